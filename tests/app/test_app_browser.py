"""The page of ``ldbb-bayes app`` in Debian's Chromium, from files to PDF; skipped where none is
installed."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pypdfium2 as pdfium
import pytest

import ldbb_bayes as lb

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[2]
AXE = next(ROOT.glob(".venv*/node_modules/axe-core/axe.min.js"), None)
LONG_MS = 240_000
CIRCLES = sorted(Path(lb.embedded_campaign()).glob("f*.csv"))
OVERFLOWING = "() => document.documentElement.scrollWidth > document.documentElement.clientWidth"


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    started = [sys.executable, "-m", "ldbb_bayes", "app", "--no-browser"]
    with subprocess.Popen(started, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        yield running.stdout.readline().strip()
        running.send_signal(signal.SIGINT)
        running.communicate(timeout=30)


@pytest.fixture
def page(browser: Any, address: str) -> Iterator[Any]:
    """A tab; nothing may go wrong in it, and nothing leave the machine."""
    context = browser.new_context(
        viewport={"width": 1280, "height": 900}, locale="en-GB", bypass_csp=False
    )
    opened = context.new_page()
    wrong = list[str]()
    opened.set_default_timeout(60_000)

    def note_message(message: Any) -> None:
        if message.type in ("error", "warning"):
            wrong.append(message.text)

    def note_request(sent: Any) -> None:
        if not sent.url.startswith((address, "data:")):
            wrong.append(sent.url)

    opened.on("console", note_message)
    opened.on("pageerror", lambda error: wrong.append(str(error)))
    opened.on("request", note_request)
    opened.goto(address)
    yield opened
    assert wrong == []
    context.close()


def until(holds: Callable[[], bool], seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.02)


def check_accessible(page: Any, browser: Any) -> None:
    """The rules of axe-core, light and dark; nothing wider than a telephone."""
    if AXE is None:
        pytest.skip("axe-core is not installed (npm install --prefix .venv axe-core)")
    for width, scheme in ((1280, "light"), (1280, "dark"), (390, "light")):
        context = browser.new_context(
            viewport={"width": width, "height": 900}, color_scheme=scheme, bypass_csp=True
        )
        other = context.new_page()
        other.goto(page.url)
        other.wait_for_selector("#sliders")
        other.wait_for_selector("#worth-section table")
        other.add_script_tag(path=str(AXE))
        violations = other.evaluate("() => axe.run(document, {iframes: false})")["violations"]
        assert violations == []
        assert not other.evaluate(OVERFLOWING)
        context.close()


def test_example_from_drop_to_pdf(page: Any, browser: Any, tmp_path: Path) -> None:
    page.click("#example")
    page.wait_for_selector("#worth-section table")
    page.click("#start")
    page.wait_for_selector("#bar")
    page.reload()  # in mid-fit
    page.wait_for_selector("#cancel")
    page.wait_for_selector("#sliders", timeout=LONG_MS)
    assert page.frame_locator("#report").locator("#certificate").is_visible()
    with page.expect_download() as loading:
        page.click("text=Both sheets (PDF)")
    loading.value.save_as(tmp_path / "report.pdf")
    with pdfium.PdfDocument(tmp_path / "report.pdf") as paper:
        sheet = paper[0].get_textpage().get_text_bounded()
        assert len(paper) == 2
    stated = (
        page.frame_locator("#report")
        .locator("section.sheet")
        .first.locator("tbody tr")
        .first.inner_text()
        .split("\t")
    )
    assert stated[2] in sheet
    for name in (
        "parameters.csv",
        "tables.zip",
        "report.json",
        "dcc.xml",
        "campaign.zip",
        "posterior.nc",
        "report.zip",
    ):
        with page.expect_download() as loading:
            page.click(f"a[href='result/{name}']")
        assert Path(loading.value.path()).stat().st_size > 500
    check_sliders(page)
    check_cheapest_campaign(page)
    check_accessible(page, browser)
    page.select_option("#language", "de")
    page.wait_for_selector("h1:has-text('Kreisformtest')")
    page.wait_for_selector("#sliders")
    assert "Keine Zahl von Kreisen bringt U unter" in page.inner_text("#cheapest-section")


def check_sliders(page: Any) -> None:
    """Every slider redraws the plan; its sheet is for the operator."""
    for slider in page.locator("#sliders input[type=range]").all():
        forecast = page.inner_html("#forecast")
        name = slider.get_attribute("name")
        slider.focus()
        keys = {"circles": "End", "turn": "End", "high": "ArrowLeft"}
        page.keyboard.press(keys.get(name, "ArrowRight"))
        if name not in ("turn", "minutes_per_clocking", "minutes_per_setup"):
            until(lambda forecast=forecast: page.inner_html("#forecast") != forecast)
    page.click("#best")
    page.wait_for_selector("#forecast p:has-text('The forces were chosen')")
    circles = int(page.input_value("#plan-circles"))
    with page.context.expect_page() as opening:
        page.click("text=Sheet for the operator")
    opening.value.wait_for_load_state()
    assert opening.value.locator("tbody tr").count() == circles
    opening.value.close()


def check_cheapest_campaign(page: Any) -> None:
    """By keyboard alone: a goal that is refused where it was typed, a search that is stopped, and
    one to its end, with what it found to take along."""
    page.locator("details.goals summary").first.focus()
    page.keyboard.press("Enter")
    page.focus("#plan-goal_C_XXX")
    page.keyboard.type("5")
    page.wait_for_selector("#plan-goal_C_XXX[aria-invalid][aria-describedby='why-goal_C_XXX']")
    page.focus("#search")
    page.keyboard.press("Enter")
    page.wait_for_selector("#cheapest-section [role=alert]:focus")
    assert page.locator("#plan-goal_C_XXX[aria-invalid]").count() == 1
    page.focus("#plan-goal_C_XXX")
    page.keyboard.type(" %")
    page.fill("#plan-goal_E_C0YX", "40 urad")
    page.focus("#plan-hours")
    page.keyboard.press("Enter")
    page.wait_for_selector("#search-bar")
    assert page.is_disabled("#search")
    assert page.locator("#plan-goal_C_XXX[aria-invalid]").count() == 0
    page.focus("#stop")
    page.keyboard.press("Enter")
    page.wait_for_selector("#cheapest-section :text('Stopped.')")
    page.keyboard.press("Enter")  # the button for the search has the focus again
    page.wait_for_selector("#cheapest-campaigns", timeout=LONG_MS)
    found = page.inner_text("#cheapest-section")
    assert "C_XXX: no number of circles brings U below" in found
    assert page.locator("#cheapest-section details").count() == 3
    with page.expect_download() as loading:
        page.click("a[href='result/cheapest-1.zip']")
    with zipfile.ZipFile(loading.value.path()) as archive:
        assert {"campaign.toml", "model.toml", "goals.json"} <= {*archive.namelist()}
    with page.context.expect_page() as opening:
        page.click("a[href='result/cheapest-1.html']")
    opening.value.wait_for_load_state()
    assert opening.value.locator("td.write").count() > 0
    opening.value.close()


def test_a_broken_workbook_is_answered_where_it_is(page: Any, tmp_path: Path) -> None:
    broken = tmp_path / "broken.xlsx"
    broken.write_bytes(b"PK\x03\x04 no workbook")
    page.set_input_files("#chosen", broken)
    alert = page.locator("#understood-section [role=alert]")
    alert.wait_for()
    assert "broken.xlsx" in alert.inner_text()
    assert page.evaluate("document.activeElement.getAttribute('role')") == "alert"
    page.click("[data-remove='broken.xlsx']")
    page.set_input_files("#chosen", CIRCLES)
    page.wait_for_selector("#understood-section table")
    page.fill("#entry-bar_U_um", "wide")
    page.keyboard.press("Enter")
    alert.wait_for()
    assert "--bar-U-um must be a number" in alert.inner_text()
    page.fill("#entry-bar_U_um", "1.5")  # and not applied
    page.reload()
    page.wait_for_selector("#understood-section dl:has-text('± 1.5 µm (stated)')")
    assert page.input_value("#entry-bar_U_um") == "1.5"


def test_files_chosen_while_the_page_redraws_arrive(page: Any) -> None:
    with page.expect_file_chooser() as opening:
        page.click("#chosen")
    page.evaluate("show('files')")
    opening.value.set_files(CIRCLES)
    page.wait_for_selector("#understood-section table")


def test_cancel_and_two_sessions_at_once(page: Any, browser: Any, address: str) -> None:
    context = browser.new_context()
    other = context.new_page()
    other.goto(address)
    other.set_input_files("#chosen", CIRCLES[:3])
    other.wait_for_selector("#understood-section table")
    page.click("#example")
    page.wait_for_selector("#worth-section table")
    page.fill("#entry-bar_U_um", "1")  # and not applied: the fit does so
    page.click("#start")
    page.wait_for_selector("#understood-section dl:has-text('± 1.0 µm (stated)')")
    other.click("#start")
    other.wait_for_selector("#step:has-text('waits for another fit')")
    page.click("#cancel")
    page.wait_for_selector("text=Cancelled. Nothing was lost")
    other.wait_for_selector("#sliders", timeout=LONG_MS)
    assert page.locator("#sliders").count() == 0
    assert other.locator("#files-section li").count() == 3
    folder = re.search(r"/s/([\w-]+)/", other.url)
    assert folder is not None
    context.close()
    until(lambda: not [*Path(os.environ.get("TMPDIR", "/tmp")).glob(f"ldbb-bayes-*/{folder[1]}")])


def test_everything_by_keyboard(page: Any) -> None:
    def reach(selector: str) -> None:
        for _ in range(200):
            if page.evaluate("selector => document.activeElement.matches(selector)", selector):
                return
            page.keyboard.press("Tab")
        raise AssertionError(f"{selector} is not reached")

    reach(".skip")
    reach("#language")
    reach("#chosen")
    reach("#example")
    page.keyboard.press("Enter")
    page.wait_for_selector("#worth-section table")
    reach("#entry-bar_U_um")
    page.keyboard.type("1")
    page.keyboard.press("Enter")
    page.wait_for_selector("#understood-section dl:has-text('± 1.0 µm (stated)')")
    page.wait_for_selector("#worth-section table")
    reach("#start")
    page.keyboard.press("Enter")
    page.wait_for_selector("#sliders", timeout=LONG_MS)
    reach("a[href='result/report.pdf']")
    reach("#plan-circles")
    page.keyboard.press("End")
    page.wait_for_selector("#forecast p:has-text('Circles: 60')")
    # Drawn from all states of the machine, after which its links are not replaced any more.
    page.wait_for_selector("#status:has-text('Circles: 60')")
    reach("a[href='result/plan.html']")
