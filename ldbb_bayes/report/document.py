"""A report before it is a page: sections of paragraphs, lists, tables and figures, the same for HTML, Markdown and tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeAlias

from matplotlib.figure import Figure

from ldbb_bayes.report.drawing import inline_svg

__all__ = ["Bullets", "Details", "Document", "Paragraph", "Part", "Picture", "Section", "Sheet", "sheet"]


@dataclass(frozen=True)
class Paragraph:
    """Plain text."""

    text: str


@dataclass(frozen=True)
class Bullets:
    """A list of plain texts."""

    items: tuple[str, ...]


@dataclass(frozen=True)
class Sheet:
    """A table as it is read; every cell is text.

    Attributes
    ----------
    caption : str
    heads : tuple of str
        Units included.
    numeric : tuple of bool
        Columns set flush right.
    rows : tuple of tuple of str
        The first cell names the row.
    """

    caption: str
    heads: tuple[str, ...]
    numeric: tuple[bool, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure.

    Attributes
    ----------
    key : str
        Of its file.
    name : str
        What it is, for those who cannot see it.
    caption : str
    figure : Figure
    """

    key: str
    name: str
    caption: str
    figure: Figure

    @cached_property
    def svg(self) -> str:
        """The figure, drawn once."""
        return inline_svg(self.figure, self.key, self.name)


@dataclass(frozen=True)
class Details:
    """Parts that open on demand on a screen, and are printed."""

    summary: str
    parts: tuple[Paragraph | Bullets | Sheet, ...]


Part: TypeAlias = Paragraph | Bullets | Sheet | Picture | Details


@dataclass(frozen=True)
class Section:
    """A heading and what stands under it."""

    key: str
    title: str
    parts: tuple[Part, ...]


@dataclass(frozen=True)
class Document:
    """A whole report.

    Attributes
    ----------
    title : str
    lines : tuple of str
        What it is of, under the title.
    alerts : tuple of str
        What a reader must know before any number.
    sections : tuple of Section
    further : mapping of name to callable
        Draws a figure that is not on the page.
    """

    title: str
    lines: tuple[str, ...]
    alerts: tuple[str, ...]
    sections: tuple[Section, ...]
    further: Mapping[str, Callable[[], Figure]] = field(default_factory=dict)

    @property
    def pictures(self) -> Iterator[Picture]:
        """All figures in order."""
        return (part for section in self.sections for part in section.parts if isinstance(part, Picture))


def sheet(caption: str, heads: Sequence[str], rows: Sequence[Sequence[str]], *, text: Sequence[int] = ()) -> Sheet:
    """A table; columns are numbers but for the first and those of ``text``."""
    numeric = tuple(k != 0 and k not in text for k in range(len(heads)))
    return Sheet(caption, tuple(heads), numeric, tuple(tuple(row) for row in rows))
