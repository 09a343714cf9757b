"""Posteriors of the hyper-parameters that an analysis may obtain from planned tests.

The hyper-parameters φ are the prior standard deviations (scales) of the noise and of other effects.
An analysis does not know their true values; it computes their posterior from the readings and the
prior. The uncertainty that the analysis states is an average over this posterior. Large scales keep
a noticeable posterior probability even if the readings scatter little. For example, three circles
that agree do not prove that a fourth circle would agree with them. This module draws
hyper-parameters from the posteriors that an analysis may obtain.

The normal score of a hyper-parameter is the standard normal quantile of its cumulative prior
probability, so that the prior of the scores v is N(0, 1). The readings are normally distributed,
and their covariance V depends on v. Their Fisher information about the scores v_i and v_j is I_ij =
½ tr(V⁻¹ ∂_iV V⁻¹ ∂_jV), where ∂_iV is the derivative of V with respect to v_i. The posterior of the
scores is approximated by a Gaussian with the precision 1 + I and the mean (1 + I)⁻¹ I v̂, where 1
is the identity matrix. Here v̂ ~ N(v, I⁻¹) is a random estimate of the true scores v, with the
covariance of an efficient estimate.

If the planned tests are analysed together with tests that have already been run, the posterior
given the latter takes the place of the prior. It is approximated by the Gaussian with the mean and
covariance of the machines' scores, which are draws from it. I is then the information in the
planned tests alone.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from ldbb_bayes.analysis.design.planned_effects import (
    EffectBlock,
    effects_at,
    inverse_covariance,
)
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.parallel.process_pool import usable_cores
from ldbb_bayes.results import Array

__all__ = ["believed_scales", "fisher_information"]

# Limit for the absolute value of normal scores; scores beyond the limit are replaced by the limit.
# The normal score of a hyper-parameter (scale of the noise or of another effect) is the standard
# normal quantile of its cumulative prior probability. The prior probability of a score beyond the
# limit is below 1e-9 on each side.
_LARGEST_SCORE = 6.0
# Step of the central differences from which the derivatives of the variances of noise and effects
# are computed. The step is a change of a normal score: the standard normal quantile of a
# hyper-parameter's cumulative prior probability.
_STEP = 0.1
# Smallest variance of a normal score before the planned tests. A score that is practically known
# would otherwise make a covariance singular.
_LEAST_SCORE_VARIANCE = 1e-6
# If a plan has more circles than this number, the information about the hyper-parameters is that of
# so many of them, evenly chosen. That of all would take a long time, and would hardly be larger for
# effects that all circles have in common, such as the form of the balls. The noise factors of the
# other circles are assumed to be known.
_MOST_CIRCLES = 24


def believed_scales(
    bound: BoundModel, phi: Array, draws: int, seed: int, *, tests_run: int = 0
) -> Array:
    """Return posterior draws of the hyper-parameters that are expected after the planned tests.

    The hyper-parameters are quantities such as the standard deviation of the noise. The readings of
    the planned tests are not known. For each of several possible machines, one estimate of the true
    hyper-parameters is therefore simulated, and values are drawn from the approximate posterior
    given this estimate.

    Parameters
    ----------
    bound
        Model applied to the planned tests.
    phi
        True hyper-parameters of K possible machines, shape (K, h), lengths in mm.
    draws
        Number of draws of the hyper-parameters for each machine.
    seed
        Seed of the random numbers.
    tests_run
        Number of tests of ``bound`` that have already been run; these come first. Default: none.

    Returns
    -------
    Array
        Hyper-parameters, shape (K, draws, h), lengths in mm.
    """
    machines, size = phi.shape
    chosen = _chosen_circles(bound, tests_run)
    prior = bound.hyper_prior
    limit = ndtr(-_LARGEST_SCORE)
    truth = ndtri(np.clip(prior.level(phi), limit, 1.0 - limit))
    rng = np.random.default_rng(seed)
    error_of_estimate = rng.standard_normal((machines, size))
    spread_of_belief = rng.standard_normal((machines, draws, size))
    before = _ScoresBefore.of(truth, tests_run)
    start = before.standardize(truth)

    def information(scores: Array) -> Array:
        # Return the Fisher information of the planned tests about the standardized scores.
        of_scores = fisher_information(chosen, scores)
        if tests_run:
            names_run = bound.test_names[:tests_run]
            of_scores = of_scores - fisher_information(bound.keeping(names_run), scores)
        return np.asarray(before.root.T @ of_scores @ before.root)

    first = _belief(start, information(truth), error_of_estimate)
    # The Fisher information about a hyper-parameter (standard deviation of the noise or of another
    # effect) increases with its value. The information is therefore computed half-way between the
    # true normal scores of the hyper-parameters and a first estimate of them. This is closer to the
    # average information than the information at the true scores.
    middle = 0.5 * (truth + before.scores(first.mean))
    belief = _belief(start, information(middle), error_of_estimate)
    standardized = belief.mean[:, None] + np.einsum("kij,knj->kni", belief.root, spread_of_belief)
    scores = before.scores(standardized)
    scores = np.clip(scores, -_LARGEST_SCORE, _LARGEST_SCORE)
    scales = np.asarray(prior.quantile(ndtr(scores)))
    factors_left_out = set(bound.setting.circle) - set(chosen.setting.circle)
    columns = [prior.names.index(name) for name in factors_left_out]
    scales[..., columns] = phi[:, None, columns]
    return scales


def _chosen_circles(bound: BoundModel, tests_run: int) -> BoundModel:
    """Return the model of all tests that have been run, and of at most 24 planned tests.

    The first ``tests_run`` tests of ``bound`` have been run. If there are more planned tests, they
    are chosen in even steps.
    """
    names = bound.test_names
    planned = names[tests_run:]
    if len(planned) <= _MOST_CIRCLES:
        return bound
    places = np.linspace(0, len(planned) - 1, _MOST_CIRCLES).round().astype(int)
    return bound.keeping((*names[:tests_run], *(planned[place] for place in places)))


class _ScoresBefore(NamedTuple):
    """Gaussian distribution N(m, R Rᵀ) of h normal scores before the planned tests are run.

    The normal score of a hyper-parameter is the standard normal quantile of its cumulative prior
    probability. Standardized scores w = R⁻¹ (v − m) have the distribution N(0, 1).
    """

    mean: Array  # means m of the normal scores of the h hyper-parameters, shape (h,)
    root: Array  # square root R of the covariance of the h normal scores, shape (h, h)

    @classmethod
    def of(cls, scores: Array, tests_run: int) -> _ScoresBefore:
        """Return the prior of the scores or, if tests have been run, the posterior given these.

        ``scores``, shape (K, h), are draws of the h scores from that distribution. ``tests_run`` is
        the number of tests that have been run. The covariance of the draws is shrunk towards its
        diagonal, because K draws determine correlations only roughly. A single draw determines no
        covariance, so that the prior is returned.
        """
        machines, size = scores.shape
        if not tests_run or machines < 2:
            return cls(np.zeros(size), np.eye(size))
        covariance = np.atleast_2d(np.cov(scores.T))
        shrunk = size / (machines + size)
        diagonal = np.diag(np.maximum(np.diagonal(covariance), _LEAST_SCORE_VARIANCE))
        return cls(
            scores.mean(axis=0),
            np.linalg.cholesky((1.0 - shrunk) * covariance + shrunk * diagonal),
        )

    def standardize(self, scores: Array) -> Array:
        """Return standardized scores, shape (K, h), for scores of the same shape."""
        return np.asarray(np.linalg.solve(self.root, (scores - self.mean).T).T)

    def scores(self, standardized: Array) -> Array:
        """Return scores, shape (..., h), for standardized scores of the same shape."""
        return np.asarray(self.mean + standardized @ self.root.T)


class _Belief(NamedTuple):
    """Gaussian approximations of the posteriors of h normal scores, for K possible machines.

    The normal score of a hyper-parameter is the standard normal quantile of its cumulative prior
    probability.
    """

    # posterior means of the normal scores of h hyper-parameters, for K possible machines, shape (K,
    # h)
    mean: Array
    # symmetric square roots of the posterior covariance matrices of the normal scores of h
    # hyper-parameters, for K possible machines, shape (K, h, h)
    root: Array


def _belief(truth: Array, information: Array, error: Array) -> _Belief:
    """Return Gaussian approximations of the posteriors of h normal scores, for K machines.

    The normal score of a hyper-parameter is the standard normal quantile of its cumulative prior
    probability.

    With the information I and a random estimate v̂ ~ N(v, I⁻¹) of the true scores v, the posterior
    has the mean (1 + I)⁻¹ I v̂ and the covariance (1 + I)⁻¹, where 1 is the identity matrix.

    ``truth``, shape (K, h), are the true scores v of K possible machines. ``information``, shape
    (K, h, h), is the Fisher information I of the readings about the scores. ``error``, shape (K,
    h), are standard normal random numbers, from which the errors of the estimates v̂ are computed.
    """
    size, axes = np.linalg.eigh(information)
    size = np.maximum(size, 0.0)
    # The three matrices computed below (``weight``, ``noise`` and the root of the covariance) have
    # the eigenvectors of the Fisher information matrix, but other eigenvalues. The order and the
    # signs in which ``eigh`` returns the eigenvectors have no influence on them.
    weight = _matrices_with(axes, size / (size + 1.0))
    noise = _matrices_with(axes, np.sqrt(size) / (size + 1.0))
    mean = np.einsum("kij,kj->ki", weight, truth) + np.einsum("kij,kj->ki", noise, error)
    return _Belief(mean, _matrices_with(axes, 1.0 / np.sqrt(size + 1.0)))


def _matrices_with(axes: Array, values: Array) -> Array:
    """Return K symmetric matrices with given eigenvectors and eigenvalues, shape (K, h, h).

    The columns of ``axes``, shape (K, h, h), are the eigenvectors; ``values``, shape (K, h), are
    the eigenvalues.
    """
    return np.asarray((axes * values[:, None]) @ np.swapaxes(axes, -1, -2))


def fisher_information(bound: BoundModel, scores: Array) -> Array:
    """Return the information in planned readings about the normal scores of the hyper-parameters.

    The hyper-parameters are the scales of the noise and of other effects. These effects, among them
    those of the parameters of interest, are integrated out: the readings have the covariance V =
    Σ_c s_c x_c x_cᵀ + σ² 1. Here x_c is the column of changes of the readings per unit of effect c,
    s_c is the variance of this effect, σ² is the variance of the white noise, and the last 1 is the
    identity matrix.

    Parameters
    ----------
    bound
        Model applied to the planned tests.
    scores
        K sets of normal scores of the h hyper-parameters, shape (K, h). A normal score is the
        standard normal quantile of the cumulative prior probability.

    Returns
    -------
    Array
        Fisher information, shape (K, h, h).
    """
    points, size = scores.shape
    # The derivatives of the variances of the effects with respect to the normal scores of the h
    # hyper-parameters are central differences. For each set of scores, the variances of the effects
    # are computed at 2 h + 1 points: at the scores (index 0), with each of the h scores increased
    # by a step (indices 1 to h), and with each score decreased by a step (indices h + 1 to 2 h).
    phi = np.repeat(_phi_at(bound, scores)[:, None], 2 * size + 1, axis=1)
    columns = np.arange(size)
    phi[:, 1 + columns, columns] = _phi_at(bound, scores + _STEP)
    phi[:, 1 + size + columns, columns] = _phi_at(bound, scores - _STEP)
    effects = effects_at(bound, phi.reshape(-1, size))
    variances = effects.variances.reshape(points, 2 * size + 1, -1)
    noise = effects.noise_variance.reshape(points, 2 * size + 1)
    spare = sum(test.readings - len(test.factor) for test in bound.reduced)

    def information_at(k: int) -> Array:
        """Return the Fisher information at one of the K sets of scores, shape (h, h)."""
        slopes = (variances[k, 1 : size + 1] - variances[k, size + 1 :]) / (2.0 * _STEP)
        noise_slope = (noise[k, 1 : size + 1] - noise[k, size + 1 :]) / (2.0 * _STEP)
        of_effects = _information_at(
            effects.blocks, variances[k, 0], noise[k, 0], slopes, noise_slope
        )
        # Of all combinations of a test's readings, only a few were used so far: those that contain
        # information about the effects. The other combinations contain white noise alone; ``spare``
        # is their number. Their information about the noise is added here.
        of_noise = 0.5 * spare * np.outer(noise_slope, noise_slope) / noise[k, 0] ** 2
        return np.asarray(of_effects + of_noise)

    # Threads share the cores: nearly all of the time is spent in BLAS, which runs without Python's
    # global lock.
    with ThreadPoolExecutor(usable_cores()) as pool:
        return np.array(list(pool.map(information_at, range(points))))


def _phi_at(bound: BoundModel, scores: Array) -> Array:
    """Return the h hyper-parameters with given normal scores, shape (K, h), lengths in mm.

    ``scores``, shape (K, h), are standard normal quantiles of the cumulative prior probabilities of
    the hyper-parameters.
    """
    return np.asarray(bound.hyper_prior.quantile(ndtr(scores)))


def _information_at(
    blocks: list[EffectBlock], variances: Array, noise: float, slopes: Array, noise_slope: Array
) -> Array:
    """Return the Fisher information of N reduced readings about h normal scores, shape (h, h).

    The readings of a test are reduced to a few combinations of the readings, which contain all
    information about the effects. The normal score of a hyper-parameter is the standard normal
    quantile of its cumulative prior probability.

    The information about the scores v_i and v_j is I_ij = ½ tr(V⁻¹ ∂_iV V⁻¹ ∂_jV), where V is the
    covariance of the readings and ∂_iV its derivative with respect to v_i. V is the sum of s_c x_c
    x_cᵀ over all effects c, plus the white noise. Here x_c are the changes of the readings per unit
    of effect c, and s_c is the variance of this effect. The sum for I_ij therefore has three parts:
    for pairs of effects, for pairs of an effect and the noise, and for the noise alone.

    Parameters
    ----------
    blocks
        Blocks of the design matrix: first the block of the effects on all tests, then one block for
        each test, with the effects on this test alone. The blocks contain C effects in all.
    variances
        Variance of every effect, shape (C,).
    noise
        Variance of the white noise.
    slopes
        Derivatives of ``variances`` with respect to the normal scores of the h hyper-parameters,
        shape (h, C).
    noise_slope
        Derivatives of ``noise`` with respect to the normal scores of the h hyper-parameters, shape
        (h,).
    """
    precision = inverse_covariance(blocks, variances, noise)
    # Only effects whose variance depends on a hyper-parameter contribute to the Fisher information
    # about the hyper-parameters.
    is_changing: Array = np.asarray(slopes.any(axis=0))
    changing_blocks = []
    for block in blocks:
        columns = block.columns[:, is_changing[block.effects]]
        changing_blocks.append(block._replace(columns=columns))
    # V is the covariance of the readings. X has one column for each effect: the changes of the
    # readings per unit of the effect. ``weighted`` is V⁻¹ X, and ``overlap`` holds the squares of
    # the elements of Xᵀ V⁻¹ X.
    of_blocks = [precision[:, block.readings] @ block.columns for block in changing_blocks]
    weighted = np.concatenate(of_blocks, axis=1)
    overlaps = [block.columns.T @ weighted[block.readings] for block in changing_blocks]
    overlap = np.concatenate(overlaps) ** 2
    slopes_of_effects = slopes[:, is_changing]
    pairs_of_effects = slopes_of_effects @ overlap @ slopes_of_effects.T
    effects_and_noise = np.outer(slopes_of_effects @ (weighted**2).sum(axis=0), noise_slope)
    noise_alone = (precision**2).sum() * np.outer(noise_slope, noise_slope)
    return np.asarray(
        0.5 * (pairs_of_effects + effects_and_noise + effects_and_noise.T + noise_alone)
    )
