"""Forces, geometry and other test conditions of a campaign, as the model needs them.

A `Setting` holds forces, radii, clockings (angles by which the balls are turned in their sockets)
and directions of travel, one entry for each test. It also holds the effect of each compliance and
geometric error on the reading. Such an effect is a function of the angle θ on the circle, and is
stored as 25 Fourier coefficients (of 1, cos θ, sin θ, …, cos 12θ, sin 12θ).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from math import gamma
from typing import Any, Literal, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Campaign, CircularTest, Instrument
from ldbb_bayes.campaign.circular_test import setup_number
from ldbb_bayes.campaign.directions import planes_run_both_ways
from ldbb_bayes.campaign.run_times import SECONDS_PER_TEST
from ldbb_bayes.errors import require
from ldbb_bayes.machine.linear import compliance_jacobian, geometric_jacobian
from ldbb_bayes.machine.parameters import ComplianceName, GeometricName, geometric_names
from ldbb_bayes.model.fourier import MAX_ORDER, ORDERS, SIZE, basis, coefficients, harmonic_index
from ldbb_bayes.results import Array

__all__ = [
    "TRAVEL_NAMES",
    "TRAVEL_SIGNS",
    "CirclePath",
    "GroupOfTests",
    "Setting",
    "geometric_errors_of",
    "setting_of",
]

# Sign of each direction of travel along a circle: 1 for clockwise (CW), −1 for counterclockwise
# (CCW).
TRAVEL_SIGNS = {"CW": 1.0, "CCW": -1.0}
# Name of the direction of travel along a circle for each sign: clockwise (CW) for 1,
# counterclockwise (CCW) for −1.
TRAVEL_NAMES = {1.0: "CW", -1.0: "CCW"}
_SECONDS_PER_HOUR = 3600.0
# If the times of all tests differ from their mean by less than this number of hours, all tests are
# treated as if they were run at the same time.
_SAME_TIME_H = 1e-9
# Fourier coefficients of powers |u|^a of a component u of the bar's direction are set to zero if
# their absolute value is at most this number, because they are then rounding errors.
_POWER_ROUNDING = 1e-12
# Largest number of results that the cache of `_power_of_cosine` holds. A result is a power |u|^a of
# a component u of the bar's direction.
_KEPT_POWERS = 256
# Fourier coefficients of rotated harmonics cos n(θ − ψ), sin n(θ − ψ) are set to zero if their
# absolute value is below this number, because they are then rounding errors.
_ROTATION_ROUNDING = 1e-14
# Two clocking angles count as equal if the distance between their points on the unit circle is at
# most this number.
_SAME_CLOCKING = 1e-9


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
    #: missing, they are derived from the order in which the tests are listed (``_time_h`` states
    #: the rules). All values are NaN if times are missing and the user has declared that the tests
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


class _MachineColumns(NamedTuple):
    """Direction of the bar and effects of parameters, as functions of the angle on a circle.

    Each field holds Fourier coefficients, shape (..., 25, columns). ``direction`` is the unit
    vector along the bar; its columns are the components X, Y, Z. ``elastic`` is the reading per
    unit force and per unit of each compliance, and ``geometric`` is the reading per unit of each
    geometric error.
    """

    direction: Array
    elastic: Array
    geometric: Array


# Cache of the effects of compliances and geometric errors on the readings. For each campaign, it
# has one entry for every set of compliances that a model uses. The cache saves time because a
# comparison applies hundreds of models to one campaign.
_MACHINE_COLUMNS: WeakKeyDictionary[Campaign, dict[tuple[ComplianceName, ...], _MachineColumns]] = (
    WeakKeyDictionary()
)


def geometric_errors_of(campaign: Campaign) -> tuple[GeometricName, ...]:
    """Return the names of the geometric errors of a campaign's machine.

    The names include offsets of the tool ball from its nominal position, which are separate for
    each set-up. A set-up has an offset along every axis that lies in the plane of at least one of
    its tests; tests that are foreseen but not yet run count as well. The name of an offset ends in
    the number of its set-up. For the first set-up, the name has no number. A test that states no
    set-up belongs to the first one.
    """
    names: list[GeometricName] = []
    for name in geometric_names(campaign.machine()):
        if name.kind != "offset":
            names.append(name)
            continue
        setups = {
            setup_number(test) for test in campaign.scope if name.component in str(test.plane)
        }
        for setup in sorted(setups):
            names.append(replace(name, setup=0 if setup == 1 else setup))
    return tuple(names)


def setting_of(
    campaign: Campaign,
    compliances: Sequence[ComplianceName],
    reference_force_N: float | None,
    *,
    pilot: Campaign | None,
    coefficients_of_pilot: bool,
) -> Setting:
    """Return the conditions of the tests of a campaign or plan, as the model needs them.

    Some fields are filled in only when a model is applied to the campaign. Until then, the
    estimated compliances and the readings that they predict are zero, and no circle has a factor
    that multiplies its noise.

    Parameters
    ----------
    campaign
        Campaign or plan.
    compliances
        Names of the compliances of the model.
    reference_force_N
        Reference force F0 [N]; None means the midpoint of the range of forces.
    pilot
        Campaign from which a plan takes F0 (if ``reference_force_N`` is None), the range of the
        forces, and the mean time and temperature. If it is None, these values are taken from
        ``campaign`` itself.
    coefficients_of_pilot
        Whether the coefficients of all effects are those of an analysis of the pilot. The largest
        force and the reference of the travel are then those of the pilot. Otherwise they are those
        of ``campaign``, because an analysis of the planned tests takes them from these.
    """
    machine = campaign.machine()
    tests = campaign.tests
    columns = _machine_columns(campaign, compliances)
    clockings = np.deg2rad([[test.work_ball_deg, test.tool_ball_deg] for test in tests])
    turned = np.exp(1j * clockings)
    clocked = bool(np.abs(turned - turned[0]).max() > _SAME_CLOCKING)
    reference = pilot or campaign
    analysed = reference if coefficients_of_pilot else campaign
    forces = reference.forces_N
    if reference_force_N is None:
        reference_force_N = (forces.min() + forces.max()) / 2.0
    setup = np.array([setup_number(test) for test in tests])
    radius_mm = _radii_mm(tests)
    travel = np.array([TRAVEL_SIGNS[test.direction or "CW"] for test in tests])
    plane_of_tests = [str(test.plane) for test in tests]
    paths = map(CirclePath, plane_of_tests, radius_mm.tolist(), travel.tolist())
    moves = np.abs(columns.direction).max(axis=(0, 1)) > 0.0
    return Setting(
        force_N=campaign.forces_N,
        pressure_bar=campaign.pressures_bar,
        radius_mm=radius_mm,
        work_ball_rad=clockings[:, 0],
        tool_ball_rad=clockings[:, 1],
        plane=np.array(plane_of_tests),
        setup=setup,
        travel=travel,
        time_h=_time_h(campaign, pilot),
        temperature_K=_relative_to_mean("temperature_C", campaign, pilot),
        direction=columns.direction,
        elastic=columns.elastic,
        geometric=_with_offsets_by_setup(campaign, columns.geometric),
        reference_force_N=float(reference_force_N),
        force_range_N=float(forces.max() - forces.min()),
        two_balls=clocked,
        clocked=clocked,
        radii_mm=tuple(sorted({float(test.radius_mm or 0.0) for test in tests})),
        drifts=campaign.drift,
        setups=tuple(sorted({*setup.tolist()})),
        planes=tuple(machine.planes),
        both_ways=planes_run_both_ways(campaign),
        paths=tuple(sorted(set(paths))),
        moving_axes=tuple(np.flatnonzero(moves).tolist()),
        centre_mm=_centres_mm(tests),
        reference_centre_mm=analysed.mean_centre_mm,
        reference_radius_mm=float(_radii_mm(analysed.tests).min()),
        largest_force_N=float(analysed.forces_N.max()),
        circle=np.array([""] * len(tests)),
        compliance_estimate=np.zeros(len(compliances)),
        compliance_size_estimate=np.zeros(len(compliances)),
        axial_size_estimate=np.zeros(3),
        fitted=np.zeros((len(tests), SIZE)),
        compensated=campaign.mount.compensated,
        deflection_um_per_bar=campaign.mount.deflection_um_per_bar,
        instrument=campaign.instrument,
    )


def _radii_mm(tests: Sequence[CircularTest]) -> Array:
    """Return the nominal radii of the tests' circles [mm], shape (tests,)."""
    return np.array([test.radius_mm for test in tests], dtype=float)


def _centres_mm(tests: Sequence[CircularTest]) -> Array:
    """Return the centres of the tests' circles on X, Y and Z [mm], shape (tests, 3)."""
    return np.array([test.circle.centre_mm for test in tests], dtype=float)


def _machine_columns(campaign: Campaign, compliances: Sequence[ComplianceName]) -> _MachineColumns:
    """Return the direction of the bar and the effects of all parameters, for every test.

    The parameters are the compliances with the names ``compliances``, and all geometric errors of
    the machine that ``campaign`` describes. An effect is the change of the reading per unit of a
    parameter. The direction and the effects are functions of the angle on the circle. They are
    returned as 25 Fourier coefficients, in arrays of shape (tests, 25, columns). The columns are
    the components X, Y, Z of the direction, or the parameters.
    """
    of_campaign = _MACHINE_COLUMNS.setdefault(campaign, {})
    names = tuple(compliances)
    if names not in of_campaign:
        machine = campaign.machine()
        by_circle = {}
        for circle in {test.circle for test in campaign.tests}:
            by_circle[circle] = _MachineColumns(
                coefficients(circle.direction),
                coefficients(partial(compliance_jacobian, machine, circle, names=names)),
                coefficients(partial(geometric_jacobian, machine, circle)),
            )
        of_tests = [by_circle[test.circle] for test in campaign.tests]
        of_campaign[names] = _MachineColumns(
            np.stack([columns.direction for columns in of_tests]),
            np.stack([columns.elastic for columns in of_tests]),
            np.stack([columns.geometric for columns in of_tests]),
        )
    return of_campaign[names]


def _with_offsets_by_setup(campaign: Campaign, columns: Array) -> Array:
    """Return the columns of a campaign's geometric errors, with separate offsets for each set-up.

    A column is the change of the reading per unit of one error, as Fourier coefficients.
    ``columns``, shape (tests, 25, errors), holds the columns of the machine's errors. The column of
    an offset of the tool ball is replaced by several columns, one for each set-up that has this
    offset (`geometric_errors_of`). The offset of a set-up acts only in the tests of this set-up.
    """
    machine_errors = [name.label for name in geometric_names(campaign.machine())]
    names = geometric_errors_of(campaign)
    index = [machine_errors.index(replace(name, setup=0).label) for name in names]
    chosen = columns[:, :, index]
    for j, name in enumerate(names):
        if name.kind == "offset":
            in_other_setup = [test.setup != (name.setup or 1) for test in campaign.tests]
            chosen[in_other_setup, :, j] = 0.0
    return chosen


def _time_h(campaign: Campaign, pilot: Campaign | None) -> Array:
    """Return the time of every test minus the mean time of the campaign [h], shape (tests,).

    If times are given for all tests, these times are used. Otherwise the tests are assumed to have
    been run in the order in which they are listed, one every six minutes; if the user has declared
    that the order was random, all values are NaN instead. All values are also NaN if all tests have
    the same time.

    A plan may have a ``pilot``, the campaign from which it was designed. There are then three
    cases:

    - All tests of the pilot have times. The mean of these times is subtracted from the times of the
      plan.
    - Times are missing in the pilot, but not in the plan. The mean time of the plan is subtracted.
    - Times are missing in both. If the first tests of the plan have the same names as the tests of
      the pilot, these tests are assumed to have been run in the order of the pilot, one every six
      minutes. Otherwise all tests have the time 0.

    If the plan begins with the tests of the pilot, every further test without a time is a test that
    could be the next one: it is assumed to be run six minutes after the last test of the pilot.
    Other tests without a time get the value 0, the mean time of the pilot.
    """
    stated_s = _field_of_tests("time_s", campaign)
    relative_s = np.zeros(len(stated_s))
    pilot_s = _field_of_tests("time_s", pilot or campaign)
    begins_with_pilot = _begins_with(campaign, pilot or campaign)
    if np.isfinite(pilot_s).all():
        if begins_with_pilot:
            next_s = pilot_s.max() + SECONDS_PER_TEST
            stated_s = np.where(np.isfinite(stated_s), stated_s, next_s)
        relative_s = np.nan_to_num(stated_s - pilot_s.mean())
    elif np.isfinite(stated_s).all():
        relative_s = stated_s - stated_s.mean()
    elif campaign.order is None and begins_with_pilot:
        relative_s = _times_from_order_s(pilot or campaign, len(campaign.tests))
    relative_h: Array = relative_s / _SECONDS_PER_HOUR
    if np.abs(relative_h).max() < _SAME_TIME_H:
        return np.full(len(relative_h), np.nan)
    return relative_h


def _times_from_order_s(campaign: Campaign, number: int) -> Array:
    """Return the times of ``number`` tests [s], of which the first are the tests of a campaign.

    These are assumed to have been run in the order in which they are listed, at equal intervals.
    Each of the other tests could be run next, one interval after the last test of the campaign. The
    mean time of the campaign is subtracted; if there are other tests, the mean time of the campaign
    and one of these. All results are zero if the user has declared that the tests were run in
    random order.
    """
    if campaign.order is not None:
        return np.zeros(number)
    run = len(campaign.tests)
    listed_s = SECONDS_PER_TEST * np.minimum(np.arange(number), run)
    return np.asarray(listed_s - listed_s[: run + 1].mean())


def _begins_with(campaign: Campaign, pilot: Campaign) -> bool:
    """Return whether the first tests of a campaign have the names of the tests of its pilot.

    The pilot is the campaign from which a plan was designed.
    """
    names = [test.name for test in campaign.tests]
    pilot_names = [test.name for test in pilot.tests]
    return names[: len(pilot_names)] == pilot_names


def _relative_to_mean(
    field: str,
    campaign: Campaign,
    pilot: Campaign | None,
) -> Array:
    """Return a quantity of every test minus the mean of this quantity, shape (tests,).

    ``field`` is the name of the field of a test, such as temperature_C. If a ``pilot`` is given
    (the campaign from which a plan was designed), the mean over its tests is subtracted, and tests
    without a value are assumed to be at this mean. Otherwise the mean over the tests of the
    campaign is subtracted, and tests without a value get NaN. All values are NaN if there is no
    value from which the mean can be computed.
    """
    values = _field_of_tests(field, campaign)
    reference = _field_of_tests(field, pilot or campaign)
    if not np.isfinite(reference).any():
        return values * np.nan
    relative: Array = values - np.nanmean(reference)
    if pilot is None:
        return relative
    return np.where(np.isfinite(relative), relative, 0.0)


def _field_of_tests(field: str, campaign: Campaign) -> Array:
    """Return the values of one field of all tests of a campaign, shape (tests,).

    ``field`` is the name of the field, such as time_s. The result is NaN for tests without a value.
    """
    values = [getattr(test, field) for test in campaign.tests]
    return np.array([np.nan if value is None else value for value in values], dtype=float)
