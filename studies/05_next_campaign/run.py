"""The campaign that should come next: which forces, how many circles, which clockings or radii;
predicted and simulated.

python studies/05_next_campaign/run.py            # fails when a stated number is not reproduced
python studies/05_next_campaign/run.py --quick    # with fewer simulated campaigns
python studies/05_next_campaign/run.py --write    # states anew
"""

from __future__ import annotations

import sys
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
    kept = (("third_widths.csv", campaigns.third_width_row, campaigns.THIRD_WIDTHS),)
    kept += (("third_decisions.csv", campaigns.third_decision_row, campaigns.THIRD_DECISIONS),)
    again = [
        replicated(HERE / name, job, kinds, effort, again=THIRD_AGAIN) for name, job, kinds in kept
    ]
    return {
        "six": six(),
        "flat": {name: flat(degree) for degree, name in enumerate(("constant", "linear"))},
        "power": designs.POWER,
        "settling": {
            "tests": circles(designs.settling()),
            "discrimination": decided(designs.settling()),
        },
        "finding": {slope: finding(slope) for slope in designs.SOUGHT},
        "squareness": {name: square(found) for name, found in designs.squareness().items()},
        "nine": {choice: nine(choice) for choice in designs.NINE},
        "squareness_target_urad": [1e6 * target for target in designs.WITHIN["E_C0YX"]],
        "radii_mm": list(designs.RADII_MM),
        "papers_forces_N": list(designs.PAPER_N),
        "papers_step_N": designs.PAPER_N[-1] - designs.PAPER_N[-2],
        "equal_slope": 1e9 * campaigns.equal_slope(),
        "simulated": simulated(widths, decisions),
        "third": third(*again, quick=effort == "quick"),
    }


def third(widths: pd.DataFrame, decisions: pd.DataFrame, *, quick: bool = False) -> dict[str, Any]:
    """What the third edition makes of it: six circles, nine, squareness, and constant or linear of
    so many and of very many.

    ``quick``: without what `LONG` names.
    """
    few = len(designs.settling().tests)
    choices = [choice for choice in designs.THIRD_NINE if choice != designs.BOTH_WAYS or not quick]
    found = {
        "six": six("third"),
        "nine": {choice: nine(choice, "third") for choice in choices},
        "settling": {
            how: {**circles(own), **decided(own)}
            for how, own in {
                "few": designs.deciding(few, "third"),
                "many": designs.deciding(designs.MOST_TO_FIND, "third"),
            }.items()
        },
        "simulated": simulated(widths, decisions, "third"),
    }
    if quick:
        return found
    return found | {
        "squareness": {name: square(own) for name, own in designs.squareness("third").items()}
    }


LONG = ("third/squareness", f"third/nine/{designs.BOTH_WAYS}")


def simulated(
    widths: pd.DataFrame, decisions: pd.DataFrame, edition: designs.Edition = "first"
) -> dict[str, Any]:
    """Widths and coverage of the simulated designs, the worst of both, and ln B of those that are
    to decide."""
    found = {
        kind: campaigns.widths(widths, kind, predicted(kind, edition))
        for kind in dict.fromkeys(widths["kind"])
    }
    every = {
        f"{name}, {kind}": own
        for kind, table in found.items()
        for name, own in table["parameters"].items()
    }
    lowest = min(every, key=lambda name: every[name]["coverage_95"])
    return {
        "widths": found,
        "campaigns": len(widths) + len(decisions),
        "mean_coverage": [table["coverage_mean"] for table in found.values()],
        "largest_miss": max(abs(own["width_over_predicted"] - 1.0) for own in every.values()),
        "lowest_coverage": {"name": lowest, "value": every[lowest]["coverage_95"]},
        "decisions": campaigns.decisions(decisions),
    }


def six(edition: designs.Edition = "first") -> dict[str, Any]:
    """Six circles for all parameters, beside the paper's six and equal steps."""
    found = designs.six(edition)
    paper = found.compared[1]
    ratio = {name: entry.sd / paper.expected[name].sd for name, entry in found.expected.items()}
    return {
        "forces_N": sorted(float(test.force_N or 0.0) for test in found.tests),
        "efficiency": (
            {"recommended": found.efficiency}
            | {own.name: own.efficiency for own in (found.compared[0], paper)}
        ),
        "width_over_the_papers": ratio,
        "narrower": [value for name, value in ratio.items() if name.startswith("C_")],
    }


def flat(degree: int) -> dict[str, Any]:
    """Best shares with flat priors; levels that are neighbours count as one."""
    found = designs.flat(degree)
    shares = found.shares.groupby("force_N")["share"].sum()
    level = (np.diff(shares.index.to_numpy(), prepend=-np.inf) > 2.0).cumsum()
    grouped = [own for _, own in shares.groupby(level)]
    return {
        "forces_N": [float(np.average(own.index, weights=own)) for own in grouped],
        "shares": [float(own.sum()) for own in grouped],
        "the_papers_seven": found.compared[1].efficiency,
    }


def circles(found: lb.analysis.Design) -> dict[str, Any]:
    """How many circles at which force, with the same clocking and radius or any."""
    count = found.table.groupby("force_N")["count"].sum()
    return {
        "number": len(found.tests),
        "at_N": {f"{force:g}": int(n) for force, n in count.items()},
    }


def decided(found: lb.analysis.Design) -> dict[str, Any]:
    """What the design expects of ln B."""
    return {} if found.discrimination is None else found.discrimination.as_dict()


def finding(slope: str) -> dict[str, Any]:
    """The fewest circles that find one slope, and what is expected if it is not there."""
    found = designs.finding(slope)
    name = slope.partition(",")[0]
    prior_sd = found.expected[name].prior_sd * SLOPE_FACTOR[name]
    own = decided(found)
    return {
        "size": designs.SOUGHT[slope] * prior_sd,
        **circles(found),
        "power": own["power"][name],
        "expected_without": own["expected_without"],
        "decisive_without": own["decisive_without"],
        "sd": found.expected[name].sd * SLOPE_FACTOR[name],
        "equal_steps_efficiency": found.compared[0].efficiency,
    }


def square(found: lb.analysis.Design) -> dict[str, Any]:
    """Squareness, and what any number of such circles would leave."""
    return {
        **circles(found),
        "urad": 1e6 * found.expected["E_C0YX"].sd,
        "floor_urad": 1e6 * found.expected["E_C0YX"].floor_sd,
    }


def nine(choice: str, edition: designs.Edition = "first") -> dict[str, Any]:
    """Expected sd of nine circles, and how many there are of each radius."""
    found = designs.nine(choice, edition)
    return {
        "at_radius_mm": {
            f"{radius:g}": int(n)
            for radius, n in found.table.groupby("radius_mm")["count"].sum().items()
        },
        "clockings": int(
            found.table[["work_ball_deg", "tool_ball_deg"]].drop_duplicates().shape[0]
        ),
        "sd": {name: entry.sd for name, entry in found.expected.items()},
    }


def predicted(kind: str, edition: designs.Edition) -> dict[str, float]:
    """Expected sd of every parameter of a simulated design."""
    forecasts = {
        "recommended six": lambda: designs.six(edition),
        "the paper's six": lambda: designs.six(edition).compared[1],
        "nine, two radii": lambda: designs.nine("two radii", edition),
        "nine, both balls clocked": lambda: designs.nine("both balls clocked", edition),
    }
    return {name: entry.sd for name, entry in forecasts[kind]().expected.items()}


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
    left, right = figure.subplots(1, 2, width_ratios=[1.25, 1.0])
    _evidence(left)
    places = np.arange(len(SEPARATED))
    for k, (choice, colour) in enumerate(COLOURS.items()):
        sd = results["nine"][choice]["sd"]
        ratio = [sd[name] / results["nine"]["forces alone"]["sd"][name] for name in SEPARATED]
        bars = right.bar(places + 0.28 * (k - 1), ratio, width=0.26, color=colour, label=choice)
        right.bar_label(
            bars,
            [f"{float(f'{sd[name] * factor:.2g}'):g}" for name, (factor, _) in SEPARATED.items()],
            fontsize=8,
        )
    right.set_xticks(places, [label for _, label in SEPARATED.values()], fontsize=8)
    right.set_ylim(0.0, 1.3)
    right.set_ylabel("expected u / that of forces alone (1)")
    right.set_title("Nine circles: geometry against ball form", fontsize=9.5)
    right.legend(fontsize=8, loc="upper left", ncols=3, columnspacing=1.0, handlelength=1.2)
    return figure


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
    few, many = (len(campaigns.plan_of(name).tests) for name in ("settling", campaigns.SOUGHT))
    axes.set_xlabel("ln B in favour of the slopes (nat, linear within ±5; grey: not decisive)")
    axes.set_title(
        f"Simulated, median and 5 to 95 %: {few} (blue) and {many} circles (orange)", fontsize=9.5
    )


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    near = {"*expected_without": 0.02, "*decisive*": 0.01, "*misleading*": 0.01, "*power*": 0.01}
    run(Study(HERE, measure, draw, tolerance=0.02, absolute=near, long=LONG))


if __name__ == "__main__":
    main()
