"""Templates for the HTML of the browser page, filled with texts in the language of the page."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import jinja2

from ldbb_bayes.app.cheapest import SEARCH_FIELDS
from ldbb_bayes.app.fields import FIELDS
from ldbb_bayes.app.page_words import words_of_page
from ldbb_bayes.files import LARGEST_TABLE_BYTES
from ldbb_bayes.report.message_translation import in_language, subject_in_language

__all__ = ["LARGEST_FILE", "MOST_FILES", "Templates"]

MOST_FILES = 400  # largest number of files that a session (one browser tab) may have
LARGEST_FILE = LARGEST_TABLE_BYTES


@jinja2.pass_context
def _with_decimal_mark(context: jinja2.runtime.Context, value: object) -> str:
    """Return a number as text with the decimal mark of the page's language.

    ``context`` holds the values with which the template is filled.
    """
    return re.sub(r"(?<=\d)\.(?=\d)", str(context["w"]["decimal"]), str(value))


@jinja2.pass_context
def _in_language_of_page(context: jinja2.runtime.Context, message: str) -> str | None:
    """Return a message in the language of the page, or None if the message exists only in English.

    Names of files, of the campaign and of its tests are not translated. ``context`` holds the
    values with which the template is filled.
    """
    names: list[str] = []
    if "session" in context:
        names += context["session"].file_sizes
    names += context["names"]
    return in_language(message, context["language"], names)


@jinja2.pass_context
def _subject_in_language_of_page(context: jinja2.runtime.Context, subject: str) -> str:
    """Return the name of what a note on imported files is about, in the language of the page.

    The page may have a name of its own for it. ``context`` holds the values with which the template
    is filled.
    """
    own_names = context["w"]["what"]
    if subject in own_names:
        return str(own_names[subject])
    return subject_in_language(subject, context["language"]) or subject


class Templates:
    """Templates of the browser page and of its sections; all inserted text is escaped."""

    def __init__(self) -> None:
        """Load the templates of the browser page, and the filters that the templates use."""
        self._environment = jinja2.Environment(
            loader=jinja2.PackageLoader("ldbb_bayes.app", "pages"),
            autoescape=True,
            undefined=jinja2.StrictUndefined,
        )
        self._environment.filters["number"] = _with_decimal_mark
        self._environment.filters["in_language"] = _in_language_of_page
        self._environment.filters["subject"] = _subject_in_language_of_page

    def show(self, name: str, language: str, *, names: Sequence[str] = (), **values: Any) -> str:
        """Return the page, or a section of the page, as HTML.

        Parameters
        ----------
        name
            File name of the template.
        language
            One of `LANGUAGES`.
        names
            Names of the campaign and of its tests, which are not translated in messages.
        **values
            Values that the template shows.

        Returns
        -------
        str
            The HTML.
        """
        template = self._environment.get_template(name)
        return template.render(
            w=words_of_page(language),
            language=language,
            names=names,
            fields=FIELDS,
            search_fields=SEARCH_FIELDS,
            most={"files": MOST_FILES, "bytes": LARGEST_FILE},
            **values,
        )
