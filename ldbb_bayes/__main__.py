"""Entry point of the program, for ``python -m ldbb_bayes`` and the command ``ldbb-bayes``."""

from __future__ import annotations

import gc
import os
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["run"]

# Python searches for unreachable objects whenever this number of objects was added. It would search
# more often by itself.
_OBJECTS_BETWEEN_SEARCHES = 100_000


def _load_commands() -> Callable[[], None]:
    """Load the commands of this program and return the function that runs the one typed.

    The objects of the loaded libraries stay until the program ends. Python is told so
    (``gc.freeze``), because each search for unreachable objects, and the last one when the program
    ends, would otherwise go through all of them: a tenth of the time of a command.
    """
    gc.disable()
    # The commands are imported only here, because they load NumPy, which takes time.
    from ldbb_bayes.cli import main

    gc.freeze()
    gc.enable()
    return main


def run() -> None:
    """Load the commands of this program, and run the command that the user typed.

    If the user presses Ctrl-C, even while the commands are being loaded, the program prints one
    line and ends with exit code 130.
    """
    # Let BLAS (the linear algebra library behind NumPy) use one thread, which is faster than
    # several because the matrices are small. NumPy reads these environment variables when it is
    # loaded.
    for variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    gc.set_threshold(_OBJECTS_BETWEEN_SEARCHES)
    try:
        main = _load_commands()
        main()
    except KeyboardInterrupt:
        message = "ldbb-bayes: interrupted; nothing is half-written."
        print(message, file=sys.stderr)  # noqa: T201, a message for the user
        sys.exit(130)


if __name__ == "__main__":
    run()
