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
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, NamedTuple, get_args

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtr

from ldbb_bayes.analysis.compliance_meaning import Meaning, same_meaning
from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.fleet.machine_effects import (
    VARIANCE_OF_CAMPAIGN,
    has_usual_circles,
    machine_effects,
    ratios_of_effects,
    with_deviations,
    with_effects_of_campaigns,
)
from ldbb_bayes.fleet.selection import Caveat, CaveatKind, labels, moment
from ldbb_bayes.machine.parameters import ComplianceName, GeometricKind, GeometricName
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.prior import Prior, geometric_unit
from ldbb_bayes.model.terms import JointLoad, Position, Term
from ldbb_bayes.model.terms.joints import joint_load_names, secants_along_axis
from ldbb_bayes.results import Array
from ldbb_bayes.units import inside_name

__all__ = ["FleetStatistics", "fleet_statistics", "reference_sd"]

# Pattern of the names of the coefficients of a compliance's change with force: slopes, such as
# C_XXX_1, and curvatures, such as C_XXX_2.
_SLOPE = re.compile(r"(C_.+)_([12])")
# Two relative standard deviations count as equal if they differ by less than this share.
_SAME_SD = 1e-6
# What a campaign states of the common instrument contradicts the best statement if the probability
# of a larger difference by chance is below this number.
_CONTRADICTION = 0.01


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
    kept: tuple[str, ...] = ()
    kept_by: Sequence[str] = machines
    if one_machine:
        kept_by = ["the machine"] * len(machines)
    if one_machine or len(set(machines)) < len(machines):
        kept = machine_effects(rows, kept_by)
    c = len(chosen)
    s = len(instrument)
    unit_by_name = dict(
        zip(rows["gaussian_names"].iloc[0], rows["gaussian_units"].iloc[0], strict=True)
    )
    units = tuple(unit_by_name[name] for name in chosen)
    of_campaigns = _likelihoods(rows, (*chosen, *instrument), kept, force)
    parameter_sd = reference_sd(
        chosen, units, of_campaigns.prior_mean[:, :c], of_campaigns.prior_sd[:, :c]
    )
    priors = of_campaigns.prior_mean, of_campaigns.prior_sd
    stated = _CommonPrior(*(values[:, c : c + s] for values in priors))
    of_instrument = _best_prior(instrument, stated)
    of_machine = _usual_prior(*(values[:, c + s :] for values in priors))
    scale = np.concatenate([parameter_sd, of_instrument.sd, of_machine.sd])
    centre = np.concatenate([np.zeros(c), of_instrument.mean, of_machine.mean])
    shift = of_campaigns.shift - of_campaigns.precision @ centre
    likelihood = Gaussian(of_campaigns.precision * (scale[:, None] * scale), shift * scale)
    if kept:
        other_circles = np.flatnonzero(~has_usual_circles(rows, kept_by))
        likelihood = _with_parts_of_campaigns(likelihood, kept, other_circles)
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
        machine=kept,
        contradictions=_contradictions(instrument, stated, of_instrument, labels(rows, rows)),
    )


def _with_parts_of_campaigns(
    likelihood: Gaussian, kept: Sequence[str], other_circles: NDArray[np.intp]
) -> Gaussian:
    """Return likelihoods without the parts of machine effects that each campaign has of its own.

    These parts are integrated out. ``kept`` are the names of the k effects of the machine, which
    are the last quantities of the likelihoods. ``other_circles`` are the indices of the campaigns
    with other circles than their machine usually has: their changes of compliance along the travel
    are not those of its other campaigns.
    """
    first = likelihood.shift.shape[-1] - len(kept)
    is_along_travel = [Term.owner(name) is Position for name in kept]
    likelihood = with_effects_of_campaigns(
        likelihood, other_circles, effects=first + np.flatnonzero(is_along_travel)
    )
    variance = np.concatenate([np.zeros(first), np.full(len(kept), VARIANCE_OF_CAMPAIGN)])
    return with_deviations(likelihood, variance)


class _CommonPrior(NamedTuple):
    """Independent normal priors of quantities that are the same in several campaigns."""

    mean: Array  #: prior mean of each quantity in internal units
    sd: Array  #: prior standard deviation of each quantity in internal units


def _best_prior(names: Sequence[str], stated: _CommonPrior) -> _CommonPrior:
    """Return the prior of s instrument errors that all campaigns have in common.

    A certificate that one campaign states of the common instrument is of all campaigns. The prior
    with the smallest standard deviation, relative to its mean if this is not zero, is therefore
    that of all. An sd without a unit, such as that of the force's gain, is relative already.
    Campaigns without a certificate assume the same share of the mount's deflection that they state.
    If several priors are equally narrow, the one with the median mean is taken. ``names`` are the
    names of the errors. ``stated`` holds the prior means and sds in n campaigns, shape (n, s); the
    sd is zero in a campaign whose model lacks the error.
    """
    mean, sd = stated
    best = _CommonPrior(np.zeros(len(names)), np.zeros(len(names)))
    for j, name in enumerate(names):
        having = np.flatnonzero(sd[:, j] > 0.0)
        means = mean[having, j]
        is_relative = Term.owner(name).unit_of(name).inside == "1"
        size = np.where((means == 0.0) | is_relative, 1.0, np.abs(means))
        relative_sd = sd[having, j] / size
        narrowest = having[relative_sd <= relative_sd.min() * (1.0 + _SAME_SD)]
        by_mean = narrowest[np.argsort(mean[narrowest, j])]
        median = by_mean[len(by_mean) // 2]
        best.mean[j] = mean[median, j]
        best.sd[j] = sd[median, j]
    return best


def _contradictions(
    names: Sequence[str], stated: _CommonPrior, best: _CommonPrior, campaigns: Sequence[str]
) -> tuple[Caveat, ...]:
    """Return one caveat for each instrument error of which campaigns state contradictory values.

    A campaign contradicts the best statement if the probability of a larger difference by chance is
    below 1 %, multiplied by the number of campaigns (Bonferroni).

    Parameters
    ----------
    names
        Names of s instrument errors.
    stated
        Prior means and sds of the errors in n campaigns, shape (n, s). The sd is zero in a campaign
        whose model lacks the error.
    best
        Prior of each error that counts for all campaigns.
    campaigns
        Names of the n campaigns for the caveat.
    """
    difference_sd = np.hypot(stated.sd, best.sd)
    distance = np.where(stated.sd > 0.0, np.abs(stated.mean - best.mean) / difference_sd, 0.0)
    p_values = 2.0 * ndtr(-distance) * len(campaigns)
    caveats = []
    for j, name in enumerate(names):
        contradicts = np.flatnonzero(p_values[:, j] < _CONTRADICTION)
        others = tuple(campaigns[i] for i in contradicts.tolist())
        if others:
            text = Term.owner(name).describe(name)
            caveats.append(Caveat(CaveatKind.CONTRADICTED_INSTRUMENT, others, text=text))
    return tuple(caveats)


def _usual_prior(mean: Array, sd: Array) -> _CommonPrior:
    """Return the prior of the part of k effects that belongs to the machine.

    Campaigns size these priors by the compliances that their own readings show, which differ
    little; the median is that of the machine. ``mean`` and ``sd`` are the prior means and sds in n
    campaigns, shape (n, k); the sd is zero in a campaign whose model lacks the effect.
    """
    k = sd.shape[1]
    usual = _CommonPrior(np.zeros(k), np.zeros(k))
    for j in range(k):
        stated = sd[:, j] > 0.0
        usual.mean[j] = np.median(mean[stated, j])
        usual.sd[j] = np.median(sd[stated, j]) / np.sqrt(1.0 + VARIANCE_OF_CAMPAIGN)
    return usual


class _Likelihoods(NamedTuple):
    """Likelihoods of q quantities from n campaigns, and their priors in the campaigns' fits."""

    precision: Array  #: precision matrices of the likelihoods, shape (n, q, q)
    shift: Array  #: precision matrices times the estimates, shape (n, q)
    prior_mean: Array  #: prior means in the campaigns' fits, shape (n, q)
    prior_sd: Array  #: prior standard deviations in the campaigns' fits, shape (n, q)


def _likelihoods(
    rows: pd.DataFrame, wanted: tuple[str, ...], kept: tuple[str, ...], force_N: float
) -> _Likelihoods:
    """Return the likelihoods of the parameters, instrument errors and effects of the machine.

    Parameters
    ----------
    rows
        Rows of n campaigns in the table of a batch.
    wanted
        Names of the parameters and instrument errors.
    kept
        Names of the effects of the machine. Their coefficients are given in units of those of the
        first campaign, because they depend on the forces of a campaign.
    force_N
        Reference force common to all campaigns [N].
    """
    likelihoods = [_likelihood(row, (*wanted, *kept), force_N) for row in rows.to_dict("records")]
    ratio = np.hstack([np.ones((len(rows), len(wanted))), ratios_of_effects(kept, rows)])
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
    compliances = [name for name in common_names if name.startswith("C_")]
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
        is_parameter = Term.owner(name) is Term and not _SLOPE.fullmatch(name)
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


def reference_sd(
    names: Sequence[str], units: Sequence[str], prior_mean: Array, prior_sd: Array
) -> Array:
    """Return the reference sd of every parameter, shape (c,), in internal units (mm, N, rad).

    The reference sd of a parameter is the larger of two values: the sd of the parameter's default
    prior, and the median of the sds of the parameter's priors in the fits of the campaigns. A prior
    in a fit may be wider than the default prior because a compliance stands for the compliances of
    several joints, or because the user expects a more compliant machine. Priors whose mean is not
    zero are left out: they state how well a parameter is known, not how large it may be.

    Parameters
    ----------
    names, units : names and internal units of the c parameters.
    prior_mean, prior_sd : prior means and prior sds of the parameters in n fits, shape (n, c) each.
    """
    prior = Prior.first()
    kind_by_unit = {geometric_unit(kind): kind for kind in get_args(GeometricKind)}
    reference = np.empty(len(names))
    for j, (name, unit) in enumerate(zip(names, units, strict=True)):
        if name.startswith("C_"):
            (default_sd,) = prior.compliance_sd([ComplianceName(*name[2:])])
        else:
            (default_sd,) = prior.geometric_sd([GeometricName("X", "X", kind_by_unit[unit])])
        is_centred = prior_mean[:, j] == 0.0
        reference[j] = default_sd
        if is_centred.any():
            reference[j] = max(default_sd, np.median(prior_sd[is_centred, j]))
    return reference


class _Likelihood(NamedTuple):
    """Likelihood of q quantities from one campaign, and their prior in the campaign's fit.

    The quantities are parameters of the machine and errors of the instrument.
    """

    #: precision matrix (inverse covariance) of the likelihood of q quantities (parameters and
    #: instrument errors), shape (q, q)
    precision: Array
    #: precision matrix of the likelihood times the estimate of the q quantities (parameters and
    #: instrument errors), shape (q,). The estimate is the maximum of the likelihood.
    shift: Array
    #: prior means, in the campaign's fit, of the q parameters and instrument errors, shape (q,)
    prior_mean: Array
    #: prior standard deviations, in the campaign's fit, of the q parameters and instrument errors,
    #: shape (q,)
    prior_sd: Array


def _likelihood(row: Mapping[Any, Any], wanted: Sequence[str], force_N: float) -> _Likelihood:
    """Return the likelihood of a campaign: the Gaussian posterior of its fit divided by the prior.

    Parameters
    ----------
    row
        Row of the campaign in the table of a batch, with the posterior moments and the priors of
        the campaign's fit.
    wanted
        Names of the q quantities (parameters and instrument errors). In the likelihood, precision
        and shift are zero for quantities that are not in the campaign's fit.
    force_N
        Reference force common to all campaigns [N]. Compliances are converted to this force by
        means of their slopes and curvatures (linear and quadratic changes with force), and of
        `JointLoad`.
    """
    names = list(row["gaussian_names"])
    mean = np.array(row["gaussian_mean"], dtype=float)
    prior_mean = np.array(row["gaussian_prior_mean"], dtype=float)
    prior_sd = np.array(row["gaussian_prior_sd"], dtype=float)
    covariance = _full_covariance(row["gaussian_covariance"], len(names))
    _require_nominal_mount(row, dict(zip(names, prior_mean.tolist(), strict=True)))
    to_force = _map_to_force(names, wanted, force_N, row)
    present = np.flatnonzero(to_force.any(axis=1))
    columns = [names.index(wanted[int(i)]) for i in present]
    to_force = to_force[present]
    precision, shift = _divide_out_prior(
        mean=to_force @ mean,
        covariance=to_force @ covariance @ to_force.T,
        prior_mean=to_force @ prior_mean,
        prior_covariance=(to_force * prior_sd**2) @ to_force.T,
    )
    likelihood = _Likelihood(
        precision=np.zeros((len(wanted), len(wanted))),
        shift=np.zeros(len(wanted)),
        prior_mean=np.zeros(len(wanted)),
        prior_sd=np.zeros(len(wanted)),
    )
    likelihood.precision[np.ix_(present, present)] = precision
    likelihood.shift[present] = shift
    likelihood.prior_mean[present] = prior_mean[columns]
    likelihood.prior_sd[present] = prior_sd[columns]
    return likelihood


def _require_nominal_mount(row: Mapping[Any, Any], prior_mean: Mapping[str, float]) -> None:
    """Raise an `InputError` for a row of an earlier version, without the mount's deflection.

    Such a row states the error of the deflection about an unknown nominal value. ``prior_mean``
    holds the prior mean of every quantity of the row.
    """
    if prior_mean.get("mount") == 0.0:
        raise InputError(
            f"the row of {row['campaign']} must hold the mount's deflection, got one of an earlier"
            " version, which holds its error alone. Run batch again."
        )


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


def _divide_out_prior(
    *, mean: Array, covariance: Array, prior_mean: Array, prior_covariance: Array
) -> tuple[Array, Array]:
    """Return the precision (q, q) and the shift (q,) of a likelihood.

    The likelihood is a posterior divided by its prior; all three are Gaussian functions of q
    quantities. The arguments are the means, shape (q,), and the covariances, shape (q, q), of the
    posterior and of the prior. The precision (inverse covariance) of the likelihood is the
    precision of the posterior minus the precision of the prior. Negative eigenvalues of this
    difference are set to zero, because the readings add nothing to the prior in the directions of
    the corresponding eigenvectors. The shift is the precision times the estimate.
    """
    scale = np.sqrt(np.diag(prior_covariance))
    squared_scale = scale[:, None] * scale
    posterior_precision = np.linalg.inv(covariance / squared_scale)
    prior_precision = np.linalg.inv(prior_covariance / squared_scale)
    symmetric_precision = 0.5 * (posterior_precision + posterior_precision.T)
    gain, directions = np.linalg.eigh(symmetric_precision - prior_precision)
    informed = directions * (gain > 0.0)
    posterior_shift = posterior_precision @ (mean / scale)
    prior_shift = prior_precision @ (prior_mean / scale)
    precision = (informed * gain) @ informed.T / squared_scale
    shift = informed @ (informed.T @ (posterior_shift - prior_shift)) / scale
    return precision, shift


def _full_covariance(lower_triangle: Sequence[float], q: int) -> Array:
    """Return the covariance matrix of q quantities, shape (q, q), from its lower triangle.

    ``lower_triangle`` lists the elements of the lower triangle row by row.
    """
    covariance = np.zeros((q, q))
    covariance[np.tril_indices(q)] = lower_triangle
    covariance += np.tril(covariance, -1).T
    return covariance


def _map_to_force(
    names: Sequence[str], wanted: Sequence[str], force_N: float, row: Mapping[Any, Any]
) -> Array:
    """Return the matrix that converts a campaign's quantities to the force ``force_N`` [N].

    The rows of the matrix belong to the quantities ``wanted``, and the columns to the quantities
    ``names`` that the campaign has. ``row`` is the row of the campaign in the table of a batch. Let
    ΔF be ``force_N`` minus the reference force of the campaign. A compliance at ``force_N`` is the
    compliance at the reference force, plus its slope times ΔF, plus its curvature times ΔF². A
    direct compliance also changes by what `JointLoad` adds. Slopes and coefficients of `JointLoad`
    are returned as they are; those of quadratic compliance, which depend on the reference force,
    must not be among ``wanted``.
    """
    reference_N = float(row["reference_force_N"])
    matrix = np.zeros((len(wanted), len(names)))
    for i, name in enumerate(wanted):
        for power, coefficient in enumerate((name, f"{name}_1", f"{name}_2")):
            if coefficient in names:
                matrix[i, names.index(coefficient)] = (force_N - reference_N) ** power
        for coefficient, secant in _joint_load(name, force_N, row).items():
            if coefficient in names:
                matrix[i, names.index(coefficient)] = secant
    return matrix


def _joint_load(name: str, force_N: float, row: Mapping[Any, Any]) -> dict[str, float]:
    """Return by how much the coefficients of `JointLoad` change a compliance at another force.

    The keys of the result are the names of the coefficients; it is empty if the compliance ``name``
    is not a direct one. ``row`` is the row of the campaign in the table of a batch, and ``force_N``
    the other force [N].
    """
    if not name.startswith("C_") or _SLOPE.fullmatch(name) is not None:
        return {}
    compliance = ComplianceName(*name.removeprefix("C_"))
    reference_N = float(row["reference_force_N"])
    if compliance.kind != "direct" or force_N == reference_N:
        return {}
    coefficients = joint_load_names(compliance.twist)
    if force_N == 0.0 and any(coefficient in row["gaussian_names"] for coefficient in coefficients):
        raise InputError(
            "reference_force_N must be positive where joints yield to their own load (JointLoad),"
            " got 0. Give a force that was tested."
        )
    if JointLoad.__name__ in row["terms"] and coefficients[0] not in row["gaussian_names"]:
        raise InputError(
            f"the row of {row['campaign']} must hold what JointLoad adds to {name} at"
            f" {force_N:g} N, got one of an earlier version. Run batch again, or give the force"
            f" {reference_N:g} N."
        )
    secants = secants_along_axis(np.array([force_N]), reference_N, float(row["force_max_N"]))
    return dict(zip(coefficients, secants[0].tolist(), strict=True))


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
