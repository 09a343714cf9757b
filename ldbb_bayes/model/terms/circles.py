"""Nuisance terms for differences between circles: shift, discrepancy, hysteresis and drift.

Nuisance terms are effects that are modelled but not of interest.
"""

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

# What shifts at random from one circle to the next. ``together``: the zero of the readings and the
# centre of the circle, with the same sd. ``apart``: both, with separate sds. ``zero``: only the
# zero. ``centre``: only the centre.
Moves = Literal["together", "apart", "zero", "centre"]
# Quantities to which a drift of the bar's length and the circle's centre can be proportional.
Covariate = Literal["time", "temperature"]
# Highest order n of the harmonics cos nθ, sin nθ of hysteresis in the model's first edition (preset
# ``first``).
_FIRST_EDITION_ORDERS = 4
# Highest order n of the harmonics cos nθ, sin nθ of hysteresis in a plane whose circles all run in
# one direction. In such a plane, hysteresis cannot be distinguished from bar length, geometric
# errors and compliances, whose effects also have orders up to this number. An effect of order 4 is
# possible only for the compliance that relates a rotation to a moment.
_ONE_WAY_ORDERS = 3
# Factor on the prior sd of the part of hysteresis that is proportional to force, in a plane whose
# circles all run in one direction.
_ONE_WAY_SHARE = 0.6


@dataclass(frozen=True)
class SetupShift(Term):
    """Random shift of the readings' zero and of the circle's centre between circles.

    A shift of the zero adds a constant to the readings of a circle (order 0). A shift of the centre
    adds multiples of cos θ and sin θ (order 1), where θ is the angle on the circle. Every test has
    separate coefficients. Their prior sds are hyper-parameters: one sd δ for zero and centre, or
    separate sds δ_0 and δ_1, as the field ``moves`` states. This field can also restrict the shift
    to the zero or to the centre.

    Examples
    --------
    >>> [scale.name for scale in lb.terms.SetupShift().scales]
    ['delta']
    >>> [scale.name for scale in lb.terms.SetupShift(moves="apart").scales]
    ['delta_0', 'delta_1']
    """

    #: what shifts at random from one circle to the next. ``together``: the zero of the readings and
    #: the centre of the circle, with the same sd. ``apart``: both, with separate sds. ``zero``:
    #: only the zero. ``centre``: only the centre.
    moves: Moves = "together"
    words = "set-up shift"
    remedy = "Run more circles: zero and centre move from one to the next."

    @property
    def scales(self) -> tuple[Scale, ...]:
        """Hyper-parameters that are the sds of the random shifts from one circle to the next.

        The zero of the readings and the centre of the circle shift. If the field ``moves`` is
        ``apart``, there are two hyper-parameters: δ_0 for the zero, and δ_1 for the centre.
        Otherwise there is only δ.
        """
        if self.moves != "apart":
            return (Scale("delta", "delta_um", "δ", "set-up shift"),)
        return (
            Scale("delta_0", "delta_um", "δ", "set-up shift of order 0"),
            Scale("delta_1", "delta_um", "δ", "set-up shift of order 1"),
        )

    def columns(self, setting: Setting) -> tuple[BasisNoise, ...]:
        """Return the model of random shifts between circles: noise of the Fourier orders 0 and 1.

        The coefficient of 1 is the shift of the readings' zero; the coefficients of cos θ and sin θ
        are the shift of the circle's centre. The field ``moves`` states whether the zero, the
        centre, or both of them shift. The noise is independent between the tests of a campaign.
        ``setting`` describes the test conditions.
        """
        zero_sd = np.where(ORDERS == 0, 1.0, 0.0)
        centre_sd = np.where(ORDERS == 1, 1.0, 0.0)
        circle = setting.circle
        if self.moves == "apart":
            return BasisNoise("delta_0", zero_sd, circle), BasisNoise("delta_1", centre_sd, circle)
        sd_by_choice = {"together": zero_sd + centre_sd, "zero": zero_sd, "centre": centre_sd}
        return (BasisNoise("delta", sd_by_choice[self.moves], circle),)


@dataclass(frozen=True)
class Discrepancy(Term):
    """Deviation of each circle from the model, in harmonics of the orders n = 2 … 12.

    The deviation is due to effects that the model lacks, and to variation from one circle to the
    next. The harmonics are cos nθ and sin nθ, where θ is the angle on the circle. Every test has
    separate coefficients. Their prior sd is κ/n^decay, with the hyper-parameter κ and the fixed
    exponent ``decay``.

    Examples
    --------
    The prior sds of the coefficients of order 0, 1 and 2, divided by κ:

    >>> noise = lb.terms.Discrepancy(decay=1.0).columns(model.bind(campaign).setting)[0]
    >>> noise.sd[:5]
    array([0. , 0. , 0. , 0.5, 0.5])
    """

    #: exponent in the prior sd κ/n^decay of the harmonics cos nθ and sin nθ, where κ is a
    #: hyper-parameter
    decay: float = 1.0
    remedy = "Run more circles: what differs from one to the next averages out."
    scales = (Scale("kappa", "kappa_um", "κ", "discrepancy"),)

    def columns(self, setting: Setting) -> tuple[BasisNoise, ...]:
        """Return the model of the deviations of circles: noise of the Fourier orders 2 to 12.

        A circle deviates because of effects that the rest of the model lacks, and because circles
        vary. The Fourier coefficients of the deviations are random, and independent between the
        tests of a campaign. ``setting`` describes the test conditions.
        """
        sd = np.where(ORDERS >= 2, np.maximum(ORDERS, 1.0) ** -self.decay, 0.0)
        return (BasisNoise("kappa", sd, setting.circle),)


@dataclass(frozen=True)
class CircleScale(Term):
    """Noise factor λ of each circle, so that an outlying circle hardly changes the compliances.

    λ multiplies the prior sds of the terms `SetupShift` and `Discrepancy` for the circle. λ² has an
    inverse gamma prior, InvGamma(3/2, 3/2). The deviations of a circle therefore follow Student's t
    distribution with three degrees of freedom. The factors are not used in campaigns with fewer
    than four tests.

    Examples
    --------
    >>> setting = model.bind(campaign).setting
    >>> [scale.name for scale in lb.terms.CircleScale().scales_in(setting)][:3]
    ['lambda_f036', 'lambda_f238', 'lambda_f364']
    """

    stem = "lambda"
    words = "scale of a circle"
    remedy = "Repeat the odd circle."

    def scales_in(self, setting: Setting) -> tuple[Scale, ...]:
        """Return the hyper-parameters λ, each of which multiplies the noise of one circle.

        ``setting`` describes the test conditions. The result is an empty tuple for campaigns with
        fewer than four tests.
        """
        scales = []
        for name in dict.fromkeys(setting.circle.tolist()):
            if name:
                words = f"scale of {name.removeprefix('lambda_')}"
                scales.append(Scale(name, 1.0, "λ", words, "circle"))
        return tuple(scales)

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return no columns, because the factors λ only multiply the noise of other terms."""
        return ()


class _HysteresisPrior(NamedTuple):
    """Prior of the coefficients of hysteresis in one plane.

    Hysteresis has a part that does not depend on force (``constant_sd``) and a part proportional to
    force (``proportional_sd``). These two fields hold the prior sds of the coefficients at the
    Fourier orders 0 and 1. At a higher order n, the prior sds are 1/n of these values.
    """

    #: prior sd of the part of hysteresis that does not depend on force [mm]; if ``hyper`` names a
    #: hyper-parameter, this field is the prior sd divided by the hyper-parameter
    constant_sd: float
    #: name of the hyper-parameter that scales the part of hysteresis that does not depend on force;
    #: None if the prior sd of this part does not depend on a hyper-parameter
    hyper: Hyper | None
    #: prior sd of the part of hysteresis that is proportional to force [mm/N]
    proportional_sd: float
    last_order: int  #: highest order n of the harmonics cos nθ, sin nθ of hysteresis


@dataclass(frozen=True)
class Hysteresis(Term):
    """Errors that change their sign with the direction of travel (hysteresis, ISO 230-4).

    The errors are harmonics s cos nθ and s sin nθ, where s = ±1 is the direction of travel and θ
    the angle on the circle. They have two parts. One part does not depend on force; its causes are
    backlash, reversal spikes and servo mismatch. The other part is proportional to force; its
    causes are friction in the bar and lost motion. The prior sds decrease as 1/n with the order n;
    at order 0, they are the same as at order 1. Each plane has separate coefficients.

    In a plane whose circles run in both directions, the orders are n = 0 … 12. The prior sd is η/n
    for the part that does not depend on force, with the hyper-parameter η, and
    ``proportional_um_per_kN``/n for the part proportional to force. If all circles of a plane run
    in one direction, or no directions are given, hysteresis cannot be separated from bar length,
    geometric errors and compliances. Hysteresis then widens the coverage intervals of these
    parameters. It has only the orders n = 0 … 3 in this case, because the effects of these
    parameters have hardly any higher orders. The prior sd is then ``constant_um``/n for the part
    that does not depend on force, and 0.6 ``proportional_um_per_kN``/n for the part proportional to
    force.

    If ``law`` is ``fixed``, as in the model's first edition (preset ``first``), the term acts only
    in planes whose circles run in both directions. The orders are then n = 0 … 4, and
    ``constant_um`` replaces η.

    Examples
    --------
    The embedded campaign has one direction of travel:

    >>> constant, in_proportion = lb.terms.Hysteresis().columns(model.bind(campaign).setting)
    >>> len(constant.names), constant.names[-1]
    (7, 'hysteresis_sin3')
    >>> lb.terms.Hysteresis.describe("hysteresis_force_cos2")
    'hysteresis in proportion to force (cos 2θ)'
    """

    #: prior sd, at Fourier order 1, of the part of hysteresis that does not depend on force [µm].
    #: It is used in planes with one direction of travel, and in all planes if the field ``law`` is
    #: ``fixed``. In all other cases this sd is the hyper-parameter η.
    constant_um: float = 2.0
    #: prior sd, at Fourier order 1, of the part of hysteresis that is proportional to force
    #: [µm/kN]. In planes with one direction of travel, the prior sd is 0.6 times this value.
    proportional_um_per_kN: float = 2.0
    #: how the prior sd, at Fourier order 1, of the part of hysteresis that does not depend on force
    #: is obtained. If this field is ``sampled``, the sd is the hyper-parameter η. If it is
    #: ``fixed``, the sd is the field ``constant_um``. The choice applies only to planes whose
    #: circles run in both directions of travel.
    law: Literal["sampled", "fixed"] = "sampled"
    calibration = "a narrower prior of it"
    remedy = "Run both directions at the same forces."

    @property
    def scales(self) -> tuple[Scale, ...]:
        """Hyper-parameter η: the scale of the part of hysteresis that does not depend on force.

        If the field ``law`` is ``fixed``, the result is an empty tuple, and the field
        ``constant_um`` is used instead of η. Even if ``law`` is ``sampled``, the model of a
        campaign has η only if at least one plane has circles in both directions.
        """
        return (Scale("eta", "eta_um", "η", "hysteresis"),) if self.law == "sampled" else ()

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return the columns of hysteresis in every plane of a campaign.

        ``setting`` describes the test conditions. A column holds, for every test, the change of the
        reading per unit of one coefficient. If the field ``law`` is ``fixed``, only planes whose
        circles run in both directions have columns.
        """
        columns: list[Columns] = []
        for plane in setting.groups_by("plane"):
            both_ways = plane.value in setting.both_ways
            if both_ways or self.law == "sampled":
                prior = self._prior(both_ways=both_ways)
                columns += _columns_of_plane(setting, plane, prior)
        return tuple(columns)

    def _prior(self, *, both_ways: bool) -> _HysteresisPrior:
        """Return the prior of the coefficients of hysteresis in one plane.

        ``both_ways`` states whether circles of the plane run in both directions.
        """
        constant_sd = self.constant_um * 1e-3
        proportional_sd = self.proportional_um_per_kN * 1e-6
        if self.law == "fixed":
            return _HysteresisPrior(constant_sd, None, proportional_sd, _FIRST_EDITION_ORDERS)
        if both_ways:
            return _HysteresisPrior(1.0, "eta", proportional_sd, MAX_ORDER)
        return _HysteresisPrior(
            constant_sd, None, _ONE_WAY_SHARE * proportional_sd, _ONE_WAY_ORDERS
        )

    @classmethod
    def unit_of(cls, coefficient: str) -> Unit:
        """Return the unit of a coefficient of the hysteresis, given the coefficient's name.

        One part of the hysteresis is proportional to force: reports display its coefficients in
        µm/kN (1 µm/kN is 1e-6 mm/N, the internal unit). The other part does not depend on force:
        reports display its coefficients in µm.
        """
        if coefficient.startswith("hysteresis_force"):
            return Unit(inside="mm/N", one=1e-6, label="µm/kN")
        return cls.unit

    @classmethod
    def describe(cls, coefficient: str) -> str:
        """Return words for a coefficient of hysteresis, given its name.

        For example, hysteresis_cos2 is described as "hysteresis (cos 2θ)".
        """
        force = " in proportion to force" if coefficient.startswith("hysteresis_force") else ""
        return f"hysteresis{force} ({order_in_words(coefficient)}{plane_in_words(coefficient)})"

    @classmethod
    def pattern(cls, coefficient: str) -> str:
        """Return words for the harmonic of a hysteresis coefficient, given its name.

        For example, the words for hysteresis_force_cos2 are `` in cos 2θ times force``. If the
        coefficient's name contains a plane, the words name the plane, too. Reports append the words
        to the name of the term.
        """
        force = " times force" if coefficient.startswith("hysteresis_force") else ""
        return f" in {order_in_words(coefficient)}{force}{plane_in_words(coefficient)}"


def _columns_of_plane(
    setting: Setting, plane: GroupOfTests, prior: _HysteresisPrior
) -> list[Columns]:
    """Return the columns of the design matrix for hysteresis in one plane of a campaign.

    The columns of the part of hysteresis that does not depend on force come first, followed by the
    columns of the part proportional to force. ``setting`` describes the test conditions, ``plane``
    states which tests are in the plane, and ``prior`` is the prior of the coefficients.
    """
    suffixes = ["0"]
    for order in range(1, prior.last_order + 1):
        suffixes += [f"cos{order}", f"sin{order}"]
    count = len(suffixes)
    falling = 1.0 / np.maximum(ORDERS[:count], 1.0)
    sign = np.where(plane.tests, setting.travel, 0.0)
    values = np.zeros((setting.tests, SIZE, count))
    values[:, np.arange(count), np.arange(count)] = sign[:, None]
    return [
        Columns(
            tuple(f"hysteresis{plane.suffix}_{suffix}" for suffix in suffixes),
            values,
            prior.constant_sd * falling,
            prior.hyper,
        ),
        Columns(
            tuple(f"hysteresis_force{plane.suffix}_{suffix}" for suffix in suffixes),
            values * setting.force_N[:, None, None],
            prior.proportional_sd * falling,
        ),
    ]


@dataclass(frozen=True)
class Drift(Term):
    """Drift of the bar's length and of the circle's centre with time or temperature.

    Let u be the time [h] or the temperature [K] of a test, minus its mean over all tests of the
    campaign. The field ``over`` states whether u is a time or a temperature. A drift of the bar's
    length changes the reading by u times one coefficient. A drift of the circle's centre changes
    the reading by u B̂ · c. B̂ is the unit vector along the bar, and the vector c holds one
    coefficient for each coordinate of the centre. ``length_um`` and ``centre_um`` are the prior sds
    of the coefficients, per hour or kelvin. For comparison, a steel bar of 150 mm grows by 1.7
    µm/K.

    If a test has no time, the model assumes that the tests were run in the listed order, one every
    six minutes. If the tests were run in random order (``order = "random"``), a drift with time is
    modelled only if the times of all tests are given. If the user has declared that nothing drifts
    (``drift = false``), the term has no effect.

    Examples
    --------
    >>> setting = model.bind(campaign).setting
    >>> lb.terms.Drift().columns(setting)[0].names
    ('drift_time_length', 'drift_time_X', 'drift_time_Y')
    >>> setting.time_h.round(2)
    array([-0.25, -0.15, -0.05,  0.05,  0.15,  0.25])
    >>> lb.terms.Drift.unit_of("drift_temperature_length").label
    'µm/K'
    """

    #: quantity to which the drift of the bar's length and the circle's centre is proportional: time
    #: or temperature
    over: Covariate = "time"
    #: prior sd of the drift of the bar's length [µm per hour or per kelvin]
    length_um: float = 2.0
    #: prior sd of the drift of each coordinate of the circle's centre [µm per hour or per kelvin]
    centre_um: float = 5.0
    remedy = "Run the forces in an order that has nothing to do with time."

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return the effects of drift on the readings of a campaign.

        The bar length and the circle centre drift. Each column of the result holds the change of
        the readings per unit of one drift coefficient. ``setting`` describes the test conditions.
        The result is an empty tuple if the user has declared that nothing drifts. For a drift with
        time, the result is also empty if the times of the tests are unknown or all equal. For a
        drift with temperature, raise an `InputError` if a test has no temperature.
        """
        if not setting.drifts:
            return ()
        change = setting.time_h
        if self.over == "temperature":
            change = setting.temperature_K
            lacking = int(np.sum(~np.isfinite(change)))
            require(
                not lacking,
                f"drift over temperature must have temperature_C in every test, got {lacking}"
                " without. Record it, or leave the term Drift out.",
            )
        if not np.isfinite(change).all():
            return ()
        axes = setting.moving_axes
        length = setting.constant(change)
        centre = setting.direction[:, :, list(axes)] * change[:, None, None]
        names = [f"drift_{self.over}_length"]
        names += [f"drift_{self.over}_{LINEAR[axis]}" for axis in axes]
        sd_um = np.array([self.length_um] + [self.centre_um] * len(axes))
        return (Columns(tuple(names), np.concatenate([length, centre], axis=2), sd_um * 1e-3),)

    @classmethod
    def unit_of(cls, coefficient: str) -> Unit:
        """Return the unit of a drift coefficient, given its name.

        The unit is µm/h for a drift with time, and µm/K for a drift with temperature.
        """
        per = "h" if coefficient.startswith("drift_time") else "K"
        return Unit(inside=f"mm/{per}", one=1e-3, label=f"µm/{per}")

    @classmethod
    def describe(cls, coefficient: str) -> str:
        """Return words for a drift coefficient, given its name.

        For example, drift_time_length is described as "drift of the bar's length over time".
        """
        covariate, quantity = coefficient.removeprefix("drift_").split("_")
        if quantity == "length":
            return f"drift of the bar's length over {covariate}"
        return f"drift of the centre along {quantity} over {covariate}"
