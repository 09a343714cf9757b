"""Every kind of bad input: exit code 2, one message that names the place and the cure, nothing
written, nothing lost.

Which files of a campaign are refused, and how, is held by tests/campaign; here that a command says
it and leaves no trace.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from campaigns import Invoke, cases

import ldbb_bayes as lb


def refused(invoke: Invoke, *arguments: object) -> str:
    code, out, err = invoke(*arguments)
    assert (code, out) == (2, ""), err
    (line,) = err.splitlines()
    assert line.startswith("ldbb-bayes: ")
    return line


def test_a_misspelt_column(folder: Path, tmp_path: Path, invoke: Invoke) -> None:
    shutil.copytree(folder, tmp_path / "c")
    spoiled = tmp_path / "c" / "f300.csv"
    spoiled.write_text(
        spoiled.read_text().replace("angle_deg,reading_um", "angle_deg,readng_um", 1)
    )
    paths = sorted(tmp_path.rglob("*"))
    message = refused(invoke, "fit", tmp_path / "c", "--out", tmp_path / "out")
    assert "f300.csv" in message
    assert "line 1: columns must be among" in message
    assert sorted(tmp_path.rglob("*")) == paths


def changed(folder: Path, target: Path, text: str, other: str) -> Path:
    """Copy a campaign, and replace a text in its campaign.toml."""
    shutil.copytree(folder, target)
    toml = target / "campaign.toml"
    content = toml.read_text(encoding="utf-8")
    toml.write_text(content.replace(text, other, 1), encoding="utf-8")
    return target


@pytest.mark.parametrize("command", ["check", "fit"])
def test_a_tolerance_that_cannot_be_used(
    command: str, folder: Path, tmp_path: Path, invoke: Invoke
) -> None:
    stated = '[tolerance]\nC_XXX = "60"\n\n[[test]]'
    message = refused(invoke, command, changed(folder, tmp_path / "c", "[[test]]", stated))
    assert (
        "campaign.toml, [tolerance]: tolerance of C_XXX must be a number with its unit" in message
    )


def test_a_mount_that_yields_too_much_names_the_key_that_was_written(
    folder: Path, tmp_path: Path, invoke: Invoke
) -> None:
    campaign = changed(
        folder, tmp_path / "c", "deflection_um_per_bar = 2.33", "stiffness_N_per_um = 0.05"
    )
    message = refused(invoke, "check", campaign)
    assert "campaign.toml: stiffness_N_per_um of [mount]: " in message


def test_a_workbook_is_to_be_imported(tmp_path: Path, invoke: Invoke) -> None:
    book = tmp_path / "mine.xlsx"
    book.write_bytes(b"PK\x03\x04" + bytes(range(256)))
    assert f"got a workbook. Import it: ldbb-bayes import {book} --out FOLDER." in refused(
        invoke, "fit", book
    )


def test_one_force(folder: Path, tmp_path: Path, invoke: Invoke) -> None:
    one = lb.write_campaign(lb.read_campaign(folder).select(["f300"]), tmp_path / "c")
    assert "--degree 0" in refused(invoke, "fit", one)
    assert "flat priors must have" in refused(
        invoke, "fit", one, "--preset", "paper", "--degree", 0
    )


# What a library call refuses is held where its tests are; here what a command line alone can get
# wrong, and that options arrive.
COMMANDS: dict[str, list[list[str]]] = cases(__file__, "refusals.toml")


CASES: dict[str, str] = {}
for command, refusals in COMMANDS.items():
    for words, message in refusals:
        CASES[f"{command} {words}"] = message


@pytest.mark.parametrize("case", CASES)
def test_options_that_cannot_be_are_refused(
    case: str,
    folder: Path,
    planned: Path,
    tmp_path: Path,
    invoke: Invoke,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    folders = {"CAMPAIGN": str(folder), "PLAN": str(planned)}
    arguments = []
    for word in case.split():
        name, slash, rest = word.partition("/")
        arguments.append(f"{folders[name]}{slash}{rest}" if name in folders else word)
    assert CASES[case] in refused(invoke, *arguments)
    assert list(tmp_path.iterdir()) == []


def test_force_replaces_results_and_nothing_else(
    folder: Path, tmp_path: Path, invoke: Invoke
) -> None:
    """Somebody's readings, a campaign, and the folder one stands in are never deleted."""
    precious = tmp_path / "stuff"
    campaign = tmp_path / "c"
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


@pytest.mark.parametrize(("content", "message"), cases(__file__, "truths.toml")["refused"])
def test_bad_truths(content: str, message: str, tmp_path: Path, invoke: Invoke) -> None:
    (tmp_path / "truths.toml").write_text(content)
    assert message in refused(invoke, "simulate", tmp_path / "truths.toml", "--out", tmp_path / "c")
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize(("typed", "right"), [("preview", "check"), ("calibrate", "validate")])
def test_names_of_python_are_answered_with_the_command(
    typed: str, right: str, invoke: Invoke
) -> None:
    line = refused(invoke, typed, "x")
    assert line == f"ldbb-bayes: No such command '{typed}'. Type ldbb-bayes {right}."
