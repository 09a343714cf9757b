"""What sheets state of directions, signs and lower limits, by definition and by another library."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from ldbb_bayes.report.plain_findings import _probability_of_sign
from ldbb_bayes.report.sheet_numbers import SheetNumbers
from ldbb_bayes.report.stiffness_numbers import _turned


@pytest.mark.parametrize("angle_deg", [0.0, 44.0, 100.0, 134.0, 136.0, 179.0])
def test_a_direction_is_stated_between_minus_45_and_135_degrees(angle_deg: float) -> None:
    """An axis has no head: 180° more or less are the same direction."""
    turned_deg = _turned(angle_deg)
    assert (turned_deg - angle_deg) % 180.0 == 0.0
    assert -45.0 < turned_deg <= 135.0


@pytest.mark.parametrize(("mean", "sd"), [(0.5, 1.0), (-2.0, 1.0), (3.0, 2.0)])
def test_the_probability_of_a_sign_is_that_of_a_normal_distribution(mean: float, sd: float) -> None:
    assert _probability_of_sign(mean, sd) == pytest.approx(norm(abs(mean), sd).sf(0.0))


def test_an_uncertain_compliance_has_the_stiffness_of_its_upper_end_as_lower_limit() -> None:
    """Of C from 2 to 80 nm/N, 1/C is at least 12.5 N/µm."""
    summary = {"median": 40e-6, "ci_low": 2e-6, "ci_high": 80e-6}
    numbers: Any = SimpleNamespace(
        _summaries={"C_XXX": summary},
        _draws={"C_XXX": np.array([2e-6, 40e-6, 80e-6])},
        words=lambda key, **values: values.get("value", key),
        verdicts={},
        _place_of_compliance=lambda axis: "",
    )
    stiffness = SheetNumbers._stiffness(numbers, SimpleNamespace(label="C_XXX", joint="X"))
    assert float(stiffness.limit) == pytest.approx(12.5)
    assert stiffness.interval == pytest.approx((12_500.0, 500_000.0))
