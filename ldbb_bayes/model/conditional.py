"""Gaussian density of the parameters at given hyper-parameters, and its truncation.

The density is p(β | y, φ). β are compliances, their changes with force, and geometric errors; y are
the readings; φ are the hyper-parameters, such as the standard deviation of the noise. Truncation
restricts β to the region in which no compliance is negative.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.orthant import Orthant
from ldbb_bayes.model.truncation import Truncation
from ldbb_bayes.results import Array

__all__ = ["GivenHyperParameters", "ParameterConditional"]


class ParameterConditional(Gaussian):
    """Gaussian density p(β | y, φ) of the parameters given the readings, for w values of φ.

    β are the p parameters, y the readings and φ the hyper-parameters. ``physical`` is the region A
    β ≥ 0 in which compliances are not negative, where A has the shape (rows, p). The Gaussian
    density itself is not truncated to this region.
    """

    physical: Truncation

    def select(self, index: NDArray[np.intp]) -> ParameterConditional:
        """Return some of the w Gaussian densities of the parameters, selected by their indices.

        Each of the w Gaussian densities belongs to one value of the hyper-parameters φ. ``index``
        holds the indices, from 0 to w − 1; an index may occur more than once.
        """
        selected = ParameterConditional.factored(
            self.mean[index], self.root[index], self.scale[index]
        )
        selected.physical = self.physical
        return selected

    @cached_property
    def orthant(self) -> Orthant:
        """Object that computes the probability that no compliance is negative, for w values of φ.

        The object can also draw standard normal vectors under the condition that no compliance is
        negative. The method ``from_standard`` converts such vectors to parameters.
        """
        rows = self.physical.rows
        return Orthant(self.mean @ rows.T, self.spread(rows))

    def draw_truncated(
        self,
        rng: np.random.Generator,
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return random parameters without negative compliances, and whether each draw is valid.

        One draw is made by rejection sampling from each of the w Gaussian densities, truncated to
        parameters without negative compliances. The first array, shape (w, p), holds the draws of
        the p parameters. The second array, shape (w,), is true for valid draws: the sampler
        accepted the draw, and no compliance is negative. A draw that is not valid does not follow
        the truncated density and may have negative compliances.
        """
        z, accepted = self.orthant.draw_standard(rng)
        beta = self.from_standard(z)
        return beta, accepted & self.physical.holds(beta)


class GivenHyperParameters(NamedTuple):
    """Evidence of the readings and density of the parameters, for w values of the hyper-parameters.

    Negative compliances are not excluded.
    """

    log_evidence: Array  #: ln p(y | φ) of the readings y, shape (w,)
    parameters: ParameterConditional  #: p(β | y, φ) of the parameters β
