"""Which campaigns of a batch are relied on: those asked for, that were fitted, and whose readings the model expects.

A slip does not stay with its campaign: readings a thousand times too large move the mean of a population, widen its spread, and
hide a change of their machine. What is left out is said.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import numpy as np
import pandas as pd

from ldbb_bayes.errors import InputError, nearest
from ldbb_bayes.fleet.reading import contradicts
from ldbb_bayes.fleet.statistics import moment_of

__all__ = ["Choice", "Wanted", "labels", "listed"]

_NAMED = 5
_CIRCLE = "order "


@dataclass(frozen=True)
class Wanted:
    """Which campaigns are asked for.

    Attributes
    ----------
    exclude : sequence of str
        Campaigns (path as given, last part of it, or name) and machines (machine_id) to leave out.
    since : str, optional
        ISO 8601 date or time; campaigns before it, and those without a date, are left out.
    misfits : bool
        Keep campaigns whose readings the model does not expect: orders of a circle that fail their check, or readings against
        non-negative compliance.
    """

    exclude: Sequence[str] = ()
    since: str | None = None
    misfits: bool = False

    def choose(self, rows: pd.DataFrame, among: pd.DataFrame | None = None) -> Choice:
        """The rows to rely on.

        Parameters
        ----------
        rows : DataFrame
            Of `read_batch`; of columns that it lacks nothing is said.
        among : DataFrame, optional
            The whole batch, what ``exclude`` may name; default: the rows.

        Raises
        ------
        InputError
            For unknown names, a date that is none, or nothing left.
        """
        choice = Choice(rows)
        choice = choice.without(_named(rows, self.exclude, rows if among is None else among), "as was asked for")
        if self.since is not None:
            choice = choice.without(_before(choice.rows, self.since), f"for no date, or one before {self.since}")
        if choice.rows.empty:
            raise InputError(f"campaigns must be left to rely on, got all {len(rows)} of them left out. Exclude fewer.")
        choice = choice.without(choice.rows["status"] != "done", "for they could not be fitted")
        if choice.rows.empty:
            raise InputError(
                f"a batch must have at least one campaign that was fitted, got none of {len(rows)}. See its reasons."
            )
        choice = choice.without(
            choice.rows["gaussian_names"].isna(),
            "for they have no sufficient statistics (flat priors, or a breakdown: see warnings)",
        )
        if choice.rows.empty:
            raise InputError(
                f"campaigns must have sufficient statistics, got none of {len(rows)} (flat priors, or a breakdown: see "
                "warnings). Run the batch with proper priors."
            )
        if "sha256" in choice.rows:
            again = choice.rows["sha256"].notna() & choice.rows["sha256"].duplicated()
            choice = choice.without(again, "for their readings are those of campaigns before them")
        unfit = _unfit(choice.rows)
        if self.misfits:
            return choice.saying(unfit, "The model does not expect the readings of {}: kept, as was asked for.")
        if unfit.all():
            raise InputError(
                f"campaigns must have readings that the model expects, got none of {len(unfit)}. See their verdicts and mend "
                "them, or keep them all the same: --include-misfits (include_misfits=True)."
            )
        return choice.without(
            unfit, "for the model does not expect their readings (see their verdicts; --include-misfits keeps them)"
        )


@dataclass(frozen=True)
class Choice:
    """Campaigns that are left, and what was left out and why, in sentences."""

    rows: pd.DataFrame
    notes: tuple[str, ...] = field(default=())

    def without(self, which: pd.Series[bool], why: str) -> Choice:
        """Without some of the campaigns."""
        if not which.any():
            return self
        return Choice(self.rows[~which], (*self.notes, f"Left out, {why}: {listed(labels(self.rows[which]))}."))

    def saying(self, which: pd.Series[bool], sentence: str) -> Choice:
        """The same, with a sentence on some of the campaigns."""
        if not which.any():
            return self
        return Choice(self.rows, (*self.notes, sentence.format(listed(labels(self.rows[which])))))

    def doubts(self) -> tuple[str, ...]:
        """The notes, and what is to be minded of the campaigns that are left."""
        rows, said = self.rows, self
        if "converged" in rows:
            lost = rows["converged"].map(lambda own: not pd.isna(own) and not own).astype(bool)
            said = said.saying(lost, "Not converged, refit with more draws: {}.")
        if "misfits" in rows:
            other = rows["misfits"].map(lambda own: bool(_texts(own))).astype(bool) & ~_unfit(rows)
            said = said.saying(other, "Noise that is not white, so that uncertainties may be too small: {}.")
        notes = said.notes
        if "model_sha256" in rows and rows["model_sha256"].nunique(dropna=True) > 1:
            notes += ("The campaigns were fitted with different models or priors; each one's priors are divided out.",)
        return notes


def labels(rows: pd.DataFrame) -> list[str]:
    """What campaigns are called: by name, those whose name others have too by path."""
    paths = rows["campaign"].astype(str)
    if "name" not in rows:
        return list(paths)
    names = rows["name"].where(rows["name"].map(lambda own: isinstance(own, str)), paths)
    return [str(path if same else name) for name, path, same in zip(names, paths, names.duplicated(keep=False), strict=True)]


def listed(names: Iterable[str]) -> str:
    """A few names, and how many more."""
    every = list(names)
    more = len(every) - _NAMED
    return ", ".join(every[:_NAMED]) + (f" and {more} more" if more > 0 else "")


def _named(rows: pd.DataFrame, exclude: Sequence[str], among: pd.DataFrame) -> pd.Series[bool]:
    """Campaigns that are, or whose machine is, among the names."""
    found = pd.Series(False, index=rows.index)
    for wanted in [exclude] if isinstance(exclude, str) else exclude:
        if not _called(among, wanted).any():
            every = {str(own) for column in _callings(among)[1:] for own in column if isinstance(own, str)}
            raise InputError(
                f"what is left out must be a campaign or machine of the batch, got {wanted!r}. Did you mean "
                f"{nearest(str(wanted), sorted(every))!r}?"
            )
        found |= _called(rows, wanted)
    return found


def _called(rows: pd.DataFrame, name: str) -> Any:
    return np.logical_or.reduce([(own == name).to_numpy(dtype=bool, na_value=False) for own in _callings(rows)])


def _callings(rows: pd.DataFrame) -> list[pd.Series[Any]]:
    """What a campaign goes by."""
    paths = rows["campaign"].astype(str)
    short = paths.map(lambda own: os.path.basename(own.rstrip("/")))
    return [paths, short, *(rows[column] for column in ("name", "machine_id") if column in rows)]


def _before(rows: pd.DataFrame, since: str) -> pd.Series[bool]:
    try:
        least = moment_of(since)
    except ValueError:
        raise InputError(f"since must be a date or time in ISO 8601, got {since!r}. For example 2026-03-01.") from None
    return rows["date"].map(lambda own: _earlier(own, least)).astype(bool)


def _earlier(date: Any, least: datetime) -> bool:
    """Dates of campaigns that failed may be none."""
    try:
        return not isinstance(date, str) or moment_of(date) < least
    except ValueError:
        return True


def _unfit(rows: pd.DataFrame) -> pd.Series[bool]:
    """Whose circles (misfits of an order) the model does not expect, or whose readings speak against non-negative compliance."""
    found = pd.Series(False, index=rows.index)
    if "misfits" in rows:
        found |= rows["misfits"].map(lambda own: any(text.startswith(_CIRCLE) for text in _texts(own))).astype(bool)
    if "log_prob_truncation" in rows:
        found |= rows["log_prob_truncation"].map(lambda own: not pd.isna(own) and contradicts(own)).astype(bool)
    return found


def _texts(value: Any) -> list[str]:
    return [str(own) for own in value] if isinstance(value, list | tuple | np.ndarray) else []
