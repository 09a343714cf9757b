"""What to mind about a population, in sentences: campaigns that are missing or doubtful, and what the model leaves aside."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from ldbb_bayes.fleet.belonging_machines import FEWEST, Belonging
from ldbb_bayes.fleet.pooled import PooledParameter
from ldbb_bayes.fleet.spreads import Spreads
from ldbb_bayes.fleet.statistics import FleetStatistics
from ldbb_bayes.units import display_name

__all__ = ["doubts_of", "doubts_of_rows", "named", "narrow_forces"]

_NAMED = 5
# sd / scale of a half-normal, and how much of it counts as nothing learnt.
_HALF_NORMAL, _HARDLY = float(np.sqrt(1.0 - 2.0 / np.pi)), 0.8
# Greatest force over least.
_SPAN = 3.0


def named(names: Sequence[str]) -> str:
    """A few names and how many more."""
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")


def doubts_of_rows(rows: pd.DataFrame) -> Iterator[str]:
    """About the campaigns of a batch; columns that the rows lack are not spoken of."""
    failed = rows["status"] != "done"
    if failed.any():
        yield f"{_campaigns(rows[failed])} could not be fitted and {_is(failed)} left out: {_names(rows[failed])}."
    silent = ~failed & rows["gaussian_names"].isna()
    if silent.any():
        yield (
            f"{_campaigns(rows[silent])} {_has(silent)} no sufficient statistics (flat priors, or a breakdown: see warnings) and "
            f"{_is(silent)} left out: {_names(rows[silent])}."
        )
    done = rows[~failed & ~silent]
    if "converged" in rows:
        loose = ~done["converged"].map(lambda own: own is not None and bool(own)).astype(bool)
        if loose.any():
            yield f"{_campaigns(done[loose])} did not converge: {_names(done[loose])}."
    if "misfits" in rows:
        misfit = done["misfits"].map(lambda own: _length(own) > 0).astype(bool)
        if misfit.any():
            yield f"{_campaigns(done[misfit])} {_has(misfit)} tests that the model does not fit: {_names(done[misfit])}."
    nameless = ~done["machine_id"].map(lambda own: isinstance(own, str)).astype(bool)
    if nameless.any():
        yield (
            f"{_campaigns(done[nameless])} {_names_no(nameless)} machine and {_counts(nameless)} as a machine of "
            f"{'its' if nameless.sum() == 1 else 'their'} own: {_names(done[nameless])}. Write machine_id into campaign.toml."
        )
    if "sha256" in rows:
        twice = done["sha256"].notna() & done["sha256"].duplicated(keep=False)
        if twice.any():
            yield f"{_campaigns(done[twice])} hold the readings of others and count twice: {_names(done[twice])}. Leave some out."
    if "model_sha256" in rows and done["model_sha256"].nunique() > 1:
        yield f"The campaigns were fitted with {done['model_sha256'].nunique()} models; each one's prior is divided out."


def narrow_forces(rows: pd.DataFrame, parameters: Sequence[str]) -> Iterator[str]:
    """About campaigns of one bar whose forces span so little that what its length and balls add looks like a compliance."""
    if not any(name.startswith("C_") for name in parameters):
        return
    narrow = rows["force_max_N"] < _SPAN * rows["force_min_N"]
    if narrow.any():
        yield (
            f"{_campaigns(rows[narrow])} {_has(narrow)} forces that span little (the greatest below {_SPAN:g} times the least): "
            f"length and ball form of the one bar look like compliances and do not average out: {_names(rows[narrow])}."
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
            f"Campaigns of one machine contradict one another: {named(changed)}. Either it changed, or they are of two machines: "
            "its estimate is sure of what neither says."
        )
    if belonging is None:
        yield f"Whether a machine belongs is not judged with {len(machines)} machines: at least {FEWEST} are needed."
    else:
        if not belonging.told.all():
            silent = [name for name, told in zip(machines, belonging.told, strict=True) if not told]
            yield f"The readings tell nothing of {named(silent)}: whether they belong is not known."
        if belonging.doubtful.any():
            unsure = [name for name, bad in zip(machines, belonging.doubtful, strict=True) if bad]
            yield f"p-values that cannot be trusted, their weights being too uneven: {named(unsure)}."
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


def _length(value: Any) -> int:
    return len(value) if isinstance(value, list | tuple | np.ndarray) else 0


def _campaigns(rows: pd.DataFrame) -> str:
    return "1 campaign" if len(rows) == 1 else f"{len(rows)} campaigns"


def _names(rows: pd.DataFrame) -> str:
    return named([str(name) for name in rows["campaign"]])


def _is(which: pd.Series[bool]) -> str:
    return "is" if which.sum() == 1 else "are"


def _has(which: pd.Series[bool]) -> str:
    return "has" if which.sum() == 1 else "have"


def _names_no(which: pd.Series[bool]) -> str:
    return "names no" if which.sum() == 1 else "name no"


def _counts(which: pd.Series[bool]) -> str:
    return "counts" if which.sum() == 1 else "count"
