"""Data the model does not believe: does the 95 % interval still hold the truth, and does the
package notice?

python studies/07_misspecification/run.py            # fails when a campaign is not reproduced
python studies/07_misspecification/run.py --write    # states anew
"""

from __future__ import annotations

import sys
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from scipy import stats

import ldbb_bayes as lb

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]
import disturbances
from study import Effort, Study, replicated, run

CAMPAIGNS: dict[disturbances.Edition, int] = {"first": 60, "third": 10}
# The third edition has drift over time without being asked.
KINDS_OF_THIRD = tuple(label for label, kind in disturbances.KINDS.items() if not kind.drift_term)
# What the second edition found is kept: one direction only, it can no longer be computed.
KINDS_OF_SECOND = tuple(label for label, kind in disturbances.KINDS.items() if not kind.both_ways)
BASELINES = 40
# Of the hysteresis in proportion to force, what is expected where circles run in one direction.
ONE_WAY_SHARE = 0.6
# Where acceptance of a draw hangs on the last digit, all draws that follow are others: by at most
# five Monte Carlo errors of 1500 draws, relative to the largest z, about 2.5.
ASTRAY = 0.1
OF_DRAWS = 5.0 * np.sqrt(2.0 / 1500.0) / 2.5
# The slower judgements are of some campaigns only.
BELONGING_EVERY = 10
DRIFT_EVERY = 3
# Number of simulated circles with which every circle is compared.
CIRCLES = 5000
CREDIBLE = 0.95
# ln B from which drift counts as found [nat].
STRONG = 3.0
# Readings contradict a bound of the parameters where it holds with less probability.
IMPROBABLE = 1e-3
# A parameter is sensitive to its prior beyond this.
SENSITIVE = 0.05
# Coverage is unlikely low where calibrated intervals have it with less probability.
CHANCE = 0.005
GROUPS = {
    "compliances": tuple(disturbances.PRIOR_SD),
    "slopes": tuple(f"{name}_1" for name in disturbances.PRIOR_SD),
    "geometry": tuple(disturbances.GEOMETRY_SD),
}
NAMES = tuple(chain.from_iterable(GROUPS.values()))
# Factor from mm, N, rad to the unit for reading, and this unit.
_DIRECT_UNIT = (1e6, "nm/N")
_CROSS_UNIT = (1e9, "nrad/N")
_STRAIGHTNESS_UNIT = (1e9, "µm/m²")
UNITS = {
    "C_XXX": _DIRECT_UNIT,
    "C_XYX": _DIRECT_UNIT,
    "C_YYY": _DIRECT_UNIT,
    "C_CXY": _CROSS_UNIT,
    "C_CYY": _CROSS_UNIT,
    "C_CCY": (1e9, "µrad/(N m)"),
    "E_XX1": (1e6, "µm/m"),
    "E_YY1": (1e6, "µm/m"),
    "E_YX2": _STRAIGHTNESS_UNIT,
    "E_XY2": _STRAIGHTNESS_UNIT,
    "E_Xt0": (1e3, "µm"),
    "E_Yt0": (1e3, "µm"),
    "E_C0YX": (1e6, "µrad"),
}
for _name in disturbances.PRIOR_SD:
    _factor, _unit = UNITS[_name]
    UNITS[f"{_name}_1"] = (_factor * 1e3, f"{_unit} per kN")
# What the package may say of a fit: columns of the campaigns.
REASONS = ("misfit", "contradiction", "hyper")


def job(label: str, seed: int) -> dict[str, Any]:
    """One campaign by the first edition: error in units of u, whether the interval holds the truth,
    u (mm, N, rad); what the package says."""
    kind = disturbances.KINDS[label]
    campaign, truth = disturbances.simulated(kind, seed, "first")
    row, fit = analysed(kind.model("first"), campaign, truth, seed)
    row["misfit"] = bool(fit.unexpected)
    row["sensitive"] = sum(entry["prior"] > SENSITIVE for entry in fit.sensitivity.values())
    row["flagged"] = float("nan")
    row["ln_b_drift"] = float("nan")
    if seed % BELONGING_EVERY == 1:
        models = {"own": kind.model("first")}
        outlying = lb.find_outlying_tests(models, campaign, seed=seed, replicates=CIRCLES)
        row["flagged"] = outlying["flag"].any()
    if seed % DRIFT_EVERY == 1 and not kind.drift_term:
        row["ln_b_drift"] = ln_b_drift(campaign)
    return row


def job_of_third(label: str, seed: int) -> dict[str, Any]:
    """The same by the third edition, on machines as that believes them: misfits are what would
    move an interval, the rest are notes, as is a centre that shifts with force."""
    kind = disturbances.KINDS[label]
    campaign, truth = disturbances.simulated(kind, seed, "third")
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
        entry = table.loc[name]
        row[f"z_{name}"] = (entry["mean"] - truth[name]) / entry["sd"]
        row[f"in_{name}"] = entry["ci_low"] <= truth[name] <= entry["ci_high"]
        row[f"u_{name}"] = entry["sd"]
    fit = table.attrs["fit"]
    row["contradiction"] = fit.log_prob_truncation < np.log(IMPROBABLE)
    row["hyper"] = "hyper" in fit.kinds
    return row, fit


def ln_b_drift(campaign: lb.Campaign) -> float:
    """ln B of the first edition with drift over time against the one without."""
    steady = disturbances.EDITIONS["first"]
    drifting = steady.with_term(lb.terms.Drift("time"))
    evidence_of_drifting = lb.log_evidence(drifting, campaign, tolerance=1e-2)
    evidence_of_steady = lb.log_evidence(steady, campaign, tolerance=1e-2)
    return lb.inference.log_bayes_factor(evidence_of_drifting, evidence_of_steady)[0]


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the page states."""
    kinds = dict.fromkeys(disturbances.KINDS, CAMPAIGNS["first"])
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
        "hyper_um": disturbances.HYPER_UM["first"],
        "direct_nm_per_N": {name: value * 1e6 for name, value in disturbances.DIRECT.items()},
        "direct_spread": disturbances.DIRECT_SPREAD,
        "narrower": disturbances.NARROWER,
        "readings": disturbances.READINGS,
        "circle_min": disturbances.CIRCLE_S / 60.0,
        "warm_up_h": disturbances.WARM_UP_S / 3600.0,
        "drift_length_um_per_h": lb.terms.Drift("time").length_um,
        "warmed_by_the_end": (
            1.0
            - float(
                np.exp(
                    -(len(disturbances.FORCES_N) - 1)
                    * disturbances.CIRCLE_S
                    / disturbances.WARM_UP_S
                )
            )
        ),
        "spike_deg": disturbances.SPIKE_DEG,
        "outlier_um": disturbances.OUTLIER_UM,
        "knee_N": disturbances.KNEE_N,
        "strong": STRONG,
        "chance": CHANCE,
        "unlikely_below": unlikely_below(CAMPAIGNS["first"]),
        "se_of_one": se_of_one(CAMPAIGNS["first"]),
        "cells": len(NAMES) * len(disturbances.KINDS),
        "said": {edition: said_of_baseline(edition) for edition in disturbances.EDITIONS},
        "forces_N": list(disturbances.FORCES_N),
        "sizes": {label: asdict(kind) for label, kind in disturbances.KINDS.items()},
        "kinds": {
            label: judged(rows[rows["kind"] == label], baseline) for label in disturbances.KINDS
        },
        "expected": {
            "constant_um": lb.terms.Hysteresis().constant_um,
            "per_kN_um": ONE_WAY_SHARE * lb.terms.Hysteresis().proportional_um_per_kN,
        },
        "third": {
            "campaigns": CAMPAIGNS["third"],
            "baselines": BASELINES,
            "hyper_um": disturbances.HYPER_UM["third"],
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
    first_baselines = rows.query(f"kind == 'baseline' and seed < {CAMPAIGNS['third']}")
    coverage = {name: float(first_baselines[f"in_{name}"].mean()) for name in NAMES}
    worst = min(coverage, key=coverage.__getitem__)
    return {"name": printed(worst), "coverage": coverage[worst]}


def of_edition(rows: pd.DataFrame, label: str) -> dict[str, Any]:
    """Campaigns of one kind by the second or third edition as `judged`, with shares of notes."""
    of_kind = rows[rows["kind"] == label]
    numbers = judged(of_kind, rows[rows["kind"] == "baseline"])
    return numbers | {"note": share(of_kind["note"]), "centre": share(of_kind["centre"])}


def of_third(rows: pd.DataFrame, first: pd.DataFrame) -> dict[str, Any]:
    """The third edition's campaigns by kind, with the verdict on what is least covered where that
    fails; the baseline's u over that of the first edition."""
    by_kind = {label: of_edition(rows, label) for label in KINDS_OF_THIRD}
    for label, of_kind in by_kind.items():
        if not of_kind["holds"]:
            of_kind["verdict"] = verdict(label, of_kind["worst"]["name"])
    baseline = rows[rows["kind"] == "baseline"]
    baseline_of_first = first[first["kind"] == "baseline"]
    by_kind["baseline"]["over_first"] = dict(
        zip(NAMES, width_ratios(baseline, baseline_of_first), strict=True)
    )
    return by_kind


def width_ratios(rows: pd.DataFrame, reference: pd.DataFrame) -> list[float]:
    """Median u of every parameter over that of other campaigns."""
    return [
        float(np.median(rows[f"u_{name}"]) / np.median(reference[f"u_{name}"])) for name in NAMES
    ]


def verdict(label: str, name: str) -> str:
    """What `lb.identify` calls a parameter of the first of these campaigns by the third
    edition."""
    kind = disturbances.KINDS[label]
    campaign, _ = disturbances.simulated(kind, 0, "third")
    return str(lb.identify(kind.model("third"), campaign).parameters[name].verdict)


def said_of_baseline(edition: disturbances.Edition) -> list[str]:
    """Sentences of a result, whatever the readings, on what circles of one direction, forces
    rising, cannot tell."""
    campaign, _ = disturbances.simulated(disturbances.KINDS["baseline"], 0, edition)
    posterior = lb.sample(disturbances.EDITIONS[edition], campaign, sampler="independent", seed=0)
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
    parameters = {name: parameter(name, rows) for name in NAMES}
    worst = least_covered(parameters)
    holds = parameters[worst]["coverage"]["share"] >= unlikely_below(len(rows))
    is_noticed = rows[list(REASONS)].max(axis=1)
    wider = width_ratios(rows, baseline)
    numbers = {
        "holds": holds,
        "silent": float(is_noticed.mean()) < 0.5,
        "coverage": coverage_of_groups(rows),
        "worst": {"name": worst, **parameters[worst]},
        "parameters": {
            name: {"coverage": entry["coverage"]["share"], "rms": entry["rms"]}
            for name, entry in parameters.items()
        },
        "wider": float(np.exp(np.mean(np.log(wider)))),
        "noticed": share(is_noticed),
        "reasons": {name: float(rows[name].mean()) for name in REASONS},
    }
    if "flagged" in rows:
        numbers |= slower_judgements(rows)
    return numbers


def least_covered(parameters: dict[str, dict[str, Any]]) -> str:
    """The parameter of the lowest coverage; of several, that of the largest error."""

    def coverage_and_error(name: str) -> tuple[float, float]:
        return parameters[name]["coverage"]["share"], -parameters[name]["rms"]

    return min(NAMES, key=coverage_and_error)


def coverage_of_groups(rows: pd.DataFrame) -> dict[str, dict[str, float]]:
    """Coverage of compliances, slopes and geometric errors."""
    coverage = {}
    for group, names in GROUPS.items():
        is_covered = rows[[f"in_{name}" for name in names]]
        coverage[group] = mean_and_se(is_covered.mean(axis=1))
    return coverage


def slower_judgements(rows: pd.DataFrame) -> dict[str, Any]:
    """What the first edition says of its prior, of outlying circles and of drift over time."""
    ln_b_drift_values = rows["ln_b_drift"].dropna()
    drift_found = None
    if len(ln_b_drift_values):
        drift_found = share(ln_b_drift_values > STRONG)
    return {
        "sensitive": float(rows["sensitive"].mean()),
        "flagged": share(rows["flagged"].dropna()),
        "drift_found": drift_found,
    }


def parameter(name: str, rows: pd.DataFrame) -> dict[str, Any]:
    """Coverage; mean and rms of the error in units of u; the same in the unit for reading."""
    factor, unit = UNITS[name]
    z = rows[f"z_{name}"]
    error = z * rows[f"u_{name}"] * factor
    return {
        "shown": printed(name),
        "unit": unit,
        "coverage": share(rows[f"in_{name}"]),
        "bias": mean_and_se(z),
        "rms": float(np.sqrt(np.mean(z**2))),
        "bias_in_unit": float(error.mean()),
        "rms_in_unit": float(np.sqrt(np.mean(error**2))),
    }


def printed(name: str) -> str:
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


def coverage_figure(results: dict[str, Any]) -> Figure:
    """Coverage by kind and parameter; beside it how often the package said something."""
    kinds = results["kinds"]
    figure = Figure(figsize=(10.0, 7.4), layout="constrained")
    coverage_axes, noticed_axes = figure.subplots(1, 2, width_ratios=(19, 4), sharey=True)
    image = draw_coverage(coverage_axes, kinds, results["unlikely_below"])
    noticed = [100.0 * kind["noticed"]["share"] for kind in kinds.values()]
    noticed_axes.barh(range(len(kinds)), noticed, color="#D55E00", height=0.7)
    noticed_axes.set_xlim(0.0, 100.0)
    noticed_axes.set_xlabel("campaigns with a\nmisfit reported (%)", fontsize=8)
    noticed_axes.tick_params(labelsize=8)
    for edge in family_edges(list(kinds)):
        coverage_axes.axhline(edge, color="#FFFFFF", linewidth=1.5)
        noticed_axes.axhline(edge, color="#BBBBBB", linewidth=0.8)
    bar = figure.colorbar(image, ax=coverage_axes, location="bottom", shrink=0.5, aspect=40)
    bar.set_label("coverage (1)", fontsize=8)
    return figure


def draw_coverage(axes: Axes, kinds: dict[str, Any], unlikely_low: float) -> AxesImage:
    """Coverage as a picture, one row for each kind; written out where it is unlikely low."""
    rows = []
    for kind in kinds.values():
        rows.append([kind["parameters"][name]["coverage"] for name in NAMES])
    coverage = np.array(rows)
    image = axes.imshow(coverage, cmap="cividis", vmin=0.0, vmax=1.0, aspect="auto")
    for (i, j), value in np.ndenumerate(coverage):
        if value < unlikely_low:
            colour = "w" if value < 0.5 else "k"
            percent = f"{100 * value:.0f}"
            axes.text(j, i, percent, ha="center", va="center", fontsize=8, color=colour)
    axes.set_xticks(range(len(NAMES)), [printed(name) for name in NAMES], rotation=90, fontsize=8)
    axes.set_yticks(range(len(kinds)), list(kinds), fontsize=8)
    for edge in np.cumsum([len(names) for names in GROUPS.values()])[:-1]:
        axes.axvline(edge - 0.5, color="#FFFFFF", linewidth=1.5)
    axes.set_title(
        "campaigns whose 95 % interval holds the truth (number: %, where unlikely low)", fontsize=9
    )
    return image


def family_edges(labels: list[str]) -> list[float]:
    """Between rows of different first words."""
    first = [label.split()[0].rstrip(",") for label in labels]
    return [i - 0.5 for i in range(1, len(first)) if first[i] != first[i - 1]]


def draw(results: dict[str, Any]) -> dict[str, Figure]:
    """Figures of the page."""
    return {"coverage": coverage_figure(results)}


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    run(Study(HERE, measure, draw))


if __name__ == "__main__":
    main()
