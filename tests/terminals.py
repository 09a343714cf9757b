"""Reading of what a command shows at a pseudo terminal."""

from __future__ import annotations

import os
from contextlib import suppress


def read_to_the_end(terminal: int) -> bytes:
    """Return what is shown at a terminal until its other end is closed."""
    output = b""
    with suppress(OSError):  # how a terminal says that its other end is closed
        block = os.read(terminal, 4096)
        while block:
            output += block
            block = os.read(terminal, 4096)
    return output
