"""The speed study still runs, without peers."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
def test_quick_run(root: Path, tmp_path: Path) -> None:
    script = root / "studies" / "90_speed" / "run.py"
    done = subprocess.run(
        [sys.executable, str(script), "--quick", "--out", str(tmp_path)], capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr
    results = json.loads((tmp_path / "results.json").read_text())
    assert set(results["race"]) == {"joint", "independent"}
    assert all(max(row["worst_mean_z"]) < 5.0 and max(row["worst_sd_error"]) < 0.15 for row in results["race"].values())
    assert "| joint |" in (tmp_path / "table.md").read_text()
