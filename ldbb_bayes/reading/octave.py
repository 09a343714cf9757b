"""Variables as Octave saves them as text (``save -text``): matrices, numbers and strings.

Vectors of the same length become the columns of one table, with the names of the variables as
headers. If a file has matrices but no vectors, each matrix becomes a table. Numbers and strings
become lines above the tables.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from ldbb_bayes.campaign.circular_test import FEWEST_READINGS
from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.entry_tables import EntryTable, sheets_of_entries, statement_of
from ldbb_bayes.reading.sheet import Sheet

__all__ = ["is_octave", "sheets_of_octave"]

# Regular expression for the two lines with which a variable begins in a text file of Octave.
_BEGINNING = re.compile(r"^[#%] name: .*\n[#%] type: ", re.MULTILINE)
# Regular expression for a line in a text file of Octave with a property of a variable, such as
# "# rows: 72".
_PROPERTY = re.compile(r"[#%] (?P<key>\w[\w ,]*?)(?:: (?P<value>.*))?\s*")


@dataclass
class _Variable:
    """Variable of Octave: its name, its type, and rows of numbers or text."""

    name: str
    type: str = ""  # type of the variable as Octave writes it, such as "matrix"
    rows: list[Row] = field(default_factory=list)  # lines with the values of the variable

    @property
    def columns(self) -> list[list[str]]:
        """Columns of a matrix or vector as lists of cells. A row vector counts as one column."""
        cells = [row.cells for row in self.rows]
        if len(cells) == 1:
            return cells
        return [list(column) for column in zip(*cells, strict=True)]


def is_octave(text: str) -> bool:
    """Return whether a text holds variables as Octave saves them."""
    return _BEGINNING.search(text) is not None


def sheets_of_octave(sheet: Sheet, text: str) -> list[Sheet]:
    """Return one sheet for each table in a text file of Octave.

    If the file holds vectors, all vectors and the columns of all matrices form one table. If it
    holds no vectors, each matrix is a table. Strings, and variables with few numbers, become lines
    above the tables.

    Parameters
    ----------
    sheet
        Sheet without rows, which holds the path of the file.
    text
        Content of the file.

    Raises
    ------
    InputError
        If the rows of a matrix differ in length, or if vectors that would form one table differ in
        length.
    """
    statements = []
    vectors = []
    matrices = []
    for variable in _variables_in(text):
        _check_rows(sheet, variable)
        length = max((len(column) for column in variable.columns), default=0)
        if length < FEWEST_READINGS or "string" in variable.type:
            statements.append(variable)
        elif len(variable.columns) == 1:
            vectors.append(variable)
        else:
            matrices.append(variable)
    lines = [_line_of_variable(variable) for variable in statements if variable.rows]
    tables = [EntryTable(m.name, lines, [], [row.cells for row in m.rows]) for m in matrices]
    if vectors:
        tables = [_table_of_vectors(sheet, lines, [*vectors, *matrices])]
    return sheets_of_entries(sheet, tables or [EntryTable("", lines, [], [])], "Octave")


def _variables_in(text: str) -> Iterator[_Variable]:
    """Yield the variables in a text that Octave saved. Lines above the first one are left out."""
    variable = _Variable("")
    for line, content in enumerate(text.split("\n"), start=1):
        stated = _PROPERTY.fullmatch(content)
        if stated is not None and stated["key"] == "name":
            if variable.name:
                yield variable
            variable = _Variable((stated["value"] or "").strip())
        elif stated is not None and stated["key"] == "type":
            variable.type = stated["value"] or ""
        elif stated is None and content.strip() and variable.name:
            cells = content.split()
            if "string" in variable.type:
                cells = [content.strip()]
            variable.rows.append(Row(line, cells))
    yield variable


def _check_rows(sheet: Sheet, variable: _Variable) -> None:
    """Raise an `InputError` if the rows of a matrix differ in their number of cells."""
    for row in variable.rows:
        width = len(variable.rows[0].cells)
        if len(row.cells) != width:
            raise InputError(
                f"{sheet.place}, line {row.line}: the rows of a matrix must have the same length,"
                f" got {len(row.cells)} numbers below {width}. Save it again (save -text)."
            )


def _line_of_variable(variable: _Variable) -> str:
    """Return a variable of Octave, such as a number or a string, as one line of text.

    The line consists of the name and the value of the variable. The name is left out if the value
    contains a colon, as in "theta: rad".
    """
    text = "; ".join(" ".join(row.cells) for row in variable.rows)
    if ":" in text:
        return text
    return statement_of(variable.name, text)


def _table_of_vectors(sheet: Sheet, lines: list[str], variables: Sequence[_Variable]) -> EntryTable:
    """Return one table whose columns are the vectors in a file and the columns of its matrices.

    ``variables`` are these vectors and matrices, and ``lines`` are the lines above the table.
    """
    header = []
    columns = []
    for variable in variables:
        for number, column in enumerate(variable.columns, start=1):
            is_vector = len(variable.columns) == 1
            header.append(variable.name if is_vector else f"{variable.name} {number}")
            columns.append(column)
    if len({len(column) for column in columns}) > 1:
        listed = ", ".join(f"{variable.name!r}" for variable in variables)
        raise InputError(
            f"{sheet.place}: vectors of one table must have the same length, got different lengths"
            f" of {listed}. Save the vectors of each circle in a file of its own."
        )
    return EntryTable("", lines, header, [list(row) for row in zip(*columns, strict=True)])
