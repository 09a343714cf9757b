"""Two campaigns of one kind of machine: by how much does every parameter differ, and with what
probability has it grown?

Before and after a repair, machine A and B. Independent instruments: the difference of independent
posteriors. The same bar, balls, mount and force device: their errors cancel (`instrument`).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import comb
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from scipy.special import ndtr, ndtri

from ldbb_bayes.analysis.circularity import offsets
from ldbb_bayes.errors import require
from ldbb_bayes.inference.posterior import bound_of, draws_of, record_of
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.terms import Columns, Term
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, readable
from ldbb_bayes.units import ranked

__all__ = ["differences"]

_LEARNT = 0.05
_DRAWS = 20_000


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


@one_blas_thread
def differences(
    posterior: xr.DataTree,
    other: xr.DataTree,
    *,
    same_instrument: bool = False,
    ci_prob: float = 0.95,
) -> pd.DataFrame:
    """Every parameter of ``other`` less that of ``posterior``.

    InputError for other machines, or a flat prior with ``same_instrument``.

    Parameters
    ----------
    posterior, other : of machines with the same topology, planes and joint frames.
    same_instrument : whether bar, balls, mount and force device were the same.
    ci_prob : float

    Returns
    -------
    One row per parameter both have, offsets of the tool ball left out: unit, first, second (means,
    at the first one's reference force), difference, sd, ci_low, ci_high, probability_of_increase.
    ``attrs["conflict"]``: of one instrument, the coefficient in which the campaigns disagree most
    about it, and the p-value of that (Bonferroni); else None.
    """
    check_probability(ci_prob)
    one = bound_of(posterior)
    two = bound_of(other)
    _check(one, two, record_of(other)["campaign"]["name"])
    names = [
        name
        for name, offset in zip(one.names, offsets(one), strict=True)
        if not offset and name in two.names
    ]
    at = one.setting.reference_force_N
    read = [_reading(bound, names, at) for bound in (one, two)]
    levels = 0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob
    drawn = [
        draws_of(tree, bound) for tree, bound in zip((posterior, other), (one, two), strict=True)
    ]
    conflict = None
    if same_instrument:
        means, mean, sd, conflict = _of_one_instrument(
            (one, two), [phi.mean(axis=0) for _, phi in drawn], read
        )
        interval = mean + ndtri(np.array(levels))[:, None] * sd
        increase = ndtr(mean / sd)
    else:
        first, second = (beta @ rows.T for (beta, _), rows in zip(drawn, read, strict=True))
        means = np.array([first.mean(axis=0), second.mean(axis=0)])
        mean = means[1] - means[0]
        sd = np.sqrt(first.var(axis=0) + second.var(axis=0))
        rng = np.random.default_rng(0)
        apart = (
            second[rng.integers(len(second), size=_DRAWS)]
            - first[rng.integers(len(first), size=_DRAWS)]
        )
        interval = np.quantile(apart, levels, axis=0)
        increase = (apart > 0.0).mean(axis=0)
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
    return readable(table, f"Second less first, {100 * ci_prob:g} % intervals")


def _check(one: BoundModel, two: BoundModel, name: str) -> None:
    first = one.campaign
    second = two.campaign
    cure = "Name another campaign; to compare models of one campaign use compare."
    got = f"got {name!r} twice (SHA-256 {first.sha256[:12]}…). {cure}"
    require(first.sha256 != second.sha256, f"results must be of different readings, {got}")
    for what, own, others in (
        ("topology", first.topology, second.topology),
        ("frames_mm", first.frames_mm, second.frames_mm),
    ):
        cure = "Compare campaigns of one kind of machine."
        require(
            own == others,
            f"results must be of machines with the same {what}, got {own!r} and {others!r}"
            f" ({name!r}). {cure}",
        )
    got = f"got {', '.join(one.setting.planes)} and {', '.join(two.setting.planes)} ({name!r})"
    cure = "a compliance would stand for other sets. Compare campaigns of the same planes."
    require(
        {*one.setting.planes} == {*two.setting.planes},
        f"results must be of the same planes, {got}: {cure}",
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
            elif (
                parameter.group != "geometric"
                and parameter.compliance == own.compliance
                and power >= 0
            ):
                rows[i, j] = comb(parameter.degree, own.degree) * lever**power
    return rows
