"""The Gaussian p(β | y, φ) of the parameters at given hyper-parameters, and its truncation.

β are compliances, their slopes and geometric errors; y are the readings; φ are the scales of the
noise and of other effects. Truncation restricts β to compliances that are not negative.
"""

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
    """Gaussian p(β | y, φ) of the p parameters β for w values of φ, without truncation.

    ``physical`` is the region A β ≥ 0 where compliances are not negative, with A of shape
    (rows, p). It is set whether or not the model imposes it.
    """

    physical: Truncation

    def select(self, index: NDArray[np.intp]) -> ParameterConditional:
        """Return the Gaussians of the values of φ with these indices, which may repeat."""
        selected = ParameterConditional.factored(
            self.mean[index], self.root[index], self.scale[index]
        )
        selected.physical = self.physical
        return selected

    @cached_property
    def orthant(self) -> Orthant:
        """Problem from which P(A β ≥ 0 | y, φ) is computed."""
        rows = self.physical.rows
        return Orthant(self.mean @ rows.T, self.spread(rows))

    def draw_truncated(
        self,
        rng: np.random.Generator,
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return a random draw of β given A β ≥ 0 for every φ, and whether it is exact.

        A draw is exact if the rejection sampler accepted a proposal and rounding did not move β
        outside the region. Shapes are (w, p) and (w,).
        """
        z, accepted = self.orthant.draw_standard(rng)
        beta = self.from_standard(z)
        return beta, accepted & self.physical.holds(beta)
