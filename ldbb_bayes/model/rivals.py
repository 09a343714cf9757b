"""Rivals of the slopes: other effects that also explain a change of the readings with force.

A slope is the change of a compliance with force.
"""

from __future__ import annotations

from typing import NamedTuple

from ldbb_bayes.model.terms import BasisNoise, Columns, ForceError, JointLoad, Mount, Term

__all__ = ["RIVALS", "Rival", "is_rival_of_slopes"]


class Rival(NamedTuple):
    """Effect that resembles a change of a compliance with force.

    It is a whole nuisance term (effect modelled but not of interest), or a part of one that a
    setting switches on.
    """

    term: type[Term]
    #: field of the term that switches the effect off when it is 0; empty if it is the whole term
    setting: str
    stem: str  #: beginning of the names of this effect's coefficients


RIVALS: dict[str, Rival] = {
    "joint load": Rival(JointLoad, "", "joint_load"),
    "curved mount": Rival(Mount, "curvature_um", "mount_curvature"),
    "curved force law": Rival(ForceError, "curvature_sd", "force_curvature"),
}
_STEMS = tuple(rival.stem for rival in RIVALS.values())


def is_rival_of_slopes(columns: Columns | BasisNoise) -> bool:
    """Return whether columns belong to an effect that resembles a slope of a compliance.

    A slope is the change of a compliance with force.
    """
    return isinstance(columns, Columns) and columns.names[0].startswith(_STEMS)
