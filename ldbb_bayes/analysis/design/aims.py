"""Aims of a campaign that is being run, and how far the campaign is from each aim.

There are two kinds of aims:

- The standard uncertainty of a quantity shall be at most u*. The distance from this aim is
  ln(u/u*), where u is the expected standard uncertainty.
- The readings shall decide between two models: the log Bayes factor in favour of the true model
  shall be at least t. The distance from this aim is ln(t/Φ), where Φ is the expected log Bayes
  factor.

Each distance is a pure number. It is zero if the campaign is expected to just reach the aim, and
positive if the campaign is expected to miss the aim. Distances from several aims can therefore be
added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ldbb_bayes.analysis.design.criteria import LogBayesFactor
from ldbb_bayes.results import Array

__all__ = ["Aim", "SlopesAim", "UncertaintyAim", "total_distance"]

# Weight of an aim that is already reached, when the next circle is chosen; an aim that is not yet
# reached has the weight 1. Because this weight is not zero, a reached aim can still decide between
# two circles that are equally good for all other aims.
_REACHED = 1e-3
# If the expected log Bayes factor of two models [nat] is smaller than this number, it is replaced
# by this number before its logarithm is taken. This avoids the logarithm of zero.
_LEAST_EVIDENCE = 1e-9


class Aim(Protocol):
    """Aim of a campaign that is being run.

    The distance of the campaign from the aim is computed from covariances of the parameters. The
    distance is zero if the campaign is expected to just reach the aim, and positive if the campaign
    is expected to miss the aim.
    """

    @property
    def is_reached(self) -> bool:
        """Whether the circles run so far have already reached the aim of the campaign."""

    def distance(self, covariance: Array) -> Array:
        """Return how far a campaign is expected to miss the aim, averaged over hyper-parameters.

        The result has the shape (...): one distance for each possible next circle. ``covariance``,
        shape (K, ..., p, p), holds the covariance matrices of the p parameters with this circle, in
        units of their prior standard deviations, at K values of the hyper-parameters.
        """

    def is_expected(self, covariance: Array) -> bool:
        """Return whether a campaign is expected to reach the aim.

        ``covariance``, shape (K, p, p), holds the covariances of the p parameters after this
        campaign, in units of their prior standard deviations, at K values of the hyper-parameters.
        """


@dataclass(frozen=True, eq=False)
class UncertaintyAim:
    """Aim to reduce the standard uncertainty of a combination w·β of the parameters to a target.

    β are the p parameters and w their weights. The uncertainty is first computed as if the
    hyper-parameters (such as the standard deviation of the noise) were known. It is then multiplied
    by ``inflation``, because unknown hyper-parameters increase the uncertainty.
    """

    #: weights w of the p parameters β in the combination w·β, shape (p,); the parameters are in
    #: units of their prior standard deviations
    weights: Array
    #: the aim is reached if the standard uncertainty of the combination w·β of the parameters β is
    #: at most this value
    target: float
    #: ratio of two standard uncertainties of the combination w·β, given the readings of the circles
    #: run so far. The numerator is the standard uncertainty with unknown hyper-parameters. The
    #: denominator is the root mean square of K standard uncertainties; each is computed as if the
    #: hyper-parameters were known to have one of K values.
    inflation: float
    #: whether the circles run so far have already reached this aim
    is_reached: bool

    def sd(self, covariance: Array) -> Array:
        """Return the standard uncertainties of the combination w·β, shape (K, ...).

        β are the p parameters, and w are the numbers in ``weights``. ``covariance``, shape (K, ...,
        p, p), are covariances of the p parameters, in units of their prior standard deviations, at
        K values of the hyper-parameters. Further dimensions, written (...), stand for possible
        circles. The uncertainties from these covariances are multiplied by ``inflation``, because
        the hyper-parameters are not known exactly.
        """
        variance = covariance @ self.weights @ self.weights
        return np.asarray(self.inflation * np.sqrt(np.maximum(variance, 0.0)))

    def distance(self, covariance: Array) -> Array:
        """Return the distances ln(u/u*) from the aim, shape (...), averaged over hyper-parameters.

        u is the expected standard uncertainty of the weighted sum of the parameters, and u* is the
        ``target``. ``covariance``, shape (K, ..., p, p), are covariances of the p parameters, in
        units of their prior standard deviations, at K values of the hyper-parameters. Further
        dimensions, written (...), stand for possible circles.
        """
        return np.asarray(np.log(self.sd(covariance) / self.target).mean(axis=0))

    def is_expected(self, covariance: Array) -> bool:
        """Return whether the root mean square of the expected uncertainties meets the target.

        Results state this root mean square as the expected uncertainty. It is larger than the
        geometric mean, from which ``distance`` is computed. ``covariance``, shape (K, p, p), are
        covariances of the p parameters, in units of their prior standard deviations, at K values of
        the hyper-parameters.
        """
        return float(np.sqrt((self.sd(covariance) ** 2).mean())) <= self.target


@dataclass(frozen=True, eq=False)
class SlopesAim:
    """Aim to decide, by the log Bayes factor, whether compliances change with force."""

    #: indices of the slopes (changes of compliance with force) in the list of the model's
    #: parameters
    columns: Sequence[int]
    #: minimum absolute value of the log Bayes factor of linear over constant compliance [nat] at
    #: which one of the two models counts as the true one
    threshold: float
    #: whether the circles run so far already decide between linear and constant compliance
    is_reached: bool

    def distance(self, covariance: Array) -> Array:
        """Return the distances ln(t/Φ) from the aim, shape (...), averaged over hyper-parameters.

        t is ``threshold``, the smallest log Bayes factor that is decisive. Two models are compared:
        compliances that change with force, and constant compliances. Φ is the expected log Bayes
        factor in favour of the model that is true. ``covariance``, shape (K, ..., p, p), are
        covariances of the p parameters, in units of their prior standard deviations, at K values of
        the hyper-parameters. Further dimensions, written (...), stand for possible circles.
        """
        of_slopes = covariance[..., self.columns, :][..., self.columns]
        root = np.linalg.cholesky(np.linalg.inv(of_slopes))
        evidence = np.maximum(LogBayesFactor().value(root), _LEAST_EVIDENCE)
        return np.asarray(np.log(self.threshold / evidence).mean(axis=0))

    def is_expected(self, covariance: Array) -> bool:
        """Return whether the expected log Bayes factor is decisive.

        ``covariance``, shape (K, p, p), are covariances of the p parameters, in units of their
        prior standard deviations, at K values of the hyper-parameters.
        """
        return float(self.distance(covariance)) <= 0.0


def total_distance(aims: Sequence[Aim], covariance: Array) -> Array:
    """Return the weighted sum of the distances from all aims, shape (...).

    The distance from each of ``aims`` is averaged over the hyper-parameters. A distance below zero
    is multiplied by 0.001. The distance from an aim that is already reached is also multiplied by
    0.001. The sum therefore depends mainly on the aims that the campaign is expected to miss.
    ``covariance``, shape (K, ..., p, p), are covariances of the p parameters, in units of their
    prior standard deviations, at K values of the hyper-parameters. Further dimensions, written
    (...), stand for possible circles.
    """
    total = np.zeros(covariance.shape[1:-2])
    for aim in aims:
        distance = aim.distance(covariance)
        weight = 1.0
        if aim.is_reached:
            weight = _REACHED
        total = total + weight * np.where(distance > 0.0, distance, _REACHED * distance)
    return total
