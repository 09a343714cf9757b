"""Every figure: text inside the page that does not overlap, units on the axes, and values where they belong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from campaigns import plan, simulated
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

import ldbb_bayes as lb
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.errors import InputError
from ldbb_bayes.report import figures
from ldbb_bayes.report.figures import FIGURES, chains, corner, save_figures
from ldbb_bayes.report.text import left_out_frame, models_table, parts_of, sensitivity_frame, slopes_table, subsets_frame

QUICK = lb.StoppingRule(ess=100.0, rhat=1.5, lengths=0.2)
LEVELS = tuple(np.linspace(36.0, 742.0, 9))


# ---- of a posterior


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


def visible_texts(figure: Figure) -> list[Text]:
    texts = []
    for axes in filter(lambda own: own.get_visible(), figure.axes):
        texts += [axes.title, axes.xaxis.label, axes.yaxis.label, *axes.texts]
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            ticks = zip(axis.get_majorticklocs(), axis.get_majorticklabels(), strict=False)
            texts += [label for place, label in ticks if low <= place <= high]
    return [text for text in texts if text.get_visible() and text.get_text().strip()]


def check_units(figure: Figure) -> None:
    labels = [text for axes in figure.axes if axes.get_visible() for text in (axes.get_xlabel(), axes.get_ylabel()) if text]
    for label in labels:
        assert "(" in label or label in ("value / prior sd", "value / posterior sd"), label


@pytest.mark.parametrize("name", FIGURES)
def test_texts_and_units(name: str, posterior: xr.DataTree) -> None:
    """Every text inside the page, no two over one another, a unit on every axis; the caller's settings are left alone."""
    before = dict(mpl.rcParams)
    figure = FIGURES[name](posterior)
    assert dict(mpl.rcParams) == before
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    if name != "traces":
        check_units(figure)
    page, texts = figure.bbox, visible_texts(figure)
    boxes = [text.get_window_extent(canvas.get_renderer()) for text in texts]
    for text, box in zip(texts, boxes, strict=True):
        assert box.x0 >= page.x0 - 2, text.get_text()
        assert box.x1 <= page.x1 + 2, text.get_text()
        assert box.y0 >= page.y0 - 2, text.get_text()
        assert box.y1 <= page.y1 + 2, text.get_text()
    straight = [(text, box) for text, box in zip(texts, boxes, strict=True) if not text.get_rotation() % 90]
    for i, (one, a) in enumerate(straight):
        for other, b in straight[:i]:
            width, height = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
            assert width <= 1.5 or height <= 1.5, f"{one.get_text()!r} overlaps {other.get_text()!r}"


def test_saved_in_both_formats(tmp_path: Path) -> None:
    written = save_figures(make("one test, few readings"), tmp_path / "figures")
    assert len(written) == 2 * len(FIGURES)
    assert all(path.stat().st_size > 3000 for path in written)
    assert (tmp_path / "figures" / "forest.svg").read_text().startswith("<?xml")


def test_choice_of_parameters(posterior: xr.DataTree) -> None:
    assert len(corner(posterior, ["C_XXX", "sigma"]).axes) == 4
    assert len(chains(posterior, ["C_YYY"]).axes) == 2
    with pytest.raises(InputError, match="Did you mean 'C_XXX'"):
        corner(posterior, ["C_XXx"])


def test_atlases_are_tables_2_and_3() -> None:
    machine = lb.Machine("wCAFYXZSt")
    figure = figures.compliance_atlas(machine)
    titles = [axes.get_title() for axes in figure.axes if axes.get_visible()]
    assert len(titles) == 18
    assert sum("no effect" in title for title in titles) == 5
    assert sum(axes.title.get_fontweight() == "bold" for axes in figure.axes) == 6
    assert len([axes for axes in figures.geometric_atlas(machine).axes if axes.get_visible()]) == 7


# ---- of analyses


def drawn(figure: Figure) -> set[str]:
    """All texts of a figure."""
    figure.canvas.draw()
    labels = {label.get_text() for axes in figure.axes for label in (*axes.get_yticklabels(), *axes.get_xticklabels())}
    own = {text for axes in figure.axes for text in (axes.get_title(), axes.get_xlabel(), axes.get_ylabel())}
    return labels | own | {text.get_text() for axes in figure.axes for text in axes.texts}


@pytest.mark.parametrize(
    ("model", "campaign"),
    [
        pytest.param(lb.HybridModel.default(1), plan(), id="plan"),
        pytest.param(lb.HybridModel.default(0), plan(work_deg=40.0, tool_deg=-25.0), id="two balls"),
        pytest.param(lb.HybridModel.paper(0), simulated(plan()), id="flat"),
        pytest.param(lb.HybridModel.default(2), plan(), id="quadratic"),
    ],
)
def test_identifiability_shows_every_parameter(model: lb.HybridModel, campaign: lb.Campaign) -> None:
    found = lb.identify(model, campaign)
    for draw in (figures.alias_map, figures.correlation_map, figures.nuisance_costs, figures.prior_and_posterior):
        texts = drawn(draw(found))
        for name in found.parameters if draw is not figures.alias_map or found.alias.size else ():
            shown = name.replace("E_C0YX", "E_C(0Y)X")
            assert any(text == shown or text.startswith(shown + ":") for text in texts)


def test_evidence(compared: Comparison) -> None:
    texts = drawn(figures.evidence(compared))
    assert {"as in the model", "without ball form", "set-up shift of order 1 (centre) only"} <= texts
    assert "ln B(linear/constant) (nat)" in texts
    assert any(text.startswith("constant: 0.99") for text in texts)
    figure = figures.evidence(replace(compared, prior_sensitivity_crossings=(0.5,)))
    assert any(np.allclose(line.get_xdata(), 0.5) for axes in figure.axes for line in axes.lines)


def test_compliance_and_geometry(compared: Comparison) -> None:
    figure = figures.compliance_with_local_fits(compared)
    assert {"C_XXX (µm/N)", "C_CCY (µrad/(N m))", "force (N)"} <= drawn(figure)
    local = compared.local_fits[compared.local_fits["parameter"] == "C_XYX"]
    crosses = [line.get_ydata() for line in figure.axes[1].lines if line.get_label() == "local, least squares"]
    np.testing.assert_allclose(crosses[0], local["least_squares"] * 1e3)
    texts = drawn(figures.geometry_with_local_fits(compared))
    assert {"E_XX1 (µm/m)", "E_C(0Y)X (µrad)", "E_Yt0 (µm)"} <= texts


def test_p_values(compared: Comparison) -> None:
    texts = drawn(figures.predictive_p_values(compared))
    assert {*compared.tests, "all", "Holm", "0", "12"} <= texts
    name, test = next(iter(compared.tests.items()))
    flagged = replace(compared, tests={name: replace(test, flag=True)})
    assert f"{name}  FLAGGED" in drawn(figures.predictive_p_values(flagged))
    drawn(figures.predictive_p_values(replace(compared, tests={})))


def test_without_slopes_and_local_fits(compared: Comparison) -> None:
    bare = replace(
        compared,
        slopes={},
        slope_subsets=(),
        compliance_against_force={},
        local_fits=pd.DataFrame(),
        tests={},
        prior_sensitivity=(),
    )
    for draw in (figures.evidence, figures.compliance_with_local_fits, figures.geometry_with_local_fits):
        drawn(draw(bare))
    assert slopes_table(bare).rows == ()
    assert subsets_frame(bare).empty


def test_tables_of_a_comparison(compared: Comparison) -> None:
    value, error = (own["linear/constant"] for own in (compared.log_bayes_factor, compared.log_bayes_factor_error))
    assert models_table(compared).rows[1][1] == f"{value:+.3f} ± {error:.1g}"
    assert "slope scale 0.03" in str(parts_of(compared)[1])
    assert len(sensitivity_frame(compared)) == 12 + len(compared.assumptions)
    tests = left_out_frame(compared)
    assert len(tests) == 6 * (13 + 19)
    assert subsets_frame(compared)["probability"].sum() == pytest.approx(1.0)
    assert tests["unit"].notna().all()


CLOCKINGS = ((0.0, 0.0), (45.0, 90.0), (90.0, 45.0))
DESIGNS: dict[str, Callable[[lb.Campaign], lb.Design]] = {
    "six": lambda pilot: lb.design(
        lb.HybridModel.default(1), pilot, tests=6, curve=True, forces_N=LEVELS, against={"own": pilot}
    ),
    "clocked": lambda pilot: lb.design(
        lb.HybridModel.default(1), pilot, tests=4, clockings_deg=CLOCKINGS, parameters=("E_C0YX",), forces_N=LEVELS
    ),
    "two radii": lambda pilot: lb.design(lb.HybridModel.default(1), pilot, tests=4, radii_mm=(150.0, 100.0), forces_N=LEVELS),
    "flat": lambda _: lb.design(lb.HybridModel.paper(1), plan(), tests=5, forces_N=LEVELS, curve=True),
}


@pytest.mark.usefixtures("few_states")
@pytest.mark.parametrize("kind", DESIGNS)
def test_designs(kind: str) -> None:
    design = DESIGNS[kind](simulated(plan(), seed=2))
    for draw in (figures.information, figures.efficiency, figures.trade_off, figures.expected_widths):
        figure = draw(design)
        figure.canvas.draw()
        check_units(figure)
    axes, below = figures.information(design).axes
    assert set(below.lines[0].get_xdata()) == {test.force_N for test in design.tests}
    assert axes.lines[-1].get_ydata()[0] == design.certificate.bound
    assert [label.get_text() for label in below.get_yticklabels()] == ["recommended", *(own.name for own in design.compared)]
    (widths,) = figures.expected_widths(design).axes
    bars = dict(zip((label.get_text().split(" ")[0] for label in widths.get_yticklabels()), widths.patches, strict=True))
    scale = design.baseline["C_XXX"].sd if kind == "flat" else 1e-4
    assert bars["C_XXX"].get_width() == pytest.approx(design.expected["C_XXX"].sd / scale)
