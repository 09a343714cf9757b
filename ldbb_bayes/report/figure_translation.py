"""Translation of the texts of a figure: titles, legends, and labels at the ticks of its axes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import Formatter

__all__ = ["translate_figure", "translate_ticks"]


class _TranslatedFormatter(Formatter):
    """Formatter of tick labels that translates the labels of another formatter."""

    def __init__(self, formatter: Formatter, translate: Callable[[str], str]) -> None:
        """Make a formatter for the labels at the ticks of a figure's axis.

        ``formatter`` makes the labels, and ``translate`` returns the translation of a label.
        """
        self._formatter = formatter
        self._translate = translate

    def __call__(self, value: float, position: int | None = None) -> str:
        """Return the translated label of one tick of a figure's axis."""
        return self._translate(self._formatter(value, position))

    def format_ticks(self, values: Any) -> list[str]:
        """Return the translated labels of all ticks of a figure's axis."""
        return [self._translate(label) for label in self._formatter.format_ticks(values)]

    def get_offset(self) -> str:
        """Return the common factor of an axis's tick labels, such as 1e−5, without translation."""
        return self._formatter.get_offset()

    def set_axis(self, axis: Any) -> None:
        """Set the figure's axis whose ticks are labelled, as Matplotlib requires of a formatter."""
        self._formatter.set_axis(axis)

    def set_locs(self, locs: Any) -> None:
        """Set the positions of the ticks to be labelled, as Matplotlib requires of a formatter."""
        self._formatter.set_locs(locs)


def translate_ticks(figure: Figure, translate: Callable[[str], str]) -> None:
    """Replace the labels at the ticks of all axes of a figure by their translations.

    The figure itself is changed; no copy is made.

    Parameters
    ----------
    figure
        The figure.
    translate
        Function that returns the translation of a label.
    """
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            formatter = axis.get_major_formatter()
            # Panels of a figure that share a scale also share the formatter of the tick labels,
            # which must be replaced only once.
            if not isinstance(formatter, _TranslatedFormatter):
                axis.set_major_formatter(_TranslatedFormatter(formatter, translate))


def translate_figure(figure: Figure, translate: Callable[[str], str]) -> None:
    """Replace all texts of a figure, except the labels at its ticks, by their translations.

    The figure itself is changed; no copy is made. `translate_ticks` translates the labels at the
    ticks.

    Parameters
    ----------
    figure
        The figure.
    translate
        Function that returns the translation of one line of text.
    """
    tick_labels = set()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            tick_labels.update(axis.get_ticklabels())
    for label in figure.findobj(Text):
        if label in tick_labels:
            continue
        lines = [translate(line) for line in label.get_text().split("\n")]
        label.set_text("\n".join(lines))
    translate_ticks(figure, translate)
