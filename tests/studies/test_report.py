"""studies/09_report: what the project's README and the issue say of it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import ldbb_bayes as lb


def test_what_is_stated(root: Path, recovered: lb.Campaign) -> None:
    results = json.loads((root / "studies" / "09_report" / "results.json").read_text(encoding="utf-8"))
    assert results["page_MB"] < 3.0
    assert results["shares_sum_to_one"]
    assert f"{100 * results['E_XX1_bar_length']:.0f} %" in (root / "docs" / "report.md").read_text(encoding="utf-8")
    posterior = lb.sample(lb.HybridModel.paper(0), recovered, sampler="independent", seed=1)
    size = lb.contributions(posterior).set_index("source")["peak_to_peak"]
    for name, value in results["peak_to_peak_um"].items():
        assert size[name] == pytest.approx(value["found"], rel=1e-6)
        assert 0.0 <= value["found"] - value["printed"] < 1.0
