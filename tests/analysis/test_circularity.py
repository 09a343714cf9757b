"""Circular deviation: known shapes, an independent minimum zone on 200 traces, and the machine's path by the exact model."""

from __future__ import annotations

import numpy as np
import pytest
from campaigns import HYPER_UM, TRUTH, plan
from scipy.optimize import minimize

import ldbb_bayes as lb
from ldbb_bayes.analysis.circularity import circularity, least_squares_zone, measured_circularity, minimum_zone
from ldbb_bayes.machine.forward import exact_reading_mm

ANGLE = np.arange(360) * np.pi / 180.0


@pytest.mark.parametrize(("order", "amplitude"), [(2, 5.0), (3, 1.5), (7, 0.2)])
def test_lobes(order: int, amplitude: float) -> None:
    """n lobes of amplitude a, wherever the centre: G = 2 a by either."""
    trace = 12.0 - 3.0 * np.cos(ANGLE) + 8.0 * np.sin(ANGLE) + amplitude * np.cos(order * ANGLE)
    for zone in (least_squares_zone(ANGLE, trace), minimum_zone(ANGLE, trace)):
        assert zone.width == pytest.approx(2.0 * amplitude, rel=1e-3)
        assert zone.centre == pytest.approx((-3.0, 8.0), abs=1e-2 * amplitude)
        assert zone.upper == pytest.approx(12.0 + amplitude, rel=1e-3)


def true_width(centre: np.ndarray, angle: np.ndarray, deviation_um: np.ndarray, radius_um: float = 1.5e5) -> float:
    """Distances of points in the plane from a centre: largest less smallest."""
    distance = np.hypot(
        (radius_um + deviation_um) * np.cos(angle) - centre[0], (radius_um + deviation_um) * np.sin(angle) - centre[1]
    )
    return float(distance.max() - distance.min())


def test_minimum_zone_on_200_traces() -> None:
    """Against a search over centres with true distances: never wider than what it finds, and as narrow to 0.1 nm."""
    rng = np.random.default_rng(4)
    for k in range(200):
        angle = np.sort(rng.uniform(0.0, 2 * np.pi, 60)) if k % 2 else ANGLE[::6]
        trace = sum(rng.normal(0.0, 5.0 / n) * np.cos(n * angle + rng.uniform(0.0, 6.0)) for n in range(1, 9))
        trace = trace + rng.normal(0.0, 0.3, len(angle))
        zone = minimum_zone(angle, trace)
        start = np.array(least_squares_zone(angle, trace).centre)
        searched = start
        for _ in range(3):
            searched = minimize(
                true_width,
                searched,
                args=(angle, trace),
                method="Nelder-Mead",
                options={"xatol": 1e-9, "fatol": 1e-9, "maxiter": 4000},
            ).x
        assert zone.width <= true_width(searched, angle, trace) + 1e-3
        assert true_width(np.array(zone.centre), angle, trace) == pytest.approx(zone.width, abs=1e-3)
        assert zone.width <= least_squares_zone(angle, trace).width + 1e-9


def test_the_machines_path() -> None:
    """G of the exact model at the truth lies where the posterior says, at every force and at none."""
    model = lb.HybridModel.default(0)
    quiet = HYPER_UM | {"tau": 0.05, "delta": 0.05, "kappa": 0.05}
    campaign = model.simulate(plan((120,) * 4), seed=5, parameters=TRUTH, hyper_um=quiet).campaign
    posterior = lb.sample(model, campaign, seed=1, sampler="quadrature")
    table = circularity(posterior)
    assert sorted(set(table["force_N"])) == [0.0, 36.0, 300.0, 520.0, 742.0]
    machine, circle = campaign.machine(), campaign.tests[0].circle
    compliances = {name: value for name, value in TRUTH.items() if name.startswith("C_")}
    errors = {name: value for name, value in TRUTH.items() if name.startswith("E_")}
    for force in (0.0, 300.0, 742.0):
        trace = 1e3 * exact_reading_mm(machine, circle, ANGLE, force_N=force, compliances=compliances, geometric_errors=errors)
        truth = {
            "G": least_squares_zone(ANGLE, trace).width,
            "G_minimum_zone": minimum_zone(ANGLE, trace).width,
            "F_max": trace.max(),
        }
        for quantity, value in truth.items():
            row = table[(table["force_N"] == force) & (table["quantity"] == quantity)].iloc[0]
            assert abs(row["mean"] - value) < 4.0 * row["sd"] + 0.02, (force, quantity)
            assert row["ci_low"] <= row["median"] <= row["ci_high"]
    measured = measured_circularity(posterior)
    assert (measured["G_minimum_zone"] <= measured["G"] + 1e-9).all()
    assert list(measured.index) == [test.name for test in campaign.tests]


def test_refused() -> None:
    with pytest.raises(lb.InputError, match="at least 3 angles"):
        minimum_zone(ANGLE[:2], ANGLE[:2])
