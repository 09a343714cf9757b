"""Results: findings as frozen dataclasses that go to JSON and back, and one table for the terminal, for HTML and for CSV."""

from __future__ import annotations

import html
import json
import os
import re
import textwrap
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Generic, Self, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, ConfigDict, PlainSerializer, TypeAdapter, ValidationError
from pydantic_core import to_json

from ldbb_bayes.errors import InputError, require
from ldbb_bayes.files import bytes_of
from ldbb_bayes.units import typeset

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Array", "ByClass", "ByRow", "Finite", "Number", "Numbers", "Records", "Result", "Table", "json_text", "read_result",
    "wrapped",
]  # fmt: skip

T = TypeVar("T")
Array: TypeAlias = NDArray[Any]
_LARGEST_BYTES = 200_000_000


def _null(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


Finite = Annotated[float, BeforeValidator(lambda value: np.inf if value is None else value), PlainSerializer(_null)]
"""A number that may be infinite, which JSON writes as null."""

Number = Annotated[float, BeforeValidator(lambda value: np.nan if value is None else value), PlainSerializer(_null)]
"""A number that may be missing, not a number then, which JSON writes as null."""

Numbers = Annotated[np.ndarray, BeforeValidator(np.asarray), PlainSerializer(lambda array: array.tolist())]
"""An array, in JSON nested lists."""


def _frame(rows: Any) -> pd.DataFrame:
    """A frame as it is; else rows by name, or a list of rows."""
    import pandas as pd  # commands that show no frame start without it

    if isinstance(rows, pd.DataFrame):
        return rows
    return pd.DataFrame.from_dict(rows, orient="index") if isinstance(rows, dict) else pd.DataFrame.from_records(rows)


if TYPE_CHECKING:
    ByRow: TypeAlias = pd.DataFrame
    Records: TypeAlias = pd.DataFrame
else:
    ByRow = Annotated[Any, BeforeValidator(_frame), PlainSerializer(lambda frame: frame.to_dict(orient="index"))]
    """A table, in JSON its rows by name."""

    Records = Annotated[
        Any,
        BeforeValidator(_frame),
        PlainSerializer(lambda frame: frame.astype(object).where(frame.notna(), None).to_dict(orient="records")),
    ]
    """A table, in JSON a list of its rows, null where a cell is missing."""


class Result:
    """Base of the frozen dataclasses that analyses return. Numbers, names and enums only: `ldbb_bayes.report.wording` writes the
    sentences, and nothing decides by reading them."""

    __pydantic_config__ = ConfigDict(arbitrary_types_allowed=True)

    def as_dict(self) -> dict[str, Any]:
        """The findings for JSON, in inside units (mm, N, rad)."""
        found: dict[str, Any] = _adapter(type(self)).dump_python(self, mode="json", by_alias=True)
        return found

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """The findings that `as_dict` wrote; keys that are no findings (sentences, provenance) are passed over."""
        result: Self = _adapter(cls).validate_python(values)
        return result

    def __str__(self) -> str:
        return str(import_module("ldbb_bayes.report.text").text_of(self))

    def _repr_html_(self) -> str:
        return str(import_module("ldbb_bayes.report.text").html_of(self))


class ByClass(Generic[T]):
    """A function that is another one for every kind of result. They are kept by the names of the classes, so that words for a
    result are registered without importing the analysis that makes it."""

    def __init__(self, default: Callable[[Any], T]) -> None:
        self._default, self._registered = default, dict[str, Callable[[Any], T]]()
        self.__doc__ = default.__doc__

    def register(self, function: Callable[[Any], T]) -> Callable[[Any], T]:
        """Take a function for the class that its first argument is annotated with."""
        self._registered[next(iter(function.__annotations__.values()))] = function
        return function

    def __call__(self, result: Any) -> T:
        names = (kind.__name__ for kind in type(result).__mro__)
        return next((self._registered[name] for name in names if name in self._registered), self._default)(result)


def read_result(path: str | os.PathLike[str], what: str, command: str, read: Callable[[dict[str, Any]], T]) -> T:
    """Return what ``command`` wrote into a folder, as the file ``what``.json, or into the file itself; ``read`` takes its JSON to
    the result. A file that is missing, damaged, or not one of ours is refused."""
    source = Path(path) / f"{what}.json" if Path(path).is_dir() else Path(path)
    cure = f"got {path}. Give the --out folder of a {command}."
    require(source.is_file(), f"{what} must be a folder with {what}.json or such a file, {cure}")
    raw = bytes_of(source, _LARGEST_BYTES, what=f"a {what}")
    try:
        return read(json.loads(raw))
    except (ValueError, KeyError, TypeError, AttributeError, StopIteration, RecursionError) as error:
        first = error.errors()[0] if isinstance(error, ValidationError) else None
        why = str(error) if first is None else f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
        got = f"got a damaged one ({type(error).__name__}: {why}). Run {command} again."
        raise InputError(f"{source} must be a {what} written by this version of ldbb-bayes {command}, {got}") from None


_ADAPTERS: dict[type, TypeAdapter[Any]] = {}


def _adapter(kind: type) -> TypeAdapter[Any]:
    if kind not in _ADAPTERS:
        _ADAPTERS[kind] = TypeAdapter(kind)
    return _ADAPTERS[kind]


@dataclass(frozen=True)
class Table:
    """A table as it is read, and as it is filed. Columns that are ``numeric`` stand flush right. A number is shown with four
    digits, None as a dash, all else as it is."""

    caption: str
    heads: tuple[str, ...]  #: of the columns, with their units: force (N)
    numeric: tuple[bool, ...]
    rows: tuple[tuple[Any, ...], ...]  #: the first cell names the row

    @classmethod
    def of(cls, caption: str, heads: Sequence[str], rows: Sequence[Sequence[Any]], *, text: Collection[str] = ()) -> Self:
        """Return a table whose columns are numbers but for the first and those named in ``text``."""
        numeric = tuple(k > 0 and head not in text for k, head in enumerate(heads))
        return cls(caption, tuple(heads), numeric, tuple(tuple(row) for row in rows))

    def frame(self) -> pd.DataFrame:
        """Return the cells as they are, for CSV."""
        import pandas as pd

        return pd.DataFrame(list(self.rows), columns=list(self.heads))

    def shown(self) -> tuple[tuple[str, ...], ...]:
        """Return the rows as they are read."""
        return tuple(tuple(typeset(_cell(value)) for value in row) for row in self.rows)

    def text(self, width: int = 120) -> str:
        """Return the table as lines of at most ``width`` characters, no number or phrase broken. Where it is too wide, heads are
        broken into lines; then what is the same in every row is said once, at the end; then columns go beneath their row, text
        before numbers, the last first."""
        heads, rows = [*map(typeset, self.heads)], self.shown()
        kept, same, beneath = list(range(len(heads))), list[int](), list[int]()
        lines = {k: heads[k].replace(" (", "\n(").split("\n") for k in kept}

        def size(k: int, head: Sequence[str] = ()) -> int:
            return max(map(len, [*(head or lines[k]), *(row[k] for row in rows)]))

        def too_wide() -> bool:
            return sum(map(size, kept)) + 2 * (len(kept) - 1) > width

        def broken(least: int) -> dict[int, list[str]]:
            words = {k: _glued(heads[k]).split(" ") for k in kept}
            return {k: textwrap.wrap(" ".join(own), max(least, size(k, own))) for k, own in words.items()}

        if narrow := too_wide():
            lines = broken(1)
        if too_wide() and len(rows) > 1:
            same = [k for k in kept[1:] if heads[k] != "unit" and len({row[k] for row in rows}) == 1]
        for k in sorted(kept[1:], key=lambda k: (heads[k] == "unit", self.numeric[k], -k)):
            if too_wide() and k not in same:
                beneath.insert(0, k)
            kept = [k for k in kept if k not in same and k not in beneath]
        for least in (12, 9, 7, 1) if narrow else ():
            if too_wide() or least == 12:
                lines = broken(least)
        high = max(len(lines[k]) for k in kept)
        over = {k: [""] * (high - len(lines[k])) + lines[k] for k in kept}

        def row_of(cells: Mapping[int, str]) -> str:
            shown = (cells[k].rjust(size(k)) if self.numeric[k] else cells[k].ljust(size(k)) for k in kept)
            return "  ".join(shown).replace("\xa0", " ").rstrip()

        def said(row: Sequence[str], which: Iterable[int]) -> str:
            filled = [k for k in which if row[k] not in ("", "–")]
            return "; ".join(_entry(heads[k], row[k], self.numeric[k]) for k in filled)

        found = [*wrapped(typeset(self.caption), width), *(row_of({k: own[i] for k, own in over.items()}) for i in range(high))]
        for row in rows:
            found += [row_of(dict(enumerate(row))), *wrapped(said(row, sorted(beneath)), width, "    ", "    ")]
        return "\n".join([*found, *wrapped(f"In every row: {said(rows[0], same)}", width)] if same else found)

    def html(self) -> str:
        """Return the table as HTML; everything is escaped."""

        def row_of(tags: Iterable[str], values: Iterable[str]) -> str:
            marks = [' class="n"' if numeric else "" for numeric in self.numeric]
            cells = zip(tags, marks, values, strict=True)
            return "".join(f"<{tag}{mark}>{html.escape(v)}</{tag.split()[0]}>" for tag, mark, v in cells)

        head = row_of(['th scope="col"'] * len(self.heads), self.heads)
        tags = ['th scope="row"', *["td"] * (len(self.heads) - 1)]
        body = "".join(f"<tr>{row_of(tags, row)}</tr>\n" for row in self.shown())
        caption = f"<caption>{html.escape(typeset(self.caption))}</caption>" if self.caption else ""
        return f"<table>{caption}<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody></table>"


def wrapped(text: str, width: int, first: str = "", then: str = "") -> list[str]:
    """Return a text as lines of at most ``width`` characters; a number keeps sign and unit, a word or path stays whole."""
    filled = textwrap.wrap(
        _glued(text), width, initial_indent=first, subsequent_indent=then, break_long_words=False, break_on_hyphens=False
    )
    return [line.replace("\xa0", " ") for line in filled]


_UNIT = r"%|°|bar\b|[nµm]?m\b|k?N\b|[nµm]?rad\b|per kN|nats?\b|times\b|u\b"
_UNBREAKABLE = "|".join((
    rf"(?<=[\d)\]]) (?={_UNIT})", r" (?=\([^()]{1,16}\))", r"(?<=/N) (?=per kN)", r"(?<=\bln) (?=[BPp]\()",
    r" (?=[=±→≤≥<>·−] [\w(−+.])", r"(?<= [=±→≤≥<>·−]) (?=[\w(−+.])",
))  # fmt: skip


def _glued(text: str) -> str:
    """The text with spaces that must not end a line made unbreakable: before units, beside signs, in short brackets."""
    text = re.sub(_UNBREAKABLE, "\xa0", text)
    return re.sub(r"[(\[][^()\[\]]{1,16}[)\]]", lambda match: match[0].replace(" ", "\xa0"), text)


def _entry(head: str, value: str, numeric: bool) -> str:
    """A cell with its head, in one line: noise 0.12 µm; verdict: identified."""
    name, _, unit = head.removesuffix(")").partition(" (")
    return f"{name} {value} {unit}".rstrip().replace(" °", "°") if numeric else f"{head}: {value}"


def _cell(value: Any) -> str:
    if value is None:
        return "–"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def json_text(result: Mapping[str, Any]) -> str:
    """Return a result as JSON; numbers that are not finite become null."""
    return to_json(result, indent=2, inf_nan_mode="null", fallback=lambda value: value.tolist()).decode() + "\n"
