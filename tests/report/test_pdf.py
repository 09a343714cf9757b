"""Pages of the certificate's PDF file: where figures and captions lie, read back by PDFium."""

from __future__ import annotations

from datetime import UTC, datetime

import pypdfium2 as pdfium
import pytest
from matplotlib.figure import Figure

from ldbb_bayes.report.blocks import Items, Pair, PictureRow, ReportSheet
from ldbb_bayes.report.pdf import pdf_of
from ldbb_bayes.report.pictures import Picture
from ldbb_bayes.results import Table

_MM_PER_POINT = 25.4 / 72.0


@pytest.fixture(scope="module")
def page() -> pdfium.PdfPage:
    """A page with a rose beside the flat figure of only three compliances. The captions are of
    letters that nothing else on the page has."""
    rose = Picture("rose", "wwww " * 15, Figure(figsize=(3.4, 3.7)))
    curve = Picture("curve", "vvvv " * 8, Figure(figsize=(6.3, 2.0)))
    sheet = ReportSheet("results", "Results", "Sheet 2", (PictureRow((rose, curve)),))
    pdf = pdf_of([sheet], "title", "en", datetime(2026, 1, 1, tzinfo=UTC))
    return pdfium.PdfDocument(pdf)[0]


def boxes_of(page: pdfium.PdfPage, letter: str) -> list[tuple[float, ...]]:
    """Left, bottom, right and top of every such letter on the page [points]."""
    text = page.get_textpage()
    letters = text.get_text_range()
    return [text.get_charbox(k) for k in range(len(letters)) if letters[k] == letter]


def test_a_caption_keeps_to_the_place_of_its_figure(page: pdfium.PdfPage) -> None:
    right_of_first = max(box[2] for box in boxes_of(page, "w"))
    left_of_second = min(box[0] for box in boxes_of(page, "v"))
    assert right_of_first < left_of_second


def test_a_rose_beside_a_flat_figure_is_large_enough_to_read(page: pdfium.PdfPage) -> None:
    """Its smallest labels have 7 points in a figure of 3.4 inches: 5 points need 62 mm."""
    widths_mm = []
    for image in page.get_objects([pdfium.raw.FPDF_PAGEOBJ_IMAGE]):
        left, _, right, _ = image.get_bounds()
        widths_mm.append((right - left) * _MM_PER_POINT)
    rose_mm, curve_mm = widths_mm
    assert rose_mm * 7.0 / (3.4 * 25.4) > 5.0
    assert rose_mm + curve_mm < 182.0


def widths_of_pictures_mm(block: Pair | PictureRow, scale: float) -> list[float]:
    """Width of every figure of a sheet with this block alone."""
    sheet = ReportSheet("results", "Results", "Sheet 2", (block,), scale)
    pdf = pdf_of([sheet], "title", "en", datetime(2026, 1, 1, tzinfo=UTC))
    widths_mm = []
    for image in pdfium.PdfDocument(pdf)[0].get_objects([pdfium.raw.FPDF_PAGEOBJ_IMAGE]):
        left, _, right, _ = image.get_bounds()
        widths_mm.append((right - left) * _MM_PER_POINT)
    return widths_mm


def test_a_wide_figure_keeps_the_width_of_a_crowded_sheet() -> None:
    traces = Picture("traces", "caption", Figure(figsize=(7.2, 2.35)))
    (width_mm,) = widths_of_pictures_mm(Pair(traces, "heading", ("item",)), 0.5)
    assert width_mm == pytest.approx(182.0, abs=0.5)


def test_roses_of_two_planes_stand_beside_the_compliances_and_fill_the_width() -> None:
    rose = Picture("rose", "caption", Figure(figsize=(4.7, 2.9)))
    curve = Picture("curve", "caption", Figure(figsize=(6.3, 3.0)))
    widths_mm = widths_of_pictures_mm(PictureRow((rose, curve)), 0.5)
    assert sum(widths_mm) == pytest.approx(178.0, abs=0.5)


def test_numbers_in_the_last_column_are_not_broken() -> None:
    heads = ("quantity", *(f"a column of {k}" for k in range(6)), "P (larger)")
    row = ("Axis X: displacement along X per force along Y", *["−1940.0"] * 6, "> 0.987")
    sheet = ReportSheet("difference", "Difference", "Sheet 3", (Table.of("", heads, [row] * 2),))
    pdf = pdf_of([sheet], "title", "en", datetime(2026, 1, 1, tzinfo=UTC))
    text = pdfium.PdfDocument(pdf)[0].get_textpage().get_text_range()
    assert text.count("> 0.987") == 2


def test_a_number_and_its_unit_stay_on_one_line() -> None:
    items = tuple("w" * k + " 5.43 ± 0.44 µm for every 100 N" for k in range(80, 120))
    sheet = ReportSheet("results", "Results", "Sheet 2", (Items("heading", items),), 0.6)
    pdf = pdf_of([sheet], "title", "en", datetime(2026, 1, 1, tzinfo=UTC))
    lines = pdfium.PdfDocument(pdf)[0].get_textpage().get_text_range().splitlines()
    beginnings = {line.partition(" ")[0] for line in lines}
    assert "every" in beginnings
    assert beginnings.isdisjoint({"N", "µm", "0.44", "±"})
