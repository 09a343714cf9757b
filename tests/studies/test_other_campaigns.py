"""The study of other campaigns shows what it was made to show, and the project's README says so."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def results() -> dict[str, Any]:
    return dict(json.loads((ROOT / "studies" / "08_other_campaigns" / "results.json").read_text(encoding="utf-8")))


def test_a_second_radius_identifies_squareness_and_straightness(results: dict[str, Any]) -> None:
    one, two = (results["predicted"][name] for name in ("one radius", "two radii"))
    for name in ("E_C0YX", "E_YX2", "E_XY2"):
        assert one[name]["verdict"] == "confounded"
        assert two[name]["verdict"] == "identified"
        u = {kind: results["simulated"][kind]["shown"][name]["u"] for kind in ("one radius", "two radii")}
        assert u["two radii"] < 0.5 * u["one radius"]


def test_intervals_hold(results: dict[str, Any]) -> None:
    """Within four binomial standard errors for each of 19 or 48 parameters, and on average."""
    for kind in ("one radius", "two radii", "both directions", "three planes"):
        own = results["simulated"][kind]
        assert own["campaigns"] == 200
        covered = list(own["coverage"].values())
        assert min(covered) > 0.95 - 4.0 * results["se"], kind
        assert sum(covered) / len(covered) == pytest.approx(0.95, abs=0.01), kind
        for name, entry in own["shown"].items():
            assert entry["error"] == pytest.approx(entry["u"], rel=0.2), (kind, name)
    assert results["calibration"]["outside"] == []


def test_one_direction_alone_takes_friction_for_compliance(results: dict[str, Any]) -> None:
    assert all(results["simulated"][kind]["shown"]["C_XYX"]["coverage"] < 0.88 for kind in ("five clockwise", "ten clockwise"))
    assert results["simulated"]["both directions"]["shown"]["C_XYX"]["coverage"] > 0.91


def test_the_readme_says_what_was_found(results: dict[str, Any]) -> None:
    readme = (ROOT / "docs" / "machines.md").read_text(encoding="utf-8")
    for name, factor, unit, kinds in (
        ("E_C0YX", 1e6, "µrad", ("one radius", "two radii")),
        ("E_YX2", 1e9, "µm/m²", ("one radius", "two radii")),
        ("C_XYX", 1e6, "nm/N", ("five clockwise", "ten clockwise", "both directions")),
    ):
        for kind in kinds:
            entry = results["simulated"][kind]["shown"][name]
            assert f"{entry['u'] * factor:.3g} {unit}, {entry['coverage']:.3f}" in readme, (name, kind)
    covered = list(results["simulated"]["three planes"]["coverage"].values())
    assert f"{min(covered):.3f} to {max(covered):.3f}, mean {sum(covered) / len(covered):.3f}" in readme
