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

__all__ = ["Confounding"]

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

    def unseen_share(self, least: float = 1.0) -> Array:
        """Share of the variance along directions in which the readings add less than ``least`` times the prior, shape (p,).

        Directions of all coefficients, parameters and nuisances, in units of the prior sd: right singular vectors of the
        whitened design, along which the readings add the squared singular value to a prior precision of one.
        """
        rows = self.information.rows()
        missing = max(rows.shape[1] - len(rows), 0)
        _, singular, right = np.linalg.svd(np.concatenate([rows, np.zeros((missing, rows.shape[1]))]), full_matrices=False)
        gain = singular[:, None] ** 2
        parts = right[:, self.information.own] ** 2 / (1.0 + gain)
        return np.asarray(np.where(gain < least, parts, 0.0).sum(axis=0) / parts.sum(axis=0))
