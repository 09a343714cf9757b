"""Many campaigns into one table: hundreds to a million, on any executor, whatever stops it and whatever some of them are."""

from __future__ import annotations

import operator
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.fleet.begun import DATASET, JOURNAL, POSTERIORS, RECORD, batch_record, begin, held
from ldbb_bayes.fleet.dataset import check_pyarrow, write_dataset
from ldbb_bayes.fleet.gather import Gathered, gather
from ldbb_bayes.fleet.journal import Journal
from ldbb_bayes.fleet.reading import read_batch, tally
from ldbb_bayes.fleet.row import STAMP, Job, Settings, failed_row, fit_row, posterior_name
from ldbb_bayes.fleet.stamps import stamp_of
from ldbb_bayes.inference.samplers import SAMPLERS
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.population_prior import PopulationPrior
from ldbb_bayes.model.spec import model_from_toml, model_to_toml
from ldbb_bayes.work import Lost, done

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Batch", "batch"]


@dataclass(frozen=True)
class Batch:
    """A finished batch.

    Attributes
    ----------
    out, dataset : Path
        Its folder, and the Parquet dataset in it.
    campaigns, done, failed : int
    not_converged, doubtful : int
        Of those done: that missed the sampling target; whose readings the model does not expect, or that speak against it.
    failures : tuple of (campaign, reason)
        The first 10 000.
    doubts : tuple of (campaign, verdict)
        Of those not converged or doubtful, the first 10 000.
    fitted : int
        Campaigns fitted by this run; the others were there.
    seconds : float
        That took.
    resumed : bool
        Whether an earlier run was gone on with.
    repeated : tuple of str
        Campaigns given more than once, kept once.
    damaged : int
        Lines of the journal of an earlier run that were damaged. What they held was done again, and so was what had failed.
    """

    out: Path
    dataset: Path
    campaigns: int
    done: int
    failed: int
    not_converged: int
    doubtful: int
    failures: tuple[tuple[str, str], ...]
    doubts: tuple[tuple[str, str], ...]
    fitted: int
    seconds: float
    resumed: bool
    repeated: tuple[str, ...]
    damaged: int

    def rows(self) -> pd.DataFrame:
        """Every row; see `read_batch`."""
        return read_batch(self.out)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        own = asdict(self) | {"out": str(self.out), "dataset": str(self.dataset)}
        failures = [{"campaign": campaign, "reason": reason} for campaign, reason in own.pop("failures")]
        doubts = [{"campaign": campaign, "verdict": verdict} for campaign, verdict in own.pop("doubts")]
        return {"schema": 1, **own, "failures": own["failed"], "failed": failures, "doubts": doubts}


def batch(
    campaigns: Iterable[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    model: HybridModel | None = None,
    prior_from: PopulationPrior | None = None,
    sampler: str = "quadrature",
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

    Finished rows are kept in a journal as they come. Whatever stops a batch (Ctrl-C, kill -9, a full disk), the same call with
    ``resume`` goes on with what is left, to the very same table.

    Parameters
    ----------
    campaigns : iterable of path
        Campaign folders, campaign.toml files, tidy CSVs, folders of campaigns (every direct subfolder with a campaign.toml,
        sorted), and lists: ``@FILE`` or a .txt file, one path a line. A campaign given twice is kept once.
    out : path
        Folder for the journal and the table.
    model : HybridModel, optional
        Default: linear in force.
    prior_from : PopulationPrior, optional
        From `prior_from`: prior of the compliances. A campaign that the population was made from fails.
    sampler : {"quadrature", "joint", "collapsed"}
    executor : concurrent.futures.Executor or callable, optional
        Where campaigns are fitted; default: here, one after the other. See `ldbb_bayes.fleet.executors`. What starts one, such as
        `process_executor` itself, is called once ``out`` is this run's, which it stays until the workers have ended.
    seed : int
        Of every campaign: its numbers are those of `sample` with this seed.
    ess : float
        Effective sample size asked for.
    ci_prob : float
        Probability of the credible intervals.
    posteriors : bool
        Keep every posterior in ``out``/posteriors as well.
    compare : bool
        Weigh linear compliance against constant by their evidences.
    table : mapping, optional
        Fields of `Campaign` for tidy CSVs: what campaign.toml would say.
    resume : bool
        Go on with what an earlier run left; with nothing there, begin.
    retry : bool
        With ``resume``: also do again what failed, and what was fitted from files that have changed since.
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
    check_pyarrow()
    check_known("sampler", [sampler], SAMPLERS)
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
    with held(folder), executor() if callable(executor) else nullcontext(executor) as pool:
        return _run(folder, found, settings, pool, resume=resume, retry=retry, force=force, progress=progress)


def _run(
    out: Path,
    found: Gathered,
    settings: Settings,
    executor: Executor | None,
    *,
    resume: bool,
    retry: bool,
    force: bool,
    progress: Callable[[int, int, int], None] | None,
) -> Batch:
    """In a folder that is held."""
    resumed = resume and (out / RECORD).exists()
    record = batch_record(found.paths, settings)
    record, key = begin(out, found.paths, record, resume=resume, force=force)
    started = time.perf_counter()
    with Journal(out / JOURNAL, len(found.paths), key) as journal:
        fitted = _fit(journal, found.paths, settings, executor, retry=retry, progress=progress)
        seconds = time.perf_counter() - started
        dataset = out / DATASET
        if fitted or journal.stale or not dataset.is_dir():
            journal.sync()
            _write(journal, found.paths, dataset, record)
            journal.stale = False
        counts = tally(dataset)
        return Batch(
            out,
            dataset,
            counts.campaigns,
            counts.done,
            counts.failed,
            counts.not_converged,
            counts.doubtful,
            counts.failures,
            counts.doubts,
            fitted,
            seconds,
            resumed,
            found.repeated,
            journal.damaged,
        )


def _fit(
    journal: Journal,
    paths: tuple[str, ...],
    settings: Settings,
    executor: Executor | None,
    *,
    retry: bool,
    progress: Callable[[int, int, int], None] | None,
) -> int:
    """Fit what has no row; the number of campaigns fitted."""
    wanted, mended = [], {}
    for index, path in enumerate(paths):
        if journal.lacks(index, retry=retry):
            wanted.append(index)
        elif retry and _mended(before := journal.read(index), os.path.join(settings.here, path)):
            wanted.append(index)
            mended[index] = before["sha256"]
    if not wanted:
        return 0
    journal.stale = True
    left = len(wanted)
    if progress is not None:
        progress(len(paths) - left, len(paths), journal.failed)
    jobs = (Job(index, paths[index]) for index in wanted)
    with closing(_done(settings, jobs, executor)) as results:
        for place, result in results:
            index = wanted[place]
            row = failed_row(settings, Job(index, paths[index]), result.reason) if isinstance(result, Lost) else result
            journal.append(index, row)
            if settings.posteriors is not None and mended.get(index, row.get("sha256")) != row.get("sha256"):
                (Path(settings.posteriors) / posterior_name(index, mended[index])).unlink(missing_ok=True)
            left -= 1
            if progress is not None:
                progress(len(paths) - left, len(paths), journal.failed)
    return len(wanted)


def _mended(row: Mapping[str, Any], place: str) -> bool:
    """Whether the files of a campaign look otherwise than when it was fitted; not where none are there now."""
    then, now = row.get(STAMP), stamp_of(place)
    return None not in (then, now) and now != then


def _done(settings: Settings, jobs: Iterator[Job], executor: Executor | None) -> Any:
    return done(partial(fit_row, settings), jobs, executor)


def _write(journal: Journal, paths: tuple[str, ...], dataset: Path, record: Mapping[str, Any]) -> None:
    """The dataset from the journal, one row in memory after the other: once for its columns, once for its rows."""
    units: dict[str, str] = {}
    for index in range(len(paths)):
        for name, own in journal.read(index).get("parameters", {}).items():
            units.setdefault(name, own["unit"])
    said = {
        "campaigns": len(paths),
        "model_sha256": record["model"]["sha256"],
        "model": record["model"]["toml"],
        "options": record["options"],
        "versions": record["versions"],
    }
    write_dataset((journal.read(index) for index in range(len(paths))), units, dataset, said)
