"""How the times of the tests are obtained: from given start times, or from the tests' order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum

from ldbb_bayes.campaign.campaign import Campaign, CircularTest

__all__ = [
    "SECONDS_PER_TEST",
    "TimeSource",
    "after_the_others",
    "time_source",
    "times_stated",
    "with_listed_times",
]

# Time [s] that is assumed between the starts of consecutive tests if start times are not given for
# all tests of a campaign.
SECONDS_PER_TEST = 360.0


class TimeSource(StrEnum):
    """Source of the times at which tests were run.

    The drift of the bar's length and of the circle's centre is computed from these times.
    """

    #: The times of the tests are the start times ``time_s`` that the user has given for all tests.
    TIMES = "times"
    #: The tests are assumed to have been run in the order in which they are listed, and a test is
    #: assumed to start six minutes after the test before it.
    LISTED = "listed order"
    #: The times of the tests are unknown, because the tests were run in random order.
    RANDOM = "random order"
    #: The times of the tests are not needed, because the user has declared that nothing drifted
    #: between tests.
    NO_DRIFT = "no drift"


def time_source(campaign: Campaign) -> TimeSource:
    """Return the source of the times at which a campaign's tests were run.

    The drift of the bar's length and of the circle's centre is computed from these times. No times
    are needed if the user has declared that nothing drifted. If start times are given for all
    tests, these times are used. Otherwise the tests are assumed to have been run in the order in
    which they are listed, unless the user has declared that the order was random.
    """
    if not campaign.drift:
        return TimeSource.NO_DRIFT
    if times_stated(campaign) == len(campaign.tests):
        return TimeSource.TIMES
    if campaign.order is None:
        return TimeSource.LISTED
    return TimeSource.RANDOM


def times_stated(campaign: Campaign) -> int:
    """Return the number of a campaign's tests for which a start time is given."""
    return sum(test.time_s is not None for test in campaign.tests)


def with_listed_times(campaign: Campaign) -> Campaign:
    """Return a campaign with a time for each test.

    A campaign that states times, or whose times are not needed or not known, is returned unchanged.
    In any other campaign, each test gets a time in proportion to its position in the list.
    """
    if time_source(campaign) != TimeSource.LISTED:
        return campaign
    tests = []
    for i, test in enumerate(campaign.tests):
        tests.append(replace(test, time_s=i * SECONDS_PER_TEST))
    return replace(campaign, tests=tuple(tests))


def after_the_others(campaign: Campaign, tests: Sequence[CircularTest]) -> tuple[CircularTest, ...]:
    """Return further tests with times after those of a campaign.

    The tests are run in the order in which they are listed, six minutes apart. A test that states a
    time keeps it. If the times of the campaign are not needed or not known, the tests are returned
    unchanged.
    """
    if time_source(campaign) != TimeSource.TIMES:
        return tuple(tests)
    last_s = max(test.time_s or 0.0 for test in campaign.tests)
    timed = []
    for k, test in enumerate(tests, start=1):
        time_s = last_s + k * SECONDS_PER_TEST
        timed.append(test if test.time_s is not None else replace(test, time_s=time_s))
    return tuple(timed)
