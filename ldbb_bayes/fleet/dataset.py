"""Rows of a batch as a Parquet dataset: a folder of parts, in the order given, the same bytes from the same rows."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ldbb_bayes.errors import InputError
from ldbb_bayes.files import staged_folder
from ldbb_bayes.fleet.row import STAMP

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["META", "PART", "check_pyarrow", "flat", "kinds", "write_dataset"]

SCHEMA = 1
META = b"ldbb_bayes"
PART = re.compile(r"part-\d{5}\.parquet")
NUMBERS = ("mean", "sd", "median", "ci_low", "ci_high")
_ROWS_A_PART, _ROWS_AT_ONCE = 4096, 256
_TEXT, _WHOLE, _NUMBER, _YES_NO, _TEXTS, _LIST_OF_NUMBERS = "text", "whole", "number", "yes or no", "texts", "numbers"
_COLUMNS: dict[str, tuple[str, str]] = {
    "campaign": (_TEXT, ""),
    "name": (_TEXT, ""),
    "sha256": (_TEXT, ""),
    "machine_id": (_TEXT, ""),
    "date": (_TEXT, ""),
    "status": (_TEXT, ""),
    "reason": (_TEXT, ""),
    "topology": (_TEXT, ""),
    "planes": (_TEXT, ""),
    "compliances": (_TEXT, ""),
    "tests": (_WHOLE, ""),
    "readings": (_WHOLE, ""),
    "force_min_N": (_NUMBER, "N"),
    "force_max_N": (_NUMBER, "N"),
    "reference_force_N": (_NUMBER, "N"),
    "degree": (_WHOLE, ""),
    "terms": (_TEXTS, ""),
    "model_sha256": (_TEXT, ""),
    "sampler": (_TEXT, ""),
    "seed": (_WHOLE, ""),
    "versions": (_TEXT, ""),
    "converged": (_YES_NO, ""),
    "verdict": (_TEXT, ""),
    "misfits": (_TEXTS, ""),
    "warnings": (_TEXTS, ""),
    "log_prob_truncation": (_NUMBER, "nat"),
    "rmse_um": (_NUMBER, "um"),
    "log_bayes_factor": (_NUMBER, "nat"),
    "log_bayes_factor_error": (_NUMBER, "nat"),
}
_GAUSSIAN: dict[str, tuple[str, str]] = {
    "gaussian_names": (_TEXTS, ""),
    "gaussian_units": (_TEXTS, ""),
    "gaussian_mean": (_LIST_OF_NUMBERS, ""),
    "gaussian_covariance": (_LIST_OF_NUMBERS, ""),
    "gaussian_prior_mean": (_LIST_OF_NUMBERS, ""),
    "gaussian_prior_sd": (_LIST_OF_NUMBERS, ""),
}


def check_pyarrow() -> None:
    """Refuse, before any work is done, where Parquet cannot be written or read.

    Raises
    ------
    InputError
    """
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise InputError("pyarrow must be installed for batches, got none. Run pip install 'ldbb-bayes[fleet]'.") from None


@lru_cache(maxsize=1)
def kinds() -> dict[str, pa.DataType]:
    """Columns that every dataset has, and their types."""
    types = _types()
    return {name: types[kind] for name, (kind, _) in (_COLUMNS | _GAUSSIAN).items()}


def flat(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row of `fit_row` with the numbers of every parameter in columns of their own, texts that Parquet takes, and no stamp."""
    numbers = {f"{name}.{key}": own[key] for name, own in row.get("parameters", {}).items() for key in NUMBERS}
    return {name: _sound(value) for name, value in row.items() if name not in (STAMP, "parameters")} | numbers


def _sound(value: Any) -> Any:
    """Half a character, as names of files can hold one, becomes a question mark."""
    if isinstance(value, str):
        return value.encode("utf-8", "replace").decode()
    return [_sound(own) for own in value] if isinstance(value, list) else value


def write_dataset(rows: Iterable[Mapping[str, Any]], units: Mapping[str, str], target: Path, said: Mapping[str, Any]) -> Path:
    """Write the dataset, whole or not at all, in place of one that may be there.

    Parameters
    ----------
    rows : iterable of mapping
        Of `fit_row`; no more than one part of the table is in memory.
    units : mapping of parameter to unit
        Of every parameter in any row, in the order of their columns.
    target : path
    said : mapping
        Model, seed, versions, …: what the dataset says of itself; for JSON.

    Raises
    ------
    InputError
        When it cannot be written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = _schema(units, said)
    ours = [own.name for own in target.iterdir() if PART.fullmatch(own.name)] if target.is_dir() else []
    with staged_folder(target, force=True, ours=ours) as staging:
        try:
            for number, table in enumerate(_parts(rows, schema)):
                path = staging / f"part-{number:05d}.parquet"
                pq.write_table(
                    table, path, row_group_size=_ROWS_A_PART, version="2.6", compression="zstd", write_page_checksum=True
                )
                os.chmod(path, 0o644)
        except pa.ArrowException as error:
            raise InputError(
                f"{target} must be writable, got: {_line(error)}. The rows are kept: free some space, then --resume."
            ) from None
        except (TypeError, OverflowError) as error:
            raise InputError(
                f"{target} must have rows that fit its columns, got: {_line(error)}. The rows are kept: please report it."
            ) from None
    return target


def _line(error: Exception) -> str:
    return " ".join(str(error).split())


def _schema(units: Mapping[str, str], said: Mapping[str, Any]) -> pa.Schema:
    import pyarrow as pa

    types = _types()
    columns = list(_COLUMNS.items())
    columns += [(f"{name}.{key}", (_NUMBER, unit)) for name, unit in units.items() for key in NUMBERS]
    columns += list(_GAUSSIAN.items())
    fields = [pa.field(name, types[kind], metadata={"unit": unit} if unit else None) for name, (kind, unit) in columns]
    text = json.dumps({"schema": SCHEMA, **said}, ensure_ascii=False, sort_keys=True)
    return pa.schema(fields, metadata={META: text.encode()})


def _types() -> dict[str, pa.DataType]:
    import pyarrow as pa

    return {
        _TEXT: pa.string(),
        _WHOLE: pa.int64(),
        _NUMBER: pa.float64(),
        _YES_NO: pa.bool_(),
        _TEXTS: pa.list_(pa.string()),
        _LIST_OF_NUMBERS: pa.list_(pa.float64()),
    }


def _parts(rows: Iterable[Mapping[str, Any]], schema: pa.Schema) -> Iterator[pa.Table]:
    """The table in parts; few rows at a time are Python's, which take ten times the room."""
    import pyarrow as pa

    left = map(flat, rows)
    while True:
        pieces: list[pa.Table] = []
        while (size := min(_ROWS_AT_ONCE, _ROWS_A_PART - sum(map(len, pieces)))) and (few := list(islice(left, size))):
            pieces.append(pa.Table.from_pylist(few, schema=schema))
        if not pieces:
            return
        yield pa.concat_tables(pieces).combine_chunks()
