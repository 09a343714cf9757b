"""Building blocks of the test certificate, for both the HTML page and the PDF file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from ldbb_bayes.report.pictures import Picture
from ldbb_bayes.results import Table

__all__ = ["Banner", "Block", "Fields", "Items", "Pair", "PictureRow", "ReportSheet"]

# A figure is as wide as the sheet if its width is more than this many times its height.
_WIDE = 1.6
# Least share of a row's width for the first of several figures. Its labels are as large then as
# beside a figure of six compliances. Less would make them too small to read.
_LEAST_FIRST_SHARE = 0.35


@dataclass(frozen=True)
class Fields:
    """Form fields on a sheet of the test certificate, each with a name and its text.

    Parameters
    ----------
    entries
        Name and text of each field. A field with an empty text is a blank line for handwriting.
    tall
        Whether the fields are tall enough for signatures.
    heading
        Heading above the fields, or an empty string for no heading.
    """

    entries: tuple[tuple[str, str], ...]
    tall: bool = False
    heading: str = ""


@dataclass(frozen=True)
class Banner:
    """Banner of the test certificate: one sentence on whether the results can be used.

    Parameters
    ----------
    kind
        ``usable``, ``reserved`` (usable with reservations) or ``unusable``.
    sentence
        Sentence that states whether the results on this sheet can be used, and the most
        serious reasons for caution.
    cure
        Sentence on what to do about the first of these reasons that has a cure. It is printed at
        the terminal, and the sheet does not show it. Empty if nothing can be done, or if
        ``sentence`` says it.
    """

    kind: str
    sentence: str
    cure: str = ""


@dataclass(frozen=True, eq=False)
class Pair:
    """A figure on a sheet of the test certificate, with a list beside or below the figure.

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
        """Whether a figure is so wide that its list of sentences is placed below it."""
        width, height = self.picture.figure.get_size_inches()
        return bool(width > _WIDE * height)


@dataclass(frozen=True)
class Items:
    """A heading on a sheet of the test certificate, with a list of sentences below it.

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
    """Figures on a sheet of the test certificate, side by side.

    Parameters
    ----------
    pictures
        The figures from left to right.
    """

    pictures: tuple[Picture, ...]

    @property
    def shares(self) -> tuple[float, ...]:
        """Width of each figure as a fraction of the row's width.

        With these fractions, all figures of the row have the same height, unless the first figure
        would be too narrow. It then has 0.35 of the width, and is higher than the others.
        """
        ratios = []
        for picture in self.pictures:
            width, height = picture.figure.get_size_inches()
            ratios.append(float(width / height))
        first = ratios[0] / sum(ratios)
        if len(ratios) > 1:
            first = max(first, _LEAST_FIRST_SHARE)
        others = [(1.0 - first) * ratio / sum(ratios[1:]) for ratio in ratios[1:]]
        return (first, *others)


Block: TypeAlias = str | Fields | Banner | Items | Table | Pair | PictureRow | Picture
"""One piece of the content of a certificate's sheet; a plain string is a note."""


@dataclass(frozen=True)
class ReportSheet:
    """One sheet of the test certificate. The sheet fills one page of A4.

    Parameters
    ----------
    key
        Anchor (id) of the sheet in the HTML page.
    title
        Title of the sheet.
    line
        Line below the title: the number of the sheet and the name of the campaign.
    blocks
        Content of the sheet from top to bottom.
    scale
        Factor by which all font sizes are scaled. It is less than 1 if the content would otherwise
        not fit on the page.
    """

    key: str
    title: str
    line: str
    blocks: tuple[Block, ...]
    scale: float = 1.0
