"""Priors that the campaigns of a fleet have in common: quantiles of another library."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from ldbb_bayes.fleet.common_priors import NormalPriors, contradictory_statements, usual_priors
from ldbb_bayes.fleet.machine_effects import VARIANCE_OF_CAMPAIGN


@pytest.mark.parametrize("number", [2, 20])
@pytest.mark.parametrize(("excess", "is_named"), [(0.99, False), (1.01, True)])
def test_statements_contradict_beyond_one_percent_of_all_comparisons(
    number: int, excess: float, is_named: bool
) -> None:
    """The 1 % are shared among the campaigns; a difference has the variance of two statements."""
    distance = excess * norm.isf(0.5 * 0.01 / number)
    mean = np.zeros((number, 1))
    mean[-1] = distance * np.hypot(3.0, 4.0)
    sd = np.full((number, 1), 4.0)
    best = NormalPriors(np.zeros(1), np.array([3.0]))
    campaigns = [f"campaign {k}" for k in range(number)]
    caveats = contradictory_statements(("mount",), NormalPriors(mean, sd), best, campaigns)
    assert [caveat.names for caveat in caveats] == ([(campaigns[-1],)] if is_named else [])


def test_parts_of_machine_and_campaign_make_up_what_a_campaign_states() -> None:
    """The part of a campaign has ``VARIANCE_OF_CAMPAIGN`` times the variance of the machine's."""
    stated = NormalPriors(np.zeros((3, 1)), np.array([[5.0], [6.0], [7.0]]))
    of_machine = usual_priors(stated).sd[0]
    of_campaign = of_machine * np.sqrt(VARIANCE_OF_CAMPAIGN)
    assert np.hypot(of_machine, of_campaign) == pytest.approx(6.0)
