"""Planning backwards: the fewest tests for a target, or why there is no such number and what would help; and the trade-off."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ldbb_bayes.analysis.forecast import Forecast
from ldbb_bayes.analysis.optimal.criteria import Variance
from ldbb_bayes.analysis.search import Found
from ldbb_bayes.analysis.space import DesignSpace
from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.errors import InputError
from ldbb_bayes.model.wording import joined
from ldbb_bayes.units import display_name, display_unit

__all__ = ["Needed", "trade_off"]

Array = NDArray[Any]
_MOST = 100
_TURNS_DEG = (0.0, 45.0, 90.0)
_SMALLER = 2.0 / 3.0
_DOUBLINGS = 8
_MISSED, _TRUNCATED = 1.1, 8.0
_REWEIGHTED = 3
_POINTS = 8
_LEVELS = 5
_STARTS = 2


class Needed:
    """The fewest tests that reach targets, or a power.

    Parameters
    ----------
    space : DesignSpace
        With criterion "a" in units of the targets, or "discriminate".
    targets : mapping of parameter to sd
    power : float, optional
        Probability of decisive evidence.
    """

    def __init__(self, space: DesignSpace, targets: Mapping[str, float], power: float | None) -> None:
        for name, value in targets.items():
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"target of {name} must be a positive sd, got {value}. Give it in mm, N and rad.")
        if power is not None and not 0.0 < power < 1.0:
            raise InputError(f"power must lie between 0 and 1, got {power}. For example 0.9.")
        self.space, self.targets, self.power = space, targets, power

    def fewest(self) -> tuple[Found, bool, list[str]]:
        """The design of the fewest tests, whether it reaches the goal, and what to say of it.

        Where none does, the best design of as many tests as the pilot has.
        """
        if self.space.augment and self.shortfall(self.space.forecast((), decide=not self.targets)) <= 1.0:
            return self.space.search.of_number(1), True, [f"The tests already run reach {self._goal}: no more are needed."]
        found, met = self._smallest()
        if met:
            number = int(found.counts.sum())
            circles = "1 circle is" if number == 1 else f"{number} circles are"
            return found, True, [f"{circles} the fewest found that reach {self._goal}."]
        return found, False, self._out_of_reach()

    def _smallest(self) -> tuple[Found, bool]:
        """The design of the fewest tests, and whether it reaches the goal; where none does, that of as many as the pilot has."""
        tried: dict[int, tuple[Found, bool]] = {}

        def met(number: int) -> bool:
            if number not in tried:
                tried[number] = self._try(number)
            return tried[number][1]

        low, high = self.space.levels - 1, max(self.space.levels, self._first_possible())
        while self._hopeless or not met(high):
            if self._hopeless or high == _MOST:
                return self.space.search.of_number(max(len(self.space.pilot.tests), self.space.levels)), False
            low, high = high, min(2 * high, _MOST)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if met(middle) else (middle, high)
        return tried[high][0], True

    def shortfall(self, forecast: Forecast) -> float:
        """The largest ratio of expected sd to target, or of the power wanted to that expected."""
        if self.targets:
            return max(forecast.expected[name].sd / value for name, value in self.targets.items())
        return float(self.power or 0.0) / max(self._power(forecast), 1e-12)

    def _power(self, forecast: Forecast) -> float:
        found = forecast.discrimination
        if found is None:
            raise InputError("power must be asked of a model with slopes and proper priors. Use degree 1 and the default preset.")
        return next(iter(found.power.values())) if len(found.power) == 1 else found.decisive_with

    @property
    def _goal(self) -> str:
        if self.power is not None:
            return f"a probability of {self.power:g} of decisive evidence (|ln B| > {self.space.threshold:g})"
        own = self.space.parameters_of_pilot
        units = {p.name: display_unit(p.unit) for p in own}
        return joined(
            [f"u({display_name(name)}) ≤ {value * units[name][0]:.3g} {units[name][1]}" for name, value in self.targets.items()]
        )

    @cached_property
    def _hopeless(self) -> bool:
        """Whether even the best shares of the largest number miss the targets by far; truncation may more than halve an sd."""
        if not self.targets:
            return False
        bounded = any(name in self.space.truncated for name in self.targets)
        return self.space.search.shares(float(_MOST)).value < -(_TRUNCATED if bounded else _MISSED)

    def _first_possible(self) -> int:
        """Where to begin: the smallest number whose best shares reach the targets on average, truncation aside."""
        if not self.targets:
            return 1
        for number in (2**k for k in range(_DOUBLINGS)):
            if number >= _MOST or self.space.search.shares(float(number)).value >= -1.0:
                return min(number, _MOST)
        return _MOST

    def _try(self, number: int) -> tuple[Found, bool]:
        """The best whole tests of a number; targets missed while others are exceeded gain weight."""
        search = self.space.search
        for _ in range(_REWEIGHTED):
            found = search.of_number(number, starts=_STARTS)
            forecast = self.space.forecast(_tests(self.space, found), decide=not self.targets)
            if self.shortfall(forecast) <= 1.0:
                return self._judged(found), True
            criterion = search.objective.cases[0].criterion
            if not isinstance(criterion, Variance) or self.space.search.objective.value(found.counts.astype(float)) < -1.0:
                break
            ratio = np.array([forecast.expected[name].sd / self.targets[name] for name in self.space.chosen])
            search = search.under(Variance(ratio[:, None] * criterion.weight * ratio))
        return self._judged(found), False

    def _judged(self, found: Found) -> Found:
        """With value and efficiency by the criterion that was asked for."""
        objective, optimum = self.space.search.objective, self.space.search.shares(float(found.counts.sum()))
        value = objective.value(found.counts.astype(float))
        return replace(found, value=value, optimum=optimum, efficiency=objective.efficiency(value, optimum.value))

    def _out_of_reach(self) -> list[str]:
        """Why not, and what would do."""
        said = [f"No number of these circles up to {_MOST} reaches {self._goal}."]
        helping = []
        for words, space in _further(self.space).items():
            found, met = Needed(space, self.targets, self.power)._smallest()
            if met:
                helping.append(f"{words} ({found.counts.sum()} circles)")
        if helping:
            said.append(f"What would reach it: {joined(helping, 'or')}. The design shown is the best without.")
        else:
            said.append("Neither clocking the balls, nor a second radius, nor other levels in this range would.")
        return said


def _further(space: DesignSpace) -> dict[str, DesignSpace]:
    """The space enlarged by what force levels cannot do, one thing at a time, at few of its own levels."""
    radius = space.radii_mm[0]
    none = (0.0,)
    turned = {
        "the work ball clocked at 0, 45 and 90°": tuple(product(_TURNS_DEG, none)),
        "the tool ball clocked at 0, 45 and 90°": tuple(product(none, _TURNS_DEG)),
        "both balls clocked at 0, 45 and 90°": tuple(product(_TURNS_DEG, _TURNS_DEG)),
    }
    levels = sorted(space.forces_N)
    few = tuple(dict.fromkeys(levels[round(i)] for i in np.linspace(0, len(levels) - 1, _LEVELS)))
    spaces = {}
    if len(levels) < _LEVELS:
        between = tuple(np.linspace(levels[0], levels[-1], 2 * _LEVELS - 1).tolist())
        spaces["force levels in between"] = replace(space, forces_N=between)
    for words, own in turned.items():
        if not set(own) <= set(space.clockings_deg):
            spaces[words] = replace(space, clockings_deg=(*space.clockings_deg, *own), forces_N=few)
    if len(space.radii_mm) == 1:
        second = round(_SMALLER * radius)
        spaces[f"a second radius of {second} mm"] = replace(space, radii_mm=(radius, second), forces_N=few)
    return spaces


def trade_off(space: DesignSpace, tests: int, equal_steps: Callable[[int], tuple[CircularTest, ...]]) -> pd.DataFrame:
    """Number of tests against efficiency and expected sd, up to twice the number of a design.

    Returns
    -------
    DataFrame
        tests, cost, efficiency, efficiency_equal_steps, and sd of every parameter; inside units.
    """
    around = np.rint(np.geomspace(max(2, tests // 2), max(2 * tests, 4), _POINTS)).astype(int)
    rows = []
    for number in np.union1d(around, [tests]).tolist():
        try:
            found = space.search.of_number(number, starts=_STARTS)
        except InputError:
            continue
        own = _tests(space, found)
        expected = space.forecast(own, decide=False).expected
        rows.append(
            {
                "tests": number,
                "cost": space.costs.of(own),
                "efficiency": min(found.efficiency, 1.0),
                "efficiency_equal_steps": space.efficiency(equal_steps(number)),
                **{f"sd_{name}": entry.sd for name, entry in expected.items()},
            }
        )
    return pd.DataFrame(rows)


def _tests(space: DesignSpace, found: Found) -> tuple[CircularTest, ...]:
    return tuple(test for test, count in zip(space.tests, found.counts, strict=True) for _ in range(count))
