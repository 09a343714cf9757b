"""One campaign, one row: what a fit says of it, or why there is none; and the table of all rows, in Parquet."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.folder import labels_of, read_campaign
from ldbb_bayes.errors import InputError, check_known, plain_reason
from ldbb_bayes.files import write_whole
from ldbb_bayes.fleet.population_prior import PopulationPrior, stands_for
from ldbb_bayes.fleet.statistics import sufficient_statistics
from ldbb_bayes.inference.evidence import log_bayes_factor, log_evidence
from ldbb_bayes.inference.mcmc import StoppingRule
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.posterior import numbers_of, record_of, saved_bytes
from ldbb_bayes.inference.sample import sample_with_densities, versions
from ldbb_bayes.jobs import one_blas_thread
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.specification import model_from_toml, model_sha256
from ldbb_bayes.report.findings import fit_in_words

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

__all__ = ["DATASET", "JOURNAL", "PART", "Job", "Settings", "fit_row", "read_batch", "write_dataset"]

_EVIDENCE_TOLERANCE = 1e-2
_LONGEST_REASON = 1200
# What no campaign causes: a full or failing disk, a mount that went, a system that opens no more files.
_NAMES = ("ENOSPC", "EDQUOT", "EIO", "ESTALE", "ENODEV", "ENOTCONN", "ETIMEDOUT", "EMFILE", "ENFILE")
_SYSTEM = {getattr(errno, name) for name in _NAMES if hasattr(errno, name)}


@dataclass(frozen=True)
class Settings:
    """How every campaign of a batch is fitted.

    ``posteriors`` is a folder for a posterior of every campaign, ``table`` fields of `Campaign` that tidy CSVs do not say,
    ``here`` the folder that relative paths start from, wherever a worker stands, ``population`` that whose prior is in the model:
    what speaks against it is said of every campaign.
    """

    model_toml: str
    sampler: str = "independent"
    seed: int = 1
    ess: float = 1000.0
    ci_prob: float = 0.95
    compare: bool = True
    posteriors: str | None = None
    table: Mapping[str, Any] = field(default_factory=dict)
    here: str = ""
    population: PopulationPrior | None = None

    @property
    def model(self) -> HybridModel:
        """The model in the TOML."""
        return _model(self.model_toml)


_model = lru_cache(maxsize=4)(model_from_toml)


@dataclass(frozen=True)
class Job:
    """A campaign's number in the batch, and its path as given."""

    index: int
    path: str


@one_blas_thread
def fit_row(settings: Settings, job: Job) -> dict[str, Any]:
    """Return the row of a campaign; ``parameters`` holds unit and numbers of each by name, ``stamp`` what its files looked like.

    Raises InputError when the disk or its mount fails, as it would for every other campaign too.
    """
    place = os.path.join(settings.here, job.path)
    row = _given(settings, job) | {"stamp": stamp_of(place)}
    try:
        with warnings.catch_warnings(action="ignore"):
            is_table = not os.path.isdir(place) and not place.lower().endswith(".toml")
            campaign = read_campaign(place, **(settings.table if is_table else {}))
            row |= _origin(campaign)
            fitted, posterior = _fitted(settings, campaign)
    except Exception as error:  # noqa: BLE001  # one campaign must not end the others
        _refuse_a_failing_disk(error, place)
        return labels_of(place) | row | {"status": "failed", "reason": _reason(error).replace(place, job.path)}
    if settings.posteriors is not None:
        write_whole(Path(settings.posteriors) / posterior_name(job.index, campaign.sha256), posterior)
    return row | fitted


def failed_row(settings: Settings, job: Job, reason: str) -> dict[str, Any]:
    """Return the row of a campaign that could not even be tried."""
    place = os.path.join(settings.here, job.path)
    return labels_of(place) | _given(settings, job) | {"stamp": None, "status": "failed", "reason": reason}


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
        **{name: getattr(campaign, name) for name in ("name", "sha256", "machine_id", "date", "topology", "readings")},
        "planes": ",".join(campaign.machine().planes),
        "compliances": json.dumps(stands_for(campaign)),
        "tests": len(campaign.tests),
        "force_min_N": float(campaign.forces_N.min()),
        "force_max_N": float(campaign.forces_N.max()),
    }


def _fitted(settings: Settings, campaign: Campaign) -> tuple[dict[str, Any], bytes]:
    """Columns of the fit, and its posterior as bytes of a file where it is to be kept."""
    doubts = () if settings.population is None else settings.population.doubts(campaign)
    posterior, densities = sample_with_densities(
        settings.model, campaign, sampler=settings.sampler, seed=settings.seed, rule=StoppingRule(ess=settings.ess)
    )
    record, words = record_of(posterior), fit_in_words(posterior)
    beside, breakdowns = _beside(settings, campaign, densities)
    row = {
        **beside,
        "status": "done",
        "reference_force_N": record["model"]["reference_force_N"],
        "terms": record["model"]["terms"],
        "converged": bool(record["sampler"]["converged"]),
        **words,
        "warnings": [*words["warnings"], *breakdowns, *doubts],
        "log_prob_truncation": record["fit"]["log_prob_truncation"],
        "rmse_um": record["fit"]["rmse_um"],
        "parameters": {
            str(name): {"unit": variable.attrs.get("unit", ""), **numbers_of(variable.to_numpy(), settings.ci_prob)}
            for name, variable in posterior["posterior"].data_vars.items()
        },
    }
    return row, b"" if settings.posteriors is None else saved_bytes(posterior)


def _beside(settings: Settings, campaign: Campaign, densities: Mapping[bool, HyperPosterior]) -> tuple[dict[str, Any], list[str]]:
    """Columns of the Bayes factor and of the sufficient statistics; one that breaks down is a warning, and the fit stands."""
    model = settings.model
    if model.prior.flat:
        return {}, []
    parts: dict[str, Callable[[], dict[str, Any]]] = {}
    if settings.compare and model.degree and campaign.force_levels > 1:
        parts["Bayes factor"] = lambda: _bayes_factor(model, campaign, densities[model.prior.truncated])
    parts["sufficient statistics"] = lambda: sufficient_statistics(densities[False]).columns()
    found: dict[str, Any] = {}
    breakdowns = []
    for name, part in parts.items():
        try:
            found |= part()
        except (InputError, ArithmeticError, np.linalg.LinAlgError) as error:
            breakdowns.append(f"No {name}: {plain_reason(error)}")
    return found, breakdowns


def _bayes_factor(model: HybridModel, campaign: Campaign, density: HyperPosterior) -> dict[str, float]:
    if model.degree == 1 and density.truncated == density.bound.truncation.active:
        linear = density.nodes(_EVIDENCE_TOLERANCE).evidence
    else:
        linear = log_evidence(model.with_degree(1), campaign, tolerance=_EVIDENCE_TOLERANCE)
    constant = log_evidence(model.with_degree(0), campaign, tolerance=_EVIDENCE_TOLERANCE)
    value, error = log_bayes_factor(linear, constant)
    return {"log_bayes_factor": float(value), "log_bayes_factor_error": float(error)}


def _reason(error: Exception) -> str:
    """One line; of an error that no input should cause also its kind and place, so that it can be mended."""
    reason = plain_reason(error)
    if isinstance(error, MemoryError):
        reason = f"the campaign must fit into memory, got: {error or 'not enough'}. Leave out readings, or add memory."
    elif reason is None:
        last = traceback.extract_tb(error.__traceback__)[-1]
        place = "/".join(Path(last.filename).parts[-2:])
        reason = f"unexpected {type(error).__name__}: {error} ({place}, line {last.lineno}). Please report it."
    return " ".join(reason.split())[:_LONGEST_REASON]


def _refuse_a_failing_disk(error: BaseException, place: str) -> None:
    """End the batch where it is the disk, not the campaign: else every campaign left would count as failed."""
    chain: list[BaseException] = [error]
    while (before := chain[-1].__cause__ or chain[-1].__context__) is not None and before not in chain:
        chain.append(before)
    try:
        os.stat(place)  # of a mount that went, exists() and the like only say that nothing is there
    except (OSError, ValueError) as gone:
        chain.append(gone)
    for each in chain:
        if isinstance(each, OSError) and each.errno in _SYSTEM:
            raise InputError(
                f"{each.filename or place} must be usable, got: {each.strerror}. That is the place, not the campaign: mend it "
                "(or remove this file, if it alone is lost), then go on with --resume. What is done is kept."
            ) from None


def stamp_of(place: str) -> str | None:
    """Return a digest of the sizes and times of a campaign's files; None where nothing is there."""
    digest = hashlib.blake2b(digest_size=8)
    root = Path(place) if os.path.isdir(place) else Path(place).parent
    whole = os.path.isdir(place) or place.lower().endswith(".toml")
    try:
        files = sorted(path for path in root.rglob("*") if path.suffix.lower() in (".toml", ".csv")) if whole else [Path(place)]
        for path in files:
            seen = path.stat()
            digest.update(f"{path.relative_to(root)}\0{seen.st_size}\0{seen.st_mtime_ns}\n".encode(errors="surrogateescape"))
    except (OSError, ValueError):
        return None
    return digest.hexdigest() if files else None


def posterior_name(index: int, sha256: str) -> str:
    """Return the name of a campaign's posterior: its number in the batch, and the beginning of its digest."""
    return f"{index:07d}-{sha256[:12]}.nc"


# ---- the table

JOURNAL, DATASET = "batch.sqlite", "campaigns.parquet"
PART = f".{DATASET}.part"
_SCHEMA = 2
_META = b"ldbb_bayes"
_NUMBERS = ("mean", "sd", "median", "ci_low", "ci_high")
_ROWS_AT_ONCE = 1024
_TEXT, _TEXTS, _NUMBERS_LIST = "string", "list<string>", "list<double>"
_COLUMNS = {
    **dict.fromkeys(("campaign", "name", "sha256", "machine_id", "date", "status", "reason", "topology", "planes"), _TEXT),
    "compliances": _TEXT,
    **dict.fromkeys(("tests", "readings"), "int64"),
    **dict.fromkeys(("force_min_N", "force_max_N", "reference_force_N"), "double"),
    "degree": "int64",
    "terms": _TEXTS,
    "model_sha256": _TEXT,
    "sampler": _TEXT,
    "seed": "int64",
    "versions": _TEXT,
    "converged": "bool",
    "state": _TEXT,
    "kinds": _TEXTS,
    "verdict": _TEXT,
    **dict.fromkeys(("misfits", "warnings"), _TEXTS),
    **dict.fromkeys(("log_prob_truncation", "rmse_um", "log_bayes_factor", "log_bayes_factor_error"), "double"),
}
_GAUSSIAN = {
    **dict.fromkeys(("gaussian_names", "gaussian_units"), _TEXTS),
    **dict.fromkeys(("gaussian_mean", "gaussian_covariance", "gaussian_prior_mean", "gaussian_prior_sd"), _NUMBERS_LIST),
}


def check_pyarrow() -> None:
    """Refuse, before any work is done, where Parquet cannot be written or read."""
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise InputError("pyarrow must be installed for batches, got none. Run pip install 'ldbb-bayes[fleet]'.") from None


@lru_cache(maxsize=1)
def _types() -> dict[str, pa.DataType]:
    """Of the columns that every dataset has."""
    import pyarrow as pa

    lists = {_TEXTS: pa.list_(pa.string()), _NUMBERS_LIST: pa.list_(pa.float64())}
    return {name: lists.get(kind) or pa.type_for_alias(kind) for name, kind in (_COLUMNS | _GAUSSIAN).items()}


def write_dataset(rows: Callable[[], Iterator[dict[str, Any]]], target: Path, about: Mapping[str, Any]) -> None:
    """Write rows of `fit_row`, given from the first each time they are asked for, as a table: whole or not at all."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    units: dict[str, str] = {}
    for row in rows():
        for name, entry in row.get("parameters", {}).items():
            units.setdefault(name, entry["unit"])
    types = _types()
    columns = [(name, types[name], name.rpartition("_")[2] if name.endswith(("_N", "_um")) else "") for name in _COLUMNS]
    columns += [(f"{name}.{key}", types["rmse_um"], unit) for name, unit in units.items() for key in _NUMBERS]
    columns += [(name, types[name], "") for name in _GAUSSIAN]
    schema = pa.schema(
        [pa.field(name, kind, metadata={"unit": unit} if unit else None) for name, kind, unit in columns],
        metadata={_META: json.dumps({"schema": _SCHEMA, **about}, ensure_ascii=False, sort_keys=True).encode()},
    )
    flat = (
        row | {f"{name}.{key}": entry[key] for name, entry in row.get("parameters", {}).items() for key in _NUMBERS}
        for row in rows()
    )
    part = target.with_name(PART)
    try:
        with pq.ParquetWriter(part, schema, compression="zstd", write_page_checksum=True) as writer:
            while few := list(islice(flat, _ROWS_AT_ONCE)):
                writer.write_table(pa.Table.from_pylist(few, schema=schema))
        os.replace(part, target)
    except (OSError, pa.ArrowException) as error:
        raise InputError(
            f"{target} must be writable, got: {' '.join(str(error).split())}. The rows are kept: free some space, then --resume."
        ) from None
    finally:
        part.unlink(missing_ok=True)


def read_batch(
    path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]], columns: Sequence[str] | None = None
) -> pd.DataFrame:
    """Return the rows of one batch, or of several below one another.

    Parameters
    ----------
    path : path or sequence of paths
        The folder a batch was written to, its campaigns.parquet, or several of either.
    columns : sequence of str, optional
        Those to read, in that order; default: all.

    Returns
    -------
    DataFrame
        One row per campaign, in the order given: campaign, name, sha256, machine_id, date, status ("done" or "failed"), reason,
        topology, planes, compliances (JSON: what each stands for), tests, readings, force_min_N, force_max_N,
        reference_force_N, degree, terms, model_sha256, sampler, seed, versions, converged, state, kinds, verdict, misfits,
        warnings, log_prob_truncation [nat], rmse_um, log_bayes_factor (linear over constant), log_bayes_factor_error [nat]; of
        every parameter and hyper-parameter NAME.mean, NAME.sd, NAME.median, NAME.ci_low, NAME.ci_high (mm, N, rad;
        ``attrs["units"]``); gaussian_… as `SufficientStatistics`, the covariance as its lower triangle, row by row. What a
        campaign does not have is missing. ``attrs["batches"]``: what each says of itself.

    Raises
    ------
    InputError
        Naming the file, when it is missing, unfinished, damaged or no batch.
    """
    check_pyarrow()
    import pyarrow as pa

    given = [path] if isinstance(path, str | os.PathLike) else list(path)
    if not given:
        raise InputError("batches must be given, got none. Name the --out folder of a batch.")
    read = [_read(_dataset(Path(entry)), columns) for entry in given]
    try:
        whole = pa.concat_tables([table for table, _ in read], promote_options="default")
    except (pa.ArrowException, TypeError) as error:
        raise InputError(f"batches must have columns of the same kinds, got {str(error)[:120]}. Write them anew.") from None
    if columns is not None:
        check_known("column", columns, dict.fromkeys(name for _, schema in read for name in schema.names))
        whole = whole.select(list(dict.fromkeys(columns)))
    frame: pd.DataFrame = whole.to_pandas()
    frame.attrs["units"] = {
        field.name.rpartition(".")[0]: field.metadata[b"unit"].decode()
        for field in whole.schema
        if field.name.endswith(".mean") and field.metadata and b"unit" in field.metadata
    }
    frame.attrs["batches"] = [json.loads(schema.metadata[_META]) for _, schema in read]
    return frame


def _dataset(path: Path) -> Path:
    if (path / DATASET).is_file():
        return path / DATASET
    if (path / JOURNAL).is_file():
        raise InputError(f"{path} must be a finished batch, got one that stopped before. Go on with it (--resume), then read it.")
    if path.is_file():
        return path
    got = "a folder without one" if path.is_dir() else "nothing"
    raise InputError(f"{path} must be the --out folder of a batch, or its {DATASET}, got {got}. Check the path.")


def _read(path: Path, columns: Sequence[str] | None) -> tuple[pa.Table, pa.Schema]:
    """The columns that are there of those wanted, and the whole schema."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    cure = "Remove it and run the batch with --resume, which writes it anew."
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            schema = file.schema_arrow
            _check_schema(schema, path)
            table = file.read(columns if columns is None else [*columns, "status"])
            table.validate(full=True)
    except InputError:
        raise
    except (pa.ArrowException, OSError, ValueError, TypeError, KeyError, RecursionError, MemoryError) as error:
        short = " ".join(str(error).split())[:120]
        raise InputError(f"{path} must be the table of a batch, got a damaged file ({short}). {cure}") from None
    odd = set(table.column("status").to_pylist()) - {"done", "failed"}
    if odd:
        raise InputError(f"{path}: status must be done or failed, got {odd.pop()!r}. {cure}")
    return table, schema


def _check_schema(schema: pa.Schema, path: Path) -> None:
    cure = "Give the --out folder of a batch."
    try:
        version = json.loads((schema.metadata or {})[_META])["schema"]
    except (KeyError, ValueError, TypeError):
        raise InputError(f"{path} must be the table of a batch, got a Parquet file of something else. {cure}") from None
    if version != _SCHEMA:
        raise InputError(f"{path} must have schema {_SCHEMA}, got {version}. Upgrade ldbb-bayes, or run the batch again.")
    for name, kind in _types().items():
        if name not in schema.names:
            raise InputError(f"{path} must have a column {name}, got none. {cure}")
        if schema.field(name).type != kind:
            raise InputError(f"{path}: column {name} must be of type {kind}, got {schema.field(name).type}. {cure}")
