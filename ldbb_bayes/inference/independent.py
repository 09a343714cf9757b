"""Independent draws: φ from the cells of a lattice, thinned to the exact density, then β from its exact conditional."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.collapsed import draw_parameters_given
from ldbb_bayes.inference.ensemble import EnsembleRun, Progress
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.inference.stopping import Assessment, StoppingRule

__all__ = ["draw_hyper", "sample_quadrature"]

Array = NDArray[Any]
_CHAINS = 4
_CHUNK = 256
_ROUNDS = 50
_ENVELOPE = 2.0


def sample_quadrature(
    start: HyperPosterior,
    *,
    assess: Callable[[Array], Assessment],
    rule: StoppingRule,
    seed: np.random.SeedSequence,
    progress: Callable[[Progress], None] | None = None,
) -> tuple[EnsembleRun, Array, Array]:
    """Independent draws of (β, φ) in four chains: a third more than the target, so that the smallest ESS reaches it.

    Returns
    -------
    run : EnsembleRun
        ``steps`` counts the draws of one chain, ``acceptance`` is the share of proposals used.
    beta : ndarray, shape (4, draws, p)
    phi : ndarray, shape (4, draws, h) [mm]
    """
    rng = np.random.default_rng(seed)
    total = _CHAINS * int(np.ceil(1.3 * rule.ess / _CHAINS + 50))
    free, acceptance = draw_hyper(start, total, rng)
    chain = free.reshape(_CHAINS, total // _CHAINS, -1)
    beta = draw_parameters_given(start, free, rng).reshape(*chain.shape[:2], -1)
    assessment = assess(np.concatenate([beta, chain], axis=2))
    if progress is not None:
        progress(Progress(total // _CHAINS, total // _CHAINS, rule.ess, assessment))
    run = EnsembleRun(chain, assessment, assessment.meets(rule, walkers=0), total // _CHAINS, 1, acceptance)
    return run, beta, start.bound.hyper_prior.phi(chain)


def draw_hyper(start: HyperPosterior, size: int, rng: np.random.Generator) -> tuple[Array, float]:
    """Independent draws of free coordinates, shape (size, h), and the share of proposals used.

    Rejection from the coarse lattice. Where the density passes the envelope the proposal is used as often as it is owed.

    Raises
    ------
    InputError
        When almost nothing is accepted: the density is too rough for its lattice.
    """
    lattice = start.coarse
    kept: list[Array] = []
    used, tried = 0, 0
    scale: float | None = None
    for _ in range(_ROUNDS):
        wanted = max(int(1.2 * _ENVELOPE * (size - used)), _CHUNK)
        free = lattice.draw(wanted, rng)
        exact = np.concatenate([start.log_density(part) for part in np.array_split(free, -(-wanted // _CHUNK))])
        ratio = exact - lattice.log_proposal(free)
        if scale is None:
            scale = float(np.logaddexp.reduce(ratio) - np.log(wanted)) + np.log(_ENVELOPE)
        owed = np.exp(ratio - scale)
        times = np.floor(owed) + (rng.random(wanted) < owed % 1.0)
        kept.append(np.repeat(free, times.astype(int), axis=0))
        used, tried = used + len(kept[-1]), tried + wanted
        if used >= size:
            return rng.permutation(np.concatenate(kept))[:size], used / tried
    raise InputError(
        f"the density of the hyper-parameters must be smooth, got {used} of {size} draws from {tried} proposals. "
        "Use --sampler joint."
    )
