"""The one error a user can cause, and the one wording for unknown names."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from difflib import SequenceMatcher

__all__ = ["InputError", "check_known", "nearest", "placed", "plain_reason", "renamed", "require"]


LONGEST_MESSAGE = 1200


class InputError(ValueError):
    """Input that cannot be used. The message says in one line what must hold, what was found, and
    how to mend it.

    Of what is longer than 1200 characters, a file's own text, the middle is left out.
    """

    def __init__(self, message: str) -> None:
        line = " ".join(message.split("\n"))
        if len(line) > LONGEST_MESSAGE:
            line = f"{line[: 2 * LONGEST_MESSAGE // 3]} … {line[-LONGEST_MESSAGE // 3 :]}"
        super().__init__(line)


def require(holds: object, message: str) -> None:
    """Refuse input with this message unless the condition holds."""
    if not holds:
        raise InputError(message)


@contextmanager
def placed(place: object) -> Iterator[None]:
    """A message inside names the place."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{place}: {error}") from None


def nearest(name: str, known: Iterable[str]) -> str:
    """The known name most like ``name``; of several that are as like, one of the same letters, or
    beginning like it."""
    own = name.lower()

    def alike(one: str) -> tuple[float, bool, int]:
        match = SequenceMatcher(None, one.lower(), own)
        anagram = sorted(one.lower()) == sorted(own)
        return match.ratio(), anagram, match.get_matching_blocks()[0].size

    return max(known, key=alike)


def check_known(what: str, names: Iterable[str], known: Iterable[str], more: str = "") -> None:
    """Refuse the first of ``names`` that is not known, with the nearest known name and the whole
    list, and what else may help."""
    candidates = list(known)
    for name in names:
        if not candidates:
            raise InputError(f"{what} must not be given here, got {name!r}. Remove it.")
        if name not in candidates:
            cure = f"Did you mean {nearest(str(name), candidates)!r}?{more}"
            raise InputError(f"{what} must be one of {', '.join(candidates)}, got {name!r}. {cure}")


def renamed(
    what: str, name: str, today: Mapping[str, str], *, refused_from: str, stacklevel: int = 3
) -> str:
    """Return what ``name`` is called today, with a FutureWarning where it is the name of an earlier
    version."""
    if name not in today:
        return name
    cure = f"Write {today[name]!r}; {refused_from} refuses the old name."
    warnings.warn(
        f"{what} {name!r} is called {today[name]!r} now. {cure}",
        FutureWarning,
        stacklevel=stacklevel,
    )
    return today[name]


def plain_reason(error: BaseException) -> str | None:
    """What a user is told, in one line, of an error that input, files or a breakdown of the numbers
    can cause; None of others."""
    if isinstance(error, InputError):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.filename or 'the output'} must be usable, got: {error.strerror}. Check it."
    if isinstance(error, ArithmeticError):
        return (
            f"the numbers must be within reach of double precision, got: {error}. Check units and"
            " magnitudes."
        )
    if type(error).__name__ == "LinAlgError":
        return (
            f"the campaign must determine the model, got a numerical breakdown ({error}). Look for"
            " forces or angles that hardly differ, readings or priors of an impossible size"
            " (ldbb-bayes check)."
        )
    return None
