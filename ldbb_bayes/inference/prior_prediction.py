"""Simulated readings of circles: random draws from the prior predictive distribution of a model.

Parameters are compliances, their changes with force, and geometric errors; hyper-parameters are
quantities such as the standard deviation of the noise; nuisances are effects that are modelled but
not of interest.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ldbb_bayes.inference.coefficients import (
    draw_from_prior,
    draw_of_circle,
    machine_coefficients,
    shared_terms,
)
from ldbb_bayes.inference.prediction import readings_drawn
from ldbb_bayes.inference.record import prior_draws_of
from ldbb_bayes.inference.residuals import tests_in_order
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = ["prior_circles"]


def prior_circles(bound: BoundModel, size: int, rng: np.random.Generator) -> Iterator[Array]:
    """Yield random readings that the prior predicts for each test in turn [mm], shape (size, n).

    Nuisances are effects that are modelled but not of interest. A test has n readings. Each of
    ``size`` draws from the prior of parameters, hyper-parameters and nuisances gives one circle,
    with white noise. If the model excludes negative compliances, the draws contain none. The
    measured readings are used only to estimate the compliances, because some prior standard
    deviations are proportional to these estimates. ``bound`` is the model of the campaign; its
    prior must not be flat.
    """
    beta, phi = prior_draws_of(bound, size, rng)
    value = dict(zip(bound.hyper_prior.names, phi.T, strict=True))
    total = machine_coefficients(bound, beta)
    for term in shared_terms(bound.nuisance_columns):
        nuisances = draw_from_prior(term, value, size, rng)
        total = total + np.einsum("tkq,wq->wtk", term.values, nuisances)
    for r, test in enumerate(tests_in_order(bound)):
        circle = total[:, r] + draw_of_circle(bound, phi, r, rng)
        yield readings_drawn(circle, value["sigma"], test.angles_rad(), rng)
