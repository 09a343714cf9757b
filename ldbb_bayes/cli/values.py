"""Conversion of option values, as typed by the user, to names, directions, numbers and balls."""

from __future__ import annotations

import math
from collections.abc import Iterable

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError, check_known, placed, require
from ldbb_bayes.units import setting_to_inside

__all__ = ["ball_in", "directions_in", "names_in", "numbers_in", "pairs_in", "points_in"]

# Coordinates X,Y,Z [mm] of a point, as an example in messages.
_POINT = "0,-200,350"
# Words for directions of travel, as this package writes them; the keys are in small letters.
_WRITTEN = {"cw": "CW", "ccw": "CCW", "both": "both"}


def names_in(text: str) -> tuple[str, ...]:
    """Return the names in a comma-separated string.

    Parameters
    ----------
    text
        Typed string, for example ``"C_XXX, C_YYY"``.

    Returns
    -------
    tuple of str
        The names in the order of the string; empty names are left out.
    """
    names = [name.strip() for name in text.split(",")]
    return tuple(name for name in names if name)


def directions_in(text: str, flag: str) -> tuple[str, ...]:
    """Return the directions of travel that the user typed as an option's value.

    Parameters
    ----------
    text
        Typed string: CW (clockwise), CCW (counterclockwise), both of them separated by a comma, or
        the word ``both``. Small letters are accepted, too.
    flag
        Flag of the option, which is named in error messages.

    Returns
    -------
    tuple of str
        CW, CCW or both, each at most once.

    Raises
    ------
    InputError
        If the string contains another word, or none.
    """
    names = names_in(text)
    require(names != (), f"{flag} must name CW, CCW or both, got {text!r}. Name them.")
    directions: list[str] = []
    for name in names:
        written = _WRITTEN.get(name.casefold(), name)
        check_known(flag, [written], ("CW", "CCW", "both"))
        directions += ("CW", "CCW") if written == "both" else (written,)
    return tuple(dict.fromkeys(directions))


def pairs_in(entries: Iterable[str], flag: str, form: str) -> dict[str, str]:
    """Return the values of an option NAME=VALUE that the user may type several times.

    Parameters
    ----------
    entries
        Typed strings, for example ``["G=20 µm"]``.
    flag
        Flag of the option, such as ``--tolerance``, which is named in error messages.
    form
        Correct form of an entry, such as ``NAME=VALUE``, which is shown in error messages.

    Returns
    -------
    dict
        The keys are the names, and the values are the strings after the equals signs.

    Raises
    ------
    InputError
        If an entry has no name, no value or no equals sign, or a name occurs twice.
    """
    values: dict[str, str] = {}
    for entry in entries:
        name, sign, value = entry.partition("=")
        if not (name and sign and value):
            raise InputError(
                f"{flag} must be {form}, got {entry!r}. Put a name, '=' and what belongs to it."
            )
        if name in values:
            raise InputError(f"{flag} must give each name once, got {name!r} again. Remove one.")
        values[name] = value
    return values


def numbers_in(text: str, flag: str, example: str, separator: str = ",") -> tuple[float, ...]:
    """Return the finite numbers in a string, separated by commas or by another separator.

    Parameters
    ----------
    text
        Typed string, for example ``"36,742"``.
    flag
        Flag of the option, which is named in error messages.
    example
        Example of numbers as the user could type them, which is shown in error messages.
    separator
        Text between two numbers.

    Returns
    -------
    tuple of float
        The numbers in the order of the string.

    Raises
    ------
    InputError
        If an entry is not a finite number.
    """
    try:
        numbers = tuple(float(entry) for entry in text.split(separator))
    except ValueError:
        numbers = (math.nan,)
    require(
        all(math.isfinite(number) for number in numbers),
        f"{flag} must hold numbers, got {text!r}. Write them like {example}.",
    )
    return numbers


def points_in(entries: Iterable[str], flag: str) -> list[tuple[float, ...]]:
    """Return the points that the user typed as coordinates X,Y,Z in a repeatable option.

    Parameters
    ----------
    entries
        Typed strings with coordinates in mm, for example ``["0,-200,350"]``.
    flag
        Flag of the option, which is named in error messages.

    Returns
    -------
    list of tuple of float
        Three coordinates for each point [mm].

    Raises
    ------
    InputError
        If an entry does not consist of three numbers.
    """
    points = [numbers_in(text, flag, _POINT) for text in entries]
    for point in points:
        require(
            len(point) == 3,
            f"{flag} must hold three numbers X,Y,Z in mm, got {len(point)}. For example {_POINT}.",
        )
    return points


def ball_in(text: str, flag: str) -> lb.Ball:
    """Return the ball that a string describes by its grade or its deviation from sphericity.

    Parameters
    ----------
    text
        Typed string, for example ``"G20"``, ``"0.5um"`` or ``"500 nm"``.
    flag
        Flag of the option, which is named in error messages.

    Returns
    -------
    Ball
        Ball with this grade or deviation from sphericity.

    Raises
    ------
    InputError
        If the string is neither a known grade nor a length with its unit.
    """
    starts_like_number = text[:1] in set("+-−.,0123456789")
    if not starts_like_number:
        with placed(flag):
            return lb.Ball(grade=text)
    try:
        sphericity_um = setting_to_inside("sphericity_um", text.replace(",", "."), flag)
    except InputError:
        raise InputError(
            f"{flag} must be a grade like G20, or a deviation from sphericity like 0.5um, got"
            f" {text!r}. Correct it."
        ) from None
    with placed(flag):
        return lb.Ball(sphericity_um=sphericity_um)
