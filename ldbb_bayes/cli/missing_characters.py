"""Replacement of characters that a terminal, or a file of its output, cannot hold.

Windows writes the output of a program to a file in the encoding of the country, in which there is
no minus sign (−) and no Greek letter. A sign of a number must not be lost there.
"""

from __future__ import annotations

import codecs
import io
import unicodedata

__all__ = ["replace_missing_characters"]

# Name under which Python knows the function `_replace`.
_HANDLER = "ldbb_bayes.similar"
# ASCII texts for characters whose Unicode decomposition is not in ASCII either.
_SIMILAR = {
    "−": "-",
    "–": "-",
    "—": "-",
    "±": "+/-",
    "×": "x",
    "·": "*",
    "≤": "<=",
    "≥": ">=",
    "→": "->",
    "√": "sqrt",
    "°": "deg",
    "µ": "u",
    "μ": "u",
    "ß": "ss",
    "“": '"',
    "”": '"',
    "„": '"',
    "⁄": "/",
    "λ": "lambda",  # its Unicode name has LAMDA
    "Λ": "Lambda",
}
# Characters of exponents, such as 10⁻⁵. As plain digits they would make another number: 10⁵ would
# be 105.
_SUPERSCRIPTS = frozenset("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻")
# Beginning of the Unicode name of a small Greek letter, which the name of the letter follows.
_SMALL_GREEK = "GREEK SMALL LETTER "
# Beginning of the Unicode name of a capital Greek letter.
_CAPITAL_GREEK = "GREEK CAPITAL LETTER "


def replace_missing_characters(stream: io.TextIOWrapper) -> None:
    """Let a stream write similar ASCII characters for those that its encoding does not have.

    Parameters
    ----------
    stream
        Output of the program; it is changed.
    """
    codecs.register_error(_HANDLER, _replace)
    stream.reconfigure(errors=_HANDLER)


def _replace(error: UnicodeError) -> tuple[str, int]:
    """Return the replacement of a text that cannot be encoded, and where the encoding goes on."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = ""
    previous = error.object[: error.start][-1:]
    for character in error.object[error.start : error.end]:
        if character in _SUPERSCRIPTS and previous not in _SUPERSCRIPTS:
            text += "^"
        text += _similar(character)
        previous = character
    return text, error.end


def _similar(character: str) -> str:
    """Return an ASCII text that is similar to a character, or a question mark."""
    if character in _SIMILAR:
        return _SIMILAR[character]
    text = ""
    for component in unicodedata.normalize("NFKD", character):
        text += _similar_component(component)
    return text or "?"


def _similar_component(character: str) -> str:
    """Return an ASCII text that is similar to a component of a decomposed character.

    The text is empty if there is none, as for accents, which are components of their own.
    """
    if character.isascii():
        return character
    if character in _SIMILAR:
        return _SIMILAR[character]
    name = unicodedata.name(character, "")
    if name.startswith(_SMALL_GREEK):
        return name.removeprefix(_SMALL_GREEK).lower()
    if name.startswith(_CAPITAL_GREEK):
        return name.removeprefix(_CAPITAL_GREEK).title()
    return ""
