"""Tables of a posterior: parameters, hyper-parameters and shared nuisances."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ldbb_bayes.errors import require
from ldbb_bayes.inference.coefficients import (
    shared_terms,
)
from ldbb_bayes.inference.diagnostics import diagnose
from ldbb_bayes.inference.posterior import bound_of, fit_of, model_draws_of, record_of
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, readable

__all__ = ["check_probability", "nuisances", "numbers_of", "priors_of", "result_json", "summarize"]

if TYPE_CHECKING:
    import xarray as xr


# What the record keeps so that the campaign and the model can be made again.
_REBUILDS = ("fields", "test_fields", "foreseen", "toml", "prior_sd", "prior_mean", "groups")


_DRAWS = 1000


def summarize(posterior: xr.DataTree, *, ci_prob: float = 0.95) -> pd.DataFrame:
    """One row per parameter and hyper-parameter, in inside units (mm, N, rad).

    Parameters
    ----------
    posterior : from `sample` or `load`.
    ci_prob : probability of the equal-tailed credible interval.

    Returns
    -------
    Columns unit, mean, sd, median, ci_low, ci_high, prior_mean and prior_sd (of proper priors; of
    parameters before truncation), ess_bulk, ess_tail, rhat; ``attrs["fit"]`` is the `Fit`: whether
    the numbers can be used (``state``), and what to mind.
    """
    check_probability(ci_prob)
    prior_sd, prior_mean = priors_of(posterior)
    variables = posterior["posterior"].data_vars
    draws = [variable.transpose("chain", "draw").values for variable in variables.values()]
    rows = {}
    for (key, variable), own, quality in zip(
        variables.items(), draws, np.transpose(diagnose(np.stack(draws, axis=2))), strict=True
    ):
        prior = {"prior_mean": prior_mean.get(str(key), np.nan), "prior_sd": prior_sd[str(key)]}
        diagnostics = dict(zip(("ess_bulk", "ess_tail", "rhat"), quality, strict=True))
        rows[str(key)] = (
            {"unit": variable.attrs.get("unit", "")}
            | numbers_of(own, ci_prob)
            | prior
            | diagnostics
        )
    table = pd.DataFrame.from_dict(rows, orient="index")
    table.attrs["fit"] = fit_of(posterior)
    return readable(table, f"Posterior, {100 * ci_prob:g} % intervals")


def result_json(posterior: xr.DataTree, *, ci_prob: float = 0.95) -> dict[str, Any]:
    """The result of a fit as documented for ``fit --json``; the key of the interval is named after
    its probability."""
    check_probability(ci_prob)
    record = record_of(posterior)
    prior_sd, prior_mean = priors_of(posterior)
    shown: dict[str, Any] = {"schema": record["schema"]}
    for part in ("campaign", "model"):
        shown[part] = {key: value for key, value in record[part].items() if key not in _REBUILDS}
    shown |= {"parameters": {}, "hyper": {}}
    for key, variable in posterior["posterior"].data_vars.items():
        name = name_shown = str(key)
        unit = variable.attrs.get("unit", "")
        factor = 1.0
        is_hyper = name not in record["model"]["groups"]
        if is_hyper and unit == "mm":
            name_shown = f"{name}_um"
            unit = "um"
            factor = 1e3
        numbers = numbers_of(variable.values * factor, ci_prob)
        interval = [numbers.pop("ci_low"), numbers.pop("ci_high")]
        sd = prior_sd[name]
        entry = {
            "unit": unit,
            **numbers,
            f"ci{100 * ci_prob:g}": interval,
            "prior_sd": None if sd is None else sd * factor,
        }
        if is_hyper:
            shown["hyper"][name_shown] = entry
        else:
            shown["parameters"][name] = entry | {"prior_mean": prior_mean.get(name)}
    return shown | {
        part: record[part]
        for part in ("averaged", "sampler", "fit", "provenance")
        if part in record
    }


def priors_of(posterior: xr.DataTree) -> tuple[dict[str, float | None], dict[str, float]]:
    """Prior sd, None where flat, and prior mean of the parameters that have a prior."""
    model = record_of(posterior)["model"]
    return model["prior_sd"], model["prior_mean"]


def numbers_of(draws: Array, ci_prob: float) -> dict[str, float]:
    """Mean, sd, median, and ci_low and ci_high of the equal-tailed interval, of draws."""
    tail = 50.0 * (1.0 - ci_prob)
    low, median, high = map(float, np.percentile(draws, [tail, 50.0, 100.0 - tail]))
    return {
        "mean": float(draws.mean()),
        "sd": float(draws.std(ddof=1)),
        "median": median,
        "ci_low": low,
        "ci_high": high,
    }


def check_probability(ci_prob: float) -> None:
    """Refuse a probability that is not between 0 and 1."""
    require(
        0.0 < ci_prob < 1.0, f"ci_prob must lie between 0 and 1, got {ci_prob}. For 95 % give 0.95."
    )


@one_blas_thread
def nuisances(posterior: xr.DataTree) -> pd.DataFrame:
    """Posterior of the shared nuisance coefficients.

    Returns
    -------
    One row per coefficient: term, unit (mm; per bar, N, h or K), mean, sd, prior_sd (at the
    posterior mean of φ). The mount's is its deviation from the nominal deflection.
    """
    bound = bound_of(posterior)
    parts = model_draws_of(posterior, _DRAWS)
    value = dict(
        zip(
            bound.hyper_prior.names,
            np.concatenate([part.phi for part in parts]).mean(axis=0),
            strict=True,
        )
    )
    rows = {
        name: {"term": kind.__name__, "unit": kind.unit_of(name).inside, "prior_sd": sd}
        for kind, columns in bound.columns_of.items()
        for part in shared_terms(columns)
        for name, sd in zip(part.names, part.sd_at(value), strict=True)
    }
    table = pd.DataFrame.from_dict(rows, orient="index", columns=["term", "unit", "prior_sd"])
    means, variances = (
        np.zeros((sum(len(part.phi) for part in parts), len(table))) for _ in range(2)
    )
    end = 0
    for own, phi, beta in parts:
        given = own.given_interest.conditional(phi, beta - own.centre)[1]
        names = [name for part in shared_terms(own.nuisance_columns) for name in part.names]
        at = np.ix_(
            np.arange(end, end := end + len(phi)),
            np.array(list(map(list(table.index).index, names)), dtype=int),
        )
        means[at], variances[at] = given.mean, given.sd**2
    table.insert(2, "mean", means.mean(axis=0))
    table.insert(3, "sd", np.sqrt(variances.mean(axis=0) + means.var(axis=0)))
    return readable(table, "Other effects of the instrument and the set-up")
