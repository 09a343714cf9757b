"""Standard uncertainties that further certificates would leave."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import oracle_of, plan, simulated
from oracle import Stated

import ldbb_bayes as lb
from ldbb_bayes.analysis.hyper_parameter_nodes import hyper_parameter_nodes
from ldbb_bayes.analysis.value_of_certificates import (
    missing_certificates,
    uncertainty_with,
    worth_of_certificates,
)
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.nodes import compute_nodes

MODEL = lb.HybridModel.first(1).without("truncation")
CAMPAIGN = simulated(plan())
CERTIFIED_BAR = lb.Instrument(bar_U_um=1.0)


def test_the_variance_over_phi_is_the_mean_of_variances_and_the_variance_of_means() -> None:
    """With a bar certified to 1 µm, by the oracle."""
    weight = np.array([0.5, 0.3, 0.2])
    bound = MODEL.bind(CAMPAIGN)
    phi = hyper_parameter_nodes(bound)[1][[0, 7, -1]]
    oracle = oracle_of(CAMPAIGN, 1, stated=Stated(length_U_um=1.0))
    conditionals = [oracle.given(node) for node in phi]
    variances = np.array([np.diag(conditional[2]) for conditional in conditionals])
    means = np.array([conditional[1] for conditional in conditionals])
    total = weight @ (variances + (means - weight @ means) ** 2)
    np.testing.assert_allclose(
        uncertainty_with(bound, CERTIFIED_BAR, weight, phi), np.sqrt(total), rtol=1e-6
    )


def test_the_pattern_of_the_machine_is_as_large_as_the_form_was() -> None:
    """Stating the balls, ω takes the place of τ; every other scale keeps its value."""
    model = lb.HybridModel.default(1)
    balls = lb.Instrument(work=lb.Ball(grade="G10"), tool=lb.Ball(grade="G10"))
    prior = model.bind(CAMPAIGN).hyper_prior
    prior_with_balls = model.bind(replace(CAMPAIGN, instrument=balls)).hyper_prior
    phi = np.linspace(1.0, 2.0, len(prior.names)) * 1e-3
    carried = dict(
        zip(prior_with_balls.names, prior_with_balls.values_from(prior, phi), strict=True)
    )
    phi_by_name = dict(zip(prior.names, phi, strict=True))
    assert set(carried) - set(phi_by_name) == {"omega"}
    assert carried.pop("omega") == phi_by_name["tau"]
    assert carried == {name: phi_by_name[name] for name in carried}


def test_the_other_ball_is_missing_where_one_is_stated() -> None:
    for stated, other in (("work", "tool"), ("tool", "work")):
        missing = missing_certificates(lb.Instrument(**{stated: lb.Ball(grade="G20")}))
        of_balls = [name for name in missing if "ball" in name]
        assert of_balls == [f"{other} ball of grade G10"]
        assert missing[of_balls[0]] == {other: lb.Ball(grade="G10")}


def test_both_balls_are_one_certificate_where_none_is_stated() -> None:
    missing = missing_certificates(lb.Instrument(bar_U_um=1.0))
    assert [name for name in missing if "ball" in name] == ["balls of grade G10"]
    stated = lb.Instrument(work=lb.Ball(grade="G10"), tool=lb.Ball(sphericity_um=0.2))
    assert not [name for name in missing_certificates(stated) if "ball" in name]


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
    sd = compute_nodes(HyperPosterior(MODEL.bind(campaign), truncated=False), 0.1).moments()[1]
    np.testing.assert_allclose(list(expected.values()), sd, rtol=0.02)


def test_many_nodes_are_thinned() -> None:
    """Three circles have no noise factors and so many nodes; a sample of them says the same."""
    bound = MODEL.bind(simulated(plan((30,) * 3, forces_N=(36.0, 400.0, 742.0)), seed=4))
    nodes = hyper_parameter_nodes(bound)
    assert len(nodes[0]) > 4000
    worth = worth_of_certificates(bound, *nodes)["bar ± 1 µm"]
    exact = uncertainty_with(bound, CERTIFIED_BAR, *nodes)
    np.testing.assert_allclose([worth[name] for name in bound.names], exact, rtol=0.01)
