"""Every figure: a Figure, units on the axes, text inside the page, labels that do not overlap."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import pytest
import xarray as xr
from campaigns import plan, simulated
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.mcmc import StoppingRule
from ldbb_bayes.report.figures import FIGURES, chains, corner, save_figures

QUICK = StoppingRule(ess=100.0, rhat=1.5, lengths=0.2)


def make(kind: str) -> xr.DataTree:
    if kind == "linear":
        return lb.sample(lb.HybridModel.default(1), simulated(plan()), rule=QUICK)
    if kind == "paper":
        return lb.sample(lb.HybridModel.paper(0), simulated(plan()), rule=QUICK)
    if kind == "one test, few readings":
        return lb.sample(lb.HybridModel.default(0), simulated(plan((9,), forces_N=(300.0,))), rule=QUICK)
    arcs = simulated(plan([30] * 11, forces_N=[50.0 + 60.0 * i for i in range(11)], arc_deg=300.0))
    return lb.sample(lb.HybridModel.default(2), arcs, sampler="independent", rule=QUICK)


@pytest.fixture(scope="module", params=["linear", "paper", "one test, few readings", "eleven arcs, quadratic"])
def posterior(request: pytest.FixtureRequest) -> xr.DataTree:
    return make(request.param)


def drawn(figure: Figure) -> FigureCanvasAgg:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return canvas


def visible_texts(figure: Figure) -> list[Text]:
    texts = []
    for axes in figure.axes:
        if not axes.get_visible():
            continue
        texts += [axes.title, axes.xaxis.label, axes.yaxis.label, *axes.texts]
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            ticks = zip(axis.get_majorticklocs(), axis.get_majorticklabels(), strict=False)
            texts += [label for place, label in ticks if low <= place <= high]
    return [text for text in texts if text.get_visible() and text.get_text().strip()]


@pytest.mark.parametrize("name", FIGURES)
def test_figure(name: str, posterior: xr.DataTree) -> None:
    figure = FIGURES[name](posterior)
    assert isinstance(figure, Figure)
    canvas = drawn(figure)
    page = figure.bbox
    renderer = canvas.get_renderer()
    texts = visible_texts(figure)
    boxes = [text.get_window_extent(renderer) for text in texts]
    for text, box in zip(texts, boxes, strict=True):
        assert box.x0 >= page.x0 - 2, text.get_text()
        assert box.x1 <= page.x1 + 2, text.get_text()
        assert box.y0 >= page.y0 - 2, text.get_text()
        assert box.y1 <= page.y1 + 2, text.get_text()
    for i in range(len(boxes)):
        for j in range(i):
            if texts[i].get_rotation() % 90 or texts[j].get_rotation() % 90:
                continue
            a, b = boxes[i], boxes[j]
            width = min(a.x1, b.x1) - max(a.x0, b.x0)
            height = min(a.y1, b.y1) - max(a.y0, b.y0)
            assert width <= 1.5 or height <= 1.5, f"{texts[i].get_text()!r} overlaps {texts[j].get_text()!r}"


@pytest.mark.parametrize("name", [name for name in FIGURES if name != "traces"])
def test_axes_carry_units(name: str, posterior: xr.DataTree) -> None:
    figure = FIGURES[name](posterior)
    labels = [axes.get_xlabel() for axes in figure.axes if axes.get_visible()]
    labels += [axes.get_ylabel() for axes in figure.axes if axes.get_visible()]
    given = [label for label in labels if label]
    assert given
    for label in given:
        assert "(" in label or label in ("value / prior sd", "value / posterior sd"), label


def test_settings_of_the_caller_are_left_alone(posterior: xr.DataTree) -> None:
    before = dict(mpl.rcParams)
    FIGURES["forest"](posterior)
    assert dict(mpl.rcParams) == before


def test_saved_in_both_formats(tmp_path: Path) -> None:
    tree = make("one test, few readings")
    written = save_figures(tree, tmp_path / "figures")
    assert len(written) == 2 * len(FIGURES)
    assert all(path.stat().st_size > 3000 for path in written)
    assert (tmp_path / "figures" / "forest.svg").read_text().startswith("<?xml")


def test_choice_of_parameters(posterior: xr.DataTree) -> None:
    tree = posterior
    assert len(corner(tree, ["C_XXX", "sigma"]).axes) == 4
    assert len(chains(tree, ["C_YYY"]).axes) == 2
    with pytest.raises(InputError, match="Did you mean 'C_XXX'"):
        corner(tree, ["C_XXx"])
