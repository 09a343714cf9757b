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
    powers = []
    for power in range(degree + 1):
        load = force * (force - reference_force_N) ** power
        powers += [load * pattern for pattern in compliance]
    return np.column_stack([*powers, *geometry])


@pytest.mark.parametrize(
    ("degree", "reference", "fixed"),
    [(0, 0.0, ()), (1, 0.0, ("C_CCY",)), (1, 300.0, ()), (2, 300.0, ())],
)
def test_against_plain_matrices(degree: int, reference: float, fixed: tuple[str, ...]) -> None:
    campaign = simulated(plan((90, 60, 80, 70), forces_N=(36.0, 200.0, 500.0, 742.0)), seed=2)
    fit = lb.fit_least_squares(campaign, degree, reference_force_N=reference, fixed=fixed)
    jacobian = np.vstack([columns(test, degree, reference) for test in campaign.tests])
    if fixed:
        jacobian = np.delete(jacobian, [5], axis=1)
    reading = np.concatenate([test.readings_mm() for test in campaign.tests])
    scale = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / scale
    solution, (square,), *_ = np.linalg.lstsq(scaled, reading, rcond=None)
    estimate = solution / scale
    freedom = len(reading) - jacobian.shape[1]
    variance = np.diag(np.linalg.inv(scaled.T @ scaled)) * square / freedom
    np.testing.assert_allclose(fit.table["estimate"] / estimate, 1.0, rtol=1e-6)
    np.testing.assert_allclose(fit.table["u"], np.sqrt(variance) / scale, rtol=1e-6)
    assert fit.quality.rmse_um == pytest.approx(1e3 * np.sqrt(square / len(reading)), rel=1e-8)
    predicted_um = 1e3 * jacobian @ estimate
    by_test = np.concatenate(list(fit.predicted_um.values()))
    np.testing.assert_allclose(by_test, predicted_um, atol=1e-6)
    first = campaign.tests[0]
    reading_um = np.asarray(first.reading_um)
    residual_um = reading_um - predicted_um[: len(first.angle_deg)]
    fitness = 100.0 * (1.0 - np.sqrt(np.mean(residual_um**2)) / np.ptp(reading_um))
    assert fit.quality.fitness_percent[first.name] == pytest.approx(fitness, rel=1e-8)


def test_the_papers_numbers(recovered: lb.Campaign) -> None:
    """Tables 5 and 6 to 1.05 half-units of the last digit, and the published RMSE."""
    constant = lb.fit_least_squares(recovered)
    linear = lb.fit_least_squares(recovered, 1)
    for name in ("table_5_global_compliances", "table_6_global_geometric_errors"):
        assert max(misses(printed(name).iloc[0], constant.estimate)) <= 1.05
    assert f"{constant.quality.rmse_um:.1f}" == "1.1"
    assert f"{linear.quality.rmse_um:.1f}" == "0.9"


def test_uncompensated_mount_is_subtracted(recovered: lb.Campaign) -> None:
    """Eq. 32: readings with the mount's deflection left in give the same estimates."""
    raw = [
        test.with_reading_um(np.asarray(test.reading_um) + 2.33 * float(test.pressure_bar or 0.0))
        for test in recovered.tests
    ]
    mount = replace(recovered.mount, compensated=False)
    uncompensated = replace(recovered, tests=tuple(raw), mount=mount)
    estimate = lb.fit_least_squares(uncompensated).table["estimate"]
    expected = lb.fit_least_squares(recovered).table["estimate"]
    np.testing.assert_allclose(estimate, expected, rtol=1e-8)


def test_what_is_not_determined() -> None:
    """Six places on the circle: rank 12."""
    angle = 60.0 * np.arange(9)
    reading = np.cos(np.arange(9.0))
    tests = [lb.CircularTest(force, angle, reading) for force in (100.0, 400.0)]
    table = lb.fit_least_squares(lb.Campaign(tuple(tests))).table
    assert table[["estimate", "u"]].isna().all(axis=None)


def test_a_plan_is_refused(recovered: lb.Campaign) -> None:
    refuses("got a plan", lb.fit_least_squares, recovered.plan(), 0)


def test_one_force_is_refused(recovered: lb.Campaign) -> None:
    refuses("two force levels", lb.fit_least_squares, recovered.select(["f036"]), 0)


def test_too_few_forces_are_refused(recovered: lb.Campaign) -> None:
    campaign = recovered.select(["f036", "f742"])
    refuses("at least (3|three) force levels", lb.fit_least_squares, campaign, 1)


def test_print_notebook_and_json() -> None:
    fit = lb.fit_least_squares(simulated(plan(), seed=1))
    assert "RMSE" in str(fit)
    assert "Eq. 31" in fit._repr_html_()
    assert lb.inference.LeastSquares.from_dict(fit.as_dict()).table.equals(fit.table)
