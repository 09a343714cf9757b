"""Posterior draws of compliances C(F) and of elastic deflections around circles, at any force F.

Both include what the term `JointLoad` adds (joints that deflect under their own load). C(F) is
computed from the compliance at the reference force and from its change with force. A circle is
described by 25 Fourier coefficients of the orders 0 to 12. φ are the h hyper-parameters, such as
the standard deviation of the noise; β are the p parameters. Shared nuisances are effects that are
modelled but not of interest and that are common to several tests; the coefficients of `JointLoad`
are among them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.inference.coefficients import ModelDraws, draw_shared, names_of_shared
from ldbb_bayes.machine.chain import LINEAR
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms import Columns, JointLoad
from ldbb_bayes.model.terms.joints import joint_load_columns
from ldbb_bayes.results import Array

__all__ = [
    "AddedCompliance",
    "ElasticDraws",
    "added_compliances",
    "compliance_curves",
    "draw_for_joint_loads",
    "elastic_draws",
    "elastic_draws_with",
    "joint_load_circles",
    "joint_load_of",
    "joint_load_secants",
]


class ElasticDraws(NamedTuple):
    """Posterior draws of compliances C(F) and of deflections along the bar, at n bar forces F."""

    #: draws of the compliances C(F) at n bar forces F, shape (draws, n, compliances) [mm/N, rad/N,
    #: rad/(N mm)]
    compliances: Array
    #: draws of the elastic deflection along the bar divided by the bar force [mm/N], shape (draws,
    #: circles, n, 25). The deflection of a circle at one of n bar forces is described by 25 Fourier
    #: coefficients.
    per_force: Array


class AddedCompliance(NamedTuple):
    """A direct compliance to which the term `JointLoad` adds a part that depends on the force."""

    place: int  #: index of the compliance among the compliances of the model
    label: str  #: name of the compliance, such as C_XXX
    axis: int  #: index of the machine axis along which the compliance acts
    columns: Columns  #: change of the readings per unit of each coefficient of the axis

    def places_in(self, names: Sequence[str]) -> NDArray[np.intp]:
        """Return the indices in ``names`` of the coefficients that belong to the compliance."""
        return np.array([names.index(name) for name in self.columns.names], dtype=np.intp)


def joint_load_of(bound: BoundModel) -> JointLoad | None:
    """Return the term of a model for joints that deflect under their own load.

    The result is None if the model has no such term. ``bound`` is the model of a campaign.
    """
    for term in bound.model.nuisances:
        if isinstance(term, JointLoad):
            return term
    return None


def added_compliances(bound: BoundModel) -> list[AddedCompliance]:
    """Return the direct compliances to which the term `JointLoad` adds a part.

    The list is empty if the model has no such term, and lacks the axes that no circle moves.
    ``bound`` is the model of a campaign.
    """
    joint_load = joint_load_of(bound)
    if joint_load is None:
        return []
    # The term may be of a class derived from `JointLoad`.
    columns_of_term = bound.columns_of.get(type(joint_load), ())
    columns_by_axis = joint_load_columns(bound.setting, columns_of_term)
    added = []
    for place, compliance in enumerate(bound.compliances):
        if compliance.kind == "direct" and compliance.twist in columns_by_axis:
            columns = columns_by_axis[compliance.twist]
            axis = LINEAR.index(compliance.twist)
            added.append(AddedCompliance(place, compliance.label, axis, columns))
    return added


def compliance_curves(
    bound: BoundModel, phi: Array, beta: Array, force_N: Array, rng: np.random.Generator
) -> Array:
    """Return the compliances C(F) at n bar forces F, shape (draws, n, compliances).

    ``force_N``, shape (n,), holds the forces [N]. C(F) is computed from the compliance at the
    reference force and from its change with force. There is one curve for each draw of the p
    parameters ``beta``, shape (draws, p), and of the h hyper-parameters ``phi``, shape (draws, h).
    The direct compliance of a machine axis is the deflection of the axis divided by the bar force
    along the axis. If the model has the term `JointLoad` (joints that deflect under their own
    load), the direct compliances include the contribution of this term. The coefficients of the
    term are then drawn at random, conditional on the parameters, the hyper-parameters and the
    readings. ``bound`` is the model of the campaign.
    """
    return elastic_draws(ModelDraws(bound, phi, beta), (), force_N, rng).compliances


def elastic_draws(
    draws: ModelDraws, circles: Sequence[int], force_N: Array, rng: np.random.Generator
) -> ElasticDraws:
    """Return posterior draws of compliances and of the elastic deflection around circles.

    If the model has the term `JointLoad` (joints that deflect under their own load), compliances
    and deflections both include the contribution of this term. The coefficients of the term are
    drawn at random, conditional on the parameters, the hyper-parameters and the readings.
    Compliances and deflections are computed from the same draws of these coefficients.

    Parameters
    ----------
    draws
        Posterior draws of a model.
    circles
        Indices of the tests for whose circles the deflection is returned.
    force_N
        The n forces F of the bar, shape (n,), none of them zero [N]. Forces other than those tested
        are allowed.
    rng
        Generator of the random draws.

    Returns
    -------
    ElasticDraws
    """
    return elastic_draws_with(draw_for_joint_loads(draws, rng), draws, circles, force_N)


def draw_for_joint_loads(draws: ModelDraws, rng: np.random.Generator) -> Array:
    """Return random draws of the shared nuisance coefficients for `elastic_draws_with`.

    They are drawn conditional on the readings, on the parameters and on the hyper-parameters, shape
    (draws, q). If the model has no term `JointLoad`, none of them is needed, and q is 0. ``draws``
    are the posterior draws of a model, and ``rng`` generates the random numbers.
    """
    if joint_load_of(draws.bound) is None:
        return np.zeros((len(draws.beta), 0))
    return draw_shared(draws.bound, draws.phi, draws.beta, rng)


def elastic_draws_with(
    shared: Array, draws: ModelDraws, circles: Sequence[int], force_N: Array
) -> ElasticDraws:
    """Return draws of compliances and elastic deflections, for given nuisance coefficients.

    The function does the same as `elastic_draws`, but takes the coefficients of the shared
    nuisances as an argument instead of drawing them. ``shared``, shape (draws, q), holds q
    coefficients of these nuisances for each draw. The coefficients are used only if the model has
    the term `JointLoad` (joints that deflect under their own load). The other arguments are the
    same as in `elastic_draws`.
    """
    bound = draws.bound
    at_forces = np.stack([bound.compliance_at(force) for force in force_N])
    compliances = np.einsum("fcp,wp->wfc", at_forces, draws.beta)
    elastic = bound.setting.elastic[list(circles)]
    per_force = np.einsum("rkc,wfc->wrfk", elastic, compliances)
    joint_load = joint_load_of(bound)
    if joint_load is None:
        return ElasticDraws(compliances, per_force)
    names = names_of_shared(bound)
    secants = joint_load.secants(bound.setting, force_N)
    for added in added_compliances(bound):
        coefficients = shared[:, added.places_in(names)]
        compliances[:, :, added.place] += coefficients @ secants.T
        for k, r in enumerate(circles):
            deflections = joint_load.deflections(bound.setting, added.axis, r, force_N)
            columns = deflections / force_N[:, None, None]
            per_force[:, k] += np.einsum("fkl,wl->wfk", columns, coefficients)
    return ElasticDraws(compliances, per_force)


def joint_load_circles(
    draws: ModelDraws, r: int, force_N: float, rng: np.random.Generator
) -> dict[str, Array]:
    """Return posterior draws of what `JointLoad` adds to each direct compliance around one circle.

    The keys of the result are the names of the direct compliances. Each value holds the Fourier
    coefficients of the deflection that is added to that of the compliance, shape (draws, 25) [mm].
    The result is empty if the model has no such term. ``r`` is the index of the test whose circle
    is run, and ``force_N`` the force of the bar [N].
    """
    bound = draws.bound
    joint_load = joint_load_of(bound)
    if joint_load is None:
        return {}
    shared = draw_shared(bound, draws.phi, draws.beta, rng)
    names = names_of_shared(bound)
    circles = {}
    for added in added_compliances(bound):
        (deflections,) = joint_load.deflections(bound.setting, added.axis, r, np.array([force_N]))
        circles[added.label] = shared[:, added.places_in(names)] @ deflections.T
    return circles


def joint_load_secants(bound: BoundModel, force_N: float) -> dict[str, dict[str, float]]:
    """Return by how much the coefficients of `JointLoad` change direct compliances at a force.

    The keys of the result are the names of the direct compliances; the keys of each value are the
    names of the coefficients. The result is empty if the model has no such term, or if ``force_N``
    [N] is the reference force, at which the term changes no compliance. ``bound`` is the model of
    the campaign.
    """
    joint_load = joint_load_of(bound)
    if joint_load is None or force_N == bound.setting.reference_force_N:
        return {}
    (secants,) = joint_load.secants(bound.setting, np.array([force_N])).tolist()
    changes = {}
    for added in added_compliances(bound):
        changes[added.label] = dict(zip(added.columns.names, secants, strict=True))
    return changes
