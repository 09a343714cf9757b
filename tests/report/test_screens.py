"""What print shows of the main results: one screen, with what matters, and the way to the rest."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd
import pytest
import xarray as xr
from matplotlib.figure import Figure

import ldbb_bayes as lb
from ldbb_bayes.analysis.verdicts import Verdict
from ldbb_bayes.report import figures, wording
from ldbb_bayes.report.identifiability_text import judged_quantities
from ldbb_bayes.units import (
    display_name,
    display_unit,
    is_slope,
    round_like,
    round_uncertainty,
    typeset,
)

LINES = 45
FORCES_N = (36.0, 238.0, 364.0, 490.0, 616.0, 742.0)
LINEAR = lb.HybridModel.default(degree=1)


@pytest.fixture(scope="module")
def identified(recovered: lb.Campaign) -> lb.analysis.Identifiability:
    return lb.identify(LINEAR, recovered)


@pytest.fixture(scope="module")
def posterior(recovered: lb.Campaign) -> xr.DataTree:
    rule = lb.inference.StoppingRule(ess=400.0)
    return lb.sample(LINEAR, recovered, sampler="independent", seed=1, rule=rule)


@pytest.fixture(scope="module")
def summary(posterior: xr.DataTree) -> pd.DataFrame:
    return lb.summarize(posterior)


@pytest.fixture(scope="module")
def designed(recovered: lb.Campaign) -> lb.analysis.Design:
    return lb.design(LINEAR, pilot=recovered, tests=6, forces_N=FORCES_N)


@pytest.fixture(params=[80, 100])
def width(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setenv("COLUMNS", str(request.param))
    return int(request.param)


def check_screen(text: str, width: int) -> None:
    """Check that a text fits on a screen and ends with the way to the rest."""
    lines = text.splitlines()
    assert len(lines) <= LINES, text
    assert max(map(len, lines)) <= width, text
    assert ".details())" in lines[-1]


def row_of(text: str, name: str) -> list[str]:
    """Return the cells of the table row of a parameter."""
    (line,) = [line for line in text.splitlines() if line.startswith(f"{name}  ")]
    return line.split()


def test_stiffness_prints_its_numbers(posterior: xr.DataTree, width: int) -> None:
    text = str(lb.stiffness(posterior, [389.0, 742.0]))
    forces = [line.split()[1] for line in text.splitlines() if line.startswith("k_min")]
    assert forces == ["389", "742"]
    assert max(map(len, text.splitlines())) <= width


def test_stiffness_of_many_forces_prints_the_largest(posterior: xr.DataTree, width: int) -> None:
    stiffness = lb.stiffness(posterior, FORCES_N)
    text = str(stiffness)
    check_screen(text, width)
    assert [line.split()[1] for line in text.splitlines() if line.startswith("k_min")] == ["N/µm"]
    assert len([line for line in stiffness.details().splitlines() if "k_min" in line]) == 6


def test_a_wide_terminal_does_not_make_long_lines(
    identified: lb.analysis.Identifiability, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "250")
    assert max(map(len, str(identified).splitlines())) <= 100


def test_identify_prints_a_row_for_each_parameter(
    identified: lb.analysis.Identifiability, width: int
) -> None:
    """U now, verdict, what holds it and how much, cheapest cure and U then."""
    text = str(identified)
    check_screen(text, width)
    quantities = judged_quantities(identified)
    for name, entry in quantities.items():
        factor = display_unit(entry.unit)[0]
        row = row_of(text, name)
        assert row[1] == round_uncertainty(2.0 * entry.sd * factor)[0]
        assert f"{entry.verdict}:" in row
        largest = next(iter(entry.partner_shares.values()), entry.held_by.share)
        assert f"{100.0 * largest:.0f} %" in " ".join(row)
        if entry.remedy is None:
            assert row[-1] == "–"
        else:
            assert row[-1] == round_uncertainty(2.0 * entry.remedy.sd * factor)[0]
            assert wording.remedy_in_words(entry.remedy) in " ".join(row)
    first_lines = " ".join(text.splitlines()[:2])
    for verdict in Verdict:
        number = sum(entry.verdict == verdict for entry in quantities.values())
        assert f"{number} " in first_lines.partition(str(verdict))[0]


def test_identify_prints_changes_with_force_instead_of_slopes(
    identified: lb.analysis.Identifiability, width: int
) -> None:
    text = str(identified)
    assert "C_XXX_1" not in text
    assert "Δ: change of a compliance from 36 N to 742 N." in " ".join(text.split())
    for name in ("C_XXX", "C_XYX", "C_YYY", "C_CXY", "C_CYY", "C_CCY"):
        u_now = row_of(text, f"Δ{name}")[1]
        change = identified.changes[name]
        assert u_now == round_uncertainty(2.0 * change.sd * display_unit(change.unit)[0])[0]
    assert "C_XXX_1  " in identified.details()


def test_identify_prints_every_certificate(
    identified: lb.analysis.Identifiability, width: int
) -> None:
    text = str(identified)
    for name, _ in wording.certificate_rows(identified):
        assert f"\n{wording.certificate_words(name)}  " in text


def test_details_of_identify_hold_every_cure(identified: lb.analysis.Identifiability) -> None:
    text = " ".join(identified.details().split())
    for sentence in lb.report.with_words(identified)["notes"]:
        assert sentence in text
    for entry in lb.report.with_words(identified)["degeneracies"]:
        last_cure = entry["cure"].rpartition(" or ")[2]
        assert last_cure.lower() in text.lower()


def test_summarize_prints_every_parameter(summary: pd.DataFrame, width: int) -> None:
    text = str(summary)
    check_screen(text, width)
    slopes = [name for name in summary.index if is_slope(str(name))]
    for name, entry in summary.drop(index=slopes).iterrows():
        factor = display_unit(entry["unit"])[0] if entry["unit"] else 1.0
        sd, decimals = round_uncertainty(entry["sd"] * factor)
        row = row_of(text, display_name(str(name)))
        for column in ("mean", "ci_low", "ci_high"):
            assert typeset(round_like(entry[column] * factor, decimals)) in row
        assert sd in row


def test_summarize_prints_changes_with_force_instead_of_slopes(
    summary: pd.DataFrame, posterior: xr.DataTree, width: int
) -> None:
    text = str(summary)
    assert "C_XXX_1" not in text
    for name, entry in lb.analysis.change_with_force(posterior).items():
        factor, _ = display_unit(entry.unit)
        sd, decimals = round_uncertainty(entry.change.sd * factor)
        row = row_of(text, f"{name} changes by")
        assert typeset(round_like(entry.change.mean * factor, decimals)) in row
        assert sd in row


def test_summarize_says_whether_its_numbers_can_be_used(summary: pd.DataFrame, width: int) -> None:
    caption = str(summary).splitlines()[0]
    assert summary.attrs["fit"].state in caption
    assert f"{summary['rhat'].max():.3f}" in caption
    ess = summary[["ess_bulk", "ess_tail"]].min(axis=None)
    assert f"{ess:.0f}" in caption


def test_printing_changes_no_value(summary: pd.DataFrame, posterior: xr.DataTree) -> None:
    assert "nm/N" in str(summary)
    mean = float(posterior["posterior"]["C_XXX"].mean())
    assert summary.loc["C_XXX", "mean"] == pytest.approx(mean, rel=1e-12)


def test_a_short_table_prints_all_its_columns(summary: pd.DataFrame, width: int) -> None:
    text = str(summary.iloc[:3])
    assert "details" not in text
    for column in summary.columns:
        assert str(column) in text


def test_compare_prints_the_evidence_first(compared: lb.analysis.Comparison, width: int) -> None:
    text = str(compared)
    check_screen(text, width)
    value, _ = compared.headline
    first, second = compared.pair
    opening = " ".join(text.splitlines()[:2])
    assert typeset(f"{value:+.2f}") in opening
    assert f"in favour of {second if value > 0 else first}" in opening
    for name, slope in compared.slopes.items():
        assert f"{display_name(name)} {slope.inclusion_probability:.2f}" in " ".join(text.split())
    for model in compared.models.values():
        assert f"{model.posterior_probability:.3g}" in text
    for assumed in compared.discrepancy_sensitivity:
        assert typeset(f"{assumed.log_bayes_factor:+.2f}") in text


def test_design_prints_tests_and_expected_u(designed: lb.analysis.Design, width: int) -> None:
    text = str(designed)
    check_screen(text, width)
    first_line = text.splitlines()[0]
    for row in designed.table.itertuples():
        assert f"{row.count} × {row.force_N:.4g} N" in first_line
    for name in designed.parameters:
        if is_slope(name):  # a coefficient of the change with force stands in the details
            assert f"{display_name(name)} " not in text
            continue
        expected = designed.expected[name]
        u = round_uncertainty(expected.sd * display_unit(expected.unit)[0])[0]
        assert row_of(text, display_name(name))[1] == u
    assert f"{designed.efficiency:.3f}" in text


def test_details_hold_all_sentences(
    identified: lb.analysis.Identifiability,
    compared: lb.analysis.Comparison,
    designed: lb.analysis.Design,
) -> None:
    sentences = [entry["statement"] for entry in lb.report.with_words(identified)["degeneracies"]]
    sentences += (
        lb.report.with_words(compared)["sentences"] + lb.report.with_words(designed)["sentences"]
    )
    texts = [result.details() for result in (identified, compared, designed)]
    everything = " ".join(" ".join(texts).split())
    for sentence in sentences:
        assert typeset(sentence) in everything


def test_details_of_a_table_hold_every_column(summary: pd.DataFrame, width: int) -> None:
    text = summary.details()  # type: ignore[operator]
    assert max(map(len, text.splitlines())) <= width
    for column in summary.columns:
        assert str(column) in text
    assert f"{summary.loc['C_XXX', 'ess_bulk']:.4g}" in text


def labels_of(figure: Figure) -> set[str]:
    labels = {text.get_text() for legend in figure.legends for text in legend.get_texts()}
    for axes in figure.axes:
        labels |= set(axes.get_legend_handles_labels()[1])
    return labels


def test_the_band_of_a_figure_is_called_what_it_is(compared: lb.analysis.Comparison) -> None:
    averaged = labels_of(figures.compliance_with_local_fits(compared))
    assert any("averaged" in label for label in averaged)
    without_average = replace(compared, compliance_against_force={})
    labels = labels_of(figures.compliance_with_local_fits(without_average))
    assert not any("averaged" in label for label in labels)
    first = next(iter(compared.models))
    assert any(label.endswith(f"%, {first}") for label in labels)
