"""c_m ~ N(μ, diag(s²)), b ~ N(0, diag(instrument_sd²)), μ_j ~ N(prior), s_j ~ HalfNormal(spread_scale · prior_sd_j).

c_m are the parameters of machine m, the same in all its campaigns; b the errors of the one instrument. What the campaigns say of
both is Gaussian (`FleetStatistics`), so that everything but s is integrated out exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.belonging_machines import FEWEST, belonging_machines
from ldbb_bayes.fleet.choosing import Wanted
from ldbb_bayes.fleet.doubts import doubts_of, doubts_of_machines, narrow_forces
from ldbb_bayes.fleet.pooled import Population
from ldbb_bayes.fleet.pooling import pooling
from ldbb_bayes.fleet.repeats import changed_machines
from ldbb_bayes.fleet.spreads import SpreadDensity, draw_spreads
from ldbb_bayes.fleet.statistics import FleetStatistics, fleet_statistics
from ldbb_bayes.fleet.telling import instrument_moments, told_of_machines, told_of_parameters
from ldbb_bayes.threads import one_blas_thread

__all__ = ["pool", "population"]

_NEEDED = ("campaign", "status", "machine_id", "date", "topology", "reference_force_N", "gaussian_names", "gaussian_mean")
# Draws of s, as many as so many pairs of draw and machine allow: for the spreads themselves, and for every machine.
_SPREADS, _MACHINES = (4_000_000, 2048, 8192), (1_000_000, 256, 2048)


def population(
    rows: pd.DataFrame,
    *,
    parameters: Sequence[str] | None = None,
    exclude: Sequence[str] = (),
    since: str | None = None,
    include_misfits: bool = False,
    reference_force_N: float | None = None,
    spread_scale: float = 0.3,
    one_instrument: bool = True,
    ci_prob: float = 0.95,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Population:
    """The population that the machines of a batch come from, the next machine, and which machines do not belong.

    Parameters
    ----------
    rows : DataFrame
        Of `read_batch`: one row per campaign; campaigns without machine_id count as machines of their own.
    parameters : sequence of str, optional
        Compliances or geometric errors; default: all constant compliances.
    exclude : sequence of str
        Campaigns (path as given, last part of it, or name) and machines to leave out.
    since : str, optional
        ISO 8601 date; campaigns before it are left out.
    include_misfits : bool
        Keep campaigns whose readings the model does not expect, see `Wanted`.
    reference_force_N : float, optional
        Force at which compliances are meant. Default: the median of the campaigns' own.
    spread_scale : float
        Prior of each spread: HalfNormal(spread_scale · default prior sd of the parameter), see `reference_sd`.
    one_instrument : bool
        Whether mount and force gain are those of one bar; else each campaign has its own.
    ci_prob : float
    seed : int
    progress : callable, optional
        Told of machines that are left out by drawing anew: done and total.

    Returns
    -------
    Population

    Raises
    ------
    InputError
        For rows that are no batch's, fewer than two machines, machines with other joints, or options out of range.
    """
    if not isinstance(rows, pd.DataFrame):
        raise InputError(f"rows must be the table of a batch, got {type(rows).__name__}. Give what read_batch returns.")
    missing = [name for name in _NEEDED if name not in rows]
    if missing:
        raise InputError(f"rows must be the table of a batch, got one without {missing[0]}. Give what read_batch returns.")
    _check_options(spread_scale, ci_prob, reference_force_N)
    choice = Wanted(exclude, since, include_misfits).choose(rows)
    statistics = fleet_statistics(
        choice.rows,
        parameters=parameters,
        reference_force_N=reference_force_N,
        one_instrument=one_instrument,
    )
    machines = set(statistics.machines)
    if len(machines) < 2:
        why = " ".join(("Add campaigns of others.", *choice.notes))
        raise InputError(f"a population must have at least two machines, got only {machines.pop()}. {why}")
    found = pool(statistics, spread_scale=spread_scale, ci_prob=ci_prob, seed=seed, progress=progress)
    narrow = narrow_forces(choice.rows, statistics.parameters) if one_instrument else ()
    readings = tuple(str(own) for own in choice.rows.get("sha256", ()) if isinstance(own, str))
    doubts = (*choice.doubts(), *doubts_of_machines(choice.rows), *narrow, *found.doubts)
    return replace(found, doubts=doubts, readings=readings)


def _check_options(spread_scale: float, ci_prob: float, reference_force_N: float | None) -> None:
    if not 0.0 < ci_prob < 1.0:
        raise InputError(f"ci_prob must lie between 0 and 1, got {ci_prob}. For 95 % give 0.95.")
    if not (np.isfinite(spread_scale) and spread_scale > 0.0):
        raise InputError(f"spread_scale must be a finite number above zero, got {spread_scale}. The default is 0.3.")
    if reference_force_N is not None and not np.isfinite(reference_force_N):
        raise InputError(f"reference_force_N must be a finite number, got {reference_force_N}. Give a force in N.")


@one_blas_thread
def pool(
    statistics: FleetStatistics,
    *,
    spread_scale: float = 0.3,
    ci_prob: float = 0.95,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Population:
    """The same from statistics at hand; options as for `population`."""
    pooled = pooling(statistics)
    if len(pooled) < 2:
        raise InputError(f"a population must have at least two machines, got only {pooled.machines[0]}. Add campaigns of others.")
    density = SpreadDensity(pooled, spread_scale)
    spreads = draw_spreads(density, seed=seed, size=_draws(len(pooled), *_SPREADS))
    few = spreads.first(_draws(len(pooled), *_MACHINES))
    common = pooled.common(few.spread)
    tails = 0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob
    parameters = told_of_parameters(statistics, spreads, few, common, tails)
    belonging = belonging_machines(density, few, seed=seed, progress=progress) if len(pooled) >= FEWEST else None
    changed = changed_machines(statistics, *instrument_moments(pooled, few, common))
    machines = told_of_machines(pooled, statistics, few, common, belonging, tails)
    return Population(
        parameters=parameters,
        machine=machines,
        campaigns=len(statistics),
        reference_force_N=statistics.reference_force_N,
        forces_N=statistics.forces_N,
        topology=statistics.topology,
        instrument=statistics.instrument,
        spread_scale=spread_scale,
        ci_prob=ci_prob,
        seed=seed,
        pareto_k=spreads.pareto_k,
        trusted=spreads.trusted,
        doubts=tuple(doubts_of(statistics, parameters, spreads, belonging, pooled.machines, changed, spread_scale)),
        compliances=statistics.compliances,
        judged=belonging is not None and bool(belonging.told.all() and not belonging.doubtful.any()),
    )


def _draws(machines: int, pairs: int, fewest: int, most: int) -> int:
    """A power of two."""
    return 2 ** int(np.log2(np.clip(pairs / machines, fewest, most)))
