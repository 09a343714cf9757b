"""Radiata pine, a benchmark for Bayes factors: published log evidences, by the dense Gaussian model and in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from ldbb_bayes.model.gaussian import LinearGaussian
from ldbb_bayes.model.normal_gamma import NormalGamma
from ldbb_bayes.model.regression import ScaledLinearGaussian

PINE = pd.read_csv(Path(__file__).parents[1] / "pine" / "pine.csv")
STRENGTH = PINE["strength"].to_numpy(dtype=float)
MEAN, PRECISION = np.array([3000.0, 185.0]), np.array([0.06, 6.0])
SHAPE, RATE = 3.0, 180_000.0
PUBLISHED = {"density": -310.12828553675, "adjusted_density": -301.70460213437}


def design(predictor: str) -> np.ndarray:
    x = PINE[predictor].to_numpy()
    return np.column_stack([np.ones(len(x)), x - x.mean()])


@pytest.mark.parametrize(("predictor", "published"), PUBLISHED.items())
def test_by_the_gaussian_model_at_every_precision(predictor: str, published: float) -> None:
    """ln ∫ p(y | τ) Gamma(τ; 3, rate 180 000) dτ, p(y | τ) the evidence of the linear Gaussian model, on a fine grid of ln τ."""
    log_tau = np.linspace(-14.0, -8.0, 1201)
    values = []
    for tau in np.exp(log_tau):
        model = LinearGaussian(design(predictor), np.full(42, 1.0 / tau), MEAN, 1.0 / (PRECISION * tau))
        values.append(model.evidence.log_density(STRENGTH) + stats.gamma(SHAPE, scale=1.0 / RATE).logpdf(tau) + np.log(tau))
    found = np.logaddexp.reduce(values) + np.log(log_tau[1] - log_tau[0])
    assert found == pytest.approx(published, abs=1e-9)


@pytest.mark.parametrize(("predictor", "published"), PUBLISHED.items())
def test_in_closed_form(predictor: str, published: float) -> None:
    prior = NormalGamma(MEAN, np.diag(PRECISION**-0.5), SHAPE, RATE)
    found = ScaledLinearGaussian(design(predictor)).normal_gamma_log_evidence(STRENGTH, prior)
    assert found == pytest.approx(published, abs=1e-9)
