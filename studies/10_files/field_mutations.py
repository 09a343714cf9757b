"""Mutations of the field files: units, radii and conventions are changed in header, column, line
or cell format. What is accepted equals the truth or says what it assumed of the mutated field.

python studies/10_files/field_mutations.py SEED NUMBER            # prints what became of them
python studies/10_files/field_mutations.py SEED NUMBER --write    # states the counts anew
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import field_files as field
import numpy as np
from field_files import TRUTH, Circle

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError

__all__ = ["Mutation", "mutation", "outcome"]

HERE = Path(__file__).resolve().parent
Files = dict[str, bytes]
Random = np.random.Generator
# Units of readings, as they may be written, each with its size [µm].
READING_UNITS = {
    "um": 1.0,
    "µm": 1.0,
    "μm": 1.0,
    "micron": 1.0,
    "mm": 1e3,
    "nm": 1e-3,
    "inch": 25400.0,
    "mil": 25.4,
    "uinch": 0.0254,
    "0.1 um": 0.1,
    "мкм": 1.0,
    "Mikrometer": 1.0,
    "10 nm": 0.01,
    "counts": 0.1,
    "V": 1.0,
    "furlong": 1.0,
}
# Units of angles, each with the number of them in a degree.
ANGLE_UNITS = {"deg": 1.0, "°": 1.0, "rad": np.pi / 180.0, "gon": 1.0 / 0.9, "Grad": 1.0, "": 1.0}
READING_WORDS = (
    "Reading",
    "Deviation",
    "Messwert",
    "Abweichung",
    "Value",
    "Écart",
    "偏差",
    "Отклонение",
)
ANGLE_WORDS = ("Angle", "Winkel", "theta", "角度", "Угол", "Position")
RADIUS_LINES = (
    "Radius: {r} mm",
    "R = {r} mm",
    "Diameter: {d} mm",
    "Ø {d} mm",
    "Bar length: {r} mm",
    "Kreisdurchmesser: {d} mm",
    "Rayon: {r} mm",
    "Raggio {r} mm",
    "Radius {ri} inch",
    "Nominal radius = {r}",
    "Länge der Stange: {r} mm",
    "Circle: {r} mm",
)
ANGLE_LINES = {
    "Angle from Y clockwise": (90.0, -1),
    "Zero of the angle: +Y": (90.0, 1),
    "Zero of the angle: -X": (180.0, 1),
    "Angle counted clockwise from +X": (0.0, -1),
    "Winkel ab +Y im Uhrzeigersinn": (90.0, -1),
    "Nullpunkt des Winkels: -Y": (270.0, 1),
}
PLACES = ("header", "header without brackets", "in", "line", "column", "cells", "nowhere")


@dataclass(frozen=True)
class Mutation:
    """Mutated files with the campaign that they truly hold."""

    what: str
    files: Files
    circles: tuple[Circle, ...]


def pick(random: Random, values: object) -> str:
    return str(random.choice(list(values)))  # type: ignore[call-overload]


def mutation(random: Random) -> Mutation:
    """Return files with a random unit, place of the unit, radius and convention."""
    unit = pick(random, READING_UNITS)
    angle_unit = pick(random, ANGLE_UNITS)
    place = pick(random, PLACES)
    separator = pick(random, (";", "\t", "|"))
    decimal = pick(random, (".", ","))
    is_diameter = bool(random.random() < 0.15)
    zero_deg = 0.0
    sense = 1
    above = []
    radius = 150.0
    if random.random() < 0.4:
        radius = float(random.choice([100.0, 200.0, 250.0, 300.0]))
        line = pick(random, RADIUS_LINES)
        above.append(line.format(r=f"{radius:g}", d=f"{2 * radius:g}", ri=f"{radius / 25.4:.6f}"))
    if random.random() < 0.3:
        line = pick(random, ANGLE_LINES)
        zero_deg = ANGLE_LINES[line][0]
        sense = ANGLE_LINES[line][1]
        above.append(line)
    if place == "line":
        line = pick(random, ("Units: {u}", "Einheit: {u}", "Unit of readings = {u}"))
        above.append(line.format(u=unit))
    reading_word = pick(random, READING_WORDS)
    if is_diameter:
        reading_word = pick(random, ("Diameter deviation", "ΔD", "Durchmesserabweichung"))
    reading_header = {
        "header": f"{reading_word} [{unit}]",
        "header without brackets": f"{reading_word} {unit}",
        "in": f"{reading_word} in {unit}",
    }.get(place, reading_word)
    angle_header = pick(random, ANGLE_WORDS)
    if angle_unit:
        angle_header += f" [{angle_unit}]"
    header = [angle_header, reading_header]
    if place == "column":
        header.append(pick(random, ("Unit", "Einheit", "Units", "")))
    files = {}
    for circle in TRUTH:
        rows = [*above, separator.join(header)]
        for k in range(len(circle.angle_deg)):
            degrees = np.mod(sense * (circle.angle_deg[k] - zero_deg), 360.0)
            factor = 2.0 if is_diameter else 1.0
            reading = f"{factor * circle.reading_um[k] / READING_UNITS[unit]:.9f}"
            cells = [f"{degrees * ANGLE_UNITS[angle_unit]:.7f}", reading]
            cells = [cell.replace(".", decimal) for cell in cells]
            if place == "cells":
                cells[1] += f" {unit}"
            if place == "column":
                cells.append(unit)
            rows.append(separator.join(cells))
        files[f"{circle.force_N:g}N.csv"] = "\n".join([*rows, ""]).encode()
    circles = tuple(Circle(c.force_N, c.angle_deg, c.reading_um, radius) for c in TRUTH)
    shown = "; ".join([f"{place} {unit!r}", *above, *header])
    return Mutation(shown, files, circles)


# What a note of the import calls each quantity.
FIELDS: dict[str, Callable[[str], bool]] = {
    "reading_um": lambda what: what in ("unit of the reading", "readings", "measured", "reading"),
    "angle_deg": lambda what: what in ("unit of the angle", "angle", "angle_zero", "angle_sense"),
    "radius_mm": lambda what: what == "radius_mm",
}
LIMITS = {"angle_deg": 0.02, "reading_um": 6e-3, "force_N": 1e-6, "radius_mm": 1e-3}


def outcome(folder: Path, mutated: Mutation) -> str:
    """Return "refused", "true", "told", or "silent" with the fields that are misread."""
    paths = []
    for name, content in mutated.files.items():
        (folder / name).write_bytes(content)
        paths.append(folder / name)
    try:
        imported = lb.import_campaign(paths)
    except InputError:
        return "refused"
    off = field.differences(imported.campaign, mutated.circles)
    wrong = [key for key, value in off.items() if value > LIMITS.get(key, 0.0)]
    if not wrong:
        return "true"
    said = [assumption.what for assumption in imported.assumptions]
    silent = [key for key in wrong if key not in FIELDS or not any(map(FIELDS[key], said))]
    return f"silent: {', '.join(silent)}" if silent else "told"


def main() -> None:
    """Try as many mutations as asked for and print what became of them."""
    random = np.random.default_rng(int(sys.argv[1]))
    counts: Counter[str] = Counter()
    shown: dict[str, list[str]] = {}
    start = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(int(sys.argv[2])):
            mutated = mutation(random)
            became = outcome(Path(folder), mutated)
            counts[became] += 1
            if became.startswith(("silent", "told")):
                shown.setdefault(became, []).append(mutated.what)
    stated = {
        "seed": int(sys.argv[1]),
        "mutations": counts.total(),
        "true": counts["true"],
        "told": counts["told"],
        "refused": counts["refused"],
        "silent": sum(number for became, number in counts.items() if became.startswith("silent")),
    }
    print(json.dumps(stated, indent=1), round(time.process_time() - start), "s of CPU")
    if "--write" in sys.argv:
        (HERE / "mutations.json").write_text(json.dumps(stated, indent=1) + "\n", encoding="utf-8")
    for became, examples in shown.items():
        for example in examples[:12]:
            print(became, "|", example)


if __name__ == "__main__":
    main()
