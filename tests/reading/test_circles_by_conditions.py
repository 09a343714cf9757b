"""Tables whose circles are told apart by their conditions: force, direction and plane together."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import Layout

ANGLES_DEG = range(0, 360, 10)
FORCES_N = (100.0, 300.0)
DIRECTIONS = ("CCW", "CW")


def reading_um(angle_deg: float, force_N: float, direction: str) -> float:
    """Return a reading that differs between forces and directions."""
    shift_um = 0.5 if direction == "CW" else 0.0
    return round(0.02 * force_N + np.cos(np.deg2rad(angle_deg)) + shift_um, 3)


def long_table(path: Path, header: str, rows: Sequence[str]) -> Path:
    path.write_text("\n".join([header, *rows, ""]))
    return path


def rows_of_circles(noise_N: Sequence[float] = (0.0,)) -> list[str]:
    """Return rows of four circles below each other; ``noise_N`` is added to the forces in turn."""
    rows = []
    for force_N in FORCES_N:
        for direction in DIRECTIONS:
            for k, angle_deg in enumerate(ANGLES_DEG):
                force = force_N + noise_N[k % len(noise_N)]
                reading = reading_um(angle_deg, force_N, direction)
                rows.append(f"{force:g},{direction},{angle_deg},{reading}")
    return rows


HEADER = "Force [N],Direction,Angle [deg],Reading [um]"


def conditions(campaign: lb.Campaign) -> list[tuple[float | None, str | None]]:
    return [(test.force_N, test.direction) for test in campaign.tests]


def test_force_and_direction_together_are_a_circle(tmp_path: Path) -> None:
    path = long_table(tmp_path / "all.csv", HEADER, rows_of_circles())
    campaign = lb.import_campaign(path).campaign
    assert conditions(campaign) == [(100, "CCW"), (100, "CW"), (300, "CCW"), (300, "CW")]
    assert [test.name for test in campaign.tests][:2] == ["100 N CCW", "100 N CW"]
    for test in campaign.tests:
        expected = [reading_um(a, test.force_N, test.direction) for a in test.angle_deg]
        assert test.reading_um == pytest.approx(expected)


def test_plane_and_force_together_are_a_circle(tmp_path: Path) -> None:
    rows = []
    for plane in ("XY", "ZX"):
        for force_N in FORCES_N:
            rows += [f"{plane},{force_N:g},{a},{reading_um(a, force_N, '')}" for a in ANGLES_DEG]
    path = long_table(tmp_path / "all.csv", "plane,Force [N],Angle [deg],Reading [um]", rows)
    tests = lb.import_campaign(path).campaign.tests
    found = [(test.plane, test.force_N) for test in tests]
    assert found == [("XY", 100), ("XY", 300), ("ZX", 100), ("ZX", 300)]


def test_the_layout_reads_the_conditions_again(tmp_path: Path) -> None:
    path = long_table(tmp_path / "all.csv", HEADER, rows_of_circles())
    result = lb.import_campaign(path)
    again = lb.import_campaign(path, layout=result.layout)
    assert again.campaign.sha256 == result.campaign.sha256


def test_a_force_that_changes_from_row_to_row_tells_no_circles_apart(tmp_path: Path) -> None:
    rows = rows_of_circles(noise_N=(0.0, 1.0, -1.0))
    with pytest.raises(lb.InputError, match="direction must be CW or CCW in all rows of a test"):
        lb.import_campaign(long_table(tmp_path / "all.csv", HEADER, rows))


def test_one_condition_alone_as_the_column_of_tests_is_refused(tmp_path: Path) -> None:
    path = long_table(tmp_path / "all.csv", HEADER, rows_of_circles())
    step = "Only 'Force \\[N\\]' and 'Direction' together name tests .* Leave --test-column out"
    with pytest.raises(lb.InputError, match=step):
        lb.import_campaign(path, layout=Layout(columns={"test": "Force [N]"}))


# ---- a column of readings for each direction


@pytest.mark.parametrize(
    ("header", "directions"),
    [
        ("Angle [deg],CCW [um],CW [um]", ["CCW", "CW"]),
        ("Angle [deg],Radial deviation CW [um],Radial deviation CCW [um]", ["CW", "CCW"]),
        ("Angle [deg],Clockwise,Counter-clockwise", ["CW", "CCW"]),
    ],
)
def test_a_column_for_each_direction_is_a_circle(
    header: str, directions: list[str], tmp_path: Path
) -> None:
    rows = []
    for angle_deg in ANGLES_DEG:
        readings = [f"{reading_um(angle_deg, 300.0, direction)}" for direction in directions]
        rows.append(",".join([f"{angle_deg}", *readings]))
    path = long_table(tmp_path / "300N.csv", header, rows)
    campaign = lb.import_campaign(path, layout=Layout(reading_unit="um")).campaign
    assert conditions(campaign) == [(300, direction) for direction in directions]
    for test in campaign.tests:
        expected = [reading_um(a, 300.0, test.direction) for a in test.angle_deg]
        assert test.reading_um == pytest.approx(expected)


def test_two_columns_of_one_direction_are_asked_for(tmp_path: Path) -> None:
    rows = [f"{a},{reading_um(a, 300.0, 'CW')},{reading_um(a, 300.0, '')}" for a in ANGLES_DEG]
    header = "Angle [deg],Deviation CW 1 [um],Deviation CW 2 [um]"
    with pytest.raises(lb.InputError, match="one column must hold the reading"):
        lb.import_campaign(long_table(tmp_path / "300N.csv", header, rows))


# ---- a header of two rows whose upper row names angles and loads


@pytest.mark.parametrize(
    ("upper", "lower"),
    [
        ("Angle;100 N;;300 N;", "°;CCW [µm];CW [µm];CCW [µm];CW [µm]"),
        ("Angle [°];100 N;;300 N;", ";CCW [µm];CW [µm];CCW [µm];CW [µm]"),
        ("Angle [°];100 N;100 N;300 N;300 N", ";CCW [µm];CW [µm];CCW [µm];CW [µm]"),
    ],
)
def test_loads_beside_the_name_of_the_angles_stand_above_directions(
    upper: str, lower: str, tmp_path: Path
) -> None:
    rows = []
    for angle_deg in ANGLES_DEG:
        cells = [f"{angle_deg}"]
        for force_N in FORCES_N:
            cells += [f"{reading_um(angle_deg, force_N, sense)}" for sense in DIRECTIONS]
        rows.append(";".join(cells))
    path = long_table(tmp_path / "all.csv", upper, [lower, *rows])
    campaign = lb.import_campaign(path).campaign
    assert conditions(campaign) == [(100, "CCW"), (100, "CW"), (300, "CCW"), (300, "CW")]
    for test in campaign.tests:
        expected = [reading_um(a, test.force_N, test.direction) for a in test.angle_deg]
        assert test.reading_um == pytest.approx(expected)


# ---- tables sorted by angle, and pairs of columns for each direction


def test_circles_of_a_table_that_is_sorted_by_angle(tmp_path: Path) -> None:
    by_angle = sorted(rows_of_circles(), key=lambda row: float(row.split(",")[2]))
    campaign = lb.import_campaign(long_table(tmp_path / "all.csv", HEADER, by_angle)).campaign
    assert conditions(campaign) == [(100, "CCW"), (100, "CW"), (300, "CCW"), (300, "CW")]
    for test in campaign.tests:
        expected = [reading_um(a, test.force_N, test.direction) for a in test.angle_deg]
        assert test.reading_um == pytest.approx(expected)


def test_force_and_direction_that_change_together_are_circles(tmp_path: Path) -> None:
    rows = [f"{row}" for row in rows_of_circles() if row.startswith(("100,CCW", "300,CW"))]
    campaign = lb.import_campaign(long_table(tmp_path / "all.csv", HEADER, rows)).campaign
    assert conditions(campaign) == [(100, "CCW"), (300, "CW")]


def test_pairs_of_columns_for_each_direction_in_several_files(tmp_path: Path) -> None:
    header = "Angle CCW [deg];CCW [um];Angle CW [deg];CW [um]"
    paths = []
    for force_N in FORCES_N:
        rows = []
        for a in ANGLES_DEG:
            up = f"{a};{reading_um(a, force_N, 'CCW')}"
            rows.append(f"{up};{360 - a};{reading_um(360 - a, force_N, 'CW')}")
        paths.append(long_table(tmp_path / f"{force_N:g} N.csv", header, rows))
    campaign = lb.import_campaign(paths).campaign
    assert [test.name for test in campaign.tests] == ["CCW", "CW", "300 N CCW", "300 N CW"]
    assert conditions(campaign) == [(100, "CCW"), (100, "CW"), (300, "CCW"), (300, "CW")]
    for test in campaign.tests:
        expected = [reading_um(a, test.force_N, test.direction) for a in test.angle_deg]
        assert test.reading_um == pytest.approx(expected)


def test_a_file_with_pairs_that_is_named_twice_is_refused(tmp_path: Path) -> None:
    rows = [f"{a};{a % 70}.5;{a};{a % 30}.5" for a in ANGLES_DEG]
    path = long_table(tmp_path / "100 N.csv", "Angle [deg];CCW [um];Angle [deg];CW [um]", rows)
    with pytest.raises(lb.InputError, match="tests must bear different names, got 'CCW' twice"):
        lb.import_campaign([path, path])


@pytest.mark.parametrize(("header", "factor"), [("R [mm]", 1), ("Diameter [mm]", 2)])
def test_radius_and_force_together_are_a_circle(header: str, factor: int, tmp_path: Path) -> None:
    rows = []
    for radius_mm in (100, 150):
        rows += [
            f"{factor * radius_mm},100,CCW,{a},{reading_um(a, 100, 'CCW')}" for a in ANGLES_DEG
        ]
    rows += [f"{factor * 100},300,CW,{a},{reading_um(a, 300, 'CW')}" for a in ANGLES_DEG]
    path = long_table(tmp_path / "all.csv", f"{header},{HEADER}", rows)
    tests = lb.import_campaign(path).campaign.tests
    found = [(test.radius_mm, test.force_N, test.direction) for test in tests]
    assert found == [(100, 100, "CCW"), (150, 100, "CCW"), (100, 300, "CW")]


@pytest.mark.parametrize("header", ["Height [mm]", "Operator"])
def test_circles_of_one_condition_that_a_further_column_divides_are_not_joined(
    header: str, tmp_path: Path
) -> None:
    rows = []
    for number in (1, 2):
        rows += [f"{number},100,CCW,{a},{reading_um(a, 100, 'CCW')}" for a in ANGLES_DEG]
    rows += [f"1,300,CW,{a},{reading_um(a, 300, 'CW')}" for a in ANGLES_DEG]
    refusal = (
        "direction must be CW or CCW in all rows .* in a column of its own \\(--test-column\\)"
    )
    with pytest.raises(lb.InputError, match=refusal):
        lb.import_campaign(long_table(tmp_path / "all.csv", f"{header},{HEADER}", rows))
    named = [f"circle {k // len(ANGLES_DEG)},{row}" for k, row in enumerate(rows)]
    path = long_table(tmp_path / "named.csv", f"name,{header},{HEADER}", named)
    campaign = lb.import_campaign(path, layout=Layout(columns={"test": "name"})).campaign
    assert conditions(campaign) == [(100, "CCW"), (100, "CCW"), (300, "CW")]


def test_a_sign_below_an_unknown_header_is_no_reason_to_join_circles(tmp_path: Path) -> None:
    signs = {"CCW": "+", "CW": "-"}
    rows = []
    for force_N in FORCES_N:
        for sense in DIRECTIONS:
            rows += [
                f"{signs[sense]},{force_N:g},{a},{reading_um(a, force_N, sense)}"
                for a in ANGLES_DEG
            ]
    path = long_table(tmp_path / "q.csv", "q,Force [N],Angle [deg],Reading [um]", rows)
    with pytest.raises(lb.InputError, match="Name the test of each row in a column"):
        lb.import_campaign(path)
    path = long_table(tmp_path / "rot.csv", "rot,Force [N],Angle [deg],Reading [um]", rows)
    with pytest.raises(
        lb.InputError, match="directions must be CW or CCW, got \\+, - in column 'rot'"
    ):
        lb.import_campaign(path)


@pytest.mark.parametrize("header", ["rep no.", "Run", "Circle", "Wdh"])
@pytest.mark.parametrize("order", ["one below the other", "in turn", "by angle"])
def test_repeated_circles_that_a_column_numbers(order: str, header: str, tmp_path: Path) -> None:
    rows = []
    for number in (1, 2):
        for row in rows_of_circles():
            rows.append(f"{number},{row}")
    if order == "one below the other":
        rows.sort(key=lambda row: row.split(",")[1:3])
    if order == "by angle":
        rows.sort(key=lambda row: float(row.split(",")[3]))
    path = long_table(tmp_path / "all.csv", f"{header},{HEADER}", rows)
    result = lb.import_campaign(path)
    assert len(result.campaign.tests) == 8
    assert {test.angle_deg.size for test in result.campaign.tests} == {len(ANGLES_DEG)}
    assert f"{header} 2 100 N CW".replace(".", "_") in [
        test.name.replace(".", "_") for test in result.campaign.tests
    ]
    assert lb.import_campaign(path, layout=result.layout).campaign.sha256 == result.campaign.sha256


@pytest.mark.parametrize(("header", "factor"), [("R [mm]", 1), ("Diameter [mm]", 2)])
@pytest.mark.parametrize("order", ["one below the other", "by angle"])
def test_a_radius_alone_tells_circles_apart(
    order: str, header: str, factor: int, tmp_path: Path
) -> None:
    rows = []
    for radius_mm in (100, 150):
        rows += [f"{factor * radius_mm},100,{a},{reading_um(a, radius_mm, '')}" for a in ANGLES_DEG]
    if order == "by angle":
        rows.sort(key=lambda row: float(row.split(",")[2]))
    path = long_table(tmp_path / "all.csv", f"{header},Force [N],Angle [deg],Reading [um]", rows)
    tests = lb.import_campaign(path).campaign.tests
    assert [(test.radius_mm, test.angle_deg.size) for test in tests] == [(100, 36), (150, 36)]


# ---- directions in headers that may mean something else


@pytest.mark.parametrize("readings", [["Reading [um]", "Reading [um]"], ["CCW [um]", "CW [um]"]])
def test_angles_headed_by_both_directions_are_asked_for(
    readings: list[str], tmp_path: Path
) -> None:
    header = f"Angle CW [deg];{readings[0]};Angle CCW [deg];{readings[1]}"
    rows = [
        f"{360 - a};{reading_um(360 - a, 0, '')};{a};{reading_um(a, 0, '')}" for a in ANGLES_DEG
    ]
    path = long_table(tmp_path / "300N.csv", header, rows)
    question = "must run clockwise or counter-clockwise, got 'Angle CW \\[deg\\], Angle CCW"
    with pytest.raises(lb.InputError, match=question):
        lb.import_campaign(path)
    tests = lb.import_campaign(path, layout=Layout(angle_sense="CCW")).campaign.tests
    of_travel = ["CW", "CCW"] if readings[0] == "Reading [um]" else ["CCW", "CW"]
    assert [test.direction for test in tests] == of_travel
    for test in tests:
        expected = [reading_um(a, 0, "") for a in test.angle_deg]
        assert test.reading_um == pytest.approx(expected)


def table_with_two_columns_of_readings(path: Path, first: str, second: str) -> Path:
    """Write a row for each force and angle, with two readings."""
    rows = []
    for force_N in FORCES_N:
        for a in ANGLES_DEG:
            rows.append(f"{force_N};{a};{a % 50 + force_N:g};{a % 50 + 1.01 * force_N:g}")
    return long_table(path, f"Force [N];Angle [deg];{first};{second}", rows)


def test_a_table_by_force_with_a_column_for_each_direction_is_split_by_both(tmp_path: Path) -> None:
    path = table_with_two_columns_of_readings(tmp_path / "all.csv", "CW [um]", "CCW [um]")
    with pytest.raises(lb.InputError, match=r"each value is a test, give --test-column 'Force"):
        lb.import_campaign(path)
    layout = Layout(columns={"test": "Force [N]"})
    tests = lb.import_campaign(path, layout=layout).campaign.tests
    assert len(tests) == 2 * len(FORCES_N)
    for test in tests:
        factor = 1.0 if test.direction == "CW" else 1.01
        expected = [a % 50 + factor * test.force_N for a in test.angle_deg]
        assert test.reading_um == pytest.approx(expected)
    circles = {(test.force_N, test.direction) for test in tests}
    assert circles == {(force_N, sense) for force_N in FORCES_N for sense in ("CW", "CCW")}


def test_columns_of_readings_without_directions_beside_tests_are_asked_for(tmp_path: Path) -> None:
    path = table_with_two_columns_of_readings(
        tmp_path / "all.csv", "Reading 1 [um]", "Reading 2 [um]"
    )
    layout = Layout(columns={"test": "Force [N]"})
    question = "one column must hold the reading, .* or all, each a test of its own"
    with pytest.raises(lb.InputError, match=question):
        lb.import_campaign(path, layout=layout)
    named = table_with_two_columns_of_readings(tmp_path / "loads.csv", "run 1 36 N", "run 2 36 N")
    question = "must have one column of readings, .* got 2 .* once for each column"
    with pytest.raises(lb.InputError, match=question):
        lb.import_campaign(named, layout=layout)
    both = ["Reading 1 [um]", "Reading 2 [um]"]
    layout = Layout(columns={"test": "Force [N]", "reading": both})
    tests = lb.import_campaign(path, layout=layout).campaign.tests
    largest = sorted(max(test.reading_um) - max(a % 50 for a in test.angle_deg) for test in tests)
    assert largest == pytest.approx(sorted([*FORCES_N, *(1.01 * force for force in FORCES_N)]))


def test_angles_headed_cw_that_rise_may_be_counted_clockwise(tmp_path: Path) -> None:
    rows = [f"{a};{reading_um(a, 0, '')};{a};{reading_um(a, 0, '')}" for a in ANGLES_DEG]
    header = "Angle CCW [deg];CCW [um];Angle CW [deg];CW [um]"
    path = long_table(tmp_path / "300N.csv", header, rows)
    with pytest.raises(lb.InputError, match="must run clockwise or counter-clockwise, got 'Angle"):
        lb.import_campaign(path)
    tests = lb.import_campaign(path, layout=Layout(angle_sense="CCW")).campaign.tests
    assert [test.direction for test in tests] == ["CCW", "CW"]
    for test in tests:
        expected = [reading_um(a, 0, "") for a in test.angle_deg]
        assert test.reading_um == pytest.approx(expected)


@pytest.mark.parametrize(
    ("header", "cell"),
    [("CW", "1"), ("CW", "0"), ("Clockwise", "yes"), ("CCW", "x"), ("Rechtslauf", "ja")],
)
def test_a_direction_that_is_answered_in_each_row_is_asked_for(
    header: str, cell: str, tmp_path: Path
) -> None:
    rows = [f"{a};{reading_um(a, 300, '')};{cell}" for a in ANGLES_DEG]
    path = long_table(tmp_path / "300N.csv", f"Angle [deg];Reading [um];{header}", rows)
    message = f"directions must be CW or CCW, got {cell} in column '{header}'"
    with pytest.raises(lb.InputError, match=message):
        lb.import_campaign(path)
    assert (
        lb.import_campaign(path, layout=Layout(direction="CW")).campaign.tests[0].direction == "CW"
    )


def test_no_column_of_tests_is_advised_for_a_direction_that_says_nothing(tmp_path: Path) -> None:
    rows = []
    for row in rows_of_circles():
        force, _, *others = row.split(",")
        rows.append(",".join([force, "±", *others]))
    with pytest.raises(lb.InputError, match=r"got '±'\. Write CW or CCW into the column"):
        lb.import_campaign(long_table(tmp_path / "all.csv", HEADER, rows))


@pytest.mark.parametrize("header", ["Reading [um];CW [um]", "CW [um];Reading [um]"])
def test_a_column_of_lengths_that_a_direction_heads_is_not_left_out(
    header: str, tmp_path: Path
) -> None:
    rows = [f"{a};{reading_um(a, 300, '')};{reading_um(a, 300, 'CW')}" for a in ANGLES_DEG]
    path = long_table(tmp_path / "300N.csv", f"Angle [deg];{header}", rows)
    with pytest.raises(lb.InputError, match="one column must hold the reading, got"):
        lb.import_campaign(path)
    stated = lb.import_campaign(path, layout=Layout(columns={"reading": "Reading [um]"}))
    assert len(stated.campaign.tests) == 1


def test_two_circles_of_the_same_conditions_below_each_other_are_not_joined(
    tmp_path: Path,
) -> None:
    rows = rows_of_circles()
    twice = [*rows[: len(ANGLES_DEG)], *rows]
    with pytest.raises(lb.InputError, match="Name the test of each row in a column of its own"):
        lb.import_campaign(long_table(tmp_path / "all.csv", HEADER, twice))


def test_laps_that_a_column_numbers_are_one_circle(tmp_path: Path) -> None:
    rows = []
    for row in rows_of_circles():
        rows.append(f"1,{row}")
    first = rows[: len(ANGLES_DEG)]
    again = [row.replace("1,", "2,", 1) for row in first]
    path = long_table(tmp_path / "all.csv", f"lap,{HEADER}", [*first, *again, *rows[len(first) :]])
    campaign = lb.import_campaign(path).campaign
    assert conditions(campaign) == [(100, "CCW"), (100, "CW"), (300, "CCW"), (300, "CW")]


def test_a_load_above_numbers_without_header_is_no_fault_of_the_program(tmp_path: Path) -> None:
    lines = []
    for force_N in FORCES_N:
        lines += [f"F={force_N:g}N CCW", *[f"{a} {a % 70}.5" for a in ANGLES_DEG], ""]
    path = tmp_path / "all.dat"
    path.write_text("\n".join(lines))
    with pytest.raises(lb.InputError, match="rows must hold readings"):
        lb.import_campaign(path)


@pytest.mark.parametrize("header", ["R", "Ø"])
def test_different_radii_without_a_unit_are_refused(header: str, tmp_path: Path) -> None:
    lines = [f"{header};force_N;angle_deg;reading_um"]
    for radius in (100, 150):
        for force_N in (100, 300):
            for angle_deg in range(0, 360, 10):
                lines.append(f"{radius};{force_N};{angle_deg};{force_N / 50 + angle_deg / 100}")
    path = tmp_path / "radii.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    message = rf"radii must have a unit, got none in column '{header}'\. Write it into the header"
    with pytest.raises(lb.InputError, match=message):
        lb.import_campaign(path)
    path.write_text("\n".join([*lines, ""]).replace(header, f"{header} [mm]"), encoding="utf-8")
    assert len(lb.import_campaign(path).campaign.tests) == 4
