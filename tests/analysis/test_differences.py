"""Differences between campaigns: independent ones by hand, those of one instrument or machine by a
dense model of both at once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pytest
from campaigns import HYPER_UM, TRUTH, plan, refuses
from scipy import stats
from scipy.linalg import block_diag

import ldbb_bayes as lb
from ldbb_bayes.analysis.common_effects import (
    CampaignPosterior,
    JointDifference,
    Shared,
    distances_of_readings,
    joint_difference,
    worst_conflict,
)
from ldbb_bayes.analysis.differences import _rows_at_force
from ldbb_bayes.analysis.parameter_changes import (
    ChangedParameters,
    changed_parameters,
    differences_can_be_used,
)
from ldbb_bayes.analysis.similar_effects import machine_terms, prior_difference
from ldbb_bayes.inference.force_curves import draws_at
from ldbb_bayes.inference.posterior import campaign_of as campaign_of_posterior
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.setting import Setting
from ldbb_bayes.model.terms import BasisNoise
from ldbb_bayes.model.terms.columns import NOISE, PARAMETERS

MODEL = lb.HybridModel.first(1).without("truncation")
SIMULATED = lb.HybridModel.first(0)
PHI = np.array([HYPER_UM[name] * 1e-3 for name in (scale.name for scale in MODEL.scales)])


def campaign_of(
    seed: int,
    *,
    radii_mm: tuple[float, ...] = (150.0,),
    model: lb.HybridModel = SIMULATED,
    **options: object,
) -> lb.Campaign:
    planned = plan(**options)
    tests = [
        replace(test, radius_mm=r, name=f"{test.name} {r:g}")
        for r in radii_mm
        for test in planned.tests
    ]
    hyper = {
        name: value
        for name, value in HYPER_UM.items()
        if name in {scale.name for scale in model.scales}
    }
    return model.simulate(
        replace(planned, tests=tuple(tests)), seed=seed, parameters=TRUTH, hyper_um=hyper
    ).campaign


@pytest.fixture(scope="module")
def two() -> tuple[Any, Any]:
    campaigns = campaign_of(1), campaign_of(2, forces_N=(50.0, 200.0, 400.0, 800.0))
    first, second = (
        lb.sample(MODEL, campaign, seed=1, sampler="independent") for campaign in campaigns
    )
    return first, second


def test_independent_instruments(two: tuple[Any, Any]) -> None:
    first, second = two
    table = lb.analysis.compare_posteriors(first, second)
    one, other = (lb.summarize(posterior) for posterior in two)
    for name in ("E_XX1", "E_YX2", "C_XXX_1", "C_CCY_1"):
        assert table.loc[name, "difference"] == pytest.approx(
            other.loc[name, "mean"] - one.loc[name, "mean"], rel=1e-6
        )
        assert table.loc[name, "sd"] == pytest.approx(
            np.hypot(one.loc[name, "sd"], other.loc[name, "sd"]), rel=1e-3
        )
        half = 0.5 * (table.loc[name, "ci_high"] - table.loc[name, "ci_low"])
        assert half == pytest.approx(1.96 * table.loc[name, "sd"], rel=0.08)
        row = table.loc[name]
        assert row["ci_low"] < row["difference"] < row["ci_high"]
        assert row["probability_of_increase"] == pytest.approx(
            stats.norm.cdf(row["difference"] / row["sd"]), abs=0.03
        )
    # C is compared at the first one's reference force, 389 N; the second one's is 425 N.
    draws = second["posterior"]
    shifted = (draws["C_XXX"] - 36.0 * draws["C_XXX_1"]).to_numpy()
    assert table.loc["C_XXX", "second"] == pytest.approx(shifted.mean(), rel=1e-9)
    assert not any(name.startswith(("E_Xt", "E_Yt")) for name in table.index)
    assert table.attrs["conflict"] is None


@pytest.mark.parametrize("same_instrument", [False, True])
def test_at_another_force_a_compliance_contains_the_joint_load(same_instrument: bool) -> None:
    """The second campaign's C at the first one's reference force is a point of its curve C(F)."""
    model = lb.HybridModel.default(1)
    campaigns = campaign_of(1), campaign_of(2, forces_N=(50.0, 200.0, 400.0, 800.0))
    first, second = (
        lb.sample(model, campaign, seed=1, sampler="independent") for campaign in campaigns
    )
    table = lb.analysis.compare_posteriors(first, second, same_instrument=same_instrument)
    curve = draws_at(second, 389.0)
    for name in ("C_XXX", "C_YYY"):
        sd = curve[name].std()
        assert table.loc[name, "second"] == pytest.approx(curve[name].mean(), abs=0.3 * sd)
    if not same_instrument:
        both = np.hypot(sd, lb.summarize(first).loc["C_YYY", "sd"])
        assert table.loc["C_YYY", "sd"] == pytest.approx(both, rel=1e-3)


def test_one_instrument_at_the_mean_hyper_parameters(two: tuple[Any, Any]) -> None:
    """Normal intervals of what the two campaigns say together, narrower than of two instruments."""
    table = lb.analysis.compare_posteriors(*two, same_instrument=True)
    np.testing.assert_allclose(table["second"] - table["first"], table["difference"], rtol=1e-6)
    half = 0.5 * (table["ci_high"] - table["ci_low"])
    np.testing.assert_allclose(half, 1.959964 * table["sd"], rtol=1e-6)
    assert (table["sd"] < 1.05 * lb.analysis.compare_posteriors(*two)["sd"]).all()
    assert ((table["probability_of_increase"] > 0.5) == (table["difference"] > 0.0)).all()


def noise_of_tests(
    column_groups: list[Any], turns: list[np.ndarray], value: Any
) -> list[np.ndarray]:
    """Covariance of what each test has for itself, one matrix for every test."""
    noises = []
    for r, turn in enumerate(turns):
        covariance = np.eye(len(turn)) * value["sigma"] ** 2
        for columns in column_groups:
            if isinstance(columns, BasisNoise) or columns.private:
                values = turn if isinstance(columns, BasisNoise) else turn @ columns.values[r]
                scaled = values * columns.sd * value[columns.hyper]
                covariance = covariance + scaled @ scaled.T
        noises.append(covariance)
    return noises


def dense(
    bounds: list[BoundModel], gains: tuple[float, float] = (0.0, 0.0)
) -> tuple[np.ndarray, np.ndarray]:
    """Posterior of both parameter vectors at PHI from all readings stacked: y = J₁ β₁ + J₂ β₂ + N ν
    + noise, N shared by both; without a certificate, a quarter of the variance of the bar's length
    is (the radii of the balls), and the rest is of each campaign. The prior means of the force's
    gain are ``gains``."""
    value = dict(zip((scale.name for scale in MODEL.scales), PHI, strict=True)) | {None: 1.0}
    designs = []
    shared = []
    noises = []
    readings = []
    lengths = []
    for bound, gain_mean in zip(bounds, gains, strict=True):
        turns = [basis(test.angles_rad()) for test in bound.campaign.tests]
        designs.append(
            np.concatenate([turn @ bound.interest_columns[r] for r, turn in enumerate(turns)])
        )
        readings.append(np.concatenate([test.readings_mm() for test in bound.campaign.tests]))
        column_groups = [
            group for term in bound.model.nuisances for group in term.columns(bound.setting)
        ]
        columns = [
            group
            for group in column_groups
            if not isinstance(group, BasisNoise) and not group.private
        ]
        # The part of the bar's length that is common to both campaigns; the rest is below.
        is_certified = bounds[0].campaign.instrument.bar_U_um is not None
        common = {"bar_length": 1.0 if is_certified else 0.5}
        noises += noise_of_tests(column_groups, turns, value)
        shared.append(
            [
                np.concatenate(
                    [
                        turn @ c.values[r] * c.sd * value[c.hyper] * common.get(c.names[0], 1.0)
                        for c in columns
                    ],
                    axis=1,
                )
                for r, turn in enumerate(turns)
            ]
        )
        share = 0.75 * (not is_certified)
        (length,) = [c for c in columns if c.names[0] == "bar_length"]
        constant = np.concatenate([turn @ length.values[r] for r, turn in enumerate(turns)])
        lengths.append(share * length.sd[0] ** 2 * constant @ constant.T)
        expected = []
        for r, turn in enumerate(turns):
            mean = np.zeros(len(turn))
            for c in columns:
                if c.mean is not None:
                    mean = mean + turn @ c.values[r] @ c.mean
                if c.names == ("force_gain",):
                    mean = mean + turn @ c.values[r][:, 0] * gain_mean
            expected.append(mean)
        readings[-1] = readings[-1] - np.concatenate(expected)
    effects = np.concatenate([turn for campaign in shared for turn in campaign])
    jacobian = block_diag(*designs)
    covariance = effects @ effects.T + block_diag(*noises) + block_diag(*lengths)
    prior = np.concatenate([bound.prior_sd for bound in bounds])
    scaled = jacobian * prior
    gain = np.linalg.solve(covariance + scaled @ scaled.T, scaled).T * prior[:, None]
    return gain @ np.concatenate(readings), np.diag(prior**2) - gain @ (jacobian * prior**2)


def common_difference(bounds: list[BoundModel]) -> tuple[list[str], JointDifference]:
    names = [name for name in bounds[0].names if not name.startswith(("E_Xt", "E_Yt"))]
    return names, joint_difference(
        bounds,
        [PHI.copy(), PHI.copy()],
        [_rows_at_force(bound, names, 389.0) for bound in bounds],
        Shared(instrument=True),
    )


@pytest.mark.parametrize("work_deg", [0.0, 40.0])
def test_the_same_instrument(work_deg: float) -> None:
    """Against the dense model of both campaigns at once; with balls turned in one of them, whose
    forms both campaigns share."""
    bounds = [MODEL.bind(campaign_of(1)), MODEL.bind(campaign_of(2, work_deg=work_deg))]
    names, difference = common_difference(bounds)
    mean, covariance = dense([bound.with_two_balls() for bound in bounds] if work_deg else bounds)
    p = len(bounds[0].names)
    for k, name in enumerate(names):
        i = bounds[0].names.index(name)
        contrast = np.zeros(2 * p)
        contrast[i], contrast[p + i] = -1.0, 1.0
        sd = float(np.sqrt(contrast @ covariance @ contrast))
        assert difference.sd[k] == pytest.approx(sd, rel=1e-5), name
        assert difference.difference[k] == pytest.approx(contrast @ mean, abs=1e-5 * sd), name
        assert difference.means[0, k] == pytest.approx(
            mean[i], abs=1e-5 * np.sqrt(covariance[i, i])
        ), name


def with_law(campaign: lb.Campaign, slope_N_per_bar: float) -> lb.Campaign:
    """The same readings at the same pressures, whose forces another force law states."""
    law = lb.campaign.ForceLaw(slope_N_per_bar)
    tests = tuple(
        replace(test, force_N=law.force_N(float(test.pressure_bar or 0.0)))
        for test in campaign.tests
    )
    return replace(campaign, tests=tests, force_law=law)


@pytest.mark.parametrize("slope_N_per_bar", [122.0, 130.0])
def test_one_regulator_has_one_slope(slope_N_per_bar: float) -> None:
    """Against the dense model of both campaigns, in which the slope of the regulator is
    s₁ (1 + g) = s₂ (1 + g − ln(s₂/s₁)), g the gain that both share."""
    campaigns = campaign_of(1), with_law(campaign_of(2), slope_N_per_bar)
    bounds = [MODEL.bind(campaign) for campaign in campaigns]
    names, difference = common_difference(bounds)
    first_slope = campaigns[0].force_law.slope_N_per_bar
    mean, covariance = dense(bounds, (0.0, -np.log(slope_N_per_bar / first_slope)))
    p = len(bounds[0].names)
    for k, name in enumerate(names):
        if name.startswith("C_"):  # at the second one's reference force here
            continue
        for place in (bounds[0].names.index(name), p + bounds[0].names.index(name)):
            sd = float(np.sqrt(covariance[place, place]))
            campaign = int(place >= p)
            assert difference.means[campaign, k] == pytest.approx(mean[place], abs=1e-5 * sd)
    for name in ("C_XXX", "C_YYY", "C_CCY"):
        k = names.index(name)
        i = bounds[0].names.index(name)
        to_first_N = 389.0 - bounds[1].setting.reference_force_N
        contrast = np.zeros(2 * p)
        contrast[[i, p + i, p + bounds[1].names.index(f"{name}_1")]] = -1.0, 1.0, to_first_N
        sd = float(np.sqrt(contrast @ covariance @ contrast))
        assert difference.sd[k] == pytest.approx(sd, rel=1e-5), name
        assert difference.difference[k] == pytest.approx(contrast @ mean, abs=1e-5 * sd), name


def test_a_force_law_stated_anew_is_no_change_of_the_machine() -> None:
    """The same pressures moved the same machine by as much."""
    first, second = campaign_of(1), campaign_of(2)
    changes = []
    for slope_N_per_bar in (126.04, 130.0):
        restated = with_law(second, slope_N_per_bar)
        names, difference = common_difference([MODEL.bind(first), MODEL.bind(restated)])
        k = names.index("C_XXX")
        changes.append(difference.difference[k] / difference.sd[k])
    assert changes[1] == pytest.approx(changes[0], abs=0.05)


CERTIFIED = lb.Instrument(
    bar_length_error_um=10.0,
    bar_U_um=1.0,
    work=lb.Ball(harmonics_um=((2, 3.0, 35.0),), U_um=0.2),
)


@pytest.mark.parametrize("certified", [(True, True), (True, False), (False, True)])
def test_a_certificate_of_the_instrument_counts_once(certified: tuple[bool, bool]) -> None:
    """One that only one of the campaigns states is of the instrument of both; against the dense
    model in which both state it."""
    campaigns = [campaign_of(1), campaign_of(2)]
    stating = [replace(campaign, instrument=CERTIFIED) for campaign in campaigns]
    mean, covariance = dense([MODEL.bind(campaign) for campaign in stating])
    bounds = []
    for k, states in enumerate(certified):
        bounds.append(MODEL.bind(stating[k] if states else campaigns[k]))
    names, difference = common_difference(bounds)
    p = len(bounds[0].names)
    for k, name in enumerate(names):
        i = bounds[0].names.index(name)
        sd = float(np.sqrt(covariance[i, i]))
        assert difference.means[0, k] == pytest.approx(mean[i], abs=1e-5 * sd), name
        assert difference.means[1, k] == pytest.approx(mean[p + i], abs=1e-5 * sd), name


def test_a_certificate_in_one_campaign_is_no_disagreement() -> None:
    one_form = SIMULATED.without("ball-form", "bar-length")
    campaigns = [campaign_of(seed, model=one_form) for seed in (3, 103)]
    stated = replace(campaigns[1], instrument=lb.Instrument(bar_U_um=1.0))
    for second in (campaigns[1], stated):
        bounds = [MODEL.bind(campaigns[0]), MODEL.bind(second)]
        assert common_difference(bounds)[1].conflict.p_value > 0.01


@pytest.mark.parametrize(
    ("first", "second", "p_value"),
    [
        ((2.33, 2.0), (2.0, 2.0), 4.0 * stats.norm.sf(0.33 / np.hypot(0.0233, 0.02))),
        ((2.33, 2.0), (2.28, 2.0), None),
        ((2.33, None), (2.0, None), None),
        ((2.33, None), (2.0, 2.0), None),
        ((2.33, None), (1.5, 2.0), 4.0 * stats.norm.sf(0.83 / np.hypot(0.233, 0.015))),
    ],
)
def test_statements_of_one_mount_that_contradict_each_other(
    first: tuple[float, float | None],
    second: tuple[float, float | None],
    p_value: float | None,
) -> None:
    """Deflections in µm/bar with U in percent, or 10 % of one sd where nothing is stated. Readings
    are compensated for what is stated, so that they agree about the mount; they are compared as
    well, so that p is that of two comparisons."""
    bounds = []
    for seed, (deflection, percent) in zip((3, 4), (first, second), strict=True):
        campaign = campaign_of(seed)
        tests = tuple(
            test.with_reading_um(
                np.asarray(test.reading_um) + (2.33 - deflection) * float(test.pressure_bar or 0.0)
            )
            for test in campaign.tests
        )
        stated = replace(
            campaign,
            tests=tests,
            mount=lb.campaign.MountCompensation(deflection),
            instrument=lb.Instrument(mount_U_percent=percent),
        )
        bounds.append(MODEL.without("ball-form").bind(stated))
    names = list(bounds[0].names)
    conflict = joint_difference(
        bounds,
        [PHI[:3].copy(), PHI[:3].copy()],
        [_rows_at_force(bound, names, 389.0) for bound in bounds],
        Shared(instrument=True),
    ).conflict
    if p_value is None:
        assert conflict is None or conflict.p_value > 0.01
    else:
        assert conflict == ("mount", pytest.approx(p_value, rel=1e-6, abs=0.0))


def test_another_radius_is_another_length() -> None:
    """One certified length at 150 mm in both cancels, those of 150 and 100 mm do not."""
    certified = lb.Instrument(bar_U_um=18.0)

    def bound_of_radii(seed: int, *radii_mm: float) -> BoundModel:
        return MODEL.bind(replace(campaign_of(seed, radii_mm=radii_mm), instrument=certified))

    first = bound_of_radii(1, 150.0)
    equal_radii, shorter, both = (
        common_difference([first, bound_of_radii(2, *radii)])[1]
        for radii in ((150.0,), (100.0,), (150.0, 100.0))
    )
    k = common_difference([first, first])[0].index("E_XX1")
    single_sd = float(
        np.sqrt(
            first.given(PHI[None])[1].covariance[
                0, first.names.index("E_XX1"), first.names.index("E_XX1")
            ]
        )
    )
    assert equal_radii.sd[k] < 0.4 * np.sqrt(2.0) * single_sd
    assert shorter.sd[k] > 0.9 * np.sqrt(2.0) * single_sd
    assert both.sd[k] < 0.4 * shorter.sd[k]


def test_the_zero_of_the_bar_is_set_anew() -> None:
    """Two halves of campaigns whose readings differ by 5 µm in all: the machine's scale has not
    changed, and no interval says that it has."""
    first = campaign_of(1)
    longer = []
    for test in campaign_of(1).tests:
        longer.append(test.with_reading_um(np.asarray(test.reading_um) + 5.0))
    bounds = [MODEL.bind(first), MODEL.bind(replace(first, tests=tuple(longer)))]
    names, difference = common_difference(bounds)
    for name in ("E_XX1", "E_YY1"):
        k = names.index(name)
        assert 2e-5 < difference.difference[k] < 3.5e-5
        assert abs(difference.difference[k]) < difference.sd[k]


def test_two_instruments_taken_for_one() -> None:
    """Campaigns simulated with forms of their own disagree about them; with one instrument they
    hardly ever do."""
    name, p = common_difference([MODEL.bind(campaign_of(seed)) for seed in (1, 2)])[1].conflict
    assert name.startswith("form_")
    assert p < 1e-6
    one_form = SIMULATED.without("ball-form", "bar-length")
    p_values = []
    for seed in range(3, 11):
        bounds = [
            MODEL.bind(campaign_of(campaign_seed, model=one_form))
            for campaign_seed in (seed, seed + 100)
        ]
        p_values.append(common_difference(bounds)[1].conflict[1])
    assert min(p_values) > 0.01 / len(p_values)


def test_what_two_readings_say_of_two_coefficients() -> None:
    """n₁ ± s₁ and n₂ ± s₂ are |n₁ − n₂| / √(s₁² + s₂²) apart, whatever the prior; the p-value is
    that of the worst of two."""
    for prior_sd in (2.0, 20.0):
        informations = []
        means = []
        for value, noise in ((3.0, 1.0), (-1.0, 1.5)):
            scale = np.array([1.0, prior_sd, prior_sd])
            noises = ({NOISE: np.diag([1.0, noise**2, noise**2])},)
            informations.append(
                Information(
                    ("E", "form", "length"),
                    (PARAMETERS, "BallForm", "BarLength"),
                    scale,
                    False,
                    (np.eye(3),),
                    noises,
                )
            )
            means.append(
                np.array([0.0, value, 0.5 * value]) * prior_sd**2 / (prior_sd**2 + noise**2)
            )
        campaigns = [
            CampaignPosterior(information, list(information.names), mean, np.zeros(3))
            for information, mean in zip(informations, means, strict=True)
        ]
        distances = distances_of_readings(
            ["length", "form"], np.ones((2, 2)), [0.0, 0.0], campaigns
        )
        assert worst_conflict(distances, {}) == (
            "form",
            pytest.approx(2.0 * 2.0 * stats.norm.sf(4.0 / np.hypot(1.0, 1.5)), rel=1e-6),
        )


def test_readings_and_statements_are_compared_together() -> None:
    """Three distances of readings and three of statements, all by chance: in 1 % of all cases, not
    in 2 %, the worst of the six has p below 1 %."""
    names = ("length", "form", "mount")
    rng = np.random.default_rng(1)
    distances = np.abs(rng.standard_normal((20_000, 6)))
    p_values = []
    for row in distances:
        of_readings = dict(zip(names, row[:3], strict=True))
        of_statements = dict(zip(names, row[3:], strict=True))
        p_values.append(worst_conflict(of_readings, of_statements).p_value)
    share = np.mean(np.array(p_values) < 0.01)
    assert 0.008 < share < 0.012
    of_both = worst_conflict({"length": 2.0, "form": 3.0}, {"length": 4.0})
    assert of_both == ("length", pytest.approx(3.0 * 2.0 * stats.norm.sf(4.0)))
    assert worst_conflict({}, {}) is None


ELASTIC = MODEL.with_term(lb.terms.JointLoad()).with_term(lb.terms.Position())
FORCES_N = {"same": (36.0, 238.0, 490.0, 742.0), "other": (50.0, 200.0, 400.0, 800.0)}


class DenseCampaign(NamedTuple):
    """One campaign as it enters the dense model of two campaigns with one machine, at PHI."""

    parameters: np.ndarray  # effect of each parameter on the readings
    machine: np.ndarray  # effect of each coefficient of the machine's joints on the readings
    names: list[str]  # of these coefficients
    sd: np.ndarray  # their prior sd
    covariance: np.ndarray  # of the readings, from all other effects
    readings: np.ndarray  # less their prior mean


def dense_campaign(bound: BoundModel) -> DenseCampaign:
    value = dict(zip((scale.name for scale in MODEL.scales), PHI, strict=True)) | {None: 1.0}
    turns = [basis(test.angles_rad()) for test in bound.campaign.tests]
    covariance = block_diag(*(np.eye(len(turn)) * value["sigma"] ** 2 for turn in turns))
    readings = np.concatenate([test.readings_mm() for test in bound.campaign.tests])
    of_machine = []
    for term in bound.model.nuisances:
        for columns in term.columns(bound.setting):
            if isinstance(columns, BasisNoise):
                effects = block_diag(*(turn * columns.sd * value[columns.hyper] for turn in turns))
                covariance = covariance + effects @ effects.T
                continue
            blocks = [turn @ columns.values[r] for r, turn in enumerate(turns)]
            if columns.private:
                effects = block_diag(*blocks)
                sd = np.tile(
                    columns.sd * value[columns.hyper] * np.ones(len(columns.names)), len(turns)
                )
            else:
                effects = np.concatenate(blocks)
                sd = columns.sd * value[columns.hyper]
            if columns.mean is not None:
                readings = readings - effects @ columns.mean
            if type(term).__name__ in ("JointLoad", "Position"):
                of_machine.append((effects, columns.names, sd))
            else:
                covariance = covariance + (effects * sd) @ (effects * sd).T
    return DenseCampaign(
        np.concatenate([turn @ bound.interest_columns[r] for r, turn in enumerate(turns)]),
        np.concatenate([effects for effects, _, _ in of_machine], axis=1),
        [name for _, names, _ in of_machine for name in names],
        np.concatenate([sd for _, _, sd in of_machine]),
        covariance,
        readings,
    )


def one_law(bounds: list[BoundModel], names: list[str]) -> np.ndarray:
    """Coefficients of the second campaign for those of the first, written from the laws: a F²/F_max
    and b F^⅔ F0^⅓ are the same function of F."""
    first, second = (bound.setting for bound in bounds)
    values = []
    for name in names:
        if name.startswith("position"):
            values.append(1.0)
        elif name.endswith("slope"):
            values.append(second.largest_force_N / first.largest_force_N)
        else:
            values.append((first.reference_force_N / second.reference_force_N) ** (1.0 / 3.0))
    return np.array(values)


def stacked_posterior(
    campaigns: list[DenseCampaign], prior_sd: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of both parameter vectors and of the machine's coefficients in both
    campaigns, correlated by 0.99."""
    first, second = campaigns
    design = np.hstack(
        [
            block_diag(first.parameters, second.parameters),
            block_diag(first.machine, second.machine),
        ]
    )
    across = np.diag(0.99 * first.sd * second.sd)
    machine = np.block([[np.diag(first.sd**2), across], [across, np.diag(second.sd**2)]])
    prior = block_diag(np.diag(np.concatenate(prior_sd) ** 2), machine)
    covariance = block_diag(first.covariance, second.covariance) + design @ prior @ design.T
    gain = np.linalg.solve(covariance, design @ prior).T
    readings = np.concatenate([first.readings, second.readings])
    return gain @ readings, prior - gain @ design @ prior


@pytest.mark.parametrize("forces", list(FORCES_N))
def test_the_same_machine(forces: str) -> None:
    """Against the dense model of both campaigns at once in which the joints' laws are nearly one;
    at other forces, one of the campaigns has a narrower prior."""
    campaigns = [campaign_of(1), campaign_of(2, forces_N=FORCES_N[forces])]
    bounds = [ELASTIC.bind(campaign) for campaign in campaigns]
    names = [name for name in bounds[0].names if not name.startswith(("E_Xt0", "E_Yt0"))]
    rows = [_rows_at_force(bound, names, bounds[0].setting.reference_force_N) for bound in bounds]
    difference = joint_difference(bounds, [PHI, PHI], rows, Shared(machine=True))
    dense_campaigns = [dense_campaign(bound) for bound in bounds]
    ratio = one_law(bounds, dense_campaigns[0].names)
    first_sd = dense_campaigns[0].sd / np.maximum(ratio, 1.0)
    second_sd = dense_campaigns[1].sd * np.minimum(ratio, 1.0)
    dense_campaigns = [
        dense_campaigns[0]._replace(sd=first_sd),
        dense_campaigns[1]._replace(sd=second_sd),
    ]
    mean, covariance = stacked_posterior(dense_campaigns, [bound.prior_sd for bound in bounds])
    nothing = np.zeros(len(names))
    of_first = [rows[0][label] for label in bounds[0].names]
    of_second = [rows[1][label] for label in bounds[1].names]
    laws_of_first = [rows[0].get(label, nothing) for label in dense_campaigns[0].names]
    laws_of_second = [rows[1].get(label, nothing) for label in dense_campaigns[1].names]
    contrasts = np.concatenate(
        [-np.array(of_first), of_second, -np.array(laws_of_first), laws_of_second]
    ).T
    for k, name in enumerate(names):
        sd = float(np.sqrt(contrasts[k] @ covariance @ contrasts[k]))
        assert difference.sd[k] == pytest.approx(sd, rel=1e-5), name
        assert difference.difference[k] == pytest.approx(contrasts[k] @ mean, abs=1e-5 * sd), name


def test_a_law_of_the_joints_is_one_at_other_forces() -> None:
    """What it adds to the readings differs by a part proportional to F u² alone, which belongs to
    the compliance."""
    first, second = (ELASTIC.bind(campaign_of(1, forces_N=FORCES_N[key])) for key in FORCES_N)
    term = lb.terms.JointLoad()
    force_N = np.array([50.0, 123.0, 700.0])
    laws = [term.deflections(bound.setting, 0, 0, force_N) for bound in (first, second)]
    names = term.columns(first.setting)[0].names
    u_squared = first.setting.along(0, 2.0)[0]
    for j, name in enumerate(names):
        ratio = lb.terms.JointLoad.ratio(name, first.setting, second.setting)
        remainder = ratio * laws[1][:, :, j] - laws[0][:, :, j]
        proportional = force_N[:, None] * u_squared
        factor = (remainder * proportional).sum() / (proportional**2).sum()
        np.testing.assert_allclose(
            remainder, factor * proportional, atol=1e-9 * np.abs(remainder).max()
        )
        assert ratio != pytest.approx(1.0, abs=1e-3)


def test_the_pattern_of_each_direction_is_its_own() -> None:
    """A campaign in one direction and one in the other have no pattern and no travel in common."""
    bounds = []
    for direction in ("CW", "CCW"):
        campaign = campaign_of(1)
        tests = tuple(replace(test, direction=direction) for test in campaign.tests)
        bounds.append(ELASTIC.bind(replace(campaign, tests=tests)))
    assert machine_terms(bounds) == {"JointLoad"}
    assert machine_terms([bounds[0], bounds[0]]) == {"JointLoad", "Position", "MachinePattern"}


def test_a_grown_compliance_is_no_disagreement_about_the_joints() -> None:
    """Laws of the joints are the same in units of their prior sd, which grows with the compliance;
    in either order of the campaigns."""
    informations = []
    means = []
    prior_sd = np.array([[1.0], [3.0]])
    for (scale,) in prior_sd:
        noises = ({NOISE: np.diag([(0.1 * scale) ** 2])},)
        informations.append(
            Information(
                ("joint_load_X_seat",),
                ("JointLoad",),
                np.array([scale]),
                False,
                (np.eye(1),),
                noises,
            )
        )
        means.append(np.array([2.0 * scale]))
    campaigns = [
        CampaignPosterior(information, list(information.names), mean, np.zeros(1))
        for information, mean in zip(informations, means, strict=True)
    ]
    p_values = {}
    for units in ("prior sd", "1"):
        for order in (1, -1):
            distances = distances_of_readings(
                ["joint_load_X_seat"],
                (prior_sd if units == "prior sd" else np.ones((2, 1)))[::order],
                [0.14],
                campaigns[::order],
            )
            p_values[units, order] = worst_conflict(distances, {}).p_value
    assert p_values["prior sd", 1] == p_values["prior sd", -1] > 0.5
    assert p_values["1", 1] < 1e-6


@pytest.mark.parametrize("radius_mm", [150.0, 100.0])
def test_one_machine_shows_smaller_changes(radius_mm: float) -> None:
    """The joints' laws cancel: changes of compliance are better known, geometric errors as before;
    at another radius the travel differs, and the laws along it are others."""
    model = lb.HybridModel.default(1)
    first, second = (
        lb.sample(model, campaign, seed=1, sampler="independent")
        for campaign in (campaign_of(1, radii_mm=(radius_mm,)), campaign_of(2))
    )
    instrument, both = (
        lb.analysis.compare_posteriors(
            first, second, same_instrument=True, same_machine=same_machine
        )["sd"]
        for same_machine in (False, True)
    )
    assert both["C_XXX_1"] < 0.6 * instrument["C_XXX_1"]
    assert both["E_C0YX"] == pytest.approx(instrument["E_C0YX"], rel=1e-3)
    if radius_mm == 150.0:
        assert both["C_XXX"] < 0.85 * instrument["C_XXX"]
        assert both["C_CYY"] < 0.8 * instrument["C_CYY"]
    else:
        assert both["C_CYY"] == pytest.approx(instrument["C_CYY"], rel=0.02)


def at_height(z_mm: float, seed: int) -> lb.Campaign:
    planned = plan()
    tests = tuple(replace(test, plane="YZ", centre_z_mm=z_mm) for test in planned.tests)
    return MODEL.simulate(replace(planned, tests=tests), seed=seed, hyper_um=HYPER_UM).campaign


def test_circles_at_other_heights_are_other_circles() -> None:
    """What belongs to circles of one centre is then not the same in both campaigns."""
    low, same, high = (
        ELASTIC.bind(at_height(z_mm, seed)) for seed, z_mm in enumerate((0.0, 0.0, 20.0))
    )
    assert machine_terms([low, same]) >= {"JointLoad", "Position"}
    assert machine_terms([low, high]) == {"JointLoad"}


def test_compliances_that_are_other_sums_are_not_compared(two: tuple[Any, Any]) -> None:
    """300 mm higher, tilts of the axes add to C_XXX; one millimetre changes nothing."""
    for z_mm in (1.0, 300.0):
        planned = plan()
        tests = tuple(replace(test, centre_z_mm=z_mm) for test in planned.tests)
        campaign = SIMULATED.simulate(replace(planned, tests=tests), seed=3).campaign
        higher = lb.sample(MODEL, campaign, seed=1, sampler="independent")
        if z_mm == 1.0:
            lb.analysis.compare_posteriors(two[0], higher)
        else:
            refuses("mean the same by C_", lb.analysis.compare_posteriors, two[0], higher)


def test_chance_among_many_comparisons_is_allowed_for() -> None:
    """Holm by hand: of three p-values 0.004, 0.02 and 0.04, 3 × 0.004 and 2 × 0.02 are below 5 %,
    and so is 0.04 alone; of 0.004, 0.03 and 0.04 only the first is."""
    for p_values, by_holm in (
        ((0.004, 0.02, 0.04), ("C_XXX", "C_YYY", "E_XX1")),
        ((0.004, 0.03, 0.04), ("C_XXX",)),
    ):
        increase = 1.0 - 0.5 * np.array([*p_values, 0.001, 0.5])
        table = pd.DataFrame(
            {"probability_of_increase": [increase[0], 1.0 - increase[1], *increase[2:4]]},
            index=["C_XXX", "C_YYY", "E_XX1", "C_XXX_1"],
        )
        changed = changed_parameters(table, 0.95)
        assert changed == ChangedParameters(("C_XXX", "C_YYY", "E_XX1"), by_holm, 3)
    assert changed_parameters(table, 0.99).alone == ("C_XXX",)


def test_changes_are_of_a_probability_between_0_and_1() -> None:
    table = pd.DataFrame({"probability_of_increase": [0.999]}, index=["C_XXX"])
    refuses("prob must be a number between 0 and 1, got 95", changed_parameters, table, 95)


@pytest.mark.parametrize(
    ("first", "second", "named"),
    [
        ({"serial_number": "1"}, {"serial_number": "2"}, "serial_number must be the same"),
        ({"machine_id": "A"}, {"machine_id": "B"}, "machine_id must be the same"),
        ({"machine_id": "A"}, {"serial_number": "2"}, None),
        ({"serial_number": "1", "machine_id": "A"}, {"serial_number": "1"}, None),
        ({"serial_number": "1"}, {}, None),
    ],
)
def test_other_machines_are_not_one(
    two: tuple[Any, Any], first: dict[str, str], second: dict[str, str], named: str | None
) -> None:
    posteriors = [
        lb.sample(MODEL, replace(campaign_of_posterior(posterior), **stated), sampler="independent")
        for posterior, stated in zip(two, (first, second), strict=True)
    ]
    if named is None:
        lb.analysis.compare_posteriors(*posteriors, same_machine=True)
    else:
        refuses(named, lb.analysis.compare_posteriors, *posteriors, same_machine=True)
        lb.analysis.compare_posteriors(*posteriors, same_instrument=True)


@pytest.mark.slow
def test_differences_that_cannot_be_are_refused(two: tuple[Any, Any]) -> None:
    constant = lb.HybridModel.first(0)
    other = lb.sample(
        constant,
        constant.simulate(replace(plan(), topology="wYFXZt"), seed=1).campaign,
        sampler="independent",
    )
    refuses("same topology", lb.analysis.compare_posteriors, two[0], other)
    refuses("different readings", lb.analysis.compare_posteriors, two[0], two[0])
    flat = [
        lb.sample(lb.HybridModel.paper(0), campaign_of(seed), seed=1, sampler="independent")
        for seed in (1, 2)
    ]
    refuses("proper priors", lb.analysis.compare_posteriors, *flat, same_instrument=True)
    averaged = lb.average({"linear": lb.HybridModel.first(1)}, campaign_of(1))
    refuses(
        "one model each", lb.analysis.compare_posteriors, two[1], averaged, same_instrument=True
    )
    lb.analysis.compare_posteriors(two[1], averaged)


@pytest.fixture
def guide_waves() -> Iterator[lb.terms.Term]:
    """A term of one's own, cos 2θ and sin 2θ of the machine, the same in every campaign."""

    @dataclass(frozen=True)
    class GuideWaves(lb.terms.Term):
        machine = True

        def columns(self, setting: Setting) -> tuple[lb.terms.Columns, ...]:
            names = ("guide_waves_cos2", "guide_waves_sin2")
            return (lb.terms.Columns(names, setting.harmonics([2]), 4e-3),)

    yield GuideWaves()
    lb.terms.Term.kinds.pop("GuideWaves")


def test_a_term_of_the_machine_that_does_not_change_cancels(guide_waves: lb.terms.Term) -> None:
    """It moves the squareness of both campaigns by as much."""
    sd = {}
    for model in (MODEL, MODEL.with_term(guide_waves)):
        bounds = [model.bind(campaign_of(seed)) for seed in (1, 2)]
        rows = [_rows_at_force(bound, ["E_C0YX"], 389.0) for bound in bounds]
        for same_machine in (True, False):
            shared = Shared(instrument=True, machine=same_machine)
            difference = joint_difference(bounds, [PHI.copy(), PHI.copy()], rows, shared)
            sd[model is MODEL, same_machine] = difference.sd[0]
    assert sd[False, True] == pytest.approx(sd[True, True], rel=1e-3)
    assert sd[False, False] > 2.0 * sd[True, False]


@pytest.mark.parametrize("name", ["bar_length", "joint_load_X_slope"])
def test_the_prior_of_a_difference_is_that_of_two_correlated_coefficients(name: str) -> None:
    correlation = lb.terms.Term.owner(name).campaign_correlation
    covariance = np.array([[1.0, correlation], [correlation, 1.0]])
    first, second = np.random.default_rng(2).multivariate_normal(np.zeros(2), covariance, 200_000).T
    assert prior_difference(name) == pytest.approx(np.std(second - first), rel=0.01)


@pytest.mark.parametrize(("p_value", "expected"), [(0.009, False), (0.011, True)])
def test_differences_are_of_no_use_where_common_effects_contradict_each_other(
    p_value: float, expected: bool
) -> None:
    assert differences_can_be_used({"conflict": ("mount", p_value)}) is expected
