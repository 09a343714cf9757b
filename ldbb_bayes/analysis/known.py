"""What is known before new tests: values of the hyper-parameters, and of the parameters, that the pilot leaves likely."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.collapsed import draw_parameters_given
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.gaussian import singular_root
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.simulate import draw_parameters

__all__ = ["Known", "hyper_nodes", "known_before", "narrowed"]

Array = NDArray[Any]
_REPEATS = 4
_KEPT: WeakKeyDictionary[Campaign, list[tuple[HybridModel, HyperPosterior]]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Known:
    """K equally likely states of the machine.

    Attributes
    ----------
    phi : ndarray, shape (K, h) [mm]
    beta : ndarray, shape (K, p)
        Parameters as they may be, inside the truncation; empty when their prior is flat.
    mean, covariance : ndarray, shape (K, p) and (K, p, p)
        What the analysis of all tests will start from at each φ, truncation aside: the prior, or the posterior of tests that
        count as run.
    """

    phi: Array
    beta: Array
    mean: Array
    covariance: Array


def hyper_nodes(model: HybridModel, pilot: Campaign, size: int, seed: int) -> Array:
    """Values of φ, equally likely, shape (size, h) [mm]: of its posterior given the pilot, or of its prior for a plan.

    For a prior their number is rounded up to a power of two. With flat priors variances are σ² times something that does not
    depend on it: one node, the root mean square.
    """
    bound = model.bind(pilot)
    prior = bound.hyper_prior
    if pilot.is_plan:
        points = scipy.stats.qmc.Sobol(len(prior.names), rng=np.random.default_rng(seed))
        nodes = np.asarray(prior.quantile(points.random_base2(int(np.ceil(np.log2(size))))))
    else:
        nodes = prior.phi(_nodes(bound, size, seed))
    return np.sqrt((nodes**2).mean(axis=0, keepdims=True)) if model.prior.flat else nodes


def known_before(model: HybridModel, pilot: Campaign, size: int, seed: int, *, augment: bool) -> Known:
    """States drawn from the pilot's posterior, or from the prior for a plan."""
    bound = model.bind(pilot)
    rng = np.random.default_rng(seed)
    phi = hyper_nodes(model, pilot, size, seed)
    count, p = len(phi), len(bound.names)
    if model.prior.flat:
        return Known(phi, np.zeros((count, 0)), np.zeros((count, p)), np.full((count, p, p), np.inf))
    if pilot.is_plan:
        beta = draw_parameters(bound, count, rng)
    else:
        beta = draw_parameters_given(_posterior(bound), bound.hyper_prior.free(phi), rng)
    if augment and not pilot.is_plan:
        _, given = bound.given(phi)
        spread = given.spread()
        return Known(phi, beta, given.mean, spread @ np.swapaxes(spread, 1, 2))
    prior = np.broadcast_to(np.diag(bound.prior_sd**2), (count, p, p))
    return Known(phi, beta, np.broadcast_to(bound.prior_mean, (count, p)), prior)


def narrowed(bound: BoundModel, known: Known, covariance: Array, seed: int) -> Array:
    """Expected posterior variances inside the truncation, shape (p,), from those without it, (K, p, p).

    States that the new tests' forces rule out are left aside. For every state the mean m that the analysis would find is drawn,
    m | β ~ N(m₁ + W (β − m₁), G − W G) with G = C₁ − C the variance gained and W = G C₁⁻¹, and the truncated Gaussian about it is
    taken.
    """
    plain = np.einsum("kii->ki", covariance).mean(axis=0)
    if not bound.truncation.active:
        return np.asarray(plain)
    possible = bound.truncation.holds(known.beta)
    if possible.any():
        known = replace(
            known,
            phi=known.phi[possible],
            beta=known.beta[possible],
            mean=known.mean[possible],
            covariance=known.covariance[possible],
        )
        covariance = covariance[possible]
    scale = bound.scale
    before = known.covariance / np.outer(scale, scale)
    after = covariance / np.outer(scale, scale)
    gained = before - after
    weight = np.swapaxes(np.linalg.solve(before, gained), 1, 2)
    mean = known.mean / scale + np.einsum("kij,kj->ki", weight, (known.beta - known.mean) / scale)
    root = singular_root(gained - weight @ gained)
    spread = singular_root(after) * scale[:, None]
    rng = np.random.default_rng(seed)
    variances = []
    for _ in range(_REPEATS):
        drawn = scale * (mean + np.einsum("kij,kj->ki", root, rng.standard_normal(mean.shape)))
        shift, inside, axes = bound.truncation.orthants(drawn, spread).moments()
        along = spread @ np.swapaxes(axes, 1, 2)
        change = np.einsum("kpd,kde,kpe->kp", along, inside - np.eye(shift.shape[1]), along)
        variances.append(change.mean(axis=0))
    return np.asarray(np.maximum(plain + np.mean(variances, axis=0), 0.0))


def _nodes(bound: BoundModel, size: int, seed: int) -> Array:
    return _posterior(bound).brief.pick(size, np.random.default_rng(seed))


def _posterior(bound: BoundModel) -> HyperPosterior:
    """p(φ | pilot), computed once while the pilot lives."""
    kept = _KEPT.setdefault(bound.campaign, [])
    found = next((posterior for model, posterior in kept if model == bound.model), None)
    if found is None:
        found = HyperPosterior(bound, truncated=bound.truncation.active)
        kept.append((bound.model, found))
    return found
