"""Conformity of quantities that are normal, and of stiffnesses whose compliance is normal."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr, ndtri

from ldbb_bayes.analysis.decision_rule import INTERVAL_LEVELS, Conformity, Distribution, decide
from ldbb_bayes.analysis.tolerances import Tolerance

__all__ = ["normal_conformity", "stiffness_conformity"]


def normal_conformity(
    unit: str, mean: float, sd: float, tolerance: Tolerance, *, confidence: float = 0.95
) -> Conformity:
    """Return the decision on the conformity of a quantity with a normal distribution.

    ``mean``, ``sd`` and the limits of ``tolerance`` are in ``unit``. ``confidence`` is the minimum
    probability at which a decision is made.
    """
    probability = _normal_probability(mean, sd, tolerance.ends)
    half_width = float(ndtri(INTERVAL_LEVELS[1])) * sd
    distribution = Distribution(mean, sd, mean - half_width, mean + half_width)
    return decide(unit, distribution, tolerance, probability, confidence, None)


def stiffness_conformity(
    unit: str,
    compliance_mean: float,
    compliance_sd: float,
    tolerance: Tolerance,
    *,
    confidence: float = 0.95,
) -> Conformity:
    """Return the decision on the conformity of a stiffness whose compliance has a normal posterior.

    The probability of conformance is the probability, under the normal distribution of the
    compliance C, that C lies between the inverses of the stiffness limits. A negative C is
    physically impossible, and counts as infinite stiffness. For a compliance with mean m and
    standard deviation s, the result states 1/m as value and mean of the stiffness, and s/m² as its
    standard deviation. If the 95 % interval of the compliance contains zero or lies below it, these
    approximations mean nothing, and value, mean, standard deviation and guard band are None. So is
    the upper end of the stiffness, and if the whole interval lies below zero, the lower end too.
    The decision does not depend on them.

    ``unit`` is the unit of the stiffness and of the limits of ``tolerance``. ``compliance_mean``
    and ``compliance_sd`` are the mean and the standard deviation of the compliance, in the inverse
    of this unit. ``confidence`` is the minimum probability at which a decision is made.
    """
    lowest_stiffness, highest_stiffness = tolerance.ends
    lowest_compliance = -np.inf
    if highest_stiffness < np.inf:
        lowest_compliance = 1.0 / highest_stiffness
    highest_compliance = np.inf
    if lowest_stiffness > 0.0:
        highest_compliance = 1.0 / lowest_stiffness
    probability = _normal_probability(
        compliance_mean, compliance_sd, (lowest_compliance, highest_compliance)
    )
    half_width = float(ndtri(INTERVAL_LEVELS[1])) * compliance_sd
    ci_low = None
    if compliance_mean + half_width > 0.0:
        ci_low = 1.0 / (compliance_mean + half_width)
    distribution = Distribution(mean=None, sd=None, low=ci_low, high=None)
    if compliance_mean > half_width:
        distribution = Distribution(
            mean=1.0 / compliance_mean,
            sd=compliance_sd / compliance_mean**2,
            low=ci_low,
            high=1.0 / (compliance_mean - half_width),
        )
    return decide(unit, distribution, tolerance, probability, confidence, None)


def _normal_probability(mean: float, sd: float, limits: tuple[float, float]) -> float:
    """Return the probability that a normally distributed quantity lies between ``limits``.

    ``mean`` and ``sd`` are the mean and the standard deviation of the quantity, in the unit of the
    limits.
    """
    low, high = limits
    return float(ndtr((high - mean) / sd) - ndtr((low - mean) / sd))
