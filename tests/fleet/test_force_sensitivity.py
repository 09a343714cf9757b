"""Errors of the force are no better known after many campaigns than their certificate says."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

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
