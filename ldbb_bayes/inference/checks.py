"""Posterior predictive checks, which compare readings with readings predicted from the posterior.

The readings of a circle are described by 25 Fourier coefficients: a constant, and a cosine and a
sine coefficient for each of the orders 1 to 12. φ are the h hyper-parameters, such as the standard
deviation of the noise. One of them, σ, is the standard deviation of white noise. β are the p
parameters: compliances, their changes with force, and geometric errors. Shared nuisances are
effects that are modelled but not of interest, and that are common to several tests. Draws are
random draws from the posterior. r is the index of a test.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from scipy.special import chdtr, chdtrc, ndtr

from ldbb_bayes.campaign.campaign import CircularTest
from ldbb_bayes.inference.coefficients import (
    ModelDraws,
    draw_shared_coefficients,
    private_terms,
)
from ldbb_bayes.inference.residuals import (
    matrix_to_harmonics,
    tests_in_order,
)
from ldbb_bayes.model.fourier import MAX_ORDER, SIZE, basis, harmonic_index
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array, Result
from ldbb_bayes.units import ranked

__all__ = [
    "Check",
    "CheckKind",
    "TestChecks",
    "all_checks",
    "autocorrelation",
    "average_checks",
    "check_predictions",
    "failing_checks",
]

# Posterior predictive checks are computed from at most this number of posterior draws.
_DRAWS = 500
# Significance level of posterior predictive checks. A check fails if its p-value, multiplied by the
# number of all checks (Bonferroni), is below this level.
_FAILS = 0.01
# Smallest p-value of a posterior predictive check. Checks are ranked by the logarithm of their
# p-value, which must be finite. A smaller p-value is therefore replaced by this number.
_SMALLEST_P = 1e-300
# Largest number of readings of a test from which the autocorrelation of its noise is computed.
_LONGEST_STRETCH = 100_000
# The Fourier orders 0 to 12 are fitted to the readings of a test. The residuals count as rounding
# errors if their sum of squares is at most this fraction of the sum of squares of the readings.
_ROUNDING = 1e-24
# Smallest standard deviation of the autocorrelation of residuals. With one degree of freedom (26
# readings) the autocorrelation is the same for all readings, and its standard deviation is zero.
_LEAST_SD = 1e-6


class CheckKind(StrEnum):
    """Property of a test's readings that a posterior predictive check examines."""

    ORDER = "order"  #: residual of a test's readings at one of the Fourier orders 0 to 12
    NOISE = "noise"  #: scatter of a test's readings about a fit of the Fourier orders 0 to 12
    #: correlation between successive residuals of the readings, after the Fourier orders 0 to 12
    #: have been fitted to them
    AUTOCORRELATION = "autocorrelation"


@dataclass(frozen=True)
class Check:
    """One posterior predictive check of the readings of one test against the model.

    A small p-value means that readings like those measured are improbable under the model.
    """

    kind: CheckKind  #: property of a test's readings that this check examines, such as their noise
    test: str  #: name of the test whose readings are checked
    p: float  #: posterior predictive p-value of the readings of a test
    #: Fourier order at which the readings of a test are checked; None unless ``kind`` is
    #: `CheckKind.ORDER`
    order: int | None = None


@dataclass(frozen=True)
class TestChecks(Result):
    """Posterior predictive p-values of one test.

    The residual is the measured circle minus the effects of the machine and of shared nuisances.
    Shared nuisances are effects that are modelled but not of interest and that are common to
    several tests, such as ball form. ``orders_p`` holds a p-value for each Fourier order. It is the
    probability that the residual of a new circle at this order exceeds the residual of the measured
    circle, averaged over the posterior. The p-values ``noise_p`` and ``autocorrelation_p`` are
    two-sided. ``autocorrelation`` and these two p-values are None if the test has at most 25
    readings.
    """

    __test__ = False

    #: posterior predictive p-values of the residual of a test's readings at each Fourier order; the
    #: keys are the orders from 0 to 12
    orders_p: dict[int, float]
    #: p-value of the hypothesis that the white noise of a test's readings is as large as the model
    #: says. The p-value is computed from the residuals of a fit of the Fourier orders 0 to 12 to
    #: the readings.
    noise_p: float | None
    #: correlation between successive residuals of the readings, after the Fourier orders 0 to 12
    #: have been fitted to them
    autocorrelation: float | None
    #: p-value of the correlation ``autocorrelation`` between successive residuals, under the
    #: hypothesis that the noise is white
    autocorrelation_p: float | None

    def of(self, test: str) -> list[Check]:
        """Return the posterior predictive checks of a circular test, one for each p-value.

        ``test`` is the name of the circular test; each check states it.
        """
        checks = [Check(CheckKind.ORDER, test, p, order) for order, p in self.orders_p.items()]
        if self.noise_p is not None:
            checks.append(Check(CheckKind.NOISE, test, self.noise_p))
        if self.autocorrelation_p is not None:
            checks.append(Check(CheckKind.AUTOCORRELATION, test, self.autocorrelation_p))
        return checks


def all_checks(checks_by_test: Mapping[str, TestChecks]) -> list[Check]:
    """Return the posterior predictive checks of all tests in one list, the smallest p-value first.

    ``checks_by_test`` holds the p-values of each test; its keys are the names of the tests.
    """
    checks: list[Check] = []
    for test, test_checks in checks_by_test.items():
        checks += test_checks.of(test)
    return ranked(checks, _surprise)


def _surprise(check: Check) -> float:
    """Return −ln p of a check; checks are ranked by this number.

    p is the posterior predictive p-value. A p-value below ``_SMALLEST_P`` is replaced by
    ``_SMALLEST_P``.
    """
    return -math.log(max(check.p, _SMALLEST_P))


def failing_checks(checks: Sequence[Check]) -> tuple[Check, ...]:
    """Return the posterior predictive checks that fail.

    A check fails if its p-value, multiplied by the number of checks (Bonferroni), is below 1 %.
    """
    return tuple(check for check in checks if check.p * len(checks) < _FAILS)


def check_predictions(
    bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator
) -> dict[str, TestChecks]:
    """Return posterior predictive p-values of every test; the keys are the names of the tests.

    Each p-value compares the readings of a test with the readings that the posterior predicts for a
    new circle. ``phi``, shape (draws, h), holds posterior draws of the h hyper-parameters (such as
    the standard deviation of the noise). ``beta``, shape (draws, p), holds posterior draws of the p
    parameters (compliances, their changes with force, geometric errors). At most 500 of the draws
    are used. ``rng`` generates the random readings. ``bound`` is the model of the campaign.
    """
    draws = ModelDraws(bound, phi, beta).thinned(_DRAWS)
    shared = draw_shared_coefficients(bound, draws.phi, draws.beta, rng)
    sigma = draws.phi[:, bound.hyper_prior.names.index("sigma")]
    checks = {}
    for r, test in enumerate(tests_in_order(bound)):
        orders_p = _p_values_of_orders(draws, r, shared[:, r], sigma)
        reduced = bound.reduced[r]
        freedom = reduced.readings - SIZE
        if freedom > 0:
            squares = reduced.residual_ss / sigma**2
            tails = [chdtrc(freedom, squares).mean(), chdtr(freedom, squares).mean()]
            noise_p = float(2.0 * min(tails))
            correlation, correlation_p = autocorrelation(test)
            checks[str(test.name)] = TestChecks(orders_p, noise_p, correlation, correlation_p)
        else:
            checks[str(test.name)] = TestChecks(orders_p, None, None, None)
    return checks


def _p_values_of_orders(draws: ModelDraws, r: int, shared: Array, sigma: Array) -> dict[int, float]:
    """Return posterior predictive p-values of a test, as a dict with the Fourier orders as keys.

    The residual is the readings minus the predicted effects of the machine and of shared nuisances
    (effects that are modelled but not of interest, such as ball form). The p-value compares the
    residual with the scatter that the model expects from noise and from effects that act on this
    test only.

    Parameters
    ----------
    draws
        Posterior draws of one model.
    r
        Index of the test.
    shared
        Fourier coefficients of the orders 0 to 12 that machine and shared nuisances predict for
        test r in every draw [mm], shape (draws, 25).
    sigma
        Standard deviation σ of white noise in every draw, shape (draws,) [mm].
    """
    reduced = draws.bound.reduced[r]
    to_harmonics = matrix_to_harmonics(draws.bound, r)
    residual = (np.asarray(reduced.reading_mm) - shared @ reduced.factor.T) @ to_harmonics.T
    basis_to_harmonics = to_harmonics @ reduced.factor
    columns = [to_harmonics]
    sd = [np.tile(sigma[:, None], to_harmonics.shape[1])]
    for term in private_terms(draws.bound, draws.phi, r):
        columns.append(basis_to_harmonics @ term.columns)
        sd.append(term.sd)
    squares = _squares_of_orders(
        residual, np.concatenate(columns, axis=1), np.concatenate(sd, axis=1)
    )
    # At all orders but 0, χ² has two degrees of freedom: it exceeds x with probability e^(−x/2).
    p_values = np.exp(-0.5 * squares)
    p_values[:, 0] = chdtrc(1, squares[:, 0])
    return dict(enumerate(p_values.mean(axis=0).tolist()))


def _squares_of_orders(residual: Array, columns: Array, sd: Array) -> Array:
    """Return rᵀ V⁻¹ r for each draw and each of the Fourier orders 0 to 12, shape (draws, 13).

    r is the part of the residual at one order. It is one number at the order 0, and two numbers (of
    the cosine and of the sine) at all others. V is its covariance matrix C S² Cᵀ. The residual
    scatters because of v independent sources. C holds the effects of the sources at this order, and
    the diagonal matrix S holds their standard deviations.

    Parameters
    ----------
    residual
        Residual Fourier coefficients of a test, shape (draws, 25) [mm].
    columns
        Effect of each of v independent sources on the 25 coefficients, shape (25, v).
    sd
        Standard deviations of the v sources in every draw, shape (draws, v).
    """
    cosine, sine = np.transpose([harmonic_index(order) for order in range(1, MAX_ORDER + 1)])
    variance = sd**2 @ (columns**2).T
    covariance = sd**2 @ (columns[cosine] * columns[sine]).T
    squares = np.empty((len(residual), MAX_ORDER + 1))
    squares[:, 0] = residual[:, 0] ** 2 / variance[:, 0]
    # The square of a pair is the square of its first number, plus that of what the first number
    # does not predict of the second; each is divided by its own variance.
    slope = covariance / variance[:, cosine]
    remainder = residual[:, sine] - slope * residual[:, cosine]
    remaining_variance = variance[:, sine] - slope * covariance
    squares[:, 1:] = residual[:, cosine] ** 2 / variance[:, cosine]
    squares[:, 1:] += remainder**2 / remaining_variance
    return squares


def average_checks(
    shares: Array, checks_by_model: Sequence[Mapping[str, TestChecks]]
) -> dict[str, TestChecks]:
    """Return posterior predictive p-values of every test, averaged over several models.

    ``shares`` are the weights of the models, which sum to one. ``checks_by_model`` holds a dict for
    each model, with the p-values under this model. The keys of these dicts and of the result are
    the names of the tests. The autocorrelation and its p-value are the same under all models.
    """
    averaged = {}
    for name, first in checks_by_model[0].items():
        of_test = [checks[name] for checks in checks_by_model]
        orders_p = {}
        for order in first.orders_p:
            orders_p[order] = float(np.dot(shares, [checks.orders_p[order] for checks in of_test]))
        noise_p = None
        noise_p_by_model = [checks.noise_p for checks in of_test if checks.noise_p is not None]
        if noise_p_by_model:
            noise_p = float(np.dot(shares, noise_p_by_model))
        averaged[name] = TestChecks(
            orders_p, noise_p, first.autocorrelation, first.autocorrelation_p
        )
    return averaged


def autocorrelation(test: CircularTest) -> tuple[float, float]:
    """Return the lag-one autocorrelation of a test's residuals, and its p-value.

    The Fourier orders 0 to 12 are fitted to the readings in order of angle; the residuals are the
    readings minus this fit. The p-value is that of a two-sided test of the hypothesis that the
    noise is white; its moments under this hypothesis are those of `_moments_under_white_noise`.
    Only the first 100 000 readings in order of angle are used. If the residuals are only rounding
    errors, the autocorrelation is 0 and its p-value is 1.
    """
    order = np.argsort(test.angle_deg, kind="stable")[:_LONGEST_STRETCH]
    angle = test.angles_rad()[order]
    reading = test.readings_mm()[order]
    columns = np.linalg.qr(basis(angle))[0]
    residual = reading - columns @ (columns.T @ reading)
    square = float(residual @ residual)
    if square <= _ROUNDING * float(reading @ reading):
        return 0.0, 1.0
    value = float(residual[1:] @ residual[:-1]) / square
    white = _moments_under_white_noise(columns)
    return value, float(2.0 * ndtr(-abs(value - white.mean) / white.sd))


class _WhiteNoiseMoments(NamedTuple):
    """Mean and standard deviation of the lag-one autocorrelation of a test's residuals."""

    mean: float
    sd: float  #: standard deviation of the lag-one autocorrelation, at least ``_LEAST_SD``


def _moments_under_white_noise(columns: Array) -> _WhiteNoiseMoments:
    """Return mean and standard deviation of the autocorrelation of residuals of white noise.

    The residuals are M e, where e are n readings of white noise, and M = I − Q Qᵀ, shape (n, n),
    removes the Fourier orders 0 to 12 from them. ``columns`` is Q, shape (n, 25): an orthonormal
    basis of these orders. The autocorrelation is eᵀ A e / eᵀ M e with A = M H M, where H has ½
    beside its diagonal. Both are exact: ν = n − 25 degrees of freedom are left, the mean is
    tr A / ν, and the variance 2 (ν tr A² − (tr A)²) / (ν² (ν + 2)). The variance is far below 1/n
    if n is small, because few orders above 12 are left.
    """
    n = len(columns)
    freedom = n - SIZE
    shifted = np.zeros_like(columns)
    shifted[1:] += 0.5 * columns[:-1]
    shifted[:-1] += 0.5 * columns[1:]
    within = columns.T @ shifted
    trace = -float(np.trace(within))
    trace_of_square = 0.5 * (n - 1) - 2.0 * float((shifted**2).sum()) + float((within**2).sum())
    variance = 2.0 * (freedom * trace_of_square - trace**2) / (freedom**2 * (freedom + 2))
    return _WhiteNoiseMoments(trace / freedom, max(float(np.sqrt(max(variance, 0.0))), _LEAST_SD))
