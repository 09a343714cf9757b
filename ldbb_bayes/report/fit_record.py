"""JSON record of a fit: all its results as one dictionary.

The command ``fit --json`` prints it, and the tables and reports of a fit are made from it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ldbb_bayes.analysis.compliance_change import change_with_force
from ldbb_bayes.analysis.conformity import assess_conformity
from ldbb_bayes.inference.force_curves import draws_at
from ldbb_bayes.inference.posterior import bound_of, campaign_of
from ldbb_bayes.inference.posterior_cache import cached_by_posterior
from ldbb_bayes.inference.summary import json_entry, result_json, summarize_nuisances
from ldbb_bayes.report.fit_description import describe_fit

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["full_result", "result_at_force"]


@cached_by_posterior
def full_result(posterior: xr.DataTree, prob: float) -> dict[str, Any]:
    """Return all results of a fit as a dictionary.

    The results include the changes of compliances with force, the coefficients of effects that are
    modelled but not of interest (nuisances), warnings, and decisions on conformity.

    Parameters
    ----------
    posterior
        Posterior of the fit.
    prob
        Probability of the credible intervals.

    Returns
    -------
    dict
        The record that the command ``fit --json`` prints.
    """
    result = result_json(posterior, prob=prob)
    changes = change_with_force(posterior, prob=prob)
    result["change_with_force"] = {name: change.as_dict() for name, change in changes.items()}
    result["nuisances"] = summarize_nuisances(posterior).to_dict(orient="index")
    result["fit"] |= describe_fit(posterior)
    if campaign_of(posterior).tolerances:
        decisions = assess_conformity(posterior)
        result["conformity"] = {name: decision.as_dict() for name, decision in decisions.items()}
    return result


def result_at_force(
    posterior: xr.DataTree, result: Mapping[str, Any], prob: float, force_N: float
) -> dict[str, Any]:
    """Return the results of a fit with the compliances C(F) at one force F.

    Parameters
    ----------
    posterior
        Posterior of the fit.
    result
        Results of the fit, see `full_result`. Their compliances are those at the model's reference
        force.
    prob
        Probability of the credible intervals.
    force_N
        Force F of the bar [N].

    Returns
    -------
    dict
        The same results; only the entries of the compliances in ``parameters`` differ.
    """
    draws_by_name = draws_at(posterior, force_N)
    parameters = dict(result["parameters"])
    for compliance in bound_of(posterior).compliances:
        name = compliance.label
        if name in parameters:
            entry = parameters[name]
            at_force = json_entry(draws_by_name[name], entry["unit"], entry["prior_sd"], prob)
            parameters[name] = entry | at_force
    return {**result, "parameters": parameters}
