"""Sampling from a density by ensembles of walkers until there are enough random draws.

A walker is a point that moves at random through the d coordinates; the points that it visits are
the draws. The sampler is emcee. Steps are run in blocks. After each block, the effective sample
size (ESS) and R-hat of the draws are assessed. A walker may also jump to a point that is drawn
independently of its present point; such a jump is called a redraw.
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

# The sampler runs its steps in blocks. After this number of blocks of equal length, the length is
# doubled.
_BLOCKS_PER_LENGTH = 4
# Largest number of times that the sampler's blocks of steps double in length.
_LARGEST_DOUBLING = 5
# The sampler runs its steps in blocks, and doubles the length of the blocks several times. At the
# first ``_DOUBLINGS_STORED`` doublings, the number of draws that a block stores is doubled too. At
# later doublings, the number of steps between two stored draws is doubled instead.
_DOUBLINGS_STORED = 2
# A move by differential evolution changes the point of a walker by a factor times the difference
# between the points of two other walkers. In this share of such moves, the factor is one, so that
# walkers can jump between modes.
_JUMP_SHARE = 0.1
# This fraction of all moves proposes a new point that does not depend on the walker's present
# point. The new point is drawn from a density similar to the posterior. If no such density is
# available, there are no such moves.
_REDRAW_SHARE = 0.9
# Largest number of draws kept from each ensemble of walkers, unless the required effective sample
# size needs more.
_MOST_DRAWS = 25_000
# Number of independent points that are drawn at once and stored until they are proposed to the
# walkers. When too few points are left, this number of points is drawn again.
_STOCK = 512


class BlockPlan(NamedTuple):
    """Plan of one block of the sampler's steps: how many draws are stored, and how far apart."""

    draws: int  #: number of draws that one block of the sampler's steps stores for each walker
    #: number of steps from one stored draw to the next, in one block of the sampler's steps
    thin: int


@dataclass(frozen=True)
class StoppingRule(Shown):
    """Rule that decides when sampling stops.

    Sampling stops when the following conditions are met:

    - The effective sample sizes for the mean and for the tails of every parameter reach ``ess``.
    - R-hat is at most ``rhat`` for every parameter.
    - The draws span at least ``lengths`` autocorrelation times.

    Sampling also stops when another block of steps would exceed ``max_steps``. R-hat compares the
    variance of all draws with the variance within each chain, and is one after convergence.

    Examples
    --------
    >>> rule = lb.inference.StoppingRule(ess=400)
    >>> posterior = lb.sample(
    ...     lb.HybridModel.first(0), campaign, sampler="independent", rule=rule
    ... )
    >>> bool(lb.summarize(posterior)["ess_bulk"].min() >= 400)
    True
    """

    #: effective sample size that sampling must reach for the mean and for the tails of every
    #: parameter
    ess: float = 1000.0
    rhat: float = 1.01  #: sampling may stop only if R-hat of every parameter is at most this value
    #: limit at which sampling stops in any case: largest number of steps of each ensemble of
    #: walkers or, for independent draws, largest number of draws of each chain
    max_steps: int = 20_000
    #: number of steps of the sampler before its draws are first assessed; later assessments are
    #: further apart. In a long run, not every step is stored as a draw.
    block: int = 20
    #: share of the stored draws that is discarded as burn-in, from the start of the run
    discard: float = 0.25
    #: number of autocorrelation times that the draws after burn-in must span. Without this
    #: condition, an ensemble that has hardly moved could satisfy the limits for R-hat and ESS.
    lengths: float = 6.0

    def next_block(self, steps: int) -> BlockPlan:
        """Return how many draws the next block stores, and how many steps lie between them.

        ``steps`` is the number of steps that the walkers have made before this block. Later blocks
        are longer.
        """
        blocks = steps / (_BLOCKS_PER_LENGTH * self.block)
        doublings = min(int(np.log2(1.0 + blocks)), _LARGEST_DOUBLING)
        thin = 2 ** max(doublings - _DOUBLINGS_STORED, 0)
        return BlockPlan(self.block * 2**doublings // thin, thin)


@dataclass(frozen=True)
class Assessment:
    """Convergence diagnostics of draws: smallest effective sample sizes and largest R-hat."""

    #: smallest effective sample size for the mean, among all parameters and hyper-parameters
    ess_bulk_min: float
    #: smallest effective sample size for the tails, among all parameters and hyper-parameters
    ess_tail_min: float
    rhat_max: float  #: largest R-hat of all parameters and hyper-parameters
    #: index, from 0, of the parameter or hyper-parameter with the smallest effective sample size
    worst: int = 0

    def meets(self, rule: StoppingRule, *, walkers: int) -> bool:
        """Return whether the draws of a sampler meet a stopping rule; False if a diagnostic is NaN.

        The rule states the effective sample sizes and the length that the run must reach, and the
        largest R-hat allowed. ``walkers`` is the number of walkers (points that move at random) of
        all ensembles together, or 0 for independent draws.
        """
        return self.share(rule, walkers=walkers) >= 1.0 and self.rhat_max <= rule.rhat

    def share(self, rule: StoppingRule, *, walkers: int) -> float:
        """Return the effective sample size reached, as a fraction of the one required by ``rule``.

        The effective sample sizes for the mean and for the tails must both reach ``rule.ess``. If
        the draws come from walkers, the run must also be ``rule.lengths`` autocorrelation times
        long; the effective sample size for the mean must therefore reach ``rule.lengths`` times the
        number of walkers. Each effective sample size is divided by the size required, and the
        smallest quotient is returned. ``walkers`` is the number of walkers of all ensembles
        together, or 0 for independent draws.
        """
        shares = [self.ess_bulk_min / rule.ess, self.ess_tail_min / rule.ess]
        if walkers > 0:
            shares.append(self.ess_bulk_min / (rule.lengths * walkers))
        return min(shares)


@dataclass(frozen=True)
class Progress:
    """Report on a running sampler, made each time that its draws are assessed."""

    steps: int  #: number of steps that the sampler has run so far
    max_steps: int  #: largest number of steps that the sampler may run
    #: effective sample size that every parameter must reach before sampling stops
    target_ess: float
    assessment: Assessment
    #: estimated time until the run of the sampler stops [s]; None if it cannot be estimated
    seconds_left: float | None = None


@dataclass(frozen=True, eq=False)
class EnsembleRun:
    """Random draws of a run of the sampler, and how well the run converged."""

    #: random draws that a sampler made, shape (ensembles, draws, d). Each draw is a point with d
    #: coordinates. All draws of a walker are next to each other.
    chain: Array
    assessment: Assessment  #: effective sample sizes and R-hat of the draws of a sampler
    #: whether the draws of a sampler meet the stopping rule (effective sample size and R-hat)
    converged: bool
    #: number of steps that each ensemble of walkers made; for independent draws, the number of
    #: draws of each chain
    steps: int
    walkers: int  #: number of walkers of each ensemble; 1 if the draws are independent
    acceptance: float  #: share of the proposed moves (or independent draws) that were accepted


class WeightedPoints(NamedTuple):
    """Independent random points in d dimensions with their importance weights.

    The points are drawn from a proposal, which is a density similar to the target density. The
    target density is the density from which the sampler is to draw.
    """

    points: Array  #: random points with d coordinates for a sampler, shape (size, d)
    #: log importance weights of the random points, shape (size,). The weight of a point is the
    #: density from which the sampler is to draw, divided by the density from which the point is
    #: drawn, up to a constant factor.
    log_weight: Array
    #: logarithm of the target density, from which a sampler is to draw, at each random point, shape
    #: (size,)
    log_target: Array

    def followed_by(self, other: WeightedPoints) -> WeightedPoints:
        """Return these points, and those of ``other`` after them."""
        return WeightedPoints(
            np.concatenate([self.points, other.points]),
            np.concatenate([self.log_weight, other.log_weight]),
            np.concatenate([self.log_target, other.log_target]),
        )

    def select(self, index: slice) -> WeightedPoints:
        """Return the points that the slice ``index`` selects."""
        return WeightedPoints(self.points[index], self.log_weight[index], self.log_target[index])


class Redraw(Protocol):
    """Source of independent random points, drawn from a density similar to the target density.

    The target density is the density from which the sampler is to draw.
    """

    def draw(self, size: int, random: np.random.RandomState) -> WeightedPoints:
        """Return ``size`` independent random points with their importance weights.

        The weight of a point is the target density, from which the sampler is to draw, divided by
        the density from which the point is drawn.
        """

    def log_weight(self, points: Array) -> Array:
        """Return the log importance weights of n points, shape (n,).

        The weight of a point is the target density, from which the sampler is to draw, divided by
        the density from which `draw` draws. ``points``, shape (n, d), holds n points in d
        dimensions.
        """


def assess(chain: Array) -> Assessment:
    """Return the smallest effective sample sizes and the largest R-hat of d coordinates.

    ``chain`` holds random draws of the coordinates, shape (chains, draws, d).
    """
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
    """Run several ensembles of walkers until a stopping rule ends the run, and return the draws.

    A walker is a point that moves at random through d coordinates; the points that it visits are
    the draws. Walkers move by differential evolution, or jump to independent points from
    ``redraw``.

    Parameters
    ----------
    log_density : callable
        Function that returns the log density, shape (n,), at n points in d dimensions, shape (n,
        d). The log density may be −inf but not NaN.
    starts : array, shape (ensembles, walkers, d)
        Starting points of the walkers.
    rule : StoppingRule
        Rule that decides when to stop. To save time, most assessments consider only one coordinate:
        the one with the smallest effective sample size in an earlier assessment. Before the run
        ends, all coordinates are considered.
    seed : SeedSequence
        Seed of the random numbers.
    progress : callable, optional
        Function called with a `Progress` at every assessment.
    redraw : Redraw, optional
        Source of independent points. Default: walkers move by differential evolution alone.

    Returns
    -------
    EnsembleRun
        Draws of all ensembles after burn-in, and how well they converged.
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
        chain = _draws_after_burn_in(blocks, rule)
        if is_last:
            worst = None
        assessment = _assess_worst_first(chain, worst, rule, all_walkers)
        worst = assessment.worst
        if progress is not None:
            elapsed = time.perf_counter() - clock
            seconds_left = _seconds_left(assessment, rule, steps, all_walkers, elapsed)
            progress(Progress(steps, rule.max_steps, rule.ess, assessment, seconds_left))
        converged = assessment.meets(rule, walkers=all_walkers)
        if converged or is_last:
            acceptance = float(np.mean(acceptances))
            return EnsembleRun(chain, assessment, converged, steps, walkers, acceptance)


def _assess_worst_first(
    chain: Array, worst: int | None, rule: StoppingRule, walkers: int
) -> Assessment:
    """Return an assessment of draws that decides whether they meet a stopping rule.

    If one coordinate alone does not meet the rule, the other coordinates are not assessed, to save
    time. ``worst`` is the index of this coordinate; None if all coordinates are to be assessed in
    any case. ``chain`` holds the draws of d coordinates, shape (chains, draws, d). ``walkers`` is
    the number of walkers of all ensembles together.
    """
    if worst is not None:
        of_worst = replace(assess(chain[..., [worst]]), worst=worst)
        if not of_worst.meets(rule, walkers=walkers):
            return of_worst
    return assess(chain)


def _seconds_left(
    assessment: Assessment, rule: StoppingRule, steps: int, walkers: int, elapsed: float
) -> float | None:
    """Return the estimated time until a run stops [s], or None if it cannot be estimated.

    The run has made ``steps`` steps in ``elapsed`` seconds. ``walkers`` is the number of walkers of
    all ensembles together. ``assessment`` is the assessment of the draws so far, and ``rule``
    decides when the run stops.
    """
    share = assessment.share(rule, walkers=walkers)
    if not share > 0.0:
        return None
    steps_left = min(steps / share, rule.max_steps) - steps
    return max(steps_left, 0.0) * elapsed / steps


class _Ensemble:
    """One ensemble of walkers (points that move at random), run in blocks of steps."""

    def __init__(
        self,
        log_density: Callable[[Array], Array],
        start: Array,
        seed: np.random.SeedSequence,
        redraw: Redraw | None,
    ) -> None:
        """Place the walkers at their starting points, without making a step.

        ``start``, shape (walkers, d), holds the starting points, each with d coordinates.
        ``log_density`` returns the log density at n points, shape (n,), from an array of shape (n,
        d). ``redraw`` is the source of independent points to which walkers may jump, or None.
        ``seed`` is the seed of the random numbers.
        """
        walkers, dimensions = start.shape
        self._sampler = emcee.EnsembleSampler(
            walkers, dimensions, log_density, vectorize=True, moves=_moves(redraw)
        )
        # Restore the log density, because emcee has wrapped it in a function that prints the
        # coordinates of all walkers when a run is interrupted.
        self._sampler.log_prob_fn = log_density
        twister: Any = np.random.RandomState(seed.generate_state(8)).get_state()
        self._state = emcee.State(start, random_state=twister)
        #: share of the walkers' proposed moves that were accepted in the last block of steps
        self.acceptance = 0.0

    def run(self, plan: BlockPlan) -> Array:
        """Run the next block of steps, and return its stored draws, shape (draws, walkers, d).

        The draws are the d coordinates of all walkers (points that move at random) at every stored
        step. ``plan`` says how many steps are run and which of them are stored.
        """
        self._sampler.reset()
        self._state = self._sampler.run_mcmc(
            self._state, plan.draws, thin_by=plan.thin, skip_initial_state_check=True
        )
        proposals = plan.draws * self._sampler.nwalkers
        self.acceptance = self._sampler.backend.accepted.sum() / proposals
        chain: Array = self._sampler.get_chain()
        return chain


def _moves(redraw: Redraw | None) -> list[tuple[Any, float]]:
    """Return the kinds of moves that emcee's walkers make, each with its share of all moves.

    ``redraw`` is the source of points that do not depend on the positions of the walkers. Moves to
    such points are included unless ``redraw`` is None.
    """
    moves = [
        (emcee.moves.DEMove(), 1.0 - _JUMP_SHARE),
        (emcee.moves.DEMove(gamma0=1.0), _JUMP_SHARE),
    ]
    if redraw is None:
        return moves
    walks = [(move, (1.0 - _REDRAW_SHARE) * share) for move, share in moves]
    return [(RedrawMove(redraw), _REDRAW_SHARE), *walks]


class _StoredBlock(NamedTuple):
    """Random draws stored from one block of steps, for all ensembles of walkers (moving points)."""

    thin: int  #: number of steps of the sampler from one stored draw to the next
    #: stored draws of the d coordinates of all walkers, shape (ensembles, draws, walkers, d)
    draws: Array


def _draws_after_burn_in(blocks: list[_StoredBlock], rule: StoppingRule) -> Array:
    """Return the draws of a run after burn-in, evenly thinned, shape (ensembles, draws, d).

    ``blocks`` holds the stored draws of d coordinates, in order of time. In later blocks, more
    steps lie between successive stored draws. The fraction ``rule.discard`` of all draws is left
    out at the start of the run, as burn-in. In the result, all draws of a walker are next to each
    other. The number of steps between successive draws is that of the last block, or larger if
    there are very many draws.
    """
    steps_between_draws = blocks[-1].thin
    evenly_spaced = []
    for block in blocks:
        stride = steps_between_draws // block.thin
        evenly_spaced.append(block.draws[:, stride - 1 :: stride])
    draws = np.concatenate(evenly_spaced, axis=1)
    after_burn_in = draws[:, int(rule.discard * draws.shape[1]) :]
    ensembles, steps, walkers, dimensions = after_burn_in.shape
    most_draws = max(_MOST_DRAWS, int(2.0 * rule.ess / ensembles))
    stride = -(-steps * walkers // most_draws)
    # Of the sampler's stored steps, keep every ``stride``-th one, counted back from the last step.
    # The draws of the last step are then always kept.
    thinned = after_burn_in[:, (steps - 1) % stride :: stride]
    return np.swapaxes(thinned, 1, 2).reshape(ensembles, -1, dimensions)


class RedrawMove:
    """Move of emcee that proposes an independent point to every walker (Tierney 1994).

    The weight of a point is the target density, from which the sampler is to draw, divided by the
    density from which independent points are drawn. A proposed point is accepted with the
    probability min(1, weight of the proposed point / weight of the walker's present point).
    """

    def __init__(self, redraw: Redraw) -> None:
        """Keep ``redraw``, the source of the independent points that are proposed to walkers."""
        self._redraw = redraw
        self._stock: WeightedPoints | None = None
        # Coordinates of all walkers after the last `RedrawMove` (jump of walkers to independent
        # points), and the log importance weights of these coordinates.
        self._last_coordinates = np.zeros(0)
        self._last_log_weight = np.zeros(0)

    def propose(self, model: Any, state: Any) -> tuple[Any, NDArray[np.bool_]]:
        """Return the walkers after this move, and whether each walker accepted its proposal.

        A proposal is accepted with the probability min(1, weight of the proposed point / weight of
        the walker's present point). The coordinates and log densities of walkers that accept are
        changed in ``state`` itself, which is returned.

        ``model`` and ``state`` are the objects that emcee passes to a move: ``model`` holds the
        generator of random numbers, ``state`` the coordinates and log densities of all walkers. The
        acceptances are returned as an array of shape (walkers,).
        """
        walkers = len(state.coords)
        log_weight = self._log_weight_of(state.coords)
        proposed = self._next_independent_points(walkers, model.random)
        log_uniform = np.log(model.random.random_sample(walkers))
        accepted = log_uniform < proposed.log_weight - log_weight
        state.coords[accepted] = proposed.points[accepted]
        state.log_prob[accepted] = proposed.log_target[accepted]
        self._last_coordinates = state.coords.copy()
        self._last_log_weight = np.where(accepted, proposed.log_weight, log_weight)
        return state, accepted

    def _log_weight_of(self, coordinates: Array) -> Array:
        """Return the log importance weights of all walkers, shape (walkers,).

        ``coordinates``, shape (walkers, d), holds the d coordinates of each walker. The weights are
        stored after each `RedrawMove`. They are computed anew only for walkers that have moved
        since then.
        """
        displaced = np.ones(len(coordinates), dtype=bool)
        if self._last_coordinates.size:
            displaced = (coordinates != self._last_coordinates).any(axis=1)
        log_weight = np.resize(self._last_log_weight, len(coordinates))
        if displaced.any():
            log_weight[displaced] = self._redraw.log_weight(coordinates[displaced])
        return log_weight

    def _next_independent_points(self, size: int, random: np.random.RandomState) -> WeightedPoints:
        """Remove ``size`` points from the stored independent points, and return them with weights.

        If too few points are stored, more points are drawn first. ``random`` generates the random
        numbers.
        """
        stock = self._stock
        while stock is None or len(stock.points) < size:
            fresh = self._redraw.draw(_STOCK, random)
            stock = fresh if stock is None else stock.followed_by(fresh)
        self._stock = stock.select(slice(size, None))
        return stock.select(slice(size))
