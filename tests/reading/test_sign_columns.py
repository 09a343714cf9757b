"""Columns with the signs of readings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

import ldbb_bayes as lb


def written(folder: Path, header: str, rows: Sequence[str]) -> Path:
    path = folder / "100N.csv"
    path.write_text("\n".join([header, *rows, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize(("header", "minus"), [("Sign", "-"), ("VZ", "−"), ("Vorzeichen", "-1")])
def test_signs_in_a_column_are_refused(header: str, minus: str, tmp_path: Path) -> None:
    rows = [f"{10 * k};{minus if k % 4 == 3 else '+'};{k % 7}.25" for k in range(36)]
    path = written(tmp_path, f"Angle [deg];{header};Reading [um]", rows)
    with pytest.raises(lb.InputError, match="line 5: readings must have their sign"):
        lb.import_campaign(path)


def test_signs_beside_signed_readings_change_nothing(tmp_path: Path) -> None:
    rows = [f"{10 * k};{'-' if k % 4 == 3 else '+'};{'-' * (k % 4 == 3)}2.25" for k in range(36)]
    path = written(tmp_path, "Angle [deg];Sign;Reading [um]", rows)
    reading_um = lb.import_campaign(path).campaign.tests[0].reading_um
    assert reading_um[2:5].tolist() == [2.25, -2.25, 2.25]
