"""Predictions that are mixtures of normal distributions, one component per draw of the scales."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from readings import LEVELS, Array, CirclePrediction
from scipy.special import logsumexp
from scipy.stats import norm

__all__ = ["Normals", "mixture_prediction"]


class Normals(NamedTuple):
    """Normal distributions of the readings: ``mean_um`` and ``sd_um``, each (draws, n) or (n,)."""

    mean_um: Array
    sd_um: Array


def mixture_prediction(
    components: Normals, reading_um: Array, repetitions: int, rng: np.random.Generator
) -> CirclePrediction:
    """Return band and log density of a mixture of equal weights, components of shape (draws, n).

    The band is that of ``repetitions`` draws of every component.
    """
    mean_um, sd_um = components
    draws_um = []
    for _ in range(repetitions):
        draws_um.append(mean_um + sd_um * rng.standard_normal(mean_um.shape))
    band_um = np.quantile(np.concatenate(draws_um), LEVELS, axis=0)
    log_sum = logsumexp(norm.logpdf(reading_um, mean_um, sd_um), axis=0)
    return CirclePrediction(band_um, log_sum - np.log(len(mean_um)))
