"""Separate fits of many campaigns, whose results are written into one table."""

from __future__ import annotations

import json
import operator
import os
import sqlite3
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ldbb_bayes.deprecation import renamed_keyword
from ldbb_bayes.errors import InputError, check_probability
from ldbb_bayes.fleet.campaign_files import digest_of_files
from ldbb_bayes.fleet.campaign_row import (
    Job,
    Settings,
    check_tolerances,
    failed_row,
    fit_row,
)
from ldbb_bayes.fleet.dataset import (
    DATASET,
    SPREADSHEET,
    check_pyarrow,
    read_batch,
    write_dataset,
    write_spreadsheet,
)
from ldbb_bayes.fleet.gathering import find_passed_over, gather
from ldbb_bayes.fleet.journal import batch_identity, begin_batch, open_journal, save_row
from ldbb_bayes.inference.fit import State
from ldbb_bayes.inference.sample import check_sampler
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.specification import model_from_toml, model_to_toml
from ldbb_bayes.parallel import Lost, done
from ldbb_bayes.results import Result

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Batch", "run_batch"]

# The result of a batch names at most this number of failed campaigns, at most this number of
# campaigns with doubtful results, and at most this number of paths that are no campaigns. If there
# are more campaigns, they are included only in the counts.
_LONGEST_NAMED = 10_000


class _FittedRow(NamedTuple):
    """Row of a campaign in the table of a batch, and the digest of the campaign's files."""

    row: dict[str, Any]  # values of the row; the keys are the names of the columns
    # digest of the campaign's files before the fit; None if the worker process died
    digest: str | None


@dataclass(frozen=True)
class Batch(Result):
    """Result of a finished batch: where its table is, and how many campaigns were fitted or failed.

    Examples
    --------
    >>> fast = lb.HybridModel.first(0)
    >>> simulated = fast.simulate(campaign, seed=1).campaign
    >>> folder = lb.write_campaign(simulated, "campaigns/machine_1")
    >>> batch = lb.fleet.run_batch(["campaigns"], "fitted", model=fast, compare=False)
    >>> batch.campaigns, batch.done, batch.failures
    (1, 1, 0)
    >>> batch.rows()["campaign"].tolist()
    ['campaigns/machine_1']
    """

    out: Path  #: folder of the batch, which holds its table and its journal (database of the rows)
    #: Parquet file with the batch's table, one row per campaign, in the folder of the batch
    dataset: Path
    spreadsheet: Path  #: the same table as CSV, without the sufficient statistics
    campaigns: int  #: number of all campaigns of the batch
    done: int  #: number of campaigns fitted successfully, in this run or an earlier one
    failures: int  #: number of campaigns that could not be fitted
    #: number of fitted campaigns for which the sampler did not meet its stopping rule (effective
    #: sample size and R-hat)
    not_converged: int
    #: number of fitted campaigns whose readings do not fit the model, or contradict the condition
    #: that no compliance is negative
    doubtful: int
    #: one dictionary for each campaign that could not be fitted; only the first 10 000 of these
    #: campaigns are listed. The key ``campaign`` holds the file path of the campaign, and the key
    #: ``reason`` says why it could not be fitted.
    failed: tuple[dict[str, str], ...]
    #: one dictionary for each campaign whose fit is doubtful or whose sampler did not converge;
    #: only the first 10 000 of these campaigns are listed. The key ``campaign`` holds the file path
    #: of the campaign. The key ``verdict`` holds a sentence on how far the fit can be trusted.
    doubts: tuple[dict[str, str], ...]
    #: number of campaigns that this run of the batch has fitted or tried to fit. The rows of the
    #: other campaigns come from earlier runs.
    fitted: int
    seconds: float  #: duration of this run of the batch [s]
    resumed: bool  #: whether this run continued an earlier run of the same batch
    #: file paths in the folders of campaigns that are no campaigns, such as tables and subfolders
    #: without a campaign.toml; only the first 10 000 are listed
    passed_over: tuple[str, ...] = ()
    #: one dictionary for each campaign with a test that was read twice or has the other sign; only
    #: the first 10 000 of these campaigns are listed. The key ``campaign`` holds the file path of
    #: the campaign. The key ``remark`` says which tests these are.
    odd_readings: tuple[dict[str, str], ...] = ()

    def rows(self) -> pd.DataFrame:
        """Return the table of the batch, one row per campaign; `read_batch` lists its columns."""
        return read_batch(self.out)


@renamed_keyword("ci_prob", "prob")
def run_batch(
    campaigns: Iterable[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    model: HybridModel | None = None,
    sampler: str = "independent",
    executor: Executor | Callable[[], AbstractContextManager[Executor | None]] | None = None,
    seed: int = 1,
    ess: float = 1000.0,
    prob: float = 0.95,
    compare: bool = True,
    table: Mapping[str, Any] | None = None,
    certificates: Mapping[str, Any] | None = None,
    tolerances: Mapping[str, str] | None = None,
    resume: bool = False,
    retry: bool = False,
    force: bool = False,
    progress: Callable[[int, int, int], None] | None = None,
) -> Batch:
    """Fit every campaign separately and write the results as the rows of one table.

    If a campaign cannot be fitted, its row gives the reason. Every row is saved as soon as it is
    computed. If a batch is stopped for any reason (Ctrl-C, kill -9, a full disk), the same call
    with ``resume=True`` fits the remaining campaigns. The table is then the same as if the batch
    had not been stopped.

    Parameters
    ----------
    campaigns : iterable of path
        Paths of campaign folders, campaign.toml files, tidy CSV files, folders of campaigns, and
        lists of campaigns. A list is ``@FILE`` or a .txt file, with one path per line.
    out : path
        Folder for the rows and the table. The folder is made if it does not exist.
    model : HybridModel, optional
        Model of the fits. Default: the default model with compliance linear in force.
    sampler : {"independent", "joint"}
        Method of drawing from the posterior; see `sample`.
    executor : Executor, or callable that starts one, optional
        Executor that runs the fits. Default: this process fits one campaign after the other. A
        function that starts an executor, such as ``process_executor``, is called after this run has
        locked the folder ``out``. The folder then stays locked until the workers of the executor
        have ended.
    seed : int
        Seed of the random draws, a whole number from 0 to 2^63 − 1.
    ess : float
        Effective sample size that each fit aims to reach.
    prob : float
        Probability of the credible intervals in the rows.
    compare : bool
        Whether to compare the evidence of linear compliance with that of constant compliance.
    table : mapping, optional
        Fields of `Campaign` for campaigns in tidy CSV files, which cannot state these fields. The
        keys are the names of the fields.
    certificates : mapping, optional
        Fields of `Instrument` for all campaigns; they replace the fields in campaign.toml. The keys
        are the names of the fields.
    tolerances : mapping of str to str, optional
        Tolerances of quantities for all campaigns, as texts such as "60 nm/N" (see
        `assess_conformity`); they replace the tolerances in campaign.toml. The keys are the names
        of the quantities.
    resume : bool
        Whether to continue an earlier run in ``out``. Campaigns whose files have changed since
        they were fitted are fitted again. If there is no earlier run, a new batch begins.
    retry : bool
        Whether to fit failed campaigns again when resuming.
    force : bool
        Whether to replace an earlier batch in ``out``.
    progress : callable, optional
        Function that is called with three arguments: the number of finished campaigns, the number
        of all campaigns, and the number of failed campaigns.

    Returns
    -------
    Batch
        Location of the table of the finished batch, and how many campaigns were fitted, failed or
        are in doubt.

    Raises
    ------
    InputError
        If there are no campaigns, an option is out of range, pyarrow is not installed, or the
        folder ``out`` cannot be written; if the folder ``out`` holds a batch and both ``resume``
        and ``force`` are false; or if ``resume`` is true and the batch in the folder has other
        campaigns, options or versions of software.

    Examples
    --------
    >>> fast = lb.HybridModel.first(0)
    >>> simulated = fast.simulate(campaign, seed=1).campaign
    >>> folder = lb.write_campaign(simulated, "campaigns/machine_1")
    >>> campaigns = ["campaigns", "machine_2"]
    >>> batch = lb.fleet.run_batch(campaigns, "fitted", model=fast, compare=False)
    >>> batch.done, batch.failures
    (1, 1)
    >>> batch.failed[0]["reason"]
    'campaign must be a folder with campaign.toml, a campaign.toml or a tidy CSV (the command import
     makes one of other tables and workbooks), got machine_2, which does not exist. Check the path.'
    """
    check_pyarrow()
    _check_restart(resume=resume, retry=retry, force=force)
    check_sampler(sampler)
    settings = Settings(
        model_toml=_canonical_toml(model or HybridModel.default()),
        sampler=sampler,
        seed=_checked_seed(seed),
        ess=_checked_ess(ess),
        prob=_checked_probability(prob),
        compare=compare,
        table=dict(table or {}),
        certificates=dict(certificates or {}),
        tolerances=dict(tolerances or {}),
    )
    folder = Path(out)
    entries = _listed_entries(campaigns)
    jobs = _numbered_jobs(gather(entries))
    passed_over = find_passed_over(entries, folder)
    check_tolerances(settings, [job.absolute_path for job in jobs])
    with open_journal(folder) as journal, _running_executor(executor) as workers:
        identity = batch_identity(settings)
        resumed = begin_batch(journal, folder, jobs, identity, resume=resume, force=force)
        start = time.perf_counter()
        fitted = _fit_campaigns(journal, settings, workers, retry, progress)
        seconds = time.perf_counter() - start
        metadata = {"campaigns": len(jobs), "model": settings.model_toml}
        write_dataset(partial(_saved_rows, journal), folder / DATASET, metadata)
        write_spreadsheet(folder / DATASET, folder / SPREADSHEET)
        counts = _count_by_state(journal)
        failures = counts.get("failed", 0)
        return Batch(
            out=folder,
            dataset=folder / DATASET,
            spreadsheet=folder / SPREADSHEET,
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
            passed_over=passed_over[:_LONGEST_NAMED],
            odd_readings=_campaigns_with_odd_readings(journal),
        )


def _listed_entries(
    campaigns: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
) -> list[str | os.PathLike[str]]:
    """Return the paths that the user names as a list; a single path is a list of one."""
    if isinstance(campaigns, str | os.PathLike):
        return [campaigns]
    return list(campaigns)


def _check_restart(*, resume: bool, retry: bool, force: bool) -> None:
    """Raise an `InputError` if the arguments for an existing batch contradict each other.

    ``retry`` is only allowed with ``resume``, and ``resume`` is not allowed with ``force``.
    """
    if (retry and not resume) or (resume and force):
        raise InputError(
            "retry must come with resume, and resume without force, got otherwise. Choose --resume"
            " [--retry] or --force."
        )


def _checked_seed(seed: int) -> int:
    """Return the seed as an integer from 0 to 2^63 − 1.

    Raise a `TypeError` if ``seed`` is not an integer, and an `InputError` if it is out of range.
    """
    number = operator.index(seed)
    if not 0 <= number < 2**63:
        raise InputError(
            f"seed must be a whole number from 0 to 2^63 - 1, got {seed}. For example 1."
        )
    return number


def _checked_ess(ess: float) -> float:
    """Return the effective sample size that every fit of a batch aims to reach.

    Raise an `InputError` unless the effective sample size is positive and finite.
    """
    if not 0.0 < ess < np.inf:
        raise InputError(f"ess must be a finite number above zero, got {ess}. For example 1000.")
    return float(ess)


def _checked_probability(prob: float) -> float:
    """Return the probability of the credible intervals, ``prob``, as a float.

    Raise an `InputError` unless the probability is above 0 and below 1.
    """
    check_probability(prob)
    return float(prob)


def _numbered_jobs(paths: Iterable[str]) -> list[Job]:
    """Return a `Job` for every campaign of a batch; the jobs are numbered from 0.

    ``paths`` are the file paths of the campaigns.
    """
    return [Job(number, path, os.path.abspath(path)) for number, path in enumerate(paths)]


def _canonical_toml(model: HybridModel) -> str:
    """Return the TOML text of a model, with the model's terms (effects) in a fixed order.

    Two models that differ only in the order of their terms have the same text.
    """
    return model_to_toml(model_from_toml(model_to_toml(model)))


@contextmanager
def _running_executor(
    executor: Executor | Callable[[], AbstractContextManager[Executor | None]] | None,
) -> Iterator[Executor | None]:
    """Yield the executor that runs the fits of a batch, or None if the fits run in this process.

    If ``executor`` is a function, the function is called to start an executor, and this executor is
    stopped when the ``with`` block ends.
    """
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
    """Fit the campaigns of a batch that have no row yet, and return the number of these campaigns.

    Each row is saved in the ``journal``, a database in the folder of the batch, as soon as it is
    computed. ``settings`` are the settings of every fit. If ``retry`` is true, campaigns that
    failed in an earlier run are fitted again. ``executor`` runs the fits; if ``executor`` is None,
    the fits run in this process. ``progress`` is called with three arguments: the number of
    finished campaigns, the number of all campaigns and the number of failed campaigns.
    """
    jobs = _pending_jobs(journal, retry)
    (campaigns,) = journal.execute("SELECT count(*) FROM campaigns").fetchone()
    query = "SELECT number FROM campaigns WHERE status = 'failed'"
    failed = {number for (number,) in journal.execute(query)}
    finished = campaigns - len(jobs)
    if progress is not None and jobs:
        progress(finished, campaigns, len(failed))
    fit = partial(_fitted_row, settings)
    with closing(done(fit, jobs, executor)) as results:  # type: ignore[type-var]
        for index, result in results:
            job = jobs[index]
            row, digest = _row_of_result(settings, job, result)
            save_row(journal, job.number, row, digest)
            failed.discard(job.number)
            if row["status"] == "failed":
                failed.add(job.number)
            finished += 1
            if progress is not None:
                progress(finished, campaigns, len(failed))
    return len(jobs)


def _fitted_row(settings: Settings, job: Job) -> _FittedRow:
    """Return the row of a campaign, and the digest of the files from which it was fitted.

    ``job`` is the campaign, and ``settings`` are the settings of the fit.
    """
    digest = digest_of_files(job.absolute_path)
    return _FittedRow(fit_row(settings, job), digest)


def _row_of_result(settings: Settings, job: Job, result: _FittedRow | Lost) -> _FittedRow:
    """Return the row of a campaign in the table of a batch, given the result of its fit.

    ``result`` is the row itself, or `Lost` if the worker process died twice. In the second case,
    the row states that the campaign could not be fitted. ``job`` is the campaign, and ``settings``
    are the settings of the fit.
    """
    if isinstance(result, Lost):
        return _FittedRow(failed_row(settings, job, result.reason), None)
    return result


def _pending_jobs(journal: sqlite3.Connection, retry: bool) -> list[Job]:
    """Return the campaigns of a batch that have no row yet, in order of their numbers.

    ``journal`` is the database in which the rows are saved; its column ``place`` holds the absolute
    paths of the campaigns. If ``retry`` is true, campaigns that could not be fitted in an earlier
    run are returned too.
    """
    condition = "status IS NULL"
    if retry:
        condition += " OR status = 'failed'"
    query = f"SELECT number, path, place FROM campaigns WHERE {condition} ORDER BY number"
    jobs = []
    for number, path, absolute_path in journal.execute(query):
        jobs.append(Job(number, path, absolute_path))
    return jobs


def _saved_rows(journal: sqlite3.Connection) -> Iterator[dict[str, Any]]:
    """Yield the rows of all campaigns, in order of the campaigns' numbers.

    ``journal`` is the database in which the rows are saved.
    """
    for (row,) in journal.execute("SELECT row FROM campaigns ORDER BY number"):
        yield json.loads(row)


def _count_by_state(journal: sqlite3.Connection) -> dict[str, int]:
    """Return the number of campaigns in each state of a fit, such as "doubtful".

    The state says how far the fit of a campaign can be trusted. The keys of the result are the
    states. Campaigns that could not be fitted are counted under the key "failed". ``journal`` is
    the database with the rows of the batch.
    """
    query = "SELECT coalesce(state, status), count(*) FROM campaigns GROUP BY 1"
    return dict(journal.execute(query).fetchall())


def _named_campaigns(
    journal: sqlite3.Connection, column: str, states: Sequence[str]
) -> tuple[dict[str, str], ...]:
    """Return one dictionary for each campaign whose fit has one of the given states.

    Each dictionary has two entries. The key "campaign" holds the file path of the campaign. The
    other key is the name ``column`` of a column of the batch's table, such as "reason"; it holds
    the entry of the campaign in this column. ``states`` are states such as "doubtful"; "failed"
    stands for campaigns that could not be fitted. ``journal`` is the database with the rows of the
    batch. At most 10 000 dictionaries are returned.
    """
    marks = ", ".join("?" * len(states))
    query = (
        f"SELECT row FROM campaigns WHERE coalesce(state, status) IN ({marks})"
        " ORDER BY number LIMIT ?"
    )
    saved = journal.execute(query, (*states, _LONGEST_NAMED))
    rows = [json.loads(row) for (row,) in saved]
    return tuple({"campaign": row["campaign"], column: row[column]} for row in rows)


def _campaigns_with_odd_readings(journal: sqlite3.Connection) -> tuple[dict[str, str], ...]:
    """Return one dictionary for each campaign with a test read twice or of the other sign.

    Each dictionary has the entries "campaign", the file path of the campaign, and "remark", the
    sentences on these tests. ``journal`` is the database with the rows of the batch. At most
    10 000 dictionaries are returned.
    """
    query = (
        "SELECT row FROM campaigns WHERE json_array_length(row, '$.odd_readings') > 0"
        " ORDER BY number LIMIT ?"
    )
    campaigns = []
    for (saved,) in journal.execute(query, [_LONGEST_NAMED]):
        row = json.loads(saved)
        campaigns.append({"campaign": row["campaign"], "remark": " ".join(row["odd_readings"])})
    return tuple(campaigns)
