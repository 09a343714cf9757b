"""The campaigns of this study: each has what one circle, one radius and one direction lack."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import ldbb_bayes as lb

MODEL = lb.HybridModel.first(degree=1)
FORCES_N = (36.0, 212.0, 389.0, 566.0, 742.0)
ANGLE_DEG = np.arange(360.0)
FIVE_MINUTES_S = 300.0


def circles(**fields: object) -> tuple[lb.CircularTest, ...]:
    """One circle at each force."""
    return tuple(lb.CircularTest(force, ANGLE_DEG, **fields) for force in FORCES_N)


def one_radius() -> lb.Plan:
    """Ten circles of 150 mm."""
    return lb.Plan((*circles(), *circles()), name="one radius")


def two_radii() -> lb.Plan:
    """Five circles of 150 mm, five of 100 mm; no ball is clocked."""
    return lb.Plan((*circles(), *circles(radius_mm=100.0)), name="two radii")


def both_directions() -> lb.Plan:
    """Five circles clockwise, five counterclockwise."""
    return lb.Plan((*circles(direction="CW"), *circles(direction="CCW")), name="both directions")


def mostly_clockwise() -> lb.Plan:
    """Ten circles clockwise, five counterclockwise."""
    return lb.Plan((*both_directions().tests, *circles(direction="CW")), name="mostly clockwise")


def three_planes() -> lb.Plan:
    """XY, YZ and ZX, each with a set-up of its own."""
    tests: list[lb.CircularTest] = []
    for k, plane in enumerate(("XY", "YZ", "ZX")):
        tests += circles(plane=plane, setup=k + 1)
    return lb.Plan(tuple(tests), name="three planes")


def everything() -> tuple[lb.HybridModel, lb.Plan]:
    """Two radii in both directions, in a random order that takes 100 minutes; the model has a drift
    over time."""
    tests: list[lb.CircularTest] = []
    for radius_mm in (150.0, 100.0):
        for direction in ("CW", "CCW"):
            tests += circles(radius_mm=radius_mm, direction=direction)
    order = np.random.default_rng(8).permutation(len(tests))
    timed = tuple(
        replace(test, time_s=FIVE_MINUTES_S * float(place))
        for test, place in zip(tests, order, strict=True)
    )
    model = MODEL.with_term(lb.terms.Drift("time"))
    return model, lb.Plan(timed, name="radii, directions and drift")
