"""The dense textbook version of the model, written from the measurement model alone.

Nothing of ldbb_bayes is imported. Every test's columns are evaluated at its own angles, the covariance of all readings is one
n × n matrix, hyper-parameters are integrated by importance sampling about the mode, the truncation is by rejection.
Columns are typed in for the paper's machine: tool at x = R cos θ, y = R sin θ.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np
from scipy import linalg, optimize, special, stats

INTEREST = ["C_XXX", "C_XYX", "C_YYY", "C_CXY", "C_CYY", "C_CCY"]
GEOMETRIC = ["E_XX1", "E_YX2", "E_XY2", "E_YY1", "E_C0YX", "E_Xt0", "E_Yt0"]
SD_C = np.array([1e-4, 1e-5, 1e-4, 1e-7, 1e-7, 1e-9])
SD_E = np.array([2e-4, 1e-6, 1e-6, 2e-4, 5e-5, 0.02, 0.02])


@dataclass
class OracleTest:
    force: float
    pressure: float
    angle: np.ndarray  # rad
    reading: np.ndarray  # mm
    work: float = 0.0  # rad
    tool: float = 0.0
    radius: float = 150.0


def compliance_columns(t: OracleTest) -> np.ndarray:
    c, s, R = np.cos(t.angle), np.sin(t.angle), t.radius
    return np.stack([c**2, c * s, s**2, R * c**2 * s, R * c * s**2, R**2 * c**2 * s**2], axis=1)


def geometric_columns(t: OracleTest) -> np.ndarray:
    c, s, R = np.cos(t.angle), np.sin(t.angle), t.radius
    return np.stack([R * c**2, R**2 * c**2 * s, R**2 * s**2 * c, R * s**2, R * c * s, c, s], axis=1)


@dataclass
class Oracle:
    """The model of one campaign; ``terms`` lists the nuisances that are on."""

    tests: list[OracleTest]
    degree: int
    terms: tuple[str, ...] = ("form", "length", "mount", "force", "setup", "discrepancy")
    compensated: bool = True
    resolution: float = 0.24e-3
    truncated: bool = True
    given_priors: dict[str, tuple[float, float]] = field(default_factory=dict)  # parameter -> prior mean and sd
    names: list[str] = field(init=False)

    def __post_init__(self) -> None:
        forces = np.array([t.force for t in self.tests])
        self.reference = 0.5 * (forces.min() + forces.max())
        span = forces.max() - forces.min()
        self.y = np.concatenate([t.reading for t in self.tests])
        if not self.compensated:
            self.y = self.y - 2.33e-3 * np.concatenate([np.full(t.angle.size, t.pressure) for t in self.tests])
        blocks, sds, self.names = [], [], []
        for k in range(self.degree + 1):
            blocks.append(np.vstack([t.force * (t.force - self.reference) ** k * compliance_columns(t) for t in self.tests]))
            sds.append(SD_C if k == 0 else 0.3 * SD_C / span**k)
            self.names += [n if k == 0 else f"{n}_{k}" for n in INTEREST]
        blocks.append(np.vstack([geometric_columns(t) for t in self.tests]))
        sds.append(SD_E)
        self.names += GEOMETRIC
        self.J, self.sd = np.hstack(blocks), np.concatenate(sds)
        self.mean = np.zeros(self.sd.size)
        for name, (mean, sd) in self.given_priors.items():
            self.mean[self.names.index(name)], self.sd[self.names.index(name)] = mean, sd
        self.unique = np.unique(forces)
        self.hypers = ["sigma"]
        self.hypers += [h for h, term in (("delta", "setup"), ("kappa", "discrepancy"), ("tau", "form")) if term in self.terms]
        self.scales = np.array([{"sigma": 1e-3, "delta": 1e-3, "kappa": 1e-3, "tau": 5e-3}[h] for h in self.hypers])
        self._nuisances(span)

    def _nuisances(self, span: float) -> None:
        everything = np.hstack([np.vstack([t.force * compliance_columns(t) for t in self.tests]), self.J[:, -7:]])
        scale = np.concatenate([SD_C, SD_E])
        estimate = np.linalg.pinv(everything * scale, rcond=1e-10) @ self.y * scale
        n = self.y.size
        self.fixed = np.zeros((n, n))
        self.form_part, self.setup_part, self.discrepancy_part = (np.zeros((n, n)) for _ in range(3))
        starts = np.cumsum([0, *[t.angle.size for t in self.tests]])
        parts = [slice(a, b) for a, b in itertools.pairwise(starts)]
        if "length" in self.terms:
            radius = np.concatenate([np.full(t.angle.size, t.radius) for t in self.tests])
            self.fixed += 9.4e-3**2 * (radius[:, None] == radius)
        if "mount" in self.terms:
            p = np.concatenate([np.full(t.angle.size, t.pressure) for t in self.tests])
            self.fixed += (0.1 * 2.33e-3) ** 2 * np.outer(p, p)
        if "force" in self.terms:
            deflection = np.concatenate([compliance_columns(t) @ estimate[:6] for t in self.tests])
            gain = np.concatenate([t.force * compliance_columns(t) @ estimate[:6] for t in self.tests])
            self.fixed += 0.01**2 * np.outer(gain, gain)
            for part in parts:
                self.fixed[part, part] += 4.0**2 * np.outer(deflection[part], deflection[part])
        for t, part in zip(self.tests, parts, strict=True):
            c, s = np.cos(t.angle), np.sin(t.angle)
            self.setup_part[part, part] += 1.0 + np.outer(c, c) + np.outer(s, s)
            for m in range(2, 13):
                c, s = np.cos(m * t.angle), np.sin(m * t.angle)
                self.discrepancy_part[part, part] += (np.outer(c, c) + np.outer(s, s)) / m**2
        turned = [(np.exp(1j * (t.work - self.tests[0].work)), np.exp(1j * (t.tool - self.tests[0].tool))) for t in self.tests]
        clocked = any(abs(w - 1) > 1e-9 or abs(q - 1) > 1e-9 for w, q in turned)
        work = np.concatenate([t.angle - t.work for t in self.tests])
        tool = np.concatenate([t.angle + np.pi - t.tool for t in self.tests])
        for angle, share in ((work, 0.5 if clocked else 1.0), (tool, 0.5 if clocked else 0.0)):
            for m in range(2, 13):
                c, s = np.cos(m * angle), np.sin(m * angle)
                self.form_part += share * (np.outer(c, c) + np.outer(s, s)) / m**2

    def covariance(self, phi: np.ndarray) -> np.ndarray:
        value = dict(zip(self.hypers, phi, strict=True))
        sigma = self.fixed + value["sigma"] ** 2 * np.eye(self.y.size)
        sigma = sigma + value.get("delta", 0.0) ** 2 * self.setup_part
        sigma = sigma + value.get("kappa", 0.0) ** 2 * self.discrepancy_part
        return sigma + value.get("tau", 0.0) ** 2 * self.form_part

    def log_likelihood(self, phi: np.ndarray, beta: np.ndarray) -> float:
        return float(stats.multivariate_normal(self.J @ beta, self.covariance(phi)).logpdf(self.y))

    def log_prior_of_log(self, log_phi: np.ndarray) -> float:
        phi = np.exp(log_phi)
        floor = self.resolution / np.sqrt(12.0)
        if phi[0] < floor or np.any(phi > 30.0 * self.scales):
            return -np.inf  # beyond 30 scales the density is below e^-450: nothing, and the dense covariance too ill-conditioned
        total = float(stats.halfnorm.logpdf(phi, scale=self.scales).sum() + log_phi.sum())
        return total - float(stats.halfnorm.logsf(floor, scale=self.scales[0]))

    def given(self, phi: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """ln p(y | φ), mean and covariance of β given y, φ; truncation aside."""
        root = linalg.cholesky(self.covariance(phi), lower=True)
        white = linalg.solve_triangular(root, np.column_stack([self.J * self.sd, self.y - self.J @ self.mean]), lower=True)
        white_j, white_y = white[:, :-1], white[:, -1]
        precision = white_j.T @ white_j + np.eye(self.sd.size)
        covariance = np.linalg.inv(precision)
        mean = covariance @ (white_j.T @ white_y)
        quadratic = white_y @ white_y - mean @ precision @ mean
        log_det = 2 * np.log(np.diag(root)).sum() + np.linalg.slogdet(precision)[1]
        log_evidence = -0.5 * (quadratic + log_det + self.y.size * np.log(2 * np.pi))
        return float(log_evidence), self.mean + mean * self.sd, covariance * np.outer(self.sd, self.sd)

    def inside(self, beta: np.ndarray) -> np.ndarray:
        """Whether C_XXX(F), C_YYY(F), C_CCY(F) ≥ 0 at every tested force."""
        holds = np.ones(beta.shape[:-1], dtype=bool)
        for j in (0, 2, 5):
            for force in self.unique:
                value = sum(beta[..., 6 * k + j] * (force - self.reference) ** k for k in range(self.degree + 1))
                holds &= value >= 0
        return holds

    def posterior(self, *, points: int = 400, draws: int = 200, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Draws of (β, φ) and their weights: importance sampling of ln φ from a wide Student-t."""
        rng = np.random.default_rng(seed)
        centre, spread = self._locate(rng)
        log_phi, log_z, conditional = self._propose(
            centre, 1.1 * spread, stats.t.rvs(5, size=(points, len(centre)), random_state=rng)
        )
        kept, found, weight = np.isfinite(log_z), [], []
        for point, value, (mean, covariance) in zip(log_phi[kept], log_z[kept] - log_z[kept].max(), conditional, strict=True):
            root = np.linalg.cholesky(covariance / np.outer(self.sd, self.sd))
            beta = mean + (rng.standard_normal((draws, self.sd.size)) @ root.T) * self.sd
            found.append(np.hstack([beta, np.tile(np.exp(point), (draws, 1))]))
            weight.append(np.exp(value) * (self.inside(beta) if self.truncated else np.ones(draws)))
        return np.concatenate(found), np.concatenate(weight) / np.sum(weight)

    def _propose(
        self, centre: np.ndarray, spread: np.ndarray, standard: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
        """Student-t points about a centre; ln p(y, φ) over their density, −inf outside the prior; β given φ of those inside."""
        log_phi = centre + standard @ spread.T
        log_proposal = stats.t.logpdf(standard, 5).sum(axis=1) - np.log(np.abs(np.linalg.det(spread)))
        target = np.array([self.log_prior_of_log(point) for point in log_phi])
        conditional = []
        for k in np.flatnonzero(np.isfinite(target)):
            log_z, mean, covariance = self.given(np.exp(log_phi[k]))
            target[k] += log_z
            conditional.append((mean, covariance))
        return log_phi, target - log_proposal, conditional

    def log_evidence(self, *, points: int = 4096, draws: int = 64, seed: int = 0) -> tuple[float, float]:
        """ln Z, truncation included where it is on, and its standard error: quasi-random importance sampling about the mode."""
        rng = np.random.default_rng(seed)
        centre, spread = self._locate(rng)
        rows = self._rows()
        halves, places = [], stats.qmc.Sobol(len(rows), rng=rng).random(draws)
        for _ in range(4):
            uniform = np.clip(stats.qmc.Sobol(len(centre), rng=rng).random(points // 4), 1e-12, 1.0 - 1e-12)
            _, weight, conditional = self._propose(centre, spread, stats.t(5).ppf(uniform))
            for k, (mean, covariance) in zip(np.flatnonzero(np.isfinite(weight)), conditional, strict=True):
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
        """ln P(T): for three compliances, ½ at degree 0; at degree 1 two half-planes of known correlation."""
        if not self.truncated:
            return 0.0
        if self.mean.any():
            rows, per = self._rows(), 2 if self.degree else 1
            pairs = [rows[k : k + per] for k in range(0, len(rows), per)]
            return sum(
                stats.multivariate_normal(-row @ self.mean, (row * self.sd**2) @ row.T).logcdf(np.zeros(per)) for row in pairs
            )
        if self.degree == 0:
            return 3.0 * np.log(0.5)
        correlation = (1.0 - 0.15**2) / (1.0 + 0.15**2)
        return 3.0 * np.log(0.25 + np.arcsin(correlation) / (2.0 * np.pi))

    def _locate(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Where the posterior of ln φ lies, and a root of its covariance, from a first round of importance sampling."""

        def negative(log_phi: np.ndarray) -> float:
            prior = self.log_prior_of_log(log_phi)
            return 1e10 if not np.isfinite(prior) else -(prior + self.given(np.exp(log_phi))[0])

        found = optimize.minimize(negative, np.log(0.3 * self.scales), method="Nelder-Mead", options={"maxiter": 600})
        centre, spread = found.x, 0.5 * np.eye(len(found.x))
        for temperature in (30.0, 10.0, 3.0, 1.0, 1.0):
            log_phi, weight, _ = self._propose(centre, spread, stats.t.rvs(5, size=(300, len(centre)), random_state=rng))
            share = np.exp((weight - weight.max()) / temperature)
            share /= share.sum()
            centre = share @ log_phi
            spread = np.linalg.cholesky((share[:, None] * (log_phi - centre)).T @ (log_phi - centre) + 1e-4 * np.eye(len(centre)))
        return centre, spread
