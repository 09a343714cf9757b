"""Goldens as compact JSON, and what differs between two of them."""

from __future__ import annotations

import itertools
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
        return _condensed_dictionary(value)
    if isinstance(value, (list, tuple)):
        return _condensed_list(value)
    return value


def _condensed_dictionary(value: dict[Any, Any]) -> dict[str, Any]:
    if _is_matrix_of_dictionaries(value):
        rows = list(value.values())
        if len(rows) > _MOST_ROWS:
            numbers = itertools.chain.from_iterable(row.values() for row in rows)
            return _digest(list(numbers)) | _keys({**value, **rows[0]})
        if len(rows[0]) > _LONGEST:
            digests = {}
            for key, row in value.items():
                digests[str(key)] = _digest(list(row.values())) | _keys(row)
            return digests
    return {str(key): condensed(item) for key, item in value.items()}


def _condensed_list(value: Sequence[Any]) -> Any:
    if len(value) > _LONGEST and _are_numbers(value):
        return _digest(list(value))
    if len(value) > _MOST_ROWS and all(_is_row(row) for row in value):
        return _digest(list(itertools.chain.from_iterable(value)))
    return [condensed(item) for item in value]


def _is_matrix_of_dictionaries(value: dict[Any, Any]) -> bool:
    """Whether all items are dictionaries of numbers under the same keys."""
    rows = list(value.values())
    if len(rows) < 2 or not isinstance(rows[0], dict):
        return False
    keys = list(rows[0])
    for row in rows:
        if not isinstance(row, dict) or list(row) != keys or not _are_numbers(row.values()):
            return False
    return True


def _is_row(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and _are_numbers(value)


def _are_numbers(values: Any) -> bool:
    return all(_is_number(value) for value in values)


def _digest(numbers: list[float]) -> dict[str, Any]:
    array = np.array(numbers, dtype=float)
    array = array[np.isfinite(array)]
    weights = np.random.RandomState(len(array)).uniform(0.5, 1.5, len(array))
    weighted = math.fsum((weights * array).tolist())
    ends = []
    if len(array):
        ends = [float(array[0]), float(array[-1]), float(array.min()), float(array.max())]
    return {"numbers": [len(numbers), *ends, math.fsum(array.tolist()), weighted]}


def _keys(value: dict[str, Any]) -> dict[str, str]:
    names = [str(name) for name in value]
    checksum = zlib.crc32("|".join(names).encode())
    return {"keys": f"{len(names)} from {names[0]} to {names[-1]}, {checksum:08x}"}


def compact(value: Any, depth: int = 0) -> str:
    """JSON with what fits into a line on one."""
    line = json.dumps(value, ensure_ascii=False)
    if len(line) + depth <= 130 or not isinstance(value, (dict, list)) or not value:
        return line
    pad = " " * (depth + 1)
    if isinstance(value, dict):
        rows = []
        for key, item in value.items():
            name = json.dumps(key, ensure_ascii=False)
            rows.append(f"{pad}{name}: {compact(item, depth + 1)}")
        return "{\n" + ",\n".join(rows) + f"\n{' ' * depth}}}"
    rows = [pad + compact(item, depth + 1) for item in value]
    return "[\n" + ",\n".join(rows) + f"\n{' ' * depth}]"


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

    def rule(self, *texts: str) -> Rule:
        """The first rule that fits one of the texts; where none does, one that allows nothing."""
        for rule in self.rules:
            if any(re.search(rule.where, text) for text in texts):
                return rule
        return Rule("")

    def walk(self, old: Any, new: Any, path: str, scale: float) -> Iterator[Difference]:
        """Differences of two values at a path; scale: of what stands around them."""
        if isinstance(old, dict) and isinstance(new, dict):
            yield from self.dictionaries(old, new, path)
        elif isinstance(old, list) and isinstance(new, list):
            yield from self.lists(old, new, path, scale)
        elif _is_number(old) and _is_number(new):
            yield from self.numbers(old, new, path, scale)
        elif isinstance(old, str) and isinstance(new, str):
            yield from self.sentences(old, new, path)
        elif old != new or type(old) is not type(new):
            yield Difference(path, old, new, math.inf)

    def dictionaries(
        self, old: dict[str, Any], new: dict[str, Any], path: str
    ) -> Iterator[Difference]:
        """Differences of the items under every key of either."""
        for key in old | new:
            inside = f"{path}/{key}"
            if key not in old:
                yield Difference(inside, "(none)", new[key], math.inf)
            elif key not in new:
                yield Difference(inside, old[key], "(none)", math.inf)
            else:
                yield from self.walk(old[key], new[key], inside, _spread_beside(old, key))

    def lists(
        self, old: list[Any], new: list[Any], path: str, scale: float
    ) -> Iterator[Difference]:
        """Differences of items, on the scale of the largest number of the list."""
        if len(old) != len(new):
            yield Difference(f"{path} (length)", len(old), len(new), math.inf)
        items = old
        if path.endswith("/numbers"):  # a digest begins with its size
            items = old[1:]
        numbers = [item for item in items if _is_number(item) and math.isfinite(item)]
        largest = max([scale, *map(abs, numbers)])
        for index, (one, two) in enumerate(zip(old, new, strict=False)):
            yield from self.walk(one, two, f"{path}/{index}", largest)

    def numbers(self, old: float, new: float, path: str, scale: float) -> Iterator[Difference]:
        """At most one difference."""
        if old == new or (math.isnan(old) and math.isnan(new)):
            return
        if not (math.isfinite(old) and math.isfinite(new)):
            yield Difference(path, old, new, math.inf)
            return
        rule = self.rule(path)
        largest = max(abs(old), abs(new), scale, rule.scale)
        if abs(old - new) > max(self.relative, rule.relative) * largest:
            yield Difference(path, old, new, abs(old - new) / largest)

    def sentences(self, old: str, new: str, path: str) -> Iterator[Difference]:
        """At most one difference."""
        rule = self.rule(path, old)
        if old == new or rule.tie:
            return
        if not _same_but_for_rounding(old, new, rule.relative):
            yield Difference(path, old, new, math.inf)


def _spread_beside(row: dict[str, Any], key: str) -> float:
    """The standard uncertainty beside a number: C_XXX.sd for C_XXX.mean, or that of the row."""
    column = key.rpartition(".")[0]
    for name in (f"{column}.sd", *SPREADS):
        if _is_number(row.get(name)):
            return abs(float(row[name]))
    return 0.0


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
        number = float(two.replace("−", "-"))
        if abs(wanted - number) > max(1.001 * unit, relative * abs(wanted)):
            return False
    return True
