"""Notes on unused texts quote them as they stand, and name no text from which a value was taken."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb

TABLE = "\n".join(f"{angle}\t{angle % 7}" for angle in range(0, 360, 5))
HEADER = "Angle [deg]\tDeviation [um]"
UNUSED = {
    "Deviation = command radius - gauge radius": ["Deviation = command radius - gauge radius"],
    "Deviation = 2 x (R measured - R nominal)": ["Deviation = 2 x (R measured - R nominal)"],
    "Deviation = command radius - feedback radius": [],
    "Travel\tCCW": [],
    "Encoder\t7200 pulses/rev, counts up counter-clockwise from +X": [],
    "Sign:\tbar longer is positive": [],
}
READ = {
    "Угол отсчитывается от оси +Y против часовой стрелки": ("angle", "from +Y, CCW"),
    "Ângulo contado a partir do eixo +Y, no sentido horário": ("angle", "from +Y, CW"),
    "Encoder\t7200 pulses/rev, counts up clockwise from +X": ("angle", "from +X, CW"),
    "Força radial aplicada: 36 N": ("force_N", "36 N"),
    "Sentido do movimento: horário": ("direction", "CW"),
    "Kierunek: przeciwnie do ruchu wskazówek zegara": ("direction", "CCW"),
    "Dönüş yönü: saat yönünün tersi": ("direction", "CCW"),
    "Отклонение = Rном - Rизм": ("sign of the reading", "-1: a longer bar is negative"),
    "편차: 공칭-측정": ("sign of the reading", "-1: a longer bar is negative"),
}


def notes(folder: Path, name: str, line: str) -> list[lb.reading.Assumption]:
    file = folder / name
    file.write_text(f"{line}\n{HEADER}\n{TABLE}\n", encoding="utf-8")
    return list(lb.import_campaign(file).assumptions)


@pytest.mark.parametrize("line", UNUSED)
def test_an_unused_text_is_quoted_as_it_stands(line: str, tmp_path: Path) -> None:
    noted = notes(tmp_path, "300N.txt", line)
    assert [note.value for note in noted if note.what == "texts not used"] == [
        repr(text) for text in UNUSED[line]
    ]


@pytest.mark.parametrize("line", READ)
def test_a_line_in_another_language_is_read(line: str, tmp_path: Path) -> None:
    name = "run.txt" if READ[line][0] == "force_N" else "300N.txt"
    noted = notes(tmp_path, name, line)
    assert READ[line] in [(note.what, note.value) for note in noted]


def test_a_text_that_is_not_understood_leaves_all_conventions_open(tmp_path: Path) -> None:
    noted = notes(tmp_path, "300N.txt", "Deviation: + = material left on a contour")
    assert not [note for note in noted if note.because == "nothing says otherwise"]
