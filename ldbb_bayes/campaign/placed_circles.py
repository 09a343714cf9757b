"""Circles of a campaign: where they are, how large, and in which direction they are run."""

from __future__ import annotations

from typing import NamedTuple

from ldbb_bayes.campaign.campaign import Campaign, Direction

__all__ = ["PlacedCircle", "placed_circles", "radii_mm_of"]


class PlacedCircle(NamedTuple):
    """Plane, radius, centre and direction of travel of a circle."""

    plane: str  #: plane of the circle, such as XY
    radius_mm: float  #: nominal radius of the circle [mm]
    centre_mm: tuple[float, ...]  #: position of the circle's centre on X, Y and Z [mm]
    direction: Direction | None  #: direction of travel; None if the campaign does not state it


def placed_circles(campaign: Campaign) -> frozenset[PlacedCircle]:
    """Return the different circles of a campaign, whatever their forces.

    Effects of the machine that depend on the place of a circle are the same in two campaigns only
    if both have the same circles.

    Parameters
    ----------
    campaign : campaign or plan. Circles that are only foreseen do not count.
    """
    circles = set()
    for test in campaign.tests:
        circle = test.circle
        centre_mm = tuple(float(value) for value in circle.centre_mm)
        circles.add(PlacedCircle(circle.plane, float(circle.radius_mm), centre_mm, test.direction))
    return frozenset(circles)


def radii_mm_of(campaign: Campaign) -> list[float]:
    """Return the different nominal radii of a campaign's circles [mm], in ascending order."""
    return sorted({test.circle.radius_mm for test in campaign.tests})
