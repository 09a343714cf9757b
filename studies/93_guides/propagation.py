"""Uncertainty of the output quantities of a measurement model: by the GUM, and by random draws.

y = f(x) is the measurement model. `propagate_linearly` is the law of propagation of uncertainty
(JCGM 100, 5.1.2 and 5.2.2): the Gaussian density of x is mapped by the Jacobian of f, by the kernel
that the package uses for its own models. `propagate_distributions` is the Monte Carlo method of
JCGM 101.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.results import Array

__all__ = ["Distribution", "Propagated", "propagate_distributions", "propagate_linearly"]

# Step of the central differences of the Jacobian, in standard uncertainties of an input quantity.
_STEP = 1e-3

Model = Callable[[Array], Array]


@dataclass(frozen=True)
class Propagated:
    """Estimates, standard uncertainties and correlations of m output quantities, by the GUM."""

    estimate: Array  #: estimates, shape (m,)
    u: Array  #: standard uncertainties, shape (m,)
    correlation: Array  #: correlation matrix, shape (m, m)
    contributions: Array  #: change of each output per standard uncertainty of each input, (m, n)

    def interval(self, k: int, prob: float) -> tuple[float, float]:
        """Return the coverage interval of output k with a normal distribution."""
        half_width = float(ndtri(0.5 + 0.5 * prob)) * self.u[k]
        return self.estimate[k] - half_width, self.estimate[k] + half_width


def propagate_linearly(model: Model, estimate: Array, covariance: Array) -> Propagated:
    """Return the output quantities of a model by the law of propagation of uncertainty.

    ``model`` takes n input quantities in the last dimension and returns m output quantities there.
    ``estimate``, shape (n,), and ``covariance``, shape (n, n) or (n,) for independent inputs, are
    those of the inputs.
    """
    inputs = Gaussian.of(estimate, covariance)
    jacobian = _jacobian(model, estimate, inputs.sd)
    spread = inputs.spread(jacobian)
    output_covariance = spread @ spread.T
    u = np.sqrt(np.diag(output_covariance))
    return Propagated(
        estimate=model(estimate),
        u=u,
        correlation=output_covariance / np.outer(u, u),
        contributions=jacobian * inputs.sd,
    )


def _jacobian(model: Model, estimate: Array, sd: Array) -> Array:
    """Return the derivatives of the outputs by the inputs, shape (m, n), by central differences."""
    columns = []
    for i, step in enumerate(_STEP * sd):
        shift = np.zeros(len(estimate))
        shift[i] = step
        change = model(estimate + shift) - model(estimate - shift)
        columns.append(change / (2.0 * step))
    return np.stack(columns, axis=-1)


@dataclass(frozen=True)
class Distribution:
    """One output quantity by random draws: mean, standard uncertainty and sorted draws."""

    mean: float
    u: float
    values: Array  #: draws in ascending order, shape (draws,)

    def symmetric(self, prob: float) -> tuple[float, float]:
        """Return the probabilistically symmetric coverage interval."""
        low, high = np.quantile(self.values, [0.5 - 0.5 * prob, 0.5 + 0.5 * prob])
        return float(low), float(high)


def propagate_distributions(values: Array) -> Distribution:
    """Return mean, standard uncertainty and sorted draws of an output quantity, shape (draws,)."""
    return Distribution(float(values.mean()), float(values.std(ddof=1)), np.sort(values))
