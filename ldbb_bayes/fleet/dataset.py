"""The table of a batch, a row a campaign, in Parquet; which of its rows count, and what is to be
minded of them."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from ldbb_bayes.errors import InputError, check_known, nearest, require
from ldbb_bayes.inference.checks import CheckKind
from ldbb_bayes.inference.fit import ConcernKind
from ldbb_bayes.report.wording import caveat_words
from ldbb_bayes.results import Result

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = [
    "DATASET",
    "FLEET_COLUMNS",
    "JOURNAL",
    "PART",
    "Caveat",
    "CaveatKind",
    "check_pyarrow",
    "check_rows",
    "choose",
    "labels",
    "moment",
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
        import pyarrow.parquet
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


class CaveatKind(StrEnum):
    """What is to be minded of the campaigns that a result rests on, and of the result."""

    EXCLUDED = "excluded"
    BEFORE = "before"
    FAILED = "failed"
    NO_STATISTICS = "no-statistics"
    GIVEN_AGAIN = "given-again"
    UNEXPECTED = "unexpected"
    NOT_CONVERGED = "not-converged"
    NOT_WHITE = "not-white"
    NO_MACHINES = "no-machines"
    WITHOUT_MACHINE = "without-machine"
    MACHINES_OF_THEIR_OWN = "machines-of-their-own"
    EXTRAPOLATED = "extrapolated"
    NO_DATES = "no-dates"
    TWO_CAMPAIGNS = "two-campaigns"
    SPREADS_NOT_TRUSTED = "spreads-not-trusted"
    ONE_INSTRUMENT = "one-instrument"
    FEW_MACHINES = "few-machines"
    UNCERTAIN_P_VALUES = "uncertain-p-values"


@dataclass(frozen=True)
class Caveat(Result):
    """One thing to mind: of which campaigns, machines or parameters, and numbers that go with
    it."""

    kind: CaveatKind
    names: tuple[str, ...] = ()
    values: tuple[float, ...] = ()
    text: str = ""


def check_rows(rows: pd.DataFrame) -> None:
    """Refuse what is not the table of a batch."""
    for name in FLEET_COLUMNS:
        require(
            name in rows,
            f"rows must be the table of a batch, got one without {name}. Give what read_batch"
            " returns.",
        )


def choose(
    rows: pd.DataFrame,
    exclude: Sequence[str] = (),
    since: str | None = None,
    include_misfits: bool = False,
    *,
    among: pd.DataFrame | None = None,
) -> tuple[pd.DataFrame, list[Caveat]]:
    """Return the rows of a batch (`read_batch`) to rely on, what was left out and why, and what is
    to be minded of the others.

    Left out are ``exclude``, campaigns (path as given, last part of it, or name) and machines
    (machine_id) of the whole batch (``among``); campaigns before ``since`` (ISO 8601) and those
    without a date; and, but for ``include_misfits``, those whose readings the model does not
    expect: orders of a circle that fail their check, or readings against non-negative compliance.
    Readings a thousand times too large would move the mean of a population, widen its spread, and
    hide a change of their machine.
    """
    check_rows(rows)
    found = rows["kinds"].map(lambda own: set(own) if own is not None else set())
    digests = rows["sha256"]
    unexpected = found.map(
        lambda own: not own.isdisjoint((CheckKind.ORDER, ConcernKind.TRUNCATION))
    ).astype(bool)
    not_white = found.map(
        lambda own: not own.isdisjoint((CheckKind.NOISE, CheckKind.AUTOCORRELATION))
    ).astype(bool)
    left_out: dict[CaveatKind, Callable[[pd.DataFrame], pd.Series[bool]]] = {
        CaveatKind.EXCLUDED: lambda own: _named(own, exclude, rows if among is None else among),
        CaveatKind.BEFORE: lambda own: _before(own, since),
        CaveatKind.FAILED: lambda own: own["status"] != "done",
        CaveatKind.NO_STATISTICS: lambda own: own["gaussian_names"].isna(),
        CaveatKind.GIVEN_AGAIN: lambda own: (
            digests[own.index].notna() & digests[own.index].duplicated()
        ),
        CaveatKind.UNEXPECTED: lambda own: unexpected[own.index] & (not include_misfits),
    }
    relied = rows
    caveats = []
    for kind, rule in left_out.items():
        if (which := rule(relied)).any():
            caveats.append(
                Caveat(
                    kind,
                    tuple(labels(relied[which])),
                    text=(since or "") * (kind is CaveatKind.BEFORE),
                )
            )
            relied = relied[~which]
    if relied.empty:
        said = " ".join(map(caveat_words, caveats))
        raise InputError(
            f"campaigns must be left to rely on, got none of {len(rows)}. {said} Mend these, or"
            " exclude fewer."
        )
    minded = {
        CaveatKind.NOT_CONVERGED: rows["converged"].eq(False),
        CaveatKind.NOT_WHITE: not_white & ~unexpected,
    }
    for kind, which in minded.items():
        if (here := which[relied.index]).any():
            caveats.append(Caveat(kind, tuple(labels(relied[here]))))
    return relied, caveats


def labels(rows: pd.DataFrame) -> list[str]:
    """Return what campaigns are called: by name, those whose name others have too by path."""
    paths = rows["campaign"].astype(str)
    names = rows["name"].where(rows["name"].map(lambda own: isinstance(own, str)), paths)
    return [
        str(path if same else name)
        for name, path, same in zip(names, paths, names.duplicated(keep=False), strict=True)
    ]


def _named(rows: pd.DataFrame, exclude: Sequence[str], among: pd.DataFrame) -> pd.Series[bool]:
    """Whether campaigns, or their machines, are among the names."""
    names, known = (
        own[["name", "machine_id"]].assign(
            path=paths, last=paths.map(lambda path: os.path.basename(path.rstrip("/")))
        )
        for own, paths in ((each, each["campaign"].astype(str)) for each in (rows, among))
    )
    wanted = [exclude] if isinstance(exclude, str) else list(exclude)
    for name in wanted:
        if not known.isin([name]).any(axis=None):
            every = sorted(
                {
                    own
                    for own in known.drop(columns="path").to_numpy().ravel()
                    if isinstance(own, str)
                }
            )
            cure = f"Did you mean {nearest(str(name), every)!r}?"
            raise InputError(
                f"what is left out must be a campaign or machine of the batch, got {name!r}. {cure}"
            )
    return names.isin(wanted).any(axis=1)


def _before(rows: pd.DataFrame, since: str | None) -> pd.Series[bool]:
    try:
        least = moment(since or "0001-01-01")
    except ValueError:
        raise InputError(
            f"since must be a date or time in ISO 8601, got {since!r}. For example 2026-03-01."
        ) from None

    def earlier(date: Any) -> bool:
        if since is None:
            return False
        try:
            return not isinstance(date, str) or moment(date) < least
        except ValueError:  # of campaigns that failed
            return True

    return rows["date"].map(earlier).astype(bool)


def moment(date: str) -> datetime:
    """Return a date or time in ISO 8601 as one in UTC, without a time zone taken as such; else a
    ValueError."""
    found = datetime.fromisoformat(date)
    return found.replace(tzinfo=UTC) if found.tzinfo is None else found.astimezone(UTC)
