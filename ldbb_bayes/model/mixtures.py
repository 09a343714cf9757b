"""Means, standard deviations and quantiles of Gaussian mixtures and of weighted random draws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr, ndtri

from ldbb_bayes.results import Array

__all__ = ["mixture_moments", "mixture_quantiles", "weighted_quantiles"]

# Maximum number of steps in the search for a quantile of a Gaussian mixture. Bisection alone would
# need about fifty steps.
_ITERATIONS = 100
# The search for a quantile of a Gaussian mixture ends when the length of a step, divided by the
# standard deviation of the mixture, is at most this number.
_STEP_TOLERANCE = 1e-12
# Largest number of Gaussian components in one computation. Quantiles of several mixtures are
# computed at once if these mixtures have at most this number of components in total. The arrays
# then fit into the processor's cache.
_CHUNK = 200_000


def mixture_moments(
    weight: Array,
    mean: Array,
    sd: Array,
) -> tuple[Array, Array]:
    """Return the means and standard deviations of mixtures of k Gaussian densities, shape (...).

    Parameters
    ----------
    weight
        Weights of the k Gaussian components, shape (k,), which sum to one.
    mean, sd
        Means and standard deviations of the components, shape (k, ...); the dimensions "..." hold
        many mixtures.
    """
    centre = np.tensordot(weight, mean, 1)
    variance = np.tensordot(weight, sd**2 + (mean - centre) ** 2, 1)
    return centre, np.sqrt(variance)


def mixture_quantiles(
    weight: Array,
    mean: Array,
    sd: Array,
    levels: Sequence[float] | Array,
) -> Array:
    """Return quantiles of mixtures of k Gaussians, shape (levels, ...).

    Each quantile is computed by Newton's method, combined with bisection between bounds that always
    enclose the quantile.

    Parameters
    ----------
    weight
        Weights of the k Gaussian components, shape (k,), or an array that broadcasts with ``mean``;
        they sum to one along the first dimension.
    mean, sd
        Means and standard deviations of the components, shape (k, ...); the dimensions "..." hold
        many mixtures.
    levels
        Probabilities of the quantiles, each strictly between zero and one.
    """
    flat_mean = mean.reshape(len(mean), -1)
    flat_sd = sd.reshape(len(mean), -1)
    if weight.ndim == 1:
        weight = weight.reshape(-1, *(1,) * (mean.ndim - 1))
    flat_weight = np.broadcast_to(weight, mean.shape).reshape(flat_mean.shape)
    quantiles = np.empty((len(levels), flat_mean.shape[1]))
    size = max(1, _CHUNK // len(mean))
    for start in range(0, flat_mean.shape[1], size):
        chunk = slice(start, start + size)
        components = flat_weight[:, chunk], flat_mean[:, chunk], flat_sd[:, chunk]
        for row, level in enumerate(levels):
            quantiles[row, chunk] = _mixture_quantile(*components, level)
    return quantiles.reshape(len(levels), *mean.shape[1:])


def _mixture_quantile(
    weight: Array,
    mean: Array,
    sd: Array,
    level: float,
) -> Array:
    """Return one quantile of each of n mixtures of k Gaussians, shape (n,).

    ``level`` is the probability of the quantile. ``weight``, ``mean`` and ``sd`` are the weights,
    means and standard deviations of the Gaussians, each of shape (k, n).
    """
    component_quantiles = mean + ndtri(level) * sd
    low = component_quantiles.min(axis=0)
    high = component_quantiles.max(axis=0)
    centre = (weight * mean).sum(axis=0)
    spread = np.sqrt((weight * (sd**2 + (mean - centre) ** 2)).sum(axis=0))
    x = np.clip(centre + ndtri(level) * spread, low, high)
    step = high - low
    for _ in range(_ITERATIONS):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            z = (x - mean) / sd
            excess = (weight * ndtr(z)).sum(axis=0) - level
            unnormalised = (weight * (np.exp(-0.5 * z**2) / sd)).sum(axis=0)
            density = unnormalised / np.sqrt(2.0 * np.pi)
            newton_x = x - excess / density
        low = np.where(excess <= 0.0, x, low)
        high = np.where(excess >= 0.0, x, high)
        # Take the step of Newton's method if it is short enough to end the search, or if it ends
        # between the bounds of the quantile and is at most half as long as the previous step.
        # Otherwise bisect the interval between the bounds.
        size = np.abs(newton_x - x)
        converged = size <= _STEP_TOLERANCE * spread
        inside = (newton_x > low) & (newton_x < high)
        shrinking = size <= 0.5 * np.abs(step)
        new_x = np.where(converged | (inside & shrinking), newton_x, 0.5 * (low + high))
        step = new_x - x
        x = new_x
        if np.all(np.abs(step) <= _STEP_TOLERANCE * spread):
            break
    return x


def weighted_quantiles(
    weight: Array,
    draws: Array,
    levels: Sequence[float] | Array,
) -> Array:
    """Return quantiles of weighted random draws, shape (levels, ...).

    Quantiles are interpolated linearly between the sorted draws. The probability at each draw is
    the sum of the weights of all smaller draws plus half the weight of the draw itself.

    Parameters
    ----------
    weight
        Weights of the random draws, shape (k,), which sum to one.
    draws
        k random draws of the quantities, shape (k, ...).
    levels
        Probabilities of the quantiles, each between zero and one.
    """
    flat = draws.reshape(len(draws), -1)
    quantiles = np.empty((len(levels), flat.shape[1]))
    for column in range(flat.shape[1]):
        order = np.argsort(flat[:, column], kind="stable")
        sorted_weight = weight[order]
        probability = np.cumsum(sorted_weight) - 0.5 * sorted_weight
        quantiles[:, column] = np.interp(levels, probability, flat[order, column])
    return quantiles.reshape(len(levels), *draws.shape[1:])
