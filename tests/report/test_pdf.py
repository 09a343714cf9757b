"""The certificate as a PDF file: a sheet is measured as high as the library fpdf2 draws it."""

import random

import pytest
from fpdf import FPDF

from ldbb_bayes.report import pdf as pdf_pages
from ldbb_bayes.report.blocks import Banner, Fields, Items, ReportSheet
from ldbb_bayes.results import Table

WORDS = (
    "a",
    "C_XXX",
    "57.3 ± 6.4 nm/N,",
    "Rundheitsabweichung",
    "10\N{NO-BREAK SPACE}µm",
    "thin\N{THIN SPACE}space",
    "W" * 60,
    "–",
)


def text_of(count: int, seed: int, separators: str = " ") -> str:
    chance = random.Random(seed)
    return "".join(chance.choice(WORDS) + chance.choice(separators) for _ in range(count)).strip()


def end_of(document: FPDF, text: str, size: float, width: float, bold: bool) -> float:
    with pdf_pages._document(document) as pdf:
        pdf.add_page()
        pdf_pages._write(pdf, text, size, width=width, bold=bold)
        return float(pdf.y)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("size", "width", "bold"), [(8.2, 182.0, False), (5.3, 37.0, True)])
def test_a_paragraph_is_measured_as_high_as_it_is_drawn(
    seed: int, size: float, width: float, bold: bool
) -> None:
    for count, separators in ((0, " "), (3, " "), (25, " "), (25, "  \n")):
        text = text_of(count, seed, separators)
        drawn = end_of(FPDF(), text, size, width, bold)
        assert end_of(pdf_pages._Ruler(), text, size, width, bold) == pytest.approx(drawn), text


@pytest.mark.parametrize("scale", [1.0, 0.63])
def test_a_sheet_is_measured_as_high_as_it_is_drawn(scale: float) -> None:
    rows = [(text_of(9, seed), str(seed), text_of(1, seed)) for seed in range(9)]
    sheet = ReportSheet(
        "sheet",
        text_of(12, 1),
        text_of(40, 2),
        (
            Banner("reserved", text_of(30, 3)),
            Fields(tuple((text_of(2, k), text_of(k, k)) for k in range(7)), heading="Fields"),
            Table.of("A table", ("what", "value", "unit"), rows),
            Items("Findings", tuple(text_of(5 * k, k) for k in range(6))),
            text_of(60, 4),
        ),
        scale,
    )
    ends = []
    for document in (FPDF(), pdf_pages._Ruler()):
        with pdf_pages._document(document) as pdf:
            ends.append(pdf_pages._draw_sheet(pdf, sheet))
    assert ends[1] == pytest.approx(ends[0])
