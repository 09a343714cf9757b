"""The base of all nuisance terms: what a term must say of itself."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Literal, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.model.setting import Setting
from ldbb_bayes.model.terms.columns import BasisNoise, Columns, Scale
from ldbb_bayes.results import Result, Shown

__all__ = [
    "Term",
    "Uncertainties",
    "Uncertainty",
    "Unit",
    "assumption",
    "order_in_words",
    "plane_in_words",
    "uncertainties",
]

# Where the terms of the package are defined: models have them unless they say otherwise.
_PACKAGE = "ldbb_bayes.model.terms."
# Before every capital letter but the first of a class name.
_BETWEEN_WORDS = re.compile(r"(?<!^)(?=[A-Z])")
# The end of a coefficient's name: its plane, and the harmonic or order 0.
_SUFFIX = re.compile(r"(?:_(?P<plane>XY|YZ|ZX))?(?:_(?P<trig>cos|sin)(?P<order>\d+)|_0)?$")


class Unit(NamedTuple):
    """A coefficient's unit."""

    inside: str  #: in files and results
    one: float  #: one unit for reading, in the inside unit
    label: str  #: name of the unit for reading


@dataclass(frozen=True)
class Uncertainty:
    """What a term assumes of the instrument: a value and its standard uncertainty."""

    name: str
    value: float
    sd: float
    unit: str  #: of both: mm, N, rad
    certificate: str  #: the field of `Instrument` that states it; empty where none does
    stated: bool  #: whether a certificate has stated it


@dataclass(frozen=True)
class Uncertainties(Result):
    """Everything that the terms of a model assume of the instrument, and its certificates."""

    assumed: tuple[Uncertainty, ...]  #: in the order of the terms
    certificates: Mapping[str, str]  #: names of the certificates


def uncertainties(campaign: Campaign, terms: Iterable[Term] | None = None) -> Uncertainties:
    """Return what terms assume of the instrument of a campaign or plan.

    Parameters
    ----------
    campaign
        Campaign or plan.
    terms
        The terms; by default those of the default model.
    """
    if terms is None:
        terms = [kind() for kind in Term.kinds.values() if not kind.on_demand]
    assumed: list[Uncertainty] = []
    for term in terms:
        assumed.extend(term.assumed(campaign))
    return Uncertainties(tuple(assumed), campaign.instrument.certificates)


def assumption(
    campaign: Campaign, name: str, certificate: str, sd: float, value: float = 0.0
) -> Uncertainty:
    """Return what a term assumes of a coefficient: its value and standard uncertainty.

    Parameters
    ----------
    campaign
        Campaign or plan.
    name
        Name of the coefficient.
    certificate
        The field of `Instrument` that states the uncertainty; empty where none does.
    sd, value
        Standard uncertainty and value, in the coefficient's inside unit.
    """
    stated = bool(certificate) and getattr(campaign.instrument, certificate) is not None
    unit = Term.owner(name).unit_of(name)
    return Uncertainty(name, value, sd, unit.inside, certificate, stated)


class Term(Shown):
    """A nuisance of the readings.

    Derive a frozen dataclass to have one of your own in fits, results, designs and model files.
    Its fields are its settings, positive numbers or strings, and its keys under ``[terms]`` of a
    model file; its class name is its name everywhere. Only `columns` has to be written; the rest
    has defaults.

    Examples
    --------
    >>> @dataclass(frozen=True)
    ... class PitchError(lb.Term):
    ...     sd_um: float = 2.0
    ...
    ...     def columns(self, setting):
    ...         sd = np.full(2, self.sd_um * 1e-3)
    ...         names = ("pitch_error_cos5", "pitch_error_sin5")
    ...         return (lb.Columns(names, setting.harmonics([5]), sd),)
    """

    #: all kinds of terms by class name, in the order of models, results and model files
    kinds: ClassVar[dict[str, type[Term]]] = {}
    #: what names of its coefficients begin with; default: ball_form for BallForm
    stem: ClassVar[str | tuple[str, ...]]
    words: ClassVar[str]  #: what it is called; default: ball form for BallForm
    unit: ClassVar[Unit] = Unit("mm", 1e-3, "µm")  #: of its coefficients
    #: what supplies it, as a noun: cures name it
    calibration: ClassVar[str] = "a measurement of it"
    #: advice for budgets in which it is the largest, a sentence
    remedy: ClassVar[str] = "Measure it, or narrow its prior."
    #: it belongs to bar, balls, mount or force device, and is the same wherever these are
    instrument: ClassVar[bool] = False
    #: fleets take its coefficient as one, the same in all campaigns of one instrument
    common: ClassVar[bool] = False
    on_demand: ClassVar[bool]  #: models have it only when asked to; so they have terms of your own

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        namesake = Term.kinds.get(cls.__name__)
        if namesake is not None and namesake.__module__ != cls.__module__:
            raise InputError(
                f"a term must have a name of its own, got {cls.__name__}, which"
                f" {namesake.__module__} has. Rename it."
            )
        settings = vars(cls)
        words = _BETWEEN_WORDS.sub(" ", cls.__name__).lower()
        cls.stem = settings.get("stem", words.replace(" ", "_"))
        cls.words = settings.get("words", words)
        cls.on_demand = settings.get("on_demand", not cls.__module__.startswith(_PACKAGE))
        Term.kinds[cls.__name__] = cls

    def __post_init__(self) -> None:
        choices: dict[str, tuple[Any, ...]] = {}
        # A class defined inside a function may have annotations that cannot be resolved.
        kind: Any = type(self)
        with suppress(NameError):
            choices = _choices(kind)
        for name, value in vars(self).items():
            setting = f"{type(self).__name__} {name}"
            if name in choices:
                check_known(setting, [value], choices[name])
                continue
            without_curvature = value == 0.0 and name.startswith("curvature")
            if isinstance(value, str | bool) or without_curvature:
                continue
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(
                    f"{setting} must be a positive number, got {value}. To drop the term, leave it"
                    " out."
                )

    @property
    def scales(self) -> tuple[Scale, ...]:
        """Its hyper-parameters."""
        return ()

    def scales_in(self, setting: Setting) -> tuple[Scale, ...]:
        """Return its hyper-parameters in a setting, where there are others than ``scales``."""
        return self.scales

    def columns(self, setting: Setting) -> tuple[Columns | BasisNoise, ...]:
        """Return its columns in a setting; none where it does not act."""
        raise NotImplementedError(f"{type(self).__name__} must have a method columns(setting)")

    def assumed(self, campaign: Campaign) -> Iterator[Uncertainty]:
        """Yield what it assumes of the instrument."""
        yield from ()

    def is_stated(self, coefficient: str, campaign: Campaign) -> bool:
        """Return whether a certificate says how large a coefficient is."""
        stated = False
        longest = -1
        for assumed in self.assumed(campaign):
            if coefficient.startswith(assumed.name) and len(assumed.name) > longest:
                longest = len(assumed.name)
                stated = assumed.stated
        return stated

    @classmethod
    def key(cls) -> str:
        """Return its name among options: ball-form for BallForm."""
        return _BETWEEN_WORDS.sub("-", cls.__name__).lower()

    @staticmethod
    def owner(coefficient: str) -> type[Term]:
        """Return the kind of term that a coefficient belongs to; `Term` itself when none has it."""
        for kind in Term.kinds.values():
            stems = (kind.stem,) if isinstance(kind.stem, str) else kind.stem
            for stem in stems:
                if coefficient == stem or coefficient.startswith(f"{stem}_"):
                    return kind
        return Term

    @classmethod
    def unit_of(cls, coefficient: str) -> Unit:
        """Return the unit of a coefficient."""
        return cls.unit

    @classmethod
    def describe(cls, coefficient: str) -> str:
        """Return a coefficient in words: ball form (cos 2θ)."""
        if cls is Term:
            return coefficient
        harmonic = order_in_words(coefficient) + plane_in_words(coefficient)
        return cls.words + (f" ({harmonic.strip()})" if harmonic else "")

    @classmethod
    def pattern(cls, coefficient: str) -> str:
        """Return its pattern after the term's words: `` in cos 2θ``; empty where it has none."""
        order = order_in_words(coefficient)
        return f" in {order}{plane_in_words(coefficient)}" if order else ""


@cache
def _choices(kind: type[Term]) -> dict[str, tuple[Any, ...]]:
    """Return the values that fields of a kind of term may have, where annotations list them."""
    return {
        name: get_args(hint)
        for name, hint in get_type_hints(kind).items()
        if get_origin(hint) is Literal
    }


def order_in_words(coefficient: str) -> str:
    """Return the harmonic of a coefficient's name: cos 2θ for form_XY_cos2."""
    match = _SUFFIX.search(coefficient)
    if match is None or not match["trig"]:
        return "order 0" if coefficient.endswith("_0") else ""
    multiple = "" if match["order"] == "1" else match["order"]
    return f"{match['trig']} {multiple}θ"


def plane_in_words(coefficient: str) -> str:
    """Return the plane of a coefficient's name: `` in plane XY`` for form_XY_cos2."""
    match = _SUFFIX.search(coefficient)
    return f" in plane {match['plane']}" if match and match["plane"] else ""
