"""What becomes of mutated files from the field: what is accepted equals the truth, or a note says
what was assumed of the very quantity that was changed, and the campaign is as the notes say.

python studies/10_files/mutation_outcomes.py SEED NUMBER            # prints what became of them
python studies/10_files/mutation_outcomes.py SEED NUMBER --write    # states the counts anew
"""

from __future__ import annotations

import json
import re
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import field_files as field
import field_mutations
import numpy as np
from field_mutations import TIME_UNITS, Meaning, Mutation, WrittenCircle, circle_of

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.assumptions import Assumption

__all__ = ["outcome"]

HERE = Path(__file__).resolve().parent
LIMITS = {"angle_deg": 0.02, "reading_um": 6e-3, "force_N": 1e-3, "radius_mm": 1e-3}
# Units as notes name them, each with its size in µm, degrees or newtons.
SIZES = {
    "um": 1.0,
    "mm": 1e3,
    "nm": 1e-3,
    "m": 1e6,
    "cm": 1e4,
    "inch": 25400.0,
    "mil": 25.4,
    "uinch": 0.0254,
    "deg": 1.0,
    "rad": 180.0 / np.pi,
    "gon": 0.9,
    "mrad": 0.18 / np.pi,
    "arcmin": 1.0 / 60.0,
    "N": 1.0,
    "kN": 1e3,
    "daN": 10.0,
    "lbf": 4.4482216152605,
    "kgf": 9.80665,
}
# Reasons of notes on quantities that nothing in a file states.
_NOTHING_STATES = re.compile("says otherwise|fit this unit|no unit in the header|spans")
AXES_DEG = {"+X": 0.0, "+Y": 90.0, "-X": 180.0, "-Y": 270.0}
SENSES = {"CW": -1, "CCW": 1}
# Fields of a meaning that the unit of a quantity changes.
FIELD_OF_UNIT = {"reading": "um_per_reading", "angle": "deg_per_angle", "force": "N_per_force"}


def outcome(folder: Path, mutated: Mutation) -> str:
    """Return "refused", "true", "told" or "silent", the latter two with the misread fields."""
    paths = []
    for name, content in mutated.files.items():
        (folder / name).write_bytes(content)
        paths.append(folder / name)
    try:
        imported = lb.import_campaign(paths)
    except InputError:
        return "refused"
    finally:
        for path in paths:
            path.unlink()
    true = [circle_of(written, written.meaning) for written in mutated.circles]
    wrong = misread(imported.campaign, true)
    if not wrong:
        return "true"
    noted = []
    for written in mutated.circles:
        meaning = meaning_by_notes(written, imported.assumptions)
        noted.append(circle_of(written, meaning))
    silent = misread(imported.campaign, noted)
    subjects = {assumption.what for assumption in imported.assumptions}
    if silent == ["readings"] and "run-in and run-out" in subjects:
        # Of a log whose circle is assumed to be another, readings are left out.
        return f"told: {', '.join(wrong)}"
    if silent:
        return f"silent: {', '.join(silent)}"
    passed_over = _passed_over(mutated, imported.assumptions)
    if passed_over:
        return f"silent, passed over: {', '.join(passed_over)}"
    return f"told: {', '.join(wrong)}"


def _passed_over(mutated: Mutation, assumptions: Sequence[Assumption]) -> list[str]:
    """Return what the files state, although a note gives a reason of what nothing states."""
    subjects = []
    for assumption in assumptions:
        if assumption.what in mutated.stated and _NOTHING_STATES.search(assumption.because):
            subjects.append(assumption.what)
    return subjects


def misread(campaign: lb.Campaign, circles: Sequence[field.Circle]) -> list[str]:
    """Return the quantities in which a campaign differs from circles by more than rounding."""
    off = field.differences(campaign, circles)
    return [key for key, value in off.items() if value > LIMITS.get(key, 0.0)]


def meaning_by_notes(written: WrittenCircle, assumptions: Sequence[Assumption]) -> Meaning:
    """Return the true meaning of a circle, changed to what the notes say was assumed."""
    meaning = written.meaning
    general = []
    particular = []
    for assumption in assumptions:
        place = assumption.place
        if not place or place.endswith(" places"):
            general.append(assumption)
        elif f"{written.name}'" in f"{place}'" or place.endswith("all.csv"):
            particular.append(assumption)
    for assumption in (*general, *particular):
        meaning = replace(meaning, **_assumed(assumption, meaning))
    return meaning


def _assumed(assumption: Assumption, meaning: Meaning) -> dict[str, Any]:
    """Return the fields of a meaning that one note states."""
    value = assumption.value.removesuffix(", as given")
    subject = assumption.what
    size = _size_of(value)
    if subject.startswith("unit of the ") and size is not None:
        quantity = subject.rpartition(" ")[2]
        if quantity not in FIELD_OF_UNIT:
            return {}
        return {FIELD_OF_UNIT[quantity]: size}
    if subject == "reading" and value.startswith("half"):
        return {"is_diameter": True}
    if subject == "reading" and value.startswith("distance"):
        return {"is_distance": True}
    number = re.match(r"[\d.]+", value)
    if subject == "radius_mm" and number is not None:
        return {subject: float(number[0])}
    if meaning.feed_mm_per_min:
        return _assumed_of_log(subject, value)
    return _assumed_of_angles(subject, value)


def _assumed_of_angles(subject: str, value: str) -> dict[str, Any]:
    """Return the fields of the meaning of a table of angles that one note states."""
    convention = re.fullmatch(r"from ([+-][XY]), (CW|CCW)", value)
    if subject == "angle" and convention is not None:
        return {"zero_deg": AXES_DEG[convention[1]], "sense": SENSES[convention[2]]}
    if subject == "direction":
        stated = re.match("CC?W", value)
        return {"direction": stated[0] if stated else None}
    if subject == "sign of the reading":
        return {"sign": int(value.partition(":")[0])}
    return {}


def _assumed_of_log(subject: str, value: str) -> dict[str, Any]:
    """Return the fields of the meaning of a log over time that one note states."""
    number = re.match(r"-?[\d.]+", value)
    if subject == "feed_mm_per_min" and number is not None:
        return {subject: float(number[0])}
    if subject == "start_deg" and number is not None:
        return {"zero_deg": float(number[0])}
    if subject == "unit of the time":
        return {"s_per_time": TIME_UNITS[value]}
    direction = re.match("CC?W", value)
    if subject == "direction" and direction is not None:
        return {"direction": direction[0], "sense": SENSES[direction[0]]}
    if subject == "sign of the reading":
        return {"sign": int(value.partition(":")[0])}
    return {}


def _size_of(unit: str) -> float | None:
    """Return the size of a unit, which may have a factor; None for several units or none."""
    factor, _, name = unit.rpartition(" ")
    if name not in SIZES:
        return None
    try:
        return float(factor or 1.0) * SIZES[name]
    except ValueError:
        return None


def main() -> None:
    """Try as many mutations as asked for and print what became of them."""
    random = np.random.default_rng(int(sys.argv[1]))
    counts: Counter[str] = Counter()
    examples_by_outcome: dict[str, list[str]] = {}
    start = time.process_time()
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        for _ in range(int(sys.argv[2])):
            mutated = field_mutations.mutation(random)
            became = outcome(Path(folder), mutated)
            counts[became] += 1
            if became.startswith(("silent", "told")):
                examples_by_outcome.setdefault(became, []).append(mutated.description)
    kinds: Counter[str] = Counter()
    for became, number in counts.items():
        kinds[re.split("[:,]", became)[0]] += number
    stated = {"seed": int(sys.argv[1]), "mutations": counts.total()}
    stated |= {kind: kinds[kind] for kind in ("true", "told", "refused", "silent")}
    print(json.dumps(stated, indent=1), round(time.process_time() - start), "s of CPU")
    if "--write" in sys.argv:
        (HERE / "mutations.json").write_text(json.dumps(stated, indent=1) + "\n", encoding="utf-8")
    for became, examples in sorted(examples_by_outcome.items()):
        print(f"{len(examples)} {became}")
        for example in examples[:12]:
            print("   ", example)


if __name__ == "__main__":
    main()
