"""Tables on several pages: a line that names another run begins another test."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pytest

import ldbb_bayes as lb

FIRST_HALF = range(0, 180, 5)
SECOND_HALF = range(180, 360, 5)


def page(run: int, angles_deg: Iterable[int]) -> str:
    lines = [f"Run {run}", f"Start time: 14:0{run}:00", "Angle [deg],Reading [um]"]
    lines += [f"{angle},{0.01 * angle + run:.2f}" for angle in angles_deg]
    return "\n".join([*lines, ""])


def number_of_tests(folder: Path, *pages: str) -> int:
    path = folder / "100N.txt"
    path.write_text("\f\n".join(pages))
    return len(lb.import_campaign(path).campaign.tests)


def test_another_run_that_starts_elsewhere_is_another_test(tmp_path: Path) -> None:
    second = page(2, [*range(90, 360, 5), *range(0, 90, 5)])
    assert number_of_tests(tmp_path, page(1, range(0, 360, 5)), second) == 2


def test_the_same_run_on_a_further_page_is_one_test(tmp_path: Path) -> None:
    assert number_of_tests(tmp_path, page(1, FIRST_HALF), page(1, SECOND_HALF)) == 1


def test_each_of_two_runs_may_fill_two_pages(tmp_path: Path) -> None:
    first = [page(1, FIRST_HALF), page(1, SECOND_HALF)]
    second = [page(2, SECOND_HALF), page(2, FIRST_HALF)]
    assert number_of_tests(tmp_path, *first, *second) == 2


def report(head: str, statement: str, end: str) -> str:
    """Return a report with a page for each of two forces, with a head above each page."""
    lines = []
    for number, force_N in enumerate((36, 122), start=1):
        lines += [head.format(p=number), "", "Test report no. 112"]
        lines += [statement.format(p=number, F=force_N), "", "Angle   Deviation"]
        lines += [f"{5 * k}.0   {0.01 * k + number:.3f}" for k in range(72)]
        lines += ["", end, ""]
    return "\n".join(lines)


@pytest.mark.parametrize("end", ["", "Remarks: none."])
@pytest.mark.parametrize("head", ["ACME S.p.A. - Sala metrologica   pag. {p}/2", "Page {p} of 2"])
def test_each_page_states_the_force_of_its_circle(head: str, end: str, tmp_path: Path) -> None:
    statement = "Run {p}: radial force {F} N, plane XY, radius 150 mm"
    path = tmp_path / "report.txt"
    path.write_text(report(head, statement, end))
    tests = lb.import_campaign(path).campaign.tests
    assert [(test.force_N, len(test.angle_deg)) for test in tests] == [(36.0, 72), (122.0, 72)]


@pytest.mark.parametrize(
    "line", ["Macchina: Thunder 1000, matr. 2217", "lo zero è sull'asse X, barra più lunga"]
)
def test_lines_of_a_page_are_neither_header_nor_greek(line: str, tmp_path: Path) -> None:
    text = report("ACME S.p.A.   pag. {p}/2", line + "\nforza radiale {F} N, piano XY", "")
    path = tmp_path / "report.txt"
    path.write_bytes(text.encode("cp1252"))
    imported = lb.import_campaign(path)
    assert [test.force_N for test in imported.campaign.tests] == [36.0, 122.0]
    encodings = [note.value for note in imported.assumptions if note.what == "encoding"]
    assert encodings == ([] if line.isascii() else ["cp1252"] * len(encodings))
