"""Planes in which circles run in both directions of travel, clockwise and counterclockwise."""

from __future__ import annotations

from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.errors import InputError

__all__ = ["planes_run_both_ways", "runs_both_ways"]


def planes_run_both_ways(campaign: Campaign) -> tuple[str, ...]:
    """Return the planes in which circles are run, or are planned, in both directions of travel.

    Raise an `InputError` if a test in such a plane has no direction. Also raise it if, in any other
    plane, only some of the tests have a direction.
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


def runs_both_ways(campaign: Campaign, plane: str) -> bool:
    """Return whether both clockwise and counterclockwise tests were run in a plane."""
    return {"CW", "CCW"} <= {test.direction for test in campaign.tests if test.plane == plane}


def _check_directions_stated(campaign: Campaign, plane: str, reason: str) -> None:
    """Raise an `InputError` if a test of ``campaign`` in ``plane`` has no direction of travel.

    In the error message, ``reason`` completes the clause "as circles of plane XY ...". A reason is,
    for example, "run, or are to run, both ways".
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
