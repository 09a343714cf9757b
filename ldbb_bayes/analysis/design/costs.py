"""Costs of a campaign: machine time, and certificates of the instrument.

Machine time is the sum of the times for all circles, all set-ups and all turns of the balls.
Circles with the same plane, radius and stated set-up are run in one set-up. In a set-up, each
clocking (pair of angles of the balls) after the first requires one turn of the balls. The price of
a campaign is the price of its machine time plus the prices of its certificates.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ldbb_bayes.campaign.campaign import CircularTest
from ldbb_bayes.errors import require
from ldbb_bayes.results import Result

__all__ = ["Costs", "Effort", "effort_of", "minutes_of", "price_of"]

_MINUTES_PER_HOUR = 60.0
# Pairs of ball angles [°] that agree to this number of decimals are treated as one clocking.
_CLOCKING_DIGITS = 6


@dataclass(frozen=True)
class Costs(Result):
    """Times needed for circles, set-ups and turns of the balls, and the price of machine time.

    Examples
    --------
    >>> from ldbb_bayes.analysis.design import Costs, minutes_of
    >>> costs = Costs(minutes_per_circle=4.0)
    >>> minutes_of(costs, campaign.plan().tests)  # six circles in one set-up
    39.0
    """

    minutes_per_circle: float = 3.0  #: minutes for one circle, including the time to set the force
    #: minutes for every set-up; circles that differ in plane, radius or stated set-up need separate
    #: set-ups
    minutes_per_setup: float = 15.0
    minutes_per_clocking: float = 5.0  #: minutes for every turn of the balls within a set-up
    #: price of an hour of machine time, in the same unit of money as the prices of certificates
    price_per_hour: float = 60.0
    #: longest machine time that a campaign may take [h]; None if there is no limit
    hours: float | None = None

    def __post_init__(self) -> None:
        """Raise an `InputError` if a time or price is negative, or zero where it must not be."""
        for name in (
            "minutes_per_circle",
            "minutes_per_setup",
            "minutes_per_clocking",
            "price_per_hour",
        ):
            value = getattr(self, name)
            require(
                np.isfinite(value) and value >= 0.0,
                f"{name} must be a number of at least 0, got {value}. Correct it.",
            )
        require(
            self.minutes_per_circle > 0.0,
            "minutes_per_circle must be above 0, got 0. Circles for nothing have no cheapest"
            " number.",
        )
        require(
            self.price_per_hour > 0.0,
            "price_per_hour must be above 0, got 0. Leave it out to compare machine times.",
        )
        require(
            self.hours is None or (np.isfinite(self.hours) and self.hours > 0.0),
            f"hours must be above 0, got {self.hours}. Leave it out for no limit.",
        )

    def fits(self, minutes: float) -> bool:
        """Return whether a campaign takes no more machine time [min] than ``hours`` allows."""
        return self.hours is None or minutes <= _MINUTES_PER_HOUR * self.hours


class Effort(NamedTuple):
    """What has to be done to run the tests of a campaign."""

    circles: int  #: number of circles of a campaign
    setups: int  #: number of set-ups of a campaign
    turns: int  #: number of turns of the balls in a campaign, both balls at once


def effort_of(tests: Iterable[CircularTest]) -> Effort:
    """Return the numbers of circles, set-ups and turns of the balls that ``tests`` need.

    The numbers do not depend on the order of the tests.
    """
    clockings_by_setup: dict[tuple[str, float, int], set[tuple[float, float]]] = {}
    circles = 0
    for test in tests:
        circles += 1
        setup = (str(test.plane), float(test.radius_mm or 0.0), test.setup or 1)
        clocking = (
            round(test.work_ball_deg % 360.0, _CLOCKING_DIGITS),
            round(test.tool_ball_deg % 360.0, _CLOCKING_DIGITS),
        )
        clockings_by_setup.setdefault(setup, set()).add(clocking)
    setups = len(clockings_by_setup)
    turns = sum(len(clockings) for clockings in clockings_by_setup.values()) - setups
    return Effort(circles, setups, turns)


def minutes_of(costs: Costs, tests: Iterable[CircularTest]) -> float:
    """Return the machine time of ``tests`` [min], computed from the times in ``costs``.

    The machine time does not depend on the order of the tests.
    """
    effort = effort_of(tests)
    return (
        costs.minutes_per_circle * effort.circles
        + costs.minutes_per_setup * effort.setups
        + costs.minutes_per_clocking * effort.turns
    )


def price_of(costs: Costs, minutes: float, certificates: float = 0.0) -> float:
    """Return the price of ``minutes`` of machine time plus the price of the certificates.

    ``costs`` states the price of an hour, and ``certificates`` is the price of the certificates.
    """
    return costs.price_per_hour * minutes / _MINUTES_PER_HOUR + certificates
