"""Identifiability of the parameters: from a campaign with readings, or from a plan.

Shares, origins and degeneracies (combinations of coefficients whose effects on the readings cancel)
are computed for the linear Gaussian model, in which compliances may be negative. They are computed
at one value of the hyper-parameters φ, such as the standard deviation of the noise. For a campaign
with readings, this value is the posterior mean of φ. For a plan, the value is the posterior mean
given the readings of the plan's pilot (the campaign from which the plan was designed) or, without a
pilot, the prior median; a plan can therefore be judged before it is run. Standard uncertainties, in
contrast, account for the spread of φ: the variance is the mean of the variances given φ plus the
variance of the means given φ. The uncertainties to expect with further certificates account for the
spread of φ, too. The standard uncertainties of a plan come from its forecast.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from ldbb_bayes.analysis.aliases import Degeneracy, degeneracies
from ldbb_bayes.analysis.cures import Cure, cures
from ldbb_bayes.analysis.curve_changes import CurveChange, curve_changes
from ldbb_bayes.analysis.design.averaged_forecast import averaged_uncertainties
from ldbb_bayes.analysis.design.bound_plans import bind_plan
from ldbb_bayes.analysis.design.forecast import forecast_plan
from ldbb_bayes.analysis.design.simulated_analyses import (
    SimulatedAnalyses,
    simulate_analyses,
    states_of,
)
from ldbb_bayes.analysis.design.slope_priors_of_pilot import with_slope_priors_of_pilot
from ldbb_bayes.analysis.design.states import extend_hyper_parameters
from ldbb_bayes.analysis.hyper_parameter_nodes import hyper_parameter_nodes
from ldbb_bayes.analysis.nested_models import averaged_sds
from ldbb_bayes.analysis.origins import Origin
from ldbb_bayes.analysis.paired_remedies import paired_remedies
from ldbb_bayes.analysis.remedies import Remedy, remedies
from ldbb_bayes.analysis.tried_remedies import TriedRemedies
from ldbb_bayes.analysis.value_of_certificates import (
    averaged_moments,
    missing_certificates,
    worth_of_certificates,
)
from ldbb_bayes.analysis.variance_sources import (
    AveragedVariance,
    ModelVariance,
    weights_of_parameters,
)
from ldbb_bayes.analysis.verdicts import (
    ChangeIdentifiability,
    ParameterIdentifiability,
    SampledSd,
    judge_average,
    judge_changes,
    not_modelled,
)
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.contradicted_certificates import (
    LEAST_RATIO_OF_STATED_BALLS,
    contradicted_certificates,
    log_ratio_of_stated_balls,
)
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.hybrid import BoundModel, HybridModel, require_model
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.linear_algebra import minimum_norm_solution
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, ByParameter, ByRow, EitherSpelling, Result

__all__ = ["Identifiability", "identify"]

# Limit below which the bias of a least-squares estimate counts as a rounding error and is set to
# zero. The bias is the error that a nuisance effect (modelled, but not of interest) causes. The
# limit is a fraction of the parameter's prior standard deviation or, with a flat prior, of a
# typical size of the parameter.
_ROUNDING = 1e-12
# Number of values of the hyper-parameters over which uncertainties are averaged that are averaged
# over constant and linear compliance too.
_AVERAGED_VALUES = 128
# Name of what a campaign states of the form of its balls, as in the names of certificates.
_STATED_FORM = "the stated form of the balls"


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
    parameters: ByParameter[ParameterIdentifiability]
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
    averaged_sd: ByParameter[float] = field(default_factory=dict)
    #: whether the hyper-parameters of a plan are those that the readings of its pilot leave likely;
    #: false for a plan without a measured pilot, and for a campaign with readings
    scales_from_pilot: bool = False
    #: names of certificates of balls that the readings (of a plan's pilot, too) contradict: the
    #: balls are less round. They are not among the ``certificates``. The form of the balls that a
    #: campaign with readings states is named "the stated form of the balls".
    contradicted_certificates: tuple[str, ...] = ()
    #: whether a fit of the model excludes negative compliances
    truncated: bool = True


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
    if campaign.is_plan:
        tests = _judged_plan(model, campaign)
    else:
        tests = _judged_campaign(model, campaign)
    bound = tests.bound
    mean_phi = tests.weight @ tests.phi
    information = information_of(bound, mean_phi)
    combinations = degeneracies(bound)
    effective_parameters = float(len(bound.names))
    certificates: dict[str, dict[str, float]] = {}
    if not information.flat:
        effective_parameters -= float(information.variances().sum())
        certificates = worth_of_certificates(
            bound, tests.weight, tests.phi, contradicted=tests.contradicted
        )
    if tests.expected is not None and certificates:
        certificates = _scaled_to_forecast(tests.expected, bound, certificates)
    changes = curve_changes(bound, information)
    variance = _averaged_over_scales(bound, information, changes, tests.weight, tests.phi)
    expected = tests.expected
    if expected is None:
        prior_sd = np.array([parameter.prior_sd for parameter in bound.parameters])
        posterior_sd = variance.models[0].sd[: variance.number_of_parameters]
        expected = SampledSd(prior_sd, posterior_sd)
    parameters = judge_average(variance, bound, expected)
    changes_judged = judge_changes(variance, changes, _prior_sd_of_changes(information, changes))
    tried = TriedRemedies(bound, mean_phi, tests.contradicted)
    remedy_by_name = _remedies_of(tried, parameters, changes_judged)
    remedy_by_name |= _with_averaged_certificates(remedy_by_name, certificates)
    sd_by_parameter = {name: entry.sd for name, entry in parameters.items()}
    confounded = [name for name, entry in parameters.items() if entry.partners]
    pairs = paired_remedies(tried, remedy_by_name, sd_by_parameter, confounded)
    with_remedies = {
        name: replace(entry, remedy=remedy_by_name[name], paired_remedy=pairs.get(name))
        for name, entry in parameters.items()
    }
    return Identifiability(
        parameters=EitherSpelling(with_remedies),
        changes={
            name: replace(entry, remedy=remedy_by_name[f"change of {name}"])
            for name, entry in changes_judged.items()
        },
        degeneracies=combinations,
        cures=cures(bound, combinations),
        not_modelled=not_modelled(bound),
        effective_parameters=effective_parameters,
        alias=_alias_matrix(bound, information),
        correlation=_correlation(information),
        certificates=certificates,
        hyper_um=bound.hyper_prior.display_values(mean_phi),
        measured=not campaign.is_plan,
        averaged_sd=EitherSpelling(tests.averaged_sd),
        scales_from_pilot=_has_measured_pilot(campaign),
        contradicted_certificates=tests.contradicted,
        truncated=model.prior.truncated,
    )


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

    The first are the prior standard deviations of an analysis of the plan's tests. The second are
    the posterior standard deviations to expect. Both are taken from the forecast that `design`
    makes. ``analyses`` are simulated analyses of the plan's tests.
    """
    expected = forecast_plan(bound.model, plan, analyses=analyses).expected
    sd = np.array([entry.sd for entry in expected.values()])
    return SampledSd(analyses.prior_sd, sd)


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
    contradicted: tuple[str, ...]  #: see ``Identifiability.contradicted_certificates``


def _judged_plan(model: HybridModel, plan: Campaign) -> _JudgedTests:
    """Return the tests of a plan, with the uncertainties to expect from them."""
    analysed_with = with_slope_priors_of_pilot(model, plan)
    bound = bind_plan(analysed_with, plan)
    weight, phi = _scales_before(bound, plan)
    if model.prior.flat:
        return _JudgedTests(bound, weight, phi, None, {}, ())
    analyses = simulate_analyses(analysed_with, plan)
    expected = _expected_sd(bound, plan, analyses)
    averaged = averaged_uncertainties(analyses)
    averaged_sd = {name: entry.sd for name, entry in averaged.items()}
    contradicted: tuple[str, ...] = ()
    if plan.pilot is not None and not plan.pilot.is_plan:
        pilot = model.bind(plan.pilot)
        missing = missing_certificates(plan.instrument)
        contradicted = contradicted_certificates(pilot, missing, *hyper_parameter_nodes(pilot))
    return _JudgedTests(bound, weight, phi, expected, averaged_sd, contradicted)


def _judged_campaign(model: HybridModel, campaign: Campaign) -> _JudgedTests:
    """Return the tests of a campaign with readings."""
    bound = model.bind(campaign)
    weight, phi = hyper_parameter_nodes(bound)
    contradicted: tuple[str, ...] = ()
    if not model.prior.flat:
        missing = missing_certificates(campaign.instrument)
        contradicted = contradicted_certificates(bound, missing, weight, phi)
    if log_ratio_of_stated_balls(bound, weight, phi) < LEAST_RATIO_OF_STATED_BALLS:
        contradicted = (_STATED_FORM, *contradicted)
    averaged_sd = _averaged_sd_now(bound, weight, phi)
    return _JudgedTests(bound, weight, phi, None, averaged_sd, contradicted)


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


def _has_measured_pilot(campaign: Campaign) -> bool:
    """Return whether a campaign is a plan that was designed from a campaign with readings."""
    return campaign.is_plan and campaign.pilot is not None and not campaign.pilot.is_plan


def _with_averaged_certificates(
    remedy_by_name: Mapping[str, Remedy | None], certificates: Mapping[str, Mapping[str, float]]
) -> dict[str, Remedy | None]:
    """Return the remedies that are certificates, with uncertainties averaged over the scales.

    A remedy is found at one value of the hyper-parameters (scales of noise and effects). The
    uncertainties with further certificates, ``certificates``, are averaged over the
    hyper-parameters instead; both are stated, and must agree. The keys of ``remedy_by_name`` and of
    the result are names of parameters; those of ``certificates`` are names of certificates, the
    first of which stands for no further certificate.
    """
    averaged: dict[str, Remedy | None] = {}
    without = next(iter(certificates.values()), {})
    for name, remedy in remedy_by_name.items():
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
    blocks = [test.factor @ bound.interest_columns[r] for r, test in enumerate(bound.reduced)]
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
