"""Nuisance terms for the form of the balls, and for the machine's errors of higher orders.

Nuisance terms are effects that are modelled but not of interest. A harmonic of order n is cos nθ or
sin nθ, with θ the angle on the circle.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Ball, Campaign
from ldbb_bayes.model.fourier import MAX_ORDER
from ldbb_bayes.model.setting import TRAVEL_NAMES, Setting
from ldbb_bayes.model.terms.base import Term, Uncertainty, order_in_words, plane_in_words
from ldbb_bayes.model.terms.columns import Columns, Scale
from ldbb_bayes.results import Array

__all__ = ["BallForm", "MachinePattern"]

# Orders n of the harmonics of a ball's form. They start at 2: order 0 is the ball's radius, and
# order 1 the position of its centre.
_FORM_ORDERS = range(2, MAX_ORDER + 1)
# Orders n of the harmonics of the machine's pattern. They start at 4, because geometric errors
# describe the lower orders.
_PATTERN_ORDERS = range(4, MAX_ORDER + 1)
_DECAY = Scale("decay", "decay", "p", "decay of form with its order", "decay")
# Prior variance of each coefficient of the orders 2 and 3, per square of the ball's deviation from
# sphericity (peak to valley).
_VARIANCE_PER_SPHERICITY = 1.0 / 24.0
# Highest order n of the harmonics to which a stated deviation from sphericity is attributed.
_LAST_SPHERICITY_ORDER = 3


class _TurnedBall(NamedTuple):
    """Ball, and the angle [rad] by which it is turned against the angle of its Fourier series."""

    ball: Ball
    turned_rad: float


class _Form(NamedTuple):
    """Form error of one ball, or the sum of the form errors of work ball and tool ball.

    ``stem`` begins the names of the coefficients; ``turned_rad`` is the clocking angle of every
    test [rad].
    """

    stem: str
    turned_rad: Array
    balls: tuple[_TurnedBall, ...]


def _harmonic_names(stem: str, orders: Sequence[int]) -> tuple[str, ...]:
    names = []
    for order in orders:
        names += [f"{stem}_cos{order}", f"{stem}_sin{order}"]
    return tuple(names)


@dataclass(frozen=True)
class BallForm(Term):
    """Form error of the balls: cos n(θ − ψ), sin n(θ − ψ), n = 2 … 12, the same at every force.

    ψ is the clocking angle of the ball. The prior variance of each coefficient is τ² (n/6)^(−2p);
    at the orders 2 and 3 it is larger by (S_work² + S_tool²)/24. S is a ball's deviation from
    sphericity, peak to valley, which its certificate or grade states, or else ``sphericity_um``.
    The hyper-parameters are τ, the scale at order 6, and p, the power by which form falls with its
    order. Harmonics that a certificate states have their mean and variance from the certificate.
    With ``law`` 1/n the prior sd is τ/n (model of the first edition).

    As long as no ball is clocked, the two forms are modelled as one sum. When a clocking differs
    between tests, each ball has its own form: the work ball at θ − ψ_work, and the tool ball, which
    is touched on its far side, at θ + 180° − ψ_tool, each with τ²/2 and its own S². Every plane
    has separate forms, because it runs over another great circle of the balls.

    Examples
    --------
    >>> lb.terms.BallForm.describe("form_cos2")
    '2-lobe form (cos 2θ)'
    >>> better_balls = model.with_term(lb.terms.BallForm(sphericity_um=0.5))
    >>> better_balls.nuisances[0]
    BallForm(sphericity_um=0.5, law='decay')
    """

    #: deviation from sphericity, peak to valley, of a ball without certificate or grade
    sphericity_um: float = 2.5
    #: law by which the prior sd falls with the order n: n^(−p) with a hyper-parameter p (decay),
    #: or 1/n
    law: Literal["decay", "1/n"] = "decay"
    stem = ("form", "work_form", "tool_form")
    calibration = "a calibration of the balls' form"
    remedy = "Clock both balls (not by 180° alone), or measure a second radius."
    instrument = True

    @property
    def scales(self) -> tuple[Scale, ...]:
        """Hyper-parameters of ball form: its scale τ at order 6, and its decay with order.

        With the law 1/n there is no decay.
        """
        tau = Scale("tau", "tau_um", "τ", "ball form")
        return (tau, _DECAY) if self.law == "decay" else (tau,)

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return the columns of the balls' form for the tests of a campaign.

        There is one set of columns for every plane and ball (or the sum of both balls). It is zero
        for tests in other planes.
        """
        columns = []
        for group in setting.groups_by("plane"):
            for form in _forms(setting):
                harmonics = setting.harmonics(_FORM_ORDERS, form.turned_rad)
                columns.append(
                    Columns(
                        _harmonic_names(form.stem + group.suffix, _FORM_ORDERS),
                        harmonics * group.tests[:, None, None],
                        hyper="tau",
                        **self._prior(form.balls),
                    )
                )
        return tuple(columns)

    def _prior(self, balls: Sequence[_TurnedBall]) -> dict[str, Any]:
        """Return the prior of the form of one ball, or of the sum of balls.

        The keys of the dictionary are names of arguments of `Columns`.
        """
        orders = np.repeat(_FORM_ORDERS, 2)
        if self.law == "1/n":
            return {"sd": np.sqrt(len(balls) / 2.0) / orders.astype(float)}
        # Each ball contributes τ²/2 to the prior variance (τ is the scale of form), at orders that
        # its certificate does not state.
        share_of_tau = np.zeros(len(orders))
        stated = np.zeros(len(orders))
        mean = np.zeros(len(orders))
        for ball, turned_rad in balls:
            low = orders <= _LAST_SPHERICITY_ORDER
            sphericity = self._sphericity(ball)
            variance = np.where(low, _VARIANCE_PER_SPHERICITY * sphericity**2, 0.0)
            half = np.full(len(orders), 0.5)
            for order, amplitude, phase_deg in ball.harmonics_um:
                at_order = orders == order
                angle = order * (np.deg2rad(phase_deg) + turned_rad)
                half[at_order] = 0.0
                variance[at_order] = _stated_sd_um(ball) ** 2
                mean[at_order] += amplitude * np.array([np.cos(angle), np.sin(angle)])
            share_of_tau = share_of_tau + half
            stated = stated + variance
        return {
            "sd": np.sqrt(share_of_tau),
            "decay": "decay",
            "orders": orders.astype(float),
            "stated": np.sqrt(stated) * 1e-3,
            "mean": mean * 1e-3,
        }

    def _sphericity(self, ball: Ball) -> float:
        """Return the deviation from sphericity of a ball [µm]: the stated one, or else assumed."""
        stated = ball.stated_sphericity_um
        return self.sphericity_um if stated is None else stated

    def assumed(self, campaign: Campaign) -> Iterator[Uncertainty]:
        """Yield what the term assumes about the form of each ball.

        This is the sd of the orders 2 and 3, and the amplitudes that certificates state. The part
        of the sd from the hyper-parameter τ, the scale of form, is not included.
        """
        if self.law != "decay":
            return
        for name in ("work", "tool"):
            ball: Ball = getattr(campaign.instrument, name)
            amplitudes = {order: amplitude for order, amplitude, _ in ball.harmonics_um}
            usual_sd = float(np.sqrt(_VARIANCE_PER_SPHERICITY) * self._sphericity(ball))
            sphericity_stated = ball.stated_sphericity_um is not None
            for order in sorted({2, 3, *amplitudes}):
                value = 0.0
                sd = usual_sd
                if order in amplitudes:
                    value = amplitudes[order]
                    sd = _stated_sd_um(ball)
                stated = order in amplitudes or sphericity_stated
                yield Uncertainty(
                    f"{name}_form_{order}", value * 1e-3, sd * 1e-3, "mm", name, stated
                )

    def is_stated(self, coefficient: str, campaign: Campaign) -> bool:
        """Return whether certificates state the size of a coefficient of form, given its name."""
        instrument = campaign.instrument
        balls = [instrument.work, instrument.tool]
        if coefficient.startswith("work"):
            balls = [instrument.work]
        elif coefficient.startswith("tool"):
            balls = [instrument.tool]
        order = int(re.findall(r"\d+$", coefficient)[0])
        for ball in balls:
            orders = [harmonic[0] for harmonic in ball.harmonics_um]
            if ball.stated_sphericity_um is None and order not in orders:
                return False
        return True

    @classmethod
    def describe(cls, coefficient: str) -> str:
        """Return a coefficient of form in words, such as 2-lobe form (cos 2θ), from its name."""
        ball = _ball_in_words(coefficient)
        owner = f"{ball}'s " if ball else ""
        order = order_in_words(coefficient)
        lobes = order.split()[1].removesuffix("θ")
        return f"{owner}{lobes}-lobe form ({order}{plane_in_words(coefficient)})"

    @classmethod
    def pattern(cls, coefficient: str) -> str:
        """Return harmonic, ball and plane of a coefficient in words, from its name.

        The words follow the name of the term in texts.
        """
        ball = _ball_in_words(coefficient)
        of_ball = f" of {ball}" if ball else ""
        return f" in {order_in_words(coefficient)}{of_ball}{plane_in_words(coefficient)}"


def _forms(setting: Setting) -> list[_Form]:
    """Return the form errors to model for the tests of a campaign.

    If differing clockings separate the two balls, there is one form error for each ball, as a
    function of the angle on this ball. Otherwise there is their sum, as a function of the angle on
    the work ball.
    """
    work = setting.instrument.work
    tool = setting.instrument.tool
    far_side = setting.tool_ball_rad - np.pi
    if setting.two_balls:
        return [
            _Form("work_form", setting.work_ball_rad, (_TurnedBall(work, 0.0),)),
            _Form("tool_form", far_side, (_TurnedBall(tool, 0.0),)),
        ]
    tool_turned = float(far_side[0] - setting.work_ball_rad[0])
    balls = (_TurnedBall(work, 0.0), _TurnedBall(tool, tool_turned))
    return [_Form("form", setting.work_ball_rad, balls)]


def _stated_sd_um(ball: Ball) -> float:
    """Return the standard uncertainty of stated harmonics [µm]: half the expanded uncertainty."""
    return 0.5 * (ball.U_um or 0.0)


def _ball_in_words(coefficient: str) -> str:
    """Return the ball of a coefficient in words; empty for the sum of both balls' forms."""
    if coefficient.startswith("work"):
        return "the work ball"
    if coefficient.startswith("tool"):
        return "the tool ball"
    return ""


@dataclass(frozen=True)
class MachinePattern(Term):
    """Geometric errors of higher orders and cyclic errors: cos nθ, sin nθ, n = 4 … 12.

    The prior sd of each coefficient is ω (n/6)^(−p), with hyper-parameters ω and p. The pattern is
    the same in all tests of one plane, direction of travel and radius. The term acts only if a ball
    is clocked: the form turns with the ball and the pattern does not, so that they can be
    separated.

    Examples
    --------
    The balls of the embedded campaign are not clocked:

    >>> "MachinePattern" in model.terms, "MachinePattern" in model.bind(campaign).terms
    (True, False)
    """

    stem = "pattern"
    remedy = "Run more circles with the balls clocked."
    scales = (Scale("omega", "omega_um", "ω", "pattern of the machine"), _DECAY)

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return the columns of the machine's pattern; none if no ball's clocking differs."""
        if not setting.clocked:
            return ()
        columns = []
        for plane in setting.groups_by("plane"):
            for radius in setting.groups_by("radius"):
                suffix = radius.suffix + plane.suffix
                columns += _patterns(setting, suffix, plane.tests & radius.tests)
        return tuple(columns)


def _patterns(setting: Setting, suffix: str, tests: NDArray[np.bool_]) -> list[Columns]:
    """Return the columns of the machine's pattern in one plane at one radius.

    Each direction of travel has its own columns.

    Parameters
    ----------
    setting
        Conditions of the campaign's tests.
    suffix
        End of the names of the coefficients, which states radius and plane.
    tests
        Whether each test has this plane and radius, shape (tests,).
    """
    orders = np.repeat(np.array(_PATTERN_ORDERS, dtype=float), 2)
    columns = []
    for travel in sorted({*setting.travels}):
        acting = tests & (setting.travel == travel)
        if not acting.any():
            continue
        direction = f"_{TRAVEL_NAMES[travel]}" if len(setting.travels) > 1 else ""
        names = _harmonic_names(f"pattern{direction}{suffix}", _PATTERN_ORDERS)
        values = setting.harmonics(_PATTERN_ORDERS) * acting[:, None, None]
        columns.append(
            Columns(names, values, np.ones(len(names)), "omega", decay="decay", orders=orders)
        )
    return columns
