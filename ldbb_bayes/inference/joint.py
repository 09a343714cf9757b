"""Joint sampling: emcee over all parameters of interest and hyper-parameters, nuisances integrated out."""

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
from ldbb_bayes.model.bound import BoundModel

__all__ = ["JointDensity", "sample_joint"]

Array = NDArray[Any]
_START_TEMPERATURE = 1.5
_WALKERS = 128


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
    """(β, φ) anew: φ from the cells of a lattice, β from its exact conditional Gaussian given φ.

    Inside the truncation β comes from the tilted draws that are nearly that Gaussian's part inside.
    """

    density: JointDensity
    start: HyperPosterior

    def draw(self, size: int, random: np.random.RandomState) -> tuple[Array, Array, Array]:
        """Points (size, p + h), the log density they were drawn with and that of the target: p(y | φ) p(φ) p(β | y, φ)."""
        bound = self.density.bound
        free = self.start.coarse.draw(size, random)
        log_evidence, given = bound.given(bound.hyper_prior.phi(free))
        white = random.standard_normal(given.mean.shape)
        log_weight, inside = np.zeros(size), np.ones(size, dtype=bool)
        if bound.truncation.active:
            white, log_weight = given.orthant.propose_spread(random.random_sample((size, len(bound.truncation.rows))), white)
        beta = given.at(white)
        if bound.truncation.active:
            inside = bound.truncation.holds(beta)
        log_given = given.log_density(beta)
        log_target = bound.hyper_prior.log_density_of_free(free) + log_evidence + log_given - bound.log_prob_truncation_prior
        log_proposed = self.start.coarse.log_proposal(free) + log_given - log_weight
        return self.density.join(beta, free), log_proposed, np.where(inside, log_target, -np.inf)

    def log_density(self, points: Array) -> Array:
        """Log density with which the points would be drawn."""
        bound = self.density.bound
        beta, free = self.density.split(points)
        _, given = bound.given(bound.hyper_prior.phi(free))
        log_weight = given.orthant.log_weight_of(given.white(beta)) if bound.truncation.active else 0.0
        return np.asarray(self.start.coarse.log_proposal(free) + given.log_density(beta) - log_weight)


def sample_joint(
    start: HyperPosterior,
    *,
    assess: Callable[[Array], Assessment],
    ensembles: int = 4,
    walkers: int | None = None,
    rule: StoppingRule | None = None,
    seed: np.random.SeedSequence,
    progress: Callable[[Progress], None] | None = None,
    store: BlockStore | None = None,
) -> tuple[EnsembleRun, Array, Array]:
    """Draws of (β, φ) from the joint posterior of the model ``start`` belongs to.

    Each ensemble starts from hyper-parameters drawn a little wider than their posterior, and from the exact conditional Gaussian
    of β inside the truncation.

    Returns
    -------
    run : EnsembleRun
    beta : ndarray, shape (ensembles, draws, p)
    phi : ndarray, shape (ensembles, draws, h) [mm]

    Raises
    ------
    InputError
        For fewer than 4 ensembles or too few walkers.
    """
    bound = start.bound
    density = JointDensity(bound)
    d = len(bound.names) + len(bound.hyper_prior.names)
    count = walkers or max(_WALKERS, 4 * d)
    if ensembles < 4:
        raise InputError(f"ensembles must be at least 4, got {ensembles}. R-hat needs independent chains.")
    if count < 2 * d or count % 2:
        raise InputError(f"walkers must be even and at least {2 * d} for {d} parameters, got {count}. Use more walkers.")
    starting, sampling = seed.spawn(2)
    starts = np.stack([_start(density, start, count, np.random.default_rng(child)) for child in starting.spawn(ensembles)])
    run = run_ensembles(
        density,
        starts,
        assess,
        rule=rule or StoppingRule(),
        seed=sampling,
        progress=progress,
        redraw=LinearRedraw(density, start),
        store=store,
    )
    beta, free = density.split(run.chain)
    return run, beta, bound.hyper_prior.phi(free)


def _start(density: JointDensity, start: HyperPosterior, count: int, rng: np.random.Generator) -> Array:
    """Starting points with finite density, shape (count, d)."""
    found: list[Array] = []
    for _ in range(50):
        free = start.draw(count, rng, temperature=_START_TEMPERATURE)
        beta, _ = conditional_draws(density.bound, free, rng)
        x = density.join(beta, free)
        found.append(x[np.isfinite(density(x))])
        if sum(map(len, found)) >= count:
            return np.concatenate(found)[:count]
    raise InputError(
        "the posterior must leave room inside the truncation, got none after 50 tries. The readings contradict non-negative "
        "compliance: check the sign of the readings, the mount compensation and the forces, or fit --without truncation."
    )
