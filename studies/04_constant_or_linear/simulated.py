"""Simulated campaigns: does the comparison find slopes that are there, none that are not, and
circles that do not belong?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pandas as pd

import ldbb_bayes as lb

FORCES_N = (36.0, 112.0, 238.0, 364.0, 490.0, 616.0, 742.0)
READINGS = 360
TRUTH = {
    "C_XXX": 5.5e-5,
    "C_XYX": 5e-7,
    "C_YYY": 4.2e-5,
    "C_CXY": 1e-8,
    "C_CYY": -1e-8,
    "C_CCY": 4e-10,
    "E_XX1": -1e-4,
    "E_YX2": 4e-7,
    "E_XY2": -6e-7,
    "E_YY1": -8e-5,
    "E_C0YX": 5e-6,
    "E_Xt0": 4e-3,
    "E_Yt0": -1e-3,
}
HYPER_UM = {"sigma": 0.3, "delta": 0.5, "kappa": 0.3, "tau": 2.0}
SIZE_SD = 3.0
OUTLIER_KAPPAS = 8.0
LINEAR = lb.HybridModel.first(1)
CONSTANT = lb.HybridModel.first(0)
SLOPES = ("C_XXX_1", "C_XYX_1", "C_YYY_1", "C_CXY_1", "C_CYY_1", "C_CCY_1")
EVIDENCE_KINDS = {"no slope": 200, "six slopes": 200, "one slope": 200}
PRIOR_KINDS = {"from the priors": 400}
BELONGING_KINDS = {"clean": 100, "clean, from the priors": 100, "outlier": 100}
BINS = 8


def plan() -> lb.Plan:
    """The paper's seven forces."""
    angle = np.arange(READINGS) * 360.0 / READINGS
    return lb.Campaign(tuple(lb.CircularTest(force, angle) for force in FORCES_N))


def log_bayes_factor(model: lb.HybridModel, campaign: lb.Campaign) -> float:
    """ln B(model/constant) [nat]."""
    own, other = (lb.log_evidence(m, campaign, tolerance=1e-2) for m in (model, CONSTANT))
    return lb.inference.log_bayes_factor(own, other)[0]


@cache
def slope_sd() -> dict[str, float]:
    """Posterior sd of every slope where there is none [inside units]: three of these are called a
    slope."""
    campaign = LINEAR.simulate(plan(), seed=1, parameters=TRUTH, hyper_um=HYPER_UM).campaign
    table = lb.inference.marginalize(LINEAR, campaign)
    return {name: float(table.loc[name, "sd"]) for name in SLOPES}


def evidence_row(kind: str, seed: int) -> dict[str, float]:
    """ln B [nat] of one campaign with no slope, with all six or with one in turn; and with that one
    alone in the model."""
    name = SLOPES[seed % len(SLOPES)]
    chosen = {"no slope": (), "six slopes": SLOPES, "one slope": (name,)}[kind]
    truth = TRUTH | {slope: SIZE_SD * slope_sd()[slope] for slope in chosen}
    campaign = LINEAR.simulate(
        plan(), seed=1000 + seed, parameters=truth, hyper_um=HYPER_UM
    ).campaign
    alone = LINEAR.fixing(*(other for other in SLOPES if other != name))
    return {
        "linear": log_bayes_factor(LINEAR, campaign),
        "that slope alone": log_bayes_factor(alone, campaign) if kind == "one slope" else np.nan,
    }


def prior_row(kind: str, seed: int) -> dict[str, float]:
    """Posterior probability of linear [1], and whether it was: model, parameters and
    hyper-parameters from their priors."""
    is_linear = np.random.default_rng(5000 + seed).random() < 0.5
    campaign = (LINEAR if is_linear else CONSTANT).simulate(plan(), seed=5000 + seed).campaign
    return {
        "probability": 1.0 / (1.0 + np.exp(-log_bayes_factor(LINEAR, campaign))),
        "was linear": float(is_linear),
    }


def belonging_row(kind: str, seed: int) -> dict[str, float]:
    """Whether the outlying circle was flagged, and how many others were."""
    number = 1000 + seed
    if kind == "clean, from the priors":
        campaign = (LINEAR if number % 2 else CONSTANT).simulate(plan(), seed=number).campaign
        odd = -1
    else:
        campaign = CONSTANT.simulate(
            plan(), seed=number, parameters=TRUTH, hyper_um=HYPER_UM
        ).campaign
        campaign, odd = (
            with_outlier(campaign, np.random.default_rng(number))
            if kind == "outlier"
            else (campaign, -1)
        )
    found = lb.find_outlying_tests(
        {"constant": CONSTANT, "linear": LINEAR}, campaign, seed=number, replicates=5000
    )
    flags = found["flag"].to_numpy(dtype=float)
    hit = flags[odd] if odd >= 0 else 0.0
    return {"flagged": hit, "others": flags.sum() - hit}


def with_outlier(campaign: lb.Campaign, rng: np.random.Generator) -> tuple[lb.Campaign, int]:
    """One circle moved by eight κ, of either sign, in every harmonic of orders 0 to 3."""
    odd = int(rng.integers(len(FORCES_N)))
    tests = list(campaign.tests)
    angle = tests[odd].angles_rad()
    harmonics = [np.ones_like(angle), *(f(n * angle) for n in (1, 2, 3) for f in (np.cos, np.sin))]
    offset = (
        OUTLIER_KAPPAS * HYPER_UM["kappa"] * (rng.choice([-1.0, 1.0], len(harmonics)) @ harmonics)
    )
    tests[odd] = tests[odd].with_reading_um(tests[odd].reading_um + offset)
    return replace(campaign, tests=tuple(tests)), odd


def summary(
    evidence: pd.DataFrame, priors: pd.DataFrame, belonging: pd.DataFrame
) -> dict[str, Any]:
    """What the page says of them."""
    own = dict(list(evidence.groupby("kind")))
    flags = dict(list(belonging.groupby("kind")))
    return {
        "forces_N": list(FORCES_N),
        "readings": READINGS,
        "size_sd": SIZE_SD,
        "outlier_kappas": OUTLIER_KAPPAS,
        "slope_sd": slope_sd(),
        "no slope": signs(own["no slope"]["linear"], positive=False),
        "six slopes": signs(own["six slopes"]["linear"], positive=True),
        "one slope, six in the model": signs(own["one slope"]["linear"], positive=True),
        "one slope, that one in the model": signs(
            own["one slope"]["that slope alone"], positive=True
        ),
        "reliability": reliability(priors["probability"], priors["was linear"]),
        "outlier flagged": share(flags["outlier"]["flagged"] > 0.0),
        "others flagged beside an outlier": share(flags["outlier"]["others"] > 0.0),
        "false alarm": share(flags["clean"]["others"] > 0.0),
        "false alarm, from the priors": share(flags["clean, from the priors"]["others"] > 0.0),
    }


def signs(values: pd.Series, *, positive: bool) -> dict[str, float]:
    """Share of the right sign, and the spread of ln B [nat]."""
    low, median, high = np.quantile(values, [0.05, 0.5, 0.95])
    return {
        **share(values > 0.0 if positive else values < 0.0),
        "median": median,
        "q5": low,
        "q95": high,
    }


def share(hits: pd.Series) -> dict[str, float]:
    """Share of hits, its standard error (no less than for half a hit) and of how many."""
    p = float(np.mean(hits))
    count = len(hits)
    return {
        "share": p,
        "se": float(np.sqrt(max(p * (1.0 - p), 0.25 / count) / count)),
        "count": count,
    }


def reliability(
    probability: Sequence[float] | pd.Series, outcome: Sequence[float] | pd.Series
) -> dict[str, Any]:
    """Claimed probability of linear against how often it was, in bins of equal count; and a test of
    their agreement.

    Spiegelhalter's z is standard normal when the probabilities are calibrated.
    """
    p = np.array(probability, dtype=float)
    y = np.array(outcome, dtype=float)
    order = np.array_split(np.argsort(p, kind="stable"), BINS)
    z = np.sum((y - p) * (1.0 - 2.0 * p)) / np.sqrt(np.sum((1.0 - 2.0 * p) ** 2 * p * (1.0 - p)))
    return {
        "claimed": [float(p[own].mean()) for own in order],
        "was linear": [float(y[own].mean()) for own in order],
        "count": [len(own) for own in order],
        "spiegelhalter_z": float(z),
        "mean claimed": float(p.mean()),
        "mean was linear": float(y.mean()),
        "right sign": share(pd.Series((p > 0.5) == (y > 0.5))),
    }
