"""Random order in which to run tests, so that a drift is not mistaken for an effect of force."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ldbb_bayes.campaign.campaign import CircularTest
from ldbb_bayes.campaign.circular_test import setup_number

__all__ = ["running_order"]

# An order of tests is not used if the absolute correlation between the forces of the tests and
# their positions exceeds this number.
_MOST_SORTED = 0.5
# Largest number of random orders that are drawn.
_MOST_ORDERS = 24


def running_order(
    tests: Sequence[CircularTest], rng: np.random.Generator
) -> tuple[CircularTest, ...]:
    """Return ``tests`` in a random order that is not sorted by force.

    Random orders are drawn until the correlation between force and position is between −0.5 and
    0.5, but at most 24. If none of them is suitable, the one with the smallest correlation is
    returned; `_random_order` describes how an order is drawn.
    """
    best = _random_order(tests, rng)
    for _ in range(_MOST_ORDERS - 1):
        if _correlation_with_order(best) <= _MOST_SORTED:
            break
        other = _random_order(tests, rng)
        if _correlation_with_order(other) < _correlation_with_order(best):
            best = other
    return best


def _correlation_with_order(tests: Sequence[CircularTest]) -> float:
    """Return the absolute correlation between the forces of tests and their positions, 0 to 1.

    It is 0 if all forces are equal, or if there is only one test.
    """
    forces_N = np.array([float(test.force_N or 0.0) for test in tests])
    from_mean_N = forces_N - forces_N.mean()
    positions = np.arange(len(tests)) - 0.5 * (len(tests) - 1)
    size = float(np.linalg.norm(from_mean_N) * np.linalg.norm(positions))
    if size == 0.0:
        return 0.0
    return abs(float(from_mean_N @ positions)) / size


def _random_order(
    tests: Sequence[CircularTest], rng: np.random.Generator
) -> tuple[CircularTest, ...]:
    """Return ``tests`` in a random order in which balls and radius are changed rarely.

    Tests are grouped by set-up, within a set-up by plane and radius, and within these groups by the
    angle of the work ball. At each of these three levels, the groups are in random order. Within a
    group with the same angle of the work ball, the tests are sorted by the angle of the tool ball:
    in ascending order in the first group, in descending order in the second, and so on alternately.
    Tests with the same angles of both balls are in random order.
    """
    ordered: list[CircularTest] = []
    for setup_block in _random_blocks(tests, setup_number, rng):
        for circle_block in _random_blocks(setup_block, _plane_and_radius, rng):
            for k, work_ball_block in enumerate(_random_blocks(circle_block, _work_ball_deg, rng)):
                angles = sorted({test.tool_ball_deg for test in work_ball_block})
                if k % 2:
                    angles.reverse()
                for tool_ball_deg in angles:
                    block = [t for t in work_ball_block if t.tool_ball_deg == tool_ball_deg]
                    ordered += [block[i] for i in rng.permutation(len(block))]
    return tuple(replace(test, name="") for test in ordered)


def _random_blocks(
    tests: Sequence[CircularTest], key: Callable[[CircularTest], Any], rng: np.random.Generator
) -> list[list[CircularTest]]:
    """Return the tests in groups with a common property; the order of the groups is random.

    ``key`` is a function that returns the property of a test, for example its set-up.
    """
    blocks: dict[Any, list[CircularTest]] = {}
    for test in tests:
        blocks.setdefault(key(test), []).append(test)
    keys = sorted(blocks)
    return [blocks[keys[i]] for i in rng.permutation(len(keys))]


def _plane_and_radius(test: CircularTest) -> tuple[str, float]:
    """Return the plane of the test's circle, and its radius [mm]."""
    return str(test.plane), float(test.radius_mm or 0.0)


def _work_ball_deg(test: CircularTest) -> float:
    """Return the angle by which the work ball is turned in its socket [°]."""
    return test.work_ball_deg
