"""Values of the hyper-parameters over which an analysis of a campaign or of a plan is averaged."""

from __future__ import annotations

import numpy as np

from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = ["hyper_parameter_nodes"]


def hyper_parameter_nodes(bound: BoundModel) -> tuple[Array, Array]:
    """Return w weighted values of the hyper-parameters φ that represent p(φ | y).

    The first result holds the weights, shape (w,). The second result holds the values of the h
    hyper-parameters, shape (w, h). They are quadrature nodes for the readings y and a model in
    which compliances may be negative. Hyper-parameters that are lengths are in mm; the others have
    no unit. For a plan, the only value is the prior median.

    Parameters
    ----------
    bound
        Model applied to a campaign or plan.
    """
    if bound.campaign.is_plan:
        median = np.full((1, len(bound.hyper_prior.names)), 0.5)
        return np.ones(1), bound.hyper_prior.quantile(median)
    integral = HyperPosterior(bound, truncated=False).coarse_integral
    return integral.weight, bound.hyper_prior.phi(integral.free)
