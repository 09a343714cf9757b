"""The control chart: units on its axes, text inside the page and clear of other text, for few and many campaigns."""

from __future__ import annotations

from functools import partial
from importlib import import_module
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from trends import drawn_rows

import ldbb_bayes as lb
from ldbb_bayes.fleet.change import detection
from ldbb_bayes.fleet.charts import control_chart


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(import_module("ldbb_bayes.fleet.trend"), "detection", partial(detection, replicates=20, further=2))


@pytest.mark.parametrize("case", ["few", "many", "no dates", "one day", "one parameter"])
def test_control_chart(case: str) -> None:
    n, step_at = (60, 40) if case == "many" else (8, 5)
    rows = drawn_rows(n, np.random.default_rng(4), step_at=step_at)
    if case == "no dates":
        rows = rows.assign(date=None, machine_id=None)
    if case == "one day":
        rows = rows.assign(date="2026-01-01")
    chosen = {"one parameter": ["C_XXX"], "no dates": ["C_XXX", "C_YYY", "E_YX2"]}.get(case)
    found = lb.trend(rows, parameters=chosen)
    figure = control_chart(found)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert len(shown) == 2 * len(found.parameters)
    page = figure.bbox
    for axes in shown:
        low, high = axes.get_xlim()
        ticks = zip(axes.get_xticks(), axes.get_xticklabels(), strict=False)
        inside = [label for place, label in ticks if low <= place <= high and label.get_text()]
        boxes = [label.get_window_extent(renderer) for label in inside if label.get_visible()]
        assert all(one.x1 < other.x0 for one, other in pairwise(boxes))
        for text in (axes.title, axes.xaxis.label, axes.yaxis.label):
            box = text.get_window_extent(renderer)
            assert not text.get_text() or (box.x0 >= page.x0 and box.x1 <= page.x1 and box.y0 >= page.y0 and box.y1 <= page.y1)
    assert "(nm/N)" in shown[0].get_ylabel() + shown[1].get_ylabel()
    titles = [(axes.title.get_window_extent(renderer), axes.title.get_text()) for axes in shown]
    boxes = [box for box, text in titles if text]
    assert not any(one.overlaps(other) for i, one in enumerate(boxes) for other in boxes[i + 1 :])


def test_places_of_one_day_are_side_by_side() -> None:
    rows = drawn_rows(4, np.random.default_rng(1)).assign(date=["2026-01-01"] * 2 + ["2026-06-01"] * 2)
    figure = control_chart(lb.trend(rows, parameters=["C_XXX"]))
    bars = [patch.get_x() for patch in figure.axes[1].patches]
    assert len(bars) == 4
    assert np.all(np.diff(bars) > 0.0)
