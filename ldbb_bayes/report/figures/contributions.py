"""What compliance and geometry contribute to the reading (the paper's Figs. 8-10)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ldbb_bayes.analysis.circularity import first_circle
from ldbb_bayes.analysis.contributions import COMPLIANCE, GEOMETRY, TOGETHER, contribution_paths
from ldbb_bayes.inference.origin import bound_of, draws_of
from ldbb_bayes.report.figures.style import PALETTE, force_colours, new_figure, styled
from ldbb_bayes.units import display_name

__all__ = ["contributions", "parameter_contributions"]

Array = NDArray[Any]
_DRAWS, _MOST = 400, 10
_DEGREES = np.arange(361)


@styled
def contributions(posterior: xr.DataTree) -> Figure:
    """Compliance, geometry and both against angle at every force, with 95 % bands; offsets of the tool ball left out (Fig. 8)."""
    bound = bound_of(posterior)
    beta, _ = draws_of(posterior, bound, _DRAWS)
    forces = np.unique(bound.setting.force_N)
    forces = forces[np.unique(np.linspace(0, len(forces) - 1, _MOST).round().astype(int))]
    planes = bound.setting.planes
    figure = new_figure(9.6, 0.6 + 3.0 * len(planes))
    panels = figure.subplots(len(planes), 3, sharey="row", squeeze=False)
    for plane, row in zip(planes, panels, strict=True):
        r = first_circle(bound, plane)
        for force, colour in zip(forces, force_colours(forces.tolist()), strict=True):
            found = contribution_paths(bound, r, float(force), beta)
            for axes, source in zip(row, (TOGETHER, COMPLIANCE, GEOMETRY), strict=True):
                if source in found and (source != GEOMETRY or force == forces[-1]):
                    _band(axes, found[source], colour if source != GEOMETRY else "black", f"{force:g} N")
        where = f" in plane {plane}" if len(planes) > 1 else ""
        for axes, title in zip(row, (f"Both{where}", f"Compliance{where}", f"Geometry{where}, at any force"), strict=True):
            axes.set_title(title)
            _angles(axes)
        row[0].set_ylabel("contribution (µm)")
    handles, labels = panels[0, 1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 6))
    return figure


@styled
def parameter_contributions(posterior: xr.DataTree) -> Figure:
    """Every compliance (with its slope) and every geometric error at the highest force, with 95 % bands (Figs. 9 and 10)."""
    bound = bound_of(posterior)
    beta, _ = draws_of(posterior, bound, _DRAWS)
    force = float(bound.setting.force_N.max())
    planes = bound.setting.planes
    figure = new_figure(10.4, 0.4 + 6.2 * len(planes))
    panels = figure.subplots(2 * len(planes), 2, squeeze=False)
    for k, plane in enumerate(planes):
        found = contribution_paths(bound, first_circle(bound, plane), force, beta)
        single = {name: path for name, path in found.items() if name not in (TOGETHER, COMPLIANCE, GEOMETRY)}
        where = f", plane {plane}" if len(planes) > 1 else ""
        for row, kind, words in ((2 * k, "C_", f"Compliances at {force:g} N"), (2 * k + 1, "E_", "Geometric errors")):
            own = {name: path for name, path in single.items() if name.startswith(kind)}
            large, small = _split(own)
            _lines(panels[row, 0], own, large, f"{words}{where}: the largest")
            _lines(panels[row, 1], own, small, f"{words}{where}: the others")
    return figure


def _split(paths: Mapping[str, Array]) -> tuple[list[str], list[str]]:
    """Those that reach a third of the largest, and the rest."""
    size = {name: float(np.ptp(path.mean(axis=0))) for name, path in paths.items()}
    limit = max(size.values(), default=0.0) / 3.0
    return [name for name in size if size[name] >= limit], [name for name in size if size[name] < limit]


def _lines(axes: Axes, paths: Mapping[str, Array], names: Sequence[str], title: str) -> None:
    axes.set_title(title)
    axes.set_ylabel("contribution (µm)")
    _angles(axes)
    colours = dict(zip(paths, (*PALETTE, "#8C8C8C", "#F0E442") * 4, strict=False))
    for name in names:
        _band(axes, paths[name], colours[name], f"{display_name(name)}: {np.ptp(paths[name].mean(axis=0)):.2g} µm p-p")
    if not names:
        axes.text(0.5, 0.5, "none", ha="center", va="center", transform=axes.transAxes)
        return
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)


def _band(axes: Axes, path: Array, colour: Any, label: str) -> None:
    closed = np.concatenate([path, path[:, :1]], axis=1)
    low, high = np.quantile(closed, [0.025, 0.975], axis=0)
    axes.fill_between(_DEGREES, low, high, color=colour, alpha=0.2, linewidth=0)
    axes.plot(_DEGREES, closed.mean(axis=0), color=colour, label=label)


def _angles(axes: Axes) -> None:
    axes.set_xlim(0.0, 360.0)
    axes.set_xticks(range(0, 361, 90))
    axes.set_xlabel("angle of the bar (°)")
