"""What to mind about a population, in sentences: what it hardly knows, and what the model leaves aside."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from ldbb_bayes.fleet.belonging_machines import FEWEST, Belonging
from ldbb_bayes.fleet.choosing import labels, listed
from ldbb_bayes.fleet.pooled import PooledParameter
from ldbb_bayes.fleet.spreads import Spreads
from ldbb_bayes.fleet.statistics import FleetStatistics
from ldbb_bayes.units import display_name

__all__ = ["doubts_of", "doubts_of_machines", "narrow_forces"]

# sd / scale of a half-normal, and how much of it counts as nothing learnt.
_HALF_NORMAL, _HARDLY = float(np.sqrt(1.0 - 2.0 / np.pi)), 0.8
# Greatest force over least.
_SPAN = 3.0


def doubts_of_machines(rows: pd.DataFrame) -> Iterator[str]:
    """About campaigns that do not say whose they are."""
    nameless = ~rows["machine_id"].map(lambda own: isinstance(own, str)).astype(bool)
    if nameless.any():
        whose = listed(labels(rows[nameless]))
        yield f"Naming no machine, each counted as one of its own: {whose}. Write machine_id into campaign.toml."


def narrow_forces(rows: pd.DataFrame, parameters: Sequence[str]) -> Iterator[str]:
    """About campaigns of one bar whose forces span so little that what its length and balls add looks like a compliance."""
    if not any(name.startswith("C_") for name in parameters):
        return
    narrow = rows["force_max_N"] < _SPAN * rows["force_min_N"]
    if narrow.any():
        yield (
            f"Forces that span little (the greatest below {_SPAN:g} times the least), so that length and ball form of the one "
            f"bar look like compliances and do not average out: {listed(labels(rows[narrow]))}."
        )


def doubts_of(
    statistics: FleetStatistics,
    parameters: Mapping[str, PooledParameter],
    spreads: Spreads,
    belonging: Belonging | None,
    machines: Sequence[str],
    changed: Sequence[str],
    spread_scale: float,
) -> Iterator[str]:
    """About the result."""
    low, high = statistics.forces_N
    force = statistics.reference_force_N
    if low > high:
        yield "No force was tested in all campaigns: compliances are carried to one force along the slopes that were fitted."
    elif not low <= force <= high:
        yield f"{force:g} N lies outside of {low:g} to {high:g} N, which all campaigns tested: compliances are extrapolated."
    if not spreads.trusted:
        yield (
            f"The spreads cannot be trusted: Pareto's k = {spreads.pareto_k:.2f} of their weights is above {spreads.good_k:.2f}. "
            "Use fewer parameters or more machines."
        )
    scales = {name: spread_scale * own.prior_sd for name, own in parameters.items()}
    prior = [
        name
        for name, own in parameters.items()
        if own.spread.sd > _HARDLY * _HALF_NORMAL * scales[name] and own.spread.mean < 2.0 * scales[name]
    ]
    if prior:
        yield (
            f"The spread of {', '.join(map(display_name, prior))} is little more than its prior, "
            f"HalfNormal({spread_scale:g} prior sd)."
        )
    if statistics.instrument and parameters:
        most = max(parameters.values(), key=lambda own: own.instrument_share)
        errors = ", ".join(_ERRORS[name] for name in statistics.instrument)
        yield (
            f"Errors of one bar, the same in all campaigns ({errors}), are up to "
            f"{100 * most.instrument_share:.0f} % of the variance of the population's mean ({display_name(most.name)}), however "
            "many machines. Where the population gives the prior of a campaign with the same bar they are counted again."
        )
    if changed:
        yield (
            f"Campaigns of one machine contradict one another: {listed(changed)}. Either it changed, or they are of two "
            "machines: its estimate is sure of what neither says, and where one bar is shared the others' move with it. Look at "
            "it over time (trend), then leave it out (--exclude) or what came before the change (--since)."
        )
    if belonging is None:
        yield f"Whether a machine belongs is not judged with {len(machines)} machines: at least {FEWEST} are needed."
    else:
        if not belonging.told.all():
            silent = [name for name, told in zip(machines, belonging.told, strict=True) if not told]
            yield f"The readings tell nothing of {listed(silent)}: whether they belong is not known."
        if belonging.doubtful.any():
            unsure = [name for name, bad in zip(machines, belonging.doubtful, strict=True) if bad]
            yield f"p-values that cannot be trusted, their weights being too uneven: {listed(unsure)}."
        if belonging.flagged.any():
            yield "The population includes the machines that do not belong. Look at what it is without them."
    yield (
        "Left aside: that compliances cannot be negative, changes of a machine from campaign to campaign, and correlations of "
        "parameters from machine to machine."
    )
    if statistics.instrument:
        yield (
            "Left aside too: that one bar has the same length and ball form in all campaigns. That is conservative for "
            "differences between machines, not for the population's mean."
        )


_ERRORS = {"mount": "mount", "force_gain": "gain of the force"}
