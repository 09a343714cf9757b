"""Where the table begins in a sheet, and its header: found out, or as the layout says."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from ldbb_bayes.errors import InputError
from ldbb_bayes.tables.columns import called, columns_of, label_of, unit_of, unit_of_a_reading
from ldbb_bayes.tables.layout import ROLES, Layout
from ldbb_bayes.tables.numerals import is_missing, looks_like_number
from ldbb_bayes.tables.preamble import load_in_name
from ldbb_bayes.tables.sheet import Sheet
from ldbb_bayes.tables.units import plain, unit_named

__all__ = ["Heading", "NoTableError", "find_heading"]

_BLOCK = 9
# Lines above a table: beyond these it is none.
LARGEST_ABOVE = 1000
_RULE = re.compile(r"[-=+_|: ]*")


class NoTableError(InputError):
    """A sheet of words alone."""


@dataclass(frozen=True, eq=False)
class Heading:
    """The columns of one sheet.

    Attributes
    ----------
    line : int
        Of the header in the file; 0 where there is none.
    first : int
        Index into the sheet's rows of the first row of numbers.
    headers, units : list of str
        As the file has them; the unit each names, or empty.
    roles : dict of role to column, from 0
    above : list of (line, text)
        Lines above the header.
    readings : list of column
        Where each column of readings is a test of its own, all of them; else the one, or none.
    label : str
        Of one of several such tests.
    """

    line: int
    first: int
    headers: list[str]
    units: list[str]
    roles: dict[str, int]
    above: list[tuple[int, str]] = field(default_factory=list)
    readings: list[int] = field(default_factory=list)
    label: str = ""

    def each(self) -> Iterator[Heading]:
        """One heading for each column of readings, with its name as label where there are several."""
        if len(self.readings) < 2:
            yield self
            return
        for column in self.readings:
            label = label_of(self.headers[column]) or f"column {column + 1}"
            yield replace(self, roles=self.roles | {"reading": column}, readings=[column], label=label)


def find_heading(sheet: Sheet, layout: Layout) -> Heading:
    """Find the table in a sheet.

    It begins below its header, whatever its first rows hold: a bad row is for the reader of rows to refuse.

    Raises
    ------
    InputError
        When there is none, or its columns cannot be told apart.
    """
    rows = sheet.rows
    block = _block(sheet, layout)
    k = _header_row(sheet, layout, block)
    if k is None:
        first, line, width = _upwards(sheet, block), 0, len(rows[block][1])
        headers = units = [""] * width
    else:
        line, width = rows[k][0], len(rows[block][1])
        headers = _headers(sheet, rows[k], width, block)
        below = rows[k + 1][1] if k + 1 < block else []
        units = _in_degrees(_units_alone(below), headers) or [unit_of(header)[1] for header in headers]
        units = [*units, *[""] * width][:width]
        first = k + 1 + bool(_units_alone(below))
        while first < block and all(_RULE.fullmatch(cell) for cell in rows[first][1]):
            first += 1
    before = rows[max(first - LARGEST_ABOVE, 0) : first if k is None else k]
    between = sheet.separator or ";"
    above = [(number, between.join(cells)) for number, cells in before]
    roles, readings = columns_of(f"{sheet.place}, line {line}" if line else sheet.place, layout, headers)
    for k in readings:
        if units[k] == unit_of(headers[k])[1]:
            units[k] = unit_of_a_reading(headers[k])
    return Heading(line, first, list(headers), list(units), roles, above, readings)


def _block(sheet: Sheet, layout: Layout) -> int:
    """The first of nine rows of numbers, cell for cell alike; of the first below the header line that was given."""
    rows = sheet.rows
    if layout.header_line and all(number != layout.header_line for number, _ in rows):
        raise InputError(
            f"{sheet.place}: header line must hold names, got nothing in line {layout.header_line}. Correct --header-line."
        )
    start = next((k for k, (number, _) in enumerate(rows) if number > (layout.header_line or 0)), len(rows))
    numbers = [_numbers(cells) for _, cells in rows]
    for k in range(start, min(len(rows), start + LARGEST_ABOVE)):
        block = range(k, min(k + _BLOCK, len(rows)))
        if len(block) < 2:
            break
        if all(numbers[j] >= 2 and len(rows[j][1]) == len(rows[k][1]) for j in block):
            return k
    raise NoTableError(
        f"{sheet.place} must hold a table of at least {_BLOCK} rows with two columns of numbers, got none. "
        f"{_example(sheet)}Check the separator (--separator), the encoding (--encoding) and what the file is; "
        "units belong into the header, not into cells."
    )


def _example(sheet: Sheet) -> str:
    """A row in the middle, for the message."""
    if not sheet.rows:
        return ""
    number, cells = sheet.rows[len(sheet.rows) // 2]
    return f"Line {number} reads {', '.join(repr(cell[:30]) for cell in cells[:6])}. "


def _upwards(sheet: Sheet, block: int) -> int:
    """Of a table without a header: up from good rows while there are as many cells, some of them numbers."""
    rows, k = sheet.rows, block
    while k and len(rows[k - 1][1]) == len(rows[block][1]) and _numbers(rows[k - 1][1]):
        k -= 1
    left = next((number for number, cells in reversed(rows[:k]) if _numbers(cells) >= 2), None)
    if k and (left is not None or _numbers(rows[k - 1][1])):
        raise InputError(
            f"{sheet.place}, line {rows[k - 1][0]}: rows of a table without a header must be alike, got "
            f"{', '.join(map(repr, rows[k - 1][1]))[:60]}. Correct or remove the line, or give --header-line."
        )
    return k


def _numbers(cells: Sequence[str]) -> int:
    return sum(looks_like_number(cell) for cell in cells)


def _header_row(sheet: Sheet, layout: Layout, block: int) -> int | None:
    """Index of the row of names: as given, or the last row of words above the numbers."""
    rows = sheet.rows
    if layout.header_line == 0:
        return None
    if layout.header_line:
        k = next(k for k, (number, _) in enumerate(rows) if number == layout.header_line)
        if _numbers(rows[k][1]) >= 2 and not _names_columns(rows[k][1]):
            raise InputError(
                f"{sheet.place}, line {layout.header_line}: the header must hold names, got numbers. "
                "Correct --header-line; 0: none."
            )
        return _above_all_numbers(sheet, k, block)
    wordy = [k for k, (_, cells) in enumerate(rows[:block]) if _names_columns(cells)]
    if not wordy:
        return None
    k = wordy[-2] if _units_alone(rows[wordy[-1]][1]) and len(wordy) > 1 else wordy[-1]
    return _above_all_numbers(sheet, k, block)


def _above_all_numbers(sheet: Sheet, k: int, block: int) -> int:
    """The row of the header, which may not stand amid the numbers."""
    rows = sheet.rows
    above = next((j for j in range(k) if _numbers(rows[j][1]) >= 2 and len(rows[j][1]) == len(rows[block][1])), None)
    if above is not None:
        raise InputError(
            f"{sheet.place}, line {rows[k][0]}: the header must stand above all numbers, got numbers in line {rows[above][0]}. "
            "Remove the line, or correct --header-line."
        )
    return k


def _names_columns(cells: Sequence[str]) -> bool:
    """Two words or more, and no number, unless two of the words name what every table has."""
    words = [cell for cell in cells if cell and not (looks_like_number(cell) or is_missing(cell) or _RULE.fullmatch(cell))]
    roles = {role for cell in words for role in ("angle", "reading", "time") if called(unit_of(cell)[0], ROLES[role])}
    return len(words) >= 2 and (_numbers(cells) == 0 or len(roles) >= 2)


def _headers(sheet: Sheet, row: tuple[int, list[str]], width: int, block: int) -> list[str]:
    """One name for every column; where blanks separate, a unit in brackets belongs to the word before it."""
    number, cells = row
    names = list(cells)
    if names and names[0] == "#":
        names = names[1:]
    if sheet.separator == " ":
        names = re.sub(r"\0(?=[\[({<])", " ", "\0".join(names)).split("\0")
    while len(names) > width and not names[-1]:
        names.pop()
    missing = len(names) < width and any(sheet.rows[block][1][len(names) :])
    if len(names) > width or missing:
        raise InputError(
            f"{sheet.place}, line {number}: the header must name every column, got {len(names)} names for {width} cells. "
            "Correct it; with decimal commas separate the cells by semicolons; --header-line where it is another, 0 for none."
        )
    return [*names, *[""] * width][:width]


def _units_alone(cells: Sequence[str]) -> list[str]:
    """The units in a row that holds nothing else, all known or in brackets; empty where it holds names."""
    inside = [cell.strip("[](){} ") for cell in cells]
    known = [unit_named(text) for text in inside]
    bracketed = [bool(re.fullmatch(r"[\[({].*[\])}]", cell)) for cell in cells]
    filled = [k for k, cell in enumerate(cells) if cell]
    if any(load_in_name([cell]) is not None for cell in cells):
        return []
    sure = [k for k in filled if known[k] or bracketed[k]]
    others = [cells[k] for k in filled if k not in sure]
    if not any(known) or len(sure) < min(len(filled), 2 - ("grad" in map(plain, others))) or any(len(own) > 4 for own in others):
        return []
    return [known[k] or inside[k] for k in range(len(cells))]


def _in_degrees(units: Sequence[str], headers: Sequence[str]) -> list[str]:
    """German for degrees, below an angle."""
    return ["deg" if plain(unit) == "grad" and plain(headers[k]).startswith("winkel") else unit for k, unit in enumerate(units)]
