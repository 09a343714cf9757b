"""Building blocks of the certificate's sheets, the same for the HTML page and for paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from ldbb_bayes.report.pictures import Picture
from ldbb_bayes.results import Table

__all__ = ["Banner", "Block", "Fields", "Items", "Pair", "PictureRow", "ReportSheet"]

# Ratio of width to height above which a figure needs the full width of a certificate's sheet.
_WIDE = 1.6


@dataclass(frozen=True)
class Fields:
    """Form fields of a certificate's sheet, each with a name and a text.

    Parameters
    ----------
    entries
        Name and text of each field; an empty text leaves a blank line for handwriting.
    tall
        Whether the fields are tall enough for signatures.
    heading
        Heading of the fields; empty if they need none.
    """

    entries: tuple[tuple[str, str], ...]
    tall: bool = False
    heading: str = ""


@dataclass(frozen=True)
class Banner:
    """Banner of a certificate, which states in one sentence whether its numbers can be used.

    Parameters
    ----------
    kind
        ``usable``, ``reserved`` (usable with reservations) or ``unusable``.
    sentence
        Sentence that states whether the numbers can be used, with the most serious reasons.
    """

    kind: str
    sentence: str


@dataclass(frozen=True, eq=False)
class Pair:
    """A figure of a certificate's sheet, with a list beside or below it.

    Parameters
    ----------
    picture
        The figure.
    heading
        Heading of the list.
    beside
        Items of the list.
    """

    picture: Picture
    heading: str
    beside: tuple[str, ...]

    @property
    def wide(self) -> bool:
        """Whether the figure needs the sheet's full width, so that its list is placed below it."""
        width, height = self.picture.figure.get_size_inches()
        return bool(width > _WIDE * height)


@dataclass(frozen=True)
class Items:
    """A heading of a certificate's sheet with a list of sentences below it.

    Parameters
    ----------
    heading
        Heading of the list.
    items
        Sentences of the list.
    """

    heading: str
    items: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class PictureRow:
    """Figures of a certificate's sheet, side by side where none of them is wide.

    Parameters
    ----------
    pictures
        The figures from left to right.
    """

    pictures: tuple[Picture, ...]

    @property
    def shares(self) -> tuple[float, ...]:
        """Share of every figure in the width of the row, for figures of the same height."""
        ratios = []
        for picture in self.pictures:
            width, height = picture.figure.get_size_inches()
            ratios.append(float(width / height))
        return tuple(ratio / sum(ratios) for ratio in ratios)

    @property
    def stacked(self) -> bool:
        """Whether the first figure is so wide that the others are placed below it."""
        width, height = self.pictures[0].figure.get_size_inches()
        return bool(width > _WIDE * height)


Block: TypeAlias = str | Fields | Banner | Items | Table | Pair | PictureRow | Picture
"""One piece of the content of a certificate's sheet; a plain string is a note."""


@dataclass(frozen=True)
class ReportSheet:
    """One sheet of the certificate, which fills one page of A4.

    Parameters
    ----------
    key
        Anchor (id) of the sheet in the HTML page.
    title
        Title of the sheet.
    line
        Line below the title: the number of the sheet and the name of the campaign.
    blocks
        Content from top to bottom.
    scale
        Relative size of the letters; less than 1 if larger letters would not fit on the page.
    """

    key: str
    title: str
    line: str
    blocks: tuple[Block, ...]
    scale: float = 1.0
