"""Results of a posterior are worked out once, and belong to the posterior that is asked about."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr
from campaigns import plan, refuses, simulated
from reports import fitted

import ldbb_bayes as lb
from ldbb_bayes.analysis import posterior_verdicts
from ldbb_bayes.inference import elastic_deflections, posterior_cache
from ldbb_bayes.inference.posterior import curves_of, elastic_draws_of
from ldbb_bayes.inference.posterior_cache import cached_by_posterior
from ldbb_bayes.report.fit_record import full_result


@pytest.fixture
def posterior() -> xr.DataTree:
    return fitted(lb.HybridModel.first(0), simulated(plan()))


@pytest.fixture(autouse=True)
def nothing_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(posterior_cache, "_RESULTS", {})


class Counted:
    """A mean that counts how often it is worked out."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, posterior: xr.DataTree, factor: float = 1.0) -> dict[str, float]:
        self.calls += 1
        return {"mean": factor * float(posterior["posterior"]["C_XXX"].mean())}


def kept_mean(work: Counted) -> object:
    def mean(posterior: xr.DataTree, factor: float = 1.0) -> dict[str, float]:
        return work(posterior, factor)

    return cached_by_posterior(mean)


def test_a_result_is_worked_out_once(posterior: xr.DataTree) -> None:
    work = Counted()
    mean = kept_mean(work)
    assert mean(posterior) == mean(posterior.copy(deep=True))
    assert work.calls == 1


def test_changed_draws_are_another_posterior(posterior: xr.DataTree) -> None:
    mean = kept_mean(Counted())
    before = mean(posterior)["mean"]
    posterior["posterior"]["C_XXX"].values[:] *= 2.0
    assert mean(posterior)["mean"] == pytest.approx(2.0 * before)


def test_other_arguments_are_another_result(posterior: xr.DataTree) -> None:
    mean = kept_mean(Counted())
    assert mean(posterior, factor=2.0)["mean"] == 2.0 * mean(posterior)["mean"]


def test_callers_may_add_to_what_they_get(posterior: xr.DataTree) -> None:
    mean = kept_mean(Counted())
    mean(posterior)["added"] = 1.0
    assert list(mean(posterior)) == ["mean"]


def test_only_the_last_results_are_kept(posterior: xr.DataTree) -> None:
    mean = kept_mean(Counted())
    for factor in range(40):
        mean(posterior, float(factor))
    assert len(posterior_cache._RESULTS) == 32


def test_two_functions_do_not_mix(posterior: xr.DataTree) -> None:
    first = kept_mean(Counted())
    second = cached_by_posterior(lambda _: {"mean": 0.0})
    assert first(posterior) != second(posterior)


def test_what_is_no_posterior_is_refused_by_the_function_itself(posterior: xr.DataTree) -> None:
    refuses("got one in units for reading", lb.analysis.judge_posterior, lb.to_units(posterior))
    refuses("must be a DataTree, got dict", lb.analysis.judge_posterior, {})


def counted_calls(monkeypatch: pytest.MonkeyPatch, module: Any, name: str) -> list[str]:
    """Return a list that grows by one name at every call of a function of a module."""
    calls: list[str] = []
    work = getattr(module, name)

    def counted(*args: Any, **kwargs: Any) -> Any:
        calls.append(name)
        return work(*args, **kwargs)

    monkeypatch.setattr(module, name, counted)
    return calls


def test_coefficients_of_joint_loads_are_drawn_once_for_all_forces_and_circles(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    posterior = fitted(lb.HybridModel.default(1), simulated(plan()))
    drawn = counted_calls(monkeypatch, elastic_deflections, "draw_shared")
    curves = curves_of(posterior, np.array([100.0]))
    draws = elastic_draws_of(posterior, [0], np.array([100.0, 300.0]))
    assert len(drawn) == 1
    np.testing.assert_allclose(draws.compliances[:, :1], curves, rtol=1e-12)


def test_the_record_of_a_fit_judges_its_changes_with_force_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    posterior = fitted(lb.HybridModel.default(1), simulated(plan()))
    drawn = counted_calls(monkeypatch, posterior_verdicts, "_drawn_changes")
    full_result(posterior, 0.95)
    posterior_verdicts.judge_quantities(posterior)
    assert len(drawn) == 1
