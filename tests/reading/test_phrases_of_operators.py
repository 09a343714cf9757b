"""Lines in which operators state load, zero of the angles, and sign in words of their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb

ANGLES_DEG = np.arange(0.0, 360.0, 10.0)


def reading_um(angle_deg: float) -> float:
    """Return a reading that no exchange of axes or signs leaves as it is."""
    theta = np.deg2rad(angle_deg)
    return float(round(4.0 * np.cos(theta) - 2.5 * np.sin(theta) + np.sin(3.0 * theta + 0.4), 3))


def table(
    folder: Path, line: str, *, zero_deg: float = 0.0, sense: int = 1, sign: int = 1, name: str = ""
) -> Path:
    """Write a circle below a line; the file counts its angles from ``zero_deg`` in ``sense``."""
    rows = [line, "Angle [deg];Deviation [um]"]
    for angle_deg in ANGLES_DEG:
        written_deg = (sense * (angle_deg - zero_deg)) % 360.0
        rows.append(f"{written_deg:g};{sign * reading_um(angle_deg)}")
    path = folder / f"{name or '100N'}.csv"
    path.write_text("\n".join([*rows, ""]), encoding="utf-8")
    return path


def assert_read_as_true(path: Path) -> None:
    (test,) = lb.import_campaign(path).campaign.tests
    assert test.reading_um == pytest.approx([reading_um(a) for a in test.angle_deg], abs=2e-3)


@pytest.mark.parametrize(
    ("line", "zero_deg", "sense"),
    [
        ("Angles counted clockwise starting at the +Y axis", 90.0, -1),
        ("Angular origin: -X (CCW)", 180.0, 1),
        ("Angular zero: +Y, clockwise", 90.0, -1),
        ("zero angle = bar points to +Y, clockwise", 90.0, -1),
        ("Zero of angles when the ball bar points to +Y, clockwise", 90.0, -1),
    ],
)
def test_the_axis_at_which_angles_begin_is_understood(
    line: str, zero_deg: float, sense: int, tmp_path: Path
) -> None:
    assert_read_as_true(table(tmp_path, line, zero_deg=zero_deg, sense=sense))


@pytest.mark.parametrize(
    ("line", "option"),
    [
        ("zero angle: ball bar points to -X", "--angle-sense"),
        ("Winkelnullpunkt: 6 Uhr", "--angle-zero"),
        ("LVDT output inverted", "--sign"),
        ("Y axis inverted", "--angle-sense"),
        ("Y-Achse gespiegelt", "--angle-sense"),
        ("Operator: A. Reader; mirrored in Y", "--angle-sense"),
        ("Bar mirrored in Y", "--angle-sense"),
        ("X reversed", "--angle-zero"),
        ("Gain 10", "--unit"),
        ("Verstärkung: 10-fach", "--unit"),
        ("Magnification;x 20", "--unit"),
    ],
)
def test_a_line_that_leaves_angles_or_sign_open_is_asked_for(
    line: str, option: str, tmp_path: Path
) -> None:
    with pytest.raises(lb.InputError, match=option):
        lb.import_campaign(table(tmp_path, line))


@pytest.mark.parametrize(
    ("line", "sign"),
    [
        ("Abweichung positiv bei Einfederung", -1),
        ("positiv = Einfederung", -1),
        ("Ausfederung ist positiv", 1),
        ("Winkel gemessen um 9 Uhr", 1),
        ("Gauge signal inverted: no", 1),
        ("Encoder signal inverted", 1),
        ("Z axis inverted", 1),
        ("Y axis reversal spikes: 2 um", 1),
        ("Gain: 1.0", 1),
        ("Servo gain 10", 1),
        ("Position loop gain: 33", 1),
    ],
)
def test_what_counts_as_positive_is_understood(line: str, sign: int, tmp_path: Path) -> None:
    assert_read_as_true(table(tmp_path, line, sign=sign))


@pytest.mark.parametrize(
    "line", ["Effort : 100 N", "Effort;100;N", "% force_setpoint = 100 N", "Kraft_soll = 100 N"]
)
def test_a_load_has_its_word_in_french_or_with_an_underscore(line: str, tmp_path: Path) -> None:
    (test,) = lb.import_campaign(table(tmp_path, line, name="a")).campaign.tests
    assert test.force_N == 100.0


@pytest.mark.parametrize("line", ["Load: 10 kg", "Force = 100000 mN", "Kraft: 1.100,0 N"])
def test_a_load_that_cannot_be_read_is_shown(line: str, tmp_path: Path) -> None:
    with pytest.raises(lb.InputError) as refusal:
        lb.import_campaign(table(tmp_path, line, name="a"))
    assert f"(is {line!r} in line 1 the load?). Give --forces-N" in str(refusal.value)


@pytest.mark.parametrize("line", ["Preload: 100 kg", "Max. force: 600 kg", "Air pressure: 6 at"])
def test_another_load_is_not_asked_for(line: str, tmp_path: Path) -> None:
    with pytest.raises(lb.InputError) as refusal:
        lb.import_campaign(table(tmp_path, line, name="a"))
    assert "the load?" not in str(refusal.value)


@pytest.mark.parametrize("label", ["Circularity", "Rundheit", "Kreisformabweichung"])
def test_a_row_of_circularity_ends_a_table(label: str, tmp_path: Path) -> None:
    path = table(tmp_path, "Direction: CCW")
    first = path.read_text(encoding="utf-8") + f"Min;-5.1\nMax;5.2\n{label};10.3\n\n"
    second = first.split(f"{label};10.3")[0].replace("CCW", "CW")
    path.write_text(f"{first}{second}{label};10.3\n", encoding="utf-8")
    tests = lb.import_campaign(path).campaign.tests
    assert [(test.direction, len(test.angle_deg)) for test in tests] == [("CCW", 36), ("CW", 36)]


def table_headed(folder: Path, header: str) -> Path:
    """Write a circle with a header of its readings."""
    path = table(folder, "Direction: CCW")
    lines = path.read_text(encoding="utf-8").splitlines()
    row = next(k for k, line in enumerate(lines) if line.startswith("Angle"))
    lines[row] = f"{lines[row].split(';')[0]};{header}"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize("header", ["Pénétration [µm]", "Eindringtiefe [µm]", "Indentation [um]"])
def test_a_penetration_may_be_a_shorter_bar(header: str, tmp_path: Path) -> None:
    path = table_headed(tmp_path, header)
    with pytest.raises(lb.InputError, match="--sign"):
        lb.import_campaign(path)


@pytest.mark.parametrize(
    "header", ["Reading *1e3 [mm]", "Reading ×10³ [mm]", "Reading 1e3* [mm]", "Reading x1E-3 [mm]"]
)
def test_a_power_of_ten_in_a_header_is_not_dropped(header: str, tmp_path: Path) -> None:
    path = table_headed(tmp_path, header)
    with pytest.raises(lb.InputError, match="--unit"):
        lb.import_campaign(path)
