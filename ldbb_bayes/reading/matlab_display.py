"""Matrices in the form in which MATLAB shows them in its command window.

Above the numbers, MATLAB may write a factor for all of them, such as ``1.0e+02 *``. If a text shows
several matrices, each of them is read as a separate table, with the commands above it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal

from ldbb_bayes.campaign.circular_test import FEWEST_READINGS
from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.header_rows import names_any_role, names_columns
from ldbb_bayes.reading.numerals import NUMBER_IN_TEXT, is_missing, looks_like_number
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.stacked_tables import lines_that_still_apply, named_sheets
from ldbb_bayes.reading.words import UNITS, unit_named

__all__ = ["displays_of_matlab", "is_matlab_display"]

# Regular expression for a line such as "1.0e+03 *", which MATLAB writes above a matrix if all
# numbers of the matrix are to be multiplied by this factor.
_FACTOR = re.compile(r"\s*(?P<factor>\d+(?:\.\d+)?[eE][+\-]\d+)\s*\*\s*")
# Regular expression for a line such as "R =". It names a variable whose value MATLAB shows below.
_NAME = re.compile(r"[A-Za-z]\w*\s*=")
# Regular expression for MATLAB's prompt ``>>`` in front of a command.
_PROMPT = re.compile(r"\s*>>\s*")
# Regular expression for a command of MATLAB that only shows a variable, such as ">> R".
_SHOWING = re.compile(r"\s*>>\s*\w+\s*")
# Regular expression for a line such as "Columns 1 through 8". MATLAB writes it above some columns
# of a matrix that is too wide to be shown at once.
_PART = re.compile(r"\s*Columns? \d+(?: (?:through|and|to) \d+)?\s*")
# Regular expression for a command of MATLAB that assigns one number to a variable, such as F = 490.
_ASSIGNED_NUMBER = re.compile(rf"\b[A-Za-z]\w*\s*=\s*(?P<number>{NUMBER_IN_TEXT})\s*(?=[;,%]|$)")
# Regular expression for a number as MATLAB shows it.
_NUMBER = re.compile(r"[+\-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+\-]?\d+)?")
# Word that is written before the value of a load, as in "Force: 490 N"; the keys are kinds of load.
_LOADS = {"force": "Force", "pressure": "Pressure"}


@dataclass
class _ShownMatrix:
    """Matrix that MATLAB shows: its rows of numbers, and all lines above them."""

    above: list[Row]  # lines above the numbers; each line is stored as a row of one cell
    # rows of numbers; empty if no matrix follows the lines in ``above``
    numbers: list[Row]


@dataclass
class _Display:
    """Matrix that MATLAB shows, with its header and the other lines above it."""

    # lines above the matrix and its header; each line is stored as a row of one cell
    lines: list[Row] = field(default_factory=list)
    # row with the names of all columns of the matrix; an empty list if nothing names them
    header: list[Row] = field(default_factory=list)
    # rows of the matrix, after multiplication by the factor that MATLAB writes above the matrix
    numbers: list[Row] = field(default_factory=list)
    # factor, such as 1.0e+03, by which all numbers of the matrix are to be multiplied; empty if
    # there is none
    factor: str = ""
    # number of the line that states the factor of the matrix; 0 if there is no factor
    factor_line: int = 0


def is_matlab_display(text: str) -> bool:
    """Return whether a text was copied from the command window of MATLAB.

    Such a text is recognised by a line with a factor of numbers, such as ``1.0e+03 *``. It is also
    recognised if it has a line with MATLAB's prompt ``>>`` and a line with only the name of a
    variable, such as ``R =``.
    """
    lines = text.split("\n")
    if any(_FACTOR.fullmatch(line) for line in lines):
        return True
    has_prompt = any(_PROMPT.match(line) for line in lines)
    return has_prompt and any(_NAME.fullmatch(line.strip()) for line in lines)


def displays_of_matlab(sheet: Sheet, text: str) -> list[Sheet]:
    """Return one sheet for each displayed matrix that has enough rows for a table.

    If MATLAB shows a common factor above the numbers, the numbers are multiplied by it. A comment
    after a command, such as ``% theta [rad], distance [mm]``, is the header of the table if it
    names every column. If a later display has no header, the header of the first display is used.
    A line above the first display also applies to a later display, unless a line above the later
    one states the same property, such as the force. If no display has enough rows for a table, the
    sheet is returned unchanged.

    Parameters
    ----------
    sheet
        The text of a file, split into rows of cells.
    text
        The same text as one string.

    Raises
    ------
    InputError
        If a matrix is shown in several parts, each with some of its columns. The error is also
        raised if a number below a factor is not written as MATLAB writes it, or if too few rows for
        a table follow a factor.
    """
    *matrices, end = _shown_matrices(sheet.rows, text.split("\n"))
    if not matrices:
        _check_no_factor(sheet, end.above)
        return [sheet]
    displays = [_display_of_matrix(sheet, matrix) for matrix in matrices]
    tables = [_rows_of_display(sheet, displays[0], display) for display in displays]
    tables[-1] += _with_values_joined(end.above)
    named = [sheet]
    if len(tables) > 1:
        named = named_sheets(sheet, tables)
    sheets = []
    for display, rows, named_sheet in zip(displays, tables, named, strict=True):
        sheets.append(
            replace(named_sheet, rows=rows, factor=display.factor, factor_line=display.factor_line)
        )
    return sheets


def _shown_matrices(rows: Sequence[Row], written: Sequence[str]) -> list[_ShownMatrix]:
    """Return the matrices in a text from MATLAB's command window, each with the lines above it.

    The last item of the result holds no matrix, but the lines below the last matrix. ``rows`` are
    the rows of the text, split into cells, and ``written`` are the lines of the text.
    """
    shown = [_ShownMatrix([], [])]
    # rows of numbers of the matrix that is being read; all have the same number of cells
    successive: list[Row] = []
    for row in rows:
        is_alike = not successive or len(row.cells) == len(successive[0].cells)
        if _is_row_of_numbers(row) and is_alike:
            successive.append(row)
            continue
        _store_numbers(shown, successive)
        successive = []
        if _is_row_of_numbers(row):
            successive.append(row)
        else:
            shown[-1].above.append(Row(row.line, [written[row.line - 1].strip()]))
    _store_numbers(shown, successive)
    return shown


def _is_row_of_numbers(row: Row) -> bool:
    """Return whether a row has at least two cells, all of them numbers or missing numbers."""
    if len(row.cells) < 2 or all(is_missing(cell) for cell in row.cells):
        return False
    return all(looks_like_number(cell) or is_missing(cell) for cell in row.cells)


def _store_numbers(matrices: list[_ShownMatrix], successive: Sequence[Row]) -> None:
    """Store successive rows of numbers as a matrix, if there are enough of them for a table.

    The rows in ``successive`` become the numbers of the last item in ``matrices``, and an empty
    item is added for the next matrix. If there are too few rows, they are added to the lines above
    the next matrix.
    """
    if len(successive) < FEWEST_READINGS:
        matrices[-1].above += [Row(row.line, [" ".join(row.cells)]) for row in successive]
        return
    matrices[-1].numbers += successive
    matrices.append(_ShownMatrix([], []))


def _check_no_factor(sheet: Sheet, lines: Sequence[Row]) -> None:
    """Raise an `InputError` if a line below the last matrix states a factor, such as 1.0e+03.

    MATLAB writes such a factor above a matrix whose numbers are to be multiplied by it.
    """
    for row in lines:
        if _FACTOR.fullmatch(row.cells[0]):
            raise InputError(
                f"{sheet.place}, line {row.line}: a factor must stand above a table of at least"
                f" {FEWEST_READINGS} rows of numbers, got {row.cells[0]!r} above fewer. Write the"
                " matrix to a file with writematrix."
            )


def _display_of_matrix(sheet: Sheet, shown: _ShownMatrix) -> _Display:
    """Return a matrix that MATLAB displays: its header, the lines above it, and its numbers.

    The numbers are multiplied by the factor, such as 1.0e+03, that MATLAB writes above the matrix.
    A factor is not used if a command or the name of another variable stands between the factor and
    the numbers. ``shown`` are the numbers and all lines above them; some of these lines state the
    factor or the names of the columns. Raise an `InputError` if the matrix is shown in several
    parts, each with some of its columns.
    """
    display = _Display()
    for row in shown.above:
        content = row.cells[0]
        factor = _FACTOR.fullmatch(content)
        if _PART.fullmatch(content):
            raise InputError(
                f"{sheet.place}, line {row.line}: a matrix must be shown with all its columns, got"
                f" {content!r}. Write it to a file with writematrix."
            )
        if factor is not None:
            display.factor = factor["factor"]
            display.factor_line = row.line
            continue
        if _NAME.fullmatch(content) or _PROMPT.match(content):
            display.factor = ""
            display.factor_line = 0
        names = _column_names(content, len(shown.numbers[0].cells))
        if names:
            display.header = [Row(row.line, names)]
            content, _, _ = content.partition("%")
            if content.split() == names or _SHOWING.fullmatch(content):
                continue
        display.lines += _line_of_command(row.line, content)
    display.lines = _with_values_joined(display.lines)
    for row in shown.numbers:
        display.numbers.append(_row_times_factor(sheet, row, display))
    return display


def _rows_of_display(sheet: Sheet, first: _Display, display: _Display) -> list[Row]:
    """Return the rows of a sheet for one matrix: the lines above it, its header and its numbers.

    ``display`` is the matrix whose rows are returned, and ``first`` is the first matrix in the
    text. Lines above the first matrix that also apply to ``display`` are added. A matrix without a
    header gets the header of the first matrix, if both have the same number of columns.
    """
    if display is first:
        return [*first.lines, *first.header, *first.numbers]
    lines_of_first = lines_that_still_apply(sheet, first.lines, display.lines)
    header = display.header
    if not header and len(first.numbers[0].cells) == len(display.numbers[0].cells):
        header = first.header
    return [*lines_of_first, *display.lines, *header, *display.numbers]


def _column_names(content: str, width: int) -> list[str]:
    """Return the names of a matrix's columns if a line states all of them; otherwise an empty list.

    The names are the words of the line, or the parts of a comment that are separated by commas.
    ``width`` is the number of columns.
    """
    _, mark, comment = content.partition("%")
    names = content.split()
    if mark:
        names = [name.strip() for name in comment.split(",")]
    if len(names) != width or not names_columns(names):
        return []
    if not any(names_any_role(name) for name in names):
        return []
    return names


def _line_of_command(line: int, content: str) -> list[Row]:
    """Return a line of MATLAB's command window without its prompt.

    The result is a list with one row, whose only cell is the line. The list is empty if the line
    holds nothing but a prompt.

    If the line assigns a number, and the comment after it is a unit of force or pressure, a text
    that states the load is appended: ``F = 490; % N`` becomes ``F = 490; % N; Force: 490 N``.
    """
    command = _PROMPT.sub("", content).strip()
    if not command:
        return []
    code, _, comment = command.partition("%")
    unit = unit_named(comment.strip(" []().;"))
    numbers = _ASSIGNED_NUMBER.findall(code)
    for role, word in _LOADS.items():
        if unit in UNITS[role] and len(numbers) == 1:
            command = f"{command}; {word}: {numbers[0]} {unit}"
    return [Row(line, [command])]


def _with_values_joined(lines: Sequence[Row]) -> list[Row]:
    """Put each name and the number in the line below it together in one line, such as ``R0 = 150``.

    A name without a number below it is left out. Lines with other contents are kept. ``lines`` are
    lines of MATLAB's command window that hold no matrix.
    """
    joined: list[Row] = []
    name = ""
    for row in lines:
        content = row.cells[0]
        if _NAME.fullmatch(content):
            name = content
            continue
        if name and _NUMBER.fullmatch(content):
            content = f"{name} {content}"
        joined.append(Row(row.line, [content]))
        name = ""
    return joined


def _row_times_factor(sheet: Sheet, row: Row, display: _Display) -> Row:
    """Return a row whose numbers are multiplied by the factor that MATLAB shows above them.

    If there is no such factor, the row is returned unchanged. ``display`` is the matrix to which
    the row belongs.
    """
    if not display.factor:
        return row
    cells = []
    for cell in row.cells:
        if is_missing(cell):
            cells.append(cell)
            continue
        if not _NUMBER.fullmatch(cell):
            raise InputError(
                f"{sheet.place}, line {row.line}: numbers below the factor {display.factor} in line"
                f" {display.factor_line} must have a decimal point, got {cell!r}. Write the matrix"
                " to a file with writematrix."
            )
        cells.append(f"{Decimal(cell) * Decimal(display.factor):f}")
    return Row(row.line, cells)
