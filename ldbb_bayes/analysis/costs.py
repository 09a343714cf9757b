"""What a set of tests costs, and the order in which to run it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, permutations
from typing import Any

import numpy as np

from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.errors import InputError

__all__ = ["Costs", "running_order"]

_ALL_ORDERS = 5
_DRAWN = 50


@dataclass(frozen=True)
class Costs:
    """Costs in one unit, for example minutes.

    Parameters
    ----------
    circle : float
        Of each circle.
    work_ball : float
        Of each change of the work ball's clocking: a set-up anew.
    tool_ball : float
        Of each change of the tool ball's clocking, which the spindle turns.
    """

    circle: float = 1.0
    work_ball: float = 0.0
    tool_ball: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value >= 0.0) or (name == "circle" and value == 0.0):
                raise InputError(f"cost of {name} must be a number ≥ 0, that of a circle > 0, got {value}. Correct it.")

    def of(self, tests: Sequence[CircularTest]) -> float:
        """Cost of tests run in blocks of one work-ball clocking, each in blocks of one tool-ball clocking."""
        return self.circle * len(tests) + self.setups({(test.work_ball_deg, test.tool_ball_deg) for test in tests})

    def setups(self, clockings_deg: Collection[tuple[float, float]]) -> float:
        """Cost of changing over between clockings (work ball, tool ball), in the order that changes the tool ball least."""
        works = len({work for work, _ in clockings_deg})
        return self.work_ball * max(works - 1, 0) + self.tool_ball * _tool_changes(_best_sequence(clockings_deg))


def _best_sequence(clockings_deg: Collection[tuple[float, float]]) -> list[tuple[float, float]]:
    """Clockings in blocks of the work ball, with few changes of the tool ball."""
    works = sorted({work for work, _ in clockings_deg})
    orders = permutations(works) if len(works) <= _ALL_ORDERS else [tuple(works)]
    return min((_sequence(clockings_deg, order) for order in orders), key=_tool_changes)


def _sequence(clockings_deg: Collection[tuple[float, float]], works: Sequence[float]) -> list[tuple[float, float]]:
    """Blocks in this order: each begins with the tool-ball clocking in place and ends with one that the next block needs."""
    tools = {work: sorted({tool for own, tool in clockings_deg if own == work}) for work in works}
    found: list[tuple[float, float]] = []
    for i, work in enumerate(works):
        left = list(tools[work])
        first = found[-1][1] if found and found[-1][1] in left else None
        following = tools[works[i + 1]] if i + 1 < len(works) else []
        last = next((tool for tool in left if tool in following and tool != first), None) if len(left) > 1 else None
        middle = [tool for tool in left if tool not in (first, last)]
        ordered = [*([] if first is None else [first]), *middle, *([] if last is None else [last])]
        found += [(work, tool) for tool in ordered]
    return found


def _tool_changes(sequence: Sequence[tuple[float, float]]) -> int:
    return sum(one[1] != other[1] for one, other in pairwise(sequence))


def running_order(tests: Sequence[CircularTest], rng: np.random.Generator) -> tuple[CircularTest, ...]:
    """Blocks of one set-up and radius, in them of one work-ball clocking, in them of one tool-ball clocking, forces and
    directions of travel at random: so that drift is not force.

    The clockings' order is drawn among those that change the tool ball least.
    """
    ordered: list[CircularTest] = []
    for setup in _shuffled({test.setup or 1 for test in tests}, rng):
        mounted = [test for test in tests if (test.setup or 1) == setup]
        for place in _shuffled({_mounting(test) for test in mounted}, rng):
            ordered += _order_of_block([test for test in mounted if _mounting(test) == place], rng)
    return tuple(replace(test, name="") for test in ordered)


def _mounting(test: CircularTest) -> tuple[Any, ...]:
    """What cannot be changed without touching the bar or its mounts."""
    return (str(test.plane), float(test.radius_mm or 0.0), test.circle.centre_mm)


def _shuffled(places: Collection[Any], rng: np.random.Generator) -> list[Any]:
    ordered = sorted(places)
    return [ordered[i] for i in rng.permutation(len(ordered))] if len(ordered) > 1 else ordered


def _order_of_block(tests: Sequence[CircularTest], rng: np.random.Generator) -> list[CircularTest]:
    clockings = {(test.work_ball_deg, test.tool_ball_deg) for test in tests}
    best = _best_sequence(clockings)
    works = sorted({work for work, _ in clockings})
    drawn = (_sequence(clockings, rng.permutation(works).tolist()) for _ in range(_DRAWN))
    sequence = next((own for own in drawn if _tool_changes(own) <= _tool_changes(best)), best)
    ordered: list[CircularTest] = []
    for clocking in sequence:
        block = [test for test in tests if (test.work_ball_deg, test.tool_ball_deg) == clocking]
        ordered += [block[i] for i in rng.permutation(len(block))]
    return ordered
