"""One machine over time: steps against stacked normal distributions, brute force and simulation."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest
from campaigns import cases, refuses
from fleets import doubts, drawn_rows, one_campaign, verdict, with_prior
from layout import check_texts
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.stats import halfnorm, multivariate_normal, norm

import ldbb_bayes as lb
from ldbb_bayes.fleet.change_point import (
    common_moments,
    current_levels,
    hypotheses,
    hypothesis_probabilities,
    scatter_rule,
)
from ldbb_bayes.fleet.control_chart import _PanelData, _vertical_range
from ldbb_bayes.fleet.control_limits import chart_points
from ldbb_bayes.fleet.deviations import deviating
from ldbb_bayes.fleet.selection import CaveatKind
from ldbb_bayes.fleet.trend import Trend
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.report.text import parts_of

Array = NDArray[np.float64]
P = 3
S = 2
Q = P + S


def informations(rng: np.random.Generator, n: int, size: float = 300.0) -> Array:
    """Full rank, of very different directions."""
    row_sizes = np.array([3.0, 1.0, 0.1, 1.0, 0.5])
    root = rng.standard_normal((n, Q, Q + 1)) * np.sqrt(size) * row_sizes[:, None]
    return root @ np.swapaxes(root, 1, 2)


def drawn(
    rng: np.random.Generator, information: Array, level: Array, instrument: Array
) -> Gaussian:
    """Campaigns at given parameters: the mean of η is Λ z, its covariance Λ."""
    instruments = np.broadcast_to(instrument, (len(level), len(instrument)))
    z = np.concatenate([level, instruments], axis=1)
    root = np.linalg.cholesky(information)
    noise = np.einsum("tab,tb->ta", root, rng.standard_normal(z.shape))
    return Gaussian(information, np.einsum("tab,tb->ta", information, z) + noise)


def carried_by(series: Gaussian, scatter: Array, parameters: int = P) -> Gaussian:
    return deviating(series, np.outer(scatter, np.ones(parameters)))


def posteriors_of(
    series: Gaussian, scatter: Array, change_scale: float = 0.2, parameters: int = P
) -> Gaussian:
    return hypotheses(carried_by(series, scatter, parameters), parameters, change_scale)


def no_change(
    series: Gaussian, rule: tuple[Array, Array], probability: float = 0.5, parameters: int = P
) -> float:
    nodes, prior = rule
    posteriors = posteriors_of(series, nodes, parameters=parameters)
    probabilities = hypothesis_probabilities(posteriors.log_integral, prior, probability)
    return float(probabilities[:, -1].sum())


def stacked(series: Gaussian, r: float, change_scale: float, step: tuple[int, int] | None) -> float:
    """ln p(maxima of the likelihoods, all campaigns in one vector), by its whole covariance."""
    n = len(series.shift)
    take = np.tile(np.eye(Q), (n, 1))
    covariance = take @ take.T + np.kron(np.eye(n), np.diag([r**2] * P + [0.0] * S))
    covariance += block_diag(*map(np.linalg.inv, series.precision))
    if step is not None:
        k, j = step
        step_direction = np.zeros(n * Q)
        step_direction[j + Q * k :: Q] = 1.0
        covariance += change_scale**2 * np.outer(step_direction, step_direction)
    maxima = np.linalg.solve(series.precision, series.shift[:, :, None]).ravel()
    return float(multivariate_normal(np.zeros(n * Q), covariance).logpdf(maxima))


@pytest.fixture(scope="module")
def series() -> Gaussian:
    rng = np.random.default_rng(3)
    information = informations(rng, 5)
    level = np.tile([0.5, -0.2, 0.1], (5, 1)) + 0.02 * rng.standard_normal((5, P))
    level[3:, 0] += 0.15
    return drawn(rng, information, level, np.array([0.3, -1.0]))


# ---- the model


def test_evidence_of_every_hypothesis(series: Gaussian) -> None:
    scatter = np.array([0.001, 0.02, 0.3])
    log_evidence = posteriors_of(series, scatter).log_integral
    no_step = log_evidence[:, -1]
    dense = np.array([stacked(series, r, 0.2, None) for r in scatter])
    expected = np.tile(dense - dense[0], (P, 1)).T
    np.testing.assert_allclose(no_step - no_step[0], expected, atol=1e-7)
    for i, k, j in product(range(len(scatter)), range(1, 5), range(P)):
        log_ratio = log_evidence[i, k - 1, j] - no_step[i, j]
        dense_ratio = stacked(series, scatter[i], 0.2, (k, j)) - dense[i]
        assert log_ratio == pytest.approx(dense_ratio, abs=1e-7)


def test_size_and_level_given_a_step(series: Gaussian) -> None:
    """Against least squares on all unknowns at once: c, b, Δ and every w_t."""
    r = 0.05
    k = 3
    j = 0
    n = 5
    posteriors = posteriors_of(series, np.array([r]))
    unknown = Q + 1 + n * P
    precision = np.diag(np.concatenate([np.ones(Q), [1.0 / 0.04], np.full(n * P, r**-2)]))
    right = np.zeros(unknown)
    for t in range(n):
        take = np.zeros((Q, unknown))
        take[:, :Q] = np.eye(Q)
        take[j, Q] = t >= k
        take[:P, Q + 1 + t * P : Q + 1 + (t + 1) * P] = np.eye(P)
        precision += take.T @ series.precision[t] @ take
        right += take.T @ series.shift[t]
    covariance = np.linalg.inv(precision)
    np.testing.assert_allclose(
        posteriors.mean[0, k - 1, j], (covariance @ right)[: Q + 1], rtol=1e-7
    )
    np.testing.assert_allclose(
        posteriors.covariance[0, k - 1, j], covariance[: Q + 1, : Q + 1], rtol=1e-6, atol=1e-12
    )


def test_a_campaign_that_says_nothing_changes_nothing(series: Gaussian) -> None:
    """Λ singular, even zero: the evidence of steps before and after it is the same."""
    precision = np.insert(series.precision, 2, 0.0, axis=0)
    with_silent = Gaussian(precision, np.insert(series.shift, 2, 0.0, axis=0))
    scatter = np.array([0.02])
    expected = posteriors_of(series, scatter).log_integral
    log_integral = posteriors_of(with_silent, scatter).log_integral
    np.testing.assert_allclose(log_integral[:, [0, 1, 3, 4, 5]], expected, atol=1e-9)
    np.testing.assert_allclose(log_integral[:, 2], expected[:, 1], atol=1e-9)


def test_probability_by_brute_force() -> None:
    """One parameter, r and Δ on fine grids, c by its closed form for three campaigns."""
    precision = np.array([4e3, 2e3, 3e3])
    maxima = np.array([0.30, 0.33, 0.34])
    series = Gaussian(precision[:, None, None], (precision * maxima)[:, None])
    nodes, weight = scatter_rule(0.02)
    posteriors = posteriors_of(series, nodes, 0.1, 1)
    probabilities = hypothesis_probabilities(posteriors.log_integral, weight, 0.3)
    r = (np.arange(400) + 0.5) * 1.2e-1 / 400
    delta = (np.arange(801) - 400) * 0.7 / 400
    change_prior = norm(0.0, 0.1).pdf(delta) * (delta[1] - delta[0])
    totals = []
    for k, hypothesis_prior in ((1, 0.15), (2, 0.15), (3, 0.7)):
        without_change = maxima - delta[:, None] * (np.arange(3) >= k)
        total = 0.0
        for scatter, scatter_prior in zip(r, halfnorm(scale=0.02).pdf(r), strict=True):
            covariance = np.ones((3, 3)) + np.diag(1.0 / precision + scatter**2)
            density = multivariate_normal(np.zeros(3), covariance).pdf(without_change)
            total += scatter_prior * np.sum(density * change_prior)
        totals.append(total * hypothesis_prior)
    expected = np.array(totals) / sum(totals)
    np.testing.assert_allclose(probabilities.sum(axis=(0, 2)), expected, atol=2e-4)
    assert probabilities.sum() == pytest.approx(1.0)
    prior = hypothesis_probabilities(np.zeros((2, 4, 3)), np.array([0.4, 0.6]), 0.3).sum(axis=0)
    np.testing.assert_allclose(prior, np.repeat([[0.3 / 9]] * 3 + [[0.7 / 3]], 3, axis=1))


@pytest.mark.slow
def test_probabilities_are_calibrated() -> None:
    """Series drawn from the model: of those that changed with probability 0.8, 0.8 have, and false
    alarms are bounded."""
    rng = np.random.default_rng(11)
    rule = scatter_rule(0.02)
    stated = []
    true = []
    for _ in range(1200):
        n = int(rng.integers(3, 9))
        information = informations(rng, n, 2e3)
        mean_level = rng.standard_normal(P)
        scatter = abs(0.02 * rng.standard_normal())
        level = mean_level + scatter * rng.standard_normal((n, P))
        changed = rng.random() < 0.5
        if changed:
            level[rng.integers(1, n) :, rng.integers(P)] += 0.2 * rng.standard_normal()
        campaigns = drawn(rng, information, level, rng.standard_normal(S))
        stated.append(1.0 - no_change(campaigns, rule))
        true.append(changed)
    probability = np.array(stated)
    has_changed = np.array(true)
    bin_number = np.digitize(probability, [0.2, 0.35, 0.5, 0.8, 0.95])
    for number in range(6):
        in_bin = bin_number == number
        in_this_bin = probability[in_bin]
        spread = np.sqrt(np.sum(in_this_bin * (1.0 - in_this_bin)))
        assert in_bin.sum() > 20
        error = abs(np.mean(has_changed[in_bin]) - np.mean(in_this_bin))
        assert error < 3.5 * max(spread, 1.0) / in_bin.sum()
    for threshold in (0.5, 0.8, 0.95):
        bound = (1.0 - threshold) / threshold
        false_alarms = np.mean(probability[~has_changed] > threshold)
        assert false_alarms < bound + 2.0 * np.sqrt(bound / 600)


# ---- points, limits, levels

SCALE = 0.02
CHANGE = 0.2


def visited(
    rng: np.random.Generator,
    n: int,
    *,
    r: float | None = None,
    step: tuple[int, int, float] | None = None,
) -> Gaussian:
    """Of the model, two parameters and one error: campaigns that see each in their own way, some
    hardly at all."""
    root = rng.standard_normal((n, 3, 4)) * np.array([60.0, 4.0, 40.0])[:, None]
    information = root @ np.swapaxes(root, 1, 2)
    scatter = r
    if scatter is None:
        scatter = halfnorm(scale=SCALE).rvs(random_state=rng)
    level = rng.standard_normal(2) + scatter * rng.standard_normal((n, 2))
    if step is not None:
        level[step[0] :, step[1]] += step[2]
    return drawn(rng, information, level, rng.standard_normal(1))


class Analysis(NamedTuple):
    """A series under the rule of the scatter: probabilities of hypotheses, the instrument's
    moments."""

    nodes: Array
    prior: Array
    carried: Gaussian
    weights: Array
    instrument: tuple[Array, Array]


def analyse(series: Gaussian) -> Analysis:
    nodes, prior = scatter_rule(SCALE)
    carried = carried_by(series, nodes, 2)
    posteriors = hypotheses(carried, 2, CHANGE)
    weights = hypothesis_probabilities(posteriors.log_integral, prior, 0.5)
    return Analysis(nodes, prior, carried, weights, common_moments(posteriors, weights))


@pytest.mark.slow
@pytest.mark.parametrize("limits", [0.997, 0.8])
def test_limits_cover_as_they_say(limits: float) -> None:
    """Where nothing changes; of every campaign from the second on, and of the early ones by
    themselves."""
    rng = np.random.default_rng(5)
    inside = []
    for _ in range(150):
        series = visited(rng, 7)
        nodes, prior, carried, _, moments = analyse(series)
        chart = chart_points(series, carried, nodes, prior, moments, limits=limits)
        assert np.isnan(chart.limits[:, 0]).all()
        inside.append((chart.estimate > chart.limits[0]) & (chart.estimate < chart.limits[1]))
    share = np.mean(np.array(inside)[:, 1:], axis=(0, 2))
    error = np.sqrt(limits * (1.0 - limits) / 300)
    np.testing.assert_allclose(share, limits, atol=3.5 * error)
    assert share.mean() == pytest.approx(limits, abs=3.0 * error / np.sqrt(3))


def test_instrument_and_levels_by_drawing_from_every_hypothesis() -> None:
    """Draws of (c, b, Δ) from each hypothesis, by its dense system."""
    rng = np.random.default_rng(7)
    n = 5
    p = 2
    q = 3
    series = visited(rng, n, r=0.02, step=(3, 0, 0.12))
    nodes, _, carried, weights, (mean, covariance) = analyse(series)
    level, sd, ends = current_levels(hypotheses(carried, p, CHANGE), weights)
    instrument_draws = []
    now = []
    total = []
    for i in range(len(nodes)):
        for k, j in product(range(1, n + 1), range(p)):
            weight = weights[i, k - 1, j]
            if weight < 1e-6:
                continue
            take = np.zeros((n, q, q + 1))
            take[:, :, :q] = np.eye(q)
            take[k:, j, q] = 1.0
            prior_precision = np.diag([*np.ones(q), CHANGE**-2])
            precision = np.einsum("tai,tab,tbj->ij", take, carried.precision[i], take)
            inside = np.linalg.inv(precision + prior_precision)
            shift = np.einsum("tai,ta->i", take, carried.shift[i])
            draws = rng.multivariate_normal(inside @ shift, inside, 200)
            instrument_draws.append(draws[:, p:q])
            now.append(draws[:, :p] + draws[:, q:] * take[-1, :p, q])
            total.append(np.full(200, weight / 200))
    weight = np.concatenate(total)
    b = np.concatenate(instrument_draws)
    c = np.concatenate(now)
    assert weight.sum() == pytest.approx(1.0, abs=1e-3)
    tolerance = 0.1 * np.sqrt(covariance[0, 0])
    assert weight @ b[:, 0] / weight.sum() == pytest.approx(mean[0], abs=tolerance)
    assert weight @ (b[:, 0] - mean[0]) ** 2 == pytest.approx(covariance[0, 0], rel=0.1)
    np.testing.assert_allclose((weight @ c - level) / sd, 0.0, atol=0.1)
    np.testing.assert_allclose(np.sqrt(weight @ (c - level) ** 2), sd, rtol=0.08)
    np.testing.assert_allclose(weight @ ((c > ends[0]) & (c < ends[1])), 0.95, atol=0.02)


def test_points_are_posteriors_of_campaigns_alone() -> None:
    p = 2
    series = visited(np.random.default_rng(8), 4)
    nodes, prior, carried, _, _ = analyse(series)
    instrument = np.array([0.4])
    spread = np.array([[0.25]])
    chart = chart_points(series, carried, nodes, prior, (instrument, spread))
    for t in range(4):
        covariance = np.linalg.inv(series.precision[t, :p, :p] + np.eye(p))
        response = covariance @ series.precision[t, :p, p:]
        expected = covariance @ series.shift[t, :p] - response @ instrument
        np.testing.assert_allclose(chart.estimate[t], expected)
        np.testing.assert_allclose(chart.sd[t], np.sqrt(np.diag(covariance)))
    precision = series.precision.sum(axis=0)
    shift = series.shift[:, :p].sum(axis=0)

    def common_level(b: Array) -> Array:
        return np.linalg.solve(precision[:p, :p] + np.eye(p), shift - precision[:p, p:] @ b)

    change = common_level(instrument + 0.5) - common_level(instrument)
    np.testing.assert_allclose(chart.common_sd, np.abs(change))
    other = chart_points(series, carried, nodes, prior, (instrument + 1.0, spread))
    np.testing.assert_allclose(
        other.limits[:, 1:] - other.estimate[1:],
        chart.limits[:, 1:] - chart.estimate[1:],
        atol=1e-9,
    )


# ---- the whole


@pytest.fixture(scope="module")
def rows() -> pd.DataFrame:
    return drawn_rows(10, np.random.default_rng(4), step_at=6)


@pytest.fixture(scope="module")
def stepped(rows: pd.DataFrame) -> Trend:
    return lb.fleet.find_trend(rows)


def by_time(trend: Trend) -> list[float]:
    return [visit.change_just_before for visit in trend.campaigns]


def names_of(trend: Trend) -> list[str]:
    return [visit.campaign for visit in trend.campaigns]


def test_a_loosened_joint(stepped: Trend) -> None:
    joint = stepped.parameters["C_XXX"]
    assert stepped.changed
    assert joint.probability == max(one.probability for one in stepped.parameters.values())
    assert sum(one.probability for one in stepped.parameters.values()) == pytest.approx(
        stepped.probability
    )
    assert sum(by_time(stepped)) == pytest.approx(stepped.probability)
    assert np.argmax(by_time(stepped)) == 6
    truth = 0.2 * one_campaign().mean[one_campaign().names.index("C_XXX")]
    assert abs(joint.change.mean - truth) < 3.0 * joint.change.sd
    assert joint.change.interval[0] < joint.change.mean < joint.change.interval[1]
    assert joint.percent == pytest.approx(20.0, abs=8.0)
    assert joint.place == 6
    assert stepped.most_probable == "C_XXX"
    assert joint.level_now.mean - joint.level_before == pytest.approx(joint.change.mean, rel=0.05)
    assert joint.level_now.sd > joint.common_sd > 0.0
    assert stepped.false_alarm == pytest.approx(1.0 / 19.0)
    table = stepped.estimates
    for side, end in ((-1.0, "ci_low"), (1.0, "ci_high")):
        np.testing.assert_allclose(
            table[end], table["estimate"] + side * norm.ppf(0.975) * table["sd"]
        )
    sentences = verdict(stepped)
    assert "Over 10 campaigns of M1 a change is found" in sentences
    assert "one of C_XXX" in sentences
    assert "between 2025-06-14 (c06) and 2025-07-14 (c07)" in sentences
    assert "a machine that stays as it is has probability 0.053 at most" in sentences
    assert doubts(stepped) == []
    for text in (str(stepped), stepped._repr_html_()):
        for phrase in ("M1, 10 campaigns", "nm/N", f"{joint.percent:+.0f} %", "a change is found"):
            assert phrase in text
    with_percent = [one for one in stepped.parameters.values() if one.percent is not None]
    assert joint in with_percent
    assert len(with_percent) < len(stepped.parameters)
    for one in with_percent:
        assert one.percent == pytest.approx(100.0 * one.change.mean / one.level_before)


def test_conformity_of_every_campaign(rows: pd.DataFrame, stepped: Trend) -> None:
    """Normal, with what the instrument adds; the limits of the newest campaign where none are
    given."""
    limit = stepped.parameters["C_XXX"].level_now.mean
    common = stepped.parameters["C_XXX"].common_sd
    estimates = stepped.estimates.query("parameter == 'C_XXX'")
    limits = {
        "C_XXX": lb.analysis.Tolerance(upper=limit),
        "stiffness_X": lb.analysis.Tolerance(lower=1.0 / limit),
    }
    conformity = lb.fleet.find_trend(rows, tolerances=limits).conformity
    expected = norm.cdf((limit - estimates["estimate"]) / np.hypot(estimates["sd"], common))
    for quantity in limits:
        probabilities = [one.probability for one in conformity[quantity].values()]
        np.testing.assert_allclose(probabilities, expected, atol=1e-9)
    assert list(conformity["C_XXX"]) == names_of(stepped)
    stated = rows.assign(tolerances='{"C_XXX": "60 nm/N", "G": "20 µm"}')
    assert list(lb.fleet.find_trend(stated).conformity) == ["C_XXX"]
    assert "≤ 60" in str(lb.fleet.find_trend(stated))
    assert stepped.conformity == {}


def test_the_probability_of_printed_intervals_is_named(rows: pd.DataFrame) -> None:
    """U = 2u is three times half the interval of 50 %, so that the interval is printed."""
    trend = lb.fleet.find_trend(rows, prob=0.5)
    level = trend.parameters["C_XXX"].level_now
    low, high = level.interval
    assert high - low == pytest.approx(2.0 * 0.6745 * level.sd, rel=0.05)
    printed = str(trend)
    assert f"[{low * 1e6:.1f}, {high * 1e6:.1f}] nm/N" in printed
    assert "[low, high]: 50 % interval" in printed


def test_a_machine_at_rest() -> None:
    quiet = lb.fleet.find_trend(drawn_rows(9, np.random.default_rng(5)))
    assert not quiet.changed
    assert quiet.probability < 0.5
    # "No change is found: its probability is …" would be read as that of no change.
    stated = f"no change is found: the probability of a change is {quiet.probability:.3f}"
    assert stated in verdict(quiet)
    odds = quiet.probability / (1.0 - quiet.probability)
    other = lb.fleet.find_trend(
        drawn_rows(9, np.random.default_rng(5)), probability=0.9, threshold=0.99
    )
    assert other.probability == pytest.approx(9.0 * odds / (1.0 + 9.0 * odds), rel=1e-9)
    assert other.false_alarm == pytest.approx(1.0 / 11.0)


def test_the_instruments_error_is_in_no_point(rows: pd.DataFrame) -> None:
    """A worse bar widens what is common, not points, limits or the step."""
    one, other = (
        lb.fleet.find_trend(campaigns)
        for campaigns in (rows, with_prior(rows, {"force_gain": (0.0, 0.03)}))
    )
    for name in ("C_XXX", "C_YYY"):
        assert other.parameters[name].common_sd > 1.05 * one.parameters[name].common_sd
    for column in ("sd", "limit_high"):
        np.testing.assert_allclose(
            other.estimates[column].dropna(),
            one.estimates[column].dropna(),
            rtol=0.08,
            atol=2e-3 * one.estimates["sd"].max(),
        )
    assert other.parameters["C_XXX"].change.mean == pytest.approx(
        one.parameters["C_XXX"].change.mean, rel=0.05
    )
    separate_bars = lb.fleet.find_trend(rows, one_instrument=False)
    assert np.isfinite(separate_bars.probability)
    # The machine's changes with force remain common.
    assert separate_bars.parameters["C_XXX"].common_sd > 0.0
    assert separate_bars.parameters["C_XXX"].common_sd < one.parameters["C_XXX"].common_sd


def test_the_prior_of_the_fits_does_not_matter(rows: pd.DataFrame) -> None:
    """The same likelihoods from fits that were told of the machine: the same step, as probable."""
    stepped = lb.fleet.find_trend(rows, one_instrument=False)
    truth = one_campaign()
    prior = {
        name: (1.1 * truth.mean[truth.names.index(name)], 0.04 * 1e-4)
        for name in ("C_XXX", "C_YYY")
    }
    other = lb.fleet.find_trend(with_prior(rows, prior), one_instrument=False)
    assert other.probability == pytest.approx(stepped.probability, rel=1e-6)
    for name, parameter in stepped.parameters.items():
        assert other.parameters[name].change.mean == pytest.approx(parameter.change.mean, rel=1e-5)
        assert other.parameters[name].level_now.mean == pytest.approx(
            parameter.level_now.mean, rel=1e-5
        )
    np.testing.assert_allclose(
        other.estimates["limit_high"], stepped.estimates["limit_high"], rtol=1e-5
    )


def test_order_of_time(rows: pd.DataFrame, stepped: Trend) -> None:
    """By date, whatever the order of rows; without dates as given; equal dates as given."""
    mixed = lb.fleet.find_trend(rows.sample(frac=1.0, random_state=3))
    assert names_of(mixed) == names_of(stepped)
    assert mixed.probability == pytest.approx(stepped.probability)
    undated = lb.fleet.find_trend(rows.assign(date=None))
    assert undated.probability == pytest.approx(stepped.probability)
    assert any("No campaign has a date" in doubt for doubt in doubts(undated))
    assert "between c06 and c07" in verdict(undated)
    zoned = rows.assign(
        date=["2026-01-01T12:00:00+02:00", "2026-01-01T11:00:00", *["2026-02-01"] * 8]
    )
    assert names_of(lb.fleet.find_trend(zoned))[:2] == ["c01", "c02"]
    some = rows.assign(date=[None, *rows["date"][1:]])
    refuses(r"a date all or none, got none for year/c01\. Write date", lb.fleet.find_trend, some)


def test_which_machine(rows: pd.DataFrame) -> None:
    two = pd.concat([rows, rows.assign(machine_id="M2", campaign="other/" + rows["name"])])
    refuses(
        r"of one machine, got those of M1, M2. Choose one: --machine M1", lb.fleet.find_trend, two
    )
    refuses(
        r"machine must be one of M1, M2, got 'm2'. Did you mean 'M2'",
        lb.fleet.find_trend,
        two,
        machine="m2",
    )
    nameless = lb.fleet.find_trend(rows.assign(machine_id=None))
    assert nameless.machine is None
    assert "No campaign names its machine" in doubts(nameless)[0]
    some = lb.fleet.find_trend(rows.assign(machine_id=[None, *["M1"] * 9]))
    assert (len(some.campaigns), doubts(some)[0]) == (
        9,
        "Left out, because they name no machine: c01.",
    )
    assert list(lb.fleet.find_trend(rows, parameters="C_XXX").parameters) == ["C_XXX"]


def test_the_level_now_and_the_value_that_is_decided_are_told_apart(rows: pd.DataFrame) -> None:
    """The level is a mean over campaigns; the decision has the estimate of the newest alone."""
    trend = lb.fleet.find_trend(rows, tolerances={"C_YYY": "60 nm/N"})
    newest = trend.estimates.query("parameter == 'C_YYY'")["estimate"].to_numpy()[-1]
    (*_, decision) = trend.conformity["C_YYY"].values()
    assert decision.mean == pytest.approx(newest)
    assert trend.parameters["C_YYY"].level_now.mean != pytest.approx(newest)
    sentences = " ".join(passage for passage in parts_of(trend) if isinstance(passage, str))
    assert "Level now: from all campaigns together" in sentences
    assert f"Value of the newest campaign alone, {names_of(trend)[-1]}," in sentences


def test_tolerances_go_before_those_of_the_newest_campaign(rows: pd.DataFrame) -> None:
    stated = rows.assign(tolerances='{"C_XXX": "60 nm/N", "C_YYY": "50 nm/N"}')
    conformity = lb.fleet.find_trend(stated, tolerances={"C_XXX": "70 nm/N"}).conformity
    limits = {
        name: {one.upper for one in by_force.values()} for name, by_force in conformity.items()
    }
    assert limits == {"C_XXX": {7e-5}, "C_YYY": {5e-5}}


def test_tolerances_of_the_newest_campaign_without_a_decision_are_named(
    rows: pd.DataFrame,
) -> None:
    limits = '{"C_XXX": "60 nm/N", "stiffness_Y": "18 N/µm", "E_C(0Y)X": "40 µrad", "G": "20 µm"}'
    stated = rows.assign(tolerances=limits)
    trend = lb.fleet.find_trend(stated, parameters=["C_XXX"])
    *_, not_followed, without_trend = doubts(trend)
    assert list(trend.conformity) == ["C_XXX"]
    assert not_followed.startswith("No decision on stiffness_Y, E_C(0Y)X, whose tolerance")
    assert "--parameters C_XXX,C_YYY,E_C0YX " in not_followed
    assert without_trend.startswith("No decision on G, whose tolerance")
    followed = lb.fleet.find_trend(stated, parameters=["C_XXX", "C_YYY", "E_C0YX"])
    assert list(followed.conformity) == ["C_XXX", "stiffness_Y", "E_C0YX"]
    assert len(doubts(followed)) == len(doubts(trend)) - 1


def test_a_campaign_that_failed_is_not_said_to_name_no_machine(rows: pd.DataFrame) -> None:
    with_failed = pd.concat(
        [rows, rows[-1:].assign(campaign="broken", name=None)], ignore_index=True
    )
    with_failed.loc[len(with_failed) - 1, ["status", "machine_id"]] = ["failed", None]
    trend = lb.fleet.find_trend(with_failed)
    caveats = {caveat.kind: caveat.names for caveat in trend.caveats}
    assert caveats[CaveatKind.FAILED_MACHINE_UNKNOWN] == ("broken",)
    assert not {CaveatKind.WITHOUT_MACHINE, CaveatKind.FAILED} & set(caveats)
    assert "of which machine they are is not known: broken." in " ".join(doubts(trend))


def test_the_force_of_compliances_is_stated(rows: pd.DataFrame) -> None:
    tolerances = {"C_XXX": "60 nm/N", "stiffness_Y": "18 N/µm"}
    trend = lb.fleet.find_trend(rows, reference_force_N=300.0, tolerances=tolerances)
    assert "compliances at 300 N" in str(trend)
    assert "Conformity (ISO 14253-1, JCGM 106), at 300 N" in str(trend)
    for decisions in trend.conformity.values():
        assert {decision.force_N for decision in decisions.values()} == {300.0}


def test_a_trend_states_its_doubts(rows: pd.DataFrame) -> None:
    """What is to be minded of campaigns, of one bar's length and balls, of two campaigns."""
    doubtful = rows.assign(status=["failed", *["done"] * 9], converged=[True, False, *[True] * 8])
    sentences = " ".join(doubts(lb.fleet.find_trend(doubtful, reference_force_N=20.0)))
    assert "the fit failed: c01." in sentences
    assert "Not converged, fit again with more draws: c02." in sentences
    assert "20 N, was not within the tested forces" in sentences
    assert "With two campaigns" in doubts(lb.fleet.find_trend(rows[:2]))[-1]
    assert "conservative for changes, not for levels" in verdict(lb.fleet.find_trend(rows))
    assert "not for levels" not in verdict(lb.fleet.find_trend(rows, one_instrument=False))


@pytest.mark.parametrize(("options", "message"), cases(__file__, "refusals.toml")["trend"])
def test_what_is_refused(rows: pd.DataFrame, options: dict[str, object], message: str) -> None:
    refuses(message, lb.fleet.find_trend, rows, **options)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["many", "no dates", "one day"])
def test_the_figure(case: str) -> None:
    """Units on its axes, text inside the page and clear of other text; campaigns of one day side by
    side."""
    n = 8
    step_at = 5
    if case == "many":
        n = 60
        step_at = 40
    rows = drawn_rows(n, np.random.default_rng(4), step_at=step_at)
    if case == "no dates":
        rows = rows.assign(date=None, machine_id=None)
    if case == "one day":
        rows = rows.assign(date="2026-01-01")
    chosen = {"one day": ["C_XXX"], "no dates": ["C_XXX", "C_YYY", "E_YX2"]}.get(case)
    result = lb.fleet.find_trend(rows, parameters=chosen)
    figure = lb.fleet.draw_control_chart(result)
    check_texts(figure)
    visible = [axes for axes in figure.axes if axes.get_visible()]
    assert len(visible) == len(result.parameters)
    for axes, name in zip(visible, result.parameters, strict=True):
        of_parameter = result.estimates["parameter"] == name
        probabilities = result.estimates.loc[of_parameter, "change_here"].to_numpy()
        lines = [line for line in axes.lines if str(line.get_label()).startswith("a change here")]
        opacities = [line.get_alpha() for line in lines]
        assert opacities == pytest.approx(probabilities[probabilities > 0.05].tolist())
        places = [float(line.get_xdata()[0]) for line in lines]  # type: ignore[index]
        assert places == sorted(places)
    assert "(nm/N)" in visible[0].get_ylabel()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("count", "with_dates"),
    [(2, {0, 1}), (3, {0, 1, 2}), (4, {2, 3}), (5, {2, 3, 4})],
)
def test_both_panels_of_a_row_have_dates_or_none(
    rows: pd.DataFrame, count: int, with_dates: set[int]
) -> None:
    names = ["C_XXX", "C_YYY", "C_CCY", "C_XYX", "C_CXY"][:count]
    figure = lb.fleet.draw_control_chart(lb.fleet.find_trend(rows, parameters=names))
    visible = [axes for axes in figure.axes if axes.get_visible()]
    named = {k for k, axes in enumerate(visible) if axes.get_xlabel().startswith("campaign")}
    assert named == with_dates
    check_texts(figure)


@pytest.mark.parametrize("estimate", [50.0, -50.0, 0.0])
def test_a_panel_of_one_value_has_a_vertical_range(estimate: float) -> None:
    ends = np.full((2, 3), estimate)
    zeros = np.zeros(3)
    data = _PanelData(np.arange(1.0, 4.0), ends[0], ends, ends, zeros > 0.0, zeros)
    bottom, top = _vertical_range(data)
    assert bottom < estimate < top


def test_scatter_rule_is_a_half_normal() -> None:
    nodes, weight = scatter_rule(0.01)
    assert weight.sum() == pytest.approx(1.0)
    assert weight @ nodes == pytest.approx(0.01 * np.sqrt(2.0 / np.pi), rel=2e-3)
    assert weight @ nodes**2 == pytest.approx(1e-4, rel=2e-3)

    def decay(r: Array) -> Array:
        return np.exp(-r / 0.003)

    expected = halfnorm(scale=0.01).expect(decay)
    assert weight @ decay(nodes) == pytest.approx(expected, rel=0.01)


def test_limits_are_of_what_the_next_campaign_would_say() -> None:
    """r known: the estimate of the third campaign, b known, drawn from its predictive
    distribution."""
    rng = np.random.default_rng(9)
    r = 0.05
    series = visited(rng, 3)
    instrument = np.array([0.4])
    carried = carried_by(series, np.array([r]), 2)
    chart = chart_points(
        series, carried, np.array([r]), np.ones(1), (instrument, np.eye(1)), limits=0.9
    )
    precision = np.eye(3) + carried.precision[0, :2].sum(axis=0)
    first_two = Gaussian(precision, carried.shift[0, :2].sum(axis=0))
    x = first_two.draw(rng, (200_000,))
    x[:, :2] += r * rng.standard_normal((len(x), 2))
    noise = rng.standard_normal(x.shape) @ np.linalg.cholesky(series.precision[2]).T
    shift = (x @ series.precision[2] + noise)[:, :2]
    shrink = np.linalg.inv(np.eye(2) + series.precision[2, :2, :2])
    estimates = (shift - series.precision[2, :2, 2] * instrument) @ shrink
    sd = estimates.std(axis=0)
    error = chart.limits[:, 2] - np.quantile(estimates, [0.05, 0.95], axis=0)
    np.testing.assert_allclose(error / sd, 0.0, atol=0.03)


def test_nodes_of_the_scatter_have_the_moments_of_a_half_normal_density() -> None:
    scatter, weight = scatter_rule(0.3)
    assert weight @ scatter**2 == pytest.approx(halfnorm(scale=0.3).moment(2), rel=2e-4)
    assert weight @ scatter**4 == pytest.approx(halfnorm(scale=0.3).moment(4), rel=2e-4)
