"""Split from its neighbours; see there."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.machine.chain import ComplianceName, kept_compliances
from ldbb_bayes.model.prior import Prior

__all__ = ["Meaning", "same_meaning", "stands_for"]


Meaning = Mapping[str, float]


_DIGITS = 7


# Of the default prior's sd: a quarter of the changes that are looked for.
_NEGLIGIBLE = 0.05


def stands_for(campaign: Campaign) -> dict[str, dict[str, float]]:
    """Of every kept compliance of a campaign (or plan) the joints' compliances it is the sum of,
    with their weights."""
    kept = kept_compliances(
        campaign.machine(), *dict.fromkeys(test.circle for test in campaign.scope)
    )
    sums = {}
    for name, members, weights, absorbed in zip(
        kept.names, kept.sets, kept.weights, kept.absorbed, strict=True
    ):
        parts = dict(zip(members, weights, strict=True)) | {
            other.label: weight for other, weight in absorbed.items()
        }
        sums[name.label] = {
            other: float(f"{weight:.{_DIGITS}g}") for other, weight in parts.items()
        }
    return sums


def same_meaning(name: str, one: Meaning, other: Meaning) -> bool:
    """Whether two sums of compliances differ by less than 5 % of the default prior sd of the kept
    compliance ``name``, the joints' being as large as their priors: a work ball that stands a
    millimetre higher makes no other machine."""
    labels = sorted(set(one) | set(other))
    size, *sizes = Prior.first().compliance_sd(
        [ComplianceName(*label[2:]) for label in (name, *labels)]
    )
    apart = [one.get(label, 0.0) - other.get(label, 0.0) for label in labels]
    return bool(np.linalg.norm(np.array(apart) * sizes) <= _NEGLIGIBLE * size)
