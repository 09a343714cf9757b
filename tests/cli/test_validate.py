"""``ldbb-bayes validate``: files, JSON, exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from campaigns import plan

import ldbb_bayes as lb
from ldbb_bayes.cli.main import app
from ldbb_bayes.model.spec import model_to_toml


def invoke(*arguments: object) -> int:
    with pytest.raises(SystemExit) as left:
        app([str(argument) for argument in arguments])
    return int(left.value.code or 0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lb.write_campaign(plan((40, 40, 40)[:3], forces_N=(36.0, 400.0, 742.0)), tmp_path_factory.mktemp("plan") / "p")


def test_files_and_json(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "v"
    common = ("validate", folder, "--degree", 0, "--replicates", 12, "--draws", 19, "--seed", 3, "--workers", 1, "--quiet")
    assert invoke(*common, "--json", "--out", out) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["calibrated"]
    assert record["replicates"] == 12
    assert set(record["quantities"]["C_XXX"]) == {"inside_band", "largest_difference", "coverage"}
    assert sorted(path.name for path in out.iterdir()) == ["rank_ecdf.png", "rank_ecdf.svg", "ranks.csv", "validation.json"]
    assert json.loads((out / "validation.json").read_text()) == record
    ranks = pd.read_csv(out / "ranks.csv", index_col="replicate")
    assert ranks.shape == (12, 18)
    assert np.all((ranks >= 0) & (ranks <= 19))
    assert invoke(*common, "--out", out) == 2
    assert "must not exist" in capsys.readouterr().err
    assert invoke(*common) == 0
    shown = capsys.readouterr().out
    assert "in 95 % interval" in shown
    assert "Calibrated as far as 12 replicates, 18 quantities, 99 % band can tell." in shown


def test_a_wrong_model_is_exit_code_1(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "truth.toml").write_text(model_to_toml(lb.HybridModel.default(0)))
    arguments = ("--degree", 0, "--without", "discrepancy,ball-form", "--data-model", tmp_path / "truth.toml", "--draws", 49)
    assert invoke("validate", folder, *arguments, "--replicates", 40, "--workers", 1, "--quiet") == 1
    assert "NOT CALIBRATED" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--preset", "paper", "--degree", 0], "validation must start from proper priors"),
        (["--replicates", 2], "replicates must be at least 10, got 2"),
        (["--sampler", "nuts"], "sampler must be one of joint, collapsed, quadrature"),
        (["--data-model", "nowhere.toml"], "nowhere.toml"),
        (["--executor", "dusk"], "--executor must be one of process, dask, got 'dusk'. Did you mean 'dask'?"),
        (["--scheduler", "tcp://a:1"], "--scheduler must go with --executor dask"),
        (
            ["--executor", "dask", "--scheduler", "nonsense", "--workers", 0],
            "--scheduler must be the address of a Dask scheduler",
        ),
    ],
)
def test_bad_input(folder: Path, arguments: list[object], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke("validate", folder, *(["--workers", 1] if "--workers" not in arguments else []), *arguments) == 2
    shown = capsys.readouterr()
    assert message in shown.err
    assert shown.out == ""
