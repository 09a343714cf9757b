"""Tables in which each circle has a row instead of a column."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.layout import Layout

ANGLES = list(range(0, 360, 10))


def row(label: str, force_N: float) -> str:
    """Return the row of a circle: its label, and readings [µm] that depend on its force."""
    readings = 0.03 * force_N + 2.0 * np.cos(np.deg2rad(2.0 * np.array(ANGLES)))
    return ";".join([label, *(f"{reading:.3f}" for reading in readings)])


def imported(folder: Path, lines: list[str]) -> lb.Imported:
    """Return what is imported from a file with these lines."""
    path = folder / "all.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return lb.import_campaign([path])


ROW_OF_ANGLES = ";".join(["Angle [deg]", *map(str, ANGLES)])


def test_rows_that_begin_with_loads_are_read_as_columns(tmp_path: Path) -> None:
    tests = imported(
        tmp_path, ["Unit: um", ROW_OF_ANGLES, row("36 N", 36.0), row("122 N", 122.0)]
    ).campaign.tests
    assert [test.force_N for test in tests] == [36.0, 122.0]
    np.testing.assert_allclose(tests[1].angle_deg, ANGLES)
    assert tests[1].reading_um[0] == pytest.approx(0.03 * 122.0 + 2.0)


def test_a_turned_table_is_told_with_the_line_of_its_angles(tmp_path: Path) -> None:
    rows = [row("F = 36 N", 36.0), row("F = 122 N", 122.0)]
    notes = imported(tmp_path, ["Unit: um", ROW_OF_ANGLES, *rows]).assumptions
    (told,) = [note for note in notes if note.what == "table on its side"]
    assert "line 2 holds the angles" in told.because


def test_units_behind_the_readings_of_a_row_are_used(tmp_path: Path) -> None:
    rows = []
    for label, force_N in (("36 N", 36.0), ("122 N", 122.0)):
        rows.append(row(label, force_N).replace(";", " mm;").replace("N mm;", "N;") + " mm")
    tests = imported(tmp_path, [ROW_OF_ANGLES, *rows]).campaign.tests
    assert tests[0].reading_um[0] == pytest.approx(1e3 * (0.03 * 36.0 + 2.0))


def test_rows_without_loads_are_refused_with_the_step(tmp_path: Path) -> None:
    lines = ["Force: 36 N", ROW_OF_ANGLES, row("first", 36.0), row("second", 36.0)]
    with pytest.raises(InputError, match=r"Transpose the table: the angles in a column 'Angle"):
        imported(tmp_path, lines)


def test_columns_named_by_evenly_spaced_loads_are_no_angles(tmp_path: Path) -> None:
    forces = range(20, 380, 20)
    lines = [";".join(["Angle [deg]", *map(str, forces)])]
    for angle in ANGLES:
        readings = [f"{0.03 * force_N + np.cos(np.deg2rad(angle)):.3f}" for force_N in forces]
        lines.append(";".join([str(angle), *readings]))
    path = tmp_path / "all.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    layout = Layout(forces_N=list(forces), reading_unit="um")
    assert len(lb.import_campaign([path], layout=layout).campaign.tests) == len(forces)


def test_a_matrix_of_sums_of_angles_is_refused_with_the_step(tmp_path: Path) -> None:
    lines = ["Force: 36 N", ";".join(["", *map(str, range(10))])]
    for first in range(0, 360, 10):
        lines.append(";".join([str(first), *(f"{0.1 * (first % 70 + k):.2f}" for k in range(10))]))
    step = r"got a matrix in which they are sums such as 10 \+ 1\. Write the angle and the reading"
    with pytest.raises(InputError, match=step):
        imported(tmp_path, lines)
