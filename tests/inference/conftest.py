"""Models that several tests of the inference use."""

from __future__ import annotations

import pytest
from campaigns import TRUTH, plan

import ldbb_bayes as lb
from ldbb_bayes.model.hybrid import BoundModel


@pytest.fixture(scope="module")
def usually_negative() -> BoundModel:
    """Four of five draws would have a negative compliance, because C_CCY is zero."""
    model = lb.HybridModel.first(1)
    return model.bind(model.simulate(plan(), parameters={**TRUTH, "C_CCY": 0.0}, seed=2).campaign)
