"""Tables of readings: a CSV into checked columns of numbers, and one tidy table with a column mapping into a campaign."""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.errors import InputError, nearest
from ldbb_bayes.files import LARGEST_TABLE_BYTES, bytes_of

__all__ = ["PER_TEST", "TIDY_COLUMNS", "read_columns", "read_tidy", "readings_of"]

Array = NDArray[np.float64]

LARGEST_LINE, LARGEST_COLUMNS, LARGEST_CELLS = 100_000, 1000, 4_000_000
READING_COLUMNS = ("angle_deg", "angle_rad", "reading_um", "reading_mm")
# Columns that hold one value for each test, by their exact names.
PER_TEST = (
    "work_ball_deg",
    "tool_ball_deg",
    "radius_mm",
    "centre_x_mm",
    "centre_y_mm",
    "centre_z_mm",
    "setup",
    "plane",
    "temperature_C",
    "time_s",
)
PER_TEST_COLUMNS = ("force_N", "pressure_bar", "direction", *PER_TEST)
TIDY_COLUMNS = ("test", *READING_COLUMNS, *PER_TEST_COLUMNS)
_TEXT_COLUMNS = ("test", "direction", "plane")


def read_columns(path: Path, known: Sequence[str], mapping: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Read a CSV with one header line into columns.

    Comma, semicolon or tab separate; with the latter two, and no decimal point anywhere, decimal commas are understood. A
    byte-order mark is dropped.

    Parameters
    ----------
    known : sequence of str
        The columns that may occur; others are refused.
    mapping : mapping, optional
        The file's column name → ours.

    Returns
    -------
    dict of column name to ndarray, shape (rows,): float, or str for ``test`` and ``direction``

    Raises
    ------
    InputError
        Naming the file and, where there is one, the line.
    """
    text = _text(path)
    header = text.split("\n", 1)[0]
    separator = max(",;\t", key=header.count)
    frame = _frame(path, text, separator)
    named = text.split("\n", 1)[0].split(separator)
    names = [str(name).strip() if not str(name).startswith("Unnamed: ") or str(name) in named else "" for name in frame.columns]
    names = [(mapping or {}).get(name, name) for name in names]
    for name in names:
        if name not in known:
            raise InputError(
                f"{path}, line 1: columns must be among {', '.join(known)}, got {name[:60]!r}. "
                f"Did you mean {nearest(name[:60], known)!r}? Rename or remove the column, "
                "or let ldbb-bayes import read the file."
            )
    repeated = next((name for name in names if names.count(name) > 1), None)
    if repeated:
        raise InputError(f"{path}, line 1: columns must differ, got {repeated!r} twice. Remove one.")
    frame.columns = pd.Index(names)
    frame = frame[~(frame == "").all(axis=1)]
    if frame.empty:
        raise InputError(f"{path} must hold readings below its header, got none. Fill the file or remove the test.")
    numeric = frame[[name for name in names if name not in _TEXT_COLUMNS]].fillna("")
    decimal_comma = separator != "," and not numeric.apply(lambda cells: cells.str.contains(".", regex=False)).to_numpy().any()
    return {name: _column(path, frame[name], name, decimal_comma) for name in names}


def readings_of(path: Path, columns: Mapping[str, Any]) -> dict[str, Array]:
    """The angle and reading columns, with the checks that catch a wrong unit.

    Raises
    ------
    InputError
        When one of them is missing or given twice, or the angle's span contradicts its unit.
    """
    found: dict[str, Array] = {}
    for pair in (READING_COLUMNS[:2], READING_COLUMNS[2:]):
        present = [name for name in pair if name in columns]
        if len(present) != 1:
            got = "both" if present else "neither"
            raise InputError(f"{path}, line 1: columns must hold {pair[0]} or {pair[1]}, got {got}. Correct the header.")
        found[present[0]] = np.asarray(columns[present[0]], dtype=float)
    if "angle_deg" in found and np.ptp(found["angle_deg"]) < 7.0:
        raise InputError(
            f"{path}: angle_deg must span more than 7°, got {np.ptp(found['angle_deg']):.3g}°. "
            "If the angles are radians, name the column angle_rad."
        )
    if "angle_rad" in found and np.ptp(found["angle_rad"]) > 4 * 2 * np.pi:
        raise InputError(
            f"{path}: angle_rad must span at most 4 turns, got {np.ptp(found['angle_rad']):.4g} rad. "
            "If the angles are degrees, name the column angle_deg."
        )
    return found


def read_tidy(path: Path, *, mapping: Mapping[str, str] | None = None, **campaign: Any) -> Campaign:
    """A campaign from one tidy CSV: columns test, force_N (or pressure_bar), angle_deg, reading_um, optionally others.

    Parameters
    ----------
    mapping : mapping, optional
        The file's column name → ours.
    **campaign
        What campaign.toml would say: fields of `Campaign`.

    Raises
    ------
    InputError
        For bad columns or cells, or a test whose force or clocking changes from row to row.
    """
    columns = read_columns(path, TIDY_COLUMNS, mapping)
    if "test" not in columns:
        raise InputError(f"{path}, line 1: columns must hold 'test', got none. Name the test each row belongs to.")
    readings = readings_of(path, columns)
    label = np.asarray(columns["test"])
    tests = []
    for name in dict.fromkeys(label.tolist()):
        rows = label == name
        fields = {key: _constant(path, name, key, columns[key][rows]) for key in PER_TEST_COLUMNS if key in columns}
        try:
            tests.append(CircularTest(name=str(name), **{key: value[rows] for key, value in readings.items()}, **fields))
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
    campaign.setdefault("name", path.stem)
    try:
        return Campaign(tuple(tests), **campaign)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _text(path: Path) -> str:
    raw = bytes_of(path, LARGEST_TABLE_BYTES, what="a file")
    if not raw.strip():
        raise InputError(f"{path} must hold a table, got an empty file. Fill it or remove the test.")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "" if b"\0" not in raw else "\0"
    if not text:
        raise InputError(
            f"{path} must be UTF-8 text, got another encoding. Save it as 'CSV UTF-8', or let ldbb-bayes import read it."
        )
    if "\0" in text:
        raise InputError(f"{path} must be UTF-8 text, got binary data. Save it as 'CSV UTF-8', or let ldbb-bayes import read it.")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    _check_shape(path, text)
    return text


def _check_shape(path: Path, text: str) -> None:
    """Neither a line nor a table beyond what readings can be."""
    separators = max(map(text.count, ",;\t"))
    if text.count("\n") + separators > LARGEST_CELLS:
        raise InputError(f"{path} must hold at most {LARGEST_CELLS} cells, got more. Split it.")
    long = next((k for k, line in enumerate(text.split("\n"), start=1) if len(line) > LARGEST_LINE), None)
    if long is not None:
        raise InputError(f"{path}, line {long}: a line must hold at most {LARGEST_LINE} signs, got more. Export it again.")
    columns = 1 + max(map(text.partition("\n")[0].count, ",;\t"))
    if columns > LARGEST_COLUMNS:
        raise InputError(f"{path}, line 1: a table must have at most {LARGEST_COLUMNS} columns, got {columns}. Export it again.")


def _frame(path: Path, text: str, separator: str) -> pd.DataFrame:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            return pd.read_csv(
                io.StringIO(text), sep=separator, dtype=str, keep_default_na=False, index_col=False, skip_blank_lines=False
            )
    except pd.errors.ParserWarning:
        raise InputError(
            f"{path}, line 1: the header must name every column, got fewer names than cells. "
            "Complete it; with decimal commas separate the cells by semicolons."
        ) from None
    except (pd.errors.ParserError, pd.errors.EmptyDataError) as error:
        said = " ".join(str(error).split()).rstrip(".")
        raise InputError(f"{path} must be a table with one header line, got: {said}. Check the line it names.") from None


def _column(path: Path, cells: pd.Series[str], name: str, decimal_comma: bool) -> Any:
    cells = cells.fillna("").str.strip()
    if name in _TEXT_COLUMNS:
        return cells.to_numpy(dtype=object)
    if decimal_comma:
        cells = cells.str.replace(",", ".", regex=False)
    try:
        values = cells.to_numpy(dtype=object).astype(float)
    except ValueError:
        values = np.array([_number(cell) for cell in cells])
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        line, cell = int(cells.index[bad[0]]) + 2, cells.iloc[bad[0]]
        raise InputError(f"{path}, line {line}: {name} must be a finite number, got {cell[:60]!r}. Correct or remove the line.")
    return values


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")


def _constant(path: Path, test: str, key: str, values: Array) -> Any:
    if len(set(values.tolist())) > 1:
        raise InputError(
            f"{path}: {key} must be the same in all rows of a test, got {values.min()} to {values.max()} in {test!r}. "
            "Split the test or correct the rows."
        )
    value = values.tolist()[0]
    return (value or None) if key in _TEXT_COLUMNS else value
