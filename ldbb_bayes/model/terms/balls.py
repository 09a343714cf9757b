"""Nuisance terms for form errors of the balls, and for geometric and cyclic errors of the machine.

Nuisance terms are effects that are modelled but not of interest. The errors are sums of harmonics
cos nθ and sin nθ, where θ is the angle on the circle and n the order. Form errors of the balls have
the orders 2 and higher. Of the errors of the machine, only those of order 4 and higher are
described here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from ldbb_bayes.campaign.campaign import Ball, Campaign, Instrument
from ldbb_bayes.model.fourier import MAX_ORDER
from ldbb_bayes.model.setting import TRAVEL_NAMES, CirclePath, GroupOfTests, Setting
from ldbb_bayes.model.terms.base import (
    MACHINE_CORRELATION,
    Term,
    Uncertainty,
    order_in_words,
    plane_in_words,
)
from ldbb_bayes.model.terms.columns import FORM_ORDER, Columns, Scale
from ldbb_bayes.results import Array

__all__ = ["BallForm", "MachinePattern"]

# Orders n of the harmonics cos nθ, sin nθ of a ball's form error. The order 0 (radius of the ball)
# and the order 1 (position of the ball's centre) are not part of the form error.
_FORM_ORDERS = range(2, MAX_ORDER + 1)
# Orders n of the harmonics cos nθ, sin nθ of the machine's pattern (geometric and cyclic errors of
# higher orders). The pattern has no orders below 4, because these lower orders are described by the
# geometric errors of the model, such as squareness.
_PATTERN_ORDERS = range(4, MAX_ORDER + 1)
# Hyper-parameter p (decay). The prior sds of the balls' form errors, and of the machine's errors of
# higher orders, are proportional to n^(−p), where the order n is the number of waves around the
# circle.
_DECAY = Scale("decay", "decay", "p", "decay of form with its order", "decay")
# Prior variance of each coefficient of a ball's form error with 2 or 3 waves around the circle,
# divided by the square of the ball's deviation from sphericity (peak to valley).
_VARIANCE_PER_SPHERICITY = 1.0 / 24.0
# Part of the prior sd of a ball's form error is computed from the ball's deviation from sphericity.
# This part is the same for all harmonics cos nθ, sin nθ with orders n up to this number. At higher
# orders, it decreases as 1/n if a certificate or grade states the deviation. If the deviation is
# assumed, this part is zero at higher orders.
_LAST_SPHERICITY_ORDER = 3


class _TurnedBall(NamedTuple):
    """Ball that contributes to a form error, and the angle by which it is turned.

    A form error is a function of the angle around a ball, counted from a mark on this ball. If two
    balls contribute, their form errors are added as functions of the angle from the mark on the
    work ball. ``turned_rad`` is the angle from this mark to the mark on ``ball`` [rad]. It is zero
    for the work ball, and for a ball that contributes alone.
    """

    ball: Ball
    turned_rad: float


class _CoefficientPrior(NamedTuple):
    """Prior of the coefficients of a ball's form error.

    Each order has two coefficients, one of the cosine and one of the sine.
    """

    #: Factor f for each coefficient of a form error of the balls. One part of the coefficient's
    #: prior variance is f τ² (n/6)^(−2p), with the order n and the hyper-parameters τ (scale of
    #: form errors at order 6) and p (decay with the order). f is half of the number of balls for
    #: which no certificate or grade gives the form error of the order n.
    share_of_tau: Array
    #: fixed part of the prior sd of each coefficient of a ball's form error [µm]; this part does
    #: not depend on hyper-parameters
    sd_um: Array
    mean_um: Array  #: prior mean of each coefficient of a ball's form error, from certificates [µm]


class _Form(NamedTuple):
    """Form error of one ball, or the sum of the form errors of work ball and tool ball.

    The names of its coefficients begin with ``stem``. ``balls`` contains the ball that has this
    form error, or both balls. The form error is a function of the angle from a mark on the ball; if
    there are two balls, the mark is on the work ball. ``turned_rad``, shape (tests,), is the angle
    of this mark on the circle of every test [rad].
    """

    stem: str
    turned_rad: Array
    balls: tuple[_TurnedBall, ...]


def _harmonic_names(stem: str, orders: Sequence[int]) -> tuple[str, ...]:
    """Return names of the coefficients of cos nθ and sin nθ, such as form_cos2 and form_sin2.

    The names begin with ``stem``; ``orders`` holds the orders n. Each order has two names.
    """
    names = []
    for order in orders:
        names += [f"{stem}_cos{order}", f"{stem}_sin{order}"]
    return tuple(names)


@dataclass(frozen=True)
class BallForm(Term):
    """Form error of the balls: cos n(θ − ψ), sin n(θ − ψ), n = 2 … 12, the same at every force.

    θ is the angle on the circle and ψ the clocking angle, by which the ball is turned in its
    socket. The prior variance of a coefficient of the order n is the sum of one contribution from
    each ball. Let S be the deviation of the ball from sphericity, peak to valley.

    - If a certificate states the harmonics of the order n, their means and variances are taken from
      the certificate.
    - If a certificate or grade states S, the contribution is S²/24 · min(1, 3/n)², because S is an
      upper limit of the form error of every order.
    - If nothing is stated, the contribution is τ²/2 (n/6)^(−2p). At the orders 2 and 3, S²/24 is
      added, with ``sphericity_um`` for S.

    The hyper-parameter τ is the prior sd, at the order 6, of the sum of the form errors of two
    balls about which nothing is stated. The hyper-parameter p is the exponent with which this sd
    decreases with the order. If certificates or grades state the form errors of both balls, the
    model has neither τ nor p. If the field ``law`` is ``1/n``, as in the model's first edition
    (preset ``first``), certificates and grades are not used, and the prior sd of the sum of both
    form errors is τ/n.

    If both balls keep their clocking in all tests, the sum of the form errors of the two balls is
    modelled. If the clocking of a ball changes between tests, the two form errors are modelled
    separately: the form error of the work ball is a function of θ − ψ_work, and that of the tool
    ball is a function of θ + 180° − ψ_tool, because the bar points in opposite directions as seen
    from the centres of the two balls. Each plane has separate form errors, because circles in
    different planes run along different great circles of the balls.

    Examples
    --------
    >>> lb.terms.BallForm.describe("form_cos2")
    '2-lobe form (cos 2θ)'
    >>> better_balls = model.with_term(lb.terms.BallForm(sphericity_um=0.5))
    >>> better_balls.nuisances[0]
    BallForm(sphericity_um=0.5, law='decay')
    """

    #: deviation from sphericity, peak to valley [µm], assumed for a ball without certificate or
    #: grade
    sphericity_um: float = 2.5
    #: how the prior sd of a ball's form error decreases with the order n (number of waves around
    #: the circle): in proportion to n^(−p) with a hyper-parameter p (``decay``), or in proportion
    #: to 1/n (``1/n``)
    law: Literal["decay", "1/n"] = "decay"
    stem = ("form", "work_form", "tool_form")
    calibration = "a calibration of the balls' form"
    remedy = "Clock both balls (not by 180° alone), or measure a second radius."
    instrument = True

    @property
    def scales(self) -> tuple[Scale, ...]:
        """Hyper-parameters of the balls' form errors: prior sd τ at order 6, and decay p.

        The prior sd of a form error with n waves around the circle is proportional to n^(−p). If
        the field ``law`` is ``1/n``, τ is the only hyper-parameter. If certificates or grades state
        the form errors of both balls, no coefficient depends on τ and p, and the model of a
        campaign has neither of them.
        """
        tau = Scale("tau", "tau_um", "τ", "ball form")
        return (tau, _DECAY) if self.law == "decay" else (tau,)

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return the columns of the balls' form errors for the tests of a campaign.

        ``setting`` describes the test conditions. A column holds the change of the reading per unit
        of one coefficient. Every plane has one set of columns for each ball, or one set for the sum
        of both balls. The columns of a plane are zero for tests in other planes.
        """
        columns = []
        for group in setting.groups_by("plane"):
            for form in _form_errors(setting):
                harmonics = setting.harmonics(_FORM_ORDERS, form.turned_rad)
                columns.append(
                    Columns(
                        _harmonic_names(form.stem + group.suffix, _FORM_ORDERS),
                        harmonics * group.tests[:, None, None],
                        **self._prior(form.balls),
                    )
                )
        return tuple(columns)

    def _prior(self, balls: Sequence[_TurnedBall]) -> dict[str, Any]:
        """Return the prior of one ball's form error, or of the sum of both balls' form errors.

        ``balls`` are the balls that contribute to the form error. The result is a dict with keyword
        arguments of `Columns`, such as ``sd`` and ``mean``.
        """
        orders = np.repeat(_FORM_ORDERS, 2).astype(float)
        if self.law == "1/n":
            return {"sd": np.sqrt(len(balls) / 2.0) / orders, "hyper": "tau"}
        prior = self._coefficient_prior(balls, orders)
        mean = prior.mean_um * 1e-3
        stated = prior.sd_um * 1e-3
        if not prior.share_of_tau.any():
            return {"sd": stated, "mean": mean}
        return {
            "sd": np.sqrt(prior.share_of_tau),
            "hyper": "tau",
            "decay": "decay",
            "orders": orders,
            "stated": stated,
            "mean": mean,
        }

    def _coefficient_prior(self, balls: Sequence[_TurnedBall], orders: Array) -> _CoefficientPrior:
        """Return the prior of the Fourier coefficients of a form error of the balls.

        ``balls`` holds one ball, or both balls if the sum of their form errors is modelled.
        ``orders`` holds the order of each coefficient.
        """
        share_of_tau = np.zeros(len(orders))
        variance = np.zeros(len(orders))
        mean = np.zeros(len(orders))
        for ball, turned_rad in balls:
            variance_of_ball = self._sphericity_sd_um(ball, orders) ** 2
            share_of_ball = np.full(len(orders), 0.5)
            if ball.stated_sphericity_um is not None:
                share_of_ball[:] = 0.0
            for order, amplitude, phase_deg in ball.harmonics_um:
                at_order = orders == order
                angle = order * (np.deg2rad(phase_deg) + turned_rad)
                share_of_ball[at_order] = 0.0
                variance_of_ball[at_order] = _stated_sd_um(ball) ** 2
                mean[at_order] += amplitude * np.array([np.cos(angle), np.sin(angle)])
            share_of_tau = share_of_tau + share_of_ball
            variance = variance + variance_of_ball
        return _CoefficientPrior(share_of_tau, np.sqrt(variance), mean)

    def coefficient_sd_um(self, ball: Ball, order: int, tau_um: Array, decay: Array) -> Array:
        """Return the prior sd of the coefficients of one order of a ball's form error [µm].

        Parameters
        ----------
        ball : Ball
            The ball, including what its certificate or grade states.
        order : int
            Order n of the harmonics cos nθ and sin nθ, whose coefficients have the same sd.
        tau_um : array or float
            Values of the hyper-parameter τ, the scale of the balls' form errors at order 6 [µm].
        decay : array or float
            Values of the hyper-parameter p, the exponent with which the contribution of τ decreases
            with the order; same shape as ``tau_um``.

        Returns
        -------
        array
            Prior sd for each pair of values of τ and p, with the shape of ``tau_um``.

        Examples
        --------
        >>> ball_form = lb.terms.BallForm()
        >>> ball_form.coefficient_sd_um(lb.Ball(), 3, 0.5, 2.0).round(2)
        array(1.51)
        """
        orders = np.array([float(order)])
        prior = self._coefficient_prior((_TurnedBall(ball, 0.0),), orders)
        relative = (order / FORM_ORDER) ** -np.asarray(decay)
        variance = prior.share_of_tau[0] * (tau_um * relative) ** 2 + prior.sd_um[0] ** 2
        return np.asarray(np.sqrt(variance))

    def _sphericity_sd_um(self, ball: Ball, orders: Array) -> Array:
        """Return prior sds for coefficients of a ball's form error, from its sphericity [µm].

        The orders of the n coefficients are ``orders``, shape (n,), at least 2; the result has the
        same shape. If a certificate or grade of ``ball`` states the deviation from sphericity S,
        the sd is S/√24 · min(1, 3/order). Otherwise, the term's field ``sphericity_um`` is taken as
        S, and the sd is S/√24 at the orders 2 and 3, and zero at higher orders.
        """
        sphericity = ball.stated_sphericity_um
        relative = np.minimum(1.0, _LAST_SPHERICITY_ORDER / orders)
        if sphericity is None:
            sphericity = self.sphericity_um
            relative = np.where(orders <= _LAST_SPHERICITY_ORDER, 1.0, 0.0)
        return np.asarray(np.sqrt(_VARIANCE_PER_SPHERICITY) * sphericity * relative)

    def assumed(self, campaign: Campaign) -> Iterator[Uncertainty]:
        """Yield an assumed amplitude and its uncertainty for each harmonic of a ball's form error.

        ``campaign`` holds the certificates and grades of the balls. If the certificate of a ball
        states the harmonic, it also gives the amplitude and its standard uncertainty. Otherwise the
        amplitude is zero, and the uncertainty is computed from the deviation from sphericity that a
        certificate or grade states, or from the field ``sphericity_um``. The hyper-parameter τ,
        which also increases the prior sds, does not contribute to the uncertainties.

        If a certificate or grade states the deviation from sphericity of a ball, its harmonics have
        the orders 2 to 12. Otherwise they have the orders 2 and 3 and those in the certificate. If
        the field ``law`` is ``1/n``, nothing is yielded.
        """
        if self.law != "decay":
            return
        for name in ("work", "tool"):
            ball: Ball = getattr(campaign.instrument, name)
            amplitudes = {order: amplitude for order, amplitude, _ in ball.harmonics_um}
            sphericity_stated = ball.stated_sphericity_um is not None
            orders = {2, 3, *amplitudes}
            if sphericity_stated:
                orders.update(_FORM_ORDERS)
            for order in sorted(orders):
                value = 0.0
                sd = float(self._sphericity_sd_um(ball, np.array([float(order)]))[0])
                if order in amplitudes:
                    value = amplitudes[order]
                    sd = _stated_sd_um(ball)
                stated = order in amplitudes or sphericity_stated
                yield Uncertainty(
                    f"{name}_form_{order}", value * 1e-3, sd * 1e-3, "mm", name, stated
                )

    def is_stated(self, coefficient: str, campaign: Campaign) -> bool:
        """Return whether the prior of a form-error coefficient follows from certificates or grades.

        ``coefficient`` is the name of the coefficient, and ``campaign`` holds the certificates and
        grades. If the coefficient describes the sum of the form errors of both balls, both balls
        need a certificate or a grade.
        """
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
        """Return the description of a coefficient of the balls' form errors, made from its name.

        For example, form_cos2 is described as "2-lobe form (cos 2θ)".
        """
        ball = _ball_in_words(coefficient)
        owner = f"{ball}'s " if ball else ""
        order = order_in_words(coefficient)
        lobes = order.split()[1].removesuffix("θ")
        return f"{owner}{lobes}-lobe form ({order}{plane_in_words(coefficient)})"

    @classmethod
    def pattern(cls, coefficient: str) -> str:
        """Return a description in words of a form-error coefficient: its harmonic, ball and plane.

        ``coefficient`` is the name of the coefficient. For example, the name work_form_cos2 gives
        `` in cos 2θ of the work ball``; reports append these words to the name of the term.
        """
        ball = _ball_in_words(coefficient)
        of_ball = f" of {ball}" if ball else ""
        return f" in {order_in_words(coefficient)}{of_ball}{plane_in_words(coefficient)}"


def _form_errors(setting: Setting) -> list[_Form]:
    """Return the ball form errors in the model of a campaign.

    If a ball is turned in its socket between tests, the model has a separate form error for each
    ball, as a function of the angle on this ball. The same holds if a ball is turned between two
    campaigns that are analysed together. Otherwise the model has only the sum of the form errors of
    both balls, as a function of the angle on the work ball. ``setting`` describes the test
    conditions.
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
    """Return the standard uncertainty of the harmonics that a ball's certificate states [µm].

    The standard uncertainty is half of the expanded uncertainty (k = 2) in the certificate.
    """
    return 0.5 * (ball.U_um or 0.0)


def _ball_in_words(coefficient: str) -> str:
    """Return the ball to which a form-error coefficient belongs, such as "the work ball".

    ``coefficient`` is the name of the coefficient. The other possible result is "the tool ball".
    Return an empty string for a coefficient of the sum of both balls' form errors.
    """
    if coefficient.startswith("work"):
        return "the work ball"
    if coefficient.startswith("tool"):
        return "the tool ball"
    return ""


@dataclass(frozen=True)
class MachinePattern(Term):
    """Geometric and cyclic errors of the machine, as a sum of harmonics of the orders 4 to 12.

    These errors are called the machine's pattern. The harmonics are cos nθ and sin nθ, where n is
    the order and θ the angle on the circle. The prior sd of each coefficient is ω (n/6)^(−p), with
    the hyper-parameters ω (prior sd at order 6) and p (decay with order, the same as for the form
    errors of the balls). The pattern is the same in all tests of one plane, direction of travel and
    radius. The term has an effect only if the clocking of a ball (the angle by which it is turned
    in its socket) differs between tests, or if a certificate or grade states the form error of a
    ball. Form error and pattern can then be separated, because the form error turns with the ball
    while the pattern does not, or because the form error is known. Otherwise the form errors of the
    balls in the model include the pattern.

    Examples
    --------
    In the campaign that comes with the package, the balls are never turned in their sockets and
    have no certificates. Its model therefore has no pattern:

    >>> "MachinePattern" in model.terms, "MachinePattern" in model.bind(campaign).terms
    (True, False)
    """

    stem = "pattern"
    machine = True
    campaign_correlation = MACHINE_CORRELATION
    of_circle = True
    remedy = "Run more circles with the balls clocked."
    scales = (Scale("omega", "omega_um", "ω", "pattern of the machine"), _DECAY)

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return the columns of the machine's pattern for the tests of a campaign.

        The pattern is made of the machine's geometric and cyclic errors of higher orders.
        ``setting`` describes the test conditions. A column holds the change of the reading per unit
        of one coefficient. The result is an empty tuple if every ball has the same clocking (angle
        by which it is turned in its socket) in all tests and no certificate or grade states the
        form error of a ball.
        """
        if not (setting.clocked or _states_form(setting.instrument)):
            return ()
        columns = []
        for plane in setting.groups_by("plane"):
            for radius in setting.groups_by("radius"):
                columns += _pattern_columns(setting, plane, radius)
        return tuple(columns)


def _states_form(instrument: Instrument) -> bool:
    """Return whether ``instrument`` has a certificate or grade for the form error of a ball.

    A certificate that states only some harmonics of the form error is sufficient.
    """
    for ball in (instrument.work, instrument.tool):
        if ball.stated_sphericity_um is not None or ball.harmonics_um:
            return True
    return False


def _pattern_columns(setting: Setting, plane: GroupOfTests, radius: GroupOfTests) -> list[Columns]:
    """Return the columns of the machine's pattern in one plane at one radius.

    The pattern is an error of the machine that depends on the angle on the circle: a sum of cosines
    and sines of several orders. A column holds the change of the reading per unit of one
    coefficient; it is zero in tests with another plane or radius. Each direction of travel has
    separate columns. The prior sd of a coefficient of the order n is ω (n/6)^(−p), with the
    hyper-parameters ω (``omega``) and p (``decay``).

    Parameters
    ----------
    setting
        Conditions of the campaign's tests.
    plane
        The tests in this plane.
    radius
        The tests at this radius.
    """
    orders = np.repeat(np.array(_PATTERN_ORDERS, dtype=float), 2)
    columns = []
    for travel in sorted(setting.travels):
        if CirclePath(plane.value, radius.value, travel) not in setting.paths:
            continue
        direction = f"_{TRAVEL_NAMES[travel]}" if len(setting.travels) > 1 else ""
        stem = f"pattern{direction}{radius.suffix}{plane.suffix}"
        names = _harmonic_names(stem, _PATTERN_ORDERS)
        acting = plane.tests & radius.tests & (setting.travel == travel)
        values = setting.harmonics(_PATTERN_ORDERS) * acting[:, None, None]
        columns.append(
            Columns(names, values, np.ones(len(names)), "omega", decay="decay", orders=orders)
        )
    return columns
