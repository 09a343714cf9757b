"""Degeneracies: combinations of coefficients that no reading of a campaign resolves.

Coefficients are the parameters of interest (compliances, their slopes and geometric errors) and the
nuisance coefficients (effects that are modelled but not of interest). In a degeneracy, the effects
of the coefficients on the readings cancel. For example, a change of the parameters cancels the
effect of a nuisance. The degeneracies span the null space of the design matrix; a sparse basis of
it is computed, so that each degeneracy involves few coefficients. No readings are needed, so that a
plan can be examined too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from ldbb_bayes.analysis.null_space import EXACT_SHARE, NullSpace
from ldbb_bayes.inference.checks import in_order_of_force
from ldbb_bayes.model.fourier import basis, harmonic_index
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.terms import Columns, Term
from ldbb_bayes.results import Array, Result
from ldbb_bayes.units import ranked

__all__ = ["Degeneracy", "Standing", "StandingKind", "degeneracies", "standing_degeneracies"]

# Largest number of angles of a test at which the effects of coefficients on the readings are
# computed. It is enough, because no effect has more than 12 waves per turn.
_MOST_ANGLES = 240
# Angles of readings [rad] that agree to this number of decimals count as one angle.
_ANGLE_DECIMALS = 9
# A degeneracy names only parameters whose effect on the readings is more than this share of the
# largest effect of any of its coefficients.
_NAMED_SHARE = 0.02
# The effect of a coefficient on the readings is a rounding error if it is below this share of the
# largest effect of any coefficient in the same combination.
_ROUNDING = 1e-9
# Friction counts as hidden if a change of the parameters imitates its effect on the readings. The
# difference must be less than this share of the effect.
_UNEXPLAINED_SHARE = 1e-3
# Singular values below this share of the largest count as zero when the change of the readings by
# friction is fitted by changes of the parameters.
_RANK_TOLERANCE = 1e-10
# A change of a reading below this share of the resolution of the readings cannot be seen.
_VISIBLE_SHARE = 0.1
# One micrometre in millimetres.
_MICROMETRE = 1e-3
# Number of lobes per turn of a form error of the balls that looks like a rotation of the machine
# caused by a moment.
_LOBES = 4


@dataclass(frozen=True, eq=False)
class Degeneracy:
    """A combination of parameters and nuisance coefficients that no reading resolves.

    Nuisance coefficients are effects that are not of interest. Those that the model leaves out are
    considered too.
    """

    #: class name of the model term that the pivot belongs to; empty if the pivot is a parameter.
    #: The pivot is the coefficient whose effect on the readings the other coefficients cancel.
    term: str
    #: changes of coefficients, by name, that compensate one another in every reading; in internal
    #: units (mm, N, rad); nuisance coefficients come before parameters
    combination: Mapping[str, float]
    #: parameters of interest whose effect on the readings is more than 2 % of the largest effect of
    #: any coefficient in ``combination``
    parameters: tuple[str, ...]
    units: Mapping[str, str]  #: internal units of all parameters in ``combination``, by name
    #: whether the model has a term for every nuisance coefficient in ``combination``; if not, the
    #: intervals of the parameters ignore the effect that is left out
    modelled: bool
    #: whether the size of every nuisance coefficient in ``combination`` is given by a certificate,
    #: or by a model term whose values the user has changed
    stated: bool
    #: root sum of squares of the changes in ``combination``, each divided by its prior standard
    #: deviation
    prior_sds: float
    #: largest change of a reading that ``combination`` causes [µm]; 0 where it is a rounding error
    #: (below 1e-9 of the largest change that one of its coefficients causes alone)
    change_um: float

    @property
    def nuisances(self) -> tuple[str, ...]:
        """Names of the nuisance coefficients (effects not of interest) in the degeneracy."""
        return tuple(name for name in self.combination if name not in self.units)


class StandingKind(StrEnum):
    """Kind of effect on the readings that looks like a parameter of the machine.

    The kinds are friction, drift, a nonlinear mount or force device (curvature), and a four-lobed
    form error of the balls (lobes). The model has no term for such an effect, or only tests at
    different forces separate the effect from the parameter.
    """

    FRICTION = "friction"
    DRIFT = "drift"
    CURVATURE = "curvature"
    LOBES = "lobes"


@dataclass(frozen=True)
class Standing(Result):
    """A kind of effect, such as friction, and the parameters that look like it.

    ``parameters`` are the names of these parameters, which the tests hardly separate from the
    effect.
    """

    kind: StandingKind
    parameters: tuple[str, ...]


@dataclass(frozen=True)
class _Coefficients:
    """The m coefficients that act in several tests: parameters and nuisance coefficients.

    Nuisance coefficients (effects that are not of interest) that the model leaves out are included.
    ``owners`` are the class names of the model terms that the coefficients belong to, empty for
    parameters. ``columns``, shape (tests, 25, m), are the changes of the 25 Fourier coefficients of
    each test's radial deviation per unit of each coefficient. ``prior_sd``, shape (m,), are the
    prior standard deviations.
    """

    names: tuple[str, ...]
    owners: tuple[str, ...]
    columns: Array
    prior_sd: Array


def degeneracies(bound: BoundModel) -> tuple[Degeneracy, ...]:
    """Return a sparse basis of the degeneracies that involve parameters of interest.

    A degeneracy is a combination of parameters and nuisance coefficients that no reading resolves.
    Its pivot is the coefficient whose effect on the readings the other coefficients cancel.

    Parameters
    ----------
    bound
        Model bound to a campaign or plan.

    Returns
    -------
    tuple of Degeneracy
        Degeneracies with a nuisance coefficient as pivot come first, then those with a parameter
        as pivot.
    """
    coefficients = _all_coefficients(bound)
    scaled = _effects(bound, coefficients.columns) * coefficients.prior_sd
    limit = _VISIBLE_SHARE * bound.campaign.resolution_um * _MICROMETRE
    space = NullSpace(scaled, len(bound.names), limit)
    combinations = []
    for pivot, vector in space.sparse_basis():
        if pivot < space.parameters:
            vector = _parameters_alone_if_unresolved(space, vector)
        degeneracy = _describe_degeneracy(bound, coefficients, space, pivot, vector)
        if degeneracy is not None:
            combinations.append(degeneracy)
    return tuple(combinations)


def _parameters_alone_if_unresolved(space: NullSpace, vector: Array) -> Array:
    """Return a combination with its nuisance coefficients set to zero, if still unresolved then.

    If a reading resolves the parameters of the combination alone, the combination is returned
    unchanged. The combination is ``vector``, shape (m,): the m coefficients in units of their prior
    standard deviations. ``space`` is the null space of the campaign's design matrix.
    """
    is_parameter = np.arange(len(vector)) < space.parameters
    parameters_only = np.where(is_parameter, vector, 0.0)
    largest_effect = (space.largest * np.abs(parameters_only)).max()
    limit = min(space.limit * np.linalg.norm(parameters_only), EXACT_SHARE * largest_effect)
    if np.abs(space.scaled @ parameters_only).max() <= limit:
        return parameters_only
    return vector


def _describe_degeneracy(
    bound: BoundModel, coefficients: _Coefficients, space: NullSpace, pivot: int, vector: Array
) -> Degeneracy | None:
    """Return the `Degeneracy` that describes an unresolved combination of coefficients.

    The combination is ``vector``, shape (m,): the m coefficients in units of their prior standard
    deviations. ``pivot`` is the index of the coefficient that has the value one. ``space`` is the
    null space that the combination belongs to. Return None if the effect of every parameter on the
    readings is at most 2 % of the largest effect of any coefficient in the combination.
    """
    names = coefficients.names
    effect = space.largest * np.abs(vector)
    members = [int(i) for i in np.flatnonzero(effect > _ROUNDING * effect.max())]
    parameters = [i for i in members if i < space.parameters]
    named = tuple(names[i] for i in parameters if effect[i] > _NAMED_SHARE * effect.max())
    if not named:
        return None
    nuisances = _sort_by_effect([i for i in members[len(parameters) :] if i != pivot], effect)
    if pivot >= space.parameters:
        nuisances.insert(0, pivot)
    change = _in_reading_units(coefficients, pivot, vector)
    prior_sds = change / coefficients.prior_sd
    terms = [_modelled_term(bound, coefficients.owners[i]) for i in nuisances]
    stated = [_is_stated(bound, names[i], term) for i, term in zip(nuisances, terms, strict=True)]
    return Degeneracy(
        term=coefficients.owners[pivot],
        combination={names[i]: float(change[i]) for i in (*nuisances, *parameters)},
        parameters=named,
        units={names[i]: bound.parameters[i].unit for i in parameters},
        modelled=None not in terms,
        stated=all(stated),
        prior_sds=float(np.linalg.norm(prior_sds)),
        change_um=_reading_change_um(space, prior_sds),
    )


def _sort_by_effect(indices: Sequence[int], effect: Array) -> list[int]:
    """Return the given indices of coefficients, those with the largest effect first.

    ``effect`` holds the largest effect of every coefficient on any reading.
    """
    effect_by_index = {i: float(effect[i]) for i in indices}
    return ranked(effect_by_index, effect_by_index.__getitem__)


def _in_reading_units(coefficients: _Coefficients, pivot: int, vector: Array) -> Array:
    """Return a combination of coefficients in internal units (mm, N, rad).

    The combination is ``vector``, shape (m,): the m coefficients in units of their prior standard
    deviations. If the coefficient with index ``pivot`` is a nuisance, the combination is scaled so
    that this nuisance is one in the unit that users see, such as 1 µm.
    """
    change = np.asarray(vector * coefficients.prior_sd)
    if coefficients.owners[pivot]:
        name = coefficients.names[pivot]
        amount = Term.owner(name).unit_of(name).one
        change *= amount / change[pivot]
    return change


def _reading_change_um(space: NullSpace, prior_sds: Array) -> float:
    """Return the largest change of any reading caused by a combination of coefficients [µm].

    Return zero if this change is a rounding error. ``prior_sds`` are the changes of the
    coefficients in units of their prior standard deviations; ``space`` is the null space that the
    combination belongs to.
    """
    change = np.abs(space.scaled @ prior_sds).max()
    largest_alone = (space.largest * np.abs(prior_sds)).max()
    if change <= _ROUNDING * largest_alone:
        return 0.0
    return float(change / _MICROMETRE)


def _modelled_term(bound: BoundModel, owner: str) -> Term | None:
    """Return the model's nuisance term whose class is named ``owner``; None if there is none."""
    for term in bound.model.nuisances:
        if type(term).__name__ == owner:
            return term
    return None


def _is_stated(bound: BoundModel, coefficient: str, term: Term | None) -> bool:
    """Return whether the size of a nuisance coefficient is stated.

    The size is stated by a certificate, or by a term that the user has changed. ``term`` is the
    model term that the coefficient belongs to; the answer is false if it is None (not modelled).
    """
    if term is None:
        return False
    is_edited = _edition_terms(bound).get(type(term)) != term
    return is_edited or term.is_stated(coefficient, bound.campaign)


def standing_degeneracies(bound: BoundModel, aliases: Sequence[Degeneracy]) -> tuple[Standing, ...]:
    """Return the kinds of effect that look like parameters, each with these parameters.

    The kinds are friction, drift, a nonlinear mount or force device, and a four-lobed form error of
    the balls. The model has no term for such an effect, or only tests at different forces separate
    the effect from the parameters.

    Parameters
    ----------
    bound
        Model bound to a campaign or plan.
    aliases
        The `degeneracies` of the bound model.
    """
    candidates = {
        StandingKind.FRICTION: _like_friction(bound),
        StandingKind.DRIFT: _like_drift(bound),
        StandingKind.CURVATURE: _like_curvature(bound),
        StandingKind.LOBES: _like_lobes(bound, aliases),
    }
    standing = []
    for kind, parameters in candidates.items():
        if parameters:
            standing.append(Standing(kind, parameters))
    return tuple(standing)


def _compliances_of_kind(bound: BoundModel, kind: str) -> tuple[str, ...]:
    """Return the names of the model's compliances of one kind, such as ``cross`` (``C_XYX``)."""
    return tuple(name.label for name in bound.compliances if name.kind == kind)


def _modelled_terms(bound: BoundModel) -> set[str]:
    """Return the class names of the model's nuisance terms, such as ``Drift``."""
    return {type(term).__name__ for term in bound.model.nuisances}


def _like_friction(bound: BoundModel) -> tuple[str, ...]:
    """Return the names of the cross compliances that friction can be mistaken for.

    Friction changes the readings like a cross compliance, but with a sign that changes with the
    direction of travel. It can be mistaken for the cross compliance if a combination of the
    parameters changes the readings in the same way.
    """
    directions = {test.name: test.direction for test in bound.campaign.tests}
    sign = np.where([directions[name] == "CCW" for name in bound.test_names], -1.0, 1.0)
    labels = _compliances_of_kind(bound, "cross")
    cross = [j for j, name in enumerate(bound.names) if name in labels]
    reversed_columns = bound.interest[:, :, cross] * sign[:, None, None]
    effects = _effects(bound, np.concatenate([bound.interest, reversed_columns], axis=2))
    parameters = effects[:, : len(bound.names)] * bound.scale
    friction = effects[:, len(bound.names) :]
    solution = np.linalg.lstsq(parameters, friction, rcond=_RANK_TOLERANCE)[0]
    unexplained = np.abs(friction - parameters @ solution).max(axis=0)
    hidden = unexplained < _UNEXPLAINED_SHARE * np.abs(friction).max(axis=0)
    return tuple(bound.names[j] for j, is_hidden in zip(cross, hidden, strict=True) if is_hidden)


def _like_drift(bound: BoundModel) -> tuple[str, ...]:
    """Return the names of the compliances that a drift of the readings can be mistaken for.

    For a campaign whose tests were run in the order of their forces, these are the direct
    compliances and, if the model has the term ``Position``, the rotations caused by a force. There
    are none for any other campaign, for a plan, or if the model has the term ``Drift``.
    """
    modelled = _modelled_terms(bound)
    if "Drift" in modelled or bound.campaign.is_plan or not in_order_of_force(bound):
        return ()
    direct = _compliances_of_kind(bound, "direct")
    if "Position" not in modelled:
        return direct
    return (*direct, *_compliances_of_kind(bound, "rotation_for_force"))


def _like_curvature(bound: BoundModel) -> tuple[str, ...]:
    """Return the direct compliances whose slopes look like a nonlinear mount or force device.

    A slope is the change of a compliance with force. There are no such compliances unless the model
    has two or more direct compliances, each with a slope.
    """
    direct = _compliances_of_kind(bound, "direct")
    if len(direct) > 1 and all(f"{label}_1" in bound.names for label in direct):
        return direct
    return ()


def _like_lobes(bound: BoundModel, aliases: Sequence[Degeneracy]) -> tuple[str, ...]:
    """Return the rotations caused by a moment that look like a four-lobed form error of the balls.

    There are none unless all tests have one radius and one clocking of the balls, at several
    forces. Then only the forces separate the rotation from the form error. There are also none if
    no degeneracy in ``aliases`` involves a form error of the balls, or if one already involves a
    four-lobed form error.
    """
    once = not bound.setting.two_balls and len(set(bound.setting.radius_mm)) == 1
    if not once or bound.campaign.force_levels <= 1:
        return ()
    if not any(degeneracy.term == "BallForm" for degeneracy in aliases):
        return ()
    coefficients = _all_coefficients(bound)
    other_orders = np.delete(coefficients.columns, harmonic_index(_LOBES), axis=1)
    has_four_lobes = ~np.any(other_orders, axis=(0, 1))
    for degeneracy in aliases:
        for name in degeneracy.nuisances:
            if has_four_lobes[coefficients.names.index(name)]:
                return ()
    return _compliances_of_kind(bound, "rotation_for_moment")


def _all_coefficients(bound: BoundModel) -> _Coefficients:
    """Return the coefficients that act in several tests: parameters and nuisance coefficients.

    The nuisance coefficients (effects that are not of interest) are those of the model's terms, and
    those of terms that the model's preset has but the model leaves out.
    """
    modelled = {type(term): term for term in bound.model.nuisances}
    terms = {**_edition_terms(bound), **modelled}
    names = list(bound.names)
    owners = [""] * len(bound.names)
    columns = [bound.interest]
    prior_sd = [bound.scale]
    for kind in Term.kinds.values():
        if kind not in terms:
            continue
        term = terms[kind]
        hyper_prior = bound.model.prior.hyper(term.scales, bound.campaign.resolution_um)
        typical = dict(zip(hyper_prior.names, hyper_prior.scale, strict=True))
        for block in term.columns(bound.setting):
            if not isinstance(block, Columns) or block.private:
                continue
            names.extend(block.names)
            owners.extend([kind.__name__] * len(block.names))
            columns.append(block.values)
            prior_sd.append(block.sd_at({"sigma": 0.0, **typical}))
    return _Coefficients(
        names=tuple(names),
        owners=tuple(owners),
        columns=np.concatenate(columns, axis=2),
        prior_sd=np.concatenate(prior_sd),
    )


def _edition_terms(bound: BoundModel) -> dict[type[Term], Term]:
    """Return the nuisance terms of the preset that the model was made from, by class.

    The terms have the package's own values, even where the user has changed them in the model.
    """
    edition = HybridModel.first()
    if bound.model.preset == "default":
        edition = HybridModel.default()
    return {type(term): term for term in edition.nuisances}


def _effects(bound: BoundModel, columns: Array) -> Array:
    """Return the change of k readings per unit of each of m coefficients, shape (k, m) [mm].

    ``columns``, shape (tests, 25, m), are the changes of the 25 Fourier coefficients of each test's
    radial deviation. The readings are those of each test at its own angles, of which at most
    ``_MOST_ANGLES`` are used.
    """
    tests = {test.name: test for test in bound.campaign.tests}
    rows = []
    for name, columns_of_test in zip(bound.test_names, columns, strict=True):
        angle = np.remainder(tests[name].angles_rad(), 2.0 * np.pi)
        angle = np.unique(np.round(angle, _ANGLE_DECIMALS))
        if len(angle) > _MOST_ANGLES:
            angle = angle[np.linspace(0, len(angle) - 1, _MOST_ANGLES).astype(int)]
        rows.append(basis(angle) @ columns_of_test)
    return np.concatenate(rows)
