"""Variables that Octave saves as text: vectors are columns, numbers and strings speak for them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb

ANGLES = np.arange(0.0, 360.0, 5.0)
READINGS = np.round(np.cos(np.deg2rad(2.0 * ANGLES)), 3)
FORCE = "# name: force_N\n# type: scalar\n36\n\n\n"


def matrix(name: str, rows: np.ndarray) -> str:
    lines = [f"# name: {name}", "# type: matrix", f"# rows: {len(rows)}"]
    lines.append(f"# columns: {len(rows[0])}")
    lines += [" " + " ".join(f"{number:g}" for number in row) for row in rows]
    return "\n".join([*lines, "", "", ""])


def imported(folder: Path, *variables: str) -> lb.Campaign:
    path = folder / "run.txt"
    path.write_text(
        "# Created by Octave 8.4.0, Mon Mar 02 14:11:07 2026 CET\n" + "".join(variables)
    )
    return lb.import_campaign(path).campaign


def test_vectors_are_the_columns_of_a_table(tmp_path: Path) -> None:
    angles = matrix("angle_deg", ANGLES[:, None])
    campaign = imported(tmp_path, FORCE, angles, matrix("reading_um", READINGS[:, None]))
    np.testing.assert_allclose(campaign.tests[0].reading_um, READINGS)


def test_vectors_in_one_row_are_columns_too(tmp_path: Path) -> None:
    angles = matrix("angle_deg", ANGLES[None, :])
    campaign = imported(tmp_path, angles, matrix("reading_um", READINGS[None, :]), FORCE)
    assert campaign.tests[0].force_N == 36.0


def test_each_matrix_is_a_test_of_its_name(tmp_path: Path) -> None:
    rows = np.column_stack([ANGLES, READINGS])
    campaign = imported(tmp_path, matrix("run_36N", rows), matrix("run_490N", rows))
    assert [test.force_N for test in campaign.tests] == [36.0, 490.0]


def test_vectors_of_different_lengths_are_refused(tmp_path: Path) -> None:
    angles = matrix("angle_deg", ANGLES[:, None])
    with pytest.raises(lb.InputError, match="got different lengths of 'angle_deg', 'reading_um'"):
        imported(tmp_path, FORCE, angles, matrix("reading_um", READINGS[1:, None]))
