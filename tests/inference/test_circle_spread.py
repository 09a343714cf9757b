"""How unlike circles are, learnt from those measured: densities of another library, known cases."""

from __future__ import annotations

import numpy as np
import pytest
from campaigns import plan, simulated
from scipy.stats import gamma, invgamma

import ldbb_bayes as lb
from ldbb_bayes.inference.circle_spread import _SHAPES, draw_new_noise_factors, shape_probabilities
from ldbb_bayes.inference.coefficients import ModelDraws
from ldbb_bayes.inference.prediction import new_circles
from ldbb_bayes.model.hyper_prior import _RATE, _SHAPE


def test_the_first_shape_is_that_of_the_prior() -> None:
    assert _SHAPES[0] == _SHAPE == _RATE


def test_probabilities_are_those_of_bayes_theorem() -> None:
    factors = np.array([0.6, 1.3, 0.9, 2.5])
    prior = np.array([0.5, *[0.5 / 7] * 7])
    likelihood = [invgamma(a, scale=a).pdf(factors**2).prod() for a in _SHAPES]
    expected = prior * likelihood / (prior @ likelihood)
    assert shape_probabilities(factors[None])[0] == pytest.approx(expected)


def test_circles_that_scatter_alike_lighten_the_tails() -> None:
    probabilities = shape_probabilities(np.ones((1, 7)))[0]
    assert probabilities[0] < 0.1


def test_an_odd_circle_leaves_the_tails_of_the_prior() -> None:
    probabilities = shape_probabilities(np.array([[0.7, 0.8, 0.9, 0.7, 0.8, 0.9, 6.0]]))[0]
    assert probabilities[0] > 0.9


def test_drawn_factors_have_the_distribution_of_the_shapes(rng: np.random.Generator) -> None:
    factors = np.tile([0.9, 1.1, 1.2, 0.8], (200_000, 1))
    weights = shape_probabilities(factors[:1])[0]
    precisions = draw_new_noise_factors(factors, rng) ** -2.0
    expected = [weights @ gamma(_SHAPES, scale=1.0 / _SHAPES).cdf(x) for x in (0.3, 1.0, 2.5)]
    shares = [(precisions <= x).mean() for x in (0.3, 1.0, 2.5)]
    assert shares == pytest.approx(expected, abs=0.005)


@pytest.fixture(scope="module")
def draws() -> ModelDraws:
    bound = lb.HybridModel.default(degree=1).bind(simulated(plan()))
    phi = np.tile(bound.hyper_prior.quantile(np.full((1, 1), 0.5)), (4000, 1))
    names = bound.hyper_prior.names
    for name in bound.setting.circle:
        phi[:, names.index(str(name))] = 1.0
    return ModelDraws(bound, phi, np.tile(bound.least_squares_estimate, (4000, 1)))


def band_width(draws: ModelDraws, seed: int, *, learn_spread: bool = True) -> float:
    """Return the mean width of the 99 % band of a new circle [mm]."""
    angle = np.arange(0.0, 360.0, 15.0)
    circle = lb.CircularTest(350.0, angle)
    rng = np.random.default_rng(seed)
    readings = next(new_circles(draws, lb.Plan((circle,)), rng, learn_spread=learn_spread))
    low, high = np.quantile(readings, [0.005, 0.995], axis=0)
    return float((high - low).mean())


def test_bands_of_new_circles_are_wider_where_one_circle_was_odd(draws: ModelDraws) -> None:
    names = draws.bound.hyper_prior.names
    odd_phi = draws.phi.copy()
    odd_phi[:, names.index(str(draws.bound.setting.circle[0]))] = 8.0
    with_odd_circle = ModelDraws(draws.bound, odd_phi, draws.beta)
    assert band_width(draws, 1) < 0.9 * band_width(with_odd_circle, 1)


def test_circles_that_scatter_as_the_prior_says_have_wider_bands(draws: ModelDraws) -> None:
    """All measured circles are alike, which the prior of the noise factors does not learn."""
    assert band_width(draws, 1) < 0.95 * band_width(draws, 1, learn_spread=False)
