"""The terms of the model: each a frozen value that answers, for a given setting, with columns in the circle's basis.

ρ_r(θ) = F_r Σ_k (F_r − F0)^k j_C·C_k + j_G·E + nuisances + ε. A column of test r is its 25 basis coefficients; a term's
columns are shared by all tests or stand for each test apart.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.machine.chain import LINEAR
from ldbb_bayes.model.basis import MAX_ORDER, ORDERS, SIZE, harmonic_index
from ldbb_bayes.model.columns import BasisNoise, Columns, Hyper
from ldbb_bayes.model.setting import Setting

__all__ = [
    "BallForm",
    "BarLength",
    "Compliance",
    "Covariate",
    "Discrepancy",
    "Drift",
    "ForceError",
    "GeometricErrors",
    "Hysteresis",
    "Mount",
    "Moves",
    "SetupShift",
]

Array = NDArray[Any]
Moves = Literal["together", "apart", "zero", "centre"]
Covariate = Literal["time", "temperature"]
_TRAVEL_ORDERS = 4
FORM_ORDERS = range(2, MAX_ORDER + 1)


@dataclass(frozen=True)
class Compliance:
    """F (F − F0)^k j_C, k = 0 … degree (Eq. 22, 33)."""

    degree: int = 1

    def columns(self, setting: Setting) -> tuple[Array, ...]:
        """One array (tests, 25, compliances) per degree [mm per unit of the parameter]."""
        lever = setting.force_N - setting.reference_force_N
        return tuple((setting.force_N * lever**k)[:, None, None] * setting.wrench for k in range(self.degree + 1))


@dataclass(frozen=True)
class GeometricErrors:
    """j_G, the same at every force (Eq. 16-18)."""

    def columns(self, setting: Setting) -> Array:
        """Array (tests, 25, geometric errors) [mm per unit of the parameter]."""
        return setting.geometric


@dataclass(frozen=True)
class BallForm:
    """cos n(θ − ψ), sin n(θ − ψ), n = 2 … 12: form error of the balls, τ/n per coefficient, the same at every force.

    While no ball is clocked the two forms are one sum. As soon as a clocking differs between tests there are two terms,
    the work ball at θ − ψ_work and the tool ball, touched on its far side, at θ + 180° − ψ_tool, each with τ/(n √2). Every plane
    runs over another great circle of the balls: it has forms of its own.
    """

    @property
    def hypers(self) -> tuple[Hyper, ...]:
        """τ."""
        return ("tau",)

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Columns, hyper-parameter τ [mm]."""
        half = 1.0 / np.sqrt(2.0)
        found = []
        for _, stem, own in _by_plane(setting):
            if not setting.two_balls:
                found.append(self._ball(f"form{stem}", setting.work_ball_rad, 1.0, own))
                continue
            found.append(self._ball(f"work_form{stem}", setting.work_ball_rad, half, own))
            found.append(self._ball(f"tool_form{stem}", setting.tool_ball_rad - np.pi, half, own))
        return tuple(found)

    @staticmethod
    def _ball(stem: str, clocking_rad: Array, share: float, own: Array) -> Columns:
        values = np.zeros((len(clocking_rad), SIZE, 2 * len(FORM_ORDERS)))
        names: list[str] = []
        for j, n in enumerate(FORM_ORDERS):
            c, s = harmonic_index(n)
            turn = n * np.remainder(clocking_rad, 2 * np.pi)
            values[:, c, 2 * j], values[:, s, 2 * j] = np.cos(turn), np.sin(turn)
            values[:, c, 2 * j + 1], values[:, s, 2 * j + 1] = -np.sin(turn), np.cos(turn)
            names += [f"{stem}_cos{n}", f"{stem}_sin{n}"]
        values[np.abs(values) < 1e-14] = 0.0
        values[~own] = 0.0
        sd = share / np.repeat(np.array(FORM_ORDERS, dtype=float), 2)
        return Columns(tuple(names), values, sd, "tau")


@dataclass(frozen=True)
class BarLength:
    """1: calibration of the bar's length (ball radii, zero setting, bar temperature); another radius is another length."""

    sd_um: float = 9.4

    def __post_init__(self) -> None:
        _check_positive(self)

    @property
    def hypers(self) -> tuple[Hyper, ...]:
        """None."""
        return ()

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """One shared column per radius [1]."""
        radii = setting.radii_mm
        values = np.zeros((setting.tests, SIZE, len(radii)))
        values[:, 0, :] = setting.radius_mm[:, None] == radii
        names = ("bar_length",) if len(radii) == 1 else tuple(f"bar_length_{radius:g}" for radius in radii)
        return (Columns(names, values, np.full(len(radii), self.sd_um * 1e-3)),)


@dataclass(frozen=True)
class Mount:
    """P: deflection of the work ball's mount per bar, known to ``relative_sd`` of its nominal value (Eq. 32)."""

    relative_sd: float = 0.10

    def __post_init__(self) -> None:
        _check_positive(self)

    @property
    def hypers(self) -> tuple[Hyper, ...]:
        """None."""
        return ()

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """One shared column [bar]; mean nominal when the readings are not compensated, 0 when they are."""
        values = np.zeros((setting.tests, SIZE, 1))
        values[:, 0, 0] = setting.pressure_bar
        nominal = setting.deflection_um_per_bar * 1e-3
        mean = 0.0 if setting.compensated else nominal
        return (Columns(("mount",), values, np.array([self.relative_sd * nominal]), mean=np.array([mean])),)


@dataclass(frozen=True)
class ForceError:
    """F j_C·Ĉ times a gain error common to all tests, and j_C·Ĉ times a random force error of each test."""

    gain_sd: float = 0.01
    random_sd_N: float = 4.0

    def __post_init__(self) -> None:
        _check_positive(self)

    @property
    def hypers(self) -> tuple[Hyper, ...]:
        """None."""
        return ()

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """One shared column [mm] and one column per test [mm/N]."""
        deflection = (setting.wrench @ setting.compliance_estimate)[:, :, None]
        gain = setting.force_N[:, None, None] * deflection
        return (
            Columns(("force_gain",), gain, np.array([self.gain_sd])),
            Columns(("force_random",), deflection, np.array([self.random_sd_N]), private=True),
        )


@dataclass(frozen=True)
class SetupShift:
    """1, cos θ, sin θ, separate for every test: zero (order 0) and centre (order 1) move between circles by δ.

    Parameters
    ----------
    moves : {"together", "apart", "zero", "centre"}
        Both with one scale δ; both, each with its own, δ_0 and δ_1; or one of them alone, with δ.
    """

    moves: Moves = "together"

    def __post_init__(self) -> None:
        check_known("SetupShift moves", [self.moves], get_args(Moves))

    @property
    def hypers(self) -> tuple[Hyper, ...]:
        """δ, or δ_0 and δ_1."""
        return ("delta_0", "delta_1") if self.moves == "apart" else ("delta",)

    def columns(self, setting: Setting) -> tuple[BasisNoise, ...]:
        """Coefficients of order 0 and 1 [mm]."""
        zero, centre = np.where(ORDERS == 0, 1.0, 0.0), np.where(ORDERS == 1, 1.0, 0.0)
        if self.moves == "apart":
            return BasisNoise("delta_0", zero), BasisNoise("delta_1", centre)
        return (BasisNoise("delta", {"together": zero + centre, "zero": zero, "centre": centre}[self.moves]),)


@dataclass(frozen=True)
class Discrepancy:
    """cos nθ, sin nθ, n = 2 … 12, separate for every test: model inadequacy and run-to-run change, κ/n^decay."""

    decay: float = 1.0

    def __post_init__(self) -> None:
        _check_positive(self)

    @property
    def hypers(self) -> tuple[Hyper, ...]:
        """κ."""
        return ("kappa",)

    def columns(self, setting: Setting) -> tuple[BasisNoise, ...]:
        """Coefficients of order 2 to 12, hyper-parameter κ [mm]."""
        return (BasisNoise("kappa", np.where(ORDERS >= 2, np.maximum(ORDERS, 1.0) ** -self.decay, 0.0)),)


@dataclass(frozen=True)
class Hysteresis:
    """s, s cos nθ, s sin nθ, n = 1 … 4, s = ±1 the sign of travel: what differs between the two directions (ISO 230-4).

    A constant part (backlash, reversal of the axes, servo lag) and one in proportion to force (friction in the bar, lost motion),
    a set of each for every plane. Active where a plane is run both ways; in one direction it looks like machine.

    Parameters
    ----------
    constant_um : float
        One sd of the constant part [µm], divided by n.
    proportional_um_per_kN : float
        One sd of the part in proportion to force [µm/kN], divided by n.
    """

    constant_um: float = 2.0
    proportional_um_per_kN: float = 2.0

    def __post_init__(self) -> None:
        _check_positive(self)

    @property
    def hypers(self) -> tuple[Hyper, ...]:
        """None."""
        return ()

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Columns [1] and [N]."""
        count = 2 * _TRAVEL_ORDERS + 1
        spread = 1.0 / np.maximum(ORDERS[:count], 1.0)
        found = []
        for plane, stem, own in _by_plane(setting):
            if plane not in setting.both_ways:
                continue
            values = np.zeros((setting.tests, SIZE, count))
            values[:, np.arange(count), np.arange(count)] = np.where(own, setting.travel, 0.0)[:, None]
            names = ("0", *(f"{trig}{n}" for n in range(1, _TRAVEL_ORDERS + 1) for trig in ("cos", "sin")))
            found.append(Columns(tuple(f"hysteresis{stem}_{n}" for n in names), values, self.constant_um * 1e-3 * spread))
            force = values * setting.force_N[:, None, None]
            sd = self.proportional_um_per_kN * 1e-6 * spread
            found.append(Columns(tuple(f"hysteresis_force{stem}_{n}" for n in names), force, sd))
        return tuple(found)


@dataclass(frozen=True)
class Drift:
    """u, u B̂: the bar's length and the circle's centre change in proportion to time or temperature u, from the campaign's mean.

    Off by default: `SetupShift` covers what changes between circles at random.

    Parameters
    ----------
    over : {"time", "temperature"}
        ``time_s`` or ``temperature_C`` of the tests.
    length_um, centre_um : float
        One sd, per hour or per kelvin. A steel bar of 150 mm grows by 1.7 µm/K.
    """

    over: Covariate = "time"
    length_um: float = 2.0
    centre_um: float = 5.0

    def __post_init__(self) -> None:
        check_known("Drift over", [self.over], get_args(Covariate))
        _check_positive(self)

    @property
    def hypers(self) -> tuple[Hyper, ...]:
        """None."""
        return ()

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """One shared column of length and one per direction of the centre [h or K].

        Raises
        ------
        InputError
            Where tests do not record it, or all at the same value.
        """
        change = setting.time_h if self.over == "time" else setting.temperature_K
        if not np.isfinite(change).all():
            field = "time_s" if self.over == "time" else "temperature_C"
            raise InputError(
                f"drift over {self.over} must have {field} in every test, got {int(np.sum(~np.isfinite(change)))} without. "
                "Record it, or leave the term Drift out."
            )
        axes = [k for k in range(3) if np.any(setting.direction[:, :, k])]
        values = setting.direction[:, :, axes] * change[:, None, None]
        length = np.zeros((setting.tests, SIZE, 1))
        length[:, 0, 0] = change
        names = (f"drift_{self.over}_length", *(f"drift_{self.over}_{LINEAR[k]}" for k in axes))
        sd = np.array([self.length_um, *[self.centre_um] * len(axes)]) * 1e-3
        return (Columns(names, np.concatenate([length, values], axis=2), sd),)


def _by_plane(setting: Setting) -> Iterator[tuple[str, str, Array]]:
    """Every plane of the campaign, what its columns' names carry (nothing where there is one plane), and which tests are its."""
    for plane in setting.planes:
        yield plane, f"_{plane}" if len(setting.planes) > 1 else "", setting.plane == plane


def _check_positive(term: Any) -> None:
    for name, value in vars(term).items():
        if isinstance(value, str):
            continue
        if not (np.isfinite(value) and value > 0):
            raise InputError(
                f"{type(term).__name__} {name} must be a positive number, got {value}. To drop the term, leave it out."
            )
