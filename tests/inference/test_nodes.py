"""Draws from weighted nodes of p(φ | y), with and without negative compliances."""

from __future__ import annotations

import numpy as np
import pytest

from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.nodes import compute_nodes
from ldbb_bayes.model.hybrid import BoundModel


@pytest.mark.parametrize("required", [True, False])
def test_draws_of_a_density_without_truncation_have_negative_compliances(
    usually_negative: BoundModel, required: bool
) -> None:
    """The model may require compliances that are not negative: its density without this counts."""
    model = usually_negative.model if required else usually_negative.model.without("truncation")
    posterior = HyperPosterior(model.bind(usually_negative.campaign), truncated=False)
    beta, _ = compute_nodes(posterior, 0.1).draw(400, np.random.default_rng(1))
    assert 0.1 < usually_negative.truncation.holds(beta).mean() < 0.9


@pytest.mark.parametrize("required", [True, False])
def test_draws_of_a_truncated_density_have_no_negative_compliance(
    usually_negative: BoundModel, required: bool
) -> None:
    model = usually_negative.model if required else usually_negative.model.without("truncation")
    posterior = HyperPosterior(model.bind(usually_negative.campaign), truncated=True)
    beta, _ = compute_nodes(posterior, 0.1).draw(400, np.random.default_rng(1))
    assert usually_negative.truncation.holds(beta).all()


def test_moments_are_those_of_draws(usually_negative: BoundModel) -> None:
    posterior = HyperPosterior(usually_negative, truncated=False)
    nodes = compute_nodes(posterior, 0.01)
    mean, sd = nodes.moments()
    beta, _ = nodes.draw(40_000, np.random.default_rng(1))
    np.testing.assert_allclose((mean - beta.mean(axis=0)) / sd, 0.0, atol=0.03)
    np.testing.assert_allclose(sd, beta.std(axis=0), rtol=0.03)
