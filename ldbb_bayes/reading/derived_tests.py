"""Tests that hold numbers computed from readings, such as a sheet ``mean 100 N`` beside ``100 N``.

Such a test is no circle of its own, although its name states a load.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.derived_columns import derived_words, without_derived_words
from ldbb_bayes.reading.names import name_as_words
from ldbb_bayes.reading.recording import Recording
from ldbb_bayes.reading.words import LONGEST_NAME, WORDS

__all__ = ["check_no_test_is_derived"]

# Regular expression for words, such as "raw" or "s", that have other meanings too in names of
# tests. Such words count only if another test has the same name without them.
_OF_SEVERAL_MEANINGS = re.compile(WORDS["columns"]["derived_or_other"], re.IGNORECASE)
# Fields of a test that tell it from other circles. Tests that agree in all of them may be one
# circle.
_CONDITIONS = ("force_N", "pressure_bar", "direction", "plane", "radius_mm", "setup")


def check_no_test_is_derived(recordings: Sequence[Recording]) -> None:
    """Raise an error if some tests hold numbers that were computed from those of other tests.

    Words in the names of files, sheets and tests show this, such as "mean" in ``mean 100 N`` beside
    ``100 N run 1``, if two tests of the same load, direction, plane and radius differ in them.
    Words with other meanings, such as "raw", count only beside a test whose name is equal but has
    no such word. Tests to which the user gives a name in the layout are not examined, nor are
    columns that the user names.

    Parameters
    ----------
    recordings
        All tests, with their conditions in `Recording.fields`.

    Raises
    ------
    InputError
        If tests of the same conditions differ in words for computed numbers.
    """
    tests_by_condition: dict[tuple[Any, ...], list[Recording]] = {}
    for recording in recordings:
        if "name" not in recording.stated:
            condition = tuple(recording.fields.get(key) for key in _CONDITIONS)
            tests_by_condition.setdefault(condition, []).append(recording)
    for tests in tests_by_condition.values():
        _check_words_agree([(_words_of_one_meaning(_name_of(test)), test) for test in tests])
        tests_by_rest: dict[str, list[tuple[frozenset[str], Recording]]] = {}
        for test in tests:
            name = _name_of(test)
            of_rest = tests_by_rest.setdefault(without_derived_words(name), [])
            of_rest.append((derived_words(name), test))
        for of_rest in tests_by_rest.values():
            if any(not words for words, _ in of_rest):
                _check_words_agree(of_rest)


def _check_words_agree(tests: Sequence[tuple[frozenset[str], Recording]]) -> None:
    """Raise an error if tests of the same conditions differ in words for computed numbers.

    Each item holds these words, and the test in whose name they stand.
    """
    fewest, plain = min(tests, key=lambda item: len(item[0]))
    for words, test in tests:
        if words != fewest:
            _check_is_no_copy(test, plain)
            other = plain.title
            if other == test.title:
                other = f"{plain.sheet.title}, {other}"
            raise InputError(
                f"{test.place}: each test must be a circle of its own, got {test.title!r} beside"
                f" {other!r}. Leave out files and sheets (--sheets) that are no circles, or"
                " give each that is a circle a name in a [[test]] of --layout."
            )


def _check_is_no_copy(test: Recording, other: Recording) -> None:
    """Raise an error if a test has exactly the readings of another test of another file."""
    readings = test.numbers.get("reading")
    readings_of_other = other.numbers.get("reading")
    if readings is None or readings_of_other is None or test.sheet.path == other.sheet.path:
        return
    if np.array_equal(readings, readings_of_other):
        raise InputError(
            f"{test.place}: each test must be imported once, got the readings of"
            f" {other.sheet.path.name} again. Leave one of the two files out."
        )


def _name_of(recording: Recording) -> str:
    """Return the names of a test, its sheet and its file, with blanks between all words.

    The name of a column that the user names is left out.
    """
    names = recording.names_of_files()
    if recording.label and "reading" in recording.layout.columns:
        names = names[1:]
    return " ".join(name_as_words(name[:LONGEST_NAME]) for name in names)


def _words_of_one_meaning(name: str) -> frozenset[str]:
    """Return the words of a name that stand for computed numbers and have no other meaning."""
    words = derived_words(name)
    return frozenset(word for word in words if not _OF_SEVERAL_MEANINGS.fullmatch(word))
