"""Writing and reading the table of a batch: a Parquet file with a row for every campaign.

A CSV file beside it has the same rows for programs that do not read Parquet, such as spreadsheets.
"""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import pandas as pd

from ldbb_bayes.errors import InputError, check_known, quoted_reason

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = [
    "COLUMN_TYPES",
    "DATASET",
    "FLEET_COLUMNS",
    "JOURNAL",
    "PARAMETER_COLUMNS",
    "PART",
    "READINGS_DIGESTS",
    "SPREADSHEET",
    "SPREADSHEET_PART",
    "STATISTICS_TYPES",
    "STIFFNESS_NAME",
    "check_pyarrow",
    "read_batch",
    "read_fleet",
    "write_dataset",
    "write_spreadsheet",
]

# Names of files in the folder of a batch. ``JOURNAL`` names the journal, a database of the rows
# computed so far. ``DATASET`` names the finished table, and ``PART`` names the table while it is
# being written. ``SPREADSHEET`` and ``SPREADSHEET_PART`` name the same of the table as CSV.
JOURNAL = "batch.sqlite"
DATASET = "campaigns.parquet"
PART = f".{DATASET}.part"
SPREADSHEET = "campaigns.csv"
SPREADSHEET_PART = f".{SPREADSHEET}.part"
# ``_SCHEMA`` is the version of the layout of a batch's table. The metadata of the Parquet file hold
# this version under the key ``_METADATA_KEY``.
_SCHEMA = 4
_METADATA_KEY = b"ldbb_bayes"
# Results that a batch's table holds for every parameter: posterior mean, standard deviation,
# median, and the two ends of the credible interval. Each has a separate column, such as C_XXX.mean.
PARAMETER_COLUMNS = ("mean", "sd", "median", "ci_low", "ci_high")
# Pattern of the names of stiffness quantities in a batch's table. For each plane, the quantities
# are the least and the greatest stiffness, their ratio, the directions of least and of greatest
# stiffness, the principal axis, and the difference between the direct compliances of the two axes
# of the plane. If there are several planes, names end with the plane, as in k_min_YZ. If a machine
# was tested in three planes, there are also its principal stiffnesses k_1, k_2 and k_3.
STIFFNESS_NAME = re.compile(
    r"(k_min|k_max|k_ratio|softest_direction|stiffest_direction|principal_axis|C_..._minus_C_...)"
    r"(_[XYZ]{2})?|k_[123]"
)
# Arrow types of the values that a batch's table holds for every quantity with a tolerance; the keys
# are the names of the values. Each value has a separate column, such as C_XXX.decision.
_CONFORMITY_TYPES = {"probability": "double", "decision": "string"}
# Number of rows in one row group of the Parquet file with a batch's table. The rows of a group are
# written together.
_ROWS_PER_GROUP = 1024
# Contents of columns.toml: the names of the columns of a batch's table, and the Arrow types of the
# columns.
_TABLE: Mapping[str, Any] = tomllib.loads(
    Path(__file__).with_name("columns.toml").read_text(encoding="utf-8")
)
# Arrow types of the first columns of a batch's table; the keys are the names of the columns. These
# columns describe a campaign and its fit.
COLUMN_TYPES: Mapping[str, str] = _TABLE["columns"]
# Arrow types of the last columns of a batch's table; the keys are the names of the columns. These
# columns hold a campaign's sufficient statistics: posterior moments and prior moments.
STATISTICS_TYPES: Mapping[str, str] = _TABLE["gaussian"]
# Names of the columns of a batch's table that the analyses of many campaigns (trend of one machine,
# population of machines) need.
FLEET_COLUMNS: tuple[str, ...] = tuple(_TABLE["fleet"])
# Names of the two columns with digests of a campaign's readings: together with the conditions, and
# alone. Rows of earlier versions lack the second one.
READINGS_DIGESTS = ("sha256", "circles_sha256")
# Pattern of the names of columns, or of the quantities to which they belong, that the analyses of
# many campaigns use if a batch has them.
_FURTHER_NAME = re.compile(rf"circles|prob|{READINGS_DIGESTS[1]}|{STIFFNESS_NAME.pattern}")


def check_pyarrow() -> None:
    """Raise an `InputError` if pyarrow, the library that reads and writes tables, is missing."""
    try:
        import pyarrow.parquet  # noqa: F401 - import it to see if it is installed
    except ImportError:
        raise InputError(
            "pyarrow must be installed for batches, got none. Run pip install 'ldbb-bayes[fleet]'."
        ) from None


def write_dataset(
    rows: Callable[[], Iterator[dict[str, Any]]], target: Path, about: Mapping[str, Any]
) -> None:
    """Write the table of a batch, completely or not at all.

    Parameters
    ----------
    rows : function that returns, on each call, a new iterator over all rows; `fit_row` describes
        the content of a row.
    target : Parquet file to write.
    about : information on the batch for the metadata of the file.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    import pyarrow as pa  # The library pyarrow need not be installed, so import it only here.
    import pyarrow.parquet as pq

    schema = _schema(rows(), about)
    flat_rows = map(_one_value_per_column, rows())
    unfinished = target.with_name(PART)
    try:
        with pq.ParquetWriter(
            unfinished, schema, compression="zstd", write_page_checksum=True
        ) as writer:
            for group in _groups_of_rows(flat_rows, _ROWS_PER_GROUP):
                writer.write_table(pa.Table.from_pylist(group, schema=schema))
        os.replace(unfinished, target)
    except (OSError, pa.ArrowException) as error:
        raise _not_writable(target, error) from None
    finally:
        unfinished.unlink(missing_ok=True)


def write_spreadsheet(dataset: Path, target: Path) -> None:
    """Write the table of a batch as CSV, completely or not at all.

    The columns are those of `read_batch`, except the sufficient statistics. Where a column holds
    several texts, such as warnings, they are joined by "; ".

    Parameters
    ----------
    dataset : Parquet file with the table, see `write_dataset`.
    target : CSV file to write, in UTF-8.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    import pyarrow.parquet as pq  # The library pyarrow need not be installed.

    columns_of_texts = [name for name, kind in COLUMN_TYPES.items() if kind == "list<string>"]
    unfinished = target.with_name(SPREADSHEET_PART)
    try:
        with (
            pq.ParquetFile(dataset) as file,
            unfinished.open("w", encoding="utf-8", newline="") as stream,
        ):
            columns = [name for name in file.schema_arrow.names if name not in STATISTICS_TYPES]
            for group in range(file.num_row_groups):
                table = file.read_row_group(group, columns)
                # A whole number stays one where other rows have none ("6", not "6.0").
                rows = table.to_pandas(integer_object_nulls=True)
                rows[columns_of_texts] = rows[columns_of_texts].map("; ".join, na_action="ignore")
                rows.to_csv(stream, index=False, header=group == 0, lineterminator="\n")
        os.replace(unfinished, target)
    except OSError as error:
        raise _not_writable(target, error) from None
    finally:
        unfinished.unlink(missing_ok=True)


def _not_writable(target: Path, error: Exception) -> InputError:
    """Return the error that a table of a batch cannot be written to the file ``target``."""
    reason = " ".join(str(error).split())
    return InputError(
        f"{target} must be writable, got: {reason}. The rows are kept: free some space, then"
        " --resume."
    )


def _schema(rows: Iterable[Mapping[str, Any]], about: Mapping[str, Any]) -> pa.Schema:
    """Return the Arrow schema of a batch's table, which states the columns and the metadata.

    Each column has a name, a type and, in some cases, a unit. A parameter, a stiffness by direction
    or a quantity with a tolerance has columns if it occurs in at least one of the rows ``rows``.
    ``about`` is information on the batch, which becomes part of the metadata.
    """
    import pyarrow as pa  # The library pyarrow need not be installed, so import it only here.

    unit_by_parameter: dict[str, str] = {}
    quantities: dict[str, None] = {}
    for row in rows:
        quantities |= dict.fromkeys(row.get("conformity", {}))
        for name, numbers in _numbers_by_quantity(row).items():
            unit_by_parameter.setdefault(name, numbers["unit"])
    fields = [_arrow_field(name, kind, _unit_in(name)) for name, kind in COLUMN_TYPES.items()]
    for name, unit in unit_by_parameter.items():
        fields += [_arrow_field(f"{name}.{column}", "double", unit) for column in PARAMETER_COLUMNS]
    for name in quantities:
        for column, kind in _CONFORMITY_TYPES.items():
            fields.append(_arrow_field(f"{name}.{column}", kind))
    fields += [_arrow_field(name, kind) for name, kind in STATISTICS_TYPES.items()]
    metadata = json.dumps({"schema": _SCHEMA, **about}, ensure_ascii=False, sort_keys=True)
    return pa.schema(fields, metadata={_METADATA_KEY: metadata.encode()})


def _arrow_field(name: str, kind: str, unit: str = "") -> pa.Field:
    """Return a column of a Parquet table: its name, Arrow type and unit.

    ``kind`` is the name of the type, such as ``double`` or ``list<double>``. The unit is stored in
    the metadata of the column; an empty unit is not stored.
    """
    import pyarrow as pa  # The library pyarrow need not be installed, so import it only here.

    element = kind.removeprefix("list<").removesuffix(">")
    arrow_type = pa.type_for_alias(element)
    if element != kind:
        arrow_type = pa.list_(arrow_type)
    metadata = {"unit": unit} if unit else None
    return pa.field(name, arrow_type, metadata=metadata)


def _unit_in(column: str) -> str:
    """Return the unit N or um at the end of a column's name, or an empty string if there is none.

    The column ``force_min_N``, for example, has the unit N.
    """
    unit = column.rpartition("_")[2]
    return unit if column.endswith(("_N", "_um")) else ""


def _one_value_per_column(row: dict[str, Any]) -> dict[str, Any]:
    """Return the row of a campaign without nested dictionaries: every value has its own column.

    In the given row, the entries ``parameters`` and ``stiffness`` hold the mean, sd, median and
    credible interval of each parameter and of each stiffness by direction. The entry ``conformity``
    holds the probability of conformity and the decision for each quantity with a tolerance. In the
    result, the columns of these values have names such as C_XXX.mean and C_XXX.decision.
    """
    flat = dict(row)
    for name, numbers in _numbers_by_quantity(row).items():
        for column in PARAMETER_COLUMNS:
            flat[f"{name}.{column}"] = numbers[column]
    for name, decision in row.get("conformity", {}).items():
        for column in _CONFORMITY_TYPES:
            flat[f"{name}.{column}"] = decision[column]
    return flat


def _numbers_by_quantity(row: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return the unit, mean, sd, median and credible interval of each parameter and stiffness.

    ``row`` is one row of a batch, which holds the results of one campaign. The result is a
    dictionary; its keys are the names of the parameters and of the stiffnesses by direction.
    """
    return {**row.get("parameters", {}), **row.get("stiffness", {})}


def _groups_of_rows(rows: Iterator[dict[str, Any]], size: int) -> Iterator[list[dict[str, Any]]]:
    """Yield the rows of a batch's table in order, in lists of at most ``size`` rows."""
    group = list(islice(rows, size))
    while group:
        yield group
        group = list(islice(rows, size))


def read_batch(
    path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    columns: Sequence[str] | None = None,
) -> pd.DataFrame:
    """Return the rows of one batch or of several batches as one table.

    A batch is a set of campaigns that `run_batch` has fitted; each campaign has one row. The
    columns are:

    - ``campaign``, ``name``, ``sha256``, ``circles_sha256``, ``machine_id``, ``date``: which
      campaign this is. ``sha256`` is the digest of the readings and their conditions, and
      ``circles_sha256`` that of the readings alone.
    - ``status``: "done" or "failed". ``reason``: why the fit failed.
    - ``topology``, ``planes``, ``tests``, ``readings``, ``force_min_N``, ``force_max_N``,
      ``reference_force_N``: the machine and its tests. ``tests`` is the number of tests, and
      ``readings`` the number of readings. ``circles``: JSON text with plane, radius, centre and
      direction of each kind of circle.
    - ``compliances``: JSON text that states the weighted sum of joint compliances for each fitted
      compliance. ``tolerances``: JSON text with the tolerances.
    - ``degree``, ``terms``, ``model_sha256``, ``sampler``, ``seed``, ``versions``: the model, the
      sampler and the versions of the software. ``prob``: probability of the credible intervals.
    - ``converged``: whether the sampler reached its target. ``state``: how far the fit can be
      trusted. ``verdict``: a sentence on the fit. ``warnings``, ``misfits``: the texts of the
      warnings, and of the misfits (disagreements between readings and model). ``kinds``: the kind
      of each warning and misfit; "copy" if a test was read twice, and "sign of one test" if the
      readings of a test have the other sign.
    - ``log_prob_truncation``: log probability that no compliance is negative [nat].
    - ``rmse_um``: root mean square of the residuals [µm].
    - ``log_bayes_factor``, ``log_bayes_factor_error``: log Bayes factor of linear over constant
      compliance, and its numerical error [nat].
    - ``NAME.mean``, ``NAME.sd``, ``NAME.median``, ``NAME.ci_low``, ``NAME.ci_high``: five columns
      for each parameter, hyper-parameter (scale of the noise or of another effect) and stiffness
      quantity. Internal units (mm, N, rad) are used; ``attrs["units"]`` states them. The stiffness
      quantities belong to the reference force: ``k_min``, ``k_max``, their ratio ``k_ratio``, the
      directions ``softest_direction``, ``stiffest_direction`` and ``principal_axis`` [deg], and the
      difference ``C_XXX_minus_C_YYY``. With several planes, the name of the plane is added, as in
      ``k_min_YZ``. With three planes there are also ``k_1``, ``k_2`` and ``k_3``; see `stiffness`.
    - ``NAME.probability``, ``NAME.decision``: probability of conformity and decision, for each
      quantity with a tolerance.
    - ``gaussian_…``: posterior and prior moments of parameters, instrument errors and coefficients
      of `JointLoad` and `Position`, which `find_trend` and `fit_population` use. The posterior
      moments are computed without the condition that no compliance is negative. One column holds
      the covariance matrix, as a list of the elements of its lower triangle, row by row.

    Parameters
    ----------
    path : path, or sequence of path
        Folder of a batch, its file campaigns.parquet, or a sequence of such folders and files.
    columns : sequence of str, optional
        Names of the columns to read, in this order. Default: all.

    Returns
    -------
    DataFrame
        One row per campaign, in the order of the batch. If a campaign does not have a value, the
        value is missing (NaN or None).

    Raises
    ------
    InputError
        If a file is missing, unfinished, damaged or not the table of a batch; if a column is
        unknown; or if pyarrow is not installed.

    Examples
    --------
    >>> fast = lb.HybridModel.first(0)
    >>> simulated = fast.simulate(campaign, seed=1).campaign
    >>> folder = lb.write_campaign(simulated, "campaigns/machine_1")
    >>> batch = lb.fleet.run_batch(["campaigns"], "fitted", model=fast, compare=False)
    >>> rows = lb.fleet.read_batch("fitted", ["campaign", "status", "tests"])
    >>> rows.to_dict("records")
    [{'campaign': 'campaigns/machine_1', 'status': 'done', 'tests': 6}]
    """
    return _read(path, columns, None)


def read_fleet(
    path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
) -> pd.DataFrame:
    """Return the columns of batches that the analysis of a trend or of a population needs.

    The columns are those named in `FLEET_COLUMNS` and, if the batches contain them, the digest of
    the readings alone, the probability of the intervals and the columns of the stiffnesses by
    direction. There is one row for each campaign. ``path`` has the same meaning as in `read_batch`,
    and the same errors are raised.
    """
    return _read(path, FLEET_COLUMNS, _FURTHER_NAME)


def _read(
    path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    columns: Sequence[str] | None,
    further: re.Pattern[str] | None,
) -> pd.DataFrame:
    """Return requested columns of the tables of one or several batches, as one table.

    ``path`` names the batches, as in `read_batch`. ``columns`` are the names of the requested
    columns; None requests all columns. Columns that match the pattern ``further``, and the columns
    of quantities that match it, are returned, too.
    """
    check_pyarrow()
    import pyarrow as pa  # The library pyarrow need not be installed, so import it only here.

    paths = [path] if isinstance(path, str | os.PathLike) else list(path)
    if not paths:
        raise InputError("batches must be given, got none. Name the --out folder of a batch.")
    datasets = [_read_table(_dataset_of(Path(entry)), columns, further) for entry in paths]
    table = pa.concat_tables([dataset.table for dataset in datasets], promote_options="default")
    if columns is not None:
        known_columns: dict[str, None] = {}
        for dataset in datasets:
            known_columns |= dict.fromkeys(dataset.schema.names)
        check_known("column", columns, known_columns)
        others = [name for name in table.column_names if name not in columns]
        table = table.select([*dict.fromkeys(columns), *others])
    rows: pd.DataFrame = table.to_pandas()
    rows.attrs["units"] = _parameter_units(table.schema)
    return rows


def _parameter_units(schema: pa.Schema) -> dict[str, str]:
    """Return the units of parameters and stiffnesses that the schema of a batch's table states.

    The result is a dictionary; its keys are the names of the parameters and stiffnesses. The unit
    of the parameter C_XXX, for example, is stored with the column C_XXX.mean.
    """
    units: dict[str, str] = {}
    for field in schema:
        parameter, _, column = field.name.rpartition(".")
        if column == "mean" and parameter and field.metadata and b"unit" in field.metadata:
            units[parameter] = field.metadata[b"unit"].decode()
    return units


def _dataset_of(path: Path) -> Path:
    """Return the file path of a batch's table; ``path`` is the batch's folder or the table itself.

    Raise an `InputError` if there is no table.
    """
    if (path / DATASET).is_file():
        return path / DATASET
    if (path / JOURNAL).is_file():
        raise InputError(
            f"{path} must be a finished batch, got one that stopped before. Go on with it"
            " (--resume), then read it."
        )
    if path.is_file():
        return path
    expected = f"must be the --out folder of a batch, or its {DATASET}"
    if path.is_dir():
        raise InputError(
            f"{path} {expected}, got a folder without one. Make one of your campaigns with"
            " ldbb-bayes batch CAMPAIGN … --out DIR, or check the path."
        )
    raise InputError(f"{path} {expected}, found none. Check the path.")


def _columns_that_match(schema: pa.Schema, names: re.Pattern[str]) -> list[str]:
    """Return the names of all columns that match a pattern, or whose quantity matches it.

    The column k_min.mean, for example, belongs to the quantity k_min. ``names`` is the pattern.
    ``schema`` lists the columns of the table of a batch.
    """
    columns = []
    for column in schema.names:
        quantity, _, _ = column.rpartition(".")
        if names.fullmatch(quantity or column):
            columns.append(column)
    return columns


class _Dataset(NamedTuple):
    """Requested columns of the table of a batch, and the schema of all columns of the table."""

    table: pa.Table  #: requested columns of the table of a batch
    schema: pa.Schema  #: names, types and units of all columns of the table of a batch


def _read_table(
    path: Path, columns: Sequence[str] | None, further: re.Pattern[str] | None
) -> _Dataset:
    """Return the requested columns of a batch's table, and the schema of all columns of the table.

    Raise an `InputError` if the file is not the table of a batch. ``columns`` are the names of the
    requested columns; None requests all columns. Columns that the table does not have are left out.
    Columns that match the pattern ``further``, and the columns of quantities that match it, are
    requested, too.
    """
    import pyarrow as pa  # The library pyarrow need not be installed, so import it only here.
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            schema = file.schema_arrow
            if columns is not None and further is not None:
                columns = [*columns, *_columns_that_match(schema, further)]
            table = file.read(columns)
            table.validate(full=True)
    except (pa.ArrowException, OSError, ValueError) as error:
        reason = quoted_reason(error)
        if (path.parent / JOURNAL).is_file():
            raise InputError(
                f"{path} must be the table of a batch, got a damaged file ({reason}). Remove it and"
                " run the batch with --resume, which writes it anew."
            ) from None
        raise InputError(
            f"{path} must be the table of a batch, got another, or a damaged file ({reason}). Give"
            " a batch's --out folder."
        ) from None
    metadata = schema.metadata or {}
    about = json.loads(metadata.get(_METADATA_KEY, "{}"))
    if about.get("schema") != _SCHEMA:
        content = f"schema {about['schema']}" if about else "a Parquet file of something else"
        raise InputError(
            f"{path} must be a batch's table of schema {_SCHEMA}, got {content}. Give the --out"
            " folder of a batch."
        )
    return _Dataset(table, schema)
