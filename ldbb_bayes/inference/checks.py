"""Posterior predictive checks: whether the readings look like new circles under the posterior.

The basis consists of the harmonics of a circle at the orders 0 to 12, 25 coefficients in all. φ are
the h hyper-parameters, the scales of the noise and of other effects; σ, one of them, is the
standard deviation of white noise. β are the p parameters: compliances, their slopes and geometric
errors. Shared nuisances are effects that are modelled but not of interest and that several tests
have in common. Draws are random draws from the posterior. Index r counts the tests.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc, ndtr, stdtr

from ldbb_bayes.campaign.campaign import CircularTest
from ldbb_bayes.inference.coefficients import (
    ModelDraws,
    draw_shared_coefficients,
    machine_coefficients,
    private_terms,
)
from ldbb_bayes.inference.residuals import (
    RANK_TOLERANCE,
    harmonics_of,
    reduced_residuals,
    tests_in_order,
)
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.fourier import MAX_ORDER, ORDERS, SIZE, basis, harmonic_index
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array, Result
from ldbb_bayes.units import ranked

__all__ = [
    "SHIFTED",
    "Check",
    "CheckKind",
    "TestChecks",
    "all_checks",
    "autocorrelation",
    "average_checks",
    "centre_shift",
    "check_predictions",
    "effects_of_failures",
    "failing_checks",
    "in_order_of_force",
]

# p-value below which a shift of the circles' centre in proportion to force is reported.
SHIFTED = 0.01
# Largest number of posterior draws from which predictive checks are computed.
_DRAWS = 500
# p-value below which a predictive check fails, after allowing for the number of checks.
_FAILS = 0.01
# Smallest p-value of which a logarithm is taken when predictive checks are ranked.
_SMALLEST_P = 1e-300
# Largest number of readings from which the autocorrelation of the noise is computed.
_LONGEST_STRETCH = 100_000
# A residual is a rounding error if its sum of squares is below this share of the readings' sum of
# squares.
_ROUNDING = 1e-24
# Smallest number of tests in a plane for the check of whether the circles' centre shifts with
# force.
_FEWEST_TESTS = 4
# Smallest number of different forces in a plane for the check of whether the circles' centre shifts
# with force.
_FEWEST_FORCES = 3
# The tests count as run in order of rising or falling force if the p-value of no relation between
# force and time is below this.
_IN_ORDER = 0.05
# Fourier orders 13 to 16, just above those of the model, from which the strength of the noise is
# estimated.
_NEXT_ORDERS = np.arange(MAX_ORDER + 1, MAX_ORDER + 5)


class CheckKind(StrEnum):
    """Property of a circle that a posterior predictive check examines."""

    ORDER = "order"  #: Fourier coefficients of one order, 0 to 12
    NOISE = "noise"  #: scatter of the readings that the orders 0 to 12 do not explain
    AUTOCORRELATION = "autocorrelation"  #: correlation of successive residuals beyond order 12


@dataclass(frozen=True)
class Check:
    """One posterior predictive check of one test."""

    kind: CheckKind
    test: str  #: name of the test that is checked
    p: float  #: p-value of the check
    order: int | None = None  #: Fourier order that is checked; None except for `CheckKind.ORDER`


@dataclass(frozen=True)
class TestChecks(Result):
    """Posterior predictive p-values of one test.

    ``orders_p`` refers to the residual of each Fourier order after the effects of the machine and
    of shared nuisances are subtracted. It is the probability that the residual of a new circle is
    larger, averaged over the posterior. The other p-values are two-sided. They and the
    autocorrelation are None if the test has too few readings.
    """

    __test__ = False

    orders_p: dict[int, float]  #: p-value of each Fourier order, 0 to 12
    #: p-value of the scatter of the readings beyond order 12, against the modelled white noise
    noise_p: float | None
    autocorrelation: float | None  #: correlation of successive residuals beyond order 12
    autocorrelation_p: float | None  #: p-value of ``autocorrelation`` against white noise

    def of(self, test: str) -> list[Check]:
        """Return all p-values as checks, labelled with the name of the test."""
        checks = [Check(CheckKind.ORDER, test, p, order) for order, p in self.orders_p.items()]
        if self.noise_p is not None:
            checks.append(Check(CheckKind.NOISE, test, self.noise_p))
        if self.autocorrelation_p is not None:
            checks.append(Check(CheckKind.AUTOCORRELATION, test, self.autocorrelation_p))
        return checks


def all_checks(checks_by_test: Mapping[str, TestChecks]) -> list[Check]:
    """Return all checks of all tests, the smallest p-value first."""
    checks: list[Check] = []
    for test, test_checks in checks_by_test.items():
        checks += test_checks.of(test)
    return ranked(checks, _surprise)


def _surprise(check: Check) -> float:
    return -math.log(max(check.p, _SMALLEST_P))


def failing_checks(checks: Sequence[Check]) -> tuple[Check, ...]:
    """Return the checks that fail at 1 % after allowing for their number (Bonferroni)."""
    return tuple(check for check in checks if check.p * len(checks) < _FAILS)


def effects_of_failures(
    bound: BoundModel, phi: Array, checks: Mapping[str, TestChecks]
) -> tuple[dict[str, float], float]:
    """Return how much failing checks could change parameters and widen intervals.

    The first result holds, for each test with a failing Fourier order, the largest change of a
    parameter when the test is left out. The change is in units of the parameter's standard
    deviation. The second result is the largest share by which an interval grows if tests with a
    failing check of noise are noisier than modelled. Their noise is taken to be as strong as at the
    orders 13 to 16. Both results are computed at the hyper-parameters φ, shape (h,).
    """
    failing = failing_checks(all_checks(checks))
    of_order = [check.test for check in failing if check.kind == CheckKind.ORDER]
    of_noise = [check.test for check in failing if check.kind != CheckKind.ORDER]
    shift = _shift_without(bound, phi, list(dict.fromkeys(of_order)))
    return shift, _widening_by_noise(bound, phi, of_noise)


def _shift_without(bound: BoundModel, phi: Array, tests: Sequence[str]) -> dict[str, float]:
    """Return, for each test, the largest change of a parameter when the test is left out.

    The change is in units of the parameter's posterior standard deviation, at the hyper-parameters
    φ, shape (h,).
    """
    if len(bound.test_names) < 2 or bound.model.prior.flat:
        return {}
    shift: dict[str, float] = {}
    conditional = bound.given(phi[None])[1]
    for test in tests:
        remaining = bound.keeping([name for name in bound.test_names if name != test])
        change = remaining.given(phi[None])[1].mean - conditional.mean
        shift[test] = float((np.abs(change) / conditional.sd).max())
    return shift


def _widening_by_noise(bound: BoundModel, phi: Array, tests: Sequence[str]) -> float:
    """Return the largest share by which an interval grows if the tests named are noisier.

    Their noise is taken to be as strong as at the Fourier orders 13 to 16, if that exceeds the
    modelled noise. ``phi`` are the hyper-parameters, shape (h,).
    """
    sigma = bound.hyper_prior.names.index("sigma")
    fails = np.isin(bound.test_names, tests)
    power = np.ones(1)
    if fails.any():
        excess = np.maximum(_power_beyond(bound) / phi[sigma] ** 2, 1.0)
        power = np.where(fails, excess, 1.0)
    noisy = phi.copy()
    noisy[sigma] *= np.sqrt(power.mean())
    variance = information_of(bound, phi).variances()
    variance_with_noise = information_of(bound, noisy).variances()
    return float(np.sqrt((variance_with_noise / variance).max()) - 1.0)


def _power_beyond(bound: BoundModel) -> Array:
    """Return, for each test, the variance of white noise that explains orders 13 to 16 [mm²].

    The mean over tests of the same plane, radius and direction of travel is subtracted first: a
    pattern of the machine is no noise.
    """
    setting = bound.setting
    waves = np.array([_waves_beyond(test) for test in tests_in_order(bound)])
    power = np.zeros(len(waves))
    kinds = list(zip(setting.plane, setting.radius_mm, setting.travel, strict=True))
    for kind in set(kinds):
        tests = [r for r, other in enumerate(kinds) if other == kind]
        deviation = waves[tests]
        freedom = len(tests)
        if len(tests) > 1:
            deviation = deviation - deviation.mean(axis=0)
            freedom = len(tests) - 1
        power[tests] = np.mean(deviation**2, axis=1) * (len(tests) / freedom)
    return power * np.array([reduced.readings for reduced in bound.reduced]) / 2.0


def _waves_beyond(test: CircularTest) -> Array:
    """Return the Fourier coefficients of a test's readings at the orders 13 to 16 [mm].

    They are fitted by least squares, together with those of the orders 0 to 12.
    """
    angle = test.angles_rad()
    turned = np.exp(1j * np.outer(angle, _NEXT_ORDERS))
    columns = np.column_stack([basis(angle), turned.real, turned.imag])
    return np.linalg.lstsq(columns, test.readings_mm(), rcond=RANK_TOLERANCE)[0][SIZE:]


def centre_shift(bound: BoundModel, beta: Array) -> dict[str, float]:
    """Return the machine axes along which the circles' centre shifts in proportion to force.

    The shift that the p parameters ``beta``, shape (p,), explain is subtracted first. The result
    maps each axis to the p-value of no shift: Student's t-test of the slope of order 1 over force.
    It holds the axes that are significant at 1 % after allowing for their number. Only planes with
    at least four tests at three forces are checked.
    """
    residuals = reduced_residuals(bound, machine_coefficients(bound, beta[None])[0])
    harmonics = [harmonics_of(bound, r) @ residual for r, residual in enumerate(residuals)]
    p_values: dict[str, float] = {}
    for plane, _, in_plane in bound.setting.each("plane"):
        force = bound.setting.force_N[in_plane]
        if len(force) < _FEWEST_TESTS or len(np.unique(force)) < _FEWEST_FORCES:
            continue
        for axis, k in zip(PLANES[plane], harmonic_index(1), strict=False):
            centre = np.array([harmonics[r][k] for r in np.flatnonzero(in_plane)])
            p_values[axis] = _p_value_of_no_slope(force, centre)
    return {axis: p for axis, p in p_values.items() if p * len(p_values) < SHIFTED}


def in_order_of_force(bound: BoundModel) -> bool:
    """Return whether the tests of any plane ran in order of rising or falling force.

    A steady drift would then look like a change with force. The ranks of force and time are
    compared by Student's t-test at 5 %. Unless all tests have a time, they are taken to have run in
    the order listed.
    """
    setting = bound.setting
    time = setting.time_h
    if not np.isfinite(time).all():
        time = np.arange(setting.tests)
    force_rank = _ranks(setting.force_N)
    time_rank = _ranks(time)
    for _, _, in_plane in setting.each("plane"):
        force = force_rank[in_plane]
        if np.ptp(force) > 0.0 and _p_value_of_no_slope(force, time_rank[in_plane]) < _IN_ORDER:
            return True
    return False


def _ranks(values: Array) -> Array:
    return np.unique(values, return_inverse=True)[1].astype(float)


def _p_value_of_no_slope(force: Array, values: Array) -> float:
    """Return the two-sided p-value of the hypothesis that values have no slope over force."""
    lever = force - force.mean()
    freedom = max(len(force) - 2, 1)
    slope = lever @ values / (lever @ lever)
    residual = values - values.mean() - slope * lever
    slope_sd = np.sqrt(residual @ residual / freedom / (lever @ lever))
    return float(2.0 * stdtr(freedom, -abs(slope) / max(slope_sd, _SMALLEST_P)))


def check_predictions(
    bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator
) -> dict[str, TestChecks]:
    """Return the checks of every test against new circles under the posterior, by test.

    Draws of the hyper-parameters φ [mm] have the shape (draws, h), those of the parameters β the
    shape (draws, p).
    """
    draws = ModelDraws(bound, phi, beta).thinned(_DRAWS)
    shared = draw_shared_coefficients(bound, draws.phi, draws.beta, rng)
    sigma = draws.phi[:, bound.hyper_prior.names.index("sigma")]
    checks = {}
    for r, test in enumerate(tests_in_order(bound)):
        orders_p = _p_values_of_orders(draws, r, shared[:, r], sigma)
        reduced = bound.reduced[r]
        outside = reduced.readings - SIZE
        if outside > 0:
            tail = chdtrc(outside, reduced.residual_ss / sigma**2).mean()
            noise_p = float(2.0 * min(tail, 1.0 - tail))
            correlation, correlation_p = autocorrelation(test)
            checks[str(test.name)] = TestChecks(orders_p, noise_p, correlation, correlation_p)
        else:
            checks[str(test.name)] = TestChecks(orders_p, None, None, None)
    return checks


def _p_values_of_orders(draws: ModelDraws, r: int, shared: Array, sigma: Array) -> dict[int, float]:
    """Return the p-value of the residual of test r at every Fourier order.

    The residual is the part of the readings that the machine and the shared nuisances do not
    explain. It is compared with the scatter to expect from reading noise and from effects that act
    on one test only.

    Parameters
    ----------
    draws
        Posterior draws of one model.
    r
        Index of the test.
    shared
        Fourier coefficients that machine and shared nuisances predict in every draw, shape (draws,
        25).
    sigma
        Standard deviation σ of white noise in every draw, shape (draws,) [mm].
    """
    reduced = draws.bound.reduced[r]
    to_harmonics = harmonics_of(draws.bound, r)
    residual = (np.asarray(reduced.projection) - shared @ reduced.factor.T) @ to_harmonics.T
    basis_to_harmonics = to_harmonics @ reduced.factor
    columns = [to_harmonics]
    sd = [np.tile(sigma[:, None], to_harmonics.shape[1])]
    for term in private_terms(draws.bound, draws.phi, r):
        columns.append(basis_to_harmonics @ term.columns)
        sd.append(term.sd)
    expected = _Scatter(np.concatenate(columns, axis=1), np.concatenate(sd, axis=1))
    p_values = {}
    for order in range(MAX_ORDER + 1):
        at_order = order == ORDERS
        of_order = _Scatter(expected.columns[at_order], expected.sd)
        p_values[order] = _mean_tail_probability(residual[:, at_order], of_order)
    return p_values


class _Scatter(NamedTuple):
    """Covariance C S² Cᵀ of k residuals that v independent sources cause, for every draw."""

    columns: Array  #: effects C of the sources on the residuals, shape (k, v)
    sd: Array  #: standard deviations of the sources, the diagonal of S, shape (draws, v)


def _mean_tail_probability(residual: Array, scatter: _Scatter) -> float:
    """Return the mean over draws of P(χ² ≥ rᵀ V⁻¹ r), a p-value of residuals.

    r is the residual of a draw, of k elements, and V its covariance from ``scatter``.
    """
    columns = scatter.columns
    covariance = np.einsum("iv,jv,wv->wij", columns, columns, scatter.sd**2)
    solved = np.linalg.solve(covariance, residual[..., None])[..., 0]
    square = np.einsum("wi,wi->w", residual, solved)
    return float(chdtrc(residual.shape[1], square).mean())


def average_checks(
    shares: Array, checks_by_model: Sequence[Mapping[str, TestChecks]]
) -> dict[str, TestChecks]:
    """Return the checks of several models, averaged with the weights ``shares`` of the models."""
    averaged = {}
    for name, first in checks_by_model[0].items():
        of_test = [checks[name] for checks in checks_by_model]
        orders_p = {}
        for order in first.orders_p:
            orders_p[order] = float(np.dot(shares, [checks.orders_p[order] for checks in of_test]))
        noise_p = None
        if first.noise_p is not None:
            noise_p = float(np.dot(shares, [checks.noise_p or 0.0 for checks in of_test]))
        averaged[name] = TestChecks(
            orders_p, noise_p, first.autocorrelation, first.autocorrelation_p
        )
    return averaged


def autocorrelation(test: CircularTest) -> tuple[float, float]:
    """Return the lag-one autocorrelation of the readings beyond order 12, and its p-value.

    The p-value is two-sided against white noise. For the n readings of white noise the
    autocorrelation has the mean tr(M S) / tr(M) and a variance of about 1/n. The matrix M, shape
    (n, n), removes the Fourier orders 0 to 12 from the readings; S, shape (n, n), shifts them to
    the next reading. If there are very many readings, only the first ones in angle are used.
    """
    order = np.argsort(test.angle_deg, kind="stable")[:_LONGEST_STRETCH]
    angle = test.angles_rad()[order]
    reading = test.readings_mm()[order]
    columns = np.linalg.qr(basis(angle))[0]
    residual = reading - columns @ (columns.T @ reading)
    square = float(residual @ residual)
    if square <= _ROUNDING * float(reading @ reading):
        return 0.0, 1.0
    n = len(residual)
    expected = -float((columns[1:] * columns[:-1]).sum()) / (n - SIZE)
    value = float(residual[1:] @ residual[:-1]) / square
    return value, float(2.0 * ndtr(-abs(value - expected) * np.sqrt(n)))
