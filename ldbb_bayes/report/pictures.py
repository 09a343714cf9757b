"""Figures of the HTML page. Each has a caption, and a name that is also its file name."""

from __future__ import annotations

import html
import io
import re
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import matplotlib as mpl
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from ldbb_bayes.parallel import start_early
from ldbb_bayes.report import figures, wording
from ldbb_bayes.report.figure_translation import translate_figure

__all__ = ["PICTURES", "DrawnPicture", "Picture", "begin_to_draw", "picture"]

_REFERENCE = re.compile(r'(\bid="|xlink:href="#|url\(#)')
_PROLOGUE = re.compile(r"^.*?(?=<svg)|<metadata>.*?</metadata>\s*", re.DOTALL)
_COORDINATES = re.compile(r' (?:d|x|y|points)="[^"]*"')
_LONG_NUMBER = re.compile(r"-?\d+\.\d{3,}")


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure of the HTML page, with its name and its caption.

    The figure is drawn when it is needed for the first time.

    Parameters
    ----------
    key
        Name of the figure and of its file, without extension.
    caption
        Caption of the figure. Screen readers read it to blind people.
    draw
        Function without arguments that draws the figure.
    wait_for_svg
        Function that returns the SVG text of the figure once another process has drawn it. If it is
        None, this process draws the figure.
    """

    key: str
    caption: str
    draw: Callable[[], Figure]
    wait_for_svg: Callable[[], str] | None = None

    @cached_property
    def figure(self) -> Figure:
        """The figure, drawn by this process."""
        return self.draw()

    @cached_property
    def svg(self) -> str:
        """The figure as SVG text, ready to be inserted into an HTML page.

        The figure adapts to the width of the screen. The title of the SVG is the caption, so that
        screen readers can read the caption. The ids of the SVG elements begin with the figure's
        name, so that no two figures of a page share an id.
        """
        if self.wait_for_svg is not None:
            return self.wait_for_svg()
        text = _PROLOGUE.sub("", _draw_svg(self.figure))
        text = _REFERENCE.sub(rf"\g<1>{self.key}-", text)
        text = _COORDINATES.sub(_round_coordinates, text)
        title = f'<title id="title-{self.key}">{html.escape(self.caption)}</title>'
        start, _, content = text.partition(">")
        attributes = start.removeprefix("<svg")
        return f'<svg role="img" aria-labelledby="title-{self.key}"{attributes}>{title}{content}'

    def in_language(self, translate: Callable[[str], str]) -> Picture:
        """Return the same figure with all its texts, and its caption, translated.

        ``translate`` returns the translation of one line of text.
        """
        return Picture(
            self.key, translate(self.caption), partial(_draw_translated, self.draw, translate)
        )


def begin_to_draw(pictures: Sequence[Picture], executor: Executor | None) -> list[Picture]:
    """Begin to draw figures in another process, and return the figures, which wait for it.

    Parameters
    ----------
    pictures
        The figures.
    executor
        Executor with another process. If it is None, the figures are returned unchanged.

    Returns
    -------
    list of Picture
        The same figures. `Picture.svg` waits for a figure that the other process is drawing; a
        figure that it has not begun by then is drawn in this process.
    """
    if executor is None:
        return list(pictures)
    begun = []
    for entry in pictures:
        begun.append(replace(entry, wait_for_svg=start_early(partial(_svg_of, entry), executor)))
    return begun


def _svg_of(entry: Picture) -> str:
    """Return the SVG text of a figure."""
    return entry.svg


def _draw_translated(draw: Callable[[], Figure], translate: Callable[[str], str]) -> Figure:
    """Draw a figure with the function ``draw``, and translate its texts."""
    figure = draw()
    translate_figure(figure, translate)
    return figure


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
    return Picture(key, caption or entry.caption, partial(entry.draw, subject, **options))
