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
# Machines followed over the months: with a joint that loosens, and without.
SERIES = 60
QUIET = 40
# Campaigns of a machine before a joint loosens, and after; the change as a share of the compliance.
BEFORE = 6
AFTER = 12
CHANGE = 0.2
PARAMETER = "C_XXX"
AGAIN: dict[Effort, int] = {"quick": 2, "usual": 10}
# Of the machine in the control chart.
SEED_OF_CHART = 7


def pooled(seed: int) -> dict[str, float]:
    """A fleet: which true means, spreads and machines lie in their 95 % intervals, and their errors
    in units of u."""
    rows, truth = fleet(seed)
    posterior = lb.fleet.fit_population(rows)
    row: dict[str, float] = {
        "pareto k": posterior.pareto_k,
        "not belonging": sum(machine.flag for machine in posterior.machine.values()),
    }
    for name, parameter in posterior.parameters.items():
        true_mean = truth["mean"][name]
        row[f"mean {name}"] = (parameter.mean.mean - true_mean) / parameter.mean.sd
        row[f"spread {name}"] = covers(parameter.spread.interval, truth["spread"][name])
        row[f"mean inside {name}"] = covers(parameter.mean.interval, true_mean)
        is_covered = []
        squares_in_population = []
        squares_without_others = []
        for machine_id, machine in posterior.machine.items():
            true = truth["machines"][machine_id][name]
            is_covered.append(covers(machine.estimate[name].interval, true))
            squares_in_population.append((machine.estimate[name].mean - true) ** 2)
            squares_without_others.append((machine.alone[name].mean - true) ** 2)
        row[f"machines inside {name}"] = float(np.mean(is_covered))
        ratio = np.mean(squares_in_population) / np.mean(squares_without_others)
        row[f"error {name}"] = float(np.sqrt(ratio))
    return row


def covers(interval: tuple[float, float], truth: float) -> bool:
    """Whether the interval holds the truth."""
    low, high = interval
    return bool(low <= truth <= high)


def watched(seed: int, change: float) -> dict[str, float]:
    """A machine month by month: after how many campaigns the change was found (0: never), false
    alarms, and which of its compliances lie in the 95 % intervals of the last month."""
    rows, level = months(
        seed, months_before=BEFORE, months_after=AFTER, change=change, parameter=PARAMETER
    )
    row = {
        "found": 0.0,
        "alarm before": float(lb.fleet.find_trend(rows[:BEFORE]).changed),
        "right": 0.0,
    }
    for campaigns_after in range(1, AFTER + 1):
        trend = lb.fleet.find_trend(rows[: BEFORE + campaigns_after])
        if trend.changed:
            row["found"] = float(campaigns_after)
            row["right"] = float(trend.most_probable == PARAMETER)
            break
    for name, parameter in lb.fleet.find_trend(rows).parameters.items():
        row[f"level inside {name}"] = float(covers(parameter.level_now.interval, level[name]))
    return row


def job(kind: str, seed: int) -> dict[str, float]:
    """One row: a fleet, or a machine whose joint loosens or does not."""
    if kind == "fleet":
        return pooled(seed)
    return watched(seed, CHANGE if kind == "loosened" else 0.0)


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
    numbers: dict[str, Any] = {"pareto_k_most": float(rows["pareto k"].max())}
    for quantity in ("mean inside", "spread", "machines inside"):
        by_parameter = rows.filter(regex=f"^{quantity} C_")
        of_fleets = by_parameter.mean(axis=1)
        numbers[quantity.split()[0]] = {
            "coverage": float(of_fleets.mean()),
            "error": standard_error(of_fleets),
            "by_parameter": means_by_parameter(by_parameter),
        }
    numbers["error_ratio"] = means_by_parameter(rows.filter(regex="^error C_"))
    is_flagged = rows["not belonging"].gt(0)
    numbers["flagged_share"] = float(is_flagged.mean())
    numbers["flagged_error"] = counting_error(int(is_flagged.sum()), len(rows))
    return numbers


def standard_error(values: pd.Series) -> float:
    """Standard error of the mean."""
    return float(values.std(ddof=1) / np.sqrt(len(values)))


def means_by_parameter(columns: pd.DataFrame) -> dict[str, float]:
    """Means of columns whose names end with a parameter's."""
    return {str(name).rsplit(" ", 1)[1]: float(mean) for name, mean in columns.mean().items()}


def counting_error(hits: int, count: int) -> float:
    """Standard deviation of a share after counting, from a uniform prior: not 0 where all or none
    were hits."""
    misses = count - hits
    return float(np.sqrt((hits + 1.0) * (misses + 1.0) / ((count + 2.0) ** 2 * (count + 3.0))))


def found_when(rows: pd.DataFrame) -> dict[str, Any]:
    """How many changes were found and how soon, and how often there was an alarm without reason."""
    loosened = rows[rows["kind"] == "loosened"]
    quiet = rows[rows["kind"] == "quiet"]
    campaigns_until_found = loosened.loc[loosened["found"] > 0, "found"]
    is_inside = pd.concat([loosened, quiet]).filter(regex="^level inside C_")
    of_machines = is_inside.mean(axis=1)
    return {
        "level_inside": {
            "coverage": float(of_machines.mean()),
            "error": standard_error(of_machines),
        },
        "alarm_before": int(loosened["alarm before"].sum()),
        "median_found": float(campaigns_until_found.median()),
        "latest_found": int(campaigns_until_found.max()),
        "found_at_all": len(campaigns_until_found),
        "right_parameter": int(loosened["right"].sum()),
        "false_alarms": int((quiet["found"] > 0).sum() + quiet["alarm before"].sum()),
    }


def draw(results: dict[str, Any]) -> Mapping[str, Figure]:
    """The control chart of one loosened machine, and coverage by parameter."""
    series = months(
        SEED_OF_CHART, months_before=BEFORE, months_after=5, change=CHANGE, parameter=PARAMETER
    )
    return {
        "control_chart": lb.fleet.draw_control_chart(lb.fleet.find_trend(series.rows)),
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
    labels = {"mean": "mean of the population", "spread": "spread", "machines": "machines"}
    for k, (quantity, label) in enumerate(labels.items()):
        shares = population[quantity]["by_parameter"]
        percent = [100.0 * shares[name] for name in names]
        colour = lb.figures.PALETTE[k]
        axes.plot(places + 0.2 * (k - 1), percent, "os^"[k], color=colour, label=label)
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
