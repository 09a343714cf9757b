"""Loads in a line above the header, such as ``Force [N],100,300,600`` above three columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.column_roles import has_role, unit_of
from ldbb_bayes.reading.names import load_in_name
from ldbb_bayes.reading.numerals import looks_like_number
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.stacked_tables import first_header
from ldbb_bayes.reading.words import UNITS

__all__ = ["with_loads_in_header"]


def with_loads_in_header(sheet: Sheet) -> Sheet:
    """Return a sheet in which the loads from the line above the header are put into the header.

    Loads are forces and pressures. The line must state a load, such as ``100 N``, for each column
    except the first. If the first cell of the line names force or pressure with a unit, the other
    cells may be numbers without units. For example, the header ``Deviation [um]`` below 100 N is
    changed to ``100 N Deviation [um]``. A sheet without such a line is returned unchanged.
    """
    header = first_header(sheet.rows)
    if not header:
        return sheet
    names = sheet.rows[header]
    loads = _loads_of(sheet.rows[header - 1].cells)
    if len(loads) != len(names.cells) - 1 or not loads:
        return sheet
    merged = [names.cells[0]]
    for load, name in zip(loads, names.cells[1:], strict=True):
        merged.append(f"{load} {name}")
    rows = [*sheet.rows[: header - 1], Row(names.line, merged), *sheet.rows[header + 1 :]]
    return replace(sheet, rows=rows)


def _loads_of(cells: Sequence[str]) -> list[str]:
    """Return the loads in a line, such as "100 N", one for each cell except the first.

    Return an empty list if one of these cells states no load.
    """
    unit = _unit_of_loads(cells[0])
    loads = []
    for cell in cells[1:]:
        load = cell
        if unit and looks_like_number(cell):
            load = f"{cell} {unit}"
        if load_in_name([load]) is None:
            return []
        loads.append(load)
    return loads


def _unit_of_loads(cell: str) -> str:
    """Return the unit of force or pressure that a cell states; empty if the cell states none."""
    header = unit_of(cell)
    for role in ("force", "pressure"):
        if has_role(header.name, role) and header.unit in UNITS[role]:
            return header.unit
    return ""
