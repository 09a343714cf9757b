"""Names of groups in the printout of a list of the program R, such as ``$`36```."""

from __future__ import annotations

import re

__all__ = ["with_runs_for_groups"]

# Regular expression for a line with the name of a group, as R prints it above the rows of a group.
_GROUP = re.compile(r"^\$(?:`(?P<quoted>[^`\n]+)`|(?P<plain>[A-Za-z.][\w.]*))[ \t]*$", re.MULTILINE)


def with_runs_for_groups(text: str) -> str:
    """Return a text in which each line with the name of a group of R names a run: ``Run 36``.

    The name may be the force of the circle, but R prints neither the quantity nor its unit.
    """
    return _GROUP.sub(lambda match: f"Run {match['quoted'] or match['plain']}", text)
