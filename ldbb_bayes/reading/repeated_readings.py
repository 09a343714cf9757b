"""Tests with the readings of another test, and readings that are exactly zero several times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ldbb_bayes.reading.recording import Recording

__all__ = ["note_repeated_readings", "note_repeated_zeros"]

# Fewer different readings may be the same in two circles by chance.
_FEWEST_DIFFERENT = 10
# This many readings in a row that are exactly zero may be an interrupted signal.
_FEWEST_ZEROS = 4


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


def note_repeated_zeros(recordings: Sequence[Recording]) -> None:
    """Note readings that are exactly zero several times in a row, as if the signal was lost.

    Nothing is noted if another reading occurs as often in a row, as it does if the instrument
    counts coarse steps.

    Parameters
    ----------
    recordings
        All tests.
    """
    for recording in recordings:
        readings = recording.numbers.get("reading")
        if readings is None or not np.any(readings):
            continue
        first_of_run = np.append(0, np.flatnonzero(np.diff(readings)) + 1)
        lengths = np.diff(np.append(first_of_run, len(readings)))
        is_zero = readings[first_of_run] == 0.0
        longest_other = lengths[~is_zero].max()
        for start, length in zip(first_of_run[is_zero], lengths[is_zero], strict=True):
            if length >= _FEWEST_ZEROS and longest_other < _FEWEST_ZEROS:
                value = f"{length} zeros in a row"
                reason = f"taken as they stand from line {recording.lines[start]}"
                recording.note("readings", value, reason, "remove them if the signal was lost")
