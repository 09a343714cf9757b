"""Rivals of the slopes: terms that also explain a change of the readings with force."""

from __future__ import annotations

from typing import NamedTuple

from ldbb_bayes.model.terms import BasisNoise, Columns, ForceError, JointLoad, Mount, Term

__all__ = ["RIVALS", "Rival", "is_rival_of_slopes"]


class Rival(NamedTuple):
    """A term, or the part of it that one setting switches on, that competes with slopes."""

    term: type[Term]
    setting: str  #: field of the term that is zero without the rival; empty: the whole term
    stem: str  #: what the names of its coefficients begin with


RIVALS: dict[str, Rival] = {
    "joint load": Rival(JointLoad, "", "joint_load"),
    "curved mount": Rival(Mount, "curvature_um", "mount_curvature"),
    "curved force law": Rival(ForceError, "curvature_sd", "force_curvature"),
}
_STEMS = tuple(rival.stem for rival in RIVALS.values())


def is_rival_of_slopes(columns: Columns | BasisNoise) -> bool:
    """Return whether columns explain a change with force as slopes do."""
    return isinstance(columns, Columns) and columns.names[0].startswith(_STEMS)
