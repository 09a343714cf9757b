"""Terms that differ between circles: shift, discrepancy, scatter, hysteresis, drift."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from ldbb_bayes.errors import require
from ldbb_bayes.machine.chain import LINEAR
from ldbb_bayes.model.fourier import MAX_ORDER, ORDERS, SIZE
from ldbb_bayes.model.setting import GroupOfTests, Setting
from ldbb_bayes.model.terms.base import Term, Unit, order_in_words, plane_in_words
from ldbb_bayes.model.terms.columns import BasisNoise, Columns, Hyper, Scale

__all__ = ["CircleScale", "Covariate", "Discrepancy", "Drift", "Hysteresis", "Moves", "SetupShift"]

# Whether zero and centre move with one scale, with one each, or only one of them moves.
Moves = Literal["together", "apart", "zero", "centre"]
# What a drift is in proportion to.
Covariate = Literal["time", "temperature"]
# The last order of hysteresis in the first edition.
_FIRST_EDITION_ORDERS = 4


@dataclass(frozen=True)
class SetupShift(Term):
    """1, cos θ, sin θ, separate for every test, scaled by δ.

    Zero (order 0) and centre (order 1) move between circles. ``moves`` says whether both have one
    scale δ, each its own, δ_0 and δ_1, or only one moves, with δ.
    """

    moves: Moves = "together"
    words = "set-up shift"
    remedy = "Run more circles: zero and centre move from one to the next."

    @property
    def scales(self) -> tuple[Scale, ...]:
        """Its hyper-parameters."""
        if self.moves != "apart":
            return (Scale("delta", "delta_um", "δ", "set-up shift"),)
        return (
            Scale("delta_0", "delta_um", "δ", "set-up shift of order 0"),
            Scale("delta_1", "delta_um", "δ", "set-up shift of order 1"),
        )

    def columns(self, setting: Setting) -> tuple[BasisNoise, ...]:
        """Return its columns in a setting."""
        zero = np.where(ORDERS == 0, 1.0, 0.0)
        centre = np.where(ORDERS == 1, 1.0, 0.0)
        circle = setting.circle
        if self.moves == "apart":
            return BasisNoise("delta_0", zero, circle), BasisNoise("delta_1", centre, circle)
        sd = {"together": zero + centre, "zero": zero, "centre": centre}
        return (BasisNoise("delta", sd[self.moves], circle),)


@dataclass(frozen=True)
class Discrepancy(Term):
    """cos nθ, sin nθ, n = 2 … 12, separate for every test, κ/n^decay.

    Model inadequacy and change from run to run.
    """

    decay: float = 1.0
    remedy = "Run more circles: what differs from one to the next averages out."
    scales = (Scale("kappa", "kappa_um", "κ", "discrepancy"),)

    def columns(self, setting: Setting) -> tuple[BasisNoise, ...]:
        """Return its columns in a setting."""
        sd = np.where(ORDERS >= 2, np.maximum(ORDERS, 1.0) ** -self.decay, 0.0)
        return (BasisNoise("kappa", sd, setting.circle),)


@dataclass(frozen=True)
class CircleScale(Term):
    """λ of every circle, which scales its shift and its discrepancy, λ² ~ InvGamma(3/2, 3/2).

    Circles scatter as Student's t with three degrees of freedom, so that an odd one does not move
    the compliances. Off with fewer than four tests.
    """

    stem = "lambda"
    words = "scale of a circle"
    remedy = "Repeat the odd circle."

    def scales_in(self, setting: Setting) -> tuple[Scale, ...]:
        """Return the scale of every circle."""
        scales = []
        for name in dict.fromkeys(setting.circle.tolist()):
            if name:
                words = f"scale of {name.removeprefix('lambda_')}"
                scales.append(Scale(name, 1.0, "λ", words, "circle"))
        return tuple(scales)

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return its columns in a setting."""
        return ()


class _HysteresisSd(NamedTuple):
    """Sd of the constant part of hysteresis at order 1, in units of its hyper-parameter if any."""

    sd_mm: float
    hyper: Hyper | None
    last_order: int


@dataclass(frozen=True)
class Hysteresis(Term):
    """s cos nθ, s sin nθ, n = 0 … 12, s = ±1 the sign of travel.

    What differs between the two directions (ISO 230-4): a constant part (backlash, reversal spikes,
    servo mismatch), η/n, η at order 0, and one in proportion to force (friction in the bar, lost
    motion), ``proportional_um_per_kN``/n; a set of each for every plane. Active where a plane is
    run both ways; in one direction it looks like machine. With ``law`` fixed orders end at 4 and
    ``constant_um`` stands for η (first edition).
    """

    constant_um: float = 2.0
    proportional_um_per_kN: float = 2.0
    law: Literal["sampled", "fixed"] = "sampled"
    calibration = "a narrower prior of it"
    remedy = "Run both directions at the same forces."

    @property
    def scales(self) -> tuple[Scale, ...]:
        """Its hyper-parameters."""
        return (Scale("eta", "eta_um", "η", "hysteresis"),) if self.law == "sampled" else ()

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return its columns in a setting."""
        columns: list[Columns] = []
        for plane in setting.each("plane"):
            if plane.value in setting.both_ways:
                columns += self._columns_of_plane(setting, plane)
        return tuple(columns)

    def _columns_of_plane(self, setting: Setting, plane: GroupOfTests) -> list[Columns]:
        """Return the constant part and the part in proportion to force."""
        constant = self._constant_part()
        suffixes = ["0"]
        for order in range(1, constant.last_order + 1):
            suffixes += [f"cos{order}", f"sin{order}"]
        count = len(suffixes)
        falling = 1.0 / np.maximum(ORDERS[:count], 1.0)
        sign = np.where(plane.tests, setting.travel, 0.0)
        values = np.zeros((setting.tests, SIZE, count))
        values[:, np.arange(count), np.arange(count)] = sign[:, None]
        proportional_sd = self.proportional_um_per_kN * 1e-6
        return [
            Columns(
                tuple(f"hysteresis{plane.suffix}_{suffix}" for suffix in suffixes),
                values,
                constant.sd_mm * falling,
                constant.hyper,
            ),
            Columns(
                tuple(f"hysteresis_force{plane.suffix}_{suffix}" for suffix in suffixes),
                values * setting.force_N[:, None, None],
                proportional_sd * falling,
            ),
        ]

    def _constant_part(self) -> _HysteresisSd:
        if self.law == "sampled":
            return _HysteresisSd(1.0, "eta", MAX_ORDER)
        return _HysteresisSd(self.constant_um * 1e-3, None, _FIRST_EDITION_ORDERS)

    @classmethod
    def unit_of(cls, coefficient: str) -> Unit:
        """Return the unit of a coefficient."""
        if coefficient.startswith("hysteresis_force"):
            return Unit("mm/N", 1e-6, "µm/kN")
        return cls.unit

    @classmethod
    def describe(cls, coefficient: str) -> str:
        """Return a coefficient in words."""
        force = " in proportion to force" if coefficient.startswith("hysteresis_force") else ""
        return f"hysteresis{force} ({order_in_words(coefficient)}{plane_in_words(coefficient)})"

    @classmethod
    def pattern(cls, coefficient: str) -> str:
        """Return its pattern after the term's words."""
        force = " times force" if coefficient.startswith("hysteresis_force") else ""
        return f" in {order_in_words(coefficient)}{force}{plane_in_words(coefficient)}"


@dataclass(frozen=True)
class Drift(Term):
    """u, u B̂: bar length and circle centre change in proportion to time or temperature u.

    u counts from the campaign's mean. Off by default: `SetupShift` covers what changes between
    circles at random. ``over`` is ``time_s`` or ``temperature_C`` of the tests, ``length_um`` and
    ``centre_um`` one sd per hour or kelvin. A steel bar of 150 mm grows by 1.7 µm/K.
    """

    over: Covariate = "time"
    length_um: float = 2.0
    centre_um: float = 5.0
    on_demand = True
    remedy = "Run the forces in an order that has nothing to do with time."

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return its columns in a setting."""
        change = setting.temperature_K
        field = "temperature_C"
        if self.over == "time":
            change = setting.time_h
            field = "time_s"
        lacking = int(np.sum(~np.isfinite(change)))
        require(
            not lacking,
            f"drift over {self.over} must have {field} in every test, got {lacking} without."
            " Record it, or leave the term Drift out.",
        )
        axes = [axis for axis in range(3) if np.any(setting.direction[:, :, axis])]
        length = setting.constant(change)
        centre = setting.direction[:, :, axes] * change[:, None, None]
        names = [f"drift_{self.over}_length"]
        names += [f"drift_{self.over}_{LINEAR[axis]}" for axis in axes]
        sd_um = np.array([self.length_um] + [self.centre_um] * len(axes))
        return (Columns(tuple(names), np.concatenate([length, centre], axis=2), sd_um * 1e-3),)

    @classmethod
    def unit_of(cls, coefficient: str) -> Unit:
        """Return the unit of a coefficient."""
        per = "h" if coefficient.startswith("drift_time") else "K"
        return Unit(f"mm/{per}", 1e-3, f"µm/{per}")

    @classmethod
    def describe(cls, coefficient: str) -> str:
        """Return a coefficient in words."""
        covariate, quantity = coefficient.removeprefix("drift_").split("_")
        if quantity == "length":
            return f"drift of the bar's length over {covariate}"
        return f"drift of the centre along {quantity} over {covariate}"
