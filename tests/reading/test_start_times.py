"""When tests were run: times that files state become ``time_s`` of their tests, and it is told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from campaigns import cases

import ldbb_bayes as lb

CASES = cases(__file__, "start_times.toml")
NAMES = ("36N", "238N", "742N")


def write(path: Path, above: str = "", header: str = "", cell: str = "") -> Path:
    """A circle in steps of 5°, with a line above, or a further column with the same cell."""
    rows = []
    for k in range(72):
        rows.append(f"{5 * k};{k % 7}.25;{cell}")
    lines = [above, f"angle_deg;reading_um;{header}", *rows]
    path.write_text("\n".join(line.strip(";") for line in lines if line), encoding="utf-8")
    return path


def imported(folder: Path, above: list[str], **options: Any) -> lb.reading.Imported:
    """One file for each line."""
    paths = []
    for name, line in zip(NAMES, above, strict=False):
        paths.append(write(folder / f"{name}.csv", line))
    return lb.import_campaign(paths, **options)


def times_s(result: lb.reading.Imported) -> list[float | None]:
    return [test.time_s for test in result.campaign.tests]


def told(result: lb.reading.Imported) -> list[tuple[str, str, str]]:
    notes = []
    for note in result.assumptions:
        if note.what in ("time_s", "order"):
            notes.append((note.what, note.value, note.because))
    return notes


def test_times_of_all_files_are_taken_after_the_earliest_and_told(tmp_path: Path) -> None:
    result = imported(
        tmp_path,
        ["Start time: 14:10:00", "Start time: 14:03:30", "Start time: 14:17:00"],
    )
    assert times_s(result) == [390.0, 0.0, 810.0]
    assert told(result) == [
        ("time_s", "238N at 0 min, 36N at 6.5 min, 742N at 13.5 min", "line 1"),
        ("order", "that of their times", "they are listed in another"),
    ]


@pytest.mark.parametrize(("above", "expected"), CASES["taken"])
def test_times_that_are_taken(above: list[str], expected: list[float], tmp_path: Path) -> None:
    assert times_s(imported(tmp_path, above)) == expected


@pytest.mark.parametrize(("above", "reason"), CASES["not_taken"])
def test_times_that_are_not_taken_are_told(above: list[str], reason: str, tmp_path: Path) -> None:
    result = imported(tmp_path, above)
    assert times_s(result) == [None, None, None]
    assert told(result) == [("order", "as listed", reason)]


@pytest.mark.parametrize(
    ("options", "notes"),
    [
        ({}, [("order", "as listed", "nothing says when the tests were run")]),
        ({"order": "random"}, []),
        ({"drift": False}, []),
    ],
)
def test_without_times_the_order_listed_counts_and_is_told_unless_stated(
    options: dict[str, Any], notes: list[tuple[str, str, str]], tmp_path: Path
) -> None:
    result = imported(tmp_path, ["Date: 2026-11-20", "Radius: 150 mm", ""], **options)
    assert times_s(result) == [None, None, None]
    assert told(result) == notes
    assert {name: getattr(result.campaign, name) for name in options} == options


def test_a_date_that_is_read_in_the_only_plausible_order_is_told(tmp_path: Path) -> None:
    """Across midnight, so that the two orders differ: ten minutes, or a month and ten minutes."""
    above = ["Date: 03/04/2026 23:55", "Date: 04/04/2026 00:05", "Date: 04/04/2026 00:15"]
    result = imported(tmp_path, above)
    assert times_s(result) == [0.0, 600.0, 1200.0]
    ((_, _, because),) = told(result)
    assert because == "line 1; '03/04/2026 23:55' read with the day first"


def test_tests_of_several_days_are_told(tmp_path: Path) -> None:
    above = ["Date: 2026-11-20 14:00", "Date: 2026-11-21 14:00", "Date: 2026-11-22 20:00"]
    result = imported(tmp_path, above)
    assert times_s(result) == [0.0, 86_400.0, 194_400.0]
    assert told(result)[-1][1] == "more than a day apart"


@pytest.mark.parametrize(
    ("header", "cells"),
    [
        ("Zeitstempel", ("2026-11-20 14:00:00", "2026-11-20 14:06:00")),
        ("Time", ("14:00:00", "14:06:00")),
        ("timestamp", ("1795183200", "1795183560")),
    ],
)
def test_columns_of_times(header: str, cells: tuple[str, str], tmp_path: Path) -> None:
    paths = []
    for name, cell in zip(NAMES, cells, strict=False):
        paths.append(write(tmp_path / f"{name}.csv", header=header, cell=cell))
    result = lb.import_campaign(paths)
    assert times_s(result) == [0.0, 360.0]
    assert told(result)[0][2] == f"the column {header!r}"


def test_names_of_files(tmp_path: Path) -> None:
    names = ("2026-11-20_14-00-00 36N.csv", "2026-11-20_14-06-30 742N.csv")
    result = lb.import_campaign([write(tmp_path / name) for name in names])
    assert times_s(result) == [0.0, 390.0]
    assert told(result)[0][2] == "its name"


def test_the_start_of_a_test_goes_before_other_times_of_its_file(tmp_path: Path) -> None:
    above = ["Time: 13:00\nStart time: 14:00", "Time: 13:00\nStart time: 14:06"]
    assert times_s(imported(tmp_path, above)) == [0.0, 360.0]


def test_times_that_are_stated_are_not_read_from_files(tmp_path: Path) -> None:
    layout = {"test": [{"file": "36N", "time_s": 7.0}, {"file": "238N", "time_s": 99.0}]}
    result = imported(
        tmp_path,
        ["Start time: 14:10:00", "Start time: 14:03:30"],
        layout=lb.reading.Layout.model_validate(layout),
    )
    assert times_s(result) == [7.0, 99.0]
    assert told(result) == []


def test_half_circles_start_with_the_earlier_half(tmp_path: Path) -> None:
    paths = []
    starts = {"36N a": "14:01", "36N b": "14:00", "742N a": "14:10", "742N b": "14:11"}
    for name, start in starts.items():
        first = 180 * name.endswith("b")
        rows = [f"{first + 5 * k};{k % 7}.25" for k in range(37)]
        lines = [f"Start time: {start}", "angle_deg;reading_um", *rows]
        (tmp_path / f"{name}.csv").write_text("\n".join(lines), encoding="utf-8")
        paths.append(tmp_path / f"{name}.csv")
    result = lb.import_campaign(paths)
    assert [test.name for test in result.campaign.tests] == ["36N", "742N"]
    assert times_s(result) == [0.0, 600.0]
