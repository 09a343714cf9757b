"""Comparison of models of one campaign by their evidences, which are computed by quadrature.

The comparison is repeated with models that have other priors or make other assumptions. In
addition, the readings of every test are predicted from the other tests. All models use the same
readings, and have the same priors for the parameters that they share. In this module, β are the
parameters (compliances, their changes with force, and geometric errors); φ are the
hyper-parameters, such as the standard deviation of the noise.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
import pandas as pd

from ldbb_bayes.analysis import neighbouring_forces, rival_explanations, sensitivity, varying_slopes
from ldbb_bayes.analysis.comparison import (
    DEFAULT_TOLERANCE,
    ComparedCampaign,
    ComparedModel,
    ComparedTest,
    Comparison,
    Difference,
    ParameterEstimate,
    ScaledSlopes,
)
from ldbb_bayes.analysis.comparison_plan import ComparisonPlan, count_steps, plan_comparison
from ldbb_bayes.analysis.outlying_tests import judge_tests
from ldbb_bayes.analysis.sensitivity import Assumed
from ldbb_bayes.analysis.varying_slopes import AveragedSlopes
from ldbb_bayes.campaign.campaign import Campaign, require_campaign
from ldbb_bayes.deprecation import renamed_keyword
from ldbb_bayes.errors import check_probability, require
from ldbb_bayes.inference.evidence import (
    check_comparable,
    log_bayes_factor,
    probabilities,
    require_models,
)
from ldbb_bayes.inference.evidence_value import Evidence
from ldbb_bayes.inference.evidences import (
    Evidences,
    leave_one_out,
    left_out_log_densities,
    report_nothing,
)
from ldbb_bayes.inference.least_squares import fit_least_squares
from ldbb_bayes.inference.nodes import Nodes
from ldbb_bayes.inference.residuals import QUALITY_DRAWS, fit_quality
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.parallel import one_blas_thread, start_early
from ldbb_bayes.results import Array

__all__ = ["begin_comparison", "compare", "interpolate_crossings"]

R = TypeVar("R")
# Smallest difference of log evidence [nat] at which an assumption about the random differences
# between circles counts as clearly rejected. Two models are compared under their own assumption,
# and then under other assumptions. Let M be the larger of the log evidences of the two models under
# their own assumption. Another assumption is clearly rejected if, under it, the log evidences of
# both models are at least this number below M. To save time, the log evidences under a clearly
# rejected assumption are computed only roughly.
_FAR_REJECTED = 10.0
# Settings of the quadrature for the posterior mean and standard deviation of parameters. Its nodes
# are weighted values of the hyper-parameters. The nodes with the smallest weights are left out.
# Together, their weights are at most the fraction ``_NEGLIGIBLE_WEIGHT`` of the sum of all weights.
# ``_MOMENT_POINTS`` is the number of quasi-random points from which means and variances are
# computed if no compliance may be negative. ``_MOMENT_NODES`` is the largest number of nodes. If
# there are more nodes, ``_MOMENT_NODES`` of them are picked in proportion to their weights. This
# causes an error of about 1 % of the posterior standard deviation.
_NEGLIGIBLE_WEIGHT = 1e-4
_MOMENT_POINTS = 256
_MOMENT_NODES = 512
# Smallest and largest tolerance of a log evidence that a caller may ask for [nat]. A comparison
# computes hundreds of evidences, and would take too long with a tolerance below
# ``_FINEST_TOLERANCE``.
_FINEST_TOLERANCE = 1e-4
_COARSEST_TOLERANCE = 1.0


@one_blas_thread
@renamed_keyword("ci_prob", "prob")
def compare(
    models: Mapping[str, HybridModel],
    campaign: Campaign,
    *,
    evidence_only: bool = False,
    tolerance: float = DEFAULT_TOLERANCE,
    prob: float = 0.95,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
    evidences: Evidences | None = None,
    executor: Executor | None = None,
) -> Comparison:
    """Compare models of one campaign by evidence and by how well they predict tests left out.

    The evidence of a model is the density of the readings under this model. The ratio of the
    evidences of two models, the Bayes factor B, is recomputed under other priors of the slopes
    (changes of compliance with force) and under other assumptions about the random differences
    between circles.

    Parameters
    ----------
    models : mapping of str to HybridModel
        At least two models by name. For the first two models, ln B of the second over the first is
        also computed under other priors and assumptions.
    campaign : Campaign
        Campaign with readings.
    evidence_only : bool
        Whether to compute only the evidences and their dependence on assumptions. This takes a
        third of the time of a full comparison. Three results are then missing: predictions of tests
        left out, models with only some of the slopes, and fits to the tests at neighbouring forces.
    tolerance : float
        Largest error allowed for a log evidence [nat], from 0.0001 to 1.
    prob : float
        Probability of the credible intervals, between 0 and 1. There are such intervals for the
        compliance C(F) at every force F, and for the fits to the tests at neighbouring forces.
    seed : int
        Seed of the random draws for simulated readings and credible intervals.
    progress : callable, optional
        Function called with the number of steps done and the total number of steps.
    evidences : Evidences, optional
        Evidences of this campaign that are already known. New evidences are added to the object,
        which can then be passed to `average`. If evidences are given, their tolerance replaces
        ``tolerance``.
    executor : Executor, optional
        Executor of ``concurrent.futures`` that computes three parts in parallel: local fits,
        evidences under other assumptions, and models with only some of the slopes. Default: this
        process computes them. The result does not depend on the executor.

    Returns
    -------
    Comparison
        Evidences, Bayes factors and estimates, in nats and internal units (mm, N, rad).

    Raises
    ------
    InputError
        For fewer than two models, two models that are the same, an improper prior, a plan (a
        campaign without readings), a tolerance or probability out of range, or evidences of another
        campaign.

    Examples
    --------
    >>> models = {"constant": lb.HybridModel.first(0), "linear": lb.HybridModel.first(1)}
    >>> comparison = lb.compare(models, campaign, evidence_only=True, tolerance=0.1)
    >>> log_bayes_factor, error = comparison.headline  # of "linear" over "constant"
    >>> round(log_bayes_factor)
    -6
    """
    require_campaign(campaign)
    if evidences is None:
        evidences = Evidences(campaign, tolerance=tolerance)
    evidences.check_campaign(campaign)
    finish = begin_comparison(
        models,
        evidences,
        evidence_only=evidence_only,
        prob=prob,
        seed=seed,
        progress=progress,
        executor=executor,
    )
    return finish()


@one_blas_thread
def begin_comparison(
    models: Mapping[str, HybridModel],
    evidences: Evidences,
    *,
    prob: float,
    seed: int,
    progress: Callable[[int, int], None] | None,
    executor: Executor | None,
    evidence_only: bool = False,
) -> Callable[[], Comparison]:
    """Begin a comparison of models, and return a function that finishes and returns it.

    The evidences of the models are computed at once. ``executor`` computes other parts of the
    comparison before the returned function needs them; parts that it has not begun by then are
    computed in this process. ``evidences`` are those of the campaign that are known already.
    `compare` explains the other arguments and the errors.
    """
    check_probability(prob)
    campaign = evidences.campaign
    _check_models(models, campaign, evidences)
    plan = plan_comparison(models, campaign, evidence_only=evidence_only)
    local_fits = _begin_local_fits(plan, campaign, prob, executor)
    if progress is not None:
        total = count_steps(plan, len(models), campaign)
        evidences.progress = _StepCounter(progress, total)
    nodes_by_model = dict(zip(models, evidences.nodes(*models.values()), strict=True))
    begun = _BegunComparison(
        plan,
        evidences,
        nodes_by_model,
        prob,
        seed,
        local_fits,
        _begin_assumptions(plan, nodes_by_model, evidences, executor),
        _begin_slope_subsets(plan, evidences, executor, seed, prob),
    )
    return begun.finish


class _StepCounter:
    """Counter of the steps of a comparison.

    The counter is called after every step. At every call, it calls ``progress`` with the number of
    steps done and the total number of steps.
    """

    def __init__(self, progress: Callable[[int, int], None], total: int) -> None:
        """Start to count the steps of a comparison at zero.

        ``progress`` is called after every step with the number of steps done and ``total``, the
        number of all steps.
        """
        self.progress = progress
        self.total = total
        self.done = 0

    def __call__(self) -> None:
        """Add 1 to the number of steps that are done, and report the new number."""
        self.done += 1
        self.progress(self.done, self.total)


@dataclass(frozen=True, eq=False)
class _BegunComparison:
    """Comparison of models of which some parts may be computed in another process.

    Fields that are functions wait for a part of the comparison, and return it.
    """

    plan: ComparisonPlan
    #: evidences of the campaign, to which those that the comparison needs are added
    evidences: Evidences
    #: nodes (weighted values of the hyper-parameters) of each model; the keys are their names
    nodes_by_model: Mapping[str, Nodes]
    prob: float  #: probability of the credible intervals
    seed: int  #: seed of the random draws
    #: function that returns the table of the fits to the tests at neighbouring forces
    local_fits: Callable[[], pd.DataFrame]
    #: function that returns the log Bayes factors under other assumptions, and the evidences that
    #: were computed for them
    by_assumption: Callable[[], tuple[tuple[Assumed, ...], list[Evidence]]]
    #: function that returns the average over models in which only some compliances change with
    #: force, and the evidences that were computed for it
    slope_subsets: Callable[[], tuple[AveragedSlopes, list[Evidence]]]

    @one_blas_thread
    def finish(self) -> Comparison:
        """Compute what is missing, wait for all parts, and return the comparison."""
        plan = self.plan
        evidences = self.evidences
        first, second = plan.pair
        left_out_nodes: dict[str, dict[str, Nodes]] = {}
        if plan.leaves_tests_out:
            left_out_nodes = leave_one_out(
                self.nodes_by_model, tolerance=evidences.tolerance, progress=evidences.progress
            )
        scaled = sensitivity.compare_under(plan.pair, plan.by_slope_scale, evidences.nodes)
        unchanged = sensitivity.compare_under(plan.pair, plan.unchanged, evidences.nodes)
        explanations = None
        if plan.has_rival_explanations:
            explanations = rival_explanations.compare_explanations(plan.pair, evidences)
            unchanged += (explanations.averaged, explanations.alone)
        averaged_slopes, subset_evidences = self.slope_subsets()
        log_densities = left_out_log_densities(self.nodes_by_model, left_out_nodes)
        compared_models = _compare_models(self.nodes_by_model, log_densities, self.seed, self.prob)
        compared_tests = _compare_tests(
            self.nodes_by_model, left_out_nodes, log_densities, self.seed, evidences.tolerance
        )
        assumptions, assumption_evidences = self.by_assumption()
        evidences.progress = report_nothing
        all_evidences = [
            *evidences.computed,
            *subset_evidences,
            *assumption_evidences,
            *_evidences_of(left_out_nodes),
        ]
        factors = _log_bayes_factors(self.nodes_by_model)
        campaign = evidences.campaign
        return Comparison(
            campaign=ComparedCampaign(campaign.name, campaign.sha256),
            models=compared_models,
            log_bayes_factor={ratio: value for ratio, (value, _) in factors.items()},
            log_bayes_factor_error={ratio: error for ratio, (_, error) in factors.items()},
            elpd_difference=_elpd_differences(log_densities),
            sensitivity_of=f"{second}/{first}",
            prior_sensitivity=_scaled_slopes(plan.slope_scales, scaled),
            prior_sensitivity_crossings=_crossings(plan.slope_scales, scaled),
            discrepancy_sensitivity=unchanged + assumptions,
            slopes=averaged_slopes.slopes,
            slope_subsets=averaged_slopes.subsets,
            compliance_against_force=averaged_slopes.curves,
            tests=compared_tests,
            local_fits=self.local_fits(),
            tolerance=evidences.tolerance,
            largest_error=max(evidence.error for evidence in all_evidences),
            by_emcee=sum(not evidence.trusted for evidence in all_evidences),
            explanations=explanations,
            slopes_of_estimate=plan.pair[second].prior.slopes_of_estimate,
        )


def _check_models(
    models: Mapping[str, HybridModel], campaign: Campaign, evidences: Evidences
) -> None:
    """Raise an `InputError` if the models cannot be compared by evidence for this campaign.

    There must be at least two models. No two of them may be equal, each must have a proper prior,
    and the campaign must have readings that are not all zero. The tolerance of ``evidences`` must
    be between 0.0001 and 1 nat.
    """
    require_models(models)
    require_campaign(campaign)
    require(
        len(models) > 1,
        f"models must be at least two, got {len(models)}. Give for example constant and linear"
        " compliance.",
    )
    require(
        _FINEST_TOLERANCE <= evidences.tolerance <= _COARSEST_TOLERANCE,
        f"tolerance must lie between {_FINEST_TOLERANCE:g} and {_COARSEST_TOLERANCE:g} nats, got"
        f" {evidences.tolerance}: evidences are hundreds. For one model log_evidence goes further.",
    )
    for first, second in itertools.combinations(models, 2):
        require(
            models[first] != models[second],
            f"models must differ, got {first!r} and {second!r} alike. Leave one out, or change its"
            " degree or terms.",
        )
    for model in models.values():
        check_comparable(model, campaign)


def _begin_local_fits(
    plan: ComparisonPlan, campaign: Campaign, prob: float, executor: Executor | None
) -> Callable[[], pd.DataFrame]:
    """Begin the fits of constant compliance to the tests at each pair of neighbouring forces.

    Return a function that waits for the fits and returns their table. The table is empty if
    ``plan`` does not include these fits. ``prob`` is the probability of the credible intervals.
    ``executor`` runs the fits in parallel; if it is None, this process runs them.
    """
    if not plan.has_local_fits:
        return pd.DataFrame
    fit = partial(neighbouring_forces.local_fits, plan.largest, campaign, prob=prob)
    return start_early(fit, executor)


def _begin_assumptions(
    plan: ComparisonPlan,
    nodes_by_model: Mapping[str, Nodes],
    evidences: Evidences,
    executor: Executor | None,
) -> Callable[[], tuple[tuple[Assumed, ...], list[Evidence]]]:
    """Start to compute the evidences of the first two models under other assumptions.

    The assumptions are about the random differences between circles; ``plan`` lists them. Return a
    function that waits for the log Bayes factors and evidences, and returns them.
    ``nodes_by_model`` holds the evidences of the models under their own assumption. ``executor``
    runs the computation in parallel; if it is None, this process runs it.
    """
    best = max(nodes_by_model[name].evidence.log_value for name in plan.pair)
    separate = evidences.empty_copy()
    if executor is None:
        separate.progress = evidences.progress
    weigh = partial(
        _weigh_assumptions, tuple(plan.pair), plan.by_assumption, separate, best - _FAR_REJECTED
    )
    steps = 2 * len(plan.by_assumption)
    return _counted(start_early(weigh, executor), executor, evidences, steps)


def _counted(
    wait: Callable[[], R], executor: Executor | None, evidences: Evidences, steps: int
) -> Callable[[], R]:
    """Return a function that waits for a part of a comparison, and counts its steps as done.

    ``wait`` waits for the part, whose ``steps`` are evidences. If there is no executor, ``wait``
    itself counts them while they are computed, and is returned unchanged. ``evidences`` holds the
    function that counts.
    """
    if executor is None:
        return wait

    def wait_and_count() -> R:
        """Return the part of the comparison, after its steps have been counted."""
        part = wait()
        for _ in range(steps):
            evidences.progress()
        return part

    return wait_and_count


def _begin_slope_subsets(
    plan: ComparisonPlan, evidences: Evidences, executor: Executor | None, seed: int, prob: float
) -> Callable[[], tuple[AveragedSlopes, list[Evidence]]]:
    """Start to compute the evidences of models in which only some compliances change with force.

    Return a function that waits for the average over these models and for the new evidences, and
    returns them. The average is empty if ``plan`` does not include it. ``evidences`` are those
    known so far. ``executor`` runs the computation in parallel; if it is None, this process runs
    it. ``seed`` is the seed of the random draws, and ``prob`` the probability of the credible
    intervals.
    """
    if not plan.has_slope_subsets:
        return _no_slope_subsets
    separate = evidences.copy()
    if executor is None:
        separate.progress = evidences.progress
    weigh = partial(_weigh_slope_subsets, plan.linear, separate, seed=seed, prob=prob)
    steps = varying_slopes.count_subsets(plan.linear, evidences.campaign)
    return _counted(start_early(weigh, executor), executor, evidences, steps)


def _no_slope_subsets() -> tuple[AveragedSlopes, list[Evidence]]:
    """Return an empty average over models with different slopes, and no evidences."""
    return AveragedSlopes({}, (), {}), []


def _weigh_slope_subsets(
    linear: HybridModel, evidences: Evidences, *, seed: int, prob: float
) -> tuple[AveragedSlopes, list[Evidence]]:
    """Return the average over models with different slopes, and the evidences computed for it.

    ``linear`` is the model in which every compliance changes with force. ``evidences`` are those
    known before; they are not in the second result. `_begin_slope_subsets` explains the other
    arguments.
    """
    known = len(evidences.computed)
    averaged = varying_slopes.slope_subsets(linear, evidences, seed=seed, prob=prob)
    return averaged, evidences.computed[known:]


def _weigh_assumptions(
    names: Sequence[str],
    assumptions: Mapping[str, Sequence[HybridModel]],
    evidences: Evidences,
    rejected_below: float,
) -> tuple[tuple[Assumed, ...], list[Evidence]]:
    """Return the log Bayes factor of two models under each assumption, and the precise evidences.

    ``names`` are the names of the two models. The assumptions are about the random differences
    between circles; ``assumptions`` holds both models under each of them. For each assumption,
    rough evidences are computed first. If both rough log evidences are below ``rejected_below``
    [nat], the log Bayes factor is computed from them. Otherwise, precise evidences are computed and
    used. The second result holds all precise evidences, but no rough ones.
    """
    weigh = partial(evidences.nodes_unless_rejected, rejected_below)
    return sensitivity.compare_under(names, assumptions, weigh), evidences.computed


def _evidences_of(left_out_nodes: Mapping[str, Mapping[str, Nodes]]) -> list[Evidence]:
    """Return a list of evidences: one for each model and each test that is left out.

    ``left_out_nodes`` holds, for each model and each test left out, the posterior given the other
    tests. The outer keys are names of models, and the inner keys are names of tests.
    """
    evidences: list[Evidence] = []
    for nodes_by_test in left_out_nodes.values():
        evidences.extend(nodes.evidence for nodes in nodes_by_test.values())
    return evidences


def _log_bayes_factors(nodes_by_model: Mapping[str, Nodes]) -> dict[str, tuple[float, float]]:
    """Return the log Bayes factor of every later model over the first model, and its error [nat].

    The error is the numerical error of the log Bayes factor. ``nodes_by_model`` holds the posterior
    of each model as nodes (weighted values of the hyper-parameters), with the model's evidence. The
    keys of the result have the form "linear/constant", where "constant" is the name of the first
    model.
    """
    first, *other_names = nodes_by_model
    factors = {}
    for name in other_names:
        factors[f"{name}/{first}"] = log_bayes_factor(
            nodes_by_model[name].evidence, nodes_by_model[first].evidence
        )
    return factors


def _scaled_slopes(scales: Sequence[float], assumed: Sequence[Assumed]) -> tuple[ScaledSlopes, ...]:
    """Return the log Bayes factor of two models for each of several widths of the slopes' prior.

    Slopes are changes of compliance with force. ``scales`` holds the widths of their prior, stated
    as ``slope_scale``. ``assumed`` holds the comparison of the two models for each width.
    """
    scaled = []
    for scale, result in zip(scales, assumed, strict=True):
        scaled.append(ScaledSlopes(scale, result.log_bayes_factor, result.log_bayes_factor_error))
    return tuple(scaled)


def _crossings(scales: Sequence[float], assumed: Sequence[Assumed]) -> tuple[float, ...]:
    """Return the widths of the slopes' prior at which the log Bayes factor changes sign.

    Slopes are changes of compliance with force. ``scales`` holds several widths of their prior,
    stated as ``slope_scale``. ``assumed`` holds the comparison of two models for each width.
    """
    log_bayes_factor = np.array([result.log_bayes_factor for result in assumed])
    return interpolate_crossings(np.array(scales), log_bayes_factor)


def interpolate_crossings(scale: Array, log_bayes_factor: Array) -> tuple[float, ...]:
    """Return the widths of the slopes' prior at which the log Bayes factor changes sign.

    Slopes are changes of compliance with force. ``scale``, shape (n,), holds n widths of their
    prior, and ``log_bayes_factor``, shape (n,), the log Bayes factor of two models for each width.
    Between these widths, the log Bayes factor is interpolated linearly in ln(scale).
    """
    x = np.log(scale)
    y = log_bayes_factor
    i = np.flatnonzero(np.sign(y[1:]) * np.sign(y[:-1]) < 0)
    crossings = x[i] + y[i] / (y[i] - y[i + 1]) * (x[i + 1] - x[i])
    return tuple(np.exp(crossings).tolist())


def _elpd_differences(log_densities: Mapping[str, Array]) -> dict[str, Difference]:
    """Return by how much each model exceeds the first in expected log predictive density [nat].

    ``log_densities`` holds, for each model, the log density of every test given the other tests
    [nat]. The result compares each model except the first with the first model. Its keys have the
    form "linear/constant", where "constant" is the name of the first model. The result is empty if
    the tests were not predicted from each other.
    """
    first, *other_names = log_densities
    differences = {}
    for name in other_names:
        if len(log_densities[name]):
            per_test = log_densities[name] - log_densities[first]
            differences[f"{name}/{first}"] = _sum_over_tests(per_test)
    return differences


def _sum_over_tests(values: Array) -> Difference:
    """Return the sum of log predictive densities over the tests, with its standard error [nat].

    ``values`` holds one log density, or one difference of two models' log densities, for each test.
    The standard error is computed from the scatter of the values. The sum is NaN if there are no
    values; the standard error is NaN for fewer than two values.
    """
    n = len(values)
    total = np.nan
    standard_error = np.nan
    if n > 0:
        total = float(values.sum())
    if n > 1:
        standard_error = float(np.sqrt(n * values.var(ddof=1)))
    return Difference(total, standard_error)


def _compare_models(
    nodes_by_model: Mapping[str, Nodes], log_densities: Mapping[str, Array], seed: int, prob: float
) -> dict[str, ComparedModel]:
    """Return the evidence, the fit and the parameter estimates of every model.

    The keys of the result are the names of the models. ``nodes_by_model`` holds the posterior of
    each model. ``log_densities`` holds, for each model, the log density of every test given the
    other tests [nat]. ``seed`` is the seed of posterior draws, and ``prob`` is the probability of
    the credible intervals of compliance at every force.
    """
    log_evidence = [nodes.evidence.log_value for nodes in nodes_by_model.values()]
    shares = probabilities(np.array(log_evidence))
    compared = {}
    for (name, nodes), probability in zip(nodes_by_model.items(), shares, strict=True):
        beta, phi = nodes.draw(QUALITY_DRAWS, np.random.default_rng(seed))
        elpd = _sum_over_tests(log_densities[name])
        compared[name] = ComparedModel(
            log_evidence=nodes.evidence.log_value,
            log_evidence_error=nodes.evidence.error,
            posterior_probability=float(probability),
            elpd_lofo=elpd.value,
            elpd_lofo_se=elpd.se,
            rmse_um=fit_quality(nodes.bound, phi, beta).rmse_um,
            least_squares_rmse_um=_least_squares_rmse_um(nodes.bound.model, nodes.bound.campaign),
            degree=nodes.bound.model.degree,
            parameters=_parameter_estimates(nodes),
            compliance_against_force=varying_slopes.averaged_curves(
                [nodes], np.ones(1), seed, prob
            ),
        )
    return compared


def _least_squares_rmse_um(model: HybridModel, campaign: Campaign) -> float:
    """Return the root-mean-square residual of the published least-squares fit [µm].

    The fit is Eq. 31 of the article on which the model is based. The compliances are polynomials in
    force, with the degree of the model. Return NaN if the campaign has too few different forces for
    a fit of this degree.
    """
    if campaign.force_levels < model.degree + 2:
        return np.nan
    fit = fit_least_squares(
        campaign, model.degree, reference_force_N=model.reference_force_N, fixed=model.fixed
    )
    return fit.quality.rmse_um


def _parameter_estimates(nodes: Nodes) -> dict[str, ParameterEstimate]:
    """Return the posterior mean and standard deviation of every parameter of a model, by name.

    ``nodes`` are quadrature nodes (weighted values of the hyper-parameters) of the posterior.
    """
    mean, sd = nodes.moments(
        spare=_NEGLIGIBLE_WEIGHT, points=_MOMENT_POINTS, components=_MOMENT_NODES
    )
    estimates = {}
    for j, parameter in enumerate(nodes.bound.parameters):
        estimates[parameter.name] = ParameterEstimate(parameter.unit, float(mean[j]), float(sd[j]))
    return estimates


def _compare_tests(
    nodes_by_model: Mapping[str, Nodes],
    left_out_nodes: Mapping[str, Mapping[str, Nodes]],
    left_out_log_densities: Mapping[str, Array],
    seed: int,
    tolerance: float,
) -> dict[str, ComparedTest]:
    """Return the comparison of every test with its prediction from the other tests, by name.

    The result is empty if no test is left out. ``nodes_by_model`` holds the posterior of each model
    given all tests; ``left_out_nodes`` holds, for each model and test, the posterior given the
    other tests. ``left_out_log_densities`` holds, for each model, the log density of every test
    given the other tests [nat]. ``seed`` is the seed of simulated readings, and ``tolerance`` is
    the largest error allowed for a log evidence [nat].
    """
    if not left_out_nodes:
        return {}
    judged_tests = judge_tests(nodes_by_model, left_out_nodes, seed=seed, tolerance=tolerance)
    forces = next(iter(nodes_by_model.values())).bound.setting.force_N
    compared = {}
    for r, (name, judged) in enumerate(judged_tests.items()):
        log_density = {}
        for model in nodes_by_model:
            log_density[model] = float(left_out_log_densities[model][r])
        compared[name] = ComparedTest(
            force_N=float(forces[r]),
            lofo_log_density=log_density,
            lofo_p_value=judged.p_value,
            lofo_family_wise_p_value=judged.family_wise_p_value,
            lofo_worst_order=judged.worst_order,
            lofo_p_value_by_order=dict(enumerate(judged.order_p_values)),
            flag=judged.flag,
        )
    return compared
