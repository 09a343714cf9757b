"""Section 4 of the paper: Tables 1 to 3, the simulation (Table 4, Figs. 3 to 5), and how far the
linear model reaches.

python studies/01_simulation/run.py            # fails when a stated number is not reproduced
python studies/01_simulation/run.py --write    # states anew
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import ldbb_bayes as lb

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
sys.path.insert(0, str(HERE))
from figures import (
    DEGREES,
    Readings,
    chain,
    data_flow,
    linearisation,
    scale_and_compliance,
    simulated_and_predicted,
)
from study import DATA, Effort, Study, run

TABLES = DATA / "published_tables"
MACHINE = lb.Machine("wCAFYXZSt", "XY")
CIRCLE = lb.machine.Circle()
ANGLE = np.deg2rad(np.arange(0.0, 360.0, 0.5))
PAPERS_STEP_DEG = 30.0
PAPERS_ANGLE = np.deg2rad(np.arange(0.0, 360.0 + PAPERS_STEP_DEG, PAPERS_STEP_DEG))
# Without force, and the paper's seven.
FORCES_N = (0.0, 36.0, 112.0, 238.0, 364.0, 490.0, 616.0, 742.0)
RESOLUTION_UM = 0.24
SIZES = np.logspace(-1.0, 2.0, 25)
DRAWS = 1000
# Captions of Tables 2 and 3.
PAPERS_UNIT_UM = 15.0
ALIKE = {
    "E_YX2": "E_YX2, E_XY2",
    "E_Xt0": "E_Xt0, E_Yt0",
    "E_XX1": "E_XX1, E_YY1",
    "E_C0YX": "E_C(0Y)X",
}
Values = Mapping[str, float]


def printed(number: int, name: str) -> pd.DataFrame:
    """A table as printed: text."""
    return pd.read_csv(TABLES / f"table_{number}_{name}.csv", dtype=str)


def in_code(name: str) -> str:
    """E_C(0Y)X → E_C0YX."""
    return name.replace("(", "").replace(")", "")


def on_page(name: str) -> str:
    """E_C0YX → E_C(0Y)X."""
    return name.replace("C0YX", "C(0Y)X")


def tables_1_and_2() -> dict[str, Any]:
    """Parameters kept and sets that look alike, as printed and as found from the Jacobian."""
    machine = lb.describe_machine(MACHINE)
    parameters = (*machine.compliances, *machine.geometric_errors)
    patterns = lb.machine.patterns(MACHINE, CIRCLE, ANGLE)
    elastic = patterns[[name for name in patterns.columns if name.startswith("C_")]]
    singular = np.linalg.svd(elastic.to_numpy(), compute_uv=False)
    printed_names = [in_code(name) for name in printed(1, "parameters")["symbol"]]
    printed_sets = {}
    for _, row in printed(2, "confounded_compliances").iterrows():
        printed_sets[row["kept"]] = sorted(row["set"].split())
    sets = {}
    for compliance in machine.compliances:
        sets[compliance.name] = sorted(compliance.members or {compliance.name: 1.0})
    rank_by_forces = {}
    for count in (1, 2, 7):
        jacobian = scaled_jacobian(FORCES_N[1 : 1 + count])
        rank_by_forces[str(count)] = int(np.linalg.matrix_rank(jacobian, tol=1e-9))
    condition_by_forces = {}
    for count in (2, 7):
        jacobian = scaled_jacobian(FORCES_N[-count:])
        condition_by_forces[str(count)] = float(np.linalg.cond(jacobian))
    return {
        "parameters": [
            {
                "name": on_page(parameter.name),
                "meaning": parameter.meaning,
                "unit": parameter.unit,
                "pattern": parameter.pattern["XY"],
            }
            for parameter in parameters
        ],
        "table_1_same": [parameter.name for parameter in parameters] == printed_names,
        "table_2_same": printed_sets == sets,
        "sets": sets,
        "null": list(machine.null),
        "columns": elastic.shape[1],
        "geometric_columns": patterns.shape[1] - elastic.shape[1],
        "rank": machine.rank,
        "condition_number": machine.condition_number,
        "seventh_singular_value": bool(singular[machine.rank] < 1e-10 * singular[0]),
        "rank_by_forces": rank_by_forces,
        "condition_by_forces": condition_by_forces,
    }


def scaled_jacobian(forces_N: tuple[float, ...]) -> np.ndarray:
    """J_H of Eq. 30, each column divided by its norm."""
    jacobian = np.vstack(
        [lb.machine.hybrid_jacobian(MACHINE, CIRCLE, ANGLE, force) for force in forces_N]
    )
    return jacobian / np.linalg.norm(jacobian, axis=0)


def starting_with(start: str, values: Values) -> dict[str, float]:
    """Values whose names start so: "C_" compliances, "E_" geometric errors."""
    return {name: value for name, value in values.items() if name.startswith(start)}


def times(factor: float, values: Values) -> dict[str, float]:
    """Every value times a factor."""
    return {name: factor * value for name, value in values.items()}


def readings_mm(values: Values, force_N: float, angle_rad: np.ndarray) -> np.ndarray:
    """The exact model (Eq. 13 and 20)."""
    return lb.machine.exact_reading_mm(
        MACHINE,
        CIRCLE,
        angle_rad,
        force_N=force_N,
        compliances=starting_with("C_", values),
        geometric_errors=starting_with("E_", values),
    )


def estimated(values: Values, angle_rad: np.ndarray = PAPERS_ANGLE) -> dict[str, float]:
    """Eq. 31 of exact readings at all eight forces."""
    jacobian = pd.concat(
        [lb.machine.hybrid_jacobian(MACHINE, CIRCLE, angle_rad, force_N) for force_N in FORCES_N]
    )
    scale = np.linalg.norm(jacobian, axis=0)
    reading = np.concatenate([readings_mm(values, force_N, angle_rad) for force_N in FORCES_N])
    estimate = np.linalg.lstsq(jacobian.to_numpy() / scale, reading, rcond=None)[0] / scale
    return dict(zip(jacobian.columns, estimate.tolist(), strict=True))


def table_4_truth() -> dict[str, float]:
    """Simulated values with the sign of Eq. 16 for E_C(0Y)X: the paper's simulation has the
    opposite one."""
    table = printed(4, "simulation")
    values = {
        in_code(name): float(value)
        for name, value in zip(table["error"], table["simulated"], strict=True)
    }
    return values | {"E_C0YX": -values["E_C0YX"]}


def table_4() -> dict[str, Any]:
    """Every estimate of Table 4 beside ours, digit by digit, with both signs of E_C(0Y)X."""
    truth = table_4_truth()
    estimate = estimated(truth)
    estimate["E_C0YX"] = -estimate["E_C0YX"]
    of_other_sign = estimated(truth | {"E_C0YX": -truth["E_C0YX"]})
    of_fine_circles = estimated(truth, ANGLE)
    rows = []
    for _, row in printed(4, "simulation").iterrows():
        name = in_code(row["error"])
        rows.append(table_4_row(row, estimate[name], of_other_sign[name]))
    corrected = [row["rounded"] for row in rows if not (row["same"] or row["cut"])]
    return {
        "rows": rows,
        "same": sum(row["same"] for row in rows),
        "corrected": ", ".join(corrected),
        "step_deg": PAPERS_STEP_DEG,
        "E_Xt0_of_fine_circles": with_minus_sign(f"{of_fine_circles['E_Xt0']:.4E}"),
        "cut": [row["name"] for row in rows if row["cut"]],
        "misprinted": [row["name"] for row in rows if not (row["same"] or row["cut"])],
        "same_with_the_sign_of_Eq_16": sum(row["same_with_the_sign_of_Eq_16"] for row in rows),
        "differences_of_other_sign": [
            row["name"] for row in rows if row["difference_has_other_sign"]
        ],
    }


def table_4_row(row: pd.Series, estimate: float, of_other_sign: float) -> dict[str, Any]:
    """One printed row beside our estimates, with the paper's sign of E_C(0Y)X and with the
    other."""
    simulated = float(row["simulated"])
    printed_difference = float(row["estimated"]) - simulated
    rounded = f"{estimate:.4E}"
    is_same = rounded == row["estimated"]
    return {
        "name": row["error"],
        "simulated": with_minus_sign(row["simulated"]),
        "printed": with_minus_sign(row["estimated"]),
        "returned": with_minus_sign(f"{estimate:.6E}"),
        "rounded": with_minus_sign(rounded),
        "same": is_same,
        "cut": not is_same and cut_off(estimate) == row["estimated"],
        "same_with_the_sign_of_Eq_16": f"{of_other_sign:.4E}" == row["estimated"],
        "difference": estimate - simulated,
        "difference_has_other_sign": float(row["difference"]) * printed_difference < 0.0,
    }


def with_minus_sign(text: str) -> str:
    """A number with true minus signs."""
    return text.replace("-", "−")


def cut_off(value: float) -> str:
    """Four decimals of the mantissa, cut off."""
    mantissa, exponent = f"{value:.12E}".split("E")
    return f"{mantissa[: mantissa.index('.') + 5]}E{exponent}"


def figures_4_and_5() -> dict[str, Any]:
    """Peak to peak of Fig. 4; largest misfit of Fig. 5."""
    contributions = simulation()
    misfits_um = []
    for by_force in contributions.values():
        for readings in by_force.values():
            misfits_um.append(np.abs(readings.simulated_um - readings.predicted_um).max())
    largest_um = [
        np.abs(readings.simulated_um).max() for readings in contributions["Both"].values()
    ]
    oval_um = {}
    for force_N, values in oval_readings_um().items():
        oval_um[f"{force_N:g}"] = float(np.ptp(values))
    return {
        "oval_um": oval_um,
        "largest_misfit_um": float(max(misfits_um)),
        "largest_reading_um": float(max(largest_um)),
    }


def oval_readings_um() -> dict[float, np.ndarray]:
    """Fig. 4: C_XXX and E_XX1 of Table 4 alone, at 0 N and the seven forces [µm]."""
    truth = table_4_truth()
    of_oval = {name: truth[name] for name in ("C_XXX", "E_XX1")}
    return {
        force_N: 1e3 * readings_mm(of_oval, force_N, np.deg2rad(DEGREES)) for force_N in FORCES_N
    }


def simulation() -> dict[str, dict[float, Readings]]:
    """Fig. 5: readings from the simulated and from the estimated values [µm]."""
    truth = table_4_truth()
    estimate = estimated(truth)
    return {
        "Geometry": readings_by_force(starting_with("E_", truth), starting_with("E_", estimate)),
        "Compliance": readings_by_force(starting_with("C_", truth), starting_with("C_", estimate)),
        "Both": readings_by_force(truth, estimate),
    }


def readings_by_force(simulated: Values, estimate: Values) -> dict[float, Readings]:
    """Readings at 0° … 360° at every force."""
    angle_rad = np.deg2rad(DEGREES)
    by_force = {}
    for force_N in FORCES_N:
        by_force[force_N] = Readings(
            simulated_um=1e3 * readings_mm(simulated, force_N, angle_rad),
            predicted_um=1e3 * readings_mm(estimate, force_N, angle_rad),
        )
    return by_force


def linearisation_um(values: Values) -> float:
    """Largest |exact − linear| reading of geometric errors [µm]."""
    jacobian = lb.machine.hybrid_jacobian(MACHINE, CIRCLE, ANGLE, 0.0)
    linear = sum(value * jacobian[name].to_numpy() for name, value in values.items())
    return float(1e3 * np.abs(readings_mm(values, 0.0, ANGLE) - linear).max())


def size_at(values: Values, error_um: float) -> float:
    """Factor on these errors at which the largest linearisation error is this large; it grows with
    the square, nearly."""
    factor = 1.0
    for _ in range(20):
        factor *= np.sqrt(error_um / linearisation_um(times(factor, values)))
    return float(factor)


class PriorDraws(NamedTuple):
    """Geometric errors drawn from their priors.

    Attributes
    ----------
    linearisation_um : ndarray, shape (draws,)
    typical : dict of str to float
        The errors of the draw at the 95 % quantile of the linearisation error.
    """

    linearisation_um: np.ndarray
    typical: dict[str, float]


def draws_from_prior(prior_sd: Values) -> PriorDraws:
    """Draw geometric errors, and compare the exact and the linear model."""
    rng = np.random.default_rng(4)
    sd = np.array(list(prior_sd.values()))
    draws = []
    for _ in range(DRAWS):
        values = rng.standard_normal(len(sd)) * sd
        draws.append(dict(zip(prior_sd, values.tolist(), strict=True)))
    errors_um = np.array([linearisation_um(draw) for draw in draws])
    typical = draws[int(np.argsort(errors_um)[int(0.95 * DRAWS)])]
    return PriorDraws(errors_um, typical)


def reach() -> dict[str, Any]:
    """How large errors may be before the linear model is off by the resolution, and what that does
    to the estimates."""
    tests = [lb.CircularTest(force_N, np.rad2deg(ANGLE)) for force_N in FORCES_N[1:]]
    parameters = lb.identify(lb.HybridModel.first(1), lb.Plan(tuple(tests))).parameters
    prior_sd = {}
    for name, parameter in parameters.items():
        if name.startswith("E_"):
            prior_sd[name] = parameter.prior_sd
    draws = draws_from_prior(prior_sd)
    limit = size_at(draws.typical, RESOLUTION_UM)
    at_limit = times(limit, draws.typical)
    bias_in_u = {}
    for name, estimate in estimated(at_limit, ANGLE).items():
        bias_in_u[name] = abs(estimate - at_limit.get(name, 0.0)) / parameters[name].sd
    most_biased = max(bias_in_u, key=bias_in_u.__getitem__)
    return {
        "resolution_um": RESOLUTION_UM,
        "radius_mm": CIRCLE.radius_mm,
        "draws": DRAWS,
        "table_4_um": linearisation_um(starting_with("E_", table_4_truth())),
        "prior_median_um": float(np.median(draws.linearisation_um)),
        "prior_95_um": float(np.quantile(draws.linearisation_um, 0.95)),
        "limit_in_prior_sd": limit,
        "bias_at_limit_in_u": bias_in_u[most_biased],
        "bias_at_limit_of": on_page(most_biased),
        "alone": reach_of_single_errors(prior_sd),
        "sizes": SIZES.tolist(),
        "curves": linearisation_curves_um(draws.typical, prior_sd),
    }


def reach_of_single_errors(prior_sd: Values) -> dict[str, dict[str, Any]]:
    """Size of every error alone at which the linear model is off by the resolution."""
    machine = lb.describe_machine(MACHINE)
    units = {parameter.name: parameter.unit for parameter in machine.geometric_errors}
    rows = {}
    for name, sd in prior_sd.items():
        factor = size_at({name: sd}, RESOLUTION_UM)
        rows[on_page(name)] = {
            "prior_sd": sd,
            "unit": units[name],
            "limit": factor * sd,
            "in_prior_sd": factor,
        }
    return rows


def linearisation_curves_um(typical: Values, prior_sd: Values) -> dict[str, list[float]]:
    """Linearisation error against size, of a typical draw from the prior and of single errors."""
    errors_by_label: dict[str, Values] = {"95 % of draws from the prior": typical}
    for name, label in ALIKE.items():
        errors_by_label[f"{label} alone"] = {name: prior_sd[name]}
    curves = {}
    for label, errors in errors_by_label.items():
        curves[label] = [linearisation_um(times(size, errors)) for size in SIZES]
    return curves


def atlas_swing() -> float:
    """Largest distance of a drawn pattern from the nominal circle, the same in every panel of both
    atlases."""
    panels = [
        *lb.figures.compliance_atlas(MACHINE).axes,
        *lb.figures.geometric_atlas(MACHINE).axes,
    ]
    swings = set()
    for axes in panels:
        if len(axes.lines) > 1:
            pattern = np.asarray(axes.lines[1].get_ydata())
            swings.add(round(float(np.abs(pattern - 1.0).max()), 3))
    (swing,) = swings - {0.0}
    return swing


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the pages state, whatever the effort."""
    return {
        "sets": tables_1_and_2(),
        "paper_unit_um": PAPERS_UNIT_UM,
        "atlas_swing": atlas_swing(),
        "table_4": table_4(),
        "figures": figures_4_and_5(),
        "reach": reach(),
    }


def draw(results: dict[str, Any]) -> dict[str, Figure]:
    """Figs. 1, 3, 4, 5, the two atlases, and the reach of the linear model."""
    reach_of_model = results["reach"]
    return {
        "fig_01": chain(),
        "fig_03": data_flow(),
        "fig_04": scale_and_compliance(oval_readings_um()),
        "fig_05": simulated_and_predicted(simulation()),
        "table_2": lb.figures.compliance_atlas(MACHINE),
        "table_3": lb.figures.geometric_atlas(MACHINE),
        "linearisation": linearisation(
            reach_of_model["sizes"],
            reach_of_model["curves"],
            RESOLUTION_UM,
            reach_of_model["limit_in_prior_sd"],
        ),
    }


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    tolerances = {"table_4/rows/*/difference": 1e-13, "figures/largest_misfit_um": 1e-6}
    run(Study(HERE, measure, draw, absolute=tolerances))


if __name__ == "__main__":
    main()
