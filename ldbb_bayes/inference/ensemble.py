"""Independent emcee ensembles, run until every parameter is known well enough. The only importer of emcee.

Walkers of one ensemble are not independent chains: each ensemble counts as one chain, its walkers laid end to end.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import emcee
import numpy as np
from numpy.typing import NDArray

__all__ = ["Assessment", "EnsembleRun", "Progress", "StoppingRule", "run_ensembles"]

Array = NDArray[Any]


@dataclass(frozen=True)
class StoppingRule:
    """When to stop: every parameter has bulk and tail ESS ≥ ``ess`` and R-hat ≤ ``rhat``, or ``max_steps`` are spent.

    Attributes
    ----------
    ess, rhat : float
    max_steps : int
        Steps of each ensemble.
    block : int
        Steps between two looks.
    thin : int
        Steps between two stored draws.
    discard : float
        Share of the stored draws given up as burn-in at every look.
    lengths : float
        The kept part must also be this many autocorrelation times long, as implied by the smallest bulk ESS: an ensemble that
        has hardly moved can look well mixed.
    """

    ess: float = 1000.0
    rhat: float = 1.01
    max_steps: int = 20_000
    block: int = 200
    thin: int = 20
    discard: float = 0.25
    lengths: float = 6.0


@dataclass(frozen=True)
class Assessment:
    """The worst ESS and R-hat over all parameters."""

    ess_bulk_min: float
    ess_tail_min: float
    rhat_max: float

    def meets(self, rule: StoppingRule, *, walkers: int) -> bool:
        """Whether the target is reached by this many walkers in all; false when a diagnostic is not a number."""
        enough = self.ess_bulk_min >= rule.ess and self.ess_tail_min >= rule.ess and self.rhat_max <= rule.rhat
        return enough and self.ess_bulk_min >= rule.lengths * walkers


@dataclass(frozen=True)
class Progress:
    """What a run reports at every look."""

    steps: int
    max_steps: int
    target_ess: float
    assessment: Assessment


@dataclass(frozen=True, eq=False)
class EnsembleRun:
    """The outcome.

    Attributes
    ----------
    chain : ndarray, shape (ensembles, draws, d)
        Walker-major: walker 0's draws, then walker 1's, …
    assessment : Assessment
    converged : bool
    steps, walkers : int
        Of each ensemble.
    acceptance : float
        Mean acceptance fraction.
    """

    chain: Array
    assessment: Assessment
    converged: bool
    steps: int
    walkers: int
    acceptance: float


def run_ensembles(
    log_density: Callable[[Array], Array],
    starts: Array,
    assess: Callable[[Array], Assessment],
    *,
    rule: StoppingRule,
    seed: np.random.SeedSequence,
    progress: Callable[[Progress], None] | None = None,
) -> EnsembleRun:
    """Run one ensemble per start with differential-evolution moves until the rule is met.

    Parameters
    ----------
    log_density : callable
        (n, d) → (n,); −inf is allowed, NaN is not.
    starts : ndarray, shape (ensembles, walkers, d)
    assess : callable
        Chain (ensembles, draws, d) → Assessment.
    """
    walkers, d = starts.shape[1:]
    moves = [(emcee.moves.DEMove(), 0.9), (emcee.moves.DEMove(gamma0=1.0), 0.1)]
    samplers = [emcee.EnsembleSampler(walkers, d, log_density, vectorize=True, moves=moves) for _ in starts]
    states = [
        emcee.State(start, random_state=np.random.RandomState(child.generate_state(8)).get_state())
        for start, child in zip(starts, seed.spawn(len(starts)), strict=True)
    ]
    steps = 0
    while True:
        for k, sampler in enumerate(samplers):
            with _interrupt_afterwards():
                states[k] = sampler.run_mcmc(states[k], rule.block // rule.thin, thin_by=rule.thin, skip_initial_state_check=True)
        steps += rule.block
        drop = int(rule.discard * (steps // rule.thin))
        chain = np.stack([_walker_major(sampler.get_chain()[drop:]) for sampler in samplers])
        assessment = assess(chain)
        if progress is not None:
            progress(Progress(steps, rule.max_steps, rule.ess, assessment))
        converged = assessment.meets(rule, walkers=len(samplers) * walkers)
        if converged or steps >= rule.max_steps:
            acceptance = float(np.mean([sampler.acceptance_fraction.mean() for sampler in samplers]))
            return EnsembleRun(chain, assessment, converged, steps, walkers, acceptance)


@contextmanager
def _interrupt_afterwards() -> Iterator[None]:
    """Let a block of steps end before an interruption is raised; emcee would print the walkers' coordinates instead."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    seen: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: seen.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if seen:
        raise KeyboardInterrupt


def _walker_major(chain: Array) -> Array:
    """(steps, walkers, d) → (walkers · steps, d)."""
    return np.swapaxes(chain, 0, 1).reshape(-1, chain.shape[2])
