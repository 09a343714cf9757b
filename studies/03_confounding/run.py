"""What form error of the balls does to the published geometric errors and C_CCY, and what clocking both balls would have changed.

python studies/03_confounding/run.py            # fails when a stated number is not reproduced
python studies/03_confounding/run.py --write    # states anew
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

import ldbb_bayes as lb

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from study import DATA, Study, run  # noqa: E402

NAMES = ("E_XX1", "E_YY1", "E_YX2", "E_XY2", "E_C0YX", "C_CCY")
SHOWN = {"E_XX1": (1e6, "µm/m"), "E_YY1": (1e6, "µm/m"), "E_YX2": (1e9, "µm/m²"), "E_XY2": (1e9, "µm/m²")}
SHOWN |= {"E_C0YX": (1e6, "µrad"), "C_CCY": (1e9, "µrad/(N m)")}
CALIBRATED_UM = 0.5
CLOCKINGS_DEG = (0.0, 45.0, 90.0)
FITS = {"least squares": "#000000", "without form": "#8C8C8C", "with form": "#0072B2"}
PLANS = {
    "as run": lambda plan: plan,
    "length calibrated to 0.5 µm": lambda plan: plan,
    "both balls at 0, 45, 90° in turn": lambda plan: turned(plan, work=True, tool=True),
    "work ball alone": lambda plan: turned(plan, work=True, tool=False),
    "both balls, length calibrated": lambda plan: turned(plan, work=True, tool=True),
}


def turned(plan: lb.Campaign, *, work: bool, tool: bool) -> lb.Campaign:
    """The same circles, the balls turned from circle to circle."""
    tests = []
    for i, test in enumerate(plan.tests):
        angle = CLOCKINGS_DEG[i % len(CLOCKINGS_DEG)]
        tests.append(replace(test, work_ball_deg=angle if work else 0.0, tool_ball_deg=angle if tool else 0.0))
    return replace(plan, tests=tuple(tests))


def calibrated(model: lb.HybridModel) -> lb.HybridModel:
    """The model with a bar length known well."""
    return replace(
        model, nuisances=tuple(replace(t, sd_um=CALIBRATED_UM) if type(t).__name__ == "BarLength" else t for t in model.nuisances)
    )


def published() -> dict[str, float]:
    """Tables 5 and 6."""
    tables = DATA / "published_tables"
    row = {
        **pd.read_csv(tables / "table_5_global_compliances.csv").iloc[0],
        **pd.read_csv(tables / "table_6_global_geometric_errors.csv").iloc[0],
    }
    return {name: float(row[name.replace("E_C0YX", "E_C(0Y)X")]) for name in NAMES}


def measure() -> dict[str, Any]:
    """Everything the page states, in units for reading."""
    campaign = lb.read_campaign(DATA / "recovered_experiment")
    constant = lb.HybridModel.default(degree=0)
    free = constant.without("truncation")
    fits = {
        "least squares": lb.marginals(lb.HybridModel.paper(degree=0), campaign),
        "without form": lb.marginals(free.without("ball-form"), campaign),
        "with form": lb.marginals(free, campaign),
    }
    printed = published()
    results: dict[str, Any] = {"parameters": {}, "plans": {}}
    for name in NAMES:
        factor, unit = SHOWN[name]
        entry: dict[str, Any] = {"unit": unit, "published": printed[name] * factor}
        for label, table in fits.items():
            row = table.loc[name]
            entry[label] = {"mean": row["mean"] * factor, "sd": row["sd"] * factor}
        results["parameters"][name] = entry
    for label, change in PLANS.items():
        model = calibrated(constant) if "calibrated" in label else constant
        found = lb.identify(model, change(campaign.plan()))
        results["plans"][label] = {
            name: {"sd": found.parameters[name].sd * SHOWN[name][0], "verdict": found.parameters[name].verdict.word}
            for name in NAMES
        }
    now = lb.identify(constant, campaign)
    fitted = results["parameters"]
    results["too_narrow"] = {n: fitted[n]["with form"]["sd"] / fitted[n]["least squares"]["sd"] for n in NAMES}
    results["gain_difference"] = fitted["E_XX1"]["with form"]["mean"] - fitted["E_YY1"]["with form"]["mean"]
    results |= {"clockings_deg": [int(angle) for angle in CLOCKINGS_DEG], "calibrated_um": CALIBRATED_UM}
    results["lowest_force_N"] = float(campaign.forces_N.min())
    results["statements"] = [d.statement for d in now.degeneracies]
    return results


def draw(results: dict[str, Any]) -> Figure:
    """Left: published, without and with form; right: predicted sd by plan."""
    figure = Figure(figsize=(10.0, 5.6), layout="constrained")
    panels = figure.subplots(2, 6)
    for axes, (name, entry) in zip(panels[0], results["parameters"].items(), strict=True):
        for x, (label, colour) in enumerate(FITS.items()):
            fit = entry[label]
            axes.errorbar(x, fit["mean"], 1.96 * fit["sd"], fmt="o", color=colour, capsize=3, markersize=4)
        axes.axhline(entry["published"], color="#D55E00", linewidth=1.0)
        axes.set_xticks([0, 1, 2], ["white\nnoise", "no\nform", "with\nform"])
        axes.set_xlim(-0.6, 2.6)
        shown = name.replace("E_C0YX", "E_C(0Y)X")
        axes.set_title(f"{shown}\n({entry['unit']})", fontsize=9)
        axes.tick_params(labelsize=7)
    for axes, name in zip(panels[1], NAMES, strict=True):
        sds = [plan[name]["sd"] for plan in results["plans"].values()]
        words = [plan[name]["verdict"] for plan in results["plans"].values()]
        colours = ["#D55E00" if word == "aliased" else "#E69F00" if word == "prior-limited" else "#009E73" for word in words]
        axes.barh(range(len(sds))[::-1], sds, color=colours)
        axes.set_yticks(range(len(sds))[::-1], list(results["plans"]) if name == NAMES[0] else [""] * len(sds), fontsize=7)
        axes.set_xlabel(f"sd ({SHOWN[name][1]})", fontsize=8)
        axes.tick_params(labelsize=7)
    figure.suptitle(
        "Top: 95 % intervals by model; orange line: published. Bottom: predicted sd of the same six circles by plan; "
        "orange: aliased, green: identified",
        fontsize=9,
    )
    return figure


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    run(Study(HERE, lambda effort: measure(), lambda results: {"confounding": draw(results)}))


if __name__ == "__main__":
    main()
