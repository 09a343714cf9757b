"""Sheets: the cells of one text file, or of one sheet of a workbook, as texts."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ldbb_bayes.campaign.text_table import Row

__all__ = ["Sheet"]


@dataclass(frozen=True, eq=False)
class Sheet:
    """Cells of one text file, or of one sheet of a workbook, as texts."""

    path: Path  #: path of the file that holds the sheet
    #: name of the sheet; for a text file, this is empty or the name of one of several tables in the
    #: file
    name: str
    rows: list[Row]  #: rows of the sheet's cells with their line numbers; empty lines are left out
    encoding: str = ""  #: encoding of a text file; empty for a workbook
    separator: str = ""  #: separator of cells in a text file; empty for a workbook
    #: whether this is the only table of readings in the file; if so, tests are named after the file
    is_only_table: bool = False
    #: format of a text file that is not written in rows, such as JSON; empty for any other file. If
    #: a file has such a format, its "line numbers" count the entries of the file instead of its
    #: lines
    format: str = ""
    #: units that were removed from cells because they stood after a number; each key holds the line
    #: number and the column index of a cell
    cell_units: Mapping[tuple[int, int], str] = field(default_factory=dict)
    #: units in the number formats of the sheet's cells, as in the format ``0.0 "µm"``; each key
    #: holds the line number and the column index of a cell
    format_units: Mapping[tuple[int, int], str] = field(default_factory=dict)
    #: line number and column index of each cell with a formula but no stored value
    formulas_without_value: Collection[tuple[int, int]] = ()
    #: line number and column index of each cell whose text is struck through
    struck_cells: Collection[tuple[int, int]] = ()
    #: whether a workbook stores all numbers of the sheet as numbers, so that their decimal mark is
    #: certain; false for a text file
    stores_numbers: bool = False
    n_headers: int = 0  #: number of repeated headers inside the table, which are left out
    #: whether the number formats and the hidden rows of the workbook could be read
    is_examined: bool = False
    hidden_rows: int = 0  #: number of hidden rows of the sheet, which are left out
    #: factor, as the file writes it, by which all numbers of the table were multiplied; empty if
    #: there is none
    factor: str = ""
    #: number of the line that states the factor of all numbers of the table; 0 if there is none
    factor_line: int = 0
    #: number of the line of the file that holds the angles, if each further line holds one circle.
    #: The columns of such a table have become the rows of this sheet. 0 for any other table
    line_of_angles: int = 0
    hidden_sheets: Sequence[str] = ()  #: names of hidden sheets of the file, which are left out
    #: names of the sheets of the file that are left out because the user names other sheets
    sheets_not_wanted: Sequence[str] = ()

    @property
    def name_in_file(self) -> str:
        """Name of the sheet if the file holds several tables; empty if the file holds only one."""
        if self.is_only_table:
            return ""
        return self.name

    @property
    def title(self) -> str:
        """Name of the sheet if the file holds several tables, or else the name of the file."""
        return self.name_in_file or self.path.stem

    @property
    def place(self) -> str:
        """Name of the sheet in error messages: path of the file, and name of the sheet."""
        if self.name:
            kind = "table" if self.separator else "sheet"
            return f"{self.path}, {kind} {self.name!r}"
        return str(self.path)

    def cells_as_written(self, row: Row) -> list[str]:
        """Return the cells of a row as in the file, with the units that stood after numbers."""
        cells = []
        for column, cell in enumerate(row.cells):
            cells.append(f"{cell} {self.cell_units.get((row.line, column), '')}".strip())
        return cells

    def texts(self, rows: Iterable[Row]) -> Iterator[tuple[int, str]]:
        """Yield the line number of each row, and its cells joined to one line of text."""
        for row in rows:
            yield row.line, self.text_of(row.cells)

    def text_of(self, cells: Iterable[str]) -> str:
        """Return the cells of a row as one line of text.

        In a text file, the cells are joined by the separator of the file. In a workbook, empty
        cells are left out, and the others are joined by semicolons.
        """
        if self.separator:
            return self.separator.join(cells)
        return ";".join(cell for cell in cells if cell)
