"""Rows of a batch of one machine's campaigns, drawn from what one campaign like them says (its Λ), for tests."""

from __future__ import annotations

from dataclasses import replace
from datetime import date, timedelta
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
from campaigns import plan, simulated

from ldbb_bayes.fleet.statistics import SufficientStatistics, sufficient_statistics
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.report.wording import trend_sentences, with_words


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
    values, vectors = np.linalg.eigh((np.linalg.inv(found.covariance) - np.diag(found.prior_sd**-2.0)) * inside)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    constant = [i for i, name in enumerate(found.names) if name.startswith("C_") and name.count("_") == 1]
    rows = []
    for t in range(n):
        truth = found.mean.copy()
        truth[-2:] = instrument
        truth[constant] += scatter * found.prior_sd[constant] * rng.standard_normal(len(constant))
        if step_at is not None and t >= step_at:
            truth[found.names.index("C_XXX")] *= 1.0 + step
        weighted = (root @ (root.T @ (truth / found.prior_sd) + rng.standard_normal(len(truth)))) / found.prior_sd
        own = replace(found, mean=found.covariance @ weighted)
        name, day = f"c{t + 1:02d}", date(2025, 1, 15) + timedelta(days=30 * t)
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
        before_mean, before_sd = (np.array(own[f"gaussian_prior_{kind}"], dtype=float) for kind in ("mean", "sd"))
        mean, sd = before_mean.copy(), before_sd.copy()
        for name, told in prior.items():
            mean[names.index(name)], sd[names.index(name)] = told
        scale = np.outer(before_sd, before_sd)
        precision = np.linalg.inv(covariance / scale)
        weighted = precision @ (np.array(own["gaussian_mean"]) / before_sd) - before_mean / before_sd
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
