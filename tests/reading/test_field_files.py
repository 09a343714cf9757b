"""Files from the field: each reads as the truth, or is refused with a step; done that step, it
reads as the truth."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import field_files
import field_programs
import field_words
import pytest
from campaigns import Invoke

import ldbb_bayes as lb

CASES = {
    **field_files.CASES,
    **field_programs.program_cases(),
    **field_words.word_cases(),
}
REFUSED = {name: case for name, case in CASES.items() if case.refusal}
READ = {name: case for name, case in CASES.items() if not case.refusal}


def write(folder: Path, files: Mapping[str, bytes]) -> list[Path]:
    folder.mkdir()
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return sorted(folder.iterdir(), key=lambda path: path.name)


def assert_true(folder: Path, case: field_files.FieldCase) -> None:
    off = field_files.differences(lb.read_campaign(folder), case.circles)
    assert field_files.agrees(off), off


@pytest.mark.parametrize("name", READ)
def test_what_stands_in_a_file_is_used(name: str, tmp_path: Path, invoke: Invoke) -> None:
    case = CASES[name]
    files = write(tmp_path / "files", case.files)
    code, stdout, stderr = invoke("import", *files, "--out", tmp_path / "c", *case.options)
    assert code == 0, stderr
    assert_true(tmp_path / "c", case)
    assert case.note in " ".join(stdout.split())


@pytest.mark.parametrize("name", REFUSED)
def test_a_refusal_names_the_step_that_reads_the_file(
    name: str, tmp_path: Path, invoke: Invoke
) -> None:
    case = CASES[name]
    files = write(tmp_path / "files", case.files)
    code, _, stderr = invoke("import", *files, "--out", tmp_path / "c", *case.options)
    assert (code, case.refusal in " ".join(stderr.split())) == (2, True), stderr
    if case.mended is not None:
        files = write(tmp_path / "mended", case.mended)
    options = (*case.options, *case.step)
    code, _, stderr = invoke("import", *files, "--out", tmp_path / "c", *options)
    assert code == 0, stderr
    assert_true(tmp_path / "c", case)
