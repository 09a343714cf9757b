"""The recommended designs run in simulation and analysed as any campaign: widths, coverage, and
whether slopes are found."""

from __future__ import annotations

from collections.abc import Callable
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
SHORT = lb.inference.StoppingRule(ess=400.0, rhat=1.05, max_steps=1000)
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
    """One draw of it; a circle's scale is drawn anew."""
    drawn = {name: float(values[seed]) for name, values in posterior(degree, edition).items()}
    parameters = {name: value for name, value in drawn.items() if name.startswith(("C_", "E_"))}
    decay = {name: value for name, value in drawn.items() if name == "decay"}
    return Truth(parameters, {name: 1e3 * drawn[name] for name in HYPERS} | decay)


def equal_slope() -> float:
    """Posterior mean of (C_XXX_1 + C_YYY_1) / 2 after the recovered experiment [mm/N²]."""
    return float(np.mean([posterior(1)[name].mean() for name in EQUAL]))


@cache
def plan_of(kind: str, edition: designs.Edition = "first") -> lb.Plan:
    """The plan of a kind of simulated campaign."""
    if edition == "third":
        found: dict[str, Callable[[], lb.analysis.Design]] = {
            "recommended six": lambda: designs.six(edition),
            "nine, both balls clocked": lambda: designs.nine("both balls clocked", edition),
            "settling": lambda: designs.deciding(len(designs.settling().tests), edition),
        }
        return found[kind]().plan()
    plans: dict[str, Callable[[], lb.Plan]] = {
        "recommended six": lambda: designs.recommended().plan(),
        "the paper's six": lambda: designs.pilot().plan(),
        "nine, two radii": lambda: designs.nine("two radii").plan(),
        "nine, both balls clocked": lambda: designs.nine("both balls clocked").plan(),
        "settling": lambda: designs.settling().plan(),
        SOUGHT: lambda: designs.finding(SOUGHT).plan(),
    }
    return plans[kind]()


def width_row(kind: str, seed: int, edition: designs.Edition = "first") -> dict[str, float]:
    """Error of the mean and sd [inside units], and whether the 95 % interval held the truth, of
    every parameter."""
    true = truth(1, seed, edition)
    model = designs.EDITIONS[edition]
    made = model.simulate(
        plan_of(kind, edition), seed=1000 + seed, parameters=true.parameters, hyper_um=true.hyper_um
    )
    rule = None if edition == "first" else SHORT
    found = lb.summarize(
        lb.sample(model, made.campaign, sampler="independent", seed=seed, rule=rule)
    )
    row = {}
    for name, value in true.parameters.items():
        own = found.loc[name]
        row[f"{name} error"], row[f"{name} sd"] = own["mean"] - value, own["sd"]
        row[f"{name} inside"] = float(own["ci_low"] <= value <= own["ci_high"])
    return row


def third_width_row(kind: str, seed: int) -> dict[str, float]:
    """The same by the third edition."""
    return width_row(kind, seed, "third")


def decision_row(kind: str, seed: int, edition: designs.Edition = "first") -> dict[str, float]:
    """ln B [nat]: linear over constant, or linear over linear without the slope sought."""
    design, _, slopes = kind.partition(": ")
    single = slopes in ("absent", "there")
    true = truth(1 if single else 0, seed, edition)
    model = designs.EDITIONS[edition]
    rng = np.random.default_rng(7000 + seed)
    linear = zero_kept(model) if slopes.endswith("zero kept") else model
    parameters = {
        name: 0.0 for name in posterior(1, edition) if name.startswith(("C_", "E_"))
    } | true.parameters
    if slopes == "slopes":
        parameters |= physical_slopes(parameters, rng, edition)
    elif slopes.startswith("equal slopes"):
        parameters |= dict.fromkeys(EQUAL, equal_slope())
    elif single:
        size = slope_sd()[SOUGHT] * designs.SOUGHT[SOUGHT] * rng.choice([-1.0, 1.0])
        parameters[SOUGHT] = size if slopes == "there" else 0.0
    made = linear.simulate(
        plan_of(design, edition), seed=2000 + seed, parameters=parameters, hyper_um=true.hyper_um
    )
    lesser = linear.fixing(SOUGHT) if single else linear.with_degree(0)
    with_, without = (
        lb.log_evidence(model, made.campaign, tolerance=1e-2) for model in (linear, lesser)
    )
    return {"ln B": lb.inference.log_bayes_factor(with_, without)[0]}


def third_decision_row(kind: str, seed: int) -> dict[str, float]:
    """The same by the third edition."""
    return decision_row(kind, seed, "third")


def zero_kept(model: lb.HybridModel) -> lb.HybridModel:
    """The model where only the centre moves between circles: the zero of the bar is checked before
    each."""
    terms = (
        replace(term, moves="centre") if type(term).__name__ == "SetupShift" else term
        for term in model.nuisances
    )
    return replace(model, nuisances=tuple(terms))


@cache
def slope_sd(edition: designs.Edition = "first") -> dict[str, float]:
    """Prior sd of the slopes at the pilot's range of force [inside units]."""
    found = lb.identify(designs.EDITIONS[edition], designs.pilot()).parameters
    return {
        name: float(entry.prior_sd)
        for name, entry in found.items()
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
        if all(
            parameters[name] >= half_range * abs(slopes[f"{name}_1"])
            for name in ("C_XXX", "C_YYY", "C_CCY")
        ):
            return slopes


def widths(rows: pd.DataFrame, kind: str, predicted: dict[str, float]) -> dict[str, Any]:
    """Of every parameter: predicted sd (the median over all machines that are possible), median sd
    and rms error over it, coverage of 95 % intervals; and over all of them."""
    own = rows[rows["kind"] == kind]
    table = {}
    for name, sd in predicted.items():
        table[name] = {
            "predicted_sd": sd,
            "width_over_predicted": float(own[f"{name} sd"].median() / sd),
            "rms_error_over_predicted": float(np.sqrt((own[f"{name} error"] ** 2).mean()) / sd),
            "coverage_95": float(own[f"{name} inside"].mean()),
        }
    covered = own[[f"{name} inside" for name in predicted]].mean(axis=1)
    return {
        "count": len(own),
        "coverage_mean": float(covered.mean()),
        "coverage_mean_se": float(covered.std(ddof=1) / np.sqrt(len(own))),
        "parameters": table,
    }


def decisions(rows: pd.DataFrame) -> dict[str, Any]:
    """Of every kind: ln B [nat], shares of either sign and of decisive evidence either way."""
    found = {}
    for kind in dict.fromkeys(rows["kind"]):
        value = rows.loc[rows["kind"] == kind, "ln B"].to_numpy()
        low, median, high = np.quantile(value, [0.05, 0.5, 0.95])
        found[kind] = {"count": len(value), "q5": low, "median": median, "q95": high}
        found[kind] |= {
            "positive": share(value > 0.0),
            "decisive with": share(value > DECISIVE),
            "decisive without": share(value < -DECISIVE),
        }
    return found


def share(hits: np.ndarray) -> dict[str, float]:
    """Share of hits and its standard error (no less than for half a hit)."""
    p = float(np.mean(hits))
    count = len(hits)
    return {"share": p, "se": float(np.sqrt(max(p * (1.0 - p), 0.25 / count) / count))}
