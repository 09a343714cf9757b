"""Marginals of the posterior by quadrature over the hyper-parameters.

The hyper-parameters are quantities such as the standard deviation of the noise. Parameters are
compliances, their changes with force, and geometric errors.
"""

from __future__ import annotations

import warnings

import numpy as np
import pandas as pd

from ldbb_bayes.campaign.campaign import Campaign, require_campaign
from ldbb_bayes.deprecation import renamed_keyword
from ldbb_bayes.errors import check_probability, check_seed, require
from ldbb_bayes.inference.evidence import warn_of_untrusted_weights
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.independent_sampler import TooRoughError, draw_jointly
from ldbb_bayes.inference.nodes import compute_nodes
from ldbb_bayes.model.hybrid import HybridModel, require_model
from ldbb_bayes.model.mixtures import mixture_moments
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, readable

__all__ = ["marginalize"]

# Number of posterior draws from which quantiles of the hyper-parameters (such as the standard
# deviation of the noise) are computed.
_DRAWS = 16_384


@one_blas_thread
@renamed_keyword("ci_prob", "prob")
def marginalize(
    model: HybridModel,
    campaign: Campaign,
    *,
    prob: float = 0.95,
    tolerance: float = 1e-3,
    seed: int = 1,
) -> pd.DataFrame:
    """Return the posterior mean, sd and quantiles of every parameter, computed by quadrature.

    The integral over the hyper-parameters (such as the standard deviation of the noise) is a sum
    over weighted nodes. No Markov chain is needed, because the parameters are Gaussian given the
    hyper-parameters, apart from the condition that compliances must not be negative (truncation).
    Quantiles are computed from random draws.

    Parameters
    ----------
    model : HybridModel
        Model with its nuisances (effects that are modelled but not of interest) and priors.
    campaign : Campaign
        Campaign with readings.
    prob : float
        Probability of the equal-tailed credible interval, between 0 and 1.
    tolerance : float
        Relative error, between 0 and 1, that is allowed in the integrals from which means and
        standard deviations are computed.
    seed : int
        Seed of the random points from which quantiles are computed. The standard error of a
        computed quantile corresponds to an error of at most 0.6 % in its probability.

    Returns
    -------
    DataFrame
        Table with the columns unit, mean, sd, median, ci_low and ci_high, and one row for each
        parameter and hyper-parameter, in mm, N and rad.

    Raises
    ------
    InputError
        For a plan (a campaign without readings), a probability or tolerance out of range, or a
        model that cannot be fitted to the campaign.

    Warns
    -----
    RuntimeWarning
        If the weights of the nodes (weighted values of the hyper-parameters), or of the draws from
        which quantiles are computed, cannot be trusted.

    Examples
    --------
    >>> table = lb.inference.marginalize(lb.HybridModel.first(0), campaign, tolerance=0.1)
    >>> interval = table.loc["C_YYY", ["ci_low", "ci_high"]]
    >>> [round(limit * 1e6) for limit in interval]  # nm/N
    [38, 47]
    """
    require_model(model)
    require_campaign(campaign)
    check_seed(seed)
    require(
        not campaign.is_plan,
        "marginals must be asked of a campaign with readings, got a plan. Run the tests or"
        " simulate.",
    )
    check_probability(prob)
    require(
        0.0 < tolerance < 1.0,
        f"tolerance must lie between 0 and 1, got {tolerance}. For example 1e-3.",
    )
    bound = model.bind(campaign)
    posterior = HyperPosterior(bound, truncated=bound.truncation.active, seed=seed)
    nodes = compute_nodes(posterior, tolerance)
    warn_of_untrusted_weights(nodes)
    levels = np.array([0.5, 0.5 - 0.5 * prob, 0.5 + 0.5 * prob])
    phi = bound.hyper_prior.phi(nodes.integral.free)
    phi_mean, phi_sd = mixture_moments(nodes.integral.weight, phi, 0.0 * phi)
    phi_draws = bound.hyper_prior.phi(_draw_free(posterior, seed))
    of_phi = [phi_mean, phi_sd, *np.quantile(phi_draws, levels, axis=0)]
    of_beta = [*nodes.moments(), *nodes.quantiles(levels, seed=seed)]
    names = [*bound.names, *bound.hyper_prior.names]
    table = pd.DataFrame(
        np.hstack([of_beta, of_phi]).T, names, ["mean", "sd", "median", "ci_low", "ci_high"]
    )
    units = [parameter.unit for parameter in bound.parameters]
    table.insert(0, "unit", [*units, *bound.hyper_prior.units])
    return readable(table, f"Marginals by quadrature, {100 * prob:g} % intervals")


def _draw_free(posterior: HyperPosterior, seed: int) -> Array:
    """Return posterior draws of the h hyper-parameters in unbounded coordinates, shape (draws, h).

    Hyper-parameters are quantities such as the standard deviation of the noise; the coordinates are
    mostly ln(value − lower bound). The draws are independent draws from rejection sampling if
    possible. If its importance weights cannot be trusted, or if hardly any draw is accepted, a
    warning is given; the draws are then resampled from weighted points. ``seed`` is the seed of the
    random numbers.
    """
    try:
        return draw_jointly(posterior, _DRAWS, np.random.default_rng(seed)).free
    except TooRoughError as error:
        warnings.warn(
            "quantiles of the hyper-parameters must come from independent draws, got weights that"
            f" cannot be trusted ({error}). Sample the posterior with sampler='joint', which needs"
            " no weights.",
            RuntimeWarning,
            stacklevel=4,
        )
    return posterior.weighted_sample_truncated.resample(_DRAWS, np.random.default_rng(seed))
