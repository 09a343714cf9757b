"""Loads in lines between tables below each other, such as ``Load step 2 of 5: 200 N``."""

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

# Fewest successive rows of numbers that are a table.
_FEWEST_ROWS = 9
# Regular expression for the word for a step in the name of a step, which is no other quantity.
_STEP = re.compile(r"\b(?:load ?)?steps?\b", re.IGNORECASE)
# Words with which the load of a line is stated.
_STATED = {"force_N": "Force: {value:.10g} N", "pressure_bar": "Pressure: {value:.10g} bar"}


@dataclass
class _Block:
    """Rows of numbers below each other, and all rows between them and the rows of numbers above."""

    heading: list[Row]  # rows above the numbers, from the end of the block above
    numbers: list[Row]  # rows of numbers


def with_loads_between(sheet: Sheet) -> Sheet:
    """Return a sheet in which the lines of loads between its tables are understood.

    The first table, and at least one further table, must stand below a line with one load (force or
    pressure), such as ``Load step 2 of 5: 200 N``. In the result, such a line stands above the
    header of its table, and states the load in words. If the header is not repeated below such a
    line, the header of the first table is added. Any other sheet is returned unchanged.
    """
    header = first_header(sheet.rows)
    if header is None:
        return sheet
    names = sheet.rows[header]
    blocks = _blocks_of(sheet)
    loads = []
    for block in blocks:
        loads.append(_loads_in(sheet, block.heading) if block.numbers else {})
    n_with_load = sum(bool(loads_of_block) for loads_of_block in loads)
    if n_with_load < 2 or not loads[0] or names not in blocks[0].heading:
        return sheet
    first_heading = blocks[0].heading
    header_rows = []
    for row in first_heading[first_heading.index(names) :]:
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


def _blocks_of(sheet: Sheet) -> list[_Block]:
    """Return the blocks of numbers of a sheet. The rows behind the last block form a block, too."""
    blocks = [_Block([], [])]
    run: list[Row] = []
    for row in sheet.rows:
        if count_numbers(row.cells) >= 2:
            run.append(row)
            continue
        _close_run(blocks, run)
        run = []
        blocks[-1].heading.append(row)
    _close_run(blocks, run)
    return blocks


def _close_run(blocks: list[_Block], run: Sequence[Row]) -> None:
    """Add successive rows of numbers to the last block, and begin a block if they are a table.

    Fewer rows than those of a table belong to the heading of the last block.
    """
    if len(run) < _FEWEST_ROWS:
        blocks[-1].heading += run
        return
    blocks[-1].numbers += run
    blocks.append(_Block([], []))


def _loads_in(sheet: Sheet, rows: Sequence[Row]) -> dict[int, NamedLoad]:
    """Return the load that each row states which has exactly one load; the keys are the lines.

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
    """Return the heading of a table with its lines of loads first and its header last.

    ``heading`` are the rows above the table, ``loads`` the loads that they state, with their lines
    as keys, and ``header_rows`` the rows of the header of the first table.
    """
    rows = []
    for row in heading:
        if row.line in loads:
            rows.append(_with_load_in_words(sheet, row, loads[row.line]))
    others = [row for row in heading if row.line not in loads]
    wanted = [comparable(cell) for cell in header_rows[0].cells]
    if not any([comparable(cell) for cell in row.cells] == wanted for row in others):
        others += [Row(rows[-1].line, row.cells) for row in header_rows]
    return [*rows, *others]


def _with_load_in_words(sheet: Sheet, row: Row, load: NamedLoad) -> Row:
    """Return a row of one cell with the text of a row, which states its load in words.

    A row that states its load in words already is returned with its text unchanged.
    """
    text = sheet.text_of(sheet.cells_as_written(row))
    if load.key in statements_in([(row.line, text)]):
        return Row(row.line, [text])
    return Row(row.line, [f"{text}; {_STATED[load.key].format(value=load.value)}"])
