"""``ldbb-bayes identify``: on a campaign, on a plan, as JSON, into a folder."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from campaigns import plan

import ldbb_bayes as lb
from ldbb_bayes.cli.identify import IDENTIFY_FILES
from ldbb_bayes.cli.main import app


def invoke(*arguments: object) -> int:
    with pytest.raises(SystemExit) as left:
        app([str(argument) for argument in arguments])
    return int(left.value.code or 0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lb.write_campaign(plan(), tmp_path_factory.mktemp("plan") / "p")


def test_a_plan_will_do(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "i"
    assert invoke("identify", folder, "--degree", 0, "--json", "--out", out) == 0
    record = json.loads(capsys.readouterr().out)
    entry = record["parameters"]["E_XX1"]
    assert (entry["verdict"], entry["with"][0]) == ("aliased", "BarLength")
    assert 0.0 < entry["confounding"]["BarLength"] <= 1.0
    assert sum(entry["shapley"].values()) == pytest.approx(1.0, abs=1e-9)
    assert set(record["degeneracies"][0]) == {"combination", "statement", "cure", "modelled"}
    assert 0.0 < record["effective_parameters"] < 13.0
    assert not record["measured"]
    assert sorted(path.name for path in out.iterdir()) == sorted(
        name for name in IDENTIFY_FILES if not name.split(".")[0].endswith(("_XY", "_YZ", "_ZX"))
    )
    assert json.loads((out / "identify.json").read_text()) == record
    alias = pd.read_csv(out / "alias.csv", index_col="parameter")
    assert np.isfinite(alias.to_numpy()).all()
    assert invoke("identify", folder, "--out", out) == 2
    assert "must not exist" in capsys.readouterr().err


def test_what_it_says(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke("identify", folder) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "prior median; no readings" in shown
    assert "1.00 µm of bar length looks exactly like +6.67 µm/m of E_XX1 and +6.67 µm/m of E_YY1." in shown
    assert "What would: A calibration of the bar's length." in shown


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere"], "nowhere"),
        (["--degree", 7], "degree"),
        (["--without", "balls"], "must be one of"),
    ],
)
def test_wrong_input(folder: Path, arguments: list[object], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    where = [] if arguments[0] == "nowhere" else [folder]
    assert invoke("identify", *where, *arguments) == 2
    assert message in capsys.readouterr().err
