"""conformity(): probabilities against the normal distribution and the draws, decisions by the guard
band; judge_certificate()."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from campaigns import cases, plan, refuses, simulated
from scipy import stats

import ldbb_bayes as lb
from ldbb_bayes.analysis.conformity import _decide_by_draws
from ldbb_bayes.analysis.decision_rule import Decision
from ldbb_bayes.analysis.normal_conformity import normal_conformity, stiffness_conformity
from ldbb_bayes.analysis.toleranced_draws import TolerancedDraws
from ldbb_bayes.analysis.tolerances import Quantity, quantities_of, tolerances_in
from ldbb_bayes.analysis.usability import Reason, ReasonKind, Use, judge_certificate
from ldbb_bayes.analysis.verdicts import Verdict
from ldbb_bayes.campaign.tested_forces import force_to_state
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.fit import Concern, ConcernKind
from ldbb_bayes.inference.posterior import campaign_of, curves_of, fit_of
from ldbb_bayes.report.conformity_tables import conformity_table
from ldbb_bayes.results import lines_of

CAMPAIGN = simulated(plan((36,) * 4), seed=1)
MODEL = lb.HybridModel.default(1)
TABLES: dict[str, Any] = cases(__file__, "refusals.toml")


@pytest.fixture(scope="module")
def posterior() -> Any:
    return lb.sample(MODEL, CAMPAIGN, sampler="independent", seed=1)


def test_half_at_the_mean_and_95_percent_at_1_64_u(posterior: Any) -> None:
    table = lb.summarize(posterior)
    for name in ("C_XXX", "C_YYY"):
        mean, sd = table.loc[name, ["mean", "sd"]]
        for upper, expected in (
            (mean, 0.5),
            (mean + 1.645 * sd, 0.95),
            (mean - 1.645 * sd, 0.05),
            (mean + 3.0 * sd, 0.99865),
        ):
            conformity = lb.assess_conformity(
                posterior, {name: lb.analysis.Tolerance(upper=upper)}
            )[name]
            assert conformity.probability == pytest.approx(expected, abs=0.02), (name, expected)
            assert conformity.guard_band == pytest.approx(1.6449 * sd, rel=1e-3)
        draws = posterior["posterior"][name].values.ravel()
        low = mean - 0.5 * sd
        high = mean + 1.2 * sd
        conformity = lb.assess_conformity(posterior, {name: lb.analysis.Tolerance(low, high)})[name]
        assert conformity.probability == pytest.approx(
            ((draws >= low) & (draws <= high)).mean(), abs=1e-12
        )


def test_the_value_of_a_stiffness_is_its_median_as_on_sheets(posterior: Any) -> None:
    limits = {"C_YYY": "60 nm/N", "stiffness_Y": "18 N/µm", "k_min": "9 N/µm", "k_ratio": "2"}
    decisions = lb.assess_conformity(posterior, limits)
    force_N = decisions["k_min"].force_N
    stiffness = lb.stiffness(posterior, [force_N]).planes[0]
    compliance = posterior["posterior"]["C_YYY"].values
    assert decisions["C_YYY"].value == decisions["C_YYY"].mean
    assert decisions["stiffness_Y"].value == pytest.approx(1.0 / np.median(compliance), rel=1e-4)
    assert decisions["k_min"].value == pytest.approx(stiffness.least.median)
    assert decisions["k_ratio"].value == pytest.approx(stiffness.ratio.median)


def test_normal_tail_beyond_the_draws(posterior: Any) -> None:
    mean, sd = lb.summarize(posterior).loc["C_XXX", ["mean", "sd"]]
    far = [
        lb.assess_conformity(posterior, {"C_XXX": lb.analysis.Tolerance(upper=mean + k * sd)})[
            "C_XXX"
        ].probability
        for k in (6.0, -6.0)
    ]
    np.testing.assert_allclose([1.0 - far[0], far[1]], stats.norm.sf(6.0), rtol=1e-5)
    assert 1.0 - far[0] > 0.0


def _gamma_draws(shape: float) -> Any:
    """Return 2000 draws that stand at even steps of the probability of a gamma distribution."""
    return stats.gamma(shape).ppf((np.arange(2000) + 0.5) / 2000)


@pytest.mark.parametrize("shape", [5, 10, 30])
@pytest.mark.parametrize("count", [1, 4, 9, 12])
def test_a_skewed_tail_has_at_least_the_share_of_its_draws(shape: float, count: int) -> None:
    limit = float(stats.gamma(shape).isf(count / 2000))
    stated = TolerancedDraws(_gamma_draws(shape), None)
    above = _decide_by_draws("mm", stated, lb.analysis.Tolerance(upper=limit), 0.999)
    assert 1.0 - above.probability == pytest.approx(count / 2000, abs=1e-12)
    below = _decide_by_draws("mm", stated, lb.analysis.Tolerance(lower=limit), 0.999)
    assert below.probability == pytest.approx(count / 2000, abs=1e-12)


def test_a_confidence_beyond_the_draws_is_not_met_by_a_normal_tail() -> None:
    stated = TolerancedDraws(_gamma_draws(10.0), None)
    limit = float(stats.gamma(10.0).isf(4.5e-3))
    conformity = _decide_by_draws("mm", stated, lb.analysis.Tolerance(upper=limit), 0.999)
    assert conformity.decision is Decision.NOT_DECIDED


def test_a_side_with_few_draws_has_at_most_the_share_of_ten() -> None:
    draws = -_gamma_draws(1.0)
    limit = float(draws.max())  # no draw lies above, and the normal tail there is 16 %
    conformity = _decide_by_draws(
        "mm", TolerancedDraws(draws, None), lb.analysis.Tolerance(upper=limit), 0.95
    )
    assert 1.0 - conformity.probability == pytest.approx(10 / 2000, abs=1e-12)


def test_the_error_of_a_probability_is_that_of_independent_draws(
    rng: np.random.Generator,
) -> None:
    """√(p(1 − p)/n), on average over many sets of draws; larger if draws are correlated."""
    tolerance = lb.analysis.Tolerance(upper=1.2)
    p = stats.norm.cdf(1.2)
    errors = {1: [], 8: []}
    for copies, listed in errors.items():
        for _ in range(200):
            draws = np.repeat(rng.standard_normal(4000 // copies), copies)
            decision = _decide_by_draws("mm", TolerancedDraws(draws, None), tolerance, 0.95)
            listed.append(decision.probability_error)
    expected = np.sqrt(p * (1.0 - p) / 4000)
    assert np.mean(errors[1]) == pytest.approx(expected, rel=0.05)
    assert np.mean(errors[8]) == pytest.approx(expected * np.sqrt(8.0), rel=0.05)


def test_a_close_decision_states_the_error_of_its_probability() -> None:
    record = {"unit": "mm/N", "force_N": 389.0, "lower": None, "upper": 6e-5, "guard_band": 4e-6}
    record |= {
        "value": 57e-6,
        "mean": 57e-6,
        "sd": 2.4e-6,
        "confidence": 0.95,
        "decision": "not decided",
        "ci_low": 52.3e-6,
        "ci_high": 61.7e-6,
    }
    record |= {"probability_error": 0.006}
    for probability, cell_text in (
        (0.948, "0.948 ± 0.006"),
        (0.92, "0.920"),
        (0.055, "0.055 ± 0.006"),
    ):
        table = conformity_table({"C_XXX": record | {"probability": probability}})
        assert cell_text in [cell.strip() for cell in lines_of([table]).split("  ")]


def test_a_skewed_stiffness_has_the_ends_of_its_interval_beside_it(
    rng: np.random.Generator,
) -> None:
    """Of a compliance of 40 ± 13 nm/N (u), 2u of the stiffness is 43 N/µm beside a value of 25."""
    compliance = stats.truncnorm.rvs(-3.0, np.inf, 40e-6, 13e-6, size=4000, random_state=rng)
    tolerance = lb.analysis.Tolerance(lower=10e3)
    stated = TolerancedDraws(1.0 / compliance, 389.0, is_stiffness=True)
    decision = _decide_by_draws("N/mm", stated, tolerance, 0.95)
    low, high = np.quantile(stated.values, (0.025, 0.975))
    assert (decision.ci_low, decision.ci_high) == (pytest.approx(low), pytest.approx(high))
    text = lines_of([conformity_table({"stiffness_X": decision.as_dict()})])
    assert 2.0 * decision.sd > 1.5 * decision.value
    above = 1e-3 * (high - decision.value)
    below = 1e-3 * (decision.value - low)
    assert f"+{above:.0f} / −{below:.0f}" in text
    assert "+a / −b are the ends of the 95 % interval" in text


def test_a_stiffness_without_an_upper_end() -> None:
    tolerance = lb.analysis.Tolerance(lower=10e3)
    certain = stiffness_conformity("N/mm", 40e-6, 10e-6, tolerance)
    assert (certain.ci_low, certain.ci_high) == (
        pytest.approx(1.0 / (40e-6 + 19.6e-6), rel=1e-4),
        pytest.approx(1.0 / (40e-6 - 19.6e-6), rel=1e-3),
    )
    near_zero = stiffness_conformity("N/mm", 40e-6, 25e-6, tolerance)
    assert near_zero.ci_high is None
    record = near_zero.as_dict()
    assert [record[key] for key in ("value", "mean", "sd", "guard_band")] == [None] * 4


def test_a_stiffness_that_is_infinite_in_its_whole_interval_has_no_ends() -> None:
    """Compliance −60 ± 49 nm/N, all of it below zero: 1/C is no negative stiffness."""
    tolerance = lb.analysis.Tolerance(lower=10e3)
    record = stiffness_conformity("N/mm", -60e-6, 25e-6, tolerance).as_dict()
    assert (record["ci_low"], record["ci_high"]) == (None, None)
    assert record["probability"] == pytest.approx(stats.norm.cdf((100e-6 + 60e-6) / 25e-6))


@pytest.mark.parametrize(
    ("compliance_mean", "cell_text"), [(40e-6, "≥ 11.2"), (1e-9, "≥ 20.4"), (-60e-6, "∞")]
)
def test_of_a_stiffness_without_an_upper_end_the_lower_one_is_printed(
    compliance_mean: float, cell_text: str
) -> None:
    """Its value, 1 / C, says nothing where the compliance may be zero: it was −200 ± …"""
    tolerance = lb.analysis.Tolerance(lower=10e3)
    decision = stiffness_conformity("N/mm", compliance_mean, 25e-6, tolerance)
    table = conformity_table({"stiffness_X": decision.as_dict()})
    assert table.rows[0][1:3] == (cell_text, "")
    assert table.rows[0][5] == "–"
    assert "+a / −b" not in table.caption


def test_decisions_by_the_guard_band() -> None:
    tolerance = lb.analysis.Tolerance(upper=60e-6)
    for inside, decision in (
        (1.7, Decision.CONFORMS),
        (1.6, Decision.NOT_DECIDED),
        (-1.6, Decision.NOT_DECIDED),
    ):
        conformity = normal_conformity("mm/N", 60e-6 - inside * 2e-6, 2e-6, tolerance)
        assert conformity.decision == decision
        assert conformity.probability == pytest.approx(stats.norm.cdf(inside))
        assert (conformity.decision == Decision.CONFORMS) == (
            conformity.mean < 60e-6 - conformity.guard_band
        )
    assert (
        normal_conformity("mm/N", 60e-6 + 3.4e-6, 2e-6, tolerance).decision
        == Decision.DOES_NOT_CONFORM
    )
    both = normal_conformity(
        "rad", 10e-6, 4e-6, lb.analysis.Tolerance(-20e-6, 20e-6), confidence=0.995
    )
    assert both.probability == pytest.approx(
        stats.norm(10.0, 4.0).cdf(20.0) - stats.norm(10.0, 4.0).cdf(-20.0)
    )
    assert both.decision == Decision.NOT_DECIDED


@pytest.mark.parametrize(
    ("compliance", "lower", "upper", "probability", "decision"),
    [
        ((50.0, 5.0), 1.0 / 42.5, None, 0.0668, Decision.NOT_DECIDED),
        ((50.0, 10.0), 1.0 / 70.0, None, 0.9772, Decision.CONFORMS),
        ((-1.0, 10.0), 1.0 / 70.0, None, 1.0, Decision.CONFORMS),
        ((50.0, 10.0), None, 1.0 / 70.0, 0.0228, Decision.DOES_NOT_CONFORM),
        ((50.0, 10.0), 1.0 / 70.0, 1.0 / 40.0, 0.8186, Decision.NOT_DECIDED),
        ((50.0, 10.0), -1.0, 1.0 / 40.0, 0.8413, Decision.NOT_DECIDED),
    ],
)
def test_a_stiffness_conforms_where_its_compliance_does(
    compliance: tuple[float, float],
    lower: float | None,
    upper: float | None,
    probability: float,
    decision: Decision,
) -> None:
    tolerance = lb.analysis.Tolerance(lower, upper)
    conformity = stiffness_conformity("N/mm", *compliance, tolerance)
    assert conformity.probability == pytest.approx(probability, abs=1e-4)
    assert conformity.decision == decision


@pytest.mark.parametrize("k", [2.0, 3.0, 4.5])
def test_a_limit_of_a_stiffness_and_of_its_compliance_are_one_statement(
    posterior: Any, k: float
) -> None:
    """Also where few draws, or none, are beyond it."""
    mean, sd = lb.summarize(posterior).loc["C_YYY", ["mean", "sd"]]
    ends = (mean - k * sd, mean + k * sd)
    of_compliance = lb.analysis.Tolerance(*ends)
    of_stiffness = lb.analysis.Tolerance(1.0 / ends[1], 1.0 / ends[0])
    for compliance, stiffness in (
        (of_compliance, of_stiffness),
        (replace(of_compliance, lower=None), replace(of_stiffness, upper=None)),
        (replace(of_compliance, upper=None), replace(of_stiffness, lower=None)),
    ):
        decisions = lb.assess_conformity(posterior, {"C_YYY": compliance, "stiffness_Y": stiffness})
        assert decisions["stiffness_Y"].probability == pytest.approx(
            decisions["C_YYY"].probability, abs=1e-12
        )
        assert decisions["stiffness_Y"].decision == decisions["C_YYY"].decision


def test_a_stiffness_below_the_tested_forces_conforms_where_its_compliance_does() -> None:
    """With what the joints' load adds, C(F) may be negative there: stiffer than any limit, not
    softer."""
    model = lb.HybridModel.default(1)
    campaign = simulated(plan((36,) * 4, forces_N=(200.0, 300.0, 500.0, 742.0)), seed=1)
    posterior = lb.sample(model, campaign, sampler="independent", seed=1)
    limits = {"C_XXX": "60 nm/N", "stiffness_X": lb.analysis.Tolerance(lower=1.0 / 60e-6)}
    decisions = lb.assess_conformity(posterior, limits, force_N=20.0)
    compliance = decisions["C_XXX"]
    assert compliance.mean - 2.0 * compliance.sd < 0.0
    assert decisions["stiffness_X"].probability == pytest.approx(compliance.probability, abs=1e-9)
    assert decisions["stiffness_X"].sd < 3.0 * decisions["stiffness_X"].mean


def test_texts_are_limits_with_their_units() -> None:
    limits = TABLES["tolerances"]["limits"]
    tolerances = tolerances_in(
        quantities_of(MODEL.bind(CAMPAIGN)), {name: text for name, text, *_ in limits}
    )
    for (name, tolerance), (_, _, parameter, *ends) in zip(tolerances.items(), limits, strict=True):
        assert (name, tolerance.ends) == (parameter, pytest.approx(tuple(ends)))


@pytest.mark.parametrize(
    "text",
    ["−20..40 µrad", "-20...40 µrad", "−20 … 40 µrad", "-2E-5..4E-5 rad", "-2e-5...4e-5 rad"],
)
def test_ranges_are_written_with_two_dots_three_or_an_ellipsis(text: str) -> None:
    tolerance = tolerances_in({"E_C0Y": Quantity("rad", ("upper",))}, {"E_C0Y": text})["E_C0Y"]
    assert tolerance.ends == pytest.approx((-2e-5, 4e-5))


def test_a_tolerance_of_a_kind_of_error_is_answered_with_the_names_of_these_errors() -> None:
    """And not with stiffness_X, the name that is most similar."""
    refuses(
        r"got 'squareness'\. Errors of squareness are E_C0YX\.$",
        tolerances_in,
        quantities_of(MODEL.bind(CAMPAIGN)),
        {"squareness": "20 µrad"},
    )


@pytest.mark.parametrize(("limits", "message"), TABLES["conformity"])
def test_tolerances_that_cannot_be_are_refused(
    posterior: Any, limits: dict[str, str], message: str
) -> None:
    refuses(message, lb.assess_conformity, posterior, limits)


def test_stiffness_and_path_at_a_force(posterior: Any) -> None:
    force = 500.0
    curve = curves_of(posterior, np.array([force]))[:, 0, 0]
    conformities = lb.assess_conformity(
        posterior,
        {"stiffness_X": "18 N/µm", "C_XXX": "60 nm/N", "G": "20 µm", "E_XX1": "1 mm/m"},
        force_N=force,
    )
    assert conformities["stiffness_X"].probability == pytest.approx(
        (1.0 / curve >= 18e3).mean(), abs=0.01
    )
    assert conformities["C_XXX"].mean == pytest.approx(curve.mean(), rel=1e-9)
    table = lb.analysis.predict_circularity(posterior, [force]).set_index("quantity")
    assert conformities["G"].mean == pytest.approx(table.loc["G", "mean"] * 1e-3, rel=1e-9)
    assert (conformities["G"].force_N, conformities["E_XX1"].force_N) == (force, None)
    for far in (
        -5.0,
        0.0,
        float("nan"),
        0.09 * CAMPAIGN.forces_N.min(),
        1.6 * CAMPAIGN.forces_N.max(),
    ):
        with pytest.raises(
            InputError,
            match=rf"force_N \(--force-N\) must be a force from .* tested from .* got {far}",
        ):
            lb.assess_conformity(posterior, {"C_XXX": "60 nm/N"}, force_N=far)
    middle = lb.assess_conformity(posterior, {"C_XXX": "60 nm/N"})["C_XXX"]
    assert (middle.mean, middle.force_N) == (
        pytest.approx(lb.summarize(posterior).loc["C_XXX", "mean"]),
        389.0,
    )


def test_a_reference_force_far_from_the_tested_ones_is_not_used() -> None:
    """Results are stated at the middle of the tested forces then."""
    model = replace(MODEL, reference_force_N=2.0 * float(CAMPAIGN.forces_N.max()))
    middle_N = 0.5 * float(CAMPAIGN.forces_N.min() + CAMPAIGN.forces_N.max())
    assert force_to_state(CAMPAIGN, model.reference_force_N or 0.0) == middle_N
    posterior = lb.sample(model, CAMPAIGN, sampler="independent", seed=1)
    decision = lb.assess_conformity(posterior, {"C_XXX": "60 nm/N"})["C_XXX"]
    assert decision.force_N == middle_N


def test_campaigns_have_tolerances(tmp_path: Path) -> None:
    campaign = replace(CAMPAIGN, tolerances={"C_XXX": "60 nm/N", "E_C0YX": "20 µrad"})
    lb.write_campaign(campaign, tmp_path / "campaign")
    again = lb.read_campaign(tmp_path / "campaign")
    assert again.tolerances == campaign.tolerances
    assert again.sha256 == CAMPAIGN.sha256
    fitted = lb.sample(MODEL.with_degree(0), again, sampler="independent")
    assert campaign_of(fitted).tolerances == campaign.tolerances
    assert lb.assess_conformity(fitted).keys() == campaign.tolerances.keys()
    toml = (
        (tmp_path / "campaign" / "campaign.toml")
        .read_text(encoding="utf-8")
        .replace('"60 nm/N"', "60")
    )
    (tmp_path / "campaign" / "campaign.toml").write_text(toml, encoding="utf-8")
    refuses(
        r"campaign\.toml: 'C_XXX' in \[tolerance\] must be a valid string, got 60",
        lb.read_campaign,
        tmp_path / "campaign",
    )


def test_may_the_numbers_be_used(posterior: Any) -> None:
    fit = fit_of(posterior)
    verdicts = lb.analysis.judge_posterior(posterior)
    assert (
        judge_certificate(
            replace(fit, concerns=(), sensitivity={}), verdicts, ("C_XXX", "C_YYY")
        ).use
        == Use.CAN_BE_USED
    )
    weak = {
        "E_C0YX": replace(
            verdicts["E_C0YX"], verdict=Verdict.CONFOUNDED, partners=("BallForm",), contraction=0.4
        )
    }
    squareness = judge_certificate(
        replace(fit, concerns=(), sensitivity={}), verdicts | weak, ("C_XXX", "E_C0YX")
    )
    assert squareness.use == Use.WITH_RESERVATION
    assert squareness.reasons == (Reason(ReasonKind.NOT_DETERMINED, ("E_C0YX",), ("BallForm",)),)
    for kind in (ConcernKind.NOT_CONVERGED, ConcernKind.TRUNCATION):
        refused = judge_certificate(replace(fit, concerns=(Concern(kind, 1.0, 2.0),)), verdicts, ())
        assert refused.use == Use.DO_NOT_USE
        assert refused.reasons[0].kind == kind
    open_sign: Any = SimpleNamespace(sign="depends on assumptions that the readings allow")
    state = judge_certificate(
        replace(fit, concerns=(), sensitivity={}), verdicts, ("C_XXX",), comparison=open_sign
    )
    assert [reason.kind for reason in state.reasons] == [ReasonKind.OPEN_SIGN]


def test_rough_weights_of_models_are_a_reservation(posterior: Any) -> None:
    fit = replace(fit_of(posterior), concerns=(), sensitivity={})
    assert judge_certificate(fit, {}, ()).reasons == ()
    judgement = judge_certificate(fit, {}, (), rough_weights=True)
    assert judgement.use == Use.WITH_RESERVATION
    assert judgement.reasons == (Reason(ReasonKind.ROUGH_WEIGHTS),)


def test_readings_in_a_wrong_unit_are_not_said_to_have_a_wrong_zero_as_well(posterior: Any) -> None:
    """The cure of the zero, to subtract it, does not help: the unit has to be stated."""
    fit = replace(fit_of(posterior), concerns=(), sensitivity={})
    zero = Concern(ConcernKind.ZERO, 20.0, 0.07, "bar_length_150")
    unit = Concern(ConcernKind.UNIT, 20.0, 3.0, "f036")
    alone = judge_certificate(replace(fit, concerns=(zero,)), {}, ())
    assert alone.reasons == (Reason(ReasonKind.ZERO),)
    both = judge_certificate(replace(fit, concerns=(unit, zero)), {}, ())
    assert both.reasons == (Reason(ReasonKind.UNIT, ("f036",)),)


# ---- stiffness by direction


def test_a_stiffness_by_direction_may_have_a_tolerance(posterior: Any) -> None:
    k_min = lb.stiffness(posterior, [389.0]).planes[0].least
    limit = f"{k_min.median / 1e3} N/um"
    decision = lb.assess_conformity(posterior, {"k_min": limit})["k_min"]
    assert decision.probability == pytest.approx(0.5, abs=0.01)
    assert decision.lower == pytest.approx(k_min.median)
    assert decision.upper is None


def test_a_ratio_of_stiffnesses_is_limited_by_a_number_without_unit(posterior: Any) -> None:
    decision = lb.assess_conformity(posterior, {"k_ratio": "3"})["k_ratio"]
    assert decision.upper == 3.0
    assert decision.decision is Decision.CONFORMS


def test_a_ratio_with_a_unit_is_refused(posterior: Any) -> None:
    refuses(
        "tolerance of k_ratio must be a number without a unit, got '3 N/µm'. Write 1.5",
        lb.assess_conformity,
        posterior,
        {"k_ratio": "3 N/µm"},
    )
