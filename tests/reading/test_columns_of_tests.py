"""Refusals of tables with too few tests name the column that helps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import Layout

ANGLES = range(0, 360, 10)


def reading(angle_deg: int, force_N: float) -> str:
    return f"{0.02 * force_N + np.cos(np.deg2rad(angle_deg)):.3f}"


def wide(folder: Path) -> Path:
    """Write a table with a column of readings for each of three tests, none named as such."""
    lines = ["Angle [deg],A,B,C"]
    for angle in ANGLES:
        readings = [reading(angle, force) for force in (100.0, 300.0, 600.0)]
        lines.append(",".join([str(angle), *readings]))
    path = folder / "wide.csv"
    path.write_text("\n".join([*lines, ""]))
    return path


def long(folder: Path, directions: str) -> Path:
    """Write a table of tests below each other, one for each letter: R is CW, L is CCW."""
    lines = ["Block,direction,Angle [deg],Reading [um]"]
    for number, letter in enumerate(directions, start=1):
        direction = "CW" if letter == "R" else "CCW"
        for angle in ANGLES:
            lines.append(f"{number},{direction},{angle},{reading(angle, 100.0 * number)}")
    path = folder / "long.csv"
    path.write_text("\n".join([*lines, ""]))
    return path


def test_columns_of_further_readings_are_named(tmp_path: Path) -> None:
    step = "give --reading-column 'A' --reading-column 'B' --reading-column 'C'"
    with pytest.raises(lb.InputError, match=step):
        lb.import_campaign(wide(tmp_path), layout=Layout(forces_N=[100.0, 300.0, 600.0]))


def test_a_column_that_names_the_tests_is_named(tmp_path: Path) -> None:
    step = "If 'Block' names the test of each row, give --test-column 'Block'"
    with pytest.raises(lb.InputError, match=step):
        lb.import_campaign(long(tmp_path, "RRR"), layout=Layout(forces_N=[100.0, 200.0, 300.0]))


def test_a_number_of_forces_that_no_column_explains_keeps_the_usual_step(tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match="Give all, in the order of files and sheets"):
        lb.import_campaign(long(tmp_path, "RRR"), layout=Layout(forces_N=[100.0, 200.0]))


def test_mixed_directions_name_the_column_of_tests(tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match="--test-column 'Block'"):
        lb.import_campaign(long(tmp_path, "RLR"))


def test_mixed_directions_without_a_column_of_tests_name_the_column_of_directions(
    tmp_path: Path,
) -> None:
    path = long(tmp_path, "RL")
    path.write_text(path.read_text().replace("\n1,", "\n,").replace("\n2,", "\n,"))
    with pytest.raises(lb.InputError, match="--test-column 'direction'"):
        lb.import_campaign(path)


def loaded(folder: Path, *headers: str) -> Path:
    """Write a table with a column of readings below each header."""
    lines = [";".join(["Angle [deg]", *headers])]
    for angle in ANGLES:
        lines.append(";".join([str(angle), *[reading(angle, 100.0)] * len(headers)]))
    path = folder / "loaded.csv"
    path.write_text("\n".join([*lines, ""]))
    return path


def test_a_force_in_the_header_is_that_of_the_column(tmp_path: Path) -> None:
    path = loaded(tmp_path, "F = 3,6 daN", "F = 49 daN", "F = 74,2 daN")
    tests = lb.import_campaign(path).campaign.tests
    assert [test.force_N for test in tests] == [36.0, 490.0, 742.0]


def test_a_column_of_readings_that_is_not_asked_for_is_no_column_of_forces(tmp_path: Path) -> None:
    path = loaded(tmp_path, "F = 3,6 daN", "F = 49 daN", "F = 74,2 daN")
    result = lb.import_campaign(path, layout=Layout(columns={"reading": [2, 4]}))
    assert [test.force_N for test in result.campaign.tests] == [36.0, 742.0]


def with_conditions(folder: Path, header: str, values: tuple[str, ...]) -> Path:
    """Write a table of tests below each other, with a column that has one value for each test."""
    lines = [f"{header};Kąt [°];Odchyłka [µm]"]
    for value in values:
        lines += [f"{value};{angle};{reading(angle, 100.0)}" for angle in ANGLES]
    path = folder / "100N.csv"
    path.write_text("\n".join([*lines, ""]))
    return path


def test_a_column_may_name_tests_and_state_their_forces(tmp_path: Path) -> None:
    path = with_conditions(tmp_path, "Siła [N]", ("150", "300"))
    layout = Layout(columns={"test": "Siła [N]"})
    tests = lb.import_campaign(path, layout=layout).campaign.tests
    assert [(test.name, test.force_N) for test in tests] == [("150", 150.0), ("300", 300.0)]


def test_a_column_may_name_tests_and_state_their_directions(tmp_path: Path) -> None:
    path = with_conditions(tmp_path, "Direction", ("CW", "CCW"))
    layout = Layout(columns={"test": "Direction"})
    tests = lb.import_campaign(path, layout=layout).campaign.tests
    assert [test.direction for test in tests] == ["CW", "CCW"]


def test_names_of_load_cases_are_no_forces(tmp_path: Path) -> None:
    path = with_conditions(tmp_path, "Load case", ("1", "2"))
    layout = Layout(columns={"test": "Load case"})
    tests = lb.import_campaign(path, layout=layout).campaign.tests
    assert [test.force_N for test in tests] == [100.0, 100.0]


def test_two_columns_of_forces_are_asked(tmp_path: Path) -> None:
    path = with_conditions(tmp_path, "Force [N];Load cell [N]", ("150;151", "300;301"))
    layout = Layout(columns={"test": "Force [N]"})
    with pytest.raises(lb.InputError, match="Say which: --force-column"):
        lb.import_campaign(path, layout=layout)


def test_a_column_of_forces_that_may_name_the_tests_is_named(tmp_path: Path) -> None:
    path = with_conditions(tmp_path, "Siła [N]", ("150", "300"))
    with pytest.raises(lb.InputError, match="give --test-column 'Siła \\[N\\]'"):
        lb.import_campaign(path)
