"""How far the linear geometric model is from the exact one (Eq. 1-14), for given errors."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.machine.forward import geometric_reading_mm
from ldbb_bayes.model.basis import basis
from ldbb_bayes.model.bound import BoundModel

__all__ = ["largest_linearisation_error_mm", "linearisation_error_mm"]

Array = NDArray[Any]


def linearisation_error_mm(bound: BoundModel, test: CircularTest, beta: Array) -> Array:
    """Exact minus linear geometric reading of one test, shape (n,) [mm]. β (p,)."""
    values = dict(zip(bound.names, beta.tolist(), strict=True))
    angle = test.angles_rad()
    errors = np.array([values.get(name.label, 0.0) for name in bound.geometric_errors])
    linear = basis(angle) @ (bound.setting.geometric[bound.test_names.index(test.name)] @ errors)
    named = {
        replace(name, setup=0).label: values.get(name.label, 0.0)
        for name in bound.geometric_errors
        if not (name.kind == "offset" and (name.setup or 1) != test.setup)
    }
    return geometric_reading_mm(bound.campaign.machine(), test.circle, angle, named) - linear


def largest_linearisation_error_mm(bound: BoundModel, beta: Array) -> float:
    """The largest absolute error over all readings [mm]."""
    tests = [test for test in bound.campaign.tests if test.name in bound.test_names]
    return float(max(np.abs(linearisation_error_mm(bound, test, beta)).max() for test in tests))
