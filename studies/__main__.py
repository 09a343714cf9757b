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
from functools import partial
from pathlib import Path

HERE = Path(__file__).resolve().parent
BY_HAND = ("90_speed", "91_fleet")
LONGEST = ("04_constant_or_linear", "05_next_campaign")
PASSED_ON = {"--executor": "process|dask", "--scheduler": "ADDRESS", "--workers": "N"}


def studies() -> list[Path]:
    """Folders with a script, in order."""
    return sorted(path.parent for path in HERE.glob("[0-9][0-9]_*/run.py"))


def ran(path: Path, options: list[str], *, aside: bool) -> tuple[int, float]:
    """Exit code and seconds of one study; run ``aside`` of others, what it prints comes in one
    piece when it ends."""
    start = time.perf_counter()
    if not aside:
        print(f"== {path.name}", flush=True)
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT} if aside else {}
    ended = subprocess.run(
        [sys.executable, str(path / "run.py"), *options], check=False, text=True, **streams
    )
    if aside:
        print(f"== {path.name}\n{ended.stdout}", end="", flush=True)
    return ended.returncode, time.perf_counter() - start


def main() -> None:
    """Each in a process of its own; a table of seconds at the end."""
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
    options = parser.parse_args()
    given = {option: getattr(options, option.strip("-")) for option in PASSED_ON}
    passed_on = [
        text for option, value in given.items() if value is not None for text in (option, value)
    ]
    known = studies()
    wanted = {
        number: [path for path in known if path.name.startswith(number.zfill(2))]
        for number in options.which
    }
    if options.at_once < 1:
        parser.error(f"--at-once must be at least 1, got {options.at_once}")
    unknown = [number for number, found in wanted.items() if not found]
    if unknown:
        parser.error(
            f"unknown study {unknown[0]}; there are {', '.join(path.name for path in known)}"
        )
    by_hand = [
        path
        for path in known
        if path.name in BY_HAND and any(path in found for found in wanted.values())
    ]
    if options.quick and by_hand:
        parser.error(
            f"{by_hand[0].name} is run by hand: python studies/{by_hand[0].name}/run.py --help"
        )
    chosen = [
        path
        for path in known
        if (any(path in found for found in wanted.values()) if wanted else path.name not in BY_HAND)
    ]
    own = [*(["--quick"] if options.quick else []), *passed_on]
    if options.at_once > 1:
        chosen.sort(key=lambda path: path.name not in LONGEST)
    with ThreadPoolExecutor(options.at_once) as pool:
        arguments = [[] if path.name in BY_HAND else own for path in chosen]
        ended = dict(
            zip(
                chosen,
                pool.map(partial(ran, aside=options.at_once > 1), chosen, arguments),
                strict=True,
            )
        )
    failed = [path.name for path, (code, _) in ended.items() if code]
    seconds = {path.name: taken for path, (_, taken) in ended.items()}
    print(
        "\n".join(
            f"{'FAILED ' if name in failed else 'ok     '}{name} {value:6.0f} s"
            for name, value in seconds.items()
        )
    )
    if failed:
        sys.exit(f"Not reproduced: {', '.join(failed)}")


if __name__ == "__main__":
    main()
