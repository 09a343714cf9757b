"""How fast are the samplers and the evidence, against NUTS, nested sampling and a bridge? What do
circles and readings cost?

python studies/90_speed/run.py                        # by hand; peers: pip install '.[bench]'
python studies/90_speed/run.py --quick --out speed    # small: shows that it runs
python studies/90_speed/run.py --restate              # the page from the results that are kept
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

# One thread and one core for everybody: XLA's threads wait by spinning, which can double the CPU
# seconds of NUTS.
os.environ.setdefault(
    "XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
)

from threadpoolctl import threadpool_limits

import ldbb_bayes as lb
from ldbb_bayes.inference.integrals import CHUNK

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]
import reduced_density
from aims import aims
from costs import cost_of_readings, kernel
from log_evidences import evidence_rows
from memory import memory
from race import race
from setting import (
    COLUMNS,
    FULL,
    QUICK,
    UNTRUNCATED,
    Size,
    has,
    recovered,
    say,
    simulated,
)
from study import page
from timed_campaigns import cost_of_campaigns

PACKAGES = ("numpy", "scipy", "emcee", "jax", "numpyro", "dynesty")
# Packages without which rows of the page are missing.
PEERS = ("numpyro", "dynesty")
READINGS = 360


def measure(size: Size) -> dict[str, Any]:
    """Everything, one after the other; memory first, for nothing else is to be there."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    results: dict[str, Any] = {
        "machine": (
            f"Python {platform.python_version()}, {platform.system()} {platform.machine()},"
            f" {os.cpu_count()} cores"
        ),
        "versions": {name: version(name) for name in PACKAGES if has(name)},
        "ess": size.ess,
        "default_ess": lb.inference.StoppingRule().ess,
        "repeats": size.repeats,
        "stack": CHUNK,
        "largest": size.readings[-1],
        "columns": COLUMNS,
        "memory": memory(size.ess, size.readings[-1]),
    }
    with threadpool_limits(1):
        results |= timings(size)
    results["cpu_seconds"] = sum(os.times()[:4])
    return results


def timings(size: Size) -> dict[str, Any]:
    """All that is timed, in one thread."""
    results: dict[str, Any] = {}
    circle_counts = (len(recovered().tests), *size.circles)
    campaigns = {str(circles): simulated(circles, READINGS) for circles in circle_counts}
    if has("jax"):
        results["density_apart"] = reduced_density.check(UNTRUNCATED.bind(recovered()))
    results["kernel"] = kernel({"recovered": recovered()} | campaigns, size.rounds)
    results["race"] = race(recovered(), size, lb_sample=True)
    fewer = replace(size, repeats=min(size.repeats, 3))
    results["circles"] = {
        str(circles): race(campaigns[str(circles)], fewer, lb_sample=False)
        for circles in size.circles
    }
    results["readings"] = cost_of_readings(size)
    results["evidence"] = evidence_rows(size)
    results["campaigns"] = cost_of_campaigns(size.largest_campaign, min(size.rounds, 21))
    return results


def main() -> None:
    """Measure, and write results.json and the page."""
    parser = command_line()
    options = parser.parse_args()
    missing = [name for name in PEERS if not has(name)]
    target = options.out / "results.json"
    if options.restate:
        results = json.loads(target.read_text("utf-8"))
    else:
        if options.out == HERE and (options.quick or missing):
            parser.error(refusal(missing))
        for name in missing:
            say(f"{name} is not installed, its rows are left out: pip install '.[bench]'")
        results = measure(size_of(options))
    options.out.mkdir(parents=True, exist_ok=True)
    write_json(target, results)
    if not missing or options.restate:
        results["aims"] = aims(results)
        results["commands"] = json.loads((HERE / "whole_commands.json").read_text("utf-8"))
        write_json(target, results)
        (options.out / "README.md").write_text(page(HERE, "README.md", results), encoding="utf-8")
    for name, row in results["race"].items():
        print(f"{name:40s} {row['per_cpu']['median']:10,.0f} effective draws per CPU second")
    if any(row["apart"] > 3.0 for row in results["evidence"]):
        sys.exit("Evidences differ by more than three of their errors.")


def command_line() -> argparse.ArgumentParser:
    """The options."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="small sizes")
    parser.add_argument(
        "--restate", action="store_true", help="write the page from the results that are kept"
    )
    parser.add_argument(
        "--out", type=Path, default=HERE, help="folder for results.json and README.md"
    )
    return parser


def size_of(options: argparse.Namespace) -> Size:
    """How much is run."""
    if options.quick:
        return QUICK
    return FULL


def refusal(missing: list[str]) -> str:
    """Why the results of this folder are not replaced."""
    text = "small or partial results must not replace those kept here: give --out FOLDER"
    if missing:
        text += f"; {' and '.join(missing)} must be installed: pip install '.[bench]'"
    return text


def write_json(path: Path, results: dict[str, Any]) -> None:
    """Write the results."""
    path.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
