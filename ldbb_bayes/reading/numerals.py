"""Conversion of texts to numbers: decimal marks, thousands separators and times of day."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from datetime import date
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ldbb_bayes.campaign.cell_numbers import LONGEST_CELL_SHOWN, number_error
from ldbb_bayes.errors import InputError
from ldbb_bayes.results import Array

__all__ = [
    "DAY_S",
    "HOUR_S",
    "KEPT_CELLS",
    "NUMBER_IN_TEXT",
    "OTHER_MARK",
    "constant_value",
    "could_be_thousands",
    "decimal_mark",
    "is_clock",
    "is_missing",
    "looks_like_number",
    "may_be_thousands",
    "number",
    "number_in_text",
    "numbers_in",
    "seconds_of",
]

# Regular expression for a character, other than comma and point, that separates thousands: a blank
# of any width, an apostrophe or an underscore.
_GAP = r"[ '’_\u00a0\u202f\u2009]"
_EXPONENT = r"(?:[eEdD][+\-−–]?\d+)?"
# Regular expression for a cell that is a number, with a decimal point or a decimal comma.
_NUMBER_CELL = re.compile(
    rf"[+\-−–]?(?:\d{{1,3}}(?:{_GAP}\d{{3}})+(?:[.,]\d+)?|\d[\d.,]*{_EXPONENT}|[.,]\d+{_EXPONENT})"
)
# Regular expression for a number inside a text. It is used within other regular expressions.
NUMBER_IN_TEXT = r"[+\-−]?(?:\d+(?:[.,]\d+)?|[.,]\d+)(?:[eE][+\-]?\d{1,3})?"
# Table that replaces minus signs and dashes by the hyphen, which Python reads as a minus sign.
_MINUS_SIGNS = str.maketrans("−–", "--")
# Regular expression for a date in front of a time of day, such as "2026-03-04T" in
# 2026-03-04T12:00:01.
_DATE = r"(?:(?P<date>\d{4}-\d\d-\d\d)|\d{1,2}[./]\d{1,2}[./]\d{4})[T ]"
# Regular expression for a time zone, or for AM or PM, after a time of day.
_ZONE = r"\s?(?P<zone>Z|[+-]\d\d:?\d\d)|\s?(?P<half_day>[AaPp])\.?[Mm]\.?"
# Regular expression for a time of day, with or without date, such as 12:00:01.250, 12:00:01 PM or
# 00:01,25 (minutes and seconds).
_CLOCK = re.compile(
    rf"(?:{_DATE})?(?:(?P<hours>\d{{1,2}}):)?(?P<minutes>\d{{1,2}}):"
    rf"(?P<seconds>\d{{1,2}}(?:[.,]\d{{1,9}})?)(?:{_ZONE})?"
)
DAY_S = 86_400.0
HOUR_S = 3_600.0
# Texts that a file may write in a cell instead of a missing number.
_MISSING = (
    "-",
    "--",
    "---",
    "nan",
    "n/a",
    "na",
    "#n/a",
    "#div/0!",
    "#value!",
    "#ref!",
    "null",
    "none",
    "missing",
    "fehlt",
)
# Several steps of an import examine whether the same cells are numbers. The results for at most
# this number of cells are stored, so that they need not be computed again.
KEPT_CELLS = 4096
# The mark that may separate thousands for each decimal mark: the comma if the point is the decimal
# mark, and the point if the comma is. The keys are the decimal marks.
OTHER_MARK = {".": ",", ",": "."}
# Largest plausible value of a quantity; the keys are the names of the quantities. A comma or point
# before three digits may separate thousands only if the resulting value does not exceed this limit:
# 1,000 N may be 1000 N, but a radius of 150.000 mm cannot be 150 000 mm.
_LARGEST_THOUSANDS = {"force_N": 5000.0, "radius_mm": 2000.0, "feed_mm_per_min": 100_000.0}


@lru_cache(maxsize=KEPT_CELLS)
def looks_like_number(cell: str) -> bool:
    """Return whether a cell is a number; a time of day also counts as a number.

    A number with misplaced marks, such as 1,234.5,6, is accepted too: its row belongs to the table,
    and `numbers_in` raises an error that names the line.
    """
    return _NUMBER_CELL.fullmatch(cell) is not None or is_clock(cell)


def is_missing(cell: str) -> bool:
    """Return whether a cell says that its number is missing, as NaN and a dash do.

    A row with a missing number still belongs to the table. If the number is needed, later code
    raises an error that names the line.
    """
    return cell.casefold() in _MISSING


def is_clock(cell: str) -> bool:
    """Return whether a cell is a time of day, or a time in minutes and seconds."""
    return ":" in cell and _CLOCK.fullmatch(cell) is not None


def could_be_thousands(cell: str) -> bool:
    """Return whether the comma or point in a number may separate thousands.

    The comma may separate thousands in ``12,310``, but not in ``0,310`` or ``12,31``.
    """
    return re.fullmatch(r"[+\-−–]?[1-9]\d{0,2}[.,]\d{3}", cell) is not None


def may_be_thousands(key: str, text: str, unit_size: float) -> bool:
    """Return whether the comma or point in the value of a quantity may separate thousands.

    ``key`` is the field of the quantity, such as force_N, ``text`` is the number as written, and
    ``unit_size`` the size of its unit in that of the field, such as 1000 for a force in kN. The
    comma in ``1,000`` N may separate thousands. The point in ``150.000`` mm may not, because no
    circle has a radius of 150 000 mm, and that in ``1.100`` kN may not for the same reason.
    """
    if not could_be_thousands(text):
        return False
    digits = re.sub(r"[^\d]", "", text)
    return float(digits) * unit_size <= _LARGEST_THOUSANDS.get(key, 0.0)


def _is_grouped(text: str, mark: str) -> bool:
    """Return whether marks divide a whole number into groups of three digits, as in 1,000,000.

    ``mark`` is a regular expression for the mark. The number must not begin with a zero: in 0.310,
    the point is a decimal mark.
    """
    return re.fullmatch(rf"[+\-]?[1-9]\d{{0,2}}(?:{mark}\d{{3}})+", text) is not None


@lru_cache(maxsize=KEPT_CELLS)
def number(cell: str, decimal: str = ".") -> float:
    """Return the number in a cell, with ``decimal`` as the decimal mark.

    Thousands may be separated by blanks, apostrophes or underscores. If the decimal mark is a
    point, they may also be separated by commas; if it is a comma, by points.

    Raises
    ------
    ValueError
        If the text is not a number (the word nan does not count as a number), if the number is too
        large for the computer, such as 1e999, or if a separator of thousands is misplaced, as in
        1,23.4.
    """
    has_digit = re.search(r"\d", cell) is not None
    if not has_digit:  # Python's function float would read the word nan as a number
        raise ValueError(cell)
    if decimal == "." and "_" not in cell:  # Python's function float would read 1_0 as 10
        with suppress(ValueError):
            return _finite_number(cell)
    text = cell.strip().translate(_MINUS_SIGNS)
    whole, decimal_if_present, fraction = text.partition(decimal)
    for mark in (_GAP, re.escape(OTHER_MARK[decimal])):
        if re.search(mark, fraction):
            raise ValueError(cell)
        if re.search(mark, whole):
            if not _is_grouped(whole, mark):
                raise ValueError(cell)
            whole = re.sub(mark, "", whole)
    point = decimal_if_present.replace(decimal, ".")
    return _finite_number(f"{whole}{point}{fraction}".replace("D", "E").replace("d", "e"))


def _finite_number(text: str) -> float:
    """Return the number that a text states; raise a ValueError if Python reads it as infinite."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def number_in_text(text: str) -> float | None:
    """Return the number that a text consists of. The decimal mark may be a comma or a point.

    Return None if the text is not a number, or if the number is too large for the computer, such as
    1e999.
    """
    decimal = "," if "," in text else "."
    try:
        return number(text, decimal)
    except ValueError:
        return None


def numbers_in(
    place: str, name: str, lines: Sequence[int], cells: Sequence[str], decimal: str | None
) -> Array:
    """Return the numbers in the n cells of a column, shape (n,).

    Parameters
    ----------
    place
        Name of the table in error messages.
    name
        Name of the column in error messages.
    lines
        Line number of each cell in the file.
    cells
        The cells as texts.
    decimal
        Decimal mark; None if no cell has one.

    Raises
    ------
    InputError
        If a cell is not a finite number. The message names the line of this cell.
    """
    values = np.full(len(cells), np.nan)
    for k, cell in enumerate(cells):
        with suppress(ValueError):
            values[k] = number(cell, decimal or ".")
    not_finite = np.flatnonzero(~np.isfinite(values))
    if not_finite.size:
        first = not_finite[0]
        remedy = "Correct or remove the line."
        if re.fullmatch(r"[+\-−–]?\d+[.,]\d+", cells[first]):
            remedy = "Correct it, or give another --decimal."
        if is_clock(cells[first]):
            remedy = (
                "If its cells are degrees, minutes and seconds, put (D-M-S) behind its name in the"
                " header."
            )
        raise number_error(place, lines[first], name, cells[first], remedy)
    return values


def decimal_mark(place: str, cells: Iterable[tuple[int, str]]) -> str | None:
    """Return the decimal mark of a table; None if no cell has a comma or a point.

    In a cell with both a comma and a point, the last mark is the decimal mark, and the other mark
    separates thousands. Raise an `InputError` if two cells show different decimal marks, or if no
    cell has both marks, but some cells have a comma and others a point.

    Parameters
    ----------
    place
        Name of the table in messages.
    cells
        Line number and text of every cell.
    """
    certain: str | None = None
    # Line number and text of the first cell that contains a comma and no point, and of the first
    # cell that contains a point and no comma. The keys are the comma and the point.
    single: dict[str, tuple[int, str]] = {}
    for line, cell in cells:
        has_comma = "," in cell
        has_point = "." in cell
        if has_comma and has_point:
            mark = max(",.", key=cell.rfind)
            if certain not in (None, mark):
                raise _contradicting_marks(place, line, cell)
            certain = mark
        elif has_comma:
            single.setdefault(",", (line, cell))
        elif has_point:
            single.setdefault(".", (line, cell))
    if certain is None:
        if len(single) == 2:
            raise _contradicting_marks(place, *max(single.values()))
        return next(iter(single), None)
    other = OTHER_MARK[certain]
    if other in single:
        line, cell = single[other]
        if not _is_grouped(cell, re.escape(other)):
            raise _contradicting_marks(place, line, cell)
    return certain


def _contradicting_marks(place: str, line: int, cell: str) -> InputError:
    """Return the error for a cell whose decimal mark contradicts that of another cell.

    ``place`` is the name of the table, and ``line`` the line of the cell in the file.
    """
    return InputError(
        f"{place}, line {line}: the decimal mark must be the same in all rows, got"
        f" {cell[:LONGEST_CELL_SHOWN]!r}. Correct it; or give --decimal, if the other stands"
        " between thousands."
    )


class _ClockTime(NamedTuple):
    """Time of day in a cell, with date and time zone if the cell states them."""

    # time of day in the cell, as seconds since midnight; if the cell states only minutes and
    # seconds, as seconds since the full hour
    seconds: float
    has_hours: bool  # whether the cell states hours, and not only minutes and seconds
    # date in the cell, as a number of days (see `date.toordinal`); None if the cell has no date
    day: int | None
    zone_s: float | None  # local time minus UTC [s]; None if the cell states no time zone


def seconds_of(place: str, lines: Sequence[int], cells: Sequence[str]) -> Array:
    """Return the times of day in n cells as seconds, shape (n,) [s].

    If the cells state time zones, all times are converted to the zone of the first cell, so that
    the beginning or end of summer time causes no jump. If all cells state a date such as
    2026-10-25, the days since the first date are added to the times. Without dates, the seconds
    continue to increase after midnight. If the cells state only minutes and seconds, the seconds
    continue to increase after each full hour.

    Parameters
    ----------
    place
        Name of the table in error messages.
    lines
        Line number of each cell in the file.
    cells
        The cells.

    Raises
    ------
    InputError
        If a cell is not a time of day, or if some cells state a time zone and others do not.
    """
    clock_times = []
    for line, cell in zip(lines, cells, strict=True):
        clock_times.append(_clock_time(place, line, cell))
    times = np.array([entry.seconds for entry in clock_times])
    zones = [entry.zone_s for entry in clock_times if entry.zone_s is not None]
    if zones and len(zones) < len(cells):
        line = lines[[entry.zone_s is None for entry in clock_times].index(True)]
        raise InputError(
            f"{place}, line {line}: times must state their time zone in all rows or in none, got"
            " none. Complete it, or export the times in UTC."
        )
    if zones:
        times = times - (np.array(zones) - zones[0])
    days = [entry.day for entry in clock_times if entry.day is not None]
    if len(days) == len(cells):
        return times + DAY_S * (np.array(days, dtype=float) - days[0])
    period = DAY_S if any(entry.has_hours for entry in clock_times) else HOUR_S
    starts_again = np.diff(times) < -0.5 * period
    return times + period * np.concatenate([[0.0], np.cumsum(starts_again)])


def _clock_time(place: str, line: int, cell: str) -> _ClockTime:
    """Return the time of day in a cell such as 12:00:01, with day and time zone if stated.

    ``place`` is the name of the table, and ``line`` the line of the cell, for the error message.
    """
    match = _CLOCK.fullmatch(cell)
    if match is None:
        raise InputError(
            f"{place}, line {line}: time must be as in 12:00:01.25, got"
            f" {cell[:LONGEST_CELL_SHOWN]!r}. Correct the line."
        )
    hours = int(match["hours"] or 0)
    if match["half_day"]:
        hours = hours % 12
        if match["half_day"] in "pP":
            hours += 12
    seconds = number(match["seconds"].replace(",", "."))
    day = None
    if match["date"]:
        with suppress(ValueError):
            day = date.fromisoformat(match["date"]).toordinal()
    return _ClockTime(
        seconds=HOUR_S * hours + 60.0 * int(match["minutes"]) + seconds,
        has_hours=bool(match["hours"]),
        day=day,
        zone_s=_zone_seconds(match["zone"]),
    )


def _zone_seconds(zone: str | None) -> float | None:
    """Return local time minus UTC [s] for a time zone such as +02:00; None for an empty text."""
    if not zone:
        return None
    if zone == "Z":
        return 0.0
    size = HOUR_S * int(zone[1:3]) + 60.0 * int(zone[-2:])
    return -size if zone[0] == "-" else size


def constant_value(
    place: str,
    test: str,
    name: str,
    lines: Sequence[int],
    cells: Sequence[str],
    decimal: str | None,
) -> str | float | None:
    """Return the value that a column has in all rows of a test; None if its cells are empty.

    Planes and directions are returned as texts, all other values as numbers.

    Parameters
    ----------
    place, test, name
        Names of the table, the test and the column in error messages.
    lines
        Line number of each row in the file.
    cells
        Cell of the column in each row.
    decimal
        Decimal mark; None if no number has one.

    Raises
    ------
    InputError
        If the rows have different values.
    """
    first = cells[0]
    for line, cell in zip(lines, cells, strict=True):
        if cell != first:
            raise InputError(
                f"{place}, line {line}: {name} must be the same in all rows of test {test!r}, got"
                f" {cell[:LONGEST_CELL_SHOWN]!r} after {first[:LONGEST_CELL_SHOWN]!r}."
                " Correct it, or name the test of each row in a column (--test-column)."
            )
    if not first:
        return None
    if name in ("plane", "direction"):
        return first
    return float(numbers_in(place, name, lines[:1], cells[:1], decimal)[0])
