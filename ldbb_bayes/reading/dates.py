"""Conversion of dates to ISO 8601. Months may be numbers, or names in several languages."""

from __future__ import annotations

import re
from datetime import date

__all__ = ["iso_date"]

# For each month, the beginnings of its English name and of the names in German, Spanish,
# Portuguese, Italian and French that begin differently.
_MONTHS = (
    ("jan", "ene", "gen"),
    ("feb", "fev", "fév"),
    ("mar", "mär"),
    ("apr", "abr", "avr"),
    ("may", "mai", "mag"),
    ("jun", "giu", "juin"),
    ("jul", "lug", "juil"),
    ("aug", "ago", "aoû", "aou"),
    ("sep", "set"),
    ("oct", "okt", "out", "ott"),
    ("nov",),
    ("dec", "dez", "dic", "déc"),
)


def iso_date(text: str) -> str:
    """Return a date as text in ISO 8601; an empty text if no such date exists.

    ``text`` is a date with the year in four digits, such as 2026-11-20, 20.11.2026, 20-Nov-2026 or
    November 20, 2026.
    """
    first, second, third = re.findall(r"\d+|[^\W\d_]+", text.casefold())
    day = first
    month = second
    year = third
    if first.isalpha():  # the month stands first, as in March 4, 2026
        day = second
        month = first
    elif len(first) == 4:  # the year stands first, as in 2026-03-04
        year = first
        day = third
    if month.isalpha():
        month = _month_number(month)
    try:
        return date(int(year), int(month), int(day)).isoformat()
    except ValueError:
        return ""


def _month_number(name: str) -> str:
    """Return the number of a month as text, such as "3" for March.

    Return "0" if the word is not the name of a month.
    """
    for k, beginnings in enumerate(_MONTHS, start=1):
        if name.startswith(beginnings):
            return str(k)
    return "0"
