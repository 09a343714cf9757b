"""Fleets made up at the level of statistics, all Gaussian; and what they say, from one dense matrix of everything."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.stats import multivariate_normal

from ldbb_bayes.fleet.statistics import FleetStatistics
from ldbb_bayes.model.gaussian import Gaussian

NAMES = ("C_XXX", "C_XYX", "C_YYY", "C_CXY", "C_CYY", "C_CCY")
UNITS = ("mm/N", "mm/N", "mm/N", "rad/N", "rad/N", "rad/(N mm)")
PRIOR_SD = np.array([1e-4, 1e-5, 1e-4, 1e-7, 1e-7, 1e-9])
INSTRUMENT_SD = np.array([2.33e-4, 0.01])


def fleet(
    rng: np.random.Generator,
    *,
    machines: int = 8,
    parameters: int = 6,
    campaigns: int = 1,
    spread: np.ndarray | float = 0.2,
    mean: np.ndarray | float = 0.5,
    known: float = 0.1,
    outlier: np.ndarray | None = None,
) -> FleetStatistics:
    """Campaigns of machines drawn from a population, in units of the prior sd.

    Parameters
    ----------
    spread, mean
        Of the population.
    known
        Size of a campaign's own standard uncertainty.
    outlier
        Added to the first machine.
    """
    c = parameters
    mu, s, b = np.broadcast_to(mean, c), np.broadcast_to(spread, c), rng.standard_normal(2)
    names, information, weighted = [], [], []
    for m in range(machines):
        own = mu + s * rng.standard_normal(c)
        own = own + (outlier if outlier is not None and m == 0 else 0.0)
        for _ in range(campaigns):
            design = rng.standard_normal((c + 4, c)) / known
            seen = np.hstack([design, design[:, :1] * 0.3 + rng.standard_normal((c + 4, 1)), rng.standard_normal((c + 4, 1))])
            reading = seen @ np.concatenate([own, b]) + rng.standard_normal(c + 4)
            information.append(seen.T @ seen)
            weighted.append(seen.T @ reading)
            names.append(f"M{m + 1:02d}")
    return FleetStatistics(
        campaigns=tuple(f"{name}/{k}" for k, name in enumerate(names)),
        machines=tuple(names),
        dates=(None,) * len(names),
        parameters=NAMES[:c],
        units=UNITS[:c],
        instrument=("mount", "force_gain"),
        prior_sd=np.concatenate([PRIOR_SD[:c], INSTRUMENT_SD]),
        likelihood=Gaussian(np.array(information), np.array(weighted)),
        reference_force_N=389.0,
        forces_N=(36.0, 742.0),
        topology="wCAFYXZSt",
    )


def telling(
    statistics: FleetStatistics, information: np.ndarray | None = None, weighted: np.ndarray | None = None, **other: Any
) -> FleetStatistics:
    """The same with another Λ or η."""
    own = statistics.likelihood
    new = Gaussian(own.precision if information is None else information, own.shift if weighted is None else weighted)
    return replace(statistics, likelihood=new, **other)


def of_campaigns(statistics: FleetStatistics, places: Any) -> FleetStatistics:
    """Some of the campaigns, in this order."""
    picked = {name: tuple(getattr(statistics, name)[k] for k in places) for name in ("campaigns", "machines", "dates")}
    return telling(statistics, statistics.likelihood.precision[places], statistics.likelihood.shift[places], **picked)


def dense(statistics: FleetStatistics, spread: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """ln p(estimates | s), and mean and covariance of (c_1 … c_n, μ, b) given them: every campaign's maximum as a reading."""
    information, weighted = statistics.likelihood.precision, statistics.likelihood.shift
    names = list(dict.fromkeys(statistics.machines))
    c, q, n = len(statistics.parameters), weighted.shape[1], len(names)
    prior = np.zeros((n * c + q, n * c + q))
    prior[n * c :, n * c :] = np.eye(q)
    for m in range(n):
        own = slice(m * c, (m + 1) * c)
        prior[own, n * c : n * c + c] = prior[n * c : n * c + c, own] = np.eye(c)
        for k in range(n):
            prior[own, k * c : (k + 1) * c] = np.eye(c) + (np.diag(spread**2) if k == m else 0.0)
    rows, readings, noise = [], [], []
    for machine, precision, weight in zip(statistics.machines, information, weighted, strict=True):
        row = np.zeros((q, n * c + q))
        row[:c, names.index(machine) * c : (names.index(machine) + 1) * c] = np.eye(c)
        row[c:, n * c + c :] = np.eye(q - c)
        rows.append(row)
        readings.append(np.linalg.solve(precision, weight))
        noise.append(np.linalg.inv(precision))
    design, reading = np.concatenate(rows), np.concatenate(readings)
    covariance = design @ prior @ design.T
    for k, own in enumerate(noise):
        covariance[k * q : (k + 1) * q, k * q : (k + 1) * q] += own
    gain = np.linalg.solve(covariance, design @ prior).T
    log_density = float(multivariate_normal(np.zeros(len(reading)), covariance).logpdf(reading))
    return log_density, gain @ reading, prior - gain @ design @ prior
