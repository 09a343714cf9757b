"""Rows of statistics at the end of a table are left out together, and told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import ldbb_bayes as lb

ROWS = [f"{5 * k};{0.1 * k:.2f}" for k in range(72)]


def imported(folder: Path, *below: str) -> lb.reading.Imported:
    path = folder / "100N.csv"
    path.write_text("\n".join(["Angle [deg];Reading [um]", *ROWS, *below, ""]))
    return lb.import_campaign(path)


@pytest.mark.parametrize(
    "labels",
    [
        ("mean", "std. dev.", "max"),
        ("Mittelwert:", "Standardabweichung", "Spannweite"),
        ("Moyenne", "Écart type", "Étendue"),
    ],
)
def test_statistics_are_left_out_together(labels: tuple[str, ...], tmp_path: Path) -> None:
    result = imported(tmp_path, *[f"{label};1.25" for label in labels])
    assert result.campaign.readings == len(ROWS)


def test_statistics_are_told_once(tmp_path: Path) -> None:
    notes = imported(tmp_path, "mean;1.25", "max;7.10").assumptions
    (note,) = [note for note in notes if "'max'" in note.value or "'max'" in note.because]
    assert (note.value, note.because) == ("2 rows left out", "'mean', 'max' from line 74 on")


def test_another_word_among_the_angles_is_refused(tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match=r"line 74: angle .* got 'broken'"):
        imported(tmp_path, "broken;1.25")


def test_tests_that_are_named_max_are_no_statistics(tmp_path: Path) -> None:
    rows = [f"{name};{row}" for name in ("min", "max") for row in ROWS]
    path = tmp_path / "100N.csv"
    path.write_text("\n".join(["test;Angle [deg];Reading [um]", *rows, ""]))
    assert len(lb.import_campaign(path).campaign.tests) == 2


@pytest.mark.parametrize(
    ("above", "step"),
    [(["1;2"], "Remove line 2,"), (["1;2", "3;4", "5;6"], "Remove lines 2 to 4,")],
)
def test_lines_of_numbers_above_the_header_are_named(
    above: list[str], step: str, tmp_path: Path
) -> None:
    path = tmp_path / "100N.csv"
    path.write_text("\n".join(["a;b", *above, "Angle [deg];Reading [um]", *ROWS, ""]))
    with pytest.raises(lb.InputError, match=step):
        lb.import_campaign(path)


def test_statistics_between_groups_of_rows_are_left_out(tmp_path: Path) -> None:
    rows = []
    for force in ("100 N", "300 N"):
        rows += [f"{force};{row}" for row in ROWS]
        rows += [f"{force};mean;1.25", f"{force};max;7.10"]
    path = tmp_path / "tests.csv"
    path.write_text("\n".join(["test;Angle [deg];Reading [um]", *rows, ""]))
    result = lb.import_campaign(path)
    assert [len(test.angle_deg) for test in result.campaign.tests] == [72, 72]
    (note,) = [note for note in result.assumptions if note.what == "left out"]
    assert (note.value, note.because) == ("4 rows left out", "'mean', 'max' from line 74 on")


def test_rows_with_units_in_their_cells_are_no_statistics(tmp_path: Path) -> None:
    path = tmp_path / "all.csv"
    rows = ["test;Angle;Deviation;"]
    for force, unit in ((100, "1/1000 mm"), (300, "0.1 um"), (600, "mm")):
        rows += [f"{force} N;{10 * k} °;{0.5 * k};{unit}" for k in range(36)]
    path.write_text("\n".join([*rows, ""]), encoding="utf-8")
    tests = lb.import_campaign(path).campaign.tests
    assert [len(test.angle_deg) for test in tests] == [36, 36, 36]
    assert [test.reading_um[1] for test in tests] == pytest.approx([0.5, 0.05, 500.0])


def test_statistics_in_the_column_of_tests_are_no_tests(tmp_path: Path) -> None:
    rows = []
    for force in ("100 N", "300 N"):
        rows += [*[f"{force};{row}" for row in ROWS], "mean;;1.25", "sd;;0.2"]
    path = tmp_path / "tests.csv"
    path.write_text("\n".join(["test;Angle [deg];Reading [um]", *rows, ""]))
    forces = [test.force_N for test in lb.import_campaign(path).campaign.tests]
    assert forces == [100.0, 300.0]


@pytest.mark.parametrize("cells", [("Gain", "Offset"), ("Scale factor", "Nullpunkt")])
@pytest.mark.parametrize("number", [str, lambda _: ""])
def test_rows_of_gain_and_offset_are_refused_with_their_lines(
    cells: tuple[str, str], number: Callable[[int], str], tmp_path: Path
) -> None:
    rows = [f"{cells[0]};1;0.5", f"{cells[1]};0;10"]
    rows += [f"{number(k + 1)};{row}" for k, row in enumerate(ROWS)]
    path = tmp_path / "100N.csv"
    path.write_text("\n".join(["Channel;Angle [deg];Reading [um]", *rows, ""]))
    with pytest.raises(lb.InputError, match=r"what these rows state, and remove the rows: 2, 3\."):
        lb.import_campaign(path)


def test_remarks_beside_some_rows_are_no_reason_to_refuse(tmp_path: Path) -> None:
    rows = [f"{row};{'touched' if k == 4 else ''}" for k, row in enumerate(ROWS)]
    path = tmp_path / "100N.csv"
    path.write_text("\n".join(["Angle [deg];Reading [um];Remark", *rows, ""]))
    assert lb.import_campaign(path).campaign.readings == len(ROWS)


@pytest.mark.parametrize(
    ("header", "usual", "unfit"),
    [
        ("Quality", "Good", "Bad_NoCommunication"),
        ("StatusCode", "Good", "Uncertain"),
        ("Remark", "", "outlier, do not use"),
        ("Bemerkung", "", "Ausreißer"),
        ("unit_string", "", "wf_increment"),
    ],
)
def test_rows_called_bad_are_refused_with_their_lines(
    header: str, usual: str, unfit: str, tmp_path: Path
) -> None:
    rows = [f"{unfit if k == 4 else usual};{row}" for k, row in enumerate(ROWS)]
    path = tmp_path / "100N.csv"
    text = "\n".join([f"{header};Angle [deg];Reading [um]", *rows, ""])
    path.write_text(text, encoding="utf-8")
    with pytest.raises(lb.InputError, match=rf"line 6: .* got '{unfit}' .* the rows: 6\."):
        lb.import_campaign(path)


@pytest.mark.parametrize("remark", ["no error", "badge 7", "errorless", "not an outlier"])
def test_remarks_that_deny_a_fault_change_nothing(remark: str, tmp_path: Path) -> None:
    rows = [f"{row};{remark if k == 4 else ''}" for k, row in enumerate(ROWS)]
    path = tmp_path / "100N.csv"
    path.write_text("\n".join(["Angle [deg];Reading [um];Remark", *rows, ""]))
    assert lb.import_campaign(path).campaign.readings == len(ROWS)


def test_a_word_for_bad_in_all_rows_is_refused(tmp_path: Path) -> None:
    rows = [f"{row};Bad" for row in ROWS]
    path = tmp_path / "100N.csv"
    path.write_text("\n".join(["Angle [deg];Reading [um];Status", *rows, ""]))
    with pytest.raises(lb.InputError, match="line 2: rows must hold readings, got 'Bad' in column"):
        lb.import_campaign(path)


@pytest.mark.parametrize("word", ["not used", "Bad Cannstatt", "Uncertainty 0.5 um"])
def test_words_of_other_meaning_in_all_rows_change_nothing(word: str, tmp_path: Path) -> None:
    rows = [f"{row};{word}" for row in ROWS]
    path = tmp_path / "100N.csv"
    path.write_text("\n".join(["Angle [deg];Reading [um];Remark", *rows, ""]))
    assert lb.import_campaign(path).campaign.readings == len(ROWS)
