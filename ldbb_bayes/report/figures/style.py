"""One style for every figure: colour-blind safe, units on every axis, no pyplot."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, ParamSpec, cast

import matplotlib as mpl
from matplotlib.figure import Figure

from ldbb_bayes.units import display_name, display_unit

__all__ = ["ACCENT", "GREY", "PALETTE", "TERM_COLOURS", "axis_label", "force_colours", "new_figure", "styled"]

P = ParamSpec("P")

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
ACCENT, GREY = PALETTE[0], "#8C8C8C"
# One colour per source of uncertainty in every figure.
TERM_COLOURS = {
    "BallForm": PALETTE[1],
    "BarLength": PALETTE[3],
    "Mount": PALETTE[0],
    "ForceError": PALETTE[4],
    "SetupShift": PALETTE[5],
    "Discrepancy": PALETTE[2],
    "Hysteresis": PALETTE[6],
    "Drift": "#F0E442",
    "ReadingNoise": GREY,
    "Parameters": "#D9D9D9",
}
_STYLE: dict[str, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "normal",
    "axes.labelsize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E3E3E3",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "lines.linewidth": 1.2,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "savefig.dpi": 160,
    "svg.hashsalt": "ldbb",
    "svg.fonttype": "none",
    "text.parse_math": False,
}


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Draw under the common style, leaving the caller's settings alone."""

    @functools.wraps(draw)
    def inner(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with mpl.rc_context(cast("Any", _STYLE)):
            return draw(*args, **kwargs)

    return inner


def new_figure(width: float, height: float) -> Figure:
    """An empty figure [inch] whose parts keep clear of one another."""
    return Figure(figsize=(width, height), layout="constrained")


def force_colours(forces_N: Sequence[float]) -> list[Any]:
    """One colour per force, light to dark in order of force."""
    cmap = mpl.colormaps["viridis"]
    order = sorted(set(forces_N))
    return [cmap(0.9 - 0.85 * (order.index(force) / max(len(order) - 1, 1))) for force in forces_N]


def axis_label(name: str, unit: str) -> tuple[float, str]:
    """Factor and label for an axis that shows a parameter in its unit for reading."""
    factor, label = display_unit(unit)
    return factor, f"{display_name(name)} ({label})"
