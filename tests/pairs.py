"""Two correlated normals both above zero, by a plain sum: the reference of orthant probabilities far out."""

from __future__ import annotations

import numpy as np
from scipy.special import log_ndtr


def pair_by_quadrature(mean: tuple[float, float], rho: float) -> float:
    """ln P(u₁ ≥ 0, u₂ ≥ 0) by the trapezoidal rule over u₁, however far."""
    reach = max(mean[0], 0.0) + 40.0 + abs(mean[1] / rho)
    value = np.concatenate([[0.0], np.geomspace(1e-9, reach, 400_001)])
    tail = log_ndtr((mean[1] + rho * (value - mean[0])) / np.sqrt(1.0 - rho**2))
    density = -0.5 * (value - mean[0]) ** 2 - 0.5 * np.log(2 * np.pi) + tail
    return float(density.max() + np.log(np.trapezoid(np.exp(density - density.max()), value)))
