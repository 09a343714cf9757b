"""Words by which the name of a column shows its role, such as angle, reading or time."""

from __future__ import annotations

import re
from functools import cache, lru_cache

from ldbb_bayes.reading.words import (
    ABSOLUTE_PRESSURE,
    LONGEST_NAME,
    OTHER_QUANTITY,
    ROLES,
    WORDS,
    comparable,
    without_accents,
)

__all__ = ["KEPT_HEADERS", "has_role"]

# The name, unit and roles of at most this number of headers are kept in memory, because many steps
# of an import need them again.
KEPT_HEADERS = 4096
# Words that may follow or precede "test" in the header of the column that names the tests.
_NUMBERING = {"name", "no", "nr", "number", "id", "label", "index"}
# ``words.toml`` lists words for each role. A listed word with at most this number of letters, such
# as "t" or "dir", must be a whole word of a header. A longer listed word may also be only the
# beginning of a word of the header.
_SHORT_WORD = 3
# Words in headers that begin like a word for time, but mean something else.
_NO_TIMES = WORDS["columns"]["no_time"].split()


@cache
def _plain_words(role: str) -> tuple[str, ...]:
    """Return the words for the role of a column, with their accents removed."""
    return tuple(without_accents(word) for word in ROLES[role])


@lru_cache(maxsize=KEPT_HEADERS)
def has_role(name: str, role: str) -> bool:
    """Return whether the name of a column contains a word for ``role``, such as angle or time.

    Accents are ignored. A word of the name may be longer than the word for the role: ``angles``
    begins with ``angle``. A word for a role that is as short as ``t`` must be equal to a word of
    the name. Words that begin like a word for time, but mean something else, are ignored for the
    role "time". For the role "test", every word of the name must be a word for a test or a word
    such as "number". For the roles "force" and "pressure", the name must not contain a word such as
    "maximum", which shows that the column holds another quantity. For the role "pressure", it must
    not say that the pressure is absolute.
    """
    name_words = re.findall(r"[^\W\d_]+", without_accents(comparable(name[:LONGEST_NAME])))
    role_words = _plain_words(role)
    if role == "time":
        name_words = [word for word in name_words if word not in _NO_TIMES]
    if role in ("force", "pressure") and OTHER_QUANTITY.search(" ".join(name_words)):
        return False
    if role == "pressure" and ABSOLUTE_PRESSURE.search(" ".join(name_words)):
        return False
    if role == "test" and not set(name_words) <= {*role_words, *_NUMBERING}:
        return False
    beginnings = tuple(word for word in role_words if len(word) > _SHORT_WORD)
    return any(word in role_words or word.startswith(beginnings) for word in name_words)
