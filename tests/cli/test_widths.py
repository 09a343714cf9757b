"""What commands print on terminals of 80, 100 and 120 columns: whole numbers with their units,
whole heads, no line too long."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fleets import drawn_rows
from typer.testing import CliRunner

import ldbb_bayes as lb
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.cli import app, output
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


@pytest.fixture(scope="module")
def printed(
    folder: Path, planned: Path, tmp_path_factory: pytest.TempPathFactory, compared: Comparison
) -> dict[str, list[Any]]:
    """Of every command what it has shown; of what takes longer the results themselves."""
    parts: dict[str, list[Any]] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("widths"))
        Path("c").symlink_to(folder)
        Path("p").symlink_to(planned)
        rows = drawn_rows(6, np.random.default_rng(1), step_at=4)
        machines = rows.assign(machine_id=[f"M{k}" for k in range(6)])
        for arguments in (*COMMANDS, ("demo",), ("trend", "b"), ("population", "b")):
            if arguments == ("demo",):  # in seconds
                posterior = lb.load("f")
                comparison = lb.read_comparison(Path("cmp"))
                given = {
                    "embedded_campaign": Path("c"),
                    "sample": posterior,
                    "compare": comparison,
                    "save_figures": None,
                }
                for name, own in given.items():
                    patch.setattr(lb, name, lambda *_, own=own, **__: own)
            patch.setattr(
                "ldbb_bayes.cli.fleets.read_batch",
                lambda *_, k=arguments[0]: rows if k == "trend" else machines,
            )
            shown = parts.setdefault(str(arguments[0]), [])
            patch.setattr(output, "show", lambda *own, shown=shown: shown.extend(own))
            ended = CliRunner().invoke(app, [*map(str, arguments)])
            assert ended.exit_code in (0, 1), ended.stderr
            shown += ended.stdout.splitlines()
    return parts | {"compare of two": [*parts_of(compared)]}


UNIT = r"(%|°|[nµm]m/|[nµm]?m\b|N\b|[nµm]?rad\b|per kN|bar\b)"
BROKEN = (
    rf"\d\n\s*{UNIT}",
    r"\s[=±→]\n",
    r"\n\s*[=±→]\s",
    r"\([^()\n]{0,12}\n[^()\n]{0,12}\)",
    r"\w…(?!\w)",
)


@pytest.mark.parametrize("width", [80, 100, 120])
def test_nothing_is_cut(printed: dict[str, list[Any]], width: int) -> None:
    """Every cell and every word of a head stands there whole; the rest is said of lines by what
    must not end or begin one."""
    assert len(printed) >= 15
    for command, parts in printed.items():
        assert parts, command
        for part in parts:
            text = lines_of([part], width)
            where = f"{command} at {width}:\n{text}"
            assert all(len(line) <= width for line in text.splitlines()), where
            flat = " ".join(text.split())
            for pattern in BROKEN[: 4 if not isinstance(part, Table) else 5]:
                assert not re.search(pattern, text), (pattern, where)
            if isinstance(part, Table):
                filled = [
                    head
                    for head, *own in zip(part.heads, *part.shown(), strict=True)
                    if set(own) - {"", "–"}
                ]
                assert {word for head in filled for word in re.findall(r"\w+", head)} <= set(
                    re.findall(r"\w+", flat)
                ), where
                for row in part.shown():
                    assert all(" ".join(cell.split()) in flat for cell in row if cell != "–"), where


@pytest.mark.parametrize("width", [80, 120])
def test_names_of_options_are_whole(width: int) -> None:
    for command in app.registered_commands:
        name = command.name or str(command.callback.__name__).rstrip("_")  # type: ignore[union-attr]
        shown = CliRunner().invoke(app, [name, "--help"], env={"COLUMNS": str(width)}).stdout
        assert "--help" in shown
        assert not re.search(r"[a-z]…", shown), shown
