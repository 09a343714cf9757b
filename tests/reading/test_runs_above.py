"""Headers of two rows: runs above the names of the columns, or loads below them."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import Layout

FORCES = Layout(forces_N=[36.0, 490.0])


def table(folder: Path, *header: str) -> Path:
    """Write a table with one column of angles and two of readings."""
    lines = [*header]
    lines += [f"{5 * k};{0.1 * k:.2f};{0.2 * k:.2f}" for k in range(72)]
    path = folder / "runs.csv"
    path.write_text("\n".join([*lines, ""]))
    return path


def four_columns(folder: Path, *above: str) -> Path:
    """Write a table with one column of angles and four of readings, whose header states loads."""
    lines = [*above, "Angle [deg];36 N [um];490 N [um];36 N [um];490 N [um]"]
    for k in range(72):
        lines.append(f"{5 * k};{0.1 * k:.2f};{0.2 * k:.2f};{0.3 * k:.2f};{0.4 * k:.2f}")
    path = folder / "loads.csv"
    path.write_text("\n".join([*lines, ""]))
    return path


@pytest.mark.parametrize(
    "header",
    [
        (";Run 1;Run 2", "Angle [deg];Dev. [um];Dev. [um]"),
        ("Angle;Run 1;Run 2", "[deg];Dev. [um];Dev. [um]"),
    ],
)
def test_runs_above_name_the_tests(header: tuple[str, str], tmp_path: Path) -> None:
    tests = lb.import_campaign(table(tmp_path, *header), layout=FORCES).campaign.tests
    assert [test.name for test in tests] == ["Dev. Run 1", "Dev. Run 2"]


def test_units_stay_with_the_readings(tmp_path: Path) -> None:
    path = table(tmp_path, ";Run 1;Run 2", "Angle [deg];Deviation [mm];Deviation [mm]")
    tests = lb.import_campaign(path, layout=FORCES).campaign.tests
    assert tests[0].reading_um[1] == 100.0


def test_a_unit_above_loads_is_that_of_all_readings(tmp_path: Path) -> None:
    path = table(tmp_path, "Angle [deg];Deviation [mm];", ";36 N;490 N")
    test = lb.import_campaign(path).campaign.tests[1]
    assert (test.force_N, test.reading_um[1]) == (490.0, 200.0)


def test_a_load_in_brackets_above_the_header_is_not_cut_off(tmp_path: Path) -> None:
    path = table(tmp_path, ";Run 1 (36 N);Run 2 (490 N)", "Angle [deg];Dev. [um];Dev. [um]")
    tests = lb.import_campaign(path).campaign.tests
    assert [test.force_N for test in tests] == [36.0, 490.0]


@pytest.mark.parametrize(
    "above", [";CW;;CCW;", ";CW;CW;CCW;CCW", "Direction;CW;;CCW;", ";im UZS;;gegen den UZS;"]
)
def test_directions_above_loads_are_those_of_their_columns(above: str, tmp_path: Path) -> None:
    path = four_columns(tmp_path, above)
    tests = lb.import_campaign(path).campaign.tests
    assert [test.direction for test in tests] == ["CW", "CW", "CCW", "CCW"]


@pytest.mark.parametrize("above", [";XY;;YZ;", ";XY;XY;YZ;YZ", "Ebene;XY-Ebene;;YZ-Ebene;"])
def test_planes_above_loads_are_those_of_their_columns(above: str, tmp_path: Path) -> None:
    path = four_columns(tmp_path, above)
    tests = lb.import_campaign(path).campaign.tests
    assert [test.plane for test in tests] == ["XY", "XY", "YZ", "YZ"]


def test_planes_and_directions_stand_above_loads(tmp_path: Path) -> None:
    path = four_columns(tmp_path, ";XY;;YZ;", ";CW;CCW;CW;CCW")
    tests = lb.import_campaign(path).campaign.tests
    stated = [(test.plane, test.direction) for test in tests]
    assert stated == [("XY", "CW"), ("XY", "CCW"), ("YZ", "CW"), ("YZ", "CCW")]


@pytest.mark.parametrize(
    "above",
    [";R = 100 mm;;R = 150 mm;", ";R 100 mm;R 100 mm;R 150 mm;R 150 mm", "Radius;100 mm;;150 mm;"],
)
def test_radii_above_loads_are_those_of_their_columns(above: str, tmp_path: Path) -> None:
    path = four_columns(tmp_path, above)
    tests = lb.import_campaign(path).campaign.tests
    stated = [(test.radius_mm, test.force_N) for test in tests]
    assert stated == [(100.0, 36.0), (100.0, 490.0), (150.0, 36.0), (150.0, 490.0)]


@pytest.mark.parametrize(
    "header",
    [
        ["Angle [deg];36 N;;490 N;", ";CW;CCW;CW;CCW"],
        ["Angle;36 N;;490 N;", ";CW;CCW;CW;CCW", "°;µm;µm;µm;µm"],
        [";36 N;;490 N;", "Winkel;G2;G3;G2;G3", "°;µm;µm;µm;µm"],
    ],
)
def test_below_loads_directions_may_be_the_only_names(header: list[str], tmp_path: Path) -> None:
    path = four_columns(tmp_path)
    numbers = path.read_text().split("\n")[1:]
    path.write_text("\n".join([*header, *numbers]))
    tests = lb.import_campaign(path).campaign.tests
    stated = [(test.force_N, test.direction) for test in tests]
    assert stated == [(36.0, "CW"), (36.0, "CCW"), (490.0, "CW"), (490.0, "CCW")]
    assert [test.reading_um[1] for test in tests] == [0.1, 0.2, 0.3, 0.4]


@pytest.mark.parametrize(
    ("above", "field", "stated"),
    [
        ("Angle [deg];CW;;CCW;", "direction", ["CW", "CW", "CCW", "CCW"]),
        ("Angle [deg];im Uhrzeigersinn;;G3;", "direction", ["CW", "CW", "CCW", "CCW"]),
        ("Winkel [°];XY;;YZ;", "plane", ["XY", "XY", "YZ", "YZ"]),
    ],
)
def test_the_angles_may_be_named_beside_conditions_above_loads(
    above: str, field: str, stated: list[str], tmp_path: Path
) -> None:
    path = four_columns(tmp_path, above)
    path.write_text(path.read_text().replace("\nAngle [deg];", "\n;"))
    tests = lb.import_campaign(path).campaign.tests
    assert [getattr(test, field) for test in tests] == stated
    assert [test.force_N for test in tests] == [36.0, 490.0, 36.0, 490.0]
    assert [test.angle_deg[1] for test in tests] == [5.0] * 4
