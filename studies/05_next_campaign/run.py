"""The campaign that should come next: which forces, how many circles, which clockings or radii;
predicted and simulated.

python studies/05_next_campaign/run.py            # fails when a stated number is not reproduced
python studies/05_next_campaign/run.py --quick    # with fewer simulated campaigns
python studies/05_next_campaign/run.py --write    # states anew
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import ldbb_bayes as lb

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]
import campaigns
import designs
from study import Effort, Study, replicated, run

AGAIN: dict[Effort, int] = {"quick": 1, "usual": 6}
THIRD_AGAIN: dict[Effort, int] = {"quick": 1, "usual": 3}
SEPARATED = {
    "E_C0YX": (1e6, "E_C(0Y)X (µrad)"),
    "E_YX2": (1e9, "E_YX2 (µm/m²)"),
    "C_CCY": (1e12, "C_CCY (nrad/(N m))"),
}
COLOURS = {"forces alone": "#8C8C8C", "two radii": "#E69F00", "both balls clocked": "#0072B2"}
LABELS = {
    "settling: constant": "constant",
    "settling: slopes": "slopes from their prior",
    "settling: equal slopes": "equal slopes",
    "settling: equal slopes, zero kept": "equal slopes, zero kept",
    "C_XYX_1: absent": "C_XYX_1 absent",
    "C_XYX_1: there": "C_XYX_1 there",
    "C_XYX_1: equal slopes": "equal slopes",
}
# Slopes in nm/N per kN, nrad/N per kN and nrad/(N m) per kN.
SLOPE_FACTOR = {"C_XXX_1": 1e9, "C_XYX_1": 1e9, "C_CXY_1": 1e12, "C_CCY_1": 1e15}


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the page states."""
    widths = replicated(
        HERE / "widths.csv", campaigns.width_row, campaigns.WIDTHS, effort, again=AGAIN
    )
    decisions = replicated(
        HERE / "decisions.csv", campaigns.decision_row, campaigns.DECISIONS, effort, again=AGAIN
    )
    third_widths = replicated(
        HERE / "third_widths.csv",
        campaigns.third_width_row,
        campaigns.THIRD_WIDTHS,
        effort,
        again=THIRD_AGAIN,
    )
    third_decisions = replicated(
        HERE / "third_decisions.csv",
        campaigns.third_decision_row,
        campaigns.THIRD_DECISIONS,
        effort,
        again=THIRD_AGAIN,
    )
    return {
        "six": six(),
        "flat": {name: flat(degree) for degree, name in enumerate(("constant", "linear"))},
        "power": designs.POWER,
        "settling": {
            "tests": circles(designs.settling()),
            "discrimination": decided(designs.settling()),
        },
        "finding": {slope: finding(slope) for slope in designs.SOUGHT},
        "squareness": {name: square(design) for name, design in designs.squareness().items()},
        "nine": {choice: nine(choice) for choice in designs.NINE},
        "squareness_target_urad": [1e6 * target for target in designs.WITHIN["E_C0YX"]],
        "radii_mm": list(designs.RADII_MM),
        "papers_forces_N": list(designs.PAPER_N),
        "papers_step_N": designs.PAPER_N[-1] - designs.PAPER_N[-2],
        "equal_slope": 1e9 * campaigns.equal_slope(),
        "simulated": simulated(widths, decisions),
        "third": third(third_widths, third_decisions, quick=effort == "quick"),
    }


# What takes minutes, and is not measured with ``--quick``.
LONG = ("third/squareness", f"third/nine/{designs.BOTH_WAYS}")


def third(widths: pd.DataFrame, decisions: pd.DataFrame, *, quick: bool = False) -> dict[str, Any]:
    """What the third edition says of the same designs; of constant or linear, with as many circles
    as settle it by the first edition, and with very many.

    ``quick``: without what `LONG` names.
    """
    choices = [choice for choice in designs.THIRD_NINE if choice != designs.BOTH_WAYS or not quick]
    numbers = {
        "six": six("third"),
        "nine": {choice: nine(choice, "third") for choice in choices},
        "settling": {
            "few": deciding(len(designs.settling().tests)),
            "many": deciding(designs.MOST_TO_FIND),
        },
        "simulated": simulated(widths, decisions, "third"),
    }
    if not quick:
        by_choice = designs.squareness("third")
        numbers["squareness"] = {name: square(design) for name, design in by_choice.items()}
    return numbers


def deciding(tests: int) -> dict[str, Any]:
    """Where so many circles go that decide by the third edition, and what ln B is expected."""
    design = designs.deciding(tests, "third")
    return {**circles(design), **decided(design)}


def simulated(
    widths: pd.DataFrame, decisions: pd.DataFrame, edition: designs.Edition = "first"
) -> dict[str, Any]:
    """Widths and coverage of the simulated designs, the worst of both, and ln B of those that are
    to decide."""
    by_kind = {
        kind: campaigns.widths(widths, kind, predicted(kind, edition))
        for kind in dict.fromkeys(widths["kind"])
    }
    coverage = {}
    misses = []
    for kind, table in by_kind.items():
        for name, entry in table["parameters"].items():
            coverage[f"{name}, {kind}"] = entry["coverage_95"]
            misses.append(abs(entry["width_over_predicted"] - 1.0))
    lowest = min(coverage, key=coverage.__getitem__)
    return {
        "widths": by_kind,
        "campaigns": len(widths) + len(decisions),
        "mean_coverage": [table["coverage_mean"] for table in by_kind.values()],
        "largest_miss": max(misses),
        "lowest_coverage": {"name": lowest, "value": coverage[lowest]},
        "decisions": campaigns.decisions(decisions),
    }


def six(edition: designs.Edition = "first") -> dict[str, Any]:
    """Six circles for all parameters, beside the paper's six and equal steps."""
    design = designs.six(edition)
    equal_steps, paper = design.compared
    ratio = {name: entry.sd / paper.expected[name].sd for name, entry in design.expected.items()}
    return {
        "forces_N": sorted(float(test.force_N or 0.0) for test in design.tests),
        "efficiency": {
            "recommended": design.efficiency,
            equal_steps.name: equal_steps.efficiency,
            paper.name: paper.efficiency,
        },
        "width_over_the_papers": ratio,
        "narrower": [value for name, value in ratio.items() if name.startswith("C_")],
    }


def flat(degree: int) -> dict[str, Any]:
    """Best shares with flat priors; levels that are neighbours count as one."""
    design = designs.flat(degree)
    shares = design.shares.groupby("force_N")["share"].sum()
    level = (np.diff(shares.index.to_numpy(), prepend=-np.inf) > 2.0).cumsum()
    levels = [of_level for _, of_level in shares.groupby(level)]
    return {
        "forces_N": [float(np.average(of_level.index, weights=of_level)) for of_level in levels],
        "shares": [float(of_level.sum()) for of_level in levels],
        "the_papers_seven": design.compared[1].efficiency,
    }


def circles(design: lb.analysis.Design) -> dict[str, Any]:
    """How many circles at which force, with the same clocking and radius or any."""
    return {"number": len(design.tests), "at_N": counts_by(design, "force_N")}


def counts_by(design: lb.analysis.Design, column: str) -> dict[str, int]:
    """How many circles there are of every force or radius."""
    counts = design.table.groupby(column)["count"].sum()
    return {f"{value:g}": int(count) for value, count in counts.items()}


def decided(design: lb.analysis.Design) -> dict[str, Any]:
    """What the design expects of ln B."""
    return {} if design.discrimination is None else design.discrimination.as_dict()


def finding(slope: str) -> dict[str, Any]:
    """The fewest circles that find one slope, and what is expected if it is not there."""
    design = designs.finding(slope)
    name = slope.partition(",")[0]
    prior_sd = design.expected[name].prior_sd * SLOPE_FACTOR[name]
    discrimination = decided(design)
    return {
        "size": designs.SOUGHT[slope] * prior_sd,
        **circles(design),
        "power": discrimination["power"][name],
        "expected_without": discrimination["expected_without"],
        "decisive_without": discrimination["decisive_without"],
        "sd": design.expected[name].sd * SLOPE_FACTOR[name],
        "equal_steps_efficiency": design.compared[0].efficiency,
    }


def square(design: lb.analysis.Design) -> dict[str, Any]:
    """Squareness, and what any number of such circles would leave."""
    return {
        **circles(design),
        "urad": 1e6 * design.expected["E_C0YX"].sd,
        "floor_urad": 1e6 * design.expected["E_C0YX"].floor_sd,
    }


def nine(choice: str, edition: designs.Edition = "first") -> dict[str, Any]:
    """Expected sd of nine circles, and how many there are of each radius."""
    design = designs.nine(choice, edition)
    clockings = design.table[["work_ball_deg", "tool_ball_deg"]].drop_duplicates()
    return {
        "at_radius_mm": counts_by(design, "radius_mm"),
        "clockings": len(clockings),
        "sd": sds(design.expected),
    }


def sds(expected: Mapping[str, Any]) -> dict[str, float]:
    """Expected sd of every parameter."""
    return {name: entry.sd for name, entry in expected.items()}


def predicted(kind: str, edition: designs.Edition) -> dict[str, float]:
    """Expected sd of every parameter of a simulated design."""
    if kind == "recommended six":
        return sds(designs.six(edition).expected)
    if kind == "the paper's six":
        return sds(designs.six(edition).compared[1].expected)
    return sds(designs.nine(kind.removeprefix("nine, "), edition).expected)


def draw(results: dict[str, Any]) -> dict[str, Figure]:
    """Expected intervals; radii against clocking, and the evidence found in simulation."""
    return {
        "expected_widths": lb.figures.expected_widths(designs.six()),
        "settling": settling_figure(results),
    }


def settling_figure(results: dict[str, Any]) -> Figure:
    """Left: ln B of simulated campaigns; right: expected u of nine circles by what may be
    changed."""
    figure = Figure(figsize=(10.0, 3.8), layout="constrained")
    evidence_axes, ratio_axes = figure.subplots(1, 2, width_ratios=[1.25, 1.0])
    _evidence(evidence_axes)
    _ratios(ratio_axes, results["nine"])
    return figure


def _ratios(axes: Axes, of_nine: dict[str, Any]) -> None:
    """Expected u of geometric errors by what may be changed, over that by forces alone."""
    places = np.arange(len(SEPARATED))
    reference = of_nine["forces alone"]["sd"]
    for k, (choice, colour) in enumerate(COLOURS.items()):
        sd = of_nine[choice]["sd"]
        ratio = [sd[name] / reference[name] for name in SEPARATED]
        bars = axes.bar(places + 0.28 * (k - 1), ratio, width=0.26, color=colour, label=choice)
        texts = []
        for name, (factor, _) in SEPARATED.items():
            two_digits = float(f"{sd[name] * factor:.2g}")
            texts.append(f"{two_digits:g}")
        axes.bar_label(bars, texts, fontsize=8)
    axes.set_xticks(places, [label for _, label in SEPARATED.values()], fontsize=8)
    axes.set_ylim(0.0, 1.3)
    axes.set_ylabel("expected u / that of forces alone (1)")
    axes.set_title("Nine circles: geometry against ball form", fontsize=9.5)
    axes.legend(fontsize=8, loc="upper left", ncols=3, columnspacing=1.0, handlelength=1.2)


def _evidence(axes: Axes) -> None:
    """Median and the central 90 % of ln B by kind."""
    rows = pd.read_csv(HERE / "decisions.csv")
    places = np.arange(len(LABELS))[::-1]
    for place, kind in zip(places, LABELS, strict=True):
        low, middle, high = np.quantile(rows.loc[rows["kind"] == kind, "ln B"], [0.05, 0.5, 0.95])
        colour = "#0072B2" if kind.startswith("settling") else "#D55E00"
        axes.errorbar(
            middle,
            place,
            xerr=[[middle - low], [high - middle]],
            fmt="o",
            color=colour,
            capsize=3,
            markersize=5,
        )
    axes.axvspan(-campaigns.DECISIVE, campaigns.DECISIVE, color="#EEEEEE", zorder=0)
    axes.axvline(0.0, color="black", linewidth=0.8)
    axes.set_xscale("symlog", linthresh=5.0)
    axes.set_xticks([-10, -5, 0, 5, 10, 100], ["−10", "−5", "0", "5", "10", "100"])
    axes.minorticks_off()
    axes.set_yticks(places, list(LABELS.values()), fontsize=8)
    settling_circles = len(campaigns.plan_of("settling").tests)
    finding_circles = len(campaigns.plan_of(campaigns.SOUGHT).tests)
    axes.set_xlabel("ln B in favour of the slopes (nat, linear within ±5; grey: not decisive)")
    axes.set_title(
        f"Simulated, median and 5 to 95 %: {settling_circles} (blue) and {finding_circles} circles"
        " (orange)",
        fontsize=9.5,
    )


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    near = {"*expected_without": 0.02, "*decisive*": 0.01, "*misleading*": 0.01, "*power*": 0.01}
    run(Study(HERE, measure, draw, tolerance=0.02, absolute=near, long=LONG))


if __name__ == "__main__":
    main()
