"""Checks of a Bayesian workflow for one model and one campaign.

The checks are those of Gelman et al., Bayesian Workflow (2020), as far as they apply here:

1. Prior prediction: is the prior wide enough for the circles measured?
2. Sampling: do the chains agree, and are there enough effective draws?
3. Sensitivity: does the posterior depend on the prior (power-scaling)?
4. Leave one circle out: does every circle agree with its prediction from the other circles?
5. Calibration for machines like this one (posterior SBC): is the posterior computed correctly?
6. Stacking: which mixture of two models, one with constant compliance and one with compliance that
   changes with force, is best at predicting circles that were left out?
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import xarray as xr

from ldbb_bayes.analysis.calibration import Validation
from ldbb_bayes.analysis.multiple_testing import holm, uniformity_p_value
from ldbb_bayes.analysis.outlying_tests import FALSE_ALARMS, judge_tests
from ldbb_bayes.analysis.posterior_calibration import calibrate_posterior
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import require
from ldbb_bayes.inference.evidence import check_comparable
from ldbb_bayes.inference.evidences import Evidences, leave_one_out, left_out_log_densities
from ldbb_bayes.inference.nodes import Nodes
from ldbb_bayes.inference.posterior import bound_of, fit_of, record_of
from ldbb_bayes.inference.prior_prediction import prior_circles
from ldbb_bayes.inference.sample import sample
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.parameter_kinds import DEGREE_NAMES
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, Result

__all__ = ["LeftOutCircle", "PriorRange", "Workflow", "check_workflow"]

# Number of circles simulated from the prior. The ranges (largest minus smallest reading) of these
# circles are compared with the measured ranges.
_PRIOR_CIRCLES = 2000
# Probability of the prior predictive interval with which the measured range of a circle (largest
# minus smallest reading) is compared.
_PRIOR_PROB = 0.95
# Numerical error allowed in the log evidence of every model [nat].
_TOLERANCE = 1e-2
# Limit for `Workflow.uniformity_p_value`, the p-value of a test of all circles together. Each
# circle is predicted from the other circles, and the test examines whether the deviations from
# these predictions are as large as expected. If the p-value is below the limit, a report says that
# the circles do not scatter as predicted.
_UNIFORM = 0.05
# Number of steps of the EM algorithm that computes the stacking weights. These are the weights of
# the mixture of models that best predicts circles that were left out.
_STACKING_STEPS = 500


@dataclass(frozen=True)
class PriorRange:
    """Measured range of one circle, and the prior predictive interval of this range.

    The range of a circle is its largest minus its smallest reading.
    """

    measured_um: float
    low_um: float  #: lower end of the prior predictive interval [µm]
    high_um: float  #: upper end of the prior predictive interval [µm]
    #: prior predictive probability that the range of the circle is at least as large as the
    #: measured range, not adjusted for the number of circles. If the value is small, such a large
    #: range is improbable under the prior.
    p_value: float


@dataclass(frozen=True)
class LeftOutCircle:
    """Comparison of one circle with the prediction from the other circles."""

    #: probability that a new circle on the same machine would deviate from the prediction at least
    #: as much as this circle does; the prediction is made from the other circles
    p_value: float
    #: p-value of the circle's deviation from the prediction, adjusted for the number of circles
    #: (Holm)
    family_wise_p_value: float
    worst_order: int  #: Fourier order in which the circle deviates most from the prediction


@dataclass(frozen=True, eq=False)
class Workflow(Result):
    """Results of the checks of a Bayesian workflow for one model and campaign.

    Examples
    --------
    >>> workflow = lb.analysis.check_workflow(lb.HybridModel.first(1), campaign, replicates=10)
    >>> workflow.surprising_circles, workflow.outlying_circles, workflow.calibration.calibrated
    ((), (), True)
    """

    campaign: str  #: name of the campaign to which the checks of the Bayesian workflow apply
    #: measured range (largest minus smallest reading) of every circle, and its prior predictive
    #: interval; the keys are names of tests
    prior_ranges: dict[str, PriorRange]
    #: probability with which, under the prior, the range of a circle lies within its prior
    #: predictive interval in ``prior_ranges``
    prior_prob: float
    rhat_max: float  #: largest R-hat of all parameters and hyper-parameters of the model
    #: effective sample size for the mean (bulk ESS), the smallest of all parameters and
    #: hyper-parameters of the model
    ess_bulk_min: float
    #: effective sample size for the 5 % and the 95 % quantile (tail ESS), the smallest of all
    #: parameters and hyper-parameters of the model
    ess_tail_min: float
    converged: bool  #: whether the sampler reached its targets for R-hat and effective sample size
    #: parameters that are sensitive to the prior, the most sensitive first. The keys are the names
    #: of the parameters, and the values are their sensitivities (by power-scaling), which are above
    #: 0.05.
    prior_sensitivity: dict[str, float]
    #: comparison of every circle with the prediction from the other circles; the keys are names of
    #: tests
    left_out: dict[str, LeftOutCircle]
    #: result of `calibrate_posterior`: ranks of true values among posterior draws, for simulated
    #: campaigns whose true values are drawn from the posterior of this campaign
    calibration: Validation
    #: weights of the mixture of models that is best at predicting circles that were left out; the
    #: keys are names of models
    stacking_weights: dict[str, float]
    #: expected log predictive density of each model [nat]: the sum, over all tests, of the log
    #: density of a test's readings given the other tests; the keys are names of models
    elpd: dict[str, float]

    @property
    def surprising_circles(self) -> tuple[str, ...]:
        """Names of the circles whose range of readings is much larger than the prior predicts.

        The range is the largest minus the smallest reading. For a circle named here, the p-value of
        the range, adjusted for the number of circles (Holm), is below 2 %.
        """
        names = list(self.prior_ranges)
        p_values = np.array([entry.p_value for entry in self.prior_ranges.values()])
        adjusted = holm(p_values)
        return tuple(name for name, p in zip(names, adjusted, strict=True) if p < FALSE_ALARMS)

    @property
    def quiet_circles(self) -> tuple[str, ...]:
        """Names of the circles whose range of readings is smaller than the prior predicts.

        The range is the largest minus the smallest reading. For a circle named here, the range is
        below its prior predictive interval. The prior is then wider than necessary for this
        machine. This is not a fault, because the prior is meant for all machines.
        """
        names = []
        for name, expected in self.prior_ranges.items():
            if expected.measured_um < expected.low_um:
                names.append(name)
        return tuple(names)

    @property
    def outlying_circles(self) -> tuple[str, ...]:
        """Names of circles that do not agree with the other circles (family-wise p-value < 2 %)."""
        names = []
        for name, circle in self.left_out.items():
            if circle.family_wise_p_value < FALSE_ALARMS:
                names.append(name)
        return tuple(names)

    @property
    def uniformity_p_value(self) -> float:
        """p-value of the hypothesis that the circles scatter as predicted.

        Each circle is compared with its prediction from the other circles, which gives a p-value.
        If the hypothesis is true, these p-values are uniformly distributed. The test takes into
        account that they depend on one another. If the result is small although no single circle is
        outlying, many circles deviate either slightly more or slightly less than predicted.
        """
        p_values = np.array([circle.p_value for circle in self.left_out.values()])
        return float(uniformity_p_value(p_values))

    @property
    def scatter_as_predicted(self) -> bool:
        """Whether the circles scatter as predicted: `uniformity_p_value` is at least 5 %.

        This property is for information only; ``passed`` does not depend on it.
        """
        return self.uniformity_p_value >= _UNIFORM

    @property
    def passed(self) -> bool:
        """Whether the sampler has converged, no circle stands out, and the calibration succeeds.

        A circle stands out if it is named in ``surprising_circles`` or ``outlying_circles``. If a
        parameter is sensitive to its prior, this is not an error and does not count here.
        """
        nothing_odd = not self.surprising_circles and not self.outlying_circles
        return nothing_odd and self.converged and self.calibration.calibrated


@one_blas_thread
def check_workflow(
    model: HybridModel,
    campaign: Campaign,
    *,
    replicates: int = 50,
    draws: int = 99,
    seed: int = 1,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Workflow:
    """Return the results of the checks of a Bayesian workflow for one model and campaign.

    The checks are prior prediction, convergence of the sampler, sensitivity to the prior,
    prediction of each circle from the other circles, calibration for machines like this one, and
    stacking. Stacking combines two models: one with constant compliance, and one with compliance
    that changes with force.

    Parameters
    ----------
    model : HybridModel
        Model with proper priors.
    campaign : Campaign
        Campaign with readings of at least two tests.
    replicates : int
        Number of simulated campaigns of the calibration, at least 10.
    draws : int
        Number of posterior draws of each simulated campaign, at least 9.
    seed : int
        Seed of all random numbers.
    executor : Executor, optional
        Executor of ``concurrent.futures`` that runs the calibration in parallel. Default: this
        process runs it. The result does not depend on the executor.
    progress : callable, optional
        Function called with the number of replicates of the calibration that are done, and the
        number of all replicates.

    Returns
    -------
    Workflow
        Results of every check.

    Raises
    ------
    InputError
        For a plan (a campaign without readings), fewer than two tests, a flat prior, or too few
        replicates.

    Examples
    --------
    >>> workflow = lb.analysis.check_workflow(lb.HybridModel.first(0), campaign, replicates=10)
    >>> workflow.passed
    True
    """
    check_comparable(model, campaign)
    require(
        len(campaign.tests) > 1,
        "a campaign must have at least two tests to leave one out, got one. Add tests.",
    )
    posterior = sample(model, campaign, sampler="independent", seed=seed)
    sampler = record_of(posterior)["sampler"]
    evidences = Evidences(campaign, tolerance=_TOLERANCE)
    models = _models_to_stack(model)
    nodes_by_model = dict(zip(models, evidences.nodes(*models.values()), strict=True))
    left_out_nodes = leave_one_out(nodes_by_model, tolerance=_TOLERANCE)
    log_densities = left_out_log_densities(nodes_by_model, left_out_nodes)
    fit = fit_of(posterior)
    return Workflow(
        campaign=campaign.name,
        prior_ranges=_prior_ranges(posterior, seed),
        prior_prob=_PRIOR_PROB,
        rhat_max=float(sampler["rhat_max"]),
        ess_bulk_min=float(sampler["ess_bulk_min"]),
        ess_tail_min=float(sampler["ess_tail_min"]),
        converged=bool(sampler["converged"]),
        prior_sensitivity={name: fit.sensitivity[name]["prior"] for name in fit.sensitive},
        left_out=_left_out_circles(nodes_by_model, left_out_nodes, seed),
        calibration=calibrate_posterior(
            posterior,
            replicates=replicates,
            draws=draws,
            seed=seed,
            executor=executor,
            progress=progress,
        ),
        stacking_weights=stacking_weights(log_densities),
        elpd={name: float(values.sum()) for name, values in log_densities.items()},
    )


def _models_to_stack(model: HybridModel) -> dict[str, HybridModel]:
    """Return one or two models: ``model`` without slopes, and ``model`` itself if it has slopes.

    Slopes are changes of compliance with force. The keys of the result say how compliance depends
    on force in the model, for example "constant".
    """
    models = {DEGREE_NAMES[0]: model.with_degree(0)}
    if model.degree > 0:
        models[DEGREE_NAMES[model.degree]] = model
    return models


def _prior_ranges(posterior: xr.DataTree, seed: int) -> dict[str, PriorRange]:
    """Return the measured range of every circle, with the prior predictive interval of the range.

    The range is the largest minus the smallest reading of a circle. The interval is computed from n
    circles drawn from the prior; ``seed`` is the seed of these circles. The result also states the
    p-value (m + 1) / (n + 1), where m of the n circles have at least the measured range. The
    p-value estimates how probable such a range is under the prior. The keys are names of tests.
    """
    bound = bound_of(posterior)
    rng = np.random.default_rng(seed)
    ranges = {}
    for test, readings_mm in zip(
        bound.campaign.tests, prior_circles(bound, _PRIOR_CIRCLES, rng), strict=True
    ):
        simulated_um = np.ptp(readings_mm, axis=1) * 1e3
        measured_um = float(np.ptp(test.readings_mm()) * 1e3)
        p_value = (1.0 + (simulated_um >= measured_um).sum()) / (_PRIOR_CIRCLES + 1.0)
        low, high = np.quantile(simulated_um, [0.5 - 0.5 * _PRIOR_PROB, 0.5 + 0.5 * _PRIOR_PROB])
        ranges[test.name] = PriorRange(measured_um, float(low), float(high), float(p_value))
    return ranges


def _left_out_circles(
    nodes_by_model: Mapping[str, Nodes],
    left_out_nodes: Mapping[str, Mapping[str, Nodes]],
    seed: int,
) -> dict[str, LeftOutCircle]:
    """Return the comparison of every circle with the prediction from the other circles.

    The keys are names of tests. ``nodes_by_model`` holds the posterior of each model given all
    tests; ``left_out_nodes`` holds, for each model and each test, the posterior given all other
    tests. A prediction consists of simulated circles; ``seed`` is the seed of the random numbers
    with which they are simulated.
    """
    judged = judge_tests(nodes_by_model, left_out_nodes, seed=seed, tolerance=_TOLERANCE)
    circles = {}
    for name, test in judged.items():
        circles[name] = LeftOutCircle(test.p_value, test.family_wise_p_value, test.worst_order)
    return circles


def stacking_weights(log_densities: Mapping[str, Array]) -> dict[str, float]:
    """Return the weights of the mixture of models that is best at predicting left-out circles.

    The keys are names of models. The weights w_m of the models m are not negative, sum to one and
    maximise Σ_r ln Σ_m w_m p_m(y_r | y_−r) (Yao et al., Bayesian Analysis 13, 2018), where y_r are
    the readings of test r and y_−r the readings of the other tests. ``log_densities`` holds, for
    each model m, the log densities ln p_m(y_r | y_−r) [nat] of all tests, shape (tests,). The
    weights are computed by the EM algorithm, in which the sum increases in every step.
    """
    names = list(log_densities)
    log_density = np.array([log_densities[name] for name in names])
    density = np.exp(log_density - log_density.max(axis=0))
    weights = np.full(len(names), 1.0 / len(names))
    for _ in range(_STACKING_STEPS):
        responsibility = weights[:, None] * density
        weights = (responsibility / responsibility.sum(axis=0)).mean(axis=1)
    return dict(zip(names, weights.tolist(), strict=True))
