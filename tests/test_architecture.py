"""The house: imports flow one way, heavy libraries stay in their rooms, public names are documented."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import ldbb_bayes

PACKAGE = Path(ldbb_bayes.__file__).parent
ROOMS = ["campaign", "machine", "tables", "model", "inference", "analysis", "report", "fleet", "cli"]
ALLOWED = {
    "machine": {"machine"},
    "campaign": {"campaign", "machine"},
    "tables": {"tables", "campaign", "machine"},
    **{room: set(ROOMS[: ROOMS.index(room) + 1]) - {"tables"} for room in ROOMS[3:-1]},
    "cli": set(ROOMS),
}
LEAVES = {
    "ldbb_bayes.errors",
    "ldbb_bayes.files",
    "ldbb_bayes.toml",
    "ldbb_bayes.notebook",
    "ldbb_bayes.threads",
    "ldbb_bayes.units",
    "ldbb_bayes.work",
    "ldbb_bayes",
}
MODULES = sorted(PACKAGE.rglob("*.py"))


def imported(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module)
    return found


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_no_arrow_points_back(path: Path) -> None:
    room = path.relative_to(PACKAGE).parts[0]
    if room not in ALLOWED:
        return
    for name in imported(path):
        if name.startswith("ldbb_bayes") and name not in LEAVES:
            assert name.split(".")[1] in ALLOWED[room], f"{path.name} imports {name}"


def test_a_back_arrow_would_be_seen(tmp_path: Path) -> None:
    file = tmp_path / "x.py"
    file.write_text("from ldbb_bayes.inference.sample import sample\n")
    assert imported(file) == {"ldbb_bayes.inference.sample"}
    assert "inference" not in ALLOWED["model"]


@pytest.mark.parametrize(("library", "homes"), [("emcee", {"inference/ensemble.py"}), ("arviz", {"inference/posterior.py"})])
def test_heavy_libraries_have_one_importer(library: str, homes: set[str]) -> None:
    importers = {str(p.relative_to(PACKAGE)) for p in MODULES if any(name.startswith(library) for name in imported(p))}
    assert importers == homes


def test_no_pyplot_and_no_assert() -> None:
    for path in MODULES:
        assert not any("pyplot" in name for name in imported(path)), path
        assert not any(isinstance(node, ast.Assert) for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))), path


def test_importing_the_package_is_light() -> None:
    code = "import sys, ldbb_bayes; print([m for m in ('emcee', 'arviz_base', 'arviz_stats', 'matplotlib') if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]"


def test_public_names_resolve_and_are_documented() -> None:
    assert set(ldbb_bayes.__all__) == {"__version__", *ldbb_bayes._HOMES}
    for name in ldbb_bayes.__all__:
        assert getattr(ldbb_bayes, name) is not None
        assert name == "__version__" or getattr(ldbb_bayes, name).__doc__
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = ldbb_bayes.nonsense


@pytest.mark.parametrize("path", [p for p in MODULES if p.name != "__init__.py"], ids=lambda p: str(p.relative_to(PACKAGE)))
def test_modules_have_docstrings_and_say_what_is_public(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert ast.get_docstring(tree)
    public = [n for n in tree.body if isinstance(n, ast.FunctionDef | ast.ClassDef) and not n.name.startswith("_")]
    for node in public:
        assert ast.get_docstring(node), f"{path.name}: {node.name}"
