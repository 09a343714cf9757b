"""Results in a notebook: escaped HTML for every result object, and the executed example."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.result import table_html


def test_tables_are_escaped() -> None:
    page = table_html("<script>", [{"a<b": "<i>", "n": 0.123456, "none": None}])
    assert "<script>" not in page
    assert "&lt;script&gt;" in page
    assert "0.1235" in page
    assert "–" in page


def test_result_objects_show_themselves() -> None:
    campaign = lb.Campaign(simulated(plan()).tests, name="<b>bold</b>")
    simulation = lb.HybridModel.default(0).simulate(campaign, seed=1)
    for thing in (campaign, campaign.plan(), lb.HybridModel.default(), lb.HybridModel.paper(), simulation, lb.preview(campaign)):
        page = thing._repr_html_()
        assert page.startswith("<table>")
        assert "<b>bold</b>" not in page
    assert "moves = together" in lb.HybridModel.default()._repr_html_()


@pytest.mark.slow
def test_the_example_notebook_runs(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    notebook = json.loads((root / "studies" / "00_first_hour" / "first_hour.ipynb").read_text())
    monkeypatch.chdir(root / "studies" / "00_first_hour")
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] for cell in cells)
    assert sum("image/png" in output.get("data", {}) for cell in cells for output in cell["outputs"]) == 2
    space: dict[str, object] = {}
    for cell in cells:
        lines = [line for line in "".join(cell["source"]).splitlines() if not line.startswith("%")]
        exec(compile("\n".join(lines), "first_hour.ipynb", "exec"), space)
