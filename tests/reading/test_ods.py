"""ODS workbooks: units in number formats, hidden rows, formulas without values, durations."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb

SPACES = " ".join(
    f'xmlns:{name}="urn:oasis:names:tc:opendocument:xmlns:{space}:1.0"'
    for name, space in {
        "office": "office",
        "table": "table",
        "text": "text",
        "style": "style",
        "number": "datastyle",
    }.items()
)
READINGS_UM = np.array([(7 * k) % 11 - 4.75 for k in range(36)])


def style(name: str, shown: str) -> str:
    return (
        f'<number:number-style style:name="N{name}"><number:number/>'
        f"<number:text>{shown}</number:text></number:number-style>"
        f'<style:style style:name="{name}" style:family="table-cell"'
        f' style:data-style-name="N{name}"/>'
    )


def number(value: float, style_name: str = "") -> str:
    attribute = f' table:style-name="{style_name}"' if style_name else ""
    return (
        f'<table:table-cell{attribute} office:value-type="float" office:value="{value!r}">'
        f"<text:p>{value}</text:p></table:table-cell>"
    )


def text(words: str) -> str:
    return (
        f'<table:table-cell office:value-type="string"><text:p>{words}</text:p></table:table-cell>'
    )


def row(*cells: str, attributes: str = "") -> str:
    return f"<table:table-row {attributes}>{''.join(cells)}</table:table-row>"


def table_rows(
    header: str = "Deviation [um]", scale: float = 1.0, style_name: str = ""
) -> list[str]:
    rows = [row(text("Angle [deg]"), text(header))]
    for k, reading in enumerate(READINGS_UM):
        rows.append(row(number(10.0 * k), number(float(scale * reading), style_name)))
    return rows


def workbook(
    folder: Path, rows: list[str], styles: str = "", columns: str = "", common_styles: str = ""
) -> Path:
    content = (
        f"<office:document-content {SPACES}><office:automatic-styles>{styles}"
        "</office:automatic-styles><office:body><office:spreadsheet>"
        f'<table:table table:name="300 N">{columns}{"".join(rows)}</table:table>'
        "</office:spreadsheet></office:body></office:document-content>"
    )
    path = folder / "m.ods"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        archive.writestr("content.xml", content)
        if common_styles:
            archive.writestr(
                "styles.xml",
                f"<office:document-styles {SPACES}><office:styles>{common_styles}</office:styles>"
                "</office:document-styles>",
            )
        archive.writestr(
            "META-INF/manifest.xml",
            '<manifest:manifest xmlns:manifest="urn:oasis:names:tc:opendocument:xmlns:manifest:1.0"'
            "/>",
        )
    return path


@pytest.mark.parametrize(("shown", "radius"), [(" cm", 10.0), (" mm", 100.0), ("m", 0.1)])
def test_the_unit_in_the_format_of_a_radius_is_read(
    shown: str, radius: float, tmp_path: Path
) -> None:
    rows = [row(text("Radius"), number(radius, "r")), *table_rows()]
    imported = lb.import_campaign(workbook(tmp_path, rows, style("r", shown)))
    assert imported.campaign.tests[0].radius_mm == pytest.approx(100.0)
    assert "hidden rows and number formats" not in [note.what for note in imported.assumptions]


def test_formats_of_the_content_come_before_common_ones_of_the_same_name(tmp_path: Path) -> None:
    rows = [row(text("Radius"), number(100.0, "r")), *table_rows()]
    path = workbook(tmp_path, rows, style("r", " mm"), common_styles=style("r", " cm"))
    assert lb.import_campaign(path).campaign.tests[0].radius_mm == pytest.approx(100.0)


def test_the_unit_in_a_common_format_is_read(tmp_path: Path) -> None:
    rows = [row(text("Radius"), number(10.0, "r")), *table_rows()]
    path = workbook(tmp_path, rows, common_styles=style("r", " cm"))
    assert lb.import_campaign(path).campaign.tests[0].radius_mm == pytest.approx(100.0)


def test_the_unit_in_the_format_of_readings_is_read(tmp_path: Path) -> None:
    rows = table_rows("Deviation", 0.1, "r")
    (test,) = lb.import_campaign(workbook(tmp_path, rows, style("r", " mil"))).campaign.tests
    np.testing.assert_allclose(test.reading_um, 2.54 * READINGS_UM)


def test_the_unit_in_the_format_of_a_column_is_read_behind_repeated_rows(tmp_path: Path) -> None:
    columns = '<table:table-column/><table:table-column table:default-cell-style-name="r"/>'
    empty = row("<table:table-cell/>", attributes='table:number-rows-repeated="4"')
    rows = [empty, *table_rows("Deviation", 0.1)]
    path = workbook(tmp_path, rows, style("r", " mil"), columns)
    (test,) = lb.import_campaign(path).campaign.tests
    np.testing.assert_allclose(test.reading_um, 2.54 * READINGS_UM)


def test_a_damaged_number_of_columns_leaves_formats_unread_and_told(tmp_path: Path) -> None:
    columns = '<table:table-column table:number-columns-repeated="x"/>'
    imported = lb.import_campaign(workbook(tmp_path, table_rows(), columns=columns))
    np.testing.assert_allclose(imported.campaign.tests[0].reading_um, READINGS_UM)
    assert "hidden rows and number formats" in [note.what for note in imported.assumptions]


@pytest.mark.parametrize("visibility", ["collapse", "filter"])
def test_hidden_rows_are_left_out_and_told(visibility: str, tmp_path: Path) -> None:
    rows = table_rows()
    hidden = f'table:visibility="{visibility}"'
    rows.insert(5, row(number(35.0), number(3.5), attributes=hidden))
    imported = lb.import_campaign(workbook(tmp_path, rows))
    np.testing.assert_allclose(imported.campaign.tests[0].reading_um, READINGS_UM)
    assert any("hidden" in note.because or "hidden" in note.value for note in imported.assumptions)


@pytest.mark.parametrize("is_inherited", [False, True])
def test_struck_numbers_are_refused(is_inherited: bool, tmp_path: Path) -> None:
    struck = (
        '<style:style style:name="bad" style:family="table-cell"><style:text-properties'
        ' style:text-line-through-style="solid"/></style:style>'
    )
    heir = '<style:style style:name="heir" style:parent-style-name="bad"/>'
    rows = table_rows()
    style_name = "heir" if is_inherited else "bad"
    rows[4] = row(number(30.0), number(float(READINGS_UM[3]), style_name))
    path = workbook(tmp_path, rows, heir, common_styles=struck)
    with pytest.raises(lb.InputError, match=r"line 5: .* numbers struck through"):
        lb.import_campaign(path)


def test_formulas_without_values_are_named(tmp_path: Path) -> None:
    rows = [row(text("Angle [deg]"), text("Deviation [um]"))]
    for reading in READINGS_UM:
        formula = '<table:table-cell table:formula="of:=[.A1]+5" office:value-type="float"/>'
        rows.append(row(formula, number(float(reading))))
    with pytest.raises(lb.InputError, match=r"line 2: cells must hold values.*save it once"):
        lb.import_campaign(workbook(tmp_path, rows))


def test_durations_are_shown_as_a_spreadsheet_shows_them(tmp_path: Path) -> None:
    rows = [row(text("Angle (D-M-S)"), text("Deviation [um]"))]
    for k, reading in enumerate(READINGS_UM):
        angle = (
            '<table:table-cell office:value-type="time"'
            f' office:time-value="PT{10 * k:02}H30M00S"><text:p>x</text:p></table:table-cell>'
        )
        rows.append(row(angle, number(float(reading))))
    (test,) = lb.import_campaign(workbook(tmp_path, rows)).campaign.tests
    np.testing.assert_allclose(test.angle_deg, 10.0 * np.arange(36) + 0.5)


@pytest.mark.parametrize(
    ("name", "beginning", "message"),
    [
        ("a.csv.bz2", b"BZh91AY&SY", "must be unpacked"),
        ("a.csv.xz", b"\xfd7zXZ\x00\x00", "must be unpacked"),
        ("a.7z", b"7z\xbc\xaf'\x1c\x00\x04", "must be unpacked"),
        ("a.feather", b"ARROW1\x00\x00", "got a Feather file"),
        ("a.pkl", b"\x80\x04\x95\x00", "got a pickle of Python"),
    ],
)
def test_compressed_and_binary_files_are_named(
    name: str, beginning: bytes, message: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_bytes(beginning + bytes(100))
    with pytest.raises(lb.InputError, match=message):
        lb.import_campaign(path)


def test_an_archive_of_files_with_another_name_must_be_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "export.dat"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("100N.csv", "Angle [deg];Deviation [um]\n0;1\n")
    with pytest.raises(lb.InputError, match="must be unpacked, got an archive"):
        lb.import_campaign(path)


@pytest.mark.parametrize("column", ["Angle [deg]", "Deviation [um]"])
def test_column_in_percent_is_asked_about(tmp_path, column):
    rows = [row(text("Angle [deg]"), text("Deviation [um]"))]
    for k, reading in enumerate(READINGS_UM):
        cells = {"Angle [deg]": number(10.0 * k), "Deviation [um]": number(float(reading))}
        cells[column] = cells[column].replace('"float"', '"percentage"')
        rows.append(row(*cells.values()))
    path = workbook(tmp_path, rows)
    with pytest.raises(
        lb.errors.InputError, match=r"line 2: column .* got a cell shown in percent"
    ):
        lb.import_campaign(path)


def test_number_in_percent_above_table_is_no_force(tmp_path):
    share = number(2.0).replace('"float"', '"percentage"')
    path = workbook(tmp_path, [row(text("Force"), share), *table_rows()])
    assert lb.import_campaign(path).campaign.tests[0].force_N == 300.0


def test_unused_column_in_percent_changes_nothing(tmp_path):
    rows = [row(text("Angle [deg]"), text("Deviation [um]"), text("Quality"))]
    share = number(0.97).replace('"float"', '"percentage"')
    for k, reading in enumerate(READINGS_UM):
        rows.append(row(number(10.0 * k), number(float(reading)), share))
    imported = lb.import_campaign(workbook(tmp_path, rows))
    np.testing.assert_allclose(imported.campaign.tests[0].reading_um, READINGS_UM)
