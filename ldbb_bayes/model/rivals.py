"""Alternative explanations of the slopes: other effects that make the readings change with force.

A slope is the change of a compliance with force. Three other effects also make the readings depend
nonlinearly on force: the load on the joints, a deflection of the work ball's mount that is not
proportional to force (curved mount), and a force that is not a linear function of pressure (curved
force law). The code calls them rivals of the slopes.
"""

from __future__ import annotations

from typing import NamedTuple

from ldbb_bayes.model.terms import ForceError, JointLoad, Mount, Term

__all__ = ["RIVALS", "Rival"]


class Rival(NamedTuple):
    """Effect on the readings that resembles a change of a compliance with force.

    The effect is either a whole nuisance term, such as `JointLoad`, or an optional part of a term,
    such as the curvature of `Mount`.
    """

    term: type[Term]
    #: Name of the field of ``term`` that switches off this effect if it is set to zero, such as
    #: ``curvature_um``. Empty string if the effect is the whole nuisance term.
    setting: str
    #: Beginning of the names of the coefficients that describe this effect. A model without the
    #: effect is the model in which these coefficients are zero.
    coefficients: str


# The alternative explanations of the slopes: effects that resemble a change of a compliance with
# force. The keys of the dict are the names that results use for these effects.
RIVALS: dict[str, Rival] = {
    "joint load": Rival(JointLoad, "", "joint_load_"),
    "curved mount": Rival(Mount, "curvature_um", "mount_curvature"),
    "curved force law": Rival(ForceError, "curvature_sd", "force_curvature"),
}
