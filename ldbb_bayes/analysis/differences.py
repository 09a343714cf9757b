"""Two campaigns of one kind of machine: by how much does every parameter differ, and with what
probability has it grown?

Before and after a repair, machine A and B. Independent instruments: the difference of independent
posteriors. The same bar, balls, mount and force device: their errors cancel (`instrument`).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import comb

import numpy as np
import pandas as pd
import xarray as xr
from scipy.special import ndtr, ndtri

from ldbb_bayes.analysis.circle_columns import offsets
from ldbb_bayes.analysis.common_instrument import _of_one_instrument
from ldbb_bayes.errors import require
from ldbb_bayes.inference.posterior import bound_of, draws_of, record_of
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, readable

__all__ = ["differences"]

_DRAWS = 20_000


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
