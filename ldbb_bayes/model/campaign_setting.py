"""Test conditions of a campaign or plan: the `Setting` that a model needs of it.

Forces, clockings and directions of travel are taken from the tests. The effects of compliances and
geometric errors on the reading are computed from the machine's kinematic chain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.campaign.circular_test import setup_number
from ldbb_bayes.campaign.directions import planes_run_both_ways
from ldbb_bayes.machine.linear import compliance_jacobian, geometric_jacobian
from ldbb_bayes.machine.parameters import ComplianceName, GeometricName, geometric_names
from ldbb_bayes.model.fourier import SIZE, coefficients
from ldbb_bayes.model.relative_conditions import relative_temperatures_K, relative_times_h
from ldbb_bayes.model.setting import TRAVEL_SIGNS, CirclePath, Setting
from ldbb_bayes.results import Array

__all__ = ["geometric_errors_of", "setting_of"]

# Two clocking angles count as equal if the distance between their points on the unit circle is at
# most this number.
_SAME_CLOCKING = 1e-9


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
        time_h=relative_times_h(campaign, pilot),
        temperature_K=relative_temperatures_K(campaign, pilot),
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
