"""The page: nothing from outside, nothing unescaped, warnings at the top."""

from __future__ import annotations

import html
import html.parser
import json
import re
from collections.abc import Collection
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
from ldbb_bayes.report.findings import findings_of_fit
from ldbb_bayes.report.fit_tables import nuisance_table
from ldbb_bayes.report.number_tables import tables
from ldbb_bayes.report.page import Document, compose, html_page
from ldbb_bayes.report.pictures import Picture
from ldbb_bayes.report.sections import SECTIONS, Details, Section, _shown_forces
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
    ids = check_references(reader, page)
    drawings = [attributes for tag, attributes in reader.tags if tag == "svg"]
    assert drawings
    for drawing in drawings:
        assert drawing["role"] == "img"
        assert drawing["aria-labelledby"] in ids
    assert [tag for tag, _ in reader.tags].count("h1") == 1
    assert ("html", {"lang": "en"}) in reader.tags
    return reader


def check_references(reader: Reader, page: str) -> set[str | None]:
    """Return the ids of a page, unique, after checking that every reference has one."""
    ids = [attributes["id"] for _, attributes in reader.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    references = set(re.findall(r"url\(#([^)]+)\)", page))
    for _, attributes in reader.tags:
        references.add((attributes.get("href") or "#")[1:])
        references.add((attributes.get("xlink:href") or "#")[1:])
        if "aria-labelledby" in attributes:
            references.add(attributes["aria-labelledby"])
    references.remove("")
    assert references <= set(ids), references - set(ids)
    return set(ids)


@pytest.mark.parametrize("number", [2, 12, 13, 19, 29, 100])
def test_tables_of_the_path_have_at_most_twelve_forces(number: int) -> None:
    forces_N = [float(force) for force in range(1, number + 1)]
    shown = _shown_forces(forces_N)
    assert len(shown) == min(number, 12)
    assert shown == sorted(set(shown) & set(forces_N))
    assert (shown[0], shown[-1]) == (1.0, number)


@pytest.mark.slow
def test_the_page_of_the_published_experiment(published: tuple[Document, str]) -> None:
    document, page = published
    reader = check(page)
    assert len(page.encode()) < 3e6
    assert [section.key for section in document.sections] == list(SECTIONS)
    assert not document.alerts
    assert len(list(document.pictures)) == 12
    assert [tag for tag, _ in reader.tags].count("figure") == 12
    assert "18." in page
    assert "N/µm" in page


Row = list[str]


def text_of(markup: str) -> str:
    return html.unescape(re.sub(r"<[^>]*>", "", markup))


def cells_of_row(row: str) -> Row:
    return [text_of(cell) for cell in re.findall(r"<t[hd].*?</t[hd]>", row, flags=re.S)]


def cells_of(page: str) -> list[tuple[Row, list[Row]]]:
    """Heads and rows of every table."""
    tables = []
    for table in re.findall(r"<table>(.*?)</table>", page, flags=re.S):
        heads, *rows = map(cells_of_row, re.findall(r"<tr>(.*?)</tr>", table, flags=re.S))
        tables.append((heads, rows))
    return tables


# What a column states of the quantity that its row names; a forecast is not the u of the results
# and is named so.
STATED = {
    "value": "value",
    "mean": "value",
    "u": "u",
    "u (1 sd)": "u",
    "U (k = 2)": "U",
    "U (k = 2), +a/−b": "U",
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


@pytest.mark.slow
def test_a_quantity_is_one_number_wherever_it_stands(published: tuple[Document, str]) -> None:
    """Of every table with a row for a quantity every column is known; what states the same of it
    agrees to its last digit."""
    _, page = published
    cells_by_quantity = tabulated_cells(page)
    assert len(cells_by_quantity) > 60
    for figure, pattern, kind in NUMBERS_OF_FIGURES:
        for quantity, number in drawn_numbers(page, figure, pattern, kind, cells_by_quantity):
            cells_by_quantity[quantity].add(number)
    for (name, kind), cells in cells_by_quantity.items():
        if kind == "value":
            check_values(name, cells)
        else:
            assert len(cells) == 1, (name, kind, cells)
    for name, u in re.findall(r"<summary>(\S+): u = (\S+) ", page):
        assert cells_by_quantity[name, "u"] == {u}, name
    text = re.sub(r"<svg.*?</svg>", "", page, flags=re.S)
    assert len(set(re.findall(r"RMSE (?:is )?([\d.]+)\s*µm", text))) == 1


# A name, and what is stated of it.
Quantity = tuple[str, str]

# Figures that write numbers beside their dots and bars: how, and what the numbers state.
NUMBERS_OF_FIGURES = (
    ("forest", r"(−?[\d.]+) (?:±|\[).*", "value"),
    ("forest", r"−?[\d.]+ (?:± ([\d.]+)|\[.*\]) .*", "U"),
    ("budget", r"([\d.]+) [^\d].*", "u"),
    ("expected_widths", r"([\d.]+)", "u"),
)


def tabulated_cells(page: str) -> dict[Quantity, set[str]]:
    """Return the cells of all tables, by the quantity that they state."""
    cells_by_quantity: dict[Quantity, set[str]] = {}
    for heads, rows in cells_of(page):
        if heads[0] not in NAMED:
            continue
        assert set(heads[1:]) <= {*STATED, *OTHERS}, heads
        column = 0
        if "symbol" in heads:
            column = heads.index("symbol")
        for row in rows:
            for head, cell in zip(heads, row, strict=True):
                if head in STATED and cell:
                    quantity = (row[column], STATED[head])
                    cells_by_quantity.setdefault(quantity, set()).add(cell)
    return cells_by_quantity


def check_values(name: str, cells: set[str]) -> None:
    """Values agree to the place of u beside u, to that of U beside U."""
    numbers = [float(cell.replace("−", "-")) for cell in cells]
    place = max(10.0 ** -len(cell.partition(".")[2]) for cell in cells)
    if place == 1.0 and any(cell.endswith("0") for cell in cells):
        place = 10.0
    assert max(numbers) - min(numbers) <= place, (name, cells)


def drawn_numbers(
    page: str, figure: str, pattern: str, kind: str, tabulated: Collection[Quantity]
) -> list[tuple[Quantity, str]]:
    """Return what a figure writes: quantities known from tables, and their numbers."""
    drawing = page[page.index(f'aria-labelledby="title-{figure}"') :].partition("</svg>")[0]
    texts = [text_of(markup) for markup in re.findall("<text.*?</text>", drawing, re.S)]
    names = [text.partition(" ")[0] for text in texts if re.match("Δ?[CE]_", text)]
    assert len(names) == (19 if figure == "forest" else 13)
    matches = [re.fullmatch(pattern, text) for text in texts]
    numbers = [match[1] for match in matches if match]
    pairs = zip(names, numbers, strict=figure != "expected_widths")
    quantities = [((name, kind), number) for name, number in pairs if number]
    return [(quantity, number) for quantity, number in quantities if quantity in tabulated]


@pytest.mark.slow
def test_a_unit_is_named_in_one_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """A unit replaced there is replaced on the whole page, its figures and both languages."""
    for inside, (factor, label) in list(units.DISPLAY_UNITS.items()):
        replaced = (1e-3 * factor, label.replace("nm/N", "ells/N"))
        monkeypatch.setitem(units.DISPLAY_UNITS, inside, replaced)
    posterior = awkward("two tests")
    findings = findings_of_fit(posterior, comparison=NOT_COMPARED, recommended=NOT_COMPARED)
    for language in ("en", "de"):
        page = html_page(compose(findings, language=language))
        assert "nm/N" not in page
        assert page.count("ells/N") > 20


def test_the_annex_assumes_only_what_the_model_has() -> None:
    """The first edition has no drift, which a fit of it therefore does not follow."""
    campaign = simulated(plan())
    assert "drift" in {remark.kind for remark in lb.check_campaign(campaign).assumptions}
    findings = findings_of_fit(fitted(lb.HybridModel.first(1), campaign))
    assert "drift" not in {remark.kind for remark in findings.preview.assumptions}
    assert "balls" in {remark.kind for remark in findings.preview.assumptions}


def test_catalogues_say_the_same() -> None:
    def leaves(table: dict[str, Any], stem: str = "") -> dict[str, set[str]]:
        fields_by_path: dict[str, set[str]] = {}
        for key, entry in table.items():
            path = f"{stem}.{key}"
            if isinstance(entry, dict):
                fields_by_path |= leaves(entry, path)
            else:
                fields_by_path[path] = set(re.findall(r"{(\w+)}", entry))
        return fields_by_path

    assert set(languages()) >= {"en", "de"}
    catalogues = [leaves(dict(words_of(language).table)) for language in languages()]
    assert all(catalogue == catalogues[0] for catalogue in catalogues)
    refuses("language", words_of, "xx")


@pytest.mark.slow
def test_the_sheets_fit_on_two_pages_of_paper(tmp_path: Path) -> None:
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
            assert len(paper) == 2
            for number in (0, 1):
                assert paper.get_page_size(number) == pytest.approx((595, 842), abs=0.5)
            first, second = (paper[number].get_textpage().get_text_range() for number in (0, 1))
        for words in (
            "Steifigkeit der Achse X",
            "N/µm",
            "12.5",
            "Ort, Datum, Unterschrift",
            "2026-11-20",
        ):
            assert words in first
        assert re.search(r"C_XXX\s+\d+(,\d+)?\s+\d+(,\d+)? \[\d+(,\d+)?; ", second)
        other_text = first + second
        for number_of_something in ("12.5", lb.__version__, "JCGM 101, 8.2"):
            other_text = other_text.replace(number_of_something, "")
        assert not re.search(r"\d\.\d", other_text)


@pytest.mark.slow
@pytest.mark.parametrize("prob", [0.68, 0.95])
def test_skewed_is_judged_by_95_percent_whatever_the_intervals(prob: float) -> None:
    """68 % of an exponential distribution lie about its mean, 95 % do not."""
    campaign = simulated(plan())
    model = lb.HybridModel.first(1).without("discrepancy", "setup-shift")
    averaged = lb.average({"constant": model.with_degree(0), "linear": model}, campaign, draws=400)
    draws = averaged["posterior"].dataset["C_XYX"]
    ranks = (np.arange(draws.size) + 0.5) / draws.size
    exponential = (-1e-6 * np.log1p(-ranks)).reshape(draws.shape)
    averaged["posterior"] = averaged["posterior"].dataset.assign(C_XYX=(draws.dims, exponential))
    findings = findings_of_fit(
        fitted(model, campaign),
        prob=prob,
        comparison=NOT_COMPARED,
        recommended=NOT_COMPARED,
        averaged=averaged,
    )
    rows = tables(findings)["averaged"]
    assert (rows.loc["C_XYX", "skewed"], rows.loc["E_XX1", "skewed"]) == (True, False)
    ends = -1e-6 * np.log([0.5 + 0.5 * prob, 0.5 - 0.5 * prob])
    assert rows.loc["C_XYX", ["ci_low", "ci_high"]].to_list() == pytest.approx(ends, abs=2e-7)


@pytest.mark.slow
def test_numbers_of_an_average() -> None:
    campaign = simulated(plan())
    model = lb.HybridModel.first(1).without("discrepancy", "setup-shift")
    averaged = lb.average({"constant": model.with_degree(0), "linear": model}, campaign, draws=400)
    findings = findings_of_fit(
        fitted(model, campaign),
        comparison=NOT_COMPARED,
        recommended=NOT_COMPARED,
        averaged=averaged,
    )
    row = tables(findings)["averaged"].loc["C_XXX"]
    draws = averaged["posterior"]["C_XXX"].values
    assert [row["mean"], row["U_k2"]] == pytest.approx([draws.mean(), 2.0 * draws.std(ddof=1)])
    assert (row["reading_unit"], row["reading_factor"]) == ("nm/N", 1e6)
    for force in (None, 500.0, 1000.0):
        first, second = sheets(findings, force_N=force)
        rows = []
        for block in second.blocks:
            if isinstance(block, Table):
                rows += [row for row in block.rows if row[1] == "C_XXX"]
        row = rows[0]
        draws = averaged["posterior"]["C_XXX"].values
        if force is not None:
            draws = curves_of(averaged, np.array([force]))[:, 0, 0]
        expanded_uncertainty = 2.0 * float(draws.std(ddof=1))
        assert row[2:4] == value_and_uncertainty(
            1e6 * float(draws.mean()), 1e6 * expanded_uncertainty
        )
        sentences = [block for block in first.blocks if isinstance(block, str)]
        sentence = next(text for text in sentences if text.startswith("Does compliance"))
        (banner,) = (block for block in first.blocks if isinstance(block, Banner))
        assert ("Stated at 1000 N, outside the tested forces" in banner.sentence) == (
            force == 1000.0
        )
        assert re.search(
            r"compliance constant .*\s%, compliance changing linearly with force .*\s%", sentence
        )


@pytest.mark.slow
def test_what_certificates_state_is_on_sheet_1() -> None:
    balls = {
        "work": lb.Ball(sphericity_um=0.6),
        "tool": lb.Ball(grade="G20", certificate="GZ 7: two balls"),
    }
    stated = lb.Instrument(**balls, bar_U_um=1.2, bar_length_error_um=-0.5, force_U_percent=0.5)
    findings = findings_of_fit(
        fitted(lb.HybridModel.default(1), replace(simulated(plan()), instrument=stated)),
        comparison=NOT_COMPARED,
    )
    first, second = sheets(findings)
    fields = next(block for block in first.blocks if isinstance(block, Fields))
    entries = dict(fields.entries)
    assert entries["Stated by certificate"] == (
        "bar length −0.5 µm, U = 1.2 µm, form of the work ball sphericity 0.6 µm,"
        " form of the tool ball G20 (GZ 7), force U = 0.50 %"
    )
    of_sheet_2 = {}
    for block in second.blocks:
        if isinstance(block, Fields):
            of_sheet_2 |= dict(block.entries)
    assert of_sheet_2["Deflection of the mount"] == "U = 20 % (assumed)"
    assert of_sheet_2["Bar length"] == "−0.5 µm, U = 1.2 µm (stated)"


def test_every_place_is_escaped() -> None:
    content = (
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
        Pair(content[3], SCRIPT, (SCRIPT,)),
    )  # type: ignore[arg-type]
    sheet = ReportSheet("sheet", SCRIPT, SCRIPT, blocks)
    section = Section("summary", SCRIPT, content[:3] + content[4:])
    page = Document(SCRIPT, (SCRIPT,), (SCRIPT,), (section,), (sheet,))
    reader = check(html_page(page))
    shortened = page._repr_html_()
    assert re.fullmatch(r"Document\(title='.{,300}\)", repr(page))
    assert [mark in shortened for mark in ("<table>", "<script")] == [True, False]
    assert sum(SCRIPT in text for text in reader.texts) == 24


def test_no_line_of_the_page_ends_between_a_number_and_its_unit() -> None:
    section = Section("summary", "Summary", ("U is 3.1 nm/N.", ("Up to 100 N",)))
    page = html_page(Document("Report", ("±5 %, 36 N",), (), (section,), ()))
    for text in ("36\u00a0N", "3.1\u00a0nm/N", "100\u00a0N"):
        assert text in page


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "opening"),
    [
        ("unconverged", "Not converged"),
        ("contradiction", "The readings contradict non-negative compliance"),
        ("paper", "Least squares"),
    ],
)
def test_what_forbids_the_numbers_stands_at_the_top(
    kind: str, opening: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    undrawn(monkeypatch)
    document = compose(
        findings_of_fit(awkward(kind), comparison=NOT_COMPARED, recommended=NOT_COMPARED)
    )
    assert any(alert.startswith(opening) for alert in document.alerts)
    page = html_page(document)
    assert (
        page.index(html.escape(document.state))
        < page.index("Read this first")
        < page.index(opening)
        < page.index("<nav")
    )
    assert document.state.startswith("DO NOT USE")
    if kind == "contradiction":
        assert re.search(r"ln P\(T \| y\) = −2[3-8]", document.alerts[0])


def test_effects_of_the_instrument_that_are_not_listed_are_counted() -> None:
    """The same number of effects on the screen of a fit, which lists fewer, and in the annex."""
    scatter = {"mean": 1e-3, "sd": 1e-3, "prior_sd": 1e-3, "term": "Drift"}
    clear = {"mean": 1e-3, "sd": 1e-4, "prior_sd": 1e-3}
    lobe = {**clear, "term": "BallForm"}
    drift = {**clear, "term": "Drift"}
    assert nuisance_table({"a": scatter, "b": lobe}, instrument_listed=False) == (
        "Other effects that differ from zero by more than 2 u: 1 of 2, all of the instrument"
        " (balls, bar, mount or force)."
    )
    entries = {"drift_time_X": drift, "form_cos2": lobe, "drift_time_Y": scatter}
    listed = nuisance_table(entries, instrument_listed=False)
    assert isinstance(listed, Table)
    assert listed.caption.endswith(
        "; 1 of 3 do not; of the instrument (balls, bar, mount or force), not listed: 1"
    )
    assert len(listed.rows) == 1
    complete = nuisance_table(entries)
    assert isinstance(complete, Table)
    assert complete.caption.endswith("; 1 of 3 do not")
    assert len(complete.rows) == 2


def test_many_effects_are_counted_where_rows_are_limited() -> None:
    clear = {"mean": 1e-3, "sd": 1e-4, "prior_sd": 1e-3}
    scatter = {"mean": 1e-3, "sd": 1e-3, "prior_sd": 1e-3, "term": "Drift"}
    entries = {"form_cos2": {**clear, "term": "BallForm"}, "drift_time_X": scatter}
    entries |= {f"hysteresis_XY_cos{k}": {**clear, "term": "Hysteresis"} for k in range(2, 5)}
    assert nuisance_table(entries, instrument_listed=False, most_rows=2) == (
        "Other effects that differ from zero by more than 2 u: 4 of 5, 1 of them of the instrument"
        " (balls, bar, mount or force). --details lists 3, such as hysteresis (cos 2θ in plane XY)."
    )
    listed = nuisance_table(entries, instrument_listed=False, most_rows=3)
    assert isinstance(listed, Table)


def test_no_table_of_nuisances_where_none_is_told_from_zero() -> None:
    one = {"mean": 1e-3, "sd": 1e-3, "prior_sd": 1e-3}
    assert (
        nuisance_table({"a": one, "b": one})
        == "None of the 2 other effects differs from zero by more than 2 u."
    )
