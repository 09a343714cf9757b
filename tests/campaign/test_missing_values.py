"""Masked readings and angles, and pandas' NA, are left out of a circular test; NaN is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest
from campaigns import refuses

import ldbb_bayes as lb

ANGLES = np.arange(0.0, 360.0, 10.0)
READINGS = 3.0 * np.cos(np.deg2rad(2.0 * ANGLES))
MISSING = np.isin(np.arange(36), (3, 17))


def masked(column: np.ndarray) -> np.ma.MaskedArray:
    return np.ma.MaskedArray(np.where(MISSING, 9999.0, column), mask=MISSING)


def with_na(column: np.ndarray) -> pd.Series:
    return pd.Series(column).astype("Float64").mask(MISSING)


def list_with_na(column: np.ndarray) -> list[Any]:
    return [pd.NA if is_missing else x for x, is_missing in zip(column, MISSING, strict=True)]


@pytest.mark.parametrize("missing_in", [masked, with_na, list_with_na])
def test_missing_readings_are_left_out_with_their_angles(missing_in: Any) -> None:
    test = lb.CircularTest(500.0, ANGLES, missing_in(READINGS))
    np.testing.assert_array_equal(test.angle_deg, ANGLES[~MISSING])
    np.testing.assert_array_equal(test.reading_um, READINGS[~MISSING])


@pytest.mark.parametrize("missing_in", [masked, with_na, list_with_na])
def test_missing_angles_are_left_out_with_their_readings(missing_in: Any) -> None:
    test = lb.CircularTest(500.0, angle_rad=missing_in(np.deg2rad(ANGLES)), reading_mm=READINGS)
    np.testing.assert_allclose(test.angle_deg, ANGLES[~MISSING], rtol=1e-14)
    np.testing.assert_allclose(test.reading_um, 1e3 * READINGS[~MISSING], rtol=1e-14)


def test_masks_of_both_columns_add_up() -> None:
    other = np.ma.MaskedArray(ANGLES, mask=np.arange(36) == 0)
    test = lb.CircularTest(500.0, other, masked(READINGS))
    assert len(test.angle_deg) == len(test.reading_um) == 33


def test_nothing_masked_changes_nothing() -> None:
    test = lb.CircularTest(500.0, np.ma.MaskedArray(ANGLES), np.ma.MaskedArray(READINGS))
    np.testing.assert_array_equal(test.reading_um, READINGS)


def test_a_nan_is_no_missing_value() -> None:
    readings = np.where(MISSING, np.nan, READINGS)
    refuses(
        "must have finite reading_um, got nan at reading 4",
        lb.CircularTest,
        500.0,
        ANGLES,
        readings,
    )


def test_too_many_masked_readings_are_refused() -> None:
    readings = np.ma.MaskedArray(READINGS, mask=ANGLES > 70.0)
    refuses("must have at least 9 readings, got 8", lb.CircularTest, 500.0, ANGLES, readings)


def test_masks_of_columns_of_different_length_are_refused() -> None:
    refuses(
        "must have one reading per angle", lb.CircularTest, 500.0, ANGLES[:-1], masked(READINGS)
    )
