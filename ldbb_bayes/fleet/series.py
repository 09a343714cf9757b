"""The campaigns of one machine in order of time, and what speaks against relying on them."""

from __future__ import annotations

import shlex

import numpy as np
import pandas as pd

from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.fleet.choosing import Choice, labels, listed
from ldbb_bayes.fleet.doubts import narrow_forces
from ldbb_bayes.fleet.statistics import FleetStatistics

__all__ = ["doubts_of", "order_of", "rows_of"]


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
        notes.append(f"Left out, for they could not be fitted, and whose they are is not known: {listed(labels(rows[unread]))}.")
    nameless = ~named & ~unread
    if nameless.any():
        notes.append(f"Left out for naming no machine: {listed(labels(rows[nameless]))}.")
    return rows[ids == (machine or known[0])], notes


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
            f"campaigns must have a date all or none, got none for {listed(missing)}. Write date = … into campaign.toml, "
            "or take all dates out and give the campaigns in order."
        )
    stamps = [0.0 if date is None else date.timestamp() for date in statistics.dates]
    return [int(place) for place in np.argsort(stamps, kind="stable")]


def doubts_of(choice: Choice, statistics: FleetStatistics, *, one_bar: bool = True) -> list[str]:
    """Campaigns not to be relied on, and what they do not have in common."""
    said = list(choice.doubts())
    low, high = statistics.forces_N
    if not low <= statistics.reference_force_N <= high:
        said.append(
            f"The reference force, {statistics.reference_force_N:g} N, was not within the tested forces of every campaign "
            f"(common to all: {low:g} to {high:g} N): compliances are extrapolated."
            if low <= high
            else "The campaigns have no tested forces in common: compliances are extrapolated."
        )
    if one_bar:
        said += narrow_forces(choice.rows, statistics.parameters)
    if all(date is None for date in statistics.dates):
        said.append("No campaign has a date: the order given is taken as that of time.")
    elif len(set(statistics.dates)) < len(statistics):
        said.append("Some campaigns have the same date: of those the order given is taken as that of time. A time of day tells.")
    if len(statistics) == 2:
        said.append("With two campaigns only the assumptions tell a change from what the machine changes every time.")
    return said
