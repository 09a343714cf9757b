"""Study 01 states what Section 4 prints, and its limit of the linear model agrees with closed forms."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest


@pytest.fixture(scope="module")
def results(root: Path) -> dict[str, Any]:
    return dict(json.loads((root / "studies" / "01_simulation" / "results.json").read_text(encoding="utf-8")))


def test_tables_1_to_3(results: dict[str, Any]) -> None:
    """What Section 4 says: 18 compliances, six left, rank 6, condition number 9742; 13 parameters, two forces separate them."""
    sets = results["sets"]
    assert sets["table_1_same"]
    assert sets["table_2_same"]
    assert (sets["columns"], sets["geometric_columns"], sets["rank"], len(sets["null"])) == (18, 7, 6, 5)
    assert int(sets["condition_number"]) == 9742
    assert sets["rank_by_forces"] == {"1": 8, "2": 13, "7": 13}


def test_table_4(results: dict[str, Any]) -> None:
    table = results["table_4"]
    assert (table["same"], table["cut"], table["misprinted"]) == (11, ["C_CCY"], ["E_YY1"])
    assert table["corrected"] == "−2.1995E−04"
    assert table["same_with_the_sign_of_Eq_16"] == 7


def test_the_limits_are_those_of_closed_forms(results: dict[str, Any]) -> None:
    """A tool offset e makes e² sin²θ/(2R); a scale error E makes (R E cs)²/(2R): largest at 90° and 45°."""
    reach = results["reach"]
    radius, error = reach["radius_mm"], reach["resolution_um"] * 1e-3
    for name in ("E_Xt0", "E_Yt0"):
        assert reach["alone"][name]["limit"] == pytest.approx(np.sqrt(2.0 * radius * error), rel=1e-3)
    for name in ("E_XX1", "E_YY1"):
        assert reach["alone"][name]["limit"] == pytest.approx(np.sqrt(8.0 * error / radius), rel=5e-3)
    sizes, curve = np.array(reach["sizes"]), np.array(reach["curves"]["E_Xt0, E_Yt0 alone"])
    np.testing.assert_allclose(np.diff(np.log(curve)) / np.diff(np.log(sizes)), 2.0, atol=0.02)


def test_figure_4(results: dict[str, Any]) -> None:
    """Peak to peak of the oval: R E_XX1 + F C_XXX."""
    for force, size in results["figures"]["oval_um"].items():
        assert size == pytest.approx(1e3 * (150.0 * 1.12e-4 + float(force) * 1.1e-4), rel=1e-9)
