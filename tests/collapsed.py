"""A third route to the posterior: β integrated out, importance sampling over φ from a wide t, exact
draws of β given φ."""

from __future__ import annotations

import numpy as np
from scipy import stats

from ldbb_bayes.inference.conditional_sampling import draw_parameters_given
from ldbb_bayes.inference.hyper_posterior import HyperPosterior

# The proposal is a Student t this many times as wide as the posterior at its mode.
_WIDTH = 1.3
_FREEDOM = 4
# Proposals for every draw.
_PROPOSALS = 8


def collapsed(posterior: HyperPosterior, size: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Draws of β (size, p) and φ (size, h): no lattice, no Markov chain. Few φ are drawn more than
    once."""
    rng = np.random.default_rng(seed)
    root = posterior.modes[0][1]
    shape = _WIDTH**2 * root @ root.T
    proposal = stats.multivariate_t(posterior.mode, shape, _FREEDOM, seed=rng)
    free = proposal.rvs(_PROPOSALS * size).reshape(-1, len(posterior.mode))
    chunks = np.array_split(free, len(free) // 256 + 1)
    log_density = np.concatenate([posterior.log_density(chunk) for chunk in chunks])
    log_ratio = log_density - proposal.logpdf(free)
    weight = np.exp(log_ratio - log_ratio.max())
    chosen = free[rng.choice(len(free), size, p=weight / weight.sum())]
    return draw_parameters_given(posterior.bound, chosen, rng), posterior.bound.hyper_prior.phi(
        chosen
    )
