"""Refusals name headers as the file writes them, and the line of a force that cannot be."""

from __future__ import annotations

from pathlib import Path

import pytest
from campaigns import refuses

import ldbb_bayes as lb
from ldbb_bayes.report.message_translation import in_language


def table(folder: Path, header: str, cells: list[str], above: str = "") -> Path:
    """Circles of 72 angles; every item of ``cells`` holds the other cells of one test."""
    lines = [above, header] if above else [header]
    for of_test in cells:
        lines += [f"{5 * k};{of_test.format(r=f'{k % 7}.25')}" for k in range(72)]
    file = folder / "alle.csv"
    file.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return file


def test_a_missing_column_lists_the_headers_as_typed(tmp_path: Path) -> None:
    file = table(tmp_path, "Winkel [°];Test;Kraft [N];Ebene", ["K1;36;XY"])
    refuses("'Test', 'Kraft .N.', 'Ebene' in line 1", lb.import_campaign, file)


def test_a_negative_force_of_a_column_has_its_line(tmp_path: Path) -> None:
    header = "Winkel [°];Test;Kraft [N];Messwert [µm]"
    file = table(tmp_path, header, ["K1;36;{r}", "K2;-742;{r}"])
    with pytest.raises(lb.InputError) as refusal:
        lb.import_campaign(file)
    message = str(refusal.value)
    assert "test 'K2', line 74: force_N must be greater than 0, got -742 N." in message
    assert "muss größer als 0 sein" in str(in_language(message, "de", ["alle.csv"]))


def test_a_negative_force_above_the_table_has_its_line(tmp_path: Path) -> None:
    file = table(tmp_path, "Winkel [°];Messwert [µm]", ["{r}"], above="Kraft: -36 N")
    refuses("line 1: force_N must be greater than 0, got -36 N", lb.import_campaign, file)


def test_a_plane_that_is_none_is_that_of_its_test() -> None:
    tests = [
        lb.CircularTest(36.0, range(0, 360, 5), name="first"),
        lb.CircularTest(742.0, range(0, 360, 5), name="second", plane="QQ"),
    ]
    with pytest.raises(lb.InputError) as refusal:
        lb.Campaign(tuple(tests))
    message = str(refusal.value)
    assert "plane of test 'second' must be one of XY, YZ, ZX, got 'QQ'" in message
    assert "Ebene" in str(in_language(message, "de"))
