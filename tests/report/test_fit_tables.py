"""Tables of a fit: what their captions say of the numbers."""

from __future__ import annotations

from dataclasses import replace

import pytest
from campaigns import plan, simulated
from reports import fitted

import ldbb_bayes as lb
from ldbb_bayes.report.fit_tables import full_result, results_table


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
