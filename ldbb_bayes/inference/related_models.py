"""Nodes and evidence of a model, computed from those of a related larger model.

φ are the hyper-parameters, the scales of the noise and of other effects. Rival explanations of
slopes are effects that look like a change of compliance with force. Given φ, the coefficients (the
parameters, and those of rival explanations of slopes) have a Gaussian posterior. Related models
differ only in the Gaussian priors of coefficients, and in truncation. The posterior of one of them
therefore follows from that of another. Nodes are weighted points that represent p(φ | y), where y
are the readings. Truncation T restricts compliances to values that are not negative.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ldbb_bayes.inference.integrals import CHUNK, Index, Integral
from ldbb_bayes.inference.nodes import HyperPosterior, Nodes
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.orthant import Orthant
from ldbb_bayes.results import Array

__all__ = ["RelatedModels"]

# Two prior standard deviations of a coefficient count as equal if their relative difference is at
# most this.
_SAME_SD = 1e-12


class _Conditionals(NamedTuple):
    """Gaussian posteriors of p coefficients given each of n values of the hyper-parameters (nodes).

    The coefficients are the parameters of interest, and those of effects that look like a change of
    compliance with force (rival explanations of slopes).
    """

    #: posterior means of the p coefficients given each of n values of the hyper-parameters, shape
    #: (p, n)
    mean: Array
    #: posterior covariances of the p coefficients given each of n values of the hyper-parameters,
    #: shape (p, p, n)
    covariance: Array


class _ChangedModel(NamedTuple):
    """Changes of evidence and posterior if the coefficients have the prior of another model.

    The changes are given at n nodes, which are values of the hyper-parameters.
    """

    #: ln p(y | φ) under the prior of the other model minus that under the prior of the given model,
    #: for the readings y and each of n values of the hyper-parameters φ, shape (n,)
    log_ratio: Array
    #: posteriors of some of the coefficients, given each of n values of the hyper-parameters, under
    #: the prior of the other model
    conditionals: _Conditionals


class _ChangedPrior(NamedTuple):
    """Coefficient that has a different prior standard deviation in another model."""

    #: index of the coefficient among the coefficients of the model whose nodes (weighted values of
    #: the hyper-parameters) are known
    coefficient: int
    mean: float  #: prior mean of the coefficient, the same in both models
    #: prior standard deviation of the coefficient in the model whose nodes are known
    sd: float
    #: prior standard deviation of the coefficient in the other model; zero if that model fixes the
    #: coefficient at zero
    other_sd: float


class RelatedModels:
    """Nodes of models that differ from a given model only in the priors of some coefficients.

    Nodes are weighted values of the hyper-parameters (scales of the noise and of other effects)
    that represent their posterior. The coefficients are the parameters of interest, and those of
    effects that look like a change of compliance with force (rival explanations of slopes). Let a
    coefficient have the prior standard deviation s₀ in the given model and s₁ in another model. The
    ratio of the two priors acts like an additional reading of the coefficient. The value of this
    reading is the prior mean, and its variance 1/(1/s₁² − 1/s₀²). If the other model fixes the
    coefficient at zero, the additional reading is exactly zero, with zero variance (Savage-Dickey
    ratio). The Gaussian posterior is conditioned on these readings one after the other.

    Parameters
    ----------
    plain : Nodes
        Nodes of the given model. It is the largest, the one that contains all coefficients, and
        allows negative compliances.
    tolerance : float
        Error allowed in every log evidence [nat].
    """

    def __init__(self, plain: Nodes, tolerance: float) -> None:
        self._integral = plain.integral
        self._bound = plain.bound
        self._tolerance = tolerance

    def nodes(self, posterior: HyperPosterior) -> Nodes:
        """Return the nodes of another model, which are weighted values of its hyper-parameters.

        ``posterior`` is the posterior of the hyper-parameters under that model. The nodes are those
        of the given model with other weights. They are computed anew if the other model has further
        coefficients, or if the error of its log evidence from the given nodes would exceed the
        tolerance.
        """
        if not set(posterior.bound.coefficients) <= set(self._bound.coefficients):
            return posterior.nodes(self._tolerance)
        all_nodes = np.arange(len(self._integral.free))
        log_ratio = self._change_prior(posterior.bound, [], all_nodes).log_ratio
        plain = replace(self._integral, log_density=self._integral.log_density + log_ratio)
        nodes = Nodes(posterior, plain)
        if posterior.truncated:
            nodes = self._truncate(posterior, plain)
        if nodes.meet(self._tolerance):
            return nodes
        return posterior.nodes(self._tolerance)

    def _truncate(self, posterior: HyperPosterior, plain: Integral) -> Nodes:
        """Return the nodes of another model under the condition that no compliance is negative.

        Nodes are weighted values of the hyper-parameters. ``posterior`` is the posterior of the
        hyper-parameters under the other model. ``plain`` holds the nodes with the weights that they
        have in the other model if it allows negative compliances.
        """
        coefficients = list(self._bound.coefficients)
        rows = posterior.bound.physical.rows
        constrained = np.flatnonzero((rows != 0.0).any(axis=0))
        indices = [coefficients.index(posterior.bound.names[j]) for j in constrained]

        def orthant(index: Index) -> Orthant:
            mean, covariance = self._change_prior(posterior.bound, indices, index).conditionals
            block = np.moveaxis(covariance, -1, 0)
            sd = np.sqrt(np.diagonal(block, axis1=1, axis2=2))
            correlation = block / (sd[:, :, None] * sd[:, None, :])
            root = sd[:, :, None] * np.linalg.cholesky(correlation)
            return Orthant(mean.T @ rows[:, constrained].T, rows[:, constrained] @ root)

        return posterior.truncate(plain, self._tolerance, orthant)

    @cached_property
    def _conditionals(self) -> _Conditionals:
        """Gaussian posteriors of the coefficients in the given model, for each of its nodes.

        A node is a value of the hyper-parameters. The first coefficients are those of rival
        explanations of slopes (effects that look like a change of compliance with force), the last
        are the parameters.
        """
        bound = self._bound
        free = self._integral.free
        p = len(bound.coefficients)
        mean = np.empty((p, len(free)))
        covariance = np.empty((p, p, len(free)))
        for start in range(0, len(free), CHUNK):
            nodes = slice(start, start + CHUNK)
            phi = bound.hyper_prior.phi(free[nodes])
            _, conditional = bound.collapsed.conditional(phi, last=p)
            mean[:, nodes] = conditional.mean.T
            covariance[..., nodes] = np.moveaxis(conditional.covariance, 0, -1)
        centre = np.pad(bound.centre, (p - len(bound.names), 0))
        return _Conditionals(mean + centre[:, None], covariance)

    def _changed_priors(self, bound: BoundModel) -> list[_ChangedPrior]:
        """Return the coefficients whose prior sd in another model differs from the given model's.

        ``bound`` is the other model applied to the campaign. A coefficient that the other model
        lacks has the sd zero there.
        """
        other_priors = bound.coefficients
        changed = []
        for j, (name, (mean, sd)) in enumerate(self._bound.coefficients.items()):
            other_sd = other_priors.get(name, (0.0, 0.0))[1]
            if abs(other_sd - sd) > _SAME_SD * sd:
                changed.append(_ChangedPrior(j, mean, sd, other_sd))
        return changed

    def _change_prior(
        self, bound: BoundModel, coefficients: list[int], nodes: Index
    ) -> _ChangedModel:
        """Return how the posterior at some nodes changes under the prior of another model.

        ``bound`` is the other model applied to the campaign. ``nodes``, shape (k,), holds indices
        of nodes (values of the hyper-parameters). ``coefficients`` are the indices of the
        coefficients whose posteriors are returned.
        """
        log_ratio = np.zeros(len(nodes))
        changed = self._changed_priors(bound)
        further = [prior.coefficient for prior in changed if prior.coefficient not in coefficients]
        places = np.array([*coefficients, *further], dtype=np.intp)
        mean = self._conditionals.mean[np.ix_(places, nodes)]
        covariance = self._conditionals.covariance[np.ix_(places, places, nodes)]
        for prior in changed:
            k = int(np.argmax(places == prior.coefficient))
            variance = prior.sd**2
            reading = 0.0
            noise = 0.0
            if prior.other_sd:
                reading = prior.mean
                noise = 1.0 / (1.0 / prior.other_sd**2 - 1.0 / variance)
            posterior_variance = covariance[k, k] + noise
            prior_variance = variance + noise
            residual = mean[k] - reading
            log_ratio = log_ratio + 0.5 * (
                np.log(prior_variance / posterior_variance)
                + (prior.mean - reading) ** 2 / prior_variance
                - residual**2 / posterior_variance
            )
            gain = covariance[k] / posterior_variance
            mean = mean - gain * residual
            covariance = covariance - gain[:, None] * covariance[k]
        size = len(coefficients)
        return _ChangedModel(log_ratio, _Conditionals(mean[:size], covariance[:size, :size]))
