"""Columns of means, deviations and models beside the circles that they are computed from."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import Layout


def table(folder: Path, *headers: str) -> Path:
    """Write a table with one column of angles, and one of readings for each of the headers."""
    lines = [";".join(["Angle [deg]", *headers])]
    for k in range(72):
        lines.append(";".join([f"{5 * k}", *[f"{0.1 * k + n:.2f}" for n in range(len(headers))]]))
    path = folder / "columns.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "derived", ["mean 36 N [um]", "36 N sd [um]", "Δ 36 N [um]", "U 36 N [um]"]
)
def test_a_column_computed_from_another_is_refused(derived: str, tmp_path: Path) -> None:
    path = table(tmp_path, "36 N [um]", "490 N [um]", derived)
    message = r"must be a circle of its own, got '.*36 N.*' beside '36 N \[um\]'"
    with pytest.raises(lb.InputError, match=message):
        lb.import_campaign(path)


@pytest.mark.parametrize(
    ("first", "second"), [("mean", "sd"), ("raw", "comp."), ("measured", "simulated")]
)
def test_two_kinds_of_numbers_for_one_load_are_refused(
    first: str, second: str, tmp_path: Path
) -> None:
    path = table(tmp_path, f"36 N {first} [um]", f"36 N {second} [um]")
    with pytest.raises(lb.InputError, match="must be a circle of its own"):
        lb.import_campaign(path)


def test_the_refusal_names_the_columns_of_circles_alone(tmp_path: Path) -> None:
    path = table(tmp_path, "36 N run 1 [um]", "36 N run 2 [um]", "36 N mean [um]")
    step = (
        r"for example --reading-column '36 N run 1 \[um\]' --reading-column '36 N run 2 \[um\]'\."
    )
    with pytest.raises(lb.InputError, match=step):
        lb.import_campaign(path)


def test_the_columns_that_are_named_are_read(tmp_path: Path) -> None:
    path = table(tmp_path, "36 N [um]", "sd 36 N [um]", "490 N [um]", "sd 490 N [um]")
    layout = Layout(columns={"reading": ["36 N [um]", "490 N [um]"]})
    assert len(lb.import_campaign(path, layout=layout).campaign.tests) == 2


@pytest.mark.parametrize(
    "headers",
    [
        ("mean 36 N [um]", "mean 490 N [um]"),
        ("mean 36 N CW [um]", "mean 36 N CCW [um]"),
        ("36 N [um]", "mean 490 N [um]"),
        ("Δr 36 N CW [um]", "Δr 36 N CCW [um]"),
    ],
)
def test_columns_of_one_kind_are_a_circle_each(headers: tuple[str, str], tmp_path: Path) -> None:
    assert len(lb.import_campaign(table(tmp_path, *headers)).campaign.tests) == 2


@pytest.mark.parametrize(
    "derived",
    [
        "36 N ±",
        "36 N CI",
        "36 N centred",
        "36 N Durchschnitt",
        "36 N gemittelt",
        "36 N error",
        "36 N Fourier",
        "36 N среднее",
    ],
)
def test_further_words_for_computed_columns_are_refused(derived: str, tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match="must be a circle of its own"):
        lb.import_campaign(table(tmp_path, "36 N [um]", "490 N [um]", f"{derived} [um]"))


@pytest.mark.parametrize(
    "circle", ["36 N restart", "36 N different bar", "36 N Stab 2", "36 N Mittelstellung"]
)
def test_words_that_only_begin_alike_do_not_count(circle: str, tmp_path: Path) -> None:
    path = table(tmp_path, "36 N [um]", f"{circle} [um]")
    assert len(lb.import_campaign(path).campaign.tests) == 2


@pytest.mark.parametrize(
    "other",
    ["36 N old", "36 N (mean)", "36 N demeaned", "36 N w/o offset", "36 N final", "36 N weight"],
)
def test_a_word_that_is_not_known_beside_a_bare_load_is_asked_for(
    other: str, tmp_path: Path
) -> None:
    path = table(tmp_path, "36 N [um]", "490 N [um]", f"{other} [um]")
    message = r"must be a circle of its own, got '36 N .+' beside '36 N \[um\]'"
    with pytest.raises(lb.InputError, match=message):
        lb.import_campaign(path)


@pytest.mark.parametrize(
    "circle", ["36 N (2)", "36 N repeat", "36 N B", "36 N warm", "36 N XY", "36 N deviation"]
)
def test_words_for_circles_beside_a_bare_load_are_read(circle: str, tmp_path: Path) -> None:
    path = table(tmp_path, "36 N [um]", f"{circle} [um]")
    assert len(lb.import_campaign(path).campaign.tests) == 2


@pytest.mark.parametrize(
    "circle",
    [
        "36 N (Wdh.)",
        "36 N nach Reparatur",
        "36 N à chaud",
        "36 N new spindle",
        "36 N neu eingespannt",
        "36 N nouvelle broche",
        "36 N zurück",
        "36 N powtórka",
        "36 N 再測定",
        "36 N повтор",
        "36 N upper table",
        "36 N max feed",
        "36 N am Abend",
        "36 N II",
    ],
)
@pytest.mark.parametrize("unit", [" [um]", ""])
def test_parts_times_and_repetitions_beside_a_bare_load_are_read(
    circle: str, unit: str, tmp_path: Path
) -> None:
    path = table(tmp_path, f"36 N{unit}", f"{circle}{unit}")
    layout = Layout(reading_unit="um")
    assert len(lb.import_campaign(path, layout=layout).campaign.tests) == 2


@pytest.mark.parametrize(
    "headers",
    [
        ("36 N old [um]", "36 N new [um]"),
        ("36 N Kreis 1 [um]", "36 N Kreis 3 neu [um]"),
        ("36 N position 1 [um]", "36 N position 2 [um]"),
        ("36 N ida", "36 N vuelta"),
    ],
)
def test_columns_before_and_after_a_change_are_a_circle_each(
    headers: tuple[str, str], tmp_path: Path
) -> None:
    layout = Layout(reading_unit="um")
    assert len(lb.import_campaign(table(tmp_path, *headers), layout=layout).campaign.tests) == 2


@pytest.mark.parametrize("other", ["36 N w/o offset", "36 N neu", "36 N q25"])
def test_a_bare_load_without_a_unit_is_asked_for_too(other: str, tmp_path: Path) -> None:
    path = table(tmp_path, "36 N", "490 N", other)
    with pytest.raises(lb.InputError, match=r"must be a circle of its own, got '36 N .+'"):
        lb.import_campaign(path, layout=Layout(reading_unit="um"))


def test_the_refusal_names_the_circles_of_loads_with_one_column(tmp_path: Path) -> None:
    path = table(tmp_path, "36 N ref [um]", "490 N ref [um]", "490 N test [um]")
    with pytest.raises(lb.InputError, match=r"--reading-column '36 N ref \[um\]'"):
        lb.import_campaign(path)


@pytest.mark.parametrize("name", ["T{} new", "T{}a", "T{}"])
def test_names_that_begin_with_t_are_tests_and_no_times(name: str, tmp_path: Path) -> None:
    lines = ["Test;Force [N];Angle [deg];Reading [um]"]
    for n in (1, 2):
        lines += [f"{name.format(n)};{100 * n};{5 * k};{0.1 * k + n:.2f}" for k in range(72)]
    path = tmp_path / "all.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    forces = [test.force_N for test in lb.import_campaign(path).campaign.tests]
    assert forces == [100.0, 200.0]


def test_a_table_of_means_alone_says_that_they_look_computed(tmp_path: Path) -> None:
    lines = ["force_N,angle_deg,mean,std"]
    lines += [f"36,{5 * k},{0.1 * k:.2f},0.1" for k in range(72)]
    path = tmp_path / "means.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    with pytest.raises(lb.InputError, match=r"Columns that look computed: 'mean' and 'std'\."):
        lb.import_campaign(path)
    layout = Layout(columns={"reading": "mean"}, reading_unit="um")
    assert lb.import_campaign(path, layout=layout).campaign.tests[0].reading_um[1] == 0.1


def test_the_step_for_a_stacked_frame_reads_it(tmp_path: Path) -> None:
    loads = {"36 N": 1.0, "490 N": 2.0}
    lines = ["Angle [deg],,0"]
    lines += [f"{5 * k},{load},{n + 0.1 * k:.2f}" for k in range(72) for load, n in loads.items()]
    path = tmp_path / "stacked.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    with pytest.raises(lb.InputError, match=r"--test-column; if a line names .* --header-line"):
        lb.import_campaign(path)
    layout = Layout(header_line=1, columns={"reading": 3, "angle": 1, "test": 2}, reading_unit="um")
    tests = lb.import_campaign(path, layout=layout).campaign.tests
    assert [(test.force_N, test.reading_um[0]) for test in tests] == [(36.0, 1.0), (490.0, 2.0)]


def test_a_table_that_was_printed_is_refused_with_the_step(tmp_path: Path) -> None:
    lines = ["            36 N   490 N", "Angle [deg]"]
    lines += [f"{5 * k:<11} {0.1 * k:6.2f} {0.2 * k:6.2f}" for k in range(72)]
    path = tmp_path / "printed.txt"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    with pytest.raises(lb.InputError, match="as to_string of pandas does: let it write CSV"):
        lb.import_campaign(path)
