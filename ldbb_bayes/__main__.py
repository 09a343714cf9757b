"""``python -m ldbb_bayes``, and the command ``ldbb-bayes``."""

from __future__ import annotations

from ldbb_bayes.cli import main as run

__all__ = ["run"]

if __name__ == "__main__":
    run()
