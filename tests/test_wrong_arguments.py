"""What Python is given in the wrong place is refused by name, with what belongs there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import xarray as xr
from campaigns import refuses

import ldbb_bayes as lb

MODEL = lb.HybridModel.first(0)


@pytest.fixture(scope="module")
def posterior(recovered: lb.Campaign) -> xr.DataTree:
    return lb.sample(MODEL, recovered, sampler="independent", seed=1)


@pytest.mark.parametrize(
    "function",
    [
        lb.summarize,
        lb.to_units,
        lb.assess_conformity,
        lb.analysis.budget_uncertainty,
        lb.analysis.judge_posterior,
        lb.figures.traces,
        lambda posterior: lb.write_report(posterior, "report"),
    ],
)
def test_a_campaign_is_no_posterior(function: Callable[[Any], Any], recovered: lb.Campaign) -> None:
    refuses("posterior must be a DataTree, got Campaign. Pass what lb.sample", function, recovered)


@pytest.mark.parametrize("function", [lb.compare, lb.average, lb.find_outlying_tests])
def test_models_have_names(function: Callable[..., Any], recovered: lb.Campaign) -> None:
    refuses("models must be HybridModels by name, .*got list", function, [MODEL], recovered)
    refuses("models must be given, got none", function, {}, recovered)


def test_a_bar_does_not_push(posterior: xr.DataTree) -> None:
    refuses("must not be negative, got -5", lb.analysis.predict_circularity, posterior, [-5.0])
    refuses("must not be negative, got -3", lb.analysis.decompose_deviation, posterior, -3.0)


def test_forces_are_no_text(posterior: xr.DataTree) -> None:
    """The text 300 would be read as 3, 0 and 0 N."""
    refuses("must be a list of numbers", lb.analysis.predict_circularity, posterior, "300")


def test_a_plan_has_no_circularity(recovered: lb.Campaign) -> None:
    refuses("must have readings", lb.analysis.measure_circularity, recovered.plan())
