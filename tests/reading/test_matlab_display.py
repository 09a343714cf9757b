"""Diaries of MATLAB: factors are applied to all columns and told, each matrix is a test."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb

ANGLES = np.deg2rad(np.arange(0.0, 360.0, 5.0))
READINGS = np.cos(2.0 * ANGLES)
ROWS = [f"   {a / 1e2:.9f}   {r / 1e2:.9f}" for a, r in zip(ANGLES, READINGS, strict=True)]
SHOW = ">> data   % theta [rad], reading [um]"


def matrix(force: int, direction: str) -> list[str]:
    command = f">> F = {force}; dir = '{direction}';  % N"
    return [command, SHOW, "", "data =", "", "   1.0e+02 *", "", *ROWS, ""]


def imported(folder: Path, lines: list[str]) -> lb.reading.Imported:
    file = folder / "diary.txt"
    file.write_text("\n".join(lines))
    return lb.import_campaign(file)


def test_the_factor_holds_for_all_columns(tmp_path: Path) -> None:
    test = imported(tmp_path, matrix(36, "CW")).campaign.tests[0]
    np.testing.assert_allclose(test.angle_deg, np.rad2deg(ANGLES), atol=1e-5)
    np.testing.assert_allclose(test.reading_um, READINGS, atol=1e-6)


def test_the_factor_is_told(tmp_path: Path) -> None:
    notes = imported(tmp_path, matrix(36, "CW")).assumptions
    factors = [(note.value, note.because) for note in notes if note.what == "factor"]
    assert factors == [("100 in all columns", "line 6 says '1.0e+02 *'")]


def test_commands_between_matrices_separate_tests(tmp_path: Path) -> None:
    tests = imported(tmp_path, [*matrix(36, "CW"), *matrix(490, "CCW")]).campaign.tests
    loads = [(test.force_N, test.direction) for test in tests]
    assert loads == [(36.0, "CW"), (490.0, "CCW")]


def test_a_factor_of_another_variable_is_not_applied(tmp_path: Path) -> None:
    plain = [f"   {a:.9f}   {r:.9f}" for a, r in zip(ANGLES, READINGS, strict=True)]
    other = [">> x", "", "x =", "", "   1.0e+03 *", "", "   1.2   3.4", ""]
    lines = [">> F = 36;  % N", *other, SHOW, "", "data =", "", *plain]
    test = imported(tmp_path, lines).campaign.tests[0]
    np.testing.assert_allclose(test.reading_um, READINGS, atol=1e-6)


def test_a_missing_number_below_a_factor_stays_missing(tmp_path: Path) -> None:
    lines = matrix(36, "CW")
    lines[9] = f"   {ANGLES[2] / 1e2:.9f}   NaN"
    assert imported(tmp_path, lines).campaign.readings == len(ANGLES) - 1


def test_a_matrix_in_parts_is_refused(tmp_path: Path) -> None:
    lines = matrix(36, "CW")
    lines.insert(4, "  Columns 1 through 2")
    with pytest.raises(lb.InputError, match="line 5: a matrix must be shown with all its columns"):
        imported(tmp_path, lines)


def test_a_factor_above_few_rows_is_named(tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match=r"line 6: a factor .* got '1\.0e\+02 \*' above fewer"):
        imported(tmp_path, matrix(36, "CW")[:12])


def test_a_decimal_comma_below_a_factor_is_refused(tmp_path: Path) -> None:
    lines = [line.replace("0.0", "0,0") for line in matrix(36, "CW")]
    with pytest.raises(lb.InputError, match=r"below the factor 1\.0e\+02 in line 6"):
        imported(tmp_path, lines)
