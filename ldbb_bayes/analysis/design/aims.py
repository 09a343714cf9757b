"""Aims of a campaign under way, and the distances from these aims after one more circle.

There are two kinds of aims. One is that a quantity has at most the standard uncertainty u*. If the
uncertainty u is expected, the distance from this aim is ln(u/u*). The other is a decision between
two models: the log Bayes factor in favour of the true model is to be at least t. If the log Bayes
factor Φ is expected, the distance from this aim is ln(t/Φ). Each distance is a pure number: zero if
the campaign is expected to just reach the aim, and positive if it is expected to miss the aim.
Distances from several aims can therefore be added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ldbb_bayes.analysis.design.criteria import LogBayesFactor
from ldbb_bayes.results import Array

__all__ = ["Aim", "SlopesAim", "UncertaintyAim", "total_distance"]

# When a circle is chosen, the distance from an aim that is reached already is multiplied by this
# number. As the number is not zero, this aim still decides between two circles that are equally
# good for all aims that are not yet reached.
_REACHED = 1e-3
# An expected log Bayes factor [nat] is raised to at least this value, to avoid the logarithm of
# zero.
_LEAST_EVIDENCE = 1e-9


class Aim(Protocol):
    """Aim of a campaign under way.

    The distance of the campaign from the aim is computed from covariances of the parameters. The
    distance is zero if the campaign is expected to just reach the aim, and positive if it is
    expected to miss the aim.
    """

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

    β are the p parameters and w their weights. The uncertainty is first computed for known
    hyper-parameters (scales of the noise and of other effects), and then multiplied by
    ``inflation``, because it is larger for unknown hyper-parameters.
    """

    #: weights w of the p parameters in the combination, shape (p,); the parameters are in units of
    #: their prior standard deviations
    weights: Array
    target: float  #: largest standard uncertainty of w·β at which the aim is reached
    #: factor by which the standard uncertainty of w·β for known hyper-parameters is multiplied,
    #: because the hyper-parameters are not known. It is the present standard uncertainty, divided
    #: by the root mean square of the present standard uncertainties for several known values of the
    #: hyper-parameters.
    inflation: float
    is_reached: bool  #: whether the aim is reached already

    def sd(self, covariance: Array) -> Array:
        """Return the standard uncertainty of the combination w·β of the parameters, shape (K, ...).

        β are the p parameters and w their weights ``weights``. ``covariance``, shape (K, ..., p,
        p), are covariances of the p parameters, in units of their prior standard deviations, at K
        values of the hyper-parameters. The dimensions (...) are those of several possible circles,
        treated at once.
        """
        variance = covariance @ self.weights @ self.weights
        return np.asarray(self.inflation * np.sqrt(np.maximum(variance, 0.0)))

    def distance(self, covariance: Array) -> Array:
        """Return the distances ln(u/u*) from the aim, shape (...), averaged over hyper-parameters.

        u is the standard uncertainty that is expected for the combination of the parameters, and u*
        is ``target``. ``covariance``, shape (K, ..., p, p), are covariances of the p parameters, in
        units of their prior standard deviations, at K values of the hyper-parameters. The
        dimensions (...) are those of several possible circles, treated at once.
        """
        return np.asarray(np.log(self.sd(covariance) / self.target).mean(axis=0))


@dataclass(frozen=True, eq=False)
class SlopesAim:
    """Aim that the evidence decides whether the compliances change with force."""

    #: indices of the slopes (changes of compliance with force) in the list of parameters
    columns: Sequence[int]
    threshold: float  #: least absolute log Bayes factor with which the evidence decides [nat]
    is_reached: bool  #: whether the aim is reached already

    def distance(self, covariance: Array) -> Array:
        """Return the distances ln(t/Φ) from the aim, shape (...), averaged over hyper-parameters.

        t is ``threshold``. Φ is the expected log Bayes factor in favour of the true one of two
        models: compliances that change with force, or constant compliances. ``covariance``, shape
        (K, ..., p, p), are covariances of the p parameters, in units of their prior standard
        deviations, at K values of the hyper-parameters. The dimensions (...) are those of several
        possible circles, treated at once.
        """
        of_slopes = covariance[..., self.columns, :][..., self.columns]
        root = np.linalg.cholesky(np.linalg.inv(of_slopes))
        evidence = np.maximum(LogBayesFactor().value(root), _LEAST_EVIDENCE)
        return np.asarray(np.log(self.threshold / evidence).mean(axis=0))


def total_distance(aims: Sequence[Aim], covariance: Array) -> Array:
    """Return the weighted sum of the distances from all aims, shape (...).

    The distance from an aim that is reached already is multiplied by 0.001, and so is a distance
    below zero. ``covariance``, shape (K, ..., p, p), are covariances of the p parameters, in units
    of their prior standard deviations, at K values of the hyper-parameters. The dimensions (...)
    are those of several possible circles, treated at once.
    """
    total = np.zeros(covariance.shape[1:-2])
    for aim in aims:
        distance = aim.distance(covariance)
        counts = 1.0
        if aim.is_reached:
            counts = _REACHED
        total = total + counts * np.where(distance > 0.0, distance, _REACHED * distance)
    return total
