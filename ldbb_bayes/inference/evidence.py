"""Log evidence of a model by quadrature over the hyper-parameters, and Bayes factors.

The evidence is the density of the readings y under the model. The hyper-parameters are quantities
such as the standard deviation of the noise. The readings depend linearly on all other unknowns,
which are integrated out exactly. Truncation T restricts compliances to values that are not
negative.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign, require_campaign
from ldbb_bayes.errors import require
from ldbb_bayes.inference.evidence_value import Evidence
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.integrals import LARGEST_PARETO_K
from ldbb_bayes.inference.nodes import Nodes, compute_nodes
from ldbb_bayes.inference.truncation_factor import ProbabilityInside
from ldbb_bayes.model.hybrid import HybridModel, require_model
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array

__all__ = [
    "check_comparable",
    "log_bayes_factor",
    "log_evidence",
    "log_prob_truncation",
    "probabilities",
    "require_models",
    "warn_of_untrusted_weights",
]

# A log probability cannot exceed zero. If the computed log probability that no compliance is
# negative exceeds its error by more than this value [nat], rounding errors must be large, and the
# value is refused.
_LARGEST_LOG_PROBABILITY = 0.1

# Error allowed in the log probability that no compliance is negative, or in the logarithm of each
# of the two integrals of which it is the ratio [nat].
_PROBABILITY_TOLERANCE = 0.02
# The probability that no compliance is negative is first computed as a mean over a sample of values
# of the hyper-parameters. This mean is used only if its logarithm is above this limit. Values
# outside the sample can then hardly change the mean, because the probability at each value is at
# most one.
_LEAST_COARSE_LOG_PROBABILITY = -2.0


@one_blas_thread
def log_evidence(model: HybridModel, campaign: Campaign, *, tolerance: float = 1e-3) -> Evidence:
    """Return the log evidence of a model, with its error.

    The evidence is Z = ∫ p(y | β, φ) p(β) p(φ) dβ dφ. It is the density of the readings y (in mm),
    averaged over the priors of the model's parameters β and hyper-parameters φ. If the model
    requires that no compliance is negative (truncation), this condition is part of the prior p(β).
    Only differences of ln Z between models of the same readings have a meaning; see
    `log_bayes_factor`.

    Parameters
    ----------
    model : HybridModel
        Model with a proper prior.
    campaign : Campaign
        Campaign with readings.
    tolerance : float
        Error allowed in the log evidence [nat]; the error reached is ``error`` of the result.

    Returns
    -------
    Evidence
        Log evidence ``log_value`` and its ``error`` [nat], with the number of nodes of the
        quadrature and the digest of the readings. The error is infinite if the weights of the
        nodes cannot be trusted.

    Raises
    ------
    InputError
        For a flat prior, under which the evidence is undefined, for a plan (a campaign without
        readings), for a tolerance that is not positive, or for a model that cannot be fitted to the
        campaign.

    Warns
    -----
    RuntimeWarning
        If the weights of the nodes (weighted values of the hyper-parameters) cannot be trusted.

    Examples
    --------
    >>> constant = lb.log_evidence(lb.HybridModel.first(0), campaign, tolerance=0.1)
    >>> linear = lb.log_evidence(lb.HybridModel.first(1), campaign, tolerance=0.1)
    >>> round(linear.log_value - constant.log_value)  # compliance is constant rather than linear
    -6
    >>> bool(linear.error < 0.1)
    True
    """
    check_comparable(model, campaign)
    require(
        tolerance > 0,
        f"tolerance must be a positive number of nats, got {tolerance}. For example 1e-3.",
    )
    bound = model.bind(campaign)
    nodes = compute_nodes(HyperPosterior(bound, truncated=bound.truncation.active), tolerance)
    warn_of_untrusted_weights(nodes)
    return nodes.evidence


def warn_of_untrusted_weights(nodes: Nodes) -> None:
    """Warn if the weights of the quadrature nodes cannot be trusted.

    Nodes are weighted values of the hyper-parameters (such as the standard deviation of the noise).
    The weights cannot be trusted if their Pareto shape k̂ is above 0.6. The warning names the
    sampler that needs no weights.
    """
    if not nodes.integral.trusted:
        warnings.warn(
            "weights of the nodes over the hyper-parameters must have a Pareto k of at most"
            f" {LARGEST_PARETO_K}, got {nodes.integral.pareto_k:.2f}: neither the evidence nor"
            " marginals by quadrature can be trusted. Sample the posterior with sampler='joint',"
            " which needs no weights.",
            RuntimeWarning,
            stacklevel=3,
        )


def require_models(models: Mapping[str, HybridModel]) -> None:
    """Raise an `InputError` unless ``models`` is a mapping that names at least one model."""
    are_models = isinstance(models, Mapping) and all(
        isinstance(model, HybridModel) for model in models.values()
    )
    require(
        are_models,
        f"models must be HybridModels by name, not yet fitted, got {type(models).__name__}. Give"
        ' for example {"constant": model.with_degree(0), "linear": model}.',
    )
    require(
        len(models) > 0,
        "models must be given, got none. Give for example constant and linear compliance.",
    )


def check_comparable(model: HybridModel, campaign: Campaign) -> None:
    """Raise an `InputError` if the evidence of a model for a campaign's readings is undefined.

    The evidence is undefined if the prior of the model is flat, or if the campaign is a plan (a
    campaign without readings). An error is also raised if all readings are zero.
    """
    require_model(model)
    require(
        not model.prior.flat,
        "a model must have a proper prior to have an evidence, got a flat one. Use the default"
        " preset.",
    )
    require_campaign(campaign)
    require(
        not campaign.is_plan,
        "a campaign must have readings to give an evidence, got a plan. Run the tests, or"
        " simulate it.",
    )
    require(
        any(np.any(test.reading_um) for test in campaign.tests),
        "readings must not all be zero to give an evidence, got nothing but zeros. Check the column"
        " of readings.",
    )


def log_bayes_factor(evidence: Evidence, other: Evidence) -> tuple[float, float]:
    """Return the log Bayes factor of a model over another model, and its error [nat].

    The Bayes factor is B = Z / Z', the evidence Z of the first model divided by the evidence Z' of
    the second one. If both models have the same prior probability, B is the ratio of their
    posterior probabilities.

    Parameters
    ----------
    evidence, other : Evidence
        Evidences of the two models for the same readings, from `log_evidence`.

    Returns
    -------
    tuple of float
        Log Bayes factor ln B of the first model over the second, and the sum of the errors of both
        log evidences [nat].

    Raises
    ------
    InputError
        If the two evidences are of different readings.

    Examples
    --------
    >>> constant = lb.log_evidence(lb.HybridModel.first(0), campaign, tolerance=0.1)
    >>> linear = lb.log_evidence(lb.HybridModel.first(1), campaign, tolerance=0.1)
    >>> log_bayes_factor, error = lb.inference.log_bayes_factor(linear, constant)
    >>> round(log_bayes_factor)
    -6
    """
    require(
        evidence.sha256 == other.sha256,
        "a Bayes factor must be between models of the same readings, got two campaigns"
        f" ({evidence.sha256[:12]}… and {other.sha256[:12]}…). Compute both evidences with the same"
        " campaign.",
    )
    return evidence.log_value - other.log_value, evidence.error + other.error


def log_prob_truncation(truncated: HyperPosterior) -> ProbabilityInside:
    """Return ln P and its error [nat]; P is the probability that no compliance is negative.

    P is the probability under the posterior that allows negative compliances. It is first computed
    for each of at least 256 values of the hyper-parameters (such as the standard deviation of the
    noise), and averaged over these values. The average is used if its error is at most 0.02 nat and
    ln P is above −2. Otherwise a few values of the hyper-parameters may dominate
    the average. P is then computed as a ratio of two integrals of the posterior density over the
    hyper-parameters: with and without the condition that no compliance is negative.

    Parameters
    ----------
    truncated : HyperPosterior
        Posterior density of the hyper-parameters with the condition that no compliance is negative.
    """
    if truncated.without_truncation.weighted_sample.trusted:
        coarse = truncated.coarse_probability
        if (
            coarse.error <= _PROBABILITY_TOLERANCE
            and coarse.log_value > _LEAST_COARSE_LOG_PROBABILITY
        ):
            return ProbabilityInside(min(coarse.log_value, 0.0), coarse.error)
    untruncated = compute_nodes(truncated.without_truncation, _PROBABILITY_TOLERANCE)
    inside = compute_nodes(truncated, _PROBABILITY_TOLERANCE)
    error = inside.error + untruncated.error
    log_value = inside.integral.log_integral - untruncated.integral.log_integral
    require(
        not log_value > _LARGEST_LOG_PROBABILITY + error,
        f"the probability of physical compliances must not exceed one, got ln P = {log_value:.3g} ±"
        f" {error:.2g}: readings out of reach of double precision. Check their sign, the mount"
        " compensation and the forces.",
    )
    return ProbabilityInside(min(log_value, 0.0), error)


def probabilities(log_evidence: Array) -> Array:
    """Return the posterior probabilities of n models, shape (n,).

    ``log_evidence``, shape (n,), holds the log evidences of the models. The models have equal prior
    probabilities.
    """
    weight = np.exp(log_evidence - log_evidence.max())
    return np.asarray(weight / weight.sum())
