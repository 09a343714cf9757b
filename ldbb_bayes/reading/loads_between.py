"""Loads in lines between the tables of a sheet, such as ``Load step 2 of 5: 200 N``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ldbb_bayes.campaign.circular_test import FEWEST_READINGS
from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.lines_above import statements_in
from ldbb_bayes.reading.names import NamedLoad, load_in_name
from ldbb_bayes.reading.role_words import has_role
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.stacked_tables import first_header, is_row_of_numbers
from ldbb_bayes.reading.words import OTHER_QUANTITY, comparable

__all__ = ["with_loads_between"]

# Regular expression for the words "step" and "load step". These words are removed before a line is
# searched for quantities other than the load.
_STEP = re.compile(r"\b(?:load ?)?steps?\b", re.IGNORECASE)
# Format strings for a text, such as "Force: 100 N", that states the load of a table. The text is
# appended to a line above the table. The keys of the dict are the two kinds of load.
_STATED = {"force_N": "Force: {value:.10g} N", "pressure_bar": "Pressure: {value:.10g} bar"}


@dataclass
class _RowBlock:
    """Table in a sheet (successive rows of numbers), together with the rows above it."""

    heading: list[Row]  # rows between the numbers of the previous table and those of this table
    # rows of numbers of the table; empty if no table follows the rows in ``heading``
    numbers: list[Row]


def with_loads_between(sheet: Sheet) -> Sheet:
    """Return a sheet in which each table below a line with a load has a header.

    A load is a force or pressure. An example of a line with a load is ``Load step 2 of 5: 200 N``.
    A text that later code can read, such as ``Force: 200 N``, is appended to each of these lines.
    If the table below such a line has no header, the header of the first table is inserted. The
    sheet is changed only if a line with a load stands above the first table, and another such line
    above at least one other table.
    """
    header = first_header(sheet.rows)
    if header is None:
        return sheet
    first_header_row = sheet.rows[header]
    blocks = _blocks_of(sheet, len(first_header_row.cells))
    # for each table, a dict with the loads that the rows above it state; the keys are line numbers
    loads = []
    for block in blocks:
        loads.append(_loads_by_line(sheet, block.heading) if block.numbers else {})
    n_with_load = sum(bool(loads_of_block) for loads_of_block in loads)
    if n_with_load < 2 or not loads[0] or first_header_row not in blocks[0].heading:
        return sheet
    first_heading = blocks[0].heading
    header_rows = []
    for row in first_heading[first_heading.index(first_header_row) :]:
        if row.line not in loads[0]:
            header_rows.append(row)
    if not header_rows:  # nothing names the columns
        return sheet
    rows: list[Row] = []
    for block, loads_of_block in zip(blocks, loads, strict=True):
        if loads_of_block:
            rows += _heading_with_loads(sheet, block.heading, loads_of_block, header_rows)
        else:
            rows += block.heading
        rows += block.numbers
    return replace(sheet, rows=rows)


def _blocks_of(sheet: Sheet, width: int) -> list[_RowBlock]:
    """Divide the rows of a sheet into blocks, each with one table and the rows above it.

    The last block holds the rows below the last table and has no table. ``width`` is the number of
    cells of the header of the first table.
    """
    blocks = [_RowBlock([], [])]
    successive: list[Row] = []  # rows of numbers with no row of text between them
    for row in sheet.rows:
        if is_row_of_numbers(row.cells, width):
            successive.append(row)
            continue
        _store_numbers(blocks, successive)
        successive = []
        blocks[-1].heading.append(row)
    _store_numbers(blocks, successive)
    return blocks


def _store_numbers(blocks: list[_RowBlock], successive: Sequence[Row]) -> None:
    """Store successive rows of numbers as a table, if there are enough of them.

    A sheet is divided into blocks; each block consists of a table and the rows above it. The last
    block in ``blocks`` has no table yet. If ``successive`` holds enough rows for a table, these
    rows become the table of the last block, and a new, empty block is appended. Otherwise, they are
    added to the rows above the table of the last block.
    """
    if len(successive) < FEWEST_READINGS:
        blocks[-1].heading += successive
        return
    blocks[-1].numbers += successive
    blocks.append(_RowBlock([], []))


def _loads_by_line(sheet: Sheet, rows: Sequence[Row]) -> dict[int, NamedLoad]:
    """Return a dict with the loads of rows that state exactly one load; the keys are line numbers.

    Rows that name a column of angles or times, or another quantity such as a preload, are left out.
    """
    loads = {}
    for row in rows:
        names = [unit_of(cell).name for cell in row.cells]
        if any(has_role(name, "angle") or has_role(name, "time") for name in names):
            continue
        text = " ".join(cell for cell in sheet.cells_as_written(row) if cell)
        load = load_in_name([text])
        if load is not None and not OTHER_QUANTITY.search(_STEP.sub("", text)):
            loads[row.line] = load
    return loads


def _heading_with_loads(
    sheet: Sheet,
    heading: Sequence[Row],
    loads: dict[int, NamedLoad],
    header_rows: Sequence[Row],
) -> list[Row]:
    """Return the rows above a table, sorted so that the rows that state loads come first.

    Every table needs a header. If the rows above the table do not repeat the header of the first
    table, this header is added below them. ``heading`` are the rows above the table. ``loads`` is a
    dict with the loads that these rows state; the keys are their line numbers. ``header_rows`` are
    the rows of the header of the first table.
    """
    rows = []
    for row in heading:
        if row.line in loads:
            rows.append(_with_load_in_words(sheet, row, loads[row.line]))
    other_rows = [row for row in heading if row.line not in loads]
    wanted = [comparable(cell) for cell in header_rows[0].cells]
    if not any([comparable(cell) for cell in row.cells] == wanted for row in other_rows):
        other_rows += [Row(rows[-1].line, row.cells) for row in header_rows]
    return [*rows, *other_rows]


def _with_load_in_words(sheet: Sheet, row: Row, load: NamedLoad) -> Row:
    """Return a row with its cells joined into one, and its load appended, as in ``Force: 200 N``.

    ``load`` is the load of the row. It is not appended if the row already states the load in a form
    that this package reads in lines above a table.
    """
    text = sheet.text_of(sheet.cells_as_written(row))
    if load.key in statements_in([(row.line, text)]):
        return Row(row.line, [text])
    return Row(row.line, [f"{text}; {_STATED[load.key].format(value=load.value)}"])
