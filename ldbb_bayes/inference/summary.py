"""Tables that summarize a posterior: parameters, hyper-parameters and shared nuisances.

Parameters are compliances, their changes with force, and geometric errors. Hyper-parameters φ are
quantities such as the standard deviation of the noise. Shared nuisances are effects that are
modelled but not of interest and that are common to several tests, such as ball form and bar length.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from ldbb_bayes.deprecation import renamed_keyword
from ldbb_bayes.errors import check_probability
from ldbb_bayes.inference.coefficients import ModelDraws, names_of_shared, shared_terms
from ldbb_bayes.inference.diagnostics import diagnose
from ldbb_bayes.inference.force_curves import force_curves
from ldbb_bayes.inference.posterior import bound_of, fit_of, model_draws_of, record_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, readable
from ldbb_bayes.tables import with_rows_instead

__all__ = [
    "interval_numbers",
    "json_entry",
    "priors_of",
    "result_json",
    "summarize",
    "summarize_nuisances",
]

# Entries of a posterior's record that are not copied into the JSON result of a fit. Some of these
# entries serve only to rebuild the campaign and the model. The others, such as prior standard
# deviations, are stated with each parameter of the result.
_FOR_REBUILDING = frozenset(
    ("fields", "test_fields", "foreseen", "toml", "prior_sd", "prior_mean", "groups")
)
# Largest number of posterior draws from which nuisance coefficients (of effects that are modelled
# but not of interest) are summarized.
_DRAWS = 1000


@renamed_keyword("ci_prob", "prob")
def summarize(posterior: xr.DataTree, *, prob: float = 0.95) -> pd.DataFrame:
    """Return a table with one row per parameter and hyper-parameter, in mm, N and rad.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.
    prob : float
        Probability of the equal-tailed credible interval, between 0 and 1.

    Returns
    -------
    DataFrame
        Table with the columns unit, mean, sd, median, ci_low, ci_high, prior_mean, prior_sd,
        ess_bulk, ess_tail (effective sample sizes) and rhat. The columns prior_mean and prior_sd
        are filled for proper priors only; for parameters they state the prior without the condition
        that no compliance is negative. ``attrs["fit"]`` says how well the model fits; it contains
        warnings, and states whether the numbers can be used (``state``). When the table is printed,
        units are easy to read, such as nm/N, and the row E_C0YX is shown as E_C(0Y)X. The printed
        table holds the change of each compliance C(F) over the tested forces in place of the
        coefficients of this change, such as C_XXX_1. The method ``details`` of the table prints
        these coefficients.

    Raises
    ------
    InputError
        For a probability that is not between 0 and 1, or a posterior from `to_units`.

    Examples
    --------
    >>> table = lb.summarize(posterior)
    >>> table.loc["C_YYY", "unit"]
    'mm/N'
    >>> round(table.loc["C_YYY", "mean"] * 1e6)  # nm/N
    39
    >>> table.attrs["fit"].state.value
    'usable'
    """
    check_probability(prob)
    prior_sd, prior_mean = priors_of(posterior)
    variables = posterior["posterior"].data_vars
    draws = [variable.transpose("chain", "draw").values for variable in variables.values()]
    diagnostics = diagnose(np.stack(draws, axis=2))
    rows: dict[str, dict[str, Any]] = {}
    for index, (key, variable) in enumerate(variables.items()):
        name = str(key)
        rows[name] = {
            "unit": variable.attrs.get("unit", ""),
            **interval_numbers(draws[index], prob),
            "prior_mean": prior_mean.get(name, np.nan),
            "prior_sd": prior_sd[name],
            "ess_bulk": diagnostics.ess_bulk[index],
            "ess_tail": diagnostics.ess_tail[index],
            "rhat": diagnostics.rhat[index],
        }
    table = pd.DataFrame.from_dict(rows, orient="index")
    fit = fit_of(posterior)
    table.attrs["fit"] = fit
    rhat = float(diagnostics.rhat.max())
    ess = float(min(diagnostics.ess_bulk.min(), diagnostics.ess_tail.min()))
    caption = (
        f"Posterior, {100 * prob:g} % intervals; fit {fit.state}, R-hat at most {rhat:.3f},"
        f" ESS at least {ess:.0f}"
    )
    return _with_changes(readable(table, caption), posterior, prob)


def _with_changes(table: pd.DataFrame, posterior: xr.DataTree, prob: float) -> pd.DataFrame:
    """Return ``table`` in a form that prints changes of compliances instead of coefficients.

    A change is the difference of a compliance C(F) between the smallest and the largest force
    tested. The coefficients, such as C_XXX_1, are the parameters that describe how C(F) depends on
    F. ``prob`` is the probability of the credible interval of each change, and ``posterior`` the
    posterior that the table summarizes.
    """
    curves = force_curves(posterior)
    if not curves.compliances:
        return table
    rows = {}
    for name, draws in curves.compliances.items():
        cells = dict.fromkeys(table.columns, np.nan)
        cells |= interval_numbers(draws.change, prob)
        rows[f"{name} changes by"] = {**cells, "unit": draws.unit}
    groups = record_of(posterior)["model"]["groups"]
    slopes = [name for name in table.index if groups.get(name) == "slope"]
    compliances = [name for name in table.index if groups.get(name) == "compliance"]
    table.attrs["caption"] += (
        f"; changes from {curves.smallest_force_N:.4g} N to {curves.largest_force_N:.4g} N"
    )
    return with_rows_instead(table, slopes, rows, len(compliances))


def result_json(posterior: xr.DataTree, *, prob: float = 0.95) -> dict[str, Any]:
    """Return the result of a fit in the form that the command ``fit --json`` writes.

    For every parameter and hyper-parameter, the result holds the mean, the standard deviation, the
    median and the credible interval of the posterior, and the prior standard deviation. It also
    holds most entries of the record that states how the posterior was made. Parameters are in mm, N
    and rad; hyper-parameters that are lengths are in µm. ``prob`` is the probability of the
    credible intervals. The keys of the intervals state this probability in per cent, such as
    ``ci95``.
    """
    check_probability(prob)
    record = record_of(posterior)
    result: dict[str, Any] = {"schema": record["schema"]}
    for section in ("campaign", "model"):
        entries = record[section].items()
        result[section] = {key: value for key, value in entries if key not in _FOR_REBUILDING}
    result["parameters"] = {}
    result["hyper"] = {}
    prior_sd, prior_mean = priors_of(posterior)
    for key, variable in posterior["posterior"].data_vars.items():
        name = str(key)
        unit = variable.attrs.get("unit", "")
        if name in record["model"]["groups"]:
            entry = json_entry(variable.values, unit, prior_sd[name], prob)
            result["parameters"][name] = entry | {"prior_mean": prior_mean.get(name)}
        elif unit == "mm":
            sd_mm = prior_sd[name]
            sd_um = None if sd_mm is None else sd_mm * 1e3
            result["hyper"][f"{name}_um"] = json_entry(variable.values * 1e3, "um", sd_um, prob)
        else:
            result["hyper"][name] = json_entry(variable.values, unit, prior_sd[name], prob)
    for section in ("averaged", "sampler", "fit", "provenance"):
        if section in record:
            result[section] = record[section]
    return result


def json_entry(draws: Array, unit: str, prior_sd: float | None, prob: float) -> dict[str, Any]:
    """Return the entry of one parameter or hyper-parameter in the JSON result of a fit.

    ``draws`` are the posterior draws of the parameter in ``unit``, and ``prior_sd`` is its prior
    standard deviation, or None for a flat prior. ``prob`` is the probability of the credible
    interval.
    """
    numbers = interval_numbers(draws, prob)
    interval = [numbers.pop("ci_low"), numbers.pop("ci_high")]
    return {"unit": unit, **numbers, f"ci{100 * prob:g}": interval, "prior_sd": prior_sd}


def priors_of(posterior: xr.DataTree) -> tuple[dict[str, float | None], dict[str, float]]:
    """Return two dicts: the prior standard deviations and the prior means.

    The keys of both are names of parameters. The first dict has a standard deviation for every
    parameter and hyper-parameter. For compliances, it is the standard deviation before truncation
    (the condition that no compliance is negative). For a parameter with a flat prior, it is None.
    The second dict has means only for parameters with a proper prior, not for hyper-parameters.
    Units are mm, N and rad.
    """
    model = record_of(posterior)["model"]
    return model["prior_sd"], model["prior_mean"]


def interval_numbers(draws: Array, prob: float) -> dict[str, float]:
    """Return a dict with the mean, sd, median and interval limits of ``draws``.

    The interval is the equal-tailed credible interval. ``prob`` is the probability of the interval,
    between 0 and 1.
    """
    tail = 50.0 * (1.0 - prob)
    low, median, high = np.percentile(draws, [tail, 50.0, 100.0 - tail])
    return {
        "mean": float(draws.mean()),
        "sd": float(draws.std(ddof=1)),
        "median": float(median),
        "ci_low": float(low),
        "ci_high": float(high),
    }


@one_blas_thread
def summarize_nuisances(posterior: xr.DataTree) -> pd.DataFrame:
    """Return a table of the posterior of the shared nuisance coefficients.

    Shared nuisances are effects that are modelled but not of interest and that are common to
    several tests, such as ball form and bar length.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.

    Returns
    -------
    DataFrame
        Table with the columns term, unit, mean, sd and prior_sd, and one row per coefficient. Units
        are made of mm, N, rad, bar, h and K; the unit of a pure number is 1. For the prior sd, the
        hyper-parameters (such as the standard deviation of the noise) are fixed at their posterior
        means. Coefficients of the work ball's mount are deviations from the nominal deflection of
        the mount.

    Raises
    ------
    InputError
        For a posterior from `to_units`.

    Examples
    --------
    The readings determine the eighth order of the balls' form, but hardly the length of the bar:

    >>> table = lb.inference.summarize_nuisances(posterior)
    >>> share = table["sd"] / table["prior_sd"]
    >>> (share[["form_sin8", "bar_length"]] < 0.5).to_list()
    [True, False]
    """
    draws_by_model = model_draws_of(posterior, _DRAWS)
    mean_phi = np.concatenate([draws.phi for draws in draws_by_model]).mean(axis=0)
    table = _prior_of_nuisances(bound_of(posterior), mean_phi)
    names = list(table.index)
    moments = [_nuisance_moments(draws, names) for draws in draws_by_model]
    mean = np.concatenate([of_model[0] for of_model in moments])
    variance = np.concatenate([of_model[1] for of_model in moments])
    table.insert(2, "mean", mean.mean(axis=0))
    table.insert(3, "sd", np.sqrt(variance.mean(axis=0) + mean.var(axis=0)))
    return readable(table, "Other effects of the instrument and the set-up")


def _prior_of_nuisances(bound: BoundModel, phi: Array) -> pd.DataFrame:
    """Return a table with term, unit and prior standard deviation of shared nuisance coefficients.

    Shared nuisances are effects that are modelled but not of interest and that are common to
    several tests. The prior standard deviation depends on the hyper-parameters; ``phi``, shape
    (h,), holds the values of the h hyper-parameters at which the standard deviation is computed.
    ``bound`` is the model of the campaign.
    """
    value = dict(zip(bound.hyper_prior.names, phi, strict=True))
    rows = {}
    for kind, columns in bound.columns_of.items():
        for term in shared_terms(columns):
            for name, sd in zip(term.names, term.sd_at(value), strict=True):
                unit = kind.unit_of(name).inside
                rows[name] = {"term": kind.__name__, "unit": unit, "prior_sd": sd}
    return pd.DataFrame.from_dict(rows, orient="index", columns=["term", "unit", "prior_sd"])


def _nuisance_moments(draws: ModelDraws, names: list[Any]) -> tuple[Array, Array]:
    """Return means and variances of nuisance coefficients for each posterior draw of a model.

    Nuisances are effects that are modelled but not of interest. Means and variances are conditional
    on the readings and on the parameters and hyper-parameters of the draw. Both arrays have the
    shape (draws, coefficients), and are zero for a coefficient that the model lacks. ``names`` are
    the names of the coefficients.
    """
    bound = draws.bound
    shifted = draws.beta - bound.least_squares_estimate
    _, conditional = bound.likelihood_given_parameters.conditional(draws.phi, shifted)
    position = np.array([names.index(name) for name in names_of_shared(bound)], dtype=int)
    mean = np.zeros((len(draws.phi), len(names)))
    variance = np.zeros((len(draws.phi), len(names)))
    mean[:, position] = conditional.mean
    variance[:, position] = conditional.sd**2
    return mean, variance
