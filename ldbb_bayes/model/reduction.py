"""Readings of a circular test reduced to the circle's basis."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.fourier import ORDERS, SIZE, basis
from ldbb_bayes.results import Array

__all__ = ["NearUniform", "Reduced", "reduce_readings"]


_CHUNK = 8192


_EVEN = 1e-6


_UNEVEN = 4


_ZERO = 1e-12


class NearUniform(NamedTuple):
    """RᵀR = S (1 + V λ Vᵀ) S, S the root of a uniform full circle's: ``size`` (25,), ``departure``
    λ (25,), the largest first, positive where readings lie closer than elsewhere, and ``along`` V
    (25, 25)."""

    size: Array
    departure: Array
    along: Array

    @property
    def counts(self) -> NDArray[np.bool_]:
        """Which departures change a log density by more than 1e-6."""
        return np.abs(self.departure) > _EVEN


@dataclass(frozen=True, eq=False)
class Reduced:
    """One test after projection on the basis: ``projection`` z = Qᵀ y [mm], m = min(n, 25) numbers,
    None of a planned test; ``factor`` R (m, 25) of the basis at the test's angles; the squares left
    outside, ``residual_ss`` [mm²]; ``readings`` n."""

    projection: Array | None
    factor: Array
    residual_ss: float
    readings: int

    @cached_property
    def near_uniform(self) -> NearUniform | None:
        """How RᵀR departs from that of a uniform full circle; none of arcs and of few readings,
        which depart from it widely."""
        if self.readings < SIZE:
            return None
        root = np.where(ORDERS == 0, 1.0, np.sqrt(0.5))
        value, along = np.linalg.eigh(self.factor.T @ self.factor / np.outer(root, root))
        departure = value / np.median(value) - 1.0
        order = np.argsort(-np.abs(departure), kind="stable")
        found = NearUniform(
            np.sqrt(np.median(value)) * root,
            departure[order],
            np.where(np.abs(along) > _ZERO, along, 0.0)[:, order],
        )
        return found if np.count_nonzero(found.counts) <= _UNEVEN and value[0] > 0.0 else None


def reduce_readings(angle_rad: Array, reading_mm: Array | None) -> Reduced:
    """One test (n,) [rad], [mm] projected on the basis; any sampling of the circle, in chunks of
    bounded memory."""
    n = len(angle_rad)
    values = np.zeros(n) if reading_mm is None else reading_mm
    stack = np.zeros((0, SIZE + 1))
    for start in range(0, n, _CHUNK):
        part = slice(start, start + _CHUNK)
        rows = np.column_stack([basis(angle_rad[part]), values[part]])
        stack = np.asarray(np.linalg.qr(np.vstack([stack, rows]), mode="r"))
    m = min(n, SIZE)
    residual = float(stack[SIZE, SIZE] ** 2) if n > SIZE else 0.0
    return Reduced(None if reading_mm is None else stack[:m, SIZE], stack[:m, :SIZE], residual, n)
