"""The nuisance terms, each one class: its columns in the circle's basis, its scales, its unit and
its words.

ρ_r(θ) = F_r Σ_k (F_r − F0)^k j_C·C_k + j_G·E + terms + ε. A column of test r is its 25 basis
coefficients; a term's columns are shared by all tests or stand for each test apart. A term of your
own is one more class derived from `Term`.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Literal, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np

from ldbb_bayes.campaign.campaign import Ball, Campaign, Instrument
from ldbb_bayes.errors import InputError, check_known, require
from ldbb_bayes.machine.chain import LINEAR
from ldbb_bayes.model.fourier import MAX_ORDER, ORDERS, SIZE, derivative
from ldbb_bayes.model.setting import TRAVEL_NAMES, Setting
from ldbb_bayes.results import Array, Result, Shown

__all__ = [
    "FORM_ORDER",
    "NOISE",
    "OWN",
    "Angle",
    "BallForm",
    "BarLength",
    "BasisNoise",
    "CircleScale",
    "Columns",
    "Covariate",
    "Discrepancy",
    "Drift",
    "ForceError",
    "Hyper",
    "Hysteresis",
    "JointLoad",
    "Law",
    "MachinePattern",
    "Mount",
    "Moves",
    "Position",
    "Scale",
    "SetupShift",
    "Source",
    "Term",
    "Uncertainties",
    "Uncertainty",
    "Unit",
    "first_edition",
    "uncertainties",
]

Hyper = str
# Whose a coefficient is that is no term's: of the parameters of interest, of the white noise of
# readings.
OWN = "Parameters"
NOISE = "ReadingNoise"
# The order at which τ and ω are the sd of form.
FORM_ORDER = 6.0


Law = Literal["half-normal", "decay", "circle"]


class Scale(NamedTuple):
    """A hyper-parameter: the sd, in mm, of what it scales, with a half-normal prior whose scale
    [µm] is ``prior_um``, or the field of `Prior` of that name. Results add ``_um`` to its name;
    ``symbol`` and ``words`` are for reading.

    Two laws are of numbers without a unit: ``decay``, the power by which form falls with its order,
    and ``circle``, λ of one circle, λ² ~ InvGamma(3/2, 3/2).
    """

    name: Hyper
    prior_um: float | str
    symbol: str = ""
    words: str = ""
    law: Law = "half-normal"

    def __repr__(self) -> str:
        return f"Scale({self.name!r})"


class Source(NamedTuple):
    """What an sd is a known multiple of: a hyper-parameter times a circle's λ times
    (order/6)^(−decay); 1 without them."""

    hyper: Hyper | None = None
    circle: Hyper | None = None
    decay: Hyper | None = None
    order: float = FORM_ORDER

    def at(self, value: Mapping[Hyper, Any]) -> Any:
        """Its value at those of the hyper-parameters [mm], of any shape."""
        size = value[self.hyper] if self.hyper else 1.0
        size = size * value[self.circle] if self.circle else size
        return size * (self.order / FORM_ORDER) ** -value[self.decay] if self.decay else size


class Unit(NamedTuple):
    """A coefficient's unit: in files and results; the size of one for reading, and what that is
    called."""

    inside: str
    one: float
    label: str


@dataclass(frozen=True, eq=False)
class Columns(Shown):
    """Columns of one term with their Gaussian prior, p coefficients."""

    names: tuple[str, ...]  #: they begin with the term's ``stem``
    values: Array  #: shape (tests, 25, p)
    #: Prior sd (p,), or one number for all: in units of ``hyper`` where one is named, else in mm; infinite for a flat prior.
    sd: Any
    hyper: Hyper | None = None  #: the hyper-parameter that scales ``sd``
    private: bool = False  #: every test has its own copy of each coefficient
    mean: Array | None = None  #: prior mean (p,) of shared coefficients; default: zero
    decay: Hyper | None = None  #: the hyper-parameter p by which ``sd`` falls as (order/6)^(−p)
    orders: Array | None = None  #: of each coefficient (p,), with ``decay``
    stated: Array | None = None  #: sd (p,) that no hyper-parameter scales, added in quadrature
    #: names of the scales λ of private coefficients, one a test, as of `BasisNoise`
    circle: Sequence[Hyper] | Array = ()

    def __post_init__(self) -> None:
        p = len(self.names)
        for name in ("sd", "mean"):
            if isinstance(value := getattr(self, name), int | float):
                object.__setattr__(self, name, np.full(p, float(value)))
        require(
            self.values.shape[1:] == (SIZE, p) and self.sd.shape == (p,),
            f"columns of {', '.join(self.names)} must have values of shape (tests, {SIZE}, {p}) and"
            f" sd of shape ({p},), got {self.values.shape} and {self.sd.shape}. Give one of each"
            " for every name.",
        )

    @property
    def sources(self) -> tuple[Source, ...]:
        """Of each coefficient."""
        if self.decay is None or self.orders is None:
            return (Source(self.hyper),) * len(self.names)
        return tuple(Source(self.hyper, None, self.decay, float(n)) for n in self.orders)

    def sources_of(self, test: int) -> tuple[Source, ...]:
        """Of each coefficient of one test."""
        circle = (str(self.circle[test]) or None) if len(self.circle) else None
        return tuple(source._replace(circle=circle) for source in self.sources)

    def sd_at(self, value: Mapping[Hyper, Any]) -> Array:
        """Prior sd at hyper-parameters, numbers or arrays (w,) [mm], shape (..., p)."""
        sizes = (
            np.broadcast_arrays(*(source.at(value) for source in self.sources))
            if self.names
            else [np.zeros(0)]
        )
        scaled = self.sd * (np.stack(sizes, axis=-1) if self.names else 1.0)
        return scaled if self.stated is None else np.hypot(scaled, self.stated)

    def draw(self, phi: Mapping[Hyper, float], tests: int, rng: np.random.Generator) -> Array:
        """What one draw from the prior at φ adds to the readings' coefficients, shape (tests, 25)
        [mm]."""
        sd = self.sd_at(phi)
        drawn = sd * rng.standard_normal((tests if self.private else 1, len(sd)))
        drawn = drawn if self.mean is None else drawn + self.mean
        return np.einsum("tkq,tq->tk", self.values, np.broadcast_to(drawn, (tests, len(sd))))


@dataclass(frozen=True, eq=False)
class BasisNoise(Shown):
    """Independent coefficients on the basis itself, separate for every test: sd = hyper · λ ·
    ``sd`` (25,); ``circle`` (tests,): the name of each test's λ, empty for none."""

    hyper: Hyper
    sd: Array
    circle: Sequence[Hyper] | Array = ()

    @property
    def sources(self) -> tuple[Source, ...]:
        """Of each test; one alone where circles have no λ."""
        return tuple(Source(self.hyper, str(name) or None) for name in self.circle) or (
            Source(self.hyper),
        )

    def source(self, test: int) -> Source:
        """Of one test."""
        return self.sources[test if len(self.circle) else 0]

    def sd_at(self, value: Mapping[Hyper, Any], test: int) -> Array:
        """Their sd at hyper-parameters, numbers or arrays (w,) [mm], shape (..., 25)."""
        return np.multiply.outer(self.source(test).at(value), self.sd)

    def draw(self, phi: Mapping[Hyper, float], tests: int, rng: np.random.Generator) -> Array:
        """One draw of them, shape (tests, 25) [mm]."""
        return np.stack([self.sd_at(phi, r) for r in range(tests)]) * rng.standard_normal(
            (tests, SIZE)
        )


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
        cls.on_demand = vars(cls).get("on_demand", cls.__module__ != __name__)
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


Moves = Literal["together", "apart", "zero", "centre"]
Covariate = Literal["time", "temperature"]
_TRAVEL_ORDERS = 4
_FORM_ORDERS = range(2, MAX_ORDER + 1)
_PATTERN_ORDERS = range(4, MAX_ORDER + 1)
_DECAY = Scale("decay", "decay", "p", "decay of form with its order", "decay")
# (S/24^½)² is the variance of a lobe whose peak to valley, 2 amplitudes, is S with each phase as
# likely as another.
_OF_SPHERICITY = 1.0 / 24.0


def _harmonic_names(stem: str, orders: Sequence[int]) -> tuple[str, ...]:
    return tuple(f"{stem}_{trig}{n}" for n in orders for trig in ("cos", "sin"))


@dataclass(frozen=True)
class BallForm(Term):
    """cos n(θ − ψ), sin n(θ − ψ), n = 2 … 12: form error of the balls, the same at every force.

    The variance of each coefficient is τ² (n/6)^(−2p), and at the orders 2 and 3 (S_work² +
    S_tool²)/24 besides, S the deviation from sphericity, peak to valley, that a ball's certificate
    or grade states, or else ``sphericity_um``. A harmonic that a certificate states has its mean
    and variance from there. With ``law`` 1/n the sd is τ/n (first edition).

    While no ball is clocked the two forms are one sum. As soon as a clocking differs between tests
    there are two terms, the work ball at θ − ψ_work and the tool ball, touched on its far side, at
    θ + 180° − ψ_tool, each with τ²/2 and its own S². Every plane runs over another great circle of
    the balls: it has forms of its own.
    """

    sphericity_um: float = 2.5
    law: Literal["decay", "1/n"] = "decay"
    stem = ("form", "work_form", "tool_form")
    calibration = "a calibration of the balls' form"
    remedy = "Clock both balls (not by 180° alone), or measure a second radius."
    instrument = True

    @property
    def scales(self) -> tuple[Scale, ...]:
        return (
            Scale("tau", "tau_um", "τ", "ball form"),
            *([_DECAY] if self.law == "decay" else []),
        )

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        work = setting.instrument.work
        tool = setting.instrument.tool
        far = setting.tool_ball_rad - np.pi
        balls = [
            (
                "form",
                setting.work_ball_rad,
                [(work, 0.0), (tool, float(far[0] - setting.work_ball_rad[0]))],
            )
        ]
        if setting.two_balls:
            balls = [
                ("work_form", setting.work_ball_rad, [(work, 0.0)]),
                ("tool_form", far, [(tool, 0.0)]),
            ]
        return tuple(
            Columns(
                _harmonic_names(stem + plane, _FORM_ORDERS),
                setting.harmonics(_FORM_ORDERS, turned) * own[:, None, None],
                hyper="tau",
                **self._prior(of),
            )
            for _, plane, own in setting.each("plane")
            for stem, turned, of in balls
        )

    def _prior(self, balls: Sequence[tuple[Ball, float]]) -> dict[str, Any]:
        """Prior of the sum of forms of balls, each turned by so much [rad]: what `Columns`
        takes."""
        if self.law == "1/n":
            return {
                "sd": np.sqrt(len(balls) / 2.0) / np.repeat(np.array(_FORM_ORDERS, dtype=float), 2)
            }
        orders = np.repeat(_FORM_ORDERS, 2)
        share = np.zeros(len(orders))
        stated = np.zeros(len(orders))
        mean = np.zeros(len(orders))
        for ball, turned in balls:
            sphericity = (
                self.sphericity_um
                if ball.stated_sphericity_um is None
                else ball.stated_sphericity_um
            )
            variance = np.where(orders <= 3, _OF_SPHERICITY * sphericity**2, 0.0)
            half = np.full(len(orders), 0.5)
            for order, amplitude, phase_deg in ball.harmonics_um:
                at = orders == order
                angle = order * (np.deg2rad(phase_deg) + turned)
                half[at], variance[at] = 0.0, (0.5 * (ball.U_um or 0.0)) ** 2
                mean[at] += amplitude * np.array([np.cos(angle), np.sin(angle)])
            share = share + half
            stated = stated + variance
        scaled = {"sd": np.sqrt(share), "decay": "decay", "orders": orders.astype(float)}
        return scaled | {"stated": np.sqrt(stated) * 1e-3, "mean": mean * 1e-3}

    def assumed(self, campaign: Campaign) -> Iterator[Uncertainty]:
        """Of the orders 2 and 3, beside what all orders share, and of those that a certificate
        states, their amplitudes."""
        for name in ("work", "tool"):
            ball: Ball = getattr(campaign.instrument, name)
            stated = {n: own for n, own, _ in ball.harmonics_um}
            sphericity = ball.stated_sphericity_um
            usual = np.sqrt(_OF_SPHERICITY) * (
                self.sphericity_um if sphericity is None else sphericity
            )
            for n in sorted({2, 3, *stated}) if self.law == "decay" else ():
                value, sd = (
                    (stated[n], 0.5 * (ball.U_um or 0.0)) if n in stated else (0.0, float(usual))
                )
                known = n in stated or sphericity is not None
                yield Uncertainty(f"{name}_form_{n}", value * 1e-3, sd * 1e-3, "mm", name, known)

    def is_stated(self, coefficient: str, campaign: Campaign) -> bool:
        instrument = campaign.instrument
        own = {"w": (instrument.work,), "t": (instrument.tool,)}.get(
            coefficient[0], (instrument.work, instrument.tool)
        )
        order = int(re.findall(r"\d+$", coefficient)[0])
        return all(
            b.stated_sphericity_um is not None or order in [n for n, *_ in b.harmonics_um]
            for b in own
        )

    @staticmethod
    def _ball(coefficient: str) -> str:
        return {"w": "the work ball", "t": "the tool ball"}.get(coefficient[0], "")

    @classmethod
    def describe(cls, coefficient: str) -> str:
        ball = cls._ball(coefficient)
        order = _order(coefficient)
        lobes = order.split()[1].removesuffix("θ")
        return (
            f"{ball + chr(39) + 's ' if ball else ''}{lobes}-lobe form"
            f" ({order}{_in_plane(coefficient)})"
        )

    @classmethod
    def pattern(cls, coefficient: str) -> str:
        ball = cls._ball(coefficient)
        return f" in {_order(coefficient)}{f' of {ball}' if ball else ''}{_in_plane(coefficient)}"


@dataclass(frozen=True)
class MachinePattern(Term):
    """cos nθ, sin nθ, n = 4 … 12, ω (n/6)^(−p): geometry of higher order and cyclic errors of the
    machine, the same in every test of a plane, direction and radius. Only where a ball is clocked:
    it does not turn with it; else it is one with the form."""

    stem = "pattern"
    remedy = "Run more circles with the balls clocked."
    scales = (Scale("omega", "omega_um", "ω", "pattern of the machine"), _DECAY)

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        if not setting.clocked:
            return ()
        found = []
        orders = np.repeat(np.array(_PATTERN_ORDERS, dtype=float), 2)
        for (_, plane, in_plane), (_, radius, at_radius) in itertools.product(
            setting.each("plane"), setting.each("radius")
        ):
            for travel in sorted({*setting.travels}):
                own = in_plane & at_radius & (setting.travel == travel)
                if not own.any():
                    continue
                way = f"_{TRAVEL_NAMES[travel]}" if len(setting.travels) > 1 else ""
                names = _harmonic_names(f"pattern{way}{radius}{plane}", _PATTERN_ORDERS)
                values = setting.harmonics(_PATTERN_ORDERS) * own[:, None, None]
                found.append(
                    Columns(
                        names, values, np.ones(len(names)), "omega", decay="decay", orders=orders
                    )
                )
        return tuple(found)


@dataclass(frozen=True)
class BarLength(Term):
    """1: calibration of the bar's length (ball radii, zero setting, bar temperature); another
    radius is another length. Mean and sd are those of the bar's certificate where there is one."""

    sd_um: float = 9.4  #: one sd of the bar's length
    calibration = "a calibration of the bar's length"
    remedy = "Calibrate the bar's length."
    instrument = True

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        names, own = zip(
            *((f"bar_length{radius}", own) for _, radius, own in setting.each("radius")),
            strict=True,
        )
        values = setting.constant(np.column_stack(own).astype(float))
        stated = setting.instrument
        sd = _expanded(stated.bar_U_um, self.sd_um)
        mean = np.full(len(names), stated.bar_length_error_um * 1e-3)
        return (
            Columns(
                names, values, np.full(len(names), sd * 1e-3), mean=mean if mean.any() else None
            ),
        )

    def assumed(self, campaign: Campaign) -> Iterator[Uncertainty]:
        own = campaign.instrument
        yield _assumed(
            campaign,
            "bar_length",
            "bar_U_um",
            _expanded(own.bar_U_um, self.sd_um) * 1e-3,
            own.bar_length_error_um * 1e-3,
        )

    @classmethod
    def describe(cls, coefficient: str) -> str:
        radius = coefficient.removeprefix("bar_length").removeprefix("_")
        return cls.words + (f" at R = {radius} mm" if radius else "")


def _expanded(stated: float | None, assumed: float, factor: float = 1.0) -> float:
    """Standard uncertainty of a stated expanded one (k = 2), times ``factor``; what is assumed
    where none is stated."""
    return assumed if stated is None else 0.5 * stated * factor


@dataclass(frozen=True)
class Mount(Term):
    """P: deflection of the work ball's mount per bar, known to ``relative_sd`` of its nominal value
    (Eq. 32) or as its certificate says; and a curvature, q(F) = 4 (F/F_max)(1 − F/F_max) times
    ``curvature_um`` (0: none)."""

    relative_sd: float = 0.10
    curvature_um: float = 0.5
    unit = Unit("mm/bar", 1e-3, "µm/bar")
    calibration = "a measurement of the mount's deflection"
    remedy = "Measure the mount's deflection."
    instrument = True
    common = True

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        relative = _expanded(setting.instrument.mount_U_percent, self.relative_sd, 0.01)
        sd = np.array([relative * (setting.deflection_um_per_bar * 1e-3)])
        linear = Columns(("mount",), setting.constant(setting.pressure_bar), sd)
        if not self.curvature_um:
            return (linear,)
        sd = np.array([self.curvature_um * 1e-3])
        return linear, Columns(("mount_curvature",), setting.constant(setting.bow), sd)

    def assumed(self, campaign: Campaign) -> Iterator[Uncertainty]:
        nominal = campaign.mount.deflection_um_per_bar * 1e-3
        relative = _expanded(campaign.instrument.mount_U_percent, self.relative_sd, 0.01)
        yield _assumed(campaign, "mount", "mount_U_percent", relative * nominal, nominal)
        if self.curvature_um:
            yield _assumed(campaign, "mount_curvature", "", self.curvature_um * 1e-3)

    @classmethod
    def unit_of(cls, coefficient: str) -> Unit:
        return Term.unit if coefficient == "mount_curvature" else cls.unit

    @classmethod
    def describe(cls, coefficient: str) -> str:
        return (
            "curvature of the mount's deflection"
            if coefficient == "mount_curvature"
            else "mount deflection"
        )


@dataclass(frozen=True)
class ForceError(Term):
    """F j_C·Ĉ times a gain error and F_max q(F) j_C·Ĉ times a curvature of the force law, 0 for
    none, both common to all tests; and j_C·Ĉ times a random force error of each test. Each as the
    load cell's certificate says where there is one."""

    gain_sd: float = 0.01  #: one sd, a share of the force
    curvature_sd: float = 0.01  #: one sd, a share of F_max
    random_sd_N: float = 4.0  #: of every test
    stem = ("force_gain", "force_curvature", "force_random")
    unit = Unit("1", 1e-2, "%")
    calibration = "a calibration of the force"
    remedy = "Calibrate the force."
    instrument = True
    common = True

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        deflection = (setting.wrench @ setting.compliance_estimate)[:, :, None]
        sd = self._sds(setting.instrument)
        forces = {
            "force_gain": setting.force_N,
            "force_curvature": setting.largest_force_N * setting.bow,
        }
        parts = [
            (name, force[:, None, None] * deflection)
            for name, force in forces.items()
            if name in sd
        ]
        return (
            *(Columns((name,), values, np.array([sd[name]])) for name, values in parts),
            Columns(("force_random",), deflection, np.array([sd["force_random"]]), private=True),
        )

    def _sds(self, stated: Instrument) -> dict[str, float]:
        """As it is, or as a certificate states; a linearity is a bound, each value within it as
        likely as another."""
        linearity = stated.force_linearity_percent
        random = stated.force_random_N
        curvature = self.curvature_sd if linearity is None else 0.01 * linearity / np.sqrt(3.0)
        found = {
            "force_gain": _expanded(stated.force_U_percent, self.gain_sd, 0.01),
            "force_curvature": float(curvature),
        }
        found |= {"force_random": self.random_sd_N if random is None else random}
        return {
            name: sd for name, sd in found.items() if self.curvature_sd or name != "force_curvature"
        }

    def assumed(self, campaign: Campaign) -> Iterator[Uncertainty]:
        for name, sd in self._sds(campaign.instrument).items():
            named = zip(
                self.stem,
                ("force_U_percent", "force_linearity_percent", "force_random_N"),
                strict=True,
            )
            yield _assumed(campaign, name, dict(named)[name], sd)

    @classmethod
    def unit_of(cls, coefficient: str) -> Unit:
        return Unit("N", 1.0, "N") if coefficient == "force_random" else cls.unit

    @classmethod
    def describe(cls, coefficient: str) -> str:
        return coefficient.replace("_", " ")


@dataclass(frozen=True)
class JointLoad(Term):
    """What yields to the load F u_a of its own axis a, not to the bar's force: F u_a² (F |u_a| −
    F0)/F_max, preload and rolling contact, and F^⅔ F0^⅓ |u_a|^(5/3) − F u_a², bolted contact (δ ~
    f^⅔); u the bar's direction.

    Both are zero along the axis at F0, where C_aa stays the secant compliance. One sd of each is
    ``relative_sd`` Ĉ_aa.
    """

    relative_sd: float = 0.2
    unit = Unit("mm/N", 1e-6, "nm/N")
    calibration = "a narrower prior of it"
    remedy = "Measure the axis' deflection under its own load."

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        found = []
        for axis, estimate in setting.driven_axes():
            values = self._laws(
                setting,
                setting.force_N[:, None],
                *(setting.along(axis, a) for a in (2.0, 3.0, 5.0 / 3.0)),
            )
            names = (f"joint_load_{LINEAR[axis]}_slope", f"joint_load_{LINEAR[axis]}_contact")
            found.append(Columns(names, values, np.full(2, self.relative_sd * estimate)))
        return tuple(found)

    def secants(self, setting: Setting, force_N: Array) -> Array:
        """What an axis' two coefficients add to its C_aa(F): the columns along the axis over F,
        shape (n, 2), at forces (n,)."""
        return self._laws(setting, force_N, 1.0, 1.0, 1.0) / force_N[:, None]

    def _laws(
        self,
        setting: Setting,
        force: Array,
        square: Array | float,
        cube: Array | float,
        contact: Array | float,
    ) -> Array:
        """Both columns from u², |u|³ and |u|^(5/3), shape (..., 2)."""
        middle = setting.reference_force_N
        own = force * (force * cube - middle * square) / setting.largest_force_N
        return np.stack([own, np.cbrt(force**2 * middle) * contact - force * square], axis=-1)

    @classmethod
    def describe(cls, coefficient: str) -> str:
        axis, kind = coefficient.removeprefix("joint_load_").split("_")
        return f"{'stiffening' if kind == 'slope' else 'contact'} of axis {axis} under its own load"


@dataclass(frozen=True)
class Position(Term):
    """F u_a³ and F (u_a⁴ − u_a²/2): compliance of axis a changes along its travel, screw and
    guideway being stiffer near their bearings. One sd is ``linear_sd`` Ĉ_aa and ``quadratic_sd``
    Ĉ_aa; u the bar's direction."""

    linear_sd: float = 0.07
    quadratic_sd: float = 0.04
    unit = Unit("mm/N", 1e-6, "nm/N")
    calibration = "a narrower prior of it"
    remedy = "Run circles at several centres."

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        force = setting.force_N[:, None]
        found = []
        for axis, estimate in setting.driven_axes():
            linear = setting.along(axis, 3.0, signed=True)
            quadratic = setting.along(axis, 4.0) - 0.5 * setting.along(axis, 2.0)
            names = (f"position_{LINEAR[axis]}_linear", f"position_{LINEAR[axis]}_quadratic")
            sd = np.array([self.linear_sd, self.quadratic_sd]) * estimate
            found.append(Columns(names, np.stack([force * linear, force * quadratic], axis=2), sd))
        return tuple(found)

    @classmethod
    def describe(cls, coefficient: str) -> str:
        axis, kind = coefficient.removeprefix("position_").split("_")
        return f"{kind} change of the compliance along {axis}"


@dataclass(frozen=True)
class Angle(Term):
    """dρ/dθ of the fitted circle, F j_C·Ĉ + j_G·Ê, once for all tests and once times the direction
    of travel: angle reference and lag of the trace. Tests that state no direction count as
    clockwise."""

    sd_deg: float = 0.1
    unit = Unit("rad", np.pi / 180.0, "°")
    calibration = "a check of the angle's reference"
    remedy = "Check the angle's reference and the lag of the trace."
    instrument = True

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        slope = derivative(setting.fitted)
        lag = slope * setting.travel[:, None]
        sd = np.deg2rad(_expanded(setting.instrument.angle_U_deg, self.sd_deg))
        return (
            Columns(
                ("angle_reference", "angle_lag"), np.stack([slope, lag], axis=2), np.full(2, sd)
            ),
        )

    def assumed(self, campaign: Campaign) -> Iterator[Uncertainty]:
        sd = float(np.deg2rad(_expanded(campaign.instrument.angle_U_deg, self.sd_deg)))
        for name in ("angle_reference", "angle_lag"):
            yield _assumed(campaign, name, "angle_U_deg", sd)

    @classmethod
    def describe(cls, coefficient: str) -> str:
        return coefficient.replace("_", " ")


@dataclass(frozen=True)
class SetupShift(Term):
    """1, cos θ, sin θ, separate for every test: zero (order 0) and centre (order 1) move between
    circles by δ.

    ``moves`` says whether both have one scale δ, each its own, δ_0 and δ_1, or one moves alone,
    with δ.
    """

    moves: Moves = "together"
    words = "set-up shift"
    remedy = "Run more circles: zero and centre move from one to the next."

    @property
    def scales(self) -> tuple[Scale, ...]:
        if self.moves != "apart":
            return (Scale("delta", "delta_um", "δ", "set-up shift"),)
        return tuple(
            Scale(f"delta_{n}", "delta_um", "δ", f"set-up shift of order {n}") for n in (0, 1)
        )

    def columns(self, setting: Setting) -> tuple[BasisNoise, ...]:
        zero = np.where(ORDERS == 0, 1.0, 0.0)
        centre = np.where(ORDERS == 1, 1.0, 0.0)
        circle = setting.circle
        if self.moves == "apart":
            return BasisNoise("delta_0", zero, circle), BasisNoise("delta_1", centre, circle)
        return (
            BasisNoise(
                "delta",
                {"together": zero + centre, "zero": zero, "centre": centre}[self.moves],
                circle,
            ),
        )


@dataclass(frozen=True)
class Discrepancy(Term):
    """cos nθ, sin nθ, n = 2 … 12, separate for every test: model inadequacy and run-to-run change,
    κ/n^decay."""

    decay: float = 1.0
    remedy = "Run more circles: what differs from one to the next averages out."
    scales = (Scale("kappa", "kappa_um", "κ", "discrepancy"),)

    def columns(self, setting: Setting) -> tuple[BasisNoise, ...]:
        sd = np.where(ORDERS >= 2, np.maximum(ORDERS, 1.0) ** -self.decay, 0.0)
        return (BasisNoise("kappa", sd, setting.circle),)


@dataclass(frozen=True)
class CircleScale(Term):
    """λ of every circle, which scales its set-up shift and its discrepancy, λ² ~ InvGamma(3/2,
    3/2): circles scatter as Student's t with three degrees of freedom, so that an odd one does not
    move the compliances. Off with fewer than four tests."""

    stem = "lambda"
    words = "scale of a circle"
    remedy = "Repeat the odd circle."

    def scales_in(self, setting: Setting) -> tuple[Scale, ...]:
        names = dict.fromkeys(name for name in setting.circle.tolist() if name)
        return tuple(
            Scale(name, 1.0, "λ", f"scale of {name.removeprefix('lambda_')}", "circle")
            for name in names
        )

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        return ()


@dataclass(frozen=True)
class Hysteresis(Term):
    """s cos nθ, s sin nθ, n = 0 … 12, s = ±1 the sign of travel: what differs between the two
    directions (ISO 230-4).

    A constant part (backlash, reversal spikes, servo mismatch), η/n, η at order 0, and one in
    proportion to force (friction in the bar, lost motion), ``proportional_um_per_kN``/n; a set of
    each for every plane. Active where a plane is run both ways; in one direction it looks like
    machine. With ``law`` fixed orders end at 4 and ``constant_um`` stands for η (first edition).
    """

    constant_um: float = 2.0
    proportional_um_per_kN: float = 2.0
    law: Literal["sampled", "fixed"] = "sampled"
    calibration = "a narrower prior of it"
    remedy = "Run both directions at the same forces."

    @property
    def scales(self) -> tuple[Scale, ...]:
        return (Scale("eta", "eta_um", "η", "hysteresis"),) if self.law == "sampled" else ()

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        eta, size, last = (
            ("eta", 1.0, MAX_ORDER)
            if self.law == "sampled"
            else (None, self.constant_um * 1e-3, _TRAVEL_ORDERS)
        )
        suffixes = ("0", *(f"{trig}{n}" for n in range(1, last + 1) for trig in ("cos", "sin")))
        count = len(suffixes)
        spread = 1.0 / np.maximum(ORDERS[:count], 1.0)
        found = []
        for plane, stem, own in setting.each("plane"):
            if plane not in setting.both_ways:
                continue
            values = np.zeros((setting.tests, SIZE, count))
            values[:, np.arange(count), np.arange(count)] = np.where(own, setting.travel, 0.0)[
                :, None
            ]
            parts = (
                ("hysteresis", values, size, eta),
                (
                    "hysteresis_force",
                    values * setting.force_N[:, None, None],
                    self.proportional_um_per_kN * 1e-6,
                    None,
                ),
            )
            found += [
                Columns(tuple(f"{part}{stem}_{n}" for n in suffixes), own, sd * spread, hyper)
                for part, own, sd, hyper in parts
            ]
        return tuple(found)

    @classmethod
    def unit_of(cls, coefficient: str) -> Unit:
        return (
            Unit("mm/N", 1e-6, "µm/kN") if coefficient.startswith("hysteresis_force") else cls.unit
        )

    @classmethod
    def describe(cls, coefficient: str) -> str:
        force = " in proportion to force" if coefficient.startswith("hysteresis_force") else ""
        return f"hysteresis{force} ({_order(coefficient)}{_in_plane(coefficient)})"

    @classmethod
    def pattern(cls, coefficient: str) -> str:
        force = " times force" if coefficient.startswith("hysteresis_force") else ""
        return f" in {_order(coefficient)}{force}{_in_plane(coefficient)}"


@dataclass(frozen=True)
class Drift(Term):
    """u, u B̂: the bar's length and the circle's centre change in proportion to time or temperature
    u, from the campaign's mean.

    Off by default: `SetupShift` covers what changes between circles at random. ``over`` is
    ``time_s`` or ``temperature_C`` of the tests, ``length_um`` and ``centre_um`` one sd per hour or
    kelvin. A steel bar of 150 mm grows by 1.7 µm/K.
    """

    over: Covariate = "time"
    length_um: float = 2.0
    centre_um: float = 5.0
    on_demand = True
    remedy = "Run the forces in an order that has nothing to do with time."

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        change = setting.time_h if self.over == "time" else setting.temperature_K
        field = "time_s" if self.over == "time" else "temperature_C"
        lacking = int(np.sum(~np.isfinite(change)))
        cure = f"got {lacking} without. Record it, or leave the term Drift out."
        require(not lacking, f"drift over {self.over} must have {field} in every test, {cure}")
        axes = [k for k in range(3) if np.any(setting.direction[:, :, k])]
        values = np.concatenate(
            [setting.constant(change), setting.direction[:, :, axes] * change[:, None, None]],
            axis=2,
        )
        names = (f"drift_{self.over}_length", *(f"drift_{self.over}_{LINEAR[k]}" for k in axes))
        return (
            Columns(
                names, values, np.array([self.length_um, *[self.centre_um] * len(axes)]) * 1e-3
            ),
        )

    @classmethod
    def unit_of(cls, coefficient: str) -> Unit:
        per = "h" if coefficient.startswith("drift_time") else "K"
        return Unit(f"mm/{per}", 1e-3, f"µm/{per}")

    @classmethod
    def describe(cls, coefficient: str) -> str:
        over, what = coefficient.removeprefix("drift_").split("_")
        return (
            "drift of"
            f" {'the bar' + chr(39) + 's length' if what == 'length' else f'the centre along {what}'}"
            f" over {over}"
        )


def first_edition() -> tuple[Term, ...]:
    """Return the nuisances of the model's first edition: form of 1/n, linear springs, circles of
    one scatter."""
    springs = (BarLength(), Mount(curvature_um=0.0), ForceError(curvature_sd=0.0))
    return (BallForm(law="1/n"), *springs, SetupShift(), Discrepancy(), Hysteresis(law="fixed"))
