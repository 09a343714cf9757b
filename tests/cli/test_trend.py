"""``ldbb-bayes trend``: what it prints, what it writes, what it refuses."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from trends import drawn_rows

from ldbb_bayes.cli.main import app
from ldbb_bayes.fleet.trend import detection


def invoke(*arguments: object) -> int:
    with pytest.raises(SystemExit) as left:
        app([str(argument) for argument in arguments])
    return int(left.value.code or 0)


@pytest.fixture
def batch(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A folder whose rows are those of two machines, one of which has a loosened joint."""
    rng = np.random.default_rng(4)
    rows = drawn_rows(6, rng, step_at=4)
    rows = pd.concat([rows, drawn_rows(3, rng).assign(machine_id="M2")], ignore_index=True)
    folder = tmp_path / "batch"

    def read(paths: list[Path], columns: Sequence[str]) -> pd.DataFrame:
        assert paths == [folder]
        return rows[[name for name in columns if name in rows]]

    monkeypatch.setattr("ldbb_bayes.fleet.row.read_batch", read)
    monkeypatch.setattr(import_module("ldbb_bayes.fleet.trend"), "detection", partial(detection, replicates=50, further=3))
    return folder


def test_json_and_files(batch: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    given = ("--machine", "M1", "--out", out, "--seed", 3, "--parameters", "C_XXX, C_YYY", "--detect", "0.3", "--ci", 0.9)
    assert invoke("trend", batch, *given, "--json") == 0
    record = json.loads(capsys.readouterr().out)
    assert (record["schema"], record["machine"], record["changed"]) == (1, "M1", True)
    assert list(record["parameters"]) == ["C_XXX", "C_YYY"]
    assert record["assumptions"]["detect"] == 0.3
    assert (record["assumptions"]["seed"], record["assumptions"]["ci"]) == (3, 0.9)
    assert sorted(path.name for path in out.iterdir()) == ["control_chart.png", "control_chart.svg", "trend.csv", "trend.json"]
    assert json.loads((out / "trend.json").read_text()) == record
    table = pd.read_csv(out / "trend.csv")
    assert len(table) == 12
    assert invoke("trend", batch, *given) == 2
    assert "must not exist" in capsys.readouterr().err
    assert invoke("trend", batch, *given, "--force", "--own-instruments") == 0
    assert "control_chart.png" in capsys.readouterr().out


def test_what_it_says(batch: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke("trend", batch, "--machine", "M1", "--quiet") == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "a change is found" in shown
    assert "+20 % found within" in shown
    assert "One lasting step of one parameter" in shown


def test_what_it_refuses(batch: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, said in (
        ((), "got those of M1, M2. Choose one: --machine M1"),
        (("--machine", "M3"), "machine must be one of M1, M2, got 'M3'"),
        (("--machine", "M1", "--detect", "-1.5"), "not below -1"),
        (("--machine", "M1", "--parameters", "force_gain"), "got 'force_gain'"),
        (("--machine", "M1", "--parameters", ""), "got none"),
    ):
        assert invoke("trend", batch, *arguments) == 2
        assert said in " ".join(capsys.readouterr().err.split())
