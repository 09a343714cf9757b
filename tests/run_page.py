"""Run the python and sh blocks of a page in order, in this folder, and compare what they print with
what the page shows.

A ``text`` block after another shows what that one prints: its lines, in order, an ellipsis for what
is left out, numbers to a tenth. A comment ``<!-- not executed: reason -->`` before a block keeps it
from being run.
"""

import io
import re
import shlex
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path

BLOCK = re.compile(
    r"^(<!-- not executed: .* -->\n+)?```(python|sh)\n(.*?)^```$(?:\n+```text\n(.*?)^```$)?",
    re.M | re.S,
)
NUMBER = re.compile(r"(?<![\w.])[-−+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?!\w)")


def same(shown: str, printed: str) -> bool:
    """Whether two lines have the same words, and the same numbers to a tenth or three units of the
    last digit shown."""
    words, own = (
        " ".join(NUMBER.sub(" # ", line).split()) for line in (shown.removesuffix("…"), printed)
    )
    if not (own.startswith(words) if shown.endswith("…") else own == words):
        return False
    for text, other in zip(NUMBER.findall(shown), NUMBER.findall(printed), strict=False):
        value, found = (float(number.replace("−", "-")) for number in (text, other))
        if abs(value - found) > 0.1 * abs(value) + 3.0 * 10.0 ** -len(
            text.partition(".")[2].partition("e")[0]
        ):
            return False
    return True


def missing(shown: str, printed: str) -> str | None:
    """Return the first line shown that is not among those printed after the one before it."""
    left = iter(printed.splitlines())
    return next(
        (
            line
            for line in shown.splitlines()
            if line.strip(" …") and not any(same(line, own) for own in left)
        ),
        None,
    )


def main(page: Path) -> None:
    space = {"__name__": "__main__"}
    for skipped, kind, code, shown in BLOCK.findall(page.read_text(encoding="utf-8")):
        printed = io.StringIO()
        if kind == "python" and not skipped:
            with redirect_stdout(printed):
                exec(compile(code, str(page), "exec"), space)
        for command in (
            re.findall(r"^ldbb-bayes .*$", code, re.M) if kind == "sh" and not skipped else []
        ):
            arguments = [
                sys.executable,
                "-W",
                "error",
                "-m",
                "ldbb_bayes",
                *shlex.split(command, comments=True)[1:],
            ]
            done = subprocess.run(
                arguments, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL
            )
            printed.write(
                done.stdout
                if done.returncode == 0
                else sys.exit(f"{page.name}: {command}\n{done.stderr}")
            )
        if not skipped and (line := missing(shown, printed.getvalue())):
            sys.exit(
                f"{page.name}: {line.strip()!r} is not printed by\n{code}which"
                f" prints\n{printed.getvalue()}"
            )


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
