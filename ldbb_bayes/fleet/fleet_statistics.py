"""Gaussian likelihoods of machine parameters, one from each campaign of a batch.

ln p(y_i | c_i, b) = −½ (c_i, b)ᵀ Λ_i (c_i, b) + η_iᵀ (c_i, b) + const

y_i are the readings of campaign i. c_i are those parameters of the machine in campaign i that are
to be compared; the compliances of all campaigns are given for one reference force. b are two errors
of the instrument, that of the mount's deflection and that of the force, which are the same in all
campaigns. Λ_i is a precision matrix (inverse of a covariance matrix), and η_i is the shift, that
is, Λ_i times the estimate of (c_i, b).

The changes of compliances with force belong to the machine. If a machine has several campaigns,
they are variables of the likelihoods as well (`machine_effects`).

All other unknowns are integrated out in each campaign separately, as if their values in different
campaigns were independent. These unknowns are the geometric errors that are not compared, the form
of the balls, the length of the bar, and the hyper-parameters (such as the standard deviation of the
noise). If campaigns have the machine or the bar in common, this treatment overstates the
uncertainty of changes and differences. It understates the uncertainty of levels and of a
population's mean, because ball form and bar length are the same in all campaigns and do not average
out.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ldbb_bayes.analysis.compliance_meaning import Meaning, same_meaning
from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.fleet.campaign_likelihood import SLOPE_NAME, campaign_likelihood
from ldbb_bayes.fleet.common_priors import (
    NormalPriors,
    best_priors,
    contradictory_statements,
    reference_sd,
    usual_priors,
)
from ldbb_bayes.fleet.force_sensitivity import with_common_sensitivity
from ldbb_bayes.fleet.machine_effects import (
    VARIANCE_OF_CAMPAIGN,
    has_usual_circles,
    machine_effects,
    ratios_of_effects,
    with_deviations,
    with_effects_of_campaigns,
)
from ldbb_bayes.fleet.selection import Caveat, CaveatKind, labels, moment
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.terms import Position, Term
from ldbb_bayes.results import Array
from ldbb_bayes.units import inside_name, is_compliance_or_slope

__all__ = ["FleetStatistics", "fleet_statistics"]


@dataclass(frozen=True, eq=False)
class FleetStatistics:
    """Gaussian likelihoods of n campaigns.

    The likelihood of a campaign is the posterior of the campaign's fit divided by the prior of this
    fit. It is a function of the c parameters to analyse, of s errors of the instrument, such as the
    error of the mount's deflection, and of k effects of the machine, such as slopes. A likelihood
    has a precision matrix Λ (inverse covariance) and a shift η (Λ times the estimate). If the model
    of a campaign lacks an instrument error or an effect, Λ and η of this campaign have zeros for
    it.
    """

    campaigns: tuple[str, ...]  #: file paths of the n campaigns, as in the table of a batch
    machines: tuple[str, ...]  #: name of the machine of each of n campaigns
    dates: tuple[datetime | None, ...]  #: date of each of n campaigns; None if it is not stated
    parameters: tuple[str, ...]  #: names of the c parameters to analyse, such as C_XXX
    #: internal units of the c parameters; each unit is a product of powers of mm, N and rad, such
    #: as mm/N
    units: tuple[str, ...]
    #: names of the s instrument errors whose values are the same in all campaigns; empty if the
    #: campaigns used different instruments
    instrument: tuple[str, ...]
    #: standard deviations that serve as units of the likelihood, shape (c + s + k,): first the
    #: reference sds of the c parameters (see `reference_sd`), then the prior sds of the s
    #: instrument errors and of the k effects of the machine. They are in internal units, made of
    #: mm, N and rad.
    prior_sd: Array
    #: likelihoods of n campaigns. Each is a Gaussian function of c + s + k variables: the c
    #: parameters, the s instrument errors and the k effects of the machine. The variables are in
    #: units of ``prior_sd``. The last two kinds are measured from their prior means.
    likelihood: Gaussian
    reference_force_N: float  #: force for which the compliances of all campaigns are given [N]
    #: lower and upper end of the range of forces that all campaigns have in common [N]: the largest
    #: of the campaigns' lowest forces, and the smallest of their highest forces. If there is no
    #: common range, the first number is larger than the second.
    forces_N: tuple[float, float]
    topology: str  #: topology of the machines: the chain of joints from workpiece to tool
    #: dictionary whose keys are the names of the fitted compliances. Each value is the weighted sum
    #: of joint compliances for which the fitted compliance stands. The dictionary is empty if the
    #: batch does not state the sums.
    compliances: Mapping[str, Meaning] = field(default_factory=dict)
    #: names of the k effects that a machine keeps from campaign to campaign (see
    #: `machine_effects`); empty if every machine has one campaign only
    machine: tuple[str, ...] = ()
    #: one caveat for each instrument error of which campaigns state values that contradict the best
    #: statement, such as two deflections of one mount
    contradictions: tuple[Caveat, ...] = ()

    def __len__(self) -> int:
        """Return the number of campaigns whose likelihoods this object holds."""
        return len(self.campaigns)

    @property
    def caveats(self) -> list[Caveat]:
        """List of caveats on extrapolated compliances and on statements that contradict each other.

        A caveat is a limitation that reports describe. The list has one caveat if, in at least one
        campaign, the reference force is outside the range of the tested forces, and one for each
        instrument error of which campaigns state contradictory values.
        """
        lowest, highest = self.forces_N
        if lowest <= self.reference_force_N <= highest:
            return list(self.contradictions)
        extrapolated = Caveat(CaveatKind.EXTRAPOLATED, values=(self.reference_force_N,))
        return [extrapolated, *self.contradictions]


def fleet_statistics(
    rows: pd.DataFrame,
    *,
    parameters: Sequence[str] | None = None,
    reference_force_N: float | None = None,
    one_instrument: bool = True,
    one_machine: bool = False,
) -> FleetStatistics:
    """Return the likelihoods of the machines' parameters from the campaigns of a batch.

    Parameters
    ----------
    rows : those rows of a batch's table whose campaigns are to be used; `choose` selects them.
    parameters : names of the parameters to analyse; default: all compliances at the reference
        force.
    reference_force_N : force for which the compliances are given [N]; default: the median of the
        reference forces of the campaigns.
    one_instrument : whether all campaigns used the same bar. If true, the errors of the mount's
        deflection and of the force are the same in all campaigns and do not average out; the best
        certificate that a campaign states of them is of all campaigns. If false, the errors of
        different campaigns are independent.
    one_machine : whether all campaigns are of one machine, whatever machine they name.

    Raises
    ------
    InputError
        If the machines differ in their joints, if a compliance stands for different sums of joint
        compliances in different campaigns, or if an option is out of range.
    """
    topology = _common_topology(rows)
    chosen = _choose_parameters(rows, parameters)
    if one_instrument:
        _require_one_version(rows)
    instrument = _instrument_errors(rows) if one_instrument else ()
    force = _reference_force(rows, reference_force_N)
    machines = _machine_names(rows)
    # With one machine, it does not matter which machine the campaigns name.
    owners: Sequence[str] = machines
    if one_machine:
        owners = ["the machine"] * len(machines)
    effects: tuple[str, ...] = ()
    if one_machine or len(set(machines)) < len(machines):
        effects = machine_effects(rows, owners)
    c = len(chosen)
    s = len(instrument)
    unit_by_name = dict(
        zip(rows["gaussian_names"].iloc[0], rows["gaussian_units"].iloc[0], strict=True)
    )
    units = tuple(unit_by_name[name] for name in chosen)
    of_campaigns = _likelihoods(rows, (*chosen, *instrument), effects, force)
    parameter_priors, instrument_priors, effect_priors = _split_priors(of_campaigns, c, s)
    parameter_sd = reference_sd(chosen, units, *parameter_priors)
    of_instrument = best_priors(instrument, instrument_priors)
    of_machine = usual_priors(effect_priors)
    scale = np.concatenate([parameter_sd, of_instrument.sd, of_machine.sd])
    centre = np.concatenate([np.zeros(c), of_instrument.mean, of_machine.mean])
    shift = of_campaigns.shift - of_campaigns.precision @ centre
    centred = with_common_sensitivity(
        Gaussian(of_campaigns.precision, shift), (*chosen, *instrument, *effects), rows, force
    )
    likelihood = Gaussian(centred.precision * (scale[:, None] * scale), centred.shift * scale)
    if effects:
        other_circles = np.flatnonzero(~has_usual_circles(rows, owners))
        likelihood = _without_parts_of_campaigns(likelihood, effects, other_circles)
    return FleetStatistics(
        campaigns=tuple(map(str, rows["campaign"])),
        machines=machines,
        dates=tuple(moment(date) if isinstance(date, str) else None for date in rows["date"]),
        parameters=chosen,
        units=units,
        instrument=instrument,
        prior_sd=scale,
        likelihood=likelihood,
        reference_force_N=force,
        forces_N=(float(rows["force_min_N"].max()), float(rows["force_max_N"].min())),
        topology=topology,
        compliances=_common_meanings(rows, chosen),
        machine=effects,
        contradictions=contradictory_statements(
            instrument, instrument_priors, of_instrument, labels(rows, rows)
        ),
    )


def _without_parts_of_campaigns(
    likelihood: Gaussian, effects: Sequence[str], other_circles: NDArray[np.intp]
) -> Gaussian:
    """Return likelihoods without the parts of machine effects that each campaign has of its own.

    These parts are integrated out. ``effects`` are the names of the k effects of the machine, which
    are the last quantities of the likelihoods. ``other_circles`` are the indices of the campaigns
    with other circles than their machine usually has: their changes of compliance along the travel
    are not those of its other campaigns.
    """
    first = likelihood.shift.shape[-1] - len(effects)
    is_along_travel = [Term.owner(name) is Position for name in effects]
    likelihood = with_effects_of_campaigns(
        likelihood, other_circles, effects=first + np.flatnonzero(is_along_travel)
    )
    variance = np.concatenate([np.zeros(first), np.full(len(effects), VARIANCE_OF_CAMPAIGN)])
    return with_deviations(likelihood, variance)


class _PriorsByKind(NamedTuple):
    """Priors in the fits of n campaigns, separately for each kind of quantity."""

    parameters: NormalPriors  #: priors of the c parameters, shape (n, c)
    instrument: NormalPriors  #: priors of the s errors of the instrument, shape (n, s)
    effects: NormalPriors  #: priors of the k effects of the machine, shape (n, k)


def _split_priors(likelihoods: _Likelihoods, c: int, s: int) -> _PriorsByKind:
    """Return the priors of c parameters, of s errors of the instrument and of all effects."""
    mean = likelihoods.prior_mean
    sd = likelihoods.prior_sd
    return _PriorsByKind(
        parameters=NormalPriors(mean[:, :c], sd[:, :c]),
        instrument=NormalPriors(mean[:, c : c + s], sd[:, c : c + s]),
        effects=NormalPriors(mean[:, c + s :], sd[:, c + s :]),
    )


class _Likelihoods(NamedTuple):
    """Likelihoods of q quantities from n campaigns, and their priors in the campaigns' fits."""

    precision: Array  #: precision matrices of the likelihoods, shape (n, q, q)
    shift: Array  #: precision matrices times the estimates, shape (n, q)
    prior_mean: Array  #: prior means in the campaigns' fits, shape (n, q)
    prior_sd: Array  #: prior standard deviations in the campaigns' fits, shape (n, q)


def _likelihoods(
    rows: pd.DataFrame, wanted: tuple[str, ...], effects: tuple[str, ...], force_N: float
) -> _Likelihoods:
    """Return the likelihoods of the parameters, instrument errors and effects of the machine.

    Parameters
    ----------
    rows
        Rows of n campaigns in the table of a batch.
    wanted
        Names of the parameters and instrument errors.
    effects
        Names of the effects of the machine. Their coefficients are given in units of those of the
        first campaign, because they depend on the forces of a campaign.
    force_N
        Reference force common to all campaigns [N].
    """
    likelihoods = [
        campaign_likelihood(row, (*wanted, *effects), force_N) for row in rows.to_dict("records")
    ]
    ratio = np.hstack([np.ones((len(rows), len(wanted))), ratios_of_effects(effects, rows)])
    precision = np.array([likelihood.precision for likelihood in likelihoods])
    shift = np.array([likelihood.shift for likelihood in likelihoods])
    prior_mean = np.array([likelihood.prior_mean for likelihood in likelihoods])
    prior_sd = np.array([likelihood.prior_sd for likelihood in likelihoods])
    return _Likelihoods(
        precision * (ratio[:, :, None] * ratio[:, None]),
        shift * ratio,
        prior_mean / ratio,
        prior_sd / ratio,
    )


def _common_topology(rows: pd.DataFrame) -> str:
    """Return the topology (chain of joints) that the machines of all campaigns share.

    ``rows`` are the rows of these campaigns in the tables of batches. Raise an `InputError` if the
    machines differ in topology.
    """
    topology, *others = sorted(set(rows["topology"]))
    if others:
        raise InputError(
            f"campaigns must be of machines with the same joints, got {topology} and {others[0]}."
            " Take one kind."
        )
    return str(topology)


def _choose_parameters(rows: pd.DataFrame, parameters: Sequence[str] | None) -> tuple[str, ...]:
    """Return the names of the parameters to analyse.

    ``parameters`` are the names that the user gives; None means all compliances at the reference
    force. Raise an `InputError` if a campaign does not have one of these parameters. ``rows`` are
    rows of the table of a batch.
    """
    common_names = _common_parameters(rows)
    compliances = [name for name in common_names if is_compliance_or_slope(name)]
    if parameters is None and not compliances:
        planes = "; ".join(sorted(set(rows["planes"])))
        raise InputError(
            f"campaigns must have a compliance in common, got those of the planes {planes}. Take"
            " campaigns of one plane, or name parameters that all have (--parameters)."
        )
    if parameters is None:
        chosen = compliances
    elif isinstance(parameters, str):
        chosen = [inside_name(parameters)]
    else:
        chosen = [inside_name(name) for name in parameters]
    check_known("parameter", chosen, common_names)
    if not chosen or len(chosen) != len(set(chosen)):
        raise InputError(
            f"parameters must be given once each, got {', '.join(chosen) or 'none'}. Name some of"
            f" {', '.join(common_names)}."
        )
    return tuple(chosen)


def _common_parameters(rows: pd.DataFrame) -> list[str]:
    """Return the names of the parameters that all campaigns have.

    Slopes and curvatures, which describe how compliances change with force, are left out. ``rows``
    are rows of the table of a batch.
    """
    names_by_campaign = [list(names) for names in rows["gaussian_names"]]
    common_names = []
    for name in names_by_campaign[0]:
        is_parameter = Term.owner(name) is Term and not SLOPE_NAME.fullmatch(name)
        if is_parameter and all(name in names for names in names_by_campaign):
            common_names.append(name)
    return common_names


def _instrument_errors(rows: pd.DataFrame) -> tuple[str, ...]:
    """Return the names of the instrument errors that the model of at least one campaign contains.

    Instrument errors are errors of the mount's deflection and of the force; they are the same in
    all campaigns with one instrument. The names are sorted by the kind of the model term to which
    the errors belong. ``rows`` are rows of the table of a batch.
    """
    names = set[str]().union(*rows["gaussian_names"])
    errors = [name for name in sorted(names) if Term.owner(name).common]
    terms = list(Term.kinds.values())
    return tuple(sorted(errors, key=lambda name: terms.index(Term.owner(name))))


def _reference_force(rows: pd.DataFrame, reference_force_N: float | None) -> float:
    """Return the force [N] for which the compliances are given.

    The force is ``reference_force_N``, which the user gives. If it is None, the force is the median
    of the reference forces in ``rows``, the rows of a batch's table. Raise an `InputError` for a
    force that is negative or not finite.
    """
    if reference_force_N is None:
        reference_force_N = np.median(rows["reference_force_N"])
    force = float(reference_force_N)
    if not 0.0 <= force < np.inf:
        raise InputError(
            f"reference_force_N must be a finite number, zero or more, got {force:g}. Give a force"
            " in N."
        )
    return force


def _machine_names(rows: pd.DataFrame) -> tuple[str, ...]:
    """Return the name of each campaign's machine: the machine_id that the campaign states.

    If a campaign states no machine_id, the file path of the campaign serves as the name of the
    machine. ``rows`` are rows of the table of a batch.
    """
    names = []
    for machine_id, campaign in zip(rows["machine_id"], rows["campaign"], strict=True):
        names.append(machine_id if isinstance(machine_id, str) else str(campaign))
    return tuple(names)


def _require_one_version(rows: pd.DataFrame) -> None:
    """Raise an `InputError` if rows of an earlier version stand beside others.

    Rows of earlier versions do not state the circles. They hold the error of the regulator's slope
    about an unknown slope, rows of this version the slope itself (`ForceError.nominal`). Both are
    the same for the default force law.
    """
    if "circles" not in rows:
        return
    is_earlier = rows["circles"].isna()
    slopes_differ = False
    for names, means in zip(rows["gaussian_names"], rows["gaussian_prior_mean"], strict=True):
        by_name = dict(zip(names, means, strict=True))
        slopes_differ = slopes_differ or by_name.get("force_gain", 0.0) != 0.0
    if slopes_differ and is_earlier.any() and not is_earlier.all():
        raise InputError(
            f"the row of {rows['campaign'][is_earlier].iloc[0]} must hold the slope of the force"
            " law, got one of an earlier version, which holds its error alone. Run batch again."
        )


def _common_meanings(rows: pd.DataFrame, chosen: Sequence[str]) -> dict[str, Meaning]:
    """Return, for each chosen compliance, the weighted sum of joint compliances it stands for.

    The keys of the result are the names of the compliances. ``rows`` are rows of the table of a
    batch; each row contains the sums of one campaign. Raise an `InputError` if two campaigns have
    different sums for the same compliance. If the row of a campaign contains no sum for a
    compliance, the sum is assumed to be the same as in the other campaigns.
    """
    meanings: dict[str, Meaning] = {}
    first_campaigns: dict[str, str] = {}
    campaign_by_text = dict(zip(rows["compliances"], map(str, rows["campaign"]), strict=True))
    for text, campaign in campaign_by_text.items():
        stated = json.loads(text) if isinstance(text, str) else {}
        for name in chosen:
            if name not in stated:
                continue
            if name not in meanings:
                meanings[name] = stated[name]
                first_campaigns[name] = campaign
            if not same_meaning(name, meanings[name], stated[name]):
                raise InputError(
                    f"campaigns must mean the same by {name}, got {first_campaigns[name]} and"
                    f" {campaign}: circles or joints' frames stand elsewhere, so that it is the sum"
                    " of other compliances. Take those of one place."
                )
    return meanings
