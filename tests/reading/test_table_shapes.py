"""Tables as instruments and programs arrange them: repeated headers, several tables in a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from campaigns import refuses

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.unit_lines import units_stated

ANGLES = list(range(0, 360, 5))
HEADER = "Angle [deg],Deviation [um]"


def readings(force_N: float) -> list[float]:
    """Return made readings [µm] of a circle at a force, one for each of `ANGLES`."""
    angles_rad = np.deg2rad(ANGLES)
    circle = 0.03 * force_N + 2.0 * np.cos(2.0 * angles_rad) + np.sin(angles_rad)
    return [float(reading) for reading in np.round(circle, 3)]


def rows(force_N: float, separator: str = ",") -> list[str]:
    """Return the lines of a table of angles and readings."""
    lines = []
    for angle, reading in zip(ANGLES, readings(force_N), strict=True):
        lines.append(f"{angle}{separator}{reading}")
    return lines


def file(folder: Path, name: str, lines: list[str], encoding: str = "utf-8") -> Path:
    """Write lines to a file and return its path."""
    path = folder / name
    path.write_text("\n".join(lines) + "\n", encoding=encoding)
    return path


def read_tests(path: Path, **layout: object) -> list[lb.CircularTest]:
    """Return the tests that are read from a file."""
    return list(lb.import_campaign([path], layout=Layout(**layout)).campaign.tests)


def check_test(test: lb.CircularTest, force_N: float) -> None:
    """Check force, angles and readings of a test."""
    assert test.force_N == force_N
    np.testing.assert_allclose(test.angle_deg, ANGLES)
    np.testing.assert_allclose(test.reading_um, readings(force_N))


@pytest.mark.parametrize("between", [[], ["Page 2"], ["Seite 2 von 3"], ["- 2 -"]])
def test_a_header_repeated_on_every_page_is_left_out(between: list[str], tmp_path: Path) -> None:
    lines = rows(100.0)
    path = file(tmp_path, "100N.csv", [HEADER, *lines[:30], *between, HEADER, *lines[30:]])
    (test,) = read_tests(path)
    check_test(test, 100.0)


def test_a_repeated_header_is_told_with_what_was_read(tmp_path: Path) -> None:
    lines = rows(100.0)
    path = file(tmp_path, "100N.csv", [HEADER, *lines[:30], HEADER, *lines[30:]])
    notes = lb.import_campaign([path]).assumptions
    (told,) = [note.value for note in notes if note.what == "repeated headers"]
    assert told == "1 passed over, the table is read whole"


def test_two_tables_with_a_line_above_each_are_two_tests(tmp_path: Path) -> None:
    first = ["Direction: CW", HEADER, *rows(100.0)]
    second = ["Direction: CCW", HEADER, *rows(100.0)]
    clockwise, counter_clockwise = read_tests(file(tmp_path, "100N.csv", [*first, *second]))
    assert (clockwise.direction, counter_clockwise.direction) == ("CW", "CCW")
    check_test(counter_clockwise, 100.0)


def test_lines_above_the_first_table_hold_for_the_second(tmp_path: Path) -> None:
    first = ["Radius: 100 mm", "Force: 100 N", HEADER, *rows(100.0)]
    second = ["Force: 300 N", HEADER, *rows(300.0)]
    tests = read_tests(file(tmp_path, "all.csv", [*first, *second]))
    assert [test.radius_mm for test in tests] == [100.0, 100.0]
    check_test(tests[0], 100.0)
    check_test(tests[1], 300.0)


@pytest.mark.parametrize(
    ("above_all", "start"),
    [
        ([], "Start time: 2026-11-20 14:{minute}:12"),
        (["Date: 2026-11-20"], "Time: 14:{minute}:12"),
        ([], "20.11.2026 14:{minute}:12"),
    ],
)
def test_tables_below_each_other_have_start_times_of_their_own(
    above_all: list[str], start: str, tmp_path: Path
) -> None:
    lines = list(above_all)
    for force_N, minute in ((100.0, "03"), (300.0, "11"), (500.0, "20")):
        lines += [f"Force: {force_N:g} N", start.format(minute=minute), HEADER, *rows(force_N)]
    tests = read_tests(file(tmp_path, "all.csv", lines))
    assert [test.time_s for test in tests] == [0.0, 480.0, 1020.0]


def test_two_files_copied_together_are_two_tests(tmp_path: Path) -> None:
    path = file(tmp_path, "both.csv", [HEADER, *rows(100.0), HEADER, *rows(300.0)])
    tests = read_tests(path, forces_N=[100.0, 300.0])
    check_test(tests[0], 100.0)
    check_test(tests[1], 300.0)


def test_two_files_copied_together_have_no_force_of_their_own(tmp_path: Path) -> None:
    path = file(tmp_path, "both.csv", [HEADER, *rows(100.0), HEADER, *rows(300.0)])
    refuses("force", read_tests, path)


def pairs(tmp_path: Path, headers: str) -> Path:
    """Write two tables beside each other, the second shorter and beginning at 90°."""
    lines = [headers]
    first = rows(100.0, ";")
    second = [*rows(300.0, ";")[18:], *[";"] * 18]
    for left, right in zip(first, second, strict=True):
        lines.append(f"{left};{right}")
    return file(tmp_path, "wide.csv", lines)


def test_pairs_of_angle_and_reading_are_tests(tmp_path: Path) -> None:
    path = pairs(tmp_path, "Angle A [deg];100 N [um];Angle B [deg];300 N [um]")
    first, second = read_tests(path)
    check_test(first, 100.0)
    assert second.force_N == 300.0
    np.testing.assert_allclose(second.angle_deg, ANGLES[18:])
    np.testing.assert_allclose(second.reading_um, readings(300.0)[18:])


def numbered_pairs(tmp_path: Path, headers: list[str]) -> Path:
    """Write two tables of angles and readings behind a column that numbers the rows."""
    lines = list(headers)
    both = zip(rows(100.0, ";"), rows(300.0, ";"), strict=True)
    for number, (left, right) in enumerate(both, start=1):
        lines.append(f"{number};{left};{right}")
    return file(tmp_path, "wide.csv", lines)


@pytest.mark.parametrize(
    "headers",
    [
        ["No.;Angle [deg];100 N [um];Angle [deg];300 N [um]"],
        ["No.;Angle 100 N [deg];Dev [um];Angle 300 N [deg];Dev [um]"],
        [";100 N;;300 N;", "No.;Angle [deg];Dev [um];Angle [deg];Dev [um]"],
        ["Force [N];100;;300;", "No.;Angle [deg];Dev [um];Angle [deg];Dev [um]"],
    ],
)
def test_pairs_may_stand_behind_the_number_of_the_row(headers: list[str], tmp_path: Path) -> None:
    first, second = read_tests(numbered_pairs(tmp_path, headers))
    check_test(first, 100.0)
    check_test(second, 300.0)


def test_a_number_of_the_row_beside_pairs_is_told(tmp_path: Path) -> None:
    path = numbered_pairs(tmp_path, ["No.;Angle [deg];100 N [um];Angle [deg];300 N [um]"])
    notes = lb.import_campaign([path]).assumptions
    (told,) = [note.value for note in notes if note.what == "columns not used"]
    assert told == "No."


def test_a_column_of_angles_with_a_load_holds_no_readings(tmp_path: Path) -> None:
    path = numbered_pairs(tmp_path, ["No.;Angle 100 N [deg];D1;Angle 300 N [deg];Dev 300 N"])
    columns = {"angle": 2}
    refuses("one column of angles", read_tests, path, columns=columns, reading_unit="um")


def test_pairs_of_equal_headers_need_forces(tmp_path: Path) -> None:
    path = pairs(tmp_path, "Angle [deg];Deviation [um];Angle [deg];Deviation [um]")
    refuses("force", read_tests, path)
    first, second = read_tests(path, forces_N=[100.0, 300.0])
    check_test(first, 100.0)
    np.testing.assert_allclose(second.reading_um, readings(300.0)[18:])


def test_the_layout_of_pairs_reads_them_again(tmp_path: Path) -> None:
    path = pairs(tmp_path, "Angle [deg];Deviation [um];Angle [deg];Deviation [um]")
    layout = Layout(forces_N=[100.0, 300.0])
    result = lb.import_campaign([path], layout=layout)
    again = lb.import_campaign([path], layout=result.layout)
    assert again.campaign.sha256 == result.campaign.sha256


def test_a_stated_column_keeps_the_table_whole(tmp_path: Path) -> None:
    path = pairs(tmp_path, "Angle A [deg];100 N [um];Angle B [deg];300 N [um]")
    (test,) = read_tests(path, columns={"angle": 1, "reading": 2})
    check_test(test, 100.0)


def test_names_of_rows_as_r_writes_them(tmp_path: Path) -> None:
    lines = ['"angle_deg" "reading_um"']
    for number, line in enumerate(rows(100.0, " "), start=1):
        lines.append(f'"{number}" {line}')
    (test,) = read_tests(file(tmp_path, "100N.txt", lines))
    check_test(test, 100.0)


def test_a_first_column_without_name_that_numbers_no_rows_is_refused(tmp_path: Path) -> None:
    lines = ["angle_deg,reading_um"]
    for number, line in enumerate(rows(100.0), start=1):
        lines.append(f"{2 * number},{line}")
    refuses("must name every column", read_tests, file(tmp_path, "100N.csv", lines))


def test_a_column_of_unknown_name_has_the_role_of_its_unit(tmp_path: Path) -> None:
    path = file(tmp_path, "100N.csv", ["Suunta [deg],Outo [um]", *rows(100.0)])
    (test,) = read_tests(path)
    check_test(test, 100.0)


def test_two_columns_of_unknown_names_and_one_unit_are_refused(tmp_path: Path) -> None:
    lines = ["Angle [deg],Outo [um],Siirto [um]"]
    for line in rows(100.0):
        lines.append(f"{line},1.5")
    refuses("--reading-column", read_tests, file(tmp_path, "100N.csv", lines))


@pytest.mark.parametrize(
    ("encoding", "header"),
    [
        ("gb18030", "角度(度),测量值(微米)"),
        ("gb18030", "角度(°),偏差(μm)"),
        ("big5", "角度(度),測量值(微米)"),
        ("shift_jis", "角度[度],変位[μm]"),
        ("euc_jp", "角度[度],変位[μm]"),
        ("euc_kr", "각도[도],편차[마이크로미터]"),
        ("cp1251", "Угол [град],Отклонение [мкм]"),
        ("koi8_r", "Угол [град],Отклонение [мкм]"),
        ("cp1253", "Γωνία [μοίρες],Απόκλιση [μικρόμετρα]"),
        ("mac_roman", "Winkel [°],Abweichung [µm]"),
        ("cp1250", "Úhel [°],Odchylka [µm]"),
        ("cp1252", "Winkel [°],Abweichung [µm]"),
        ("utf-16", "Winkel [°],Abweichung [µm]"),
    ],
)
def test_encodings(encoding: str, header: str, tmp_path: Path) -> None:
    (test,) = read_tests(file(tmp_path, "100N.csv", [header, *rows(100.0)], encoding))
    check_test(test, 100.0)


LABVIEW = """LabVIEW Measurement\t
Writer_Version\t2
Separator\tTab
Decimal_Separator\t.
X_Columns\t{columns}
Operator\tlab
Date\t2026/05/11
***End_of_Header***\t
\t
Channels\t2\t\t
Samples\t72\t72\t
Y_Unit_Label\tMikrometer\tN\t
X_Dimension\tTime\tTime\t
X0\t0.0\t0.0\t
Delta_X\t0.392699\t0.392699\t
***End_of_Header***\t\t\t
X_Value\tUntitled\tUntitled 1\tComment"""


@pytest.mark.parametrize("columns", ["One", "No"])
def test_files_of_labview_are_read(columns: str, tmp_path: Path) -> None:
    lines = LABVIEW.format(columns=columns).split("\n")
    for number, reading in enumerate(readings(100.0)):
        time = ""
        if columns == "One":
            time = f"{0.392699 * number:.6f}"
        lines.append(f"{time}\t{reading}\t100.0\t")
    path = file(tmp_path, "run.lvm", lines)
    (test,) = read_tests(path, feed_mm_per_min=2000.0)
    assert test.force_N == 100.0
    np.testing.assert_allclose(test.angle_deg, ANGLES, atol=1e-4)
    np.testing.assert_allclose(test.reading_um, readings(100.0))


@pytest.mark.parametrize("mark", ["’", "'", "_"])
def test_marks_between_thousands(mark: str, tmp_path: Path) -> None:
    lines = [HEADER]
    for angle, reading in zip(ANGLES, readings(100.0), strict=True):
        lines.append(f"{angle},1{mark}{reading + 200.0:07.3f}")
    (test,) = read_tests(file(tmp_path, "100N.csv", lines), reading_unit="um")
    np.testing.assert_allclose(test.reading_um, np.array(readings(100.0)) + 1200.0)


def wide(tmp_path: Path, header: str, above: str = "") -> Path:
    """Write a table with an angle and a reading for each of three forces in every row."""
    lines = [above] if above else []
    lines.append(header)
    columns = [readings(force_N) for force_N in (100.0, 300.0, 600.0)]
    for angle, first, second, third in zip(ANGLES, *columns, strict=True):
        lines.append(f"{angle},{first},{second},{third}")
    return file(tmp_path, "wide.csv", lines)


def check_tests(tests: list[lb.CircularTest]) -> None:
    """Check the tests of a table that `wide` wrote."""
    for test, force_N in zip(tests, (100.0, 300.0, 600.0), strict=True):
        check_test(test, force_N)


@pytest.mark.parametrize(
    "header",
    [
        "Angle [deg],Run 1 [um],Run 2 [um],Run 3 [um]",
        "Winkel,Lauf 1,Lauf 2,Lauf 3",
        "Angle,Deviation run 1,Deviation run 2,Deviation run 3",
        "Angle [deg],100,300,600",
    ],
)
def test_columns_of_runs_are_tests_whose_forces_are_asked(header: str, tmp_path: Path) -> None:
    path = wide(tmp_path, header)
    refuses("--forces-N", read_tests, path)
    check_tests(read_tests(path, forces_N=[100.0, 300.0, 600.0]))


@pytest.mark.parametrize("above", ["Force [N],100,300,600", ",100 N,300 N,600 N"])
def test_forces_in_the_line_above_the_header(above: str, tmp_path: Path) -> None:
    path = wide(tmp_path, "Angle [deg],Deviation [um],Deviation [um],Deviation [um]", above)
    check_tests(read_tests(path))


def test_forces_above_the_header_are_read_again_with_the_layout(tmp_path: Path) -> None:
    header = "Angle [deg],Deviation [um],Deviation [um],Deviation [um]"
    path = wide(tmp_path, header, "Force [kN],0.1,0.3,0.6")
    result = lb.import_campaign([path])
    check_tests(list(result.campaign.tests))
    again = lb.import_campaign([path], layout=result.layout)
    assert again.campaign.sha256 == result.campaign.sha256


def test_the_step_of_repeated_headers(tmp_path: Path) -> None:
    path = wide(tmp_path, "Angle [deg],Deviation [um],Deviation [um],Deviation [um]")
    step = "--reading-column 2 --reading-column 3 --reading-column 4"
    refuses(step, read_tests, path)
    check_tests(read_tests(path, columns={"reading": [2, 3, 4]}, forces_N=[100.0, 300.0, 600.0]))


def test_units_in_some_cells_are_those_of_the_header(tmp_path: Path) -> None:
    lines = [HEADER]
    for angle, reading in zip(ANGLES, readings(100.0), strict=True):
        unit = " um" if angle % 10 else ""
        lines.append(f"{angle},{reading}{unit}")
    (test,) = read_tests(file(tmp_path, "100N.csv", lines))
    check_test(test, 100.0)


def test_units_in_some_cells_alone_are_refused(tmp_path: Path) -> None:
    lines = ["Angle,Deviation"]
    for angle, reading in zip(ANGLES, readings(100.0), strict=True):
        unit = " mm" if angle % 10 else ""
        lines.append(f"{angle},{reading}{unit}")
    path = file(tmp_path, "100N.csv", lines)
    refuses("--unit", read_tests, path)
    (test,) = read_tests(path, reading_unit="um")
    check_test(test, 100.0)


def in_counts(size_um: float) -> list[str]:
    """Return the lines of a table whose readings are in counts of a size [µm]."""
    lines = []
    for angle, reading in zip(ANGLES, readings(100.0), strict=True):
        lines.append(f"{angle},{reading / size_um:.0f}")
    return lines


def test_a_line_with_a_factor_before_the_unit(tmp_path: Path) -> None:
    lines = ["Unit of readings = 10 nm", "Angle [deg],Deviation", *in_counts(0.01)]
    (test,) = read_tests(file(tmp_path, "100N.csv", lines))
    np.testing.assert_allclose(test.reading_um, readings(100.0), atol=0.006)


@pytest.mark.parametrize("header", ["Unit", "Einheit"])
def test_a_column_of_units_with_a_factor(header: str, tmp_path: Path) -> None:
    lines = [f"Angle [deg],Deviation,{header}"]
    lines += [f"{line},0.1 µm" for line in in_counts(0.1)]
    (test,) = read_tests(file(tmp_path, "100N.csv", lines))
    np.testing.assert_allclose(test.reading_um, readings(100.0), atol=0.06)


@pytest.mark.parametrize("header", ["Écart counts", "Deviation_digits", "Abweichung inc"])
def test_counts_of_unknown_size_are_refused(header: str, tmp_path: Path) -> None:
    path = file(tmp_path, "100N.csv", [f"Angle [deg],{header}", *in_counts(0.1)])
    refuses("--unit '0.1 um' for counts", read_tests, path)
    (test,) = read_tests(path, reading_unit="0.1 um")
    np.testing.assert_allclose(test.reading_um, readings(100.0), atol=0.06)


def test_the_size_of_counts_in_a_line_holds_for_the_header(tmp_path: Path) -> None:
    lines = ["1 count = 0.1 µm", "Angle [deg],Deviation counts", *in_counts(0.1)]
    (test,) = read_tests(file(tmp_path, "100N.csv", lines))
    np.testing.assert_allclose(test.reading_um, readings(100.0), atol=0.06)


@pytest.mark.parametrize(("name", "sign"), [("-dR", -1.0), ("- dR", 1.0), ("dR", 1.0)])
def test_a_minus_sign_behind_a_load_turns_the_readings(
    name: str, sign: float, tmp_path: Path
) -> None:
    lines = [f"Angle [deg],100 N {name} [um],300 N {name} [um]"]
    for angle, light, heavy in zip(ANGLES, readings(100.0), readings(300.0), strict=True):
        lines.append(f"{angle},{light},{heavy}")
    tests = read_tests(file(tmp_path, "all.csv", lines))
    np.testing.assert_allclose(tests[1].reading_um, sign * np.array(readings(300.0)))


@pytest.mark.parametrize(
    "line",
    ["Angle: deg; Reading: 10 nm", "Winkel: Grad | Messwert: 0,01 µm", "Reading=10nm,Angle=°"],
)
def test_a_line_of_quantities_with_their_units_states_units(line: str, tmp_path: Path) -> None:
    numbers = []
    for angle, reading in zip(ANGLES, readings(100.0), strict=True):
        numbers.append(f"{angle};{100.0 * reading:.1f}")
    path = file(tmp_path, "100N.csv", [line, "Angle;Reading", *numbers])
    (test,) = read_tests(path)
    check_test(test, 100.0)


def test_a_line_of_quantities_with_their_units_is_not_told_as_unread(tmp_path: Path) -> None:
    path = file(tmp_path, "100N.csv", ["Angle: deg; Reading: um", "Angle,Reading", *rows(100.0)])
    reasons = [note.because for note in lb.import_campaign([path]).assumptions]
    assert [reason for reason in reasons if "not understood" in reason] == []


@pytest.mark.parametrize(
    "line",
    [
        "Angle: deg; Deviation: 5 µm",
        "Angle: deg; Deviation: 1000 µm",
        "Angle: 10 deg; Reading: mm",
        "Angle: deg; Radius: mm",
        "Angle: deg; Reading: mm; Reading: um",
    ],
)
def test_a_line_of_quantities_with_values_states_no_units(line: str) -> None:
    assert units_stated(line) == {}


@pytest.mark.parametrize("header", ["theta_Y0_cw", "angle_y0", "theta_-X0_ccw"])
def test_a_header_of_angles_that_names_an_axis_and_zero_is_asked_for(
    header: str, tmp_path: Path
) -> None:
    path = file(tmp_path, "100N.csv", [f"{header},Deviation [um]", *rows(100.0)])
    refuses("angles must begin at an axis, got .* Say at which: --angle-zero", read_tests, path)


def test_a_header_of_angles_with_an_axis_and_zero_is_read_with_the_step(tmp_path: Path) -> None:
    path = file(tmp_path, "100N.csv", ["theta_Y0_cw,Deviation [um]", *rows(100.0)])
    (test,) = read_tests(path, angle_zero="+Y")
    np.testing.assert_allclose(test.angle_deg[:2], [90.0, 85.0])


def test_forces_above_names_and_units_of_pairs_are_their_loads(tmp_path: Path) -> None:
    lines = [
        "Kraft_N,100,100,300,300",
        "Größe,Winkel,Abstand,Winkel,Abstand",
        "Einheit,°,mm,°,mm",
        "Punkt,,,,",
    ]
    pairs_of_rows = zip(rows(100.0), rows(300.0), strict=True)
    for number, (first, second) in enumerate(pairs_of_rows):
        cells = []
        for row in (first, second):
            angle, reading = row.split(",")
            cells += [angle, f"{150.0 + float(reading) / 1e3:.6f}"]
        lines.append(",".join([str(number), *cells]))
    tests = read_tests(file(tmp_path, "wide.csv", lines))
    assert [test.force_N for test in tests] == [100.0, 300.0]
    for test, force_N in zip(tests, (100.0, 300.0), strict=True):
        np.testing.assert_allclose(test.reading_um, readings(force_N), atol=1e-6)
