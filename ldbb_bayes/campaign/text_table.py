"""Rows, cells and columns of a table in a text file.

The tables of a campaign folder are read strictly, by `read_strict_table`. Imported files are split
in the same way, after the encoding and the separator of the cells have been determined.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ldbb_bayes.campaign.cell_numbers import LONGEST_CELL_SHOWN
from ldbb_bayes.campaign.text_decoding import decode_text, table_bytes
from ldbb_bayes.errors import InputError

__all__ = ["LARGEST_TABLE", "Row", "columns_of", "read_strict_table", "rows_of_text"]

# Largest number of cells that a text table may have.
LARGEST_TABLE = 4_000_000
# Longest line that a text table may have [characters].
_LONGEST_LINE = 100_000


class Row(NamedTuple):
    """Row of a table in a text file: number of its line in the file, and texts of its cells."""

    #: number of the line in the text file that holds this row of the table, counted from 1
    line: int
    cells: list[str]


def read_strict_table(path: Path) -> tuple[list[Row], str]:
    """Return the rows of a text table in UTF-8, and the character that separates its cells.

    The first row is the header. The separator is whichever of comma, semicolon and tab is most
    frequent in the file's first line. Raise an `InputError` for a file that is not a text table in
    UTF-8.
    """
    text = decode_text(path, table_bytes(path), "utf-8")
    header = text.partition("\n")[0]
    separator = max(",;\t", key=header.count)
    return rows_of_text(path, text, separator), separator


def rows_of_text(path: Path, text: str, separator: str) -> list[Row]:
    """Return the non-empty lines of a text table as rows of cells.

    ``text`` is the table, ``separator`` the character between cells, and ``path`` the path of the
    file for error messages. Raise an `InputError` if the table or one of its lines is too large.
    """
    if text.count("\n") + text.count(separator) > LARGEST_TABLE:
        raise InputError(f"{path} must hold at most {LARGEST_TABLE} cells, got more. Split it.")
    rows = []
    for line, content in enumerate(text.split("\n"), start=1):
        if len(content) > _LONGEST_LINE:
            raise InputError(
                f"{path}, line {line}: a line must hold at most {_LONGEST_LINE} signs, got"
                f" {len(content)}. Export it again."
            )
        if content.strip():
            rows.append(Row(line, _split_line(path, line, content, separator)))
    return rows


def _split_line(path: Path, line: int, content: str, separator: str) -> list[str]:
    """Return the cells of one line of a table, without blanks at the ends of each cell.

    A cell in quotes must end on the same line; otherwise an `InputError` is raised. If the
    separator is a blank, any number of blanks separates two cells.

    Parameters
    ----------
    path, line
        Path of the file and number of the line, for error messages.
    content
        Text of the line.
    separator
        Character between cells.
    """
    if separator == " ":
        return _split_at_blanks(content)
    if '"' not in content:
        return [cell.strip() for cell in content.split(separator)]
    try:
        cells = next(csv.reader(io.StringIO(content), delimiter=separator, strict=True))
    except (csv.Error, StopIteration):
        raise InputError(
            f"{path}, line {line}: quotes must be closed in their cell, got"
            f" {content[:LONGEST_CELL_SHOWN]!r}. Correct the line."
        ) from None
    return [cell.strip() for cell in cells]


def _split_at_blanks(content: str) -> list[str]:
    """Return the cells of a line in which one or more blanks separate two cells.

    A cell in quotation marks may contain blanks. A quotation mark that no second mark closes, such
    as the sign for inches, is part of its cell.
    """
    if '"' not in content:
        return content.split()
    single_spaced = " ".join(content.split())
    try:
        return next(csv.reader(io.StringIO(single_spaced), delimiter=" ", strict=True))
    except (csv.Error, StopIteration):
        return content.split()


def columns_of(place: str, rows: Sequence[Row], width: int) -> tuple[list[int], list[list[str]]]:
    """Return the line number of each row in the text file, and the columns of the table.

    The table has ``width`` columns. Additional cells of a row are ignored if they are empty. Raise
    an `InputError` for a row with fewer cells, and for a row with additional cells that are not
    empty. ``place`` is the file's name for error messages.
    """
    for row in rows:
        if len(row.cells) < width or any(row.cells[width:]):
            raise InputError(
                f"{place}, line {row.line}: rows must have {width} cells, got {len(row.cells)}."
                " Complete or remove the line; with decimal commas separate the cells by"
                " semicolons."
            )
    lines = [row.line for row in rows]
    cells = (row.cells[:width] for row in rows)
    columns = [list(column) for column in zip(*cells, strict=True)]
    return lines, columns
