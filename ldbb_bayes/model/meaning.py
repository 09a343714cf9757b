"""What a kept compliance stands for: C_XXX = Σ weight · compliance of a joint, and whether two campaigns mean the same by it.

Another centre of the circles or another place of the joints' frames can make it the sum of other compliances, or of the same with
other weights; another radius does not.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.machine.kept import kept_compliances
from ldbb_bayes.machine.names import ComplianceName
from ldbb_bayes.model.prior import Prior

__all__ = ["Meaning", "same_meaning", "stands_for"]

Meaning = Mapping[str, float]
_DIGITS = 7
# Of the default prior's sd: a quarter of the changes that are looked for.
_NEGLIGIBLE = 0.05


def stands_for(campaign: Campaign) -> dict[str, dict[str, float]]:
    """Of every kept compliance of a campaign (or plan) the joints' compliances it is the sum of, with their weights."""
    kept = kept_compliances(campaign.machine(), *dict.fromkeys(test.circle for test in campaign.scope))
    found = {}
    for name, members, weights, absorbed in zip(kept.names, kept.sets, kept.weights, kept.absorbed, strict=True):
        parts = dict(zip(members, weights, strict=True)) | {other.label: weight for other, weight in absorbed.items()}
        found[name.label] = {other: float(f"{weight:.{_DIGITS}g}") for other, weight in parts.items()}
    return found


def same_meaning(name: str, one: Meaning, other: Meaning) -> bool:
    """Whether they differ by less than 5 % of the compliance's default prior sd, the joints' being as large as their priors.

    A work ball that stands a millimetre higher makes no other machine; one that stands a decimetre higher does.

    Parameters
    ----------
    name : str
        The kept compliance.
    one, other : mapping of compliance to weight
    """
    labels = sorted(set(one) | set(other))
    names = [ComplianceName(*label[2:]) for label in (name, *labels)]
    size, *sizes = Prior.default().compliance_sd(names, 0, 1.0)
    apart = [one.get(label, 0.0) - other.get(label, 0.0) for label in labels]
    return bool(np.linalg.norm(np.array(apart) * sizes) <= _NEGLIGIBLE * size)
