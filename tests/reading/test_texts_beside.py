"""Texts beside a table, or in its unused columns, take part like lines below it."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb


def notes_on(folder: Path, header: str, **cells: str) -> dict[str, str]:
    """Return the notes on a table with further cells, such as ``row_4="+ = bar shorter"``."""
    lines = [header]
    for k in range(72):
        lines.append(f"{5 * k};{k % 7}.25;{cells.get(f'row_{k}', '')}")
    path = folder / "100 N.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    notes = lb.import_campaign(path).assumptions
    return {note.what: f"{note.value} ({note.because})" for note in notes}


@pytest.mark.parametrize("column", ["", "Kommentar", "Remarks", "Remarque"])
@pytest.mark.parametrize(
    ("text", "what", "value"),
    [
        ("Winkel ab +Y im Uhrzeigersinn", "angle", "from +Y, CW"),
        ("positiv = Stab kürzer", "sign of the reading", "-1"),
        ("valeurs au diamètre", "reading", "half of each"),
        ("gefahren im Uhrzeigersinn", "direction", "CW"),
    ],
)
def test_a_text_beside_the_table_is_used(
    column: str, text: str, what: str, value: str, tmp_path: Path
) -> None:
    notes = notes_on(tmp_path, f"angle [deg];reading [um];{column}", row_5=text)
    assert notes[what].startswith(value)
    assert "texts not used" not in notes
    assert "columns not used" not in notes


def test_a_unit_among_the_remarks_is_used(tmp_path: Path) -> None:
    notes = notes_on(tmp_path, "Winkel [°];Abweichung;Bemerkung", row_3="Werte in 0,1 µm")
    assert notes["unit of the reading"] == "0.1 um (line 5, column 'Bemerkung')"


def test_a_header_that_is_a_text_is_used(tmp_path: Path) -> None:
    notes = notes_on(tmp_path, "angle [deg];reading [um];+ means bar shorter than nominal")
    assert notes["sign of the reading"] == "-1: a longer bar is negative (line 1, column 3)"
    assert "columns not used" not in notes


def test_a_remark_that_states_nothing_is_told(tmp_path: Path) -> None:
    header = "angle [deg];reading [um];Remarks"
    notes = notes_on(tmp_path, header, row_9="probe touched again", row_10="ok")
    assert notes["texts not used"] == "'probe touched again' (line 11, column 'Remarks')"
    assert notes["columns not used"] == "Remarks (no role is known for them)"
    assert notes["sign of the reading"].endswith("(no text that is understood says otherwise)")


def test_a_direction_holds_only_for_the_test_of_its_row(tmp_path: Path) -> None:
    lines = ["run;angle [deg];reading [um];remark"]
    for run, remark in (("36 N", "travel clockwise"), ("72 N", "travel counter-clockwise")):
        lines += [f"{run};{5 * k};{k % 7}.25;{'' if k else remark}" for k in range(72)]
    path = tmp_path / "runs.csv"
    path.write_text("\n".join([*lines, ""]))
    tests = lb.import_campaign(path).campaign.tests
    assert [test.direction for test in tests] == ["CW", "CCW"]


@pytest.mark.parametrize(
    ("line", "unit"),
    [
        ("Alle Abweichungen in Zehntel-µm", "0.1 um"),
        ("Abweichungen in 0,1 µm, + = Stab länger.", "0.1 um"),
        ("Messwerte: Zehntel Mikrometer", "0.1 um"),
        ("Scostamenti in centesimi di millimetro (+ = barra più lunga).", "0.01 mm"),
        ("Écarts en 1/100 mm", "0.01 mm"),
    ],
)
@pytest.mark.parametrize("is_below", [False, True])
def test_a_sentence_around_the_table_states_the_unit(
    line: str, unit: str, is_below: bool, tmp_path: Path
) -> None:
    table = ["angle [deg];reading", *(f"{5 * k};{k % 7}.25" for k in range(72))]
    lines = [*table, "", line] if is_below else [line, "", *table]
    path = tmp_path / "100 N.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    notes = {note.what: note.value for note in lb.import_campaign(path).assumptions}
    assert notes["unit of the reading"] == unit


def test_a_share_in_the_header_is_asked(tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match=r"Error, millionths.*--unit"):
        notes_on(tmp_path, "angle [deg];Error, millionths;")
