"""Campaign folders for the goldens, made with numpy alone: nothing here depends on the package."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["CAMPAIGNS", "Circle", "fleet", "plan", "write_campaign"]

FORCES_N = (36.0, 212.0, 389.0, 566.0, 742.0)
READINGS = 72
NOISE_UM = 0.3
ALONG = {"X": 5.5e-5, "Y": 4.2e-5, "Z": 3.0e-5}  # mm/N
GAIN = {"X": -1e-4, "Y": -8e-5, "Z": 4e-5}
OFFSET_MM = {"X": 4e-3, "Y": -1e-3, "Z": 2e-3}
ACROSS, SQUARE, BEND = 5e-7, 5e-6, (4e-7, -6e-7)  # mm/N, rad, 1/mm


@dataclass(frozen=True)
class Circle:
    """One circular test: what campaign.toml says of it, and its angles."""

    force_N: float
    angle_deg: np.ndarray
    plane: str = "XY"
    radius_mm: float = 150.0
    said: dict[str, Any] = field(default_factory=dict)


def full(readings: int = READINGS) -> np.ndarray:
    return np.arange(readings) * 360.0 / readings


def uneven(k: int) -> np.ndarray:
    """An arc of 250° to 330° that begins elsewhere in every test, read more densely at its start."""
    share = np.linspace(0.0, 1.0, READINGS) ** (1.0 + 0.1 * k)
    return np.round(-20.0 + 40.0 * k + (250.0 + 20.0 * k) * share, 4)


def readings_um(circle: Circle, random: np.random.RandomState, *, slope: float, factor: float) -> np.ndarray:
    """Compliance, geometry, form of both balls, what differs between circles, and noise, to 0.01 µm."""
    a, b = circle.plane
    theta, radius, force = np.deg2rad(circle.angle_deg), circle.radius_mm, circle.force_N
    c, s = np.cos(theta), np.sin(theta)
    grown = 1.0 + slope * (force - 389.0) / 389.0
    mm = force * grown * (factor * ALONG[a] * c**2 + ALONG[b] * s**2 + ACROSS * c * s)
    mm += radius * (GAIN[a] * c**2 + GAIN[b] * s**2 - SQUARE * c * s) + radius**2 * (BEND[0] * c**2 * s + BEND[1] * c * s**2)
    mm += OFFSET_MM[a] * c + OFFSET_MM[b] * s
    for order in range(2, 6):
        for ball, size in (("work_ball_deg", 1.5e-3), ("tool_ball_deg", 1e-3)):
            turned = theta - np.deg2rad(circle.said.get(ball, 0.0))
            mm += size / order**2 * np.cos(order * turned + order)
    mm += {"CW": -4e-4, "CCW": 4e-4}.get(circle.said.get("direction", ""), 0.0) * (1.0 + 0.5 * np.cos(theta))
    um = 1e3 * mm + random.normal(0.0, 0.5)
    for order in range(1, 6):
        cos, sin = random.normal(0.0, 0.3 / order, 2)
        um += cos * np.cos(order * theta) + sin * np.sin(order * theta)
    return np.round(um + random.normal(0.0, NOISE_UM, len(theta)), 2)


_TURNS = ((0.0, 0.0), (45.0, 0.0), (90.0, 45.0), (0.0, 90.0), (135.0, 135.0))
CAMPAIGNS = {
    "arcs": [Circle(force, uneven(k)) for k, force in enumerate(FORCES_N)],
    "clocked": [
        Circle(force, full(), said={"work_ball_deg": work, "tool_ball_deg": tool})
        for force, (work, tool) in zip(FORCES_N, _TURNS, strict=True)
    ],
    "two_radii": [Circle(force, full(), radius_mm=radius) for radius in (150.0, 100.0) for force in (36.0, 389.0, 742.0)],
    "both_ways": [Circle(force, full(), said={"direction": way}) for force in (36.0, 389.0, 742.0) for way in ("CCW", "CW")],
    "three_planes": [Circle(force, full(), plane=plane) for plane in ("XY", "YZ", "ZX") for force in (100.0, 700.0)],
}


def write_campaign(
    folder: Path,
    circles: Sequence[Circle],
    *,
    seed: int = 1,
    slope: float = 0.03,
    factor: float = 1.0,
    said: Sequence[str] = (),
    measured: bool = True,
) -> Path:
    """campaign.toml and, where it is measured, one CSV per test; ``slope``: how compliance grows with force, ``factor``: what
    C along the first axis is multiplied with, ``said``: further lines of campaign.toml."""
    folder.mkdir(parents=True)
    random = np.random.RandomState(seed)
    lines = ["schema = 1", 'topology = "wCAFYXZSt"', f'plane = "{circles[0].plane}"', "radius_mm = 150.0"]
    lines += [f'name = "{folder.name}"', "resolution_um = 0.24", *said]
    for k, circle in enumerate(circles):
        name = f"t{k + 1}"
        lines += ["[[test]]", f'name = "{name}"', f"force_N = {circle.force_N!r}"]
        lines += [f'file = "{name}.csv"'] if measured else [f"readings = {len(circle.angle_deg)}"]
        lines += [f'plane = "{circle.plane}"', f"radius_mm = {circle.radius_mm!r}"]
        lines += [f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {value!r}" for key, value in circle.said.items()]
        if measured:
            reading = readings_um(circle, random, slope=slope, factor=factor)
            rows = [f"{angle:.4f},{value:.2f}" for angle, value in zip(circle.angle_deg, reading, strict=True)]
            (folder / f"{name}.csv").write_text("\n".join(["angle_deg,reading_um", *rows, ""]), encoding="utf-8")
    (folder / "campaign.toml").write_text("\n".join([*lines, ""]), encoding="utf-8")
    return folder


def plan(folder: Path) -> Path:
    """Three circles that nobody has run yet, the balls turned once."""
    turned = {"work_ball_deg": 60.0, "tool_ball_deg": 60.0}
    circles = [Circle(36.0, full()), Circle(389.0, full(), said=turned), Circle(742.0, full())]
    return write_campaign(folder, circles, measured=False)


def fleet(folder: Path) -> list[Path]:
    """Six machines, three circles a campaign: M0 is of another kind; M1 loosens by 40 % before its third campaign of four."""
    found = []
    months = {1: ("01", "03", "05", "07")}
    for machine, spread in enumerate((2.2, 1.0, 1.03, 0.97, 1.01, 0.98)):
        for visit, month in enumerate(months.get(machine, ("02",))):
            factor = spread * (1.4 if machine == 1 and visit >= 2 else 1.0)
            said = (f'machine_id = "M{machine}"', f"date = 2026-{month}-15")
            circles = [Circle(force, full(60)) for force in (36.0, 400.0, 742.0)]
            own = folder / f"m{machine}_{month}"
            write_campaign(own, circles, seed=10 * machine + visit, slope=0.0, factor=factor, said=said)
            found.append(own)
    return found
