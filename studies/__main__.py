"""Run the studies: `python studies` all but those run by hand, `python studies 01 04` some,
`--quick` for a smaller run of each, `--at-once 2` two of them at a time.

Exit code 1 when a number that a study states is not reproduced.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).resolve().parent
# Run by hand: they take long, and have options of their own.
BY_HAND = ("90_speed", "91_fleet")
# Begun first where several run at once.
LONGEST = ("04_constant_or_linear", "05_next_campaign")
# Options that are passed on to each study.
PASSED_ON = {"--executor": "process|dask", "--scheduler": "ADDRESS", "--workers": "N"}


class Outcome(NamedTuple):
    """How a study ended."""

    name: str
    exit_code: int
    seconds: float


def studies() -> list[Path]:
    """Folders with a script, in order."""
    return sorted(path.parent for path in HERE.glob("[0-9][0-9]_*/run.py"))


def run_study(folder: Path, options: list[str], *, side_by_side: bool) -> Outcome:
    """Run one study in a process of its own.

    ``side_by_side``: with others; what it prints comes in one piece when it ends.
    """
    start = time.perf_counter()
    command = [sys.executable, str(folder / "run.py"), *options]
    if side_by_side:
        process = subprocess.run(
            command, check=False, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        print(f"== {folder.name}\n{process.stdout}", end="", flush=True)
    else:
        print(f"== {folder.name}", flush=True)
        process = subprocess.run(command, check=False)
    return Outcome(folder.name, process.returncode, time.perf_counter() - start)


def command_line() -> argparse.ArgumentParser:
    """The options of ``python studies``."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "which", nargs="*", metavar="NUMBER", help="numbers of studies, for example 01 04"
    )
    parser.add_argument(
        "--quick", action="store_true", help="fewer simulated campaigns are made again"
    )
    parser.add_argument(
        "--at-once", type=int, default=1, metavar="N", help="studies that run side by side"
    )
    for option, metavar in PASSED_ON.items():
        parser.add_argument(option, metavar=metavar, help="see run.py --help of a study")
    return parser


def chosen_studies(parser: argparse.ArgumentParser, options: argparse.Namespace) -> list[Path]:
    """The folders that are asked for, in order; without numbers all but those run by hand."""
    folders = studies()
    if not options.which:
        return [folder for folder in folders if folder.name not in BY_HAND]
    chosen: set[Path] = set()
    for number in options.which:
        with_number = {folder for folder in folders if folder.name.startswith(number.zfill(2))}
        if not with_number:
            names = ", ".join(folder.name for folder in folders)
            parser.error(f"unknown study {number}; there are {names}")
        chosen |= with_number
    by_hand = [folder.name for folder in sorted(chosen) if folder.name in BY_HAND]
    if options.quick and by_hand:
        parser.error(f"{by_hand[0]} is run by hand: python studies/{by_hand[0]}/run.py --help")
    return sorted(chosen)


def options_of_study(folder: Path, options: argparse.Namespace) -> list[str]:
    """The options that a study is run with; those run by hand have options of their own."""
    if folder.name in BY_HAND:
        return []
    texts = ["--quick"] if options.quick else []
    for option in PASSED_ON:
        value = getattr(options, option.strip("-"))
        if value is not None:
            texts += [option, value]
    return texts


def run_all(folders: list[Path], options: argparse.Namespace) -> list[Outcome]:
    """Run the studies, so many at once, the longest first where there are several at once."""
    side_by_side = options.at_once > 1
    if side_by_side:
        longest = [folder for folder in folders if folder.name in LONGEST]
        folders = longest + [folder for folder in folders if folder.name not in LONGEST]
    with ThreadPoolExecutor(options.at_once) as pool:
        futures = []
        for folder in folders:
            arguments = options_of_study(folder, options)
            futures.append(pool.submit(run_study, folder, arguments, side_by_side=side_by_side))
        return [future.result() for future in futures]


def main() -> None:
    """Run the studies, each in a process of its own; print a table of seconds at the end."""
    parser = command_line()
    options = parser.parse_args()
    if options.at_once < 1:
        parser.error(f"--at-once must be at least 1, got {options.at_once}")
    outcomes = run_all(chosen_studies(parser, options), options)
    for outcome in outcomes:
        word = "FAILED" if outcome.exit_code else "ok    "
        print(f"{word} {outcome.name} {outcome.seconds:6.0f} s")
    failed = [outcome.name for outcome in outcomes if outcome.exit_code]
    if failed:
        sys.exit(f"Not reproduced: {', '.join(failed)}")


if __name__ == "__main__":
    main()
