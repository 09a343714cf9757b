"""Mixtures of split Student-t distributions: proposals of importance sampling, and their fit.

Every component is a product of split t along axes of its own (Geweke, Econometrica 57, 1317-1339,
1989), fitted to weighted points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import gammaln, stdtrit

from ldbb_bayes.results import Array

__all__ = ["Mixture", "Random", "SplitT", "fit_split_t", "refit_mixture"]

# emcee hands its moves a RandomState.
Random = np.random.Generator | np.random.RandomState

# Degrees of freedom that are tried, the heaviest tails first.
_FREEDOMS = np.array([3.0, 5.0, 9.0, 20.0])
# Light tails are fitted in many dimensions only: in few they gain little and leave corners of the
# density in the tail. In up to so many dimensions ...
_FEW_DIMENSIONS = 5
# ... only the first so many degrees of freedom are tried.
_HEAVY_TAILS = 2
# Degrees of freedom from which the fit starts.
_FIRST_FREEDOM = 9.0
# Where the two sides may meet, in units of the axis.
_OFFSETS = np.linspace(-0.4, 0.4, 9)
# Alternations between scales and degrees of freedom, and EM steps of the scales in each.
_ALTERNATIONS = 2
_EM_STEPS = 3
# Smallest and largest scale, in units of the axis.
_SMALLEST_SCALE = 0.05
_LARGEST_SCALE = 20.0
# A proposal is made this much wider than its fit: too narrow a proposal is the worse error.
_WIDER = 1.05
# More points than this are resampled to this number before tails are fitted.
_FITTED_POINTS = 4096
# A component of a smaller share is not refitted, and none gets less.
_SMALLEST_SHARE = 0.02
# Correlations are shrunk towards zero as by this many points a dimension.
_SHRINKAGE = 4.0


@dataclass(frozen=True, eq=False)
class SplitT:
    """x = centre + root z, every z an independent split Student-t.

    Each z has a scale and degrees of freedom for each side of zero: ``scale`` and ``freedom`` are
    (2, h), below and above. The density is continuous: both sides have the same height at zero.
    """

    centre: Array
    root: Array
    scale: Array
    freedom: Array

    def log_density(self, points: Array) -> Array:
        """Return the log density of points (n, h), shape (n,)."""
        z = np.linalg.solve(self.root, (points - self.centre).T).T
        above = z > 0.0
        scale = np.where(above, self.scale[1], self.scale[0])
        freedom = np.where(above, self.freedom[1], self.freedom[0])
        tails = (0.5 * (freedom + 1.0) * np.log1p(z**2 / (freedom * scale**2))).sum(axis=1)
        log_mass = np.log(_side_masses(self.scale, self.freedom).sum(axis=0)).sum()
        return np.asarray(-log_mass - np.linalg.slogdet(self.root)[1] - tails)

    def transform(self, uniform: Array) -> Array:
        """Return points from uniform numbers (n, h)."""
        masses = _side_masses(self.scale, self.freedom)
        share = masses / masses.sum(axis=0)
        below = uniform < share[0]
        probability = np.where(below, uniform / share[0], (1.0 - uniform) / share[1])
        level = np.clip(probability / 2.0, 1e-15, 0.5)
        signed_scale = np.where(below, self.scale[0], -self.scale[1])
        freedom = np.where(below, self.freedom[0], self.freedom[1])
        z = signed_scale * stdtrit(freedom, level)
        return np.asarray(self.centre + z @ self.root.T)


def _side_masses(scale: Array, freedom: Array) -> Array:
    """Return ∫ (1 + z²/(freedom scale²))^(−(freedom + 1)/2) over one side."""
    log_height = gammaln(freedom / 2.0) - gammaln((freedom + 1.0) / 2.0)
    return np.asarray(0.5 * scale * np.sqrt(freedom * np.pi) * np.exp(log_height))


def _log_tail(square: Array, scale: Array, freedom: Array | float) -> Array:
    """Return minus the log of the unnormalised density at squared distances from zero."""
    return np.asarray(0.5 * (freedom + 1.0) * np.log1p(square / (freedom * scale**2)))


@dataclass(frozen=True, eq=False)
class Mixture:
    """A mixture of split Student-t, each with its share (k,)."""

    components: tuple[SplitT, ...]
    share: Array

    def log_density(self, points: Array) -> Array:
        """Return the log density of points (n, h), shape (n,)."""
        return np.asarray(np.logaddexp.reduce(self.by_component(points), axis=0))

    def by_component(self, points: Array) -> Array:
        """Return ln of share times density, shape (k, n)."""
        rows = []
        for share, component in zip(self.share, self.components, strict=True):
            rows.append(np.log(share) + component.log_density(points))
        return np.stack(rows)

    def draw(self, size: int, rng: Random, *, temperature: float = 1.0) -> Array:
        """Return independent draws, shape (size, h), with scales √temperature as wide."""
        limits = np.cumsum(self.share)[:-1]
        picked = np.searchsorted(limits, rng.uniform(size=size), side="right")
        uniform = rng.uniform(size=(size, len(self.components[0].centre)))
        points = np.empty_like(uniform)
        for k, component in enumerate(self.components):
            wider = replace(component, scale=component.scale * np.sqrt(temperature))
            points[picked == k] = wider.transform(uniform[picked == k])
        return points


def refit_mixture(proposal: Mixture, points: Array, weight: Array) -> Mixture:
    """Return the mixture with every component that counts refitted to its share of the points.

    Points (n, h), their weights (n,) sum to one.
    """
    by_component = proposal.by_component(points)
    weights = weight * np.exp(by_component - np.logaddexp.reduce(by_component, axis=0))
    mass = weights.sum(axis=1)
    components = []
    for k, component in enumerate(proposal.components):
        if mass[k] > _SMALLEST_SHARE:
            component = _refit_component(component, points, weights[k] / mass[k])
        components.append(component)
    share = np.maximum(mass, _SMALLEST_SHARE)
    return Mixture(tuple(components), share / share.sum())


def _refit_component(component: SplitT, points: Array, weight: Array) -> SplitT:
    """Move, turn and stretch a component to mean, covariance and tails of weighted points.

    Correlations are shrunk towards zero where few points carry them.
    """
    z = np.linalg.solve(component.root, (points - component.centre).T).T
    ess = 1.0 / (weight**2).sum()
    h = z.shape[1]
    mean = weight @ z
    centred = z - mean
    covariance = (centred.T * weight) @ centred
    sd = np.sqrt(np.diag(covariance))
    pseudo_points = _SHRINKAGE * h
    correlation = ess * covariance / np.outer(sd, sd) + pseudo_points * np.eye(h)
    correlation = correlation / (ess + pseudo_points)
    values, vectors = np.linalg.eigh(correlation)
    standard = centred / sd @ (vectors / np.sqrt(values)) @ vectors.T
    spread = np.sqrt(weight @ standard**2)
    root = (component.root * sd) @ (vectors * np.sqrt(values)) @ vectors.T * spread
    centre = component.centre + component.root @ mean
    if len(points) > _FITTED_POINTS:
        levels = np.linspace(0.0, 1.0, _FITTED_POINTS, endpoint=False) + 0.5 / _FITTED_POINTS
        picked = np.minimum(np.searchsorted(np.cumsum(weight), levels), len(weight) - 1)
        standard = standard[picked]
        weight = np.full(_FITTED_POINTS, 1.0 / _FITTED_POINTS)
    return fit_split_t(
        centre, root, standard / spread, np.broadcast_to(weight[:, None], standard.shape)
    )


class _AxisFit(NamedTuple):
    """Split t fitted along each of h axes."""

    offset: Array  #: where the two sides meet (h,)
    scale: Array  #: (2, h)
    freedom: Array  #: (2, h)
    log_likelihood: Array  #: mean over the weights (h,)


def fit_split_t(centre: Array, root: Array, z: Array, weight: Array) -> SplitT:
    """Return the split t that is most likely along every axis.

    Scales come from EM steps; degrees of freedom and where the sides meet from a few candidates.

    Parameters
    ----------
    centre, root : ndarray, shapes (h,) and (h, h)
        x = centre + root z.
    z, weight : ndarray, shape (n, h)
        Places along the axes, and weights that sum to one along every axis.
    """
    h = z.shape[1]
    freedoms = _FREEDOMS
    if h <= _FEW_DIMENSIONS:
        freedoms = _FREEDOMS[:_HEAVY_TAILS]
    best = _AxisFit(np.zeros(h), np.ones((2, h)), np.ones((2, h)), np.full(h, -np.inf))
    for offset in _OFFSETS:
        candidate = _fit_about(float(offset), z, weight, freedoms)
        better = candidate.log_likelihood > best.log_likelihood
        best = _AxisFit(
            np.where(better, candidate.offset, best.offset),
            np.where(better, candidate.scale, best.scale),
            np.where(better, candidate.freedom, best.freedom),
            np.where(better, candidate.log_likelihood, best.log_likelihood),
        )
    return SplitT(centre + root @ best.offset, root, _WIDER * best.scale, best.freedom)


def _fit_about(offset: float, z: Array, weight: Array, freedoms: Array) -> _AxisFit:
    """Fit scales and degrees of freedom with the two sides meeting at an offset."""
    h = z.shape[1]
    square = (z - offset) ** 2
    above = z > offset
    side_weights = np.stack([np.where(above, 0.0, weight), np.where(above, weight, 0.0)])
    scale = np.ones((2, h))
    freedom = np.full((2, h), _FIRST_FREEDOM)
    for _ in range(_ALTERNATIONS):
        scale = _fit_scale(square, side_weights, scale, freedom)
        for side in (0, 1):
            freedom[side] = _best_freedom(side, square, side_weights, scale, freedom, freedoms)
    tails = np.zeros(h)
    for side in (0, 1):
        log_tail = _log_tail(square, scale[side], freedom[side])
        tails = tails + (side_weights[side] * log_tail).sum(axis=0)
    log_likelihood = -np.log(_side_masses(scale, freedom).sum(axis=0)) - tails
    return _AxisFit(np.full(h, offset), scale, freedom, log_likelihood)


def _fit_scale(square: Array, side_weights: Array, scale: Array, freedom: Array) -> Array:
    """Improve the scales (2, h) by a few EM steps."""
    for _ in range(_EM_STEPS):
        pull = (freedom[:, None] + 1.0) / (freedom[:, None] + square / scale[:, None] ** 2)
        moment = (side_weights * pull * square).sum(axis=1)
        masses = _side_masses(scale, freedom)
        cube = masses.sum(axis=0) * scale / masses * moment
        scale = np.clip(np.cbrt(cube), _SMALLEST_SCALE, _LARGEST_SCALE)
    return scale


def _best_freedom(
    side: int, square: Array, side_weights: Array, scale: Array, freedom: Array, freedoms: Array
) -> Array:
    """Return the likeliest candidate of the degrees of freedom of one side, shape (h,)."""
    other_mass = _side_masses(scale, freedom)[1 - side]
    costs = []
    for candidate in freedoms:
        log_tail = _log_tail(square, scale[side], candidate)
        tail = (side_weights[side] * log_tail).sum(axis=0)
        costs.append(np.log(_side_masses(scale[side], candidate) + other_mass) + tail)
    return np.asarray(freedoms[np.argmin(costs, axis=0)])
