"""Campaigns as people run them today: equal force steps, both directions, balls as they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ldbb_bayes.campaign.campaign import CircularTest, Direction

__all__ = ["equal_steps_both_ways", "published_forces"]

# Forces of the seven circles of the published experiment [N] (paper, Table 4).
_PUBLISHED_FORCES_N = (36.0, 112.0, 238.0, 364.0, 490.0, 616.0, 742.0)
_BOTH: tuple[Direction, Direction] = ("CW", "CCW")


def equal_steps_both_ways(
    template: CircularTest, lowest_N: float, highest_N: float, number: int
) -> tuple[CircularTest, ...]:
    """Return circles in equal steps of force, alternately in either direction of travel.

    ``template`` is a test of the machine; the balls are not turned.
    """
    forces = np.linspace(lowest_N, highest_N, number)
    return _circles(template, [float(force) for force in forces])


def published_forces(
    template: CircularTest, lowest_N: float, highest_N: float
) -> tuple[CircularTest, ...]:
    """Return circles at the forces of the published experiment, alternately in either direction.

    Where a machine is tested from another lowest to another highest force, they are in proportion.
    """
    published = np.array(_PUBLISHED_FORCES_N)
    shares = (published - published[0]) / (published[-1] - published[0])
    forces = lowest_N + shares * (highest_N - lowest_N)
    return _circles(template, [float(round(force, 9)) for force in forces])


def _circles(template: CircularTest, forces_N: Sequence[float]) -> tuple[CircularTest, ...]:
    """Return one circle at every force, alternately clockwise and counterclockwise."""
    circles = []
    for k, force_N in enumerate(forces_N):
        circles.append(
            replace(
                template,
                force_N=force_N,
                direction=_BOTH[k % 2],
                work_ball_deg=0.0,
                tool_ball_deg=0.0,
            )
        )
    return tuple(circles)
