"""Detection of the encoding of a text file from its byte-order mark, zero bytes or words."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress

import charset_normalizer

from ldbb_bayes.campaign.text_decoding import BYTE_ORDER_MARKS
from ldbb_bayes.reading.words import ROLES, WORDS, comparable

__all__ = ["encoding_of"]

# Number of bytes at the beginning of a text file that are searched for zeros. Many zeros show that
# the encoding is UTF-16.
_HEAD_BYTES = 4096
# UTF-16 stores most characters in two bytes. For ASCII characters, one of the two bytes is zero:
# always the first, or always the second. A text file is taken to be UTF-16 if the zeros at even
# positions, or at odd positions, are more than this fraction of all examined bytes.
_SHARE_OF_ZEROS = 0.2
# Encodings that are tried for a text that is not UTF-8, in order of preference: encodings for
# Western Europe, Macintosh, Cyrillic, Greek, Central Europe, East Asia and MS-DOS.
_ENCODINGS = (
    "cp1252",
    "mac_roman",
    "cp1251",
    "koi8_r",
    "cp1253",
    "cp1250",
    "cp932",
    "gb18030",
    "big5",
    "euc_kr",
    "euc_jp",
    "cp850",
)
# Encodings among these for languages with Latin letters.
_LATIN_ENCODINGS = ("cp1252", "mac_roman", "cp1250", "cp850")
# Letters with accents, and other letters outside ASCII, of the languages of Western Europe.
_WESTERN_LETTERS = frozenset("àáâãäçèéêëìíîïñòóôõöùúûüßœµ")
# Other characters outside ASCII that texts in these languages may have.
_WESTERN_SIGNS = frozenset("°²³±·«»§€–—‘’“”…\xa0")
# Largest number of lines from which the encoding is determined. Only lines with letters outside
# ASCII are counted.
_LINES_EXAMINED = 50
# The guess of the library charset_normalizer is used only for a text with at least this number of
# bytes outside ASCII.
_FEWEST_BYTES = 8
_LETTERS = re.compile(r"[^\W\d_]+")
_WORD = re.compile(r"[^\W\d_]+|[°µμ]+")


def encoding_of(raw: bytes) -> str:
    """Return the encoding of a text file.

    The encoding is UTF-8 or UTF-16 if a byte-order mark or many zero bytes show this. Any other
    text is taken to be UTF-8 if it can be decoded as UTF-8. If it cannot, several encodings are
    tried, and the encoding in which the text contains the most known words for columns and units is
    used. If the text contains no known word in any of them, the library charset_normalizer guesses
    the encoding. If such a text has few letters outside ASCII, or only some accents in words of
    Latin letters, it is taken to be Windows-1252.

    Parameters
    ----------
    raw
        Content of the file.
    """
    for encoding, mark in BYTE_ORDER_MARKS.items():
        if raw.startswith(mark):
            return encoding
    head = raw[:_HEAD_BYTES]
    if head[1::2].count(0) > _SHARE_OF_ZEROS * len(head):
        return "utf-16-le"
    if head[::2].count(0) > _SHARE_OF_ZEROS * len(head):
        return "utf-16-be"
    with suppress(UnicodeDecodeError):
        raw.decode("utf-8")
        return "utf-8"
    lines = [line for line in raw.split(b"\n") if not line.isascii()][:_LINES_EXAMINED]
    if _is_western(b"\n".join(lines)):
        return _encoding_of_words(lines, _LATIN_ENCODINGS) or "cp1252"
    return _encoding_of_words(lines, _ENCODINGS) or _guess_of_library(b"\n".join(lines))


def _is_western(text: bytes) -> bool:
    """Return whether a text, decoded as Windows-1252, may be in a language of Western Europe.

    This is the case if letters outside ASCII are letters of these languages, and stand alone (as in
    the Italian ``è``) or among more letters of ASCII, as in ``più``. In another encoding, such a
    text would have words that mix two alphabets: ``piω``.
    """
    try:
        decoded = text.decode("cp1252").lower()
    except UnicodeDecodeError:
        return False
    signs = {sign for sign in _LETTERS.sub("", decoded) if not sign.isascii()}
    if not _WESTERN_SIGNS.issuperset(signs):
        return False
    for word in _LETTERS.findall(decoded):
        outside = [letter for letter in word if not letter.isascii()]
        if not _WESTERN_LETTERS.issuperset(outside):
            return False
        if len(word) > 1 and 2 * len(outside) > len(word):
            return False
    return True


def _encoding_of_words(lines: Sequence[bytes], encodings: Sequence[str]) -> str:
    """Return the encoding in which lines contain the most known words for columns and units.

    ``encodings`` are the possible encodings. Only words with letters outside ASCII are considered.
    The result is an empty string if the lines contain no known word in any encoding.
    """
    best_encoding = ""
    best_score = 0
    for encoding in encodings:
        try:
            text = b"\n".join(lines).decode(encoding)
        except UnicodeDecodeError:
            continue
        words = {comparable(word) for word in _WORD.findall(text) if not word.isascii()}
        score = len(words & _KNOWN_WORDS)
        if score > best_score:
            best_encoding = encoding
            best_score = score
    return best_encoding


def _guess_of_library(text: bytes) -> str:
    """Return the encoding that the library charset_normalizer guesses for a text.

    The result is cp1252 if the library cannot guess, or if the text has too few bytes outside ASCII
    for a guess.
    """
    n_bytes = sum(byte > 127 for byte in text)
    if n_bytes >= _FEWEST_BYTES:
        match = charset_normalizer.from_bytes(text).best()
        if match is not None:
            return str(match.encoding)
    return "cp1252"


def _known_words() -> frozenset[str]:
    """Return the words for columns and units that contain a character outside ASCII."""
    words: set[str] = set()
    for role_words in ROLES.values():
        words.update(role_words)
    for units in WORDS["units"].values():
        for unit, (_, *synonyms) in units.items():
            words.update((unit, *synonyms))
    words.update(WORDS["encoding"]["words"].split())
    return frozenset(comparable(word) for word in words if not word.isascii())


_KNOWN_WORDS = _known_words()
