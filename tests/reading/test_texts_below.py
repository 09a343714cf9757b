"""Texts around a table, such as the end of a letter, are no rows; conditions of queries count."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb

ROWS = [f"{5 * k}  {0.1 * k:.2f}" for k in range(72)]


def imported(folder: Path, *below: str) -> lb.reading.Imported:
    path = folder / "100N.txt"
    path.write_text("\n".join(["Angle [deg]  Deviation [um]", *ROWS, "", *below, ""]))
    return lb.import_campaign(path)


@pytest.mark.parametrize(
    "below",
    [
        ("Best regards,", "Jan", "--", "Meetkamer", "Tel. +31 40 123 4567", "KvK 12345678"),
        ("Tel. +31 40 123 4567", "Mob. +31 6 12345678"),
        ("(72 rows)", "Time: 1.234 ms"),
    ],
)
def test_texts_below_are_no_rows(below: tuple[str, ...], tmp_path: Path) -> None:
    assert imported(tmp_path, *below).campaign.readings == 72


def test_texts_below_are_told(tmp_path: Path) -> None:
    notes = imported(tmp_path, "Regards, Jan", "Tel. +31 40 123 4567").assumptions
    assert "'Tel. +31 40 123 4567'" in [note.value for note in notes]


@pytest.mark.parametrize("below", ["360", "360  7.2 broken", "broken  7.2"])
def test_a_broken_row_at_the_end_is_refused(below: str, tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match="line 75"):
        imported(tmp_path, below)


@pytest.mark.parametrize("prompt", ["", "db=> ", "SQL> "])
def test_conditions_of_queries_state_fields(prompt: str, tmp_path: Path) -> None:
    lines = []
    for force in (100, 300):
        condition = f"where force_N = {force} and plane='ZX' order by angle_deg"
        lines.append(f"{prompt}select angle_deg, reading_um from circles {condition};")
        lines += [" angle_deg | reading_um ", "-----+-----"]
        lines += [f" {5 * k} | {0.1 * k:.2f} " for k in range(72)]
        lines.append("(72 rows)")
    path = tmp_path / "psql.txt"
    path.write_text("\n".join([*lines, ""]))
    tests = lb.import_campaign(path).campaign.tests
    assert [(test.force_N, test.plane) for test in tests] == [(100.0, "ZX"), (300.0, "ZX")]
