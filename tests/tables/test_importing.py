"""Tables as they are found: what each step makes of them, checked by hand-worked examples; round trip through the layout."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from openpyxl import Workbook

import ldbb_bayes as lb
from ldbb_bayes.tables.cells import read_sheets
from ldbb_bayes.tables.columns import unit_of
from ldbb_bayes.tables.layout import layout_to_toml
from ldbb_bayes.tables.numerals import decimal_mark, numbers_of, seconds_of
from ldbb_bayes.tables.recording import angles_from_time, average_laps, on_the_circle


def table(path: Path, header: str, rows: list[str], above: str = "", encoding: str = "utf-8") -> Path:
    path.write_bytes("\n".join([*([above] if above else []), header, *rows, ""]).encode(encoding))
    return path


def circle() -> list[str]:
    return [f"{5 * k},{k % 7}.25" for k in range(72)]


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("Angle [°]", "Angle", "deg"),
        ("reading_um", "reading", "um"),
        ("Radial deviation (µm)", "Radial deviation", "um"),
        ("Radial deviation (μm)", "Radial deviation", "um"),
        ("P/bar", "P", "bar"),
        ("Kraft in kN", "Kraft", "kN"),
        ("rho, mm", "rho", "mm"),
        ("t (ms)", "t", "ms"),
        ("angle", "angle", ""),
        ("serial number", "serial number", ""),
        ("test", "test", ""),
        ("reading 2 µm", "reading", "um"),
        ("Reading, 0.1 µm", "Reading", "(0.1) um"),
        ("reading / 0.1 µm", "reading", "0.1 um"),
        ("Reading [10 um]", "Reading", "10 um"),
        ("Messwert 1/1000 mm", "Messwert", "1/1000 mm"),
        ("Pressure [MPa (gauge)]", "Pressure", "MPa"),
        ("Force (kN)*", "Force", "kN"),
        ("Reading [µm] (CW)", "Reading", "um"),
        ("Angle (0-360°)", "Angle", "deg"),
        ("Reading [mm] (inch)", "Reading", "mm and inch"),
        ("Pressure (barg)", "Pressure", "bar"),
    ],
)
def test_unit_of_a_header(header: str, name: str, unit: str) -> None:
    assert unit_of(header) == (name, unit)


@pytest.mark.parametrize(
    ("cells", "decimal", "values"),
    [
        (["1.5", "-2", "3e-1"], ".", [1.5, -2.0, 0.3]),
        (["1,5", "−2,25"], ",", [1.5, -2.25]),
        (["1,234.5", "12,345,678.9"], ".", [1234.5, 12345678.9]),
        (["1.234,5", "1 234,5", "1'234,5"], ",", [1234.5, 1234.5, 1234.5]),
        (["1.5D+02"], ".", [150.0]),
        (["7"], None, [7.0]),
    ],
)
def test_numbers(cells: list[str], decimal: str | None, values: list[float]) -> None:
    assert decimal_mark("here", enumerate(cells, start=1)) == decimal
    np.testing.assert_allclose(numbers_of("here", "x", range(1, 9), cells, decimal), values, rtol=1e-15)


@pytest.mark.parametrize(
    "cell", ["1,23,4.5", "12,34.5", "1_000", "0x10", "", "--1", "1e", "nan", "∞", "1.2.3", "12 30", "12'30", "0 36"]
)
def test_what_is_no_number(cell: str) -> None:
    with pytest.raises(lb.InputError, match="here, line 3: x must be a finite number"):
        numbers_of("here", "x", [3], [cell], ".")


@given(st.floats(-1e6, 1e6), st.sampled_from(".,"), st.integers(0, 6))
def test_a_number_written_any_way_comes_back(value: float, decimal: str, digits: int) -> None:
    other = {".": ",", ",": "."}[decimal]
    text = f"{value:,.{digits}f}"
    written = text.translate(str.maketrans({",": other, ".": decimal}))
    assert numbers_of("here", "x", [1], [written], decimal)[0] == pytest.approx(round(value, digits), rel=1e-12, abs=1e-12)


def test_mark_that_changes_is_refused_with_its_line() -> None:
    with pytest.raises(lb.InputError, match=r"here, line 3: the decimal mark must be the same"):
        decimal_mark("here", [(1, "1.5"), (2, "2.5"), (3, "3,5")])


def test_log_over_time() -> None:
    """At 2000 mm/min on 150 mm a turn takes 28.274 s; the run-in of 45° takes an eighth of that."""
    turn = 2.0 * np.pi * 150.0 / (2000.0 / 60.0)
    assert turn == pytest.approx(28.2743, abs=1e-4)
    time = np.arange(0.0, 1.25 * turn, 0.01)
    angle = angles_from_time(time, feed_mm_per_min=2000.0, radius_mm=150.0, start_deg=90.0, overshoot_deg=45.0, sense=-1)
    assert angle[0] == pytest.approx(135.0)
    k = int(np.searchsorted(time, turn / 8.0 + turn / 4.0))
    assert angle[k] == pytest.approx(0.0, abs=0.13)
    kept = on_the_circle(angle, start_deg=90.0, sense=-1)
    assert angle[kept].max() <= 90.0 + 0.07
    assert np.ptp(angle[kept]) == pytest.approx(360.0, abs=0.26)


def test_times_of_day_go_on_over_midnight() -> None:
    found = seconds_of("here", [1, 2, 3, 4], ["23:59:58,5", "2026-11-21T23:59:59.5", "0:00:00.25", "00:01:00"])
    np.testing.assert_allclose(found - found[0], [0.0, 1.0, 1.75, 61.5])
    np.testing.assert_allclose(seconds_of("here", [1, 2, 3], ["59:59.5", "00:00.5", "0:01.5"]), [3599.5, 3600.5, 3601.5])
    with pytest.raises(lb.InputError, match="here, line 2: time must be as in"):
        seconds_of("here", [1, 2], ["12:00:01", "12.5"])


@pytest.mark.parametrize(
    ("cells", "after_midnight"),
    [
        (["11:59:59.5 AM", "12:00:00 PM", "12:00:01.25 pm", "1:00:00 p.m."], [43_199.5, 43_200.0, 43_201.25, 46_800.0]),
        (["12:59:59 AM", "1:00:00 AM", "1:00:01AM"], [3599.0, 3600.0, 3601.0]),
        (["2026-03-04T12:00:00Z", "2026-03-04T12:00:01.5Z"], [43_200.0, 43_201.5]),
        (["2026-03-04 12:00:00+01:00", "2026-03-04 12:00:01+01:00"], [43_200.0, 43_201.0]),
        (["59:59.5Z", "00:00.5Z"], [3599.5, 3600.5]),
    ],
)
def test_clocks_of_twelve_hours_and_with_zones(cells: list[str], after_midnight: list[float]) -> None:
    np.testing.assert_allclose(seconds_of("here", range(len(cells)), cells), after_midnight)


def test_laps_are_averaged_at_the_same_angles() -> None:
    """The second lap lies between the angles of the first; a straight line is interpolated exactly."""
    first, second = np.arange(0.0, 360.0, 5.0), np.arange(362.0, 722.0, 5.0)
    angle = np.concatenate([first, second])
    reading = np.concatenate([np.full(72, 1.0), np.full(72, 2.0)])
    averaged, mean = average_laps(angle, reading)
    np.testing.assert_array_equal(averaged, first)
    np.testing.assert_allclose(mean[1:], 1.5)


def test_encodings_and_separators_are_found(tmp_path: Path) -> None:
    for encoding, mark in (
        ("utf-8", b""),
        ("utf-16-le", b""),
        ("utf-16-be", b"\xfe\xff"),
        ("cp1252", b""),
        ("utf-8", b"\xef\xbb\xbf"),
    ):
        for separator in ",;\t|":
            text = "\n".join(["Winkel °" + separator + "Messwert µm", *(line.replace(",", separator) for line in circle())])
            path = tmp_path / "own.csv"
            path.write_bytes(mark + text.encode(encoding))
            (sheet,) = read_sheets(path)
            assert (sheet.encoding, sheet.separator) == (encoding, separator)
            assert sheet.rows[0] == (1, ["Winkel °", "Messwert µm"])


def test_the_layout_that_was_found_out_leaves_nothing_to_guess(tmp_path: Path) -> None:
    """Read again with it: the same campaign, and no assumption about the file."""
    rows = [line.replace(",", ";").replace(".", ",") for line in circle()]
    path = table(tmp_path / "own 238N.csv", "Winkel;Messwert", rows, "Radius: 140 mm", "cp1252")
    first = lb.import_campaign(path)
    (tmp_path / "layout.toml").write_text(layout_to_toml(first.layout), encoding="utf-8")
    again = lb.import_campaign(path, layout=lb.read_layout(tmp_path / "layout.toml"))
    assert again.campaign.sha256 == first.campaign.sha256
    assert again.layout == first.layout
    assert {a.what for a in first.assumptions} >= {
        "separator",
        "decimal mark",
        "columns",
        "unit of the angle",
        "force_N",
        "radius_mm",
    }
    assert {a.what for a in again.assumptions if a.place} == {"force_N", "radius_mm"}, "what the file says of its test"
    assert first.campaign.tests[0].force_N == 238.0
    assert first.campaign.tests[0].radius_mm == 140.0


def test_what_is_given_is_not_assumed(tmp_path: Path) -> None:
    path = table(tmp_path / "own.csv", "a,b", circle())
    layout = lb.Layout.model_validate(
        {
            "columns": {"angle": "a", "reading": "b"},
            "reading_unit": "nm",
            "angle_unit": "deg",
            "zero": "deviation",
            "test": [{"file": "own.csv", "pressure_bar": 3.0, "direction": "CW", "work_ball_deg": 45.0}],
        }
    )
    found = lb.import_campaign([path], layout=layout, topology="wCAFYXZSt", plane="XY", radius_mm=150.0, resolution_um=0.1)
    (test,) = found.campaign.tests
    assert (test.pressure_bar, test.direction, test.work_ball_deg) == (3.0, "CW", 45.0)
    np.testing.assert_allclose(test.reading_um, [1e-3 * (k % 7 + 0.25) for k in range(72)])
    assert {a.what for a in found.assumptions} == {"mount", "force", "direction"}  # stated CW, the angles rise


def test_an_entry_for_no_file_is_told(tmp_path: Path) -> None:
    """An import.toml of other files serves for new ones."""
    path = table(tmp_path / "own 36N.csv", "angle_deg,reading_um", circle())
    layout = lb.Layout.model_validate({"test": [{"file": "other.csv", "force_N": 742.0}]})
    found = lb.import_campaign(path, layout=layout)
    assert found.campaign.tests[0].force_N == 36.0
    assert ("[[test]] not used", "other.csv") in {(a.what, a.value) for a in found.assumptions}


def test_labels_that_cannot_be_files_are_changed_and_told(tmp_path: Path) -> None:
    """A label in the table becomes a file's name."""
    path = table(tmp_path / "all.csv", "test,force_N,angle_deg,reading_um", [f"../evil,36,{line}" for line in circle()])
    assert told(path)["name of the test"] == "_._evil"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("schema = 2\n", "'schema' must be valid"),
        ("colums = {}\n", "'colums'"),
        ("[columns]\nangel = 'a'\n", "'angel'"),
        ("laps = 'mean'\n", "'laps'"),
        ("a = " + "[\n" * 5000, "valid TOML"),
        ("a." * 400 + "b = 1", "line 1"),
        ("x = 'é'\n", "UTF-8"),
    ],
)
def test_layouts_that_are_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "layout.toml"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(lb.InputError) as found:
        lb.read_layout(path)
    assert str(path) in str(found.value)
    assert said in str(found.value)


def test_our_own_tidy_table_imports_as_it_reads(tmp_path: Path) -> None:
    """Columns that hold one value a test among them; the readers share no code."""
    header = "test,force_N,angle_deg,reading_um,direction,work_ball_deg,radius_mm,setup,plane,temperature_C,time_s"
    rows = [f"a,36,{line},CW,45,120,2,XY,20.5,0" for line in circle()] + [
        f"b,742,{line},CCW,90,150,1,XY,21,600" for line in circle()
    ]
    path = table(tmp_path / "all.csv", header, rows)
    read, found = lb.read_campaign(path), lb.import_campaign(path, name="all")
    assert found.campaign.sha256 == read.sha256
    assert "columns not used" not in {a.what for a in found.assumptions}


def test_a_value_of_a_test_that_changes_is_refused_with_its_line(tmp_path: Path) -> None:
    rows = [f"a,36,{line},{45 if k < 30 else 50}" for k, line in enumerate(circle())]
    path = table(tmp_path / "all.csv", "test,force_N,angle_deg,reading_um,work_ball_deg", rows)
    with pytest.raises(
        lb.InputError, match="line 32: work_ball_deg must be the same in all rows of test 'a', got '50' after '45'"
    ):
        lb.import_campaign(path)


def test_columns_that_are_not_used_are_named(tmp_path: Path) -> None:
    path = table(tmp_path / "own 36N.csv", "angle_deg,reading_um,humidity", [f"{line},0.4" for line in circle()])
    told = {a.what: a.value for a in lb.import_campaign(path).assumptions}
    assert told["columns not used"] == "humidity"


def test_units_below_the_names_are_read_with_the_layout_too(tmp_path: Path) -> None:
    """A header line that was found out has its units below it still."""
    path = tmp_path / "own 36N.csv"
    path.write_text("\n".join(["angle,reading", "deg,mm", *(f"{5 * k},{k % 7}.25" for k in range(72))]), encoding="utf-8")
    first = lb.import_campaign(path)
    again = lb.import_campaign(path, layout=first.layout)
    assert first.campaign.tests[0].reading_um[1] == pytest.approx(1250.0)
    assert again.campaign.sha256 == first.campaign.sha256


def test_the_shipped_campaign_imports_from_its_own_tables(root: Path) -> None:
    """Names like f036 say the force."""
    files = sorted((root / "data" / "recovered_experiment").glob("f*.csv"))
    found, shipped = lb.import_campaign(files).campaign, lb.read_campaign(root / "data" / "recovered_experiment")
    assert found.forces_N.tolist() == shipped.forces_N.tolist()
    for own, test in zip(found.tests, shipped.tests, strict=True):
        np.testing.assert_array_equal(own.reading_um, test.reading_um)
        np.testing.assert_array_equal(own.angle_deg, test.angle_deg)


@pytest.mark.parametrize("bad", ["---", "NaN", ""])
def test_a_bad_cell_near_the_top_is_refused_too(bad: str, tmp_path: Path) -> None:
    """The table begins below its header, not at the first good row."""
    rows = circle()
    rows[5] = f"25,{bad}"
    path = table(tmp_path / "own 36N.csv", "angle_deg,reading_um", rows)
    with pytest.raises(lb.InputError, match="line 7: reading must be a finite number"):
        lb.import_campaign(path)


@pytest.mark.parametrize(
    ("header", "factor"),
    [
        ("Abweichung in 1/1000 mm", 1.0),
        ("reading / 0.1 um", 0.1),
        ("reading [mil]", 25.4),
        ("reading [thou]", 25.4),
        ("reading (millimeters)", 1000.0),
        ("reading [uinch]", 0.0254),
    ],
)
def test_units_with_factors_and_other_names(header: str, factor: float, tmp_path: Path) -> None:
    path = table(tmp_path / "own 36N.csv", f"angle_deg,{header}", circle())
    assert lb.import_campaign(path).campaign.tests[0].reading_um[1] == pytest.approx(1.25 * factor)


@pytest.mark.parametrize(
    "header",
    [
        "reading [counts]",
        "reading [V]",
        "reading [\u00c2\u00b5m]",
        "reading in steps",
        "reading in sswert in mm",
        "reading in 1/0 mm",
    ],
)
def test_units_that_are_none_are_refused(header: str, tmp_path: Path) -> None:
    path = table(tmp_path / "own 36N.csv", f"angle_deg,{header}", circle())
    with pytest.raises(lb.InputError, match=r"line 1\. Correct the header, or give --unit"):
        lb.import_campaign(path)


@pytest.mark.parametrize("laps", [2, 3])
def test_laps_without_their_closing_reading_are_all_kept(laps: int, tmp_path: Path) -> None:
    """With and without run-in; times rounded to 0.01 s."""
    step = np.deg2rad(5.0) * 150.0 / (2000.0 / 60.0)
    for lead in (0, 9):
        rows = [f"{k * step:.2f},{(k - lead) % 7}.25" for k in range(72 * laps + lead)]
        path = table(tmp_path / "own 36N.csv", "t (s),reading_um", rows, f"Overshoot {5 * lead} deg")
        found = lb.import_campaign(path, layout=lb.Layout(feed_mm_per_min=2000.0, laps="keep"))
        assert len(found.campaign.tests[0].angle_deg) == 72 * laps


def test_columns_of_one_value_are_no_reading(tmp_path: Path) -> None:
    path = table(tmp_path / "own 36N.csv", "angle_deg,error,status", [f"{5 * k},0,{k}" for k in range(72)])
    with pytest.raises(lb.InputError, match="the reading must change from row to row, got 0 in all"):
        lb.import_campaign(path)


def test_bare_columns_must_be_two_or_named(tmp_path: Path) -> None:
    path = table(tmp_path / "own 36N.csv", "0,0,1.5", [f"{k},{5 * k},{k % 7}.25" for k in range(1, 72)])
    with pytest.raises(lb.InputError, match="must be named by number, got 3"):
        lb.import_campaign(path)
    found = lb.import_campaign(path, layout=lb.Layout(columns={"angle": 2, "reading": 3}))
    assert found.campaign.tests[0].reading_um[1] == 1.25


def test_options_win_over_tests_of_a_layout() -> None:
    layout = lb.Layout.model_validate({"test": [{"file": "a.csv", "force_N": 36.0, "direction": "CCW"}]})
    assert layout.with_given({"direction": "CW"}).test[0].direction is None
    assert layout.with_given({"direction": "CW"}).test[0].force_N == 36.0


def test_units_found_in_one_file_do_not_beat_the_header_of_another(tmp_path: Path) -> None:
    """import.toml of files that differ."""
    paths = [
        table(tmp_path / "own 36N.csv", "angle_deg,reading", circle()),
        table(tmp_path / "own 742N.csv", "angle_deg,reading [mm]", [f"{5 * k},0.00{k % 7}" for k in range(72)]),
    ]
    first = lb.import_campaign(paths)
    again = lb.import_campaign(paths, layout=first.layout)
    assert again.campaign.sha256 == first.campaign.sha256


def test_rows_of_missing_readings_at_the_end_are_not_dropped(tmp_path: Path) -> None:
    path = table(tmp_path / "own 36N.csv", "angle_deg,reading_um", [*circle(), "---,---"])
    with pytest.raises(lb.InputError, match="line 74: angle must be a finite number, got '---'"):
        lb.import_campaign(path)


def test_there_and_back_is_not_one_test(tmp_path: Path) -> None:
    rows = [f"{a},{k % 7}.25" for k, a in enumerate([*range(0, 360, 5), *range(360, 0, -5)])]
    path = table(tmp_path / "own 36N.csv", "angle_deg,reading_um", rows)
    with pytest.raises(lb.InputError, match=r"angles must run one way in a test, got -355° after \+360°"):
        lb.import_campaign(path)


def told(path: Path, **layout: object) -> dict[str, str]:
    return {a.what: a.value for a in lb.import_campaign(path, layout=lb.Layout.model_validate(layout)).assumptions}


def test_run_in_beside_an_angle_column_is_told(tmp_path: Path) -> None:
    rows = [f"{a},{k % 7}.25" for k, a in enumerate(range(-45, 405, 5))]
    path = table(tmp_path / "own 36N.csv", "angle_deg,reading_um", rows)
    assert told(path)["laps"] == "all 1.25 kept in one test"
    assert told(path, overshoot_deg=45.0, laps="keep")["not used"] == "--overshoot-deg"


def test_a_direction_that_the_angles_contradict_is_told(tmp_path: Path) -> None:
    path = table(tmp_path / "own 36N.csv", "angle_deg,reading_um", circle())
    assert told(path, direction="CW")["direction"] == "CW, as stated"
    assert "direction" not in told(path, direction="CCW")


def test_marks_that_may_be_of_thousands_are_told(tmp_path: Path) -> None:
    path = table(tmp_path / "own 36N.csv", "angle_deg;reading_nm", [f"{5 * k};12,{310 + k}" for k in range(72)])
    assert told(path)["decimal mark"] == ","
    (own,) = [a for a in lb.import_campaign(path).assumptions if a.what == "decimal mark"]
    assert "thousands" in own.because
    assert lb.import_campaign(path, layout=lb.Layout(decimal=".")).campaign.tests[0].reading_um[0] == pytest.approx(12.310)


def test_a_log_named_as_our_own_columns(tmp_path: Path) -> None:
    rows = [f"{0.4 * k:.1f},{k % 7}.25" for k in range(72)]
    path = table(tmp_path / "own 36N.csv", "time_s,reading_um", rows)
    assert len(lb.import_campaign(path, layout=lb.Layout(feed_mm_per_min=2000.0)).campaign.tests[0].angle_deg) >= 70


@pytest.mark.parametrize("other", ["T [°C]", "time stamp", "Test temperature"])
def test_columns_beside_angle_and_reading_do_no_harm(other: str, tmp_path: Path) -> None:
    path = table(tmp_path / "own 36N.csv", f"angle_deg,reading_um,{other}", [f"{line},04.03.2026" for line in circle()])
    assert told(path)["columns not used"] == other


def test_workbooks_with_titles_dates_and_notes(tmp_path: Path) -> None:
    """A date and a formula outside the table, a sheet of words, two books with the usual name of a sheet."""
    for force in (36, 742):
        book = Workbook()
        sheet = book.active
        sheet.append(["measured", datetime(2026, 3, 4, 10, 15)])
        sheet.append(["angle_deg", "reading_um", "check"])
        for k in range(72):
            sheet.append([5 * k, k % 7 + 0.25, f"=B{k + 3}*2"])
        book.create_sheet("Info").append(["operator", "J. D."])
        book.save(tmp_path / f"own {force}N.xlsx")
    found = lb.import_campaign(sorted(tmp_path.glob("*.xlsx")))
    assert [test.name for test in found.campaign.tests] == ["own 36N", "own 742N"]
    assert found.campaign.forces_N.tolist() == [36.0, 742.0]
    assert "left out" in {a.what for a in found.assumptions}


def test_decimal_commas_between_blanks_or_commas(tmp_path: Path) -> None:
    """Blanks separate; between commas the columns cannot be told."""
    rows = [f"{5 * k},0 {k % 7},25" for k in range(72)]
    path = tmp_path / "own 36N.txt"
    path.write_text("\n".join(rows), encoding="utf-8")
    assert lb.import_campaign(path).campaign.tests[0].reading_um[1] == 1.25
    path.write_text("\n".join(row.replace(" ", ",") for row in rows), encoding="utf-8")
    with pytest.raises(lb.InputError, match="must be named by number, got 4"):
        lb.import_campaign(path)


def test_distances_on_another_radius_ask_for_it(tmp_path: Path) -> None:
    path = table(tmp_path / "own 36N.csv", "angle_deg,radius (mm)", [f"{5 * k},100.00{k % 7}" for k in range(72)])
    with pytest.raises(lb.InputError, match=r"or distances near it, got 100 mm\. Give --radius-mm"):
        lb.import_campaign(path)
    assert lb.import_campaign(path, radius_mm=100.0).campaign.tests[0].reading_um[1] == pytest.approx(1.0, abs=1e-6)


def test_rows_without_a_label_are_refused(tmp_path: Path) -> None:
    rows = [f"{'' if k == 30 else 'a'},36,{line}" for k, line in enumerate(circle())]
    path = table(tmp_path / "all.csv", "test,force_N,angle_deg,reading_um", rows)
    with pytest.raises(lb.InputError, match="line 32: rows must name their test"):
        lb.import_campaign(path)


def test_file_names_that_tests_cannot_have(tmp_path: Path) -> None:
    path = table(tmp_path / "36,5 N (1).csv", "angle_deg,reading_um", circle())
    found = lb.import_campaign(path)
    assert found.campaign.tests[0].name == "36_5 N _1_"
    assert found.campaign.forces_N.tolist() == [36.5]


def test_a_label_before_its_file(tmp_path: Path) -> None:
    """Both entries speak; the label's word counts."""
    rows = [f"{label},{line}" for label in "ab" for line in circle()]
    path = table(tmp_path / "all.csv", "test,angle_deg,reading_um", rows)
    entries = [
        {"file": "all.csv", "direction": "CCW"},
        {"file": "a", "force_N": 36.0},
        {"file": "b", "force_N": 742.0, "direction": "CW"},
    ]
    found = lb.import_campaign(path, layout=lb.Layout.model_validate({"test": entries}))
    assert [(test.force_N, test.direction) for test in found.campaign.tests] == [(36.0, "CCW"), (742.0, "CW")]
    assert "[[test]] not used" not in {a.what for a in found.assumptions}
    with pytest.raises(lb.InputError, match="must be of one test, got several in it"):
        lb.import_campaign(path, layout=lb.Layout.model_validate({"test": [{"file": "all.csv", "force_N": 36.0}]}))


def test_repeated_angles_and_end_marks(tmp_path: Path) -> None:
    """0 to 360° twice over, the closing angle read twice, and the end mark of old systems."""
    rows = [f"{a},{k % 7}.25" for k, a in enumerate([*range(0, 365, 5)] * 2)]
    path = table(tmp_path / "own 36N.csv", "angle_deg,reading_um", rows)
    path.write_bytes(path.read_bytes() + b"\x1a")
    assert len(lb.import_campaign(path, layout=lb.Layout(laps="average")).campaign.tests[0].angle_deg) == 72


def test_no_table_shows_what_is_there(tmp_path: Path) -> None:
    path = table(tmp_path / "own 36N.csv", "angle_deg,reading_um", [f"{5 * k} deg,{k} um" for k in range(72)])
    with pytest.raises(lb.InputError, match=r"Line 37 reads '175', 'deg,35', 'um'\."):
        lb.import_campaign(path)


def test_what_a_spreadsheet_hides_is_told(tmp_path: Path) -> None:
    book = Workbook()
    for force in (36, 742):
        sheet = book.create_sheet(f"{force} N")
        for row in [["angle", "reading um"], *([5 * k, k % 7] for k in range(72))]:
            sheet.append(row)
    del book["Sheet"]
    book["742 N"].sheet_state = "hidden"
    for row in (5, 6, 40):
        book["36 N"].row_dimensions[row].hidden = True
    book.save(tmp_path / "two.xlsx")
    told = [(own.place, own.value) for own in lb.import_campaign(tmp_path / "two.xlsx").assumptions if own.what == "hidden"]
    rows = "3 rows of the workbook"
    assert told == [
        (f"{tmp_path / 'two.xlsx'}, sheet '36 N'", f"{rows}, read like the others"),
        (f"{tmp_path / 'two.xlsx'}, sheet '742 N'", f"the sheet and {rows}, read like the others"),
    ]


def test_rows_of_one_label_apart_are_told(tmp_path: Path) -> None:
    rows = [f"{test},{force},{row}" for test, force in (("A", 36), ("B", 742), ("A", 36)) for row in circle()]
    assert told(table(tmp_path / "x.csv", "test,force_N,angle_deg,reading_um", rows))["rows"] == "2 blocks joined"


def test_a_radius_of_a_test_against_the_option_is_told(tmp_path: Path) -> None:
    rows = [f"{test},{force},{radius},{row}" for test, force, radius in (("A", 36, 100), ("B", 742, 150)) for row in circle()]
    path = table(tmp_path / "x.csv", "test,force_N,radius_mm,angle_deg,reading_um", rows)
    found = lb.import_campaign(path, radius_mm=150.0)
    assert [test.radius_mm for test in found.campaign.tests] == [100.0, 150.0]
    assert [own.place for own in found.assumptions if own.what == "radius_mm"] == [f"{path}, test 'A'"]


def loads_of(path: Path | list[Path], **layout: object) -> list[tuple[str, float | None, str | None]]:
    found = lb.import_campaign(path, layout=lb.Layout.model_validate(layout))
    return [(test.name, test.force_N, test.direction) for test in found.campaign.tests]


def test_a_layout_of_last_week_does_not_speak_over_this_weeks_files_unheard(tmp_path: Path) -> None:
    """The same names, other headers: what the files say counts; what was stated counts, and is told."""
    old, new = tmp_path / "wk1", tmp_path / "wk2"
    for folder, force, sense in ((old, 36, "CCW"), (new, 86, "CW")):
        folder.mkdir()
        table(folder / "Test1.csv", "angle_deg,reading_um", circle(), f"Force: {force} N\nDirection: {sense}\nRadius: 100 mm")
    first = lb.import_campaign(old / "Test1.csv")
    assert loads_of(new / "Test1.csv", **first.layout.model_dump(by_alias=True, exclude_none=True)) == [("Test1", 86.0, "CW")]
    given = lb.Layout.model_validate({"test": [{"file": "Test1.csv", "force_N": 36.0, "direction": "CCW"}]})
    found = lb.import_campaign(new / "Test1.csv", layout=given, radius_mm=150.0)
    said = {(own.what, own.value, own.because) for own in found.assumptions}
    assert said >= {
        ("force_N", "36 N, as given", "line 1 says 86 N"),
        ("direction", "CCW, as given", "the file says the other"),
        ("radius_mm", "150 mm, as given", "line 3 says 100 mm"),
    }
    assert (found.campaign.tests[0].force_N, found.campaign.tests[0].direction) == (36.0, "CCW")


def test_what_is_given_against_a_column_is_told(tmp_path: Path) -> None:
    rows = [f"36,CCW,{row}" for row in circle()]
    path = table(tmp_path / "a.csv", "force_N,direction,angle [deg],reading [um]", rows)
    layout = lb.Layout.model_validate({"forces_N": [400.0], "direction": "CW", "reading_unit": "nm"})
    said = {(own.what, own.value) for own in lb.import_campaign(path, layout=layout).assumptions}
    assert said >= {("force_N", "400 N, as given"), ("direction", "CW, as given"), ("unit of the reading", "nm, as given")}


def test_one_force_for_each_sheet(tmp_path: Path) -> None:
    book = Workbook()
    for name in ("Versuch 1", "Versuch 2"):
        sheet = book.create_sheet(name)
        for row in [["Winkel", "Abweichung [mm]"], *([5 * k, 0.001 * (k % 7)] for k in range(72))]:
            sheet.append(row)
    book.save(tmp_path / "two.xlsx")
    assert loads_of(tmp_path / "two.xlsx", forces_N=[36.0, 742.0]) == [("Versuch 1", 36.0, None), ("Versuch 2", 742.0, None)]
    for_all = {"test": [{"file": "two.xlsx", "force_N": 36.0}]}
    with pytest.raises(lb.InputError, match="must be of one test, got several in it"):
        loads_of(tmp_path / "two.xlsx", **for_all)
    each = {"test": [{"file": f"Versuch {k}", "force_N": force} for k, force in ((1, 36.0), (2, 742.0))]}
    assert [own[1] for own in loads_of(tmp_path / "two.xlsx", **each)] == [36.0, 742.0]
    with pytest.raises(lb.InputError, match=r"'Versuch 2': --forces-N must hold one number for each test, got 1"):
        loads_of(tmp_path / "two.xlsx", forces_N=[36.0])


@pytest.mark.parametrize(
    ("header", "names"),
    [
        ("Winkel [°];36 N [mm];742 N CW [mm]", ["36 N", "742 N CW"]),
        ("angle;reading 36 N, mm;reading 742 N CW, mm", ["reading 36 N_ mm", "reading 742 N CW_ mm"]),
        ("angle;F=36N (mm);F=742N CW (mm)", ["F_36N", "F_742N CW"]),
    ],
)
def test_a_column_for_each_force(header: str, names: list[str], tmp_path: Path) -> None:
    rows = [f"{5 * k};{0.001 * (k % 7):.3f};{0.002 * (k % 5):.3f}" for k in range(72)]
    found = lb.import_campaign(table(tmp_path / "wide.csv", header, rows))
    first, second = found.campaign.tests
    assert [(test.name, test.force_N, test.direction) for test in (first, second)] == [
        (names[0], 36.0, None),
        (names[1], 742.0, "CW"),
    ]
    np.testing.assert_allclose(first.reading_um, [k % 7 for k in range(72)], atol=1e-12)
    np.testing.assert_allclose(second.reading_um, [2 * (k % 5) for k in range(72)], atol=1e-12)
    again = lb.import_campaign(tmp_path / "wide.csv", layout=found.layout)
    assert again.campaign.sha256 == found.campaign.sha256


def test_columns_of_readings_that_are_named(tmp_path: Path) -> None:
    rows = [f"{5 * k},{k % 7},{k % 5}" for k in range(72)]
    path = table(tmp_path / "wide.csv", "angle_deg,A [um],B [nm]", rows)
    found = lb.import_campaign(
        path, layout=lb.Layout.model_validate({"columns": {"reading": ["A", "B"]}, "forces_N": [36.0, 742.0]})
    )
    np.testing.assert_allclose(found.campaign.tests[1].reading_um, [0.001 * (k % 5) for k in range(72)], atol=1e-12)
    assert [test.force_N for test in found.campaign.tests] == [36.0, 742.0]
    bare = table(tmp_path / "bare.csv", "0,0,0", rows[1:])
    assert len(loads_of(bare, columns={"angle": 1, "reading": [2, 3]}, header_line=0, forces_N=[36.0, 742.0])) == 2
    with pytest.raises(lb.InputError, match="the angle must be one column"):
        lb.Layout().with_given({"columns": {"angle": ["A", "B"]}})


@pytest.mark.parametrize(
    ("zero", "values"), [("distance", [k % 7 for k in range(72)]), ("deviation", [150.0 + 0.001 * (k % 7) for k in range(72)])]
)
def test_a_zero_that_the_readings_contradict_is_refused(zero: str, values: list[float], tmp_path: Path) -> None:
    path = table(tmp_path / "a 36N.csv", "angle_deg,reading [mm]", [f"{5 * k},{v:.3f}" for k, v in enumerate(values)])
    with pytest.raises(lb.InputError, match=rf"as {zero} \(--zero\)"):
        told(path, zero=zero)


def test_angles_that_may_be_gon_are_told(tmp_path: Path) -> None:
    rows = [f"{k * 400 / 72:.4f},{k % 7}" for k in range(72)]
    found = lb.import_campaign(table(tmp_path / "a 36N.csv", "angle,reading_um", rows))
    assert [own.because for own in found.assumptions if own.what == "unit of the angle"] == ["it spans 394.4: gon are as likely"]


def test_a_decimal_mark_that_the_cells_contradict_is_told(tmp_path: Path) -> None:
    path = table(tmp_path / "a 36N.csv", "angle_deg;reading_um", [f"{5 * k};{k % 7 + 1}.250" for k in range(72)])
    assert told(path, decimal=",")["decimal mark"] == ",, as given"


def test_a_formula_for_a_label_is_refused(tmp_path: Path) -> None:
    book = Workbook()
    sheet = book.active
    assert sheet is not None
    for row in [["test", "force_N", "angle", "reading um"], *(['="T"&"0"', 238, 5 * k, k % 7] for k in range(72))]:
        sheet.append(row)
    book.save(tmp_path / "f.xlsx")
    with pytest.raises(lb.InputError, match="cell A2: cells must hold values, got the formula"):
        lb.import_campaign(tmp_path / "f.xlsx")


@pytest.mark.parametrize("above", [1, 5, 8, 12])
def test_a_header_amid_the_numbers_is_refused(above: int, tmp_path: Path) -> None:
    rows = [*circle()[:above], "angle_deg,reading_um", *circle()[above:]]
    with pytest.raises(lb.InputError, match=f"line {above + 2}"):
        told(table(tmp_path / "a 36N.csv", "angle_deg,reading_um", rows))


@pytest.mark.parametrize("bad", ["NaN,NaN", "n/a,n/a", "#DIV/0!,#DIV/0!", "paused,paused"])
def test_rows_without_numbers_near_the_top_are_named(bad: str, tmp_path: Path) -> None:
    rows = [*circle()[:3], bad, *circle()[3:]]
    with pytest.raises(lb.InputError, match="line 5"):
        told(table(tmp_path / "a 36N.csv", "angle_deg,reading_um", rows))


@pytest.mark.parametrize("units", ["°;µm;-", "°;µm;°C", "Grad;µm;"])
def test_units_of_which_one_is_none(units: str, tmp_path: Path) -> None:
    rows = [units, *(f"{5 * k};{k % 7};21" for k in range(72))]
    found = lb.import_campaign(table(tmp_path / "a 36N.csv", "Winkel;Messwert;T", rows))
    np.testing.assert_allclose(found.campaign.tests[0].reading_um, [k % 7 for k in range(72)])
    assert found.campaign.tests[0].arc_deg > 350.0


def test_the_angle_of_the_first_axis_is_as_the_file_counts(tmp_path: Path) -> None:
    """Clockwise with X at 30: the file's 30 is 0, its 120 is -90."""
    rows = [f"{(30 - 5 * k) % 360},{k % 7}" for k in range(72)]
    path = table(tmp_path / "a 36N.csv", "angle_deg,reading_um", rows)
    layout = lb.Layout.model_validate({"angle_sign": -1, "angle_offset_deg": 30.0})
    (test,) = lb.import_campaign(path, layout=layout).campaign.tests
    np.testing.assert_allclose(np.mod(test.angle_deg, 360.0), [5 * k for k in range(72)], atol=1e-9)


def test_times_and_temperatures_of_every_reading_are_left_out(tmp_path: Path) -> None:
    rows = [f"{0.1 * k:.1f},{row},{20 + 0.01 * k:.2f}" for k, row in enumerate(circle())]
    found = lb.import_campaign(table(tmp_path / "a 36N.csv", "time_s,angle_deg,reading_um,temperature_C", rows))
    assert {own.value for own in found.assumptions if own.what == "columns not used"} == {"time_s", "temperature_C"}


def test_distances_far_from_the_radius_are_refused(tmp_path: Path) -> None:
    path = table(tmp_path / "a 36N.csv", "angle_deg,reading [mm]", [f"{5 * k},{155 + 0.001 * (k % 7):.3f}" for k in range(72)])
    with pytest.raises(lb.InputError, match="got 155 mm"):
        told(path)
    assert lb.import_campaign(path, radius_mm=155.0).campaign.tests[0].radius_mm == 155.0


def test_a_column_of_steps_of_load_is_no_load(tmp_path: Path) -> None:
    rows = [f"3,{row}" for row in circle()]
    path = table(tmp_path / "a 36N.csv", "Load step,angle_deg,reading_um", rows)
    assert lb.import_campaign(path).campaign.tests[0].force_N == 36.0


def write(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


def test_loads_of_an_option_are_not_joined_to_those_of_a_layout(tmp_path: Path) -> None:
    paths = [table(tmp_path / f"{name}.csv", "angle_deg,reading_um", circle()) for name in "ab"]
    entry = {"file": "a.csv", "force_N": 5.0}
    layout = lb.Layout.model_validate({"forces_N": [36.0, 742.0], "test": [entry]}).with_given({"pressures_bar": [2.0, 3.0]})
    found = lb.import_campaign(paths, layout=layout)
    assert [round(float(test.force_N or 0.0), 2) for test in found.campaign.tests] == [237.88, 363.92]


def test_a_force_off_the_law_of_its_pressure_is_told(tmp_path: Path) -> None:
    path = table(tmp_path / "a 36N.csv", "pressure_bar,angle_deg,reading_um", [f"6,{row}" for row in circle()])
    assert told(path)["force and pressure"] == "36 N and 6 bar"
    right = table(tmp_path / "a 742N.csv", "pressure_bar,angle_deg,reading_um", [f"6,{row}" for row in circle()])
    assert "force and pressure" not in told(right)


@pytest.mark.parametrize("bad", ["-,-", ",", "pause", "15.0", "15,-3,1"])
def test_rows_above_a_bad_one_are_not_dropped_without_a_header(bad: str, tmp_path: Path) -> None:
    rows = [*circle()[:3], bad, *circle()[4:]]
    with pytest.raises(lb.InputError, match=r"line [34]"):
        told(write(tmp_path / "36N.csv", rows))


@pytest.mark.parametrize(
    "header",
    [
        *("reading [10-3 mm]", "reading [10–3 mm]", "reading 10-3 mm", "reading 10^-3 mm", "reading x 10 µm", "reading x10 µm"),
        *(
            "reading [µm] x 10",
            "reading [µm] / 10",
            "reading (mm) x1000",
            "reading 100 nm",
            "reading [1,000 nm]",
            "reading 0.1 µm",
        ),
    ],
)
def test_factors_that_are_not_understood_are_refused(header: str, tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match=r"must be in um|name every column"):
        told(table(tmp_path / "a 36N.csv", f"angle_deg;{header}", [row.replace(",", ";") for row in circle()]))


def test_a_header_that_is_not_looked_at_is_told(tmp_path: Path) -> None:
    path = table(tmp_path / "a 36N.csv", "angle_deg,reading_mm", circle())
    layout = {"header_line": 0, "columns": {"angle": 1, "reading": 2}}
    assert told(path, **layout)["header"] == "none, as given"
    with pytest.raises(lb.InputError, match="line 3: the header must hold names, got numbers"):
        told(path, **(layout | {"header_line": 3}))


def test_directions_and_loads_in_headers_and_sheets(tmp_path: Path) -> None:
    rows = [f"{5 * k};{k % 7};{k % 5}" for k in range(72)]
    path = table(tmp_path / "wide.csv", "angle;36 N (CW) [um];238 N (CCW) [um]", rows)
    assert loads_of(path) == [("36 N", 36.0, "CW"), ("238 N", 238.0, "CCW")]
    assert loads_of(path, columns={"reading": "238 N (CCW) [um]"}) == [("wide", 238.0, "CCW")]
    path = table(tmp_path / "more.csv", "angle;A (36 N);reading [um] 238 N", rows)
    assert [own[1] for own in loads_of(path)] == [36.0, 238.0]
    book = Workbook()
    for name in ("36 N CW", "36 N CCW"):
        sheet = book.create_sheet(name)
        for row in [["angle", "reading um"], *([5 * k, k % 7] for k in range(72))]:
            sheet.append(row)
    book.save(tmp_path / "cw and ccw.xlsx")
    assert loads_of(tmp_path / "cw and ccw.xlsx") == [("36 N CW", 36.0, "CW"), ("36 N CCW", 36.0, "CCW")]


def test_labels_that_two_files_share(tmp_path: Path) -> None:
    rows = [f"{5 * k};{k % 7};{k % 5}" for k in range(72)]
    paths = [table(tmp_path / f"{name}.csv", "angle;36 N;238 N", rows) for name in ("CW", "CCW")]
    assert [own[0] for own in loads_of(paths)] == ["36 N", "238 N", "CCW 36 N", "CCW 238 N"]


def test_what_cannot_apply_is_told(tmp_path: Path) -> None:
    log = [f"{0.4 * k:.1f},{k % 7}" for k in range(90)]
    layout = lb.Layout.model_validate({"angle_sign": -1, "feed_mm_per_min": 2000.0, "forces_N": [36.0]})
    found = lb.import_campaign(table(tmp_path / "log.csv", "time_s,reading_um", log), layout=layout)
    assert "--angle-sign, --angle-offset-deg" in {own.value for own in found.assumptions}
    rows = [f"CW,5 V,{row}" for row in circle()]
    path = table(tmp_path / "a 36N CCW.csv", "direction,Force [V],angle_deg,reading_um", [row.replace(" V", "") for row in rows])
    layout = lb.Layout.model_validate({"forces_N": [36.0]})
    said = {(own.what, own.value) for own in lb.import_campaign(path, layout=layout).assumptions}
    assert said >= {("direction", "CW, its column"), ("column of the force", "not used")}


def test_a_radius_and_a_plane_against_the_file_are_told(tmp_path: Path) -> None:
    rows = [f"100,YZ,{row}" for row in circle()]
    path = table(tmp_path / "a 36N.csv", "radius_mm,plane,angle_deg,reading_um", rows, "Radius: 150 mm")
    said = [(own.what, own.value) for own in lb.import_campaign(path, plane="XY").assumptions]
    assert ("radius_mm", "100.0, as given") in said
    assert ("plane", "YZ") in said
