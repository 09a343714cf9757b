"""Peak memory of whole tasks, each in a process of its own."""

from __future__ import annotations

import re
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from costs import least_squares
from nuts import NUTS, ReducedNuts
from race import sampler_draws
from setting import MODEL, SAMPLERS, UNTRUNCATED, has, recovered
from threadpoolctl import threadpool_limits

import ldbb_bayes as lb
from ldbb_bayes.model.reduction import reduce_readings

__all__ = ["memory"]


def memory(ess: float, readings: int) -> dict[str, dict[str, float]]:
    """Peak MB of resident memory, and how much there was before the work began, by task."""
    tasks = ["independent", "joint", "lb.sample", "lb.log_evidence", "reduce", "lstsq"]
    if has("numpyro"):
        tasks += list(NUTS)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        peaks = pool.map(peak_of, repeat(ess), repeat(readings), tasks)
        return dict(zip(tasks, peaks, strict=True))


def peak_of(ess: float, readings: int, task: str) -> dict[str, float]:
    """One task, here: package and campaign are there before, a peer's libraries and compilation
    are not."""
    bound = UNTRUNCATED.bind(recovered())
    angle_rad = np.arange(readings) * (2.0 * np.pi / readings)
    reading_mm = 1e-4 * np.random.default_rng(0).standard_normal(readings)
    before_MB = peak_MB()
    with threadpool_limits(1):
        if task in SAMPLERS:
            sampler_draws(bound, task, ess, 1)
        elif task in NUTS:
            ReducedNuts(bound, whitened=NUTS[task]).run(1)
        elif task == "lb.sample":
            lb.sample(MODEL, recovered())
        elif task == "lb.log_evidence":
            lb.log_evidence(MODEL, recovered())
        elif task == "reduce":
            reduce_readings(angle_rad, reading_mm)
        elif task == "lstsq":
            least_squares(angle_rad, reading_mm)
        else:
            raise ValueError(f"unknown task {task}")
    return {"before": before_MB, "peak": peak_MB()}


def peak_MB() -> float:
    """Of this process so far, by Linux."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    (kilobytes,) = re.findall(r"VmHWM:\s+(\d+) kB", status)
    return float(kilobytes) / 1024.0
