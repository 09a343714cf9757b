"""Translation of the annex, with its tables, lists, figures and hidden details.

The annex consists of the sections of the report that follow the two sheets of its certificate. Its
texts are made in English, and translated when the HTML page is made.
"""

from __future__ import annotations

import unicodedata
from dataclasses import replace
from typing import Any

from ldbb_bayes.report.figure_translation import translate_figure
from ldbb_bayes.report.pictures import Picture
from ldbb_bayes.report.sections import Details, Part, Section
from ldbb_bayes.report.text_translation import TextTranslation, catalogue_of
from ldbb_bayes.report.translation import Words
from ldbb_bayes.results import Table

__all__ = ["annex_translation", "section_in_language"]

# key of the section of a report's annex that lists technical terms in alphabetical order
_GLOSSARY = "glossary"


def annex_translation(words: Words, kept: frozenset[str]) -> TextTranslation | None:
    """Return an object that translates a report's annex into the language of the certificate.

    The annex consists of the sections of the report that follow the certificate.

    Parameters
    ----------
    words
        Texts of the test certificate, in its language.
    kept
        Texts that are not translated, such as names of tests.

    Returns
    -------
    TextTranslation or None
        None if the language has no catalogue for the annex. English has no catalogue, because the
        texts of the annex are made in English.
    """
    catalogue = catalogue_of(words.language, "annex")
    if catalogue is None:
        return None
    return TextTranslation(words, catalogue, kept)


def section_in_language(section: Section, translation: TextTranslation) -> Section:
    """Return a section of the annex with all its texts translated.

    Parameters
    ----------
    section
        Section of the annex, in English. Labels and titles of its figures are translated in the
        figures themselves; no copies of the figures are made.
    translation
        Translation into the language of the certificate.

    Returns
    -------
    Section
    """
    content = tuple(_translated_part(part, translation) for part in section.content)
    if section.key == _GLOSSARY:
        content = tuple(_in_alphabetical_order(part) for part in content)
    return Section(section.key, translation.text(section.title), content)


def _translated_part(part: Part, translation: TextTranslation) -> Part:
    """Return one part of a section, such as a table or a figure, with all its texts translated."""
    if isinstance(part, Picture):
        translate_figure(part.figure, translation.text)
        return Picture(part.key, translation.text(part.caption), part.figure)
    if isinstance(part, Details):
        content = tuple(translation.passage(passage) for passage in part.content)
        return Details(translation.text(part.summary), content)
    return translation.passage(part)


def _in_alphabetical_order(part: Any) -> Any:
    """Return a copy of a table whose rows are sorted by the text in the first column.

    The order is alphabetical. A letter with an umlaut comes after the same letter without an
    umlaut. If ``part`` is not a table, it is returned unchanged.
    """
    if not isinstance(part, Table):
        return part
    rows = sorted(part.rows, key=lambda row: unicodedata.normalize("NFD", str(row[0]).casefold()))
    return replace(part, rows=tuple(rows))
