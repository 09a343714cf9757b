"""Aims of a campaign under way, and the distances from them after one more circle.

There are two kinds of aims. One is that a quantity has at most the standard uncertainty u*. If the
uncertainty u is expected, the distance from this aim is ln(u/u*). The other is a decision between
two models: the log Bayes factor in favour of the true model is to be at least t. If the log Bayes
factor Φ is expected, the distance from this aim is ln(t/Φ). Distances from several aims can be
added, because each is zero where its aim is expected to be just reached.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ldbb_bayes.analysis.design.criteria import LogBayesFactor
from ldbb_bayes.results import Array

__all__ = ["Aim", "SlopesAim", "UncertaintyAim", "total_distance"]

# Weight that an aim which is reached already has when a circle is chosen. As the weight is not
# zero, such an aim still decides between two circles that are equally good for all aims that are
# not reached.
_REACHED = 1e-3
# Smaller expected log Bayes factors [nat] are raised to this value, to avoid the logarithm of zero.
_LEAST_EVIDENCE = 1e-9


class Aim(Protocol):
    """Aim of a campaign. Its distance is computed from covariances of the parameters."""

    @property
    def is_reached(self) -> bool:
        """Whether the aim is reached already."""

    def distance(self, covariance: Array) -> Array:
        """Return the distances from the aim, shape (...), averaged over the hyper-parameters.

        ``covariance``, shape (K, ..., p, p), are covariances of the p parameters, in units of their
        prior standard deviations, at K values of the hyper-parameters. The dimensions (...) are
        those of several possible circles, treated at once.
        """


@dataclass(frozen=True, eq=False)
class UncertaintyAim:
    """Aim that the standard uncertainty of a combination w·β of the parameters becomes small.

    β are the p parameters. Uncertainties are first computed for known hyper-parameters (scales of
    the noise and of other effects), and then multiplied by ``inflation``, because they are larger
    if the hyper-parameters are unknown.
    """

    #: weights w, shape (p,), by which the p parameters in units of their prior standard deviations
    #: are multiplied
    weights: Array
    target: float  #: standard uncertainty asked for
    #: factor by which uncertainties are multiplied: the present standard uncertainty with unknown
    #: hyper-parameters, divided by the root mean square of the present standard uncertainties with
    #: known hyper-parameters
    inflation: float
    is_reached: bool  #: whether the aim is reached already

    def sd(self, covariance: Array) -> Array:
        """Return the standard uncertainties of w·β, shape (K, ...).

        ``covariance``, shape (K, ..., p, p), are covariances of the p parameters, in units of their
        prior standard deviations, at K values of the hyper-parameters.
        """
        variance = covariance @ self.weights @ self.weights
        return np.asarray(self.inflation * np.sqrt(np.maximum(variance, 0.0)))

    def distance(self, covariance: Array) -> Array:
        """Return the distances ln(u/u*), shape (...), averaged over the hyper-parameters.

        u is the standard uncertainty of w·β, and u* is ``target``. ``covariance``, shape (K, ...,
        p, p), are covariances of the p parameters, in units of their prior standard deviations, at
        K values of the hyper-parameters.
        """
        return np.asarray(np.log(self.sd(covariance) / self.target).mean(axis=0))


@dataclass(frozen=True, eq=False)
class SlopesAim:
    """Aim that the evidence decides whether the compliances change with force."""

    #: indices of the slopes (changes of compliance with force) among the p parameters
    columns: Sequence[int]
    threshold: float  #: log Bayes factor that is enough for the decision [nat]
    is_reached: bool  #: whether the aim is reached already

    def distance(self, covariance: Array) -> Array:
        """Return the distances ln(t/Φ), shape (...), averaged over the hyper-parameters.

        t is ``threshold``, and Φ the expected log Bayes factor in favour of the true model.
        ``covariance``, shape (K, ..., p, p), are covariances of the p parameters, in units of their
        prior standard deviations, at K values of the hyper-parameters.
        """
        of_slopes = covariance[..., self.columns, :][..., self.columns]
        root = np.linalg.cholesky(np.linalg.inv(of_slopes))
        evidence = np.maximum(LogBayesFactor().value(root), _LEAST_EVIDENCE)
        return np.asarray(np.log(self.threshold / evidence).mean(axis=0))


def total_distance(aims: Sequence[Aim], covariance: Array) -> Array:
    """Return the sum of the distances from all aims, shape (...).

    Aims that are reached already, and distances below zero, have the weight 0.001. ``covariance``,
    shape (K, ..., p, p), are covariances of the p parameters, in units of their prior standard
    deviations, at K values of the hyper-parameters.
    """
    total = np.zeros(covariance.shape[1:-2])
    for aim in aims:
        distance = aim.distance(covariance)
        counts = 1.0
        if aim.is_reached:
            counts = _REACHED
        total = total + counts * np.where(distance > 0.0, distance, _REACHED * distance)
    return total
