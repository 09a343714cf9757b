"""The machines of a population drawn: every one of a few, some of many, those that do not belong among them."""

from __future__ import annotations

import numpy as np
import pytest
from fleets import fleet
from matplotlib.colors import same_color

from ldbb_bayes.fleet.charts import _ODD, machine_chart
from ldbb_bayes.fleet.population import pool
from ldbb_bayes.report.figures import save_figure

OUTLIER = np.array([4.0, 0.0])


@pytest.mark.parametrize(("number", "shown"), [(6, 6), (80, 60)])
def test_machines(number: int, shown: int, tmp_path: object) -> None:
    found = pool(fleet(np.random.default_rng(1), machines=number, parameters=2, outlier=OUTLIER))
    figure = machine_chart(found)
    panels = [axes for axes in figure.axes if axes.get_visible()]
    assert [axes.get_xlabel() for axes in panels] == ["C_XXX (nm/N)", "C_XYX (nm/N)"]
    for axes in panels:
        intervals = [line for line in axes.lines if len(line.get_xdata()) == 2 and line.get_ydata()[0] == line.get_ydata()[1]]
        assert len(intervals) == 2 * shown
        odd = [line for line in intervals if same_color(line.get_color(), _ODD)]
        assert len(odd) == 1
        own = found.machine["M01"].estimate["C_XXX" if axes is panels[0] else "C_XYX"]
        assert np.asarray(odd[0].get_xdata(), dtype=float) * 1e-6 == pytest.approx(own.interval)
        assert "M01" in [label.get_text() for label in axes.get_yticklabels()]
    first, second = (path.read_bytes() for path in (save_figure(machine_chart(found), str(tmp_path), name)[0] for name in "ab"))
    assert first == second


def test_one_parameter_and_nothing_odd() -> None:
    figure = machine_chart(pool(fleet(np.random.default_rng(2), machines=3, parameters=1)))
    assert "does not belong" not in [text.get_text() for text in figure.legends[0].get_texts()]
    assert len(figure.axes) == 1
