"""Stiffness by direction: against the exact forward model, closed forms and plain NumPy."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from campaigns import HYPER_UM, TRUTH, plan, refuses, simulated
from scipy.stats import norm

import ldbb_bayes as lb
from ldbb_bayes.analysis import directional_stiffness
from ldbb_bayes.analysis.directional_stiffness import PlaneStiffness, stiffness_draws
from ldbb_bayes.analysis.stated_quantities import (
    AxialDirection,
    axial_direction,
    is_hardly_positive,
    stated_stiffness,
)
from ldbb_bayes.inference.coefficients import ModelDraws
from ldbb_bayes.inference.elastic_deflections import elastic_draws
from ldbb_bayes.machine.exact import exact_reading_mm
from ldbb_bayes.machine.linear import kept_compliances
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.report.stiffness_numbers import _principal_axis_note
from ldbb_bayes.report.translation import words_of

ANGLE = np.deg2rad(np.arange(360))
FORCE_N = 500.0
MODEL = lb.HybridModel.first(0)
QUIET = HYPER_UM | {"tau": 0.05, "delta": 0.05, "kappa": 0.05}
COMPLIANCES = {name: value for name, value in TRUTH.items() if name.startswith("C_")}


def campaign_of(
    *, longer_bar_um: float = 0.0, softer_mount_um_per_bar: float = 0.0, gain: float = 1.0
) -> lb.Campaign:
    """A simulated campaign with an error of the instrument that nothing states."""
    simulated = MODEL.simulate(plan((120,) * 4), seed=5, parameters=TRUTH, hyper_um=QUIET).campaign
    tests = []
    pressures_bar = simulated.pressures_bar
    for test, pressure_bar in zip(simulated.tests, pressures_bar, strict=True):
        added_um = longer_bar_um + softer_mount_um_per_bar * pressure_bar
        changed = test.with_reading_um(test.reading_um + added_um)
        force_N = float(test.force_N or 0.0) * gain
        tests.append(replace(changed, force_N=force_N, pressure_bar=pressure_bar))
    return replace(simulated, tests=tuple(tests))


def posterior_of(campaign: lb.Campaign) -> xr.DataTree:
    return lb.sample(MODEL, campaign, seed=1, sampler="independent")


def plane_of(posterior: xr.DataTree, force_N: float = FORCE_N) -> PlaneStiffness:
    return lb.stiffness(posterior, [force_N]).planes[0]


@pytest.fixture(scope="module")
def posterior() -> xr.DataTree:
    return posterior_of(campaign_of())


def exact_compliance(compliances: dict[str, float], circle: Any, machine: Any) -> np.ndarray:
    """Compliance along the bar of the exact model: change of the reading over the force."""
    loaded = exact_reading_mm(machine, circle, ANGLE, force_N=FORCE_N, compliances=compliances)
    return (loaded - exact_reading_mm(machine, circle, ANGLE)) / FORCE_N


# ---- the curve c(θ) against the exact model


def test_the_compliance_along_the_bar_is_that_of_the_exact_model() -> None:
    """Every compliance of every joint acts; each kept one stands for the sum of its set."""
    planned = plan()
    machine = planned.machine()
    circle = planned.tests[0].circle
    estimable = kept_compliances(machine, circle)
    rng = np.random.default_rng(2)
    sums = []
    compliances = {}
    for members, weights in zip(estimable.sets, estimable.weights, strict=True):
        values = rng.normal(5e-5, 1e-5, len(members)) * 1e-2 ** members[0].count("C_C")
        compliances |= dict(zip(members, values.tolist(), strict=True))
        sums.append(float(np.dot(weights, values)))
    bound = MODEL.bind(planned)
    beta = np.zeros((1, len(bound.names)))
    for compliance, value in zip(bound.compliances, sums, strict=True):
        beta[0, bound.names.index(compliance.label)] = value
    phi = np.ones((1, len(bound.hyper_prior.names)))
    draws = elastic_draws(
        ModelDraws(bound, phi, beta), [0], np.array([FORCE_N]), np.random.default_rng(0)
    )
    expected = exact_compliance(compliances, circle, machine)
    np.testing.assert_allclose(basis(ANGLE) @ draws.per_force[0, 0, 0], expected, rtol=1e-9)


def test_least_and_greatest_stiffness_lie_where_the_exact_model_puts_them(
    posterior: xr.DataTree,
) -> None:
    planned = plan()
    exact = exact_compliance(COMPLIANCES, planned.tests[0].circle, planned.machine())
    plane = plane_of(posterior)
    assert plane.least.ci_low < 1.0 / exact.max() < plane.least.ci_high
    assert plane.greatest.ci_low < 1.0 / exact.min() < plane.greatest.ci_high
    assert plane.ratio.ci_low < exact.max() / exact.min() < plane.ratio.ci_high


def test_the_band_holds_the_exact_curve(posterior: xr.DataTree) -> None:
    planned = plan()
    exact = exact_compliance(COMPLIANCES, planned.tests[0].circle, planned.machine())
    plane = plane_of(posterior)
    at_angles = exact[np.asarray(plane.angle_deg)]
    assert (plane.compliance_low < at_angles).all()
    assert (at_angles < plane.compliance_high).all()


def test_a_bolted_contact_deflects_as_its_law_says() -> None:
    """At 45°, the bar loads each joint with F/√2: the part of the term JointLoad is its law's."""
    campaign = plan()
    model = MODEL.with_term(lb.terms.JointLoad())
    setting = model.bind(campaign).setting
    deflections = lb.terms.JointLoad().deflections(setting, 0, 0, np.array([FORCE_N]))
    load_N = FORCE_N / np.sqrt(2.0)
    reference_N = setting.reference_force_N
    contact_mm = np.cbrt(load_N**2 * reference_N) / np.sqrt(2.0) - load_N / np.sqrt(2.0)
    at_45_degrees = basis(np.array([0.25 * np.pi])) @ deflections[0]
    np.testing.assert_allclose(at_45_degrees[0, 1], contact_mm, atol=0.005 * FORCE_N)


def test_compliances_of_the_draws_are_the_curves_along_the_axes() -> None:
    """With the term JointLoad too, the curve at 0° is the compliance of the first axis."""
    model = lb.HybridModel.default(1)
    posterior = lb.sample(model, campaign_of(), seed=1, sampler="independent")
    bound = model.bind(campaign_of())
    draws = directional_stiffness.elastic_draws_of(posterior, [0], np.array([742.0]), 200)
    labels = [compliance.label for compliance in bound.compliances]
    along_x = draws.per_force[:, 0, 0] @ basis(np.array([0.0]))[0]
    direct = draws.compliances[:, 0, labels.index("C_XXX")]
    np.testing.assert_allclose(along_x, direct, rtol=0.01, atol=2e-7)


# ---- errors of the instrument that cancel


def test_the_length_of_the_bar_changes_no_stiffness(posterior: xr.DataTree) -> None:
    plane = plane_of(posterior)
    longer = plane_of(posterior_of(campaign_of(longer_bar_um=8.0)))
    assert abs(longer.least.mean - plane.least.mean) < 0.05 * plane.least.sd


def test_the_mount_changes_the_stiffness_but_not_the_difference(posterior: xr.DataTree) -> None:
    plane = plane_of(posterior)
    softer = plane_of(posterior_of(campaign_of(softer_mount_um_per_bar=0.4)))
    assert abs(softer.least.mean - plane.least.mean) > 0.5 * plane.least.sd
    assert abs(softer.difference.mean - plane.difference.mean) < 0.1 * plane.difference.sd


def test_the_gain_of_the_force_changes_the_stiffness_but_not_the_ratio(
    posterior: xr.DataTree,
) -> None:
    plane = plane_of(posterior)
    stated_higher = plane_of(posterior_of(campaign_of(gain=1.05)), 1.05 * FORCE_N)
    assert stated_higher.least.mean > plane.least.mean + 0.3 * plane.least.sd
    assert abs(stated_higher.ratio.mean - plane.ratio.mean) < 0.15 * plane.ratio.sd


# ---- numbers against plain NumPy


def test_difference_cross_and_principal_axis_are_those_of_the_draws(
    posterior: xr.DataTree,
) -> None:
    draws = {name: np.ravel(posterior["posterior"][name].values) for name in COMPLIANCES}
    plane = plane_of(posterior)
    difference = draws["C_XXX"] - draws["C_YYY"]
    assert plane.difference_name == "C_XXX − C_YYY"
    np.testing.assert_allclose(plane.difference.mean, difference.mean(), rtol=0.01)
    assert plane.cross is not None
    np.testing.assert_allclose(plane.cross.mean, draws["C_XYX"].mean(), rtol=0.03)
    axis_deg = np.degrees(0.5 * np.arctan2(draws["C_XYX"], difference)).mean()
    np.testing.assert_allclose(plane.principal_axis.angle_deg, axis_deg, atol=0.1)


def test_off_the_machines_zero_tilts_are_in_the_tensor(posterior: xr.DataTree) -> None:
    """C_CXY, C_CYY and C_CCY turn the table about the machine's zero: a lever to the circle's
    centre makes a displacement of it. The remark on the sheet names them."""
    plane = plane_of(posterior)
    assert set(plane.tensor_of) == {"C_XXX", "C_XYX", "C_YYY"}
    tests = tuple(replace(t, centre_x_mm=300.0, centre_y_mm=-80.0) for t in campaign_of().tests)
    off_zero = plane_of(posterior_of(replace(campaign_of(), tests=tests)))
    tilts = {"C_CXY", "C_CYY", "C_CCY"}
    assert set(off_zero.tensor_of) == {"C_XXX", "C_XYX", "C_YYY"} | tilts
    english = words_of("en")
    assert "C_CCY" not in _principal_axis_note(plane, english)
    remark = _principal_axis_note(off_zero, english)
    assert remark.startswith("at the circle's centre, of C_XXX, C_XYX, C_YYY")
    assert "C_CCY" in remark


@pytest.mark.parametrize(
    ("language", "axis_alone"),
    [("en", "of C_YYY, C_YZY and C_ZZZ"), ("de", "aus C_YYY, C_YZY und C_ZZZ")],
)
def test_a_plane_without_tilts_has_no_remark_on_tilts(language: str, axis_alone: str) -> None:
    """In the plane YZ of a machine wXYFZSt, no tilt of an axis changes the readings."""
    tests = tuple(replace(test, plane="YZ") for test in plan().tests)
    bound = MODEL.bind(replace(plan(), tests=tests, topology="wXYFZSt"))
    compliances = np.tile([4e-5, 1e-6, 3e-5], (4, 1))
    curve = compliances @ bound.setting.elastic[0].T
    plane = directional_stiffness._plane_stiffness(bound, 0, FORCE_N, curve, compliances, 0.95)
    assert _principal_axis_note(plane, words_of(language)) == axis_alone


def test_in_a_plane_with_tilts_the_remark_names_them(posterior: xr.DataTree) -> None:
    remark = _principal_axis_note(plane_of(posterior), words_of("en"))
    assert remark.endswith("alone; the directions above count tilts of the axes as well")


def test_expanded_uncertainty_is_twice_the_standard_uncertainty(posterior: xr.DataTree) -> None:
    table = lb.stiffness(posterior).table()
    np.testing.assert_allclose(table["U_k2"].astype(float), 2.0 * table["sd"].astype(float))


def test_draws_for_tolerances_are_those_of_the_result(posterior: xr.DataTree) -> None:
    draws = stiffness_draws(posterior, FORCE_N)["XY"]
    plane = plane_of(posterior)
    np.testing.assert_allclose(draws["k_min"].mean(), plane.least.mean)
    np.testing.assert_allclose(draws["k_max"].mean(), plane.greatest.mean)
    np.testing.assert_allclose(draws["k_ratio"].mean(), plane.ratio.mean)


def test_stiffness_is_stated_at_both_ends_and_the_middle_of_the_forces(
    posterior: xr.DataTree,
) -> None:
    forces = [plane.force_N for plane in lb.stiffness(posterior).planes]
    assert forces == [36.0, 389.0, 742.0]


def test_an_averaged_posterior_has_a_stiffness() -> None:
    linear = lb.HybridModel.first(1).with_term(lb.terms.JointLoad())
    models = {"constant": linear.with_degree(0), "linear": linear}
    averaged = lb.average(models, simulated(plan((36,) * 4), seed=1))
    plane = plane_of(averaged)
    assert plane.least.ci_low < 1.0 / COMPLIANCES["C_XXX"] < plane.least.ci_high


def test_a_result_goes_to_json_and_back(posterior: xr.DataTree) -> None:
    result = lb.stiffness(posterior, [FORCE_N])
    again = lb.analysis.DirectionalStiffness.from_dict(result.as_dict())
    assert again.planes[0].least == result.planes[0].least
    np.testing.assert_allclose(again.planes[0].compliance, result.planes[0].compliance)


# ---- directions


def direction_of(angle_deg: np.ndarray) -> AxialDirection:
    return axial_direction(np.deg2rad(angle_deg), 0.95)


def test_directions_about_zero_have_their_mean_there() -> None:
    """179° and 1° are two degrees apart, and their mean is 0°, not 90°."""
    direction = direction_of(np.array([179.0, 1.0, 181.0, 359.0]))
    assert min(direction.angle_deg, 180.0 - direction.angle_deg) < 1e-9
    np.testing.assert_allclose(direction.sd_deg, 1.0)


def test_a_narrow_direction_has_the_spread_of_its_draws() -> None:
    draws_deg = np.random.default_rng(3).normal(120.0, 5.0, 20_000)
    direction = direction_of(draws_deg)
    np.testing.assert_allclose(direction.angle_deg, 120.0, atol=0.15)
    np.testing.assert_allclose(direction.U_deg, 10.0, rtol=0.02)
    np.testing.assert_allclose(direction.ci_high_deg - direction.ci_low_deg, 19.6, rtol=0.03)
    assert direction.is_determined


def test_a_direction_that_may_be_any_is_not_determined() -> None:
    direction = direction_of(np.arange(0.0, 180.0, 0.1))
    assert not direction.is_determined
    assert direction.concentration < 1e-9


def test_an_axis_that_may_be_either_of_two_is_not_determined() -> None:
    assert not direction_of(np.repeat([0.0, 90.0], [60, 40])).is_determined


def test_a_direction_known_within_a_degree_has_the_interval_of_its_draws() -> None:
    """Without tilts the softest direction is ½ atan2(C_XYX, C_XXX − C_YYY), here about 0°: its
    interval is that of a sample, and goes below 0°."""
    bound = MODEL.bind(plan())
    labels = [compliance.label for compliance in bound.compliances]
    rng = np.random.default_rng(11)
    compliances = np.zeros((2000, len(labels)))
    compliances[:, labels.index("C_XXX")] = rng.normal(5.5e-5, 1e-7, 2000)
    compliances[:, labels.index("C_YYY")] = rng.normal(4.2e-5, 1e-7, 2000)
    compliances[:, labels.index("C_XYX")] = rng.normal(6e-8, 1e-7, 2000)
    curve = compliances @ bound.setting.elastic[0].T
    plane = directional_stiffness._plane_stiffness(bound, 0, FORCE_N, curve, compliances, 0.95)
    cross = compliances[:, labels.index("C_XYX")]
    difference = compliances[:, labels.index("C_XXX")] - compliances[:, labels.index("C_YYY")]
    sample_deg = np.degrees(0.5 * np.arctan2(cross, difference))
    low, high = np.quantile(sample_deg, [0.025, 0.975])
    assert -1.0 < low < 0.0 < high < 1.0
    np.testing.assert_allclose(plane.softest.angle_deg, sample_deg.mean(), atol=1e-4)
    np.testing.assert_allclose(plane.softest.ci_low_deg, low, atol=1e-4)
    np.testing.assert_allclose(plane.softest.ci_high_deg, high, atol=1e-4)
    np.testing.assert_allclose(plane.stiffest.ci_low_deg, low + 90.0, atol=1e-4)


# ---- stiffness that is hardly determined


def test_a_compliance_near_zero_has_only_a_lower_limit_of_stiffness() -> None:
    draws = np.abs(np.random.default_rng(4).normal(0.0, 1e-6, 2000))
    stated = stated_stiffness(draws, 0.95)
    assert stated.only_lower_limit
    assert stated.ci_low > 4e5


def test_the_ratio_is_never_below_one(posterior: xr.DataTree) -> None:
    assert stiffness_draws(posterior, FORCE_N)["XY"]["k_ratio"].min() >= 1.0


# ---- three planes


def three_planes() -> Any:
    tests = []
    for plane in ("XY", "YZ", "ZX"):
        for test in plan().tests:
            tests.append(replace(test, plane=plane, name=f"{plane}{test.force_N:g}"))
    return MODEL.bind(replace(plan(), tests=tuple(tests)))


def principal(values: dict[str, float]) -> directional_stiffness.PrincipalStiffness:
    """Principal stiffnesses of compliances that are known exactly."""
    bound = three_planes()
    compliances = [values.get(compliance.label, 0.0) for compliance in bound.compliances]
    return directional_stiffness._principal_stiffness(
        bound, FORCE_N, np.tile(compliances, (3, 1)), 0.95
    )


def test_principal_stiffnesses_of_uncoupled_axes_are_those_of_the_axes() -> None:
    axes = principal({"C_XXX": 4e-5, "C_YYY": 6e-5, "C_ZZZ": 2e-5}).axes
    np.testing.assert_allclose([axis.stiffness.mean for axis in axes], [1 / 6e-5, 25e3, 50e3])
    np.testing.assert_allclose(np.abs(axes[0].direction), [0.0, 1.0, 0.0], atol=1e-6)


def test_coupled_axes_have_the_eigenvalues_of_the_tensor() -> None:
    """The tensor [[5, 1], [1, 5]] has the eigenvalues 6 and 4, at 45° to its axes."""
    axes = principal({"C_XXX": 5e-5, "C_YYY": 5e-5, "C_XYX": 2e-5, "C_ZZZ": 1e-5}).axes
    np.testing.assert_allclose(
        [axis.stiffness.mean for axis in axes], [1 / 6e-5, 1 / 4e-5, 1e5], rtol=1e-6
    )
    np.testing.assert_allclose(
        np.abs(axes[0].direction), [np.sqrt(0.5), np.sqrt(0.5), 0.0], atol=1e-6
    )


# ---- what is refused


def test_a_force_of_zero_is_refused(posterior: xr.DataTree) -> None:
    refuses("forces_N must be positive, got 0", lb.stiffness, posterior, [0.0])


def test_a_text_of_forces_is_refused(posterior: xr.DataTree) -> None:
    refuses("forces_N must be a list of numbers, got '300'", lb.stiffness, posterior, "300")


def test_a_probability_above_one_is_refused(posterior: xr.DataTree) -> None:
    refuses("prob must", lb.stiffness, posterior, prob=95.0)


@pytest.mark.parametrize(("lower_end", "expected"), [(0.19, True), (0.21, False)])
@pytest.mark.parametrize("prob", [0.9, 0.95])
def test_a_compliance_is_hardly_positive_where_its_interval_begins_below_a_fifth(
    lower_end: float, expected: bool, prob: float
) -> None:
    sd = (1.0 - lower_end) / norm.ppf(0.5 + 0.5 * prob)
    compliance = norm(1.0, sd).ppf((np.arange(20_000) + 0.5) / 20_000)
    assert is_hardly_positive(compliance, prob) is expected
