"""The recommended designs run in simulation and analysed as any campaign: widths, coverage, and
whether slopes are found."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import designs
import numpy as np
import pandas as pd

import ldbb_bayes as lb

WIDTHS = {
    "recommended six": 200,
    "the paper's six": 200,
    "nine, two radii": 200,
    "nine, both balls clocked": 200,
}
DECISIONS = {
    "settling: constant": 200,
    "settling: slopes": 200,
    "settling: equal slopes": 200,
    "settling: equal slopes, zero kept": 200,
    "C_XYX_1: absent": 200,
    "C_XYX_1: there": 200,
    "C_XYX_1: equal slopes": 200,
}
# Of the third edition, fewer: a campaign takes several times as long.
THIRD_WIDTHS = {"recommended six": 20, "nine, both balls clocked": 12}
THIRD_DECISIONS = {"settling: constant": 20, "settling: slopes": 20}
# The third edition is sampled with less effort.
SHORT = lb.inference.StoppingRule(ess=400.0, rhat=1.05, max_steps=1000)
# Evidence beyond this is decisive [nat].
DECISIVE = 5.0
HYPERS = ("sigma", "delta", "kappa", "tau")
EQUAL = ("C_XXX_1", "C_YYY_1")
SOUGHT = "C_XYX_1"


@dataclass(frozen=True)
class Truth:
    """Parameters [inside units] and hyper-parameters [µm]."""

    parameters: dict[str, float]
    hyper_um: dict[str, float]


@cache
def posterior(degree: int, edition: designs.Edition = "first") -> dict[str, Any]:
    """Independent draws from the posterior of the recovered experiment, by name, shape (draws,)."""
    model = designs.EDITIONS[edition].with_degree(degree)
    tree = lb.sample(model, designs.pilot(), sampler="independent", seed=1)
    return {
        str(name): values.to_numpy().ravel() for name, values in tree["posterior"].data_vars.items()
    }


def truth(degree: int, seed: int, edition: designs.Edition = "first") -> Truth:
    """One draw from the posterior; a circle's scale is drawn anew."""
    draw = {name: float(values[seed]) for name, values in posterior(degree, edition).items()}
    parameters = {name: value for name, value in draw.items() if name.startswith(("C_", "E_"))}
    hyper_um = {name: 1e3 * draw[name] for name in HYPERS}
    if "decay" in draw:
        hyper_um["decay"] = draw["decay"]
    return Truth(parameters, hyper_um)


def equal_slope() -> float:
    """Posterior mean of (C_XXX_1 + C_YYY_1) / 2 after the recovered experiment [mm/N²]."""
    return float(np.mean([posterior(1)[name].mean() for name in EQUAL]))


@cache
def plan_of(kind: str, edition: designs.Edition = "first") -> lb.Plan:
    """The plan of a kind of simulated campaign."""
    if kind.startswith("nine, "):
        return designs.nine(kind.removeprefix("nine, "), edition).plan()
    if edition == "third":
        return plan_of_third(kind)
    if kind == "recommended six":
        return designs.recommended().plan()
    if kind == "the paper's six":
        return designs.pilot().plan()
    if kind == "settling":
        return designs.settling().plan()
    if kind == SOUGHT:
        return designs.finding(SOUGHT).plan()
    raise KeyError(kind)


def plan_of_third(kind: str) -> lb.Plan:
    """The plan of a kind by the third edition: six circles, or as many as settle by the first."""
    if kind == "recommended six":
        return designs.six("third").plan()
    if kind == "settling":
        return designs.deciding(len(designs.settling().tests), "third").plan()
    raise KeyError(kind)


def width_row(kind: str, seed: int, edition: designs.Edition = "first") -> dict[str, float]:
    """Error of the mean and sd [inside units], and whether the 95 % interval held the truth, of
    every parameter."""
    true = truth(1, seed, edition)
    model = designs.EDITIONS[edition]
    simulation = model.simulate(
        plan_of(kind, edition), seed=1000 + seed, parameters=true.parameters, hyper_um=true.hyper_um
    )
    rule = None if edition == "first" else SHORT
    posterior_draws = lb.sample(
        model, simulation.campaign, sampler="independent", seed=seed, rule=rule
    )
    table = lb.summarize(posterior_draws)
    row = {}
    for name, value in true.parameters.items():
        entry = table.loc[name]
        row[f"{name} error"] = entry["mean"] - value
        row[f"{name} sd"] = entry["sd"]
        row[f"{name} inside"] = float(entry["ci_low"] <= value <= entry["ci_high"])
    return row


def third_width_row(kind: str, seed: int) -> dict[str, float]:
    """The same by the third edition."""
    return width_row(kind, seed, "third")


def decision_row(kind: str, seed: int, edition: designs.Edition = "first") -> dict[str, float]:
    """ln B [nat]: linear over constant, or linear over linear without the slope sought."""
    design, _, slopes = kind.partition(": ")
    one_slope_sought = slopes in ("absent", "there")
    true = truth(int(one_slope_sought), seed, edition)
    model = designs.EDITIONS[edition]
    linear = zero_kept(model) if slopes.endswith("zero kept") else model
    simulation = linear.simulate(
        plan_of(design, edition),
        seed=2000 + seed,
        parameters=true_parameters(slopes, true, seed, edition),
        hyper_um=true.hyper_um,
    )
    simpler = linear.fixing(SOUGHT) if one_slope_sought else linear.with_degree(0)
    evidence = lb.log_evidence(linear, simulation.campaign, tolerance=1e-2)
    evidence_of_simpler = lb.log_evidence(simpler, simulation.campaign, tolerance=1e-2)
    return {"ln B": lb.inference.log_bayes_factor(evidence, evidence_of_simpler)[0]}


def true_parameters(
    slopes: str, true: Truth, seed: int, edition: designs.Edition
) -> dict[str, float]:
    """Parameters of a campaign that is to decide, with slopes as its kind says."""
    rng = np.random.default_rng(7000 + seed)
    names = [name for name in posterior(1, edition) if name.startswith(("C_", "E_"))]
    parameters = dict.fromkeys(names, 0.0) | true.parameters
    if slopes == "slopes":
        parameters |= physical_slopes(parameters, rng, edition)
    elif slopes.startswith("equal slopes"):
        parameters |= dict.fromkeys(EQUAL, equal_slope())
    elif slopes == "there":
        size = slope_sd()[SOUGHT] * designs.SOUGHT[SOUGHT]
        parameters[SOUGHT] = size * rng.choice([-1.0, 1.0])
    elif slopes == "absent":
        parameters[SOUGHT] = 0.0
    return parameters


def third_decision_row(kind: str, seed: int) -> dict[str, float]:
    """The same by the third edition."""
    return decision_row(kind, seed, "third")


def zero_kept(model: lb.HybridModel) -> lb.HybridModel:
    """The model where only the centre moves between circles: the zero of the bar is checked before
    each."""
    terms = []
    for term in model.nuisances:
        if type(term).__name__ == "SetupShift":
            term = replace(term, moves="centre")
        terms.append(term)
    return replace(model, nuisances=tuple(terms))


@cache
def slope_sd(edition: designs.Edition = "first") -> dict[str, float]:
    """Prior sd of the slopes at the pilot's range of force [inside units]."""
    parameters = lb.identify(designs.EDITIONS[edition], designs.pilot()).parameters
    return {
        name: float(entry.prior_sd)
        for name, entry in parameters.items()
        if name.startswith("C_") and name.endswith("_1")
    }


def physical_slopes(
    parameters: dict[str, float], rng: np.random.Generator, edition: designs.Edition = "first"
) -> dict[str, float]:
    """Slopes from their prior, such that C_XXX, C_YYY and C_CCY are nowhere negative over the
    tested forces."""
    half_range = 0.5 * float(np.ptp(designs.pilot().forces_N))
    while True:
        slopes = {name: sd * rng.standard_normal() for name, sd in slope_sd(edition).items()}
        smallest = [
            parameters[name] - half_range * abs(slopes[f"{name}_1"])
            for name in ("C_XXX", "C_YYY", "C_CCY")
        ]
        if min(smallest) >= 0.0:
            return slopes


def widths(rows: pd.DataFrame, kind: str, predicted: dict[str, float]) -> dict[str, Any]:
    """Of every parameter: predicted sd (the median over all machines that are possible), median sd
    and rms error over it, coverage of 95 % intervals; and over all of them."""
    of_kind = rows[rows["kind"] == kind]
    table = {}
    for name, sd in predicted.items():
        rms_error = np.sqrt((of_kind[f"{name} error"] ** 2).mean())
        table[name] = {
            "predicted_sd": sd,
            "width_over_predicted": float(of_kind[f"{name} sd"].median() / sd),
            "rms_error_over_predicted": float(rms_error / sd),
            "coverage_95": float(of_kind[f"{name} inside"].mean()),
        }
    covered = of_kind[[f"{name} inside" for name in predicted]].mean(axis=1)
    return {
        "count": len(of_kind),
        "coverage_mean": float(covered.mean()),
        "coverage_mean_se": float(covered.std(ddof=1) / np.sqrt(len(of_kind))),
        "parameters": table,
    }


def decisions(rows: pd.DataFrame) -> dict[str, Any]:
    """Of every kind: ln B [nat], shares of either sign and of decisive evidence either way."""
    by_kind = {}
    for kind in dict.fromkeys(rows["kind"]):
        value = rows.loc[rows["kind"] == kind, "ln B"].to_numpy()
        low, median, high = np.quantile(value, [0.05, 0.5, 0.95])
        by_kind[kind] = {
            "count": len(value),
            "q5": low,
            "median": median,
            "q95": high,
            "positive": share(value > 0.0),
            "decisive with": share(value > DECISIVE),
            "decisive without": share(value < -DECISIVE),
        }
    return by_kind


def share(hits: np.ndarray) -> dict[str, float]:
    """Share of hits and its standard error (no less than for half a hit)."""
    p = float(np.mean(hits))
    count = len(hits)
    return {"share": p, "se": float(np.sqrt(max(p * (1.0 - p), 0.25 / count) / count))}
