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
from fleets import dense, doubts, fleet, of_campaigns, telling
from scipy.stats import halfnorm, kstest, norm

import ldbb_bayes as lb
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet import outlying_machines
from ldbb_bayes.fleet.compliance_meaning import same_meaning, stands_for
from ldbb_bayes.fleet.deviations import estimate_separately
from ldbb_bayes.fleet.fleet_statistics import FleetStatistics
from ldbb_bayes.fleet.outlying_machines import JudgedMachines, judge_machines
from ldbb_bayes.fleet.population import Population, pool
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
    return Spreads(
        np.tile(spread, (n, 1)), np.zeros(n), np.full(n, 1.0 / n), -np.inf, 0.5, np.log(spread)
    )


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
    log_density = np.array([own[0] for own in expected])
    np.testing.assert_allclose(
        common.log_integral - common.log_integral[0], log_density - log_density[0], atol=1e-8
    )
    found = machine_estimates(likelihood, spreads, common)
    for k, (_, mean, covariance) in enumerate(expected):
        np.testing.assert_allclose(common.mean[k], mean[12:], atol=1e-8)
        np.testing.assert_allclose(common.covariance[k], covariance[12:, 12:], atol=1e-9)
        middle, sd, z, variance = (own[k] for own in found)
        np.testing.assert_allclose(middle.ravel(), mean[:12], atol=1e-8)
        np.testing.assert_allclose(sd.ravel(), np.sqrt(np.diag(covariance)[:12]), atol=1e-8)
        for m in range(4):
            pick = np.zeros((3, len(mean)))
            pick[:, m * 3 : m * 3 + 3], pick[:, 12:15] = np.eye(3), -np.eye(3)
            np.testing.assert_allclose(z[m] * spreads[k], pick @ mean, atol=1e-8)
            np.testing.assert_allclose(
                variance[m] * spreads[k] ** 2, np.diag(pick @ covariance @ pick.T), atol=1e-8
            )


def test_chunks_are_the_whole(rng: np.random.Generator) -> None:
    """Many spreads at once, and one by one."""
    _, likelihood = machine_likelihoods(fleet(rng, machines=300, parameters=2))
    spreads = rng.uniform(0.1, 0.5, (70, 2))
    together = shared_quantities(likelihood, spreads).log_integral
    single = [
        float(shared_quantities(likelihood, spread[None]).log_integral[0]) for spread in spreads
    ]
    np.testing.assert_allclose(together, single, rtol=1e-12)


# ---- the spreads


@pytest.mark.parametrize("spread", [0.0, 0.2])
@pytest.mark.parametrize("parameters", [1, 2])
def test_draws_are_those_of_a_grid(
    rng: np.random.Generator, parameters: int, spread: float
) -> None:
    """Over s itself with its half-normal prior: neither logarithm nor Jacobian."""
    target = density_of(fleet(rng, machines=5, parameters=parameters, spread=spread))
    axis = (np.arange(240) + 0.5) * 1.5 / 240
    grid = np.stack(np.meshgrid(*[axis] * parameters, indexing="ij"), axis=-1).reshape(
        -1, parameters
    )
    log_weight = shared_quantities(target.likelihood, grid).log_integral + halfnorm(
        scale=SCALE
    ).logpdf(grid).sum(axis=1)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    mean = weight @ grid
    sd = np.sqrt(weight @ (grid - mean) ** 2)
    draws = draw_spreads(target, parameters, seed=1)
    assert draws.trusted
    np.testing.assert_allclose((draws.weight @ draws.spread - mean) / sd, 0.0, atol=0.03)
    np.testing.assert_allclose(
        np.sqrt(draws.weight @ (draws.spread - draws.weight @ draws.spread) ** 2), sd, rtol=0.04
    )


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
    prior = np.diff(halfnorm(scale=SCALE).logpdf(np.exp(both)).sum(axis=1) + both.sum(axis=1))
    apart = np.diff(target.log(both)) - np.diff(
        shared_quantities(target.likelihood, np.exp(both)).log_integral
    )
    assert apart == pytest.approx(prior, rel=1e-9)


@pytest.mark.parametrize("scale", [1e-8, 1e-3, 0.3, 30.0])
def test_any_prior_of_the_spread_will_do(rng: np.random.Generator, scale: float) -> None:
    draws = draw_spreads(density_of(fleet(rng, machines=5), scale), 6, seed=1, size=8192)
    assert draws.trusted
    assert draws.effective > 1000.0
    if scale < 1e-6:
        np.testing.assert_allclose(
            draws.weight @ draws.spread, scale * np.sqrt(2.0 / np.pi), rtol=0.03
        )
    silent = draw_spreads(
        density_of(fleet(rng, machines=3, parameters=2, known=1e6), scale), 2, seed=1
    )
    np.testing.assert_allclose(
        silent.weight @ silent.spread, scale * np.sqrt(2.0 / np.pi), rtol=0.03
    )
    np.testing.assert_allclose(silent.weight @ silent.spread**2, scale**2, rtol=0.05)


# ---- machines against the others


def test_a_machine_against_the_dense_prediction(rng: np.random.Generator) -> None:
    """s known: a given the others is Gaussian, with moments from one dense matrix of everything."""
    made = fleet(rng, machines=6, parameters=2)
    found = judged(density_of(made), fixed(TWO))
    information = made.likelihood.precision
    weighted = made.likelihood.shift
    spreads = np.array([TWO, TWO[::-1], 2.0 * TWO])
    x = shared_quantities(made.likelihood, spreads)
    log_density, _ = outlying_machines._leave_out_each(
        made.likelihood, estimate_separately(made.likelihood, 2), spreads, x
    )
    whole = shared_quantities(made.likelihood, spreads).log_integral
    for m in range(6):
        kept = of_campaigns(made, [k for k in range(6) if k != m])
        left_out = whole - shared_quantities(kept.likelihood, spreads).log_integral
        np.testing.assert_allclose(np.diff(log_density[:, m]), np.diff(left_out), rtol=1e-8)
        _, mean, covariance = dense(kept, TWO)
        mean = mean[10:]
        covariance = covariance[10:, 10:].copy()
        covariance[:2, :2] += np.diag(TWO**2)
        rows = information[m][:2]
        left = weighted[m][:2] - rows @ mean
        spread = rows @ covariance @ rows.T + rows[:, :2]
        single = np.linalg.inv(rows[:, :2] + np.eye(2))
        z = (single @ left) / np.sqrt(np.diag(single @ spread @ single.T))
        np.testing.assert_allclose(found.z[m], z, rtol=1e-6)
        np.testing.assert_allclose(found.parameter_p_value[m], 2.0 * norm.sf(np.abs(z)), rtol=1e-6)
    least = np.sort(np.minimum(1.0, 2.0 * found.parameter_p_value.min(axis=1)))
    assert found.p_value.min() == pytest.approx(min(1.0, 6.0 * least[0]), rel=1e-9)
    assert found.p_value.max() == pytest.approx(
        max(np.minimum(1.0, least * np.arange(6, 0, -1))), rel=1e-9
    )


def test_readings_that_tell_fewer_numbers_than_parameters(rng: np.random.Generator) -> None:
    """A machine of rank one has one z, whatever the parameter; of one that tells nothing there is
    nothing to say."""
    made = fleet(rng, machines=6, parameters=2)
    information = made.likelihood.precision.copy()
    weighted = made.likelihood.shift.copy()
    row = np.array([1.0, 0.5, 0.2, 0.1])
    information[0], weighted[0] = np.outer(row, row) * 100.0, 10.0 * row * 8.0
    information[1], weighted[1] = 0.0, 0.0
    found = judged(density_of(telling(made, information, weighted)), fixed(TWO))
    assert found.p_value[1] == 1.0
    assert found.z[1].tolist() == [0.0, 0.0]
    assert abs(found.z[0, 0]) == pytest.approx(abs(found.z[0, 1]), rel=1e-6)


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
        return real(log_ratio) if next(machines, None) is None else unsmoothed

    monkeypatch.setattr(outlying_machines, "pareto_smooth", first_in_vain)
    anew = judge_machines(
        density, spreads, common, seed=1, progress=lambda done, total: calls.append((done, total))
    )
    assert calls[-1] == (12, 12)
    np.testing.assert_allclose(
        anew.parameter_p_value, weighed.parameter_p_value, rtol=0.1, atol=2e-3
    )
    np.testing.assert_allclose(anew.z, weighed.z, atol=0.1)


def test_p_values_are_uniform_and_z_standard() -> None:
    """Fleets of the model, spreads and all; one machine of each, so that they are independent."""
    rng = np.random.default_rng(11)
    p = []
    z = []
    for _ in range(100):
        spread = np.abs(rng.standard_normal(2)) * 0.3
        mean = rng.standard_normal(2)
        density = density_of(fleet(rng, machines=7, parameters=2, spread=spread, mean=mean))
        found = judged(density, draw_spreads(density, 2, seed=1, size=256))
        p.append(found.parameter_p_value[3])
        z.append(found.z[3])
    assert kstest(np.ravel(p), "uniform").pvalue > 0.01
    assert kstest(np.ravel(z), "norm").pvalue > 0.01


def test_an_outlier_is_flagged() -> None:
    made = fleet(
        np.random.default_rng(5), machines=30, outlier=np.array([0.0, 0.0, 3.0, 0.0, 0.0, 0.0])
    )
    density = density_of(made)
    found = judged(density, draw_spreads(density, 6, seed=1, size=1024))
    assert (found.p_value < 0.05).tolist() == [True] + [False] * 29
    assert np.argmax(np.abs(found.z[0])) == 2
    assert found.z[0, 2] > 5.0
    assert not found.doubtful.any()


# ---- the whole


def test_spreads_follow_their_prior(rng: np.random.Generator) -> None:
    made = fleet(rng, machines=3, parameters=2)
    narrow, wide = (
        pool(made, spread_scale=scale).parameters["C_XXX"].spread.mean for scale in (0.01, 0.3)
    )
    assert narrow < 0.2 * wide


@pytest.fixture(scope="module")
def found() -> Population:
    """Eight machines, the first of another kind."""
    return pool(fleet(np.random.default_rng(3), machines=8, outlier=OUTLIER))


def test_everything_against_a_sum_over_dense_gaussians(rng: np.random.Generator) -> None:
    """One parameter: s on a grid with its half-normal prior, everything else from dense
    matrices."""
    made = fleet(rng, machines=4, parameters=1)
    result = pool(made)
    grid = (np.arange(300) + 0.5) * 1.5 / 300
    parts = [dense(made, np.array([s])) for s in grid]
    log_weight = np.array([own[0] for own in parts]) - 0.5 * (grid / 0.3) ** 2
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    means = np.array([own[1] for own in parts])
    variances = np.array([np.diag(own[2]) for own in parts])
    mean = weight @ means
    sd = np.sqrt(weight @ (variances + (means - mean) ** 2))
    unit = made.prior_sd[0]
    own = result.parameters["C_XXX"]
    assert own.mean.mean / unit == pytest.approx(mean[4], abs=0.01 * sd[4])
    assert own.mean.sd / unit == pytest.approx(sd[4], rel=0.01)
    assert own.spread.mean / unit == pytest.approx(weight @ grid, rel=0.01)
    assert own.next.mean == own.mean.mean
    assert own.next.sd / unit == pytest.approx(np.sqrt(sd[4] ** 2 + weight @ grid**2), rel=0.01)
    for m, machine in enumerate(result.machine.values()):
        assert machine.estimate["C_XXX"].mean / unit == pytest.approx(mean[m], abs=0.02 * sd[m])
        assert machine.estimate["C_XXX"].sd / unit == pytest.approx(sd[m], rel=0.01)
    known = np.array([np.linalg.inv(np.linalg.inv(own[2][4:, 4:])[:1, :1])[0, 0] for own in parts])
    share = 1.0 - (weight @ known + weight @ (means[:, 4] - mean[4]) ** 2) / sd[4] ** 2
    assert own.instrument_sd / unit == pytest.approx(sd[4] * np.sqrt(share), rel=0.02)


def test_alone_is_a_fit_with_the_instrument_known_as_all_know_it(rng: np.random.Generator) -> None:
    """(A + I)⁻¹ (a − B b), b drawn from its posterior, against draws."""
    made = fleet(rng, machines=3, parameters=2)
    result = pool(made)
    density = density_of(made)
    spreads = draw_spreads(density, 2, seed=1)
    common = shared_quantities(density.likelihood, spreads.spread)
    pick = rng.choice(len(spreads.weight), 40_000, p=spreads.weight)
    x = Gaussian(common.precision[pick], common.shift[pick]).draw(rng)
    a = density.likelihood.shift[1, :2]
    rows = density.likelihood.precision[1, :2]
    inverse = np.linalg.inv(rows[:, :2] + np.eye(2))
    noise = rng.standard_normal((len(pick), 2)) @ np.linalg.cholesky(inverse).T
    draws = ((a - x[:, 2:] @ rows[:, 2:].T) @ inverse + noise) * made.prior_sd[:2]
    for j, name in enumerate(made.parameters):
        own = result.machine["M02"].alone[name]
        assert own.mean == pytest.approx(draws[:, j].mean(), abs=0.03 * own.sd)
        assert own.sd == pytest.approx(draws[:, j].std(), rel=0.02)
        assert own.interval == pytest.approx(
            tuple(np.quantile(draws[:, j], [0.025, 0.975])), abs=0.06 * own.sd
        )


def test_a_machine_that_does_not_belong(found: Population) -> None:
    assert found.not_belonging == ("M01",)
    head = "M01 does not belong with the others: p < 0.0001 over all machines, most in C_XXX"
    assert any(sentence.startswith(head) for sentence in population_sentences(found))
    few = pool(fleet(np.random.default_rng(3), machines=5))
    assert few.not_belonging == ()
    assert {own.p_value for own in few.machine.values()} == {None}
    assert "With 5 machines the spread between them rests on its prior" in " ".join(doubts(few))


def test_the_record(found: Population) -> None:
    record = with_words(found)
    following = found.parameters["C_XXX"].next
    again = json.loads(json.dumps(record))
    assert again["sha256"] == digest_of(again)
    assert again["next"]["C_XXX"] == {"unit": "mm/N", "mean": following.mean, "sd": following.sd}
    again["next"]["C_XXX"]["sd"] *= 1.0 + 1e-12
    assert again["sha256"] != digest_of(again)
    made = replace(
        fleet(np.random.default_rng(1), machines=3, parameters=2),
        parameters=("C_XXX", "E_XX1"),
        units=("mm/N", "1"),
    )
    other = pool(made).as_dict()
    assert (list(other["next"]), list(other["parameters"])) == (["C_XXX"], ["C_XXX", "E_XX1"])
    machines = found.machines_table()
    assert machines.loc["M02", "C_YYY.mean"] == found.machine["M02"].estimate["C_YYY"].mean
    assert machines["flag"].sum() == 1
    for shown in (str(found), found._repr_html_()):
        for part in (
            "8 machines, 8 campaigns; compliances at 389 N, tested from 36 to 742 N.",
            "nm/N",
            "M01 does not belong",
        ):
            assert part in shown


def test_what_each_its_own_bar_changes(rng: np.random.Generator) -> None:
    """No error is common to all, and nothing is said of one."""
    made = fleet(rng, machines=3, parameters=2)
    information = made.likelihood.precision[:, :2, :2]
    weighted = made.likelihood.shift[:, :2]
    result = pool(telling(made, information, weighted, instrument=(), prior_sd=made.prior_sd[:2]))
    assert {entry.instrument_sd for entry in result.parameters.values()} == {0.0}
    assert "one bar" not in " ".join(doubts(result))
    assert "mount deflection, force gain" in " ".join(doubts(pool(made)))


def test_doubts(rng: np.random.Generator) -> None:
    """Of one bar's length and balls, of forces that were not tested; readings that tell nothing
    leave the prior."""
    made = fleet(rng, machines=2, parameters=1)
    for other in ({"reference_force_N": 900.0}, {"forces_N": (500.0, 300.0)}):
        assert "was not within the tested forces of every campaign" in " ".join(
            doubts(pool(replace(made, **other)))
        )
    assert (
        "conservative for differences between machines, not for the population's mean"
        in " ".join(doubts(pool(made)))
    )
    nothing = pool(
        telling(made, 0.0 * made.likelihood.precision, 0.0 * made.likelihood.shift)
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
    prior = lb.prior_from(written(tmp_path))
    assert prior == lb.prior_from(tmp_path / "population.json")
    assert (prior.machines, prior.campaigns, prior.sha256) == (24, 60, digest_of(RESULT))
    model = lb.HybridModel.first(1)
    found = prior.model(model).bind(plan())
    usual = model.bind(plan())
    assert found.setting.reference_force_N == 300.0
    own = {p.name: (p.prior_mean, p.prior_sd) for p in found.parameters}
    for name, entry in RESULT["next"].items():
        assert own[name] == (entry["mean"], entry["sd"])
    others = [i for i, name in enumerate(found.names) if name not in RESULT["next"]]
    np.testing.assert_array_equal(found.prior_sd[others], usual.prior_sd[others])
    assert not found.prior_mean[others].any()
    assert prior.model(replace(model, reference_force_N=300.0)) == prior.model(model)
    assert prior.doubts(plan()) == ()
    assert pickle.loads(pickle.dumps(prior)) == prior


def test_doubts_of_a_prior(tmp_path: Path) -> None:
    """Forces elsewhere, the machine itself, what the population says of itself."""
    prior = lb.prior_from(written(tmp_path, doubts=["Its spreads cannot be trusted."]))
    force, own = prior.doubts(plan((40, 40), forces_N=(400.0, 742.0)))
    assert force.startswith(
        "The population's compliances are meant at 300 N, outside this campaign's forces (400 to"
        " 742 N)"
    )
    assert own == "The population says: Its spreads cannot be trusted."
    assert (
        "has campaigns of this machine (M07)" in prior.doubts(replace(plan(), machine_id="M07"))[0]
    )


def test_an_edited_file_is_refused(tmp_path: Path) -> None:
    file = written(tmp_path) / "population.json"
    record = json.loads(file.read_text())
    file.write_text(json.dumps(record, indent=2, sort_keys=True))
    assert lb.prior_from(file).sds["C_XXX"] == 4e-6
    record["next"]["C_XXX"]["sd"] = 4.1e-6
    file.write_text(json.dumps(record))
    refuses(r"its sha256 is not that of its contents: it was edited", lb.prior_from, file)


def test_other_machines_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError,
        match=(
            r"topology must be the population's 'wCAFYXZSt' to use its prior, got 'wXFYZt'\. Use a"
        ),
    ):
        lb.prior_from(written(tmp_path)).doubts(replace(plan(), topology="wXFYZt"))
    other = lb.prior_from(
        written(tmp_path, next={"C_ZZZ": {"unit": "mm/N", "mean": 5e-5, "sd": 1e-6}})
    )
    refuses(
        r"must have the population's compliances, got C_XXX, .* without C_ZZZ\.",
        other.doubts,
        plan(),
    )


def test_compliances_of_another_place_are_refused(tmp_path: Path) -> None:
    told = stands_for(plan())
    prior = lb.prior_from(written(tmp_path, compliances=told))
    assert prior.compliances == told
    assert prior.doubts(plan()) == ()
    higher = replace(plan(), tests=tuple(replace(test, centre_z_mm=100.0) for test in plan().tests))
    refuses(
        r"must mean by C_XXX what the population does, got circles or joints' frames",
        prior.doubts,
        higher,
    )


def test_models_it_does_not_go_with(tmp_path: Path) -> None:
    prior = lb.prior_from(written(tmp_path))
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
    for own in ({"overrides": {"C_XXX": 1e-5}}, {"means": {"C_XXX": 1e-5}}):
        with pytest.raises(
            InputError, match="C_XXX must have one prior, got the population's and the model's own"
        ):
            prior.model(replace(model, prior=replace(model.prior, **own)))
    with pytest.raises(
        InputError, match=r"reference_force_N must be the population's 300 N, .* got 389 N\. Leave"
    ):
        prior.model(replace(model, reference_force_N=389.0))


def test_what_is_no_population(tmp_path: Path) -> None:
    for changes in ({"schema": 2}, {"kind": "fit"}):
        refuses(
            r"must be a population written by .*, got a damaged one",
            lb.prior_from,
            written(tmp_path, **changes),
        )
    for content in (b"{", b"\xff\xfe\x00", b"[" * 100_000, b"[]"):
        (tmp_path / "population.json").write_bytes(content)
        refuses(
            r"must be a population written by|must be a population, got", lb.prior_from, tmp_path
        )


# ---- what a compliance stands for

FRAMES = {"X": (10.0, 300.0, -200.0), "Y": (-50.0, 20.0, 400.0)}


def placed(
    centre_mm: tuple[float, float, float] = (0.0, 0.0, 0.0), radius_mm: float = 150.0, **fields: Any
) -> Campaign:
    """A plan whose circles lie there."""
    x, y, z = centre_mm
    own = {"centre_x_mm": x, "centre_y_mm": y, "centre_z_mm": z, "radius_mm": radius_mm}
    made = plan()
    return replace(made, tests=tuple(replace(test, **own) for test in made.tests), **fields)


def test_the_sum_is_what_readings_see(rng: np.random.Generator) -> None:
    """Joints' compliances drawn, the kept ones made of them: the same readings of a circle off the
    centre."""
    made = placed((120.0, -40.0, 90.0), frames_mm=FRAMES)
    meant = stands_for(made)
    members = sorted({label for parts in meant.values() for label in parts})
    truth = dict(zip(members, rng.standard_normal(len(members)), strict=True))
    names = [ComplianceName(*label[2:]) for label in (*members, *meant)]
    circle = next(iter(made.tests)).circle
    jacobian = compliance_jacobian(made.machine(), circle, np.linspace(0.0, 6.0, 40), names)
    kept = [
        sum(weight * truth[label] for label, weight in parts.items()) for parts in meant.values()
    ]
    every = jacobian[:, : len(members)] @ list(truth.values())
    assert np.linalg.norm(jacobian[:, len(members) :] @ kept - every) < 1e-6 * np.linalg.norm(every)


@pytest.mark.parametrize("frames", [{}, FRAMES])
def test_a_radius_does_not_matter(frames: dict[str, Any]) -> None:
    meant = stands_for(placed((0.0, 0.0, 80.0), frames_mm=frames))
    assert meant == stands_for(placed((0.0, 0.0, 80.0), radius_mm=50.0, frames_mm=frames))
    assert meant["C_XXX"]["C_BXX"] == (280.0 if frames else 80.0)


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
