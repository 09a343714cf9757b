"""The model as TOML, both ways."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from campaigns import cases, plan, refuses

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.model.specification import model_from_toml, model_sha256, model_to_toml
from ldbb_bayes.model.terms import Angle, BarLength, Discrepancy, Drift, Mount, SetupShift

CASES = cases(__file__, "spec.toml")

MODELS = [
    lb.HybridModel.first(1),
    lb.HybridModel.default(2),
    lb.HybridModel.paper(0),
    lb.HybridModel.first(2).without("mount", "truncation"),
    lb.HybridModel.first(1).fixing("C_XYX_1", "E_C0YX"),
    lb.HybridModel(1, (SetupShift("apart"), Discrepancy(2.0))),
    lb.HybridModel.first(1).with_term(
        Drift("temperature", centre_um=3.0), lb.terms.Hysteresis(1.0, 4.0)
    ),
    lb.HybridModel(
        0,
        (BarLength(3.0), Mount(0.2)),
        replace(lb.Prior.first(), tau_um=9.0, overrides={"C_XXX": 1e-5}),
        0.0,
    ),
]


@pytest.mark.parametrize("model", MODELS)
def test_round_trip(model: lb.HybridModel) -> None:
    back = model_from_toml(model_to_toml(model))
    assert back == model
    assert model_sha256(back) == model_sha256(model)


def test_what_is_left_out_is_the_presets() -> None:
    assert model_from_toml("schema = 1") == lb.HybridModel.default(1)
    first = lb.HybridModel.first(1)
    two_terms = model_from_toml(
        'schema = 1\npreset = "first"\n[terms.BallForm]\n[terms.Mount]\nrelative_sd = 0.2\n'
    )
    mount = replace(first.nuisances[2], relative_sd=0.2)  # type: ignore[type-var]
    assert two_terms.nuisances == (first.nuisances[0], mount)
    assert "Drift" not in model_to_toml(lb.HybridModel.first(1))
    model = model_from_toml(
        "schema = 1\ndegree = 0\n[prior]\ntau_um = 15.0\n[terms.BarLength]\nsd_um = 2.0\n"
    )
    assert model.nuisances == (BarLength(2.0),)
    assert model.prior.tau_um == 15.0


@pytest.mark.parametrize(("text", "message"), CASES["refused"])
def test_model_files_that_cannot_be_are_refused(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "model.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        lb.read_model(file)
    assert str(file) in str(caught.value)


def test_units_in_a_model_file() -> None:
    """Each is the number in the unit that its key or parameter has."""
    prior = lb.Prior(
        tau_um=2.0,
        direct_mm_per_N=9e-5,
        rotation_for_moment_rad_per_N_mm=2e-9,
        straightness_per_mm=5e-7,
        squareness_rad=np.deg2rad(10.0 / 3600.0),
        slope_scale=0.2,
        means={"C_XXX": 6e-5, "E_C0YX": -3e-6},
        overrides={"C_XXX": 5e-6, "C_CCY": 5e-10, "C_YYY_1": 2e-8, "E_YX2": 3e-7, "E_Xt0_2": 0.01},
    )
    model = lb.read_model(Path(__file__).with_name("units.toml"))
    assert vars(model.prior) == vars(replace(prior, squareness_rad=model.prior.squareness_rad))
    assert model.prior.squareness_rad == pytest.approx(prior.squareness_rad, rel=1e-12)
    force = lb.terms.ForceError(gain_sd=0.02, random_sd_N=3.0)
    assert model.nuisances == (force, Angle(0.2), lb.terms.Hysteresis(proportional_um_per_kN=2.0))
    assert model_from_toml(model_to_toml(model)) == model


def test_with_prior() -> None:
    """Parameters by mean and sd, settings by their key, with units or without; what was fixed is
    free again."""
    plain = lb.HybridModel.default(1).fixing("C_XXX", "C_XYX_1")
    model = plain.with_prior(
        {"E_C(0Y)X": (0, "20 µrad")},
        C_XXX=("60 nm/N", "5 nm/N"),
        C_YYY_1=(0.0, 2e-8),
        tau_um="2 µm",
    )
    assert dict(model.prior.means) == {"E_C0YX": 0.0, "C_XXX": 6e-5}
    assert dict(model.prior.overrides) == {"E_C0YX": 2e-5, "C_XXX": 5e-6, "C_YYY_1": 2e-8}
    assert (model.prior.tau_um, model.fixed) == (2.0, ("C_XYX_1",))
    assert model_from_toml(model_to_toml(model)) == model
    bound = model.bind(plan())
    assert dict(zip(bound.names, bound.prior_sd, strict=True))["C_XXX"] == 5e-6
    assert model.with_prior(C_XXX=(0.0, "1 µm/kN")).prior.means["C_XXX"] == 0.0


NO_SD = (
    {"C_XXX": (0.0, None)},
    "prior sd of C_XXX must be a number or text with its unit, got None",
)


@pytest.mark.parametrize(("priors", "message"), [*CASES["priors"], NO_SD])
def test_priors_refused(priors: dict[str, object], message: str) -> None:
    arguments = dict(priors)
    for name, prior in priors.items():
        if isinstance(prior, list):  # TOML has no tuples
            arguments[name] = tuple(prior)
    refuses(message, lb.HybridModel.default(1).with_prior, arguments)


def test_missing_file(tmp_path: Path) -> None:
    refuses("readable TOML file", lb.read_model, tmp_path / "none.toml")
