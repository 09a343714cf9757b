"""The study's numbers are reproduced, its page says what they are, and small simulations agree with the large ones."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

STUDY = Path(__file__).parents[2] / "studies" / "04_constant_or_linear"


def page() -> str:
    return (STUDY / "README.md").read_text(encoding="utf-8").replace("−", "-")


@pytest.mark.slow
def test_reproduced() -> None:
    done = subprocess.run([sys.executable, str(STUDY / "run.py")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_page_says_what_was_found() -> None:
    found = json.loads((STUDY / "results.json").read_text(encoding="utf-8"))
    text = page()
    centre = found["assumptions"]["set-up shift of order 1 (centre) only"]
    scale = found["slope_scale"]
    rmse = found["least_squares_rmse_um"]
    inclusion = found["inclusion_probability"]
    others = [p for name, p in inclusion.items() if name != "C_XYX"]
    for claim in (
        f"{rmse['constant']:.2f} → {rmse['linear']:.2f} µm, {100 * (rmse['linear'] / rmse['constant'] - 1):.0f} %",
        f"ln B = {found['log_bayes_factor']:.2f}: constant",
        f"ln B = {centre['log_bayes_factor']:+.2f}: linear",
        f"ln B = {found['assumptions']['white noise only, no truncation']['log_bayes_factor']:+.0f}: linear",
        f"overstates the case by {found['white_noise_overstates_by_nats']:.0f} nats",
        f"is {-centre['evidence']:.1f} nats lower",
        f"from {scale['0.03']:.2f} (slopes",
        f"to {scale['3.0']:.1f} (at 3)",
        f"lower by {-found['elpd_difference']['value']:.1f} ± {found['elpd_difference']['se']:.1f}",
        f"C_XYX varies with probability {inclusion['C_XYX']:.2f}, the others {min(others):.2f} to {max(others):.2f}",
        f"no slope at all {found['no_slope_probability']:.2f}",
    ):
        assert claim in text, claim
    assert found["flagged"] == []


def test_the_page_says_what_was_simulated() -> None:
    found = json.loads((STUDY / "simulations.json").read_text(encoding="utf-8"))
    text = page()
    rows = {
        "no slope: ln B negative": found["no slope"],
        "all six slopes of 3 posterior sd: ln B positive": found["all slopes of 3 posterior sd"],
        "one slope of 3 posterior sd, that one in the model": found["one slope of 3 posterior sd, that one in the model"],
        "one slope of 3 posterior sd, all six in the model": found["one slope of 3 posterior sd, six in the model"],
        "the likelier model was the true one": found["reliability"]["right_sign"],
        "an outlying test (8 κ in orders 0 to 3) is flagged": found["outlier flagged"],
        "another test is flagged beside it": found["others flagged beside an outlier"],
        "a false alarm in a clean campaign": found["false alarm in a clean campaign"],
        "the same, everything drawn from the priors": found["false alarm in a clean campaign drawn from the priors"],
    }
    for label, entry in rows.items():
        (row,) = [line for line in text.splitlines() if label in line]
        value, spread = map(float, re.findall(r"\| ([\d.]+) ± ([\d.]+) \|", row)[0])
        assert value == pytest.approx(entry["share"], abs=6e-4)
        assert spread == pytest.approx(entry["se"], abs=6e-4)
    assert f"z = {found['reliability']['spiegelhalter_z']:.2f}" in text
    assert found["campaigns"] == 200


def test_what_was_asked_of_the_simulations() -> None:
    """Signs right in 95 and 90 %, outliers found in 95 % at no more than 5 % false alarms, probabilities calibrated."""
    found = json.loads((STUDY / "simulations.json").read_text(encoding="utf-8"))
    assert found["no slope"]["share"] >= 0.95
    assert found["all slopes of 3 posterior sd"]["share"] >= 0.90
    assert found["one slope of 3 posterior sd, that one in the model"]["share"] >= 0.90
    assert found["outlier flagged"]["share"] >= 0.95
    assert found["false alarm in a clean campaign"]["share"] <= 0.05
    assert found["false alarm in a clean campaign drawn from the priors"]["share"] <= 0.05
    reliability = found["reliability"]
    assert abs(reliability["spiegelhalter_z"]) < 3.0
    claimed, seen, count = (np.array(reliability[name]) for name in ("claimed", "was_linear", "count"))
    assert np.all(np.abs(seen - claimed) < 4.0 * np.sqrt(np.maximum(claimed * (1.0 - claimed), 0.25 / count) / count))


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("simulate_comparison", STUDY / "simulate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["simulate_comparison"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_a_few_campaigns_anew(script: ModuleType) -> None:
    """Other seeds than the study's: ten of each kind."""
    slopes = {name: 3.0 * sd for name, sd in script.posterior_sd().items()}
    assert sum(script.with_slopes(seed, {}) < 0.0 for seed in range(10)) >= 9
    assert sum(script.with_slopes(seed, slopes) > 0.0 for seed in range(10)) >= 8
    hits = [script.flagged(seed, outlier=True) for seed in range(6)]
    assert all(hit for hit, _ in hits)
    assert sum(others for _, others in hits) <= 1


def test_a_broken_evidence_would_be_seen(script: ModuleType) -> None:
    """Probabilities that are too sure by a factor of 4 in log odds fail the test of calibration."""
    rng = np.random.default_rng(1)
    log_odds = rng.normal(0.0, 2.0, 400)
    outcome = rng.random(400) < 1.0 / (1.0 + np.exp(-log_odds))
    honest = script.reliability([(float(1.0 / (1.0 + np.exp(-x))), bool(o)) for x, o in zip(log_odds, outcome, strict=True)])
    sure = script.reliability([(float(1.0 / (1.0 + np.exp(-4.0 * x))), bool(o)) for x, o in zip(log_odds, outcome, strict=True)])
    assert abs(honest["spiegelhalter_z"]) < 3.0 < abs(sure["spiegelhalter_z"])
