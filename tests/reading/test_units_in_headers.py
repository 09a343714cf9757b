"""Units in headers: words that multiply them, R's dots, and units that are not read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.words import size_of_unit


@pytest.mark.parametrize(
    ("role", "header", "size"),
    [
        ("reading", "deviation.micro.metres", 1.0),
        ("reading", "dev_milli_inch", 25.4),
        ("reading", "deviation.thousandths.of.an.inch", 25.4),
        ("reading", "dev hundred thousandths of an inch", 0.254),
        ("reading", "dev.millionths.of.an.inch", 0.0254),
        ("reading", "Reading..um..1", 1.0),
        ("angle", "angle.milli.deg", 1e-3),
        ("angle", "angle tenths of a degree", 0.1),
        ("force", "Force kilo newton", 1e3),
        ("force", "force.pound.force", 4.4482216152605),
        ("force", "F_pounds", 4.4482216152605),
    ],
)
def test_words_that_multiply_a_unit_count(role: str, header: str, size: float) -> None:
    assert size_of_unit(role, unit_of(header).unit) == pytest.approx(size)


@pytest.mark.parametrize(
    ("header", "unit"),
    [
        ("force.oz", "oz"),
        ("Load kg", "kg"),
        ("Pressure kg/cm2", "kg/cm2"),
        ("dev_tenths", "tenths"),
        ("angle_counts", "counts"),
        ("Angle half deg", "half deg"),
        ("dev...m.", "?m"),
        ("dev.1000ths.of.an.inch", "1000ths of an inch"),
        ("dev..0.1.um.", "(0.1) um"),
    ],
)
def test_a_unit_that_is_not_read_is_no_other_unit(header: str, unit: str) -> None:
    assert unit_of(header).unit == unit


def test_a_unit_that_is_not_read_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    rows = [f"{5 * k},{0.1 * k:.2f},100" for k in range(72)]
    path.write_text("\n".join(["angle.deg,dev.um,force.oz", *rows, ""]))
    with pytest.raises(lb.InputError, match=r"got 'oz' in line 1.*--force-unit"):
        lb.import_campaign(path)


def test_a_factor_between_dots_is_asked(tmp_path: Path) -> None:
    path = tmp_path / "100N.csv"
    rows = [f"{5 * k},{k}" for k in range(72)]
    path.write_text("\n".join(["angle.deg,dev.um.x10", *rows, ""]))
    with pytest.raises(lb.InputError, match="--unit"):
        lb.import_campaign(path)


def test_a_prefix_apart_from_its_unit_is_read_in_a_line(tmp_path: Path) -> None:
    path = tmp_path / "100N.csv"
    rows = [f"{5 * k},{k / 1000}" for k in range(72)]
    path.write_text("\n".join(["Unit: milli metres", "Angle [deg],Reading", *rows, ""]))
    assert lb.import_campaign(path).campaign.tests[0].reading_um[1] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("header", "step"),
    [
        ("Position (gr),dev.um,force.N", r"--angle-unit gon \(400 in a turn\) or --angle-unit deg"),
        ("angle.deg,dev.um,load_kg", "--force-unit kgf"),
    ],
)
def test_a_unit_that_may_be_two_is_refused_with_both(
    header: str, step: str, tmp_path: Path
) -> None:
    path = tmp_path / "t.csv"
    rows = [f"{5 * k},{0.1 * k:.2f},100" for k in range(72)]
    path.write_text("\n".join([header, *rows, ""]))
    with pytest.raises(lb.InputError, match=step):
        lb.import_campaign(path)


def test_inches_that_may_be_a_word_are_asked(tmp_path: Path) -> None:
    path = tmp_path / "100N.csv"
    rows = [f"{5 * k},{k / 1000}" for k in range(72)]
    path.write_text("\n".join(["in", "Angle [deg],Reading", *rows, ""]))
    with pytest.raises(lb.InputError, match=r"'in' in line 1.*--unit"):
        lb.import_campaign(path)
    imported = lb.import_campaign(path, layout=Layout(reading_unit="inch"))
    assert imported.campaign.tests[0].reading_um[1] == pytest.approx(25.4)


@pytest.mark.parametrize(("header", "sign"), [("dR 100 N - in", 1.0), ("-dR 100 N - in", -1.0)])
def test_inches_behind_a_dash_do_not_state_the_sign(
    header: str, sign: float, tmp_path: Path
) -> None:
    path = tmp_path / "100N.csv"
    rows = [f"{5 * k},{k / 100_000}" for k in range(72)]
    path.write_text("\n".join([f"Angle [deg],{header}", *rows, ""]))
    assert lb.import_campaign(path).campaign.tests[0].reading_um[1] == pytest.approx(sign * 0.254)


def test_a_tenth_of_a_unit_in_the_header_is_the_size_of_a_count(tmp_path: Path) -> None:
    file = tmp_path / "300N.csv"
    table = "\n".join(f"{angle},{angle % 7}" for angle in range(0, 360, 5))
    file.write_text(f"Angle [deg],dR [0.1 um]\n{table}\n", encoding="utf-8")
    imported = lb.import_campaign(file)
    assert imported.campaign.tests[0].reading_um[1] == pytest.approx(0.5)
    assert ("unit of the reading", "0.1 um") in [
        (note.what, note.value) for note in imported.assumptions
    ]


def circle_with_headers(folder: Path, angle: str, reading: str, above: str = "") -> Path:
    """Write one circle with a reading every 5°, and a line above the table."""
    lines = [above] * bool(above) + [f"{angle};{reading}"]
    lines += [f"{5 * k};{20.0 + k % 24:.1f}" for k in range(72)]
    path = folder / "36N.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "header",
    ["Reading [um] (x10)", "Reading [um] (x 10)", "Reading 10x [um]", "Reading um E-1"],
)
def test_a_factor_beside_the_unit_of_readings_is_asked_for(header: str, tmp_path: Path) -> None:
    path = circle_with_headers(tmp_path, "Angle [deg]", header)
    with pytest.raises(lb.InputError, match="the unit of readings must be known, got the header"):
        lb.import_campaign(path)
    test = lb.import_campaign(path, layout=Layout(reading_unit="0.1 um")).campaign.tests[0]
    assert test.reading_um[:2] == pytest.approx([2.0, 2.1])


@pytest.mark.parametrize(
    "header", ["Angle x10 [deg]", "10*Angle [deg]", "angle_deg_x10", "Angle/2 [deg]"]
)
def test_a_factor_in_the_header_of_angles_is_asked_for(header: str, tmp_path: Path) -> None:
    path = circle_with_headers(tmp_path, header, "Reading [um]")
    with pytest.raises(lb.InputError, match="the unit of angles must be known, got the header"):
        lb.import_campaign(path)
    layout = Layout(angle_unit="2 deg")
    test = lb.import_campaign(path, layout=layout).campaign.tests[0]
    assert max(test.angle_deg) == pytest.approx(710.0)


def test_degrees_that_are_added_in_the_header_of_angles_are_asked_for(tmp_path: Path) -> None:
    path = circle_with_headers(tmp_path, "Angle+90 [deg]", "Reading [um]")
    with pytest.raises(lb.InputError, match="angles must begin at an axis, got 'Angle\\+90"):
        lb.import_campaign(path)


def test_angles_that_are_subtracted_from_90_degrees_are_asked_for(tmp_path: Path) -> None:
    path = circle_with_headers(tmp_path, "90-angle [deg]", "Reading [um]")
    with pytest.raises(lb.InputError, match="angles must run clockwise or counter-clockwise"):
        lb.import_campaign(path)
    with pytest.raises(lb.InputError, match=r"at an axis, got .* Give --angle-offset-deg"):
        lb.import_campaign(path, layout=Layout(angle_sense="CW"))
    layout = Layout(angle_sign=-1, angle_offset_deg=90.0)
    test = lb.import_campaign(path, layout=layout).campaign.tests[0]
    np.testing.assert_allclose(np.mod(test.angle_deg[:3], 360.0), [90.0, 85.0, 80.0])


def test_minus_in_words_in_front_of_readings_is_a_sign(tmp_path: Path) -> None:
    path = circle_with_headers(tmp_path, "Angle [deg]", "minus reading [um]")
    test = lb.import_campaign(path).campaign.tests[0]
    assert test.reading_um[:2] == pytest.approx([-20.0, -21.0])


@pytest.mark.parametrize("line", ["Radius: 0.1", "Radius: 100000", "Radius: 100 m m"])
def test_a_radius_that_no_bar_has_is_asked_for(line: str, tmp_path: Path) -> None:
    path = circle_with_headers(tmp_path, "Angle [deg]", "Reading [um]", line)
    with pytest.raises(lb.InputError, match="the radius must be 10 to 5000 mm, got"):
        lb.import_campaign(path)
    assert lb.import_campaign(path, radius_mm=100.0).campaign.radius_mm == 100.0


@pytest.mark.parametrize("header", ["reading_10um", "reading_01um", "reading e3 [mm]"])
def test_a_factor_written_as_one_word_with_its_unit_is_asked_for(
    header: str, tmp_path: Path
) -> None:
    with pytest.raises(lb.InputError, match=r"reading must be in um, |unit of readings must be"):
        lb.import_campaign(circle_with_headers(tmp_path, "Angle [deg]", header))


@pytest.mark.parametrize(
    ("angle", "reading"),
    [
        ("deg", "um"),
        ("°", "µm"),
        ("Degrees", "Microns"),
        ("[deg]", "[um]"),
        ("Angle [deg]", "Reading [um] 1"),
        ("Angle [deg]", "36N_run1_um"),
        ("Angle [deg]", "Radius deviation from 150 mm [um]"),
    ],
)
def test_units_without_names_and_numbers_of_columns_are_read(
    angle: str, reading: str, tmp_path: Path
) -> None:
    path = circle_with_headers(tmp_path, angle, reading)
    test = lb.import_campaign(path).campaign.tests[0]
    columns = np.loadtxt(path, delimiter=";", skiprows=1)
    np.testing.assert_allclose(test.angle_deg, columns[:, 0])
    np.testing.assert_allclose(test.reading_um, columns[:, 1])


@pytest.mark.parametrize(
    ("name", "radius_mm"),
    [
        ("36 N radius 10 cm", 100.0),
        ("36 N_radius=3.937 in", 99.9998),
        ("36 N Rayon 0,1 m", 100.0),
        ("radius 75 in XY, 36 N", 75.0),
        ("36 N_radius_75_in_XY", 75.0),
    ],
)
def test_a_radius_with_its_unit_is_taken_from_a_name(
    name: str, radius_mm: float, tmp_path: Path
) -> None:
    path = circle_with_headers(tmp_path, "Angle [deg]", "Reading [um]")
    path = path.rename(tmp_path / f"{name}.csv")
    assert lb.import_campaign(path).campaign.tests[0].radius_mm == pytest.approx(radius_mm)


@pytest.mark.parametrize("length", ["Radius 0.1", "Bar length 100", "radius ~100", "Radius 4"])
def test_a_length_without_a_unit_in_a_name_is_noted(length: str, tmp_path: Path) -> None:
    path = circle_with_headers(tmp_path, "Angle [deg]", "Reading [um]")
    path = path.rename(tmp_path / f"36 N {length}.csv")
    notes = [str(assumption) for assumption in lb.import_campaign(path).assumptions]
    assert any(f"its name says {length}, not taken" in note for note in notes)


def test_a_load_in_newtons_is_read_in_cyrillic(tmp_path: Path) -> None:
    path = circle_with_headers(tmp_path, "угол, град", "отклонение, мкм")
    path = path.rename(tmp_path / "238 Н повтор.csv")
    assert lb.import_campaign(path).campaign.tests[0].force_N == 238.0


@pytest.mark.parametrize(
    ("unit", "size_um"), [("1/10 µm", 0.1), ("1/1000 mm", 1.0), ("1e-6 m", 1.0)]
)
def test_a_share_of_a_unit_in_the_header_is_the_size_of_a_count(
    unit: str, size_um: float, tmp_path: Path
) -> None:
    path = tmp_path / "100N.csv"
    lines = [f"{10 * k};{k % 7 + 3}" for k in range(36)]
    text = "\n".join([f"Angle [deg];Reading [{unit}]", *lines, ""])
    path.write_text(text, encoding="utf-8")
    reading_um = lb.import_campaign(path).campaign.tests[0].reading_um
    assert reading_um[:2].tolist() == pytest.approx([3 * size_um, 4 * size_um])
