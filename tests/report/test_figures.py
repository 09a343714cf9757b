"""Every figure: text inside the page that does not overlap, units on the axes, and values where they belong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from campaigns import plan, simulated
from layout import check_texts, check_units
from matplotlib.figure import Figure

import ldbb_bayes as lb
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.errors import InputError
from ldbb_bayes.report import figures
from ldbb_bayes.report.figures import FIGURES, corner, save_figures
from ldbb_bayes.report.findings import full_result
from ldbb_bayes.report.text import parameter_table, parts_of

QUICK = lb.StoppingRule(ess=100.0, rhat=1.5, lengths=0.2)
LEVELS = tuple(np.linspace(36.0, 742.0, 9))


# ---- of a posterior


def make(kind: str) -> xr.DataTree:
    if kind == "linear":
        return lb.sample(lb.HybridModel.first(1), simulated(plan()), rule=QUICK)
    if kind == "paper":
        return lb.sample(lb.HybridModel.paper(0), simulated(plan()), rule=QUICK)
    if kind == "one test, few readings":
        return lb.sample(lb.HybridModel.first(0), simulated(plan((9,), forces_N=(300.0,))), rule=QUICK)
    arcs = simulated(plan([30] * 11, forces_N=[50.0 + 60.0 * i for i in range(11)], arc_deg=300.0))
    return lb.sample(lb.HybridModel.first(2), arcs, sampler="independent", rule=QUICK)


@pytest.fixture(
    scope="module",
    params=[pytest.param("linear", marks=pytest.mark.slow), "paper", "one test, few readings", "eleven arcs, quadratic"],
)
def posterior(request: pytest.FixtureRequest) -> xr.DataTree:
    return make(request.param)


@pytest.mark.parametrize("name", FIGURES)
def test_texts_and_units(name: str, posterior: xr.DataTree) -> None:
    """Every text inside the page, no two over one another, a unit on every axis, true minus signs; the caller's settings are left
    alone."""
    before = dict(mpl.rcParams)
    figure = FIGURES[name](posterior)
    assert dict(mpl.rcParams) == before
    check_texts(figure)
    if name != "traces":
        check_units(figure)


def test_saved_in_both_formats_in_the_unit_of_the_tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compliances near 5e-5 mm/N read 50 nm/N in figures and in the tables of a fit."""
    two = {name: FIGURES[name] for name in ("forest", "compliance_against_force")}
    monkeypatch.setattr("ldbb_bayes.report.figures.posteriors.FIGURES", two)
    tree = lb.sample(lb.HybridModel.first(0), simulated(plan()), sampler="independent", rule=QUICK)
    written = save_figures(tree, tmp_path / "figures")
    assert len(written) == 4
    assert all(path.stat().st_size > 3000 for path in written)
    assert (tmp_path / "figures" / "forest.svg").read_text().startswith("<?xml")
    for name in two:
        text = (tmp_path / "figures" / f"{name}.svg").read_text()
        assert ("nm/N" in text, "µm/N" in text) == (True, False)
    assert "nm/N" in parameter_table(full_result(tree, 0.95)).frame()["unit"].tolist()


def test_choice_of_parameters(posterior: xr.DataTree) -> None:
    assert len(corner(posterior, ["C_XXX", "sigma"]).axes) == 4
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


@pytest.mark.parametrize("model", [lb.HybridModel.first(2), lb.HybridModel.paper(0)])
def test_identifiability_shows_every_parameter(model: lb.HybridModel) -> None:
    found = lb.identify(model, simulated(plan()))
    texts = drawn(figures.prior_and_posterior(found))
    for name in found.parameters:
        assert any(text.startswith(name.replace("E_C0YX", "E_C(0Y)X") + ":") for text in texts)


def test_comparisons(compared: Comparison) -> None:
    texts = drawn(figures.evidence(compared))
    assert {
        "as in the model",
        "without discrepancy",
        "slope scale 0.03",
        "ln B(linear/constant) (nat, linear within ±5)",
    } <= texts
    figure = figures.compliance_with_local_fits(compared)
    assert {"C_XXX (nm/N)", "C_CCY (µrad/(N m))", "force (N)"} <= drawn(figure)
    local = compared.local_fits[compared.local_fits["parameter"] == "C_XYX"]
    crosses = [line.get_ydata() for line in figure.axes[1].lines if line.get_label() == "local, least squares"]
    np.testing.assert_allclose(crosses[0], local["least_squares"] * 1e6)
    assert {"E_XX1 (µm/m)", "E_C(0Y)X (µrad)", "E_Yt0 (µm)"} <= drawn(figures.geometry_with_local_fits(compared))
    bare = replace(compared, slopes={}, slope_subsets=(), compliance_against_force={}, tests={}, prior_sensitivity=())
    bare = replace(bare, local_fits=pd.DataFrame())
    for draw in (figures.evidence, figures.compliance_with_local_fits, figures.geometry_with_local_fits):
        drawn(draw(bare))


def test_tables_of_a_comparison(compared: Comparison) -> None:
    models, assumptions, slopes, tests, *_ = parts_of(compared)
    value, error = (own["linear/constant"] for own in (compared.log_bayes_factor, compared.log_bayes_factor_error))
    assert models.rows[1][1] == f"{value:+.3f} ± {error:.1g}"
    assert len(assumptions.rows) == 12 + len(compared.discrepancy_sensitivity)
    assert (len(slopes.rows), len(tests.rows)) == (6, 6)


@pytest.mark.usefixtures("few_states")
@pytest.mark.parametrize("kind", ["proper", "flat"])
def test_designs(kind: str) -> None:
    pilot = simulated(plan(), seed=2)
    if kind == "flat":
        design = lb.design(lb.HybridModel.paper(1), plan(), tests=5, forces_N=LEVELS)
    else:
        design = lb.design(lb.HybridModel.first(1), pilot, tests=6, forces_N=LEVELS, against={"own": pilot})
    figure = figures.expected_widths(design)
    figure.canvas.draw()
    check_units(figure)
    (widths,) = figure.axes
    bars = dict(zip((label.get_text().split(" ")[0] for label in widths.get_yticklabels()), widths.patches, strict=True))
    scale = design.baseline["C_XXX"].sd if kind == "flat" else 1e-4
    assert bars["C_XXX"].get_width() == pytest.approx(design.expected["C_XXX"].sd / scale)
