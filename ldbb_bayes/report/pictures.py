"""Figures of the HTML page. Each has a caption, and a name that is also its file name."""

from __future__ import annotations

import html
import io
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import matplotlib as mpl
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from ldbb_bayes.report import figures, wording

__all__ = ["PICTURES", "DrawnPicture", "Picture", "picture"]

_REFERENCE = re.compile(r'(\bid="|xlink:href="#|url\(#)')
_PROLOGUE = re.compile(r"^.*?(?=<svg)|<metadata>.*?</metadata>\s*", re.DOTALL)
_COORDINATES = re.compile(r' (?:d|x|y|points)="[^"]*"')
_LONG_NUMBER = re.compile(r"-?\d+\.\d{3,}")


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure of the HTML page, with its name and its caption.

    ``key`` is the name of the figure and of its file, without extension. Screen readers read the
    caption to blind people.
    """

    key: str
    caption: str
    figure: Figure

    @cached_property
    def svg(self) -> str:
        """The figure as SVG text, ready to be inserted into an HTML page.

        The figure adapts to the width of the screen. The title of the SVG is the caption, so that
        screen readers can read the caption. The ids of the SVG elements begin with the figure's
        name, so that no two figures of a page share an id.
        """
        text = _PROLOGUE.sub("", _draw_svg(self.figure))
        text = _REFERENCE.sub(rf"\g<1>{self.key}-", text)
        text = _COORDINATES.sub(_round_coordinates, text)
        title = f'<title id="title-{self.key}">{html.escape(self.caption)}</title>'
        start, _, content = text.partition(">")
        attributes = start.removeprefix("<svg")
        return f'<svg role="img" aria-labelledby="title-{self.key}"{attributes}>{title}{content}'


def _draw_svg(figure: Figure) -> str:
    """Return the text of an SVG file that shows a figure without background colours."""
    grounds: list[Any] = [figure.patch, *(axes.patch for axes in figure.axes)]
    visible_grounds = [ground for ground in grounds if ground.get_visible()]
    buffer = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "ldbb", "svg.fonttype": "none"}):
        for ground in visible_grounds:
            ground.set_visible(False)
        canvas: Any = FigureCanvasSVG(figure)
        # Use print_svg, because the method savefig would draw the figure twice.
        canvas.print_svg(buffer, metadata={"Date": None})
    for ground in visible_grounds:
        ground.set_visible(True)
    return buffer.getvalue()


def _round_coordinates(match: re.Match[str]) -> str:
    """Return coordinates from the text of an SVG figure, with all numbers rounded to two decimals.

    ``match`` is the match of a regular expression for coordinates.
    """
    return _LONG_NUMBER.sub(_round_number, match[0])


def _round_number(match: re.Match[str]) -> str:
    """Return a number that was found in the text of an SVG figure, rounded to two decimals."""
    return f"{float(match[0]):.2f}"


class DrawnPicture(NamedTuple):
    """A function that draws one figure of the HTML page, and the caption of the figure."""

    draw: Callable[..., Figure]
    caption: str


# Figures whose names differ from the names of the functions that draw them. The keys are the names
# of the figures, and the values are the names of the functions.
_FUNCTIONS = {"budget": "budget_bars"}
PICTURES: Mapping[str, DrawnPicture] = {
    key: DrawnPicture(getattr(figures, _FUNCTIONS.get(key, key)), caption)
    for key, caption in wording.PAGE["pictures"].items()
}


def picture(key: str, subject: Any, caption: str = "", **options: Any) -> Picture:
    """Return a figure of the HTML page, with the name of its file and its caption.

    Parameters
    ----------
    key
        Name of the figure, which must be a key of `PICTURES`. The file of the figure has the same
        name, followed by the ending of its format.
    subject
        Posterior, or result of an analysis, that the figure shows.
    caption
        Caption of the figure. Default: the caption in `PICTURES`.
    **options
        Further arguments, which are passed to the function that draws the figure.

    Returns
    -------
    Picture
    """
    entry = PICTURES[key]
    return Picture(key, caption or entry.caption, entry.draw(subject, **options))
