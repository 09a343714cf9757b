"""Degeneracies: combinations of coefficients whose effects on the readings cancel.

Coefficients are the parameters of interest (compliances, their changes with force, and geometric
errors) and the nuisance coefficients, of effects that are modelled but not of interest. For
example, a change of some parameters may cancel the effect of a nuisance coefficient in every
reading. The readings then cannot tell the two effects apart. The degeneracies span the null space
of the design matrix. A sparse basis of this space is computed, so that each degeneracy involves few
coefficients. No readings are needed. A plan (a campaign without readings) can therefore be examined
too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ldbb_bayes.analysis.null_space import EXACT_SHARE, NullSpace
from ldbb_bayes.analysis.origins import is_size_stated, ready_made_terms, term_named
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms import Columns, Term
from ldbb_bayes.results import Array
from ldbb_bayes.units import ranked

__all__ = ["Degeneracy", "degeneracies"]

# Largest number of angles per test at which the effects of the model's coefficients on the readings
# are computed. This number suffices, because no effect has more than 12 waves per turn.
_MOST_ANGLES = 240
# Two angles of readings [rad] count as equal if they are equal after rounding to this number of
# decimals.
_ANGLE_DECIMALS = 9
# A degeneracy is a combination of coefficients that the readings cannot distinguish. Its
# description names a parameter only if the parameter's effect on the readings, divided by the
# largest effect of a coefficient in the combination, is greater than this number.
_NAMED_SHARE = 0.02
# The effect of a coefficient on the readings counts as a rounding error if it is below this
# fraction of the largest effect of any coefficient in the combination. The joint effect of all
# coefficients of the combination counts as a rounding error if it is below the same limit.
_ROUNDING = 1e-9
# A change of a reading counts as too small to be seen if it is below this fraction of the
# resolution of the readings.
_VISIBLE_SHARE = 0.1
# One micrometre in millimetres.
_MICROMETRE = 1e-3


@dataclass(frozen=True, eq=False)
class Degeneracy:
    """A combination of parameters and nuisance coefficients whose effects on the readings cancel.

    The model may have been made from a preset (a ready-made model) by leaving out some effects. The
    combination can contain coefficients of these effects too.
    """

    #: class name of the model term that the pivot belongs to; an empty string if the pivot is a
    #: parameter. The pivot is one coefficient of the degeneracy; the other coefficients together
    #: cancel its effect on the readings.
    term: str
    #: change of each coefficient of the degeneracy, in a unit composed of mm, N and rad; the keys
    #: are the names of the coefficients. Together, these changes have no effect on any reading.
    #: Nuisance coefficients come before parameters.
    combination: Mapping[str, float]
    #: parameters of interest that contribute notably to the degeneracy: the effect of each on the
    #: readings is more than 2 % of the largest effect of any coefficient in ``combination``
    parameters: tuple[str, ...]
    #: unit of each parameter in ``combination``, composed of mm, N and rad; the keys are the names
    #: of the parameters
    units: Mapping[str, str]
    #: whether the model has a term for every nuisance coefficient in ``combination``. If a term is
    #: missing, its effect is not included in the credible intervals of the parameters.
    modelled: bool
    #: whether the standard uncertainty of every nuisance coefficient in ``combination`` is stated
    #: by a certificate or by the user; false if one of them is only assumed
    stated: bool
    #: size of the degeneracy: root sum of squares of the changes of its coefficients, where each
    #: change is divided by the prior standard deviation of the coefficient
    prior_sds: float
    #: largest change of a reading that the coefficients of the degeneracy cause together [µm]; 0 if
    #: this change is a rounding error (below 1e-9 of the largest change that one of the
    #: coefficients alone causes)
    change_um: float

    @property
    def nuisances(self) -> tuple[str, ...]:
        """Names of the nuisance coefficients in the degeneracy."""
        return tuple(name for name in self.combination if name not in self.units)


@dataclass(frozen=True)
class _Coefficients:
    """The m coefficients that act in several tests: parameters and nuisance coefficients.

    If the model was made from a preset (a ready-made model) by leaving out effects, these effects
    are included here. ``owners`` are the class names of the model terms that the coefficients
    belong to; for a parameter, the name is empty. ``prior_sd``, shape (m,), are the prior standard
    deviations of the coefficients. The radial deviation of each test is described by 25 Fourier
    coefficients. ``columns``, shape (tests, 25, m), holds the changes of these 25 Fourier
    coefficients per unit of each of the m coefficients.
    """

    names: tuple[str, ...]
    owners: tuple[str, ...]
    columns: Array
    prior_sd: Array


def degeneracies(bound: BoundModel) -> tuple[Degeneracy, ...]:
    """Return a sparse basis of the degeneracies that involve parameters of interest.

    One coefficient of each degeneracy is called its pivot: the other coefficients together cancel
    the effect of the pivot on the readings.

    Parameters
    ----------
    bound
        Model applied to a campaign or plan.

    Returns
    -------
    tuple of Degeneracy
        The degeneracies, first those whose pivot is a nuisance coefficient, then those whose pivot
        is a parameter.
    """
    coefficients = _all_coefficients(bound)
    scaled = _reading_changes(bound, coefficients.columns) * coefficients.prior_sd
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
    """Return a degeneracy without nuisance coefficients if the effects of its parameters cancel.

    ``vector``, shape (m,), holds the values of the m coefficients in units of their prior standard
    deviations. The function sets the nuisance coefficients to zero. If the effects of the
    parameters still cancel, the parameters alone are returned. If not, ``vector`` is returned
    unchanged. ``space`` is the null space of the campaign's design matrix.
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
    """Return the `Degeneracy` that describes a combination of coefficients whose effects cancel.

    ``vector``, shape (m,), holds the m coefficients in units of their prior standard deviations.
    One of them has the value one; ``pivot`` is its index. The other coefficients together cancel
    the effect of this coefficient on the readings. ``coefficients`` are all coefficients, and
    ``space`` is the null space that the combination belongs to.

    In the result, the coefficients are in their own units, which are composed of mm, N and rad. If
    the coefficient ``pivot`` is a nuisance coefficient, all coefficients are multiplied by the same
    factor, so that this one equals one display unit, such as 1 µm. ``change_um`` is then the
    largest change of any reading that these coefficients cause together. Return None if the effect
    of every parameter on the readings is at most 2 % of the largest effect of any coefficient in
    the combination.
    """
    names = coefficients.names
    effect = space.largest * np.abs(vector)
    # Indices of the coefficients in the degeneracy: those whose effects on the readings are not
    # mere rounding errors. Parameters of interest come before nuisance coefficients.
    members = np.flatnonzero(effect > _ROUNDING * effect.max()).tolist()
    parameters = [i for i in members if i < space.parameters]
    named = tuple(names[i] for i in parameters if effect[i] > _NAMED_SHARE * effect.max())
    if not named:
        return None
    other_nuisances = [i for i in members if i >= space.parameters and i != pivot]
    nuisances = _sort_by_effect(other_nuisances, effect)
    if pivot >= space.parameters:
        nuisances.insert(0, pivot)
    change = _in_internal_units(coefficients, pivot, vector)
    prior_sds = change / coefficients.prior_sd
    terms = [term_named(bound, coefficients.owners[i]) for i in nuisances]
    stated = [
        is_size_stated(bound, names[i], term) for i, term in zip(nuisances, terms, strict=True)
    ]
    return Degeneracy(
        term=coefficients.owners[pivot],
        combination={names[i]: float(change[i]) for i in (*nuisances, *parameters)},
        parameters=named,
        units={names[i]: bound.parameters[i].unit for i in parameters},
        modelled=None not in terms,
        stated=all(stated),
        prior_sds=float(np.linalg.norm(prior_sds)),
        change_um=_largest_change_um(space, prior_sds),
    )


def _sort_by_effect(indices: Sequence[int], effect: Array) -> list[int]:
    """Return indices of model coefficients, sorted by effect on the readings, largest first.

    ``indices`` are the indices to sort. ``effect`` holds, for every coefficient, its largest effect
    on any reading.
    """
    effect_by_index = {i: float(effect[i]) for i in indices}
    return ranked(effect_by_index, effect_by_index.__getitem__)


def _in_internal_units(coefficients: _Coefficients, pivot: int, vector: Array) -> Array:
    """Return a combination of coefficients, converted to units composed of mm, N and rad.

    ``vector``, shape (m,), holds the m coefficients in units of their prior standard deviations.
    ``pivot`` is the index of one coefficient. If it is a nuisance coefficient, the combination is
    scaled so that this coefficient equals one display unit, for example 1 µm, which is returned as
    0.001 mm.
    """
    change = np.asarray(vector * coefficients.prior_sd)
    if coefficients.owners[pivot]:
        name = coefficients.names[pivot]
        amount = Term.owner(name).unit_of(name).one
        change *= amount / change[pivot]
    return change


def _largest_change_um(space: NullSpace, prior_sds: Array) -> float:
    """Return the largest change of a reading that a combination of coefficients causes [µm].

    Return zero if this change is a rounding error. ``prior_sds`` are the changes of the
    coefficients in units of their prior standard deviations; ``space`` is the null space that the
    combination belongs to.
    """
    change = np.abs(space.scaled @ prior_sds).max()
    largest_alone = (space.largest * np.abs(prior_sds)).max()
    if change <= _ROUNDING * largest_alone:
        return 0.0
    return float(change / _MICROMETRE)


def _all_coefficients(bound: BoundModel) -> _Coefficients:
    """Return the coefficients that act in several tests: parameters and nuisance coefficients.

    A model may leave out some terms of the preset (ready-made model) that it is made from. The
    result contains the nuisance coefficients of all terms of the preset, including those that are
    left out.
    """
    modelled = {type(term): term for term in bound.model.nuisances}
    terms = {**ready_made_terms(bound), **modelled}
    names = list(bound.names)
    owners = [""] * len(bound.names)
    columns = [bound.interest_columns]
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


def _reading_changes(bound: BoundModel, columns: Array) -> Array:
    """Return by how much k readings change per unit of each of m coefficients, shape (k, m) [mm].

    The radial deviation of a test is described by 25 Fourier coefficients. ``columns``, shape
    (tests, 25, m), states by how much these change per unit of each of the m coefficients. The k
    readings are taken at the angles of the tests, at most ``_MOST_ANGLES`` for each test.
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
