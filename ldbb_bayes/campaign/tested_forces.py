"""Check that a force at which results are stated is near the forces that were tested."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError, require

__all__ = ["check_deflecting_force", "check_force", "force_to_state", "listed_forces"]

# Limits of the force at which results may be stated. The force must be at least
# ``_LEAST_FORCE_SHARE`` times the smallest force tested, and at most ``_LARGEST_FORCE_SHARE`` times
# the largest force tested.
_LEAST_FORCE_SHARE = 0.1
_LARGEST_FORCE_SHARE = 1.5


def check_force(
    campaign: Campaign, force_N: float | None, subject: str = "force_N (--force-N)"
) -> None:
    """Raise an `InputError` if a force is too far outside the range of the tested forces.

    ``force_N`` [N] must lie between a tenth of the smallest force tested and 1.5 times the largest
    force tested. None is allowed, and means the model's reference force. ``subject`` is the name of
    the force in the message.
    """
    if force_N is None:
        return
    lower = _LEAST_FORCE_SHARE * float(campaign.forces_N.min())
    _check_between(campaign, force_N, lower, subject)


def force_to_state(campaign: Campaign, reference_N: float) -> float:
    """Return the force [N] at which results are stated if the user names none.

    It is the model's reference force ``reference_N``. If that is too far from the tested forces
    (`check_force`), it is their middle instead. The reference force of a plan is that of the
    campaign from which the plan was designed; the forces of the plan may all be smaller.
    """
    least = float(campaign.forces_N.min())
    largest = float(campaign.forces_N.max())
    if _LEAST_FORCE_SHARE * least <= reference_N <= _LARGEST_FORCE_SHARE * largest:
        return reference_N
    return 0.5 * (least + largest)


def check_deflecting_force(campaign: Campaign, force_N: float, subject: str) -> None:
    """Raise an `InputError` if a force is negative or too far above the tested forces.

    The check is for quantities, such as the deviation of a path, to which compliances contribute in
    proportion to the force. A small force is allowed, because compliances hardly contribute then.
    ``force_N`` [N] must be at most 1.5 times the largest force tested. ``subject`` is the name of
    the force in the message.
    """
    _check_between(campaign, force_N, 0.0, subject)


def _check_between(campaign: Campaign, force_N: float, lower_N: float, subject: str) -> None:
    """Raise an `InputError` unless a force is between a limit and 1.5 times the largest tested.

    ``lower_N`` is the limit [N]. The other arguments are those of `check_force`.
    """
    least = float(campaign.forces_N.min())
    largest = float(campaign.forces_N.max())
    upper_N = _LARGEST_FORCE_SHARE * largest
    require(
        lower_N <= force_N <= upper_N,
        f"{subject} must be a force from {lower_N:g} to {upper_N:g} N, for {campaign.name!r}"
        f" was tested from {least:g} to {largest:g} N, got {force_N}. Choose one within what was"
        " tested, or test at that force.",
    )


def listed_forces(forces_N: float | Sequence[float]) -> list[float]:
    """Return forces as a list; a single number is a list of one force.

    Raise an `InputError` for anything else than numbers, such as a text.
    """
    message = f"forces_N must be a list of numbers, got {forces_N!r}. Write for example [300.0]."
    try:
        forces = np.atleast_1d(np.asarray(forces_N))
    except ValueError:  # lists of different lengths within the list
        raise InputError(message) from None
    require(forces.dtype.kind in "iuf" and forces.ndim == 1, message)
    return [float(force) for force in forces]
