"""What the columns of a table are called, in which units they are, and which of them is what."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from ldbb_bayes.campaign.table import PER_TEST
from ldbb_bayes.errors import InputError, nearest
from ldbb_bayes.tables.layout import ROLES, Layout
from ldbb_bayes.tables.preamble import load_in_name, without_load
from ldbb_bayes.tables.units import plain, unit_named

__all__ = ["called", "columns_of", "label_of", "unit_of", "unit_of_a_reading"]

# Signs of a name: beyond these it is none.
LONGEST_NAME = 200
# Beside a word for a load: not the load of the test.
_ANOTHER = {"step", "max", "min", "limit", "no", "nr", "number", "case", "preload", "supply", "ambient", "rated", "range"}
# Beside the word for a test in the header of the column that names it.
_NUMBERING = ("name", "no", "nr", "number", "id", "label", "index")
# A number after it is a factor of the unit; elsewhere it numbers the column: ``reading 2 µm``.
_PER = re.compile(r"/\s*$")
_BRACKET = re.compile(r"[\[({<]")
_INSIDE = re.compile(r"[\[({<]\s*([^\[\](){}<>]+?)\s*(?=[\[\](){}<>])")
# 0-360°
_RANGE = re.compile(r"-?\d+\s*(?:-|–|to|\.\.\.?)\s*\d+\s*(?=°|deg)")
# A factor, or half of one, before a unit: 10-3, x 10, 0.1. One or two digits alone number the column, but for ten.
_FACTOR = re.compile(r"[x×*]|[x×*]?\d[\d.,^⁻⁰¹²³⁴⁵⁶⁷⁸⁹−–+eE\-]*")
_NUMBER = re.compile(r"(?!10)\d{1,2}")
_AFTER_IN = re.compile(r"(.*?)\s+in\s+(.+)")
_AFTER_BRACKETS = re.compile(r"[\])}>]")
_AT_END = re.compile(r"(.*?)(?:\s*/\s*|_|\s*,\s*|\s+)((?:\d[\d.,/]*\s*)?[^\s/_,\d]+)\s*")


def unit_of(header: str) -> tuple[str, str]:
    """A header's name and unit: ``Angle [°]`` → ("Angle", "deg"), ``reading_um`` → ("reading", "um").

    What stands in brackets or after "in" and is no unit comes back as it is, to be refused where the column is used.
    """
    header = header.strip().lstrip("#").strip()
    if len(header) > LONGEST_NAME:
        return header, ""
    name, inside = _BRACKET.split(header)[0].strip(" _"), [_RANGE.sub("", own) for own in _INSIDE.findall(header)]
    after = _AFTER_IN.fullmatch(header)
    if not (inside and name) and after:
        name, inside = after[1].strip(" _"), [after[2].strip()]
    if inside and name:
        if [plain(own) for own in inside] == ["grad"] and plain(name).startswith("winkel"):
            return name, "deg"
        known = {unit_named(own) for own in inside} - {""}
        scaled = bool(re.search(r"\d", _AFTER_BRACKETS.split(header)[-1])) and not after
        return name, known.pop() if len(known) == 1 and not scaled else " and ".join(inside) + " …" * scaled
    match = _AT_END.fullmatch(header)
    unit = unit_named(match[2]) if match else ""
    if match and unit and not _PER.search(header[: match.start(2)]) and "/" not in unit:
        factor, _, unit = unit.rpartition(" ")
        last = factor or next(reversed(re.split(r"[\s_,]+", match[1])))
        if _FACTOR.fullmatch(last) and not _NUMBER.fullmatch(last):
            return match[1].strip(" _"), f"({last}) {unit}"
    return (match[1].strip(" _"), unit) if match and unit and match[1].strip(" _") else (header, "")


def columns_of(where: str, layout: Layout, headers: Sequence[str]) -> tuple[dict[str, int], list[int]]:
    """Which column is what, and all columns of readings: as the layout says, else by the words of the header."""
    asked = {role: column if isinstance(column, list) else [column] for role, column in layout.columns.items()}
    each = {role: [_asked(where, role, own, headers) for own in columns] for role, columns in asked.items() if columns}
    found = {role: columns[0] for role, columns in each.items()}
    readings = each.get("reading", [])
    if not any(headers):
        found = _of_bare_columns(where, found, len(headers))
        return found, readings or [found["reading"]]
    names = [unit_of(header)[0] for header in headers]
    ours = {k for k, header in enumerate(headers) if header in PER_TEST}
    for role, words in ROLES.items():
        if role in found:
            continue
        own = [k for k, name in enumerate(names) if k not in found.values() and called(name, words)]
        own = [k for k in own if k not in ours] or own
        loaded = _with_loads(headers, found) if role == "reading" else []
        if len(loaded) > 1 and set(own) <= set(loaded):
            readings, own = loaded, loaded[:1]
        if len(own) > 1:
            both = ", or all, each a test of its own, by naming it once for each" if role == "reading" else ""
            raise InputError(
                f"{where}: one column must hold the {role}, got {' and '.join(repr(headers[k][:LONGEST_NAME]) for k in own)}. "
                f"Say which: --{role}-column{both}."
            )
        if own and not (own[0] in ours and role != "reading"):
            found[role] = own[0]
    if "angle" in found and "time" not in layout.columns:
        found.pop("time", None)
    elif "angle" not in found and "time" not in found and "time_s" in headers:
        found["time"] = list(headers).index("time_s")
    found = {role: column for role, column in found.items() if role == "reading" or column not in readings}
    readings = readings or [found[role] for role in ("reading",) if role in found]
    if len(readings) > 1 and "test" in found:
        raise InputError(
            f"{where}: a table must have one column of readings, or none that names the test, got {len(readings)} of readings "
            f"beside {headers[found['test']][:LONGEST_NAME]!r}. Say which: --reading-column."
        )
    return found, readings


def _with_loads(headers: Sequence[str], found: Mapping[str, int]) -> list[int]:
    """Columns that are called by the load of a test: ``36 N [mm]``, ``reading 238 N``."""
    return [k for k, header in enumerate(headers) if k not in found.values() and load_in_name([header]) is not None]


def label_of(header: str) -> str:
    """A header without its unit in brackets."""
    return _BRACKET.split(header)[0].strip() or header


def unit_of_a_reading(header: str) -> str:
    """Of a column of readings; the load in its name, and the load's unit, are not of them."""
    return unit_of(f"reading {without_load(header)}")[1]


def _of_bare_columns(where: str, found: dict[str, int], width: int) -> dict[str, int]:
    """Without a header: angle, then reading, if there are only two columns; else what was asked for."""
    if "reading" in found and ("angle" in found or "time" in found):
        return found
    if found or width != 2:
        raise InputError(
            f"{where}: columns without a header must be named by number, got {width} of them. "
            "Give --reading-column and --angle-column or --time-column."
        )
    return {"angle": 0, "reading": 1}


def _asked(where: str, role: str, column: str | int, headers: Sequence[str]) -> int:
    """The column that was asked for, by its number or its header, with or without the unit."""
    if isinstance(column, int):
        if not 1 <= column <= len(headers):
            raise InputError(f"{where}: column of the {role} must be 1 to {len(headers)}, got {column}. Correct it.")
        return column - 1
    exact = [k for k, header in enumerate(headers) if plain(header) == plain(column)]
    alike = [k for k, header in enumerate(headers) if plain(unit_of(header)[0]) == plain(unit_of(column)[0])]
    matching = exact or alike
    if len(matching) == 1:
        return matching[0]
    known = ", ".join(repr(header[:LONGEST_NAME]) for header in headers if header) or "no header"
    hint = f" Did you mean {nearest(column, headers)!r}?" if any(headers) else ""
    raise InputError(
        f"{where}: column of the {role} must be one of {known}, got {column!r} ({len(matching) or 'none'} such).{hint}"
    )


def called(name: str, words: Sequence[str]) -> bool:
    """Whether a header names what these words do."""
    parts = re.findall(r"[^\W\d_]+", plain(name[:LONGEST_NAME]))
    if words in (ROLES["force"], ROLES["pressure"]) and set(parts) & _ANOTHER:
        return False
    if words is ROLES["test"] and not set(parts) <= {*words, *_NUMBERING}:
        return False
    return any(word in parts or (len(word) > 3 and any(part.startswith(word) for part in parts)) for word in words)
