"""How objects show themselves: short reprs, tables for a notebook, prints that hide no column."""

from __future__ import annotations

import pickle
from inspect import isclass
from pathlib import Path
from pkgutil import resolve_name
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from campaigns import plan, simulated
from fleets import drawn_rows
from public_names import public_names
from reports import fitted

import ldbb_bayes as lb
from ldbb_bayes.inference.evidence_value import Evidence
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.results import ByName, Shown, Table, parts_of, readable, register_when_displayed

MODEL = lb.HybridModel.first(0).without("discrepancy", "setup-shift")
FORCES_N = (36.0, 400.0, 742.0)

pytestmark = pytest.mark.usefixtures("few_states_of_module")


@pytest.fixture(scope="module")
def campaign() -> lb.Campaign:
    tests = []
    for force_N in FORCES_N:
        tests.append(lb.CircularTest(force_N, np.arange(40) * 9.0, direction="CW"))
        tests.append(lb.CircularTest(force_N, np.arange(40) * 9.0, direction="CCW"))
    return lb.Campaign(simulated(lb.Campaign(tuple(tests))).tests, name="<b>bold</b>")


@pytest.fixture(scope="module")
def posterior(campaign: lb.Campaign) -> xr.DataTree:
    return fitted(MODEL, campaign)


@pytest.fixture(scope="module")
def design() -> lb.analysis.Design:
    return lb.design(lb.HybridModel.paper(0), plan(), tests=3, forces_N=FORCES_N)


@pytest.fixture(scope="module")
def validation() -> lb.analysis.Validation:
    return lb.calibrate(MODEL, plan((24,) * 3, forces_N=FORCES_N), replicates=10, draws=9)


@pytest.fixture(scope="module")
def machines() -> pd.DataFrame:
    return drawn_rows(6, np.random.default_rng(1), step_at=4)


@pytest.fixture(scope="module")
def population(machines: pd.DataFrame) -> lb.fleet.Population:
    return lb.fleet.fit_population(machines.assign(machine_id=[f"M{k}" for k in range(6)]))


def public_terms() -> list[lb.terms.Term]:
    terms = []
    for kind in lb.terms.Term.kinds.values():
        terms.append(kind())
    return terms


def batch_with_a_failure() -> lb.fleet.Batch:
    failure = {"campaign": "<b>", "reason": "none"}
    folder = Path("b")
    numbers = (2, 1, 1, 0, 0, (failure,), (), 1, 2.0)
    return lb.fleet.Batch(folder, folder, folder, *numbers, resumed=False)


@pytest.fixture(scope="module")
def objects_of_campaign(campaign: lb.Campaign) -> list[Any]:
    machine = campaign.machine()
    return [
        campaign,
        campaign.plan(),
        campaign.tests[0],
        campaign.mount,
        campaign.force_law,
        campaign.instrument,
        machine,
        campaign.tests[0].circle,
        lb.Ball(grade="G5"),
        lb.describe_machine(machine),
        lb.reading.Layout(forces_N=[36.0]),
        lb.check_campaign(campaign),
        lb.terms.uncertainties(campaign),
        lb.reading.Imported(campaign, lb.reading.Layout(), (), ()),
    ]


@pytest.fixture(scope="module")
def objects_of_model(campaign: lb.Campaign) -> list[Any]:
    return [
        MODEL,
        MODEL.bind(campaign),
        MODEL.prior,
        *public_terms(),
        lb.terms.Columns(("bow_cos5",), np.zeros((3, 25, 1)), np.ones(1)),
        lb.terms.BasisNoise("kappa", np.ones(25)),
        lb.identify(MODEL, campaign),
        lb.inference.StoppingRule(),
        lb.inference.Evidences(campaign),
        MODEL.simulate(campaign, seed=1),
        lb.log_density(MODEL, campaign),
        Gaussian.of(np.zeros(2), np.eye(2)),
        lb.fleet.PopulationPrior(
            400.0, 6, 6, {"C_XXX": 5e-5}, {"C_XXX": 1e-6}, "0" * 64, "wCAFYXZSt"
        ),
    ]


@pytest.fixture(scope="module")
def objects_of_results(
    campaign: lb.Campaign,
    posterior: xr.DataTree,
    design: lb.analysis.Design,
    validation: lb.analysis.Validation,
    population: lb.fleet.Population,
    machines: pd.DataFrame,
    compared: lb.analysis.Comparison,
) -> list[Any]:
    conformity = lb.assess_conformity(posterior, {"G": "30 µm", "C_XXX": "80 nm/N"})
    budgets = lb.analysis.budget_uncertainty(posterior)
    changes = lb.analysis.change_with_force(fitted(MODEL.with_degree(1), campaign))
    stiffness = lb.stiffness(posterior)
    gum = lb.analysis.validate_gum(posterior)
    goals = {"C_XXX": "5nm/N"}
    return [
        gum,
        gum.parameters["C_XXX"],
        lb.analysis.Costs(),
        lb.analysis.ChangedParameters(("C_XXX", "C_YYY"), ("C_XXX",), 11),
        lb.design(MODEL, campaign, goals=goals, forces_N=FORCES_N),
        lb.analysis.next_circle(MODEL, campaign, goals=goals),
        next(iter(lb.analysis.judge_posterior(posterior).values())),
        lb.fit_least_squares(campaign),
        design,
        validation,
        population,
        budgets,
        budgets["C_XXX"],
        lb.fleet.find_trend(machines),
        batch_with_a_failure(),
        lb.analysis.Tolerance(upper=1.0),
        conformity,
        conformity["G"],
        changes,
        changes["C_XXX"],
        compared,
        stiffness,
        stiffness.planes[0],
        lb.analysis.check_workflow(MODEL, campaign, replicates=10),
    ]


@pytest.fixture(scope="module")
def objects(
    objects_of_campaign: list[Any], objects_of_model: list[Any], objects_of_results: list[Any]
) -> list[Any]:
    """Objects of every public class, the campaign first."""
    return [*objects_of_campaign, *objects_of_model, *objects_of_results]


@pytest.fixture(scope="module")
def tables(
    campaign: lb.Campaign,
    posterior: xr.DataTree,
    design: lb.analysis.Design,
    validation: lb.analysis.Validation,
    population: lb.fleet.Population,
) -> list[pd.DataFrame]:
    """The tables of every public function that returns one, the summary first."""
    machine = campaign.machine()
    circle = campaign.tests[0].circle
    angle = np.arange(8.0)
    other_posterior = fitted(MODEL, lb.Campaign(simulated(campaign.plan(), seed=2).tests))
    return [
        lb.summarize(posterior),
        lb.inference.summarize_nuisances(posterior),
        lb.analysis.predict_circularity(posterior),
        lb.analysis.decompose_deviation(posterior),
        lb.fit_least_squares(campaign).table,
        *lb.analysis.measure_circularity(posterior),
        lb.inference.marginalize(MODEL, campaign),
        lb.analysis.compare_posteriors(posterior, other_posterior),
        lb.local_fits(MODEL, campaign),
        lb.find_outlying_tests({"constant": MODEL}, campaign, replicates=400),
        validation.coverage(),
        design.expected_table(),
        population.machines_table(),
        lb.machine.patterns(machine, circle, angle),
        lb.machine.hybrid_jacobian(machine, circle, angle, 300.0, degree=1),
    ]


def check_page(text: str) -> None:
    """Well-formed, accessible tables, and nothing that was not escaped."""
    elements = list(ElementTree.fromstring(f"<div>{text}</div>").iter())
    assert {element.tag for element in elements} <= {
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
    for element in elements:
        assert element.tag != "th" or element.get("scope") in ("col", "row")


@pytest.mark.slow
def test_the_objects_are_of_every_public_class(objects: list[Any]) -> None:
    kinds = {lb.InputError, lb.terms.Scale, lb.terms.Unit}
    for example in objects:
        kinds.update(type(example).__mro__)
    for name in public_names():
        kind = resolve_name(f"ldbb_bayes.{name}")
        assert not isclass(kind) or kind in kinds, name


@pytest.mark.slow
def test_every_public_class_shows_itself(
    objects: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    for example in objects:
        assert len(repr(example).replace("\n", 80 * "!")) <= 80, type(example)
        check_page(example._repr_html_())
        text = str(example)
        assert max(map(len, text.splitlines())) <= 80
        if isinstance(example, dict):
            for name in example:
                assert name in text.replace("C(0Y)X", "C0YX")


@pytest.mark.slow
def test_the_name_of_a_campaign_is_escaped(objects: list[Any]) -> None:
    assert "&lt;b&gt;" in objects[0]._repr_html_()


def test_the_repr_of_results_by_name_has_their_names() -> None:
    tolerances = {f"C_{k:03d}": lb.analysis.Tolerance(upper=1.0) for k in range(2)}
    assert repr(ByName(tolerances)) == "<2 Tolerance: C_000, C_001>"
    many = repr(ByName({f"C_{k:03d}": k for k in range(100)}))
    assert many.startswith("<100 int: C_000, C_001, ")
    assert (len(many), many[-2:]) == (80, "…>")


def test_parameters_are_found_as_they_are_printed(campaign: lb.Campaign) -> None:
    found = lb.identify(lb.HybridModel.first(0), campaign)
    again = lb.analysis.Identifiability.from_dict(found.as_dict())
    for result in (found, again):
        assert result.parameters["E_C(0Y)X"] is result.parameters["E_C0YX"]
        assert "E_C(0Y)X" not in list(result.parameters)
        with pytest.raises(KeyError, match="E_C0XX"):
            result.parameters["E_C0XX"]
    results = ByName[int](E_C0YX=1)
    assert results["E_C(0Y)X"] == 1
    assert (results.get("E_C(0Y)X"), results.get("E_C0YX")) == (1, 1)
    assert (results.get("E_C(0X)X"), results.get("C_XXX", 2)) == (None, 2)
    assert "E_C(0Y)X" in results
    assert "E_C(0X)X" not in results


def test_rows_of_tables_are_shown_as_parameters_are_printed() -> None:
    frame = readable(pd.DataFrame({"unit": ["rad"], "mean": [1e-6]}, index=["E_C0YX"]), "")
    assert frame.loc["E_C0YX", "unit"] == "rad"
    for text in (str(frame), frame._repr_html_(), frame.details()):
        assert "E_C(0Y)X" in text
        assert "E_C0YX" not in text


def test_no_results_are_shown_as_none() -> None:
    assert (repr(ByName()), str(ByName())) == ("<no results>", "No results.")


def test_a_long_name_is_cut_with_a_sign() -> None:
    circle = lb.CircularTest(300.0, np.arange(0.0, 360.0, 5.0))
    text = repr(lb.Plan((circle,), name="spindle " * 9))
    assert len(text) == 80
    assert "spin…: 1 tests, 300 to 300 N, 72 readings>" in text


def test_short_reprs() -> None:
    evidence = Evidence(3.24318, 0.0012, 512, "d0d2" * 16)
    assert " ln Z = 3.2432 ± 0.0012 nat, 512 nodes; readings d0d2d0d2>" in repr(evidence)
    assert repr(lb.Prior.default()) == "Prior()"
    assert repr(MODEL.scales[0]) == "Scale('sigma')"
    assert (
        repr(lb.Instrument(bar_U_um=1.0))
        == "Instrument(work=Ball(), tool=Ball(), bar_length_error_um=0, bar_U_um=1)"
    )


@pytest.mark.slow
def test_tables_show_every_column(
    tables: list[pd.DataFrame], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    for table in tables:
        text = str(table)
        assert max(map(len, text.splitlines())) <= 80, text
        words = {word.rstrip(":,.") for word in text.split()}
        assert {str(column) for column in table.columns} <= words, text
        assert "…" not in text or len(table) > 60
        assert "Left out" not in table.details()
        assert all(str(column) in table.to_string() for column in table.columns)
        check_page(table._repr_html_())


@pytest.mark.slow
def test_a_printed_number_is_in_the_unit_beside_it(
    tables: list[pd.DataFrame], monkeypatch: pytest.MonkeyPatch
) -> None:
    """5.5e-5 mm/N is printed as 55 nm/N, and kept."""
    monkeypatch.setenv("COLUMNS", "80")
    table = tables[0]
    (line,) = [line for line in str(table).splitlines() if line.startswith("C_XXX ")]
    name, unit, mean = line.split()[:3]
    assert (unit, table.loc[name, "unit"]) == ("nm/N", "mm/N")
    assert float(mean) == pytest.approx(1e6 * table.loc[name, "mean"], rel=1e-3)
    back = pickle.loads(pickle.dumps(table))
    assert (str(back), back.attrs["fit"]) == (str(table), table.attrs["fit"])
    assert "nm/N" in str(table.loc[["C_XXX"], ["mean", "unit"]])


def test_a_wide_table_without_rows_shows_its_heads() -> None:
    """A selection of rows may be empty; the heading of the rows' names has no text."""
    columns = {f"column_{k}": [1.0] for k in range(20)}
    frame = readable(pd.DataFrame(columns, index=["a"]), "Numbers")
    empty = frame[frame["column_0"] > 2.0]
    for text in (str(empty), empty.details()):
        assert text.startswith("Numbers\n")
        assert "column_0" in text


def test_a_long_table_shows_its_ends() -> None:
    text = str(readable(pd.DataFrame({"n": np.arange(500)}), "Numbers")).splitlines()
    assert text[0] == "Numbers, 500 rows"
    ends = [[str(k)] * 2 for k in (*range(30), *range(470, 500))]
    assert [line.split() for line in text[2:]] == [*ends[:30], ["…"] * 2, *ends[30:]]


def test_a_heading_beneath_a_row_keeps_its_brackets() -> None:
    heads = ["parameter", *[f"column {k:02d} of the table" for k in range(12)], "P(second > first)"]
    table = Table.of("", heads, [["C_XXX", *range(12), "< 0.001"], ["C_YYY", *range(12), "0.5"]])
    assert "P(second > first) < 0.001" in table.text(60)


def test_a_heading_beneath_a_row_gives_its_unit_to_the_number() -> None:
    heads = ["parameter", *[f"column {k:02d} of the table" for k in range(12)], "noise (µm)"]
    table = Table.of("", heads, [["C_XXX", *range(12), "0.12"], ["C_YYY", *range(12), "0.5"]])
    assert "noise 0.12 µm" in table.text(60)


def test_a_heading_beneath_a_row_does_not_give_the_unit_one_to_the_number() -> None:
    """It read "autocorrelation 0.1 1"."""
    heads = ["test", "a first column of this table", "autocorrelation (1)"]
    rows = [["f036", "x" * 30, "0.1"], ["f130", "y" * 30, "-0.2"]]
    assert "autocorrelation 0.1\n" in Table.of("", heads, rows).text(30)


def test_tables_are_escaped() -> None:
    row = ["<i>", 0.123456, None]
    page = Table.of("<script>", ["a<b", "n", "none"], [row], text=["a<b"]).html()
    assert "<script>" not in page
    assert all(text in page for text in ("&lt;script&gt;", "0.1235", "–"))


def test_heads_of_tables_are_typeset_in_html() -> None:
    page = Table.of("", ["circle", "at -5 °C (1e-05 mm)"], [["f036", 1.0]]).html()
    assert "at −5 °C (1·10⁻⁵ mm)" in page


def test_words_are_registered_when_a_result_is_first_displayed() -> None:
    class Length(Shown):
        """A result of a class of which nothing is registered yet."""

    class Force(Shown):
        """A result of a class of which nothing is ever registered."""

    def register() -> None:
        parts_of.register(Length, lambda _: ("1 mm",))

    register_when_displayed(register)
    assert str(Length()).strip() == "1 mm"
    assert "Force" in str(Force())
