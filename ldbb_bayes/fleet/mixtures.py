"""Σ_k w_k N(mean_k, sd_k²): moments and quantiles of mixtures of Gaussians."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

__all__ = ["mixture_moments", "mixture_quantiles", "weighted_quantiles"]

Array = NDArray[Any]
_ITERATIONS, _CLOSE = 100, 1e-9
_TOGETHER = 200_000


def mixture_moments(weight: Array, mean: Array, sd: Array) -> tuple[Array, Array]:
    """Mean and sd, shape (...), of components (k, ...)."""
    middle = np.tensordot(weight, mean, 1)
    return middle, np.sqrt(np.tensordot(weight, sd**2 + (mean - middle) ** 2, 1))


def mixture_quantiles(weight: Array, mean: Array, sd: Array, levels: Sequence[float]) -> Array:
    """Quantiles, shape (levels, ...), of components (k, ...): Newton's method kept inside a bracket."""
    flat_mean, flat_sd = (part.reshape(len(weight), -1) for part in (mean, sd))
    found = np.empty((len(levels), flat_mean.shape[1]))
    size = max(1, _TOGETHER // len(weight))
    for start in range(0, flat_mean.shape[1], size):
        own = slice(start, start + size)
        for row, level in enumerate(levels):
            found[row, own] = _quantile(weight, flat_mean[:, own], flat_sd[:, own], level)
    return found.reshape(len(levels), *mean.shape[1:])


def _quantile(weight: Array, mean: Array, sd: Array, level: float) -> Array:
    each = mean + ndtri(level) * sd
    low, high = each.min(axis=0), each.max(axis=0)
    middle, spread = mixture_moments(weight, mean, sd)
    x = np.clip(middle + ndtri(level) * spread, low, high)
    for _ in range(_ITERATIONS):
        z = (x - mean) / sd
        excess = weight @ ndtr(z) - level
        low, high = np.where(excess <= 0.0, x, low), np.where(excess >= 0.0, x, high)
        density = weight @ (np.exp(-0.5 * z**2) / sd) / np.sqrt(2.0 * np.pi)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = excess / density
        new = x - step
        new = np.where((new >= low) & (new <= high), new, 0.5 * (low + high))
        moved, x = np.abs(new - x), new
        if np.all(moved <= _CLOSE * spread):
            break
    return x


def weighted_quantiles(weight: Array, draws: Array, levels: Sequence[float]) -> Array:
    """Quantiles, shape (levels, ...), of weighted draws (k, ...), linear between the middles of their weights."""
    flat = draws.reshape(len(draws), -1)
    found = np.empty((len(levels), flat.shape[1]))
    for column in range(flat.shape[1]):
        order = np.argsort(flat[:, column], kind="stable")
        reached = np.cumsum(weight[order]) - 0.5 * weight[order]
        found[:, column] = np.interp(levels, reached, flat[order, column])
    return found.reshape(len(levels), *draws.shape[1:])
