"""Words that turn a word for clockwise into its opposite, or leave open which sense is meant."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.travel_direction import direction_named, directions_stated, senses_in

OPPOSED = [
    "gegenläufig zum Uhrzeigersinn",
    "entgegengesetzt zum Uhrzeigersinn",
    "entgegen d. Uhrzeigersinn",
    "gg. UZS",
    "opposite to clockwise",
    "against the clockwise direction",
    "anti-CW",
    "contre le sens horaire",
    "sens contraire au sens des aiguilles d'une montre",
    "sens inverse du sens des aiguilles d'une montre",
    "contro il senso orario",
    "contrario al sentido horario",
    "oposto ao sentido horário",
    "逆時計回り",
    "時計回りと逆",
    "反顺时针",
    "顺时针反向",
    "시계방향의 반대",
]


def circle(folder: Path, line: str) -> Path:
    """Write a circle with a line above its table."""
    lines = [line, "Angle [deg];Reading [um]"]
    for angle_deg in range(0, 360, 10):
        lines.append(f"{angle_deg};{5.0 * np.sin(np.deg2rad(angle_deg)):.3f}")
    path = folder / "100N.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize("words", OPPOSED)
def test_the_opposite_of_clockwise_is_counter_clockwise(words: str) -> None:
    assert senses_in(words) == {"CCW"}


@pytest.mark.parametrize(
    ("words", "sense"),
    [
        ("gegen den Uhrzeigersinn", "CCW"),
        ("im Uhrzeigersinn", "CW"),
        ("sens anti-trigonométrique", "CW"),
        ("math. neg.", "CW"),
        ("mathematisch positiver Drehsinn", "CCW"),
        ("по ходу часовой стрелки", "CW"),
        ("против хода часовой стрелки", "CCW"),
        ("v smere hodinových ručičiek", "CW"),
        ("proti smere hodinových ručičiek", "CCW"),
        ("反時計方向", "CCW"),
        ("36N-CW", "CW"),
        ("36 N -CW", "CW"),
        ("clockwise, reversed at 360", "CW"),
    ],
)
def test_other_words_keep_their_sense(words: str, sense: str) -> None:
    assert senses_in(words) == {sense}


@pytest.mark.parametrize(
    "words",
    [
        "reversed clockwise",
        "CW (inverted)",
        "CW reversed",
        "-CW",
        "c-cw",
        "not CW",
        "other than clockwise",
        "umgekehrter Uhrzeigersinn",
        "非顺时针",
        "CW against CCW",
        "CCW gegen CW",
        "force against CW",
        "im UZS gegen den UZS",
        "never CW",
        "no CCW",
    ],
)
def test_words_that_leave_the_sense_open_name_both(words: str) -> None:
    assert senses_in(words) == {"CW", "CCW"}


@pytest.mark.parametrize(
    ("cell", "direction"),
    [
        ("horário", "CW"),
        ("anti-horário", "CCW"),
        ("trigo", "CCW"),
        ("по часовой стрелке", "CW"),
        ("против часовой стрелки", "CCW"),
        ("po směru hodin", "CW"),
        ("proti směru hodin", "CCW"),
        ("saat yönü", "CW"),
        ("ACW", "CCW"),
        ("w prawo", "CW"),
        ("w lewo", "CCW"),
        ("doprava", "CW"),
        ("vlevo", "CCW"),
        ("höger", "CW"),
        ("venstre", "CCW"),
        ("motsols", "CCW"),
        ("右回り", "CW"),
        ("⟲", "CCW"),
        ("saat yönünün tersi", "CCW"),
    ],
)
def test_cells_of_a_column_of_directions(cell: str, direction: str) -> None:
    assert direction_named(cell) == direction


def test_a_direction_against_the_clock_hand_is_read(tmp_path: Path) -> None:
    path = circle(tmp_path, "Drehrichtung: entgegengesetzt zum Uhrzeigersinn")
    assert lb.import_campaign(path).campaign.tests[0].direction == "CCW"


def test_angles_opposite_to_clockwise_are_not_mirrored(tmp_path: Path) -> None:
    path = circle(tmp_path, "Angle measured opposite to clockwise from +X")
    assert lb.import_campaign(path).campaign.tests[0].angle_deg[1] == pytest.approx(10.0)


@pytest.mark.parametrize(
    "line",
    ["12 o'clock = 0 deg, clockwise", "North = 0°, clockwise", "Top = 0 deg, CW"],
)
def test_a_zero_that_is_no_axis_is_asked_for(line: str, tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match="--angle-zero"):
        lb.import_campaign(circle(tmp_path, line))


def test_an_encoder_that_counts_to_the_right_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match="--angle-sense"):
        lb.import_campaign(circle(tmp_path, "Drehgeber zählt rechts herum positiv"))


@pytest.mark.parametrize("header", ["Angle (neg.) [deg]", "Winkel neg [°]"])
def test_negative_angles_are_asked_for(header: str, tmp_path: Path) -> None:
    path = circle(tmp_path, "")
    text = path.read_text(encoding="utf-8").replace("Angle [deg]", header)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(lb.InputError, match="--angle-sense"):
        lb.import_campaign(path)


@pytest.mark.parametrize(
    ("line", "senses"),
    [
        ("Direction: inverse of clockwise", {"CCW"}),
        ("Direction: reverse of counter-clockwise", {"CW"}),
        ("Direction: CW; spindle CCW", {"CW", "CCW"}),
        ("Direction (CW/CCW): CCW", {"CCW"}),
    ],
)
def test_senses_in_lines_about_the_direction(line: str, senses: set[str]) -> None:
    assert directions_stated([(1, line)]) == senses


@pytest.mark.parametrize(
    ("clockwise", "counter"),
    [
        ("rechts [um]", "links [um]"),
        ("right", "left"),
        ("Rechtslauf [um]", "Linkslauf [um]"),
        ("C.W. [um]", "C.C.W. [um]"),
        ("w prawo [um]", "w lewo [um]"),
        ("po směru [um]", "proti směru [um]"),
    ],
)
@pytest.mark.parametrize("stated", [False, True])
def test_columns_of_opposite_sides_are_runs_in_opposite_directions(
    clockwise: str, counter: str, stated: bool, tmp_path: Path
) -> None:
    lines = [f"Angle [deg];{clockwise};{counter}"]
    for angle_deg in range(0, 360, 10):
        wave = 5.0 * np.sin(np.deg2rad(angle_deg))
        lines.append(f"{angle_deg};{10.0 + wave:.3f};{-10.0 + wave:.3f}")
    path = tmp_path / "100N.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    columns: dict[str, int | str | list[int | str]] = {}
    if stated:
        columns["reading"] = [clockwise, counter]
    layout = Layout(columns=columns, reading_unit="um")
    tests = lb.import_campaign(path, layout=layout).campaign.tests
    means = {test.direction: float(np.mean(test.reading_um)) for test in tests}
    assert means == {"CW": pytest.approx(10.0), "CCW": pytest.approx(-10.0)}


@pytest.mark.parametrize(
    ("line", "direction"),
    [
        ("Direction: C.W.", "CW"),
        ("Direction: C.C.W.", "CCW"),
        ("Direction: A.C.W.", "CCW"),
        ("Kierunek ruchu: w prawo", "CW"),
        ("Kierunek: lewy", "CCW"),
        ("Směr pohybu: proti směru", "CCW"),
        ("Směr: vpravo", "CW"),
        ("Kiertosuunta: vasemmalle", "CCW"),
        ("Suunta: myötäpäivään", "CW"),
        ("gemeten met de klok mee", "CW"),
        ("Draaisin: linksom", "CCW"),
        ("Retning: med uret", "CW"),
    ],
)
def test_directions_in_lines_are_read_in_more_languages(
    line: str, direction: str, tmp_path: Path
) -> None:
    assert lb.import_campaign(circle(tmp_path, line)).campaign.tests[0].direction == direction


def test_a_side_without_its_opposite_is_no_direction(tmp_path: Path) -> None:
    path = circle(tmp_path, "a line")
    path.write_text(path.read_text(encoding="utf-8").replace("Reading [um]", "right [um]"))
    layout = Layout(columns={"reading": "right [um]"})
    assert lb.import_campaign(path, layout=layout).campaign.tests[0].direction is None


ROTATIONS = [
    "Path angle [deg]",
    "Rotation angle (deg)",
    "Angle of rotation [deg]",
    "Bahnwinkel [°]",
    "Drehwinkel [°]",
    "回転角 [deg]",
]


@pytest.mark.parametrize("header", ROTATIONS)
def test_rising_angle_of_rotation_on_a_clockwise_circle_is_asked_about(
    header: str, tmp_path: Path
) -> None:
    path = circle(tmp_path, "Direction: CW")
    table = path.read_text(encoding="utf-8").replace("Angle [deg]", header)
    path.write_text(table, encoding="utf-8")
    with pytest.raises(lb.errors.InputError, match=r"travelled angle.* --angle-sense CCW"):
        lb.import_campaign(path)
    kept = lb.import_campaign(path, layout=Layout(angle_sense="CCW")).campaign.tests[0]
    assert kept.angle_deg[9] == 90.0
    path.write_text(table.replace(header, "travelled angle [deg]"), encoding="utf-8")
    along = lb.import_campaign(path).campaign.tests[0]
    assert along.angle_deg[9] == -90.0
    assert along.reading_um[9] == 5.0
