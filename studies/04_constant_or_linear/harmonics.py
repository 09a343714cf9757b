"""The first edition of the model once more, dense, for numbers that are a linear map of the
harmonics of six circles.

Under the model harmonics are Gaussian given the hyper-parameters, and so are such numbers; their
density is averaged over the priors on a grid. Given the harmonics of the shipped readings this must
return `lb.log_evidence`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from make_campaign import FORCES_N, PRESSURES_BAR, READINGS, recover
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, null_space
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm
from study import DATA

import ldbb_bayes as lb

Array = NDArray[np.float64]
COMPLIANCES = ("C_XXX", "C_XYX", "C_YYY", "C_CXY", "C_CYY", "C_CCY")
NOT_NEGATIVE = ("C_XXX", "C_YYY", "C_CCY")
PRIOR_SD = dict(zip(COMPLIANCES, (1e-4, 1e-5, 1e-4, 1e-7, 1e-7, 1e-9), strict=True))
PRIOR_SD |= {
    "E_XX1": 2e-4,
    "E_YX2": 1e-6,
    "E_XY2": 1e-6,
    "E_YY1": 2e-4,
    "E_C0YX": 5e-5,
    "E_Xt0": 0.02,
    "E_Yt0": 0.02,
}
SLOPE_SCALE = 0.3
LEAST_SIZE_DIVISOR = 20.0
LENGTH_MM = 9.4e-3
MOUNT_MM_PER_BAR = 0.1 * 2.33e-3
GAIN = 0.01
RANDOM_N = 4.0
# Half-normal scales, and grids of the hyper-parameters, even in their logarithms [mm].
SCALE_MM = {"delta": 1e-3, "kappa": 1e-3, "tau": 5e-3}
GRID = {
    "delta": np.geomspace(5e-5, 3e-3, 14),
    "kappa": np.geomspace(1e-5, 2e-3, 20),
    "tau": np.geomspace(5e-4, 2e-2, 12),
}
GRID_OF_READINGS = {
    "delta": np.geomspace(2e-4, 3e-3, 12),
    "kappa": np.geomspace(1.8e-4, 3.6e-4, 12),
    "tau": np.geomspace(1e-3, 5e-3, 12),
}
# What explains a change with force beside slopes: the second edition's terms and their sizes.
RIVALS = ("joint load", "curved mount", "curved force law")
CURVE_MM = 0.5e-3
CURVE_OF_FORCE = 0.01
OWN_LOAD = 0.2
# The third edition's joint load, and what it lets act in every model: drift in the order listed,
# and what changes its sign with the direction of travel where only one is run.
THIRD_OWN_LOAD = 0.4
LISTED_H = 0.1
DRIFT_OF_LENGTH_MM_PER_H = 2e-3
DRIFT_OF_CENTRE_MM_PER_H = 5e-3
ONE_WAY_MM = 2e-3
ONE_WAY_MM_PER_N = 1.2e-6
ONE_WAY_LAST_ORDER = 3
MIDDLE_N = 0.5 * (FORCES_N.min() + FORCES_N.max())
RANGE_N = float(np.ptp(FORCES_N))
# Points of the grid below the best by more [nat] do not count.
_UNLIKELY = 12.0
# A bound so many posterior standard deviations away is taken as kept for certain.
_FAR_SD = 5.0


@dataclass(frozen=True, eq=False)
class Data:
    """Numbers that are a linear map of the harmonics of six circles.

    Attributes
    ----------
    order : ndarray, shape (k,)
        Of each harmonic of a circle.
    basis : ndarray, shape (720, k)
        The harmonics at the angles of one circle.
    values, jacobian, sd : ndarray, shapes (m,), (m, 6 k), (m,)
        Numbers; numbers per mm of every harmonic, circle by circle; what they are known to.
    """

    order: Array
    basis: Array
    values: Array
    jacobian: Array
    sd: Array

    def without(self, circle: int) -> Data:
        """Return what is known whatever the harmonics of one circle are.

        The numbers are projected on what does not depend on that circle, each known to 1.
        """
        count = len(self.order)
        columns = slice(circle * count, (circle + 1) * count)
        of_circle = self.jacobian[:, columns] / self.sd[:, None]
        projection = null_space(of_circle.T).T / self.sd
        return replace(
            self,
            values=projection @ self.values,
            jacobian=projection @ self.jacobian,
            sd=np.ones(len(projection)),
        )

    def harmonics_of(self, traces: Array) -> Array:
        """Return the harmonics of traces around a circle: (720, j) gives (k, j)."""
        return np.linalg.lstsq(self.basis, traces, rcond=None)[0]

    @cached_property
    def columns(self) -> dict[str, Array]:
        """Harmonics of the columns of Eq. 20 and 21 at every force, each (6, k) [mm per unit]."""
        jacobians = [
            lb.machine.hybrid_jacobian(lb.Machine(), lb.machine.Circle(), angles_rad(), force_N)
            for force_N in FORCES_N
        ]
        harmonics = np.array([self.harmonics_of(jacobian.to_numpy()) for jacobian in jacobians])
        return {name: harmonics[:, :, j] for j, name in enumerate(jacobians[0].columns)}


def printed_numbers() -> Data:
    """Tables 5 to 8, in units of what each number is known to."""
    recovered = recover()
    sd = np.array([number.half_unit for number in recovered.numbers]) / np.sqrt(3.0)
    values = np.array([number.value for number in recovered.numbers])
    order = np.array([0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0])
    return Data(
        order=order,
        basis=trigonometric(order, angles_rad()),
        values=values / sd,
        jacobian=1e3 * recovered.jacobian / sd[:, None],
        sd=np.ones(len(sd)),
    )


def all_harmonics(campaign: lb.Campaign) -> Data:
    """Orders 0 to 12 of every circle, known to the white noise."""
    order = np.array([0.0, *np.repeat(np.arange(1.0, 13.0), 2)])
    basis = trigonometric(order, campaign.tests[0].angles_rad())
    readings_mm = 1e-3 * np.array([test.reading_um for test in campaign.tests]).T
    harmonics = np.linalg.lstsq(basis, readings_mm, rcond=None)[0]
    circles = harmonics.shape[1]
    squares = np.sum((readings_mm - basis @ harmonics) ** 2)
    sigma = np.sqrt(squares / (circles * (len(basis) - len(order))))
    sd = sigma * np.sqrt(np.where(order == 0.0, 1.0, 2.0) / len(basis))
    return Data(
        order=order,
        basis=trigonometric(order, angles_rad()),
        values=harmonics.T.ravel(),
        jacobian=np.eye(harmonics.size),
        sd=np.tile(sd, circles),
    )


def angles_rad() -> Array:
    """Of one circle [rad]."""
    return np.arange(READINGS) * 2.0 * np.pi / READINGS


def trigonometric(orders: Array, angle_rad: Array) -> Array:
    """1, cos θ, sin θ, cos 2θ …: of each order the cosine first."""
    columns: list[Array] = []
    for index, order in enumerate(orders):
        repeats_the_order = index > 0 and order == orders[index - 1]
        if repeats_the_order:
            columns.append(np.sin(order * angle_rad))
        else:
            columns.append(np.cos(order * angle_rad))
    return np.column_stack(columns)


@cache
def estimate() -> dict[str, float]:
    """Ĉ: the compliances of Table 5."""
    of_all_forces = [
        number for number in recover().numbers if len(number.forces_N) == len(FORCES_N)
    ]
    return {name: of_all_forces[j].value for j, name in enumerate(COMPLIANCES)}


@dataclass(frozen=True)
class Sizes:
    """What slopes and joint load are measured against, by compliance, and which they are.

    Attributes
    ----------
    slope : dict of str to float
        Prior sd of a slope times the range of force, per ``slope_scale``.
    joint : dict of str to float
        Compliance that the joint load's prior sd is a share of.
    third : bool
        Whether joint load, drift and hysteresis are the third edition's.
    """

    slope: Mapping[str, float]
    joint: Mapping[str, float]
    third: bool = False


def sizes_of_first_edition() -> Sizes:
    """Slopes are measured against what any machine's compliance may be."""
    return Sizes(PRIOR_SD, estimate())


def sizes_of_second_edition() -> Sizes:
    """Slopes are measured against their own compliance, Ĉ of Table 5."""
    return Sizes(slope=_no_less_than_a_share(estimate()), joint=estimate())


def sizes_of_third_edition() -> Sizes:
    """Slopes are measured against Ĉ and u(Ĉ), added in squares, as `lb` finds them from the
    shipped readings."""
    campaign = lb.read_campaign(DATA / "recovered_experiment")
    setting = lb.HybridModel.default(1).bind(campaign).setting
    size = dict(zip(COMPLIANCES, setting.compliance_size_estimate.tolist(), strict=True))
    return Sizes(slope=_no_less_than_a_share(size), joint=size, third=True)


def _no_less_than_a_share(size: Mapping[str, float]) -> dict[str, float]:
    """The absolute sizes, but no less than a share of the prior sd."""
    return {
        name: max(abs(value), PRIOR_SD[name] / LEAST_SIZE_DIVISOR) for name, value in size.items()
    }


class NormalEquations(NamedTuple):
    """Weighted least squares of all parameters X on the numbers y, with noise N, at g points.

    Attributes
    ----------
    information : ndarray, shape (g, 19, 19)
        XᵀN⁻¹X.
    projected : ndarray, shape (g, 19)
        XᵀN⁻¹y.
    misfit : ndarray, shape (g,) [nat]
        yᵀN⁻¹y + ln det N + m ln 2π.
    """

    information: Array
    projected: Array
    misfit: Array


class Conditional(NamedTuple):
    """Numbers and parameters given the hyper-parameters φ, at g points.

    Attributes
    ----------
    log_density : ndarray, shape (g,) [nat]
        ln p(numbers | φ).
    precision : ndarray, shape (g, k, k)
        Of the k parameters, in units of the prior sd.
    projected : ndarray, shape (g, k)
        Precision times mean.
    """

    log_density: Array
    precision: Array
    projected: Array


@dataclass(frozen=True)
class Evidence:
    """What the grid says of one subset of slopes.

    Attributes
    ----------
    log_evidence : float
        ln Z with truncation [nat].
    mean_mm : dict of str to float
        Posterior means of the hyper-parameters.
    sd_of_kappa_mm : float
    """

    log_evidence: float
    mean_mm: Mapping[str, float]
    sd_of_kappa_mm: float


@dataclass(frozen=True, eq=False)
class Model:
    """The first edition of the model, of a linear map of harmonics, for every subset of slopes at
    once.

    Parameters
    ----------
    zero_moves : bool
        Whether δ moves order 0 beside order 1.
    common_mode : bool
        Whether the bar's length changes with F (F − F0), by the prior sd of a slope.
    slope_scale : float
        Prior sd of a slope times the range of force, per sd(C).
    decay : float
        The discrepancy of order n is κ/n to this power.
    unexplained_mm : float
        Added to what is known of every harmonic of every circle [mm].
    rivals : tuple of str
        Which of `RIVALS` it has.
    sizes : Sizes
        What slopes and joint load are measured against; the third edition's bring its drift and
        hysteresis along.
    """

    data: Data
    zero_moves: bool = True
    common_mode: bool = False
    slope_scale: float = SLOPE_SCALE
    decay: float = 1.0
    unexplained_mm: float = 0.0
    rivals: tuple[str, ...] = ()
    sizes: Sizes = field(default_factory=sizes_of_first_edition)
    grid: Mapping[str, Array] = field(default_factory=lambda: GRID)

    def slope_size(self, name: str) -> float:
        """Prior sd of a slope times the range of force."""
        return self.slope_scale * self.sizes.slope[name]

    @cached_property
    def parameters(self) -> Array:
        """Columns of 13 parameters and 6 slopes times their prior sd, shape (m, 19)."""
        columns = self.data.columns
        lever_N = (FORCES_N - MIDDLE_N)[:, None]
        patterns = [sd * columns[name] for name, sd in PRIOR_SD.items()]
        for name in COMPLIANCES:
            patterns.append(self.slope_size(name) / RANGE_N * lever_N * columns[name])
        return self._numbers_of(patterns)

    @cached_property
    def fixed(self) -> Array:
        """Covariance of length, mount, force error, common mode, rivals and what is unexplained,
        shape (m, m)."""
        patterns = self._bar_and_mount() + self._force_errors()
        if self.common_mode:
            patterns.append(self._common_mode())
        patterns += self._rivals()
        if self.sizes.third:
            patterns += self._drift() + self._one_way()
        unexplained = self.unexplained_mm**2 * _square(self.data.jacobian)
        return _square(self._numbers_of(patterns)) + unexplained

    def _numbers_of(self, patterns: Sequence[Array]) -> Array:
        """What patterns of harmonics, each (6, k) [mm], do to the numbers: one column each."""
        return self.data.jacobian @ np.array([pattern.ravel() for pattern in patterns]).T

    def _order_zero(self) -> Array:
        """One in the mean of a circle, zero in its other harmonics, shape (k,)."""
        return (self.data.order == 0.0).astype(float)

    def _deflection(self) -> Array:
        """Harmonics of the deflection by Ĉ at every force, shape (6, k) [mm]."""
        columns = self.data.columns
        deflection: Array = np.sum(
            [value * columns[name] for name, value in estimate().items()], axis=0
        )
        return deflection

    def _bar_and_mount(self) -> list[Array]:
        """One sd of the bar's length and of the deflection of the mount, each (6, k) [mm]."""
        length = np.outer(np.full(len(FORCES_N), LENGTH_MM), self._order_zero())
        mount = MOUNT_MM_PER_BAR * np.outer(PRESSURES_BAR, self._order_zero())
        return [length, mount]

    def _force_errors(self) -> list[Array]:
        """One sd of the gain of the force, and of the force of every circle, each (6, k) [mm]."""
        deflection = self._deflection()
        patterns = [GAIN * deflection]
        for circle in np.eye(len(FORCES_N)):
            patterns.append(RANDOM_N * np.outer(circle, [1.0]) * deflection / FORCES_N[:, None])
        return patterns

    def _common_mode(self) -> Array:
        """One sd of a length that changes with F (F − F0), shape (6, k) [mm]."""
        sd = self.slope_scale * PRIOR_SD["C_XXX"] / RANGE_N
        return np.outer(sd * FORCES_N * (FORCES_N - MIDDLE_N), self._order_zero())

    def _rivals(self) -> list[Array]:
        """One sd of the rivals of slopes that the model has, each (6, k) [mm]."""
        bow = 4.0 * FORCES_N * (FORCES_N.max() - FORCES_N) / FORCES_N.max() ** 2
        patterns = []
        if "curved mount" in self.rivals:
            patterns.append(CURVE_MM * np.outer(bow, self._order_zero()))
        if "curved force law" in self.rivals:
            share_of_force = CURVE_OF_FORCE * FORCES_N.max() * (bow / FORCES_N)
            patterns.append(share_of_force[:, None] * self._deflection())
        if "joint load" in self.rivals:
            patterns += self._joint_load()
        return patterns

    def _joint_load(self) -> list[Array]:
        """One sd of what yields to the load of its own axis: stiffening and contact of X and of Y,
        and the third edition's seats, each (6, k) [mm]."""
        force_N = FORCES_N[:, None]
        cube_root = np.cbrt(force_N**2 * MIDDLE_N)
        share = THIRD_OWN_LOAD if self.sizes.third else OWN_LOAD
        patterns = []
        for name, u in (("C_XXX", np.cos(angles_rad())), ("C_YYY", np.sin(angles_rad()))):
            stiffening = force_N * u**2 * (force_N * np.abs(u) - MIDDLE_N) / FORCES_N.max()
            contact = cube_root * np.abs(u) ** (5.0 / 3.0) - force_N * u**2
            traces = [stiffening, contact]
            if self.sizes.third:
                seat = (cube_root - force_N) * u**2
                traces.append(seat)
            for trace in traces:
                harmonics = self.data.harmonics_of(trace.T).T
                patterns.append(share * self.sizes.joint[name] * harmonics)
        return patterns

    def _drift(self) -> list[Array]:
        """One sd of a drift of the bar's length and of the centre in the order listed, each (6, k)
        [mm]."""
        hours = LISTED_H * np.arange(len(FORCES_N))
        hours = hours - hours.mean()
        unit = np.eye(len(self.data.order))
        patterns = [DRIFT_OF_LENGTH_MM_PER_H * np.outer(hours, unit[0])]
        for harmonic in np.flatnonzero(self.data.order == 1.0):
            patterns.append(DRIFT_OF_CENTRE_MM_PER_H * np.outer(hours, unit[harmonic]))
        return patterns

    def _one_way(self) -> list[Array]:
        """One sd of what changes its sign with the direction of travel, constant and in proportion
        to force, each (6, k) [mm]."""
        unit = np.eye(len(self.data.order))
        patterns = []
        for harmonic, order in enumerate(self.data.order):
            if order <= ONE_WAY_LAST_ORDER:
                decaying = unit[harmonic] / max(order, 1.0)
                patterns.append(ONE_WAY_MM * np.outer(np.ones(len(FORCES_N)), decaying))
                patterns.append(ONE_WAY_MM_PER_N * np.outer(FORCES_N, decaying))
        return patterns

    @cached_property
    def moving(self) -> dict[str, Array]:
        """Covariance per δ² (orders 0 and 1), κ² and τ² (orders from 2), each (m, m)."""
        order = self.data.order
        circles = len(FORCES_N)
        setup = np.where(order == 1.0, 1.0, np.where(order == 0.0, float(self.zero_moves), 0.0))
        discrepancy = _power_law(order, self.decay)
        form = _power_law(order, 1.0)
        columns = {
            "delta": np.diag(np.tile(setup, circles)),
            "kappa": np.diag(np.tile(discrepancy, circles)),
            "tau": np.tile(np.diag(form), (circles, 1)),
        }
        return {name: _square(self.data.jacobian @ matrix) for name, matrix in columns.items()}

    @cached_property
    def points(self) -> list[dict[str, float]]:
        """Of the grid [mm]."""
        return [
            dict(zip(self.grid, values, strict=True)) for values in product(*self.grid.values())
        ]

    @cached_property
    def log_prior(self) -> Array:
        """Of every point, not normalised: half-normal, on a grid even in the logarithm."""
        return np.array([_log_prior_at(point) for point in self.points])

    @cached_property
    def normal_equations(self) -> NormalEquations:
        """Of all 19 parameters, at every point."""
        at_points = [self._normal_equations_at(point) for point in self.points]
        return NormalEquations(
            information=np.array([equations.information for equations in at_points]),
            projected=np.array([equations.projected for equations in at_points]),
            misfit=np.array([equations.misfit for equations in at_points]),
        )

    def _normal_equations_at(self, hyper_mm: Mapping[str, float]) -> NormalEquations:
        """The same at one point, without the axis of points."""
        moving = [hyper_mm[name] ** 2 * covariance for name, covariance in self.moving.items()]
        noise = np.diag(self.data.sd**2) + self.fixed
        noise += np.sum(moving, axis=0)
        factor = cho_factor(noise, lower=True)
        log_det = 2.0 * np.log(np.diag(factor[0])).sum()
        weighted = cho_solve(factor, np.column_stack([self.parameters, self.data.values]))
        values_weighted = self.data.values @ weighted
        constant = log_det + len(noise) * np.log(2.0 * np.pi)
        return NormalEquations(
            information=self.parameters.T @ weighted[:, :-1],
            projected=values_weighted[:-1],
            misfit=values_weighted[-1] + constant,
        )

    def conditional(self, slopes: Sequence[str]) -> Conditional:
        """Numbers, and the 13 parameters with these slopes, given the hyper-parameters."""
        size = len(PRIOR_SD)
        columns = [*range(size), *(size + COMPLIANCES.index(name) for name in slopes)]
        equations = self.normal_equations
        precision = np.eye(len(columns)) + equations.information[:, columns][:, :, columns]
        projected = equations.projected[:, columns]
        root = np.linalg.cholesky(precision)
        white = np.linalg.solve(root, projected[:, :, None])[:, :, 0]
        log_det = 2.0 * np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        log_density = -0.5 * (equations.misfit - (white**2).sum(axis=1) + log_det)
        return Conditional(log_density, precision, projected)

    def bounded_combinations(self, slopes: Sequence[str]) -> Array:
        """C_XXX, C_YYY, C_CCY at the lowest and the highest force as combinations of the k
        parameters in prior sd, shape (bounds, k)."""
        rows = []
        for name in NOT_NEGATIVE:
            ends = (-0.5, 0.5) if name in slopes else (0.0,)
            for end in ends:
                row = np.zeros(len(PRIOR_SD) + len(slopes))
                row[list(PRIOR_SD).index(name)] = 1.0
                if name in slopes:
                    change = end * self.slope_size(name) / PRIOR_SD[name]
                    row[len(PRIOR_SD) + slopes.index(name)] = change
                rows.append(row)
        return np.array(rows)

    def not_negative(self, slopes: Sequence[str], mean: Array, covariance: Array) -> Array:
        """P(C_XXX, C_YYY, C_CCY ≥ 0 at the lowest and the highest force) (n,), of means (n, k) and
        covariances (n, k, k) in prior sd."""
        bounds = self.bounded_combinations(slopes)
        bound_mean = mean @ bounds.T
        bound_covariance = bounds @ covariance @ bounds.T
        distance_sd = bound_mean / np.sqrt(np.diagonal(bound_covariance, axis1=1, axis2=2))
        uncertain = distance_sd < _FAR_SD
        probability = np.where(uncertain, norm.cdf(distance_sd), 1.0).prod(axis=1)
        for k in np.flatnonzero(uncertain.sum(axis=1) > 1):
            joint = uncertain[k]
            probability[k] = multivariate_normal.cdf(
                bound_mean[k, joint],
                np.zeros(joint.sum()),
                bound_covariance[k][np.ix_(joint, joint)],
            )
        return probability

    def _prior_not_negative(self, slopes: Sequence[str]) -> float:
        """The same probability before any number is seen."""
        size = len(PRIOR_SD) + len(slopes)
        (probability,) = self.not_negative(slopes, np.zeros((1, size)), np.eye(size)[None])
        return float(probability)

    def evidence(self, slopes: Sequence[str] = ()) -> Evidence:
        """Average over the grid, with truncation."""
        conditional = self.conditional(slopes)
        joint = self.log_prior + conditional.log_density
        likely = joint > joint.max() - _UNLIKELY
        covariance = np.linalg.inv(conditional.precision[likely])
        mean = np.einsum("gij,gj->gi", covariance, conditional.projected[likely])
        probability = self.not_negative(slopes, mean, covariance)
        joint[likely] += np.log(np.maximum(probability, 1e-300))
        total = logsumexp(joint)
        weight = np.exp(joint - total)
        mean_mm = {
            name: float(weight @ [point[name] for point in self.points]) for name in self.grid
        }
        squares = [(point["kappa"] - mean_mm["kappa"]) ** 2 for point in self.points]
        prior_total = logsumexp(self.log_prior) + np.log(self._prior_not_negative(slopes))
        return Evidence(
            log_evidence=float(total - prior_total),
            mean_mm=mean_mm,
            sd_of_kappa_mm=float(weight @ squares) ** 0.5,
        )

    def log_evidence(self, slopes: Sequence[str] = ()) -> float:
        """ln Z with these slopes [nat]."""
        return self.evidence(slopes).log_evidence

    def log_bayes_factor(self) -> float:
        """Of all six slopes over none [nat]."""
        return self.log_evidence(COMPLIANCES) - self.log_evidence()


def _square(columns: Array) -> Array:
    return columns @ columns.T


def _power_law(order: Array, power: float) -> Array:
    """1/n to a power for orders n from 2, zero below."""
    return np.where(order >= 2.0, np.maximum(order, 1.0) ** -power, 0.0)


def _log_prior_at(point: Mapping[str, float]) -> float:
    """Half-normal densities of the hyper-parameters, times each for the even logarithm."""
    total = 0.0
    for name, value_mm in point.items():
        total += np.log(value_mm) - 0.5 * (value_mm / SCALE_MM[name]) ** 2
    return float(total)
