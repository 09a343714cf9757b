"""Who holds a parameter's variance: every nuisance term alone, in fair shares, and by its scale.

All at given hyper-parameters and with the truncation set aside, from a linear Gaussian model (`Information`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.information import NOISE, Information

__all__ = ["Confounding", "Spectrum"]

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Confounding:
    """Posterior variances of the parameters of interest under everything one could know.

    Attributes
    ----------
    information : Information
    """

    information: Information

    @property
    def terms(self) -> tuple[str, ...]:
        """The nuisance terms."""
        return self.information.terms

    @cached_property
    def variance(self) -> Array:
        """Var(β | y) in units of the prior variance, shape (p,)."""
        return self.information.variances()

    @cached_property
    def fraction(self) -> dict[str, Array]:
        """Confounding fraction 1 − Var(β | y, g) / Var(β | y) of every term g, each shape (p,)."""
        return {term: self.lost_by_knowing([term]) for term in self.terms}

    def lost_by_knowing(self, terms: Sequence[str]) -> Array:
        """Share of the variance that vanishes when these terms are known, shape (p,)."""
        return np.clip(1.0 - self.information.variances(terms) / self.variance, 0.0, 1.0)

    @cached_property
    def shares(self) -> dict[str, Array]:
        """Shapley shares of the terms and of the reading noise with the parameters' own prior; they sum to one.

        A term's share is what knowing it takes from the variance, averaged over all orders in which terms become known
        (Shapley 1953; Owen 2014). What stays when all are known goes to ``ReadingNoise``.
        """
        terms, count = self.terms, len(self.terms)
        known = [frozenset(term for i, term in enumerate(terms) if number >> i & 1) for number in range(2**count)]
        worth = [1.0 - self.information.variances(subset) / self.variance for subset in known]
        found = {}
        for i, term in enumerate(terms):
            total = np.zeros(len(self.variance))
            for number, subset in enumerate(known):
                if number >> i & 1:
                    continue
                weight = factorial(len(subset)) * factorial(count - len(subset) - 1) / factorial(count)
                total = total + weight * (worth[number | 1 << i] - worth[number])
            found[term] = total
        found[NOISE] = 1.0 - worth[-1]
        return found

    @cached_property
    def sensitivity(self) -> dict[str, Array]:
        """d ln sd(β) / d ln(prior scale of the term), each shape (p,); parameters' own priors and reading noise too."""
        return self.information.contributions()


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Directions of the coefficients by how much the readings add to the prior: 1 + λ is the gain in precision along each.

    Attributes
    ----------
    gain : ndarray, shape (m,)
        λ ≥ 0: below one the prior outweighs the readings.
    vectors : ndarray, shape (m, m)
        Orthonormal columns in units of the prior sd.
    """

    gain: Array
    vectors: Array

    @classmethod
    def of(cls, information: Information) -> Spectrum:
        """Of all coefficients, parameters and nuisances, with proper priors."""
        rows = information.rows()
        missing = max(rows.shape[1] - len(rows), 0)
        _, singular, right = np.linalg.svd(np.concatenate([rows, np.zeros((missing, rows.shape[1]))]), full_matrices=False)
        return cls(singular**2, right.T)

    def weak_share(self) -> Array:
        """Share of every coefficient's variance along directions where the prior outweighs the readings, shape (m,)."""
        parts = self.vectors**2 / (1.0 + self.gain)
        return np.asarray(parts[:, self.gain < 1.0].sum(axis=1) / parts.sum(axis=1))
