"""TODO: say what this module is."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from scipy.stats import qmc

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.nodes import HyperPosterior, draw_parameters_given
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.results import Array

__all__ = ["States", "carried", "hyper_nodes", "states_before"]


_KEPT: WeakKeyDictionary[Campaign, list[HyperPosterior]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class States:
    """K equally likely states of the machine: hyper-parameters φ (K, h) [mm], and parameters β (K,
    p) inside the truncation, none when their prior is flat. ``before``, at each φ, untruncated: the
    prior, or the posterior of tests that count as run."""

    phi: Array
    beta: Array
    before: Gaussian


def hyper_nodes(model: HybridModel, pilot: Campaign, size: int, seed: int) -> Array:
    """Values of φ, equally likely, shape (size, h) [mm]: of its posterior given the pilot, or of
    its prior for a plan. For a prior their number is rounded up to a power of two. With flat priors
    variances are σ² times something that does not depend on it: one node, the root mean square."""
    if pilot.is_plan:
        prior = model.bind(pilot).hyper_prior
        points = qmc.Sobol(len(prior.names), rng=np.random.default_rng(seed))
        nodes = np.asarray(prior.quantile(points.random(1 << int(np.ceil(np.log2(size))))))
    else:
        posterior = _posterior(model, pilot)
        nodes = posterior.bound.hyper_prior.phi(
            posterior.brief.pick(size, np.random.default_rng(seed))
        )
    return np.sqrt((nodes**2).mean(axis=0, keepdims=True)) if model.prior.flat else nodes


def carried(bound: BoundModel, phi: Array, run: int) -> Array:
    """φ (K, h) of the pilot for a binding of ``run`` of its circles and of circles to come. These
    have λ = 1, as 1/λ² is one on average; scales that do not act on the pilot are spread over their
    prior."""
    pilot = bound.pilot or bound.campaign
    before = bound if pilot is bound.campaign else _posterior(bound.model, pilot).bound
    place = {name: k for k, name in enumerate(before.hyper_prior.names)}
    circles = dict(
        zip(bound.setting.circle[:run].tolist(), before.setting.circle.tolist(), strict=False)
    )
    levels = np.random.default_rng(0).permuted(
        np.tile((np.arange(len(phi)) + 0.5) / len(phi), (len(bound.hyper_prior.names), 1)), axis=1
    )
    found = bound.hyper_prior.quantile(levels.T)
    for k, (name, law) in enumerate(
        zip(bound.hyper_prior.names, bound.hyper_prior.laws, strict=True)
    ):
        own = circles.get(name, "") if law == "circle" else name
        if own in place:
            found[:, k] = phi[:, place[own]]
        elif law == "circle":
            found[:, k] = 1.0
    return found


def states_before(
    model: HybridModel, pilot: Campaign, size: int, seed: int, *, augment: bool
) -> States:
    """States drawn from the pilot's posterior, or from the prior for a plan."""
    bound = model.bind(pilot)
    rng = np.random.default_rng(seed)
    phi = hyper_nodes(model, pilot, size, seed)
    shape = len(phi), len(bound.names)
    if model.prior.flat:
        return States(
            phi, np.zeros((len(phi), 0)), Gaussian(np.zeros((*shape, shape[1])), np.zeros(shape))
        )
    if pilot.is_plan:
        beta = bound.draw_parameters(len(phi), rng)
    else:
        beta = draw_parameters_given(_posterior(model, pilot), bound.hyper_prior.free(phi), rng)
    if augment and not pilot.is_plan:
        given = bound.given(phi)[1]
        return States(phi, beta, Gaussian.factored(given.mean, given.root, given.scale))
    return States(
        phi,
        beta,
        Gaussian.of(
            np.broadcast_to(bound.prior_mean, shape), np.broadcast_to(bound.prior_sd**2, shape)
        ),
    )


def _posterior(model: HybridModel, pilot: Campaign) -> HyperPosterior:
    """p(φ | pilot), computed once while the pilot lives."""
    kept = _KEPT.setdefault(pilot, [])
    if not any(posterior.bound.model == model for posterior in kept):
        bound = model.bind(pilot)
        kept.append(HyperPosterior(bound, truncated=bound.truncation.active))
    return next(posterior for posterior in kept if posterior.bound.model == model)
