"""The prior of one more machine from a population's result: what it sets, what it doubts, what it refuses."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns import plan

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.population_prior import digest_of, stands_for

RESULT: dict[str, Any] = {
    "schema": 1,
    "kind": "population",
    "reference_force_N": 300.0,
    "machines": 24,
    "campaigns": 60,
    "forces_N": [36.0, 742.0],
    "topology": "wCAFYXZSt",
    "next": {
        "C_XXX": {"unit": "mm/N", "mean": 5.1e-5, "sd": 4e-6},
        "C_XYX": {"unit": "mm/N", "mean": 0.0, "sd": 1e-6},
        "C_CCY": {"unit": "rad/(N mm)", "mean": 4e-10, "sd": 2e-10},
    },
    "more": "of no concern here",
}


def written(folder: Path, **changes: Any) -> Path:
    record = json.loads(json.dumps(RESULT | changes))
    (folder / "population.json").write_text(json.dumps({"sha256": digest_of(record)} | record))
    return folder


def test_sets_means_and_sds_at_the_populations_force(tmp_path: Path) -> None:
    prior = lb.prior_from(written(tmp_path))
    assert prior == lb.prior_from(tmp_path / "population.json")
    assert (prior.machines, prior.campaigns, prior.sha256, prior.forces_N) == (24, 60, digest_of(RESULT), (36.0, 742.0))
    model = lb.HybridModel.default(1)
    found, usual = prior.model(model).bind(plan()), model.bind(plan())
    assert found.setting.reference_force_N == 300.0
    own = {p.name: (p.prior_mean, p.prior_sd) for p in found.parameters}
    for name, entry in RESULT["next"].items():
        assert own[name] == (entry["mean"], entry["sd"])
    others = [i for i, name in enumerate(found.names) if name not in RESULT["next"]]
    np.testing.assert_array_equal(found.prior_sd[others], usual.prior_sd[others])
    assert not found.prior_mean[others].any()
    assert prior.model(replace(model, reference_force_N=300.0)) == prior.model(model)
    assert prior.doubts(plan()) == ()
    assert pickle.loads(pickle.dumps(prior)) == prior


def test_doubts(tmp_path: Path) -> None:
    prior = lb.prior_from(written(tmp_path, machines=5))
    doubts = prior.doubts(plan((40, 40), forces_N=(400.0, 742.0)))
    assert doubts[0].startswith("The population's compliances are meant at 300 N, outside this campaign's forces (400 to 742 N)")
    assert doubts[1].startswith("The population has 5 machines, fewer than 6")
    assert len(doubts) == 2


def test_a_population_that_doubts_itself(tmp_path: Path) -> None:
    prior = lb.prior_from(written(tmp_path, trusted=False, not_belonging=["M07"]))
    assert pickle.loads(pickle.dumps(prior)) == prior
    untrusted, odd = prior.doubts(plan())
    assert untrusted.startswith("The population says that its spreads cannot be trusted")
    assert odd.startswith("The population includes 1 machine that does not belong with the others (M07)")
    (several,) = lb.prior_from(written(tmp_path, not_belonging=[f"M{m}" for m in range(7)])).doubts(plan())
    assert "7 machines that do not belong with the others (M0, M1, M2, M3, M4 and 2 more)" in several


def test_an_edited_file_is_refused(tmp_path: Path) -> None:
    file = written(tmp_path) / "population.json"
    record = json.loads(file.read_text())
    file.write_text(json.dumps(record, indent=2, sort_keys=True))
    assert lb.prior_from(file).sds["C_XXX"] == 4e-6
    record["next"]["C_XXX"]["sd"] = 4.1e-6
    file.write_text(json.dumps(record))
    with pytest.raises(InputError, match=r"got contents that its sha256 is not of: it was edited\. Give the folder"):
        lb.prior_from(file)


def test_other_machines_are_refused(tmp_path: Path) -> None:
    prior = lb.prior_from(written(tmp_path))
    with pytest.raises(InputError, match=r"topology must be the population's 'wCAFYXZSt' to use its prior, got 'wXFYZt'\. Use a"):
        prior.doubts(replace(plan(), topology="wXFYZt"))
    other = lb.prior_from(written(tmp_path, next={"C_ZZZ": {"unit": "mm/N", "mean": 5e-5, "sd": 1e-6}}))
    with pytest.raises(
        InputError, match=r"must have the population's compliances, got C_XXX, .* without C_ZZZ\. Use a population"
    ):
        other.doubts(plan())


def test_compliances_of_another_place_are_refused(tmp_path: Path) -> None:
    told = stands_for(plan())
    prior = lb.prior_from(written(tmp_path, compliances=told))
    assert prior.compliances == told
    assert prior.doubts(plan()) == ()
    assert pickle.loads(pickle.dumps(prior)) == prior
    higher = replace(plan(), tests=tuple(replace(test, centre_z_mm=100.0) for test in plan().tests))
    with pytest.raises(InputError, match=r"must mean by C_XXX what the population does, got circles or joints' frames"):
        prior.doubts(higher)
    with pytest.raises(InputError, match=r"compliances\.C_XXX\.C_X"):
        lb.prior_from(written(tmp_path, compliances={"C_XXX": {"C_X": 1.0}}))


def test_models_it_does_not_go_with(tmp_path: Path) -> None:
    prior, model = lb.prior_from(written(tmp_path)), lb.HybridModel.default(1)
    with pytest.raises(InputError, match=r"must have proper priors to take a population's, got flat ones\. Use the default"):
        prior.model(lb.HybridModel.paper(0))
    with pytest.raises(InputError, match=r"C_XYX must be free to have the population's prior, got one fixed at zero"):
        prior.model(model.fixing("C_XYX"))
    for own in ({"overrides": {"C_XXX": 1e-5}}, {"means": {"C_XXX": 1e-5}}):
        with pytest.raises(InputError, match="C_XXX must have one prior, got the population's and the model's own"):
            prior.model(replace(model, prior=replace(model.prior, **own)))
    with pytest.raises(InputError, match=r"reference_force_N must be the population's 300 N, .* got 389 N\. Leave"):
        prior.model(replace(model, reference_force_N=389.0))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"schema": 2}, r"schema = 2 \(Input should be 1\)"),
        ({"kind": "fit"}, r"kind = 'fit'"),
        ({"machines": 0}, r"machines = 0"),
        ({"machines": 2.5}, r"machines = 2\.5"),
        ({"reference_force_N": float("nan")}, r"reference_force_N = nan"),
        ({"next": {}}, r"next = \{\}"),
        ({"next": {"C_XXX": {"unit": "mm/N", "mean": 5e-5}}}, r"next\.C_XXX\.sd = nothing"),
        ({"next": {"C_XXX": {"unit": "mm/N", "mean": 5e-5, "sd": 0.0}}}, r"next\.C_XXX\.sd = 0\.0"),
        ({"next": {"C_XXX_1": {"unit": "mm/N/N", "mean": 0.0, "sd": 1e-8}}}, r"'C_XXX_1' among the compliances"),
        ({"next": {"C_XXX": {"unit": "µm/N", "mean": 0.05, "sd": 0.004}}}, r"C_XXX in 'µm/N' instead of 'mm/N'"),
    ],
)
def test_files_that_are_none(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    folder = written(tmp_path, **changes)
    with pytest.raises(InputError, match=message) as refused:
        lb.prior_from(folder)
    text = str(refused.value)
    assert text.startswith(f"{folder}/population.json must be a population's result, got ")
    assert text.endswith("Give the folder that held the result, or its population.json, unchanged.")


def test_what_is_no_file_or_no_json(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"population\.json must be a population's result, got nothing\. Check the path"):
        lb.prior_from(tmp_path)
    for content in (b"{", b"\xff\xfe\x00", b"[" * 100_000, b"[]", b"1" * 5000):
        (tmp_path / "population.json").write_bytes(content)
        with pytest.raises(InputError, match=r"must be a population's result, got .*unchanged\."):
            lb.prior_from(tmp_path)
    (tmp_path / "population.json").write_bytes(b" " * (128 * 2**20 + 1))
    with pytest.raises(InputError, match="must be at most 128 MB, got more"):
        lb.prior_from(tmp_path)
