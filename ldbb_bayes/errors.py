"""`InputError`, the error for unusable input, and functions that raise it or write its message."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import SequenceMatcher
from typing import NamedTuple, SupportsIndex

__all__ = [
    "LONGEST_MESSAGE",
    "InputError",
    "check_known",
    "check_probability",
    "check_seed",
    "nearest",
    "placed",
    "plain_reason",
    "quoted_reason",
    "require",
    "require_whole",
    "suggestion",
]

# Largest length of an error message [characters]. The middle of a longer message is left out.
# Messages may be long because they quote files.
LONGEST_MESSAGE = 1200
# If a library cannot read a file, at most this many characters of its error message are quoted.
_LONGEST_QUOTED_REASON = 120
# A name is suggested instead of a misspelt name only if at least this fraction of the letters of
# the two names match.
_LEAST_SIMILARITY = 0.4
# The last of several words that are written together, such as Error in ForceError.
_LAST_WORD = re.compile(r"(?<=[a-z])[A-Z][a-z]+$")


class InputError(ValueError):
    """Error that is raised for input that cannot be used.

    The message states in one line which condition the input must fulfil, what was found instead,
    and how to correct the input. The middle of a message longer than 1200 characters is left out.
    The error is also a ValueError.

    Examples
    --------
    >>> lb.CircularTest(500.0, angle_deg=[0.0, 90.0, 180.0, 270.0])
    Traceback (most recent call last):
        ...
    ldbb_bayes.errors.InputError: a circular test must have at least 9 angles, got 4. Give the
    angles of all readings that are planned, such as every 10°.
    """

    def __init__(self, message: str) -> None:
        """Store the error message as one line, without its middle part if the line is too long."""
        line = " ".join(message.split("\n"))
        if len(line) > LONGEST_MESSAGE:
            line = f"{line[: 2 * LONGEST_MESSAGE // 3]} … {line[-LONGEST_MESSAGE // 3 :]}"
        super().__init__(line)


def require(condition: object, message: str) -> None:
    """Raise an `InputError` with the given message unless the condition is true."""
    if not condition:
        raise InputError(message)


def check_probability(prob: object, name: str = "prob") -> None:
    """Raise an `InputError` unless ``prob`` is a number above 0 and below 1.

    ``name`` is the name of the argument in the message.
    """
    require(
        isinstance(prob, int | float) and 0.0 < prob < 1.0,
        f"{name} must be a number between 0 and 1, got {prob!r}. For 95 % give 0.95.",
    )


def require_whole(name: str, number: object) -> None:
    """Raise an `InputError` unless ``number`` has the method ``__index__``, as every integer has.

    Booleans and NumPy arrays have this method too, and cause no error. ``name`` is the name of the
    argument in the message.
    """
    require(
        isinstance(number, SupportsIndex),
        f"{name} must be a whole number, got {number!r}. Give for example {name}=6.",
    )


def check_seed(seed: object) -> None:
    """Raise an `InputError` unless ``seed`` is an integer of at least zero.

    Every object with the method ``__index__`` is taken as an integer. Booleans and NumPy arrays
    also have this method.
    """
    require(
        isinstance(seed, SupportsIndex) and int(seed) >= 0,
        f"seed must be a whole number of at least 0, got {seed!r}. Give for example seed=1.",
    )


@contextmanager
def placed(place: object) -> Iterator[None]:
    """Put the place of a fault at the beginning of the message of an `InputError`.

    The error is raised in the ``with`` block. The place is, for example, the name of the file that
    contains the fault.
    """
    try:
        yield
    except InputError as error:
        raise InputError(f"{place}: {error}") from None


class _Similarity(NamedTuple):
    """Measures of how similar two names are; the most important measure comes first.

    Larger values mean more similar names.
    """

    ratio: float  # fraction of the letters of two compared names that match, from 0 to 1
    same_letters: bool  # whether two compared names consist of the same letters in any order
    # number of letters in the first block of consecutive letters in which two compared names match;
    # for example, 3 for "forse" and "force", whose first block is "for"
    first_match_size: int


def nearest(name: str, known: Iterable[str]) -> str:
    """Return the known name that is most similar to ``name``, a name that is probably misspelt.

    If several names are equally similar, a name with the same letters as ``name``, in any order, is
    preferred. If there is no such name, the first sequence of matching letters decides: the longer
    this sequence, the better. For example, "forse" and "force" have "for" as the first sequence.
    Capital and small letters are not distinguished.
    """
    lower_name = name.lower()

    def similarity(candidate: str) -> _Similarity:
        """Return measures of how similar the known name ``candidate`` is to the misspelt name."""
        lower_candidate = candidate.lower()
        match = SequenceMatcher(None, lower_candidate, lower_name)
        return _Similarity(
            ratio=match.ratio(),
            same_letters=sorted(lower_candidate) == sorted(lower_name),
            first_match_size=match.get_matching_blocks()[0].size,
        )

    return max(known, key=similarity)


def check_known(
    kind: str, names: Iterable[str], known: Iterable[str], more: str = "", *, instead: str = ""
) -> None:
    """Raise an `InputError` for the first of several names that is not a known name.

    Parameters
    ----------
    kind
        Word for the kind of the names, such as "test" or "option"; it is used in the message.
    names
        Names that a user gave.
    known
        All valid names; the message lists these names and suggests the most similar name.
    more
        Further advice that is appended to the message.
    instead
        Advice that replaces the suggestion of the most similar name.

    Raises
    ------
    InputError
        If a name is not known.
    """
    known_names = list(known)
    for name in names:
        if not known_names:
            raise InputError(f"{kind} must not be given here, got {name!r}. Remove it.")
        if name not in known_names:
            raise InputError(
                f"{kind} must be one of {', '.join(known_names)}, got {name!r}."
                f"{instead or suggestion(str(name), known_names)}{more}"
            )


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return a question for the user, such as " Did you mean 'mount'?", or an empty text.

    Parameters
    ----------
    name
        Name that a user gave, and that is not known.
    known
        All valid names.

    Returns
    -------
    str
        Question that suggests the known name that is most similar to ``name``; it begins with a
        blank. The text is empty if the two names have little in common, because the user then means
        something else.
    """
    candidate = nearest(name, known)
    similar = candidate.lower()
    stated = name.lower()
    beginning = stated[:2]
    if beginning.endswith("_") and similar.startswith(beginning):
        # All compliances begin with C_, and all geometric errors with E_. This says nothing of
        # whether one of them is meant by another.
        similar = similar.removeprefix(beginning)
        stated = stated.removeprefix(beginning)
    last_word = _LAST_WORD.search(candidate)
    if last_word and stated.endswith(last_word[0].lower()):
        # Names such as ForceError and PitchError share a word that says as little.
        similar = similar.removesuffix(last_word[0].lower())
        stated = stated.removesuffix(last_word[0].lower())
    if SequenceMatcher(None, similar, stated).ratio() < _LEAST_SIMILARITY:
        return ""
    return f" Did you mean {candidate!r}?"


def quoted_reason(error: BaseException) -> str:
    """Return the beginning of a library's error message, in one line, to quote it in another."""
    return " ".join(str(error).split())[:_LONGEST_QUOTED_REASON]


def plain_reason(error: BaseException) -> str | None:
    """Return a one-line message for an error that the user's input, files or numbers caused.

    Return None for any other error, which is a fault of the program.
    """
    if isinstance(error, InputError):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.filename or 'the output'} must be usable, got: {error.strerror}. Check it."
    if isinstance(error, ArithmeticError):
        return (
            f"the numbers must be within reach of double precision, got: {error}. Check units and"
            " magnitudes."
        )
    # The error LinAlgError of NumPy is recognised by its name, because NumPy is not imported here.
    if type(error).__name__ == "LinAlgError":
        return (
            f"the campaign must determine the model, got a numerical breakdown ({error}). Look for"
            " forces or angles that hardly differ, readings or priors of an impossible size"
            " (ldbb-bayes check)."
        )
    return None
