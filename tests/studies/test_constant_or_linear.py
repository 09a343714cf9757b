"""Study 04 shows what it was asked for: right signs, calibrated probabilities, outliers found, and what the answer hangs on."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

STUDY = Path(__file__).parents[2] / "studies" / "04_constant_or_linear"


@pytest.fixture(scope="module")
def results() -> dict[str, Any]:
    return dict(json.loads((STUDY / "results.json").read_text(encoding="utf-8")))


def module_of(path: Path, name: str) -> ModuleType:
    for folder in (STUDY.parent, STUDY.parent / "02_recovered_experiment", STUDY):
        sys.path.insert(0, str(folder))
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def simulated() -> ModuleType:
    return module_of(STUDY / "simulated.py", "simulated_comparison")


@pytest.fixture(scope="module")
def harmonics() -> ModuleType:
    return module_of(STUDY / "harmonics.py", "harmonics_of_circles")


def test_three_answers_side_by_side(results: dict[str, Any]) -> None:
    """RMSE and white noise say linear, the honest answer says constant, and one assumption turns it."""
    compared = results["compared"]
    rmse = compared["least_squares_rmse_um"]
    assert (f"{rmse['constant']:.1f}", f"{rmse['linear']:.1f}") == ("1.1", "0.9")
    assert compared["assumptions"]["white noise only, no truncation"]["log_bayes_factor"] > 500.0
    assert compared["log_bayes_factor"] == pytest.approx(compared["savage_dickey"], abs=0.02)
    assert compared["log_bayes_factor"] < -5.0
    assert compared["assumptions"]["set-up shift of order 1 (centre) only"]["log_bayes_factor"] > 5.0
    assert len(compared["slope_scale"]) >= 5


def test_the_printed_numbers_alone(results: dict[str, Any]) -> None:
    """The dense model returns the package's ln B where both see the same; which way the numbers lean, and what turns the sign."""
    found, compared = results["printed"], results["compared"]
    assert found["of_readings"]["log_bayes_factor"] == pytest.approx(compared["log_bayes_factor"], abs=0.01)
    assert found["scaled"]["1"]["zero and centre move"] == pytest.approx(compared["log_bayes_factor"], abs=0.01)
    assert found["numbers"] == results["undetermined"]["printed"]
    assert found["slope_scale"]["0.3"] == pytest.approx(found["log_bayes_factor"]["zero and centre move"], abs=1e-3)
    assert [row["numbers"] for row in found["without"].values()] == [found["numbers"] - 8] * 6
    lightest, *others = (row["log_bayes_factor"] for row in found["without"].values())
    assert lightest < -5.0 < min(others)
    for label, value in found["log_bayes_factor"].items():
        assert found["parts"][label]["all six"] == pytest.approx(value, abs=1e-3)
    assert found["log_bayes_factor"]["zero and centre move"] > 0.0 > compared["log_bayes_factor"]
    assert found["kappa_um"]["linear"] < found["kappa_um"]["constant"] < compared["kappa_um"]
    assert found["scaled"]["0.25"]["zero and centre move"] > 0.0 > found["scaled"]["0.5"]["zero and centre move"]


def test_one_circle_ignored(harmonics: ModuleType) -> None:
    """The same as saying of every harmonic of that circle that it is known to a millimetre."""
    grid = {"delta": np.array([7e-4]), "kappa": np.array([1e-4]), "tau": np.array([5e-3])}
    data = harmonics.printed_numbers()
    for circle in (0, 3):
        own = slice(8 * circle, 8 * circle + 8)
        vague = harmonics.Model(data, grid=grid)
        vague.fixed[:] += data.jacobian[:, own] @ data.jacobian[:, own].T
        ignored = harmonics.Model(data.without(circle), grid=grid)
        assert ignored.log_bayes_factor() == pytest.approx(vague.log_bayes_factor(), abs=0.01)
        assert ignored.log_bayes_factor() != pytest.approx(harmonics.Model(data, grid=grid).log_bayes_factor(), abs=0.5)


def test_the_three_undetermined_directions(results: dict[str, Any]) -> None:
    """The same null space as study 02 found another way; ln B of the campaign as shipped; its sign turns along cos 4θ alone."""
    found, other = (
        results["undetermined"],
        json.loads((STUDY.parent / "02_recovered_experiment" / "results.json").read_text("utf-8")),
    )
    assert (found["printed"], found["determined"]) == (78, 45)
    for name, sd in zip(found["paths"], other["open"]["sd_um"].values(), strict=True):
        assert found["paths"][name]["sd_um"] == pytest.approx(sd, rel=1e-4)
    assert found["smallest"]["cos4_um"] == pytest.approx(other["open"]["cos4_at_lowest_um"]["set to zero"], abs=1e-4)
    assert found["as_recovered"] == pytest.approx(results["compared"]["log_bayes_factor"], abs=0.01)
    assert found["exchanges"]["most"] < -5.0
    assert found["drawn"]["least"] < 0.0 < found["drawn"]["most"]


def test_parts_of_the_gain(results: dict[str, Any]) -> None:
    """Shares of Fourier orders add to one; equal slopes alone are the share of order 0, as c² + s² = 1."""
    squares = results["gain"]["least_squares"]
    assert sum(squares["order"].values()) == pytest.approx(1.0, abs=1e-6)
    assert squares["equal slopes"]["first"] == pytest.approx(squares["order"]["0"], rel=1e-6)
    gain = squares["readings"] * (squares["rmse_um"]["constant"] ** 2 - squares["rmse_um"]["linear"] ** 2)
    assert squares["gain_um2"] == pytest.approx(gain, rel=1e-9)
    evidence = results["gain"]["evidence"]
    assert evidence["zero and centre move"]["all six"] == pytest.approx(results["compared"]["log_bayes_factor"], abs=0.02)


def test_what_was_asked_of_the_simulations(results: dict[str, Any]) -> None:
    """Signs right in 95 and 90 % (two standard errors allowed), outliers found in 95 % at no more than 5 % false alarms."""
    found = results["simulated"]

    def at_least(kind: str, share: float) -> bool:
        return bool(found[kind]["share"] + 2.0 * found[kind]["se"] >= share)

    assert at_least("no slope", 0.95)
    assert at_least("six slopes", 0.90)
    assert at_least("one slope, that one in the model", 0.90)
    assert at_least("outlier flagged", 0.95)
    assert found["false alarm"]["share"] <= 0.05
    assert found["false alarm, from the priors"]["share"] <= 0.05
    reliability = found["reliability"]
    assert abs(reliability["spiegelhalter_z"]) < 3.0
    claimed, seen, count = (np.array(reliability[name]) for name in ("claimed", "was linear", "count"))
    assert np.all(np.abs(seen - claimed) < 4.0 * np.sqrt(np.maximum(claimed * (1.0 - claimed), 0.25 / count) / count))


@pytest.mark.slow
def test_a_few_campaigns_anew(simulated: ModuleType) -> None:
    """Other seeds than the study's: ten of each kind."""
    rows = {
        kind: [simulated.evidence_row(kind, seed)["linear"] for seed in range(5000, 5010)] for kind in ("no slope", "six slopes")
    }
    assert sum(value < 0.0 for value in rows["no slope"]) >= 9
    assert sum(value > 0.0 for value in rows["six slopes"]) >= 8


def test_a_broken_evidence_would_be_seen(simulated: ModuleType) -> None:
    """Probabilities that are too sure by a factor of 4 in log odds fail the test of calibration."""
    rng = np.random.default_rng(1)
    log_odds = rng.normal(0.0, 2.0, 400)
    outcome = (rng.random(400) < 1.0 / (1.0 + np.exp(-log_odds))).astype(float)
    honest, sure = (simulated.reliability(1.0 / (1.0 + np.exp(-factor * log_odds)), outcome) for factor in (1.0, 4.0))
    assert abs(honest["spiegelhalter_z"]) < 3.0 < abs(sure["spiegelhalter_z"])
