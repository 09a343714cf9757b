"""Conformity with tolerances: p = P(lower ≤ η ≤ upper | y) of JCGM 106, and decisions after ISO
14253-1; may the numbers be used?

A machine conforms where p is at least the confidence, for a normal posterior where the estimate
lies inside each limit by the guard band; it does not conform where 1 − p is; in between nothing is
decided.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtr, ndtri

from ldbb_bayes.analysis.circularity import path_draws
from ldbb_bayes.analysis.tolerances import (
    _PATHS,
    Tolerance,
    check_force,
    quantities_of,
    tolerances_in,
)
from ldbb_bayes.errors import require
from ldbb_bayes.inference.posterior import bound_of, curves_of, draws_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, ByName, Result
from ldbb_bayes.units import is_direct

if TYPE_CHECKING:
    import xarray as xr


__all__ = ["Conformity", "Decision", "conformity", "draws_at", "normal_conformity"]

_FEW = 10
_TRACES = 2000


class Decision(StrEnum):
    """What follows from a tolerance at the confidence asked for."""

    CONFORMS = "conforms"
    DOES_NOT_CONFORM = "does not conform"
    NOT_DECIDED = "not decided"


@dataclass(frozen=True)
class Conformity(Result):
    """A quantity and its tolerance, in inside units."""

    unit: str  #: of all that follow
    force_N: float | None  #: at which it is stated; None of geometric errors and slopes
    lower: float | None  #: limit
    upper: float | None  #: limit
    mean: float  #: estimate
    sd: float  #: its standard uncertainty
    probability: float  #: of conformance
    #: how far the estimate must lie inside a limit so that the machine conforms; as far outside, it
    #: does not
    guard_band: float
    confidence: float  #: at which it is decided
    decision: Decision  #: by ISO 14253-1

    @property
    def limits(self) -> tuple[float, float]:
        """Both limits, infinite where there is none."""
        return Tolerance(self.lower, self.upper).ends


@one_blas_thread
def conformity(
    posterior: xr.DataTree,
    tolerances: Mapping[str, str | Tolerance] | None = None,
    *,
    force_N: float | None = None,
    confidence: float = 0.95,
) -> dict[str, Conformity]:
    """Decide whether a machine conforms.

    InputError for an unknown name, a number without its unit or with one of another kind, or limits
    the wrong way round.

    Parameters
    ----------
    posterior : from `average`, `sample` or `load`.
    tolerances : mapping of name to str or Tolerance, optional
        Default: those of the campaign. Names are parameters, ``stiffness_X`` (1/C_XXX), and G,
        F_max and F_min of the machine's path, with the plane where there are several (``G_YZ``).
    force_N : at which compliances, stiffnesses and the path are stated, from a tenth of the least
        force tested to 1.5 times the largest; default: the model's reference force, where C(F) is
        C.
    confidence : probability that a decision asks for.
    """
    require(
        0.5 < confidence < 1.0,
        f"confidence must lie between 0.5 and 1, got {confidence}. For 95 % give 0.95.",
    )
    bound = bound_of(posterior)
    known = quantities_of(bound)
    read = tolerances_in(known, bound.campaign.tolerances if tolerances is None else tolerances)
    force = bound.setting.reference_force_N if force_N is None else float(force_N)
    check_force(bound.campaign, force_N)
    if not read:
        return ByName()
    draws = dict(_draws(posterior, bound, read, force))
    return ByName(
        {
            name: _decided(known[name].unit, own, read[name], confidence, at)
            for name, (own, at) in draws.items()
        }
    )


def draws_at(posterior: xr.DataTree, force_N: float) -> dict[str, Array]:
    """Return the draws of every parameter, of compliances at a force [inside units]."""
    bound = bound_of(posterior)
    values = dict(zip(bound.names, draws_of(posterior, bound)[0].T, strict=True))
    if force_N == bound.setting.reference_force_N:
        return values
    curves = curves_of(posterior, np.array([force_N]))[:, 0]
    return values | {own.label: curves[:, j] for j, own in enumerate(bound.compliances)}


def _draws(
    posterior: xr.DataTree, bound: BoundModel, names: Collection[str], force: float
) -> Iterable[tuple[str, tuple[Array, float | None]]]:
    """Draws of what is named, and the force at which it is stated."""
    parameters = dict(zip(bound.names, bound.parameters, strict=True))
    values = draws_at(posterior, force)
    along = {f"stiffness_{name[2]}": name for name in bound.names if is_direct(name)}
    paths: dict[str, Array] = {}
    if any(name.startswith(tuple(_PATHS)) for name in names):
        several = len(bound.setting.planes) > 1
        for where, found in path_draws(posterior, [force], _TRACES):
            paths |= {
                f"{name}_{where['plane']}" if several else name: found[name] * 1e-3
                for name in _PATHS
            }
    for name in names:
        if name in parameters:
            yield name, (values[name], force if parameters[name].group == "compliance" else None)
        else:
            yield name, (1.0 / values[along[name]] if name in along else paths[name], force)


def _decided(
    unit: str, draws: Array, tolerance: Tolerance, confidence: float, force: float | None
) -> Conformity:
    mean = float(draws.mean())
    sd = float(draws.std(ddof=1))
    low, high = tolerance.ends
    below = _tail(draws < low, (low - mean) / max(sd, 1e-300))
    above = _tail(draws > high, (mean - high) / max(sd, 1e-300))
    return _conformity(
        unit, mean, sd, tolerance, min(max(1.0 - below - above, 0.0), 1.0), confidence, force
    )


def _tail(outside: Array, score: float) -> float:
    """Probability beyond a limit: the share of draws; where few are on either side, the normal
    tail, as far as they allow."""
    n = len(outside)
    count = int(outside.sum())
    if min(count, n - count) >= _FEW:
        return count / n
    tail = float(ndtr(score))
    least = _FEW / n
    return min(tail, least) if count < _FEW else max(tail, 1.0 - least)


def normal_conformity(
    unit: str, mean: float, sd: float, tolerance: Tolerance, *, confidence: float = 0.95
) -> Conformity:
    """The same of a normal distribution."""
    low, high = tolerance.ends
    probability = float(ndtr((high - mean) / sd) - ndtr((low - mean) / sd))
    return _conformity(unit, mean, sd, tolerance, probability, confidence, None)


def _conformity(
    unit: str,
    mean: float,
    sd: float,
    tolerance: Tolerance,
    probability: float,
    confidence: float,
    force: float | None,
) -> Conformity:
    decided = Decision.CONFORMS if probability >= confidence else Decision.NOT_DECIDED
    decision = Decision.DOES_NOT_CONFORM if probability <= 1.0 - confidence else decided
    band = float(ndtri(confidence)) * sd
    return Conformity(
        unit,
        force,
        tolerance.lower,
        tolerance.upper,
        mean,
        sd,
        probability,
        band,
        confidence,
        decision,
    )


# ---- may the numbers be used?
