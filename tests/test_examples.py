"""Docstrings of public names: complete, and with examples that run."""

from __future__ import annotations

import doctest
import inspect
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpydoc.validate import validate
from public_names import public_names

import ldbb_bayes as lb

# What numpydoc must not find in a docstring, by the beginnings of its codes: SS is the summary,
# PR parameters, RT returns, EX examples. Fields of classes are documented by ``#:`` beside them.
FAULTS = {
    "function": ("SS", "PR", "RT", "EX"),
    "class": ("SS", "EX"),
}
# Examples that take about a second or more; they run with the slow tests.
LONG_EXAMPLES = {
    "analysis.Comparison",
    "analysis.Design",
    "analysis.Identifiability",
    "analysis.ParameterIdentifiability",
    "analysis.Validation",
    "analysis.Workflow",
    "analysis.calibrate_posterior",
    "analysis.check_workflow",
    "analysis.compare_posteriors",
    "average",
    "calibrate",
    "compare",
    "figures.compliance_atlas",
    "figures.compliance_with_local_fits",
    "figures.evidence",
    "figures.expected_widths",
    "figures.forest",
    "figures.geometry_with_local_fits",
    "figures.parameter_contributions",
    "figures.prior_and_posterior",
    "figures.rank_ecdf",
    "figures.workflow_checks",
    "figures.save_figure",
    "find_outlying_tests",
    "fleet.Batch",
    "fleet.draw_control_chart",
    "fleet.read_batch",
    "fleet.run_batch",
    "inference.StoppingRule",
    "inference.marginalize",
    "inference.with_predictive",
    "local_fits",
    "save",
}
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def examples() -> list[Any]:
    """Return the public names; those with a long example are marked as slow."""
    return [
        pytest.param(name, marks=pytest.mark.slow if name in LONG_EXAMPLES else ())
        for name in public_names()
    ]


@pytest.fixture(scope="session")
def names_of_examples(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Return what every example may use, as the reference of Python says."""
    campaign = lb.read_campaign(lb.embedded_campaign())
    model = lb.HybridModel.default(degree=1)
    posterior = lb.sample(model, campaign, sampler="independent", seed=1)
    return {
        "lb": lb,
        "np": np,
        "campaign": campaign,
        "model": model,
        "posterior": posterior,
        "rows": rows_of_two_campaigns(campaign, tmp_path_factory.mktemp("batch")),
    }


def rows_of_two_campaigns(campaign: lb.Campaign, folder: Path) -> pd.DataFrame:
    """Return the table of a batch: two campaigns, C_XXX = 50 nm/N in one and 70 in the other."""
    model = lb.HybridModel.first(0)
    for number, compliance in ((1, 50e-6), (2, 70e-6)):
        truth = {"C_XXX": compliance, "C_YYY": 50e-6}
        simulated = model.simulate(campaign, seed=number, parameters=truth).campaign
        lb.write_campaign(simulated, folder / "campaigns" / str(number))
    batch = lb.fleet.run_batch(
        [folder / "campaigns"], folder / "fitted", model=model, compare=False
    )
    return batch.rows()


def faults(name: str) -> list[str]:
    """Return what numpydoc finds missing in the docstring of a public name."""
    documented = resolve_name(f"ldbb_bayes.{name}")
    kind = "class" if inspect.isclass(documented) else "function"
    found = validate(f"{documented.__module__}.{documented.__qualname__}")["errors"]
    return [f"{code}: {text}" for code, text in found if code.startswith(FAULTS[kind])]


@pytest.mark.parametrize("name", public_names())
def test_a_docstring_is_complete(name: str) -> None:
    assert faults(name) == []


@pytest.mark.parametrize("name", examples())
def test_an_example_runs(
    name: str,
    names_of_examples: dict[str, Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    documented = resolve_name(f"ldbb_bayes.{name}")
    text = inspect.getdoc(documented) or ""
    example = doctest.DocTestParser().get_doctest(text, dict(names_of_examples), name, None, 0)
    assert example.examples, f"{name} has no example"
    outcome = doctest.DocTestRunner(optionflags=OPTIONS).run(example)
    assert outcome.failed == 0


def test_a_wrong_example_would_be_seen(names_of_examples: dict[str, Any]) -> None:
    example = doctest.DocTestParser().get_doctest(
        ">>> campaign.readings\n-1", dict(names_of_examples), "wrong", None, 0
    )
    assert doctest.DocTestRunner(verbose=False).run(example, out=lambda _: None).failed == 1
