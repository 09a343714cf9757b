"""The command population on real campaigns: simulated, fitted by batch, pooled; on rows that are made up; and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from batches import CONSTANT
from campaigns import TRUTH, plan
from typer.testing import CliRunner

import ldbb_bayes as lb
from ldbb_bayes.cli.main import app
from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.population_prior import digest_of
from ldbb_bayes.model.specification import model_to_toml
from ldbb_bayes.report.wording import population_doubts

pytest.importorskip("pyarrow")
MEAN, SPREAD, STIFF = 5e-5, 4e-6, 1.2e-4


def invoke(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, ["population", *map(str, arguments)], env={"COLUMNS": "200"})
    return done.exit_code, done.stdout, done.stderr


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six machines, the first of another kind and the last measured twice; one campaign names no machine, one is not there."""
    folder = tmp_path_factory.mktemp("shop")
    rng = np.random.default_rng(1)
    paths = []
    truths = [STIFF, *(MEAN + SPREAD * rng.standard_normal(5))]
    for k in range(7):
        machine = min(k, 5)
        truth = {**TRUTH, "C_XXX": truths[machine]}
        planned = plan((60,) * 3, forces_N=(36.0, 400.0, 742.0))
        campaign = CONSTANT.simulate(planned, seed=k + 1, parameters=truth, hyper_um={"sigma": 0.3, "tau": 2.0}).campaign
        named = replace(campaign, machine_id=None if k == 4 else f"M{machine}")
        paths.append(lb.write_campaign(named, folder / f"c{k}"))
    (folder / "model.toml").write_text(model_to_toml(CONSTANT), encoding="utf-8")
    arguments = ["batch", *map(str, paths), str(folder / "c9"), "--out", str(folder / "b"), "--workers", "1", "--no-compare"]
    done = CliRunner().invoke(app, [*arguments, "--model", str(folder / "model.toml"), "--ess", "200", "--quiet"])
    assert (folder / "b" / "campaigns.parquet").is_file(), done.output
    return folder / "b"


def test_from_campaigns_to_a_population(rows: Path, tmp_path: Path) -> None:
    out = tmp_path / "p"
    code, stdout, stderr = invoke(rows, "--out", out, "--parameters", "C_XXX,C_YYY,E_XX1", "--json")
    assert code == 0, stderr
    record = json.loads(stdout)
    assert sorted(path.name for path in out.iterdir()) == ["machines.csv", "machines.png", "machines.svg", "population.json"]
    assert json.loads((out / "population.json").read_text()) == record
    assert record["sha256"] == digest_of(record)
    assert (record["schema"], record["kind"], record["machines"], record["campaigns"]) == (1, "population", 6, 7)
    assert (record["topology"], record["forces_N"], record["reference_force_N"]) == ("wCAFYXZSt", [36.0, 742.0], 389.0)
    assert list(record["next"]) == ["C_XXX", "C_YYY"]
    assert record["machine"]["M5"]["campaigns"] == 2
    assert record["not_belonging"] == ["M0"]
    worst = record["machine"]["M0"]["parameters"]
    assert max(worst, key=lambda name: abs(worst[name]["z"])) == "C_XXX"
    own = record["machine"]["M0"]["estimate"]["C_XXX"]
    assert abs(own["mean"] - STIFF) < 4.0 * own["sd"]
    doubts = " ".join(record["doubts"])
    assert "Left out, for they could not be fitted: " in doubts
    assert "Naming no machine, each counted as one of its own: " in doubts
    assert "Where the population gives the prior of a campaign with the same bar they are counted again." in doubts
    assert record["readings_sha256"] == lb.read_batch(rows)["sha256"].dropna().tolist()
    again = lb.prior_from(out)
    with pytest.raises(InputError, match="must not be in the population that gives its prior"):
        again.doubts(lb.read_campaign(rows.parent / "c3"))
    other = replace(lb.read_campaign(rows.parent / "c3"), resolution_um=0.25)
    assert any("has campaigns of this machine (M3)" in doubt for doubt in again.doubts(other))
    assert {f"The population says: {doubt}" for doubt in record["doubts"]} <= set(again.doubts(other))
    table = pd.read_csv(out / "machines.csv", index_col="machine")
    assert table.loc["M0", "flag"]
    assert table.loc["M5", "C_XXX.mean"] == pytest.approx(record["machine"]["M5"]["estimate"]["C_XXX"]["mean"])
    code, _, stderr = invoke(rows, "--out", out)
    assert code == 2
    assert "must not exist" in stderr


def test_what_it_prints(rows: Path, tmp_path: Path) -> None:
    code, stdout, stderr = invoke(rows, "--out", tmp_path / "p", "--parameters", "C_XXX", "--own-instruments", "--ci", 0.9)
    assert code == 0, stderr
    shown = " ".join(stdout.split())
    for part in ("C_XXX", "nm/N", "90 %", "next machine", "M0 does not belong with the others: p ", "population.json"):
        assert part in shown
    assert "one bar" not in shown
    assert lb.population(lb.read_batch(rows), parameters=["C_XXX"], one_instrument=False).not_belonging == ("M0",)


def test_flat_campaigns_are_left_out(rows: Path) -> None:
    table = lb.read_batch(rows)
    table.at[2, "gaussian_names"] = None
    table["converged"] = table.index != 3
    table.at[4, "kinds"] = ["noise"]
    table.at[6, "sha256"] = table.at[1, "sha256"]
    found = lb.population(table, parameters=["C_XXX"])
    assert found.campaigns == 5
    said = " ".join(population_doubts(found))
    assert "Left out, for they have no sufficient statistics (flat priors, or a breakdown: see warnings): " in said
    assert "Not converged, refit with more draws: " in said
    assert "Noise that is not white, so that uncertainties may be too small: " in said
    assert "Left out, for their readings are those of campaigns before them: " in said


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--parameters", "C_XX"), "Did you mean 'C_XYX'?"),
        (("--parameters", ""), "parameters must be given once each, got none"),
        (("--spread-scale", 0), "spread_scale must be a finite number above zero, got 0"),
        (("--exclude", "M9"), "must be a campaign or machine of the batch, got 'M9'"),
        (("--since", "last year"), "since must be a date or time in ISO 8601"),
        (("--ci", 95), "ci_prob must lie between 0 and 1"),
        (("--reference-force", "nan"), "reference_force_N must be a finite number"),
    ],
)
def test_what_is_refused(rows: Path, arguments: tuple[object, ...], message: str) -> None:
    code, stdout, stderr = invoke(rows, *arguments)
    assert (code, stdout) == (2, "")
    assert message in stderr
    assert "Traceback" not in stderr


def test_no_batch(tmp_path: Path) -> None:
    code, _, stderr = invoke(tmp_path / "nothing")
    assert code == 2
    assert "must be the --out folder of a batch" in stderr
