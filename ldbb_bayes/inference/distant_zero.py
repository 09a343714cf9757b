"""Check of the zero of the readings: whether all of them have too large a constant in common."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ldbb_bayes.inference.coefficients import ModelDraws, names_of_shared, shared_terms
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms import BarLength
from ldbb_bayes.results import Array

__all__ = ["DistantZero", "distant_zeros"]

# A constant in all readings counts as too large if it exceeds this number of the standard
# deviations that it has if the model is right.
_LARGEST_DISTANCE = 3.0
# Largest number of posterior draws from which a constant in all readings is estimated.
_DRAWS = 1000
# Smallest share of the prior variance of the bar's length by which the readings reduce it. A
# smaller share is replaced by this number, to avoid a division by zero.
_SMALLEST_KNOWN_SHARE = 1e-6


class DistantZero(NamedTuple):
    """A constant that all readings at one radius have in common, larger than expected."""

    name: str  # name of the coefficient of the bar's length at this radius
    # constant by which the readings lie away from what is expected [mm]: the error of the bar's
    # length if nothing were known of it beforehand, minus the error that is stated
    distance_mm: float
    expected_mm: float  # largest size of this constant to be expected [mm]


def distant_zeros(bound: BoundModel, phi: Array, beta: Array) -> Iterator[DistantZero]:
    """Yield the constant of each radius whose readings have too large a constant in common.

    An error of the bar's length adds a constant to all readings, and so does a zero that was not
    set. Scale errors of the axes have a constant part, and would take up most of a wrong zero. Let
    m₀ and σ be the prior mean and standard deviation of the bar's length error, m its posterior
    mean and v its posterior variance. Without this prior, the readings would give the error
    m₀ + (m − m₀) / (1 − v/σ²). If the model is right, this estimate is normally distributed about
    m₀ with the standard deviation σ / √(1 − v/σ²).

    Parameters
    ----------
    bound
        Model of the campaign.
    phi
        Posterior draws of the hyper-parameters, in mm, N and rad, shape (n, h).
    beta
        Posterior draws of the parameters, in mm, N and rad, shape (n, p).

    Yields
    ------
    DistantZero
    """
    information = information_of(bound, phi.mean(axis=0))
    bar_lengths = shared_terms(bound.columns_of.get(BarLength, ()))
    if information.flat or not bar_lengths:
        return
    (bar_length,) = bar_lengths
    shared_names = names_of_shared(bound)
    draws = ModelDraws(bound, phi, beta).thinned(_DRAWS)
    _, conditional = bound.likelihood_given_parameters.conditional(
        draws.phi, draws.beta - bound.least_squares_estimate
    )
    posterior_means = conditional.mean.mean(axis=0)
    remaining_shares = np.diag(information.covariance())
    prior_means = bar_length.prior_mean.tolist()
    for name, prior_mean in zip(bar_length.names, prior_means, strict=True):
        k = information.names.index(name)
        known_share = max(1.0 - float(remaining_shares[k]), _SMALLEST_KNOWN_SHARE)
        posterior_mean = float(posterior_means[shared_names.index(name)])
        distance = (posterior_mean - prior_mean) / known_share
        expected = _LARGEST_DISTANCE * float(information.scale[k]) / np.sqrt(known_share)
        if abs(distance) > expected:
            yield DistantZero(name, distance, float(expected))
