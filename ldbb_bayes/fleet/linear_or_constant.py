"""Bayes factor of linear over constant compliance, from the nodes of one fit.

φ are the hyper-parameters (such as the standard deviation of the noise). Nodes are weighted values
of φ. T is the condition that no compliance is negative (truncation). The log evidence of a model
with truncation is ln Z + ln P(T | y) − ln P(T). Z is the density of the readings y under the model
without truncation; P(T | y) and P(T) are the posterior and the prior probability of T under the
model without truncation. The model of linear compliance and the model of constant compliance have
the same hyper-parameters φ; one set of nodes can therefore be used for both models.
"""

from __future__ import annotations

from typing import NamedTuple

from ldbb_bayes.inference.evidence import log_evidence
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.nodes import Nodes, compute_nodes
from ldbb_bayes.inference.related_models import RelatedModels
from ldbb_bayes.inference.truncation_factor import ProbabilityInside

__all__ = ["EvidenceRatio", "linear_over_constant"]


class EvidenceRatio(NamedTuple):
    """Logarithm of the ratio of two evidences (log Bayes factor), and its error [nat]."""

    value: float  #: log Bayes factor of linear over constant compliance [nat]
    error: float  #: error of the log Bayes factor [nat]


class _LogEvidence(NamedTuple):
    """Log evidence of a model, and its error [nat]."""

    value: float  #: log evidence of a model [nat]
    error: float  #: error of the log evidence of a model [nat]


def linear_over_constant(density: HyperPosterior, *, tolerance: float) -> EvidenceRatio:
    """Return the log Bayes factor of linear over constant compliance, and its error [nat].

    Parameters
    ----------
    density : posterior density of the hyper-parameters (such as the sd of the noise)
        under the model of a fit, in which compliances depend on force. If compliances are linear in
        force and the nodes (weighted values of the hyper-parameters) of this fit are precise
        enough, these nodes are used for both models. Otherwise both evidences are computed anew.
    tolerance : error allowed in each of the two log evidences [nat]. The error of the result is the
        sum of the errors of the two log evidences.
    """
    model = density.bound.model
    without_truncation = density.without_truncation
    nodes = Nodes(without_truncation, without_truncation.weighted_sample)
    if model.degree != 1 or not nodes.meets(tolerance):
        campaign = density.bound.campaign
        of_linear = log_evidence(model.with_degree(1), campaign, tolerance=tolerance)
        of_constant = log_evidence(model.with_degree(0), campaign, tolerance=tolerance)
        return _log_ratio(
            linear=_LogEvidence(of_linear.log_value, of_linear.error),
            constant=_LogEvidence(of_constant.log_value, of_constant.error),
        )
    # Nodes are weighted values of the hyper-parameters. The nodes of the model of linear compliance
    # can also be used for the model of constant compliance, but with other weights.
    related = RelatedModels(nodes, tolerance)
    constant_model = model.with_degree(0).bind(density.bound.campaign)
    constant = HyperPosterior(constant_model, truncated=True, near=without_truncation.mode)
    constant_nodes = related.nodes(constant.without_truncation)
    return _log_ratio(
        linear=_log_evidence_from(nodes, density, tolerance, known=density.coarse_probability),
        constant=_log_evidence_from(constant_nodes, constant, tolerance),
    )


def _log_evidence_from(
    nodes: Nodes,
    truncated: HyperPosterior,
    tolerance: float,
    *,
    known: ProbabilityInside | None = None,
) -> _LogEvidence:
    """Return the log evidence of a model with truncation, from nodes computed without truncation.

    Truncation is the condition that no compliance is negative. ``nodes`` are weighted values of the
    hyper-parameters, such as the standard deviation of the noise; they represent the posterior of
    the hyper-parameters without truncation. ``truncated`` is the posterior density of the
    hyper-parameters with truncation. From ``nodes``, the log probability that no compliance is
    negative is computed. If its error exceeds ``tolerance`` [nat], the evidence is computed from
    nodes of ``truncated`` instead. ``known`` is this log probability if it was computed before, for
    example by the fit of the campaign; it is used if its error is at most ``tolerance``.
    """
    bound = truncated.bound
    value = nodes.evidence.log_value
    error = nodes.evidence.error
    if not bound.truncation.active:
        return _LogEvidence(value, error)
    posterior_probability = known
    if posterior_probability is None or posterior_probability.error > tolerance:
        posterior_probability = truncated.probability_inside(nodes.integral, tolerance)
    if posterior_probability.error > tolerance:
        evidence = compute_nodes(truncated, tolerance).evidence
        return _LogEvidence(evidence.log_value, evidence.error)
    log_prior_probability, prior_error = bound.parameter_prior.normalisation
    return _LogEvidence(
        value + posterior_probability.log_value - log_prior_probability,
        error + posterior_probability.error + prior_error,
    )


def _log_ratio(linear: _LogEvidence, constant: _LogEvidence) -> EvidenceRatio:
    """Return the log Bayes factor of linear over constant compliance, with its error [nat].

    The arguments are the log evidences of the two models; the error is the sum of their errors.
    """
    return EvidenceRatio(linear.value - constant.value, linear.error + constant.error)
