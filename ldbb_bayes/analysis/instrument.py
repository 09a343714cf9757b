"""Two campaigns run with the same bar, balls, mount and force device.

Errors ν of the instrument are the same in both and cancel in differences, as far as the two campaigns see them alike. With
(β₁, ν) and (β₂, ν) Gaussian given the readings of each, and ν ~ N(0, S), precisions add and the prior of ν is taken out once:
Λ = Λ₁ + Λ₂ − S⁻¹ (truncation set aside, hyper-parameters at their means, the size of the form at the mean of both).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.special import ndtr

from ldbb_bayes.errors import InputError
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.columns import Columns
from ldbb_bayes.model.information import Information, information_of

__all__ = ["INSTRUMENT", "SharedInstrument", "same_instrument_means"]

Array = NDArray[Any]
INSTRUMENT = ("BallForm", "BarLength", "Mount", "ForceError")
_LEARNT = 0.05


@dataclass(frozen=True, eq=False)
class SharedInstrument:
    """What both campaigns say together.

    Attributes
    ----------
    means : ndarray, shape (2, names)
        Of the parameters of each.
    difference : ndarray, shape (names,)
        Second less first.
    covariance : ndarray, shape (names, names)
        Of the difference.
    conflict : (coefficient, p-value), or None
        Where they disagree most about the instrument, allowing for the number of coefficients; None where neither tells any.
    """

    means: Array
    difference: Array
    covariance: Array
    conflict: tuple[str, float] | None


def same_instrument_means(
    bounds: tuple[BoundModel, BoundModel], phi: tuple[Array, Array], read: Sequence[Array]
) -> SharedInstrument:
    """Means and differences of two campaigns run with one instrument.

    Parameters
    ----------
    bounds : of both campaigns
    phi : of both, each (h,) [mm]
    read : of both, rows that take β to the parameters compared, each (names, p)

    Raises
    ------
    InputError
        For flat priors.
    """
    if len({(test.work_ball_deg % 360.0, test.tool_ball_deg % 360.0) for own in bounds for test in own.campaign.tests}) > 1:
        bounds = (bounds[0].with_two_balls(), bounds[1].with_two_balls())
    one, two = bounds
    if "tau" in one.hyper_prior.names and "tau" in two.hyper_prior.names:
        i, j = one.hyper_prior.names.index("tau"), two.hyper_prior.names.index("tau")
        phi[0][i] = phi[1][j] = 0.5 * (phi[0][i] + phi[1][j])
    information = [information_of(bound, values) for bound, values in zip(bounds, phi, strict=True)]
    if any(own.flat for own in information):
        raise InputError("same_instrument must go with proper priors, got flat ones. Fit with the default preset.")
    told = [[_physical(name, bound) for name in own.names] for bound, own in zip(bounds, information, strict=True)]
    pairs = zip(told[0], information[0].owners, strict=True)
    alike = [name for name, owner in pairs if owner in INSTRUMENT and name in told[1]]
    place: dict[tuple[int, str], int] = {}
    for k, names in enumerate(told):
        for name in names:
            place[k, name] = place[0, name] if k and name in alike else len(set(place.values()))
    means = [_mean(bound, values) for bound, values in zip(bounds, phi, strict=True)]
    size = len(set(place.values()))
    precision, weighted, scale = np.zeros((size, size)), np.zeros(size), np.ones(size)
    for k, own in enumerate(information):
        at = [place[k, name] for name in told[k]]
        root, _ = own.root()
        inside = (root.T @ root) / np.outer(own.scale, own.scale)
        precision[np.ix_(at, at)] += inside
        weighted[at] += inside @ means[k]
        scale[at] = own.scale
    again = [place[0, name] for name in alike]
    precision[again, again] -= scale[again] ** -2.0
    cholesky = np.linalg.cholesky(precision * np.outer(scale, scale))
    covariance = scipy.linalg.cho_solve((cholesky, True), np.eye(size)) * np.outer(scale, scale)
    mean = covariance @ weighted
    rows = np.zeros((2, len(read[0]), size))
    for k, bound in enumerate(bounds):
        rows[k][:, [place[k, name] for name in bound.names]] = read[k]
    apart = rows[1] - rows[0]
    return SharedInstrument(rows @ mean, apart @ mean, apart @ covariance @ apart.T, _conflict(alike, told, information, means))


def _conflict(
    alike: Sequence[str], told: Sequence[Sequence[str]], information: Sequence[Information], means: Sequence[Array]
) -> tuple[str, float] | None:
    """Where the readings of both, each by itself, disagree most about a coefficient: what they say of it beyond its prior,
    n ± 1/√l with l = 1/Var(ν | y) − 1/S, must be the same number."""
    found = []
    covariances = [np.diag(own.covariance()) for own in information]
    for name in alike:
        said, precision = [], []
        for names, own, variance, mean in zip(told, information, covariances, means, strict=True):
            j = names.index(name)
            learnt = 1.0 / variance[j] - 1.0
            precision.append(learnt / own.scale[j] ** 2)
            said.append(mean[j] / (variance[j] * max(learnt, _LEARNT)))
        if min(precision) * information[0].scale[told[0].index(name)] ** 2 > _LEARNT:
            apart = (said[0] - said[1]) / np.sqrt(1.0 / precision[0] + 1.0 / precision[1])
            found.append((name, float(2.0 * ndtr(-abs(apart)))))
    if not found:
        return None
    worst, p = min(found, key=lambda pair: pair[1])
    return worst, min(1.0, p * len(found))


def _physical(name: str, bound: BoundModel) -> str:
    """The coefficient's name, with the radius that a bar length is of."""
    return f"bar_length_{bound.setting.radii_mm[0]:g}" if name == "bar_length" else name


def _mean(bound: BoundModel, phi: Array) -> Array:
    """Posterior mean of parameters and shared nuisances at φ, in the order of `information_of`."""
    beta = bound.given(phi[None])[1].mean[0]
    if not any(isinstance(term, Columns) and not term.private for term in bound.nuisance_columns):
        return np.asarray(beta)
    _, nuisances = bound.given_interest.conditional(phi[None], (beta - bound.centre)[None])
    return np.concatenate([beta, nuisances.mean[0]])
