"""What commands print on terminals of 80, 100 and 120 columns: whole numbers with their units,
whole heads, no line too long."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fleets import drawn_rows
from reports import undrawn
from typer.testing import CliRunner

import ldbb_bayes as lb
from ldbb_bayes.analysis import outlying_tests
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.cli import app, output, questions
from ldbb_bayes.inference import hyper_posterior
from ldbb_bayes.report.text import parts_of
from ldbb_bayes.results import Table, lines_of

FEW = ("--preset", "first", "--without", "discrepancy,hysteresis,setup-shift")
COMMANDS: tuple[tuple[object, ...], ...] = (
    ("check", "c"),
    ("machine", "wCAFYXZSt", "--plane", "XY,YZ,ZX", "--frame", "Y=0,-200,350"),
    ("simulate", "p", "--out", "s"),
    ("import", "s/f036.csv", "s/f400.csv", "--forces-N", "36,400", "--out", "i"),
    ("fit", "c", *FEW, "--sampler", "independent", "--ess", 400, "--out", "f"),
    ("summarize", "f"),
    ("identify", "c"),
    ("compare", "c", *FEW, "--degree", 1, "--out", "cmp"),
    (
        "design",
        "c",
        *FEW,
        "--tests",
        3,
        "--forces",
        "36,742",
        "--clockings",
        "0,45",
        "--criterion",
        "d",
        "--out",
        "d",
    ),
    ("validate", "p", *FEW, "--degree", 0, "--replicates", 10, "--draws", 19, "--workers", 1),
    (
        "batch",
        "c",
        "nothing",
        *FEW,
        "--degree",
        0,
        "--ess",
        400,
        "--workers",
        1,
        "--no-compare",
        "--out",
        "b",
    ),
    ("report", "f", "--comparison", "cmp", "--design", "d"),
)


def always(answer: object) -> Callable[..., object]:
    """Return a function that gives the same answer to everything."""

    def give(*_: object, **__: object) -> object:
        return answer

    return give


def collector(collected: list[Any]) -> Callable[..., None]:
    """Return a function that adds its arguments to a list."""

    def collect(*arguments: object) -> None:
        collected.extend(arguments)

    return collect


@pytest.fixture(scope="module")
def printed(
    folder: Path, planned: Path, tmp_path_factory: pytest.TempPathFactory, compared: Comparison
) -> dict[str, list[Any]]:
    """Of every command what it has shown; of what takes longer the results themselves. Figures,
    which are not printed, stay undrawn; tests are judged by fewer replicates, and hyper-parameters
    averaged over fewer nodes, than numbers would need."""
    parts_of_commands: dict[str, list[Any]] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("widths"))
        undrawn(patch)
        patch.setattr(lb.figures, "save_figure", always(None))
        patch.setattr(outlying_tests, "_REPLICATES", 4000)
        patch.setattr(hyper_posterior, "_COARSE_TOLERANCE", 1.0)
        Path("c").symlink_to(folder)
        Path("p").symlink_to(planned)
        rows = drawn_rows(6, np.random.default_rng(1), step_at=4)
        machines = rows.assign(machine_id=[f"M{k}" for k in range(6)])
        for arguments in (*COMMANDS, ("demo",), ("trend", "b"), ("population", "b")):
            if arguments == ("demo",):  # in seconds
                posterior = lb.load("f")
                comparison = lb.analysis.read_comparison(Path("cmp"))
                replacements = {
                    "embedded_campaign": Path("c"),
                    "sample": posterior,
                    "compare": comparison,
                }
                for name, replacement in replacements.items():
                    patch.setattr(lb, name, always(replacement))
                patch.setattr(lb.figures, "save_figures", always(None))
            batch = machines
            if arguments[0] == "trend":
                batch = rows
            patch.setattr("ldbb_bayes.cli.fleets.read_fleet", always(batch))
            printed_parts = parts_of_commands.setdefault(str(arguments[0]), [])
            patch.setattr(output, "show", collector(printed_parts))
            ended = CliRunner().invoke(app, [*map(str, arguments)])
            assert ended.exit_code in (0, 1), ended.stderr
            printed_parts += ended.stdout.splitlines()
    return parts_of_commands | {"compare of two": [*parts_of(compared)]}


UNIT = r"(%|°|[nµm]m/|[nµm]?m\b|N\b|[nµm]?rad\b|per kN|bar\b)"
BROKEN = (
    rf"\d\n\s*{UNIT}",
    r"\s[=±→]\n",
    r"\n\s*[=±→]\s",
    r"\([^()\n]{0,12}\n[^()\n]{0,12}\)",
)
# A word of a table that is cut off.
CUT = r"\w…(?!\w)"


@pytest.mark.slow
@pytest.mark.parametrize("width", [80, 100, 120])
def test_nothing_is_cut(printed: dict[str, list[Any]], width: int) -> None:
    """Every cell and every word of a head stands there whole; the rest is said of lines by what
    must not end or begin one."""
    assert len(printed) >= 15
    for command, blocks in printed.items():
        assert blocks, command
        for block in blocks:
            text = lines_of([block], width)
            where = f"{command} at {width}:\n{text}"
            assert all(len(line) <= width for line in text.splitlines()), where
            flat = " ".join(text.split())
            for pattern in BROKEN:
                assert not re.search(pattern, text), (pattern, where)
            if isinstance(block, Table):
                assert not re.search(CUT, text), (CUT, where)
                assert set(words_of_filled_heads(block)) <= set(re.findall(r"\w+", flat)), where
                for row in block.shown():
                    assert all(" ".join(cell.split()) in flat for cell in row if cell != "–"), where


def words_of_filled_heads(table: Table) -> list[str]:
    """Words of the heads of columns that hold anything."""
    words = []
    for head, *cells in zip(table.heads, *table.shown(), strict=True):
        if set(cells) - {"", "–"}:
            words += re.findall(r"\w+", head)
    return words


@pytest.mark.slow
@pytest.mark.parametrize("width", [80, 120])
def test_names_of_options_are_whole(width: int) -> None:
    for command in app.registered_commands:
        name = command.name
        if not name:
            assert command.callback is not None
            name = command.callback.__name__.rstrip("_")
        help_text = CliRunner().invoke(app, [name, "--help"], env={"COLUMNS": str(width)}).stdout
        assert "--help" in help_text
        assert not re.search(r"[a-z]…", help_text), help_text


def test_a_paragraph_of_the_help_is_broken_at_the_width_of_the_terminal() -> None:
    help_text = CliRunner().invoke(app, ["design", "--help"], env={"COLUMNS": "80"}).stdout
    assert "readings). The chosen tests are written into --out DIR" in help_text


def test_what_was_written_is_broken_between_paths(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = [f"/data/machine_{k}/report/report.html" for k in range(4)]
    monkeypatch.setenv("COLUMNS", "80")
    output.show_written(f"Written: {', '.join(paths)}")
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert all(any(path in line for line in lines) for path in paths)


def test_what_was_written_is_one_line_in_a_file(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    line = f"Written: {', '.join(['/data/machine/report/report.html'] * 9)}"
    output.show_written(line)
    assert capsys.readouterr().out == f"{line}\n"


@pytest.mark.parametrize("width", [60, 80, 120])
def test_the_list_of_machines_fits_the_terminal(width: int) -> None:
    lines = questions._lines_of_machines(width)
    assert max(len(line) for line in lines) <= width
    assert "wCAFYXZSt" in " ".join(lines)
    heads = [line for line in lines if re.match(r"  \d  \S", line)]
    assert len(heads) == len(questions.MACHINES)
