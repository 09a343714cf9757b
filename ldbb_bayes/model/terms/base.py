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
    "MACHINE_CORRELATION",
    "Term",
    "Uncertainties",
    "Uncertainty",
    "Unit",
    "assumption",
    "order_in_words",
    "plane_in_words",
    "uncertainties",
]

#: Prior correlation of a coefficient of the machine between two of its campaigns. If the
#: coefficients were taken as equal, the interval of a change of C_CCY would not contain the true
#: change in 7 of 64 simulated machines whose C_XXX grew by 15 %.
MACHINE_CORRELATION = 0.99

# Beginning of the names of the modules that define the package's own nuisance terms. The default
# model has these terms, except those that are only added on request (``on_demand``).
_PACKAGE = "ldbb_bayes.model.terms."
# Regular expression for the positions in the class name of a term where a new word begins: before
# every capital letter except the first, as before Form in BallForm.
_BETWEEN_WORDS = re.compile(r"(?<!^)(?=[A-Z])")
# Regular expression for the end of the name of a term's coefficient. The end, such as _XY_cos2 or
# _0, states plane and harmonic.
_SUFFIX = re.compile(r"(?:_(?P<plane>XY|YZ|ZX))?(?:_(?P<trig>cos|sin)(?P<order>\d+)|_0)?$")


class Unit(NamedTuple):
    """Internal unit of a term's coefficient, and the unit in which reports display it.

    Examples
    --------
    >>> lb.terms.Unit(inside="mm/N", one=1e-6, label="nm/N")
    Unit(inside='mm/N', one=1e-06, label='nm/N')
    >>> lb.terms.Mount.unit_of("mount").label
    'µm/bar'
    """

    #: internal unit, a combination of mm, N and rad, in which a nuisance coefficient is expressed
    #: in all computations.
    inside: str
    #: unit in which reports display a coefficient, expressed in internal units (mm, N, rad): 1e-3
    #: for µm, for example, because 1 µm is 1e-3 mm
    one: float
    #: name of the unit in which reports display a nuisance coefficient, such as µm
    label: str


@dataclass(frozen=True)
class Uncertainty:
    """Assumed value and standard uncertainty of a property of the instrument.

    In the model, the property is a coefficient of a nuisance term. ``name`` is the name of this
    coefficient, such as bar_length. ``value`` is its assumed value, and ``sd`` the standard
    uncertainty of this value.
    """

    name: str
    value: float
    sd: float
    #: unit of ``value`` and ``sd``, made of mm, N and rad
    unit: str
    #: Name of the field of `Instrument` for the uncertainty that a certificate states, such as
    #: ``bar_U_um`` for the length of the bar; empty string if there is no such field.
    certificate: str
    #: whether the campaign's `Instrument` states the uncertainty of a property, for example from a
    #: certificate, or the grade of a ball; otherwise the uncertainty is a default value
    stated: bool


@dataclass(frozen=True)
class Uncertainties(Result):
    """Uncertainties assumed for the instrument, and names of its calibration certificates.

    Each uncertainty is the prior standard deviation of a coefficient of a nuisance term. A nuisance
    term is the part of the model for an effect that is not of interest.

    Examples
    --------
    >>> instrument = lb.terms.uncertainties(campaign)
    >>> assumed = {assumption.name: assumption for assumption in instrument.assumed}
    >>> assumed["bar_length"].sd, assumed["bar_length"].unit, assumed["bar_length"].stated
    (0.0094, 'mm', False)
    """

    #: properties of the instrument, such as the length of the bar, with the value and the standard
    #: uncertainty that the model assumes for each
    assumed: tuple[Uncertainty, ...]
    #: dict of the names of the instrument's calibration certificates; its keys are the certified
    #: parts, such as ``bar``
    certificates: Mapping[str, str]


def uncertainties(campaign: Campaign, terms: Iterable[Term] | None = None) -> Uncertainties:
    """Return what nuisance terms assume about the instrument of a campaign or plan.

    Nuisances are effects that are modelled but not of interest. When the result is printed, it is a
    table. The table also names the field of ``campaign.toml`` in which to enter the value from each
    certificate.

    Parameters
    ----------
    campaign : Campaign
        Campaign or plan.
    terms : iterable of Term, optional
        Nuisance terms; by default the nuisance terms of the default model.

    Returns
    -------
    Uncertainties
        Assumed value and standard uncertainty of each property of the instrument, and the names of
        the certificates.

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
    """Return a term's assumption about one of its coefficients as an `Uncertainty`.

    The unit is determined from the name of the coefficient. The result also says whether the
    uncertainty comes from a certificate of the campaign. The uncertainty itself is given by the
    caller as ``sd``; it is not read from the certificate.

    Parameters
    ----------
    campaign
        Campaign or plan, which holds the certificates.
    name
        Name of the coefficient, such as bar_length.
    certificate
        Name of the field of `Instrument` that holds the uncertainty from a certificate, such as
        bar_U_um. If this field is filled in, the result says that the uncertainty comes from a
        certificate. Empty string if there is no such field.
    sd
        Standard uncertainty of the coefficient that the term assumes, in the internal unit of the
        coefficient (made of mm, N, rad).
    value
        Value of the coefficient that the term assumes, in the same unit.
    """
    stated = bool(certificate) and getattr(campaign.instrument, certificate) is not None
    unit = Term.owner(name).unit_of(name)
    return Uncertainty(name, value, sd, unit.inside, certificate, stated)


class Term(Shown):
    """An effect on the readings that is modelled but not of interest (a nuisance).

    The effect is a sum of columns (functions of the angle) times coefficients with Gaussian priors.
    To define a term of your own, derive a frozen dataclass from this class. In fits, results,
    designs and model files, the term has the name of your class. The fields of your class are the
    settings of the term (positive numbers or strings). In a model file, the names of these fields
    are the keys of the term's table under ``[terms]``. Only the method `columns` must be written;
    everything else has defaults.

    Examples
    --------
    An effect with five waves around the circle, the same in all tests:

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

    #: Dict of the classes of all nuisance terms; its keys are the names of the classes. Models,
    #: results and model files list the terms in the order of this dict.
    kinds: ClassVar[dict[str, type[Term]]] = {}
    #: Beginning of the names of the coefficients of a nuisance term. It is a tuple if these names
    #: can begin in different ways. By default it is made from the class name: ``bar_length`` for
    #: the class BarLength.
    stem: ClassVar[str | tuple[str, ...]]
    #: name of a nuisance term in reports; by default made from the class name, such as ball form
    #: for BallForm
    words: ClassVar[str]
    #: internal unit of the coefficients of a nuisance term, and the unit in which reports display
    #: them
    unit: ClassVar[Unit] = Unit("mm", 1e-3, "µm")
    #: description of a measurement that would determine the effect of a nuisance term; printed in
    #: advice to the user
    calibration: ClassVar[str] = "a measurement of it"
    #: advice (a sentence) that is printed with an uncertainty budget if a nuisance term contributes
    #: most to the uncertainty
    remedy: ClassVar[str] = "Measure it, or narrow its prior."
    #: whether the effect of a nuisance term belongs to the instrument (bar, balls, mount or force
    #: device)
    instrument: ClassVar[bool] = False
    #: whether the effect of a nuisance term belongs to the machine and stays the same as long as
    #: its joints are not changed
    machine: ClassVar[bool] = False
    #: prior correlation of each coefficient of a nuisance term between two campaigns that have the
    #: instrument, or the machine, in common. It is below one if a part of the effect is another in
    #: every campaign.
    campaign_correlation: ClassVar[float] = 1.0
    #: whether the coefficients of a nuisance term belong to circles of a certain plane, radius and
    #: centre
    of_circle: ClassVar[bool] = False
    #: whether the coefficients of a nuisance term have the same values in all campaigns with the
    #: same instrument
    common: ClassVar[bool] = False
    #: whether a model has a nuisance term only if the term is added with ``with_term``; by default
    #: false for terms of the package and true for terms that you define
    on_demand: ClassVar[bool]

    def __init_subclass__(cls) -> None:
        """Register a new class of nuisance terms, and give it default names.

        The defaults for ``stem`` and ``words`` are made from the name of the class. Raise an
        `InputError` if a term of another module has the same name.
        """
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
        """Raise an `InputError` if a setting of the term has a value that is not permitted.

        A number must be finite and positive, except that a curvature may also be zero. If the type
        of a setting is a ``Literal``, the value must be one of those that the ``Literal`` lists.
        This is not checked if the names in the type annotations of the class cannot be resolved.
        """
        choices: dict[str, tuple[Any, ...]] = {}
        # The annotations of a term's class state the permitted choices of its settings. If a user
        # defines the class inside a function, the names in the annotations may be unknown here. The
        # choices are then not checked.
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
        """Hyper-parameters of a nuisance term, which scale the prior sds of its coefficients.

        Hyper-parameters are estimated from the readings. By default a term has none.
        """
        return ()

    def scales_in(self, setting: Setting) -> tuple[Scale, ...]:
        """Return the hyper-parameters of a nuisance term for the test conditions of a campaign.

        ``setting`` describes the test conditions. By default, the result is the property ``scales``
        of the term, which does not depend on the campaign.
        """
        return self.scales

    def columns(self, setting: Setting) -> tuple[Columns | BasisNoise, ...]:
        """Return the columns of a nuisance term for the test conditions of a campaign.

        ``setting`` describes the test conditions. A column is the change of the reading per unit of
        one coefficient, as 25 Fourier coefficients for each test. The result is an empty tuple if
        the term has no effect on these tests.
        """
        raise NotImplementedError(f"{type(self).__name__} must have a method columns(setting)")

    def assumed(self, campaign: Campaign) -> Iterator[Uncertainty]:
        """Yield assumed properties of the instrument: their values and standard uncertainties.

        ``campaign`` holds the certificates of the instrument. By default, a term assumes nothing
        about the instrument.
        """
        yield from ()

    def is_stated(self, coefficient: str, campaign: Campaign) -> bool:
        """Return whether a certificate states the uncertainty of a coefficient of this term.

        ``coefficient`` is the name of the coefficient; ``campaign`` holds the certificates. The
        term may assume uncertainties for several properties of the instrument. The name of a
        coefficient begins with the name of its property: ``bar_length_150``, for example, belongs
        to the property ``bar_length``. If several properties fit, the one with the longest name is
        used.
        """
        stated = False
        longest = -1
        for assumed in self.assumed(campaign):
            if coefficient.startswith(assumed.name) and len(assumed.name) > longest:
                longest = len(assumed.name)
                stated = assumed.stated
        return stated

    @classmethod
    def ratio(cls, coefficient: str, first: Setting, second: Setting) -> float:
        """Return the value of a coefficient in a second campaign if it is one in a first campaign.

        The effect that the coefficient describes is the same in both campaigns, which have the test
        conditions ``first`` and ``second``. By default, its value is the same too. ``coefficient``
        is the name of the coefficient.
        """
        return 1.0

    @classmethod
    def nominal(cls, coefficient: str, campaign: Campaign) -> float:
        """Return what a campaign states of a quantity whose error a coefficient is.

        The value is in internal units (mm, N, rad). The quantity is the nominal value plus the
        coefficient. It is the same in campaigns with the same instrument, even if the campaigns
        state different nominal values. ``coefficient`` is the name of the coefficient. By default
        the nominal value is zero.
        """
        return 0.0

    @classmethod
    def key(cls) -> str:
        """Return the term's name on the command line, such as ball-form for BallForm."""
        return _BETWEEN_WORDS.sub("-", cls.__name__).lower()

    @staticmethod
    def owner(coefficient: str) -> type[Term]:
        """Return the class of the nuisance term to which the named ``coefficient`` belongs.

        Return `Term` if no term has a coefficient with this name. If the name begins with the stems
        of several terms, it belongs to the term with the longest of these stems:
        ``angle_encoder_cos2`` belongs to a term of yours with the stem ``angle_encoder``, not to
        `Angle`.
        """
        owner = Term
        longest = 0
        for kind in Term.kinds.values():
            stems = (kind.stem,) if isinstance(kind.stem, str) else kind.stem
            for stem in stems:
                is_of_stem = coefficient == stem or coefficient.startswith(f"{stem}_")
                if is_of_stem and len(stem) > longest:
                    owner = kind
                    longest = len(stem)
        return owner

    @classmethod
    def unit_of(cls, coefficient: str) -> Unit:
        """Return the internal and the display unit of the nuisance coefficient ``coefficient``."""
        return cls.unit

    @classmethod
    def describe(cls, coefficient: str) -> str:
        """Return a description of a coefficient of this term, derived from the coefficient's name.

        For example, pattern_cos4 is described as "machine pattern (cos 4θ)". The base class `Term`
        itself returns the name unchanged.
        """
        if cls is Term:
            return coefficient
        harmonic = order_in_words(coefficient) + plane_in_words(coefficient)
        return cls.words + (f" ({harmonic.strip()})" if harmonic else "")

    @classmethod
    def pattern(cls, coefficient: str) -> str:
        """Return the harmonic and plane of a coefficient in words, such as `` in cos 2θ``.

        The words are derived from ``coefficient``, the name of the coefficient. The plane is left
        out if the name contains none. If the name contains no harmonic, the result is an empty
        string.
        """
        order = order_in_words(coefficient)
        return f" in {order}{plane_in_words(coefficient)}" if order else ""


@cache
def _choices(kind: type[Term]) -> dict[str, tuple[Any, ...]]:
    """Return the permitted values of those settings of a term that are chosen from a list.

    ``kind`` is the class of the term. The result is a dict: each key is the name of such a setting,
    each value is the tuple of its permitted values.
    """
    return {
        name: get_args(hint)
        for name, hint in get_type_hints(kind).items()
        if get_origin(hint) is Literal
    }


def order_in_words(coefficient: str) -> str:
    """Return the harmonic in a coefficient's name, such as cos 2θ for form_XY_cos2.

    Return "order 0" for names that end in _0, and an empty string for names without a harmonic.
    """
    match = _SUFFIX.search(coefficient)
    if match is None or not match["trig"]:
        return "order 0" if coefficient.endswith("_0") else ""
    multiple = "" if match["order"] == "1" else match["order"]
    return f"{match['trig']} {multiple}θ"


def plane_in_words(coefficient: str) -> str:
    """Return the plane in a coefficient's name as words: `` in plane XY`` for form_XY_cos2.

    Return an empty string for names without a plane.
    """
    match = _SUFFIX.search(coefficient)
    return f" in plane {match['plane']}" if match and match["plane"] else ""
