"""Tables of a fit: what their captions say of the numbers."""

from __future__ import annotations

from dataclasses import replace

import pytest
from campaigns import plan, simulated
from reports import fitted
from scipy.stats import norm

import ldbb_bayes as lb
from ldbb_bayes.report.fit_record import full_result
from ldbb_bayes.report.fit_tables import explanation_of_U, results_table
from ldbb_bayes.results import Table


@pytest.mark.parametrize(
    ("model", "caption"),
    [
        (
            replace(lb.HybridModel.first(1), reference_force_N=300.0),
            "Compliances at 300 N, their change with force, geometric errors",
        ),
        (lb.HybridModel.first(0), "Compliances, geometric errors"),
    ],
)
def test_results_state_the_force_where_compliances_change(
    model: lb.HybridModel, caption: str
) -> None:
    posterior = fitted(model, simulated(plan()))
    verdicts = lb.analysis.judge_posterior(posterior)
    assert results_table(full_result(posterior, 0.95), verdicts).caption == caption


@pytest.mark.parametrize("prob", [0.68, 0.9])
def test_u_does_not_change_with_the_probability_of_intervals(prob: float) -> None:
    posterior = fitted(lb.HybridModel.first(1), simulated(plan()))
    verdicts = lb.analysis.judge_posterior(posterior)
    of_95 = full_result(posterior, 0.95)
    table = results_table(full_result(posterior, prob), verdicts, result_of_U=of_95)
    expected = results_table(of_95, verdicts)
    column = table.heads.index("U (k = 2)")
    assert [row[column] for row in table.rows] == [row[column] for row in expected.rows]
    draws = posterior["posterior"]["E_XX1"].to_numpy() * 1e6
    row = next(row for row in table.rows if row[0] == "E_XX1")
    assert float(row[column]) == pytest.approx(2.0 * draws.std(), rel=0.05)
    ends = row[column + 1].strip("[]").replace("−", "-").split(", ")
    width = float(ends[1]) - float(ends[0])
    assert width == pytest.approx(2.0 * norm.ppf(0.5 + 0.5 * prob) * draws.std(), rel=0.1)


@pytest.mark.parametrize(("expanded", "sentences"), [("6.5", 0), ("+7.9 / −0.7", 1)])
def test_unequal_distances_in_place_of_u_are_explained_where_they_occur(
    expanded: str, sentences: int
) -> None:
    table = Table.of("", ("parameter", "U (k = 2)", "unit"), [("C_XXX", expanded, "nm/N")])
    explained = explanation_of_U(table)
    assert len(explained) == sentences
    assert all("+a / −b" in sentence for sentence in explained)
