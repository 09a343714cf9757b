"""Reading of text tables: decoding of the file, splitting into cells, and reading of numbers.

The tables of a campaign folder are read strictly, by `read_strict_table` and `strict_numbers`.
Imported files are read in the same steps, after the encoding, the separator of the cells and the
decimal mark of the file have been determined.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ldbb_bayes.errors import InputError, require
from ldbb_bayes.files import LARGEST_TABLE_BYTES, bytes_of
from ldbb_bayes.results import Array

__all__ = [
    "ARCHIVE_SIGNATURE",
    "BYTE_ORDER_MARKS",
    "COMPOUND_SIGNATURE",
    "LARGEST_TABLE",
    "LONGEST_CELL_SHOWN",
    "EmptyFileError",
    "Row",
    "columns_of",
    "decode_text",
    "number_error",
    "read_strict_table",
    "rows_of_text",
    "strict_numbers",
    "table_bytes",
]

# Largest number of cells that a text table may have.
LARGEST_TABLE = 4_000_000
# Longest line that a text table may have [characters].
_LONGEST_LINE = 100_000
# Largest number of characters of a table's cell that an error message shows.
LONGEST_CELL_SHOWN = 60
# Byte-order mark with which a text file may begin, for each encoding.
BYTE_ORDER_MARKS = {
    "utf-8": b"\xef\xbb\xbf",
    "utf-16-le": b"\xff\xfe",
    "utf-16-be": b"\xfe\xff",
}
# First bytes of a file that is a zip archive; workbooks in the formats XLSX and ODS are such
# archives.
ARCHIVE_SIGNATURE = b"PK\x03\x04"
# First bytes of a file in Microsoft's compound file format, the format of XLS workbooks and of
# workbooks with a password.
COMPOUND_SIGNATURE = b"\xd0\xcf\x11\xe0"
# Character (Ctrl-Z) with which old text files end; it is removed when a text table is read.
_CONTROL_Z = b"\x1a"


class EmptyFileError(InputError):
    """Error for a text table whose file is empty or contains only blanks."""


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


def table_bytes(path: Path) -> bytes:
    """Return the bytes of a file that holds a table.

    Raise an `InputError` if the file is empty, too large or cannot be read.
    """
    raw = bytes_of(path, LARGEST_TABLE_BYTES, what="a file")
    if not raw.strip(b" \t\r\n\0"):
        raise EmptyFileError(
            f"{path} must hold a table, got an empty file. Leave it out or export it again."
        )
    return raw


def decode_text(path: Path, raw: bytes, encoding: str) -> str:
    r"""Return the text of a file without its byte-order mark, with ``\n`` at the ends of lines.

    ``raw`` are the bytes of the file, and ``path`` is its path for error messages.

    Raises
    ------
    InputError
        If the file is a workbook, if bytes are invalid in the encoding, or if the text contains
        control characters.
    """
    require(
        not raw.startswith((ARCHIVE_SIGNATURE, COMPOUND_SIGNATURE)),
        f"{path} must be a text file, got a workbook. Import it: ldbb-bayes import {path} --out"
        " FOLDER.",
    )
    for mark in BYTE_ORDER_MARKS.values():
        if raw.startswith(mark):
            raw = raw[len(mark) :]
            break
    remedy = "Save it as 'CSV UTF-8', or import it with --encoding."
    try:
        text = raw.rstrip(_CONTROL_Z).decode(encoding)
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise InputError(
            f"{path}, line {line}: text must be {encoding}, got other bytes. {remedy}"
        ) from None
    control_character = re.search(r"[^ -\U0010ffff\t\r\n\f]", text)
    if control_character is not None:
        line = text.count("\n", 0, control_character.start()) + 1
        raise InputError(f"{path}, line {line}: a table must be text, got binary data. {remedy}")
    return text.replace("\r\n", "\n").replace("\r", "\n")


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


def strict_numbers(
    place: str, name: str, lines: Sequence[int], cells: Sequence[str], decimal: str
) -> Array:
    """Return the numbers in the n cells of a table's column, shape (n,).

    Raise an `InputError` for a cell that is not a finite number, and for a number with thousands
    separators, such as 1,000,000. In a cell such as 1.000, the point is read as a decimal mark.

    Parameters
    ----------
    place, name
        Name of the file and name of the column, for error messages.
    lines
        Number of the line that holds each cell, for error messages.
    cells
        Texts of the cells.
    decimal
        Decimal mark: point or comma.
    """
    # Python would read 1_000 as 1000, but a cell with an underscore does not count as a number.
    plain = "_" not in "".join(cells)
    if plain and decimal == ".":
        with suppress(ValueError):
            values = np.array([float(cell) for cell in cells])
            if np.isfinite(values).all():
                return values
    values = np.full(len(cells), np.nan)
    for k, cell in enumerate(cells):
        if "_" in cell:
            continue
        with suppress(ValueError):
            values[k] = float(cell.replace(decimal, "."))
    not_finite = np.flatnonzero(~np.isfinite(values))
    if not_finite.size:
        first = not_finite[0]
        raise number_error(place, lines[first], name, cells[first])
    return values


def number_error(
    place: str, line: int, name: str, cell: str, remedy: str = "Correct or remove the line."
) -> InputError:
    """Return the `InputError` for a cell of a text table that should hold a finite number.

    Parameters
    ----------
    place, line
        Name of the file and number of the line.
    name
        Name of the column.
    cell
        Text of the cell.
    remedy
        Sentence that says what the user can do. If the cell looks like a date, a sentence about
        dates is used instead.
    """
    content = "an empty cell"
    if cell:
        content = repr(cell[:LONGEST_CELL_SHOWN])
    if re.match(r"\d{4}-\d\d-\d\d", cell):
        remedy = "A spreadsheet took a number for a date: format the column as number."
    return InputError(
        f"{place}, line {line}: {name} must be a finite number, got {content}. {remedy}"
    )
