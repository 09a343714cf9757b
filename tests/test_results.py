"""How objects show themselves: short reprs, tables for a notebook, prints that hide no column."""

from __future__ import annotations

import pickle
from inspect import isclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from campaigns import plan, simulated
from fleets import drawn_rows
from reports import fitted

import ldbb_bayes as lb
from ldbb_bayes.inference.nodes import Evidence
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.results import Table, readable

MODEL = lb.HybridModel.first(0).without("discrepancy", "setup-shift")
FORCES_N = (36.0, 400.0, 742.0)


@pytest.fixture(scope="module")
def shown() -> tuple[list[Any], list[pd.DataFrame]]:
    """Objects of every public class, and the tables of every public function that returns one, the
    summary first."""
    tests = [
        lb.CircularTest(F, np.arange(40) * 9.0, direction=way)
        for F in FORCES_N
        for way in ("CW", "CCW")
    ]  # type: ignore[arg-type]
    campaign = lb.Campaign(simulated(lb.Campaign(tuple(tests))).tests, name="<b>bold</b>")
    posterior = fitted(MODEL, campaign)
    machine = campaign.machine()
    circle = campaign.tests[0].circle
    other = fitted(MODEL, lb.Campaign(simulated(campaign.plan(), seed=2).tests))
    design = lb.design(lb.HybridModel.paper(0), plan(), tests=3, forces_N=FORCES_N)
    squares = lb.least_squares(campaign)
    validation = lb.validate(MODEL, plan((24,) * 3, forces_N=FORCES_N), replicates=10, draws=9)
    rows = drawn_rows(6, np.random.default_rng(1), step_at=4)
    population = lb.population(rows.assign(machine_id=[f"M{k}" for k in range(6)]))
    prior = lb.PopulationPrior(400.0, 6, 6, {"C_XXX": 5e-5}, {"C_XXX": 1e-6}, "0" * 64, "wCAFYXZSt")
    columns = lb.Columns(("bow_cos5",), np.zeros((3, 25, 1)), np.ones(1))
    batch = lb.Batch(
        Path("b"),
        Path("b"),
        2,
        1,
        1,
        0,
        0,
        ({"campaign": "<b>", "reason": "none"},),
        (),
        1,
        2.0,
        resumed=False,
    )
    terms = [
        getattr(lb, name)()
        for name in lb.__all__
        if isclass(own := getattr(lb, name)) and issubclass(own, lb.Term)
    ]
    judged = lb.conformity(posterior, {"G": "30 µm", "C_XXX": "80 nm/N"})
    budgets = lb.budgets(posterior)
    angle = np.arange(8.0)
    verdict = next(iter(lb.verdicts(posterior).values()))
    return [
        campaign,
        campaign.plan(),
        campaign.tests[0],
        campaign.mount,
        campaign.force_law,
        campaign.instrument,
        machine,
        circle,
        MODEL,
        MODEL.bind(campaign),
        MODEL.prior,
        *terms,
        columns,
        lb.BasisNoise("kappa", np.ones(25)),
        lb.Ball(grade="G5"),
        lb.describe(machine),
        lb.Layout(forces_N=[36.0]),
        lb.preview(campaign),
        lb.identify(MODEL, campaign),
        verdict,
        squares,
        lb.uncertainties(campaign),
        lb.StoppingRule(),
        lb.Evidences(campaign),
        design,
        validation,
        population,
        prior,
        budgets,
        lb.trend(rows),
        batch,
        lb.Tolerance(upper=1.0),
        judged,
        judged["G"],
        budgets["C_XXX"],
        MODEL.simulate(campaign, seed=1),
        lb.Imported(campaign, lb.Layout(), (), ()),
        lb.log_density(MODEL, campaign),
        Gaussian.of(np.zeros(2), np.eye(2)),
    ], [
        lb.summarize(posterior),
        lb.nuisances(posterior),
        lb.circularity(posterior),
        lb.contributions(posterior),
        squares.table,
        *lb.measured_circularity(posterior),
        lb.marginals(MODEL, campaign),
        lb.differences(posterior, other),
        lb.local_fits(MODEL, campaign),
        lb.belonging({"constant": MODEL}, campaign, replicates=400),
        validation.coverage(),
        design.expected_table(),
        population.machines_table(),
        lb.patterns(machine, circle, angle),
        lb.hybrid_jacobian(machine, circle, angle, 300.0, degree=1),
    ]


def check_page(text: str) -> None:
    """Well-formed, accessible tables, and nothing that was not escaped."""
    elements = list(ElementTree.fromstring(f"<div>{text}</div>").iter())
    assert {own.tag for own in elements} <= {
        "div",
        "table",
        "caption",
        "thead",
        "tbody",
        "tr",
        "th",
        "td",
        "p",
    }
    assert len(elements) > 1
    assert all(own.get("scope") in ("col", "row") for own in elements if own.tag == "th")


def test_every_public_class_shows_itself(
    shown: Any, monkeypatch: pytest.MonkeyPatch, compared: lb.Comparison
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    objects = [*shown[0], compared]
    kinds = {kind for own in objects for kind in type(own).__mro__} | {
        lb.InputError,
        lb.Scale,
        lb.Unit,
    }
    assert [
        name for name in lb.__all__ if isclass(own := getattr(lb, name)) and own not in kinds
    ] == []
    for own in objects:
        assert len(repr(own).replace("\n", 80 * "!")) <= 80, type(own)
        check_page(own._repr_html_())
        assert max(map(len, str(own).splitlines())) <= 80
        assert not isinstance(own, dict) or all(
            name in str(own).replace("C(0Y)X", "C0YX") for name in own
        )
    assert "&lt;b&gt;" in objects[0]._repr_html_()
    assert " ln Z = 3.2432 ± 0.0012 nat, 512 nodes; readings d0d2d0d2>" in repr(
        Evidence(3.24318, 0.0012, 512, "d0d2" * 16)
    )
    assert (repr(lb.Prior.default()), repr(MODEL.scales[0])) == ("Prior()", "Scale('sigma')")
    assert (
        repr(lb.Instrument(bar_U_um=1.0))
        == "Instrument(work=Ball(), tool=Ball(), bar_length_error_um=0, bar_U_um=1)"
    )


def test_tables_show_every_column(shown: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    for table in shown[1]:
        text = str(table)
        assert max(map(len, text.splitlines())) <= 80, text
        assert {str(column) for column in table.columns} <= {
            word.rstrip(":") for word in text.split()
        }, text
        assert "…" not in text or len(table) > 60
        assert all(str(column) in table.to_string() for column in table.columns)
        check_page(table._repr_html_())


def test_a_printed_number_is_in_the_unit_beside_it(
    shown: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """5.5e-5 mm/N is printed as 55 nm/N, and kept."""
    monkeypatch.setenv("COLUMNS", "80")
    table = shown[1][0]
    name, unit, mean = next(
        line for line in str(table).splitlines() if line.startswith("C_XXX ")
    ).split()[:3]
    assert (unit, table.loc[name, "unit"]) == ("nm/N", "mm/N")
    assert float(mean) == pytest.approx(1e6 * table.loc[name, "mean"], rel=1e-3)
    back = pickle.loads(pickle.dumps(table))
    assert (str(back), back.attrs["fit"]) == (str(table), table.attrs["fit"])
    assert "nm/N" in str(table.loc[["C_XXX"], ["mean", "unit"]])


def test_a_long_table_shows_its_ends() -> None:
    text = str(readable(pd.DataFrame({"n": np.arange(500)}), "Numbers")).splitlines()
    assert text[0] == "Numbers, 500 rows"
    ends = [[str(k)] * 2 for k in (*range(30), *range(470, 500))]
    assert [line.split() for line in text[2:]] == [*ends[:30], ["…"] * 2, *ends[30:]]


def test_tables_are_escaped() -> None:
    page = Table.of(
        "<script>", ["a<b", "n", "none"], [["<i>", 0.123456, None]], text=["a<b"]
    ).html()
    assert "<script>" not in page
    assert all(text in page for text in ("&lt;script&gt;", "0.1235", "–"))
