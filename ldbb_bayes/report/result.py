"""The JSON of a fit with what a look at the readings adds."""

from __future__ import annotations

from typing import Any

import xarray as xr

from ldbb_bayes.analysis.preview import preview
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.nuisances import nuisances
from ldbb_bayes.inference.origin import campaign_of
from ldbb_bayes.inference.summary import result_json

__all__ = ["full_result", "look_warnings", "sizes_of"]


def full_result(posterior: xr.DataTree, ci_prob: float) -> dict[str, Any]:
    """The JSON of a fit, with nuisances, and what a look at the readings finds among its warnings."""
    result = result_json(posterior, ci_prob=ci_prob)
    result["nuisances"] = nuisances(posterior).to_dict(orient="index")
    result["fit"]["warnings"] += look_warnings(campaign_of(posterior))
    return result


def look_warnings(campaign: Campaign) -> list[str]:
    """What a look at the readings adds to a fit's own warnings."""
    seen = preview(campaign)
    every = [f"Look at {test.name}: {remark}." for test in seen.tests for remark in test.remarks]
    return every + [remark for remark in seen.remarks if not remark.startswith(("One", "Two"))]


def sizes_of(posterior: xr.DataTree) -> dict[str, list[float]]:
    """Means and U (k = 2) of the parameters by inside unit: what units for reading are chosen by."""
    found: dict[str, list[float]] = {}
    for entry in result_json(posterior)["parameters"].values():
        found.setdefault(entry["unit"], []).extend((entry["mean"], 2.0 * entry["sd"]))
    return found
