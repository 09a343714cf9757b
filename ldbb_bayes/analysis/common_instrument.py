"""The difference of two campaigns run with one instrument, whose errors cancel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from ldbb_bayes.errors import require
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.terms import Columns, Term
from ldbb_bayes.results import Array
from ldbb_bayes.units import ranked

_LEARNT = 0.05


class _Together(NamedTuple):
    """What both campaigns say: means (2, names), second less first with its sd, and where they
    disagree most about the instrument, with the p-value of that (allowing for the number of
    coefficients; None where neither says anything)."""

    means: Array
    difference: Array
    sd: Array
    conflict: tuple[str, float] | None


def _of_one_instrument(
    bounds: Sequence[BoundModel], phi: Sequence[Array], read: Sequence[Array]
) -> _Together:
    """Two campaigns run with one instrument; ``read``: rows that take β of each to the parameters
    compared, each (names, p)."""
    if (
        len(
            {
                (test.work_ball_deg % 360.0, test.tool_ball_deg % 360.0)
                for own in bounds
                for test in own.campaign.tests
            }
        )
        > 1
    ):
        bounds = [bound.with_two_balls() for bound in bounds]
    for name in ("tau", "decay"):
        if any(name not in bound.hyper_prior.names for bound in bounds):
            continue
        at = [bound.hyper_prior.names.index(name) for bound in bounds]
        phi[0][at[0]] = phi[1][at[1]] = 0.5 * (phi[0][at[0]] + phi[1][at[1]])
    information = [information_of(bound, values) for bound, values in zip(bounds, phi, strict=True)]
    said = "same_instrument must go with proper priors, got flat ones. Fit with the default preset."
    require(not any(own.flat for own in information), said)
    # Bar lengths are the same only of the same radius.
    lengths = [{"bar_length": f"bar_length_{bound.setting.radii_mm[0]:g}"} for bound in bounds]
    names = [
        [own.get(name, name) for name in found.names]
        for own, found in zip(lengths, information, strict=True)
    ]
    of_instrument = [
        owner in Term.kinds and Term.kinds[owner].instrument for owner in information[0].owners
    ]
    alike = [
        name
        for name, shared in zip(names[0], of_instrument, strict=True)
        if shared and name in names[1]
    ]
    apart = [name for name in names[1] if name not in alike]
    place = [
        list(range(len(names[0]))),
        [names[0].index(n) if n in alike else len(names[0]) + apart.index(n) for n in names[1]],
    ]
    means = [_mean(bound, values) for bound, values in zip(bounds, phi, strict=True)]
    size = len(names[0]) + len(apart)
    # The prior of what both have is in both posteriors and counts once.
    again = np.array([names[0].index(name) for name in alike], dtype=int)
    prior = np.zeros((size, size))
    prior[again, again] = information[0].scale[again] ** -2.0
    both = Gaussian(-prior, np.zeros(size))
    rows = np.zeros((2, len(read[0]), size))
    for k, (own, mean) in enumerate(zip(information, means, strict=True)):
        root = own.root()[0] / own.scale
        precision = np.zeros((size, size))
        shift = np.zeros(size)
        precision[np.ix_(place[k], place[k])] = root.T @ root
        shift[place[k]] = root.T @ (root @ mean)
        both = both + Gaussian(precision, shift)
        rows[k][:, place[k][: read[k].shape[1]]] = read[k]
    sd = np.sqrt((both.spread(rows[1] - rows[0]) ** 2).sum(axis=1))
    return _Together(
        rows @ both.mean,
        (rows[1] - rows[0]) @ both.mean,
        sd,
        _conflict(alike, names, information, means),
    )


def _conflict(
    alike: Sequence[str],
    names: Sequence[Sequence[str]],
    information: Sequence[Information],
    means: Sequence[Array],
) -> tuple[str, float] | None:
    """Where the readings of both, each by itself, disagree most about a coefficient: what they say
    of it beyond its prior, n ± 1/√l with l = 1/Var(ν | y) − 1/S, must be the same number."""
    places = np.array([[own.index(name) for name in alike] for own in names], dtype=int)
    scale = np.array([own.scale[at] for own, at in zip(information, places, strict=True)])
    variance = np.array(
        [np.diag(own.covariance())[at] for own, at in zip(information, places, strict=True)]
    )
    mean = np.array([own[at] for own, at in zip(means, places, strict=True)])
    learnt = 1.0 / variance - 1.0
    precision = learnt / scale**2
    seen = np.flatnonzero(precision.min(axis=0) * scale[0] ** 2 > _LEARNT).tolist()
    if not seen:
        return None
    stated = mean / (variance * np.maximum(learnt, _LEARNT))
    apart = {
        alike[j]: float(abs(stated[0, j] - stated[1, j]) / np.sqrt((1.0 / precision[:, j]).sum()))
        for j in seen
    }
    worst = ranked(apart, apart.__getitem__)[0]
    return worst, min(1.0, float(2.0 * ndtr(-apart[worst])) * len(seen))


def _mean(bound: BoundModel, phi: Array) -> Array:
    """Posterior mean of parameters and shared nuisances at φ, in the order of `information_of`."""
    beta = bound.given(phi[None])[1].mean[0]
    if not any(isinstance(term, Columns) and not term.private for term in bound.nuisance_columns):
        return np.asarray(beta)
    _, nuisances = bound.given_interest.conditional(phi[None], (beta - bound.centre)[None])
    return np.concatenate([beta, nuisances.mean[0]])
