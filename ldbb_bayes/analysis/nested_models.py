"""Models with constant and with linear compliance, all taken from the largest of them.

Compliance may be constant or change with force (the change is called a slope), and three other
effects may make the readings look as if compliance changed with force: the load on the joints, a
curved mount and a curved force law. They are called rivals. `average` weighs all models with and
without slopes, and with and without each rival, by their evidences. Each of these models is the
largest model, in which some coefficients (slopes, or coefficients of rivals) are zero.

All results of the smaller models follow from the posterior of the largest one, given the
hyper-parameters φ (such as the standard deviation of the noise). Let y be the readings, and D the
coefficients that are zero in a smaller model. By the Savage-Dickey density ratio (J. M. Dickey
1971), the evidence of the smaller model over that of the largest is p(D = 0 | y, φ) / p(D = 0):
posterior over prior density. The posterior of the other coefficients is that of the largest model,
given D = 0. If compliances must not be negative (condition T), the ratio is multiplied by
P(T | y, φ) / P(T) of the smaller model, and divided by that of the largest.

`average` estimates the compliances anew for each model, and sizes the priors of slopes and joint
loads by them. Here, these sizes are those of the largest model. For this reason, results are stated
for compliances and geometric errors, but not for slopes, which depend on their own priors most.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from ldbb_bayes.analysis.rival_explanations import subsets
from ldbb_bayes.analysis.truncated_moments import TruncatedMoments, truncated_moments
from ldbb_bayes.inference.coefficients import shared_terms
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.rivals import RIVALS
from ldbb_bayes.results import Array

__all__ = ["Coefficients", "NestedModels", "averaged_sds", "averaged_variances"]

# Name of the slopes in the list of effects that a model may have or lack.
_SLOPES = "slopes"
# A model is left out of an average if its log probability is below that of the most probable model
# by more than this number [nat].
_NEGLIGIBLE = 12.0
# Number of quasi-random points from which, for each value of the hyper-parameters, moments are
# computed under the condition that no compliance is negative. Averages over models are over many
# such values. With 4096 points, the averaged standard deviations change by at most 0.1 %.
_POINTS_INSIDE = 256


class Coefficients(NamedTuple):
    """Gaussian distributions of q coefficients, in units of their prior standard deviations.

    The coefficients are the p parameters and, after them, the coefficients of the rivals. The
    leading dimensions of the arrays count the distributions.
    """

    mean: Array  # means minus prior means, shape (..., q)
    covariance: Array  # covariances, shape (..., q, q)


class ParameterDistributions(NamedTuple):
    """Gaussian distributions of the p parameters alone, in internal units (mm, N, rad).

    The leading dimensions of the arrays count the distributions.
    """

    mean: Array  # means of the parameters, shape (..., p)
    covariance: Array  # covariances, shape (..., p, p)


class _PosteriorOfModel(NamedTuple):
    """Posteriors of the p parameters under one of the nested models, in internal units.

    The leading dimensions of the arrays count the sets of readings and hyper-parameters.
    """

    #: log evidence of the model minus that of the largest model without condition T [nat], shape
    #: (...)
    log_ratio: Array
    mean: Array  #: posterior means of the parameters, shape (..., p)
    variance: Array  #: posterior variances of the parameters, shape (..., p)


@dataclass(frozen=True, eq=False)
class NestedModels:
    """The models over which `average` averages, as special cases of the largest of them."""

    bound: BoundModel  #: the largest model (slopes and all rivals), applied to the tests
    #: indices of the q coefficients (first the p parameters, then those of the rivals) among all
    #: coefficients that are the same in all tests
    places: tuple[int, ...]
    names: tuple[str, ...]  #: names of the q coefficients
    prior_sd: Array  #: prior standard deviations of the q coefficients, shape (q,)
    #: for each model, the indices of those of the q coefficients that are zero in it
    zeros: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, bound: BoundModel) -> NestedModels | None:
        """Return the models nested in ``bound``; None if there is nothing to average.

        That is so if compliance is not linear in the model, or if the priors are flat.
        """
        slopes = [k for k, entry in enumerate(bound.parameters) if entry.group == "slope"]
        if bound.model.prior.flat or bound.model.degree != 1 or not slopes:
            return None
        chosen = _choose_coefficients(bound)
        members = {_SLOPES: tuple(slopes), **chosen.rivals}
        zeros = []
        for effects in subsets(tuple(members)):
            indices: list[int] = []
            for effect, indices_of_effect in members.items():
                if effect not in effects:
                    indices += indices_of_effect
            zeros.append(tuple(indices))
        return cls(bound, chosen.places, chosen.names, chosen.prior_sd, tuple(zeros))

    @property
    def stated(self) -> dict[int, str]:
        """Names of the parameters for which results are stated; the keys are their indices.

        These are compliances and geometric errors, but not slopes.
        """
        parameters = enumerate(self.bound.parameters)
        return {k: entry.name for k, entry in parameters if entry.group != "slope"}

    def coefficients_given(self, phi: Array) -> Coefficients:
        """Return the posteriors of the q coefficients in the largest model, without condition T.

        T is the condition that no compliance is negative. ``phi``, shape (w, h), are w values of
        the h hyper-parameters, with lengths in mm. If the tests have no readings, only the
        covariances have a meaning.
        """
        _, density = self.bound.collapsed.conditional_of(self.places, phi)
        p = len(self.bound.names)
        mean = density.mean.copy()
        mean[:, :p] += self.bound.least_squares_estimate - self.bound.prior_mean
        covariance = density.covariance / np.outer(self.prior_sd, self.prior_sd)
        return Coefficients(mean / self.prior_sd, covariance)

    def restrict(
        self, model: int, coefficients: Coefficients, precision: Array
    ) -> tuple[Array, Coefficients]:
        """Return the log evidence of a model over the largest, and the coefficients under it.

        Condition T, that no compliance is negative, is left out.

        Parameters
        ----------
        model
            Index of the model in ``zeros``.
        coefficients
            Distributions of the coefficients in the largest model, of leading shape (...).
        precision
            Prior precisions of the coefficients, in units of 1/``prior_sd``², of a shape that
            broadcasts to (..., q). They are 1 for the priors of ``bound``.
        """
        zeros = list(self.zeros[model])
        mean, covariance = coefficients
        if not zeros:
            return np.zeros(mean.shape[:-1]), coefficients
        rows = covariance[..., zeros, :]
        block = rows[..., zeros]
        value = mean[..., zeros]
        root = np.linalg.cholesky(block)
        white = np.linalg.solve(root, value[..., None])[..., 0]
        log_sd = np.log(np.diagonal(root, axis1=-2, axis2=-1))
        log_prior_sd = -0.5 * np.log(precision[..., zeros])
        log_ratio = (log_prior_sd - log_sd).sum(axis=-1) - 0.5 * (white**2).sum(axis=-1)
        gain = np.linalg.solve(block, rows)
        restricted_mean = mean - np.einsum("...zq,...z->...q", gain, value)
        restricted_covariance = covariance - np.swapaxes(rows, -1, -2) @ gain
        # The coefficients that are zero have no rounding errors left in them.
        restricted_mean[..., zeros] = 0.0
        restricted_covariance[..., zeros, :] = 0.0
        restricted_covariance[..., :, zeros] = 0.0
        return log_ratio, Coefficients(restricted_mean, restricted_covariance)

    def posteriors(self, coefficients: Coefficients, precision: Array) -> list[_PosteriorOfModel]:
        """Return the posteriors of the parameters under every model, and the models' evidences.

        The first posterior is that of the largest model. Models that are improbable at all values
        of the hyper-parameters are left out. For the arguments, see `restrict`.
        """
        restricted = [self.restrict(k, coefficients, precision) for k in range(len(self.zeros))]
        most_probable = np.max([log_ratio for log_ratio, _ in restricted], axis=0)
        posteriors = []
        for k, (log_ratio, given_zeros) in enumerate(restricted):
            is_largest = not self.zeros[k]
            if not is_largest and np.max(log_ratio - most_probable) < -_NEGLIGIBLE:
                continue
            inside = self._inside(k, given_zeros)
            log_ratio_inside = log_ratio + inside.log_probability
            posteriors.append(_PosteriorOfModel(log_ratio_inside, inside.mean, inside.variance))
        return posteriors

    def log_inside(self, model: int, coefficients: Coefficients) -> Array:
        """Return ln P(T) under given distributions minus its prior value, shape (...).

        T is the condition that no compliance is negative. ``model`` is the index of the model to
        which the distributions of the coefficients belong.
        """
        return self._inside(model, coefficients).log_probability

    def _inside(self, model: int, coefficients: Coefficients) -> TruncatedMoments:
        """Return moments under condition T, with ln P(T) minus its prior value."""
        parameters = self.parameters_of(coefficients)
        inside = truncated_moments(
            self.bound, parameters.mean, parameters.covariance, points=_POINTS_INSIDE
        )
        log_ratio = inside.log_probability - self._log_prior_inside[model]
        return inside._replace(log_probability=log_ratio)

    def parameters_of(self, coefficients: Coefficients) -> ParameterDistributions:
        """Return the distributions of the p parameters, the first of the q coefficients."""
        p = len(self.bound.names)
        scale = self.prior_sd[:p]
        mean = self.bound.prior_mean + coefficients.mean[..., :p] * scale
        covariance = coefficients.covariance[..., :p, :p] * np.outer(scale, scale)
        return ParameterDistributions(mean, covariance)

    @cached_property
    def _log_prior_inside(self) -> list[float]:
        """Log prior probabilities, under every model, that no compliance is negative.

        The rivals have no effect on it. It is computed once for all models that have the same
        parameters.
        """
        p = len(self.bound.names)
        known: dict[tuple[int, ...], float] = {}
        log_probabilities = []
        for zeros in self.zeros:
            zero_parameters = tuple(k for k in zeros if k < p)
            if zero_parameters not in known:
                known[zero_parameters] = self._log_prior_inside_with(zero_parameters)
            log_probabilities.append(known[zero_parameters])
        return log_probabilities

    def _log_prior_inside_with(self, zero_parameters: tuple[int, ...]) -> float:
        """Return the log prior probability that no compliance is negative, with some at zero.

        ``zero_parameters`` are the indices of the parameters that are zero.
        """
        q = len(self.prior_sd)
        variance = np.ones(q)
        variance[list(zero_parameters)] = 0.0
        prior = Coefficients(np.zeros((1, q)), np.diag(variance)[None])
        parameters = self.parameters_of(prior)
        inside = truncated_moments(self.bound, parameters.mean, parameters.covariance)
        return float(inside.log_probability[0])


class _NestedCoefficients(NamedTuple):
    """The q coefficients of the nested models: the p parameters, then those of the rivals."""

    places: tuple[int, ...]  #: see ``NestedModels.places``
    names: tuple[str, ...]  #: names of the coefficients
    prior_sd: Array  #: prior standard deviations of the coefficients, shape (q,)
    #: indices of the coefficients of each rival among the q coefficients; the keys are the names of
    #: the rivals
    rivals: dict[str, tuple[int, ...]]


def _choose_coefficients(bound: BoundModel) -> _NestedCoefficients:
    """Return the coefficients by which the models nested in ``bound`` differ, and all parameters.

    In the vector of the coefficients that are the same in all tests, those of the nuisances
    (effects modelled but not of interest) come first, and the parameters last.
    """
    names: list[str] = []
    sds: list[float] = []
    for columns in shared_terms(bound.nuisance_columns):
        names += columns.names
        sds += [float(sd) for sd in columns.sd]
    places = list(range(len(names), len(names) + len(bound.names)))
    chosen_names = list(bound.names)
    prior_sd = bound.scale.tolist()
    rivals = {}
    for rival in bound.model.rivals:
        beginning = RIVALS[rival].coefficients
        of_rival = [place for place, name in enumerate(names) if name.startswith(beginning)]
        rivals[rival] = tuple(range(len(places), len(places) + len(of_rival)))
        places += of_rival
        prior_sd += [sds[place] for place in of_rival]
        chosen_names += [names[place] for place in of_rival]
    return _NestedCoefficients(tuple(places), tuple(chosen_names), np.array(prior_sd), rivals)


def averaged_variances(posteriors: list[_PosteriorOfModel], log_weight: Array) -> Array:
    """Return posterior variances of the p parameters, averaged over models, shape (..., p).

    Parameters
    ----------
    posteriors
        Posteriors under every model for n values of the hyper-parameters, of the leading shape
        (..., n).
    log_weight
        Logarithms of the weights of the n values under the largest model, of a shape that
        broadcasts to (..., n).
    """
    log_ratios = np.stack([entry.log_ratio + log_weight for entry in posteriors], axis=-1)
    total = logsumexp(log_ratios, axis=(-2, -1), keepdims=True)
    weight = np.exp(log_ratios - total)
    means = np.stack([entry.mean for entry in posteriors], axis=-2)
    variances = np.stack([entry.variance for entry in posteriors], axis=-2)
    mean = np.einsum("...nm,...nmp->...p", weight, means)
    deviation = means - mean[..., None, None, :]
    return np.asarray(np.einsum("...nm,...nmp->...p", weight, variances + deviation**2))


def averaged_sds(bound: BoundModel, phi: Array, *, truncated: bool) -> dict[str, float]:
    """Return standard uncertainties that are averaged over constant and linear compliance.

    They approximate those of `average`. The keys of the result are the names of the
    compliances and geometric errors, without slopes. The result is empty if there is nothing to
    average (see `NestedModels`).

    Parameters
    ----------
    bound
        Largest model, applied to a campaign with readings.
    phi
        Random draws of the h hyper-parameters (such as the standard deviation of the noise) from
        their posterior under the largest model, shape (w, h); lengths in mm.
    truncated
        Whether this posterior is that under condition T, that no compliance is negative.
    """
    models = NestedModels.of(bound)
    if models is None:
        return {}
    posteriors = models.posteriors(models.coefficients_given(phi), np.ones(len(models.prior_sd)))
    log_weight = np.zeros(len(phi))
    if truncated:
        # The evidences are taken relative to the largest model under condition T.
        log_weight = -posteriors[0].log_ratio
    sd = np.sqrt(averaged_variances(posteriors, log_weight))
    return {name: float(sd[k]) for k, name in models.stated.items()}
