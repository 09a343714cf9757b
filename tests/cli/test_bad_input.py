"""Every kind of bad input: exit code 2, one message that names the file and the place and the cure, nothing written."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.cli.main import app
from ldbb_bayes.inference.origin import record_of

Spoil = Callable[[Path], None]


def edit(file: str, old: str, new: str, count: int = 1) -> Spoil:
    def spoil(folder: Path) -> None:
        text = (folder / file).read_text()
        assert old in text, f"{old!r} not in {file}"
        (folder / file).write_text(text.replace(old, new, count))

    return spoil


def rows(header: str, angles: np.ndarray) -> Spoil:
    def spoil(folder: Path) -> None:
        lines = [f"{float(a)!r},{0.1 * i}" for i, a in enumerate(angles)]
        (folder / "f300.csv").write_text(header + "\n" + "\n".join(lines) + "\n")

    return spoil


def cell(line: int, text: str) -> Spoil:
    def spoil(folder: Path) -> None:
        lines = (folder / "f300.csv").read_text().splitlines()
        lines[line - 1] = text
        (folder / "f300.csv").write_text("\n".join(lines) + "\n")

    return spoil


def replace_file(content: bytes) -> Spoil:
    return lambda folder: (folder / "f300.csv").write_bytes(content) and None


def single_force(folder: Path) -> None:
    campaign = lb.read_campaign(folder).select(["f300"])
    shutil.rmtree(folder)
    lb.write_campaign(campaign, folder)


CASES: dict[str, tuple[Spoil, list[str], tuple[str, ...]]] = {
    "missing column": (cell(1, "angle_deg"), [], ("f300.csv, line 1", "the header must name every column")),
    "extra column": (cell(1, "angle_deg,reading_um,volts"), [], ("f300.csv", "line 1", "'volts'", "Rename or remove")),
    "misspelt column": (cell(1, "angle_deg,readng_um"), [], ("f300.csv, line 1", "Did you mean 'reading_um'")),
    "wrong unit suffix": (
        cell(1, "angle_deg,reading_mil"),
        [],
        ("f300.csv, line 1", "'reading_mil'", "Did you mean 'reading_um'"),
    ),
    "both units": (cell(1, "reading_mm,reading_um"), [], ("f300.csv", "angle_deg or angle_rad, got neither")),
    "not a number": (cell(5, "27.0,nan"), [], ("f300.csv, line 5", "reading_um must be a finite number, got 'nan'", "Correct")),
    "empty cell": (cell(5, "27.0,"), [], ("f300.csv, line 5", "got ''")),
    "infinity": (cell(5, "27.0,inf"), [], ("f300.csv, line 5", "got 'inf'")),
    "text cell": (cell(9, "x,1.0"), [], ("f300.csv, line 9", "angle_deg must be a finite number, got 'x'")),
    "too many cells": (cell(9, "1.0,1.0,1.0"), [], ("f300.csv", "line 9")),
    "force zero": (edit("campaign.toml", "force_N = 300.0", "force_N = 0.0"), [], ("f300.csv", "force_N > 0")),
    "force negative": (
        edit("campaign.toml", "force_N = 300.0", "force_N = -300.0"),
        [],
        ("f300.csv", "force_N > 0 N, got -300.0"),
    ),
    "force not a number": (edit("campaign.toml", "force_N = 300.0", "force_N = nan"), [], ("f300.csv", "force_N > 0 N, got nan")),
    "few readings": (rows("angle_deg,reading_um", np.arange(8) * 45.0), [], ("f300.csv", "at least 9 readings, got 8")),
    "short arc": (rows("angle_deg,reading_um", np.arange(40) * 4.0), [], ("f300.csv", "arc of at least 180°, got 156°")),
    "degrees named radians": (
        rows("angle_rad,reading_um", np.arange(60) * 6.0),
        [],
        ("f300.csv", "angle_rad must span", "angle_deg"),
    ),
    "radians named degrees": (rows("angle_deg,reading_um", np.arange(60) * 0.1), [], ("f300.csv", "more than 7°", "angle_rad")),
    "duplicate names": (
        edit("campaign.toml", 'name = "f520"', 'name = "f300"'),
        [],
        ("campaign.toml", "test names must differ, got 'f300' twice"),
    ),
    "file outside": (edit("campaign.toml", '"f300.csv"', '"../f300.csv"'), [], ("campaign.toml, test 2", "must lie inside")),
    "absolute path": (edit("campaign.toml", '"f300.csv"', '"/etc/hostname"'), [], ("campaign.toml, test 2", "must lie inside")),
    "file missing": (
        edit("campaign.toml", '"f300.csv"', '"f301.csv"'),
        [],
        ("campaign.toml, test 2", "must exist, got 'f301.csv'"),
    ),
    "empty file": (replace_file(b""), [], ("f300.csv", "got an empty file")),
    "binary file": (replace_file(bytes(range(256))), [], ("f300.csv", "binary data")),
    "unknown key": (edit("campaign.toml", "radius_mm", "radus_mm"), [], ("campaign.toml", "Did you mean 'radius_mm'")),
    "unknown key in a test": (
        edit("campaign.toml", "force_N = 300.0", "forceN = 300.0"),
        [],
        ("[test 2]", "Did you mean 'force_N'"),
    ),
    "future schema": (
        edit("campaign.toml", "schema = 1", "schema = 9"),
        [],
        ("campaign.toml", "schema must be 1, got 9", "Upgrade"),
    ),
    "broken TOML": (edit("campaign.toml", "[[test]]", "[[test"), [], ("campaign.toml", "valid TOML", "line")),
    "no such plane": (edit("campaign.toml", '"XY"', '"XW"'), [], ("campaign.toml", "'plane'", "got 'XW'")),
    "no such direction": (
        edit("campaign.toml", "force_N = 300.0", 'force_N = 300.0\ndirection = "left"'),
        [],
        ("campaign.toml", "'direction' in [test 2]", "got 'left'"),
    ),
    "no such topology": (
        edit("campaign.toml", "wCAFYXZSt", "wCAFZSt"),
        [],
        ("campaign.toml", "topology must hold the axes", "wCAFZSt"),
    ),
    "topology nonsense": (edit("campaign.toml", "wCAFYXZSt", "machine"), [], ("campaign.toml", "w…F…t")),
    "one force, linear": (single_force, [], ("at least two force levels", "--degree 0")),
    "one force, flat priors": (single_force, ["--preset", "paper", "--degree", "0"], ("flat priors must have", "another force")),
    "existing result": (lambda _: None, ["EXISTING"], ("must not exist", "--force")),
}


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lb.write_campaign(simulated(plan()), tmp_path_factory.mktemp("good") / "c")


def failing(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as left:
        app(arguments)
    shown = capsys.readouterr()
    assert left.value.code == 2
    assert shown.out == ""
    assert shown.err.count("\n") == 1, shown.err
    assert shown.err.startswith("ldbb-bayes: ")
    assert "Traceback" not in shown.err
    return shown.err


@pytest.mark.parametrize("case", CASES)
def test_fit_refuses(case: str, good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spoil, options, expected = CASES[case]
    folder, out = tmp_path / "c", tmp_path / "out"
    shutil.copytree(good, folder)
    spoil(folder)
    if options == ["EXISTING"]:
        options = []
        out.mkdir()
        (out / "mine.txt").write_text("keep me")
    before = sorted(tmp_path.rglob("*"))
    message = failing(["fit", str(folder), "--out", str(out), *options], capsys)
    for part in expected:
        assert part in message, message
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("case", ["text cell", "unknown key", "file outside", "binary file"])
def test_check_and_simulate_refuse_alike(case: str, good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spoil, _, expected = CASES[case]
    folder = tmp_path / "c"
    shutil.copytree(good, folder)
    spoil(folder)
    for command in (["check", str(folder)], ["simulate", str(folder), "--out", str(tmp_path / "out")]):
        message = failing(command, capsys)
        for part in expected:
            assert part in message
    assert not (tmp_path / "out").exists()


def test_one_force_with_proper_priors_is_warned_of() -> None:
    one = simulated(plan((40,), forces_N=(300.0,)))
    tree = lb.sample(lb.HybridModel.default(0), one, rule=lb.StoppingRule(ess=100.0, rhat=1.5, lengths=0.2))
    warnings = record_of(tree)["fit"]["warnings"]
    assert "One force level: constant compliance and geometry are told apart by their priors alone." in warnings


def test_no_permission(good: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def denied(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(tempfile, "mkdtemp", denied)
    message = failing(["fit", str(good), "--out", str(tmp_path / "out")], capsys)
    assert "out must be writable, got: Permission denied. Choose another place." in message
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("existing", [False, True])
def test_disk_full(
    existing: bool, good: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    if existing:
        out.mkdir()
        (out / "summary.json").write_text("old")

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("xarray.DataTree.to_netcdf", full)
    message = failing(["fit", str(good), "--degree", "0", "--max-steps", "200", "--out", str(out), "--force", "--quiet"], capsys)
    assert "No space left on device" in message
    kept = {"out.checkpoint", "block-00000.npz"}
    found = {p.name for p in tmp_path.rglob("*")}
    assert found >= kept, "the run itself is not lost: --resume writes its result"
    assert found - kept - {f"block-{n:05d}.npz" for n in range(20)} == ({"out", "summary.json"} if existing else set())


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("schema = 1\n", "'forces_N' must be given"),
        ("schema = 1\nforces_N = [100.0, 300.0]\n[parameters]\nC_XXZ = 1.0\n", "parameter must be one of"),
        ("schema = 1\nforces_N = [100.0, -5.0]\n", "force_N > 0"),
        ("schema = 1\nforces_N = [100.0, 300.0]\n[hyper_um]\nsigma = -1.0\n", "hyper-parameter sigma must be"),
        ("schema = 1\nforce_N = [100.0]\n", "Did you mean 'forces_N'"),
        ("schema = 1\nforces_N = 'all'\n", "'forces_N' must be valid"),
    ],
)
def test_bad_truths(content: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "truths.toml").write_text(content)
    assert message in failing(["simulate", str(tmp_path / "truths.toml"), "--out", str(tmp_path / "c")], capsys)
    assert not (tmp_path / "c").exists()
