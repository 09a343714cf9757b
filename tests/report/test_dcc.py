"""Results as D-SI in a DCC: the numbers of summary.json, its structure, and what it says of itself.

Where LDBB_DCC_XSD names PTB's dcc.xsd (3.3.0, with SI_Format.xsd 2.2.1 beside it) the file is
validated against that; it is not part of this repository. Everywhere elements and texts are
compared with what that schema asks of them (dcc_structure.toml).
"""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import xarray as xr
from campaigns import cases, plan, simulated
from reports import SCRIPT, awkward, fitted
from scipy.stats import chi2

import ldbb_bayes as lb
from ldbb_bayes.inference.summary import result_json
from ldbb_bayes.report import dcc_export
from ldbb_bayes.report.dcc_export import dsi_unit
from ldbb_bayes.report.message_translation import in_language
from ldbb_bayes.report.translation import words_of
from ldbb_bayes.units import display_name, is_slope

SI = "{https://ptb.de/si}"
STRUCTURE = cases(__file__, "dcc_structure.toml")


@pytest.fixture(scope="module")
def posterior() -> xr.DataTree:
    return fitted(lb.HybridModel.first(1), simulated(plan()))


def check_structure(path: Path) -> ElementTree.Element:
    root = ElementTree.parse(path).getroot()
    for element in root.iter():
        kind, name = element.tag.removeprefix("{https://ptb.de/").split("}")
        children = "".join(child.tag.partition("}")[2] + " " for child in element)
        if children:
            order = STRUCTURE["children"].get(name, ".*")
            assert re.fullmatch(order, children), (name, children)
        for names, form in STRUCTURE["texts"].items():
            if re.fullmatch(names, f"{kind}:{name}"):
                assert re.fullmatch(form, element.text or ""), (name, element.text)
    xsd = os.environ.get("LDBB_DCC_XSD")
    if xsd:
        from lxml import etree  # needed here alone

        schema = etree.XMLSchema(etree.parse(xsd))
        schema.assertValid(etree.parse(str(path)))
    return root


def words(root: ElementTree.Element, tag: str) -> list[str]:
    texts = [element.text or "" for element in root.iter(f"{SI}{tag}")]
    return " ".join(texts).split()


def stiffness_of(posterior: xr.DataTree) -> dict[str, tuple[float, float, str]]:
    """Value, u and unit of the stiffness by direction at the reference force, by its sign.

    The value of a stiffness or ratio is its median, as on the sheets."""
    (plane,) = lb.stiffness(posterior, [389.0], prob=0.9).planes
    values = {
        "k_min": plane.least,
        "k_max": plane.greatest,
        "k_ratio": plane.ratio,
        "C_XXX−C_YYY": plane.difference,
    }
    directions = {
        "θ(k_min)": plane.softest,
        "θ(k_max)": plane.stiffest,
        "ψ": plane.principal_axis,
    }
    stated = {}
    for name, value in values.items():
        assert not value.only_lower_limit
        stated[name] = (value.median, value.sd, value.unit)
    difference = plane.difference
    stated["C_XXX−C_YYY"] = (difference.mean, difference.sd, difference.unit)
    for name, direction in directions.items():
        if direction.is_determined:
            stated[name] = (direction.angle_deg, direction.sd_deg, "deg")
    return stated


def test_what_is_not_determined_is_left_out(posterior: xr.DataTree) -> None:
    (plane,) = lb.stiffness(posterior, [389.0]).planes
    assert len(dcc_export._entries_of_plane(plane)) == 7
    direction = replace(plane.softest, is_determined=False)
    greatest = replace(plane.greatest, only_lower_limit=True)
    unknown = replace(plane, softest=direction, greatest=greatest)
    names = [entry["name"] for entry in dcc_export._entries_of_plane(unknown)]
    assert names == ["k_min", "k_ratio", "stiffest_direction", "principal_axis", "difference"]


def contents(element: ElementTree.Element) -> dict[str | None, str]:
    """Texts of an element by their languages."""
    texts = element.iter("{https://ptb.de/dcc}content")
    return {content.get("lang"): content.text or "" for content in texts}


def test_remarks_are_in_german_too(posterior: xr.DataTree, tmp_path: Path) -> None:
    """In the words of the sheets, with a decimal comma; of every text that has a language."""
    root = check_structure(lb.report.write_dcc(posterior, tmp_path / "dcc.xml"))
    kinds = ("description", "declaration")
    remarks = [contents(e) for kind in kinds for e in root.iter(f"{{https://ptb.de/dcc}}{kind}")]
    assert len(remarks) > 15
    for remark in remarks:
        assert list(remark) == ["en", "de"], remark
    words_of_sheets = words_of("de")
    shown = [remark["de"] for remark in remarks]
    confounded = words_of_sheets("remarks.confounded", partners="")
    assert any(text.startswith(confounded) for text in shown)
    (axial,) = {text for text in shown if "Gegenrichtung" in text}
    assert axial == words_of_sheets("remarks.axial", axis="X")
    assert any(re.search(r"Konvergiert; das Modell .*kleinstes p = 0,\d+", text) for text in shown)


@pytest.mark.parametrize(
    ("english", "german"),
    [
        (
            "Converged; the model does not expect readings like these (order 3 of the slow run,"
            " white noise of f36 and 3 more): without the slow run a parameter moves by 1.5 u and"
            " intervals would be up to 12 % wider; no parameter is sensitive to its prior.",
            "Konvergiert; das Modell erwartet solche Messwerte nicht (Ordnung 3 von the slow run,"
            " weißes Rauschen von f36 und 3 weitere): ohne the slow run verschiebt sich ein"
            " Parameter um 1,5 u und Intervalle wären bis zu 12 % breiter; kein Parameter hängt"
            " von seinem Vorwissen ab.",
        ),
        (
            "Converged; the unit of the readings is in doubt: do not use the numbers; 2 of 19"
            " parameters are sensitive to their prior (E_XX1 and 1 coefficient of the change with"
            " force).",
            "Konvergiert; die Einheit der Messwerte ist zweifelhaft: die Zahlen nicht verwenden;"
            " 2 von 19 Parametern hängen von ihrem Vorwissen ab (E_XX1 und 1 Koeffizient der"
            " Änderung mit der Kraft).",
        ),
    ],
)
def test_what_a_fit_is_said_to_be_is_translated(english: str, german: str) -> None:
    assert in_language(english, "de", ["the slow run", "f36"]) == german


def test_the_file_says_whether_the_results_can_be_used(tmp_path: Path) -> None:
    """A file that was read twice shows in nothing else, and sheet 1 says so."""
    campaign = simulated(plan())
    again = replace(campaign.tests[0], name="again")
    twice = replace(campaign, tests=(*campaign.tests, again))
    path = lb.report.write_dcc(fitted(lb.HybridModel.first(0), twice), tmp_path / "dcc.xml")
    text = path.read_text("utf-8")
    assert "CAN BE USED WITH THIS RESERVATION. Of the tests f036 and again, each holds" in text
    assert "MIT FOLGENDEM VORBEHALT VERWENDBAR. Von den Messungen f036 und again hat jede" in text


def test_a_skewed_stiffness_has_its_interval_in_place_of_u(
    posterior: xr.DataTree, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """126.7 (+255 / −50) N/µm on the sheets is not 126.7 ± 180 N/µm here, from below zero."""
    result = lb.stiffness(posterior, [389.0])
    (plane,) = result.planes
    greatest = replace(plane.greatest, median=126.7e3, sd=90e3, ci_low=76.7e3, ci_high=381.7e3)
    skewed = replace(result, planes=(replace(plane, greatest=greatest),))
    monkeypatch.setattr(dcc_export, "stiffness", lambda *_, **__: skewed)
    root = check_structure(lb.report.write_dcc(posterior, tmp_path / "dcc.xml"))
    (k_max,) = [element for element in root.iter() if element.get("id") == "k_max"]
    assert words(k_max, "value") == ["126700.0"]
    assert words(k_max, "intervalMin") + words(k_max, "intervalMax") == ["76700.0", "381700.0"]
    assert words(k_max, "valueStandardMU") == ["90000.0"]
    assert not words(k_max, "valueExpandedMU")


def test_a_skewed_change_has_its_interval_in_place_of_u(
    posterior: xr.DataTree, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    curves = dcc_export.force_curves(posterior)
    change = np.random.default_rng(1).exponential(2e-6, 4000)
    at_smallest = np.zeros_like(change)
    draws = curves.compliances["C_CCY"]._replace(at_smallest=at_smallest, at_largest=change)
    skewed = replace(curves, compliances=curves.compliances | {"C_CCY": draws})
    monkeypatch.setattr(dcc_export, "force_curves", lambda *_: skewed)
    root = check_structure(lb.report.write_dcc(posterior, tmp_path / "dcc.xml", prob=0.9))
    (stated,) = [element for element in root.iter() if element.get("id") == "C_CCY_change"]
    ends = words(stated, "intervalMin") + words(stated, "intervalMax")
    expected = np.quantile(change, (0.025, 0.975))
    np.testing.assert_allclose(np.array(ends, float), expected, rtol=1e-6)
    assert words(stated, "coverageProbability") == ["0.95"]
    assert not words(stated, "valueExpandedMU")


def test_a_change_that_is_almost_certainly_none_has_no_interval_of_its_few_draws(
    posterior: xr.DataTree, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 4000 draws 3840 are zero, 120 above and 40 below: the interval would be [0, …]."""
    curves = dcc_export.force_curves(posterior)
    change = np.zeros(4000)
    change[:120] = np.linspace(1e-6, 7e-6, 120)
    change[120:160] = np.linspace(-6e-6, -1e-6, 40)
    draws = curves.compliances["C_CCY"]._replace(at_smallest=np.zeros(4000), at_largest=change)
    rare = replace(curves, compliances=curves.compliances | {"C_CCY": draws})
    monkeypatch.setattr(dcc_export, "force_curves", lambda *_: rare)
    root = check_structure(lb.report.write_dcc(posterior, tmp_path / "dcc.xml"))
    (stated,) = [element for element in root.iter() if element.get("id") == "C_CCY_change"]
    assert not words(stated, "intervalMin")
    (expanded,) = words(stated, "valueExpandedMU")
    assert float(expanded) == pytest.approx(2.0 * change.std(ddof=1), rel=1e-6)


def test_the_probability_of_intervals_does_not_decide_where_U_is_stated(
    posterior: xr.DataTree, tmp_path: Path
) -> None:
    """Half of an interval of 68 % is one u: that U is twice as large does not make it useless."""
    root = check_structure(lb.report.write_dcc(posterior, tmp_path / "dcc.xml", prob=0.68))
    for name in ("C_XXX_change", "k_min", "difference"):
        (quantity,) = [element for element in root.iter() if element.get("id") == name]
        assert len(words(quantity, "valueExpandedMU")) == 1, name
    assert words(root, "coverageProbabilityXMLList") == ["0.68", "0.68"]


def test_stiffnesses_name_the_circle_that_they_are_of(tmp_path: Path) -> None:
    """Of circles of two radii in one plane, k_min is that of the first."""
    smaller = tuple(
        replace(test, radius_mm=100.0, name=f"{test.name} small") for test in plan().tests
    )
    both = replace(plan(), tests=(*plan().tests, *smaller))
    posterior = fitted(lb.HybridModel.first(0), simulated(both))
    path = lb.report.write_dcc(posterior, tmp_path / "dcc.xml")
    descriptions = {}
    for quantity in check_structure(path).iter("{https://ptb.de/dcc}quantity"):
        texts = [element.text or "" for element in quantity.iter("{https://ptb.de/dcc}content")]
        descriptions[quantity.get("id")] = " | ".join(texts)
    assert "R\u00a0= 150\u00a0mm" in descriptions["k_min"]
    assert "are the same; R\u00a0= 150\u00a0mm" in descriptions["softest_direction"]
    assert "R\u00a0=" not in descriptions["C_XXX"]


@pytest.mark.slow
def test_principal_stiffnesses_state_their_axes(tmp_path: Path) -> None:
    planes = tuple(
        replace(test, plane=plane, name=f"{plane}{test.force_N:g}")
        for plane in ("XY", "YZ", "ZX")
        for test in plan().tests
    )
    posterior = fitted(lb.HybridModel.first(1), simulated(replace(plan(), tests=planes)))
    root = check_structure(lb.report.write_dcc(posterior, tmp_path / "dcc.xml"))
    names = {quantity.get("id") for quantity in root.iter("{https://ptb.de/dcc}quantity")}
    assert {"k_1", "k_min_XY", "difference_YZ"} <= names
    assert "along (" in (tmp_path / "dcc.xml").read_text("utf-8")


def test_numbers_are_those_of_the_summary(recovered: lb.Campaign, tmp_path: Path) -> None:
    stated = {
        "serial_number": "4711",
        "ball_bar": "QC20",
        "operator": "A & B",
        "place": "Hall <2>",
        "date": "2026-11-20T14:30",
    }
    warm = tuple(replace(test, temperature_C=20.5) for test in recovered.tests)
    campaign = replace(recovered, tests=warm, **stated)
    posterior = fitted(lb.HybridModel.first(1), campaign)
    root = check_structure(lb.report.write_dcc(posterior, tmp_path / "dcc.xml", prob=0.9))
    quantities = {
        quantity.name.split(" / ")[0].split()[-1]: quantity
        for quantity in lb.campaign.read_dcc(tmp_path / "dcc.xml").quantities
        if quantity.name
    }
    expected = result_json(posterior, prob=0.9)["parameters"]
    stated_values = {
        name: (entry["mean"], entry["sd"], entry["unit"])
        for name, entry in expected.items()
        if not is_slope(name)
    }
    factors = dict.fromkeys(stated_values, 2.0)
    for name, change in lb.analysis.change_with_force(posterior).items():
        summary = change.change
        stated_values[f"Δ{name}"] = (summary.mean, summary.sd, change.unit)
        # Of a skewed change, u and the 95 % interval are stated and no U.
        low, high = summary.ci_low, summary.ci_high
        is_skewed = abs(0.5 * (low + high) - summary.mean) > 0.1 * (high - low)
        factors[f"Δ{name}"] = 1.0 if is_skewed else 2.0
    stated_values |= stiffness_of(posterior)
    assert set(quantities) == {display_name(name) for name in stated_values}
    for name, (mean, sd, unit) in stated_values.items():
        quantity = quantities[display_name(name)]
        k = factors.get(name, 2.0)
        assert (quantity.value, quantity.U, quantity.k, quantity.unit) == (
            mean,
            k * sd,
            k,
            dsi_unit(unit),
        ), name
        if k == 2.0:
            assert quantity.coverage == pytest.approx(0.954, abs=0.02)
    ends = [list(map(float, words(root, f"interval{end}XMLList"))) for end in ("Min", "Max")]
    assert list(zip(*ends, strict=True)) == [tuple(entry["ci90"]) for entry in expected.values()]
    dataset = posterior["posterior"].dataset
    draws = np.stack([np.ravel(dataset[name]) for name in expected])
    matrix = []
    for cell in root.iter(f"{SI}covarianceXMLList"):
        matrix += [float(value.text or "") for value in cell.iter(f"{SI}valueXMLList")]
    np.testing.assert_array_equal(np.reshape(matrix, [len(expected)] * 2), np.cov(draws))
    (factor,) = map(float, words(root, "coverageFactorXMLList"))
    of_normal_distribution = chi2.ppf(0.9, len(expected))
    assert factor**2 == pytest.approx(of_normal_distribution, rel=0.05)
    text = (tmp_path / "dcc.xml").read_text("utf-8")
    for statement in (
        *stated.values(),
        "20.5 20.5",
        "no calibration certificate",
        "kein Kalibrierschein",
        "\\degreecelsius",
    ):
        escaped = statement[:10].replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
        assert escaped in text


def test_units_are_those_of_the_si() -> None:
    """mm/N, rad/(N mm) per N, 1/mm, a number; their products."""
    assert dsi_unit("mm/N") == r"\milli\metre\newton\tothe{-1}"
    assert dsi_unit("rad/(N mm)/N") == r"\radian\newton\tothe{-2}\milli\metre\tothe{-1}"
    assert (dsi_unit("1/mm"), dsi_unit("1"), dsi_unit("mm", "1/mm")) == (
        r"\milli\metre\tothe{-1}",
        r"\one",
        r"\one",
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["script", "degree 2", "paper", "long name"])
def test_awkward_results(kind: str, tmp_path: Path) -> None:
    check_structure(lb.report.write_dcc(awkward(kind), tmp_path / "dcc.xml"))
    assert SCRIPT not in (tmp_path / "dcc.xml").read_text("utf-8")
