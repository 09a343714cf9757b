"""Journal of a batch: an SQLite database in which every row is saved as soon as it is computed.

With the journal, a batch that was stopped can be continued with the remaining campaigns. A lock on
the journal also prevents two runs from writing into the same folder.
"""

from __future__ import annotations

import json
import math
import shutil
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from pydantic_core import to_jsonable_python

from ldbb_bayes.errors import InputError
from ldbb_bayes.files import write_whole
from ldbb_bayes.fleet.campaign_files import digest_of_files
from ldbb_bayes.fleet.campaign_row import Job, Settings
from ldbb_bayes.fleet.dataset import (
    DATASET,
    JOURNAL,
    PART,
    SPREADSHEET,
    SPREADSHEET_PART,
)
from ldbb_bayes.model.specification import model_sha256
from ldbb_bayes.parallel import versions

__all__ = ["batch_identity", "begin_batch", "open_journal", "save_row"]

# Name of the text file, in the folder of a batch, with the file paths of all its campaigns.
_LIST = "campaigns.txt"
# Names of all files that the folder of a batch may hold: the journal (an SQLite database of the
# rows), SQLite's temporary files for this database, the list of campaigns, and the finished and the
# unfinished table, as Parquet and as CSV.
_BATCH_FILES = (
    JOURNAL,
    f"{JOURNAL}-wal",
    f"{JOURNAL}-shm",
    f"{JOURNAL}-journal",
    _LIST,
    DATASET,
    PART,
    SPREADSHEET,
    SPREADSHEET_PART,
)
# SQL statements that make the three tables of a journal. ``batch`` has one row, the identity of the
# batch as JSON. ``campaigns`` has a row for each campaign: its number, its path as the user wrote
# it, its absolute path (``place``) and, after the fit, status, state and the row of the batch's
# table as JSON. ``files`` has, after the fit, the digest of the files of each campaign.
_TABLES = """
CREATE TABLE IF NOT EXISTS batch (record TEXT);
CREATE TABLE IF NOT EXISTS campaigns (
    number INTEGER PRIMARY KEY, path TEXT, place TEXT, status TEXT, state TEXT, row TEXT
);
CREATE TABLE IF NOT EXISTS files (number INTEGER PRIMARY KEY, digest TEXT);
"""


@contextmanager
def open_journal(out: Path) -> Iterator[sqlite3.Connection]:
    """Yield the journal of a batch, locked against other runs until the ``with`` block ends.

    The journal is an SQLite database in the folder of the batch, in which every campaign's row is
    saved.

    Parameters
    ----------
    out : folder of the batch. A folder that does not exist is made. It is removed again if an error
        ends the ``with`` block, or the preparation of the database, before a batch has begun. It is
        kept if the database cannot be opened.

    Raises
    ------
    InputError
        If the folder holds anything other than a batch, cannot be written, or is in use by another
        run. Any error of the database in the ``with`` block, for example because the disk is full,
        is also raised as an `InputError`.
    """
    is_new = not out.exists()
    _check_folder(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
        connection = sqlite3.connect(out / JOURNAL, timeout=0.0, isolation_level=None)
    except (OSError, sqlite3.Error) as error:
        raise InputError(f"{out} must be writable, got: {error}. Choose another place.") from None
    keep_folder = not is_new
    with closing(connection):
        try:
            connection.execute("PRAGMA locking_mode = EXCLUSIVE")
            connection.execute("PRAGMA journal_mode = WAL")
            connection.executescript(
                f"PRAGMA synchronous = NORMAL; BEGIN EXCLUSIVE; {_TABLES} COMMIT;"
            )
            yield connection
            keep_folder = True
        except sqlite3.Error as error:
            raise InputError(
                f"{out / JOURNAL} must be a sound journal that can be written and that no other run"
                f" is using, got: {error}. What is in it is kept: wait for the other run or free"
                " some space, then go on with --resume; remove a damaged one."
            ) from None
        finally:
            if not keep_folder and not _holds_batch(connection):
                shutil.rmtree(out, ignore_errors=True)


def _check_folder(out: Path) -> None:
    """Raise an `InputError` if ``out`` cannot be the folder of a batch.

    The folder need not exist. If it exists, it must hold nothing but the files of a batch.
    """
    if not out.exists():
        return
    if not out.is_dir():
        raise InputError(f"{out} must be a folder, got a file. Choose another name.")
    other_names = [path.name for path in out.iterdir() if path.name not in _BATCH_FILES]
    if other_names:
        raise InputError(
            f"{out} must hold nothing but a batch, got {min(other_names)!r}. Move it away or choose"
            " another name."
        )


def _holds_batch(journal: sqlite3.Connection) -> bool:
    """Return whether the journal, an SQLite database, states to which batch it belongs."""
    with suppress(sqlite3.Error):
        (count,) = journal.execute("SELECT count(*) FROM batch").fetchone()
        return bool(count > 0)
    return False


def batch_identity(settings: Settings) -> dict[str, Any]:
    """Return the options and versions that must be the same in all runs of one batch.

    Parameters
    ----------
    settings : settings with which the campaigns of the batch are fitted.

    Returns
    -------
    Dictionary of options and versions of software. The keys are the names that the error message
    uses if an option or a version differs between two runs.
    """
    identity: dict[str, Any] = {"model": model_sha256(settings.model)[:12]}
    for name in ("sampler", "seed", "ess", "prob", "compare"):
        identity[name] = getattr(settings, name)
    options_by_kind = {
        "table option": settings.table,
        "certificate": settings.certificates,
        "tolerance": settings.tolerances,
    }
    for kind, options in options_by_kind.items():
        for name, value in options.items():
            identity[f"{kind} {name}"] = to_jsonable_python(value)
    for name, version in versions().items():
        identity[f"version of {name}"] = version
    return identity


def begin_batch(
    journal: sqlite3.Connection,
    out: Path,
    jobs: Sequence[Job],
    identity: Mapping[str, Any],
    *,
    resume: bool,
    force: bool,
) -> bool:
    """Record a new batch in the journal, or check that the batch in the journal can be continued.

    Parameters
    ----------
    journal : the open journal of the folder ``out``: a database that holds the results of every
        campaign of the batch in one row, see `open_journal`.
    out : folder of the batch.
    jobs : campaigns of the batch, in the order of their numbers.
    identity : options and versions of software of this run, see `batch_identity`.
    resume : whether to continue the batch in the folder, if there is a batch.
    force : whether to replace the batch in the folder, if there is a batch.

    Returns
    -------
    Whether an earlier batch is continued.

    Raises
    ------
    InputError
        If the journal records a batch, and neither ``resume`` nor ``force`` is set. The error is
        also raised if ``resume`` is set, but the recorded batch has other campaigns, options or
        versions of software. Finally, it is raised if the folder holds a table of results whose
        batch is not recorded in the journal, unless ``force`` is set.
    """
    saved = journal.execute("SELECT record FROM batch").fetchone()
    has_table = (out / DATASET).exists()
    if saved is None and has_table and not force:
        raise InputError(
            f"{out} must hold the journal of its batch, got none. Begin anew (--force), or choose"
            " another name."
        )
    if saved is not None and not resume and not force:
        state = "a finished" if has_table else "an unfinished"
        raise InputError(
            f"{out} must not hold a batch, got {state} one. Go on with it (--resume; failed"
            " campaigns again: --resume --retry), begin anew (--force), or choose another name."
        )
    record = json.dumps(identity)
    if saved is not None and resume:
        _check_same_identity(out, json.loads(saved[0]), json.loads(record))
        _check_same_campaigns(journal, out, jobs)
        _forget_changed_campaigns(journal)
        return True
    for name in (DATASET, SPREADSHEET):
        (out / name).unlink(missing_ok=True)
    lines = [f"{job.absolute_path}\n" for job in jobs]
    write_whole(out / _LIST, "".join(lines).encode())
    with journal:
        journal.execute("BEGIN")
        journal.execute("DELETE FROM batch")
        journal.execute("DELETE FROM campaigns")
        journal.execute("DELETE FROM files")
        journal.executemany("INSERT INTO campaigns (number, path, place) VALUES (?, ?, ?)", jobs)
        journal.execute("INSERT INTO batch VALUES (?)", [record])
    return False


def _check_same_identity(
    out: Path, identity_there: Mapping[str, Any], identity_here: Mapping[str, Any]
) -> None:
    """Raise an `InputError` if this run has other options or versions of software than the batch.

    ``identity_there`` holds the options and versions with which the batch in the folder ``out`` was
    begun; ``identity_here`` holds those of this run.
    """
    for name in sorted({*identity_there, *identity_here}):
        if identity_there.get(name) != identity_here.get(name):
            raise InputError(
                f"{out} must be resumed with the options that its batch was begun with, got"
                f" {_option_in_message(name, identity_here.get(name))} where the batch has"
                f" {_option_in_message(name, identity_there.get(name))}. Resume with the same"
                " options, or begin anew (--force), which fits every campaign again."
            )


def _option_in_message(name: str, value: Any) -> str:
    """Return an option with its value as an error message states it, such as "seed 2"."""
    return f"no {name}" if value is None else f"{name} {value}"


def _check_same_campaigns(journal: sqlite3.Connection, out: Path, jobs: Sequence[Job]) -> None:
    """Raise an `InputError` unless the batch in the journal has exactly the campaigns of this run.

    The journal is the database of the batch's rows. ``jobs`` are the campaigns of this run, in
    order of their numbers, and ``out`` is the folder of the batch.
    """
    query = "SELECT place FROM campaigns ORDER BY number"
    paths_there = [path for (path,) in journal.execute(query)]
    paths_here = [job.absolute_path for job in jobs]
    if paths_there != paths_here:
        raise InputError(
            f"{out} must be of this batch, got other campaigns ({len(paths_there)} where this run"
            f" has {len(paths_here)}, or in another order). Go on with its own list: @{out / _LIST}"
            " --resume. New campaigns make a batch of their own."
        )


def _forget_changed_campaigns(journal: sqlite3.Connection) -> None:
    """Remove the rows of the campaigns whose files have changed since they were fitted.

    These campaigns are then fitted again. The row of a campaign is kept if the campaign has been
    moved away, or if no digest of its files was saved. ``journal`` is the database of the batch's
    rows.
    """
    query = (
        "SELECT number, place, digest FROM campaigns JOIN files USING (number)"
        " WHERE digest IS NOT NULL AND status IS NOT NULL"
    )
    changed = []
    for number, path, digest in journal.execute(query):
        if Path(path).exists() and digest_of_files(path) != digest:
            changed.append((number,))
    journal.executemany(
        "UPDATE campaigns SET status = NULL, state = NULL, row = NULL WHERE number = ?", changed
    )


def save_row(
    journal: sqlite3.Connection, number: int, row: Mapping[str, Any], digest: str | None = None
) -> None:
    """Save the row of a campaign in the journal, which must already list the campaign.

    The row is saved without a commit, because every statement is a separate transaction. The digest
    is saved first: a row is therefore never saved without the digest of its files.

    Parameters
    ----------
    journal : open journal (database of the rows), see `open_journal`.
    number : number of the campaign in the batch, from 0.
    row : dictionary of the row's values; the keys are the names of the columns, see `fit_row`. The
        status is "done" or "failed". The state says how far a fit can be trusted; a campaign that
        could not be fitted has no state.
    digest : digest of the campaign's files before the fit; None if it is not known.
    """
    journal.execute("INSERT OR REPLACE INTO files VALUES (?, ?)", (number, digest))
    journal.execute(
        "UPDATE campaigns SET status = ?, state = ?, row = ? WHERE number = ?",
        (row["status"], row.get("state"), json.dumps(_storable(row)), number),
    )


def _storable(value: Any) -> Any:
    """Return a value of a campaign's row in a form that can be stored as JSON and Parquet.

    The value may be nested. Numbers that are not finite become None (null in JSON), and tuples
    become lists. Characters that UTF-8 cannot encode, which file names may contain, become question
    marks.
    """
    if isinstance(value, Mapping):
        return {name: _storable(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_storable(entry) for entry in value]
    if isinstance(value, str):
        return value.encode("utf-8", "replace").decode()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
