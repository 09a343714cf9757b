"""Common style of all figures, and functions that draw elements which several figures share.

Colour-blind readers can distinguish the colours, and every axis states its unit. The functions do
not use Matplotlib's interface pyplot.
"""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Callable, Iterable, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any, ParamSpec

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from ldbb_bayes.campaign.campaign import distinct_forces
from ldbb_bayes.results import Array
from ldbb_bayes.units import display_name, display_unit

__all__ = ["PALETTE", "force_colours", "new_figure", "save_figure", "styled"]

P = ParamSpec("P")

# Width of a figure [inch]. At this width, text in the figure is legible on a screen that is 390
# pixels wide.
WIDTH = 6.3
#: Colours for lines and points. Colour-blind readers can distinguish them.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
ACCENT = PALETTE[0]
GREY = "#8C8C8C"
FAINT = "#B8B8B8"
LIGHT = "#D9D9D9"
# Dashes and gaps of a reference line, such as a nominal circle, in units of its width.
DASHED = (0, (4, 3))
# Colours of the model terms (sources of uncertainty), which are the same in all figures. The keys
# are the class names of the terms. The colours of terms that a user defines are taken from
# ``_SPARE``.
_TERM_COLOURS = {
    "BallForm": PALETTE[1],
    "BarLength": PALETTE[3],
    "Mount": PALETTE[0],
    "ForceError": PALETTE[4],
    "SetupShift": PALETTE[5],
    "Discrepancy": PALETTE[2],
    "Hysteresis": PALETTE[6],
    "Drift": "#F0E442",
    "ModelChoice": "#661100",
    "ReadingNoise": GREY,
    "Parameters": LIGHT,
}
_SPARE = ("#882255", "#44AA99", "#999933", "#332288")
# Metadata with which Matplotlib writes no date into a file. The keys are file formats. PNG is not
# among them, because PNG files have no date.
_NO_DATE: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
_STYLE = mpl.rc_params_from_file(
    Path(__file__).with_name("figures.mplstyle"), use_default_template=False
)


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Return a function that draws the same figure as ``draw``, but in the common style.

    Parameters
    ----------
    draw : callable
        Function that returns a figure.

    Returns
    -------
    callable
        Function that takes the same arguments as ``draw``, and returns the same figure in the
        common style. After a call, Matplotlib has the same settings as before.

    Examples
    --------
    >>> @lb.figures.styled
    ... def readings(test):
    ...     figure = lb.figures.new_figure(4.0, 3.0)
    ...     figure.subplots().plot(test.angle_deg, test.reading_um)
    ...     return figure
    >>> len(readings(campaign.tests[0]).axes)
    1
    """

    @functools.wraps(draw)
    def draw_styled(*args: P.args, **kwargs: P.kwargs) -> Figure:
        """Call the function ``draw``, and return its figure in the common style of all figures."""
        with mpl.rc_context(_STYLE):
            figure = draw(*args, **kwargs)
            engine = figure.get_layout_engine()
            if engine is not None:
                # Compute the layout of the figure once, and not again for every file in which it is
                # saved. Without a layout engine, Matplotlib also draws each file only once.
                engine.execute(figure)
                figure.set_layout_engine(None)
            return figure

    return draw_styled


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure. Panels that are added to the figure do not overlap.

    Parameters
    ----------
    width, height : float
        Width and height of the figure [inch].

    Returns
    -------
    Figure
        A Matplotlib figure without panels; its method ``subplots`` adds them.

    Examples
    --------
    >>> figure = lb.figures.new_figure(6.3, 3.0)
    >>> axes = figure.subplots()
    >>> figure.get_size_inches().tolist()
    [6.3, 3.0]
    """
    # The horizontal space between panels is larger than Matplotlib's default, because text may be a
    # little wider in a file with another resolution.
    return Figure(figsize=(width, height), layout=ConstrainedLayoutEngine(w_pad=0.08))


def force_colours(forces_N: Sequence[float]) -> list[Any]:
    """Return one colour per force, from light to dark with increasing force.

    Even the lightest colour is visible on white paper, also when printed in grey.

    Parameters
    ----------
    forces_N : sequence of float
        Forces [N]; equal forces get the same colour.

    Returns
    -------
    list
        Matplotlib colour of each force.

    Examples
    --------
    >>> light, dark, again = lb.figures.force_colours([36.0, 742.0, 36.0])
    >>> light == again, light == dark
    (True, False)
    """
    levels = distinct_forces(forces_N)
    places = np.searchsorted(levels, forces_N, side="right") - 1
    darkest = max(len(levels) - 1, 1)
    return [mpl.colormaps["viridis"](0.72 - 0.72 * place / darkest) for place in places]


def axis_label(name: str, unit: str) -> tuple[float, str]:
    """Return a factor and a label for an axis that shows a parameter.

    The label states the parameter and the unit, for example "C_XXX (nm/N)". The factor converts a
    value from ``unit``, the internal unit (mm, N, rad) of the parameter ``name``, to the unit in
    the label.
    """
    factor, label = display_unit(unit)
    return factor, f"{display_name(name)} ({label})"


def panels(
    count: int, columns: int, height: float, extra: float = 0.6, **options: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure with ``count`` panels, at most ``columns`` of them in a row.

    Each row is ``height`` inches high. The figure is ``extra`` inches higher than all rows
    together. Further ``options`` are passed to ``Figure.subplots``.
    """
    columns = min(count, columns)
    rows = math.ceil(count / columns)
    figure = new_figure(WIDTH, extra + height * rows)
    all_axes = list(figure.subplots(rows, columns, squeeze=False, **options).flat)
    for k, axes in enumerate(all_axes):
        if k >= count:
            axes.remove()
        elif axes.name == "rectilinear":
            axes.locator_params(nbins=5)
    return figure, all_axes[:count]


def name_rows(axes: Axes, names: Sequence[str]) -> Array:
    """Label the rows in a panel of a figure with names. The first name is at the top.

    Return the vertical positions of the rows, shape (rows,), in the order of ``names``.
    """
    rows = np.arange(len(names))[::-1]
    axes.set_yticks(rows, [display_name(name) for name in names])
    axes.set_ylim(-0.6, len(names) - 0.4)
    axes.grid(axis="y", visible=False)
    return rows


def right_labels(axes: Axes, rows: Any, texts: Sequence[str]) -> None:
    """Write a label at the right of each row in a panel of a figure.

    ``rows`` holds the vertical positions of the rows, and ``texts`` the label of each row.
    """
    for row, text in zip(rows, texts, strict=True):
        axes.text(1.015, row, text, fontsize=8, va="center", transform=axes.get_yaxis_transform())


def term_colours(terms: Iterable[str]) -> dict[str, str]:
    """Return a dict with a colour for every model term (source of uncertainty).

    ``terms`` are the class names of the terms, which are also the keys of the dict. The order of
    the keys is the order in which the bars of the terms are stacked.
    """
    distinct_terms = list(dict.fromkeys(terms))
    user_terms = [term for term in distinct_terms if term not in _TERM_COLOURS]
    colours = {term: colour for term, colour in _TERM_COLOURS.items() if term in distinct_terms}
    return colours | dict(zip(user_terms, cycle(_SPARE), strict=False))


def band(axes: Axes, x: Any, limits: Any, colour: Any, alpha: float = 0.2, **options: Any) -> None:
    """Shade the area between two curves.

    ``limits`` holds the lower and the upper curve as functions of ``x``. ``alpha`` is the opacity
    of the shade, from 0 to 1. ``options`` are passed to ``Axes.fill_between``.
    """
    axes.fill_between(x, limits[0], limits[1], color=colour, alpha=alpha, linewidth=0, **options)


def legend_below(figure: Figure, axes: Axes, columns: int = 6) -> None:
    """Put the legend of one panel below all panels of a figure.

    At most ``columns`` entries of the legend stand side by side.
    """
    handles, labels = axes.get_legend_handles_labels()
    if labels:
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), columns))


def save_figure(
    figure: Figure,
    folder: str | os.PathLike[str],
    name: str,
    *,
    formats: Sequence[str] = ("png", "svg"),
) -> list[Path]:
    """Write one figure into a folder, in one file for each format.

    The same figure always gives files with the same bytes.

    Parameters
    ----------
    figure : Figure
        The Matplotlib figure.
    folder : path
        Folder for the files. The folder is made if it does not exist.
    name : str
        Name of the files without extension.
    formats : sequence of str
        One or several file formats: png, svg or pdf.

    Returns
    -------
    list of Path
        Paths of the files that were written.

    Examples
    --------
    >>> figure = lb.figures.residuals(posterior)
    >>> [file.name for file in lb.figures.save_figure(figure, "figures", "residuals")]
    ['residuals.png', 'residuals.svg']
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for extension in formats:
        path = folder / f"{name}.{extension}"
        metadata = _NO_DATE.get(extension)
        with mpl.rc_context({"svg.hashsalt": "ldbb"}):
            figure.savefig(path, format=extension, dpi=160, metadata=metadata)
        files.append(path)
    return files
