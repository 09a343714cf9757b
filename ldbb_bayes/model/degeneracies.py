"""What a campaign or plan cannot tell apart whatever the readings: the null space of its joint design, and what would end it.

Columns are all parameters of interest and all shared nuisances, modelled or not, without priors. A combination is degenerate
when one prior sd along it changes no reading by more than a tenth of the readout's resolution, and by no more than a twentieth
of what the nuisance it begins with does, or, of parameters among themselves, the one that does most. The null space is brought
to a sparse form: one nuisance each, and the parameters that imitate it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.basis import basis
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.columns import HYPERS, Columns
from ldbb_bayes.model.hybrid import NUISANCES
from ldbb_bayes.model.nullspace import EXACTLY, NullSpace
from ldbb_bayes.model.terms import Drift
from ldbb_bayes.model.wording import (
    amount_words,
    change_words,
    company_words,
    joined,
    natural_amount,
    pattern,
    term_words,
    three,
)
from ldbb_bayes.units import display_name, display_unit

__all__ = ["Degeneracy", "degeneracies", "sentences", "standing_degeneracies"]

Array = NDArray[Any]
_ANGLES = 240
_NEGLIGIBLE = 0.02
_COMPANY = 3
_HIDDEN = 1e-3
_MICROMETRE = 1e-3


@dataclass(frozen=True, eq=False)
class Degeneracy:
    """A combination of coefficients that no reading of a campaign sees.

    Attributes
    ----------
    term : str
        Class name of the nuisance it begins with; empty for parameters among themselves.
    combination : mapping of name to change
        Added together they change no reading; inside units (mm, N, rad), the nuisance first.
    parameters : tuple of str
        Parameters of interest in it that do more than a fiftieth of what the nuisance does.
    units : mapping of name to unit
        Of all parameters in it.
    modelled : bool
        False when the model leaves the nuisance out: then nothing bounds it, and the intervals ignore it.
    prior_sds : float
        Its length in units of the prior sd.
    change_um : float
        Largest change of a reading by it [µm].
    """

    term: str
    combination: Mapping[str, float]
    parameters: tuple[str, ...]
    units: Mapping[str, str]
    modelled: bool
    prior_sds: float
    change_um: float

    @property
    def nuisances(self) -> tuple[str, ...]:
        """Nuisance coefficients in it."""
        return tuple(name for name in self.combination if name not in self.units)

    @property
    def statement(self) -> str:
        """In words, with the exchange rate: what looks like what, and how much of it."""
        changes = {name: self.combination[name] for name in self.parameters}
        if self.term:
            amount = self.combination[self.nuisances[0]]
            subject = amount_words(self.term, self.nuisances[0], amount) + self._company()
            looks = joined([change_words(name, -change, self.units[name]) for name, change in changes.items()])
            verb, said = "looks exactly like", looks + self._difference({name: -change for name, change in changes.items()})
        else:
            subject = joined([change_words(name, change, self.units[name]) for name, change in changes.items()])
            subject += f" in company with {len(self.nuisances)} nuisances" if self.nuisances else ""
            verb, said = "together change", "no reading"
        left_out = "" if self.modelled else "; the model leaves it out, and the intervals do not cover it"
        return f"{subject} {verb} {said}{left_out}."

    def _company(self) -> str:
        """The other nuisances in it."""
        lead, *others = self.nuisances
        if len(others) > _COMPANY:
            return f" in company with {len(others)} other nuisances"
        amounts = [company_words(lead, self.combination[lead], name, self.combination[name]) for name in others]
        return f" with {joined(amounts)}" if amounts else ""

    def _difference(self, changes: Mapping[str, float]) -> str:
        """Of two that go opposite ways by as much: their difference."""
        if len(changes) != 2:
            return ""
        (first, a), (second, b) = changes.items()
        if self.units[first] != self.units[second] or not abs(a + b) < 1e-6 * abs(a):
            return ""
        factor, unit = display_unit(self.units[first])
        return f" ({three(abs(a - b) * factor)} {unit} of {display_name(first)} − {display_name(second)})"


def degeneracies(bound: BoundModel) -> tuple[Degeneracy, ...]:
    """The sparse null space of a campaign's or plan's design, as far as it holds parameters of interest."""
    names, owners, values, sd = _coefficients(bound)
    modelled = {type(term).__name__ for term in bound.model.nuisances}
    scaled = _effects(bound, values) * sd
    limit = 0.1 * bound.campaign.resolution_um * _MICROMETRE
    p = len(bound.names)
    found = []
    for pivot, sparse in NullSpace(scaled, p, limit).sparse():
        vector = sparse if pivot >= p else _of_parameters_alone(scaled, sparse, p, limit)
        effect = np.abs(scaled * vector).max(axis=0)
        moving = np.flatnonzero(vector)
        own = [i for i in moving if i < p]
        others = sorted((i for i in moving if i >= p), key=lambda i: (i != pivot, -effect[i]))
        main = tuple(names[i] for i in own if effect[i] > _NEGLIGIBLE * effect.max())
        if not main:
            continue
        term = owners[pivot]
        lead = pivot if pivot >= p else own[0]
        change = vector * sd
        amount = natural_amount(term, names[lead]) if term else change[lead]
        change *= amount / change[lead]
        found.append(
            Degeneracy(
                term,
                {names[i]: float(change[i]) for i in (*others, *own)},
                main,
                {names[i]: bound.parameters[i].unit for i in own},
                all(owners[i] in modelled for i in others),
                float(np.linalg.norm(change / sd)),
                float(np.abs(scaled @ (change / sd)).max() / _MICROMETRE),
            )
        )
    return tuple(found)


def _of_parameters_alone(scaled: Array, vector: Array, p: int, limit: float) -> Array:
    """The vector without its nuisances, where it is as good so."""
    alone = np.where(np.arange(len(vector)) < p, vector, 0.0)
    change = np.abs(scaled @ alone).max()
    good = change <= min(limit * np.linalg.norm(alone), EXACTLY * np.abs(scaled * alone).max())
    return alone if good else vector


def sentences(found: Sequence[Degeneracy]) -> tuple[str, ...]:
    """One sentence per term: what it looks like, and what supplies it."""
    by_term: dict[str, list[Degeneracy]] = {}
    for degeneracy in found:
        by_term.setdefault(degeneracy.term, []).append(degeneracy)
    said = []
    for term, members in by_term.items():
        if not term:
            for member in members:
                together = joined([display_name(name) for name in member.parameters])
                said.append(f"{together} cannot be told apart by these readings.")
            continue
        alike: dict[tuple[str, ...], list[str]] = {}
        for member in members:
            alike.setdefault(member.parameters, []).append(pattern(member.nuisances[0]))
        parts = [f"like {joined([display_name(n) for n in names])}{', '.join(p)}" for names, p in alike.items()]
        left_out = "" if members[0].modelled else " The model leaves it out: the intervals do not cover it."
        said.append(
            f"{term_words(term).capitalize()} looks exactly {'; '.join(parts)}: these readings cannot tell them apart."
            f"{left_out} {_CURES_IN_SHORT[term]}"
        )
    return tuple(said)


_CURES_IN_SHORT: Mapping[str, str] = {
    "BallForm": "Clock both balls (not by 180° alone), or measure a second radius.",
    "BarLength": "Calibrate the bar's length.",
    "Mount": "Measure the mount's deflection.",
    "ForceError": "Calibrate the force.",
    "Hysteresis": "Run both directions at the same forces.",
    "Drift": "Run the forces in an order that has nothing to do with time.",
}


def standing_degeneracies(bound: BoundModel, found: Sequence[Degeneracy]) -> tuple[str, ...]:
    """Degeneracies with effects that are not terms of the model, and what is told apart by force alone, in sentences."""
    said = []
    hidden = [display_name(name) for name in _like_friction(bound)]
    if hidden:
        said.append(
            f"Friction in the bar or lost motion in proportion to force looks exactly like {joined(hidden)} "
            "in these directions. Run both directions at the same forces."
        )
    direct = [name.label for name in bound.compliances if name.kind == "direct"]
    sloped = [display_name(label) for label in direct if f"{label}_1" in bound.names]
    if len(sloped) == len(direct) > 1:
        said.append(
            f"A curvature in force common to all angles (force law, mount) looks exactly like equal slopes of {joined(sloped)}."
        )
    rotary = [display_name(name.label) for name in bound.compliances if name.kind == "rotation_for_moment"]
    once = not bound.setting.two_balls and len(set(bound.setting.radius_mm)) == 1 and bound.campaign.force_levels > 1
    four = any(name.endswith(("cos4", "sin4")) for d in found for name in d.nuisances)
    if rotary and once and not four and any(d.term == "BallForm" for d in found):
        said.append(f"{joined(rotary)} and the 4-lobe form of the balls are told apart by force alone.")
    for covariate, values in (("time", bound.setting.time_h), ("temperature", bound.setting.temperature_K)):
        if np.isfinite(values).all() and np.ptp(values) > 0.0 and not any(isinstance(t, Drift) for t in bound.model.nuisances):
            said.append(
                f"The tests record {covariate}, the model has no drift over it: what changes steadily counts as set-up shift, "
                f"and as compliance where the forces were run in order. Ask for it (--drift {covariate})."
            )
    return tuple(said)


def _like_friction(bound: BoundModel) -> tuple[str, ...]:
    """Cross compliances whose pattern, turned with the direction of travel, is one of the parameters' own."""
    by_name = {test.name: test for test in bound.campaign.tests}
    sign = np.array([-1.0 if by_name[name].direction == "CCW" else 1.0 for name in bound.test_names])
    labels = [name.label for name in bound.compliances if name.kind == "cross"]
    cross = [j for j, name in enumerate(bound.names) if name in labels]
    columns = _effects(bound, np.concatenate([bound.interest, bound.interest[:, :, cross] * sign[:, None, None]], axis=2))
    own, turned = columns[:, : len(bound.names)] * bound.scale, columns[:, len(bound.names) :]
    rest = turned - own @ np.linalg.lstsq(own, turned, rcond=1e-10)[0]
    alike = np.abs(rest).max(axis=0) < _HIDDEN * np.abs(turned).max(axis=0)
    return tuple(bound.names[j] for j, like in zip(cross, alike, strict=True) if like)


def _coefficients(bound: BoundModel) -> tuple[list[str], list[str], Array, Array]:
    """Names, owners, columns (tests, 25, m) and prior sd (m,) of parameters and of every shared nuisance, modelled or not."""
    own = {type(term): term for term in bound.model.nuisances}
    everything = bound.model.prior.hyper(HYPERS, bound.campaign.resolution_um)
    scale = dict(zip(everything.names, everything.scale_mm, strict=True))
    names, owners = list(bound.names), [""] * len(bound.names)
    values, sd = [bound.interest], [bound.scale]
    for kind in NUISANCES.values():
        if kind is Drift and kind not in own:
            continue
        for part in own.get(kind, kind()).columns(bound.setting):
            if not isinstance(part, Columns) or part.private:
                continue
            names += part.names
            owners += [kind.__name__] * len(part.names)
            values.append(part.values)
            sd.append(part.sd * (scale[part.hyper] if part.hyper else 1.0))
    return names, owners, np.concatenate(values, axis=2), np.concatenate(sd)


def _effects(bound: BoundModel, values: Array) -> Array:
    """Change of readings per unit of the coefficients at up to ``_ANGLES`` angles of each test, shape (k, m) [mm]."""
    rows = []
    by_name = {test.name: test for test in bound.campaign.tests}
    for r, name in enumerate(bound.test_names):
        angle = by_name[name].angles_rad()
        angle = np.unique(np.round(np.remainder(angle, 2.0 * np.pi), 9))
        if len(angle) > _ANGLES:
            angle = angle[np.linspace(0, len(angle) - 1, _ANGLES).astype(int)]
        rows.append(basis(angle) @ values[r])
    return np.concatenate(rows)
