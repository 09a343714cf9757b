"""Simulated campaigns: does the comparison find slopes that are there, none that are not, and
circles that do not belong?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import ldbb_bayes as lb

Array = NDArray[np.float64]
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
    of_model = lb.log_evidence(model, campaign, tolerance=1e-2)
    of_constant = lb.log_evidence(CONSTANT, campaign, tolerance=1e-2)
    return lb.inference.log_bayes_factor(of_model, of_constant)[0]


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
    slope_in_turn = SLOPES[seed % len(SLOPES)]
    slopes_of_kind = {"no slope": (), "six slopes": SLOPES, "one slope": (slope_in_turn,)}
    truth = dict(TRUTH)
    for slope in slopes_of_kind[kind]:
        truth[slope] = SIZE_SD * slope_sd()[slope]
    campaign = LINEAR.simulate(
        plan(), seed=1000 + seed, parameters=truth, hyper_um=HYPER_UM
    ).campaign
    row = {"linear": log_bayes_factor(LINEAR, campaign), "that slope alone": np.nan}
    if kind == "one slope":
        fixed_slopes = [slope for slope in SLOPES if slope != slope_in_turn]
        row["that slope alone"] = log_bayes_factor(LINEAR.fixing(*fixed_slopes), campaign)
    return row


def prior_row(kind: str, seed: int) -> dict[str, float]:
    """Posterior probability of linear [1], and whether it was: model, parameters and
    hyper-parameters from their priors."""
    is_linear = np.random.default_rng(5000 + seed).random() < 0.5
    model = LINEAR if is_linear else CONSTANT
    campaign = model.simulate(plan(), seed=5000 + seed).campaign
    return {
        "probability": 1.0 / (1.0 + np.exp(-log_bayes_factor(LINEAR, campaign))),
        "was linear": float(is_linear),
    }


def belonging_row(kind: str, seed: int) -> dict[str, float]:
    """Whether the outlying circle was flagged, and how many others were."""
    seed = 1000 + seed
    if kind == "clean, from the priors":
        model = LINEAR if seed % 2 else CONSTANT
        campaign = model.simulate(plan(), seed=seed).campaign
    else:
        campaign = CONSTANT.simulate(
            plan(), seed=seed, parameters=TRUTH, hyper_um=HYPER_UM
        ).campaign
    if kind != "outlier":
        return {"flagged": 0.0, "others": flags_of(campaign, seed).sum()}
    campaign, outlier = with_outlier(campaign, np.random.default_rng(seed))
    flags = flags_of(campaign, seed)
    return {"flagged": flags[outlier], "others": flags.sum() - flags[outlier]}


def flags_of(campaign: lb.Campaign, seed: int) -> Array:
    """One for every circle that is flagged, zero for the others."""
    models = {"constant": CONSTANT, "linear": LINEAR}
    table = lb.find_outlying_tests(models, campaign, seed=seed, replicates=5000)
    return table["flag"].to_numpy(dtype=float)


def with_outlier(campaign: lb.Campaign, rng: np.random.Generator) -> tuple[lb.Campaign, int]:
    """One circle, and its position, offset by eight κ, of either sign, in every harmonic of orders
    0 to 3."""
    outlier = int(rng.integers(len(FORCES_N)))
    tests = list(campaign.tests)
    angle_rad = tests[outlier].angles_rad()
    harmonics = [np.ones_like(angle_rad)]
    for order in (1, 2, 3):
        harmonics += [np.cos(order * angle_rad), np.sin(order * angle_rad)]
    signs = rng.choice([-1.0, 1.0], len(harmonics))
    offset_um = OUTLIER_KAPPAS * HYPER_UM["kappa"] * (signs @ harmonics)
    tests[outlier] = tests[outlier].with_reading_um(tests[outlier].reading_um + offset_um)
    return replace(campaign, tests=tuple(tests)), outlier


def summary(
    evidence: pd.DataFrame, priors: pd.DataFrame, belonging: pd.DataFrame
) -> dict[str, Any]:
    """What the page says of them."""
    log_bayes_factors = dict(list(evidence.groupby("kind")))
    flags = dict(list(belonging.groupby("kind")))
    no_slope = log_bayes_factors["no slope"]
    six_slopes = log_bayes_factors["six slopes"]
    one_slope = log_bayes_factors["one slope"]
    return {
        "forces_N": list(FORCES_N),
        "readings": READINGS,
        "size_sd": SIZE_SD,
        "outlier_kappas": OUTLIER_KAPPAS,
        "slope_sd": slope_sd(),
        "no slope": right_signs(no_slope["linear"], positive=False),
        "six slopes": right_signs(six_slopes["linear"], positive=True),
        "one slope, six in the model": right_signs(one_slope["linear"], positive=True),
        "one slope, that one in the model": right_signs(
            one_slope["that slope alone"], positive=True
        ),
        "reliability": reliability(priors["probability"], priors["was linear"]),
        "outlier flagged": share(flags["outlier"]["flagged"] > 0.0),
        "others flagged beside an outlier": share(flags["outlier"]["others"] > 0.0),
        "false alarm": share(flags["clean"]["others"] > 0.0),
        "false alarm, from the priors": share(flags["clean, from the priors"]["others"] > 0.0),
    }


def right_signs(log_bayes_factors: pd.Series, *, positive: bool) -> dict[str, float]:
    """Share of the right sign, and the spread of ln B [nat]."""
    low, median, high = np.quantile(log_bayes_factors, [0.05, 0.5, 0.95])
    is_right = log_bayes_factors > 0.0 if positive else log_bayes_factors < 0.0
    return {**share(is_right), "median": median, "q5": low, "q95": high}


def share(hits: pd.Series) -> dict[str, float]:
    """Share of hits, its standard error (no less than for half a hit) and of how many."""
    p = float(np.mean(hits))
    count = len(hits)
    variance = max(p * (1.0 - p), 0.25 / count) / count
    return {"share": p, "se": float(np.sqrt(variance)), "count": count}


def reliability(
    probability: Sequence[float] | pd.Series, outcome: Sequence[float] | pd.Series
) -> dict[str, Any]:
    """Claimed probability of linear against how often it was, in bins of equal count; and a test of
    their agreement."""
    p = np.array(probability, dtype=float)
    y = np.array(outcome, dtype=float)
    bins = np.array_split(np.argsort(p, kind="stable"), BINS)
    return {
        "claimed": [float(p[members].mean()) for members in bins],
        "was linear": [float(y[members].mean()) for members in bins],
        "count": [len(members) for members in bins],
        "spiegelhalter_z": spiegelhalter_z(p, y),
        "mean claimed": float(p.mean()),
        "mean was linear": float(y.mean()),
        "right sign": share(pd.Series((p > 0.5) == (y > 0.5))),
    }


def spiegelhalter_z(p: Array, y: Array) -> float:
    """Standard normal when the probabilities p of the outcomes y are calibrated."""
    weight = 1.0 - 2.0 * p
    variance = np.sum(weight**2 * p * (1.0 - p))
    return float(np.sum((y - p) * weight) / np.sqrt(variance))
