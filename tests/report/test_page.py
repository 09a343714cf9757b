"""The page: nothing from outside, nothing unescaped, warnings at the top."""

from __future__ import annotations

import html
import html.parser
import json
import re
from collections.abc import Collection, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pypdfium2 as pdfium
import pytest
from campaigns import plan, refuses, simulated
from reports import NOT_COMPARED, SCRIPT, awkward, fitted, undrawn

import ldbb_bayes as lb
from ldbb_bayes import units
from ldbb_bayes.inference.posterior import curves_of, record_of
from ldbb_bayes.report.blocks import Banner, Fields, Pair, ReportSheet
from ldbb_bayes.report.figures.style import new_figure
from ldbb_bayes.report.findings import find
from ldbb_bayes.report.fit_tables import nuisance_table
from ldbb_bayes.report.number_tables import tables
from ldbb_bayes.report.page import Document, compose, html_page
from ldbb_bayes.report.pictures import Picture
from ldbb_bayes.report.sections import SECTIONS, Details, Section
from ldbb_bayes.report.sheets import sheets
from ldbb_bayes.report.translation import languages, words_of
from ldbb_bayes.results import Table
from ldbb_bayes.units import value_and_uncertainty


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
    references = {
        (attributes.get(n) or "#")[1:]
        for _, attributes in reader.tags
        for n in ("href", "xlink:href")
    } - {""}
    references |= set(re.findall(r"url\(#([^)]+)\)", page))
    references |= {
        attributes["aria-labelledby"] or ""
        for _, attributes in reader.tags
        if "aria-labelledby" in attributes
    }
    assert references <= set(ids), references - set(ids)
    drawings = [attributes for tag, attributes in reader.tags if tag == "svg"]
    assert drawings
    assert all(own["role"] == "img" and own["aria-labelledby"] in ids for own in drawings)
    assert [
        tag for tag, _ in reader.tags if tag in ("h1", "main", "title") and tag != "title"
    ].count("h1") == 1
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


def cells_of(page: str) -> list[tuple[list[str], list[list[str]]]]:
    """Heads and rows of every table."""
    found = []
    for table in re.findall(r"<table>(.*?)</table>", page, flags=re.S):
        rows = [
            [
                html.unescape(re.sub(r"<[^>]*>", "", cell))
                for cell in re.findall(r"<t[hd].*?</t[hd]>", row, flags=re.S)
            ]
            for row in re.findall(r"<tr>(.*?)</tr>", table, flags=re.S)
        ]
        found.append((rows[0], rows[1:]))
    return found


# What a column states of the quantity that its row names; a forecast is not the u of the results
# and is named so.
STATED = {
    "value": "value",
    "mean": "value",
    "u": "u",
    "u (1 sd)": "u",
    "U (k = 2)": "U",
    "95 % interval": "interval",
}
NAMED = (
    "parameter",
    "symbol",
    "nuisance",
    "quantity",
    "expected u",
    "compliance",
    "geometric error",
)
OTHERS = {
    *(
        "prior sd",
        "unit",
        "stiffness (N/µm)",
        "verdict",
        "remark",
        "largest sources",
        "what would improve it most",
        "u then",
    ),
    *(
        "ESS bulk",
        "ESS tail",
        "R-hat",
        "sensitivity to the prior (1)",
        "recommended",
        "equal steps",
        "no less than",
        "prior",
    ),
    *("pattern", "what it is", "stands for", "varies with probability", "symbol"),
}


def test_a_quantity_is_one_number_wherever_it_stands(published: tuple[Document, str]) -> None:
    """Of every table with a row for a quantity every column is known; what states the same of it
    agrees to its last digit."""
    _, page = published
    found: dict[tuple[str, str], set[str]] = {}
    for heads, rows in cells_of(page):
        if heads[0] not in NAMED:
            continue
        assert set(heads[1:]) <= {*STATED, *OTHERS}, heads
        name = heads.index("symbol") if "symbol" in heads else 0
        for row in rows:
            for head, cell in zip(heads, row, strict=True):
                if head in STATED and cell:
                    found.setdefault((row[name], STATED[head]), set()).add(cell)
    assert len(found) > 60
    for quantity, number in [*drawn(page, found)]:
        found[quantity].add(number)
    for (name, what), cells in found.items():
        if what == "value":  # to the place of u beside u, to that of U beside U
            numbers = [float(cell.replace("−", "-")) for cell in cells]
            place = max(10.0 ** -len(cell.partition(".")[2]) for cell in cells)
            place *= 10.0 if place == 1.0 and any(cell.endswith("0") for cell in cells) else 1.0
            assert max(numbers) - min(numbers) <= place, (name, cells)
        else:
            assert len(cells) == 1, (name, what, cells)
    for name, u in re.findall(r"<summary>(\S+): u = (\S+) ", page):
        assert found[name, "u"] == {u}, name
    rmse = set(
        re.findall(r"RMSE (?:is )?([\d.]+) µm", re.sub(r"<svg.*?</svg>", "", page, flags=re.S))
    )
    assert len(rmse) == 1


def drawn(page: str, known: Collection[tuple[str, str]]) -> Iterator[tuple[tuple[str, str], str]]:
    """What figures write beside their dots and bars: quantity and what is stated of it, as known
    from tables, and the number."""
    of_forest = (
        ("forest", r"(−?[\d.]+) (?:±|\[).*", "value"),
        ("forest", r"−?[\d.]+ (?:± ([\d.]+)|\[.*\]) .*", "U"),
    )
    for key, number, what in (
        *of_forest,
        ("budget", r"([\d.]+) [^\d].*", "u"),
        ("expected_widths", r"([\d.]+)", "u"),
    ):
        drawing = page[page.index(f'aria-labelledby="title-{key}"') :].partition("</svg>")[0]
        texts = [
            html.unescape(re.sub("<[^>]+>", "", own))
            for own in re.findall("<text.*?</text>", drawing, re.S)
        ]
        names = [
            (name, what) for text in texts if ((name := text.partition(" ")[0]), what) in known
        ]
        numbers = [own[1] for text in texts if (own := re.fullmatch(number, text))]
        assert len(names) == 19
        yield from (
            (name, own) for name, own in zip(names, numbers, strict=key != "expected_widths") if own
        )


def test_a_unit_is_named_in_one_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """A unit replaced there is replaced on the whole page, its figures and both languages."""
    for inside, (factor, label) in list(units._UNITS.items()):
        monkeypatch.setitem(units._UNITS, inside, (1e-3 * factor, label.replace("nm/N", "ells/N")))
    posterior = awkward("two tests")
    for language in ("en", "de"):
        document = compose(
            find(posterior, comparison=NOT_COMPARED, recommended=NOT_COMPARED), language=language
        )
        page = html_page(document)
        assert "nm/N" not in page
        assert page.count("ells/N") > 20


def test_catalogues_say_the_same() -> None:
    def leaves(table: dict[str, Any], stem: str = "") -> dict[str, set[str]]:
        found: dict[str, set[str]] = {}
        for key, own in table.items():
            where = f"{stem}.{key}"
            found |= (
                leaves(own, where)
                if isinstance(own, dict)
                else {where: set(re.findall(r"{(\w+)}", own))}
            )
        return found

    assert set(languages()) >= {"en", "de"}
    every = [leaves(dict(words_of(language).table)) for language in languages()]
    assert all(own == every[0] for own in every)
    refuses("language", words_of, "xx")


def test_paper(tmp_path: Path) -> None:
    """Two pages of A4 with the words of the sheets, in German with decimal commas, at whatever
    number of tests and names."""
    named = {
        "machine_type": "Μ 5 axes",
        "serial_number": "12.5",
        "operator": "Ö" * 60,
        "date": "2026-11-20",
    }
    for kind in ("two tests", "forty tests"):
        posterior = awkward(kind)
        record = record_of(posterior)
        record["campaign"]["fields"] |= named
        posterior["provenance"].attrs["json"] = json.dumps(record)
        lb.write_report(
            posterior,
            tmp_path / kind,
            comparison=NOT_COMPARED,
            recommended=NOT_COMPARED,
            language="de",
        )
        with closing(pdfium.PdfDocument(tmp_path / kind / "report.pdf")) as paper:
            assert [
                tuple(round(side) for side in own)
                for own in map(paper.get_page_size, range(len(paper)))
            ] == [(595, 842)] * 2
            first, second = (paper[k].get_textpage().get_text_range() for k in (0, 1))
        assert all(
            word in first
            for word in (
                "Steifigkeit der Achse X",
                "N/µm",
                "12.5",
                "Ort, Datum, Unterschrift",
                "2026-11-20",
            )
        )
        assert all(
            re.search(r"C_XXX\s+\d+(,\d+)?\s+\d+(,\d+)? \[\d+(,\d+)?; ", text) for text in [second]
        )
        assert not re.search(
            r"\d\.\d", (first + second).replace("12.5", "").replace(lb.__version__, "")
        )


def test_numbers_of_an_average() -> None:
    campaign = simulated(plan())
    model = lb.HybridModel.first(1).without("discrepancy", "setup-shift")
    averaged = lb.average({"constant": model.with_degree(0), "linear": model}, campaign, draws=400)
    found = find(
        fitted(model, campaign),
        comparison=NOT_COMPARED,
        recommended=NOT_COMPARED,
        averaged=averaged,
    )
    row = tables(found)["averaged"].loc["C_XXX"]
    draws = averaged["posterior"]["C_XXX"].values
    assert [row["mean"], row["U_k2"]] == pytest.approx([draws.mean(), 2.0 * draws.std(ddof=1)])
    assert (row["reading_unit"], row["reading_factor"]) == ("nm/N", 1e6)
    for force in (None, 500.0, 1000.0):
        first, second = sheets(found, force_N=force)
        row = next(
            row
            for block in second.blocks
            if isinstance(block, Table)
            for row in block.rows
            if row[1] == "C_XXX"
        )
        draws = (
            averaged["posterior"]["C_XXX"].values
            if force is None
            else curves_of(averaged, np.array([force]))[:, 0, 0]
        )
        assert row[2:4] == value_and_uncertainty(
            1e6 * float(draws.mean()), 1e6 * float(draws.std(ddof=1))
        )
        said = next(
            block
            for block in first.blocks
            if isinstance(block, str) and block.startswith("Does compliance")
        )
        (banner,) = (block for block in first.blocks if isinstance(block, Banner))
        assert ("Stated at 1000 N, outside the tested forces" in banner.sentence) == (
            force == 1000.0
        )
        assert re.search(r"constant compliance .* %, linear compliance .* %", said)


def test_what_certificates_state_is_on_sheet_1() -> None:
    balls = {
        "work": lb.Ball(sphericity_um=0.6),
        "tool": lb.Ball(grade="G20", certificate="GZ 7: two balls"),
    }
    stated = lb.Instrument(**balls, bar_U_um=1.2, bar_length_error_um=-0.5, force_U_percent=0.5)
    found = find(
        fitted(lb.HybridModel.default(1), replace(simulated(plan()), instrument=stated)),
        comparison=NOT_COMPARED,
    )
    said = dict(
        next(block.entries for block in sheets(found)[0].blocks if isinstance(block, Fields))
    )
    form = "form of the work ball 0.6 µm, form of the tool ball G20 (GZ 7)"
    assert (
        said["Stated by certificate"] == f"bar length −0.5 µm, U = 1.2 µm, {form}, force U = 0.50 %"
    )
    assert said["Assumed, U (k = 2)"] == "mount ± 20 %, angle of the trace ± 0.20°"


def test_every_place_is_escaped() -> None:
    parts = (
        SCRIPT,
        (SCRIPT,),
        Table.of(SCRIPT, [SCRIPT, "b"], [[SCRIPT, SCRIPT]]),
        Picture("key", SCRIPT, new_figure(1.0, 1.0)),
        Details(SCRIPT, (f"one\n{SCRIPT}",)),
    )
    blocks = (
        SCRIPT,
        Fields(((SCRIPT, SCRIPT),)),
        Banner("usable", SCRIPT),
        Pair(parts[3], SCRIPT, (SCRIPT,)),
    )  # type: ignore[arg-type]
    sheet = ReportSheet("sheet", SCRIPT, SCRIPT, blocks)
    page = Document(
        SCRIPT, (SCRIPT,), (SCRIPT,), (Section("summary", SCRIPT, parts[:3] + parts[4:]),), (sheet,)
    )
    reader = check(html_page(page))
    shown = page._repr_html_()
    assert re.fullmatch(r"Document\(title='.{,300}\)", repr(page))
    assert [mark in shown for mark in ("<table>", "<script")] == [True, False]
    assert sum(SCRIPT in text for text in reader.texts) == 24


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("unconverged", "Not converged"),
        ("contradiction", "The readings contradict non-negative compliance"),
        ("paper", "Least squares"),
    ],
)
def test_what_forbids_the_numbers_stands_at_the_top(
    kind: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    undrawn(monkeypatch)
    document = compose(find(awkward(kind), comparison=NOT_COMPARED, recommended=NOT_COMPARED))
    assert any(alert.startswith(said) for alert in document.alerts)
    page = html_page(document)
    assert (
        page.index(html.escape(document.state))
        < page.index("Read this first")
        < page.index(said)
        < page.index("<nav")
    )
    assert document.state.startswith("DO NOT USE")
    if kind == "contradiction":
        assert re.search(r"ln P\(T \| y\) = −2[3-8]", document.alerts[0])


def test_no_table_of_nuisances_where_none_is_told_from_zero() -> None:
    one = {"mean": 1e-3, "sd": 1e-3, "prior_sd": 1e-3}
    assert (
        nuisance_table({"a": one, "b": one})
        == "None of the 2 other effects differs from zero by more than 2 u."
    )
