"""Terms of the form of the balls and of the pattern of the machine."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ldbb_bayes.campaign.campaign import Ball, Campaign
from ldbb_bayes.model.fourier import MAX_ORDER
from ldbb_bayes.model.setting import TRAVEL_NAMES, Setting
from ldbb_bayes.model.terms.base import Term, Uncertainty, _in_plane, _order
from ldbb_bayes.model.terms.columns import Columns, Scale

__all__ = ["BallForm", "MachinePattern"]


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
