"""Many campaigns into one table: each fitted by itself into a row, rows kept in SQLite as they come and exported as Parquet."""

from __future__ import annotations

import json
import operator
import os
import re
import shutil
import sqlite3
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext, suppress
from dataclasses import asdict, dataclass, is_dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from pydantic import Field

from ldbb_bayes.campaign.folder import TOML_NAME
from ldbb_bayes.errors import InputError
from ldbb_bayes.files import bytes_of, write_whole
from ldbb_bayes.fleet import dataset
from ldbb_bayes.fleet.dataset import DATASET, JOURNAL, PART, Job, Settings, fit_row, read_batch, write_dataset
from ldbb_bayes.fleet.population_prior import PopulationPrior
from ldbb_bayes.inference.posterior import State, check_probability
from ldbb_bayes.inference.sample import check_sampler, versions
from ldbb_bayes.jobs import Lost, done
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.specification import model_from_toml, model_sha256, model_to_toml
from ldbb_bayes.result import Result

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Batch", "Doubt", "Failure", "batch", "gather"]

LIST, POSTERIORS = "campaigns.txt", "posteriors"
_OURS = (JOURNAL, f"{JOURNAL}-wal", f"{JOURNAL}-shm", f"{JOURNAL}-journal", LIST, DATASET, POSTERIORS, PART)
_POSTERIOR = re.compile(r"\d{7,}-[0-9a-f]{12}\.nc|\..*\.part")

# ---- which campaigns

_LARGEST_LIST = 2**30
_COMMENT = re.compile(r"(^|\s)#.*")
_QUOTED = re.compile(r'"(.+)"')


class Gathered(NamedTuple):
    """Paths of campaigns in the order given, and those that were given again."""

    paths: tuple[str, ...]
    repeated: tuple[str, ...]


def gather(given: Iterable[str | os.PathLike[str]]) -> Gathered:
    """Return the campaigns that folders of campaigns and lists stand for, and those that were given again.

    A campaign folder, a campaign.toml or a tidy CSV stands for itself; any other folder for its direct subfolders with a
    campaign.toml, sorted; ``@FILE`` or a .txt file for the paths in it, one a line, ' #' beginning a comment but for paths in
    double quotes, which are taken as they are. What does not exist stays: the batch says so in its row.

    Raises
    ------
    InputError
        For no campaign, none that exists, or a path that cannot stand on a line.
    """
    seen: dict[str, str] = {}
    repeated = []
    for path in _opened([given] if isinstance(given, str | os.PathLike) else given):
        if not (path.isprintable() and path == path.strip() and path):
            raise InputError(f"paths of campaigns must be printable and stand on one line, got {path!r}. Rename it.")
        key = os.path.abspath(path)
        key = os.path.dirname(key) if os.path.basename(key) == TOML_NAME else key
        if seen.setdefault(key, path) is not path:
            repeated.append(path)
    paths = tuple(seen.values())
    if not paths:
        raise InputError("a batch must have at least one campaign, got none. Name campaigns, folders of them, or a list (@FILE).")
    if not any(os.path.isfile(os.path.join(path, TOML_NAME)) or os.path.isfile(path) for path in paths):
        raise InputError(
            f"a batch must have campaigns that exist, got none among {len(paths)} ({paths[0]}). "
            f"Name folders with {TOML_NAME}, tidy CSVs, folders of campaigns, or a list (@FILE)."
        )
    return Gathered(paths, tuple(repeated))


def _opened(given: Iterable[str | os.PathLike[str]]) -> Iterator[str]:
    for entry in (os.fspath(each) for each in given):
        if entry.startswith("@") or (entry.lower().endswith(".txt") and os.path.isfile(entry)):
            for line in _lines(Path(entry.removeprefix("@"))):
                yield from _inside(line)
        else:
            yield from _inside(entry)


def _inside(path: str) -> list[str]:
    """The path itself, or the campaigns right in a folder of campaigns."""
    if not os.path.isdir(path) or os.path.isfile(os.path.join(path, TOML_NAME)):
        return [path]
    try:
        with os.scandir(path) as entries:
            names = sorted(entry.name for entry in entries if os.path.isfile(os.path.join(entry.path, TOML_NAME)))
    except OSError as error:
        raise InputError(f"{path} must be a readable folder, got: {error.strerror}. Check its permissions.") from None
    return [os.path.join(path, name) for name in names] or [path]


def _lines(file: Path) -> Iterator[str]:
    try:
        text = bytes_of(file, _LARGEST_LIST, what="a list of campaigns, one path a line").decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{file} must be UTF-8 text, got another encoding. Save it as UTF-8.") from None
    for line in map(str.strip, text.splitlines()):
        quoted = _QUOTED.fullmatch(line) or _QUOTED.fullmatch(_COMMENT.sub("", line).strip())
        path = quoted[1] if quoted else _COMMENT.sub("", line).strip()
        if path:
            yield path


def listed(paths: Iterable[str]) -> bytes:
    """Return a list that is read as these paths: quoted where a part would be a comment."""
    return "".join(f'"{path}"\n' if _COMMENT.search(path) or _QUOTED.fullmatch(path) else f"{path}\n" for path in paths).encode()


# ---- the journal

_TABLES = """
CREATE TABLE IF NOT EXISTS batch (record TEXT);
CREATE TABLE IF NOT EXISTS campaigns (number INTEGER PRIMARY KEY, path TEXT, status TEXT, state TEXT, row TEXT);
"""
_MOST_NAMED = 10_000
_WORDS = {
    "ci_prob": "probability of the intervals",
    "compare": "comparison",
    "ess": "effective sample size",
    "prior_from": "population",
    "here": "folder that relative paths start from",
}


@contextmanager
def _journal(out: Path) -> Iterator[sqlite3.Connection]:
    """The database of a folder, made if need be; SQLite's lock keeps other runs out while the block lasts."""
    made = not out.exists()
    if not made and not out.is_dir():
        raise InputError(f"{out} must be a folder, got a file. Choose another name.")
    foreign = [] if made else sorted(path.name for path in out.iterdir() if path.name not in _OURS)
    if foreign:
        raise InputError(f"{out} must hold nothing but a batch, got {foreign[0]!r}. Move it away or choose another name.")
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
            connection.executescript(f"PRAGMA synchronous = NORMAL; BEGIN EXCLUSIVE; {_TABLES} COMMIT;")
            yield connection
            begun = True
        except sqlite3.Error as error:
            raise _unusable(out, error) from None
        finally:
            with suppress(sqlite3.Error):
                begun = begun or connection.execute("SELECT count(*) FROM batch").fetchone()[0] > 0
            if not begun:
                shutil.rmtree(out, ignore_errors=True)


def _unusable(out: Path, error: sqlite3.Error) -> InputError:
    if error.sqlite_errorcode in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
        return InputError(f"{out} must not be in use, got another run at work there. Wait for it, or choose another --out.")
    if error.sqlite_errorcode in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT):
        return InputError(f"{out / JOURNAL} must be the journal of a batch, got a damaged file. Remove {out}, and begin anew.")
    return InputError(
        f"{out / JOURNAL} must be writable, got: {error}. What is in it is kept: free some space or mend the place, then go on "
        "with --resume."
    )


def _record(paths: Sequence[str], settings: Settings) -> dict[str, Any]:
    """What makes a batch what it is."""
    table = {
        f"table option {name}": asdict(value) if is_dataclass(value) and not isinstance(value, type) else value
        for name, value in settings.table.items()
    }
    return {
        "model": model_sha256(settings.model)[:12],
        **{name: getattr(settings, name) for name in ("sampler", "seed", "ess", "ci_prob", "compare")},
        "posteriors": settings.posteriors is not None,
        "prior_from": None if settings.population is None else settings.population.sha256,
        "here": None if all(map(os.path.isabs, paths)) else settings.here,
        **table,
        **{f"version of {name}": value for name, value in versions().items()},
    }


def _begin(
    journal: sqlite3.Connection, out: Path, paths: Sequence[str], record: Mapping[str, Any], *, resume: bool, force: bool
) -> bool:
    """Write down what the batch is, or compare it with what is there; whether there was one."""
    before = journal.execute("SELECT record FROM batch").fetchone()
    if before is None and not force and any((out / name).exists() for name in (DATASET, POSTERIORS)):
        raise InputError(f"{out} must hold the journal of its batch, got none. Begin anew (--force), or choose another name.")
    if before is not None and not resume and not force:
        state = "a finished" if (out / DATASET).exists() else "an unfinished"
        raise InputError(
            f"{out} must not hold a batch, got {state} one. Go on with it (--resume; failed campaigns again: --resume --retry), "
            "begin anew (--force), or choose another name."
        )
    if before is not None and resume:
        _check_same(journal, out, paths, json.loads(before[0]), json.loads(json.dumps(record)))
        return True
    (out / DATASET).unlink(missing_ok=True)
    for path in (out / POSTERIORS).glob("*"):
        if _POSTERIOR.fullmatch(path.name):
            path.unlink()
    write_whole(out / LIST, listed(paths))
    with journal:
        journal.execute("BEGIN")
        journal.execute("DELETE FROM batch")
        journal.execute("DELETE FROM campaigns")
        journal.executemany("INSERT INTO campaigns (number, path) VALUES (?, ?)", enumerate(paths))
        journal.execute("INSERT INTO batch VALUES (?)", [json.dumps(record)])
    return False


def _check_same(
    journal: sqlite3.Connection, out: Path, paths: Sequence[str], before: Mapping[str, Any], now: Mapping[str, Any]
) -> None:
    def refuse(names: Iterable[str]) -> None:
        for name in names:
            if before.get(name) != now.get(name):
                got, has = ("nothing" if own.get(name) is None else own[name] for own in (before, now))
                raise InputError(
                    f"{out} must be of this batch, got {_WORDS.get(name, name)} {got} where this run has {has}. Resume with what "
                    "the batch was begun with, or begin anew (--force)."
                )

    refuse(sorted({*before, *now} - {"here"}))
    there = [path for (path,) in journal.execute("SELECT path FROM campaigns ORDER BY number")]
    if there != list(paths):
        pairs = enumerate(zip(there, paths, strict=False), start=1)
        other = next((f"number {k} is {old} where this run has {new}" for k, (old, new) in pairs if old != new), None)
        more = " Campaigns that are new make a batch of their own." if len(paths) > len(there) else ""
        raise InputError(
            f"{out} must be of this batch, got other campaigns ({other or f'{len(there)} where this run has {len(paths)}'}). "
            f"Go on with its own list: @{out / LIST} --resume.{more}"
        )
    refuse(["here"])


def _wanted(journal: sqlite3.Connection, settings: Settings, retry: bool) -> dict[int, str | None]:
    """Numbers of the campaigns to be fitted; of those fitted from files that have changed since, their digest then."""
    where = "" if retry else " WHERE status IS NULL"
    found: dict[int, str | None] = {}
    for number, path, status, row in journal.execute(f"SELECT number, path, status, row FROM campaigns{where} ORDER BY number"):
        if status != "done":
            found[number] = None
        else:
            before, now = json.loads(row), dataset.stamp_of(os.path.join(settings.here, path))
            if None not in (before["stamp"], now) and now != before["stamp"]:
                found[number] = before["sha256"]
    return found


def _fit(
    journal: sqlite3.Connection,
    paths: Sequence[str],
    settings: Settings,
    executor: Executor | None,
    retry: bool,
    progress: Callable[[int, int, int], None] | None,
) -> int:
    """Fit what has no row, each row a transaction; the number of campaigns fitted."""
    wanted = _wanted(journal, settings, retry)
    order = list(wanted)
    failed = {number for (number,) in journal.execute("SELECT number FROM campaigns WHERE status = 'failed'")}
    if progress is not None and wanted:
        progress(len(paths) - len(wanted), len(paths), len(failed))
    jobs = (Job(number, paths[number]) for number in order)
    with closing(done(partial(fit_row, settings), jobs, executor)) as results:  # type: ignore[type-var]
        for count, (place, result) in enumerate(results, start=1):
            number = order[place]
            if isinstance(result, Lost):
                result = dataset.failed_row(settings, Job(number, paths[number]), result.reason)
            journal.execute(
                "UPDATE campaigns SET status = ?, state = ?, row = ? WHERE number = ?",
                (result["status"], result.get("state"), json.dumps(_plain(result)), number),
            )
            before = wanted[number]
            if settings.posteriors is not None and before is not None and before != result.get("sha256"):
                (Path(settings.posteriors) / dataset.posterior_name(number, before)).unlink(missing_ok=True)
            (failed.add if result["status"] == "failed" else failed.discard)(number)
            if progress is not None:
                progress(len(paths) - len(wanted) + count, len(paths), len(failed))
    return len(wanted)


def _plain(value: Any) -> Any:
    """For JSON and Parquet: numbers that are none become null, half a character, as names of files hold one, a question mark."""
    if isinstance(value, dict):
        return {name: _plain(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, str):
        return value.encode("utf-8", "replace").decode()
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _rows(journal: sqlite3.Connection) -> Iterator[dict[str, Any]]:
    for (row,) in journal.execute("SELECT row FROM campaigns ORDER BY number"):
        yield json.loads(row)


# ---- the batch


@dataclass(frozen=True)
class Failure(Result):
    """A campaign that could not be fitted, and why."""

    campaign: str
    reason: str


@dataclass(frozen=True)
class Doubt(Result):
    """A campaign that is not converged or doubtful, and its verdict."""

    campaign: str
    verdict: str


@dataclass(frozen=True)
class Batch(Result):
    """A finished batch.

    Attributes
    ----------
    out, dataset : Path
        Its folder, and the Parquet table in it.
    campaigns, done, failed : int
        In JSON the last is ``failures``.
    not_converged, doubtful : int
        Of those done: that missed the sampling target; whose readings the model does not expect, or that speak against it.
    failures, doubts : tuple of Failure, of Doubt
        The first 10 000 each; in JSON the former is ``failed``.
    fitted, seconds : int, float
        Campaigns fitted by this run, and the time that took; the others were there.
    resumed : bool
        Whether an earlier run was gone on with.
    repeated : tuple of str
        Campaigns given more than once, kept once.
    """

    out: Path
    dataset: Path
    campaigns: int
    done: int
    failed: Annotated[int, Field(alias="failures")]
    not_converged: int
    doubtful: int
    failures: Annotated[tuple[Failure, ...], Field(alias="failed")]
    doubts: tuple[Doubt, ...]
    fitted: int
    seconds: float
    resumed: bool
    repeated: tuple[str, ...]

    def rows(self) -> pd.DataFrame:
        """Return every row; see `read_batch`."""
        return read_batch(self.out)


def batch(
    campaigns: Iterable[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    model: HybridModel | None = None,
    prior_from: PopulationPrior | None = None,
    sampler: str = "independent",
    executor: Executor | Callable[[], AbstractContextManager[Executor | None]] | None = None,
    seed: int = 1,
    ess: float = 1000.0,
    ci_prob: float = 0.95,
    posteriors: bool = False,
    compare: bool = True,
    table: Mapping[str, Any] | None = None,
    resume: bool = False,
    retry: bool = False,
    force: bool = False,
    progress: Callable[[int, int, int], None] | None = None,
) -> Batch:
    """Fit every campaign by itself, each into one row of a table; a campaign that cannot be fitted is a row that says why.

    Every row is kept as it comes. Whatever stops a batch (Ctrl-C, kill -9, a full disk), the same call with ``resume`` goes on
    with what is left, to the very same table.

    Parameters
    ----------
    campaigns : iterable of path
        Campaign folders, campaign.toml files, tidy CSVs, folders of campaigns (every direct subfolder with a campaign.toml,
        sorted), and lists: ``@FILE`` or a .txt file, one path a line. A campaign given twice is kept once.
    out : path
        Folder for the rows and the table.
    model : HybridModel, optional
        Default: linear in force.
    prior_from : PopulationPrior, optional
        From `prior_from`: prior of the compliances. A campaign that the population was made from fails.
    sampler, seed, ess, ci_prob
        As for `sample` and `summarize`: the numbers are theirs.
    executor : concurrent.futures.Executor or callable, optional
        Where campaigns are fitted; default: here, one after the other. See `ldbb_bayes.jobs`. What starts one, such as
        `process_executor` itself, is called once ``out`` is this run's, which it stays until the workers have ended.
    posteriors : bool
        Keep every posterior in ``out``/posteriors as well.
    compare : bool
        Weigh linear compliance against constant by their evidences.
    table : mapping, optional
        Fields of `Campaign` for tidy CSVs: what campaign.toml would say.
    resume, retry : bool
        Go on with what an earlier run left (with nothing there, begin); also do again what failed, and what was fitted from files
        that have changed since.
    force : bool
        Replace an earlier batch in ``out``.
    progress : callable, optional
        Called with the numbers of campaigns done with, of all, and of those that failed.

    Raises
    ------
    InputError
        For no campaigns, a batch in ``out`` that may not be touched or is another one, a place that cannot be written, or
        without pyarrow.
    """
    dataset.check_pyarrow()
    check_sampler(sampler)
    check_probability(ci_prob)
    if retry and not resume:
        raise InputError("retry (--retry) must come with resume (--resume), got it alone. Add it.")
    if force and resume:
        raise InputError("resume and force must not come together, got both. Go on (--resume), or begin anew (--force).")
    seed = operator.index(seed)
    if not 0 <= seed < 2**63:
        raise InputError(f"seed must be a whole number from 0 to 2^63 - 1, got {seed}. For example 1.")
    if not ess > 0.0:
        raise InputError(f"ess must be above zero, got {ess}. For example 1000.")
    folder, found = Path(out), gather(campaigns)
    chosen = model or HybridModel.default()
    written = model_to_toml(chosen if prior_from is None else prior_from.model(chosen))
    settings = Settings(
        model_to_toml(model_from_toml(written)),  # the same text whatever order its terms were given in
        sampler,
        seed,
        float(ess),
        float(ci_prob),
        compare,
        os.path.abspath(folder / POSTERIORS) if posteriors else None,
        dict(table or {}),
        os.getcwd(),
        prior_from,
    )
    with _journal(folder) as journal, executor() if callable(executor) else nullcontext(executor) as pool:
        record = _record(found.paths, settings)
        resumed = _begin(journal, folder, found.paths, record, resume=resume, force=force)
        if posteriors:
            (folder / POSTERIORS).mkdir(exist_ok=True)
        started = time.perf_counter()
        fitted = _fit(journal, found.paths, settings, pool, retry, progress)
        seconds = time.perf_counter() - started
        about = {
            "campaigns": len(found.paths),
            "model_sha256": model_sha256(settings.model),
            "model": settings.model_toml,
            "options": {name: value for name, value in record.items() if name not in ("model", "here")},
        }
        write_dataset(partial(_rows, journal), folder / DATASET, about)
        return _finished(journal, folder, found, fitted, seconds, resumed)


def _finished(journal: sqlite3.Connection, out: Path, found: Gathered, fitted: int, seconds: float, resumed: bool) -> Batch:
    counts = dict(journal.execute("SELECT coalesce(state, status), count(*) FROM campaigns GROUP BY 1").fetchall())
    failed, unusable, doubtful = (counts.get(kind, 0) for kind in ("failed", State.UNUSABLE, State.DOUBTFUL))
    named = "SELECT row FROM campaigns WHERE coalesce(state, status) IN (?, ?) ORDER BY number LIMIT ?"
    failures = map(json.loads, (row for (row,) in journal.execute(named, ("failed", "failed", _MOST_NAMED))))
    doubts = map(json.loads, (row for (row,) in journal.execute(named, (State.UNUSABLE, State.DOUBTFUL, _MOST_NAMED))))
    return Batch(
        out=out,
        dataset=out / DATASET,
        campaigns=len(found.paths),
        done=len(found.paths) - failed,
        failed=failed,
        not_converged=unusable,
        doubtful=doubtful,
        failures=tuple(Failure(row["campaign"], row["reason"]) for row in failures),
        doubts=tuple(Doubt(row["campaign"], row["verdict"]) for row in doubts),
        fitted=fitted,
        seconds=seconds,
        resumed=resumed,
        repeated=found.repeated,
    )
