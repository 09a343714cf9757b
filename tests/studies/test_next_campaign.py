"""Study 05: designs are those the theory asks for, and simulated campaigns bear out widths, coverage and decisions."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture(scope="module")
def results(root: Path) -> dict[str, Any]:
    return dict(json.loads((root / "studies" / "05_next_campaign" / "results.json").read_text(encoding="utf-8")))


def test_designs(results: dict[str, Any]) -> None:
    six, flat = results["six"], results["flat"]
    assert six["forces_N"] == [36.0, 36.0, 389.0, 389.0, 742.0, 742.0]
    assert six["efficiency"]["recommended"] > 0.999 > 0.9 > six["efficiency"]["the paper's six"]
    assert flat["constant"]["forces_N"] == [36.0, 742.0]
    assert sum(flat["linear"]["shares"]) == pytest.approx(1.0, abs=1e-3)
    wanted = dict(zip(("forces alone", "two radii", "both balls clocked"), (3.0, 3.0, 1.0), strict=True))
    for name, squareness in results["squareness"].items():
        assert (squareness["urad"] <= wanted[name]) == (name != "forces alone")
    assert results["squareness"]["forces alone"]["floor_urad"] > 3.0


def test_predicted_widths_and_coverage(results: dict[str, Any]) -> None:
    """Every width within 10 % of what was predicted, in 200 campaigns of each design; coverage as claimed."""
    widths = results["simulated"]["widths"]
    assert results["simulated"]["largest_miss"] < 0.1
    for name, own in widths.items():
        assert own["count"] == 200
        covered = {p: entry["coverage_95"] for p, entry in own["parameters"].items()}
        assert min(share for p, share in covered.items() if p != "C_CCY") >= 0.90, name
        assert covered["C_CCY"] >= 0.86, name
        assert own["coverage_mean"] == pytest.approx(0.95, abs=0.02), name


def test_the_design_settles_it_as_often_as_predicted(results: dict[str, Any]) -> None:
    """Decisive shares within three binomial standard errors of the forecast; what it cannot settle is said."""
    forecast, seen = results["settling"]["discrimination"], results["simulated"]["decisions"]
    against = seen["settling: constant"]["decisive without"]
    assert against["share"] == pytest.approx(forecast["decisive_without"], abs=3.0 * 0.02)
    power = results["finding"]["C_XYX_1"]["power"]
    assert seen["C_XYX_1: there"]["decisive with"]["share"] == pytest.approx(power, abs=3.0 * 0.021)
    assert seen["settling: equal slopes"]["median"] < 0.0 < seen["settling: equal slopes, zero kept"]["median"]
