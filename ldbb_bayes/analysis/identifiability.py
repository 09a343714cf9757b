"""Which numbers come from the readings, which from the prior, and which are two names for one thing.

Everything is of the linear Gaussian model at one value of the hyper-parameters φ, truncation set aside: no readings are needed,
and a plan can be asked before it is run. With readings φ is its posterior mean, without them its prior median.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from scipy.special import ndtr

from ldbb_bayes.analysis.confounding import Confounding
from ldbb_bayes.analysis.identified import Direction, Identifiability, ParameterIdentifiability
from ldbb_bayes.analysis.verdict import TENTH, verdict_of
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.origin import bound_of, draws_of
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.cures import cures
from ldbb_bayes.model.degeneracies import Degeneracy, degeneracies, standing_degeneracies
from ldbb_bayes.model.gaussian import least_squares
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.information import Information, information_of
from ldbb_bayes.threads import one_blas_thread

__all__ = ["identify", "overlap", "verdicts"]

Array = NDArray[Any]

_HALF = 0.5
_SHOWN = 3
_ROUNDING = 1e-12


@one_blas_thread
def identify(model: HybridModel, campaign: Campaign) -> Identifiability:
    """What the model can learn from a campaign, or could from a plan.

    Parameters
    ----------
    model : HybridModel
    campaign : Campaign
        A plan needs no readings.

    Raises
    ------
    InputError
        Where the model does not go with the campaign.
    """
    bound = model.bind(campaign)
    phi, mean = _hyper_and_mean(bound)
    information = information_of(bound, phi)
    found = degeneracies(bound)
    covariance = information.covariance()
    own = information.own
    entries = _parameters(bound, information, found, mean)
    directions, effective = _directions(information, covariance[np.ix_(own, own)])
    rows = np.concatenate([test.factor @ bound.interest[r] for r, test in enumerate(bound.reduced)])
    return Identifiability(
        entries,
        found,
        cures(bound, found),
        standing_degeneracies(bound, found),
        _alias_matrix(information, rows),
        _correlation(information, covariance),
        directions,
        effective,
        _condition(rows),
        _condition(rows * bound.scale),
        {name: float(value * 1e3) for name, value in zip(bound.hyper_prior.names, phi, strict=True)},
        not campaign.is_plan,
    )


@one_blas_thread
def verdicts(posterior: xr.DataTree) -> dict[str, ParameterIdentifiability]:
    """The same of every parameter of a posterior, at its mean hyper-parameters; mean, sd and contraction are the draws'."""
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound)
    prior_sd = [
        float(posterior["prior"][name].std()) if np.isfinite(nominal) else np.inf
        for name, nominal in zip(bound.names, bound.prior_sd, strict=True)
    ]
    information = information_of(bound, phi.mean(axis=0))
    drawn = (np.array(prior_sd), beta.std(axis=0))
    return _parameters(bound, information, degeneracies(bound), beta.mean(axis=0), drawn)


def _hyper_and_mean(bound: BoundModel) -> tuple[Array, Array]:
    """φ [mm] and the mean of β there."""
    if bound.campaign.is_plan:
        return bound.hyper_prior.quantile(np.full(len(bound.hyper_prior.names), _HALF)), bound.prior_mean
    lattice = HyperPosterior(bound, truncated=False).coarse
    phi = lattice.weight @ bound.hyper_prior.phi(lattice.free)
    _, given = bound.given(phi[None])
    return phi, given.mean[0]


def _parameters(
    bound: BoundModel,
    information: Information,
    found: tuple[Degeneracy, ...],
    mean: Array,
    drawn: tuple[Array, Array] | None = None,
) -> dict[str, ParameterIdentifiability]:
    """``drawn``: prior and posterior sd that replace the Gaussian's, truncation included."""
    confounding = Confounding(information)
    covariance = information.covariance()
    own, proper = information.own, not information.flat
    unseen = np.stack([confounding.unseen_share(least) if proper else np.zeros(len(own)) for least in (1.0, TENTH)])
    root, _ = information.root()
    precision = (root**2).sum(axis=0)
    correlation = _correlation(information, covariance)
    entries = {}
    for i, (k, parameter) in enumerate(zip(own, bound.parameters, strict=True)):
        sd, prior_sd = float(np.sqrt(covariance[k, k]) * information.scale[k]), parameter.prior_sd
        if drawn is not None:
            prior_sd, sd = float(drawn[0][i]), float(drawn[1][i])
        ratio = (sd / prior_sd) ** 2
        fraction = {term: float(values[i]) for term, values in confounding.fraction.items()}
        others = correlation[parameter.name].drop(parameter.name)
        largest = others.reindex(others.abs().sort_values(ascending=False).index)[:_SHOWN]
        rivals = {name: float(others[name] ** 2) for name in bound.names if name != parameter.name}
        mine = tuple(d for d in found if parameter.name in d.parameters)
        verdict = verdict_of(confounding, i, rivals, unseen[:, i], 1.0 - ratio, mine)
        entries[parameter.name] = ParameterIdentifiability(
            parameter.name,
            parameter.unit,
            prior_sd,
            float(mean[i]),
            sd,
            1.0 - ratio,
            float(-0.5 * np.log(ratio)) if proper else np.inf,
            overlap((float(mean[i]) - parameter.prior_mean) / prior_sd, np.sqrt(ratio)) if proper else 0.0,
            fraction,
            {source: float(values[i]) for source, values in confounding.shares.items()},
            {source: float(values[i]) for source, values in confounding.sensitivity.items()},
            float(covariance[k, k] * precision[k]),
            {str(name): float(value) for name, value in largest.items()},
            float(unseen[0, i]),
            verdict,
            parameter.prior_mean,
        )
    return entries


def overlap(mean: float, sd: float) -> float:
    """Area common to N(0, 1) and N(mean, sd²), 0 … 1; mean and sd in units of the prior sd."""
    if abs(sd - 1.0) < 1e-9:
        return float(2.0 * ndtr(-abs(mean) / 2.0))
    # The densities cross where (x − mean)² / sd² + 2 ln sd = x².
    a, b, c = 1.0 / sd**2 - 1.0, -2.0 * mean / sd**2, mean**2 / sd**2 + 2.0 * np.log(sd)
    low, high = sorted(((-b - np.sqrt(b * b - 4 * a * c)) / (2 * a), (-b + np.sqrt(b * b - 4 * a * c)) / (2 * a)))
    wide = ndtr(high) - ndtr(low)
    narrow = ndtr((high - mean) / sd) - ndtr((low - mean) / sd)
    return float(min(1.0, 1.0 - abs(narrow - wide)))


def _directions(information: Information, covariance: Array) -> tuple[tuple[Direction, ...], float]:
    """Eigenvectors of the prior-whitened posterior covariance of the parameters of interest, and Σ λ / (1 + λ)."""
    names = [information.names[i] for i in information.own]
    if information.flat:
        return (), float(len(names))
    kept, vectors = np.linalg.eigh(covariance)
    kept = np.clip(kept, np.finfo(float).tiny, 1.0)
    found = []
    for value, vector in zip(kept, vectors.T, strict=True):
        sign = np.sign(vector[np.argmax(np.abs(vector))])
        found.append(Direction(float(1.0 / value - 1.0), dict(zip(names, (sign * vector).tolist(), strict=True))))
    return tuple(found), float((1.0 - kept).sum())


def _condition(rows: Array) -> float:
    singular = np.linalg.svd(rows, compute_uv=False)
    dependent = len(rows) < rows.shape[1] or singular[-1] <= np.finfo(float).eps * max(rows.shape) * singular[0]
    return np.inf if dependent else float(singular[0] / singular[-1])


def _alias_matrix(information: Information, rows: Array) -> pd.DataFrame:
    own = information.own
    others = np.setdiff1d(np.arange(len(information.names)), own)
    every = np.concatenate(information.design)
    moved = [least_squares(rows, every[:, j] * information.scale[j], information.scale[own]) for j in others]
    names = [information.names[i] for i in own]
    table = np.array(moved).reshape(len(others), len(own)).T
    table[np.abs(table) < _ROUNDING * information.scale[own, None]] = 0.0
    return pd.DataFrame(table, names, [information.names[j] for j in others])


def _correlation(information: Information, covariance: Array) -> pd.DataFrame:
    sd = np.sqrt(np.diag(covariance))
    names = list(information.names)
    return pd.DataFrame(covariance / np.outer(sd, sd), names, names)
