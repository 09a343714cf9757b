"""The house: imports flow one way, heavy libraries stay in their rooms, public
names are documented."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections import Counter
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import ldbb_bayes
from ldbb_bayes.campaign.circular_test import FEWEST_READINGS

PACKAGE = Path(ldbb_bayes.__file__).parent
TESTS = Path(__file__).parent
ROOMS = ["campaign", "machine", "model", "inference", "analysis", "report", "fleet", "cli", "app"]
ALLOWED = {
    "machine": {"machine"},
    "campaign": {"campaign", "machine"},
    "reading": {"campaign", "machine", "reading"},
    **{room: set(ROOMS[: ROOMS.index(room) + 1]) for room in ROOMS[2:]},
}
for user in ("report", "fleet", "cli", "app"):
    ALLOWED[user] |= {"reading"}
ALLOWED["cli"] |= {"app"}  # one command starts the page in the browser
LEAVES = {"deprecation", "errors", "files", "parallel", "results", "tables", "units"}
FOR_FITS = {"arviz_stats", "emcee", "fpdf", "matplotlib", "scipy.stats", "xarray"}
CAMPAIGN = TESTS.parent / "data" / "recovered_experiment"
FORBIDDEN = {
    "telling",
    "begun",
    "known",
    "found",
    "told",
    "hold",
    "places",
    "stamps",
    "own",
    "said",
}


@cache
def trees() -> dict[Path, ast.Module]:
    return {
        path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(PACKAGE.rglob("*.py"))
    }


@cache
def names() -> dict[Path, str]:
    """Of modules, by their files."""
    dotted = {
        path: ".".join(("ldbb_bayes", *path.relative_to(PACKAGE).with_suffix("").parts))
        for path in trees()
    }
    return {path: name.removesuffix(".__init__") for path, name in dotted.items()}


@cache
def imported(tree: ast.AST) -> set[str]:
    """Modules, wherever the import stands: at the top, for type checkers, in a function."""
    modules: set[str] = set()
    of_package = set(names().values())
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, "relative import"
            full_names = {f"{node.module}.{alias.name}" for alias in node.names}
            modules |= (full_names & of_package) or {node.module}
    return modules


def circle(arrows: dict[str, set[str]]) -> list[str]:
    try:
        TopologicalSorter(arrows).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_no_arrow_points_back() -> None:
    for path, tree in trees().items():
        room = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        allowed = (
            LEAVES | ALLOWED.get(room, set())
            if room in ALLOWED or room in LEAVES
            else {*ROOMS, *LEAVES}
        )
        for name in imported(tree):
            words = name.split(".")
            assert words[0] != "ldbb_bayes" or len(words) == 1 or words[1] in allowed, (
                f"{path.name} imports {name}"
            )


def test_no_circle() -> None:
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"a"}})
    arrows = {
        names()[path]: {name for name in imported(tree) if name.startswith("ldbb_bayes.")}
        for path, tree in trees().items()
    }
    assert circle(arrows) == []


def test_names_of_modules_and_classes_are_unique() -> None:
    """No module of a private name, and no module or class of one name twice."""
    modules = Counter(path.stem for path in trees() if path.name != "__init__.py")
    assert {name for name, count in modules.items() if count > 1} == set()
    assert not {word for name in modules for word in name.split("_")} & FORBIDDEN
    classes = Counter(
        node.name
        for tree in trees().values()
        for node in tree.body
        if isinstance(node, ast.ClassDef)
    )
    assert {name for name, count in classes.items() if count > 1} == set()


def test_the_fewest_readings_of_a_circle_are_said_once() -> None:
    """By circular_test; fourteen modules that read files had a constant of their own."""
    modules = set()
    for path, tree in trees().items():
        if path.parent.name not in ("campaign", "reading"):
            continue
        for node in tree.body:
            if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant):
                is_fewest = any("FEWEST" in ast.unparse(target) for target in node.targets)
                if is_fewest and node.value.value == FEWEST_READINGS:
                    modules.add(path.name)
    assert modules == {"circular_test.py"}


def importers(library: str) -> set[str]:
    """Modules that import a library or a package whose name begins like it."""
    return {
        path.relative_to(PACKAGE).as_posix()
        for path, tree in trees().items()
        if any(name.startswith(library) for name in imported(tree))
    }


def test_only_one_module_imports_emcee() -> None:
    assert importers("emcee") == {"inference/mcmc.py"}


def test_only_inference_imports_arviz() -> None:
    modules = importers("arviz")
    assert modules
    assert {Path(module).parent.name for module in modules} == {"inference"}


def test_no_pyplot_and_no_assert() -> None:
    for path, tree in trees().items():
        assert not any("pyplot" in name for name in imported(tree)), path
        assert not any(isinstance(node, ast.Assert) for node in ast.walk(tree)), path


def test_the_package_itself_loads_no_library() -> None:
    """Its names are imported when they are first asked for."""
    code = "import sys, ldbb_bayes; print('numpy' in sys.modules)"
    command = [sys.executable, "-c", code]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert output.strip() == "False"


def test_the_operators_sheet_loads_no_library_for_figures() -> None:
    """It draws nothing: translations of texts and of figures are modules of their own."""
    code = "import sys, ldbb_bayes.report.operator_sheet; print('matplotlib' in sys.modules)"
    command = [sys.executable, "-c", code]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert output.strip() == "False"


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [["--help"], ["check", str(CAMPAIGN)], ["machine", "wCAFYXZSt"]],
    ids=["help", "check", "machine"],
)
def test_commands_that_fit_nothing_load_no_library_for_fits(command: list[str]) -> None:
    run = [sys.executable, "-X", "importtime", "-m", "ldbb_bayes", *command]
    log = subprocess.run(run, capture_output=True, text=True, check=True).stderr
    loaded = {line.rpartition("|")[2].strip() for line in log.splitlines()}
    assert "numpy" in loaded
    assert loaded & FOR_FITS == set()


def test_public_names_resolve_and_are_documented() -> None:
    for name in ldbb_bayes.__all__:
        assert getattr(ldbb_bayes, name) is not None
        assert name == "__version__" or getattr(ldbb_bayes, name).__doc__
    with pytest.raises(AttributeError, match="nonsense"):
        _ = ldbb_bayes.nonsense


def test_modules_and_public_names_have_docstrings() -> None:
    for path, tree in trees().items():
        assert ast.get_docstring(tree), path
        for node in tree.body:
            if not isinstance(node, ast.FunctionDef | ast.ClassDef):
                continue
            # Overloads only declare types; the function that follows them has the docstring.
            decorators = {ast.unparse(decorator) for decorator in node.decorator_list}
            if not node.name.startswith("_") and "overload" not in decorators:
                assert ast.get_docstring(node), f"{path.name}: {node.name}"
