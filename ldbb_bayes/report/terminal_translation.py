"""Translation of what the terminal shows of a report: assumptions, tables and sentences.

The texts are made in English, in the same words as those of other commands. They are looked up in
the catalogues of the annex and of messages, and in templates/terminal_<language>.toml. A text that
is in none of them stays in English.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from ldbb_bayes.reading.assumptions import Assumption
from ldbb_bayes.report.message_translation import (
    in_language,
    is_own_text,
    subject_in_language,
)
from ldbb_bayes.report.text_translation import TextTranslation, catalogue_of
from ldbb_bayes.report.translation import words_of
from ldbb_bayes.results import Passage, Table

__all__ = ["assumption_in_language", "printed_in_language"]

# Catalogues of sentences, and those of tables: heads of columns are not those of messages, in which
# the name of a quantity may be the subject of a sentence.
_CATALOGUES = ("annex", "messages", "terminal")
_CATALOGUES_OF_TABLES = ("annex", "terminal")


def assumption_in_language(
    assumption: Assumption, language: str, names: Iterable[str] = ()
) -> Assumption:
    """Return an assumption of an import with its texts in another language.

    Texts and names of the user's files are not translated.

    Parameters
    ----------
    assumption
        The assumption, in English.
    language
        Code of the language, such as ``de``.
    names
        Names of files, tests and campaigns, which are not translated.

    Returns
    -------
    Assumption
    """
    # A place is a path, or a list of paths, with the name of a sheet or table behind it.
    pieces = assumption.place.replace(": ", ", ").split(", ")
    kept = (*names, *(piece for piece in pieces if "." in piece))
    value = assumption.value
    if not is_own_text(assumption.what):
        value = in_language(value, language, kept) or value
    return replace(
        assumption,
        place=in_language(assumption.place, language, kept) or assumption.place,
        what=subject_in_language(assumption.what, language) or assumption.what,
        value=value,
        because=in_language(assumption.because, language, kept) or assumption.because,
        option=in_language(assumption.option, language, kept) or assumption.option,
    )


def printed_in_language(
    passages: Sequence[Passage], language: str, names: Iterable[str] = ()
) -> tuple[Passage, ...]:
    """Return tables, sentences and lists for the terminal in another language.

    Parameters
    ----------
    passages
        Tables, sentences and lists, in English. Those that are in the other language already are
        returned unchanged.
    language
        Code of the language, such as ``de``.
    names
        Names of files, tests and campaigns, which are not translated.

    Returns
    -------
    tuple
        The passages. They are returned unchanged if the language has no catalogues (files of
        translated texts), as is the case for English.
    """
    catalogue = catalogue_of(language, *_CATALOGUES_OF_TABLES)
    if catalogue is None:
        return tuple(passages)
    kept = tuple(names)
    translation = TextTranslation(words_of(language), catalogue, frozenset(kept))
    translated: list[Passage] = []
    for passage in passages:
        if isinstance(passage, Table):
            translated.append(translation.passage(passage))
        elif isinstance(passage, tuple):
            translated.append(tuple(_text(item, language, kept) for item in passage))
        else:
            translated.append(_text(passage, language, kept))
    return tuple(translated)


def _text(text: str, language: str, names: tuple[str, ...]) -> str:
    """Return a text in another language, or unchanged if a part of it is in no catalogue."""
    return in_language(text, language, names, catalogues=_CATALOGUES) or text
