"""Convergence, importance weights and sensitivity of draws. The only importer of arviz_stats."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from contextlib import suppress

import numpy as np
from scipy.special import ndtri

from ldbb_bayes.results import Array

__all__ = ["diagnose", "pareto_smooth", "power_sensitivity"]


_POWERS = (0.99, 1.01)


_COUNT = 10.0


def power_sensitivity(
    draws: Mapping[str, Array], scaled: Mapping[str, Array]
) -> dict[str, dict[str, float]]:
    """How much each parameter's posterior changes when a part of the joint density is raised to a
    power near one.

    Of draws and of the log densities of parts, each (chains, draws). Above 0.05 counts as
    sensitive; 0 where a part is constant. The cumulative Jensen-Shannon distance by which a power
    of two would move it (Kallioinen et al. 2023), the larger of those of x and −x; weights are too
    even to need smoothing.
    """
    every = np.stack([values.ravel() for values in draws.values()])
    order = np.argsort(every, axis=1)
    widths = np.diff(np.take_along_axis(every, order, axis=1), axis=1)
    plain = np.linspace(1.0 / every.shape[1], 1.0 - 1.0 / every.shape[1], every.shape[1] - 1)
    changes = {part: np.zeros(len(every)) for part in scaled}
    for part, log_density in scaled.items():
        for power in _POWERS if np.ptp(log_density) > 0.0 else ():
            weight = np.exp((power - 1.0) * (log_density - log_density.mean())).ravel()
            moved = np.cumsum(weight[order], axis=1)[:, :-1] / weight.sum()
            apart = np.maximum(
                _apart(plain, moved, widths), _apart(1.0 - plain, 1.0 - moved, widths)
            )
            changes[part] += apart / abs(np.log2(power)) / len(_POWERS)
    return {
        name: {part: float(values[k]) for part, values in changes.items()}
        for k, name in enumerate(draws)
    }


def _apart(one: Array, other: Array, widths: Array) -> Array:
    """Cumulative Jensen-Shannon distance of distribution functions (d, n) on steps of these
    widths."""
    middle = 0.5 * (one + other)
    shift = 0.5 / np.log(2.0) * (widths * (other - one)).sum(axis=1)
    divergence = [(widths * own * np.log2(own / middle)).sum(axis=1) for own in (one, other)]
    total = np.maximum(divergence[0] + shift, 0.0) + np.maximum(divergence[1] - shift, 0.0)
    return np.asarray(np.sqrt(total / (2.0 * (widths * middle).sum(axis=1))))


def pareto_smooth(log_ratio: Array) -> tuple[Array, float, float]:
    """Weights of importance sampling (n,), their largest smoothed by a Pareto tail (Vehtari et al.
    2024), from ln of target over proposal at independent draws, up to a constant; Pareto's k̂,
    infinite when hardly a draw counts or the tail cannot be judged, −inf for equal weights; and the
    k̂ above which weights cannot be trusted."""
    good_k = min(0.7, 1.0 - 1.0 / float(np.log10(len(log_ratio))))
    if np.ptp(log_ratio) < np.sqrt(np.finfo(float).eps):
        return np.full(len(log_ratio), 1.0 / len(log_ratio)), -np.inf, good_k
    log_weight = log_ratio
    k = np.inf
    with suppress(ValueError), np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):
        from arviz_stats.base import array_stats

        smoothed, shape = array_stats.psislw(-log_ratio)
        if not np.isnan(smoothed).any():
            log_weight = smoothed
            k = float(shape)
    weight = np.exp(log_weight - np.max(log_weight))
    weight /= weight.sum()
    counted = 1.0 / np.sum(weight**2) > _COUNT
    return weight, k if counted and np.isfinite(k) else np.inf, good_k


_TAILS = (0.05, 0.95)


_ROUNDING = 1e-15


def diagnose(chain: Array) -> Array:
    """Bulk ESS, tail ESS and rank-normalised split R-hat (Vehtari et al. 2021), shape (3, d), of a
    chain (chains, draws, d)."""
    draws = np.ascontiguousarray(np.moveaxis(chain, 2, 0), dtype=float)
    flat = draws.reshape(len(draws), -1)
    half = draws.shape[2] // 2
    split = np.concatenate([draws[..., :half], draws[..., -half:]], axis=1)
    folded = np.abs(split - np.median(split, axis=(1, 2), keepdims=True))
    white = _rank_normalised(split)
    white_folded = _rank_normalised(folded)
    below = [draws <= np.quantile(flat, level, axis=1)[:, None, None] for level in _TAILS]
    tails = [
        _ess(np.concatenate([own[..., :half], own[..., -half:]], axis=1).astype(float))
        for own in below
    ]
    return np.stack(
        [_ess(white), np.minimum(*tails), np.maximum(_rhat(white), _rhat(white_folded))]
    )


def _rank_normalised(draws: Array) -> Array:
    """Normal scores of the ranks of (d, chains, draws) among all chains and draws of a quantity;
    equal values share a rank."""
    flat = draws.reshape(len(draws), -1)
    n = flat.shape[1]
    order = np.argsort(flat, axis=1)
    ordered = np.take_along_axis(flat, order, axis=1)
    place = np.arange(flat.shape[1])
    new = np.diff(ordered, axis=1) > 0.0
    ends = np.ones((len(flat), 1), dtype=bool)
    first = np.maximum.accumulate(np.where(np.hstack([ends, new]), place, 0), axis=1)
    last = np.minimum.accumulate(np.where(np.hstack([new, ends]), place, n)[:, ::-1], axis=1)[
        :, ::-1
    ]
    np.put_along_axis(
        flat := np.empty_like(flat),
        order,
        ndtri(((first + last) / 2.0 + 0.625) / (n + 0.25)),
        axis=1,
    )
    return flat.reshape(draws.shape)


def _rhat(draws: Array) -> Array:
    n = draws.shape[2]
    between = draws.mean(axis=2).var(axis=1, ddof=1)
    within = draws.var(axis=2, ddof=1).mean(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.sqrt(between / within + (n - 1) / n))


def _ess(draws: Array) -> Array:
    """ESS of (d, chains, draws), shape (d,): autocorrelations summed in pairs while these are
    positive, made to fall (Geyer)."""
    _, chains, n = draws.shape
    centred = draws - draws.mean(axis=2, keepdims=True)
    transform = np.fft.rfft(centred, 1 << (2 * n - 1).bit_length(), axis=2)
    covariance = np.fft.irfft((np.abs(transform) ** 2).mean(axis=1), axis=1)[:, :n] / n
    within = covariance[:, :1] * n / (n - 1.0)
    total = covariance[:, :1] + (
        draws.mean(axis=2).var(axis=1, ddof=1)[:, None] if chains > 1 else 0.0
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        rho = 1.0 - (within - covariance) / total
    rho[:, 0] = 1.0
    pairs = rho[:, : 2 * ((n - 1) // 2)].reshape(len(rho), -1, 2).sum(axis=2)
    last = np.argmax(np.hstack([pairs[:, :-1] <= 0.0, np.ones((len(rho), 1), dtype=bool)]), axis=1)
    every = np.arange(len(rho))
    even = np.where(
        (pairs[every, last] >= 0.0) | (rho[every, 2 * last] > 0.0), rho[every, 2 * last], 0.0
    )
    falling = np.where(
        np.arange(pairs.shape[1]) < last[:, None], np.minimum.accumulate(pairs, axis=1), 0.0
    )
    length = np.maximum(2.0 * falling.sum(axis=1) + even - 1.0, 1.0 / np.log10(chains * n))
    still = np.ptp(draws, axis=(1, 2)) < _ROUNDING
    return np.asarray(np.where(still, chains * n, chains * n / length))
