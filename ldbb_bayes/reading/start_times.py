"""Start times of the tests of a campaign, from the dates and times that their files state.

The times are used only if every test has one. Only then are the order of all tests and the pauses
between the tests known.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import date
from typing import Any, NamedTuple

import numpy as np

from ldbb_bayes.reading.assumptions import LIST_SHOWN, AssumptionLog, shown_list
from ldbb_bayes.reading.cited_lines import CitedLine, cited_line, quoted_line
from ldbb_bayes.reading.dates import iso_date
from ldbb_bayes.reading.numerals import DAY_S
from ldbb_bayes.reading.recording import Recording
from ldbb_bayes.reading.timestamps import (
    Rank,
    Timestamp,
    epoch_stamp,
    epoch_stamp_in_line,
    stamp_in_name,
    stamps_in,
    unread_stamp,
)
from ldbb_bayes.results import Array

__all__ = ["take_start_times"]

# If the times of day of the tests have no dates and span more than this [s], some tests may have
# been run after midnight. This is assumed only if all tests span at most ``_NIGHT_S`` when the
# early times are counted as times of the next day.
_LONG_CAMPAIGN_S = 12 * 3_600.0
# Longest duration of a campaign that is assumed to have run across midnight [s].
_NIGHT_S = 6 * 3_600.0
# Shortest time from one circle to the next [s]. Timestamps that are closer together are taken as
# the times at which the files were written.
_SHORTEST_CIRCLE_S = 5.0
# Regular expression for a date without a time of day in a name, such as 2026-11-20 or 20.11.2026.
_DATE_IN_NAME = re.compile(
    r"(?<!\d)(?:(?:19|20)\d\d([-_.])\d\d\1\d\d|\d\d([-_.])\d\d\2(?:19|20)\d\d)(?!\d)"
)
# Options with which the user can replace the start times of tests. They are named in the notes that
# list the start times found in the files.
_OPTIONS_TAKEN = "time_s of a [[test]] in --layout, --no-drift"
# Options by which the user can state the order of the tests. Notes name these options if the files
# state no start times, because the tests are then assumed to have been run as listed.
_OPTIONS_LISTED = "--order, time_s of a [[test]] in --layout, --no-drift"


class _Start(NamedTuple):
    """Date and time, stated in a file, at which a test was run."""

    title: str  # name of the test that began at this time
    stamp: Timestamp  # date, time of day, or both, at which the test began
    # words with which notes say where the start of the test is stated, such as "line 3"
    source: str | CitedLine
    # header of the column that states when the test began; empty if a line or a name states it
    column: str = ""


class _Times(NamedTuple):
    """Start times of all tests, or the reason why they are not known."""

    # time from the earliest start of all tests to the start of each test [s], shape (tests,)
    seconds: Array | None
    # reason why the times are not known. If they are known, the text says how an ambiguous date was
    # read; it is empty if no date is ambiguous
    reason: str | CitedLine


def take_start_times(
    campaign: Mapping[str, Any], recordings: Sequence[Recording], log: AssumptionLog
) -> set[str]:
    """Set the field ``time_s`` of every test to its start time, counted from the first test [s].

    Start times are the dates and times that columns, lines above the tables, and names of files
    state. They are used, and noted, only if they are known for all tests and if neither the user
    nor a column states ``time_s``. If start times are not known for all tests, the tests are
    assumed to have been run in the order in which they are listed. This assumption is noted with
    the reason, unless the user gives an order or says that there is no drift.

    Parameters
    ----------
    campaign
        Fields of the campaign that the user's options set.
    recordings
        Rows and statements of each test in the files. The start times of the tests are added.
    log
        Log to which the assumptions are added.

    Returns
    -------
    set of str
        Headers of the columns from which start times were taken.
    """
    if len(recordings) < 2 or any(_states_time(recording) for recording in recordings):
        return set()
    starts = []
    for recording in recordings:
        start = _start_of_test(recording)
        if start is not None:
            starts.append(start)
    times = _times_of_tests(starts, recordings)
    if times.seconds is None:
        if campaign.get("order") is None and campaign.get("drift", True):
            log.add("", "order", "as listed", times.reason, _OPTIONS_LISTED)
        _note_days_apart(recordings, log)
        return set()
    for recording, seconds in zip(recordings, times.seconds.tolist(), strict=True):
        recording.fields["time_s"] = round(seconds, 3)
    _note_times(starts, times, log)
    return {start.column for start in starts if start.column}


def _unread_line(recordings: Sequence[Recording]) -> CitedLine | None:
    """Return a note on the first date and time of unknown meaning; None if there are none.

    Such a date and time stand in a line above a table, after words that this package does not know.
    It is therefore uncertain whether they say when a test was run.
    """
    for recording in recordings:
        for line, text in recording.heading.lines_above:
            unread = unread_stamp(text)
            if unread:
                return quoted_line(line, unread, "not understood")
    return None


def _times_of_tests(starts: Sequence[_Start], recordings: Sequence[Recording]) -> _Times:
    """Return the start times of the tests, or the reason why they are not known.

    ``starts`` holds the timestamps of the tests that have one, and ``recordings`` all tests.
    """
    if not starts:
        nothing = "nothing says when the tests were run"
        return _Times(None, _unread_line(recordings) or nothing)
    titles = [recording.title for recording in recordings]
    if len(starts) < len(titles):
        stated = [start.title for start in starts]
        lacking = [title for title in titles if title not in stated]
        counts = f"only {len(starts)} of {len(titles)} tests state when they were run"
        return _Times(None, f"{counts}, not {shown_list(lacking)}")
    return _times_from_stamps([start.stamp for start in starts])


def _note_days_apart(recordings: Sequence[Recording], log: AssumptionLog) -> None:
    """Add a note to the log if the dates of the tests lie more than a day apart.

    The dates stand in columns, in lines above the tables, and in names. A date that can be read in
    two ways, such as 03/04/2026, is left out.
    """
    dated = [_day_of_test(recording) for recording in recordings]
    days = [day for day in dated if day is not None]
    n_days = (max(days) - min(days)).days if days else 0
    if n_days > 1:
        reason = f"{n_days} days from the first test to the last, with one drift over all"
        log.add("", "date", "more than a day apart", reason, "import the tests of each day alone")


def _day_of_test(recording: Recording) -> date | None:
    """Return the day of a test; None if it is not stated, or can be read in two ways."""
    dated = [start for start in _stated_starts(recording) if start.stamp.has_date]
    if dated:
        stamp = min(dated, key=_rank_of_source).stamp
        return stamp.day_first if stamp.day_first == stamp.month_first else None
    for name in recording.names_of_files():
        match = _DATE_IN_NAME.search(name)
        day = iso_date(match[0].replace("_", "-")) if match else ""
        if day:
            return date.fromisoformat(day)
    return None


def _states_time(recording: Recording) -> bool:
    """Return whether the user or a column of the table states the field ``time_s`` of a test."""
    if recording.stated.get("time_s") is not None:
        return True
    return recording.fields.get("time_s") is not None


def _start_of_test(recording: Recording) -> _Start | None:
    """Return the start time of a test from the most reliable source; None if nothing states it.

    The sources are columns, lines above the table, and the names of the test and its file. If the
    most reliable source states a time of day but no date, the date is taken from another source.
    """
    starts = _stated_starts(recording)
    timed = [start for start in starts if start.stamp.seconds is not None]
    if not timed:
        return None
    start = min(timed, key=_rank_of_source)
    dated = [other for other in starts if other.stamp.has_date]
    if start.stamp.has_date or not dated:
        return start
    day = min(dated, key=_rank_of_source).stamp
    stamp = replace(start.stamp, day_first=day.day_first, month_first=day.month_first)
    return start._replace(stamp=stamp)


def _rank_of_source(start: _Start) -> Rank:
    """Return the rank of the place that states the start of a test.

    A place with a lower rank is more reliable. For example, a column of times has a lower rank than
    the name of a file.
    """
    return start.stamp.rank


def _stated_starts(recording: Recording) -> list[_Start]:
    """Return all dates and times that columns, lines and names state for a test."""
    title = recording.title
    starts = []
    for header, cell in recording.first_cells.items():
        source = f"the column {header[:LIST_SHOWN]!r}"
        for stamp in _stamps_of_cell(header, cell):
            starts.append(_Start(title, stamp, source, header))
    for line, text in recording.heading.lines_above:
        since_epoch = epoch_stamp_in_line(text)
        stamps = stamps_in(text) if since_epoch is None else [since_epoch]
        starts += [_Start(title, stamp, cited_line(line)) for stamp in stamps]
    named = stamp_in_name(recording.names())
    if named is not None:
        starts.append(_Start(title, named, "its name"))
    return starts


def _stamps_of_cell(header: str, cell: str) -> list[Timestamp]:
    """Return the dates and times in a cell if the header of its column is about time."""
    since_epoch = epoch_stamp(header, cell)
    if since_epoch is not None:
        return [since_epoch]
    return stamps_in(f"{header}: {cell}", Rank.COLUMN)


def _times_from_stamps(stamps: Sequence[Timestamp]) -> _Times:
    """Return the times [s] from the earliest start to the start of each test.

    ``stamps`` holds one timestamp with a time of day for each test. If the timestamps do not
    determine the times, the result states the reason instead.
    """
    zones = {stamp.zone_s for stamp in stamps}
    if None in zones and len(zones) > 1:
        return _Times(None, "some tests state a time zone, and the others none that is known")
    seconds = _seconds_of_day(stamps)
    dated = [stamp for stamp in stamps if stamp.has_date]
    if len(dated) == len(stamps):
        times = _times_from_dates(stamps, seconds)
    elif len(dated) == 0 or _is_one_day(dated):
        times = _Times(_times_across_midnight(seconds), "")
    else:
        times = _Times(None, "some tests state no date, and the others several")
    if times.seconds is None:
        return times
    span = float(times.seconds.max())
    if span < _SHORTEST_CIRCLE_S * (len(stamps) - 1):
        reason = f"they are too close together: all within {span:.3g} s"
        return _Times(None, reason)
    return times


def _seconds_of_day(stamps: Sequence[Timestamp]) -> Array:
    """Return the time of day of each timestamp [s], in UTC if they state time zones."""
    seconds = np.array([stamp.seconds for stamp in stamps], dtype=float)
    zones = [stamp.zone_s for stamp in stamps]
    if None not in zones:
        seconds -= np.array(zones, dtype=float)
    return seconds


def _is_one_day(stamps: Sequence[Timestamp]) -> bool:
    """Return whether all timestamps state the same date."""
    days = {(stamp.day_first, stamp.month_first) for stamp in stamps}
    return len(days) == 1


def _times_across_midnight(seconds: Array) -> Array:
    """Return the times [s] from the earliest start to each start, from times of day without dates.

    ``seconds`` are the times of day [s], shape (tests,). If they span more than twelve hours, the
    tests may have been run across midnight. In this case, the times before the largest gap are
    moved to the next day, provided that all times then lie within six hours.
    """
    span = np.ptp(seconds)
    if span > _LONG_CAMPAIGN_S:
        ordered = np.sort(seconds)
        largest_gap = int(np.argmax(np.diff(ordered)))
        after_midnight = seconds <= ordered[largest_gap]
        shifted = seconds + DAY_S * after_midnight
        if np.ptp(shifted) <= _NIGHT_S:
            seconds = shifted
    return seconds - seconds.min()


def _times_from_dates(stamps: Sequence[Timestamp], seconds: Array) -> _Times:
    """Return the times [s] from the earliest start to each start; the timestamps have dates.

    In a date such as 03/04/2026, either the day or the month stands first. An order is possible if
    it makes all dates valid. If no order is possible, the times are unknown. Suppose both orders
    are possible and give different times: if all tests start within 24 hours in only one of them,
    this order is used; otherwise, the times are unknown. ``stamps`` holds the timestamp of each
    test, and ``seconds`` holds its time of day [s], shape (tests,).
    """
    times_by_order: dict[str, Array] = {}
    for order, days in _possible_days(stamps).items():
        ordinals = np.array([day.toordinal() for day in days], dtype=float)
        since_first_day = DAY_S * (ordinals - ordinals.min()) + seconds
        times_by_order[order] = since_first_day - since_first_day.min()
    if not times_by_order:
        return _Times(None, "their dates do not fit together: days and months change places")
    candidates = list(times_by_order.values())
    if len(candidates) == 1 or np.array_equal(candidates[0], candidates[1]):
        return _Times(candidates[0], "")
    within_a_day = [order for order, times in times_by_order.items() if times.max() <= DAY_S]
    open_stamp = _first_ambiguous_date(stamps)
    if len(within_a_day) != 1:
        return _Times(None, f"{open_stamp!r} may have the day or the month first")
    order = within_a_day[0]
    return _Times(times_by_order[order], f"{open_stamp!r} read with the {order} first")


def _possible_days(stamps: Sequence[Timestamp]) -> Mapping[str, list[date]]:
    """Return a dict with the dates of all timestamps for each possible order of day and month.

    The keys are "day" for dates with the day first, and "month" for dates with the month first. An
    order is left out if at least one timestamp has no valid date in this order. ``stamps`` holds
    the timestamp of each test.
    """
    days_by_order = {
        "day": [stamp.day_first for stamp in stamps],
        "month": [stamp.month_first for stamp in stamps],
    }
    possible = {}
    for order, days in days_by_order.items():
        existing = [day for day in days if day is not None]
        if len(existing) == len(days):
            possible[order] = existing
    return possible


def _first_ambiguous_date(stamps: Sequence[Timestamp]) -> str:
    """Return the text of the first timestamp whose date depends on the order of day and month.

    ``stamps`` are the timestamps of all tests. The result is empty if every date is certain.
    """
    for stamp in stamps:
        if stamp.day_first != stamp.month_first:
            return stamp.text
    return ""


def _note_times(starts: Sequence[_Start], times: _Times, log: AssumptionLog) -> None:
    """Add a note on the start times of the tests, and on the sources of these times, to the log.

    A further note is added if the tests are not listed in the order of their times, and another if
    the first and the last test are more than a day apart. ``starts`` holds the start of each test
    with its source. ``times`` holds the times from the earliest start to the start of each test.
    """
    seconds = np.asarray(times.seconds)
    in_order = np.argsort(seconds, kind="stable").tolist()
    entries = []
    for k in in_order:
        entries.append(f"{starts[k].title} at {seconds[k] / 60.0:.4g} min")
    sources = list(dict.fromkeys(str(start.source) for start in starts))
    log.cite("", [start.source for start in starts if isinstance(start.source, CitedLine)])
    reason = shown_list(sources)
    if times.reason:
        reason += f"; {times.reason}"
    log.add("", "time_s", shown_list(entries), reason, _OPTIONS_TAKEN)
    if in_order != list(range(len(starts))):
        log.add("", "order", "that of their times", "they are listed in another", _OPTIONS_TAKEN)
    span_s = float(seconds.max())
    if span_s > DAY_S:
        days = round(span_s / DAY_S, 1)
        reason = f"{days:g} days from the first test to the last, with one drift over all"
        log.add("", "time_s", "more than a day apart", reason, _OPTIONS_TAKEN)
