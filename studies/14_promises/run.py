"""Does a forecast keep its promise? U that is forecast for a plan, beside U that the fits of
simulated machines then state.

python studies/14_promises/run.py            # fails when a stated number is not reproduced
python studies/14_promises/run.py --write    # states anew
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import ldbb_bayes as lb
from ldbb_bayes.analysis.design.space import Space

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
sys.path.insert(0, str(HERE.parent / "12_real_machines"))
from machines import PLANS, simulate
from study import Effort, Study, replicated, run

Row = dict[str, float]

# Families of study 12 that are run in both directions in random order; seeds are others than there.
KINDS = ("mild, both ways, shuffled", "mild, both ways, shuffled, certificates")
MACHINES = 20
FIRST_SEED = 3000
# Machines that are drawn from the priors of the model: these are what the promise is about.
DRAWN = "drawn from the priors"
DRAWN_MACHINES = 100
# Forces of the pilot and of the plan, each run in both directions [N].
PILOT_FORCES_N = (36.0, 389.0, 742.0)
PLAN_FORCES_N = (36.0, 271.0, 507.0, 742.0)
DIRECTIONS = ("CW", "CCW")
# Share of the machines like the pilot that state no more than the likely U of a forecast.
PROMISED = 0.9
# What the shares of promises kept, and the medians of forecast over stated u, should keep to.
LEAST_KEPT = 0.85
MOST_KEPT = 0.95
MOST_OFF = 0.1
# U up to this factor above its goal counts as nearly met.
NEARLY = 1.05
AGAIN: dict[Effort, int] = {"quick": 1, "usual": 2}
MODEL = lb.HybridModel.default(1)
# Parameters whose goals are stated on the page one by one.
GOALS = ("C_XXX", "C_XYX", "E_C0YX")
# Goals of the campaigns that are searched: largest U, as a share of the U that the pilot gives.
SHARES_OF_PILOT = {"C_XXX": 0.9, "C_YYY": 0.9, "C_XYX": 0.8}
NM_PER_N = 1e6


def job(kind: str, seed: int) -> Row:
    """One machine: pilot, forecast of the plan, readings of the plan, and their fit."""
    family = PLANS[kind]
    pilot, _ = simulate(family, FIRST_SEED + seed, PILOT_FORCES_N)
    plan = same_plan(pilot, seed)
    campaign, _ = simulate(family, FIRST_SEED + seed, PLAN_FORCES_N, plan)
    return forecast_over_stated(plan, campaign)


def drawn_job(kind: str, seed: int) -> Row:
    """The same of one machine whose parameters and scales are drawn from the priors of the model.

    The pilot and the plan measure the same machine with the same noise. The noise factors of the
    circles and all nuisance effects are drawn anew.
    """
    like_others, _ = simulate(PLANS[KINDS[0]], FIRST_SEED, PILOT_FORCES_N)
    pilot = MODEL.simulate(like_others.plan(), seed=FIRST_SEED + seed)
    plan = same_plan(pilot.campaign, seed)
    scales = {
        name: value for name, value in pilot.hyper_um.items() if not name.startswith("lambda")
    }
    again = MODEL.simulate(
        plan, seed=2 * FIRST_SEED + seed, parameters=pilot.parameters, hyper_um=scales
    )
    return forecast_over_stated(plan, again.campaign)


def same_plan(pilot: lb.Campaign, seed: int) -> lb.Campaign:
    """Return the plan that is the same for all machines, in random order."""
    space = Space(MODEL, pilot, PLAN_FORCES_N, directions=DIRECTIONS)
    return space.plan_of(space.tests, seed=seed)


def forecast_over_stated(plan: lb.Campaign, campaign: lb.Campaign) -> Row:
    """Return forecast over stated u of every parameter, and the u of nine in ten over stated u."""
    expected = lb.analysis.forecast_plan(MODEL, plan).expected
    stated = stated_u(campaign)
    row = {}
    for name, entry in expected.items():
        row[f"{name}/forecast"] = entry.sd / stated[name]
        row[f"{name}/likely"] = entry.likely_sd / stated[name]
    return row


def stated_u(campaign: lb.Campaign) -> dict[str, float]:
    """Return the standard uncertainty of every parameter that a fit of a campaign states."""
    posterior = lb.sample(MODEL, campaign, sampler="independent", seed=1)["posterior"]
    return {name: float(posterior[name].std()) for name in MODEL.bind(campaign).names}


def searched_job(kind: str, seed: int) -> Row:
    """One machine: pilot, cheapest campaign for three goals, its readings, and their fit."""
    family = PLANS[kind]
    pilot, _ = simulate(family, FIRST_SEED + seed, PILOT_FORCES_N)
    of_pilot = stated_u(pilot)
    goals = {}
    for name, share in SHARES_OF_PILOT.items():
        goals[name] = f"{share * 2.0 * of_pilot[name] * NM_PER_N:.4g} nm/N"
    found = lb.design(MODEL, pilot, goals=goals, probability=PROMISED)
    best = found.best
    campaign, _ = simulate(family, FIRST_SEED + seed, PLAN_FORCES_N, best.plan())
    stated = stated_u(campaign)
    row = {"circles": float(best.circles), "promised": best.probability}
    for name in goals:
        limit_u = found.goals[name].limit_U / 2.0
        row[f"{name}/promised"] = best.goals[name].probability
        row[f"{name}/kept"] = float(stated[name] <= limit_u)
    row["kept"] = min(row[f"{name}/kept"] for name in goals)
    return row


def of_parameter(rows: pd.DataFrame, name: str) -> dict[str, float]:
    """Return the share of promises kept, and forecast over stated u of one parameter."""
    ratio = rows[f"{name}/forecast"]
    low, high = np.quantile(ratio, [0.05, 0.95])
    return {
        "kept": float((rows[f"{name}/likely"] >= 1.0).mean()),
        "nearly": float((NEARLY * rows[f"{name}/likely"] >= 1.0).mean()),
        "median": float(ratio.median()),
        "low": low,
        "high": high,
    }


def of_rows(rows: pd.DataFrame, names: list[str]) -> dict[str, Any]:
    """Return the numbers of every parameter, and the share of promises kept of all together."""
    parameters = {name: of_parameter(rows, name) for name in names}
    kept = {name: entry["kept"] for name, entry in parameters.items()}
    far = [name for name, entry in parameters.items() if abs(entry["median"] - 1.0) > MOST_OFF]
    return {
        "machines": len(rows),
        "kept": float(np.mean(list(kept.values()))),
        "nearly": float(np.mean([entry["nearly"] for entry in parameters.values()])),
        "se": float(np.sqrt(PROMISED * (1.0 - PROMISED) / len(rows))),
        "parameters": parameters,
        "least": min(kept, key=kept.__getitem__),
        "most": max(kept, key=kept.__getitem__),
        "far": far,
        "outside": [name for name in names if not LEAST_KEPT <= kept[name] <= MOST_KEPT],
    }


def of_searched(rows: pd.DataFrame) -> dict[str, Any]:
    """Return promised and kept shares of campaigns that were searched for three goals."""
    goals = {}
    for name, share in SHARES_OF_PILOT.items():
        goals[name] = {
            "of_pilot": share,
            "promised": float(rows[f"{name}/promised"].mean()),
            "kept": float(rows[f"{name}/kept"].mean()),
        }
    return {
        "machines": len(rows),
        "circles": {name: float(getattr(rows["circles"], name)()) for name in ("min", "max")},
        "promised": float(rows["promised"].mean()),
        "kept": float(rows["kept"].mean()),
        "goals": goals,
    }


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the page states."""
    kinds = dict.fromkeys(KINDS, MACHINES)
    rows = replicated(HERE / "machines.csv", job, kinds, effort, again=AGAIN)
    drawn = replicated(HERE / "drawn.csv", drawn_job, {DRAWN: DRAWN_MACHINES}, effort, again=AGAIN)
    searched = replicated(HERE / "searched.csv", searched_job, kinds, effort, again=AGAIN)
    ending = "/likely"
    names = [column.removesuffix(ending) for column in rows.columns if column.endswith(ending)]
    return {
        "machines": MACHINES,
        "circles": {
            "pilot": len(DIRECTIONS) * len(PILOT_FORCES_N),
            "plan": len(DIRECTIONS) * len(PLAN_FORCES_N),
        },
        "promised": PROMISED,
        "must": {"least": LEAST_KEPT, "most": MOST_KEPT, "off": MOST_OFF, "nearly": NEARLY - 1.0},
        "goals": list(GOALS),
        "pooled": of_rows(rows, names),
        "families": {kind: of_rows(rows[rows["kind"] == kind], names) for kind in KINDS},
        "drawn": of_rows(drawn, names),
        "searched": of_searched(searched),
    }


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    run(Study(HERE, measure))


if __name__ == "__main__":
    main()
