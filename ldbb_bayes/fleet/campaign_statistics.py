"""Sufficient statistics of one campaign: moments of its parameters and of further coefficients.

Analyses of many campaigns need no other results of a campaign's fit. Parameters are compliances,
their changes with force (slopes) and geometric errors. The further coefficients are modelled but
not of interest (nuisance coefficients). They are errors of the instrument, of the mount's
deflection and of the force, and coefficients of the machine. Those of `JointLoad` describe how
direct compliances change with force in addition to their slopes, those of `Position` how they
change along the travel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms import Columns, JointLoad, Position, Term
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array

__all__ = ["SufficientStatistics", "mixture_covariance", "sufficient_statistics"]

# Number of nodes that are processed at once. A node is a value of the hyper-parameters (such as the
# standard deviation of the noise). At each node, all other unknowns have a Gaussian distribution,
# whose mean and covariance are computed.
_NODES_AT_ONCE = 256
# Number of nodes over which the moments of the parameters are averaged. A node is a value of the
# hyper-parameters (such as the standard deviation of the noise). The nodes are selected with
# probabilities proportional to their weights. With this number, the numerical error of a mean is a
# small fraction of the parameter's standard uncertainty.
_NODES = 512
# Seed of the random selection of nodes. A node is a weighted value of the hyper-parameters; the
# moments of a campaign's parameters are averaged over the selected nodes.
_SEED = 0


@dataclass(frozen=True, eq=False)
class SufficientStatistics:
    """Posterior moments of a campaign's parameters and of further coefficients.

    There are q quantities: first the parameters (compliances, their changes with force, geometric
    errors), then further coefficients. These are properties of the instrument (the mount's
    deflection and errors of the force), which have the same values in all campaigns with the same
    instrument, and coefficients of `JointLoad` and `Position`, which describe the machine. The
    mount's deflection is its nominal value plus the coefficient of the model, because campaigns
    with the same mount may state different nominal values. So is the gain of the force, whose
    nominal value is the logarithm of the slope of the force law. All moments are in internal units
    (mm, N, rad).
    """

    #: names of the q parameters and further coefficients of a campaign's fit
    names: tuple[str, ...]
    #: internal units of all q quantities (parameters and further coefficients); each unit is a
    #: product of powers of mm, N and rad, such as mm/N
    units: tuple[str, ...]
    mean: Array  #: posterior means of the q parameters and further coefficients, shape (q,)
    #: posterior covariance matrix of the q parameters and further coefficients, shape (q, q)
    covariance: Array
    prior_mean: Array  #: prior means of the q parameters and further coefficients, shape (q,)
    #: prior standard deviations of the q parameters and further coefficients, shape (q,)
    prior_sd: Array

    def columns(self) -> dict[str, list[Any]]:
        """Return the moments of the campaign as a dictionary of lists.

        The moments are posterior means and covariances, and prior means and standard deviations.
        The keys of the result are the names of the columns in a batch's table. The list for the
        covariance matrix contains only the lower triangle of the matrix, row by row.
        """
        lists: dict[str, list[Any]] = {}
        for name, value in vars(self).items():
            lists[f"gaussian_{name}"] = np.asarray(value).tolist()
        triangle = self.covariance[np.tril_indices(len(self.names))]
        lists["gaussian_covariance"] = triangle.tolist()
        return lists


@one_blas_thread
def sufficient_statistics(posterior: HyperPosterior) -> SufficientStatistics:
    """Return the posterior moments of a campaign's parameters and of further coefficients.

    Further coefficients are errors of the instrument and coefficients of `JointLoad` and
    `Position`; see `SufficientStatistics`.

    Parameters
    ----------
    posterior : posterior density of the campaign's hyper-parameters (scales of the noise and of
        other effects). It must be the posterior of a model that allows negative compliances and
        whose priors are not flat, because a flat prior has no standard deviation. The function does
        not check this.
    """
    bound = posterior.bound
    chosen = _choose_coefficients(bound)
    nodes = posterior.weighted_sample.resample(_NODES, np.random.default_rng(_SEED))
    means = []
    covariances = []
    for start in range(0, _NODES, _NODES_AT_ONCE):
        phi = bound.hyper_prior.phi(nodes[start : start + _NODES_AT_ONCE])
        _, coefficients = bound.collapsed.conditional_of(chosen.places, phi)
        means.append(coefficients.mean)
        covariances.append(coefficients.covariance)
    weight = np.full(_NODES, 1.0 / _NODES)
    mean, covariance = mixture_covariance(
        weight, np.concatenate(means), np.concatenate(covariances)
    )
    mean[: len(bound.names)] += bound.least_squares_estimate
    mean[len(bound.names) :] += chosen.prior_mean[len(bound.names) :]
    return SufficientStatistics(
        names=chosen.names,
        units=chosen.units,
        mean=mean,
        covariance=covariance,
        prior_mean=chosen.prior_mean,
        prior_sd=chosen.prior_sd,
    )


class _ChosenCoefficients(NamedTuple):
    """The q coefficients whose posterior moments are computed: parameters, then others.

    The others are errors of the instrument and coefficients of `JointLoad` and `Position`; see
    `SufficientStatistics`.
    """

    #: indices of the q parameters and further coefficients in the vector that holds all
    #: coefficients common to the tests of a campaign
    places: list[int]
    names: tuple[str, ...]  #: names of the q parameters and further coefficients of a campaign
    #: internal units of all q quantities (parameters and further coefficients); each unit is a
    #: product of powers of mm, N and rad, such as mm/N
    units: tuple[str, ...]
    #: prior means of the q parameters and further coefficients in mm, N and rad, shape (q,)
    prior_mean: Array
    #: prior standard deviations of the q parameters and further coefficients in mm, N and rad,
    #: shape (q,)
    prior_sd: Array


def _choose_coefficients(bound: BoundModel) -> _ChosenCoefficients:
    """Return the coefficients whose moments are computed: parameters, then others.

    ``bound`` is a model applied to one campaign. The vector of all its coefficients begins with the
    nuisance coefficients, that is, with effects that are modelled but not of interest, such as
    instrument errors. The result, in contrast, begins with the parameters.
    """
    nuisance_sds: list[tuple[str, float]] = []
    for term in bound.nuisance_columns:
        if isinstance(term, Columns) and not term.private:
            nuisance_sds += zip(term.names, map(float, term.sd), strict=True)
    first_parameter = len(nuisance_sds)
    places = list(range(first_parameter, first_parameter + len(bound.names)))
    names = list(bound.names)
    units = [parameter.unit for parameter in bound.parameters]
    further_means = []
    further_sds = []
    for place, (name, sd) in enumerate(nuisance_sds):
        owner = Term.owner(name)
        if owner.common or owner in (JointLoad, Position):
            places.append(place)
            names.append(name)
            units.append(owner.unit_of(name).inside)
            further_means.append(owner.nominal(name, bound.campaign))
            further_sds.append(sd)
    return _ChosenCoefficients(
        places=places,
        names=tuple(names),
        units=tuple(units),
        prior_mean=np.concatenate([bound.prior_mean, further_means]),
        prior_sd=np.concatenate([bound.prior_sd, further_sds]),
    )


def mixture_covariance(
    weight: Array, mean: Array, covariance: Array | None = None
) -> tuple[Array, Array]:
    """Return the mean (q,) and covariance (q, q) of a weighted mixture of k distributions.

    Each distribution describes the same vector of q elements.

    Parameters
    ----------
    weight : weights of the k distributions, which sum to one, shape (k,).
    mean : means of the distributions, shape (k, q).
    covariance : covariances of the distributions, shape (k, q, q). None means that all covariances
        are zero.
    """
    centre = weight @ mean
    deviation = mean - centre
    between = (deviation.T * weight) @ deviation
    if covariance is None:
        return centre, between
    return centre, np.tensordot(weight, covariance, 1) + between
