"""Split from its neighbours; see there."""

from __future__ import annotations

import json
import shutil
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from pydantic_core import to_jsonable_python

from ldbb_bayes.errors import InputError, require
from ldbb_bayes.files import write_whole
from ldbb_bayes.fleet.campaign_row import Job, Settings
from ldbb_bayes.fleet.dataset import (
    DATASET,
    JOURNAL,
    PART,
)
from ldbb_bayes.model.specification import model_sha256
from ldbb_bayes.parallel import versions

LIST = "campaigns.txt"


_OURS = (JOURNAL, f"{JOURNAL}-wal", f"{JOURNAL}-shm", f"{JOURNAL}-journal", LIST, DATASET, PART)


_TABLES = """
CREATE TABLE IF NOT EXISTS batch (record TEXT);
CREATE TABLE IF NOT EXISTS campaigns (number INTEGER PRIMARY KEY, path TEXT, place TEXT, status TEXT, state TEXT, row TEXT);
"""


@contextmanager
def _journal(out: Path) -> Iterator[sqlite3.Connection]:
    """The database of a folder, made if need be; SQLite's lock keeps other runs out while the block
    lasts."""
    made = not out.exists()
    require(made or out.is_dir(), f"{out} must be a folder, got a file. Choose another name.")
    first = (
        min((path.name for path in out.iterdir() if path.name not in _OURS), default=None)
        if out.is_dir()
        else None
    )
    require(
        first is None,
        f"{out} must hold nothing but a batch, got {first!r}. Move it away or choose another name.",
    )
    try:
        out.mkdir(parents=True, exist_ok=True)
        connection = sqlite3.connect(out / JOURNAL, timeout=0.0, isolation_level=None)
    except (OSError, sqlite3.Error) as error:
        raise InputError(f"{out} must be writable, got: {error}. Choose another place.") from None
    begun = not made
    with closing(connection):
        try:
            connection.execute("PRAGMA locking_mode = EXCLUSIVE")
            connection.execute("PRAGMA journal_mode = WAL")
            connection.executescript(
                f"PRAGMA synchronous = NORMAL; BEGIN EXCLUSIVE; {_TABLES} COMMIT;"
            )
            yield connection
            begun = True
        except sqlite3.Error as error:
            raise InputError(
                f"{out / JOURNAL} must be a sound journal that can be written and that no other run"
                f" is using, got: {error}. What is in it is kept: wait for the other run or free"
                " some space, then go on with --resume; remove a damaged one."
            ) from None
        finally:
            with suppress(sqlite3.Error):
                begun = begun or connection.execute("SELECT count(*) FROM batch").fetchone()[0] > 0
            if not begun:
                shutil.rmtree(out, ignore_errors=True)


def _record(settings: Settings) -> dict[str, Any]:
    """What makes a batch what it is."""
    given = {
        "table option": settings.table,
        "certificate": settings.certificates,
        "tolerance": settings.tolerances,
    }
    return {
        "model": model_sha256(settings.model)[:12],
        **{
            name: getattr(settings, name)
            for name in ("sampler", "seed", "ess", "ci_prob", "compare")
        },
        **{
            f"{kind} {name}": to_jsonable_python(value)
            for kind, own in given.items()
            for name, value in own.items()
        },
        **{f"version of {name}": value for name, value in versions().items()},
    }


def _begin(
    journal: sqlite3.Connection,
    out: Path,
    jobs: Sequence[Job],
    record: Mapping[str, Any],
    resume: bool,
    force: bool,
) -> bool:
    """Write down what the batch is, or compare it with what is there; whether there was one."""
    before = journal.execute("SELECT record FROM batch").fetchone()
    if before is None and not force and (out / DATASET).exists():
        raise InputError(
            f"{out} must hold the journal of its batch, got none. Begin anew (--force), or choose"
            " another name."
        )
    if before is not None and not resume and not force:
        state = "a finished" if (out / DATASET).exists() else "an unfinished"
        cure = (
            "Go on with it (--resume; failed campaigns again: --resume --retry), begin anew"
            " (--force), or choose another name."
        )
        raise InputError(f"{out} must not hold a batch, got {state} one. {cure}")
    if before is not None and resume:
        _check_same(journal, out, jobs, json.loads(before[0]), json.loads(json.dumps(record)))
        return True
    (out / DATASET).unlink(missing_ok=True)
    write_whole(out / LIST, "".join(f"{job.place}\n" for job in jobs).encode())
    with journal:
        journal.execute("BEGIN")
        journal.execute("DELETE FROM batch")
        journal.execute("DELETE FROM campaigns")
        journal.executemany("INSERT INTO campaigns (number, path, place) VALUES (?, ?, ?)", jobs)
        journal.execute("INSERT INTO batch VALUES (?)", [json.dumps(record)])
    return False


def _check_same(
    journal: sqlite3.Connection,
    out: Path,
    jobs: Sequence[Job],
    before: Mapping[str, Any],
    now: Mapping[str, Any],
) -> None:
    for name in sorted({*before, *now}):
        got, has = ("nothing" if own.get(name) is None else own[name] for own in (before, now))
        cure = "Resume with what the batch was begun with, or begin anew (--force)."
        said = f"{out} must be of this batch, got {name} {got} where this run has {has}. {cure}"
        require(before.get(name) == now.get(name), said)
    there = [place for (place,) in journal.execute("SELECT place FROM campaigns ORDER BY number")]
    cure = (
        f"Go on with its own list: @{out / LIST} --resume. New campaigns make a batch of their own."
    )
    got = (
        f"got other campaigns ({len(there)} where this run has {len(jobs)}, or in another order)."
        f" {cure}"
    )
    require(there == [job.place for job in jobs], f"{out} must be of this batch, {got}")


def _plain(value: Any) -> Any:
    """For JSON and Parquet: numbers that are none become null, half a character, as names of files
    hold one, a question mark."""
    if isinstance(value, dict):
        return {name: _plain(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, str):
        return value.encode("utf-8", "replace").decode()
    return None if isinstance(value, float) and not np.isfinite(value) else value
