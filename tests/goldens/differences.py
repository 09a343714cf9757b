"""Goldens as compact JSON, and what differs between two of them."""

from __future__ import annotations

import json
import math
import re
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

__all__ = ["Difference", "Rule", "compact", "condensed", "differences"]

NUMBER = re.compile(r"(?<![\w.])[−+-]?\d+(?:\.\d+)?(?:e[−+-]?\d+)?(?![\w.]*\w)")
# A number beside a standard uncertainty is compared on that scale; other keys on their own.
SPREADS = ("sd", "u")
_LONGEST = 16
_MOST_ROWS = 20


class Difference(NamedTuple):
    """Where two goldens differ."""

    path: str
    old: Any
    new: Any
    relative: float


@dataclass(frozen=True)
class Rule:
    """How closely some numbers and sentences can be held.

    Attributes
    ----------
    where : str
        Regular expression found in the path, or in the sentence.
    relative : float
        Largest relative difference that is rounding.
    scale : float
        Numbers are held on this scale where their own is smaller: 1 for shares of a whole.
    tie : bool
        The sentence chooses between equals and may choose otherwise: not compared.
    """

    where: str
    relative: float = 0.0
    scale: float = 0.0
    tie: bool = False


def condensed(value: Any) -> Any:
    """The same, long lists of numbers as [size, first, last, smallest, largest, sum, a weighted
    sum].

    So are matrices, written as lists or dictionaries: row by row where there are few rows. A
    dictionary alone may hold several units and stays.
    """
    if isinstance(value, dict):
        rows = list(value.values())
        if len(rows) > 1 and all(
            isinstance(row, dict) and _are_numbers(row.values()) and list(row) == list(rows[0])
            for row in rows
        ):
            if len(rows) > _MOST_ROWS:
                return _digest([number for row in rows for number in row.values()]) | _keys(
                    {**value, **rows[0]}
                )
            if len(rows[0]) > _LONGEST:
                return {
                    str(key): _digest(list(row.values())) | _keys(row) for key, row in value.items()
                }
        return {str(key): condensed(own) for key, own in value.items()}
    if isinstance(value, (list, tuple)):
        if len(value) > _LONGEST and _are_numbers(value):
            return _digest(list(value))
        if len(value) > _MOST_ROWS and all(
            isinstance(row, (list, tuple)) and _are_numbers(row) for row in value
        ):
            return _digest([number for row in value for number in row])
        return [condensed(own) for own in value]
    return value


def _are_numbers(values: Any) -> bool:
    return all(_is_number(own) for own in values)


def _digest(numbers: list[float]) -> dict[str, Any]:
    array = np.array(numbers, dtype=float)
    array = array[np.isfinite(array)]
    weights = np.random.RandomState(len(array)).uniform(0.5, 1.5, len(array))
    weighted = math.fsum((weights * array).tolist())
    ends = (
        [float(array[0]), float(array[-1]), float(array.min()), float(array.max())]
        if len(array)
        else []
    )
    return {"numbers": [len(numbers), *ends, math.fsum(array.tolist()), weighted]}


def _keys(value: dict[str, Any]) -> dict[str, str]:
    names = list(map(str, value))
    return {
        "keys": (
            f"{len(names)} from {names[0]} to {names[-1]},"
            f" {zlib.crc32('|'.join(names).encode()):08x}"
        )
    }


def compact(value: Any, depth: int = 0) -> str:
    """JSON with what fits into a line on one."""
    line = json.dumps(value, ensure_ascii=False)
    if len(line) + depth <= 130 or not isinstance(value, (dict, list)) or not value:
        return line
    pad = " " * (depth + 1)
    if isinstance(value, dict):
        rows = [
            f"{pad}{json.dumps(key, ensure_ascii=False)}: {compact(own, depth + 1)}"
            for key, own in value.items()
        ]
        return "{\n" + ",\n".join(rows) + f"\n{' ' * depth}}}"
    return "[\n" + ",\n".join(pad + compact(own, depth + 1) for own in value) + f"\n{' ' * depth}]"


def differences(
    old: Any, new: Any, *, relative: float = 1e-10, rules: Sequence[Rule] = ()
) -> list[Difference]:
    """Everything that differs by more than rounding.

    Parameters
    ----------
    relative
        Largest difference of two numbers, of the larger one, the largest in its list, or the
        standard uncertainty beside it. Numbers in sentences may differ by one in their last place.
    rules
        The first that fits a path or sentence holds for it.
    """
    return list(_Comparison(relative, tuple(rules)).walk(old, new, "", 0.0))


@dataclass(frozen=True)
class _Comparison:
    relative: float
    rules: tuple[Rule, ...]

    def rule(self, *texts: str) -> Rule | None:
        return next(
            (own for own in self.rules if any(re.search(own.where, text) for text in texts)), None
        )

    def walk(self, old: Any, new: Any, path: str, scale: float) -> Iterator[Difference]:
        """Differences of two values at a path; scale: of what stands around them."""
        if isinstance(old, dict) and isinstance(new, dict):
            spread = next((abs(old[key]) for key in SPREADS if _is_number(old.get(key))), 0.0)
            for key in [*old, *(key for key in new if key not in old)]:
                if key not in old or key not in new:
                    yield Difference(
                        f"{path}/{key}", old.get(key, "(none)"), new.get(key, "(none)"), math.inf
                    )
                else:
                    own = old.get(
                        f"{key.rpartition('.')[0]}.sd"
                    )  # of C_XXX.mean, in a row of a table
                    yield from self.walk(
                        old[key], new[key], f"{path}/{key}", abs(own) if _is_number(own) else spread
                    )
        elif isinstance(old, list) and isinstance(new, list):
            if len(old) != len(new):
                yield Difference(f"{path} (length)", len(old), len(new), math.inf)
            first = 1 if path.endswith("/numbers") else 0  # a digest begins with its size
            inside = max(
                [
                    scale,
                    *(abs(own) for own in old[first:] if _is_number(own) and math.isfinite(own)),
                ]
            )
            for k, (one, two) in enumerate(zip(old, new, strict=False)):
                yield from self.walk(one, two, f"{path}/{k}", inside)
        elif _is_number(old) and _is_number(new):
            yield from self.numbers(old, new, path, scale)
        elif isinstance(old, str) and isinstance(new, str):
            yield from self.sentences(old, new, path)
        elif old != new or type(old) is not type(new):
            yield Difference(path, old, new, math.inf)

    def numbers(self, old: float, new: float, path: str, scale: float) -> Iterator[Difference]:
        """At most one difference."""
        if old == new or (math.isnan(old) and math.isnan(new)):
            return
        if not (math.isfinite(old) and math.isfinite(new)):
            yield Difference(path, old, new, math.inf)
            return
        found = self.rule(path)
        largest = max(abs(old), abs(new), scale, found.scale if found else 0.0)
        if abs(old - new) > max(self.relative, found.relative if found else 0.0) * largest:
            yield Difference(path, old, new, abs(old - new) / largest)

    def sentences(self, old: str, new: str, path: str) -> Iterator[Difference]:
        """At most one difference."""
        found = self.rule(path, old)
        if old == new or (found and found.tie):
            return
        if not _same_but_for_rounding(old, new, found.relative if found else 0.0):
            yield Difference(path, old, new, math.inf)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _same_but_for_rounding(old: str, new: str, relative: float) -> bool:
    """Whether the words are the same and every number is, to one of its last place or so much of
    its size."""
    if NUMBER.sub("#", old).split() != NUMBER.sub("#", new).split():
        return False
    for one, two in zip(NUMBER.findall(old), NUMBER.findall(new), strict=True):
        head, _, power = one.replace("−", "-").partition("e")
        unit = 10.0 ** (int(power or 0) - len(head.partition(".")[2]))
        wanted = float(one.replace("−", "-"))
        got = float(two.replace("−", "-"))
        if abs(wanted - got) > max(1.001 * unit, relative * abs(wanted)):
            return False
    return True
