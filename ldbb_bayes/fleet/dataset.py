"""The table of a batch: rows written as Parquet, and read."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ldbb_bayes.errors import InputError, check_known

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

__all__ = ["DATASET", "JOURNAL", "PART", "check_pyarrow", "read_batch", "write_dataset"]

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
    """Write rows of `fit_row` as a table, whole or not at all, few of them in memory at a time.

    Parameters
    ----------
    rows : callable
        Gives them from the first; called twice.
    target : path
    about : mapping
        What the table says of itself.

    Raises
    ------
    InputError
        When it cannot be written.
    """
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
