"""Machines that do not belong to the population of the others.

Every machine is left out in turn and compared with what the others predict of it, everything but
their spreads integrated out exactly. (Tests of one campaign are compared in another way: see
`outlying_tests`.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from ldbb_bayes.analysis.multiple_testing import holm
from ldbb_bayes.fleet.deviations import Estimates, estimate_separately, whitened
from ldbb_bayes.fleet.spread_density import (
    SpreadDensity,
    Spreads,
    draw_spreads,
    shared_quantities,
    spread_slices,
)
from ldbb_bayes.inference.diagnostics import pareto_smooth
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.triangular import eliminate
from ldbb_bayes.results import Array

__all__ = ["JudgedMachines", "judge_machines"]

# Draws of the spreads without a machine, where weights cannot be trusted.
_DRAWS_WITHOUT = 512
# Machines for which spreads are drawn anew, those that stand out most first.
_MOST_REDRAWN = 200
# Smallest p-value, so that its normal deviate is finite.
_SMALLEST_P = 1e-300


@dataclass(frozen=True, eq=False)
class JudgedMachines:
    """The n machines, each against the others."""

    #: at most the probability that of so many machines of one population a parameter of one stands
    #: out so much (Bonferroni over parameters, Holm over machines), shape (n,)
    p_value: Array
    parameter_p_value: Array  #: two-sided, of each parameter by itself, shape (n, c)
    z: Array  #: the same as a normal deviate, shape (n, c)
    doubtful: Array  #: whether p-values cannot be trusted (Pareto's k̂), shape (n,)


def judge_machines(
    density: SpreadDensity,
    spreads: Spreads,
    shared: Gaussian,
    *,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
) -> JudgedMachines:
    """Compare every machine with what the others predict of it.

    The draws of the spreads are weighted to what they were without the machine; where these weights
    cannot be trusted, spreads are drawn anew without it.

    Parameters
    ----------
    density : of ln s with all machines.
    spreads : draws of it.
    shared : (μ, b) given the draws, see `shared_quantities`.
    seed : of new draws.
    progress : called with the numbers of machines drawn anew, done and in all.
    """
    likelihood = density.likelihood
    n = len(likelihood.shift)
    c = spreads.spread.shape[1]
    separate = estimate_separately(likelihood, c)
    left_out = _leave_out_each(likelihood, separate, spreads.spread, shared)
    weights = np.empty((n, len(spreads.spread)))
    doubtful = np.empty(n, dtype=bool)
    for m in range(n):
        log_weight = spreads.log_weight - left_out.log_density[:, m]
        weights[m], pareto_k, good_k = pareto_smooth(log_weight)
        doubtful[m] = pareto_k > good_k
    p_value, side = _two_sided_p_value(weights, left_out.z)
    redrawn = np.flatnonzero(doubtful)
    by_p_value = np.argsort(p_value.min(axis=1)[redrawn], kind="stable")
    redrawn = redrawn[by_p_value][:_MOST_REDRAWN]
    for count, m in enumerate(redrawn.tolist(), start=1):
        new_spreads, z = _draw_without(density, separate, spreads.mode, m, seed)
        new_p_value, new_side = _two_sided_p_value(new_spreads.weight[None], z)
        doubtful[m] = not new_spreads.trusted
        p_value[m] = new_p_value[0]
        side[m] = new_side[0]
        if progress is not None:
            progress(count, len(redrawn))
    overall = holm(np.minimum(1.0, c * p_value.min(axis=1)))
    return JudgedMachines(overall, p_value, -side * ndtri(0.5 * p_value), doubtful)


class _LeftOut(NamedTuple):
    """Every machine against the others, given k spreads."""

    log_density: Array  #: ln p(y_m | y_−m, s), up to a constant, shape (k, n)
    z: Array  #: its standardised difference from their prediction, shape (c, k, n)


def _leave_out_each(
    likelihood: Gaussian, separate: Estimates, spread: Array, shared: Gaussian
) -> _LeftOut:
    k, c = spread.shape
    n, q = likelihood.shift.shape
    log_density = np.empty((k, n))
    z = np.empty((c, k, n))
    log_integral = shared.log_integral - shared.log_constant
    for rows in spread_slices(spread, likelihood):
        system = whitened(likelihood, spread[rows])
        gram = np.einsum("iakn,ibkn->abkn", system[:, c:], system[:, c:])
        precision = (
            np.moveaxis(shared.precision[rows], 0, -1)[..., None]
            - likelihood.precision.T[:, :, None]
            + gram[:q, :q]
        )
        shift = shared.shift[rows].T[..., None] - likelihood.shift.T[:, None] + gram[:q, q]
        log_others, z[:, rows] = _compare(separate, precision, shift, spread[rows])
        log_determinant = np.log(system[range(c), range(c)]).sum(axis=0)
        log_machine = 0.5 * gram[q, q] - log_determinant
        log_density[rows] = log_integral[rows, None] + log_machine - log_others
    return _LeftOut(log_density, z)


def _draw_without(
    density: SpreadDensity, separate: Estimates, mode: Array, m: int, seed: int
) -> tuple[Spreads, Array]:
    """Return spreads drawn without machine m, and its z given each of them, shape (c, k, 1)."""
    likelihood = density.likelihood
    stays = np.arange(len(likelihood.shift)) != m
    other_machines = Gaussian(likelihood.precision[stays], likelihood.shift[stays])
    without = SpreadDensity(other_machines, density.scale)
    spreads = draw_spreads(without, len(mode), seed=seed, size=_DRAWS_WITHOUT, start=mode)
    shared = shared_quantities(other_machines, spreads.spread)
    machine = Estimates(
        separate.covariance[m : m + 1],
        separate.response[m : m + 1],
        separate.value[m : m + 1],
    )
    precision = np.moveaxis(shared.precision, 0, -1)[..., None]
    _, z = _compare(machine, precision, shared.shift.T[..., None], spreads.spread)
    return spreads, z


def _compare(
    separate: Estimates, precision: Array, shift: Array, spread: Array
) -> tuple[Array, Array]:
    """Return ln ∫ of (μ, b) as the other machines know them, and z of the machines left out.

    The integral, up to a constant, has shape (k, n), z (c, k, n). Precision (q, q, k, n) and shift
    (q, k, n) are those of (μ, b) from the other machines.
    """
    q = len(shift)
    c = spread.shape[1]
    parameter_response = separate.response[..., :c]
    response = np.broadcast_to(separate.response.T[:, :, None], (q, c, *shift.shape[1:]))
    system = np.concatenate([precision, shift[:, None], response], axis=1)
    eliminate(system.reshape(1, *system.shape[:2], -1))
    standardised = system[:, q]
    gain = system[:, q + 1 :]
    log_determinant = np.log(system[range(q), range(q)]).sum(axis=0)
    noise = (parameter_response * separate.covariance).sum(axis=-1).T[:, None]
    deviation = np.einsum("ka,nja->jkn", spread**2, parameter_response**2)
    variance = (gain**2).sum(axis=0) + deviation + noise
    difference = separate.value.T[:, None] - (gain * standardised[:, None]).sum(axis=0)
    z = np.divide(
        difference, np.sqrt(variance), out=np.zeros_like(difference), where=variance > 0.0
    )
    return 0.5 * (standardised**2).sum(axis=0) - log_determinant, z


def _two_sided_p_value(weights: Array, z: Array) -> tuple[Array, Array]:
    """Return twice the smaller tail of mixtures over s, and its side (±1), each of shape (n, c).

    Weights have shape (n, k), z (c, k, n).
    """
    above = np.einsum("mk,jkm->mj", weights, ndtr(-z))
    below = np.einsum("mk,jkm->mj", weights, ndtr(z))
    p_value = np.clip(2.0 * np.minimum(above, below), _SMALLEST_P, 1.0)
    return p_value, np.where(above < below, 1.0, -1.0)
