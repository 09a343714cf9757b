"""Every figure is a function of a posterior (or of another result) that returns a matplotlib Figure.

PALETTE, force_colours, new_figure and styled are for figures of one's own in the same style.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import matplotlib as mpl
import xarray as xr
from matplotlib.figure import Figure

from ldbb_bayes.report.figures.bayes_factors import (
    compliance_with_local_fits,
    evidence,
    geometry_with_local_fits,
    predictive_p_values,
    rank_ecdf,
)
from ldbb_bayes.report.figures.correlations import alias_map, budget_bars, correlation_map, nuisance_costs, prior_and_posterior
from ldbb_bayes.report.figures.forests import chains, compliance_against_force, corner, difference_forest, forest
from ldbb_bayes.report.figures.plans import efficiency, expected_widths, information, trade_off
from ldbb_bayes.report.figures.polar import (
    circularity,
    compliance_atlas,
    contributions,
    geometric_atlas,
    parameter_contributions,
    predictive,
    residuals,
    traces,
)
from ldbb_bayes.report.figures.style import PALETTE, force_colours, new_figure, styled

__all__ = [
    "FIGURES",
    "PALETTE",
    "alias_map",
    "budget_bars",
    "chains",
    "circularity",
    "compliance_against_force",
    "compliance_atlas",
    "compliance_with_local_fits",
    "contributions",
    "corner",
    "correlation_map",
    "difference_forest",
    "efficiency",
    "evidence",
    "expected_widths",
    "force_colours",
    "forest",
    "geometric_atlas",
    "geometry_with_local_fits",
    "information",
    "new_figure",
    "nuisance_costs",
    "parameter_contributions",
    "predictive",
    "predictive_p_values",
    "prior_and_posterior",
    "rank_ecdf",
    "residuals",
    "save_figure",
    "save_figures",
    "styled",
    "traces",
    "trade_off",
]

FIGURES: Mapping[str, Callable[[xr.DataTree], Figure]] = MappingProxyType(
    {
        "traces": traces,
        "residuals": residuals,
        "forest": forest,
        "compliance_against_force": compliance_against_force,
        "corner": corner,
        "chains": chains,
        "predictive": predictive,
        "contributions": contributions,
        "parameter_contributions": parameter_contributions,
        "circularity": circularity,
    }
)


def save_figures(
    posterior: xr.DataTree, folder: str | os.PathLike[str], *, formats: tuple[str, ...] = ("png", "svg")
) -> list[Path]:
    """Draw every figure into a folder; returns the files written."""
    return [path for name, draw in FIGURES.items() for path in save_figure(draw(posterior), folder, name, formats=formats)]


def save_figure(
    figure: Figure, folder: str | os.PathLike[str], name: str, *, formats: tuple[str, ...] = ("png", "svg")
) -> list[Path]:
    """Write one figure into a folder under a name, the same bytes for the same figure; returns the files written."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    written = [folder / f"{name}.{kind}" for kind in formats]
    for path, kind in zip(written, formats, strict=True):
        with mpl.rc_context({"svg.hashsalt": "ldbb"}):
            figure.savefig(path, format=kind, dpi=160, metadata={"Date": None} if kind == "svg" else None)
    return written
