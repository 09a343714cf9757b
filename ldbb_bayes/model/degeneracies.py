"""What a campaign or plan cannot tell apart whatever the readings: the null space of its joint design, and what would end it.

Columns are all parameters of interest and all shared nuisances, modelled or not, without priors. A combination is degenerate
when one prior sd along it changes no reading by more than a tenth of the readout's resolution. The null space is brought to
a sparse form: one nuisance each, and the parameters that imitate it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.errors import InputError
from ldbb_bayes.model.basis import basis
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.hybrid import NUISANCES
from ldbb_bayes.model.terms import HYPERS, Columns
from ldbb_bayes.units import display_name, display_unit

__all__ = ["Degeneracy", "cures", "degeneracies", "sentences", "standing_degeneracies"]

Array = NDArray[Any]
_ANGLES = 240
_NEGLIGIBLE = 0.02
_CUTS = (_NEGLIGIBLE, 1e-3, 1e-5, 0.0)
_OF_ITSELF = 0.05
_STRICT = 0.5
_COMPANY = 3
_SMALL = 0.01
_FULL_DEG = 355.0
_MICROMETRE = 1e-3
_NATURAL: Mapping[str, tuple[float, str]] = {"ForceError": (0.01, "1 % of force gain")}
_CALIBRATIONS: Mapping[str, str] = {
    "BallForm": "a calibration of the balls' form",
    "BarLength": "a calibration of the bar's length",
    "Mount": "a measurement of the mount's deflection",
    "ForceError": "a calibration of the force",
}


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
            subject = _amount_words(self.term, self.nuisances[0], amount) + self._company()
            looks = _joined([_change_words(name, -change, self.units[name]) for name, change in changes.items()])
            verb, said = "looks exactly like", looks + self._difference({name: -change for name, change in changes.items()})
        else:
            subject = _joined([_change_words(name, change, self.units[name]) for name, change in changes.items()])
            verb, said = "together change" if len(changes) > 1 else "changes", "no reading"
        left_out = "" if self.modelled else "; the model leaves it out, and the intervals do not cover it"
        return f"{subject} {verb} {said}{left_out}."

    def _company(self) -> str:
        """The other nuisances in it."""
        lead, *others = self.nuisances
        if len(others) > _COMPANY:
            return f" in company with {len(others)} other nuisances"
        amounts = [
            f"{self.combination[name] / self.combination[lead]:.2g} times as much {_nuisance_words(name)}" for name in others
        ]
        return f" with {_joined(amounts)}" if amounts else ""

    def _difference(self, changes: Mapping[str, float]) -> str:
        """Of two that go opposite ways by as much: their difference."""
        if len(changes) != 2:
            return ""
        (first, a), (second, b) = changes.items()
        if self.units[first] != self.units[second] or not abs(a + b) < 1e-6 * abs(a):
            return ""
        factor, unit = display_unit(self.units[first])
        return f" ({_three(abs(a - b) * factor)} {unit} of {display_name(first)} − {display_name(second)})"


def degeneracies(bound: BoundModel) -> tuple[Degeneracy, ...]:
    """The sparse null space of a campaign's or plan's design, as far as it holds parameters of interest."""
    names, owners, values, sd = _coefficients(bound)
    modelled = {type(term).__name__ for term in bound.model.nuisances}
    scaled = _effects(bound, values) * sd
    limit = 0.1 * bound.campaign.resolution_um * _MICROMETRE
    p = len(bound.names)
    found = []
    for vector in _Design(scaled, p, limit).sparse():
        moving = np.flatnonzero(vector)
        own = [i for i in moving if i < p]
        effect = np.abs(scaled * vector).max(axis=0)
        main = tuple(names[i] for i in own if effect[i] > _NEGLIGIBLE * effect.max())
        if not main:
            continue
        others = [i for i in moving if i >= p]
        term = owners[others[0]] if others else ""
        change = vector * sd
        lead = others[0] if others else own[0]
        amount = _natural_amount(term, values[:, :, lead]) if others else change[lead]
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


def cures(bound: BoundModel, found: Sequence[Degeneracy]) -> tuple[str, ...]:
    """For each degeneracy what would end it: tests tried by adding them to the plan, and the calibration that supplies it."""
    tried = {
        words: degeneracies(replace_campaign(bound, tests)) for words, tests in _further_tests(bound.campaign.plan()).items()
    }
    said = []
    for degeneracy in found:
        helping = [words for words, left in tried.items() if not any(_same(degeneracy, other) for other in left)]
        if any(words in helping for words in ("clocking the work ball (0/45/90°)", "clocking the tool ball (0/45/90°)")):
            helping = [words for words in helping if not words.startswith("clocking both")]
        if degeneracy.term:
            helping.append(_CALIBRATIONS[degeneracy.term])
        text = _joined(helping, "or") if helping else "a narrower prior on one of them"
        said.append(text[0].upper() + text[1:] + ".")
    return tuple(said)


def replace_campaign(bound: BoundModel, tests: Sequence[CircularTest]) -> BoundModel:
    """The same model bound to a plan with further tests."""
    plan = bound.campaign.plan()
    named = [replace(test, name=f"further-{i}") for i, test in enumerate(tests)]
    return BoundModel(bound.model, replace(plan, tests=(*plan.tests, *named)))


def sentences(found: Sequence[Degeneracy]) -> tuple[str, ...]:
    """One sentence per term: what it looks like, and what supplies it."""
    by_term: dict[str, list[Degeneracy]] = {}
    for degeneracy in found:
        by_term.setdefault(degeneracy.term, []).append(degeneracy)
    said = []
    for term, members in by_term.items():
        if not term:
            for member in members:
                together = _joined([display_name(name) for name in member.parameters])
                alone = "changes no reading as far as its prior lets it"
                said.append(f"{together} {alone if len(member.parameters) == 1 else 'cannot be told apart by these readings'}.")
            continue
        alike: dict[tuple[str, ...], list[str]] = {}
        for member in members:
            alike.setdefault(member.parameters, []).append(_pattern(member.nuisances[0]))
        parts = [f"like {_joined([display_name(n) for n in names])}{', '.join(p)}" for names, p in alike.items()]
        left_out = "" if members[0].modelled else " The model leaves it out: the intervals do not cover it."
        said.append(
            f"{_term_words(term).capitalize()} looks exactly {'; '.join(parts)}: these readings cannot tell them apart."
            f"{left_out} {_CURES_IN_SHORT[term]}"
        )
    return tuple(said)


_CURES_IN_SHORT: Mapping[str, str] = {
    "BallForm": "Clock both balls (not by 180° alone), or measure a second radius.",
    "BarLength": "Calibrate the bar's length.",
    "Mount": "Measure the mount's deflection.",
    "ForceError": "Calibrate the force.",
}


def standing_degeneracies(bound: BoundModel, found: Sequence[Degeneracy]) -> tuple[str, ...]:
    """Degeneracies with effects that are not terms of the model, and what is told apart by force alone, in sentences."""
    said = []
    cross = [display_name(name.label) for name in bound.compliances if name.kind == "cross"]
    directions = {test.direction for test in bound.campaign.tests}
    if cross and not {"CW", "CCW"} <= directions:
        said.append(
            f"Friction in the bar or lost motion in proportion to force looks exactly like {_joined(cross)} "
            "in circles of one direction. Run both directions."
        )
    direct = [display_name(name.label) for name in bound.compliances if name.kind == "direct"]
    if bound.model.degree and len(direct) == 2:
        said.append(
            f"A curvature in force common to all angles (force law, mount) looks exactly like equal slopes of {_joined(direct)}."
        )
    rotary = [display_name(name.label) for name in bound.compliances if name.kind == "rotation_for_moment"]
    if rotary and any(d.term == "BallForm" for d in found) and bound.campaign.force_levels > 1:
        said.append(f"{rotary[0]} and the 4-lobe form of the balls are told apart by force alone.")
    return tuple(said)


def _coefficients(bound: BoundModel) -> tuple[list[str], list[str], Array, Array]:
    """Names, owners, columns (tests, 25, m) and prior sd (m,) of parameters and of every shared nuisance, modelled or not."""
    own = {type(term): term for term in bound.model.nuisances}
    everything = bound.model.prior.hyper(HYPERS, bound.campaign.resolution_um)
    scale = dict(zip(everything.names, everything.scale_mm, strict=True))
    names, owners = list(bound.names), [""] * len(bound.names)
    values, sd = [bound.interest], [bound.scale]
    for kind in NUISANCES.values():
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
        if len(angle) > _ANGLES:
            angle = angle[np.linspace(0, len(angle) - 1, _ANGLES).astype(int)]
        rows.append(basis(angle) @ values[r])
    return np.concatenate(rows)


class _Design:
    """Columns in units of the prior sd, the first p of them parameters of interest, and what is too small to be seen."""

    def __init__(self, scaled: Array, p: int, limit: float) -> None:
        self.scaled, self.p, self.limit = scaled, p, limit
        stacked: Any = scaled
        self._triangle = np.asarray(np.linalg.qr(stacked, mode="r"))

    def sparse(self) -> list[Array]:
        """A basis of the null space.

        First what parameters do among themselves, then every nuisance that the other parameters imitate by themselves, then
        what is left of the null space. Each vector has a pivot that the others lack.
        """
        own = np.arange(self.p)
        every = np.arange(self.scaled.shape[1])
        found = self._independent(own, own < self.p)
        own = np.setdiff1d(own, list(found))
        for j in every[self.p :]:
            vector = self._imitation(int(j), own)
            if vector is not None:
                found[int(j)] = vector
        left = np.setdiff1d(every, list(found))
        found |= self._independent(left, left >= self.p)
        return [found[j] for j in sorted(found, key=lambda j: (j < self.p, j))]

    def _independent(self, columns: NDArray[np.intp], preferred: NDArray[np.bool_]) -> dict[int, Array]:
        """A basis of the null space of some columns, by pivot."""
        pivots = columns[_pivots(self._null_space(columns), preferred)]
        others = np.setdiff1d(columns, pivots)
        vectors = {int(pivot): self._imitation(int(pivot), others) for pivot in pivots}
        return {pivot: vector for pivot, vector in vectors.items() if vector is not None}

    def _null_space(self, columns: NDArray[np.intp]) -> Array:
        """Orthonormal directions, shape (columns, k), along which one prior sd moves no reading by more than the limit."""
        _, singular, right = np.linalg.svd(self._triangle[:, columns])
        singular = np.append(singular, np.zeros(len(columns) - len(singular)))
        vectors = right[singular <= self.limit * np.sqrt(len(self.scaled))].T
        while vectors.shape[1] and np.abs(self.scaled[:, columns] @ vectors).max() > self.limit:
            vectors = vectors[:, 1:]
        return vectors

    def _imitation(self, target: int, others: NDArray[np.intp]) -> Array | None:
        """One of the target and the least of the others that undo it, or None when they cannot."""
        solved = self._undone(target, others)
        if np.abs(self.scaled @ solved).max() > self.limit * np.linalg.norm(solved):
            return None
        effect = np.abs(self.scaled * solved).max(axis=0)
        for cut in _CUTS:
            vector = self._undone(target, others[effect[others] > cut * effect.max()])
            if np.abs(self.scaled @ vector).max() <= _STRICT * self.limit:
                return vector
        return solved

    def _undone(self, target: int, others: NDArray[np.intp]) -> Array:
        """One of the target with the others by least squares."""
        vector = np.zeros(self.scaled.shape[1])
        vector[others] = -np.linalg.lstsq(self._triangle[:, others], self._triangle[:, target], rcond=1e-12)[0]
        vector[target] = 1.0
        return vector


def _pivots(null: Array, preferred: NDArray[np.bool_]) -> list[int]:
    """As many rows of the null space as it has dimensions, as independent as can be, preferred ones first."""
    pivots: list[int] = []
    rest = null.copy()
    while len(pivots) < null.shape[1]:
        length = np.linalg.norm(rest, axis=1)
        wanted = np.round(np.where(preferred, length, 0.0), 6)
        pivot = int(np.argmax(wanted if wanted.max(initial=0.0) > _OF_ITSELF else length))
        pivots.append(pivot)
        unit = rest[pivot] / length[pivot]
        rest = rest - np.outer(rest @ unit, unit)
    return pivots


def _natural_amount(term: str, values: Array) -> float:
    """One micrometre of the nuisance, or what is natural for it."""
    return _NATURAL[term][0] if term in _NATURAL else _MICROMETRE


def _same(one: Degeneracy, other: Degeneracy) -> bool:
    """Whether another plan still has it: the same term, in the same pattern, and a parameter in common."""
    if one.term != other.term or not set(one.parameters) & set(other.parameters):
        return False
    return not one.term or _order(one.nuisances[0]) == _order(other.nuisances[0])


def _further_tests(plan: Campaign) -> dict[str, list[CircularTest]]:
    """Tests one could add, by what is new about them."""
    first, last = min(plan.tests, key=_force), max(plan.tests, key=_force)
    radius = float(first.radius_mm or plan.radius_mm)

    def again(work: float, tool: float) -> list[CircularTest]:
        return [
            replace(test, work_ball_deg=test.work_ball_deg + work * turn, tool_ball_deg=test.tool_ball_deg + tool * turn)
            for test in plan.tests
            for turn in (45.0, 90.0)
            if work or tool or turn == 45.0
        ]

    new_force = _force(last) * 0.6 if plan.force_levels == 1 else 0.5 * (_force(first) + _force(last)) * 1.037
    further = {
        "another force level": [replace(first, force_N=new_force, pressure_bar=None)],
        "clocking the work ball (0/45/90°)": again(1.0, 0.0),
        "clocking the tool ball (0/45/90°)": again(0.0, 1.0),
        "clocking both balls (0/45/90°)": again(1.0, 1.0),
        "a second radius": [replace(test, radius_mm=round(radius * 2.0 / 3.0, 1)) for test in plan.tests],
    }
    if min(test.arc_deg for test in plan.tests) < _FULL_DEG:
        further["full circles"] = [replace(test, angle_deg=np.arange(120) * 3.0) for test in plan.tests]
    return further


def _force(test: CircularTest) -> float:
    if test.force_N is None:
        raise InputError(f"{test.label} must have a force here.")
    return float(test.force_N)


def _order(nuisance: str) -> str:
    """What kind of pattern a nuisance coefficient has, whichever ball it is of."""
    return re.sub(r"^(work_|tool_)|_(cos|sin)|_[\d.]+$", "", nuisance)


def _term_words(term: str) -> str:
    """BallForm → ball form."""
    return re.sub(r"(?<!^)(?=[A-Z])", " ", term).lower()


def _pattern(name: str) -> str:
    """form_cos2 →  in cos 2θ; empty where the term has a single column."""
    found = re.fullmatch(r"(work_|tool_)?form_(cos|sin)(\d+)", name)
    if not found:
        return ""
    ball = {"work_": " of the work ball", "tool_": " of the tool ball"}.get(found[1] or "", "")
    return f" in {found[2]} {found[3]}θ{ball}"


def _nuisance_words(name: str) -> str:
    found = re.fullmatch(r"(work_|tool_)?form_(cos|sin)(\d+)", name)
    if found:
        ball = {"work_": "the work ball's ", "tool_": "the tool ball's "}.get(found[1] or "", "")
        return f"{ball}{found[3]}-lobe form ({found[2]} {found[3]}θ)"
    length = re.fullmatch(r"bar_length(?:_([\d.]+))?", name)
    if length:
        return "bar length" + (f" at R = {length[1]} mm" if length[1] else "")
    return {"mount": "mount deflection", "force_gain": "force gain"}.get(name, name)


def _amount_words(term: str, name: str, amount: float) -> str:
    if term in _NATURAL:
        return _NATURAL[term][1]
    return f"{_three(amount / _MICROMETRE)} {'µm/bar' if term == 'Mount' else 'µm'} of {_nuisance_words(name)}"


def _change_words(name: str, change: float, unit: str) -> str:
    factor, label = display_unit(unit)
    value = abs(change) * factor
    if value < _SMALL and label.startswith("µ"):
        value, label = value * 1e3, "n" + label[1:]
    return f"{'+' if change > 0 else '−'}{_three(value)} {label} of {display_name(name)}"


def _three(value: float) -> str:
    """Three significant digits without an exponent."""
    if value == 0.0 or not np.isfinite(value):
        return f"{value:g}"
    decimals = max(2 - int(np.floor(np.log10(abs(float(f"{value:.2e}"))))), 0)
    return f"{value:.{decimals}f}" if decimals <= 6 else f"{value:.2e}"


def _joined(parts: Sequence[str], word: str = "and") -> str:
    return f" {word} ".join(parts) if len(parts) < 3 else f"{', '.join(parts[:-1])} {word} {parts[-1]}"
