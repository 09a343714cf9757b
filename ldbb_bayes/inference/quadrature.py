"""Integrals of a density with known modes: a lattice in few dimensions, a sample in many.

Nothing here knows of circles.
"""

from __future__ import annotations

from collections.abc import Sequence

from ldbb_bayes.inference.importance_sampling import importance_sample
from ldbb_bayes.inference.integrals import Integral, LogDensity
from ldbb_bayes.inference.lattice import grow_lattice
from ldbb_bayes.results import Array

__all__ = ["integrate"]

# Most dimensions in which a lattice needs fewer nodes than a sample.
LARGEST_LATTICE_DIMENSION = 5
# A sample gets this share of the tolerance: what is averaged over its nodes adds errors.
_OF_TOLERANCE = 0.8


def integrate(
    log_density: LogDensity,
    modes: Sequence[tuple[Array, Array]],
    *,
    tolerance: float = 1e-3,
    step: float | None = None,
    seed: int = 0,
) -> Integral:
    """Return ∫ f: a lattice in up to five dimensions, importance sampling in more.

    Where the weights of the sample cannot be trusted the result says so: its error is infinite.

    Parameters
    ----------
    log_density : callable
        ln f, (n, h) → (n,).
    modes : sequence of pairs
        Modes (h,), highest first, and a root (h, h) of the inverse curvature at each.
    tolerance : float
        Error of ln ∫ f asked for [nat].
    step : float, optional
        The first step of a lattice, in sd.
    seed : int
        Seed of a sample.
    """
    if len(modes[0][0]) <= LARGEST_LATTICE_DIMENSION:
        return grow_lattice(log_density, modes, tolerance=tolerance, step=step)
    return importance_sample(log_density, modes, tolerance=_OF_TOLERANCE * tolerance, seed=seed)
