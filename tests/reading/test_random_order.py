"""Points of one turn in any order, below a header that defines the readings behind their unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.header_units import unit_of

ANGLE_DEG = np.arange(0.0, 360.0, 5.0)


def test_points_in_any_order_are_sorted_and_it_is_told(tmp_path: Path) -> None:
    order = np.random.default_rng(3).permutation(len(ANGLE_DEG))
    rows = [f"{ANGLE_DEG[k]:g};{-0.001 * k:.3f}" for k in order]
    lines = ["Angle [deg];Deviation (mm, nominal - measured)", *rows, ""]
    (tmp_path / "36N.csv").write_text("\n".join(lines))
    result = lb.import_campaign(tmp_path / "36N.csv")
    (test,) = result.campaign.tests
    np.testing.assert_allclose(test.angle_deg, ANGLE_DEG)
    np.testing.assert_allclose(test.reading_um, np.arange(len(ANGLE_DEG)))
    assert "rows: sorted by angle" in " ".join(str(result).split())


@pytest.mark.parametrize(
    "header", ["Deviation (mm, nominal - measured)", "편차(mm, 공칭-측정)", "dr [mm, Ist - Soll]"]
)
def test_a_unit_may_stand_before_a_definition(header: str) -> None:
    assert unit_of(header).unit == "mm"


@pytest.mark.parametrize("header", ["Deviation (mm, x 10)", "Deviation (mm, see sheet)"])
def test_other_words_behind_a_unit_leave_it_open(header: str) -> None:
    assert unit_of(header).unit != "mm"
