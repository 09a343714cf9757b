"""Study 06 shows that the right model is calibrated, truncation and arcs included, and that the wrong ones are seen."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture(scope="module")
def results(root: Path) -> dict[str, Any]:
    return dict(json.loads((root / "studies" / "06_validation" / "results.json").read_text(encoding="utf-8")))


def test_the_right_model_is_calibrated(results: dict[str, Any]) -> None:
    assert {"linear", "constant", "untruncated", "arcs", "clocked"} == set(results["calibrated"])
    for kind in results["calibrated"]:
        case = results["cases"][kind]
        assert case["outside"] == 0
        assert case["replicates"] >= 300
        assert case["worst_coverage"] > 0.95 - 4.0 * case["se_of_one"]
        assert case["mean_coverage"] == pytest.approx(0.95, abs=0.01)


def test_wrong_models_are_seen(results: dict[str, Any]) -> None:
    for kind in set(results["cases"]) - set(results["calibrated"]):
        case = results["cases"][kind]
        assert case["outside"] > 5, kind
        assert case["worst_coverage"] < 0.7, kind
    more = results["cases"]["no discrepancy, more readings"]["mean_coverage"]
    assert more < results["cases"]["no discrepancy"]["mean_coverage"] - 0.02
