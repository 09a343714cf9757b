"""Many campaigns into one table: each fitted by itself into a row, rows kept in SQLite as they come
and exported as Parquet."""

from __future__ import annotations

import json
import operator
import os
import sqlite3
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Executor
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from ldbb_bayes.campaign.folder import labels_of
from ldbb_bayes.errors import require
from ldbb_bayes.fleet.campaign_row import Job, Settings, _given, fit_row
from ldbb_bayes.fleet.dataset import (
    DATASET,
    check_pyarrow,
    read_batch,
    write_dataset,
)
from ldbb_bayes.fleet.gathering import gather
from ldbb_bayes.fleet.journal import _begin, _journal, _plain, _record
from ldbb_bayes.inference.fit import State
from ldbb_bayes.inference.sample import sampler_named
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.specification import model_from_toml, model_to_toml
from ldbb_bayes.parallel import Lost, done
from ldbb_bayes.results import Result

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Batch", "batch"]


# ---- which campaigns


# ---- one campaign, one row


# ---- the journal

_MOST_NAMED = 10_000


def _fit(
    journal: sqlite3.Connection,
    settings: Settings,
    executor: Executor | None,
    retry: bool,
    progress: Callable[[int, int, int], None] | None,
) -> int:
    """Fit what has no row, and with ``retry`` what failed, each row a transaction; the number of
    campaigns fitted."""
    wanted = "status IS NULL OR status = 'failed'" if retry else "status IS NULL"
    jobs = [
        Job(*own)
        for own in journal.execute(
            f"SELECT number, path, place FROM campaigns WHERE {wanted} ORDER BY number"
        )
    ]
    (every,) = journal.execute("SELECT count(*) FROM campaigns").fetchone()
    failed = {
        number
        for (number,) in journal.execute("SELECT number FROM campaigns WHERE status = 'failed'")
    }
    if progress is not None and jobs:
        progress(every - len(jobs), every, len(failed))
    with closing(done(partial(fit_row, settings), jobs, executor)) as results:  # type: ignore[type-var]
        for count, (place, result) in enumerate(results, start=1):
            job = jobs[place]
            if isinstance(result, Lost):
                result = (
                    labels_of(job.place)
                    | _given(settings, job)
                    | {
                        "status": "failed",
                        "reason": result.reason,
                    }
                )
            journal.execute(
                "UPDATE campaigns SET status = ?, state = ?, row = ? WHERE number = ?",
                (result["status"], result.get("state"), json.dumps(_plain(result)), job.number),
            )
            (failed.add if result["status"] == "failed" else failed.discard)(job.number)
            if progress is not None:
                progress(every - len(jobs) + count, every, len(failed))
    return len(jobs)


# ---- the batch


@dataclass(frozen=True)
class Batch(Result):
    """A finished batch."""

    out: Path  #: the folder
    dataset: Path  #: the Parquet table in it
    campaigns: int  #: in all
    done: int  #: fitted, now or before
    failed: Annotated[int, Field(alias="failures")]  #: that could not be fitted
    not_converged: int  #: of those done: that missed the sampling target
    #: of those done: whose readings the model does not expect, or that speak against it
    doubtful: int
    #: campaign and reason, of the first 10 000
    failures: Annotated[tuple[dict[str, str], ...], Field(alias="failed")]
    doubts: tuple[dict[str, str], ...]  #: campaign and verdict, likewise
    fitted: int  #: campaigns fitted by this run, the others were there
    seconds: float  #: that took
    resumed: bool  #: whether an earlier run was gone on with

    def rows(self) -> pd.DataFrame:
        """Return every row; see `read_batch`."""
        return read_batch(self.out)


def batch(
    campaigns: Iterable[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    model: HybridModel | None = None,
    sampler: str = "independent",
    executor: Executor | Callable[[], AbstractContextManager[Executor | None]] | None = None,
    seed: int = 1,
    ess: float = 1000.0,
    ci_prob: float = 0.95,
    compare: bool = True,
    table: Mapping[str, Any] | None = None,
    certificates: Mapping[str, Any] | None = None,
    tolerances: Mapping[str, str] | None = None,
    resume: bool = False,
    retry: bool = False,
    force: bool = False,
    progress: Callable[[int, int, int], None] | None = None,
) -> Batch:
    """Fit every campaign by itself, each into one row of a table; a campaign that cannot be fitted
    is a row that says why.

    Every row is kept as it comes. Whatever stops a batch (Ctrl-C, kill -9, a full disk), the same
    call with ``resume`` goes on with what is left, to the very same table. InputError for no
    campaigns, a batch in ``out`` that may not be touched or is another one, a place that cannot be
    written, or without pyarrow.

    Parameters
    ----------
    campaigns : see `gather`: campaign folders, campaign.toml files, tidy CSVs, folders of
        campaigns, and lists of them (``@FILE``).
    out : folder for the rows and the table.
    model : default: linear in force.
    sampler, seed, ess, ci_prob
        As for `sample` and `summarize`: the numbers are theirs.
    executor : where campaigns are fitted; default: here, one after the other. What starts one, such
        as `process_executor` itself, is called once ``out`` is this run's, which it stays until the
        workers have ended.
    compare : weigh linear compliance against constant by their evidences.
    table : fields of `Campaign` for tidy CSVs: what campaign.toml would say.
    certificates : fields of `Instrument` for all campaigns, instead of what campaign.toml says of
        them.
    tolerances : limits by quantity for all campaigns, see `conformity`, before those of
        campaign.toml.
    resume, retry : go on with what an earlier run left (with nothing there, begin); also do again
        what failed.
    force : replace an earlier batch in ``out``.
    progress : called with the numbers of campaigns done with, of all, and of those that failed.
    """
    check_pyarrow()
    sampler = sampler_named(sampler)
    check_probability(ci_prob)
    said = (
        "retry must come with resume, and resume without force, got otherwise. Choose --resume"
        " [--retry] or --force."
    )
    require(not (force if resume else retry), said)
    seed = operator.index(seed)
    require(
        0 <= seed < 2**63,
        f"seed must be a whole number from 0 to 2^63 - 1, got {seed}. For example 1.",
    )
    require(
        0.0 < ess < np.inf, f"ess must be a finite number above zero, got {ess}. For example 1000."
    )
    folder = Path(out)
    paths = gather(campaigns)
    # The same text whatever order its terms were given in.
    written = model_to_toml(model_from_toml(model_to_toml(model or HybridModel.default())))
    given = dict(table or {}), dict(certificates or {}), dict(tolerances or {})
    settings = Settings(written, sampler, seed, float(ess), float(ci_prob), compare, *given)
    jobs = [Job(number, path, os.path.abspath(path)) for number, path in enumerate(paths)]
    with (
        _journal(folder) as journal,
        executor() if callable(executor) else nullcontext(executor) as pool,
    ):
        record = _record(settings)
        resumed = _begin(journal, folder, jobs, record, resume=resume, force=force)
        started = time.perf_counter()
        fitted = _fit(journal, settings, pool, retry, progress)
        seconds = time.perf_counter() - started
        rows = "SELECT row FROM campaigns ORDER BY number"
        about = {"campaigns": len(jobs), "model": settings.model_toml}
        write_dataset(
            lambda: (json.loads(row) for (row,) in journal.execute(rows)), folder / DATASET, about
        )
        return _finished(journal, folder, len(jobs), fitted, seconds, resumed)


def _finished(
    journal: sqlite3.Connection,
    out: Path,
    campaigns: int,
    fitted: int,
    seconds: float,
    resumed: bool,
) -> Batch:
    counts = dict(
        journal.execute(
            "SELECT coalesce(state, status), count(*) FROM campaigns GROUP BY 1"
        ).fetchall()
    )
    failed, unusable, doubtful = (
        counts.get(kind, 0) for kind in ("failed", State.UNUSABLE, State.DOUBTFUL)
    )
    named = (
        "SELECT row FROM campaigns WHERE coalesce(state, status) IN (?, ?) ORDER BY number LIMIT ?"
    )

    def first(why: str, *states: str) -> tuple[dict[str, str], ...]:
        rows = map(
            json.loads,
            (row for (row,) in journal.execute(named, (states[0], states[-1], _MOST_NAMED))),
        )
        return tuple({key: row[key] for key in ("campaign", why)} for row in rows)

    return Batch(
        out=out,
        dataset=out / DATASET,
        campaigns=campaigns,
        done=campaigns - failed,
        failed=failed,
        not_converged=unusable,
        doubtful=doubtful,
        failures=first("reason", "failed"),
        doubts=first("verdict", State.UNUSABLE, State.DOUBTFUL),
        fitted=fitted,
        seconds=seconds,
        resumed=resumed,
    )
