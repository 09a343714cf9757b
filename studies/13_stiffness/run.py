"""Does the machine stand where sheet 1 puts it? Stiffness by direction, and the deviation of the
path, of exactly simulated machines.

python studies/13_stiffness/run.py            # fails when a stated number is not reproduced
python studies/13_stiffness/run.py --write    # states anew
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

import ldbb_bayes as lb

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
sys.path.insert(0, str(HERE.parent / "12_real_machines"))
from drives import added_by_drives_mm
from machines import (
    FAMILIES,
    FORCES_N,
    MIDDLE_N,
    NEW,
    STATED,
    Machine,
    deflection_mm,
    simulate,
    trace_mm,
)
from study import Effort, Study, kept, replicated, run

Array = NDArray[np.float64]
Row = dict[str, float]

# Campaigns of each family of study 12, none of which study 12 itself is about.
CAMPAIGNS = 30
CAMPAIGNS_OF_AVERAGE = 10
FIRST_SEED = 1000
AGAIN: dict[Effort, int] = {"quick": 1, "usual": 2}
# The family whose drives add to the path what looks like geometric errors, and its campaigns.
WITH_DRIVES = "drives, drift, well planned"
CAMPAIGNS_WITH_DRIVES = 20
# Families of which one averaged campaign is made again: an average takes five times as long.
AVERAGED_AGAIN = ("mild", "contact")
KINDS = FAMILIES | NEW | STATED
LINEAR = lb.HybridModel.default(1)
MODELS = {"constant": LINEAR.with_degree(0), "linear": LINEAR}
# Forces at which the stiffness is stated: the smallest, the reference force and the largest [N].
STATED_AT_N = (FORCES_N[0], MIDDLE_N, FORCES_N[-1])
# Angles at which the exact machine is evaluated.
ANGLE = np.linspace(0.0, 2.0 * np.pi, 1440, endpoint=False)
# A force that stands for none: the laws of seats have a limit at zero, but no value [N].
NO_FORCE_N = 1e-6
# What must hold: the share of intervals that hold the truth, and the share of U that G may be
# biased by.
LEAST_COVERAGE = 0.93
MOST_BIAS_OF_G = 0.1
LEVELS = np.array([0.025, 0.975])
STIFFNESSES = ("k_min", "k_max", "k_ratio")
DIRECTIONS = ("softest direction", "stiffest direction", "principal axis")
CROSS = "C_XYX"
DIFFERENCE = "C_XXX − C_YYY"
BY_DIRECTION = (*STIFFNESSES, *DIRECTIONS, CROSS, DIFFERENCE)
# Further numbers of sheet 1, all at the reference force except the deviation without load.
AXES = ("1 / C_XXX", "1 / C_YYY")
COMPLIANCES = ("C_CXY", "C_CYY", "C_CCY", "E_C0YX")
PATH = ("G", "F_max", "F_min", "G without load")
FURTHER = (*AXES, *COMPLIANCES, *PATH)


def job(kind: str, seed: int) -> Row:
    """One campaign by the model whose compliances are linear in force."""
    campaign, machine = simulate(KINDS[kind], FIRST_SEED + seed)
    posterior = lb.sample(LINEAR, campaign, sampler="independent", seed=seed)
    return judged_campaign(posterior, machine)


def job_of_average(kind: str, seed: int) -> Row:
    """The same campaign averaged over constant and linear compliance, as sheets are by default."""
    campaign, machine = simulate(KINDS[kind], FIRST_SEED + seed)
    posterior = lb.average(MODELS, campaign, seed=seed)
    return judged_campaign(posterior, machine)


def judged_campaign(posterior: xr.DataTree, machine: Machine) -> Row:
    """Error, U and coverage of every number of sheet 1, and whether it is determined."""
    row: Row = {}
    stated = lb.stiffness(posterior, STATED_AT_N)
    for plane in stated.planes:
        true = true_stiffness(machine, plane.force_N)
        table = lb.analysis.DirectionalStiffness(stated.prob, (plane,)).table()
        for entry in table.to_dict(orient="records"):
            name = f"{entry['quantity']} at {plane.force_N:.0f} N"
            row |= judged_stiffness(name, entry, true[entry["quantity"]])
    row |= judged_parameters(posterior, machine)
    row |= judged_path(posterior, machine)
    return {name: float(value) for name, value in row.items()}


def true_stiffness(machine: Machine, force_N: float) -> dict[str, float]:
    """Stiffness by direction of the exact machine, each axis in the middle of its travel."""
    in_the_middle = replace(machine, travel=((0.0, 0.0), (0.0, 0.0)))
    dx, dy = deflection_mm(in_the_middle, force_N, force_N, ANGLE)
    compliance = (dx * np.cos(ANGLE) + dy * np.sin(ANGLE)) / force_N
    softest_deg = float(np.degrees(ANGLE[compliance.argmax()]))
    stiffest_deg = float(np.degrees(ANGLE[compliance.argmin()]))
    cross = machine.compliance[CROSS] + machine.slope[CROSS] * (force_N - MIDDLE_N)
    difference = machine.secant("C_XXX", force_N) - machine.secant("C_YYY", force_N)
    principal_axis_deg = float(np.degrees(0.5 * np.arctan2(cross, difference)))
    return {
        "k_min": 1.0 / compliance.max(),
        "k_max": 1.0 / compliance.min(),
        "k_ratio": compliance.max() / compliance.min(),
        "softest direction": softest_deg,
        "stiffest direction": stiffest_deg,
        "principal axis": principal_axis_deg,
        CROSS: cross,
        DIFFERENCE: difference,
    }


def judged_stiffness(name: str, entry: dict[str, Any], truth: float) -> Row:
    """One number by direction; directions that differ by half a turn are the same, and a stiffness
    without upper limit holds all that is stiffer."""
    low = entry["ci_low"]
    high = entry["ci_high"]
    estimate = entry["median"]
    if entry["unit"] == "deg":
        error = (estimate - truth + 90.0) % 180.0 - 90.0
        covered = low - estimate <= -error <= high - estimate
    else:
        error = estimate - truth
        if not entry["is_determined"]:
            high = np.inf
        covered = low <= truth <= high
    row = judged(name, error, entry["U_k2"], covered=covered)
    return row | {f"{name}/determined": bool(entry["is_determined"])}


def judged(name: str, error: float, expanded: float, *, covered: bool) -> Row:
    """Error, U and coverage of one number, by name of the column."""
    return {f"{name}/error": error, f"{name}/U": expanded, f"{name}/covered": covered}


def judged_parameters(posterior: xr.DataTree, machine: Machine) -> Row:
    """Stiffnesses of the axes, and the parameters of sheet 1, at the reference force."""
    row: Row = {}
    for name in (*AXES, *COMPLIANCES):
        label = name.removeprefix("1 / ")
        draws = np.ravel(posterior["posterior"][label].values)
        truth = machine.truth[label]
        if label.startswith(("C_XXX", "C_YYY")):
            truth = machine.secant(label, MIDDLE_N)
        low, high = np.quantile(draws, LEVELS)
        error = draws.mean() - truth
        expanded = 2.0 * draws.std()
        if name in AXES:
            median = np.median(draws)
            error = 1.0 / median - 1.0 / truth
            expanded = 2.0 * np.std(1.0 / np.maximum(draws, 0.1 * median))
        row |= judged(name, float(error), float(expanded), covered=bool(low <= truth <= high))
    return row


def job_with_drives(kind: str, seed: int) -> Row:
    """Deviations of the path of one campaign, judged by the path of geometry and springs, and by
    the path that also has what the drives add of the orders of geometric errors."""
    campaign, machine = simulate(KINDS[kind], FIRST_SEED + seed)
    posterior = lb.sample(LINEAR, campaign, sampler="independent", seed=seed)
    added_mm = added_by_drives_mm(KINDS[kind], FIRST_SEED + seed, ANGLE)
    row = judged_path(posterior, machine)
    judged_with = judged_path(posterior, machine, added_mm)
    row |= {f"with drives/{name}": value for name, value in judged_with.items()}
    return {name: float(value) for name, value in row.items()}


def judged_path(posterior: xr.DataTree, machine: Machine, added_mm: Array | float = 0.0) -> Row:
    """Circular and radial deviations at the reference force, and the circular one without load.

    ``added_mm``: what the true path has beside geometry and springs, shape (angles,).
    """
    table = lb.analysis.predict_circularity(posterior, [0.0, MIDDLE_N])
    row: Row = {}
    for name in PATH:
        force_N = 0.0 if name == "G without load" else MIDDLE_N
        quantity = name.partition(" ")[0]
        is_row = (table["quantity"] == quantity) & (table["force_N"] == force_N)
        entry = table[is_row].iloc[0]
        truth = true_path(machine, force_N, added_mm)[quantity]
        covered = bool(entry["ci_low"] <= truth <= entry["ci_high"])
        row |= judged(name, entry["mean"] - truth, 2.0 * entry["sd"], covered=covered)
    return row


def true_path(machine: Machine, force_N: float, added_mm: Array | float = 0.0) -> dict[str, float]:
    """Deviations of the exact path about its least-squares circle [µm]."""
    trace = trace_mm(machine, force_N or NO_FORCE_N, ANGLE) + added_mm
    circle = np.column_stack([np.ones_like(ANGLE), np.cos(ANGLE), np.sin(ANGLE)])
    coefficients = np.linalg.lstsq(circle, trace)[0]
    deviation_um = 1e3 * (trace - circle @ coefficients)
    return {"G": np.ptp(deviation_um), "F_max": deviation_um.max(), "F_min": deviation_um.min()}


def names_at(force_N: float) -> list[str]:
    """Columns of all numbers by direction at one force."""
    return [f"{name} at {force_N:.0f} N" for name in BY_DIRECTION]


def names_by_direction() -> list[str]:
    """Columns of all numbers by direction, at every force at which they are stated."""
    names = []
    for force_N in STATED_AT_N:
        names += names_at(force_N)
    return names


def of_number(rows: pd.DataFrame, name: str) -> dict[str, float]:
    """Coverage of the interval and of ± U, and bias in U, over campaigns that determine the
    number."""
    determined = np.ones(len(rows), dtype=bool)
    if f"{name}/determined" in rows:
        determined = rows[f"{name}/determined"].to_numpy() > 0
    error = rows[f"{name}/error"][determined]
    expanded = rows[f"{name}/U"][determined]
    covered = rows[f"{name}/covered"]
    # A stiffness with a lower limit alone states this limit; a direction that is not determined
    # states nothing.
    if name.startswith(DIRECTIONS):
        covered = covered[determined]
    return {
        "stated": len(covered),
        "held": int(covered.sum()),
        "determined": float(determined.mean()),
        "coverage": float(covered.mean()),
        "within_U": float((error.abs() <= expanded).mean()),
        "bias": float(error.mean() / expanded.mean()),
    }


def averaged_campaigns(effort: Effort) -> pd.DataFrame:
    """Campaigns averaged over models, one row each; two of them are made again."""
    path = HERE / "averaged.csv"
    kinds = dict.fromkeys(KINDS, CAMPAIGNS_OF_AVERAGE)
    if effort == "write":
        return replicated(path, job_of_average, kinds, effort, again={})
    rows = [{"kind": kind, "seed": 0, **job_of_average(kind, 0)} for kind in AVERAGED_AGAIN]
    return kept(path, pd.DataFrame(rows), kinds, effort)


def path_with_drives(effort: Effort) -> dict[str, Any]:
    """Coverage and bias of the path's deviations, without and with what the drives add."""
    kinds = {WITH_DRIVES: CAMPAIGNS_WITH_DRIVES}
    rows = replicated(HERE / "with_drives.csv", job_with_drives, kinds, effort, again=AGAIN)
    numbers = {}
    for name in PATH:
        numbers[name] = {
            "without": of_number(rows, name),
            "with": of_number(rows, f"with drives/{name}"),
        }
    return {"family": WITH_DRIVES, "campaigns": len(rows), "numbers": numbers}


def falls_short(families: dict[str, Any]) -> list[dict[str, Any]]:
    """Numbers at the reference force whose intervals hold the truth too seldom, by family."""
    short = []
    for kind, numbers in families.items():
        for name in (*names_at(MIDDLE_N), *FURTHER):
            coverage = numbers[name]["coverage"]
            if coverage < LEAST_COVERAGE:
                short.append({"family": kind, "number": name, "coverage": coverage})
    return short


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the page states."""
    kinds = dict.fromkeys(KINDS, CAMPAIGNS)
    rows = replicated(HERE / "campaigns.csv", job, kinds, effort, again=AGAIN)
    averaged = averaged_campaigns(effort)
    numbers = [*names_by_direction(), *FURTHER]
    pooled = {name: of_number(rows, name) for name in numbers}
    families = {}
    for kind in kinds:
        of_kind = rows[rows["kind"] == kind]
        families[kind] = {name: of_number(of_kind, name) for name in numbers}
    return {
        "campaigns": CAMPAIGNS,
        "total": len(rows),
        "forces_N": [f"{force_N:.0f}" for force_N in STATED_AT_N],
        "by_direction": list(BY_DIRECTION),
        "further": list(FURTHER),
        "must": {"coverage": LEAST_COVERAGE, "bias": MOST_BIAS_OF_G},
        "se": float(np.sqrt(0.95 * 0.05 / CAMPAIGNS)),
        "reference_N": f"{MIDDLE_N:.0f}",
        "pooled": pooled,
        "averaged": {name: of_number(averaged, name) for name in numbers},
        "averaged_total": len(averaged),
        "averaged_campaigns": CAMPAIGNS_OF_AVERAGE,
        "falls_short": falls_short(families),
        "with_drives": path_with_drives(effort),
        "families": families,
    }


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    run(Study(HERE, measure))


if __name__ == "__main__":
    main()
