"""Digest of the readings of circles alone, whatever is stated of them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

import numpy as np

from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.results import Array

__all__ = ["circles_digest"]

# Step to which angles [deg] and differences of readings [µm] are rounded before they are hashed. It
# is far below what an instrument resolves, and far above the rounding errors of double precision.
_STEP = 1e-6
# Numbers with few decimals are multiples of the step. This offset, in steps, keeps them away from
# the limits of the rounding, where an error in the last digit would change the result.
_OFFSET = 1.0 / 3.0


def circles_digest(tests: Iterable[CircularTest]) -> str:
    """Return the SHA-256 digest of the angles and readings of circles.

    Two campaigns have the same digest if they hold the same readings, whatever else they state. The
    order and the names of the tests, and the order of the readings within a test, have no effect.
    Neither has a constant that is added to all readings of a circle: the differences between
    neighbouring readings are hashed instead of the readings. If readings are compensated for
    another deflection of the mount, or the bar's zero is set again, the readings of a circle change
    by such a constant.

    Angles are rounded to 1e-6°, and differences of readings to 1e-6 µm, so that rounding errors in
    the last digit have no effect.

    Parameters
    ----------
    tests : tests with readings.
    """
    digest = hashlib.sha256()
    for circle in sorted(_digest_of_circle(test) for test in tests):
        digest.update(circle)
    return digest.hexdigest()


def _digest_of_circle(test: CircularTest) -> bytes:
    """Return the SHA-256 digest of a test's angles and of the differences between its readings."""
    reading_um = np.asarray(test.reading_um, dtype=float)
    angles = _in_steps(test.angle_deg)
    by_angle = np.lexsort((reading_um, angles))
    digest = hashlib.sha256(angles[by_angle].tobytes())
    digest.update(_in_steps(np.diff(reading_um[by_angle])).tobytes())
    return digest.digest()


def _in_steps(values: Array) -> Array:
    """Return values as whole numbers of steps of 1e-6, for the computation of a digest."""
    return np.floor(np.asarray(values, dtype=float) / _STEP + _OFFSET).astype("<i8")
