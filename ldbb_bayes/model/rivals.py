"""Rivals of the slopes: other effects that also explain a change of the readings with force.

A slope is the change of a compliance with force.
"""

from __future__ import annotations

from typing import NamedTuple

from ldbb_bayes.model.terms import BasisNoise, Columns, ForceError, JointLoad, Mount, Term

__all__ = ["RIVALS", "Rival", "is_rival_of_slopes"]


class Rival(NamedTuple):
    """A term, or an effect that one setting of a term switches on, that resembles a slope."""

    term: type[Term]
    setting: str  #: field of the term that is 0 without the rival; "": the whole term
    stem: str  #: beginning of the names of the rival's coefficients


RIVALS: dict[str, Rival] = {
    "joint load": Rival(JointLoad, "", "joint_load"),
    "curved mount": Rival(Mount, "curvature_um", "mount_curvature"),
    "curved force law": Rival(ForceError, "curvature_sd", "force_curvature"),
}
_STEMS = tuple(rival.stem for rival in RIVALS.values())


def is_rival_of_slopes(columns: Columns | BasisNoise) -> bool:
    """Return whether columns belong to a rival of the slopes."""
    return isinstance(columns, Columns) and columns.names[0].startswith(_STEMS)
