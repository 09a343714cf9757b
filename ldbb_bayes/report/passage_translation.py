"""Translation of texts about the cheapest campaign for goals, and about the next circle."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ldbb_bayes.report.text_translation import TextTranslation, catalogue_of
from ldbb_bayes.report.translation import words_of
from ldbb_bayes.results import Passage

__all__ = ["passages_in_language", "untranslated_texts"]

_CATALOGUES = ("annex", "goal_design", "next_circle")


def passages_in_language(
    passages: Sequence[Passage], language: str, names: Iterable[str] = ()
) -> tuple[Passage, ...]:
    """Translate tables and sentences about planned circles into another language.

    They are about the cheapest campaign that reaches goals for uncertainties, or about the next
    circle of a campaign. The English texts are looked up in the catalogues
    templates/annex_<language>.toml, templates/goal_design_<language>.toml and
    templates/next_circle_<language>.toml. A text that is in none of them stays in English.

    Parameters
    ----------
    passages
        Tables and sentences in English.
    language
        Code of the language, such as ``de``.
    names
        Names of campaigns and tests, which are not translated.

    Returns
    -------
    tuple
        The tables and sentences. They are returned unchanged if the language has no catalogues, as
        is the case for English.
    """
    translation = _translation(language, names)
    if translation is None:
        return tuple(passages)
    return tuple(translation.passage(passage) for passage in passages)


def untranslated_texts(
    passages: Sequence[Passage], language: str, names: Iterable[str] = ()
) -> set[str]:
    """Return the English texts of tables and sentences that have no translation into a language.

    ``passages`` are the tables and sentences. ``language`` is the code of the language, such as
    ``de``. ``names`` are the names of campaigns and tests, which need no translation. The result is
    empty if the language has no catalogues (files of translated texts). This is the case for
    English.
    """
    translation = _translation(language, names)
    if translation is None:
        return set()
    for passage in passages:
        translation.passage(passage)
    return translation.missing


def _translation(language: str, names: Iterable[str]) -> TextTranslation | None:
    """Return an object that translates texts about planned circles into a language.

    None is returned if the language has no catalogues (files of translated texts). ``names`` are
    the names of campaigns and tests. They are not translated, even if they stand in quotation
    marks.
    """
    catalogue = catalogue_of(language, *_CATALOGUES)
    if catalogue is None:
        return None
    kept = frozenset(name for text in names for name in (text, repr(text)))
    return TextTranslation(words_of(language), catalogue, kept)
