"""Campaigns of several radii, directions and planes, everything drawn from its prior: what the
analysis says of the truth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from plans import MODEL, both_directions, mostly_clockwise, one_radius, three_planes, two_radii

import ldbb_bayes as lb

# Machines with friction, of which the circles clockwise alone are analysed.
CLOCKWISE = {"five clockwise": both_directions, "ten clockwise": mostly_clockwise}
PLANS = {
    "one radius": one_radius,
    "two radii": two_radii,
    "both directions": both_directions,
    "three planes": three_planes,
}
SHOWN = ("E_C0YX", "E_YX2", "E_XY2", "C_XYX", "C_XXX")
FIRST_SEED = 5000
DEFAULT = lb.HybridModel.default(degree=1)
LEVEL = 0.95


def analysed(kind: str, seed: int) -> Mapping[str, float]:
    """What the first edition says of a machine of its own, see `said_by`."""
    return said_by(MODEL, kind, seed)


def analysed_by_default(kind: str, seed: int) -> Mapping[str, float]:
    """What the default model, the third edition, says of the same campaign."""
    return said_by(DEFAULT, kind, seed)


def said_by(model: lb.HybridModel, kind: str, seed: int) -> Mapping[str, float]:
    """Of every parameter the posterior probability below the truth; of those shown u and error
    (mean − truth) as well."""
    plan = (PLANS | CLOCKWISE)[kind]()
    simulation = MODEL.simulate(plan, seed=FIRST_SEED + seed)
    campaign = simulation.campaign
    if kind in CLOCKWISE:
        clockwise = [test.name for test in campaign.tests if test.direction == "CW"]
        campaign = campaign.select(clockwise)
    draws = lb.sample(model, campaign, sampler="independent", seed=seed)["posterior"]
    row = {}
    for name, truth in simulation.parameters.items():
        values = draws[name].to_numpy().ravel()
        row[f"{name} below"] = np.mean(values < truth)
        if name in SHOWN:
            row[f"{name} u"] = values.std()
            row[f"{name} error"] = values.mean() - truth
    return row


def summary(rows: pd.DataFrame) -> dict[str, Any]:
    """Coverage of every parameter; root mean squares of u and error of those shown."""
    return {str(kind): of_kind(group) for kind, group in rows.groupby("kind")}


def of_kind(rows: pd.DataFrame) -> dict[str, Any]:
    """The same of one kind of campaigns; columns without numbers are of parameters it lacks."""
    rows = rows.dropna(axis="columns")
    coverage = {}
    for column in rows.filter(regex=" below$"):
        is_inside = (rows[column] - 0.5).abs() < 0.5 * LEVEL
        coverage[column.removesuffix(" below")] = float(is_inside.mean())
    errors = {}
    for name in SHOWN:
        if f"{name} u" in rows:
            errors[name] = {
                "u": root_mean_square(rows[f"{name} u"]),
                "error": root_mean_square(rows[f"{name} error"]),
                "coverage": coverage[name],
            }
    return {
        "campaigns": len(rows),
        "parameters": len(coverage),
        "coverage": coverage,
        "shown": errors,
    }


def root_mean_square(values: pd.Series) -> float:
    """Root of the mean square."""
    return float(np.sqrt((values**2).mean()))
