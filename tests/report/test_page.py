"""The page: nothing from outside, nothing unescaped, warnings at the top."""

from __future__ import annotations

import html
import html.parser
import re

import pytest
from reports import NOT_COMPARED, SCRIPT, awkward, undrawn

from ldbb_bayes.report.figures.style import new_figure
from ldbb_bayes.report.findings import find
from ldbb_bayes.report.page import Document, compose, html_page
from ldbb_bayes.report.sections import SECTIONS, Details, Picture, Section
from ldbb_bayes.report.sheets import Banner, Fields, Pair, ReportSheet
from ldbb_bayes.report.text import nuisance_table
from ldbb_bayes.result import Table


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


def check(page: str) -> Reader:
    """Self-contained, ids unique, references resolved, figures named."""
    reader = Reader()
    reader.feed(page)
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


def test_the_page_of_the_published_experiment(published: tuple[Document, str]) -> None:
    document, page = published
    reader = check(page)
    assert len(page.encode()) < 3e6
    assert [section.key for section in document.sections] == list(SECTIONS)
    assert not document.alerts
    assert sum(tag == "figure" for tag, _ in reader.tags) == len(list(document.pictures)) == 11
    assert "18." in page
    assert "N/µm" in page


def test_every_place_is_escaped() -> None:
    parts = (
        SCRIPT,
        (SCRIPT,),
        Table.of(SCRIPT, [SCRIPT, "b"], [[SCRIPT, SCRIPT]]),
        Picture("key", SCRIPT, new_figure(1.0, 1.0)),
        Details(SCRIPT, (f"one\n{SCRIPT}",)),
    )
    blocks = (SCRIPT, Fields(((SCRIPT, SCRIPT),)), Banner("usable", SCRIPT), Pair(parts[3], SCRIPT, (SCRIPT,)))  # type: ignore[arg-type]
    sheet = ReportSheet("sheet", SCRIPT, SCRIPT, blocks)
    reader = check(
        html_page(Document(SCRIPT, (SCRIPT,), (SCRIPT,), (Section("summary", SCRIPT, parts[:3] + parts[4:]),), (sheet,)))
    )
    assert sum(SCRIPT in text for text in reader.texts) == 24


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
    assert page.index(html.escape(document.state)) < page.index("Read this first") < page.index(said) < page.index("<nav")
    assert document.state.startswith("DO NOT USE")
    if kind == "contradiction":
        assert re.search(r"ln P\(T \| y\) = −2[3-8]", document.alerts[0])


def test_no_table_of_nuisances_where_none_is_told_from_zero() -> None:
    one = {"mean": 1e-3, "sd": 1e-3, "prior_sd": 1e-3}
    assert nuisance_table({"a": one, "b": one}) == "None of the 2 other effects differs from zero by more than 2 u."
