"""Text files in the format TOA5, which data loggers of Campbell Scientific write."""

from __future__ import annotations

import re

__all__ = ["without_kinds_of_samples"]

# Regular expression for the first line of a file in the format TOA5.
_FIRST_LINE = re.compile(r'\s*"?TOA5"?,')
# Index, in a file in the format TOA5, of the line with words such as "Smp" or "Avg", which state
# how each column was sampled.
_LINE_OF_SAMPLES = 3


def without_kinds_of_samples(text: str) -> str:
    """Return a file of a data logger without the line that states how columns were sampled.

    In the format TOA5, this line stands below the names and units of the columns, and holds words
    such as "Smp" and "Avg". Any other text is returned unchanged.
    """
    lines = text.split("\n")
    if _FIRST_LINE.match(text) is None or len(lines) <= _LINE_OF_SAMPLES:
        return text
    lines[_LINE_OF_SAMPLES] = ""
    return "\n".join(lines)
