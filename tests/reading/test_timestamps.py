"""Dates and times in lines and names: what they mean, and which are not those of a test."""

from __future__ import annotations

from datetime import date, datetime

import pytest
from campaigns import cases
from openpyxl.utils.datetime import to_excel

from ldbb_bayes.reading.timestamps import (
    Rank,
    Timestamp,
    epoch_stamp,
    epoch_stamp_in_line,
    stamp_in_name,
    stamps_in,
)

CASES = cases(__file__, "timestamps.toml")


def written(stamp: Timestamp) -> str:
    """The stamp in ISO 8601: the date with the day first, the time, and the zone in hours."""
    parts = []
    if stamp.day_first is not None:
        parts.append(stamp.day_first.isoformat())
    if stamp.seconds is not None:
        minutes = int(stamp.seconds // 60)
        parts.append(f"{minutes // 60:02d}:{minutes % 60:02d}:{stamp.seconds % 60:06.3f}")
    if stamp.zone_s is not None:
        parts.append(f"{stamp.zone_s / 3600:+g} h")
    return " ".join(parts)


@pytest.mark.parametrize(("line", "expected"), CASES["stamps"])
def test_stamps_in_lines(line: str, expected: list[str]) -> None:
    assert [written(stamp) for stamp in stamps_in(line)] == expected


@pytest.mark.parametrize("line", CASES["others"])
def test_dates_and_times_of_something_else(line: str) -> None:
    assert stamps_in(line) == []


@pytest.mark.parametrize(
    ("line", "rank"),
    [
        ("Start time: 14:03", Rank.START),
        ("Messbeginn;14:03", Rank.START),
        ("Uhrzeit: 14:03", Rank.TEST),
        ("# 2026-11-20 14:03", Rank.ALONE),
    ],
)
def test_the_words_of_a_line_say_what_its_stamp_is(line: str, rank: Rank) -> None:
    assert [stamp.rank for stamp in stamps_in(line)] == [rank]


def test_day_and_month_are_open_only_where_numbers_stand_between_slashes() -> None:
    (stamp,) = stamps_in("Date: 03/04/2026 14:03")
    assert (stamp.day_first, stamp.month_first) == (date(2026, 4, 3), date(2026, 3, 4))
    (stamp,) = stamps_in("Date: 25/04/2026 14:03")
    assert (stamp.day_first, stamp.month_first) == (date(2026, 4, 25), None)
    (stamp,) = stamps_in("Date: 03.04.2026 14:03")
    assert stamp.day_first == stamp.month_first == date(2026, 4, 3)


@pytest.mark.parametrize(("name", "expected"), CASES["names"])
def test_stamps_in_names(name: str, expected: str) -> None:
    stamp = stamp_in_name([name])
    found = ""
    if stamp is not None:
        found = written(stamp)
    assert found == expected


@pytest.mark.parametrize("unit", [1, 1000])
def test_seconds_since_1970(unit: int) -> None:
    when = datetime.fromisoformat("2026-11-20T14:03:12+00:00")
    stamp = epoch_stamp("timestamp", f"{when.timestamp() * unit:.0f}")
    assert stamp is not None
    assert written(stamp) == "2026-11-20 14:03:12.000 +0 h"


@pytest.mark.parametrize(
    ("header", "cell"),
    [
        ("reading", "1795183392"),
        ("time", "12"),
        ("time", "123456789"),
        ("time", "14:03"),
        ("time", "46346.5"),
        ("date", "12345.5"),
        ("calibration date", "46346.5"),
    ],
)
def test_other_numbers_are_no_seconds_since_1970(header: str, cell: str) -> None:
    assert epoch_stamp(header, cell) is None


@pytest.mark.parametrize("mark", [".", ","])
def test_days_that_a_spreadsheet_counts(mark: str) -> None:
    days = to_excel(datetime.fromisoformat("2026-11-20T14:03:12"))
    stamp = epoch_stamp("Date", f"{days:.6f}".replace(".", mark))
    assert stamp is not None
    assert written(stamp) == "2026-11-20 14:03:12.000"
    assert epoch_stamp_in_line(f"Datum;{days:.6f}") == epoch_stamp_in_line(f"Datum: {days:.6f}")
    in_line = epoch_stamp_in_line(f"Datum: {days:.6f}")
    assert in_line is not None
    assert (written(in_line), in_line.rank) == ("2026-11-20 14:03:12.000", Rank.TEST)


@pytest.mark.parametrize("line", ["Serial: 46346.5", "Date: 20.11.2026", "Radius: 150", "Date: 5"])
def test_other_lines_hold_no_counted_days(line: str) -> None:
    assert epoch_stamp_in_line(line) is None
