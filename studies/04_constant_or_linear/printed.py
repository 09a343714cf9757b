"""Constant or linear compliance from the 78 printed numbers themselves: no reading, nothing synthetic.

They are a linear map of 48 harmonics, each number known to its half-unit/√3. Under the model harmonics are Gaussian given the
hyper-parameters, and so are the printed numbers; their density is averaged over the priors on a grid. The model is written
out here once more, dense, in harmonics; given the harmonics of the shipped readings it must return `lb.log_evidence`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import combinations, product
from typing import Any

import numpy as np
from gain import ASSUMPTIONS, EQUAL
from make_campaign import FORCES_N, PRESSURES_BAR, READINGS, recover
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm
from undetermined import MODELS, recovered

import ldbb_bayes as lb

Array = NDArray[np.float64]
COMPLIANCES = ("C_XXX", "C_XYX", "C_YYY", "C_CXY", "C_CYY", "C_CCY")
NOT_NEGATIVE = ("C_XXX", "C_YYY", "C_CCY")
PRIOR_SD = dict(zip(COMPLIANCES, (1e-4, 1e-5, 1e-4, 1e-7, 1e-7, 1e-9), strict=True))
PRIOR_SD |= {"E_XX1": 2e-4, "E_YX2": 1e-6, "E_XY2": 1e-6, "E_YY1": 2e-4, "E_C0YX": 5e-5, "E_Xt0": 0.02, "E_Yt0": 0.02}
SLOPE_SCALE = 0.3
LENGTH_MM, MOUNT_MM_PER_BAR, GAIN, RANDOM_N = 9.4e-3, 0.1 * 2.33e-3, 0.01, 4.0
# Half-normal scales, and grids of the hyper-parameters, even in their logarithms [mm].
SCALE_MM = {"delta": 1e-3, "kappa": 1e-3, "tau": 5e-3}
GRID = {"delta": np.geomspace(5e-5, 3e-3, 14), "kappa": np.geomspace(1e-5, 2e-3, 20), "tau": np.geomspace(5e-4, 2e-2, 12)}
GRID_OF_READINGS = {
    "delta": np.geomspace(2e-4, 3e-3, 12),
    "kappa": np.geomspace(1.8e-4, 3.6e-4, 12),
    "tau": np.geomspace(1e-3, 5e-3, 12),
}
MIDDLE_N, RANGE_N = 0.5 * (FORCES_N.min() + FORCES_N.max()), float(np.ptp(FORCES_N))
ZERO_AND_CENTRE, CENTRE = "zero and centre move", "the centre alone moves"
SCALES = (0.0, 0.25, 0.5, 1.0, 2.0)
SLOPE_SCALES = (0.03, 0.1, 0.3, 1.0, 3.0)
# Points of the grid below the best by more [nat] do not count.
_UNLIKELY = 25.0


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

    @cached_property
    def columns(self) -> dict[str, Array]:
        """Harmonics of the columns of Eq. 20 and 21 at every force, each (6, k) [mm per unit]."""
        jacobian = [lb.hybrid_jacobian(lb.Machine(), lb.Circle(), angles(), force) for force in FORCES_N]
        fitted = np.array([np.linalg.lstsq(self.basis, own.to_numpy(), rcond=None)[0] for own in jacobian])
        return {name: fitted[:, :, j] for j, name in enumerate(jacobian[0].columns)}


def printed_numbers() -> Data:
    """Tables 5 to 8, in units of what each number is known to."""
    found = recover()
    sd = np.array([number.half_unit for number in found.numbers]) / np.sqrt(3.0)
    values = np.array([number.value for number in found.numbers])
    order = np.array([0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0])
    return Data(order, trigonometric(order, angles()), values / sd, 1e3 * found.jacobian / sd[:, None], np.ones(len(sd)))


def all_harmonics(campaign: lb.Campaign) -> Data:
    """Orders 0 to 12 of every circle, known to the white noise."""
    order = np.array([0.0, *np.repeat(np.arange(1.0, 13.0), 2)])
    basis = trigonometric(order, campaign.tests[0].angles_rad())
    readings = 1e-3 * np.array([test.reading_um for test in campaign.tests]).T
    values = np.linalg.lstsq(basis, readings, rcond=None)[0]
    sigma = np.sqrt(np.sum((readings - basis @ values) ** 2) / (values.shape[1] * (len(basis) - len(order))))
    sd = sigma * np.sqrt(np.where(order == 0.0, 1.0, 2.0) / len(basis))
    circles = values.shape[1]
    return Data(order, trigonometric(order, angles()), values.T.ravel(), np.eye(values.size), np.tile(sd, circles))


def angles() -> Array:
    """Of one circle [rad]."""
    return np.arange(READINGS) * 2.0 * np.pi / READINGS


def trigonometric(order: Array, angle_rad: Array) -> Array:
    """1, cos θ, sin θ, cos 2θ …: of each order the cosine first."""
    again = [bool(k and n == order[k - 1]) for k, n in enumerate(order)]
    return np.column_stack(
        [np.sin(n * angle_rad) if sine else np.cos(n * angle_rad) for n, sine in zip(order, again, strict=True)]
    )


@cache
def estimate() -> dict[str, float]:
    """Ĉ: the compliances of Table 5."""
    numbers = [number for number in recover().numbers if len(number.forces_N) == len(FORCES_N)]
    return {name: numbers[k].value for k, name in enumerate(COMPLIANCES)}


@dataclass(frozen=True, eq=False)
class Model:
    """The default model, of a linear map of harmonics.

    Parameters
    ----------
    slopes : tuple of str
        Compliances that change with force.
    zero_moves : bool
        Whether δ moves order 0 beside order 1.
    common_mode : bool
        Whether the bar's length changes with F (F − F0), by the prior sd of a slope.
    slope_scale : float
        Prior sd of a slope times the range of force, per sd(C).
    """

    data: Data
    slopes: tuple[str, ...] = ()
    zero_moves: bool = True
    common_mode: bool = False
    slope_scale: float = SLOPE_SCALE

    @cached_property
    def parameters(self) -> Array:
        """Columns of the parameters times their prior sd, shape (m, 13 + slopes)."""
        column = self.data.columns
        lever = (FORCES_N - MIDDLE_N)[:, None]
        own = [sd * column[name] for name, sd in PRIOR_SD.items()]
        own += [self.slope_scale * PRIOR_SD[name] / RANGE_N * lever * column[name] for name in self.slopes]
        return self.data.jacobian @ np.array([c.ravel() for c in own]).T

    @cached_property
    def fixed(self) -> Array:
        """Covariance of length, mount, force error and common mode, shape (m, m)."""
        one = (self.data.order == 0.0).astype(float)
        deflection: Array = np.sum([value * self.data.columns[name] for name, value in estimate().items()], axis=0)
        columns = [
            np.outer(np.full(len(FORCES_N), LENGTH_MM), one),
            MOUNT_MM_PER_BAR * np.outer(PRESSURES_BAR, one),
            GAIN * deflection,
        ]
        columns += [RANDOM_N * np.outer(circle, [1.0]) * deflection / FORCES_N[:, None] for circle in np.eye(len(FORCES_N))]
        if self.common_mode:
            curve = self.slope_scale * PRIOR_SD["C_XXX"] / RANGE_N * FORCES_N * (FORCES_N - MIDDLE_N)
            columns.append(np.outer(curve, one))
        return _square(self.data.jacobian @ np.array([c.ravel() for c in columns]).T)

    @cached_property
    def moving(self) -> dict[str, Array]:
        """Covariance per δ² (orders 0 and 1), κ² and τ² (orders from 2, divided by the order), each (m, m)."""
        order, circles = self.data.order, len(FORCES_N)
        setup = np.where(order == 1.0, 1.0, np.where(order == 0.0, float(self.zero_moves), 0.0))
        form = np.where(order >= 2.0, 1.0 / np.maximum(order, 1.0), 0.0)
        columns = {
            "delta": np.diag(np.tile(setup, circles)),
            "kappa": np.diag(np.tile(form, circles)),
            "tau": np.tile(np.diag(form), (circles, 1)),
        }
        return {name: _square(self.data.jacobian @ own) for name, own in columns.items()}

    def given(self, hyper_mm: Mapping[str, float]) -> tuple[float, Array, Array]:
        """ln p(numbers | φ) [nat]; mean and covariance of the parameters in prior sd."""
        noise = np.diag(self.data.sd**2) + self.fixed
        noise += np.sum([hyper_mm[name] ** 2 * own for name, own in self.moving.items()], axis=0)
        factor = cho_factor(noise, lower=True)
        weighted = cho_solve(factor, np.column_stack([self.parameters, self.data.values]))
        precision = np.eye(self.parameters.shape[1]) + self.parameters.T @ weighted[:, :-1]
        covariance = np.linalg.inv(precision)
        mean = covariance @ (self.parameters.T @ weighted[:, -1])
        square = self.data.values @ weighted[:, -1] - mean @ precision @ mean
        determinant = 2.0 * np.log(np.diag(factor[0])).sum() + np.linalg.slogdet(precision)[1]
        return -0.5 * (square + determinant + len(noise) * np.log(2.0 * np.pi)), mean, covariance

    def not_negative(self, mean: Array, covariance: Array) -> float:
        """P(C_XXX, C_YYY, C_CCY ≥ 0 at the lowest and the highest force), of mean and covariance in prior sd."""
        rows = []
        for name in NOT_NEGATIVE:
            for end in (-0.5, 0.5) if name in self.slopes else (0.0,):
                row = np.zeros(len(mean))
                row[list(PRIOR_SD).index(name)] = 1.0
                if end:
                    row[len(PRIOR_SD) + self.slopes.index(name)] = end * self.slope_scale
                rows.append(row)
        ends = np.array(rows)
        at, spread = ends @ mean, ends @ covariance @ ends.T
        open_ = at < 8.0 * np.sqrt(np.diag(spread))
        at, spread = at[open_], spread[np.ix_(open_, open_)]
        if len(at) < 2:
            return float(np.prod(norm.cdf(at / np.sqrt(np.diag(spread)))))
        return float(multivariate_normal.cdf(at, np.zeros(len(at)), spread))

    def evidence(self, grid: Mapping[str, Array] = GRID) -> dict[str, float]:
        """ln Z with truncation [nat], and posterior means of the hyper-parameters [mm]."""
        points = [dict(zip(grid, values, strict=True)) for values in product(*grid.values())]
        prior = np.array([sum(np.log(v) - 0.5 * (v / SCALE_MM[name]) ** 2 for name, v in point.items()) for point in points])
        found = [self.given(point) for point in points]
        joint = prior + np.array([own[0] for own in found])
        for k in np.flatnonzero(joint > joint.max() - _UNLIKELY):
            joint[k] += np.log(max(self.not_negative(*found[k][1:]), 1e-300))
        size = self.parameters.shape[1]
        total = logsumexp(joint)
        weight = np.exp(joint - total)
        means = {name: float(weight @ [point[name] for point in points]) for name in grid}
        return {
            "log_evidence": float(total - logsumexp(prior) - np.log(self.not_negative(np.zeros(size), np.eye(size)))),
            **means,
        }


def _square(columns: Array) -> Array:
    return columns @ columns.T


def scaled(factor: float) -> lb.Campaign:
    """The recovered experiment; what is synthetic and differs from circle to circle (sin 4θ, orders 5 to 12) times ``factor``."""
    angle = recovered().tests[0].angles_rad()
    basis = np.column_stack([np.sin(4.0 * angle), *(f(n * angle) for n in range(5, 13) for f in (np.cos, np.sin))])
    own = np.linalg.lstsq(basis, np.array([test.reading_um for test in recovered().tests]).T, rcond=None)[0]
    change = (factor - 1.0) * basis @ (own - own.mean(axis=1, keepdims=True))
    tests = (test.with_reading_um(test.reading_um + add) for test, add in zip(recovered().tests, change.T, strict=True))
    return replace(recovered(), tests=tuple(tests))


def measure() -> dict[str, Any]:
    """ln B of the printed numbers and of the shipped readings, the latter with the synthetic part scaled; slopes one by one."""
    data = printed_numbers()
    subsets = [own for size in range(len(COMPLIANCES) + 1) for own in combinations(COMPLIANCES, size)]
    every = {own: Model(data, own).evidence() for own in subsets}
    log_evidence = np.array([own["log_evidence"] for own in every.values()])
    probability = np.exp(log_evidence - logsumexp(log_evidence))
    least, most = every[()], every[COMPLIANCES]
    kept = {name: np.array([name in own for own in subsets]) for name in COMPLIANCES}
    stays = {own: Model(data, own, zero_moves=False).evidence()["log_evidence"] for own in ((), COMPLIANCES)}
    return {
        "numbers": len(data.values),
        "harmonics": data.jacobian.shape[1],
        "subsets": len(subsets),
        "log_bayes_factor": {
            ZERO_AND_CENTRE: most["log_evidence"] - least["log_evidence"],
            CENTRE: stays[COMPLIANCES] - stays[()],
        },
        "a zero that stays": {
            "constant": stays[()] - least["log_evidence"],
            "linear": stays[COMPLIANCES] - most["log_evidence"],
        },
        "kappa_um": {"constant": 1e3 * least["kappa"], "linear": 1e3 * most["kappa"]},
        "inclusion": {name: float(probability @ own) for name, own in kept.items()},
        "no_slope": float(probability[0]),
        "slope_scale": {
            f"{scale:g}": Model(data, COMPLIANCES, slope_scale=scale).evidence()["log_evidence"] - least["log_evidence"]
            for scale in SLOPE_SCALES
        },
        "parts": {ZERO_AND_CENTRE: parts(data), CENTRE: parts(data, zero_moves=False)},
        "of_readings": of_readings(),
        "scaled": {f"{factor:g}": with_scaled(factor) for factor in SCALES},
    }


def parts(data: Data, *, zero_moves: bool = True) -> dict[str, float]:
    """ln B over constant compliance [nat] of common mode, of some slopes, and of all."""
    equal = tuple(name.removesuffix("_1") for name in EQUAL)
    others = tuple(name for name in COMPLIANCES if name not in equal)
    models = {
        "common mode": Model(data, (), zero_moves, common_mode=True),
        "C_XXX_1 and C_YYY_1": Model(data, equal, zero_moves),
        "C_XYX_1": Model(data, ("C_XYX",), zero_moves),
        "the other four": Model(data, others, zero_moves),
        "common mode and the other four": Model(data, others, zero_moves, common_mode=True),
        "all six": Model(data, COMPLIANCES, zero_moves),
    }
    least = Model(data, (), zero_moves).evidence()["log_evidence"]
    return {name: own.evidence()["log_evidence"] - least for name, own in models.items()}


def of_readings() -> dict[str, float]:
    """ln B by the dense model, given all 150 harmonics of the shipped readings."""
    data = all_harmonics(recovered())
    found = [Model(data, own).evidence(GRID_OF_READINGS)["log_evidence"] for own in ((), COMPLIANCES)]
    return {"harmonics": len(data.values), "log_bayes_factor": found[1] - found[0]}


def with_scaled(factor: float) -> dict[str, Any]:
    """ln B of the readings by `lb.log_evidence`, κ and the two RMSE, with the synthetic part scaled."""
    campaign = scaled(factor)
    found: dict[str, Any] = {}
    for label in (ZERO_AND_CENTRE, CENTRE):
        least, most = (lb.log_evidence(ASSUMPTIONS[label](model), campaign, tolerance=1e-2) for model in MODELS.values())
        found[label] = lb.log_bayes_factor(most, least)[0]
    kappa = 1e3 * lb.marginals(MODELS["constant"], campaign, tolerance=1e-2).loc["kappa", "mean"]
    rmse = {name: lb.least_squares(campaign, degree).quality.rmse_um for degree, name in enumerate(MODELS)}
    return {**found, "kappa_um": kappa, "rmse_um": rmse}
