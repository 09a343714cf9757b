"""Standard uncertainties that further certificates would leave."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import oracle_of, plan, simulated
from oracle import Stated

import ldbb_bayes as lb
from ldbb_bayes.analysis.value_of_certificates import uncertainty_with
from ldbb_bayes.analysis.verdicts import hyper_parameter_nodes
from ldbb_bayes.inference.nodes import HyperPosterior

MODEL = lb.HybridModel.first(1).without("truncation")
CAMPAIGN = simulated(plan())
CERTIFIED_BAR = lb.Instrument(bar_U_um=1.0)


def test_variances_are_averaged_over_phi() -> None:
    """With a bar certified to 1 µm, by the oracle."""
    weight = np.array([0.5, 0.3, 0.2])
    bound = MODEL.bind(CAMPAIGN)
    phi = hyper_parameter_nodes(bound)[1][[0, 7, -1]]
    oracle = oracle_of(CAMPAIGN, 1, stated=Stated(length_U_um=1.0))
    variances = [np.diag(oracle.given(node)[2]) for node in phi]
    np.testing.assert_allclose(
        uncertainty_with(bound, CERTIFIED_BAR, weight, phi), np.sqrt(weight @ variances), rtol=1e-6
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("certificate", "campaign"),
    [
        ("none of these", CAMPAIGN),
        ("bar ± 1 µm", replace(CAMPAIGN, instrument=CERTIFIED_BAR)),
    ],
)
def test_uncertainties_are_those_of_a_certified_campaign(
    certificate: str, campaign: lb.Campaign
) -> None:
    expected = lb.identify(MODEL, CAMPAIGN).certificates[certificate]
    sd = HyperPosterior(MODEL.bind(campaign), truncated=False).nodes(0.1).moments()[1]
    np.testing.assert_allclose(list(expected.values()), sd, rtol=0.02)
