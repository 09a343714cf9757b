"""Conformity with tolerances of one machine, decided from each campaign of its trend.

A decision follows from one campaign, and from what the other campaigns say of the errors and
effects that all have in common.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ldbb_bayes.analysis.decision_rule import Conformity, Decision
from ldbb_bayes.analysis.normal_conformity import normal_conformity, stiffness_conformity
from ldbb_bayes.analysis.tolerances import Quantity, Tolerance, quantities, tolerances_in
from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.control_limits import ChartPoints
from ldbb_bayes.fleet.fleet_statistics import FleetStatistics
from ldbb_bayes.fleet.selection import Caveat, CaveatKind
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.parameter_kinds import is_possible
from ldbb_bayes.units import inside_name, is_compliance_or_slope, is_direct, is_slope

__all__ = ["caveats_of_tolerances", "conformities_of_campaigns"]

# The readings of a campaign say nothing about a parameter if the precision of its likelihood, in
# units of the reference standard deviation, is below this number.
_NO_INFORMATION = 1e-6
# Beginning of the name of a stiffness along an axis, such as stiffness_X.
_STIFFNESS = "stiffness_"


def conformities_of_campaigns(
    statistics: FleetStatistics,
    campaigns: Sequence[str],
    series: Gaussian,
    chart: ChartPoints,
    tolerances: Mapping[str, str | Tolerance] | None,
    newest_tolerances: Any,
) -> dict[str, dict[str, Conformity]]:
    """Return the decisions on conformity with tolerances for each quantity.

    The result is a dictionary of dictionaries. The outer keys are the names of the quantities
    (parameters or stiffnesses), and the inner keys are the names of the campaigns. Each decision
    follows from one campaign, and from what the others say of the errors and effects that all have
    in common. The uncertainties include the uncertainty that these errors and effects cause in all
    campaigns together.

    Parameters
    ----------
    statistics : likelihoods of the campaigns.
    campaigns : names of the campaigns, in order of time.
    series : likelihoods of the campaigns, in order of time. Of a parameter on which the readings of
        a campaign say nothing, no decision is made.
    chart : estimates from each campaign.
    tolerances : tolerances of quantities; the keys are the names of the quantities. They replace
        those of the same quantities in ``newest_tolerances``.
    newest_tolerances : tolerances in the record of the newest campaign, as JSON text. Those of
        quantities that are not followed over time have no decision; `caveats_of_tolerances` says
        so.
    """
    followed = _followed_quantities(statistics)
    chosen: Mapping[str, str | Tolerance] = tolerances or {}
    _check_followed(chosen, followed)
    limits = tolerances_in(followed, chosen)
    for name, text in _stated_tolerances(newest_tolerances).items():
        if name in followed and name not in limits:
            limits |= tolerances_in(followed, {name: text})
    conformities = {}
    for name, tolerance in limits.items():
        j = _parameter_of(name, statistics.parameters)
        mean = chart.estimate[:, j] * statistics.prior_sd[j]
        sd = np.hypot(chart.sd[:, j], chart.common_sd[j]) * statistics.prior_sd[j]
        is_stiffness = name.startswith(_STIFFNESS)
        decide = stiffness_conformity if is_stiffness else normal_conformity
        force_N = None
        if is_compliance_or_slope(statistics.parameters[j]):
            force_N = statistics.reference_force_N
        decisions = {}
        for i, campaign in enumerate(campaigns):
            decision = decide(followed[name].unit, float(mean[i]), float(sd[i]), tolerance)
            if series.precision[i, j, j] < _NO_INFORMATION:
                decision = replace(decision, decision=Decision.NOT_DECIDED)
            decisions[campaign] = replace(decision, force_N=force_N)
        conformities[name] = decisions
    return conformities


def caveats_of_tolerances(statistics: FleetStatistics, newest_tolerances: Any) -> list[Caveat]:
    """Return caveats on tolerances of the newest campaign on which the trend makes no decision.

    One caveat names the quantities that the trend could follow, and the parameters to choose for
    this. Another names the quantities that no trend follows, such as the circular deviation G.

    Parameters
    ----------
    statistics : likelihoods of the campaigns.
    newest_tolerances : tolerances in the record of the newest campaign, as JSON text.
    """
    followed = _followed_quantities(statistics)
    parameters = list(statistics.parameters)
    could_follow = []
    never_followed = []
    for name in _stated_tolerances(newest_tolerances):
        if name in followed:
            continue
        parameter = _parameter_to_follow(name)
        if parameter is None:
            never_followed.append(name)
            continue
        could_follow.append(name)
        if parameter not in parameters:
            parameters.append(parameter)
    caveats = []
    if could_follow:
        kind = CaveatKind.TOLERANCES_NOT_FOLLOWED
        caveats.append(Caveat(kind, tuple(could_follow), text=",".join(parameters)))
    if never_followed:
        caveats.append(Caveat(CaveatKind.TOLERANCES_WITHOUT_TREND, tuple(never_followed)))
    return caveats


def _followed_quantities(statistics: FleetStatistics) -> dict[str, Quantity]:
    """Return the quantities on which a trend can decide; the keys are their names."""
    return quantities(dict(zip(statistics.parameters, statistics.units, strict=True)))


def _stated_tolerances(newest_tolerances: Any) -> dict[str, str]:
    """Return the tolerances in the record of a campaign, which is JSON text or missing.

    The keys are the names of the quantities.
    """
    stated = json.loads(newest_tolerances or "{}")
    return {inside_name(name): text for name, text in stated.items()}


def _check_followed(chosen: Mapping[str, Any], followed: Mapping[str, Quantity]) -> None:
    """Raise an `InputError` for the tolerance of a parameter that the trend does not follow.

    The keys of ``chosen`` are names of quantities as the user stated them, and those of
    ``followed`` the names of all quantities that the trend follows. A name that no trend can follow
    is left to the check of all names.
    """
    for stated_name in chosen if isinstance(chosen, Mapping) else ():
        name = inside_name(stated_name)
        parameter = _parameter_to_follow(name)
        if name in followed or parameter is None:
            continue
        parameters = ",".join([*(one for one in followed if is_possible(one)), parameter])
        raise InputError(
            f"tolerance must be of a parameter that the trend follows, got {name!r}, which it does"
            f" not. Follow it too: --parameters {parameters} (parameters=[…] in Python)."
        )


def _parameter_to_follow(quantity: str) -> str | None:
    """Return the parameter that a trend has to follow to decide on a quantity.

    It is the quantity itself, or the compliance of a stiffness along an axis. The result is None if
    no trend decides on the quantity, as on a change of compliance with force.
    """
    axis = quantity.removeprefix(_STIFFNESS)
    parameter = quantity if axis == quantity else f"C_{3 * axis}"
    if is_slope(parameter) or not is_possible(parameter):
        return None
    return parameter


def _parameter_of(quantity: str, parameters: Sequence[str]) -> int:
    """Return the index in ``parameters`` of the parameter that determines a quantity.

    The quantity is either a parameter itself or the stiffness along an axis. The stiffness along X,
    for example, is determined by the compliance C_XXX. Raise an `InputError` if there is no such
    parameter.
    """
    for j, name in enumerate(parameters):
        if quantity == name or (is_direct(name) and quantity == f"stiffness_{name[2]}"):
            return j
    raise InputError(f"{quantity} must be a quantity of the trend, got another. Leave it out.")
