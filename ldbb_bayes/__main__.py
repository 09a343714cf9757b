"""``python -m ldbb_bayes``, and the command ``ldbb-bayes``."""

from __future__ import annotations

import sys

__all__ = ["run"]


def run() -> None:
    """The command line; an interruption while it is still being loaded is one like any other."""
    try:
        from ldbb_bayes.cli import main

        main()
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        sys.exit(130)


if __name__ == "__main__":
    run()
