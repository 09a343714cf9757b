"""Collapsed sampling: the hyper-parameters alone, then β from its exact conditional Gaussian inside the truncation.

p(φ | y, T) ∝ p(y | φ) p(φ) P(T | y, φ), all linear parameters integrated out; then β ~ p(β | y, φ, T). Exact, and
the check of the joint sampler.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.ensemble import BlockStore, EnsembleRun, Progress, run_ensembles
from ldbb_bayes.inference.quadrature import HyperPosterior, conditional_draws
from ldbb_bayes.inference.stopping import Assessment, StoppingRule

__all__ = ["draw_parameters_given", "sample_collapsed"]

Array = NDArray[Any]
_WALKERS = 128
_ROUNDS = 20


@dataclass(frozen=True, eq=False)
class HyperRedraw:
    """φ anew, in free coordinates, from the cells of a lattice."""

    start: HyperPosterior

    def draw(self, size: int, random: np.random.RandomState) -> tuple[Array, Array, Array]:
        """Points (size, h), the log density they were drawn with and that of the target."""
        free = self.start.coarse.draw(size, random)
        return free, self.log_density(free), self.start.log_density(free)

    def log_density(self, points: Array) -> Array:
        """Log density with which the points would be drawn."""
        return self.start.coarse.log_proposal(points)


def sample_collapsed(
    start: HyperPosterior,
    *,
    assess: Callable[[Array], Assessment],
    ensembles: int = 4,
    walkers: int | None = None,
    rule: StoppingRule,
    seed: np.random.SeedSequence,
    progress: Callable[[Progress], None] | None = None,
    store: BlockStore | None = None,
) -> tuple[EnsembleRun, Array, Array]:
    """Draws of (β, φ).

    Parameters
    ----------
    start : HyperPosterior
        Of the model, truncated where the model is; also the density that is sampled.

    Returns
    -------
    run : EnsembleRun
        Its assessment covers β and φ (φ alone where that has not converged).
    beta : ndarray, shape (ensembles, draws, p)
    phi : ndarray, shape (ensembles, draws, h) [mm]

    Raises
    ------
    InputError
        For fewer than 4 ensembles or too few walkers.
    """
    count = walkers or _WALKERS
    d = len(start.mode)
    if ensembles < 4:
        raise InputError(f"ensembles must be at least 4, got {ensembles}. R-hat needs independent chains.")
    if count < 2 * d + 2 or count % 2:
        raise InputError(
            f"walkers must be even and at least {2 * d + 2} for {d} hyper-parameters, got {count}. Use more walkers."
        )
    starting, sampling, drawing = seed.spawn(3)
    starts = np.stack([start.draw(count, np.random.default_rng(child), temperature=1.5) for child in starting.spawn(ensembles)])
    drawn: list[Array] = []

    def complete(chain: Array) -> Array:
        """With β, once the hyper-parameters have converged: they are what mixes slowly."""
        drawn[:] = [_with_parameters(start, chain, np.random.default_rng(drawing))]
        return drawn[0]

    run = run_ensembles(
        start.log_density,
        starts,
        assess,
        rule=rule,
        seed=sampling,
        progress=progress,
        redraw=HyperRedraw(start),
        store=store,
        complete=complete,
    )
    everything = drawn[0] if run.converged else _with_parameters(start, run.chain, np.random.default_rng(drawing))
    return run, everything[..., :-d], start.bound.hyper_prior.phi(run.chain)


def _with_parameters(start: HyperPosterior, chain: Array, rng: np.random.Generator) -> Array:
    """(β, φ) of a chain of free coordinates."""
    beta = draw_parameters_given(start, chain.reshape(-1, chain.shape[2]), rng).reshape(*chain.shape[:2], -1)
    return np.concatenate([beta, chain], axis=2)


def draw_parameters_given(start: HyperPosterior, free: Array, rng: np.random.Generator) -> Array:
    """β given each φ, shape (w, p): exact conditional draws, repeated until all are inside the truncation.

    Raises
    ------
    InputError
        When rounds of exact rejection leave some undrawn: the readings leave no room inside the truncation.
    """
    beta, accepted = conditional_draws(start.bound, free, rng)
    for _ in range(_ROUNDS):
        if accepted.all():
            return beta
        missing = np.flatnonzero(~accepted)
        beta[missing], accepted[missing] = conditional_draws(start.bound, free[missing], rng)
    if accepted.all():
        return beta
    raise InputError(
        "the posterior must leave room inside the truncation, got draws that never fall into it. The readings contradict "
        "non-negative compliance: check signs, mount compensation and forces, or fit --without truncation."
    )
