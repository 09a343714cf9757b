"""Forces, geometry and other conditions of a campaign's tests, as the model needs them.

A `Setting` holds forces, radii, clockings and directions of travel, one entry per test, and the
columns of the machine's compliances and geometric errors in the circle's basis.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import gamma
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Campaign, CircularTest, Instrument
from ldbb_bayes.errors import InputError
from ldbb_bayes.machine.linear import compliance_jacobian, geometric_jacobian
from ldbb_bayes.machine.parameters import ComplianceName, GeometricName, geometric_names
from ldbb_bayes.model.fourier import MAX_ORDER, ORDERS, SIZE, basis, coefficients, harmonic_index
from ldbb_bayes.results import Array

__all__ = [
    "TRAVEL_NAMES",
    "TRAVEL_SIGNS",
    "GroupOfTests",
    "Setting",
    "geometric_errors_of",
    "setting_of",
]

# Sign of each direction of travel (clockwise is positive), and the direction of each sign.
TRAVEL_SIGNS = {"CW": 1.0, "CCW": -1.0}
TRAVEL_NAMES = {1.0: "CW", -1.0: "CCW"}
_SECONDS_PER_HOUR = 3600.0
# Basis coefficients of |u|^a and of rotated harmonics that are smaller are rounding errors.
_POWER_ROUNDING = 1e-12
_ROTATION_ROUNDING = 1e-14
# Clockings are equal if their points on the unit circle are closer than this.
_SAME_CLOCKING = 1e-9


class GroupOfTests(NamedTuple):
    """Tests of one plane, radius or set-up."""

    #: The plane, radius or set-up.
    value: Any
    #: Suffix of coefficient names; empty if the campaign has one plane, radius or set-up only.
    suffix: str
    #: Whether each test belongs to the group, shape (tests,).
    tests: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Setting:
    """Conditions of a campaign's tests; most arrays have one row per test."""

    force_N: Array
    pressure_bar: Array
    radius_mm: Array
    work_ball_rad: Array
    tool_ball_rad: Array
    plane: Array
    setup: Array
    travel: Array  #: +1 clockwise or not stated, −1 counterclockwise
    time_h: Array  #: minus the mean of the whole campaign; NaN where not recorded
    temperature_K: Array  #: minus the mean of the whole campaign; NaN where not recorded
    direction: Array  #: basis coefficients (tests, 25, 3) of the bar's direction (X, Y, Z)
    wrench: Array  #: j_C, reading per unit force and compliance, (tests, 25, compliances)
    geometric: Array  #: j_G, reading per unit geometric error, (tests, 25, geometric errors)
    # The following fields describe the whole campaign, and `select` keeps them unchanged; but
    # `circle` and `fitted` have one row per test.
    reference_force_N: float  #: F0, the force at which slopes do not act
    force_range_N: float  #: F_max − F_min
    two_balls: bool  #: whether each of the two balls has a form of its own
    clocked: bool  #: whether the clocking of a ball differs between tests
    radii_mm: tuple[float, ...]  #: the different radii
    setups: tuple[int, ...]  #: the different set-ups
    planes: tuple[str, ...]  #: the machine's planes
    both_ways: tuple[str, ...]  #: planes run in both directions of travel
    largest_force_N: float  #: F_max of the whole campaign
    circle: Array  #: name of each test's hyper-parameter λ; empty if circles have no λ
    compliance_estimate: Array  #: Ĉ (compliances,), used only to linearise
    axial_estimate: Array  #: sums of direct compliances Ĉ along X, Y, Z; zero if there is none
    fitted: Array  #: the circle fitted with Ĉ, F j_C·Ĉ + j_G·Ê, (tests, 25) [mm]
    compensated: bool  #: whether the readings are compensated for the mount
    deflection_um_per_bar: float  #: nominal deflection of the mount
    instrument: Instrument  #: what certificates state

    @property
    def tests(self) -> int:
        """Number of tests."""
        return len(self.force_N)

    def select(self, rows: Sequence[int]) -> Setting:
        """Return the setting of selected tests; properties of the whole campaign are unchanged."""
        selected: dict[str, Any] = {}
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray) and not name.endswith("_estimate"):
                selected[name] = value[list(rows)]
        return replace(self, **selected)

    @property
    def travels(self) -> tuple[float, ...]:
        """The different directions of travel."""
        return tuple(sorted({*self.travel.tolist()}, reverse=True))

    @property
    def bow(self) -> Array:
        """Curvature over force, q(F) = 4 (F/F_max)(1 − F/F_max), shape (tests,) [1]."""
        share = self.force_N / self.largest_force_N
        return np.asarray(4.0 * share * (1.0 - share))

    def driven_axes(self) -> list[tuple[int, float]]:
        """Return the machine axes that the circles drive, each with its compliance |Ĉ_aa| [mm/N].

        Axes are indices: X is 0, Y is 1, Z is 2. Axes without a compliance are left out.
        """
        moves = np.abs(self.direction).max(axis=(0, 1)) > 0.0
        axes = []
        for axis, compliance in enumerate(self.axial_estimate):
            if moves[axis] and compliance != 0.0:
                axes.append((axis, abs(float(compliance))))
        return axes

    def along(
        self,
        axis: int,
        power: float,
        *,
        signed: bool = False,
    ) -> Array:
        """Return the Fourier series of |u|^a to order 12.

        u = A cos(θ − ϑ) is the component of the bar's direction along a machine axis, with
        amplitude A and phase ϑ. The series is A^a Σ s_n cos n(θ − ϑ) over even n (odd n if signed),
        with s_n = 2^(1−a) Γ(a+1) / (Γ(1+(a+n)/2) Γ(1+(a−n)/2)), and half of that for n = 0.

        Parameters
        ----------
        axis
            Index of the machine axis: X is 0, Y is 1, Z is 2.
        power
            Exponent a.
        signed
            Whether |u|^a is multiplied by the sign of u.

        Returns
        -------
        Basis coefficients, shape (tests, 25).
        """
        first = int(signed)
        series = np.zeros(MAX_ORDER + 1)
        series[first] = 2.0 ** (1.0 - power) * gamma(power + 1.0)
        series[first] /= gamma(1.0 + (power + first) / 2.0) * gamma(1.0 + (power - first) / 2.0)
        for n in range(first, MAX_ORDER - 1, 2):
            series[n + 2] = series[n] * (power - n) / (power + n + 2)
        series[0] /= 2.0
        cosine = self.direction[:, 1, axis]
        sine = self.direction[:, 2, axis]
        amplitude = np.hypot(cosine, sine)[:, None] ** power
        values = amplitude * series[ORDERS] * basis(np.arctan2(sine, cosine))
        return np.where(np.abs(values) > _POWER_ROUNDING, values, 0.0)

    def each(self, kind: Literal["plane", "radius", "setup"]) -> Iterator[GroupOfTests]:
        """Yield the tests of every plane, radius or set-up of the campaign."""
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
        """Return columns cos n(θ − ψ) and sin n(θ − ψ) alternately, for every order n.

        Parameters
        ----------
        orders
            The orders n.
        turned_rad
            Angle ψ of every test by which the ball is clocked [rad].

        Returns
        -------
        Basis coefficients, shape (tests, 25, 2 orders).
        """
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
        """Return columns that do not depend on the angle, shape (tests, 25, p).

        Parameters
        ----------
        values
            Shape (tests, p) or (tests,).
        """
        columns_of_tests = values[:, None] if values.ndim == 1 else values
        columns = np.zeros((self.tests, SIZE, columns_of_tests.shape[1]))
        columns[:, 0] = columns_of_tests
        return columns


class _MachineColumns(NamedTuple):
    """Basis coefficients of the bar's direction, j_C and j_G, each (..., 25, columns).

    j_C is the reading per unit force and compliance, j_G that per unit geometric error.
    """

    direction: Array
    wrench: Array
    geometric: Array


def geometric_errors_of(campaign: Campaign) -> tuple[GeometricName, ...]:
    """Return the geometric errors of a campaign's machine.

    Each set-up has its own tool offsets; the names of those after the first end in its number.
    """
    names: list[GeometricName] = []
    for name in geometric_names(campaign.machine()):
        if name.kind != "offset":
            names.append(name)
            continue
        setups = {test.setup or 1 for test in campaign.scope if name.component in str(test.plane)}
        for setup in sorted(setups):
            names.append(replace(name, setup=0 if setup == 1 else setup))
    return tuple(names)


def setting_of(
    campaign: Campaign,
    compliances: Sequence[ComplianceName],
    reference_force_N: float | None,
    *,
    pilot: Campaign | None,
) -> Setting:
    """Return the setting of a campaign or plan.

    Parameters
    ----------
    campaign
        Campaign or plan.
    compliances
        Names of the compliances.
    reference_force_N
        Reference force F0; None means the middle of the range of forces.
    pilot
        Campaign from which a plan takes F0, force range and the zero of time and temperature.
    """
    machine = campaign.machine()
    tests = campaign.tests
    columns = _machine_columns(campaign, compliances)
    clockings = np.deg2rad([[test.work_ball_deg, test.tool_ball_deg] for test in tests])
    turned = np.exp(1j * clockings)
    clocked = bool(np.abs(turned - turned[0]).max() > _SAME_CLOCKING)
    forces = (pilot or campaign).forces_N
    if reference_force_N is None:
        reference_force_N = (forces.min() + forces.max()) / 2.0
    setup = np.array([test.setup or 1 for test in tests])
    return Setting(
        force_N=campaign.forces_N,
        pressure_bar=campaign.pressures_bar,
        radius_mm=np.array([test.radius_mm for test in tests], dtype=float),
        work_ball_rad=clockings[:, 0],
        tool_ball_rad=clockings[:, 1],
        plane=np.array([str(test.plane) for test in tests]),
        setup=setup,
        travel=np.array([TRAVEL_SIGNS[test.direction or "CW"] for test in tests]),
        time_h=_relative_to_mean("time_s", campaign, pilot) / _SECONDS_PER_HOUR,
        temperature_K=_relative_to_mean("temperature_C", campaign, pilot),
        direction=columns.direction,
        wrench=columns.wrench,
        geometric=_by_setup(campaign, columns.geometric),
        reference_force_N=float(reference_force_N),
        force_range_N=float(forces.max() - forces.min()),
        two_balls=clocked,
        clocked=clocked,
        radii_mm=tuple(sorted({float(test.radius_mm or 0.0) for test in tests})),
        setups=tuple(sorted({*setup.tolist()})),
        planes=tuple(machine.planes),
        both_ways=_planes_run_both_ways(campaign),
        largest_force_N=float(forces.max()),
        circle=np.array([""] * len(tests)),
        compliance_estimate=np.zeros(len(compliances)),
        axial_estimate=np.zeros(3),
        fitted=np.zeros((len(tests), SIZE)),
        compensated=campaign.mount.compensated,
        deflection_um_per_bar=campaign.mount.deflection_um_per_bar,
        instrument=campaign.instrument,
    )


def _machine_columns(campaign: Campaign, compliances: Sequence[ComplianceName]) -> _MachineColumns:
    """Return the machine's columns of every test, each of shape (tests, 25, columns)."""
    machine = campaign.machine()
    by_circle = {}
    for circle in {test.circle for test in campaign.tests}:
        by_circle[circle] = _MachineColumns(
            coefficients(circle.direction),
            coefficients(partial(compliance_jacobian, machine, circle, names=compliances)),
            coefficients(partial(geometric_jacobian, machine, circle)),
        )
    of_tests = [by_circle[test.circle] for test in campaign.tests]
    return _MachineColumns(
        np.stack([columns.direction for columns in of_tests]),
        np.stack([columns.wrench for columns in of_tests]),
        np.stack([columns.geometric for columns in of_tests]),
    )


def _by_setup(campaign: Campaign, columns: Array) -> Array:
    """Return the columns of the campaign's geometric errors, given those of the machine.

    A tool offset acts only in its own set-up. Columns have shape (tests, 25, errors).
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


def _relative_to_mean(
    field: str,
    campaign: Campaign,
    pilot: Campaign | None,
) -> Array:
    """Return a recorded field minus its mean over the campaign or its pilot, shape (tests,).

    Tests of a plan that record no value are assumed at the pilot's mean, as if their order had
    nothing to do with their conditions.
    """
    values = _recorded(field, campaign)
    reference = _recorded(field, pilot or campaign)
    if not np.isfinite(reference).any():
        return values * np.nan
    relative: Array = values - np.nanmean(reference)
    if pilot is None:
        return relative
    return np.where(np.isfinite(relative), relative, 0.0)


def _recorded(field: str, campaign: Campaign) -> Array:
    """Return a field of every test, shape (tests,), NaN where it is not recorded."""
    values = [getattr(test, field) for test in campaign.tests]
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def _planes_run_both_ways(campaign: Campaign) -> tuple[str, ...]:
    """Return the planes that run, or are to run, in both directions of travel."""
    both = []
    for plane in dict.fromkeys(str(test.plane) for test in campaign.scope):
        directions = {test.direction for test in campaign.scope if test.plane == plane}
        if {"CW", "CCW"} <= directions:
            _check_directions_stated(campaign, plane)
            both.append(plane)
    return tuple(both)


def _check_directions_stated(campaign: Campaign, plane: str) -> None:
    """Refuse tests of a plane that do not state their direction of travel."""
    undirected: list[CircularTest] = [
        test for test in campaign.tests if test.plane == plane and test.direction is None
    ]
    if undirected:
        raise InputError(
            f"{undirected[0].label} must state its direction, CW or CCW, as circles of plane"
            f" {plane} run, or are to run, both ways, got none. Give direction in every test of"
            f" {campaign.name!r}."
        )
