"""Posterior density p(φ | y) of the hyper-parameters, its modes, and its integral with nodes.

y are the readings; φ are the h hyper-parameters, such as the standard deviation of the noise; β are
the p parameters: compliances, their changes with force, and geometric errors. The readings depend
linearly on β and on the effects that are modelled but not of interest. Both are therefore
integrated out exactly. Truncation T restricts β to compliances that are not negative; P(T | y, φ)
is the probability that β meets this condition. Free coordinates are φ transformed to be unbounded,
mostly ln(φ − lower bound). A node is one value of φ; many nodes with weights represent p(φ | y).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.stats import qmc

from ldbb_bayes.inference.density_ratio import RatioIntegral, RatioSampler
from ldbb_bayes.inference.importance_sampling import (
    importance_sample,
    refit_sample,
    sample_similar,
)
from ldbb_bayes.inference.integrals import Integral
from ldbb_bayes.inference.mode_search import Mode, ModeSearch
from ldbb_bayes.inference.normal_scores import NormalScores
from ldbb_bayes.inference.quadrature import integrate
from ldbb_bayes.inference.truncation_factor import (
    ProbabilityInside,
    TruncationFactor,
    mean_probability_inside,
)
from ldbb_bayes.model.conditional import GivenHyperParameters
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = ["HyperPosterior"]

# Number of points at which the density is computed to choose the starting points of the search for
# modes (maxima) of the posterior.
_STARTS = 256
# Coarse nodes are weighted values of the hyper-parameters that serve where a rough integral
# suffices. ``_COARSE_TOLERANCE`` is the error allowed in the log integral from coarse nodes [nat].
# ``_COARSE_STEP`` is the spacing of coarse nodes on a lattice, in standard deviations of the
# Gaussian fitted at the highest mode.
_COARSE_TOLERANCE = 0.2
_COARSE_STEP = 1.25
# The nodes of smallest weight are skipped when the probability that no compliance is negative is
# computed. The share of the integral that belongs to these nodes is at most the tolerance [nat]
# divided by this number.
_PARTS_OF_TOLERANCE = 20.0
# The nodes of smallest weight are skipped when the probability that no compliance is negative is
# computed. With a larger tolerance, more nodes are skipped, but together the skipped nodes never
# hold more than this share of the integral.
_LARGEST_LEFT_OUT = 5e-4
# The error of the log evidence is the sum of two errors. One is the error of the integral over the
# nodes, the other that of the probability that no compliance is negative. If the first error is
# within the tolerance but the sum is not, new nodes are computed with the tolerance multiplied by
# this factor.
_NODES_SHARE = 0.7
# New nodes may be drawn from a proposal that is fitted to other nodes. The error of their integral
# may be this fraction of the tolerance, because the probability that no compliance is negative is
# then computed at a few of them, which has an error of its own.
_SHARE_OF_RESAMPLED = 0.8
# Error allowed in the logarithm of the rough posterior probability that no compliance is negative
# [nat], see `coarse_probability`.
_PROBABILITY_TOLERANCE = 0.02


class HyperPosterior:
    """Posterior density of the hyper-parameters φ given the readings y, in free coordinates.

    Searches and integrals use two things that are easier to compute with. The smooth density is the
    posterior density with a smooth upper bound in place of P(T | y, φ); without truncation, it is
    the posterior density itself. Normal scores are coordinates in which every prior is standard
    normal, except the priors of factors that multiply the noise of single circles
    (`normal_scores`).

    Parameters
    ----------
    bound : BoundModel
        The model of the campaign.
    truncated : bool
        Whether the density is multiplied by P(T | y, φ). This is the probability, given y and φ, of
        the condition T that no compliance is negative. The argument may differ from what the model
        requires.
    seed : int
        Seed of the starting points of the search for modes, and of the quasi-random points from
        which P(T | y, φ) is computed.
    near : ndarray, shape (h,), optional
        Mode of a similar density, in free coordinates. The search for modes then starts from this
        point first.
    """

    def __init__(
        self, bound: BoundModel, *, truncated: bool, seed: int = 0, near: Array | None = None
    ) -> None:
        """Describe the posterior of the hyper-parameters of the model ``bound`` of a campaign.

        Nothing is computed yet. ``truncated`` states whether the condition that no compliance is
        negative is part of the posterior. ``seed`` is the seed of quasi-random points. ``near``,
        shape (h,), is None or the mode of a similar posterior of the h hyper-parameters, in
        unbounded coordinates; the search for modes starts there.
        """
        self.bound = bound
        self.truncated = truncated
        self._seed = seed
        self._near = near
        self._integrals: dict[float, Integral] = {}

    @cached_property
    def _scores(self) -> NormalScores:
        """Transformation between normal scores and free coordinates of the hyper-parameters."""
        return NormalScores(self.bound.hyper_prior)

    @cached_property
    def modes(self) -> list[Mode]:
        """Modes (maxima) of the smooth posterior density, the highest first.

        There are at most three modes, or four if the mode of a similar density (``near``) was
        given. The density is a function of the normal scores of the h hyper-parameters.
        """
        return self._search.modes(self._starts())

    @cached_property
    def _search(self) -> ModeSearch:
        """Search for maxima of the smooth posterior density of normal scores."""
        is_noise_factor = np.array([law == "circle" for law in self.bound.hyper_prior.laws])
        return ModeSearch(self._smooth_log_density, is_noise_factor)

    @property
    def mode(self) -> Array:
        """Values of the h hyper-parameters φ where the smooth density is highest, shape (h,).

        The values are returned in free coordinates. The density, however, is that of the normal
        scores, which are other coordinates.
        """
        return self._scores.free(self.modes[0][0])

    def given(self, free: Array) -> GivenHyperParameters:
        """Return ln p(y | φ), shape (w,), and the Gaussian densities p(β | y, φ) for w values of φ.

        y are the readings, β the parameters (compliances, their changes with force, geometric
        errors), and φ the h hyper-parameters. ``free``, shape (w, h), holds φ in free coordinates.
        The Gaussians allow negative compliances.
        """
        return self.bound.given(self.bound.hyper_prior.phi(free))

    def log_density(self, free: Array) -> Array:
        """Return the joint log density of readings and hyper-parameters at w points, shape (w,).

        ``free``, shape (w, h), holds w values of the h hyper-parameters φ in free coordinates. If
        ``truncated`` of this object is True, the log probability that no compliance is negative,
        given φ and the readings, is added. At points where the prior density is zero, the result is
        −∞.
        """
        prior = self.bound.hyper_prior
        return self._add_likelihood(prior.log_density_of_free(free), prior.phi(free), smooth=False)

    def _add_likelihood(self, log_prior: Array, phi: Array, *, smooth: bool) -> Array:
        """Return ``log_prior`` plus the log density of the readings at w points, shape (w,).

        ``log_prior``, shape (w,), is the log prior density of the points, in any coordinates;
        points where it is −∞ stay there. ``phi``, shape (w, h), holds the values of the h
        hyper-parameters at the points. If the field ``truncated`` is true, the log probability that
        no compliance is negative is added. If ``smooth`` is true, an upper bound of this
        probability is used instead, which is cheaper to compute and is a smooth function of φ.
        """
        log_density = np.array(log_prior)
        finite = np.isfinite(log_density)
        if not finite.any():
            return log_density
        if not self.truncated:
            log_density[finite] += self.bound.log_evidence(phi[finite])
            return log_density
        log_evidence, conditional = self.bound.given(phi[finite])
        if smooth:
            log_probability = conditional.orthant.log_bound
        else:
            log_probability = conditional.orthant.log_probability(seed=self._seed)[0]
        log_density[finite] += log_evidence + log_probability
        return log_density

    def integral(self, tolerance: float) -> RatioIntegral:
        """Return the integral of the density, with the nodes that represent the posterior.

        ``tolerance`` is the error allowed in the logarithm of the integral of the density [nat]. If
        the nodes do not reach this tolerance, the integral states a larger ``error``.

        If the attribute ``truncated`` is True, the posterior density of φ has the factor P(φ): the
        probability, given φ and the readings, that no compliance is negative. First, nodes are
        computed for the density without this factor, and their weights are multiplied by P(φ). If
        the error of the integral over these nodes exceeds the tolerance, new nodes are computed
        from a proposal that is fitted to these weights (`_resample_truncated`). If their error is
        too large, too, nodes are computed for the density with an upper bound B(φ) in place of
        P(φ). The weights of these nodes are multiplied by P(φ) / B(φ). The set with the smaller
        error is returned.
        """
        if not self.truncated:
            return RatioIntegral(self._smooth_integral(tolerance), 0.0)
        untruncated = self.without_truncation
        resampled = self._resample_truncated(untruncated._smooth_integral(tolerance), tolerance)
        if resampled is not None:
            return resampled
        truncated = self.truncate(untruncated._smooth_integral(tolerance), tolerance)
        if truncated.integral.error <= tolerance and not truncated.meets(tolerance):
            finer = untruncated._smooth_integral(_NODES_SHARE * tolerance)
            truncated = self.truncate(finer, tolerance)
        if truncated.integral.error <= tolerance:
            return truncated
        bounded = self.truncate(self._smooth_integral(tolerance), tolerance, bounded=True)
        if bounded.error < truncated.error:
            return bounded
        return truncated

    def _smooth_integral(self, tolerance: float) -> Integral:
        """Return the integral of the smooth posterior density, computed once for each tolerance.

        ``tolerance`` is the error allowed in the log integral [nat].
        """
        if tolerance not in self._integrals:
            self._integrals[tolerance] = self._integrate(tolerance)
        return self._integrals[tolerance]

    def _integrate(self, tolerance: float, *, step: float | None = None) -> Integral:
        """Return the integral of the smooth posterior density, with nodes in free coordinates.

        ``tolerance`` is the error allowed in the log integral [nat]; if it is not reached, the
        integral states its larger error. ``step`` is the first spacing of the nodes if they form a
        lattice, in standard deviations of the Gaussian fitted at the highest mode; by default, it
        is computed from the tolerance.
        """
        integral = integrate(
            self._smooth_log_density,
            [*self.modes, *self._corners],
            tolerance=tolerance,
            step=step,
            seed=self._seed,
        )
        return self._scores.to_free(integral)

    def _resample_truncated(self, integral: Integral, tolerance: float) -> RatioIntegral | None:
        """Return the integral of the density with truncation from that without it, if possible.

        P(T | y, φ) is the probability, given the readings y and φ, of the condition T that no
        compliance is negative. ``integral`` holds the nodes of the density that allows negative
        compliances. If P(T | y, φ) at a few of these nodes suffices for the ``tolerance``, they are
        returned with weights multiplied by P(T | y, φ). If it does not, a proposal is fitted to
        these weights, and new nodes are drawn from it for the density with a smooth upper bound in
        place of P(T | y, φ). At a few of the new nodes, the bound is then replaced by P(T | y, φ).
        The result is None if the new nodes do not reach the tolerance either, or if no nodes could
        be drawn.
        """
        attempt = None
        factor = self._truncation_factor(integral, tolerance)
        for attempt in RatioSampler(integral).attempts(factor.log_truncated_density):
            if attempt.error <= tolerance:
                return attempt
            if attempt.least_error > tolerance:
                break
        is_sample = integral.proposal is not None
        if attempt is None or not is_sample or not np.isfinite(attempt.error):
            return None
        sample = sample_similar(
            self._smooth_log_density,
            self._scores.from_free(attempt.integral),
            tolerance=_SHARE_OF_RESAMPLED * tolerance,
            seed=self._seed,
        )
        resampled = self._scores.to_free(sample)
        resampled_factor = self._truncation_factor(resampled, tolerance, bounded=True)
        return RatioSampler(resampled).integrate(resampled_factor.log_truncated_density, tolerance)

    def truncate(
        self,
        integral: Integral,
        tolerance: float,
        *,
        bounded: bool = False,
    ) -> RatioIntegral:
        """Return an integral times the probability that no compliance is negative at its nodes.

        P(T | y, φ) is the probability, given the readings y and φ, of the condition T that no
        compliance is negative. This probability is computed only at some of the nodes
        (`density_ratio`). If the error would then exceed the tolerance, the probability is computed
        at all nodes except those of smallest weight.

        Parameters
        ----------
        integral : Integral
            Integral of the density that allows negative compliances, with its nodes.
        tolerance : float
            Error allowed in the log integral [nat].
        bounded : bool
            Whether the density in ``integral`` includes an upper bound of P(T | y, φ) as a factor.
            The bound is then replaced by P(T | y, φ).
        """
        factor = self._truncation_factor(integral, tolerance, bounded=bounded)
        sampled = RatioSampler(integral).integrate(factor.log_truncated_density, tolerance)
        if sampled is not None:
            return sampled
        spare = min(tolerance / _PARTS_OF_TOLERANCE, _LARGEST_LEFT_OUT)
        truncated = integral.times(factor.log_factor, spare)
        return RatioIntegral(truncated, factor.error(truncated.weight))

    def _truncation_factor(
        self, integral: Integral, tolerance: float, *, bounded: bool = False
    ) -> TruncationFactor:
        """Return the density with truncation at the nodes of ``integral``, to be computed there.

        The arguments are those of `truncate`.
        """
        return TruncationFactor(
            self.bound, integral, tolerance=tolerance, seed=self._seed, bounded=bounded
        )

    def probability_inside(self, integral: Integral, tolerance: float) -> ProbabilityInside:
        """Return the posterior probability that no compliance is negative, from a few nodes.

        ``integral`` is that of the density that allows negative compliances, with its nodes, and
        ``tolerance`` is the error allowed in the log probability [nat]. `mean_probability_inside`
        explains how many nodes are used.
        """
        return mean_probability_inside(self.bound, integral, tolerance=tolerance, seed=self._seed)

    @cached_property
    def without_truncation(self) -> HyperPosterior:
        """Posterior density of the hyper-parameters that allows negative compliances.

        If the density of this object already allows negative compliances, the result is this object
        itself.
        """
        if not self.truncated:
            return self
        return HyperPosterior(self.bound, truncated=False, seed=self._seed, near=self._near)

    @cached_property
    def weighted_sample(self) -> Integral:
        """Weighted random values of the hyper-parameters, drawn from a mixture.

        The mixture is fitted to the posterior density, and further values can be drawn from the
        mixture. The values with their weights represent the posterior. If ``truncated`` is true,
        one factor of the posterior density is the probability that no compliance is negative. The
        values are weighted with an upper bound of this probability instead.
        """
        sample = importance_sample(
            self._smooth_log_density,
            [*self.modes, *self._corners],
            tolerance=_COARSE_TOLERANCE / 4.0,
            seed=self._seed,
        )
        return self._scores.to_free(sample)

    def refitted_sample(self, sample: Integral, free: Array, log_density: Array) -> Integral:
        """Return weighted random values as `weighted_sample`, from a mixture that is fitted anew.

        ``sample`` are the earlier values, from this function or from `weighted_sample`.
        ``free``, shape (n, h), holds n more values drawn from the same mixture, in unbounded
        coordinates, and ``log_density``, shape (n,), the log of the posterior density there.
        """
        scores = self._scores.scores(free)
        refitted = refit_sample(
            self._smooth_log_density,
            self._scores.from_free(sample),
            scores,
            log_density + self._scores.log_jacobian(scores),
            seed=self._seed,
        )
        return self._scores.to_free(refitted)

    @cached_property
    def coarse_probability(self) -> ProbabilityInside:
        """Rough posterior probability that no compliance is negative.

        The result is the mean, over nodes, of the probability given the hyper-parameters. The nodes
        are picked from ``without_truncation.weighted_sample``: weighted random values that
        represent the posterior in which compliances may be negative. More nodes are picked until
        the error of the log probability is at most 0.02 nat, but not more than
        ``without_truncation.weighted_sample`` holds. If these are too few, the error exceeds 0.02
        nat.
        """
        return self.probability_inside(
            self.without_truncation.weighted_sample, _PROBABILITY_TOLERANCE
        )

    @cached_property
    def coarse_integral(self) -> Integral:
        """Coarse nodes of the posterior density: weighted values of the hyper-parameters.

        The error allowed in the log integral from coarse nodes is 0.2 nat. If ``truncated`` is
        true, one factor of the posterior density is the probability that no compliance is negative.
        The coarse nodes are computed with an upper bound of this probability instead.
        """
        return self._integrate(_COARSE_TOLERANCE, step=_COARSE_STEP)

    @cached_property
    def coarse_integral_truncated(self) -> Integral:
        """Coarse nodes of the posterior density.

        They are the nodes of `coarse_integral` with more accurate weights. If ``truncated`` is
        true, each weight in `coarse_integral` was multiplied by an upper bound of the probability
        that no compliance is negative. Here, this bound is replaced by the probability itself.
        """
        return self._replace_bound(self.coarse_integral)

    @cached_property
    def weighted_sample_truncated(self) -> Integral:
        """Random values of the hyper-parameters, weighted to represent their posterior density.

        The values are those in `weighted_sample`. If ``truncated`` is true, each weight there was
        multiplied by an upper bound of the probability that no compliance is negative. Here, this
        bound is replaced by the probability itself.
        """
        return self._replace_bound(self.weighted_sample)

    def _replace_bound(self, integral: Integral) -> Integral:
        """Return an integral with more accurate weights of its nodes.

        If ``truncated`` is true, each weight in the given ``integral`` was multiplied by an upper
        bound of the probability that no compliance is negative. In the result, this bound is
        replaced by the probability itself. The error allowed in the log integral is 0.2 nat, so
        that the probability is usually computed at some of the nodes only (`truncate`). If
        ``truncated`` is false, ``integral`` is returned unchanged.
        """
        if not self.truncated:
            return integral
        return self.truncate(integral, _COARSE_TOLERANCE, bounded=True).integral

    def _starts(self) -> list[Array]:
        """Return the starting points of the search for modes (maxima) of the posterior density.

        If the mode of a similar density was given, it is the first point. Further points are chosen
        from many points (`ModeSearch.starts`). They are always needed, because a search from the
        mode of a similar density may end at a lower maximum. Each point, shape (h,), holds the
        normal scores of the h hyper-parameters.
        """
        similar: list[Array] = []
        if self._near is not None:
            similar.append(self._scores.scores(self._near))
        prior = self.bound.hyper_prior
        sobol = qmc.Sobol(len(prior.names), rng=np.random.default_rng(self._seed))
        spread_over_prior = self._scores.scores(prior.starts(sobol.random(_STARTS)))
        return similar + self._search.starts(spread_over_prior)

    @cached_property
    def _corners(self) -> list[Mode]:
        """Maxima of the smooth posterior density with one hyper-parameter held near zero.

        There is at most one maximum for each hyper-parameter that is a length and may be zero;
        negligible maxima are left out. The posterior density may extend far towards zero in one
        hyper-parameter. Near zero, the most probable values of the other hyper-parameters may
        differ from those at the mode. The proposal (the density from which points are drawn) covers
        this region if it is also fitted at these maxima.
        """
        prior = self.bound.hyper_prior
        axes = np.flatnonzero(prior.in_mm & (prior.lower == 0.0))
        return self._search.corners(self.modes[0], axes)

    def _smooth_log_density(self, scores: Array) -> Array:
        """Return the log of the smooth posterior density of normal scores at w points, shape (w,).

        ``scores``, shape (w, h), holds the normal scores of the h hyper-parameters.
        """
        phi = self.bound.hyper_prior.phi(self._scores.free(scores))
        return self._add_likelihood(self._scores.log_prior(scores), phi, smooth=True)
