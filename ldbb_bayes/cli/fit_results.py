"""Functions that write the files of a fit, and add tolerances to the campaign to be fitted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import ldbb_bayes as lb
from ldbb_bayes.analysis.tolerances import (
    check_stated_tolerances,
    quantities_of,
    tolerances_in,
)
from ldbb_bayes.campaign.folder import MODEL_NAME
from ldbb_bayes.cli.output import write_files
from ldbb_bayes.inference.posterior import record_of
from ldbb_bayes.units import inside_name

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["RESULT_FILES", "with_tolerances", "write_result"]

# Names of the files and folders that a fit, and a report of the fit, write into the fit's folder. A
# new fit may replace a folder that holds nothing else.
RESULT_FILES = (
    "posterior.nc",
    "summary.json",
    MODEL_NAME,
    "report.html",
    "report.json",
    "tables",
)


def with_tolerances(
    campaign: lb.Campaign, model: lb.HybridModel, tolerances: Mapping[str, str]
) -> lb.Campaign:
    """Return a campaign with additional tolerances for quantities such as compliances.

    If the campaign already has a tolerance for the same quantity, this tolerance is replaced.

    Parameters
    ----------
    campaign
        The campaign.
    model
        Model with which the campaign will be fitted.
    tolerances
        Limits as strings, for example ``{"C_XXX": "60 nm/N"}``; the keys are names of quantities.

    Returns
    -------
    Campaign

    Raises
    ------
    InputError
        If a limit cannot be read, or the model has no such quantity.
    """
    check_stated_tolerances(campaign, model)
    if not tolerances:
        return campaign
    tolerances_in(quantities_of(model.bind(campaign)), tolerances)
    stated = {inside_name(name): limit for name, limit in tolerances.items()}
    return replace(campaign, tolerances={**campaign.tolerances, **stated})


def write_result(posterior: xr.DataTree, result: Mapping[str, Any], folder: Path) -> None:
    """Write posterior.nc, summary.json and model.toml of a fit.

    Parameters
    ----------
    posterior
        Posterior of the fit.
    result
        Summary of the fit from `ldbb_bayes.report.fit_record.full_result`.
    folder
        Folder for the files; it is created if necessary.
    """
    folder.mkdir(exist_ok=True)
    lb.save(posterior, folder / "posterior.nc")
    model_toml = record_of(posterior)["model"]["toml"]
    write_files(folder, {"summary.json": result, MODEL_NAME: model_toml})
