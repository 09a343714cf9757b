"""Entry point of the program, for ``python -m ldbb_bayes`` and the command ``ldbb-bayes``."""

from __future__ import annotations

import gc
import os
import sys

__all__ = ["run"]

# Python searches for unreachable objects whenever this number of objects was added. It would search
# more often by itself, and each search goes through all objects of the loaded libraries: together,
# this takes a tenth of the time of a command.
_OBJECTS_BETWEEN_SEARCHES = 100_000


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
        # The commands are imported only here, because they load NumPy, which takes time.
        from ldbb_bayes.cli import main

        main()
    except KeyboardInterrupt:
        message = "ldbb-bayes: interrupted; nothing is half-written."
        print(message, file=sys.stderr)  # noqa: T201, a message for the user
        sys.exit(130)


if __name__ == "__main__":
    run()
