"""Every design the study speaks of."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Mapping
from functools import cache
from itertools import product
from typing import Any, Literal

import numpy as np
from study import DATA

import ldbb_bayes as lb

Edition = Literal["first", "third"]
EDITIONS: dict[Edition, lb.HybridModel] = {
    "first": lb.HybridModel.first(degree=1),
    "third": lb.HybridModel.default(degree=1),
}
LINEAR = EDITIONS["first"]
LEVELS_N = tuple(np.linspace(36.0, 742.0, 15))
FINE_N = tuple(np.linspace(36.0, 742.0, 101))
FIVE_N = tuple(np.linspace(36.0, 742.0, 5))
PAPER_N = (36.0, 112.0, 238.0, 364.0, 490.0, 616.0, 742.0)
BOTH_BALLS = tuple(product((0.0, 45.0, 90.0), repeat=2))
RADII_MM = (150.0, 100.0)
POWER = 0.9
MOST_TO_SETTLE = 10
MOST_TO_FIND = 40
# Slopes one at a time, and their size in prior sd.
SOUGHT = {"C_XXX_1": 1.0, "C_XXX_1, half": 0.5, "C_XYX_1": 1.0, "C_CXY_1": 1.0, "C_CCY_1": 1.0}
NINE: Mapping[str, Mapping[str, Any]] = {
    "forces alone": {},
    "two radii": {"radii_mm": RADII_MM},
    "both balls clocked": {"clockings_deg": BOTH_BALLS},
    "radii and clockings to choose from": {"clockings_deg": BOTH_BALLS, "radii_mm": RADII_MM},
}
# Targets of the squareness [rad].
WITHIN = {"E_C0YX": (3e-6, 1e-6)}
# Of the third edition too: what it lets the direction of travel change is seen in both alone.
BOTH_WAYS = "both balls clocked, both directions"
THIRD_NINE = {choice: NINE[choice] for choice in ("forces alone", "two radii")}
THIRD_NINE |= {
    "both balls clocked": NINE["both balls clocked"],
    BOTH_WAYS: {**NINE["both balls clocked"], "directions": ("CW", "CCW")},
}


@cache
def pilot() -> lb.Campaign:
    """The recovered experiment."""
    return lb.read_campaign(DATA / "recovered_experiment")


def paper_levels() -> lb.Plan:
    """The seven levels of the experiment, 112 N included."""
    return lb.Campaign(tuple(lb.CircularTest(force, np.arange(720) / 2.0) for force in PAPER_N))


@cache
def six(edition: Edition = "first") -> lb.analysis.Design:
    """Six circles for all parameters, beside the paper's."""
    return lb.design(
        EDITIONS[edition], pilot(), tests=6, forces_N=FINE_N, against={"the paper's six": pilot()}
    )


@cache
def recommended() -> lb.analysis.Design:
    """The same six circles, without what they are compared with."""
    return lb.design(LINEAR, pilot(), tests=6, forces_N=LEVELS_N)


@cache
def nine(choice: str, edition: Edition = "first") -> lb.analysis.Design:
    """Nine circles for all parameters, with radii or clockings to choose from."""
    choices = NINE if edition == "first" else THIRD_NINE
    return lb.design(EDITIONS[edition], pilot(), tests=9, forces_N=FIVE_N, **choices[choice])


@cache
def deciding(tests: int, edition: Edition = "first") -> lb.analysis.Design:
    """So many circles for constant or linear."""
    return lb.design(
        EDITIONS[edition], pilot(), tests=tests, criterion="discriminate", forces_N=LEVELS_N
    )


def fewest(
    design_of: Callable[[int], lb.analysis.Design],
    is_enough: Callable[[lb.analysis.Design], bool],
    largest: int,
) -> lb.analysis.Design:
    """The design of the fewest circles that are enough; more circles are better."""

    def is_enough_circles(number: int) -> bool:
        return is_enough(design_of(number))

    numbers = range(2, largest + 1)
    place = bisect_left(numbers, True, key=is_enough_circles)
    if place == len(numbers):
        raise RuntimeError(f"{largest} circles are not enough")
    return design_of(numbers[place])


def settling() -> lb.analysis.Design:
    """The fewest circles that settle constant or linear with the power wanted, whichever is
    true."""

    def settles(design: lb.analysis.Design) -> bool:
        chances = design.discrimination
        return chances is not None and min(chances.decisive_with, chances.decisive_without) >= POWER

    return fewest(deciding, settles, MOST_TO_SETTLE)


@cache
def finding(slope: str) -> lb.analysis.Design:
    """The fewest circles that find one slope with the power wanted."""
    name = slope.partition(",")[0]
    options = {
        "criterion": "discriminate",
        "parameters": [name],
        "slope_size": SOUGHT[slope],
        "forces_N": LEVELS_N,
    }

    @cache
    def design_of(tests: int) -> lb.analysis.Design:
        return lb.design(LINEAR, pilot(), tests=tests, **options)

    def finds(design: lb.analysis.Design) -> bool:
        chances = design.discrimination
        return chances is not None and chances.power[name] >= POWER

    return fewest(design_of, finds, MOST_TO_FIND)


def squareness(edition: Edition = "first") -> dict[str, lb.analysis.Design]:
    """Squareness: the best six circles by forces alone, the fewest to a target with two radii, and
    with both balls clocked; where no number reaches the target, six as well."""
    coarse, fine = WITHIN["E_C0YX"]

    def six_or_fewest(sd: float, **choice: Any) -> lb.analysis.Design:
        @cache
        def design_of(tests: int) -> lb.analysis.Design:
            return lb.design(
                EDITIONS[edition],
                pilot(),
                tests=tests,
                criterion="c",
                parameters=["E_C0YX"],
                forces_N=FIVE_N,
                **choice,
            )

        def reaches_target(design: lb.analysis.Design) -> bool:
            return design.expected["E_C0YX"].sd <= sd

        if design_of(6).expected["E_C0YX"].floor_sd > sd:
            return design_of(6)
        return fewest(design_of, reaches_target, MOST_TO_FIND)

    by_choice = {
        "forces alone": six_or_fewest(coarse),
        "two radii": six_or_fewest(coarse, radii_mm=RADII_MM),
        "both balls clocked": six_or_fewest(fine, clockings_deg=BOTH_BALLS),
    }
    if edition == "third":
        by_choice[BOTH_WAYS] = six_or_fewest(fine, **THIRD_NINE[BOTH_WAYS])
    return by_choice


def flat(degree: int) -> lb.analysis.Design:
    """D-optimum with flat priors, beside the paper's seven levels."""
    return lb.design(
        lb.HybridModel.paper(degree),
        paper_levels(),
        tests=7,
        against={"the paper's seven": paper_levels()},
    )
