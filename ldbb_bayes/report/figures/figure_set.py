"""List of all figures of a posterior, and a function that writes the figures into a folder."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import xarray as xr
from matplotlib.figure import Figure

from ldbb_bayes.report.figures.circle_figures import residuals, traces
from ldbb_bayes.report.figures.parameter_figures import compliance_against_force, corner, forest
from ldbb_bayes.report.figures.path_figures import (
    circularity,
    contributions,
    parameter_contributions,
)
from ldbb_bayes.report.figures.stiffness_figures import stiffness_rose
from ldbb_bayes.report.figures.style import save_figure

__all__ = ["FIGURES", "save_figures"]

#: Mapping from the names of the figures of a posterior to the functions that draw them.
FIGURES: Mapping[str, Callable[[xr.DataTree], Figure]] = MappingProxyType(
    {
        "traces": traces,
        "residuals": residuals,
        "forest": forest,
        "compliance_against_force": compliance_against_force,
        "stiffness_rose": stiffness_rose,
        "corner": corner,
        "contributions": contributions,
        "parameter_contributions": parameter_contributions,
        "circularity": circularity,
    }
)


def save_figures(
    posterior: xr.DataTree,
    folder: str | os.PathLike[str],
    *,
    formats: Sequence[str] = ("png", "svg"),
) -> list[Path]:
    """Draw every figure of a posterior, and write the figures into a folder.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample` or `load`.
    folder : path
        Folder for the files. The folder is made if it does not exist.
    formats : sequence of str
        One or several file formats: png, svg or pdf.

    Returns
    -------
    list of Path
        Paths of the files that were written.

    Examples
    --------
    >>> files = lb.figures.save_figures(posterior, "figures", formats=["png"])  # doctest: +SKIP
    >>> list(lb.figures.FIGURES)
    ['traces', 'residuals', 'forest', 'compliance_against_force', 'stiffness_rose', 'corner',
     'contributions', 'parameter_contributions', 'circularity']
    """
    files: list[Path] = []
    for name, draw in FIGURES.items():
        files += save_figure(draw(posterior), folder, name, formats=formats)
    return files
