"""make says which Debian package is missing instead of failing oddly."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")


def fake_python(folder: Path, *, refuse: str) -> Path:
    """A Python that fails for any command that mentions ``refuse``."""
    script = folder / "python"
    script.write_text(f'#!/bin/sh\ncase "$*" in *"{refuse}"*) exit 1;; esac\nexec {sys.executable} "$@"\n')
    script.chmod(0o755)
    return script


@pytest.mark.parametrize(
    ("refuse", "advice"),
    [("import venv", "apt install python3-venv python3-pip"), ("version_info", "Python 3.11 or newer is needed")],
)
@pytest.mark.parametrize("target", ["demo", "test"])
def test_missing_parts_are_named(root: Path, tmp_path: Path, refuse: str, advice: str, target: str) -> None:
    command = ["make", target, f"PYTHON={fake_python(tmp_path, refuse=refuse)}", f"VENV={tmp_path / 'venv'}"]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert advice in done.stdout
    assert not (tmp_path / "venv").exists()
