"""How many campaigns a second, on how many workers, in how much memory; and what a million on a
cluster would take.

python studies/91_fleet/run.py                        # by hand, three quarters of an hour on two
cores, nothing else running python studies/91_fleet/run.py --quick --out fleet    # small: shows
that it runs
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
POLL_S = 0.5
COLLECTED = 5000
CLUSTER = 1_000_000


@dataclass(frozen=True)
class Size:
    """What is measured: ``few`` and ``many`` campaigns of ``readings`` a test, ``broken`` of the
    many planted."""

    few: int
    many: int
    broken: int
    readings: int
    machines: tuple[int, ...]


FULL = Size(100, 1000, 20, 1000, (1000, 5000))
QUICK = Size(2, 6, 2, 60, (20,))


def plant(folder: Path, size: Size) -> list[str]:
    """Write the campaigns; every so many one that is broken, in turn torn, without a file,
    misspelt, of one force, no number."""
    angles = np.arange(size.readings) * 360.0 / size.readings
    plan = lb.Plan(
        tuple(lb.CircularTest(force_N=float(force), angle_deg=angles) for force in FORCES_N)
    )
    every = size.many // size.broken
    broken = []
    for i in range(size.many):
        made = MODEL.simulate(plan, seed=91_000 + i, parameters=TRUTH, hyper_um=HYPER_UM).campaign
        target = folder / f"{i:05d}"
        dated = f"20{10 + i // 336:02d}-{i % 336 // 28 + 1:02d}-{i % 28 + 1:02d}"
        lb.write_campaign(
            replace(made, name=f"campaign {i}", machine_id=f"M{i % 50:02d}", date=dated), target
        )
        if i % every == every - 1:
            _break(target, len(broken))
            broken.append(str(target))
    return broken


def _break(folder: Path, kind: int) -> None:
    """One of five ways to break a campaign."""
    toml = folder / "campaign.toml"
    first = sorted(folder.glob("*.csv"))[0]
    text = toml.read_text(encoding="utf-8")
    if kind % 5 == 0:
        first.write_text(first.read_text(encoding="utf-8")[:300] + ",,,", encoding="utf-8")
    elif kind % 5 == 1:
        first.unlink()
    elif kind % 5 == 2:
        toml.write_text(text.replace("topology", "topolgy"), encoding="utf-8")
    elif kind % 5 == 3:
        toml.write_text(re.sub(r"(force_N|pressure_bar) = .*", r"\1 = 3.0", text), encoding="utf-8")
    else:
        lines = first.read_text(encoding="utf-8").splitlines()
        first.write_text(
            "\n".join([*lines[:50], lines[50].split(",")[0] + ",broken", *lines[51:], ""]),
            encoding="utf-8",
        )


def batch(paths: list[str], out: Path, executor: str, workers: int) -> dict[str, Any]:
    """One batch, as a user starts it: seconds, campaigns a second, peak memory of every process,
    digest of the dataset."""
    listed = out.with_suffix(".txt")
    listed.write_text("\n".join(paths) + "\n", encoding="utf-8")
    command = [
        sys.executable,
        "-m",
        "ldbb_bayes",
        "batch",
        f"@{listed}",
        "--out",
        str(out),
        "--executor",
        executor,
    ]
    start = time.perf_counter()
    with subprocess.Popen(
        [*command, "--workers", str(workers), "--json", "--quiet"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    ) as process:
        peaks: dict[int, float] = {}
        while process.poll() is None:
            _note_peaks(process.pid, peaks)
            time.sleep(POLL_S)
        said = json.loads(process.stdout.read() if process.stdout else b"{}")
    seconds = time.perf_counter() - start
    own = peaks.pop(process.pid, 0.0)
    found = {
        "executor": executor,
        "workers": workers,
        "campaigns": len(paths),
        "seconds": seconds,
        "per_second": len(paths) / seconds,
        "collector_MB": own,
        "worker_MB": max(peaks.values(), default=own),
        "failed": sorted(entry["campaign"] for entry in said["failed"]),
        "dataset": hashlib.sha256((out / "campaigns.parquet").read_bytes()).hexdigest(),
        "journal_bytes": (out / "batch.sqlite").stat().st_size,
        "dataset_bytes": (out / "campaigns.parquet").stat().st_size,
    }
    _say(
        f"{executor}, {workers} workers, {len(paths)} campaigns: {found['per_second']:.2f}/s,"
        f" {found['worker_MB']:.0f} MB"
    )
    return found


def _note_peaks(pid: int, peaks: dict[int, float]) -> None:
    """Largest resident memory so far of a process and all below it [MB]; helpers of the executors
    count too."""
    try:
        family = [psutil.Process(pid), *psutil.Process(pid).children(recursive=True)]
    except psutil.Error:
        return
    for one in family:
        try:
            status = Path(f"/proc/{one.pid}/status").read_text(encoding="utf-8")
            (kB,) = re.findall(r"VmHWM:\s+(\d+) kB", status)
            peaks[one.pid] = max(peaks.get(one.pid, 0.0), int(kB) / 1024.0)
        except (OSError, ValueError):
            continue


def pooled(rows: pd.DataFrame, machines: int) -> dict[str, Any]:
    """A population of so many machines in a process of its own: machines it counts, seconds and
    peak memory.

    Campaigns are taken again and again, each time as readings of their own, for the same readings
    given twice count once; those whose readings the model does not expect are kept, for as many
    machines as asked for are to be pooled.
    """
    with tempfile.TemporaryDirectory() as folder:
        stem = Path(folder) / "rows.pkl"
        rows.to_pickle(stem)
        code = (
            "import sys, time, resource, pandas as pd, numpy as np, ldbb_bayes as lb\nfrom"
            " dataclasses import replace\nrows = pd.read_pickle(sys.argv[1]); n = int(sys.argv[2]);"
            " rng = np.random.default_rng(91)\nrows = rows.iloc[np.arange(n) %"
            " len(rows)].reset_index(drop=True)\nrows['machine_id'] = rows['sha256'] ="
            " rows['circles_sha256'] = [f'M{i:06d}' for i in range(n)]\nstart ="
            " time.perf_counter(); found = lb.fleet.fit_population(rows, include_misfits=True);"
            " end = time.perf_counter()\nprint(len(found.machine), end - start,"
            " resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)\n"
        )
        done = subprocess.run(
            [sys.executable, "-c", code, str(stem), str(machines)],
            capture_output=True,
            text=True,
            check=True,
        )
    counted, seconds, megabytes = map(float, done.stdout.split())
    _say(f"population of {counted:.0f} machines: {seconds:.0f} s, {megabytes:.0f} MB")
    return {"machines": int(counted), "seconds": seconds, "MB": megabytes}


def collected(out: Path, again: Path) -> float:
    """Rows a second that one process takes into a journal, of a row that a batch kept."""
    with closing(sqlite3.connect(out / "batch.sqlite")) as journal:
        (text,) = journal.execute(
            "SELECT row FROM campaigns WHERE status = 'done' LIMIT 1"
        ).fetchone()
    row = json.loads(text)
    moments = []
    paths = [str(again.parent / "campaigns"), *(f"copy {k}" for k in range(COLLECTED))]
    with mock.patch("ldbb_bayes.fleet.batch.fit_row", return_value=row):
        lb.fleet.run_batch(paths, again, progress=lambda *_: moments.append(time.perf_counter()))
    return (len(moments) - 1) / (moments[-1] - moments[0])


def measure(size: Size, folder: Path) -> dict[str, Any]:
    """Everything, one after the other."""
    (folder / "campaigns").mkdir()
    broken = plant(folder / "campaigns", size)
    paths = sorted(str(path) for path in (folder / "campaigns").iterdir())
    few = [path for path in paths if path not in broken][: size.few]
    runs = {
        f"{executor} {workers} {len(chosen)}": batch(
            chosen, folder / f"{executor}-{workers}-{len(chosen)}", executor, workers
        )
        for chosen, counts in ((few, (1, 2)), (paths, (2,)))
        for executor in ("process", "dask")
        for workers in counts
    }
    for run in runs.values():
        run["reported"] = run.pop("failed") == (
            sorted(broken) if run["campaigns"] == size.many else []
        )
    rows = lb.fleet.read_batch(folder / f"process-2-{size.many}")
    return {
        "machine": (
            f"{platform.machine()}, {os.cpu_count()} cores,"
            f" {psutil.virtual_memory().total / 2**30:.0f} GiB"
        ),
        "versions": {
            name: version(name) for name in ("numpy", "scipy", "pyarrow", "dask", "distributed")
        },
        "tests": len(FORCES_N),
        "readings": size.readings,
        "few": size.few,
        "many": size.many,
        "broken": size.broken,
        "runs": runs,
        "scaling": {
            executor: (
                runs[f"{executor} 2 {size.few}"]["per_second"]
                / runs[f"{executor} 1 {size.few}"]["per_second"]
            )
            for executor in ("process", "dask")
        },
        "same_dataset": {
            str(count): (
                len({run["dataset"] for run in runs.values() if run["campaigns"] == count}) == 1
            )
            for count in (size.few, size.many)
        },
        "collector": {
            "rows_per_second": collected(folder / f"process-2-{size.many}", folder / "again")
        },
        "population": [pooled(rows[rows["status"] == "done"], count) for count in size.machines],
    }


def planned(results: dict[str, Any]) -> dict[str, Any]:
    """A million campaigns with the measured constants."""
    many = results["runs"][f"process 2 {results['many']}"]
    per_core_hour = 3600.0 * many["per_second"] / many["workers"]
    return {
        "campaigns": CLUSTER,
        "core_hours": CLUSTER / per_core_hour,
        "hours_on": {str(cores): CLUSTER / per_core_hour / cores for cores in (2, 100, 1000)},
        "journal_GB": CLUSTER * many["journal_bytes"] / many["campaigns"] / 1e9,
        "dataset_GB": CLUSTER * many["dataset_bytes"] / many["campaigns"] / 1e9,
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
        default=FULL.many,
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
            size = replace(
                FULL,
                many=options.campaigns,
                few=options.campaigns // 10,
                broken=max(options.campaigns // 50, 1),
            )
            results = measure(QUICK if options.quick else size, Path(folder))
        results["plan"] = planned(results)
    options.out.mkdir(parents=True, exist_ok=True)
    target.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    text = page(HERE, "README.md", results)
    (options.out / "README.md").write_text(text, encoding="utf-8")


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
