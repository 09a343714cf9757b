"""p(β, φ | y) by ensembles of walkers, run until there is enough. The only importer of emcee."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import emcee
import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.nodes import HyperPosterior, conditional_draws
from ldbb_bayes.model.hybrid import BoundModel

__all__ = [
    "Assessment",
    "EnsembleRun",
    "JointDensity",
    "LinearRedraw",
    "Progress",
    "Redraw",
    "StoppingRule",
    "run_ensembles",
    "sample_joint",
]

Array = NDArray[Any]
_BLOCKS_A_LEVEL = 4
_MOST_DOUBLINGS = 5
_DOUBLINGS_STORED = 2
_JUMP = 0.1
_REDRAWN = 0.85
_MOST_DRAWS = 25_000
_STOCK = 256
_WALKERS = 128
_START_TEMPERATURE = 1.5
_STARTING_ROUNDS = 50


@dataclass(frozen=True)
class StoppingRule:
    """When to stop: every parameter has bulk and tail ESS ≥ ``ess`` and R-hat ≤ ``rhat``, or ``max_steps`` are spent.

    Attributes
    ----------
    ess, rhat : float
    max_steps : int
        Steps of each ensemble.
    block : int
        Steps between the first looks; later looks are further apart, and of a long run not every step is stored.
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

    def next_block(self, steps: int) -> tuple[int, int]:
        """Draws stored in the block that follows so many steps, and steps between them. The target does not enter."""
        doublings = min(int(np.log2(1.0 + steps / (_BLOCKS_A_LEVEL * self.block))), _MOST_DOUBLINGS)
        thin = 2 ** max(doublings - _DOUBLINGS_STORED, 0)
        return self.block * 2**doublings // thin, thin


@dataclass(frozen=True)
class Assessment:
    """The worst ESS and R-hat over all parameters; ``worst`` is the number of the one with the smallest ESS."""

    ess_bulk_min: float
    ess_tail_min: float
    rhat_max: float
    worst: int = 0

    def meets(self, rule: StoppingRule, *, walkers: int) -> bool:
        """Whether the target is reached by this many walkers in all (0: independent draws); false where one is not a number."""
        return self.share(rule, walkers=walkers) >= 1.0 and self.rhat_max <= rule.rhat

    def share(self, rule: StoppingRule, *, walkers: int) -> float:
        """How much of the sample sizes asked for there is."""
        shares = (self.ess_bulk_min / rule.ess, self.ess_tail_min / rule.ess)
        return min(shares) if walkers == 0 else min(*shares, self.ess_bulk_min / (rule.lengths * walkers))


@dataclass(frozen=True)
class Progress:
    """What a run reports at every look; ``seconds_left`` is an estimate, None while there is nothing to go by."""

    steps: int
    max_steps: int
    target_ess: float
    assessment: Assessment
    seconds_left: float | None = None


@dataclass(frozen=True, eq=False)
class EnsembleRun:
    """The outcome: a chain (ensembles, draws, d), walker-major (walker 0's draws, then walker 1's, …), steps and walkers of each
    ensemble, and the mean acceptance fraction."""

    chain: Array
    assessment: Assessment
    converged: bool
    steps: int
    walkers: int
    acceptance: float


class Redraw(Protocol):
    """Independent draws from a density near the target, which can be computed."""

    def draw(self, size: int, random: np.random.RandomState) -> tuple[Array, Array, Array]:
        """Points, shape (size, d), the log density they were drawn with and that of the target, shape (size,)."""

    def log_density(self, points: Array) -> Array:
        """Log density with which (n, d) points would be drawn, shape (n,); −inf where none is."""


def run_ensembles(
    log_density: Callable[[Array], Array],
    starts: Array,
    assess: Callable[[Array], Assessment],
    *,
    rule: StoppingRule,
    seed: np.random.SeedSequence,
    progress: Callable[[Progress], None] | None = None,
    redraw: Redraw | None = None,
) -> EnsembleRun:
    """Run one ensemble per start until the rule is met: differential evolution, mixed with independent draws from ``redraw``.

    ``log_density`` maps (n, d) to (n,), where −inf is allowed, NaN is not; ``starts`` are (ensembles, walkers, d). Most looks
    assess only the coordinate that was worst at the last.
    """
    twisters: Any = [np.random.RandomState(child.generate_state(8)).get_state() for child in seed.spawn(len(starts))]
    states: Sequence[Any] = [emcee.State(own, random_state=twister) for own, twister in zip(starts, twisters, strict=True)]
    walkers = starts.shape[1]
    count, clock, steps = len(starts) * walkers, time.perf_counter(), 0
    parts: list[tuple[int, Array]] = []
    accepted: list[float] = []
    worst: int | None = None
    while True:
        draws, thin = rule.next_block(steps)
        chains, states, shares = zip(*(_run_block(log_density, state, draws, thin, redraw) for state in states), strict=True)
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
            left = None if needed is None else max(needed, 0.0) * (time.perf_counter() - clock) / steps
            progress(Progress(steps, rule.max_steps, rule.ess, assessment, left))
        converged = assessment.meets(rule, walkers=count)
        if converged or last:
            return EnsembleRun(chain, assessment, converged, steps, walkers, float(np.mean(accepted)))


def _run_block(
    log_density: Callable[[Array], Array], state: emcee.State, draws: int, thin: int, redraw: Redraw | None
) -> tuple[Array, emcee.State, float]:
    """The next stretch of one ensemble, shape (draws, walkers, d), the state it ends in, proposals accepted per stored step."""
    moves = [(emcee.moves.DEMove(), 1.0 - _JUMP), (emcee.moves.DEMove(gamma0=1.0), _JUMP)]
    target = log_density
    if redraw is not None:
        anew = RedrawMove(redraw, log_density)
        moves = [(anew, _REDRAWN), *((move, (1.0 - _REDRAWN) * share) for move, share in moves)]
        target = anew.target
    sampler = emcee.EnsembleSampler(*state.coords.shape, target, vectorize=True, moves=moves)
    sampler.log_prob_fn = target  # emcee's wrapper prints the walkers of a run that is interrupted
    end = sampler.run_mcmc(state, draws, thin_by=thin, skip_initial_state_check=True)
    return sampler.get_chain(), end, sampler.backend.accepted.sum() / (draws * state.coords.shape[0])


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


class RedrawMove(emcee.moves.RedBlueMove):  # type: ignore[misc]
    """Independent proposals (Tierney 1994): what was drawn last is accepted by how it compares with the target.

    Proposals do not depend on the walkers: they are drawn many at a time, and both their densities are remembered.
    """

    def __init__(self, redraw: Redraw, log_density: Callable[[Array], Array]) -> None:
        super().__init__()
        self._redraw, self._log_density = redraw, log_density
        self._proposed: dict[bytes, float] = {}
        self._targeted: dict[bytes, float] = {}
        self._stock: list[Array] = []

    def get_proposal(self, sample: Array, complement: list[Array], random: np.random.RandomState) -> tuple[Array, Array]:
        """Proposals for the walkers of one half, shape (n, d), and ln q(back) − ln q(there), shape (n,)."""
        log_back = _recall(self._proposed, sample, self._redraw.log_density)
        while len(self._stock) < len(sample):
            points, log_proposed, log_target = self._redraw.draw(_STOCK, random)
            self._proposed.update(zip(_keys(points), log_proposed.tolist(), strict=True))
            self._targeted.update(zip(_keys(points), log_target.tolist(), strict=True))
            self._stock += list(points)
        proposal, self._stock = np.array(self._stock[: len(sample)]), self._stock[len(sample) :]
        return proposal, log_back - _recall(self._proposed, proposal, self._redraw.log_density)

    def target(self, points: Array) -> Array:
        """Log density of the target, shape (n,): remembered where this move drew the points."""
        return _recall(self._targeted, points, self._log_density)


def _recall(values: dict[bytes, float], points: Array, compute: Callable[[Array], Array]) -> Array:
    """Values of points (n, d), shape (n,): looked up, and computed and remembered where they are new."""
    keys = _keys(points)
    missing = [i for i, key in enumerate(keys) if key not in values]
    if missing:
        values.update(zip([keys[i] for i in missing], compute(points[missing]).tolist(), strict=True))
    return np.array([values[key] for key in keys])


def _keys(points: Array) -> list[bytes]:
    return [row.tobytes() for row in points]


@dataclass(frozen=True, eq=False)
class JointDensity:
    """ln p(x | y) up to a constant, x = ((β − centre) / scale, ln(φ − lower))."""

    bound: BoundModel

    def __call__(self, x: Array) -> Array:
        """Log density of (n, p + h) points, shape (n,)."""
        beta, free = self.split(x)
        total = self.bound.log_prior(beta) + self.bound.hyper_prior.log_density_of_free(free)
        inside = np.isfinite(total)
        if inside.any():
            total[inside] += self.bound.log_likelihood(self.bound.hyper_prior.phi(free[inside]), beta[inside])
        return np.asarray(total)

    def split(self, x: Array) -> tuple[Array, Array]:
        """x (..., p + h) → β (..., p), the free coordinates of φ (..., h)."""
        p = len(self.bound.names)
        return self.bound.centre + x[..., :p] * self.bound.scale, x[..., p:]

    def join(self, beta: Array, free: Array) -> Array:
        """The reverse of `split`."""
        return np.concatenate([(beta - self.bound.centre) / self.bound.scale, free], axis=-1)


@dataclass(frozen=True, eq=False)
class LinearRedraw:
    """(β, φ) anew: φ from the cells of a lattice, β from its exact conditional Gaussian given φ; inside the truncation from the
    tilted draws that are nearly that Gaussian's part inside."""

    density: JointDensity
    start: HyperPosterior

    def draw(self, size: int, random: np.random.RandomState) -> tuple[Array, Array, Array]:
        """Points (size, p + h), the log density they were drawn with and that of the target: p(y | φ) p(φ) p(β | y, φ)."""
        bound = self.density.bound
        free = self.start.coarse.draw(size, random)
        log_evidence, given = self.start.given(free)
        white, log_weight = random.standard_normal(given.mean.shape), np.zeros(size)
        if bound.truncation.active:
            uniform = random.random_sample((size, len(bound.truncation.rows)))
            white, log_weight = given.orthant.propose_spread(uniform, white)
        beta = given.at(white)
        log_given = given.log_density(beta)
        log_target = bound.hyper_prior.log_density_of_free(free) + log_evidence + log_given - bound.log_prob_truncation_prior
        log_proposed = self.start.coarse.log_proposal(free) + log_given - log_weight
        return self.density.join(beta, free), log_proposed, np.where(bound.truncation.holds(beta), log_target, -np.inf)

    def log_density(self, points: Array) -> Array:
        """Log density with which the points would be drawn."""
        beta, free = self.density.split(points)
        _, given = self.start.given(free)
        log_weight = given.orthant.log_weight_of(given.white(beta)) if self.density.bound.truncation.active else 0.0
        return np.asarray(self.start.coarse.log_proposal(free) + given.log_density(beta) - log_weight)


def sample_joint(
    start: HyperPosterior,
    *,
    assess: Callable[[Array], Assessment],
    ensembles: int = 4,
    walkers: int | None = None,
    rule: StoppingRule,
    seed: np.random.SeedSequence,
    progress: Callable[[Progress], None] | None = None,
) -> tuple[EnsembleRun, Array, Array]:
    """The run, and draws of β (ensembles, draws, p) and φ (ensembles, draws, h) [mm] from the joint posterior.

    Each ensemble starts from hyper-parameters drawn a little wider than their posterior, and from the exact conditional Gaussian
    of β inside the truncation.

    Raises
    ------
    InputError
        For fewer than 4 ensembles or too few walkers.
    """
    density = JointDensity(start.bound)
    d = len(start.bound.names) + len(start.bound.hyper_prior.names)
    count = walkers or max(_WALKERS, 4 * d)
    if ensembles < 4:
        raise InputError(f"ensembles must be at least 4, got {ensembles}. R-hat needs independent chains.")
    if count < 2 * d or count % 2:
        raise InputError(f"walkers must be even and at least {2 * d} for {d} parameters, got {count}. Use more walkers.")
    starting, sampling = seed.spawn(2)
    starts = np.stack([_start(density, start, count, np.random.default_rng(child)) for child in starting.spawn(ensembles)])
    redraw = LinearRedraw(density, start)
    run = run_ensembles(density, starts, assess, rule=rule, seed=sampling, progress=progress, redraw=redraw)
    beta, free = density.split(run.chain)
    return run, beta, start.bound.hyper_prior.phi(free)


def _start(density: JointDensity, start: HyperPosterior, count: int, rng: np.random.Generator) -> Array:
    """Starting points with finite density, shape (count, d)."""
    points = np.zeros((0, 0))
    for _ in range(_STARTING_ROUNDS):
        free = start.coarse.draw(count, rng, temperature=_START_TEMPERATURE)
        x = density.join(conditional_draws(density.bound, free, rng)[0], free)
        points = np.concatenate([points.reshape(-1, x.shape[1]), x[np.isfinite(density(x))]])
        if len(points) >= count:
            return points[:count]
    raise InputError(
        "the posterior must leave room inside the truncation, got none after 50 tries. The readings contradict non-negative "
        "compliance: check the sign of the readings, the mount compensation and the forces, or fit --without truncation."
    )
