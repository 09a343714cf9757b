"""Polar sketches of circular tests for the terminal, in Braille dots."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.circular_test import CircularTest

__all__ = ["MOST_SKETCHES", "polar_sketch", "polar_sketches"]

Array = NDArray[np.float64]
MOST_SKETCHES = 24
_BLANK = 0x2800
# Bits of a Braille cell of 2 × 4 dots, by row and column.
_BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
_BETWEEN = "   "
# Of the half-width: radius of the dotted mean circle, and of the largest deviation on it.
_CIRCLE, _SWING = 0.62, 0.34


def polar_sketch(test: CircularTest, *, scale_um: float, columns: int = 20) -> list[str]:
    """Deviations from the test's mean on a dotted circle, θ counter-clockwise from the right.

    Parameters
    ----------
    scale_um : float
        Deviation that is drawn as about half the circle's radius [µm].
    columns : int
        Width in characters; the height is half of it.
    """
    size = 2 * columns
    deviation = np.asarray(test.reading_um) - float(np.mean(test.reading_um))
    dots = np.zeros((size, size), dtype=bool)
    round_ = np.deg2rad(np.arange(0.0, 360.0, 12.0))
    _put(dots, round_, np.full(len(round_), _CIRCLE))
    _put(dots, test.angles_rad(), _CIRCLE + _SWING * np.clip(deviation / scale_um, -1.5, 1.0))
    cells = (dots.reshape(size // 4, 4, size // 2, 2) * _BITS[None, :, None, :]).sum(axis=(1, 3))
    return ["".join(chr(_BLANK + int(cell)) for cell in row) for row in cells]


def _put(dots: NDArray[np.bool_], angle_rad: Array, radius: Array) -> None:
    half = 0.5 * (len(dots) - 1)
    x = np.rint(half * (1.0 + radius * np.cos(angle_rad))).astype(int)
    y = np.rint(half * (1.0 - radius * np.sin(angle_rad))).astype(int)
    dots[y, x] = True


def polar_sketches(tests: Sequence[CircularTest], *, width: int, columns: int = 20) -> list[str]:
    """Sketches of tests with readings side by side, one scale for all, with names and forces above and the scale below."""
    scale = max(float(np.abs(test.reading_um - np.mean(test.reading_um)).max()) for test in tests)
    scale = scale if scale > 0.0 else 1.0
    across = max((width + len(_BETWEEN)) // (columns + len(_BETWEEN)), 1)
    lines: list[str] = []
    for first in range(0, len(tests), across):
        row = tests[first : first + across]
        titles = [f"{test.name} ({test.force_N:.4g} N)" for test in row]
        lines.append(_BETWEEN.join(title[:columns].ljust(columns) for title in titles).rstrip())
        sketches = [polar_sketch(test, scale_um=scale, columns=columns) for test in row]
        lines += [_BETWEEN.join(parts) for parts in zip(*sketches, strict=True)]
    swing = _SWING / _CIRCLE
    return [
        *lines,
        f"Dotted: the mean of each circle; angle 0 at the right, counter-clockwise. All drawn alike: {scale:.3g} µm, the largest "
        f"deviation of all, stands {swing:.0%} of the dotted radius off it.",
    ]
