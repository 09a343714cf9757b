"""Sign of readings, as a header or a line above the table says it in words.

An example is the line ``Positive readings: bar shorter``.
"""

from __future__ import annotations

import re

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.bar_extensions import names_extension
from ldbb_bayes.reading.names import LOAD_IN_NAME
from ldbb_bayes.reading.open_question import OpenQuestionError
from ldbb_bayes.reading.recording import Recording
from ldbb_bayes.reading.words import LONGEST_TEXT, WORDS, comparable

__all__ = ["sign_of_readings"]

_WORDS = WORDS["reading_sign"]
# Pattern of a word for the sign of a reading, or for what the bar then is.
_WORD = re.compile(
    rf"(?P<shorter>{_WORDS['shorter']})|(?P<longer>{_WORDS['longer']})"
    rf"|(?P<positive>{_WORDS['positive']})|(?P<negative>{_WORDS['negative']})",
    re.IGNORECASE,
)
_OTHER_SUBJECT = re.compile(_WORDS["other"], re.IGNORECASE)
# Patterns of a line about readings or their sign, of words that deny, and that turn the sign.
_SUBJECT = re.compile(_WORDS["subject"], re.IGNORECASE)
_DENIED = re.compile(_WORDS["denied"], re.IGNORECASE)
_TURNED = re.compile(_WORDS["turned"], re.IGNORECASE)
# Pattern of a number other than −1, which shows that a line states a value and no sign.
_OTHER_NUMBER = re.compile(r"(?<![^\W_])\d(?<![-−]1)(?<![-−] 1)|(?<![^\W_])\d{2}")
# Pattern of a unit in brackets at the beginning of a header.
_UNIT_IN_FRONT = re.compile(r"^\s*[\[(<{][^\])>}]*[\])>}]\s*(?=[-−–\w])")
# Pattern of a header of readings that turns their sign, or may do so.
_TURNED_HEADER = re.compile(_WORDS["header"])
# Pattern of a word in the name of a file for readings whose sign is turned.
_TURNED_NAME = re.compile(r"(?<![^\W\d_])(?:invert\w*|negated?|reversed|flipped)", re.IGNORECASE)
# Pattern of a line that says what a sign of readings means.
_MEANING = re.compile(_WORDS["meaning"], re.IGNORECASE)
# Pattern of a text that writes the reading as nominal less actual radius, and of a header that
# writes it with a minus.
_NOMINAL_LESS_ACTUAL = re.compile(_WORDS["nominal_less_actual"])
_MINUS = re.compile(_WORDS["minus"])
# Sign of the readings for each pair of the sign of a number and what the bar then is.
_SIGNS = {
    frozenset({"positive", "longer"}): 1,
    frozenset({"negative", "shorter"}): 1,
    frozenset({"positive", "shorter"}): -1,
    frozenset({"negative", "longer"}): -1,
}
# An error message shows at most this number of characters of a text from a file.
_TEXT_SHOWN = 60


def sign_of_readings(recording: Recording) -> int:
    """Return the sign with which readings are multiplied: −1 if a longer bar reads less, else 1.

    The user's sign counts first, then the words of the file, which are noted.

    Parameters
    ----------
    recording
        The test as the file holds it.

    Raises
    ------
    InputError
        For words that contradict each other, or that name both signs and do not say which is which.
    """
    stated = recording.layout.sign
    sources = _stated_signs(recording)
    if stated is not None:
        if sources and stated not in sources:
            source = next(iter(sources.values()))
            recording.note("sign of the reading", f"{stated}, as given", f"{source}", "--sign")
        return stated
    if len(sources) > 1:
        raise InputError(
            f"{recording.place}: the sign of the readings must be said once, got a positive one for"
            f" a longer bar in {sources[1]} and for a shorter one in {sources[-1]}. Give --sign."
        )
    if not sources:
        return 1
    sign, source = next(iter(sources.items()))
    longer = "positive" if sign == 1 else "negative"
    recording.note("sign of the reading", f"{sign}: a longer bar is {longer}", source, "--sign")
    return sign


def _stated_signs(recording: Recording) -> dict[int, str]:
    """Return the signs that the header of readings and lines above state, each with its source.

    Raise an `OpenQuestionError` for words whose meaning is open, if the user states no sign.
    """
    header = recording.heading.headers[recording.heading.roles["reading"]]
    texts = {f"the header {header!r}": header}
    for line, text in (*recording.lines_of_all_tests, *recording.heading.lines_above):
        texts[f"line {line}"] = text
    sources: dict[int, str] = {}
    _note_names(recording)
    if _MINUS.search(_words_of_header(header)):
        sources[-1] = f"the header {header!r}"
    for source, text in texts.items():
        if _NOMINAL_LESS_ACTUAL.search(_words_of_header(text)):
            sources.setdefault(-1, source)
            continue
        words = _words_in(text)
        sign = None
        if words:
            sign = _sign_of(words)
        elif not (_turns_sign(text) or _is_turned_header(source, text)):
            _note_unread(recording, source, text)
            continue
        if sign is not None:
            sources.setdefault(sign, source)
        elif recording.layout.sign is None:
            raise OpenQuestionError(
                f"{recording.place}: one sign of the readings must mean a longer bar, got"
                f" {text.strip()[:_TEXT_SHOWN]!r} in {source}. Say which: --sign 1 (positive is"
                " longer) or -1.",
                "sign",
                ("1", "-1"),
            )
    return sources


def _words_of_header(header: str) -> str:
    """Return a header in small letters, with blanks for underscores, without a unit in front."""
    words = comparable(header[:LONGEST_TEXT]).replace("_", " ")
    return _UNIT_IN_FRONT.sub("", words)


def _note_names(recording: Recording) -> None:
    """Note words in names of files that may turn the sign of readings."""
    for name in recording.names_of_files():
        turned = _TURNED_NAME.search(name)
        if turned is not None and recording.layout.sign is None:
            reason = f"its name says {turned[0]!r}, not understood"
            recording.note("sign of the reading", "1: a longer bar is positive", reason, "--sign")


def _note_unread(recording: Recording, source: str, text: str) -> None:
    """Note a line that may say what the sign of readings means, but is not understood."""
    text = text[:LONGEST_TEXT]
    if _OTHER_SUBJECT.search(text) or _OTHER_NUMBER.search(text) or not _MEANING.search(text):
        return
    if recording.layout.sign is None and source.startswith("line"):
        reason = f"{source} says {text.strip()[:_TEXT_SHOWN]!r}, not understood"
        recording.note("sign of the reading", "1: a longer bar is positive", reason, "--sign")


def _is_turned_header(source: str, text: str) -> bool:
    """Return whether a text is a header of readings that may have the other sign.

    An example is ``Shortening [um]``. A header with a minus in front is understood.
    """
    words = _words_of_header(text)
    is_understood = _MINUS.search(words) is not None
    is_turned = _TURNED_HEADER.search(words) is not None
    return source.startswith("the header") and is_turned and not is_understood


def _turns_sign(text: str) -> bool:
    """Return whether a text turns the sign of readings, as ``Readings inverted``.

    Such a text is not about angles or loads, and holds no number but −1.
    """
    text = LOAD_IN_NAME.sub("", text[:LONGEST_TEXT])
    if _OTHER_SUBJECT.search(text) or _OTHER_NUMBER.search(text) or _DENIED.search(text):
        return False
    return _SUBJECT.search(text) is not None and _TURNED.search(text) is not None


def _words_in(text: str) -> list[str]:
    """Return the kinds of words for signs and lengths in a text about the sign of readings.

    The list is empty for a text that is not about it.
    """
    text = text[:LONGEST_TEXT]
    if _OTHER_SUBJECT.search(text) or names_extension(text):
        return []
    words = [str(match.lastgroup) for match in _WORD.finditer(text)]
    has_sign = "positive" in words or "negative" in words
    has_length = "shorter" in words or "longer" in words
    if not (has_sign and has_length):
        return []
    return words


def _sign_of(words: list[str]) -> int | None:
    """Return the sign of readings that the words of a text mean, two by two; None if unclear."""
    signs = set()
    for first, second in zip(words[::2], words[1::2], strict=False):
        signs.add(_SIGNS.get(frozenset({first, second})))
    if len(words) % 2 or len(signs) != 1:
        return None
    return signs.pop()
