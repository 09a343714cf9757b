"""What form error of the balls does to the published geometric errors and C_CCY, and what clocking
both balls would have changed.

python studies/03_confounding/run.py            # fails when a stated number is not reproduced
python studies/03_confounding/run.py --write    # states anew
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import ldbb_bayes as lb

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
sys.path.insert(0, str(HERE))
from figures import confounding
from study import DATA, Effort, Study, run

# Parameters that the page shows: factor from the inside unit to the unit for reading.
SHOWN = {
    "E_XX1": (1e6, "µm/m"),
    "E_YY1": (1e6, "µm/m"),
    "E_YX2": (1e9, "µm/m²"),
    "E_XY2": (1e9, "µm/m²"),
    "E_C0YX": (1e6, "µrad"),
    "C_CCY": (1e9, "µrad/(N m)"),
}
NAMES = tuple(SHOWN)
SHOWN_COMPLIANCES = {
    "C_XXX": (1e6, "nm/N"),
    "C_XYX": (1e6, "nm/N"),
    "C_YYY": (1e6, "nm/N"),
    "C_CXY": (1e9, "nrad/N"),
    "C_CYY": (1e9, "nrad/N"),
}
# Place of cos 4θ in `basis`.
COS_4 = 7
CONSTANT = lb.HybridModel.first(degree=0)
FREE = CONSTANT.without("truncation")
CALIBRATED_UM = 0.5
CLOCKINGS_DEG = (0.0, 45.0, 90.0)
# What the default model, the third edition, foretells of the same circles.
THIRD = lb.HybridModel.default(degree=0)
GRADE = "G10"
RECOVERED = HERE.parent / "02_recovered_experiment" / "results.json"
FROM_DIGITS = HERE.parent / "04_constant_or_linear" / "results.json"
# Synthetic form of orders 5 to 12, as a multiple of that in the recovered experiment.
SYNTHETIC = (0.5, 1.0, 2.0, 4.0)
# Section 5: by CMM measurement, the form errors of the spheres "may contribute at most 30 µm".
PAPERS_FORM_UM = 30
HALF_NORMAL_MEDIAN = 0.6745


def turned(plan: lb.Campaign, *, work: bool, tool: bool) -> lb.Campaign:
    """The same circles, the balls turned from circle to circle."""
    tests = []
    for i, test in enumerate(plan.tests):
        angle_deg = CLOCKINGS_DEG[i % len(CLOCKINGS_DEG)]
        work_deg = angle_deg if work else 0.0
        tool_deg = angle_deg if tool else 0.0
        tests.append(replace(test, work_ball_deg=work_deg, tool_ball_deg=tool_deg))
    return replace(plan, tests=tuple(tests))


def both_ways(plan: lb.Campaign) -> lb.Campaign:
    """The same circles, by turns clockwise and counterclockwise."""
    tests = [replace(test, direction="CCW" if i % 2 else "CW") for i, test in enumerate(plan.tests)]
    return replace(plan, tests=tuple(tests))


def graded(plan: lb.Campaign) -> lb.Campaign:
    """The same circles, with balls of a stated grade."""
    ball = lb.Ball(grade=GRADE)
    return replace(plan, instrument=replace(plan.instrument, work=ball, tool=ball))


def calibrated(model: lb.HybridModel) -> lb.HybridModel:
    """The model with a bar length known well."""
    terms = []
    for term in model.nuisances:
        if type(term).__name__ == "BarLength":
            terms.append(replace(term, sd_um=CALIBRATED_UM))
        else:
            terms.append(term)
    return replace(model, nuisances=tuple(terms))


def foretold(model: lb.HybridModel, plan: lb.Campaign) -> dict[str, dict[str, Any]]:
    """Expected sd [unit for reading] and verdict of the shown parameters."""
    parameters = lb.identify(model, plan).parameters
    rows = {}
    for name in NAMES:
        factor, _ = SHOWN[name]
        rows[name] = {
            "sd": parameters[name].sd * factor,
            "verdict": parameters[name].verdict,
        }
    return rows


def foretold_by_plan(plan: lb.Campaign) -> dict[str, Any]:
    """What other plans of the same circles would have known, by the first edition."""
    both_turned = turned(plan, work=True, tool=True)
    well_known_length = calibrated(CONSTANT)
    return {
        "as run": foretold(CONSTANT, plan),
        "length calibrated to 0.5 µm": foretold(well_known_length, plan),
        "both balls at 0, 45, 90° in turn": foretold(CONSTANT, both_turned),
        "work ball alone": foretold(CONSTANT, turned(plan, work=True, tool=False)),
        "both balls, length calibrated": foretold(well_known_length, both_turned),
    }


def foretold_by_plan_of_third_edition(plan: lb.Campaign) -> dict[str, Any]:
    """What other plans of the same circles would have known, by the third edition."""
    both_directions = both_ways(plan)
    return {
        "as run": foretold(THIRD, plan),
        "both balls turned": foretold(THIRD, turned(plan, work=True, tool=True)),
        "both directions": foretold(THIRD, both_directions),
        "both, balls turned": foretold(THIRD, turned(both_directions, work=True, tool=True)),
        f"both, balls of grade {GRADE}": foretold(THIRD, graded(both_directions)),
    }


def published() -> dict[str, float]:
    """Tables 5 and 6."""
    tables = DATA / "published_tables"
    row = {
        **pd.read_csv(tables / "table_5_global_compliances.csv").iloc[0],
        **pd.read_csv(tables / "table_6_global_geometric_errors.csv").iloc[0],
    }
    names = (*NAMES, *SHOWN_COMPLIANCES)
    return {name: float(row[name.replace("E_C0YX", "E_C(0Y)X")]) for name in names}


def basis(test: lb.CircularTest) -> np.ndarray:
    """Orders 0 to 3 and cos 4θ, what the tables know of a circle, shape (n, 8)."""
    angle_rad = np.deg2rad(np.asarray(test.angle_deg))
    columns = [np.ones_like(angle_rad)]
    for order in (1, 2, 3):
        columns += [np.cos(order * angle_rad), np.sin(order * angle_rad)]
    return np.column_stack([*columns, np.cos(4.0 * angle_rad)])


def harmonics_um(campaign: lb.Campaign) -> np.ndarray:
    """Of every circle, shape (tests, 8) [µm]."""
    rows = []
    for test in campaign.tests:
        rows.append(np.linalg.lstsq(basis(test), np.asarray(test.reading_um), rcond=None)[0])
    return np.array(rows)


def with_readings(campaign: lb.Campaign, readings_um: np.ndarray) -> lb.Campaign:
    """The same circles with other readings, shape (tests, n)."""
    tests = []
    for test, reading_um in zip(campaign.tests, readings_um, strict=True):
        tests.append(replace(test, reading_um=reading_um))
    return replace(campaign, tests=tuple(tests))


def with_form_scaled(campaign: lb.Campaign, factor: float) -> lb.Campaign:
    """The campaign with what its circles share outside orders 0 to 3 and cos 4θ made so many times
    as large."""
    readings_um = np.array([np.asarray(test.reading_um) for test in campaign.tests])
    fitted = []
    for test, coefficients_um in zip(campaign.tests, harmonics_um(campaign), strict=True):
        fitted.append(basis(test) @ coefficients_um)
    fitted_um = np.array(fitted)
    remainder_um = readings_um - fitted_um
    shared_um = remainder_um.mean(axis=0)
    return with_readings(campaign, fitted_um + remainder_um + (factor - 1.0) * shared_um)


def open_pattern(forces_N: np.ndarray) -> np.ndarray:
    """cos 4θ of every circle that changes no number of Tables 5 to 8, per unit at the lowest force.

    C_CCY of two neighbours is their sum of F cos 4θ, over the sum of F²: what alternates with the
    force and is as 1/F is in none.
    """
    return (-1.0) ** np.arange(forces_N.size) * forces_N[0] / forces_N


def completed(campaign: lb.Campaign, cos_4_um: float) -> lb.Campaign:
    """The campaign with so much more cos 4θ at the lowest force, and no other number of Tables 5 to
    8."""
    changes_um = cos_4_um * open_pattern(campaign.forces_N)
    readings_um = []
    for test, change_um in zip(campaign.tests, changes_um, strict=True):
        readings_um.append(test.reading_um + change_um * basis(test)[:, COS_4])
    return with_readings(campaign, np.array(readings_um))


def completions(campaign: lb.Campaign) -> dict[str, Any]:
    """C_CCY under other values of cos 4θ at the lowest force, which nobody printed: truncation off,
    and on (study 02)."""
    of_study_02 = json.loads(RECOVERED.read_text(encoding="utf-8"))
    truncated = of_study_02["completions"]
    u_um = of_study_02["open"]["cos4_at_lowest_um"]["sd"]
    cos_4_um = harmonics_um(campaign)[:, COS_4]
    pattern = open_pattern(campaign.forces_N)
    steps_um = {
        "as recovered": 0.0,
        "− 1 u": -u_um,
        "+ 1 u": u_um,
        "set to zero": -(cos_4_um @ pattern) / (pattern @ pattern),
    }
    names_in_study_02 = {
        "as recovered": "as recovered",
        "− 1 u": "cos 4θ at the lowest force, − 1 u",
        "+ 1 u": "cos 4θ at the lowest force, + 1 u",
        "set to zero": "set to zero",
    }
    factor, _ = SHOWN["C_CCY"]
    rows: dict[str, Any] = {}
    estimates = []
    for label, step_um in steps_um.items():
        changed = completed(campaign, step_um)
        table = lb.inference.marginalize(FREE, changed, tolerance=1e-2)
        with_truncation = truncated["parameters"][names_in_study_02[label]]["C_CCY"]
        rows[label] = {
            "cos_4_um": cos_4_um[0] + step_um,
            "off": marginal(table, "C_CCY"),
            "on": {key: factor * value for key, value in with_truncation.items()},
        }
        estimates.append(lb.fit_least_squares(changed).estimate["C_CCY"])
    return {
        "rows": rows,
        "u_um": u_um,
        "range_on": [factor * value for value in truncated["range"]["C_CCY"]],
        "least_squares_unchanged": bool(np.ptp(estimates) < 1e-9 * abs(estimates[0])),
    }


def synthetic_form(campaign: lb.Campaign) -> dict[str, Any]:
    """What the size of the synthetic form does to τ, and through it to the geometric errors form is
    confused with."""
    rows = {}
    for factor in SYNTHETIC:
        table = lb.inference.marginalize(FREE, with_form_scaled(campaign, factor))
        rows[f"{factor:g}"] = {
            "tau_um": {
                "mean": 1e3 * float(table.loc["tau", "mean"]),
                "sd": 1e3 * float(table.loc["tau", "sd"]),
            },
            "u": {name: marginal(table, name)["sd"] for name in NAMES},
            "C_CCY": marginal(table, "C_CCY"),
        }
    return rows


def peak_to_peak_per_tau() -> float:
    """Median peak to peak of form whose coefficients of order n = 2 to 12 have sd 1/n."""
    rng = np.random.default_rng(1)
    orders = np.arange(2, 13)
    angle_rad = np.deg2rad(np.arange(360.0))
    phases = np.outer(orders, angle_rad)
    of_cosines, of_sines = rng.standard_normal((2, 4000, orders.size)) / orders
    form = of_cosines @ np.cos(phases) + of_sines @ np.sin(phases)
    return float(np.median(np.ptp(form, axis=1)))


def gain_difference(campaign: lb.Campaign) -> dict[str, float]:
    """E_XX1 − E_YY1 of the joint posterior, with form [µm/m]."""
    # So many draws that another seed moves the sd by less than a hundredth.
    rule = lb.inference.StoppingRule(ess=40_000.0)
    result = lb.sample(FREE, campaign, sampler="independent", seed=1, rule=rule)
    posterior = result["posterior"]
    difference = 1e6 * (posterior["E_XX1"] - posterior["E_YY1"])
    return {"mean": float(difference.mean()), "sd": float(difference.std())}


def marginal(table: pd.DataFrame, name: str) -> dict[str, float]:
    """Mean and sd of a parameter in its unit for reading."""
    factor, _ = (SHOWN | SHOWN_COMPLIANCES)[name]
    return {
        "mean": factor * float(table.loc[name, "mean"]),
        "sd": factor * float(table.loc[name, "sd"]),
    }


def marginals(
    shown: Mapping[str, tuple[float, str]], fits: Mapping[str, pd.DataFrame]
) -> dict[str, dict[str, Any]]:
    """Of these parameters: the published value, and mean and sd by every fit."""
    printed = published()
    rows: dict[str, dict[str, Any]] = {}
    for name, (factor, unit) in shown.items():
        rows[name] = {"unit": unit, "published": printed[name] * factor}
        for label, table in fits.items():
            rows[name][label] = marginal(table, name)
    return rows


def size_of_form(tau_um: float) -> dict[str, float]:
    """Peak to peak of the form that τ stands for, beside what the paper says of it [µm]."""
    per_tau = peak_to_peak_per_tau()
    return {
        "per_tau": per_tau,
        "expected": per_tau * tau_um,
        "paper": PAPERS_FORM_UM,
        "prior_median": per_tau * HALF_NORMAL_MEDIAN * CONSTANT.prior.tau_um,
        "tau_of_paper": PAPERS_FORM_UM / per_tau,
    }


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the page states, in units for reading, whatever the effort."""
    campaign = lb.read_campaign(DATA / "recovered_experiment")
    fits = {
        "least squares": lb.inference.marginalize(lb.HybridModel.paper(degree=0), campaign),
        "without form": lb.inference.marginalize(FREE.without("ball-form"), campaign),
        "with form": lb.inference.marginalize(FREE, campaign),
    }
    unshifted = lb.inference.marginalize(FREE.without("setup-shift"), campaign)
    parameters = marginals(SHOWN, fits)
    compliances = marginals(SHOWN_COMPLIANCES, {**fits, "without set-up shift": unshifted})
    too_narrow = {}
    for name, row in parameters.items():
        too_narrow[name] = row["with form"]["sd"] / row["least squares"]["sd"]
    of_study_04 = json.loads(FROM_DIGITS.read_text(encoding="utf-8"))
    form = synthetic_form(campaign)
    identified = lb.report.with_words(lb.identify(CONSTANT, campaign))
    return {
        "parameters": parameters,
        "compliances": compliances,
        "tau_of_digits_um": of_study_04["printed"]["tau_um"]["constant"],
        "plans": foretold_by_plan(campaign.plan()),
        "third": foretold_by_plan_of_third_edition(campaign.plan()),
        "too_narrow": too_narrow,
        "gain_difference": gain_difference(campaign),
        "completions": completions(campaign),
        "synthetic_form": form,
        "form_um": size_of_form(form["1"]["tau_um"]["mean"]),
        "clockings_deg": [int(angle) for angle in CLOCKINGS_DEG],
        "calibrated_um": CALIBRATED_UM,
        "lowest_force_N": float(campaign.forces_N.min()),
        "statements": [degeneracy["statement"] for degeneracy in identified["degeneracies"]],
    }


def draw(results: dict[str, Any]) -> dict[str, Figure]:
    """Top: intervals by model and completion; bottom: predicted standard uncertainties by plan."""
    return {
        "confounding": confounding(
            results["parameters"], results["plans"], results["completions"]["rows"]
        )
    }


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    tolerances = {"*C_CCY*/mean": 0.001, "completions/rows/*/mean": 0.001}
    run(Study(HERE, measure, draw, absolute=tolerances))


if __name__ == "__main__":
    main()
