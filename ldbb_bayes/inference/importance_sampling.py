"""Integrals in many dimensions by importance sampling with an adapted proposal.

Points are drawn from a proposal, a density similar to the density f to be integrated. The weight of
a point is f divided by the proposal; the mean of the weights is the integral of f over h
dimensions. The points are quasi-random: they come from several Sobol sequences, each randomised
independently (scrambled). The proposal is a mixture of split Student-t distributions, whose two
sides differ (Geweke, Econometrica 57, 1317-1339, 1989). Points are drawn in several rounds. After
the first round, the proposal is fitted to the weighted points of all earlier rounds before new
points are drawn from it.

The weights of a round are computed with the proposal from which the points of this round were
drawn. With a proposal that was fitted to the same points, ln ∫ f would be too small, by 0.1 nat in
45 dimensions.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from threading import Lock

import numpy as np
from scipy.stats import qmc

from ldbb_bayes.inference.integrals import Integral, LogFunction, in_chunks
from ldbb_bayes.inference.mixture_proposals import Mixture, SplitT, fit_split_t, refit_mixture
from ldbb_bayes.results import Array

__all__ = ["importance_sample", "refit_sample", "sample_similar"]

# Largest number of points of a round, unless the caller states another one.
_MOST_POINTS = 65_536
# Distances from a mode at which the density to integrate is evaluated, on both sides along every
# direction. The unit is a standard deviation of the Gaussian fitted at the mode.
_ALONG_AXIS = np.array([0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.5, 8.0, 10.0])
# Number of independent randomisations (scrambles) of the Sobol sequence; the scatter between the
# randomised sequences gives the error of an integral.
_SCRAMBLES = 8
# In the first round of sampling, each randomised Sobol sequence (of quasi-random points) gives at
# least ``_FEWEST_POINTS`` points, and at least ``_POINTS_PER_DIMENSION`` points for each dimension.
# The number is rounded up to a power of two.
_FEWEST_POINTS = 32.0
_POINTS_PER_DIMENSION = 1.5
# Each round of importance sampling starts with more points than the round before, usually by this
# factor. The factor is smaller if there would be too many points.
_GROWTH = 4
# For each component of the mixture from which points are drawn, a component is added that is wider
# by the factor ``_WIDE``. Without the wider components, points in the tails could have very large
# weights. All wider components together have the probability ``_WIDE_SHARE`` in the mixture.
_WIDE = 1.5
_WIDE_SHARE = 0.1
# Largest number of pairs of dimensions and seeds whose quasi-random points are kept.
_KEPT_SEQUENCES = 4
# Largest number of rounds of importance sampling, each of which draws new points.
_ROUNDS = 5
# A round of sampling is extended by more points only if the effective sample size of its weights
# exceeds this fraction of its number of points. Otherwise the proposal, which is the density from
# which points are drawn, is fitted anew.
_EFFICIENT = 0.4
# If the effective sample size of a round's weights exceeds this fraction of its number of points,
# the round is extended further, even if it already has many points. The weights are then so nearly
# equal that a new fit of the proposal (the density from which points are drawn) would hardly
# improve them.
_VERY_EFFICIENT = 0.7
# A round of sampling with few points is not extended if its error exceeds this multiple of the
# tolerance. Fitting the proposal (the density from which points are drawn) to all points so far and
# beginning another round is then cheaper.
_REACHABLE = 2.0
# A proposal (the density from which points are drawn) is fitted to weighted points. If the
# effective sample size of the weights is too small, the weights are first made more equal: they are
# raised to a power below one. In h dimensions, the effective sample size suffices if it is at least
# (h + 1) times this number, or at least a third of the number of points.
_FITTED_PER_DIMENSION = 40.0
# A proposal (the density from which points are drawn) is fitted to points with importance weights.
# If a few weights dominate, all weights are made more equal by raising them to a power. The power
# starts at one. The power is multiplied by ``_EVENING`` until the effective sample size of the
# weights suffices, or until the next power would be at most ``_LEAST_POWER``.
_EVENING = 0.8
_LEAST_POWER = 0.02


class _UniformPoints:
    """Points of several Sobol sequences in d dimensions, each randomised independently (scrambled).

    A point has d coordinates between 0 and 1.
    """

    def __init__(self, dimensions: int, rng: np.random.Generator) -> None:
        """Randomise the sequences of points with d ``dimensions``; ``rng`` makes random numbers."""
        self._engines = [qmc.Sobol(dimensions, rng=rng) for _ in range(_SCRAMBLES)]
        self._points = np.zeros((_SCRAMBLES, 0, dimensions))
        # Threads of one process may ask for points at the same time.
        self._lock = Lock()

    def between(self, start: int, stop: int) -> Array:
        """Return the points from the index ``start`` to ``stop`` − 1 of every sequence.

        The points of the first sequence come first. The result has the shape (points, d).
        """
        with self._lock:
            missing = stop - self._points.shape[1]
            if missing > 0:
                new_points = [engine.random(missing) for engine in self._engines]
                self._points = np.concatenate([self._points, new_points], axis=1)
            points = self._points
        return points[:, start:stop].reshape(-1, points.shape[2])


class _SobolSequences:
    """Quasi-random points for every round of importance sampling."""

    def __init__(self, dimensions: int, seed: int) -> None:
        """Prepare points with d ``dimensions``; ``seed`` is the seed of their randomisation."""
        self._dimensions = dimensions
        self._rng = np.random.default_rng(seed)
        self._rounds: list[_UniformPoints] = []
        self._lock = Lock()

    def of_round(self, number: int) -> _UniformPoints:
        """Return the points of one round; ``number`` counts the rounds from 0."""
        with self._lock:
            while len(self._rounds) <= number:
                self._rounds.append(_UniformPoints(self._dimensions, self._rng))
        return self._rounds[number]


@lru_cache(maxsize=_KEPT_SEQUENCES)
def _sobol_sequences(dimensions: int, seed: int) -> _SobolSequences:
    """Return the quasi-random points with d ``dimensions`` that belong to a seed.

    They depend on nothing else, and their randomisation takes milliseconds. They are therefore kept
    for the next campaign of a batch, whose fits all have the same seed.
    """
    return _SobolSequences(dimensions, seed)


def importance_sample(
    log_density: LogFunction,
    modes: Sequence[tuple[Array, Array]],
    *,
    tolerance: float = 1e-2,
    seed: int = 0,
    max_points: int = _MOST_POINTS,
    tries: int = 3,
) -> Integral:
    """Return the integral ∫ f of a density, computed from quasi-random points in several rounds.

    In each round, points are drawn from a proposal, a density similar to f. The weight of a point
    is f divided by the proposal. The proposal of the first round is fitted to f along directions
    through every mode. The proposal of a later round is fitted to the points of all earlier rounds.
    The number of points in a round is doubled as long as the error is too large and the weights are
    not too unequal.

    The integral is taken from the earliest round after the first that reaches the tolerance and
    whose weights can be trusted. If there is no such round, it is taken from the round with the
    smallest error among those with trusted weights or, if no round has trusted weights, among all
    rounds after the first.

    A round may miss a tail of f by chance. If no round has weights that can be trusted, the rounds
    are therefore repeated with other seeds. If no seed gives weights that can be trusted, the
    result of the first seed is returned; its attribute ``trusted`` is false.

    Parameters
    ----------
    log_density : callable
        Function that returns ln f, shape (n,), at n points in h dimensions, shape (n, h).
    modes : sequence of pairs
        One pair for each mode (maximum) of f, the highest mode first: the mode, shape (h,), and a
        square root, shape (h, h), of the inverse of minus the Hessian of ln f at the mode.
    tolerance : float
        Error allowed in ln ∫ f [nat].
    seed : int
        Seed of the randomised quasi-random sequences.
    max_points : int
        Largest number of points of a round.
    tries : int
        Largest number of seeds tried.
    """
    best = _best_of_rounds(log_density, modes, tolerance, seed, max_points)
    if best.trusted or tries < 2:
        return best
    retried = importance_sample(
        log_density,
        modes,
        tolerance=tolerance,
        seed=seed + 1,
        max_points=max_points,
        tries=tries - 1,
    )
    if retried.trusted:
        return retried
    return best


def _best_of_rounds(
    log_density: LogFunction,
    modes: Sequence[tuple[Array, Array]],
    tolerance: float,
    seed: int,
    max_points: int,
) -> Integral:
    """Return the earliest round of sampling that reaches the tolerance, or else the best round.

    In a round, points are drawn and weighted to compute the integral of the density whose logarithm
    is ``log_density``. If no round reaches the tolerance, the round with the smallest error is
    returned. Rounds with weights that can be trusted are preferred. The first round is never
    returned: it only serves to fit the proposal, which is the density from which points are drawn.
    The arguments are the same as in `importance_sample`.
    """
    sequences = _sobol_sequences(len(modes[0][0]) + 1, seed)
    components = tuple(_fit_along_axes(log_density, mode, root) for mode, root in modes)
    fitted = Mixture(components, np.full(len(modes), 1.0 / len(modes)))
    fewest = max(_FEWEST_POINTS, _POINTS_PER_DIMENSION * len(modes[0][0]))
    size = 1 << int(np.ceil(np.log2(fewest)))
    first = _draw_round(log_density, _add_wider(fitted), size, sequences.of_round(0))
    return _best_after(first, log_density, fitted, _GROWTH * size, tolerance, seed, max_points)


def sample_similar(
    log_density: LogFunction,
    earlier: Integral,
    *,
    tolerance: float = 1e-2,
    seed: int = 0,
) -> Integral:
    """Return the integral of a density that is similar to the density of an earlier sample.

    The points of the earlier sample take the place of the first round of `importance_sample`: a
    proposal is fitted to them. No modes are needed. The next round starts with half as many points.

    Parameters
    ----------
    log_density : callable
        Function that returns the log density to integrate, shape (n,), at n points in h dimensions,
        shape (n, h).
    earlier : Integral
        Sample that `importance_sample` has returned. Its density may have been changed.
    tolerance : float
        Error allowed in the log integral [nat].
    seed : int
        Seed of the randomised quasi-random sequences.
    """
    fitted = _without_wider(_proposal_of(earlier))
    size = 1 << int(np.log2(len(earlier.free) // (2 * _SCRAMBLES)))
    return _best_after(earlier, log_density, fitted, size, tolerance, seed, _MOST_POINTS)


def refit_sample(
    log_density: LogFunction, earlier: Integral, points: Array, values: Array, *, seed: int = 0
) -> Integral:
    """Return a sample from a proposal that is fitted to an earlier sample and to more points.

    The new sample has at least half as many points as the two together.

    Parameters
    ----------
    log_density : callable
        Function that returns the log density to integrate, shape (n,), at n points in h dimensions,
        shape (n, h).
    earlier : Integral
        Sample that `importance_sample` or this function has returned.
    points : ndarray, shape (m, h)
        More points drawn from the proposal of the earlier sample.
    values : ndarray, shape (m,)
        Log density at these points.
    seed : int
        Seed of the randomised quasi-random sequences.
    """
    proposal = _proposal_of(earlier)
    all_points = np.concatenate([earlier.free, points])
    all_values = np.concatenate([earlier.log_density, values])
    h = all_points.shape[1]
    weight = _even_out(all_values - proposal.log_density(all_points), h)
    fitted = refit_mixture(_without_wider(proposal), all_points, weight)
    size = 1 << int(np.log2(len(all_points) // _SCRAMBLES))
    uniform = _sobol_sequences(h + 1, seed).of_round(_ROUNDS)
    return _draw_round(log_density, _add_wider(fitted), size, uniform)


def _proposal_of(sample: Integral) -> Mixture:
    """Return the density from which the points of a sample were drawn.

    Raise a `TypeError` if the points are a lattice, because they were then not drawn at random.
    """
    if not isinstance(sample.proposal, Mixture):
        raise TypeError("a lattice has no proposal to fit. Give a sample of importance_sample.")
    return sample.proposal


def _best_after(
    first: Integral,
    log_density: LogFunction,
    fitted: Mixture,
    size: int,
    tolerance: float,
    seed: int,
    max_points: int,
) -> Integral:
    """Return the best of the rounds of sampling that follow the round ``first``.

    ``fitted`` is the proposal of the round ``first`` without its wider components. The second round
    starts with ``size`` points of each randomised quasi-random sequence. `_best_of_rounds` explains
    the rest.
    """
    sequences = _sobol_sequences(first.free.shape[1] + 1, seed)
    rounds = [first]
    proposals = [_add_wider(fitted)]
    while len(rounds) < _ROUNDS:
        fitted = _fit_to_rounds(rounds, proposals, fitted)
        proposal = _add_wider(fitted)
        size = min(size, max_points // _SCRAMBLES)
        refit_points = _GROWTH * size * _SCRAMBLES
        if len(rounds) == _ROUNDS - 1:
            refit_points = max_points
        sample = _draw_round(
            log_density,
            proposal,
            size,
            sequences.of_round(len(rounds)),
            tolerance=tolerance,
            refit_points=refit_points,
            max_points=max_points,
        )
        if sample.trusted and sample.error <= tolerance:
            return sample
        rounds.append(sample)
        proposals.append(proposal)
        size = _GROWTH * size
    return min(rounds[1:], key=_untrusted_and_error)


def _untrusted_and_error(sample: Integral) -> tuple[bool, float]:
    """Return a sort key that puts the better of several importance samples first.

    Samples whose weights can be trusted come before all other samples. Within each of these two
    groups, the samples are in ascending order of the error of the log integral.
    """
    return not sample.trusted, sample.error


def _draw_round(
    log_density: LogFunction,
    proposal: Mixture,
    size: int,
    uniform: _UniformPoints,
    *,
    tolerance: float = np.inf,
    refit_points: int = 0,
    max_points: int = 0,
) -> Integral:
    """Return one round of importance sampling; the number of points is doubled until it suffices.

    Points are drawn from ``proposal``, at first ``size`` points of each randomised quasi-random
    sequence (scramble). Their number suffices if the error of ln ∫ f is at most ``tolerance``
    [nat], where ``log_density`` is ln f. ``uniform`` are the quasi-random points of this round.
    Doubling stops early in the following cases:

    - the weights are very unequal or cannot be trusted;
    - the round would have more than ``max_points`` points;
    - the round would have more than ``refit_points`` points, and the weights are not nearly equal;
    - the round is small, and its error is more than twice the tolerance.

    In the last two cases, a proposal fitted to these points is probably better.
    """
    sample = _extend_sample(log_density, proposal, uniform, size, None)
    while sample.trusted and sample.error > tolerance:
        n = len(sample.free)
        efficiency = sample.ess / n
        if efficiency <= _EFFICIENT or 2 * n > max_points:
            break
        if efficiency <= _VERY_EFFICIENT and 2 * n > refit_points:
            break
        if 16 * n < max_points and sample.error > _REACHABLE * tolerance:
            break
        sample = _extend_sample(log_density, proposal, uniform, n // _SCRAMBLES, sample)
    return sample


def _extend_sample(
    log_density: LogFunction,
    proposal: Mixture,
    uniform: _UniformPoints,
    size: int,
    earlier: Integral | None,
) -> Integral:
    """Return an earlier sample of weighted points together with new points.

    ``proposal`` is the density from which the points of both samples are drawn. ``size`` new points
    are made from the next points of each of the randomised quasi-random sequences ``uniform``.
    ``earlier`` is the earlier sample; if it is None, only the new points are returned.
    ``log_density`` is the logarithm of the density to be integrated.
    """
    used = 0 if earlier is None else len(earlier.free) // _SCRAMBLES
    free = proposal.transform(uniform.between(used, used + size))
    scramble = np.repeat(np.arange(_SCRAMBLES), size)
    values = in_chunks(log_density, free)
    if earlier is not None:
        free = np.concatenate([earlier.free, free])
        scramble = np.concatenate([earlier.estimate, scramble])
        values = np.concatenate([earlier.log_density, values])
    log_volume = -proposal.log_density(free) - np.log(len(free))
    no_edge = np.zeros(len(free), dtype=bool)
    return Integral(free, values, log_volume, scramble, no_edge, proposal)


def _fit_along_axes(log_density: LogFunction, mode: Array, root: Array) -> SplitT:
    """Return a split Student-t distribution fitted to a density along h directions through a mode.

    ``log_density`` is the logarithm of the density to fit. ``mode``, shape (h,), is a maximum of
    ``log_density``; ``root``, shape (h, h), is a square root of the inverse of minus the Hessian of
    ``log_density`` at ``mode``.
    """
    # Use the symmetric square root of the covariance. Of all square roots, it changes the
    # directions of the coordinate axes least. In particular, it does not mix a coordinate with
    # others if the coordinate is not correlated with them.
    variance, vectors = np.linalg.eigh(root @ root.T)
    root = vectors * np.sqrt(variance) @ vectors.T
    z = np.concatenate([-_ALONG_AXIS[::-1], [0.0], _ALONG_AXIS])
    h = len(mode)
    points = (mode + z[:, None, None] * root.T).reshape(-1, h)
    values = in_chunks(log_density, points).reshape(-1, h)
    weight = np.exp(values - values.max(axis=0)) * np.gradient(z)[:, None]
    z_of_axes = np.broadcast_to(z[:, None], values.shape)
    return fit_split_t(mode, root, z_of_axes, weight / weight.sum(axis=0))


def _add_wider(fitted: Mixture) -> Mixture:
    """Return a mixture with one additional, wider component for every component.

    Where a fitted mixture falls off faster than the density to be integrated, a few points would
    have very large weights. The wider components limit these weights (defensive mixture,
    Hesterberg, Technometrics 37 (1995) 185).
    """
    wider = fitted.widen(_WIDE)
    share = np.concatenate([(1.0 - _WIDE_SHARE) * fitted.share, _WIDE_SHARE * wider.share])
    return Mixture((*fitted.components, *wider.components), share)


def _without_wider(proposal: Mixture) -> Mixture:
    """Return a proposal without the wider components that `_add_wider` has added."""
    count = len(proposal.components) // 2
    share = proposal.share[:count]
    return Mixture(proposal.components[:count], share / share.sum())


def _fit_to_rounds(
    rounds: Sequence[Integral], proposals: Sequence[Mixture], fitted: Mixture
) -> Mixture:
    """Return the mixture ``fitted``, refitted to the weighted points of all rounds of sampling.

    ``rounds`` holds the points of each round (values of the hyper-parameters in unbounded
    coordinates), and ``proposals`` the density from which the points of each round were drawn. The
    weight of a point is the density to integrate divided by the mixture of all ``proposals``. In
    this mixture, each proposal has a share proportional to the number of points of its round. If
    the effective sample size of the weights is too small for the fit, the weights are first made
    more equal (``_even_out``).
    """
    points = np.concatenate([sample.free for sample in rounds])
    log_density = np.concatenate([sample.log_density for sample in rounds])
    log_proposals = []
    for sample, proposal in zip(rounds, proposals, strict=True):
        log_proposals.append(np.log(len(sample.free)) + proposal.log_density(points))
    log_weight = log_density - np.logaddexp.reduce(log_proposals, axis=0)
    return refit_mixture(fitted, points, _even_out(log_weight, points.shape[1]))


def _even_out(log_weight: Array, h: int) -> Array:
    """Return the weights of n points in h dimensions, made more equal if few points dominate.

    ``log_weight``, shape (n,), holds the logarithms of the original weights; the weights returned
    sum to one. Weights become more equal if they are raised to a power below one. The power is
    lowered until the effective sample size of the weights suffices to fit a density to the points,
    or until the power is very small.
    """
    sufficient = min(len(log_weight) / 3.0, _FITTED_PER_DIMENSION * (h + 1.0))
    power = 1.0
    while True:
        weight = np.exp(power * (log_weight - log_weight.max()))
        weight = weight / weight.sum()
        is_too_small = 1.0 / (weight**2).sum() < sufficient
        if not is_too_small or _EVENING * power <= _LEAST_POWER:
            return np.asarray(weight)
        power = _EVENING * power
