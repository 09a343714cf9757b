"""The campaigns of one machine in order of time, and what speaks against relying on them."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sized

import numpy as np
import pandas as pd

from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.fleet.doubts import narrow_forces
from ldbb_bayes.fleet.statistics import FleetStatistics
from ldbb_bayes.model.wording import joined

__all__ = ["doubts_of", "order_of", "rows_of", "silent_of"]

_NAMED = 5


def rows_of(rows: pd.DataFrame, machine: str | None) -> tuple[pd.DataFrame, list[str]]:
    """A batch's rows of one machine, and what is to be said of the choice.

    Raises
    ------
    InputError
        For an unknown machine, or several and none chosen.
    """
    ids = rows["machine_id"] if "machine_id" in rows else pd.Series([None] * len(rows), index=rows.index, dtype=object)
    named = ids.map(lambda own: isinstance(own, str)).astype(bool)
    known = sorted(set(ids[named]))
    if machine is not None:
        check_known("machine", [machine], known)
    elif len(known) > 1:
        raise InputError(
            f"the campaigns must be of one machine, got those of {', '.join(known)}. Choose one: "
            f"--machine {shlex.quote(known[0])} (machine={known[0]!r})."
        )
    if not known:
        return rows, ["No campaign names its machine: all are taken as campaigns of one (machine_id in campaign.toml)."]
    notes = []
    unread = ~named & (rows["status"] != "done")
    if unread.any():
        notes.append(f"Left out, for they could not be fitted, and whose they are is not known: {_listed(_names(rows[unread]))}.")
    nameless = ~named & ~unread
    if nameless.any():
        notes.append(f"Left out for naming no machine: {_listed(_names(rows[nameless]))}.")
    return rows[ids == (machine or known[0])], notes


def silent_of(rows: pd.DataFrame) -> pd.Series[bool]:
    """Campaigns that were fitted without sufficient statistics."""
    return (rows["status"] == "done") & rows["gaussian_names"].isna()


def order_of(statistics: FleetStatistics) -> list[int]:
    """Places of the campaigns in order of date, equal dates as given; as given where there are none.

    Raises
    ------
    InputError
        For dates of some campaigns only.
    """
    missing = [name for name, date in zip(statistics.campaigns, statistics.dates, strict=True) if date is None]
    if missing and len(missing) < len(statistics):
        raise InputError(
            f"campaigns must have a date all or none, got none for {_listed(missing)}. Write date = … into campaign.toml, "
            "or take all dates out and give the campaigns in order."
        )
    stamps = [0.0 if date is None else date.timestamp() for date in statistics.dates]
    return [int(place) for place in np.argsort(stamps, kind="stable")]


def doubts_of(rows: pd.DataFrame, statistics: FleetStatistics, *, one_bar: bool = True) -> list[str]:
    """Campaigns not to be relied on, and what they do not have in common."""
    silent = silent_of(rows)
    done = rows[(rows["status"] == "done") & ~silent]
    said = []
    failed = rows[rows["status"] != "done"]
    if len(failed):
        said.append(f"Left out, for they could not be fitted: {_listed(_names(failed))}.")
    if silent.any():
        said.append(
            f"Left out, for they have no sufficient statistics (flat priors, or a breakdown: see warnings): "
            f"{_listed(_names(rows[silent]))}."
        )
    if "converged" in done:
        lost = done[[not pd.isna(own) and not own for own in done["converged"]]]
        if len(lost):
            said.append(f"Not converged, refit with more draws: {_listed(_names(lost))}.")
    if "misfits" in done:
        unfit = done[[isinstance(own, Sized) and len(own) > 0 for own in done["misfits"]]]
        if len(unfit):
            said.append(f"The model does not describe all readings of: {_listed(_names(unfit))}.")
    if "sha256" in done:
        twice = done[done["sha256"].notna() & done["sha256"].duplicated(keep=False)]
        if len(twice):
            said.append(f"The same readings more than once, counted as campaigns of their own: {_listed(_names(twice))}.")
    if "model_sha256" in done and done["model_sha256"].nunique(dropna=True) > 1:
        said.append("The campaigns were fitted with different models or priors; each one's priors are divided out.")
    low, high = statistics.forces_N
    if not low <= statistics.reference_force_N <= high:
        said.append(
            f"The reference force, {statistics.reference_force_N:g} N, was not within the tested forces of every campaign "
            f"(common to all: {low:g} to {high:g} N): compliances are extrapolated."
            if low <= high
            else "The campaigns have no tested forces in common: compliances are extrapolated."
        )
    if one_bar:
        said += narrow_forces(done, statistics.parameters)
    if all(date is None for date in statistics.dates):
        said.append("No campaign has a date: the order given is taken as that of time.")
    if len(statistics) == 2:
        said.append("With two campaigns only the assumptions tell a change from what the machine changes every time.")
    return said


def _names(rows: pd.DataFrame) -> list[str]:
    own = rows["name"] if "name" in rows else rows["campaign"]
    return [str(name if isinstance(name, str) else path) for name, path in zip(own, rows["campaign"], strict=True)]


def _listed(names: Iterable[str]) -> str:
    every = list(names)
    return joined(every if len(every) <= _NAMED else [*every[: _NAMED - 1], f"{len(every) - _NAMED + 1} more"])
