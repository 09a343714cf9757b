"""The study of batches still runs, small: every executor gives the same dataset and reports what is broken."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("pyarrow")
pytest.importorskip("distributed")


@pytest.mark.slow
def test_quick_run(root: Path, tmp_path: Path) -> None:
    script = root / "studies" / "91_fleet" / "run.py"
    done = subprocess.run(
        [sys.executable, str(script), "--quick", "--out", str(tmp_path)], capture_output=True, text=True, check=False, timeout=900
    )
    assert done.returncode == 0, done.stderr
    results = json.loads((tmp_path / "results.json").read_text())
    assert set(results["runs"]) == {
        f"{executor} {workers} {campaigns}" for executor in ("process", "dask") for workers, campaigns in ((1, 4), (2, 4), (2, 8))
    }
    assert all(run["reported"] and run["worker_MB"] > 50.0 for run in results["runs"].values())
    assert all(results["same_dataset"].values())
    assert [pool["machines"] for pool in results["population"]] == [20]
    assert "**A million campaigns.**" in (tmp_path / "README.md").read_text()
