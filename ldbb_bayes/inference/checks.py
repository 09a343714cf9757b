"""Posterior predictive checks: whether the posterior expects the readings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

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
    "Check",
    "CheckKind",
    "SHIFTED",
    "TestChecks",
    "autocorrelation",
    "averaged_checks",
    "centre_shift",
    "effects",
    "every_check",
    "failing",
    "in_order_of_force",
    "predictive_checks",
]

_DRAWS = 500
_STRETCH = 100_000
SHIFTED = 0.01
_FAILS = 0.01
_SMALLEST = 1e-300
_FEWEST_SHIFTED = 4
_IN_ORDER = 0.05


class CheckKind(StrEnum):
    """What a posterior predictive check looks at: an order of the circle, the scatter beyond the
    orders, its correlation."""

    ORDER = "order"
    NOISE = "noise"
    AUTOCORRELATION = "autocorrelation"


@dataclass(frozen=True)
class Check:
    """One posterior predictive p-value; ``order`` is None but for `CheckKind.ORDER`."""

    kind: CheckKind
    test: str
    p: float
    order: int | None = None


@dataclass(frozen=True)
class TestChecks(Result):
    """Posterior predictive p-values of one test; None where it has too few readings.

    Of the residual at order n = 0 … 12 after machine and shared nuisances: the probability that a
    new circle lies further out, averaged over the posterior. Of the others two-sided.
    """

    __test__ = False

    orders_p: dict[int, float]
    noise_p: float | None  #: of the readings' scatter outside orders 0 … 12 against σ
    autocorrelation: float | None
    autocorrelation_p: float | None  #: of its lag-one autocorrelation against white noise

    def of(self, test: str) -> list[Check]:
        """Every p-value there is as a check of this test."""
        others = (
            (CheckKind.NOISE, self.noise_p),
            (CheckKind.AUTOCORRELATION, self.autocorrelation_p),
        )
        orders = [Check(CheckKind.ORDER, test, p, n) for n, p in self.orders_p.items()]
        return orders + [Check(kind, test, p) for kind, p in others if p is not None]


def every_check(checks: Mapping[str, TestChecks]) -> list[Check]:
    """All checks of all tests, the smallest p first."""
    every = [check for name, own in checks.items() for check in own.of(name)]
    return ranked(every, lambda check: -math.log(max(check.p, _SMALLEST)))


def failing(checks: Sequence[Check]) -> tuple[Check, ...]:
    """Those that fail at 1 % after allowing for their number (Bonferroni)."""
    return tuple(check for check in checks if check.p * len(checks) < _FAILS)


def effects(
    bound: BoundModel, phi: Array, checks: Mapping[str, TestChecks]
) -> tuple[dict[str, float], float]:
    """What failing checks would do to the intervals at φ (h,): of tests with a failing order the
    largest change of a parameter, in its sd, when the test is left out; and the share by which an
    interval grows with the noise next to the basis elsewhere."""
    found = failing(every_check(checks))
    names = dict.fromkeys(check.test for check in found if check.kind == CheckKind.ORDER)
    given = bound.given(phi[None])[1]
    shift = dict[str, float]()
    for name in names if len(bound.test_names) > 1 and not bound.model.prior.flat else ():
        rest = bound.keeping([other for other in bound.test_names if other != name])
        shift[name] = float((np.abs(rest.given(phi[None])[1].mean - given.mean) / given.sd).max())
    sigma = bound.hyper_prior.names.index("sigma")
    noisy = phi.copy()
    fails = np.isin(
        bound.test_names, [check.test for check in found if check.kind != CheckKind.ORDER]
    )
    power = (
        np.where(fails, np.maximum(_power_beyond(bound) / phi[sigma] ** 2, 1.0), 1.0)
        if fails.any()
        else np.ones(1)
    )
    noisy[sigma] *= np.sqrt(power.mean())
    before, after = (information_of(bound, own).variances() for own in (phi, noisy))
    return shift, float(np.sqrt((after / before).max()) - 1.0)


def _power_beyond(bound: BoundModel) -> Array:
    """Variance [mm²] of white noise as strong as what the readings of each test have at the orders
    13 to 16, next to those of the basis, but for what tests of one plane, radius and direction
    share there: a pattern of the machine is no noise."""
    setting = bound.setting
    orders = np.arange(MAX_ORDER + 1, MAX_ORDER + 5)
    waves = []
    for test in tests_in_order(bound):
        angle = test.angles_rad()
        turned = np.exp(1j * np.outer(angle, orders))
        columns = np.column_stack([basis(angle), turned.real, turned.imag])
        waves.append(np.linalg.lstsq(columns, test.readings_mm(), rcond=RANK_TOLERANCE)[0][SIZE:])
    power = np.zeros(len(waves))
    kinds = list(zip(setting.plane, setting.radius_mm, setting.travel, strict=True))
    for kind in set(kinds):
        alike = [r for r, other in enumerate(kinds) if other == kind]
        each = np.array(waves)[alike]
        many = len(alike) > 1
        power[alike] = np.mean((each - many * each.mean(axis=0)) ** 2, axis=1) * (
            len(alike) / (len(alike) - many)
        )
    return power * np.array([test.readings for test in bound.reduced]) / 2.0


def centre_shift(bound: BoundModel, beta: Array) -> dict[str, float]:
    """Axes along which the circles' centre shifts in proportion to force, beyond what the machine β
    (p,) does, and the p-value of no such shift, at 1 % after allowing for the axes' number:
    Student's t of the slope of order 1 over force. For planes of at least four tests at three
    forces."""
    misfits = reduced_residuals(bound, machine_coefficients(bound, beta[None])[0])
    rest = [harmonics_of(bound, r) @ misfit for r, misfit in enumerate(misfits)]
    found: dict[str, float] = {}
    for plane, _, own in bound.setting.each("plane"):
        force = bound.setting.force_N[own]
        if len(force) < _FEWEST_SHIFTED or len(np.unique(force)) < _FEWEST_SHIFTED - 1:
            continue
        for axis, k in zip(PLANES[plane], harmonic_index(1), strict=False):
            found[axis] = _p_value_of_no_slope(
                force, np.array([rest[r][k] for r in np.flatnonzero(own)])
            )
    return {axis: p for axis, p in found.items() if p * len(found) < SHIFTED}


def in_order_of_force(bound: BoundModel) -> bool:
    """Whether the tests of a plane ran in an order of force, so that a steady drift passes for a
    change with force: Student's t of the ranks at 5 %. Where not every test has a time, they ran as
    listed."""
    time = (
        bound.setting.time_h
        if np.isfinite(bound.setting.time_h).all()
        else np.arange(bound.setting.tests)
    )
    ranks = [
        np.unique(values, return_inverse=True)[1].astype(float)
        for values in (bound.setting.force_N, time)
    ]
    pairs = [[rank[own] for rank in ranks] for _, _, own in bound.setting.each("plane")]
    return any(
        np.ptp(force) > 0.0 and _p_value_of_no_slope(force, order) < _IN_ORDER
        for force, order in pairs
    )


def _p_value_of_no_slope(force: Array, values: Array) -> float:
    """The p-value of no slope of values over force."""
    lever = force - force.mean()
    freedom = max(len(force) - 2, 1)
    slope = lever @ values / (lever @ lever)
    left = values - values.mean() - slope * lever
    spread = np.sqrt(left @ left / freedom / (lever @ lever))
    return float(2.0 * stdtr(freedom, -abs(slope) / max(spread, 1e-300)))


def predictive_checks(
    bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator
) -> dict[str, TestChecks]:
    """Compare every test with new circles under the posterior, φ (draws, h) [mm] and β (draws,
    p)."""
    _, phi, beta = ModelDraws(bound, phi, beta).thinned(_DRAWS)
    shared = draw_shared_coefficients(bound, phi, beta, rng)
    sigma = phi[:, bound.hyper_prior.names.index("sigma")]
    checks = {}
    for r, (test, reduced) in enumerate(zip(tests_in_order(bound), bound.reduced, strict=True)):
        inverse = harmonics_of(bound, r)
        residual = (np.asarray(reduced.projection) - shared[:, r] @ reduced.factor.T) @ inverse.T
        seen = inverse @ reduced.factor
        noise = (inverse, np.tile(sigma[:, None], inverse.shape[1]))
        parts = [noise, *((seen @ columns, sd) for columns, sd in private_terms(bound, phi, r))]
        columns, sd = (np.concatenate(own, axis=1) for own in zip(*parts, strict=True))
        orders = {
            n: _tail(residual[:, n == ORDERS], columns[n == ORDERS], sd)
            for n in range(MAX_ORDER + 1)
        }
        outside = reduced.readings - SIZE
        noise_p = correlation = correlation_p = None
        if outside > 0:
            tail = chdtrc(outside, reduced.residual_ss / sigma**2).mean()
            noise_p = float(2.0 * min(tail, 1.0 - tail))
            correlation, correlation_p = autocorrelation(test)
        checks[str(test.name)] = TestChecks(orders, noise_p, correlation, correlation_p)
    return checks


def averaged_checks(
    share: Array, checks: Sequence[Mapping[str, TestChecks]]
) -> dict[str, TestChecks]:
    """The checks of several models, averaged with these shares."""
    averaged = {}
    for name, first in checks[0].items():
        every = [own[name] for own in checks]
        orders = {
            n: float(np.dot(share, [own.orders_p[n] for own in every])) for n in first.orders_p
        }
        noise_p = (
            None
            if first.noise_p is None
            else float(np.dot(share, [own.noise_p or 0.0 for own in every]))
        )
        averaged[name] = TestChecks(orders, noise_p, first.autocorrelation, first.autocorrelation_p)
    return averaged


def autocorrelation(test: CircularTest) -> tuple[float, float]:
    """Lag-one autocorrelation of the readings after orders 0 … 12 are taken out, and its two-sided
    p-value under white noise.

    Under white noise it has mean tr(M S) / tr(M) and nearly variance 1/n, M the projection off the
    basis, S the shift to the next reading. Of very many readings, a stretch is looked at.
    """
    order = np.argsort(test.angle_deg, kind="stable")[:_STRETCH]
    angle = test.angles_rad()[order]
    reading = test.readings_mm()[order]
    columns = np.linalg.qr(basis(angle))[0]
    rest = reading - columns @ (columns.T @ reading)
    square = float(rest @ rest)
    if square <= 1e-24 * float(reading @ reading):
        return 0.0, 1.0
    n = len(rest)
    expected = -float((columns[1:] * columns[:-1]).sum()) / (n - SIZE)
    value = float(rest[1:] @ rest[:-1]) / square
    return value, float(2.0 * ndtr(-abs(value - expected) * np.sqrt(n)))


def _tail(residual: Array, columns: Array, sd: Array) -> float:
    """Mean over the draws of P(χ² ≥ rᵀ V⁻¹ r), r (draws, k), V = C S² Cᵀ, C (k, v), S (draws,
    v)."""
    covariance = np.einsum("iv,jv,wv->wij", columns, columns, sd**2)
    square = np.einsum(
        "wi,wi->w", residual, np.linalg.solve(covariance, residual[..., None])[..., 0]
    )
    return float(chdtrc(residual.shape[1], square).mean())
