"""Change of compliance with force: against draws in plain NumPy, and against an exact machine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from campaigns import plan, refuses, simulated

import ldbb_bayes as lb
from ldbb_bayes.analysis.compliance_change import ChangeWithForce, _change_if_any
from ldbb_bayes.analysis.curve_changes import curve_changes
from ldbb_bayes.inference.force_curves import force_curves, prior_changes
from ldbb_bayes.inference.posterior import bound_of, record_of
from ldbb_bayes.model.bound_information import information_of

SMALLEST_N = 36.0
LARGEST_N = 742.0
MIDDLE_N = 389.0
SPAN_N = LARGEST_N - SMALLEST_N
RADIUS_MM = 150.0
CAMPAIGN = simulated(plan((36,) * 4), seed=1)
MODEL = lb.HybridModel.first(1).with_term(lb.terms.JointLoad())
NAMES = ["C_XXX", "C_XYX", "C_YYY", "C_CXY", "C_CYY", "C_CCY"]


@pytest.fixture(scope="module")
def posterior() -> xr.DataTree:
    return lb.sample(MODEL, CAMPAIGN, sampler="independent", seed=1)


@pytest.fixture(scope="module")
def averaged() -> xr.DataTree:
    return lb.average({"constant": MODEL.with_degree(0), "linear": MODEL}, CAMPAIGN)


SHARE = (0.35, 0.3)  # of the deflection of X and Y that goes with force^⅔
COMPLIANCE = (6e-5, 4.5e-5)  # of X and Y at the middle force [mm/N]


def contact_campaign(share: tuple[float, float], compliance: tuple[float, float]) -> lb.Campaign:
    """Circles of a machine whose axes yield in part as contacts: deflection ~ force^⅔.

    The bar's force follows the deflected ball, and the reading is the exact distance of the balls.
    """
    angle = np.deg2rad(np.arange(0.0, 360.0, 6.0))
    rng = np.random.default_rng(5)
    nominal = RADIUS_MM * np.array([np.cos(angle), np.sin(angle)])
    tests = []
    for force_N in (36.0, 112.0, 238.0, 389.0, 565.0, 742.0):
        displacement = np.zeros_like(nominal)
        for _ in range(6):
            place = nominal + displacement
            load_N = force_N * place / np.hypot(*place)
            for k in range(2):
                contact_N = np.sign(load_N[k]) * np.cbrt(load_N[k] ** 2 * MIDDLE_N)
                displacement[k] = compliance[k] * (
                    (1.0 - share[k]) * load_N[k] + share[k] * contact_N
                )
        reading_um = (np.hypot(*(nominal + displacement)) - RADIUS_MM) * 1e3
        noise_um = rng.normal(0.0, 0.2, len(angle))
        tests.append(lb.CircularTest(force_N, np.rad2deg(angle), reading_um + noise_um))
    return lb.Campaign(tuple(tests), mount=lb.campaign.MountCompensation(compensated=True))


@pytest.fixture(scope="module")
def contact() -> xr.DataTree:
    return lb.sample(
        lb.HybridModel.default(1),
        contact_campaign(SHARE, COMPLIANCE),
        sampler="independent",
        seed=1,
    )


def draws_of(posterior: xr.DataTree, name: str) -> np.ndarray:
    return np.ravel(posterior["posterior"][name].values)


# ---- against draws in plain NumPy


@pytest.mark.parametrize("name", ["C_XYX", "C_CXY", "C_CYY", "C_CCY"])
def test_without_joint_load_it_is_the_slope_times_the_span(
    posterior: xr.DataTree, name: str
) -> None:
    at_middle = draws_of(posterior, name)
    slope = draws_of(posterior, f"{name}_1")
    expected = slope * SPAN_N
    entry = lb.analysis.change_with_force(posterior, prob=0.9)[name]
    assert entry.change.mean == pytest.approx(expected.mean(), rel=1e-9)
    assert entry.change.sd == pytest.approx(expected.std(ddof=1), rel=1e-9)
    assert entry.change.interval == pytest.approx(np.quantile(expected, [0.05, 0.95]), rel=1e-9)
    assert entry.probability_of_increase == np.mean(slope > 0.0)
    assert entry.probability_of_decrease == np.mean(slope < 0.0)
    at_smallest = at_middle + slope * (SMALLEST_N - MIDDLE_N)
    assert entry.at_smallest.mean == pytest.approx(at_smallest.mean(), rel=1e-9)
    at_largest = at_middle + slope * (LARGEST_N - MIDDLE_N)
    assert entry.at_largest.interval == pytest.approx(np.quantile(at_largest, [0.05, 0.95]))
    assert entry.at_reference.median == pytest.approx(np.median(at_middle), rel=1e-9)


def test_relative_is_the_ratio_of_each_draw(posterior: xr.DataTree) -> None:
    ratio = draws_of(posterior, "C_CXY_1") * SPAN_N / draws_of(posterior, "C_CXY")
    relative = lb.analysis.change_with_force(posterior)["C_CXY"].relative
    assert relative is not None
    assert relative.median == pytest.approx(np.median(ratio), rel=1e-9)
    assert relative.interval == pytest.approx(np.quantile(ratio, [0.025, 0.975]), rel=1e-9)


def test_relative_to_a_compliance_that_may_be_zero_is_not_stated(posterior: xr.DataTree) -> None:
    entry = lb.analysis.change_with_force(posterior, prob=0.999)["C_XYX"]
    assert entry.at_reference.ci_low < 0.0 < entry.at_reference.ci_high
    assert entry.relative is None


# Compliance that one unit of a coefficient of JointLoad adds at a force, by the last part of its
# name: F (F − F0)/F_max and F^⅔ F0^⅓ − F, over F.
SECANTS = {
    "slope": lambda force: (force - MIDDLE_N) / LARGEST_N,
    "contact": lambda force: np.cbrt(MIDDLE_N / force) - 1.0,
    "seat": lambda force: np.cbrt(MIDDLE_N / force) - 1.0,
}


@pytest.mark.parametrize("axis", ["X", "Y"])
def test_joint_load_is_in_the_change_of_a_direct_compliance(
    contact: xr.DataTree, axis: str
) -> None:
    nuisances = lb.inference.summarize_nuisances(contact)["mean"]
    name = f"C_{axis}{axis}{axis}"
    expected = draws_of(contact, f"{name}_1").mean() * SPAN_N
    of_slope = expected
    for coefficient, mean in nuisances.items():
        if str(coefficient).startswith(f"joint_load_{axis}_"):
            secant = SECANTS[str(coefficient).rpartition("_")[2]]
            expected += mean * (secant(LARGEST_N) - secant(SMALLEST_N))
    change = lb.analysis.change_with_force(contact)[name].change
    error = 4.0 * change.sd / np.sqrt(draws_of(contact, name).size)
    assert change.mean == pytest.approx(expected, abs=error)
    assert abs(expected - of_slope) > error, "a test in which joint load counts"


def test_at_the_reference_force_joint_load_adds_nothing(posterior: xr.DataTree) -> None:
    curves = force_curves(posterior).compliances["C_XXX"]
    np.testing.assert_allclose(curves.at_reference, draws_of(posterior, "C_XXX"), rtol=1e-12)


# ---- averages over models


def test_models_without_a_change_count(averaged: xr.DataTree) -> None:
    entry = lb.analysis.change_with_force(averaged)["C_XYX"]
    slope = draws_of(averaged, "C_XYX_1")
    constant = 1.0 - record_of(averaged)["averaged"]["probability"]["linear"]
    zero = 1.0 - entry.probability_of_increase - entry.probability_of_decrease
    assert zero == pytest.approx(constant, abs=1e-3)
    assert 0.01 < zero < 0.999, "a test in which both models count"
    assert entry.change.mean == pytest.approx(slope.mean() * SPAN_N, rel=1e-9)
    assert entry.change.sd == pytest.approx(slope.std(ddof=1) * SPAN_N, rel=1e-9)


def test_joint_load_changes_a_compliance_of_the_constant_model(averaged: xr.DataTree) -> None:
    curve = force_curves(averaged).compliances["C_XXX"].change
    slope = draws_of(averaged, "C_XXX_1")
    assert np.mean(curve == 0.0) < np.mean(slope == 0.0)


def test_the_interval_of_a_change_if_there_is_one_is_that_of_the_models_with_one(
    averaged: xr.DataTree,
) -> None:
    slope = draws_of(averaged, "C_XYX_1")
    expected = slope[slope != 0.0] * SPAN_N
    if_any = lb.analysis.change_with_force(averaged)["C_XYX"].if_any
    assert if_any is not None
    assert if_any.interval == pytest.approx(np.quantile(expected, [0.025, 0.975]), rel=1e-9)
    assert if_any.mean == pytest.approx(expected.mean(), rel=1e-9)


def test_a_model_whose_compliance_always_changes_has_no_such_interval(
    posterior: xr.DataTree,
) -> None:
    assert lb.analysis.change_with_force(posterior)["C_XYX"].if_any is None


def test_too_few_draws_with_a_change_have_no_interval() -> None:
    change = np.append(np.zeros(4000), np.arange(1.0, 20.0))
    assert _change_if_any(change, 0.95) is None
    if_any = _change_if_any(np.append(change, 20.0), 0.95)
    assert if_any is not None
    assert if_any.mean == 10.5


# ---- against an exact machine


def test_the_change_of_an_exact_contact_machine_is_in_its_interval(contact: xr.DataTree) -> None:
    changes = lb.analysis.change_with_force(contact)
    for k, name in enumerate(("C_XXX", "C_YYY")):
        secants = np.cbrt(MIDDLE_N / np.array([SMALLEST_N, LARGEST_N]))
        truth = COMPLIANCE[k] * SHARE[k] * (secants[1] - secants[0])
        entry = changes[name]
        assert entry.change.ci_low < truth < entry.change.ci_high
        assert entry.probability_of_decrease > 0.95
        by_slope = draws_of(contact, f"{name}_1").mean() * SPAN_N
        assert abs(entry.change.mean - truth) < 0.5 * abs(by_slope - truth)


# ---- which compliances change


def test_every_compliance_with_a_slope(posterior: xr.DataTree) -> None:
    assert list(lb.analysis.change_with_force(posterior)) == NAMES


def test_of_a_constant_model_the_axes_with_joint_load() -> None:
    constant = lb.sample(MODEL.with_degree(0), CAMPAIGN, sampler="independent", seed=1)
    changes = lb.analysis.change_with_force(constant)
    assert list(changes) == ["C_XXX", "C_YYY"]


def test_nothing_changes_in_a_constant_model_without_joint_load() -> None:
    model = MODEL.with_degree(0).without("joint-load")
    constant = lb.sample(model, CAMPAIGN, sampler="independent", seed=1)
    assert lb.analysis.change_with_force(constant) == {}


def test_one_force_shows_no_change() -> None:
    tests = tuple(replace(test, force_N=300.0) for test in CAMPAIGN.tests)
    campaign = replace(CAMPAIGN, tests=tests)
    constant = lb.sample(MODEL.with_degree(0), campaign, sampler="independent", seed=1)
    assert lb.analysis.change_with_force(constant) == {}


def test_a_reference_force_of_zero() -> None:
    model = replace(MODEL, reference_force_N=0.0).without("joint-load")
    posterior = lb.sample(model, CAMPAIGN, sampler="independent", seed=1)
    change = lb.analysis.change_with_force(posterior)["C_XYX"]
    assert change.reference_force_N == 0.0
    expected = draws_of(posterior, "C_XYX").mean()
    assert change.at_reference.mean == pytest.approx(expected, rel=1e-6)
    assert np.isfinite(lb.analysis.change_with_force(posterior)["C_XXX"].at_reference.mean)


# ---- priors


def test_prior_draws_have_the_prior_sd_of_the_linear_model(posterior: xr.DataTree) -> None:
    """The sd of draws is that of the change as a weighted sum of independent coefficients."""
    bound = bound_of(posterior)
    phi = bound.hyper_prior.quantile(np.full((1, len(bound.hyper_prior.names)), 0.5))[0]
    changes = curve_changes(bound, information_of(bound, phi))
    draws_by_name = prior_changes(posterior)
    assert list(draws_by_name) == list(changes)
    for name, draws in draws_by_name.items():
        assert draws.std() == pytest.approx(np.linalg.norm(changes[name].weights), rel=0.1), name


# ---- refusals and records


def test_joints_under_load_have_no_compliance_at_no_force() -> None:
    """With F0 = 0 two columns of JointLoad would be −F u², which is C_aa."""
    refuses("reference_force_N", replace(MODEL, reference_force_N=0.0).bind, CAMPAIGN)


def test_a_probability_that_is_none_is_refused(posterior: xr.DataTree) -> None:
    refuses("prob", lb.analysis.change_with_force, posterior, prob=95.0)


def test_the_record_is_read_back(posterior: xr.DataTree) -> None:
    change = lb.analysis.change_with_force(posterior)["C_XXX"]
    assert ChangeWithForce.from_dict(change.as_dict()) == change


# ---- what a table of parameters prints


def test_print_has_changes_and_details_has_slopes_too(posterior: xr.DataTree) -> None:
    table = lb.summarize(posterior)
    assert "C_XXX changes by" in str(table)
    assert "C_XXX_1" not in str(table)
    assert "C_XXX changes by" in table.details()
    assert "C_XXX_1" in table.details()


def test_the_table_itself_has_the_coefficients(posterior: xr.DataTree) -> None:
    table = lb.summarize(posterior)
    slope = draws_of(posterior, "C_XXX_1").mean()
    assert table.loc["C_XXX_1", "mean"] == pytest.approx(slope)
    assert "C_XXX changes by" not in table.index


def test_an_excerpt_prints_the_rows_that_were_asked_for(posterior: xr.DataTree) -> None:
    excerpt = lb.summarize(posterior).loc[["C_XXX", "C_XXX_1"]]
    assert "C_XXX_1" in str(excerpt)
    assert "changes by" not in str(excerpt)


def test_columns_alone_print_the_changes(posterior: xr.DataTree) -> None:
    assert "C_XXX changes by" in str(lb.summarize(posterior)[["unit", "mean", "sd"]])
