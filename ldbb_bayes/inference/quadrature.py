"""Integrals of a density with known modes: by a lattice in few dimensions, by sampling in many."""

from __future__ import annotations

from collections.abc import Sequence

from ldbb_bayes.inference.importance_sampling import importance_sample
from ldbb_bayes.inference.integrals import Integral, LogDensity
from ldbb_bayes.inference.lattice import grow_lattice
from ldbb_bayes.results import Array

__all__ = ["integrate"]

# Largest number of dimensions in which an integral is computed from a lattice of nodes. In more
# dimensions importance sampling needs fewer nodes.
LARGEST_LATTICE_DIMENSION = 5
# Importance sampling is asked for an integral with an error of at most this share of the tolerance,
# because averages over its nodes have further errors.
_SHARE_OF_TOLERANCE = 0.8


def integrate(
    log_density: LogDensity,
    modes: Sequence[tuple[Array, Array]],
    *,
    tolerance: float = 1e-3,
    step: float | None = None,
    seed: int = 0,
) -> Integral:
    """Return the integral ∫ f of a density in h dimensions, with its nodes and error.

    In up to five dimensions it is computed from a lattice, in more dimensions by importance
    sampling. If the weights of a sample cannot be trusted, the error of the result is infinite.

    Parameters
    ----------
    log_density : callable
        Function that returns ln f, shape (n,), at n points in h dimensions, shape (n, h).
    modes : sequence of pairs
        Modes (maxima) of f, shape (h,), the highest first, each with a square root, shape (h, h),
        of the inverse of minus the Hessian of ln f there.
    tolerance : float
        Error allowed in ln ∫ f [nat].
    step : float, optional
        Spacing of the points with which a lattice starts, in units of the standard deviation of the
        Gaussian fitted to f at the highest mode. Default: computed from the tolerance.
    seed : int
        Seed of importance sampling.
    """
    if len(modes[0][0]) <= LARGEST_LATTICE_DIMENSION:
        return grow_lattice(log_density, modes, tolerance=tolerance, step=step)
    tolerance_of_sample = _SHARE_OF_TOLERANCE * tolerance
    return importance_sample(log_density, modes, tolerance=tolerance_of_sample, seed=seed)
