"""Forecast of tests before they are run: expected uncertainties, and information gain.

The forecast is computed for the linear Gaussian model, given the hyper-parameters φ (the scales of
the noise and of other effects), and averaged over φ. The expected standard deviations (sds) account
for the truncation (compliances must not be negative). β are the parameters (compliances, their
slopes and geometric errors). A state is one possible machine: values of φ and β.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldbb_bayes.analysis.design.discrimination import Discrimination
from ldbb_bayes.analysis.design.states import States, extend_hyper_parameters
from ldbb_bayes.model.bound_information import information_of, informations_of
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.linear_algebra import singular_root
from ldbb_bayes.results import Array, Finite, Result

__all__ = [
    "Expected",
    "Forecast",
    "expected_uncertainties",
    "posteriors",
    "truncated_variances",
    "undetermined_forecast",
]

# Number of posterior means that a forecast draws at random for each possible state of the machine.
# Each is one that an analysis of the new tests may find.
_MEANS_PER_STATE = 4
# The floor of a parameter's uncertainty is its expected standard deviation if every test were run
# this many times.
_REPETITIONS_OF_FLOOR = 1e6
# Singular values of the design matrix of the readings below this count as zero, when it is tested
# whether the tests determine every parameter.
_RANK_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Expected(Result):
    """Prior and expected posterior standard deviation of one parameter, in mm, N and rad.

    ``prior_sd`` is infinite for a flat prior. ``sd`` accounts for the truncation (compliances must
    not be negative), ``untruncated_sd`` does not. The squares of both are averages over the
    hyper-parameters. Both are infinite if, with flat priors, the tests leave a parameter
    undetermined. ``sd_error`` is the standard error of ``sd`` from the scatter over possible states
    of the machine. It is somewhat too large, because states are spread more evenly than independent
    ones. ``floor_sd`` is the standard deviation if every test were run a million times. It is due
    to nuisance effects that all tests share, and is reduced for the truncation in the same ratio as
    ``sd``.
    """

    unit: str
    prior_sd: Finite
    sd: Finite
    sd_error: Finite
    untruncated_sd: Finite
    floor_sd: Finite


@dataclass(frozen=True, eq=False)
class Forecast(Result):
    """Forecast of planned tests: expected uncertainties, information gain, evidence on slopes."""

    #: prior and expected standard deviation of each parameter, by name
    expected: dict[str, Expected]
    #: expected Kullback-Leibler divergence of the posterior from the prior [nat]; infinite for a
    #: flat prior
    information_gain: Finite
    #: expected evidence for or against slopes; None for a model without slopes or with flat priors
    discrimination: Discrimination | None

    @property
    def determined(self) -> bool:
        """Whether the tests determine every parameter; always true with proper priors."""
        return all(np.isfinite(entry.sd) for entry in self.expected.values())


def undetermined_forecast(bound: BoundModel) -> Forecast:
    """Return the forecast of tests that leave parameters undetermined: all sds are infinite."""
    expected = {}
    for parameter in bound.parameters:
        expected[parameter.name] = Expected(
            parameter.unit, parameter.prior_sd, np.inf, np.inf, np.inf, np.inf
        )
    return Forecast(expected, np.inf, None)


def expected_uncertainties(
    bound: BoundModel, states: States, covariance: Array, floor: Array, seed: int
) -> dict[str, Expected]:
    """Return the expected uncertainty of every parameter after planned tests.

    Parameters
    ----------
    bound
        Model bound to the tests.
    states
        K possible states of the machine before the tests: hyper-parameters and parameters.
    covariance
        Posterior covariances of the p parameters in each state if compliances may be negative,
        shape (K, p, p), in units of the prior standard deviations.
    floor
        Standard deviations that remain after very many tests, shape (p,), in units of the prior
        standard deviations.
    seed
        Seed of the random posterior means that an analysis of the tests may find.

    Returns
    -------
    dict of str to Expected
        Expected uncertainty by parameter.
    """
    scale = bound.scale
    untruncated_sd = scale * np.sqrt(np.einsum("kii->ki", covariance).mean(axis=0))
    variance, variance_error = truncated_variances(
        bound, states, covariance * np.outer(scale, scale), seed
    )
    sd = np.sqrt(variance)
    # The error of the sd follows from that of the variance to first order. Where the variance is
    # zero within its error, it is the sd of a variance that is larger by one standard error.
    sd_error = np.sqrt(variance_error)
    is_positive = sd > 0.0
    sd_error[is_positive] = 0.5 * variance_error[is_positive] / sd[is_positive]
    floor_sd = scale * floor * np.minimum(1.0, sd / untruncated_sd)
    expected = {}
    for k, parameter in enumerate(bound.parameters):
        expected[parameter.name] = Expected(
            unit=parameter.unit,
            prior_sd=parameter.prior_sd,
            sd=float(sd[k]),
            sd_error=float(sd_error[k]),
            untruncated_sd=float(untruncated_sd[k]),
            floor_sd=float(floor_sd[k]),
        )
    return expected


def truncated_variances(
    bound: BoundModel, states: States, covariance: Array, seed: int
) -> tuple[Array, Array]:
    """Return expected posterior variances with truncation, and their standard errors.

    With truncation, compliances must not be negative. A state is one possible machine. States in
    which a compliance would be negative at a force of the new tests are left out, unless this holds
    for all states. For every other state, posterior means that the analysis may find are drawn at
    random. For each mean, the variance of the truncated Gaussian about it is computed.

    Parameters
    ----------
    bound
        Model bound to the tests.
    states
        K states of the machine before the tests.
    covariance
        Posterior covariances of the p parameters in each state, without truncation, shape (K, p,
        p), in internal units (mm, N, rad).
    seed
        Seed of the random posterior means that an analysis of the tests may find.

    Returns
    -------
    variance : Array
        Mean variance over the states that are not left out, shape (p,), in internal units.
    error : Array
        Standard error of the mean variance, shape (p,).
    """
    variance_by_state = np.einsum("kii->ki", covariance)
    if bound.truncation.active:
        is_possible = bound.truncation.holds(states.beta)
        is_possible |= not is_possible.any()
        change = _variance_change_by_truncation(bound, states, is_possible, covariance, seed)
        variance_by_state = variance_by_state[is_possible] + change
    error = variance_by_state.std(axis=0) / np.sqrt(max(len(variance_by_state) - 1, 1))
    return np.maximum(variance_by_state.mean(axis=0), 0.0), error


def _variance_change_by_truncation(
    bound: BoundModel, states: States, is_possible: Array, covariance: Array, seed: int
) -> Array:
    """Return how much the truncation changes the posterior variances, in every possible state.

    With truncation, compliances must not be negative. For each state, posterior means are drawn as
    the analysis may find them, and the variances of the truncated Gaussian about each mean are
    averaged. The change is negative where the truncation narrows the posterior.

    Parameters
    ----------
    bound
        Model bound to the new tests.
    states
        K states of the machine before the tests.
    is_possible
        Mask of the states that are used, shape (K,): those in which no compliance is negative, or
        all states if there is no such state.
    covariance
        Posterior covariances of the p parameters without truncation, shape (K, p, p), in internal
        units (mm, N, rad).
    seed
        Seed of the random posterior means.

    Returns
    -------
    Array
        Variance with truncation minus variance without, shape (possible states, p), in internal
        units.
    """
    scale = bound.scale
    p = len(scale)
    relative_covariance = covariance[is_possible] / np.outer(scale, scale)
    relative_means = _draw_posterior_means(states, is_possible, relative_covariance, scale, seed)
    means = scale * relative_means.reshape(-1, p)
    spread = np.tile(singular_root(relative_covariance) * scale[:, None], (_MEANS_PER_STATE, 1, 1))
    shift, covariance_inside, axes = bound.truncation.orthants(means, spread).moments()
    # In standard coordinates, the covariance of the parameters without truncation is the identity.
    # Along the directions ``axes`` that the truncation restricts, it becomes ``covariance_inside``.
    along_axes = spread @ np.swapaxes(axes, 1, 2)
    change_along_axes = along_axes @ (covariance_inside - np.eye(shift.shape[1]))
    change = np.einsum("kpd,kpd->kp", change_along_axes, along_axes)
    return np.asarray(change.reshape(relative_means.shape).mean(axis=0))


def _draw_posterior_means(
    states: States, is_possible: Array, covariance: Array, scale: Array, seed: int
) -> Array:
    """Draw posterior means that an analysis of the new tests may find, in every possible state.

    Let m₁ be the mean and P₁ the precision of the p parameters β before the tests, C their
    covariance after the tests, and W = 1 − C P₁. Given β of a state, the posterior mean is normally
    distributed with the mean m₁ + W (β − m₁) and the covariance W C. ``is_possible``, shape (K,),
    is true for those of the K states in which no compliance is negative, or for all states if there
    is no such state; ``covariance`` holds C for each of these. C and the result, shape (draws,
    possible states, p), are in units of ``scale``, the prior standard deviations.
    """
    prior_mean = states.before.mean[is_possible]
    prior_precision = states.before.precision[is_possible] * np.outer(scale, scale)
    weight = np.eye(len(scale)) - covariance @ prior_precision
    root = singular_root(weight @ covariance)
    deviation = (states.beta[is_possible] - prior_mean) / scale
    mean = prior_mean / scale + np.einsum("kij,kj->ki", weight, deviation)
    noise = np.random.default_rng(seed).standard_normal((_MEANS_PER_STATE, *mean.shape))
    return np.asarray(mean + np.einsum("kij,rkj->rki", root, noise))


def posteriors(bound: BoundModel, phi: Array, run: int) -> tuple[Gaussian | None, Array]:
    """Return the posterior p(β | y, φ), and the standard deviations that very many tests leave.

    β are the p parameters and φ the hyper-parameters, of which K values are given. Both results are
    in units of the prior standard deviations. The readings y are not known yet. The mean of the
    posterior is therefore set to zero, and only its covariance has a meaning.

    Parameters
    ----------
    bound
        Model bound to the tests.
    phi
        Hyper-parameters of the campaign that the design starts from, shape (K, h) [mm].
    run
        Number of circles of ``bound`` that were run already, which come first.

    Returns
    -------
    posterior : Gaussian or None
        Posterior in which compliances may be negative; None where, with flat priors, a parameter is
        undetermined.
    floor : Array
        Standard deviations of the p parameters if every test were run a million times, shape (p,):
        their root mean square over the K values of φ. Empty where ``posterior`` is None.
    """
    phi = extend_hyper_parameters(bound, phi, run)
    first = information_of(bound, phi[0])
    interest = first.interest
    size = len(first.names)
    # A QR factorisation compresses the information of the readings to as many rows as there are
    # coefficients.
    row_list = []
    for information in informations_of(bound, phi):
        row_list.append(np.linalg.qr(information.rows(), mode="r"))
    rows = np.array(row_list)
    if first.flat:
        rank = np.linalg.matrix_rank(rows[..., interest], tol=_RANK_TOLERANCE).min()
        if rank < len(interest):
            return None, np.zeros(0)
    once_and_often = np.array([1.0, np.sqrt(_REPETITIONS_OF_FLOOR)])[:, None, None, None] * rows
    no_reading = np.zeros(once_and_often.shape[:-1])
    if first.flat:
        both = Gaussian.from_rows(once_and_often, no_reading)
    else:
        prior = Gaussian.of(np.zeros(size), np.ones(size))
        both = prior.observe(once_and_often, no_reading).marginal(interest.tolist())
    posterior = Gaussian.factored(both.mean[0], both.root[0], both.scale[0])
    floor = np.sqrt((both.sd[1] ** 2).mean(axis=0))
    return posterior, floor
