"""Mode of p(φ | y), and the proposal that its nodes make."""

from __future__ import annotations

import numpy as np
import pytest
from campaigns import HYPER_UM, TRUTH, plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.nodes import compute_nodes


@pytest.mark.parametrize(
    ("planned", "left_out"),
    [(plan(), []), (plan((9, 40, 12, 30)), ["ball-form"]), (plan(work_deg=40.0), [])],
)
def test_a_proposal_reaches_the_corners_of_the_density(
    planned: lb.Campaign, left_out: list[str]
) -> None:
    """Where one noise vanishes and another makes up for it one draw would stand for hundreds: the
    lattice's nodes go there."""
    model = lb.HybridModel.first(1)
    campaign = model.simulate(planned, seed=4, parameters=TRUTH, hyper_um=HYPER_UM).campaign
    posterior = HyperPosterior(model.without(*left_out).bind(campaign), truncated=False)
    free, _ = compute_nodes(posterior, 1e-2).integral.heaviest(1e-5)
    log_weight = (
        posterior.log_density(free)
        - posterior.weighted_sample.log_proposal(free)
        - posterior.weighted_sample.log_integral
    )
    assert posterior.weighted_sample.trusted
    assert np.exp(log_weight.max()) < 12.0


def test_mode_is_a_maximum() -> None:
    bound = lb.HybridModel.first(1).bind(simulated(plan()))
    posterior = HyperPosterior(bound, truncated=True)
    around = posterior.mode + 0.3 * np.random.default_rng(0).normal(size=(200, 4))
    highest = posterior.log_density(posterior.mode[None])[0]
    assert posterior.log_density(around).max() <= highest + 1e-4


def test_the_mode_of_a_similar_density_does_not_hide_a_higher_mode() -> None:
    angle_deg = np.arange(0.0, 360.0, 9.0)
    tests = []
    for force_N in np.round(np.linspace(40.0, 740.0, 12)):
        tests.append(lb.CircularTest(float(force_N), angle_deg, name=f"{force_N:g}"))
    linear = lb.HybridModel.first(1).without("truncation")
    scales_um = {"tau": 15.0, "kappa": 0.5, "delta": 0.0, "sigma": 0.3}
    campaign = linear.simulate(lb.Campaign(tests), seed=0, hyper_um=scales_um).campaign
    of_linear = HyperPosterior(linear.bind(campaign), truncated=False)
    # Without the slope of C_XXX, which is large here, the readings ask for other scales.
    reduced = linear.fixing("C_XXX_1").bind(campaign)
    from_prior = HyperPosterior(reduced, truncated=False)
    from_mode_nearby = HyperPosterior(reduced, truncated=False, near=of_linear.mode)
    heights = [float(one.log_density(one.mode[None])[0]) for one in (from_prior, from_mode_nearby)]
    assert heights[1] == pytest.approx(heights[0], abs=1e-3)
