"""Tables as they are found: what each step makes of them, checked by hand-worked examples; round
trip through the layout."""

from __future__ import annotations

import re
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns import cases, refuses
from openpyxl import Workbook

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import layout_to_toml
from ldbb_bayes.reading.spreadsheet import read_sheets
from ldbb_bayes.reading.workbook import _names_matching

CASES = cases(__file__, "importing.toml")

HEADER = "angle_deg,reading_um"
NAME = "a 36N.csv"


def lines(form: str = "{a},{r}.25", count: int = 72) -> list[str]:
    """Rows of a circle in steps of 5°: k, angle a, reading r."""
    return [form.format(k=k, a=5 * k, r=k % 7, q=k % 5, t=0.4 * k) for k in range(count)]


CIRCLE = lines()


def table(
    path: Path,
    header: str = HEADER,
    rows: list[str] = CIRCLE,
    above: str = "",
    encoding: str = "utf-8",
) -> Path:
    content = [line for line in (above, header) if line]
    content += [*rows, ""]
    path.write_bytes("\n".join(content).encode(encoding))
    return path


def book(path: Path, sheets: dict[str, list[list[Any]]]) -> Path:
    workbook = Workbook()
    del workbook["Sheet"]
    for name, rows in sheets.items():
        sheet = workbook.create_sheet(name)
        for row in rows:
            sheet.append(row)
    workbook.save(path)
    return path


SHEET = [
    ["measured", datetime(2026, 3, 4), ""],
    ["angle", "reading um", "check"],
    *([5 * k, k % 7, "=B2*2"] for k in range(72)),
]


def imported(
    path: Path | list[Path], layout: dict[str, Any] | None = None, **campaign: Any
) -> lb.reading.Imported:
    return lb.import_campaign(
        path, layout=lb.reading.Layout.model_validate(layout or {}), **campaign
    )


def told(result: lb.reading.Imported) -> set[tuple[str, str]]:
    return {(assumption.what, assumption.value) for assumption in result.assumptions}


def loads_of(path: Path | list[Path], **layout: Any) -> list[tuple[str, float | None, str | None]]:
    return [
        (test.name, test.force_N, test.direction) for test in imported(path, layout).campaign.tests
    ]


# ---- numbers, times, encodings


@pytest.mark.parametrize(
    ("form", "reason"),
    [
        ("{a};{r},25", "no cell has a point"),
        ("{a};1.23{r},5", "points stand between thousands"),
    ],
)
def test_why_a_comma_is_the_decimal_mark(form: str, reason: str, tmp_path: Path) -> None:
    path = table(tmp_path / NAME, "angle_deg;reading_um", lines(form))
    reasons = {
        assumption.because
        for assumption in imported(path).assumptions
        if assumption.what == "decimal mark"
    }
    assert reasons == {reason}


def test_a_short_table_is_refused_with_its_readings_and_not_left_out(tmp_path: Path) -> None:
    paths = [table(tmp_path / "a 36N.csv", rows=lines(count=5)), table(tmp_path / "b 742N.csv")]
    refuses("a 36N.csv: test 'a 36N' must have at least 9 readings, got 5", imported, paths)


@pytest.mark.parametrize("separator", list(",;\t|"))
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf", b"\xfe\xff"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16-le", "utf-16-be", "cp1252"])
def test_encodings_and_separators_are_found(
    encoding: str, mark: bytes, separator: str, tmp_path: Path
) -> None:
    encoding = {b"\xef\xbb\xbf": "utf-8", b"\xfe\xff": "utf-16-be"}.get(mark, encoding)
    rows = [row.replace(",", separator) for row in CIRCLE]
    path = table(tmp_path / "own.csv", f"Winkel °{separator}Messwert µm", rows, "", encoding)
    path.write_bytes(mark + path.read_bytes())
    (sheet,) = read_sheets(path)
    assert (sheet.encoding, sheet.separator, sheet.rows[0]) == (
        encoding,
        separator,
        (1, ["Winkel °", "Messwert µm"]),
    )


# ---- angles from time, laps


def test_laps_of_the_same_angles_are_averaged(tmp_path: Path) -> None:
    """Twice the same angles, with a closing angle and an end mark."""
    path = table(tmp_path / NAME, rows=lines(count=73) * 2)
    path.write_bytes(path.read_bytes() + b"\x1a")
    assert len(imported(path, {"laps": "average"}).campaign.tests[0].angle_deg) == 72


@pytest.mark.parametrize(("laps", "lead"), [(2, 0), (3, 9)])
def test_laps_without_their_closing_reading_are_all_kept(
    laps: int, lead: int, tmp_path: Path
) -> None:
    """With and without run-in; times rounded to 0.01 s."""
    step = np.deg2rad(5.0) * 150.0 / (2000.0 / 60.0)
    rows = [f"{k * step:.2f},{(k - lead) % 7}.25" for k in range(72 * laps + lead)]
    path = table(tmp_path / NAME, "t (s),reading_um", rows, f"Overshoot {5 * lead} deg")
    (test,) = imported(path, {"feed_mm_per_min": 2000.0, "laps": "keep"}).campaign.tests
    assert len(test.angle_deg) == 72 * laps


# ---- the layout


def test_the_layout_that_was_found_out_leaves_nothing_to_guess(tmp_path: Path) -> None:
    """Read again with it: the same campaign, and no assumption about the file."""
    rows = [line.replace(",", ";").replace(".", ",") for line in CIRCLE]
    path = table(tmp_path / "own 238N.csv", "Winkel;Messwert", rows, "Radius: 140 mm", "cp1252")
    first = imported(path)
    (tmp_path / "layout.toml").write_text(layout_to_toml(first.layout), encoding="utf-8")
    again = lb.import_campaign(path, layout=lb.reading.read_layout(tmp_path / "layout.toml"))
    assert (again.campaign.sha256, again.layout) == (first.campaign.sha256, first.layout)
    assert {"separator", "decimal mark", "columns", "unit of the angle"} <= {
        assumption.what for assumption in first.assumptions
    }
    assert {assumption.what for assumption in again.assumptions if assumption.place} == {
        "force_N",
        "radius_mm",
    }, "what the file says of its test"
    assert (first.campaign.tests[0].force_N, first.campaign.tests[0].radius_mm) == (238.0, 140.0)
    assert str(first).startswith("own 238N: 1 test, 72 readings. Assumed")
    assert first.as_dict()["campaign"] == {"name": "own 238N", "tests": 1, "readings": 72}


def test_what_is_given_is_not_assumed(tmp_path: Path) -> None:
    path = table(tmp_path / "own.csv", "a,b")
    entry = {"file": "own.csv", "pressure_bar": 3.0, "direction": "CW", "work_ball_deg": 45.0}
    layout = {
        "columns": {"angle": "a", "reading": "b"},
        "reading_unit": "nm",
        "angle_unit": "deg",
        "zero": "deviation",
        "sign": 1,
        "measured": "radius",
        "angle_sense": "CCW",
    }
    result = imported(
        path,
        layout | {"test": [entry]},
        topology="wCAFYXZSt",
        plane="XY",
        radius_mm=150.0,
        resolution_um=0.1,
    )
    (test,) = result.campaign.tests
    assert (test.pressure_bar, test.direction, test.work_ball_deg) == (3.0, "CW", 45.0)
    np.testing.assert_allclose(test.reading_um, [1e-3 * (k % 7 + 0.25) for k in range(72)])
    assert {assumption.what for assumption in result.assumptions} == {
        "mount",
        "force",
        "direction",
    }  # stated CW, the angles rise


DEEP = ("a = " + "[\n" * 5000, "valid TOML"), ("a." * 400 + "b = 1", "line 1")


@pytest.mark.parametrize(("text", "message"), [*CASES["layouts_refused"], *DEEP])
def test_layouts_that_are_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "layout.toml"
    path.write_bytes(text.encode("latin-1"))
    refuses(f"{path}.*{re.escape(message)}", lb.reading.read_layout, path)


def test_a_layout_of_last_week_does_not_speak_over_this_weeks_files_unheard(tmp_path: Path) -> None:
    """The same names, other headers: what the files say counts; what was stated counts, and is
    told."""
    for week, force, sense in (("1", 36, "CCW"), ("2", 86, "CW")):
        (tmp_path / week).mkdir()
        table(
            tmp_path / week / "T.csv", above=f"Force: {force} N\nDirection: {sense}\nRadius: 100 mm"
        )
    first = imported(tmp_path / "1" / "T.csv").layout.model_dump(by_alias=True, exclude_none=True)
    assert loads_of(tmp_path / "2" / "T.csv", **first) == [("T", 86.0, "CW")]
    stated = {"test": [{"file": "T.csv", "force_N": 36.0, "direction": "CCW"}]}
    result = imported(tmp_path / "2" / "T.csv", stated, radius_mm=150.0)
    assert {
        (assumption.what, assumption.value, assumption.because) for assumption in result.assumptions
    } >= {
        ("force_N", "36 N, as given", "line 1 says 86 N"),
        ("direction", "CCW, as given", "the file says the other"),
        ("radius_mm", "150 mm, as given", "line 3 says 100 mm"),
    }
    assert [test.force_N for test in result.campaign.tests] == [36.0]


def test_options_win_over_tests_of_a_layout(tmp_path: Path) -> None:
    entry = {"file": "a.csv", "force_N": 5.0, "direction": "CCW"}
    layout = lb.reading.Layout.model_validate({"forces_N": [36.0, 742.0], "test": [entry]})
    assert layout.with_given({"direction": "CW"}).test[0].stated() == {
        "file": "a.csv",
        "force_N": 5.0,
    }
    assert layout.with_given({"pressures_bar": [2.0, 3.0]}).test[0].stated() == {
        "file": "a.csv",
        "direction": "CCW",
    }
    paths = [table(tmp_path / "a.csv"), table(tmp_path / "b.csv")]
    given = {"pressures_bar": [2.0, 3.0], "direction": "CCW"}
    result = lb.import_campaign(paths, layout=layout.with_given(given))
    assert [round(float(test.force_N or 0.0), 2) for test in result.campaign.tests] == [
        237.88,
        363.92,
    ]
    refuses(
        "the angle must be one column",
        lb.reading.Layout().with_given,
        {"columns": {"angle": ["A", "B"]}},
    )


# ---- what is told


@pytest.mark.parametrize(("header", "form", "above", "layout", "expected"), CASES["told"])
def test_what_was_assumed_is_told(
    header: str,
    form: str,
    above: str,
    layout: dict[str, Any],
    expected: tuple[str, str],
    tmp_path: Path,
) -> None:
    path = table(tmp_path / NAME, header, lines(form), above)
    assert tuple(expected) in told(imported(path, layout, plane="XY"))


LEFT_ALONE = (
    "Raw data",
    "Temperature;compensated",
    "Resolution: 5",
    "Encoder resolution: 1 mm",
    "Machine;Date",
    "Plane: XY, YZ",
)
SAID = {
    "Plane;YZ\nMachine: VMC 12\nDatum: 20.11.2026": ("YZ", True, 0.24, "VMC 12", "2026-11-20"),
    "Plane: ZX\nReadings raw, not compensated for mount\nResolution 0.01 µm": (
        "ZX",
        False,
        0.01,
        None,
        None,
    ),
    **dict.fromkeys(LEFT_ALONE, ("XY", True, 0.24, None, None)),
}


@pytest.mark.parametrize("above", SAID)
def test_lines_above_say_what_was_measured(above: str, tmp_path: Path) -> None:
    campaign = imported(
        table(tmp_path / NAME, "angle_deg;reading_um", lines("{a};{r}.25"), above)
    ).campaign
    assert (
        campaign.plane,
        campaign.mount.compensated,
        campaign.resolution_um,
        campaign.machine_id,
        campaign.date,
    ) == SAID[above]


CONTRADICTIONS = (
    "Plane: YZ\nPlane: ZX",
    "Readings raw\nCompensated: yes",
    "Date: 1.1.2026\nDate: 2.1.2026",
)


@pytest.mark.parametrize(
    ("above", "options"),
    [
        *((lines_above, {}) for lines_above in CONTRADICTIONS),
        ("Readings raw", {"mount": lb.campaign.MountCompensation(3.0)}),
    ],
)
def test_lines_above_that_contradict_are_refused(
    above: str, options: dict[str, Any], tmp_path: Path
) -> None:
    """Each other; and a deflection of the mount given without saying that the readings are raw."""
    refuses("must be said once", imported, table(tmp_path / NAME, above=above), **options)


def test_what_is_given_wins_over_lines_above_and_is_told(tmp_path: Path) -> None:
    mount = lb.campaign.MountCompensation(3.0, compensated=False)
    result = imported(
        table(tmp_path / NAME, above="Plane: YZ\nReadings compensated\nResolution 0.01 µm"),
        plane="XY",
        mount=mount,
    )
    assert (result.campaign.plane, result.campaign.mount, result.campaign.resolution_um) == (
        "XY",
        mount,
        0.01,
    )
    assert told(result) >= {
        ("plane", "XY, as given"),
        ("mount", "raw, as given"),
        ("resolution_um", "0.01 µm"),
    }
    result = imported(
        table(tmp_path / NAME, above="Plane: XY\nReadings raw"), plane="XY", mount=mount
    )
    assert not {"plane", "mount"} & {assumption.what for assumption in result.assumptions}


def test_a_resolution_that_contradicts_a_line_is_told_with_its_unit(tmp_path: Path) -> None:
    path = table(tmp_path / NAME, above="Resolution 0.01 µm")
    result = imported(path, resolution_um=0.1)
    (note,) = [note for note in result.assumptions if note.what == "resolution_um"]
    assert (note.value, note.because) == ("0.1 µm, as given", "line 1 says 0.01 µm")


def test_a_resolution_that_agrees_but_for_rounding_is_no_contradiction(tmp_path: Path) -> None:
    path = table(tmp_path / NAME, above="Resolution 0.1 µm")
    result = imported(path, resolution_um=0.1 + 1e-12)
    assert "resolution_um" not in {note.what for note in result.assumptions}


def test_names_say_plane_and_radius(tmp_path: Path) -> None:
    paths = [table(tmp_path / f"ZX_R100_{force}N.csv") for force in (36, 742)]
    result = imported(paths)
    assert (result.campaign.plane, [test.radius_mm for test in result.campaign.tests]) == (
        "ZX",
        [100.0, 100.0],
    )
    assert told(result) >= {("plane", "ZX"), ("radius_mm", "100 mm")}
    assert result.unsaid == lb.import_campaign(paths, layout=result.layout).unsaid
    result = imported(paths, plane="XY", radius_mm=150.0)
    assert told(result) >= {("plane", "XY, as given"), ("radius_mm", "150 mm, as given")}
    assert (result.campaign.plane, result.campaign.tests[0].circle.radius_mm) == ("XY", 150.0)
    for above in ("Plane: YZ", "Radius: 150 mm"):
        refuses(
            "must be said once.*its name",
            imported,
            table(tmp_path / "ZX_R100_36N.csv", above=above),
        )
    refuses("which number does 'Test 2 350 N' mean", imported, table(tmp_path / "Test 2 350 N.csv"))


# ---- what is refused


@pytest.mark.parametrize(
    ("header", "rows", "layout", "message"),
    [
        *[
            (header, lines(form), layout, message)
            for header, form, layout, message in CASES["forms_refused"]
        ],
        (
            HEADER,
            [*lines("{a},{r}", 73), *lines("{a},{r}")[::-1]],
            {},
            r"run one way in a test, got runs of \+360° and -360°",
        ),
        (
            "test,angle_deg,reading_um",
            ["a," + CIRCLE[0], *lines(",{a},{r}")],
            {},
            "line 3: rows must name their test",
        ),
        (
            "test,force_N,angle_deg,reading_um,work_ball_deg",
            [*lines("a,36,{a},{r},45", 30), *lines("a,36,{a},{r},50")[30:]],
            {},
            "line 32: work_ball_deg must be the same in all rows of test 'a', got '50' after '45'",
        ),
        *[
            ("", [*CIRCLE[:3], bad, *CIRCLE[4:]], {}, "line [34]")
            for bad in ("pause", "15.0", "15,-3,1")
        ],
        *[
            (HEADER, [*CIRCLE[:5], f"{bad},1.5", *CIRCLE[6:]], {}, r"line 7: angle \(column")
            for bad in ("---", "NaN", "")
        ],
        *[
            (HEADER, [*CIRCLE[:3], f"{bad},{bad}", *CIRCLE[3:]], {}, "line 5")
            for bad in ("paused", "1.2.3")
        ],
    ],
)
def test_files_that_cannot_be_are_refused(
    header: str, rows: list[str], layout: dict[str, Any], message: str, tmp_path: Path
) -> None:
    refuses(message, imported, table(tmp_path / NAME, header, rows), layout)


# ---- what is read


@pytest.mark.parametrize("bad", ["25,", "25,NaN", "25,---", "NaN,n/a", ",", "#DIV/0!,#DIV/0!"])
def test_rows_without_a_reading_are_left_out_and_told(bad: str, tmp_path: Path) -> None:
    result = imported(table(tmp_path / NAME, HEADER, [*CIRCLE[:5], bad, *CIRCLE[6:]]))
    (test,) = result.campaign.tests
    assert 25.0 not in test.angle_deg
    assert len(test.angle_deg) == len(CIRCLE) - 1
    (note,) = [note for note in result.assumptions if note.what == "missing readings"]
    assert note.value == "1 row left out"


def test_a_column_of_few_readings_is_refused(tmp_path: Path) -> None:
    rows = [f"{5 * k}," for k in range(40)] + CIRCLE[40:]
    refuses(r"line 2: reading \(column", imported, table(tmp_path / NAME, HEADER, rows), {})


@pytest.mark.parametrize("units", ["°;µm;-", "°;µm;°C", "Grad;µm;"])
def test_units_below_the_names_of_which_one_is_none(units: str, tmp_path: Path) -> None:
    (test,) = imported(
        table(tmp_path / NAME, "Winkel;Messwert;T", [units, *lines("{a};{r};21")])
    ).campaign.tests
    np.testing.assert_allclose(test.reading_um, [k % 7 for k in range(72)])
    assert test.arc_deg > 350.0


def test_our_own_tables_import_as_they_read(tmp_path: Path, root: Path) -> None:
    """Columns that hold one value a test among them; names like f036 say the force."""
    header = (
        "test,force_N,angle_deg,reading_um,direction,work_ball_deg,radius_mm,setup,plane,"
        "temperature_C,time_s"
    )
    rows = lines("a,36,{a},{r},CW,45,120,2,XY,20.5,0") + lines(
        "b,742,{a},{r},CCW,90,150,1,XY,21,600"
    )
    path = table(tmp_path / "all.csv", header, rows)
    result = imported(path, name="all")
    assert result.campaign.sha256 == lb.read_campaign(path).sha256
    assert "columns not used" not in {assumption.what for assumption in result.assumptions}
    shipped = lb.read_campaign(root / "data" / "recovered_experiment")
    again = imported(sorted((root / "data" / "recovered_experiment").glob("f*.csv"))).campaign
    assert again.forces_N.tolist() == shipped.forces_N.tolist()
    for read_again, test in zip(again.tests, shipped.tests, strict=True):
        np.testing.assert_array_equal(
            [read_again.angle_deg, read_again.reading_um], [test.angle_deg, test.reading_um]
        )


def test_marks_that_may_be_of_thousands_bare_columns_and_commas_between_blanks(
    tmp_path: Path,
) -> None:
    path = table(
        tmp_path / NAME,
        "angle_deg;reading_nm",
        lines("{a};12,{k}10", 10) + lines("{a};12,{k}0")[10:],
    )
    assert any(
        "thousands" in assumption.because
        for assumption in imported(path).assumptions
        if assumption.what == "decimal mark"
    )
    assert imported(path, {"decimal": "."}).campaign.tests[0].reading_um[0] == pytest.approx(12.010)
    path = table(tmp_path / NAME, "", lines("{k},{a},{r}.25"))
    assert (
        imported(path, {"columns": {"angle": 2, "reading": 3}}).campaign.tests[0].reading_um[1]
        == 1.25
    )
    assert (
        imported(table(tmp_path / "b 36N.txt", "", lines("{a},0 {r},25")))
        .campaign.tests[0]
        .reading_um[1]
        == 1.25
    )


def test_names_of_files_and_labels(tmp_path: Path) -> None:
    """What cannot stand in a file's name is replaced; a label that two files share comes behind the
    file's name."""
    result = imported(table(tmp_path / "36,5 N (1).csv"))
    assert [(test.name, test.force_N) for test in result.campaign.tests] == [("36_5 N _1_", 36.5)]
    paths = [
        table(tmp_path / f"{name}.csv", "angle;36 N;238 N", lines("{a};{r};{q}"))
        for name in ("CW", "CCW")
    ]
    assert [loads[0] for loads in loads_of(paths)] == ["36 N", "238 N", "CCW 36 N", "CCW 238 N"]
    refuses(
        "tests must bear different names, got 'a 36N' twice", imported, [table(tmp_path / NAME)] * 2
    )


def test_a_label_before_its_file(tmp_path: Path) -> None:
    """Both entries speak; the label's word counts; one force for a file of several tests is
    refused."""
    rows = [f"a,{line}" for line in CIRCLE] + [f"b,{line}" for line in CIRCLE]
    path = table(tmp_path / "all.csv", "test,angle_deg,reading_um", rows)
    loads = [{"file": "a", "force_N": 36.0}, {"file": "b", "force_N": 742.0, "direction": "CW"}]
    result = imported(path, {"test": [{"file": "all.csv", "direction": "CCW"}, *loads]})
    assert [(test.force_N, test.direction) for test in result.campaign.tests] == [
        (36.0, "CCW"),
        (742.0, "CW"),
    ]
    assert "[[test]] not used" not in {assumption.what for assumption in result.assumptions}
    refuses(
        "must be of one test, got several in it",
        imported,
        path,
        {"test": [{"file": "all.csv", "force_N": 36.0}]},
    )


@pytest.mark.parametrize(("header", "expected"), CASES["columns"])
def test_a_column_for_each_force(
    header: str, expected: list[tuple[str, float, str]], tmp_path: Path
) -> None:
    path = table(tmp_path / "wide.csv", header, lines("{a};0.00{r};0.0{q}"))
    result = imported(path)
    assert loads_of(path) == [
        (name, force, direction or None) for name, force, direction in expected
    ]
    np.testing.assert_allclose(
        result.campaign.tests[1].reading_um, [10 * (k % 5) for k in range(72)], atol=1e-12
    )
    assert lb.import_campaign(path, layout=result.layout).campaign.sha256 == result.campaign.sha256


# ---- workbooks

RADII = [
    ("Radius:", "100 mm"),
    ("Radius", "100 mm"),
    ("Radius:", None, "100 mm"),
    ("Messradius:", "100,0 mm"),
    ("Radius [mm]", 100),
    ("Radius:", 100, "mm"),
    ("Radius: 100 mm",),
]


@pytest.mark.parametrize("colon", ["", ":"])
@pytest.mark.parametrize(
    "listed",
    [[], [("Blatt", "Kraft [N]", "Drehsinn"), ("36 N", 36, "GUZS"), ("742 N", 742, "gegen UZS")]],
)
@pytest.mark.parametrize("radius", RADII)
def test_labels_and_values_of_an_overview_are_read_above_and_below_its_list(
    radius: tuple[Any], listed: list[Any], colon: str, tmp_path: Path
) -> None:
    values = {
        "Maschine": "VMC 12",
        "Messgerät": "LDBB",
        "kalibriert am": "1.2.2026",
        "Vorschub": "2000 mm/min",
        "Ort": "Halle 3",
        "Kraftmessgerät": "Kistler 9317",
    }
    pairs = [(label + colon, value) for label, value in values.items()]
    overview = [
        *pairs[:2],
        radius,
        *listed,
        *pairs[2:],
        *([] if listed else [("Richtung" + colon, "UZS")]),
    ]
    campaign = imported(
        book(tmp_path / "b.xlsx", {"Info": overview, "36 N": SHEET, "742 N": SHEET})
    ).campaign
    assert [
        campaign.machine_id,
        campaign.ball_bar,
        campaign.ball_bar_calibrated,
        campaign.feed_mm_per_min,
        campaign.place,
        campaign.force_device,
    ] == ["VMC 12", "LDBB", "2026-02-01", 2000.0, "Halle 3", "Kistler 9317"]
    assert [(test.radius_mm, test.direction) for test in campaign.tests] == [
        (100.0, "CCW" if listed else "CW")
    ] * 2


@pytest.mark.parametrize("label", ["Ball bar", "Ball bar:", "Loaded double ball bar", "Ballbar"])
def test_the_bar_of_an_overview_is_read_although_bar_is_a_unit_too(
    label: str, tmp_path: Path
) -> None:
    overview = [("Machine", "FZ 400"), (label, "LDBB 7"), ("Remark by us", "Place: Hall 3")]
    sheets = {"About": overview, "36 N": SHEET, "742 N": SHEET}
    campaign = imported(book(tmp_path / "b.xlsx", sheets)).campaign
    assert (campaign.ball_bar, campaign.place) == ("LDBB 7", "Hall 3")


def test_a_direction_of_a_sheet_without_a_table_has_that_reason(tmp_path: Path) -> None:
    sheets = {"Info": [("Richtung:", "UZS")], "36 N": SHEET, "742 N": SHEET}
    result = imported(book(tmp_path / "b.xlsx", sheets))
    reasons = {(a.value, a.because) for a in result.assumptions if a.what == "direction"}
    assert ("CW", "a sheet without a table") in reasons


def test_what_is_not_understood_or_contradicts_the_force_law_is_told(tmp_path: Path) -> None:
    overview = [
        ("Radius", "hundert"),
        ("Vorschub", "langsam"),
        ("Richtung", "CW und CCW"),
        ("Prüfkraft:", "238 N"),
    ]
    path = book(tmp_path / "b.xlsx", {"Info": overview, "A": SHEET, "B": SHEET})
    assumptions = imported(
        path, {"forces_N": [112.0, 2.0], "pressures_bar": [1.0, 2.0]}
    ).assumptions
    because = {
        assumption.what: assumption.because for assumption in assumptions if not assumption.place
    }
    for line, key in enumerate(("radius_mm", "feed_mm_per_min", "direction"), start=1):
        assert re.fullmatch(
            f"line {line} of .* says {key.split('_')[0]}, not understood", because[key]
        )
    (unused,) = (
        assumption.because for assumption in assumptions if assumption.value == "taken for no test"
    )
    assert re.fullmatch("line 4 of .* says 238 N outside the list of tests", unused)
    assert ("2 N at 2 bar", "of the pressures the force law makes 237.9 N") in {
        (assumption.value, assumption.because) for assumption in assumptions
    }


def book_of_two_machines(path: Path) -> Path:
    """The sheets of each machine begin with the same letter."""
    sheets = {}
    for machine in "AB":
        for force in (36, 742):
            sheets[f"{machine} {force} N"] = [["Serial number:", f"{machine}-1"], *SHEET]
    return book(path, sheets)


def test_two_machines_in_a_book_are_imported_one_by_one(tmp_path: Path) -> None:
    """Their refusal names --sheets, whose patterns are expanded in the order of the book."""
    path = book_of_two_machines(tmp_path / "two.xlsx")
    cure = r"Import machines one by one \(--sheets with those of one\)\. Of one machine, correct"
    refuses(rf"serial_number must be said once, got A-1 .* and B-1 .*\. {cure}", imported, path)
    for patterns in (["B*"], ["B 36 N", "B*"], ["B ?? N", "B 742 N"]):
        campaign = imported(path, {"sheets": patterns}).campaign
        assert campaign.serial_number == "B-1"
        assert [test.name for test in campaign.tests] == ["B 36 N", "B 742 N"]
    absent = r"sheets must match C\*, got none: it has 'A 36 N', 'A 742 N'"
    refuses(absent, imported, path, {"sheets": ["B*", "C*"]})


def test_a_pattern_matches_what_is_shown() -> None:
    """Hidden sheets match no pattern. Brackets are letters, and so is ? in the name of a sheet."""
    names = ["36 N", "36 N?", "742 N [1]", "742 N"]
    shown = names[:3]
    assert _names_matching(Path("b.ods"), ["742*"], names, shown) == ["742 N [1]"]
    assert _names_matching(Path("b.ods"), ["742 N [*", "36 N?"], names, shown) == [
        "742 N [1]",
        "36 N?",
    ]


def test_one_force_for_each_sheet(tmp_path: Path) -> None:
    path = book(tmp_path / "two.xlsx", {"Versuch 1": SHEET, "Versuch 2": SHEET})
    expected = [("Versuch 1", 36.0, None), ("Versuch 2", 742.0, None)]
    assert loads_of(path, forces_N=[36.0, 742.0]) == expected
    loads = {
        "test": [{"file": f"Versuch {k}", "force_N": force} for k, force in ((1, 36.0), (2, 742.0))]
    }
    assert loads_of(path, **loads) == expected
    refuses(
        r"--forces-N must hold one number for each test, got 1 for 2 tests",
        loads_of,
        path,
        forces_N=[36.0],
    )
    senses = book(tmp_path / "cw and ccw.xlsx", {"36 N CW": SHEET, "36 N CCW": SHEET})
    assert loads_of(senses) == [("36 N CW", 36.0, "CW"), ("36 N CCW", 36.0, "CCW")]


@pytest.mark.parametrize("above", ["", "Feed: 2000 mm/min"])
def test_a_feed_that_the_user_states_is_that_of_the_campaign(tmp_path: Path, above: str) -> None:
    """Also beside angles, and where the file states another."""
    path = table(tmp_path / NAME, above=above)
    assert imported(path, {"feed_mm_per_min": 1500.0}).campaign.feed_mm_per_min == 1500.0
