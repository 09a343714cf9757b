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
from study import Study, run


def imported(folder: Path, case: awkward.Case) -> dict[str, Any]:
    """Largest differences from the campaign that all cases write."""
    for name, content in case.files.items():
        (folder / name).write_bytes(content)
    files = [str(folder / name) for name in case.files]
    done = run_command(["import", *files, "--out", str(folder / "campaign"), *case.options])
    if done.exit_code:
        sys.exit(f"10_files: {case.what}: {done.output}")
    off: dict[str, list[float]] = {"angle_deg": [], "reading_um": [], "force_N": []}
    for test, own in zip(
        lb.read_campaign(folder / "campaign").tests, awkward.campaign().tests, strict=True
    ):
        order = np.argsort(np.mod(np.round(test.angle_deg, 3), 360.0))
        angle = (
            np.mod(np.asarray(test.angle_deg)[order] - np.asarray(own.angle_deg) + 180.0, 360.0)
            - 180.0
        )
        off["angle_deg"].append(float(np.abs(angle).max()))
        off["reading_um"].append(
            float(np.abs(np.asarray(test.reading_um)[order] - np.asarray(own.reading_um)).max())
        )
        off["force_N"].append(abs(float(test.force_N or 0.0) - float(own.force_N or 0.0)))
    return {
        "what": case.what,
        "files": len(case.files),
        "options": " ".join(case.options),
        **{name: round(max(found), 9) for name, found in off.items()},
    }


def refused(folder: Path, case: malformed.Malformed) -> dict[str, Any]:
    """The message, without the folder; whether it names what it should; whether anything was
    written."""
    (folder / case.file).write_bytes(case.content)
    start = time.perf_counter()
    done = run_command(
        ["import", str(folder / case.file), "--out", str(folder / "campaign"), *case.options]
    )
    said = " ".join(done.output.split()).replace(f"{folder}/", "").removeprefix("ldbb-bayes: ")
    return {
        "what": case.what,
        "message": said,
        "names_the_place": all(word in said for word in case.names),
        "code": done.exit_code,
        "written": sorted(path.name for path in folder.iterdir() if path.name != case.file),
        "in_two_seconds": time.perf_counter() - start < 2.0,
    }


def from_the_field(folder: Path, case: field_files.FieldCase) -> dict[str, Any]:
    """Return whether files from the field are refused, and whether they read as the truth after the
    step that the refusal names."""
    (folder / "files").mkdir()
    for name, content in case.files.items():
        (folder / "files" / name).write_bytes(content)
    options = list(case.options)
    is_refused = False
    if case.refusal:
        done = import_files(folder, options)
        said = " ".join(done.output.split())
        is_refused = done.exit_code == 2 and case.refusal in said
        options += case.step
        if case.mended is not None:
            shutil.rmtree(folder / "files")
            (folder / "files").mkdir()
            for name, content in case.mended.items():
                (folder / "files" / name).write_bytes(content)
    done = import_files(folder, options)
    reads_true = False
    if done.exit_code == 0:
        campaign = lb.read_campaign(folder / "campaign")
        reads_true = field_files.agrees(field_files.differences(campaign, case.circles))
    return {
        "kind": case.kind,
        "what": case.what,
        "refused_first": is_refused,
        "step": " ".join(case.step) or ("the file mended" if case.mended else ""),
        "reads_true": reads_true,
    }


def import_files(folder: Path, options: list[str]) -> Ended:
    """Import all files of a folder by the command."""
    files = sorted(str(path) for path in (folder / "files").iterdir())
    return run_command(["import", *files, "--out", str(folder / "campaign"), *options])


def measure() -> dict[str, Any]:
    """Every case; what was found by hand is read."""
    good = {}
    bad = {}
    for name, case in awkward.CASES.items():
        with tempfile.TemporaryDirectory() as folder:
            good[name] = imported(Path(folder), case)
    for name, wrong in malformed.CASES.items():
        with tempfile.TemporaryDirectory() as folder:
            bad[name] = refused(Path(folder), wrong)
    field = {}
    cases_of_field = field_files.CASES | field_programs.program_cases() | field_words.word_cases()
    for name, case_of_field in cases_of_field.items():
        with tempfile.TemporaryDirectory() as folder:
            field[name] = from_the_field(Path(folder), case_of_field)
    return {
        "field": field,
        "mutations": json.loads((HERE / "mutations.json").read_text(encoding="utf-8")),
        "awkward": good,
        "malformed": bad,
        "largest": {
            unit: max(own[unit] for own in good.values())
            for unit in ("angle_deg", "reading_um", "force_N")
        },
        "tests": len(awkward.PRESSURES_BAR),
        "readings": awkward.READINGS,
        "fuzz": json.loads((HERE / "fuzz.json").read_text(encoding="utf-8")),
        "guided": json.loads((HERE / "guided.json").read_text(encoding="utf-8")),
    }


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    small = {f"*/{name}": 1e-6 for name in ("angle_deg", "reading_um", "force_N")}
    run(Study(HERE, lambda effort: measure(), absolute=small, once=("malformed/*/message",)))


if __name__ == "__main__":
    main()
