"""What a fit says of the nuisances that tests share: ball form, bar length, mount, force gain, hysteresis, drift.

They are integrated out when sampling. Given β, φ and the readings they are Gaussian: mean and sd follow from the draws by the law
of total variance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import scipy.linalg
import xarray as xr
from numpy.typing import NDArray

from ldbb_bayes.inference.origin import bound_of, draws_of
from ldbb_bayes.model.basis import SIZE
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.columns import Columns
from ldbb_bayes.model.wording import inside_unit
from ldbb_bayes.threads import one_blas_thread

__all__ = ["DrawnNuisances", "draw_nuisances", "nuisances"]

Array = NDArray[Any]
_DRAWS = 1000


@one_blas_thread
def nuisances(posterior: xr.DataTree) -> pd.DataFrame:
    """Posterior of the shared nuisance coefficients.

    Returns
    -------
    DataFrame
        One row per coefficient: term, unit (mm; per bar, N, h or K), mean, sd, prior_sd (at the posterior mean of φ). The mount's
        is its deviation from the nominal deflection.
    """
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, _DRAWS)
    names, owners, prior_sd = _shared(bound, phi)
    if not names:
        return pd.DataFrame(columns=["term", "unit", "mean", "sd", "prior_sd"])
    _, given = bound.given_interest.conditional(phi, beta - bound.centre)
    within = np.zeros(len(names))
    for root, scale in zip(given.precision_root, given.scale, strict=True):
        inverse = scipy.linalg.solve_triangular(root, np.eye(len(names)), lower=True)
        within += (inverse**2).sum(axis=0) * scale**2 / len(beta)
    return pd.DataFrame(
        {
            "term": owners,
            "unit": [inside_unit(name) for name in names],
            "mean": given.mean.mean(axis=0),
            "sd": np.sqrt(within + given.mean.var(axis=0)),
            "prior_sd": prior_sd,
        },
        index=list(names),
    )


@dataclass(frozen=True, eq=False)
class DrawnNuisances:
    """Draws of the shared nuisance coefficients given β, φ and the readings.

    Attributes
    ----------
    names : list of str
        Of the q coefficients.
    values : ndarray, shape (tests, 25, q)
        Their columns.
    draws : ndarray, shape (draws, q)
    """

    names: list[str]
    values: Array
    draws: Array


def draw_nuisances(bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator) -> DrawnNuisances:
    """One draw of the shared nuisances for every draw of φ (draws, h) and β (draws, p)."""
    names, _, _ = _shared(bound, phi)
    if not names:
        empty = np.zeros((len(bound.test_names), SIZE, 0))
        return DrawnNuisances(names, empty, np.zeros((len(beta), 0)))
    _, given = bound.given_interest.conditional(phi, beta - bound.centre)
    values = [term.values for term in bound.nuisance_columns if isinstance(term, Columns) and not term.private]
    return DrawnNuisances(names, np.concatenate(values, axis=2), given.draw(rng))


def _shared(bound: BoundModel, phi: Array) -> tuple[list[str], list[str], Array]:
    """Names, terms and prior sd of the shared columns, in the order of the model's terms."""
    scale = dict(zip(bound.hyper_prior.names, phi.mean(axis=0), strict=True))
    names: list[str] = []
    owners: list[str] = []
    sd = [np.zeros(0)]
    for term in bound.model.nuisances:
        for part in term.columns(bound.setting):
            if isinstance(part, Columns) and not part.private:
                names += part.names
                owners += [type(term).__name__] * len(part.names)
                sd.append(part.sd * (scale[part.hyper] if part.hyper else 1.0))
    return names, owners, np.concatenate(sd)
