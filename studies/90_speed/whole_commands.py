"""What whole commands take, libraries and two processes included, on Linux or macOS.

Each command runs in a process of its own, several times; seconds of the clock and of the processor
are medians. Campaigns are simulated, except the recovered experiment.

    python studies/90_speed/whole_commands.py            # six minutes, with nothing else at work
    python studies/90_speed/run.py --restate             # write the page, with the new rows
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ldbb_bayes as lb

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from timed_campaigns import ALL_PLANES, Kind

RECOVERED = HERE.parents[1] / "data" / "recovered_experiment"
CAMPAIGNS = {"six": Kind(6), "three planes": Kind(3, ALL_PLANES), "forty": Kind(40)}
# Campaigns of a batch: of one plan, and of six plans in turn.
FLEETS = {
    "one plan": [Kind(6)],
    "mixed plans": [
        Kind(4),
        Kind(6),
        Kind(12),
        Kind(6, directions=("CW", "CCW")),
        Kind(3, radii_mm=(100.0, 150.0)),
        Kind(6, quiet=True),
    ],
}
FLEET_SIZE = 200
# Exit code of a command some of whose fits have too few draws.
FEW_DRAWS = 1
GOALS = ("--goal", "C_XXX=5%", "--goal", "E_C0YX=10urad")


@dataclass(frozen=True)
class Command:
    """A command line, and what was asked of it."""

    title: str
    arguments: Sequence[str]
    asked: float
    #: whether seconds of the clock, seconds of the processor or campaigns a second are asked for
    unit: str = "s"


@dataclass(frozen=True)
class Took:
    """Seconds that a process and those that it started have taken."""

    clock_s: float
    cpu_s: float


def commands(folder: Path) -> list[Command]:
    """Return the commands; ``folder`` holds the campaigns, and takes what the commands write."""
    six, planes, forty = (str(folder / name) for name in CAMPAIGNS)
    recovered = str(RECOVERED)
    batches = []
    for name, asked in (("one plan", 8.0), ("mixed plans", 3.0)):
        batches.append(
            Command(
                f"`batch` of {FLEET_SIZE} campaigns, {name}",
                ["batch", str(folder / name), "--out", "OUT", "--workers", "2"],
                asked,
                "campaigns/s",
            )
        )
    return [
        Command("`report` of six circles", ["report", six, "--out", "OUT"], 8.0),
        Command(
            "`report` of six circles, sheets only",
            ["report", six, "--sheets-only", "--out", "OUT"],
            4.0,
        ),
        Command(
            "`report` of nine circles in three planes", ["report", planes, "--out", "OUT"], 30.0
        ),
        Command("`report` of forty circles", ["report", forty, "--out", "OUT"], 30.0),
        Command("`compare`, recovered experiment", ["compare", recovered], 5.0, "CPU s"),
        Command("`design` in three planes", ["design", planes, "--tests", "9"], 30.0),
        Command("`design` for two goals", ["design", recovered, *GOALS], 20.0),
        Command("`next`, two goals", ["next", recovered, *GOALS], 2.0),
        *batches,
    ]


def write_campaigns(folder: Path) -> None:
    """Write all campaigns into a folder."""
    for name, kind in CAMPAIGNS.items():
        lb.write_campaign(kind.campaign(), folder / name)
    for name, kinds in FLEETS.items():
        for k in range(FLEET_SIZE):
            lb.write_campaign(kinds[k % len(kinds)].campaign(seed=k), folder / name / f"{k:03d}")


def took(arguments: Sequence[str], folder: Path) -> Took:
    """Return what a command takes. What it writes to OUT goes into a new folder."""
    out = tempfile.mkdtemp(dir=folder)
    line = [argument.replace("OUT", f"{out}/out") for argument in arguments]
    start = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "ldbb_bayes", *line],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _, status, usage = os.wait4(process.pid, 0)
    clock = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in (0, FEW_DRAWS):
        sys.exit(f"{' '.join(line)} ended with {process.returncode}")
    return Took(clock, usage.ru_utime + usage.ru_stime)


def measure(command: Command, folder: Path, repeats: int) -> dict[str, Any]:
    """Return medians of what a command takes, beside what was asked."""
    runs = [took(command.arguments, folder) for _ in range(repeats)]
    clock = statistics.median(run.clock_s for run in runs)
    cpu = statistics.median(run.cpu_s for run in runs)
    by_unit = {"s": clock, "CPU s": cpu, "campaigns/s": FLEET_SIZE / clock}
    measured = by_unit[command.unit]
    reached = measured <= command.asked
    if command.unit == "campaigns/s":
        reached = measured >= command.asked
    return {
        "what": command.title,
        "clock_s": clock,
        "cpu_s": cpu,
        "found": measured,
        "asked": command.asked,
        "unit": command.unit,
        "reached": reached,
    }


def main() -> None:
    """Measure, and write whole_commands.json."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--repeats", type=int, default=3, help="runs of each command")
    parser.add_argument("--out", type=Path, default=HERE, help="folder of whole_commands.json")
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write_campaigns(folder)
        took(["identify", str(RECOVERED)], folder)  # what is loaded first from the disk
        for command in commands(folder):
            repeats = options.repeats
            if command.unit == "campaigns/s":
                repeats = 1
            row = measure(command, folder, repeats)
            rows.append(row)
            print(f"{row['what']:45s} {row['found']:6.1f} {row['unit']}", flush=True)
    text = json.dumps({"repeats": options.repeats, "rows": rows}, indent=1)
    (options.out / "whole_commands.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
