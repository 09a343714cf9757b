"""Run the python and sh blocks of a page in order, in this folder, and compare what they print with what the page shows.

python tests/run_page.py docs/how-to/own_term.md

A ``text`` block after another shows what that one prints: its lines, in order, an ellipsis for what is left out, numbers to a
tenth. A comment ``<!-- not executed: reason -->`` before a block keeps it from being run.
"""

from __future__ import annotations

import io
import re
import shlex
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

BLOCK = re.compile(r"^(<!-- not executed: .* -->\n+)?```(python|sh)\n(.*?)^```$(?:\n+```text\n(.*?)^```$)?", re.M | re.S)
NUMBER = re.compile(r"(?<![\w.])[-−+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?!\w)")


def same(shown: str, printed: str) -> bool:
    """Whether two lines have the same words, and the same numbers to a tenth or three units of the last digit shown."""
    begun = shown.removesuffix("…").rstrip()
    words, own = (" ".join(NUMBER.sub(" # ", line).split()) for line in (begun, printed))
    if not (own.startswith(words) if shown.endswith("…") else own == words):
        return False
    pairs = zip(NUMBER.findall(begun), NUMBER.findall(printed), strict=False)
    values = [(a, *(float(text.replace("−", "-")) for text in (a, b))) for a, b in pairs]
    return all(abs(x - y) <= 0.1 * abs(x) + 3.0 * 10.0 ** -len(a.partition(".")[2].partition("e")[0]) for a, x, y in values)


def missing(shown: str, printed: str) -> str | None:
    """Return the first line shown that is not among those printed after the one before it."""
    left = iter(printed.splitlines())
    lines = [line for line in shown.splitlines() if line.strip(" …")]
    return next((line for line in lines if not any(same(line, own) for own in left)), None)


def run(command: str) -> str:
    """Return what a command prints; its error where it fails."""
    arguments = [sys.executable, "-W", "error", "-m", "ldbb_bayes", *shlex.split(command, comments=True)[1:]]
    done = subprocess.run(arguments, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
    return done.stdout if done.returncode == 0 else sys.exit(f"{command}\n{done.stderr}")


def main(page: Path) -> None:
    """Run a page."""
    space: dict[str, Any] = {"__name__": "__main__"}
    for skipped, kind, code, shown in BLOCK.findall(page.read_text(encoding="utf-8")):
        if skipped:
            continue
        printed = io.StringIO()
        if kind == "sh":
            printed.writelines(run(line) for line in code.splitlines() if line.startswith("ldbb-bayes "))
        else:
            with redirect_stdout(printed):
                exec(compile(code, str(page), "exec"), space)
        line = missing(shown, printed.getvalue())
        if line is not None:
            sys.exit(f"{page.name}: {line.strip()!r} is not printed by\n{code}which prints\n{printed.getvalue()}")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
