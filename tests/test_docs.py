"""Pages for users are true and plain: blocks run and print what is shown, sentences are short, the
workbook is the experiment."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import run_page

import ldbb_bayes as lb
from ldbb_bayes.model.specification import model_from_toml

ROOT = Path(__file__).resolve().parents[1]
LESSONS = [
    *sorted((ROOT / "docs" / "tutorials").glob("*.md")),
    *sorted((ROOT / "docs" / "how-to").glob("*.md")),
]
PAGES = [
    ROOT / "README.md",
    *sorted(page for page in (ROOT / "docs").rglob("*.md") if "_build" not in page.parts),
]
WORKBOOK = ROOT / "docs" / "tutorials" / "practice.xlsx"


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [page for page in PAGES if run_page.BLOCK.search(page.read_text(encoding="utf-8"))],
    ids=str,
)
def test_blocks_run(page: Path, tmp_path: Path, place_of_demonstration: Path) -> None:
    """In a folder of their own, with the data of the checkout and the tutorial's workbook."""
    (tmp_path / "data").symlink_to(ROOT / "data")
    (tmp_path / WORKBOOK.name).write_bytes(WORKBOOK.read_bytes())
    in_checkout = tmp_path / WORKBOOK.relative_to(ROOT)
    in_checkout.parent.mkdir(parents=True)
    in_checkout.write_bytes(WORKBOOK.read_bytes())
    command = [sys.executable, "-W", "error", run_page.__file__, page, place_of_demonstration]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr


def test_what_is_not_printed_is_seen() -> None:
    printed = "parameter  value\nC_XXX       57.5  nm/N\nC_YYY       42.0  nm/N\n"
    assert run_page.missing("C_XXX  57  nm/N\n…\nC_YYY …", printed) is None
    for expected in (
        "C_XXX  67.5  nm/N",
        "C_YYY  42.0  nm/N\nC_XXX  57.5  nm/N",
        "C_XXX  57.5  µm",
        "C_XXX  57.5",
    ):
        assert run_page.missing(expected, printed), expected


@pytest.mark.parametrize(
    ("shown", "printed", "is_near"),
    [
        ("57.5", "57.7", True),
        ("57.5", "57.71", False),
        ("57", "58.9", True),
        ("1.7", "1.4", False),
        ("5.39e-05", "5.41e-05", True),
        ("5.39e-05", "5.42e-05", False),
        ("−1200", "−1203", False),
    ],
)
def test_numbers_of_pages_may_differ_in_the_last_digit(
    shown: str, printed: str, is_near: bool
) -> None:
    """A tenth was allowed, and of a number such as 1e-05 all of it."""
    assert run_page.near(shown, printed) == is_near


def test_a_block_between_two_that_are_not_executed_is_found() -> None:
    skipped = "<!-- not executed: it takes long -->\n```python\nraise ValueError\n```\n"
    page = skipped + "\n```python\nprint(1)\n```\n\n" + skipped
    blocks = run_page.BLOCK.findall(page)
    assert [code for comment, _, code, _ in blocks if not comment] == ["print(1)\n"]


@pytest.mark.parametrize("page", LESSONS, ids=str)
def test_no_sentence_is_long(page: Path) -> None:
    """Of the text, list items and table cells; code, links' addresses and comments count as a
    word."""
    text = re.sub(
        r"^```.*?^```$|<!--.*?-->|\]\([^)]*\)|`[^`]*`",
        " code ",
        page.read_text(encoding="utf-8"),
        flags=re.M | re.S,
    )
    sentences = re.split(r"\n\s*\n|^\s*(?:[-*]|\d+\.|#+)\s|\||[.!?](?=[\s)])", text, flags=re.M)
    words_of_sentences = [sentence.split() for sentence in sentences]
    assert [" ".join(words) for words in words_of_sentences if len(words) > 35] == []


def test_the_workbook_is_the_published_experiment(recovered: lb.Campaign) -> None:
    imported = lb.import_campaign(WORKBOOK).campaign
    for test, published in zip(imported.tests, recovered.tests, strict=True):
        assert test.force_N == published.force_N
        assert test.angle_deg.tolist() == published.angle_deg.tolist()
        assert np.abs(test.reading_um - published.reading_um).max() < 5.001e-3


MODEL_BLOCKS = [
    (page.name, block)
    for page in PAGES
    for block in re.findall(r"```toml\n(.*?)```", page.read_text(encoding="utf-8"), re.S)
    if "[prior" in block
]


@pytest.mark.parametrize(("page", "block"), MODEL_BLOCKS)
def test_model_files_of_pages_leave_no_term_out(page: str, block: str) -> None:
    """They can be used alone as they stand."""
    assert page in {"files.md", "change_a_prior.md"}
    assert model_from_toml(block).terms == lb.HybridModel.default().terms


def test_pages_have_model_files() -> None:
    assert {page for page, _ in MODEL_BLOCKS} == {"files.md", "change_a_prior.md"}
