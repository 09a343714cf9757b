"""Sufficient statistics of one campaign: moments of its parameters and of instrument errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms import Columns, Term
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array

__all__ = ["SufficientStatistics", "mixture_covariance", "sufficient_statistics"]

# Nodes whose conditional Gaussians are worked on at once.
_NODES_AT_ONCE = 256
# Weight of the lightest nodes, which together are left out of the moments.
_NEGLECTED_WEIGHT = 1e-4


@dataclass(frozen=True, eq=False)
class SufficientStatistics:
    """Moments of a campaign's parameters and of the errors of its instrument.

    There are q of them: the p parameters of interest, then the coefficients of terms ``common`` to
    campaigns.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    mean: Array  #: shape (q,), in inside units, like the rest
    covariance: Array  #: shape (q, q)
    prior_mean: Array  #: shape (q,)
    prior_sd: Array  #: shape (q,)

    def columns(self) -> dict[str, list[Any]]:
        """Return the columns of a batch's table: lists.

        Of the covariance they hold the lower triangle, row by row.
        """
        lists: dict[str, list[Any]] = {}
        for name, value in vars(self).items():
            lists[f"gaussian_{name}"] = np.asarray(value).tolist()
        triangle = self.covariance[np.tril_indices(len(self.names))]
        lists["gaussian_covariance"] = triangle.tolist()
        return lists


@one_blas_thread
def sufficient_statistics(posterior: HyperPosterior) -> SufficientStatistics:
    """Return the posterior moments of parameters and instrument errors.

    Parameters
    ----------
    posterior : one that is not truncated; its prior must not be flat.
    """
    bound = posterior.bound
    chosen = _choose_coefficients(bound)
    nodes, weight = posterior.coarse.heaviest(_NEGLECTED_WEIGHT)
    means = []
    covariances = []
    for start in range(0, len(weight), _NODES_AT_ONCE):
        phi = bound.hyper_prior.phi(nodes[start : start + _NODES_AT_ONCE])
        _, coefficients = bound.collapsed.conditional(phi)
        selector = np.eye(coefficients.mean.shape[1])[chosen.places]
        spread = coefficients.spread(selector)
        means.append(coefficients.mean[:, chosen.places])
        covariances.append(spread @ np.swapaxes(spread, 1, 2))
    mean, covariance = mixture_covariance(
        weight, np.concatenate(means), np.concatenate(covariances)
    )
    mean[: len(bound.names)] += bound.centre
    return SufficientStatistics(
        names=chosen.names,
        units=chosen.units,
        mean=mean,
        covariance=covariance,
        prior_mean=chosen.prior_mean,
        prior_sd=chosen.prior_sd,
    )


class _ChosenCoefficients(NamedTuple):
    """Parameters, then instrument errors: q of the coefficients of a bound model."""

    places: list[int]  #: among the coefficients that all tests share
    names: tuple[str, ...]
    units: tuple[str, ...]
    prior_mean: Array  #: shape (q,)
    prior_sd: Array  #: shape (q,)


def _choose_coefficients(bound: BoundModel) -> _ChosenCoefficients:
    """Return the coefficients that campaigns have in common; nuisances stand before parameters."""
    nuisance_sds: list[tuple[str, float]] = []
    for term in bound.nuisance_columns:
        if isinstance(term, Columns) and not term.private:
            nuisance_sds += zip(term.names, map(float, term.sd), strict=True)
    first_parameter = len(nuisance_sds)
    places = list(range(first_parameter, first_parameter + len(bound.names)))
    names = list(bound.names)
    units = [parameter.unit for parameter in bound.parameters]
    instrument_sds = []
    for place, (name, sd) in enumerate(nuisance_sds):
        owner = Term.owner(name)
        if owner.common:
            places.append(place)
            names.append(name)
            units.append(owner.unit_of(name).inside)
            instrument_sds.append(sd)
    return _ChosenCoefficients(
        places=places,
        names=tuple(names),
        units=tuple(units),
        prior_mean=np.concatenate([bound.prior_mean, np.zeros(len(instrument_sds))]),
        prior_sd=np.concatenate([bound.prior_sd, instrument_sds]),
    )


def mixture_covariance(
    weight: Array, mean: Array, covariance: Array | None = None
) -> tuple[Array, Array]:
    """Return the mean (q,) and the covariance (q, q) of a mixture.

    Parameters
    ----------
    weight : of the components, shape (k,).
    mean : of the components, shape (k, q).
    covariance : of the components, shape (k, q, q); None: zero.
    """
    centre = weight @ mean
    deviation = mean - centre
    between = (deviation.T * weight) @ deviation
    if covariance is None:
        return centre, between
    return centre, np.tensordot(weight, covariance, 1) + between
