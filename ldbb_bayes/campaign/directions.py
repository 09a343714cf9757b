"""Check that either all tests in a plane state their direction of travel, or no test does."""

from __future__ import annotations

from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.errors import InputError

__all__ = ["planes_run_both_ways"]


def planes_run_both_ways(campaign: Campaign) -> tuple[str, ...]:
    """Return the planes in which circles are run, or are planned, in both directions of travel.

    Raise an `InputError` if a test in such a plane states no direction, or if in any other plane
    some tests state a direction and some do not.
    """
    both = []
    for plane in dict.fromkeys(str(test.plane) for test in campaign.scope):
        directions = {test.direction for test in campaign.scope if test.plane == plane}
        if {"CW", "CCW"} <= directions:
            _check_directions_stated(campaign, plane, "run, or are to run, both ways")
            both.append(plane)
        elif any(test.direction for test in campaign.tests if test.plane == plane):
            _check_directions_stated(campaign, plane, "state theirs in other tests")
    return tuple(both)


def _check_directions_stated(campaign: Campaign, plane: str, reason: str) -> None:
    """Raise an `InputError` if a test of ``campaign`` in a plane states no direction of travel.

    ``plane`` is the name of the plane. The error message states why a direction is needed, in a
    clause that begins with "as circles of plane" and the name of the plane. ``reason`` is the end
    of this clause, such as "run, or are to run, both ways".
    """
    undirected: list[CircularTest] = [
        test for test in campaign.tests if test.plane == plane and test.direction is None
    ]
    if undirected:
        raise InputError(
            f"{undirected[0].label} must state its direction, CW or CCW, as circles of plane"
            f" {plane} {reason}, got none. Give direction in every test of"
            f" {campaign.name!r}."
        )
