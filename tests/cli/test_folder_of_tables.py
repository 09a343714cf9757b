"""A folder of tables, named as a campaign: the message names the command that makes one of it."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from campaigns import Invoke, refuses

import ldbb_bayes as lb
from ldbb_bayes.fleet.gathering import gather


@pytest.fixture
def tables(files: list[Path], tmp_path: Path) -> Path:
    """A folder whose name has a blank, with two tables and a note."""
    folder = tmp_path / "my tests"
    folder.mkdir()
    for file in files:
        file.rename(folder / file.name)
    (folder / "a note.md").write_text("Measured in March.")
    return folder


COMMANDS = [
    "identify",
    "check",
    "compare",
    "design",
    "next",
    "validate",
    "simulate --out out",
    "fit --out out",
    "report --out out",
    "batch --out out",
]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_names_the_import(tables: Path, invoke: Invoke, command: str) -> None:
    name, *options = command.split()
    exit_code, _, message = invoke(name, tables, *options)
    assert exit_code == 2
    assert f"ldbb-bayes import '{tables}'/*.csv --out DIR" in message


def test_the_named_command_works(tables: Path, invoke: Invoke) -> None:
    exit_code, _, message = invoke("identify", tables)
    typed = message.split("with ldbb-bayes ")[1].split(", and name DIR")[0]
    pattern = Path(shlex.split(typed)[1])
    matches = sorted(pattern.parent.glob(pattern.name))
    exit_code, _, message = invoke("import", *matches, "--out", tables.parent / "made", "--yes")
    assert exit_code == 0, message
    assert len(lb.read_campaign(tables.parent / "made").tests) == len(matches)


def test_a_folder_of_campaigns_names_one(tmp_path: Path) -> None:
    (tmp_path / "shop" / "mill").mkdir(parents=True)
    (tmp_path / "shop" / "mill" / "campaign.toml").touch()
    refuses("Name one of the campaigns in it, such as .*mill", lb.read_campaign, tmp_path / "shop")


def test_a_report_on_a_folder_of_campaigns_names_one(tmp_path: Path, invoke: Invoke) -> None:
    (tmp_path / "shop" / "mill").mkdir(parents=True)
    (tmp_path / "shop" / "mill" / "campaign.toml").touch()
    exit_code, _, message = invoke("report", tmp_path / "shop", "--out", tmp_path / "out")
    assert exit_code == 2
    assert f"Name one of the campaigns in it, such as {tmp_path / 'shop' / 'mill'}." in message


def test_a_report_on_an_empty_folder_names_no_command(tmp_path: Path, invoke: Invoke) -> None:
    exit_code, _, message = invoke("report", tmp_path, "--out", tmp_path / "out")
    assert exit_code == 2
    assert message.endswith("got neither. Check the path.\n")


def test_an_empty_folder_names_no_command(tmp_path: Path) -> None:
    refuses("a folder without one. Check the path", lb.read_campaign, tmp_path)
    refuses("a folder without one. Check the path", lb.read_campaign, tmp_path / "campaign.toml")
    refuses("none among 1 .*Name folders with", gather, [tmp_path])
