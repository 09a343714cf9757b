"""Does a forecast keep its promise? U that is forecast for a plan, beside U that the fits of
simulated machines then state.

python studies/14_promises/run.py            # fails when a stated number is not reproduced
python studies/14_promises/run.py --write    # states anew
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import ldbb_bayes as lb
from ldbb_bayes.analysis.design.averaged_forecast import averaged_uncertainties
from ldbb_bayes.analysis.design.present_estimates import present_estimates
from ldbb_bayes.analysis.design.simulated_analyses import simulate_analyses
from ldbb_bayes.analysis.design.space import Space
from ldbb_bayes.analysis.rival_explanations import subsets
from ldbb_bayes.inference.evidence import probabilities
from ldbb_bayes.inference.evidences import Evidences

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
sys.path.insert(0, str(HERE.parent / "12_real_machines"))
import machines
from study import Effort, Study, replicated, run

Row = dict[str, float]

# Every family of study 12, measured in both directions and in random order.
FAMILIES = {**machines.FAMILIES, **machines.NEW, **machines.STATED}
# Size of what differs from circle to circle, in that of the published experiment and of study 12.
SCATTER = (0.5, 4.0)
# Machines that differ in their effects and in how much their circles scatter.
DIFFERENT = "machines of all families"
# Machines that resemble each other: the mild ones of study 12, whose circles scatter alike.
MILD = "mild, both ways, shuffled"
# Machines that are drawn from the priors of the model: these are what the promise is about.
DRAWN = "drawn from the priors"
MACHINES = {DIFFERENT: 120, MILD: 40, DRAWN: 100}
SEARCHED_MACHINES = {DIFFERENT: 240, MILD: 20}
AVERAGED_MACHINES = {DIFFERENT: 60, DRAWN: 60}
# Other seeds than those of study 12.
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
# U up to this factor above its goal counts as nearly met.
NEARLY = 1.05
AGAIN: dict[Effort, int] = {"quick": 1, "usual": 2}
MODEL = lb.HybridModel.default(1)
CONSTANT = MODEL.with_degree(0)
# Numerical error of the log evidence with which the posterior of a fit is computed [nat].
TOLERANCE = 0.05
# The same for every model of an average.
TOLERANCE_OF_AVERAGE = 0.1
# Parameters whose goals are stated on the page one by one.
GOALS = ("C_XXX", "C_XYX", "E_C0YX")
# Goals of the campaigns that are searched: largest U, as a share of the U that the pilot gives.
SHARES_OF_PILOT = {"C_XXX": 0.9, "C_YYY": 0.9, "C_XYX": 0.8}
NM_PER_N = 1e6


def job(kind: str, seed: int) -> Row:
    """One machine: pilot, forecast of the plan, readings of the plan, and their fit."""
    return forecast_over_stated(*plan_and_readings(kind, seed))


def averaged_job(kind: str, seed: int) -> Row:
    """The same, with U averaged over constant and linear compliance: forecast, and by `average`.

    Also U of linear compliance that is forecast, over the averaged U that is stated.
    """
    plan, campaign = plan_and_readings(kind, seed)
    analyses = simulate_analyses(MODEL, plan)
    linear = lb.analysis.forecast_plan(MODEL, plan, analyses=analyses).expected
    stated = stated_averaged_u(campaign)
    row = {}
    for name, entry in averaged_uncertainties(analyses).items():
        row[f"{name}/forecast"] = entry.sd / stated[name]
        row[f"{name}/likely"] = entry.likely_sd / stated[name]
        row[f"{name}/linear"] = linear[name].sd / stated[name]
    return row


def plan_and_readings(kind: str, seed: int) -> tuple[lb.Campaign, lb.Campaign]:
    """Return the plan that follows the pilot of one machine, and its readings on this machine."""
    if kind == DRAWN:
        return plan_and_readings_of_drawn(seed)
    family = family_of(kind, seed)
    pilot, _ = machines.simulate(family, FIRST_SEED + seed, PILOT_FORCES_N)
    plan = same_plan(pilot, seed)
    campaign, _ = machines.simulate(family, FIRST_SEED + seed, PLAN_FORCES_N, plan)
    return plan, campaign


def family_of(kind: str, seed: int) -> machines.Disturbances:
    """Return what acts on a machine; ``DIFFERENT`` goes through the families of study 12 in turn.

    Its circles scatter by an amount of the machine's own and, among themselves, unequally.
    """
    if kind == MILD:
        return machines.PLANS[MILD]
    family = list(FAMILIES.values())[seed % len(FAMILIES)]
    return replace(family, both_ways=True, shuffled=True, scatter=SCATTER, uneven=True)


def plan_and_readings_of_drawn(seed: int) -> tuple[lb.Campaign, lb.Campaign]:
    """The same of one machine whose parameters and scales are drawn from the priors of the model.

    The pilot and the plan measure the same machine with the same noise. The noise factors of the
    circles and all nuisance effects are drawn anew.
    """
    like_others, _ = machines.simulate(machines.PLANS[MILD], FIRST_SEED, PILOT_FORCES_N)
    pilot = MODEL.simulate(like_others.plan(), seed=FIRST_SEED + seed)
    plan = same_plan(pilot.campaign, seed)
    scales_um = {
        name: value for name, value in pilot.hyper_um.items() if not name.startswith("lambda")
    }
    planned = MODEL.simulate(
        plan, seed=2 * FIRST_SEED + seed, parameters=pilot.parameters, hyper_um=scales_um
    )
    return plan, planned.campaign


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
    """Return the standard uncertainty of every parameter that a fit of a campaign states.

    It is computed by quadrature over the hyper-parameters, without the scatter of random draws.
    """
    nodes = Evidences(campaign, tolerance=TOLERANCE).nodes(MODEL)[0]
    return dict(zip(nodes.bound.names, present_estimates(nodes).sd.tolist(), strict=True))


def stated_averaged_u(campaign: lb.Campaign) -> dict[str, float]:
    """Return the standard uncertainties of the average over constant and linear compliance.

    The average is over all models that `average` weighs; it is computed by quadrature, without the
    scatter of random draws.
    """
    models = []
    for model in (MODEL, CONSTANT):
        models += [model.with_rivals(*rivals) for rivals in subsets(MODEL.rivals)]
    all_nodes = Evidences(campaign, tolerance=TOLERANCE_OF_AVERAGE).nodes(*models)
    probability = probabilities(np.array([nodes.evidence.log_value for nodes in all_nodes]))
    names = all_nodes[0].bound.names
    means = np.zeros((len(models), len(names)))
    variances = np.zeros_like(means)
    for k, nodes in enumerate(all_nodes):
        columns = [names.index(name) for name in nodes.bound.names]
        estimates = present_estimates(nodes)
        means[k, columns] = estimates.mean
        variances[k, columns] = estimates.sd**2
    between_models = (means - probability @ means) ** 2
    averaged_u = np.sqrt(probability @ (variances + between_models))
    return dict(zip(names, averaged_u.tolist(), strict=True))


def searched_job(kind: str, seed: int) -> Row:
    """One machine: pilot, cheapest campaign for three goals, its readings, and their fit.

    Also forecast over stated u of every parameter. All numbers are zero where the goals are out of
    reach.
    """
    family = family_of(kind, seed)
    pilot, _ = machines.simulate(family, FIRST_SEED + seed, PILOT_FORCES_N)
    of_pilot = stated_u(pilot)
    goals = {}
    for name, share in SHARES_OF_PILOT.items():
        goals[name] = f"{share * 2.0 * of_pilot[name] * NM_PER_N:.4g} nm/N"
    design = lb.design(MODEL, pilot, goals=goals, probability=PROMISED)
    row = row_of_zeros(list(of_pilot))
    if not design.all_reached:
        return row
    best = design.best
    campaign, _ = machines.simulate(family, FIRST_SEED + seed, PLAN_FORCES_N, best.plan())
    stated = stated_u(campaign)
    row["found"] = 1.0
    row["circles"] = float(best.circles)
    row["promised"] = best.probability
    row["kept"] = 1.0
    for name in goals:
        is_kept = float(stated[name] <= design.goals[name].limit_U / 2.0)
        row[f"{name}/promised"] = best.goals[name].probability
        row[f"{name}/kept"] = is_kept
        row["kept"] = min(row["kept"], is_kept)
    for name, entry in best.expected.items():
        row[f"{name}/forecast"] = entry.sd / stated[name]
    return row


def row_of_zeros(parameters: list[str]) -> Row:
    """Return the row of a machine on which no campaign reaches the goals."""
    row = dict.fromkeys(("found", "circles", "promised", "kept"), 0.0)
    for name in SHARES_OF_PILOT:
        row[f"{name}/promised"] = 0.0
        row[f"{name}/kept"] = 0.0
    for name in parameters:
        row[f"{name}/forecast"] = 0.0
    return row


def of_parameter(rows: pd.DataFrame, name: str) -> dict[str, float]:
    """Return the share of promises kept, and forecast over stated u of one parameter."""
    ratio = rows[f"{name}/forecast"]
    likely_ratio = rows[f"{name}/likely"]
    low, high = np.quantile(ratio, [0.05, 0.95])
    return {
        "kept": float((likely_ratio >= 1.0).mean()),
        "nearly": float((NEARLY * likely_ratio >= 1.0).mean()),
        "median": float(ratio.median()),
        "low": low,
        "high": high,
    }


def of_rows(rows: pd.DataFrame, names: list[str]) -> dict[str, Any]:
    """Return the numbers of every parameter, and the share of promises kept of all together."""
    parameters = {name: of_parameter(rows, name) for name in names}
    share_kept = {name: entry["kept"] for name, entry in parameters.items()}
    share_nearly_kept = [entry["nearly"] for entry in parameters.values()]
    medians = {name: entry["median"] for name, entry in parameters.items()}
    return {
        "machines": len(rows),
        "kept": float(np.mean(list(share_kept.values()))),
        "nearly": float(np.mean(share_nearly_kept)),
        "se": float(np.sqrt(PROMISED * (1.0 - PROMISED) / len(rows))),
        "parameters": parameters,
        "least": min(share_kept, key=share_kept.__getitem__),
        "most": max(share_kept, key=share_kept.__getitem__),
        "far": far_from_one(medians),
        "outside": [name for name in names if not LEAST_KEPT <= share_kept[name] <= MOST_KEPT],
    }


def far_from_one(medians: dict[str, float]) -> list[str]:
    """Return the parameters whose median of forecast over stated u is too far from one."""
    return [name for name, median in medians.items() if abs(median - 1.0) > MOST_OFF]


def of_searched(rows: pd.DataFrame) -> dict[str, Any]:
    """Return promised and kept shares of campaigns that were searched for three goals."""
    in_reach = rows[rows["found"] == 1.0]
    goals = {}
    for name, share in SHARES_OF_PILOT.items():
        goals[name] = {
            "of_pilot": share,
            "promised": float(in_reach[f"{name}/promised"].mean()),
            "kept": float(in_reach[f"{name}/kept"].mean()),
        }
    medians = {}
    for name in parameters_with(in_reach, "/forecast"):
        medians[name] = float(in_reach[f"{name}/forecast"].median())
    return {
        "machines": len(rows),
        "medians": medians,
        "far": far_from_one(medians),
        "found": len(in_reach),
        "circles": {
            "min": float(in_reach["circles"].min()),
            "max": float(in_reach["circles"].max()),
        },
        "promised": float(in_reach["promised"].mean()),
        "kept": float(in_reach["kept"].mean()),
        "goals": goals,
    }


def of_averaged(rows: pd.DataFrame) -> dict[str, Any]:
    """Return the numbers of every parameter whose averaged U is forecast."""
    numbers = of_rows(rows, parameters_with(rows, "/likely"))
    for name, entry in numbers["parameters"].items():
        entry["linear"] = float(rows[f"{name}/linear"].median())
    return numbers


def parameters_with(rows: pd.DataFrame, ending: str) -> list[str]:
    """Return the parameters of the columns that end so."""
    return [column.removesuffix(ending) for column in rows.columns if column.endswith(ending)]


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the page states."""
    rows = replicated(HERE / "machines.csv", job, MACHINES, effort, again=AGAIN)
    searched = replicated(
        HERE / "searched.csv", searched_job, SEARCHED_MACHINES, effort, again=AGAIN
    )
    averaged = replicated(
        HERE / "averaged.csv", averaged_job, AVERAGED_MACHINES, effort, again=AGAIN
    )
    names = parameters_with(rows, "/likely")
    different = rows[rows["kind"] == DIFFERENT]
    kept_by_family = {}
    for k, family in enumerate(FAMILIES):
        of_family = different[different["seed"] % len(FAMILIES) == k]
        kept_by_family[family] = of_rows(of_family, names)["kept"]
    return {
        "circles": {
            "pilot": len(DIRECTIONS) * len(PILOT_FORCES_N),
            "plan": len(DIRECTIONS) * len(PLAN_FORCES_N),
        },
        "promised": PROMISED,
        "must": {"least": LEAST_KEPT, "most": MOST_KEPT, "off": MOST_OFF, "nearly": NEARLY - 1.0},
        "goals": list(GOALS),
        "families": {"number": len(FAMILIES), "kept": kept_by_family},
        "scatter": {"least": SCATTER[0], "most": SCATTER[1]},
        "different": of_rows(different, names),
        "mild": of_rows(rows[rows["kind"] == MILD], names),
        "drawn": of_rows(rows[rows["kind"] == DRAWN], names),
        "averaged": of_averaged(averaged[averaged["kind"] == DIFFERENT]),
        "averaged_drawn": of_averaged(averaged[averaged["kind"] == DRAWN]),
        "searched": of_searched(searched[searched["kind"] == DIFFERENT]),
        "searched_mild": of_searched(searched[searched["kind"] == MILD]),
    }


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    run(Study(HERE, measure))


if __name__ == "__main__":
    main()
