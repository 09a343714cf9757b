"""The posterior in numbers: a table for reading and the JSON that other programs rely on."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.origin import record_of
from ldbb_bayes.inference.posterior import diagnose
from ldbb_bayes.model.columns import HYPERS

__all__ = ["check_probability", "numbers_of", "priors_of", "result_json", "summarize"]

Array = NDArray[Any]


def summarize(posterior: xr.DataTree, *, ci_prob: float = 0.95) -> pd.DataFrame:
    """One row per parameter and hyper-parameter, in inside units (mm, N, rad).

    Parameters
    ----------
    posterior : DataTree
        From `sample` or `load`.
    ci_prob : float
        Probability of the equal-tailed credible interval.

    Returns
    -------
    DataFrame
        Columns unit, mean, sd, median, ci_low, ci_high, prior_mean (of parameters with a proper prior), prior_sd, ess_bulk,
        ess_tail, rhat; ``attrs["verdict"]`` says in one line whether the numbers can be used, ``attrs["fit"]`` is that judgement
        in parts (``misfits``, ``warnings``, …).

    Raises
    ------
    InputError
        When ci_prob is not between 0 and 1.
    """
    check_probability(ci_prob)
    prior_sd, prior_mean = priors_of(posterior)
    rows = {}
    for name, variable in posterior["posterior"].data_vars.items():
        draws = variable.transpose("chain", "draw").to_numpy()
        bulk, tail, rhat = diagnose(draws)
        numbers = numbers_of(draws, ci_prob)
        rows[str(name)] = {
            "unit": variable.attrs.get("unit", ""),
            "mean": numbers["mean"],
            "sd": numbers["sd"],
            "median": numbers["median"],
            "ci_low": numbers["interval"][0],
            "ci_high": numbers["interval"][1],
            "prior_mean": prior_mean.get(str(name), np.nan),
            "prior_sd": prior_sd[str(name)],
            "ess_bulk": bulk,
            "ess_tail": tail,
            "rhat": rhat,
        }
    table = pd.DataFrame.from_dict(rows, orient="index")
    table.attrs["fit"] = record_of(posterior)["fit"]
    table.attrs["verdict"] = table.attrs["fit"]["verdict"]
    return table


def result_json(posterior: xr.DataTree, *, ci_prob: float = 0.95) -> dict[str, Any]:
    """The result of a fit as documented for ``fit --json``; the key of the interval is named after its probability."""
    check_probability(ci_prob)
    record = record_of(posterior)
    key = f"ci{100 * ci_prob:g}"
    prior_sd, prior_mean = priors_of(posterior)
    parameters: dict[str, Any] = {}
    hyper: dict[str, Any] = {}
    for name, variable in posterior["posterior"].data_vars.items():
        is_hyper = name in HYPERS
        factor = 1e3 if is_hyper else 1.0
        numbers = numbers_of(variable.to_numpy() * factor, ci_prob)
        known = prior_sd[str(name)]
        entry = {
            "unit": "um" if is_hyper else variable.attrs.get("unit", ""),
            "mean": numbers["mean"],
            "sd": numbers["sd"],
            "median": numbers["median"],
            key: numbers["interval"],
            "prior_sd": None if known is None else known * factor,
        }
        if is_hyper:
            hyper[f"{name}_um"] = entry
        else:
            parameters[str(name)] = entry | {"prior_mean": prior_mean.get(str(name))}
    model = {name: value for name, value in record["model"].items() if name not in ("toml", "prior_sd", "prior_mean", "groups")}
    campaign = {name: value for name, value in record["campaign"].items() if name not in ("fields", "test_fields", "foreseen")}
    return {
        "schema": record["schema"],
        "campaign": campaign,
        "model": model,
        "parameters": parameters,
        "hyper": hyper,
        "sampler": record["sampler"],
        "fit": record["fit"],
        "provenance": record["provenance"],
    }


def priors_of(posterior: xr.DataTree) -> tuple[dict[str, float | None], dict[str, float]]:
    """Prior sd, None where flat, and prior mean of the parameters that have a prior; zero in results older than prior means."""
    model = record_of(posterior)["model"]
    sd = model["prior_sd"]
    return sd, model.get("prior_mean", {name: 0.0 for name in model["groups"] if sd[name] is not None})


def numbers_of(draws: Array, ci_prob: float) -> dict[str, Any]:
    """Mean, sd, median and the equal-tailed interval of draws."""
    tail = 50.0 * (1.0 - ci_prob)
    low, median, high = np.percentile(draws, [tail, 50.0, 100.0 - tail])
    return {
        "mean": float(draws.mean()),
        "sd": float(draws.std(ddof=1)),
        "median": float(median),
        "interval": [float(low), float(high)],
    }


def check_probability(ci_prob: float) -> None:
    """Refuse a probability that is not between 0 and 1."""
    if not 0.0 < ci_prob < 1.0:
        raise InputError(f"ci_prob must lie between 0 and 1, got {ci_prob}. For 95 % give 0.95.")
