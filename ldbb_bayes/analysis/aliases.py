"""Find combinations of coefficients that no reading of a campaign resolves.

They are the null space of the design, as a sparse basis: an amount of a nuisance, and the change of
parameters that looks exactly like it. A plan has them too, since no readings are needed.
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

# Angles of each test at which patterns are compared: they have at most 12 waves per turn.
_MOST_ANGLES = 240
# Decimals of an angle [rad] to which repeated angles count as one.
_ANGLE_DECIMALS = 9
# A parameter with a smaller share of the largest effect is not named in a degeneracy.
_NAMED_SHARE = 0.02
# Effects below this share of the largest are rounding.
_ROUNDING = 1e-9
# A pattern is a combination of others where less than this share of it remains unexplained.
_UNEXPLAINED_SHARE = 1e-3
# Singular values below this share of the largest count as zero in that comparison.
_RANK_TOLERANCE = 1e-10
# A change below this share of the readout's resolution is not seen.
_VISIBLE_SHARE = 0.1
# Millimetres in a micrometre.
_MICROMETRE = 1e-3
# Lobes of the ball form that look like rotation by a moment.
_LOBES = 4


@dataclass(frozen=True, eq=False)
class Degeneracy:
    """A combination of coefficients that no reading of a campaign sees."""

    #: class name of the nuisance it begins with; empty for parameters among themselves
    term: str
    #: changes that compensate one another in every reading; inside units (mm, N, rad), the nuisance
    #: first
    combination: Mapping[str, float]
    #: parameters of interest that do more than a fiftieth of what the nuisance does
    parameters: tuple[str, ...]
    units: Mapping[str, str]  #: of all parameters in it
    #: whether the model has the nuisance: else nothing bounds it, and the intervals ignore it
    modelled: bool
    #: whether a certificate, or the model where its term was edited, says how large it is
    stated: bool
    prior_sds: float  #: its length in units of the prior sd
    #: largest change of a reading; 0 below 1e-9 of what its largest member does alone, which is
    #: rounding
    change_um: float

    @property
    def nuisances(self) -> tuple[str, ...]:
        """Nuisance coefficients in it."""
        return tuple(name for name in self.combination if name not in self.units)


class StandingKind(StrEnum):
    """An effect that is no term of the model, or one that force alone separates."""

    FRICTION = "friction"
    DRIFT = "drift"
    CURVATURE = "curvature"
    LOBES = "lobes"


@dataclass(frozen=True)
class Standing(Result):
    """Parameters that look like an effect which the tests of a plan do not separate."""

    kind: StandingKind
    parameters: tuple[str, ...]


@dataclass(frozen=True)
class _Coefficients:
    """All parameters and shared nuisances, modelled or not.

    ``owners`` are class names of terms, empty for parameters; ``columns`` has shape (tests, 25, m),
    ``prior_sd`` shape (m,).
    """

    names: tuple[str, ...]
    owners: tuple[str, ...]
    columns: Array
    prior_sd: Array


def degeneracies(bound: BoundModel) -> tuple[Degeneracy, ...]:
    """Return the sparse null space of a design, as far as it holds parameters of interest.

    Parameters
    ----------
    bound
        Model bound to a campaign or plan.

    Returns
    -------
    tuple of Degeneracy
        Those that begin with a nuisance first, then those of parameters among themselves.
    """
    coefficients = _all_coefficients(bound)
    scaled = _effects(bound, coefficients.columns) * coefficients.prior_sd
    limit = _VISIBLE_SHARE * bound.campaign.resolution_um * _MICROMETRE
    space = NullSpace(scaled, len(bound.names), limit)
    combinations = []
    for pivot, vector in space.sparse_basis():
        if pivot < space.parameters:
            vector = _without_nuisances(space, vector)
        degeneracy = _describe_degeneracy(bound, coefficients, space, pivot, vector)
        if degeneracy is not None:
            combinations.append(degeneracy)
    return tuple(combinations)


def _without_nuisances(space: NullSpace, vector: Array) -> Array:
    """Return a vector of parameters without its nuisances where it is as good so."""
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
    """Return what a vector of the null space combines, or None if no parameter has a part in it."""
    names = coefficients.names
    effect = space.largest * np.abs(vector)
    members = [int(i) for i in np.flatnonzero(effect > _ROUNDING * effect.max())]
    parameters = [i for i in members if i < space.parameters]
    named = tuple(names[i] for i in parameters if effect[i] > _NAMED_SHARE * effect.max())
    if not named:
        return None
    nuisances = _rank_nuisances(
        members[len(parameters) :], pivot, effect, is_nuisance=pivot >= space.parameters
    )
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


def _rank_nuisances(
    nuisances: Sequence[int], pivot: int, effect: Array, *, is_nuisance: bool
) -> list[int]:
    """Return the pivot, where it is a nuisance, then the others by their effect."""
    effects = {i: float(effect[i]) for i in nuisances if i != pivot}
    ranking = ranked(effects, effects.__getitem__)
    if is_nuisance:
        return [pivot, *ranking]
    return ranking


def _in_reading_units(coefficients: _Coefficients, pivot: int, vector: Array) -> Array:
    """Return a vector in inside units, a nuisance at its pivot scaled to one of its unit."""
    change = np.asarray(vector * coefficients.prior_sd)
    if coefficients.owners[pivot]:
        name = coefficients.names[pivot]
        amount = Term.owner(name).unit_of(name).one
        change *= amount / change[pivot]
    return change


def _reading_change_um(space: NullSpace, prior_sds: Array) -> float:
    """Return the largest change of a reading [µm], zero where it is rounding."""
    change = np.abs(space.scaled @ prior_sds).max()
    largest_alone = (space.largest * np.abs(prior_sds)).max()
    if change <= _ROUNDING * largest_alone:
        return 0.0
    return float(change / _MICROMETRE)


def _modelled_term(bound: BoundModel, owner: str) -> Term | None:
    """Return the model's term of a class name, or None if the model leaves it out."""
    for term in bound.model.nuisances:
        if type(term).__name__ == owner:
            return term
    return None


def _is_stated(bound: BoundModel, coefficient: str, term: Term | None) -> bool:
    """Return whether a certificate or an edited term says how large a coefficient is."""
    if term is None:
        return False
    is_edited = _edition_terms(bound).get(type(term)) != term
    return is_edited or term.is_stated(coefficient, bound.campaign)


def standing_degeneracies(bound: BoundModel, aliases: Sequence[Degeneracy]) -> tuple[Standing, ...]:
    """Return degeneracies with effects that are no terms, and those that force alone separates.

    Parameters
    ----------
    bound
        Model bound to a campaign or plan.
    aliases
        Its `degeneracies`.
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
    """Return the names of compliances of one kind."""
    return tuple(name.label for name in bound.compliances if name.kind == kind)


def _modelled_terms(bound: BoundModel) -> set[str]:
    """Return class names of the model's nuisance terms."""
    return {type(term).__name__ for term in bound.model.nuisances}


def _like_friction(bound: BoundModel) -> tuple[str, ...]:
    """Return cross compliances whose pattern looks like friction.

    Friction has the pattern of a cross compliance, with the sign of the direction of travel: it is
    hidden where that is a combination of the parameters' own patterns.
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
    """Return compliances that look like a drift, where the tests ran in the order of force."""
    modelled = _modelled_terms(bound)
    if "Drift" in modelled or bound.campaign.is_plan or not in_order_of_force(bound):
        return ()
    direct = _compliances_of_kind(bound, "direct")
    if "Position" not in modelled:
        return direct
    return (*direct, *_compliances_of_kind(bound, "rotation_for_force"))


def _like_curvature(bound: BoundModel) -> tuple[str, ...]:
    """Return direct compliances whose slopes look like a curved mount or force law."""
    direct = _compliances_of_kind(bound, "direct")
    if len(direct) > 1 and all(f"{label}_1" in bound.names for label in direct):
        return direct
    return ()


def _like_lobes(bound: BoundModel, aliases: Sequence[Degeneracy]) -> tuple[str, ...]:
    """Return rotary compliances that only the levels of force separate from four-lobe form."""
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
    """Return parameters and shared nuisances of the model and of its edition."""
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
    """Return the terms of the model's edition as the package ships them."""
    edition = HybridModel.first()
    if bound.model.preset == "default":
        edition = HybridModel.default()
    return {type(term): term for term in edition.nuisances}


def _effects(bound: BoundModel, columns: Array) -> Array:
    """Return the change of readings per unit of each coefficient, shape (k, m) [mm].

    Each test has its own angles, at most ``_MOST_ANGLES`` of them.
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
