"""Columns that hold numbers computed from readings, such as ``100 N mean`` beside ``100 N run 1``.

Such a column is no circle of its own, although its header states a load.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.names import LOAD_IN_NAME, NamedLoad, load_in_name
from ldbb_bayes.reading.travel_direction import without_directions
from ldbb_bayes.reading.words import LONGEST_NAME, WORDS, comparable, unit_named

__all__ = [
    "check_none_is_derived",
    "derived_words",
    "without_derived_words",
    "without_remarks",
]

# Regular expression for a word, such as "mean" or "simulated", which shows that a column may hold
# other numbers than the readings of a circle.
_DERIVED = re.compile(rf"(?<![^\W\d_])(?:{WORDS['columns']['derived']})(?![^\W\d_])", re.IGNORECASE)
# Regular expression for a word that may stand beside the load of a circle, such as "run", "XY" or
# "warm".
_WORD_OF_CIRCLES = (
    f"{WORDS['loads']['beside']}|{WORDS['names']['run']}|{WORDS['columns']['of_circles']}"
    f"|{WORDS['columns']['parts']}"
)
_OF_CIRCLES = re.compile(_WORD_OF_CIRCLES, re.IGNORECASE)
# Regular expression for a remark in brackets about a circle, such as "(2)" or "(Wdh.)".
_REMARK = re.compile(
    rf"\(\s*(?:\d{{1,2}}|(?:{_WORD_OF_CIRCLES})\.?(?:\s?\d{{1,2}})?)\s*\)", re.IGNORECASE
)
# Regular expression for a part of a machine with a word in front of it, as in "new spindle". The
# word may be one of those for computed numbers, but is about the part.
_PART = re.compile(
    rf"(?<![^\W\d_])(?:{WORDS['columns']['old_or_new']}|{WORDS['columns']['before_part']})"
    rf"[\W_]{{1,3}}(?:{WORDS['columns']['parts']})(?![^\W\d_])",
    re.IGNORECASE,
)
# Regular expression for a word, such as "old", which shows that other numbers were computed only if
# another column has the same header without such a word.
_BEFORE_OR_AFTER = re.compile(WORDS["columns"]["before_or_after"], re.IGNORECASE)
# Regular expression for a text in brackets.
_IN_BRACKETS = re.compile(r"[\[(]([^\[\]()]*)[\])]")
# Words for readings, such as "deviation".
_OF_READINGS = frozenset(WORDS["roles"]["reading"].split())
# A word of fewer letters, such as the A of "run A", may number the circles of one load.
_FEWEST_LETTERS = 2
# An error message proposes at most this number of columns.
_COLUMNS_SHOWN = 6


def check_none_is_derived(place: str, headers: Sequence[str]) -> None:
    """Raise an error if some columns of readings hold numbers that were computed from the others.

    Words such as "mean" show this if two columns of the same load differ in them. If all columns of
    a load have the same words, as in ``mean 100 N CW`` and ``mean 100 N CCW``, each is a circle.
    Words such as "old" show it only if another column has the same header without such a word: of
    ``100 N old`` and ``100 N new``, each is a circle. Any other word shows it too, such as the last
    of ``100 N weight``, if it stands in some columns of a load and another column of this load has
    no such word. Words for circles, parts and directions, such as "run" and "new spindle", and
    single letters are no such words.

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
    for headers_of_load in _headers_by_load(headers):
        derived = _derived_words_of_load(headers_of_load)
        if len(set(derived.values())) > 1:
            raise _no_circle(place, headers, derived)
        unknown = {header: _unknown_words(_name_of(header)) for header in headers_of_load}
        has_plain_header = frozenset() in unknown.values()
        if has_plain_header and len(set(unknown.values())) > 1:
            raise _no_circle(place, headers, unknown)


def _headers_by_load(headers: Sequence[str]) -> list[list[str]]:
    """Return the headers that state a load, in one list for each load."""
    by_load: dict[NamedLoad, list[str]] = {}
    for header in headers:
        load = load_in_name([_name_of(header)])
        if load is not None:
            by_load.setdefault(load._replace(name=""), []).append(header)
    return list(by_load.values())


def _derived_words_of_load(headers: Sequence[str]) -> dict[str, frozenset[str]]:
    """Return the words for computed numbers in each of the headers, which state the same load.

    Words such as "old" are left out unless another header is the same without such words. The keys
    of the dict are the headers.
    """
    rests = {header: without_derived_words(_name_of(header)) for header in headers}
    plain_rests = set()
    for header, rest in rests.items():
        if not derived_words(_name_of(header)):
            plain_rests.add(rest)
    by_header = {}
    for header, rest in rests.items():
        words = derived_words(_name_of(header))
        if rest not in plain_rests:
            words = frozenset(word for word in words if not _BEFORE_OR_AFTER.fullmatch(word))
        by_header[header] = words
    return by_header


def _no_circle(
    place: str, headers: Sequence[str], words_of_load: Mapping[str, frozenset[str]]
) -> InputError:
    """Return the error for columns of one load whose words show that some are no circles.

    ``words_of_load`` holds these words for each header of the load, and ``headers`` are the headers
    of all columns of readings.
    """
    fewest = min(words_of_load.values(), key=len)
    examples: dict[frozenset[str], str] = {}
    for header, words in words_of_load.items():
        examples.setdefault(words, header)
    plain = examples.pop(fewest)
    no_circles = " and ".join(repr(header[:LONGEST_NAME]) for header in examples.values())
    return InputError(
        f"{place}: each column of readings must be a circle of its own, got {no_circles} beside"
        f" {plain[:LONGEST_NAME]!r}. Name the columns that are circles, for example"
        f" {_options(_probable_circles(headers, words_of_load))}."
    )


def _probable_circles(
    headers: Sequence[str], words_of_load: Mapping[str, frozenset[str]]
) -> list[str]:
    """Return, of each load, the headers with the fewest words that speak against a circle.

    ``words_of_load`` holds these words for each header of one load. In headers of other loads, they
    are the words for computed numbers. ``headers`` are the headers of all columns of readings.
    """
    circles = []
    for headers_of_load in _headers_by_load(headers):
        words_by_header = {}
        for header in headers_of_load:
            derived = derived_words(_name_of(header))
            words_by_header[header] = words_of_load.get(header, derived)
        fewest = min(words_by_header.values(), key=len)
        circles += [header for header in headers_of_load if words_by_header[header] == fewest]
    return circles


def derived_words(name: str) -> frozenset[str]:
    """Return the words of a name that stand for computed numbers, such as "mean"."""
    return frozenset(_DERIVED.findall(_PART.sub(" ", comparable(name))))


def without_derived_words(name: str) -> str:
    """Return a name without words for computed numbers, and without the signs between its words."""
    return " ".join(re.findall(r"\d+|[^\W\d_]+", _DERIVED.sub(" ", comparable(name))))


def without_remarks(header: str) -> str:
    """Return a header without remarks about the circle, such as ``36 N`` of ``36 N (2)``.

    A remark is a number or a word in brackets, such as "(2)" or "(repeat)". A header that states no
    load is returned unchanged.
    """
    if load_in_name([header]) is None:
        return header
    return _REMARK.sub("", header)


def _name_of(header: str) -> str:
    """Return a header without its unit, followed by its texts in brackets that are no units."""
    texts = [text for text in _IN_BRACKETS.findall(header[:LONGEST_NAME]) if not unit_named(text)]
    name = unit_of(header).name[:LONGEST_NAME]
    if load_in_name([name]) is None:  # "300 N" alone, of which N is the unit
        name = header[:LONGEST_NAME]
    return " ".join([name, *texts])


def _unknown_words(name: str) -> frozenset[str]:
    """Return the words of a name that state no load, direction or plane, and mean no circle.

    Words for computed numbers are left out.
    """
    rest = _PART.sub(" ", without_directions(LOAD_IN_NAME.sub(" ", comparable(name))))
    words = re.findall(rf"[^\W\d_]{{{_FEWEST_LETTERS},}}", rest)
    unknown = []
    for word in words:
        is_known = word in _OF_READINGS or _OF_CIRCLES.fullmatch(word) or _DERIVED.fullmatch(word)
        if not is_known:
            unknown.append(word)
    return frozenset(unknown)


def _options(headers: Sequence[str]) -> str:
    """Return the options that state these columns of readings; of many, only the first."""
    options = [f"--reading-column '{header[:LONGEST_NAME]}'" for header in headers[:_COLUMNS_SHOWN]]
    if len(headers) > _COLUMNS_SHOWN:
        options.append("…")
    return " ".join(options)
