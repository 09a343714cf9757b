"""Bayes factor of linear over constant compliance: that of the two evidences, each by itself."""

from __future__ import annotations

import numpy as np
import pytest
from batches import FORCES_N, LINEAR
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.fleet.linear_or_constant import linear_over_constant
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.nodes import compute_nodes

TOLERANCE = 0.05


def campaign_of_three() -> lb.Campaign:
    return simulated(plan((60,) * 3, forces_N=FORCES_N), seed=2)


@pytest.mark.parametrize(
    "model",
    [
        LINEAR,
        LINEAR.without("truncation"),
        LINEAR.with_degree(2),
        LINEAR.fixing("C_XYX_1"),
    ],
    ids=["truncated", "not truncated", "quadratic", "one slope fixed"],
)
def test_it_is_that_of_two_evidences(model: lb.HybridModel) -> None:
    campaign = campaign_of_three()
    ratio = linear_over_constant(
        HyperPosterior(model.bind(campaign), truncated=True), tolerance=TOLERANCE
    )
    linear = lb.log_evidence(model.with_degree(1), campaign)
    constant = lb.log_evidence(model.with_degree(0), campaign)
    difference = ratio.value - (linear.log_value - constant.log_value)
    assert abs(difference) < ratio.error + linear.error + constant.error


def test_its_error_is_at_most_two_tolerances_and_those_of_the_truncation() -> None:
    density = HyperPosterior(LINEAR.bind(campaign_of_three()), truncated=True)
    ratio = linear_over_constant(density, tolerance=TOLERANCE)
    assert 0.0 < ratio.error < 4.0 * TOLERANCE


def test_the_probability_of_truncation_is_that_of_the_integrals() -> None:
    density = HyperPosterior(LINEAR.bind(campaign_of_three()), truncated=True)
    coarse = density.probability_inside(density.without_truncation.weighted_sample, 0.02)
    integrals = [
        compute_nodes(nodes, 1e-3).integral.log_integral
        for nodes in (density, density.without_truncation)
    ]
    assert np.isclose(coarse.log_value, integrals[0] - integrals[1], atol=coarse.error + 2e-3)
