"""How objects show themselves: findings that go to JSON and back, short reprs, and one table for
terminal and HTML."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import textwrap
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass
from functools import cache, singledispatch
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, ConfigDict, PlainSerializer, TypeAdapter, ValidationError
from pydantic_core import to_json

from ldbb_bayes.errors import InputError, require
from ldbb_bayes.files import bytes_of
from ldbb_bayes.units import display_unit, typeset

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Array",
    "ByName",
    "ByRow",
    "Finite",
    "Number",
    "Numbers",
    "Records",
    "Result",
    "Shown",
    "Passage",
    "Table",
    "brief",
    "entries_of",
    "html_of",
    "json_text",
    "lines_of",
    "parts_of",
    "read_result",
    "readable",
    "table_of",
    "text_of",
    "wrapped",
]

T = TypeVar("T")
Array: TypeAlias = NDArray[Any]
_LARGEST_BYTES = 200_000_000


def _null(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


Finite = Annotated[
    float, BeforeValidator(lambda value: np.inf if value is None else value), PlainSerializer(_null)
]
"""A number that may be infinite, which JSON writes as null."""

Number = Annotated[
    float, BeforeValidator(lambda value: np.nan if value is None else value), PlainSerializer(_null)
]
"""A number that may be missing, not a number then, which JSON writes as null."""

Numbers = Annotated[
    np.ndarray, BeforeValidator(np.asarray), PlainSerializer(lambda array: array.tolist())
]
"""An array, in JSON nested lists."""


def _frame(rows: Any) -> pd.DataFrame:
    """A frame as it is; else rows by name, or a list of rows."""
    import pandas as pd  # commands that show no frame start without it

    if isinstance(rows, pd.DataFrame):
        return rows
    return (
        pd.DataFrame.from_dict(rows, orient="index")
        if isinstance(rows, dict)
        else pd.DataFrame.from_records(rows)
    )


if TYPE_CHECKING:
    ByRow: TypeAlias = pd.DataFrame
    Records: TypeAlias = pd.DataFrame
else:
    ByRow = Annotated[
        Any, BeforeValidator(_frame), PlainSerializer(lambda frame: frame.to_dict(orient="index"))
    ]
    """A table, in JSON its rows by name."""

    Records = Annotated[
        Any,
        BeforeValidator(_frame),
        PlainSerializer(
            lambda frame: frame.astype(object).where(frame.notna(), None).to_dict(orient="records")
        ),
    ]
    """A table, in JSON a list of its rows, null where a cell is missing."""


# Longest repr, longest value and most entries of a collection in one; rows of a table printed
# whole; narrowest and widest print.
_LONGEST = 80
_LONGEST_VALUE = 56
_MOST_ENTRIES = 12
_MOST_ROWS = 60
_NARROW = 80
_WIDE = 120


def entries_of(thing: Any) -> dict[str, Any]:
    """Return what an object shows of itself: what its class names in ``shown``, else the fields of
    a dataclass or pydantic model; nothing of anything else."""
    own = (
        [one.name for one in fields(thing)]
        if is_dataclass(thing)
        else getattr(type(thing), "model_fields", ())
    )
    return {name: getattr(thing, name) for name in getattr(type(thing), "shown", ()) or own}


def brief(value: Any, longest: int = _LONGEST_VALUE) -> str:
    """Return a value on one line: arrays, tables and long collections by their size; of an object
    what is not empty, of a long one what is not usual, as far as there is room."""
    kind = type(value).__name__
    if getattr(value, "shape", ()):
        return f"<{kind}, {' × '.join(map(str, value.shape))}>"
    if isinstance(value, Mapping | Set | tuple | list):
        whole = repr(value) if len(value) <= _MOST_ENTRIES else ""
        return (
            whole
            if 0 < len(whole) <= longest and "array(" not in whole
            else f"<{len(value)} entries>"
        )
    if (entries := entries_of(value)) or isinstance(value, Shown):
        filled = {
            name: own
            for name, own in entries.items()
            if own is not None and (not hasattr(own, "__len__") or len(own))
        }
        said = [f"{name}={brief(own)}" for name, own in filled.items()]
        if len(whole := f"{kind}({', '.join(said)})") > longest:
            usual = [
                isinstance(own, float | int | str) and own == getattr(type(value), name, None)
                for name, own in filled.items()
            ]
            said = [one for one, left_out in zip(said, usual, strict=True) if not left_out]
            whole = f"{kind}({', '.join(said)})"
        while len(whole) > longest and said:
            said = said[:-1] if longest == _LONGEST else []
            whole = f"{kind}({', '.join([*said, '…'])})"
        return whole
    text = f"{value:.6g}" if isinstance(value, float) else repr(value).replace("\n", " ")
    return text if len(text) <= longest else f"{text[: longest - 1]}…"


class Shown:
    """Base of what users have in hand: a repr of one line; tables and sentences in print and in a
    notebook."""

    shown: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "__repr__" not in vars(cls):  # else a dataclass would write its own
            cls.__repr__ = Shown.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        return brief(self, _LONGEST)

    def __str__(self) -> str:
        return text_of(self, _width())

    def _repr_html_(self) -> str:
        return html_of(self)


def _width() -> int:
    """Of the terminal, 80 where there is none."""
    return min(max(shutil.get_terminal_size((_NARROW, 24)).columns, _NARROW), _WIDE)


class Result(Shown):
    """Base of the frozen dataclasses that analyses return. Numbers, names and enums only:
    `ldbb_bayes.report.wording` writes the sentences, and nothing decides by reading them."""

    __pydantic_config__ = ConfigDict(arbitrary_types_allowed=True)

    def as_dict(self) -> dict[str, Any]:
        """The findings for JSON, in inside units (mm, N, rad)."""
        found: dict[str, Any] = _adapter(type(self)).dump_python(self, mode="json", by_alias=True)
        return found

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """The findings that `as_dict` wrote; keys that are no findings (sentences, provenance) are
        passed over."""
        result: Self = _adapter(cls).validate_python(values)
        return result


class ByName(Shown, dict[str, T]):
    """Results by name, shown as one table."""

    def __repr__(self) -> str:
        return f"<{len(self)} {type(next(iter(self.values()), None)).__name__}>"


def read_result(
    path: str | os.PathLike[str], what: str, command: str, read: Callable[[dict[str, Any]], T]
) -> T:
    """Return what ``command`` wrote into a folder, as the file ``what``.json, or into the file
    itself; ``read`` takes its JSON to the result. A file that is missing, damaged, or not one of
    ours is refused."""
    source = Path(path) / f"{what}.json" if Path(path).is_dir() else Path(path)
    cure = f"got {path}. Give the --out folder of a {command}."
    require(source.is_file(), f"{what} must be a folder with {what}.json or such a file, {cure}")
    raw = bytes_of(source, _LARGEST_BYTES, what=f"a {what}")
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
        first = error.errors()[0] if isinstance(error, ValidationError) else None
        why = str(error) if first is None else f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
        got = f"got a damaged one ({type(error).__name__}: {why}). Run {command} again."
        raise InputError(
            f"{source} must be a {what} written by this version of ldbb-bayes {command}, {got}"
        ) from None


_ADAPTERS: dict[type, TypeAdapter[Any]] = {}


def _adapter(kind: type) -> TypeAdapter[Any]:
    if kind not in _ADAPTERS:
        _ADAPTERS[kind] = TypeAdapter(kind)
    return _ADAPTERS[kind]


@dataclass(frozen=True)
class Table:
    """A table as it is read, and as it is filed. Columns that are ``numeric`` stand flush right. A
    number is shown with four digits, None as a dash, all else as it is."""

    caption: str
    heads: tuple[str, ...]  #: of the columns, with their units: force (N)
    numeric: tuple[bool, ...]
    rows: tuple[tuple[Any, ...], ...]  #: the first cell names the row

    @classmethod
    def of(
        cls,
        caption: str,
        heads: Sequence[str],
        rows: Sequence[Sequence[Any]],
        *,
        text: Collection[str] = (),
    ) -> Self:
        """Return a table whose columns are numbers but for the first and those named in
        ``text``."""
        numeric = tuple(k > 0 and head not in text for k, head in enumerate(heads))
        return cls(caption, tuple(heads), numeric, tuple(tuple(row) for row in rows))

    def shown(self) -> tuple[tuple[str, ...], ...]:
        """Return the rows as they are read."""
        return tuple(tuple(typeset(_cell(value)) for value in row) for row in self.rows)

    def text(self, width: int = 120) -> str:
        """Return the table as lines of at most ``width`` characters, no number or phrase broken.
        Where it is too wide, heads are broken into lines; then what is the same in every row is
        said once, at the end; then columns go beneath their row, text before numbers, the last
        first."""
        heads = [*map(typeset, self.heads)]
        rows = self.shown()
        kept = list(range(len(heads)))
        same = list[int]()
        beneath = list[int]()
        lines = {k: heads[k].replace(" (", "\n(").split("\n") for k in kept}

        def size(k: int, head: Sequence[str] = ()) -> int:
            return max(map(len, [*(head or lines[k]), *(row[k] for row in rows)]))

        def too_wide() -> bool:
            return sum(map(size, kept)) + 2 * (len(kept) - 1) > width

        def broken(least: int) -> dict[int, list[str]]:
            words = {k: _glued(heads[k]).split(" ") for k in kept}
            return {
                k: textwrap.wrap(" ".join(own), max(least, size(k, own)))
                for k, own in words.items()
            }

        if narrow := too_wide():
            lines = broken(1)
        if too_wide() and len(rows) > 1:
            same = [
                k for k in kept[1:] if heads[k] != "unit" and len({row[k] for row in rows}) == 1
            ]
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
            shown = (
                cells[k].rjust(size(k)) if self.numeric[k] else cells[k].ljust(size(k))
                for k in kept
            )
            return "  ".join(shown).replace("\xa0", " ").rstrip()

        def said(row: Sequence[str], which: Iterable[int]) -> str:
            filled = [k for k in which if row[k] not in ("", "–")]
            return "; ".join(_entry(heads[k], row[k], self.numeric[k]) for k in filled)

        found = [
            *wrapped(typeset(self.caption), width),
            *(row_of({k: own[i] for k, own in over.items()}) for i in range(high)),
        ]
        for row in rows:
            found += [
                row_of(dict(enumerate(row))),
                *wrapped(said(row, sorted(beneath)), width, "    ", "    "),
            ]
        return "\n".join(
            [*found, *wrapped(f"In every row: {said(rows[0], same)}", width)] if same else found
        )

    def html(self) -> str:
        """Return the table as HTML; everything is escaped."""

        def row_of(tags: Iterable[str], values: Iterable[str]) -> str:
            marks = [' class="n"' if numeric else "" for numeric in self.numeric]
            cells = zip(tags, marks, values, strict=True)
            return "".join(
                f"<{tag}{mark}>{html.escape(v)}</{tag.split()[0]}>" for tag, mark, v in cells
            )

        head = row_of(['th scope="col"'] * len(self.heads), self.heads)
        tags = ['th scope="row"', *["td"] * (len(self.heads) - 1)]
        body = "".join(f"<tr>{row_of(tags, row)}</tr>\n" for row in self.shown())
        caption = f"<caption>{html.escape(typeset(self.caption))}</caption>" if self.caption else ""
        return f"<table>{caption}<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody></table>"


# Columns in the unit that their row names.
_OF_ROW = (
    "mean",
    "sd",
    "median",
    "ci_low",
    "ci_high",
    "prior_mean",
    "prior_sd",
    "estimate",
    "u",
    "first",
    "second",
    "difference",
    "least_squares",
    "least_squares_u",
    "sd_error",
    "floor_sd",
    "baseline_sd",
)
_NAMING = ("parameter", "quantity", "source")  # columns that name a numbered row


def readable(
    frame: pd.DataFrame, caption: str = "", units: Mapping[str, str] | None = None
) -> pd.DataFrame:
    """Return a frame whose print has every column within 80 characters, and that a notebook shows
    under its caption; ``units`` of columns stand in their heads. What rows have in an inside unit
    is printed in the one for reading, and kept as it is."""
    made: pd.DataFrame = _frame_class()(frame)
    made.attrs = {**frame.attrs, "caption": caption, "units": dict(units or {})}
    return made


@cache
def _frame_class() -> type[pd.DataFrame]:
    import pandas as pd  # commands that show no frame start without it

    class ReadableFrame(pd.DataFrame):
        """A frame that is shown as a `Table`."""

        __module__ = __name__
        __qualname__ = "ReadableFrame"

        @property
        def _constructor(self) -> type[pd.DataFrame]:
            return ReadableFrame

        def __repr__(self) -> str:
            return table_of(self).text(_width())

        def _repr_html_(self) -> str:
            return table_of(self).html()

    return ReadableFrame


def __getattr__(name: str) -> Any:
    """The class of readable frames, for pickle."""
    if name == "ReadableFrame":
        return _frame_class()
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def table_of(frame: pd.DataFrame) -> Table:
    """Return a frame as it is read: numbers with the unit of their row, converted; of a long one
    the first and last rows."""
    caption = frame.attrs.get("caption", "")
    units = frame.attrs.get("units", {})
    if naming := [
        name
        for name in _NAMING
        if name in frame and frame.index.name is None and frame.index.dtype == int
    ]:
        frame = frame.set_index(naming[0])
    heads = [f"{name} ({units[name]})" if units.get(name) else str(name) for name in frame.columns]
    numeric = [kind.kind in "iufb" for kind in frame.dtypes]
    cut = len(frame) > _MOST_ROWS
    rows = list[tuple[Any, ...]]()
    for label, *row in (
        frame.take(np.r_[: _MOST_ROWS // 2, -_MOST_ROWS // 2 : 0]) if cut else frame
    ).itertuples(name=None):
        factor = 1.0
        unit = dict(zip(frame, row, strict=True)).get("unit")
        with suppress(InputError):
            factor, unit = display_unit(str(unit))
        rows.append((" / ".join(map(str, label)) if isinstance(label, tuple) else label,))
        for name, own in zip(frame, row, strict=True):
            size = own * factor if isinstance(own, float) and name in _OF_ROW else own
            rows[-1] += (unit if name == "unit" else None if own != own else size,)
    if cut:
        rows.insert(_MOST_ROWS // 2, ("…",) * (len(heads) + 1))
        caption += f"{', ' * bool(caption)}{len(frame)} rows"
    return Table(caption, (str(frame.index.name or ""), *heads), (False, *numeric), tuple(rows))


def wrapped(text: str, width: int, first: str = "", then: str = "") -> list[str]:
    """Return a text as lines of at most ``width`` characters; a number keeps sign and unit, a word
    or path stays whole."""
    filled = textwrap.wrap(
        _glued(text),
        width,
        initial_indent=first,
        subsequent_indent=then,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace("\xa0", " ") for line in filled]


_UNIT = r"%|°|bar\b|[nµm]?m\b|k?N\b|[nµm]?rad\b|per kN|nats?\b|times\b|u\b"
_UNBREAKABLE = "|".join(
    (
        rf"(?<=[\d)\]]) (?={_UNIT})",
        r" (?=\([^()]{1,16}\))",
        r"(?<=/N) (?=per kN)",
        r"(?<=\bln) (?=[BPp]\()",
        r" (?=[=±→≤≥<>·−] [\w(−+.])",
        r"(?<= [=±→≤≥<>·−]) (?=[\w(−+.])",
    )
)


def _glued(text: str) -> str:
    """The text with spaces that must not end a line made unbreakable: before units, beside signs,
    in short brackets."""
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
    return (
        to_json(
            result, indent=2, inf_nan_mode="null", fallback=lambda value: value.tolist()
        ).decode()
        + "\n"
    )


Passage: TypeAlias = Table | str | tuple[str, ...]
"""A table, a paragraph, or a list."""


@singledispatch
def parts_of(result: Any) -> tuple[Passage, ...]:
    """Return a result as tables, sentences and lists, in the order they are read.

    A result is a table of its fields, unless a function is registered for its class with
    ``@parts_of.register``: `ldbb_bayes.report.text` and the fleet's modules do so.
    """
    rows = [(name, brief(value)) for name, value in entries_of(result).items()]
    if not rows:
        rows = [("none", "")]
    return (Table.of(type(result).__name__, ("field", "value"), rows, text=("value",)),)


def lines_of(parts: Iterable[Passage], width: int = 120) -> str:
    """Return tables, an empty line after each, paragraphs and lists as lines of at most ``width``
    characters."""
    lines: list[str] = []
    for part in parts:
        if isinstance(part, Table):
            lines += [part.text(width), ""]
        elif isinstance(part, str):
            lines += wrapped(typeset(part), width) or [""]
        else:
            for item in part:
                lines += wrapped(typeset(item), width, "- ", "  ") or [""]
    return "\n".join(lines)


def text_of(result: Any, width: int = 120) -> str:
    """Return a result for a terminal or a log."""
    return lines_of(parts_of(result), width)


def html_of(result: Any) -> str:
    """Return a result for a notebook; everything is escaped."""
    blocks: list[str] = []
    for part in parts_of(result):
        if isinstance(part, Table):
            blocks.append(part.html())
            continue
        paragraphs = (part,) if isinstance(part, str) else part
        blocks += [f"<p>{html.escape(typeset(paragraph))}</p>" for paragraph in paragraphs]
    return "".join(blocks)
