"""Texts that hold no table: the refusal says what they are, and the step that reads them."""

from __future__ import annotations

from pathlib import Path
from time import process_time

import pytest

import ldbb_bayes as lb

NUMBERS = [(5.0 * k, 0.1 * k) for k in range(72)]
STEP = r"\. Save the readings as CSV: the line 'Angle \[deg\],Reading \[um\]'"


def refusal(folder: Path, name: str, lines: list[str]) -> str:
    path = folder / name
    path.write_text("\n".join([*lines, ""]))
    with pytest.raises(lb.InputError, match=STEP) as refused:
        lb.import_campaign(path)
    return str(refused.value)


def test_xml_is_named(tmp_path: Path) -> None:
    lines = ["<test>", *[f'<p angle="{a}" reading="{r}"/>' for a, r in NUMBERS], "</test>"]
    assert "got XML." in refusal(tmp_path, "run.xml", lines)


def test_a_page_in_html_is_named(tmp_path: Path) -> None:
    lines = ["<table>", *[f"<tr><td>{a}</td><td>{r}</td></tr>" for a, r in NUMBERS], "</table>"]
    assert "got a page in HTML." in refusal(tmp_path, "run.html", lines)


def test_yaml_is_named(tmp_path: Path) -> None:
    lines = ["readings:"]
    for angle, reading in NUMBERS:
        lines += [f"  - angle: {angle}", f"    reading: {reading}"]
    assert "got YAML." in refusal(tmp_path, "run.yaml", lines)


def test_lists_in_lines_are_named(tmp_path: Path) -> None:
    lines = [f"angle = {[a for a, _ in NUMBERS]}", f"reading = {[r for _, r in NUMBERS]}"]
    said = "got lists of numbers in lines: 'angle' and 'reading'."
    assert said in refusal(tmp_path, "run.toml", lines)


@pytest.mark.parametrize("name", ["run.m", "run.txt"])
def test_a_program_of_matlab_is_named_with_its_command(name: str, tmp_path: Path) -> None:
    lines = ["% theta: deg", "run(1).F = 36; % N"]
    for vector, k in (("run(1).theta", 0), ("run(1).dL", 1)):
        numbers = [f"{pair[k]:g}" for pair in NUMBERS]
        lines.append(f"{vector} = [ ...")
        for first in range(0, len(numbers), 12):
            lines.append("   " + " ".join(numbers[first : first + 12]) + " ...")
        lines.append("];")
    text = refusal(tmp_path, name, lines)
    assert "got a program of MATLAB with vectors in lines: 'run(1).theta' and 'run(1).dL'." in text
    command = "writematrix([run(1).theta(:) run(1).dL(:)], '36 N.csv')."
    assert text.endswith(f"{command} Copy the lines that begin with % above its numbers.")


def test_lists_that_go_on_in_further_lines_are_named(tmp_path: Path) -> None:
    lines = []
    for name, k in (("angle", 0), ("reading", 1)):
        lines.append(f"{name} = np.array([")
        for first in range(0, len(NUMBERS), 12):
            numbers = NUMBERS[first : first + 12]
            lines.append("    " + ", ".join(f"{pair[k]:g}" for pair in numbers) + ",")
        lines.append("])")
    said = "got lists of numbers in lines: 'angle' and 'reading'."
    assert said in refusal(tmp_path, "run.py", lines)


def test_tests_named_t1_are_rows_and_no_header(tmp_path: Path) -> None:
    lines = ["test,force_N,angle_deg,reading_um", *[f"T1,36,{a},{r}" for a, r in NUMBERS]]
    path = tmp_path / "run.csv"
    path.write_text("\n".join([*lines, ""]))
    assert lb.import_campaign(path).campaign.readings == len(NUMBERS)


def test_lists_that_are_closed_in_their_line_are_named_at_once(tmp_path: Path) -> None:
    angles = ", ".join(str(5 * k) for k in range(30))
    readings = ", ".join(f"{0.1 * k:.1f}" for k in range(30))
    start = process_time()
    lines = [f"angle_deg = [{angles}]", f"reading_um = [{readings}]"]
    assert "lists of numbers in lines: 'angle_deg'" in refusal(tmp_path, "run.txt", lines)
    assert process_time() - start < 5.0
