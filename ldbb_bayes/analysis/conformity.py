"""Conformity with tolerances: p = P(lower ≤ η ≤ upper | y) of JCGM 106, and decisions after ISO
14253-1; may the numbers be used?

A machine conforms where p is at least the confidence, for a normal posterior where the estimate
lies inside each limit by the guard band; it does not conform where 1 − p is; in between nothing is
decided.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtr, ndtri

from ldbb_bayes.analysis.circularity import path_draws
from ldbb_bayes.analysis.verdicts import ParameterIdentifiability, Verdict
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import check_known, require
from ldbb_bayes.inference.fit import ConcernKind, Fit, State
from ldbb_bayes.inference.posterior import bound_of, curves_of, draws_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, ByName, Result, Shown
from ldbb_bayes.units import inside_name, is_direct, to_inside

if TYPE_CHECKING:
    import xarray as xr

    from ldbb_bayes.analysis.comparison import Comparison

__all__ = [
    "Conformity",
    "Decision",
    "Judgement",
    "Quantity",
    "Reason",
    "ReasonKind",
    "Tolerance",
    "Use",
    "check_force",
    "conformity",
    "draws_at",
    "is_determined",
    "normal_conformity",
    "quantities",
    "quantities_of",
    "state_of",
    "tolerances_in",
]

_PATHS = {"G": ("upper",), "F_max": ("upper",), "F_min": ("lower",)}
_POSITIVE = re.compile(r"C_(.)\1.")  # deflection and tilt under their own force and moment
_NEVER_NEGATIVE = re.compile(_POSITIVE.pattern + r"|stiffness_.|G(_..)?")
_FEW = 10
_TRACES = 2000
_LEAST = 0.1
_MOST = 1.5  # of the tested forces, where C(F) may be stated
_HARDLY = 0.9


class Decision(StrEnum):
    """What follows from a tolerance at the confidence asked for."""

    CONFORMS = "conforms"
    DOES_NOT_CONFORM = "does not conform"
    NOT_DECIDED = "not decided"


@dataclass(frozen=True)
class Tolerance(Shown):
    """What a quantity may be, limits included, in inside units (mm, N, rad); None: no limit on that
    side."""

    lower: float | None = None  #: limit
    upper: float | None = None  #: limit

    def __post_init__(self) -> None:
        low, high = self.ends
        require(
            low < high,
            f"a tolerance must have a lower limit below its upper one, got {low:g} and {high:g}."
            " Correct it.",
        )
        require(
            np.isfinite([low, high]).any(),
            "a tolerance must have a limit, got none. Write for example 60 nm/N.",
        )

    @property
    def ends(self) -> tuple[float, float]:
        """Both limits, infinite where there is none."""
        return (
            -np.inf if self.lower is None else self.lower,
            np.inf if self.upper is None else self.upper,
        )


@dataclass(frozen=True)
class Conformity(Result):
    """A quantity and its tolerance, in inside units."""

    unit: str  #: of all that follow
    force_N: float | None  #: at which it is stated; None of geometric errors and slopes
    lower: float | None  #: limit
    upper: float | None  #: limit
    mean: float  #: estimate
    sd: float  #: its standard uncertainty
    probability: float  #: of conformance
    #: how far the estimate must lie inside a limit so that the machine conforms; as far outside, it
    #: does not
    guard_band: float
    confidence: float  #: at which it is decided
    decision: Decision  #: by ISO 14253-1

    @property
    def limits(self) -> tuple[float, float]:
        """Both limits, infinite where there is none."""
        return Tolerance(self.lower, self.upper).ends


@dataclass(frozen=True)
class Quantity:
    """What may have a tolerance: its unit, and the sides that a single number limits."""

    unit: str
    sides: tuple[str, ...]


def quantities(units: Mapping[str, str], planes: Collection[str] = ()) -> dict[str, Quantity]:
    """What may have a tolerance, by name: parameters with these units, stiffnesses, and the
    machine's path in these planes."""
    found = {
        key: Quantity(unit, ("upper",) if _POSITIVE.fullmatch(key) else ("lower", "upper"))
        for key, unit in units.items()
    }
    found |= {
        f"stiffness_{name[2]}": Quantity("N/mm", ("lower",)) for name in units if is_direct(name)
    }
    ends = [f"_{plane}" for plane in planes] if len(planes) > 1 else [""] * len(planes)
    return found | {
        name + end: Quantity("mm", sides) for name, sides in _PATHS.items() for end in ends
    }


def quantities_of(bound: BoundModel) -> dict[str, Quantity]:
    """The same of a bound model."""
    return quantities({own.name: own.unit for own in bound.parameters}, bound.setting.planes)


def tolerances_in(
    known: Mapping[str, Quantity], given: Mapping[str, str | Tolerance]
) -> dict[str, Tolerance]:
    """Tolerances by name: texts with a unit read, names and limits checked. ``60 nm/N`` is an upper
    limit of what cannot be negative, of a stiffness a lower one (``18 N/µm``), of anything else ±;
    ``−20..40 µrad`` is both, and ``≤``, ``≥`` or ``±`` before a number say which."""
    read = {}
    for name, tolerance in ((inside_name(name), own) for name, own in given.items()):
        check_known("tolerance", [name], known)
        read[name] = own = (
            tolerance if isinstance(tolerance, Tolerance) else _read(name, tolerance, known[name])
        )
        limit = own.lower if own.upper is None else own.upper
        said = (
            f"tolerance of {name} must have a limit above 0, for {name} cannot be negative, got"
            f" {tolerance}. Leave the sign out."
        )
        require(limit is None or limit > 0.0 or not _NEVER_NEGATIVE.fullmatch(name), said)
    return read


def check_force(campaign: Campaign, force_N: float | None) -> None:
    """Refuse a force far from those tested, at which nothing can be stated; None passes."""
    least, most = (float(end) for end in (campaign.forces_N.min(), campaign.forces_N.max()))
    got = f"{campaign.name!r} was tested from {least:g} to {most:g} N, got {force_N}"
    cure = "Choose one within what was tested, or test at that force"
    said = (
        f"force_N (--force-N) must be a force from {_LEAST * least:g} to {_MOST * most:g} N, for"
        f" {got}. {cure}."
    )
    require(force_N is None or (force_N > 0.0 and _LEAST * least <= force_N <= _MOST * most), said)


def _read(name: str, text: str, quantity: Quantity) -> Tolerance:
    what = f"tolerance of {name}"
    least, between, most = text.partition("..")
    if between:
        unit = re.sub(r"^\s*[+−-]?[\d.]+(e[+-]?\d+)?", "", most, flags=re.IGNORECASE)
        least = (
            least if re.search(r"[^\W\d]|[%°]", re.sub(r"\de[+-]?\d", "", least)) else least + unit
        )
        low, high = (to_inside(end, quantity.unit, what) for end in (least, most))
        require(
            low < high,
            f"{what} must have its lower limit first, got {text!r}. Write for example −20..40"
            " µrad.",
        )
        return Tolerance(low, high)
    sign = re.match(r"\s*(±|≤|<=|≥|>=)?", text)
    told = {
        "±": ("lower", "upper"),
        "≤": ("upper",),
        "<=": ("upper",),
        "≥": ("lower",),
        ">=": ("lower",),
    }
    sides = told.get(sign[1] if sign and sign[1] else "", quantity.sides)
    value = to_inside(text[sign.end() if sign else 0 :], quantity.unit, what)
    if len(sides) == 2:
        return Tolerance(-abs(value), abs(value))
    return Tolerance(**{sides[0]: value})


@one_blas_thread
def conformity(
    posterior: xr.DataTree,
    tolerances: Mapping[str, str | Tolerance] | None = None,
    *,
    force_N: float | None = None,
    confidence: float = 0.95,
) -> dict[str, Conformity]:
    """Decide whether a machine conforms.

    InputError for an unknown name, a number without its unit or with one of another kind, or limits
    the wrong way round.

    Parameters
    ----------
    posterior : from `average`, `sample` or `load`.
    tolerances : mapping of name to str or Tolerance, optional
        Default: those of the campaign. Names are parameters, ``stiffness_X`` (1/C_XXX), and G,
        F_max and F_min of the machine's path, with the plane where there are several (``G_YZ``).
    force_N : at which compliances, stiffnesses and the path are stated, from a tenth of the least
        force tested to 1.5 times the largest; default: the model's reference force, where C(F) is
        C.
    confidence : probability that a decision asks for.
    """
    require(
        0.5 < confidence < 1.0,
        f"confidence must lie between 0.5 and 1, got {confidence}. For 95 % give 0.95.",
    )
    bound = bound_of(posterior)
    known = quantities_of(bound)
    read = tolerances_in(known, bound.campaign.tolerances if tolerances is None else tolerances)
    force = bound.setting.reference_force_N if force_N is None else float(force_N)
    check_force(bound.campaign, force_N)
    if not read:
        return ByName()
    draws = dict(_draws(posterior, bound, read, force))
    return ByName(
        {
            name: _decided(known[name].unit, own, read[name], confidence, at)
            for name, (own, at) in draws.items()
        }
    )


def draws_at(posterior: xr.DataTree, force_N: float) -> dict[str, Array]:
    """Return the draws of every parameter, of compliances at a force [inside units]."""
    bound = bound_of(posterior)
    values = dict(zip(bound.names, draws_of(posterior, bound)[0].T, strict=True))
    if force_N == bound.setting.reference_force_N:
        return values
    curves = curves_of(posterior, np.array([force_N]))[:, 0]
    return values | {own.label: curves[:, j] for j, own in enumerate(bound.compliances)}


def _draws(
    posterior: xr.DataTree, bound: BoundModel, names: Collection[str], force: float
) -> Iterable[tuple[str, tuple[Array, float | None]]]:
    """Draws of what is named, and the force at which it is stated."""
    parameters = dict(zip(bound.names, bound.parameters, strict=True))
    values = draws_at(posterior, force)
    along = {f"stiffness_{name[2]}": name for name in bound.names if is_direct(name)}
    paths: dict[str, Array] = {}
    if any(name.startswith(tuple(_PATHS)) for name in names):
        several = len(bound.setting.planes) > 1
        for where, found in path_draws(posterior, [force], _TRACES):
            paths |= {
                f"{name}_{where['plane']}" if several else name: found[name] * 1e-3
                for name in _PATHS
            }
    for name in names:
        if name in parameters:
            yield name, (values[name], force if parameters[name].group == "compliance" else None)
        else:
            yield name, (1.0 / values[along[name]] if name in along else paths[name], force)


def _decided(
    unit: str, draws: Array, tolerance: Tolerance, confidence: float, force: float | None
) -> Conformity:
    mean = float(draws.mean())
    sd = float(draws.std(ddof=1))
    low, high = tolerance.ends
    below = _tail(draws < low, (low - mean) / max(sd, 1e-300))
    above = _tail(draws > high, (mean - high) / max(sd, 1e-300))
    return _conformity(
        unit, mean, sd, tolerance, min(max(1.0 - below - above, 0.0), 1.0), confidence, force
    )


def _tail(outside: Array, score: float) -> float:
    """Probability beyond a limit: the share of draws; where few are on either side, the normal
    tail, as far as they allow."""
    n = len(outside)
    count = int(outside.sum())
    if min(count, n - count) >= _FEW:
        return count / n
    tail = float(ndtr(score))
    least = _FEW / n
    return min(tail, least) if count < _FEW else max(tail, 1.0 - least)


def normal_conformity(
    unit: str, mean: float, sd: float, tolerance: Tolerance, *, confidence: float = 0.95
) -> Conformity:
    """The same of a normal distribution."""
    low, high = tolerance.ends
    probability = float(ndtr((high - mean) / sd) - ndtr((low - mean) / sd))
    return _conformity(unit, mean, sd, tolerance, probability, confidence, None)


def _conformity(
    unit: str,
    mean: float,
    sd: float,
    tolerance: Tolerance,
    probability: float,
    confidence: float,
    force: float | None,
) -> Conformity:
    decided = Decision.CONFORMS if probability >= confidence else Decision.NOT_DECIDED
    decision = Decision.DOES_NOT_CONFORM if probability <= 1.0 - confidence else decided
    band = float(ndtri(confidence)) * sd
    return Conformity(
        unit,
        force,
        tolerance.lower,
        tolerance.upper,
        mean,
        sd,
        probability,
        band,
        confidence,
        decision,
    )


# ---- may the numbers be used?


class Use(StrEnum):
    """Whether the numbers of a certificate can be used."""

    CAN_BE_USED = "can be used"
    WITH_RESERVATION = "can be used with reservation"
    DO_NOT_USE = "do not use"


class ReasonKind(StrEnum):
    """Why not, or why not without reservation."""

    NOT_CONVERGED = "not-converged"
    MISFIT = "misfit"
    TRUNCATION = "truncation"
    ROUGH_EVIDENCE = "rough-evidence"
    NOT_DETERMINED = "not-determined"
    PRIOR_SENSITIVE = "prior-sensitive"
    HYPER = "hyper"
    FORCES = "forces"
    OPEN_SIGN = "open-sign"


@dataclass(frozen=True)
class Reason(Result):
    """One reason: the parameters or tests it is about, and of those not determined what they are
    confounded with."""

    kind: ReasonKind
    names: tuple[str, ...] = ()
    partners: tuple[str, ...] = ()


@dataclass(frozen=True)
class Judgement(Result):
    """Whether the numbers can be used, and all reasons against it, the gravest first."""

    use: Use
    reasons: tuple[Reason, ...] = ()


def is_determined(entry: ParameterIdentifiability) -> bool:
    """Whether the readings determine a parameter: identified, or its u at most a third of what the
    prior says."""
    return entry.verdict == Verdict.IDENTIFIED or not entry.contraction < _HARDLY


def state_of(
    fit: Fit,
    verdicts: Mapping[str, ParameterIdentifiability],
    stated: Collection[str],
    *,
    comparison: Comparison | None = None,
) -> Judgement:
    """Say whether the numbers of a certificate can be used.

    Not: where the sampler missed its target, the model does not expect the readings, or these
    contradict non-negative compliance. With reservation: where what is ``stated`` (parameters) is
    hardly determined by the readings, rests on the prior, noise is above what its prior expects,
    forces are too few for the degree, or the answer of ``comparison`` hangs on assumptions.
    """
    concerns = {own.kind: own for own in reversed(fit.concerns)}
    grave = []
    if fit.state == State.UNUSABLE:
        grave.append(Reason(ReasonKind.NOT_CONVERGED))
    if fit.misfits:
        grave.append(
            Reason(ReasonKind.MISFIT, tuple(dict.fromkeys(own.test for own in fit.misfits)))
        )
    if ConcernKind.TRUNCATION in concerns:
        grave.append(Reason(ReasonKind.TRUNCATION))
    weak = [own for name, own in verdicts.items() if name in stated and not is_determined(own)]
    minor = [Reason(ReasonKind.NOT_DETERMINED, (own.name,), own.partners) for own in weak]
    sensitive = tuple(
        name for name in fit.sensitive if name in stated and name not in {own.name for own in weak}
    )
    minor += [Reason(ReasonKind.PRIOR_SENSITIVE, sensitive)] if sensitive else []
    names = tuple(own.name for own in fit.concerns if own.kind == ConcernKind.HYPER)
    minor += [Reason(ReasonKind.HYPER, names)] if names else []
    minor += [Reason(ReasonKind.FORCES)] if ConcernKind.FORCES in concerns else []
    if comparison is not None:
        from ldbb_bayes.analysis.comparison import (
            Sign,
        )  # commands that compare nothing start without it

        minor += [] if comparison.within_tolerance else [Reason(ReasonKind.ROUGH_EVIDENCE)]
        minor += [Reason(ReasonKind.OPEN_SIGN)] if comparison.sign == Sign.OPEN else []
    use = Use.DO_NOT_USE if grave else Use.WITH_RESERVATION if minor else Use.CAN_BE_USED
    return Judgement(use, (*grave, *minor))
