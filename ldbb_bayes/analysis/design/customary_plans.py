"""Campaigns as they are usually run: in equal steps of force, or as in the published experiment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ldbb_bayes.campaign.campaign import CircularTest, Direction

__all__ = ["equal_steps", "published_forces"]

# Forces of the seven circles of the published experiment [N] (Table 4 of the article on which the
# model is based).
_PUBLISHED_FORCES_N = (36.0, 112.0, 238.0, 364.0, 490.0, 616.0, 742.0)


def equal_steps(
    template: CircularTest,
    ways: Sequence[Direction | None],
    lowest_N: float,
    highest_N: float,
    number: int,
) -> tuple[CircularTest, ...]:
    """Return circles in equal steps of force, with alternating directions of travel.

    ``lowest_N`` and ``highest_N`` are the first and the last force [N], and ``number`` is the
    number of circles. ``ways`` are the directions of travel; None means that the direction is not
    stated. All other settings are those of ``template``, a test of the machine, but the balls are
    not turned.
    """
    forces = np.linspace(lowest_N, highest_N, number)
    return _circles(template, ways, [float(force) for force in forces])


def published_forces(
    template: CircularTest,
    ways: Sequence[Direction | None],
    lowest_N: float,
    highest_N: float,
) -> tuple[CircularTest, ...]:
    """Return circles at the published forces, with alternating directions of travel.

    The forces of the published experiment are scaled linearly to the range from ``lowest_N`` to
    ``highest_N`` [N]. ``ways`` are the directions of travel; None means that the direction is not
    stated. All other settings are those of ``template``, a test of the machine, but the balls are
    not turned.
    """
    published = np.array(_PUBLISHED_FORCES_N)
    shares = (published - published[0]) / (published[-1] - published[0])
    forces = lowest_N + shares * (highest_N - lowest_N)
    return _circles(template, ways, [float(round(force, 9)) for force in forces])


def _circles(
    template: CircularTest, ways: Sequence[Direction | None], forces_N: Sequence[float]
) -> tuple[CircularTest, ...]:
    """Return one circle at every force, with alternating directions of travel.

    ``ways`` are the directions of travel. The balls are not turned in their sockets. All other
    settings are those of ``template``, a test of the machine.
    """
    circles = []
    for k, force_N in enumerate(forces_N):
        circles.append(
            replace(
                template,
                force_N=force_N,
                direction=ways[k % len(ways)],
                work_ball_deg=0.0,
                tool_ball_deg=0.0,
            )
        )
    return tuple(circles)
