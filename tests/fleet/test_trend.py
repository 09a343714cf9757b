"""One machine over time: a loosened joint is found, when and by how much; order, choice of machine, doubts and refusals."""

from __future__ import annotations

import json
from functools import partial
from importlib import import_module

import numpy as np
import pandas as pd
import pytest
from campaigns import HYPER_UM, TRUTH, plan
from trends import doubts, drawn_rows, one_campaign, row, verdict, with_prior

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.change import Series, Steps, Weights, carry, detection, scatter_rule, steps_of, weigh
from ldbb_bayes.fleet.statistics import fleet_statistics, sufficient_statistics
from ldbb_bayes.fleet.trend import Trend
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.report.wording import probability_words
from ldbb_bayes.table import json_text


@pytest.fixture(scope="module")
def rows() -> pd.DataFrame:
    return drawn_rows(10, np.random.default_rng(4), step_at=6)


@pytest.fixture(scope="module")
def found(rows: pd.DataFrame) -> Trend:
    return lb.trend(rows)


def test_a_loosened_joint(found: Trend) -> None:
    own = found.parameters["C_XXX"]
    assert found.changed
    assert own.probability == max(one.probability for one in found.parameters.values())
    assert sum(one.probability for one in found.parameters.values()) == pytest.approx(found.probability)
    assert found.by_time.sum() == pytest.approx(found.probability)
    assert np.argmax(found.by_time) == 6
    truth = 0.2 * one_campaign().mean[one_campaign().names.index("C_XXX")]
    assert abs(own.size - truth) < 3.0 * own.sd
    assert own.interval[0] < own.size < own.interval[1]
    assert own.percent == pytest.approx(20.0, abs=8.0)
    assert own.level - own.before == pytest.approx(own.size, rel=0.05)
    assert found.detection.before == 4
    said = verdict(found)
    assert "Over 10 campaigns of M1 a change is found" in said
    assert "one of C_XXX" in said
    assert "between 2025-06-14 (c06) and 2025-07-14 (c07)" in said
    assert "A loosened joint (C_XXX +20 %) would be found within" in said
    assert "the 4 campaigns since the change" in said
    assert doubts(found) == []


def test_a_machine_at_rest() -> None:
    quiet = lb.trend(drawn_rows(9, np.random.default_rng(5)))
    assert not quiet.changed
    assert quiet.probability < 0.5
    assert "no change is found" in verdict(quiet)
    assert quiet.detection.before == 9
    assert quiet.sensitivity["a prior probability of 0.1"] < quiet.probability < quiet.sensitivity["a prior probability of 0.9"]
    odds = quiet.probability / (1.0 - quiet.probability)
    assert quiet.sensitivity["a prior probability of 0.9"] == pytest.approx(9.0 * odds / (1.0 + 9.0 * odds), rel=1e-9)


@pytest.mark.usefixtures("quick")
def test_the_instruments_error_is_in_no_point(rows: pd.DataFrame) -> None:
    """A worse bar widens what is common, not points, limits or the step."""
    one, other = (lb.trend(own) for own in (rows, with_prior(rows, {"force_gain": (0.0, 0.03)})))
    for name in ("C_XXX", "C_YYY"):
        assert other.parameters[name].common_sd > 1.05 * one.parameters[name].common_sd
    for column in ("sd", "limit_high"):
        np.testing.assert_allclose(
            other.estimates[column].dropna(), one.estimates[column].dropna(), rtol=0.08, atol=2e-3 * one.estimates["sd"].max()
        )
    assert other.parameters["C_XXX"].size == pytest.approx(one.parameters["C_XXX"].size, rel=0.05)
    assert np.isfinite(lb.trend(rows, one_instrument=False).probability)
    assert lb.trend(rows, one_instrument=False).parameters["C_XXX"].common_sd == 0.0


@pytest.mark.usefixtures("quick")
def test_when_is_that_of_the_parameter_that_is_named(rows: pd.DataFrame, monkeypatch: pytest.MonkeyPatch) -> None:
    """C_XXX before c02 0.30 or c03 0.25, C_YYY before c03 0.40: C_XXX before c02, though a change before c03 is more probable."""

    def weights(steps: Steps, scatter_weight: np.ndarray, probability: float) -> Weights:
        change = np.zeros(steps.log_ratio.shape)
        change[:, :, 0], change[:, :, 2] = scatter_weight[:, None] * [0.30, 0.25], scatter_weight[:, None] * [0.0, 0.40]
        return Weights(0.05 * scatter_weight, change)

    monkeypatch.setattr(import_module("ldbb_bayes.fleet.trend"), "weigh", weights)
    found = lb.trend(rows[:3], threshold=0.9)
    likely = found.most_probable
    assert (likely.parameter, likely.place) == ("C_XXX", 1)
    assert likely.change.probability == pytest.approx(0.30)
    said = verdict(found)
    assert "one of C_XXX (0.550), then between 2025-01-15 (c01) and 2025-02-14 (c02) (both: 0.300): " in said
    assert found.detection.before == 2
    nodes, prior = scatter_rule(0.01)
    steps = steps_of(carry(Series.of(fleet_statistics(rows[:3]), range(3)), nodes), 0.2)
    assert likely.change.size == pytest.approx(1e-4 * float(prior @ steps.size[:, 0, 0]))
    assert found.as_dict()["most_probable"]["just_before"] == "c02"


@pytest.mark.usefixtures("quick")
def test_per_cent_of_what_is_known(found: Trend) -> None:
    """A level known to a fifth; the others have none."""
    told = {name: own.percent is not None for name, own in found.parameters.items()}
    assert told["C_XXX"]
    assert not all(told.values())
    for own in found.parameters.values():
        if own.percent is not None:
            assert own.percent == pytest.approx(100.0 * own.size / own.before)
            assert abs(own.before) > 5.0 * own.level_sd


@pytest.mark.usefixtures("quick")
def test_the_prior_of_the_fits_does_not_matter(rows: pd.DataFrame, found: Trend) -> None:
    """The same likelihoods from fits that were told of the machine: the same step, as probable."""
    truth = one_campaign()
    told = {name: (1.1 * truth.mean[truth.names.index(name)], 0.04 * 1e-4) for name in ("C_XXX", "C_YYY")}
    other = lb.trend(with_prior(rows, told))
    assert other.probability == pytest.approx(found.probability, rel=1e-6)
    assert other.sensitivity["half the change_scale"] == pytest.approx(found.sensitivity["half the change_scale"], rel=1e-6)
    for name, own in found.parameters.items():
        assert other.parameters[name].size == pytest.approx(own.size, rel=1e-5)
        assert other.parameters[name].level == pytest.approx(own.level, rel=1e-5)
    np.testing.assert_allclose(other.estimates["limit_high"], found.estimates["limit_high"], rtol=1e-5)


@pytest.mark.slow
def test_found_as_soon_as_predicted() -> None:
    """Whole rows, prior divided out and all, campaign after campaign."""
    rng = np.random.default_rng(6)
    before, replicates, size = 5, 120, 0.2
    nodes, weight = scatter_rule(0.01, step=0.35)
    first = fleet_statistics(drawn_rows(1, rng))
    series = Series.of(first, [0])
    truth = one_campaign()
    level = np.array([truth.mean[truth.names.index(name)] for name in first.parameters]) / first.prior_sd
    instrument = np.array([1e-4, 0.005]) / first.instrument_sd
    changes = np.full(6, np.nan)
    changes[0] = size * level[0]
    soon = detection(
        series.information[0],
        6,
        np.concatenate([level, instrument]),
        changes,
        before=before,
        scatter=(np.array([0.003]), np.ones(1)),
        change_scale=0.2,
        repeatability=0.01,
        probability=0.5,
        threshold=0.95,
        further=3,
        replicates=2000,
    )
    seen = np.zeros((replicates, 4), dtype=bool)
    for own in seen:
        statistics = fleet_statistics(drawn_rows(before + 3, rng, step_at=before, step=size))
        for further in range(4):
            part = Series.of(statistics, range(before + further))
            own[further] = weigh(steps_of(carry(part, nodes), 0.2), weight, 0.5).none.sum() < 0.05
    share = np.logical_or.accumulate(seen[~seen[:, 0], 1:], axis=1).mean(axis=0)
    assert 0.1 < soon.found[0, 0] < 0.97
    np.testing.assert_allclose(share, soon.found[0], atol=3.5 * np.sqrt(0.25 / replicates))


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where predictions do not matter."""
    module = import_module("ldbb_bayes.fleet.trend")
    monkeypatch.setattr(module, "detection", partial(detection, replicates=20, further=2))


@pytest.mark.usefixtures("quick")
def test_order_of_time(rows: pd.DataFrame, found: Trend) -> None:
    """By date, whatever the order of rows; without dates as given; equal dates as given."""
    mixed = lb.trend(rows.sample(frac=1.0, random_state=3))
    assert mixed.campaigns == found.campaigns
    assert mixed.probability == pytest.approx(found.probability)
    undated = lb.trend(rows.assign(date=None))
    assert undated.probability == pytest.approx(found.probability)
    assert any("No campaign has a date" in doubt for doubt in doubts(undated))
    assert "between c06 and c07" in verdict(undated)
    same = lb.trend(rows.assign(date="2026-01-01"))
    assert any("Some campaigns have the same date" in doubt for doubt in doubts(same))
    assert same.campaigns == found.campaigns
    zoned = rows.assign(date=["2026-01-01T12:00:00+02:00", "2026-01-01T11:00:00", *["2026-02-01"] * 8])
    assert lb.trend(zoned).campaigns[:2] == ("c01", "c02")
    some = rows.assign(date=[None, *rows["date"][1:]])
    with pytest.raises(InputError, match=r"a date all or none, got none for year/c01\. Write date"):
        lb.trend(some)


@pytest.mark.usefixtures("quick")
def test_which_machine(rows: pd.DataFrame) -> None:
    two = pd.concat([rows, rows.assign(machine_id="M2", campaign="other/" + rows["name"])])
    with pytest.raises(InputError, match=r"of one machine, got those of M1, M2. Choose one: --machine M1"):
        lb.trend(two)
    with pytest.raises(InputError, match=r"machine must be one of M1, M2, got 'm2'. Did you mean 'M2'"):
        lb.trend(two, machine="m2")
    assert lb.trend(two, machine="M2").machine == "M2"
    assert lb.trend(two, machine="M2", exclude=["M1"]).probability == lb.trend(two, machine="M2").probability
    nameless = lb.trend(rows.assign(machine_id=None))
    assert nameless.machine is None
    assert "No campaign names its machine" in doubts(nameless)[0]
    with pytest.raises(InputError, match="machine must not be given here, got 'M1'"):
        lb.trend(rows.assign(machine_id=None), machine="M1")
    some = lb.trend(rows.assign(machine_id=[None, *["M1"] * 9]))
    assert (len(some.campaigns), doubts(some)[0]) == (9, "Left out for naming no machine: c01.")
    unread = rows.assign(machine_id=[None, *["VMC 07"] * 9], status=["failed", *["done"] * 9])
    assert doubts(lb.trend(unread))[0] == "Left out, for they could not be fitted, and their machine is not named: c01."
    with pytest.raises(InputError, match="--machine 'VMC 07'"):
        lb.trend(two.assign(machine_id=["VMC 07"] * 10 + ["VMC 08"] * 10))
    assert list(lb.trend(rows, parameters="C_XXX").parameters) == ["C_XXX"]


@pytest.mark.usefixtures("quick")
def test_campaigns_without_statistics_are_left_out_and_named(rows: pd.DataFrame) -> None:
    """As flat priors or a breakdown leave them: the others say the same as without them."""
    silent = rows.copy()
    gaussian = [name for name in rows if name.startswith("gaussian_")]
    silent.loc[silent.index[2], gaussian] = None
    found, without = lb.trend(silent), lb.trend(rows.drop(index=rows.index[2]))
    assert found.estimates.equals(without.estimates)
    name = rows["name"].iloc[2]
    assert f"Left out, for they have no sufficient statistics (flat priors, or a breakdown: see warnings): {name}." in doubts(
        found
    )
    silent[gaussian] = None
    with pytest.raises(InputError, match=f"must have sufficient statistics, got none of {len(rows)}"):
        lb.trend(silent)


@pytest.mark.usefixtures("quick")
def test_one_bar_is_in_every_level(rows: pd.DataFrame) -> None:
    """Its length and its balls; most where forces span little."""
    few = rows.assign(force_min_N=[300.0, *[36.0] * 9])
    one, own = lb.trend(few), lb.trend(few, one_instrument=False)
    assert [doubt for doubt in doubts(one) if "span little" in doubt] == [
        "Forces that span little (the greatest below 3 times the least), so that length and ball form of the one bar look like "
        "compliances and do not average out: c01."
    ]
    assert "conservative for changes, not for levels" in verdict(one)
    assert "span little" not in " ".join(doubts(own))
    assert "not for levels" not in verdict(own)
    assert "span little" not in " ".join(doubts(lb.trend(few, parameters=["E_XX1"])))


@pytest.mark.usefixtures("quick")
def test_remarks(rows: pd.DataFrame) -> None:
    doubtful = rows.assign(
        status=["failed", *["done"] * 9],
        converged=[True, False, *[True] * 8],
        kinds=[[], [], ["autocorrelation"], *[[]] * 7],
        sha256=[str(i) for i in (0, 1, 2, 3, 3, 5, 6, 7, 8, 9)],
        model_sha256=["a"] * 5 + ["b"] * 5,
    )
    said = " ".join(doubts(lb.trend(doubtful, reference_force_N=20.0)))
    assert "could not be fitted: c01." in said
    assert "Not converged, refit with more draws: c02." in said
    assert "Noise that is not white, so that uncertainties may be too small: c03." in said
    assert "Left out, for their readings are those of campaigns before them: c05." in said
    assert "different models or priors" in said
    assert "20 N, was not within the tested forces" in said
    assert "With two campaigns" in doubts(lb.trend(rows[:2]))[-1]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"change_scale": 0.0}, "change_scale must be above zero"),
        ({"repeatability": float("nan")}, "repeatability must be above zero"),
        ({"probability": 1.0}, "probability must lie between 0 and 1"),
        ({"threshold": 0.0}, "threshold must lie between 0 and 1"),
        ({"detect": -1.01}, r"not below -1 \(-100 %\), got -1.01"),
        ({"detect": 0.0}, "other than 0"),
        ({"ci_prob": 1.5}, "ci_prob must lie between 0 and 1"),
        ({"parameters": ["C_XXXX"]}, "got 'C_XXXX'. Did you mean 'C_XXX'"),
        ({"parameters": ["C_XXX", "C_XXX"]}, "once each"),
        ({"parameters": ["mount"]}, "parameter must be one of .*, got 'mount'"),
    ],
)
def test_what_is_refused(rows: pd.DataFrame, options: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        lb.trend(rows, **options)


def test_too_few(rows: pd.DataFrame) -> None:
    with pytest.raises(InputError, match="at least 2 campaigns of one machine to rely on, got 1"):
        lb.trend(rows[:1])


def test_what_is_shown(found: Trend) -> None:
    record = json.loads(json_text(found.as_dict()))
    assert record["probability_of_change"] == pytest.approx(found.probability)
    assert record["campaigns"][6] == {
        "campaign": "c07",
        "date": "2025-07-14T00:00:00+00:00",
        "change_just_before": pytest.approx(found.by_time[6]),
    }
    assert record["parameters"]["C_XXX"]["change"]["ci95"] == pytest.approx(found.parameters["C_XXX"].interval)
    assert len(found.estimates) == 60
    assert found.estimates["limit_low"].isna().sum() == 6
    assert record["caveats"] == []
    for shown in (str(found), found._repr_html_()):
        for part in ("M1, 10 campaigns", "nm/N", "+20 %", "a change is found"):
            assert part in shown
    assert (probability_words(1e-9), probability_words(1.0), probability_words(0.25)) == ("< 0.001", "> 0.999", "0.250")


@pytest.mark.usefixtures("quick")
def test_geometric_errors_and_another_force(rows: pd.DataFrame) -> None:
    chosen = lb.trend(rows, parameters=["C_XXX", "E_YX2"], reference_force_N=500.0, detect=-0.3, seed=2)
    assert tuple(chosen.parameters) == ("C_XXX", "E_YX2")
    assert chosen.reference_force_N == 500.0
    assert chosen.parameters["C_XXX"].probability > 0.9
    assert "A change of C_XXX −30 %" in verdict(chosen)


@pytest.mark.slow
def test_from_readings() -> None:
    """Campaigns simulated reading by reading, the joint loosened before the fifth of seven."""
    generator = lb.HybridModel.default(0).without("mount", "force-error")
    model = lb.HybridModel.default(1)
    made = []
    for t in range(7):
        truth = TRUTH | {"C_XXX": TRUTH["C_XXX"] * (1.2 if t >= 4 else 1.0)}
        campaign = generator.simulate(plan((60,) * 4), seed=100 + t, parameters=truth, hyper_um=HYPER_UM).campaign
        posterior = HyperPosterior(model.without("truncation").bind(campaign), truncated=False)
        made.append(row(sufficient_statistics(posterior), campaign=f"m{t}", name=f"m{t}", date=f"2026-0{t + 1}-10"))
    found = lb.trend(pd.DataFrame(made))
    own = found.parameters["C_XXX"]
    assert own.probability > 0.95
    assert np.argmax(found.by_time) == 4
    assert abs(own.size - 0.2 * TRUTH["C_XXX"]) < 3.0 * own.sd
    assert abs(own.before - TRUTH["C_XXX"]) < 3.0 * own.common_sd
