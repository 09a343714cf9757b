"""The three directions of the recovered experiment that the tables leave open, and what the
evidence says along them.

The tables print 13 parameters of all six circles and of the five pairs of neighbours, each by Eq.
31 a linear map of 48 harmonics (orders 0 to 3 and cos 4θ of every circle). Its null space is what
no printed number sees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from study import DATA

import ldbb_bayes as lb

Array = NDArray[np.float64]
HARMONICS = ("1", "cos θ", "sin θ", "cos 2θ", "sin 2θ", "cos 3θ", "sin 3θ", "cos 4θ")
# What each direction is called, and the harmonic of the lightest circle of which it is the unseen
# part.
COS_4 = "cos 4θ of the lightest circle"
DIRECTIONS = {"exchange of cos θ and cos 3θ": 1, "exchange of sin θ and sin 3θ": 2, COS_4: 7}
# The weak prior of the recovery [µm]: harmonic = a + b (F − 389 N) / 353 N + scatter.
LEVEL_UM = 20.0
TREND_UM = 30.0
SCATTER_UM = 0.5
MODELS = {"constant": lb.HybridModel.first(0), "linear": lb.HybridModel.first(1)}
STEPS_SD = (-2.0, -1.5, -1.0, -0.5, 0.5, 1.0, 1.5, 2.0)
KINDS = {"drawn": 200, "near": 400}
# Spread of the draws, in that of the weak prior: those nearby are where the evidences are largest.
SPREAD = {"drawn": 1.0, "near": 0.5}
_RANK = 1e-9


@dataclass(frozen=True)
class OpenDirections:
    """The null space of the printed numbers.

    Attributes
    ----------
    printed, determined : int
        Printed numbers, and how many combinations of the harmonics they determine.
    directions : ndarray, shape (48, 3)
        Orthonormal, circle by circle, harmonics in their order.
    covariance : ndarray, shape (3, 3) [µm²]
        Of the coordinates, given what the tables determine: what the weak prior leaves open.
    coordinates_um : ndarray, shape (3,)
        Of the campaign as recovered.
    """

    printed: int
    determined: int
    directions: Array
    covariance: Array
    coordinates_um: Array

    @property
    def sd_um(self) -> Array:
        """Of each coordinate [µm]."""
        return np.sqrt(np.diag(self.covariance))


@cache
def recovered() -> lb.Campaign:
    """The recovered experiment."""
    return lb.read_campaign(DATA / "recovered_experiment")


def harmonics(angle_rad: Array) -> Array:
    """1, cos θ, sin θ … cos 4θ, shape (n, 8)."""
    columns = [np.ones_like(angle_rad)]
    for order in (1, 2, 3):
        columns += [np.cos(order * angle_rad), np.sin(order * angle_rad)]
    return np.column_stack([*columns, np.cos(4.0 * angle_rad)])


def printed_map(campaign: lb.Campaign) -> Array:
    """Every printed number per µm of every harmonic, shape (78, 48), by Eq. 31 on campaigns of one
    harmonic of one circle."""
    zero_tests = [test.with_reading_um(0.0 * test.reading_um) for test in campaign.tests]
    zero_campaign = replace(campaign, tests=tuple(zero_tests))
    circles = len(campaign.tests)
    columns = []
    for circle in range(circles):
        for harmonic in range(len(HARMONICS)):
            change_um = np.zeros((circles, len(HARMONICS)))
            change_um[circle, harmonic] = 1.0
            unit_campaign = with_harmonics_added(zero_campaign, change_um)
            columns.append(estimates_of_the_tables(unit_campaign))
    return np.column_stack(columns)


def estimates_of_the_tables(campaign: lb.Campaign) -> Array:
    """Eq. 31 on all six circles and on every pair of neighbours, shape (78,)."""
    names = [test.name for test in campaign.tests]
    selections = [names]
    for first in range(len(names) - 1):
        selections.append(names[first : first + 2])
    fits = [lb.fit_least_squares(campaign.select(selection)) for selection in selections]
    return np.concatenate([fit.table["estimate"] for fit in fits])


@cache
def open_directions() -> OpenDirections:
    """Null space, named directions in it, and what the weak prior says of them."""
    campaign = recovered()
    rows = printed_map(campaign)
    row_norms = np.linalg.norm(rows, axis=1, keepdims=True)
    _, singular, right = np.linalg.svd(rows / row_norms)
    rank = int(np.sum(singular > _RANK * singular[0]))
    projector = right[rank:].T @ right[rank:]
    first_column = len(HARMONICS) * lightest_circle()
    columns = [first_column + harmonic for harmonic in DIRECTIONS.values()]
    directions = projector[:, columns] / np.linalg.norm(projector[:, columns], axis=0)
    precision_of_circles = np.linalg.inv(weak_prior(campaign.forces_N))
    precision = np.kron(precision_of_circles, np.eye(len(HARMONICS)))
    return OpenDirections(
        printed=len(rows),
        determined=rank,
        directions=directions,
        covariance=np.linalg.inv(directions.T @ precision @ directions),
        coordinates_um=directions.T @ coefficients(campaign).ravel(),
    )


def weak_prior(forces_N: Array) -> Array:
    """Covariance of one harmonic over the circles, shape (6, 6) [µm²]."""
    lever = (forces_N - 389.0) / 353.0
    trend = TREND_UM**2 * np.outer(lever, lever)
    return LEVEL_UM**2 + trend + SCATTER_UM**2 * np.eye(len(lever))


def lightest_circle() -> int:
    """Position of the circle with the smallest force."""
    return int(np.argmin(recovered().forces_N))


def coefficients(campaign: lb.Campaign) -> Array:
    """Harmonics of every circle, shape (6, 8) [µm]."""
    fits = [
        np.linalg.lstsq(harmonics(test.angles_rad()), test.reading_um, rcond=None)[0]
        for test in campaign.tests
    ]
    return np.array(fits)


def with_harmonics_added(campaign: lb.Campaign, change_um: Array) -> lb.Campaign:
    """The campaign with harmonics added, shape (6, 8) [µm]."""
    tests = []
    for test, change in zip(campaign.tests, change_um, strict=True):
        trace_um = harmonics(test.angles_rad()) @ change
        tests.append(test.with_reading_um(test.reading_um + trace_um))
    return replace(campaign, tests=tuple(tests))


def along(coordinates_um: Array) -> lb.Campaign:
    """The recovered experiment changed along the three directions, shape (3,) [µm]."""
    change_um = open_directions().directions @ coordinates_um
    return with_harmonics_added(recovered(), change_um.reshape(-1, len(HARMONICS)))


def log_evidence(campaign: lb.Campaign) -> dict[str, float]:
    """ln Z of both models, less that of constant compliance on the experiment as recovered
    [nat]."""
    differences = {}
    for name, model in MODELS.items():
        evidence = lb.log_evidence(model, campaign, tolerance=1e-2)
        differences[name] = evidence.log_value - log_evidence_as_recovered()
    return differences


@cache
def log_evidence_as_recovered() -> float:
    """ln Z of constant compliance on the experiment as recovered."""
    return lb.log_evidence(MODELS["constant"], recovered(), tolerance=1e-2).log_value


def row(kind: str, seed: int) -> dict[str, float]:
    """Both log evidences [nat] with the three directions drawn from what the weak prior leaves open
    [µm], or nearer."""
    rng = np.random.default_rng(3000 + seed)
    root = SPREAD[kind] * np.linalg.cholesky(open_directions().covariance)
    coordinates_um = root @ rng.standard_normal(len(DIRECTIONS))
    by_direction = dict(zip(DIRECTIONS, coordinates_um, strict=True))
    return {**by_direction, **log_evidence(along(coordinates_um))}


def measure(drawn_rows: pd.DataFrame) -> dict[str, Any]:
    """Along each direction by prior sd; at the smallest harmonics; drawn, and averaged; without the
    lightest circle."""
    campaign = recovered()
    lightest = lightest_circle()
    null_space = open_directions()
    paths = {name: path_along(name) for name in DIRECTIONS}
    as_recovered = evidences(campaign)["log_bayes_factor"]
    cos_4_um = coefficients(campaign)[:, DIRECTIONS[COS_4]]
    smallest = along(-null_space.coordinates_um)
    smallest_cos_4_um = coefficients(smallest)[lightest, DIRECTIONS[COS_4]]
    exchanges = []
    for name, path in paths.items():
        if name != COS_4:
            exchanges += [step["log_bayes_factor"] for step in path["steps"].values()]
    return {
        "printed": null_space.printed,
        "determined": null_space.determined,
        "lightest_N": campaign.forces_N[lightest],
        "as_recovered": as_recovered,
        "cos4_um": cos_4_um.tolist(),
        "crossing_um": crossing(paths[COS_4], cos_4_um[lightest], as_recovered),
        "paths": paths,
        "largest_step_sd": max(STEPS_SD),
        "exchanges": {"least": min(exchanges), "most": max(exchanges)},
        "smallest": {**evidences(smallest), "cos4_um": smallest_cos_4_um},
        "without_lightest": evidences(without_lightest_circle())["log_bayes_factor"],
        "drawn": spread(drawn_rows[drawn_rows["kind"] == "drawn"]),
        "averaged": averaged(drawn_rows[drawn_rows["kind"] == "near"]),
    }


def path_along(name: str) -> dict[str, Any]:
    """ln B and ln Z at steps of the prior sd along one direction: whole steps, of cos 4θ halves
    too."""
    null_space = open_directions()
    index = list(DIRECTIONS).index(name)
    sd_um = null_space.sd_um[index]
    column = len(HARMONICS) * lightest_circle() + DIRECTIONS[name]
    coordinates_um = np.zeros(len(DIRECTIONS))
    coordinates_um[index] = sd_um
    steps = {}
    for step in STEPS_SD:
        if name == COS_4 or step == round(step):
            steps[f"{step:+g}"] = evidences(along(step * coordinates_um))
    return {
        "sd_um": sd_um,
        "sd_of_harmonic_um": sd_um * null_space.directions[column, index],
        "steps": steps,
    }


def without_lightest_circle() -> lb.Campaign:
    """The recovered experiment without the circle of the smallest force, which it foresees."""
    test = recovered().tests[lightest_circle()]
    return replace(recovered().without(test.name), foreseen=(test,))


def evidences(campaign: lb.Campaign) -> dict[str, float]:
    """ln B(linear/constant), and ln Z of constant compliance less that of the experiment as
    recovered [nat]."""
    evidence = log_evidence(campaign)
    return {
        "log_bayes_factor": evidence["linear"] - evidence["constant"],
        "constant": evidence["constant"],
    }


def crossing(path: Mapping[str, Any], recovered_um: float, as_recovered: float) -> float:
    """cos 4θ of the lightest circle from which ln B favours linear [µm], interpolated."""
    log_bayes_factors = {0.0: as_recovered}
    for step, evidence in path["steps"].items():
        if float(step) > 0.0:
            log_bayes_factors[float(step)] = evidence["log_bayes_factor"]
    steps_sd = sorted(log_bayes_factors)
    values = [log_bayes_factors[step] for step in steps_sd]
    step_at_zero = np.interp(0.0, values, steps_sd)
    return float(recovered_um + path["sd_of_harmonic_um"] * step_at_zero)


def spread(drawn_rows: pd.DataFrame) -> dict[str, float]:
    """ln B of completions drawn [nat]."""
    log_bayes_factor = (drawn_rows["linear"] - drawn_rows["constant"]).to_numpy()
    count = len(log_bayes_factor)
    share = float((log_bayes_factor > 0.0).mean())
    low, median, high = np.quantile(log_bayes_factor, [0.05, 0.5, 0.95])
    return {
        "count": count,
        "least": log_bayes_factor.min(),
        "q5": low,
        "median": median,
        "q95": high,
        "most": log_bayes_factor.max(),
        "share_linear": share,
        "share_linear_se": float(np.sqrt(share * (1.0 - share) / count)),
    }


def averaged(near_rows: pd.DataFrame) -> dict[str, float]:
    """ln B with each model's evidence averaged over the weak prior, as missing data are [nat]:
    draws nearby, reweighted."""
    coordinates_um = near_rows[list(DIRECTIONS)].to_numpy()
    whitened = np.linalg.solve(open_directions().covariance, coordinates_um.T).T
    distance = np.sum(coordinates_um * whitened, axis=1)
    log_weight = -0.5 * distance * (1.0 - SPREAD["near"] ** -2)
    log_weight = log_weight - log_weight.max()
    weighted = {}
    log_mean = {}
    for name in MODELS:
        largest = near_rows[name].max()
        weighted[name] = np.exp(near_rows[name] - largest + log_weight).to_numpy()
        log_mean[name] = float(np.log(weighted[name].mean()) + largest)
    constant = weighted["constant"]
    linear = weighted["linear"]
    influence = linear / linear.mean() - constant / constant.mean()
    return {
        "log_bayes_factor": log_mean["linear"] - log_mean["constant"],
        "se": float(influence.std(ddof=1) / np.sqrt(len(near_rows))),
        "effective": float(constant.sum() ** 2 / (constant**2).sum()),
    }
