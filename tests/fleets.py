"""Fleets made up at the level of statistics, all Gaussian; and what they say, from one dense matrix
of everything."""

from __future__ import annotations

from dataclasses import replace
from datetime import date, timedelta
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
from campaigns import plan, simulated
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal

from ldbb_bayes.fleet.campaign_statistics import SufficientStatistics, sufficient_statistics
from ldbb_bayes.fleet.fleet_statistics import FleetStatistics
from ldbb_bayes.inference.nodes import HyperPosterior
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
    mu = np.broadcast_to(mean, c)
    s = np.broadcast_to(spread, c)
    b = rng.standard_normal(2)
    names = []
    information = []
    weighted = []
    for m in range(machines):
        own = mu + s * rng.standard_normal(c)
        own = own + (outlier if outlier is not None and m == 0 else 0.0)
        for _ in range(campaigns):
            design = rng.standard_normal((c + 4, c)) / known
            seen = np.hstack(
                [
                    design,
                    design[:, :1] * 0.3 + rng.standard_normal((c + 4, 1)),
                    rng.standard_normal((c + 4, 1)),
                ]
            )
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
    statistics: FleetStatistics,
    information: np.ndarray | None = None,
    weighted: np.ndarray | None = None,
    **other: Any,
) -> FleetStatistics:
    """The same with another Λ or η."""
    own = statistics.likelihood
    new = Gaussian(
        own.precision if information is None else information,
        own.shift if weighted is None else weighted,
    )
    return replace(statistics, likelihood=new, **other)


def of_campaigns(statistics: FleetStatistics, places: Any) -> FleetStatistics:
    """Some of the campaigns, in this order."""
    picked = {
        name: tuple(getattr(statistics, name)[k] for k in places)
        for name in ("campaigns", "machines", "dates")
    }
    return telling(
        statistics,
        statistics.likelihood.precision[places],
        statistics.likelihood.shift[places],
        **picked,
    )


def dense(statistics: FleetStatistics, spread: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
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
    return log_density, gain @ reading, prior - gain @ design @ prior


# ---- rows of a batch of one machine's campaigns, drawn from what one campaign like them says (its
# Λ)


@cache
def one_campaign() -> SufficientStatistics:
    model = HybridModel.first(degree=1).without("truncation")
    return sufficient_statistics(HyperPosterior(model.bind(simulated(plan())), truncated=False))


def row(found: SufficientStatistics, **fields: object) -> dict[str, object]:
    """As the batch keeps it."""
    usual = {
        "campaign": "a",
        "name": "a",
        "sha256": None,
        "compliances": None,
        "tolerances": None,
        "status": "done",
        "machine_id": "M1",
        "date": None,
        "topology": "wCAFYXZSt",
        "reference_force_N": 389.0,
        "force_min_N": 36.0,
        "force_max_N": 742.0,
        "converged": True,
        "kinds": [],
        **found.columns(),
    }
    return usual | fields


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
    found = one_campaign()
    inside = np.outer(found.prior_sd, found.prior_sd)
    values, vectors = np.linalg.eigh(
        (np.linalg.inv(found.covariance) - np.diag(found.prior_sd**-2.0)) * inside
    )
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    constant = [
        i for i, name in enumerate(found.names) if name.startswith("C_") and name.count("_") == 1
    ]
    rows = []
    for t in range(n):
        truth = found.mean.copy()
        truth[-2:] = instrument
        truth[constant] += scatter * found.prior_sd[constant] * rng.standard_normal(len(constant))
        if step_at is not None and t >= step_at:
            truth[found.names.index("C_XXX")] *= 1.0 + step
        weighted = (
            root @ (root.T @ (truth / found.prior_sd) + rng.standard_normal(len(truth)))
        ) / found.prior_sd
        own = replace(found, mean=found.covariance @ weighted)
        name = f"c{t + 1:02d}"
        day = date(2025, 1, 15) + timedelta(days=30 * t)
        rows.append(row(own, campaign=f"year/{name}", name=name, date=day.isoformat()))
    return pd.DataFrame(rows)


def with_prior(rows: pd.DataFrame, prior: dict[str, tuple[float, float]]) -> pd.DataFrame:
    """The same likelihoods under another prior of the parameters named, mean and sd."""
    changed = []
    for own in rows.to_dict("records"):
        names = list(own["gaussian_names"])
        q = len(names)
        covariance = np.zeros((q, q))
        covariance[np.tril_indices(q)] = own["gaussian_covariance"]
        covariance += np.tril(covariance, -1).T
        before_mean, before_sd = (
            np.array(own[f"gaussian_prior_{kind}"], dtype=float) for kind in ("mean", "sd")
        )
        mean = before_mean.copy()
        sd = before_sd.copy()
        for name, told in prior.items():
            mean[names.index(name)], sd[names.index(name)] = told
        scale = np.outer(before_sd, before_sd)
        precision = np.linalg.inv(covariance / scale)
        weighted = (
            precision @ (np.array(own["gaussian_mean"]) / before_sd) - before_mean / before_sd
        )
        ratio = before_sd / sd
        after = np.linalg.inv(precision + np.diag(ratio**2 - 1.0))
        found = after @ (weighted + ratio**2 * mean / before_sd) * before_sd
        changed.append(
            own
            | {
                "gaussian_mean": found.tolist(),
                "gaussian_covariance": (after * scale)[np.tril_indices(q)].tolist(),
                "gaussian_prior_mean": mean.tolist(),
                "gaussian_prior_sd": sd.tolist(),
            }
        )
    return pd.DataFrame(changed)


def doubts(found: Any) -> list[str]:
    """What is to be minded, in words."""
    return list(with_words(found)["doubts"])


def verdict(found: Any) -> str:
    return " ".join(trend_sentences(found))
