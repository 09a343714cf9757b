"""Data the model does not believe: does the 95 % interval still hold the truth, and does the
package notice?

python studies/07_misspecification/run.py            # makes a part of the campaigns again; fails
when one is not reproduced python studies/07_misspecification/run.py --write    # states anew
"""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy import stats

import ldbb_bayes as lb

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]
import disturbances as made
from study import Effort, Study, replicated, run

CAMPAIGNS: dict[made.Edition, int] = {"first": 60, "third": 10}
# The third edition has drift over time without being asked.
KINDS_OF_THIRD = tuple(label for label, kind in made.KINDS.items() if not kind.drift_term)
# What the second edition found is kept: one direction only, it can no longer be computed.
KINDS_OF_SECOND = tuple(label for label, kind in made.KINDS.items() if not kind.both_ways)
BASELINES = 40
# Of the hysteresis in proportion to force, what is expected where circles run in one direction.
ONE_WAY_SHARE = 0.6
# Where acceptance of a draw hangs on the last digit, all draws that follow are others: by at most
# five Monte Carlo errors of 1500 draws, relative to the largest z, about 2.5.
ASTRAY = 0.1
OF_DRAWS = 5.0 * np.sqrt(2.0 / 1500.0) / 2.5
BELONGING_EVERY = 10
DRIFT_EVERY = 3  # the slower judgements are of some campaigns
CIRCLES = 5000
CREDIBLE = 0.95
STRONG = 3.0
IMPROBABLE = 1e-3
SENSITIVE = 0.05
CHANCE = 0.005
GROUPS = {
    "compliances": tuple(made.PRIOR_SD),
    "slopes": tuple(f"{name}_1" for name in made.PRIOR_SD),
    "geometry": tuple(made.GEOMETRY_SD),
}
NAMES = tuple(name for group in GROUPS.values() for name in group)
UNITS = dict.fromkeys(("C_XXX", "C_XYX", "C_YYY"), (1e6, "nm/N")) | dict.fromkeys(
    ("C_CXY", "C_CYY"), (1e9, "nrad/N")
)
UNITS |= {"C_CCY": (1e9, "µrad/(N m)")} | dict.fromkeys(("E_XX1", "E_YY1"), (1e6, "µm/m"))
UNITS |= dict.fromkeys(("E_YX2", "E_XY2"), (1e9, "µm/m²")) | dict.fromkeys(
    ("E_Xt0", "E_Yt0"), (1e3, "µm")
)
UNITS |= {"E_C0YX": (1e6, "µrad")}
UNITS |= {f"{name}_1": (UNITS[name][0] * 1e3, f"{UNITS[name][1]} per kN") for name in made.PRIOR_SD}


def job(label: str, seed: int) -> dict[str, Any]:
    """One campaign by the first edition: error in units of u, whether the interval holds the truth,
    u (mm, N, rad); what the package says."""
    kind = made.KINDS[label]
    campaign, truth = made.simulated(kind, seed, "first")
    row, fit = analysed(kind.model("first"), campaign, truth, seed)
    row["misfit"] = bool(fit.unexpected)
    row["sensitive"] = sum(parts["prior"] > SENSITIVE for parts in fit.sensitivity.values())
    row["flagged"] = row["ln_b_drift"] = float("nan")
    if seed % BELONGING_EVERY == 1:
        flags = lb.find_outlying_tests(
            {"own": kind.model("first")}, campaign, seed=seed, replicates=CIRCLES
        )["flag"]
        row["flagged"] = flags.any()
    if seed % DRIFT_EVERY == 1 and not kind.drift_term:
        row["ln_b_drift"] = ln_b_drift(campaign)
    return row


def job_of_third(label: str, seed: int) -> dict[str, Any]:
    """The same by the third edition, on machines as that believes them: misfits are what would
    move an interval, the rest are notes, as is a centre that shifts with force."""
    kind = made.KINDS[label]
    campaign, truth = made.simulated(kind, seed, "third")
    row, fit = analysed(kind.model("third"), campaign, truth, seed)
    row["misfit"] = bool(fit.misfits)
    row["note"] = len(fit.unexpected) > len(fit.misfits)
    row["centre"] = "centre" in fit.kinds
    return row


def analysed(
    model: lb.HybridModel, campaign: lb.Campaign, truth: dict[str, float], seed: int
) -> tuple[dict[str, Any], Any]:
    """Errors, coverage and u of all parameters, and contradictions; and the fit."""
    posterior = lb.sample(model, campaign, sampler="independent", seed=seed)
    table = lb.summarize(posterior, prob=CREDIBLE)
    row: dict[str, Any] = {}
    for name in NAMES:
        found = table.loc[name]
        row[f"z_{name}"] = (found["mean"] - truth[name]) / found["sd"]
        row[f"in_{name}"] = found["ci_low"] <= truth[name] <= found["ci_high"]
        row[f"u_{name}"] = found["sd"]
    fit = table.attrs["fit"]
    row["contradiction"] = fit.log_prob_truncation < np.log(IMPROBABLE)
    row["hyper"] = "hyper" in fit.kinds
    return row, fit


def ln_b_drift(campaign: lb.Campaign) -> float:
    """ln B of the first edition with drift over time against the one without."""
    believed = made.EDITIONS["first"]
    drifting = believed.with_term(lb.terms.Drift("time"))
    own, other = (
        lb.log_evidence(model, campaign, tolerance=1e-2) for model in (drifting, believed)
    )
    return lb.inference.log_bayes_factor(own, other)[0]


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the page states."""
    kinds = dict.fromkeys(made.KINDS, CAMPAIGNS["first"])
    rows = replicated(HERE / "simulated.csv", job, kinds, effort, again={"quick": 1, "usual": 6})
    kinds = dict.fromkeys(KINDS_OF_THIRD, CAMPAIGNS["third"]) | {"baseline": BASELINES}
    third = replicated(
        HERE / "third.csv",
        job_of_third,
        kinds,
        effort,
        again={"quick": 1, "usual": 3},
        astray=ASTRAY,
        of_draws=OF_DRAWS,
    )
    second = pd.read_csv(HERE / "second_edition.csv")
    baseline = rows[rows["kind"] == "baseline"]
    return {
        "campaigns": CAMPAIGNS["first"],
        "judged": {
            "flagged": int(baseline["flagged"].count()),
            "drift": int(baseline["ln_b_drift"].count()),
        },
        "hyper_um": made.HYPER_UM["first"],
        "direct_nm_per_N": {name: value * 1e6 for name, value in made.DIRECT.items()},
        "direct_spread": made.DIRECT_SPREAD,
        "narrower": made.NARROWER,
        "readings": made.READINGS,
        "circle_min": made.CIRCLE_S / 60.0,
        "warm_up_h": made.WARM_UP_S / 3600.0,
        "drift_length_um_per_h": lb.terms.Drift("time").length_um,
        "warmed_by_the_end": (
            1.0 - float(np.exp(-(len(made.FORCES_N) - 1) * made.CIRCLE_S / made.WARM_UP_S))
        ),
        "spike_deg": made.SPIKE_DEG,
        "outlier_um": made.OUTLIER_UM,
        "knee_N": made.KNEE_N,
        "strong": STRONG,
        "chance": CHANCE,
        "unlikely_below": unlikely_below(CAMPAIGNS["first"]),
        "se_of_one": se_of_one(CAMPAIGNS["first"]),
        "cells": len(NAMES) * len(made.KINDS),
        "said": {edition: said_of_baseline(edition) for edition in made.EDITIONS},
        "forces_N": list(made.FORCES_N),
        "sizes": {label: asdict(kind) for label, kind in made.KINDS.items()},
        "kinds": {label: judged(rows[rows["kind"] == label], baseline) for label in made.KINDS},
        "expected": {
            "constant_um": lb.terms.Hysteresis().constant_um,
            "per_kN_um": ONE_WAY_SHARE * lb.terms.Hysteresis().proportional_um_per_kN,
        },
        "third": {
            "campaigns": CAMPAIGNS["third"],
            "baselines": BASELINES,
            "hyper_um": made.HYPER_UM["third"],
            "unlikely_below": unlikely_below(CAMPAIGNS["third"]),
            "se_of_one": se_of_one(CAMPAIGNS["third"]),
            "as_few_baselines": as_few_baselines(third),
            "kinds": of_third(third, rows),
        },
        "second": {
            "kinds": {label: of_edition(second, label) for label in KINDS_OF_SECOND},
        },
    }


def as_few_baselines(rows: pd.DataFrame) -> dict[str, Any]:
    """The parameter least covered in as many baselines as there are campaigns of other kinds."""
    few = rows.query(f"kind == 'baseline' and seed < {CAMPAIGNS['third']}")
    coverage = {name: float(few[f"in_{name}"].mean()) for name in NAMES}
    worst = min(coverage, key=coverage.__getitem__)
    return {"name": shown(worst), "coverage": coverage[worst]}


def of_edition(rows: pd.DataFrame, label: str) -> dict[str, Any]:
    """Campaigns of one kind by the second or third edition as `judged`, with shares of notes."""
    of_kind = rows[rows["kind"] == label]
    found = judged(of_kind, rows[rows["kind"] == "baseline"])
    return found | {"note": share(of_kind["note"]), "centre": share(of_kind["centre"])}


def of_third(rows: pd.DataFrame, first: pd.DataFrame) -> dict[str, Any]:
    """The third edition's campaigns by kind, with the verdict on what is least covered where that
    fails; the baseline's u over that of the first edition."""
    found = {label: of_edition(rows, label) for label in KINDS_OF_THIRD}
    for label, of_kind in found.items():
        if not of_kind["holds"]:
            of_kind["verdict"] = verdict(label, of_kind["worst"]["name"])
    baseline = rows[rows["kind"] == "baseline"]
    old = first[first["kind"] == "baseline"]
    ratio = {
        name: float(np.median(baseline[f"u_{name}"]) / np.median(old[f"u_{name}"]))
        for name in NAMES
    }
    found["baseline"]["over_first"] = ratio
    return found


def verdict(label: str, name: str) -> str:
    """What `lb.identify` calls a parameter of the first of these campaigns by the third
    edition."""
    kind = made.KINDS[label]
    campaign, _ = made.simulated(kind, 0, "third")
    return str(lb.identify(kind.model("third"), campaign).parameters[name].verdict)


def said_of_baseline(edition: made.Edition) -> list[str]:
    """Sentences of a result, whatever the readings, on what circles of one direction, forces
    rising, cannot tell."""
    campaign, _ = made.simulated(made.KINDS["baseline"], 0, edition)
    posterior = lb.sample(made.EDITIONS[edition], campaign, sampler="independent", seed=0)
    warnings = lb.report.describe_fit(posterior)["warnings"]
    return [text for text in warnings if "onfounded" in text]


def unlikely_below(count: int) -> float:
    """Coverage that calibrated intervals fall below with a probability of less than `CHANCE`."""
    return float(stats.binom.ppf(CHANCE, count, CREDIBLE) / count)


def se_of_one(count: int) -> float:
    """Standard error of the coverage of one parameter whose intervals are calibrated."""
    return float(np.sqrt(CREDIBLE * (1.0 - CREDIBLE) / count))


def judged(rows: pd.DataFrame, baseline: pd.DataFrame) -> dict[str, Any]:
    """Coverage, errors and what was noticed, of the campaigns of one kind."""
    every = {name: parameter(name, rows) for name in NAMES}
    held = rows[[f"in_{name}" for name in NAMES]].set_axis(NAMES, axis=1)
    wider = [np.median(rows[f"u_{name}"]) / np.median(baseline[f"u_{name}"]) for name in NAMES]
    worst = min(NAMES, key=lambda name: (every[name]["coverage"]["share"], -every[name]["rms"]))
    said = rows[["misfit", "contradiction", "hyper"]].max(axis=1)
    holds = every[worst]["coverage"]["share"] >= unlikely_below(len(rows))
    found = {
        "holds": holds,
        "silent": float(said.mean()) < 0.5,
        "coverage": {
            group: mean_and_se(held[list(names)].mean(axis=1)) for group, names in GROUPS.items()
        },
        "worst": {"name": worst, **every[worst]},
        "parameters": {
            name: {"coverage": found["coverage"]["share"], "rms": found["rms"]}
            for name, found in every.items()
        },
        "wider": float(np.exp(np.mean(np.log(wider)))),
        "noticed": share(said),
        "reasons": {
            name: float(rows[name].mean()) for name in ("misfit", "contradiction", "hyper")
        },
    }
    if "flagged" not in rows:
        return found
    return found | {
        "sensitive": float(rows["sensitive"].mean()),
        "flagged": share(rows["flagged"].dropna()),
        "drift_found": (
            share(rows["ln_b_drift"].dropna() > STRONG)
            if rows["ln_b_drift"].notna().any()
            else None
        ),
    }


def parameter(name: str, rows: pd.DataFrame) -> dict[str, Any]:
    """Coverage; mean and rms of the error in units of u; the same in the unit for reading."""
    factor, unit = UNITS[name]
    z = rows[f"z_{name}"]
    error = z * rows[f"u_{name}"] * factor
    return {
        "shown": shown(name),
        "unit": unit,
        "coverage": share(rows[f"in_{name}"]),
        "bias": mean_and_se(z),
        "rms": float(np.sqrt(np.mean(z**2))),
        "bias_in_unit": float(error.mean()),
        "rms_in_unit": float(np.sqrt(np.mean(error**2))),
    }


def shown(name: str) -> str:
    """As the paper writes it."""
    return name.replace("E_C0YX", "E_C(0Y)X")


def mean_and_se(values: pd.Series) -> dict[str, float]:
    """Mean over campaigns and its standard error."""
    return {"mean": float(values.mean()), "se": float(values.std(ddof=1) / np.sqrt(len(values)))}


def share(hits: pd.Series) -> dict[str, float]:
    """Share of hits and its standard error, with half a hit added to either side, so that none or
    all is not certain."""
    p = float(hits.mean())
    n = len(hits)
    q = (p * n + 0.5) / (n + 1.0)
    return {"share": p, "se": float(np.sqrt(q * (1.0 - q) / n))}


def draw(results: dict[str, Any]) -> Figure:
    """Coverage by kind and parameter; beside it how often the package said something."""
    kinds = results["kinds"]
    figure = Figure(figsize=(10.0, 7.4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(19, 4), sharey=True)
    coverage = np.array(
        [[kind["parameters"][name]["coverage"] for name in NAMES] for kind in kinds.values()]
    )
    image = left.imshow(coverage, cmap="cividis", vmin=0.0, vmax=1.0, aspect="auto")
    for (i, j), value in np.ndenumerate(coverage):
        if value < results["unlikely_below"]:
            left.text(
                j,
                i,
                f"{100 * value:.0f}",
                ha="center",
                va="center",
                fontsize=8,
                color="w" if value < 0.5 else "k",
            )
    left.set_xticks(range(len(NAMES)), [shown(name) for name in NAMES], rotation=90, fontsize=8)
    left.set_yticks(range(len(kinds)), list(kinds), fontsize=8)
    for edge in family_edges(list(kinds)):
        left.axhline(edge, color="#FFFFFF", linewidth=1.5)
        right.axhline(edge, color="#BBBBBB", linewidth=0.8)
    for edge in np.cumsum([len(names) for names in GROUPS.values()])[:-1]:
        left.axvline(edge - 0.5, color="#FFFFFF", linewidth=1.5)
    noticed = [100.0 * kind["noticed"]["share"] for kind in kinds.values()]
    right.barh(range(len(kinds)), noticed, color="#D55E00", height=0.7)
    right.set_xlim(0.0, 100.0)
    right.set_xlabel("campaigns with a\nmisfit reported (%)", fontsize=8)
    right.tick_params(labelsize=8)
    left.set_title(
        "campaigns whose 95 % interval holds the truth (number: %, where unlikely low)", fontsize=9
    )
    figure.colorbar(image, ax=left, location="bottom", shrink=0.5, aspect=40).set_label(
        "coverage (1)", fontsize=8
    )
    return figure


def family_edges(labels: list[str]) -> list[float]:
    """Between rows of different first words."""
    first = [label.split()[0].rstrip(",") for label in labels]
    return [i - 0.5 for i in range(1, len(first)) if first[i] != first[i - 1]]


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    run(Study(HERE, measure, lambda results: {"coverage": draw(results)}))


if __name__ == "__main__":
    main()
