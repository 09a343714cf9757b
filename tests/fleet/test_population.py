"""A population against dense Gaussians of everything, its spreads against grids, coverage in
made-up fleets, what is said."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns import plan, refuses
from fleets import dense, doubts, fleet, of_campaigns, with_likelihood
from scipy.stats import halfnorm, kstest, norm

import ldbb_bayes as lb
from ldbb_bayes.analysis.compliance_meaning import same_meaning, stands_for
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet import outlying_machines
from ldbb_bayes.fleet.deviations import estimate_separately
from ldbb_bayes.fleet.fleet_statistics import FleetStatistics
from ldbb_bayes.fleet.interval_summary import Summary
from ldbb_bayes.fleet.outlying_machines import JudgedMachines, judge_machines
from ldbb_bayes.fleet.pooling import pool
from ldbb_bayes.fleet.population import Population
from ldbb_bayes.fleet.population_prior import digest_of
from ldbb_bayes.fleet.spread_density import (
    SpreadDensity,
    Spreads,
    draw_spreads,
    machine_estimates,
    machine_likelihoods,
    shared_quantities,
)
from ldbb_bayes.machine.linear import compliance_jacobian
from ldbb_bayes.machine.parameters import ComplianceName
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.report.wording import population_sentences, with_words

SCALE = 0.3
SPREAD = np.array([0.3, 0.05, 1.4])
TWO = np.array([0.3, 0.05])
OUTLIER = np.array([3.0, 0, 0, 0, 0, 0])


def density_of(statistics: FleetStatistics, scale: float = SCALE) -> SpreadDensity:
    return SpreadDensity(machine_likelihoods(statistics)[1], scale)


def fixed(spread: np.ndarray) -> Spreads:
    """Draws that are all the same spread."""
    n = 64
    draws = np.tile(spread, (n, 1))
    weight = np.full(n, 1.0 / n)
    return Spreads(draws, np.zeros(n), weight, -np.inf, 0.5, np.log(spread))


def judged(density: SpreadDensity, spreads: Spreads) -> JudgedMachines:
    return judge_machines(
        density, spreads, shared_quantities(density.likelihood, spreads.spread), seed=1
    )


# ---- given the spreads


@pytest.fixture
def statistics(rng: np.random.Generator) -> FleetStatistics:
    """Four machines, one of them with three campaigns."""
    return replace(fleet(rng, machines=6, parameters=3), machines=("a", "b", "b", "c", "d", "b"))


def test_the_dense_gaussian(statistics: FleetStatistics) -> None:
    spreads = np.array([SPREAD, 0.5 * SPREAD, SPREAD[::-1]])
    machines, likelihood = machine_likelihoods(statistics)
    assert machines == ("a", "b", "c", "d")
    common = shared_quantities(likelihood, spreads)
    expected = [dense(statistics, spread) for spread in spreads]
    log_density = np.array([moments[0] for moments in expected])
    np.testing.assert_allclose(
        common.log_integral - common.log_integral[0], log_density - log_density[0], atol=1e-8
    )
    estimates = machine_estimates(likelihood, spreads, common)
    for k, (_, mean, covariance) in enumerate(expected):
        np.testing.assert_allclose(common.mean[k], mean[12:], atol=1e-8)
        np.testing.assert_allclose(common.covariance[k], covariance[12:, 12:], atol=1e-9)
        sd = np.sqrt(np.diag(covariance)[:12])
        z = estimates.z_mean[k]
        z_variance = estimates.z_variance[k]
        np.testing.assert_allclose(estimates.mean[k].ravel(), mean[:12], atol=1e-8)
        np.testing.assert_allclose(estimates.sd[k].ravel(), sd, atol=1e-8)
        for m in range(4):
            pick = np.zeros((3, len(mean)))
            pick[:, m * 3 : m * 3 + 3] = np.eye(3)
            pick[:, 12:15] = -np.eye(3)
            variance = np.diag(pick @ covariance @ pick.T)
            np.testing.assert_allclose(z[m] * spreads[k], pick @ mean, atol=1e-8)
            np.testing.assert_allclose(z_variance[m] * spreads[k] ** 2, variance, atol=1e-8)


def test_chunks_are_the_whole(rng: np.random.Generator) -> None:
    """Many spreads at once, and one by one."""
    _, likelihood = machine_likelihoods(fleet(rng, machines=300, parameters=2))
    spreads = rng.uniform(0.1, 0.5, (70, 2))
    at_once = shared_quantities(likelihood, spreads).log_integral
    single = []
    for spread in spreads:
        single.append(float(shared_quantities(likelihood, spread[None]).log_integral[0]))
    np.testing.assert_allclose(at_once, single, rtol=1e-12)


# ---- the spreads


@pytest.mark.parametrize("spread", [0.0, 0.2])
@pytest.mark.parametrize("parameters", [1, 2])
def test_draws_are_those_of_a_grid(
    rng: np.random.Generator, parameters: int, spread: float
) -> None:
    """Over s itself with its half-normal prior: neither logarithm nor Jacobian."""
    target = density_of(fleet(rng, machines=5, parameters=parameters, spread=spread))
    axis = (np.arange(240) + 0.5) * 1.5 / 240
    axes = np.meshgrid(*[axis] * parameters, indexing="ij")
    grid = np.stack(axes, axis=-1).reshape(-1, parameters)
    log_prior = halfnorm(scale=SCALE).logpdf(grid).sum(axis=1)
    log_weight = shared_quantities(target.likelihood, grid).log_integral + log_prior
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    mean = weight @ grid
    sd = np.sqrt(weight @ (grid - mean) ** 2)
    draws = draw_spreads(target, parameters, seed=1)
    assert draws.trusted
    mean_of_draws = draws.weight @ draws.spread
    sd_of_draws = np.sqrt(draws.weight @ (draws.spread - mean_of_draws) ** 2)
    np.testing.assert_allclose((mean_of_draws - mean) / sd, 0.0, atol=0.03)
    np.testing.assert_allclose(sd_of_draws, sd, rtol=0.04)


def test_the_gradient_has_prior_and_jacobian(rng: np.random.Generator) -> None:
    target = density_of(fleet(rng, machines=4, parameters=2))
    h = 1e-5
    t = np.array([-1.0, -3.0])
    for j, step in enumerate(h * np.eye(2)):
        above, below = target.log(np.array([t + step, t - step]))
        assert target.gradient(t[None])[0, j] == pytest.approx(
            (above - below) / (2.0 * h), rel=1e-7
        )
    both = np.array([t, t + np.array([0.3, 0.0])])
    log_prior = halfnorm(scale=SCALE).logpdf(np.exp(both)).sum(axis=1) + both.sum(axis=1)
    log_integral = shared_quantities(target.likelihood, np.exp(both)).log_integral
    difference = np.diff(target.log(both)) - np.diff(log_integral)
    assert difference == pytest.approx(np.diff(log_prior), rel=1e-9)


@pytest.mark.parametrize("scale", [1e-8, 1e-3, 0.3, 30.0])
def test_any_prior_of_the_spread_will_do(rng: np.random.Generator, scale: float) -> None:
    draws = draw_spreads(density_of(fleet(rng, machines=5), scale), 6, seed=1, size=8192)
    assert draws.trusted
    assert draws.effective > 1000.0
    if scale < 1e-6:
        np.testing.assert_allclose(
            draws.weight @ draws.spread, scale * np.sqrt(2.0 / np.pi), rtol=0.03
        )
    silent_fleet = fleet(rng, machines=3, parameters=2, uncertainty=1e6)
    silent = draw_spreads(density_of(silent_fleet, scale), 2, seed=1)
    np.testing.assert_allclose(
        silent.weight @ silent.spread, scale * np.sqrt(2.0 / np.pi), rtol=0.03
    )
    np.testing.assert_allclose(silent.weight @ silent.spread**2, scale**2, rtol=0.05)


# ---- machines against the others


def test_a_machine_against_the_dense_prediction(rng: np.random.Generator) -> None:
    """s known: a given the others is Gaussian, with moments from one dense matrix of everything."""
    six_machines = fleet(rng, machines=6, parameters=2)
    outliers = judged(density_of(six_machines), fixed(TWO))
    information = six_machines.likelihood.precision
    weighted = six_machines.likelihood.shift
    spreads = np.array([TWO, TWO[::-1], 2.0 * TWO])
    x = shared_quantities(six_machines.likelihood, spreads)
    separate = estimate_separately(six_machines.likelihood, 2)
    log_density, _ = outlying_machines._compare_each_with_others(
        six_machines.likelihood, separate, spreads, x
    )
    log_evidence = shared_quantities(six_machines.likelihood, spreads).log_integral
    for m in range(6):
        five_machines = of_campaigns(six_machines, [k for k in range(6) if k != m])
        left_out = log_evidence - shared_quantities(five_machines.likelihood, spreads).log_integral
        np.testing.assert_allclose(np.diff(log_density[:, m]), np.diff(left_out), rtol=1e-8)
        _, mean, covariance = dense(five_machines, TWO)
        mean = mean[10:]
        covariance = covariance[10:, 10:].copy()
        covariance[:2, :2] += np.diag(TWO**2)
        rows = information[m][:2]
        residual = weighted[m][:2] - rows @ mean
        spread = rows @ covariance @ rows.T + rows[:, :2]
        single = np.linalg.inv(rows[:, :2] + np.eye(2))
        z = (single @ residual) / np.sqrt(np.diag(single @ spread @ single.T))
        np.testing.assert_allclose(outliers.z[m], z, rtol=1e-6)
        np.testing.assert_allclose(
            outliers.parameter_p_value[m], 2.0 * norm.sf(np.abs(z)), rtol=1e-6
        )
    sorted_p_values = np.sort(np.minimum(1.0, 2.0 * outliers.parameter_p_value.min(axis=1)))
    assert outliers.p_value.min() == pytest.approx(min(1.0, 6.0 * sorted_p_values[0]), rel=1e-9)
    assert outliers.p_value.max() == pytest.approx(
        max(np.minimum(1.0, sorted_p_values * np.arange(6, 0, -1))), rel=1e-9
    )


def test_readings_that_tell_fewer_numbers_than_parameters(rng: np.random.Generator) -> None:
    """A machine of rank one has one z for all parameters; one without information has p = 1."""
    six_machines = fleet(rng, machines=6, parameters=2)
    information = six_machines.likelihood.precision.copy()
    weighted = six_machines.likelihood.shift.copy()
    row = np.array([1.0, 0.5, 0.2, 0.1])
    information[0] = np.outer(row, row) * 100.0
    weighted[0] = 10.0 * row * 8.0
    information[1] = 0.0
    weighted[1] = 0.0
    outliers = judged(density_of(with_likelihood(six_machines, information, weighted)), fixed(TWO))
    assert outliers.p_value[1] == 1.0
    assert outliers.z[1].tolist() == [0.0, 0.0]
    assert abs(outliers.z[0, 0]) == pytest.approx(abs(outliers.z[0, 1]), rel=1e-6)


def test_drawn_anew_or_weighted(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Weights that can be trusted give what draws without the machine give."""
    density = density_of(fleet(rng, machines=12, parameters=2))
    spreads = draw_spreads(density, 2, seed=1)
    common = shared_quantities(density.likelihood, spreads.spread)
    weighed = judged(density, spreads)
    calls = []
    real = outlying_machines.pareto_smooth
    machines = iter(range(12))

    def first_in_vain(log_ratio: np.ndarray) -> tuple[np.ndarray, float, float]:
        unsmoothed = np.full(len(log_ratio), 1.0 / len(log_ratio)), 9.0, 0.5
        if next(machines, None) is None:
            return real(log_ratio)
        return unsmoothed

    monkeypatch.setattr(outlying_machines, "pareto_smooth", first_in_vain)

    def record(count: int, total: int) -> None:
        calls.append((count, total))

    anew = judge_machines(density, spreads, common, seed=1, progress=record)
    assert calls[-1] == (12, 12)
    np.testing.assert_allclose(
        anew.parameter_p_value, weighed.parameter_p_value, rtol=0.1, atol=2e-3
    )
    np.testing.assert_allclose(anew.z, weighed.z, atol=0.1)


@pytest.mark.slow
def test_p_values_are_uniform_and_z_standard() -> None:
    """Fleets of the model, spreads and all; one machine of each, so that they are independent."""
    rng = np.random.default_rng(11)
    p = []
    z = []
    for _ in range(100):
        spread = np.abs(rng.standard_normal(2)) * 0.3
        mean = rng.standard_normal(2)
        density = density_of(fleet(rng, machines=7, parameters=2, spread=spread, mean=mean))
        outliers = judged(density, draw_spreads(density, 2, seed=1, size=256))
        p.append(outliers.parameter_p_value[3])
        z.append(outliers.z[3])
    assert kstest(np.ravel(p), "uniform").pvalue > 0.01
    assert kstest(np.ravel(z), "norm").pvalue > 0.01


def test_an_outlier_is_flagged() -> None:
    thirty_machines = fleet(
        np.random.default_rng(5), machines=30, outlier=np.array([0.0, 0.0, 3.0, 0.0, 0.0, 0.0])
    )
    density = density_of(thirty_machines)
    outliers = judged(density, draw_spreads(density, 6, seed=1, size=1024))
    assert (outliers.p_value < 0.05).tolist() == [True] + [False] * 29
    assert np.argmax(np.abs(outliers.z[0])) == 2
    assert outliers.z[0, 2] > 5.0
    assert not outliers.doubtful.any()


# ---- the whole


def test_spreads_follow_their_prior(rng: np.random.Generator) -> None:
    three_machines = fleet(rng, machines=3, parameters=2)
    narrow, wide = (
        pool(three_machines, spread_scale=scale).parameters["C_XXX"].spread.mean
        for scale in (0.01, 0.3)
    )
    assert narrow < 0.2 * wide


@pytest.fixture(scope="module")
def eight_machines() -> Population:
    """Eight machines, the first of another kind."""
    return pool(fleet(np.random.default_rng(3), machines=8, outlier=OUTLIER))


def test_everything_against_a_sum_over_dense_gaussians(rng: np.random.Generator) -> None:
    """One parameter: s on a grid with its half-normal prior, everything else from dense
    matrices."""
    four_machines = fleet(rng, machines=4, parameters=1)
    result = pool(four_machines)
    grid = (np.arange(300) + 0.5) * 1.5 / 300
    dense_moments = [dense(four_machines, np.array([s])) for s in grid]
    log_density = np.array([moments[0] for moments in dense_moments])
    log_weight = log_density - 0.5 * (grid / 0.3) ** 2
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    means = np.array([moments[1] for moments in dense_moments])
    variances = np.array([np.diag(moments[2]) for moments in dense_moments])
    mean = weight @ means
    sd = np.sqrt(weight @ (variances + (means - mean) ** 2))
    unit = four_machines.prior_sd[0]
    parameter = result.parameters["C_XXX"]
    assert parameter.mean.mean / unit == pytest.approx(mean[4], abs=0.01 * sd[4])
    assert parameter.mean.sd / unit == pytest.approx(sd[4], rel=0.01)
    assert parameter.spread.mean / unit == pytest.approx(weight @ grid, rel=0.01)
    assert parameter.next.mean == parameter.mean.mean
    assert parameter.next.sd / unit == pytest.approx(
        np.sqrt(sd[4] ** 2 + weight @ grid**2), rel=0.01
    )
    for m, machine in enumerate(result.machine.values()):
        assert machine.estimate["C_XXX"].mean / unit == pytest.approx(mean[m], abs=0.02 * sd[m])
        assert machine.estimate["C_XXX"].sd / unit == pytest.approx(sd[m], rel=0.01)
    precisions = [np.linalg.inv(moments[2][4:, 4:]) for moments in dense_moments]
    conditional_variance = np.array([1.0 / precision[0, 0] for precision in precisions])
    variance = weight @ conditional_variance + weight @ (means[:, 4] - mean[4]) ** 2
    share = 1.0 - variance / sd[4] ** 2
    assert parameter.instrument_sd / unit == pytest.approx(sd[4] * np.sqrt(share), rel=0.02)


def test_alone_is_a_fit_with_the_instrument_known_as_all_know_it(rng: np.random.Generator) -> None:
    """(A + I)⁻¹ (a − B b), b drawn from its posterior, against draws."""
    three_machines = fleet(rng, machines=3, parameters=2)
    result = pool(three_machines)
    density = density_of(three_machines)
    spreads = draw_spreads(density, 2, seed=1)
    common = shared_quantities(density.likelihood, spreads.spread)
    pick = rng.choice(len(spreads.weight), 40_000, p=spreads.weight)
    x = Gaussian(common.precision[pick], common.shift[pick]).draw(rng)
    a = density.likelihood.shift[1, :2]
    rows = density.likelihood.precision[1, :2]
    inverse = np.linalg.inv(rows[:, :2] + np.eye(2))
    noise = rng.standard_normal((len(pick), 2)) @ np.linalg.cholesky(inverse).T
    draws = ((a - x[:, 2:] @ rows[:, 2:].T) @ inverse + noise) * three_machines.prior_sd[:2]
    for j, name in enumerate(three_machines.parameters):
        summary = result.machine["M02"].alone[name]
        assert summary.mean == pytest.approx(draws[:, j].mean(), abs=0.03 * summary.sd)
        assert summary.sd == pytest.approx(draws[:, j].std(), rel=0.02)
        assert summary.interval == pytest.approx(
            tuple(np.quantile(draws[:, j], [0.025, 0.975])), abs=0.06 * summary.sd
        )


def test_a_machine_that_does_not_belong(eight_machines: Population) -> None:
    assert eight_machines.not_belonging == ("M01",)
    head = "M01 does not belong with the others: p < 0.0001 over all machines, most in C_XXX"
    assert any(sentence.startswith(head) for sentence in population_sentences(eight_machines))
    five_machines = pool(fleet(np.random.default_rng(3), machines=5))
    assert five_machines.not_belonging == ()
    assert {machine.p_value for machine in five_machines.machine.values()} == {None}
    assert "With 5 machines the spread between them rests on its prior" in " ".join(
        doubts(five_machines)
    )


def test_the_record(eight_machines: Population) -> None:
    record = with_words(eight_machines)
    following = eight_machines.parameters["C_XXX"].next
    again = json.loads(json.dumps(record))
    assert again["sha256"] == digest_of(again)
    assert again["next"]["C_XXX"] == {"unit": "mm/N", "mean": following.mean, "sd": following.sd}
    again["next"]["C_XXX"]["sd"] *= 1.0 + 1e-12
    assert again["sha256"] != digest_of(again)
    two_kinds = replace(
        fleet(np.random.default_rng(1), machines=3, parameters=2),
        parameters=("C_XXX", "E_XX1"),
        units=("mm/N", "1"),
    )
    other = pool(two_kinds).as_dict()
    assert (list(other["next"]), list(other["parameters"])) == (["C_XXX"], ["C_XXX", "E_XX1"])
    machines = eight_machines.machines_table()
    assert machines.loc["M02", "C_YYY.mean"] == eight_machines.machine["M02"].estimate["C_YYY"].mean
    assert machines["flag"].sum() == 1
    assert "or the 50 % interval where ± U" in str(replace(eight_machines, prob=0.5))
    for text in (str(eight_machines), eight_machines._repr_html_()):
        for phrase in (
            "8 machines, 8 campaigns; compliances at 389 N, tested from 36 to 742 N.",
            "nm/N",
            "M01 does not belong",
        ):
            assert phrase in text


def test_a_summary_is_printed_with_rounded_numbers() -> None:
    summary = Summary(1.07434218e-05, 2.7e-06, (6.401137723460878e-06, 1.7e-05))
    assert "(6.40114·10⁻⁶, 1.7·10⁻⁵)" in str(summary)


def test_names_of_machines_are_kept(eight_machines: Population, tmp_path: Path) -> None:
    """Only the pair of numbers ``interval`` has a key of its own; a machine may be called so."""
    names = ["interval_mill", "interval", *list(eight_machines.machine)[2:]]
    machines = {}
    for name, machine in zip(names, eight_machines.machine.values(), strict=True):
        machines[name] = replace(machine, name=name)
    renamed = replace(eight_machines, machine=machines)
    record = renamed.as_dict()
    assert list(record["machine"]) == names
    assert "ci95" in record["machine"]["interval"]["estimate"]["C_XXX"]
    path = tmp_path / "population.json"
    path.write_text(json.dumps(with_words(renamed)))
    assert lb.fleet.read_population_prior(path).machine_ids == frozenset(names)


def test_what_each_its_own_bar_changes(rng: np.random.Generator) -> None:
    """No error is common to all, and nothing is said of one."""
    three_machines = fleet(rng, machines=3, parameters=2)
    information = three_machines.likelihood.precision[:, :2, :2]
    weighted = three_machines.likelihood.shift[:, :2]
    result = pool(
        with_likelihood(
            three_machines,
            information,
            weighted,
            instrument=(),
            prior_sd=three_machines.prior_sd[:2],
        )
    )
    assert {entry.instrument_sd for entry in result.parameters.values()} == {0.0}
    assert "one bar" not in " ".join(doubts(result))
    assert "mount deflection, force gain" in " ".join(doubts(pool(three_machines)))


def test_a_population_states_its_doubts(rng: np.random.Generator) -> None:
    """Of one bar's length and balls, of forces that were not tested; readings that tell nothing
    leave the prior."""
    two_machines = fleet(rng, machines=2, parameters=1)
    for other in ({"reference_force_N": 900.0}, {"forces_N": (500.0, 300.0)}):
        assert "was not within the tested forces of every campaign" in " ".join(
            doubts(pool(replace(two_machines, **other)))
        )
    assert (
        "conservative for differences between machines, not for the population's mean"
        in " ".join(doubts(pool(two_machines)))
    )
    nothing = pool(
        with_likelihood(
            two_machines,
            0.0 * two_machines.likelihood.precision,
            0.0 * two_machines.likelihood.shift,
        )
    ).parameters["C_XXX"]
    assert nothing.mean.mean == 0.0
    assert nothing.spread.mean / nothing.prior_sd == pytest.approx(
        0.3 * np.sqrt(2.0 / np.pi), rel=0.03
    )


RESULT: dict[str, Any] = json.loads(
    Path(__file__).with_name("population.json").read_text(encoding="utf-8")
)


def written(folder: Path, **changes: Any) -> Path:
    record = json.loads(json.dumps(RESULT | changes))
    (folder / "population.json").write_text(json.dumps({"sha256": digest_of(record)} | record))
    return folder


def test_sets_means_and_sds_at_the_populations_force(tmp_path: Path) -> None:
    prior = lb.fleet.read_population_prior(written(tmp_path))
    assert prior == lb.fleet.read_population_prior(tmp_path / "population.json")
    assert (prior.machines, prior.campaigns, prior.sha256) == (24, 60, digest_of(RESULT))
    model = lb.HybridModel.first(1)
    bound = prior.model(model).bind(plan())
    bound_default = model.bind(plan())
    assert bound.setting.reference_force_N == 300.0
    prior_by_name = {p.name: (p.prior_mean, p.prior_sd) for p in bound.parameters}
    for name, entry in RESULT["next"].items():
        assert prior_by_name[name] == (entry["mean"], entry["sd"])
    unchanged = [i for i, name in enumerate(bound.names) if name not in RESULT["next"]]
    np.testing.assert_array_equal(bound.prior_sd[unchanged], bound_default.prior_sd[unchanged])
    assert not bound.prior_mean[unchanged].any()
    assert prior.model(replace(model, reference_force_N=300.0)) == prior.model(model)
    assert prior.doubts(plan()) == ()
    assert pickle.loads(pickle.dumps(prior)) == prior


def test_doubts_of_a_prior(tmp_path: Path) -> None:
    """Forces elsewhere, the machine itself, what the population says of itself."""
    prior = lb.fleet.read_population_prior(
        written(tmp_path, doubts=["Its spreads cannot be trusted."])
    )
    force, stated = prior.doubts(plan((40, 40), forces_N=(400.0, 742.0)))
    assert force.startswith(
        "The population's compliances are meant at 300 N, outside this campaign's forces (400 to"
        " 742 N)"
    )
    assert stated == "The population says: Its spreads cannot be trusted."
    assert (
        "has campaigns of this machine (M07)" in prior.doubts(replace(plan(), machine_id="M07"))[0]
    )


def test_an_edited_file_is_refused(tmp_path: Path) -> None:
    file = written(tmp_path) / "population.json"
    record = json.loads(file.read_text())
    file.write_text(json.dumps(record, indent=2, sort_keys=True))
    assert lb.fleet.read_population_prior(file).sds["C_XXX"] == 4e-6
    record["next"]["C_XXX"]["sd"] = 4.1e-6
    file.write_text(json.dumps(record))
    refuses(
        r"its sha256 is not that of its contents: it was edited",
        lb.fleet.read_population_prior,
        file,
    )


def test_a_fit_given_as_a_population_is_refused_with_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "summary.json").write_text("{}", encoding="utf-8")
    advice = (
        r"one machine goes by hand into \[prior.means\] and \[prior.overrides\] of a model.toml"
    )
    for path in (tmp_path, tmp_path / "summary.json"):
        refuses(advice, lb.fleet.read_population_prior, path)


def test_other_machines_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError,
        match=(
            r"topology must be the population's 'wCAFYXZSt' to use its prior, got 'wXFYZt'\. Use a"
        ),
    ):
        lb.fleet.read_population_prior(written(tmp_path)).doubts(replace(plan(), topology="wXFYZt"))
    other = lb.fleet.read_population_prior(
        written(tmp_path, next={"C_ZZZ": {"unit": "mm/N", "mean": 5e-5, "sd": 1e-6}})
    )
    refuses(
        r"must have the population's compliances, got C_XXX, .* without C_ZZZ\.",
        other.doubts,
        plan(),
    )


def test_compliances_of_another_place_are_refused(tmp_path: Path) -> None:
    meanings = stands_for(plan())
    prior = lb.fleet.read_population_prior(written(tmp_path, compliances=meanings))
    assert prior.compliances == meanings
    assert prior.doubts(plan()) == ()
    higher = replace(plan(), tests=tuple(replace(test, centre_z_mm=100.0) for test in plan().tests))
    refuses(
        r"must mean by C_XXX what the population does, got circles or joints' frames",
        prior.doubts,
        higher,
    )


def test_models_it_does_not_go_with(tmp_path: Path) -> None:
    prior = lb.fleet.read_population_prior(written(tmp_path))
    model = lb.HybridModel.first(1)
    with pytest.raises(
        InputError,
        match=r"must have proper priors to take a population's, got flat ones\. Use the default",
    ):
        prior.model(lb.HybridModel.paper(0))
    refuses(
        r"C_XYX must be free to have the population's prior, got one fixed at zero",
        prior.model,
        model.fixing("C_XYX"),
    )
    for changes in ({"overrides": {"C_XXX": 1e-5}}, {"means": {"C_XXX": 1e-5}}):
        with pytest.raises(
            InputError, match="C_XXX must have one prior, got the population's and the model's own"
        ):
            prior.model(replace(model, prior=replace(model.prior, **changes)))
    with pytest.raises(
        InputError, match=r"reference_force_N must be the population's 300 N, .* got 389 N\. Leave"
    ):
        prior.model(replace(model, reference_force_N=389.0))


def test_what_is_no_population(tmp_path: Path) -> None:
    for changes in ({"schema": 2}, {"kind": "fit"}):
        refuses(
            r"must be a population written by .*, got another file or a damaged one",
            lb.fleet.read_population_prior,
            written(tmp_path, **changes),
        )
    for content in (b"{", b"\xff\xfe\x00", b"[" * 100_000, b"[]"):
        (tmp_path / "population.json").write_bytes(content)
        refuses(
            r"must be a population written by|must be a population, got",
            lb.fleet.read_population_prior,
            tmp_path,
        )


# ---- what a compliance stands for

FRAMES = {"X": (10.0, 300.0, -200.0), "Y": (-50.0, 20.0, 400.0)}


def placed(
    centre_mm: tuple[float, float, float] = (0.0, 0.0, 0.0), radius_mm: float = 150.0, **fields: Any
) -> Campaign:
    """A plan whose circles lie there."""
    x, y, z = centre_mm
    circle = {"centre_x_mm": x, "centre_y_mm": y, "centre_z_mm": z, "radius_mm": radius_mm}
    centred = plan()
    return replace(
        centred, tests=tuple(replace(test, **circle) for test in centred.tests), **fields
    )


def test_the_sum_is_what_readings_see(rng: np.random.Generator) -> None:
    """Joints' compliances drawn, the kept ones made of them: the same readings of a circle off the
    centre."""
    campaign = placed((120.0, -40.0, 90.0), frames_mm=FRAMES)
    meanings = stands_for(campaign)
    members = sorted(set().union(*meanings.values()))
    truth = dict(zip(members, rng.standard_normal(len(members)), strict=True))
    names = [ComplianceName(*label[2:]) for label in (*members, *meanings)]
    circle = next(iter(campaign.tests)).circle
    jacobian = compliance_jacobian(campaign.machine(), circle, np.linspace(0.0, 6.0, 40), names)
    sums = []
    for weights in meanings.values():
        sums.append(sum(weight * truth[label] for label, weight in weights.items()))
    expected = jacobian[:, : len(members)] @ list(truth.values())
    error = jacobian[:, len(members) :] @ sums - expected
    assert np.linalg.norm(error) < 1e-6 * np.linalg.norm(expected)


@pytest.mark.parametrize(("frames", "length"), [({}, 80.0), (FRAMES, 280.0)])
def test_a_radius_does_not_matter(frames: dict[str, Any], length: float) -> None:
    meanings = stands_for(placed((0.0, 0.0, 80.0), frames_mm=frames))
    assert meanings == stands_for(placed((0.0, 0.0, 80.0), radius_mm=50.0, frames_mm=frames))
    assert meanings["C_XXX"]["C_BXX"] == length


def test_a_millimetre_counts_for_nothing_and_a_decimetre_does() -> None:
    """Along the wrench; in the frames' plane nothing does."""
    one, near, far = (stands_for(placed((0.0, 0.0, z))) for z in (0.0, 1.0, 100.0))
    assert one["C_XXX"] == {"C_XXX": 1.0, "C_XXY": 1.0}
    assert stands_for(placed((100.0, -30.0, 0.0))) == one
    assert far["C_XXX"]["C_BXX"] == pytest.approx(100.0)
    assert near["C_XXX"] != one["C_XXX"]
    assert all(same_meaning(name, one[name], near[name]) for name in one)
    assert [name for name in one if not same_meaning(name, one[name], far[name])] == [
        "C_XXX",
        "C_XYX",
        "C_YYY",
        "C_CXY",
        "C_CYY",
    ]
