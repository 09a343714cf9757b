"""Moments and quantiles of mixtures of Gaussians and of weighted draws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr, ndtri

from ldbb_bayes.results import Array

__all__ = ["mixture_moments", "mixture_quantiles", "weighted_quantiles"]


_ITERATIONS = 100


_CLOSE = 1e-12


_TOGETHER = 200_000


def mixture_moments(weight: Array, mean: Array, sd: Array) -> tuple[Array, Array]:
    """Mean and sd, shape (...), of mixtures of Gaussians: weights (k,), components (k, ...)."""
    middle = np.tensordot(weight, mean, 1)
    return middle, np.sqrt(np.tensordot(weight, sd**2 + (mean - middle) ** 2, 1))


def mixture_quantiles(
    weight: Array, mean: Array, sd: Array, levels: Sequence[float] | Array
) -> Array:
    """Quantiles, shape (levels, ...), of mixtures of Gaussians: Newton's method kept inside a
    bracket. Components (k, ...); weights (k,), or an array that broadcasts with them, sum to one
    along the first axis."""
    flat_mean, flat_sd = (part.reshape(len(mean), -1) for part in (mean, sd))
    weight = weight.reshape(-1, *(1,) * (mean.ndim - 1)) if weight.ndim == 1 else weight
    flat_weight = np.broadcast_to(weight, mean.shape).reshape(flat_mean.shape)
    found = np.empty((len(levels), flat_mean.shape[1]))
    size = max(1, _TOGETHER // len(mean))
    for start in range(0, flat_mean.shape[1], size):
        own = slice(start, start + size)
        for row, level in enumerate(levels):
            found[row, own] = _mixture_quantile(
                flat_weight[:, own], flat_mean[:, own], flat_sd[:, own], level
            )
    return found.reshape(len(levels), *mean.shape[1:])


def _mixture_quantile(weight: Array, mean: Array, sd: Array, level: float) -> Array:
    each = mean + ndtri(level) * sd
    low = each.min(axis=0)
    high = each.max(axis=0)
    middle = (weight * mean).sum(axis=0)
    spread = np.sqrt((weight * (sd**2 + (mean - middle) ** 2)).sum(axis=0))
    x = np.clip(middle + ndtri(level) * spread, low, high)
    step = high - low
    for _ in range(_ITERATIONS):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            z = (x - mean) / sd
            excess = (weight * ndtr(z)).sum(axis=0) - level
            low = np.where(excess <= 0.0, x, low)
            high = np.where(excess >= 0.0, x, high)
            new = x - excess / (
                (weight * (np.exp(-0.5 * z**2) / sd)).sum(axis=0) / np.sqrt(2.0 * np.pi)
            )
        # Newton's step where it is the last, or stays inside the bracket and is at most half of the
        # one before; else halfway.
        size = np.abs(new - x)
        good = (size <= _CLOSE * spread) | (
            (new > low) & (new < high) & (size <= 0.5 * np.abs(step))
        )
        new = np.where(good, new, 0.5 * (low + high))
        step = new - x
        x = new
        if np.all(np.abs(step) <= _CLOSE * spread):
            break
    return x


def weighted_quantiles(weight: Array, draws: Array, levels: Sequence[float] | Array) -> Array:
    """Quantiles, shape (levels, ...), of weighted draws (k, ...), linear between the middles of
    their weights."""
    flat = draws.reshape(len(draws), -1)
    found = np.empty((len(levels), flat.shape[1]))
    for column in range(flat.shape[1]):
        order = np.argsort(flat[:, column], kind="stable")
        reached = np.cumsum(weight[order]) - 0.5 * weight[order]
        found[:, column] = np.interp(levels, reached, flat[order, column])
    return found.reshape(len(levels), *draws.shape[1:])
