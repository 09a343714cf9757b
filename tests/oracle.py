"""The dense textbook version of the model, written from the measurement model alone, in both its
editions.

Nothing of ldbb_bayes is imported. Every test's columns are evaluated at its own angles, the
covariance of all readings is one n × n matrix, hyper-parameters are integrated by importance
sampling about the mode, the truncation is by rejection. Columns are typed in for the paper's
machine: tool at x = R cos θ, y = R sin θ.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from scipy import linalg, optimize, special, stats

INTEREST = ["C_XXX", "C_XYX", "C_YYY", "C_CXY", "C_CYY", "C_CCY"]
GEOMETRIC = ["E_XX1", "E_YX2", "E_XY2", "E_YY1", "E_C0YX", "E_Xt0", "E_Yt0"]
SD_C = np.array([1e-4, 1e-5, 1e-4, 1e-7, 1e-7, 1e-9])
SD_E = np.array([2e-4, 1e-6, 1e-6, 2e-4, 5e-5, 0.02, 0.02])
TERMS = {"first": ("form", "length", "mount", "force", "setup", "discrepancy")}
TERMS["second"] = (*TERMS["first"], "pattern", "joint", "position", "angle", "hysteresis", "circle")
SCALES = {
    "first": {"sigma": 1e-3, "delta": 1e-3, "kappa": 1e-3, "tau": 5e-3}
}  # of half-normal priors, mm
SCALES["second"] = SCALES["first"] | {"tau": 1.5e-3, "omega": 1.5e-3, "eta": 2e-3}
Phi = Mapping[str, float] | np.ndarray  # by name, or in the order of Oracle.hypers


@dataclass
class OracleTest:
    force: float
    pressure: float
    angle: np.ndarray  # rad
    reading: np.ndarray  # mm
    work: float = 0.0  # rad
    tool: float = 0.0
    radius: float = 150.0
    direction: float = 1.0  # CW or not stated +1, CCW −1


@dataclass
class Stated:
    """What is known of the parts; a U is expanded, k = 2. The defaults are what the model assumes
    where nothing is stated."""

    sphericity_um: dict[str, float] = field(default_factory=dict)  # ball -> S
    harmonics_um: dict[str, dict[int, tuple[float, float, float]]] = field(
        default_factory=dict
    )  # amplitude, phase (deg), U
    length_error_um: float = 0.0
    length_U_um: float = 18.8
    mount_um_per_bar: float = 2.33
    mount_U_percent: float = 20.0
    force_U_percent: float = 2.0
    linearity_percent: float = math.sqrt(3.0)
    random_N: float = 4.0
    angle_U_deg: float = 0.2


def compliance_columns(theta: np.ndarray, R: np.ndarray) -> np.ndarray:
    c = np.cos(theta)
    s = np.sin(theta)
    return np.stack([c**2, c * s, s**2, R * c**2 * s, R * c * s**2, R**2 * c**2 * s**2], axis=1)


def geometric_columns(theta: np.ndarray, R: np.ndarray) -> np.ndarray:
    c = np.cos(theta)
    s = np.sin(theta)
    return np.stack([R * c**2, R**2 * c**2 * s, R**2 * s**2 * c, R * s**2, R * c * s, c, s], axis=1)


def waves(order: int, angle: np.ndarray) -> np.ndarray:
    """cos nθ and sin nθ; of order 0 a column of ones."""
    return np.stack([np.cos(order * angle), np.sin(order * angle)][: 2 if order else 1], axis=1)


@cache
def spectrum_of_power(power: float) -> np.ndarray:
    """Coefficients of cos nθ in |cos θ|^power, n = 0 to 12, by the midpoint rule."""
    grid = (np.arange(2**16) + 0.5) * np.pi / 2**15
    return np.array(
        [
            np.mean(np.abs(np.cos(grid)) ** power * np.cos(n * grid)) * (2.0 if n else 1.0)
            for n in range(13)
        ]
    )


def projected_power(power: float, angle: np.ndarray) -> np.ndarray:
    """|cos θ|^power without its Fourier orders above 12."""
    return np.cos(np.outer(angle, np.arange(13))) @ spectrum_of_power(power)


@dataclass
class Oracle:
    """The model of one campaign; ``terms`` lists the nuisances that are on, all those of the
    edition by default."""

    tests: list[OracleTest]
    degree: int
    terms: tuple[str, ...] | None = None
    compensated: bool = True
    resolution: float = 0.24e-3
    truncated: bool = True
    given_priors: dict[str, tuple[float, float]] = field(
        default_factory=dict
    )  # parameter -> prior mean and sd
    edition: str = "first"
    stated: Stated = field(default_factory=Stated)
    names: list[str] = field(init=False)

    def __post_init__(self) -> None:
        self.terms = TERMS[self.edition] if self.terms is None else self.terms
        sizes = [t.angle.size for t in self.tests]
        self.theta, self.y = (
            np.concatenate([getattr(t, name) for t in self.tests]) for name in ("angle", "reading")
        )
        self.force, self.pressure, self.radius, self.travel, self.work, self.tool = (
            np.repeat([getattr(t, name) for t in self.tests], sizes)
            for name in ("force", "pressure", "radius", "direction", "work", "tool")
        )
        self.circle = np.repeat(np.arange(len(sizes)), sizes)
        if not self.compensated:
            self.y = self.y - 1e-3 * self.stated.mount_um_per_bar * self.pressure
        self.unique = np.unique(self.force)
        self.reference = 0.5 * (self.force.min() + self.force.max())
        self.span, self.most = np.ptp(self.force), self.force.max()
        self.bow = 4.0 * (self.force / self.most) * (1.0 - self.force / self.most)
        self.compliance = compliance_columns(self.theta, self.radius)
        whole = np.hstack(
            [self.force[:, None] * self.compliance, geometric_columns(self.theta, self.radius)]
        )
        scale = np.concatenate([SD_C, SD_E])
        self.estimate = np.linalg.pinv(whole * scale, rcond=1e-10) @ self.y * scale
        self.axes = (
            (0.0, abs(self.estimate[0])),
            (np.pi / 2.0, abs(self.estimate[2])),
        )  # angle and |Ĉ_aa| of X and Y
        size = (
            SD_C if self.edition == "first" else np.maximum(np.abs(self.estimate[:6]), SD_C / 20.0)
        )
        steps = range(1, self.degree + 1)
        slopes = [((self.force - self.reference) ** k)[:, None] * whole[:, :6] for k in steps]
        self.J = np.hstack([whole[:, :6], *slopes, whole[:, 6:]])
        self.sd = np.concatenate([SD_C, *[0.3 * size / self.span**k for k in steps], SD_E])
        self.names = INTEREST + [f"{name}_{k}" for k in steps for name in INTEREST] + GEOMETRIC
        self.mean = np.zeros(self.sd.size)
        for name, (mean, sd) in self.given_priors.items():
            self.mean[self.names.index(name)], self.sd[self.names.index(name)] = mean, sd
        self.grams: dict[tuple[tuple[str, ...], int], np.ndarray] = {
            ((), 0): np.zeros((self.y.size, self.y.size))
        }
        for term in (term for term in self.terms if term != "circle"):
            getattr(self, f"_{term}")()
        used = {
            name for hypers, order in self.grams for name in (*hypers, *(["p"] if order else []))
        } | {"sigma"}
        self.hypers = [
            name for name in ("sigma", "delta", "kappa", "tau", "p", "omega", "eta") if name in used
        ]
        self.hypers += [name for r in range(len(sizes)) for name in self._odd(r) if name in used]
        self.scales = np.array([SCALES[self.edition].get(name, 1.0) for name in self.hypers])

    def _add(self, columns: np.ndarray, sd: float, *hypers: str, order: int = 0) -> None:
        """Coefficients of standard deviation sd × hyper-parameters × (order/6)^−p, the last where
        an order is given."""
        scaled = columns.reshape(self.y.size, -1) * sd
        self.grams[hypers, order] = self.grams.get((hypers, order), 0.0) + scaled @ scaled.T

    def _odd(self, r: int) -> tuple[str, ...]:
        return (f"lambda_{r + 1}",) if "circle" in self.terms and len(self.tests) >= 4 else ()

    def _form(self) -> None:
        for ball, angle in (
            ("work", self.theta - self.work),
            ("tool", self.theta + np.pi - self.tool),
        ):
            for n in range(2, 13):
                columns = waves(n, angle)
                if n in self.stated.harmonics_um.get(ball, {}):
                    amplitude, phase, expanded = self.stated.harmonics_um[ball][n]
                    self.y = self.y - 1e-3 * amplitude * np.cos(n * (angle - np.deg2rad(phase)))
                    self._add(columns, 0.5e-3 * expanded)
                elif self.edition == "first":
                    self._add(columns, math.sqrt(0.5) / n, "tau")
                else:
                    self._add(columns, math.sqrt(0.5), "tau", order=n)
                    if n in (2, 3):
                        self._add(
                            columns,
                            1e-3 * self.stated.sphericity_um.get(ball, 2.5) / math.sqrt(24.0),
                        )

    def _pattern(self) -> None:
        clocked = any(
            abs(np.exp(1j * (turn - turn[0])) - 1.0).max() > 1e-9 for turn in (self.work, self.tool)
        )
        for way, radius in set(zip(self.travel, self.radius, strict=True)) if clocked else ():
            here = (self.travel == way) & (self.radius == radius)
            for n in range(4, 13):
                self._add(here[:, None] * waves(n, self.theta), 1.0, "omega", order=n)

    def _length(self) -> None:
        self.y = self.y - 1e-3 * self.stated.length_error_um
        for radius in np.unique(self.radius):
            self._add(self.radius == radius, 0.5e-3 * self.stated.length_U_um)

    def _mount(self) -> None:
        self._add(
            self.pressure, 1e-3 * self.stated.mount_um_per_bar * self.stated.mount_U_percent / 200.0
        )
        if self.edition == "second":
            self._add(self.bow, 0.5e-3)

    def _force(self) -> None:
        deflection = self.compliance @ self.estimate[:6]
        self._add(self.force * deflection, self.stated.force_U_percent / 200.0)
        if self.edition == "second":
            self._add(
                self.most * self.bow * deflection,
                self.stated.linearity_percent / 100.0 / math.sqrt(3.0),
            )
        for r in range(len(self.tests)):
            self._add((self.circle == r) * deflection, self.stated.random_N)

    def joint_columns(self) -> list[tuple[np.ndarray, float]]:
        """Two of X and two of Y, with their sd."""
        found = []
        for place, size in self.axes:
            F = self.force
            square = np.cos(self.theta - place) ** 2
            angle = self.theta - place
            found.append(
                (
                    F * (F * projected_power(3.0, angle) - self.reference * square) / self.most,
                    0.2 * size,
                )
            )
            contact = F ** (2 / 3) * self.reference ** (1 / 3) * projected_power(5 / 3, angle)
            found.append((contact - F * square, 0.2 * size))
        return found

    def _joint(self) -> None:
        for column, sd in self.joint_columns():
            self._add(column, sd)

    def _position(self) -> None:
        for place, size in self.axes:
            u = np.cos(self.theta - place)
            self._add(self.force * u**3, 0.07 * size)
            self._add(self.force * (u**4 - u**2 / 2.0), 0.04 * size)

    def _angle(self) -> None:
        turned = self.theta + 1e-30j  # derivatives by a complex step are exact
        elastic = self.force * (compliance_columns(turned, self.radius) @ self.estimate[:6])
        slope = (elastic + geometric_columns(turned, self.radius) @ self.estimate[6:]).imag / 1e-30
        for column in (slope, self.travel * slope):
            self._add(column, np.deg2rad(self.stated.angle_U_deg / 2.0))

    def _setup(self) -> None:
        for r in range(len(self.tests)):
            for n in (0, 1):
                self._add(
                    (self.circle == r)[:, None] * waves(n, self.theta), 1.0, "delta", *self._odd(r)
                )

    def _discrepancy(self) -> None:
        for r in range(len(self.tests)):
            for n in range(2, 13):
                self._add(
                    (self.circle == r)[:, None] * waves(n, self.theta),
                    1.0 / n,
                    "kappa",
                    *self._odd(r),
                )

    def _hysteresis(self) -> None:
        if np.ptp(self.travel):  # both directions are run
            for n in range(13):
                columns = self.travel[:, None] * waves(n, self.theta)
                self._add(columns, 1.0 / max(n, 1), "eta")
                self._add(self.force[:, None] * columns, 2e-6 / max(n, 1))

    def by_name(self, phi: Phi) -> Mapping[str, float]:
        return phi if isinstance(phi, Mapping) else dict(zip(self.hypers, phi, strict=True))

    def shared(self, phi: Phi) -> np.ndarray:
        """Covariance of what is not separate for every test: without set-up shift, discrepancy and
        noise."""
        return self._sum(phi, [key for key in self.grams if not {"delta", "kappa"} & set(key[0])])

    def covariance(self, phi: Phi) -> np.ndarray:
        return self._sum(phi, list(self.grams)) + self.by_name(phi)["sigma"] ** 2 * np.eye(
            self.y.size
        )

    def _sum(self, phi: Phi, keys: list[tuple[tuple[str, ...], int]]) -> np.ndarray:
        value = self.by_name(phi)
        fall = [(n / 6.0) ** -value["p"] if n else 1.0 for _, n in keys]
        return sum(
            (math.prod(value[h] for h in key[0]) * f) ** 2 * self.grams[key]
            for key, f in zip(keys, fall, strict=True)
        )

    def log_likelihood(self, phi: Phi, beta: Mapping[str, float] | np.ndarray) -> float:
        beta = np.array([beta[name] for name in self.names]) if isinstance(beta, Mapping) else beta
        return float(stats.multivariate_normal(self.J @ beta, self.covariance(phi)).logpdf(self.y))

    def log_prior(self, phi: Phi) -> float:
        """Of σ, δ, κ, τ, p, ω, η and λ themselves."""
        value = self.by_name(phi)
        total = 0.0
        for name, scale in zip(self.hypers, self.scales, strict=True):
            if name == "p":
                total += stats.truncnorm.logpdf(
                    value[name], -1.5 / 0.7, 1.5 / 0.7, loc=2.0, scale=0.7
                )
            elif name.startswith("lambda"):
                total += stats.invgamma.logpdf(value[name] ** 2, 1.5, scale=1.5) + np.log(
                    2.0 * value[name]
                )
            else:
                total += stats.halfnorm.logpdf(value[name], scale=scale)
        floor = self.resolution / np.sqrt(12.0)
        return (
            float(total - stats.halfnorm.logsf(floor, scale=self.scales[0]))
            if value["sigma"] >= floor
            else -np.inf
        )

    def phi(self, free: np.ndarray) -> np.ndarray:
        """From ln φ; of p from its logit within 0.5 to 3.5."""
        p = np.array(self.hypers) == "p"
        return np.where(p, 0.5 + 3.0 * special.expit(free), np.exp(np.where(p, 0.0, free)))

    def log_prior_of_log(self, free: np.ndarray) -> float:
        """Of ln φ and logit p; beyond 30 scales is next to nothing, and the dense covariance too
        ill-conditioned."""
        phi = self.phi(free)
        if np.any(phi > 30.0 * self.scales):
            return -np.inf
        change = [
            (v - 0.5) * (3.5 - v) / 3.0 if name == "p" else v
            for name, v in zip(self.hypers, phi, strict=True)
        ]
        return self.log_prior(phi) + float(np.log(change).sum())

    def given(self, phi: Phi) -> tuple[float, np.ndarray, np.ndarray]:
        """ln p(y | φ), mean and covariance of β given y, φ; truncation aside."""
        root = linalg.cholesky(self.covariance(phi), lower=True)
        white = linalg.solve_triangular(
            root, np.column_stack([self.J * self.sd, self.y - self.J @ self.mean]), lower=True
        )
        white_j = white[:, :-1]
        white_y = white[:, -1]
        precision = white_j.T @ white_j + np.eye(self.sd.size)
        covariance = np.linalg.inv(precision)
        mean = covariance @ (white_j.T @ white_y)
        quadratic = white_y @ white_y - mean @ precision @ mean
        log_det = 2 * np.log(np.diag(root)).sum() + np.linalg.slogdet(precision)[1]
        log_evidence = -0.5 * (quadratic + log_det + self.y.size * np.log(2 * np.pi))
        return (
            float(log_evidence),
            self.mean + mean * self.sd,
            covariance * np.outer(self.sd, self.sd),
        )

    def inside(self, beta: np.ndarray) -> np.ndarray:
        """Whether C_XXX(F), C_YYY(F), C_CCY(F) ≥ 0 at every tested force."""
        holds = np.ones(beta.shape[:-1], dtype=bool)
        for j in (0, 2, 5):
            for force in self.unique:
                value = sum(
                    beta[..., 6 * k + j] * (force - self.reference) ** k
                    for k in range(self.degree + 1)
                )
                holds &= value >= 0
        return holds

    def posterior(
        self, *, points: int = 400, draws: int = 200, seed: int = 0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Draws of (β, φ) and their weights: importance sampling of ln φ from a wide Student-t."""
        rng = np.random.default_rng(seed)
        centre, spread = self._locate(rng)
        log_phi, log_z, conditional = self._propose(
            centre, 1.1 * spread, stats.t.rvs(5, size=(points, len(centre)), random_state=rng)
        )
        kept = np.isfinite(log_z)
        found = []
        weight = []
        for point, value, (mean, covariance) in zip(
            log_phi[kept], log_z[kept] - log_z[kept].max(), conditional, strict=True
        ):
            root = np.linalg.cholesky(covariance / np.outer(self.sd, self.sd))
            beta = mean + (rng.standard_normal((draws, self.sd.size)) @ root.T) * self.sd
            found.append(np.hstack([beta, np.tile(self.phi(point), (draws, 1))]))
            weight.append(np.exp(value) * (self.inside(beta) if self.truncated else np.ones(draws)))
        return np.concatenate(found), np.concatenate(weight) / np.sum(weight)

    def _propose(
        self, centre: np.ndarray, spread: np.ndarray, standard: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
        """Student-t points about a centre; ln p(y, φ) over their density, −inf outside the prior; β
        given φ of those inside."""
        log_phi = centre + standard @ spread.T
        log_proposal = stats.t.logpdf(standard, 5).sum(axis=1) - np.log(
            np.abs(np.linalg.det(spread))
        )
        target = np.array([self.log_prior_of_log(point) for point in log_phi])
        conditional = []
        for k in np.flatnonzero(np.isfinite(target)):
            log_z, mean, covariance = self.given(self.phi(log_phi[k]))
            target[k] += log_z
            conditional.append((mean, covariance))
        return log_phi, target - log_proposal, conditional

    def log_evidence(
        self, *, points: int = 4096, draws: int = 64, seed: int = 0
    ) -> tuple[float, float]:
        """ln Z, truncation included where it is on, and its standard error: quasi-random importance
        sampling about the mode."""
        rng = np.random.default_rng(seed)
        centre, spread = self._locate(rng)
        rows = self._rows()
        halves = []
        places = stats.qmc.Sobol(len(rows), rng=rng).random(draws)
        for _ in range(4):
            uniform = np.clip(
                stats.qmc.Sobol(len(centre), rng=rng).random(points // 4), 1e-12, 1.0 - 1e-12
            )
            _, weight, conditional = self._propose(centre, spread, stats.t(5).ppf(uniform))
            for k, (mean, covariance) in zip(
                np.flatnonzero(np.isfinite(weight)), conditional, strict=True
            ):
                if self.truncated:
                    root = np.linalg.cholesky(rows @ covariance @ rows.T)
                    turned = np.clip((places + rng.random(len(rows))) % 1.0, 1e-12, 1.0 - 1e-12)
                    inside = (rows @ mean + special.ndtri(turned) @ root.T >= 0.0).all(axis=1)
                    weight[k] += np.log(max(inside.mean(), 1e-300))
            halves.append(np.logaddexp.reduce(weight) - np.log(points // 4))
        value = float(np.logaddexp.reduce(halves) - np.log(4))
        error = float(np.std(np.exp(np.array(halves) - value), ddof=1) / 2.0)
        return value - self._log_prob_prior(), error

    def _rows(self) -> np.ndarray:
        """C_XXX(F), C_YYY(F), C_CCY(F) at the least and the greatest force, for degrees 0 and 1."""
        rows = []
        for j in (0, 2, 5):
            for force in self.unique[[0, -1]] if self.degree else self.unique[:1]:
                row = np.zeros(self.sd.size)
                row[j] = 1.0
                if self.degree:
                    row[6 + j] = force - self.reference
                rows.append(row)
        return np.array(rows)

    def _log_prob_prior(self) -> float:
        """ln P(T): for three compliances, ½ at degree 0; at degree 1 two half-planes of known
        correlation."""
        if not self.truncated:
            return 0.0
        if self.mean.any():
            rows = self._rows()
            per = 2 if self.degree else 1
            pairs = [rows[k : k + per] for k in range(0, len(rows), per)]
            return sum(
                stats.multivariate_normal(-row @ self.mean, (row * self.sd**2) @ row.T).logcdf(
                    np.zeros(per)
                )
                for row in pairs
            )
        if self.degree == 0:
            return 3.0 * np.log(0.5)
        ratio = [(self.sd[6 + j] * self.span / 2.0 / self.sd[j]) ** 2 for j in (0, 2, 5)]
        return float(
            sum(np.log(0.25 + np.arcsin((1.0 - r) / (1.0 + r)) / (2.0 * np.pi)) for r in ratio)
        )

    def _locate(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Where the posterior of ln φ lies, and a root of its covariance, from a first round of
        importance sampling."""

        def negative(log_phi: np.ndarray) -> float:
            prior = self.log_prior_of_log(log_phi)
            return 1e10 if not np.isfinite(prior) else -(prior + self.given(self.phi(log_phi))[0])

        found = optimize.minimize(negative, np.log(0.3 * self.scales), method="Powell")
        centre = found.x
        spread = 0.5 * np.eye(len(found.x))
        for temperature in (30.0, 10.0, 3.0, 1.0, 1.0):
            log_phi, weight, _ = self._propose(
                centre,
                spread,
                stats.t.rvs(5, size=(75 * len(centre), len(centre)), random_state=rng),
            )
            share = np.exp((weight - weight.max()) / temperature)
            share /= share.sum()
            centre = share @ log_phi
            spread = np.linalg.cholesky(
                (share[:, None] * (log_phi - centre)).T @ (log_phi - centre)
                + 1e-4 * np.eye(len(centre))
            )
        return centre, spread
