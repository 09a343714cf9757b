"""The Gaussian p(β | y, φ) of the parameters at given hyper-parameters, and its truncation."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.orthant import Orthant
from ldbb_bayes.model.truncation import Truncation
from ldbb_bayes.results import Array

__all__ = ["ParameterConditional"]


class ParameterConditional(Gaussian):
    """Gaussian p(β | y, φ) for w values of φ, without truncation.

    ``physical`` is the region A β ≥ 0 of physical compliances, whether or not the model imposes it.
    """

    physical: Truncation

    def select(self, index: NDArray[np.intp]) -> ParameterConditional:
        """Return the Gaussians of the φ of these numbers, which may repeat."""
        selected = ParameterConditional.factored(
            self.mean[index], self.root[index], self.scale[index]
        )
        selected.physical = self.physical
        return selected

    @cached_property
    def orthant(self) -> Orthant:
        """The problem of P(A β ≥ 0 | y, φ)."""
        rows = self.physical.rows
        return Orthant(self.mean @ rows.T, self.spread(rows))

    def draw_truncated(
        self,
        rng: np.random.Generator,
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Draw β given A β ≥ 0 once for every φ, shape (w, p), and return where a draw is exact.

        A draw is exact where the rejection sampler did not give up and rounding did not leave β
        outside.
        """
        z, accepted = self.orthant.draw_standard(rng)
        beta = self.from_standard(z)
        return beta, accepted & self.physical.holds(beta)
