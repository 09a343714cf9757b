"""Base class of nuisance terms (effects that are modelled but not of interest)."""

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

# Beginning of the module names of the package's own terms. The default model has these terms,
# unless they are marked as on demand.
_PACKAGE = "ldbb_bayes.model.terms."
# Pattern of the positions in a class name where a new word begins: before every capital letter
# except the first.
_BETWEEN_WORDS = re.compile(r"(?<!^)(?=[A-Z])")
# Pattern of the end of a coefficient's name, with plane and harmonic, such as _XY_cos2 or _0.
_SUFFIX = re.compile(r"(?:_(?P<plane>XY|YZ|ZX))?(?:_(?P<trig>cos|sin)(?P<order>\d+)|_0)?$")


class Unit(NamedTuple):
    """Unit of a coefficient, and the unit in which reports display it.

    Examples
    --------
    >>> lb.terms.Unit(inside="mm/N", one=1e-6, label="nm/N")
    Unit(inside='mm/N', one=1e-06, label='nm/N')
    >>> lb.terms.Mount.unit_of("mount").label
    'µm/bar'
    """

    inside: str  #: internal unit, made of mm, N and rad, as in results
    one: float  #: size of one display unit in internal units, such as 1e-3 for µm
    label: str  #: name of the display unit, such as µm


@dataclass(frozen=True)
class Uncertainty:
    """A value and its standard uncertainty that a term assumes about the instrument."""

    name: str
    value: float
    sd: float
    unit: str  #: unit of value and sd, made of mm, N, rad
    #: field of `Instrument` that holds the certificate's uncertainty; empty if there is none
    certificate: str
    stated: bool  #: whether a certificate states the uncertainty


@dataclass(frozen=True)
class Uncertainties(Result):
    """All assumptions of a model's terms about the instrument, and the certificates.

    Examples
    --------
    >>> instrument = lb.terms.uncertainties(campaign)
    >>> assumed = {assumption.name: assumption for assumption in instrument.assumed}
    >>> assumed["bar_length"].sd, assumed["bar_length"].unit, assumed["bar_length"].stated
    (0.0094, 'mm', False)
    """

    assumed: tuple[Uncertainty, ...]  #: assumed values with uncertainties, in the order of terms
    certificates: Mapping[str, str]  #: names of the instrument's certificates, by instrument part


def uncertainties(campaign: Campaign, terms: Iterable[Term] | None = None) -> Uncertainties:
    """Return the assumptions of terms about the instrument of a campaign or plan.

    Printed, they are a table that says where in ``campaign.toml`` a certificate's value belongs.

    Parameters
    ----------
    campaign : Campaign
        Campaign or plan.
    terms : iterable of Term, optional
        The terms; by default those of the default model.

    Returns
    -------
    Uncertainties
        Value and standard uncertainty of each quantity of the instrument that the terms assume, and
        the names of the certificates.

    Examples
    --------
    >>> instrument = lb.terms.uncertainties(campaign, [lb.terms.ForceError()])
    >>> [(assumed.name, assumed.sd, assumed.unit) for assumed in instrument.assumed]
    [('force_gain', 0.01, '1'), ('force_curvature', 0.01, '1'), ('force_random', 4.0, 'N')]
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
    """Return the value and standard uncertainty that a term assumes for a coefficient.

    Parameters
    ----------
    campaign
        Campaign or plan.
    name
        Name of the coefficient.
    certificate
        Field of `Instrument` that holds the certificate's uncertainty; empty if there is none.
    sd, value
        Standard uncertainty and value, in the coefficient's internal unit (of mm, N, rad).
    """
    stated = bool(certificate) and getattr(campaign.instrument, certificate) is not None
    unit = Term.owner(name).unit_of(name)
    return Uncertainty(name, value, sd, unit.inside, certificate, stated)


class Term(Shown):
    """An effect on the readings that is modelled but not of interest (a nuisance).

    To define a term of your own, derive a frozen dataclass; fits, results, designs and model files
    then know it by its class name. The fields of the class are the settings of the term (positive
    numbers or strings), and the keys under ``[terms]`` of a model file. Only the method `columns`
    must be written; everything else has defaults.

    Examples
    --------
    Five waves in each turn, the same in all tests:

    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class FiveWaves(lb.terms.Term):
    ...     sd_um: float = 2.0
    ...
    ...     def columns(self, setting):
    ...         sd = np.full(2, self.sd_um * 1e-3)
    ...         names = ("five_waves_cos5", "five_waves_sin5")
    ...         return (lb.terms.Columns(names, setting.harmonics([5]), sd),)
    >>> model.with_term(FiveWaves(sd_um=1.0)).terms[-1]
    'FiveWaves'
    >>> FiveWaves.describe("five_waves_cos5")
    'five waves (cos 5θ)'
    """

    #: classes of all terms by name, in the order of models, results and model files
    kinds: ClassVar[dict[str, type[Term]]] = {}
    #: beginning of the names of the term's coefficients; by default from the class name, such as
    #: ball_form for BallForm
    stem: ClassVar[str | tuple[str, ...]]
    #: name of the term in texts; by default from the class name, such as ball form for BallForm
    words: ClassVar[str]
    unit: ClassVar[Unit] = Unit("mm", 1e-3, "µm")  #: unit of the term's coefficients
    #: measurement that would determine the effect (a noun), used in advice
    calibration: ClassVar[str] = "a measurement of it"
    #: advice (a sentence) for uncertainty budgets in which the term contributes most
    remedy: ClassVar[str] = "Measure it, or narrow its prior."
    #: whether the effect belongs to the instrument (bar, balls, mount or force device)
    instrument: ClassVar[bool] = False
    #: whether the coefficient is the same in all campaigns that use one instrument
    common: ClassVar[bool] = False
    #: whether models have the term only on request; by default true for terms that you define
    on_demand: ClassVar[bool]

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
        # Annotations of a class defined inside a function may be unknown here; then its choices are
        # not checked.
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
        """Hyper-parameters of the term: scales of its prior sds that readings help to determine.

        By default a term has none.
        """
        return ()

    def scales_in(self, setting: Setting) -> tuple[Scale, ...]:
        """Return the term's hyper-parameters for the tests of a campaign; by default ``scales``."""
        return self.scales

    def columns(self, setting: Setting) -> tuple[Columns | BasisNoise, ...]:
        """Return the term's columns for the tests of a campaign.

        The tuple is empty if the term has no effect on these tests.
        """
        raise NotImplementedError(f"{type(self).__name__} must have a method columns(setting)")

    def assumed(self, campaign: Campaign) -> Iterator[Uncertainty]:
        """Yield what the term assumes about the instrument: values and standard uncertainties."""
        yield from ()

    def is_stated(self, coefficient: str, campaign: Campaign) -> bool:
        """Return whether a certificate states the uncertainty of a coefficient."""
        stated = False
        longest = -1
        for assumed in self.assumed(campaign):
            if coefficient.startswith(assumed.name) and len(assumed.name) > longest:
                longest = len(assumed.name)
                stated = assumed.stated
        return stated

    @classmethod
    def key(cls) -> str:
        """Return the term's name as a command-line option: ball-form for BallForm."""
        return _BETWEEN_WORDS.sub("-", cls.__name__).lower()

    @staticmethod
    def owner(coefficient: str) -> type[Term]:
        """Return the class of the term that a coefficient belongs to, or `Term` if unknown."""
        for kind in Term.kinds.values():
            stems = (kind.stem,) if isinstance(kind.stem, str) else kind.stem
            for stem in stems:
                if coefficient == stem or coefficient.startswith(f"{stem}_"):
                    return kind
        return Term

    @classmethod
    def unit_of(cls, coefficient: str) -> Unit:
        """Return the unit of a coefficient of this term, given the coefficient's name."""
        return cls.unit

    @classmethod
    def describe(cls, coefficient: str) -> str:
        """Return a coefficient in words, such as ball form (cos 2θ), from its name."""
        if cls is Term:
            return coefficient
        harmonic = order_in_words(coefficient) + plane_in_words(coefficient)
        return cls.words + (f" ({harmonic.strip()})" if harmonic else "")

    @classmethod
    def pattern(cls, coefficient: str) -> str:
        """Return the harmonic of a coefficient, such as `` in cos 2θ``, from its name.

        The text is empty if the name contains no harmonic.
        """
        order = order_in_words(coefficient)
        return f" in {order}{plane_in_words(coefficient)}" if order else ""


@cache
def _choices(kind: type[Term]) -> dict[str, tuple[Any, ...]]:
    """Return the permitted values of a term's settings, for settings with a list of choices."""
    return {
        name: get_args(hint)
        for name, hint in get_type_hints(kind).items()
        if get_origin(hint) is Literal
    }


def order_in_words(coefficient: str) -> str:
    """Return the harmonic in a coefficient's name in words: cos 2θ for form_XY_cos2."""
    match = _SUFFIX.search(coefficient)
    if match is None or not match["trig"]:
        return "order 0" if coefficient.endswith("_0") else ""
    multiple = "" if match["order"] == "1" else match["order"]
    return f"{match['trig']} {multiple}θ"


def plane_in_words(coefficient: str) -> str:
    """Return the plane in a coefficient's name in words: `` in plane XY`` for form_XY_cos2."""
    match = _SUFFIX.search(coefficient)
    return f" in plane {match['plane']}" if match and match["plane"] else ""
