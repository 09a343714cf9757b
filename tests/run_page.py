"""Run the python and sh blocks of a page in order, in this folder, and compare what they print with
what the page shows.

A ``text`` block after another shows what that one prints: its lines, in order, an ellipsis for what
is left out, numbers to two units of the last digit shown. A comment ``<!-- not executed: reason
-->`` before a block keeps it from being run.
"""

import io
import re
import shlex
import subprocess
import sys
from contextlib import redirect_stdout
from decimal import Decimal
from pathlib import Path

from demonstrations import copied_demonstration

BLOCK = re.compile(
    r"^(<!-- not executed: [^\n]* -->\n+)?```(python|sh)\n(.*?)^```$(?:\n+```text\n(.*?)^```$)?",
    re.M | re.S,
)
NUMBER = re.compile(r"(?<![\w.])[-−+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?!\w)")


def same(expected: str, printed: str) -> bool:
    """Whether two lines have the same words, and the same numbers to two units of the last digit
    shown."""
    words = words_of(expected.removesuffix("…"))
    printed_words = words_of(printed)
    if expected.endswith("…"):
        printed_words = printed_words[: len(words)]
    if printed_words != words:
        return False
    pairs = zip(NUMBER.findall(expected), NUMBER.findall(printed), strict=False)
    return all(near(text, printed_text) for text, printed_text in pairs)


def words_of(line: str) -> str:
    return " ".join(NUMBER.sub(" # ", line).split())


def near(text: str, printed: str) -> bool:
    """Whether two numbers agree to two units of the last digit of the first.

    Another processor moves the last digit of a number that comes from draws.
    """
    value = Decimal(text.replace("−", "-"))
    printed_value = Decimal(printed.replace("−", "-"))
    last_digit = Decimal((0, (1,), value.as_tuple().exponent))
    return abs(value - printed_value) <= 2 * last_digit


def missing(expected: str, printed: str) -> str | None:
    """Return the first line shown that is not among those printed after the one before it."""
    remaining_lines = iter(printed.splitlines())
    for line in expected.splitlines():
        if not line.strip(" …"):
            continue
        if not any(same(line, printed_line) for printed_line in remaining_lines):
            return line
    return None


def run_command(page: Path, command: str, demonstration: Path) -> str:
    """Return what a command of the package prints; the run ends where it fails.

    The demonstration is taken from where it is kept.
    """
    if command == "ldbb-bayes demo":
        return copied_demonstration(demonstration, Path.cwd())
    words = shlex.split(command, comments=True)[1:]
    arguments = [sys.executable, "-W", "error", "-m", "ldbb_bayes", *words]
    ended = subprocess.run(
        arguments, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL
    )
    if ended.returncode != 0:
        sys.exit(f"{page.name}: {command}\n{ended.stderr}")
    return ended.stdout


def main(page: Path, demonstration: Path) -> None:
    space = {"__name__": "__main__"}
    for skipped, kind, code, expected in BLOCK.findall(page.read_text(encoding="utf-8")):
        if skipped:
            continue
        printed = io.StringIO()
        if kind == "python":
            with redirect_stdout(printed):
                exec(compile(code, str(page), "exec"), space)
        else:
            for command in re.findall(r"^ldbb-bayes .*$", code, re.M):
                printed.write(run_command(page, command, demonstration))
        line = missing(expected, printed.getvalue())
        if line:
            sys.exit(
                f"{page.name}: {line.strip()!r} is not printed by\n{code}which"
                f" prints\n{printed.getvalue()}"
            )


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), Path(sys.argv[2]))
