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
    odd_um: float = 0.0  # an odd circle
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
        k = ("C_XXX", "C_YYY").index(name)
        spring = self.compliance[name] + self.slope[name] * (force_N - MIDDLE_N)
        return spring * self.axial_force(k, np.array(force_N), force_N).item() / force_N

    def axial_force(self, k: int, load: Array, bar_N: float) -> Array:
        """The force that a linear spring of axis ``k`` would need to yield as this one does to its
        load [N]; a seat, unlike a joint, is pressed by the whole force of the bar ``bar_N``."""
        size = np.abs(load)
        share = self.contact[k]
        law = (1.0 - share) * load + share * np.sign(load) * np.cbrt(size**2 * MIDDLE_N)
        if self.seat[k]:
            law = law + self.seat[k] * load * (np.cbrt(MIDDLE_N / bar_N) - 1.0)
        return np.asarray(law + self.own_load[k] * load * (size - MIDDLE_N) / LARGEST_N)


def ball(rng: np.random.Generator, decay: float, sphericity_um: float, lobe: bool) -> Array:
    """Complex amplitudes [mm] of a form whose deviation from sphericity over the circle, peak to
    valley, is so much."""
    size = _ORDERS.astype(float) ** -decay * np.hypot(*rng.standard_normal((2, len(_ORDERS))))
    if lobe:
        size = np.where(rng.integers(2, 6) == _ORDERS, 1.0, 0.0)
    form = size * np.exp(2j * np.pi * rng.random(len(_ORDERS)))
    angle = np.linspace(0.0, 2.0 * np.pi, 1440)
    return np.asarray(
        form * sphericity_um * 1e-3 / np.ptp((form @ np.exp(1j * np.outer(_ORDERS, angle))).real)
    )


def draw_machine(family: Disturbances, rng: np.random.Generator) -> Machine:
    """One machine of a family."""
    direct = np.exp(rng.uniform(*np.log(family.compliance), 2))
    scale = direct.mean() / 5e-5
    compliance = {
        "C_XXX": direct[0],
        "C_XYX": rng.normal(0.0, 1e-6) * scale,
        "C_YYY": direct[1],
        "C_CXY": rng.normal(0.0, 2e-8) * scale,
        "C_CYY": rng.normal(0.0, 2e-8) * scale,
        "C_CCY": rng.uniform(0.5e-10, 4e-10) * scale,
    }
    span = LARGEST_N - FORCES_N[0]
    plain = not (family.own_load or family.contact[1])
    slope = {
        name: value * rng.normal(0.0, 0.12) / span * plain for name, value in compliance.items()
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
    grades = [str(rng.choice(family.lobe)) if family.lobe else family.grade for _ in range(2)]
    forms = [
        ball(rng, family.form_decay, GRADES_UM[g] * rng.uniform(0.5, 1.0), bool(family.lobe))
        for g in grades
    ]
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
    pair = tuple((float(a), float(b)) for a, b in travel)
    load = ((float(contact[0]), float(contact[1])), (float(own_load[0]), float(own_load[1])))
    return Machine(compliance, slope, geometry, *load, pair, *forms, instrument)  # type: ignore[arg-type]


def with_seats(machine: Machine, family: Disturbances, rng: np.random.Generator) -> Machine:
    """The machine with seats of balls and spindle that yield to the bar's whole force; nothing else
    of it changes with force."""
    first = float(rng.uniform(*family.seat))
    second = float(rng.uniform(*family.seat))
    return replace(machine, seat=(first, second), slope=dict.fromkeys(machine.slope, 0.0))


def deflection_mm(
    machine: Machine, force_N: float, bar_N: float, angle: Array
) -> tuple[Array, Array]:
    """Displacement of the tool along X and Y, (n,) each, under a bar force at the angles of the
    undeflected bar; ``bar_N``: the force that the linear springs' slopes see."""
    lever = bar_N - MIDDLE_N
    c = {name: value + machine.slope[name] * lever for name, value in machine.compliance.items()}
    x = RADIUS_MM * np.cos(angle)
    y = RADIUS_MM * np.sin(angle)
    moved = np.zeros((2, len(angle)))
    for _ in range(4):
        length = np.hypot(x + moved[0], y + moved[1])
        load = force_N * np.array([x + moved[0], y + moved[1]]) / length
        axial = []
        for k, name in enumerate(("C_XXX", "C_YYY")):
            linear, quadratic = machine.travel[k]
            place = np.array([x, y])[k] / RADIUS_MM
            axial.append(
                c[name]
                * (1.0 + linear * place + quadratic * (place**2 - 0.5))
                * machine.axial_force(k, load[k], force_N)
            )
        turn = c["C_CXY"] * load[0] + c["C_CYY"] * load[1] + c["C_CCY"] * x * load[1]
        moved = np.array(
            [
                axial[0] + c["C_XYX"] * load[1] - x * (1.0 - np.cos(turn)),
                axial[1] + x * np.sin(turn),
            ]
        )
    return moved[0], moved[1]


def trace_mm(machine: Machine, force_N: float, angle: Array) -> Array:
    """Exact change of the ball distance, geometry and springs, at true angles (n,)."""
    setup = lb.Campaign((lb.CircularTest(100.0, np.arange(0.0, 360.0, 20.0)),), radius_mm=RADIUS_MM)
    rigid = geometric_reading_mm(setup.machine(), setup.tests[0].circle, angle, machine.geometry)
    dx, dy = deflection_mm(machine, force_N, force_N, angle)
    distance = RADIUS_MM + rigid
    return np.asarray(
        np.hypot(distance * np.cos(angle) + dx, distance * np.sin(angle) + dy) - RADIUS_MM
    )


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
        compliance = {k: value * grown.get(k, 1.0) for k, value in machine.compliance.items()}
        machine = replace(machine, compliance=compliance)
    ways = ("CW", "CCW") if family.both_ways else ("CW",)
    runs = [(force, way) for force in forces_N for way in ways]
    order = (
        np.random.default_rng([seed, 1]).permutation(len(runs))
        if family.shuffled
        else np.arange(len(runs))
    )
    odd = int(rng.integers(len(runs))) if family.odd_um else -1
    drift = rng.normal(0.0, family.warm_up_um * 1e-3, 3)
    sizes = {
        name: getattr(family, f"{name}_um") * 1e-3
        for name in ("spikes", "lost", "mismatch", "friction")
    }
    drive = {name: rng.normal(0.0, size, 2) for name, size in sizes.items()}
    rubbing, growing = (
        rng.normal(0.0, per_kN * 1e-6, n)
        for per_kN, n in ((family.friction_um_per_kN, None), (family.lost_um_per_kN, 2))
    )
    if plan is not None:
        runs = [(test.force_N, test.direction) for test in plan.tests]
        order = np.arange(len(runs))
        rng = np.random.default_rng([seed, 3])
    scatter = scatter_of_circles(family, seed, len(runs), again=plan is not None)
    tests = []
    for k, (nominal, way) in enumerate(runs):
        sign = 1.0 if way == "CW" else -1.0
        angle = np.linspace(0.0, 2.0 * np.pi, READINGS, endpoint=False)
        true = angle + machine.instrument["angle"] + sign * machine.instrument["lag"]
        reading = _reading(machine, nominal, true, rng)
        reading += scatter[k] * (
            rng.normal(0.0, 0.4e-3)
            + rng.normal(0.0, 0.4e-3) * np.cos(angle)
            + rng.normal(0.0, 0.4e-3) * np.sin(angle)
        )
        later = order[k] / max(len(runs) - 1, 1) - 0.5
        reading += (drift[0] + drift[1] * np.cos(angle) + drift[2] * np.sin(angle)) * later
        reading += _changes(angle, scatter[k] * 0.25e-3, rng)
        lost = drive["lost"] + growing * nominal
        reading += _drives(angle, sign, drive | {"lost": lost}, rng) + sign * rubbing * nominal
        if k == odd:
            reading += (
                _changes(angle, family.odd_um * 1e-3, rng, highest=6)
                + family.odd_um * 1e-3 * rng.normal()
            )
        if family.filtered:
            half = family.filtered // 2
            around = np.concatenate([reading[-half:], reading, reading[:half]])
            reading = np.convolve(around, np.ones(2 * half + 1) / (2 * half + 1), "valid")
        noise = np.convolve(
            rng.normal(0.0, 0.12e-3, READINGS + 4), [0.5, 0.3, 0.2, 0.1, 0.05], "valid"
        )
        reading_um = np.round((reading + noise) * 1e3 / RESOLUTION_UM) * RESOLUTION_UM
        name = f"f{nominal:03.0f}{'_' + way if family.both_ways else ''}"
        if plan is not None:
            name = plan.tests[k].name
        tests.append(
            lb.CircularTest(nominal, np.rad2deg(angle), reading_um, direction=way, name=name)  # type: ignore[arg-type]
        )
    of_all = {
        "radius_mm": RADIUS_MM,
        "resolution_um": RESOLUTION_UM,
        "name": f"seed {seed}",
        "instrument": family.stated,
    }
    run = sorted(zip(order, tests, strict=True), key=lambda pair: pair[0])
    return lb.Campaign(tuple(test for _, test in run), **of_all), machine


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


def _reading(machine: Machine, nominal: float, angle: Array, rng: np.random.Generator) -> Array:
    """Geometry, springs, balls, length, mount and force as the bar applies it; ``angle`` is the
    true one."""
    share = nominal / LARGEST_N
    bow = 4.0 * share * (1.0 - share)
    force = (
        nominal * (1.0 + machine.instrument["gain"])
        + LARGEST_N * bow * machine.instrument["force_curvature"]
    )
    force += rng.normal(0.0, 3.0)
    reading = trace_mm(machine, force, angle)
    turned = np.exp(1j * np.outer(angle, _ORDERS))
    far = np.exp(1j * np.outer(angle + np.pi, _ORDERS))
    reading = reading + (turned @ machine.work_ball + far @ machine.tool_ball).real
    pressure = (nominal + 14.2) / 126.04
    return (
        reading
        + machine.instrument["length"]
        + machine.instrument["mount"] * pressure
        + machine.instrument["mount_curvature"] * bow
    )


def _changes(angle: Array, size_mm: float, rng: np.random.Generator, highest: int = 12) -> Array:
    """What one circle has for itself at the orders 2 and up, falling as 1/n."""
    orders = np.arange(2, highest + 1)
    amplitude = rng.normal(0.0, 1.0, (2, len(orders))) * size_mm / orders
    turned = np.exp(1j * np.outer(angle, orders))
    return np.asarray(turned.real @ amplitude[0] + turned.imag @ amplitude[1])


def _drives(angle: Array, sign: float, drive: dict[str, Array], rng: np.random.Generator) -> Array:
    """What the drives add, ``sign`` 1 clockwise: servo mismatch and friction, which change their
    sign with the direction; lost motion, by half of which each axis lags behind its own velocity;
    spikes where an axis sticks after its reversal, outwards (inwards where compensated too much) in
    either direction and fading as the circle goes on."""
    total = sign * (drive["mismatch"][0] * np.sin(2.0 * angle) + drive["friction"][0])
    along = np.stack([np.cos(angle), np.sin(angle)])
    velocity = sign * np.stack([np.sin(angle), -np.cos(angle)])
    total = total - 0.5 * drive["lost"] @ (along * np.sign(np.round(velocity, 12)))
    for k in range(4):
        since = np.remainder(-sign * (angle - 0.5 * np.pi * k), 2.0 * np.pi)
        total = total + drive["spikes"][k % 2] * np.exp(-since / np.deg2rad(6.0)) * (
            1.0 + 0.1 * rng.normal()
        )
    return np.asarray(total)
