"""Forces, geometry and other test conditions of a campaign, as the model needs them.

A `Setting` holds forces, radii, clockings (angles by which the balls are turned in their sockets)
and directions of travel, one entry for each test. It also holds the effect of each compliance and
geometric error on the reading. Such an effect is a function of the angle θ on the circle, and is
stored as 25 Fourier coefficients (of 1, cos θ, sin θ, …, cos 12θ, sin 12θ).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import gamma
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Instrument
from ldbb_bayes.errors import require
from ldbb_bayes.model.fourier import MAX_ORDER, ORDERS, SIZE, basis, harmonic_index
from ldbb_bayes.results import Array

__all__ = [
    "TRAVEL_NAMES",
    "TRAVEL_SIGNS",
    "CirclePath",
    "GroupOfTests",
    "Setting",
]

# Sign of each direction of travel along a circle: 1 for clockwise (CW), −1 for counterclockwise
# (CCW).
TRAVEL_SIGNS = {"CW": 1.0, "CCW": -1.0}
# Name of the direction of travel along a circle for each sign: clockwise (CW) for 1,
# counterclockwise (CCW) for −1.
TRAVEL_NAMES = {1.0: "CW", -1.0: "CCW"}
# Fourier coefficients of powers |u|^a of a component u of the bar's direction are set to zero if
# their absolute value is at most this number, because they are then rounding errors.
_POWER_ROUNDING = 1e-12
# Largest number of results that the cache of `_power_of_cosine` holds. A result is a power |u|^a of
# a component u of the bar's direction.
_KEPT_POWERS = 256
# Fourier coefficients of rotated harmonics cos n(θ − ψ), sin n(θ − ψ) are set to zero if their
# absolute value is below this number, because they are then rounding errors.
_ROTATION_ROUNDING = 1e-14


class GroupOfTests(NamedTuple):
    """Tests of a campaign that have the same plane, the same radius or the same set-up."""

    #: Plane (such as XY), radius [mm] or number of the set-up that all tests of a group have in
    #: common.
    value: Any
    #: Text at the end of the names of coefficients that apply only to one group of tests, such as
    #: ``_XY`` for the tests in one plane; empty if the group contains all tests of the campaign.
    suffix: str
    #: For each test of the campaign, whether it belongs to a group of tests with the same plane,
    #: radius or set-up, shape (tests,).
    tests: NDArray[np.bool_]


class CirclePath(NamedTuple):
    """Path of a circle: circles with the same path differ only in force, clocking and set-up."""

    plane: str  #: plane of the circle, such as XY
    radius_mm: float  #: nominal radius of the circle [mm]
    travel: float  #: direction of travel: +1 for clockwise, −1 for counterclockwise


@dataclass(frozen=True, eq=False)
class Setting:
    """Test conditions of a campaign, as the model needs them.

    Most arrays have one row for each test. Functions of the angle θ on the circle are stored as the
    25 coefficients of 1, cos θ, sin θ, …, cos 12θ, sin 12θ.
    """

    force_N: Array  #: radial force of the bar in each test [N], shape (tests,)
    pressure_bar: Array  #: pressure of the regulator in each test [bar], shape (tests,)
    radius_mm: Array  #: nominal radius of each test's circle [mm], shape (tests,)
    #: clocking of the work ball in each test: the angle by which the ball is turned in its socket
    #: [rad], shape (tests,)
    work_ball_rad: Array
    #: clocking of the tool ball in each test: the angle by which the ball is turned in its socket
    #: [rad], shape (tests,)
    tool_ball_rad: Array
    plane: Array  #: plane of each test's circle, such as XY, shape (tests,)
    setup: Array  #: index of the set-up of each test, counted from 1, shape (tests,)
    #: direction of travel along each test's circle, shape (tests,): +1 for clockwise, −1 for
    #: counterclockwise; +1 also if no direction is given for the test
    travel: Array
    #: time of each test minus the mean time of the campaign [h], shape (tests,). For a plan, the
    #: mean time of the campaign from which it was designed (its pilot) is subtracted. If times are
    #: missing, they are derived from the order in which the tests are listed, with one test every
    #: six minutes. All values are NaN if times are missing and the user has declared that the tests
    #: were run in random order, or if all tests have the same time.
    time_h: Array
    #: temperature of each test minus the mean temperature of the campaign [K], shape (tests,); NaN
    #: if unknown. For a plan, the mean temperature of the campaign from which it was designed (its
    #: pilot) is subtracted
    temperature_K: Array
    #: Fourier coefficients of the components X, Y, Z of the unit vector along the bar, shape
    #: (tests, 25, 3). The components are functions of the angle on the circle
    direction: Array
    #: Fourier coefficients of the change of the reading per unit force and per unit of each
    #: compliance, shape (tests, 25, compliances). The change is a function of the angle on the
    #: circle
    elastic: Array
    #: Fourier coefficients of the change of the reading per unit of each geometric error, shape
    #: (tests, 25, geometric errors). The change is a function of the angle on the circle
    geometric: Array
    # `reference_force_N` and the fields below it describe the whole campaign, and the method
    # `select` leaves them unchanged. The exceptions are `circle` and `fitted`, which have one row
    # for each test; `select` selects their rows too.

    #: reference force F0 [N], at which compliances are stated. Slopes (changes of compliances with
    #: force) are multiplied by powers of F − F0, where F is the force of a test
    reference_force_N: float
    force_range_N: float  #: largest minus smallest bar force of the campaign [N]
    #: whether the form errors of work ball and tool ball are modelled separately; otherwise only
    #: the sum of both form errors is modelled
    two_balls: bool
    #: whether the clocking of a ball differs between tests
    clocked: bool
    radii_mm: tuple[float, ...]  #: the different nominal radii of the campaign's circles [mm]
    drifts: bool  #: whether the bar's length and the circle's centre may drift between tests
    setups: tuple[int, ...]  #: numbers of the campaign's set-ups, such as 1 and 2
    planes: tuple[str, ...]  #: planes in which the machine runs circles, such as XY
    both_ways: tuple[str, ...]  #: planes in which circles run in both directions of travel
    paths: tuple[CirclePath, ...]  #: the different paths of the campaign's circles
    #: indices of the axes that move in the campaign's tests: X is 0, Y is 1, Z is 2
    moving_axes: tuple[int, ...]
    centre_mm: Array  #: centre of each test's circle on X, Y and Z [mm], shape (tests, 3)
    #: position on X, Y and Z [mm] at which compliances are stated if they change along the travel:
    #: for each axis, the mean of the centres of those circles in which it moves
    reference_centre_mm: tuple[float, ...]
    #: smallest nominal radius of the campaign's circles [mm]. It is the length over which the prior
    #: of a change of compliance along the travel is stated
    reference_radius_mm: float
    largest_force_N: float  #: largest bar force of the whole campaign [N]
    #: name of the hyper-parameter λ (noise factor) that multiplies the noise of each test's circle,
    #: shape (tests,); empty string if circles have no noise factors
    circle: Array
    #: estimate of each compliance in internal units (mm, N, rad), shape (compliances,). Effects on
    #: the readings that depend nonlinearly on the compliances are linearised about this estimate
    compliance_estimate: Array
    #: magnitude of each compliance in internal units (mm, N, rad), shape (compliances,): the
    #: estimate of the compliance and the standard uncertainty of this estimate, added in
    #: quadrature. The default prior sds of the compliances' changes with force are proportional to
    #: these magnitudes
    compliance_size_estimate: Array
    #: magnitude of the direct compliance (displacement along an axis per force along this axis) of
    #: X, Y and Z [mm/N], shape (3,); zero for an axis without a direct compliance
    axial_size_estimate: Array
    #: Fourier coefficients of the readings that the estimated compliances and geometric errors
    #: predict, shape (tests, 25) [mm]
    fitted: Array
    #: whether the readings are compensated for the deflection of the work ball's mount
    compensated: bool
    #: nominal deflection of the work ball's mount per pressure of the regulator [µm/bar]
    deflection_um_per_bar: float
    #: values that certificates state for the bar, the balls, the mount, the force and the angle,
    #: with their uncertainties
    instrument: Instrument

    @property
    def tests(self) -> int:
        """Number of tests whose conditions (force, radius and so on) this object holds."""
        return len(self.force_N)

    def select(self, rows: Sequence[int]) -> Setting:
        """Return the test conditions of only some of the tests.

        ``rows`` holds the indices of the selected tests, from 0. Properties of the whole campaign,
        such as its range of forces, do not change.
        """
        selected: dict[str, Any] = {}
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray) and not name.endswith("_estimate"):
                selected[name] = value[list(rows)]
        return replace(self, **selected)

    @property
    def tested_planes(self) -> tuple[str, ...]:
        """Planes with at least one circle. Foreseen circles, which may be run later, do not count.

        These planes, not ``planes``, are those of which a stiffness or a path can be stated.
        """
        return tuple(plane for plane in self.planes if plane in self.plane)

    @property
    def travels(self) -> tuple[float, ...]:
        """Directions of travel in the whole campaign: 1 is clockwise, −1 is counterclockwise."""
        return tuple(sorted({path.travel for path in self.paths}, reverse=True))

    @property
    def bow(self) -> Array:
        """Parabola 4 (F/F_max)(1 − F/F_max) at the force F of every test, shape (tests,).

        F_max is the largest force of the campaign. The parabola is 0 at F = 0 and at F = F_max, and
        1 at half of F_max.
        """
        share = self.force_N / self.largest_force_N
        return np.asarray(4.0 * share * (1.0 - share))

    def driven_axes(self) -> list[tuple[int, float]]:
        """Return the axes that move in the campaign, and the magnitudes of their compliances.

        The result is a list of pairs: the index of an axis (X is 0, Y is 1, Z is 2), and the
        magnitude of the axis' direct compliance, which is the displacement along the axis per force
        along the axis [mm/N]. Axes without a direct compliance are left out.
        """
        axes = []
        for axis in self.moving_axes:
            size = float(self.axial_size_estimate[axis])
            if size != 0.0:
                axes.append((axis, size))
        return axes

    def along(
        self,
        axis: int,
        power: float,
        *,
        signed: bool = False,
    ) -> Array:
        """Return Fourier coefficients of |u|^a, where u is one component of the bar's direction.

        u = A cos(θ − ϑ) is the X, Y or Z component of the unit vector along the bar, with amplitude
        A and phase ϑ; θ is the angle on the circle. The series is |u|^a = A^a Σ s_n cos n(θ − ϑ),
        summed over even n up to 12, or over odd n if |u|^a is multiplied by the sign of u. The
        coefficients of the series are s_n = 2^(1−a) Γ(a+1) / (Γ(1+(a+n)/2) Γ(1+(a−n)/2)), where Γ
        is the gamma function; s_0 is half of this expression.

        Parameters
        ----------
        axis
            Index of the machine axis: X is 0, Y is 1, Z is 2.
        power
            Exponent a of |u|^a.
        signed
            Whether |u|^a is multiplied by the sign of u.

        Returns
        -------
        Fourier coefficients, shape (tests, 25).
        """
        first_harmonics = self.direction[:, 1:3, axis]
        values = _power_of_cosine(first_harmonics.tobytes(), power, signed=signed)
        return values.copy()

    def groups_by(self, kind: Literal["plane", "radius", "setup"]) -> Iterator[GroupOfTests]:
        """Yield the tests of the campaign in groups.

        ``kind`` states whether the tests of a group have the same plane, the same radius or the
        same set-up.
        """
        of_tests: Array
        of_campaign: Sequence[Any]
        if kind == "plane":
            of_tests = self.plane
            of_campaign = self.planes
        elif kind == "radius":
            of_tests = self.radius_mm
            of_campaign = self.radii_mm
        else:
            of_tests = self.setup
            of_campaign = self.setups
        for value in of_campaign:
            text = value if isinstance(value, str) else f"{value:g}"
            suffix = f"_{text}" if len(of_campaign) > 1 else ""
            yield GroupOfTests(value, suffix, of_tests == value)

    def harmonics(
        self,
        orders: Sequence[int],
        turned_rad: Array | float = 0.0,
    ) -> Array:
        """Return cos n(θ − ψ) and sin n(θ − ψ) of several orders n, as Fourier coefficients.

        θ is the angle on the circle, and ψ the clocking angle by which a ball is turned in its
        socket.

        Parameters
        ----------
        orders
            Orders n of the harmonics, from 1 to 12. `constant` gives an effect of order 0.
        turned_rad
            Angle ψ of every test [rad], shape (tests,), or one number for all tests.

        Returns
        -------
        Fourier coefficients, shape (tests, 25, 2 · number of orders). The last dimension holds
        cosine and sine of the first order, then of the second, and so on.

        Raises
        ------
        InputError
            If an order is not a whole number from 1 to 12.
        """
        for n in orders:
            require(
                n in range(1, MAX_ORDER + 1),
                f"orders of harmonics must be whole numbers from 1 to {MAX_ORDER}, got {n}. For an"
                " effect that is constant over the circle take setting.constant.",
            )
        values = np.zeros((self.tests, SIZE, 2 * len(orders)))
        for j, n in enumerate(orders):
            cosine, sine = harmonic_index(n)
            turn = n * np.remainder(turned_rad, 2 * np.pi)
            values[:, cosine, 2 * j] = np.cos(turn)
            values[:, sine, 2 * j] = np.sin(turn)
            values[:, cosine, 2 * j + 1] = -np.sin(turn)
            values[:, sine, 2 * j + 1] = np.cos(turn)
        return np.where(np.abs(values) < _ROTATION_ROUNDING, 0.0, values)

    def constant(self, values: Array) -> Array:
        """Return p effects that are constant over the circle, as Fourier coefficients.

        The result has the shape (tests, 25, p); only the first of the 25 coefficients is not zero.

        Parameters
        ----------
        values
            Constants of every test, shape (tests, p), or (tests,) for a single effect.
        """
        columns_of_tests = values[:, None] if values.ndim == 1 else values
        columns = np.zeros((self.tests, SIZE, columns_of_tests.shape[1]))
        columns[:, 0] = columns_of_tests
        return columns


@lru_cache(maxsize=_KEPT_POWERS)
def _power_of_cosine(first_harmonics: bytes, power: float, *, signed: bool) -> Array:
    """Return Fourier coefficients of a power of one component of the bar's direction.

    u is the X, Y or Z component of the unit vector along the bar, as a function of the angle θ on
    the circle; this function is a cosine with an amplitude and a phase. The result, shape (tests,
    25), describes |u|^``power``, multiplied by the sign of u if ``signed`` is true; the method
    `Setting.along` states the formula. ``first_harmonics`` is an array of shape (tests, 2) that
    holds the coefficients of cos θ and sin θ in u. It is given as bytes, so that it can be a key of
    the cache in which results are kept. The cache saves time, because the models of a campaign need
    the same powers hundreds of times.
    """
    first = int(signed)
    series = np.zeros(MAX_ORDER + 1)
    series[first] = 2.0 ** (1.0 - power) * gamma(power + 1.0)
    series[first] /= gamma(1.0 + (power + first) / 2.0) * gamma(1.0 + (power - first) / 2.0)
    for n in range(first, MAX_ORDER - 1, 2):
        series[n + 2] = series[n] * (power - n) / (power + n + 2)
    series[0] /= 2.0
    harmonics = np.frombuffer(first_harmonics).reshape(-1, 2)
    cosine = harmonics[:, 0]
    sine = harmonics[:, 1]
    amplitude = np.hypot(cosine, sine)[:, None] ** power
    values = amplitude * series[ORDERS] * basis(np.arctan2(sine, cosine))
    return np.where(np.abs(values) > _POWER_ROUNDING, values, 0.0)
