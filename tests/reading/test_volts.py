"""Readings in volts: a line with their size is quoted, and gives the step."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb


@pytest.mark.parametrize(
    ("line", "step"),
    [
        ("1 V = 10 µm", "give --unit '10 um'"),
        ("Sensitivity: 0,01 mm/V", "give --unit '0.01 mm'"),
        ("1 mV = 10 µm", "Correct the header, or give --unit"),
    ],
)
def test_a_line_with_the_size_of_a_volt_gives_the_step(
    line: str, step: str, tmp_path: Path
) -> None:
    rows = [f"{5 * k},{0.1 * k:.2f}" for k in range(72)]
    path = tmp_path / "100N.csv"
    path.write_text("\n".join([line, "Angle [deg],Reading [V]", *rows, ""]), encoding="utf-8")
    with pytest.raises(lb.InputError, match=step):
        lb.import_campaign(path)
