"""How many campaigns a second, on how many workers, in how much memory; and what a million on a
cluster would take.

python studies/91_fleet/run.py                        # by hand, three quarters of an hour on two
                                                      # cores, nothing else running
python studies/91_fleet/run.py --quick --out fleet    # small: shows that it runs
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import platform
import re
import sqlite3
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pandas as pd
import psutil

import ldbb_bayes as lb

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from study import page

FORCES_N = np.linspace(36.0, 742.0, 7)
MODEL = lb.HybridModel.first(degree=1)
TRUTH = {"C_XXX": 6e-5, "C_YYY": 5e-5, "C_CCY": 5e-10}
HYPER_UM = {"sigma": 0.15, "delta": 0.4, "kappa": 0.3, "tau": 3.0}
# Seconds between two looks at the memory of a batch.
POLL_S = 0.5
# Rows that the collector takes into a journal.
ROWS_COLLECTED = 5000
# Campaigns of the plan for a cluster, and numbers of cores it may have.
CLUSTER_CAMPAIGNS = 1_000_000
CLUSTER_CORES = (2, 100, 1000)
EXECUTORS = ("process", "dask")
PACKAGES = ("numpy", "scipy", "pyarrow", "dask", "distributed")


@dataclass(frozen=True)
class Size:
    """What is measured."""

    small_batch: int  #: campaigns of the small batches, none of them broken
    large_batch: int  #: campaigns of the large batches, all there are
    broken: int  #: of the campaigns of a large batch
    readings: int  #: of a test
    machines: tuple[int, ...]  #: sizes of the populations


FULL = Size(small_batch=100, large_batch=1000, broken=20, readings=1000, machines=(1000, 5000))
QUICK = Size(small_batch=2, large_batch=6, broken=2, readings=60, machines=(20,))

# Pools a population of so many machines from a table of rows, and prints the machines counted,
# seconds and peak memory. Each campaign counts as readings of its own.
POPULATION_SCRIPT = """
import resource, sys, time
import numpy as np, pandas as pd
import ldbb_bayes as lb

rows = pd.read_pickle(sys.argv[1])
machines = int(sys.argv[2])
rows = rows.iloc[np.arange(machines) % len(rows)].reset_index(drop=True)
names = [f"M{number:06d}" for number in range(machines)]
rows["machine_id"] = rows["sha256"] = rows["circles_sha256"] = names
start = time.perf_counter()
population = lb.fleet.fit_population(rows, include_misfits=True)
seconds = time.perf_counter() - start
peak_MB = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(len(population.machine), seconds, peak_MB)
"""


def plant(folder: Path, size: Size) -> list[str]:
    """Write the campaigns, and return the folders of those that are broken, in equal steps."""
    angle_deg = np.arange(size.readings) * 360.0 / size.readings
    tests = tuple(lb.CircularTest(force_N=float(force), angle_deg=angle_deg) for force in FORCES_N)
    plan = lb.Plan(tests)
    step = size.large_batch // size.broken
    broken: list[str] = []
    for number in range(size.large_batch):
        target = folder / f"{number:05d}"
        lb.write_campaign(simulated_campaign(plan, number), target)
        if number % step == step - 1:
            break_campaign(target, len(broken))
            broken.append(str(target))
    return broken


def simulated_campaign(plan: lb.Plan, number: int) -> lb.Campaign:
    """One of fifty machines, each campaign dated a day later than the last."""
    simulation = MODEL.simulate(plan, seed=91_000 + number, parameters=TRUTH, hyper_um=HYPER_UM)
    year = 10 + number // 336
    month = number % 336 // 28 + 1
    day = number % 28 + 1
    return replace(
        simulation.campaign,
        name=f"campaign {number}",
        machine_id=f"M{number % 50:02d}",
        date=f"20{year:02d}-{month:02d}-{day:02d}",
    )


def break_campaign(folder: Path, kind: int) -> None:
    """In one of five ways in turn: torn table, missing file, misspelt key, one force, a word among
    the numbers."""
    toml = folder / "campaign.toml"
    first_table = sorted(folder.glob("*.csv"))[0]
    text = toml.read_text(encoding="utf-8")
    if kind % 5 == 0:
        torn = first_table.read_text(encoding="utf-8")[:300] + ",,,"
        first_table.write_text(torn, encoding="utf-8")
    elif kind % 5 == 1:
        first_table.unlink()
    elif kind % 5 == 2:
        toml.write_text(text.replace("topology", "topolgy"), encoding="utf-8")
    elif kind % 5 == 3:
        one_force = re.sub(r"(force_N|pressure_bar) = .*", r"\1 = 3.0", text)
        toml.write_text(one_force, encoding="utf-8")
    else:
        lines = first_table.read_text(encoding="utf-8").splitlines()
        lines[50] = lines[50].split(",")[0] + ",broken"
        first_table.write_text("\n".join([*lines, ""]), encoding="utf-8")


def run_batch(paths: list[str], out: Path, executor: str, workers: int) -> dict[str, Any]:
    """One batch, as a user starts it: seconds, campaigns a second, peak memory of every process,
    digest of the dataset."""
    list_of_paths = out.with_suffix(".txt")
    list_of_paths.write_text("\n".join(paths) + "\n", encoding="utf-8")
    command = [sys.executable, "-m", "ldbb_bayes", "batch", f"@{list_of_paths}"]
    command += ["--out", str(out), "--executor", executor, "--workers", str(workers)]
    command += ["--json", "--quiet"]
    peaks_MB: dict[int, float] = {}
    start = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        assert process.stdout is not None
        while process.poll() is None:
            note_peaks(process.pid, peaks_MB)
            time.sleep(POLL_S)
        answer = json.loads(process.stdout.read())
    seconds = time.perf_counter() - start
    collector_MB = peaks_MB.pop(process.pid, 0.0)
    worker_MB = max(peaks_MB.values(), default=collector_MB)
    per_second = len(paths) / seconds
    say(
        f"{executor}, {workers} workers, {len(paths)} campaigns: {per_second:.2f}/s,"
        f" {worker_MB:.0f} MB"
    )
    return {
        "executor": executor,
        "workers": workers,
        "campaigns": len(paths),
        "seconds": seconds,
        "per_second": per_second,
        "collector_MB": collector_MB,
        "worker_MB": worker_MB,
        "failed": sorted(entry["campaign"] for entry in answer["failed"]),
        "dataset": hashlib.sha256((out / "campaigns.parquet").read_bytes()).hexdigest(),
        "journal_bytes": (out / "batch.sqlite").stat().st_size,
        "dataset_bytes": (out / "campaigns.parquet").stat().st_size,
    }


def note_peaks(pid: int, peaks_MB: dict[int, float]) -> None:
    """Largest resident memory so far of a process and all below it; helpers of the executors count
    too."""
    try:
        family = [psutil.Process(pid), *psutil.Process(pid).children(recursive=True)]
    except psutil.Error:
        return
    for member in family:
        try:
            status = Path(f"/proc/{member.pid}/status").read_text(encoding="utf-8")
            (kilobytes,) = re.findall(r"VmHWM:\s+(\d+) kB", status)
        except (OSError, ValueError):
            continue
        peaks_MB[member.pid] = max(peaks_MB.get(member.pid, 0.0), int(kilobytes) / 1024.0)


def pool_population(rows: pd.DataFrame, machines: int) -> dict[str, Any]:
    """A population of so many machines in a process of its own: machines it counts, seconds and
    peak memory.

    Campaigns are taken again and again, each time as readings of their own, for the same readings
    given twice count once; those whose readings the model does not expect are kept, for as many
    machines as asked for are to be pooled.
    """
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "rows.pkl"
        rows.to_pickle(table)
        process = subprocess.run(
            [sys.executable, "-c", POPULATION_SCRIPT, str(table), str(machines)],
            capture_output=True,
            text=True,
            check=True,
        )
    counted, seconds, megabytes = process.stdout.split()
    say(f"population of {counted} machines: {float(seconds):.0f} s, {float(megabytes):.0f} MB")
    return {"machines": int(counted), "seconds": float(seconds), "MB": float(megabytes)}


def rows_collected_per_second(batch_folder: Path, out: Path) -> float:
    """Rows a second that one process takes into a journal, of a row that a batch kept."""
    with closing(sqlite3.connect(batch_folder / "batch.sqlite")) as journal:
        (text,) = journal.execute(
            "SELECT row FROM campaigns WHERE status = 'done' LIMIT 1"
        ).fetchone()
    moments = []

    def note_moment(*_: object) -> None:
        moments.append(time.perf_counter())

    paths = [f"copy {number}" for number in range(ROWS_COLLECTED)]
    paths.insert(0, str(out.parent / "campaigns"))
    with mock.patch("ldbb_bayes.fleet.batch.fit_row", return_value=json.loads(text)):
        lb.fleet.run_batch(paths, out, progress=note_moment)
    return (len(moments) - 1) / (moments[-1] - moments[0])


def run_batches(folder: Path, broken: list[str], size: Size) -> dict[str, dict[str, Any]]:
    """The small batch on one worker and on two, then the large one on two, by executor.

    Each says whether it ``reported`` the broken campaigns and no others.
    """
    paths = sorted(str(path) for path in (folder / "campaigns").iterdir())
    sound = [path for path in paths if path not in broken]
    small_batch = sound[: size.small_batch]
    runs = {}
    for batch, worker_counts in ((small_batch, (1, 2)), (paths, (2,))):
        broken_here = sorted(path for path in broken if path in batch)
        for executor in EXECUTORS:
            for workers in worker_counts:
                out = folder / f"{executor}-{workers}-{len(batch)}"
                run = run_batch(batch, out, executor, workers)
                run["reported"] = run.pop("failed") == broken_here
                runs[f"{executor} {workers} {len(batch)}"] = run
    return runs


def speed_up(runs: dict[str, dict[str, Any]], executor: str, campaigns: int) -> float:
    """Campaigns a second with two workers over those with one."""
    with_two = runs[f"{executor} 2 {campaigns}"]["per_second"]
    with_one = runs[f"{executor} 1 {campaigns}"]["per_second"]
    return with_two / with_one


def is_same_dataset(runs: dict[str, dict[str, Any]], campaigns: int) -> bool:
    """Whether all batches of so many campaigns gave the same dataset to the last bit."""
    digests = {run["dataset"] for run in runs.values() if run["campaigns"] == campaigns}
    return len(digests) == 1


def measure(size: Size, folder: Path) -> dict[str, Any]:
    """Everything, one after the other."""
    (folder / "campaigns").mkdir()
    broken = plant(folder / "campaigns", size)
    runs = run_batches(folder, broken, size)
    largest = folder / f"process-2-{size.large_batch}"
    rows = lb.fleet.read_batch(largest)
    fitted = rows[rows["status"] == "done"]
    sizes = (size.small_batch, size.large_batch)
    return {
        "machine": (
            f"{platform.machine()}, {os.cpu_count()} cores,"
            f" {psutil.virtual_memory().total / 2**30:.0f} GiB"
        ),
        "versions": {name: version(name) for name in PACKAGES},
        "tests": len(FORCES_N),
        "readings": size.readings,
        "few": size.small_batch,
        "many": size.large_batch,
        "broken": size.broken,
        "runs": runs,
        "scaling": {name: speed_up(runs, name, size.small_batch) for name in EXECUTORS},
        "same_dataset": {str(count): is_same_dataset(runs, count) for count in sizes},
        "collector": {"rows_per_second": rows_collected_per_second(largest, folder / "again")},
        "population": [pool_population(fitted, machines) for machines in size.machines],
    }


def plan_for_cluster(results: dict[str, Any]) -> dict[str, Any]:
    """A million campaigns with the measured constants."""
    run = results["runs"][f"process 2 {results['many']}"]
    per_core_hour = 3600.0 * run["per_second"] / run["workers"]
    core_hours = CLUSTER_CAMPAIGNS / per_core_hour
    return {
        "campaigns": CLUSTER_CAMPAIGNS,
        "core_hours": core_hours,
        "hours_on": {str(cores): core_hours / cores for cores in CLUSTER_CORES},
        "journal_GB": CLUSTER_CAMPAIGNS * run["journal_bytes"] / run["campaigns"] / 1e9,
        "dataset_GB": CLUSTER_CAMPAIGNS * run["dataset_bytes"] / run["campaigns"] / 1e9,
        "rows_per_second_on_1000": 1000.0 * per_core_hour / 3600.0,
    }


def main() -> None:
    """Measure, and write results.json and the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="a few small campaigns")
    parser.add_argument(
        "--campaigns",
        type=int,
        default=FULL.large_batch,
        help="of the larger batches; the smaller have a tenth of it",
    )
    parser.add_argument(
        "--out", type=Path, default=HERE, help="where results.json and README.md go"
    )
    parser.add_argument(
        "--restate", action="store_true", help="write the page from the results that are kept"
    )
    options = parser.parse_args()
    target = options.out / "results.json"
    if options.restate:
        results = json.loads(target.read_text(encoding="utf-8"))
    else:
        with tempfile.TemporaryDirectory() as folder:
            results = measure(size_of(options), Path(folder))
        results["plan"] = plan_for_cluster(results)
    options.out.mkdir(parents=True, exist_ok=True)
    target.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    text = page(HERE, "README.md", results)
    (options.out / "README.md").write_text(text, encoding="utf-8")


def size_of(options: argparse.Namespace) -> Size:
    """What is measured."""
    if options.quick:
        return QUICK
    return replace(
        FULL,
        large_batch=options.campaigns,
        small_batch=options.campaigns // 10,
        broken=max(options.campaigns // 50, 1),
    )


def say(text: str) -> None:
    """Progress."""
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
