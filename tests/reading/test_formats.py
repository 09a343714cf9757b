"""Texts that hold no table: the refusal says what they are, and the step that reads them."""

from __future__ import annotations

import gzip
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


def test_fields_of_q_das_are_named(tmp_path: Path) -> None:
    lines = ["K0100 2", "K2001/1 Angle", "K2001/2 Reading"]
    for angle, reading in NUMBERS:
        lines += [f"K0001/1 {angle}", f"K0001/2 {reading}"]
    assert "got values with K-fields of Q-DAS." in refusal(tmp_path, "36N.dfq", lines)


def test_a_table_in_latex_is_named(tmp_path: Path) -> None:
    rows = [rf"{angle} & {reading} \\" for angle, reading in NUMBERS]
    lines = [r"\begin{tabular}{rr}", r"\hline", r"Angle & Reading \\", *rows, r"\end{tabular}"]
    assert "got a table in LaTeX." in refusal(tmp_path, "36N.tex", lines)


def test_an_export_of_twincat_is_named(tmp_path: Path) -> None:
    lines = ["Name\tScope", "Starttime of export\t133787654321234567", ""]
    for name, cell in (("Name", "Angle"), ("SampleTime[ms]", "1"), ("Port", "851")):
        lines.append(f"{name}\t{cell}\t{name}\t{cell}")
    lines += [f"{k}\t{angle}\t{k}\t{reading}" for k, (angle, reading) in enumerate(NUMBERS)]
    assert "got an export of TwinCAT Scope," in refusal(tmp_path, "36N.csv", lines)


def test_settings_below_names_of_sections_are_named(tmp_path: Path) -> None:
    lines = ["[Circle]", "Force=36 N", "[Data]"]
    for k, (angle, reading) in enumerate(NUMBERS):
        lines += [f"Angle{k}={angle}", f"Reading{k}={reading}"]
    assert "got settings with a name and a value in each line." in refusal(tmp_path, "r.ini", lines)


@pytest.mark.parametrize(
    ("beginning", "name"),
    [
        (b"TDSm\x0e\0\0\0", "a TDMS file of LabVIEW"),
        (b"\x89HDF\r\n\x1a\n", "an HDF5 file"),
        (b"\x93NUMPY\1\0", "an array of NumPy"),
        (b"MATLAB 5.0 MAT-file, Platform: GLNXA64", "a MAT file of MATLAB"),
        (b"PAR1\x15\0", "a Parquet file"),
    ],
)
def test_a_binary_format_is_named(beginning: bytes, name: str, tmp_path: Path) -> None:
    path = tmp_path / "36N.csv"
    path.write_bytes(beginning + bytes(200))
    with pytest.raises(lb.InputError, match=rf"got {name}\. Save the readings as CSV with the"):
        lb.import_campaign(path)


def test_a_text_that_gzip_has_compressed_must_be_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "36N.csv.gz"
    path.write_bytes(gzip.compress(b"Angle [deg],Reading [um]\n0,1\n"))
    with pytest.raises(lb.InputError, match="must be unpacked, got an archive"):
        lb.import_campaign(path)
