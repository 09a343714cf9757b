"""Study 07: the baseline is calibrated and quiet, disturbances of other shapes are noticed, and the README names what is not."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture(scope="module")
def kinds(root: Path) -> dict[str, Any]:
    return dict(json.loads((root / "studies" / "07_misspecification" / "results.json").read_text(encoding="utf-8"))["kinds"])


def test_every_disturbance_that_was_asked_for(kinds: dict[str, Any]) -> None:
    words = ("backlash", "centre, sorted", "centre, random", "hysteresis", "Student-t", "saturation", "pressure law", "curvature")
    for word in words:
        assert any(word in kind for kind in kinds), word


def test_the_baseline_is_calibrated_and_quiet(kinds: dict[str, Any]) -> None:
    baseline = kinds["baseline"]
    for group in baseline["coverage"].values():
        assert group["mean"] == pytest.approx(0.95, abs=3.0 * group["se"])
    assert baseline["noticed"]["share"] < 0.05


def test_what_has_another_shape_is_noticed(kinds: dict[str, Any]) -> None:
    for kind in ("backlash small", "backlash large", "backlash closed by load", "hysteresis, both, unstated", "outliers"):
        assert kinds[kind]["noticed"]["share"] > 0.9, kind


def test_silent_failures_and_their_remedies(kinds: dict[str, Any]) -> None:
    """What the README says the package cannot notice: a warming bar with rising forces, friction one way, a wrong force."""
    for kind in ("bar large, sorted", "hysteresis, CW", "pressure law large", "saturation large", "curvature large"):
        assert kinds[kind]["noticed"]["share"] < 0.05, kind
        assert kinds[kind]["worst"]["coverage"]["share"] < 0.7, kind
    for kind in ("bar large, random, Drift", "hysteresis, both, stated", "centre, sorted, Drift"):
        assert min(entry["coverage"] for entry in kinds[kind]["parameters"].values()) > 0.86, kind
