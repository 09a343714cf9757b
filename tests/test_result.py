"""Results: tables that are escaped, objects that show themselves in a notebook."""

from __future__ import annotations

from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.result import Table


def test_tables_are_escaped() -> None:
    page = Table.of("<script>", ["a<b", "n", "none"], [["<i>", 0.123456, None]], text=["a<b"]).html()
    assert "<script>" not in page
    assert "&lt;script&gt;" in page
    assert "0.1235" in page
    assert "–" in page


def test_result_objects_show_themselves() -> None:
    campaign = lb.Campaign(simulated(plan()).tests, name="<b>bold</b>")
    simulation = lb.HybridModel.first(0).simulate(campaign, seed=1)
    for thing in (campaign, campaign.plan(), lb.HybridModel.first(), lb.HybridModel.paper(), simulation, lb.preview(campaign)):
        page = thing._repr_html_()
        assert page.startswith("<table>")
        assert "<b>bold</b>" not in page
    assert "moves = together" in lb.HybridModel.first()._repr_html_()
