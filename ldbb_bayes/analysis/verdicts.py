"""Verdicts on parameters: each parameter is identified, prior-limited or confounded.

A verdict states how well the readings determine a parameter. It is based on the sources of the
parameter's uncertainty. Each source has a share in the variance of the parameter
(`Information.shares`; the shares sum to one), and an origin. The origin says where the standard
uncertainty of the source comes from: it is measured by the readings of this campaign, stated by a
certificate or the user, or assumed by the model (`origins`). A parameter is confounded with an
assumed effect if this effect causes more than half of the variance. In this module, β are the
parameters (compliances, changes of compliances with force, and geometric errors) and y are the
readings. Nuisances are effects that are modelled but not of interest.

Shares and origins are computed for the linear Gaussian model, in which compliances may be negative.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from types import MappingProxyType
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from ldbb_bayes.analysis.confounding_rule import NEAR_TIE, confounding_sources
from ldbb_bayes.analysis.curve_changes import CurveChange
from ldbb_bayes.analysis.origins import Origin, ready_made_terms
from ldbb_bayes.analysis.paired_remedies import PairedRemedy
from ldbb_bayes.analysis.remedies import Remedy
from ldbb_bayes.analysis.variance_sources import (
    AveragedVariance,
    ModelVariance,
    VarianceSource,
    weights_of_parameters,
)
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.information import Information
from ldbb_bayes.results import Array, Finite, Number, Result

__all__ = [
    "CONTRACTION_LIMIT",
    "ChangeIdentifiability",
    "ParameterIdentifiability",
    "SampledSd",
    "Verdict",
    "judge",
    "judge_average",
    "judge_changes",
    "judge_parameters",
    "not_modelled",
    "shares_by_name",
]

# A parameter β is prior-limited if its contraction, 1 − Var(β | y) / Var(β) for readings y, is
# below this limit. The posterior sd of β is then more than half of its prior sd.
CONTRACTION_LIMIT = 0.75


class Verdict(StrEnum):
    """Verdict on a parameter, which states how well the readings determine the parameter.

    Every source of uncertainty has a share in the variance of the parameter, and an origin: its
    standard uncertainty is measured in this campaign, stated or assumed. The sources are the terms
    of the model and the priors of the parameters; if the coefficients of a term have several
    origins, the term counts as one source for each origin. The verdict is the first of these that
    applies (sd is the standard deviation):

    1. *confounded*, if more than half of the parameter's variance comes from one effect whose
       standard uncertainty is assumed, or from several such effects that act on the same
       combination of parameters;
    2. *prior-limited*, if the posterior sd is more than half of the prior sd;
    3. *identified*, if rules 1 and 2 do not apply.

    In rule 1, an effect is a term of the model, or another parameter through its prior. An effect
    that causes an error of this parameter also causes errors of the other parameters. These errors,
    in units of the parameters' posterior sds, form a vector. Two effects act on the same
    combination of parameters if their vectors are nearly proportional: the squared cosine of the
    angle between the vectors is at least 0.95. The effects with the largest shares are named, but
    no effect with a share below 5 %. If the named effects were known, at least their share of the
    variance would vanish, and the parameter's standard uncertainty would be smaller by about 30 %
    or more.

    A share that differs from one half by less than 1e-6 counts as one half, and therefore not as
    more than half. Effects whose shares differ by less than 1e-6 are ranked in the order of the
    model's terms.
    """

    IDENTIFIED = "identified"
    PRIOR_LIMITED = "prior-limited"
    CONFOUNDED = "confounded"


@dataclass(frozen=True, eq=False)
class ParameterIdentifiability(Result):
    """How well one parameter is known; values are in internal units composed of mm, N and rad.

    Examples
    --------
    >>> result = lb.identify(lb.HybridModel.first(0), campaign)
    >>> parameter = result.parameters["E_C0YX"]
    >>> parameter.verdict.value, parameter.partners
    ('confounded', ('BallForm',))
    >>> parameter.held_by.name, parameter.held_by.origin.value
    ('BallForm', 'assumed')
    >>> parameter.remedy.kind.value  # the cheapest remedy
    'balls'
    """

    name: str  #: name of the parameter, such as C_XXX
    #: verdict on how well the readings determine the parameter: identified, prior-limited or
    #: confounded
    verdict: Verdict
    #: source of uncertainty with the largest share of the parameter's variance
    held_by: VarianceSource
    #: names of the effects (model terms or other parameters) with which the parameter is
    #: confounded. The effect that causes the largest share of the parameter's variance comes first.
    #: Empty if the parameter is not confounded.
    partners: Annotated[tuple[str, ...], Field(alias="with")]
    #: for each effect with which the parameter is confounded (``partners``), the share of the
    #: parameter's variance that this effect causes; the keys are names of effects
    partner_shares: dict[str, float]
    #: standard uncertainty that the parameter would have if the effects with which it is confounded
    #: (``partners``) were known exactly; None if ``partners`` is empty
    sd_if_known: float | None
    #: cheapest remedy (a change of the plan or a certificate) that would reduce the standard
    #: uncertainty of the parameter, with the standard uncertainty after this remedy. None if no
    #: remedy reduces the standard uncertainty by more than 10 %, or if no remedies were looked for.
    remedy: Remedy | None
    #: the cheapest remedy (a change of the plan or a certificate) together with a second remedy, if
    #: the parameter is still confounded after the first remedy alone. None if there is no first
    #: remedy, if the first remedy alone is enough, or if no second remedy reduces the remaining
    #: standard uncertainty by more than 10 %.
    paired_remedy: PairedRemedy | None
    unit: str  #: internal unit of the parameter, composed of mm, N and rad
    prior_mean: Number  #: prior mean of the parameter; NaN for a flat prior
    #: prior standard deviation of the parameter; infinite for a flat prior
    prior_sd: Finite
    mean: float  #: posterior mean of the parameter; for a plan the prior mean
    sd: float  #: posterior standard deviation of the parameter
    #: contraction of a parameter: one minus its posterior variance divided by its prior variance;
    #: NaN for a flat prior
    contraction: Number
    #: mutual information of parameter and readings, ½ ln(prior variance / posterior variance)
    #: [nat]; NaN for a flat prior
    information_gain: Number
    #: for each model term, the share of the parameter's posterior variance that would vanish if the
    #: effect of the term were known exactly; the keys are class names of terms
    confounding: dict[str, float]
    #: share of the parameter's variance that each source causes; the shares sum to one, as in
    #: `budget_uncertainty`. Sources are the model terms, the reading noise, the priors of all
    #: parameters together (key ``Parameters``) and, in an average over models, the choice between
    #: the models.
    shares: dict[str, float]
    #: share of the parameter's variance that comes from the sources of each origin. The keys are
    #: the three origins of a standard uncertainty: measured in this campaign, stated or assumed.
    #: The shares sum to one.
    origin_shares: dict[Origin, float]


@dataclass(frozen=True, eq=False)
class ChangeIdentifiability(Result):
    """How well the change of one compliance C(F) over the tested forces is known.

    All quantities are in internal units (mm, N, rad). `Verdict` states the rules for the verdict.

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
    #: internal unit of the compliance, composed of mm, N and rad; its change with force has the
    #: same unit
    unit: str
    smallest_force_N: float  #: smallest force tested, F_min [N]
    largest_force_N: float  #: largest force tested, F_max [N]
    #: verdict (identified, prior-limited or confounded) on the change of the compliance from the
    #: smallest to the largest force tested
    verdict: Verdict
    #: source of uncertainty with the largest share in the variance of the compliance's change with
    #: force
    held_by: VarianceSource
    #: for each effect with which the compliance's change with force is confounded, the share of the
    #: change's variance that the effect causes; the keys are names of effects. Empty if the change
    #: is not confounded.
    partner_shares: dict[str, float]
    #: cheapest remedy (a certificate or a change of the plan) for a large uncertainty of the
    #: compliance's change with force; None if no remedy reduces this uncertainty by more than 10 %,
    #: or if no remedies were looked for
    remedy: Remedy | None
    #: prior standard deviation of the compliance's change with force; infinite for a flat prior
    prior_sd: Finite
    sd: float  #: posterior standard deviation of the compliance's change with force
    #: share of the variance of the compliance's change with force that comes from the sources of
    #: each origin. The keys are the three origins of a standard uncertainty: measured in this
    #: campaign, stated or assumed. The shares sum to one.
    origin_shares: dict[Origin, float]


class SampledSd(NamedTuple):
    """Prior and posterior standard deviations of all p parameters, shape (p,) each.

    The standard deviations come from random draws or from the linear Gaussian model. In the linear
    Gaussian model, posterior standard deviations are either averaged over the hyper-parameters or
    computed at one value of the hyper-parameters.
    """

    prior: Array
    posterior: Array


class PartneredVerdict(NamedTuple):
    """A verdict on a parameter, and the effects with which the parameter is confounded."""

    verdict: Verdict
    partners: tuple[VarianceSource, ...]


def judge(
    sources: Sequence[VarianceSource],
    contraction: float,
    likeness: Mapping[tuple[str, str], float] | None = None,
) -> PartneredVerdict:
    """Return the verdict on a parameter, and the effects with which it is confounded.

    The parameter is confounded if effects whose standard uncertainties are assumed cause more than
    half of its variance. Otherwise, it is prior-limited if its posterior sd is more than half of
    its prior sd, and identified if not. `Verdict` states the rules in full. With a flat prior, a
    parameter is never prior-limited.

    Parameters
    ----------
    sources
        All sources of the parameter's variance, the largest share first.
    contraction
        One minus the posterior variance divided by the prior variance; NaN for a flat prior.
    likeness
        Each source causes errors of all parameters, which form a vector. For each pair of sources
        whose standard uncertainties are assumed, ``likeness`` holds the squared cosine of the angle
        between their vectors. A key consists of the names of the two sources. Default: all sources
        are taken to act on the same combination of parameters.
    """
    partners = confounding_sources(sources, likeness)
    if partners:
        return PartneredVerdict(Verdict.CONFOUNDED, partners)
    if contraction < CONTRACTION_LIMIT - NEAR_TIE:
        return PartneredVerdict(Verdict.PRIOR_LIMITED, ())
    return PartneredVerdict(Verdict.IDENTIFIED, ())


def judge_parameters(
    bound: BoundModel, information: Information, mean: Array, sampled_sd: SampledSd | None = None
) -> dict[str, ParameterIdentifiability]:
    """Return for every parameter of a model whether it is identified, prior-limited or confounded.

    Parameters
    ----------
    bound
        Model of a campaign or of a plan.
    information
        Linear model of the readings (`Information`), at one value of the hyper-parameters.
    mean
        Posterior mean (for a plan, prior mean) of the p parameters, shape (p,), in internal units
        (mm, N, rad).
    sampled_sd
        Prior and posterior standard deviations of the parameters, as stated in the results. They
        either come from random draws in which no compliance is negative, or account for the spread
        of the hyper-parameters. If they are not given, the standard deviations of the linear
        Gaussian model ``information`` are used, which belong to one value of the hyper-parameters.

    Returns
    -------
    dict of ParameterIdentifiability
        Verdict on each parameter; the keys are names of parameters.
    """
    if sampled_sd is None:
        sampled_sd = _gaussian_sd(bound, information)
    weights = weights_of_parameters(information)
    model = ModelVariance(1.0, bound, information, weights, mean, sampled_sd.posterior)
    return judge_average(AveragedVariance((model,), len(mean)), bound, sampled_sd)


def judge_average(
    variance: AveragedVariance,
    bound: BoundModel,
    sampled_sd: SampledSd,
    slopes: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> dict[str, ParameterIdentifiability]:
    """Return how well the readings determine each parameter; the keys are names of parameters.

    The results are averaged over the models in ``variance``, which holds the variances of the
    parameters under each of one or more models. ``bound`` is a model that has all the parameters.
    ``sampled_sd`` holds the prior and posterior standard deviations that are reported for the
    parameters. ``slopes`` are the names of the slopes (changes with force) on which a compliance
    depends, because it is judged at another force than the reference force. The keys are names of
    compliances.
    """
    entries = {}
    for i, parameter in enumerate(bound.parameters):
        name = parameter.name
        variance_ratio = float(sampled_sd.posterior[i] / sampled_sd.prior[i]) ** 2
        contraction = 1.0 - variance_ratio
        sources = variance.sources(i, (name, *slopes.get(name, ())))
        judgement = judge(sources.sources, contraction, sources.likeness)
        partner_shares = shares_by_name(judgement.partners)
        sd_if_known = None
        if partner_shares:
            sd_if_known = float(variance.sd_without_assumed(tuple(partner_shares))[i])
        entry = ParameterIdentifiability(
            name=name,
            verdict=judgement.verdict,
            held_by=sources.sources[0],
            partners=tuple(partner_shares),
            partner_shares=partner_shares,
            sd_if_known=sd_if_known,
            remedy=None,
            paired_remedy=None,
            unit=parameter.unit,
            prior_mean=parameter.prior_mean,
            prior_sd=float(sampled_sd.prior[i]),
            mean=float(variance.mean[i]),
            sd=float(sampled_sd.posterior[i]),
            contraction=contraction,
            information_gain=_information_gain(variance_ratio),
            confounding={term: float(share[i]) for term, share in variance.shares_removed.items()},
            shares={term: float(share[i]) for term, share in variance.shares_by_term.items()},
            origin_shares=_shares_by_origin(sources.sources),
        )
        if bound.model.prior.flat:
            entry = replace(entry, prior_mean=np.nan, contraction=np.nan, information_gain=np.nan)
        entries[name] = entry
    return entries


def judge_changes(
    variance: AveragedVariance, changes: Mapping[str, CurveChange], prior_sd: Array
) -> dict[str, ChangeIdentifiability]:
    """Return how well the change of each compliance with force is known.

    The keys of ``changes`` and of the result are names of compliances. ``variance`` holds, under
    each model, the variances of all parameters and, after them, the variances of the changes.
    ``prior_sd`` holds the prior standard deviation of each change. A change that no model with
    posterior draws has is left out: it has no uncertainty to be judged.
    """
    entries = {}
    for k, (name, change) in enumerate(changes.items()):
        i = variance.number_of_parameters + k
        sd = float(np.sqrt(variance.variance[i]))
        if sd == 0.0:
            continue
        sources = variance.sources(i, change.slopes)
        contraction = 1.0 - float(sd / prior_sd[k]) ** 2
        judgement = judge(sources.sources, contraction, sources.likeness)
        entries[name] = ChangeIdentifiability(
            compliance=name,
            unit=change.unit,
            smallest_force_N=change.smallest_force_N,
            largest_force_N=change.largest_force_N,
            verdict=judgement.verdict,
            held_by=sources.sources[0],
            partner_shares=shares_by_name(judgement.partners),
            remedy=None,
            prior_sd=float(prior_sd[k]),
            sd=sd,
            origin_shares=_shares_by_origin(sources.sources),
        )
    return entries


def shares_by_name(sources: Sequence[VarianceSource]) -> dict[str, float]:
    """Return the share of each source in a quantity's variance; the keys are names of sources."""
    return {source.name: source.share for source in sources}


def _shares_by_origin(sources: Sequence[VarianceSource]) -> dict[Origin, float]:
    """Return the share of a quantity's variance that comes from each origin, as a dict.

    The standard uncertainty of a source of uncertainty has one of three origins, which are the keys
    of the result: it is measured in this campaign, stated or assumed. Each value is the sum of the
    shares of all sources with this origin.
    """
    shares = dict.fromkeys(Origin, 0.0)
    for source in sources:
        shares[source.origin] += source.share
    return shares


def _gaussian_sd(bound: BoundModel, information: Information) -> SampledSd:
    """Return the parameters' prior and posterior standard deviations in the linear Gaussian model.

    In this model, compliances may be negative.
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


def not_modelled(bound: BoundModel) -> tuple[str, ...]:
    """Return the class names of those terms of the ready-made model that the user has left out.

    ``bound`` was made from a ready-made model such as ``HybridModel.first``. The result is empty
    for the ready-made model ``paper``, which has no terms.
    """
    if bound.model.preset == "paper":
        return ()
    modelled = {type(term) for term in bound.model.nuisances}
    return tuple(kind.__name__ for kind in ready_made_terms(bound) if kind not in modelled)
