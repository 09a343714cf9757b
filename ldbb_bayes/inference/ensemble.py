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

from ldbb_bayes.inference.stopping import Assessment, Looks, StoppingRule

__all__ = ["Block", "BlockStore", "EnsembleRun", "Progress", "Redraw", "run_ensembles"]

Array = NDArray[Any]
_JUMP = 0.1
_REDRAWN = 0.85
_MOST_DRAWS = 25_000
_STOCK = 256


class Redraw(Protocol):
    """Independent draws from a density near the target, which can be computed."""

    def draw(self, size: int, random: np.random.RandomState) -> tuple[Array, Array, Array]:
        """Points, shape (size, d), the log density they were drawn with and that of the target, shape (size,)."""

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
    complete: Callable[[Array], Array] | None = None,
) -> EnsembleRun:
    """Run one ensemble per start until the rule is met: differential evolution, mixed with independent draws from ``redraw``.

    Parameters
    ----------
    log_density : callable
        (n, d) → (n,); −inf is allowed, NaN is not.
    starts : ndarray, shape (ensembles, walkers, d)
    assess : callable
        Chain (ensembles, draws, d) → Assessment. At most looks only of the coordinate that was worst at the last.
    store : BlockStore, optional
        Blocks found there are taken as they are; new ones are kept there.
    complete : callable, optional
        Chain → chain of all that must meet the rule, called once its coordinates do.
    """
    walkers = starts.shape[1]
    block = _first_state(starts, seed)
    parts: list[tuple[int, Array]] = []
    steps, fresh, clock = 0, 0, time.perf_counter()
    count = len(starts) * walkers
    looks = Looks(assess, complete, rule, count)
    accepted: list[float] = []
    while True:
        draws, thin = rule.next_block(steps)
        size = draws * thin
        kept = store.load(len(parts)) if store is not None else None
        if kept is None:
            block = _run_block(log_density, block, draws, thin, redraw)
            fresh += size
            if store is not None:
                store.save(len(parts), block)
        else:
            block, clock = kept, time.perf_counter()
        parts.append((thin, block.chain))
        steps += size
        accepted += [block.accepted.sum() / block.chain[..., 0].size]
        chain = _kept_draws(parts, rule)
        last = steps + int(np.prod(rule.next_block(steps))) > rule.max_steps
        assessment = looks.at(chain, last=last)
        share = assessment.share(rule, walkers=count)
        if progress is not None:
            left = _seconds_left(time.perf_counter() - clock, fresh, steps, rule.max_steps, share)
            progress(Progress(steps, rule.max_steps, rule.ess, assessment, left))
        converged = assessment.meets(rule, walkers=count)
        if converged or last:
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
        anew = RedrawMove(redraw, log_density) if redraw is not None else None
        target = anew.target if anew is not None else log_density
        sampler = emcee.EnsembleSampler(*before.coords.shape[1:], target, vectorize=True, moves=_moves(anew))
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


def _moves(anew: RedrawMove | None) -> list[tuple[emcee.moves.Move, float]]:
    plain = [(emcee.moves.DEMove(), 1.0 - _JUMP), (emcee.moves.DEMove(gamma0=1.0), _JUMP)]
    if anew is None:
        return plain
    return [(anew, _REDRAWN), *((move, (1.0 - _REDRAWN) * share) for move, share in plain)]


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
    """Independent proposals (Tierney 1994): what was drawn last is accepted by how it compares with the target.

    Proposals do not depend on the walkers: they are drawn many at a time, and both their densities are remembered.
    """

    def __init__(self, redraw: Redraw, log_density: Callable[[Array], Array]) -> None:
        super().__init__()
        self._redraw, self._log_density = redraw, log_density
        self._proposed: dict[bytes, float] = {}
        self._targeted: dict[bytes, float] = {}
        self._stock = np.zeros((0, 0))
        self._log_stock = np.zeros(0)

    def get_proposal(self, sample: Array, complement: list[Array], random: np.random.RandomState) -> tuple[Array, Array]:
        """Proposals for the walkers of one half, shape (n, d), and ln q(back) − ln q(there), shape (n,)."""
        log_back = _recall(self._proposed, sample, self._redraw.log_density)
        while len(self._log_stock) < len(sample):
            self._restock(random)
        proposal, log_there = self._stock[: len(sample)], self._log_stock[: len(sample)]
        self._stock, self._log_stock = self._stock[len(sample) :], self._log_stock[len(sample) :]
        return proposal, log_back - log_there

    def target(self, points: Array) -> Array:
        """Log density of the target, shape (n,): remembered where this move drew the points."""
        return _recall(self._targeted, points, self._log_density)

    def _restock(self, random: np.random.RandomState) -> None:
        points, log_proposed, log_target = self._redraw.draw(_STOCK, random)
        keys = _keys(points)
        self._proposed.update(zip(keys, log_proposed.tolist(), strict=True))
        self._targeted.update(zip(keys, log_target.tolist(), strict=True))
        self._stock = np.concatenate([self._stock.reshape(-1, points.shape[1]), points])
        self._log_stock = np.concatenate([self._log_stock, log_proposed])


def _recall(known: dict[bytes, float], points: Array, compute: Callable[[Array], Array]) -> Array:
    """Values of points (n, d), shape (n,): looked up, and computed and remembered where they are new."""
    keys = _keys(points)
    missing = [i for i, key in enumerate(keys) if key not in known]
    if missing:
        known.update(zip([keys[i] for i in missing], compute(points[missing]).tolist(), strict=True))
    return np.array([known[key] for key in keys])


def _keys(points: Array) -> list[bytes]:
    """One key for each row: its bytes."""
    rows = np.ascontiguousarray(points)
    whole = rows.tobytes()
    width = rows.shape[1] * rows.itemsize
    return [whole[i : i + width] for i in range(0, len(whole), width)]


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
