"""Base classes of results, which can be written as JSON, read back and displayed."""

from __future__ import annotations

import html
import json
import os
from collections.abc import Callable, Iterable, Mapping, Set
from dataclasses import fields, is_dataclass
from functools import singledispatch
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self, TypeAlias, TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    PlainSerializer,
    TypeAdapter,
    ValidationError,
)
from pydantic_core import to_json

from ldbb_bayes.errors import InputError, require
from ldbb_bayes.files import bytes_of
from ldbb_bayes.tables import Table, readable, table_of, terminal_width, wrapped
from ldbb_bayes.units import inside_name, typeset

__all__ = [
    "LONGEST_REPR",
    "Array",
    "ByName",
    "ByParameter",
    "ByRow",
    "EitherSpelling",
    "Finite",
    "Number",
    "Numbers",
    "Passage",
    "Records",
    "Result",
    "Shown",
    "Table",
    "brief",
    "entries_of",
    "html_of",
    "json_text",
    "lines_of",
    "parts_of",
    "read_result",
    "readable",
    "register_when_displayed",
    "registered_function",
    "screen_of",
    "table_of",
    "text_of",
    "wrapped",
]

T = TypeVar("T")
# Type of a NumPy array with elements of any kind.
Array: TypeAlias = NDArray[Any]
# Largest size of a result's JSON file that is read [bytes].
_LARGEST_BYTES = 200_000_000
# Largest length of the one-line text (``repr``) of an object [characters].
LONGEST_REPR = 80
# Largest length of the text for the value of one attribute, within the one-line text of an object
# [characters].
_LONGEST_VALUE = 56
# Largest number of entries of a list, tuple, set or dictionary that one-line texts show. If there
# are more entries, the text states only their number.
_MOST_ENTRIES = 12


def _null_unless_finite(value: float) -> float | None:
    """Return a result's number as JSON can store it: None for NaN and infinite numbers."""
    return float(value) if np.isfinite(value) else None


def _infinite_if_null(value: float | None) -> float:
    """Return a result's number that was read from JSON. The value null (None) becomes infinity."""
    return np.inf if value is None else value


def _nan_if_null(value: float | None) -> float:
    """Return a result's number that was read from JSON. The value null (None) becomes NaN."""
    return np.nan if value is None else value


def _to_list(array: Array) -> Any:
    """Return the elements of a result's array as nested lists, for JSON."""
    return array.tolist()


def _to_frame(rows: Any) -> pd.DataFrame:
    """Return a table that was read from JSON as a data frame (table of pandas).

    ``rows`` holds the rows of the table. It is a list, or a dictionary whose keys are the names of
    the rows. If ``rows`` already is a data frame, it is returned unchanged.
    """
    if isinstance(rows, pd.DataFrame):
        return rows
    if isinstance(rows, dict):
        return pd.DataFrame.from_dict(rows, orient="index")
    return pd.DataFrame.from_records(rows)


def _to_rows_by_name(frame: pd.DataFrame) -> dict[Any, Any]:
    """Return a dictionary from the names of a data frame's rows to dictionaries of cells."""
    return frame.to_dict(orient="index")


def _to_records(frame: pd.DataFrame) -> list[dict[Any, Any]]:
    """Return the rows of a data frame as a list of dictionaries. Missing values become None."""
    with_nulls = frame.astype(object).where(frame.notna(), None)
    return with_nulls.to_dict(orient="records")


Finite = Annotated[float, BeforeValidator(_infinite_if_null), PlainSerializer(_null_unless_finite)]
"""Type of a field for a number that may be infinite; infinity is written as null in JSON."""

Number = Annotated[float, BeforeValidator(_nan_if_null), PlainSerializer(_null_unless_finite)]
"""Type of a field for a number that may be missing (NaN); NaN is written as null in JSON."""

Numbers = Annotated[np.ndarray, BeforeValidator(np.asarray), PlainSerializer(_to_list)]
"""Type of a field for an array, which is written as nested lists in JSON."""

if TYPE_CHECKING:
    ByRow: TypeAlias = pd.DataFrame
    Records: TypeAlias = pd.DataFrame
else:
    ByRow = Annotated[Any, BeforeValidator(_to_frame), PlainSerializer(_to_rows_by_name)]
    """Type of a field for a data frame, which is written as a dictionary of its rows in JSON."""

    Records = Annotated[Any, BeforeValidator(_to_frame), PlainSerializer(_to_records)]
    """Type of a field for a data frame, which is written as a list of its rows in JSON.

    A missing cell is written as null.
    """


def entries_of(source: Any) -> dict[str, Any]:
    """Return a dictionary with names and values of the displayed attributes of ``source``.

    The class of ``source`` lists the displayed attributes in ``shown``. If the class does not list
    any, and ``source`` is a dataclass or pydantic model, all its fields are displayed. If
    ``source`` is any other object, the result is empty.
    """
    kind = type(source)
    names = getattr(kind, "shown", ())
    if not names and is_dataclass(source):
        names = [field.name for field in fields(source)]
    elif not names:
        names = getattr(kind, "model_fields", ())
    return {name: getattr(source, name) for name in names}


def brief(value: Any, longest: int = _LONGEST_VALUE) -> str:
    """Return any value as one line of text with at most ``longest`` characters.

    For an array, a table or a long collection, the text states only the size. For an object, the
    text is the class name and the attributes that are not empty. If this text is too long,
    attributes with default values are left out first, then the last attributes.
    """
    kind = type(value).__name__
    if getattr(value, "shape", ()):
        return f"<{kind}, {' × '.join(map(str, value.shape))}>"
    if isinstance(value, Mapping | Set | tuple | list):
        return _brief_collection(value, longest)
    entries = entries_of(value)
    if entries or isinstance(value, Shown):
        return _brief_object(value, entries, longest)
    text = repr(value).replace("\n", " ")
    if isinstance(value, float):
        text = f"{value:.6g}"
    if len(text) > longest:
        return f"{text[: longest - 1]}…"
    return text


def _brief_collection(value: Any, longest: int) -> str:
    """Return a collection as one line of text: its entries (floats rounded), or only their number.

    Only the number is stated if there are many entries, if the entries include arrays, or if the
    text would have more than ``longest`` characters.
    """
    if len(value) <= _MOST_ENTRIES:
        text = repr(value)
        is_plain = type(value) in (tuple, list) and len(value) > 1
        if is_plain and all(type(entry) is float for entry in value):
            rounded = ", ".join(f"{entry:.6g}" for entry in value)
            text = f"{text[0]}{rounded}{text[-1]}"
        if len(text) <= longest and "array(" not in text:
            return text
    return f"<{len(value)} entries>"


def _brief_object(value: Any, entries: Mapping[str, Any], longest: int) -> str:
    """Return an object as one line of text: the class name, and ``name=value`` for each attribute.

    ``entries`` holds the names and values of the displayed attributes; empty values are left out.
    If the line is longer than ``longest`` characters, attributes that have their default values are
    left out too. If the line is still too long, the last attributes are left out.
    """
    kind = type(value)
    filled = {name: entry for name, entry in entries.items() if not _is_empty(entry)}
    assignments = [f"{name}={brief(entry)}" for name, entry in filled.items()]
    text = f"{kind.__name__}({', '.join(assignments)})"
    if len(text) > longest:
        assignments = [
            f"{name}={brief(entry)}"
            for name, entry in filled.items()
            if not _is_default(kind, name, entry)
        ]
        text = f"{kind.__name__}({', '.join(assignments)})"
    while len(text) > longest and assignments:
        # The attributes at the end are left out first. An object that is itself an attribute of a
        # displayed object has less space: if it does not fit, only the name of its class is
        # displayed.
        assignments = assignments[:-1] if longest == LONGEST_REPR else []
        text = f"{kind.__name__}({', '.join([*assignments, '…'])})"
    return text


def _is_empty(entry: Any) -> bool:
    """Return whether the value of an attribute is None, or a text or collection of length zero."""
    return entry is None or (hasattr(entry, "__len__") and len(entry) == 0)


def _is_default(kind: type, name: str, entry: Any) -> bool:
    """Return whether a number or text is the default value of the attribute ``name`` of a class."""
    return isinstance(entry, float | int | str) and bool(entry == getattr(kind, name, None))


class Shown:
    """Base class of the objects that users see. It defines how these objects are displayed.

    The ``repr`` is one line. ``print`` shows the most important parts on one screen. `details`
    returns all tables and sentences, which notebooks show too.
    """

    # Names of the attributes that the display of an object shows. If there are none, all fields of
    # a dataclass are shown.
    shown: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls) -> None:
        """Give a subclass the one-line ``repr`` of this class, unless the subclass defines one."""
        # The decorator ``dataclass`` writes a new method ``__repr__`` unless the class already has
        # one. Therefore ``__repr__`` is set here. Writing ``repr=False`` in every decorator would
        # not suffice, because users define subclasses too.
        super().__init_subclass__()
        if "__repr__" not in vars(cls):
            cls.__repr__ = Shown.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        """Return this object, such as a result or a campaign, as one line of text."""
        return brief(self, LONGEST_REPR)

    def __str__(self) -> str:
        """Return the most important tables and sentences about this object, for one screen."""
        return lines_of(screen_of(self), terminal_width())

    def details(self) -> str:
        """Return a text with all tables and sentences that describe this object."""
        return text_of(self, terminal_width())

    def _repr_html_(self) -> str:
        """Return all tables and sentences about this object as HTML, for a notebook."""
        return html_of(self)


class Result(Shown):
    """Base class of the frozen dataclasses that analyses return.

    Results hold only numbers, names and enum members; `ldbb_bayes.report.wording` writes the
    sentences about them. No decision of the program depends on a sentence.
    """

    __pydantic_config__ = ConfigDict(arbitrary_types_allowed=True)

    def as_dict(self) -> dict[str, Any]:
        """Return this result as a dictionary that can be written as JSON.

        Numbers are in internal units (mm, N, rad) unless the name of a field states another unit.
        """
        findings: dict[str, Any] = _adapter(type(self)).dump_python(
            self, mode="json", by_alias=True
        )
        return findings

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Return the result that a dictionary from `as_dict` describes.

        Keys that are not fields of the result, such as sentences and provenance, are ignored.
        """
        result: Self = _adapter(cls).validate_python(values)
        return result


# Mapping from the classes of results to objects of the library pydantic. Such an object converts
# results of the class to dictionaries and back. It is made when it is first needed.
_ADAPTERS: dict[type, TypeAdapter[Any]] = {}


def _adapter(kind: type) -> TypeAdapter[Any]:
    """Return the pydantic object that converts results of a class to dictionaries and back.

    The object is made only once for each class.
    """
    if kind not in _ADAPTERS:
        _ADAPTERS[kind] = TypeAdapter(kind)
    return _ADAPTERS[kind]


class EitherSpelling(dict[str, T]):
    """Dictionary whose keys are names of parameters, and which finds them as they are printed, too.

    Examples
    --------
    >>> lb.identify(lb.HybridModel.first(0), campaign).parameters["E_C(0Y)X"].verdict.value
    'prior-limited'
    """

    def __missing__(self, name: str) -> T:
        """Return the entry of E_C0YX for E_C(0Y)X; raise a `KeyError` if there is none."""
        key = inside_name(str(name))
        if key not in self:
            raise KeyError(name)
        return self[key]

    def __contains__(self, name: object) -> bool:
        """Return whether there is an entry of this name, in either spelling."""
        if super().__contains__(name):
            return True
        return isinstance(name, str) and super().__contains__(inside_name(name))

    def get(self, name: str, default: Any = None, /) -> Any:
        """Return the entry of this name, in either spelling; ``default`` if there is none."""
        try:
            return self[name]
        except KeyError:
            return default


ByParameter = Annotated[dict[str, T], AfterValidator(EitherSpelling)]
"""Type of a field for a dictionary of parameters, which finds them in either spelling."""


class ByName(Shown, EitherSpelling[T]):
    """Dictionary of results of one class, whose keys are the names of the results.

    The dictionary is displayed as one table.
    """

    def __repr__(self) -> str:
        """Return the number of results, their class and the first names as one line of text."""
        if not self:
            return "<no results>"
        kind = type(next(iter(self.values()))).__name__
        text = f"<{len(self)} {kind}: {', '.join(self)}>"
        if len(text) > LONGEST_REPR:
            return f"{text[: LONGEST_REPR - 2]}…>"
        return text


Passage: TypeAlias = Table | str | tuple[str, ...]
"""Part of a displayed result: a table, a paragraph (a text) or a list (a tuple of texts)."""


# Functions of other modules that define how classes of results are displayed. They are called when
# a result is first displayed.
_REGISTRATIONS: set[Callable[[], object]] = set()


def register_when_displayed(register: Callable[[], object]) -> None:
    """Store the function ``register``, which is called later to define how results are displayed.

    It is called without arguments whenever a result is to be displayed. Modules that are needed
    only for the display are therefore loaded as late as possible.
    """
    _REGISTRATIONS.add(register)


def registered_function(general: Any, result: Any) -> Callable[[Any], Any] | None:
    """Return the function that is registered for the class of ``result``, or None.

    ``general`` is a function made by `functools.singledispatch`, for which other modules register
    one function per class of results. Before the function is looked up, the functions that
    `register_when_displayed` stored are called.
    """
    for register in _REGISTRATIONS:
        register()
    function: Callable[[Any], Any] = general.dispatch(type(result))
    if function is general.dispatch(object):
        return None
    return function


@singledispatch
def parts_of(result: Any) -> tuple[Passage, ...]:
    """Return the parts that describe a result: tables, sentences and lists, in reading order.

    By default, one table of the result's fields is returned. Other modules, such as
    `ldbb_bayes.report.text`, can define other parts for a class of results with a function that has
    the decorator ``@parts_of.register``.
    """
    registered = registered_function(parts_of, result)
    if registered is not None:
        passages: tuple[Passage, ...] = registered(result)
        return passages
    rows = [(name, brief(value)) for name, value in entries_of(result).items()]
    if not rows:
        rows = [("none", "")]
    return (Table.of(type(result).__name__, ("field", "value"), rows, text=("value",)),)


@singledispatch
def screen_of(result: Any) -> tuple[Passage, ...]:
    """Return the tables and sentences that ``print`` shows for a result.

    By default, all tables and sentences are returned. For classes whose results fill more than a
    screen, the module `ldbb_bayes.report.screens` registers functions that return only some of the
    tables and sentences.
    """
    registered = registered_function(screen_of, result)
    if registered is not None:
        passages: tuple[Passage, ...] = registered(result)
        return passages
    return parts_of(result)


def lines_of(passages: Iterable[Passage], width: int = 120) -> str:
    """Return passages (tables, paragraphs and lists) as text, broken into lines.

    Lines have at most ``width`` characters if words are short enough. An empty line follows each
    table.
    """
    lines: list[str] = []
    for passage in passages:
        if isinstance(passage, Table):
            lines += [passage.text(width), ""]
        elif isinstance(passage, str):
            lines += wrapped(typeset(passage), width) or [""]
        else:
            for item in passage:
                lines += wrapped(typeset(item), width, "- ", "  ") or [""]
    return "\n".join(lines)


def text_of(result: Any, width: int = 120) -> str:
    """Return all tables and sentences about a result as plain text, for a terminal or a log.

    Lines have at most ``width`` characters if words are short enough.
    """
    return lines_of(parts_of(result), width)


def html_of(result: Any) -> str:
    """Return all tables and sentences about a result as HTML for a notebook.

    Special characters in the texts are escaped.
    """
    blocks: list[str] = []
    for passage in parts_of(result):
        if isinstance(passage, Table):
            blocks.append(passage.html())
            continue
        paragraphs = (passage,) if isinstance(passage, str) else passage
        blocks += [f"<p>{html.escape(typeset(paragraph))}</p>" for paragraph in paragraphs]
    return "".join(blocks)


def read_result(
    path: str | os.PathLike[str],
    name: str,
    command: str,
    read: Callable[[dict[str, Any]], T],
    advice: str = "",
) -> T:
    """Return a result from the JSON file that a command of ``ldbb-bayes`` wrote.

    Parameters
    ----------
    path : path
        Path of the file, or of the folder that contains the file ``name``.json.
    name : str
        Name of the result, such as "comparison".
    command : str
        Name of the command that wrote the file, such as "compare".
    read : callable
        Function that makes the result from the content of the JSON file.
    advice : str, optional
        Further advice that is appended to the message of an error.

    Raises
    ------
    InputError
        If the file is missing, is damaged, or was not written by the command.
    """
    source = Path(path)
    end = f" {advice}" if advice else ""
    if source.is_dir():
        source = source / f"{name}.json"
    require(
        source.is_file(),
        f"{name} must be a folder with {name}.json or such a file, got {path}. Give the --out"
        f" folder of a {command}.{end}",
    )
    raw = bytes_of(source, _LARGEST_BYTES, what=f"a {name}")
    try:
        return read(json.loads(raw))
    except (
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        StopIteration,
        RecursionError,
    ) as error:
        raise InputError(
            f"{source} must be a {name} written by this version of ldbb-bayes {command}, got"
            f" another file or a damaged one ({_reason_of(error)}). Name the file of a {name}, or"
            f" run {command} again.{end}"
        ) from None


def _reason_of(error: Exception) -> str:
    """Return the reason for an error, for a message about a damaged file of results.

    If pydantic (the library that checks the content of files) raised the error, return only the
    first entry of the error's message.
    """
    if isinstance(error, KeyError):
        return f"it lacks {error}"
    if not isinstance(error, ValidationError):
        return str(error) or "no such value"
    first = error.errors()[0]
    field = ".".join(map(str, first["loc"]))
    return f"{field}: {first['msg']}"


def json_text(result: Mapping[str, Any]) -> str:
    """Return the dictionary of a result as JSON text. NaN and infinite numbers become null."""
    text = to_json(result, indent=2, inf_nan_mode="null", fallback=_to_list)
    return text.decode() + "\n"
