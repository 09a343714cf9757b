"""Split from its neighbours; see there."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any

import pandas as pd

from ldbb_bayes.errors import InputError, nearest, require
from ldbb_bayes.fleet.dataset import FLEET_COLUMNS
from ldbb_bayes.inference.checks import CheckKind
from ldbb_bayes.inference.fit import ConcernKind
from ldbb_bayes.report.wording import caveat_words
from ldbb_bayes.results import Result

__all__ = ["Caveat", "CaveatKind", "check_rows", "choose", "labels", "moment"]


class CaveatKind(StrEnum):
    """What is to be minded of the campaigns that a result rests on, and of the result."""

    EXCLUDED = "excluded"
    BEFORE = "before"
    FAILED = "failed"
    NO_STATISTICS = "no-statistics"
    GIVEN_AGAIN = "given-again"
    UNEXPECTED = "unexpected"
    NOT_CONVERGED = "not-converged"
    NOT_WHITE = "not-white"
    NO_MACHINES = "no-machines"
    WITHOUT_MACHINE = "without-machine"
    MACHINES_OF_THEIR_OWN = "machines-of-their-own"
    EXTRAPOLATED = "extrapolated"
    NO_DATES = "no-dates"
    TWO_CAMPAIGNS = "two-campaigns"
    SPREADS_NOT_TRUSTED = "spreads-not-trusted"
    ONE_INSTRUMENT = "one-instrument"
    FEW_MACHINES = "few-machines"
    UNCERTAIN_P_VALUES = "uncertain-p-values"


@dataclass(frozen=True)
class Caveat(Result):
    """One thing to mind: of which campaigns, machines or parameters, and numbers that go with
    it."""

    kind: CaveatKind
    names: tuple[str, ...] = ()
    values: tuple[float, ...] = ()
    text: str = ""


def check_rows(rows: pd.DataFrame) -> None:
    """Refuse what is not the table of a batch."""
    for name in FLEET_COLUMNS:
        require(
            name in rows,
            f"rows must be the table of a batch, got one without {name}. Give what read_batch"
            " returns.",
        )


def choose(
    rows: pd.DataFrame,
    exclude: Sequence[str] = (),
    since: str | None = None,
    include_misfits: bool = False,
    *,
    among: pd.DataFrame | None = None,
) -> tuple[pd.DataFrame, list[Caveat]]:
    """Return the rows of a batch (`read_batch`) to rely on, what was left out and why, and what is
    to be minded of the others.

    Left out are ``exclude``, campaigns (path as given, last part of it, or name) and machines
    (machine_id) of the whole batch (``among``); campaigns before ``since`` (ISO 8601) and those
    without a date; and, but for ``include_misfits``, those whose readings the model does not
    expect: orders of a circle that fail their check, or readings against non-negative compliance.
    Readings a thousand times too large would move the mean of a population, widen its spread, and
    hide a change of their machine.
    """
    check_rows(rows)
    found = rows["kinds"].map(lambda own: set(own) if own is not None else set())
    digests = rows["sha256"]
    unexpected = found.map(
        lambda own: not own.isdisjoint((CheckKind.ORDER, ConcernKind.TRUNCATION))
    ).astype(bool)
    not_white = found.map(
        lambda own: not own.isdisjoint((CheckKind.NOISE, CheckKind.AUTOCORRELATION))
    ).astype(bool)
    left_out: dict[CaveatKind, Callable[[pd.DataFrame], pd.Series[bool]]] = {
        CaveatKind.EXCLUDED: lambda own: _named(own, exclude, rows if among is None else among),
        CaveatKind.BEFORE: lambda own: _before(own, since),
        CaveatKind.FAILED: lambda own: own["status"] != "done",
        CaveatKind.NO_STATISTICS: lambda own: own["gaussian_names"].isna(),
        CaveatKind.GIVEN_AGAIN: lambda own: (
            digests[own.index].notna() & digests[own.index].duplicated()
        ),
        CaveatKind.UNEXPECTED: lambda own: unexpected[own.index] & (not include_misfits),
    }
    relied = rows
    caveats = []
    for kind, rule in left_out.items():
        if (which := rule(relied)).any():
            caveats.append(
                Caveat(
                    kind,
                    tuple(labels(relied[which])),
                    text=(since or "") * (kind is CaveatKind.BEFORE),
                )
            )
            relied = relied[~which]
    if relied.empty:
        said = " ".join(map(caveat_words, caveats))
        raise InputError(
            f"campaigns must be left to rely on, got none of {len(rows)}. {said} Mend these, or"
            " exclude fewer."
        )
    minded = {
        CaveatKind.NOT_CONVERGED: rows["converged"].eq(False),
        CaveatKind.NOT_WHITE: not_white & ~unexpected,
    }
    for kind, which in minded.items():
        if (here := which[relied.index]).any():
            caveats.append(Caveat(kind, tuple(labels(relied[here]))))
    return relied, caveats


def labels(rows: pd.DataFrame) -> list[str]:
    """Return what campaigns are called: by name, those whose name others have too by path."""
    paths = rows["campaign"].astype(str)
    names = rows["name"].where(rows["name"].map(lambda own: isinstance(own, str)), paths)
    return [
        str(path if same else name)
        for name, path, same in zip(names, paths, names.duplicated(keep=False), strict=True)
    ]


def _named(rows: pd.DataFrame, exclude: Sequence[str], among: pd.DataFrame) -> pd.Series[bool]:
    """Whether campaigns, or their machines, are among the names."""
    names, known = (
        own[["name", "machine_id"]].assign(
            path=paths, last=paths.map(lambda path: os.path.basename(path.rstrip("/")))
        )
        for own, paths in ((each, each["campaign"].astype(str)) for each in (rows, among))
    )
    wanted = [exclude] if isinstance(exclude, str) else list(exclude)
    for name in wanted:
        if not known.isin([name]).any(axis=None):
            every = sorted(
                {
                    own
                    for own in known.drop(columns="path").to_numpy().ravel()
                    if isinstance(own, str)
                }
            )
            cure = f"Did you mean {nearest(str(name), every)!r}?"
            raise InputError(
                f"what is left out must be a campaign or machine of the batch, got {name!r}. {cure}"
            )
    return names.isin(wanted).any(axis=1)


def _before(rows: pd.DataFrame, since: str | None) -> pd.Series[bool]:
    try:
        least = moment(since or "0001-01-01")
    except ValueError:
        raise InputError(
            f"since must be a date or time in ISO 8601, got {since!r}. For example 2026-03-01."
        ) from None

    def earlier(date: Any) -> bool:
        if since is None:
            return False
        try:
            return not isinstance(date, str) or moment(date) < least
        except ValueError:  # of campaigns that failed
            return True

    return rows["date"].map(earlier).astype(bool)


def moment(date: str) -> datetime:
    """Return a date or time in ISO 8601 as one in UTC, without a time zone taken as such; else a
    ValueError."""
    found = datetime.fromisoformat(date)
    return found.replace(tzinfo=UTC) if found.tzinfo is None else found.astimezone(UTC)
