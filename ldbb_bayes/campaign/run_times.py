"""Sources of the times at which tests were run: stated start times, or the order of the tests."""

from __future__ import annotations

from enum import StrEnum

from ldbb_bayes.campaign.campaign import Campaign

__all__ = ["SECONDS_PER_TEST", "TimeSource", "time_source", "times_stated"]

# Time [s] that is assumed from the start of one test to the start of the next if a campaign states
# no times of its tests.
SECONDS_PER_TEST = 360.0


class TimeSource(StrEnum):
    """Source of the times at which tests were run.

    The drift of the bar's length and of the circle's centre is computed from these times.
    """

    TIMES = "times"  #: the start time (``time_s``) that every test states
    LISTED = "listed order"  #: the order in which the tests are listed, one test every six minutes
    #: no source: the times are unknown, because the campaign states that the order was random
    RANDOM = "random order"
    #: no source is needed: the campaign states that nothing drifted from test to test
    NO_DRIFT = "no drift"


def time_source(campaign: Campaign) -> TimeSource:
    """Return the source of the times at which a campaign's tests were run.

    The drift of the bar's length and of the circle's centre is computed from these times. If the
    campaign states that nothing drifted, no times are needed. If all tests state their start times,
    these times are used. If not, it is assumed that the tests were run in the order in which they
    are listed, unless the campaign states that the order was random.
    """
    if not campaign.drift:
        return TimeSource.NO_DRIFT
    if times_stated(campaign) == len(campaign.tests):
        return TimeSource.TIMES
    if campaign.order is None:
        return TimeSource.LISTED
    return TimeSource.RANDOM


def times_stated(campaign: Campaign) -> int:
    """Return the number of tests of a campaign that state their start time."""
    return sum(test.time_s is not None for test in campaign.tests)
