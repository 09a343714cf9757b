"""Phrase that says of which circle the quantities of a plane are stated."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ldbb_bayes.campaign.campaign import Campaign
    from ldbb_bayes.machine.chain import Circle
    from ldbb_bayes.report.translation import Words

__all__ = ["circle_phrase", "tests_of_stated_circle"]


def _circles_of_plane(campaign: Campaign, plane: str) -> dict[str, Circle]:
    """Return the circle of each test in a plane; the keys are the names of the tests."""
    return {str(test.name): test.circle for test in campaign.tests if test.plane == plane}


def tests_of_stated_circle(campaign: Campaign, plane: str) -> list[str]:
    """Return the names of the tests of the circle whose quantities are stated in a plane.

    This is the first circle in ``plane``.
    """
    circles = _circles_of_plane(campaign, plane)
    stated = next(iter(circles.values()))
    return [name for name, circle in circles.items() if circle == stated]


def circle_phrase(campaign: Campaign, plane: str, words: Words) -> str:
    """Return a phrase that says of which circle the quantities of a plane are.

    Circular deviations, and stiffnesses by direction, are those of the first circle in ``plane``.
    The phrase, in the language of ``words``, begins with a comma. It is empty if all tests in the
    plane have the same circle.
    """
    circles = list(_circles_of_plane(campaign, plane).values())
    first = circles[0]
    if all(circle == first for circle in circles):
        return ""
    radius = words.number(f"{first.radius_mm:g}")
    if all(circle.centre_mm == first.centre_mm for circle in circles):
        return words("quantities.circle", radius=radius)
    centre = ", ".join(f"{coordinate_mm:g}" for coordinate_mm in first.centre_mm)
    return words(
        "quantities.circle_about",
        radius=radius,
        centre=words.number(centre.replace("-", "−")),
    )
