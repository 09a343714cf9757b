"""German words in tables: headers of the column that names the test, and directions of travel."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb
from ldbb_bayes.report.message_translation import in_language


def table(folder: Path, header: str, row: str) -> Path:
    """Two circles of 72 readings; {test} is its number, {force} 36 or 742."""
    lines = [header]
    for test, force in ((1, 36), (2, 742)):
        for k in range(72):
            lines.append(row.format(test=test, force=force) + f";{5 * k};{k % 7},25")
    file = folder / "alle.csv"
    file.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return file


@pytest.mark.parametrize("header", ["Prüfkreis", "Prüfkreis Nr.", "Messkreis", "Test"])
def test_the_column_that_names_the_tests(header: str, tmp_path: Path) -> None:
    file = table(tmp_path, f"{header};Kraft [N];Winkel [°];Messwert [µm]", "K{test};{force}")
    tests = lb.import_campaign(file).campaign.tests
    assert [(test.name, test.force_N) for test in tests] == [("K1", 36.0), ("K2", 742.0)]


def test_a_column_of_measurements_may_number_the_rows(tmp_path: Path) -> None:
    """ "Messung" may be one reading or one circle: it names no test unless the user says so."""
    lines = ["Messung;Winkel [°];Messwert [µm]", *(f"{k};{5 * k};{k % 7},25" for k in range(72))]
    file = tmp_path / "36N.csv"
    file.write_text("\n".join([*lines, ""]), encoding="utf-8")
    (test,) = lb.import_campaign(file).campaign.tests
    assert len(test.angle_deg) == 72


@pytest.mark.parametrize(
    ("word", "direction"),
    [
        ("Uhrzeigersinn", "CW"),
        ("im UZS", "CW"),
        ("mit dem Uhrzeigersinn", "CW"),
        ("gegen den UZS", "CCW"),
        ("gegen UZS", "CCW"),
        ("entgegen dem Uhrzeigersinn", "CCW"),
    ],
)
def test_directions(word: str, direction: str, tmp_path: Path) -> None:
    header = "Test;Kraft [N];Richtung;Winkel [°];Messwert [µm]"
    file = table(tmp_path, header, f"K{{test}};{{force}};{word}")
    assert {test.direction for test in lb.import_campaign(file).campaign.tests} == {direction}


def test_an_unknown_direction_is_refused_as_it_was_typed(tmp_path: Path) -> None:
    header = "Test;Kraft [N];Richtung;Winkel [°];Messwert [µm]"
    file = table(tmp_path, header, "K{test};{force};nach Westen")
    with pytest.raises(lb.InputError) as refusal:
        lb.import_campaign(file)
    message = str(refusal.value)
    assert "got 'nach Westen'. Write CW or CCW into the column" in message
    for known in ("counter-clockwise", "gegen den Uhrzeigersinn", "GUZS"):
        assert known in message
    assert "Gelesen werden auch" in str(in_language(message, "de"))
