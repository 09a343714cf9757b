"""Which parameters the readings hardly determine."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from ldbb_bayes.analysis.usability import undetermined_parameters
from ldbb_bayes.analysis.verdicts import Verdict


def judged(*ratios: float, verdict: Verdict = Verdict.CONFOUNDED) -> dict[str, Any]:
    """Verdicts on parameters P0, P1, … with these ratios of posterior and prior sd."""
    return {
        f"P{k}": SimpleNamespace(verdict=verdict, contraction=1.0 - ratio**2)
        for k, ratio in enumerate(ratios)
    }


@pytest.mark.parametrize("ratios", [(0.305, 0.335), (0.335, 0.345), (0.29, 0.3), (0.39, 0.399)])
def test_two_parameters_known_equally_well_are_judged_alike(ratios: tuple[float, ...]) -> None:
    assert len(undetermined_parameters(judged(*ratios, 0.1, 0.9))) in (1, 3)


def test_a_parameter_that_is_hardly_narrowed_is_not_determined() -> None:
    assert undetermined_parameters(judged(0.1, 0.45)) == {"P1"}


def test_an_identified_parameter_is_determined() -> None:
    assert not undetermined_parameters(judged(0.45, verdict=Verdict.IDENTIFIED))


def test_a_parameter_with_a_flat_prior_is_determined() -> None:
    entry = SimpleNamespace(verdict=Verdict.CONFOUNDED, contraction=float("nan"))
    assert not undetermined_parameters({"P0": entry})
