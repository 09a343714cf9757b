"""Effects of failing posterior predictive checks on the parameters and their credible intervals.

A failing check shows that the model does not describe the readings of a test well. This matters if
leaving out the test would change the parameters, or if noise like that of the test would widen
their credible intervals. φ are the h hyper-parameters, such as the standard deviation σ of the
noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ldbb_bayes.campaign.campaign import CircularTest
from ldbb_bayes.inference.checks import CheckKind, TestChecks, all_checks, failing_checks
from ldbb_bayes.inference.residuals import tests_in_order
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.fourier import MAX_ORDER, basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = ["effects_of_failures"]

# Fourier orders 13 to 16, just above the orders 0 to 12 of the model. The readings at these orders
# show how strong the noise is.
_NEXT_ORDERS = np.arange(MAX_ORDER + 1, MAX_ORDER + 5)
# A combination of these orders counts as part of the orders 0 to 12 if what they leave of it is
# below this fraction of its size on a full circle. On an arc, most combinations are.
_LEAST_LEFT = 0.1


def effects_of_failures(
    bound: BoundModel, phi: Array, checks: Mapping[str, TestChecks]
) -> tuple[dict[str, float], float]:
    """Estimate the effect of failing checks on the parameters and on their credible intervals.

    A failing check shows that the model does not describe the readings of a test well. A check
    fails if its p-value, multiplied by the number of checks, is below 1 %. The result is a tuple of
    two items:

    - a dict with the shifts of parameters. Its keys are the names of the tests that fail the check
      of a Fourier order. The value for a test is the largest change of any parameter when the test
      is left out, in units of the parameter's posterior standard deviation. The dict is empty if no
      check of a Fourier order fails, if the campaign has only one test, or if the prior is flat;
    - the widening of credible intervals, a number. Tests that fail a check of noise or
      autocorrelation may be noisier than modelled. Their noise is estimated from their readings at
      the Fourier orders 13 to 16. The widening is the largest relative increase of the width of a
      credible interval that this noise causes. The widening is 0 if no check of noise or
      autocorrelation fails.

    Both items are computed at one value ``phi`` of the h hyper-parameters (such as the standard
    deviation of the noise), shape (h,). ``checks`` holds the p-values of each test; its keys are
    the names of the tests. ``bound`` is the model of the campaign.
    """
    failing = failing_checks(all_checks(checks))
    of_order = [check.test for check in failing if check.kind == CheckKind.ORDER]
    of_noise = [check.test for check in failing if check.kind != CheckKind.ORDER]
    shift = _shift_without(bound, phi, list(dict.fromkeys(of_order)))
    return shift, _widening_by_noise(bound, phi, of_noise)


def _shift_without(bound: BoundModel, phi: Array, tests: Sequence[str]) -> dict[str, float]:
    """Return how much the parameters change when one test is left out, for each of ``tests``.

    ``tests`` are the names of the tests that are left out one at a time. The result is a dict with
    these names as its keys. The value is the largest change of any parameter, in units of the
    parameter's posterior standard deviation. The changes are computed at one value ``phi``, shape
    (h,), of the h hyper-parameters (such as the standard deviation of the noise). The dict is empty
    if the campaign has one test only or the prior is flat. ``bound`` is the model of the campaign.
    """
    if len(bound.test_names) < 2 or bound.model.prior.flat:
        return {}
    shift: dict[str, float] = {}
    conditional = bound.given(phi[None]).parameters
    for test in tests:
        remaining = bound.keeping([name for name in bound.test_names if name != test])
        change = remaining.given(phi[None]).parameters.mean - conditional.mean
        shift[test] = float((np.abs(change) / conditional.sd).max())
    return shift


def _widening_by_noise(bound: BoundModel, phi: Array, tests: Sequence[str]) -> float:
    """Return the largest relative widening of intervals if some tests are noisier than modelled.

    The intervals are the credible intervals of the parameters. A result of 0.1 means that the most
    affected interval becomes 10 % wider. ``tests`` are the names of the noisier tests. Their noise
    variance is estimated from their readings at the Fourier orders 13 to 16, but is at least the
    noise variance σ² of the model. The noise variance of all other tests is σ². The wider intervals
    are computed with σ² replaced by the mean noise variance of all tests. ``phi``, shape (h,), is
    one value of the h hyper-parameters (such as the standard deviation of the noise). ``bound`` is
    the model of the campaign.
    """
    if not tests:
        return 0.0
    sigma = bound.hyper_prior.names.index("sigma")
    is_noisier = np.isin(bound.test_names, tests)
    measured_ratio = _noise_variance_above_order_12(bound) / phi[sigma] ** 2
    variance_ratio = np.where(is_noisier, np.maximum(measured_ratio, 1.0), 1.0)
    noisy = phi.copy()
    noisy[sigma] *= np.sqrt(variance_ratio.mean())
    variance = information_of(bound, phi).variances()
    variance_with_noise = information_of(bound, noisy).variances()
    return float(np.sqrt((variance_with_noise / variance).max()) - 1.0)


def _noise_variance_above_order_12(bound: BoundModel) -> Array:
    """Estimate the noise variance of each test from its readings at the Fourier orders 13 to 16.

    The variances are in mm², shape (tests,). Deviations that the machine repeats are not noise. The
    mean Fourier coefficients of all tests with the same plane, radius and direction of travel are
    therefore first subtracted. ``bound`` is the model of the campaign.
    """
    setting = bound.setting
    fits = [_coefficients_above_order_12(test) for test in tests_in_order(bound)]
    coefficients = np.array([fit.coefficients for fit in fits])
    mean_square = np.zeros(len(coefficients))
    conditions = list(zip(setting.plane, setting.radius_mm, setting.travel, strict=True))
    for condition in set(conditions):
        tests = [r for r, of_test in enumerate(conditions) if of_test == condition]
        mean_square[tests] = _mean_square_of_scatter(coefficients[tests])
    gain = np.array([fit.noise_gain for fit in fits])
    return np.divide(mean_square, gain, out=np.zeros(len(gain)), where=gain > 0.0)


def _mean_square_of_scatter(coefficients: Array) -> Array:
    """Return the mean square of each test's coefficients, without what the tests repeat.

    ``coefficients``, shape (tests, m), holds m coefficients of every test. Their means over the
    tests are subtracted; of two or more tests, the mean squares are enlarged, because the means
    were computed from the same tests. A single test has nothing to be compared with, and all of its
    coefficients count as scatter. The result has the shape (tests,).
    """
    n = len(coefficients)
    if n == 1:
        return np.asarray(np.mean(coefficients**2, axis=1))
    deviation = coefficients - coefficients.mean(axis=0)
    return np.asarray(np.mean(deviation**2, axis=1) * (n / (n - 1)))


class _FitAboveOrder12(NamedTuple):
    """Fourier coefficients of a test's readings at the orders 13 to 16, and their noise."""

    #: four cosine coefficients of a test's readings, and then four sine coefficients, of the orders
    #: 13 to 16, shape (8,) [mm]
    coefficients: Array
    #: mean variance of the coefficients of the orders 13 to 16 if the readings of a test have white
    #: noise of variance one: 2/n for n readings of a full circle; zero if nothing was fitted
    noise_gain: float


def _coefficients_above_order_12(test: CircularTest) -> _FitAboveOrder12:
    """Return the Fourier coefficients of a test's readings at the orders 13 to 16.

    They are fitted by least squares together with the coefficients of the orders 0 to 12. On an
    arc, the orders 0 to 12 describe nearly all of most combinations of the orders 13 to 16. These
    combinations are left out; otherwise little noise would give large coefficients.
    """
    angle = test.angles_rad()
    turned = np.exp(1j * np.outer(angle, _NEXT_ORDERS))
    lower = np.linalg.qr(basis(angle))[0]
    columns = np.hstack([turned.real, turned.imag])
    columns -= lower @ (lower.T @ columns)
    left, size, right = np.linalg.svd(columns, full_matrices=False)
    is_kept = size > _LEAST_LEFT * np.sqrt(0.5 * len(angle))
    inverse = right[is_kept].T / size[is_kept]
    coefficients = inverse @ (left[:, is_kept].T @ test.readings_mm())
    return _FitAboveOrder12(coefficients, float((inverse**2).sum(axis=1).mean()))
