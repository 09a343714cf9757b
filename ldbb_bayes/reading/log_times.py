"""Times of the readings in a log over time: their unit, jumps of the clock, and gaps.

A log over time is a table that holds times instead of angles.
"""

from __future__ import annotations

import numpy as np

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.column_units import unit_size
from ldbb_bayes.reading.open_question import OpenQuestionError
from ldbb_bayes.reading.recording import Recording
from ldbb_bayes.reading.words import UNITS
from ldbb_bayes.results import Array

__all__ = ["times_of_log"]

# Earliest and latest time at which readings may have been recorded, in seconds since 1970: the
# beginning of the year 2000 and the beginning of the year 2100. If the first number in a column of
# times lies between these limits in one of ``_STAMP_UNITS``, all numbers in the column are taken to
# be times since 1970 in this unit.
_FIRST_STAMP_S = 946_684_800.0
_LAST_STAMP_S = 4_102_444_800.0
# Units in which programs count the time since 1970.
_STAMP_UNITS = ("s", "ms", "us", "ns")
# In a log over time, the step from one time to the next is called a gap if it is longer than this
# multiple of the median step.
_LARGEST_GAP_STEPS = 5.0
# Times are evenly spaced if no step differs from the median step by more than this fraction of
# the median step.
_EVEN_SHARE = 0.5
# A note on a clock that was set back lists at most this number of steps back in time.
_ROWS_SHOWN = 5


def times_of_log(recording: Recording) -> Array:
    """Return the times of the readings in a log over time, shape (n,) [s].

    A log over time is a table that holds times instead of angles. The returned times increase from
    reading to reading. If the clock was set back and all other time steps are nearly equal, the
    times are corrected and the correction is noted. If there are gaps between the times, the user
    must state whether the machine stood still or continued to move during the gaps.

    Raises
    ------
    InputError
        If times do not increase and cannot be corrected, or if the user does not state what the
        machine did in gaps.
    """
    raw = recording.numbers["time"]
    times = raw * unit_size(recording, "time", *_usual_unit(raw))
    steps = np.diff(times)
    if len(steps) == 0:
        return times
    equal = np.flatnonzero(steps == 0.0)
    if equal.size:
        line = recording.lines[equal[0] + 1]
        raise InputError(
            f"{recording.place}, line {line}: time must increase from row to row, got the same"
            " again. Export the time with more decimals, or leave the second row out."
        )
    usual = float(np.median(np.abs(steps)))
    steps = _without_jumps_back(recording, steps, usual)
    steps = _without_gaps(recording, steps, usual)
    return times[0] + np.concatenate([[0.0], np.cumsum(steps)])


def _usual_unit(raw: Array) -> tuple[str, str]:
    """Return the unit that is assumed for times, and the reason why this unit is assumed.

    The unit is used only if neither the user nor the file states a unit. ``raw`` are the numbers in
    the column of times, shape (n,).
    """
    for unit in _STAMP_UNITS:
        if _FIRST_STAMP_S <= raw[0] * UNITS["time"][unit] <= _LAST_STAMP_S:
            return unit, "stamps since 1970"
    return "s", "no unit in the header"


def _without_jumps_back(recording: Recording, steps: Array, usual: float) -> Array:
    """Return the time steps [s] with each step back in time replaced by the usual step.

    A step is negative if the clock was set back. ``steps`` are the differences of successive times,
    shape (n − 1,), and ``usual`` is the median of their absolute values [s]. Raise an error if many
    steps are negative, or if the positive steps are not nearly equal. Neither error is raised if
    the user states that the machine stood still where the times have a gap.
    """
    is_back = steps < 0.0
    if not is_back.any():
        return steps
    forward = steps[~is_back]
    line = recording.lines[int(np.argmax(is_back)) + 1]
    is_even = forward.size > 0 and np.abs(forward - usual).max() <= _EVEN_SHARE * usual
    is_rare = np.count_nonzero(is_back) <= max(1, forward.size // 20)
    if recording.layout.gaps != "still" and not (is_even and is_rare):
        raise OpenQuestionError(
            f"{recording.place}, line {line}: time must increase from row to row, got"
            f" {steps[is_back][0]:.4g} s. Sort the rows by time; if the clock was set back, give"
            " --gaps still: such a step then counts as a usual one.",
            "gaps",
            ("still",),
        )
    back = ", ".join(f"{step:.4g} s" for step in steps[is_back][:_ROWS_SHOWN])
    value = f"the clock was set back ({back} at line {line}): one usual step of {usual:.4g} s"
    recording.note("time", value, "the rows are evenly spaced otherwise", "--gaps")
    return np.where(is_back, usual, steps)


def _without_gaps(recording: Recording, steps: Array, usual: float) -> Array:
    """Return the time steps [s], with a usual step in place of each gap without motion.

    A gap is a step much longer than the usual step. If the user states that the machine stood still
    in gaps, each gap is replaced by the usual step. If the user states that the machine continued
    to move, the steps are returned unchanged. If the user states neither, an error is raised for a
    gap. ``steps`` are the differences of successive times, shape (n − 1,), and ``usual`` is the
    median of their absolute values [s].
    """
    is_gap = steps > _LARGEST_GAP_STEPS * usual
    if not is_gap.any():
        return steps
    line = recording.lines[int(np.argmax(is_gap)) + 1]
    longest = float(steps[is_gap].max())
    gaps = recording.layout.gaps
    if gaps is None:
        raise OpenQuestionError(
            f"{recording.place}, line {line}: a log must have no gap, got one of {longest:.4g} s"
            f" where {usual:.4g} s is usual. Say what the machine did in it: --gaps still, or"
            " --gaps moving.",
            "gaps",
            ("still", "moving"),
        )
    recording.note("gaps", gaps, f"{longest:.4g} s before line {line}", "--gaps")
    if gaps == "moving":
        return steps
    return np.where(is_gap, usual, steps)
