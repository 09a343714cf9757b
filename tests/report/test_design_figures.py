"""Figures of a design: drawn for every kind of one, with units on their axes and what they are about on them."""

from __future__ import annotations

import numpy as np
import pytest
from campaigns import plan, simulated
from matplotlib.figure import Figure

import ldbb_bayes as lb
from ldbb_bayes.report.figures import efficiency, expected_widths, information, trade_off

pytestmark = pytest.mark.usefixtures("few_states")
LEVELS = tuple(np.linspace(36.0, 742.0, 9))
KINDS = {
    "six": {"tests": 6, "curve": True},
    "clocked": {"tests": 4, "clockings_deg": ((0.0, 0.0), (45.0, 90.0), (90.0, 45.0)), "parameters": ("E_C0YX",), "curve": True},
    "two radii, no curve": {"tests": 4, "radii_mm": (150.0, 100.0)},
}


@pytest.fixture(scope="module", params=list(KINDS))
def design(request: pytest.FixtureRequest, few_states: None) -> lb.Design:
    pilot = simulated(plan(), seed=2)
    return lb.design(lb.HybridModel.default(1), pilot, forces_N=LEVELS, against={"own": pilot}, **KINDS[request.param])


@pytest.fixture(scope="module")
def flat(few_states: None) -> lb.Design:
    return lb.design(lb.HybridModel.paper(1), plan(), tests=5, forces_N=LEVELS, curve=True)


def labels(figure: Figure) -> list[str]:
    return [text for axes in figure.axes if axes.get_visible() for text in (axes.get_xlabel(), axes.get_ylabel()) if text]


@pytest.mark.parametrize("draw", [information, efficiency, trade_off, expected_widths], ids=lambda f: f.__name__)
def test_drawn(design: lb.Design, flat: lb.Design, draw: object) -> None:
    for one in (design, flat):
        figure = draw(one)  # type: ignore[operator]
        figure.canvas.draw()
        for label in labels(figure):
            assert "(" in label, label


def test_what_is_on_them(design: lb.Design) -> None:
    axes, below = information(design).axes
    shown = {t.force_N for t in design.tests}
    assert set(below.lines[0].get_xdata()) == shown
    assert axes.lines[-1].get_ydata()[0] == design.certificate.bound
    assert [t.get_text() for t in below.get_yticklabels()] == ["recommended", "equal steps", "own"]
    (widths,) = expected_widths(design).axes
    bars = {
        label.get_text().split(" ")[0]: bar.get_width()
        for label, bar in zip(widths.get_yticklabels(), widths.patches, strict=True)
    }
    assert bars["C_XXX"] == pytest.approx(design.expected["C_XXX"].sd / 1e-4)
