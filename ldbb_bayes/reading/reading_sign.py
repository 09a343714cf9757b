"""Sign of readings that a header or a line above the table states in words.

An example is the line ``Positive readings: bar shorter``.
"""

from __future__ import annotations

import re

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.bar_extensions import names_extension
from ldbb_bayes.reading.cited_lines import TEXT_SHOWN, CitedLine, cited_line, quoted_line
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.line_parts import divide_line, finer_divisions, segments_of_line
from ldbb_bayes.reading.names import LOAD_IN_NAME
from ldbb_bayes.reading.open_question import OpenQuestionError
from ldbb_bayes.reading.recording import Recording
from ldbb_bayes.reading.travel_direction import senses_in
from ldbb_bayes.reading.words import LONGEST_TEXT, WORDS, comparable

__all__ = [
    "is_about_sign",
    "leaves_difference_unread",
    "names_sign_or_length",
    "sign_of_readings",
]

_WORDS = WORDS["reading_sign"]
# Regular expression for a word about the sign of a reading, such as "positive", or a word which
# says that the bar is longer or shorter, such as "elongated".
_WORD = re.compile(
    rf"(?P<shorter>{_WORDS['shorter']})|(?P<longer>{_WORDS['longer']})"
    rf"|(?P<positive>{_WORDS['positive']})|(?P<negative>{_WORDS['negative']})",
    re.IGNORECASE,
)
_OTHER_SUBJECT = re.compile(_WORDS["other"], re.IGNORECASE)
# Regular expression for words which show that a line is about readings or their sign.
_SUBJECT = re.compile(_WORDS["subject"], re.IGNORECASE)
# Regular expression for negations, such as "not".
_DENIED = re.compile(_WORDS["denied"], re.IGNORECASE)
# Regular expression for words which say that the sign of readings is reversed.
_TURNED = re.compile(_WORDS["turned"], re.IGNORECASE)
# Regular expression for a number other than −1. A line with such a number states a value and not a
# sign.
_OTHER_NUMBER = re.compile(r"(?<![^\W_])\d(?<![-−]1)(?<![-−] 1)|(?<![^\W_])\d{2}")
# Regular expression for an angle, such as "30 deg". A text with an angle is not about readings.
_ANGLE = re.compile(r"\d ?(?:°(?! ?[CF]\b)|deg(?:rees?)?\b(?! ?[CF]\b))", re.IGNORECASE)
# Regular expression for a unit in brackets at the beginning of a header.
_UNIT_IN_FRONT = re.compile(r"^\s*[\[(<{][^\])>}]*[\])>}]\s*(?=[-−–\w])")
# Regular expression for the unit "in" (inch) behind a dash at the end of a header, as in "dR - in".
# The dash is then no minus sign, and "in" does not mean inward.
_INCHES_AT_END = re.compile(r"\s+[-−–]\s*in\s*$", re.IGNORECASE)
# Regular expression for a header which shows that the sign of its readings is or may be reversed.
_TURNED_HEADER = re.compile(_WORDS["header"])
# Regular expression for a word in the name of a file which shows that the sign of readings is
# reversed.
_TURNED_NAME = re.compile(r"(?<![^\W\d_])(?:invert\w*|negated?|reversed|flipped)", re.IGNORECASE)
# Regular expression for a line that says what a sign of readings means.
_MEANING = re.compile(_WORDS["meaning"], re.IGNORECASE)
# Regular expression for the label "Sign" with a text after it, such as "Sign: as drawn", which may
# state the sign of readings.
_LABEL = re.compile(_WORDS["label"], re.IGNORECASE)
# Regular expression for words for positive or negative readings, such as "positive values".
_NAMED = re.compile(_WORDS["named"], re.IGNORECASE)
# Regular expression for a word such as "means", which shows that a text defines something.
_MEANS = re.compile(_WORDS["means"], re.IGNORECASE)
# Regular expressions for the meaning of a sign: "+ = in" or "+ = out", and "in = +" or "out = +".
_IN_OR_OUT = re.compile(_WORDS["in_or_out"], re.IGNORECASE)
_IN_OR_OUT_FIRST = re.compile(_WORDS["in_or_out_first"], re.IGNORECASE)
# Regular expression for a text that defines the reading as nominal radius minus actual radius.
_NOMINAL_LESS_ACTUAL = re.compile(_WORDS["nominal_less_actual"])
# Regular expression for a text that defines the reading as actual radius minus nominal radius.
_ACTUAL_LESS_NOMINAL = re.compile(_WORDS["actual_less_nominal"])
# Regular expressions for a name of readings, such as "Shortening", that shows whether readings are
# positive for a longer or for a shorter bar. The keys are the signs of the readings.
_NAMES_OF_SIGN = {
    -1: re.compile(_WORDS["shortening"], re.IGNORECASE),
    1: re.compile(_WORDS["lengthening"], re.IGNORECASE),
}
# Regular expression for words in front of the name of readings in a line, such as "Readings:".
_NAME_LABEL = re.compile(_WORDS["name_label"], re.IGNORECASE)
# Regular expression for a name of readings, such as "Compression", that is ambiguous if it is the
# whole line. The line may then be about the load.
_UNCLEAR_ALONE = re.compile(_WORDS["unclear_alone"], re.IGNORECASE)
# Regular expression for a header with a minus sign before the name of the reading.
_MINUS = re.compile(_WORDS["minus"])
# Regular expression for a load in front of a minus sign, as in "36 N -dR". The minus sign must
# belong to the name that follows. A dash between blanks, as in "36 N - dR", merely separates the
# load from the name.
_LOAD_IN_FRONT = re.compile(rf"^\W*{LOAD_IN_NAME.pattern}\s+(?=[-−–]\S)", re.IGNORECASE)
# Sign of the readings for each pair of words in a statement such as "positive means longer". One
# word is the sign of a reading; the other says whether the bar is then longer or shorter.
_SIGNS = {
    frozenset({"positive", "longer"}): 1,
    frozenset({"negative", "shorter"}): 1,
    frozenset({"positive", "shorter"}): -1,
    frozenset({"negative", "longer"}): -1,
}


def sign_of_readings(recording: Recording) -> int:
    """Return the factor for the readings: −1 if a longer bar gives a smaller reading, otherwise 1.

    The sign that the user states takes precedence over the words of the file. Words that decide the
    sign, or that contradict the user, are noted.

    Parameters
    ----------
    recording
        Rows of the test in the file, and everything that the file or the user states about the
        test.

    Raises
    ------
    InputError
        If the user states no sign, and words in the file contradict each other or are ambiguous.
    """
    stated = recording.layout.sign
    sources = _stated_signs(recording)
    if stated is not None:
        if sources and stated not in sources:
            source = next(iter(sources.values()))
            recording.note("sign of the reading", f"{stated}, as given", source, "--sign")
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


def _stated_signs(recording: Recording) -> dict[int, str | CitedLine]:
    """Return the signs that the file states for the readings, and the places that state them.

    The result is a dict: the keys are the signs, 1 and −1, and each value is the first place that
    states the sign. The header of the column of readings and the lines outside the table are
    searched. Raise an `OpenQuestionError` if the user states no sign and a text states the sign in
    ambiguous words.
    """
    header = recording.heading.headers[recording.heading.roles["reading"]]
    sources: dict[int, str | CitedLine] = {}
    unread: list[tuple[str | CitedLine, str]] = []
    _note_names(recording)
    if _MINUS.search(_words_of_header(header)):
        sources[-1] = f"the header {header!r}"
    for source, text in _texts_about_sign(recording, header):
        sign_of_definition = _sign_of_difference(text) or _sign_of_name(source, text)
        if sign_of_definition is not None:
            sources.setdefault(sign_of_definition, source)
            continue
        words = _meanings_of_sign_words(text)
        sign = None
        if words:
            sign = _sign_from_meanings(words)
        elif not _leaves_sign_open(source, text):
            unread.append((source, text))
            continue
        if sign is not None:
            sources.setdefault(sign, source)
        elif recording.layout.sign is None:
            raise OpenQuestionError(
                f"{recording.place}: one sign of the readings must mean a longer bar, got"
                f" {_words_on_sign(text)!r} in {source}. Say which: --sign 1 (positive is longer)"
                " or -1.",
                "sign",
                ("1", "-1"),
            )
    # If a text about the sign is not understood, a note says so, and says that positive readings
    # are assumed to mean a longer bar. The note is left out if another text states the opposite
    # sign.
    if -1 not in sources:
        for source, text in unread:
            _note_unread(recording, source, text)
    return sources


def _words_on_sign(text: str) -> str:
    """Return a text about the sign of readings, shortened for a message if it is long.

    The shortened text begins at the first word that is about the sign or about the length of the
    bar, such as "positive" or "longer". If this word is near the end of the text, the end of the
    text is returned instead.
    """
    text = text.strip()
    first = _WORD.search(text)
    if len(text) <= TEXT_SHOWN or first is None:
        return text[:TEXT_SHOWN]
    start = min(first.start(), len(text) - TEXT_SHOWN)
    return text[start:][:TEXT_SHOWN]


def _sign_of_difference(text: str) -> int | None:
    """Return the sign of readings that a text defines as a difference of two radii.

    The sign is −1 for nominal radius minus actual radius, and 1 for the opposite. The result is
    None for any other text.
    """
    words = _words_of_header(text)
    if _OTHER_SUBJECT.search(words):
        return None
    if _NOMINAL_LESS_ACTUAL.search(words):
        return -1
    if _ACTUAL_LESS_NOMINAL.search(words):
        return 1
    return None


def _sign_of_name(source: str | CitedLine, text: str) -> int | None:
    """Return the sign of readings that follows from their name: −1 for ``Shortening [um]``.

    ``text`` is the header of the readings, or a line. A line must hold nothing but the name of the
    readings, alone or after words such as "Readings:". The result is None for any other text.
    ``source`` tells where the text is, such as "line 3".
    """
    words = LOAD_IN_NAME.sub("", _words_of_header(text))
    label = _NAME_LABEL.match(words)
    if label is not None:
        words = words[label.end() :]
    is_line = isinstance(source, CitedLine)
    if is_line and label is None and _UNCLEAR_ALONE.search(words):
        return None
    for name in (words, unit_of(words).name):
        for sign, pattern in _NAMES_OF_SIGN.items():
            if pattern.fullmatch(name.strip(" .,;:-–#%\"'")):
                return sign
    return None


def _texts_about_sign(recording: Recording, header: str) -> list[tuple[str | CitedLine, str]]:
    """Return the texts that may state the sign of a test's readings, as pairs (source, text).

    The texts are the header of the readings (``header``) and the statements in lines outside the
    table. A source says where a text stands, such as "line 3".
    """
    texts: list[tuple[str | CitedLine, str]] = [
        (f"the header {header!r}", _INCHES_AT_END.sub("", header))
    ]
    for line, text in recording.lines_outside:
        texts += [(cited_line(line), statement) for statement in _statements_in_line(text)]
    return texts


def _leaves_sign_open(source: str | CitedLine, text: str) -> bool:
    """Return whether a text is about the sign of readings, but does not determine it.

    ``source`` tells where the text is, such as "line 3".
    """
    return (
        _says_sign_is_reversed(text)
        or _is_header_of_reversed_sign(source, text)
        or _explains_sign_unclearly(source, text)
    )


def _statements_in_line(text: str) -> list[str]:
    """Divide a line into statements, so that those about the sign of readings can be found.

    In ``Angles from Y, clockwise; positive: bar shorter``, only the last statement is about the
    sign of readings. The line is not divided in three cases:

    - The whole line states one sign.
    - The whole line is about the sign of readings, but no statement in it has both a word for a
      sign and a word for a longer or shorter bar. An example is ``Readings inverted; bar
      horizontal``.
    - No statement in the line is about the sign of readings.
    """
    text = text[:LONGEST_TEXT]
    if _sign_from_meanings(_meanings_of_sign_words(text)) is not None:
        return [text]
    statements = divide_line(text)
    if any(_meanings_of_sign_words(statement) for statement in statements):
        return statements
    for parts in finer_divisions(text):
        if any(_sign_from_meanings(_meanings_of_sign_words(part)) is not None for part in parts):
            return parts
    if is_about_sign(text):
        return [text]
    segments = _with_labels_joined(segments_of_line(text))
    if any(is_about_sign(segment) for segment in segments):
        return segments
    return [text]


def _with_labels_joined(segments: list[str]) -> list[str]:
    """Join a segment that is a label, such as "Sign", to the segment that follows it."""
    joined: list[str] = []
    for segment in segments:
        if joined and comparable(joined[-1].strip(" #*:=")) in _WORDS["labels"]:
            joined[-1] += f";{segment}"
        else:
            joined.append(segment)
    return joined


def is_about_sign(text: str) -> bool:
    """Return whether a line or part of a line is about the sign of readings.

    An example is ``nominal minus measured``. Another is ``Readings inverted``, although it does not
    say which sign the readings now have.
    """
    if _sign_of_difference(text) is not None or _sign_of_name(cited_line(0), text) is not None:
        return True
    words = _meanings_of_sign_words(text)
    if words and _sign_from_meanings(words) is not None:
        return True
    return _leaves_sign_open(cited_line(0), text) or _explains_sign(text)


def names_sign_or_length(text: str) -> bool:
    """Return whether a text has a word for a sign, or one for a longer or shorter bar."""
    return bool(_meanings_of_words(text[:LONGEST_TEXT]))


def leaves_difference_unread(text: str) -> bool:
    """Return whether a text defines readings as a difference, but leaves their sign uncertain.

    The difference is that of the nominal and the actual radius. Its sign is uncertain if the text
    also names another subject, as in ``Force 238 N nominal minus measured``.
    """
    words = _words_of_header(text)
    is_difference = _NOMINAL_LESS_ACTUAL.search(words) or _ACTUAL_LESS_NOMINAL.search(words)
    return is_difference is not None and _sign_of_difference(text) is None


def _explains_sign_unclearly(source: str | CitedLine, text: str) -> bool:
    """Return whether a line explains the sign of readings in words that are not understood.

    Examples are ``Sign: as on the drawing`` and a line that states the sign of readings and the
    sense of angles in one sentence. ``source`` tells where the text is, such as "line 3".
    """
    text = text[:LONGEST_TEXT]
    if not isinstance(source, CitedLine) or _DENIED.search(text):
        return False
    if _OTHER_NUMBER.search(text):
        return _LABEL.search(text) is not None and not _OTHER_SUBJECT.search(text)
    is_named = _NAMED.search(text) is not None and _MEANS.search(text) is not None
    if _OTHER_SUBJECT.search(text):
        return is_named and _has_sign_and_length(_meanings_of_words(text))
    return is_named or _LABEL.search(text) is not None


def _words_of_header(header: str) -> str:
    """Return the words of a header or line in a form in which words for signs can be found.

    The words are in lower case, and underscores become blanks. A unit in brackets in front of the
    name is left out. So is a load in front of a minus sign, as in ``36 N -dR``. Very long texts are
    cut off.
    """
    words = comparable(header[:LONGEST_TEXT]).replace("_", " ")
    return _LOAD_IN_FRONT.sub("", _UNIT_IN_FRONT.sub("", words))


def _note_names(recording: Recording) -> None:
    """Add a note for each file whose name suggests that the sign of the readings is reversed."""
    for name in recording.names_of_files():
        turned = _TURNED_NAME.search(name)
        if turned is not None and recording.layout.sign is None:
            reason = f"its name says {turned[0]!r}, not understood"
            recording.note("sign of the reading", "1: a longer bar is positive", reason, "--sign")


def _note_unread(recording: Recording, source: str | CitedLine, text: str) -> None:
    """Add a note on a line that may explain the sign of readings, but is not understood.

    ``source`` tells where the line is, such as "line 3", and ``text`` is the line.
    """
    text = text[:LONGEST_TEXT]
    if not _explains_sign(text):
        return
    if recording.layout.sign is None and isinstance(source, CitedLine):
        reason = quoted_line(source.line, text, "not understood", TEXT_SHOWN)
        recording.note("sign of the reading", "1: a longer bar is positive", reason, "--sign")


def _explains_sign(text: str) -> bool:
    """Return whether a text may explain the sign of readings, such as ``Positive: see drawing``.

    The result is False if the text has a word such as clockwise, because it then explains the sense
    of angles or the direction of travel.
    """
    if _OTHER_SUBJECT.search(text) or _OTHER_NUMBER.search(text) or senses_in(text):
        return False
    return _MEANING.search(text) is not None


def _is_header_of_reversed_sign(source: str | CitedLine, text: str) -> bool:
    """Return whether a text is a header of readings whose sign may be reversed.

    An example is ``Shortening [um]``. The result is False for a header that begins with a minus
    sign, because this package takes the minus sign into account. ``source`` tells where the text
    is, such as "line 3".
    """
    words = _words_of_header(text)
    is_understood = _MINUS.search(words) is not None
    is_turned = _TURNED_HEADER.search(words) is not None
    return not isinstance(source, CitedLine) and is_turned and not is_understood


def _says_sign_is_reversed(text: str) -> bool:
    """Return whether a text, such as ``Readings inverted``, says that the sign is reversed.

    Such a text is not about angles or loads, and contains no number other than −1.
    """
    text = LOAD_IN_NAME.sub("", text[:LONGEST_TEXT].replace("_", " "))
    if _OTHER_SUBJECT.search(text) or _OTHER_NUMBER.search(text) or _DENIED.search(text):
        return False
    return _SUBJECT.search(text) is not None and _TURNED.search(text) is not None


def _meanings_of_sign_words(text: str) -> list[str]:
    """Return what the words of a text say about the sign of readings, in the order of the words.

    For ``positive reading: bar shorter``, the list holds "positive" and "shorter". The other
    possible entries are "negative" and "longer". The list is empty unless the text has both a word
    for a sign and a word for a longer or shorter bar.
    """
    text = text[:LONGEST_TEXT]
    if _OTHER_SUBJECT.search(text) or _ANGLE.search(text) or names_extension(text):
        return []
    words = _meanings_of_words(text)
    if not _has_sign_and_length(words):
        return []
    return words


def _meanings_of_words(text: str) -> list[str]:
    """Return what the words of a text say about the sign of readings, in the order of the words.

    Each entry is "positive", "negative", "shorter" or "longer". All other words are skipped.
    """
    text = _IN_OR_OUT_FIRST.sub(r"\g<sign> \g<way>ward", text)
    text = _IN_OR_OUT.sub(r"\g<sign> = \g<way>ward", text)
    return [str(match.lastgroup) for match in _WORD.finditer(text)]


def _has_sign_and_length(words: list[str]) -> bool:
    """Return whether a text has both a word for a sign and a word for a shorter or longer bar.

    ``words`` lists the meanings of the words: positive, negative, shorter or longer.
    """
    has_sign = "positive" in words or "negative" in words
    has_length = "shorter" in words or "longer" in words
    return has_sign and has_length


def _sign_from_meanings(words: list[str]) -> int | None:
    """Return the sign of readings that a text states; None if the text is ambiguous.

    ``words`` lists what the words of the text say: positive, negative, shorter or longer. The first
    and the second entry form a pair, such as positive and longer, and so do the third and the
    fourth. Each pair states a sign, and all pairs must state the same sign.
    """
    signs = set()
    for first, second in zip(words[::2], words[1::2], strict=False):
        signs.add(_SIGNS.get(frozenset({first, second})))
    if len(words) % 2 or len(signs) != 1:
        return None
    return signs.pop()
