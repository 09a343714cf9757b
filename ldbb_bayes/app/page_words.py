"""Texts of the browser page in English and in German."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any

__all__ = ["LANGUAGES", "PAGES", "words_of_page"]

LANGUAGES = ("en", "de")
PAGES = files("ldbb_bayes.app") / "pages"


@cache
def words_of_page(language: str) -> Mapping[str, Any]:
    """Return the texts of the browser page in a language.

    Parameters
    ----------
    language
        Code of the language, which must be in `LANGUAGES`.

    Returns
    -------
    dict
        The texts; the keys are short names. The texts of each section of the page are in a separate
        dictionary, which is one of the values.
    """
    return tomllib.loads((PAGES / f"words_{language}.toml").read_text(encoding="utf-8"))
