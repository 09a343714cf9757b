"""Constant or linear compliance on the recovered experiment: RMSE's answer, white noise's, the
honest one, and what it hangs on.

python studies/04_constant_or_linear/run.py            # fails when a stated number is not
reproduced python studies/04_constant_or_linear/run.py --quick    # with fewer simulated campaigns
python studies/04_constant_or_linear/run.py --write    # states anew
"""

from __future__ import annotations

import json
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import ldbb_bayes as lb

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]
sys.path.append(str(HERE.parent / "02_recovered_experiment"))
import gain
import printed
import simulated
import undetermined
from study import Effort, Study, replicated, run

AGAIN: dict[Effort, int] = {"quick": 1, "usual": 6}
MOVES = (printed.ZERO_AND_CENTRE, printed.CENTRE)
BLUE = "#0072B2"
ORANGE = "#D55E00"
GREEN = "#009E73"
GREY = "#8C8C8C"
SHOWN = {"common mode": BLUE, "the other four": ORANGE, "all six": GREY}


@cache
def comparison() -> lb.analysis.Comparison:
    """Constant against linear compliance, everything else as by default."""
    linear = lb.HybridModel.first(degree=1)
    return lb.compare(
        {"constant": linear.with_degree(0), "linear": linear}, undetermined.recovered()
    )


def compared() -> dict[str, Any]:
    """What `lb.compare` found; evidence of an assumption less that of the model."""
    record = comparison().as_dict()
    every = {a["assumption"]: a for a in record["discrepancy_sensitivity"]}
    own = max(every["as in the model"]["log_evidence"].values())
    naive = every["white noise only, no truncation"]["log_bayes_factor"]
    none = next(s["probability"] for s in record["slope_subsets"] if not s["varying"])
    return {
        "log_bayes_factor": record["log_bayes_factor"]["linear/constant"],
        "kappa_um": (
            1e3
            * float(
                lb.inference.marginalize(lb.HybridModel.first(0), undetermined.recovered()).loc[
                    "kappa", "mean"
                ]
            )
        ),
        "probability": {
            name: model["posterior_probability"] for name, model in record["models"].items()
        },
        "least_squares_rmse_um": {
            name: model["least_squares_rmse_um"] for name, model in record["models"].items()
        },
        "white_noise_overstates_by_nats": naive - record["log_bayes_factor"]["linear/constant"],
        "slope_scale": {
            f"{s['slope_scale']:g}": s["log_bayes_factor"] for s in record["prior_sensitivity"]
        },
        "assumptions": {
            label: {
                "log_bayes_factor": a["log_bayes_factor"],
                "evidence": max(a["log_evidence"].values()) - own,
            }
            for label, a in every.items()
        },
        "elpd_difference": record["elpd_difference"]["linear/constant"],
        "inclusion": {
            name: slope["inclusion_probability"] for name, slope in record["slopes"].items()
        },
        "no_slope": none,
        "some_slope": float(np.log((1.0 - none) / none / (len(record["slope_subsets"]) - 1))),
        "flagged": [name for name, test in record["tests"].items() if test["flag"]],
    }


def explained(label: str) -> dict[str, Any]:
    """The third edition's answer from the readings: ln B with no rival of slopes and averaged over
    all combinations of rivals, and how probable each explanation is."""
    linear = gain.ASSUMPTIONS[label](lb.HybridModel.default(degree=1))
    models = {"constant": linear.with_degree(0), "linear": linear}
    found = lb.compare(models, undetermined.recovered(), evidence_only=True).explanations
    if found is None:
        raise RuntimeError("the default model must have rivals of slopes")
    return {
        "alone": found.alone.log_bayes_factor,
        "averaged": found.averaged.log_bayes_factor,
        "inclusion": found.inclusion_probability,
        "likeliest": list(found.models[0].by),
    }


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the page states."""
    campaign = undetermined.recovered()
    drawn = replicated(
        HERE / "drawn.csv", undetermined.row, undetermined.KINDS, effort, again=AGAIN
    )
    evidence = replicated(
        HERE / "evidence.csv", simulated.evidence_row, simulated.EVIDENCE_KINDS, effort, again=AGAIN
    )
    priors = replicated(
        HERE / "priors.csv", simulated.prior_row, simulated.PRIOR_KINDS, effort, again=AGAIN
    )
    belonging = replicated(
        HERE / "belonging.csv",
        simulated.belonging_row,
        simulated.BELONGING_KINDS,
        effort,
        again=AGAIN,
    )
    return {
        "circles": len(campaign.tests),
        "readings": campaign.readings,
        "slope_scale": lb.Prior.first().slope_scale,
        "compared": compared(),
        "explained": {
            label: explained(label) for label in MOVES[: 1 if effort == "quick" else None]
        },
        "printed": printed.measure(effort == "quick"),
        "undetermined": undetermined.measure(drawn),
        "gain": {
            "least_squares": gain.least_squares(campaign),
            "evidence": gain.evidence(campaign),
            "slopes": gain.slopes(campaign),
        },
        "simulated": simulated.summary(evidence, priors, belonging),
    }


def draw(results: dict[str, Any]) -> dict[str, Figure]:
    """The comparison's own figures, the gain and the open directions, and the reliability of
    probabilities."""
    return {
        "answer": answer_figure(results),
        "explanations": explanations_figure(results),
        "evidence": lb.figures.evidence(comparison()),
        "compliance": lb.figures.compliance_with_local_fits(comparison()),
        "gain": gain_figure(results),
        "reliability": reliability_figure(results["simulated"]["reliability"]),
    }


def answer_figure(results: dict[str, Any]) -> Figure:
    """Left: ln B of the readings against how much circles differ, and of the printed numbers;
    right: which slopes."""
    found = results["printed"]
    compared = results["compared"]
    figure = Figure(figsize=(9.6, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.25, 1.0])
    for label, colour in ((printed.ZERO_AND_CENTRE, BLUE), (printed.CENTRE, ORANGE)):
        rows = found["scaled"].values()
        left.plot(
            [r["kappa_um"] for r in rows],
            [r[label] for r in rows],
            "o-",
            color=colour,
            label=f"readings; {label}",
        )
        kappa = found["kappa_um"]
        value = found["log_bayes_factor"][label]
        left.plot(
            [kappa["linear"], kappa["constant"]],
            [value, value],
            color=colour,
            linewidth=6,
            alpha=0.45,
            solid_capstyle="butt",
        )
    shipped = found["scaled"]["1"]
    left.plot(shipped["kappa_um"], shipped[printed.ZERO_AND_CENTRE], "D", color=BLUE, markersize=9)
    left.axhline(0.0, color="black", linewidth=0.8)
    left.set_xscale("log")
    left.set_xticks([0.05, 0.1, 0.2, 0.5], ["0.05", "0.1", "0.2", "0.5"])
    left.minorticks_off()
    left.set(
        xlabel="κ inferred: how much circles differ (µm)", ylabel="ln B(linear/constant) (nat)"
    )
    left.set_title("Bars: printed numbers alone; diamond: readings as shipped", fontsize=9.5)
    left.legend(fontsize=8)
    names = list(found["inclusion"])
    place = np.arange(len(names))
    for k, (label, own, colour) in enumerate(
        (
            ("printed numbers alone", found["inclusion"], GREEN),
            ("readings as shipped", compared["inclusion"], GREY),
        )
    ):
        right.barh(
            place + 0.4 * (k - 0.5),
            [own[name] for name in names],
            height=0.38,
            color=colour,
            label=label,
        )
    right.set_yticks(place, names)
    right.invert_yaxis()
    right.set(xlabel="probability that it changes with force (1)", xlim=(0.0, 1.0))
    right.set_title("Slopes one by one, each as likely as not beforehand", fontsize=9.5)
    right.legend(fontsize=8, loc="lower right")
    return figure


def explanations_figure(results: dict[str, Any]) -> Figure:
    """Left: ln B with slopes alone and averaged over rivals, by edition; right: how probable every
    explanation is by the third."""
    of_printed = results["printed"]["explanations"]
    first = of_printed[printed.FIRST]
    kept = json.loads((HERE / "second_edition.json").read_text(encoding="utf-8"))["explained"]
    second = [of_printed[printed.SECOND][label] for label in MOVES]
    second += [kept[label] for label in MOVES]
    shipped = (
        results["compared"]["log_bayes_factor"],
        results["compared"]["assumptions"]["set-up shift of order 1 (centre) only"],
    )
    old = [*(first[label]["alone"] for label in MOVES), shipped[0], shipped[1]["log_bayes_factor"]]
    new = [of_printed[printed.THIRD][label] for label in MOVES]
    new += [results["explained"][label] for label in MOVES]
    labels = [
        f"{of};\n{label}"
        for of in ("printed", "readings")
        for label in ("zero moves", "zero stays")
    ]
    figure = Figure(figsize=(9.6, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.2, 1.0])
    bars = {
        "slopes alone, first edition": (old, GREY),
        "slopes alone, third": ([own["alone"] for own in new], BLUE),
        "averaged over rivals, second": ([own["averaged"] for own in second], GREEN),
        "averaged over rivals, third": ([own["averaged"] for own in new], ORANGE),
    }
    place = np.arange(len(labels))
    for k, (label, (values, colour)) in enumerate(bars.items()):
        left.bar_label(
            left.bar(place + 0.21 * (k - 1.5), values, width=0.2, color=colour, label=label),
            fmt="%+.1f",
            fontsize=6,
        )
    left.axhline(0.0, color="black", linewidth=0.8)
    left.set_xticks(place, labels, fontsize=8)
    left.set_ylabel("ln B(linear/constant) (nat)")
    left.legend(fontsize=8)
    names = list(new[0]["inclusion"])
    for k, (label, own, colour) in enumerate(
        zip(labels, new, (GREEN, ORANGE, BLUE, GREY), strict=True)
    ):
        values = [own["inclusion"][name] for name in names]
        right.barh(
            np.arange(len(names)) + 0.2 * (k - 1.5),
            values,
            height=0.18,
            color=colour,
            label=label.replace("\n", " "),
        )
    right.axvline(0.5, color="black", linewidth=0.8, linestyle="--")
    right.set_yticks(range(len(names)), names)
    right.invert_yaxis()
    right.set(xlabel="probability that it explains a change with force (1)", xlim=(0.0, 1.0))
    # FurtherCampaign the bars of joint load, which are short.
    right.legend(fontsize=8, loc="center right", bbox_to_anchor=(1.0, 0.62))
    return figure


def gain_figure(results: dict[str, Any]) -> Figure:
    """Left: gain by order; middle: ln B of its parts; right: ln B against what the tables leave
    open."""
    figure = Figure(figsize=(10.5, 3.8), layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=[0.8, 1.1, 1.1])
    orders = results["gain"]["least_squares"]["order"]
    left.bar(
        list(orders),
        [100.0 * share for share in orders.values()],
        color=[BLUE, GREEN, GREEN, GREEN, ORANGE],
    )
    left.set(xlabel="Fourier order (1)", ylabel="share of the least-squares gain (%)")
    left.set_title("Gain of linear, by order", fontsize=9.5)
    _parts(middle, results["gain"]["evidence"])
    _open(right, results["undetermined"])
    return figure


def _parts(axes: Axes, evidence: dict[str, Any]) -> None:
    """ln B over constant compliance of common mode, the other slopes and all of them, under three
    assumptions."""
    labels = [label for label in gain.ASSUMPTIONS if label != "white noise alone"]
    for k, (part, colour) in enumerate(SHOWN.items()):
        values = [evidence[label][part] for label in labels]
        axes.bar(
            np.arange(len(labels)) + 0.27 * (k - 1), values, width=0.25, color=colour, label=part
        )
    axes.axhline(0.0, color="black", linewidth=0.8)
    axes.set_xticks(
        range(len(labels)),
        ["zero and\ncentre move", "each with its\nown scale", "the centre\nalone moves"],
        fontsize=8,
    )
    axes.set_ylabel("ln B over constant compliance (nat)")
    axes.set_title("Evidence of the parts", fontsize=9.5)
    axes.legend(fontsize=8, loc="upper left")


def _open(axes: Axes, found: dict[str, Any]) -> None:
    """ln B along cos 4θ of the lightest circle, and of completions drawn."""
    drawn = pd.read_csv(HERE / "drawn.csv").query("kind == 'drawn'")
    path = found["paths"][undetermined.COS_4]
    per_um = path["sd_of_harmonic_um"] / path["sd_um"]
    recovered = found["cos4_um"][0]
    axes.plot(
        recovered + per_um * drawn[undetermined.COS_4],
        drawn["linear"] - drawn["constant"],
        ".",
        color=GREY,
        markersize=3,
    )
    steps = {0.0: found["as_recovered"]} | {
        float(step): own["log_bayes_factor"] for step, own in path["steps"].items()
    }
    x = np.array(sorted(steps))
    axes.plot(
        recovered + path["sd_of_harmonic_um"] * x,
        [steps[step] for step in x],
        "o-",
        color=BLUE,
        markersize=4,
    )
    axes.plot(recovered, steps[0.0], "D", color=ORANGE, markersize=7, label="as recovered")
    axes.plot(
        found["smallest"]["cos4_um"],
        found["smallest"]["log_bayes_factor"],
        "s",
        color=GREEN,
        label="smallest harmonics",
    )
    axes.axhline(0.0, color="black", linewidth=0.8)
    axes.set(
        xlabel=f"cos 4θ at {found['lightest_N']:.0f} N (µm)", ylabel="ln B(linear/constant) (nat)"
    )
    axes.set_title("What the tables leave open; grey: drawn", fontsize=9.5)
    axes.legend(fontsize=8, loc="upper left")


def reliability_figure(found: dict[str, Any]) -> Figure:
    """Claimed probability of linear against how often it was linear."""
    figure = Figure(figsize=(4.6, 4.4), layout="constrained")
    axes = figure.subplots()
    claimed, seen, count = (np.array(found[name]) for name in ("claimed", "was linear", "count"))
    spread = np.sqrt(np.maximum(claimed * (1.0 - claimed), 0.25 / count) / count)
    axes.plot([0.0, 1.0], [0.0, 1.0], color=GREY, linewidth=0.9)
    axes.errorbar(claimed, seen, 2.0 * spread, fmt="o", color=BLUE, capsize=3)
    axes.set_xlabel("claimed probability of linear (1)")
    axes.set_ylabel("share that was linear (1), ± 2 standard errors")
    axes.set_title(f"{sum(found['count'])} campaigns from the priors", fontsize=9.5)
    return figure


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    nats = {
        f"{part}/*": 0.03
        for part in ("compared", "explained", "undetermined", "gain/evidence", "printed")
    } | {"gain/slopes/*": 0.1}
    run(
        Study(
            HERE,
            measure,
            draw,
            absolute=nats,
            long=(*(f"printed/{path}" for path in printed.LONG), f"explained/{MOVES[1]}"),
        )
    )


if __name__ == "__main__":
    main()
