"""The null space of a design in the sense of what a readout can see, as a sparse basis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from ldbb_bayes.analysis.null_space import EXACTLY, NullSpace
from ldbb_bayes.inference.checks import in_order_of_force
from ldbb_bayes.model.fourier import basis, harmonic_index
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.terms import Columns, Term
from ldbb_bayes.results import Array, Result
from ldbb_bayes.units import ranked

__all__ = ["Degeneracy", "Standing", "StandingKind", "degeneracies", "standing_degeneracies"]


_ANGLES = 240
_NEGLIGIBLE = 0.02
_ROUNDING = 1e-9
_HIDDEN = 1e-3
_MICROMETRE = 1e-3


@dataclass(frozen=True, eq=False)
class Degeneracy:
    """A combination of coefficients that no reading of a campaign sees."""

    term: str  # class name of the nuisance it begins with; empty for parameters among themselves
    combination: Mapping[
        str, float
    ]  # changes that together change no reading; inside units (mm, N, rad), the nuisance first
    parameters: tuple[
        str, ...
    ]  # those of interest that do more than a fiftieth of what the nuisance does
    units: Mapping[str, str]  # of all parameters in it
    # whether the model has the nuisance: else nothing bounds it, and the intervals ignore it
    modelled: bool
    stated: (
        bool  # whether a certificate, or the model where its term was edited, says how large it is
    )
    prior_sds: float  # its length in units of the prior sd
    # of a reading, the largest; 0 below 1e-9 of what its largest member does alone, which is
    # rounding
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
    """What holds whatever is measured: parameters that such an effect looks like."""

    kind: StandingKind
    parameters: tuple[str, ...]


def degeneracies(bound: BoundModel) -> tuple[Degeneracy, ...]:
    """The sparse null space of a campaign's or plan's design, as far as it holds parameters of
    interest."""
    names, owners, values, sd = _coefficients(bound)
    modelled = {type(term).__name__: term for term in bound.model.nuisances}
    edited = {type(term) for term in bound.model.nuisances if _usual(bound).get(type(term)) != term}
    scaled = _effects(bound, values) * sd
    limit = 0.1 * bound.campaign.resolution_um * _MICROMETRE
    p = len(bound.names)
    found = []
    space = NullSpace(scaled, p, limit)
    for pivot, sparse in space.sparse():
        alone = np.where(np.arange(len(sparse)) < p, sparse, 0.0)
        good = min(limit * np.linalg.norm(alone), EXACTLY * (space.largest * np.abs(alone)).max())
        # Of parameters the vector without its nuisances, where it is as good so.
        vector = alone if pivot < p and np.abs(scaled @ alone).max() <= good else sparse
        effect = space.largest * np.abs(vector)
        moving = np.flatnonzero(effect > _ROUNDING * effect.max())
        own = [int(i) for i in moving if i < p]
        others = [pivot] if pivot >= p else list[int]()
        others += ranked(
            [int(i) for i in moving if i >= p and i != pivot], key=lambda i: float(effect[i])
        )
        main = tuple(names[i] for i in own if effect[i] > _NEGLIGIBLE * effect.max())
        if not main:
            continue
        term = owners[pivot]
        lead = pivot if pivot >= p else own[0]
        change = vector * sd
        amount = Term.owner(names[lead]).unit_of(names[lead]).one if term else change[lead]
        change *= amount / change[lead]
        together = np.abs(scaled @ (change / sd)).max()
        terms = {names[i]: modelled.get(owners[i]) for i in others}
        stated = [
            one and (type(one) in edited or one.is_stated(name, bound.campaign))
            for name, one in terms.items()
        ]
        moved = together > _ROUNDING * (space.largest * np.abs(change / sd)).max()
        found.append(
            Degeneracy(
                term,
                {names[i]: float(change[i]) for i in (*others, *own)},
                main,
                {names[i]: bound.parameters[i].unit for i in own},
                None not in terms.values(),
                all(stated),
                float(np.linalg.norm(change / sd)),
                float(moved * together / _MICROMETRE),
            )
        )
    return tuple(found)


def standing_degeneracies(bound: BoundModel, found: Sequence[Degeneracy]) -> tuple[Standing, ...]:
    """Return degeneracies with effects that are not terms of the model, and what force alone
    separates."""
    standing = (
        [Standing(StandingKind.FRICTION, hidden)] if (hidden := _like_friction(bound)) else []
    )
    direct = tuple(name.label for name in bound.compliances if name.kind == "direct")
    modelled = {type(term).__name__ for term in bound.model.nuisances}
    if "Drift" not in modelled and not bound.campaign.is_plan and in_order_of_force(bound):
        turning = [
            name.label
            for name in bound.compliances
            if name.kind == "rotation_for_force" and "Position" in modelled
        ]
        standing.append(Standing(StandingKind.DRIFT, (*direct, *turning)))
    if len(direct) > 1 and all(f"{label}_1" in bound.names for label in direct):
        standing.append(Standing(StandingKind.CURVATURE, direct))
    rotary = tuple(name.label for name in bound.compliances if name.kind == "rotation_for_moment")
    once = (
        not bound.setting.two_balls
        and len(set(bound.setting.radius_mm)) == 1
        and bound.campaign.force_levels > 1
    )
    names, _, values, _ = _coefficients(bound)
    of_fourth_order = ~np.any(np.delete(values, harmonic_index(4), axis=1), axis=(0, 1))
    four = any(of_fourth_order[names.index(name)] for d in found for name in d.nuisances)
    if rotary and once and not four and any(d.term == "BallForm" for d in found):
        standing.append(Standing(StandingKind.LOBES, rotary))
    return tuple(standing)


def _like_friction(bound: BoundModel) -> tuple[str, ...]:
    """Cross compliances whose pattern, turned with the direction of travel, is one of the
    parameters' own."""
    by_name = {test.name: test for test in bound.campaign.tests}
    sign = np.array(
        [-1.0 if by_name[name].direction == "CCW" else 1.0 for name in bound.test_names]
    )
    labels = [name.label for name in bound.compliances if name.kind == "cross"]
    cross = [j for j, name in enumerate(bound.names) if name in labels]
    columns = _effects(
        bound,
        np.concatenate([bound.interest, bound.interest[:, :, cross] * sign[:, None, None]], axis=2),
    )
    own = columns[:, : len(bound.names)] * bound.scale
    turned = columns[:, len(bound.names) :]
    rest = turned - own @ np.linalg.lstsq(own, turned, rcond=1e-10)[0]
    alike = np.abs(rest).max(axis=0) < _HIDDEN * np.abs(turned).max(axis=0)
    return tuple(bound.names[j] for j, like in zip(cross, alike, strict=True) if like)


def _coefficients(bound: BoundModel) -> tuple[list[str], list[str], Array, Array]:
    """Names, owners, columns (tests, 25, m) and prior sd (m,) of parameters and of every shared
    nuisance, modelled or not."""
    own = {type(term): term for term in bound.model.nuisances}
    usual = _usual(bound)
    names, owners = list(bound.names), [""] * len(bound.names)
    values = [bound.interest]
    sd = [bound.scale]
    for kind in Term.kinds.values():
        if kind not in own and kind not in usual:
            continue
        term = own.get(kind) or usual[kind]
        typical = bound.model.prior.hyper(term.scales, bound.campaign.resolution_um)
        scale = {"sigma": 0.0} | dict(zip(typical.names, typical.scale, strict=True))
        for part in term.columns(bound.setting):
            if not isinstance(part, Columns) or part.private:
                continue
            names += part.names
            owners += [kind.__name__] * len(part.names)
            values.append(part.values)
            sd.append(part.sd_at(scale))
    return names, owners, np.concatenate(values, axis=2), np.concatenate(sd)


def _usual(bound: BoundModel) -> dict[type[Term], Term]:
    """The terms of the model's edition."""
    edition = HybridModel.default() if bound.model.preset == "default" else HybridModel.first()
    return {type(term): term for term in edition.nuisances}


def _effects(bound: BoundModel, values: Array) -> Array:
    """Change of readings per unit of the coefficients at up to ``_ANGLES`` angles of each test,
    shape (k, m) [mm]."""
    rows = []
    by_name = {test.name: test for test in bound.campaign.tests}
    for r, name in enumerate(bound.test_names):
        angle = np.unique(np.round(np.remainder(by_name[name].angles_rad(), 2.0 * np.pi), 9))
        if len(angle) > _ANGLES:
            angle = angle[np.linspace(0, len(angle) - 1, _ANGLES).astype(int)]
        rows.append(basis(angle) @ values[r])
    return np.concatenate(rows)
