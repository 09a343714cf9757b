"""Independent draws by quadrature: nodes of φ drawn by their weights, then β from its exact conditional."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.inference.collapsed import draw_parameters_given
from ldbb_bayes.inference.ensemble import Assessment, EnsembleRun, Progress, StoppingRule
from ldbb_bayes.inference.quadrature import HyperPosterior

__all__ = ["sample_quadrature"]

Array = NDArray[Any]
_CHAINS = 4
_NODES = 4096
_MOST_NODES = 1 << 17


def sample_quadrature(
    start: HyperPosterior,
    *,
    assess: Callable[[Array], Assessment],
    rule: StoppingRule,
    seed: np.random.SeedSequence,
    progress: Callable[[Progress], None] | None = None,
) -> tuple[EnsembleRun, Array, Array]:
    """Draws of (β, φ) in four chains.

    Nodes are doubled until their effective number (Kish) is at least twice the target; the draws share nodes in proportion to the
    weights, so that no more is asked of them than the nodes hold.

    Returns
    -------
    run : EnsembleRun
        ``steps`` counts the nodes, ``acceptance`` is their effective share.
    beta : ndarray, shape (4, draws, p)
    phi : ndarray, shape (4, draws, h) [mm]
    """
    rng = np.random.default_rng(seed)
    size = _NODES
    while True:
        free, log_weight = start.nodes(size)
        weight = np.exp(log_weight - log_weight.max())
        effective = float(weight.sum() ** 2 / (weight**2).sum())
        if effective >= 2.0 * rule.ess or size >= _MOST_NODES:
            break
        size *= 2
    total = _CHAINS * int(np.ceil(1.3 * rule.ess / _CHAINS + 50))
    picked = free[_systematic(weight / weight.sum(), total, rng)]
    chain = rng.permutation(picked).reshape(_CHAINS, total // _CHAINS, -1)
    beta = draw_parameters_given(start, chain.reshape(total, -1), rng).reshape(*chain.shape[:2], -1)
    assessment = assess(np.concatenate([beta, chain], axis=2))
    if progress is not None:
        progress(Progress(size, _MOST_NODES, rule.ess, assessment))
    converged = assessment.meets(rule, walkers=0) and effective >= rule.ess
    run = EnsembleRun(chain, assessment, converged, size, 1, effective / size)
    return run, beta, start.bound.hyper_prior.phi(chain)


def _systematic(weight: Array, size: int, rng: np.random.Generator) -> Array:
    """Indices drawn in proportion to the weights by systematic resampling."""
    places = (rng.random() + np.arange(size)) / size
    return np.minimum(np.searchsorted(np.cumsum(weight), places), len(weight) - 1)
