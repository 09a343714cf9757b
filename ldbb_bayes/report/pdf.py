"""Conversion of the test certificate to a PDF of A4 pages, with the library fpdf2.

Lengths are in millimetres, font sizes in points, and grey levels from 0 (black) to 255 (white).
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import matplotlib as mpl
from fpdf import FPDF
from fpdf.fonts import FontFace, TTFFont

from ldbb_bayes.report.blocks import Banner, Block, Fields, Items, Pair, PictureRow, ReportSheet
from ldbb_bayes.report.pictures import Picture
from ldbb_bayes.results import Table
from ldbb_bayes.units import MM_PER_INCH, keep_with_units

__all__ = ["fit_to_pages", "pdf_of"]

_WIDTH = 182.0  # width of the printed area of an A4 page [mm]
_LEFT = 14.0  # left margin of an A4 page [mm]
_TOP = 14.0  # top margin of an A4 page [mm]
# Lowest position at which the content of a sheet of the test certificate may end [mm from the top
# of the page]. The space below this position is kept free, because a browser that prints the sheet
# makes lines of text slightly taller.
_BOTTOM = 272.0
# Highest position at which the fields for signatures may begin [mm from the top of the page].
_SIGNATURES = 256.0
_PAIRED_WIDTH = 104.0  # width of a figure with a list of sentences beside it [mm]
# Largest height allowed for a figure with a list of sentences beside or below it [mm].
_PAIRED_HEIGHT = 88.0
# A figure that is as wide as the page may have this height even if the font size of the sheet is
# reduced [mm]. Its panels would otherwise be too small to read.
_READABLE_HEIGHT = 64.0
# Largest height allowed for a figure that has no list of sentences beside or below it [mm].
_PICTURE_HEIGHT = 100.0
# Least width of the first column of a table [mm].
_LEAST_FIRST_WIDTH = 20.0
_ROW_GAP = 4.0  # distance between two figures side by side on a page [mm]
_BULLET_WIDTH = 4.0  # width of the space for the bullet before an item of a list on a page [mm]
_DPI = 300.0
_LINE_HEIGHT = 0.46  # height of a line of text, divided by the font size [mm per point]
_INK = 0  # grey level of text on a page of the certificate, from 0 (black) to 255 (white)
# grey level of notes, captions and names of form fields, from 0 (black) to 255 (white)
_SOFT_INK = 85
# grey level of the ruled lines of tables and form fields, from 0 (black) to 255 (white)
_RULE = 150
# Grey levels of the certificate's banner, from 0 (black) to 255 (white). Each value is a pair: the
# level of the background, and the level of the text. The keys are what the banner says about the
# results: "usable", "reserved" (usable with reservations) or "unusable".
_GROUND_AND_INK = {"usable": (255, 0), "reserved": (232, 0), "unusable": (0, 255)}
_SMALLEST_TITLE_SCALE = 0.8
# largest number of times that the font size is reduced to make a sheet of the test certificate fit
# its page
_MOST_ATTEMPTS = 8
# The height of a text is proportional to this power of the font size. With a larger font, each line
# is higher, and the text has more lines.
_POWER_OF_TEXT = 2.0
# The height of a usual sheet, with texts and figures, is proportional to this power of the font
# size.
_POWER_OF_SHEET = 1.5
# The height of a figure is proportional to this power of the font size.
_POWER_OF_FIGURES = 1.0
# Whenever the font size of a sheet of the test certificate is reduced, the new size is chosen to
# leave this height empty at the bottom of the page [mm]. The sheet then usually fits even if the
# lines are broken differently than expected.
_SPARE_HEIGHT = 1.0


def pdf_of(sheets: Sequence[ReportSheet], title: str, language: str, created: datetime) -> bytes:
    """Return a PDF file as bytes, with one page per certificate sheet and embedded fonts.

    Parameters
    ----------
    sheets
        Sheets, each of which fits one page; see `fit_to_pages`.
    title, language, created
        Properties of the PDF document: its title, the code of its language, such as ``en``, and the
        time of its creation.

    Returns
    -------
    bytes
    """
    with _document() as pdf:
        pdf.set_title(title)
        pdf.set_lang(language)
        pdf.set_creation_date(created)
        for sheet in sheets:
            _draw_sheet(pdf, sheet)
        return bytes(pdf.output())


def fit_to_pages(sheets: Sequence[ReportSheet]) -> tuple[ReportSheet, ...]:
    """Return copies of a certificate's sheets with fonts so small that each fits on one page.

    The font size of a sheet is reduced at most 8 times. After that, a very long sheet may still
    exceed its page.

    Parameters
    ----------
    sheets
        Sheets with any font size.

    Returns
    -------
    tuple of ReportSheet
        The same sheets with smaller font sizes; a sheet that already fits is not changed.
    """
    with _document() as pdf:
        return tuple(_fit_to_page(pdf, sheet) for sheet in sheets)


def _fit_to_page(pdf: FPDF, sheet: ReportSheet) -> ReportSheet:
    """Return a sheet with a font so small that it fits on one page. ``pdf`` is used for trials."""
    height = _draw_sheet(pdf, sheet, pictures=False) - _TOP
    power = _POWER_OF_SHEET
    for _ in range(_MOST_ATTEMPTS):
        if height <= _BOTTOM - _TOP:
            break
        shrink = ((_BOTTOM - _TOP - _SPARE_HEIGHT) / height) ** (1.0 / power)
        sheet = replace(sheet, scale=sheet.scale * shrink)
        former_height = height
        height = _draw_sheet(pdf, sheet, pictures=False) - _TOP
        power = _power_of_height(height / former_height, shrink)
    return sheet


def _power_of_height(height_ratio: float, size_ratio: float) -> float:
    """Return the power p with which the height of a certificate's sheet depends on the font size.

    The height is assumed to be proportional to size^p, where size is the font size. The power is
    computed from the last reduction of the font size: ``height_ratio`` is the new height of the
    sheet divided by its former height, and ``size_ratio`` is the new font size divided by the
    former font size. The power lies between 1 and 2, because the height of figures is proportional
    to the font size, and the height of texts to its square. A result below 1 is therefore replaced
    by 1, and a result above 2 by 2.
    """
    power = math.log(height_ratio) / math.log(size_ratio)
    return min(max(power, _POWER_OF_FIGURES), _POWER_OF_TEXT)


@contextmanager
def _document() -> Iterator[FPDF]:
    """Yield an empty PDF document with margins and fonts, and close its font files after use."""
    pdf = FPDF()
    pdf.set_auto_page_break(False)
    pdf.set_margins(_LEFT, _TOP, _LEFT)
    fonts = Path(mpl.get_data_path()) / "fonts" / "ttf"
    pdf.add_font("DejaVu", "", fonts / "DejaVuSans.ttf")
    pdf.add_font("DejaVu", "B", fonts / "DejaVuSans-Bold.ttf")
    try:
        yield pdf
    finally:
        for font in pdf.fonts.values():
            if isinstance(font, TTFFont):
                font.close()


def _draw_sheet(pdf: FPDF, sheet: ReportSheet, *, pictures: bool = True) -> float:
    """Add a page with a certificate's sheet, and return where the sheet ends [mm from the top].

    If ``pictures`` is false, the places of figures are left empty.
    """
    pdf.add_page()
    title_scale = max(sheet.scale, _SMALLEST_TITLE_SCALE)
    _write(pdf, sheet.title, 15.0 * title_scale, bold=True)
    _write(pdf, sheet.line, 8.0 * title_scale, grey=_SOFT_INK)
    for block in sheet.blocks:
        pdf.set_xy(_LEFT, pdf.y + 2.2 * sheet.scale)
        _draw_block(pdf, block, sheet.scale, pictures)
    return float(pdf.y)


def _draw_block(pdf: FPDF, block: Block, scale: float, pictures: bool) -> None:
    """Draw one part of a sheet, such as a table, below the parts that are already drawn.

    ``scale`` is the relative font size. If ``pictures`` is false, the places of figures are left
    empty.
    """
    if isinstance(block, str):
        _write(pdf, block, 7.2 * scale, grey=_SOFT_INK)
    elif isinstance(block, Fields):
        _draw_fields(pdf, block, scale)
    elif isinstance(block, Banner):
        _draw_banner(pdf, block, scale)
    elif isinstance(block, Items):
        _draw_items(pdf, block, scale)
    elif isinstance(block, Table):
        _draw_table(pdf, block, scale)
    elif isinstance(block, Pair):
        _draw_pair(pdf, block, scale, pictures)
    elif isinstance(block, PictureRow):
        _draw_row(pdf, block, scale, pictures)
    else:
        _draw_picture(pdf, block, _WIDTH, _PICTURE_HEIGHT * scale, scale, pictures)


def _write(
    pdf: FPDF,
    text: str,
    size: float,
    *,
    width: float = _WIDTH,
    bold: bool = False,
    grey: int = _INK,
    **options: Any,
) -> None:
    """Write a paragraph in the PDF, and move the writing position to the line below it.

    ``size`` is the font size [points], ``width`` the width of the paragraph [mm], and ``grey`` the
    grey level of the text from 0 (black) to 255 (white). If ``bold`` is true, the text is bold.
    ``options`` are passed to ``FPDF.multi_cell``.
    """
    pdf.set_font("DejaVu", "B" if bold else "", size)
    pdf.set_text_color(grey)
    height = _LINE_HEIGHT * size
    pdf.multi_cell(
        width, height, keep_with_units(text), align="L", new_x="LEFT", new_y="NEXT", **options
    )


def _draw_banner(pdf: FPDF, banner: Banner, scale: float) -> None:
    """Draw the banner of the test certificate: a sentence in bold type on a grey background.

    ``scale`` is the relative font size.
    """
    ground, ink = _GROUND_AND_INK[banner.kind]
    pdf.set_fill_color(ground)
    _write(
        pdf, banner.sentence, 10.0 * scale, bold=True, grey=ink, border=1, padding=1.6, fill=True
    )
    pdf.set_fill_color(255)


def _draw_items(pdf: FPDF, items: Items, scale: float) -> None:
    """Draw a heading and a list of sentences on a page. ``scale`` is the relative font size."""
    _write(pdf, items.heading, 9.0 * scale, bold=True)
    for item in items.items:
        pdf.set_xy(_LEFT, pdf.y + 0.8 * scale)
        _write(pdf, "•", 8.2 * scale, width=_BULLET_WIDTH)
        pdf.set_xy(_LEFT + _BULLET_WIDTH, pdf.y - _LINE_HEIGHT * 8.2 * scale)
        _write(pdf, item, 8.2 * scale, width=_WIDTH - _BULLET_WIDTH)
    pdf.set_x(_LEFT)


# ---- form fields


@dataclass(frozen=True)
class _FieldColumn:
    """Horizontal positions [mm] of names and texts in one of the two columns of form fields.

    ``left`` is the left edge of the column, ``name_width`` the width of the fields' names, and
    ``gap`` the distance between the two columns.
    """

    left: float
    name_width: float = 36.0
    gap: float = 6.0

    @property
    def text_left(self) -> float:
        """Left edge of the texts in this column of form fields [mm]."""
        return self.left + self.name_width

    @property
    def text_width(self) -> float:
        """Width of the texts in this column of form fields [mm]."""
        return 0.5 * (_WIDTH - self.gap) - self.name_width

    @property
    def next_left(self) -> float:
        """Left edge of the next column of form fields, to the right of this column [mm]."""
        return self.text_left + self.text_width + self.gap


_FIRST_COLUMN = _FieldColumn(_LEFT)
_SECOND_COLUMN = _FieldColumn(_FIRST_COLUMN.next_left)


def _draw_fields(pdf: FPDF, fields: Fields, scale: float) -> None:
    """Draw form fields in two columns. The text of a field is to the right of its name.

    ``scale`` is the relative font size.
    """
    space = 0.7 * scale
    if fields.heading:
        _write(pdf, fields.heading, 9.0 * scale, bold=True)
    if fields.tall:
        pdf.set_y(max(pdf.y, _SIGNATURES))
        space = 9.0 * scale
    for k in range(0, len(fields.entries), 2):
        _draw_field_row(pdf, fields.entries[k : k + 2], pdf.y + space, scale)


def _draw_field_row(
    pdf: FPDF, entries: Sequence[tuple[str, str]], top: float, scale: float
) -> None:
    """Draw one or two form fields side by side, with a line below the text of each field.

    ``entries`` holds the name and the text of each field. ``top`` is the position of the upper edge
    of the fields [mm from the top of the page]. ``scale`` is the relative font size.
    """
    size = 7.8 * scale
    bottom = top
    columns = (_FIRST_COLUMN, _SECOND_COLUMN)[: len(entries)]
    for column, (name, text) in zip(columns, entries, strict=True):
        pdf.set_xy(column.left, top)
        _write(pdf, name, size, width=column.name_width, grey=_SOFT_INK)
        bottom = max(bottom, pdf.y)
        pdf.set_xy(column.text_left, top)
        _write(pdf, text or " ", size, width=column.text_width)
        bottom = max(bottom, pdf.y)
    line = bottom + 0.4 * scale
    pdf.set_draw_color(_RULE)
    for column in columns:
        pdf.line(column.text_left, line, column.text_left + column.text_width, line)
    pdf.set_y(line)


# ---- tables and figures


def _draw_table(pdf: FPDF, table: Table, scale: float) -> None:
    """Draw a table with its caption in the PDF file. ``scale`` is the relative font size."""
    if table.caption:
        _write(pdf, table.caption, 9.0 * scale, bold=True)
        pdf.set_y(pdf.y + 0.8 * scale)
    size = 7.8 * scale
    pdf.set_font("DejaVu", "", size)
    pdf.set_text_color(_INK)
    pdf.set_draw_color(_RULE)
    rows = [table.heads, *table.shown()]
    alignment = ["RIGHT" if is_number else "LEFT" for is_number in table.numeric]
    with pdf.table(
        rows,
        col_widths=_column_widths(pdf, rows, keep_last=table.numeric[-1]),
        width=_WIDTH,
        text_align=alignment,
        headings_style=FontFace(emphasis="BOLD"),
        borders_layout="HORIZONTAL_LINES",
        line_height=_LINE_HEIGHT * size,
        padding=(0.55 * scale, 1.0),
    ):
        pass


def _column_widths(pdf: FPDF, rows: Sequence[Sequence[str]], *, keep_last: bool) -> list[float]:
    """Return the widths of a table's columns [mm], which add up to the full width of a certificate.

    ``rows`` holds the texts of the cells; the first row has the column headings. Each column except
    the first and the last is as wide as its longest text. The first and the last column share the
    remaining width; long texts in these two columns are broken into lines. If ``keep_last`` is
    true, the last column holds numbers, which must not be broken. It is then as wide as its longest
    text, too, and the first column has the remaining width, unless too little remains.
    """
    widths = []
    for k in range(len(rows[0])):
        longest = max(pdf.get_string_width(row[k]) for row in rows)
        widths.append(longest * 1.1 + 3.0)
    outer = [0]
    has_room = _WIDTH - sum(widths[1:]) >= _LEAST_FIRST_WIDTH
    if len(widths) > 1 and not (keep_last and has_room):
        outer.append(len(widths) - 1)
    outer_width = sum(widths[k] for k in outer)
    inner_width = sum(widths) - outer_width
    for k in outer:
        widths[k] *= (_WIDTH - inner_width) / outer_width
    return widths


def _draw_pair(pdf: FPDF, pair: Pair, scale: float, pictures: bool) -> None:
    """Draw a figure with a list of sentences.

    The list is below a wide figure, and beside any other figure. ``scale`` is the relative font
    size. If ``pictures`` is false, the figure's place is left empty.
    """
    top = pdf.y
    if pair.wide:
        indent = 0.0
        height = max(_PAIRED_HEIGHT * scale, _READABLE_HEIGHT)
        _draw_picture(pdf, pair.picture, _WIDTH, height, scale, pictures)
        list_top = pdf.y + scale
        items: Sequence[str] = ["; ".join(pair.beside)]
    else:
        indent = _PAIRED_WIDTH + 4.0
        height = _PAIRED_HEIGHT * scale
        _draw_picture(pdf, pair.picture, _PAIRED_WIDTH, height, scale, pictures)
        list_top = top
        items = pair.beside
    bottom = pdf.y
    pdf.set_xy(_LEFT + indent, list_top)
    _write(pdf, pair.heading, 9.0 * scale, width=_WIDTH - indent, bold=True)
    for item in items:
        pdf.set_xy(_LEFT + indent, pdf.y + 0.6 * scale)
        _write(pdf, item, 7.2 * scale, width=_WIDTH - indent)
    pdf.set_y(max(bottom, pdf.y))


def _draw_row(pdf: FPDF, row: PictureRow, scale: float, pictures: bool) -> None:
    """Draw figures side by side.

    ``scale`` is the relative font size. If ``pictures`` is false, the places of the figures are
    left empty.
    """
    top = pdf.y
    left = _LEFT
    bottom = top
    height = max(_PICTURE_HEIGHT * scale, _READABLE_HEIGHT)
    gaps = _ROW_GAP * (len(row.pictures) - 1)
    for picture, share in zip(row.pictures, row.shares, strict=True):
        width = share * (_WIDTH - gaps)
        pdf.set_y(top)
        _draw_picture(pdf, picture, width, height, scale, pictures, left=left)
        bottom = max(bottom, pdf.y)
        left += width + _ROW_GAP
    pdf.set_xy(_LEFT, bottom)


def _draw_picture(
    pdf: FPDF,
    picture: Picture,
    width: float,
    height: float,
    scale: float,
    pictures: bool,
    *,
    left: float = _LEFT,
) -> None:
    """Draw a figure, with the figure's caption below.

    The figure is made as large as ``width`` and ``height`` [mm] allow. ``scale`` is the relative
    font size of the sheet, to which the caption keeps. ``left`` is the position of the figure's
    left edge [mm]. If ``pictures`` is false, the figure's place is left empty.
    """
    inches = picture.figure.get_size_inches()
    caption_width = width
    width = min(width, height * inches[0] / inches[1])
    if pictures:
        image = io.BytesIO()
        dpi = _DPI * width / MM_PER_INCH / inches[0]
        picture.figure.savefig(image, format="png", dpi=dpi)
        pdf.image(image, left, pdf.y, width, alt_text=picture.caption)
    pdf.set_xy(left, pdf.y + width * inches[1] / inches[0])
    _write(pdf, picture.caption, 7.2 * scale, width=caption_width, grey=_SOFT_INK)
