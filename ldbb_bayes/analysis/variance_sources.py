"""Sources of the variance of parameters and of other quantities, under one model or several.

Given the hyper-parameters φ, such as the standard deviation of the noise, the error of every
quantity is a sum of independent errors, one from each source. A source is a model term, the reading
noise or the prior of a parameter. Each source has a share in the quantity's variance, and an
origin: its standard uncertainty is measured in this campaign, stated or assumed (`origins`).

In an average over models m with probabilities p_m, the variance of a quantity is
Σ p_m (var_m + (mean_m − mean)²). Here mean_m and var_m are the mean and the variance of the
posterior draws under model m, and mean is the average Σ p_m mean_m. The part Σ p_m var_m is divided
among the sources of every model, as for a single model. The part Σ p_m (mean_m − mean)² is a
separate source, the choice between the models (`MODEL_CHOICE`). This source counts as measured in
this campaign, because the readings determine the probabilities of the models.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from ldbb_bayes.analysis.origins import Origin, is_prior_stated, origins
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.terms.columns import PARAMETERS
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

# Name of the source of variance that arises when results are averaged over several models. The
# models give different means of a quantity; the scatter of these means is a part of the variance.
MODEL_CHOICE = "ModelChoice"


@dataclass(frozen=True)
class VarianceSource(Result):
    """A source of the uncertainty of one parameter, with its share of the parameter's variance.

    The field ``name`` is the class name of a model term, such as ``Mount``, or ``ReadingNoise`` for
    the reading noise. For the prior of the parameter itself, it is ``Parameters``; for the prior of
    another parameter, it is the name of that parameter. In an average over several models, the
    differences between the results of the models are a source, too, with the name ``ModelChoice``.
    """

    name: str
    #: origin of the source's standard uncertainty: measured in this campaign, stated by a
    #: certificate or by the user, or assumed
    origin: Origin
    share: float  #: share of a parameter's variance that one source of uncertainty causes


class SourcesOfVariance(NamedTuple):
    """Sources of the variance of one parameter.

    ``sources`` are all sources, the largest share first. ``likeness`` compares assumed sources,
    whose standard uncertainties are neither measured nor stated. An assumed source that causes an
    error of this parameter causes errors of the other parameters at the same time. These errors
    form a vector with one element for each parameter. For each pair of assumed sources,
    ``likeness`` holds the squared cosine of the angle between their vectors; a key consists of the
    names of the two sources. The squared cosine is 1 if both sources act on the same combination of
    parameters.
    """

    sources: tuple[VarianceSource, ...]
    likeness: dict[tuple[str, str], float]


@dataclass(frozen=True, eq=False)
class ModelVariance:
    """The variances of q quantities under one model, and the sources of these variances.

    The quantities are parameters, and changes of compliances with force.
    """

    probability: float  #: probability of the model in an average; one for a single model
    bound: BoundModel  #: the model, applied to a campaign or to a plan
    information: Information  #: linear model of the readings, at one value of the hyper-parameters
    #: change of each of the q quantities (parameters, and changes of compliances with force) when
    #: each of the model's m coefficients alone changes by its prior sd, shape (q, m). The internal
    #: units are composed of mm, N and rad. The changes are zero for a quantity that the model does
    #: not have.
    weights: Array
    #: means of q quantities (parameters, or changes of compliances with force) under one model,
    #: shape (q,)
    mean: Array
    #: standard deviations of q quantities (parameters, or changes of compliances with force) under
    #: one model, shape (q,). These are the values stated in the results. They come from posterior
    #: draws, in which no compliance is negative, or from an average over the hyper-parameters. They
    #: may therefore differ from the square roots of ``gaussian_variance``.
    sd: Array

    @cached_property
    def origins(self) -> dict[tuple[str, str], Origin]:
        """Origin of every source of uncertainty: measured in this campaign, stated or assumed.

        Each key is a pair of names: the name of the source (a coefficient or a kind of noise), and
        the class name of the model term to which the source belongs.
        """
        return origins(self.bound, self.information)

    @cached_property
    def gaussian_variance(self) -> Array:
        """Variances of q quantities according to the linear Gaussian model, shape (q,).

        The quantities are parameters, and changes of compliances with force.
        """
        return self._variance(self.information)

    def errors(self) -> dict[tuple[str, Origin], Array]:
        """Return, for each source of variance, the covariance matrix of the errors that it causes.

        A source is a model term, the reading noise or the prior of a parameter. The result is a
        dict. Each key is a pair: the name of the source and its origin. Each value is a covariance
        matrix of the errors of the q quantities, shape (q, q). The matrices are scaled so that the
        sum of their diagonals is ``sd``², the variances of the quantities.
        """
        gaussian_sd = np.sqrt(np.where(self.gaussian_variance > 0.0, self.gaussian_variance, 1))
        sd_ratio = self.sd / gaussian_sd
        scale = np.outer(sd_ratio, sd_ratio)
        information = self.information
        errors: dict[tuple[str, Origin], Array] = {}
        for key, covariance in information.error_covariances(self.weights).items():
            term = key[1]
            if term != PARAMETERS:
                source = (term, self.origins[key])
                errors[source] = errors.get(source, 0.0) + scale * covariance
        if information.flat:
            return errors
        # If the true value of a parameter is one prior sd above the prior mean, the prior causes an
        # error in the estimate of each quantity. The size of this error is the posterior covariance
        # of the quantity and the parameter, where the parameter is in units of its prior sd.
        error_by_prior = self.weights @ information.covariance()[:, information.interest]
        for j, name in enumerate(self.bound.names):
            origin = Origin.ASSUMED
            if is_prior_stated(self.bound, name):
                origin = Origin.STATED
            errors[name, origin] = scale * np.outer(error_by_prior[:, j], error_by_prior[:, j])
        return errors

    def variance_if_known(self, names: Sequence[str]) -> Array:
        """Return the variances that q quantities would have if some effects were known exactly.

        The quantities are parameters, and changes of compliances with force. ``names`` are the
        names of the known effects: class names of model terms, or names of single coefficients. The
        result has the shape (q,).
        """
        return self._scaled(self._variance(self.information, names))

    def variance_without_assumed(self, partners: Sequence[str]) -> Array:
        """Return the variances that q quantities would have if assumed effects were known exactly.

        ``partners`` are the names of the effects that are taken to be known: class names of model
        terms, and names of parameters. A named parameter is taken to be known exactly. Of a named
        model term, only the parts whose standard deviation is assumed (neither measured nor stated)
        are taken to be known: single coefficients, or the scatter that the term causes. All other
        coefficients stay uncertain. For example, a certificate may state the deflection of the
        mount, but not its curvature (its deviation from a straight line against force). Of the term
        ``Mount``, only the coefficient of the curvature is then taken to be known.

        The q quantities are parameters, and changes of compliances with force. The result has the
        shape (q,).
        """
        information = self.information
        known = [name for name in partners if name in information.names]
        for name, owner in zip(information.names, information.owners, strict=True):
            if owner in partners and self.origins[name, owner] == Origin.ASSUMED:
                known.append(name)
        noises = [name for name in partners if self.origins.get((name, name)) == Origin.ASSUMED]
        return self._scaled(self._variance(_without_noise(information, noises), known))

    def _variance(self, information: Information, known: Sequence[str] = ()) -> Array:
        """Return the variances of q quantities in the linear Gaussian model, shape (q,).

        The quantities are parameters, and changes of compliances with force. ``information`` is the
        linear model of the readings. ``known`` are the names of effects that are taken to be known
        exactly: class names of model terms, or names of coefficients.
        """
        covariance = information.covariance(known)
        return _variances_of(self.weights, covariance)

    def _scaled(self, variance: Array) -> Array:
        """Convert variances of the linear model to variances of the posterior, shape (q,).

        ``variance`` holds one variance for each of q quantities (parameters, and changes of
        compliances with force), computed from the linear model with some effects taken to be known.
        Each variance is multiplied by ``sd``² and divided by `gaussian_variance`. Here ``sd``² is
        the posterior variance of the quantity, and `gaussian_variance` is its variance in the
        linear model in which no effect is taken to be known. The result is at most ``sd``².
        """
        before = np.where(self.gaussian_variance > 0.0, self.gaussian_variance, 1.0)
        return np.clip(variance / before, 0.0, 1.0) * self.sd**2


@dataclass(frozen=True, eq=False)
class AveragedVariance:
    """Variances of q quantities, averaged over models, and the sources of these variances.

    ``models`` holds the variances under each model; there may be a single model. The first
    ``number_of_parameters`` quantities are all parameters that occur in at least one model; the
    others are changes of compliances with force.
    """

    models: tuple[ModelVariance, ...]
    number_of_parameters: int

    @cached_property
    def mean(self) -> Array:
        """Means of q quantities, averaged over the models, shape (q,).

        The quantities are parameters, and changes of compliances with force. The averaged means are
        Σ p_m mean_m, where p_m is the probability of model m, and mean_m are the means under model
        m.
        """
        return np.sum([model.probability * model.mean for model in self.models], axis=0)

    @cached_property
    def spread(self) -> Array:
        """Covariance matrix of the means, which differ from model to model, shape (q, q).

        The means are those of the q quantities. The matrix is Σ p_m d_m d_mᵀ, where p_m is the
        probability of model m, and d_m are the means under model m minus the means averaged over
        the models.
        """
        covariance = np.zeros((len(self.mean), len(self.mean)))
        for model in self.models:
            deviation = model.mean - self.mean
            covariance += model.probability * np.outer(deviation, deviation)
        return covariance

    @cached_property
    def errors(self) -> dict[tuple[str, Origin], Array]:
        """For each source of uncertainty, the covariance matrix of the errors that it causes.

        The result is a dict. Each key is a pair: the name of the source and its origin. Each value
        is a matrix, shape (q, q), for the errors of the q quantities, which are parameters, and
        changes of compliances with force. The matrices are averages over the models; see
        `ModelVariance.errors`.
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
        """Variances of q quantities in the average over the models, shape (q,).

        The quantities are parameters, and changes of compliances with force. The variances are Σ
        p_m (var_m + (mean_m − mean)²). Here p_m is the probability of model m, var_m and mean_m are
        the variances and means under model m, and mean = Σ p_m mean_m is the average of the means.
        """
        return np.diag(sum(self.errors.values(), np.zeros(self.spread.shape)))

    @cached_property
    def _divisor(self) -> Array:
        """Variances of q quantities, shape (q,); a variance of zero is replaced by 1.

        The quantities are parameters, and changes of compliances with force. A source of
        uncertainty causes a part of the variance of a quantity. This part, divided by the variance,
        is the source's share. The replacement prevents a division by zero.
        """
        return np.where(self.variance > 0.0, self.variance, 1.0)

    @cached_property
    def shares_by_term(self) -> dict[str, Array]:
        """Dict with the share of each model term in the variances of q quantities.

        The quantities are the parameters and the changes of the compliances with force. Each key is
        the class name of a term; each value has the shape (q,). The priors of all parameters count
        together as one term. If the results are averaged over several models, the uncertainty about
        the right model counts as one more term.
        """
        shares: dict[str, Array] = {}
        if not self.models[0].information.flat:
            shares[PARAMETERS] = np.zeros(len(self.variance))
        parameters = {name for model in self.models for name in model.bound.names}
        for (source, _), covariance in self.errors.items():
            term = PARAMETERS if source in parameters else source
            shares[term] = shares.get(term, 0.0) + np.diag(covariance) / self._divisor
        return shares

    @cached_property
    def shares_removed(self) -> dict[str, Array]:
        """For each term, the share of each variance that would vanish if the term was known.

        The result is a dict. Its keys are the class names of the model terms, and its values are
        arrays of shares, shape (q,), for the variances of the q quantities. The quantities are
        parameters, and changes of compliances with force. A term is known if its effect on
        the readings is known exactly.
        """
        removed: dict[str, Array] = {}
        for model in self.models:
            for term in model.information.terms:
                difference = model.sd**2 - model.variance_if_known([term])
                share = model.probability * difference / self._divisor
                removed[term] = removed.get(term, 0.0) + share
        return {term: np.clip(share, 0.0, 1.0) for term, share in removed.items()}

    def sd_without_assumed(self, partners: Sequence[str]) -> Array:
        """Return standard uncertainties that q quantities would have if some effects were known.

        ``partners`` are names of effects: model terms or parameters. The named parameters are taken
        to be known exactly. Of the coefficients of the named model terms, only those whose standard
        uncertainty is assumed (neither measured nor stated) are taken to be known exactly; see
        `ModelVariance.variance_without_assumed`. The result has the shape (q,).
        """
        variance = np.diag(self.spread).copy()
        for model in self.models:
            variance += model.probability * model.variance_without_assumed(partners)
        return np.sqrt(variance)

    def sources(self, index: int, parameters: Sequence[str]) -> SourcesOfVariance:
        """Return the sources of the variance of one quantity, the largest share first.

        ``index`` is the index of the quantity. ``parameters`` are the names of the parameters from
        which the quantity is computed. If the quantity is a parameter, this is the name of the
        parameter. If the quantity is the change of a compliance with force, these are the names of
        the slopes that the change depends on, such as ``C_XXX_1``. The priors of these parameters
        together count as one source.
        """
        sd = np.sqrt(self._divisor)
        shares: dict[tuple[str, Origin], float] = {}
        patterns: dict[str, Array] = {}
        for (source, origin), covariance in self.errors.items():
            label = PARAMETERS if source in parameters else source
            share = float(covariance[index, index] / self._divisor[index])
            shares[label, origin] = shares.get((label, origin), 0.0) + share
            if origin == Origin.ASSUMED:
                number = self.number_of_parameters
                pattern = covariance[:number, index] / sd[:number]
                patterns[label] = patterns.get(label, 0.0) + pattern
        entries = []
        for (label, origin), share in shares.items():
            entries.append(VarianceSource(label, origin, share))
        ordered = ranked(entries, lambda source: source.share)
        return SourcesOfVariance(tuple(ordered), _likeness(patterns))


def sources_of(bound: BoundModel, information: Information) -> dict[str, SourcesOfVariance]:
    """Return the sources of every parameter's variance in one model, the largest share first.

    The keys are names of parameters. If the coefficients of a model term have different origins,
    the term counts as one source for each origin. The prior of the parameter itself is a separate
    source, and so is the prior of each other parameter.

    Parameters
    ----------
    bound
        Model of a campaign or of a plan.
    information
        Linear model of the readings (`Information`), at one value of the hyper-parameters.
    """
    weights = weights_of_parameters(information)
    sd = np.sqrt(_variances_of(weights, information.covariance()))
    model = ModelVariance(1.0, bound, information, weights, bound.prior_mean, sd)
    variance = AveragedVariance((model,), len(bound.names))
    return {name: variance.sources(i, (name,)) for i, name in enumerate(bound.names)}


def weights_of_parameters(information: Information) -> Array:
    """Return the change of each parameter when one coefficient alone changes by its prior sd.

    The result has one row for each of the p parameters and one column for each of the m
    coefficients, shape (p, m). The parameters are themselves coefficients, so that every row has a
    single element that is not zero.
    """
    return (np.eye(len(information.names)) * information.scale)[information.interest]


def _without_noise(information: Information, known: Sequence[str]) -> Information:
    """Return the linear model of the readings without the random effects of some model terms.

    ``known`` holds the class names of these terms. Random effects are those that differ from circle
    to circle or from reading to reading; the model treats them as noise.
    """
    if not known:
        return information
    # In the linear model of the readings, tests with the same noise have one common dictionary,
    # which holds the sources of this noise. Each dictionary is copied only once, so that these
    # tests have one common dictionary in the result, too.
    remaining: dict[int, dict[str, Array]] = {}
    for sources in information.noise:
        remaining[id(sources)] = {name: sources[name] for name in sources if name not in known}
    return replace(information, noise=tuple(remaining[id(item)] for item in information.noise))


def _likeness(patterns: Mapping[str, Array]) -> dict[tuple[str, str], float]:
    """Return, for each pair of sources of uncertainty, how similar their errors are.

    ``patterns`` holds one vector, shape (p,), for each source of uncertainty of a quantity. The
    source causes a part of the covariance of this quantity with each of the p parameters. The
    vector holds these parts, each divided by the standard deviation of the parameter. The
    similarity of two sources is the squared cosine of the angle between their vectors, or zero if a
    vector is zero. The keys of the result are pairs of names of sources.
    """
    if not patterns:
        return {}
    stacked = np.stack(list(patterns.values()))
    length = np.linalg.norm(stacked, axis=1, keepdims=True)
    unit = stacked / np.where(length > 0.0, length, 1.0)
    squared_cosine = (unit @ unit.T) ** 2
    pairs = product(patterns, patterns)
    return dict(zip(pairs, squared_cosine.ravel().tolist(), strict=True))


def _variances_of(weights: Array, covariance: Array) -> Array:
    """Return the variances of q weighted sums of m coefficients, shape (q,).

    ``weights``, shape (q, m), holds the weights of each sum, and ``covariance``, shape (m, m), the
    covariance of the coefficients.
    """
    return np.asarray(np.sum((weights @ covariance) * weights, axis=1))
