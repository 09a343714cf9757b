"""Zones: known shapes, an independent minimum zone on 200 traces, many at once."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

import ldbb_bayes as lb
from ldbb_bayes.analysis.circularity import least_squares_zone, minimum_zone, minimum_zone_widths

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


def test_many_at_once() -> None:
    """The exchange algorithm against the linear programme, flat and noisy traces among them."""
    rng = np.random.default_rng(7)
    traces = np.array(
        [
            sum(rng.normal(0.0, 5.0 / n) * np.cos(n * ANGLE + rng.uniform(0.0, 6.0)) for n in range(1, 7))
            + (k % 3 == 0) * rng.normal(0.0, 0.3, 360)
            for k in range(60)
        ]
    )
    traces[5], traces[6] = 0.0, 3.0
    widths = minimum_zone_widths(ANGLE, traces)
    np.testing.assert_allclose(widths, [minimum_zone(ANGLE, trace).width for trace in traces], atol=1e-9)
    few = ANGLE[::72]
    one = np.array([1.0, -2.0, 0.5, 0.0, 1.5])
    assert minimum_zone_widths(few, one)[0] == pytest.approx(minimum_zone(few, one).width, abs=1e-9)


def test_refused() -> None:
    with pytest.raises(lb.InputError, match="at least 3 angles"):
        minimum_zone(ANGLE[:2], ANGLE[:2])
