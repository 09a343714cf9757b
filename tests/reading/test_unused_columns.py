"""Columns that are not used are told, and columns in use are not among them."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import Layout


def unused(folder: Path, second_start: int) -> list[str]:
    """Return the unused columns of two pairs; the angles of the second pair start elsewhere."""
    lines = ["Ángulo (°);300 N (µm);Ángulo (°);600 N (µm)"]
    lines += [f"{a};{a % 7};{(a + second_start) % 360};{a % 9}" for a in range(0, 360, 5)]
    path = folder / "a.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    layout = Layout(columns={"angle": 1, "reading": 2})
    notes = lb.import_campaign(path, layout=layout).assumptions
    return [note.value for note in notes if note.what == "columns not used"]


@pytest.mark.parametrize(
    ("start", "told"), [(0, ["600 N (µm)"]), (90, ["Ángulo (°) (column 3), 600 N (µm)"])]
)
def test_a_column_that_repeats_a_used_one_is_told_if_it_differs(
    start: int, told: list[str], tmp_path: Path
) -> None:
    assert unused(tmp_path, start) == told
