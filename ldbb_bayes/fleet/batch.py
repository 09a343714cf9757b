"""Many campaigns into one table: each is fitted by itself into a row."""

from __future__ import annotations

import json
import operator
import os
import sqlite3
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.campaign_row import Job, Settings, failed_row, fit_row
from ldbb_bayes.fleet.dataset import DATASET, check_pyarrow, read_batch, write_dataset
from ldbb_bayes.fleet.gathering import gather
from ldbb_bayes.fleet.journal import batch_identity, begin_batch, open_journal, save_row
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

# Campaigns that the result of a batch names, of each kind.
_LONGEST_NAMED = 10_000


@dataclass(frozen=True)
class Batch(Result):
    """A finished batch."""

    out: Path  #: the folder
    dataset: Path  #: the Parquet table in it
    campaigns: int  #: in all
    done: int  #: fitted, now or before
    failures: int  #: that could not be fitted
    not_converged: int  #: of those done: that missed the sampling target
    #: of those done: whose readings the model does not expect, or that speak against it
    doubtful: int
    #: campaign and reason, of the first 10 000 that could not be fitted
    failed: tuple[dict[str, str], ...]
    #: campaign and verdict, of the first 10 000 that did not converge or are doubtful
    doubts: tuple[dict[str, str], ...]
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
    """Fit every campaign by itself, each into one row of a table.

    A campaign that cannot be fitted is a row that says why. Every row is kept as it comes. Whatever
    stops a batch (Ctrl-C, kill -9, a full disk), the same call with ``resume`` goes on with what is
    left, to the very same table.

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
    compare : compare linear compliance with constant by their evidences.
    table : fields of `Campaign` for tidy CSVs: what campaign.toml would say.
    certificates : fields of `Instrument` for all campaigns, instead of what campaign.toml says of
        them.
    tolerances : limits by quantity for all campaigns, see `conformity`, before those of
        campaign.toml.
    resume, retry : go on with what an earlier run left (with nothing there, begin); also do again
        what failed.
    force : replace an earlier batch in ``out``.
    progress : called with the numbers of campaigns done with, of all, and of those that failed.

    Returns
    -------
    The finished batch.

    Raises
    ------
    InputError
        For no campaigns, a batch in ``out`` that may not be touched or is another one, a place that
        cannot be written, or without pyarrow.
    """
    check_pyarrow()
    _check_restart(resume=resume, retry=retry, force=force)
    settings = Settings(
        model_toml=_canonical_toml(model or HybridModel.default()),
        sampler=sampler_named(sampler),
        seed=_checked_seed(seed),
        ess=_checked_ess(ess),
        ci_prob=_checked_probability(ci_prob),
        compare=compare,
        table=dict(table or {}),
        certificates=dict(certificates or {}),
        tolerances=dict(tolerances or {}),
    )
    folder = Path(out)
    jobs = _number(gather(campaigns))
    with open_journal(folder) as journal, _started(executor) as workers:
        identity = batch_identity(settings)
        resumed = begin_batch(journal, folder, jobs, identity, resume=resume, force=force)
        start = time.perf_counter()
        fitted = _fit_campaigns(journal, settings, workers, retry, progress)
        seconds = time.perf_counter() - start
        metadata = {"campaigns": len(jobs), "model": settings.model_toml}
        write_dataset(partial(_saved_rows, journal), folder / DATASET, metadata)
        counts = _count_by_state(journal)
        failures = counts.get("failed", 0)
        return Batch(
            out=folder,
            dataset=folder / DATASET,
            campaigns=len(jobs),
            done=len(jobs) - failures,
            failures=failures,
            not_converged=counts.get(State.UNUSABLE, 0),
            doubtful=counts.get(State.DOUBTFUL, 0),
            failed=_named_campaigns(journal, "reason", ("failed",)),
            doubts=_named_campaigns(journal, "verdict", (State.UNUSABLE, State.DOUBTFUL)),
            fitted=fitted,
            seconds=seconds,
            resumed=resumed,
        )


def _check_restart(*, resume: bool, retry: bool, force: bool) -> None:
    if (retry and not resume) or (resume and force):
        raise InputError(
            "retry must come with resume, and resume without force, got otherwise. Choose --resume"
            " [--retry] or --force."
        )


def _checked_seed(seed: int) -> int:
    number = operator.index(seed)
    if not 0 <= number < 2**63:
        raise InputError(
            f"seed must be a whole number from 0 to 2^63 - 1, got {seed}. For example 1."
        )
    return number


def _checked_ess(ess: float) -> float:
    if not 0.0 < ess < np.inf:
        raise InputError(f"ess must be a finite number above zero, got {ess}. For example 1000.")
    return float(ess)


def _checked_probability(ci_prob: float) -> float:
    check_probability(ci_prob)
    return float(ci_prob)


def _number(paths: Iterable[str]) -> list[Job]:
    return [Job(number, path, os.path.abspath(path)) for number, path in enumerate(paths)]


def _canonical_toml(model: HybridModel) -> str:
    """Return the TOML of a model, the same whatever order its terms were given in."""
    return model_to_toml(model_from_toml(model_to_toml(model)))


@contextmanager
def _started(
    executor: Executor | Callable[[], AbstractContextManager[Executor | None]] | None,
) -> Iterator[Executor | None]:
    """Yield an executor, started here where the argument is what starts one."""
    if callable(executor):
        with executor() as started:
            yield started
    else:
        yield executor


def _fit_campaigns(
    journal: sqlite3.Connection,
    settings: Settings,
    executor: Executor | None,
    retry: bool,
    progress: Callable[[int, int, int], None] | None,
) -> int:
    """Fit the campaigns without a row, and with ``retry`` those that failed; return how many."""
    jobs = _pending_jobs(journal, retry)
    (campaigns,) = journal.execute("SELECT count(*) FROM campaigns").fetchone()
    query = "SELECT number FROM campaigns WHERE status = 'failed'"
    failed = {number for (number,) in journal.execute(query)}
    finished = campaigns - len(jobs)
    if progress is not None and jobs:
        progress(finished, campaigns, len(failed))
    fit = partial(fit_row, settings)
    with closing(done(fit, jobs, executor)) as results:  # type: ignore[type-var]
        for index, result in results:
            job = jobs[index]
            row = _row_of(settings, job, result)
            save_row(journal, job.number, row)
            failed.discard(job.number)
            if row["status"] == "failed":
                failed.add(job.number)
            finished += 1
            if progress is not None:
                progress(finished, campaigns, len(failed))
    return len(jobs)


def _row_of(settings: Settings, job: Job, result: dict[str, Any] | Lost) -> dict[str, Any]:
    if isinstance(result, Lost):
        return failed_row(settings, job, result.reason)
    return result


def _pending_jobs(journal: sqlite3.Connection, retry: bool) -> list[Job]:
    condition = "status IS NULL"
    if retry:
        condition += " OR status = 'failed'"
    query = f"SELECT number, path, place FROM campaigns WHERE {condition} ORDER BY number"
    return [Job(*entry) for entry in journal.execute(query)]


def _saved_rows(journal: sqlite3.Connection) -> Iterator[dict[str, Any]]:
    for (row,) in journal.execute("SELECT row FROM campaigns ORDER BY number"):
        yield json.loads(row)


def _count_by_state(journal: sqlite3.Connection) -> dict[str, int]:
    """Return how many campaigns have each state; those that failed have none."""
    query = "SELECT coalesce(state, status), count(*) FROM campaigns GROUP BY 1"
    return dict(journal.execute(query).fetchall())


def _named_campaigns(
    journal: sqlite3.Connection, column: str, states: tuple[str, ...]
) -> tuple[dict[str, str], ...]:
    """Return path and one more column of the first campaigns with one of the states."""
    query = (
        "SELECT row FROM campaigns WHERE coalesce(state, status) IN (?, ?) ORDER BY number LIMIT ?"
    )
    saved = journal.execute(query, (states[0], states[-1], _LONGEST_NAMED))
    rows = [json.loads(row) for (row,) in saved]
    return tuple({"campaign": row["campaign"], column: row[column]} for row in rows)
