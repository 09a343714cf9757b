"""Regression with an unknown noise scale: NIST's certified values (tests/nist), and the three priors against other code."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal, localcontext
from fractions import Fraction
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import scipy.integrate
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from ldbb_bayes.errors import InputError
from ldbb_bayes.model.gaussian import Gaussian, LinearGaussian
from ldbb_bayes.model.normal_gamma import NormalGamma, StudentT
from ldbb_bayes.model.regression import ScaledLinearGaussian

FOLDER = Path(__file__).resolve().parents[1] / "nist"
# Digits (log relative errors) required of estimates, their standard deviations and the residual standard deviation: for estimates
# the package's promise (Norris 11, Pontius 11, Longley 9, Wampler1 8, Filip 6), elsewhere one or two below what was attained, as
# LAPACK rounds differently from build to build. Estimates lose the digits of the condition number; from Wampler3 to 5 also those
# of ever larger residuals, beside which the terms to be found are small. Certified zeros: digits of the absolute error.
DIGITS = {
    "Norris": (11, 12, 12),
    "Pontius": (11, 11, 11),
    "NoInt1": (13, 13, 13),
    "NoInt2": (13, 13, 13),
    "Filip": (6, 6, 7),
    "Longley": (9, 10, 10),
    "Wampler1": (8, 8, 8),
    "Wampler2": (11, 13, 13),
    "Wampler3": (8, 12, 12),
    "Wampler4": (7, 12, 12),
    "Wampler5": (5, 12, 12),
}


@dataclass(frozen=True)
class Certified:
    """One dataset as printed: powers of x in the model (none for Longley's own columns), data and certified values."""

    powers: tuple[int, ...]
    rows: tuple[tuple[str, ...], ...]
    estimate: tuple[str, ...]
    sd: tuple[str, ...]
    residual: str

    def design(self, number: Callable[[str], object]) -> tuple[list[list], list]:
        """J and y in any arithmetic."""
        y = [number(row[0]) for row in self.rows]
        if len(self.rows[0]) > 2:
            return [[number("1"), *map(number, row[1:])] for row in self.rows], y
        return [[number(row[1]) ** power for power in self.powers] for row in self.rows], y

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        jacobian, y = self.design(float)
        return np.array(jacobian), np.array(y)


@cache
def certified(name: str) -> Certified:
    with (FOLDER / "certified.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["dataset"] == name]
    with (FOLDER / f"{name.lower()}.csv").open(encoding="utf-8") as file:
        data = tuple(map(tuple, csv.reader(file)))[1:]
    parameters, last = rows[:-1], rows[-1]
    assert last["parameter"] == "residual"
    return Certified(
        tuple(int(row["parameter"][1:]) for row in parameters),
        data,
        tuple(row["estimate"] for row in parameters),
        tuple(row["sd"] for row in parameters),
        last["sd"],
    )


def digits(values: np.ndarray, printed: tuple[str, ...]) -> float:
    """Least log relative error; of the absolute error where 0 is certified."""
    truth = np.array(printed, dtype=float)
    error = np.abs(np.asarray(values) - truth) / np.where(truth == 0.0, 1.0, np.abs(truth))
    return float(-np.log10(max(error.max(), 1e-15)))


def solve_exactly(matrix: list[list[Fraction]], right: list[list[Fraction]]) -> list[list[Fraction]]:
    """Gauss and Jordan."""
    rows = [left + extra for left, extra in zip(matrix, right, strict=True)]
    for i in range(len(rows)):
        rows[i] = [value / rows[i][i] for value in rows[i]]
        for k in range(len(rows)):
            if k != i:
                factor = rows[k][i]
                rows[k] = [a - factor * b for a, b in zip(rows[k], rows[i], strict=True)]
    return [row[len(rows) :] for row in rows]


def as_printed(exact: Decimal, printed: str) -> bool:
    """Whether ``exact`` rounds to the printed digits."""
    unit = Decimal(1).scaleb(Decimal(printed).as_tuple().exponent)
    return abs(exact - Decimal(printed)) <= unit / 2


@pytest.mark.parametrize("name", DIGITS)
def test_typed_data_give_the_certified_values_in_rational_arithmetic(name: str) -> None:
    data = certified(name)
    jacobian, y = data.design(Fraction)
    n, p = len(jacobian), len(jacobian[0])
    gram = [[sum(row[i] * row[j] for row in jacobian) for j in range(p)] for i in range(p)]
    moments = [sum(row[i] * value for row, value in zip(jacobian, y, strict=True)) for i in range(p)]
    solved = solve_exactly(gram, [[moments[i], *(Fraction(i == j) for j in range(p))] for i in range(p)])
    estimate = [row[0] for row in solved]
    left = [value - sum(a * b for a, b in zip(row, estimate, strict=True)) for row, value in zip(jacobian, y, strict=True)]
    variance = sum(value**2 for value in left) / Fraction(n - p)
    with localcontext(prec=60):
        for value, printed in zip(estimate, data.estimate, strict=True):
            assert as_printed(Decimal(value.numerator) / value.denominator, printed)
        squares = [variance * solved[i][1 + i] for i in range(p)] + [variance]
        for square, printed in zip(squares, [*data.sd, data.residual], strict=True):
            assert as_printed((Decimal(square.numerator) / square.denominator).sqrt(), printed)


@pytest.mark.parametrize("name", DIGITS)
def test_certified_digits(name: str) -> None:
    data = certified(name)
    posterior = ScaledLinearGaussian(data.arrays()[0]).flat_posterior(data.arrays()[1])
    attained = (
        digits(posterior.coefficients.mean, data.estimate),
        digits(posterior.coefficients.scale, data.sd),
        digits(np.array([posterior.scale]), (data.residual,)),
    )
    assert np.all(np.array(attained) >= DIGITS[name]), f"{name}: {np.round(attained, 1)} digits"
    assert posterior.coefficients.dof == len(data.rows) - len(data.estimate)


def by_normal_equations(jacobian: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.linalg.solve(jacobian.T @ jacobian, jacobian.T @ y)


def by_default_lstsq(jacobian: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(jacobian, y, rcond=None)[0]


@pytest.mark.parametrize("wrong", [by_normal_equations, by_default_lstsq])
def test_naive_solutions_miss_filip(wrong: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> None:
    """The thresholds can fail: two usual ways have no digit of Filip right."""
    data = certified("Filip")
    assert digits(wrong(*data.arrays()), data.estimate) < 1.0


def test_the_order_and_units_of_columns_do_not_matter() -> None:
    data = certified("Filip")
    jacobian, y = data.arrays()
    order, unit = np.random.default_rng(3).permutation(11), 10.0 ** np.linspace(-80.0, 80.0, 11)
    turned = ScaledLinearGaussian(jacobian[:, order] * unit).flat_posterior(y).coefficients
    back = np.empty(11)
    back[order] = turned.mean * unit
    assert digits(back, data.estimate) >= 6.0
    back[order] = turned.scale * unit
    assert digits(back, data.sd) >= 6.0


def regression(
    n: int, p: int, seed: int, *, relative: str = "none"
) -> tuple[ScaledLinearGaussian, np.ndarray, np.random.Generator]:
    """A random design with V absent, diagonal or full, readings of noise scale 0.7, and the generator that goes on."""
    rng = np.random.default_rng(seed)
    variance = {
        "none": None,
        "diagonal": np.exp(rng.normal(size=n)),
        "full": np.atleast_2d(np.cov(rng.normal(size=(n, 3 * n + 2)))) + 0.1 * np.eye(n),
    }[relative]
    model = ScaledLinearGaussian(rng.normal(size=(n, p)), variance)
    return model, model.jacobian @ rng.normal(size=p) + 0.7 * rng.normal(size=n), rng


def root_of(p: int, rng: np.random.Generator) -> np.ndarray:
    return np.linalg.cholesky(np.atleast_2d(np.cov(rng.normal(size=(p, 3 * p + 2)))) + 0.1 * np.eye(p))


def full_noise(model: ScaledLinearGaussian) -> np.ndarray:
    noise = model.relative_noise
    if noise is None:
        return np.eye(len(model.jacobian))
    return np.diag(noise) if noise.ndim == 1 else noise


def log_density_of_scale(sigma: float | np.ndarray, shape: float, rate: float) -> float | np.ndarray:
    """ln p(σ) where 1/σ² ~ Gamma(shape, rate), by SciPy."""
    return stats.gamma.logpdf(np.asarray(sigma) ** -2.0, shape, scale=1.0 / rate) + np.log(2.0) - 3.0 * np.log(sigma)


RELATIVE = ["none", "diagonal", "full"]


@pytest.mark.parametrize("relative", RELATIVE)
def test_flat_posterior_against_the_textbook(relative: str) -> None:
    model, y, rng = regression(14, 3, 8, relative=relative)
    jacobian, weight = model.jacobian, np.linalg.inv(full_noise(model))
    spread = np.linalg.inv(jacobian.T @ weight @ jacobian)
    estimate = spread @ jacobian.T @ weight @ y
    left = y - jacobian @ estimate
    square = left @ weight @ left / 11
    posterior = model.flat_posterior(y)
    beta = posterior.coefficients
    np.testing.assert_allclose(beta.mean, estimate)
    assert posterior.scale == pytest.approx(np.sqrt(square))
    np.testing.assert_allclose(beta.covariance, square * spread * 11 / 9)
    np.testing.assert_allclose(beta.sd**2, np.diag(beta.covariance))
    np.testing.assert_allclose(beta.interval(0.95), stats.t.interval(0.95, 11, estimate, np.sqrt(square * np.diag(spread))))
    value = estimate + rng.normal(size=3)
    expected = stats.multivariate_t(estimate, square * spread, 11).logpdf(value)
    assert beta.log_density(value) == pytest.approx(expected)
    # Under 1/σ the posterior is the likelihood times 1/σ up to a constant: differences between two points are exact.
    points = [(value, 0.5), (estimate, 1.3)]
    got = [posterior.log_density(*point) for point in points]
    wanted = [model.likelihood(*point).log_density(y) - np.log(point[1]) for point in points]
    assert got[0] - got[1] == pytest.approx(wanted[0] - wanted[1])


@pytest.mark.parametrize("relative", RELATIVE)
@pytest.mark.parametrize(("n", "p"), [(1, 1), (12, 3), (2, 5)])
def test_normal_gamma_evidence_is_student_t(n: int, p: int, relative: str) -> None:
    model, y, rng = regression(n, p, 4, relative=relative)
    prior = NormalGamma(rng.normal(size=p), root_of(p, rng), 1.7, 0.6)
    spread = model.jacobian @ prior.root
    scale = prior.rate / prior.shape * (full_noise(model) + spread @ spread.T)
    expected = stats.multivariate_t(model.jacobian @ prior.mean, scale, 2.0 * prior.shape).logpdf(y)
    assert model.normal_gamma_log_evidence(y, prior) == pytest.approx(expected)


@given(
    n=st.integers(1, 9),
    p=st.integers(1, 6),
    seed=st.integers(0, 10**6),
    relative=st.sampled_from(RELATIVE),
    shape=st.floats(0.05, 50.0),
    sigma=st.floats(0.1, 10.0),
)
def test_bayes_identity_of_the_normal_gamma_prior(n: int, p: int, seed: int, relative: str, shape: float, sigma: float) -> None:
    """ln p(β, σ | y) + ln p(y) = ln p(y | β, σ) + ln p(β, σ), the right side by SciPy."""
    model, y, rng = regression(n, p, seed, relative=relative)
    prior = NormalGamma(rng.normal(size=p), root_of(p, rng), shape, 0.8)
    beta = rng.normal(size=p)
    covariance = prior.root @ prior.root.T
    right = stats.multivariate_normal(model.jacobian @ beta, sigma**2 * full_noise(model)).logpdf(y)
    right += stats.multivariate_normal(prior.mean, sigma**2 * covariance).logpdf(beta) + log_density_of_scale(sigma, shape, 0.8)
    left = model.normal_gamma_posterior(y, prior).log_density(beta, sigma) + model.normal_gamma_log_evidence(y, prior)
    assert left == pytest.approx(right, rel=1e-8, abs=1e-7)
    assert model.likelihood(beta, sigma).log_density(y) + prior.log_density(beta, sigma) == pytest.approx(
        right, rel=1e-8, abs=1e-7
    )


@given(
    n=st.integers(1, 9),
    p=st.integers(1, 6),
    seed=st.integers(0, 10**6),
    relative=st.sampled_from(RELATIVE),
    shape=st.floats(0.05, 50.0),
)
def test_bayes_identity_of_the_normal_prior(n: int, p: int, seed: int, relative: str, shape: float) -> None:
    """With σ integrated out of both sides: ln p(β | y) + ln p(y) = ln p(y | β) + ln p(β), where y | β is Student-t."""
    model, y, rng = regression(n, p, seed, relative=relative)
    prior = Gaussian(rng.normal(size=p), root_of(p, rng))
    posterior = model.normal_posterior(y, prior, shape=shape, rate=0.8)
    beta = posterior.draw(1, rng)[0][0]
    likelihood = stats.multivariate_t(model.jacobian @ beta, 0.8 / shape * full_noise(model), 2.0 * shape)
    right = likelihood.logpdf(y) + prior.log_density(beta)
    assert posterior.log_density(beta) + posterior.log_evidence == pytest.approx(right, rel=1e-8, abs=1e-7)


def test_normal_prior_against_brute_force_in_two_dimensions() -> None:
    """One coefficient: every moment and quantile from the density on a grid of β and ln σ."""
    model, y, _ = regression(6, 1, 2)
    posterior = model.normal_posterior(y, Gaussian(np.array([0.3]), np.array([[0.6]])), shape=1.2, rate=0.5)
    beta, log_sigma = np.linspace(-3.5, 4.0, 3001), np.linspace(-3.5, 4.5, 1601)
    sigma = np.exp(log_sigma)[:, None]
    misfit = ((y[:, None] - model.jacobian * beta) ** 2).sum(axis=0)
    log_joint = -0.5 * misfit / sigma**2 - 6 * np.log(sigma) - 3.0 * np.log(2.0 * np.pi)
    log_joint = log_joint + stats.norm.logpdf(beta, 0.3, 0.6) + log_density_of_scale(sigma, 1.2, 0.5) + np.log(sigma)
    density = np.exp(log_joint).sum(axis=0) * (log_sigma[1] - log_sigma[0])
    total = density.sum() * (beta[1] - beta[0])
    density /= total
    mean = (density * beta).sum() * (beta[1] - beta[0])
    assert posterior.log_evidence == pytest.approx(np.log(total), abs=1e-9)
    assert posterior.mean[0] == pytest.approx(mean, abs=1e-9)
    assert posterior.sd[0] == pytest.approx(np.sqrt((density * (beta - mean) ** 2).sum() * (beta[1] - beta[0])), abs=1e-9)
    below = scipy.integrate.cumulative_simpson(density, x=beta, initial=0.0)
    np.testing.assert_allclose(posterior.interval(0.9)[:, 0], np.interp([0.05, 0.95], below, beta), atol=1e-5)
    assert posterior.log_density(beta[[1700]]) == pytest.approx(np.log(density[1700]), abs=1e-9)


@pytest.mark.parametrize("case", ["ordinary", "few readings", "collinear", "useless column", "conflict"])
def test_normal_prior_against_the_dense_model_at_every_scale(case: str) -> None:
    """ln p(y), mean and covariance from the model of known noise, averaged over a fine grid of ln σ."""
    n, p = (3, 6) if case == "few readings" else (15, 4)
    model, y, rng = regression(n, p, 6, relative="diagonal")
    jacobian, shape, rate = model.jacobian.copy(), 0.9, 0.4
    prior = Gaussian(rng.normal(size=p), root_of(p, rng))
    if case == "collinear":
        jacobian[:, 1] = jacobian[:, 0]
    if case == "useless column":
        jacobian[:, 1] = 0.0
    if case == "conflict":
        prior, shape, rate = Gaussian(np.full(p, 8.0), 0.02 * np.eye(p)), 30.0, 30.0 * 0.01**2
    model = ScaledLinearGaussian(jacobian, model.relative_noise)
    posterior = model.normal_posterior(y, prior, shape=shape, rate=rate)
    log_sigma = np.linspace(-7.0, 6.0, 1301)
    log_value, means, seconds = [], [], []
    for sigma in np.exp(log_sigma):
        given_sigma = LinearGaussian(jacobian, sigma**2 * model.relative_noise, prior.mean, prior.covariance)
        log_value.append(given_sigma.evidence.log_density(y) + log_density_of_scale(sigma, shape, rate) + np.log(sigma))
        conditional = given_sigma.posterior(y)
        means.append(conditional.mean)
        seconds.append(conditional.covariance + np.outer(conditional.mean, conditional.mean))
    top = np.max(log_value)
    weight = np.exp(np.array(log_value) - top)
    assert posterior.log_evidence == pytest.approx(top + np.log(weight.sum() * 0.01), abs=1e-8)
    assert len(posterior.sigma) < 200
    weight /= weight.sum()
    mean = weight @ np.array(means)
    covariance = np.tensordot(weight, np.array(seconds), 1) - np.outer(mean, mean)
    np.testing.assert_allclose(posterior.mean, mean, atol=1e-8)
    np.testing.assert_allclose(posterior.covariance, covariance, atol=1e-8)


def test_two_modes_of_the_scale_are_both_found() -> None:
    """A narrow prior far from readings that agree: either the noise is small and the prior gives way, or the noise is large."""
    n, separation = 60, 2.573
    y = 1.0 + 0.01 * stats.norm.ppf((np.arange(n) + 0.5) / n)
    log_sigma = np.linspace(-7.0, 4.0, 60001)
    variance, square = np.exp(2.0 * log_sigma), float(np.sum((y - y.mean()) ** 2))
    log_value = stats.norm.logpdf(separation, 0.0, np.sqrt(0.1**2 + variance / n)) - 0.5 * (n - 1) * np.log(2.0 * np.pi)
    log_value += -0.5 * square / variance - (n - 1) * log_sigma - 0.5 * np.log(n)
    log_value += log_density_of_scale(np.exp(log_sigma), 0.5, 1e-4) + log_sigma
    top = log_value.max()
    weight = np.exp(log_value - top)
    prior = Gaussian(np.array([y.mean() - separation]), np.array([[0.1]]))
    posterior = ScaledLinearGaussian(np.ones((n, 1))).normal_posterior(y, prior, shape=0.5, rate=1e-4)
    assert posterior.log_evidence == pytest.approx(top + np.log(weight.sum() * (log_sigma[1] - log_sigma[0])), abs=1e-8)
    small = weight[log_sigma < -2.0].sum() / weight.sum()
    assert 0.1 < small < 0.9
    assert posterior.weight[posterior.sigma < np.exp(-2.0)].sum() == pytest.approx(small, abs=1e-8)


def test_a_vast_normal_prior_gives_the_flat_posterior() -> None:
    model, y, _ = regression(12, 3, 9, relative="full")
    flat = model.flat_posterior(y)
    vast = Gaussian(np.zeros(3), 1e6 * np.eye(3))
    posterior = model.normal_posterior(y, vast, shape=1e-9, rate=1e-9)
    np.testing.assert_allclose(posterior.mean, flat.coefficients.mean, atol=1e-7)
    np.testing.assert_allclose(posterior.covariance, flat.coefficients.covariance, rtol=1e-6)
    np.testing.assert_allclose(posterior.interval(0.99), flat.coefficients.interval(0.99), atol=1e-6)
    value = flat.mean + 0.3
    assert posterior.log_density(value) == pytest.approx(flat.coefficients.log_density(value), abs=1e-6)


@pytest.mark.parametrize("name", ["Norris", "Longley", "Wampler4"])
def test_a_vast_normal_gamma_prior_centres_on_least_squares(name: str) -> None:
    jacobian, y = certified(name).arrays()
    model, p = ScaledLinearGaussian(jacobian), jacobian.shape[1]
    flat = model.flat_posterior(y)
    vast = NormalGamma(np.zeros(p), np.diag(1e8 * flat.coefficients.scale), 1e-9, 1e-9 * flat.rate)
    posterior = model.normal_gamma_posterior(y, vast)
    np.testing.assert_allclose(posterior.mean, flat.mean, atol=1e-6 * flat.coefficients.scale.min())
    np.testing.assert_allclose(
        posterior.root, flat.root, rtol=1e-6, atol=1e-6 * np.abs(flat.root).min(where=flat.root != 0, initial=1)
    )
    assert posterior.rate == pytest.approx(flat.rate, rel=1e-6)


def test_a_known_scale_gives_the_model_of_known_noise() -> None:
    """1/σ² ~ Gamma(10⁷, 10⁷ σ₀²) is σ₀ to 0.02 %; what differs is of order n / 10⁷."""
    model, y, rng = regression(10, 3, 12, relative="full")
    mean, root, sigma, shape = rng.normal(size=3), root_of(3, rng), 0.6, 1e7
    rate = shape * sigma**2
    noise = sigma**2 * full_noise(model)
    apart = LinearGaussian(model.jacobian, noise, mean, root @ root.T)
    mixture = model.normal_posterior(y, Gaussian(mean, root), shape=shape, rate=rate)
    np.testing.assert_allclose(mixture.mean, apart.posterior(y).mean, atol=1e-5)
    np.testing.assert_allclose(mixture.covariance, apart.posterior(y).covariance, atol=1e-5)
    assert mixture.log_evidence == pytest.approx(apart.evidence.log_density(y), abs=1e-4)
    tied = LinearGaussian(model.jacobian, noise, mean, sigma**2 * root @ root.T)
    conjugate = model.normal_gamma_posterior(y, NormalGamma(mean, root, shape, rate)).coefficients
    np.testing.assert_allclose(conjugate.mean, tied.posterior(y).mean, atol=1e-9)
    np.testing.assert_allclose(conjugate.covariance, tied.posterior(y).covariance, atol=1e-5)
    log_evidence = model.normal_gamma_log_evidence(y, NormalGamma(mean, root, shape, rate))
    assert log_evidence == pytest.approx(tied.evidence.log_density(y), abs=1e-4)


def test_draws_follow_their_distributions(rng: np.random.Generator) -> None:
    model, y, _ = regression(12, 2, 3)
    flat = model.flat_posterior(y)
    student, size = flat.coefficients, 20_000
    beta, sigma = flat.draw(size, rng)
    for sample in (student.draw(size, rng), beta):
        for j in range(2):
            assert stats.kstest(sample[:, j], stats.t(student.dof, student.mean[j], student.scale[j]).cdf).pvalue > 1e-4
    assert stats.kstest(sigma**-2.0, stats.gamma(flat.shape, scale=1.0 / flat.rate).cdf).pvalue > 1e-4
    assert (
        stats.kstest(beta[:, 0], stats.t(student.dof, student.mean[0] + 0.1 * student.scale[0], student.scale[0]).cdf).pvalue
        < 1e-6
    )
    mixture = model.normal_posterior(y, Gaussian(np.ones(2), np.eye(2)), shape=1.0, rate=0.2)
    beta, sigma = mixture.draw(size, rng)
    np.testing.assert_allclose(beta.mean(axis=0), mixture.mean, atol=5.0 * mixture.sd.max() / np.sqrt(size))
    np.testing.assert_allclose(np.cov(beta.T), mixture.covariance, atol=0.1 * mixture.sd.max() ** 2)
    assert np.mean((beta > mixture.interval(0.8)[0]) & (beta < mixture.interval(0.8)[1])) == pytest.approx(0.8, abs=0.02)
    assert np.log(sigma).mean() == pytest.approx(mixture.weight @ np.log(mixture.sigma), abs=0.02)


def test_few_degrees_of_freedom_have_no_sd() -> None:
    student = StudentT(np.zeros(2), np.eye(2), 2.0)
    assert np.all(np.isinf(student.sd))
    assert np.all(np.isfinite(student.interval(0.95)))
    with pytest.raises(InputError, match="dof must be > 2 for a covariance to exist, got 2"):
        _ = student.covariance


LINE = np.column_stack([np.ones(4), np.arange(4.0)])
UNIT = NormalGamma(np.zeros(2), np.eye(2), 1.0, 1.0)


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda: ScaledLinearGaussian(np.ones(3)), r"jacobian must be finite, of shape \(n, p\), n and p > 0, got shape \(3,\)"),
        (lambda: ScaledLinearGaussian(np.full((3, 1), np.nan)), "jacobian must be finite"),
        (lambda: ScaledLinearGaussian(LINE, np.ones(3)), r"relative_noise must have shape \(4,\) or \(4, 4\), got \(3,\)"),
        (lambda: ScaledLinearGaussian(LINE, -np.ones(4)).flat_posterior(np.ones(4)), "relative_noise must have positive"),
        (lambda: ScaledLinearGaussian(LINE).flat_posterior(np.ones(3)), r"y must be 4 finite values, got shape \(3,\)"),
        (lambda: ScaledLinearGaussian(LINE).flat_posterior(np.full(4, np.inf)), "y must be 4 finite values"),
        (
            lambda: ScaledLinearGaussian(LINE[:2]).flat_posterior(np.ones(2)),
            "y must have more than 2 values .* got 2. Add values",
        ),
        (lambda: ScaledLinearGaussian(LINE).flat_posterior(np.zeros(4)), "y must not be fitted exactly"),
        (
            lambda: ScaledLinearGaussian(LINE[:, [0, 0]]).flat_posterior(np.arange(4.0)),
            r"independent columns .* got column [01] ",
        ),
        (lambda: ScaledLinearGaussian(LINE * [1, 0]).flat_posterior(np.arange(4.0)), "independent columns .* got column 1 "),
        (
            lambda: ScaledLinearGaussian(LINE[:, :1]).normal_gamma_posterior(np.ones(4), UNIT),
            "prior must be of 1 coefficients, got 2",
        ),
        (lambda: NormalGamma(np.zeros(2), np.eye(3), 1.0, 1.0), r"root must be lower triangular, of shape \(2, 2\)"),
        (lambda: NormalGamma(np.zeros(2), np.ones((2, 2)), 1.0, 1.0), "root must be lower triangular"),
        (lambda: NormalGamma(np.zeros(2), np.eye(2), 0.0, 1.0), "shape must be above 0 and below inf, got 0.0"),
        (lambda: NormalGamma(np.zeros(2), np.eye(2), 1.0, np.nan), "rate must be above 0 and below inf, got nan"),
        (
            lambda: ScaledLinearGaussian(LINE).normal_posterior(
                np.ones(4), Gaussian(np.zeros(2), np.eye(2)), shape=1.0, rate=-1.0
            ),
            "rate must be above 0",
        ),
        (lambda: UNIT.coefficients.interval(95), "prob must be above 0 and below 1, got 95. Give 0.95 for 95 %"),
    ],
)
def test_refused(act: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        act()


@pytest.mark.parametrize("gap", [1e-3, 1e-8])
def test_nearly_collinear_columns_are_solved(gap: float) -> None:
    base = np.linspace(1.0, 2.0, 20)
    jacobian = np.column_stack([base, base * (1.0 + gap * np.cos(5.0 * base))])
    y = jacobian @ np.array([1.0, 2.0]) + 1e-12 * np.sin(40.0 * base)
    estimate = ScaledLinearGaussian(jacobian).flat_posterior(y).coefficients.mean
    np.testing.assert_allclose(estimate, [1.0, 2.0], atol=1e-9 / gap * 1e-2)
