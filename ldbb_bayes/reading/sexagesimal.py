"""Angles in degrees, minutes and seconds, such as 12° 30' 15"."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from ldbb_bayes.errors import InputError

__all__ = [
    "SECONDS_UNIT",
    "check_angle_is_whole",
    "columns_in_sexagesimal",
    "names_sexagesimal",
    "seconds_in",
]

# Unit of the numbers that `seconds_in` returns, in this package's notation.
SECONDS_UNIT = "arcsec"
_SECONDS = r"(?P<seconds>\d{1,2})(?P<mark>[.,])?(?P<decimals>(?<=[.,])\d+)?"
# Regular expression for an angle with marks for degrees and minutes, as in 12° 30' or 12d 30m 15s.
_WITH_SIGNS = re.compile(
    r"(?P<sign>[+\-−–]?)(?P<degrees>\d{1,3})\s?(?:°|º|d|deg)\s?(?P<minutes>\d{1,2})\s?['′’m]"
    rf"(?:\s?{_SECONDS}\s?(?:\"|″|”|''|′′|’’|s)?)?",
    re.IGNORECASE,
)
# Regular expression for an angle in degrees, minutes and seconds without marks, as in 12-30-15. A
# text that matches may also be a date or a time of day.
_WITHOUT_SIGNS = re.compile(
    rf"(?P<sign>[+\-−–]?)(?P<degrees>\d{{1,3}})[\-: ](?P<minutes>\d{{1,2}})[\-: ]{_SECONDS}"
)
# Regular expression for the words of a header that say that angles are in degrees, minutes and
# seconds.
_NAMED = re.compile(
    r"(?<![^\W_])d[-. :,/]?m[-. :,/]?s(?![^\W_])|\bdeg\w*[-. :,/]{1,2}min\w*[-. :,/]{1,2}sec"
    r"|°\s?['′]\s?(?:\"|″|'')|\bgrad[-. :,/]{1,2}min\w*[-. :,/]{1,2}sek"
    r"|度[-. :,/]?分[-. :,/]?秒|도[-. :,/]?분[-. :,/]?초",
    re.IGNORECASE,
)
# Regular expressions for the headers of columns with the minutes and the seconds of angles.
_HEADS_MINUTES = re.compile(r"\W*(?:arc[ -]?)?min(?:ut\w*)?\W*|['′’]", re.IGNORECASE)
_HEADS_SECONDS = re.compile(
    r"\W*(?:arc[ -]?)?se[ck](?:[ou]nd\w*)?\W*|\"|″|”|''|′′|’’", re.IGNORECASE
)
# Number of minutes in a degree, and of seconds in a minute.
_SIXTY = 60


def names_sexagesimal(header: str) -> bool:
    """Return whether a header says that its angles are in degrees, minutes and seconds."""
    return _NAMED.search(header) is not None


def check_angle_is_whole(place: str, headers: Sequence[str], angle: int | None) -> None:
    """Raise an `InputError` if two further columns hold the minutes and the seconds of the angles.

    An example is a table with the columns ``Deg``, ``Min`` and ``Sec``, of which only the first is
    taken for the angle.

    Parameters
    ----------
    place
        Name of the table in the error message.
    headers
        Headers of all columns.
    angle
        Index of the column of angles from 0; None if there is none.
    """
    if angle is None or len(headers) < angle + 3:
        return
    names = list(headers[angle : angle + 3])
    if _HEADS_MINUTES.fullmatch(names[1]) and _HEADS_SECONDS.fullmatch(names[2]):
        shown = ", ".join(repr(name) for name in names)
        raise InputError(
            f"{place}: the angle must stand in one column, got {shown}. Join them, for example"
            " 12°30'15\"."
        )


def columns_in_sexagesimal(rows: Iterable[Sequence[str]]) -> set[int]:
    """Return the indices of the columns whose angles are in degrees, minutes and seconds.

    A column is included if one of its cells says so, such as the header ``Angle [dms]``.
    """
    columns = set()
    for cells in rows:
        columns |= {column for column, cell in enumerate(cells) if names_sexagesimal(cell)}
    return columns


def seconds_in(cell: str, *, is_named: bool = False) -> str:
    """Return the size of an angle in arcseconds as a text: "45015" for 12° 30' 15".

    The decimal mark of the seconds is kept. The text is empty if the cell is not an angle in
    degrees, minutes and seconds.

    Parameters
    ----------
    cell
        The cell.
    is_named
        Whether the header of the column says that its angles are in degrees, minutes and seconds.
        An angle may then be written as 12-30-15 or 12:30:15.
    """
    match = _WITH_SIGNS.fullmatch(cell)
    if match is None and is_named:
        match = _WITHOUT_SIGNS.fullmatch(cell)
    if match is None:
        return ""
    minutes = int(match["minutes"])
    seconds = int(match["seconds"] or 0)
    if minutes >= _SIXTY or seconds >= _SIXTY:
        return ""
    total = (int(match["degrees"]) * _SIXTY + minutes) * _SIXTY + seconds
    decimals = ""
    if match["decimals"]:
        decimals = f"{match['mark']}{match['decimals']}"
    return f"{match['sign']}{total}{decimals}"
