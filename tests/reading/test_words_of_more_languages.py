"""Direction, plane, load and start time in words of further languages."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb


def table(folder: Path, lines: str, name: str = "100N") -> Path:
    rows = [f"{10 * k};{(7 * k) % 11}.25" for k in range(36)]
    path = folder / f"{name}.csv"
    text = "\n".join([lines, "Angle [deg];Reading [um]", *rows, ""])
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("line", "direction"),
    [
        ("Draairichting: rechtsom", "CW"),
        ("Richting: linksom", "CCW"),
        ("Yön: saat yönünde", "CW"),
        ("Yön: saat yönünün tersine", "CCW"),
        ("Verso: orario", "CW"),
        ("Verso di percorrenza: antiorario", "CCW"),
        ("Směr: ve směru hodinových ručiček", "CW"),
        ("Rotationsriktning: moturs", "CCW"),
        ("방향: 시계방향", "CW"),
        ("회전 방향: 반시계방향", "CCW"),
    ],
)
def test_directions(line: str, direction: str, tmp_path: Path) -> None:
    (test,) = lb.import_campaign(table(tmp_path, line)).campaign.tests
    assert test.direction == direction


@pytest.mark.parametrize("word", ["Vlak", "Düzlem", "Płaszczyzna", "Rovina", "Плоскость"])
def test_the_word_for_plane_is_read(word: str, tmp_path: Path) -> None:
    (test,) = lb.import_campaign(table(tmp_path, f"{word}: ZX")).campaign.tests
    assert test.plane == "ZX"


def test_force_in_korean(tmp_path: Path) -> None:
    (test,) = lb.import_campaign(table(tmp_path, "힘: 150 N", name="a")).campaign.tests
    assert test.force_N == 150.0


@pytest.mark.parametrize(
    "line", ["Beginn: 1{k}.30 Uhr", "Heure de début: 1{k}h30", "Date: 20/11/2026 1{k}h30"]
)
def test_start_times(line: str, tmp_path: Path) -> None:
    paths = [table(tmp_path, line.format(k=k), name=f"{k + 1}00N") for k in range(3)]
    tests = lb.import_campaign(paths).campaign.tests
    assert [test.time_s for test in tests] == [0.0, 3600.0, 7200.0]


@pytest.mark.parametrize(
    ("header", "clockwise", "counter"),
    [
        ("Yön", "saat yönünde", "saat yönünün tersine"),
        ("Draairichting", "rechtsom", "linksom"),
        ("Направление", "по часовой", "против часовой"),
        ("方向", "顺时针", "逆时针"),
        ("방향", "시계방향", "반시계방향"),
        ("Sentido", "horario", "antihorario"),
        ("Drehsinn", "↻", "↺"),
    ],
)
def test_columns_of_directions(header: str, clockwise: str, counter: str, tmp_path: Path) -> None:
    rows = [f"{header};Force [N];Angle [deg];Reading [um]"]
    for force_N in (100, 300):
        for word in (clockwise, counter):
            rows += [f"{word};{force_N};{10 * k};{(7 * k) % 11}.25" for k in range(36)]
    path = tmp_path / "all.csv"
    path.write_text("\n".join([*rows, ""]), encoding="utf-8")
    tests = lb.import_campaign(path).campaign.tests
    found = [(test.force_N, test.direction) for test in tests]
    assert found == [(100, "CW"), (100, "CCW"), (300, "CW"), (300, "CCW")]


@pytest.mark.parametrize(
    "line",
    ["Inrichting: links", "Berichting: rechtsom", "Kompassriktning: medurs", "Einrichtung: rechts"],
)
def test_other_words_that_end_like_a_direction_state_none(line: str, tmp_path: Path) -> None:
    assert lb.import_campaign(table(tmp_path, line)).campaign.tests[0].direction is None


@pytest.mark.parametrize("unit", ["kgf/cm2", "kp/cm²", "kg/cm2"])
def test_a_pressure_in_kilograms_per_square_centimetre(unit: str, tmp_path: Path) -> None:
    in_line = table(tmp_path, f"Pressure: 2 {unit}", name="line")
    rows = [f"{10 * k};{(7 * k) % 11}.25;2" for k in range(36)]
    in_column = tmp_path / "column.csv"
    in_column.write_text("\n".join([f"Angle [deg];Reading [um];Pressure [{unit}]", *rows, ""]))
    for path in (in_line, in_column):
        test = lb.import_campaign(path).campaign.tests[0]
        assert test.pressure_bar == pytest.approx(1.96133)


@pytest.mark.parametrize("unit", ["Neugrad", "grades", "gradi centesimali"])
def test_words_for_gon(unit: str, tmp_path: Path) -> None:
    rows = [f"{10 * k};{(7 * k) % 11}.25" for k in range(40)]
    path = tmp_path / "300N.csv"
    path.write_text("\n".join([f"Angle [{unit}];Reading [um]", *rows, ""]))
    test = lb.import_campaign(path).campaign.tests[0]
    assert test.angle_deg[10] == pytest.approx(90.0)


@pytest.mark.parametrize("unit", ["micrômetros", "mikrometre"])
def test_words_for_micrometre(unit: str, tmp_path: Path) -> None:
    rows = [f"{10 * k};{(7 * k) % 11}.25" for k in range(36)]
    path = tmp_path / "300N.csv"
    text = "\n".join([f"Angle [deg];Odchylenie [{unit}]", *rows, ""])
    path.write_text(text, encoding="utf-8")
    assert lb.import_campaign(path).campaign.tests[0].reading_um[1] == pytest.approx(7.25)


@pytest.mark.parametrize("label", ["平面", "평면", "площина", "sík"])
def test_words_for_plane(label: str, tmp_path: Path) -> None:
    assert lb.import_campaign(table(tmp_path, f"{label}: ZX")).campaign.plane == "ZX"
