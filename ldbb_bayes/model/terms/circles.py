"""Terms that differ between circles: shift, discrepancy, scatter, hysteresis, drift."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ldbb_bayes.errors import require
from ldbb_bayes.machine.chain import LINEAR
from ldbb_bayes.model.fourier import MAX_ORDER, ORDERS, SIZE
from ldbb_bayes.model.setting import Setting
from ldbb_bayes.model.terms.base import Term, Unit, _in_plane, _order
from ldbb_bayes.model.terms.columns import BasisNoise, Columns, Scale

__all__ = ["CircleScale", "Covariate", "Discrepancy", "Drift", "Hysteresis", "Moves", "SetupShift"]


Moves = Literal["together", "apart", "zero", "centre"]


Covariate = Literal["time", "temperature"]


_TRAVEL_ORDERS = 4


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
