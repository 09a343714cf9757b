"""Log densities sampled by ensembles of walkers until there are enough draws.

The only importer of emcee; it knows nothing of circles.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import emcee
import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.inference.diagnostics import diagnose
from ldbb_bayes.results import Array, Shown

__all__ = [
    "Assessment",
    "BlockPlan",
    "EnsembleRun",
    "Progress",
    "Redraw",
    "StoppingRule",
    "WeightedPoints",
    "assess",
    "run_ensembles",
]

# Blocks double in length after so many of one length ...
_BLOCKS_PER_LENGTH = 4
# ... but at most so often,
_LARGEST_DOUBLING = 5
# and from the third doubling on the steps between stored draws double instead.
_DOUBLINGS_STORED = 2
# Share of differential-evolution moves of factor 1, which jump between modes.
_JUMP_SHARE = 0.1
# Share of moves that draw independent points, where there is something to draw them from.
_REDRAW_SHARE = 0.9
# So many draws of each ensemble are kept at most, unless the ESS asked for needs more.
_MOST_DRAWS = 25_000
# Independent points drawn at a time.
_STOCK = 512


class BlockPlan(NamedTuple):
    """How a block of steps is stored."""

    draws: int  #: stored draws
    thin: int  #: steps between them


@dataclass(frozen=True)
class StoppingRule(Shown):
    """When to stop sampling.

    Every parameter has bulk and tail ESS ≥ ``ess`` and R-hat ≤ ``rhat``, or ``max_steps`` are
    spent.
    """

    ess: float = 1000.0
    rhat: float = 1.01
    max_steps: int = 20_000  #: of each ensemble
    #: steps between the first looks; later ones are further apart, and of a long run not every step
    #: is stored
    block: int = 20
    discard: float = 0.25  #: share of the stored draws given up as burn-in at every look
    #: The kept draws must also span this many autocorrelation times, as implied by the smallest
    #: bulk ESS: an ensemble that has hardly moved can look well mixed.
    lengths: float = 6.0

    def next_block(self, steps: int) -> BlockPlan:
        """Return how the block after so many steps is stored; the target does not enter."""
        blocks = steps / (_BLOCKS_PER_LENGTH * self.block)
        doublings = min(int(np.log2(1.0 + blocks)), _LARGEST_DOUBLING)
        thin = 2 ** max(doublings - _DOUBLINGS_STORED, 0)
        return BlockPlan(self.block * 2**doublings // thin, thin)


@dataclass(frozen=True)
class Assessment:
    """The worst ESS and R-hat over all parameters."""

    ess_bulk_min: float
    ess_tail_min: float
    rhat_max: float
    worst: int = 0  #: position of the parameter with the smallest ESS

    def meets(self, rule: StoppingRule, *, walkers: int) -> bool:
        """Return whether so many walkers in all (0: independent draws) reach the target.

        False where a diagnostic is not a number.
        """
        return self.share(rule, walkers=walkers) >= 1.0 and self.rhat_max <= rule.rhat

    def share(self, rule: StoppingRule, *, walkers: int) -> float:
        """Return the share reached of the sample sizes asked for."""
        shares = [self.ess_bulk_min / rule.ess, self.ess_tail_min / rule.ess]
        if walkers > 0:
            shares.append(self.ess_bulk_min / (rule.lengths * walkers))
        return min(shares)


@dataclass(frozen=True)
class Progress:
    """What a run reports at every look."""

    steps: int
    max_steps: int
    target_ess: float
    assessment: Assessment
    seconds_left: float | None = None  #: an estimate; None while there is nothing to go by


@dataclass(frozen=True, eq=False)
class EnsembleRun:
    """Draws of a run, and how it went."""

    chain: Array  #: (ensembles, draws, d), walker-major
    assessment: Assessment
    converged: bool
    steps: int  #: of each ensemble
    walkers: int  #: of each ensemble
    acceptance: float  #: mean acceptance fraction


class WeightedPoints(NamedTuple):
    """Independent points with their importance weights."""

    points: Array  #: (size, d)
    log_weight: Array  #: ln of target over proposal, (size,)
    log_target: Array  #: ln of the target density, (size,)


class Redraw(Protocol):
    """A source of independent points near the target."""

    def draw(self, size: int, random: np.random.RandomState) -> WeightedPoints:
        """Return so many independent points."""

    def log_weight(self, points: Array) -> Array:
        """Return ln of target over proposal at any points, shape (n,)."""


def assess(chain: Array) -> Assessment:
    """Return the worst diagnostics over the last axis of a chain (chains, draws, d)."""
    bulk, tail, rhat = diagnose(chain)
    worst = int(np.argmin(np.minimum(bulk, tail)))
    return Assessment(float(bulk.min()), float(tail.min()), float(rhat.max()), worst)


def run_ensembles(
    log_density: Callable[[Array], Array],
    starts: Array,
    *,
    rule: StoppingRule,
    seed: np.random.SeedSequence,
    progress: Callable[[Progress], None] | None = None,
    redraw: Redraw | None = None,
) -> EnsembleRun:
    """Run one ensemble per start until the rule is met.

    Moves are differential evolution, mixed with independent draws from ``redraw``.

    Parameters
    ----------
    log_density : callable
        Maps (n, d) to (n,); −inf is allowed, NaN is not.
    starts : array, shape (ensembles, walkers, d)
    rule : StoppingRule
        Most looks assess only the coordinate that was worst at the look before.
    seed : SeedSequence
    progress : callable, optional
        Called with a `Progress` at every look.
    redraw : Redraw, optional
        Source of independent points.

    Returns
    -------
    EnsembleRun
    """
    walkers = starts.shape[1]
    all_walkers = len(starts) * walkers
    ensembles = [
        _Ensemble(log_density, start, child, redraw)
        for start, child in zip(starts, seed.spawn(len(starts)), strict=True)
    ]
    clock = time.perf_counter()
    blocks: list[_StoredBlock] = []
    acceptances: list[float] = []
    steps = 0
    worst: int | None = None
    while True:
        plan = rule.next_block(steps)
        draws = np.stack([ensemble.run(plan) for ensemble in ensembles])
        blocks.append(_StoredBlock(plan.thin, draws))
        acceptances.append(float(np.mean([ensemble.acceptance for ensemble in ensembles])))
        steps += plan.draws * plan.thin
        following = rule.next_block(steps)
        is_last = steps + following.draws * following.thin > rule.max_steps
        chain = _kept_draws(blocks, rule)
        assessment = None
        if worst is not None and not is_last:
            assessment = replace(assess(chain[..., [worst]]), worst=worst)
        if assessment is None or assessment.meets(rule, walkers=all_walkers):
            assessment = assess(chain)
        worst = assessment.worst
        if progress is not None:
            elapsed = time.perf_counter() - clock
            seconds_left = _seconds_left(assessment, rule, steps, all_walkers, elapsed)
            progress(Progress(steps, rule.max_steps, rule.ess, assessment, seconds_left))
        converged = assessment.meets(rule, walkers=all_walkers)
        if converged or is_last:
            acceptance = float(np.mean(acceptances))
            return EnsembleRun(chain, assessment, converged, steps, walkers, acceptance)


def _seconds_left(
    assessment: Assessment, rule: StoppingRule, steps: int, walkers: int, elapsed: float
) -> float | None:
    """Return the time until the target is reached at the present pace, or the steps are spent."""
    share = assessment.share(rule, walkers=walkers)
    if not share > 0.0:
        return None
    steps_left = min(steps / share, rule.max_steps) - steps
    return max(steps_left, 0.0) * elapsed / steps


class _Ensemble:
    """One ensemble of walkers, run block by block."""

    def __init__(
        self,
        log_density: Callable[[Array], Array],
        start: Array,
        seed: np.random.SeedSequence,
        redraw: Redraw | None,
    ) -> None:
        walkers, dimensions = start.shape
        self._sampler = emcee.EnsembleSampler(
            walkers, dimensions, log_density, vectorize=True, moves=_moves(redraw)
        )
        # emcee wraps the function in one that prints all walkers when a run is interrupted.
        self._sampler.log_prob_fn = log_density
        twister: Any = np.random.RandomState(seed.generate_state(8)).get_state()
        self._state = emcee.State(start, random_state=twister)
        self.acceptance = 0.0  #: of the last block

    def run(self, plan: BlockPlan) -> Array:
        """Run the next block and return the stored draws, (draws, walkers, d)."""
        self._sampler.reset()
        self._state = self._sampler.run_mcmc(
            self._state, plan.draws, thin_by=plan.thin, skip_initial_state_check=True
        )
        proposals = plan.draws * self._sampler.nwalkers
        self.acceptance = self._sampler.backend.accepted.sum() / proposals
        chain: Array = self._sampler.get_chain()
        return chain


def _moves(redraw: Redraw | None) -> list[tuple[Any, float]]:
    """Return the moves of an ensemble, each with its share."""
    moves = [
        (emcee.moves.DEMove(), 1.0 - _JUMP_SHARE),
        (emcee.moves.DEMove(gamma0=1.0), _JUMP_SHARE),
    ]
    if redraw is None:
        return moves
    walks = [(move, (1.0 - _REDRAW_SHARE) * share) for move, share in moves]
    return [(RedrawMove(redraw), _REDRAW_SHARE), *walks]


class _StoredBlock(NamedTuple):
    """Stored draws of all ensembles."""

    thin: int  #: steps between draws
    draws: Array  #: (ensembles, draws, walkers, d)


def _kept_draws(blocks: list[_StoredBlock], rule: StoppingRule) -> Array:
    """Return the draws after burn-in, (ensembles, draws, d), walker-major.

    Their spacing is that of the last block, wider where there are very many.
    """
    spacing = blocks[-1].thin
    evenly_spaced = []
    for block in blocks:
        stride = spacing // block.thin
        evenly_spaced.append(block.draws[:, stride - 1 :: stride])
    draws = np.concatenate(evenly_spaced, axis=1)
    after_burn_in = draws[:, int(rule.discard * draws.shape[1]) :]
    ensembles, steps, walkers, dimensions = after_burn_in.shape
    limit = max(_MOST_DRAWS, int(2.0 * rule.ess / ensembles))
    stride = -(-steps * walkers // limit)
    thinned = after_burn_in[:, (steps - 1) % stride :: stride]
    return np.swapaxes(thinned, 1, 2).reshape(ensembles, -1, dimensions)


class RedrawMove:
    """Independent proposals for all walkers (Tierney 1994).

    A proposal is accepted with probability min(1, ratio of weights, there over here); a weight is
    target over proposal.
    """

    def __init__(self, redraw: Redraw) -> None:
        self._redraw = redraw
        self._stock: WeightedPoints | None = None
        # Of the state after the last proposal: walkers, and their log weights.
        self._last_coordinates = np.zeros(0)
        self._last_log_weight = np.zeros(0)

    def propose(self, model: Any, state: Any) -> tuple[Any, NDArray[np.bool_]]:
        """Return the next state of the ensemble, and whose proposals were accepted."""
        walkers = len(state.coords)
        log_weight = self._log_weight_of(state.coords)
        proposed = self._take(walkers, model.random)
        log_uniform = np.log(model.random.random_sample(walkers))
        accepted = log_uniform < proposed.log_weight - log_weight
        state.coords[accepted] = proposed.points[accepted]
        state.log_prob[accepted] = proposed.log_target[accepted]
        self._last_coordinates = state.coords.copy()
        self._last_log_weight = np.where(accepted, proposed.log_weight, log_weight)
        return state, accepted

    def _log_weight_of(self, coordinates: Array) -> Array:
        """Return log weights of the walkers; new ones only where another move displaced them."""
        displaced = np.ones(len(coordinates), dtype=bool)
        if self._last_coordinates.size:
            displaced = (coordinates != self._last_coordinates).any(axis=1)
        log_weight = np.resize(self._last_log_weight, len(coordinates))
        if displaced.any():
            log_weight[displaced] = self._redraw.log_weight(coordinates[displaced])
        return log_weight

    def _take(self, size: int, random: np.random.RandomState) -> WeightedPoints:
        """Return so many points from the stock, which is filled as needed."""
        stock = self._stock
        while stock is None or len(stock.points) < size:
            fresh = self._redraw.draw(_STOCK, random)
            if stock is None:
                stock = fresh
            else:
                stock = WeightedPoints(
                    np.concatenate([stock.points, fresh.points]),
                    np.concatenate([stock.log_weight, fresh.log_weight]),
                    np.concatenate([stock.log_target, fresh.log_target]),
                )
        self._stock = WeightedPoints(
            stock.points[size:], stock.log_weight[size:], stock.log_target[size:]
        )
        return WeightedPoints(stock.points[:size], stock.log_weight[:size], stock.log_target[:size])
