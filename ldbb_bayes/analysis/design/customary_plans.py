"""Campaigns as they are usually run: in equal steps of force, or as in the published experiment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ldbb_bayes.campaign.campaign import CircularTest

__all__ = ["equal_steps", "published_forces"]

# Forces of the seven circles of the published experiment [N] (Table 4 of the article on which the
# model is based).
_PUBLISHED_FORCES_N = (36.0, 112.0, 238.0, 364.0, 490.0, 616.0, 742.0)
# Smallest number of circles that a plane has in a campaign in equal steps of several planes. From
# one circle, nobody could see how a compliance changes with force.
_FEWEST_CIRCLES = 2


def equal_steps(
    templates: Sequence[CircularTest], lowest_N: float, highest_N: float, number: int
) -> tuple[CircularTest, ...]:
    """Return circles in equal steps of force in every plane, with alternating directions of travel.

    The circles are shared equally over the planes; the first planes have one more where the number
    cannot be divided. If there are several planes, each has at least two circles.

    Parameters
    ----------
    templates : a test of the machine for every plane and direction of travel. The force is that of
        the step, and the balls are not turned; all other settings are copied.
    lowest_N, highest_N : first and last force in every plane [N].
    number : number of circles in all planes together.
    """
    planes = _by_plane(templates)
    circles: list[CircularTest] = []
    for k, in_plane in enumerate(planes):
        share = len(range(k, number, len(planes)))
        if len(planes) > 1:
            share = max(share, _FEWEST_CIRCLES)
        forces = np.linspace(lowest_N, highest_N, share)
        circles += _circles(in_plane, [float(force) for force in forces])
    return tuple(circles)


def published_forces(
    templates: Sequence[CircularTest], lowest_N: float, highest_N: float
) -> tuple[CircularTest, ...]:
    """Return circles at the published forces in every plane, with alternating directions of travel.

    The forces of the published experiment are scaled linearly to the range from ``lowest_N`` to
    ``highest_N`` [N]. ``templates`` is a test of the machine for every plane and direction, as for
    `equal_steps`.
    """
    published = np.array(_PUBLISHED_FORCES_N)
    shares = (published - published[0]) / (published[-1] - published[0])
    forces = lowest_N + shares * (highest_N - lowest_N)
    forces_N = [float(round(force, 9)) for force in forces]
    circles: list[CircularTest] = []
    for in_plane in _by_plane(templates):
        circles += _circles(in_plane, forces_N)
    return tuple(circles)


def _by_plane(templates: Sequence[CircularTest]) -> list[list[CircularTest]]:
    """Return the tests of each plane as a list, in the order in which the planes are listed."""
    planes: dict[str | None, list[CircularTest]] = {}
    for template in templates:
        planes.setdefault(template.plane, []).append(template)
    return list(planes.values())


def _circles(templates: Sequence[CircularTest], forces_N: Sequence[float]) -> list[CircularTest]:
    """Return one circle of a plane at every force, with alternating directions of travel.

    ``templates`` is a test in the plane for every direction. The balls are not turned in their
    sockets. All other settings are those of the templates.
    """
    circles = []
    for k, force_N in enumerate(forces_N):
        template = templates[k % len(templates)]
        circles.append(replace(template, force_N=force_N, work_ball_deg=0.0, tool_ball_deg=0.0))
    return circles
