"""Figures of identifiability and the atlases: everything labelled, nothing drawn for nothing."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from campaigns import plan, simulated
from matplotlib.figure import Figure

import ldbb_bayes as lb
from ldbb_bayes.report.figures import (
    alias_map,
    compliance_atlas,
    correlation_map,
    geometric_atlas,
    nuisance_costs,
    prior_and_posterior,
)

CASES = {
    "plan": (lb.HybridModel.default(1), plan()),
    "two balls": (lb.HybridModel.default(0), plan(work_deg=40.0, tool_deg=-25.0)),
    "flat": (lb.HybridModel.paper(0), simulated(plan())),
    "quadratic": (lb.HybridModel.default(2), plan()),
}


@pytest.fixture(scope="module", params=CASES)
def found(request: pytest.FixtureRequest) -> lb.Identifiability:
    return lb.identify(*CASES[request.param])


@pytest.mark.parametrize("draw", [alias_map, correlation_map, nuisance_costs, prior_and_posterior])
def test_every_figure_draws_every_parameter(found: lb.Identifiability, draw: Callable[[lb.Identifiability], Figure]) -> None:
    figure = draw(found)
    figure.canvas.draw()
    texts = {label.get_text() for axes in figure.axes for label in (*axes.get_yticklabels(), axes.title)}
    if draw is alias_map and not found.alias.size:
        return
    for name in found.parameters:
        shown = name.replace("E_C0YX", "E_C(0Y)X")
        assert any(text == shown or text.startswith(shown + ":") for text in texts)


def test_atlases_are_tables_2_and_3() -> None:
    machine = lb.Machine("wCAFYXZSt")
    figure = compliance_atlas(machine)
    titles = [axes.get_title() for axes in figure.axes if axes.get_visible()]
    assert len(titles) == 18
    assert sum("no effect" in title for title in titles) == 5
    assert sum(axes.title.get_fontweight() == "bold" for axes in figure.axes) == 6
    assert len([axes for axes in geometric_atlas(machine).axes if axes.get_visible()]) == 7
