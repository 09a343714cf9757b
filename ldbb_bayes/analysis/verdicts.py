"""Verdicts on parameters: each parameter is identified, prior-limited or confounded.

A verdict states how well the readings determine a parameter. It is based on the sources of the
parameter's uncertainty. Each source has a share in the variance of the parameter
(`Information.shares`; the shares sum to one), and an origin. The origin says where the standard
uncertainty of the source comes from: it is measured by the readings of this campaign, stated by a
certificate or the user, or assumed by the model (`origins`). A parameter is confounded with an
assumed effect if this effect causes more than half of the variance. In this module, β are the
parameters (compliances, changes of compliances with force, and geometric errors) and y are the
readings. Nuisances are effects that are modelled but not of interest.

Shares, origins and degeneracies (combinations of coefficients whose effects on the readings cancel)
are computed for the linear Gaussian model, in which compliances may be negative. They are computed
at one value of the hyper-parameters φ, such as the standard deviation of the noise. For a campaign
with readings, this value is the posterior mean of φ. For a plan, the value is the posterior mean
given the readings of the plan's pilot (the campaign from which the plan was designed) or, without a
pilot, the prior median; a plan can therefore be judged before it is run. Standard uncertainties, in
contrast, account for the spread of φ: the variance is the mean of the variances given φ plus the
variance of the means given φ. The uncertainties to expect with further certificates account for the
spread of φ, too. If a posterior is judged, the standard uncertainties are the standard deviations
of its draws; if a plan is judged, they come from its forecast.

In an average over models, shares and variances are averaged over the models, weighted by the
models' probabilities (`variance_sources`). The verdicts are then determined by the same rules as
for a single model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
import pandas as pd
from pydantic import Field

from ldbb_bayes.analysis.aliases import Degeneracy, degeneracies
from ldbb_bayes.analysis.confounding_rule import NEAR_TIE, confounding_sources
from ldbb_bayes.analysis.cures import Cure, cures
from ldbb_bayes.analysis.curve_changes import CurveChange, curve_changes
from ldbb_bayes.analysis.design.averaged_forecast import averaged_uncertainties
from ldbb_bayes.analysis.design.candidates import bind_plan
from ldbb_bayes.analysis.design.forecast import (
    SimulatedAnalyses,
    forecast_plan,
    simulate_analyses,
    states_of,
)
from ldbb_bayes.analysis.design.states import extend_hyper_parameters
from ldbb_bayes.analysis.nested_models import averaged_sds
from ldbb_bayes.analysis.origins import Origin, ready_made_terms
from ldbb_bayes.analysis.paired_remedies import PairedRemedy, paired_remedies
from ldbb_bayes.analysis.remedies import Remedy, remedies
from ldbb_bayes.analysis.tried_remedies import TriedRemedies
from ldbb_bayes.analysis.value_of_certificates import averaged_moments, worth_of_certificates
from ldbb_bayes.analysis.variance_sources import (
    AveragedVariance,
    ModelVariance,
    VarianceSource,
    sources_of,
    weights_of_parameters,
)
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.averaged_models import AveragedModel, averaged_models
from ldbb_bayes.inference.coefficients import compliance_curves
from ldbb_bayes.inference.kept_results import kept
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.posterior import bound_of
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.hybrid import BoundModel, HybridModel, require_model
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.linear_algebra import minimum_norm_solution
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, ByRow, Finite, Number, Result

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "CONTRACTION_LIMIT",
    "ChangeIdentifiability",
    "Identifiability",
    "JudgedQuantities",
    "ParameterIdentifiability",
    "SampledSd",
    "Verdict",
    "confounded_in",
    "confounded_parameters",
    "hyper_parameter_nodes",
    "identify",
    "judge",
    "judge_parameters",
    "judge_posterior",
    "judge_quantities",
    "not_modelled",
    "variance_share_removed",
]

# A parameter β is prior-limited if its contraction, 1 − Var(β | y) / Var(β) for readings y, is
# below this limit. The posterior sd of β is then more than half of its prior sd.
CONTRACTION_LIMIT = 0.75
# Limit below which the bias of a least-squares estimate counts as a rounding error and is set to
# zero. The bias is the error that a nuisance effect (modelled, but not of interest) causes. The
# limit is a fraction of the parameter's prior standard deviation or, with a flat prior, of a
# typical size of the parameter.
_ROUNDING = 1e-12
# Number of values of the hyper-parameters over which uncertainties are averaged that are averaged
# over constant and linear compliance too.
_AVERAGED_VALUES = 128


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

    #: how well the readings determine each parameter (identified, prior-limited or confounded); the
    #: keys are names of parameters
    parameters: dict[str, ParameterIdentifiability]
    #: how well the change of each compliance over the tested forces is known; the keys are names of
    #: compliances
    changes: dict[str, ChangeIdentifiability]
    #: degeneracies: combinations of model coefficients whose effects on the readings cancel
    degeneracies: tuple[Degeneracy, ...]
    #: for each of the ``degeneracies`` (combinations of coefficients whose effects on the readings
    #: cancel), the ways to separate the effects: kinds of further tests, or a calibration
    cures: tuple[tuple[Cure, ...], ...]
    #: class names of the model terms that belong to the ready-made model, such as
    #: ``HybridModel.first``, but that the user has left out. Their effects are not included in the
    #: credible intervals of the parameters.
    not_modelled: tuple[str, ...]
    #: effective number of parameters that the readings determine: the sum of the contractions of
    #: all parameters. The contraction of a parameter is one minus its posterior variance divided by
    #: its prior variance. For a flat prior, the effective number is the number of all parameters.
    effective_parameters: float
    #: table of errors of least-squares estimates, in internal units (mm, N, rad). Rows are
    #: parameters, and columns are nuisance coefficients (of effects not of interest). Each entry is
    #: the error of the parameter's estimate if the nuisance coefficient is equal to its prior
    #: standard deviation and the fit ignores this coefficient.
    alias: ByRow
    #: table of posterior correlations between coefficients: the parameters, and the coefficients of
    #: nuisances (effects not of interest) that act in several tests
    correlation: ByRow
    #: standard uncertainties to expect with further certificates of the instrument. The outer keys
    #: are the cases, and the inner keys are names of parameters. The cases are "none of these", the
    #: name of each certificate that the instrument does not have yet and, if there are several such
    #: certificates, "all of these". For a flat prior, there are no entries.
    certificates: dict[str, dict[str, float]]
    #: values of the hyper-parameters, such as the standard deviation of the noise, at which the
    #: verdicts on the parameters are computed; the keys are names of hyper-parameters. Lengths are
    #: in µm. Some hyper-parameters are numbers without a unit, such as the factor λ by which the
    #: noise of a circle is larger or smaller than average.
    hyper_um: dict[str, float]
    #: whether the campaign has readings; false for a plan
    measured: bool
    #: standard uncertainties of the compliances and geometric errors, averaged over constant and
    #: linear compliance, as the sheets of a report state them; for a plan, those to expect. They
    #: account for the condition that no compliance is negative. The keys are names of parameters.
    #: Empty if compliance is not linear in the model, or if priors are flat.
    averaged_sd: dict[str, float] = field(default_factory=dict)
    #: whether the hyper-parameters of a plan are those that the readings of its pilot leave likely;
    #: false for a plan without a measured pilot, and for a campaign with readings
    scales_from_pilot: bool = False


def _scales_before(bound: BoundModel, plan: Campaign) -> tuple[Array, Array]:
    """Return w weighted sets of values of the hyper-parameters for which a plan is judged.

    A hyper-parameter is, for example, the standard deviation of the noise. The first result holds
    the weights of the sets, shape (w,). The second result holds the sets, shape (w, h), with one
    value for each of the h hyper-parameters. The weighted sets represent the posterior of the
    hyper-parameters given the readings of the plan's pilot (the campaign from which the plan was
    designed). Without such readings, the only set consists of the prior medians.
    """
    pilot = plan.pilot
    if pilot is None or pilot.is_plan:
        return hyper_parameter_nodes(bound)
    run = len(pilot.tests) if plan.adds_to_pilot else 0
    phi = extend_hyper_parameters(bound, states_of(bound.model, plan).phi, run)
    return np.full(len(phi), 1.0 / len(phi)), phi


def _expected_sd(bound: BoundModel, plan: Campaign, analyses: SimulatedAnalyses) -> SampledSd:
    """Return the parameters' standard deviations before and after a plan is run.

    The first are the prior standard deviations. The second are the posterior standard deviations to
    expect, taken from the forecast that `design` makes. ``analyses`` are simulated analyses of the
    plan's tests.
    """
    expected = forecast_plan(bound.model, plan, analyses=analyses).expected
    return SampledSd(bound.prior_sd, np.array([entry.sd for entry in expected.values()]))


class _JudgedTests(NamedTuple):
    """Tests that are judged, and what is known or expected of them from elsewhere."""

    bound: BoundModel  #: model applied to the tests
    weight: Array  #: weights of w values of the hyper-parameters, shape (w,)
    #: w values of the h hyper-parameters (such as the standard deviation of the noise), shape
    #: (w, h), lengths in mm
    phi: Array
    #: prior standard deviations, and those to expect from the tests of a plan; None for tests with
    #: readings, and if priors are flat
    expected: SampledSd | None
    averaged_sd: dict[str, float]  #: see ``Identifiability.averaged_sd``


def _judged_plan(model: HybridModel, plan: Campaign) -> _JudgedTests:
    """Return the tests of a plan, with the uncertainties to expect from them."""
    bound = bind_plan(model, plan)
    weight, phi = _scales_before(bound, plan)
    if model.prior.flat:
        return _JudgedTests(bound, weight, phi, None, {})
    analyses = simulate_analyses(model, plan)
    expected = _expected_sd(bound, plan, analyses)
    averaged = averaged_uncertainties(analyses)
    averaged_sd = {name: entry.sd for name, entry in averaged.items()}
    return _JudgedTests(bound, weight, phi, expected, averaged_sd)


def _judged_campaign(model: HybridModel, campaign: Campaign) -> _JudgedTests:
    """Return the tests of a campaign with readings."""
    bound = model.bind(campaign)
    weight, phi = hyper_parameter_nodes(bound)
    return _JudgedTests(bound, weight, phi, None, _averaged_sd_now(bound, weight, phi))


def _averaged_sd_now(bound: BoundModel, weight: Array, phi: Array) -> dict[str, float]:
    """Return the uncertainties of a campaign with readings, averaged over constant and linear.

    See ``Identifiability.averaged_sd``. ``phi``, shape (w, h), are w values of the
    hyper-parameters, and ``weight``, shape (w,), their weights, as `hyper_parameter_nodes` returns
    them.
    """
    steps = (np.arange(_AVERAGED_VALUES) + 0.5) / _AVERAGED_VALUES
    chosen = np.searchsorted(np.cumsum(weight) / weight.sum(), steps)
    return averaged_sds(bound, phi[chosen], truncated=False)


def _scaled_to_forecast(
    expected: SampledSd, bound: BoundModel, certificates: Mapping[str, Mapping[str, float]]
) -> dict[str, dict[str, float]]:
    """Return standard uncertainties with further certificates, scaled to agree with a forecast.

    The keys of ``certificates`` are certificates that the instrument could have in addition. Each
    value holds the standard uncertainty that every parameter would have with this certificate. The
    first entry holds the standard uncertainties without a further certificate. For each parameter,
    all standard uncertainties are multiplied by the same factor. The factor is chosen so that the
    standard uncertainty without a further certificate is equal to the forecast ``expected``.
    """
    without = next(iter(certificates.values()))
    scaled = {}
    for certificate, sd in certificates.items():
        scaled[certificate] = {
            name: sd[name] * float(expected_sd) / without[name]
            for name, expected_sd in zip(bound.names, expected.posterior, strict=True)
        }
    return scaled


class SampledSd(NamedTuple):
    """Prior and posterior standard deviations of all p parameters, shape (p,) each.

    The standard deviations come from random draws or from the linear Gaussian model. In the linear
    Gaussian model, posterior standard deviations are either averaged over the hyper-parameters or
    computed at one value of the hyper-parameters.
    """

    prior: Array
    posterior: Array


@one_blas_thread
def identify(model: HybridModel, campaign: Campaign) -> Identifiability:
    """Return how well a campaign or a plan determines the parameters of a model.

    The verdict on each parameter is identified, prior-limited (the readings hardly narrow its
    prior) or confounded (most of its variance comes from effects whose standard uncertainty is
    assumed). No readings are needed, so that a plan can be judged before it is run. All results
    come from the linear Gaussian model, in which compliances may be negative. Shares of the
    variance are computed at the posterior mean of the hyper-parameters (such as the standard
    deviation of the noise). For a plan, the shares are computed at the posterior mean given the
    readings of the plan's pilot (the campaign from which the plan was designed) or, without a
    pilot, at the prior median. Standard uncertainties are averaged over the hyper-parameters. For a
    plan, they are the standard uncertainties to expect when the plan has been run; `design`
    forecasts the same values.

    Parameters
    ----------
    model : HybridModel
        Model with its nuisances and priors.
    campaign : Campaign
        Tests with or without readings.

    Returns
    -------
    Identifiability
        Verdicts on the parameters. The result also holds combinations of coefficients whose effects
        on the readings cancel, further tests that would separate these effects, and the
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
    judged = _judged_plan if campaign.is_plan else _judged_campaign
    bound, weight, nodes, expected, averaged_sd = judged(model, campaign)
    phi = weight @ nodes
    information = information_of(bound, phi)
    combinations = degeneracies(bound)
    effective_parameters = float(len(bound.names))
    certificates: dict[str, dict[str, float]] = {}
    if not information.flat:
        effective_parameters -= float(information.variances().sum())
        certificates = worth_of_certificates(bound, weight, nodes)
    if expected is not None and certificates:
        certificates = _scaled_to_forecast(expected, bound, certificates)
    changes = curve_changes(bound, information)
    variance = _averaged_over_scales(bound, information, changes, weight, nodes)
    prior_sd = np.array([parameter.prior_sd for parameter in bound.parameters])
    posterior_sd = variance.models[0].sd[: variance.number_of_parameters]
    if expected is None:
        expected = SampledSd(prior_sd, posterior_sd)
    parameters = _judge_average(variance, bound, expected)
    changes_judged = _judge_changes(variance, changes, _prior_sd_of_changes(information, changes))
    tried = TriedRemedies(bound, phi)
    found = _remedies_of(tried, parameters, changes_judged)
    found |= _with_averaged_certificates(found, certificates)
    sd_by_parameter = {name: entry.sd for name, entry in parameters.items()}
    confounded = [name for name, entry in parameters.items() if entry.partners]
    pairs = paired_remedies(tried, found, sd_by_parameter, confounded)
    return Identifiability(
        parameters={
            name: replace(entry, remedy=found[name], paired_remedy=pairs.get(name))
            for name, entry in parameters.items()
        },
        changes={
            name: replace(entry, remedy=found[f"change of {name}"])
            for name, entry in changes_judged.items()
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
        averaged_sd=averaged_sd,
        scales_from_pilot=_has_measured_pilot(campaign),
    )


def _has_measured_pilot(campaign: Campaign) -> bool:
    """Return whether a campaign is a plan that was designed from a campaign with readings."""
    return campaign.is_plan and campaign.pilot is not None and not campaign.pilot.is_plan


def _with_averaged_certificates(
    found: Mapping[str, Remedy | None], certificates: Mapping[str, Mapping[str, float]]
) -> dict[str, Remedy | None]:
    """Return the remedies that are certificates, with uncertainties averaged over the scales.

    A remedy is found at one value of the hyper-parameters (scales of noise and effects). The
    uncertainties with further certificates, ``certificates``, are averaged over the
    hyper-parameters instead; both are stated, and must agree. The keys of ``found`` and of the
    result are names of parameters; those of ``certificates`` are names of certificates, the first
    of which stands for no further certificate.
    """
    averaged: dict[str, Remedy | None] = {}
    without = next(iter(certificates.values()), {})
    for name, remedy in found.items():
        if remedy is None or not remedy.certificate or name not in without:
            continue
        ratio = certificates[remedy.certificate][name] / without[name]
        sd_before = remedy.sd / remedy.ratio
        averaged[name] = replace(remedy, sd=ratio * sd_before, ratio=ratio)
    return averaged


def _averaged_over_scales(
    bound: BoundModel,
    information: Information,
    changes: Mapping[str, CurveChange],
    weight: Array,
    phi: Array,
) -> AveragedVariance:
    """Return the posterior variance of each quantity under one model, and what causes it.

    The quantities are the parameters of ``bound``, and the changes of compliances with force
    (``changes``). Each variance is a weighted mean of variances at w values of the
    hyper-parameters, plus the variance of the means at these values. ``phi``, shape (w, h), holds
    the w values of the h hyper-parameters, and ``weight``, shape (w,), their weights. The shares of
    the sources in the variances are computed from ``information``, the linear model at the mean of
    the hyper-parameters.
    """
    weights = _weights_of_quantities(information, changes)
    moments = averaged_moments(bound, weights / information.scale, weight, phi)
    mean = moments.mean
    if bound.campaign.is_plan:
        prior_mean = np.zeros(len(information.names))
        prior_mean[information.interest] = bound.prior_mean / bound.scale
        mean = weights @ prior_mean
    model = ModelVariance(1.0, bound, information, weights, mean, moments.sd)
    return AveragedVariance((model,), len(bound.names))


def _weights_of_quantities(information: Information, changes: Mapping[str, CurveChange]) -> Array:
    """Return the change of each quantity when one coefficient alone changes by its prior sd.

    The result has one row for each of the q quantities and one column for each of the m
    coefficients, shape (q, m). The quantities are all parameters, then all changes of compliances
    with force.
    """
    rows = [change.weights for change in changes.values()]
    return np.concatenate([weights_of_parameters(information), *(row[None] for row in rows)])


def _prior_sd_of_changes(information: Information, changes: Mapping[str, CurveChange]) -> Array:
    """Return prior standard deviations of the compliances' changes with force, shape (changes,).

    A change is the compliance at the largest force tested minus the compliance at the smallest.
    ``changes`` holds the effect of every coefficient of the model on each change. For a flat prior,
    the standard deviations are infinite.
    """
    if information.flat:
        return np.full(len(changes), np.inf)
    return np.array([float(np.linalg.norm(change.weights)) for change in changes.values()])


@one_blas_thread
def judge_posterior(posterior: xr.DataTree) -> dict[str, ParameterIdentifiability]:
    """Return the verdict on every parameter of a posterior.

    The verdict is identified, prior-limited (the readings hardly narrow the parameter's prior) or
    confounded (most of the parameter's variance comes from effects whose standard uncertainty is
    assumed). The field ``remedy`` is None for every parameter; `identify` finds remedies for large
    uncertainties.

    If the posterior is an average over models (`average`), the variance of a parameter is the sum
    of two parts. The first part is the mean of the parameter's variances under the models, and the
    second part is the variance of its means under the models. The second part is a separate source
    of uncertainty, ``ModelChoice``. The share of every other source in the first part is averaged
    over the models. In this average, the weight of a model is its probability times the parameter's
    variance under this model.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.

    Returns
    -------
    dict of str to ParameterIdentifiability
        Verdict on each parameter; the keys are names of parameters. The verdict is computed at the
        posterior mean of the hyper-parameters (such as the standard deviation of the noise) under
        each model. The fields ``mean``, ``sd`` and ``contraction`` come from the posterior draws.

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
    return dict(judge_quantities(posterior).parameters)


class JudgedQuantities(NamedTuple):
    """How well the readings determine the parameters and the changes of compliances with force.

    The keys of ``parameters`` are names of parameters; the keys of ``changes`` are names of
    compliances.
    """

    parameters: dict[str, ParameterIdentifiability]
    changes: dict[str, ChangeIdentifiability]


@kept
@one_blas_thread
def judge_quantities(posterior: xr.DataTree) -> JudgedQuantities:
    """Return the verdict on every parameter, and on every compliance's change with force.

    Each verdict is identified, prior-limited or confounded. The verdicts on the parameters are
    those that `judge_posterior` returns. The change of a compliance is its value at the largest
    force tested minus its value at the smallest. The same rules give the verdict on a change, from
    posterior draws of the change. If the posterior is an average over models, the prior variance of
    a change is the mean of its prior variances under the models, all with the same weight; models
    without posterior draws are left out.
    """
    bound = bound_of(posterior)
    models = averaged_models(posterior)
    # The changes of compliances with force are computed from the model ``bound``, because this
    # model has all parameters that occur in any of the averaged models.
    phi = np.concatenate([model.phi for model in models]).mean(axis=0)
    all_changes = curve_changes(bound, information_of(bound, phi))
    variances = [_variance_of_model(model, all_changes) for model in models]
    variance = AveragedVariance(tuple(variances), len(bound.names))
    prior_variance = np.zeros(len(all_changes))
    for model_variance in variances:
        weights = model_variance.weights[variance.number_of_parameters :]
        prior_variance += np.sum(weights**2, axis=1) / len(variances)
    if bound.model.prior.flat:
        prior_variance = np.full(len(all_changes), np.inf)
    return JudgedQuantities(
        _judge_average(variance, bound, _sampled_sd(posterior, bound, variance)),
        _judge_changes(variance, all_changes, np.sqrt(prior_variance)),
    )


def _variance_of_model(model: AveragedModel, changes: Mapping[str, CurveChange]) -> ModelVariance:
    """Return the variances of parameters and of compliances' changes with force in one model.

    ``model`` is one of several models whose results are averaged. ``changes`` holds the changes of
    compliances with force that occur in any of these models; the keys are names of compliances. In
    the result, the parameters come first, then the changes. If a change does not occur in
    ``model``, its row of ``ModelVariance.weights`` is zero. This row states how much the change
    depends on each coefficient of the model.
    """
    bound = model.bound
    information = information_of(bound, model.phi.mean(axis=0))
    number_of_parameters = model.beta.shape[1]
    weights = np.zeros((number_of_parameters + len(changes), len(information.names)))
    weights[model.places] = weights_of_parameters(information)
    mean = [model.mean]
    sd = [model.sd]
    if changes:
        changes_of_model = curve_changes(bound, information)
        for k, name in enumerate(changes):
            if name in changes_of_model:
                weights[number_of_parameters + k] = changes_of_model[name].weights
        drawn = _drawn_changes(model, list(changes))
        mean.append(drawn.mean(axis=0))
        sd.append(drawn.std(axis=0))
    return ModelVariance(
        probability=model.probability,
        bound=bound,
        information=information,
        weights=weights,
        mean=np.concatenate(mean),
        sd=np.concatenate(sd),
    )


def _drawn_changes(model: AveragedModel, names: Sequence[str]) -> Array:
    """Return posterior draws of changes of compliances with force, shape (draws, names).

    A change is the compliance at the largest force tested minus the compliance at the smallest.
    ``names`` are the names of the compliances.
    """
    bound = model.bound
    tested_N = bound.setting.force_N
    ends_N = np.array([tested_N.min(), tested_N.max()])
    beta = model.beta[:, model.places]
    curves = compliance_curves(bound, model.phi, beta, ends_N, np.random.default_rng(0))
    labels = [compliance.label for compliance in bound.compliances]
    places = [labels.index(name) for name in names]
    return np.asarray(curves[:, 1, places] - curves[:, 0, places])


def _sampled_sd(posterior: xr.DataTree, bound: BoundModel, variance: AveragedVariance) -> SampledSd:
    """Return the prior and the posterior standard deviations of all parameters.

    ``variance`` holds the variances of the posterior draws. For a parameter with a flat prior, the
    prior standard deviation is infinite.
    """
    prior_sd = np.full(len(bound.names), np.inf)
    for j, name in enumerate(bound.names):
        if np.isfinite(bound.prior_sd[j]):
            prior_sd[j] = float(posterior["prior"][name].std())
    return SampledSd(prior_sd, np.sqrt(variance.variance[: variance.number_of_parameters]))


def confounded_parameters(bound: BoundModel, phi: Array) -> dict[str, tuple[str, ...]]:
    """Return, for each confounded parameter, the effects with which it is confounded.

    A parameter is confounded if most of its variance comes from effects whose standard uncertainty
    is assumed. Parameters that are not confounded are left out. `judge_posterior` finds the same
    effects, but takes more time because it returns complete verdicts.

    Parameters
    ----------
    bound
        Model of a campaign.
    phi
        Values of the h hyper-parameters, such as the standard deviation of the noise, shape (h,);
        lengths in mm.
    """
    confounded = {}
    for name, (sources, likeness) in sources_of(bound, information_of(bound, phi)).items():
        partners = confounding_sources(sources, likeness)
        if partners:
            confounded[name] = tuple(_shares_by_name(partners))
    return confounded


def confounded_in(posterior: xr.DataTree) -> dict[str, tuple[str, ...]]:
    """Return, for each confounded parameter of a posterior, the effects confounded with it.

    A parameter is confounded if most of its variance comes from effects whose standard uncertainty
    is assumed. Parameters that are not confounded are left out. `judge_posterior` finds the same
    effects, but takes more time because it returns complete verdicts. The posterior may be an
    average over models.
    """
    names = bound_of(posterior).names
    variances = [_variance_of_model(model, {}) for model in averaged_models(posterior)]
    variance = AveragedVariance(tuple(variances), len(names))
    confounded = {}
    for i, name in enumerate(names):
        sources, likeness = variance.sources(i, (name,))
        partners = confounding_sources(sources, likeness)
        if partners:
            confounded[name] = tuple(_shares_by_name(partners))
    return confounded


def hyper_parameter_nodes(bound: BoundModel) -> tuple[Array, Array]:
    """Return w weighted sets of values of the hyper-parameters φ.

    The first result holds the weights of the sets, shape (w,). The second result holds the sets,
    shape (w, h), with one value for each of the h hyper-parameters. The sets are quadrature nodes:
    together with their weights, they represent p(φ | y), for the readings y and a model in which
    compliances may be negative. Hyper-parameters that are lengths are in mm; the others have no
    unit. For a plan, the only set consists of the prior medians.
    """
    if bound.campaign.is_plan:
        median = np.full((1, len(bound.hyper_prior.names)), 0.5)
        return np.ones(1), bound.hyper_prior.quantile(median)
    coarse = HyperPosterior(bound, truncated=False).coarse
    return coarse.weight, bound.hyper_prior.phi(coarse.free)


def variance_share_removed(information: Information, names: Sequence[str]) -> Array:
    """Return the share of each parameter's variance that would vanish if some effects were known.

    The variances are posterior variances. ``names`` are the names of the effects: class names of
    model terms, or names of single coefficients. The result has the shape (p,) for p parameters.
    """
    return np.clip(1.0 - information.variances(names) / information.variances(), 0.0, 1.0)


def not_modelled(bound: BoundModel) -> tuple[str, ...]:
    """Return the class names of those terms of the ready-made model that the user has left out.

    ``bound`` was made from a ready-made model such as ``HybridModel.first``. The result is empty
    for the ready-made model ``paper``, which has no terms.
    """
    if bound.model.preset == "paper":
        return ()
    modelled = {type(term) for term in bound.model.nuisances}
    return tuple(kind.__name__ for kind in ready_made_terms(bound) if kind not in modelled)


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
    bound: BoundModel,
    information: Information,
    mean: Array,
    sampled_sd: SampledSd | None = None,
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
    return _judge_average(AveragedVariance((model,), len(mean)), bound, sampled_sd)


def _judge_average(
    variance: AveragedVariance, bound: BoundModel, sampled_sd: SampledSd
) -> dict[str, ParameterIdentifiability]:
    """Return how well the readings determine each parameter; the keys are names of parameters.

    The results are averaged over the models in ``variance``, which holds the variances of the
    parameters under each of one or more models. ``bound`` is a model that has all the parameters.
    ``sampled_sd`` holds the prior and posterior standard deviations that are reported for the
    parameters.
    """
    entries = {}
    for i, parameter in enumerate(bound.parameters):
        name = parameter.name
        variance_ratio = float(sampled_sd.posterior[i] / sampled_sd.prior[i]) ** 2
        contraction = 1.0 - variance_ratio
        sources = variance.sources(i, (name,))
        judgement = judge(sources.sources, contraction, sources.likeness)
        partner_shares = _shares_by_name(judgement.partners)
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


def _judge_changes(
    variance: AveragedVariance, changes: Mapping[str, CurveChange], prior_sd: Array
) -> dict[str, ChangeIdentifiability]:
    """Return how well the change of each compliance with force is known.

    The keys of ``changes`` and of the result are names of compliances. ``variance`` holds, under
    each model, the variances of all parameters and, after them, the variances of the changes.
    ``prior_sd`` holds the prior standard deviation of each change.
    """
    entries = {}
    for k, (name, change) in enumerate(changes.items()):
        i = variance.number_of_parameters + k
        sd = float(np.sqrt(variance.variance[i]))
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
            partner_shares=_shares_by_name(judgement.partners),
            remedy=None,
            prior_sd=float(prior_sd[k]),
            sd=sd,
            origin_shares=_shares_by_origin(sources.sources),
        )
    return entries


def _remedies_of(
    tried: TriedRemedies,
    parameters: Mapping[str, ParameterIdentifiability],
    changes: Mapping[str, ChangeIdentifiability],
) -> dict[str, Remedy | None]:
    """Return the cheapest remedy for every parameter and every change of a compliance with force.

    A remedy for a large uncertainty is a certificate or a change of the plan. The keys of the
    result are the names of the parameters, and names such as "change of C_XXX" for the changes.
    ``tried`` computes the uncertainties after each remedy. ``parameters`` and ``changes`` hold the
    verdicts and the uncertainties without any remedy.
    """
    entries: list[ParameterIdentifiability | ChangeIdentifiability] = []
    entries += parameters.values()
    entries += changes.values()
    sd = np.array([entry.sd for entry in entries])
    measured_share = np.array([entry.origin_shares.get(Origin.MEASURED, 0.0) for entry in entries])
    return remedies(tried, sd, measured_share)


def _shares_by_name(sources: Sequence[VarianceSource]) -> dict[str, float]:
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


def _alias_matrix(bound: BoundModel, information: Information) -> pd.DataFrame:
    """Return the table of errors that nuisances cause in least-squares estimates of parameters.

    Nuisances are effects not of interest, which the least-squares fit ignores. The table has one
    row for each parameter and one column for each nuisance coefficient. Each entry is the error of
    the parameter's estimate if the nuisance coefficient is equal to its prior standard deviation.
    The internal units of the errors are composed of mm, N and rad.
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
    """Return the table of posterior correlations between coefficients.

    The coefficients are the parameters, and the nuisance coefficients that act in several tests.
    Rows and columns are named after the coefficients.
    """
    covariance = information.covariance()
    names = list(information.names)
    sd = np.sqrt(np.diag(covariance))
    return pd.DataFrame(covariance / np.outer(sd, sd), names, names)
