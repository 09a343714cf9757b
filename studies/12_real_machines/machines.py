"""Campaigns of machines as they are: springs that yield to the load of their own joint, balls with
lobes, drives, drifts.

Nothing of the package's linear model is used. Geometry goes through the exact forward model (Eq.
1-14); each joint yields by its own law to the load that the bar puts on it, in the place where the
tool then stands, by iteration to equilibrium:

    δ_X = C_XXX a_X(u_X) l(F u_X),  δ_Y likewise,  φ = C_CXY F_x + C_CYY F_y + C_CCY (x F_y),

u the bar's direction, l the law (linear, contact ~ f^⅔, stiffening under its own load; of a seat,
which the bar presses with its whole force, F^⅔ u_X), a the change along the travel. The truth of
C_XXX is the secant compliance along the axis at F0 in the middle of the travel, that of a slope the
change of the linear spring with the bar's force.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

import ldbb_bayes as lb
from ldbb_bayes.machine.exact import geometric_reading_mm

Array = NDArray[np.float64]
FORCES_N = (36.0, 112.0, 238.0, 364.0, 490.0, 616.0, 742.0)
RADIUS_MM = 150.0
READINGS = 720
RESOLUTION_UM = 0.24
MIDDLE_N = 0.5 * (FORCES_N[0] + FORCES_N[-1])
LARGEST_N = FORCES_N[-1]
GRADES_UM = {"G5": 0.13, "G10": 0.25, "G20": 0.5, "G40": 1.0, "G100": 2.5, "G200": 5.0}
_ORDERS = np.arange(2, 31)
# Angles of the readings of every circle [rad].
_ANGLE = np.linspace(0.0, 2.0 * np.pi, READINGS, endpoint=False)


@dataclass(frozen=True)
class Disturbances:
    """What a family of machines has beyond the mild; each machine draws its own within these."""

    form_decay: float = 2.0
    grade: str = "G20"
    lobe: tuple[str, ...] = ()  # grades of balls of a single lobe
    contact: tuple[float, float] = (0.0, 0.0)  # share of the deflection that goes with f^⅔
    seat: tuple[float, float] = (0.0, 0.0)  # share that a seat adds, with the bar's force F^⅔
    own_load: float = 0.0  # relative change of compliance over the largest load, sd
    travel: tuple[float, float] = (0.0, 0.0)  # relative change along the travel
    odd_um: float = 0.0  # what one circle has that no other has
    lag_deg: tuple[float, float] = (0.0, 0.05)
    filtered: int = 0  # readings that the trace is averaged over
    both_ways: bool = False
    spikes_um: float = 0.0
    lost_um: float = 0.0  # lost motion of an axis: backlash, wind-up
    lost_um_per_kN: float = 0.0  # what it grows by with the bar's force
    mismatch_um: float = 0.0
    friction_um: float = 0.0  # constant, by the sign of travel
    friction_um_per_kN: float = 0.0
    warm_up_um: float = 0.0  # over the whole campaign, about its middle
    shuffled: bool = False  # run in an order that has nothing to do with force
    compliance: tuple[float, float] = (3e-5, 8e-5)
    length_um: float = 5.0
    mount_percent: float = 7.0
    scatter: tuple[float, float] = (1.0, 1.0)  # size of what differs from circle to circle
    uneven: bool = False  # circles scatter by unequal amounts, as Student t with 3 degrees
    stated: lb.Instrument = field(default_factory=lb.Instrument)


FAMILIES: dict[str, Disturbances] = {
    "mild": Disturbances(),
    "steep form": Disturbances(form_decay=3.0, grade="G40"),
    "one lobe": Disturbances(lobe=("G20", "G40", "G100", "G200")),
    "contact": Disturbances(contact=(0.2, 0.5)),
    "own load": Disturbances(own_load=0.25),
    "travel": Disturbances(travel=(0.05, 0.10)),
    "odd circle": Disturbances(odd_um=3.0),
    "angle lag": Disturbances(lag_deg=(0.1, 0.3), filtered=9),
    "both ways": Disturbances(
        both_ways=True, spikes_um=3.0, lost_um=2.0, lost_um_per_kN=0.5, mismatch_um=3.0
    ),
    "warm-up, seals": Disturbances(
        warm_up_um=2.0, friction_um=0.5, friction_um_per_kN=0.5, lost_um_per_kN=0.5
    ),
    "stiff": Disturbances(compliance=(5e-6, 1e-5)),
    "soft": Disturbances(compliance=(1e-4, 2e-4)),
}
# One for each term that is new in the third edition, run one way but where it says so.
NEW: dict[str, Disturbances] = {
    "servo mismatch, one way": Disturbances(mismatch_um=1.0),
    "lost motion, one way": Disturbances(lost_um=2.0, lost_um_per_kN=1.0),
    "seat": Disturbances(seat=(0.2, 0.5)),
    "warm-up, sorted": Disturbances(warm_up_um=2.0),
    "warm-up, shuffled": Disturbances(warm_up_um=2.0, shuffled=True),
}
# What certificates state, and machines of which they are true.
CERTIFIED = lb.Instrument(
    work=lb.Ball(grade="G10"), tool=lb.Ball(grade="G10"), bar_U_um=1.0, mount_U_percent=2.0
)
_G10 = lb.Instrument(work=lb.Ball(grade="G10"), tool=lb.Ball(grade="G10"))
_G20 = lb.Instrument(work=lb.Ball(grade="G20"), tool=lb.Ball(grade="G20"))
STATED: dict[str, Disturbances] = {
    "mild, G20 stated": Disturbances(stated=_G20),
    "mild, certificates": Disturbances(
        grade="G10", length_um=0.5, mount_percent=1.0, stated=CERTIFIED
    ),
    "drives, drift, well planned": Disturbances(
        grade="G10",
        length_um=0.5,
        mount_percent=1.0,
        stated=CERTIFIED,
        both_ways=True,
        shuffled=True,
        spikes_um=3.0,
        lost_um=2.0,
        lost_um_per_kN=0.5,
        mismatch_um=3.0,
        warm_up_um=2.0,
        friction_um=0.5,
        friction_um_per_kN=0.5,
    ),
}
# The mild machines again, measured by better plans and with better balls.
PLANS: dict[str, Disturbances] = {
    "mild, shuffled": Disturbances(shuffled=True),
    "mild, both ways": Disturbances(both_ways=True),
    "mild, both ways, shuffled": Disturbances(both_ways=True, shuffled=True),
    "mild, both ways, shuffled, G10 stated": Disturbances(
        both_ways=True, shuffled=True, grade="G10", stated=_G10
    ),
    "mild, both ways, shuffled, certificates": Disturbances(
        both_ways=True,
        shuffled=True,
        grade="G10",
        length_um=0.5,
        mount_percent=1.0,
        stated=CERTIFIED,
    ),
}


@dataclass(frozen=True)
class Machine:
    """One machine and its instrument, in mm, N, rad."""

    compliance: dict[str, float]
    slope: dict[str, float]
    geometry: dict[str, float]
    contact: tuple[float, float]
    own_load: tuple[float, float]
    travel: tuple[tuple[float, float], tuple[float, float]]
    work_ball: Array  # complex amplitudes at the orders 2 … 30 [mm]
    tool_ball: Array
    instrument: dict[str, float] = field(default_factory=dict)
    seat: tuple[float, float] = (0.0, 0.0)

    @property
    def truth(self) -> dict[str, float]:
        """Parameters by name."""
        return {
            **self.compliance,
            **{f"{name}_1": value for name, value in self.slope.items()},
            **self.geometry,
        }

    def secant(self, name: str, force_N: float) -> float:
        """C_XXX or C_YYY as the deflection along the axis over the bar's force, in the middle of
        the travel [mm/N]."""
        axis = ("C_XXX", "C_YYY").index(name)
        spring = self.compliance[name] + self.slope[name] * (force_N - MIDDLE_N)
        return spring * self.axial_force(axis, np.array(force_N), force_N).item() / force_N

    def axial_force(self, axis: int, load: Array, bar_N: float) -> Array:
        """The force that a linear spring of X (``axis`` 0) or Y (1) would need to yield as this one
        does to its load [N]; a seat, unlike a joint, is pressed by the whole force of the bar
        ``bar_N``."""
        size = np.abs(load)
        share = self.contact[axis]
        law = (1.0 - share) * load + share * np.sign(load) * np.cbrt(size**2 * MIDDLE_N)
        if self.seat[axis]:
            law = law + self.seat[axis] * load * (np.cbrt(MIDDLE_N / bar_N) - 1.0)
        return np.asarray(law + self.own_load[axis] * load * (size - MIDDLE_N) / LARGEST_N)


def ball(rng: np.random.Generator, decay: float, sphericity_um: float, lobe: bool) -> Array:
    """Complex amplitudes [mm] of the form of a ball.

    Its deviation from sphericity over the circle, peak to valley, is ``sphericity_um``.
    """
    size = _ORDERS.astype(float) ** -decay * np.hypot(*rng.standard_normal((2, len(_ORDERS))))
    if lobe:
        size = np.where(rng.integers(2, 6) == _ORDERS, 1.0, 0.0)
    form = size * np.exp(2j * np.pi * rng.random(len(_ORDERS)))
    angle = np.linspace(0.0, 2.0 * np.pi, 1440)
    profile = (form @ np.exp(1j * np.outer(_ORDERS, angle))).real
    return np.asarray(form * sphericity_um * 1e-3 / np.ptp(profile))


def draw_machine(family: Disturbances, rng: np.random.Generator) -> Machine:
    """One machine of a family."""
    compliance = draw_compliance(family, rng)
    span_N = LARGEST_N - FORCES_N[0]
    # Where the joints themselves are not linear, nothing else changes with force.
    linear_joints = not (family.own_load or family.contact[1])
    slope = {
        name: value * rng.normal(0.0, 0.12) / span_N * linear_joints
        for name, value in compliance.items()
    }
    geometry = {
        "E_XX1": rng.normal(0.0, 5e-5),
        "E_YX2": rng.normal(0.0, 3e-7),
        "E_XY2": rng.normal(0.0, 3e-7),
        "E_YY1": rng.normal(0.0, 5e-5),
        "E_C0YX": rng.normal(0.0, 2e-5),
        "E_Xt0": rng.normal(0.0, 5e-3),
        "E_Yt0": rng.normal(0.0, 5e-3),
    }
    work_ball, tool_ball = draw_balls(family, rng)
    contact = rng.uniform(*family.contact, 2)
    own_load = rng.normal(0.0, family.own_load, 2)
    travel = rng.uniform(*family.travel, (2, 2)) * rng.choice([-1.0, 1.0], (2, 2))
    instrument = {
        "length": rng.normal(0.0, family.length_um * 1e-3),
        "mount": rng.normal(0.0, 0.01 * family.mount_percent * 2.33e-3),
        "mount_curvature": rng.normal(0.0, 0.3e-3),
        "gain": rng.normal(0.0, 0.007),
        "force_curvature": rng.normal(0.0, 0.005),
        "angle": np.deg2rad(rng.normal(0.0, 0.05)),
        "lag": np.deg2rad(rng.uniform(*family.lag_deg)),
    }
    return Machine(
        compliance=compliance,
        slope=slope,
        geometry=geometry,
        contact=_pair(contact),
        own_load=_pair(own_load),
        travel=(_pair(travel[0]), _pair(travel[1])),
        work_ball=work_ball,
        tool_ball=tool_ball,
        instrument=instrument,
    )


def _pair(values: Array) -> tuple[float, float]:
    """The numbers of X and Y."""
    return float(values[0]), float(values[1])


def draw_compliance(family: Disturbances, rng: np.random.Generator) -> dict[str, float]:
    """Compliances by name [mm/N, rad/N, rad/(N mm)]; the others go with the direct ones."""
    direct = np.exp(rng.uniform(*np.log(family.compliance), 2))
    scale = direct.mean() / 5e-5
    return {
        "C_XXX": direct[0],
        "C_XYX": rng.normal(0.0, 1e-6) * scale,
        "C_YYY": direct[1],
        "C_CXY": rng.normal(0.0, 2e-8) * scale,
        "C_CYY": rng.normal(0.0, 2e-8) * scale,
        "C_CCY": rng.uniform(0.5e-10, 4e-10) * scale,
    }


def draw_balls(family: Disturbances, rng: np.random.Generator) -> tuple[Array, Array]:
    """Forms of the work ball and the tool ball, as `ball` gives them."""
    grades = [family.grade, family.grade]
    if family.lobe:
        grades = [str(rng.choice(family.lobe)) for _ in range(2)]
    forms = []
    for grade in grades:
        sphericity_um = GRADES_UM[grade] * rng.uniform(0.5, 1.0)
        forms.append(ball(rng, family.form_decay, sphericity_um, bool(family.lobe)))
    return forms[0], forms[1]


def with_seats(machine: Machine, family: Disturbances, rng: np.random.Generator) -> Machine:
    """The machine with seats of balls and spindle that yield to the bar's whole force.

    Nothing else of it changes with force.
    """
    first = float(rng.uniform(*family.seat))
    second = float(rng.uniform(*family.seat))
    return replace(machine, seat=(first, second), slope=dict.fromkeys(machine.slope, 0.0))


def deflection_mm(
    machine: Machine, force_N: float, bar_N: float, angle: Array
) -> tuple[Array, Array]:
    """Displacement of the tool along X and Y, (n,) each, under a bar force at the angles of the
    undeflected bar; ``bar_N``: the force that the linear springs' slopes see."""
    lever_N = bar_N - MIDDLE_N
    compliance = {
        name: value + machine.slope[name] * lever_N for name, value in machine.compliance.items()
    }
    position = RADIUS_MM * np.array([np.cos(angle), np.sin(angle)])
    x = position[0]
    deflection = np.zeros((2, len(angle)))
    for _ in range(4):
        bar = position + deflection
        load = force_N * bar / np.hypot(bar[0], bar[1])
        axial_x = axial_deflection_mm(machine, compliance, 0, load[0], x, force_N)
        axial_y = axial_deflection_mm(machine, compliance, 1, load[1], position[1], force_N)
        turn = (
            compliance["C_CXY"] * load[0]
            + compliance["C_CYY"] * load[1]
            + compliance["C_CCY"] * x * load[1]
        )
        deflection = np.array(
            [
                axial_x + compliance["C_XYX"] * load[1] - x * (1.0 - np.cos(turn)),
                axial_y + x * np.sin(turn),
            ]
        )
    return deflection[0], deflection[1]


def axial_deflection_mm(
    machine: Machine,
    compliance: Mapping[str, float],
    axis: int,
    load_N: Array,
    position_mm: Array,
    bar_N: float,
) -> Array:
    """How far X (``axis`` 0) or Y (1) yields along itself to its load, at a position along its
    travel."""
    name = ("C_XXX", "C_YYY")[axis]
    linear, quadratic = machine.travel[axis]
    place = position_mm / RADIUS_MM
    along_travel = 1.0 + linear * place + quadratic * (place**2 - 0.5)
    return np.asarray(compliance[name] * along_travel * machine.axial_force(axis, load_N, bar_N))


def trace_mm(machine: Machine, force_N: float, angle: Array) -> Array:
    """Exact change of the ball distance, geometry and springs, at true angles (n,)."""
    setup = lb.Campaign((lb.CircularTest(100.0, np.arange(0.0, 360.0, 20.0)),), radius_mm=RADIUS_MM)
    rigid = geometric_reading_mm(setup.machine(), setup.tests[0].circle, angle, machine.geometry)
    dx, dy = deflection_mm(machine, force_N, force_N, angle)
    distance = RADIUS_MM + rigid
    return np.asarray(
        np.hypot(distance * np.cos(angle) + dx, distance * np.sin(angle) + dy) - RADIUS_MM
    )


class _Circle(NamedTuple):
    """One circle of a campaign before it is measured."""

    force_N: float
    direction: Literal["CW", "CCW"]
    name: str
    place: int  # in the order in which the circles are run


class _Errors(NamedTuple):
    """What goes wrong in one campaign beside the machine's springs, balls and geometry."""

    odd_circle: int  # index of the circle that has something of its own; −1: none
    drift_mm: Array  # of zero and centre over the whole campaign, shape (3,)
    drive_mm: dict[str, Array]  # errors of the drives by kind, of X and Y
    friction_mm_per_N: float
    lost_mm_per_N: Array  # of X and Y


def simulate(
    family: Disturbances,
    seed: int,
    forces_N: tuple[float, ...] = FORCES_N,
    plan: lb.Campaign | None = None,
    grown: Mapping[str, float] | None = None,
) -> tuple[lb.Campaign, Machine]:
    """A campaign of one machine, with what its certificates state, and the machine.

    With a ``plan`` the same machine is measured once more, circle by circle as planned. Its
    compliances have been multiplied by the factors ``grown``.
    """
    rng = np.random.default_rng(seed)
    machine = draw_machine(family, rng)
    if family.seat[1]:
        machine = with_seats(machine, family, np.random.default_rng([seed, 2]))
    if grown is not None:
        compliance = {
            name: value * grown.get(name, 1.0) for name, value in machine.compliance.items()
        }
        machine = replace(machine, compliance=compliance)
    circles = circles_of_family(family, seed, forces_N)
    errors = draw_errors(family, len(circles), rng)
    if plan is not None:
        circles = circles_of_plan(plan)
        rng = np.random.default_rng([seed, 3])
    scatter = scatter_of_circles(family, seed, len(circles), again=plan is not None)
    tests = {}
    for k, circle in enumerate(circles):
        time = circle.place / max(len(circles) - 1, 1) - 0.5
        odd_um = family.odd_um if k == errors.odd_circle else 0.0
        reading_mm = _circle_mm(machine, circle, errors, time, scatter[k], odd_um, rng)
        reading_um = _displayed_um(reading_mm, family.filtered, rng)
        tests[circle.place] = lb.CircularTest(
            circle.force_N,
            np.rad2deg(_ANGLE),
            reading_um,
            direction=circle.direction,
            name=circle.name,
        )
    campaign = lb.Campaign(
        tuple(tests[place] for place in sorted(tests)),
        radius_mm=RADIUS_MM,
        resolution_um=RESOLUTION_UM,
        name=f"seed {seed}",
        instrument=family.stated,
    )
    return campaign, machine


def circles_of_family(
    family: Disturbances, seed: int, forces_N: tuple[float, ...]
) -> list[_Circle]:
    """Circles at the forces, each in both directions where the family is run both ways."""
    directions: tuple[Literal["CW", "CCW"], ...] = ("CW",)
    if family.both_ways:
        directions = ("CW", "CCW")
    count = len(forces_N) * len(directions)
    places = np.arange(count)
    if family.shuffled:
        places = np.random.default_rng([seed, 1]).permutation(count)
    circles: list[_Circle] = []
    for force_N in forces_N:
        for direction in directions:
            name = f"f{force_N:03.0f}"
            if family.both_ways:
                name += f"_{direction}"
            circles.append(_Circle(force_N, direction, name, int(places[len(circles)])))
    return circles


def circles_of_plan(plan: lb.Campaign) -> list[_Circle]:
    """Circles as planned, run in the order of the plan."""
    return [
        _Circle(test.force_N, test.direction, test.name, place)
        for place, test in enumerate(plan.tests)
    ]


def draw_errors(family: Disturbances, circles: int, rng: np.random.Generator) -> _Errors:
    """What goes wrong in a campaign of so many circles."""
    odd_circle = int(rng.integers(circles)) if family.odd_um else -1
    drift_mm = rng.normal(0.0, family.warm_up_um * 1e-3, 3)
    drive_mm = {
        "spikes": rng.normal(0.0, family.spikes_um * 1e-3, 2),
        "lost": rng.normal(0.0, family.lost_um * 1e-3, 2),
        "mismatch": rng.normal(0.0, family.mismatch_um * 1e-3, 2),
        "friction": rng.normal(0.0, family.friction_um * 1e-3, 2),
    }
    friction_mm_per_N = float(rng.normal(0.0, family.friction_um_per_kN * 1e-6))
    lost_mm_per_N = rng.normal(0.0, family.lost_um_per_kN * 1e-6, 2)
    return _Errors(odd_circle, drift_mm, drive_mm, friction_mm_per_N, lost_mm_per_N)


def _circle_mm(
    machine: Machine,
    circle: _Circle,
    errors: _Errors,
    time: float,
    scatter: float,
    odd_um: float,
    rng: np.random.Generator,
) -> Array:
    """Readings of one circle [mm] before filter, noise and display.

    ``time`` goes from −0.5 at the first circle of the campaign to 0.5 at the last; ``scatter`` is
    the size of what differs from circle to circle; ``odd_um`` that of what this one alone has.
    """
    sign = 1.0 if circle.direction == "CW" else -1.0
    true_angle = _ANGLE + machine.instrument["angle"] + sign * machine.instrument["lag"]
    reading = _reading(machine, circle.force_N, true_angle, rng)
    reading += scatter * (
        rng.normal(0.0, 0.4e-3)
        + rng.normal(0.0, 0.4e-3) * np.cos(_ANGLE)
        + rng.normal(0.0, 0.4e-3) * np.sin(_ANGLE)
    )
    zero, centre_x, centre_y = errors.drift_mm
    reading += (zero + centre_x * np.cos(_ANGLE) + centre_y * np.sin(_ANGLE)) * time
    reading += _changes(_ANGLE, scatter * 0.25e-3, rng)
    lost_mm = errors.drive_mm["lost"] + errors.lost_mm_per_N * circle.force_N
    reading += (
        _drives(_ANGLE, sign, errors.drive_mm | {"lost": lost_mm}, rng)
        + sign * errors.friction_mm_per_N * circle.force_N
    )
    if odd_um:
        odd_mm = odd_um * 1e-3
        reading += _changes(_ANGLE, odd_mm, rng, highest=6) + odd_mm * rng.normal()
    return reading


def _displayed_um(reading_mm: Array, filtered: int, rng: np.random.Generator) -> Array:
    """Readings as the instrument gives them: averaged over ``filtered`` neighbours (0: not), with
    noise, rounded to its resolution [µm]."""
    if filtered:
        half = filtered // 2
        around = np.concatenate([reading_mm[-half:], reading_mm, reading_mm[:half]])
        window = np.ones(2 * half + 1) / (2 * half + 1)
        reading_mm = np.convolve(around, window, "valid")
    white = rng.normal(0.0, 0.12e-3, READINGS + 4)
    noise_mm = np.convolve(white, [0.5, 0.3, 0.2, 0.1, 0.05], "valid")
    steps = np.round((reading_mm + noise_mm) * 1e3 / RESOLUTION_UM)
    return np.asarray(steps * RESOLUTION_UM)


def scatter_of_circles(family: Disturbances, seed: int, circles: int, again: bool) -> Array:
    """Size of what differs from circle to circle, of every circle, in that of the mild machines.

    ``again``: whether the machine is measured once more, by other circles.
    """
    size = np.exp(np.random.default_rng([seed, 4]).uniform(*np.log(family.scatter)))
    if not family.uneven:
        return np.full(circles, size)
    freedom = 3.0
    chi_square = np.random.default_rng([seed, 5 + again]).chisquare(freedom, circles)
    return np.asarray(size * np.sqrt(freedom / chi_square))


def _reading(machine: Machine, nominal_N: float, angle: Array, rng: np.random.Generator) -> Array:
    """Geometry, springs, balls, length, mount and force as the bar applies it; ``angle`` is the
    true one."""
    share = nominal_N / LARGEST_N
    bow = 4.0 * share * (1.0 - share)
    force_N = (
        nominal_N * (1.0 + machine.instrument["gain"])
        + LARGEST_N * bow * machine.instrument["force_curvature"]
    )
    force_N += rng.normal(0.0, 3.0)
    at_work_ball = np.exp(1j * np.outer(angle, _ORDERS))
    at_tool_ball = np.exp(1j * np.outer(angle + np.pi, _ORDERS))
    form = (at_work_ball @ machine.work_ball + at_tool_ball @ machine.tool_ball).real
    pressure_bar = (nominal_N + 14.2) / 126.04
    return (
        trace_mm(machine, force_N, angle)
        + form
        + machine.instrument["length"]
        + machine.instrument["mount"] * pressure_bar
        + machine.instrument["mount_curvature"] * bow
    )


def _changes(angle: Array, size_mm: float, rng: np.random.Generator, highest: int = 12) -> Array:
    """What one circle has for itself at the orders 2 and up, falling as 1/n."""
    orders = np.arange(2, highest + 1)
    amplitude = rng.normal(0.0, 1.0, (2, len(orders))) * size_mm / orders
    waves = np.exp(1j * np.outer(angle, orders))
    return np.asarray(waves.real @ amplitude[0] + waves.imag @ amplitude[1])


def _drives(angle: Array, sign: float, drive: dict[str, Array], rng: np.random.Generator) -> Array:
    """What the drives add, ``sign`` 1 clockwise: servo mismatch and friction, which change their
    sign with the direction; lost motion, by half of which each axis lags behind its own velocity;
    spikes where an axis sticks after its reversal, outwards (inwards where compensated too much) in
    either direction and fading as the circle goes on."""
    total = sign * (drive["mismatch"][0] * np.sin(2.0 * angle) + drive["friction"][0])
    along = np.stack([np.cos(angle), np.sin(angle)])
    velocity = sign * np.stack([np.sin(angle), -np.cos(angle)])
    total = total - 0.5 * drive["lost"] @ (along * np.sign(np.round(velocity, 12)))
    for quarter in range(4):
        since_reversal = np.remainder(-sign * (angle - 0.5 * np.pi * quarter), 2.0 * np.pi)
        fading = np.exp(-since_reversal / np.deg2rad(6.0))
        total = total + drive["spikes"][quarter % 2] * fading * (1.0 + 0.1 * rng.normal())
    return np.asarray(total)
