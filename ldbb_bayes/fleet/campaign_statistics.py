"""Split from its neighbours; see there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms import Columns, Term
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array

__all__ = ["SufficientStatistics", "mixture_covariance", "sufficient_statistics"]


_CHUNK = 256


_SPARE = 1e-4


@dataclass(frozen=True, eq=False)
class SufficientStatistics:
    """Moments of a campaign's parameters and of the errors of its instrument. ``names`` are the p
    parameters of interest, then the coefficients of terms ``common`` to campaigns; q in all. Means
    and ``prior_sd`` have shape (q,), ``covariance`` (q, q)."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    mean: Array
    covariance: Array
    prior_mean: Array
    prior_sd: Array

    def columns(self) -> dict[str, list[Any]]:
        """As a batch keeps them: lists, of the covariance the lower triangle row by row."""
        plain = {
            f"gaussian_{name}": np.asarray(value).tolist() for name, value in vars(self).items()
        }
        return plain | {
            "gaussian_covariance": self.covariance[np.tril_indices(len(self.names))].tolist()
        }


@one_blas_thread
def sufficient_statistics(posterior: HyperPosterior) -> SufficientStatistics:
    """Return the posterior moments of a density that is not truncated, its prior not flat."""
    bound = posterior.bound
    pick, names, units, prior_mean, prior_sd = _columns(bound)
    free, weight = posterior.coarse.heaviest(_SPARE)
    means = []
    covariances = []
    for start in range(0, len(weight), _CHUNK):
        phi = bound.hyper_prior.phi(free[start : start + _CHUNK])
        _, shared = bound.collapsed.conditional(phi)
        spread = shared.spread(np.eye(shared.mean.shape[1])[pick])
        means.append(shared.mean[:, pick])
        covariances.append(spread @ np.swapaxes(spread, 1, 2))
    mean, covariance = mixture_covariance(
        weight, np.concatenate(means), np.concatenate(covariances)
    )
    mean[: len(bound.names)] += bound.centre
    return SufficientStatistics(names, units, mean, covariance, prior_mean, prior_sd)


def _columns(bound: BoundModel) -> tuple[list[int], tuple[str, ...], tuple[str, ...], Array, Array]:
    """Places among the shared coefficients, names, units and priors of parameters and instrument
    errors."""
    terms = [
        term for term in bound.nuisance_columns if isinstance(term, Columns) and not term.private
    ]
    nuisances = [
        (name, float(sd)) for term in terms for name, sd in zip(term.names, term.sd, strict=True)
    ]
    own = [
        (place, name, sd) for place, (name, sd) in enumerate(nuisances) if Term.owner(name).common
    ]
    pick = [
        *range(len(nuisances), len(nuisances) + len(bound.names)),
        *(place for place, _, _ in own),
    ]
    names = (*bound.names, *(name for _, name, _ in own))
    units = (
        *(parameter.unit for parameter in bound.parameters),
        *(Term.owner(name).unit_of(name).inside for _, name, _ in own),
    )
    prior_sd = np.concatenate([bound.prior_sd, [sd for _, _, sd in own]])
    return pick, names, units, np.concatenate([bound.prior_mean, np.zeros(len(own))]), prior_sd


def mixture_covariance(
    weight: Array, mean: Array, covariance: Array | float = 0.0
) -> tuple[Array, Array]:
    """Mean (q,) and covariance (q, q) of a mixture: weights (k,), means (k, q), covariances (k, q,
    q) or none."""
    middle = weight @ mean
    apart = mean - middle
    inside = (
        np.tensordot(weight, covariance, 1) if isinstance(covariance, np.ndarray) else covariance
    )
    return middle, inside + (apart.T * weight) @ apart
