"""Aims of a campaign under way, and how far from them it would be after one more circle.

The distance from an aim is a logarithm: ln (u / u*) of a quantity whose standard uncertainty u is
to become u*, and ln (t / Φ) of a decision for which the expected log Bayes factor Φ in favour of
the truth is to become t. It is zero where the aim is expected to be reached, so that distances from
several aims can be added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ldbb_bayes.analysis.design.criteria import LogBayesFactor
from ldbb_bayes.results import Array

__all__ = ["Aim", "SlopesAim", "UncertaintyAim", "total_distance"]

# Weight of an aim that is reached already, in the choice of a circle. It is not zero, so that of
# two circles that are equally good for the other aims the one that is better for this one is
# chosen.
_REACHED = 1e-3
# The expected log Bayes factor counts as at least this [nat], to avoid the logarithm of zero.
_LEAST_EVIDENCE = 1e-9


class Aim(Protocol):
    """One aim, judged by covariances of the p parameters in units of their prior sds."""

    @property
    def is_reached(self) -> bool:
        """Whether the aim is reached already."""

    def distance(self, covariance: Array) -> Array:
        """Return the distance for covariances, shape (K, ..., p, p), as the mean over K, (...)."""


@dataclass(frozen=True, eq=False)
class UncertaintyAim:
    """Aim that the standard uncertainty of a combination w·β of the parameters becomes small.

    Covariances are those at given hyper-parameters (scales of the noise and of other effects).
    Uncertainties with unknown hyper-parameters are larger.
    """

    weights: Array  #: w, per prior standard deviation of each of the p parameters, shape (p,)
    target: float  #: standard uncertainty asked for
    #: present standard uncertainty, with unknown hyper-parameters, divided by the root mean square
    #: of those at given ones; uncertainties from covariances are multiplied by it
    inflation: float
    is_reached: bool  #: whether the aim is reached already

    def sd(self, covariance: Array) -> Array:
        """Return expected uncertainties, shape (K, ...), for covariances, shape (K, ..., p, p)."""
        variance = covariance @ self.weights @ self.weights
        return np.asarray(self.inflation * np.sqrt(np.maximum(variance, 0.0)))

    def distance(self, covariance: Array) -> Array:
        """Return ln (u / u*), shape (...), for covariances, shape (K, ..., p, p)."""
        return np.asarray(np.log(self.sd(covariance) / self.target).mean(axis=0))


@dataclass(frozen=True, eq=False)
class SlopesAim:
    """Aim that the evidence decides whether the compliances change with force."""

    columns: Sequence[int]  #: indices of the slopes among the p parameters
    threshold: float  #: log Bayes factor asked for [nat]
    is_reached: bool  #: whether the aim is reached already

    def distance(self, covariance: Array) -> Array:
        """Return ln (t / Φ), shape (...), for covariances, shape (K, ..., p, p)."""
        of_slopes = covariance[..., self.columns, :][..., self.columns]
        root = np.linalg.cholesky(np.linalg.inv(of_slopes))
        evidence = np.maximum(LogBayesFactor().value(root), _LEAST_EVIDENCE)
        return np.asarray(np.log(self.threshold / evidence).mean(axis=0))


def total_distance(aims: Sequence[Aim], covariance: Array) -> Array:
    """Return the sum of the distances from all aims, shape (...).

    An aim that is reached, or is expected to be, hardly counts. ``covariance``, shape (K, ..., p,
    p), are covariances of the parameters at K values of the hyper-parameters.
    """
    total = np.zeros(covariance.shape[1:-2])
    for aim in aims:
        distance = aim.distance(covariance)
        counts = 1.0
        if aim.is_reached:
            counts = _REACHED
        total = total + counts * np.where(distance > 0.0, distance, _REACHED * distance)
    return total
