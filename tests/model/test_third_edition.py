"""The third edition of the model against the dense oracle: every term alone, all together and each
left out, on campaigns of every kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
import pytest
from campaigns import TRUTH, oracle_of, plan, refuses
from oracle import Estimate, Oracle, OracleMachine, Stated

import ldbb_bayes as lb
from ldbb_bayes.campaign.campaign import Ball, Campaign, CircularTest, Instrument, MountCompensation
from ldbb_bayes.inference.elastic_deflections import compliance_curves
from ldbb_bayes.machine.linear import compliance_jacobian, geometric_jacobian
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms.joints import compliance_along_travel

TERMS = {
    "ball-form": "form",
    "machine-pattern": "pattern",
    "bar-length": "length",
    "mount": "mount",
    "force-error": "force",
    "joint-load": "joint",
    "position": "position",
    "angle": "angle",
    "setup-shift": "setup",
    "discrepancy": "discrepancy",
    "hysteresis": "hysteresis",
    "drift": "drift",
    "circle-scale": "circle",
}
CERTIFIED = Instrument(
    work=Ball(grade="G20", harmonics_um=((2, 0.3, 35.0), (7, 0.1, -50.0)), U_um=0.08),
    tool=Ball(sphericity_um=0.7, harmonics_um=((3, 0.2, 110.0),), U_um=0.05),
    bar_length_error_um=-3.0,
    bar_U_um=1.2,
    mount_U_percent=2.0,
    force_U_percent=0.6,
    force_linearity_percent=0.3,
    force_random_N=1.5,
    angle_U_deg=0.05,
)
STATED = Stated(
    sphericity_um={"work": 0.5, "tool": 0.7},
    harmonics_um={
        "work": {2: (0.3, 35.0, 0.08), 7: (0.1, -50.0, 0.08)},
        "tool": {3: (0.2, 110.0, 0.05)},
    },
    length_error_um=-3.0,
    length_U_um=1.2,
    mount_U_percent=2.0,
    force_U_percent=0.6,
    linearity_percent=0.3,
    random_N=1.5,
    angle_U_deg=0.05,
)


FULL_CIRCLE = np.arange(36) * 10.0
ARC = np.linspace(-10.0, 230.0, 36)


def simulate(
    tests: int = 4,
    *,
    angle_deg: np.ndarray = FULL_CIRCLE,
    clocking_steps: tuple[float, float] = (0.0, 0.0),
    directions: Sequence[Literal["CW", "CCW"] | None] = (None,),
    radii: Sequence[float] = (150.0,),
    instrument: Instrument | None = None,
) -> Campaign:
    """Readings of a machine with waves and noise that are of no model; clockings of both balls grow
    by ``clocking_steps`` from test to test."""
    circles = []
    for i, force in enumerate(np.linspace(742.0, 36.0, tests)):
        circle = CircularTest(
            force,
            angle_deg + 0.7 * i,
            np.zeros(36),
            work_ball_deg=clocking_steps[0] * i + 15.0,
            tool_ball_deg=clocking_steps[1] * i,
            radius_mm=radii[i % len(radii)],
            direction=directions[i % len(directions)],
        )
        circles.append(circle)
    silent = Campaign(tuple(circles), mount=MountCompensation(compensated=False))
    machine = oracle_of(silent, 0, terms=())
    rng = np.random.default_rng(tests)
    reading = machine.J @ [TRUTH[name] for name in machine.names] - machine.y
    waves = np.cos(np.outer(machine.theta, [2, 4, 5])) @ [2e-3, 1e-3, 1e-3]
    noise = 5e-4 * rng.normal(size=reading.size)
    readings_um = np.split((reading + (waves + noise)) * 1e3, tests)
    measured = []
    for test, reading_um in zip(silent.tests, readings_um, strict=True):
        measured.append(test.with_reading_um(reading_um))
    campaign = replace(silent, tests=tuple(measured))
    if instrument is not None:
        campaign = replace(campaign, instrument=instrument)
    return campaign


WORK_BALL = Instrument(work=Ball(grade="G10"))
BOTH_BALLS = Instrument(work=Ball(grade="G10"), tool=Ball(sphericity_um=0.4))
HARMONICS = Instrument(tool=Ball(harmonics_um=((3, 0.2, 110.0), (5, 0.1, 20.0)), U_um=0.05))
STATED_OF = {
    CERTIFIED: STATED,
    WORK_BALL: Stated(sphericity_um={"work": 0.25}),
    BOTH_BALLS: Stated(sphericity_um={"work": 0.25, "tool": 0.4}),
    HARMONICS: Stated(harmonics_um={"tool": {3: (0.2, 110.0, 0.05), 5: (0.1, 20.0, 0.05)}}),
}


def timed(campaign: Campaign) -> Campaign:
    """Every test states its time; the listed order is another one."""
    times_s = 700.0 * np.arange(len(campaign.tests)) ** 1.5
    tests = []
    for test, time_s in zip(campaign.tests, np.roll(times_s, 2), strict=True):
        tests.append(replace(test, time_s=float(time_s)))
    return replace(campaign, tests=tuple(tests))


def without_a_time(campaign: Campaign) -> Campaign:
    """All tests but the first state their time."""
    first = replace(campaign.tests[0], time_s=None)
    return replace(campaign, tests=(first, *campaign.tests[1:]))


CAMPAIGNS = {
    "circles": simulate(),
    "three arcs": simulate(3, angle_deg=ARC),
    "one ball clocked": simulate(5, clocking_steps=(40.0, 0.0)),
    "both balls clocked": simulate(angle_deg=ARC, clocking_steps=(40.0, -25.0)),
    "both directions": simulate(6, directions=("CW", "CCW"), radii=(150.0, 150.0, 100.0)),
    "all at once": simulate(
        8,
        angle_deg=ARC,
        clocking_steps=(0.0, 70.0),
        directions=("CW", "CW", "CCW"),
        radii=(150.0, 100.0),
        instrument=CERTIFIED,
    ),
    "certified": simulate(directions=("CCW",), instrument=CERTIFIED),
    "one ball stated": simulate(instrument=WORK_BALL),
    "both balls stated": simulate(directions=("CW", "CCW"), instrument=BOTH_BALLS),
    "harmonics stated": simulate(instrument=HARMONICS),
    "clocked, one ball stated": simulate(5, clocking_steps=(40.0, 0.0), instrument=WORK_BALL),
    "clocked, both stated": simulate(5, clocking_steps=(0.0, 25.0), instrument=BOTH_BALLS),
    "times": timed(simulate(5)),
    "a time missing": without_a_time(timed(simulate(5))),
    "random order": replace(simulate(5), order="random"),
    "random order, times": replace(timed(simulate(5)), order="random"),
    "no drift": replace(timed(simulate(5)), drift=False),
}


class ModelAndOracle(NamedTuple):
    """The package's model, the oracle, and hyper-parameters by name and in the package's order."""

    bound: BoundModel
    oracle: Oracle
    phi_by_name: dict[str, float]
    phi: np.ndarray


def stated_of(campaign: Campaign) -> Stated:
    """What the campaign's certificates state, as the oracle has it."""
    for instrument, stated in STATED_OF.items():
        if campaign.instrument == instrument:
            return stated
    return Stated()


def model_and_oracle(
    campaign: Campaign, degree: int, terms: Sequence[str], **options: object
) -> ModelAndOracle:
    """Both with these terms alone; the oracle with further options."""
    left_out = [name for name in TERMS if name not in terms]
    bound = lb.HybridModel.default(degree).without(*left_out).bind(campaign)
    oracle = oracle_of(
        campaign,
        degree,
        terms=tuple(TERMS[name] for name in terms),
        edition="third",
        stated=stated_of(campaign),
        **options,
    )
    rng = np.random.default_rng(len(campaign.tests) + degree + len(terms))
    usual = {"sigma": 4e-4, "delta": 6e-4, "kappa": 4e-4, "tau": 1e-3, "omega": 5e-4, "eta": 8e-4}
    phi_by_name = {}
    for name in oracle.hypers:
        phi_by_name[name] = usual.get(name, 1.0) * float(np.exp(0.5 * rng.normal()))
    if "p" in phi_by_name:
        phi_by_name["p"] = float(rng.uniform(0.6, 3.4))
    oracle_names = {"decay": "p"}
    for r, test in enumerate(campaign.tests):
        oracle_names[f"lambda_{test.name}"] = f"lambda_{r + 1}"
    names = [oracle_names.get(name, name) for name in bound.hyper_prior.names]
    assert set(names) == set(phi_by_name)
    return ModelAndOracle(
        bound, oracle, phi_by_name, np.array([phi_by_name[name] for name in names])
    )


def check(pair: ModelAndOracle) -> None:
    """ln p(y | φ), ln p(y | φ, β), β given y and φ, and the prior of φ, of parameters in any
    order."""
    check_posterior_of_coefficients(pair)
    check_prior_of_hyper_parameters(pair)


def check_posterior_of_coefficients(pair: ModelAndOracle) -> None:
    bound = pair.bound
    oracle = pair.oracle
    order = [oracle.names.index(name) for name in bound.names]
    sd = oracle.sd[order]
    expected = oracle.given(pair.phi_by_name)
    mean = expected.mean[order]
    np.testing.assert_allclose(bound.prior_sd, sd, rtol=1e-8)
    log_evidence, conditional = bound.given(pair.phi[None])
    assert log_evidence[0] == pytest.approx(expected.log_evidence, rel=1e-8)
    np.testing.assert_allclose((conditional.mean[0] - mean) / sd, 0.0, atol=1e-8)
    conditional_sd = np.linalg.norm(conditional.spread()[0], axis=1)
    expected_sd = np.sqrt(np.diag(expected.covariance))[order]
    np.testing.assert_allclose(conditional_sd, expected_sd, rtol=1e-8)
    beta = mean + 0.1 * sd
    beta_by_name = dict(zip(bound.names, beta, strict=True))
    log_likelihood = oracle.log_likelihood(pair.phi_by_name, beta_by_name)
    assert bound.log_likelihood(pair.phi[None], beta[None])[0] == pytest.approx(
        log_likelihood, rel=1e-8
    )


def check_prior_of_hyper_parameters(pair: ModelAndOracle) -> None:
    prior = pair.bound.hyper_prior
    log_prior = pair.oracle.log_prior(pair.phi_by_name)
    assert prior.log_density(pair.phi) == pytest.approx(log_prior, rel=1e-10)
    free = prior.free(pair.phi)
    slopes = []
    for k, step in enumerate(1e-5 * np.eye(len(free))):
        difference = prior.phi(free + step) - prior.phi(free - step)
        slopes.append(difference[k] / 2e-5)
    assert prior.log_density_of_free(free) == pytest.approx(
        log_prior + np.log(slopes).sum(), rel=1e-8
    )


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("name", CAMPAIGNS)
def test_all_terms_together(name: str, degree: int) -> None:
    check(model_and_oracle(CAMPAIGNS[name], degree, list(TERMS)))


@pytest.mark.parametrize("term", TERMS)
@pytest.mark.parametrize("name", ["circles", "both directions", "all at once"])
def test_every_term_alone(name: str, term: str) -> None:
    check(model_and_oracle(CAMPAIGNS[name], 1, [term]))


@pytest.mark.slow
@pytest.mark.parametrize("term", TERMS)
@pytest.mark.parametrize("name", ["circles", "both directions", "all at once"])
def test_every_term_left_out(name: str, term: str) -> None:
    remaining = [name for name in TERMS if name != term]
    check(model_and_oracle(CAMPAIGNS[name], 1, remaining))


def test_force_curves_with_joint_load() -> None:
    """C_aa(F) by dense algebra, where the coefficients of the joint load are parameters beside the
    others."""
    bound, oracle, phi_by_name, phi = model_and_oracle(CAMPAIGNS["circles"], 1, list(TERMS))
    terms = tuple(set(TERMS.values()) - {"joint"})
    dense = oracle_of(bound.campaign, 1, terms=terms, edition="third", given_estimate=oracle.known)
    columns, sd = zip(*oracle.joint_columns(), strict=True)
    dense.J = np.column_stack([dense.J, *columns])
    dense.sd = np.append(dense.sd, sd)
    dense.mean = np.append(dense.mean, 6 * [0])
    expected = dense.given(phi_by_name)
    rng = np.random.default_rng(1)
    force = np.array([36.0, 150.0, 389.0, 742.0])
    phi_draws = np.tile(phi, (40_000, 1))
    beta = bound.given(phi[None])[1].draw(rng, (40_000,))[:, 0]
    plain = bound.model.without("joint-load").bind(bound.campaign)
    straight = compliance_curves(plain, phi_draws, beta, force, rng)
    curves = compliance_curves(bound, phi_draws, beta, force, rng)
    relative_force = (force - 389.0) / 742.0
    contact = np.cbrt(389.0 / force) - 1.0  # and seat
    law = np.stack([np.ones(4), force - 389.0, relative_force, contact, contact], axis=1)
    for k, axis, first in ((0, "C_XXX", -6), (2, "C_YYY", -3)):
        index = [dense.names.index(axis), dense.names.index(f"{axis}_1"), *range(first, first + 3)]
        covariance = expected.covariance[np.ix_(index, index)]
        u = np.sqrt(np.diag(law @ covariance @ law.T))
        error = curves[:, :, k].mean(axis=0) - law @ expected.mean[index]
        np.testing.assert_allclose(error / u, 0.0, atol=0.02)
        np.testing.assert_allclose(curves[:, :, k].std(axis=0), u, rtol=0.015)
        assert abs(straight[:, 0, k].std() / u[0] - 1.0) > 0.1
    # At F0, to the rounding of the sum with slopes times zero.
    np.testing.assert_allclose(curves[:, 2], beta[:, :6], rtol=1e-14)
    np.testing.assert_array_equal(curves[:, :, [1, 3, 4, 5]], straight[:, :, [1, 3, 4, 5]])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["three arcs", "both directions"])
def test_evidence(name: str) -> None:
    """Of all terms, truncation included: the oracle integrates over φ on its own."""
    campaign = replace(CAMPAIGNS[name], tests=CAMPAIGNS[name].tests[:3])
    expected, error = oracle_of(campaign, 1, edition="third").log_evidence(points=8192, seed=1)
    evidence = lb.log_evidence(lb.HybridModel.default(1), campaign, tolerance=1e-2)
    tolerance = 4.0 * (error + evidence.error)
    assert error < 0.01
    assert evidence.log_value == pytest.approx(expected, abs=tolerance, rel=0.0)


def three_planes() -> Campaign:
    """Four circles in every plane: XY is run one way, YZ and ZX both ways."""
    directions: dict[str, tuple[Literal["CW", "CCW"], ...]] = {
        "XY": ("CCW", "CCW", "CCW", "CCW"),
        "YZ": ("CW", "CCW", "CCW", "CCW"),
        "ZX": ("CW", "CW", "CCW", "CW"),
    }
    circles = []
    for plane, directions_of_plane in directions.items():
        for i, direction in enumerate(directions_of_plane):
            force = (100.0, 420.0, 700.0, 300.0)[i]
            angle_deg = FULL_CIRCLE + 0.7 * len(circles)
            radius_mm = (150.0, 100.0)[i % 2]
            circles.append(
                CircularTest(
                    force, angle_deg, plane=plane, radius_mm=radius_mm, direction=direction
                )
            )
    silent = Campaign(tuple(circles))
    truth = {"C_XXX": 5e-5, "C_YYY": 4e-5, "C_ZZZ": 3e-5, "E_XX1": 1e-5}
    return lb.HybridModel.first(0).simulate(silent, seed=4, parameters=truth).campaign


def machine_of(bound: BoundModel) -> OracleMachine:
    """The columns of a machine of several planes, circle by circle."""
    campaign = bound.campaign
    machine = campaign.machine()

    def stacked(columns: Callable[..., np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
        def at_angles(theta: np.ndarray) -> np.ndarray:
            blocks = []
            for test, angles in zip(
                campaign.tests, np.split(theta, len(campaign.tests)), strict=True
            ):
                blocks.append(columns(test, angles))
            return np.concatenate(blocks)

        return at_angles

    def compliance(test: CircularTest, angles: np.ndarray) -> np.ndarray:
        return compliance_jacobian(machine, test.circle, angles, bound.compliances)

    def geometric(test: CircularTest, angles: np.ndarray) -> np.ndarray:
        return geometric_jacobian(machine, test.circle, angles)

    return OracleMachine(
        [name.label for name in bound.compliances],
        [name.label for name in bound.geometric_errors],
        stacked(compliance),
        stacked(geometric),
    )


def test_three_planes() -> None:
    """Every plane has a form, a pattern and a hysteresis of its own."""
    campaign = three_planes()
    machine = machine_of(lb.HybridModel.default(0).bind(campaign))
    check(model_and_oracle(campaign, 1, list(TERMS), machine=machine))


def test_leaving_tests_out_changes_neither_estimate_nor_times() -> None:
    """The estimate Ĉ and the times from the mean are of the whole campaign."""
    campaign = CAMPAIGNS["all at once"]
    bound = lb.HybridModel.default(1).bind(campaign)
    names = bound.test_names[1::2]
    half = bound.keeping(names)
    np.testing.assert_array_equal(half.setting.compliance_estimate, bound.estimate.compliances)
    np.testing.assert_array_equal(half.setting.time_h, bound.setting.time_h[1::2])
    np.testing.assert_array_equal(half.prior_sd, bound.prior_sd)


def test_estimate_is_of_the_model() -> None:
    """Ĉ, u(Ĉ) and Ê by fixed point against the oracle's, and other terms give others."""
    pair = model_and_oracle(CAMPAIGNS["circles"], 2, list(TERMS))
    estimate = pair.bound.estimate
    expected_estimate = pair.oracle.known
    np.testing.assert_allclose(
        estimate.compliances, expected_estimate.compliance, rtol=1e-8, atol=1e-17
    )
    np.testing.assert_allclose(estimate.compliance_sd, expected_estimate.sd, rtol=1e-8)
    np.testing.assert_allclose(
        estimate.geometric_errors, expected_estimate.geometric, rtol=1e-7, atol=1e-14
    )
    without = pair.bound.model.without("joint-load").bind(pair.bound.campaign).estimate
    assert without.compliance_sd[0] < 0.9 * estimate.compliance_sd[0]


def test_plan_takes_the_estimate_of_its_pilot() -> None:
    """The covariance of the parameters from a plan's circles, as the pilot's estimate makes it."""
    pilot = CAMPAIGNS["circles"]
    plan = replace(simulate(clocking_steps=(40.0, 0.0)).plan(), order="random")
    expected_estimate = oracle_of(pilot, 1, edition="third").known
    check_covariance(lb.HybridModel.default(1), plan, pilot, expected_estimate)


def test_a_plan_takes_largest_force_and_reference_of_travel_from_its_own_tests() -> None:
    """As an analysis of its readings does, which knows nothing of the pilot."""
    pilot = CAMPAIGNS["circles"]
    tests = []
    for test in pilot.plan().tests:
        if test.force_N < 500.0:
            tests.append(replace(test, radius_mm=75.0, centre_x_mm=40.0))
    plan = replace(pilot.plan(), tests=tuple(tests))
    model = lb.HybridModel.default(1)
    planned = BoundModel(model, plan, pilot=pilot).setting
    analysed = BoundModel(model, plan).setting
    assert planned.largest_force_N == analysed.largest_force_N
    assert planned.reference_radius_mm == analysed.reference_radius_mm == 75.0
    assert planned.reference_centre_mm == analysed.reference_centre_mm
    assert planned.reference_force_N != analysed.reference_force_N


def test_plan_without_pilot_takes_usual_compliances() -> None:
    plan = CAMPAIGNS["circles"].plan()
    compliance = np.array([5e-5, 0.0, 5e-5, 0.0, 0.0, 0.0])
    usual = Estimate(compliance, np.zeros(6), np.zeros(7))
    check_covariance(lb.HybridModel.default(1), plan, None, usual)


def check_covariance(
    model: lb.HybridModel, plan: Campaign, pilot: Campaign | None, expected_estimate: Estimate
) -> None:
    """Covariance of β given φ = the prior medians; drift only where the listed order counts."""
    bound = BoundModel(model, plan, pilot=pilot)
    tests = []
    for test in plan.tests:
        tests.append(test.with_reading_um(np.zeros(len(test.angle_deg))))
    silent = replace(plan, tests=tuple(tests), drift=plan.order is None)
    dense = oracle_of(silent, model.degree, edition="third", given_estimate=expected_estimate)
    order = [dense.names.index(name) for name in bound.names]
    np.testing.assert_allclose(bound.prior_sd, dense.sd[order], rtol=1e-8)
    median = bound.hyper_prior.quantile(np.full((1, len(bound.hyper_prior.names)), 0.5))
    conditional = bound.given(median)[1]
    conditional_sd = np.linalg.norm(conditional.spread()[0], axis=1)
    expected = dense.given(dense.medians()).covariance
    np.testing.assert_allclose(conditional_sd, np.sqrt(np.diag(expected))[order], rtol=1e-8)


def test_hyper_parameters_of_what_is_stated_vanish() -> None:
    """With both balls stated, the form has no scale; its decay stays with the pattern alone."""
    campaign = CAMPAIGNS["both balls stated"]
    model = lb.HybridModel.default(1)
    names = model.bind(campaign).hyper_prior.names
    assert "tau" not in names
    assert {"omega", "decay"} <= set(names)
    plain = model.without("machine-pattern").bind(campaign).hyper_prior.names
    assert not {"tau", "omega", "decay"} & set(plain)
    assert "eta" in plain
    assert "eta" not in model.bind(CAMPAIGNS["circles"]).hyper_prior.names


def test_directions_of_some_tests_alone_are_refused() -> None:
    campaign = CAMPAIGNS["certified"]
    first = replace(campaign.tests[0], direction=None)
    mixed = replace(campaign, tests=(first, *campaign.tests[1:]))
    refuses(
        "'f742' must state its direction, CW or CCW, as circles of plane XY state theirs in other"
        " tests, got none. Give direction in every test",
        lb.HybridModel.default(1).bind,
        mixed,
    )


def test_first_edition_has_the_terms_it_had() -> None:
    """One direction, listed order and stated balls change nothing in the first edition."""
    bound = lb.HybridModel.first(1).bind(CAMPAIGNS["both balls stated"])
    assert not {"MachinePattern", "JointLoad", "Position", "Angle", "Drift"} & set(bound.terms)
    assert bound.hyper_prior.names == ("sigma", "delta", "kappa", "tau")
    one_way = lb.HybridModel.first(1).bind(CAMPAIGNS["certified"])
    assert "Hysteresis" not in one_way.terms


def test_plan_that_begins_with_the_tests_of_its_pilot_keeps_their_times() -> None:
    """Further tests count as run next, after those of the pilot, unless they state times."""
    pilot = simulate(3)
    further = replace(pilot.plan().tests[0], name="")
    longer = replace(pilot.plan(), tests=(*pilot.plan().tests, further))
    model = lb.HybridModel.default(1)
    hours = BoundModel(model, longer, pilot=pilot).setting.time_h
    np.testing.assert_allclose(hours, [-0.15, -0.05, 0.05, 0.15], atol=1e-15)
    further_alone = replace(pilot.plan(), tests=(further,))
    unknown = BoundModel(model, further_alone, pilot=pilot)
    assert np.isnan(unknown.setting.time_h).all()
    assert "Drift" not in unknown.terms
    stating = timed(pilot)
    late = replace(further, time_s=7200.0)
    longer = replace(stating.plan(), tests=(*stating.plan().tests, late))
    hours = BoundModel(model, longer, pilot=stating).setting.time_h
    times = [test.time_s for test in stating.tests]
    np.testing.assert_allclose(hours * 3600.0, np.array([*times, 7200.0]) - np.mean(times))
    without_time = replace(pilot.plan(), tests=(*stating.plan().tests, further))
    hours = BoundModel(model, without_time, pilot=stating).setting.time_h
    assert hours[-1] == pytest.approx((max(times) + 360.0 - np.mean(times)) / 3600.0)


def test_compliance_along_the_travel_of_circles_at_different_centres() -> None:
    """F u² x and F u² (x² − ½) at x = (centre + R u)/R₀, evaluated at angles."""
    tests = [
        replace(test, centre_x_mm=centre_mm, radius_mm=radius_mm)
        for test, centre_mm, radius_mm in zip(
            plan().tests, (-90.0, 0.0, 30.0, 60.0), (150.0, 100.0, 150.0, 100.0), strict=True
        )
    ]
    setting = lb.HybridModel.default(degree=0).bind(replace(plan(), tests=tuple(tests))).setting
    theta = np.linspace(0.0, 2 * np.pi, 50)
    u = np.cos(theta)
    columns = compliance_along_travel(setting, 0)
    for r, test in enumerate(tests):
        x = (float(test.centre_x_mm or 0.0) - setting.reference_centre_mm[0]) / 100.0
        x = x + float(test.radius_mm or 0.0) / 100.0 * u
        force_N = float(test.force_N or 0.0)
        values = basis(theta) @ columns[r]
        np.testing.assert_allclose(values[:, 0], force_N * u**2 * x, atol=1e-9)
        np.testing.assert_allclose(values[:, 1], force_N * u**2 * (x**2 - 0.5), atol=1e-9)
