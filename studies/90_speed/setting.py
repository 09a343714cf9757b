"""Sizes, campaigns and clocks of the speed study."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import ldbb_bayes as lb

sys.path[:0] = [str(Path(__file__).resolve().parents[1])]
from study import DATA

__all__ = [
    "COLUMNS",
    "FULL",
    "MODEL",
    "QUICK",
    "SAMPLERS",
    "UNTRUNCATED",
    "Array",
    "Clocked",
    "Size",
    "clocked",
    "has",
    "recovered",
    "say",
    "simulated",
    "spread",
]

Array = NDArray[Any]
MODEL = lb.HybridModel.first(degree=1)
UNTRUNCATED = MODEL.without("truncation")
# The simulated machine, and the scales of its nuisances [µm].
TRUTH = {"C_XXX": 6e-5, "C_YYY": 5e-5, "C_CCY": 5e-10}
HYPER_UM = {"sigma": 0.15, "delta": 0.4, "kappa": 0.3, "tau": 3.0}
LOWEST_N = 36.0
HIGHEST_N = 742.0
N_PER_BAR = 126.0
SAMPLERS = ("joint", "independent")
# Columns of the least squares that one circle is compared with.
COLUMNS = 13


@dataclass(frozen=True)
class Size:
    """How much is run."""

    ess: float  #: effective draws asked for
    repeats: int  #: runs of each row
    circles: tuple[int, ...]  #: numbers of circles, beside those of the experiment
    readings: tuple[int, ...]  #: numbers of readings of a circle
    rounds: int  #: of the kernel
    degrees: tuple[int, ...]  #: of the models whose evidence is compared
    largest_campaign: int  #: circles of the largest campaign of the default model


FULL = Size(
    ess=10_000.0,
    repeats=7,
    circles=(12, 24, 40),
    readings=(1_000, 10_000, 100_000, 1_000_000),
    rounds=101,
    degrees=(0, 1),
    largest_campaign=40,
)
QUICK = Size(
    ess=1000.0,
    repeats=1,
    circles=(12,),
    readings=(1_000, 10_000),
    rounds=5,
    degrees=(1,),
    largest_campaign=6,
)


@dataclass(frozen=True)
class Clocked:
    """Seconds of the processor, of all threads, and of the clock on the wall."""

    cpu: float
    wall: float


def clocked(work: Callable[..., Any], *arguments: Any) -> tuple[Any, Clocked]:
    """What the work returns, and what it took."""
    cpu_start = time.process_time()
    wall_start = time.perf_counter()
    result = work(*arguments)
    cpu = time.process_time() - cpu_start
    return result, Clocked(cpu, time.perf_counter() - wall_start)


def spread(values: Any) -> dict[str, float]:
    """Median and quartiles."""
    low, median, high = np.quantile(values, [0.25, 0.5, 0.75])
    return {"median": float(median), "low": float(low), "high": float(high)}


@cache
def recovered() -> lb.Campaign:
    """The recovered experiment."""
    return lb.read_campaign(DATA / "recovered_experiment")


def simulated(circles: int, readings: int) -> lb.Campaign:
    """Circles from 36 to 742 N of so many readings each."""
    angle_deg = np.arange(readings) * 360.0 / readings
    tests = []
    for force_N in np.linspace(LOWEST_N, HIGHEST_N, circles):
        tests.append(lb.CircularTest(force_N, angle_deg, pressure_bar=force_N / N_PER_BAR))
    plan = lb.Plan(tuple(tests))
    return MODEL.simulate(plan, seed=2, parameters=TRUTH, hyper_um=HYPER_UM).campaign


def has(name: str) -> bool:
    """Whether a package is installed."""
    try:
        version(name)
    except PackageNotFoundError:
        return False
    return True


def say(text: str) -> None:
    """Progress."""
    print(text, file=sys.stderr, flush=True)
