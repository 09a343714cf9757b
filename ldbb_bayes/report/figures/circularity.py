"""Circular-test quantities of ISO 230-4 against force."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ldbb_bayes.analysis.circularity import circularity as quantities
from ldbb_bayes.analysis.circularity import measured_circularity
from ldbb_bayes.inference.origin import bound_of
from ldbb_bayes.report.figures.style import PALETTE, new_figure, styled

__all__ = ["circularity"]

_POINTS, _DRAWS = 25, 500
_PANELS = (
    (("G", "G_minimum_zone"), "Circular deviation (µm)"),
    (("F_max", "F_min"), "Radial deviation (µm)"),
    (("squareness",), "Squareness (µm/m)"),
    (("scale_mismatch",), "Scale mismatch (µm/m)"),
)
_WORDS = {
    "G": "G, least-squares centre",
    "G_minimum_zone": "G, minimum zone",
    "F_max": "F_max",
    "F_min": "F_min",
    "squareness": "squareness",
    "scale_mismatch": "scale mismatch",
}


@styled
def circularity(posterior: xr.DataTree) -> Figure:
    """G, F_max and F_min, squareness and scale mismatch of the machine's path against force with 95 % bands; crosses: of the
    readings themselves, balls and bar included."""
    bound = bound_of(posterior)
    top = float(bound.setting.force_N.max())
    table = quantities(posterior, np.linspace(0.0, top, _POINTS).tolist(), draws=_DRAWS, both_ways=False)
    measured, _ = measured_circularity(posterior)
    planes = bound.setting.planes
    figure = new_figure(9.6, 0.3 + 5.2 * len(planes))
    panels = figure.subplots(2 * len(planes), 2, squeeze=False)
    for k, plane in enumerate(planes):
        own = table[table["plane"] == plane]
        # Other radii have other paths: only readings of the circle that is drawn.
        read = measured[(measured["plane"] == plane) & (measured["radius_mm"] == own["radius_mm"].iloc[0])]
        for axes, (names, label) in zip(panels[2 * k : 2 * k + 2].flat, _PANELS, strict=True):
            for name, colour in zip(names, PALETTE, strict=False):
                _quantity(axes, own[own["quantity"] == name], read, name, colour)
            axes.set_ylabel(label)
            axes.set_xlabel("force (N)")
            axes.set_xlim(-0.02 * top, 1.02 * top)
            axes.legend(loc="best")
            if len(planes) > 1:
                axes.set_title(f"Plane {plane}")
    figure.suptitle("The machine's path, 95 % band; crosses: the readings, balls and bar included", fontsize=9.5)
    return figure


def _quantity(axes: Axes, rows: pd.DataFrame, read: pd.DataFrame, name: str, colour: str) -> None:
    axes.fill_between(rows["force_N"], rows["ci_low"], rows["ci_high"], color=colour, alpha=0.2, linewidth=0)
    axes.plot(rows["force_N"], rows["median"], color=colour, label=_WORDS[name])
    axes.plot(read["force_N"], read[name].astype(float), "x", color=colour, markersize=5)
