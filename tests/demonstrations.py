"""`ldbb-bayes demo`, which takes half a minute: run once for all tests and pages that begin with
it."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

from filelock import FileLock

__all__ = ["Demonstration", "copied_demonstration", "demonstration_in"]


class Demonstration(NamedTuple):
    """How the command ended, what it printed, and the folder in which it was run."""

    exit_code: int
    stdout: str
    stderr: str
    folder: Path


def demonstration_in(place: Path) -> Demonstration:
    """Return the demonstration that is kept in a folder; run it where it is not there yet.

    Processes of tests that want it at the same time wait for the first.
    """
    place.mkdir(exist_ok=True)
    folder = place / "run"
    kept = place / "ended.json"
    with FileLock(place / "lock"):
        if not kept.exists():
            folder.mkdir()
            command = [sys.executable, "-W", "error", "-m", "ldbb_bayes", "demo"]
            ended = subprocess.run(
                command,
                cwd=folder,
                capture_output=True,
                text=True,
                check=False,
                stdin=subprocess.DEVNULL,
            )
            record = [ended.returncode, ended.stdout, ended.stderr]
            kept.write_text(json.dumps(record), encoding="utf-8")
    exit_code, stdout, stderr = json.loads(kept.read_text(encoding="utf-8"))
    return Demonstration(exit_code, stdout, stderr, folder)


def copied_demonstration(place: Path, folder: Path) -> str:
    """Copy what the command writes into a folder, and return what it printed."""
    demonstration = demonstration_in(place)
    if demonstration.exit_code != 0:
        sys.exit(f"ldbb-bayes demo\n{demonstration.stderr}")
    shutil.copytree(demonstration.folder / "ldbb_demo", folder / "ldbb_demo")
    return demonstration.stdout
