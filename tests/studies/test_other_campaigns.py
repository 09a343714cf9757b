"""The study is reproduced, its intervals hold, and its page and the README say what was found."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
STUDY = ROOT / "studies" / "08_other_campaigns"


@pytest.fixture(scope="module")
def found() -> dict[str, Any]:
    return dict(json.loads((STUDY / "simulations.json").read_text(encoding="utf-8")))


@pytest.mark.slow
def test_reproduced() -> None:
    done = subprocess.run([sys.executable, str(STUDY / "run.py")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_second_radius_identifies_squareness_and_straightness(found: dict[str, Any]) -> None:
    verdicts = json.loads((STUDY / "results.json").read_text(encoding="utf-8"))
    for name in ("E_C0YX", "E_YX2", "E_XY2"):
        assert verdicts["one radius"][name]["verdict"] == "aliased"
        assert verdicts["two radii"][name]["verdict"] == "identified"
        assert found["two radii"][name]["rms_sd"] < 0.5 * found["one radius"][name]["rms_sd"]


def test_intervals_hold(found: dict[str, Any]) -> None:
    """400 campaigns: the binomial standard error of a coverage of 0.95 is 0.011."""
    assert found["campaigns"] == found["calibration"]["replicates"] == 400
    for name in ("one radius", "two radii", "both directions", "three planes"):
        covered = [entry["coverage_95"] for entry in found[name].values()]
        assert min(covered) > 0.91, name
        assert sum(covered) / len(covered) == pytest.approx(0.95, abs=0.006), name
        for parameter, entry in found[name].items():
            assert entry["rms_error"] == pytest.approx(entry["rms_sd"], rel=0.15), (name, parameter)
    assert found["calibration"]["outside"] == found["calibration"]["failures"] == []


def test_one_direction_alone_takes_friction_for_compliance(found: dict[str, Any]) -> None:
    assert found["its clockwise half"]["C_XYX"]["coverage_95"] < 0.85
    assert found["both directions"]["C_XYX"]["coverage_95"] > 0.92


def test_the_pages_say_what_was_found(found: dict[str, Any]) -> None:
    page, readme = ((folder / "README.md").read_text(encoding="utf-8") for folder in (STUDY, ROOT))
    one, two, half, both = (found[name] for name in ("one radius", "two radii", "its clockwise half", "both directions"))

    def cell(entry: dict[str, float], factor: float, unit: str) -> str:
        return f"{entry['rms_sd'] * factor:.3g} / {entry['rms_error'] * factor:.3g} {unit}, {entry['coverage_95']:.3f}"

    for name, shown, factor, unit, before, after in (
        ("E_C0YX", "E_C(0Y)X", 1e6, "µrad", one, two),
        ("E_YX2", "E_YX2", 1e9, "µm/m²", one, two),
        ("E_XY2", "E_XY2", 1e9, "µm/m²", one, two),
        ("C_XYX", "C_XYX", 1e6, "nm/N", half, both),
    ):
        assert f"| {shown} | {cell(before[name], factor, unit)} | {cell(after[name], factor, unit)} |" in page
        if name != "E_XY2":
            for entry in (before[name], after[name]):
                assert f"{entry['rms_sd'] * factor:.3g} {unit}, {entry['coverage_95']:.3f}" in readme
    for campaign in ("two radii", "both directions", "three planes", "its clockwise half"):
        covered = [entry["coverage_95"] for entry in found[campaign].values()]
        spread = f"{min(covered):.3f} to {max(covered):.3f}, mean {sum(covered) / len(covered):.3f}"
        assert spread in page
        if campaign == "three planes":
            assert spread in readme
