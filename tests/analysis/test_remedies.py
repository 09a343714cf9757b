"""The cheapest remedy for every parameter, against the campaign that is really bound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import plan, simulated
from reports import plan_of_three_planes

import ldbb_bayes as lb
from ldbb_bayes.analysis.hyper_parameter_nodes import hyper_parameter_nodes
from ldbb_bayes.analysis.paired_remedies import paired_remedies
from ldbb_bayes.analysis.remedies import CURED_RATIO, Remedy, _choose_remedy, _Trial
from ldbb_bayes.analysis.tried_remedies import RemedyKind, RemedyStep, TriedRemedies, longer_plans
from ldbb_bayes.analysis.value_of_certificates import CERTIFICATES
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.hybrid import BoundModel

FORCES_N = (36.0, 136.0, 238.0, 364.0, 490.0, 616.0, 678.0, 742.0)
ANGLE = np.arange(72) * 5.0
DEFAULT = lb.HybridModel.default(0)


def one_way(forces_N: tuple[float, ...] = FORCES_N) -> lb.Campaign:
    """Circles in one direction, in the order of these forces."""
    return lb.Campaign(tuple(lb.CircularTest(force, ANGLE, direction="CW") for force in forces_N))


def sd_of(model: lb.HybridModel, campaign: lb.Campaign, parameter: str) -> float:
    """Return the standard uncertainty in the linear model, at the prior median of the scales."""
    bound = model.bind(campaign)
    phi = bound.hyper_prior.quantile(np.full(len(bound.hyper_prior.names), 0.5))
    information = information_of(bound, phi)
    sd = np.sqrt(information.variances()) * information.scale[information.interest]
    return float(sd[bound.names.index(parameter)])


def ratio_of(
    model: lb.HybridModel, with_remedy: lb.Campaign, without: lb.Campaign, parameter: str
) -> float:
    return sd_of(model, with_remedy, parameter) / sd_of(model, without, parameter)


def remedy_of(identified: lb.analysis.Identifiability, parameter: str) -> Remedy:
    remedy = identified.parameters[parameter].remedy
    assert remedy is not None
    return remedy


@pytest.fixture(scope="module")
def planned() -> lb.analysis.Identifiability:
    return lb.identify(DEFAULT, one_way())


def test_the_other_direction_as_a_longer_plan_has_it(planned: lb.analysis.Identifiability) -> None:
    """Lost motion looks like C_XYX until every circle is also run the other way."""
    remedy = remedy_of(planned, "C_XYX")
    assert remedy.kind == RemedyKind.DIRECTION
    assert remedy.circles == len(FORCES_N)
    tests = one_way().tests
    other = [replace(test, direction="CCW", name="") for test in tests]
    longer = lb.Campaign((*tests, *other))
    expected = ratio_of(DEFAULT, longer, one_way(), "C_XYX")
    assert remedy.ratio == pytest.approx(expected, rel=1e-9)
    assert remedy.ratio == pytest.approx(remedy.sd / planned.parameters["C_XYX"].sd, rel=1e-9)


def test_turned_balls_as_a_longer_plan_has_them(planned: lb.analysis.Identifiability) -> None:
    remedy = remedy_of(planned, "E_YX2")
    assert remedy.kind == RemedyKind.BALLS
    tests = one_way().tests
    further = [replace(t, work_ball_deg=45.0, tool_ball_deg=45.0, name="") for t in tests]
    longer = lb.Campaign((*tests, *further))
    expected = ratio_of(DEFAULT, longer, one_way(), "E_YX2")
    assert remedy.ratio == pytest.approx(expected, rel=1e-9)


@pytest.mark.slow
def test_a_certificate_as_a_certified_campaign_has_it() -> None:
    """The certified campaign has scales of its own, which differ somewhat."""
    campaign = simulated(one_way())
    identified = lb.identify(DEFAULT, campaign)
    remedy = remedy_of(identified, "E_XX1")
    assert remedy.kind == RemedyKind.CERTIFICATE
    assert remedy.certificate == "bar ± 1 µm"
    assert remedy.circles == 0
    instrument = lb.Instrument(**CERTIFICATES[remedy.certificate])
    certified = lb.identify(DEFAULT, replace(campaign, instrument=instrument))
    assert remedy.sd == pytest.approx(certified.parameters["E_XX1"].sd, rel=0.03)
    table = identified.certificates
    assert remedy.sd == pytest.approx(table[remedy.certificate]["E_XX1"], rel=0.01)
    assert remedy.ratio == pytest.approx(remedy.sd / identified.parameters["E_XX1"].sd, rel=1e-9)


def test_hyper_parameters_of_readings_are_carried_over_by_name() -> None:
    """With readings, φ is the posterior mean; what only the longer plan has is at its median."""
    campaign = simulated(one_way())
    identified = lb.identify(DEFAULT, campaign)
    bound = DEFAULT.bind(campaign)
    weight, nodes = hyper_parameter_nodes(bound)
    phi_of_readings = dict(zip(bound.hyper_prior.names, weight @ nodes, strict=True))
    plan_both_ways = longer_plans(bound)[RemedyKind.DIRECTION]
    longer = BoundModel(DEFAULT, plan_both_ways, pilot=campaign)
    names = longer.hyper_prior.names
    assert "eta" in names
    assert "eta" not in phi_of_readings
    median = longer.hyper_prior.quantile(np.full(len(names), 0.5))
    phi = np.array([phi_of_readings.get(name, median[k]) for k, name in enumerate(names)])
    information = information_of(longer, phi)
    sd = np.sqrt(information.variances()) * information.scale[information.interest]
    information_before = information_of(bound, weight @ nodes)
    sd_before = (
        np.sqrt(information_before.variances())
        * information_before.scale[information_before.interest]
    )
    place = longer.names.index("C_XYX")
    remedy = remedy_of(identified, "C_XYX")
    assert remedy.kind == RemedyKind.DIRECTION
    # The ratio is the one at the mean of φ; U now and U then are averaged over φ.
    assert remedy.ratio == pytest.approx(sd[place] / sd_before[place], rel=1e-6)
    assert remedy.sd == pytest.approx(remedy.ratio * identified.parameters["C_XYX"].sd)


def test_nothing_but_the_plan_changes_with_a_pilot() -> None:
    """A plan with the readings as pilot has the uncertainties of the campaign itself."""
    campaign = simulated(one_way())
    bound = DEFAULT.bind(campaign)
    phi = bound.hyper_prior.quantile(np.full(len(bound.hyper_prior.names), 0.5))
    timed = [replace(test, time_s=360.0 * k) for k, test in enumerate(campaign.plan().tests)]
    planned_again = BoundModel(
        DEFAULT, replace(campaign.plan(), tests=tuple(timed)), pilot=campaign
    )
    np.testing.assert_allclose(
        information_of(planned_again, phi).variances(),
        information_of(bound, phi).variances(),
        rtol=1e-6,
    )


@pytest.mark.parametrize("degree", [0, 1])
@pytest.mark.parametrize(
    "campaign",
    [
        pytest.param(one_way(), marks=pytest.mark.slow, id="eight"),
        pytest.param(one_way(FORCES_N[::2]), id="four"),
        pytest.param(plan(), id="unstated"),
    ],
)
def test_more_circles_are_for_what_is_measured_here(campaign: lb.Campaign, degree: int) -> None:
    for entry in lb.identify(lb.HybridModel.default(degree), campaign).parameters.values():
        if entry.remedy is not None and entry.remedy.kind == RemedyKind.CIRCLES:
            assert entry.verdict != "confounded"
            assert entry.origin_shares["measured here"] > 0.5  # type: ignore[index]


def test_circles_of_a_scattering_campaign_are_to_be_repeated() -> None:
    model = lb.HybridModel.first(0)
    remedy = remedy_of(lb.identify(model, plan()), "C_XYX")
    assert remedy.kind == RemedyKind.CIRCLES
    twice = lb.Campaign((*plan().tests, *(replace(test, name="") for test in plan().tests)))
    longer = replace(plan(), tests=twice.tests)
    assert remedy.ratio == pytest.approx(ratio_of(model, longer, plan(), "C_XYX"))


def test_both_directions_need_no_other_one() -> None:
    tests = one_way().tests
    both = lb.Campaign((*tests, *(replace(test, direction="CCW", name="") for test in tests)))
    assert RemedyKind.DIRECTION not in longer_plans(DEFAULT.bind(both))
    assert RemedyKind.DIRECTION in longer_plans(DEFAULT.bind(one_way()))


def test_a_plan_is_shuffled_without_further_circles() -> None:
    shuffled = longer_plans(DEFAULT.bind(one_way()))[RemedyKind.ORDER]
    forces = [test.force_N for test in shuffled.tests]
    assert sorted(forces) == list(FORCES_N)
    assert abs(np.corrcoef(forces, np.arange(8))[0, 1]) < 0.02
    assert RemedyKind.ORDER not in longer_plans(DEFAULT.without("drift").bind(one_way()))


def test_hyper_parameters_carried_to_another_campaign() -> None:
    """Those of the same name keep their values, new ones have their prior median."""
    short = DEFAULT.bind(one_way(FORCES_N[:4])).hyper_prior
    long = DEFAULT.bind(one_way()).hyper_prior
    phi = short.quantile(np.array([[0.2] * len(short.names), [0.7] * len(short.names)]))
    carried = long.values_from(short, phi)
    assert carried.shape == (2, len(long.names))
    median = long.quantile(np.full(len(long.names), 0.5))
    for k, name in enumerate(long.names):
        if name in short.names:
            np.testing.assert_array_equal(carried[:, k], phi[:, short.names.index(name)])
        else:
            assert carried[:, k] == pytest.approx(median[k])
    assert any(name not in short.names for name in long.names)


# Pairs of remedies


def tried_remedies(model: lb.HybridModel, campaign: lb.Campaign) -> TriedRemedies:
    """Return the remedies for a plan, tried at the prior median of the scales."""
    bound = model.bind(campaign)
    phi = bound.hyper_prior.quantile(np.full((1, len(bound.hyper_prior.names)), 0.5))[0]
    return TriedRemedies(bound, phi)


BAR = RemedyStep(RemedyKind.CERTIFICATE, "bar ± 1 µm")
BALLS = RemedyStep(RemedyKind.CERTIFICATE, "balls of grade G10")
TURNED = RemedyStep(RemedyKind.BALLS, "")


def test_two_certificates_as_a_certified_plan_has_them() -> None:
    statements = {**CERTIFICATES[BAR.certificate], **CERTIFICATES[BALLS.certificate]}
    certified = replace(one_way(), instrument=lb.Instrument(**statements))
    sd = tried_remedies(DEFAULT, one_way()).sd_with(BAR, BALLS)
    assert sd["E_XX1"] == pytest.approx(sd_of(DEFAULT, certified, "E_XX1"), rel=1e-9)


def test_a_longer_plan_with_a_certificate() -> None:
    tests = one_way().tests
    further = [replace(t, work_ball_deg=45.0, tool_ball_deg=45.0, name="") for t in tests]
    instrument = lb.Instrument(**CERTIFICATES[BAR.certificate])
    longer = lb.Campaign((*tests, *further), instrument=instrument)
    tried = tried_remedies(DEFAULT, one_way())
    sd = tried.sd_with(TURNED, BAR)
    assert sd["E_XX1"] == pytest.approx(sd_of(DEFAULT, longer, "E_XX1"), rel=1e-9)
    assert tried.circles_with(TURNED, BAR) == len(tests)


def test_a_certificate_is_not_tried_twice() -> None:
    tried = tried_remedies(DEFAULT, one_way())
    assert tried.bound_with(BAR, BAR) is None
    assert tried.sd_with(BAR, BAR) == {}


def test_pairs_are_for_what_one_remedy_leaves_confounded(
    planned: lb.analysis.Identifiability,
) -> None:
    tried = tried_remedies(DEFAULT, one_way())
    with_pair = []
    for name, entry in planned.parameters.items():
        pair = entry.paired_remedy
        if pair is None:
            continue
        with_pair.append(name)
        assert entry.verdict == "confounded"
        assert entry.remedy is not None
        assert pair.first == RemedyStep(entry.remedy.kind, entry.remedy.certificate)
        assert name in tried.confounded_with(pair.first)
        assert pair.sd < 0.9 * entry.remedy.sd
        assert pair.is_confounded is (name in tried.confounded_with(pair.first, pair.second))
        other_steps = [step for step in tried.steps if step != pair.first]
        best = min(tried.sd_with(pair.first, step).get(name, np.inf) for step in other_steps)
        assert pair.ratio < 1.021 * best / tried.sd_with()[name]
    assert with_pair


def test_what_one_remedy_frees_has_no_pair(planned: lb.analysis.Identifiability) -> None:
    tried = tried_remedies(DEFAULT, one_way())
    remedies = {name: entry.remedy for name, entry in planned.parameters.items()}
    sd = {name: entry.sd for name, entry in planned.parameters.items()}
    freed = []
    for name, remedy in remedies.items():
        if remedy is None:
            continue
        step = RemedyStep(remedy.kind, remedy.certificate)
        if name not in tried.confounded_with(step):
            freed.append(name)
    assert freed
    assert paired_remedies(tried, remedies, sd, freed) == {}


def test_circles_still_planned_are_the_cure_of_their_plane() -> None:
    """What is said of them is what a fit with them states; of the plane that has been run, others
    are named."""
    model = lb.HybridModel.first(0)
    campaign = simulated(plan_of_three_planes())
    run = campaign.select([test.name for test in campaign.tests if test.plane == "XY"])
    planned = tuple(test for test in campaign.tests if test.plane == "YZ")
    identified = lb.identify(model, replace(run, foreseen=planned))
    remedy = remedy_of(identified, "C_ZZZ")
    assert (remedy.kind, remedy.circles) == (RemedyKind.PLANNED, len(planned))
    both = campaign.select([test.name for test in campaign.tests if test.plane != "ZX"])
    assert remedy.sd == pytest.approx(lb.identify(model, both).parameters["C_ZZZ"].sd, rel=0.2)
    other = identified.parameters["C_XXX"].remedy
    assert other is None or other.kind != RemedyKind.PLANNED


@pytest.mark.parametrize("rounding", [-1e-15, 1e-15])
def test_which_of_equal_remedies_is_chosen_does_not_hang_on_rounding(rounding: float) -> None:
    """Both halve the variance: the first, which is the cheaper one, is enough."""
    halved = np.array([CURED_RATIO + rounding])
    helpful = [
        _Trial(RemedyKind.CIRCLES, "", 4, halved),
        _Trial(RemedyKind.RADIUS, "", 4, np.array([CURED_RATIO - 1e-15])),
    ]
    chosen = _choose_remedy(helpful, 0, 1.0)
    assert chosen is not None
    assert chosen.kind == RemedyKind.CIRCLES
