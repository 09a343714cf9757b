"""The text cells of one file, or of one sheet of a workbook."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from ldbb_bayes.campaign.text_table import Row

__all__ = ["Sheet"]


@dataclass(frozen=True, eq=False)
class Sheet:
    """Text cells of one file, or of one sheet of a workbook."""

    path: Path
    name: str  #: of the sheet; empty for a text file
    rows: list[Row]  #: without empty lines
    encoding: str = ""  #: of a text file
    separator: str = ""  #: of a text file
    is_only_table: bool = False  #: of its file, so that the table bears the file's name

    @property
    def name_in_file(self) -> str:
        """Return what distinguishes the sheet in its file; empty for the only table of a file."""
        if self.is_only_table:
            return ""
        return self.name

    @property
    def title(self) -> str:
        """Return the sheet's name in its file, or the file's name."""
        return self.name_in_file or self.path.stem

    @property
    def place(self) -> str:
        """Return what a message calls the sheet."""
        if self.name:
            return f"{self.path}, sheet {self.name!r}"
        return str(self.path)

    def texts(self, rows: Iterable[Row]) -> Iterator[tuple[int, str]]:
        """Return rows as lines of text, with their numbers."""
        for row in rows:
            yield row.line, self.text_of(row.cells)

    def text_of(self, cells: Iterable[str]) -> str:
        """Return cells as one line; of a workbook those that are filled, with semicolons."""
        if self.separator:
            return self.separator.join(cells)
        return ";".join(cell for cell in cells if cell)
