"""The model as TOML, both ways."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.model.specification import model_from_toml, model_sha256, model_to_toml
from ldbb_bayes.model.terms import BarLength, Discrepancy, Drift, Mount, SetupShift

MODELS = [
    lb.HybridModel.first(1),
    lb.HybridModel.default(2),
    lb.HybridModel.paper(0),
    lb.HybridModel.first(2).without("mount", "truncation"),
    lb.HybridModel.first(1).fixing("C_XYX_1", "E_C0YX"),
    lb.HybridModel(1, (SetupShift("apart"), Discrepancy(2.0))),
    lb.HybridModel.first(1).including(Drift("temperature", centre_um=3.0), lb.Hysteresis(1.0, 4.0)),
    lb.HybridModel(0, (BarLength(3.0), Mount(0.2)), replace(lb.Prior.first(), tau_um=9.0, overrides={"C_XXX": 1e-5}), 0.0),
]


@pytest.mark.parametrize("model", MODELS)
def test_round_trip(model: lb.HybridModel) -> None:
    back = model_from_toml(model_to_toml(model))
    assert back == model
    assert model_sha256(back) == model_sha256(model)


def test_what_is_left_out_is_the_presets() -> None:
    assert model_from_toml("schema = 1") == lb.HybridModel.default(1)
    first = lb.HybridModel.first(1)
    alone = model_from_toml('schema = 1\npreset = "first"\n[terms.BallForm]\n[terms.Mount]\nrelative_sd = 0.2\n')
    assert alone.nuisances == (first.nuisances[0], replace(first.nuisances[2], relative_sd=0.2))  # type: ignore[type-var]
    assert "Drift" not in model_to_toml(lb.HybridModel.first(1))
    model = model_from_toml("schema = 1\ndegree = 0\n[prior]\ntau_um = 15.0\n[terms.BarLength]\nsd_um = 2.0\n")
    assert model.nuisances == (BarLength(2.0),)
    assert model.prior.tau_um == 15.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("schema =", r"model\.toml must be valid TOML"),
        ("schema = 2", "'schema' must be 1, got 2"),
        ("schema = 1\ndegree = 4", "'degree' must be 0, 1 or 2, got 4"),
        ("schema = 1\n[prior]\ntau = 1.0", "Did you mean 'tau_um'"),
        ("schema = 1\n[prior]\ntruncated = 1.0", "prior truncated must be a bool"),
        ("schema = 1\n[terms.BallForms]", "Did you mean 'BallForm'"),
        ("schema = 1\n[terms.BarLength]\nsd_um = -1.0", "BarLength sd_um must be"),
        ("schema = 1\n[terms.BallForm]\nx = 1.0", "BallForm key must be one of sphericity_um, law, got 'x'"),
        ("schema = 1\n[terms.SetupShift]\nmoves = 'zeros'", "SetupShift moves must be one of .* Did you mean 'zero'"),
        ("schema = 1\n[terms.Discrepancy]\ndecay = 'fast'", "Discrepancy decay must be a float, got 'fast'"),
        ("schema = 1\nreference_force_N = nan", "reference_force_N must be finite"),
    ],
)
def test_refused(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "model.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        lb.read_model(file)
    assert str(file) in str(caught.value)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="readable TOML file"):
        lb.read_model(tmp_path / "none.toml")
