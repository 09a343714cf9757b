"""Prior of the parameters of interest of one campaign: its density, its constant and its draws.

The prior is β ~ N(mean, diag sd²), restricted to the region A β ≥ 0 in which compliances are not
negative. β are the p parameters: compliances, their changes with force, and geometric errors.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import connected_components

from ldbb_bayes.errors import require
from ldbb_bayes.model.orthant import Orthant
from ldbb_bayes.model.truncation import Truncation
from ldbb_bayes.results import Array

__all__ = ["ParameterPrior"]

# Error tolerance [nat] for the log of the normalising constant of the truncated prior. The constant
# is a product with one factor for each group of compliances that depend on common parameters; the
# tolerance applies to the log of each factor.
_TOLERANCE = 1e-4


class _Normalisation(NamedTuple):
    """Probability that no compliance is negative, under the Gaussian prior before truncation."""

    log_value: float  #: log of this probability, the normalising constant of the truncated prior
    error: float  #: numerical error of the log [nat]


@dataclass(frozen=True, eq=False)
class ParameterPrior:
    """Prior β ~ N(mean, diag sd²) of the p parameters, restricted to a region.

    Parameters
    ----------
    mean, sd
        Means and standard deviations before truncation, shape (p,), in mm, N and rad.
    truncation
        Region to which the parameters are restricted.
    flat
        Whether the density is constant; ``sd`` is then infinite.
    """

    mean: Array
    sd: Array
    truncation: Truncation
    flat: bool

    def log_density(self, beta: Array) -> Array:
        """Return the log prior density of the p parameters of interest, shape (...).

        ``beta``, shape (..., p), holds values of the parameters in mm, N and rad. If the prior is
        flat, the log density is 0 everywhere. If the prior is truncated to exclude negative
        compliances, the log density is −inf where a compliance is negative, and the density is
        normalised over the remaining region.
        """
        if self.flat:
            return np.zeros(beta.shape[:-1])
        white = (beta - self.mean) / self.sd
        density = -0.5 * (white**2).sum(axis=-1) - np.log(self.sd * np.sqrt(2 * np.pi)).sum()
        return np.where(
            self.truncation.holds(beta), density - self.normalisation.log_value, -np.inf
        )

    @cached_property
    def normalisation(self) -> _Normalisation:
        """Log normalising constant of the truncated prior, and its numerical error [nat].

        The constant is the probability, under the Gaussian prior before truncation, that no
        compliance is negative. Both numbers are 0 if the prior is not truncated. Groups of
        compliances that have no parameter in common are independent, so that their log
        probabilities are added.
        """
        if not self.truncation.active:
            return _Normalisation(0.0, 0.0)
        mean = self.truncation.rows @ self.mean
        root = self.truncation.rows * self.sd
        _, block = connected_components(np.abs(root @ root.T) > 0.0, directed=False)
        values = []
        for k in range(block.max() + 1):
            orthant = Orthant(mean[None, block == k], root[None, block == k])
            values.append(orthant.log_probability(_TOLERANCE))
        value, error = np.sum(values, axis=(0, 2))
        return _Normalisation(float(value), float(error))

    def draw(self, size: int, rng: np.random.Generator) -> Array:
        """Return random draws of the p parameters of interest, shape (size, p).

        The parameters are in mm, N and rad. If the prior excludes negative compliances, no draw
        contains a negative compliance. Raise an `InputError` if the prior is flat.
        """
        require(
            not self.flat,
            "parameters must be given when the prior is flat, got none. Pass true values.",
        )
        p = len(self.mean)
        if not self.truncation.active:
            return self.mean + rng.standard_normal((size, p)) * self.sd
        draws = np.zeros((0, p))
        root = np.broadcast_to(np.diag(self.sd), (size, p, p))
        orthant = self.truncation.orthants(np.broadcast_to(self.mean, (size, p)), root)
        while len(draws) < size:
            white, exact = orthant.draw_standard(rng)
            beta = self.mean + white * self.sd
            draws = np.concatenate([draws, beta[exact & self.truncation.holds(beta)]])
        return draws[:size]
