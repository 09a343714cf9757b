"""``ldbb-bayes fit --prior-from``: the prior used, its doubts told, what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.cli.main import app
from ldbb_bayes.model.population_prior import digest_of

RESULT = {
    "schema": 1,
    "kind": "population",
    "reference_force_N": 389.0,
    "machines": 4,
    "campaigns": 9,
    "forces_N": [36.0, 742.0],
    "topology": "wCAFYXZSt",
    "next": {"C_XXX": {"unit": "mm/N", "mean": 5.1e-5, "sd": 4e-6}},
}


def invoke(*arguments: object) -> int:
    with pytest.raises(SystemExit) as left:
        app([str(argument) for argument in arguments])
    return int(left.value.code or 0)


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    campaign = simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)), seed=1)
    population = tmp_path / "population"
    population.mkdir()
    (population / "population.json").write_text(json.dumps(RESULT | {"sha256": digest_of(RESULT)}))
    return lb.write_campaign(campaign, tmp_path / "campaign"), population


def test_fit(folders: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    campaign, population = folders
    out = tmp_path / "out"
    fit = ("fit", campaign, "--sampler", "quadrature", "--json")
    assert invoke(*fit, "--prior-from", population, "--out", out) == 0
    said = capsys.readouterr()
    record = json.loads(said.out)
    assert record["prior_from"]["sha256"] == digest_of(RESULT)
    assert (record["prior_from"]["machines"], record["prior_from"]["path"]) == (4, str(population))
    (doubt,) = record["prior_from"]["doubts"]
    assert doubt.startswith("The population has 4 machines, fewer than 6")
    assert f"--prior-from: {doubt}" in said.err
    entry = record["parameters"]["C_XXX"]
    assert (entry["prior_mean"], entry["prior_sd"]) == (5.1e-5, 4e-6)
    assert record["model"]["reference_force_N"] == 389.0
    assert json.loads((out / "summary.json").read_text()) == record
    again = lb.read_model(out / "model.toml")
    assert (dict(again.prior.means), again.reference_force_N) == ({"C_XXX": 5.1e-5}, 389.0)
    capsys.readouterr()
    assert invoke(*fit) == 0
    assert "prior_from" not in json.loads(capsys.readouterr().out)


def test_refusals(folders: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    campaign, population = folders
    assert invoke("fit", campaign, "--prior-from", campaign) == 2
    assert "population.json must be a population's result, got nothing. Check the path." in capsys.readouterr().err
    assert invoke("fit", campaign, "--preset", "paper", "--prior-from", population) == 2
    assert "must have proper priors to take a population's, got flat ones" in capsys.readouterr().err
    other = RESULT | {"topology": "wXFYZt"}
    (population / "population.json").write_text(json.dumps(other | {"sha256": digest_of(other)}))
    assert invoke("fit", campaign, "--prior-from", population) == 2
    assert "topology must be the population's 'wXFYZt' to use its prior, got 'wCAFYXZSt'" in capsys.readouterr().err
