"""Awkward files import to one campaign; mutated ones are read or refused in one line, without a
traceback or a long wait."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from pathlib import Path

import awkward
import fuzz
import malformed
import numpy as np
import pytest
from campaigns import cases, written
from command_line import Ended, run_command

import ldbb_bayes as lb
from ldbb_bayes.errors import LONGEST_MESSAGE


def imported(folder: Path, case: awkward.Case, out: str, *options: str) -> lb.Campaign:
    files = map(str, written(folder, case.files))
    arguments = ["import", *files, "--out", str(folder / out), *options]
    result = run_command(arguments)
    assert result.exit_code == 0, result.output
    return lb.read_campaign(folder / out)


@pytest.mark.slow
@pytest.mark.parametrize("name", awkward.CASES)
def test_awkward_files_are_read_as_they_are_meant(name: str, tmp_path: Path) -> None:
    """Forces, angles and readings as far as their digits tell; the import.toml that is written
    reads the same without options."""
    case = awkward.CASES[name]
    wanted = awkward.campaign()
    campaign = imported(tmp_path, case, "campaign", *case.options)
    assert len(campaign.tests) == len(wanted.tests)
    for test, expected in zip(campaign.tests, wanted.tests, strict=True):
        order = np.argsort(np.mod(np.round(test.angle_deg, 3), 360.0))
        difference_deg = test.angle_deg[order] - expected.angle_deg
        around_zero_deg = np.mod(difference_deg + 180.0, 360.0) - 180.0
        np.testing.assert_allclose(around_zero_deg, 0.0, atol=1e-3)
        np.testing.assert_allclose(test.reading_um[order], expected.reading_um, atol=6e-3)
        assert test.force_N == pytest.approx(expected.force_N, abs=1e-4)
    again = imported(
        tmp_path, case, "again", "--layout", str(tmp_path / "campaign" / "import.toml")
    )
    assert [test.reading_um.tolist() for test in again.tests] == [
        test.reading_um.tolist() for test in campaign.tests
    ]
    assert again.forces_N.tolist() == campaign.forces_N.tolist()


def test_the_page_counts_them(root: Path) -> None:
    """What is refused, and how, is a golden (import_malformed)."""
    assert (len(awkward.CASES) >= 30, len(malformed.CASES) >= 60) == (True, True)
    page = (root / "docs" / "how-to" / "files_as_found.md").read_text(encoding="utf-8")
    assert f"{len(awkward.CASES)} awkward ways" in page
    assert f"{len(malformed.CASES)} files that are refused" in page


# What a message names: options that say otherwise, or the line to leave out. The others name what
# only its owner can mend.
CURES: dict[str, str] = cases(__file__, "cures.toml")
LINES = "08 09 11 12 13 14 16 17 18 19 20 21 22 41 43 63"


@pytest.mark.parametrize(
    "name", [*CURES, *(name for name in malformed.CASES if name[:2] in LINES.split())]
)
def test_the_cure_that_is_named_works(name: str, tmp_path: Path) -> None:
    case = malformed.CASES[name]
    path = tmp_path / case.file
    path.write_bytes(case.content)

    def import_it(*options: str) -> Ended:
        return run_command(["import", str(path), "--out", str(tmp_path / "c"), *options])

    message = import_it(*case.options).output
    if name in CURES:
        options = [option.replace("36_N", "36 N") for option in CURES[name].split()]
        if options and name != "33_metres":
            assert options[0] in message or options[0] in case.options, message
        last = import_it(*options)
    else:
        (line,) = re.findall(r"line (\d+):", message)
        rows = case.content.split(b"\n")
        path.write_bytes(b"\n".join([*rows[: int(line) - 1], *rows[int(line) :]]))
        last = import_it(*case.options)
    assert last.exit_code == 0, f"{message} -> {last.output}"


def without_memory(findings: fuzz.Findings) -> list[str]:
    """What was wrong; the process holds the other tests' memory too."""
    return [line for line in findings.wrong if not line.endswith(" MB")]


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["import, text", "import, workbook", "layout", "tidy table", "model", "truths"]
)
def test_a_few_hundred_mutations(name: str) -> None:
    findings = fuzz.fuzz(name, 300, 11, {})
    assert without_memory(findings) == []
    assert findings.read + findings.refused == 300


@pytest.mark.slow
def test_many_mutations() -> None:
    """In other inputs than those of the study: no traceback, no input above 2 s of the processor,
    no reader above 500 MB."""
    all_findings = list(fuzz.fuzz_all(20_000, 2, list(fuzz.readers({}))))
    assert sum(findings.inputs for findings in all_findings) >= 20_000
    for findings in all_findings:
        assert findings.wrong == (), findings.reader
        assert findings.refused > 0
        assert findings.slowest_cpu_s < 2.0
        assert findings.largest_mb < 500.0


def wait(seconds: float) -> None:
    time.sleep(seconds)


def compute(seconds: float) -> None:
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


@pytest.mark.parametrize(("spend", "is_wrong"), [(wait, False), (compute, True)])
def test_only_time_of_the_processor_is_limited(
    monkeypatch: pytest.MonkeyPatch, spend: Callable[[float], None], is_wrong: bool
) -> None:
    reader = fuzz.Reader("x.csv", [b"12345678" * 4], lambda _: spend(0.2), 1.0)
    monkeypatch.setattr(fuzz, "readers", lambda options: {"own": reader})
    monkeypatch.setattr(fuzz, "keep", lambda *_: None)
    monkeypatch.setattr(fuzz, "LIMIT_S", 0.15)
    findings = fuzz.fuzz("own", 1, 1, {})
    assert findings.slowest_s > 0.15
    assert bool(without_memory(findings)) == is_wrong


def test_a_reader_that_fails_would_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """A traceback and a long message are found."""

    def fails(path: Path) -> None:
        if path.stat().st_size % 2:
            raise KeyError("angle")
        raise lb.InputError("x" * 5 * LONGEST_MESSAGE)

    paths: list[Path] = []

    def reads_once(path: Path) -> None:
        paths.append(path)
        if len(paths) > 1:
            fails(path)

    reader = fuzz.Reader("x.csv", [b"12345678" * 4], reads_once, 1.0)
    monkeypatch.setattr(fuzz, "readers", lambda options: {"own": reader})
    monkeypatch.setattr(fuzz, "keep", lambda *_: None)
    messages = without_memory(fuzz.fuzz("own", 40, 1, {}))
    assert 0 < len(messages) < 40
    assert all("KeyError" in line for line in messages)
