"""Loads in lines between the tables of a sheet, such as ``Load step 2 of 5: 200 N``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.column_roles import count_numbers, has_role, unit_of
from ldbb_bayes.reading.lines_above import statements_in
from ldbb_bayes.reading.names import NamedLoad, load_in_name
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.stacked_tables import first_header
from ldbb_bayes.reading.words import OTHER_QUANTITY, comparable

__all__ = ["with_loads_between"]

# Smallest number of successive rows of numbers that are taken to be a table.
_FEWEST_ROWS = 9
# Regular expression for the words "step" and "load step". A line such as "Load step 2" must not be
# mistaken for a line about a quantity other than the load.
_STEP = re.compile(r"\b(?:load ?)?steps?\b", re.IGNORECASE)
# Text with which a load is written into the lines above a table, such as "Force: 100 N". The keys
# are the two kinds of load.
_STATED = {"force_N": "Force: {value:.10g} N", "pressure_bar": "Pressure: {value:.10g} bar"}


@dataclass
class _RowBlock:
    """Successive rows of numbers, which are treated as a table, and the rows above them."""

    heading: list[Row]  # rows between the numbers of the previous table and those of this table
    # rows of numbers of the table; empty for the rows below the last table of the sheet
    numbers: list[Row]


def with_loads_between(sheet: Sheet) -> Sheet:
    """Return a sheet in which each line of loads stands above the header of its table.

    The first table, and at least one further table, must stand below a line with one load (force or
    pressure), such as ``Load step 2 of 5: 200 N``. In the result, a text such as ``Force: 200 N``
    is added to each such line. If the header is not repeated below the line, the header of the
    first table is added. Any other sheet is returned unchanged.
    """
    header = first_header(sheet.rows)
    if header is None:
        return sheet
    first_header_row = sheet.rows[header]
    blocks = _blocks_of(sheet)
    # for each block of rows, a dict with the loads that the rows above its numbers state; the keys
    # are line numbers
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
    rows: list[Row] = []
    for block, loads_of_block in zip(blocks, loads, strict=True):
        if loads_of_block:
            rows += _heading_with_loads(sheet, block.heading, loads_of_block, header_rows)
        else:
            rows += block.heading
        rows += block.numbers
    return replace(sheet, rows=rows)


def _blocks_of(sheet: Sheet) -> list[_RowBlock]:
    """Return all rows of a sheet in blocks: the rows above each table, and its rows of numbers.

    The rows after the last table form a block without numbers.
    """
    blocks = [_RowBlock([], [])]
    successive: list[Row] = []  # rows of numbers with no row of text between them
    for row in sheet.rows:
        if count_numbers(row.cells) >= 2:
            successive.append(row)
            continue
        _store_numbers(blocks, successive)
        successive = []
        blocks[-1].heading.append(row)
    _store_numbers(blocks, successive)
    return blocks


def _store_numbers(blocks: list[_RowBlock], successive: Sequence[Row]) -> None:
    """Store successive rows of numbers as a table, if there are enough of them for a table.

    A block consists of a table and the rows above it. The rows become the table of the last item in
    ``blocks``, and a new block is begun. If there are too few rows, they are added to the rows
    above the table of the last block. ``successive`` are the rows of numbers.
    """
    if len(successive) < _FEWEST_ROWS:
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
    """Return the rows above a table in a new order: the rows that state loads come first.

    If the rows do not repeat the header of the first table, this header is added at the end.
    ``heading`` are the rows above the table. ``loads`` holds the loads that these rows state; the
    keys are the line numbers. ``header_rows`` are the rows of the header of the first table.
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
    """Return a row with one cell: the text of ``row``, and a statement such as ``Force: 200 N``.

    Nothing is added if the text of ``row`` already states the load in a form that is understood.
    ``load`` is the load that ``row`` states.
    """
    text = sheet.text_of(sheet.cells_as_written(row))
    if load.key in statements_in([(row.line, text)]):
        return Row(row.line, [text])
    return Row(row.line, [f"{text}; {_STATED[load.key].format(value=load.value)}"])
