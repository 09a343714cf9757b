"""Texts of the test certificate in several languages.

The texts are read from the files templates/words_<language>.toml.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from ldbb_bayes.errors import check_known
from ldbb_bayes.model.terms import Term
from ldbb_bayes.report.wording import joined
from ldbb_bayes.units import display_name

__all__ = ["Words", "check_language", "languages", "words_of"]

_TEMPLATES = files("ldbb_bayes.report") / "templates"


@dataclass(frozen=True)
class Words:
    """Texts of the test certificate in one language.

    Parameters
    ----------
    language
        Code of the language, for example ``en``.
    table
        Content of the file templates/words_<language>.toml.
    """

    language: str
    table: Mapping[str, Any]

    def __call__(self, key: str, **values: str) -> str:
        """Return the test certificate's text with a given key, such as ``heads.value``.

        The text may have placeholders in braces, such as ``{force}``. ``values`` holds the text
        that replaces each placeholder.
        """
        words: Any = self.table
        for name in key.split("."):
            words = words[name]
        return str(words).format(**values)

    def number(self, text: str) -> str:
        """Return a text whose numbers have the decimal mark of the language (1,5 in German)."""
        return re.sub(r"(?<=\d)\.(?=\d)", str(self.table["decimal"]), text)

    def joined(self, items: Sequence[str]) -> str:
        """Return items as one string, such as "a, b and c", in the language of the texts."""
        return joined(items, str(self.table["and"]).strip())

    def unit(self, label: str) -> str:
        """Return the label of a unit, in which the word "per" is translated."""
        return label.replace(" per ", str(self.table["per"]))

    def percent(self, probability: float, *, below: float | None = None) -> str:
        """Return a probability in per cent as a string, such as "40 %".

        Probabilities below 1 % give "< 1 %", and probabilities above 99 % give "> 99 %". If a
        probability is known to be smaller than the limit ``below``, but would be rounded to it, it
        has one decimal place and is rounded down: 0.9496 is "94.9 %" below 0.95.
        """
        if below is not None and round(100.0 * probability) >= round(100.0 * below):
            percent = math.floor(1000.0 * probability) / 10.0
            return self("percent", value=self.number(f"{percent:.1f}"))
        shown = min(max(100.0 * probability, 1.0), 99.0)
        sign = ""
        if probability < 0.01:
            sign = "< "
        elif probability > 0.99:
            sign = "> "
        return self("percent", value=f"{sign}{shown:.0f}")

    def term(self, name: str) -> str:
        """Return the translated name of a model term or of a parameter.

        ``name`` is the class name of the model term, such as ``BarLength``, or the name of the
        parameter. The names of terms that a user has defined are not translated.
        """
        if name in self.table["terms"]:
            return str(self.table["terms"][name])
        if name in Term.kinds:
            return str(Term.kinds[name].words)
        return display_name(name)


def languages() -> tuple[str, ...]:
    """Return the codes, such as ``en``, of the languages in which the package has texts."""
    codes = []
    for entry in _TEMPLATES.iterdir():
        match = re.fullmatch(r"words_(\w+)\.toml", entry.name)
        if match:
            codes.append(match[1])
    return tuple(sorted(codes))


def check_language(language: str) -> None:
    """Raise an `InputError` if the package has no texts in a language.

    ``language`` is the code of the language, such as ``de``.
    """
    check_known("language", [language], languages(), " Leave it out for English.")


@cache
def words_of(language: str) -> Words:
    """Return the texts of the test certificate in the language ``language``.

    Parameters
    ----------
    language
        Code of the language. It must be one of the codes that `languages` returns.

    Returns
    -------
    Words

    Raises
    ------
    InputError
        The package has no texts in the language.
    """
    check_language(language)
    catalogue = _TEMPLATES / f"words_{language}.toml"
    return Words(language, tomllib.loads(catalogue.read_text(encoding="utf-8")))
