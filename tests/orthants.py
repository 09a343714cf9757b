"""Orthant problems whose ln P is found by sums over a line: rows that share one factor, chains,
cones in a plane, pairs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import trapezoid
from scipy.special import log_ndtr, logsumexp, ndtr

_CELLS = 20_001


@dataclass(frozen=True)
class Case:
    """u = mean + spread e, (m,) and (m, q), and ln P(u ≥ 0)."""

    mean: np.ndarray
    spread: np.ndarray
    log_probability: float


def _integral(log_density: Callable[[np.ndarray], np.ndarray], reach: float) -> float:
    """ln ∫ of a log-concave density by the trapezoidal rule: coarse, then where it counts."""
    x = np.linspace(-reach, reach, _CELLS)
    for _ in range(2):
        value = log_density(x)
        heavy = np.flatnonzero(value > value.max() - 40.0)
        x = np.linspace(x[max(heavy[0] - 1, 0)], x[min(heavy[-1] + 1, _CELLS - 1)], _CELLS)
    return float(logsumexp(log_density(x)) + np.log(x[1] - x[0]))


def one_factor(mean: np.ndarray, loading: np.ndarray) -> Case:
    """u_i = mean_i + a_i z + √(1 − a_i²) e_i."""
    private_sd = np.sqrt(1.0 - loading**2)

    def log_density(z: np.ndarray) -> np.ndarray:
        log_probability = log_ndtr((mean + np.outer(z, loading)) / private_sd).sum(axis=1)
        return -0.5 * (z**2 + np.log(2 * np.pi)) + log_probability

    reach = 1.5 * np.abs(mean).max() + 12.0
    spread = np.column_stack([loading, np.diag(private_sd)])
    return Case(mean, spread, _integral(log_density, reach))


def chain(mean: np.ndarray, rho: np.ndarray) -> Case:
    """u_i − mean_i = ρ_i (u_{i−1} − mean_{i−1}) + √(1 − ρ_i²) e_i: one transition after another
    over a grid of u."""
    m = len(mean)
    root = np.eye(len(mean))
    for i in range(1, m):
        root[i] = rho[i - 1] * root[i - 1]
        root[i, i] = np.sqrt(1.0 - rho[i - 1] ** 2)
    nodes, weights = np.polynomial.legendre.leggauss(200)
    top = max(float(mean.max()), 0.0) + 10.0
    u = (nodes + 1.0) * top / 2.0
    log_weight = np.log(weights * top / 2.0)
    message = np.zeros(len(u))
    for i in range(m - 1, 0, -1):
        centre = mean[i] + rho[i - 1] * (u - mean[i - 1])
        sd = root[i, i]
        log_step = -0.5 * ((u - centre[:, None]) / sd) ** 2 - np.log(sd * np.sqrt(2 * np.pi))
        message = logsumexp(log_step + message + log_weight, axis=1)
    first = -0.5 * ((u - mean[0]) ** 2 + np.log(2 * np.pi))
    return Case(mean, root, float(logsumexp(first + message + log_weight)))


def cone(mean: np.ndarray, rows: np.ndarray) -> Case:
    """Many rows of two coordinates: ∫ φ(x) P(y between its bounds | x) dx; no row may be parallel
    to y."""

    def log_density(x: np.ndarray) -> np.ndarray:
        edge = -(mean + np.outer(x, rows[:, 0])) / rows[:, 1]
        low = np.where(rows[:, 1] > 0.0, edge, -np.inf).max(axis=1)
        high = np.where(rows[:, 1] < 0.0, edge, np.inf).min(axis=1)
        mass = np.where(low > 0.0, ndtr(-low) - ndtr(-high), ndtr(high) - ndtr(low))
        with np.errstate(divide="ignore"):
            return -0.5 * (x**2 + np.log(2 * np.pi)) + np.log(np.maximum(mass, 0.0))

    return Case(mean, rows, _integral(log_density, 14.0))


def random_case(rng: np.random.Generator) -> Case:
    """A case of 2 to 10 rows, correlated by up to 0.99, held or broken by up to 30 sd, some with
    rows that follow from others."""
    kind = rng.integers(4)
    m = int(rng.integers(2, 11))
    scatter = rng.normal(0.0, rng.choice([0.5, 2.0]), m)
    mean = scatter + rng.choice([1.0, 0.0, -2.0, -6.0, -12.0, -30.0])
    if kind == 0:
        case = one_factor(mean, np.full(m, np.sqrt(rng.choice([0.3, 0.9, 0.99]))))
    elif kind == 1:
        case = one_factor(mean, rng.choice([-1.0, 1.0], m) * np.sqrt(rng.uniform(0.0, 0.99, m)))
    elif kind == 2:
        rho = rng.choice([-1.0, 1.0]) * rng.uniform(0.0, 0.98, m - 1)
        case = chain(np.maximum(mean, -4.0), rho)
    else:
        angle = rng.uniform(0.0, 2 * np.pi) + rng.uniform(-1.2, 1.2, m)
        case = cone(np.maximum(mean, -4.0), np.column_stack([np.cos(angle), np.sin(angle)]))
    if kind != 3 and rng.random() < 0.3:
        share = rng.dirichlet(np.ones(m), 2)
        return Case(
            np.append(case.mean, share @ case.mean),
            np.vstack([case.spread, share @ case.spread]),
            case.log_probability,
        )
    return case


def pair_by_quadrature(mean: tuple[float, float], rho: float) -> float:
    """ln P(u₁ ≥ 0, u₂ ≥ 0) by the trapezoidal rule over u₁, however far."""
    reach = max(mean[0], 0.0) + 40.0 + abs(mean[1] / rho)
    value = np.concatenate([[0.0], np.geomspace(1e-9, reach, 400_001)])
    tail = log_ndtr((mean[1] + rho * (value - mean[0])) / np.sqrt(1.0 - rho**2))
    density = -0.5 * (value - mean[0]) ** 2 - 0.5 * np.log(2 * np.pi) + tail
    return float(density.max() + np.log(trapezoid(np.exp(density - density.max()), value)))
