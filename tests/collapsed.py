"""A third route to the posterior: β integrated out, importance sampling over φ from a wide t, exact
draws of β given φ."""

from __future__ import annotations

import numpy as np
from scipy import stats

from ldbb_bayes.inference.nodes import HyperPosterior, draw_parameters_given

_WIDER = 1.3
_FREEDOM = 4
_PROPOSALS = 8


def collapsed(posterior: HyperPosterior, size: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Draws of β (size, p) and φ (size, h): no lattice, no Markov chain. Few φ are drawn more than
    once."""
    rng = np.random.default_rng(seed)
    root = posterior.modes[0][1]
    proposal = stats.multivariate_t(posterior.mode, _WIDER**2 * root @ root.T, _FREEDOM, seed=rng)
    free = proposal.rvs(_PROPOSALS * size).reshape(-1, len(posterior.mode))
    parts = [posterior.log_density(part) for part in np.array_split(free, len(free) // 256 + 1)]
    ratio = np.concatenate(parts) - proposal.logpdf(free)
    weight = np.exp(ratio - ratio.max())
    picked = free[rng.choice(len(free), size, p=weight / weight.sum())]
    return draw_parameters_given(posterior, picked, rng), posterior.bound.hyper_prior.phi(picked)
