"""Independent emcee ensembles, run until every parameter is known well enough. The only importer of emcee.

Walkers of one ensemble are not independent chains: each ensemble counts as one chain, its walkers laid end to end. A run is a
sequence of blocks, each a function of the one before it: blocks kept in a checkpoint need not be run again.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

import emcee
import numpy as np
from numpy.typing import NDArray

__all__ = ["Assessment", "Block", "BlockStore", "EnsembleRun", "Progress", "Redraw", "StoppingRule", "run_ensembles"]

Array = NDArray[Any]
_JUMP = 0.1
_REDRAWN = 0.85
_MOST_DRAWS = 25_000
_BLOCKS_A_LEVEL = 4
_MOST_DOUBLINGS = 5


@dataclass(frozen=True)
class StoppingRule:
    """When to stop: every parameter has bulk and tail ESS ≥ ``ess`` and R-hat ≤ ``rhat``, or ``max_steps`` are spent.

    Attributes
    ----------
    ess, rhat : float
    max_steps : int
        Steps of each ensemble.
    block : int
        Draws stored between two looks. At first every step is stored, later every second, fourth, … of longer blocks.
    discard : float
        Share of the stored draws given up as burn-in at every look.
    lengths : float
        The kept part must also be this many autocorrelation times long, as implied by the smallest bulk ESS: an ensemble that
        has hardly moved can look well mixed.
    """

    ess: float = 1000.0
    rhat: float = 1.01
    max_steps: int = 20_000
    block: int = 20
    discard: float = 0.25
    lengths: float = 6.0

    def thin(self, steps: int) -> int:
        """Steps between stored draws in the block that follows so many; a power of two. The target does not enter."""
        doublings = int(np.log2(1.0 + steps / (_BLOCKS_A_LEVEL * self.block)))
        return 2 ** min(doublings, _MOST_DOUBLINGS)


@dataclass(frozen=True)
class Assessment:
    """The worst ESS and R-hat over all parameters."""

    ess_bulk_min: float
    ess_tail_min: float
    rhat_max: float

    def meets(self, rule: StoppingRule, *, walkers: int) -> bool:
        """Whether the target is reached by this many walkers in all; false when a diagnostic is not a number."""
        return self.share(rule, walkers=walkers) >= 1.0 and self.rhat_max <= rule.rhat

    def share(self, rule: StoppingRule, *, walkers: int) -> float:
        """How much of the sample sizes asked for there is."""
        shares = (self.ess_bulk_min / rule.ess, self.ess_tail_min / rule.ess)
        return min(shares) if walkers == 0 else min(*shares, self.ess_bulk_min / (rule.lengths * walkers))


class Redraw(Protocol):
    """Independent draws from a density near the target, which can be computed."""

    def draw(self, size: int, random: np.random.RandomState) -> tuple[Array, Array]:
        """Points, shape (size, d), and the log density they were drawn with, shape (size,)."""

    def log_density(self, points: Array) -> Array:
        """Log density with which (n, d) points would be drawn, shape (n,); −inf where none is."""


@dataclass(frozen=True)
class Progress:
    """What a run reports at every look; ``seconds_left`` is an estimate, None while there is nothing to go by."""

    steps: int
    max_steps: int
    target_ess: float
    assessment: Assessment
    seconds_left: float | None = None


@dataclass(frozen=True, eq=False)
class Block:
    """A stretch of a run and the state it ends in.

    Attributes
    ----------
    chain : ndarray, shape (ensembles, draws, walkers, d)
    coords : ndarray, shape (ensembles, walkers, d)
    log_density : ndarray, shape (ensembles, walkers)
    random : ndarray of uint32, shape (ensembles, 624)
        Key of each Mersenne twister.
    position : ndarray of int, shape (ensembles,)
    gauss : ndarray, shape (ensembles, 2)
        Whether a normal number is in store, and which.
    accepted : ndarray of int, shape (ensembles,)
        Proposals accepted in the steps that were stored.
    """

    chain: Array
    coords: Array
    log_density: Array
    random: Array
    position: Array
    gauss: Array
    accepted: Array

    def state(self, k: int) -> emcee.State:
        """The state of one ensemble; without log densities in the empty block a run begins with."""
        twister = ("MT19937", self.random[k], int(self.position[k]), int(self.gauss[k, 0]), float(self.gauss[k, 1]))
        log_density = self.log_density[k] if self.log_density.size else None
        return emcee.State(self.coords[k], log_prob=log_density, random_state=twister)


class BlockStore(Protocol):
    """Where blocks are kept, numbered from 0."""

    def load(self, number: int) -> Block | None:
        """The block of that number, or None."""

    def save(self, number: int, block: Block) -> None:
        """Keep a block for good."""


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
    redraw: Redraw | None = None,
    store: BlockStore | None = None,
) -> EnsembleRun:
    """Run one ensemble per start until the rule is met: differential evolution, mixed with independent draws from ``redraw``.

    Parameters
    ----------
    log_density : callable
        (n, d) → (n,); −inf is allowed, NaN is not.
    starts : ndarray, shape (ensembles, walkers, d)
    assess : callable
        Chain (ensembles, draws, d) → Assessment.
    store : BlockStore, optional
        Blocks found there are taken as they are; new ones are kept there.
    """
    walkers = starts.shape[1]
    block = _first_state(starts, seed)
    parts: list[tuple[int, Array]] = []
    steps, fresh, clock = 0, 0, time.perf_counter()
    accepted: list[float] = []
    while True:
        thin = rule.thin(steps)
        size = rule.block * thin
        kept = store.load(len(parts)) if store is not None else None
        if kept is None:
            block = _run_block(log_density, block, rule.block, thin, redraw)
            fresh += size
            if store is not None:
                store.save(len(parts), block)
        else:
            block, clock = kept, time.perf_counter()
        parts.append((thin, block.chain))
        steps += size
        accepted += [block.accepted.sum() / block.chain[..., 0].size]
        chain = _kept_draws(parts, rule)
        assessment = assess(chain)
        share = assessment.share(rule, walkers=len(starts) * walkers)
        if progress is not None:
            left = _seconds_left(time.perf_counter() - clock, fresh, steps, rule.max_steps, share)
            progress(Progress(steps, rule.max_steps, rule.ess, assessment, left))
        converged = assessment.meets(rule, walkers=len(starts) * walkers)
        if converged or steps + rule.block * rule.thin(steps) > rule.max_steps:
            return EnsembleRun(chain, assessment, converged, steps, walkers, float(np.mean(accepted)))


def _first_state(starts: Array, seed: np.random.SeedSequence) -> Block:
    """An empty block that ends at the starts."""
    twisters: Any = [np.random.RandomState(child.generate_state(8)).get_state() for child in seed.spawn(len(starts))]
    return Block(
        np.zeros((len(starts), 0, *starts.shape[1:])),
        starts,
        np.zeros((len(starts), 0)),
        np.array([twister[1] for twister in twisters]),
        np.array([twister[2] for twister in twisters]),
        np.zeros((len(starts), 2)),
        np.zeros(len(starts), dtype=int),
    )


def _run_block(log_density: Callable[[Array], Array], before: Block, draws: int, thin: int, redraw: Redraw | None) -> Block:
    """The next stretch of every ensemble. Nothing but ``before`` enters it, so that a resumed run is the same to the last bit."""
    results = []
    for k in range(len(before.coords)):
        sampler = emcee.EnsembleSampler(*before.coords.shape[1:], log_density, vectorize=True, moves=_moves(redraw))
        steps = sampler.sample(before.state(k), iterations=draws, thin_by=thin, skip_initial_state_check=True)
        with _interrupt_between_steps() as check:
            for _ in steps:
                check()
        end = sampler.get_last_sample()
        results.append((sampler.get_chain(), end, int(sampler.backend.accepted.sum())))
    return Block(
        np.stack([chain for chain, _, _ in results]),
        np.stack([end.coords for _, end, _ in results]),
        np.stack([end.log_prob for _, end, _ in results]),
        np.array([end.random_state[1] for _, end, _ in results]),
        np.array([end.random_state[2] for _, end, _ in results]),
        np.array([end.random_state[3:] for _, end, _ in results], dtype=float),
        np.array([accepted for _, _, accepted in results]),
    )


def _moves(redraw: Redraw | None) -> list[tuple[emcee.moves.Move, float]]:
    plain = [(emcee.moves.DEMove(), 1.0 - _JUMP), (emcee.moves.DEMove(gamma0=1.0), _JUMP)]
    if redraw is None:
        return plain
    return [(RedrawMove(redraw), _REDRAWN), *((move, (1.0 - _REDRAWN) * share) for move, share in plain)]


def _kept_draws(parts: list[tuple[int, Array]], rule: StoppingRule) -> Array:
    """Draws after burn-in, walker-major, at the spacing of the last block, wider where there are very many."""
    every = np.concatenate([_every(parts[-1][0] // thin, chain) for thin, chain in parts], axis=1)
    kept = every[:, int(rule.discard * every.shape[1]) :]
    most = max(_MOST_DRAWS, int(2.0 * rule.ess / len(kept)))
    stride = -(-kept.shape[1] * kept.shape[2] // most)
    return np.swapaxes(_every(stride, kept), 1, 2).reshape(len(kept), -1, kept.shape[3])


def _every(stride: int, chain: Array) -> Array:
    """The last draw and every stride-th before it."""
    return chain[:, ::-1][:, ::stride][:, ::-1]


def _seconds_left(elapsed: float, fresh: int, steps: int, max_steps: int, share: float) -> float | None:
    """From the steps per second so far, and a sample size that grows with the steps."""
    if fresh == 0 or not share > 0.0:
        return None
    needed = min(steps / share, max_steps) - steps
    return max(needed, 0.0) * elapsed / fresh


class RedrawMove(emcee.moves.RedBlueMove):  # type: ignore[misc]
    """Independent proposals (Tierney 1994): what was drawn last is accepted by how it compares with the target."""

    def __init__(self, redraw: Redraw) -> None:
        super().__init__()
        self._redraw = redraw
        self._known: dict[bytes, float] = {}

    def get_proposal(self, sample: Array, complement: list[Array], random: np.random.RandomState) -> tuple[Array, Array]:
        """Proposals for the walkers of one half, shape (n, d), and ln q(back) − ln q(there), shape (n,)."""
        log_back = self._log_density(sample)
        proposal, log_there = self._redraw.draw(len(sample), random)
        self._known.update(zip((row.tobytes() for row in proposal), log_there.tolist(), strict=True))
        return proposal, log_back - log_there

    def _log_density(self, sample: Array) -> Array:
        """With which each would be drawn: remembered where this move drew it."""
        keys = [row.tobytes() for row in sample]
        found = np.array([self._known.get(key, np.nan) for key in keys])
        unknown = np.isnan(found)
        if unknown.any():
            found[unknown] = self._redraw.log_density(sample[unknown])
            self._known.update(zip((keys[i] for i in np.flatnonzero(unknown)), found[unknown].tolist(), strict=True))
        return found


@contextmanager
def _interrupt_between_steps() -> Iterator[Callable[[], None]]:
    """A check that raises what was interrupted meanwhile; inside a step emcee would print the walkers' coordinates instead."""
    if threading.current_thread() is not threading.main_thread():
        yield lambda: None
        return
    seen: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: seen.append(number))

    def check() -> None:
        if seen:
            raise KeyboardInterrupt

    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, before)
    check()
