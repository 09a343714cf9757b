"""Figures and tables of a comparison: everything labelled, values where they belong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from rich.console import Console

from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.report.figures import compliance_with_local_fits, evidence, geometry_with_local_fits, predictive_p_values
from ldbb_bayes.report.text import (
    left_out_frame,
    left_out_table,
    models_table,
    sensitivity_frame,
    slopes_table,
    subsets_frame,
)


def drawn(figure: Figure) -> set[str]:
    figure.canvas.draw()
    labels = {label.get_text() for axes in figure.axes for label in (*axes.get_yticklabels(), *axes.get_xticklabels())}
    own = {text for axes in figure.axes for text in (axes.get_title(), axes.get_xlabel(), axes.get_ylabel())}
    return labels | own | {text.get_text() for axes in figure.axes for text in axes.texts}


def test_evidence(compared: Comparison) -> None:
    texts = drawn(evidence(compared))
    assert {"as in the model", "without ball form", "set-up shift of order 1 (centre) only"} <= texts
    assert "ln B(linear/constant) (nat)" in texts
    assert any(text.startswith("constant: 0.99") for text in texts)


def test_compliance_and_geometry(compared: Comparison) -> None:
    texts = drawn(compliance_with_local_fits(compared))
    assert {"C_XXX (µm/N)", "C_CCY (µrad/(N m))", "force (N)"} <= texts
    figure = compliance_with_local_fits(compared)
    local = compared.local_fits[compared.local_fits["parameter"] == "C_XYX"]
    crosses = [line.get_ydata() for line in figure.axes[1].lines if line.get_label() == "local, least squares"]
    np.testing.assert_allclose(crosses[0], local["least_squares"] * 1e3)
    texts = drawn(geometry_with_local_fits(compared))
    assert {"E_XX1 (µm/m)", "E_C(0Y)X (µrad)", "E_Yt0 (µm)"} <= texts


def test_p_values(compared: Comparison) -> None:
    texts = drawn(predictive_p_values(compared))
    assert {*compared.tests, "all", "Holm", "0", "12"} <= texts
    name, test = next(iter(compared.tests.items()))
    flagged = replace(compared, tests={name: replace(test, flag=True)})
    assert f"{name}  FLAGGED" in drawn(predictive_p_values(flagged))
    drawn(predictive_p_values(replace(compared, tests={})))


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
    for draw in (evidence, compliance_with_local_fits, geometry_with_local_fits):
        drawn(draw(bare))
    assert slopes_table(bare).rows == ()
    assert subsets_frame(bare).empty


def test_crossings_are_drawn(compared: Comparison) -> None:
    figure = evidence(replace(compared, prior_sensitivity_crossings=(0.5,)))
    assert any(np.allclose(line.get_xdata(), 0.5) for axes in figure.axes for line in axes.lines)


def test_tables(compared: Comparison, capsys: pytest.CaptureFixture[str]) -> None:
    console = Console(width=200, highlight=False)
    for table in (models_table(compared), slopes_table(compared), left_out_table(compared)):
        console.print(table.rich())
    shown = capsys.readouterr().out
    value, error = (own["linear/constant"] for own in (compared.log_bayes_factor, compared.log_bayes_factor_error))
    assert f"{value:+.3f} ± {error:.1g}" in shown
    frame = sensitivity_frame(compared)
    assert len(frame) == 12 + len(compared.assumptions)
    tests = left_out_frame(compared)
    assert len(tests) == 6 * (13 + 19)
    assert subsets_frame(compared)["probability"].sum() == pytest.approx(1.0)
    assert tests["unit"].notna().all()
