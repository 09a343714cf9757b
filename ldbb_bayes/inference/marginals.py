"""Means, standard deviations and quantiles of every parameter from nodes over the hyper-parameters, without sampling.

What the samplers are compared with.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtr

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.independent import draw_hyper
from ldbb_bayes.inference.lattice import Lattice
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.threads import one_blas_thread

__all__ = ["marginals", "moments", "nodes_that_matter", "quantiles"]

Array = NDArray[Any]
_CHUNK = 256
_SPARE = 1e-7
_COMPONENTS = 8192
_BISECTIONS = 50


@one_blas_thread
def marginals(
    model: HybridModel, campaign: Campaign, *, ci_prob: float = 0.95, tolerance: float = 1e-3, seed: int = 1
) -> pd.DataFrame:
    """The posterior's marginals by quadrature.

    Parameters
    ----------
    ci_prob : float
        Probability of the equal-tailed credible interval.
    tolerance : float
        Relative error of the integrals behind means and standard deviations.
    seed : int
        Of the points behind the quantiles; where a compliance is bounded their standard error is half a per cent of probability.

    Returns
    -------
    DataFrame
        Columns unit, mean, sd, median, ci_low, ci_high; one row per parameter and hyper-parameter, in mm, N, rad.

    Raises
    ------
    InputError
        For a plan, or a probability or tolerance out of range.
    """
    if campaign.is_plan:
        raise InputError("marginals must be asked of a campaign with readings, got a plan. Run the tests, or simulate it.")
    if not 0.0 < ci_prob < 1.0:
        raise InputError(f"ci_prob must lie between 0 and 1, got {ci_prob}. For 95 % give 0.95.")
    if not 0.0 < tolerance < 1.0:
        raise InputError(f"tolerance must lie between 0 and 1, got {tolerance}. For example 1e-3.")
    bound = model.bind(campaign)
    posterior = HyperPosterior(bound, truncated=bound.truncation.active, seed=seed)
    lattice = posterior.lattice(tolerance)
    levels = np.array([0.5, 0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob])
    draws, _ = draw_hyper(posterior, 2 * _COMPONENTS, np.random.default_rng(seed))
    hyper = np.quantile(bound.hyper_prior.phi(draws), levels, axis=0)
    beta = np.vstack([*moments(posterior, lattice), quantiles(posterior, lattice, levels, seed)])
    phi = np.vstack([*_hyper_moments(posterior, lattice), hyper])
    names = [*bound.names, *bound.hyper_prior.names]
    table = pd.DataFrame(np.hstack([beta, phi]).T, index=names, columns=["mean", "sd", "median", "ci_low", "ci_high"])
    table.insert(0, "unit", [*(parameter.unit for parameter in bound.parameters), *("mm" for _ in bound.hyper_prior.names)])
    return table


def moments(posterior: HyperPosterior, lattice: Lattice, *, spare: float = _SPARE) -> tuple[Array, Array]:
    """Mean and sd of β, each (p,): those given φ, exact, averaged over the nodes but for a share ``spare`` of the integral."""
    bound = posterior.bound
    free, weight = nodes_that_matter(lattice, spare)
    means, variances = [], []
    for start in range(0, len(free), _CHUNK):
        _, given = bound.given(bound.hyper_prior.phi(free[start : start + _CHUNK]))
        spread = given.spread()
        mean, variance = given.mean, (spread**2).sum(axis=2)
        if posterior.truncated:
            shift, covariance, axes = given.orthant.moments()
            along = spread @ np.swapaxes(axes, 1, 2)
            mean = mean + np.einsum("wpd,wd->wp", along, shift)
            variance = variance + np.einsum("wpd,wde,wpe->wp", along, covariance - np.eye(shift.shape[1]), along)
        means.append(mean)
        variances.append(variance)
    every = np.concatenate(means)
    mean = weight @ every
    return mean, np.sqrt(weight @ (np.concatenate(variances) + (every - mean) ** 2))


def quantiles(posterior: HyperPosterior, lattice: Lattice, levels: Array, seed: int, *, components: int = _COMPONENTS) -> Array:
    """Quantiles of β, shape (levels, p): of Gaussians given φ and, inside the truncation, given the constrained directions."""
    bound = posterior.bound
    rng = np.random.default_rng(seed)
    free = lattice.pick(components, rng)
    means, sds = [], []
    for start in range(0, len(free), _CHUNK):
        _, given = bound.given(bound.hyper_prior.phi(free[start : start + _CHUNK]))
        spread = given.spread()
        mean, variance = given.mean, (spread**2).sum(axis=2)
        if posterior.truncated:
            x, _ = given.orthant.draw(rng)
            along = spread @ np.swapaxes(given.orthant.axes, 1, 2)
            mean = mean + np.einsum("wpd,wd->wp", along, x)
            variance = np.maximum(variance - (along**2).sum(axis=2), 0.0)
        means.append(mean)
        sds.append(np.sqrt(variance))
    mean, sd = np.concatenate(means), np.concatenate(sds)
    sd = np.maximum(sd, 1e-6 * mean.std(axis=0))
    low = np.broadcast_to((mean - 9.0 * sd).min(axis=0), (len(levels), mean.shape[1]))
    high = np.broadcast_to((mean + 9.0 * sd).max(axis=0), low.shape)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        below = np.stack([ndtr((row - mean) / sd).mean(axis=0) for row in middle]) < levels[:, None]
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)


def _hyper_moments(posterior: HyperPosterior, lattice: Lattice) -> tuple[Array, Array]:
    phi, weight = posterior.bound.hyper_prior.phi(lattice.free), lattice.weight
    mean = weight @ phi
    return mean, np.sqrt(weight @ (phi - mean) ** 2)


def nodes_that_matter(lattice: Lattice, spare: float) -> tuple[Array, Array]:
    """Nodes and normalised weights, but for a share ``spare`` of the integral."""
    weight = lattice.weight
    order = np.argsort(weight)
    matter = np.sort(order[np.cumsum(weight[order]) > spare])
    return lattice.free[matter], weight[matter] / weight[matter].sum()
