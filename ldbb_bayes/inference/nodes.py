"""p(φ | y), everything linear integrated out: its modes, weighted nodes, draws, and what is
averaged over the nodes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.integrals import (
    CHUNK,
    Integral,
    bridge_sample,
    importance_sample,
    in_chunks,
    integrate,
)
from ldbb_bayes.model.conditional import ParameterConditional
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.mixtures import mixture_quantiles
from ldbb_bayes.model.newton import central_differences, newton
from ldbb_bayes.model.orthant import Orthant
from ldbb_bayes.model.triangular import solve_upper
from ldbb_bayes.results import Array
from ldbb_bayes.units import value_and_uncertainty

__all__ = [
    "Evidence",
    "HyperPosterior",
    "Nodes",
    "TooRoughError",
    "conditional_draws",
    "draw_jointly",
    "draw_parameters_given",
]

Index = NDArray[np.intp]
_STEP = 0.05
_FLATTEST = 0.3
_STARTS = 256
_BASINS = 3
_APART = 1.5
_MOST_WITH_CORNERS = 5
_BELOW_MODE = 3.0
_COARSE = 0.2
_COARSE_STEP = 1.25
_LOW = 12.0
_OF_TOLERANCE = 20.0
_SPARED = 5e-4
_FINEST = 1e-3
_SHARE = 0.7


class HyperPosterior:
    """p(φ | y), with or without the truncation, in free coordinates.

    Parameters
    ----------
    bound : BoundModel
    truncated : include P(T | y, φ), the probability of physical compliances (whether or not the
        model imposes them).
    seed : of the starting points of the search and of the quasi-random points of P(T | y, φ).
    near : ndarray, shape (h,), optional
        Free coordinates of the mode of a density much like this one; saves the search for it.
    """

    def __init__(
        self, bound: BoundModel, *, truncated: bool, seed: int = 0, near: Array | None = None
    ) -> None:
        self.bound = bound
        self.truncated = truncated
        self._seed = seed
        self._near = near
        self._kept: dict[float, Integral] = {}

    @cached_property
    def modes(self) -> list[tuple[Array, Array]]:
        """Every mode (h,) that was found and counts, the highest first, and a root (h, h) of the
        inverse curvature there."""
        climbed = [
            newton(self._smooth, self._derivatives, start, least_curvature=_FLATTEST)
            for start in self._starts()
        ]
        height = self._smooth(np.array(climbed))
        found: list[tuple[Array, Array]] = []
        for k in np.argsort(-height):
            if height[k] > height.max() - _LOW and all(
                np.linalg.norm(climbed[k] - mode) > _APART for mode, _ in found
            ):
                found.append((climbed[k], _root(self._derivatives(climbed[k])[1])))
        return found

    @property
    def mode(self) -> Array:
        """The highest mode, shape (h,)."""
        return self.modes[0][0]

    def given(self, free: Array) -> tuple[Array, ParameterConditional]:
        """ln p(y | φ), shape (w,), and p(β | y, φ) at free coordinates (w, h)."""
        return self.bound.given(self.bound.hyper_prior.phi(free))

    def log_density(self, free: Array, *, smooth: bool = False) -> Array:
        """ln p(y, free coordinates), shape (w,), where truncated with ln P(T | y, φ) or its upper
        bound, cheaper and smooth."""
        total = self.bound.hyper_prior.log_density_of_free(free)
        inside = np.isfinite(total)
        if inside.any() and self.truncated:
            log_evidence, given = self.given(free[inside])
            orthant = given.orthant
            total[inside] += log_evidence + (
                orthant.log_bound if smooth else orthant.log_probability(seed=self._seed)[0]
            )
        elif inside.any():
            total[inside] += self.bound.log_evidence(self.bound.hyper_prior.phi(free[inside]))
        return np.asarray(total)

    def nodes(self, tolerance: float = 1e-3) -> Nodes:
        """Weighted nodes of p(y, free coordinates) to this tolerance [nat]; of their own where
        truncation moves it far."""
        if not self.truncated:
            if tolerance not in self._kept:
                self._kept[tolerance] = integrate(
                    self._smooth, self.modes, tolerance=tolerance, seed=self._seed
                )
            return Nodes(self, self._kept[tolerance])
        found = self.inside(self.plain.nodes(tolerance).integral, tolerance)
        if found.integral.error <= tolerance and not found.suit(tolerance):
            found = self.inside(self.plain.nodes(_SHARE * tolerance).integral, tolerance)
        if found.integral.error <= tolerance:
            return found
        smooth = integrate(self._smooth, self.modes, tolerance=tolerance, seed=self._seed)
        return min(found, self.inside(smooth, tolerance, bounded=True), key=lambda own: own.error)

    def inside(
        self,
        integral: Integral,
        tolerance: float,
        orthant: Callable[[Index], Orthant] | None = None,
        *,
        bounded: bool = False,
    ) -> Nodes:
        """Nodes of a density without truncation times P(T | y, φ), or of one ``bounded`` times what
        the bound is too large by; ``orthant`` of an index of them, where known. Nodes share points:
        their errors add up."""
        most = CHUNK if orthant is None else 4 * CHUNK
        orthant = orthant or (lambda index: self.given(integral.free[index])[1].orthant)
        error = np.zeros(len(integral.free))

        def factor(index: Index) -> Array:
            own = orthant(index)
            value, error[index] = own.log_probability(
                max(tolerance / 4.0, _FINEST), seed=self._seed
            )
            return value - own.log_bound if bounded else value

        found = integral.times(
            partial(in_chunks, factor, most=most), min(tolerance / _OF_TOLERANCE, _SPARED)
        )
        return Nodes(self, found, float(found.weight @ np.where(found.weight > 0.0, error, 0.0)))

    @cached_property
    def plain(self) -> HyperPosterior:
        """The same without truncation."""
        return (
            HyperPosterior(self.bound, truncated=False, seed=self._seed, near=self._near)
            if self.truncated
            else self
        )

    @cached_property
    def proposal(self) -> Integral:
        """A sample, whose proposal can be drawn from; P(T | y, φ) by its bound."""
        return importance_sample(
            self._smooth, [*self.modes, *self._corners()], tolerance=_COARSE / 4.0, seed=self._seed
        )

    @cached_property
    def coarse(self) -> Integral:
        """Coarse nodes; P(T | y, φ) by its bound."""
        return integrate(
            self._smooth, self.modes, tolerance=_COARSE, step=_COARSE_STEP, seed=self._seed
        )

    @cached_property
    def brief(self) -> Integral:
        """The coarse nodes with P(T | y, φ) itself."""
        return (
            self.inside(self.coarse, _COARSE, bounded=True).integral
            if self.truncated
            else self.coarse
        )

    @cached_property
    def emcee_nodes(self) -> Integral:
        """emcee's draws as nodes, from where the sample's are."""
        found = bridge_sample(self._smooth, self.proposal, seed=self._seed)
        return self.inside(found, _COARSE, bounded=True).integral if self.truncated else found

    def _starts(self) -> list[Array]:
        """Where to climb from: the best of many starting points, several basins tried."""
        if self._near is not None:
            return [self._near]
        prior = self.bound.hyper_prior
        points = qmc.Sobol(len(prior.names), rng=np.random.default_rng(self._seed)).random(_STARTS)
        starts = prior.starts(points)
        starts = starts[np.argsort(-self._smooth(starts))]
        basins: list[Array] = []
        for start in starts[: _STARTS // 4]:
            if len(basins) < _BASINS and all(
                np.linalg.norm(start - other) > _APART for other in basins
            ):
                basins.append(start)
        return basins

    def _corners(self) -> Iterator[tuple[Array, Array]]:
        """Where one noise vanishes and the others make up for it, as `modes`; from there ln p falls
        by one for each unit."""
        for j in range(len(self.mode) if len(self.mode) <= _MOST_WITH_CORNERS else 0):
            free = np.arange(len(self.mode)) != j

            def derivatives(point: Array, free: Array = free) -> tuple[Array, Array]:
                gradient, hessian = self._derivatives(point)
                return np.where(free, gradient, 0.0), np.where(np.outer(free, free), hessian, 0.0)

            start = self.mode - np.where(free, 0.0, _BELOW_MODE)
            corner = newton(self._smooth, derivatives, start, least_curvature=_FLATTEST)
            if np.diff(self._smooth(np.array([self.mode, corner])))[0] > -_LOW:
                yield corner, _root(derivatives(corner)[1])

    def _smooth(self, free: Array) -> Array:
        return self.log_density(free, smooth=True)

    def _derivatives(self, point: Array) -> tuple[Array, Array]:
        return central_differences(self._smooth, point, _STEP)


def _root(hessian: Array) -> Array:
    """A root (h, h) of the inverse curvature, nowhere flatter than what counts."""
    curvature, vectors = np.linalg.eigh(-hessian)
    return np.asarray(vectors / np.sqrt(np.maximum(curvature, _FLATTEST)))


@dataclass(frozen=True)
class Evidence:
    """ln Z of a model and a campaign."""

    #: ln of the density of the readings in mm; only differences between models of the same readings
    #: count
    log_value: float
    error: float  #: [nat]
    nodes: int  #: of the quadrature
    sha256: str  #: digest of the readings it is of
    #: emcee and bridge sampling took over, the weights of the nodes not to be trusted
    by_emcee: bool = False

    def __repr__(self) -> str:
        value = " ± ".join(value_and_uncertainty(self.log_value, self.error))
        return f"<Evidence: ln Z = {value} nat, {self.nodes} nodes; readings {self.sha256[:8]}>"


_SPARE = 1e-7
_COMPONENTS = 8192


@dataclass(frozen=True, eq=False)
class Nodes:
    """p(φ | y) as weighted nodes, and what is averaged over them; ``doubt``: the error of the mean
    of P(T | y, φ) [nat]."""

    posterior: HyperPosterior
    integral: Integral
    doubt: float = 0.0

    @property
    def bound(self) -> BoundModel:
        """The model and its campaign."""
        return self.posterior.bound

    @property
    def error(self) -> float:
        """Of the log evidence [nat]: the nodes' and, truncated, those of P(T | y, φ) and P(T |
        prior)."""
        return (
            self.integral.error
            + self.doubt
            + self.posterior.truncated * self.bound.truncation_prior[1]
        )

    def suit(self, tolerance: float) -> bool:
        """Whether more nodes are not needed: P(T | y, φ) may leave them less than the tolerance,
        though not below its half."""
        return self.integral.error <= tolerance - (
            self.doubt if self.doubt < tolerance / 2.0 else 0.0
        )

    @cached_property
    def evidence(self) -> Evidence:
        """ln Z = ln ∫ p(y | φ) p(φ) dφ; truncated: ln Z + ln P(T | y) − ln P(T | prior)."""
        campaign = self.bound.campaign
        names = self.bound.test_names
        sha256 = campaign.sha256
        left_out = len(names) < len(campaign.tests)
        sha256 = (
            hashlib.sha256("\n".join([sha256, *names]).encode()).hexdigest() if left_out else sha256
        )
        prior = self.bound.log_prob_truncation_prior if self.posterior.truncated else 0.0
        by_emcee = self.integral.bridge_error > 0.0
        return Evidence(
            self.integral.log_integral - prior,
            self.error,
            len(self.integral.weight),
            sha256,
            by_emcee,
        )

    def draw(self, size: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """β given nodes picked by their weights, shape (size, p), and their φ, shape (size, h)
        [mm]."""
        free = self.integral.pick(size, rng)
        return draw_parameters_given(self.posterior, free, rng), self.bound.hyper_prior.phi(free)

    def moments(self, *, spare: float = _SPARE, points: int = 512) -> tuple[Array, Array]:
        """Mean and sd of β, each (p,): those given φ, from so many points, averaged over nodes but
        for a share ``spare``."""
        free, weight = self.integral.heaviest(spare)
        every, variance = self._given(free, lambda orthant: orthant.moments(points)[:2])
        mean = weight @ every
        return mean, np.sqrt(weight @ (variance + (every - mean) ** 2))

    def quantiles(self, levels: Array, *, seed: int, components: int = _COMPONENTS) -> Array:
        """Quantiles of β, shape (levels, p): of Gaussians given φ and, inside the truncation, the
        constrained directions."""
        rng = np.random.default_rng(seed)

        def drawn(orthant: Orthant) -> tuple[Array, Array]:
            x, _ = orthant.draw_along_axes(rng)
            return x, np.zeros((*x.shape, x.shape[1]))

        mean, variance = self._given(self.integral.pick(components, rng), drawn)
        sd = np.maximum(np.sqrt(np.maximum(variance, 0.0)), 1e-6 * mean.std(axis=0))
        return mixture_quantiles(np.full(len(mean), 1.0 / len(mean)), mean, sd, levels)

    def _given(
        self, free: Array, inside: Callable[[Orthant], tuple[Array, Array]]
    ) -> Iterator[Array]:
        """Means and variances of β given φ, (w, p) each; ``inside``: mean and covariance along the
        axes truncation acts on."""
        parts = []
        for start in range(0, len(free), CHUNK):
            _, given = self.posterior.given(free[start : start + CHUNK])
            spread = given.spread()
            mean = given.mean
            variance = (spread**2).sum(axis=2)
            if self.posterior.truncated:
                shift, covariance = inside(given.orthant)
                along = spread @ np.swapaxes(given.orthant.axes, 1, 2)
                mean = mean + np.einsum("wpd,wd->wp", along, shift)
                variance = variance + np.einsum(
                    "wpd,wde,wpe->wp", along, covariance - np.eye(shift.shape[1]), along
                )
            parts.append((mean, variance))
        return (np.concatenate(own) for own in zip(*parts, strict=True))


_ROUNDS_INSIDE = 20
_MOST_ROUNDS = 50
_MOST_TRIES = 64
_FEW_INSIDE = 0.02
_INSIDE = 4.0
_ENVELOPE = 2.0


def conditional_draws(
    bound: BoundModel, free: Array, rng: np.random.Generator
) -> tuple[Array, NDArray[np.bool_]]:
    """One draw of β (w, p) for each free coordinates from its exact conditional Gaussian inside the
    truncation; and whether it is exact: not where the rejection sampler gave up, or rounding left β
    outside."""
    beta = np.zeros((len(free), len(bound.names)))
    exact = np.ones(len(free), dtype=bool)
    nodes, node = np.unique(free, axis=0, return_inverse=True)
    once = bound.given(bound.hyper_prior.phi(nodes))[1] if 2 * len(nodes) <= len(free) else None
    for start in range(0, len(free), CHUNK):
        part = slice(start, start + CHUNK)
        given = (
            once.select(node.ravel()[part])
            if once
            else bound.given(bound.hyper_prior.phi(free[part]))[1]
        )
        beta[part], exact[part] = (
            given.draw_truncated(rng) if bound.truncation.active else (given.draw(rng), True)
        )
    return beta, exact


def draw_parameters_given(start: HyperPosterior, free: Array, rng: np.random.Generator) -> Array:
    """β given each φ, shape (w, p): exact conditional draws, repeated until all are inside the
    truncation.

    Raises
    ------
    InputError
        When rounds of exact rejection leave some undrawn: the readings leave no room inside the
        truncation.
    """
    beta = np.zeros((len(free), len(start.bound.names)))
    missing = np.arange(len(free))
    for _ in range(1 + _ROUNDS_INSIDE):
        beta[missing], exact = conditional_draws(start.bound, free[missing], rng)
        missing = missing[~exact]
        if not missing.size:
            return beta
    raise InputError(
        "the posterior must leave room where no compliance is negative, got no draw that falls"
        " there. The readings contradict non-negative compliance: check signs, mount compensation"
        " and forces, or fit --without truncation."
    )


class TooRoughError(Exception):
    """The density of the hyper-parameters is too rough to be drawn from independently: emcee must
    take over."""


def draw_jointly(
    start: HyperPosterior, size: int, rng: np.random.Generator
) -> tuple[Array, Array, float]:
    """Independent draws of free coordinates (size, h) and β (size, p), and the share of proposals
    used.

    Rejection from the proposal of a sample. Truncated, several β are drawn for each φ without
    truncation, and φ counts by how many are inside: exact, as that share is P(T | y, φ) on average.
    Where few are, φ is drawn by P(T | y, φ) itself, and β by tilting. A φ that passes the envelope
    is used as often as it is owed, with another β.

    Raises
    ------
    TooRoughError
        When the weights of the sample cannot be trusted, or almost nothing is accepted.
    """
    share = _share_inside(start, rng) if start.truncated else 1.0
    tilted = share < _FEW_INSIDE
    proposal = (start if tilted else start.plain).proposal
    prior = start.bound.hyper_prior
    if not proposal.trusted:
        raise TooRoughError(f"Pareto k {proposal.pareto_k:.2f}")
    tries = int(np.ceil(_INSIDE / share)) if start.truncated and not tilted else 1
    log_scale = proposal.log_integral + np.log(_ENVELOPE * (1.0 if tilted else share))
    kept: list[tuple[Array, Array]] = []
    used = 0
    tried = 0
    for _ in range(_MOST_ROUNDS * max(1, -(-size // CHUNK))):
        free = proposal.draw(CHUNK, rng)
        log_weight = -proposal.log_proposal(free) - log_scale
        if tilted:
            picked = free[_owed(log_weight + start.log_density(free), rng)]
            beta = draw_parameters_given(start, picked, rng)
        else:
            log_evidence, given = start.given(free)
            log_weight += prior.log_density_of_free(free) + log_evidence
            white, count = _inside(given, tries, rng, truncated=start.truncated)
            with np.errstate(divide="ignore"):
                index = _owed(log_weight + np.log(count / tries), rng)
            again = np.arange(len(index)) - np.searchsorted(index, index)
            white = white[index, np.minimum(again, count[index] - 1)]
            if not start.truncated:
                white = rng.standard_normal(white.shape)
            picked = free[index]
            beta = given.mean[index] + solve_upper(given.root[index], white) * given.scale[index]
        kept.append((picked, beta))
        used = used + len(picked)
        tried = tried + CHUNK
        if used >= size:
            order = rng.permutation(size)
            every = [np.concatenate(part) for part in zip(*kept, strict=True)]
            return every[0][order], every[1][order], used / tried
    raise TooRoughError(f"{used} of {size} draws from {tried} proposals")


def _owed(log_weight: Array, rng: np.random.Generator) -> Index:
    """Which proposals are used, each as often as its weight says on average."""
    owed = np.exp(log_weight)
    return np.repeat(
        np.arange(len(owed)), (np.floor(owed) + (rng.random(len(owed)) < owed % 1.0)).astype(int)
    )


def _inside(
    given: ParameterConditional, tries: int, rng: np.random.Generator, *, truncated: bool = True
) -> tuple[Array, Array]:
    """Standard coordinates (w, tries, p) of draws without truncation, those inside it first, and
    how many are, (w,)."""
    white = rng.standard_normal((len(given.mean), tries, given.mean.shape[1]))
    rows = given.physical.rows[: None if truncated else 0]
    value = white @ np.swapaxes(given.spread(rows), 1, 2) + (given.mean @ rows.T)[:, None]
    inside = (value >= 0.0).all(axis=2)
    order = np.argsort(~inside, axis=1, kind="stable")
    return np.take_along_axis(white, order[:, :, None], axis=1), inside.sum(axis=1)


def _share_inside(start: HyperPosterior, rng: np.random.Generator) -> float:
    """P(T | y), roughly: the share of draws without truncation, of the heaviest nodes, that are
    inside."""
    proposal = start.plain.proposal
    count = _inside(start.given(proposal.pick(CHUNK, rng))[1], _MOST_TRIES, rng)[1]
    return max(float(count.mean()) / _MOST_TRIES, 1e-9)
