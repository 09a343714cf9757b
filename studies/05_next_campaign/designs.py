"""Every design the study speaks of."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from functools import cache
from itertools import product
from typing import Any

import numpy as np
from study import DATA

import ldbb_bayes as lb

LINEAR = lb.HybridModel.default(degree=1)
LEVELS_N = tuple(np.linspace(36.0, 742.0, 15))
FINE_N = tuple(np.linspace(36.0, 742.0, 101))
FIVE_N = tuple(np.linspace(36.0, 742.0, 5))
PAPER_N = (36.0, 112.0, 238.0, 364.0, 490.0, 616.0, 742.0)
BOTH_BALLS = tuple(product((0.0, 45.0, 90.0), repeat=2))
RADII_MM = (150.0, 100.0)
POWER = 0.9
MOST_TO_SETTLE = 10
# Slopes one at a time, and their size in prior sd.
SOUGHT = {"C_XXX_1": 1.0, "C_XXX_1, half": 0.5, "C_XYX_1": 1.0, "C_CXY_1": 1.0, "C_CCY_1": 1.0}
NINE: Mapping[str, Mapping[str, Any]] = {
    "forces alone": {},
    "two radii": {"radii_mm": RADII_MM},
    "both balls clocked": {"clockings_deg": BOTH_BALLS},
    "radii and clockings to choose from": {"clockings_deg": BOTH_BALLS, "radii_mm": RADII_MM},
}
WITHIN = {"E_C0YX": (3e-6, 1e-6)}


@cache
def pilot() -> lb.Campaign:
    """The recovered experiment."""
    return lb.read_campaign(DATA / "recovered_experiment")


def paper_levels() -> lb.Plan:
    """The seven levels of the experiment, 112 N included."""
    return lb.Campaign(tuple(lb.CircularTest(force, np.arange(720) / 2.0) for force in PAPER_N))


@cache
def six() -> lb.Design:
    """Six circles for all parameters, beside the paper's, and under other assumptions."""
    return lb.design(LINEAR, pilot(), tests=6, forces_N=FINE_N, against={"the paper's six": pilot()}, robust=True)


@cache
def recommended() -> lb.Design:
    """The same six circles, without what they are compared with."""
    return lb.design(LINEAR, pilot(), tests=6, forces_N=LEVELS_N)


@cache
def nine(choice: str) -> lb.Design:
    """Nine circles for all parameters, with radii or clockings to choose from."""
    return lb.design(LINEAR, pilot(), tests=9, forces_N=FIVE_N, **NINE[choice])


@cache
def deciding(tests: int) -> lb.Design:
    """So many circles for constant or linear."""
    return lb.design(LINEAR, pilot(), tests=tests, criterion="discriminate", forces_N=LEVELS_N)


def decides(tests: int) -> bool:
    """Whether they settle it with the power wanted, whichever is true."""
    found = deciding(tests).discrimination
    return found is not None and min(found.decisive_with, found.decisive_without) >= POWER


def settling() -> lb.Design:
    """The fewest circles that settle constant or linear; more circles decide better."""
    numbers = range(3, MOST_TO_SETTLE + 1)
    place = bisect_left(numbers, True, key=decides)
    if place == len(numbers):
        raise RuntimeError(f"{MOST_TO_SETTLE} circles do not settle constant or linear")
    return deciding(numbers[place])


@cache
def finding(slope: str) -> lb.Design:
    """The fewest circles that find one slope with the power wanted."""
    name = slope.partition(",")[0]
    return lb.design(LINEAR, pilot(), power=POWER, parameters=[name], slope_size=SOUGHT[slope], forces_N=LEVELS_N)


def squareness() -> dict[str, lb.Design]:
    """Squareness: the best six circles by forces alone, the fewest to a target with two radii, and with both balls clocked."""
    coarse, fine = WITHIN["E_C0YX"]
    return {
        "forces alone": lb.design(LINEAR, pilot(), tests=6, criterion="c", parameters=["E_C0YX"], forces_N=FIVE_N),
        "two radii": lb.design(LINEAR, pilot(), targets={"E_C0YX": coarse}, forces_N=FIVE_N, radii_mm=RADII_MM),
        "both balls clocked": lb.design(LINEAR, pilot(), targets={"E_C0YX": fine}, forces_N=FIVE_N, clockings_deg=BOTH_BALLS),
    }


def flat(degree: int) -> lb.Design:
    """D-optimum with flat priors, beside the paper's seven levels."""
    return lb.design(lb.HybridModel.paper(degree), paper_levels(), tests=7, against={"the paper's seven": paper_levels()})
