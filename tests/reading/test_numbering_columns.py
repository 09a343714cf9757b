"""Tables whose circles are numbered by two columns together, such as run and pass."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import Layout

FORCES = {("1", "1"): 100.0, ("1", "2"): 300.0, ("2", "1"): 300.0, ("2", "2"): 100.0}


def table(folder: Path, has_directions: bool = False) -> Path:
    """Write four circles, numbered by run and pass, which differ in force or in direction."""
    lines = ["run,pass,Angle [deg],Reading [um],Force [N],direction"]
    for (run, number), force_N in FORCES.items():
        for angle_deg in range(0, 360, 10):
            reading_um = 0.02 * force_N + np.cos(np.deg2rad(angle_deg))
            condition = f"{force_N},CW"
            if has_directions:
                condition = "100,CW" if force_N == 100.0 else "100,CCW"
            lines.append(f"{run},{number},{angle_deg},{reading_um:.3f},{condition}")
    path = folder / "all.csv"
    path.write_text("\n".join([*lines, ""]))
    return path


def test_the_layout_of_two_columns_reads_them_again(tmp_path: Path) -> None:
    path = table(tmp_path)
    result = lb.import_campaign([path])
    again = lb.import_campaign([path], layout=result.layout)
    assert again.campaign.sha256 == result.campaign.sha256


def test_two_columns_are_not_told_as_one_column_of_tests(tmp_path: Path) -> None:
    result = lb.import_campaign([table(tmp_path)])
    (columns,) = [entry for entry in result.assumptions if entry.what == "columns"]
    assert "test =" not in columns.value


@pytest.mark.parametrize("has_directions", [False, True])
def test_one_of_two_columns_alone_is_refused_with_the_step_that_reads_them(
    has_directions: bool, tmp_path: Path
) -> None:
    path = table(tmp_path, has_directions)
    step = "Only 'run' and 'pass' together name tests of one force. Leave --test-column out."
    with pytest.raises(lb.InputError, match=step):
        lb.import_campaign([path], layout=Layout(columns={"test": "run"}))


def repetitions(folder: Path, header: str, n_repetitions: int = 3) -> Path:
    """Write repetitions of one circle at one force, numbered in the first column."""
    lines = [f"{header};force_N;angle_deg;reading_um"]
    for number in range(1, n_repetitions + 1):
        for angle_deg in range(0, 360, 10):
            reading_um = number + np.cos(np.deg2rad(angle_deg))
            lines.append(f"{number};100;{angle_deg};{reading_um:.3f}")
    path = folder / "all.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize("header", ["rep", "Wdh. Nr.", "Wiederholung", "repetition no", "Series"])
def test_each_repetition_at_one_force_is_a_circle(header: str, tmp_path: Path) -> None:
    tests = lb.import_campaign(repetitions(tmp_path, header)).campaign.tests
    assert [len(test.angle_deg) for test in tests] == [36, 36, 36]


def test_the_layout_of_repetitions_reads_them_again(tmp_path: Path) -> None:
    path = repetitions(tmp_path, "rep")
    result = lb.import_campaign([path])
    again = lb.import_campaign([path], layout=result.layout)
    assert again.campaign.sha256 == result.campaign.sha256


def test_laps_of_one_circle_stay_together(tmp_path: Path) -> None:
    tests = lb.import_campaign(repetitions(tmp_path, "lap")).campaign.tests
    assert [len(test.angle_deg) for test in tests] == [108]


def test_parts_of_one_circle_are_no_repetitions(tmp_path: Path) -> None:
    path = repetitions(tmp_path, "rep", 1)
    text = path.read_text(encoding="utf-8").replace("\n1;100;2", "\n2;100;2")
    path.write_text(text.replace("\n1;100;3", "\n2;100;3"), encoding="utf-8")
    assert len(lb.import_campaign(path).campaign.tests) == 1


def test_circles_sorted_by_angle_may_all_have_0_and_360(tmp_path: Path) -> None:
    lines = ["angle_deg;force_N;direction;reading_um"]
    for angle_deg in range(0, 361, 10):
        for force_N in (100, 300):
            for direction in ("CW", "CCW"):
                reading_um = 0.02 * force_N + np.cos(np.deg2rad(angle_deg))
                lines.append(f"{angle_deg};{force_N};{direction};{reading_um:.3f}")
    path = tmp_path / "all.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    tests = lb.import_campaign(path).campaign.tests
    assert [len(test.angle_deg) for test in tests] == [37, 37, 37, 37]
