"""Integrals from the ratio of two densities at some of the nodes, against the sum over all nodes
and against closed forms."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ldbb_bayes.inference.density_ratio import LogValues, RatioSampler, _decompose
from ldbb_bayes.inference.importance_sampling import importance_sample
from ldbb_bayes.inference.integrals import Index, Integral
from ldbb_bayes.inference.lattice import grow_lattice

Array = np.ndarray
LogRatio = Callable[[Array], Array]
# Dimensions of the densities: as many as four circles have hyper-parameters.
H = 9
LOG_2PI = float(np.log(2 * np.pi))


def log_normal(x: Array) -> Array:
    return -0.5 * (x**2).sum(axis=1) - 0.5 * x.shape[1] * LOG_2PI


@pytest.fixture(scope="module")
def nodes() -> Integral:
    """Nodes of N(0, I)."""
    return importance_sample(log_normal, [(np.zeros(H), np.eye(H))], tolerance=2e-3)


def smooth(x: Array) -> Array:
    """No polynomial, as ratios of models are not; it grows so slowly that its mean is finite."""
    cubic = x[:, 3] ** 3 / (1.0 + 0.05 * x[:, 3] ** 2)
    return 0.3 * np.tanh(x[:, 0] - 0.5 * x[:, 1]) + 0.1 * np.sin(3.0 * x[:, 2]) + 0.05 * cubic


class Evaluated:
    """A density times a ratio, which counts at how many nodes it was asked for."""

    def __init__(self, integral: Integral, log_ratio: LogRatio) -> None:
        self.integral = integral
        self.log_ratio = log_ratio
        self.nodes = 0

    def __call__(self, index: Index) -> LogValues:
        self.nodes += len(index)
        values = self.integral.log_density[index] + self.log_ratio(self.integral.free[index])
        return LogValues(values, np.zeros(len(index)))

    def of_all(self) -> float:
        """ln of the weighted mean of the ratio over all nodes, plus that of the integral."""
        ratio = np.exp(self.log_ratio(self.integral.free))
        return self.integral.log_integral + float(np.log(self.integral.weight @ ratio))


@pytest.mark.slow
@pytest.mark.parametrize("amplitude", [1.0, 0.2])
def test_stated_error_covers_the_sum_over_all_nodes(nodes: Integral, amplitude: float) -> None:
    """In 99 % of the samples, drawn with 300 seeds."""
    evaluated = Evaluated(nodes, lambda x: amplitude * smooth(x))
    expected = evaluated.of_all()
    covered = []
    for seed in range(300):
        result = RatioSampler(nodes, seed=seed).integrate(evaluated, tolerance=1.0)
        assert result is not None
        error = abs(result.integral.log_integral - expected)
        covered.append(error <= result.integral.ratio_error)
    assert np.mean(covered) >= 0.99


def test_stated_error_is_of_the_size_of_the_error(nodes: Integral) -> None:
    """It is three standard errors, and a little more because of the leverage."""
    evaluated = Evaluated(nodes, smooth)
    expected = evaluated.of_all()
    ratios = []
    for seed in range(100):
        result = RatioSampler(nodes, seed=seed).integrate(evaluated, tolerance=1.0)
        assert result is not None
        error = result.integral.log_integral - expected
        ratios.append(error / result.integral.ratio_error)
    assert 0.15 < np.std(ratios) < 0.4


def test_the_ratio_of_two_normal_densities_is_fitted_without_residual(nodes: Integral) -> None:
    slope = np.linspace(-0.2, 0.3, H)
    evaluated = Evaluated(nodes, lambda x: x @ slope - 0.05 * x[:, 0] ** 2)
    result = RatioSampler(nodes).integrate(evaluated, tolerance=0.1)
    assert result is not None
    assert result.integral.ratio_error < 1e-9
    assert result.integral.log_integral == pytest.approx(evaluated.of_all(), abs=1e-9)


def test_a_ratio_that_no_polynomial_fits_is_not_trusted(nodes: Integral) -> None:
    evaluated = Evaluated(nodes, lambda x: 5.0 * smooth(x))
    assert RatioSampler(nodes).integrate(evaluated, tolerance=10.0) is None


def test_few_nodes_are_evaluated_where_they_suffice(nodes: Integral) -> None:
    evaluated = Evaluated(nodes, lambda x: 0.2 * smooth(x))
    assert RatioSampler(nodes).integrate(evaluated, tolerance=0.02) is not None
    assert evaluated.nodes <= 192


def test_more_nodes_are_evaluated_where_few_do_not_suffice(nodes: Integral) -> None:
    evaluated = Evaluated(nodes, smooth)
    sampler = RatioSampler(nodes)
    rough = sampler.integrate(evaluated, tolerance=1.0)
    assert rough is not None
    evaluated.nodes = 0
    fine = sampler.integrate(evaluated, tolerance=0.8 * rough.error)
    assert fine is not None
    assert fine.error <= 0.8 * rough.error
    assert 192 < evaluated.nodes <= 576


def test_none_is_returned_where_no_sample_reaches_the_tolerance(nodes: Integral) -> None:
    evaluated = Evaluated(nodes, smooth)
    assert RatioSampler(nodes).integrate(evaluated, tolerance=nodes.error + 1e-6) is None


def test_no_more_nodes_are_evaluated_where_all_would_not_suffice(nodes: Integral) -> None:
    evaluated = Evaluated(nodes, smooth)
    assert RatioSampler(nodes).integrate(evaluated, tolerance=0.5 * nodes.error) is None
    assert evaluated.nodes <= 192


@pytest.mark.parametrize("seed", range(20))
def test_a_heavy_tailed_ratio_is_not_trusted(nodes: Integral, seed: int) -> None:
    """Ratios follow a Pareto distribution of the shape 0.9, whose variance is infinite."""
    uniform = np.random.default_rng(seed).random(len(nodes.free))
    log_ratio_of_all = -0.9 * np.log(uniform)

    def evaluate(index: Index) -> LogValues:
        return LogValues(nodes.log_density[index] + log_ratio_of_all[index], np.zeros(len(index)))

    assert RatioSampler(nodes, seed=seed).integrate(evaluate, tolerance=0.1) is None


@pytest.mark.parametrize("level", [0.0, -2000.0])
def test_a_huge_ratio_is_not_trusted(nodes: Integral, level: float) -> None:
    """It exceeds the largest number of double precision, or the mean times this number."""
    evaluated = Evaluated(nodes, lambda x: level + 1000.0 * np.sin(3.0 * x[:, 2]))
    assert RatioSampler(nodes).integrate(evaluated, tolerance=1.0) is None


def test_a_density_that_is_zero_at_a_node_is_left_to_others(nodes: Integral) -> None:
    def evaluate(index: Index) -> LogValues:
        return LogValues(np.full(len(index), -np.inf), np.zeros(len(index)))

    assert RatioSampler(nodes).integrate(evaluate, tolerance=1.0) is None


def test_errors_of_the_values_are_passed_on(nodes: Integral) -> None:
    def evaluate(index: Index) -> LogValues:
        return LogValues(nodes.log_density[index], np.full(len(index), 0.003))

    result = RatioSampler(nodes).integrate(evaluate, tolerance=1.0)
    assert result is not None
    assert result.value_error == pytest.approx(0.003)
    assert result.error == pytest.approx(nodes.error + 0.003, abs=1e-6)


def test_weights_of_the_nodes_are_those_under_the_other_density(nodes: Integral) -> None:
    """Means of coordinates under N(b, I)."""
    slope = np.linspace(-0.2, 0.3, H)
    result = RatioSampler(nodes).integrate(Evaluated(nodes, lambda x: x @ slope), tolerance=0.1)
    assert result is not None
    mean = result.integral.weight @ result.integral.free
    np.testing.assert_allclose(mean, slope, atol=0.05)


@pytest.mark.parametrize("dependent", [0.0, 1e-13, 1e-7])
def test_a_polynomial_is_fitted_by_least_squares(dependent: float) -> None:
    """Against least squares of NumPy, where two columns are independent, nearly equal or equal."""
    rng = np.random.default_rng(0)
    matrix = rng.standard_normal((40, 6))
    if dependent:
        matrix[:, 5] = matrix[:, 2] + dependent * matrix[:, 5]
    values = rng.standard_normal(40)
    found = _decompose(matrix)
    np.testing.assert_allclose(
        found.orthonormal.T @ found.orthonormal, np.eye(found.orthonormal.shape[1]), atol=1e-9
    )
    fitted = matrix @ (found.coefficients @ (found.orthonormal.T @ values))
    solution = np.linalg.lstsq(matrix, values, rcond=1e-10)[0]
    np.testing.assert_allclose(fitted, matrix @ solution, atol=1e-6)


def test_too_few_nodes_are_not_sampled() -> None:
    lattice = grow_lattice(log_normal, [(np.zeros(1), np.eye(1))], tolerance=0.01)
    evaluated = Evaluated(lattice, lambda x: x[:, 0])
    assert RatioSampler(lattice).integrate(evaluated, tolerance=1.0) is None
    assert evaluated.nodes == 0


def test_the_ratio_of_two_normal_densities_on_a_lattice_has_its_closed_form() -> None:
    """∫ N(x; 0, I) exp(b x) dx = exp(½ |b|²)."""
    lattice = grow_lattice(log_normal, [(np.zeros(3), np.eye(3))], tolerance=1e-3)
    slope = np.array([0.1, -0.2, 0.3])
    result = RatioSampler(lattice).integrate(Evaluated(lattice, lambda x: x @ slope), tolerance=0.1)
    assert result is not None
    assert result.integral.log_integral == pytest.approx(0.5 * slope @ slope, abs=result.error)


def test_samples_of_a_lattice_have_honest_errors() -> None:
    lattice = grow_lattice(log_normal, [(np.zeros(3), np.eye(3))], tolerance=1e-3)
    evaluated = Evaluated(lattice, lambda x: 0.1 * np.sin(2.0 * x).sum(axis=1))
    expected = evaluated.of_all()
    covered = []
    for seed in range(300):
        result = RatioSampler(lattice, seed=seed).integrate(evaluated, tolerance=0.5)
        assert result is not None
        error = abs(result.integral.log_integral - expected)
        covered.append(error <= result.integral.ratio_error)
    assert np.mean(covered) >= 0.99
