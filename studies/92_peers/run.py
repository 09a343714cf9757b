"""Side by side with the field: least squares with a GUM budget, a Gaussian process as discrepancy,
and the package.

python studies/92_peers/run.py            # fails when a stated number is not reproduced
python studies/92_peers/run.py --write    # states anew; needs the package of the Gaussian process:
pip install '.[bench]'
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

import ldbb_bayes as lb
from ldbb_bayes.campaign.run_times import SECONDS_PER_TEST
from ldbb_bayes.parallel import one_blas_thread

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "12_real_machines"), str(HERE)]
import gaussian_process
import package_models
from least_squares import by_least_squares
from machines import FAMILIES, FORCES_N, RADIUS_MM, READINGS, simulate
from readings import (
    MODEL,
    READINGS_OF_A_CIRCLE,
    SETUP_UM,
    Answer,
    Array,
    evenly_picked,
    picked_readings_um,
)
from study import DATA, Effort, Study, replicated, run

RECOVERED = "recovered experiment"
MEASURED = lb.read_campaign(DATA / "recovered_experiment")
# Machines simulated by the linear model, and the families of study 12 simulated exactly.
SIMULATED_BY_MODEL = {
    "white noise alone": replace(MODEL, nuisances=()),
    "as the model says": MODEL,
}
SIMULATED_EXACTLY = {
    "mild": "mild",
    "ball of one lobe": "one lobe",
    "joints in contact": "contact",
    "warm-up and seals": "warm-up, seals",
}
SIMULATED = (*SIMULATED_BY_MODEL, *SIMULATED_EXACTLY)
# Campaigns of every kind of simulated machine; campaigns on which every method is timed.
CAMPAIGNS = 15
TIMED = 3
# Of the recovered experiment every circle is left out once.
KINDS = {RECOVERED: len(MEASURED.tests), **dict.fromkeys(SIMULATED, CAMPAIGNS)}
MADE_AGAIN: dict[Effort, int] = {"quick": 2, "usual": 4}

PARAMETERS = MODEL.bind(MEASURED).names
SLOPES = [name for name in PARAMETERS if name.startswith("C") and name.endswith("_1")]
GROUPS = {
    "compliances": [name for name in PARAMETERS if name.startswith("C") and name not in SLOPES],
    "slopes": SLOPES,
    "geometric errors": [name for name in PARAMETERS if name.startswith("E")],
}

PROCESS = "Gaussian process"
SQUARES_SHORT = "least squares, short budget"
SQUARES_FULL = "least squares, full budget"
PROCESS_SHORT = f"{PROCESS}, short budget"
PROCESS_FULL = f"{PROCESS}, full budget"
# The package's default model, and the average over models.
OURS = "linear"
AVERAGED = "averaged"
METHODS = (SQUARES_SHORT, SQUARES_FULL, PROCESS_SHORT, PROCESS_FULL, OURS)
LABELS = {name: name for name in METHODS} | {OURS: "ours"}
COLOURS = {
    SQUARES_SHORT: "#c44e52",
    SQUARES_FULL: "#c44e52",
    PROCESS_SHORT: "#8172b2",
    PROCESS_FULL: "#8172b2",
    OURS: "#4c72b0",
}
CIRCLE_COLUMNS = ("score", "inside", "width")
# 2/α of a 95 % interval: its interval score adds so many times the distance of what lies outside.
PENALTY_OUTSIDE = 40.0
STATED = HERE / "results.json"

Method = Callable[..., Answer]


def campaign_of(kind: str, seed: int) -> tuple[lb.Campaign, dict[str, float] | None]:
    """A campaign and its true parameters, where they are known."""
    if kind == RECOVERED:
        return MEASURED, None
    if kind in SIMULATED_BY_MODEL:
        angle_deg = np.arange(0.0, 360.0, 360.0 / READINGS)
        tests = tuple(lb.CircularTest(force_N, angle_deg) for force_N in FORCES_N)
        plan = lb.Plan(tests, radius_mm=RADIUS_MM)
        simulation = SIMULATED_BY_MODEL[kind].simulate(plan, seed=seed)
        return simulation.campaign, simulation.parameters
    campaign, machine = simulate(FAMILIES[SIMULATED_EXACTLY[kind]], seed)
    return campaign, machine.truth


def without_one(campaign: lb.Campaign, seed: int) -> tuple[lb.Campaign, lb.CircularTest]:
    """The campaign without one of its tests, and this test.

    Tests state when they were run, one every six minutes in the order listed, so that the test left
    out keeps its place in time.
    """
    timed = []
    for position, test in enumerate(campaign.tests):
        timed.append(replace(test, time_s=SECONDS_PER_TEST * position))
    left_out = seed % len(timed)
    remaining = tuple(timed[:left_out] + timed[left_out + 1 :])
    return replace(campaign, tests=remaining), timed[left_out]


def least_squares_methods() -> dict[str, Method]:
    """Least squares with either budget."""
    return {
        SQUARES_SHORT: partial(by_least_squares, full=False),
        SQUARES_FULL: partial(by_least_squares, full=True),
    }


def process_methods(seed: int) -> dict[str, Method]:
    """The Gaussian process with either budget."""
    calibrate = partial(gaussian_process.by_gaussian_process, seed=seed)
    return {
        PROCESS_SHORT: partial(calibrate, full=False),
        PROCESS_FULL: partial(calibrate, full=True),
    }


def default_method(seed: int) -> dict[str, Method]:
    """The package's default model."""
    return {OURS: partial(package_models.by_default_model, seed=seed)}


def averaged_method(seed: int) -> dict[str, Method]:
    """The package's average over models."""
    return {AVERAGED: partial(package_models.by_average_of_models, seed=seed)}


def row_of(methods: Mapping[str, Method], kind: str, seed: int) -> dict[str, float]:
    """One campaign by every method, as a row of the table that is kept."""
    campaign, truth = campaign_of(kind, seed)
    row = dict[str, float]()
    for name, method in methods.items():
        row |= interval_columns(name, method, campaign, truth)
        row |= circle_columns(name, method, campaign, seed)
    return row


def interval_columns(
    name: str, method: Method, campaign: lb.Campaign, truth: dict[str, float] | None
) -> dict[str, float]:
    """Ends of the intervals of the parameters less the truth; NaN where it is not known."""
    columns = {}
    if truth is None:
        for parameter in PARAMETERS:
            columns[f"{name}/{parameter}/low"] = np.nan
            columns[f"{name}/{parameter}/high"] = np.nan
        return columns
    interval = method(campaign).interval
    for parameter, low, high in zip(PARAMETERS, *interval, strict=True):
        columns[f"{name}/{parameter}/low"] = low - truth[parameter]
        columns[f"{name}/{parameter}/high"] = high - truth[parameter]
    return columns


def circle_columns(name: str, method: Method, campaign: lb.Campaign, seed: int) -> dict[str, float]:
    """Of the circle left out: mean log density of its readings [nat, per µm], the share of them
    inside the band, and mean width of the band [µm]."""
    remaining, left_out = without_one(campaign, seed)
    prediction = method(remaining, left_out).circle
    assert prediction is not None
    reading_um = picked_readings_um(left_out)
    low_um, high_um = prediction.band_um
    inside = (low_um <= reading_um) & (reading_um <= high_um)
    return {
        f"{name}/score": prediction.log_density.mean(),
        f"{name}/inside": inside.mean(),
        f"{name}/width": (high_um - low_um).mean(),
    }


def without_process(kind: str, seed: int) -> dict[str, float]:
    """A campaign by least squares and the default model; the measured one by the average too."""
    row = row_of(least_squares_methods() | default_method(seed), kind, seed)
    averaged = {f"{AVERAGED}/{column}": np.nan for column in CIRCLE_COLUMNS}
    if kind == RECOVERED:
        averaged_row = row_of(averaged_method(seed), kind, seed)
        averaged = {column: averaged_row[column] for column in averaged}
    return row | averaged


def with_process(kind: str, seed: int) -> dict[str, float]:
    """A campaign by the Gaussian process."""
    return row_of(process_methods(seed), kind, seed)


def all_rows(effort: Effort) -> pd.DataFrame:
    """Every campaign by every method.

    The rows of the Gaussian process are made again where its package is installed.
    """
    rows = replicated(HERE / "campaigns.csv", without_process, KINDS, effort, again=MADE_AGAIN)
    path = HERE / "gaussian_process.csv"
    if gaussian_process.HAS_PACKAGE:
        process_rows = replicated(
            path, with_process, KINDS, effort, again=MADE_AGAIN, tolerance=0.1
        )
    elif effort == "write":
        raise lb.InputError(
            "ACBICI must be installed to state anew, got none. Install it: pip install '.[bench]'"
        )
    else:
        print(
            "ACBICI is not installed: what the Gaussian process said is taken as kept. pip install"
            " '.[bench]' has it made again."
        )
        process_rows = pd.read_csv(path)
    return rows.merge(process_rows, on=["kind", "seed"], validate="one_to_one")


def parameter_scores(rows: pd.DataFrame) -> dict[str, Any]:
    """How the intervals of the parameters do, by method.

    Coverage of all parameters with its standard error over campaigns, and that of groups; median
    width and mean interval score over ours, geometric means over the parameters.
    """
    our_low, our_high = interval_ends(rows, OURS)
    our_width = our_high - our_low
    our_score = interval_score(our_low, our_high)
    scores = {}
    for method in METHODS:
        low, high = interval_ends(rows, method)
        inside = (low <= 0.0) & (high >= 0.0)
        coverage_by_campaign = inside.mean(axis=1)
        median_width_ratio = np.median((high - low) / our_width, axis=0)
        mean_score_ratio = interval_score(low, high).mean(axis=0) / our_score.mean(axis=0)
        scores[method] = {
            "coverage": float(inside.mean()),
            "se": float(coverage_by_campaign.std(ddof=1) / np.sqrt(len(rows))),
            "groups": coverage_by_group(inside),
            "width": geometric_mean(median_width_ratio),
            "score": geometric_mean(mean_score_ratio),
        }
    return scores


def interval_ends(rows: pd.DataFrame, method: str) -> tuple[Array, Array]:
    """Lower and upper ends of the intervals less the truth, each (campaigns, parameters)."""
    low = rows[[f"{method}/{name}/low" for name in PARAMETERS]].to_numpy()
    high = rows[[f"{method}/{name}/high" for name in PARAMETERS]].to_numpy()
    return low, high


def interval_score(low: Array, high: Array) -> Array:
    """Interval score (Gneiting and Raftery 2007) of intervals less the truth; less is better."""
    distance_outside = np.maximum(low, 0.0) + np.maximum(-high, 0.0)
    return np.asarray((high - low) + PENALTY_OUTSIDE * distance_outside)


def coverage_by_group(inside: Array) -> dict[str, float]:
    """Share of the intervals, shape (campaigns, parameters), that hold the truth, by group."""
    coverage = {}
    for group, names in GROUPS.items():
        columns = [PARAMETERS.index(name) for name in names]
        coverage[group] = float(inside[:, columns].mean())
    return coverage


def geometric_mean(ratios: Array) -> float:
    """Of positive numbers."""
    return float(np.exp(np.log(ratios).mean()))


def circle_scores(rows: pd.DataFrame) -> dict[str, Any]:
    """How the circles left out are predicted, by method that predicts all of them.

    Log score, its difference from ours with standard error, coverage with standard error, width.
    """
    scores = {}
    for method in (*METHODS, AVERAGED):
        log_score = rows[f"{method}/score"]
        if log_score.isna().any():
            continue
        gain = log_score - rows[f"{OURS}/score"]
        inside = rows[f"{method}/inside"]
        scores[method] = {
            "score": float(log_score.mean()),
            "inside": float(inside.mean()),
            "width": float(rows[f"{method}/width"].mean()),
            "gain": float(gain.mean()),
            "gain_se": float(gain.std(ddof=1) / np.sqrt(len(gain))),
            "inside_se": float(inside.std(ddof=1) / np.sqrt(len(rows))),
        }
    return scores


def scores_by_force(rows: pd.DataFrame) -> dict[str, Any]:
    """Of the measured campaign: log score, coverage and width of every circle, by its force."""
    measured = rows[rows["kind"] == RECOVERED].sort_values("seed")
    scores = {}
    for test, (_, row) in zip(MEASURED.tests, measured.iterrows(), strict=True):
        scores[f"{test.force_N:.0f}"] = {
            method: circle_scores_of_row(row, method) for method in (*METHODS, AVERAGED)
        }
    return scores


def circle_scores_of_row(row: pd.Series, method: str) -> dict[str, float]:
    """Log score, coverage and width of one circle by one method."""
    return {column: float(row[f"{method}/{column}"]) for column in CIRCLE_COLUMNS}


def left_out_circle(position: int) -> dict[str, Any]:
    """A circle of the measured campaign that was left out: readings and bands less the
    least-squares prediction [µm]."""
    remaining, left_out = without_one(MEASURED, position)
    methods = least_squares_methods()
    if gaussian_process.HAS_PACKAGE:
        methods |= process_methods(position)
    methods |= default_method(position)
    bands_um = {}
    for name, method in methods.items():
        prediction = method(remaining, left_out).circle
        assert prediction is not None
        bands_um[name] = prediction.band_um
    middle_um = bands_um[SQUARES_FULL].mean(axis=0)
    bands = {name: (band_um - middle_um).tolist() for name, band_um in bands_um.items()}
    if not gaussian_process.HAS_PACKAGE:
        stated_bands = stated("shown")["band_um"]
        bands |= {name: stated_bands[name] for name in (PROCESS_SHORT, PROCESS_FULL)}
    return {
        "force_N": left_out.force_N,
        "angle_deg": left_out.angle_deg[evenly_picked(left_out)].tolist(),
        "reading_um": (picked_readings_um(left_out) - middle_um).tolist(),
        "band_um": bands,
    }


def stated(name: str) -> Any:
    """What is stated under this name."""
    return json.loads(STATED.read_text(encoding="utf-8"))[name]


@one_blas_thread
def cpu_seconds() -> dict[str, float]:
    """Median CPU seconds of every method for the intervals of one campaign, in this process and one
    thread."""
    methods = least_squares_methods() | process_methods(1) | default_method(1) | averaged_method(1)
    seconds: dict[str, list[float]] = {name: [] for name in methods}
    for seed in range(TIMED):
        campaign, _ = simulate(FAMILIES["mild"], seed)
        for name, method in methods.items():
            start = time.process_time()
            method(campaign)
            seconds[name].append(time.process_time() - start)
    return {name: float(np.median(times)) for name, times in seconds.items()}


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the page states; time is measured, and ACBICI as it stands run, with ``--write``
    only."""
    rows = all_rows(effort)
    rows_by_kind = {kind: rows[rows["kind"] == kind] for kind in KINDS}
    results = {
        "campaigns": CAMPAIGNS,
        "readings": READINGS,
        "picked": READINGS_OF_A_CIRCLE,
        "few": gaussian_process.READINGS_SAMPLED,
        "noise_um": gaussian_process.NOISE_UM,
        "discrepancy_um": float(np.sqrt(gaussian_process.DISCREPANCY_UM2)),
        "setup_um": SETUP_UM,
        "forces_N": list(FORCES_N),
        "timed": TIMED,
        "parameters": {kind: parameter_scores(rows_by_kind[kind]) for kind in SIMULATED},
        "circles": {kind: circle_scores(rows_by_kind[kind]) for kind in KINDS},
        "by_force": scores_by_force(rows),
    }
    if effort == "write":
        results["seconds"] = cpu_seconds()
        results["as_it_stands"] = gaussian_process.as_it_stands(MEASURED, seed=1)
    else:
        results["seconds"] = stated("seconds")
        results["as_it_stands"] = stated("as_it_stands")
    if effort != "quick":
        results["shown"] = left_out_circle(len(MEASURED.tests) - 1)
    return results


@lb.figures.styled
def figure(results: dict[str, Any]) -> Figure:
    """A circle that no method was given, and how often intervals hold the truth and how wide they
    are."""
    page = lb.figures.new_figure(11.0, 6.2)
    left, right = page.subfigures(1, 2, width_ratios=(1.0, 1.35))
    draw_left_out_circle(left, results["shown"])
    draw_coverage_and_width(right, results["parameters"])
    return page


def draw_left_out_circle(area: SubFigure, circle: dict[str, Any]) -> None:
    """Readings and 95 % bands of one circle, a panel per method."""
    panels = area.subplots(3, 1, sharex=True, sharey=True)
    for axes, method in zip(panels, (SQUARES_FULL, PROCESS_FULL, OURS), strict=True):
        low, high = circle["band_um"][method]
        axes.fill_between(circle["angle_deg"], low, high, color=COLOURS[method], alpha=0.35, lw=0.0)
        axes.plot(circle["angle_deg"], circle["reading_um"], "k.", ms=4)
        axes.set_title(LABELS[method], fontsize=9, loc="left")
    panels[1].set_ylabel("reading − least-squares prediction (µm)")
    panels[2].set_xlabel("angle (°)")
    panels[2].set_xticks(range(0, 361, 90))
    area.suptitle(
        f"Circle at {circle['force_N']:.0f} N, predicted from the others, 95 % bands", fontsize=10
    )


def draw_coverage_and_width(area: SubFigure, parameters: dict[str, Any]) -> None:
    """Coverage and width of the intervals of parameters, a line per kind of machine."""
    coverage_axes, width_axes = area.subplots(1, 2, sharey=True)
    kinds = list(parameters)
    for position, method in enumerate(METHODS):
        heights = np.arange(len(kinds)) + 0.15 * (position - 2)
        scores = [parameters[kind][method] for kind in kinds]
        draw_method(coverage_axes, width_axes, method, heights, scores)
    coverage_axes.axvline(95.0, color="k", lw=1.0)
    coverage_axes.set_xlabel("95 % intervals that hold the truth (%)")
    coverage_axes.set_xlim(0.0, 103.0)
    width_axes.set_xlim(left=0.0)
    width_axes.set_xlabel("width, ours = 1")
    coverage_axes.set_yticks(range(len(kinds)), kinds)
    coverage_axes.set_ylim(len(kinds) - 0.5, -0.5)
    area.suptitle("Compliances, slopes and geometric errors of simulated machines", fontsize=10)
    area.legend(
        *coverage_axes.get_legend_handles_labels(),
        loc="outside lower center",
        ncols=3,
        fontsize=8,
    )


def draw_method(
    coverage_axes: Axes,
    width_axes: Axes,
    method: str,
    heights: Array,
    scores: list[dict[str, float]],
) -> None:
    """Coverage with two standard errors, and width, of one method; open where the budget is
    short."""
    colour = COLOURS[method]
    inner_colour = colour
    if method in (SQUARES_SHORT, PROCESS_SHORT):
        inner_colour = "white"
    style: dict[str, Any] = {
        "fmt": "o",
        "color": colour,
        "ms": 5,
        "mfc": inner_colour,
        "label": LABELS[method],
    }
    coverage_percent = [100.0 * score["coverage"] for score in scores]
    two_se_percent = [200.0 * score["se"] for score in scores]
    coverage_axes.errorbar(coverage_percent, heights, xerr=two_se_percent, **style)
    width_axes.errorbar([score["width"] for score in scores], heights, **style)


def draw(results: dict[str, Any]) -> dict[str, Figure]:
    """The figures by file name."""
    return {"side_by_side": figure(results)}


if __name__ == "__main__":
    run(Study(HERE, measure, draw, absolute={"shown/*": 0.3}, long=("shown",)))
