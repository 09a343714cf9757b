"""Files as they are found: do the awkward ones import to one campaign, and are the malformed ones
refused by name?

python studies/10_files/run.py            # fails when a stated number or message is not reproduced
python studies/10_files/run.py --write    # states anew
python studies/10_files/fuzz.py --write   # by hand, minutes: mutated files through every reader
python studies/10_files/guided.py --write # by hand, an hour: a coverage-guided hunt
python studies/10_files/mutation_outcomes.py 7 10000 --write # by hand, minutes: units, angles
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import ldbb_bayes as lb

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]
import awkward
import field_files
import field_programs
import field_words
import malformed
from command_line import Ended, run_command
from study import Effort, Study, run

UNITS = ("angle_deg", "reading_um", "force_N")


def imported(folder: Path, case: awkward.Case) -> dict[str, Any]:
    """Largest differences from the campaign that all cases write."""
    for name, content in case.files.items():
        (folder / name).write_bytes(content)
    files = [str(folder / name) for name in case.files]
    ended = run_command(["import", *files, "--out", str(folder / "campaign"), *case.options])
    if ended.exit_code:
        sys.exit(f"10_files: {case.description}: {ended.output}")
    largest = dict.fromkeys(UNITS, 0.0)
    tests = lb.read_campaign(folder / "campaign").tests
    for test, expected in zip(tests, awkward.campaign().tests, strict=True):
        difference = largest_differences(test, expected)
        largest = {unit: max(largest[unit], difference[unit]) for unit in UNITS}
    return {
        "what": case.description,
        "files": len(case.files),
        "options": " ".join(case.options),
        **{unit: round(value, 9) for unit, value in largest.items()},
    }


def largest_differences(test: lb.CircularTest, expected: lb.CircularTest) -> dict[str, float]:
    """Of the angles (the shorter way round), readings and force of two tests."""
    order = np.argsort(np.mod(np.round(test.angle_deg, 3), 360.0))
    angle_deg = np.asarray(test.angle_deg)[order] - np.asarray(expected.angle_deg)
    angle_deg = np.mod(angle_deg + 180.0, 360.0) - 180.0
    reading_um = np.asarray(test.reading_um)[order] - np.asarray(expected.reading_um)
    force_N = float(test.force_N or 0.0) - float(expected.force_N or 0.0)
    return {
        "angle_deg": float(np.abs(angle_deg).max()),
        "reading_um": float(np.abs(reading_um).max()),
        "force_N": abs(force_N),
    }


def refused(folder: Path, case: malformed.Malformed) -> dict[str, Any]:
    """The message, without the folder; whether it names what it should; whether anything was
    written."""
    (folder / case.file).write_bytes(case.content)
    start = time.perf_counter()
    ended = run_command(
        ["import", str(folder / case.file), "--out", str(folder / "campaign"), *case.options]
    )
    seconds = time.perf_counter() - start
    message = " ".join(ended.output.split())
    message = message.replace(f"{folder}/", "").removeprefix("ldbb-bayes: ")
    return {
        "what": case.description,
        "message": message,
        "names_the_place": all(word in message for word in case.names),
        "code": ended.exit_code,
        "written": sorted(path.name for path in folder.iterdir() if path.name != case.file),
        "in_two_seconds": seconds < 2.0,
    }


def from_the_field(folder: Path, case: field_files.FieldCase) -> dict[str, Any]:
    """Return whether files from the field are refused, and whether they read as the truth after the
    step that the refusal names."""
    write_files(folder, case.files)
    options = list(case.options)
    is_refused = False
    if case.refusal:
        ended = import_files(folder, options)
        message = " ".join(ended.output.split())
        is_refused = ended.exit_code == 2 and case.refusal in message
        options += case.step
        if case.mended is not None:
            shutil.rmtree(folder / "files")
            write_files(folder, case.mended)
    ended = import_files(folder, options)
    reads_true = False
    if ended.exit_code == 0:
        campaign = lb.read_campaign(folder / "campaign")
        reads_true = field_files.agrees(field_files.differences(campaign, case.circles))
    return {
        "kind": case.kind,
        "what": case.description,
        "refused_first": is_refused,
        "step": " ".join(case.step) or ("the file mended" if case.mended else ""),
        "reads_true": reads_true,
    }


def write_files(folder: Path, contents: Mapping[str, bytes]) -> None:
    """Write files into the folder that is imported."""
    (folder / "files").mkdir()
    for name, content in contents.items():
        (folder / "files" / name).write_bytes(content)


def import_files(folder: Path, options: list[str]) -> Ended:
    """Import all files of a folder by the command."""
    files = sorted(str(path) for path in (folder / "files").iterdir())
    return run_command(["import", *files, "--out", str(folder / "campaign"), *options])


def measure(effort: Effort) -> dict[str, Any]:
    """Every case; what was found by hand is read."""
    good = {}
    for name, case in awkward.CASES.items():
        with tempfile.TemporaryDirectory() as folder:
            good[name] = imported(Path(folder), case)
    bad = {}
    for name, malformed_case in malformed.CASES.items():
        with tempfile.TemporaryDirectory() as folder:
            bad[name] = refused(Path(folder), malformed_case)
    field = {}
    field_cases = field_files.CASES | field_programs.program_cases() | field_words.word_cases()
    for name, field_case in field_cases.items():
        with tempfile.TemporaryDirectory() as folder:
            field[name] = from_the_field(Path(folder), field_case)
    return {
        "field": field,
        "mutations": by_hand("mutations.json"),
        "awkward": good,
        "malformed": bad,
        "largest": {unit: largest_of_all(good, unit) for unit in UNITS},
        "tests": len(awkward.PRESSURES_BAR),
        "readings": awkward.READINGS,
        "fuzz": by_hand("fuzz.json"),
        "guided": by_hand("guided.json"),
    }


def largest_of_all(rows: Mapping[str, Mapping[str, Any]], unit: str) -> float:
    """The largest difference of all awkward files."""
    return max(row[unit] for row in rows.values())


def by_hand(name: str) -> Any:
    """What was measured by hand and is kept in a file."""
    return json.loads((HERE / name).read_text(encoding="utf-8"))


if __name__ == "__main__":
    differences = {f"*/{unit}": 1e-6 for unit in UNITS}
    run(Study(HERE, measure, absolute=differences, once=("malformed/*/message",)))
