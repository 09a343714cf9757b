"""Numbers with the minus sign behind them, and numbers in Arabic digits."""

from __future__ import annotations

from pathlib import Path

import ldbb_bayes as lb

READINGS_UM = [round(1.5 - 0.1 * k, 2) for k in range(72)]
TO_ARABIC = str.maketrans("0123456789.", "٠١٢٣٤٥٦٧٨٩٫")


def imported(folder: Path, cells: list[str]) -> list[float]:
    """Return the readings of a circle of these cells."""
    path = folder / "36 N.csv"
    rows = [f"{5 * k};{cell}" for k, cell in enumerate(cells)]
    path.write_text("\n".join(["Angle [deg];Deviation [um]", *rows]), encoding="utf-8")
    return [float(value) for value in lb.import_campaign(path).campaign.tests[0].reading_um]


def test_a_minus_behind_a_number_counts(tmp_path: Path) -> None:
    cells = [f"{abs(value):.2f}{'-' if value < 0 else ''}" for value in READINGS_UM]
    assert imported(tmp_path, cells) == READINGS_UM
    assert imported(tmp_path, [cell.replace(".", ",") for cell in cells]) == READINGS_UM


def test_arabic_digits_are_read(tmp_path: Path) -> None:
    cells = [f"{value:.2f}".translate(TO_ARABIC) for value in READINGS_UM]
    assert imported(tmp_path, cells) == READINGS_UM
