"""What the posterior predicts for the circles, and whether it expects the readings.

Three predictions are never mixed up. Machine: H β. Shared: plus ball form, bar length, mount and
force error; RMSE and fitness (Eq. 34-35) are of this one. New circle: plus set-up shift,
discrepancy and white noise, drawn anew. Beside them the paper's own estimate and prediction (Eq.
31): least squares of readings on the hybrid Jacobian, whose uncertainty knows of white noise alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.special import chdtrc, ndtr, stdtr

from ldbb_bayes.campaign.campaign import Campaign, CircularTest, check_campaign
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.inference.integrals import CHUNK
from ldbb_bayes.inference.nodes import Nodes
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.model.fourier import MAX_ORDER, ORDERS, SIZE, basis, harmonic_index
from ldbb_bayes.model.hybrid import BoundModel, HybridModel, information_of
from ldbb_bayes.model.terms import BasisNoise, Columns, JointLoad
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, ByRow, Numbers, Result, readable
from ldbb_bayes.units import ranked

__all__ = [
    "SHIFTED",
    "Check",
    "CheckKind",
    "FitQuality",
    "LeastSquares",
    "Part",
    "TestChecks",
    "autocorrelation",
    "averaged_checks",
    "band_um",
    "centre_shift",
    "compliance_curves",
    "draw_shared",
    "effects",
    "every_check",
    "failing",
    "fit_quality",
    "harmonics_of",
    "in_order_of_force",
    "least_squares",
    "machine_coefficients",
    "new_circle_coefficients",
    "predictive_checks",
    "quality_of",
    "replicate_left_out",
    "residuals_mm",
    "shared_coefficients",
    "shared_columns",
    "shared_terms",
]

_DRAWS = 500
_RANK = 1e-6
_STRETCH = 100_000
SHIFTED = 0.01
_FAILS = 0.01
_SMALLEST = 1e-300
_FEWEST_SHIFTED = 4
_IN_ORDER = 0.05


class Part(NamedTuple):
    """A bound model and its draws of φ, shape (n, h) [mm], and β, shape (n, p): those of one model
    where several are averaged."""

    bound: BoundModel
    phi: Array
    beta: Array

    def few(self, most: int) -> Part:
        """The same with so many draws at most, evenly picked."""
        pick = np.linspace(0, len(self.phi) - 1, min(most, len(self.phi))).astype(int)
        return Part(self.bound, self.phi[pick], self.beta[pick])


def machine_coefficients(bound: BoundModel, beta: Array) -> Array:
    """Basis coefficients of H β plus the nominal mount deflection, shape (draws, tests, 25)
    [mm]."""
    return np.einsum("tkp,wp->wtk", bound.interest, beta) + bound.known_offset


def shared_terms(
    columns: Iterable[Columns | BasisNoise], *, private: bool = False
) -> list[Columns]:
    """Those of the nuisances' columns whose coefficients tests share; or that every test has for
    itself."""
    return [term for term in columns if isinstance(term, Columns) and term.private == private]


def shared_columns(bound: BoundModel, *, private: bool = False) -> Array:
    """The same side by side, shape (tests, 25, q) [mm]."""
    values = [term.values for term in shared_terms(bound.nuisance_columns, private=private)]
    return np.concatenate([np.zeros((len(bound.test_names), SIZE, 0)), *values], axis=2)


def draw_shared(bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator) -> Array:
    """One draw of the shared nuisance coefficients given each β, φ and y, shape (draws, q)."""
    parts = [slice(start, start + CHUNK) for start in range(0, len(phi), CHUNK)]
    return np.concatenate(
        [
            bound.given_interest.conditional(phi[i], beta[i] - bound.centre)[1].draw(rng)
            for i in parts
        ]
    )


def compliance_curves(
    bound: BoundModel, phi: Array, beta: Array, force_N: Array, rng: np.random.Generator
) -> Array:
    """C(F) of every kept compliance at forces (n,), shape (draws, n, compliances): C and its
    slopes; of an axis, its deflection over a bar force along it, also what `JointLoad` adds, drawn
    given each β, φ and y."""
    curves = np.einsum(
        "fcp,wp->wfc", np.stack([bound.compliance_at(force) for force in force_N]), beta
    )
    term = next((term for term in bound.model.nuisances if isinstance(term, JointLoad)), None)
    if term is not None:
        names = [name for part in shared_terms(bound.nuisance_columns) for name in part.names]
        drawn = draw_shared(bound, phi, beta, rng)
        secants = term.secants(bound.setting, force_N)
        for j, own in enumerate(bound.compliances):
            along = [
                k
                for k, name in enumerate(names)
                if own.kind == "direct" and name.startswith(f"joint_load_{own.twist}_")
            ]
            curves[:, :, j] += drawn[:, along] @ secants[:, : len(along)].T
    return np.asarray(curves)


def shared_coefficients(bound: BoundModel, phi: Array, beta: Array) -> Array:
    """Machine plus the expected ball form, bar length, mount and force error given β, φ and y;
    (draws, tests, 25) [mm]."""
    shifted = beta - bound.centre
    mean = bound.given_interest.conditional(phi, shifted)[1].mean
    total = machine_coefficients(bound, beta) + np.einsum(
        "tkq,wq->wtk", shared_columns(bound), mean
    )
    private = shared_columns(bound, private=True)
    if not private.size:
        return np.asarray(total)
    own = bound.given_interest.private_mean(phi, shifted, mean)[:, :, : private.shape[2]]
    return np.asarray(total + np.einsum("tkv,wtv->wtk", private, own))


def new_circle_coefficients(
    bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator
) -> Array:
    """A new circle in the place of every test, white noise aside: shared nuisances drawn from their
    posterior, force error, set-up shift and discrepancy drawn anew; (draws, tests, 25) [mm]."""
    shared = _shared_drawn(bound, phi, beta, rng)
    return shared + np.stack(
        [draw_of_circle(bound, phi, r, rng) for r in range(len(bound.test_names))], axis=1
    )


def _shared_drawn(bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator) -> Array:
    drawn = draw_shared(bound, phi, beta, rng)
    return np.asarray(
        machine_coefficients(bound, beta) + np.einsum("tkq,wq->wtk", shared_columns(bound), drawn)
    )


def draw_of_circle(bound: BoundModel, phi: Array, r: int, rng: np.random.Generator) -> Array:
    """Fresh draws of what circle r has for itself: random force error, set-up shift, discrepancy;
    (draws, 25) [mm]."""
    total = np.zeros((len(phi), SIZE))
    for columns, sd in _own(bound, phi, r):
        total = total + (sd * rng.standard_normal(sd.shape)) @ columns.T
    return total


def _own(bound: BoundModel, phi: Array, r: int) -> Iterator[tuple[Array, Array]]:
    """Columns (25, v) of what circle r has for itself, and the sd of their coefficients (draws,
    v)."""
    value = dict(zip(bound.hyper_prior.names, phi.T, strict=True))
    for term in bound.nuisance_columns:
        if isinstance(term, BasisNoise):
            yield np.eye(SIZE), term.sd_at(value, r)
        elif term.private:
            yield term.values[r], np.broadcast_to(term.sd_at(value), (len(phi), len(term.names)))


def new_circles(part: Part, plan: Campaign, rng: np.random.Generator) -> Iterator[Array]:
    """Readings (draws, n) [mm] of each planned test in turn, one circle for every draw."""
    bound = part.bound
    beta = part.beta
    measured, planned = _beside(bound, plan)
    names = planned.hyper_prior.names
    phi = planned.hyper_prior.draw(len(beta), rng)
    for j, name in enumerate(bound.hyper_prior.names):
        phi[:, names.index(name)] = part.phi[:, j]
    value = dict(zip(names, phi.T, strict=True))
    learnt = [name for term in shared_terms(measured.nuisance_columns) for name in term.names]
    drawn = draw_shared(measured, phi, beta, rng)
    total = machine_coefficients(planned, beta)
    for term in shared_terms(planned.nuisance_columns):
        own = term.sd_at(value) * rng.standard_normal((len(beta), len(term.names))) + (
            0.0 if term.mean is None else term.mean
        )
        for j, name in enumerate(term.names):
            if name in learnt:
                own[:, j] = drawn[:, learnt.index(name)]
        total = total + np.einsum("tkq,wq->wtk", term.values, own)
    for r, test in enumerate(plan.tests):
        own = total[:, r] + draw_of_circle(planned, phi, r, rng)
        yield readings_drawn(own, value["sigma"], test.angles_rad(), rng)


def readings_drawn(
    coefficients: Array, sigma_mm: Array, angle_rad: Array, rng: np.random.Generator
) -> Array:
    """Readings (draws, n) [mm] of circles (draws, 25) with white noise (draws,)."""
    smooth = coefficients @ basis(angle_rad).T
    return np.asarray(smooth + sigma_mm[:, None] * rng.standard_normal(smooth.shape))


def _beside(bound: BoundModel, plan: Campaign) -> tuple[BoundModel, BoundModel]:
    """The tests measured and those planned as one campaign's: with both balls' forms, all radii and
    directions of either."""
    campaign = bound.campaign
    model = bound.model
    machines = [(one.topology, dict(one.frames_mm)) for one in (campaign, plan)]
    got = f"got {machines[1][0]}. Make the plan with the campaign's topology and frames."
    require(
        machines[0] == machines[1],
        f"the plan must be of the posterior's machine {machines[0][0]}, its frames too, {got}",
    )
    new = tuple(replace(test.with_reading_um(None), name="") for test in plan.tests)
    union = replace(campaign, tests=(*campaign.plan().tests, *new))
    model = model if bound.setting.circle[0] else model.without("circle-scale")
    whole = BoundModel(model, union, pilot=campaign)
    other = sorted(set(whole.names) ^ set(bound.names))
    cure = "Fit with replace(campaign, foreseen=plan.tests), so that the model knows of them."
    require(
        not other,
        f"the plan must show only what the fit has, got planes or set-ups with {', '.join(other)}"
        f" too. {cure}",
    )
    names = [test.name for test in union.tests]
    run = len(campaign.tests)
    measured = whole.keeping(names[:run])
    measured.reduced = bound.reduced
    return measured, whole.keeping(names[run:])


def replicate_left_out(
    bound: BoundModel,
    others: Nodes,
    name: str,
    size: int,
    rng: np.random.Generator,
    *,
    each: int = 1,
) -> Array:
    """Least-squares harmonics of circles that the others expect in the place of a test of
    ``bound``, shape (size, 25) [mm]; so many of each posterior draw."""
    r = bound.test_names.index(name)
    beta, phi = others.draw(-(-size // each), rng)
    machine = beta @ bound.interest[r].T + bound.known_offset[r]
    machine = machine + draw_shared(others.bound, phi, beta, rng) @ shared_columns(bound)[r].T
    machine = np.repeat(machine, each, axis=0)[:size]
    phi = np.repeat(phi, each, axis=0)[:size]
    factor = bound.reduced[r].factor
    noise = phi[:, [bound.hyper_prior.names.index("sigma")]] * rng.standard_normal(
        (size, len(factor))
    )
    circle = (machine + draw_of_circle(bound, phi, r, rng)) @ factor.T + noise
    return np.asarray(circle @ harmonics_of(bound, r).T)


def band_um(
    coefficients: Array,
    sigma_mm: Array,
    angle_rad: Array,
    rng: np.random.Generator,
    *,
    prob: float = 0.95,
) -> Array:
    """Equal-tailed pointwise band of readings, white noise included: (2, angles) [µm] from (draws,
    25) and (draws,)."""
    readings = readings_drawn(coefficients, sigma_mm, angle_rad, rng)
    return np.quantile(readings, [(1.0 - prob) / 2.0, (1.0 + prob) / 2.0], axis=0) * 1e3


def residuals_mm(bound: BoundModel, predicted: Array) -> list[Array]:
    """Reading minus prediction of every test, each of shape (n,) [mm]; predicted (tests, 25)."""
    return [
        test.readings_mm() - basis(test.angles_rad()) @ own
        for test, own in zip(_tests(bound), predicted, strict=True)
    ]


def _misfits(bound: BoundModel, predicted: Array) -> list[Array]:
    """Reduced readings minus prediction, each of shape (m,) [mm]."""
    return [
        np.asarray(test.projection) - test.factor @ own
        for test, own in zip(bound.reduced, predicted, strict=True)
    ]


def harmonics_of(bound: BoundModel, r: int) -> Array:
    """Least-squares harmonics from the reduced readings of test r, shape (25, m); minimum norm
    where readings are too few."""
    return np.asarray(np.linalg.pinv(bound.reduced[r].factor, rcond=_RANK))


def _tests(bound: BoundModel) -> list[CircularTest]:
    """The tests of a bound model, in its order."""
    by_name = {test.name: test for test in bound.campaign.tests}
    return [by_name[name] for name in bound.test_names]


@dataclass(frozen=True)
class FitQuality:
    """Root mean square error over all readings and by test [µm], and fitness by test [%] (Eq.
    34-35)."""

    rmse_um: float
    rmse_by_test_um: dict[str, float]
    fitness_percent: dict[str, float]


def fit_quality(bound: BoundModel, phi: Array, beta: Array) -> FitQuality:
    """RMSE and fitness of the posterior mean prediction, machine plus shared nuisances, from φ
    (draws, h) [mm], β (draws, p)."""
    return quality_of(bound, shared_coefficients(bound, phi, beta).mean(axis=0))


def quality_of(bound: BoundModel, predicted: Array) -> FitQuality:
    """The same of a prediction, basis coefficients (tests, 25) [mm]."""
    misfits = _misfits(bound, predicted)
    squares = np.array(
        [m @ m + test.residual_ss for m, test in zip(misfits, bound.reduced, strict=True)]
    )
    n = np.array([test.readings for test in bound.reduced])
    rmse = np.sqrt(squares / n) * 1e3
    spans = [float(np.ptp(test.readings_mm())) for test in _tests(bound)]
    fitness = [
        100.0 * (1.0 - e * 1e-3 / span) if span > 0 else np.nan
        for e, span in zip(rmse, spans, strict=True)
    ]
    by_test, fit = (
        dict(zip(bound.test_names, map(float, values), strict=True)) for values in (rmse, fitness)
    )
    return FitQuality(float(np.sqrt(squares.sum() / n.sum()) * 1e3), by_test, fit)


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
    for test in _tests(bound):
        angle = test.angles_rad()
        turned = np.exp(1j * np.outer(angle, orders))
        columns = np.column_stack([basis(angle), turned.real, turned.imag])
        waves.append(np.linalg.lstsq(columns, test.readings_mm(), rcond=_RANK)[0][SIZE:])
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
    misfits = _misfits(bound, machine_coefficients(bound, beta[None])[0])
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
    _, phi, beta = Part(bound, phi, beta).few(_DRAWS)
    shared = _shared_drawn(bound, phi, beta, rng)
    sigma = phi[:, bound.hyper_prior.names.index("sigma")]
    checks = {}
    for r, (test, reduced) in enumerate(zip(_tests(bound), bound.reduced, strict=True)):
        inverse = harmonics_of(bound, r)
        residual = (np.asarray(reduced.projection) - shared[:, r] @ reduced.factor.T) @ inverse.T
        seen = inverse @ reduced.factor
        noise = (inverse, np.tile(sigma[:, None], inverse.shape[1]))
        parts = [noise, *((seen @ columns, sd) for columns, sd in _own(bound, phi, r))]
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


_SINGULAR = 1e-10


@dataclass(frozen=True, eq=False)
class LeastSquares(Result):
    """A least-squares estimate and how well it fits."""

    #: One row per parameter: unit, estimate, u (standard uncertainty from the scatter of the residuals, as if they were white
    #: noise; not a number where the readings do not determine the parameters), in inside units.
    table: ByRow
    #: RMSE over all readings and of every test [µm], fitness of every test [%] (Eq. 34-35)
    quality: FitQuality
    predicted_um: dict[str, Numbers]  #: by test, in the order of its readings

    @property
    def estimate(self) -> dict[str, float]:
        """Parameter to estimate, in inside units."""
        return {str(name): float(value) for name, value in self.table["estimate"].items()}


@one_blas_thread
def least_squares(
    campaign: Campaign,
    degree: int = 0,
    *,
    reference_force_N: float | None = None,
    fixed: tuple[str, ...] = (),
) -> LeastSquares:
    """Estimate compliances, slopes and geometric errors by the pseudoinverse (Eq. 31).

    InputError for a plan, or fewer than degree + 2 force levels.

    Parameters
    ----------
    campaign : with readings.
    degree : {0, 1, 2}
        Compliance constant, linear (Eq. 33) or quadratic in force.
    reference_force_N : F0; default: mid-range of the campaign's forces. 0 gives Eq. 33 literally.
    fixed : parameters held at zero.
    """
    check_campaign(campaign)
    if campaign.is_plan:
        raise InputError(
            "least squares must have readings, got a plan. Run the tests, or simulate it."
        )
    bound = HybridModel(
        degree, (), HybridModel.paper().prior, reference_force_N, "paper", fixed
    ).bind(campaign)
    predicted = machine_coefficients(bound, bound.centre[None])[0]
    readings = {
        test.name: basis(test.angles_rad()) @ own * 1e3
        for test, own in zip(campaign.tests, predicted, strict=True)
    }
    quality = fit_quality(bound, np.ones((1, 1)), bound.centre[None])
    units = [parameter.unit for parameter in bound.parameters]
    table = pd.DataFrame(
        {"unit": units, "estimate": bound.centre, "u": _uncertainty(bound, quality)},
        index=list(bound.names),
    )
    if table["u"].isna().any():
        table["estimate"] = np.nan
    return LeastSquares(readable(table, "Least squares"), quality, readings)


def _uncertainty(bound: BoundModel, quality: FitQuality) -> Array:
    """Square roots of the diagonal of s² (JᵀJ)⁻¹, shape (p,); not a number where J is singular or
    as many as the readings."""
    readings = sum(test.readings for test in bound.reduced)
    square = readings * (quality.rmse_um * 1e-3) ** 2
    freedom = readings - len(bound.names)
    rows = (
        np.concatenate([test.factor @ bound.interest[r] for r, test in enumerate(bound.reduced)])
        * bound.scale
    )
    singular, right = np.linalg.svd(rows, full_matrices=False)[1:]
    if freedom <= 0 or len(rows) < rows.shape[1] or singular[-1] < _SINGULAR * singular[0]:
        return np.full(len(bound.names), np.nan)
    return np.asarray(
        np.sqrt(square / freedom * ((right.T / singular) ** 2).sum(axis=1)) * bound.scale
    )
