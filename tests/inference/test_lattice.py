"""The grown trapezoidal rule against closed forms: Gaussians, long tails, skew, two modes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy import stats
from scipy.special import gammaln

from ldbb_bayes.inference.lattice import grow_lattice

Array = np.ndarray


def correlated_gaussian(x: Array) -> Array:
    covariance = np.array([[1.0, 0.7, 0.0, 0.1], [0.7, 2.0, 0.3, 0.0], [0.0, 0.3, 0.5, 0.2], [0.1, 0.0, 0.2, 1.5]])
    return np.atleast_1d(stats.multivariate_normal(np.array([0.3, -0.2, 0.1, 0.4]), covariance).logpdf(x)) + 12.5


def half_normals_in_logarithms(x: Array) -> Array:
    """ln φ of half-normal φ: falls like e^x on the left, doubly exponentially on the right."""
    return np.asarray((x + 0.5 * np.log(2.0 / np.pi) - 0.5 * np.exp(2.0 * x)).sum(axis=1))


def log_gammas(x: Array) -> Array:
    return np.asarray((2.5 * x - np.exp(x) - gammaln(2.5)).sum(axis=1))


def two_modes(x: Array) -> Array:
    """3 sd apart."""
    one, other = (stats.norm(centre, 1.0).logpdf(x).sum(axis=1) for centre in (-1.5, 1.5))
    return np.asarray(np.logaddexp(one, other) - np.log(2.0))


CASES: dict[str, tuple[Callable[[Array], Array], Array, Array, float]] = {
    "Gaussian": (correlated_gaussian, np.zeros(4), np.diag([1.0, 1.2, 0.7, 1.2]), 12.5),
    "half-normals": (half_normals_in_logarithms, np.zeros(3), 0.7 * np.eye(3), 0.0),
    "log gammas": (log_gammas, np.full(2, np.log(2.5)), np.eye(2) / np.sqrt(2.5), 0.0),
    "two modes": (two_modes, np.full(2, 1.5), np.eye(2), 0.0),
    "one dimension": (log_gammas, np.array([np.log(2.5)]), np.array([[0.6]]), 0.0),
}


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("case", CASES)
def test_integral_and_its_error(case: str, tolerance: float) -> None:
    log_density, centre, root, expected = CASES[case]
    lattice = grow_lattice(log_density, centre, root, tolerance=tolerance)
    assert lattice.error <= tolerance
    assert abs(lattice.log_integral - expected) <= lattice.error + 1e-9
    assert lattice.weight.sum() == pytest.approx(1.0)


def test_the_error_says_so_when_nodes_run_out() -> None:
    lattice = grow_lattice(half_normals_in_logarithms, np.zeros(3), 0.05 * np.eye(3), tolerance=1e-6, most=2000)
    assert lattice.error > 1e-6


def test_moments_of_the_nodes() -> None:
    lattice = grow_lattice(correlated_gaussian, np.zeros(4), np.eye(4), tolerance=1e-6)
    np.testing.assert_allclose(lattice.weight @ lattice.free, [0.3, -0.2, 0.1, 0.4], atol=1e-5)
    centred = lattice.free - lattice.weight @ lattice.free
    covariance = (lattice.weight[:, None] * centred).T @ centred
    np.testing.assert_allclose(np.diag(covariance), [1.0, 2.0, 0.5, 1.5], atol=1e-4)


@pytest.mark.parametrize("case", ["half-normals", "two modes", "one dimension"])
def test_draws_come_from_the_density_they_say(case: str) -> None:
    """Weighted by density over proposal they give the integral; every proposal density is that of its cells."""
    log_density, centre, root, expected = CASES[case]
    lattice = grow_lattice(log_density, centre, root, tolerance=1e-3)
    free = lattice.draw(20_000, np.random.default_rng(3))
    weight = np.exp(log_density(free) - lattice.log_proposal(free) + lattice.log_integral - expected)
    assert weight.mean() == pytest.approx(1.0, abs=5.0 * weight.std() / np.sqrt(len(weight)) + 1e-3)
    assert weight.sum() ** 2 / (weight**2).sum() > 0.6 * len(weight)
    wider = lattice.draw(20_000, np.random.default_rng(3), temperature=2.0)
    assert np.all(wider.std(axis=0) > 1.1 * free.std(axis=0))


def test_a_corrected_lattice_is_that_of_the_other_density() -> None:
    def tilted(x: Array) -> Array:
        return correlated_gaussian(x) + np.log(stats.norm.cdf(x[:, 0]))

    lattice = grow_lattice(correlated_gaussian, np.zeros(4), np.eye(4), tolerance=1e-4)
    corrected = lattice.corrected(tilted, spare=1e-7)
    expected = 12.5 + stats.norm.logcdf(0.3 / np.sqrt(2.0))
    assert corrected.log_integral == pytest.approx(expected, abs=2e-4)
