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

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy.linalg
from scipy.special import ndtr, ndtri

from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms.columns import BasisNoise, Columns
from ldbb_bayes.results import Array

__all__ = [
    "EffectBlock",
    "Effects",
    "believed_scales",
    "effects_at",
    "fisher_information",
    "inverse_covariance",
]

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
# If a plan has more circles than this number, the analysis is assumed to know the true
# hyper-parameters. With so many circles, an average over their posterior would take a long time,
# and would hardly differ from the result for the true values.
_MOST_CIRCLES = 24


def believed_scales(bound: BoundModel, phi: Array, draws: int, seed: int, *, run: int = 0) -> Array:
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
    run
        Number of tests of ``bound`` that have already been run; these come first. Default: none.

    Returns
    -------
    Array
        Hyper-parameters, shape (K, draws, h), lengths in mm. If there are more than 24 circles, all
        values equal the true values ``phi``.
    """
    machines, size = phi.shape
    if len(bound.campaign.tests) > _MOST_CIRCLES:
        return np.broadcast_to(phi[:, None], (machines, draws, size))
    prior = bound.hyper_prior
    limit = ndtr(-_LARGEST_SCORE)
    truth = ndtri(np.clip(prior.level(phi), limit, 1.0 - limit))
    rng = np.random.default_rng(seed)
    error_of_estimate = rng.standard_normal((machines, size))
    spread_of_belief = rng.standard_normal((machines, draws, size))
    before = _ScoresBefore.of(truth, run)
    start = before.standardize(truth)

    def information(scores: Array) -> Array:
        # Return the Fisher information of the planned tests about the standardized scores.
        of_scores = fisher_information(bound, scores)
        if run:
            names_run = bound.test_names[:run]
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
    return np.asarray(prior.quantile(ndtr(scores)))


class _ScoresBefore(NamedTuple):
    """Gaussian distribution N(m, R Rᵀ) of h normal scores before the planned tests are run.

    The normal score of a hyper-parameter is the standard normal quantile of its cumulative prior
    probability. Standardized scores w = R⁻¹ (v − m) have the distribution N(0, 1).
    """

    mean: Array  # means m of the normal scores of the h hyper-parameters, shape (h,)
    root: Array  # square root R of the covariance of the h normal scores, shape (h, h)

    @classmethod
    def of(cls, scores: Array, run: int) -> _ScoresBefore:
        """Return the prior of the scores or, if tests have been run, the posterior given these.

        ``scores``, shape (K, h), are draws of the h scores from that distribution. ``run`` is the
        number of tests that have been run. The covariance of the draws is shrunk towards its
        diagonal, because K draws determine correlations only roughly. A single draw determines no
        covariance, so that the prior is returned.
        """
        machines, size = scores.shape
        if not run or machines < 2:
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
    steps = np.concatenate([np.zeros((1, size)), _STEP * np.eye(size), -_STEP * np.eye(size)])
    stepped = (scores[:, None] + steps).reshape(-1, size)
    phi = bound.hyper_prior.quantile(ndtr(stepped))
    effects = effects_at(bound, phi)
    variances = effects.variances.reshape(points, 2 * size + 1, -1)
    noise = effects.noise_variance.reshape(points, 2 * size + 1)
    spare = sum(test.readings - len(test.factor) for test in bound.reduced)
    information = np.empty((points, size, size))
    for k in range(points):
        slopes = (variances[k, 1 : size + 1] - variances[k, size + 1 :]) / (2.0 * _STEP)
        noise_slope = (noise[k, 1 : size + 1] - noise[k, size + 1 :]) / (2.0 * _STEP)
        information[k] = _information_at(
            effects.blocks, variances[k, 0], noise[k, 0], slopes, noise_slope
        )
        # Of all combinations of a test's readings, only a few were used so far: those that contain
        # information about the effects. The other combinations contain white noise alone; ``spare``
        # is their number. Their information about the noise is added here.
        information[k] += 0.5 * spare * np.outer(noise_slope, noise_slope) / noise[k, 0] ** 2
    return information


class EffectBlock(NamedTuple):
    """A block of the design matrix: the effects on all tests, or the effects on one test alone.

    The design matrix has one row for each of the N reduced readings (combinations of a test's
    readings) of all tests, and one column for each of the C effects. The block has n of these rows
    and c of these columns. In these c columns, the elements in all other rows are zero.
    """

    # indices of this block's n reduced readings in the list of the reduced readings of all tests. A
    # reduced reading is a combination of the readings of one test.
    readings: slice
    # indices of this block's c effects in the list of all effects on the readings
    effects: slice
    # block of the design matrix: change of each of n reduced readings per unit of each of c
    # effects, shape (n, c)
    columns: Array


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


def inverse_covariance(blocks: list[EffectBlock], variances: Array, noise: float) -> Array:
    """Return the inverse covariance of N reduced readings (combinations of readings), shape (N, N).

    The covariance is V = B + X Xᵀ. B is the block-diagonal covariance due to the white noise and to
    the effects on single tests, with one block for each test. X are the changes of the readings
    when each effect on all tests changes by its standard deviation. By the Woodbury identity, V⁻¹ =
    B⁻¹ − B⁻¹ X (1 + Xᵀ B⁻¹ X)⁻¹ Xᵀ B⁻¹.
    """
    on_all_tests, *on_one_test = blocks
    shared = on_all_tests.columns * np.sqrt(variances[on_all_tests.effects])
    inverse = np.zeros((len(shared), len(shared)))
    weighted = np.empty_like(shared)
    for block in on_one_test:
        covariance = (block.columns * variances[block.effects]) @ block.columns.T
        covariance[np.diag_indices_from(covariance)] += noise
        of_test = np.linalg.inv(covariance)
        inverse[block.readings, block.readings] = of_test
        weighted[block.readings] = of_test @ shared[block.readings]
    root = np.linalg.cholesky(np.eye(shared.shape[1]) + shared.T @ weighted)
    update = scipy.linalg.solve_triangular(root, weighted.T, lower=True)
    return np.asarray(inverse - update.T @ update)


class Effects(NamedTuple):
    """All effects on the reduced readings of planned tests, and the variances of these effects.

    The readings of a test are reduced to a few combinations of the readings, which contain all
    information about the effects. Each effect has w variances, one for each of w sets of
    hyper-parameters.
    """

    # blocks of the design matrix of the readings: first the block of the effects on all tests, then
    # one block for the effects on each single test
    blocks: list[EffectBlock]
    # variances of all C effects on the readings, for each of w sets of hyper-parameters, shape (w,
    # C)
    variances: Array
    # variance of the white noise of the readings [mm²] for each of w sets of hyper-parameters,
    # shape (w,)
    noise_variance: Array


def effects_at(bound: BoundModel, phi: Array) -> Effects:
    """Return all effects on the planned readings, and the variances of these effects.

    ``phi``, shape (w, h), are w sets of the h hyper-parameters, with lengths in mm. The variances
    are computed for each set.
    """
    values = dict(zip(bound.hyper_prior.names, phi.T, strict=True))
    on_all_tests = _effects_on_all_tests(bound, values)
    on_single_tests = [_effects_on_one_test(bound, values, r) for r in range(len(bound.reduced))]
    all_readings, common_effects = on_all_tests.columns.shape
    first_block = EffectBlock(
        slice(0, all_readings), slice(0, common_effects), on_all_tests.columns
    )
    blocks = [first_block]
    # Readings are counted through all tests, and so are effects. ``readings`` and ``effects`` state
    # how many of them come before the next test; they are the first indices of this test.
    readings = 0
    effects = common_effects
    for on_one_test in on_single_tests:
        n, c = on_one_test.columns.shape
        readings_of_test = slice(readings, readings + n)
        effects_of_test = slice(effects, effects + c)
        blocks.append(EffectBlock(readings_of_test, effects_of_test, on_one_test.columns))
        readings += n
        effects += c
    variances = np.concatenate(
        [group.variances for group in (on_all_tests, *on_single_tests)], axis=1
    )
    return Effects(blocks, variances, values["sigma"] ** 2)


class _EffectColumns(NamedTuple):
    """Changes of n readings per unit of each of c effects, and the variances of these effects."""

    # changes of n reduced readings (combinations of a test's readings) per unit of each of c
    # effects, shape (n, c)
    columns: Array
    # variances of the c effects for each of w sets of hyper-parameters, shape (w, c)
    variances: Array


def _effects_on_all_tests(bound: BoundModel, values: Mapping[str, Array]) -> _EffectColumns:
    """Return the design matrix of the effects on all tests, and the variances of these effects.

    These effects are the parameters, and the nuisance coefficients that have the same value in all
    tests. `_effects_on_one_test` treats all other effects: noise, and coefficients that have a
    separate value in each test. ``values`` holds w values of each hyper-parameter, by name; lengths
    are in mm. The variances are prior variances, computed for each of the w values.
    """
    factors = [test.factor for test in bound.reduced]
    interest = [factor @ bound.interest[r] for r, factor in enumerate(factors)]
    columns = [np.concatenate(interest)]
    sds = [bound.scale]
    for effect in bound.nuisance_columns:
        if isinstance(effect, Columns) and effect.names and not effect.private:
            of_tests = [factor @ effect.values[r] for r, factor in enumerate(factors)]
            columns.append(np.concatenate(of_tests))
            sds.append(effect.sd_at(values))
    return _combine_groups(columns, sds, len(values["sigma"]))


def _effects_on_one_test(bound: BoundModel, values: Mapping[str, Array], r: int) -> _EffectColumns:
    """Return the design matrix of the effects on one test only, and the variances of these effects.

    ``r`` is the index of the test. ``values`` holds w values of each hyper-parameter, by name;
    lengths are in mm. The variances are prior variances, computed for each of the w values.
    """
    factor = bound.reduced[r].factor
    columns = [np.empty((len(factor), 0))]
    sds = [np.empty(0)]
    for effect in bound.nuisance_columns:
        if isinstance(effect, BasisNoise):
            columns.append(factor)
            sds.append(effect.sd_at(values, r))
        elif effect.private:
            columns.append(factor @ effect.values[r])
            sds.append(effect.sd_at(values, r))
    return _combine_groups(columns, sds, len(values["sigma"]))


def _combine_groups(columns: list[Array], sds: list[Array], sets: int) -> _EffectColumns:
    """Return one design matrix for several groups of effects, with the variances of the effects.

    For each group, ``columns`` holds the design matrix of the group, and ``sds`` the standard
    deviations of its effects. ``sets`` is the number of sets of hyper-parameters; the result holds
    one variance of each effect for each set.
    """
    variances = []
    for column, sd in zip(columns, sds, strict=True):
        variances.append(np.broadcast_to(sd**2, (sets, column.shape[1])))
    return _EffectColumns(np.concatenate(columns, axis=1), np.concatenate(variances, axis=1))
