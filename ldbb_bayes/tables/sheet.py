"""Text cells of one table, wherever they come from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

__all__ = ["LARGEST_CELLS", "Sheet"]

LARGEST_CELLS = 1_200_000


@dataclass(frozen=True, eq=False)
class Sheet:
    """Text cells of one file, or of one sheet of a workbook.

    Attributes
    ----------
    path : Path
    name : str
        Of the sheet; empty for a text file.
    rows : list of (line, cells)
        Line as the file counts it, from 1; empty lines are left out.
    only : bool
        Whether it is the one table of its file, and so bears the file's name.
    encoding, separator : str
        How a text file was read; empty for a workbook.
    hidden : str
        What the spreadsheet does not show of it; empty for none.
    """

    path: Path
    name: str
    rows: list[tuple[int, list[str]]]
    only: bool = False
    encoding: str = ""
    separator: str = ""
    hidden: str = ""

    @property
    def own_name(self) -> str:
        """What distinguishes it in its file; empty for the one table of a file."""
        return "" if self.only else self.name

    @property
    def place(self) -> str:
        """What a message calls it."""
        return f"{self.path}, sheet {self.name!r}" if self.name else str(self.path)
