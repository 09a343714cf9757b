"""The prior of one more machine from a population's result; what compliances stand for, against the wrench Jacobian."""

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
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.population import digest_of
from ldbb_bayes.fleet.statistics import same_meaning, stands_for
from ldbb_bayes.machine.chain import ComplianceName, compliance_jacobian

RESULT: dict[str, Any] = {
    "schema": 1,
    "kind": "population",
    "reference_force_N": 300.0,
    "machines": 24,
    "campaigns": 60,
    "topology": "wCAFYXZSt",
    "next": {
        "C_XXX": {"unit": "mm/N", "mean": 5.1e-5, "sd": 4e-6},
        "C_XYX": {"unit": "mm/N", "mean": 0.0, "sd": 1e-6},
        "C_CCY": {"unit": "rad/(N mm)", "mean": 4e-10, "sd": 2e-10},
    },
    "compliances": {},
    "machine": {"M07": {}},
    "readings_sha256": [],
    "doubts": [],
}


def written(folder: Path, **changes: Any) -> Path:
    record = json.loads(json.dumps(RESULT | changes))
    (folder / "population.json").write_text(json.dumps({"sha256": digest_of(record)} | record))
    return folder


def test_sets_means_and_sds_at_the_populations_force(tmp_path: Path) -> None:
    prior = lb.prior_from(written(tmp_path))
    assert prior == lb.prior_from(tmp_path / "population.json")
    assert (prior.machines, prior.campaigns, prior.sha256) == (24, 60, digest_of(RESULT))
    model = lb.HybridModel.first(1)
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
    """Forces elsewhere, the machine itself, what the population says of itself."""
    prior = lb.prior_from(written(tmp_path, doubts=["Its spreads cannot be trusted."]))
    force, own = prior.doubts(plan((40, 40), forces_N=(400.0, 742.0)))
    assert force.startswith("The population's compliances are meant at 300 N, outside this campaign's forces (400 to 742 N)")
    assert own == "The population says: Its spreads cannot be trusted."
    assert "has campaigns of this machine (M07)" in prior.doubts(replace(plan(), machine_id="M07"))[0]


def test_an_edited_file_is_refused(tmp_path: Path) -> None:
    file = written(tmp_path) / "population.json"
    record = json.loads(file.read_text())
    file.write_text(json.dumps(record, indent=2, sort_keys=True))
    assert lb.prior_from(file).sds["C_XXX"] == 4e-6
    record["next"]["C_XXX"]["sd"] = 4.1e-6
    file.write_text(json.dumps(record))
    with pytest.raises(InputError, match=r"its sha256 is not that of its contents: it was edited"):
        lb.prior_from(file)


def test_other_machines_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"topology must be the population's 'wCAFYXZSt' to use its prior, got 'wXFYZt'\. Use a"):
        lb.prior_from(written(tmp_path)).doubts(replace(plan(), topology="wXFYZt"))
    other = lb.prior_from(written(tmp_path, next={"C_ZZZ": {"unit": "mm/N", "mean": 5e-5, "sd": 1e-6}}))
    with pytest.raises(InputError, match=r"must have the population's compliances, got C_XXX, .* without C_ZZZ\."):
        other.doubts(plan())


def test_compliances_of_another_place_are_refused(tmp_path: Path) -> None:
    told = stands_for(plan())
    prior = lb.prior_from(written(tmp_path, compliances=told))
    assert prior.compliances == told
    assert prior.doubts(plan()) == ()
    higher = replace(plan(), tests=tuple(replace(test, centre_z_mm=100.0) for test in plan().tests))
    with pytest.raises(InputError, match=r"must mean by C_XXX what the population does, got circles or joints' frames"):
        prior.doubts(higher)


def test_models_it_does_not_go_with(tmp_path: Path) -> None:
    prior, model = lb.prior_from(written(tmp_path)), lb.HybridModel.first(1)
    with pytest.raises(InputError, match=r"must have proper priors to take a population's, got flat ones\. Use the default"):
        prior.model(lb.HybridModel.paper(0))
    with pytest.raises(InputError, match=r"C_XYX must be free to have the population's prior, got one fixed at zero"):
        prior.model(model.fixing("C_XYX"))
    for own in ({"overrides": {"C_XXX": 1e-5}}, {"means": {"C_XXX": 1e-5}}):
        with pytest.raises(InputError, match="C_XXX must have one prior, got the population's and the model's own"):
            prior.model(replace(model, prior=replace(model.prior, **own)))
    with pytest.raises(InputError, match=r"reference_force_N must be the population's 300 N, .* got 389 N\. Leave"):
        prior.model(replace(model, reference_force_N=389.0))


def test_what_is_no_population(tmp_path: Path) -> None:
    for changes in ({"schema": 2}, {"kind": "fit"}):
        with pytest.raises(InputError, match=r"must be a population written by .*, got a damaged one"):
            lb.prior_from(written(tmp_path, **changes))
    for content in (b"{", b"\xff\xfe\x00", b"[" * 100_000, b"[]"):
        (tmp_path / "population.json").write_bytes(content)
        with pytest.raises(InputError, match=r"must be a population written by|must be a population, got"):
            lb.prior_from(tmp_path)


# ---- what a compliance stands for

FRAMES = {"X": (10.0, 300.0, -200.0), "Y": (-50.0, 20.0, 400.0)}


def placed(centre_mm: tuple[float, float, float] = (0.0, 0.0, 0.0), radius_mm: float = 150.0, **fields: Any) -> Campaign:
    """A plan whose circles lie there."""
    x, y, z = centre_mm
    own = {"centre_x_mm": x, "centre_y_mm": y, "centre_z_mm": z, "radius_mm": radius_mm}
    made = plan()
    return replace(made, tests=tuple(replace(test, **own) for test in made.tests), **fields)


def test_the_sum_is_what_readings_see(rng: np.random.Generator) -> None:
    """Joints' compliances drawn, the kept ones made of them: the same readings of a circle off the centre."""
    made = placed((120.0, -40.0, 90.0), frames_mm=FRAMES)
    meant = stands_for(made)
    members = sorted({label for parts in meant.values() for label in parts})
    truth = dict(zip(members, rng.standard_normal(len(members)), strict=True))
    names = [ComplianceName(*label[2:]) for label in (*members, *meant)]
    circle = next(iter(made.tests)).circle
    jacobian = compliance_jacobian(made.machine(), circle, np.linspace(0.0, 6.0, 40), names)
    kept = [sum(weight * truth[label] for label, weight in parts.items()) for parts in meant.values()]
    every = jacobian[:, : len(members)] @ list(truth.values())
    assert np.linalg.norm(jacobian[:, len(members) :] @ kept - every) < 1e-6 * np.linalg.norm(every)


@pytest.mark.parametrize("frames", [{}, FRAMES])
def test_a_radius_does_not_matter(frames: dict[str, Any]) -> None:
    meant = stands_for(placed((0.0, 0.0, 80.0), frames_mm=frames))
    assert meant == stands_for(placed((0.0, 0.0, 80.0), radius_mm=50.0, frames_mm=frames))
    assert meant["C_XXX"]["C_BXX"] == (280.0 if frames else 80.0)


def test_a_millimetre_counts_for_nothing_and_a_decimetre_does() -> None:
    """Along the wrench; in the frames' plane nothing does."""
    one, near, far = (stands_for(placed((0.0, 0.0, z))) for z in (0.0, 1.0, 100.0))
    assert one["C_XXX"] == {"C_XXX": 1.0, "C_XXY": 1.0}
    assert stands_for(placed((100.0, -30.0, 0.0))) == one
    assert far["C_XXX"]["C_BXX"] == pytest.approx(100.0)
    assert near["C_XXX"] != one["C_XXX"]
    assert all(same_meaning(name, one[name], near[name]) for name in one)
    assert [name for name in one if not same_meaning(name, one[name], far[name])] == ["C_XXX", "C_XYX", "C_YYY", "C_CXY", "C_CYY"]
