"""Awkward files import to one campaign; malformed ones are refused by a message that names the place; nothing is written."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from typer.testing import CliRunner

import ldbb_bayes as lb
from ldbb_bayes.cli.main import app

STUDY = Path(__file__).parents[2] / "studies" / "10_files"
sys.path.insert(0, str(STUDY))
import awkward  # noqa: E402
import malformed  # noqa: E402


def imported(folder: Path, case: awkward.Case) -> lb.Campaign:
    for name, content in case.files.items():
        (folder / name).write_bytes(content)
    files = [str(folder / name) for name in case.files]
    found = CliRunner().invoke(app, ["import", *files, "--out", str(folder / "campaign"), *case.options])
    assert found.exit_code == 0, found.output
    return lb.read_campaign(folder / "campaign")


@pytest.mark.parametrize("name", awkward.CASES)
def test_awkward(name: str, tmp_path: Path) -> None:
    """Forces, angles and readings as far as their digits tell."""
    campaign, wanted = imported(tmp_path, awkward.CASES[name]), awkward.campaign()
    assert len(campaign.tests) == len(wanted.tests)
    for test, own in zip(campaign.tests, wanted.tests, strict=True):
        order = np.argsort(np.mod(np.round(test.angle_deg, 3), 360.0))
        np.testing.assert_allclose(np.mod(test.angle_deg[order] - own.angle_deg + 180.0, 360.0) - 180.0, 0.0, atol=1e-3)
        np.testing.assert_allclose(test.reading_um[order], own.reading_um, atol=6e-3)
        assert test.force_N == pytest.approx(own.force_N, abs=1e-4)


@pytest.mark.parametrize("name", awkward.CASES)
def test_awkward_with_its_own_layout(name: str, tmp_path: Path) -> None:
    """The import.toml beside the campaign reads the same files to the same campaign, option or no option."""
    case = awkward.CASES[name]
    first = imported(tmp_path, case)
    files = [str(tmp_path / own) for own in case.files]
    layout = ["--layout", str(tmp_path / "campaign" / "import.toml")]
    again = CliRunner().invoke(app, ["import", *files, "--out", str(tmp_path / "again"), *layout])
    assert again.exit_code == 0, again.output
    assert [test.reading_um.tolist() for test in lb.read_campaign(tmp_path / "again").tests] == [
        test.reading_um.tolist() for test in first.tests
    ]
    assert lb.read_campaign(tmp_path / "again").forces_N.tolist() == first.forces_N.tolist()


@pytest.mark.parametrize("name", malformed.CASES)
def test_malformed(name: str, tmp_path: Path) -> None:
    case = malformed.CASES[name]
    (tmp_path / case.file).write_bytes(case.content)
    start = time.process_time()
    found = CliRunner().invoke(app, ["import", str(tmp_path / case.file), "--out", str(tmp_path / "campaign"), *case.options])
    said = " ".join(found.output.split())
    assert found.exit_code == 2, said
    assert isinstance(found.exception, SystemExit)
    for word in case.names:
        assert word in said
    assert [path.name for path in tmp_path.iterdir()] == [case.file]
    assert time.process_time() - start < 20.0


def test_there_are_as_many_as_promised() -> None:
    assert len(awkward.CASES) >= 30
    assert len(malformed.CASES) >= 60


def test_the_readme_counts_them() -> None:
    readme = (STUDY.parents[1] / "docs" / "readings.md").read_text(encoding="utf-8")
    assert f"{len(awkward.CASES)} awkward ways" in readme
    assert f"{len(malformed.CASES)} files that are refused" in readme


def test_modules_are_those_of_the_study() -> None:
    for module in (awkward, malformed):
        assert isinstance(module, ModuleType)
        assert Path(str(module.__file__)).parent == STUDY
