"""Rivals of the slopes: other effects that also explain a change of the readings with force.

A slope is the change of a compliance with force. The rivals are: the load on the joints, a
deflection of the work ball's mount that is not proportional to force (curved mount), and a force
that is not a linear function of pressure (curved force law).
"""

from __future__ import annotations

from typing import NamedTuple

from ldbb_bayes.model.terms import BasisNoise, Columns, ForceError, JointLoad, Mount, Term

__all__ = ["RIVALS", "Rival", "is_rival_of_slopes"]


class Rival(NamedTuple):
    """Effect on the readings that resembles a change of a compliance with force.

    The effect is a whole nuisance term (effect modelled but not of interest), such as `JointLoad`,
    or a part of a term that a setting switches on, such as the curvature of `Mount`.
    """

    term: type[Term]
    #: name of the field of the term that switches the effect off when it is 0, such as
    #: curvature_um; empty text if the effect is the whole term
    setting: str
    stem: str  #: beginning of the names of the effect's coefficients, such as joint_load


# Rivals of the slopes, by the names that results use for them.
RIVALS: dict[str, Rival] = {
    "joint load": Rival(JointLoad, "", "joint_load"),
    "curved mount": Rival(Mount, "curvature_um", "mount_curvature"),
    "curved force law": Rival(ForceError, "curvature_sd", "force_curvature"),
}
# Beginnings of the names of the rivals' coefficients.
_STEMS = tuple(rival.stem for rival in RIVALS.values())


def is_rival_of_slopes(columns: Columns | BasisNoise) -> bool:
    """Return whether the columns of a term belong to an effect that resembles a slope.

    A slope is the change of a compliance with force. Effects that resemble a slope are the load on
    the joints, a mount deflection that is not proportional to force, and a force that is not a
    linear function of pressure. Noise (`BasisNoise`) never resembles a slope.
    """
    return isinstance(columns, Columns) and columns.names[0].startswith(_STEMS)
