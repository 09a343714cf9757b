"""(β, b) | y ≈ N(mean, covariance), truncation left aside: what a campaign says of its parameters and of its instrument.

b are the instrument's own errors, the mount's deflection and the gain of the force: they are the same in every campaign run
with the same bar, and must not average out over campaigns. Given the hyper-parameters φ everything is Gaussian; over φ, on the
nodes of p(φ | y), mean and covariance follow by the laws of total expectation and variance. With the prior divided out they are
the likelihood of many campaigns' parameters, at a cost that does not grow with readings.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.marginals import nodes_that_matter
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.columns import Columns
from ldbb_bayes.threads import one_blas_thread

__all__ = ["INSTRUMENT", "SufficientStatistics", "sufficient_statistics"]

Array = NDArray[Any]
INSTRUMENT = {"mount": "mm/bar", "force_gain": "1"}
_CHUNK = 256
_SPARE = 1e-4


@dataclass(frozen=True, eq=False)
class SufficientStatistics:
    """Moments of a campaign's parameters and instrument errors.

    Attributes
    ----------
    names : tuple of str
        The p parameters of interest, then those of ``mount`` and ``force_gain`` that the model has; q in all.
    units : tuple of str
    mean : ndarray, shape (q,)
    covariance : ndarray, shape (q, q)
    prior_mean, prior_sd : ndarray, shape (q,)
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    mean: Array
    covariance: Array
    prior_mean: Array
    prior_sd: Array

    def columns(self) -> dict[str, list[Any]]:
        """As a batch keeps them: lists, of the covariance the lower triangle row by row."""
        return {
            "gaussian_names": list(self.names),
            "gaussian_units": list(self.units),
            "gaussian_mean": self.mean.tolist(),
            "gaussian_covariance": self.covariance[np.tril_indices(len(self.names))].tolist(),
            "gaussian_prior_mean": self.prior_mean.tolist(),
            "gaussian_prior_sd": self.prior_sd.tolist(),
        }


@one_blas_thread
def sufficient_statistics(posterior: HyperPosterior) -> SufficientStatistics:
    """Posterior moments with the truncation left aside.

    Parameters
    ----------
    posterior : HyperPosterior
        Not truncated.

    Raises
    ------
    InputError
        For a truncated density, or a flat prior.
    """
    bound = posterior.bound
    if posterior.truncated or bound.model.prior.flat:
        kind = "a truncated density" if posterior.truncated else "a flat prior"
        raise InputError(f"sufficient statistics must be those of a Gaussian with a proper prior, got {kind}. Use another.")
    pick, names, units, prior_mean, prior_sd = _columns(bound)
    free, weight = nodes_that_matter(posterior.coarse, _SPARE)
    means, spreads = [], []
    for start in range(0, len(weight), _CHUNK):
        phi = bound.hyper_prior.phi(free[start : start + _CHUNK])
        _, shared = bound.collapsed.conditional(phi, np.zeros(len(bound.names)))
        inverse = np.linalg.inv(shared.precision_root)
        spread = (np.swapaxes(inverse, 1, 2) * shared.scale[:, :, None])[:, pick]
        means.append(shared.mean[:, pick])
        spreads.append(spread @ np.swapaxes(spread, 1, 2))
    every = np.concatenate(means)
    mean = weight @ every
    apart = every - mean
    covariance = np.einsum("w,wij->ij", weight, np.concatenate(spreads)) + np.einsum("w,wi,wj->ij", weight, apart, apart)
    mean[: len(bound.names)] += bound.centre
    return SufficientStatistics(names, units, mean, covariance, prior_mean, prior_sd)


def _columns(bound: BoundModel) -> tuple[list[int], tuple[str, ...], tuple[str, ...], Array, Array]:
    """Places among the shared coefficients, names, units and priors of parameters and instrument errors."""
    terms = [term for term in bound.nuisance_columns if isinstance(term, Columns) and not term.private]
    nuisances = [(name, float(sd)) for term in terms for name, sd in zip(term.names, term.sd, strict=True)]
    own = [(place, name, sd) for place, (name, sd) in enumerate(nuisances) if name in INSTRUMENT]
    pick = [*range(len(nuisances), len(nuisances) + len(bound.names)), *(place for place, _, _ in own)]
    names = (*bound.names, *(name for _, name, _ in own))
    units = (*(parameter.unit for parameter in bound.parameters), *(INSTRUMENT[name] for _, name, _ in own))
    prior_sd = np.concatenate([bound.prior_sd, [sd for _, _, sd in own]])
    return pick, names, units, np.concatenate([bound.prior_mean, np.zeros(len(own))]), prior_sd
