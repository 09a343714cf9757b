"""Errors of the force are no better known after many campaigns than their certificate says."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.fleet.force_sensitivity import with_common_sensitivity
from ldbb_bayes.fleet.machine_effects import with_deviations
from ldbb_bayes.model.gaussian import Gaussian

NAMES = ("C_XXX", "C_YYY", "force_gain")
SD = 0.01
MACHINES = 200


def posterior_of_gain(likelihood: Gaussian) -> tuple[float, float]:
    """Mean and sd of the gain; compliances scatter by 6 nm/N about an unknown mean."""
    marginal = with_deviations(likelihood, np.array([6.0**2, 6.0**2, 0.0]))
    precision = marginal.precision.sum(axis=0) + np.diag([1e-4, 1e-4, SD**-2.0])
    covariance = np.linalg.inv(precision)
    return float((covariance @ marginal.shift.sum(axis=0))[2]), float(covariance[2, 2] ** 0.5)


def test_many_machines_do_not_tell_the_gain_of_the_force() -> None:
    """Readings tell C + g C alone; each campaign's own C in g C moves the gain by sds."""
    rng = np.random.default_rng(3)
    estimates = rng.normal(60.0, np.hypot(6.0, 4.0), (MACHINES, 2))
    columns = np.tile(np.eye(2, 3), (MACHINES, 1, 1))
    columns[:, :, 2] = estimates  # each campaign is linearised at its own estimate
    raw = Gaussian(
        np.swapaxes(columns, 1, 2) @ columns / 4.0**2,
        (np.swapaxes(columns, 1, 2) @ estimates[:, :, None])[..., 0] / 4.0**2,
    )
    rows = pd.DataFrame(
        {
            "force_max_N": [742.0] * MACHINES,
            "gaussian_names": [NAMES] * MACHINES,
            "gaussian_mean": [[*estimate, 0.0] for estimate in estimates],
        }
    )
    mean, sd = posterior_of_gain(with_common_sensitivity(raw, NAMES, rows, 389.0))
    assert abs(mean) < 0.1 * SD
    assert sd == pytest.approx(SD, rel=0.02)
    wrong, _ = posterior_of_gain(raw)
    assert wrong > 2.0 * SD


def test_a_curvature_of_the_force_law_acts_as_its_column_does_beside_that_of_the_gain() -> None:
    """The readings move by C F of a gain and by C F_max q(F) of a curvature; slopes, by the
    derivative of their ratio with respect to the force."""
    forces_N = np.array([150.0, 300.0, 600.0])
    campaign = simulated(plan((24,) * 3, forces_N=forces_N))
    gain, curvature, _ = lb.terms.ForceError().columns(
        lb.HybridModel.default(degree=1).bind(campaign).setting
    )
    ratio = curvature.values[:, 1, 0] / gain.values[:, 1, 0]
    names = ("C_XXX", "C_XXX_1", "force_gain", "force_curvature")
    rows = pd.DataFrame(
        {
            "force_max_N": [600.0] * 3,
            "gaussian_names": [names] * 3,
            "gaussian_mean": [[50.0, 0.0, 0.0, 0.0], [60.0, 0.0, 0.0, 0.0], [80.0, 0.0, 0.0, 0.0]],
        }
    )
    unit = Gaussian(np.tile(np.eye(4), (3, 1, 1)), np.zeros((3, 4)))
    per_newton = (ratio[1] - ratio[0]) / (forces_N[1] - forces_N[0])
    for force_N, expected in zip(forces_N, ratio, strict=True):
        precision = with_common_sensitivity(unit, names, rows, force_N).precision
        np.testing.assert_allclose(precision[:, 0, 2], [10.0, 0.0, -20.0])
        np.testing.assert_allclose(precision[:, 0, 3], precision[:, 0, 2] * expected, atol=1e-12)
        np.testing.assert_allclose(precision[:, 1, 3], precision[:, 0, 2] * per_newton)
