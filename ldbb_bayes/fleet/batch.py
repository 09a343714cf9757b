"""Many campaigns into one table: each fitted by itself into a row, rows kept in SQLite as they come
and exported as Parquet."""

from __future__ import annotations

import json
import operator
import os
import shutil
import sqlite3
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from pydantic import Field
from pydantic_core import to_jsonable_python

from ldbb_bayes.analysis.conformity import conformity
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.folder import TOML_NAME, labels_of, read_campaign
from ldbb_bayes.errors import InputError, plain_reason, require
from ldbb_bayes.files import bytes_of, write_whole
from ldbb_bayes.fleet.dataset import (
    DATASET,
    JOURNAL,
    PART,
    check_pyarrow,
    read_batch,
    write_dataset,
)
from ldbb_bayes.fleet.statistics import stands_for, sufficient_statistics
from ldbb_bayes.inference.evidence import log_bayes_factor, log_evidence
from ldbb_bayes.inference.fit import State
from ldbb_bayes.inference.mcmc import StoppingRule
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.posterior import record_of
from ldbb_bayes.inference.sample import sample_from, sampler_named
from ldbb_bayes.inference.summary import check_probability, numbers_of
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.specification import model_from_toml, model_sha256, model_to_toml
from ldbb_bayes.parallel import Lost, done, one_blas_thread, versions
from ldbb_bayes.report.text import fit_in_words
from ldbb_bayes.results import Result

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Batch", "Job", "Settings", "batch", "fit_row", "gather"]

LIST = "campaigns.txt"
_OURS = (JOURNAL, f"{JOURNAL}-wal", f"{JOURNAL}-shm", f"{JOURNAL}-journal", LIST, DATASET, PART)

# ---- which campaigns

_LARGEST_LIST = 2**30


def gather(given: Iterable[str | os.PathLike[str]]) -> tuple[str, ...]:
    """Return the campaigns that folders of campaigns and lists stand for, each once. A campaign
    folder, a campaign.toml or a tidy CSV stands for itself; any other folder for its direct
    subfolders with a campaign.toml, sorted; ``@FILE`` or a .txt file for the paths in it, one a
    line but for comments (#). What does not exist stays: the batch says so in its row."""
    seen: dict[str, str] = {}
    for path in _opened([given] if isinstance(given, str | os.PathLike) else given):
        line = path.isprintable() and path == path.strip() and path and path[0] != "#"
        require(
            line,
            f"paths of campaigns must be printable and stand on one line, got {path!r}. Rename it.",
        )
        whole = os.path.abspath(path)
        seen.setdefault(
            os.path.dirname(whole) if os.path.basename(whole) == TOML_NAME else whole, path
        )
    paths = tuple(seen.values())
    got = f"got none among {len(paths)}{f' ({paths[0]})' if paths else ''}"
    cure = f"Name folders with {TOML_NAME}, tidy CSVs, folders of campaigns, or a list (@FILE)."
    there = any(
        os.path.isfile(os.path.join(path, TOML_NAME)) or os.path.isfile(path) for path in paths
    )
    require(there, f"a batch must have campaigns that exist, {got}. {cure}")
    return paths


def _opened(given: Iterable[str | os.PathLike[str]]) -> Iterator[str]:
    """Every path by itself: lists read, folders of campaigns opened."""
    for entry in (os.fspath(each) for each in given):
        if not (
            entry.startswith("@") or (entry.lower().endswith(".txt") and os.path.isfile(entry))
        ):
            yield from _inside(entry)
            continue
        file = Path(entry.removeprefix("@"))
        try:
            text = bytes_of(
                file, _LARGEST_LIST, what="a list of campaigns, one path a line"
            ).decode("utf-8-sig")
        except UnicodeDecodeError:
            raise InputError(
                f"{file} must be UTF-8 text, got another encoding. Save it as UTF-8."
            ) from None
        for line in map(str.strip, text.splitlines()):
            if line and not line.startswith("#"):
                yield from _inside(line)


def _inside(path: str) -> list[str]:
    """The path itself, or the campaigns right in a folder of campaigns."""
    if not os.path.isdir(path) or os.path.isfile(os.path.join(path, TOML_NAME)):
        return [path]
    try:
        with os.scandir(path) as entries:
            names = sorted(
                entry.name
                for entry in entries
                if os.path.isfile(os.path.join(entry.path, TOML_NAME))
            )
    except OSError as error:
        raise InputError(
            f"{path} must be a readable folder, got: {error.strerror}. Check its permissions."
        ) from None
    return [os.path.join(path, name) for name in names] or [path]


# ---- one campaign, one row

_EVIDENCE_TOLERANCE = 1e-2
_LONGEST_REASON = 1200


@dataclass(frozen=True)
class Settings:
    """How every campaign of a batch is fitted. ``table`` are fields of `Campaign` that tidy CSVs do
    not say, ``certificates`` of `Instrument` instead of what campaigns say."""

    model_toml: str
    sampler: str = "independent"
    seed: int = 1
    ess: float = 1000.0
    ci_prob: float = 0.95
    compare: bool = True
    table: Mapping[str, Any] = field(default_factory=dict)
    certificates: Mapping[str, Any] = field(default_factory=dict)
    #: of quantities, before what campaigns say
    tolerances: Mapping[str, str] = field(default_factory=dict)

    @property
    def model(self) -> HybridModel:
        """The model in the TOML."""
        return _model(self.model_toml)


_model = lru_cache(maxsize=4)(model_from_toml)


class Job(NamedTuple):
    """A campaign's number in the batch, its path as given, and where that is, wherever a worker
    stands."""

    number: int
    path: str
    place: str


@one_blas_thread
def fit_row(settings: Settings, job: Job) -> dict[str, Any]:
    """Return the row of a campaign; ``parameters`` holds unit and numbers of each by name."""
    row = _given(settings, job)
    try:
        with warnings.catch_warnings(action="ignore"):
            is_table = not os.path.isdir(job.place) and not job.place.lower().endswith(".toml")
            campaign = read_campaign(
                job.place,
                certificates=settings.certificates,
                **(settings.table if is_table else {}),
            )
            campaign = replace(campaign, tolerances={**campaign.tolerances, **settings.tolerances})
            row |= _origin(campaign)
            return row | _fitted(settings, campaign)
    except Exception as error:  # one campaign must not end the others
        reason = plain_reason(error)
        if reason is None:
            last = traceback.extract_tb(error.__traceback__)[-1]
            place = "/".join(Path(last.filename).parts[-2:])
            reason = (
                f"unexpected {type(error).__name__}: {error} ({place}, line {last.lineno}). Please"
                " report it."
            )
        reason = " ".join(reason.split())[:_LONGEST_REASON].replace(job.place, job.path)
        return labels_of(job.place) | row | {"status": "failed", "reason": reason}


def _given(settings: Settings, job: Job) -> dict[str, Any]:
    return {
        "campaign": job.path,
        "degree": settings.model.degree,
        "model_sha256": model_sha256(settings.model),
        "sampler": settings.sampler,
        "seed": settings.seed,
        "versions": json.dumps(versions()),
    }


def _origin(campaign: Campaign) -> dict[str, Any]:
    return {
        **{
            name: getattr(campaign, name)
            for name in ("name", "sha256", "machine_id", "date", "topology", "readings")
        },
        "planes": ",".join(campaign.machine().planes),
        "compliances": json.dumps(stands_for(campaign)),
        "tolerances": json.dumps(dict(campaign.tolerances), ensure_ascii=False),
        "tests": len(campaign.tests),
        "force_min_N": float(campaign.forces_N.min()),
        "force_max_N": float(campaign.forces_N.max()),
    }


def _fitted(settings: Settings, campaign: Campaign) -> dict[str, Any]:
    """Columns of the fit, the Bayes factor and the statistics; where one of these two breaks down,
    a warning says so."""
    inside = HyperPosterior(settings.model.bind(campaign), truncated=True, seed=settings.seed)
    rule = StoppingRule(ess=settings.ess)
    posterior = sample_from(inside, settings.sampler, seed=settings.seed, rule=rule, prior_draws=0)
    record = record_of(posterior)
    words = fit_in_words(posterior)
    model = settings.model
    breakdowns = []
    beside: dict[str, Any] = {}
    parts: dict[str, Callable[[], dict[str, Any]]] = {}
    if settings.compare and model.degree and campaign.force_levels > 1:
        parts["Bayes factor"] = lambda: _bayes_factor(
            model, campaign, inside if model.prior.truncated else inside.plain
        )
    parts["sufficient statistics"] = lambda: sufficient_statistics(inside.plain).columns()
    parts = {} if model.prior.flat else parts
    if campaign.tolerances:
        parts["conformity"] = lambda: {
            "conformity": {name: own.as_dict() for name, own in conformity(posterior).items()}
        }
    for name, part in parts.items():
        try:
            beside |= part()
        except (InputError, ArithmeticError, np.linalg.LinAlgError) as error:
            breakdowns.append(f"No {name}: {plain_reason(error)}")
    return {
        **beside,
        "status": "done",
        "reference_force_N": record["model"]["reference_force_N"],
        "terms": record["model"]["terms"],
        "converged": bool(record["sampler"]["converged"]),
        **words,
        "warnings": [*words["warnings"], *breakdowns],
        "log_prob_truncation": record["fit"]["log_prob_truncation"],
        "rmse_um": record["fit"]["rmse_um"],
        "parameters": {
            str(name): {
                "unit": variable.attrs.get("unit", ""),
                **numbers_of(variable.to_numpy(), settings.ci_prob),
            }
            for name, variable in posterior["posterior"].data_vars.items()
        },
    }


def _bayes_factor(
    model: HybridModel, campaign: Campaign, density: HyperPosterior
) -> dict[str, float]:
    if model.degree == 1 and density.truncated == density.bound.truncation.active:
        linear = density.nodes(_EVIDENCE_TOLERANCE).evidence
    else:
        linear = log_evidence(model.with_degree(1), campaign, tolerance=_EVIDENCE_TOLERANCE)
    constant = log_evidence(model.with_degree(0), campaign, tolerance=_EVIDENCE_TOLERANCE)
    value, error = log_bayes_factor(linear, constant)
    return {"log_bayes_factor": float(value), "log_bayes_factor_error": float(error)}


# ---- the journal

_TABLES = """
CREATE TABLE IF NOT EXISTS batch (record TEXT);
CREATE TABLE IF NOT EXISTS campaigns (number INTEGER PRIMARY KEY, path TEXT, place TEXT, status TEXT, state TEXT, row TEXT);
"""
_MOST_NAMED = 10_000


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
