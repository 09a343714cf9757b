"""Independent draws of parameters and scales against moments of the nodes."""

from __future__ import annotations

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.inference import independent_sampler
from ldbb_bayes.inference.density import JointDensity
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.independent_sampler import draw_jointly
from ldbb_bayes.inference.nodes import compute_nodes


def check_moments(draws: np.ndarray, mean: np.ndarray, sd: np.ndarray) -> None:
    standard_error = 1.0 / np.sqrt(len(draws))
    error = (draws.mean(axis=0) - mean) / sd
    np.testing.assert_allclose(error, 0.0, atol=4.0 * standard_error)
    np.testing.assert_allclose(draws.std(axis=0) / sd, 1.0, atol=6.0 * standard_error)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("truncated", "few_inside", "size"), [(False, 0.0, 6000), (True, 0.0, 6000), (True, 1.0, 1500)]
)
def test_draws_have_the_moments_of_the_nodes(
    recovered: lb.Campaign,
    truncated: bool,
    few_inside: float,
    size: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """ln P(T | y) is −1.2: several β for each φ; and by tilting, as where it is far smaller."""
    monkeypatch.setattr(independent_sampler, "_SMALLEST_SHARE_INSIDE", few_inside)
    model = lb.HybridModel.first(1)
    if not truncated:
        model = model.without("truncation")
    posterior = HyperPosterior(model.bind(recovered), truncated=truncated)
    nodes = compute_nodes(posterior, 1e-2)
    draws = draw_jointly(posterior, size, np.random.default_rng(2))
    free, beta, accepted, proposed, log_posterior = draws
    assert len(free) == len(beta) == size
    mean = nodes.integral.weight @ nodes.integral.free
    sd = np.sqrt(nodes.integral.weight @ (nodes.integral.free - mean) ** 2)
    check_moments(free, mean, sd)
    check_moments(beta, *nodes.moments(spare=1e-4))
    density = JointDensity(posterior.bound)
    np.testing.assert_allclose(log_posterior, density(density.join(beta, free)), atol=1e-8)
    if truncated:
        assert posterior.bound.physical.holds(beta).all()
    assert len(np.unique(beta, axis=0)) == size
    assert len(np.unique(free, axis=0)) > 0.95 * size
    assert 0.2 < accepted / proposed < 1.0
