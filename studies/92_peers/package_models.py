"""The package's answers: its default model, and the average over models."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
from mixtures import Normals, mixture_prediction
from readings import LEVELS, MODEL, Answer, Array, evenly_picked, picked_readings_um

import ldbb_bayes as lb
from ldbb_bayes.inference.circle_spread import draw_new_noise_factors
from ldbb_bayes.inference.coefficients import (
    draw_shared,
    machine_coefficients,
    private_terms,
    shared_columns,
)
from ldbb_bayes.inference.evidence import probabilities
from ldbb_bayes.inference.evidences import Evidences
from ldbb_bayes.inference.nodes import Nodes
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel

__all__ = ["by_average_of_models", "by_default_model"]

# Independent draws over all models.
DRAWS = 4000
UM_PER_MM = 1e3


def by_default_model(
    campaign: lb.Campaign, left_out: lb.CircularTest | None = None, *, seed: int
) -> Answer:
    """Answer with the default model, linear in force."""
    return _averaged_over((MODEL,), campaign, left_out, seed)


def by_average_of_models(
    campaign: lb.Campaign, left_out: lb.CircularTest | None = None, *, seed: int
) -> Answer:
    """Average over constant and linear compliance, with and without each rival of slopes, as
    `lb.average` does."""
    models = []
    for model in (MODEL.with_degree(0), MODEL):
        for selection in itertools.product((True, False), repeat=len(model.rivals)):
            rivals = itertools.compress(model.rivals, selection)
            models.append(model.with_rivals(*rivals))
    return _averaged_over(tuple(models), campaign, left_out, seed)


def _averaged_over(
    models: tuple[lb.HybridModel, ...],
    campaign: lb.Campaign,
    left_out: lb.CircularTest | None,
    seed: int,
) -> Answer:
    """Answer with independent draws of each model, as many as its posterior probability says."""
    posteriors = Evidences(campaign).nodes(*models)
    log_evidences = np.array([nodes.evidence.log_value for nodes in posteriors])
    rng = np.random.default_rng(seed)
    counts = rng.multinomial(DRAWS, probabilities(log_evidences))
    names = MODEL.bind(campaign).names
    draws = []
    means_um = []
    sds_um = []
    for nodes, count in zip(posteriors, counts.tolist(), strict=True):
        if count == 0:
            continue
        beta, phi = nodes.draw(count, rng)
        # A parameter that this model does not have is zero.
        in_all_names = np.zeros((count, len(names)))
        in_all_names[:, [names.index(name) for name in nodes.bound.names]] = beta
        draws.append(in_all_names)
        if left_out is not None:
            component = _new_circle(nodes, campaign, left_out, beta, phi, rng)
            means_um.append(component.mean_um)
            sds_um.append(component.sd_um)
    interval = np.quantile(np.concatenate(draws), LEVELS, axis=0)
    if left_out is None:
        return Answer(interval, None)
    components = Normals(np.concatenate(means_um), np.concatenate(sds_um))
    reading_um = picked_readings_um(left_out)
    return Answer(interval, mixture_prediction(components, reading_um, 1, rng))


def _new_circle(
    nodes: Nodes,
    campaign: lb.Campaign,
    left_out: lb.CircularTest,
    beta: Array,
    phi: Array,
    rng: np.random.Generator,
) -> Normals:
    """Mean and sd of every picked reading of the new circle, each (draws, n) [µm].

    They are conditional on β, φ and draws of the nuisances that circles share.
    """
    with_new_circle = replace(campaign, tests=(*campaign.tests, left_out))
    bound = BoundModel(nodes.bound.model, with_new_circle, pilot=campaign)
    scales = _scales_with_new_circle(nodes.bound, bound, phi, rng)
    angle_rad = np.deg2rad(left_out.angle_deg[evenly_picked(left_out)])
    waves_um = basis(angle_rad) * UM_PER_MM
    shared = draw_shared(nodes.bound, phi, beta, rng)
    coefficients = machine_coefficients(bound, beta)[:, -1] + shared @ shared_columns(bound)[-1].T
    mean_um = coefficients @ waves_um.T
    sigma = scales[:, [bound.hyper_prior.names.index("sigma")]]
    variance = (sigma * UM_PER_MM) ** 2
    for columns, sd in private_terms(bound, scales, len(campaign.tests)):
        variance = variance + sd**2 @ ((waves_um @ columns) ** 2).T
    return Normals(mean_um, np.sqrt(variance))


def _scales_with_new_circle(
    fitted: BoundModel, bound: BoundModel, phi: Array, rng: np.random.Generator
) -> Array:
    """Draws φ of the fitted circles, and of the new circle's noise, shape (draws, scales).

    What only the new circle has comes from its prior; its noise factor is as those of the other
    circles, where circles have one each.
    """
    fitted_names = fitted.hyper_prior.names
    hyper_prior = bound.hyper_prior
    scales = hyper_prior.quantile(rng.random((len(phi), len(hyper_prior.names))))
    scales[:, [hyper_prior.names.index(name) for name in fitted_names]] = phi
    circle_names = [str(name) for name in fitted.setting.circle if name in fitted_names]
    factors = [fitted_names.index(name) for name in circle_names]
    if factors:
        new_factor = hyper_prior.names.index(str(bound.setting.circle[-1]))
        scales[:, new_factor] = draw_new_noise_factors(phi[:, factors], rng)
    return np.asarray(scales)
