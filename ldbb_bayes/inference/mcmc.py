"""Log densities sampled by ensembles of walkers, run until there is enough, knowing no circles. The
only importer of emcee."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.inference.diagnostics import diagnose
from ldbb_bayes.results import Array, Shown

__all__ = [
    "Assessment",
    "EnsembleRun",
    "Progress",
    "Redraw",
    "StoppingRule",
    "assess",
    "run_ensembles",
]

_BLOCKS_A_LEVEL = 4
_MOST_DOUBLINGS = 5
_DOUBLINGS_STORED = 2
_JUMP = 0.1
_REDRAWN = 0.9
_MOST_DRAWS = 25_000
_STOCK = 512


@dataclass(frozen=True)
class StoppingRule(Shown):
    """When to stop: every parameter has bulk and tail ESS ≥ ``ess`` and R-hat ≤ ``rhat``, or
    ``max_steps`` are spent."""

    ess: float = 1000.0
    rhat: float = 1.01
    max_steps: int = 20_000  #: of each ensemble
    #: steps between the first looks; later ones are further apart, and of a long run not every step
    #: is stored
    block: int = 20
    discard: float = 0.25  #: share of the stored draws given up as burn-in at every look
    #: The kept part must also be this many autocorrelation times long, as implied by the smallest bulk ESS: an ensemble that has
    #: hardly moved can look well mixed.
    lengths: float = 6.0

    def next_block(self, steps: int) -> tuple[int, int]:
        """Draws stored in the block that follows so many steps, and steps between them. The target
        does not enter."""
        doublings = min(int(np.log2(1.0 + steps / (_BLOCKS_A_LEVEL * self.block))), _MOST_DOUBLINGS)
        thin = 2 ** max(doublings - _DOUBLINGS_STORED, 0)
        return self.block * 2**doublings // thin, thin


@dataclass(frozen=True)
class Assessment:
    """The worst ESS and R-hat over all parameters; ``worst`` is the number of the one with the
    smallest ESS."""

    ess_bulk_min: float
    ess_tail_min: float
    rhat_max: float
    worst: int = 0

    def meets(self, rule: StoppingRule, *, walkers: int) -> bool:
        """Whether the target is reached by this many walkers in all (0: independent draws); false
        where one is not a number."""
        return self.share(rule, walkers=walkers) >= 1.0 and self.rhat_max <= rule.rhat

    def share(self, rule: StoppingRule, *, walkers: int) -> float:
        """How much of the sample sizes asked for there is."""
        shares = (self.ess_bulk_min / rule.ess, self.ess_tail_min / rule.ess)
        return (
            min(shares)
            if walkers == 0
            else min(*shares, self.ess_bulk_min / (rule.lengths * walkers))
        )


@dataclass(frozen=True)
class Progress:
    """What a run reports at every look; ``seconds_left`` is an estimate, None while there is
    nothing to go by."""

    steps: int
    max_steps: int
    target_ess: float
    assessment: Assessment
    seconds_left: float | None = None


@dataclass(frozen=True, eq=False)
class EnsembleRun:
    """A chain (ensembles, draws, d), walker-major; steps and walkers of each ensemble; and the mean
    acceptance fraction."""

    chain: Array
    assessment: Assessment
    converged: bool
    steps: int
    walkers: int
    acceptance: float


def assess(chain: Array) -> Assessment:
    """The worst diagnostics over the last axis of a chain (chains, draws, d)."""
    bulk, tail, rhat = diagnose(chain)
    worst = int(np.argmin(np.minimum(bulk, tail)))
    return Assessment(float(bulk.min()), float(tail.min()), float(rhat.max()), worst)


@cache
def _emcee() -> Any:
    """emcee. It imports scipy.stats, a second, for a move that is not used here: that one gets it
    when it is first called."""
    if hidden := "scipy.stats" not in sys.modules:
        sys.modules["scipy.stats"] = None  # type: ignore[assignment]
    try:
        import emcee
    finally:
        if hidden:
            del sys.modules["scipy.stats"]
    if hidden:
        emcee.moves.kde.gaussian_kde = lambda *args, **options: import_module(
            "scipy.stats"
        ).gaussian_kde(*args, **options)
    return emcee


def run_ensembles(
    log_density: Callable[[Array], Array],
    starts: Array,
    *,
    rule: StoppingRule,
    seed: np.random.SeedSequence,
    progress: Callable[[Progress], None] | None = None,
    redraw: Redraw | None = None,
) -> EnsembleRun:
    """Run one ensemble per start until the rule is met: differential evolution, mixed with
    independent draws from ``redraw``. ``log_density`` maps (n, d) to (n,), where −inf is allowed,
    NaN is not; ``starts`` are (ensembles, walkers, d). Most looks assess only the coordinate that
    was worst at the last."""
    twisters: Any = [
        np.random.RandomState(child.generate_state(8)).get_state()
        for child in seed.spawn(len(starts))
    ]
    states = [
        _emcee().State(own, random_state=twister)
        for own, twister in zip(starts, twisters, strict=True)
    ]
    samplers = [_sampler(log_density, starts.shape[1:], redraw) for _ in starts]
    walkers = starts.shape[1]
    count = len(starts) * walkers
    clock = time.perf_counter()
    steps = 0
    parts: list[tuple[int, Array]] = []
    accepted: list[float] = []
    worst: int | None = None
    while True:
        draws, thin = rule.next_block(steps)
        blocks = [_run_block(*own, draws, thin) for own in zip(samplers, states, strict=True)]
        chains, states, shares = map(list, zip(*blocks, strict=True))
        parts.append((thin, np.stack(chains)))
        accepted.append(float(np.mean(shares)))
        steps += draws * thin
        chain = _kept_draws(parts, rule)
        last = steps + int(np.prod(rule.next_block(steps))) > rule.max_steps
        assessment = None if worst is None or last else assess(chain[..., [worst]])
        if assessment is None or assessment.meets(rule, walkers=count):
            assessment = assess(chain)
            worst = assessment.worst
        if progress is not None:
            share = assessment.share(rule, walkers=count)
            needed = min(steps / share, rule.max_steps) - steps if share > 0.0 else None
            left = (
                None if needed is None else max(needed, 0.0) * (time.perf_counter() - clock) / steps
            )
            progress(Progress(steps, rule.max_steps, rule.ess, assessment, left))
        converged = assessment.meets(rule, walkers=count)
        if converged or last:
            return EnsembleRun(
                chain, assessment, converged, steps, walkers, float(np.mean(accepted))
            )


def _sampler(
    log_density: Callable[[Array], Array], shape: tuple[int, int], redraw: Redraw | None
) -> Any:
    """One ensemble of so many walkers and dimensions."""
    de = _emcee().moves.DEMove
    moves = [(de(), 1.0 - _JUMP), (de(gamma0=1.0), _JUMP)]
    if redraw is not None:
        moves = [
            (RedrawMove(redraw), _REDRAWN),
            *((move, (1.0 - _REDRAWN) * share) for move, share in moves),
        ]
    sampler = _emcee().EnsembleSampler(*shape, log_density, vectorize=True, moves=moves)
    sampler.log_prob_fn = (
        log_density  # emcee's wrapper prints the walkers of a run that is interrupted
    )
    return sampler


def _run_block(sampler: Any, state: Any, draws: int, thin: int) -> tuple[Array, Any, float]:
    """The next stretch of one ensemble, shape (draws, walkers, d), the state it ends in, proposals
    accepted per stored step."""
    sampler.reset()
    end = sampler.run_mcmc(state, draws, thin_by=thin, skip_initial_state_check=True)
    return sampler.get_chain(), end, sampler.backend.accepted.sum() / (draws * sampler.nwalkers)


def _kept_draws(parts: list[tuple[int, Array]], rule: StoppingRule) -> Array:
    """Draws after burn-in, walker-major, at the spacing of the last block, wider where there are
    very many."""
    strides = [parts[-1][0] // thin for thin, _ in parts]
    every = np.concatenate(
        [own[:, stride - 1 :: stride] for stride, (_, own) in zip(strides, parts, strict=True)],
        axis=1,
    )
    kept = every[:, int(rule.discard * every.shape[1]) :]
    most = max(_MOST_DRAWS, int(2.0 * rule.ess / len(kept)))
    stride = -(-kept.shape[1] * kept.shape[2] // most)
    return np.swapaxes(kept[:, (kept.shape[1] - 1) % stride :: stride], 1, 2).reshape(
        len(kept), -1, kept.shape[3]
    )


class Redraw(Protocol):
    """Independent points (size, d), their log weights, target over proposal, and log densities; and
    log weights of any points."""

    def draw(self, size: int, random: np.random.RandomState) -> tuple[Array, Array, Array]: ...
    def log_weight(self, points: Array) -> Array: ...


class RedrawMove:
    """Independent proposals for all walkers (Tierney 1994), accepted by weights, target over
    proposal, there and here."""

    def __init__(self, redraw: Redraw) -> None:
        self._redraw = redraw
        self._stock = list[Array]()
        self._before = np.zeros(0)
        self._weight = np.zeros(0)

    def propose(self, model: Any, state: Any) -> tuple[Any, NDArray[np.bool_]]:
        """The next state of the ensemble, and whose proposals were accepted; weights are kept of
        walkers that stayed."""
        size = len(state.coords)
        moved = np.ones(len(state.coords), dtype=bool)
        if self._before.size:
            moved = (state.coords != self._before).any(axis=1)
        here = np.resize(self._weight, size)
        here[moved] = self._redraw.log_weight(state.coords[moved]) if moved.any() else 0.0
        while not self._stock or len(self._stock[0]) < size:
            drawn = self._redraw.draw(_STOCK, model.random)
            self._stock = [
                np.concatenate(own)
                for own in zip(self._stock or [own[:0] for own in drawn], drawn, strict=True)
            ]
        points, log_weight, log_target = (own[:size] for own in self._stock)
        self._stock = [own[size:] for own in self._stock]
        accepted = np.log(model.random.random_sample(size)) < log_weight - here
        state.coords[accepted], state.log_prob[accepted] = points[accepted], log_target[accepted]
        self._before = state.coords.copy()
        self._weight = np.where(accepted, log_weight, here)
        return state, accepted
