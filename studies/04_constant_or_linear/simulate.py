"""Does the comparison find slopes that are there, none that are not, and tests that do not belong? Simulated campaigns.

python studies/04_constant_or_linear/simulate.py            # 20 campaigns of each kind, a minute
python studies/04_constant_or_linear/simulate.py --write    # 200 of each (400 for the probabilities), a quarter of an hour
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import ldbb_bayes as lb

HERE = Path(__file__).resolve().parent
FORCES_N = (36.0, 112.0, 238.0, 364.0, 490.0, 616.0, 742.0)
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
OFFSET_KAPPAS = 8.0
LINEAR, CONSTANT = lb.HybridModel.default(1), lb.HybridModel.default(0)
SLOPES = ("C_XXX_1", "C_XYX_1", "C_YYY_1", "C_CXY_1", "C_CYY_1", "C_CCY_1")


def plan() -> lb.Campaign:
    """The paper's seven forces, 360 readings each."""
    return lb.Campaign(tuple(lb.CircularTest(force, np.arange(360.0)) for force in FORCES_N))


def log_bayes_factor(model: lb.HybridModel, campaign: lb.Campaign) -> float:
    """ln B(model/constant)."""
    own, other = (lb.log_evidence(m, campaign, tolerance=1e-2) for m in (model, CONSTANT))
    return lb.log_bayes_factor(own, other)[0]


def posterior_sd() -> dict[str, float]:
    """Posterior sd of every slope where there is none: what three of are called a slope."""
    campaign = LINEAR.simulate(plan(), seed=1, parameters=TRUTH, hyper_um=HYPER_UM).campaign
    return {name: float(lb.marginals(LINEAR, campaign).loc[name, "sd"]) for name in SLOPES}


def with_slopes(seed: int, slopes: dict[str, float]) -> float:
    """ln B(linear/constant) of one campaign with these slopes."""
    truth = TRUTH | slopes
    return log_bayes_factor(LINEAR, LINEAR.simulate(plan(), seed=seed, parameters=truth, hyper_um=HYPER_UM).campaign)


def one_slope(seed: int, slopes: dict[str, float]) -> tuple[float, float]:
    """The same with one of the slopes, in turn: against all six slopes, and against that slope alone."""
    name = SLOPES[seed % len(SLOPES)]
    truth = TRUTH | {name: slopes[name]}
    campaign = LINEAR.simulate(plan(), seed=seed, parameters=truth, hyper_um=HYPER_UM).campaign
    alone = LINEAR.fixing(*(other for other in SLOPES if other != name))
    return log_bayes_factor(LINEAR, campaign), log_bayes_factor(alone, campaign)


def from_prior(seed: int) -> tuple[float, bool]:
    """Posterior probability of linear, and whether it was: model, parameters and hyper-parameters drawn from their priors."""
    is_linear = bool(np.random.default_rng(seed).random() < 0.5)
    campaign = (LINEAR if is_linear else CONSTANT).simulate(plan(), seed=seed).campaign
    return float(1.0 / (1.0 + np.exp(-log_bayes_factor(LINEAR, campaign)))), is_linear


def flagged(seed: int, *, outlier: bool) -> tuple[bool, int]:
    """Whether the outlying test was flagged, and how many others were."""
    rng = np.random.default_rng(seed)
    campaign = CONSTANT.simulate(plan(), seed=seed, parameters=TRUTH, hyper_um=HYPER_UM).campaign
    odd = int(rng.integers(len(FORCES_N))) if outlier else -1
    tests = list(campaign.tests)
    if outlier:
        angle = np.deg2rad(tests[odd].angle_deg)
        harmonics = [np.ones_like(angle), *(f(n * angle) for n in (1, 2, 3) for f in (np.cos, np.sin))]
        offset = OFFSET_KAPPAS * HYPER_UM["kappa"] * (rng.choice([-1.0, 1.0], len(harmonics)) @ harmonics)
        tests[odd] = tests[odd].with_reading_um(tests[odd].reading_um + offset)
    found = lb.belonging(
        {"constant": CONSTANT, "linear": LINEAR}, replace(campaign, tests=tuple(tests)), seed=seed, replicates=5000
    )
    flags = found["flag"].to_numpy()
    return bool(outlier and flags[odd]), int(flags.sum()) - int(outlier and flags[odd])


def clean_from_prior(seed: int) -> int:
    """Tests flagged in a campaign of which everything is drawn from the priors."""
    model = LINEAR if seed % 2 else CONSTANT
    campaign = model.simulate(plan(), seed=seed).campaign
    return int(lb.belonging({"constant": CONSTANT, "linear": LINEAR}, campaign, seed=seed)["flag"].sum())


def measure(campaigns: int) -> dict[str, Any]:
    """All experiments on every core."""
    sd = posterior_sd()
    three = {name: 3.0 * value for name, value in sd.items()}
    seeds = range(1000, 1000 + campaigns)
    with ProcessPoolExecutor(os.cpu_count(), mp_context=multiprocessing.get_context("spawn")) as pool:
        run = partial(pool.map, chunksize=2)
        none = list(run(partial(with_slopes, slopes={}), seeds))
        every = list(run(partial(with_slopes, slopes=three), seeds))
        single = list(run(partial(one_slope, slopes=three), seeds))
        drawn = list(run(from_prior, range(5000, 5000 + 2 * campaigns)))
        clean = list(run(partial(flagged, outlier=False), seeds))
        any_ = list(run(clean_from_prior, seeds))
        odd = list(run(partial(flagged, outlier=True), seeds))
    return {
        "campaigns": campaigns,
        "forces_N": list(FORCES_N),
        "slope_posterior_sd": sd,
        "no slope": summary(np.array(none), positive=False),
        "all slopes of 3 posterior sd": summary(np.array(every), positive=True),
        "one slope of 3 posterior sd, six in the model": summary(np.array(single)[:, 0], positive=True),
        "one slope of 3 posterior sd, that one in the model": summary(np.array(single)[:, 1], positive=True),
        "reliability": reliability(drawn),
        "outlier flagged": share([hit for hit, _ in odd]),
        "others flagged beside an outlier": share([others > 0 for _, others in odd]),
        "false alarm in a clean campaign": share([others > 0 for _, others in clean]),
        "false alarm in a clean campaign drawn from the priors": share([others > 0 for others in any_]),
    }


def summary(values: np.ndarray, *, positive: bool) -> dict[str, float]:
    """Share of the right sign, and the spread of ln B."""
    low, median, high = np.quantile(values, [0.05, 0.5, 0.95])
    right = values > 0 if positive else values < 0
    return {**share(right), "ln_b_median": float(median), "ln_b_5": float(low), "ln_b_95": float(high)}


def share(hits: Sequence[bool] | np.ndarray) -> dict[str, float]:
    """Share of hits and its standard error."""
    p = float(np.mean(hits))
    return {"share": p, "se": float(np.sqrt(max(p * (1.0 - p), 0.25 / len(hits)) / len(hits)))}


def reliability(drawn: Sequence[tuple[float, bool]], bins: int = 8) -> dict[str, Any]:
    """Claimed probability of linear against how often it was linear, in bins of equal count; and a test of their agreement.

    Spiegelhalter's z is standard normal when the probabilities are calibrated.
    """
    probability, outcome = (np.array(column, dtype=float) for column in zip(*drawn, strict=True))
    order = np.array_split(np.argsort(probability), bins)
    variance = np.sum((1.0 - 2.0 * probability) ** 2 * probability * (1.0 - probability))
    z = np.sum((outcome - probability) * (1.0 - 2.0 * probability)) / np.sqrt(variance)
    return {
        "claimed": [float(probability[own].mean()) for own in order],
        "was_linear": [float(outcome[own].mean()) for own in order],
        "count": [len(own) for own in order],
        "spiegelhalter_z": float(z),
        "mean_claimed": float(probability.mean()),
        "mean_was_linear": float(outcome.mean()),
        "right_sign": share((probability > 0.5) == (outcome > 0.5)),
    }


def draw(results: dict[str, Any]) -> Figure:
    """The reliability plot."""
    found = results["reliability"]
    figure = Figure(figsize=(4.6, 4.4), layout="constrained")
    axes = figure.subplots()
    claimed, seen, count = (np.array(found[name]) for name in ("claimed", "was_linear", "count"))
    spread = np.sqrt(np.maximum(claimed * (1.0 - claimed), 0.25 / count) / count)
    axes.plot([0.0, 1.0], [0.0, 1.0], color="#8C8C8C", linewidth=0.9)
    axes.errorbar(claimed, seen, 2.0 * spread, fmt="o", color="#0072B2", capsize=3)
    axes.set_xlabel("claimed probability of linear (1)")
    axes.set_ylabel("share that was linear (1), ± 2 standard errors")
    axes.set_title(f"{sum(found['count'])} campaigns from the priors", fontsize=9.5)
    return figure


def main() -> None:
    """Measure; ``--write`` keeps the numbers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--write", action="store_true", help="200 campaigns of each kind; write simulations.json and reliability.png"
    )
    options = parser.parse_args()
    results = measure(200 if options.write else 20)
    print(json.dumps(results, indent=2))
    if options.write:
        (HERE / "simulations.json").write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
        draw(results).savefig(HERE / "reliability.png", dpi=150)


if __name__ == "__main__":
    main()
