"""Prior correlation of the machine's effects between two campaigns that were run on one machine.

Some joints deflect in a way that is not proportional to the force, or that changes along the
travel. These effects are described by nuisance coefficients (of effects that are modelled but not
of interest). Their prior standard deviations are proportional to the compliances. On one machine,
a coefficient divided by its prior standard deviation is therefore nearly the same in two campaigns,
even if a compliance has changed in between.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms import Term
from ldbb_bayes.results import Array

__all__ = ["STANDARDISED_DIFFERENCE", "correlate_priors", "machine_terms"]

# Prior correlation of a coefficient of the machine between two campaigns. If the coefficients were
# taken as equal, the interval of a change of C_CCY would not contain the true change in 7 of 64
# simulated machines whose C_XXX grew by 15 %.
_CORRELATION = 0.99

#: prior standard deviation of the difference of a coefficient of the machine between two campaigns,
#: if the coefficient is divided by its prior standard deviation in each campaign
STANDARDISED_DIFFERENCE = float(np.sqrt(2.0 * (1.0 - _CORRELATION)))


def machine_terms(bounds: Sequence[BoundModel]) -> frozenset[str]:
    """Return the class names of the terms whose coefficients are similar in two campaigns.

    The terms describe effects of the machine. Effects that belong to circles of a certain plane,
    radius and centre are left out if the two campaigns have different circles. ``bounds`` are the
    models of the two campaigns.
    """
    circles = []
    for bound in bounds:
        tests = bound.campaign.tests
        circles.append({(t.plane, t.radius_mm, t.centre_x_mm, t.centre_y_mm) for t in tests})
    names = []
    for name, kind in Term.kinds.items():
        if kind.machine and (circles[0] == circles[1] or not kind.of_circle):
            names.append(name)
    return frozenset(names)


def correlate_priors(
    names: Sequence[str], prior_sd: Array, bounds: Sequence[BoundModel]
) -> Gaussian:
    """Return the factor by which independent priors are multiplied to become correlated.

    The result is a Gaussian of 2c variables: the c coefficients in the first campaign, then those
    in the second. Let s₁ and s₂ be the prior standard deviations of a coefficient in the two
    campaigns, and r its value in the second campaign if it is one in the first (`Term.ratio`). If
    r = 1, the prior covariance matrix becomes [[s₁², ρ s₁ s₂], [ρ s₁ s₂, s₂²]], where ρ is the
    correlation. If r differs from 1, one of the two campaigns must have a narrower prior than it
    has by itself: s₂ is multiplied by r if r < 1, and s₁ is divided by r if r > 1.

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
        covariance = np.outer(sd, sd) * [[1.0, _CORRELATION], [_CORRELATION, 1.0]]
        places = np.ix_([j, c + j], [j, c + j])
        precision[places] = np.linalg.inv(covariance) - np.diag(prior_sd[:, j] ** -2.0)
    return Gaussian(precision, np.zeros(2 * c))
