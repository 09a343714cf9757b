"""`pool`: shrinkage, the next machine, coverage in fleets that are made up, and what is said."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from fleets import dense, fleet
from trends import doubts, drawn_rows, with_prior

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet import membership as module
from ldbb_bayes.fleet.pooling import SpreadDensity, draw_spreads, pooling
from ldbb_bayes.fleet.population import _NEEDED, Population, pool
from ldbb_bayes.fleet.population_prior import digest_of
from ldbb_bayes.fleet.statistics import FleetStatistics
from ldbb_bayes.model.gaussian import mixture_quantiles, weighted_quantiles
from ldbb_bayes.report.wording import population_sentences, with_words


def statistics() -> FleetStatistics:
    """Eight machines, the first of another kind."""
    return fleet(np.random.default_rng(3), machines=8, outlier=np.array([3.0, 0, 0, 0, 0, 0]))


@pytest.fixture(scope="module")
def found() -> Population:
    return pool(statistics())


def test_everything_against_a_sum_over_dense_gaussians(rng: np.random.Generator) -> None:
    """One parameter: s on a grid with its half-normal prior, everything else from dense matrices."""
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
    unit, own = made.prior_sd[0], result.parameters["C_XXX"]
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
    assert own.instrument_share == pytest.approx(share, abs=0.01)
    assert own.instrument_sd / unit == pytest.approx(sd[4] * np.sqrt(share), rel=0.02)


def test_alone_is_a_fit_with_the_instrument_known_as_all_know_it(rng: np.random.Generator) -> None:
    """(A + I)⁻¹ (a − B b), b drawn from its posterior, against draws."""
    made = fleet(rng, machines=3, parameters=2)
    result, pooled = pool(made), pooling(made)
    spreads = draw_spreads(SpreadDensity(pooled, 0.3), seed=1)
    common = pooled.common(spreads.spread)
    pick = rng.choice(len(spreads.weight), 40_000, p=spreads.weight)
    x = common.mean[pick] + np.einsum("kij,kj->ki", common.root[pick], rng.standard_normal((len(pick), 4)))
    a, rows = pooled.weighted[:2, 1], pooled.information[:2, :, 1]
    inverse = np.linalg.inv(rows[:, :2] + np.eye(2))
    noise = rng.standard_normal((len(pick), 2)) @ np.linalg.cholesky(inverse).T
    draws = ((a - x[:, 2:] @ rows[:, 2:].T) @ inverse + noise) * made.prior_sd
    for j, name in enumerate(made.parameters):
        own = result.machine["M02"].alone[name]
        assert own.mean == pytest.approx(draws[:, j].mean(), abs=0.03 * own.sd)
        assert own.sd == pytest.approx(draws[:, j].std(), rel=0.02)
        assert own.interval == pytest.approx(tuple(np.quantile(draws[:, j], [0.025, 0.975])), abs=0.06 * own.sd)


@pytest.mark.slow
def test_intervals_cover() -> None:
    """Fleets of the model: 95 % intervals of means and spreads hold the truth in 95 ± 3 %."""
    rng = np.random.default_rng(2)
    inside = []
    for _ in range(200):
        spread, mean = np.abs(rng.standard_normal(2)) * 0.3, rng.standard_normal(2)
        pooled = pooling(fleet(rng, machines=6, parameters=2, spread=spread, mean=mean))
        draws = draw_spreads(SpreadDensity(pooled, 0.3), seed=1, size=512)
        common = pooled.common(draws.spread)
        sd = np.sqrt((common.root[:, :2] ** 2).sum(axis=-1))
        low, high = mixture_quantiles(draws.weight, common.mean[:, :2], sd, (0.025, 0.975))
        least, most = weighted_quantiles(draws.weight, draws.spread, (0.025, 0.975))
        inside.append([(low < mean) & (mean < high), (least < spread) & (spread < most)])
    coverage = np.mean(inside, axis=(0, 2))
    np.testing.assert_allclose(coverage, 0.95, atol=0.03)


def test_shrunken_lies_between_alone_and_the_mean() -> None:
    """For a parameter by itself; and on the whole less is known alone."""
    result = pool(fleet(np.random.default_rng(4), machines=6, parameters=1, known=0.3))
    middle = result.parameters["C_XXX"].mean.mean
    for own in result.machine.values():
        alone, shrunken = own.alone["C_XXX"], own.estimate["C_XXX"]
        assert min(alone.mean, middle) - 0.1 * alone.sd < shrunken.mean < max(alone.mean, middle) + 0.1 * alone.sd
        assert 0.0 < own.shrinkage["C_XXX"] < 1.0
    widths = [(own.estimate["C_XXX"].sd, own.alone["C_XXX"].sd) for own in result.machine.values()]
    assert np.prod([shrunken / alone for shrunken, alone in widths]) < 0.8


def test_the_order_of_campaigns_does_not_matter(rng: np.random.Generator) -> None:
    made = fleet(rng, machines=4, parameters=2, campaigns=2)
    order = rng.permutation(len(made))
    turned = replace(
        made,
        campaigns=tuple(made.campaigns[k] for k in order),
        machines=tuple(made.machines[k] for k in order),
        information=made.information[order],
        weighted=made.weighted[order],
    )
    one, other = pool(made), pool(turned)
    for name, own in one.parameters.items():
        assert own.mean.mean == pytest.approx(other.parameters[name].mean.mean, rel=1e-8)
        assert own.spread.sd == pytest.approx(other.parameters[name].spread.sd, rel=1e-8)
    for name, machine in one.machine.items():
        assert machine.campaigns == other.machine[name].campaigns == 2
        assert machine.estimate["C_XXX"].sd == pytest.approx(other.machine[name].estimate["C_XXX"].sd, rel=1e-8)


def test_a_machine_that_does_not_belong(found: Population) -> None:
    assert found.not_belonging == ("M01",)
    head = "M01 does not belong with the others: p < 0.0001 over all machines"
    assert any(sentence.startswith(head) for sentence in population_sentences(found))
    assert "The population includes the machines that do not belong." in " ".join(doubts(found))
    few = pool(fleet(np.random.default_rng(3), machines=5))
    assert few.not_belonging == ()
    assert {own.p_value for own in few.machine.values()} == {None}
    assert "not judged with 5 machines: at least 6 are needed" in " ".join(doubts(few))


def test_that_none_stands_out_is_said_only_where_all_were_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    said = "No machine stands out from the others (Holm, 5 %)."
    made = fleet(np.random.default_rng(4), machines=6, parameters=2)
    quiet = pool(made)
    assert said in population_sentences(quiet)
    least = min(quiet.machine.values(), key=lambda own: own.p_value or 0.0)
    farthest = [sentence for sentence in population_sentences(quiet) if sentence.startswith("The farthest out: ")]
    assert len(farthest) == (least.family_wise_p_value <= 0.5)
    assert all(sentence.startswith(f"The farthest out: {least.name}, p = ") for sentence in farthest)
    near = fleet(np.random.default_rng(4), machines=6, parameters=2, outlier=np.array([0.3, 0.0]))
    assert any(sentence.startswith("The farthest out: M01, p = ") for sentence in population_sentences(pool(near)))
    information, weighted = made.information.copy(), made.weighted.copy()
    information[2], weighted[2] = 0.0, 0.0
    silent = pool(replace(made, information=information, weighted=weighted))
    assert said not in population_sentences(silent)
    assert "The readings tell nothing of M03: whether they belong is not known." in doubts(silent)
    monkeypatch.setattr(module, "pareto_smooth", lambda log_ratio: (np.full(len(log_ratio), 1.0 / len(log_ratio)), 9.0, 0.5))
    monkeypatch.setattr(module, "_MOST_ANEW", 0)
    doubtful = pool(made)
    assert said not in population_sentences(doubtful)
    assert "p-values that cannot be trusted" in " ".join(doubts(doubtful))
    assert said not in population_sentences(pool(fleet(np.random.default_rng(4), machines=5)))


def test_the_record(found: Population) -> None:
    record, following = with_words(found), found.parameters["C_XXX"].next
    again = json.loads(json.dumps(record))
    assert (again["schema"], again["kind"], again["machines"], again["campaigns"]) == (1, "population", 8, 8)
    assert again["sha256"] == digest_of(again) == with_words(pool(statistics()))["sha256"]
    assert set(again["next"]) == set(found.parameters)
    assert again["next"]["C_XXX"] == {"unit": "mm/N", "mean": following.mean, "sd": following.sd}
    again["next"]["C_XXX"]["sd"] *= 1.0 + 1e-12
    assert again["sha256"] != digest_of(again)
    assert again["not_belonging"] == ["M01"]
    assert set(again["machine"]["M02"]["estimate"]["C_XXX"]) == {"mean", "sd", "ci95"}
    machines = found.machines_table()
    assert machines.loc["M02", "C_YYY.mean"] == found.machine["M02"].estimate["C_YYY"].mean
    assert machines["flag"].sum() == 1
    for shown in (str(found), found._repr_html_()):
        for part in ("8 machines, 8 campaigns; compliances at 389 N, tested from 36 to 742 N.", "nm/N", "M01 does not belong"):
            assert part in shown


def test_only_constant_compliances_have_a_next(rng: np.random.Generator) -> None:
    made = replace(fleet(rng, machines=3, parameters=2), parameters=("C_XXX", "E_XX1"), units=("mm/N", "1"))
    record = pool(made).as_dict()
    assert list(record["next"]) == ["C_XXX"]
    assert list(record["parameters"]) == ["C_XXX", "E_XX1"]


def test_what_each_its_own_bar_changes(rng: np.random.Generator) -> None:
    """No error is common to all, and nothing is said of one."""
    made = fleet(rng, machines=3, parameters=2)
    own = replace(
        made,
        instrument=(),
        instrument_sd=np.zeros(0),
        information=made.information[:, :2, :2],
        weighted=made.weighted[:, :2],
    )
    result = pool(own)
    assert {entry.instrument_sd for entry in result.parameters.values()} == {0.0}
    assert "one bar" not in " ".join(doubts(result))
    assert "mount, gain of the force" in " ".join(doubts(pool(made)))


def test_the_prior_of_the_fits_does_not_matter(rng: np.random.Generator) -> None:
    """The same likelihoods from fits that were told of a population: the same population."""
    rows = six_machines(rng)
    told = {"C_XXX": (5e-5, 4e-6), "C_CCY": (4e-10, 2e-10)}
    one, other = (lb.population(own) for own in (rows, with_prior(rows, told)))
    for name, own in one.parameters.items():
        assert other.parameters[name].prior_sd == own.prior_sd
        for kind in ("mean", "spread", "next"):
            assert getattr(other.parameters[name], kind).mean == pytest.approx(getattr(own, kind).mean, rel=1e-4)
            assert getattr(other.parameters[name], kind).sd == pytest.approx(getattr(own, kind).sd, rel=1e-4)


def six_machines(rng: np.random.Generator) -> pd.DataFrame:
    """Rows of a batch."""
    return drawn_rows(6, rng, scatter=0.1).assign(machine_id=[f"M{m}" for m in range(6)])


def test_one_bar_is_in_the_mean(rng: np.random.Generator) -> None:
    """Its length and its balls; most where forces span little."""
    rows = six_machines(rng).assign(force_min_N=[300.0, 300.0, 36.0, 36.0, 36.0, 36.0])
    said = " ".join(doubts(lb.population(rows)))
    assert "Forces that span little (the greatest below 3 times the least)" in said
    assert "do not average out: c01, c02." in said
    assert "conservative for differences between machines, not for the population's mean" in said
    assert "span little" not in " ".join(doubts(lb.population(rows, one_instrument=False)))


def test_forces_that_were_not_tested(rng: np.random.Generator) -> None:
    made = fleet(rng, machines=2, parameters=1)
    other = {"reference_force_N": 900.0}, {"forces_N": (500.0, 300.0)}
    far, apart = (" ".join(doubts(pool(replace(made, **own)))) for own in other)
    assert "The reference force, 900 N, was not within the tested forces of every campaign" in far
    assert "No force was tested in all campaigns" in apart


def test_little_more_than_the_prior(rng: np.random.Generator) -> None:
    vague = pool(fleet(rng, machines=2, parameters=1, known=50.0))
    assert "spread of C_XXX is little more than its prior, HalfNormal(0.3 prior sd)" in " ".join(doubts(vague))
    few = fleet(rng, machines=3, parameters=1)
    far = replace(few, weighted=few.weighted * np.array([1.0, 1.0, 50.0])[:, None])
    assert "little more than its prior" not in " ".join(doubts(pool(far, spread_scale=0.01)))


def test_what_is_refused(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="at least two machines, got only M01"):
        pool(fleet(rng, machines=1, campaigns=3))
    with pytest.raises(InputError, match="rows must be the table of a batch, got str"):
        lb.population("batch")  # type: ignore[arg-type]
    rows = pd.DataFrame({"campaign": ["a"], "status": ["done"]})
    with pytest.raises(InputError, match="one without machine_id"):
        lb.population(rows)
    whole = rows.assign(**dict.fromkeys(_NEEDED))
    with pytest.raises(InputError, match="spread_scale must be a finite number above zero, got 0"):
        lb.population(whole, spread_scale=0.0)
    with pytest.raises(InputError, match="ci_prob must lie between 0 and 1, got 95"):
        lb.population(whole, ci_prob=95)
    with pytest.raises(InputError, match="reference_force_N must be a finite number, got nan"):
        lb.population(whole, reference_force_N=float("nan"))
