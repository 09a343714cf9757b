"""Circular-test quantities of the machine's path: by the exact model, and of both directions by simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import HYPER_UM, TRUTH, plan

import ldbb_bayes as lb
from ldbb_bayes.analysis.circularity import circularity, least_squares_zone, measured_circularity, minimum_zone
from ldbb_bayes.machine.forward import exact_reading_mm

ANGLE = np.arange(360) * np.pi / 180.0
QUIET = HYPER_UM | {"tau": 0.05, "delta": 0.05, "kappa": 0.05}


def second_harmonic(trace: np.ndarray) -> tuple[float, float]:
    """cos 2θ and sin 2θ of a trace, by the discrete Fourier sum."""
    return float(2.0 * (trace * np.cos(2 * ANGLE)).mean()), float(2.0 * (trace * np.sin(2 * ANGLE)).mean())


@pytest.mark.parametrize("topology", ["wCAFYXZSt", "wYFXZt"])
def test_the_machines_path(topology: str) -> None:
    """Every quantity of the exact model at the truth lies where the posterior says, at every force and at none."""
    model = lb.HybridModel.default(0)
    planned = replace(plan((120,) * 4), topology=topology)
    names = set(model.bind(planned).names)
    truth = {name: value for name, value in TRUTH.items() if name in names}
    campaign = model.simulate(planned, seed=5, parameters=truth, hyper_um=QUIET).campaign
    posterior = lb.sample(model, campaign, seed=1, sampler="independent")
    table = circularity(posterior)
    assert sorted(set(table["force_N"])) == [0.0, 36.0, 300.0, 520.0, 742.0]
    machine, circle = campaign.machine(), campaign.tests[0].circle
    compliances = {name: value for name, value in truth.items() if name.startswith("C_")}
    errors = {name: value for name, value in truth.items() if name.startswith("E_") and name[3] != "t"}

    def exact_um(force_N: float, errors: dict[str, float]) -> np.ndarray:
        return 1e3 * exact_reading_mm(machine, circle, ANGLE, force_N=force_N, compliances=compliances, geometric_errors=errors)

    one = exact_um(0.0, {next(n for n in names if n.startswith("E_C0")): 1e-6})
    for force in (0.0, 300.0, 742.0):
        trace = exact_um(force, errors)
        zone = least_squares_zone(ANGLE, trace)
        cosine, sine = second_harmonic(trace)
        truths = {
            "G": zone.width,
            "G_minimum_zone": minimum_zone(ANGLE, trace).width,
            "F_max": zone.upper - zone.mean,
            "F_min": zone.lower - zone.mean,
            # cos 2θ of R (g₁ cos² θ + g₂ sin² θ) is R (g₁ − g₂) / 2; 1 µm/m of squareness makes the trace `one`.
            "scale_mismatch": 2.0 * cosine / 0.150,
            "squareness": sine / second_harmonic(one)[1],
        }
        for quantity, value in truths.items():
            row = table[(table["force_N"] == force) & (table["quantity"] == quantity)].iloc[0]
            assert abs(row["mean"] - value) < 4.0 * row["sd"] + 0.02, (force, quantity)
            assert row["ci_low"] <= row["median"] <= row["ci_high"]
    measured, pairs = measured_circularity(posterior)
    assert (measured["G_minimum_zone"] <= measured["G"] + 1e-9).all()
    np.testing.assert_allclose(measured["F_max"] - measured["F_min"], measured["G"])
    assert list(measured.index) == [test.name for test in campaign.tests]
    assert pairs.empty


def test_a_known_squareness_and_mismatch() -> None:
    """At no force the path's squareness is E_C(0Y)X and its mismatch E_XX1 − E_YY1, draw by draw."""
    model = lb.HybridModel.default(1)
    campaign = model.simulate(plan(), seed=2, hyper_um=HYPER_UM).campaign
    posterior = lb.sample(model, campaign, seed=1, sampler="independent")
    table = circularity(posterior, [0.0]).set_index("quantity")
    group = posterior["posterior"]
    square = group["E_C0YX"].to_numpy() * 1e6
    mismatch = (group["E_XX1"] - group["E_YY1"]).to_numpy() * 1e6
    assert table.loc["squareness", "mean"] == pytest.approx(square.mean(), abs=0.05 * square.std())
    assert table.loc["scale_mismatch", "mean"] == pytest.approx(mismatch.mean(), abs=0.05 * mismatch.std())
    assert table.loc["squareness", "sd"] == pytest.approx(square.std(), rel=0.04)
    assert table.loc["squareness", "unit"] == "µm/m"


@pytest.fixture(scope="module")
def both_ways() -> tuple[lb.Campaign, object]:
    tests = tuple(replace(test, direction=way, name=f"{way}{k}") for way in ("CW", "CCW") for k, test in enumerate(plan().tests))
    model = lb.HybridModel.default(0)
    campaign = model.simulate(replace(plan(), tests=tests), seed=3, hyper_um=QUIET).campaign
    # Lost motion: clockwise 2 µm of cos θ and 3 µm of sin 2θ more than the mean path, the other way as much less.
    moved = tuple(
        test.with_reading_um(
            np.asarray(test.reading_um)
            + (1.0 if test.direction == "CW" else -1.0) * (2.0 * np.cos(test.angles_rad()) + 3.0 * np.sin(2 * test.angles_rad()))
        )
        for test in campaign.tests
    )
    campaign = replace(campaign, tests=moved)
    return campaign, lb.sample(model, campaign, seed=1, sampler="independent")


def test_both_directions(both_ways: tuple[lb.Campaign, object]) -> None:
    """G(b) and D of the readings by their definition, and of the posterior where the readings put them."""
    campaign, posterior = both_ways
    _, pairs = measured_circularity(posterior)  # type: ignore[arg-type]
    assert list(pairs.index) == [f"CW{k} + CCW{k}" for k in range(4)]
    for k in range(4):
        one, other = (next(t for t in campaign.tests if t.name == f"{way}{k}") for way in ("CW", "CCW"))
        angle = np.concatenate([one.angles_rad(), other.angles_rad()])
        reading = np.concatenate([one.reading_um, other.reading_um])  # type: ignore[list-item]
        fitted = np.linalg.lstsq(np.column_stack([np.ones_like(angle), np.cos(angle), np.sin(angle)]), reading, rcond=None)[0]
        rest = reading - fitted[1] * np.cos(angle) - fitted[2] * np.sin(angle)
        assert pairs.loc[f"CW{k} + CCW{k}", "G_b"] == pytest.approx(np.ptp(rest))
        assert pairs.loc[f"CW{k} + CCW{k}", "D"] == pytest.approx(fitted[0])
        assert pairs.loc[f"CW{k} + CCW{k}", "G_b_minimum_zone"] <= pairs.loc[f"CW{k} + CCW{k}", "G_b"] + 1e-9
    table = circularity(posterior, [520.0]).set_index("quantity")  # type: ignore[arg-type]
    assert set(table.index) >= {"G_b", "G_b_minimum_zone", "D", "G"}
    # One direction alone lacks the lost motion: 2 (2 cos θ + 3 sin 2θ) between the two ways.
    assert table.loc["G_b", "median"] > table.loc["G", "median"] + 1.0
    assert table.loc["G_b", "ci_low"] < pairs.loc["CW2 + CCW2", "G_b"] < table.loc["G_b", "ci_high"] + 2.0
