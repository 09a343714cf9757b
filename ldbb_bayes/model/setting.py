"""Tests of a campaign as the model's terms see them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import gamma
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Campaign, Instrument
from ldbb_bayes.errors import InputError
from ldbb_bayes.machine.chain import (
    ComplianceName,
    GeometricName,
    compliance_jacobian,
    geometric_jacobian,
    geometric_names,
)
from ldbb_bayes.model.fourier import MAX_ORDER, ORDERS, SIZE, basis, coefficients, harmonic_index
from ldbb_bayes.results import Array

__all__ = ["Setting", "TRAVEL", "WAYS", "geometric_errors_of", "setting_of"]


TRAVEL = {"CW": 1.0, "CCW": -1.0}


WAYS = {1.0: "CW", -1.0: "CCW"}


_HOUR_S = 3600.0


@dataclass(frozen=True, eq=False)
class Setting:
    """A campaign as terms see it, one row per test (the whole campaign's: F0, range, and the fields
    after them)."""

    force_N: Array
    pressure_bar: Array
    radius_mm: Array
    work_ball_rad: Array
    tool_ball_rad: Array
    plane: Array
    setup: Array
    travel: Array  #: +1 clockwise or not stated, −1 counterclockwise
    time_h: Array  #: from the mean of the whole campaign, like temperatures; NaN where not recorded
    temperature_K: Array
    direction: Array  #: basis coefficients (tests, 25, 3) of the bar's direction (X, Y, Z)
    wrench: Array  #: of j_C, (tests, 25, compliances)
    geometric: Array  #: of j_G, (tests, 25, geometric errors)
    reference_force_N: float  #: F0
    force_range_N: float  #: F_max − F_min
    two_balls: bool  #: whether the balls' forms are two terms
    clocked: bool  #: whether the clocking of either differs between tests, why they are
    radii_mm: tuple[float, ...]  #: the different ones, as of set-ups and planes
    setups: tuple[int, ...]
    planes: tuple[str, ...]
    both_ways: tuple[str, ...]  #: planes run in both directions of travel
    largest_force_N: float  #: F_max of the whole campaign
    circle: Array  #: name of each test's scale λ, empty where circles have none
    compliance_estimate: Array  #: Ĉ (compliances,), used only to linearise
    axial_estimate: Array  #: Ĉ_aa along X, Y, Z, zero where there is none
    fitted: Array  #: the circle fitted with Ĉ, F j_C·Ĉ + j_G·Ê, (tests, 25) [mm]
    compensated: bool  #: of the mount, like the next
    deflection_um_per_bar: float
    instrument: Instrument  #: what certificates state

    @property
    def tests(self) -> int:
        """Number of tests."""
        return len(self.force_N)

    def select(self, rows: Sequence[int]) -> Setting:
        """Only these tests; what belongs to the whole campaign stays."""
        per_test = [name for name, value in vars(self).items() if isinstance(value, np.ndarray)]
        return replace(
            self,
            **{
                name: getattr(self, name)[list(rows)]
                for name in per_test
                if not name.endswith("_estimate")
            },
        )

    @property
    def travels(self) -> tuple[float, ...]:
        """The different directions of travel."""
        return tuple(sorted({*self.travel.tolist()}, reverse=True))

    @property
    def bow(self) -> Array:
        """q(F) = 4 (F/F_max)(1 − F/F_max), shape (tests,) [1]."""
        share = self.force_N / self.largest_force_N
        return np.asarray(4.0 * share * (1.0 - share))

    def driven_axes(self) -> list[tuple[int, float]]:
        """Axes X, Y, Z that the circles move and whose compliance they show, by number, and |Ĉ_aa|
        [mm/N]."""
        moved = np.abs(self.direction).max(axis=(0, 1)) > 0.0
        return [
            (k, abs(float(size)))
            for k, size in enumerate(self.axial_estimate)
            if moved[k] and size != 0.0
        ]

    def along(self, axis: int, power: float, *, signed: bool = False) -> Array:
        """|u|^a, u = A cos(θ − ϑ) the bar's direction along an axis, times the sign of u where
        ``signed``, to order 12, shape (tests, 25): A^a Σ s_n cos n(θ − ϑ), s_n = 2^(1−a) Γ(a+1) /
        (Γ(1+(a+n)/2) Γ(1+(a−n)/2)), n even or, signed, odd; s_0/2."""
        first = int(signed)
        share = np.zeros(MAX_ORDER + 1)
        share[first] = 2.0 ** (1.0 - power) * gamma(power + 1.0)
        share[first] /= gamma(1.0 + (power + first) / 2.0) * gamma(1.0 + (power - first) / 2.0)
        for n in range(first, MAX_ORDER - 1, 2):
            share[n + 2] = share[n] * (power - n) / (power + n + 2)
        share[0] /= 2.0
        cosine = self.direction[:, 1, axis]
        sine = self.direction[:, 2, axis]
        found = (
            np.hypot(cosine, sine)[:, None] ** power
            * share[ORDERS]
            * basis(np.arctan2(sine, cosine))
        )
        return np.where(np.abs(found) > 1e-12, found, 0.0)

    def each(
        self, what: Literal["plane", "radius", "setup"]
    ) -> Iterator[tuple[Any, str, NDArray[np.bool_]]]:
        """Every plane, radius or set-up of the campaign, what names carry of it (nothing of an only
        one), and its tests."""
        own, every = {
            "plane": (self.plane, self.planes),
            "radius": (self.radius_mm, self.radii_mm),
            "setup": (self.setup, self.setups),
        }[what]
        for value in every:
            text = value if isinstance(value, str) else f"{value:g}"
            yield value, f"_{text}" if len(every) > 1 else "", own == value

    def harmonics(self, orders: Sequence[int], turned_rad: Array | float = 0.0) -> Array:
        """cos n(θ − ψ), sin n(θ − ψ) in turn, order by order, shape (tests, 25, 2 orders); ψ of
        each test: a clocked ball."""
        values = np.zeros((self.tests, SIZE, 2 * len(orders)))
        for j, n in enumerate(orders):
            c, s = harmonic_index(n)
            turn = n * np.remainder(turned_rad, 2 * np.pi)
            values[:, c, 2 * j], values[:, s, 2 * j] = np.cos(turn), np.sin(turn)
            values[:, c, 2 * j + 1], values[:, s, 2 * j + 1] = -np.sin(turn), np.cos(turn)
        return np.where(np.abs(values) < 1e-14, 0.0, values)

    def constant(self, values: Array) -> Array:
        """What does not depend on the angle, (tests, p) or (tests,), as columns, shape (tests, 25,
        p)."""
        own = values[:, None] if values.ndim == 1 else values
        columns = np.zeros((self.tests, SIZE, own.shape[1]))
        columns[:, 0] = own
        return columns


def geometric_errors_of(campaign: Campaign) -> tuple[GeometricName, ...]:
    """The geometric errors of a campaign's machine, with the tool offsets of every set-up but the
    first by its number."""
    names: list[GeometricName] = []
    for name in geometric_names(campaign.machine()):
        if name.kind == "offset":
            seen = {test.setup or 1 for test in campaign.scope if name.component in str(test.plane)}
            names += [replace(name, setup=0 if setup == 1 else setup) for setup in sorted(seen)]
        else:
            names.append(name)
    return tuple(names)


def setting_of(
    campaign: Campaign,
    compliances: Sequence[ComplianceName],
    reference_force_N: float | None,
    *,
    pilot: Campaign | None,
) -> Setting:
    """The setting of a campaign or plan; of a plan F0, force range and the zero of time and
    temperature are the pilot's."""
    machine = campaign.machine()
    tests = campaign.tests
    columns = {
        circle: (
            coefficients(circle.direction),
            coefficients(partial(compliance_jacobian, machine, circle, names=compliances)),
            coefficients(partial(geometric_jacobian, machine, circle)),
        )
        for circle in {test.circle for test in tests}
    }
    direction, wrench, geometric = (
        np.stack([columns[test.circle][k] for test in tests]) for k in range(3)
    )
    clockings = np.deg2rad([[test.work_ball_deg, test.tool_ball_deg] for test in tests])
    turned = np.exp(1j * clockings)
    clocked = bool(np.abs(turned - turned[0]).max() > 1e-9)
    forces = (pilot or campaign).forces_N
    return Setting(
        force_N=campaign.forces_N,
        pressure_bar=campaign.pressures_bar,
        radius_mm=np.array([test.radius_mm for test in tests], dtype=float),
        work_ball_rad=clockings[:, 0],
        tool_ball_rad=clockings[:, 1],
        plane=np.array([str(test.plane) for test in tests]),
        setup=np.array([test.setup or 1 for test in tests]),
        travel=np.array([TRAVEL[test.direction or "CW"] for test in tests]),
        time_h=_recorded("time_s", campaign, pilot) / _HOUR_S,
        temperature_K=_recorded("temperature_C", campaign, pilot),
        direction=direction,
        wrench=wrench,
        geometric=_by_setup(campaign, geometric),
        reference_force_N=float(
            (forces.min() + forces.max()) / 2.0 if reference_force_N is None else reference_force_N
        ),
        force_range_N=float(forces.max() - forces.min()),
        two_balls=clocked,
        clocked=clocked,
        radii_mm=tuple(sorted({float(test.radius_mm or 0.0) for test in tests})),
        setups=tuple(sorted({test.setup or 1 for test in tests})),
        planes=tuple(machine.planes),
        both_ways=_both_ways(campaign),
        largest_force_N=float(forces.max()),
        circle=np.array([""] * len(tests)),
        compliance_estimate=np.zeros(len(compliances)),
        axial_estimate=np.zeros(3),
        fitted=np.zeros((len(tests), SIZE)),
        compensated=campaign.mount.compensated,
        deflection_um_per_bar=campaign.mount.deflection_um_per_bar,
        instrument=campaign.instrument,
    )


def _by_setup(campaign: Campaign, columns: Array) -> Array:
    """Columns of the machine's errors (tests, 25, errors) → those of the campaign's: a tool offset
    only in its own set-up."""
    machine_errors = [name.label for name in geometric_names(campaign.machine())]
    names = geometric_errors_of(campaign)
    chosen = columns[:, :, [machine_errors.index(replace(name, setup=0).label) for name in names]]
    for j, name in enumerate(names):
        if name.kind == "offset":
            chosen[[test.setup != (name.setup or 1) for test in campaign.tests], :, j] = 0.0
    return chosen


def _recorded(field: str, campaign: Campaign, pilot: Campaign | None) -> Array:
    """From the campaign's mean. Tests of a plan beside a pilot that record nothing are taken at the
    pilot's mean: run in an order that has nothing to do with what differs between them."""
    own, before = (
        np.array(
            [
                np.nan if getattr(test, field) is None else getattr(test, field)
                for test in tests.tests
            ],
            dtype=float,
        )
        for tests in (campaign, pilot or campaign)
    )
    if not np.isfinite(before).any():
        return own * np.nan
    shifted: Array = own - np.nanmean(before)
    return shifted if pilot is None else np.where(np.isfinite(shifted), shifted, 0.0)


def _both_ways(campaign: Campaign) -> tuple[str, ...]:
    """Planes run, or to be run, in both directions."""
    both = []
    for plane in dict.fromkeys(str(test.plane) for test in campaign.scope):
        if not {"CW", "CCW"} <= {test.direction for test in campaign.scope if test.plane == plane}:
            continue
        silent = next(
            (test for test in campaign.tests if test.plane == plane and test.direction is None),
            None,
        )
        if silent is not None:
            raise InputError(
                f"{silent.label} must state its direction, CW or CCW, as circles of plane {plane}"
                " run, or are to run, both ways, got none. Give direction in every test of"
                f" {campaign.name!r}."
            )
        both.append(plane)
    return tuple(both)
