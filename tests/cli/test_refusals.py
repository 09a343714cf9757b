"""Every kind of bad input: exit code 2, one message that names the place and the cure, nothing written, nothing lost."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from campaigns import Invoke

import ldbb_bayes as lb

Spoil = Callable[[Path], None]


def toml(old: str, new: str) -> Spoil:
    def spoil(folder: Path) -> None:
        text = (folder / "campaign.toml").read_text()
        assert old in text, f"{old!r} not in campaign.toml"
        (folder / "campaign.toml").write_text(text.replace(old, new, 1))

    return spoil


def table(header: str, angles: np.ndarray) -> Spoil:
    lines = [f"{float(angle)!r},{0.1 * i}" for i, angle in enumerate(angles)]
    return raw("\n".join([header, *lines, ""]).encode())


def cell(line: int, text: str) -> Spoil:
    def spoil(folder: Path) -> None:
        lines = (folder / "f300.csv").read_text().splitlines()
        lines[line - 1] = text
        (folder / "f300.csv").write_text("\n".join(lines) + "\n")

    return spoil


def raw(content: bytes) -> Spoil:
    return lambda folder: (folder / "f300.csv").write_bytes(content) and None


def single_force(folder: Path) -> None:
    campaign = lb.read_campaign(folder).select(["f300"])
    shutil.rmtree(folder)
    lb.write_campaign(campaign, folder)


FORCE, FILE = "force_N = 300.0", '"f300.csv"'
DEG, RAD = "angle_deg,reading_um", "angle_rad,reading_um"
# What is spoiled, and the parts of the message; of the last also options.
CASES: dict[str, tuple[Spoil, str]] = {
    "missing column": (cell(1, "angle_deg"), "f300.csv, line 1 … the header must name every column"),
    "extra column": (cell(1, "angle_deg,reading_um,volts"), "f300.csv … line 1 … 'volts' … Rename or remove"),
    "misspelt column": (cell(1, "angle_deg,readng_um"), "f300.csv, line 1 … Did you mean 'reading_um'"),
    "wrong unit suffix": (cell(1, "angle_deg,reading_mil"), "f300.csv, line 1 … 'reading_mil' … Did you mean 'reading_um'"),
    "both units": (cell(1, "reading_mm,reading_um"), "f300.csv … angle_deg or angle_rad, got neither"),
    "not a number": (cell(5, "27.0,nan"), "f300.csv, line 5 … reading_um must be a finite number, got 'nan' … Correct"),
    "empty cell": (cell(5, "27.0,"), "f300.csv, line 5 … got ''"),
    "infinity": (cell(5, "27.0,inf"), "f300.csv, line 5 … got 'inf'"),
    "text cell": (cell(9, "x,1.0"), "f300.csv, line 9 … angle_deg must be a finite number, got 'x'"),
    "too many cells": (cell(9, "1.0,1.0,1.0"), "f300.csv … line 9"),
    "force zero": (toml(FORCE, "force_N = 0.0"), "f300.csv … force_N > 0"),
    "force negative": (toml(FORCE, "force_N = -300.0"), "f300.csv … force_N > 0 N, got -300.0"),
    "force not a number": (toml(FORCE, "force_N = nan"), "f300.csv … force_N > 0 N, got nan"),
    "few readings": (table(DEG, np.arange(8) * 45.0), "f300.csv … at least 9 readings, got 8"),
    "short arc": (table(DEG, np.arange(40) * 4.0), "f300.csv … arc of at least 180°, got 156°"),
    "degrees named radians": (table(RAD, np.arange(60) * 6.0), "f300.csv … angle_rad must span … angle_deg"),
    "radians named degrees": (table(DEG, np.arange(60) * 0.1), "f300.csv … more than 7° … angle_rad"),
    "duplicate names": (toml('name = "f520"', 'name = "f300"'), "campaign.toml … test names must differ, got 'f300' twice"),
    "file outside": (toml(FILE, '"../f300.csv"'), "campaign.toml, test 2 … must lie inside"),
    "absolute path": (toml(FILE, '"/etc/hostname"'), "campaign.toml, test 2 … must lie inside"),
    "file missing": (toml(FILE, '"f301.csv"'), "campaign.toml, test 2 … must exist, got 'f301.csv'"),
    "empty file": (raw(b""), "f300.csv … got an empty file"),
    "binary file": (raw(bytes(range(256))), "f300.csv, line 2 … text must be utf-8, got other bytes"),
    "unknown key": (toml("radius_mm", "radus_mm"), "campaign.toml … Did you mean 'radius_mm'"),
    "unknown key in a test": (toml(FORCE, "forceN = 300.0"), "[test 2] … Did you mean 'force_N'"),
    "future schema": (toml("schema = 1", "schema = 9"), "campaign.toml … schema must be 1, got 9 … Upgrade"),
    "broken TOML": (toml("[[test]]", "[[test"), "campaign.toml … valid TOML … line"),
    "no such plane": (toml('"XY"', '"XW"'), "campaign.toml … 'plane' … got 'XW'"),
    "no such direction": (toml(FORCE, f'{FORCE}\ndirection = "left"'), "campaign.toml … 'direction' in [test 2] … got 'left'"),
    "no such topology": (toml("wCAFYXZSt", "wCAFZSt"), "campaign.toml … topology must hold the axes … wCAFZSt"),
    "topology nonsense": (toml("wCAFYXZSt", "machine"), "campaign.toml … w…F…t"),
    "one force": (single_force, "at least two force levels … --degree 0"),
    "one force --preset paper --degree 0": (single_force, "flat priors must have … another force"),
}


def refused(invoke: Invoke, *arguments: object) -> str:
    code, out, err = invoke(*arguments)
    assert (code, out) == (2, ""), err
    assert "Traceback" not in err
    return " ".join(err.replace("│", " ").split())


@pytest.mark.parametrize("case", CASES)
def test_campaigns(case: str, folder: Path, tmp_path: Path, invoke: Invoke) -> None:
    spoil, expected = CASES[case]
    shutil.copytree(folder, tmp_path / "c")
    spoil(tmp_path / "c")
    before = sorted(tmp_path.rglob("*"))
    options = case.split()[2:] if "--" in case else []
    message = refused(invoke, "fit", tmp_path / "c", "--out", tmp_path / "out", *options)
    assert [part for part in expected.split(" … ") if part not in message] == [], message
    assert sorted(tmp_path.rglob("*")) == before


# Beside those of the golden `refusals`.
COMMANDS: dict[str, list[tuple[str, str]]] = {
    "fit": [
        ("CAMPAIGN --without balls", "Did you mean 'ball-form'"),
        ("CAMPAIGN --sampler quadrature", "It is now called 'independent'"),
        ("CAMPAIGN --model none.toml", "readable TOML file"),
        ("CAMPAIGN --radius-mm 100", "--radius-mm must come with a tidy CSV"),
        ("CAMPAIGN --nonsense", "No such option"),
        ("CAMPAIGN --out /proc/nothing/r", "must be writable"),
        ("CAMPAIGN --prior-from CAMPAIGN", "population.json must be a population's result, got nothing. Check the path."),
        ("", "Missing argument"),
    ],
    "summarize": [("nowhere", "result must be a folder with posterior.nc")],
    "identify": [("nowhere", "nowhere"), ("CAMPAIGN --degree 7", "degree"), ("CAMPAIGN --without balls", "must be one of")],
    "compare": [
        ("CAMPAIGN --degree 0", "compare must have a degree of at least 1, got 0"),
        ("CAMPAIGN --preset paper", "must have a proper prior to have an evidence"),
        ("CAMPAIGN --leave-out circle", "leave_out must be 'test', got 'circle': every test is left out in turn"),
        ("CAMPAIGN --tolerance inf", "tolerance must lie between"),
        ("CAMPAIGN --tolerance -1", "tolerance must lie between 0.0001 and 1 nats"),
        ("CAMPAIGN --ci 2", "ci_prob must lie between 0 and 1"),
        ("CAMPAIGN --also nothing", "--also must be NAME=FILE.toml, got 'nothing'"),
        ("CAMPAIGN --also mine=nowhere.toml", "nowhere.toml must be a readable TOML file"),
        ("CAMPAIGN --also linear=x.toml", "--also must give a new name, got 'linear' again"),
        ("CAMPAIGN --radius-mm 100", "--radius-mm must come with a tidy CSV"),
    ],
    "design": [
        ("CAMPAIGN --tests 0", "tests must be between 1 and 300, got 0"),
        ("CAMPAIGN --tests 4 --budget 9", "must have one goal, got tests and budget"),
        ("CAMPAIGN --forces 742:36:1", "--forces must be LO:HI:STEP with LO ≤ HI and STEP > 0, or a list, got '742:36:1'"),
        ("CAMPAIGN --forces 36:742", "--forces must be LO:HI:STEP"),
        ("CAMPAIGN --forces 36:742:1e-6", "--forces must give at most 5000 values"),
        ("CAMPAIGN --forces 36,x", "--forces must be made of numbers, got 'x'"),
        ("CAMPAIGN --forces -5,100", "forces must be > 0 N, got -5"),
        ("CAMPAIGN --clockings 0/45/90", "must be all angles of the work ball, or all WORK/TOOL, got '0/45/90'"),
        ("CAMPAIGN --clockings 0,45/90", "must be all angles of the work ball, or all WORK/TOOL, got '0,45/90'"),
        ("CAMPAIGN --target C_XYX=1e-6 --target C_XYX=1e-7", "--target must give each name once, got 'C_XYX' again"),
        ("CAMPAIGN --radii nan", "--radii must be made of numbers, got 'nan'"),
        ("CAMPAIGN --criterion best", "criterion must be one of eig, d, a, c, i, e, discriminate, got 'best'"),
        ("CAMPAIGN --target C_XYX", "--target must be NAME=SD, got 'C_XYX'"),
        ("CAMPAIGN --target C_XYX=small", "--target must be made of numbers, got 'small'"),
        ("CAMPAIGN --against nowhere", "--against must be NAME=PATH, got 'nowhere'"),
        ("CAMPAIGN --against it=nowhere", "nowhere, which does not exist"),
        ("CAMPAIGN --cost-circle 0", "cost of circle must be a number ≥ 0, that of a circle > 0, got 0"),
        ("CAMPAIGN --power 1.5", "power must lie between 0 and 1, got 1.5"),
        ("CAMPAIGN --threshold -1", "threshold must be a positive number, got -1"),
        ("CAMPAIGN --degree 0 --criterion discriminate", "criterion discriminate must be about slopes"),
    ],
    "validate": [
        ("PLAN --preset paper --degree 0", "validation must start from proper priors"),
        ("PLAN --sampler nuts", "sampler must be one of joint, independent"),
        ("PLAN --data-model nowhere.toml", "nowhere.toml"),
        ("PLAN --executor dusk", "--executor must be one of process, dask, got 'dusk'. Did you mean 'dask'?"),
        ("PLAN --scheduler tcp://a:1", "--scheduler must go with --executor dask"),
    ],
    "machine": [
        ("wCAFYXZSt --plane XZ", "plane must be one of XY, YZ, ZX, got 'XZ'. Did you mean 'ZX'"),
        ("YXZ", "topology must read w…F…t"),
        ("wFYXt --plane YZ", "got 'wFYXt' without Z"),
        ("wFYXZt --frame Y=1,2", "--frame must hold three finite numbers X,Y,Z in mm, got '1,2'"),
        ("wFYXZt --frame Y", "--frame must be AXIS=X,Y,Z, got 'Y'"),
        ("wFYXZt --frame Y=1,2,3 --frame Y=1,2,3", "--frame must give each name once, got 'Y' again"),
        ("wFYXZt --frame Q=1,2,3", "frames_mm must name linear axes of 'wFYXZt', got 'Q'"),
        ("wFYXZt --frame Y=1,2,nan", "three finite numbers"),
        ("wFYXZt --centre a,b,c", "--centre must hold three finite numbers"),
    ],
    "report": [("nowhere", "must be a folder with posterior.nc"), ("CAMPAIGN", "must be a folder with posterior.nc")],
    "population": [("nowhere", "must be the --out folder of a batch")],
}


@pytest.mark.parametrize(
    ("command", "arguments", "message"),
    [(command, *case) for command, cases in COMMANDS.items() for case in cases],
    ids=[f"{command} {arguments}" for command, cases in COMMANDS.items() for arguments, _ in cases],
)
def test_options(
    command: str,
    arguments: str,
    message: str,
    folder: Path,
    planned: Path,
    tmp_path: Path,
    invoke: Invoke,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    given = [{"CAMPAIGN": str(folder), "PLAN": str(planned)}.get(own, own) for own in arguments.split()]
    assert message in refused(invoke, command, *given)
    assert list(tmp_path.iterdir()) == []


def test_force_replaces_results_and_nothing_else(folder: Path, tmp_path: Path, invoke: Invoke) -> None:
    """Somebody's readings, a campaign, and the folder one stands in are never deleted."""
    precious, campaign = tmp_path / "stuff", tmp_path / "c"
    precious.mkdir()
    (precious / "my_readings.csv").write_text("mine")
    lb.write_campaign(lb.read_campaign(folder), campaign)
    (tmp_path / "result").mkdir()
    (tmp_path / "result" / "posterior.nc").write_text("old")
    assert "must not exist" in refused(invoke, "fit", folder, "--out", precious)
    for arguments, message in (
        (("fit", folder, "--out", precious), "got 'my_readings.csv'. Move it away"),
        (("fit", campaign, "--out", campaign), "nothing but earlier results to be replaced"),
        (("demo", "--out", precious), "got 'my_readings.csv'"),
        (("simulate", folder, "--out", tmp_path / "result"), "got 'posterior.nc'"),
        (("fit", folder, "--out", "."), "must not be the folder you stand in"),
    ):
        assert message in refused(invoke, *arguments, "--force")
    assert (precious / "my_readings.csv").read_text() == "mine"
    assert lb.read_campaign(campaign).sha256 == lb.read_campaign(folder).sha256
    assert invoke("simulate", folder, "--out", campaign, "--force")[0] == 0


def test_no_permission(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, invoke: Invoke) -> None:
    def denied(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(tempfile, "mkdtemp", denied)
    message = refused(invoke, "fit", folder, "--out", tmp_path / "out")
    assert "out must be writable, got: Permission denied. Choose another place." in message
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("existing", [False, True])
def test_disk_full(existing: bool, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, invoke: Invoke) -> None:
    out = tmp_path / "out"
    if existing:
        out.mkdir()
        (out / "summary.json").write_text("old")

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("xarray.DataTree.to_netcdf", full)
    fit = ("fit", folder, "--degree", "0", "--sampler", "independent", "--out", out, "--force")
    assert "No space left on device" in refused(invoke, *fit)
    assert {p.name for p in tmp_path.rglob("*")} == ({"out", "summary.json"} if existing else set())


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
def test_bad_truths(content: str, message: str, tmp_path: Path, invoke: Invoke) -> None:
    (tmp_path / "truths.toml").write_text(content)
    assert message in refused(invoke, "simulate", tmp_path / "truths.toml", "--out", tmp_path / "c")
    assert not (tmp_path / "c").exists()
