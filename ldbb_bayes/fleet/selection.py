"""Selection of the campaigns from which a trend or a population of machines is computed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any

import pandas as pd

from ldbb_bayes.campaign.remarks import RemarkKind
from ldbb_bayes.errors import InputError, suggestion
from ldbb_bayes.fleet.dataset import FLEET_COLUMNS, READINGS_DIGESTS
from ldbb_bayes.inference.checks import CheckKind
from ldbb_bayes.inference.fit import ConcernKind
from ldbb_bayes.report.wording import caveat_words
from ldbb_bayes.results import Result

__all__ = ["Caveat", "CaveatKind", "check_rows", "choose", "labels", "moment"]

# Kinds of warnings and checks of a campaign's fit. A warning or a failed check of one of these
# kinds means that the readings of the campaign do not fit the model or that their unit is in
# doubt.
_MISFIT_KINDS: frozenset[str] = frozenset(
    {CheckKind.ORDER, ConcernKind.TRUNCATION, ConcernKind.UNIT}
)
# Kinds of checks of a campaign's fit. A failed check of one of these kinds means that the noise of
# the campaign's readings is not white, although the model assumes white noise.
_NOISE_KINDS: frozenset[str] = frozenset({CheckKind.NOISE, CheckKind.AUTOCORRELATION})
# Largest number of campaigns and machines that an error message on an unknown one names.
_MOST_NAMES = 8


class CaveatKind(StrEnum):
    """Kinds of limitations of a trend or of a population of machines.

    A limitation concerns the analysis itself, the campaigns that the analysis uses, or the
    campaigns that are left out.
    """

    EXCLUDED = "excluded"
    BEFORE = "before"
    FAILED = "failed"
    FAILED_MACHINE_UNKNOWN = "failed-machine-unknown"
    NO_STATISTICS = "no-statistics"
    GIVEN_AGAIN = "given-again"
    UNEXPECTED = "unexpected"
    NOT_CONVERGED = "not-converged"
    NOT_WHITE = "not-white"
    READ_TWICE = "read-twice"
    OTHER_SIGN = "other-sign"
    NO_MACHINES = "no-machines"
    WITHOUT_MACHINE = "without-machine"
    MACHINES_OF_THEIR_OWN = "machines-of-their-own"
    EXTRAPOLATED = "extrapolated"
    NO_DATES = "no-dates"
    TWO_CAMPAIGNS = "two-campaigns"
    TOLERANCES_NOT_FOLLOWED = "tolerances-not-followed"
    TOLERANCES_WITHOUT_TREND = "tolerances-without-trend"
    SPREADS_NOT_TRUSTED = "spreads-not-trusted"
    ONE_INSTRUMENT = "one-instrument"
    CONTRADICTED_INSTRUMENT = "contradicted-instrument"
    FEW_MACHINES = "few-machines"
    UNCERTAIN_P_VALUES = "uncertain-p-values"


# Caveats on campaigns that are used although a remark says that some of their readings are wrong.
# The values are the kinds of these remarks in the rows of a batch.
_CAVEATS_ON_READINGS: dict[CaveatKind, str] = {
    CaveatKind.READ_TWICE: RemarkKind.COPY,
    CaveatKind.OTHER_SIGN: RemarkKind.MIRRORED,
}


@dataclass(frozen=True)
class Caveat(Result):
    """One limitation of a trend or a population. Reports describe it to the user in a sentence."""

    #: kind of one limitation of a trend or a population. The kind ``two-campaigns``, for example,
    #: means that there are only two campaigns.
    kind: CaveatKind
    #: names of the campaigns, machines or parameters that a limitation of a trend or a population
    #: concerns
    names: tuple[str, ...] = ()
    #: numbers that a report includes in its sentence on a limitation of a trend or a population. If
    #: there are few machines, for example, these are their number and the number that is needed.
    values: tuple[float, ...] = ()
    #: detail that a report includes in its sentence on a limitation of a trend or a population. If
    #: earlier campaigns are left out, for example, it is the date from which campaigns are used.
    text: str = ""


def check_rows(rows: pd.DataFrame) -> None:
    """Raise an `InputError` if rows are not the table of a batch.

    Parameters
    ----------
    rows : table of a batch, as `read_batch` returns it.

    Raises
    ------
    InputError
        If a column that a trend or a population needs is missing.
    """
    for name in FLEET_COLUMNS:
        if name not in rows:
            raise InputError(
                f"rows must be the table of a batch, got one without {name}. Give what read_batch"
                " returns."
            )


def choose(
    rows: pd.DataFrame,
    exclude: Sequence[str] = (),
    since: str | None = None,
    include_misfits: bool = False,
    *,
    among: pd.DataFrame | None = None,
) -> tuple[pd.DataFrame, list[Caveat]]:
    """Return the rows of a batch to be analysed, and limitations (caveats) of this selection.

    By default, campaigns whose readings do not fit the model are left out. The readings do not fit
    if they differ too much from the model at one Fourier order of a circle, if they contradict the
    condition that no compliance is negative, or if their unit is in doubt. For example, readings in
    a wrong unit would shift the mean of a population and increase its spread, or hide a change of a
    machine. The following campaigns are also left out:

    - campaigns that could not be fitted;
    - campaigns whose row lacks sufficient statistics;
    - campaigns that the user excludes;
    - campaigns with the same readings as an earlier row, whatever else they state.

    Parameters
    ----------
    rows : table of a batch, as `read_batch` returns it.
    exclude : campaigns and machines to leave out. A campaign is identified by its path as in the
        table, by the last part of this path or by its name; a machine by its machine_id.
    since : date (ISO 8601); campaigns that are earlier or have no date are left out.
    include_misfits : whether to keep campaigns whose readings do not fit the model.
    among : table of the whole batch; every name in ``exclude`` must be in this table. Default:
        ``rows``.

    Returns
    -------
    The rows to use, and caveats. The caveats name the campaigns that are left out, and those that
    are kept although their sampler did not converge, their noise is not white, a test was read
    twice or a test has the other sign.

    Raises
    ------
    InputError
        If no campaign is left, a name is unknown, or ``since`` is not a date.
    """
    check_rows(rows)
    batch = rows if among is None else among
    selection = _Selection(rows, batch)
    selection.leave_out(CaveatKind.EXCLUDED, _is_named(rows, exclude, batch))
    is_early = _is_undated_or_before(selection.rows, since)
    selection.leave_out(CaveatKind.BEFORE, is_early, text=since or "")
    selection.leave_out(CaveatKind.FAILED, selection.rows["status"] != "done")
    selection.leave_out(CaveatKind.NO_STATISTICS, selection.rows["gaussian_names"].isna())
    selection.leave_out(CaveatKind.GIVEN_AGAIN, _is_given_again(selection.rows))
    if not include_misfits:
        is_misfit = _reports_any_of(selection.rows, _MISFIT_KINDS)
        selection.leave_out(CaveatKind.UNEXPECTED, is_misfit)
    used_rows = selection.rows
    if used_rows.empty:
        reasons = " ".join(caveat_words(caveat) for caveat in selection.caveats)
        raise InputError(
            f"campaigns must be left to rely on, got none of {len(rows)}. {reasons} Mend these, or"
            " exclude fewer."
        )
    not_white = _reports_any_of(used_rows, _NOISE_KINDS) & ~_reports_any_of(
        used_rows, _MISFIT_KINDS
    )
    selection.add_caveat(CaveatKind.NOT_CONVERGED, used_rows["converged"].eq(False))
    selection.add_caveat(CaveatKind.NOT_WHITE, not_white)
    for caveat_kind, remark_kind in _CAVEATS_ON_READINGS.items():
        is_odd = _reports_any_of(used_rows, frozenset({remark_kind}))
        selection.add_caveat(caveat_kind, is_odd)
    return used_rows, selection.caveats


class _Selection:
    """Rows of a batch's table that are still to be used, and caveats on the campaigns left out."""

    def __init__(self, rows: pd.DataFrame, batch: pd.DataFrame) -> None:
        """Store the rows. ``batch`` is the table of the whole batch; its names give the labels."""
        self.rows = rows
        self.caveats: list[Caveat] = []
        self._batch = batch

    def leave_out(self, kind: CaveatKind, is_left_out: pd.Series[bool], text: str = "") -> None:
        """Remove rows, and add a caveat that names the campaigns removed, if there are any.

        ``is_left_out`` states for each row whether it is removed. ``kind`` and ``text`` are the
        kind and the text of the caveat.
        """
        self.add_caveat(kind, is_left_out, text)
        self.rows = self.rows[~is_left_out]

    def add_caveat(self, kind: CaveatKind, concerns: pd.Series[bool], text: str = "") -> None:
        """Add a caveat (limitation of an analysis) on some campaigns, if there are any.

        ``concerns`` states for each row whether the caveat is on its campaign. ``kind`` and
        ``text`` are the kind and the text of the caveat.
        """
        if concerns.any():
            names = labels(self.rows[concerns], self._batch)
            self.caveats.append(Caveat(kind, tuple(names), text=text))


def _is_given_again(rows: pd.DataFrame) -> pd.Series[bool]:
    """Return for each campaign whether an earlier row holds the same readings.

    The digest of the readings alone also recognises readings for which another order of the tests
    or another mount is stated. Rows of earlier versions lack this digest; of these, only campaigns
    with the same readings and the same conditions are recognised. ``rows`` has one row per
    campaign.
    """
    is_again = pd.Series(False, index=rows.index, dtype=bool)
    for column in READINGS_DIGESTS:
        if column in rows:
            is_again |= rows[column].notna() & rows[column].duplicated()
    return is_again


def _reports_any_of(rows: pd.DataFrame, kinds: frozenset[str]) -> pd.Series[bool]:
    """Return for each campaign whether its fit has a warning or a failed check of the given kinds.

    The kind "order", for example, means that the difference between readings and model is too large
    at one Fourier order of a circle. ``rows`` are rows of the table of a batch, one per campaign.
    """
    matches = [
        reported is not None and not kinds.isdisjoint(reported) for reported in rows["kinds"]
    ]
    return pd.Series(matches, index=rows.index, dtype=bool)


def labels(rows: pd.DataFrame, among: pd.DataFrame | None = None) -> list[str]:
    """Return the label of each campaign: its name, or its file path if it has no unique name.

    Parameters
    ----------
    rows : rows of the table of a batch, as `read_batch` returns it.
    among : table in which a name must be unique. Default: ``rows``.
    """
    names = _names(rows)
    how_often = _names(rows if among is None else among).value_counts()
    is_unique = names.map(how_often).eq(1)
    return [str(label) for label in names.where(is_unique, rows["campaign"].astype(str))]


def _names(rows: pd.DataFrame) -> pd.Series[str]:
    """Return the name of each campaign, or its file path if it has no name."""
    return rows["name"].where(rows["name"].map(_is_text), rows["campaign"].astype(str))


def _is_text(value: Any) -> bool:
    """Return whether a cell of a table holds a text. An empty cell holds NaN or None."""
    return isinstance(value, str)


def _is_named(rows: pd.DataFrame, exclude: Sequence[str], batch: pd.DataFrame) -> pd.Series[bool]:
    """Return for each campaign whether the user excluded the campaign or its machine by name.

    ``exclude`` are the names that the user gave. Raise an `InputError` if the table ``batch`` has
    no campaign or machine of one of these names. ``rows`` has one row per campaign.
    """
    excluded = [exclude] if isinstance(exclude, str) else list(exclude)
    known_names = _excludable_names(batch)
    for name in excluded:
        if not known_names.isin([name]).any(axis=None):
            entries = known_names.drop(columns="path").to_numpy().ravel()
            candidates = sorted({entry for entry in entries if isinstance(entry, str)})
            names = f" It has {', '.join(candidates[:_MOST_NAMES])}."
            raise InputError(
                f"what is left out must be a campaign or machine of the batch, got {name!r}."
                f"{suggestion(str(name), candidates) or names}"
            )
    return _excludable_names(rows).isin(excluded).any(axis=1)


def _excludable_names(rows: pd.DataFrame) -> pd.DataFrame:
    """Return a table of the names by which a user can exclude each campaign or its machine.

    The table has one row per campaign and four columns: ``name``, ``machine_id``, ``path`` (file
    path of the campaign) and ``last`` (last part of this path).
    """
    paths = rows["campaign"].astype(str)
    last_parts = paths.map(_last_part)
    return rows[["name", "machine_id"]].assign(path=paths, last=last_parts)


def _last_part(path: str) -> str:
    """Return the last part of a path, for example ``machine_1`` of ``campaigns/machine_1/``."""
    return os.path.basename(path.rstrip("/"))


def _is_undated_or_before(rows: pd.DataFrame, since: str | None) -> pd.Series[bool]:
    """Return for each campaign whether its date is missing or before the date ``since``.

    If ``since`` is None, the result is false for all campaigns. ``rows`` has one row per campaign.
    Raise an `InputError` if ``since`` is not a date.
    """
    if since is None:
        return pd.Series(False, index=rows.index, dtype=bool)
    try:
        first = moment(since)
    except ValueError:
        raise InputError(
            f"since must be a date or time in ISO 8601, got {since!r}. For example 2026-03-01."
        ) from None
    is_early = [_is_earlier(date, first) for date in rows["date"]]
    return pd.Series(is_early, index=rows.index, dtype=bool)


def _is_earlier(date: Any, first: datetime) -> bool:
    """Return whether a campaign's date is before the date ``first``.

    A campaign without a valid date also counts as earlier.
    """
    if not isinstance(date, str):
        return True
    try:
        return moment(date) < first
    except ValueError:  # A campaign that could not be fitted may have an invalid date.
        return True


def moment(date: str) -> datetime:
    """Return the date or time that a text states, in UTC.

    A time without a time zone is taken as UTC.

    Parameters
    ----------
    date : date or time in ISO 8601.

    Raises
    ------
    ValueError
        If the text is not a date or time in ISO 8601.
    """
    instant = datetime.fromisoformat(date)
    if instant.tzinfo is None:
        return instant.replace(tzinfo=UTC)
    return instant.astimezone(UTC)
