"""Names of runs that stand in the row above the header.

For example, ``Run 1`` and ``Run 2`` stand above two columns that are both headed ``Deviation``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.column_roles import names_runs
from ldbb_bayes.reading.header_rows import count_numbers
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.merged_cells import with_merged_cells_filled
from ldbb_bayes.reading.overview import LONGEST_OVERVIEW
from ldbb_bayes.reading.role_words import has_role
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.words import unit_named

__all__ = ["with_runs_in_header"]

# The first numbers of a table stand at most this number of rows below its header, because a row of
# units may lie between them.
_ROWS_TO_NUMBERS = 2


def with_runs_in_header(sheet: Sheet) -> Sheet:
    """Return a sheet in which the names of runs above the header have been added to the header.

    The header ``Deviation [um]`` below the cell ``Run 1`` is changed to ``Deviation Run 1 [um]``. A
    text in merged cells applies to all columns below. If the first cell of the header is empty or
    only a unit, the name above it is put there. A sheet without names of runs above the header is
    returned unchanged.
    """
    rows = sheet.rows
    for k in range(min(len(rows) - 2, LONGEST_OVERVIEW)):
        if count_numbers(rows[k].cells) or count_numbers(rows[k + 1].cells):
            continue
        below = rows[k + 2 : k + 2 + _ROWS_TO_NUMBERS]
        if any(count_numbers(row.cells) >= 2 for row in below):
            names = _names_with_runs(rows[k], rows[k + 1].cells)
            if names:
                joined = [*rows[:k], Row(rows[k + 1].line, names), *rows[k + 2 :]]
                return replace(sheet, rows=joined)
    return sheet


def _names_with_runs(above: Row, header: Sequence[str]) -> list[str]:
    """Return the headers of all columns, with names of runs added to the headers of readings.

    A run is one circular test. ``header`` are the cells of the header, and ``above`` is the row
    above it, which may name the runs. The result is an empty list if ``above`` names no runs.
    """
    is_angle = has_role(unit_of(above.cells[0]).name, "angle")
    if is_angle and not header[0]:
        return _names_with_units(above, header)
    names = list(header)
    unit = unit_named(names[0].strip("[](){} "))
    if is_angle and unit:
        names[0] = f"{above.cells[0]} [{unit}]"
    runs = with_merged_cells_filled(above, names).cells
    readings = [k for k, name in enumerate(names) if has_role(unit_of(name).name, "reading")]
    if len(readings) < 2 or len(runs) != len(names):
        return []
    if not names_runs([runs[column] for column in readings]):
        return []
    for column in readings:
        names[column] = _with_run(names[column], runs[column])
    return names


def _with_run(name: str, run: str) -> str:
    """Return a header with the name of a run before its unit: ``Deviation Run 1 [um]``."""
    stated = unit_of(name)
    if not stated.unit:
        return f"{stated.name} {run}"
    return f"{stated.name} {run} [{stated.unit}]"


def _names_with_units(above: Row, header: Sequence[str]) -> list[str]:
    """Return the headers of a table, with the unit of the readings from the row above its header.

    The header names only the loads or runs, such as ``100 N`` and ``300 N``. The row ``above``
    names the angle in its first cell. A merged cell beside it names the readings and their unit,
    such as ``Deviation [um]``. The returned headers of the readings are then ``100 N [um]`` and
    ``300 N [um]``. The result is an empty list if ``above`` names something else, or if a header is
    missing.
    """
    texts = [cell for cell in above.cells[1:] if cell]
    names = [above.cells[0], *header[1:]]
    if len(texts) != 1 or len(names) < 3 or not all(names):
        return []
    readings = unit_of(texts[0])
    if not has_role(readings.name, "reading"):
        return []
    if readings.unit:
        names[1:] = [f"{name} [{readings.unit}]" for name in names[1:]]
    return names
