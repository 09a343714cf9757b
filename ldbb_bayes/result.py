"""What analyses return: findings as frozen dataclasses, which go to JSON and back, and which the report's words show."""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

import numpy as np
import pandas as pd
from pydantic import BeforeValidator, ConfigDict, PlainSerializer, TypeAdapter, ValidationError

from ldbb_bayes.errors import InputError

__all__ = ["ByRow", "Finite", "Number", "Numbers", "Records", "Result", "read_result"]

T = TypeVar("T")
_LARGEST_BYTES = 200_000_000


def _null(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _infinite(value: Any) -> Any:
    return np.inf if value is None else value


Finite = Annotated[float, BeforeValidator(_infinite), PlainSerializer(_null)]
"""A number that may be infinite, which JSON writes as null."""

Number = Annotated[float, BeforeValidator(lambda value: np.nan if value is None else value), PlainSerializer(_null)]
"""A number that may be missing, not a number then, which JSON writes as null."""

Numbers = Annotated[np.ndarray, BeforeValidator(np.asarray), PlainSerializer(lambda array: array.tolist())]
"""An array, in JSON nested lists."""

ByRow = Annotated[
    pd.DataFrame,
    BeforeValidator(lambda rows: rows if isinstance(rows, pd.DataFrame) else pd.DataFrame.from_dict(rows, orient="index")),
    PlainSerializer(lambda frame: frame.to_dict(orient="index")),
]
"""A table, in JSON its rows by name."""

Records = Annotated[
    pd.DataFrame,
    BeforeValidator(lambda rows: rows if isinstance(rows, pd.DataFrame) else pd.DataFrame.from_records(rows)),
    PlainSerializer(lambda frame: frame.astype(object).where(frame.notna(), None).to_dict(orient="records")),
]
"""A table, in JSON a list of its rows, null where a cell is missing."""


class Result:
    """Base of the frozen dataclasses that analyses return.

    Numbers, names and enums only: `ldbb_bayes.report.wording` writes the sentences, and nothing decides by reading them.
    """

    __pydantic_config__ = ConfigDict(arbitrary_types_allowed=True)

    def as_dict(self) -> dict[str, Any]:
        """The findings for JSON, in inside units (mm, N, rad)."""
        found: dict[str, Any] = _adapter(type(self)).dump_python(self, mode="json", by_alias=True)
        return found

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """The findings that `as_dict` wrote; keys that are no findings (sentences, provenance) are passed over.

        Raises
        ------
        pydantic.ValidationError
        """
        result: Self = _adapter(cls).validate_python(values)
        return result

    def __str__(self) -> str:
        return str(import_module("ldbb_bayes.report.text").text_of(self))

    def _repr_html_(self) -> str:
        return str(import_module("ldbb_bayes.report.text").html_of(self))


def read_result(path: Path, what: str, command: str, read: Callable[[dict[str, Any]], T]) -> T:
    """Return what a command wrote into a folder, or into the file itself.

    Parameters
    ----------
    path : Path
    what : str
        Stem of the file, and what it holds: ``comparison``.
    command : str
        That writes it: ``compare``.
    read : callable
        Takes the JSON to the result.

    Raises
    ------
    InputError
        When the file is missing, damaged, or not one of ours.
    """
    source = path / f"{what}.json" if path.is_dir() else path
    if not source.is_file():
        raise InputError(
            f"{what} must be a folder with {what}.json or such a file, got {path}. Give the --out folder of a {command}."
        )
    try:
        if source.stat().st_size > _LARGEST_BYTES:
            raise ValueError("larger than 200 MB")
        return read(json.loads(source.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, StopIteration, RecursionError) as error:
        why = str(error)
        if isinstance(error, ValidationError):
            first = error.errors()[0]
            why = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
        raise InputError(
            f"{source} must be a {what} written by this version of ldbb-bayes {command}, got a damaged one "
            f"({type(error).__name__}: {why}). Run {command} again."
        ) from None


_ADAPTERS: dict[type, TypeAdapter[Any]] = {}


def _adapter(kind: type) -> TypeAdapter[Any]:
    if kind not in _ADAPTERS:
        _ADAPTERS[kind] = TypeAdapter(kind)
    return _ADAPTERS[kind]
