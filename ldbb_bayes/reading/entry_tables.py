"""Conversion of tables in files of named values, such as JSON, to sheets.

The rows of these tables are not lines of the file. The statements of the file and the rows of its
tables are therefore numbered consecutively, and messages use these numbers as line numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.numerals import looks_like_number
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.words import unit_named

__all__ = ["EntryTable", "sheets_of_entries", "statement_of"]


@dataclass
class EntryTable:
    """Table of a file, with the statements that apply to it."""

    name: str  #: name of the table in the file; empty if nothing names the table
    statements: list[str]  #: statements that apply to the table, such as ``radius: 150 mm``
    header: list[str]  #: names of the table's columns; empty if nothing names them
    rows: list[list[str]]  #: cells of each row of the table


def sheets_of_entries(sheet: Sheet, tables: Sequence[EntryTable], format_name: str) -> list[Sheet]:
    """Return one sheet for each table of a file.

    Parameters
    ----------
    sheet
        Sheet without rows, which holds the path of the file.
    tables
        Tables of the file.
    format_name
        Name of the format in messages, such as JSON.
    """
    sheets = []
    line = 0
    for table in tables:
        cells = [[statement] for statement in table.statements]
        if table.header:
            cells.append(table.header)
        rows = []
        for row in [*cells, *table.rows]:
            line += 1
            rows.append(Row(line, row))
        name = table.name if len(tables) > 1 else ""
        sheets.append(replace(sheet, rows=rows, name=name, format=format_name))
    return _with_different_names(sheets)


def statement_of(key: str, value: str) -> str:
    """Return a line of text for a key and its value: ``radius: 150 mm`` for ``radius_mm`` and 150.

    The unit is moved from the key to the value only if the value is a number.
    """
    stated = unit_of(key)
    if unit_named(stated.unit) and looks_like_number(value):
        return f"{stated.name.replace('_', ' ')}: {value} {stated.unit}"
    return f"{key.replace('_', ' ')}: {value}"


def _with_different_names(sheets: Sequence[Sheet]) -> list[Sheet]:
    """Return the sheets, renamed if necessary so that no two have the same name.

    If two sheets have the same name, a number is added to the names of all sheets.
    """
    names = [sheet.name for sheet in sheets]
    if len(set(names)) == len(names):
        return list(sheets)
    numbered = []
    for number, sheet in enumerate(sheets, start=1):
        numbered.append(replace(sheet, name=f"{sheet.name or 'table'} {number}"))
    return numbered
