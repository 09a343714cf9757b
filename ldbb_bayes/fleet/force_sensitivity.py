"""Sensitivity of the compliances to errors of the force, the same in all campaigns.

The readings of campaign i depend on the compliances C and on the gain error g of the force through
C + g Ĉ_i, where Ĉ_i are the compliances that this campaign estimates. The noise of the readings
is in Ĉ_i too. Over many campaigns of one instrument, the product g Ĉ_i would therefore explain this
noise, and the differences between machines, and g would be found where no readings can tell it. So
Ĉ_i is replaced by Ĉ, the median over the campaigns. The curvature κ of the force is treated
likewise. With the largest force F_max it adds κ 4 (1 − F/F_max) Ĉ_i to the compliances at the force
F, and −κ 4 Ĉ_i/F_max to the slopes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.results import Array
from ldbb_bayes.units import is_compliance_or_slope

__all__ = ["with_common_sensitivity"]


def with_common_sensitivity(
    likelihood: Gaussian, names: Sequence[str], rows: pd.DataFrame, force_N: float
) -> Gaussian:
    """Return likelihoods with the same sensitivity to errors of the force in all campaigns.

    Let x be the q quantities and d = Ĉ − Ĉ_i. The likelihood is taken at C + g d, that is, at T x
    with a matrix T of the campaign. Those of the result are Tᵀ Λ T and Tᵀ η.

    Parameters
    ----------
    likelihood : likelihoods of q quantities from n campaigns, with precision matrices Λ and shifts
        η, in internal units. Errors of the instrument are measured from their prior means.
    names : names of the q quantities: parameters, instrument errors and effects of the machine.
    rows : rows of n campaigns in the table of a batch.
    force_N : force for which the compliances are given [N].

    Returns
    -------
    Gaussian
    """
    maps = np.tile(np.eye(len(names)), (len(rows), 1, 1))
    largest_N = rows["force_max_N"].to_numpy(dtype=float)
    for j, name in enumerate(names):
        if not is_compliance_or_slope(name):
            continue
        factors = {"force_gain": 1.0, "force_curvature": 4.0 * (1.0 - force_N / largest_N)}
        compliance = name.removesuffix("_1")
        if compliance != name:
            factors = {"force_curvature": -4.0 / largest_N}
        for error, factor in factors.items():
            if error in names:
                distance = _distance_from_median(compliance, rows)
                maps[:, j, names.index(error)] = factor * distance
    transposed = np.swapaxes(maps, 1, 2)
    shift = (transposed @ likelihood.shift[:, :, None])[..., 0]
    return Gaussian(transposed @ likelihood.precision @ maps, shift)


def _distance_from_median(compliance: str, rows: pd.DataFrame) -> Array:
    """Return the median of a compliance's estimates less each campaign's estimate, shape (n,).

    The distance is zero for campaigns without this compliance. ``rows`` are rows of n campaigns.
    """
    estimates = np.full(len(rows), np.nan)
    columns = zip(rows["gaussian_names"], rows["gaussian_mean"], strict=True)
    for i, (names_of_row, means) in enumerate(columns):
        by_name = dict(zip(names_of_row, means, strict=True))
        estimates[i] = by_name.get(compliance, np.nan)
    if np.isnan(estimates).all():
        return np.zeros(len(rows))
    return np.nan_to_num(np.nanmedian(estimates) - estimates)
