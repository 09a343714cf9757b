"""What drives add to the path that looks exactly like geometric errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from machines import Disturbances, simulate
from numpy.typing import NDArray

__all__ = ["added_by_drives_mm"]

Array = NDArray[np.float64]

# Orders of a path that geometric errors have, and that are no circle.
GEOMETRIC_ORDERS = (2, 3)


def added_by_drives_mm(family: Disturbances, seed: int, angle: Array) -> Array:
    """What drives add to the path in both directions alike, of the orders of geometric errors:
    readings of a campaign less those of the same machine with perfect drives, at the angles,
    shape (angles,)."""
    perfect = replace(
        family,
        spikes_um=0.0,
        lost_um=0.0,
        lost_um_per_kN=0.0,
        mismatch_um=0.0,
        friction_um=0.0,
        friction_um_per_kN=0.0,
    )
    campaign, _ = simulate(family, seed)
    campaign_perfect, _ = simulate(perfect, seed)
    total_um = np.zeros(len(campaign.tests[0].reading_um))
    for test, test_perfect in zip(campaign.tests, campaign_perfect.tests, strict=True):
        total_um += test.reading_um - test_perfect.reading_um
    mean_mm = 1e-3 * total_um / len(campaign.tests)
    coefficients = np.fft.rfft(mean_mm) / len(mean_mm)
    added = np.zeros_like(angle)
    for order in GEOMETRIC_ORDERS:
        added += 2.0 * np.real(coefficients[order] * np.exp(1j * order * angle))
    return added
