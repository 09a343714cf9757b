"""The published experiment given back by its printed numbers: what they determine, and Tables 5 to
9 and Figs. 7 to 16 anew.

python studies/02_recovered_experiment/run.py          # fails when a number is not reproduced
python studies/02_recovered_experiment/run.py --write  # states anew
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import ldbb_bayes as lb

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
sys.path.insert(0, str(HERE))
import beliefs
from figures import (
    BAND_U,
    Pair,
    contributions,
    harmonics,
    local_traces,
    on_page,
    parameter_contributions,
    part_um,
    upper_pair,
    with_least_squares,
)
from make_campaign import (
    FORCES_N,
    OUT_OF_BAND_RMS_UM,
    TABLES,
    WEAK_UM,
    Recovered,
    campaign_of,
    half_unit,
    recover,
)
from study import DATA, Effort, Study, run

SHAPE_OF_HARMONICS = (FORCES_N.size, 8)
HARMONICS = ("1", "cos θ", "sin θ", "cos 2θ", "sin 2θ", "cos 3θ", "sin 3θ", "cos 4θ")
COS_4 = HARMONICS.index("cos 4θ")
EXCHANGE_OF_COSINES = "exchange of cos θ and cos 3θ"
EXCHANGE_OF_SINES = "exchange of sin θ and sin 3θ"
COS_4_AT_LOWEST = "cos 4θ at the lowest force"
# Tables 5 to 8 by number.
STEMS = {
    "5": "global_compliances",
    "6": "global_geometric_errors",
    "7": "local_compliances",
    "8": "local_geometric_errors",
}
COLUMNS = ("constant", "linear", "local")
# Of Fig. 7, whose band is of readings of these circles, not of a new one.
LEAST_SQUARES = {
    "prediction": "lines: least squares (Eq. 31), constant compliance",
    "band": "shaded: 95 % of readings by white noise",
}
CONSTANT = lb.HybridModel.first(degree=0)
# Section 5.3.
PRINTED_RMSE_MM = {"constant": 0.0011, "linear": 0.0009}
PRINTED_GAIN_PERCENT = 18


def in_code(name: str) -> str:
    """E_C(0Y)X → E_C0YX."""
    return name.replace("(", "").replace(")", "")


@cache
def campaign() -> lb.Campaign:
    """The recovered experiment as it is shipped."""
    return lb.read_campaign(DATA / "recovered_experiment")


@cache
def pairs() -> Mapping[Pair, lb.inference.LeastSquares]:
    """Least squares of every pair of neighbouring forces (Tables 7 and 8)."""
    names = [test.name for test in campaign().tests]
    return {
        (low, high): lb.fit_least_squares(campaign().select([low, high]))
        for low, high in pairwise(names)
    }


def local_fit(test: lb.CircularTest) -> lb.inference.LeastSquares:
    """Least squares of the pair in which a test is the upper force."""
    return pairs()[upper_pair(pairs(), test.name)]


def named_directions(recovered: Recovered) -> dict[str, np.ndarray]:
    """Orthonormal open directions by name, each (48,): the parts of three harmonics of the lowest
    force that no printed number determines."""
    projector = recovered.open_directions.T @ recovered.open_directions
    open_parts = {
        EXCHANGE_OF_COSINES: projector[:, HARMONICS.index("cos θ")],
        EXCHANGE_OF_SINES: projector[:, HARMONICS.index("sin θ")],
        COS_4_AT_LOWEST: projector[:, COS_4],
    }
    return {name: part / np.linalg.norm(part) for name, part in open_parts.items()}


def sd_along(recovered: Recovered, direction: np.ndarray) -> float:
    """How far the weak prior narrows one direction [µm]."""
    return float(np.sqrt(direction @ recovered.covariance @ direction))


def alternates(direction: np.ndarray, by_harmonic: Mapping[str, float]) -> bool:
    """Whether a direction is these harmonics, with the sign alternating from circle to circle."""
    pattern = [by_harmonic.get(name, 0.0) for name in HARMONICS]
    alternating_signs = np.array([1.0, -1.0] * 3)
    expected = np.outer(alternating_signs, pattern).ravel() / np.sqrt(2 * FORCES_N.size)
    return bool(np.allclose(direction, expected, atol=1e-4))


def open_directions(recovered: Recovered) -> dict[str, Any]:
    """What the tables leave open, and how far the weak prior narrows it."""
    directions = named_directions(recovered)
    basis = np.array(list(directions.values()))
    set_to_zero = recovered.mean - basis.T @ (basis @ recovered.mean)
    other_changes = np.delete(set_to_zero - recovered.mean, COS_4)
    sd_um = {name: sd_along(recovered, direction) for name, direction in directions.items()}
    cosines = directions[EXCHANGE_OF_COSINES]
    sines = directions[EXCHANGE_OF_SINES]
    return {
        "count": len(recovered.open_directions),
        "orthonormal": bool(np.allclose(basis @ basis.T, np.eye(len(basis)), atol=1e-6)),
        "sd_um": sd_um,
        "in_one_um": sd_um[EXCHANGE_OF_COSINES] / float(np.sqrt(2 * FORCES_N.size)),
        "alternating": {
            EXCHANGE_OF_COSINES: alternates(cosines, {"cos θ": 1.0, "cos 3θ": 1.0}),
            EXCHANGE_OF_SINES: alternates(sines, {"sin θ": 1.0, "sin 3θ": -1.0}),
        },
        "cos4_at_lowest_um": {
            "recovered": float(recovered.mean[COS_4]),
            "sd": float(recovered.sd[COS_4]),
            "set to zero": float(set_to_zero[COS_4]),
        },
        "largest_other_change_um": float(np.abs(other_changes).max()),
    }


def determined_to_um(recovered: Recovered) -> float:
    """Largest sd of a harmonic with its part along the open directions left out [µm]."""
    directions = recovered.open_directions
    projector = np.eye(directions.shape[1]) - directions.T @ directions
    return float(np.sqrt(np.diag(projector @ recovered.covariance @ projector)).max())


def completed_harmonics(recovered: Recovered) -> dict[str, np.ndarray]:
    """Harmonics that return the printed numbers equally well, each (48,): as recovered, with the
    open directions set to zero, and one u along each of them."""
    directions = named_directions(recovered)
    part_along = sum((direction @ recovered.mean) * direction for direction in directions.values())
    completed = {"as recovered": recovered.mean, "set to zero": recovered.mean - part_along}
    for name, direction in directions.items():
        step = sd_along(recovered, direction) * direction
        completed[f"{name}, + 1 u"] = recovered.mean + step
        completed[f"{name}, − 1 u"] = recovered.mean - step
    return completed


def posterior_of(harmonics_um: np.ndarray) -> dict[str, dict[str, float]]:
    """Mean and sd of every parameter, under the first edition with constant compliance."""
    table = lb.inference.marginalize(CONSTANT, campaign_of(harmonics_um), tolerance=1e-2)
    posterior = {}
    for name in table.index:
        posterior[name] = {
            "mean": float(table.loc[name, "mean"]),
            "sd": float(table.loc[name, "sd"]),
        }
    return posterior


def completions(recovered: Recovered) -> dict[str, Any]:
    """Posterior of what depends most on the completion, under the first edition with constant
    compliance."""
    completed = completed_harmonics(recovered)
    posteriors = {name: posterior_of(harmonics_um) for name, harmonics_um in completed.items()}
    moves_in_u = largest_moves_in_u(posteriors)
    most_moved = max(moves_in_u, key=moves_in_u.__getitem__)
    stated_names = ("C_CXY", "C_CYY", "C_CCY", "delta", "kappa")
    stated = {}
    for label, posterior in posteriors.items():
        stated[label] = {name: posterior[name] for name in stated_names}
    ranges = {}
    for name in stated_names:
        means = [posterior[name]["mean"] for posterior in posteriors.values()]
        ranges[name] = [min(means), max(means)]
    changes = [least_squares_change(campaign_of(values)) for values in completed.values()]
    return {
        "parameters": stated,
        "largest_move_in_u": moves_in_u[most_moved],
        "which": most_moved,
        "range": ranges,
        "least_squares_unchanged": max(changes) < 1e-9,
    }


def largest_moves_in_u(posteriors: Mapping[str, Mapping[str, Any]]) -> dict[str, float]:
    """Largest distance of each parameter's mean from that as recovered, in its u."""
    as_recovered = posteriors["as recovered"]
    moves = {}
    for name, marginal in as_recovered.items():
        distances = [
            abs(posterior[name]["mean"] - marginal["mean"]) for posterior in posteriors.values()
        ]
        moves[name] = max(distances) / marginal["sd"]
    return moves


def least_squares_change(other: lb.Campaign) -> float:
    """Largest relative change of the estimates of Eq. 31."""
    shipped = lb.fit_least_squares(campaign()).table["estimate"]
    changed = lb.fit_least_squares(other).table["estimate"]
    return float((changed / shipped - 1.0).abs().max())


def tables_5_to_8() -> dict[str, list[dict[str, Any]]]:
    """Every printed number beside the estimate of Eq. 31 from the shipped readings."""
    of_all_circles = lb.fit_least_squares(campaign())
    of_pairs = {}
    for pair, fit in pairs().items():
        of_pairs[tuple(float(name[1:]) for name in pair)] = fit
    tables: dict[str, list[dict[str, Any]]] = {}
    for number, stem in STEMS.items():
        tables[number] = []
        for _, row in pd.read_csv(TABLES / f"table_{number}_{stem}.csv", dtype=str).iterrows():
            force_columns = [name for name in row.index if name.startswith("force_")]
            forces_N = tuple(float(row[name]) for name in force_columns)
            fit = of_pairs[forces_N] if forces_N else of_all_circles
            forces = " and ".join(row[name] for name in force_columns)
            for name in row.index.drop(force_columns):
                tables[number].append(_cell(row[name], name, fit, forces))
    return tables


def _cell(printed: str, name: str, fit: lb.inference.LeastSquares, forces: str) -> dict[str, Any]:
    """One printed number and its estimate, with the distance in half-units of the last digit."""
    value, u = fit.table.loc[in_code(name), ["estimate", "u"]]
    return {
        "forces_N": forces or "all",
        "parameter": name,
        "printed": printed.replace("-", "−"),
        "returned": float(value),
        "u": float(u),
        "half_units": float(abs(value - float(printed)) / half_unit(printed)),
    }


def table_9() -> dict[str, Any]:
    """Fitness (Eq. 35) as printed, with the RMSE of each own circle (own), and with that of all
    circles fitted together (all)."""
    printed = pd.read_csv(TABLES / "table_9_fitness.csv").set_index("force_N")
    fits = {
        "constant": lb.fit_least_squares(campaign(), 0).quality,
        "linear": lb.fit_least_squares(campaign(), 1).quality,
    }
    rows: dict[str, Any] = {}
    local_pairs = {}
    for test in campaign().tests:
        force = f"{test.force_N:g}"
        qualities = fits | {"local": local_fit(test).quality}
        rows[force] = fitness_row(test, printed.loc[float(test.force_N or 0.0)], qualities)
        pair = upper_pair(pairs(), test.name)
        local_pairs[force] = [float(name[1:]) for name in pair]
    rmse_ratio = fits["linear"].rmse_um / fits["constant"].rmse_um
    return {
        "rows": rows,
        "worst": largest_differences(rows),
        "printed_rmse_um": {column: 1e3 * value for column, value in PRINTED_RMSE_MM.items()},
        "printed_gain_percent": PRINTED_GAIN_PERCENT,
        "local_pairs": local_pairs,
        "rmse_um": {column: quality.rmse_um for column, quality in fits.items()},
        "ratios": [row["ratio"] for row in rows.values()],
        "rmse_ratio": rmse_ratio,
        "gain": 1.0 - rmse_ratio,
        "synthetic_um": OUT_OF_BAND_RMS_UM,
    }


def fitness_row(
    test: lb.CircularTest, printed: pd.Series, qualities: Mapping[str, Any]
) -> dict[str, Any]:
    """Fitness of one circle by constant, linear and local compliance [%], and what the printed ones
    say of the ratio of the RMSE."""
    span_um = float(np.ptp(np.asarray(test.reading_um)))
    row: dict[str, Any] = {"span_um": span_um}
    for column, quality in qualities.items():
        row[column] = {
            "printed": float(printed[f"{column}_percent"]),
            "own": quality.fitness_percent[test.name],
            "all": 100.0 * (1.0 - quality.rmse_um / span_um),
        }
    misfit_of_linear = 100.0 - printed["linear_percent"]
    misfit_of_constant = 100.0 - printed["constant_percent"]
    row["ratio"] = float(misfit_of_linear / misfit_of_constant)
    return row


def largest_differences(rows: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    """Largest distance from the printed fitness, by column and kind of RMSE [%]."""
    largest: dict[str, dict[str, float]] = {}
    for column in COLUMNS:
        largest[column] = {}
        for kind in ("own", "all"):
            differences = [abs(row[column][kind] - row[column]["printed"]) for row in rows.values()]
            largest[column][kind] = max(differences)
    return largest


def recovered_figure_values_um() -> dict[str, float]:
    """What the text states beside Figs. 8 to 14, from the recovered readings at the largest force,
    by figure and quantity."""
    top_test = max(campaign().tests, key=lambda test: test.force_N or 0.0)
    force_N = float(top_test.force_N or 0.0)
    constant = lb.fit_least_squares(campaign()).estimate
    local = local_fit(top_test).estimate
    compliance_um = part_um(constant, force_N, start="C_")
    geometry_um = part_um(constant, force_N, start="E_")
    local_geometry_um = [part_um(fit.estimate, force_N, start="E_") for fit in pairs().values()]
    values_um = {
        "8b compliance largest": compliance_um.max(),
        "8b compliance smallest": min(0.0, compliance_um.min()),
        "8c geometry largest": geometry_um.max(),
        "8c geometry smallest": geometry_um.min(),
        "12 change of geometry with force": np.ptp(np.array(local_geometry_um), axis=0).max(),
    }
    jacobian = lb.machine.hybrid_jacobian(
        lb.Machine(), lb.machine.Circle(), np.deg2rad(np.arange(360.0)), force_N
    )
    peak_to_peak = dict(
        zip(jacobian.columns, np.ptp(jacobian.to_numpy(), axis=0) * 1e3, strict=True)
    )
    for number, start, estimate in (
        ("9", "C_", constant),
        ("10", "E_", constant),
        ("13", "C_", local),
        ("14", "E_", local),
    ):
        for name, swing in peak_to_peak.items():
            if name.startswith(start):
                values_um[f"{number} {on_page(name)}"] = abs(estimate[name]) * swing
    return values_um


def figure_values() -> list[dict[str, Any]]:
    """What the text states beside Figs. 8 to 14, in µm, and the same from the recovered
    readings."""
    returned_um = recovered_figure_values_um()
    rows = []
    for _, row in pd.read_csv(TABLES / "figure_values.csv", dtype=str).iterrows():
        value_um = float(returned_um[f"{row['figure']} {row['quantity']}"])
        printed_um = float(row["printed_mm"]) * 1e3
        unit_um = 2.0 * half_unit(row["printed_mm"]) * 1e3
        rows.append(
            {
                "figure": row["figure"],
                "quantity": row["quantity"],
                "printed_um": printed_um,
                "returned_um": value_um,
                "units_of_last_digit": abs(abs(value_um) - abs(printed_um)) / unit_um,
            }
        )
    return rows


def harmonics_by_force(recovered: Recovered) -> dict[str, dict[str, Any]]:
    """Mean and sd of every harmonic at every force [µm]."""
    mean_um = recovered.mean.reshape(SHAPE_OF_HARMONICS)
    sd_um = recovered.sd.reshape(SHAPE_OF_HARMONICS)
    by_force: dict[str, dict[str, Any]] = {}
    for circle, force_N in enumerate(FORCES_N):
        by_force[f"{force_N:g}"] = {}
        for k, name in enumerate(HARMONICS):
            by_force[f"{force_N:g}"][name] = {"mean": mean_um[circle, k], "sd": sd_um[circle, k]}
    return by_force


def is_shipped(other: lb.Campaign) -> bool:
    """Whether its readings are those of the campaign as it is shipped, to a picometre."""
    for test, shipped in zip(other.tests, campaign().tests, strict=True):
        if not np.allclose(test.reading_um, shipped.reading_um, rtol=0.0, atol=1e-6):
            return False
    return True


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the pages state."""
    recovered = recover()
    tables = tables_5_to_8()
    readings_half_units = {}
    for number, rows in tables.items():
        readings_half_units[number] = max(row["half_units"] for row in rows)
    beside_figures = figure_values()
    figures_off = []
    for row in beside_figures:
        if row["units_of_last_digit"] > 1.0:
            figures_off.append(f"{row['quantity']} (Fig. {row['figure']})")
    dimensions = recovered.jacobian.shape[1]
    return {
        "forces_N": FORCES_N.tolist(),
        "printed_numbers": len(recovered.numbers),
        "dimensions": dimensions,
        "determined": dimensions - len(recovered.open_directions),
        "determined_to_um": determined_to_um(recovered),
        "worst_half_units": float(np.abs(recovered.misses).max()),
        "readings_half_units": readings_half_units,
        "shipped_is_this": is_shipped(campaign_of(recovered.mean)),
        "harmonics": harmonics_by_force(recovered),
        "open": open_directions(recovered),
        "completions": completions(recovered),
        "tables": tables,
        "table_9": table_9(),
        "figure_values": beside_figures,
        "figures_within": len(beside_figures) - len(figures_off),
        "left_out_N": 112,
        "weak_prior_um": WEAK_UM,
        "band_u": BAND_U,
        "beliefs": beliefs.measure(beliefs.AGAIN if effort == "quick" else beliefs.BELIEFS),
        "figure_off": figures_off,
    }


def draw(results: dict[str, Any]) -> dict[str, Figure]:
    """Figs. 7 to 16, and the harmonics."""
    recovered = recover()
    directions = recovered.open_directions
    set_to_zero = recovered.mean - directions.T @ (directions @ recovered.mean)
    fits = {
        "constant": lb.fit_least_squares(campaign(), 0),
        "linear": lb.fit_least_squares(campaign(), 1),
    }
    tests = campaign().tests
    top_test = tests[-1]
    top_force_N = float(top_test.force_N or 0.0)
    constant_estimates = {test.name: fits["constant"].estimate for test in tests}
    local_estimates = {test.name: local_fit(test).estimate for test in tests}
    linear = lb.HybridModel.first(1)
    comparison = lb.compare({"constant": linear.with_degree(0), "linear": linear}, campaign())
    compliance = lb.figures.compliance_with_local_fits(comparison)
    geometry = lb.figures.geometry_with_local_fits(comparison)
    white_noise = lb.sample(lb.HybridModel.paper(0), campaign(), sampler="independent", seed=1)
    return {
        "beliefs": beliefs.widths_and_shifts(results["beliefs"]),
        "harmonics": harmonics(recovered, set_to_zero, FORCES_N, HARMONICS),
        "fig_07": lb.figures.traces(white_noise, {**lb.figures.WORDS, **LEAST_SQUARES}),
        "fig_08": contributions(campaign(), constant_estimates),
        "fig_09_10": parameter_contributions(fits["constant"].table, top_force_N),
        "fig_11": local_traces(campaign(), pairs()),
        "fig_12": contributions(campaign(), local_estimates),
        "fig_13_14": parameter_contributions(local_fit(top_test).table, top_force_N),
        "fig_15": with_least_squares(compliance, fits, FORCES_N),
        "fig_16": with_least_squares(geometry, fits, FORCES_N),
    }


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    tolerances = {
        "*half_units*": 0.002,
        "*log_bayes_factor*": 0.05,
        "*/evidence": 0.05,
        "*elsewhere/*": 0.05,
        "beliefs/*/mean/C_[XY]*": 0.05,
        "beliefs/*/mean/C_C[XY]*": 0.2,
        "beliefs/*/mean/E_*": 0.5,
        "beliefs/*/curve/*": 0.5,
        "*/delta_um": 0.005,
    }
    long_beliefs = [belief for belief in beliefs.BELIEFS if belief not in beliefs.AGAIN]
    long = tuple(f"beliefs/by_belief/{belief}" for belief in long_beliefs)
    run(Study(HERE, measure, draw, absolute=tolerances, long=long))


if __name__ == "__main__":
    main()
