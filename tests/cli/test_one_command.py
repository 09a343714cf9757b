"""``report FILE…`` and what it rests on: files as they are found to a page in one command, nothing
edited."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from pathlib import Path

import awkward
import numpy as np
import pypdfium2
import pytest
from campaigns import Invoke, refuses
from openpyxl import Workbook
from reports import NOT_COMPARED, undrawn

import ldbb_bayes as lb
from ldbb_bayes.cli import app, file_reports, questions, report_making
from ldbb_bayes.reading.file_patterns import matching

FORCES_N = (36.0, 238.0, 364.0, 490.0, 616.0, 742.0)
HEAD = (
    ("Maschine", "DMG Mori DMU 50"),
    ("Seriennummer", "1139-4711"),
    ("Bediener", "Jörg Müller"),
    ("Datum", "20.11.2026"),
    ("Temperatur", "21,4 °C"),
    ("Vorschub", "2000 mm/min"),
    ("Messgerät", "QC20-W Nr. K12345"),
    ("kalibriert am", "05.01.2026"),
    ("Ebene", "XY"),
)
NAMED = {
    "machine_type": "DMG Mori DMU 50",
    "serial_number": "1139-4711",
    "machine_id": "1139-4711",
    "operator": "Jörg Müller",
    "date": "2026-11-20",
    "ball_bar": "QC20-W Nr. K12345",
    "ball_bar_calibrated": "2026-01-05",
    "feed_mm_per_min": 2000.0,
    "plane": "XY",
}


def circles(*forces_N: float) -> list[lb.CircularTest]:
    """As awkward writes them, of a machine whose compliance shows; steps of 0.1 µm."""
    angle = np.arange(0.0, 360.0, 2.0)
    theta = np.deg2rad(angle)
    shape = (
        8.0 * np.cos(2.0 * theta)
        - 3.0 * np.sin(theta)
        + 0.4 * np.random.default_rng(1).standard_normal(len(angle))
    )
    bend = 54e-3 * np.cos(theta) ** 2 + 39e-3 * np.sin(theta) ** 2 - 2.33e-2
    tests = []
    for force_N in forces_N:
        reading_um = np.round(shape + force_N * bend, 1)
        name = f"{force_N:g} N"
        tests.append(lb.CircularTest(force_N, angle, reading_um, name=name, direction="CCW"))
    return tests


def german(value: float, digits: int) -> str:
    return f"{value:.{digits}f}".replace(".", ",")


def book(folder: Path) -> list[str]:
    """Six sheets, the first of them an overview that says what the others are; decimal commas, as
    text."""

    def fill(workbook: Workbook) -> None:
        sheet = workbook.active
        sheet.title = "Übersicht"
        for row in (*HEAD, (), ("Blatt", "Prüfkraft [N]", "Richtung", "größte Abweichung [µm]")):
            sheet.append(row)
        for k, test in enumerate(circles(*FORCES_N[1:]), start=1):
            sheet.append(
                [
                    f"Versuch {k}",
                    test.force_N,
                    "gegen den Uhrzeigersinn",
                    float(np.abs(test.reading_um).max()),
                ]
            )
            page = workbook.create_sheet(f"Versuch {k}")
            page.append(["Winkel [°]", "Messwert [mm]"])
            for a, r in zip(test.angle_deg, test.reading_um, strict=True):
                page.append([german(a, 1), german(r * 1e-3, 4)])

    (folder / "Messung.xlsx").write_bytes(awkward.workbook(fill))
    return [str(folder / "Messung.xlsx")]


def windows(folder: Path) -> list[str]:
    """CSVs in Windows-1252 with a preamble, named by a pattern as cmd.exe hands it on; a note lies
    beside them."""
    above = [f"{name}: {value}" for name, value in HEAD]
    how = awkward.Writing(
        ";",
        ",",
        ("Winkel [°]", "Abweichung [µm]"),
        above,
        digits=(1, 1),
        encoding="cp1252",
        end="\r\n",
    )
    (folder / "Läufe").mkdir()
    for test in circles(*FORCES_N):
        (folder / "Läufe" / f"Lauf {test.name}.csv").write_bytes(how.table(test))
    (folder / "Läufe" / "~$Lauf 5 N.csv").write_bytes(b"\0")
    (folder / "Läufe" / "Lauf, Bemerkungen.csv").write_text(
        "Spindel warm; nichts auffällig\n", encoding="utf-8"
    )
    return [f"{folder}/Läufe/Lauf*.csv"]


def instrument(folder: Path) -> list[str]:
    """Text of an instrument: time and radius of each circle, with run-in and run-out."""
    head = (
        "QC20-W capture",
        "Machine: DMG Mori DMU 50",
        "Machine serial no: 1139-4711",
        "Operator: Jörg Müller",
        "Date: 20-Nov-2026",
        "Ball bar: QC20-W Nr. K12345",
        "Last calibration: 2026-01-05",
        "Plane: XY",
        "Radius: 150 mm",
        "Feed rate: 2000.0 mm/min",
        "Start angle: 0 deg",
        "Angular overshoot: 44 deg",
        "Machine temp: 21.4 °C",
    )
    for test in circles(*FORCES_N):
        turn = np.arange(-22, 180 + 22)
        seconds = np.deg2rad(2.0) * 150.0 / (2000.0 / 60.0) * (turn + 22.0)
        rows = [
            f"{t:.6f}\t{r:.4f}"
            for t, r in zip(seconds, 150.0 + 1e-3 * test.reading_um[turn % 180], strict=True)
        ]
        lines = [
            *head,
            f"Force: {test.force_N:g} N",
            "Direction: CCW",
            "",
            "Time (s)\tRadius (mm)",
            *rows,
        ]
        (folder / f"run {test.name}.txt").write_text("\n".join(lines), encoding="utf-8")
    return [str(folder / "run ??? N.txt"), str(folder / "run 36 N.txt")]


def halves(folder: Path) -> list[str]:
    """Half circles, a file each, angles of both from their own beginning to their own end."""
    preamble = [f"{name}: {value}" for name, value in HEAD]
    for test in circles(*FORCES_N):
        for half, points in (("first", np.arange(91)), ("second", np.arange(90, 181) % 180)):
            lines = [*preamble, "angle (deg);reading (um)"]
            readings_um = test.reading_um[points]
            for angle_deg, reading_um in zip(test.angle_deg[points], readings_um, strict=True):
                lines.append(f"{angle_deg:.1f};{reading_um:.1f}")
            (folder / f"{test.name} {half} half.csv").write_text("\n".join(lines), encoding="utf-8")
    return [str(folder / "*half.csv")]


CASES: dict[str, Callable[[Path], list[str]]] = {
    case.__name__: case for case in (book, windows, instrument, halves)
}


@pytest.mark.parametrize("name", CASES)
def test_what_files_say_is_understood(name: str, tmp_path: Path, invoke: Invoke) -> None:
    """Forces, readings, resolution, and everything that the certificate names; only machine and
    mount are assumed."""
    patterns = CASES[name](tmp_path)
    record = json.loads(invoke("import", *patterns, "--out", tmp_path / "c", "--json")[1])
    campaign = lb.read_campaign(tmp_path / "c")
    forces_N = FORCES_N
    if name == "book":
        forces_N = FORCES_N[1:]
    wanted = circles(*forces_N)
    direction = None
    if name in ("book", "instrument"):
        direction = "CCW"
    assert {key: getattr(campaign, key) for key in NAMED} == NAMED
    assert campaign.resolution_um == 0.1
    assert {test.temperature_C for test in campaign.tests} == {21.4}
    assert sorted(campaign.forces_N) == [test.force_N for test in wanted]
    for understood in campaign.tests:
        (test,) = [test for test in wanted if test.force_N == understood.force_N]
        angle_deg = np.mod(np.round(understood.angle_deg, 2), 360.0)
        around_deg, first = np.unique(angle_deg, return_index=True)
        reading_um = np.asarray(understood.reading_um)[first]
        np.testing.assert_allclose(around_deg, test.angle_deg, atol=0.02)
        np.testing.assert_allclose(reading_um, test.reading_um, atol=1e-9)
        assert understood.direction == direction
        assert understood.arc_deg == 360.0
    subjects = [assumption["what"] for assumption in record["assumptions"]]
    assert subjects.count("list of tests") == {"book": 1}.get(name, 0)
    assert subjects.count("left out") == {"windows": 1}.get(name, 0)
    unsaid = {"topology", "mount", "radius_mm"}
    if name == "instrument":
        unsaid.remove("radius_mm")
    assert set(record["unsaid"]) == unsaid


WRITTEN = {
    "averaged.nc",
    "campaign",
    "comparison.json",
    "dcc.xml",
    "design.json",
    "model.toml",
    "posterior.nc",
    "report.html",
    "report.json",
    "report.pdf",
    "summary.json",
    "tables",
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_one_command_from_files_to_two_sheets(name: str, tmp_path: Path, invoke: Invoke) -> None:
    patterns = CASES[name](tmp_path)
    asked = ("--language", "de", "--annex", "--force-N", 350)
    code, stdout, stderr = invoke(
        "report", *patterns, "--out", tmp_path / "out", *asked, "--tolerance", "C_XXX=70 nm/N"
    )
    assert (code, stderr) == (0, "")
    assert {path.name for path in (tmp_path / "out").iterdir()} == WRITTEN
    assert "Gemittelt über Nachgiebigkeit konstant und linear" in stdout
    assert "JCGM 106), bei 350 N" in stdout
    assert "Nachgiebigkeiten bei 350 N" in stdout
    averaged = lb.assess_conformity(lb.load(tmp_path / "out" / "averaged.nc"), force_N=350.0)[
        "C_XXX"
    ].as_dict()
    for file in ("summary.json", "report.json"):
        assert json.loads((tmp_path / "out" / file).read_text(encoding="utf-8"))["conformity"] == {
            "C_XXX": averaged
        }
    first, _ = sheets(tmp_path / "out" / "report.pdf")
    for word in ("DMG Mori DMU 50", "1139-4711", "Jörg Müller", "QC20-W Nr. K12345"):
        assert word in first
    code, _, stderr = invoke("report", tmp_path / "out", "--force", *asked, "--quiet")
    assert (code, stderr) == (0, "")
    assert sheets(tmp_path / "out" / "report.pdf")[0] == first, (
        "the page of the result is the page of the files"
    )


def sheets(path: Path) -> list[str]:
    with pypdfium2.PdfDocument(path) as file:
        return [" ".join(page.get_textpage().get_text_range().split()) for page in file]


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """What compares, averages and designs has tests of its own, as figures have; fits of few draws
    and no second process, which would have nothing to do."""
    undrawn(monkeypatch)
    few_draws = partial(lb.sample, rule=lb.inference.StoppingRule(ess=400.0))
    monkeypatch.setattr(lb, "sample", few_draws)
    monkeypatch.setattr(file_reports, "second_process", nullcontext)
    monkeypatch.setattr(file_reports, "begin_comparison", failing(lb.InputError(NOT_COMPARED)))
    for name in ("average", "design"):
        monkeypatch.setattr(lb, name, failing(lb.InputError(NOT_COMPARED)))


def failing(error: BaseException) -> Callable[..., None]:
    """Return a function that raises an error whatever it is called with."""

    def fail(*_: object, **__: object) -> None:
        raise error

    return fail


def answering(monkeypatch: pytest.MonkeyPatch, *answers: str) -> list[str]:
    """A user at a terminal; what is asked."""
    asked: list[str] = []
    remaining_answers = iter(answers)

    def prompt(question: str, **_: object) -> str:
        asked.append(question)
        return next(remaining_answers)

    monkeypatch.setattr(report_making, "can_ask", lambda: True)
    monkeypatch.setattr("typer.prompt", prompt)
    return asked


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_at_most_three_questions(
    files: list[Path], tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of what neither files nor options say; a wrong answer is asked again; the folder stands
    beside the first file."""
    asked = answering(monkeypatch, "9", "4", "perhaps", "n", "G20")
    code, stdout, stderr = invoke("report", *files)
    assert code == 0, stderr
    assert len(asked) == 5
    assert "must be 1 to 7" in stderr
    assert "bed type (wXFYZSt)" in stderr
    out = tmp_path / f"{files[0].stem}_report"
    campaign = lb.read_campaign(out / "campaign")
    assert campaign.topology == "wXFYZSt"
    assert campaign.mount.compensated is False
    assert campaign.instrument.work.grade == "G20"
    assert not {"topology:", "mount:"} & {line[2:].split(" ")[0] for line in stdout.splitlines()}
    assert lb.load(out)["provenance"] is not None
    assert invoke("report", *files)[0] == 2, "an earlier report is not replaced"
    asked = answering(monkeypatch)
    options = (
        "--topology",
        "wFXYZSt",
        "--raw",
        "--balls",
        "G10",
        "--serial-number",
        "7",
        "--force",
    )
    assert invoke("report", *files, *options)[0] == 0
    assert (asked, lb.read_campaign(out / "campaign").serial_number) == ([], "7")
    asked = answering(monkeypatch)
    assert (
        invoke("report", out / "campaign", "--out", tmp_path / "again", "--operator", "Ann")[0] == 0
    )
    assert (asked, lb.read_campaign(tmp_path / "again" / "campaign").operator) == ([], "Ann")


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_a_german_report_speaks_german_at_the_terminal(
    files: list[Path], tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All but names, options, and the reason why this test compares and designs nothing."""
    monkeypatch.setenv("COLUMNS", "5000")  # so that no name of a file is broken
    out = tmp_path / "out"
    options = ("--language", "de", "--yes", "--tolerance", "C_XXX=60 nm/N")
    code, stdout, stderr = invoke("report", *files, "--out", out, *options)
    assert code == 0, stderr
    text = stdout.replace(NOT_COMPARED, "").replace(str(tmp_path), "")
    for path in files:
        text = text.replace(path.name, "")
    english = r"\b(the|of|and|with|is|are|by|which|not|from|to|for|each|nothing|verdict|value)\b"
    assert not [line for line in text.splitlines() if re.search(english, line)]
    for words in ("Angenommen (mit der genannten Option zu ändern)", "Urteil", "Geschrieben:"):
        assert words in text


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_without_a_terminal_what_is_assumed_is_said(
    files: list[Path], tmp_path: Path, invoke: Invoke
) -> None:
    code, stdout, _ = invoke("report", *files, "--out", tmp_path / "out")
    assert code == 0
    for words in (
        "topology: wCAFYXZSt",
        "mount: readings compensated",
        "balls: as the model assumes",
    ):
        assert words in stdout
    assert {path.name for path in (tmp_path / "out").iterdir()} == WRITTEN - {
        "averaged.nc",
        "comparison.json",
        "design.json",
    }


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_an_interruption_or_a_full_disk_leaves_nothing(
    files: list[Path], tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of what was written so far."""
    for error, raised in (
        (KeyboardInterrupt(), KeyboardInterrupt),
        (OSError(28, "No space left on device"), SystemExit),
    ):
        monkeypatch.setattr(lb, "write_report", failing(error))
        with pytest.raises(raised):
            app(["report", *map(str, files)])
        assert sorted(tmp_path.iterdir()) == sorted(files)


def test_machines_on_the_list_can_be_measured(root: Path) -> None:
    """And stand in the docs."""
    page = (root / "docs" / "how-to" / "machines.md").read_text(encoding="utf-8")
    for machine in questions.MACHINES:
        assert f"| {machine.name} | `{machine.topology}` | {machine.looks} |" in page
        assert lb.Machine(machine.topology, ("XY", "YZ", "ZX")).plane
    assert len({machine.topology for machine in questions.MACHINES}) == len(questions.MACHINES)


# ---- patterns


def test_patterns_are_expanded_in_natural_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As cmd.exe and PowerShell hand them on, backslashes and a closing quote included; brackets
    mean themselves."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my runs").mkdir()
    names = ["10 N.csv", "2 N.csv", "2 N [b].csv", "36 N.csv", "~$2 N.csv", ".2 N.csv", "note.txt"]
    for name in names:
        (tmp_path / "my runs" / name).write_text("x")
    tables = ["2 N [b].csv", "2 N.csv", "10 N.csv", "36 N.csv"]
    for pattern in (
        "my runs/*.csv",
        "my runs\\*.csv",
        'my runs\\*.csv"',
        str(tmp_path / "my runs" / "*.csv"),
        "my*/*.csv",
    ):
        assert [path.name for path in matching([pattern])] == tables, pattern
    assert [path.name for path in matching(["my runs\\?? N.csv"])] == ["10 N.csv", "36 N.csv"]
    assert [path.name for path in matching(["my runs/2 N [b]*", "my runs/*.csv"])] == tables
    assert matching([r"my runs\36 N.csv"]) == [Path("my runs/36 N.csv")]
    for pattern, listing in (
        ("my runs/*.xlsx", "my runs holds '2 N [b].csv', '2 N.csv'"),
        ("yours\\*.csv", "there is no folder yours"),
    ):
        refuses(f"must match a file, got none: {re.escape(listing)}", matching, [pattern])
