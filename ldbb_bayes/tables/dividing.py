"""The tests of one sheet: its rows and columns of readings divided, with what is said of each."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ldbb_bayes.campaign.table import PER_TEST
from ldbb_bayes.errors import InputError
from ldbb_bayes.tables.assumptions import Notes
from ldbb_bayes.tables.heading import Heading
from ldbb_bayes.tables.layout import Layout
from ldbb_bayes.tables.numerals import (
    Unusable,
    constant,
    could_be_thousands,
    decimal_mark,
    is_clock,
    is_missing,
    looks_like_number,
    numbers_of,
    seconds_of,
)
from ldbb_bayes.tables.preamble import said_above
from ldbb_bayes.tables.sheet import Sheet
from ldbb_bayes.tables.tabled import TabledTest
from ldbb_bayes.tables.units import UNITS

__all__ = ["tests_in"]

_WORDS = ("test", "direction")
_LONGEST_LIST = 200


def tests_in(
    sheet: Sheet, heading: Heading, layout: Layout, campaign: Mapping[str, Any], notes: Notes
) -> Iterator[tuple[TabledTest, set[str]]]:
    """The tests of one sheet, in the order of their first rows, and the entries of the layout that speak of them."""
    lines, columns = _columns(sheet, heading)
    _note_reading(sheet, heading, layout, notes)
    numeric = {role: column for role, column in heading.roles.items() if role not in (*_WORDS, "reading")}
    clock = numeric.pop("time") if "time" in numeric and is_clock(columns[numeric["time"]][0]) else None
    decimal = _decimal(sheet, lines, [columns[c] for c in (*numeric.values(), *heading.readings)], layout, notes)
    numbers = {role: numbers_of(sheet.place, role, lines, columns[column], decimal) for role, column in numeric.items()}
    if clock is not None and layout.time_unit not in (None, "s"):
        raise InputError(f"{sheet.place}: times of day have no unit, got {layout.time_unit!r}. Leave --time-unit out.")
    if clock is not None:
        numbers["time"] = seconds_of(sheet.place, lines, columns[clock])
        heading.units[clock] = "s"
    per_test = _per_test(sheet, heading, columns, notes)
    above = said_above(heading.above)
    for own in heading.each():
        for c in own.readings:
            numbers["reading"] = numbers_of(sheet.place, "reading", lines, columns[c], decimal)
        for label, mine in _rows_of_tests(sheet, own, lines, columns):
            rows = np.array(mine)
            blocks = 1 + int(np.count_nonzero(np.diff(rows) > 1))
            if blocks > 1:
                notes.add(
                    f"{sheet.place}, test {label!r}", "rows", f"{blocks} blocks joined", "others stand between", "--test-column"
                )
            words = {columns[own.roles["direction"]][k]: lines[k] for k in reversed(mine)} if "direction" in own.roles else {}
            stated, entries = layout.of(
                *(name for name in (label, sheet.own_name, sheet.path.name, sheet.path.stem, str(sheet.path), sheet.name) if name)
            )
            fields = {
                name: constant(sheet.place, label, name, [lines[k] for k in mine], [columns[c][k] for k in mine], decimal)
                for name, c in per_test.items()
            }
            several = len(rows) < len(lines) or len(heading.readings) > 1 or bool(sheet.own_name)
            for_file = [own for own in layout.test if own.file in entries - {label, sheet.own_name}]
            if several and any(entry.force_N or entry.pressure_bar for entry in for_file):
                raise InputError(
                    f"{sheet.place}: a force or pressure given for the file must be of one test, got several in it. "
                    "Give --forces-N with one for each, a [[test]] for each in --layout, or a column."
                )
            part = {role: values[rows] for role, values in numbers.items()}
            yield (
                TabledTest(
                    sheet, own, label, [lines[k] for k in mine], part, words, above, layout, stated, campaign, notes, fields
                ),
                entries,
            )


def _per_test(sheet: Sheet, heading: Heading, columns: Sequence[Sequence[str]], notes: Notes) -> dict[str, int]:
    """Columns that hold one value for each test; times and temperatures of every reading are left out, and told."""
    found = {header: c for c, header in enumerate(heading.headers) if header in PER_TEST and c not in heading.roles.values()}
    labels = columns[heading.roles["test"]] if "test" in heading.roles else [""] * len(columns[0])
    for header in sorted(set(found) & {"time_s", "temperature_C"}):
        if len(set(zip(labels, columns[found[header]], strict=True))) > len(set(labels)):
            notes.add(sheet.place, "columns not used", header, "it changes within a test", "a [[test]] in --layout")
            del found[header]
    return found


def _decimal(sheet: Sheet, lines: Sequence[int], columns: Sequence[Sequence[str]], layout: Layout, notes: Notes) -> str | None:
    """The decimal mark, as given or found out; told where it may be another."""
    cells = [(line, column[k]) for k, line in enumerate(lines) for column in columns if not isinstance(column[k], Unusable)]
    decimal = layout.decimal or decimal_mark(sheet.place, cells)
    if layout.decimal is not None:
        other = "," if decimal == "." else "."
        if any(other in cell for _, cell in cells) and not any(layout.decimal in cell for _, cell in cells):
            notes.add(sheet.place, "decimal mark", f"{decimal}, as given", f"cells have {other!r} alone: thousands", "--decimal")
        return decimal
    marked = [cell for _, cell in cells if decimal and decimal in cell]
    if marked and all(could_be_thousands(cell) for cell in marked):
        notes.add(sheet.place, "decimal mark", str(decimal), "thousands are as likely: three digits behind each", "--decimal")
    elif decimal == ",":
        notes.add(sheet.place, "decimal mark", ",", "no cell has a point", "--decimal")
    if decimal:
        notes.keep(decimal=decimal)
    return decimal


def _rows_of_tests(
    sheet: Sheet, heading: Heading, lines: Sequence[int], columns: Sequence[Sequence[str]]
) -> Iterator[tuple[str, list[int]]]:
    """Labels and rows of the tests in a table, in the order of their first rows."""
    if "test" not in heading.roles:
        yield heading.label, list(range(len(lines)))
        return
    labels = columns[heading.roles["test"]]
    unusable = next((label for label in labels if isinstance(label, Unusable)), None)
    if unusable is not None:
        raise InputError(unusable.why)
    blank = next((line for line, label in zip(lines, labels, strict=True) if not label), None)
    if blank is not None:
        raise InputError(f"{sheet.place}, line {blank}: rows must name their test, got none. Complete or remove the line.")
    places: dict[str, list[int]] = {}
    for k, label in enumerate(labels):
        places.setdefault(label, []).append(k)
    yield from places.items()


def _columns(sheet: Sheet, heading: Heading) -> tuple[list[int], list[list[str]]]:
    """Lines and columns of the table; what is no row of numbers may only stand below it."""
    width = len(heading.headers)
    rows = sheet.rows[heading.first :]
    end = len(rows)
    while end and not any(looks_like_number(cell) or is_missing(cell) for cell in rows[end - 1][1]):
        end -= 1
    for number, cells in rows[:end]:
        if len(cells) < width or any(cells[width:]):
            raise InputError(
                f"{sheet.place}, line {number}: rows must have {width} cells, got {len(cells)}. Complete or remove the line; "
                "with decimal commas separate the cells by semicolons."
            )
    return [number for number, _ in rows[:end]], [
        list(column) for column in zip(*(cells[:width] for _, cells in rows[:end]), strict=True)
    ]


def _note_reading(sheet: Sheet, heading: Heading, layout: Layout, notes: Notes) -> None:
    """How the file itself was read."""
    if sheet.hidden:
        notes.add(sheet.place, "hidden", f"{sheet.hidden}, read like the others", "the spreadsheet hides it", "--sheets")
    if sheet.encoding and layout.encoding is None:
        notes.keep(encoding=sheet.encoding)
        if sheet.encoding != "utf-8":
            notes.add(sheet.place, "encoding", sheet.encoding, "its bytes", "--encoding")
    if sheet.separator and layout.separator is None:
        notes.keep(separator=sheet.separator)
        if sheet.separator != ",":
            notes.add(sheet.place, "separator", repr(sheet.separator), "most lines split alike", "--separator")
    words = next((number for number, text in reversed(heading.above) if len(re.findall(r"[^\W\d_]{2,}", text)) > 1), None)
    if layout.header_line == 0 and words is not None:
        notes.add(sheet.place, "header", "none, as given", f"line {words} holds words", "--header-line")
    if layout.header_line is None:
        notes.keep(header_line=heading.line)
        if heading.line > 1:
            notes.add(sheet.place, "header", f"line {heading.line}", "numbers begin below it", "--header-line")
    found: dict[str, Any] = {
        role: heading.headers[column] or column + 1 for role, column in heading.roles.items() if role not in layout.columns
    }
    if len(heading.readings) > 1 and "reading" not in layout.columns:
        found["reading"] = [heading.headers[column] for column in heading.readings]
    if found:
        notes.keep(columns=dict(layout.columns) | found)
        options = ", ".join(f"--{role}-column" for role in found)
        shown = ", ".join(f"{role} = {column!r}" for role, column in found.items())[:_LONGEST_LIST]
        notes.add(sheet.place, "columns", shown, "their names" if heading.line else "no header: the first two", options)
    unused_units = [role for role in UNITS if getattr(layout, f"{role}_unit") and role not in heading.roles]
    if unused_units:
        options = ", ".join("--unit" if role == "reading" else f"--{role}-unit" for role in unused_units)
        notes.add(sheet.place, "not used", options, "there is no such column", "--…-column")
    if layout.separator and not sheet.separator:
        notes.add(sheet.place, "not used", "--separator", "a workbook has none", "")
    used = {*heading.roles.values(), *heading.readings, *(c for c, header in enumerate(heading.headers) if header in PER_TEST)}
    unused = [header for c, header in enumerate(heading.headers) if header and c not in used]
    if unused:
        names = ", ".join(unused)[:_LONGEST_LIST]
        notes.add(sheet.place, "columns not used", names, "no role is known for them", "--…-column, or a [[test]] in --layout")
