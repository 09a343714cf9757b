"""Columns known by their cells, laws of force and lists of forces: used, or refused with a cure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.force_laws import states_force_law
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.role_words import has_role


def written(
    folder: Path, header: str, row: str = "{a},{r}.25", above: str = "", name: str = "a 36N.csv"
) -> Path:
    """Write a circle in steps of 5°: angle a, reading r, number of the row k."""
    lines = [line for line in (above, header) if line]
    lines += [row.format(a=5 * k, r=k % 7, k=k) for k in range(72)]
    path = folder / name
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


def imported(path: Path, layout: dict[str, Any] | None = None, **campaign: Any) -> lb.Campaign:
    stated = lb.reading.Layout.model_validate(layout or {})
    return lb.import_campaign(path, layout=stated, **campaign).campaign


@pytest.mark.parametrize("header", ["PlaneName", "GPlane", "circle.plane", "Plane_ID", "Messebene"])
@pytest.mark.parametrize(("cell", "plane"), [("YZ", "YZ"), ("zx", "ZX"), ("G19", "YZ")])
def test_a_column_of_planes_is_used(tmp_path: Path, header: str, cell: str, plane: str) -> None:
    path = written(tmp_path, f"{header},angle_deg,reading_um", f"{cell},{{a}},{{r}}.25")
    (test,) = imported(path).tests
    assert test.plane == plane


def test_planes_under_another_name_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "Setting,angle_deg,reading_um", "G18,{a},{r}.25")
    with pytest.raises(lb.InputError, match=r"'Setting'\. Give --plane .* to 'plane'"):
        imported(path)


def test_planes_under_another_name_are_read_once_renamed(tmp_path: Path) -> None:
    path = written(tmp_path, "plane,angle_deg,reading_um", "G18,{a},{r}.25")
    (test,) = imported(path).tests
    assert test.plane == "ZX"


def test_planes_that_the_user_states_too_are_no_question(tmp_path: Path) -> None:
    path = written(tmp_path, "Setting,angle_deg,reading_um", "G18,{a},{r}.25")
    assert imported(path, plane="ZX").plane == "ZX"


@pytest.mark.parametrize("cell", ["X-Z", "Z/X plane", "ZX"])
def test_a_plane_may_be_written_with_a_mark(tmp_path: Path, cell: str) -> None:
    path = written(tmp_path, "PlaneName,angle_deg,reading_um", f"{cell},{{a}},{{r}}.25")
    assert imported(path, plane="ZX").plane == "ZX"


@pytest.mark.parametrize("cell", ["1", "front", ""])
def test_a_column_of_planes_without_a_plane_is_refused(tmp_path: Path, cell: str) -> None:
    path = written(tmp_path, "Plane_ID,angle_deg,reading_um", f"{cell},{{a}},{{r}}.25")
    text = path.read_text(encoding="utf-8").replace(f"{cell},5,", "YZ,5,")
    path.write_text(text, encoding="utf-8")
    with pytest.raises(lb.InputError, match=r"'Plane_ID' must name the plane.*--plane"):
        imported(path)


def test_a_column_of_planes_without_a_plane_gives_way_to_the_user(tmp_path: Path) -> None:
    path = written(tmp_path, "Plane_ID,angle_deg,reading_um", "1,{a},{r}.25")
    assert imported(path, plane="ZX").plane == "ZX"


def test_a_plane_of_the_user_that_a_column_contradicts_is_told(tmp_path: Path) -> None:
    path = written(tmp_path, "PlaneName,angle_deg,reading_um", "YZ,{a},{r}.25")
    assumptions = lb.import_campaign(path, plane="XY").assumptions
    notes = [(note.value, note.because) for note in assumptions if note.what == "plane"]
    assert notes == [("XY, as given", "column 'PlaneName' says YZ")]


def test_the_column_plane_is_used_and_told_against_the_plane_of_the_user(tmp_path: Path) -> None:
    path = written(tmp_path, "plane,angle_deg,reading_um", "YZ,{a},{r}.25")
    result = lb.import_campaign(path, plane="XY")
    notes = [(note.value, note.because) for note in result.assumptions if note.what == "plane"]
    assert notes == [("YZ, its column", "--plane says XY")]
    assert result.campaign.tests[0].plane == "YZ"


def test_signs_in_a_column_of_the_travel_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "travel,angle_deg,reading_um", "-1,{a},{r}.25")
    with pytest.raises(lb.InputError, match=r"got -1 in column 'travel'\. Give --direction"):
        imported(path)


def test_signs_in_a_column_of_the_travel_give_way_to_the_user(tmp_path: Path) -> None:
    path = written(tmp_path, "travel,angle_deg,reading_um", "-1,{a},{r}.25")
    (test,) = imported(path, {"direction": "CCW"}).tests
    assert test.direction == "CCW"


@pytest.mark.parametrize("cell", ["CW", "ccw", "G2", "G03", "clockwise", "UZS", "links"])
def test_directions_under_another_name_are_refused(tmp_path: Path, cell: str) -> None:
    path = written(tmp_path, "Mode,angle_deg,reading_um", f"{cell},{{a}},{{r}}.25")
    with pytest.raises(lb.InputError, match="--direction-column 'Mode'"):
        imported(path)


def test_the_column_of_directions_is_read_once_named(tmp_path: Path) -> None:
    path = written(tmp_path, "Mode,angle_deg,reading_um", "G03,{a},{r}.25")
    (test,) = imported(path, {"columns": {"direction": "Mode"}}).tests
    assert test.direction == "CCW"


PAIRS = {"columns": {"angle": 1, "reading": [2, 4]}, "forces_N": [36.0, 238.0]}


def test_further_angles_beside_readings_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "Winkel,dR,Winkel,dR", "{a},{r}.25,1{a},{k}.5")
    with pytest.raises(lb.InputError, match=r"other angles in the columns 'Winkel' \(3\)"):
        imported(path, PAIRS)


def test_equal_angles_beside_readings_are_read(tmp_path: Path) -> None:
    path = written(tmp_path, "Winkel,dR,Winkel,dR", "{a},{r}.25,{a},{k}.5")
    assert len(imported(path, {**PAIRS, "reading_unit": "um"}).tests) == 2


LAWS = [
    "Force law,F = 118.5 N/bar * p - 9.0 N",
    "Force [N] = 118.5*p[bar] - 9.0",
    "Kraft = 118,5 * Druck - 9",
    "Slope 11.85 daN per bar",
    "F = -9.0 + p * 118.5",
    "Gain: 1185 N/MPa",
    "118.5 N bar^-1",
    "Calibration: 1 bar = 118.5 N",
    "1,0 bar entspricht 118,5 N",
    "Force slope: 118.5, offset -9",
    "Force offset -9 N",
    "Piston area 11.85 cm²",
    "Kraft F = A * p mit A = 1185 mm²",
]


@pytest.mark.parametrize("line", LAWS)
def test_a_law_of_force_is_refused(tmp_path: Path, line: str) -> None:
    path = written(tmp_path, "angle_deg,reading_um", above=line, name="2.0 bar.csv")
    with pytest.raises(lb.InputError, match=r"--force-slope .*--force-offset"):
        imported(path)


@pytest.mark.parametrize("line", LAWS)
def test_a_law_of_force_that_is_given_is_used_with_the_pressure(tmp_path: Path, line: str) -> None:
    path = written(tmp_path, "angle_deg,reading_um", above=line, name="2.0 bar.csv")
    (test,) = imported(path, force_law=lb.campaign.ForceLaw(118.5, -9.0)).tests
    assert (test.force_N, test.pressure_bar) == (228.0, 2.0)


@pytest.mark.parametrize(
    "line",
    [
        "F = 600 N, p = 5 bar",
        "F = 600 N p = 5 bar",
        "Load = 600 N at pressure = 5 bar",
        "Deflection 2.33 µm/bar",
        "Feed 2000 mm/min",
        "Force: 600 N / 5 bar",
        "Force: 600 N at 5 bar",
        "11 bar = maximum",
    ],
)
def test_other_lines_are_no_law(line: str) -> None:
    assert not states_force_law(line)


@pytest.mark.parametrize("line", ["# load [lbf]: 8 8 80 80 160", "Force [N];8;80", "Last: 8; 80 N"])
def test_a_list_of_forces_is_not_taken_for_one(tmp_path: Path, line: str) -> None:
    path = written(tmp_path, "angle_deg,reading_um", above=line, name="a.csv")
    with pytest.raises(lb.InputError, match=r"several numbers in line 1\. Give --forces-N"):
        imported(path)


def test_a_list_of_forces_gives_way_to_those_of_the_user(tmp_path: Path) -> None:
    above = "# load [lbf]: 8 8 80 80 160"
    path = written(tmp_path, "angle_deg,reading_um", above=above, name="a.csv")
    (test,) = imported(path, {"forces_N": [36.0]}).tests
    assert test.force_N == 36.0


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [("force..lbf.", "force", "lbf"), ("dev..mil.", "dev", "mil"), ("theta..deg.", "theta", "deg")],
)
def test_dots_of_r_are_brackets(header: str, name: str, unit: str) -> None:
    assert unit_of(header) == (name, unit)


def test_columns_that_r_has_named_are_read_in_their_units(tmp_path: Path) -> None:
    path = written(tmp_path, "force..lbf.,theta..deg.,dev..mil.", "8,{a},{r}.25")
    (test,) = imported(path).tests
    assert (round(test.force_N or 0.0, 3), float(test.reading_um[1])) == (35.586, 1.25 * 25.4)


@pytest.mark.parametrize(
    ("header", "cell"),
    [("Radius_m", "0.1"), ("R_mm", "100"), ("R [mm]", "100"), ("bar_length_in", "3.937008")],
)
def test_a_column_of_the_radius_is_used(tmp_path: Path, header: str, cell: str) -> None:
    path = written(tmp_path, f"angle_deg,dr_um,{header}", f"{{a}},{{r}}.25,{cell}")
    (test,) = imported(path).tests
    assert test.radius_mm == pytest.approx(100.0, rel=1e-6)


def subjects(path: Path) -> dict[str, str]:
    """Return the reasons of what was assumed about a file; the keys are the subjects."""
    return {entry.what: entry.because for entry in lb.import_campaign(path).assumptions}


def test_a_column_that_states_the_radius_is_not_called_unused(tmp_path: Path) -> None:
    path = written(tmp_path, "angle_deg,dr_um,Radius_m", "{a},{r}.25,0.1")
    assert "columns not used" not in subjects(path)


@pytest.mark.parametrize("header", ["Rnom", "R0", "r_soll", "R_nominal"])
def test_a_column_that_may_be_the_radius_is_named(tmp_path: Path, header: str) -> None:
    path = written(tmp_path, f"angle_deg,dr_um,{header}", "{a},{r}.25,100")
    assert f"says {header}: 100, not taken" in subjects(path)["radius_mm"]


RUNS = "Angle [deg],run 1 36 N [um],run 2 400 N [um],run 3 400 N [um]"


def test_numbers_of_runs_beside_forces_are_asked(tmp_path: Path) -> None:
    path = written(tmp_path, RUNS, "{a},{r}.25,{r}.5,{r}.75", name="a.csv")
    with pytest.raises(lb.InputError, match=r"which number does 'run 2 400 N' mean.*--forces-N"):
        imported(path)


def test_runs_beside_forces_are_read_once_the_forces_are_given(tmp_path: Path) -> None:
    path = written(tmp_path, RUNS, "{a},{r}.25,{r}.5,{r}.75", name="a.csv")
    tests = imported(path, {"forces_N": [36.0, 400.0, 400.0]}).tests
    assert [test.force_N for test in tests] == [36.0, 400.0, 400.0]


@pytest.mark.parametrize("header", ["forca_N", "force_N", "loading_N", "ciężar_N"])
def test_a_column_in_newtons_that_names_tests_states_their_force(
    tmp_path: Path, header: str
) -> None:
    path = written(tmp_path, f"{header},angle_deg,reading_um", "36,{a},{r}.25", name="a.csv")
    (test,) = imported(path, {"columns": {"test": header}}).tests
    assert test.force_N == 36.0


def test_a_largest_force_that_names_tests_is_not_their_force(tmp_path: Path) -> None:
    path = written(tmp_path, "max_N,angle_deg,reading_um", "36,{a},{r}.25", name="a.csv")
    with pytest.raises(lb.InputError, match="force or pressure must be known"):
        imported(path, {"columns": {"test": "max_N"}})


@pytest.mark.parametrize("header", ["ângulo", "angulo", "ÚHEL", "uhel", "kąt", "kat"])
def test_a_header_without_accents_names_the_same_column(header: str) -> None:
    assert has_role(header, "angle")


def test_a_closing_quotation_mark_is_no_inch(tmp_path: Path) -> None:
    path = written(
        tmp_path, "Angle [deg],Reading [um]", above='# write.csv(x, encoding = "latin1")'
    )
    notes = lb.import_campaign(path).assumptions
    (told,) = [note.because for note in notes if note.what == "radius_mm"]
    assert "latin1" not in told


def test_a_length_in_inches_is_told_as_a_possible_radius(tmp_path: Path) -> None:
    path = written(tmp_path, "Angle [deg],Reading [um]", above='# fixture 6"')
    notes = lb.import_campaign(path).assumptions
    (told,) = [note.because for note in notes if note.what == "radius_mm"]
    assert 'fixture 6"' in told
