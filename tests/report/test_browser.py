"""The page in a real browser: no error, no request, nothing that overflows; skipped where none is
installed."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

import pypdfium2 as pdfium
import pytest
from reports import AWKWARD, awkward

import ldbb_bayes as lb
from ldbb_bayes.report.page import Document

FOLDER = Path(__file__).parent
SCRIPTS = {path.stem: path.read_text(encoding="utf-8") for path in FOLDER.glob("*.js")}

A4_PX = 794 - 2 * 53
NARROW_PX = 390
VIEWS = (
    (1280, "light", "screen"),
    (1280, "dark", "screen"),
    (NARROW_PX, "light", "screen"),
    (NARROW_PX, "dark", "screen"),
    (A4_PX, "light", "print"),
)
# Elements whose text reaches outside themselves, or out of the page; what scrolls on purpose may.
OVERFLOWING = SCRIPTS["overflowing"]
# Where nothing can scroll, what stands in a scrolling box must fit as well.
CUT_OFF = SCRIPTS["cut_off"]
# Sheets whose text does not fit their page.
SPILT = SCRIPTS["spilt"]
# Text of less contrast than WCAG's AA asks for, 4.5 to 1.
FAINT = SCRIPTS["faint"]
UNNAMED = SCRIPTS["unnamed"]


def look(browser: Any, page: Path) -> None:
    """At 1280 px light and dark, at 390 px, and as printed on A4."""
    for width, scheme, medium in VIEWS:
        context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
        opened = context.new_page()
        messages: list[str] = []
        asked: list[str] = []
        opened.on("console", lambda message, messages=messages: messages.append(message.text))
        opened.on("pageerror", lambda error, messages=messages: messages.append(str(error)))
        opened.on("dialog", lambda dialog, messages=messages: messages.append(dialog.message))
        opened.on("request", lambda request, asked=asked: asked.append(request.url))
        opened.goto(page.as_uri())
        opened.emulate_media(media=medium, color_scheme=scheme)
        where = f"{width} px, {scheme}, {medium}"
        assert messages == [], where
        assert asked == [page.as_uri()], where
        assert opened.evaluate(OVERFLOWING) == [], where
        assert opened.evaluate(UNNAMED) == 0, where
        tree = opened.locator("body").aria_snapshot()
        assert all(
            f"- {role}" in tree
            for role in ("main", "heading", "table", "status", "img", "columnheader", "rowheader")
        ), where
        opened.evaluate("document.querySelectorAll('details').forEach(one => one.open = true)")
        assert opened.evaluate(OVERFLOWING) == [], where
        if width == NARROW_PX:
            assert opened.evaluate(CUT_OFF) == [], where
        if medium == "print":
            assert opened.evaluate(CUT_OFF) == [], where
            assert opened.evaluate(SPILT) == [], where
            opened.emulate_media(media="print", color_scheme="light")
            with closing(pdfium.PdfDocument(opened.pdf(prefer_css_page_size=True))) as paper:
                sizes = [paper.get_page_size(number) for number in range(len(paper))]
            rounded = [(round(width_pt), round(height_pt)) for width_pt, height_pt in sizes]
            assert rounded == [(595, 842)] * 2, where
        assert opened.evaluate(FAINT) == [], where
        if scheme == "dark":
            colour = opened.evaluate("getComputedStyle(document.body).backgroundColor")
            channels = colour.strip("rgba()").split(",")[:3]
            assert max(map(int, channels)) < 60, colour
        context.close()


@pytest.mark.slow
def test_the_published_experiment(
    browser: Any, published: tuple[Document, str], tmp_path: Path
) -> None:
    (tmp_path / "report.html").write_text(published[1], encoding="utf-8")
    look(browser, tmp_path / "report.html")


@pytest.mark.slow
@pytest.mark.parametrize("kind", AWKWARD)
def test_awkward_campaigns(kind: str, browser: Any, tmp_path: Path) -> None:
    """Worked out in full, comparison and design included."""
    lb.write_report(awkward(kind), tmp_path)
    look(browser, tmp_path / "report.html")


def test_what_overflows_is_seen(browser: Any, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text(
        "<!doctype html><p style='width:40px;white-space:nowrap'>" + "m" * 60 + "</p>",
        encoding="utf-8",
    )
    context = browser.new_context(viewport={"width": 390, "height": 900})
    opened = context.new_page()
    opened.goto(page.as_uri())
    assert opened.evaluate(OVERFLOWING)
    context.close()
