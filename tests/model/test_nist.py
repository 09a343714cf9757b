"""The Gaussian kernel on regressions with an unknown noise scale: NIST's certified values
(tests/nist), and Radiata pine.

1/σ² ~ Gamma(a, b) on top of the kernel is a few lines: they stand here.
"""

from __future__ import annotations

import csv
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from scipy.special import gammaln

from ldbb_bayes.model.gaussian import Gaussian

FOLDER = Path(__file__).resolve().parents[1] / "nist"
DIGITS: dict[str, list[int]] = tomllib.loads((FOLDER / "digits.toml").read_text(encoding="utf-8"))


@dataclass(frozen=True)
class Certified:
    """One dataset as printed: powers of x in the model, data and certified values.

    Longley's data have no powers but columns of their own.
    """

    powers: tuple[int, ...]
    rows: tuple[tuple[str, ...], ...]
    estimate: tuple[str, ...]
    sd: tuple[str, ...]
    residual: str

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """J and y."""
        y, *columns = np.array(self.rows, dtype=float).T
        if len(columns) > 1:  # Longley's own columns
            return np.stack([np.ones(len(y)), *columns], axis=1), y
        powers = [columns[0] ** power for power in self.powers]
        return np.stack(powers, axis=1), y


@cache
def certified(name: str) -> Certified:
    with (FOLDER / "certified.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["dataset"] == name]
    with (FOLDER / f"{name.lower()}.csv").open(encoding="utf-8") as file:
        data = tuple(map(tuple, csv.reader(file)))[1:]
    parameters = rows[:-1]
    last = rows[-1]
    assert last["parameter"] == "residual"
    return Certified(
        tuple(int(row["parameter"][1:]) for row in parameters),
        data,
        tuple(row["estimate"] for row in parameters),
        tuple(row["sd"] for row in parameters),
        last["sd"],
    )


class Fit(NamedTuple):
    """Estimate, its standard deviations, and the residual standard deviation."""

    estimate: np.ndarray
    sd: np.ndarray
    residual_sd: float


def regression(jacobian: np.ndarray, y: np.ndarray) -> Fit:
    """Fit under p(β, σ) ∝ 1/σ."""
    likelihood = Gaussian.from_rows(jacobian, y)
    residual = y - jacobian @ likelihood.mean
    residual_sd = float(np.sqrt(residual @ residual / (len(y) - jacobian.shape[1])))
    return Fit(likelihood.mean, likelihood.sd * residual_sd, residual_sd)


def digits(values: np.ndarray, printed: tuple[str, ...]) -> float:
    """Least log relative error; of the absolute error where 0 is certified."""
    truth = np.array(printed, dtype=float)
    error = np.abs(np.asarray(values) - truth) / np.where(truth == 0.0, 1.0, np.abs(truth))
    return float(-np.log10(max(error.max(), 1e-15)))


def test_normal_equations_miss_filip() -> None:
    """The thresholds can fail: a usual way has no digit of Filip right."""
    data = certified("Filip")
    jacobian, y = data.arrays()
    estimate = np.linalg.solve(jacobian.T @ jacobian, jacobian.T @ y)
    assert digits(estimate, data.estimate) < 1.0


@pytest.mark.parametrize("name", DIGITS)
def test_certified_digits(name: str) -> None:
    data = certified(name)
    fit = regression(*data.arrays())
    attained = np.array(
        [
            digits(fit.estimate, data.estimate),
            digits(fit.sd, data.sd),
            digits(np.array([fit.residual_sd]), (data.residual,)),
        ]
    )
    assert np.all(attained >= DIGITS[name]), f"{name}: {np.round(attained, 1)} digits"


def test_a_wide_prior_loses_no_digits() -> None:
    """Prior to posterior by the same factorisation: with a prior 10¹² wider than Pontius' estimates
    their digits stay."""
    data = certified("Pontius")
    jacobian, y = data.arrays()
    fit = regression(jacobian, y)
    wide = Gaussian.of(np.zeros(3), (1e12 * np.abs(fit.estimate)) ** 2)
    posterior = wide.observe(jacobian / fit.residual_sd, y / fit.residual_sd)
    assert digits(posterior.mean, data.estimate) >= 10
    np.testing.assert_allclose(posterior.sd, fit.sd, rtol=1e-9)


PINE = pd.read_csv(FOLDER.parent / "pine" / "pine.csv")
STRENGTH = PINE["strength"].to_numpy(dtype=float)
# Prior of intercept and slope: N(MEAN, 1 / (τ PRECISION)), τ ~ Gamma(SHAPE, RATE).
MEAN = np.array([3000.0, 185.0])
PRECISION = np.array([0.06, 6.0])
SHAPE = 3.0
RATE = 180_000.0
PUBLISHED = {"density": -310.12828553675, "adjusted_density": -301.70460213437}


def centred_line(predictor: str) -> np.ndarray:
    """A straight line in one predictor, about its mean."""
    x = PINE[predictor].to_numpy()
    return np.column_stack([np.ones(len(x)), x - x.mean()])


@pytest.mark.parametrize(("predictor", "published"), PUBLISHED.items())
def test_evidences_of_radiata_pine_on_a_grid(predictor: str, published: float) -> None:
    """ln ∫ p(y | τ) Gamma(τ; 3, rate 180 000) dτ on a grid of ln τ, all of it one stack."""
    jacobian = centred_line(predictor)
    log_tau = np.linspace(-14.0, -8.0, 1201)
    root = np.exp(0.5 * log_tau)[:, None]
    prior = Gaussian.of(np.tile(MEAN, (1201, 1)), 1.0 / (PRECISION * root**2))
    posterior = prior.observe(jacobian * root[..., None], STRENGTH * root)
    log_likelihood = posterior.log_integral + len(jacobian) * np.log(root[:, 0])
    log_prior = stats.gamma(SHAPE, scale=1.0 / RATE).logpdf(np.exp(log_tau))
    values = log_likelihood + log_prior + log_tau
    log_evidence = np.logaddexp.reduce(values) + np.log(log_tau[1] - log_tau[0])
    assert log_evidence == pytest.approx(published, abs=1e-9)


@pytest.mark.parametrize(("predictor", "published"), PUBLISHED.items())
def test_evidences_of_radiata_pine_in_closed_form(predictor: str, published: float) -> None:
    """At σ = 1 the log evidence is a constant less half the squares that Gamma's rate gains."""
    jacobian = centred_line(predictor)
    posterior = Gaussian.of(MEAN, 1.0 / PRECISION).observe(jacobian, STRENGTH)
    residual = STRENGTH - jacobian @ posterior.mean
    squares = residual @ residual + PRECISION @ (posterior.mean - MEAN) ** 2
    shape = SHAPE + 0.5 * len(jacobian)
    rate = RATE + 0.5 * squares
    gamma_ratio = gammaln(shape) - gammaln(SHAPE) + SHAPE * np.log(RATE) - shape * np.log(rate)
    log_evidence = posterior.log_integral + 0.5 * squares + gamma_ratio
    assert log_evidence == pytest.approx(published, abs=1e-8)
