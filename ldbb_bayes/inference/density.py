"""ln p(β, φ | y), nuisances integrated out: the one definition that every sampler uses, ours and
others.

ln p(y | β, φ) + ln p(β) + ln p(φ), each normalised: β ~ N(m, S) inside the truncation A β ≥ 0, φ by
its laws, independent of β. The integral over all x = (β, φ) is the evidence of `log_evidence`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import require
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.results import Array, Shown

__all__ = ["JointDensity", "LinearRedraw", "LogDensity", "log_density", "starting_points"]

_START_TEMPERATURE = 1.5
_TRIES = 2
_EDGE = 1e-15


def log_density(model: HybridModel, campaign: Campaign) -> LogDensity:
    """Return the posterior's log density, for samplers and optimisers of your own.

    InputError for a plan, or a model that the campaign cannot carry.

    Examples
    --------
    >>> density = lb.log_density(lb.HybridModel.default(1), campaign)
    >>> sampler = emcee.EnsembleSampler(4 * len(density.names), len(density.names), density.log_prob, vectorize=True)
    >>> sampler.run_mcmc(density.initial(4 * len(density.names), seed=1), 5000)
    """
    require(
        not campaign.is_plan,
        "campaign must have readings to have a posterior, got a plan. Run the tests, or"
        " simulate it.",
    )
    return LogDensity(model.bind(campaign))


@dataclass(frozen=True, eq=False, repr=False)
class LogDensity(Shown):
    """ln p(x, y) of a model and a campaign at x = (β, φ): parameters, then hyper-parameters; all
    nuisances integrated out.

    A point has shape (d,), a stack of points (n, d); densities are then a number, or of shape (n,).
    Logarithms are natural and every density is normalised: the evidence of a nested sampler is that
    of `log_evidence`.
    """

    bound: BoundModel  #: the model of the campaign

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the d coordinates."""
        return (*self.bound.names, *self.bound.hyper_prior.names)

    @property
    def units(self) -> tuple[str, ...]:
        """Their units, those of a posterior: mm, N, rad; none of a number."""
        return (
            *(parameter.unit for parameter in self.bound.parameters),
            *self.bound.hyper_prior.units,
        )

    @cached_property
    def bounds(self) -> Array:
        """The least and the greatest value of each coordinate, shape (d, 2). The truncation, C(F) ≥
        0 at every tested force, is more than bounds; `log_prior` has all of it."""
        return np.concatenate([self.bound.truncation.bounds, self.bound.hyper_prior.bounds])

    @property
    def scale(self) -> Array:
        """Sizes in the prior, shape (d,), of parameters the sd. Optimisers want the posterior's:
        the spread of `initial`."""
        prior = self.bound.hyper_prior
        return np.concatenate([self.bound.scale, np.where(prior.in_mm, prior.scale, 1.0)])

    def __repr__(self) -> str:
        campaign = self.bound.campaign.name
        return (
            f"LogDensity of {campaign!r}: {len(self.bound.names)} parameters,"
            f" {len(self.bound.hyper_prior.names)} scales"
        )

    def log_prob(self, x: Array) -> Any:
        """ln p(y | x) + ln p(x); −inf outside the prior, never NaN."""

        def both(beta: Array, phi: Array) -> Array:
            return _log_joint(self.bound, beta, phi, self.bound.hyper_prior.log_density(phi))

        return self._at(x, both)

    def log_prior(self, x: Array) -> Any:
        """ln p(x), the truncation included; of flat priors that of the hyper-parameters alone."""
        return self._at(
            x,
            lambda beta, phi: self.bound.log_prior(beta) + self.bound.hyper_prior.log_density(phi),
        )

    def log_likelihood(self, x: Array) -> Any:
        """ln p(y | x) of the readings in mm; −inf where a hyper-parameter is out of its bounds."""
        return self._at(x, lambda beta, phi: self.bound.log_likelihood(phi, beta))

    def prior_transform(self, u: Array) -> Array:
        """Return the x whose prior probabilities, one coordinate after the other, are u in the unit
        cube; inside the truncation.

        InputError for flat priors, which have no such point, and for u outside the cube.
        """
        bound, p = self.bound, len(self.bound.names)
        require(
            not bound.model.prior.flat,
            "a prior to transform to must be proper, got a flat one. Use the default preset.",
        )
        levels = np.atleast_2d(self._checked(u, "u"))
        beyond = levels[~((levels >= 0.0) & (levels <= 1.0))]
        require(
            not len(beyond),
            f"u must lie between 0 and 1, got {beyond[:1].sum()}. Give prior probabilities, one"
            " each.",
        )
        levels = np.clip(levels, _EDGE, 1.0 - _EDGE)
        beta = bound.truncation.quantile(levels[:, :p], bound.prior_mean, bound.prior_sd)
        return np.concatenate([beta, bound.hyper_prior.quantile(levels[:, p:])], axis=1).reshape(
            np.shape(u)
        )

    def split(self, x: Array) -> dict[str, dict[str, Any]]:
        """Return ``{"parameters": {name: value}, "hyper": {name: value}}``; of a stack, values of
        shape (n,)."""
        values = np.moveaxis(self._checked(x), -1, 0)
        p = len(self.bound.names)
        by_name = dict(
            zip(self.names, values.tolist() if values.ndim == 1 else values, strict=True)
        )
        return {
            "parameters": {n: by_name[n] for n in self.names[:p]},
            "hyper": {n: by_name[n] for n in self.names[p:]},
        }

    def initial(self, n: int, seed: int = 1) -> Array:
        """Return starting points, shape (n, d): spread a little wider than the posterior, all of
        them inside."""
        joint = JointDensity(self.bound)
        random = np.random.RandomState(seed)
        beta, free = joint.split(starting_points(LinearRedraw(joint, self._start), n, random))
        return np.concatenate([beta, self.bound.hyper_prior.phi(free)], axis=1)

    @cached_property
    def _start(self) -> HyperPosterior:
        return HyperPosterior(self.bound, truncated=self.bound.truncation.active)

    def _checked(self, x: Array, what: str = "x") -> Array:
        values = np.asarray(x, dtype=float)
        d = len(self.names)
        fits = values.ndim in (1, 2) and values.shape[-1] == d
        require(
            fits,
            f"{what} must have shape ({d},) or (n, {d}), got {values.shape}. Order it as in names.",
        )
        return values

    def _at(self, x: Array, density: Callable[[Array, Array], Array]) -> Any:
        """A density of β and φ at the points that are within the bounds of φ, −inf at the
        others."""
        values = self._checked(x)
        p = len(self.bound.names)
        points = values.reshape(-1, len(self.names))
        low, high = self.bound.hyper_prior.bounds.T
        inside = np.isfinite(points).all(axis=1) & (
            (points[:, p:] >= low) & (points[:, p:] <= high)
        ).all(axis=1)
        total = np.full(len(points), -np.inf)
        if inside.any():
            total[inside] = density(points[inside, :p], points[inside, p:])
        return float(total[0]) if values.ndim == 1 else total


def _log_joint(bound: BoundModel, beta: Array, phi: Array, log_hyper: Array) -> Array:
    """ln p(y | β, φ) + ln p(β) + what is given of φ, shape (n,)."""
    total = bound.log_prior(beta) + log_hyper
    inside = np.isfinite(total)
    if inside.any():
        total[inside] += bound.log_likelihood(phi[inside], beta[inside])
    return np.asarray(total)


@dataclass(frozen=True, eq=False)
class JointDensity:
    """The same in coordinates for a random walk, ((β − centre) / scale, ln(φ − lower)); their
    Jacobian but for a constant."""

    bound: BoundModel

    def __call__(self, x: Array) -> Array:
        """Log density of (n, p + h) points, shape (n,)."""
        beta, free = self.split(x)
        return _log_joint(
            self.bound,
            beta,
            self.bound.hyper_prior.phi(free),
            self.bound.hyper_prior.log_density_of_free(free),
        )

    def split(self, x: Array) -> tuple[Array, Array]:
        """x (..., p + h) → β (..., p), the free coordinates of φ (..., h)."""
        p = len(self.bound.names)
        return self.bound.centre + x[..., :p] * self.bound.scale, x[..., p:]

    def join(self, beta: Array, free: Array) -> Array:
        """The reverse of `split`."""
        return np.concatenate([(beta - self.bound.centre) / self.bound.scale, free], axis=-1)


@dataclass(frozen=True, eq=False)
class LinearRedraw:
    """(β, φ) anew: φ from the proposal fitted to its nodes, β from its exact conditional Gaussian
    given φ; inside the truncation from the tilted draws that are nearly that Gaussian's part
    inside."""

    density: JointDensity
    start: HyperPosterior

    def draw(
        self, size: int, random: np.random.RandomState, *, temperature: float = 1.0
    ) -> tuple[Array, Array, Array]:
        """Points (size, p + h), log weights, target over proposal, and log densities of the target,
        (size,) each."""
        bound = self.density.bound
        free = self.start.proposal.draw(size, random, temperature=temperature)
        log_evidence, given = self.start.given(free)
        white = random.standard_normal(given.mean.shape)
        log_tilt = np.zeros(size)
        if bound.truncation.active:
            uniform = random.random_sample((size, len(bound.truncation.rows)))
            white, log_tilt = given.orthant.propose_standard(uniform, white)
        beta = given.from_standard(white)
        log_marginal = bound.hyper_prior.log_density_of_free(free) + log_evidence
        log_target = np.where(
            bound.truncation.holds(beta), log_marginal + given.log_density(beta), -np.inf
        )
        log_weight = np.where(
            np.isfinite(log_target),
            log_marginal - self.start.proposal.log_proposal(free) + log_tilt,
            -np.inf,
        )
        return (
            self.density.join(beta, free),
            log_weight,
            log_target - bound.log_prob_truncation_prior,
        )

    def log_weight(self, points: Array) -> Array:
        """Log weights of points inside the truncation, shape (n,)."""
        beta, free = self.density.split(points)
        log_evidence, given = self.start.given(free)
        log_tilt = (
            given.orthant.log_proposal_weight(given.standardize(beta))
            if self.density.bound.truncation.active
            else 0.0
        )
        log_marginal = self.density.bound.hyper_prior.log_density_of_free(free) + log_evidence
        return np.asarray(log_marginal - self.start.proposal.log_proposal(free) + log_tilt)


def starting_points(redraw: LinearRedraw, n: int, random: np.random.RandomState) -> Array:
    """Points (n, p + h) inside the truncation, φ drawn a little wider than its posterior, β from
    its exact conditional Gaussian.

    InputError where the readings leave next to no room inside the truncation.
    """
    points, _, log_target = redraw.draw(_TRIES * n, random, temperature=_START_TEMPERATURE)
    inside = points[np.isfinite(log_target)]
    require(
        len(inside) >= n,
        "the posterior must leave room where no compliance is negative, got almost none. The"
        " readings contradict non-negative compliance: check the sign of the readings, the mount"
        " compensation and the forces, or fit --without truncation.",
    )
    return np.asarray(inside[:n])
