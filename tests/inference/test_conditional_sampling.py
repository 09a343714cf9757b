"""Draws of the parameters given the scales."""

from __future__ import annotations

import numpy as np
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.inference.conditional_sampling import conditional_draws
from ldbb_bayes.inference.hyper_posterior import HyperPosterior


def test_conditional_draws_have_the_conditional_moments() -> None:
    rng = np.random.default_rng(0)
    model = lb.HybridModel.first(1).without("truncation")
    plain = HyperPosterior(model.bind(simulated(plan())), truncated=False)
    free = np.tile(plain.mode, (6_000, 1))
    beta, exact = conditional_draws(plain.bound, free, rng)
    _, conditional = plain.given(free[:1])
    sd = np.linalg.norm(conditional.spread()[0], axis=1)
    assert exact.all()
    np.testing.assert_allclose((beta.mean(axis=0) - conditional.mean[0]) / sd, 0.0, atol=0.06)
    np.testing.assert_allclose(beta.std(axis=0) / sd, 1.0, atol=0.04)
