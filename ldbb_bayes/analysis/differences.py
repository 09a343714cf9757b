"""Two campaigns of one kind of machine: by how much does every parameter differ, and with what probability has it grown?

Before and after a repair, machine A and B. Independent instruments: the difference of independent posteriors. The same bar,
balls, mount and force device: their errors cancel (`instrument`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import Any

import numpy as np
import pandas as pd
import scipy.linalg
import xarray as xr
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from ldbb_bayes.analysis.circularity import offsets
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.posterior import bound_of, check_probability, draws_of, record_of
from ldbb_bayes.jobs import one_blas_thread
from ldbb_bayes.model.hybrid import BoundModel, information_of
from ldbb_bayes.model.likelihood import Information
from ldbb_bayes.model.terms import Columns, Term
from ldbb_bayes.units import ranked

__all__ = ["differences"]

Array = NDArray[Any]
_LEARNT = 0.05


@dataclass(frozen=True, eq=False)
class _Together:
    """What both campaigns say: means (2, names), second less first with its covariance, and where they disagree most about the
    instrument, with the p-value of that (allowing for the number of coefficients; None where neither says anything)."""

    means: Array
    difference: Array
    covariance: Array
    conflict: tuple[str, float] | None


def _of_one_instrument(bounds: tuple[BoundModel, BoundModel], phi: tuple[Array, Array], read: Sequence[Array]) -> _Together:
    """Two campaigns run with one instrument; ``read``: rows that take β of each to the parameters compared, each (names, p)."""
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
    alike = [name for name, owner in pairs if owner in Term.kinds and Term.kinds[owner].instrument and name in told[1]]
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
    return _Together(rows @ mean, apart @ mean, apart @ covariance @ apart.T, _conflict(alike, told, information, means))


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
            found.append((name, float(abs(apart))))
    if not found:
        return None
    worst, apart = ranked(found, lambda pair: pair[1])[0]
    return worst, min(1.0, float(2.0 * ndtr(-apart)) * len(found))


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


_DRAWS = 20_000


@one_blas_thread
def differences(
    posterior: xr.DataTree, other: xr.DataTree, *, same_instrument: bool = False, ci_prob: float = 0.95
) -> pd.DataFrame:
    """Every parameter of ``other`` less that of ``posterior``.

    Parameters
    ----------
    posterior, other : DataTree
        Of machines with the same topology, planes and joint frames.
    same_instrument : bool
        Whether bar, balls, mount and force device were the same.
    ci_prob : float

    Returns
    -------
    DataFrame
        One row per parameter both have, offsets of the tool ball left out: unit, first, second (means, at the first one's
        reference force), difference, sd, ci_low, ci_high, probability_of_increase. ``attrs["conflict"]``: of one instrument, the
        coefficient in which the campaigns disagree most about it, and the p-value of that (Bonferroni); else None.

    Raises
    ------
    InputError
        For other machines, or a flat prior with ``same_instrument``.
    """
    check_probability(ci_prob)
    one, two = bound_of(posterior), bound_of(other)
    _check(one, two, record_of(other)["campaign"]["name"])
    names = [name for name, offset in zip(one.names, offsets(one), strict=True) if not offset and name in two.names]
    at = one.setting.reference_force_N
    read = [_reading(bound, names, at) for bound in (one, two)]
    low, high = 0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob
    conflict = None
    if same_instrument:
        phi = (draws_of(posterior, one)[1].mean(axis=0), draws_of(other, two)[1].mean(axis=0))
        shared = _of_one_instrument((one, two), phi, read)
        means, mean, sd = shared.means, shared.difference, np.sqrt(np.diag(shared.covariance))
        conflict = shared.conflict
        reach = float(ndtri(high)) * sd
        interval, increase = np.array([mean - reach, mean + reach]), ndtr(mean / sd)
    else:
        drawn = [
            draws_of(tree, bound)[0] @ rows.T for tree, bound, rows in zip((posterior, other), (one, two), read, strict=True)
        ]
        means = np.array([draws.mean(axis=0) for draws in drawn])
        mean, sd = means[1] - means[0], np.sqrt(drawn[0].var(axis=0) + drawn[1].var(axis=0))
        rng = np.random.default_rng(0)
        apart = drawn[1][rng.integers(len(drawn[1]), size=_DRAWS)] - drawn[0][rng.integers(len(drawn[0]), size=_DRAWS)]
        interval, increase = np.quantile(apart, [low, high], axis=0), (apart > 0.0).mean(axis=0)
    table = pd.DataFrame(
        {
            "unit": [one.parameters[one.names.index(name)].unit for name in names],
            "first": means[0],
            "second": means[1],
            "difference": mean,
            "sd": sd,
            "ci_low": interval[0],
            "ci_high": interval[1],
            "probability_of_increase": increase,
        },
        index=names,
    )
    table.attrs["conflict"] = conflict
    return table


def _check(one: BoundModel, two: BoundModel, name: str) -> None:
    first, second = one.campaign, two.campaign
    if first.sha256 == second.sha256:
        raise InputError(
            f"results must be of different readings, got {name!r} twice (SHA-256 {first.sha256[:12]}…). Name another campaign; "
            "to compare models of one campaign use compare."
        )
    for what in ("topology", "frames_mm"):
        if getattr(first, what) != getattr(second, what):
            raise InputError(
                f"results must be of machines with the same {what}, got {getattr(first, what)!r} and {getattr(second, what)!r} "
                f"({name!r}). Compare campaigns of one kind of machine."
            )
    if set(one.setting.planes) != set(two.setting.planes):
        raise InputError(
            f"results must be of the same planes, got {', '.join(one.setting.planes)} and {', '.join(two.setting.planes)} "
            f"({name!r}): a compliance would stand for other sets. Compare campaigns of the same planes."
        )


def _reading(bound: BoundModel, names: Sequence[str], reference_force_N: float) -> Array:
    """Rows that take β to these parameters at another reference force, shape (names, p)."""
    rows = np.zeros((len(names), len(bound.names)))
    lever = reference_force_N - bound.setting.reference_force_N
    for i, name in enumerate(names):
        own = bound.parameters[bound.names.index(name)]
        for j, parameter in enumerate(bound.parameters):
            power = parameter.degree - own.degree
            if own.group == "geometric":
                rows[i, j] = parameter.name == name
            elif parameter.group != "geometric" and parameter.compliance == own.compliance and power >= 0:
                rows[i, j] = comb(parameter.degree, own.degree) * lever**power
    return rows
