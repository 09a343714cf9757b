"""Warnings about a posterior that contradicts what the model, or the user, stated beforehand."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ldbb_bayes.campaign.unlikely_spans import unlikely_spans
from ldbb_bayes.inference.centre_shift import SHIFTED, centre_shift
from ldbb_bayes.inference.contradicted_certificates import (
    LEAST_RATIO_OF_STATED_BALLS,
    log_ratio_of_stated_balls,
)
from ldbb_bayes.inference.distant_zero import distant_zeros
from ldbb_bayes.inference.fit import Concern, ConcernKind
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = ["concerns_of_posterior", "contradicted_priors", "limits_of_compliances_near_zero"]

# About the number of posterior draws from which it is checked whether the readings contradict the
# stated form of the balls.
_VALUES_FOR_BALLS = 128
# If the log posterior probability that no compliance is negative is below this limit, the readings
# contradict the condition that no compliance is negative.
_IMPROBABLE = float(np.log(1e-3))
# A warning is given if the posterior median of a hyper-parameter (scale of the noise or of another
# effect) is above the quantile of its prior at this probability.
_HYPER_PRIOR_PROBABILITY = 0.999
# A fit warns if the distance between the posterior mean of a parameter and the prior mean that the
# user stated exceeds this limit. The unit of the limit is the standard deviation that the distance
# has if the prior is right.
_LARGEST_PRIOR_DISTANCE = 3.0
# A compliance that cannot be negative may be zero if its posterior mean is at most ``_EXPANSION``
# standard deviations (the expanded uncertainty U, k = 2). The fit then states the value below which
# the compliance lies with the probability ``_PROBABILITY_OF_UPPER``.
_EXPANSION = 2.0
_PROBABILITY_OF_UPPER = 0.95
# The distance between the prior mean and the posterior mean of a parameter is divided by the
# standard deviation that this distance has if the prior is right. To avoid a division by zero, the
# variance of the distance is taken to be at least this fraction of the prior variance.
_SMALLEST_VARIANCE_SHARE = 0.05


def concerns_of_posterior(
    bound: BoundModel, phi: Array, beta: Array, log_prob_truncation: float
) -> Iterator[Concern]:
    """Check a posterior against the assumptions of its model, and yield warnings.

    There is a warning for each assumption that the posterior contradicts, and a warning if there
    are too few different forces to check an assumption. `Concern` describes the kinds of warnings:
    TRUNCATION, FORCES, HYPER, PRIOR, ZERO, UNIT, BALLS, CENTRE and NEAR_ZERO.

    Parameters
    ----------
    bound : BoundModel
        Model applied to the campaign.
    phi : array
        The n posterior draws of the h hyper-parameters, shape (n, h); those that are lengths are in
        mm.
    beta : array
        The n posterior draws of the p parameters, shape (n, p), in internal units (mm, N, rad).
    log_prob_truncation : float
        Log posterior probability that no compliance is negative.

    Yields
    ------
    Concern
    """
    if log_prob_truncation < _IMPROBABLE:
        yield Concern(ConcernKind.TRUNCATION, log_prob_truncation, _IMPROBABLE)
    levels = bound.campaign.force_levels
    needed = bound.model.degree + 2
    if levels < needed:
        yield Concern(ConcernKind.FORCES, levels, needed)
    yield from contradicted_priors(bound, phi, beta)
    for axis, p in centre_shift(bound, beta.mean(axis=0)).items():
        yield Concern(ConcernKind.CENTRE, p, SHIFTED, axis)
    yield from _compliances_near_zero(bound, beta)


def contradicted_priors(bound: BoundModel, phi: Array, beta: Array) -> Iterator[Concern]:
    """Yield a warning for everything known beforehand that the readings contradict.

    `Concern` describes the kinds of these warnings: HYPER, PRIOR, ZERO, UNIT and BALLS.

    Parameters
    ----------
    bound : BoundModel
        Model applied to the campaign.
    phi : array
        The n posterior draws of the h hyper-parameters, shape (n, h); those that are lengths are in
        mm.
    beta : array
        The n posterior draws of the p parameters, shape (n, p), in internal units (mm, N, rad).

    Yields
    ------
    Concern
    """
    yield from _large_hyper_parameters(bound, phi)
    yield from _distant_means(bound, beta)
    for zero in distant_zeros(bound, phi, beta):
        yield Concern(ConcernKind.ZERO, zero.distance_mm, zero.expected_mm, zero.name)
    for span in unlikely_spans(bound.campaign):
        yield Concern(ConcernKind.UNIT, span.span_um * 1e-3, span.limit_um * 1e-3, span.test)
    thinned_phi = phi[:: max(1, len(phi) // _VALUES_FOR_BALLS)]
    log_ratio = log_ratio_of_stated_balls(bound, np.ones(len(thinned_phi)), thinned_phi)
    if log_ratio < LEAST_RATIO_OF_STATED_BALLS:
        yield Concern(ConcernKind.BALLS, log_ratio, LEAST_RATIO_OF_STATED_BALLS)


def _large_hyper_parameters(bound: BoundModel, phi: Array) -> Iterator[Concern]:
    """Yield a warning for each hyper-parameter with a median above the 99.9 % prior quantile.

    Only hyper-parameters (such as the standard deviation of the noise) that are lengths are
    examined. ``phi``, shape (n, h), holds n posterior draws of all h hyper-parameters; those that
    are lengths are in mm. ``bound`` is the model of the campaign.
    """
    prior = bound.hyper_prior
    limits = prior.quantile(np.full(phi.shape[1], _HYPER_PRIOR_PROBABILITY))
    medians = np.median(phi, axis=0)
    for name, median, limit, is_length in zip(
        prior.names, medians, limits, prior.in_mm, strict=True
    ):
        if is_length and median > limit:
            yield Concern(ConcernKind.HYPER, float(median), float(limit), str(name))


def _distant_means(bound: BoundModel, beta: Array) -> Iterator[Concern]:
    """Yield a warning for each parameter whose posterior mean is too far from its prior mean.

    Only parameters for which the user stated a prior are examined. ``beta``, shape (n, p), holds n
    posterior draws of the p parameters in internal units (mm, N, rad). ``bound`` is the model
    of the campaign.
    """
    stated = {*bound.model.prior.overrides, *bound.model.prior.means}
    prior_variance = bound.prior_sd**2
    # If the prior of a parameter is right, the distance of its posterior mean from its prior mean
    # is a random draw from a normal distribution about zero. The variance of this distribution is
    # the prior variance minus the posterior variance.
    expected_variance = np.maximum(
        prior_variance - beta.var(axis=0), _SMALLEST_VARIANCE_SHARE * prior_variance
    )
    distance = np.abs(beta.mean(axis=0) - bound.prior_mean) / np.sqrt(expected_variance)
    for name, z in zip(bound.names, distance, strict=True):
        if z > _LARGEST_PRIOR_DISTANCE and name in stated:
            yield Concern(ConcernKind.PRIOR, float(z), _LARGEST_PRIOR_DISTANCE, name)


def _compliances_near_zero(bound: BoundModel, beta: Array) -> Iterator[Concern]:
    """Yield a warning for each compliance that cannot be negative and may be zero.

    The warning states the value below which the compliance lies with a probability of 95 %, see
    `limits_of_compliances_near_zero`.
    """
    for name, upper in limits_of_compliances_near_zero(bound, beta).items():
        j = bound.names.index(name)
        unit = bound.parameters[j].unit
        yield Concern(ConcernKind.NEAR_ZERO, float(beta[:, j].mean()), upper, name, unit)


def limits_of_compliances_near_zero(bound: BoundModel, beta: Array) -> dict[str, float]:
    """Return upper limits of the compliances that cannot be negative and may be zero.

    Credible intervals have equal tails. The interval of such a compliance leaves out the values
    next to zero, where the compliance may well lie. The value below which it lies with a
    probability of 95 % is then to be stated instead. A compliance may be zero if its posterior mean
    is at most two standard deviations.

    Parameters
    ----------
    bound : BoundModel
        Model of the campaign.
    beta : array
        The n posterior draws of the p parameters, shape (n, p), in internal units (mm, N, rad).

    Returns
    -------
    dict
        The limits in internal units; the keys are the names of the compliances.
    """
    is_restricted = (bound.truncation.rows != 0.0).any(axis=0)
    is_near_zero = beta.mean(axis=0) <= _EXPANSION * beta.std(axis=0)
    limits = {}
    for j in np.flatnonzero(is_restricted & is_near_zero):
        parameter = bound.parameters[j]
        if parameter.group == "compliance":
            limits[parameter.name] = float(np.quantile(beta[:, j], _PROBABILITY_OF_UPPER))
    return limits
