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
class Open:
    """The null space.

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
    orders = [f(n * angle_rad) for n in (1, 2, 3) for f in (np.cos, np.sin)]
    return np.column_stack([np.ones_like(angle_rad), *orders, np.cos(4.0 * angle_rad)])


def printed_map(campaign: lb.Campaign) -> Array:
    """Every printed number per µm of every harmonic, shape (78, 48), by Eq. 31 on campaigns of one
    harmonic of one circle."""
    names = [test.name for test in campaign.tests]
    windows = [names, *(names[k : k + 2] for k in range(len(names) - 1))]
    columns = []
    for circle in range(len(names)):
        for harmonic in range(len(HARMONICS)):
            shift = np.zeros((len(names), len(HARMONICS)))
            shift[circle, harmonic] = 1.0
            unit = moved(
                replace(
                    campaign,
                    tests=tuple(t.with_reading_um(0.0 * t.reading_um) for t in campaign.tests),
                ),
                shift,
            )
            columns.append(
                np.concatenate(
                    [lb.fit_least_squares(unit.select(own)).table["estimate"] for own in windows]
                )
            )
    return np.column_stack(columns)


@cache
def open_directions() -> Open:
    """Null space, named directions in it, and what the weak prior says of them."""
    campaign = recovered()
    rows = printed_map(campaign)
    singular, right = np.linalg.svd(rows / np.linalg.norm(rows, axis=1, keepdims=True))[1:]
    rank = int(np.sum(singular > _RANK * singular[0]))
    projector = right[rank:].T @ right[rank:]
    lightest = len(HARMONICS) * int(np.argmin(campaign.forces_N))
    unseen = projector[:, [lightest + harmonic for harmonic in DIRECTIONS.values()]]
    directions = unseen / np.linalg.norm(unseen, axis=0)
    lever = (campaign.forces_N - 389.0) / 353.0
    across = LEVEL_UM**2 + TREND_UM**2 * np.outer(lever, lever) + SCATTER_UM**2 * np.eye(len(lever))
    precision = np.kron(np.linalg.inv(across), np.eye(len(HARMONICS)))
    covariance = np.linalg.inv(directions.T @ precision @ directions)
    return Open(
        len(rows), rank, directions, covariance, directions.T @ coefficients(campaign).ravel()
    )


def coefficients(campaign: lb.Campaign) -> Array:
    """Harmonics of every circle, shape (6, 8) [µm]."""
    fits = [
        np.linalg.lstsq(harmonics(test.angles_rad()), test.reading_um, rcond=None)[0]
        for test in campaign.tests
    ]
    return np.array(fits)


def moved(campaign: lb.Campaign, shift_um: Array) -> lb.Campaign:
    """The campaign with harmonics added, shape (6, 8) [µm]."""
    own = zip(campaign.tests, shift_um, strict=True)
    return replace(
        campaign,
        tests=tuple(
            t.with_reading_um(t.reading_um + harmonics(t.angles_rad()) @ s) for t, s in own
        ),
    )


def along(coordinates_um: Array) -> lb.Campaign:
    """The recovered experiment moved along the three directions, shape (3,) [µm]."""
    shift = open_directions().directions @ coordinates_um
    return moved(recovered(), shift.reshape(-1, len(HARMONICS)))


def log_evidence(campaign: lb.Campaign) -> dict[str, float]:
    """ln Z of both models, less that of constant compliance on the experiment as recovered
    [nat]."""
    return {
        name: lb.log_evidence(m, campaign, tolerance=1e-2).log_value - as_recovered()
        for name, m in MODELS.items()
    }


@cache
def as_recovered() -> float:
    """ln Z of constant compliance on the experiment as recovered."""
    return lb.log_evidence(MODELS["constant"], recovered(), tolerance=1e-2).log_value


def row(kind: str, seed: int) -> dict[str, float]:
    """Both log evidences [nat] with the three directions drawn from what the weak prior leaves open
    [µm], or nearer."""
    rng = np.random.default_rng(3000 + seed)
    drawn = (
        SPREAD[kind]
        * np.linalg.cholesky(open_directions().covariance)
        @ rng.standard_normal(len(DIRECTIONS))
    )
    return {**dict(zip(DIRECTIONS, drawn, strict=True)), **log_evidence(along(drawn))}


def measure(drawn: pd.DataFrame) -> dict[str, Any]:
    """Along each direction by prior sd; at the smallest harmonics; drawn, and averaged; without the
    lightest circle."""
    found = open_directions()
    lightest = int(np.argmin(recovered().forces_N))
    paths = {}
    for k, (name, harmonic) in enumerate(DIRECTIONS.items()):
        unit = np.eye(len(DIRECTIONS))[k] * found.sd_um[k]
        steps = STEPS_SD if name == COS_4 else [step for step in STEPS_SD if step == round(step)]
        paths[name] = {
            "sd_um": found.sd_um[k],
            "sd_of_harmonic_um": (
                found.sd_um[k] * found.directions[len(HARMONICS) * lightest + harmonic, k]
            ),
            "steps": {f"{step:+g}": stated(along(step * unit)) for step in steps},
        }
    own = stated(recovered())["log_bayes_factor"]
    cos_4 = coefficients(recovered())[:, 7]
    smallest = along(-found.coordinates_um)
    rest = replace(
        recovered().without(recovered().tests[lightest].name),
        foreseen=(recovered().tests[lightest],),
    )
    exchanged = [
        step["log_bayes_factor"]
        for name, path in paths.items()
        if name != COS_4
        for step in path["steps"].values()
    ]
    return {
        "printed": found.printed,
        "determined": found.determined,
        "lightest_N": recovered().forces_N[lightest],
        "as_recovered": own,
        "cos4_um": cos_4.tolist(),
        "crossing_um": crossing(paths[COS_4], cos_4[lightest], own),
        "paths": paths,
        "largest_step_sd": max(STEPS_SD),
        "exchanges": {"least": min(exchanged), "most": max(exchanged)},
        "smallest": {**stated(smallest), "cos4_um": coefficients(smallest)[lightest, 7]},
        "without_lightest": stated(rest)["log_bayes_factor"],
        "drawn": spread(drawn[drawn["kind"] == "drawn"]),
        "averaged": averaged(drawn[drawn["kind"] == "near"]),
    }


def stated(campaign: lb.Campaign) -> dict[str, float]:
    """ln B(linear/constant), and ln Z of constant compliance less that of the experiment as
    recovered [nat]."""
    found = log_evidence(campaign)
    return {"log_bayes_factor": found["linear"] - found["constant"], "constant": found["constant"]}


def crossing(path: Mapping[str, Any], recovered_um: float, as_recovered: float) -> float:
    """cos 4θ of the lightest circle from which ln B favours linear [µm], interpolated."""
    steps = {0.0: as_recovered} | {
        float(step): own["log_bayes_factor"] for step, own in path["steps"].items()
    }
    x = np.array(sorted(step for step in steps if step >= 0.0))
    return float(
        recovered_um + path["sd_of_harmonic_um"] * np.interp(0.0, [steps[step] for step in x], x)
    )


def spread(drawn: pd.DataFrame) -> dict[str, float]:
    """ln B of completions drawn [nat]."""
    each = (drawn["linear"] - drawn["constant"]).to_numpy()
    p = float((each > 0.0).mean())
    low, median, high = np.quantile(each, [0.05, 0.5, 0.95])
    return {
        "count": len(each),
        "least": each.min(),
        "q5": low,
        "median": median,
        "q95": high,
        "most": each.max(),
        "share_linear": p,
        "share_linear_se": float(np.sqrt(p * (1.0 - p) / len(each))),
    }


def averaged(near: pd.DataFrame) -> dict[str, float]:
    """ln B with each model's evidence averaged over the weak prior, as missing data are [nat]:
    draws nearby, reweighted."""
    coordinates = near[list(DIRECTIONS)].to_numpy()
    square = np.sum(
        coordinates * np.linalg.solve(open_directions().covariance, coordinates.T).T, axis=1
    )
    log_weight = -0.5 * square * (1.0 - SPREAD["near"] ** -2)
    joint = {
        name: np.exp(near[name] - near[name].max() + log_weight - log_weight.max()).to_numpy()
        for name in MODELS
    }
    value = {name: float(np.log(own.mean()) + near[name].max()) for name, own in joint.items()}
    influence = (
        joint["linear"] / joint["linear"].mean() - joint["constant"] / joint["constant"].mean()
    )
    return {
        "log_bayes_factor": value["linear"] - value["constant"],
        "se": float(influence.std(ddof=1) / np.sqrt(len(near))),
        "effective": float(joint["constant"].sum() ** 2 / (joint["constant"] ** 2).sum()),
    }
