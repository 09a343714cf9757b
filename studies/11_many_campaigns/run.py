"""Many machines and many months: is a population returned as surely as it says, and how soon is a
loosened joint found?

python studies/11_many_campaigns/run.py            # fails when a stated number is not reproduced
python studies/11_many_campaigns/run.py --write    # states anew
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import ldbb_bayes as lb

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]
from machines import (
    FORCES_N,
    MACHINES,
    MONTHLY_FORCES_N,
    MONTHLY_READINGS,
    READINGS,
    REPEATABILITY,
    fleet,
    months,
)
from study import Effort, Study, replicated, run

FLEETS = 200
SERIES = 60
QUIET = 40
BEFORE = 6
AFTER = 12
CHANGE = 0.2
PARAMETER = "C_XXX"
AGAIN: dict[Effort, int] = {"quick": 2, "usual": 10}
SHOWN = 7


def pooled(seed: int) -> dict[str, float]:
    """A fleet: which true means, spreads and machines lie in their 95 % intervals, and their errors
    in units of u."""
    rows, truth = fleet(seed)
    found = lb.fleet.fit_population(rows)
    row: dict[str, float] = {
        "pareto k": found.pareto_k,
        "not belonging": sum(own.flag for own in found.machine.values()),
    }
    for name, own in found.parameters.items():
        row[f"mean {name}"] = (own.mean.mean - truth["mean"][name]) / own.mean.sd
        row[f"spread {name}"] = (
            own.spread.interval[0] <= truth["spread"][name] <= own.spread.interval[1]
        )
        row[f"mean inside {name}"] = (
            own.mean.interval[0] <= truth["mean"][name] <= own.mean.interval[1]
        )
        machines = [
            (
                one.estimate[name].interval[0]
                <= truth["machines"][machine][name]
                <= one.estimate[name].interval[1]
            )
            for machine, one in found.machine.items()
        ]
        row[f"machines inside {name}"] = float(np.mean(machines))
        alone = [
            (one.alone[name].mean - truth["machines"][machine][name]) ** 2
            for machine, one in found.machine.items()
        ]
        shrunk = [
            (one.estimate[name].mean - truth["machines"][machine][name]) ** 2
            for machine, one in found.machine.items()
        ]
        row[f"error {name}"] = float(np.sqrt(np.mean(shrunk) / np.mean(alone)))
    return row


def watched(seed: int, change: float) -> dict[str, float]:
    """A machine month by month: after how many campaigns the change was found, false alarms, and
    which of its compliances lie in the 95 % intervals of the last month."""
    rows, level = months(seed, before=BEFORE, after=AFTER, change=change, parameter=PARAMETER)
    found = 0
    alarm = float(lb.fleet.find_trend(rows[:BEFORE]).changed)
    right = 0.0
    for n in range(BEFORE + 1, BEFORE + AFTER + 1):
        now = lb.fleet.find_trend(rows[:n])
        if now.changed:
            found = n - BEFORE
            right = float(now.most_probable == PARAMETER)
            break
    row = {"found": float(found), "alarm before": alarm, "right": right}
    for name, own in lb.fleet.find_trend(rows).parameters.items():
        low, high = own.level_now.interval
        row[f"level inside {name}"] = float(low <= level[name] <= high)
    return row


def job(kind: str, seed: int) -> dict[str, float]:
    """One row."""
    return pooled(seed) if kind == "fleet" else watched(seed, CHANGE if kind == "loosened" else 0.0)


def measure(effort: Effort) -> dict[str, Any]:
    """All kinds."""
    kinds = {"fleet": FLEETS, "loosened": SERIES, "quiet": QUIET}
    rows = replicated(HERE / "simulated.csv", job, kinds, effort, again=AGAIN)
    return {
        "setting": setting(),
        "population": population(rows[rows["kind"] == "fleet"]),
        "trend": found_when(rows),
    }


def setting() -> dict[str, Any]:
    """What was simulated."""
    return {
        "fleets": FLEETS,
        "machines": MACHINES,
        "series": SERIES,
        "quiet": QUIET,
        "before": BEFORE,
        "after": AFTER,
        "change_percent": 100.0 * CHANGE,
        "repeatability_percent": 100.0 * REPEATABILITY,
        "tests": len(FORCES_N),
        "readings": READINGS,
        "monthly_tests": len(MONTHLY_FORCES_N),
        "monthly_readings": MONTHLY_READINGS,
        "threshold": 0.95,
        "family_percent": 5.0,
    }


def population(rows: pd.DataFrame) -> dict[str, Any]:
    """Coverage with its standard error: fleets are independent, parameters and machines of one are
    not."""
    found: dict[str, Any] = {"pareto_k_most": float(rows["pareto k"].max())}
    for what in ("mean inside", "spread", "machines inside"):
        own = rows.filter(regex=f"^{what} C_")
        each = own.mean(axis=1)
        found[what.split()[0]] = {
            "coverage": float(each.mean()),
            "error": float(each.std(ddof=1) / np.sqrt(len(each))),
            "by_parameter": {
                str(name).rsplit(" ", 1)[1]: float(value) for name, value in own.mean().items()
            },
        }
    errors = rows.filter(regex="^error C_").mean()
    found["error_ratio"] = {
        str(name).rsplit(" ", 1)[1]: float(value) for name, value in errors.items()
    }
    found["flagged_share"] = float(rows["not belonging"].gt(0).mean())
    found["flagged_error"] = counting_error(int(rows["not belonging"].gt(0).sum()), len(rows))
    return found


def counting_error(found: int, of: int) -> float:
    """Standard deviation of a share after counting, from a uniform prior: not 0 where all or none
    were found."""
    return float(np.sqrt((found + 1.0) * (of - found + 1.0) / ((of + 2.0) ** 2 * (of + 3.0))))


def found_when(rows: pd.DataFrame) -> dict[str, Any]:
    """How many were found and how soon, and how often there was an alarm without reason."""
    loosened, quiet = (rows[rows["kind"] == kind] for kind in ("loosened", "quiet"))
    seen = loosened.loc[loosened["found"] > 0, "found"]
    inside = pd.concat([loosened, quiet]).filter(regex="^level inside C_")
    of_machines = inside.mean(axis=1)
    return {
        "level_inside": {
            "coverage": float(of_machines.mean()),
            "error": float(of_machines.std(ddof=1) / np.sqrt(len(of_machines))),
        },
        "alarm_before": int(loosened["alarm before"].sum()),
        "median_found": float(seen.median()),
        "latest_found": int(seen.max()),
        "found_at_all": len(seen),
        "right_parameter": int(loosened["right"].sum()),
        "false_alarms": int((quiet["found"] > 0).sum() + quiet["alarm before"].sum()),
    }


def draw(results: dict[str, Any]) -> Mapping[str, Figure]:
    """The control chart of one loosened machine, and coverage by parameter."""
    shown = months(SHOWN, before=BEFORE, after=5, change=CHANGE, parameter=PARAMETER)
    return {
        "control_chart": lb.fleet.draw_control_chart(lb.fleet.find_trend(shown.rows)),
        "coverage": coverage(results["population"]),
    }


@lb.figures.styled
def coverage(population: dict[str, Any]) -> Figure:
    """Share inside the interval by parameter, with two binomial standard errors about what is
    promised."""
    figure = lb.figures.new_figure(7.5, 3.0)
    axes = figure.add_subplot()
    names = list(population["mean"]["by_parameter"])
    places = np.arange(len(names))
    for k, (what, label) in enumerate(
        (("mean", "mean of the population"), ("spread", "spread"), ("machines", "machines"))
    ):
        own = population[what]["by_parameter"]
        heights = [100.0 * own[name] for name in names]
        axes.plot(
            places + 0.2 * (k - 1), heights, "os^"[k], color=lb.figures.PALETTE[k], label=label
        )
    band = 100.0 * np.sqrt(0.95 * 0.05 / FLEETS)
    axes.axhspan(
        95.0 - 2.0 * band,
        95.0 + 2.0 * band,
        color="#E3E3E3",
        lw=0.0,
        label="two standard errors of counting fleets",
    )
    axes.axhline(95.0, color="#8C8C8C", lw=0.8)
    axes.set_xticks(places, names)
    axes.set_ylabel("inside the 95 % interval (%)")
    axes.set_ylim(88.0, 100.0)
    axes.legend(ncols=4, loc="lower left")
    return figure


if __name__ == "__main__":
    run(Study(HERE, measure, draw, absolute={"population/*": 0.005}))
