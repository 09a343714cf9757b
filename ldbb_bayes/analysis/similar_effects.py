"""Prior correlation of effects that are similar in two campaigns with one machine or instrument.

Some joints deflect in a way that is not proportional to the force, or that changes along the
travel. These effects are described by nuisance coefficients (of effects that are modelled but not
of interest). Their prior standard deviations are proportional to the compliances. On one machine,
a coefficient divided by its prior standard deviation is therefore nearly the same in two campaigns,
even if a compliance has changed in between.

A bar has the same balls in both campaigns, but its zero is set anew, and its temperature is
another. If no certificate states its length, the errors of its length are therefore only in part
the same.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ldbb_bayes.campaign.placed_circles import placed_circles
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms import Term
from ldbb_bayes.results import Array

__all__ = ["correlate_priors", "machine_terms", "prior_difference", "similar_units"]


def machine_terms(bounds: Sequence[BoundModel]) -> frozenset[str]:
    """Return the class names of the terms whose coefficients are similar in two campaigns.

    The terms describe effects of the machine. Effects that belong to circles of a certain plane,
    radius, centre and direction are left out if the two campaigns have different circles.
    ``bounds`` are the models of the two campaigns.
    """
    first, second = (placed_circles(bound.campaign) for bound in bounds)
    names = []
    for name, kind in Term.kinds.items():
        if kind.machine and (first == second or not kind.of_circle):
            names.append(name)
    return frozenset(names)


def prior_difference(name: str) -> float:
    """Return the prior standard deviation of the difference of a coefficient between two campaigns.

    ``name`` is the name of the coefficient, which is divided by its prior standard deviation in
    each of the two campaigns.
    """
    return float(np.sqrt(2.0 * (1.0 - Term.owner(name).campaign_correlation)))


def similar_units(names: Sequence[str], prior_sd: Array, bounds: Sequence[BoundModel]) -> Array:
    """Return the units in which the coefficients are nearly the same in two campaigns.

    In the first campaign the unit of a coefficient is its prior standard deviation. In the second
    it is the prior standard deviation times `Term.ratio`. The arguments are the same as in
    `correlate_priors`. The result has the shape (2, c).
    """
    first, second = (bound.setting for bound in bounds)
    ratios = [Term.owner(name).ratio(name, first, second) for name in names]
    return np.stack([prior_sd[0], prior_sd[1] * ratios])


def correlate_priors(
    names: Sequence[str], prior_sd: Array, bounds: Sequence[BoundModel]
) -> Gaussian:
    """Return the factor by which independent priors are multiplied to become correlated.

    The result is a Gaussian of 2c variables: the c coefficients in the first campaign, then those
    in the second. Let s₁ and s₂ be the prior standard deviations of a coefficient in the two
    campaigns, and r its value in the second campaign if it is one in the first (`Term.ratio`). If
    r = 1, the prior covariance matrix becomes [[s₁², ρ s₁ s₂], [ρ s₁ s₂, s₂²]], where ρ is the
    correlation `Term.campaign_correlation`. If r differs from 1, one of the two campaigns must have
    a narrower prior than it has by itself: s₂ is multiplied by r if r < 1, and s₁ is divided by r
    if r > 1.

    Parameters
    ----------
    names
        Names of the c coefficients.
    prior_sd
        Prior standard deviations s of the c coefficients in both campaigns, shape (2, c).
    bounds
        Models of the two campaigns.
    """
    c = len(names)
    first, second = (bound.setting for bound in bounds)
    precision = np.zeros((2 * c, 2 * c))
    for j, name in enumerate(names):
        ratio = Term.owner(name).ratio(name, first, second)
        sd = prior_sd[:, j] * [min(1.0, 1.0 / ratio), min(1.0, ratio)]
        correlation = Term.owner(name).campaign_correlation
        covariance = np.outer(sd, sd) * [[1.0, correlation], [correlation, 1.0]]
        places = np.ix_([j, c + j], [j, c + j])
        precision[places] = np.linalg.inv(covariance) - np.diag(prior_sd[:, j] ** -2.0)
    return Gaussian(precision, np.zeros(2 * c))
