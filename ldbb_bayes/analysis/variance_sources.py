"""Sources of the variance of parameters and of other quantities, under one model or several.

Given the hyper-parameters φ (the scales of the noise and of other effects), the error of every
quantity is a sum of independent errors, one from each source: a model term, reading noise or the
prior of a parameter. Each source has a share in the quantity's variance, and an origin: it is
measured here, stated or assumed (`origins`).

In an average over models m with probabilities p_m, the variance of a quantity is
Σ p_m (var_m + (mean_m − mean)²). The first part is shared out among the sources of every model, as
under that model alone. The second part is a source of its own, the choice between the models
(`MODEL_CHOICE`). It is measured here, because the readings give the probabilities. The variances
var_m are those of the posterior draws.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ldbb_bayes.analysis.origins import Origin, is_prior_stated, origins
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.terms.columns import OWN
from ldbb_bayes.results import Array, Result
from ldbb_bayes.units import ranked

__all__ = [
    "MODEL_CHOICE",
    "AveragedVariance",
    "ModelVariance",
    "SourcesOfVariance",
    "VarianceSource",
    "sources_of",
    "weights_of_parameters",
]

# Name of the source of variance that is the spread between the models of an average.
MODEL_CHOICE = "ModelChoice"


@dataclass(frozen=True)
class VarianceSource(Result):
    """A source of the uncertainty of one parameter, with its share of the variance.

    ``name`` is the class name of a model term, such as ``Mount``, ``ReadingNoise``, the name of
    another parameter (its prior), ``Parameters`` for the prior of the parameter itself, or
    ``ModelChoice`` for the spread between the models of an average.
    """

    name: str
    origin: Origin  #: where its size comes from: measured here, stated or assumed
    share: float  #: share of the source in the parameter's variance


class SourcesOfVariance(NamedTuple):
    """Sources of the variance of one parameter.

    ``sources`` are all sources, the largest share first. An assumed source that causes an error of
    this parameter causes errors of the other parameters too, which form a vector. ``likeness`` is
    the squared cosine of the angle between the vectors of two assumed sources, by their names: it
    is 1 if both act on the same combination of parameters.
    """

    sources: tuple[VarianceSource, ...]
    likeness: dict[tuple[str, str], float]


@dataclass(frozen=True, eq=False)
class ModelVariance:
    """The variance of q quantities under one model, and what it comes from."""

    probability: float  #: probability of the model in the average; one for a single model
    bound: BoundModel  #: the model, applied to a campaign or plan
    information: Information  #: information of the bound model, given the hyper-parameters
    #: weights of the model's m coefficients, divided by their prior sds, in each quantity, in the
    #: quantity's internal unit, shape (q, m); zero for a quantity that the model lacks
    weights: Array
    mean: Array  #: means of the quantities under this model, shape (q,)
    #: standard deviations of the quantities under this model, shape (q,): those of posterior draws,
    #: which may differ from those of the linear Gaussian model by the bounds on compliances
    sd: Array

    @cached_property
    def origins(self) -> dict[tuple[str, str], Origin]:
        """Origin of every source, by names of source and model term."""
        return origins(self.bound, self.information)

    @cached_property
    def gaussian_variance(self) -> Array:
        """Variances of the quantities in the linear Gaussian model, shape (q,)."""
        return self._variance(self.information)

    def errors(self) -> dict[tuple[str, Origin], Array]:
        """Return the covariance (q, q) of the errors of all quantities due to every source.

        The keys are names of sources with their origins. The name of a source is that of a model
        term, or that of the parameter whose prior it is. The covariances are scaled so that they
        add up to the variances ``sd``².
        """
        drawn = self.sd / np.sqrt(np.where(self.gaussian_variance > 0.0, self.gaussian_variance, 1))
        scale = np.outer(drawn, drawn)
        information = self.information
        errors: dict[tuple[str, Origin], Array] = {}
        for key, covariance in information.error_covariances(self.weights).items():
            term = key[1]
            if term != OWN:
                source = (term, self.origins[key])
                errors[source] = errors.get(source, 0.0) + scale * covariance
        if information.flat:
            return errors
        total = self.weights @ information.covariance()[:, information.interest]
        for j, name in enumerate(self.bound.names):
            origin = Origin.ASSUMED
            if is_prior_stated(self.bound, name):
                origin = Origin.STATED
            errors[name, origin] = scale * np.outer(total[:, j], total[:, j])
        return errors

    def variance_if_known(self, names: Sequence[str]) -> Array:
        """Return the variances that the quantities would have if some effects were known, (q,).

        ``names`` are those of model terms or single coefficients.
        """
        return self._scaled(self._variance(self.information, names))

    def variance_without_assumed(self, partners: Sequence[str]) -> Array:
        """Return the variances (q,) if what is assumed of some effects were known exactly.

        Coefficients of an effect that are measured or stated stay uncertain. For example, if a
        certificate states the mount's deflection, only the curvature of this deflection, which is
        assumed, becomes known. ``partners`` are names of model terms, or of parameters whose priors
        are meant.
        """
        information = self.information
        known = [name for name in partners if name in information.names]
        for name, owner in zip(information.names, information.owners, strict=True):
            if owner in partners and self.origins[name, owner] == Origin.ASSUMED:
                known.append(name)
        noises = [name for name in partners if self.origins.get((name, name)) == Origin.ASSUMED]
        return self._scaled(self._variance(_without_noise(information, noises), known))

    def _variance(self, information: Information, known: Sequence[str] = ()) -> Array:
        covariance = information.covariance(known)
        return np.einsum("qi,ij,qj->q", self.weights, covariance, self.weights)

    def _scaled(self, variance: Array) -> Array:
        """Return variances (q,) of the linear Gaussian model, scaled to those of the draws."""
        before = np.where(self.gaussian_variance > 0.0, self.gaussian_variance, 1.0)
        return np.clip(variance / before, 0.0, 1.0) * self.sd**2


@dataclass(frozen=True, eq=False)
class AveragedVariance:
    """The variance of q quantities, averaged over models, and its sources.

    ``models`` are the models, a single one if nothing is averaged. The first ``number`` quantities
    are the parameters of all models together.
    """

    models: tuple[ModelVariance, ...]
    number: int

    @cached_property
    def mean(self) -> Array:
        """Means of the quantities, Σ p_m mean_m, shape (q,)."""
        return np.sum([model.probability * model.mean for model in self.models], axis=0)

    @cached_property
    def spread(self) -> Array:
        """Covariance (q, q) of the quantities' means over the models."""
        covariance = np.zeros((len(self.mean), len(self.mean)))
        for model in self.models:
            deviation = model.mean - self.mean
            covariance += model.probability * np.outer(deviation, deviation)
        return covariance

    @cached_property
    def errors(self) -> dict[tuple[str, Origin], Array]:
        """Covariance (q, q) of the errors of all quantities due to every source.

        The keys are names of sources with their origins; see `ModelVariance.errors`.
        """
        errors: dict[tuple[str, Origin], Array] = {}
        for model in self.models:
            for key, covariance in model.errors().items():
                errors[key] = errors.get(key, 0.0) + model.probability * covariance
        if len(self.models) > 1:
            errors[MODEL_CHOICE, Origin.MEASURED] = self.spread
        return errors

    @cached_property
    def variance(self) -> Array:
        """Variances of the quantities, Σ p_m (var_m + (mean_m − mean)²), shape (q,)."""
        return np.diag(sum(self.errors.values(), np.zeros(self.spread.shape)))

    @cached_property
    def _divisor(self) -> Array:
        """Variances of the quantities by which shares are divided, one where they are zero."""
        return np.where(self.variance > 0.0, self.variance, 1.0)

    @cached_property
    def shares_by_term(self) -> dict[str, Array]:
        """Share of every term in the variances of the quantities, shape (q,), by its class name.

        The priors of the parameters count as one term, and so does the choice between the models of
        an average.
        """
        shares: dict[str, Array] = {}
        if not self.models[0].information.flat:
            shares[OWN] = np.zeros(len(self.variance))
        parameters = {name for model in self.models for name in model.bound.names}
        for (source, _), covariance in self.errors.items():
            term = OWN if source in parameters else source
            shares[term] = shares.get(term, 0.0) + np.diag(covariance) / self._divisor
        return shares

    @cached_property
    def shares_removed(self) -> dict[str, Array]:
        """Share of the quantities' variances, shape (q,), that knowing a model term would remove.

        The keys are the class names of the terms.
        """
        removed: dict[str, Array] = {}
        for model in self.models:
            for term in model.information.terms:
                difference = model.sd**2 - model.variance_if_known([term])
                share = model.probability * difference / self._divisor
                removed[term] = removed.get(term, 0.0) + share
        return {term: np.clip(share, 0.0, 1.0) for term, share in removed.items()}

    def sd_without_assumed(self, partners: Sequence[str]) -> Array:
        """Return the standard uncertainties (q,) if what is assumed of some effects were known.

        ``partners`` are model terms or parameters, see `ModelVariance.variance_without_assumed`.
        """
        variance = np.diag(self.spread).copy()
        for model in self.models:
            variance += model.probability * model.variance_without_assumed(partners)
        return np.sqrt(variance)

    def sources(self, i: int, own: Sequence[str]) -> SourcesOfVariance:
        """Return the sources of the variance of one quantity, the largest share first.

        ``i`` is the index of the quantity. ``own`` are names of parameters whose priors count as
        the prior of the quantity itself: the name of a parameter, or of the slopes from which a
        change with force follows.
        """
        sd = np.sqrt(self._divisor)
        shares: dict[tuple[str, Origin], float] = {}
        patterns: dict[str, Array] = {}
        for (source, origin), covariance in self.errors.items():
            label = OWN if source in own else source
            share = float(covariance[i, i] / self._divisor[i])
            shares[label, origin] = shares.get((label, origin), 0.0) + share
            if origin == Origin.ASSUMED:
                pattern = covariance[: self.number, i] / sd[: self.number]
                patterns[label] = patterns.get(label, 0.0) + pattern
        entries = []
        for (label, origin), share in shares.items():
            entries.append(VarianceSource(label, origin, share))
        ordered = ranked(entries, lambda source: source.share)
        return SourcesOfVariance(tuple(ordered), _likeness(patterns))


def sources_of(bound: BoundModel, information: Information) -> dict[str, SourcesOfVariance]:
    """Return all sources of the variance of every parameter of one model, largest share first.

    A model term whose coefficients have several origins is one source for each of them. The prior
    of the parameter itself and those of the other parameters are sources of their own.

    Parameters
    ----------
    bound
        Model bound to a campaign or plan.
    information
        Information of the bound model, given the hyper-parameters.
    """
    weights = weights_of_parameters(information)
    sd = np.sqrt(np.einsum("qi,ij,qj->q", weights, information.covariance(), weights))
    model = ModelVariance(1.0, bound, information, weights, bound.prior_mean, sd)
    variance = AveragedVariance((model,), len(bound.names))
    return {name: variance.sources(i, (name,)) for i, name in enumerate(bound.names)}


def weights_of_parameters(information: Information) -> Array:
    """Return the change of each parameter if one of the m coefficients changes by its prior sd.

    The p parameters are coefficients themselves, so that every row has a single element that is not
    zero. The result has the shape (p, m).
    """
    return (np.eye(len(information.names)) * information.scale)[information.interest]


def _without_noise(information: Information, known: Sequence[str]) -> Information:
    """Return the information of readings without the noise of some terms, by their class names."""
    if not known:
        return information
    # Tests with the same noise share one dictionary of its sources, and share one in the result
    # too.
    remaining: dict[int, dict[str, Array]] = {}
    for sources in information.noise:
        remaining[id(sources)] = {name: sources[name] for name in sources if name not in known}
    return replace(information, noise=tuple(remaining[id(item)] for item in information.noise))


def _likeness(patterns: Mapping[str, Array]) -> dict[tuple[str, str], float]:
    """Return the squared cosine of the angle between every two patterns of errors, by names.

    A pattern, shape (p,), holds the errors of all parameters that one source causes together with
    an error of a given parameter. For a pattern of zeros the result is zero.
    """
    if not patterns:
        return {}
    stacked = np.stack(list(patterns.values()))
    length = np.linalg.norm(stacked, axis=1, keepdims=True)
    unit = stacked / np.where(length > 0.0, length, 1.0)
    cosine = (unit @ unit.T).tolist()
    likeness = {}
    for first, row in zip(patterns, cosine, strict=True):
        for second, value in zip(patterns, row, strict=True):
            likeness[first, second] = value**2
    return likeness
