"""Cells into numbers, whatever the decimal mark and the marks between thousands."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError

__all__ = [
    "Unusable",
    "constant",
    "could_be_thousands",
    "decimal_mark",
    "is_clock",
    "is_missing",
    "looks_like_number",
    "numbers_of",
    "seconds_of",
]

Array = NDArray[np.float64]
_MINUS = str.maketrans("−–", "--")
_BLANKS = re.compile(r"[ '\u00a0\u202f\u2009]")
LONGEST = 60
_EXPONENT = r"(?:[eEdD][+\-−–]?\d+)?"
_NUMBER = re.compile(
    rf"[+\-−–]?(?:\d{{1,3}}(?:[ '\u00a0\u202f\u2009]\d{{3}})+(?:[.,]\d+)?|\d[\d.,]*{_EXPONENT}|[.,]\d+{_EXPONENT})"
)
# 12:00:01.250, 00:01,25 (minutes, seconds), 2026-03-04T12:00:01Z, 12:00:01 PM.
_DATE = r"(?:\d{4}-\d\d-\d\d|\d{1,2}[./]\d{1,2}[./]\d{4})[T ]"
_ZONE = r"Z|[+-]\d\d:\d\d|\s?([AaPp])\.?[Mm]\.?"
_CLOCK = re.compile(rf"(?:{_DATE})?(?:(\d{{1,2}}):)?(\d{{1,2}}):(\d{{1,2}}(?:[.,]\d{{1,9}})?)(?:{_ZONE})?")
_DAY_S = 86_400.0
_MISSING = ("-", "--", "---", "nan", "n/a", "na", "#n/a", "#div/0!", "#value!", "#ref!", "null", "none")
_GROUPED_BY_BLANKS = re.compile(r"[+\-]?\d{1,3}(?:[ '\u00a0\u202f\u2009]\d{3})+")
_GROUPED = {mark: re.compile(rf"[+\-]?\d{{1,3}}(?:\{mark}\d{{3}})+") for mark in ",."}


def decimal_mark(place: str, cells: Iterable[tuple[int, str]]) -> str | None:
    """The decimal mark of a table; None where no cell has one.

    Of a comma and a point in one cell the last is the decimal mark. Cells of commas alone beside cells of points alone
    contradict each other, unless those of one kind can only be thousands of the other.

    Parameters
    ----------
    place : str
        For the message.
    cells : iterable of (line, cell)

    Raises
    ------
    InputError
        Naming the line where the mark changes.
    """
    found: str | None = None
    alone: dict[str, tuple[int, str]] = {}
    for line, cell in cells:
        comma, point = cell.rfind(","), cell.rfind(".")
        if comma < 0 and point < 0:
            continue
        if comma >= 0 and point >= 0:
            mark = "," if comma > point else "."
            if found not in (None, mark):
                raise _changes(place, line, cell)
            found = mark
        else:
            alone.setdefault("," if comma >= 0 else ".", (line, cell))
    if found is None and len(alone) == 2:
        raise _changes(place, *max(alone.values()))
    if found is None:
        return next(iter(alone), None)
    other = "." if found == "," else ","
    if other in alone and not _GROUPED[other].fullmatch(alone[other][1]):
        raise _changes(place, *alone[other])
    return found


def _changes(place: str, line: int, cell: str) -> InputError:
    return InputError(
        f"{place}, line {line}: the decimal mark must be the same in all rows, got {cell[:LONGEST]!r}. "
        "Correct it, or give --decimal."
    )


def could_be_thousands(cell: str) -> bool:
    """Whether the mark in a cell may stand between thousands: ``12,310`` may, ``0,310`` and ``12,31`` may not."""
    return re.fullmatch(r"[+\-−–]?[1-9]\d{0,2}[.,]\d{3}", cell) is not None


def numbers_of(place: str, what: str, lines: Sequence[int], cells: Sequence[str], decimal: str | None) -> Array:
    """One column of numbers.

    Raises
    ------
    InputError
        Naming the line of the first cell that is no finite number.
    """
    try:
        values = np.array([_number(cell, decimal or ".") for cell in cells])
    except ValueError:
        values = np.array([_or_nan(cell, decimal or ".") for cell in cells])
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        k = int(bad[0])
        own = cells[k]
        if isinstance(own, Unusable):
            raise InputError(own.why)
        cure = "Give --decimal" if re.fullmatch(r"[+\-−–]?\d+[.,]\d+", own) else "Correct or remove the line"
        raise InputError(f"{place}, line {lines[k]}: {what} must be a finite number, got {own[:LONGEST]!r}. {cure}.")
    return values


class Unusable(str):
    """A cell that holds no value of its own (a formula, an error, a date): what to say if it is used."""

    __slots__ = ("why",)
    why: str

    @classmethod
    def because(cls, text: str, why: str) -> Unusable:
        """The cell as text, and the message."""
        cell = cls(text)
        cell.why = why
        return cell


def looks_like_number(cell: str) -> bool:
    """Whether a cell is a number, whatever its decimal mark, or a time of day."""
    return _NUMBER.fullmatch(cell) is not None or is_clock(cell)


def is_missing(cell: str) -> bool:
    """Whether a cell stands for a number that is not there: such rows belong to the table, and are refused by name."""
    return cell.casefold() in _MISSING or isinstance(cell, Unusable)


def is_clock(cell: str) -> bool:
    """Whether a cell is a time of day, or minutes and seconds."""
    return ":" in cell and _CLOCK.fullmatch(cell) is not None


def seconds_of(place: str, lines: Sequence[int], cells: Sequence[str]) -> Array:
    """Times of day as seconds that go on over midnight (minutes and seconds: over the hour); a date is left out.

    Raises
    ------
    InputError
        Naming the line of the first cell that is no time.
    """
    found = []
    for line, cell in zip(lines, cells, strict=True):
        match = _CLOCK.fullmatch(cell)
        if match is None:
            raise InputError(f"{place}, line {line}: time must be as in 12:00:01.25, got {cell[:LONGEST]!r}. Correct the line.")
        hours, minutes, seconds = int(match[1] or 0), int(match[2]), float(match[3].replace(",", "."))
        if match[4]:
            hours = hours % 12 + 12 * (match[4] in "pP")
        found.append(3600.0 * hours + 60.0 * minutes + seconds)
    times = np.array(found)
    round_s = _DAY_S if any(match[1] for cell in cells if (match := _CLOCK.fullmatch(cell))) else 3600.0
    return times + round_s * np.concatenate([[0.0], np.cumsum(np.diff(times) < -0.5 * round_s)])


def constant(
    place: str, test: str, name: str, lines: Sequence[int], cells: Sequence[str], decimal: str | None
) -> str | float | None:
    """The one value that a column holds in all rows of a test; None where it is empty.

    Raises
    ------
    InputError
        Naming the line where it changes.
    """
    other = next((k for k, cell in enumerate(cells) if cell != cells[0]), None)
    if other is not None:
        raise InputError(
            f"{place}, line {lines[other]}: {name} must be the same in all rows of test {test!r}, "
            f"got {cells[other][:LONGEST]!r} after {cells[0][:LONGEST]!r}. Correct it."
        )
    if not cells[0]:
        return None
    return cells[0] if name == "plane" else float(numbers_of(place, name, lines[:1], cells[:1], decimal)[0])


def _number(cell: str, decimal: str) -> float:
    """Of one cell; marks between thousands must be the other of comma and point, or blanks, or an apostrophe."""
    if "_" in cell:
        raise ValueError(cell)
    if decimal == ".":
        try:
            return float(cell)
        except ValueError:
            pass
    text = cell.strip().translate(_MINUS)
    if _BLANKS.search(text):
        if not _GROUPED_BY_BLANKS.fullmatch(text.partition(decimal)[0]):
            raise ValueError(cell)
        text = _BLANKS.sub("", text)
    other = "," if decimal == "." else "."
    if other in text:
        if not _GROUPED[other].fullmatch(text.partition(decimal)[0]):
            raise ValueError(cell)
        text = text.replace(other, "")
    return float(text.replace(decimal, ".").replace("D", "E").replace("d", "e"))


def _or_nan(cell: str, decimal: str) -> float:
    try:
        return _number(cell, decimal)
    except ValueError:
        return float("nan")
