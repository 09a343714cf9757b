"""Simulated campaigns: reproducible, true to the model's covariance, exact where asked."""

from __future__ import annotations

import numpy as np
import pytest
from campaigns import HYPER_UM, TRUTH, cases, oracle_of, plan, refuses

import ldbb_bayes as lb
from ldbb_bayes.machine.exact import exact_reading_mm
from ldbb_bayes.model.fourier import basis

SILENT = {"sigma": 0.0, "delta": 0.0, "kappa": 0.0, "tau": 0.0}


def test_a_seed_determines_the_simulated_campaign() -> None:
    model = lb.HybridModel.first(1)
    first = model.simulate(plan(), seed=1)
    repeated = model.simulate(plan(), seed=1)
    other_seed = model.simulate(plan(), seed=2)
    assert first.campaign.sha256 == repeated.campaign.sha256
    assert first.campaign.sha256 != other_seed.campaign.sha256
    assert first.parameters == repeated.parameters
    assert set(first.hyper_um) == {"sigma", "delta", "kappa", "tau"}


def test_exact_readings_come_from_the_forward_model() -> None:
    model = lb.HybridModel.first(0).without("bar-length", "mount", "force-error")
    simulation = model.simulate(plan(), seed=1, parameters=TRUTH, hyper_um=SILENT, exact=True)
    campaign = simulation.campaign
    errors = {name: value for name, value in TRUTH.items() if name.startswith("E")}
    compliances = {name: value for name, value in TRUTH.items() if name.startswith("C")}
    for test in campaign.tests:
        exact = exact_reading_mm(
            campaign.machine(),
            test.circle,
            test.angles_rad(),
            force_N=float(test.force_N or 0.0),
            compliances=compliances,
            geometric_errors=errors,
        )
        np.testing.assert_allclose(test.readings_mm(), exact, atol=1e-12)


@pytest.mark.slow
def test_covariance_of_the_readings_is_the_oracles() -> None:
    """400 simulations of one small plan: whitened by the oracle's covariance they are standard
    normal."""
    model = lb.HybridModel.first(0)
    planned = plan((12, 12), forces_N=(100.0, 700.0), work_deg=30.0)
    readings = []
    for seed in range(400):
        simulation = model.simulate(planned, seed=seed, parameters=TRUTH, hyper_um=HYPER_UM)
        campaign = simulation.campaign
        readings.append(np.concatenate([test.readings_mm() for test in campaign.tests]))
    oracle = oracle_of(campaign, 0)
    truth = np.array([TRUTH[name] for name in oracle.names])
    phi = np.array([HYPER_UM[name] * 1e-3 for name in oracle.hypers])
    root = np.linalg.cholesky(oracle.covariance(phi))
    residuals = np.array(readings) - oracle.J @ truth
    white = np.linalg.solve(root, residuals.T)
    assert np.abs(white.mean(axis=1)).max() < 0.25
    assert np.mean(white**2) == pytest.approx(1.0, abs=0.06)
    sample = np.cov(white)
    assert np.abs(sample - np.eye(24)).max() < 0.3


@pytest.mark.parametrize(("arguments", "message"), cases(__file__, "spec.toml")["simulate"])
def test_simulations_that_cannot_be_are_refused(arguments: dict, message: str) -> None:
    refuses(message, lb.HybridModel.first(0).simulate, plan(), seed=1, **arguments)


@pytest.mark.parametrize(
    ("hyper_um", "message"),
    [
        ({"sigma": np.nan}, "hyper-parameter sigma must be a number ≥ 0 in µm, got nan. Correct"),
        (
            {"decay": 4.0},
            "hyper-parameter decay must be a number from 0.5 to 3.5, got 4.0. Correct",
        ),
        (
            {"decay": 0.0},
            "hyper-parameter decay must be a number from 0.5 to 3.5, got 0.0. Correct",
        ),
        (
            {"lambda_f742": 0.0},
            "hyper-parameter lambda_f742 must be a number > 0, got 0.0. Correct",
        ),
    ],
)
def test_hyper_parameters_must_be_in_their_range(hyper_um: dict, message: str) -> None:
    model = lb.HybridModel.default()
    refuses(message, model.simulate, plan(), seed=1, hyper_um=hyper_um)


def test_truths_may_be_texts_with_a_unit() -> None:
    model = lb.HybridModel.first(1)
    texts = {"C_XXX": "60 nm/N", "C_XXX_1": "-5 nm/N/kN", "E_C(0Y)X": "20 µrad"}
    numbers = {"C_XXX": 60e-6, "C_XXX_1": -5e-9, "E_C0YX": 20e-6}
    stated = model.simulate(plan(), seed=1, parameters=texts, hyper_um={"sigma": "0.3 µm"})
    expected = model.simulate(plan(), seed=1, parameters=numbers, hyper_um={"sigma": 0.3})
    assert stated.parameters == expected.parameters
    assert stated.hyper_um == pytest.approx(expected.hyper_um, rel=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"parameters": {"C_XXX": "60 µrad"}}, "true C_XXX must be a number with its unit, got"),
        ({"parameters": {"C_XXX": None}}, "true C_XXX must be a number or text with its unit"),
        ({"parameters": "60 nm/N"}, "true parameters must be numbers or texts by name, got"),
        ({"hyper_um": {"sigma": "0.3 nm/N"}}, "hyper-parameter sigma must be a number with its"),
        ({"hyper_um": {"decay": "2 µm"}}, "hyper-parameter decay must be a number, got '2 µm'"),
        ({"hyper_um": 0.3}, "hyper_um must be numbers in µm or texts by name, got 0.3"),
        ({"effects": {"bar_length": "1 µm"}}, "effect bar_length must be a finite number in mm,"),
        ({"effects": {"bar_length": np.nan}}, "effect bar_length must be a finite number in mm,"),
        ({"effects": {"bar": 1e-3}}, "effect must be one of .*, got 'bar'"),
        ({"effects": 1e-3}, "effects must be numbers by name, got 0.001"),
    ],
)
def test_truths_of_another_kind_are_refused(arguments: dict, message: str) -> None:
    refuses(message, lb.HybridModel.default().simulate, plan(), seed=1, **arguments)


def test_machines_of_a_flat_prior_must_be_given() -> None:
    message = "parameters must be given when the prior is flat, got none. Pass true values."
    refuses(message, lb.HybridModel.paper(1).simulate, plan(), seed=1)


@pytest.fixture
def few_machines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ldbb_bayes.model.hybrid._MOST_MACHINES", 100)


@pytest.mark.usefixtures("few_machines")
def test_a_prior_that_leaves_no_machine_is_refused() -> None:
    model = lb.HybridModel.default(1).with_prior(C_XXX=("-60 nm/N", "5 nm/N"))
    message = "prior mean of C_XXX must leave .*, got -60 nm/N with the sd 5 nm/N: 100 machines"
    refuses(message, model.simulate, plan(), seed=1)


@pytest.mark.usefixtures("few_machines")
def test_slopes_that_leave_no_machine_are_refused() -> None:
    model = lb.HybridModel.default(1).with_prior(slope_scale=1e4)
    message = "prior slope_scale must let compliances be positive at every tested force, got 10000"
    refuses(message, model.simulate, plan(), seed=1)


def test_effects_and_private_noise_are_told_apart() -> None:
    """What tests have in common is named with its unit; what one test has is not kept."""
    model = lb.HybridModel.default()
    bound = model.bind(plan())
    simulation = model.simulate(plan(), seed=1)
    names: list[str] = []
    for columns in bound.nuisance_columns:
        if isinstance(columns, lb.terms.Columns) and not columns.private:
            names += columns.names
    assert list(simulation.effects) == names
    assert set(simulation.units) == {*simulation.parameters, *simulation.effects}
    assert simulation.units["force_gain"] == "1"
    assert simulation.units["mount"] == "mm/bar"
    assert simulation.units["joint_load_X_seat"] == "mm/N"
    assert not any(name.startswith(("setup", "discrepancy")) for name in simulation.effects)


def test_readings_follow_from_the_effects() -> None:
    """Without noise and private effects, parameters and effects are all that is in the readings."""
    model = lb.HybridModel.default(1).without("setup-shift", "discrepancy", "circle-scale")
    model = model.without("force-error")
    simulation = model.simulate(plan(), seed=4, hyper_um={"sigma": 0.0})
    bound = model.bind(plan())
    beta = np.array([simulation.parameters[name] for name in bound.names])
    coefficients = bound.interest_columns @ beta + bound.known_offset
    truth = bound.linearised_at(beta)
    for term in model.nuisances:
        for columns in term.columns(truth):
            values = np.array([simulation.effects[name] for name in columns.names])
            coefficients = coefficients + columns.values @ values
    for test, expected in zip(simulation.campaign.tests, coefficients, strict=True):
        readings = basis(test.angles_rad()) @ expected
        np.testing.assert_allclose(test.readings_mm(), readings, atol=1e-12)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_true_compliances_at_the_tested_forces(degree: int) -> None:
    """The formula of the model: C(F) is C + slopes + JointLoad's columns at u = 1, over F."""
    simulation = lb.HybridModel.default(degree).simulate(plan(), seed=2)
    force = np.array([36.0, 300.0, 520.0, 742.0])
    reference = 0.5 * (36.0 + 742.0)
    contact = np.cbrt(force**2 * reference)
    for name, axis in (("C_XXX", "X"), ("C_YYY", "Y"), ("C_XYX", None)):
        expected = np.full(4, simulation.parameters[name])
        for power in range(1, degree + 1):
            slope = simulation.parameters[f"{name}_{power}"]
            expected += slope * (force - reference) ** power
        if axis:
            slope, bolt, seat = (
                simulation.effects[f"joint_load_{axis}_{law}"]
                for law in ("slope", "contact", "seat")
            )
            rolling = force * (force - reference) / 742.0
            expected += (slope * rolling + (bolt + seat) * (contact - force)) / force
        true = simulation.change_with_force[name]
        assert true.unit == "mm/N"
        assert true.forces_N == tuple(force)
        np.testing.assert_allclose(true.at_forces, expected, rtol=1e-12, atol=1e-18)
        assert true.at_reference == pytest.approx(simulation.parameters[name], rel=1e-12)
        assert (true.at_smallest, true.at_largest) == (true.at_forces[0], true.at_forces[-1])
        assert true.change == pytest.approx(expected[-1] - expected[0], rel=1e-9, abs=1e-18)


def test_a_fit_recovers_the_true_compliances() -> None:
    """With next to no noise and nothing private, C(F) of a fit is the truth within a few u, and
    much nearer to it than the slope alone."""
    other_terms = [
        kind.key() for kind in lb.terms.Term.kinds.values() if kind is not lb.terms.JointLoad
    ]
    model = lb.HybridModel.default(1).without(*other_terms)
    planned = plan((360,) * 8, forces_N=np.linspace(40.0, 740.0, 8).tolist())
    scales_um = {"sigma": 0.1}
    simulation = model.simulate(planned, seed=3, parameters=TRUTH, hyper_um=scales_um)
    posterior = lb.sample(model, simulation.campaign, seed=1)
    changes = lb.analysis.change_with_force(posterior)
    for name in ("C_XXX", "C_YYY"):
        true = simulation.change_with_force[name]
        for end in ("at_smallest", "at_largest", "change"):
            value = getattr(changes[name], end)
            assert abs(value.mean - getattr(true, end)) < 4.0 * value.sd
        assert abs(true.change) > 10.0 * changes[name].change.sd


def test_without_joint_load_only_slopes_change_compliances() -> None:
    model = lb.HybridModel.default(1).without("joint-load")
    simulation = model.simulate(plan(), seed=1)
    true = simulation.change_with_force["C_XXX"]
    assert true.change == pytest.approx(706.0 * simulation.parameters["C_XXX_1"], rel=1e-9)
    constant = lb.HybridModel.paper().simulate(plan(), seed=1, parameters=TRUTH)
    assert constant.change_with_force["C_XXX"].change == 0.0
    assert constant.effects == {}
