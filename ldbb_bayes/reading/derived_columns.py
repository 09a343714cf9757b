"""Columns that hold numbers computed from readings, such as ``100 N mean`` beside ``100 N run 1``.

Such a column is no circle of its own, although its header states a load.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.column_roles import unit_of
from ldbb_bayes.reading.names import NamedLoad, load_in_name
from ldbb_bayes.reading.words import LONGEST_NAME, WORDS, comparable

__all__ = ["check_none_is_derived", "derived_words", "without_derived_words"]

# Regular expression for a word, such as "mean" or "simulated", which shows that a column may hold
# other numbers than the readings of a circle.
_DERIVED = re.compile(rf"(?<![^\W\d_])(?:{WORDS['columns']['derived']})(?![^\W\d_])", re.IGNORECASE)
# An error message proposes at most this number of columns.
_COLUMNS_SHOWN = 6


def check_none_is_derived(place: str, headers: Sequence[str]) -> None:
    """Raise an error if some columns of readings hold numbers that were computed from the others.

    Words such as "mean" show this if two columns of the same load differ in them. If all columns of
    a load have the same words, as in ``mean 100 N CW`` and ``mean 100 N CCW``, each is a circle.

    Parameters
    ----------
    place
        Name of the table in the error message.
    headers
        Headers of all columns of readings.

    Raises
    ------
    InputError
        If columns of the same load differ in words for computed numbers.
    """
    words_by_load: dict[NamedLoad, dict[frozenset[str], str]] = {}
    for header in headers:
        name = unit_of(header).name[:LONGEST_NAME]
        load = load_in_name([name])
        if load is not None:
            of_load = words_by_load.setdefault(load._replace(name=""), {})
            of_load.setdefault(_words_of_header(header), header[:LONGEST_NAME])
    for of_load in words_by_load.values():
        if len(of_load) > 1:
            fewest = min(of_load, key=len)
            others = " and ".join(repr(of_load[words]) for words in of_load if words != fewest)
            circles = [header for header in headers if _words_of_header(header) == fewest]
            raise InputError(
                f"{place}: each column of readings must be a circle of its own, got {others} beside"
                f" {of_load[fewest]!r}. Name the columns that are circles, for example"
                f" {_options(circles)}."
            )


def derived_words(name: str) -> frozenset[str]:
    """Return the words of a name that stand for computed numbers, such as "mean"."""
    return frozenset(_DERIVED.findall(comparable(name)))


def without_derived_words(name: str) -> str:
    """Return a name without words for computed numbers, and without the signs between its words."""
    return " ".join(re.findall(r"\d+|[^\W\d_]+", _DERIVED.sub(" ", comparable(name))))


def _words_of_header(header: str) -> frozenset[str]:
    """Return the words of a header, without its unit, that stand for computed numbers."""
    return derived_words(unit_of(header).name[:LONGEST_NAME])


def _options(headers: Sequence[str]) -> str:
    """Return the options that state these columns of readings; of many, only the first."""
    options = [f"--reading-column '{header[:LONGEST_NAME]}'" for header in headers[:_COLUMNS_SHOWN]]
    if len(headers) > _COLUMNS_SHOWN:
        options.append("…")
    return " ".join(options)
