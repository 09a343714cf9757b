"""Does a forecast keep its promise? U that is forecast for a plan, beside U that the fits of
exactly simulated machines then state.

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
AGAIN: dict[Effort, int] = {"quick": 1, "usual": 2}
MODEL = lb.HybridModel.default(1)
# Parameters whose goals are stated on the page one by one.
GOALS = ("C_XXX", "C_XYX", "E_C0YX")


def job(kind: str, seed: int) -> Row:
    """One machine: pilot, forecast of the plan, readings of the plan, and their fit."""
    family = PLANS[kind]
    pilot, _ = simulate(family, FIRST_SEED + seed, PILOT_FORCES_N)
    space = Space(MODEL, pilot, PLAN_FORCES_N, directions=DIRECTIONS)
    plan = space.plan_of(space.tests, seed=seed)
    expected = lb.analysis.forecast_plan(MODEL, plan).expected
    campaign, _ = simulate(family, FIRST_SEED + seed, PLAN_FORCES_N, plan)
    posterior = lb.sample(MODEL, campaign, sampler="independent", seed=1)["posterior"]
    row = {}
    for name, entry in expected.items():
        u = float(posterior[name].std())
        row[f"{name}/forecast"] = entry.sd / u
        row[f"{name}/likely"] = entry.likely_sd / u
    return row


def of_parameter(rows: pd.DataFrame, name: str) -> dict[str, float]:
    """Return the share of promises kept, and forecast over stated u of one parameter."""
    ratio = rows[f"{name}/forecast"]
    low, high = np.quantile(ratio, [0.05, 0.95])
    return {
        "kept": float((rows[f"{name}/likely"] >= 1.0).mean()),
        "median": float(ratio.median()),
        "low": low,
        "high": high,
    }


def of_rows(rows: pd.DataFrame, names: list[str]) -> dict[str, Any]:
    """Return the numbers of every parameter, and the share of promises kept of all together."""
    parameters = {name: of_parameter(rows, name) for name in names}
    return {
        "machines": len(rows),
        "kept": float(np.mean([entry["kept"] for entry in parameters.values()])),
        "parameters": parameters,
    }


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the page states."""
    rows = replicated(
        HERE / "machines.csv", job, dict.fromkeys(KINDS, MACHINES), effort, again=AGAIN
    )
    ending = "/likely"
    names = [column.removesuffix(ending) for column in rows.columns if column.endswith(ending)]
    pooled = of_rows(rows, names)
    parameters = pooled["parameters"]
    far = []
    for name, entry in parameters.items():
        if abs(entry["median"] - 1.0) > MOST_OFF:
            far.append(name)
    outside = []
    for name, entry in parameters.items():
        if not LEAST_KEPT <= entry["kept"] <= MOST_KEPT:
            outside.append(name)
    return {
        "machines": MACHINES,
        "least": min(parameters, key=lambda name: parameters[name]["kept"]),
        "circles": {
            "pilot": len(DIRECTIONS) * len(PILOT_FORCES_N),
            "plan": len(DIRECTIONS) * len(PLAN_FORCES_N),
        },
        "promised": PROMISED,
        "must": {"least": LEAST_KEPT, "most": MOST_KEPT, "off": MOST_OFF},
        "se": float(np.sqrt(PROMISED * (1.0 - PROMISED) / len(rows))),
        "goals": list(GOALS),
        "pooled": pooled,
        "families": {kind: of_rows(rows[rows["kind"] == kind], names) for kind in KINDS},
        "far": far,
        "outside": outside,
    }


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    run(Study(HERE, measure))


if __name__ == "__main__":
    main()
