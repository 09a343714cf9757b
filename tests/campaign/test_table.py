"""Tidy tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.campaign.table import read_tidy
from ldbb_bayes.errors import InputError


def tidy(campaign: lb.Campaign, extra: str = "") -> str:
    lines = [f"test,force_N,pressure_bar,work_ball_deg,angle_deg,reading_um{',' + extra if extra else ''}"]
    for test in campaign.tests:
        for angle, reading in zip(test.angle_deg, test.reading_um, strict=True):
            cells = [test.name, test.force_N, test.pressure_bar, test.work_ball_deg, angle, reading]
            lines.append(",".join(str(cell) for cell in cells) + ("," if extra else ""))
    return "\n".join(lines) + "\n"


def test_tidy_is_the_same_campaign(tmp_path: Path) -> None:
    campaign = simulated(plan(work_deg=20.0))
    path = tmp_path / "all.csv"
    path.write_text(tidy(campaign))
    assert lb.read_campaign(path).sha256 == campaign.sha256
    assert lb.read_campaign(path, radius_mm=100.0).tests[0].radius_mm == 100.0


def test_column_mapping(tmp_path: Path) -> None:
    campaign = simulated(plan())
    path = tmp_path / "all.csv"
    path.write_text(tidy(campaign).replace("reading_um", "rho", 1))
    with pytest.raises(InputError, match="got 'rho'"):
        lb.read_campaign(path)
    assert read_tidy(path, mapping={"rho": "reading_um"}).sha256 == campaign.sha256


def test_rows_of_a_test_must_agree(tmp_path: Path) -> None:
    path = tmp_path / "all.csv"
    path.write_text(tidy(simulated(plan())).replace("f036,36.0", "f036,37.0", 1))
    with pytest.raises(InputError, match=r"all\.csv: force_N must be the same in all rows of a test, got 36.0 to 37.0 in 'f036'"):
        lb.read_campaign(path)


def test_test_column_is_needed(tmp_path: Path) -> None:
    path = tmp_path / "all.csv"
    path.write_text("force_N,angle_deg,reading_um\n" + "\n".join(f"36,{a},1" for a in range(0, 360, 10)))
    with pytest.raises(InputError, match="must hold 'test'"):
        lb.read_campaign(path)


def test_options_belong_to_tables(root: Path) -> None:
    with pytest.raises(InputError, match="options must come with a tidy CSV, got radius_mm"):
        lb.read_campaign(root / "data" / "recovered_experiment", radius_mm=100.0)


def test_empty_direction_is_none(tmp_path: Path) -> None:
    path = tmp_path / "all.csv"
    path.write_text(tidy(simulated(plan()), "direction"))
    assert all(test.direction is None for test in lb.read_campaign(path).tests)
    assert np.isfinite(lb.read_campaign(path).forces_N).all()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (",".join(["a"] * 1_000_000) + "\n", "line 1: a line must hold at most 100000 signs"),
        (",".join(["a"] * 2000) + "\n1\n", "at most 1000 columns, got 2000"),
        ("angle_deg,reading_um\n1,2\n" + ",".join([""] * 4_000_001), "at most 4000000 cells"),
        ("angle_deg,reading_um\n1," + "1" * 99_000 + "x\n", "reading_um must be a finite number, got '1111"),
    ],
)
def test_tables_of_no_sensible_shape_are_refused_at_once(content: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(content)
    with pytest.raises(InputError, match=said) as refused:
        lb.read_campaign(path)
    assert len(str(refused.value)) < 400
