"""Tests with exactly the same readings, such as a file and its copy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ldbb_bayes.reading.recording import Recording

__all__ = ["note_repeated_readings"]

# Fewer different readings may be the same in two circles by chance.
_FEWEST_DIFFERENT = 10


def note_repeated_readings(recordings: Sequence[Recording]) -> None:
    """Note tests whose readings are exactly those of another test, as in a file and its copy.

    Two circles of a machine differ at least by noise. Tests with few different readings are not
    examined.

    Parameters
    ----------
    recordings
        All tests.
    """
    first_tests: dict[bytes, Recording] = {}
    for recording in recordings:
        readings = recording.numbers.get("reading")
        if readings is None or len(np.unique(readings)) < _FEWEST_DIFFERENT:
            continue
        first = first_tests.setdefault(readings.tobytes(), recording)
        if first is not recording:
            reason = f"exactly those of {first.title!r}"
            recording.note("readings", "a circle of their own", reason, "leave a copy out")
