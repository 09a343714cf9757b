"""Sketches in Braille: a circle is a circle, a spike stands where it is, one scale for all."""

from __future__ import annotations

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.report.sketch import polar_sketch, polar_sketches

ANGLE = np.arange(0.0, 360.0, 1.0)


def dots(lines: list[str]) -> np.ndarray:
    """Which dots are set, by the bits of the Unicode block, shape (4 rows, 2 columns of each cell)."""
    cells = np.array([[ord(sign) - 0x2800 for sign in line] for line in lines])
    places = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1), (3, 0), (3, 1)]
    found = np.zeros((4 * cells.shape[0], 2 * cells.shape[1]), dtype=bool)
    for bit, (row, column) in enumerate(places):
        found[row::4, column::2] = (cells >> bit) & 1
    return found


def circle(reading: np.ndarray, force: float = 36.0) -> lb.CircularTest:
    return lb.CircularTest(force, ANGLE, reading, name=f"f{force:.0f}")


def test_equal_readings_are_a_round_ring() -> None:
    lines = polar_sketch(circle(np.full(360, 7.0)), scale_um=1.0)
    assert [len(line) for line in lines] == [20] * 10
    y, x = np.nonzero(dots(lines))
    radius = np.hypot(x - 19.5, y - 19.5) / 19.5
    assert radius.min() == pytest.approx(radius.max(), abs=0.09)
    assert radius.mean() == pytest.approx(0.62, abs=0.03)


@pytest.mark.parametrize(("at_deg", "column", "row"), [(0, 1.0, 0.0), (90, 0.0, 1.0), (180, -1.0, 0.0), (270, 0.0, -1.0)])
def test_a_spike_stands_at_its_angle(at_deg: int, column: float, row: float) -> None:
    """θ counter-clockwise from the right, upwards is +."""
    reading = np.zeros(360)
    reading[at_deg] = 100.0
    y, x = np.nonzero(dots(polar_sketch(circle(reading), scale_um=100.0)))
    far = int(np.argmax(np.hypot(x - 19.5, y - 19.5)))
    assert (x[far] - 19.5) / 19.5 == pytest.approx(0.95 * column, abs=0.08)
    assert (19.5 - y[far]) / 19.5 == pytest.approx(0.95 * row, abs=0.08)


def test_sketches_stand_side_by_side_as_the_width_allows() -> None:
    tests = [circle(np.sin(np.deg2rad(2 * ANGLE)) * k, 100.0 * k) for k in (1, 2, 3)]
    wide, narrow = polar_sketches(tests, width=70), polar_sketches(tests, width=30)
    assert (len(wide), len(narrow)) == (1 + 10 + 1, 3 * 11 + 1)
    assert "f100 (100 N)" in wide[0]
    assert "f300 (300 N)" in wide[0]
    assert "3 µm" in wide[-1]
    assert max(map(len, narrow[:-1])) <= 30


def test_all_readings_equal_are_drawn_too() -> None:
    assert "1 µm" in polar_sketches([circle(np.zeros(360))], width=80)[-1]
