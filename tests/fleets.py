"""Simulated Gaussian fleets, and their posterior from one dense matrix."""

from __future__ import annotations

from dataclasses import replace
from datetime import date, timedelta
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from campaigns import plan, simulated
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal

from ldbb_bayes.fleet.campaign_statistics import SufficientStatistics, sufficient_statistics
from ldbb_bayes.fleet.fleet_statistics import FleetStatistics
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.report.wording import trend_sentences, with_words

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
    uncertainty: float = 0.1,
    outlier: np.ndarray | None = None,
) -> FleetStatistics:
    """Campaigns of machines drawn from a population, in units of the prior sd.

    Parameters
    ----------
    spread, mean
        Of the population.
    uncertainty
        Size of a campaign's standard uncertainty.
    outlier
        Added to the first machine.
    """
    c = parameters
    mu = np.broadcast_to(mean, c)
    s = np.broadcast_to(spread, c)
    b = rng.standard_normal(2)
    names = []
    information = []
    weighted = []
    for m in range(machines):
        machine = mu + s * rng.standard_normal(c)
        if outlier is not None and m == 0:
            machine = machine + outlier
        for _ in range(campaigns):
            design = rng.standard_normal((c + 4, c)) / uncertainty
            mount = design[:, :1] * 0.3 + rng.standard_normal((c + 4, 1))
            force_gain = rng.standard_normal((c + 4, 1))
            rows = np.hstack([design, mount, force_gain])
            reading = rows @ np.concatenate([machine, b]) + rng.standard_normal(c + 4)
            information.append(rows.T @ rows)
            weighted.append(rows.T @ reading)
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


def with_likelihood(
    statistics: FleetStatistics,
    information: np.ndarray | None = None,
    weighted: np.ndarray | None = None,
    **other: Any,
) -> FleetStatistics:
    """Return the statistics with another Λ or η."""
    if information is None:
        information = statistics.likelihood.precision
    if weighted is None:
        weighted = statistics.likelihood.shift
    return replace(statistics, likelihood=Gaussian(information, weighted), **other)


def of_campaigns(statistics: FleetStatistics, places: Any) -> FleetStatistics:
    """Return some of the campaigns, in this order."""
    picked = {}
    for name in ("campaigns", "machines", "dates"):
        values = getattr(statistics, name)
        picked[name] = tuple(values[k] for k in places)
    return with_likelihood(
        statistics,
        statistics.likelihood.precision[places],
        statistics.likelihood.shift[places],
        **picked,
    )


class DensePosterior(NamedTuple):
    log_density: float
    mean: np.ndarray
    covariance: np.ndarray


def dense(statistics: FleetStatistics, spread: np.ndarray) -> DensePosterior:
    """ln p(estimates | s), and mean and covariance of (c_1 … c_n, μ, b) given them: every
    campaign's maximum as a reading."""
    information = statistics.likelihood.precision
    weighted = statistics.likelihood.shift
    names = list(dict.fromkeys(statistics.machines))
    c = len(statistics.parameters)
    q = weighted.shape[1]
    n = len(names)
    common = np.kron(np.ones((n, 1)), np.eye(c, q))
    prior = np.block(
        [
            [common @ common.T + np.kron(np.eye(n), np.diag(spread**2)), common],
            [common.T, np.eye(q)],
        ]
    )
    rows = []
    readings = []
    noise = []
    for machine, precision, weight in zip(statistics.machines, information, weighted, strict=True):
        row = np.zeros((q, n * c + q))
        row[:c, names.index(machine) * c : (names.index(machine) + 1) * c] = np.eye(c)
        row[c:, n * c + c :] = np.eye(q - c)
        rows.append(row)
        readings.append(np.linalg.solve(precision, weight))
        noise.append(np.linalg.inv(precision))
    design = np.concatenate(rows)
    reading = np.concatenate(readings)
    covariance = design @ prior @ design.T + block_diag(*noise)
    gain = np.linalg.solve(covariance, design @ prior).T
    log_density = float(multivariate_normal(np.zeros(len(reading)), covariance).logpdf(reading))
    return DensePosterior(log_density, gain @ reading, prior - gain @ design @ prior)


# ---- rows of a batch: campaigns of one machine, drawn with the Λ of one real campaign


@cache
def one_campaign() -> SufficientStatistics:
    model = HybridModel.first(degree=1).without("truncation")
    return sufficient_statistics(HyperPosterior(model.bind(simulated(plan())), truncated=False))


def row(statistics: SufficientStatistics, **fields: object) -> dict[str, object]:
    """Return the row of a campaign in the table of a batch."""
    default = {
        "campaign": "a",
        "name": "a",
        "sha256": None,
        "circles_sha256": None,
        "compliances": None,
        "tolerances": None,
        "status": "done",
        "machine_id": "M1",
        "date": None,
        "topology": "wCAFYXZSt",
        "planes": "XY",
        "circles": None,
        "reference_force_N": 389.0,
        "force_min_N": 36.0,
        "force_max_N": 742.0,
        "converged": True,
        "kinds": [],
        "terms": [],
        **statistics.columns(),
    }
    return default | fields


def drawn_rows(
    n: int,
    rng: np.random.Generator,
    *,
    step_at: int | None = None,
    step: float = 0.2,
    scatter: float = 0.003,
    instrument: tuple[float, float] = (1e-4, 0.005),
) -> pd.DataFrame:
    """n campaigns a month apart; C_XXX grows by ``step`` before campaign ``step_at`` (from 0)."""
    statistics = one_campaign()
    prior_sd = statistics.prior_sd
    precision = np.linalg.inv(statistics.covariance) - np.diag(prior_sd**-2.0)
    values, vectors = np.linalg.eigh(precision * np.outer(prior_sd, prior_sd))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    constant = []
    for i, name in enumerate(statistics.names):
        if name.startswith("C_") and name.count("_") == 1:
            constant.append(i)
    rows = []
    for t in range(n):
        truth = statistics.mean.copy()
        truth[-2:] = statistics.prior_mean[-2:] + instrument
        truth[constant] += scatter * prior_sd[constant] * rng.standard_normal(len(constant))
        if step_at is not None and t >= step_at:
            truth[statistics.names.index("C_XXX")] *= 1.0 + step
        noise = rng.standard_normal(len(truth))
        shift = (root @ (root.T @ (truth / prior_sd) + noise)) / prior_sd
        shift = shift + statistics.prior_mean / prior_sd**2
        drawn = replace(statistics, mean=statistics.covariance @ shift)
        name = f"c{t + 1:02d}"
        day = date(2025, 1, 15) + timedelta(days=30 * t)
        rows.append(row(drawn, campaign=f"year/{name}", name=name, date=day.isoformat()))
    return pd.DataFrame(rows)


def with_prior(rows: pd.DataFrame, prior: dict[str, tuple[float, float]]) -> pd.DataFrame:
    """Return the same likelihoods under another prior (mean and sd) of the named parameters."""
    return pd.DataFrame([_row_with_prior(entry, prior) for entry in rows.to_dict("records")])


def _row_with_prior(entry: dict[Any, Any], prior: dict[str, tuple[float, float]]) -> dict[Any, Any]:
    names = list(entry["gaussian_names"])
    q = len(names)
    covariance = np.zeros((q, q))
    covariance[np.tril_indices(q)] = entry["gaussian_covariance"]
    covariance += np.tril(covariance, -1).T
    old_mean = np.array(entry["gaussian_prior_mean"], dtype=float)
    old_sd = np.array(entry["gaussian_prior_sd"], dtype=float)
    new_mean = old_mean.copy()
    new_sd = old_sd.copy()
    for name, (prior_mean, prior_sd) in prior.items():
        new_mean[names.index(name)] = prior_mean
        new_sd[names.index(name)] = prior_sd
    scale = np.outer(old_sd, old_sd)
    precision = np.linalg.inv(covariance / scale)
    posterior_mean = np.array(entry["gaussian_mean"])
    shift = precision @ (posterior_mean / old_sd) - old_mean / old_sd
    ratio = old_sd / new_sd
    new_covariance = np.linalg.inv(precision + np.diag(ratio**2 - 1.0))
    new_shift = shift + ratio**2 * new_mean / old_sd
    return entry | {
        "gaussian_mean": (new_covariance @ new_shift * old_sd).tolist(),
        "gaussian_covariance": (new_covariance * scale)[np.tril_indices(q)].tolist(),
        "gaussian_prior_mean": new_mean.tolist(),
        "gaussian_prior_sd": new_sd.tolist(),
    }


def doubts(result: Any) -> list[str]:
    """Return the caveats of a result in words."""
    return list(with_words(result)["doubts"])


def verdict(trend: Any) -> str:
    return " ".join(trend_sentences(trend))
