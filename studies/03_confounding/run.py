"""What form error of the balls does to the published geometric errors and C_CCY, and what clocking
both balls would have changed.

python studies/03_confounding/run.py            # fails when a stated number is not reproduced
python studies/03_confounding/run.py --write    # states anew
"""

from __future__ import annotations

import json
import sys
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
from study import DATA, Study, run

NAMES = ("E_XX1", "E_YY1", "E_YX2", "E_XY2", "E_C0YX", "C_CCY")
SHOWN = {
    "E_XX1": (1e6, "µm/m"),
    "E_YY1": (1e6, "µm/m"),
    "E_YX2": (1e9, "µm/m²"),
    "E_XY2": (1e9, "µm/m²"),
}
SHOWN |= {"E_C0YX": (1e6, "µrad"), "C_CCY": (1e9, "µrad/(N m)")}
COMPLIANCES = {
    "C_XXX": (1e6, "nm/N"),
    "C_XYX": (1e6, "nm/N"),
    "C_YYY": (1e6, "nm/N"),
    "C_CXY": (1e9, "nrad/N"),
    "C_CYY": (1e9, "nrad/N"),
}
CONSTANT = lb.HybridModel.first(degree=0)
FREE = CONSTANT.without("truncation")
CALIBRATED_UM = 0.5
CLOCKINGS_DEG = (0.0, 45.0, 90.0)
PLANS = {
    "as run": lambda plan: plan,
    "length calibrated to 0.5 µm": lambda plan: plan,
    "both balls at 0, 45, 90° in turn": lambda plan: turned(plan, work=True, tool=True),
    "work ball alone": lambda plan: turned(plan, work=True, tool=False),
    "both balls, length calibrated": lambda plan: turned(plan, work=True, tool=True),
}
# What the default model, the third edition, foretells of the same circles.
THIRD = lb.HybridModel.default(degree=0)
GRADE = "G10"
THIRD_PLANS = {
    "as run": lambda plan: plan,
    "both balls turned": lambda plan: turned(plan, work=True, tool=True),
    "both directions": lambda plan: both_ways(plan),
    "both, balls turned": lambda plan: turned(both_ways(plan), work=True, tool=True),
    f"both, balls of grade {GRADE}": lambda plan: graded(both_ways(plan)),
}
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
        angle = CLOCKINGS_DEG[i % len(CLOCKINGS_DEG)]
        tests.append(
            replace(
                test, work_ball_deg=angle if work else 0.0, tool_ball_deg=angle if tool else 0.0
            )
        )
    return replace(plan, tests=tuple(tests))


def both_ways(plan: lb.Campaign) -> lb.Campaign:
    """The same circles, by turns clockwise and counterclockwise."""
    tests = [replace(test, direction="CCW" if i % 2 else "CW") for i, test in enumerate(plan.tests)]
    return replace(plan, tests=tuple(tests))


def graded(plan: lb.Campaign) -> lb.Campaign:
    """The same circles, with balls of a stated grade."""
    ball = lb.Ball(grade=GRADE)
    return replace(plan, instrument=replace(plan.instrument, work=ball, tool=ball))


def foretold(plan: lb.Campaign) -> dict[str, Any]:
    """Expected sd and verdict of every parameter under the third edition, by plan."""
    found = {}
    for label, change in THIRD_PLANS.items():
        parameters = lb.identify(THIRD, change(plan)).parameters
        found[label] = {
            name: {
                "sd": parameters[name].sd * SHOWN[name][0],
                "verdict": parameters[name].verdict,
            }
            for name in NAMES
        }
    return found


def calibrated(model: lb.HybridModel) -> lb.HybridModel:
    """The model with a bar length known well."""
    return replace(
        model,
        nuisances=tuple(
            replace(t, sd_um=CALIBRATED_UM) if type(t).__name__ == "BarLength" else t
            for t in model.nuisances
        ),
    )


def published() -> dict[str, float]:
    """Tables 5 and 6."""
    tables = DATA / "published_tables"
    row = {
        **pd.read_csv(tables / "table_5_global_compliances.csv").iloc[0],
        **pd.read_csv(tables / "table_6_global_geometric_errors.csv").iloc[0],
    }
    return {name: float(row[name.replace("E_C0YX", "E_C(0Y)X")]) for name in (*NAMES, *COMPLIANCES)}


def basis(test: lb.CircularTest) -> np.ndarray:
    """Orders 0 to 3 and cos 4θ, what the tables know of a circle, shape (n, 8)."""
    angle = np.deg2rad(np.asarray(test.angle_deg))
    waves = [f(n * angle) for n in (1, 2, 3) for f in (np.cos, np.sin)]
    return np.column_stack([np.ones_like(angle), *waves, np.cos(4.0 * angle)])


def harmonics_um(campaign: lb.Campaign) -> np.ndarray:
    """Of every circle, shape (tests, 8) [µm]."""
    return np.array(
        [
            np.linalg.lstsq(basis(test), np.asarray(test.reading_um), rcond=None)[0]
            for test in campaign.tests
        ]
    )


def with_readings(campaign: lb.Campaign, readings_um: np.ndarray) -> lb.Campaign:
    """The same circles with other readings, shape (tests, n)."""
    return replace(
        campaign,
        tests=tuple(
            replace(t, reading_um=own) for t, own in zip(campaign.tests, readings_um, strict=True)
        ),
    )


def with_form_scaled(campaign: lb.Campaign, factor: float) -> lb.Campaign:
    """The campaign with what its circles share outside orders 0 to 3 and cos 4θ made so many times
    as large."""
    known = np.array(
        [basis(t) @ own for t, own in zip(campaign.tests, harmonics_um(campaign), strict=True)]
    )
    rest = np.array([np.asarray(test.reading_um) for test in campaign.tests]) - known
    return with_readings(campaign, known + rest + (factor - 1.0) * rest.mean(axis=0))


def completed(campaign: lb.Campaign, cos_4_um: float) -> lb.Campaign:
    """The campaign with so much more cos 4θ at the lowest force, and no other number of Tables 5 to
    8.

    C_CCY of two neighbours is their sum of F cos 4θ, over the sum of F²: what alternates with the
    force and is as 1/F is in none.
    """
    forces = campaign.forces_N
    change = cos_4_um * (-1.0) ** np.arange(forces.size) * forces[0] / forces
    return with_readings(
        campaign,
        np.array(
            [
                t.reading_um + own * basis(t)[:, 7]
                for t, own in zip(campaign.tests, change, strict=True)
            ]
        ),
    )


def completions(campaign: lb.Campaign) -> dict[str, Any]:
    """C_CCY under other values of cos 4θ at the lowest force, which nobody printed: truncation off,
    and on (study 02)."""
    known = json.loads(RECOVERED.read_text(encoding="utf-8"))
    u_um = known["open"]["cos4_at_lowest_um"]["sd"]
    bounded = known["completions"]
    cos_4 = harmonics_um(campaign)[:, 7]
    along = (-1.0) ** np.arange(cos_4.size) * campaign.forces_N[0] / campaign.forces_N
    steps = {
        "as recovered": 0.0,
        "− 1 u": -u_um,
        "+ 1 u": u_um,
        "set to zero": -(cos_4 @ along) / (along @ along),
    }
    names = {f"{sign} 1 u": f"cos 4θ at the lowest force, {sign} 1 u" for sign in "−+"}
    rows: dict[str, Any] = {}
    for label, step in steps.items():
        table = lb.inference.marginalize(FREE, completed(campaign, step), tolerance=1e-2)
        on = bounded["parameters"][names.get(label, label)]["C_CCY"]
        rows[label] = {
            "cos_4_um": cos_4[0] + step,
            "off": _read(table, "C_CCY"),
            "on": {word: SHOWN["C_CCY"][0] * value for word, value in on.items()},
        }
    squares = [
        lb.fit_least_squares(completed(campaign, step)).estimate["C_CCY"] for step in steps.values()
    ]
    return {
        "rows": rows,
        "u_um": u_um,
        "range_on": [SHOWN["C_CCY"][0] * value for value in bounded["range"]["C_CCY"]],
        "least_squares_unchanged": bool(np.ptp(squares) < 1e-9 * abs(squares[0])),
    }


def synthetic_form(campaign: lb.Campaign) -> dict[str, Any]:
    """What the size of the synthetic form does to τ, and through it to the geometric errors form is
    confused with."""
    rows = {}
    for factor in SYNTHETIC:
        table = lb.inference.marginalize(FREE, with_form_scaled(campaign, factor))
        tau = {word: 1e3 * float(table.loc["tau", word]) for word in ("mean", "sd")}
        rows[f"{factor:g}"] = {
            "tau_um": tau,
            "u": {name: _read(table, name)["sd"] for name in NAMES},
            "C_CCY": _read(table, "C_CCY"),
        }
    return rows


def peak_to_peak_per_tau() -> float:
    """Median peak to peak of form whose coefficients of order n = 2 to 12 have sd 1/n."""
    rng = np.random.default_rng(1)
    orders = np.arange(2, 13)
    angle = np.deg2rad(np.arange(360.0))
    drawn = rng.standard_normal((2, 4000, orders.size)) / orders
    form = drawn[0] @ np.cos(np.outer(orders, angle)) + drawn[1] @ np.sin(np.outer(orders, angle))
    return float(np.median(np.ptp(form, axis=1)))


def gain_difference(campaign: lb.Campaign) -> dict[str, float]:
    """E_XX1 − E_YY1 of the joint posterior, with form [µm/m]."""
    # So many draws that another seed moves the sd by less than a hundredth.
    drawn = lb.sample(
        FREE, campaign, sampler="independent", seed=1, rule=lb.inference.StoppingRule(ess=40_000.0)
    )["posterior"]
    difference = 1e6 * (drawn["E_XX1"] - drawn["E_YY1"])
    return {"mean": float(difference.mean()), "sd": float(difference.std())}


def _read(table: pd.DataFrame, name: str) -> dict[str, float]:
    factor = (SHOWN | COMPLIANCES)[name][0]
    return {word: factor * float(table.loc[name, word]) for word in ("mean", "sd")}


def measure() -> dict[str, Any]:
    """Everything the page states, in units for reading."""
    campaign = lb.read_campaign(DATA / "recovered_experiment")
    fits = {
        "least squares": lb.inference.marginalize(lb.HybridModel.paper(degree=0), campaign),
        "without form": lb.inference.marginalize(FREE.without("ball-form"), campaign),
        "with form": lb.inference.marginalize(FREE, campaign),
    }
    printed = published()
    fitted: dict[str, Any] = {}
    for name in NAMES:
        factor, unit = SHOWN[name]
        fitted[name] = {"unit": unit, "published": printed[name] * factor} | {
            k: _read(t, name) for k, t in fits.items()
        }
    unshifted = lb.inference.marginalize(FREE.without("setup-shift"), campaign)
    others = {
        name: (
            {"unit": unit, "published": printed[name] * factor}
            | {k: _read(t, name) for k, t in ({**fits, "without set-up shift": unshifted}).items()}
        )
        for name, (factor, unit) in COMPLIANCES.items()
    }
    plans = {}
    for label, change in PLANS.items():
        model = calibrated(CONSTANT) if "calibrated" in label else CONSTANT
        found = lb.identify(model, change(campaign.plan()))
        plans[label] = {
            name: {
                "sd": found.parameters[name].sd * SHOWN[name][0],
                "verdict": found.parameters[name].verdict,
            }
            for name in NAMES
        }
    form = synthetic_form(campaign)
    per_tau = peak_to_peak_per_tau()
    return {
        "parameters": fitted,
        "compliances": others,
        "tau_of_digits_um": json.loads(FROM_DIGITS.read_text(encoding="utf-8"))["printed"][
            "tau_um"
        ]["constant"],
        "plans": plans,
        "third": foretold(campaign.plan()),
        "too_narrow": {
            n: fitted[n]["with form"]["sd"] / fitted[n]["least squares"]["sd"] for n in NAMES
        },
        "gain_difference": gain_difference(campaign),
        "completions": completions(campaign),
        "synthetic_form": form,
        "form_um": {
            "per_tau": per_tau,
            "expected": per_tau * form["1"]["tau_um"]["mean"],
            "paper": PAPERS_FORM_UM,
            "prior_median": per_tau * HALF_NORMAL_MEDIAN * CONSTANT.prior.tau_um,
            "tau_of_paper": PAPERS_FORM_UM / per_tau,
        },
        "clockings_deg": [int(angle) for angle in CLOCKINGS_DEG],
        "calibrated_um": CALIBRATED_UM,
        "lowest_force_N": float(campaign.forces_N.min()),
        "statements": [
            d["statement"]
            for d in lb.report.with_words(lb.identify(CONSTANT, campaign))["degeneracies"]
        ],
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
    run(
        Study(
            HERE,
            lambda effort: measure(),
            draw,
            absolute={"*C_CCY*/mean": 0.001, "completions/rows/*/mean": 0.001},
        )
    )


if __name__ == "__main__":
    main()
