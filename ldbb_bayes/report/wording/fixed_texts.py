"""Texts that need no choice of words, read from the file sentences.toml.

Most texts have a key, which names the kind of result that the text is about.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

__all__ = ["IN_FORCE", "PAGE", "SENTENCES"]

_TEMPLATES = Path(__file__).parents[1] / "templates"
SENTENCES: Mapping[str, Any] = tomllib.loads(
    (_TEMPLATES / "sentences.toml").read_text(encoding="utf-8")
)
PAGE: Mapping[str, Any] = SENTENCES["page"]
IN_FORCE = ("constant", "linear in force", "quadratic in force")
