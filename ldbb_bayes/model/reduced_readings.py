"""Reduced readings of a campaign or plan, computed once."""

from __future__ import annotations

from weakref import WeakKeyDictionary

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.model.reduction import Reduced, reduce_readings

__all__ = ["reduced_readings"]

# Cache of the reduced readings of every campaign (at most 25 numbers for each test). It saves time
# because a comparison applies hundreds of models to the same reduced readings.
_REDUCED_READINGS: WeakKeyDictionary[Campaign, tuple[Reduced, ...]] = WeakKeyDictionary()


def reduced_readings(campaign: Campaign) -> tuple[Reduced, ...]:
    """Return the readings of every test, reduced to at most 25 numbers.

    The reduced readings of every campaign are kept in a cache.
    """
    if campaign not in _REDUCED_READINGS:
        reduce = _reduce_plan if campaign.is_plan else _reduce_campaign
        _REDUCED_READINGS[campaign] = reduce(campaign)
    return _REDUCED_READINGS[campaign]


def _reduce_campaign(campaign: Campaign) -> tuple[Reduced, ...]:
    """Return the readings of every test of a campaign, reduced to at most 25 numbers."""
    return tuple(reduce_readings(test.angles_rad(), test.readings_mm()) for test in campaign.tests)


def _reduce_plan(campaign: Campaign) -> tuple[Reduced, ...]:
    """Return a `Reduced` object without readings for every test of the plan ``campaign``.

    The object describes how readings at the test's angles are reduced to at most 25 numbers. Tests
    with equal angles share one `Reduced` object.
    """
    reduced_by_angles: dict[bytes, Reduced] = {}
    for test in campaign.tests:
        angles = test.angle_deg.tobytes()
        if angles not in reduced_by_angles:
            reduced_by_angles[angles] = reduce_readings(test.angles_rad(), None)
    return tuple(reduced_by_angles[test.angle_deg.tobytes()] for test in campaign.tests)
