"""Verdicts whether each parameter is identified, prior-limited or confounded.

A parameter is confounded if the readings cannot separate it from another effect. In this module, β
are the parameters (compliances, their slopes and geometric errors) and y the readings. Nuisances
are effects that are modelled but not of interest. A degeneracy is a combination of parameters and
nuisance coefficients that no reading resolves.

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

from ldbb_bayes.analysis.aliases import (
    Degeneracy,
    Standing,
    StandingKind,
    degeneracies,
    standing_degeneracies,
)
from ldbb_bayes.analysis.cures import Cure, cures
from ldbb_bayes.analysis.value_of_certificates import worth_of_certificates
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.checks import centre_shift
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.posterior import bound_of, draws_of
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.hybrid import BoundModel, HybridModel, require_model
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.linear_algebra import minimum_norm_solution
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, ByRow, Finite, Number, Result
from ldbb_bayes.units import ranked

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "CONTRACTION_LIMIT",
    "MAJORITY",
    "OPEN_VARIANCE_SHARE",
    "Identifiability",
    "ParameterIdentifiability",
    "SampledSd",
    "Verdict",
    "hyper_parameter_nodes",
    "identify",
    "judge_parameters",
    "judge_posterior",
    "prior_dominated_share",
    "variance_share_removed",
]

# An effect counts as holding most of a parameter's posterior variance if its share of the variance
# is above this.
MAJORITY = 0.5
# A parameter β is prior-limited where its contraction, 1 − Var(β | y) / Var(β) for readings y, is
# below this.
CONTRACTION_LIMIT = 0.75
# A parameter is confounded if nuisances of unknown size that look exactly like it hold more than
# this share of its variance. A quarter of the variance is half of the standard uncertainty.
OPEN_VARIANCE_SHARE = 0.25
# An effect that holds less than this share of a parameter's variance is not named with the verdict
# on the parameter.
_NAMED_SHARE = 0.05
# The prior outweighs the readings tenfold, along a combination of coefficients, if the precision
# that the readings add is less than this share of the prior's precision.
_TENTH = 0.1
# A change of a parameter's least-squares estimate below this share of the parameter's prior
# standard deviation is a rounding error.
_ROUNDING = 1e-12
# Class names of terms that a model may leave out, by the kind of effect that they model; the effect
# then looks like a parameter.
_TERMS_LEFT_OUT = {StandingKind.FRICTION: "Hysteresis", StandingKind.DRIFT: "Drift"}


class Verdict(StrEnum):
    """Verdict on how well one parameter is known.

    Nuisances are effects that are modelled but not of interest. The contraction is one minus the
    ratio of posterior and prior variance; sd is the standard deviation. The rules apply in this
    order:

    1. *confounded*, when a term that the model's preset has, but the model leaves out, looks
       exactly like the parameter. Nothing then limits the size of this effect.
    2. *confounded*, when nuisances in the model look exactly like the parameter and make up more
       than half of its standard uncertainty: knowing them would remove more than a quarter of its
       variance. This holds only if neither a certificate nor the user states their size. A size
       inferred from other Fourier orders of the circle does not count.
    3. *confounded*, when more than half of the parameter's variance lies along combinations of
       coefficients for which the priors outweigh the readings, and more than half of it would
       vanish if the nuisances and the parameters that no reading separates from this parameter were
       known. Also *confounded*, when more than half of the variance lies along combinations for
       which the priors outweigh the readings tenfold, and more than half of it would vanish if the
       most correlated parameter were known.
    4. *prior-limited*, when the contraction is below 0.75: the posterior sd is more than half of
       the prior sd.
    5. *identified* otherwise, except where an effect that the model leaves out looks exactly like
       the parameter in these tests; then *confounded*. With one direction of travel, C_XYX looks
       like lost motion in proportion to force. In tests that ran in the order of force, direct
       compliances such as C_XXX look like a drift of the bar's length. Where `Position` is
       modelled, C_CXY looks like a drift of the circle's centre.

    If the circle's centre shifts in proportion to force, rotations caused by a force, such as
    C_CXY, are *confounded* with `Position`, whatever these rules give.
    """

    IDENTIFIED = "identified"
    PRIOR_LIMITED = "prior-limited"
    CONFOUNDED = "confounded"


@dataclass(frozen=True, eq=False)
class ParameterIdentifiability(Result):
    """How well one parameter is known, in internal units (mm, N, rad).

    Examples
    --------
    >>> result = lb.identify(lb.HybridModel.first(0), campaign)
    >>> parameter = result.parameters["C_XXX"]
    >>> round(parameter.contraction, 2)  # the readings narrow the prior
    1.0
    >>> share = parameter.partner_shares["Mount"]  # of the variance, due to the mount
    >>> parameter.verdict.value, round(share, 1)
    ('confounded', 0.6)
    """

    name: str  #: name of the parameter
    verdict: Verdict  #: verdict: identified, prior-limited or confounded
    #: effects that are named with the verdict, those with the largest share first. For a confounded
    #: parameter they are the model terms, then the parameters, from which it cannot be separated.
    #: For others they are the terms with more than 5 % of its variance.
    partners: Annotated[tuple[str, ...], Field(alias="with")]
    #: share of the parameter's posterior variance that vanishes if an effect in ``partners`` is
    #: known, by name of the effect; effects that the model leaves out have no share
    partner_shares: dict[str, float]
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
    degeneracies: tuple[Degeneracy, ...]  #: combinations of coefficients that no reading resolves
    #: remedies for each item of ``degeneracies``: further tests that resolve it when added to the
    #: plan, or a calibration
    cures: tuple[tuple[Cure, ...], ...]
    #: kinds of effect, such as friction, each with the parameters that it looks like: the model has
    #: no term for the effect, or only tests at different forces separate it from the parameters
    standing: tuple[Standing, ...]
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
    (the readings cannot separate it from another effect). No readings are needed, so that a plan
    can be judged before it is run. All is computed for the linear Gaussian model, in which
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
    return Identifiability(
        parameters=judge_parameters(bound, information, combinations, mean),
        degeneracies=combinations,
        cures=cures(bound, combinations),
        standing=standing_degeneracies(bound, combinations),
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
    (the readings cannot separate it from another effect).

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
    >>> judged["C_XXX"].verdict.value, judged["C_XXX"].partners[0]
    ('confounded', 'Mount')
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
        degeneracies(bound),
        beta.mean(axis=0),
        SampledSd(prior_sd, beta.std(axis=0)),
    )


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


def prior_dominated_share(information: Information, precision_ratio: float = 1.0) -> Array:
    """Return the share of each parameter's variance along combinations that priors dominate.

    Priors dominate a combination of coefficients if the readings add less than ``precision_ratio``
    times the precision of the prior. The combinations are the right singular vectors of the design
    matrix of all coefficients (parameters and nuisances), for readings in standard deviations of
    their noise and coefficients in prior standard deviations. Along each combination, the prior
    precision is therefore one, and the readings add the square of the singular value.

    Parameters
    ----------
    information
        Information of the readings about all coefficients, given the hyper-parameters.
    precision_ratio
        Limit of the precision that the readings add, divided by that of the prior.

    Returns
    -------
    ndarray
        Share of the variance of each of the p parameters, shape (p,).
    """
    rows = information.rows()
    coefficients = rows.shape[1]
    missing = max(coefficients - len(rows), 0)
    padded = np.concatenate([rows, np.zeros((missing, coefficients))])
    _, singular, right = np.linalg.svd(padded, full_matrices=False)
    precision = singular[:, None] ** 2
    variances = right[:, information.interest] ** 2 / (1.0 + precision)
    dominated = np.where(precision < precision_ratio, variances, 0.0)
    return np.asarray(dominated.sum(axis=0) / variances.sum(axis=0))


@dataclass(frozen=True)
class _ParameterFacts:
    """Facts about one parameter on which its verdict is based.

    ``index`` is the index of the parameter. ``removed_shares`` are the shares of its variance that
    knowing each model term would remove; ``squared_correlations`` those that knowing each other
    parameter would remove. ``dominated_share`` is the share of the variance along combinations of
    coefficients for which the priors outweigh the readings; ``tenfold_dominated_share`` is that
    along combinations for which the priors outweigh the readings tenfold. ``contraction`` is one
    minus the ratio of posterior and prior variance. ``degeneracies`` are the unresolved
    combinations with the parameter.
    """

    index: int
    removed_shares: Mapping[str, float]
    squared_correlations: Mapping[str, float]
    dominated_share: float
    tenfold_dominated_share: float
    contraction: float
    degeneracies: tuple[Degeneracy, ...]


class _Judgement(NamedTuple):
    """A verdict on a parameter, and its partners.

    ``partners`` are the names of the model terms or parameters from which the parameter cannot be
    separated, or that hold much of its variance.
    """

    verdict: Verdict
    partners: tuple[str, ...]


def judge_parameters(
    bound: BoundModel,
    information: Information,
    combinations: tuple[Degeneracy, ...],
    mean: Array,
    sampled_sd: SampledSd | None = None,
) -> dict[str, ParameterIdentifiability]:
    """Return the verdict on every parameter of a model.

    Parameters
    ----------
    bound
        Model bound to a campaign or plan.
    information
        Information of the bound model, given the hyper-parameters.
    combinations
        The `degeneracies` of the bound model.
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
    correlation = _correlation(information)
    removed_shares = {
        term: variance_share_removed(information, [term]) for term in information.terms
    }
    contributions = information.contributions()
    dominated = np.zeros(len(bound.names))
    tenfold_dominated = np.zeros(len(bound.names))
    if not information.flat:
        dominated = prior_dominated_share(information)
        tenfold_dominated = prior_dominated_share(information, _TENTH)
    left_out = _terms_left_out(bound, combinations)
    shifted = _shifted_parameters(bound, mean)
    entries = {}
    for i, parameter in enumerate(bound.parameters):
        name = parameter.name
        prior_sd = float(sampled_sd.prior[i])
        variance_ratio = float(sampled_sd.posterior[i] / sampled_sd.prior[i]) ** 2
        facts = _ParameterFacts(
            index=i,
            removed_shares={term: float(share[i]) for term, share in removed_shares.items()},
            squared_correlations=_squared_correlations(correlation, bound.names, name),
            dominated_share=dominated[i],
            tenfold_dominated_share=tenfold_dominated[i],
            contraction=1.0 - variance_ratio,
            degeneracies=tuple(d for d in combinations if name in d.parameters),
        )
        judgement = _allow_for_effects_left_out(
            _judge(information, facts), left_out.get(name, ()), is_shifted=name in shifted
        )
        shares = {**facts.removed_shares, **facts.squared_correlations}
        entry = ParameterIdentifiability(
            name=name,
            verdict=judgement.verdict,
            partners=judgement.partners,
            partner_shares={
                partner: shares[partner] for partner in judgement.partners if partner in shares
            },
            unit=parameter.unit,
            prior_mean=parameter.prior_mean,
            prior_sd=prior_sd,
            mean=float(mean[i]),
            sd=float(sampled_sd.posterior[i]),
            contraction=facts.contraction,
            information_gain=_information_gain(variance_ratio),
            confounding=dict(facts.removed_shares),
            shares={source: float(share[i]) for source, share in contributions.items()},
        )
        if information.flat:
            entry = replace(entry, prior_mean=np.nan, contraction=np.nan, information_gain=np.nan)
        entries[name] = entry
    return entries


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


def _squared_correlations(
    correlation: pd.DataFrame, names: Sequence[str], name: str
) -> dict[str, float]:
    """Return the squared posterior correlation of a parameter with every other one, by name.

    ``correlation`` is the matrix of posterior correlations, ``name`` the name of the parameter, and
    ``names`` are the names of all parameters.
    """
    row = correlation[name]
    return {partner: float(row[partner] ** 2) for partner in names if partner != name}


def _terms_left_out(
    bound: BoundModel, combinations: Sequence[Degeneracy]
) -> dict[str, tuple[str, ...]]:
    """Return the terms that the model lacks and that look exactly like a parameter, by parameter.

    The terms are given by class name, such as ``Drift``. Only parameters with such terms are
    listed.
    """
    parameters_by_kind = {
        standing.kind: standing.parameters
        for standing in standing_degeneracies(bound, combinations)
    }
    terms: dict[str, tuple[str, ...]] = {}
    for kind, term in _TERMS_LEFT_OUT.items():
        for name in parameters_by_kind.get(kind, ()):
            terms[name] = (*terms.get(name, ()), term)
    return terms


def _shifted_parameters(bound: BoundModel, mean: Array) -> tuple[str, ...]:
    """Return the names of the compliances that a shift of the circle's centre may imitate.

    These are the rotations caused by a force, such as ``C_CXY``, if the estimated centre of the
    circles shifts in proportion to force. Otherwise, and for a plan, there are none. ``mean``,
    shape (p,), are the estimated parameters.
    """
    if bound.campaign.is_plan or not centre_shift(bound, mean):
        return ()
    return tuple(name.label for name in bound.compliances if name.kind == "rotation_for_force")


def _judge(information: Information, facts: _ParameterFacts) -> _Judgement:
    """Return the verdict on one parameter by the rules of `Verdict`.

    ``facts`` are about this parameter, and ``information`` is about all coefficients. Effects that
    are neither terms of the model nor of its preset are not considered.
    """
    removed = facts.removed_shares
    terms = information.shared_terms
    heavy_terms = [term for term in terms if removed[term] > _NAMED_SHARE]
    heavy = tuple(ranked(heavy_terms, removed.__getitem__))
    modelled = {d.term for d in facts.degeneracies if d.modelled}
    exact = tuple(term for term in heavy if term in modelled)
    not_modelled = dict.fromkeys(d.term for d in facts.degeneracies if not d.modelled)
    if not_modelled:
        return _Judgement(Verdict.CONFOUNDED, (*not_modelled, *exact))
    open_terms = _open_terms(exact, facts.degeneracies)
    if open_terms:
        share = variance_share_removed(information, open_terms)[facts.index]
        if share > OPEN_VARIANCE_SHARE:
            return _Judgement(Verdict.CONFOUNDED, open_terms)
    partners = _inseparable_partners(information, facts, exact or heavy)
    if partners:
        return _Judgement(Verdict.CONFOUNDED, partners)
    if facts.contraction < CONTRACTION_LIMIT:
        return _Judgement(Verdict.PRIOR_LIMITED, heavy)
    return _Judgement(Verdict.IDENTIFIED, heavy)


def _open_terms(terms: Sequence[str], combinations: Sequence[Degeneracy]) -> tuple[str, ...]:
    """Return those of the given model terms whose size neither a certificate nor the user states.

    The answer is taken from ``combinations``, the degeneracies (combinations of coefficients that
    no reading resolves); terms without a coefficient in them are not returned.
    """
    not_stated = {d.term for d in combinations if d.modelled and not d.stated}
    return tuple(term for term in terms if term in not_stated)


def _inseparable_partners(
    information: Information, facts: _ParameterFacts, partner_terms: Sequence[str]
) -> tuple[str, ...]:
    """Return the terms and parameters that make a parameter confounded by rule 3 of `Verdict`.

    If the rule does not apply, return an empty tuple. ``facts`` are those about the parameter;
    ``partner_terms`` are the terms to name if the rule applies.
    """
    correlations = facts.squared_correlations
    rivals = ranked(correlations, correlations.__getitem__)
    twins = _twins(rivals, facts.degeneracies)
    named_twins = [name for name in twins if correlations[name] > _NAMED_SHARE]
    partners = (*partner_terms, *named_twins)
    if facts.dominated_share > MAJORITY and partners:
        names = (*information.shared_terms, *twins)
        if variance_share_removed(information, names)[facts.index] > MAJORITY:
            return partners
    if facts.tenfold_dominated_share > MAJORITY and rivals:
        nearest = rivals[0]
        if correlations[nearest] > MAJORITY:
            return (nearest,)
    return ()


def _twins(names: Sequence[str], combinations: Sequence[Degeneracy]) -> tuple[str, ...]:
    """Return those of the named parameters that no reading separates from other parameters.

    They are the members of those ``combinations`` that contain parameters only, no nuisances.
    """
    inseparable = set[str]()
    for degeneracy in combinations:
        if not degeneracy.term:
            inseparable.update(degeneracy.parameters)
    return tuple(name for name in names if name in inseparable)


def _allow_for_effects_left_out(
    judgement: _Judgement, terms: tuple[str, ...], *, is_shifted: bool
) -> _Judgement:
    """Return the verdict on a parameter, changed for effects that the model leaves out.

    ``terms`` are the terms left out of the model that look exactly like the parameter. They make an
    identified parameter confounded. ``is_shifted`` states whether the parameter is a rotation that
    a shift of the circle's centre may imitate. If it is, the parameter becomes confounded with
    ``Position``, whatever ``judgement`` states.
    """
    verdict = judgement.verdict
    partners = judgement.partners
    if terms and verdict == Verdict.IDENTIFIED:
        verdict = Verdict.CONFOUNDED
        partners = (*terms, *partners)
    if is_shifted:
        verdict = Verdict.CONFOUNDED
        partners = tuple(dict.fromkeys(["Position", *partners]))
    return _Judgement(verdict, partners)


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
