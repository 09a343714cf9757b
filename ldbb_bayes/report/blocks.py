"""What a sheet is made of, on the page and on paper alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from ldbb_bayes.report.pictures import Picture
from ldbb_bayes.results import Table

__all__ = ["Banner", "Block", "Fields", "Pair", "ReportSheet"]

_WIDE = 1.6  # width over height of a figure that needs the full width of a sheet


@dataclass(frozen=True)
class Fields:
    """Entries with their names.

    Parameters
    ----------
    entries
        Name and text of each; an empty text is a line to write on.
    tall
        Whether there is room for signatures.
    """

    entries: tuple[tuple[str, str], ...]
    tall: bool = False


@dataclass(frozen=True)
class Banner:
    """Whether the numbers can be used, in one sentence.

    Parameters
    ----------
    kind
        ``usable``, ``reserved`` or ``unusable``.
    sentence
        With the gravest reasons.
    """

    kind: str
    sentence: str


@dataclass(frozen=True, eq=False)
class Pair:
    """A figure, and a list beside it.

    Parameters
    ----------
    picture
        The figure.
    heading
        Of the list.
    beside
        Its items.
    """

    picture: Picture
    heading: str
    beside: tuple[str, ...]

    @property
    def wide(self) -> bool:
        """Whether the figure needs the full width, so that the list comes below."""
        width, height = self.picture.figure.get_size_inches()
        return bool(width > _WIDE * height)


Block: TypeAlias = str | Fields | Banner | Table | Pair | Picture
"""A note, or what its name says."""


@dataclass(frozen=True)
class ReportSheet:
    """One page of A4.

    Parameters
    ----------
    key
        Its anchor on the page.
    title
        Of the sheet.
    line
        Below the title: which sheet, of what.
    blocks
        Its content from top to bottom.
    scale
        Size of its letters, 1 where there is room.
    """

    key: str
    title: str
    line: str
    blocks: tuple[Block, ...]
    scale: float = 1.0
