"""Entry point of the program, for ``python -m ldbb_bayes`` and the command ``ldbb-bayes``."""

from __future__ import annotations

import gc
import os
import signal
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType

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


class _Interruptions:
    """Record of whether the user pressed Ctrl-C.

    A library may turn the `KeyboardInterrupt` of Ctrl-C into an error of its own, or pass over it:
    Pydantic does both where it calls Python code while it makes or uses a validator.
    """

    def __init__(self) -> None:
        """Begin to record, unless Ctrl-C does something else than raise `KeyboardInterrupt`."""
        self.happened = False
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, self._interrupt)

    def _interrupt(self, signal_number: int, frame: FrameType | None) -> None:
        """Record that the user pressed Ctrl-C, and raise `KeyboardInterrupt`.

        Python calls this method with the number of the signal and the interrupted frame.
        """
        self.happened = True
        signal.default_int_handler(signal_number, frame)


def run() -> None:
    """Load the commands of this program, and run the command that the user typed.

    If the user presses Ctrl-C, even while the commands are being loaded, the program prints one
    line and ends with exit code 130. An error after Ctrl-C counts as its consequence.
    """
    interruptions = _Interruptions()
    # Let BLAS (the linear algebra library behind NumPy) use one thread, which is faster than
    # several because the matrices are small. NumPy reads these environment variables when it is
    # loaded.
    for variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    gc.set_threshold(_OBJECTS_BETWEEN_SEARCHES)
    try:
        main = _load_commands()
        if interruptions.happened:
            raise KeyboardInterrupt
        main()
    except KeyboardInterrupt:
        _end_interrupted()
    except Exception:
        if not interruptions.happened:
            raise
        _end_interrupted()


def _end_interrupted() -> None:
    """Print that the user interrupted the program, and end it with exit code 130."""
    message = "ldbb-bayes: interrupted; nothing is half-written."
    print(message, file=sys.stderr)  # noqa: T201, a message for the user
    sys.exit(130)


if __name__ == "__main__":
    run()
