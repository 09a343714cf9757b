"""Circles whose readings span less or more than a ball bar shows: their unit is in doubt."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.circular_test import CircularTest

__all__ = ["UnlikelySpan", "unlikely_spans"]

# Smallest peak-to-peak value of a real circle [µm]: one step of a fine readout, 0.1 µm, less its
# rounding. Noise and the form of the balls alone give more. Readings in mm that are taken for µm
# give less.
_LEAST_SPAN_UM = 0.09
# Largest range of the readings of a real circle [µm], spikes left out. A ball bar has a stroke of
# some mm. Readings in nm that are taken for µm have a larger range.
_LARGEST_RANGE_UM = 3000.0
# Percentiles of a circle's readings between which its range is determined. Spikes lie outside.
_RANGE_PERCENTILES = (5.0, 95.0)
# If the readout has a resolution coarser than this [µm], the readings of a good circle may all be
# equal.
_COARSE_RESOLUTION_UM = 0.5


class UnlikelySpan(NamedTuple):
    """A circle whose readings have a range that no ball bar shows."""

    test: str  #: name of the circular test
    #: peak-to-peak value of the readings, or their range without spikes if that is too large [µm]
    span_um: float
    #: smallest or largest value that a ball bar shows [µm]
    limit_um: float


def unlikely_spans(campaign: Campaign) -> tuple[UnlikelySpan, ...]:
    """Return the circles of a campaign whose readings probably are in another unit than stated.

    Their readings span less or more than a ball bar shows: a peak-to-peak value below 0.09 µm, or a
    range above 3 mm. The limits are wider than those of the preview of a campaign, because a fit
    whose readings are in doubt cannot be used. Planned tests are not judged.

    Parameters
    ----------
    campaign : Campaign
        Campaign or plan.

    Returns
    -------
    tuple of UnlikelySpan
        One entry for each such circle, in the order of the campaign.
    """
    spans = [_unlikely_span(test, campaign.resolution_um) for test in campaign.tests]
    return tuple(span for span in spans if span is not None)


def _unlikely_span(test: CircularTest, resolution_um: float) -> UnlikelySpan | None:
    """Return the range of a circle's readings if no ball bar shows it, and otherwise None.

    ``resolution_um`` is the resolution of the readout [µm].
    """
    if test.reading_um is None:
        return None
    span_um = float(np.ptp(test.reading_um))
    may_be_equal = span_um == 0.0 and resolution_um > _COARSE_RESOLUTION_UM
    if span_um < _LEAST_SPAN_UM and not may_be_equal:
        return UnlikelySpan(test.name, span_um, _LEAST_SPAN_UM)
    low_um, high_um = np.percentile(test.reading_um, _RANGE_PERCENTILES)
    range_um = float(high_um - low_um)
    if range_um > _LARGEST_RANGE_UM:
        return UnlikelySpan(test.name, range_um, _LARGEST_RANGE_UM)
    return None
