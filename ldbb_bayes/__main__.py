"""``python -m ldbb_bayes``, and the command ``ldbb-bayes``."""

from __future__ import annotations

import sys

__all__ = ["run"]


def run() -> None:
    """Load the commands and run the one typed; Ctrl-C at any time ends it with one line, exit code
    130."""
    try:
        from ldbb_bayes.cli import main

        main()
    except KeyboardInterrupt:
        print("ldbb-bayes: interrupted; nothing was written.", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    run()
