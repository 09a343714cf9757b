"""Distance of the circles from the place at which a direct compliance contains no tilt.

A joint that tilts by the angle φ moves the ball by φ times its lever, the vector from the joint's
frame to the ball. The direct compliance C_aa of the joint is therefore its compliance at the frame.
At another place, compliances that describe tilts add to it.
"""

from __future__ import annotations

import numpy as np

from ldbb_bayes.analysis.circle_columns import ANGLE_RAD
from ldbb_bayes.machine.chain import LINEAR, ROTARY
from ldbb_bayes.model.hybrid import BoundModel

__all__ = ["largest_lever_mm"]

# A smaller distance between the centre of a circle and a joint's frame counts as zero [mm].
_NO_LEVER_MM = 1e-6


def largest_lever_mm(bound: BoundModel, axis: str) -> float:
    """Return the largest distance from a joint's frame to a circle's centre with which tilts act.

    Parameters
    ----------
    bound
        The model, applied to a campaign.
    axis
        Linear axis of the joint, such as X.

    Returns
    -------
    float
        The distance at right angles to the axis about which the joint tilts [mm]. It is zero if the
        model has no tilt of the joint, or if all circles are centred at the joint's frame.
    """
    turned = set()
    for compliance in bound.compliances:
        if compliance.joint == axis:
            turned |= {compliance.twist, compliance.wrench} & set(ROTARY)
    machine = bound.campaign.machine()
    joint = machine.joint(axis)
    largest_mm = 0.0
    for circle in {test.circle for test in bound.campaign.tests}:
        lever_mm = machine.lever_mm(joint, circle, ANGLE_RAD).mean(axis=0)
        for letter in turned:
            about = LINEAR[ROTARY.index(letter)]
            across_mm = [lever_mm[k] for k, other in enumerate(LINEAR) if other != about]
            largest_mm = max(largest_mm, float(np.linalg.norm(across_mm)))
    return largest_mm if largest_mm > _NO_LEVER_MM else 0.0
