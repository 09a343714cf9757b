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
LEAST_SHARE = 20.0
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
        """What is known whatever the harmonics of one circle are: numbers projected on what does
        not see it, each known to 1."""
        own = (
            self.jacobian[:, circle * len(self.order) : (circle + 1) * len(self.order)]
            / self.sd[:, None]
        )
        unseen = null_space(own.T).T / self.sd
        return replace(
            self,
            values=unseen @ self.values,
            jacobian=unseen @ self.jacobian,
            sd=np.ones(len(unseen)),
        )

    @cached_property
    def columns(self) -> dict[str, Array]:
        """Harmonics of the columns of Eq. 20 and 21 at every force, each (6, k) [mm per unit]."""
        jacobian = [
            lb.machine.hybrid_jacobian(lb.Machine(), lb.machine.Circle(), angles(), force)
            for force in FORCES_N
        ]
        fitted = np.array(
            [np.linalg.lstsq(self.basis, own.to_numpy(), rcond=None)[0] for own in jacobian]
        )
        return {name: fitted[:, :, j] for j, name in enumerate(jacobian[0].columns)}


def printed_numbers() -> Data:
    """Tables 5 to 8, in units of what each number is known to."""
    found = recover()
    sd = np.array([number.half_unit for number in found.numbers]) / np.sqrt(3.0)
    values = np.array([number.value for number in found.numbers])
    order = np.array([0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0])
    return Data(
        order,
        trigonometric(order, angles()),
        values / sd,
        1e3 * found.jacobian / sd[:, None],
        np.ones(len(sd)),
    )


def all_harmonics(campaign: lb.Campaign) -> Data:
    """Orders 0 to 12 of every circle, known to the white noise."""
    order = np.array([0.0, *np.repeat(np.arange(1.0, 13.0), 2)])
    basis = trigonometric(order, campaign.tests[0].angles_rad())
    readings = 1e-3 * np.array([test.reading_um for test in campaign.tests]).T
    values = np.linalg.lstsq(basis, readings, rcond=None)[0]
    sigma = np.sqrt(
        np.sum((readings - basis @ values) ** 2) / (values.shape[1] * (len(basis) - len(order)))
    )
    sd = sigma * np.sqrt(np.where(order == 0.0, 1.0, 2.0) / len(basis))
    circles = values.shape[1]
    return Data(
        order,
        trigonometric(order, angles()),
        values.T.ravel(),
        np.eye(values.size),
        np.tile(sd, circles),
    )


def angles() -> Array:
    """Of one circle [rad]."""
    return np.arange(READINGS) * 2.0 * np.pi / READINGS


def trigonometric(order: Array, angle_rad: Array) -> Array:
    """1, cos θ, sin θ, cos 2θ …: of each order the cosine first."""
    again = [bool(k and n == order[k - 1]) for k, n in enumerate(order)]
    return np.column_stack(
        [
            np.sin(n * angle_rad) if sine else np.cos(n * angle_rad)
            for n, sine in zip(order, again, strict=True)
        ]
    )


@cache
def estimate() -> dict[str, float]:
    """Ĉ: the compliances of Table 5."""
    numbers = [number for number in recover().numbers if len(number.forces_N) == len(FORCES_N)]
    return {name: numbers[k].value for k, name in enumerate(COMPLIANCES)}


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


def of_first() -> Sizes:
    """Slopes of the first edition: measured against what any machine's compliance may be."""
    return Sizes(PRIOR_SD, estimate())


def of_second() -> Sizes:
    """Slopes of the second edition: measured against their own compliance, Ĉ of Table 5."""
    slope = {
        name: max(abs(value), PRIOR_SD[name] / LEAST_SHARE) for name, value in estimate().items()
    }
    return Sizes(slope, estimate())


def of_third() -> Sizes:
    """The third edition: Ĉ and u(Ĉ) as `lb` finds them from the shipped readings, added in
    squares."""
    campaign = lb.read_campaign(DATA / "recovered_experiment")
    setting = lb.HybridModel.default(1).bind(campaign).setting
    size = dict(zip(COMPLIANCES, setting.compliance_size_estimate.tolist(), strict=True))
    slope = {name: max(value, PRIOR_SD[name] / LEAST_SHARE) for name, value in size.items()}
    return Sizes(slope, size, third=True)


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
    sizes: Sizes = field(default_factory=of_first)
    grid: Mapping[str, Array] = field(default_factory=lambda: GRID)

    def slope_size(self, name: str) -> float:
        """Prior sd of a slope times the range of force."""
        return self.slope_scale * self.sizes.slope[name]

    @cached_property
    def parameters(self) -> Array:
        """Columns of 13 parameters and 6 slopes times their prior sd, shape (m, 19)."""
        column = self.data.columns
        lever = (FORCES_N - MIDDLE_N)[:, None]
        own = [sd * column[name] for name, sd in PRIOR_SD.items()]
        own += [self.slope_size(name) / RANGE_N * lever * column[name] for name in COMPLIANCES]
        return self.data.jacobian @ np.array([c.ravel() for c in own]).T

    @cached_property
    def fixed(self) -> Array:
        """Covariance of length, mount, force error, common mode and what is unexplained, shape (m,
        m)."""
        one = (self.data.order == 0.0).astype(float)
        deflection: Array = np.sum(
            [value * self.data.columns[name] for name, value in estimate().items()], axis=0
        )
        columns = [
            np.outer(np.full(len(FORCES_N), LENGTH_MM), one),
            MOUNT_MM_PER_BAR * np.outer(PRESSURES_BAR, one),
            GAIN * deflection,
        ]
        columns += [
            RANDOM_N * np.outer(circle, [1.0]) * deflection / FORCES_N[:, None]
            for circle in np.eye(len(FORCES_N))
        ]
        if self.common_mode:
            curve = (
                self.slope_scale * PRIOR_SD["C_XXX"] / RANGE_N * FORCES_N * (FORCES_N - MIDDLE_N)
            )
            columns.append(np.outer(curve, one))
        bow = 4.0 * FORCES_N * (FORCES_N.max() - FORCES_N) / FORCES_N.max() ** 2
        if "curved mount" in self.rivals:
            columns.append(CURVE_MM * np.outer(bow, one))
        if "curved force law" in self.rivals:
            columns.append(CURVE_OF_FORCE * FORCES_N.max() * (bow / FORCES_N)[:, None] * deflection)
        if "joint load" in self.rivals:
            columns += self._own_load()
        if self.sizes.third:
            columns += self._drift() + self._one_way()
        own = _square(self.data.jacobian @ np.array([c.ravel() for c in columns]).T)
        return own + self.unexplained_mm**2 * _square(self.data.jacobian)

    def _own_load(self) -> list[Array]:
        """One sd of what yields to the load of its own axis: stiffening and contact of X and of Y,
        and the third edition's seats, each (6, k) [mm]."""
        force = FORCES_N[:, None]
        share = THIRD_OWN_LOAD if self.sizes.third else OWN_LOAD
        found = []
        for name, u in (("C_XXX", np.cos(angles())), ("C_YYY", np.sin(angles()))):
            stiffening = force * u**2 * (force * np.abs(u) - MIDDLE_N) / FORCES_N.max()
            cube_root = np.cbrt(force**2 * MIDDLE_N)
            contact = cube_root * np.abs(u) ** (5.0 / 3.0) - force * u**2
            traces = [stiffening, contact]
            if self.sizes.third:
                traces.append((cube_root - force) * u**2)
            for trace in traces:
                fitted = np.linalg.lstsq(self.data.basis, trace.T, rcond=None)[0].T
                found.append(share * self.sizes.joint[name] * fitted)
        return found

    def _drift(self) -> list[Array]:
        """One sd of a drift of the bar's length and of the centre in the order listed, each (6, k)
        [mm]."""
        hours = LISTED_H * np.arange(len(FORCES_N))
        hours = hours - hours.mean()
        first = np.flatnonzero(self.data.order == 1.0)
        unit = np.eye(len(self.data.order))
        length = DRIFT_OF_LENGTH_MM_PER_H * np.outer(hours, unit[0])
        return [length, *(DRIFT_OF_CENTRE_MM_PER_H * np.outer(hours, unit[k]) for k in first)]

    def _one_way(self) -> list[Array]:
        """One sd of what changes its sign with the direction of travel, constant and in proportion
        to force, each (6, k) [mm]."""
        found = []
        for k, order in enumerate(self.data.order):
            if order <= ONE_WAY_LAST_ORDER:
                unit = np.eye(len(self.data.order))[k] / max(order, 1.0)
                found.append(ONE_WAY_MM * np.outer(np.ones(len(FORCES_N)), unit))
                found.append(ONE_WAY_MM_PER_N * np.outer(FORCES_N, unit))
        return found

    @cached_property
    def moving(self) -> dict[str, Array]:
        """Covariance per δ² (orders 0 and 1), κ² and τ² (orders from 2), each (m, m)."""
        order = self.data.order
        circles = len(FORCES_N)
        setup = np.where(order == 1.0, 1.0, np.where(order == 0.0, float(self.zero_moves), 0.0))
        discrepancy, form = (
            np.where(order >= 2.0, np.maximum(order, 1.0) ** -power, 0.0)
            for power in (self.decay, 1.0)
        )
        columns = {
            "delta": np.diag(np.tile(setup, circles)),
            "kappa": np.diag(np.tile(discrepancy, circles)),
            "tau": np.tile(np.diag(form), (circles, 1)),
        }
        return {name: _square(self.data.jacobian @ own) for name, own in columns.items()}

    @cached_property
    def points(self) -> list[dict[str, float]]:
        """Of the grid [mm]."""
        return [
            dict(zip(self.grid, values, strict=True)) for values in product(*self.grid.values())
        ]

    @cached_property
    def log_prior(self) -> Array:
        """Of every point, not normalised: half-normal, on a grid even in the logarithm."""
        return np.array(
            [
                sum(np.log(v) - 0.5 * (v / SCALE_MM[name]) ** 2 for name, v in p.items())
                for p in self.points
            ]
        )

    @cached_property
    def weighed(self) -> tuple[Array, Array, Array]:
        """At g points, of all parameters: XᵀN⁻¹X (g, 19, 19); XᵀN⁻¹y (g, 19); yᵀN⁻¹y + ln det N + m
        ln 2π (g,) [nat]."""
        found = [self._weighed(point) for point in self.points]
        information, projected, rest = (np.array(own) for own in zip(*found, strict=True))
        return information, projected, rest

    def _weighed(self, hyper_mm: Mapping[str, float]) -> tuple[Array, Array, float]:
        noise = np.diag(self.data.sd**2) + self.fixed
        noise += np.sum([hyper_mm[name] ** 2 * own for name, own in self.moving.items()], axis=0)
        factor = cho_factor(noise, lower=True)
        weighted = cho_solve(factor, np.column_stack([self.parameters, self.data.values]))
        own = 2.0 * np.log(np.diag(factor[0])).sum() + len(noise) * np.log(2.0 * np.pi)
        of_values = self.data.values @ weighted
        return self.parameters.T @ weighted[:, :-1], of_values[:-1], float(of_values[-1] + own)

    def given(self, slopes: Sequence[str]) -> tuple[Array, Array, Array]:
        """At g points: ln p(numbers | φ) (g,) [nat]; precision (g, k, k) of k = 13 parameters and
        these slopes in units of the prior sd, and precision times mean (g, k)."""
        size = len(PRIOR_SD)
        kept = [*range(size), *(size + COMPLIANCES.index(name) for name in slopes)]
        information, projected, rest = self.weighed
        precision = np.eye(len(kept)) + information[:, kept][:, :, kept]
        projected = projected[:, kept]
        root = np.linalg.cholesky(precision)
        white = np.linalg.solve(root, projected[:, :, None])[:, :, 0]
        log_det = 2.0 * np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        return -0.5 * (rest - (white**2).sum(axis=1) + log_det), precision, projected

    def not_negative(self, slopes: Sequence[str], mean: Array, covariance: Array) -> Array:
        """P(C_XXX, C_YYY, C_CCY ≥ 0 at the lowest and the highest force) (n,), of means (n, k) and
        covariances (n, k, k) in prior sd."""
        rows = []
        for name in NOT_NEGATIVE:
            for end in (-0.5, 0.5) if name in slopes else (0.0,):
                row = np.zeros(mean.shape[1])
                row[list(PRIOR_SD).index(name)] = 1.0
                if end:
                    row[len(PRIOR_SD) + slopes.index(name)] = (
                        end * self.slope_size(name) / PRIOR_SD[name]
                    )
                rows.append(row)
        ends = np.array(rows)
        at = mean @ ends.T
        spread = ends @ covariance @ ends.T
        far = at / np.sqrt(np.diagonal(spread, axis1=1, axis2=2))
        open_ = far < 5.0
        found = np.where(open_, norm.cdf(far), 1.0).prod(axis=1)
        for k in np.flatnonzero(open_.sum(axis=1) > 1):
            own = open_[k]
            found[k] = multivariate_normal.cdf(
                at[k, own], np.zeros(own.sum()), spread[k][np.ix_(own, own)]
            )
        return found

    def evidence(self, slopes: Sequence[str] = ()) -> dict[str, float]:
        """ln Z with truncation [nat], posterior means of the hyper-parameters and sd of κ [mm]."""
        log_density, precision, projected = self.given(slopes)
        joint = self.log_prior + log_density
        likely = joint > joint.max() - _UNLIKELY
        covariance = np.linalg.inv(precision[likely])
        mean = np.einsum("gij,gj->gi", covariance, projected[likely])
        joint[likely] += np.log(np.maximum(self.not_negative(slopes, mean, covariance), 1e-300))
        size = len(PRIOR_SD) + len(slopes)
        total = logsumexp(joint)
        weight = np.exp(joint - total)
        means = {name: float(weight @ [point[name] for point in self.points]) for name in self.grid}
        square = float(weight @ [(point["kappa"] - means["kappa"]) ** 2 for point in self.points])
        (inside,) = self.not_negative(slopes, np.zeros((1, size)), np.eye(size)[None])
        before = logsumexp(self.log_prior) + np.log(inside)
        return {"log_evidence": float(total - before), **means, "sd_of_kappa": square**0.5}

    def log_bayes_factor(self) -> float:
        """Of all six slopes over none [nat]."""
        return self.evidence(COMPLIANCES)["log_evidence"] - self.evidence()["log_evidence"]


def _square(columns: Array) -> Array:
    return columns @ columns.T
