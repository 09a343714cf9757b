"""Times and temperatures of tests, relative to the mean of a campaign.

Drift with time and drift with temperature are modelled as proportional to these differences.
"""

from __future__ import annotations

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.run_times import SECONDS_PER_TEST
from ldbb_bayes.results import Array

__all__ = ["relative_temperatures_K", "relative_times_h"]

_SECONDS_PER_HOUR = 3600.0
# If the times of all tests differ from their mean by less than this number of hours, all tests are
# treated as if they were run at the same time.
_SAME_TIME_H = 1e-9


def relative_times_h(campaign: Campaign, pilot: Campaign | None) -> Array:
    """Return the time of every test minus the mean time of the campaign [h], shape (tests,).

    If times are given for all tests, these times are used. Otherwise the tests are assumed to have
    been run in the order in which they are listed, one every six minutes; if the user has declared
    that the order was random, all values are NaN instead. All values are also NaN if all tests have
    the same time.

    A plan may have a ``pilot``, the campaign from which it was designed. There are then three
    cases:

    - All tests of the pilot have times. The mean of these times is subtracted from the times of the
      plan.
    - Times are missing in the pilot, but not in the plan. The mean time of the plan is subtracted.
    - Times are missing in both. If the first tests of the plan have the same names as the tests of
      the pilot, these tests are assumed to have been run in the order of the pilot, one every six
      minutes. Otherwise all tests have the time 0.

    If the plan begins with the tests of the pilot, every further test without a time is a test that
    could be the next one: it is assumed to be run six minutes after the last test of the pilot.
    Other tests without a time get the value 0, the mean time of the pilot.
    """
    stated_s = _field_of_tests("time_s", campaign)
    relative_s = np.zeros(len(stated_s))
    pilot_s = _field_of_tests("time_s", pilot or campaign)
    begins_with_pilot = _begins_with(campaign, pilot or campaign)
    if np.isfinite(pilot_s).all():
        if begins_with_pilot:
            next_s = pilot_s.max() + SECONDS_PER_TEST
            stated_s = np.where(np.isfinite(stated_s), stated_s, next_s)
        relative_s = np.nan_to_num(stated_s - pilot_s.mean())
    elif np.isfinite(stated_s).all():
        relative_s = stated_s - stated_s.mean()
    elif campaign.order is None and begins_with_pilot:
        relative_s = _times_from_order_s(pilot or campaign, len(campaign.tests))
    relative_h: Array = relative_s / _SECONDS_PER_HOUR
    if np.abs(relative_h).max() < _SAME_TIME_H:
        return np.full(len(relative_h), np.nan)
    return relative_h


def _times_from_order_s(campaign: Campaign, number: int) -> Array:
    """Return the times of ``number`` tests [s], of which the first are the tests of a campaign.

    These are assumed to have been run in the order in which they are listed, at equal intervals.
    Each of the other tests could be run next, one interval after the last test of the campaign. The
    mean time of the campaign is subtracted; if there are other tests, the mean time of the campaign
    and one of these. All results are zero if the user has declared that the tests were run in
    random order.
    """
    if campaign.order is not None:
        return np.zeros(number)
    run = len(campaign.tests)
    listed_s = SECONDS_PER_TEST * np.minimum(np.arange(number), run)
    return np.asarray(listed_s - listed_s[: run + 1].mean())


def _begins_with(campaign: Campaign, pilot: Campaign) -> bool:
    """Return whether the first tests of a campaign have the names of the tests of its pilot.

    The pilot is the campaign from which a plan was designed.
    """
    names = [test.name for test in campaign.tests]
    pilot_names = [test.name for test in pilot.tests]
    return names[: len(pilot_names)] == pilot_names


def relative_temperatures_K(campaign: Campaign, pilot: Campaign | None) -> Array:
    """Return the temperature of every test minus a mean temperature [K], shape (tests,).

    If a ``pilot`` is given (the campaign from which a plan was designed), the mean over its tests
    is subtracted, and tests without a temperature are assumed to be at this mean. Otherwise the
    mean over the tests of the campaign is subtracted, and tests without a temperature get NaN. All
    values are NaN if there is no temperature from which the mean can be computed.
    """
    temperatures = _field_of_tests("temperature_C", campaign)
    reference = _field_of_tests("temperature_C", pilot or campaign)
    if not np.isfinite(reference).any():
        return temperatures * np.nan
    relative: Array = temperatures - np.nanmean(reference)
    if pilot is None:
        return relative
    return np.where(np.isfinite(relative), relative, 0.0)


def _field_of_tests(field: str, campaign: Campaign) -> Array:
    """Return the values of one field of all tests of a campaign, shape (tests,).

    ``field`` is the name of the field, such as time_s. The result is NaN for tests without a value.
    """
    values = [getattr(test, field) for test in campaign.tests]
    return np.array([np.nan if value is None else value for value in values], dtype=float)
