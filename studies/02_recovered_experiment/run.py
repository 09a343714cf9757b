"""The published experiment given back by its printed numbers: what they determine, and Tables 5 to
9 and Figs. 7 to 16 anew.

python studies/02_recovered_experiment/run.py            # fails when a stated number is not
reproduced python studies/02_recovered_experiment/run.py --write    # states anew
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

HARMONICS = ("1", "cos θ", "sin θ", "cos 2θ", "sin 2θ", "cos 3θ", "sin 3θ", "cos 4θ")
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


def named_directions(found: Recovered) -> dict[str, np.ndarray]:
    """Orthonormal open directions by name, each (48,): the unseen parts of three harmonics of the
    lowest force."""
    projector = found.open_directions.T @ found.open_directions
    exchanges = ("exchange of cos θ and cos 3θ", "exchange of sin θ and sin 3θ")
    unseen = {name: projector[:, 1 + k] for k, name in enumerate(exchanges)}
    unseen |= {"cos 4θ at the lowest force": projector[:, 7]}
    return {name: own / np.linalg.norm(own) for name, own in unseen.items()}


def open_directions(found: Recovered) -> dict[str, Any]:
    """What the tables leave open, and how far the weak prior narrows it."""
    named = named_directions(found)
    basis = np.array(list(named.values()))
    zero = found.mean - basis.T @ (basis @ found.mean)
    sd = {name: float(np.sqrt(own @ found.covariance @ own)) for name, own in named.items()}
    alternate = np.array([1.0, -1.0] * 3)
    expected = {
        name: np.outer(alternate, [0.0, *shape]).ravel() / np.sqrt(2 * FORCES_N.size)
        for name, shape in zip(named, ((1, 0, 0, 0, 1, 0, 0), (0, 1, 0, 0, 0, -1, 0)), strict=False)
    }
    return {
        "count": len(found.open_directions),
        "orthonormal": bool(np.allclose(basis @ basis.T, np.eye(len(basis)), atol=1e-6)),
        "sd_um": sd,
        "in_one_um": next(iter(sd.values())) / float(np.sqrt(2 * FORCES_N.size)),
        "alternating": {
            name: bool(np.allclose(named[name], own, atol=1e-4)) for name, own in expected.items()
        },
        "cos4_at_lowest_um": {
            "recovered": float(found.mean[7]),
            "sd": float(found.sd[7]),
            "set to zero": float(zero[7]),
        },
        "largest_other_change_um": float(np.abs(np.delete(zero - found.mean, 7)).max()),
    }


def _determined_to(found: Recovered) -> float:
    """Largest sd of a harmonic with its part along the open directions left out [µm]."""
    along = found.open_directions
    rest = np.eye(along.shape[1]) - along.T @ along
    return float(np.sqrt(np.diag(rest @ found.covariance @ rest)).max())


def completions(found: Recovered) -> dict[str, Any]:
    """Posterior of what depends most on the completion, under the first edition with constant
    compliance."""
    named = named_directions(found)
    made = {
        "as recovered": found.mean,
        "set to zero": found.mean - sum((own @ found.mean) * own for own in named.values()),
    }
    for name, own in named.items():
        step = np.sqrt(own @ found.covariance @ own) * own
        made |= {
            f"{name}, {word}": found.mean + sign * step
            for word, sign in (("+ 1 u", 1.0), ("− 1 u", -1.0))
        }
    rows = {}
    for name, values in made.items():
        table = lb.inference.marginalize(CONSTANT, campaign_of(values), tolerance=1e-2)
        rows[name] = {
            p: {"mean": float(table.loc[p, "mean"]), "sd": float(table.loc[p, "sd"])}
            for p in table.index
        }
    base = rows["as recovered"]
    moved = {
        p: max(abs(row[p]["mean"] - base[p]["mean"]) / base[p]["sd"] for row in rows.values())
        for p in base
    }
    largest = max(moved, key=lambda name: moved[name])
    kept = ("C_CXY", "C_CYY", "C_CCY", "delta", "kappa")
    return {
        "parameters": {name: {p: row[p] for p in kept} for name, row in rows.items()},
        "largest_move_in_u": moved[largest],
        "which": largest,
        "range": {
            p: [f(row[p]["mean"] for row in rows.values()) for f in (min, max)] for p in kept
        },
        "least_squares_unchanged": (
            max(_change(campaign_of(values)) for values in made.values()) < 1e-9
        ),
    }


def _change(other: lb.Campaign) -> float:
    """Largest relative change of the estimates of Eq. 31."""
    own, new = (lb.fit_least_squares(one).table["estimate"] for one in (campaign(), other))
    return float((new / own - 1.0).abs().max())


def tables_5_to_8() -> dict[str, list[dict[str, Any]]]:
    """Every printed number beside the estimate of Eq. 31 from the shipped readings."""
    whole = lb.fit_least_squares(campaign())
    local = {tuple(float(name[1:]) for name in pair): found for pair, found in pairs().items()}
    found: dict[str, list[dict[str, Any]]] = {}
    for number, stem in enumerate(
        (
            "global_compliances",
            "global_geometric_errors",
            "local_compliances",
            "local_geometric_errors",
        ),
        start=5,
    ):
        rows = []
        for _, row in pd.read_csv(TABLES / f"table_{number}_{stem}.csv", dtype=str).iterrows():
            forces = [name for name in row.index if name.startswith("force_")]
            squares = local[tuple(float(row[name]) for name in forces)] if forces else whole
            rows += [
                _cell(row[name], name, squares, " and ".join(row[f] for f in forces))
                for name in row.index.drop(forces)
            ]
        found[str(number)] = rows
    return found


def _cell(
    printed: str, name: str, squares: lb.inference.LeastSquares, forces: str
) -> dict[str, Any]:
    value, u = squares.table.loc[in_code(name), ["estimate", "u"]]
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
        column: lb.fit_least_squares(campaign(), degree).quality
        for degree, column in enumerate(("constant", "linear"))
    }
    rows: dict[str, Any] = {}
    for test in campaign().tests:
        span = float(np.ptp(np.asarray(test.reading_um)))
        quality = fits | {"local": pairs()[upper_pair(pairs(), test.name)].quality}
        stated = printed.loc[float(test.force_N or 0.0)]
        rows[f"{test.force_N:g}"] = {
            "span_um": span,
            **{
                column: {
                    "printed": float(stated[f"{column}_percent"]),
                    "own": own.fitness_percent[test.name],
                    "all": 100.0 * (1.0 - own.rmse_um / span),
                }
                for column, own in quality.items()
            },
            "ratio": float(
                (100.0 - stated["linear_percent"]) / (100.0 - stated["constant_percent"])
            ),
        }
    worst = {
        column: {
            how: max(abs(row[column][how] - row[column]["printed"]) for row in rows.values())
            for how in ("own", "all")
        }
        for column in COLUMNS
    }
    return {
        "rows": rows,
        "worst": worst,
        "printed_rmse_um": {column: 1e3 * value for column, value in PRINTED_RMSE_MM.items()},
        "printed_gain_percent": PRINTED_GAIN_PERCENT,
        "local_pairs": {
            f"{t.force_N:g}": [float(n[1:]) for n in upper_pair(pairs(), t.name)]
            for t in campaign().tests
        },
        "rmse_um": {column: own.rmse_um for column, own in fits.items()},
        "ratios": [row["ratio"] for row in rows.values()],
        "rmse_ratio": fits["linear"].rmse_um / fits["constant"].rmse_um,
        "gain": 1.0 - fits["linear"].rmse_um / fits["constant"].rmse_um,
        "synthetic_um": OUT_OF_BAND_RMS_UM,
    }


def figure_values() -> list[dict[str, Any]]:
    """What the text states beside Figs. 8 to 14, in µm, and the same from the recovered
    readings."""
    top = max(campaign().tests, key=lambda test: test.force_N or 0.0)
    force = float(top.force_N or 0.0)
    whole = lb.fit_least_squares(campaign()).estimate
    last = pairs()[upper_pair(pairs(), top.name)].estimate
    geometry = np.array([part_um(own.estimate, force, start="E_") for own in pairs().values()])
    known = {
        "8b compliance largest": part_um(whole, force, start="C_").max(),
        "8b compliance smallest": min(0.0, part_um(whole, force, start="C_").min()),
        "8c geometry largest": part_um(whole, force, start="E_").max(),
        "8c geometry smallest": part_um(whole, force, start="E_").min(),
        "12 change of geometry with force": np.ptp(geometry, axis=0).max(),
    }
    jacobian = lb.machine.hybrid_jacobian(
        lb.Machine(), lb.machine.Circle(), np.deg2rad(np.arange(360.0)), force
    )
    size = np.ptp(jacobian.to_numpy(), axis=0) * 1e3
    for number, kind, estimate in (
        ("9", "C_", whole),
        ("10", "E_", whole),
        ("13", "C_", last),
        ("14", "E_", last),
    ):
        for name, swing in zip(jacobian.columns, size, strict=True):
            if name.startswith(kind):
                known[f"{number} {name.replace('C0YX', 'C(0Y)X')}"] = abs(estimate[name]) * swing
    stated = pd.read_csv(TABLES / "figure_values.csv", dtype=str)
    rows = []
    for _, row in stated.iterrows():
        value = float(known[f"{row['figure']} {row['quantity']}"])
        text = row["printed_mm"]
        printed = float(text) * 1e3
        unit = 2.0 * half_unit(text) * 1e3
        rows.append(
            {
                "figure": row["figure"],
                "quantity": row["quantity"],
                "printed_um": printed,
                "returned_um": value,
                "units_of_last_digit": abs(abs(value) - abs(printed)) / unit,
            }
        )
    return rows


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the pages state."""
    found = recover()
    mean = found.mean.reshape(6, 8)
    sd = found.sd.reshape(6, 8)
    tables = tables_5_to_8()
    beside = figure_values()
    shipped = campaign_of(found.mean)
    return {
        "forces_N": FORCES_N.tolist(),
        "printed_numbers": len(found.numbers),
        "dimensions": found.jacobian.shape[1],
        "determined": found.jacobian.shape[1] - len(found.open_directions),
        "determined_to_um": _determined_to(found),
        "worst_half_units": float(np.abs(found.misses).max()),
        "readings_half_units": {
            number: max(row["half_units"] for row in rows) for number, rows in tables.items()
        },
        "shipped_is_this": all(
            np.allclose(np.asarray(a.reading_um), np.asarray(b.reading_um), rtol=0.0, atol=1e-6)
            for a, b in zip(shipped.tests, campaign().tests, strict=True)
        ),
        "harmonics": {
            f"{force:g}": {
                name: {"mean": mean[r, k], "sd": sd[r, k]} for k, name in enumerate(HARMONICS)
            }
            for r, force in enumerate(FORCES_N)
        },
        "open": open_directions(found),
        "completions": completions(found),
        "tables": tables,
        "table_9": table_9(),
        "figure_values": beside,
        "figures_within": sum(row["units_of_last_digit"] <= 1.0 for row in beside),
        "left_out_N": 112,
        "weak_prior_um": WEAK_UM,
        "band_u": BAND_U,
        "beliefs": beliefs.measure(beliefs.AGAIN if effort == "quick" else [*beliefs.BELIEFS]),
        "figure_off": [
            f"{row['quantity']} (Fig. {row['figure']})"
            for row in beside
            if row["units_of_last_digit"] > 1.0
        ],
    }


def draw(results: dict[str, Any]) -> dict[str, Figure]:
    """Figs. 7 to 16, and the harmonics."""
    found = recover()
    whole = campaign()
    fits = {"constant": lb.fit_least_squares(whole), "linear": lb.fit_least_squares(whole, 1)}
    top = whole.tests[-1]
    force = float(top.force_N or 0.0)
    local = {test.name: pairs()[upper_pair(pairs(), test.name)] for test in whole.tests}
    linear = lb.HybridModel.first(1)
    compared = lb.compare({"constant": linear.with_degree(0), "linear": linear}, whole)
    fitted = lb.sample(lb.HybridModel.paper(0), whole, sampler="independent", seed=1)
    along = found.open_directions
    zero = found.mean - along.T @ (along @ found.mean)
    return {
        "beliefs": beliefs.widths_and_shifts(results["beliefs"]),
        "harmonics": harmonics(
            *(v.reshape(6, 8) for v in (found.mean, found.sd, zero)), FORCES_N, HARMONICS
        ),
        "fig_07": lb.figures.traces(fitted, {**lb.figures.WORDS, **LEAST_SQUARES}),
        "fig_08": contributions(whole, dict.fromkeys(local, fits["constant"].estimate)),
        "fig_09_10": parameter_contributions(fits["constant"].table, force),
        "fig_11": local_traces(whole, pairs()),
        "fig_12": contributions(whole, {name: own.estimate for name, own in local.items()}),
        "fig_13_14": parameter_contributions(local[top.name].table, force),
        "fig_15": with_least_squares(
            lb.figures.compliance_with_local_fits(compared), fits, FORCES_N
        ),
        "fig_16": with_least_squares(lb.figures.geometry_with_local_fits(compared), fits, FORCES_N),
    }


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    near = {
        "*half_units*": 0.002,
        "*log_bayes_factor*": 0.05,
        "*/evidence": 0.05,
        "*elsewhere/*": 0.05,
    }
    near |= {
        "beliefs/*/mean/C_[XY]*": 0.05,
        "beliefs/*/mean/C_C[XY]*": 0.2,
        "beliefs/*/mean/E_*": 0.5,
        "beliefs/*/curve/*": 0.5,
        "*/delta_um": 0.005,
    }
    long = tuple(
        f"beliefs/by_belief/{belief}" for belief in beliefs.BELIEFS if belief not in beliefs.AGAIN
    )
    run(Study(HERE, measure, draw, absolute=near, long=long))


if __name__ == "__main__":
    main()
