"""Eq. 31 with RMSE and fitness (Eq. 34, 35) against plain matrices and the paper's tables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import misses, plan, printed, refuses, simulated

import ldbb_bayes as lb


def columns(test: lb.CircularTest, degree: int, reference_force_N: float) -> np.ndarray:
    """J_H of one test, typed in."""
    c = np.cos(test.angles_rad())
    s = np.sin(test.angles_rad())
    radius = 150.0
    force = float(test.force_N or 0.0)
    compliance = [c**2, c * s, s**2, radius * c**2 * s, radius * c * s**2, radius**2 * c**2 * s**2]
    geometry = [
        radius * c**2,
        radius**2 * c**2 * s,
        radius**2 * s**2 * c,
        radius * s**2,
        radius * c * s,
        c,
        s,
    ]
    powers = [
        force * (force - reference_force_N) ** k * own
        for k in range(degree + 1)
        for own in compliance
    ]
    return np.column_stack([*powers, *geometry])


@pytest.mark.parametrize(
    ("degree", "reference", "fixed"),
    [(0, 0.0, ()), (1, 0.0, ("C_CCY",)), (1, 300.0, ()), (2, 300.0, ())],
)
def test_against_plain_matrices(degree: int, reference: float, fixed: tuple[str, ...]) -> None:
    campaign = simulated(plan((90, 60, 80, 70), forces_N=(36.0, 200.0, 500.0, 742.0)), seed=2)
    found = lb.least_squares(campaign, degree, reference_force_N=reference, fixed=fixed)
    jacobian = np.vstack([columns(test, degree, reference) for test in campaign.tests])
    jacobian = np.delete(jacobian, [5] if fixed else [], axis=1)
    reading = np.concatenate([test.readings_mm() for test in campaign.tests])
    scale = np.linalg.norm(jacobian, axis=0)
    estimate, (square,), *_ = np.linalg.lstsq(jacobian / scale, reading, rcond=None)
    inverse = np.linalg.inv((jacobian / scale).T @ (jacobian / scale))
    freedom = len(reading) - jacobian.shape[1]
    np.testing.assert_allclose(found.table["estimate"] / (estimate / scale), 1.0, rtol=1e-6)
    np.testing.assert_allclose(
        found.table["u"], np.sqrt(np.diag(inverse) * square / freedom) / scale, rtol=1e-6
    )
    assert found.quality.rmse_um == pytest.approx(1e3 * np.sqrt(square / len(reading)), rel=1e-8)
    predicted = 1e3 * jacobian @ (estimate / scale)
    np.testing.assert_allclose(
        np.concatenate(list(found.predicted_um.values())), predicted, atol=1e-6
    )
    first = campaign.tests[0]
    own = np.asarray(first.reading_um) - predicted[: len(first.angle_deg)]
    expected = 100.0 * (1.0 - np.sqrt(np.mean(own**2)) / np.ptp(np.asarray(first.reading_um)))
    assert found.quality.fitness_percent[first.name] == pytest.approx(expected, rel=1e-8)


def test_the_papers_numbers(recovered: lb.Campaign) -> None:
    """Tables 5 and 6 to 1.05 half-units of the last digit, and the published RMSE."""
    whole = lb.least_squares(recovered)
    for name in ("table_5_global_compliances", "table_6_global_geometric_errors"):
        assert max(misses(printed(name).iloc[0], whole.estimate)) <= 1.05
    assert f"{whole.quality.rmse_um:.1f}" == "1.1"
    assert f"{lb.least_squares(recovered, 1).quality.rmse_um:.1f}" == "0.9"


def test_uncompensated_mount_is_subtracted(recovered: lb.Campaign) -> None:
    """Eq. 32: readings with the mount's deflection left in give the same estimates."""
    raw = [
        test.with_reading_um(np.asarray(test.reading_um) + 2.33 * float(test.pressure_bar or 0.0))
        for test in recovered.tests
    ]
    mount = replace(recovered.mount, compensated=False)
    found = lb.least_squares(replace(recovered, tests=tuple(raw), mount=mount))
    np.testing.assert_allclose(
        found.table["estimate"], lb.least_squares(recovered).table["estimate"], rtol=1e-8
    )


def test_what_is_not_determined() -> None:
    angle = 60.0 * np.arange(9)  # six places on the circle: rank 12
    few = lb.Campaign(
        tuple(lb.CircularTest(force, angle, np.cos(np.arange(9.0))) for force in (100.0, 400.0))
    )
    assert lb.least_squares(few).table[["estimate", "u"]].isna().all(axis=None)


@pytest.mark.parametrize("wrong", ["plan", "one force", "too few forces"])
def test_refused(recovered: lb.Campaign, wrong: str) -> None:
    campaign, degree, message = {
        "plan": (recovered.plan(), 0, "got a plan"),
        "one force": (recovered.select(["f036"]), 0, "two force levels"),
        "too few forces": (
            recovered.select(["f036", "f742"]),
            1,
            "at least (3|three) force levels",
        ),
    }[wrong]
    refuses(message, lb.least_squares, campaign, degree)


def test_shown() -> None:
    found = lb.least_squares(simulated(plan(), seed=1))
    assert "RMSE" in str(found)
    assert "Eq. 31" in found._repr_html_()
    assert lb.LeastSquares.from_dict(found.as_dict()).table.equals(found.table)
