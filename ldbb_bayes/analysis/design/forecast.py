"""Forecast of tests before they are run: expected uncertainties and information gain.

`design` uses this forecast for the tests that it recommends, `identify` uses it for a plan, and the
browser page uses it for the tests that are set with its sliders.

A forecast depends on the model, on the tests, and on what is known of the machine before the tests.
The analysis of the tests is simulated on many possible machines (`simulated_analyses`). The
expected uncertainty of a parameter is the median of the uncertainties that these analyses state.
Slopes are changes of compliances with force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ldbb_bayes.analysis.design.bound_plans import bind_plan
from ldbb_bayes.analysis.design.discrimination import Discrimination, discrimination_of
from ldbb_bayes.analysis.design.simulated_analyses import (
    LIKELY,
    SEED,
    SimulatedAnalyses,
    analyses_on_machines,
    stated_variances,
    states_of,
    tests_already_run,
)
from ldbb_bayes.analysis.design.slope_priors_of_pilot import with_slope_priors_of_pilot
from ldbb_bayes.analysis.design.states import States, extend_hyper_parameters
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.model.bound_information import information_of, informations_of
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, Finite, Result

__all__ = [
    "Expected",
    "Forecast",
    "Slopes",
    "expected_uncertainties",
    "forecast_plan",
    "forecast_tests",
    "posteriors",
]

# Standard error of the median of normally distributed values, divided by the standard error of
# their mean.
_ERROR_OF_MEDIAN = 1.2533
# The lower limit ("floor") of a parameter's uncertainty is the standard deviation that would remain
# if every planned test were run this number of times.
_REPETITIONS_OF_FLOOR = 1e6
# Singular values of the design matrix below this number are treated as zero in the decision whether
# the tests determine every parameter.
_RANK_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Expected(Result):
    """Prior and expected posterior standard deviation of one parameter, in the unit ``unit``.

    On each possible machine, the analysis of the tests would state a different standard
    uncertainty: ``sd`` is the median over the machines, and nine in ten machines have at most
    ``likely_sd``. Both account for the condition that no compliance is negative, which truncates
    the posterior; ``untruncated_sd`` is the median without this condition. ``sd_error`` is the
    standard error of ``sd``, computed from the scatter of the uncertainties between the machines.
    It is somewhat too large, because the machines are spread more evenly than independent random
    machines would be.

    ``floor_sd`` is the standard deviation that would remain if every planned test were run a
    million times. It comes from nuisance effects (modelled, but not of interest) that are the same
    in all tests. The condition that no compliance is negative reduces ``floor_sd`` in the same
    ratio as ``sd``.

    ``prior_sd`` is that of an analysis of the planned tests, which sizes the prior of a slope by
    the compliance that its own readings show; it is then the median over the machines. It is
    infinite for a flat prior. If priors are flat and the tests do not determine all parameters, all
    values are infinite.
    """

    unit: str
    prior_sd: Finite
    sd: Finite
    sd_error: Finite
    likely_sd: Finite
    untruncated_sd: Finite
    floor_sd: Finite


@dataclass(frozen=True, eq=False)
class Forecast(Result):
    """Results that planned tests are expected to give, such as the uncertainties of parameters."""

    #: standard deviation of each parameter under the prior, and as expected after the planned
    #: tests; the keys are the names of the parameters
    expected: dict[str, Expected]
    #: expected information gain of the planned tests [nat]: the expectation of the Kullback-Leibler
    #: divergence of the posterior from the prior; infinite for a flat prior
    information_gain: Finite
    #: evidence for or against slopes that the planned tests are expected to give; None if the model
    #: has no slopes, or if priors are flat
    discrimination: Discrimination | None

    @property
    def determined(self) -> bool:
        """Whether the planned tests determine every parameter; always true with proper priors."""
        return all(np.isfinite(entry.sd) for entry in self.expected.values())


@dataclass(frozen=True)
class Slopes:
    """Slopes about which planned tests give evidence, and their assumed root mean square."""

    #: names of the slopes about which evidence is forecast, such as ``C_XXX_1``
    names: tuple[str, ...]
    #: root mean square that the slopes are assumed to have on a machine with slopes, in prior
    #: standard deviations
    size: float = 1.0


@one_blas_thread
def forecast_plan(
    model: HybridModel,
    plan: Campaign,
    *,
    slopes: Slopes | None = None,
    machines: int | None = None,
    analyses: SimulatedAnalyses | None = None,
) -> Forecast:
    """Return the forecast of a plan: expected uncertainties, information gain and evidence.

    Parameters
    ----------
    model : HybridModel
        Model for the analysis of the plan's tests.
    plan : Campaign
        Plan. Before it is run, the machine is known only from the readings of the plan's pilot (the
        campaign that the plan starts from) or, if there are none, from the prior.
    slopes : Slopes, optional
        Slopes (changes of compliance with force) for which the evidence is forecast, and their
        assumed size. Default: all slopes of the model, with a root mean square of one prior
        standard deviation.
    machines : int, optional
        Number of possible machines that the forecast averages over. A smaller number is faster and
        less exact. Default: 64.
    analyses : SimulatedAnalyses, optional
        Analyses of the plan's tests, if they have already been simulated with this model. Default:
        they are simulated.

    Returns
    -------
    Forecast
        Expected uncertainties, information gain, and evidence for or against slopes.

    Examples
    --------
    >>> forecast = lb.analysis.forecast_plan(lb.HybridModel.first(0), campaign.plan())
    >>> forecast.expected["C_XXX"].sd < forecast.expected["C_XXX"].likely_sd
    True
    """
    if analyses is not None:
        return forecast_tests(
            analyses.bound,
            analyses.states,
            tests_run=analyses.tests_run,
            slopes=slopes,
            analyses=analyses,
        )
    analysed_with = with_slope_priors_of_pilot(model, plan)
    bound = bind_plan(analysed_with, plan)
    states = states_of(analysed_with, plan, machines)
    return forecast_tests(bound, states, tests_run=tests_already_run(plan), slopes=slopes)


def forecast_tests(
    bound: BoundModel,
    states: States,
    *,
    tests_run: int = 0,
    slopes: Slopes | None = None,
    known_scales: bool = False,
    analyses: SimulatedAnalyses | None = None,
) -> Forecast:
    """Return the forecast of planned tests.

    Parameters
    ----------
    bound
        Model applied to the tests that have already been run, followed by the planned tests.
    states
        Possible states of the machine before the planned tests: values of its parameters and
        hyper-parameters.
    tests_run
        Number of tests that have already been run.
    slopes
        Slopes (changes of compliance with force) for which the evidence is forecast, and their
        assumed size. Default: all slopes of the model, with a root mean square of one prior
        standard deviation.
    known_scales
        Whether to assume that the analysis knows the hyper-parameters, and that the noise has the
        same size in all circles. Default: the analysis estimates the hyper-parameters from its
        readings.
    analyses
        Simulated analyses of the tests, if they are already known. Default: they are simulated.

    Returns
    -------
    Forecast
        Expected uncertainties, information gain, and evidence for or against slopes.
    """
    posterior, floor = posteriors(bound, states.phi, tests_run)
    if posterior is None:
        return _undetermined_forecast(bound)
    covariance = posterior.covariance
    if known_scales or bound.model.prior.flat:
        analyses = SimulatedAnalyses(bound, tests_run, states, states, covariance[:, None])
    elif analyses is None:
        analyses = analyses_on_machines(bound, states, tests_run, SEED)
    expected = expected_uncertainties(analyses, covariance, floor)
    if bound.model.prior.flat:
        return Forecast(expected, np.inf, None)
    information_gain = float(-0.5 * np.linalg.slogdet(covariance)[1].mean())
    if slopes is None:
        slopes = Slopes(tuple(p.name for p in bound.parameters if p.group == "slope"))
    return Forecast(
        expected, information_gain, _evidence(bound, states, covariance, tests_run, slopes)
    )


def posteriors(bound: BoundModel, phi: Array, tests_run: int) -> tuple[Gaussian | None, Array]:
    """Return the posterior p(β | y, φ), and the standard deviations after very many tests.

    β are the p parameters and φ the h hyper-parameters. Both results are computed for K sets of φ,
    and are in units of the prior standard deviations. The readings y are not known yet. The mean of
    the posterior is therefore set to zero; only its covariance is meaningful.

    Parameters
    ----------
    bound
        Model applied to the tests.
    phi
        K sets of hyper-parameters of the campaign that the design starts from, shape (K, h);
        lengths in mm.
    tests_run
        Number of circles of ``bound`` that have already been run; these circles come first in
        ``bound``.

    Returns
    -------
    posterior : Gaussian or None
        Posterior in which compliances may be negative; None if priors are flat and the tests do not
        determine all parameters.
    floor : Array
        Standard deviation that each parameter would have if every planned test were run a million
        times, shape (p,). It is the root mean square over the K sets of φ. The array is empty if
        ``posterior`` is None.
    """
    phi = extend_hyper_parameters(bound, phi, tests_run)
    first = information_of(bound, phi[0])
    interest = first.interest
    size = len(first.names)
    rows_run = []
    rows_planned = []
    for information in informations_of(bound, phi):
        blocks = information.blocks()
        rows_run.append(_compressed_rows(blocks[:tests_run], size))
        rows_planned.append(_compressed_rows(blocks[tests_run:], size))
    already_run = np.array(rows_run)
    planned = np.array(rows_planned)
    once = np.concatenate([already_run, planned], axis=1)
    if first.flat:
        rank = np.linalg.matrix_rank(once[..., interest], tol=_RANK_TOLERANCE).min()
        if rank < len(interest):
            return None, np.zeros(0)
    # The uncertainties are computed for one run of every planned test, and for a million runs. N
    # runs give N times the information of one run. The derivatives of the readings with respect to
    # the parameters are therefore multiplied by √N. Tests already run are not repeated.
    often = np.concatenate([already_run, np.sqrt(_REPETITIONS_OF_FLOOR) * planned], axis=1)
    once_and_often = np.stack([once, often])
    no_reading = np.zeros(once_and_often.shape[:-1])
    if first.flat:
        both = Gaussian.from_rows(once_and_often, no_reading)
    else:
        prior = Gaussian.of(np.zeros(size), np.ones(size))
        both = prior.observe(once_and_often, no_reading).marginal(interest.tolist())
    posterior = Gaussian.factored(both.mean[0], both.root[0], both.scale[0])
    floor = np.sqrt((both.sd[1] ** 2).mean(axis=0))
    return posterior, floor


def _compressed_rows(blocks: Sequence[Array], size: int) -> Array:
    """Return as few rows as hold the information of several tests, shape (rows, size).

    ``blocks`` holds one matrix for each test: the derivatives of its readings with respect to the
    ``size`` coefficients of the model. The QR factorisation of all of them has at most ``size``
    rows, and loses no information.
    """
    return np.asarray(np.linalg.qr(np.concatenate([np.zeros((0, size)), *blocks]), mode="r"))


def expected_uncertainties(
    analyses: SimulatedAnalyses, covariance: Array, floor: Array
) -> dict[str, Expected]:
    """Return the expected uncertainty of every parameter after planned tests.

    Parameters
    ----------
    analyses
        Analyses of the tests, simulated on K possible machines.
    covariance
        Posterior covariances of the p parameters on each machine, shape (K, p, p), in units of the
        prior standard deviations. They are computed as if compliances could be negative, and as if
        the noise had the same size in all circles.
    floor
        Standard deviations that remain after very many tests, shape (p,), in units of the prior
        standard deviations.

    Returns
    -------
    dict of str to Expected
        Expected uncertainties; the keys are the names of the parameters.
    """
    bound = analyses.bound
    states = analyses.states_of_analyses
    believed = analyses.covariance
    prior_sd = analyses.prior_sd
    scale = bound.scale
    variances = stated_variances(bound, states, believed * np.outer(scale, scale))
    sd = np.sqrt(np.median(variances, axis=0))
    likely_variance = np.quantile(variances, LIKELY, axis=0, method="weibull")
    likely_sd = np.sqrt(likely_variance)
    untruncated = stated_variances(
        bound, states, believed * np.outer(scale, scale), truncated=False
    )
    untruncated_sd = np.sqrt(np.median(untruncated, axis=0))
    # Further tests cannot make a parameter less well known, but the forecast is made from few
    # machines. It is limited to what is known before the tests.
    if not bound.model.prior.flat:
        excess = np.maximum(untruncated_sd / _sd_before(states), 1.0)
        untruncated_sd = untruncated_sd / excess
        sd = sd / excess
    sd_error = np.sqrt(variances).std(axis=0) * _ERROR_OF_MEDIAN / np.sqrt(len(states.phi))
    typical_sd = np.sqrt(np.einsum("kii->ki", covariance).mean(axis=0))
    floor_sd = floor * np.minimum(scale, sd / typical_sd)
    expected = {}
    for k, parameter in enumerate(bound.parameters):
        expected[parameter.name] = Expected(
            unit=parameter.unit,
            prior_sd=float(prior_sd[k]),
            sd=float(sd[k]),
            sd_error=float(sd_error[k]),
            likely_sd=float(likely_sd[k]),
            untruncated_sd=float(untruncated_sd[k]),
            floor_sd=float(floor_sd[k]),
        )
    return expected


def _sd_before(states: States) -> Array:
    """Return the standard deviations of the p parameters before the tests, shape (p,).

    The variance is the mean of the variances given the hyper-parameters, plus the variance of the
    means. ``states`` are the possible states of the machine. Compliances may be negative. The
    priors must not be flat.
    """
    before = states.before
    return np.asarray(np.sqrt((before.sd**2).mean(axis=0) + before.mean.var(axis=0)))


def _undetermined_forecast(bound: BoundModel) -> Forecast:
    """Return infinite uncertainties, for tests that do not determine all parameters."""
    expected = {}
    for parameter in bound.parameters:
        expected[parameter.name] = Expected(
            unit=parameter.unit,
            prior_sd=parameter.prior_sd,
            sd=np.inf,
            sd_error=np.inf,
            likely_sd=np.inf,
            untruncated_sd=np.inf,
            floor_sd=np.inf,
        )
    return Forecast(expected, np.inf, None)


def _evidence(
    bound: BoundModel, states: States, covariance: Array, tests_run: int, slopes: Slopes
) -> Discrimination | None:
    """Return the expected evidence for or against slopes; None if there are no slopes.

    ``states`` are K possible states of the machine before the tests: values of its parameters and
    hyper-parameters. ``covariance`` are the posterior covariances of the p parameters in each
    state, shape (K, p, p), in units of the prior standard deviations. ``tests_run`` is the number
    of tests that have already been run. ``slopes`` holds the names of the slopes, and the root mean
    square that the slopes are assumed to have if the compliances change with force.
    """
    if not slopes.names:
        return None
    columns = [bound.names.index(name) for name in slopes.names]
    before = None
    pilot = bound.pilot or bound.campaign
    if tests_run and not pilot.is_plan:
        scale = bound.scale[columns]
        marginal = states.before.marginal(columns)
        before = Gaussian.factored(marginal.mean / scale, marginal.root, marginal.scale / scale)
    return discrimination_of(
        covariance[:, columns][:, :, columns],
        slopes.names,
        size=slopes.size,
        before=before,
        seed=SEED,
    )
