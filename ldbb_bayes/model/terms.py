"""The nuisance terms, each one class: its columns in the circle's basis, its scales, its unit and its words.

ρ_r(θ) = F_r Σ_k (F_r − F0)^k j_C·C_k + j_G·E + terms + ε. A column of test r is its 25 basis coefficients; a term's columns are
shared by all tests or stand for each test apart. A term of your own is one more class derived from `Term`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError, check_known, require
from ldbb_bayes.machine.chain import LINEAR
from ldbb_bayes.model.fourier import MAX_ORDER, ORDERS, SIZE, Setting

__all__ = [
    "NOISE",
    "OWN",
    "BallForm",
    "BarLength",
    "BasisNoise",
    "Columns",
    "Covariate",
    "Discrepancy",
    "Drift",
    "ForceError",
    "Hyper",
    "Hysteresis",
    "Mount",
    "Moves",
    "Scale",
    "SetupShift",
    "Term",
    "Unit",
]

Array = NDArray[Any]
Hyper = str
# Whose a coefficient is that is no term's: of the parameters of interest, of the white noise of readings.
OWN, NOISE = "Parameters", "ReadingNoise"


class Scale(NamedTuple):
    """A hyper-parameter: the sd, in mm, of what it scales, with a half-normal prior whose scale [µm] is ``prior_um``, or the
    field of `Prior` of that name. Results add ``_um`` to its name; ``symbol`` and ``words`` are for reading."""

    name: Hyper
    prior_um: float | str
    symbol: str = ""
    words: str = ""


class Unit(NamedTuple):
    """A coefficient's unit: in files and results; the size of one for reading, and what that is called."""

    inside: str
    one: float
    label: str


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of one term with their Gaussian prior.

    Attributes
    ----------
    names : tuple of str
        Of the p coefficients; they begin with the term's ``stem``.
    values : ndarray, shape (tests, 25, p)
    sd, mean : ndarray, shape (p,)
        Prior sd, in units of ``hyper`` where one is named, infinite for a flat prior; prior mean of shared coefficients, zero
        unless given.
    hyper : str, optional
        The hyper-parameter that scales ``sd``.
    private : bool
        True when every test has its own copy of each coefficient.

    Raises
    ------
    InputError
        For shapes that do not go together.
    """

    names: tuple[str, ...]
    values: Array
    sd: Array
    hyper: Hyper | None = None
    private: bool = False
    mean: Array | None = None

    def __post_init__(self) -> None:
        p = len(self.names)
        require(
            self.values.shape[1:] == (SIZE, p) and self.sd.shape == (p,),
            f"columns of {', '.join(self.names)} must have values of shape (tests, {SIZE}, {p}) and sd of shape ({p},), "
            f"got {self.values.shape} and {self.sd.shape}. Give one of each for every name.",
        )

    def draw(self, phi: Mapping[Hyper, float], tests: int, rng: np.random.Generator) -> Array:
        """What one draw from the prior at φ adds to the readings' coefficients, shape (tests, 25) [mm]."""
        sd = self.sd * (phi[self.hyper] if self.hyper else 1.0)
        drawn = sd * rng.standard_normal((tests if self.private else 1, len(sd)))
        drawn = drawn if self.mean is None else drawn + self.mean
        return np.einsum("tkq,tq->tk", self.values, np.broadcast_to(drawn, (tests, len(sd))))


@dataclass(frozen=True, eq=False)
class BasisNoise:
    """Independent coefficients on the basis itself, separate for every test: sd = hyper · ``sd`` (25,)."""

    hyper: Hyper
    sd: Array

    def draw(self, phi: Mapping[Hyper, float], tests: int, rng: np.random.Generator) -> Array:
        """One draw of them, shape (tests, 25) [mm]."""
        return phi[self.hyper] * self.sd * rng.standard_normal((tests, SIZE))


class Term:
    """A nuisance of the readings. Derive a frozen dataclass to have one of your own in fits, results, designs and model files.

    Its fields are its settings, positive numbers or strings, and its keys under ``[terms]`` of a model file; its class name is
    its name everywhere. Only `columns` has to be written; the rest has defaults.

    Attributes
    ----------
    stem : str or tuple of str
        What the names of its coefficients begin with; default: the class name, ball_form for BallForm.
    unit : Unit
        Of its coefficients.
    words : str
        What it is called; default: ball form for BallForm.
    calibration, remedy : str
        What supplies it, as a noun and as advice.
    instrument : bool
        Whether it belongs to bar, balls, mount or force device, and is the same wherever these are.
    common : bool
        Whether fleets take its coefficient, the same in all campaigns of one instrument, as one; others are taken anew in each.
    on_demand : bool
        Whether models have it only when asked to.

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
    stem: ClassVar[str | tuple[str, ...]]
    words: ClassVar[str]
    unit: ClassVar[Unit] = Unit("mm", 1e-3, "µm")
    calibration: ClassVar[str] = "a measurement of it"
    remedy: ClassVar[str] = "Measure it, or narrow its prior."
    instrument: ClassVar[bool] = False
    common: ClassVar[bool] = False
    on_demand: ClassVar[bool] = True

    def __init_subclass__(cls) -> None:
        other = Term.kinds.get(cls.__name__)
        if other is not None and other.__module__ != cls.__module__:
            raise InputError(f"a term must have a name of its own, got {cls.__name__}, which {other.__module__} has. Rename it.")
        spaced = re.sub(r"(?<!^)(?=[A-Z])", " ", cls.__name__).lower()
        cls.stem = vars(cls).get("stem", spaced.replace(" ", "_"))
        cls.words = vars(cls).get("words", spaced)
        Term.kinds[cls.__name__] = cls

    def __post_init__(self) -> None:
        hints: dict[str, Any] = {}
        with suppress(NameError):
            hints = get_type_hints(type(self))
        for name, value in vars(self).items():
            what = f"{type(self).__name__} {name}"
            if get_origin(hints.get(name)) is Literal:
                check_known(what, [value], get_args(hints[name]))
            elif not isinstance(value, str | bool) and not (np.isfinite(value) and value > 0):
                raise InputError(f"{what} must be a positive number, got {value}. To drop the term, leave it out.")

    @property
    def scales(self) -> tuple[Scale, ...]:
        """Its hyper-parameters."""
        return ()

    def columns(self, setting: Setting) -> tuple[Columns | BasisNoise, ...]:
        """Its columns in a setting; none where it does not act."""
        raise NotImplementedError(f"{type(self).__name__} must have a method columns(setting)")

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


@dataclass(frozen=True)
class BallForm(Term):
    """cos n(θ − ψ), sin n(θ − ψ), n = 2 … 12: form error of the balls, τ/n per coefficient, the same at every force.

    While no ball is clocked the two forms are one sum. As soon as a clocking differs between tests there are two terms,
    the work ball at θ − ψ_work and the tool ball, touched on its far side, at θ + 180° − ψ_tool, each with τ/(n √2). Every plane
    runs over another great circle of the balls: it has forms of its own.
    """

    stem = ("form", "work_form", "tool_form")
    calibration = "a calibration of the balls' form"
    remedy = "Clock both balls (not by 180° alone), or measure a second radius."
    instrument = True
    on_demand = False

    @property
    def scales(self) -> tuple[Scale, ...]:
        return (Scale("tau", "tau_um", "τ", "ball form"),)

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        balls = [("form", setting.work_ball_rad, 1.0)]
        if setting.two_balls:
            half = 1.0 / np.sqrt(2.0)
            balls = [("work_form", setting.work_ball_rad, half), ("tool_form", setting.tool_ball_rad - np.pi, half)]
        return tuple(
            Columns(
                tuple(f"{stem}{plane}_{trig}{n}" for n in _FORM_ORDERS for trig in ("cos", "sin")),
                setting.harmonics(_FORM_ORDERS, turned) * own[:, None, None],
                share / np.repeat(np.array(_FORM_ORDERS, dtype=float), 2),
                "tau",
            )
            for _, plane, own in setting.each("plane")
            for stem, turned, share in balls
        )

    @staticmethod
    def _ball(coefficient: str) -> str:
        return {"w": "the work ball", "t": "the tool ball"}.get(coefficient[0], "")

    @classmethod
    def describe(cls, coefficient: str) -> str:
        ball, order = cls._ball(coefficient), _order(coefficient)
        lobes = order.split()[1].removesuffix("θ")
        return f"{ball + chr(39) + 's ' if ball else ''}{lobes}-lobe form ({order}{_in_plane(coefficient)})"

    @classmethod
    def pattern(cls, coefficient: str) -> str:
        ball = cls._ball(coefficient)
        return f" in {_order(coefficient)}{f' of {ball}' if ball else ''}{_in_plane(coefficient)}"


@dataclass(frozen=True)
class BarLength(Term):
    """1: calibration of the bar's length (ball radii, zero setting, bar temperature); another radius is another length."""

    sd_um: float = 9.4
    calibration = "a calibration of the bar's length"
    remedy = "Calibrate the bar's length."
    instrument = True
    on_demand = False

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        names, own = zip(*((f"bar_length{radius}", own) for _, radius, own in setting.each("radius")), strict=True)
        values = setting.constant(np.column_stack(own).astype(float))
        return (Columns(names, values, np.full(len(names), self.sd_um * 1e-3)),)

    @classmethod
    def describe(cls, coefficient: str) -> str:
        radius = coefficient.removeprefix("bar_length").removeprefix("_")
        return cls.words + (f" at R = {radius} mm" if radius else "")


@dataclass(frozen=True)
class Mount(Term):
    """P: deflection of the work ball's mount per bar, known to ``relative_sd`` of its nominal value (Eq. 32)."""

    relative_sd: float = 0.10
    unit = Unit("mm/bar", 1e-3, "µm/bar")
    calibration = "a measurement of the mount's deflection"
    remedy = "Measure the mount's deflection."
    instrument = True
    common = True
    on_demand = False

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        sd = np.array([self.relative_sd * (setting.deflection_um_per_bar * 1e-3)])
        return (Columns(("mount",), setting.constant(setting.pressure_bar), sd),)

    @classmethod
    def describe(cls, coefficient: str) -> str:
        return "mount deflection"


@dataclass(frozen=True)
class ForceError(Term):
    """F j_C·Ĉ times a gain error common to all tests, and j_C·Ĉ times a random force error of each test."""

    gain_sd: float = 0.01
    random_sd_N: float = 4.0
    stem = ("force_gain", "force_random")
    unit = Unit("1", 1e-2, "%")
    calibration = "a calibration of the force"
    remedy = "Calibrate the force."
    instrument = True
    common = True
    on_demand = False

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        deflection = (setting.wrench @ setting.compliance_estimate)[:, :, None]
        gain = setting.force_N[:, None, None] * deflection
        return (
            Columns(("force_gain",), gain, np.array([self.gain_sd])),
            Columns(("force_random",), deflection, np.array([self.random_sd_N]), private=True),
        )

    @classmethod
    def unit_of(cls, coefficient: str) -> Unit:
        return Unit("N", 1.0, "N") if coefficient == "force_random" else cls.unit

    @classmethod
    def describe(cls, coefficient: str) -> str:
        return coefficient.replace("_", " ")


@dataclass(frozen=True)
class SetupShift(Term):
    """1, cos θ, sin θ, separate for every test: zero (order 0) and centre (order 1) move between circles by δ.

    ``moves`` says whether both have one scale δ, each its own, δ_0 and δ_1, or one moves alone, with δ.
    """

    moves: Moves = "together"
    words = "set-up shift"
    remedy = "Run more circles: zero and centre move from one to the next."
    on_demand = False

    @property
    def scales(self) -> tuple[Scale, ...]:
        if self.moves != "apart":
            return (Scale("delta", "delta_um", "δ", "set-up shift"),)
        return tuple(Scale(f"delta_{n}", "delta_um", "δ", f"set-up shift of order {n}") for n in (0, 1))

    def columns(self, setting: Setting) -> tuple[BasisNoise, ...]:
        zero, centre = np.where(ORDERS == 0, 1.0, 0.0), np.where(ORDERS == 1, 1.0, 0.0)
        if self.moves == "apart":
            return BasisNoise("delta_0", zero), BasisNoise("delta_1", centre)
        return (BasisNoise("delta", {"together": zero + centre, "zero": zero, "centre": centre}[self.moves]),)


@dataclass(frozen=True)
class Discrepancy(Term):
    """cos nθ, sin nθ, n = 2 … 12, separate for every test: model inadequacy and run-to-run change, κ/n^decay."""

    decay: float = 1.0
    remedy = "Run more circles: what differs from one to the next averages out."
    on_demand = False

    @property
    def scales(self) -> tuple[Scale, ...]:
        return (Scale("kappa", "kappa_um", "κ", "discrepancy"),)

    def columns(self, setting: Setting) -> tuple[BasisNoise, ...]:
        return (BasisNoise("kappa", np.where(ORDERS >= 2, np.maximum(ORDERS, 1.0) ** -self.decay, 0.0)),)


@dataclass(frozen=True)
class Hysteresis(Term):
    """s, s cos nθ, s sin nθ, n = 1 … 4, s = ±1 the sign of travel: what differs between the two directions (ISO 230-4).

    A constant part (backlash, reversal of the axes, servo lag) and one in proportion to force (friction in the bar, lost motion),
    a set of each for every plane. Active where a plane is run both ways; in one direction it looks like machine.

    One sd of the former is ``constant_um``/n, of the latter ``proportional_um_per_kN``/n.
    """

    constant_um: float = 2.0
    proportional_um_per_kN: float = 2.0
    calibration = "a narrower prior of it"
    remedy = "Run both directions at the same forces."
    on_demand = False

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        count = 2 * _TRAVEL_ORDERS + 1
        suffixes = ("0", *(f"{trig}{n}" for n in range(1, _TRAVEL_ORDERS + 1) for trig in ("cos", "sin")))
        spread = 1.0 / np.maximum(ORDERS[:count], 1.0)
        found = []
        for plane, stem, own in setting.each("plane"):
            if plane not in setting.both_ways:
                continue
            values = np.zeros((setting.tests, SIZE, count))
            values[:, np.arange(count), np.arange(count)] = np.where(own, setting.travel, 0.0)[:, None]
            parts = (
                ("hysteresis", values, self.constant_um * 1e-3),
                ("hysteresis_force", values * setting.force_N[:, None, None], self.proportional_um_per_kN * 1e-6),
            )
            found += [Columns(tuple(f"{part}{stem}_{n}" for n in suffixes), own, sd * spread) for part, own, sd in parts]
        return tuple(found)

    @classmethod
    def unit_of(cls, coefficient: str) -> Unit:
        return Unit("mm/N", 1e-6, "µm/kN") if coefficient.startswith("hysteresis_force") else cls.unit

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
    """u, u B̂: the bar's length and the circle's centre change in proportion to time or temperature u, from the campaign's mean.

    Off by default: `SetupShift` covers what changes between circles at random. ``over`` is ``time_s`` or ``temperature_C`` of the
    tests, ``length_um`` and ``centre_um`` one sd per hour or kelvin. A steel bar of 150 mm grows by 1.7 µm/K.
    """

    over: Covariate = "time"
    length_um: float = 2.0
    centre_um: float = 5.0
    remedy = "Run the forces in an order that has nothing to do with time."

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        change = setting.time_h if self.over == "time" else setting.temperature_K
        field, lacking = "time_s" if self.over == "time" else "temperature_C", int(np.sum(~np.isfinite(change)))
        cure = f"got {lacking} without. Record it, or leave the term Drift out."
        require(not lacking, f"drift over {self.over} must have {field} in every test, {cure}")
        axes = [k for k in range(3) if np.any(setting.direction[:, :, k])]
        values = np.concatenate([setting.constant(change), setting.direction[:, :, axes] * change[:, None, None]], axis=2)
        names = (f"drift_{self.over}_length", *(f"drift_{self.over}_{LINEAR[k]}" for k in axes))
        return (Columns(names, values, np.array([self.length_um, *[self.centre_um] * len(axes)]) * 1e-3),)

    @classmethod
    def unit_of(cls, coefficient: str) -> Unit:
        per = "h" if coefficient.startswith("drift_time") else "K"
        return Unit(f"mm/{per}", 1e-3, f"µm/{per}")

    @classmethod
    def describe(cls, coefficient: str) -> str:
        over, what = coefficient.removeprefix("drift_").split("_")
        return f"drift of {'the bar' + chr(39) + 's length' if what == 'length' else f'the centre along {what}'} over {over}"
