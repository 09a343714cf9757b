"""Two campaigns of one kind of machine: by how much does every parameter differ, and with what probability has it grown?

Before and after a repair, machine A and B. Independent instruments: the difference of independent posteriors. The same bar,
balls, mount and force device: their errors cancel (`instrument`).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import comb
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from ldbb_bayes.analysis.circularity import offsets
from ldbb_bayes.analysis.instrument import same_instrument_means
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.origin import bound_of, draws_of, record_of
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.threads import one_blas_thread

__all__ = ["differences"]

Array = NDArray[Any]
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
        shared = same_instrument_means((one, two), phi, read)
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
