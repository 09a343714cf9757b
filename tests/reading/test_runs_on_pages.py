"""Tables on several pages: a line that names another run begins another test."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

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
