"""The page: golden text, nothing from outside, nothing unescaped, warnings at the top."""

from __future__ import annotations

import html
import html.parser
import os
import re
from pathlib import Path

import pytest
import xarray as xr
from reports import NOT_COMPARED, SCRIPT, awkward, fitted, undrawn

import ldbb_bayes as lb
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.report.figures.style import new_figure
from ldbb_bayes.report.findings import find, sizes_of
from ldbb_bayes.report.page import Document, compose, html_page
from ldbb_bayes.report.sections import Details, Picture, Section
from ldbb_bayes.result import Table
from ldbb_bayes.units import units_for

GOLDEN = Path(__file__).parent / "golden" / "report.txt"
NUMBER = re.compile(r"(?<![\w.])[−+-]?\d+(?:\.\d+)?(?:e[−+-]?\d+)?(?!\w)")


@pytest.fixture(scope="module")
def document(recovered: lb.Campaign, compared: Comparison) -> Document:
    posterior = fitted(lb.HybridModel.default(1), recovered)
    with units_for(sizes_of(posterior)):
        return compose(find(posterior, comparison=compared))


def text_of_page(page: str) -> str:
    """What is read of a page: a line for every block and row, cells apart by bars, figures by their captions."""
    text = re.sub(r"<svg.*?</svg>|<style>.*?</style>|<title>.*?</title>", "", page, flags=re.DOTALL)
    text = re.sub(r"</t[hd]><t[hd][^>]*>", " | ", text)
    text = re.sub(r"</(?:p|h1|h2|li|tr|caption|figcaption|summary|a)>", "\n", text)
    lines = (" ".join(line.split()) for line in html.unescape(re.sub(r"<[^>]+>", " ", text)).splitlines())
    return "\n".join(line for line in lines if line) + "\n"


@pytest.mark.golden
def test_golden_text(document: Document) -> None:
    """Word for word; numbers to three units of their last place. LDBB_WRITE_GOLDEN=1 writes the text anew."""
    text = re.sub(r"^Fitted .*|^(fitted|versions) \|.*", "", text_of_page(html_page(document)), flags=re.M)
    if os.environ.get("LDBB_WRITE_GOLDEN"):
        GOLDEN.write_text(text, encoding="utf-8")
    golden = GOLDEN.read_text(encoding="utf-8")
    assert NUMBER.sub("#", text).splitlines() == NUMBER.sub("#", golden).splitlines()
    for found, expected in zip(NUMBER.findall(text), NUMBER.findall(golden), strict=True):
        value, wanted = (float(number.replace("−", "-")) for number in (found, expected))
        decimals = len(expected.partition("e")[0].partition(".")[2]) - int((expected.partition("e")[2] or "0").replace("−", "-"))
        assert value == pytest.approx(wanted, abs=3.01 * 10.0**-decimals, rel=5e-3), (found, expected)


class Reader(html.parser.HTMLParser):
    """What a page holds."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def read(page: str) -> Reader:
    reader = Reader()
    reader.feed(page)
    return reader


def check(page: str) -> Reader:
    """Self-contained, ids unique, references resolved, figures named."""
    reader = read(page)
    names = {tag for tag, _ in reader.tags}
    assert not names & {"script", "iframe", "object", "embed", "link", "img", "form", "base"}
    for tag, attributes in reader.tags:
        assert not any(name.startswith("on") for name in attributes), (tag, attributes)
        for name in ("src", "href", "xlink:href", "action"):
            assert (attributes.get(name) or "#").startswith("#"), (tag, attributes)
    assert not re.search(r"@import|url\((?!#)", page)
    ids = [attributes["id"] for _, attributes in reader.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    references = {(attributes.get(n) or "#")[1:] for _, attributes in reader.tags for n in ("href", "xlink:href")} - {""}
    references |= set(re.findall(r"url\(#([^)]+)\)", page))
    references |= {attributes["aria-labelledby"] or "" for _, attributes in reader.tags if "aria-labelledby" in attributes}
    assert references <= set(ids), references - set(ids)
    drawings = [attributes for tag, attributes in reader.tags if tag == "svg"]
    assert drawings
    assert all(own["role"] == "img" and own["aria-labelledby"] in ids for own in drawings)
    assert [tag for tag, _ in reader.tags if tag in ("h1", "main", "title") and tag != "title"].count("h1") == 1
    assert ("html", {"lang": "en"}) in reader.tags
    return reader


def test_the_page_of_the_published_experiment(document: Document) -> None:
    page = html_page(document)
    reader = check(page)
    assert len(page.encode()) < 3e6
    titles = ["Summary", "The campaign", "Results", "What the data cannot separate", "Constant or linear", "Uncertainty budget"]
    titles += ["Circular-test quantities", "Recommended next tests", "How well the model fits", "Priors and assumptions"]
    assert [section.title for section in document.sections] == [
        *titles,
        "Diagnostics",
        "Method, limitations, provenance",
        "Sign-off",
    ]
    assert not document.alerts
    assert sum(tag == "figure" for tag, _ in reader.tags) == len(list(document.pictures)) == 12
    others = {"corner", "prior_and_posterior", "nuisance_costs", "alias", "correlation", "expected_widths", "efficiency"}
    assert set(document.further) == {*others, "predictive_p_values", "geometry_with_local_fits"}
    assert "18." in page
    assert "N/µm" in page


def text_part() -> Document:
    parts = (
        SCRIPT,
        (SCRIPT,),
        Table.of(SCRIPT, [SCRIPT, "b"], [[SCRIPT, SCRIPT]]),
        Picture("key", SCRIPT, new_figure(1.0, 1.0)),
        Details(SCRIPT, (f"one\n{SCRIPT}",)),
    )
    return Document(SCRIPT, (SCRIPT,), (SCRIPT,), (Section("summary", SCRIPT, parts),))


def test_every_place_is_escaped() -> None:
    document = text_part()
    reader = check(html_page(document))
    assert sum(SCRIPT in text for text in reader.texts) == 16


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("unconverged", "Not converged"),
        ("contradiction", "The readings contradict non-negative compliance"),
        ("paper", "Least squares"),
    ],
)
def test_what_forbids_the_numbers_stands_at_the_top(kind: str, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    undrawn(monkeypatch)
    document = compose(find(awkward(kind), comparison=NOT_COMPARED, recommended=NOT_COMPARED))
    assert any(alert.startswith(said) for alert in document.alerts)
    page = html_page(document)
    assert page.index("Read this first") < page.index(said) < page.index("<nav")
    if kind == "unconverged":
        (lead, *_) = document.sections[0].parts
        assert lead == "The sampler has not converged: nothing below may be used."
    if kind == "contradiction":
        assert re.search(r"ln P\(T \| y\) = -2[3-8]", document.alerts[0])


def test_refused(recovered: lb.Campaign, compared: Comparison) -> None:
    posterior: xr.DataTree = awkward("two tests")
    with pytest.raises(lb.InputError, match="comparison must be of the readings of the fit"):
        find(posterior, comparison=compared)
