"""Estimates of compliances from planned tests, by which an analysis sizes the priors of its slopes.

The prior standard deviation of a slope (change of a compliance with force) is proportional to the
magnitude of its compliance. An analysis takes this magnitude from an estimate m of the parameters β
that it computes first, with the hyper-parameters at the medians of their priors. The readings are
y = X β + e, with the prior β ~ N(m₀, Λ). If V is the covariance of the readings at these medians,
the estimate is m = m₀ + Λ Xᵀ V⁻¹ (y − X m₀).

The hyper-parameters of the machine are not these medians. The errors e of its readings have another
covariance, Σ_c s_c x_c x_cᵀ + σ² 1, where x_c are the changes of the readings per unit of effect c,
s_c is the variance of the effect on this machine, and σ² the variance of the white noise. With B =
V⁻¹ X Λ, the estimate therefore has the mean m₀ + Bᵀ X (β − m₀) and the covariance
Σ_c s_c (Bᵀ x_c) (Bᵀ x_c)ᵀ + σ² Bᵀ B.
"""

from __future__ import annotations

import numpy as np

from ldbb_bayes.analysis.design.planned_effects import effects_at, inverse_covariance
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = ["draw_reference_estimates", "prior_medians"]


def prior_medians(bound: BoundModel) -> Array:
    """Return the medians of the h hyper-parameters under their priors, shape (1, h).

    A hyper-parameter is, for example, the standard deviation of the noise. Lengths are in mm.
    """
    return np.asarray(bound.hyper_prior.quantile(np.full((1, len(bound.hyper_prior.names)), 0.5)))


def draw_reference_estimates(bound: BoundModel, phi: Array, beta: Array, seed: int) -> Array:
    """Draw the estimates that an analysis of planned tests finds on K possible machines.

    Parameters
    ----------
    bound
        Model applied to the planned tests. No test has been run yet.
    phi
        Hyper-parameters of the machines (such as the standard deviation of the noise), shape (K,
        h); lengths in mm.
    beta
        Parameters of the machines, shape (K, p), in internal units (mm, N, rad).
    seed
        Seed of the random numbers.

    Returns
    -------
    Array
        Estimates of the parameters as if compliances could be negative, shape (K, p), in internal
        units.
    """
    reference = effects_at(bound, prior_medians(bound))
    of_machines = effects_at(bound, phi)
    precision = inverse_covariance(
        reference.blocks, reference.variances[0], float(reference.noise_variance[0])
    )
    # The first columns of the first block belong to the p parameters, the other columns of all
    # blocks to the nuisance effects. The estimates are computed in units of the prior sds.
    p = len(bound.names)
    columns = reference.blocks[0].columns[:, :p] * bound.scale
    weights = precision @ columns
    of_blocks = [block.columns.T @ weights[block.readings] for block in reference.blocks]
    of_effects = np.concatenate(of_blocks)[p:]
    rng = np.random.default_rng(seed)
    machines = len(phi)
    standard = rng.standard_normal((machines, len(of_effects)))
    from_effects = (standard * np.sqrt(of_machines.variances[:, p:])) @ of_effects
    white_noise = rng.standard_normal((machines, len(weights)))
    from_noise = np.sqrt(of_machines.noise_variance)[:, None] * (white_noise @ weights)
    deviation = (beta - bound.prior_mean) / bound.scale
    estimate = deviation @ columns.T @ weights + from_effects + from_noise
    return np.asarray(bound.prior_mean + bound.scale * estimate)
