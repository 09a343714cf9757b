"""Direction of travel of the machine, CW or CCW, in lines above a table and in names.

Examples are the line ``Measured clockwise``, and the words G2 (clockwise) and G3 of G-code.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ldbb_bayes.reading.cited_lines import TEXT_SHOWN
from ldbb_bayes.reading.line_parts import segments_of_line, statements_of_line
from ldbb_bayes.reading.names import LOAD_IN_NAME
from ldbb_bayes.reading.open_question import OpenQuestionError
from ldbb_bayes.reading.programmed_circles import programs_arc
from ldbb_bayes.reading.qualifications import words_of_exception, words_of_view
from ldbb_bayes.reading.words import LONGEST_TEXT, WORDS

__all__ = [
    "NAMES_DIRECTION",
    "UnreadDirection",
    "check_direction_is_clear",
    "direction_named",
    "directions_stated",
    "is_direction",
    "senses_in",
    "senses_of_header",
    "unread_direction",
    "with_sides_in_full",
    "without_directions",
]

_WORDS: Mapping[str, Any] = WORDS["directions"]
# Regular expression for any word for clockwise or counter-clockwise. Words beside it may turn it
# into its opposite, as in "opposite to clockwise", or leave open what is meant.
_SENSE = re.compile(
    rf"(?<![a-zA-Z])(?:(?:(?P<doubted>{_WORDS['doubted']})|(?P<opposed>{_WORDS['opposed']}))"
    r"[\s_-]*)?"
    rf"(?P<word>{_WORDS['clock_hand']}|ccw|cw|{_WORDS['in_words']})(?![a-z])"
    rf"(?P<behind>{_WORDS['opposed_behind']})?(?P<doubted_behind>{_WORDS['doubted_behind']})?",
    re.IGNORECASE,
)
# Regular expression for a word of G-code for a circle: G2 or G02 (clockwise), G3 or G03. The
# expression does not match the grade of a ball, as in "ball G3".
_ARC = re.compile(
    r"(?<![^\W_])(?<!ball[ _-])(?<!balls[ _-])(?<!kugel[ _-])(?<!kugeln[ _-])(?<!grade[ _-])"
    r"G0?(?P<sense>[23])(?![^\W_]|[.,]\d)",
    re.IGNORECASE,
)
# Regular expression for words which show that G2 or G3 in a line does not mean a circle, but a
# grade of balls or the name of a product.
_OTHER_ARC = re.compile(_WORDS["other_arc"], re.IGNORECASE)
_SENSES_OF_ARCS = {"2": "CW", "3": "CCW"}
# Meaning of the letters R and L in a column of directions, if the column holds both letters and no
# other text.
_SIDES_BY_LETTER = {"R": "right", "L": "left"}
# Regular expression for a word for "direction", with the text that follows it.
NAMES_DIRECTION = re.compile(_WORDS["after"], re.IGNORECASE)
# Regular expression for words which show that a direction is not the direction of travel, as in
# "direction of the force".
_OTHER_DIRECTION = re.compile(_WORDS["other"], re.IGNORECASE)
# Regular expression for a text, such as a dash, that stands in place of a missing direction.
_MISSING = re.compile(r"[\s:=;,|()\[\]\-–—.]*(?:n/?a|none)?[\s;,|)\].]*", re.IGNORECASE)
# Regular expression for words which show that a line is about the sense in which angles are
# counted.
_SENSE_OF_ANGLE = re.compile(WORDS["angle_convention"]["sense"], re.IGNORECASE)
# Regular expressions for words, such as "rechts", that mean clockwise or counter-clockwise if they
# follow a word for direction.
_SIDES = {
    "CW": re.compile(rf"[\s:=;,|]*(?:{_WORDS['right']})(?!\w|\sto\b|\snach\b)", re.IGNORECASE),
    "CCW": re.compile(rf"[\s:=;,|]*(?:{_WORDS['left']})(?!\w|\sto\b|\snach\b)", re.IGNORECASE),
}
# Regular expression for an arrow that turns clockwise or counter-clockwise, after a word for
# direction.
_ARROW = re.compile(r"[\s:=;,|]*(?P<arrow>[↺⟲↻⟳])[\s;,|]*")
# Regular expression for a sign or a word, such as "positive", that means a direction of travel
# after a word for direction, but does not say which.
_OPEN_DIRECTION = re.compile(rf"[\s:=;,|]*(?:{_WORDS['open']})[\s;,|.]*", re.IGNORECASE)
# Regular expression for words that may state the direction of travel, such as "left", "positive" or
# "reversed".
_TURNED = re.compile(f"{_WORDS['turned']}|{_WORDS['stated']}", re.IGNORECASE)
# Regular expression for words which show that a line is about angles.
_ANGLES = re.compile(WORDS["angle_convention"]["subject"], re.IGNORECASE)
# Regular expression for words for the motion or the measurement, such as "run" or "measured".
_TRAVEL = re.compile(_WORDS["travel"], re.IGNORECASE)
# Regular expression for words, such as anticlockwise, that mean counter-clockwise.
_COUNTER = re.compile(_WORDS["counter"], re.IGNORECASE)
# Regular expression for words that mean a load, such as "force" and "pressure".
_LOADS = re.compile(_WORDS["loads"], re.IGNORECASE)
# Regular expression for a direction with an answer or a box, as in "CW: yes" and "CCW [x]".
_ANSWERED = re.compile(
    rf"(?<![^\W_])(?:(?P<right>{_WORDS['run_right']})|(?P<left>{_WORDS['run_left']})"
    rf"|(?P<sense>{_SENSE.pattern}))\s*(?:[:=;,|\t]\s*(?:(?P<yes>{_WORDS['yes']})|{_WORDS['no']})"
    r"(?!\w)|(?:[:=;,|\t]\s*)?(?:\[\s*(?P<box>x)?\s*\]|\(\s*(?P<bracket>x)?\s*\)))",
    re.IGNORECASE,
)
# A regular expression for each direction of travel, which finds words such as "Rechtslauf". The
# keys are the directions.
_RUNS_BY_SENSE = {
    "CW": re.compile(rf"(?<![^\W_])(?:{_WORDS['run_right']})", re.IGNORECASE),
    "CCW": re.compile(rf"(?<![^\W_])(?:{_WORDS['run_left']})", re.IGNORECASE),
}
# Regular expression for words, such as "clockwise run" or "Rechtslauf", that name a run and its
# direction of travel.
_RUN_WITH_SENSE = re.compile(
    rf"(?<![^\W_])(?:{_WORDS['run_right']}|{_WORDS['run_left']})", re.IGNORECASE
)
# Regular expression for a word such as "run" in front of a direction.
_RUN_IN_FRONT = re.compile(rf"^(?:{WORDS['names']['run']})\s+", re.IGNORECASE)
# Regular expression for words which show that a line is not about the angles of the readings.
_NO_ANGLES = re.compile(WORDS["angle_convention"]["other"], re.IGNORECASE)


class UnreadDirection(NamedTuple):
    """Line that may state a direction of travel, but is not understood."""

    #: number of the line that may state the direction of travel; if this line is not in the sheet
    #: with the readings, a text with the number and the other sheet, such as "3 of notes.txt"
    line: int | str
    text: str  #: first characters of the line that may state the direction of travel


def _senses_by_word() -> dict[str, str]:
    """Return a dict that assigns CW or CCW to each word for a direction, such as HORAIRE."""
    senses = {}
    for sense in ("CW", "CCW"):
        for word in _WORDS[sense]:
            senses[word] = sense
    return senses


_SENSES_BY_WORD = _senses_by_word()


def direction_named(word: str) -> str:
    """Return CW or CCW for a word that means clockwise or counter-clockwise, such as G2.

    Any other word is returned as it is written. The words CW and CCW may have small letters.
    """
    capitals = word.strip().upper()
    if capitals in ("CW", "CCW"):
        return capitals
    letters = re.sub(r"(?<=\w)[-_ ](?:DE[NM][-_ ])?", "", capitals)
    if letters not in _SENSES_BY_WORD and is_direction(word.strip()):
        senses = senses_in(word)
        return senses.pop() if len(senses) == 1 else word
    return _SENSES_BY_WORD.get(letters, word)


def senses_of_header(name: str) -> set[str]:
    """Return the senses, CW or CCW, that the name of a column states, as in ``CW`` and ``rechts``.

    Words for right and left count only if they are the whole name, or follow a word such as "run";
    the caller must see to it that another column has the other sense.
    """
    side = direction_named(_RUN_IN_FRONT.sub("", name))
    if side in ("CW", "CCW") and re.search(r"[^\W\d_]", name):
        return {side}
    return senses_in(name)


def with_sides_in_full(cells: Sequence[str]) -> list[str]:
    """Replace R by "right" and L by "left" in the cells of a column of directions.

    The letters are replaced only if the column holds both and nothing else, because R alone may
    mean another word, such as "reverse".
    """
    letters = [cell.strip().upper() for cell in cells]
    if {letter for letter in letters if letter} != set(_SIDES_BY_LETTER):
        return list(cells)
    return [_SIDES_BY_LETTER.get(letter, "") for letter in letters]


def senses_in(text: str) -> set[str]:
    """Return the senses, clockwise (CW) or counter-clockwise (CCW), that a text names.

    The result holds both if the text leaves open which is meant, as in ``reversed clockwise`` and
    ``force against CW``, or if it compares both, as in ``CW against CCW``.
    """
    senses: set[str] = set()
    end = 0
    for match in _SENSE.finditer(text):
        follows_another = bool(senses) and not text[end : match.start()].strip()
        is_compared = match["opposed"] is not None and (follows_another or _may_be_against(match))
        end = match.end()
        if match["doubted"] or match["doubted_behind"] or is_compared:
            senses |= {"CW", "CCW"}
        elif _means_counter(match):
            senses.add("CCW")
        else:
            senses.add("CW")
    return senses


def _may_be_against(match: re.Match[str]) -> bool:
    """Return whether something may be against a run CW or CCW, as in ``force against CW``.

    ``match`` is the match of a word for a sense, and of an opposing word in front of it. In anti-CW
    and counter-CW, this word is a part of the sense.
    """
    is_short = match["word"].upper() in ("CW", "CCW")
    return is_short and match["opposed"].lower() not in ("anti", "counter")


def _means_counter(match: re.Match[str]) -> bool:
    """Return whether a word for a sense means counter-clockwise, with the words beside it.

    ``match`` is the match of the word. A word such as "against" in front of it, or such as 反対
    behind it, turns the sense into its opposite.
    """
    is_counter = _COUNTER.search(match["word"]) is not None
    turned = [is_counter, match["opposed"] is not None, match["behind"] is not None]
    return turned.count(True) % 2 == 1


def is_direction(text: str) -> bool:
    """Return whether a text is a word for clockwise or counter-clockwise, such as CW."""
    return _SENSE.fullmatch(text) is not None


def without_directions(text: str) -> str:
    """Return a text with a blank in place of each word for clockwise or counter-clockwise."""
    for pattern in (_SENSE, _RUN_WITH_SENSE, _ARC):
        text = pattern.sub(" ", text)
    return text


def directions_stated(
    lines: Sequence[tuple[int | str, str]], names: Sequence[str] = ()
) -> set[str]:
    """Return the directions of travel, CW and CCW, that names and lines above a table state.

    In a line, a direction is accepted if it follows a word such as "direction", if the line also
    has a word such as "run" or "measured", or if the line is nothing but the direction. The words
    G2 and G3 are accepted anywhere in a line. They are ignored in blocks of G-code that program an
    arc, because not all of these arcs are the measured circle.

    Parameters
    ----------
    lines
        Line number and text of each line. For a line of another sheet, the line number is replaced
        by a text such as "3 of notes.txt".
    names
        Names of test, column, sheet and file; only the first name that contains a direction is
        used.
    """
    directions: set[str] = set()
    for name in names:
        directions = senses_in(name[:LONGEST_TEXT]) | _senses_of_arcs(name[:LONGEST_TEXT])
        if directions:
            break
    for _, content in lines:
        text = content[:LONGEST_TEXT]
        for statement in statements_of_line(text, _is_about_angles_and_travel):
            if _is_qualified(statement):
                continue
            stated = _directions_in_statement(statement) or _directions_in_segments(statement)
            directions = directions | stated
    return directions


def _is_qualified(text: str) -> bool:
    """Return whether a statement holds words that change the direction that it names.

    Examples are ``CW (seen from below)`` and ``CW, except test 2``.
    """
    if words_of_view(text):
        return True
    was_named = False
    for segment in segments_of_line(text):
        exception = words_of_exception(segment)
        is_named = bool(senses_in(segment)) or NAMES_DIRECTION.search(segment) is not None
        continues = was_named and segment.strip().startswith(exception)
        if exception and (is_named or continues):
            return True
        was_named = is_named
    return False


def _directions_in_segments(text: str) -> set[str]:
    """Return the directions of travel that a statement names: CW, CCW or both.

    Each segment of the statement is searched. For example, the second segment of ``Force 238 N;
    travel clockwise`` names a direction. The result is empty for a statement about angles, because
    the direction may be the sense in which they are counted.
    """
    directions: set[str] = set()
    if not _is_about_angles(text):
        for segment in _segments_with_labels(text):
            directions |= _directions_in_statement(segment)
    return directions


def _segments_with_labels(text: str) -> list[str]:
    """Split a line into segments, but keep a direction of travel together with its label.

    In ``Spindle;CW``, "Spindle" is the label of the direction, and the line remains one segment.
    The line ``Force 238 N;CW`` is divided into two segments, because the words before the direction
    are a complete statement and not a label.
    """
    segments: list[str] = []
    for segment in segments_of_line(text):
        is_alone = is_direction(segment.strip(" .;,|\t"))
        if is_alone and segments and not _is_whole_statement(segments[-1]):
            segments[-1] += f";{segment}"
        else:
            segments.append(segment)
    return segments


def _is_whole_statement(text: str) -> bool:
    """Return whether the text before a direction, such as CW, is a complete statement without it.

    A complete statement, such as "Force 238 N", contains a number or a plane. It contains no word
    for angles or for anything else that may have a direction, such as a spindle. The text "Spindle"
    is not complete, because it only says what turns in the direction.
    """
    has_value = re.search(r"\d|\b[XYZ]{2}\b", text) is not None
    is_about_others = _OTHER_DIRECTION.search(_LOADS.sub(" ", text)) or _ANGLES.search(text)
    return has_value and not is_about_others


def _directions_answered_yes(text: str) -> set[str]:
    """Return the directions of travel that are followed by "yes" or a ticked box in a text.

    For example, ``CW: yes, CCW: no`` gives CW, and ``CCW [x]`` gives CCW.
    """
    senses: set[str] = set()
    if _is_about_angles(text) or _OTHER_DIRECTION.search(text):
        return senses
    for match in _ANSWERED.finditer(text):
        if not (match["yes"] or match["box"] or match["bracket"]):
            continue
        if match["right"]:
            senses.add("CW")
        elif match["left"]:
            senses.add("CCW")
        else:
            senses |= senses_in(match["sense"])
    return senses


def _directions_in_statement(text: str) -> set[str]:
    """Return the directions of travel, CW and CCW, that one statement of a line names."""
    answered = _directions_answered_yes(text)
    if answered:
        return answered
    match = NAMES_DIRECTION.search(text)
    if match is None and _is_about_travel(text):
        return _direction_after(text) or _sense_beside_load(text)
    if match is None:
        return _senses_of_arcs(text) or _sense_beside_load(text)
    if _SENSE_OF_ANGLE.search(text):
        return set()
    # In "sentido do movimento: horário", the sense consists of the first and the last word.
    return _direction_after(match[1]) or _direction_after(match[0])


def _sense_beside_load(text: str) -> set[str]:
    """Return the direction of travel that is named beside a load: CCW for ``Load 490 N CCW``.

    The result is empty if the text contains no load, if it names both directions, or if a direction
    is followed by yes or no, as in ``CW: no``. It is also empty if the text is about angles, or
    about another direction, such as that of the force.
    """
    without_load = _LOADS.sub(" ", LOAD_IN_NAME.sub(" ", text))
    if LOAD_IN_NAME.search(text) is None or _is_about_angles(text):
        return set()
    if _OTHER_DIRECTION.search(without_load) or _ANSWERED.search(without_load):
        return set()
    senses = senses_in(without_load)
    for sense, pattern in _RUNS_BY_SENSE.items():
        if pattern.search(without_load):
            senses.add(sense)
    if len(senses) > 1:
        return set()
    return senses


def _is_about_angles_and_travel(text: str) -> bool:
    """Return whether a text has words both for angles and for another subject, such as travel."""
    return _ANGLES.search(text) is not None and _NO_ANGLES.search(text) is not None


def _is_about_travel(text: str) -> bool:
    """Return whether a line without the word "direction" may be about the direction of travel."""
    if _is_about_angles(text) or _OTHER_DIRECTION.search(text):
        return False
    return is_direction(text.strip(" .;,|\t")) or _TRAVEL.search(text) is not None


def _is_about_angles(text: str) -> bool:
    """Return whether a text has a word for angles, but none for another subject, such as travel."""
    return _ANGLES.search(text) is not None and _NO_ANGLES.search(text) is None


def _direction_after(text: str) -> set[str]:
    """Return the directions, CW and CCW, that a text about the direction of travel states.

    ``text`` is what follows a word such as "direction", or a whole statement about travel that
    contains no such word. The words G2 and G3 count as CW and CCW. If the text names both
    directions, the directions after its last separator, such as a colon, are returned, unless words
    there show that another direction is meant, such as that of the spindle.
    """
    senses = senses_in(text) | _senses_of_arcs(text)
    arrow = _ARROW.fullmatch(text)
    if arrow is not None:
        return {direction_named(arrow["arrow"])}
    if not senses:
        # After a word for direction, "right" means clockwise and "left" counter-clockwise.
        for sense, side in _SIDES.items():
            if side.match(text):
                return {sense}
    if len(senses) > 1:
        # A line may list both directions before it states one: "Direction (CW/CCW): CCW".
        last = re.split(r"[:=;|\t]", text)[-1]
        if _OTHER_DIRECTION.search(last):
            return senses
        return senses_in(last) | _senses_of_arcs(last)
    return senses


def _senses_of_arcs(text: str) -> set[str]:
    """Return the directions, CW or CCW, for the words G2 and G3 in a text.

    The result is empty for a block of G-code that programs an arc, and for a line that consists
    only of G2 or G3. It is also empty if G2 or G3 is the grade of a ball.
    """
    is_block = _ARC.fullmatch(text.strip()) is not None or programs_arc(text)
    if is_block or _OTHER_ARC.search(text):
        return set()
    return {_SENSES_OF_ARCS[match["sense"]] for match in _ARC.finditer(text)}


def check_direction_is_clear(place: str, lines: Sequence[tuple[int | str, str]]) -> None:
    """Raise an `OpenQuestionError` for a line such as ``Direction: -1`` or ``Direction: positive``.

    Such a line states a direction of travel, but not in words for clockwise or counter-clockwise.

    Parameters
    ----------
    place
        Name of the table in the error message.
    lines
        Line number and text of each line. For a line of another sheet, the line number is replaced
        by a text such as "3 of notes.txt".
    """
    for line, text in lines:
        match = NAMES_DIRECTION.search(text[:LONGEST_TEXT])
        if match is None or _is_about_angles(text) or _OTHER_DIRECTION.search(text):
            continue
        if _OPEN_DIRECTION.fullmatch(match[1]):
            raise OpenQuestionError(
                f"{place}: direction must be CW or CCW, got {text.strip()[:TEXT_SHOWN]!r} in line"
                f" {line}. Say which: --direction CW or CCW; or, if tests differ, direction in a"
                " [[test]] of --layout.",
                "direction",
                ("CW", "CCW"),
            )


def unread_direction(lines: Sequence[tuple[int | str, str]]) -> UnreadDirection | None:
    """Return the first line that may state a direction of travel but is not understood.

    Such a line has a word for direction or a word such as "clockwise", but it does not state the
    direction of travel and is not about angles. Return None if there is no such line.

    Parameters
    ----------
    lines
        Line number and text of each line. For a line of another sheet, the line number is replaced
        by a text such as "3 of notes.txt".
    """
    for line, content in lines:
        text = content[:LONGEST_TEXT]
        if directions_stated([(line, text)]):
            continue
        for statement in statements_of_line(text, _is_about_angles_and_travel):
            unread = _part_not_understood(statement)
            if unread:
                return UnreadDirection(line, unread.strip()[:TEXT_SHOWN])
    return None


def _part_not_understood(text: str) -> str:
    """Return the part of a text that may state a direction of travel, but is not understood.

    In most cases, this is the whole text. If the text also names another direction, such as that of
    a load, it is the first segment that may state a direction of travel. The result is empty if
    there is no such text or segment, or if the text is about angles.
    """
    if _is_about_angles(text):
        return ""
    if _OTHER_DIRECTION.search(text) is None:
        return text if _may_state_direction(text) else ""
    for segment in _segments_with_labels(text):
        if _may_state_direction(segment):
            return segment
    return ""


def _may_state_direction(text: str) -> bool:
    """Return whether a line may state a direction of travel, clockwise or counter-clockwise.

    The result is False for a line about angles, or about a direction other than that of travel. For
    a line about a load, it is True only if the line has a word such as clockwise. A line with a
    word for direction must also have text after this word; a dash or "n/a" does not count.
    """
    if _is_about_angles(text):
        return False
    if _OTHER_DIRECTION.search(text):
        is_of_load = _OTHER_DIRECTION.search(_LOADS.sub(" ", text)) is None
        return is_of_load and (bool(senses_in(text)) or _RUN_WITH_SENSE.search(text) is not None)
    match = NAMES_DIRECTION.search(text)
    if match is not None:
        following_text = match[1]
        return _MISSING.fullmatch(following_text) is None
    patterns = (_TURNED, _RUN_WITH_SENSE)
    return bool(senses_in(text)) or any(pattern.search(text) for pattern in patterns)
