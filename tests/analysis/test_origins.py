"""Origins of the sources of uncertainty: measured here, stated or assumed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import plan

import ldbb_bayes as lb
from ldbb_bayes.analysis.origins import Origin, is_prior_stated, origins
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.terms.columns import NOISE, PARAMETERS

ANGLE = np.arange(60) * 6.0


def random_information(seed: int) -> Information:
    """Return information on 3 parameters and 5 nuisances from two tests of 9 readings."""
    rng = np.random.default_rng(seed)
    noise = []
    for _ in range(2):
        root = rng.standard_normal((9, 9))
        noise.append({NOISE: 0.3 * np.eye(9), "SetupShift": root @ root.T})
    return Information(
        names=("E_XX1", "E_YY1", "C_XXX", "a", "b", "c", "d", "e"),
        owners=(
            PARAMETERS,
            PARAMETERS,
            PARAMETERS,
            "Mount",
            "Mount",
            "BallForm",
            "BallForm",
            "Drift",
        ),
        scale=rng.uniform(0.5, 3.0, 8),
        flat=False,
        design=(rng.standard_normal((9, 8)), rng.standard_normal((9, 8))),
        noise=tuple(noise),
    )


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_sd_from_readings_by_flat_priors(seed: int) -> None:
    """The posterior with the priors of one nuisance and of all parameters left out, in numpy."""
    information = random_information(seed)
    precision = np.zeros((8, 8))
    for design, sources in zip(information.design, information.noise, strict=True):
        precision += design.T @ np.linalg.inv(sum(sources.values())) @ design
    sd = information.sd_from_readings()
    assert np.isnan(sd[:3]).all()
    for k in range(3, 8):
        prior = np.append(np.zeros(3), information.scale[3:] ** -2.0)
        prior[k] = 0.0
        flat_sd = np.sqrt(np.linalg.inv(precision + np.diag(prior))[k, k])
        assert sd[k] == pytest.approx(flat_sd / information.scale[k], rel=1e-9)


def test_what_a_parameter_imitates_is_not_seen() -> None:
    information = random_information(4)
    designs = []
    for design in information.design:
        imitated = design.copy()
        imitated[:, 6] = design[:, 0] - 2.0 * design[:, 2]
        designs.append(imitated)
    sd = replace(information, design=tuple(designs)).sd_from_readings()
    assert np.isinf(sd[6])
    assert np.isfinite(sd[[3, 4, 5, 7]]).all()


@pytest.mark.parametrize("seed", [5, 6])
def test_errors_of_all_sources_make_up_the_covariance(seed: int) -> None:
    information = random_information(seed)
    total = sum(information.error_covariances().values())
    interest = np.ix_(information.interest, information.interest)
    np.testing.assert_allclose(total, information.covariance()[interest], rtol=1e-9, atol=1e-12)


# Campaigns


def origins_of(model: lb.HybridModel, campaign: lb.Campaign) -> dict[tuple[str, str], Origin]:
    """Return the origins at the prior medians of the hyper-parameters."""
    bound = model.bind(campaign)
    phi = bound.hyper_prior.quantile(np.full(len(bound.hyper_prior.names), 0.5))
    return origins(bound, information_of(bound, phi))


def turned(step_deg: float) -> lb.Campaign:
    """Four forces at each of three clockings of both balls."""
    tests = []
    for turn in (0.0, step_deg, 2.0 * step_deg):
        for force in (36.0, 300.0, 520.0, 742.0):
            test = lb.CircularTest(force, ANGLE, work_ball_deg=turn, tool_ball_deg=turn)
            tests.append(test)
    return lb.Campaign(tuple(tests))


FIRST = lb.HybridModel.first(1)


def test_form_is_measured_at_the_orders_that_the_machine_cannot_make() -> None:
    """At orders 2 and 3 geometric errors look like it: what other orders say of it is no matter."""
    origin_of = origins_of(FIRST, plan())
    for order in (2, 3):
        assert origin_of[f"form_sin{order}", "BallForm"] == Origin.ASSUMED
    for order in (5, 6):
        assert origin_of[f"form_sin{order}", "BallForm"] == Origin.MEASURED
    assert origin_of["bar_length", "BarLength"] == Origin.ASSUMED
    assert origin_of["mount", "Mount"] == Origin.ASSUMED


def test_turned_balls_measure_the_form_of_all_orders() -> None:
    origin_of = origins_of(FIRST, turned(45.0))
    forms = {name: origin for (name, _), origin in origin_of.items() if "form_cos2" in name}
    unturned = origins_of(FIRST, turned(0.0))
    assert unturned["form_cos2", "BallForm"] == Origin.ASSUMED
    assert forms
    assert origins_of(FIRST, turned(45.0))["work_form_cos3", "BallForm"] == Origin.ASSUMED


def test_scatter_is_measured_here() -> None:
    origin_of = origins_of(FIRST, plan())
    for source in (NOISE, "SetupShift", "Discrepancy"):
        assert origin_of[source, source] == Origin.MEASURED


@pytest.mark.parametrize(
    ("instrument", "source", "origin"),
    [
        (lb.Instrument(), ("bar_length", "BarLength"), Origin.ASSUMED),
        (lb.Instrument(bar_U_um=1.0), ("bar_length", "BarLength"), Origin.STATED),
        (lb.Instrument(bar_U_um=1.0), ("mount", "Mount"), Origin.ASSUMED),
        (lb.Instrument(mount_U_percent=2.0), ("mount", "Mount"), Origin.STATED),
        (lb.Instrument(), ("ForceError", "ForceError"), Origin.ASSUMED),
        (lb.Instrument(force_random_N=1.0), ("ForceError", "ForceError"), Origin.STATED),
    ],
)
def test_certificates_state(
    instrument: lb.Instrument, source: tuple[str, str], origin: Origin
) -> None:
    assert origins_of(FIRST, replace(plan(), instrument=instrument))[source] == origin


def test_a_term_that_the_user_changed_is_stated() -> None:
    changed = FIRST.with_term(lb.terms.BarLength(sd_um=3.0))
    assert origins_of(FIRST, plan())["bar_length", "BarLength"] == Origin.ASSUMED
    assert origins_of(changed, plan())["bar_length", "BarLength"] == Origin.STATED


DEFAULT = lb.HybridModel.default(1)


@pytest.mark.parametrize(
    ("model", "coefficient", "stated"),
    [
        # Curvature switched off: the rest of the term is as large as nobody stated.
        (DEFAULT.with_rivals(), ("mount", "Mount"), False),
        (DEFAULT.with_rivals(), ("force_gain", "ForceError"), False),
        (DEFAULT.with_rivals(), ("ForceError", "ForceError"), False),
        (DEFAULT.with_term(lb.terms.Mount(relative_sd=0.02)), ("mount", "Mount"), True),
        (DEFAULT.with_term(lb.terms.Mount(relative_sd=0.02)), ("mount_curvature", "Mount"), False),
        (
            DEFAULT.with_term(lb.terms.Position(linear_sd=0.02)),
            ("position_X_linear", "Position"),
            True,
        ),
        (
            DEFAULT.with_term(lb.terms.Position(linear_sd=0.02)),
            ("position_X_quadratic", "Position"),
            False,
        ),
        # A term of the default model in the preset `first`, with the sizes of the package.
        (
            FIRST.with_term(lb.terms.JointLoad()),
            ("joint_load_X_slope", "JointLoad"),
            False,
        ),
        # Another covariate is another effect; nobody stated its size.
        (
            DEFAULT.with_term(lb.terms.Drift(over="temperature")),
            ("drift_temperature_length", "Drift"),
            False,
        ),
        (
            DEFAULT.with_term(lb.terms.Drift(over="temperature", length_um=1.0)),
            ("drift_temperature_length", "Drift"),
            True,
        ),
    ],
)
def test_only_sizes_that_the_user_gave_are_stated(
    model: lb.HybridModel, coefficient: tuple[str, str], stated: bool
) -> None:
    planned = plan()
    tests = []
    for k, test in enumerate(planned.tests):
        tests.append(replace(test, temperature_C=20.0 + k))
    origin = origins_of(model, replace(planned, tests=tuple(tests)))[coefficient]
    assert (origin == Origin.STATED) == stated


@pytest.mark.parametrize(
    ("model", "stated"),
    [
        (FIRST, set[str]()),
        (FIRST.with_prior(C_XXX=("60 nm/N", "5 nm/N")), {"C_XXX"}),
        (FIRST.with_prior(gain=1e-4), {"E_XX1", "E_YY1"}),
        (FIRST.with_prior(tau_um=1.0), set[str]()),
    ],
)
def test_priors_that_the_user_gave_are_stated(model: lb.HybridModel, stated: set[str]) -> None:
    bound = model.bind(plan())
    assert {name for name in bound.names if is_prior_stated(bound, name)} == stated


def test_the_origin_of_every_source_is_known() -> None:
    bound = BoundModel(lb.HybridModel.default(1), turned(45.0))
    phi = bound.hyper_prior.quantile(np.full(len(bound.hyper_prior.names), 0.5))
    information = information_of(bound, phi)
    assert set(information.shares()) <= set(origins(bound, information))
