"""Functions that remove readings from a circular test: in given arcs, or near reversals of axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ldbb_bayes.campaign.campaign import CircularTest
from ldbb_bayes.errors import InputError, require

__all__ = ["mask_angles", "mask_reversals"]

# Angles at which the machine axes of a plane reverse [deg].
_REVERSALS_DEG = (0.0, 90.0, 180.0, 270.0)


def mask_angles(test: CircularTest, arcs_deg: Sequence[Sequence[float]]) -> CircularTest:
    """Return a test without the readings inside given arcs.

    Parameters
    ----------
    test : CircularTest
        The circular test; it is not changed.
    arcs_deg : sequence of tuple of float
        Start and end of each arc [deg]; the arc runs counter-clockwise from the start, modulo 360°.
        Readings at start and end are removed too. If start and end differ by 360° or more, the arc
        is the whole circle.

    Returns
    -------
    CircularTest
        The test with the remaining readings.

    Raises
    ------
    InputError
        If an angle is not finite, if fewer than nine readings remain, or if the remaining readings
        cover less than 180°.

    Examples
    --------
    >>> test = campaign.tests[0]
    >>> shorter = lb.reading.mask_angles(test, [(350.0, 10.0)])
    >>> len(test.angle_deg), len(shorter.angle_deg)
    (720, 679)
    """
    keep = np.ones(len(test.angle_deg), dtype=bool)
    for start, end in arcs_deg:
        if not (np.isfinite(start) and np.isfinite(end)):
            raise InputError(
                f"arcs_deg must be finite angles, got ({start}, {end}). Give start and end in"
                " degrees."
            )
        width = np.mod(end - start, 360.0)
        if abs(end - start) >= 360.0:
            width = 360.0
        keep &= np.mod(test.angle_deg - start, 360.0) > width
    require(
        keep.any(),
        f"arcs_deg must leave readings, got arcs that cover all of test {test.name!r}. Make them"
        " smaller.",
    )
    return test.select(keep)


def mask_reversals(test: CircularTest, half_width_deg: float = 5.0) -> CircularTest:
    """Return a test without the readings near 0°, 90°, 180° and 270°.

    At these angles the axes of the machine reverse, so that backlash and reversal spikes are
    largest.

    Parameters
    ----------
    test : CircularTest
        The circular test; it is not changed.
    half_width_deg : float, default 5.0
        Readings are removed if they are at most this angle away from a reversal point [deg]. The
        value must be above 0 and below 45.

    Returns
    -------
    CircularTest
        The test with the remaining readings.

    Raises
    ------
    InputError
        If the half-width is out of range, or if fewer than nine readings are left.

    Examples
    --------
    >>> test = lb.reading.mask_reversals(campaign.tests[0], half_width_deg=5.0)
    >>> len(test.angle_deg), test.angle_deg.min()
    (636, np.float64(5.5))
    """
    require(
        0.0 < half_width_deg < 45.0,
        f"half_width_deg must lie between 0 and 45, got {half_width_deg}. Choose a few degrees.",
    )
    arcs = [(angle - half_width_deg, angle + half_width_deg) for angle in _REVERSALS_DEG]
    return mask_angles(test, arcs)
