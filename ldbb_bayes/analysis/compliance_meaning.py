"""Weighted sum of joint compliances that a fitted compliance stands for (its meaning).

Readings do not determine the compliance of every joint. They determine only some weighted sums of
the compliances of joints. A model has one compliance for each of these sums.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.machine.linear import kept_compliances
from ldbb_bayes.machine.parameters import ComplianceName
from ldbb_bayes.model.prior import Prior

__all__ = ["Meaning", "same_meaning", "stands_for"]

# A fitted compliance stands for a weighted sum of the compliances of single joints. This sum is
# called its meaning. The type is a dictionary: the keys are the labels of the joints' compliances,
# and the values are their weights.
Meaning = Mapping[str, float]
# A fitted compliance stands for a weighted sum of the compliances of joints. The weights of this
# sum are rounded to this number of significant digits.
_DIGITS = 7
# Two weighted sums of joints' compliances are treated as the same if the standard deviation of
# their difference is at most this fraction of the fitted compliance's default prior sd. The limit
# is a quarter of the prior standard deviation that `find_trend` assumes, by default, for a sudden
# change of a compliance.
_NEGLIGIBLE = 0.05


def stands_for(campaign: Campaign) -> dict[str, dict[str, float]]:
    """Return, for each fitted compliance, the weighted sum of joint compliances it stands for.

    The readings of circles determine only some weighted sums of the compliances of joints.

    Parameters
    ----------
    campaign : campaign or plan whose circles determine the sums.

    Returns
    -------
    Dictionary of weighted sums; the keys are the labels of the fitted compliances, such as C_XXX.
    Each sum is itself a dictionary of weights; its keys are the labels of the joints' compliances.
    The unit of a weight is a power of mm, so that the product of the weight and the joint's
    compliance has the unit of the fitted compliance.
    """
    circles = dict.fromkeys(test.circle for test in campaign.scope)
    compliances = kept_compliances(campaign.machine(), *circles)
    sums: dict[str, dict[str, float]] = {}
    for name, members, member_weights, absorbed in zip(
        compliances.names,
        compliances.sets,
        compliances.weights,
        compliances.absorbed,
        strict=True,
    ):
        # A fitted compliance is the estimate of a weighted sum of joint compliances. The sum
        # contains joint compliances of two kinds, called members and absorbed compliances. The
        # effect of a member on the readings is proportional to the effect of the fitted compliance.
        # The effect of an absorbed compliance is a linear combination of the effects of several
        # fitted compliances.
        weights = dict(zip(members, member_weights, strict=True))
        weights |= {other.label: weight for other, weight in absorbed.items()}
        sums[name.label] = {
            label: float(f"{weight:.{_DIGITS}g}") for label, weight in weights.items()
        }
    return sums


def same_meaning(name: str, one: Meaning, other: Meaning) -> bool:
    """Return whether a compliance stands for the same sum of joint compliances in two campaigns.

    The compliances of joints are taken as independent, each with its default prior sd. Two weighted
    sums are treated as the same if the standard deviation of their difference is at most 5 % of the
    fitted compliance's default prior sd. If the work ball is mounted a millimetre higher, for
    example, a sum changes by less than this limit.

    Parameters
    ----------
    name : label of the fitted compliance, such as C_XXX, which stands for the first sum in one
        campaign and for the second sum in another.
    one, other : the two sums. In each sum, the keys are the labels of the joints' compliances, and
        the values are their weights.
    """
    labels = sorted(set(one) | set(other))
    names = [ComplianceName(*label[2:]) for label in (name, *labels)]
    prior_sd, *joint_sds = Prior.first().compliance_sd(names)
    differences = np.array([one.get(label, 0.0) - other.get(label, 0.0) for label in labels])
    return bool(np.linalg.norm(differences * joint_sds) <= _NEGLIGIBLE * prior_sd)
