"""Nodes (weighted points) and evidence of a model, computed from the nodes of a related model.

φ are the hyper-parameters, such as the standard deviation of the noise. Nodes are weighted points
that represent p(φ | y), where y are the readings. Related models have the same hyper-parameters.
They may differ in how compliances change with force, in their alternative explanations (effects
that look like a change of compliance with force), and in whether negative compliances are allowed.
The posteriors of φ under related models are similar. The nodes of one model can therefore represent
the posterior of another model if their weights are changed.
"""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np

from ldbb_bayes.inference.density_ratio import LogValues, RatioIntegral, RatioSampler
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.integrals import Index, in_chunks
from ldbb_bayes.inference.nodes import Nodes, compute_nodes
from ldbb_bayes.inference.truncation_factor import common_error_allowed
from ldbb_bayes.results import Array

__all__ = ["RelatedModels", "log_density_with_error"]

# If the nodes of the given model do not suffice for a related model, and the error of the given
# model's log evidence exceeds ``_LARGEST_SHARE`` times the tolerance, its nodes are computed once
# more, with ``_FINER`` times the tolerance.
_LARGEST_SHARE = 0.5
_FINER = 0.5
# If the finer nodes of the given model miss the tolerance themselves, new nodes of a related model
# would most probably miss it as well. Its log evidence from the given nodes is then allowed this
# multiple of the given model's error.
_MULTIPLE_OF_GIVEN_ERROR = 1.5
# If the error of the given model is larger than this [nat], new nodes are computed nevertheless.
_LARGEST_GIVEN_ERROR = 0.2
# The evidence of a model is at most the one that it would have if no reading made its compliances
# negative. A model is negligible if this upper bound of its log evidence is below the limit of
# negligible models by this number [nat]: no sum of evidences then shows which value it has.
_FAR_BELOW = 20.0


class RelatedModels:
    """Nodes of models that have the same hyper-parameters as a given model.

    Nodes are weighted values of the hyper-parameters φ that represent their posterior. All models
    use the same values of φ, but each model has its own weights. The weights are proportional to
    p(y | φ) p(φ) under the model, where y are the readings.

    Parameters
    ----------
    untruncated : Nodes
        Nodes of the given model, which must allow negative compliances (no truncation). The given
        model should be the largest of the models, because its posterior of φ is then wide enough
        for all of them.
    tolerance : float
        Error allowed in every log evidence [nat].
    """

    def __init__(self, untruncated: Nodes, tolerance: float) -> None:
        """Keep what is needed to use the nodes of the given model for other models.

        ``untruncated`` are the nodes of the given model, which must allow negative compliances.
        They are kept with a sampler of density ratios at these nodes, and the names of the
        hyper-parameters. ``tolerance`` is the error allowed in every log evidence [nat].
        """
        self._untruncated = untruncated
        self._ratios = RatioSampler(untruncated.integral)
        self._names = untruncated.bound.hyper_prior.names
        self._tolerance = tolerance
        self._may_be_refined = untruncated.error > _LARGEST_SHARE * tolerance
        # Samplers of density ratios at the nodes of models for which new nodes had to be computed.
        self._further_ratios: list[RatioSampler] = []

    def copy(self) -> RelatedModels:
        """Return an object that holds the same nodes, and does not change with this object."""
        copied = copy.copy(self)
        copied._further_ratios = list(self._further_ratios)
        return copied

    def nodes(self, posterior: HyperPosterior) -> Nodes:
        """Return nodes that represent a posterior.

        This object holds nodes of a given model; ``posterior`` is the posterior density under
        another model. The nodes of the given model are used again, with new weights. If possible,
        the new density is evaluated only at some of the nodes (`density_ratio`). New nodes are
        computed if the other model has other hyper-parameters, or if the error of its log evidence
        would exceed the tolerance. If the given model misses the tolerance itself, an error in
        proportion to its error is accepted.
        """
        return self.nodes_unless_negligible(posterior, -np.inf)[0]

    def nodes_unless_negligible(
        self, posterior: HyperPosterior, below: float
    ) -> tuple[Nodes, bool]:
        """Return the same nodes as `nodes`, or others if they show that a model is negligible.

        A model is negligible if its log evidence is at most ``below`` [nat]. If the nodes of the
        given model do not suffice, and new nodes were computed for other models before, these nodes
        are tried before new nodes are computed again. They are returned if they show within the
        tolerance that the model is negligible. If new nodes without truncation show that the model
        is negligible by far, these are returned, and the log evidence from them is an upper bound.
        The second value is true in both cases.
        """
        if posterior.bound.hyper_prior.names != self._names:
            return compute_nodes(posterior, self._tolerance), False
        nodes = self._nodes_from_sample(posterior, self._ratios)
        if nodes is None and self._may_be_refined:
            self._refine()
            nodes = self._nodes_from_sample(posterior, self._ratios)
        if nodes is None and self._attainable_error > self._tolerance:
            nodes = self._nodes_from_sample(posterior, self._ratios, self._attainable_error)
        if nodes is not None:
            return nodes, False
        if np.isfinite(below):
            for ratios in self._further_ratios:
                nodes = self._nodes_from_sample(posterior, ratios)
                if nodes is not None and nodes.evidence.log_value + nodes.error <= below:
                    return nodes, True
        weighted = self._integral_from_all_values(posterior)
        if weighted.meets(self._tolerance):
            return Nodes(posterior, weighted.integral, weighted.value_error), False
        return self._new_nodes(posterior, below)

    def _new_nodes(self, posterior: HyperPosterior, below: float) -> tuple[Nodes, bool]:
        """Return new nodes of a model, and whether they show that it is negligible by far.

        If they do, they are without truncation, and the log evidence from them is an upper bound.
        New nodes without truncation are kept for further models. ``below`` is the largest log
        evidence of a negligible model [nat].
        """
        untruncated = compute_nodes(posterior.without_truncation, self._tolerance)
        self._further_ratios.append(RatioSampler(untruncated.integral))
        at_most = Nodes(posterior, untruncated.integral)
        if at_most.evidence.log_value + at_most.error <= below - _FAR_BELOW:
            return at_most, True
        return compute_nodes(posterior, self._tolerance), False

    @property
    def _attainable_error(self) -> float:
        """Error of a log evidence that nodes may be expected to reach [nat].

        It is the tolerance, unless the given model misses it although its nodes have been refined.
        """
        error = self._untruncated.error
        is_between = self._tolerance < error <= _LARGEST_GIVEN_ERROR
        if self._may_be_refined or not is_between:
            return self._tolerance
        return _MULTIPLE_OF_GIVEN_ERROR * error

    def _refine(self) -> None:
        """Replace the nodes of the given model by nodes with half of the allowed error.

        The error of the given model's evidence is part of the error of every related evidence. If
        it is nearly as large as the tolerance, new nodes would have to be computed for most of the
        related models. Finer nodes of the given model, computed once, are enough for most of them.
        """
        finer = compute_nodes(self._untruncated.posterior, _FINER * self._tolerance)
        self._untruncated = finer
        self._ratios = RatioSampler(finer.integral)
        self._may_be_refined = False

    def _nodes_from_sample(
        self, posterior: HyperPosterior, ratios: RatioSampler, tolerance: float | None = None
    ) -> Nodes | None:
        """Return nodes of an earlier model, with new weights for the posterior of another model.

        ``posterior`` is the posterior density of the hyper-parameters under the other model. It is
        evaluated at some of the nodes with which ``ratios`` was made. The result is None if the
        error of the log evidence would exceed ``tolerance`` [nat], by default that of this object.
        """
        allowed = self._tolerance if tolerance is None else tolerance

        def evaluate(index: Index) -> LogValues:
            return log_density_with_error(posterior, ratios.integral.free[index], self._tolerance)

        sampled = ratios.integrate(evaluate, allowed)
        if sampled is None:
            return None
        return Nodes(posterior, sampled.integral, sampled.value_error)

    def _integral_from_all_values(self, posterior: HyperPosterior) -> RatioIntegral:
        """Return the integral of the posterior of another model, with nodes of the given model.

        ``posterior`` is the posterior density of the hyper-parameters under the other model. It is
        evaluated at every node; the new weights are computed from its values.
        """
        integral = self._untruncated.integral
        untruncated = replace(
            integral,
            log_density=in_chunks(posterior.without_truncation.log_density, integral.free),
        )
        if posterior.truncated:
            return posterior.truncate(untruncated, self._tolerance)
        return RatioIntegral(untruncated, 0.0)


def log_density_with_error(posterior: HyperPosterior, free: Array, tolerance: float) -> LogValues:
    """Return the joint log density of readings and hyper-parameters at w points, with errors.

    ``free``, shape (w, h), holds w values of the h hyper-parameters in unbounded coordinates
    (mostly ln(value − lower bound)). ``posterior`` is the posterior density of the
    hyper-parameters; this object also holds the model and the readings. ``tolerance`` is the error
    allowed in a log evidence [nat].
    """
    log_density = posterior.bound.hyper_prior.log_density_of_free(free)
    log_evidence, conditional = posterior.given(free)
    log_density = log_density + log_evidence
    error = np.zeros(len(free))
    if posterior.truncated:
        log_probability, error = conditional.orthant.log_probability(
            common_error_allowed(tolerance)
        )
        log_density = log_density + log_probability
    return LogValues(log_density, error)
