"""Axes that are stiffer near their bearings, measured by circles at several places."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.nodes import compute_nodes

MODEL = lb.HybridModel.default(1)
FORCES_N = (700.0, 100.0, 500.0, 300.0)
ANGLE_DEG = np.arange(0.0, 360.0, 6.0)
# Centres on X and Y, and radii [mm]; the places of a case have their mean at zero.
PLACES = {
    "three centres": (((-150.0, 0.0), 150.0), ((0.0, -150.0), 150.0), ((150.0, 150.0), 150.0)),
    "two radii": (((0.0, 0.0), 150.0), ((0.0, 0.0), 300.0)),
}
CAMPAIGNS = 24


def plan_at(places: tuple[tuple[tuple[float, float], float], ...]) -> lb.Campaign:
    """A set-up at every place, with circles both ways and at four forces."""
    tests = []
    for setup, ((x_mm, y_mm), radius_mm) in enumerate(places, start=1):
        for k, force_N in enumerate(FORCES_N):
            test = lb.CircularTest(
                force_N,
                ANGLE_DEG,
                direction=("CW", "CCW")[k % 2],
                centre_x_mm=x_mm,
                centre_y_mm=y_mm,
                radius_mm=radius_mm,
                setup=setup,
            )
            tests.append(test)
    return lb.Plan(
        tuple(tests),
        order="random",
        instrument=lb.Instrument(bar_U_um=1.0, mount_U_percent=2.0),
    )


def measured(plan: lb.Campaign, seed: int) -> tuple[lb.Campaign, dict[str, float]]:
    """Readings of a machine whose compliances change along its axes, and its true parameters.

    The change is a function of the place on the axis, by as much as the model believes; it is added
    here to readings of a model without it. Compliances are those at the mean of the centres.
    """
    rng = np.random.default_rng([31, seed])
    hyper_um = {"sigma": 0.15, "delta": 0.4, "kappa": 0.3, "tau": 0.6}
    simulation = MODEL.without("position").simulate(plan, seed=seed, hyper_um=hyper_um)
    changes = rng.standard_normal((2, 2)) * (0.07, 0.04)
    angle = np.deg2rad(ANGLE_DEG)
    tests = []
    for test in simulation.campaign.tests:
        reading_um = np.asarray(test.reading_um).copy()
        for axis, (name, u) in enumerate({"C_XXX": np.cos(angle), "C_YYY": np.sin(angle)}.items()):
            place = test.circle.centre_mm[axis] + test.circle.radius_mm * u
            linear, quadratic = changes[axis]
            share = linear * place / 150.0 + quadratic * ((place / 150.0) ** 2 - 0.5)
            compliance = simulation.parameters[name] * share
            reading_um += 1e3 * compliance * float(test.force_N or 0.0) * u**2
        tests.append(test.with_reading_um(reading_um))
    return replace(simulation.campaign, tests=tuple(tests)), dict(simulation.parameters)


@pytest.mark.slow
@pytest.mark.parametrize("case", PLACES)
def test_intervals_hold_the_truth_at_several_places(case: str) -> None:
    """They held C_CCY and C_CYY in a quarter to three quarters of the campaigns where each circle
    had a change of its own, about its own centre and over its own radius."""
    plan = plan_at(PLACES[case])
    inside: dict[str, list[bool]] = {"C_CXY": [], "C_CYY": [], "C_CCY": []}
    for seed in range(CAMPAIGNS):
        campaign, truth = measured(plan, seed)
        posterior = compute_nodes(HyperPosterior(MODEL.bind(campaign), truncated=True), 0.1)
        draws, _ = posterior.draw(2000, np.random.default_rng(seed))
        names = MODEL.bind(campaign).names
        for name, hits in inside.items():
            low, high = np.quantile(draws[:, names.index(name)], [0.025, 0.975])
            hits.append(bool(low <= truth[name] <= high))
    coverage = {name: float(np.mean(hits)) for name, hits in inside.items()}
    assert min(coverage.values()) >= 0.8, coverage
    assert np.mean(list(coverage.values())) >= 0.88, coverage
