"""Translation of messages: notes on files that were read, remarks, and error messages.

The messages are made in English where files are read and checked. To show a message in another
language, the text of the message is looked up in the catalogues templates/messages_<language>.toml
and templates/annex_<language>.toml. Texts in quotation marks come from files, and are not
translated.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from ldbb_bayes.report.text_translation import TextTranslation, catalogue_of
from ldbb_bayes.report.translation import words_of

__all__ = ["OwnWords", "in_language", "is_own_text", "subject_in_language"]

# Parts of a message that are the same in every language: text in quotation marks as Python writes
# it, and names of files such as campaign.toml. The apostrophe in "ball's" is no quotation mark.
_QUOTED = r"(?<!\w)'(?:[^'\\]|\\.)*'|\"(?:[^\"\\]|\\.)*\""
_SAME = rf"{_QUOTED}|\b\w+\.toml\b"
# While a message is translated, a single character stands for each part that is the same in every
# language. ``_FIRST_MARK`` and ``_LAST_MARK`` are the first and the last of these characters.
# Unicode assigns no meaning to them.
_FIRST_MARK = 0xE000
_LAST_MARK = 0xF8FF

# Subjects of notes that contain words copied from a file of the user. For example, a note on the
# operator contains the name of the operator. These words must not be translated.
_OWN_TEXTS = frozenset(
    (
        "[[test]] not used",
        "ball_bar",
        "columns not used",
        "encoding",
        "force_device",
        "machine_id",
        "machine_type",
        "name of the test",
        "operator",
        "place",
        "serial_number",
        "test of each row",
        "texts not used",
    )
)


def is_own_text(subject: str) -> bool:
    """Return whether the value in a note is a text or a name that must not be translated.

    ``subject`` is what the note is about. For example, a note with the subject "operator" contains
    the operator's name.
    """
    return subject in _OWN_TEXTS


@dataclass
class OwnWords:
    """Parts of a message that must not be translated, each with a character that stands for it.

    `hide` replaces each part by its character before the translation; `show` puts the parts back
    after the translation.

    Parameters
    ----------
    names
        Names of files. They are not translated, wherever they stand in the message.
    """

    names: Iterable[str] = ()
    _parts: list[str] = field(default_factory=list)

    def hide(self, message: str) -> str:
        """Return a message in which one character stands for each part that must not be translated.

        `show` puts these parts back.

        Parameters
        ----------
        message
            The message.

        Returns
        -------
        str
        """
        longest_first = sorted(self.names, key=len, reverse=True)
        names = [rf"(?<!\w){re.escape(name)}(?!\w)" for name in longest_first if "." in name]
        return re.sub("|".join([*names, _SAME]), self._mark, message)

    def show(self, message: str) -> str:
        """Return a message in which the parts that `hide` took out are put back.

        Parameters
        ----------
        message
            The message that `hide` returned, or its translation.

        Returns
        -------
        str
        """
        for k, text in enumerate(self._parts):
            message = message.replace(chr(_FIRST_MARK + k), text)
        return message

    def _mark(self, match: re.Match[str]) -> str:
        """Store a part of a message that must not be translated, and return a stand-in for it.

        ``match`` is the match of a regular expression; its text is this part. The
        stand-in is a single character. If no unused character is left, the part is not stored, and
        is returned unchanged.
        """
        mark = _FIRST_MARK + len(self._parts)
        if mark > _LAST_MARK:
            return match[0]
        self._parts.append(match[0])
        return chr(mark)


def subject_in_language(subject: str, language: str) -> str | None:
    """Return the name, in another language, of what a note on imported files is about.

    Parameters
    ----------
    subject
        The subject in English, such as "force_N" or "left out".
    language
        Code of the language, such as ``de``.

    Returns
    -------
    str or None
        The name from the catalogue templates/subjects_<language>.toml. If this catalogue does not
        have the subject, it is translated like a message; see `in_language`.
    """
    catalogue = catalogue_of(language, "subjects")
    if catalogue is not None and subject in catalogue.entries:
        return catalogue.entries[subject]
    return in_language(subject, language)


def in_language(
    message: str,
    language: str,
    names: Iterable[str] = (),
    *,
    catalogues: Sequence[str] = ("annex", "messages"),
) -> str | None:
    """Return a message in another language.

    Parameters
    ----------
    message
        The message in English.
    language
        Code of the language, such as ``de``.
    names
        Names of files, tests and campaigns, which are not translated.
    catalogues
        Names of the catalogues in which the message is looked up, such as ``annex`` for the file
        templates/annex_de.toml.

    Returns
    -------
    str or None
        The translated message; None if a part of the message is not in the catalogues (files of
        translated texts). The message is returned unchanged if the language has no catalogues,
        as is the case for English.
    """
    catalogue = catalogue_of(language, *catalogues)
    if catalogue is None:
        return message
    kept = frozenset(names)
    own_words = OwnWords(kept)
    # Two versions of the message are looked up in the catalogues (files of translated texts). In
    # the first version, `OwnWords.hide` has replaced all texts in quotation marks. The second is
    # the original message, which is needed because some texts in the catalogues contain quotation
    # marks.
    for text in (own_words.hide(message), message):
        translation = TextTranslation(words_of(language), catalogue, kept)
        translated = translation.text(text)
        if not translation.missing:
            return own_words.show(translated)
    return None
