"""Nuisance terms that differ between circles: shift, discrepancy, hysteresis and drift.

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

# What a new set-up shifts: zero and centre with one common scale (together) or with separate scales
# (apart), or one of them alone.
Moves = Literal["together", "apart", "zero", "centre"]
# Quantities that a drift can be proportional to.
Covariate = Literal["time", "temperature"]
# Highest order n of the harmonics cos nθ, sin nθ of hysteresis in the model of the first edition.
_FIRST_EDITION_ORDERS = 4


@dataclass(frozen=True)
class SetupShift(Term):
    """Random shift of zero and centre between circles: 1, cos θ, sin θ, separate for every test.

    The prior sd is the hyper-parameter δ. ``moves`` states whether zero (order 0) and centre
    (order 1) have one common δ, have a δ_0 and a δ_1, or only one of them moves, with sd δ.

    Examples
    --------
    >>> [scale.name for scale in lb.terms.SetupShift().scales]
    ['delta']
    >>> [scale.name for scale in lb.terms.SetupShift(moves="apart").scales]
    ['delta_0', 'delta_1']
    """

    #: what moves: zero and centre with one common sd (together) or separate sds (apart), or only
    #: one of them (zero, centre)
    moves: Moves = "together"
    words = "set-up shift"
    remedy = "Run more circles: zero and centre move from one to the next."

    @property
    def scales(self) -> tuple[Scale, ...]:
        """Hyper-parameters of the set-up shift: one sd, or separate ones for zero and centre."""
        if self.moves != "apart":
            return (Scale("delta", "delta_um", "δ", "set-up shift"),)
        return (
            Scale("delta_0", "delta_um", "δ", "set-up shift of order 0"),
            Scale("delta_1", "delta_um", "δ", "set-up shift of order 1"),
        )

    def columns(self, setting: Setting) -> tuple[BasisNoise, ...]:
        """Return the shift as noise of the Fourier coefficients 1, cos θ, sin θ of every circle."""
        zero_sd = np.where(ORDERS == 0, 1.0, 0.0)
        centre_sd = np.where(ORDERS == 1, 1.0, 0.0)
        circle = setting.circle
        if self.moves == "apart":
            return BasisNoise("delta_0", zero_sd, circle), BasisNoise("delta_1", centre_sd, circle)
        sd_by_choice = {"together": zero_sd + centre_sd, "zero": zero_sd, "centre": centre_sd}
        return (BasisNoise("delta", sd_by_choice[self.moves], circle),)


@dataclass(frozen=True)
class Discrepancy(Term):
    """Model inadequacy and change from run to run: cos nθ, sin nθ, n = 2 … 12.

    The coefficients are separate for every test. Their prior sd is κ/n^decay, with the
    hyper-parameter κ.

    Examples
    --------
    The prior sd of the orders 0, 1 and 2, in units of κ:

    >>> noise = lb.terms.Discrepancy(decay=1.0).columns(model.bind(campaign).setting)[0]
    >>> noise.sd[:5]
    array([0. , 0. , 0. , 0.5, 0.5])
    """

    decay: float = 1.0  #: power by which the prior sd falls with the order of the harmonic
    remedy = "Run more circles: what differs from one to the next averages out."
    scales = (Scale("kappa", "kappa_um", "κ", "discrepancy"),)

    def columns(self, setting: Setting) -> tuple[BasisNoise, ...]:
        """Return the discrepancy as noise of the Fourier coefficients from order 2."""
        sd = np.where(ORDERS >= 2, np.maximum(ORDERS, 1.0) ** -self.decay, 0.0)
        return (BasisNoise("kappa", sd, setting.circle),)


@dataclass(frozen=True)
class CircleScale(Term):
    """Scale λ of every circle, which multiplies the sd of its set-up shift and discrepancy.

    λ² has an inverse gamma prior, InvGamma(3/2, 3/2). The circles therefore scatter as Student's t
    with three degrees of freedom, and an outlying circle hardly changes the compliances. The term
    does not act on campaigns with fewer than four tests.

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
        """Return the noise factor λ of every circle as a hyper-parameter."""
        scales = []
        for name in dict.fromkeys(setting.circle.tolist()):
            if name:
                words = f"scale of {name.removeprefix('lambda_')}"
                scales.append(Scale(name, 1.0, "λ", words, "circle"))
        return tuple(scales)

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return no columns: the factors λ scale the noise of other terms."""
        return ()


class _HysteresisSd(NamedTuple):
    """Prior sd, at order 1, of the part of hysteresis that does not depend on force.

    With a hyper-parameter, ``sd_mm`` is a factor on its value. ``last_order`` is the highest order
    of the harmonics.
    """

    sd_mm: float
    hyper: Hyper | None
    last_order: int


@dataclass(frozen=True)
class Hysteresis(Term):
    """Difference between the two directions of travel (ISO 230-4): s cos nθ, s sin nθ, n = 0 … 12.

    s = ±1 is the direction of travel. One part does not depend on force (backlash, reversal spikes,
    servo mismatch); its prior sd is η/n, and η at order 0, with the hyper-parameter η. The other is
    proportional to force (friction in the bar, lost motion); its prior sd is
    ``proportional_um_per_kN``/n, undivided at order 0. Each plane has separate coefficients. The
    term acts on planes that are run in both directions; with one direction it cannot be separated
    from the machine's other errors. With ``law`` fixed (model of the first edition) the first part
    ends at order 4 and ``constant_um`` replaces η.

    Examples
    --------
    The embedded campaign has one direction of travel, in which the term does not act:

    >>> lb.terms.Hysteresis().columns(model.bind(campaign).setting)
    ()
    >>> lb.terms.Hysteresis.describe("hysteresis_force_cos2")
    'hysteresis in proportion to force (cos 2θ)'
    """

    #: prior sd of the part of hysteresis that does not depend on force; used if ``law`` is fixed
    constant_um: float = 2.0
    proportional_um_per_kN: float = 2.0  #: prior sd of the hysteresis proportional to force
    #: whether η is a hyper-parameter (sampled) or replaced by ``constant_um`` (fixed)
    law: Literal["sampled", "fixed"] = "sampled"
    calibration = "a narrower prior of it"
    remedy = "Run both directions at the same forces."

    @property
    def scales(self) -> tuple[Scale, ...]:
        """Hyper-parameter of hysteresis: the scale η of its constant part; none if it is fixed."""
        return (Scale("eta", "eta_um", "η", "hysteresis"),) if self.law == "sampled" else ()

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return the columns of hysteresis in every plane that is run in both directions."""
        columns: list[Columns] = []
        for plane in setting.groups_by("plane"):
            if plane.value in setting.both_ways:
                columns += self._columns_of_plane(setting, plane)
        return tuple(columns)

    def _columns_of_plane(self, setting: Setting, plane: GroupOfTests) -> list[Columns]:
        """Return the columns of hysteresis in one plane.

        The part that does not depend on force is first, then the part proportional to force.
        """
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
        """Return the unit of a coefficient of hysteresis, given its name."""
        if coefficient.startswith("hysteresis_force"):
            return Unit("mm/N", 1e-6, "µm/kN")
        return cls.unit

    @classmethod
    def describe(cls, coefficient: str) -> str:
        """Return a coefficient in words, such as hysteresis (cos 2θ), from its name."""
        force = " in proportion to force" if coefficient.startswith("hysteresis_force") else ""
        return f"hysteresis{force} ({order_in_words(coefficient)}{plane_in_words(coefficient)})"

    @classmethod
    def pattern(cls, coefficient: str) -> str:
        """Return the harmonic of a coefficient in words, with plane and dependence on force.

        The words follow the name of the term in texts.
        """
        force = " times force" if coefficient.startswith("hysteresis_force") else ""
        return f" in {order_in_words(coefficient)}{force}{plane_in_words(coefficient)}"


@dataclass(frozen=True)
class Drift(Term):
    """Drift of bar length and circle centre with time or temperature u: columns u and u B̂.

    B̂ is the direction of the bar. u is the difference from the campaign's mean of the tests'
    ``time_s`` or ``temperature_C``, as ``over`` states. ``length_um`` and ``centre_um`` are prior
    sds per hour or kelvin; a steel bar of 150 mm grows by 1.7 µm/K. The term is off by default,
    because `SetupShift` covers random changes between circles.

    Examples
    --------
    >>> model.with_term(lb.terms.Drift("temperature", length_um=1.7)).terms[-1]
    'Drift'
    >>> lb.terms.Drift.unit_of("drift_temperature_length").label
    'µm/K'
    """

    over: Covariate = "time"  #: quantity that the drift is proportional to: time or temperature
    length_um: float = 2.0  #: prior sd of the bar's length per hour or kelvin
    centre_um: float = 5.0  #: prior sd of each coordinate of the centre per hour or kelvin
    on_demand = True
    remedy = "Run the forces in an order that has nothing to do with time."

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return the columns of the drift of bar length and circle centre."""
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
        """Return the unit of a drift coefficient, such as mm/K, given its name."""
        per = "h" if coefficient.startswith("drift_time") else "K"
        return Unit(f"mm/{per}", 1e-3, f"µm/{per}")

    @classmethod
    def describe(cls, coefficient: str) -> str:
        """Return a drift coefficient in words, from its name."""
        covariate, quantity = coefficient.removeprefix("drift_").split("_")
        if quantity == "length":
            return f"drift of the bar's length over {covariate}"
        return f"drift of the centre along {quantity} over {covariate}"
