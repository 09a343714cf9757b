"""Translation of texts and tables, sentence by sentence, with catalogues of English texts.

All texts are first made in English, in the same words that the terminal shows. Where they are shown
in another language, each English text is looked up in a catalogue and replaced by its translation,
as in the program gettext. A key of the catalogue may have placeholders in braces, such as ``{a}``.
A placeholder stands for any text, which is translated too. A placeholder whose name begins with
``n`` stands only for numbers. A placeholder whose name begins with ``r`` stands for text that is
not translated, such as the text of a file. The program never reads results from sentences, so a
translation changes only the text that is shown.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from importlib.resources import files
from typing import Any, NamedTuple

from ldbb_bayes.report.translation import Words
from ldbb_bayes.results import Passage, Table

__all__ = ["Catalogue", "TextTranslation", "catalogue_of", "has_english"]

_TEMPLATES = files("ldbb_bayes.report") / "templates"
_PLACE = re.compile(r"\\\{(\w+)\\\}")
_NUMBER = r"[-+−±]?[\d.,eE−+<>≥≤ /\[\]…%°-]*\d[\d.,]*"
# Regular expression for a number with decimals, such as 1.5. It does not match a part of a date or
# of a version number, such as ``0.3`` in ``0.3.0``.
_DECIMALS = re.compile(r"(?<![\d.])(\d+)\.(\d+)(?!\d|\.\d)")
_SENTENCE_ENDS = re.compile(r"(?<=[.?!]) (?=[A-Z('{]|u[: ]|ln |\d+ %)")
# A text that is not in the catalogue of translations is split at one of these separators, and its
# pieces are translated separately. The separators are tried in this order: those that usually leave
# the longest pieces come first.
_SEPARATORS = ("; ", ": ", ", ", " and ", " or ")
_WORD = re.compile(r"(?<![\w./\\-])(?:[A-Za-z][a-z]{2,}|of|by|to|or|at|is|it|as)(?![\w/\\(=])")
# Symbols, units, names of programs, and other words that are the same in every language.
_SAME = frozenset(
    (
        "bar",
        "bayes",
        "cos",
        "decay",
        "delta",
        "eig",
        "elpd",
        "emcee",
        "eta",
        "kappa",
        "lambda",
        "ldbb",
        "linear",
        "Linux",
        "nat",
        "numpy",
        "omega",
        "Python",
        "scipy",
        "sigma",
        "sin",
        "tau",
    )
)
# Regular expression for a text that begins with the instrument, as "bar ± 1 µm" does. In other
# places, "bar" may be the unit of pressure, which is the same in every language.
_INSTRUMENT = re.compile(r"bar \S")
# Regular expression for an interval such as [1.5, 2.5]. In a language with a decimal comma, a
# semicolon is put between the two numbers.
_INTERVAL = re.compile(r"\[([^\[\],;]+), ([^\[\],;]+)\]")


class _SplitText(NamedTuple):
    """Pieces of an English text, and the word or sign that is put between the translated pieces."""

    pieces: list[str]
    word: str


@dataclass(frozen=True, eq=False)
class _Phrase:
    """An English text that has placeholders, and its translation with the same placeholders."""

    english: str
    translation: str

    def match(self, text: str) -> re.Match[str] | None:
        """Return how a text matches the whole English text, or None if it does not.

        Most texts differ from it before its first placeholder; its pattern is then not needed.
        """
        if not text.startswith(self.english.partition("{")[0]):
            return None
        return self._pattern.fullmatch(text)

    @cached_property
    def size(self) -> int:
        """Number of characters of the regular expression outside the placeholders."""
        return len(_PLACE.sub("", re.escape(self.english)))

    @cached_property
    def _pattern(self) -> re.Pattern[str]:
        """Regular expression for texts that have other texts in place of the placeholders."""
        fixed = re.escape(self.english)
        return re.compile(_PLACE.sub(_group_of_placeholder, fixed), re.DOTALL)


class Catalogue(NamedTuple):
    """Translations of English texts into one language."""

    #: Mapping from whole English texts to their translations into one language.
    entries: Mapping[str, str]
    #: translations of English texts that have placeholders; texts with the most characters outside
    #: the placeholders come first
    phrases: tuple[_Phrase, ...]


@dataclass(frozen=True, eq=False)
class TextTranslation:
    """Translation of English texts and tables into one language.

    Parameters
    ----------
    words
        Texts of the sheets of the test certificate, in the language of the translation.
    catalogue
        The translations of English texts.
    kept
        Texts that are not translated: names of campaigns and tests.
    missing
        English texts for which no translation was found so far.
    """

    words: Words
    catalogue: Catalogue
    kept: frozenset[str] = frozenset()
    missing: set[str] = field(default_factory=set)
    _stored_translations: dict[str, str | None] = field(default_factory=dict)

    def text(self, text: str) -> str:
        """Return the translation of an English text, with the decimal mark of the language.

        A text without a translation stays in English and is added to ``missing``.
        """
        return self._with_decimal_mark(self._translation_or_english(text))

    def passage(self, passage: Passage) -> Passage:
        """Return a table, paragraph or list with all its texts translated.

        A text of several lines, such as the model in TOML format, is returned unchanged.
        """
        if isinstance(passage, Table):
            return self._translated_table(passage)
        if isinstance(passage, tuple):
            return tuple(self.text(item) for item in passage)
        return passage if "\n" in passage else self.text(passage)

    def _translated_table(self, table: Table) -> Table:
        """Return a copy of a table with its caption, column headings and cells translated."""
        rows = []
        for row in table.rows:
            rows.append(tuple(self._translated_cell(cell) for cell in row))
        heads = tuple(self.text(head) for head in table.heads)
        return replace(table, caption=self.text(table.caption), heads=heads, rows=tuple(rows))

    def _translated_cell(self, cell: Any) -> Any:
        """Return a cell of a table. A text is translated, and a number is returned unchanged."""
        return self.text(cell) if isinstance(cell, str) else cell

    # ---- translation of one text

    def _translation_or_english(self, text: str) -> str:
        """Return the translation of a text, or the English text if there is no translation.

        A text without a translation is added to ``missing``.
        """
        translation = self._translation_or_none(text)
        if translation is None:
            self.missing.add(text)
            return text
        return translation

    def _translation_or_none(self, text: str) -> str | None:
        """Return the translation of a text, or None if a part of the text has no translation.

        Each result is stored, so that the same text is translated only once.
        """
        if text not in self._stored_translations:
            self._stored_translations[text] = self._find_translation(text)
        return self._stored_translations[text]

    def _find_translation(self, text: str) -> str | None:
        """Find the translation of a text, or return None if a part of the text has no translation.

        Names of campaigns and tests are returned unchanged. In a text without an English word, only
        pieces that are keys of the catalogue of translations are replaced. Any other text is first
        looked up as a whole. If the catalogue does not have it, the text is split, for example into
        its sentences, and the pieces are translated separately.
        """
        if text in self.kept:
            return text
        if not has_english(text):
            pieces = [self.catalogue.entries.get(piece, piece) for piece in text.split(": ")]
            return ": ".join(pieces)
        known = self._translation_of_whole_text(text)
        if known is not None:
            return known
        for joint in self._ways_to_split(text):
            translations = [self._translation_or_none(piece) for piece in joint.pieces]
            if None not in translations:
                return joint.word.join(map(str, translations))
        return self._translation_by_pattern(text, of_sentences=True)

    def _translation_of_whole_text(self, text: str) -> str | None:
        """Return the translation of a text if the whole text matches a key of the catalogue.

        The keys of the catalogue are English texts, and its values are translations. A key may have
        placeholders. A placeholder stands for any text that does not extend beyond one sentence.
        Return None if no key matches.
        """
        entries = self.catalogue.entries
        if text in entries:
            return entries[text]
        lower = entries.get(text[:1].lower() + text[1:])
        if lower is not None:
            return lower[:1].upper() + lower[1:]
        return self._translation_by_pattern(text)

    def _translation_by_pattern(self, text: str, *, of_sentences: bool = False) -> str | None:
        """Return the translation of a text that matches an English text with placeholders.

        If ``of_sentences`` is true, a placeholder may stand for several sentences. Return None if
        no pattern in the catalogue of translations matches the whole text, or if the text for which
        a placeholder stands has no translation.
        """
        for phrase in self.catalogue.phrases:
            match = phrase.match(text)
            if match is None:
                continue
            values = match.groupdict()
            if not of_sentences and any(map(_SENTENCE_ENDS.search, values.values())):
                continue
            places = {
                name: self._translation_of_placeholder(name, value)
                for name, value in values.items()
            }
            if None not in places.values():
                return phrase.translation.format(**places)
        return None

    def _translation_of_placeholder(self, name: str, value: str) -> str | None:
        """Return the translation of the text that replaces a placeholder in a sentence.

        ``name`` is the name of the placeholder, and ``value`` is the text. If the name begins with
        ``r`` (raw), the text must not be translated, and is returned unchanged. However, None is
        returned if such a text has several sentences, because the placeholder then matches more
        text than intended. For any other name, None is returned if a part of the text has no
        translation.
        """
        if not name.startswith("r"):
            return self._translation_or_none(value)
        return None if _SENTENCE_ENDS.search(value) else value

    def _ways_to_split(self, text: str) -> Iterator[_SplitText]:
        """Yield every way to split a text into pieces that can be translated separately.

        If the text has several sentences, the first way splits it into its sentences. Each further
        way splits the text at one kind of separator, such as a comma or the word "and".
        """
        sentences = _SENTENCE_ENDS.split(text)
        if len(sentences) > 1:
            yield _SplitText(sentences, " ")
        for joint in _SEPARATORS:
            if joint in text:
                word = self.catalogue.entries.get(joint.strip(), joint.strip())
                yield _SplitText(text.split(joint), joint.replace(joint.strip(), word))

    def _with_decimal_mark(self, text: str) -> str:
        """Return a text whose numbers and intervals are written as is usual in the language.

        Numbers get the decimal mark of the language. In a language with a decimal comma, an
        interval has a semicolon between its two numbers.
        """
        mark = str(self.words.table["decimal"])
        interval = self.words("interval", low=r"\g<1>", high=r"\g<2>")
        return _DECIMALS.sub(rf"\g<1>{mark}\g<2>", _INTERVAL.sub(interval, text))


@cache
def catalogue_of(language: str, *names: str) -> Catalogue | None:
    """Return the translations of English texts into a language.

    Parameters
    ----------
    language
        Code of the language, such as ``de``.
    *names
        Names of the catalogues, such as ``annex`` for the file templates/annex_de.toml. If several
        catalogues have the same key, the translation of the last of them is used.

    Returns
    -------
    Catalogue or None
        None if one of these catalogues does not exist for the language.
    """
    entries: dict[str, str] = {}
    for name in names:
        source = _TEMPLATES / f"{name}_{language}.toml"
        if not source.is_file():
            return None
        for table in tomllib.loads(source.read_text(encoding="utf-8")).values():
            entries |= table
    phrases = [_Phrase(key, entries[key]) for key in entries if "{" in key]
    return Catalogue(entries, tuple(sorted(phrases, key=lambda phrase: -phrase.size)))


def _group_of_placeholder(match: re.Match[str]) -> str:
    """Return the regular expression that replaces a placeholder in an English text.

    The expression is a group with the name of the placeholder. It matches every text that the
    placeholder can stand for: {a} stands for any text, and {n1} only for numbers. ``match`` is the
    regular-expression match that found the placeholder in a key of the catalogue.
    """
    inside = ".+?"
    if match[1].startswith("n"):
        inside = _NUMBER
    return f"(?P<{match[1]}>{inside})"


def has_english(text: str) -> bool:
    """Return whether a text contains an English word that needs a translation."""
    if _INSTRUMENT.match(text):
        return True
    return any(word not in _SAME for word in _WORD.findall(text))
