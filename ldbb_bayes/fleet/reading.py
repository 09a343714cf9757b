"""The rows of batches as they stand on disk, taken for what they are only once they have been checked."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.fleet.begun import DATASET, RECORD
from ldbb_bayes.fleet.dataset import META, PART, SCHEMA, check_pyarrow, kinds

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

__all__ = ["Tally", "contradicts", "read_batch", "tally"]

_MOST_NAMED = 10_000
_IMPROBABLE = math.log(1e-3)
_REASON = 120


def read_batch(
    path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]], columns: Sequence[str] | None = None
) -> pd.DataFrame:
    """The rows of one batch, or of several below one another.

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
        reference_force_N, degree, terms, model_sha256, sampler, seed, versions, converged, verdict, misfits, warnings,
        log_prob_truncation [nat], rmse_um, log_bayes_factor (linear over constant) and log_bayes_factor_error [nat]; of every
        parameter and hyper-parameter NAME.mean, NAME.sd, NAME.median, NAME.ci_low, NAME.ci_high (mm, N, rad;
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
    tables, said, known = [], [], dict.fromkeys(kinds())
    for own in given:
        folder = _dataset(Path(own))
        parts = [table for _, table in _parts(folder, None if columns is None else [*columns, "status"])]
        tables += parts
        known |= dict.fromkeys(_names(folder))
        said.append(json.loads(parts[0].schema.metadata[META]))
    try:
        whole = pa.concat_tables(tables, promote_options="default")
    except (pa.ArrowException, TypeError) as error:
        raise InputError(
            f"batches must have columns of the same kinds, got {_short(error)}. Write them anew (--resume)."
        ) from None
    if columns is not None:
        check_known("column", columns, known)
        whole = whole.select(list(dict.fromkeys(columns)))
    frame: pd.DataFrame = whole.to_pandas()
    frame.attrs["units"] = {
        field.name.rpartition(".")[0]: field.metadata[b"unit"].decode()
        for field in whole.schema
        if field.name.endswith(".mean") and field.metadata and b"unit" in field.metadata
    }
    frame.attrs["batches"] = said
    return frame


@dataclass(frozen=True)
class Tally:
    """How many campaigns of a dataset were fitted, and how well; the first failures with their reasons, the first doubts with
    their verdicts."""

    campaigns: int
    done: int
    not_converged: int
    doubtful: int
    failed: int
    failures: tuple[tuple[str, str], ...]
    doubts: tuple[tuple[str, str], ...]


def tally(dataset: Path) -> Tally:
    """Count the rows of a dataset; doubtful are those that the model does not expect, or that speak against it."""
    columns = ["campaign", "status", "reason", "converged", "verdict", "misfits", "log_prob_truncation"]
    campaigns = done = not_converged = doubtful = 0
    failures: list[tuple[str, str]] = []
    doubts: list[tuple[str, str]] = []
    for _, table in _parts(dataset, columns):
        for row in table.to_pylist():
            campaigns += 1
            if row["status"] == "done":
                done += 1
                not_converged += not row["converged"]
                doubted = bool(row["misfits"]) or contradicts(row["log_prob_truncation"])
                doubtful += bool(row["converged"] and doubted)
                if (doubted or not row["converged"]) and len(doubts) < _MOST_NAMED:
                    doubts.append((row["campaign"], row["verdict"]))
            elif len(failures) < _MOST_NAMED:
                failures.append((row["campaign"], row["reason"]))
    return Tally(campaigns, done, not_converged, doubtful, campaigns - done, tuple(failures), tuple(doubts))


def contradicts(log_prob_truncation: float | None) -> bool:
    """Whether readings speak against non-negative compliance (below one in a thousand)."""
    return log_prob_truncation is not None and log_prob_truncation < _IMPROBABLE


def _dataset(path: Path) -> Path:
    if (path / DATASET).is_dir():
        return path / DATASET
    if (path / RECORD).is_file():
        raise InputError(f"{path} must be a finished batch, got one that stopped before. Go on with it (--resume), then read it.")
    if path.is_dir() and any(PART.fullmatch(own.name) for own in path.iterdir()):
        return path
    got = "a folder without one" if path.is_dir() else "a file" if path.exists() else "nothing"
    raise InputError(f"{path} must be the --out folder of a batch, or its {DATASET}, got {got}. Check the path.")


def _parts(dataset: Path, columns: list[str] | None = None) -> Iterator[tuple[Path, pa.Table]]:
    """The parts in order, every one of them there and as they were written."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    cure = "Remove its folder and run the batch with --resume, which writes it anew."
    paths = sorted(own for own in dataset.iterdir() if PART.fullmatch(own.name))
    promised, read = -1, 0
    for number, path in enumerate(paths):
        try:
            with pq.ParquetFile(path, page_checksum_verification=True) as file:
                promised = _check(file.schema_arrow, path)
                table = file.read(columns)
                table.validate(full=True)
        except InputError:
            raise
        except (pa.ArrowException, OSError, ValueError, TypeError, KeyError, RecursionError, MemoryError) as error:
            raise InputError(f"{path} must be a part of a batch, got a damaged file ({_short(error)}). {cure}") from None
        if path.name != f"part-{number:05d}.parquet":
            raise InputError(f"{dataset} must have all its parts, got {path.name} where part {number} should be. {cure}")
        read += table.num_rows
        status = set(table.column("status").to_pylist())
        if not status <= {"done", "failed"}:
            odd = next(own for own in status if own not in ("done", "failed"))
            raise InputError(f"{path}: status must be done or failed, got {odd!r}. {cure}")
        yield path, table
    if read != promised:
        raise InputError(f"{dataset} must have {max(promised, 1)} rows, got {read}: a part is missing. {cure}")


def _names(dataset: Path) -> list[str]:
    """Of all columns; in a dataset that was read."""
    import pyarrow.parquet as pq

    return list(pq.read_schema(dataset / "part-00000.parquet").names)


def _check(schema: pa.Schema, path: Path) -> int:
    """The number of rows the whole dataset promises."""
    cure = "Give the --out folder of a batch."
    try:
        said: dict[str, Any] = json.loads((schema.metadata or {})[META])
        number, version = int(said["campaigns"]), int(said["schema"])
    except (KeyError, ValueError, TypeError):
        raise InputError(f"{path} must be a part of a batch, got a Parquet file of something else. {cure}") from None
    if version != SCHEMA:
        raise InputError(f"{path} must have schema {SCHEMA}, got {version}. Upgrade ldbb-bayes, or run the batch again.")
    for name, kind in kinds().items():
        found = schema.get_field_index(name)
        if found < 0:
            raise InputError(f"{path} must have a column {name}, got none. {cure}")
        if schema.field(found).type != kind:
            raise InputError(f"{path}: column {name} must be of type {kind}, got {schema.field(found).type}. {cure}")
    return number


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:_REASON] or type(error).__name__
