"""The dense textbook version of the model, in its first and its third edition.

It is written from the measurement model alone: nothing of ldbb_bayes is imported. Every test's
columns are evaluated at its own angles, the covariance of all readings is one n × n matrix,
hyper-parameters are integrated by importance sampling about the mode, and the truncation is by
rejection. Columns are typed in for the paper's machine: tool at x = R cos θ, y = R sin θ. Another
machine, of several planes, is given with its columns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy import linalg, optimize, special, stats

# Parameters of interest with their prior sd: compliances [mm/N …] and geometric errors.
INTEREST = ["C_XXX", "C_XYX", "C_YYY", "C_CXY", "C_CYY", "C_CCY"]
GEOMETRIC = ["E_XX1", "E_YX2", "E_XY2", "E_YY1", "E_C0YX", "E_Xt0", "E_Yt0"]
SD_C = np.array([1e-4, 1e-5, 1e-4, 1e-7, 1e-7, 1e-9])
SD_E = np.array([2e-4, 1e-6, 1e-6, 2e-4, 5e-5, 0.02, 0.02])
TERMS = {"first": ("form", "length", "mount", "force", "setup", "discrepancy")}
TERMS["third"] = (
    *TERMS["first"],
    "pattern",
    "joint",
    "position",
    "angle",
    "hysteresis",
    "drift",
    "circle",
)
# Scales of the half-normal priors [mm].
SCALES = {"first": {"sigma": 1e-3, "delta": 1e-3, "kappa": 1e-3, "tau": 5e-3}}
SCALES["third"] = SCALES["first"] | {"tau": 1.5e-3, "omega": 1.5e-3, "eta": 2e-3}
# Steps from least squares to the estimate about which the third edition is linearised.
STEPS = 3
# Order to which the derivative of a trigonometric polynomial is exact.
RIESZ_ORDER = 8
# Order of the hyper-parameters that circles share.
HYPERS = ("sigma", "delta", "kappa", "tau", "p", "omega", "eta")
# Exponent p of the balls' form: a normal prior between two limits.
P_MEAN = 2.0
P_SD = 0.7
P_LIMITS = (0.5, 3.5)
# The compliances that must not be negative: C_XXX, C_YYY and C_CCY.
PHYSICAL = (0, 2, 5)
# Uniform numbers keep this distance from zero and one.
LEAST_UNIFORM = 1e-12
# Hyper-parameters by name, or in the order of Oracle.hypers.
Phi = Mapping[str, float] | np.ndarray


@dataclass
class OracleTest:
    """One circular test: N, bar, rad and mm."""

    force: float
    pressure: float
    angle: np.ndarray
    reading: np.ndarray
    work: float = 0.0
    tool: float = 0.0
    radius: float = 150.0
    direction: float = 1.0  # CW or not stated +1, CCW −1
    plane: str = "XY"
    time: float | None = None  # seconds


@dataclass
class OracleMachine:
    """Columns of compliances (per unit force) and geometric errors at an angle of every reading."""

    compliances: list[str]
    errors: list[str]
    compliance: Callable[[np.ndarray], np.ndarray]
    geometric: Callable[[np.ndarray], np.ndarray]


@dataclass
class Estimate:
    """Ĉ with u(Ĉ), and Ê."""

    compliance: np.ndarray
    sd: np.ndarray
    geometric: np.ndarray

    @property
    def size(self) -> np.ndarray:
        return np.hypot(self.compliance, self.sd)


@dataclass
class Stated:
    """What certificates state; a U is expanded, k = 2.

    The defaults are what the model assumes where nothing is stated.
    """

    # Sphericity S by ball.
    sphericity_um: dict[str, float] = field(default_factory=dict)
    # Amplitude, phase [deg] and U by ball and order.
    harmonics_um: dict[str, dict[int, tuple[float, float, float]]] = field(default_factory=dict)
    length_error_um: float = 0.0
    length_U_um: float = 18.8
    mount_um_per_bar: float = 2.33
    mount_U_percent: float = 20.0
    force_U_percent: float = 2.0
    linearity_percent: float = math.sqrt(3.0)
    random_N: float = 4.0
    angle_U_deg: float = 0.2


class Conditional(NamedTuple):
    """ln p(y | φ), mean and covariance of β given y and φ."""

    log_evidence: float
    mean: np.ndarray
    covariance: np.ndarray


class Proposals(NamedTuple):
    """Points of ln φ, ln p(y, φ) over their density, and β given φ of those inside the prior."""

    log_phi: np.ndarray
    log_weight: np.ndarray
    conditional: list[Conditional]


def compliance_columns(theta: np.ndarray, R: np.ndarray) -> np.ndarray:
    c = np.cos(theta)
    s = np.sin(theta)
    return np.stack([c**2, c * s, s**2, R * c**2 * s, R * c * s**2, R**2 * c**2 * s**2], axis=1)


def geometric_columns(theta: np.ndarray, R: np.ndarray) -> np.ndarray:
    c = np.cos(theta)
    s = np.sin(theta)
    return np.stack([R * c**2, R**2 * c**2 * s, R**2 * s**2 * c, R * s**2, R * c * s, c, s], axis=1)


def sd_of_compliance(name: str) -> float:
    """Prior sd of C_XXX, C_XYX, C_CXY, C_CCY and their like."""
    rotations = sum(letter in "ABC" for letter in name[2:4])
    if rotations:
        return (1e-7, 1e-9)[rotations - 1]
    return 1e-4 if name[2] == name[3] else 1e-5


def sd_of_error(name: str) -> float:
    """Prior sd of E_XX1, E_YX2, E_C0YX, E_Xt0 and their like."""
    if name[3] == "0":
        return 5e-5
    if name[3:5] == "t0":
        return 0.02
    return 2e-4 if name.endswith("1") else 1e-6


def derivative(function: Callable[[np.ndarray], np.ndarray], theta: np.ndarray) -> np.ndarray:
    """Of a trigonometric polynomial: Riesz' interpolation formula, exact to order 8."""
    total = np.zeros(len(theta))
    for k in range(1, 2 * RIESZ_ORDER + 1):
        step = (2 * k - 1) * np.pi / (2 * RIESZ_ORDER)
        weight = (-1.0) ** (k + 1) / (4.0 * RIESZ_ORDER * np.sin(step / 2.0) ** 2)
        total = total + weight * function(theta + step)
    return total


def waves(order: int, angle: np.ndarray) -> np.ndarray:
    """cos nθ and sin nθ; of order 0 a column of ones."""
    if order == 0:
        return np.ones((len(angle), 1))
    return np.stack([np.cos(order * angle), np.sin(order * angle)], axis=1)


@cache
def spectrum_of_power(power: float) -> np.ndarray:
    """Coefficients of cos nθ in |cos θ|^power, n = 0 to 12, by the midpoint rule."""
    grid = (np.arange(2**16) + 0.5) * np.pi / 2**15
    values = np.abs(np.cos(grid)) ** power
    spectrum = np.array([np.mean(values * np.cos(n * grid)) for n in range(13)])
    spectrum[1:] *= 2.0
    return spectrum


def projected_power(power: float, angle: np.ndarray) -> np.ndarray:
    """|cos θ|^power without its Fourier orders above 12."""
    return np.cos(np.outer(angle, np.arange(13))) @ spectrum_of_power(power)


def inside_unit_interval(uniform: np.ndarray) -> np.ndarray:
    return np.clip(uniform, LEAST_UNIFORM, 1.0 - LEAST_UNIFORM)


def log_probability_inside(conditional: Conditional, rows: np.ndarray, normal: np.ndarray) -> float:
    """ln P(rows · β ≥ 0) as the share of standard normal points (draws, rows) inside."""
    root = np.linalg.cholesky(rows @ conditional.covariance @ rows.T)
    inside = (rows @ conditional.mean + normal @ root.T >= 0.0).all(axis=1)
    return float(np.log(max(inside.mean(), 1e-300)))


def is_clocked(angle: np.ndarray) -> bool:
    """Whether the clocking of a ball differs between readings."""
    return bool(np.abs(np.exp(1j * (angle - angle[0])) - 1.0).max() > 1e-9)


@dataclass
class Oracle:
    """The model of one campaign.

    ``terms`` lists the nuisances that are on, by default all those of the edition.
    """

    tests: list[OracleTest]
    degree: int
    terms: tuple[str, ...] | None = None
    compensated: bool = True
    resolution: float = 0.24e-3
    truncated: bool = True
    # Prior mean and sd by parameter.
    given_priors: dict[str, tuple[float, float]] = field(default_factory=dict)
    edition: str = "first"
    stated: Stated = field(default_factory=Stated)
    machine: OracleMachine | None = None
    order: str | None = None  # "random": the listed order of tests is no time
    drift: bool = True
    given_estimate: Estimate | None = None
    names: list[str] = field(init=False)

    def __post_init__(self) -> None:
        if self.terms is None:
            self.terms = TERMS[self.edition]
        self._join_tests()
        self._build_columns()
        self.grams: dict[tuple[tuple[str, ...], int], np.ndarray] = {
            ((), 0): np.zeros((self.y.size, self.y.size))
        }
        add_term = {
            "form": self._form,
            "length": self._length,
            "mount": self._mount,
            "force": self._force,
            "setup": self._setup,
            "discrepancy": self._discrepancy,
            "pattern": self._pattern,
            "joint": self._joint,
            "position": self._position,
            "angle": self._angle,
            "hysteresis": self._hysteresis,
            "drift": self._drift,
        }
        for term in self.terms:
            if term != "circle":
                add_term[term]()
        self.hypers = self._list_hypers()
        self.scales = np.array([SCALES[self.edition].get(name, 1.0) for name in self.hypers])

    def _join_tests(self) -> None:
        """Join the readings of all tests, and repeat what is stated of a test for each of them."""
        self.theta = np.concatenate([test.angle for test in self.tests])
        self.y = np.concatenate([test.reading for test in self.tests])
        self.force = self._repeat([test.force for test in self.tests])
        self.pressure = self._repeat([test.pressure for test in self.tests])
        self.radius = self._repeat([test.radius for test in self.tests])
        self.travel = self._repeat([test.direction for test in self.tests])
        self.work = self._repeat([test.work for test in self.tests])
        self.tool = self._repeat([test.tool for test in self.tests])
        self.circle = self._repeat(list(range(len(self.tests))))
        self.plane = np.array([test.plane for test in self.tests])[self.circle]
        if not self.compensated:
            self.y = self.y - 1e-3 * self.stated.mount_um_per_bar * self.pressure
        self.unique = np.unique(self.force)
        self.reference = 0.5 * (self.force.min() + self.force.max())
        self.span = np.ptp(self.force)
        self.largest = self.force.max()
        self.bow = 4.0 * (self.force / self.largest) * (1.0 - self.force / self.largest)

    def _repeat(self, values: list[float]) -> np.ndarray:
        return np.repeat(values, [test.angle.size for test in self.tests])

    def _build_columns(self) -> None:
        """Build the columns of the parameters of interest, and their priors."""
        if self.machine is None:
            self.machine = OracleMachine(
                INTEREST,
                GEOMETRIC,
                lambda theta: compliance_columns(theta, self.radius),
                lambda theta: geometric_columns(theta, self.radius),
            )
        sd_c = np.array([sd_of_compliance(name) for name in self.machine.compliances])
        sd_e = np.array([sd_of_error(name) for name in self.machine.errors])
        self.compliance = self.machine.compliance(self.theta)
        elastic = self.force[:, None] * self.compliance
        geometric = self.machine.geometric(self.theta)
        self.known = self._estimate(np.hstack([elastic, geometric]), np.concatenate([sd_c, sd_e]))
        self.estimate = np.concatenate([self.known.compliance, self.known.geometric])
        size = sd_c
        if self.edition != "first":
            size = np.maximum(self.known.size, sd_c / 20.0)
        slopes = []
        slope_sd = []
        slope_names = []
        for k in range(1, self.degree + 1):
            slopes.append(((self.force - self.reference) ** k)[:, None] * elastic)
            slope_sd.append(0.3 * size / self.span**k)
            slope_names += [f"{name}_{k}" for name in self.machine.compliances]
        self.J = np.hstack([elastic, *slopes, geometric])
        self.sd = np.concatenate([sd_c, *slope_sd, sd_e])
        self.names = self.machine.compliances + slope_names + self.machine.errors
        self.mean = np.zeros(self.sd.size)
        for name, (mean, sd) in self.given_priors.items():
            j = self.names.index(name)
            self.mean[j] = mean
            self.sd[j] = sd

    def _estimate(self, constant: np.ndarray, scale: np.ndarray) -> Estimate:
        """Ĉ, u(Ĉ) and Ê: of least squares, or in the third edition by fixed point from there."""
        if self.given_estimate is not None:
            return self.given_estimate
        count = self.compliance.shape[1]
        value = np.linalg.pinv(constant * scale, rcond=1e-10) @ self.y * scale
        estimate = Estimate(value[:count], np.zeros(count), value[count:])
        if self.edition != "third":
            return estimate
        degree = min(1, self.degree)
        for _ in range(STEPS):  # each about the estimate of the last
            reference = replace(
                self, degree=degree, given_estimate=estimate, given_priors=self._priors_to(degree)
            )
            posterior = reference.given(reference.medians())
            sd = np.sqrt(np.diag(posterior.covariance))
            errors = len(posterior.mean) - len(scale) + count
            estimate = Estimate(posterior.mean[:count], sd[:count], posterior.mean[errors:])
        return estimate

    def _priors_to(self, degree: int) -> dict[str, tuple[float, float]]:
        """The given priors without those of slopes of higher degrees."""
        higher = tuple(f"_{k}" for k in range(degree + 1, 3))
        return {name: prior for name, prior in self.given_priors.items() if name[-2:] not in higher}

    def medians(self) -> dict[str, float]:
        """The prior medians of the hyper-parameters."""
        medians = {}
        for name, scale in zip(self.hypers, self.scales, strict=True):
            if name == "p":
                medians[name] = P_MEAN  # the limits are as far on either side
            elif name.startswith("lambda"):
                medians[name] = math.sqrt(stats.invgamma.median(1.5, scale=1.5))
            else:
                floor = self.resolution / np.sqrt(12.0) if name == "sigma" else 0.0
                above = stats.halfnorm.sf(floor, scale=scale)
                medians[name] = float(stats.halfnorm.isf(0.5 * above, scale=scale))
        return medians

    def axes(self) -> list[tuple[np.ndarray, np.ndarray, float]]:
        """Of every driven axis: its angle in every reading, whether it is in the plane, Ĉ_aa."""
        axes = []
        for axis in "XYZ":
            in_plane = np.array([axis in plane for plane in self.plane])
            if in_plane.any():
                second = np.array([plane[1] == axis for plane in self.plane])
                size = self.known.size[self.machine.compliances.index(f"C_{axis}{axis}{axis}")]
                axes.append((self.theta - np.pi / 2.0 * second, in_plane, size))
        return axes

    def _list_hypers(self) -> list[str]:
        """The hyper-parameters that the terms need, in their order."""
        needed = {"sigma"}
        for hypers, order in self.grams:
            needed.update(hypers)
            if order:
                needed.add("p")
        names = [name for name in HYPERS if name in needed]
        for r in range(len(self.tests)):
            names += [name for name in self._circle_scale(r) if name in needed]
        return names

    def _add(self, columns: np.ndarray, sd: float, *hypers: str, order: int = 0) -> None:
        """Add coefficients of standard deviation sd × hyper-parameters × (order/6)^−p.

        The last factor where an order is stated.
        """
        scaled = columns.reshape(self.y.size, -1) * sd
        self.grams[hypers, order] = self.grams.get((hypers, order), 0.0) + scaled @ scaled.T

    def _circle_scale(self, r: int) -> tuple[str, ...]:
        """The name of the scale λ of a circle, if it has one."""
        if "circle" in self.terms and len(self.tests) >= 4:
            return (f"lambda_{r + 1}",)
        return ()

    def _form(self) -> None:
        self._form_of_ball("work", self.theta - self.work)
        self._form_of_ball("tool", self.theta + np.pi - self.tool)

    def _form_of_ball(self, ball: str, angle: np.ndarray) -> None:
        certified = self.stated.harmonics_um.get(ball, {})
        for n in certified:
            amplitude, phase, _ = certified[n]
            self.y = self.y - 1e-3 * amplitude * np.cos(n * (angle - np.deg2rad(phase)))
        for plane in np.unique(self.plane):
            for n in range(2, 13):
                columns = (self.plane == plane)[:, None] * waves(n, angle)
                if n in certified:
                    self._add(columns, 0.5e-3 * certified[n][2])
                elif self.edition == "first":
                    self._add(columns, math.sqrt(0.5) / n, "tau")
                else:
                    self._form_of_order(ball, n, columns)

    def _form_of_order(self, ball: str, n: int, columns: np.ndarray) -> None:
        """Of which no harmonic is certified: what is stated bounds the ball at every order."""
        stated_um = self.stated.sphericity_um.get(ball)
        sphericity = 1e-3 * (2.5 if stated_um is None else stated_um) / math.sqrt(24.0)
        if stated_um is not None:
            self._add(columns, sphericity * min(1.0, 3.0 / n))
            return
        self._add(columns, math.sqrt(0.5), "tau", order=n)
        if n in (2, 3):
            self._add(columns, sphericity)

    def _pattern(self) -> None:
        """Add a pattern of the circle where a ball is clocked: by plane, direction and radius.

        So it is where anything is stated of a ball's form.
        """
        stated = bool(self.stated.sphericity_um) or bool(self.stated.harmonics_um)
        if not (stated or is_clocked(self.work) or is_clocked(self.tool)):
            return
        for travel, radius, plane in set(zip(self.travel, self.radius, self.plane, strict=True)):
            readings = (self.travel == travel) & (self.radius == radius) & (self.plane == plane)
            for n in range(4, 13):
                self._add(readings[:, None] * waves(n, self.theta), 1.0, "omega", order=n)

    def _length(self) -> None:
        self.y = self.y - 1e-3 * self.stated.length_error_um
        for radius in np.unique(self.radius):
            self._add(self.radius == radius, 0.5e-3 * self.stated.length_U_um)

    def _mount(self) -> None:
        relative_sd = self.stated.mount_U_percent / 200.0
        self._add(self.pressure, 1e-3 * self.stated.mount_um_per_bar * relative_sd)
        if self.edition != "first":
            self._add(self.bow, 0.5e-3)

    def _force(self) -> None:
        deflection = self.compliance @ self.known.compliance
        self._add(self.force * deflection, self.stated.force_U_percent / 200.0)
        if self.edition != "first":
            linearity_sd = self.stated.linearity_percent / 100.0 / math.sqrt(3.0)
            self._add(self.largest * self.bow * deflection, linearity_sd)
        for r in range(len(self.tests)):
            self._add((self.circle == r) * deflection, self.stated.random_N)

    def joint_columns(self) -> list[tuple[np.ndarray, float]]:
        """Three of every axis, with their sd."""
        columns = []
        force = self.force
        share = 0.4
        for angle, in_plane, size in self.axes():
            square = np.cos(angle) ** 2
            stiffening = force * projected_power(3.0, angle) - self.reference * square
            columns.append((in_plane * force * stiffening / self.largest, share * size))
            contact_force = force ** (2 / 3) * self.reference ** (1 / 3)
            contact = contact_force * projected_power(5 / 3, angle)
            columns.append((in_plane * (contact - force * square), share * size))
            columns.append((in_plane * (contact_force - force) * square, share * size))
        return columns

    def _joint(self) -> None:
        for column, sd in self.joint_columns():
            self._add(column, sd)

    def _position(self) -> None:
        """All circles about one centre; places on an axis in units of the smallest radius."""
        for angle, in_plane, size in self.axes():
            u = in_plane * np.cos(angle)
            x = self.radius / self.radius.min() * u
            self._add(self.force * u**2 * x, 0.07 * size)
            self._add(self.force * u**2 * (x**2 - 0.5), 0.04 * size)

    def _angle(self) -> None:
        def fitted(theta: np.ndarray) -> np.ndarray:
            elastic = self.force * (self.machine.compliance(theta) @ self.known.compliance)
            return elastic + self.machine.geometric(theta) @ self.known.geometric

        slope = derivative(fitted, self.theta)
        for column in (slope, self.travel * slope):
            self._add(column, np.deg2rad(self.stated.angle_U_deg / 2.0))

    def _setup(self) -> None:
        for r in range(len(self.tests)):
            for n in (0, 1):
                self._add(self._waves_of_circle(r, n), 1.0, "delta", *self._circle_scale(r))

    def _discrepancy(self) -> None:
        for r in range(len(self.tests)):
            for n in range(2, 13):
                self._add(self._waves_of_circle(r, n), 1.0 / n, "kappa", *self._circle_scale(r))

    def _waves_of_circle(self, r: int, order: int) -> np.ndarray:
        return (self.circle == r)[:, None] * waves(order, self.theta)

    def _hysteresis(self) -> None:
        for plane in np.unique(self.plane):
            in_plane = self.plane == plane
            if np.ptp(self.travel[in_plane]):  # both directions are run
                for n in range(13):
                    columns = (in_plane * self.travel)[:, None] * waves(n, self.theta)
                    self._add(columns, 1.0 / max(n, 1), "eta")
                    self._add(self.force[:, None] * columns, 2e-6 / max(n, 1))
            else:
                for n in range(4):
                    columns = (in_plane * self.travel)[:, None] * waves(n, self.theta)
                    self._add(columns, 2e-3 / max(n, 1))
                    self._add(self.force[:, None] * columns, 1.2e-6 / max(n, 1))

    def hours(self) -> np.ndarray | None:
        """Of every test, from the campaign's mean: as all tests state, else as they are listed."""
        if not self.drift:
            return None
        times = [test.time for test in self.tests]
        if None not in times:
            hours = np.array(times, dtype=float) / 3600.0
        elif self.order == "random":
            return None
        else:
            hours = 0.1 * np.arange(len(times))
        return hours - hours.mean()

    def _drift(self) -> None:
        hours = self.hours()
        if hours is None:
            return
        u = hours[self.circle]
        self._add(u, 2e-3)
        for angle, in_plane, _ in self.axes():
            self._add(u * in_plane * np.cos(angle), 5e-3)

    def by_name(self, phi: Phi) -> Mapping[str, float]:
        """Hyper-parameters by their names."""
        if isinstance(phi, Mapping):
            return phi
        return dict(zip(self.hypers, phi, strict=True))

    def shared(self, phi: Phi) -> np.ndarray:
        """Covariance without what is separate for every test: set-up shift, discrepancy, noise."""
        return self._sum(phi, [key for key in self.grams if not {"delta", "kappa"} & set(key[0])])

    def covariance(self, phi: Phi) -> np.ndarray:
        """Covariance of all readings given β and φ."""
        noise = self.by_name(phi)["sigma"] ** 2 * np.eye(self.y.size)
        return self._sum(phi, list(self.grams)) + noise

    def _sum(self, phi: Phi, keys: list[tuple[tuple[str, ...], int]]) -> np.ndarray:
        """Sum of these Gram matrices times their hyper-parameters squared."""
        value = self.by_name(phi)
        total = np.zeros((self.y.size, self.y.size))
        for hypers, order in keys:
            scale = math.prod(value[name] for name in hypers)
            if order:
                scale *= (order / 6.0) ** -value["p"]
            total = total + scale**2 * self.grams[hypers, order]
        return total

    def log_likelihood(self, phi: Phi, beta: Mapping[str, float] | np.ndarray) -> float:
        """ln p(y | β, φ)."""
        if isinstance(beta, Mapping):
            beta = np.array([beta[name] for name in self.names])
        return float(stats.multivariate_normal(self.J @ beta, self.covariance(phi)).logpdf(self.y))

    def log_prior(self, phi: Phi) -> float:
        """Of σ, δ, κ, τ, p, ω, η and λ themselves."""
        value = self.by_name(phi)
        floor = self.resolution / np.sqrt(12.0)
        if value["sigma"] < floor:
            return -np.inf
        total = 0.0
        for name, scale in zip(self.hypers, self.scales, strict=True):
            if name == "p":
                limits = [(limit - P_MEAN) / P_SD for limit in P_LIMITS]
                total += stats.truncnorm.logpdf(value[name], *limits, loc=P_MEAN, scale=P_SD)
            elif name.startswith("lambda"):
                log_density = stats.invgamma.logpdf(value[name] ** 2, 1.5, scale=1.5)
                total += log_density + np.log(2.0 * value[name])
            else:
                total += stats.halfnorm.logpdf(value[name], scale=scale)
        return float(total - stats.halfnorm.logsf(floor, scale=self.scales[0]))

    def phi(self, free: np.ndarray) -> np.ndarray:
        """From ln φ; of p from its logit within its limits."""
        is_p = np.array(self.hypers) == "p"
        low, high = P_LIMITS
        p = low + (high - low) * special.expit(free)
        return np.where(is_p, p, np.exp(np.where(is_p, 0.0, free)))

    def log_prior_of_log(self, free: np.ndarray) -> float:
        """Of ln φ and logit p.

        Beyond 30 scales is next to nothing, and the dense covariance too ill-conditioned.
        """
        phi = self.phi(free)
        if np.any(phi > 30.0 * self.scales):
            return -np.inf
        low, high = P_LIMITS
        is_p = np.array(self.hypers) == "p"
        jacobian = np.where(is_p, (phi - low) * (high - phi) / (high - low), phi)
        return self.log_prior(phi) + float(np.log(jacobian).sum())

    def given(self, phi: Phi) -> Conditional:
        """ln p(y | φ), mean and covariance of β given y, φ; truncation aside."""
        root = linalg.cholesky(self.covariance(phi), lower=True)
        columns = np.column_stack([self.J * self.sd, self.y - self.J @ self.mean])
        white = linalg.solve_triangular(root, columns, lower=True)
        white_j = white[:, :-1]
        white_y = white[:, -1]
        precision = white_j.T @ white_j + np.eye(self.sd.size)
        covariance = np.linalg.inv(precision)
        mean = covariance @ (white_j.T @ white_y)
        quadratic = white_y @ white_y - mean @ precision @ mean
        log_det = 2 * np.log(np.diag(root)).sum() + np.linalg.slogdet(precision)[1]
        log_evidence = -0.5 * (quadratic + log_det + self.y.size * np.log(2 * np.pi))
        return Conditional(
            float(log_evidence),
            self.mean + mean * self.sd,
            covariance * np.outer(self.sd, self.sd),
        )

    def inside(self, beta: np.ndarray) -> np.ndarray:
        """Whether C_XXX(F), C_YYY(F), C_CCY(F) ≥ 0 at every tested force."""
        holds = np.ones(beta.shape[:-1], dtype=bool)
        for j in PHYSICAL:
            for force in self.unique:
                compliance = 0.0
                for k in range(self.degree + 1):
                    compliance = compliance + beta[..., 6 * k + j] * (force - self.reference) ** k
                holds &= compliance >= 0
        return holds

    def posterior(
        self, *, points: int = 400, draws: int = 200, seed: int = 0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Draws of (β, φ) and their weights: importance sampling of ln φ from a wide Student-t."""
        rng = np.random.default_rng(seed)
        centre, spread = self._locate(rng)
        standard = stats.t.rvs(5, size=(points, len(centre)), random_state=rng)
        proposals = self._propose(centre, 1.1 * spread, standard)
        finite = np.isfinite(proposals.log_weight)
        log_weight = proposals.log_weight[finite]
        relative_weight = np.exp(log_weight - log_weight.max())
        samples = []
        weights = []
        for k, log_phi in enumerate(proposals.log_phi[finite]):
            _, mean, covariance = proposals.conditional[k]
            root = np.linalg.cholesky(covariance / np.outer(self.sd, self.sd))
            beta = mean + (rng.standard_normal((draws, self.sd.size)) @ root.T) * self.sd
            samples.append(np.hstack([beta, np.tile(self.phi(log_phi), (draws, 1))]))
            counts = self.inside(beta) if self.truncated else np.ones(draws)
            weights.append(relative_weight[k] * counts)
        return np.concatenate(samples), np.concatenate(weights) / np.sum(weights)

    def _propose(self, centre: np.ndarray, spread: np.ndarray, standard: np.ndarray) -> Proposals:
        """Student-t points about a centre, weighted; weights outside the prior are −inf."""
        log_phi = centre + standard @ spread.T
        log_volume = np.log(np.abs(np.linalg.det(spread)))
        log_proposal = stats.t.logpdf(standard, 5).sum(axis=1) - log_volume
        target = np.array([self.log_prior_of_log(point) for point in log_phi])
        conditional = []
        for k in np.flatnonzero(np.isfinite(target)):
            of_phi = self.given(self.phi(log_phi[k]))
            target[k] += of_phi.log_evidence
            conditional.append(of_phi)
        return Proposals(log_phi, target - log_proposal, conditional)

    def log_evidence(
        self, *, points: int = 4096, draws: int = 64, seed: int = 0
    ) -> tuple[float, float]:
        """ln Z, truncation included where it is on, and its standard error.

        Quasi-random importance sampling about the mode, in four independent rounds.
        """
        rng = np.random.default_rng(seed)
        centre, spread = self._locate(rng)
        rows = self._rows()
        uniform_draws = stats.qmc.Sobol(len(rows), rng=rng).random(draws)
        rounds = []
        for _ in range(4):
            uniform = stats.qmc.Sobol(len(centre), rng=rng).random(points // 4)
            standard = stats.t(5).ppf(inside_unit_interval(uniform))
            proposals = self._propose(centre, spread, standard)
            log_weight = proposals.log_weight
            if self.truncated:
                finite = np.flatnonzero(np.isfinite(log_weight))
                for k, conditional in zip(finite, proposals.conditional, strict=True):
                    turned = (uniform_draws + rng.random(len(rows))) % 1.0
                    normal = special.ndtri(inside_unit_interval(turned))
                    log_weight[k] += log_probability_inside(conditional, rows, normal)
            rounds.append(np.logaddexp.reduce(log_weight) - np.log(points // 4))
        value = float(np.logaddexp.reduce(rounds) - np.log(4))
        error = float(np.std(np.exp(np.array(rounds) - value), ddof=1) / 2.0)
        return value - self._log_prob_prior(), error

    def _rows(self) -> np.ndarray:
        """C_XXX(F), C_YYY(F), C_CCY(F) at the least and the greatest force, for degrees 0 and 1."""
        forces = self.unique[[0, -1]] if self.degree else self.unique[:1]
        rows = []
        for j in PHYSICAL:
            for force in forces:
                row = np.zeros(self.sd.size)
                row[j] = 1.0
                if self.degree:
                    row[6 + j] = force - self.reference
                rows.append(row)
        return np.array(rows)

    def _log_prob_prior(self) -> float:
        """ln P(T): for three compliances, ½ at degree 0.

        At degree 1 two half-planes of known correlation.
        """
        if not self.truncated:
            return 0.0
        if self.mean.any():
            return self._log_prob_about_mean()
        if self.degree == 0:
            return 3.0 * np.log(0.5)
        total = 0.0
        for j in PHYSICAL:
            ratio = (self.sd[6 + j] * self.span / 2.0 / self.sd[j]) ** 2
            angle = np.arcsin((1.0 - ratio) / (1.0 + ratio))
            total += np.log(0.25 + angle / (2.0 * np.pi))
        return float(total)

    def _log_prob_about_mean(self) -> float:
        """ln P(T) of prior means other than zero, compliance by compliance."""
        rows = self._rows()
        forces = 2 if self.degree else 1
        total = 0.0
        for first in range(0, len(rows), forces):
            pair = rows[first : first + forces]
            covariance = (pair * self.sd**2) @ pair.T
            distribution = stats.multivariate_normal(-pair @ self.mean, covariance)
            total += distribution.logcdf(np.zeros(forces))
        return total

    def _locate(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Where the posterior of ln φ lies, and a root of its covariance.

        From a first round of importance sampling.
        """

        def negative(log_phi: np.ndarray) -> float:
            prior = self.log_prior_of_log(log_phi)
            if not np.isfinite(prior):
                return 1e10
            return -(prior + self.given(self.phi(log_phi)).log_evidence)

        centre = optimize.minimize(negative, np.log(0.3 * self.scales), method="Powell").x
        h = len(centre)
        spread = 0.5 * np.eye(h)
        for temperature in (30.0, 10.0, 3.0, 1.0, 1.0):
            standard = stats.t.rvs(5, size=(75 * h, h), random_state=rng)
            proposals = self._propose(centre, spread, standard)
            log_weight = proposals.log_weight
            share = np.exp((log_weight - log_weight.max()) / temperature)
            share /= share.sum()
            centre = share @ proposals.log_phi
            centred = proposals.log_phi - centre
            covariance = (share[:, None] * centred).T @ centred
            spread = np.linalg.cholesky(covariance + 1e-4 * np.eye(h))
        return centre, spread
