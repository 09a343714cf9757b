"""The table of a batch, a row a campaign, in Parquet; which of its rows count, and what is to be
minded of them."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from ldbb_bayes.errors import InputError, check_known, require

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = [
    "DATASET",
    "FLEET_COLUMNS",
    "JOURNAL",
    "PART",
    "check_pyarrow",
    "read_batch",
    "write_dataset",
]

JOURNAL = "batch.sqlite"
DATASET = "campaigns.parquet"
PART = f".{DATASET}.part"
_SCHEMA = 4
_META = b"ldbb_bayes"
_NUMBERS = ("mean", "sd", "median", "ci_low", "ci_high")
_ROWS_AT_ONCE = 1024
_DECIDED = {"probability": "double", "decision": "string"}  # of conformity with each tolerance
_TEXTS = "list<string>"
_NUMBERS_LIST = "list<double>"
# Every column and its kind: of the campaign and its fit, then, behind those of the parameters, its
# statistics.
_TABLE: Mapping[str, Any] = tomllib.loads(
    Path(__file__).with_name("columns.toml").read_text(encoding="utf-8")
)
_COLUMNS, _GAUSSIAN = (dict[str, str](_TABLE[part]) for part in ("columns", "gaussian"))


def check_pyarrow() -> None:
    """Refuse, before any work is done, where Parquet cannot be written or read."""
    try:
        import pyarrow.parquet  # noqa: F401, whether it is there
    except ImportError:
        raise InputError(
            "pyarrow must be installed for batches, got none. Run pip install 'ldbb-bayes[fleet]'."
        ) from None


def write_dataset(
    rows: Callable[[], Iterator[dict[str, Any]]], target: Path, about: Mapping[str, Any]
) -> None:
    """Write rows of `fit_row`, given from the first each time they are asked for, as a table: whole
    or not at all."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    lists = {_TEXTS: pa.list_(pa.string()), _NUMBERS_LIST: pa.list_(pa.float64())}
    types = {
        name: lists.get(kind) or pa.type_for_alias(kind)
        for name, kind in (_COLUMNS | _GAUSSIAN).items()
    }
    units = dict[str, str]()
    limited = dict[str, None]()
    for row in rows():
        limited |= dict.fromkeys(row.get("conformity", {}))
        for name, entry in row.get("parameters", {}).items():
            units.setdefault(name, entry["unit"])
    columns = [
        (name, types[name], name.rpartition("_")[2] if name.endswith(("_N", "_um")) else "")
        for name in _COLUMNS
    ]
    columns += [
        (f"{name}.{key}", pa.float64(), unit) for name, unit in units.items() for key in _NUMBERS
    ]
    columns += [
        (f"{name}.{key}", pa.type_for_alias(kind), "")
        for name in limited
        for key, kind in _DECIDED.items()
    ]
    columns += [(name, types[name], "") for name in _GAUSSIAN]
    schema = pa.schema(
        [
            pa.field(name, kind, metadata={"unit": unit} if unit else None)
            for name, kind, unit in columns
        ],
        metadata={
            _META: (
                json.dumps(
                    {"schema": _SCHEMA, **about}, ensure_ascii=False, sort_keys=True
                ).encode()
            )
        },
    )
    flat = (
        row
        | {
            f"{name}.{key}": entry[key]
            for name, entry in row.get("parameters", {}).items()
            for key in _NUMBERS
        }
        | {
            f"{name}.{key}": entry[key]
            for name, entry in row.get("conformity", {}).items()
            for key in _DECIDED
        }
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
            f"{target} must be writable, got: {' '.join(str(error).split())}. The rows are kept:"
            " free some space, then --resume."
        ) from None
    finally:
        part.unlink(missing_ok=True)


def read_batch(
    path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    columns: Sequence[str] | None = None,
) -> pd.DataFrame:
    """Return the rows of one batch, or of several below one another.

    InputError naming the file, when it is missing, unfinished, damaged or no batch.

    Parameters
    ----------
    path : the folder a batch was written to, its campaigns.parquet, or several of either.
    columns : those to read, in that order; default: all.

    Returns
    -------
    One row per campaign, in the order given: campaign, name, sha256, machine_id, date, status
    ("done" or "failed"), reason, topology, planes, compliances (JSON: what each stands for),
    tolerances (JSON), tests, readings, force_min_N, force_max_N, reference_force_N, degree, terms,
    model_sha256, sampler, seed, versions, converged, state, kinds, verdict, misfits, warnings,
    log_prob_truncation [nat], rmse_um, log_bayes_factor (linear over constant),
    log_bayes_factor_error [nat]; of every parameter and hyper-parameter NAME.mean, NAME.sd,
    NAME.median, NAME.ci_low, NAME.ci_high (mm, N, rad; ``attrs["units"]``); of every quantity with
    a tolerance NAME.probability (of conformance) and NAME.decision; ``gaussian_…`` as
    `SufficientStatistics`, the covariance as its lower triangle, row by row. What a campaign does
    not have is missing.
    """
    check_pyarrow()
    import pyarrow as pa

    given = [path] if isinstance(path, str | os.PathLike) else list(path)
    require(given, "batches must be given, got none. Name the --out folder of a batch.")
    read = [_read(_dataset(Path(entry)), columns) for entry in given]
    whole = pa.concat_tables([table for table, _ in read], promote_options="default")
    if columns is not None:
        check_known(
            "column", columns, dict.fromkeys(name for _, schema in read for name in schema.names)
        )
        whole = whole.select(list(dict.fromkeys(columns)))
    frame: pd.DataFrame = whole.to_pandas()
    frame.attrs["units"] = {
        field.name.rpartition(".")[0]: field.metadata[b"unit"].decode()
        for field in whole.schema
        if field.name.endswith(".mean") and field.metadata and b"unit" in field.metadata
    }
    return frame


def _dataset(path: Path) -> Path:
    if (path / DATASET).is_file():
        return path / DATASET
    if (path / JOURNAL).is_file():
        raise InputError(
            f"{path} must be a finished batch, got one that stopped before. Go on with it"
            " (--resume), then read it."
        )
    if path.is_file():
        return path
    got = "a folder without one" if path.is_dir() else "nothing"
    raise InputError(
        f"{path} must be the --out folder of a batch, or its {DATASET}, got {got}. Check the path."
    )


def _read(path: Path, columns: Sequence[str] | None) -> tuple[pa.Table, pa.Schema]:
    """The columns that are there of those wanted, and the whole schema."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            schema = file.schema_arrow
            table = file.read(columns)
            table.validate(full=True)
    except (pa.ArrowException, OSError, ValueError) as error:
        ours = (path.parent / JOURNAL).is_file()
        got = "a damaged" if ours else "another, or a damaged"
        cure = (
            "Remove it and run the batch with --resume, which writes it anew."
            if ours
            else "Give a batch's --out folder."
        )
        reason = " ".join(str(error).split())[:120]
        raise InputError(
            f"{path} must be the table of a batch, got {got} file ({reason}). {cure}"
        ) from None
    about = json.loads((schema.metadata or {}).get(_META, "{}"))
    if about.get("schema") != _SCHEMA:
        got = f"schema {about['schema']}" if about else "a Parquet file of something else"
        raise InputError(
            f"{path} must be a batch's table of schema {_SCHEMA}, got {got}. Give the --out folder"
            " of a batch."
        )
    return table, schema


# ---- which campaigns count

# The columns of a batch's table that a trend or a population asks for.
FLEET_COLUMNS: tuple[str, ...] = tuple(_TABLE["fleet"])
