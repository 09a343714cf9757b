"""Commands of the package, run in this process.

Typer reads all commands and options anew for every call of an app, which takes longer than to
import a file. Here they are read once.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from typing import NamedTuple
from unittest.mock import patch

import typer

from ldbb_bayes.cli import app

__all__ = ["Ended", "run_command"]

COMMAND_LINE = typer.main.get_command(app)


class Ended(NamedTuple):
    """How a command ended, and what it printed."""

    exit_code: int
    stdout: str
    stderr: str

    @property
    def output(self) -> str:
        """Return all that was printed."""
        return self.stdout + self.stderr


def run_command(arguments: Sequence[str]) -> Ended:
    """Run a command where no one can be asked: neither input nor output is a terminal."""
    stdout = io.StringIO()
    stderr = io.StringIO()
    nothing = io.StringIO()
    exit_code = 0
    with redirect_stdout(stdout), redirect_stderr(stderr), patch("sys.stdin", nothing):
        try:
            COMMAND_LINE.main(args=list(arguments))
        except SystemExit as ending:
            exit_code = int(ending.code or 0)
    return Ended(exit_code, stdout.getvalue(), stderr.getvalue())
