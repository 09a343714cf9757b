"""Nuisance terms of the machine's joints: compliance that changes with load or along the travel.

Nuisance terms are effects that are modelled but not of interest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ldbb_bayes.errors import require
from ldbb_bayes.machine.chain import LINEAR
from ldbb_bayes.model.setting import Setting
from ldbb_bayes.model.terms.base import MACHINE_CORRELATION, Term, Unit
from ldbb_bayes.model.terms.columns import BasisNoise, Columns
from ldbb_bayes.results import Array

__all__ = [
    "JointLoad",
    "Position",
    "joint_load_columns",
    "joint_load_names",
    "secants_along_axis",
]

# Exponent a in the effect of a bolted contact on the reading, which is proportional to |u|^a. u is
# the cosine of the angle between bar and machine axis. If the bar has the force F, the force along
# the axis is F u, and the contact deflects in proportion to |F u|^(2/3). The reading changes by |u|
# times this deflection, so that a = 2/3 + 1 = 5/3.
_CONTACT_POWER = 5.0 / 3.0


class _LawInWords(NamedTuple):
    """Description in words of a nonlinear deflection of a machine axis.

    ``effect`` names the kind of deflection, and ``load`` the load that causes it.
    """

    effect: str
    load: str


# Descriptions in words of the three nonlinear deflections of an axis. The name of a deflection's
# coefficient ends with the key, as in joint_load_X_contact. The order is that of the coefficients.
_LAWS = {
    "slope": _LawInWords("stiffening", "its own load"),
    "contact": _LawInWords("contact", "its own load"),
    "seat": _LawInWords("seat", "the bar's force"),
}


@dataclass(frozen=True)
class JointLoad(Term):
    """Nonlinear deflection of each machine axis a, under its own load F u_a and under the force F.

    u_a is the cosine of the angle between bar and axis. F is the bar's force, F0 the reference
    force and F_max the largest force of the campaign. The term has three columns (changes of the
    reading per unit coefficient) for each axis:

    - F u_a² (F |u_a| − F0)/F_max, for preload and rolling contact;
    - F^⅔ F0^⅓ |u_a|^(5/3) − F u_a², for bolted contact (deflection proportional to load^⅔);
    - (F^⅔ F0^⅓ − F) u_a², for a seat. A seat is a contact that deflects under the bar's whole force
      and not only under the component of the force along the axis.

    All columns are zero if F = F0 and the bar points along the axis. The direct compliance C_aa of
    the axis is therefore the axis' deflection divided by the force, for this force and direction
    (secant compliance). The prior sd of each coefficient is ``relative_sd`` times the magnitude of
    C_aa: the estimate of C_aa and its standard uncertainty, added in quadrature.

    F0 must be positive, because the compliance of a contact that stiffens under its own load is not
    defined at zero load. With F0 = 0, two of the columns would be −F u_a², and readings could not
    separate them from the effect of C_aa.

    Examples
    --------
    >>> columns = lb.terms.JointLoad().columns(model.bind(campaign).setting)
    >>> columns[0].names
    ('joint_load_X_slope', 'joint_load_X_contact', 'joint_load_X_seat')
    >>> lb.terms.JointLoad.describe("joint_load_X_contact")
    'contact of axis X under its own load'
    """

    #: prior sd of each coefficient of the nonlinear deflection of a machine axis, as a fraction of
    #: the magnitude of the axis' direct compliance
    relative_sd: float = 0.4
    unit = Unit("mm/N", 1e-6, "nm/N")
    machine = True
    campaign_correlation = MACHINE_CORRELATION
    calibration = "a narrower prior of it"
    remedy = "Measure the axis' deflection under its own load."

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return the columns of the nonlinear deflection of each axis that the circles drive.

        ``setting`` describes the test conditions. A column holds, for every test, the change of the
        reading per unit of one coefficient.
        """
        reference_N = setting.reference_force_N
        require(
            reference_N > 0.0,
            f"reference_force_N must be positive in a model with JointLoad, got {reference_N:g}:"
            " joints that yield to their own load have no finite compliance without load."
            " Give a force that was tested, or leave the term out (--without joint-load).",
        )
        columns = []
        for axis, size in setting.driven_axes():
            values = _deflections(
                setting.force_N[:, None],
                reference_N,
                setting.largest_force_N,
                u_squared=setting.along(axis, 2.0),
                u_cubed=setting.along(axis, 3.0),
                u_contact=setting.along(axis, _CONTACT_POWER),
            )
            names = joint_load_names(LINEAR[axis])
            columns.append(Columns(names, values, np.full(len(names), self.relative_sd * size)))
        return tuple(columns)

    def secants(self, setting: Setting, force_N: Array) -> Array:
        """Return by how much one unit of each coefficient changes the compliance of an axis.

        The change is calculated at the n forces ``force_N``, shape (n,), none of them zero. It is
        the nonlinear deflection of the axis divided by the force of the bar, with the bar along the
        axis. The result has the shape (n, 3), because the term has three coefficients for each
        axis. ``setting`` holds the reference force and the largest force of the campaign.
        """
        return secants_along_axis(force_N, setting.reference_force_N, setting.largest_force_N)

    def deflections(self, setting: Setting, axis: int, r: int, force_N: Array) -> Array:
        """Return the effects of the nonlinear deflections of an axis on the readings of one circle.

        Each axis has three coefficients of nonlinear deflection.

        Parameters
        ----------
        setting
            Conditions of the campaign's tests.
        axis
            Index of the machine axis: X is 0, Y is 1, Z is 2.
        r
            Index of the test, from 0. Only the circle of this test is used; ``force_N`` need not
            contain the force of the test.
        force_N
            The n forces of the bar, shape (n,) [N].

        Returns
        -------
        For each of n forces, the 25 Fourier coefficients of the reading per unit of each of the
        axis' three coefficients, shape (n, 25, 3) [N].
        """
        return _deflections(
            force_N[:, None],
            setting.reference_force_N,
            setting.largest_force_N,
            u_squared=setting.along(axis, 2.0)[r],
            u_cubed=setting.along(axis, 3.0)[r],
            u_contact=setting.along(axis, _CONTACT_POWER)[r],
        )

    @classmethod
    def ratio(cls, coefficient: str, first: Setting, second: Setting) -> float:
        """Return the value of a coefficient in a second campaign if it is one in a first campaign.

        The deflection of the axis is the same function of the force in both campaigns, but for a
        part that is proportional to the force and belongs to the compliance. This holds if the
        coefficient of rolling contact is proportional to F_max, and those of bolted contact and
        seat to F0^(−⅓). ``first`` and ``second`` hold the reference force F0 and the largest force
        F_max of each campaign.
        """
        forces = [
            ForcesOfCampaign(setting.reference_force_N, setting.largest_force_N)
            for setting in (first, second)
        ]
        return ratio_of_coefficients(coefficient, *forces)

    @classmethod
    def describe(cls, coefficient: str) -> str:
        """Return words for a coefficient of a nonlinear deflection, given its name.

        For example, joint_load_X_contact is described as "contact of axis X under its own load".
        """
        axis, law = coefficient.removeprefix("joint_load_").split("_")
        effect, load = _LAWS[law]
        return f"{effect} of axis {axis} under {load}"


class ForcesOfCampaign(NamedTuple):
    """Forces of a campaign on which the values of the coefficients of `JointLoad` depend."""

    reference_N: float  #: reference force F0 of the campaign [N]
    largest_N: float  #: largest force F_max of the campaign [N]


def ratio_of_coefficients(
    coefficient: str, first: ForcesOfCampaign, second: ForcesOfCampaign
) -> float:
    """Return the value of a coefficient in a second campaign if it is one in a first campaign.

    `JointLoad.ratio` says why. ``coefficient`` is the name of the coefficient, and ``first`` and
    ``second`` are the forces of the two campaigns.
    """
    if coefficient.endswith("_slope"):
        return second.largest_N / first.largest_N
    return float(np.cbrt(first.reference_N / second.reference_N))


def joint_load_names(axis: str) -> tuple[str, ...]:
    """Return the names of the coefficients of an axis' nonlinear deflections (term `JointLoad`).

    ``axis`` is the letter of the axis.
    """
    return tuple(f"joint_load_{axis}_{law}" for law in _LAWS)


def secants_along_axis(force_N: Array, reference_force_N: float, largest_force_N: float) -> Array:
    """Return by how much one unit of each coefficient of `JointLoad` changes a direct compliance.

    The change is calculated at the n forces ``force_N``, shape (n,), none of them zero. It is the
    nonlinear deflection of an axis divided by the force of the bar, with the bar along the axis.
    The result has the shape (n, 3), because the term has three coefficients for each axis. It is
    zero at the campaign's reference force ``reference_force_N``. ``largest_force_N`` is the largest
    force of the campaign.
    """
    deflections = _deflections(
        force_N, reference_force_N, largest_force_N, u_squared=1.0, u_cubed=1.0, u_contact=1.0
    )
    return deflections / force_N[:, None]


def _deflections(
    force_N: Array,
    reference_force_N: float,
    largest_force_N: float,
    *,
    u_squared: Array | float,
    u_cubed: Array | float,
    u_contact: Array | float,
) -> Array:
    """Return the deflections of rolling contact, bolted contact and seat per unit compliance.

    The formulas are in `JointLoad`. ``force_N`` holds the forces F, ``reference_force_N`` is F0 and
    ``largest_force_N`` is F_max. Let u be the component of the bar's unit vector along an axis.
    ``u_squared`` is u², ``u_cubed`` is |u|³ and ``u_contact`` is |u|^(5/3), as numbers or as
    Fourier coefficients that are broadcast against the forces. The result has the shape (..., 3)
    [N].
    """
    rolling = force_N * (force_N * u_cubed - reference_force_N * u_squared) / largest_force_N
    contact_force = np.cbrt(force_N**2 * reference_force_N)
    bolted = contact_force * u_contact - force_N * u_squared
    seat = (contact_force - force_N) * u_squared
    return np.stack([rolling, bolted, seat], axis=-1)


def joint_load_columns(
    setting: Setting, columns: Sequence[Columns | BasisNoise]
) -> dict[str, Columns]:
    """Return a dict with the columns of each axis' nonlinear deflections (term `JointLoad`).

    The keys are the letters of the axes. A column holds the change of the reading per unit of one
    coefficient. ``columns`` are the columns of `JointLoad` in the model of a campaign, and
    ``setting`` describes the test conditions. If the model lacks `JointLoad`, ``columns`` and the
    result are empty.
    """
    shared = [block for block in columns if isinstance(block, Columns)]
    if not shared:
        return {}
    axes = [LINEAR[axis] for axis, _ in setting.driven_axes()]
    return dict(zip(axes, shared, strict=True))


@dataclass(frozen=True)
class Position(Term):
    """Change of the compliance of each machine axis a along its travel.

    Screw and guideway are stiffer near their bearings. Let x be the position on axis a, measured
    from the mean centre of the circles in which the axis moves, in units of the smallest radius R₀
    of the campaign's circles. The compliance changes by L x + Q (x² − ½), with the coefficients L
    and Q. On a circle with the radius R and the centre s (in the same units), x = s + (R/R₀) u_a,
    where u_a is the cosine of the angle between bar and axis. With the force F, the columns
    (changes of the reading per unit coefficient) are F u_a² x and F u_a² (x² − ½). If all circles
    have one centre and one radius, they are F u_a³ and F (u_a⁴ − u_a²/2). The prior sds of the
    coefficients are ``linear_sd`` and ``quadratic_sd`` times the magnitude of the axis' direct
    compliance C_aa: the estimate of C_aa and its standard uncertainty, added in quadrature.

    The term leaves C_aa unchanged at the mean centre. Tilts are other columns: they act with the
    distance from the joint's frame (the machine's zero), and C_aa is the compliance there.

    Examples
    --------
    >>> columns = lb.terms.Position().columns(model.bind(campaign).setting)
    >>> columns[0].names
    ('position_X_linear', 'position_X_quadratic')
    >>> lb.terms.Position.describe("position_X_linear")
    'linear change of the compliance along X'
    """

    #: prior sd of the linear change of an axis' compliance along its travel, as a fraction of the
    #: magnitude of the axis' direct compliance
    linear_sd: float = 0.07
    #: prior sd of the quadratic change of an axis' compliance along its travel, as a fraction of
    #: the magnitude of the axis' direct compliance
    quadratic_sd: float = 0.04
    unit = Unit("mm/N", 1e-6, "nm/N")
    machine = True
    campaign_correlation = MACHINE_CORRELATION
    of_circle = True
    calibration = "a narrower prior of it"
    remedy = "Run circles at several centres."

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return the columns for the changes of compliance along the axes that the circles drive.

        ``setting`` describes the test conditions. A column holds, for every test, the change of the
        reading per unit of one coefficient.
        """
        columns = []
        for axis, size in setting.driven_axes():
            values = compliance_along_travel(setting, axis)
            letter = LINEAR[axis]
            names = (f"position_{letter}_linear", f"position_{letter}_quadratic")
            sd = np.array([self.linear_sd, self.quadratic_sd]) * size
            columns.append(Columns(names, values, sd))
        return tuple(columns)

    @classmethod
    def describe(cls, coefficient: str) -> str:
        """Return words for a change of compliance along an axis, given the coefficient's name.

        For example, position_X_linear is described as "linear change of the compliance along X".
        """
        axis, law = coefficient.removeprefix("position_").split("_")
        return f"{law} change of the compliance along {axis}"


def compliance_along_travel(setting: Setting, axis: int) -> Array:
    """Return the columns of a linear and a quadratic change of compliance along an axis.

    The columns are those of `Position`: F u_a² x and F u_a² (x² − ½), with x = s + ρ u_a. The
    compliance at the position x acts on the force F u_a, and its deflection on the reading as u_a.

    Parameters
    ----------
    setting : Setting
        Conditions of the tests.
    axis : int
        Index of the machine axis: X is 0, Y is 1, Z is 2.

    Returns
    -------
    ndarray, shape (tests, 25, 2)
        Fourier coefficients of the readings per unit of L and of Q [N].
    """
    reference_mm = setting.reference_radius_mm
    shift_mm = setting.centre_mm[:, axis] - setting.reference_centre_mm[axis]
    s = (shift_mm / reference_mm)[:, None]
    rho = (setting.radius_mm / reference_mm)[:, None]
    squared = setting.along(axis, 2.0)
    cubed = setting.along(axis, 3.0, signed=True)
    fourth = setting.along(axis, 4.0)
    linear = rho * cubed + s * squared
    quadratic = rho**2 * fourth - 0.5 * squared + 2.0 * s * rho * cubed + s**2 * squared
    force = setting.force_N[:, None]
    return np.stack([force * linear, force * quadratic], axis=2)
