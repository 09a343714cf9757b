"""Least squares with an uncertainty budget after the GUM.

    θ̂ = J⁺ y,   u² = type A (scatter of the residuals) + type B (the budget), both propagated

J is the hybrid Jacobian (Eq. 33).
"""

from __future__ import annotations

import numpy as np
from readings import (
    LEVELS,
    MODEL,
    READINGS_OF_A_CIRCLE,
    Answer,
    CirclePrediction,
    readings_of,
)
from scipy.stats import norm

import ldbb_bayes as lb

__all__ = ["by_least_squares"]


def by_least_squares(
    campaign: lb.Campaign, left_out: lb.CircularTest | None = None, *, full: bool
) -> Answer:
    """Fit all readings by least squares; predict the circle that was left out, if any."""
    prior_sd = MODEL.bind(campaign).prior_sd
    fitted = readings_of(campaign, campaign.tests, prior_sd)
    inverse = np.linalg.pinv(fitted.jacobian, rcond=1e-12)
    theta = inverse @ fitted.reading_um
    residual_um = fitted.reading_um - fitted.jacobian @ theta
    noise_variance = float(np.sum(residual_um**2)) / (len(residual_um) - len(theta))

    budget = fitted.budget(campaign, theta, full=full)
    by_test = fitted.separated_by_test(budget.by_circle)
    propagated = inverse @ np.column_stack([budget.shared, by_test])
    type_a_variance = noise_variance * (inverse**2).sum(axis=1)
    u = np.sqrt(type_a_variance + (propagated**2).sum(axis=1))
    interval = (theta + norm.ppf(LEVELS)[:, None] * u) * prior_sd
    if left_out is None:
        return Answer(interval, None)

    new = readings_of(campaign, (left_out,), prior_sd, READINGS_OF_A_CIRCLE)
    new_budget = new.budget(campaign, theta, full=full)
    # An error that all circles share acts on the fit and on the new circle: only its remainder
    # counts. Errors of the fitted circles act on the fit alone.
    on_new_circle = np.column_stack(
        [new_budget.shared, np.zeros((len(new.angle_rad), by_test.shape[1]))]
    )
    remainder = new.jacobian @ propagated - on_new_circle
    variance = noise_variance * (1.0 + ((new.jacobian @ inverse) ** 2).sum(axis=1))
    variance = variance + (remainder**2).sum(axis=1) + (new_budget.by_circle**2).sum(axis=1)
    mean_um = new.jacobian @ theta
    sd_um = np.sqrt(variance)
    band_um = mean_um + norm.ppf(LEVELS)[:, None] * sd_um
    log_density = norm.logpdf(new.reading_um, mean_um, sd_um)
    return Answer(interval, CirclePrediction(band_um, log_density))
