"""The nuisance terms, each one class: its columns in the circle's basis, its scales, its unit and
its words.

ρ_r(θ) = F_r Σ_k (F_r − F0)^k j_C·C_k + j_G·E + terms + ε. A column of test r is its 25 basis
coefficients; a term's columns are shared by all tests or stand for each test apart. A term of your
own is one more class derived from `Term`.
"""

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

__all__ = ["Term", "Uncertainties", "Uncertainty", "Unit", "uncertainties"]


class Unit(NamedTuple):
    """A coefficient's unit: in files and results; the size of one for reading, and what that is
    called."""

    inside: str
    one: float
    label: str


@dataclass(frozen=True)
class Uncertainty:
    """What a term assumes of the instrument: a value and its standard uncertainty, in ``unit`` (mm,
    N, rad), the field of `Instrument` that states it (empty: none does), and whether a certificate
    has stated it."""

    name: str
    value: float
    sd: float
    unit: str
    certificate: str
    stated: bool


@dataclass(frozen=True)
class Uncertainties(Result):
    """Everything that the terms of a model assume of the instrument, and the names of its
    certificates."""

    assumed: tuple[Uncertainty, ...]  #: in the order of the terms
    certificates: Mapping[str, str]


def uncertainties(campaign: Campaign, terms: Iterable[Term] | None = None) -> Uncertainties:
    """Return what terms, by default those of the default model, assume of the instrument of a
    campaign or plan."""
    used = (
        [kind() for kind in Term.kinds.values() if not kind.on_demand] if terms is None else terms
    )
    return Uncertainties(
        tuple(own for term in used for own in term.assumed(campaign)),
        campaign.instrument.certificates,
    )


def _assumed(
    campaign: Campaign, name: str, certificate: str, sd: float, value: float = 0.0
) -> Uncertainty:
    stated = bool(certificate) and getattr(campaign.instrument, certificate) is not None
    return Uncertainty(name, value, sd, Term.owner(name).unit_of(name).inside, certificate, stated)


class Term(Shown):
    """A nuisance of the readings. Derive a frozen dataclass to have one of your own in fits,
    results, designs and model files.

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
    ...         return (lb.Columns(("pitch_error_cos5", "pitch_error_sin5"), setting.harmonics([5]), sd),)
    """

    kinds: ClassVar[dict[str, type[Term]]] = {}
    #: what names of its coefficients begin with; default: ball_form for BallForm
    stem: ClassVar[str | tuple[str, ...]]
    words: ClassVar[str]  #: what it is called; default: ball form for BallForm
    unit: ClassVar[Unit] = Unit("mm", 1e-3, "µm")  #: of its coefficients
    #: what supplies it, as a noun: cures name it
    calibration: ClassVar[str] = "a measurement of it"
    remedy: ClassVar[str] = (
        #: advice for budgets in which it is the largest, a sentence
        "Measure it, or narrow its prior."
    )
    instrument: ClassVar[bool] = (
        #: it belongs to bar, balls, mount or force device, and is the same wherever these are
        False
    )
    #: fleets take its coefficient as one, the same in all campaigns of one instrument
    common: ClassVar[bool] = False
    on_demand: ClassVar[bool]  #: models have it only when asked to; so they have terms of your own

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        other = Term.kinds.get(cls.__name__)
        if other is not None and other.__module__ != cls.__module__:
            raise InputError(
                f"a term must have a name of its own, got {cls.__name__}, which {other.__module__}"
                " has. Rename it."
            )
        spaced = re.sub(r"(?<!^)(?=[A-Z])", " ", cls.__name__).lower()
        cls.stem = vars(cls).get("stem", spaced.replace(" ", "_"))
        cls.words = vars(cls).get("words", spaced)
        of_package = cls.__module__.startswith("ldbb_bayes.model.terms.")
        cls.on_demand = vars(cls).get("on_demand", not of_package)
        Term.kinds[cls.__name__] = cls

    def __post_init__(self) -> None:
        kind: Any = type(self)
        choices: dict[str, tuple[Any, ...]] = {}
        with suppress(NameError):
            choices = _choices(kind)
        for name, value in vars(self).items():
            what = f"{type(self).__name__} {name}"
            if name in choices:
                check_known(what, [value], choices[name])
            elif isinstance(value, str | bool) or (
                value == 0.0 and name.startswith("curvature")
            ):  # no curvature, the rest stays
                continue
            elif not (np.isfinite(value) and value > 0.0):
                raise InputError(
                    f"{what} must be a positive number, got {value}. To drop the term, leave it"
                    " out."
                )

    @property
    def scales(self) -> tuple[Scale, ...]:
        """Its hyper-parameters."""
        return ()

    def scales_in(self, setting: Setting) -> tuple[Scale, ...]:
        """Its hyper-parameters in a setting, where more than ``scales``."""
        return self.scales

    def columns(self, setting: Setting) -> tuple[Columns | BasisNoise, ...]:
        """Its columns in a setting; none where it does not act."""
        raise NotImplementedError(f"{type(self).__name__} must have a method columns(setting)")

    def assumed(self, campaign: Campaign) -> Iterator[Uncertainty]:
        """What it assumes of the instrument."""
        yield from ()

    def is_stated(self, coefficient: str, campaign: Campaign) -> bool:
        """Whether a certificate says how large a coefficient is."""
        alike = [own for own in self.assumed(campaign) if coefficient.startswith(own.name)]
        return bool(alike) and max(alike, key=lambda own: len(own.name)).stated

    @classmethod
    def key(cls) -> str:
        """Its name among options: ball-form for BallForm."""
        return re.sub(r"(?<!^)(?=[A-Z])", "-", cls.__name__).lower()

    @staticmethod
    def owner(coefficient: str) -> type[Term]:
        """The kind of term that a coefficient's name belongs to; `Term` itself when none has it."""
        for kind in Term.kinds.values():
            stems = (kind.stem,) if isinstance(kind.stem, str) else kind.stem
            if any(coefficient == stem or coefficient.startswith(f"{stem}_") for stem in stems):
                return kind
        return Term

    @classmethod
    def unit_of(cls, coefficient: str) -> Unit:
        """Unit of a coefficient."""
        return cls.unit

    @classmethod
    def describe(cls, coefficient: str) -> str:
        """A coefficient in words: ball form (cos 2θ)."""
        if cls is Term:
            return coefficient
        order = _order(coefficient) + _in_plane(coefficient)
        return cls.words + (f" ({order.strip()})" if order else "")

    @classmethod
    def pattern(cls, coefficient: str) -> str:
        """Its pattern after the term's words: `` in cos 2θ``; empty where it has none."""
        order = _order(coefficient)
        return f" in {order}{_in_plane(coefficient)}" if order else ""


_SUFFIX = re.compile(r"(?:_(?P<plane>XY|YZ|ZX))?(?:_(?P<trig>cos|sin)(?P<order>\d+)|_0)?$")


@cache
def _choices(kind: type[Term]) -> dict[str, tuple[Any, ...]]:
    """The values that fields of one kind of term may have, where its annotations list them."""
    return {
        name: get_args(hint)
        for name, hint in get_type_hints(kind).items()
        if get_origin(hint) is Literal
    }


def _order(coefficient: str) -> str:
    """form_XY_cos2 → cos 2θ."""
    match = _SUFFIX.search(coefficient)
    if match is None or not match["trig"]:
        return "order 0" if coefficient.endswith("_0") else ""
    return f"{match['trig']} {'' if match['order'] == '1' else match['order']}θ"


def _in_plane(coefficient: str) -> str:
    match = _SUFFIX.search(coefficient)
    return f" in plane {match['plane']}" if match and match["plane"] else ""
