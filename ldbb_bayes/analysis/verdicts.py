"""Verdicts whether each parameter is identified, prior-limited or confounded.

Verdicts are numbers: they follow from what holds the variance of a parameter. In this module, β
are the parameters (compliances, their slopes and geometric errors) and y the readings. Nuisances
are effects that are modelled but not of interest. Every source of uncertainty has a share in the
variance of a parameter (`Information.shares`; they sum to one), and an origin: it is measured here,
stated or assumed (`origins`). A parameter whose variance is held by an effect that nobody measured
or stated is confounded with it.

Everything is computed for the linear Gaussian model, in which compliances may be negative, at one
value of the hyper-parameters φ (the scales of the noise and of other effects). For a campaign with
readings, this value is the posterior mean of φ; for a plan, which can thus be judged before it is
run, it is the prior median. Only the benefit of certificates is averaged over p(φ | y).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
import pandas as pd
from pydantic import Field

from ldbb_bayes.analysis.aliases import Degeneracy, degeneracies
from ldbb_bayes.analysis.cures import Cure, cures
from ldbb_bayes.analysis.curve_changes import CurveChange, curve_changes
from ldbb_bayes.analysis.origins import MAJORITY, Origin, edition_terms, is_prior_stated, origins
from ldbb_bayes.analysis.remedies import Remedy, remedies
from ldbb_bayes.analysis.value_of_certificates import worth_of_certificates
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.posterior import bound_of, draws_of
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.hybrid import BoundModel, HybridModel, require_model
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.linear_algebra import minimum_norm_solution
from ldbb_bayes.model.terms.columns import OWN
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, ByRow, Finite, Number, Result
from ldbb_bayes.units import ranked

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "CONTRACTION_LIMIT",
    "SAME_COMBINATION",
    "ChangeIdentifiability",
    "Identifiability",
    "ParameterIdentifiability",
    "SampledSd",
    "SourcesOfVariance",
    "VarianceSource",
    "Verdict",
    "confounded_parameters",
    "hyper_parameter_nodes",
    "identify",
    "judge",
    "judge_parameters",
    "judge_posterior",
    "not_modelled",
    "sources_of",
    "variance_share_removed",
]

# Two effects act on the same combination of parameters if the squared cosine of the angle between
# the errors that they cause is at least this.
SAME_COMBINATION = 0.95
# A parameter β is prior-limited where its contraction, 1 − Var(β | y) / Var(β) for readings y, is
# below this: its posterior sd is more than half of its prior sd.
CONTRACTION_LIMIT = 0.75
# An effect that holds less than this share of a parameter's variance is not named with the verdict
# on the parameter.
_NAMED_SHARE = 0.05
# Shares and contractions that differ from their limit by less than this count as equal to it, so
# that no verdict depends on rounding errors: a share equal to the limit is no majority, and a
# contraction equal to it is none that limits.
_NEAR_TIE = 1e-6
# A change of a parameter's least-squares estimate below this share of the parameter's prior
# standard deviation is a rounding error.
_ROUNDING = 1e-12


class Verdict(StrEnum):
    """Verdict on how well one parameter is known.

    Every source of uncertainty has a share in the variance of the parameter, and an origin: it is
    measured here, stated or assumed. The sources are the terms of the model, each divided by
    origin, and the priors of the parameters. sd is the standard deviation. The rules apply in this
    order:

    1. *confounded*, when one assumed effect holds more than half of the parameter's variance, or
       several that act on the same combination do so together: those with the largest shares, none
       below 5 %. An effect is a term of the model, or another parameter through its prior. With an
       error of this parameter, an effect causes errors of all parameters; two effects act on the
       same combination if these errors, in posterior sds, are proportional, or nearly so (squared
       cosine of the angle between them at least 0.95). Knowing the effects would remove at least
       their share of the variance, and so cut the parameter's standard uncertainty by 30 % or
       more.
    2. *prior-limited*, when the posterior sd is more than half of the prior sd.
    3. *identified* otherwise.

    Shares within 1e-6 of one half count as one half, which is no majority. Effects whose shares
    agree within 1e-6 are ranked in the order of the model's terms.
    """

    IDENTIFIED = "identified"
    PRIOR_LIMITED = "prior-limited"
    CONFOUNDED = "confounded"


@dataclass(frozen=True)
class VarianceSource(Result):
    """A source of the uncertainty of one parameter, with its share of the variance.

    ``name`` is the class name of a model term, such as ``Mount``, ``ReadingNoise``, the name of
    another parameter (its prior), or ``Parameters`` for the prior of the parameter itself.
    """

    name: str
    origin: Origin  #: where its size comes from: measured here, stated or assumed
    share: float  #: share of the source in the parameter's variance


@dataclass(frozen=True, eq=False)
class ParameterIdentifiability(Result):
    """How well one parameter is known, in internal units (mm, N, rad).

    Examples
    --------
    >>> result = lb.identify(lb.HybridModel.first(0), campaign)
    >>> parameter = result.parameters["E_C0YX"]
    >>> parameter.verdict.value, parameter.partners
    ('confounded', ('BallForm',))
    >>> parameter.held_by.name, parameter.held_by.origin.value
    ('BallForm', 'assumed')
    >>> parameter.remedy.kind.value  # the cheapest cure
    'balls'
    """

    name: str  #: name of the parameter
    verdict: Verdict  #: verdict: identified, prior-limited or confounded
    held_by: VarianceSource  #: source with the largest share of the parameter's variance
    #: assumed effects that a confounded parameter cannot be separated from: model terms, or other
    #: parameters; those with the largest share first. Empty for other verdicts.
    partners: Annotated[tuple[str, ...], Field(alias="with")]
    #: share of each effect in ``partners`` in the parameter's variance, by name of the effect
    partner_shares: dict[str, float]
    #: standard uncertainty that the parameter would have if the effects in ``partners`` were known
    #: exactly; None if there are none
    sd_if_known: float | None
    #: cheapest cure: what would narrow the parameter, and its standard uncertainty then; None where
    #: none narrows it by a tenth, or where none was looked for
    remedy: Remedy | None
    unit: str  #: internal unit of the parameter (of mm, N, rad)
    prior_mean: Number  #: prior mean of the parameter; not a number for a flat prior
    #: prior standard deviation of the parameter; infinite for a flat prior
    prior_sd: Finite
    mean: float  #: posterior mean of the parameter; for a plan the prior mean
    sd: float  #: posterior standard deviation of the parameter
    #: contraction: one minus the ratio of the posterior and the prior variance; not a number for a
    #: flat prior
    contraction: Number
    #: mutual information of parameter and readings, ½ ln(prior variance / posterior variance)
    #: [nat]; not a number for a flat prior
    information_gain: Number
    #: share of the parameter's posterior variance that vanishes if a model term is known, by class
    #: name of the term
    confounding: dict[str, float]
    #: shares of model terms, reading noise and the parameters' own priors in the parameter's
    #: variance, as in `budget_uncertainty`; they sum to one
    shares: dict[str, float]
    #: share of all sources of one origin in the parameter's variance, by origin; they sum to one
    origin_shares: dict[Origin, float]


@dataclass(frozen=True, eq=False)
class ChangeIdentifiability(Result):
    """How well the change of one compliance C(F) over the tested forces is known.

    The numbers are in internal units (mm, N, rad); the rules of the verdict are those of `Verdict`.

    Examples
    --------
    >>> result = lb.identify(lb.HybridModel.default(1), campaign.plan())
    >>> change = result.changes["C_XYX"]
    >>> change.smallest_force_N, change.largest_force_N
    (36.0, 742.0)
    >>> change.held_by.name  # its own prior
    'Parameters'
    """

    compliance: str  #: name of the compliance, such as C_XXX
    unit: str  #: internal unit of the compliance and of its change
    smallest_force_N: float  #: smallest force tested, F_min [N]
    largest_force_N: float  #: largest force tested, F_max [N]
    verdict: Verdict  #: verdict on the change C(F_max) − C(F_min)
    held_by: VarianceSource  #: source with the largest share of the change's variance
    #: share of each assumed effect that the change is confounded with, by name of the effect
    partner_shares: dict[str, float]
    #: cheapest cure, as for a parameter; None where none narrows the change by a tenth
    remedy: Remedy | None
    prior_sd: Finite  #: prior standard deviation of the change; infinite for a flat prior
    sd: float  #: posterior standard deviation of the change
    #: share of all sources of one origin in the change's variance, by origin; they sum to one
    origin_shares: dict[Origin, float]


@dataclass(frozen=True, eq=False)
class Identifiability(Result):
    """How well a campaign or plan determines the parameters of a model.

    Examples
    --------
    >>> result = lb.identify(lb.HybridModel.first(0), campaign)
    >>> round(result.effective_parameters, 1), len(result.parameters)
    (12.7, 13)
    >>> known = result.certificates["mount ± 2 %"]["C_XXX"]
    >>> round(known / result.certificates["none of these"]["C_XXX"], 1)
    0.6
    """

    #: verdict on each parameter, by name
    parameters: dict[str, ParameterIdentifiability]
    #: verdict on the change of each compliance over the tested forces, by name of the compliance
    changes: dict[str, ChangeIdentifiability]
    degeneracies: tuple[Degeneracy, ...]  #: combinations of coefficients that no reading resolves
    #: remedies for each item of ``degeneracies``: further tests that resolve it when added to the
    #: plan, or a calibration
    cures: tuple[tuple[Cure, ...], ...]
    #: class names of the terms of the model's preset that the user switched off: no interval covers
    #: these effects
    not_modelled: tuple[str, ...]
    #: number of parameters that the readings determine: the sum of the contractions, or for a flat
    #: prior the number of all parameters
    effective_parameters: float
    #: change of each parameter's least-squares estimate (rows) caused by each nuisance coefficient
    #: (columns), if the fit ignores the nuisance and its size is one prior standard deviation; in
    #: internal units (mm, N, rad)
    alias: ByRow
    #: posterior correlations of the parameters, and of the nuisances (effects not of interest) that
    #: act in several tests
    correlation: ByRow
    #: standard uncertainty to expect with further certificates of the instrument, by certificate,
    #: then by parameter: without any, with each one that the instrument lacks, and with all of
    #: these; empty for a flat prior
    certificates: dict[str, dict[str, float]]
    #: hyper-parameters (scales of the noise and of other effects) at which the verdicts are
    #: computed [µm]
    hyper_um: dict[str, float]
    #: whether the hyper-parameters and the means come from readings, not from priors
    measured: bool


class SampledSd(NamedTuple):
    """Prior and posterior standard deviations of all p parameters, shape (p,) each.

    The standard deviations are those of random draws or, if there are no draws, of the linear
    Gaussian model.
    """

    prior: Array
    posterior: Array


@one_blas_thread
def identify(model: HybridModel, campaign: Campaign) -> Identifiability:
    """Return how well a campaign, or a plan once run, determines the parameters of a model.

    Each parameter is identified, prior-limited (the readings hardly narrow its prior) or confounded
    (an effect that nobody measured holds most of its variance). No readings are needed, so that a
    plan can be judged before it is run. All is computed for the linear Gaussian model, in which
    compliances may be negative. The hyper-parameters (the scales of the noise and of other effects)
    have their posterior mean or, for a plan, their prior median.

    Parameters
    ----------
    model : HybridModel
        Model with its nuisances and priors.
    campaign : Campaign
        Tests with or without readings.

    Returns
    -------
    Identifiability
        Verdicts on the parameters; combinations that no reading resolves, with remedies; and the
        uncertainties to expect with further certificates. Units are internal (mm, N, rad).

    Raises
    ------
    InputError
        For a model that cannot be fitted to the campaign.

    Examples
    --------
    >>> result = lb.identify(lb.HybridModel.first(0), campaign.plan())
    >>> result.parameters["C_XXX"].verdict.value
    'confounded'
    >>> result.parameters["C_XXX"].partners[0]  # the mount, too, deflects with force
    'Mount'
    """
    require_model(model)
    bound = model.bind(campaign)
    weight, nodes = hyper_parameter_nodes(bound)
    phi = weight @ nodes
    mean = bound.prior_mean
    if not campaign.is_plan:
        mean = bound.given(phi[None])[1].mean[0]
    information = information_of(bound, phi)
    combinations = degeneracies(bound)
    effective_parameters = float(len(bound.names))
    certificates: dict[str, dict[str, float]] = {}
    if not information.flat:
        effective_parameters -= float(information.variances().sum())
        certificates = worth_of_certificates(bound, weight, nodes)
    parameters = judge_parameters(bound, information, mean)
    changes = _judge_changes(bound, information)
    found = _remedies_of(bound, phi, parameters, changes)
    return Identifiability(
        parameters={name: replace(entry, remedy=found[name]) for name, entry in parameters.items()},
        changes={
            name: replace(entry, remedy=found[f"change of {name}"])
            for name, entry in changes.items()
        },
        degeneracies=combinations,
        cures=cures(bound, combinations),
        not_modelled=not_modelled(bound),
        effective_parameters=effective_parameters,
        alias=_alias_matrix(bound, information),
        correlation=_correlation(information),
        certificates=certificates,
        hyper_um=bound.hyper_prior.named(phi),
        measured=not campaign.is_plan,
    )


@one_blas_thread
def judge_posterior(posterior: xr.DataTree) -> dict[str, ParameterIdentifiability]:
    """Return the verdict on every parameter of a posterior.

    Each parameter is identified, prior-limited (the readings hardly narrow its prior) or confounded
    (an effect that nobody measured holds most of its variance). Cures are not looked for; use
    `identify` for them.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.

    Returns
    -------
    dict of str to ParameterIdentifiability
        Verdict on each parameter by name, computed at the posterior mean of the hyper-parameters
        (the scales of the noise and of other effects); mean, sd and contraction are those of the
        posterior draws.

    Raises
    ------
    InputError
        For a posterior from `to_units`.

    Examples
    --------
    >>> judged = lb.analysis.judge_posterior(posterior)
    >>> judged["E_YX2"].verdict.value, judged["E_YX2"].partners
    ('confounded', ('BallForm',))
    >>> judged["C_XYX_1"].verdict.value
    'prior-limited'
    """
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound)
    prior_sd = np.full(len(bound.names), np.inf)
    for j, name in enumerate(bound.names):
        if np.isfinite(bound.prior_sd[j]):
            prior_sd[j] = float(posterior["prior"][name].std())
    return judge_parameters(
        bound,
        information_of(bound, phi.mean(axis=0)),
        beta.mean(axis=0),
        SampledSd(prior_sd, beta.std(axis=0)),
    )


def confounded_parameters(bound: BoundModel, phi: Array) -> dict[str, tuple[str, ...]]:
    """Return the effects with which each confounded parameter is confounded, by its name.

    Parameters that are not confounded are left out. The effects are those of the verdicts of
    `judge_posterior`; finding them alone takes less time than the verdicts.

    Parameters
    ----------
    bound
        Model bound to a campaign.
    phi
        Hyper-parameters (scales of the noise and of other effects), shape (h,); lengths in mm.
    """
    confounded = {}
    for name, (sources, likeness) in sources_of(bound, information_of(bound, phi)).items():
        partners = _confounding_sources(sources, likeness)
        if partners:
            confounded[name] = tuple(_shares_by_name(partners))
    return confounded


def hyper_parameter_nodes(bound: BoundModel) -> tuple[Array, Array]:
    """Return weights, shape (w,), and values, shape (w, h), of the hyper-parameters φ.

    The w values are quadrature nodes that represent p(φ | y), for the readings y and a model in
    which compliances may be negative. Lengths are in mm; decays and noise factors are pure numbers.
    For a plan there is one node, the prior median.
    """
    if bound.campaign.is_plan:
        median = np.full((1, len(bound.hyper_prior.names)), 0.5)
        return np.ones(1), bound.hyper_prior.quantile(median)
    coarse = HyperPosterior(bound, truncated=False).coarse
    return coarse.weight, bound.hyper_prior.phi(coarse.free)


def variance_share_removed(information: Information, names: Sequence[str]) -> Array:
    """Return the share of each parameter's variance that knowing some effects would remove.

    The variance is that of the posterior. ``names`` are the names of these effects: model terms or
    single coefficients. The result has the shape (p,) for p parameters.
    """
    return np.clip(1.0 - information.variances(names) / information.variances(), 0.0, 1.0)


def not_modelled(bound: BoundModel) -> tuple[str, ...]:
    """Return the class names of the terms of a model's preset that the user switched off.

    The preset ``paper`` has no terms, so that none is missing from it.
    """
    if bound.model.preset == "paper":
        return ()
    modelled = {type(term) for term in bound.model.nuisances}
    return tuple(kind.__name__ for kind in edition_terms(bound) if kind not in modelled)


class PartneredVerdict(NamedTuple):
    """A verdict on a parameter, and the sources that it cannot be separated from, if any."""

    verdict: Verdict
    partners: tuple[VarianceSource, ...]


def judge(
    sources: Sequence[VarianceSource],
    contraction: float,
    likeness: Mapping[tuple[str, str], float] | None = None,
) -> PartneredVerdict:
    """Return the verdict on a parameter by the rules of `Verdict`.

    Parameters
    ----------
    sources
        All sources of the parameter's variance, the largest share first.
    contraction
        One minus the ratio of posterior and prior variance; not a number for a flat prior.
    likeness
        How alike the errors are that two sources cause, from 0 to 1, by names of the sources.
        Default: all sources act on the same combination of parameters.
    """
    partners = _confounding_sources(sources, likeness)
    if partners:
        return PartneredVerdict(Verdict.CONFOUNDED, partners)
    if contraction < CONTRACTION_LIMIT - _NEAR_TIE:
        return PartneredVerdict(Verdict.PRIOR_LIMITED, ())
    return PartneredVerdict(Verdict.IDENTIFIED, ())


def _confounding_sources(
    sources: Sequence[VarianceSource], likeness: Mapping[tuple[str, str], float] | None
) -> tuple[VarianceSource, ...]:
    """Return the assumed sources that hold most of a parameter's variance; empty if none do."""
    candidates = []
    for source in sources:
        is_effect = source.origin == Origin.ASSUMED and source.name != OWN
        if is_effect and source.share >= _NAMED_SHARE:
            candidates.append(source)
    for first in candidates:
        partners: list[VarianceSource] = []
        share = 0.0
        for source in candidates:
            if likeness is not None and likeness[first.name, source.name] < SAME_COMBINATION:
                continue
            partners.append(source)
            share += source.share
            if share > MAJORITY + _NEAR_TIE:
                return tuple(partners)
    return ()


class SourcesOfVariance(NamedTuple):
    """Sources of the variance of one parameter.

    ``sources`` are all sources, the largest share first. ``likeness`` is how alike the errors of
    all parameters are that two assumed sources cause with an error of this parameter: the square of
    the cosine of the angle between them, by names of the sources.
    """

    sources: tuple[VarianceSource, ...]
    likeness: dict[tuple[str, str], float]


def sources_of(bound: BoundModel, information: Information) -> dict[str, SourcesOfVariance]:
    """Return all sources of the variance of every parameter, the largest share first.

    A model term whose coefficients have several origins is one source for each of them. The prior
    of the parameter itself and those of the other parameters are sources of their own.

    Parameters
    ----------
    bound
        Model bound to a campaign or plan.
    information
        Information of the bound model, given the hyper-parameters.
    """
    weights = np.eye(len(information.names))[information.interest]
    errors = _errors_by_source(bound, information, weights)
    sources = {}
    for i, name in enumerate(bound.names):
        sources[name] = _sources_of_quantity(errors, i, len(bound.names), (name,))
    return sources


def _sources_of_changes(
    bound: BoundModel, information: Information, changes: Mapping[str, CurveChange]
) -> dict[str, SourcesOfVariance]:
    """Return all sources of the variance of every change with force, the largest share first.

    The priors of the compliance's slopes are the change's own prior.
    """
    weights = np.eye(len(information.names))[information.interest]
    for change in changes.values():
        weights = np.concatenate([weights, change.weights[None]])
    errors = _errors_by_source(bound, information, weights)
    number = len(bound.names)
    sources = {}
    for k, (name, change) in enumerate(changes.items()):
        sources[name] = _sources_of_quantity(errors, number + k, number, change.slopes)
    return sources


def _sources_of_quantity(
    errors: Mapping[tuple[str, Origin], Array], i: int, number: int, own: Sequence[str]
) -> SourcesOfVariance:
    """Return the sources of the variance of one quantity, the largest share first.

    Parameters
    ----------
    errors
        Covariances of the errors of all quantities by source and origin, see `_errors_by_source`.
    i
        Place of the quantity among them.
    number
        Number p of parameters, which are the first of the quantities.
    own
        Names of the parameters whose priors are the quantity's own prior.
    """
    total = sum(errors.values(), np.zeros(()))
    variance = np.diag(total)
    sd = np.sqrt(np.where(variance > 0.0, variance, 1.0))
    shares: dict[tuple[str, Origin], float] = {}
    patterns: dict[str, Array] = {}
    for (source, origin), covariance in errors.items():
        label = OWN if source in own else source
        share = float(covariance[i, i] / sd[i] ** 2)
        shares[label, origin] = shares.get((label, origin), 0.0) + share
        if origin == Origin.ASSUMED:
            pattern = covariance[:number, i] / sd[:number]
            patterns[label] = patterns.get(label, 0.0) + pattern
    entries = []
    for (label, origin), share in shares.items():
        entries.append(VarianceSource(label, origin, share))
    ordered = ranked(entries, lambda source: source.share)
    return SourcesOfVariance(tuple(ordered), _likeness(patterns))


def _errors_by_source(
    bound: BoundModel, information: Information, weights: Array
) -> dict[tuple[str, Origin], Array]:
    """Return the covariance (q, q) of the errors of q quantities due to every source and origin.

    The name of a source is that of a model term, or that of the parameter whose prior it is.
    ``weights``, shape (q, m), are those of the m coefficients in the quantities.
    """
    origin_of = origins(bound, information)
    errors: dict[tuple[str, Origin], Array] = {}
    for key, covariance in information.error_covariances(weights).items():
        term = key[1]
        if term != OWN:
            source = (term, origin_of[key])
            errors[source] = errors.get(source, 0.0) + covariance
    if information.flat:
        return errors
    total = weights @ information.covariance()[:, information.interest]
    for j, name in enumerate(bound.names):
        origin = Origin.ASSUMED
        if is_prior_stated(bound, name):
            origin = Origin.STATED
        errors[name, origin] = np.outer(total[:, j], total[:, j])
    return errors


def _likeness(patterns: Mapping[str, Array]) -> dict[tuple[str, str], float]:
    """Return the squared cosine of the angle between every two patterns of errors, by names.

    A pattern, shape (p,), are the errors of all parameters that come with an error of one parameter
    from one source. The likeness of a pattern that is zero is zero.
    """
    if not patterns:
        return {}
    stacked = np.stack(list(patterns.values()))
    length = np.linalg.norm(stacked, axis=1, keepdims=True)
    unit = stacked / np.where(length > 0.0, length, 1.0)
    cosine = (unit @ unit.T).tolist()
    likeness = {}
    for first, row in zip(patterns, cosine, strict=True):
        for second, value in zip(patterns, row, strict=True):
            likeness[first, second] = value**2
    return likeness


def judge_parameters(
    bound: BoundModel,
    information: Information,
    mean: Array,
    sampled_sd: SampledSd | None = None,
) -> dict[str, ParameterIdentifiability]:
    """Return the verdict on every parameter of a model, without cures.

    Parameters
    ----------
    bound
        Model bound to a campaign or plan.
    information
        Information of the bound model, given the hyper-parameters.
    mean
        Mean of the p parameters, shape (p,), in internal units (mm, N, rad).
    sampled_sd
        Prior and posterior standard deviations from random draws, under the condition that no
        compliance is negative. Default: those of the linear Gaussian model.

    Returns
    -------
    dict of ParameterIdentifiability
        Verdict by parameter.
    """
    if sampled_sd is None:
        sampled_sd = _gaussian_sd(bound, information)
    removed_shares = {
        term: variance_share_removed(information, [term]) for term in information.terms
    }
    contributions = information.contributions()
    sources = sources_of(bound, information)
    origin_of = origins(bound, information)
    entries = {}
    for i, parameter in enumerate(bound.parameters):
        name = parameter.name
        variance_ratio = float(sampled_sd.posterior[i] / sampled_sd.prior[i]) ** 2
        contraction = 1.0 - variance_ratio
        judgement = judge(sources[name].sources, contraction, sources[name].likeness)
        partner_shares = _shares_by_name(judgement.partners)
        sd = float(sampled_sd.posterior[i])
        entry = ParameterIdentifiability(
            name=name,
            verdict=judgement.verdict,
            held_by=sources[name].sources[0],
            partners=tuple(partner_shares),
            partner_shares=partner_shares,
            sd_if_known=_sd_if_known(information, origin_of, tuple(partner_shares), i, sd),
            remedy=None,
            unit=parameter.unit,
            prior_mean=parameter.prior_mean,
            prior_sd=float(sampled_sd.prior[i]),
            mean=float(mean[i]),
            sd=sd,
            contraction=contraction,
            information_gain=_information_gain(variance_ratio),
            confounding={term: float(share[i]) for term, share in removed_shares.items()},
            shares={source: float(share[i]) for source, share in contributions.items()},
            origin_shares=_shares_by_origin(sources[name].sources),
        )
        if information.flat:
            entry = replace(entry, prior_mean=np.nan, contraction=np.nan, information_gain=np.nan)
        entries[name] = entry
    return entries


def _judge_changes(bound: BoundModel, information: Information) -> dict[str, ChangeIdentifiability]:
    """Return the verdict on the change of every compliance with force, without cures."""
    changes = curve_changes(bound, information)
    sources = _sources_of_changes(bound, information, changes)
    covariance = information.covariance()
    entries = {}
    for name, change in changes.items():
        variance = float(change.weights @ covariance @ change.weights)
        prior_sd = np.inf
        if not information.flat:
            prior_sd = float(np.linalg.norm(change.weights))
        contraction = 1.0 - variance / prior_sd**2
        judgement = judge(sources[name].sources, contraction, sources[name].likeness)
        entries[name] = ChangeIdentifiability(
            compliance=name,
            unit=change.unit,
            smallest_force_N=change.smallest_force_N,
            largest_force_N=change.largest_force_N,
            verdict=judgement.verdict,
            held_by=sources[name].sources[0],
            partner_shares=_shares_by_name(judgement.partners),
            remedy=None,
            prior_sd=prior_sd,
            sd=float(np.sqrt(variance)),
            origin_shares=_shares_by_origin(sources[name].sources),
        )
    return entries


def _remedies_of(
    bound: BoundModel,
    phi: Array,
    parameters: Mapping[str, ParameterIdentifiability],
    changes: Mapping[str, ChangeIdentifiability],
) -> dict[str, Remedy | None]:
    """Return the cheapest cure of every parameter and change, by names as those of `remedies`.

    ``phi``, shape (h,), are the hyper-parameters [mm] at which the verdicts were found.
    """
    entries: list[ParameterIdentifiability | ChangeIdentifiability] = []
    entries += parameters.values()
    entries += changes.values()
    sd = np.array([entry.sd for entry in entries])
    scatter = np.array([entry.origin_shares.get(Origin.MEASURED, 0.0) for entry in entries])
    return remedies(bound, phi, sd, scatter)


def _shares_by_name(sources: Sequence[VarianceSource]) -> dict[str, float]:
    """Return the shares of sources by name."""
    return {source.name: source.share for source in sources}


def _shares_by_origin(sources: Sequence[VarianceSource]) -> dict[Origin, float]:
    """Return the sum of the shares of all sources of each origin, in the order of `Origin`."""
    shares = dict.fromkeys(Origin, 0.0)
    for source in sources:
        shares[source.origin] += source.share
    return shares


def _sd_if_known(
    information: Information,
    origin_of: Mapping[tuple[str, str], Origin],
    partners: Sequence[str],
    i: int,
    sd: float,
) -> float | None:
    """Return the standard uncertainty of parameter i if some assumed effects were known exactly.

    Only what is assumed of an effect counts as known then: a deflection of the mount that a
    certificate states stays uncertain where its curvature, which nobody measured, becomes known.
    ``origin_of`` are the origins of all sources, ``partners`` model terms or other parameters, and
    ``sd`` is the present standard uncertainty. Return None if there are no partners.
    """
    if not partners:
        return None
    known = [name for name in partners if name in information.names]
    for name, owner in zip(information.names, information.owners, strict=True):
        if owner in partners and origin_of[name, owner] == Origin.ASSUMED:
            known.append(name)
    known_noise = [name for name in partners if origin_of.get((name, name)) == Origin.ASSUMED]
    variance = _without_noise(information, known_noise).variances(known)[i]
    ratio = float(variance / information.variances()[i])
    return sd * float(np.sqrt(np.clip(ratio, 0.0, 1.0)))


def _without_noise(information: Information, known: Sequence[str]) -> Information:
    """Return the information of readings without the noise of some terms, by their class names."""
    if not known:
        return information
    # Tests with the same noise share one dictionary of its sources, and do so in the result.
    remaining: dict[int, dict[str, Array]] = {}
    for sources in information.noise:
        remaining[id(sources)] = {name: sources[name] for name in sources if name not in known}
    return replace(information, noise=tuple(remaining[id(item)] for item in information.noise))


def _gaussian_sd(bound: BoundModel, information: Information) -> SampledSd:
    """Return prior and posterior standard deviations of all parameters without random draws.

    The standard deviations are those of the linear Gaussian model, in which compliances may be
    negative.
    """
    prior_sd = np.array([parameter.prior_sd for parameter in bound.parameters])
    posterior_sd = np.sqrt(information.variances()) * information.scale[information.interest]
    return SampledSd(prior_sd, posterior_sd)


def _information_gain(variance_ratio: float) -> float:
    """Return the information gain ½ ln(prior variance / posterior variance) of a parameter [nat].

    ``variance_ratio`` is the posterior variance divided by the prior variance.
    """
    if variance_ratio == 0.0:
        return np.inf
    return float(-0.5 * np.log(variance_ratio))


def _alias_matrix(bound: BoundModel, information: Information) -> pd.DataFrame:
    """Return the errors of least-squares estimates of the parameters caused by ignored nuisances.

    Rows are parameters, columns are nuisance coefficients. Each error is that for a nuisance whose
    size is one prior standard deviation, in internal units (mm, N, rad).
    """
    interest = information.interest
    names = np.array(information.names)
    nuisances = np.setdiff1d(np.arange(len(names)), interest)
    blocks = [test.factor @ bound.interest[r] for r, test in enumerate(bound.reduced)]
    rows = np.concatenate(blocks)
    effects = np.concatenate(information.design) * information.scale
    scale = information.scale[interest]
    alias = np.zeros((len(interest), len(nuisances)))
    for column, nuisance in enumerate(nuisances):
        alias[:, column] = minimum_norm_solution(rows, effects[:, nuisance], scale)
    alias[np.abs(alias) < _ROUNDING * scale[:, None]] = 0.0
    return pd.DataFrame(alias, names[interest].tolist(), names[nuisances].tolist())


def _correlation(information: Information) -> pd.DataFrame:
    """Return the posterior correlations of parameters and of nuisances that act in several tests.

    Rows and columns of the table are named by these coefficients.
    """
    covariance = information.covariance()
    names = list(information.names)
    sd = np.sqrt(np.diag(covariance))
    return pd.DataFrame(covariance / np.outer(sd, sd), names, names)
