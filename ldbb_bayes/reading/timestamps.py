"""Timestamps in files of readings: the date and the time of day at which a test was run.

An example is the line ``Start time: 20.11.2026 14:03:12``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, timedelta
from enum import IntEnum
from typing import NamedTuple

from ldbb_bayes.reading.dates import iso_date
from ldbb_bayes.reading.numerals import DAY_S, HOUR_S
from ldbb_bayes.reading.words import LONGEST_TEXT, WORDS

__all__ = [
    "Rank",
    "Timestamp",
    "epoch_stamp",
    "epoch_stamp_in_line",
    "stamp_in_name",
    "stamps_in",
    "unread_stamp",
    "without_stamps",
]

# Regular expressions for words that precede a timestamp in a line; the keys are kinds of words,
# such as "start".
_WORDS = {kind: re.compile(words, re.IGNORECASE) for kind, words in WORDS["stamps"].items()}
_MONTH = WORDS["parts"]["month"]
_MARKS = WORDS["stamps"]
# Regular expressions for dates and times in East Asian files, such as 2026年11月20日 and 14时3分,
# and for a word for the morning or afternoon in front of a time.
_DATE_WITH_MARKS = re.compile(
    rf"(?P<year>\d{{4}})\s?{_MARKS['year']}\s?(?P<month>\d\d?)\s?{_MARKS['month']}"
    rf"\s?(?P<day>\d\d?)\s?{_MARKS['day']}"
)
_TIME_WITH_MARKS = re.compile(
    rf"(?P<hours>\d\d?)\s?{_MARKS['hours']}\s?(?P<minutes>\d\d?)\s?{_MARKS['minutes']}"
    rf"(?:\s?(?P<seconds>\d\d?)\s?{_MARKS['seconds']})?"
)
_HALF_DAY_IN_FRONT = re.compile(
    rf"(?:(?P<morning>{_MARKS['morning']})|{_MARKS['afternoon']})\s?(?P<time>\d\d?:\d\d(?::\d\d)?)"
)
# Regular expression for Greek and Turkish words for the morning or afternoon behind a time.
_HALF_DAY_BEHIND = re.compile(
    r"(?P<time>\d\d?:\d\d(?::\d\d)?)\s?"
    rf"(?:(?P<morning>{_MARKS['morning_behind']})|(?:{_MARKS['afternoon_behind']}))(?!\w)",
    re.IGNORECASE,
)
# Regular expression for a place where no unit of a load follows, as one does in 20261120_1000N.
_NO_UNIT_BEHIND = r"(?![ _]?(?:k?N|daN|lbf?|kgf|kp|m?bar|[Mk]?Pa|psi|mm)(?![^\W_]))"
# Regular expression for a date and a time of day that are written as one number of twelve, fourteen
# or seventeen digits, such as 20261120140312 or 20261120T140312. The last three of seventeen digits
# are milliseconds.
_STAMP_OF_DIGITS = re.compile(
    r"(?<![\d.,])(?P<year>20\d\d)(?P<month>[01]\d)(?P<day>[0-3]\d)[T_-]?"
    r"(?P<hours>[0-2]\d)(?P<minutes>[0-5]\d)"
    r"(?:(?P<seconds>[0-5]\d)(?:\.?(?P<milliseconds>\d{3}))?)?"
    rf"(?![.,]?\d){_NO_UNIT_BEHIND}"
)
# Regular expression for a time of day with points and the word Uhr, such as 14.30 Uhr.
_TIME_WITH_POINTS = re.compile(
    r"(?<![\d.,:])(?P<hours>\d\d?)\.(?P<minutes>\d\d)(?:\.(?P<seconds>\d\d))?(?=\s?uhr\b)", re.I
)
# Regular expression for a time of day with an h behind the hours, such as 14h30. It may also be a
# duration.
_TIME_WITH_H = re.compile(
    r"(?<![\w.,:])(?P<hours>\d\d?)\s?h\s?(?P<minutes>[0-5]\d)(?![\w:])(?![.,]\d)", re.I
)
# Regular expression for a date with words between day, month and year, such as 10 de junio de 2026.
_DATE_WITH_WORDS = re.compile(
    rf"(?P<day>\d\d?) de (?P<month>{_MONTH}) del? (?P<year>\d{{4}})", re.I
)
# Regular expression for a date. The year has four digits; after a point or a slash, it may also
# have two.
_DATE = (
    r"(?:\d{4}[-/.]\d\d?[-/.]\d\d?"
    rf"|\d\d?\.\s?(?:\d\d?\.|{_MONTH})\s?(?:\d{{4}}|\d\d)(?!\d)"
    rf"|\d\d?[- ]{_MONTH}[- ]?\d{{4}}|{_MONTH} \d\d?,\s?\d{{4}}"
    r"|\d\d?/\d\d?/(?:\d{4}|\d\d)(?!\d)|\d\d?-\d\d?-\d{4})"
)
# Local time minus UTC [h] for abbreviations of time zones with a single meaning. CST, IST and BST
# have several.
_ZONES_H = {
    "WET": 0,
    "WEST": 1,
    "CET": 1,
    "CEST": 2,
    "MEZ": 1,
    "MESZ": 2,
    "EET": 2,
    "EEST": 3,
    "MSK": 3,
    "JST": 9,
    "KST": 9,
    "AEST": 10,
    "AEDT": 11,
    "EST": -5,
    "EDT": -4,
    "CDT": -5,
    "MST": -7,
    "MDT": -6,
    "PST": -8,
    "PDT": -7,
}
# Regular expression for a time zone in capitals, such as CET.
_ZONE_IN_LETTERS = rf"(?-i:{'|'.join(_ZONES_H)})(?!\w)"
# Regular expression for a time of day, with or without seconds, AM or PM, and time zone.
_TIME = (
    r"(?P<hours>\d{1,2}):(?P<minutes>\d\d)(?::(?P<seconds>\d\d(?:[.,]\d{1,9})?))?(?![\d:])"
    r"(?:\s?(?P<half_day>[AaPp])\.?\s?[Mm]\b\.?)?"
    rf"(?P<zone>Z\b|\s?(?:{_ZONE_IN_LETTERS})|\s?(?:UTC|GMT)(?!\s?[+-])"
    r"|\s?(?:UTC|GMT)?\s?[+-]\d\d:?\d\d(?![\d:])|\s?(?:UTC|GMT)\s?[+-]\d\d?(?![\d:]))?"
)
# Regular expression for a date and a time of day in either order, for a date alone, or for a time
# of day alone.
_STAMP = re.compile(
    rf"(?<![\d./+-])(?<!\d[:,])(?:(?P<date>{_DATE})"
    rf"(?:(?:T|[ ,;|\t]{{1,3}}|\s+(?:{_MARKS['between']})\s+){_TIME})?"
    rf"|{_TIME.replace('?P<', '?P<only_')}(?:[ ,;|\t]{{1,3}}(?:on |am )?(?P<date_after>{_DATE}))?)",
    re.IGNORECASE,
)
# Regular expression for a timestamp in the name of a file, such as 2026-11-20_14-03-12,
# 20261120T1403 or 20261120140312. In 2026-11-20_1000N, the last number is no time but a load.
_STAMP_IN_NAME = re.compile(
    r"(?<!\d)(?P<year>20\d\d)[-_.]?(?P<month>[01]\d)[-_.]?(?P<day>[0-3]\d)[-_ T]{0,2}"
    r"(?P<hours>[0-2]\d)(?P<mark>[-_.:h]?)(?P<minutes>[0-5]\d)"
    r"(?:(?:(?P=mark)|m)(?P<seconds>[0-5]\d)(?:\d{3})?)?"
    rf"(?!\d){_NO_UNIT_BEHIND}"
)
# Regular expression for a date whose first two numbers may be day and month, or month and day.
_OPEN_DATE = re.compile(r"(\d\d?)[/-](\d\d?)[/-](\d{4}|\d\d)")
_CENTURY = 2000
_MINUTE_S = 60.0
# Earliest and latest time of a test, in seconds since 1970: the beginning of 2000 and of 2100.
_EPOCH_S = (946_684_800.0, 4_102_444_800.0)
# Day that spreadsheets count as 0.
_DAY_ZERO = datetime(1899, 12, 30, tzinfo=UTC)
# Regular expression for a date and time that a spreadsheet writes as a number of days.
_SERIAL = re.compile(r"\d{5}[.,]\d+")
# Regular expression for a line that is nothing but a label and a number.
_LABELLED_NUMBER = re.compile(r"\W*(?P<label>[^\d:=;,|\t]+)[\s:=;,|\t]+(?P<number>\d[\d.,]*\d)\W*")


class Rank(IntEnum):
    """Kinds of places in a file that may state when a test was run, the most reliable first."""

    COLUMN = 0  #: the start time of a test is in the first row of a column of times
    START = 1  #: the start time of a test is in a line with a word such as "start"
    TEST = 2  #: the start time of a test is in a line with a word such as "time" or "measured"
    ALONE = 3  #: the start time of a test is in a line that holds only a date and a time
    NAME = 4  #: the start time of a test is in the name of the test or of its file


@dataclass(frozen=True)
class Timestamp:
    """Date, time of day, or both, that a file states for a test."""

    #: kind of place where the timestamp was found, such as a column or the name of the file; a
    #: place with a smaller rank is more reliable
    rank: Rank
    text: str  #: the timestamp (date, time of day, or both) as the file writes it
    #: date that the timestamp means if the day stands before the month; None if the timestamp
    #: states no date, or a date that does not exist
    day_first: date | None = None
    #: date that the timestamp means if the month stands before the day; equal to ``day_first`` if
    #: the date can be read only in one way; None if the timestamp states no date, or a date that
    #: does not exist
    month_first: date | None = None
    seconds: float | None = None  #: time of day as seconds since midnight; None for a date alone
    zone_s: float | None = None  #: local time minus UTC [s]; None if no time zone is stated

    @property
    def has_date(self) -> bool:
        """Whether the timestamp states a date."""
        return self.day_first is not None or self.month_first is not None


def stamps_in(text: str, rank: Rank | None = None) -> list[Timestamp]:
    """Return the timestamps in a line that may state when a test was run, from left to right.

    A timestamp is a date, a time of day, or both. A timestamp is returned if the words before it
    say that the test was run, started or recorded at this time. If ``rank`` is None, a timestamp
    without words before it is returned only if it has both a date and a time of day. Durations, and
    the times of other events such as a calibration or the end of the test, are left out.

    Parameters
    ----------
    text
        The line. For a cell of a table, it is ``header: cell``.
    rank
        Kind of place from which the line comes, for example a column of times. If None, the kind is
        found from the words in the line.
    """
    stamps = []
    end = 0
    text = _in_usual_form(text[:LONGEST_TEXT])
    for match in _STAMP.finditer(text):
        words_before = text[end : match.start()]
        end = match.end()
        rank_of_words = _rank_from_words(words_before)
        if rank_of_words is None:
            continue
        if rank is None and rank_of_words == Rank.ALONE and not _has_date_and_time(match):
            continue
        if _is_duration(words_before, match):
            continue
        stamp = _stamp_of(match, rank_of_words if rank is None else rank)
        if stamp is not None:
            stamps.append(stamp)
    return stamps


def unread_stamp(text: str) -> str:
    """Return ``text`` if it contains a date and a time of day whose meaning is not known.

    The meaning is not known if the words before the date are not understood. The result is empty if
    the text has no date with a time of day. It is also empty if the words say that a test was run
    at this time, or that something else happened, such as a calibration.
    """
    end = 0
    text = _in_usual_form(text[:LONGEST_TEXT])
    for match in _STAMP.finditer(text):
        words_before = text[end : match.start()]
        end = match.end()
        is_understood = _rank_from_words(words_before) is not None
        if _has_date_and_time(match) and not (
            is_understood or _WORDS["other"].search(words_before)
        ):
            return text.strip()
    return ""


def _in_usual_form(text: str) -> str:
    """Replace dates and times with words or marks, such as 14.30 Uhr, by usual forms.

    For example, ``2026年11月20日 14时3分`` becomes ``2026-11-20 14:03``, ``下午2:03`` becomes
    ``2:03 PM``, ``10 de junio de 2026`` becomes ``10 junio 2026``, and ``20261120140312`` becomes
    ``2026-11-20 14:03:12``. A time such as ``14h30`` becomes ``14:30`` only beside a word for a
    start, a date or a clock; it may be a duration elsewhere. Other dates and times are not changed.
    """
    text = _DATE_WITH_MARKS.sub(r"\g<year>-\g<month>-\g<day>", text)
    text = _TIME_WITH_MARKS.sub(_time_without_marks, text)
    text = _HALF_DAY_IN_FRONT.sub(_time_with_half_day, text)
    text = _HALF_DAY_BEHIND.sub(_time_with_half_day, text)
    text = _STAMP_OF_DIGITS.sub(_stamp_with_marks, text)
    text = _TIME_WITH_POINTS.sub(_time_without_marks, text)
    if _WORDS["start"].search(text) or _WORDS["clock"].search(text):
        text = _TIME_WITH_H.sub(_time_without_marks, text)
    return _DATE_WITH_WORDS.sub(r"\g<day> \g<month> \g<year>", text)


def _stamp_with_marks(match: re.Match[str]) -> str:
    """Return a date and time that are one number, as in ``2026-11-20 14:03:12.250``.

    ``match`` matches the number. Seconds and milliseconds are left out if it does not state them.
    """
    text = f"{match['year']}-{match['month']}-{match['day']} {match['hours']}:{match['minutes']}"
    if match["seconds"]:
        text += f":{match['seconds']}"
    if match["milliseconds"]:
        text += f".{match['milliseconds']}"
    return text


def _time_without_marks(match: re.Match[str]) -> str:
    """Return a time of day with marks such as 时 and 分 in the usual form: 14:03 for 14时3分."""
    numbers = [number.zfill(2) for number in match.groups() if number]
    return ":".join(numbers)


def _time_with_half_day(match: re.Match[str]) -> str:
    """Return a time with AM or PM, such as ``2:03 PM``, for a time such as 下午2:03.

    ``match`` matches a word for morning or afternoon and the time. In East Asian languages the word
    stands before the time.
    """
    return f"{match['time']} {'AM' if match['morning'] else 'PM'}"


def without_stamps(text: str) -> str:
    """Return a text with a blank in place of each timestamp (a date, a time of day, or both)."""
    return _STAMP.sub(" ", text)


def _rank_from_words(words: str) -> Rank | None:
    """Return how reliable a timestamp is as the time of a test, judged by the words before it.

    The result is ``Rank.START`` after a word such as "start", ``Rank.TEST`` after a word such as
    "measured", and ``Rank.ALONE`` if there is no word. It is None if the words are not understood,
    or if they show that the timestamp is not the time of a test. ``words`` is the text before the
    timestamp. It begins at the previous timestamp in the line, or at the beginning of the line if
    there is none.
    """
    if _WORDS["other"].search(words):
        return None
    if _WORDS["start"].search(words):
        return Rank.START
    if _WORDS["test"].search(words):
        return Rank.TEST
    if re.search(r"\w", words):
        return None
    return Rank.ALONE


def _has_date_and_time(match: re.Match[str]) -> bool:
    """Return whether a matched timestamp states both a date and a time of day."""
    return all(_parts_of_stamp(match).get(name) for name in ("date", "hours"))


def _is_duration(words: str, match: re.Match[str]) -> bool:
    """Return whether a timestamp may be a duration, such as ``Time: 00:01:28``.

    A timestamp may be a duration if it has no date and its hour is zero. It is not taken as a
    duration if the ``words`` before it are about a start or a clock.
    """
    fields = _parts_of_stamp(match)
    if "date" in fields or int(fields["hours"]) > 0:
        return False
    return not (_WORDS["start"].search(words) or _WORDS["clock"].search(words))


def _parts_of_stamp(match: re.Match[str]) -> dict[str, str]:
    """Return a dict with the parts of a matched timestamp, such as date and hours.

    The keys are the names of the parts. Parts that the timestamp does not state are left out.
    """
    fields = {}
    for name, text in match.groupdict().items():
        if text:
            fields[name.removeprefix("only_").removesuffix("_after")] = text
    return fields


def _stamp_of(match: re.Match[str], rank: Rank) -> Timestamp | None:
    """Return the timestamp in ``match``, or None if its date or time does not exist.

    ``match`` is a match of the regular expression for timestamps, and ``rank`` is the kind of place
    that states the timestamp.
    """
    fields = _parts_of_stamp(match)
    day_first = None
    month_first = None
    if "date" in fields:
        dates = _dates_of(fields["date"])
        day_first = dates.day_first
        month_first = dates.month_first
        if day_first is None and month_first is None:
            return None
    seconds = None
    zone_s = None
    if "hours" in fields:
        seconds = _seconds_of(fields)
        if seconds is None:
            return None
        zone_s = _zone_of(fields.get("zone", ""))
        if _is_end_of_span(fields):
            zone_s = None
    # A spreadsheet writes a date without a time as midnight.
    if seconds == 0.0 and "date" in fields:
        seconds = None
    return Timestamp(rank, match[0].strip(), day_first, month_first, seconds, zone_s)


class _Dates(NamedTuple):
    """The two dates that a text may mean.

    The two dates differ only for a text such as 03/04/2026, in which the day or the month may stand
    first.
    """

    # date that the text means if the day stands before the month; None if this date does not exist
    day_first: date | None
    # date that the text means if the month stands before the day; None if this date does not exist
    month_first: date | None


def _dates_of(text: str) -> _Dates:
    """Return the two dates that a text such as 03/04/2026 may mean: day first, and month first.

    Both dates are equal if day and month cannot be confused, as in 2026-11-20. A date that does not
    exist is None.
    """
    open_date = _OPEN_DATE.fullmatch(text)
    if open_date is None:
        day = _certain_date(text)
        return _Dates(day, day)
    first = int(open_date[1])
    second = int(open_date[2])
    year = _full_year(open_date[3])
    return _Dates(_date_or_none(year, second, first), _date_or_none(year, first, second))


def _certain_date(text: str) -> date | None:
    """Return the date that a text states in a form in which day and month cannot be confused.

    An example is 2026-11-20 or 20.11.26. Return None if the date does not exist.
    """
    short_year = re.fullmatch(r"(?!\d{4})(.*\.\s?)(\d\d)", text)
    if short_year is not None:
        text = f"{short_year[1]}{_full_year(short_year[2])}"
    iso = iso_date(text)
    if not iso:
        return None
    return date.fromisoformat(iso)


def _full_year(digits: str) -> int:
    """Return a year as a number; two digits such as 26 mean a year of this century."""
    if len(digits) == 2:
        return _CENTURY + int(digits)
    return int(digits)


def _date_or_none(year: int, month: int, day: int) -> date | None:
    """Return the date of a year, month and day; None if it does not exist."""
    try:
        return date(year, month, day)
    except ValueError:
        return None


def _seconds_of(fields: dict[str, str]) -> float | None:
    """Return the time of day in seconds since midnight; None for a time that does not exist.

    ``fields`` holds the hours, the minutes and, if they are stated, the seconds and AM or PM, as
    texts.
    """
    hours = int(fields["hours"])
    minutes = int(fields["minutes"])
    seconds = float(fields.get("seconds", "0").replace(",", "."))
    if "half_day" in fields:
        if not 1 <= hours <= 12:
            return None
        hours = hours % 12
        if fields["half_day"] in "pP":
            hours += 12
    if hours > 23 or minutes > 59 or seconds >= 60.0:
        return None
    return HOUR_S * hours + _MINUTE_S * minutes + seconds


def _is_end_of_span(fields: dict[str, str]) -> bool:
    """Return whether the zone of a timestamp may be the end of a span, as in ``10:20-10:30``.

    ``fields`` holds the parts of the timestamp. In a span, neither a date nor seconds are stated.
    """
    zone = fields.get("zone", "").strip()
    return zone[:1] in ("+", "-") and "date" not in fields and "seconds" not in fields


def _zone_of(text: str) -> float | None:
    """Return local time minus UTC [s] for the text of a time zone; None for an empty text.

    Examples are ``Z``, ``CET``, ``UTC+1`` and ``+01:00``.
    """
    word = text.strip()
    if not word:
        return None
    if word in _ZONES_H:
        return HOUR_S * _ZONES_H[word]
    offset = re.search(r"([+-])(\d\d?)(?::?(\d\d))?$", word)
    if offset is None:
        return 0.0
    size = HOUR_S * int(offset[2]) + _MINUTE_S * int(offset[3] or 0)
    return float(f"{offset[1]}1") * size


def stamp_in_name(names: Iterable[str]) -> Timestamp | None:
    """Return the timestamp in the first name that contains one; None if no name contains one.

    A timestamp is a date (year, month, day) with a time of day, with or without seconds. Names with
    a date or time that does not exist are left out. ``names`` are the names of a test and its file,
    such as ``2026-11-20_14-03-12 36N``.
    """
    for name in names:
        match = _STAMP_IN_NAME.search(name[:LONGEST_TEXT])
        if match is None:
            continue
        day = _date_or_none(int(match["year"]), int(match["month"]), int(match["day"]))
        fields = {key: match[key] or "0" for key in ("hours", "minutes", "seconds")}
        seconds = _seconds_of(fields)
        if day is not None and seconds is not None:
            return Timestamp(Rank.NAME, match[0], day, day, seconds)
    return None


def epoch_stamp(header: str, text: str) -> Timestamp | None:
    """Return the timestamp for a cell that states a time as a number.

    The number is one of seconds or milliseconds since 1970, or the days that a spreadsheet counts.

    Parameters
    ----------
    header
        Header of a column. For days, it must have a word for a date.
    text
        First cell of this column.

    Returns
    -------
    Timestamp or None
        None if the text is not such a number, or if the header does not say that the column holds
        the time of a test.
    """
    if _rank_from_words(header) not in (Rank.START, Rank.TEST):
        return None
    when = None
    if re.fullmatch(r"\d{9,13}(?:\.\d+)?", text):
        when = _time_since_1970(float(text))
    elif _SERIAL.fullmatch(text) and _WORDS["date"].search(header):
        when = _DAY_ZERO + timedelta(seconds=round(DAY_S * float(text.replace(",", "."))))
    if when is None or not _EPOCH_S[0] <= when.timestamp() <= _EPOCH_S[1]:
        return None
    midnight = when.replace(hour=0, minute=0, second=0, microsecond=0)
    day = when.date()
    seconds = (when - midnight).total_seconds()
    if not _SERIAL.fullmatch(text):
        return Timestamp(Rank.COLUMN, text, day, day, seconds, 0.0)
    # A spreadsheet writes a date without a time as midnight.
    return Timestamp(Rank.COLUMN, text, day, day, seconds or None)


def _time_since_1970(number: float) -> datetime:
    """Return the time for a number of seconds, or of milliseconds, since 1970."""
    seconds = number / 1e3 if number > _EPOCH_S[1] else number
    return datetime.fromtimestamp(seconds, tz=UTC)


def epoch_stamp_in_line(text: str) -> Timestamp | None:
    """Return the timestamp of a line such as ``Date: 45352.4271`` (see `epoch_stamp`).

    Return None for any other line.
    """
    match = _LABELLED_NUMBER.fullmatch(text[:LONGEST_TEXT])
    if match is None:
        return None
    stamp = epoch_stamp(match["label"], match["number"])
    rank = _rank_from_words(match["label"])
    return None if stamp is None or rank is None else replace(stamp, rank=rank)
