"""The documentation: it builds without a warning, its links lead somewhere, and every public name
is in the reference."""

from __future__ import annotations

import dataclasses
import importlib.util
import inspect
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from pkgutil import resolve_name

import pytest
from public_names import public_names
from pydantic import TypeAdapter
from test_readme import pages

import ldbb_bayes as lb
from ldbb_bayes.report.fit_record import full_result

# What the start of the reference of Python says once for all.
COMMON = {
    "model",
    "campaign",
    "posterior",
    "machine",
    "test",
    "path",
    "prob",
    "seed",
    "progress",
}
EXTERNAL = re.compile(
    r"https?://[\w.-]+\.[a-z]{2,}(:\d+)?(/[\w./?=&%+~#@!$,;:()*'-]*)?"
    r"|mailto:[^@\s]+@[\w.-]+\.[a-z]{2,}"
)


def anchors(page: str) -> set[str]:
    heads = re.findall(
        r"^#+ +(.*?) *#*$", re.sub(r"^```.*?^```", "", page, flags=re.S | re.M), re.M
    )
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


def faults(page: Path, root: Path) -> list[str]:
    """Links and pictures that lead nowhere."""
    text = re.sub(r"^```.*?^```|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.S | re.M)
    broken = []
    for link in re.findall(r"\]\(<?([^)>\s]+)>?(?: \"[^\"]*\")?\)|(?:src|href)=\"([^\"]+)\"", text):
        place, _, anchor = "".join(link).partition("#")
        target = (page.parent / place).resolve() if place else page
        if ":" in place:
            broken += (
                [] if EXTERNAL.fullmatch("".join(link)) else [f"{page.name}: {place} is no address"]
            )
        elif not target.exists() or not target.is_relative_to(root):
            broken.append(f"{page.name}: {place} does not exist")
        elif anchor and target.suffix == ".md" and anchor not in anchors(target.read_text("utf-8")):
            broken.append(f"{page.name}: {place} has no #{anchor}")
    return broken


def test_links_lead_somewhere(root: Path, tmp_path: Path) -> None:
    all_pages = [*pages(root), *root.glob("*.md"), *(root / "studies").rglob("*.md")]
    assert [fault for page in all_pages for fault in faults(page, root)] == []
    bad = tmp_path / "bad.md"
    bad.write_text(
        "# A head\n[a](#a-head) [b](#b) [c](missing.md) ![d](d.png) [e](http:/nowhere)"
        " [f](https://a.org/b)"
    )
    assert len(faults(bad, tmp_path)) == 4


def test_every_public_name_is_in_the_reference_with_an_example(root: Path) -> None:
    text = "".join(
        page.read_text(encoding="utf-8")
        for page in (root / "docs" / "reference" / "api").glob("*.md")
    )
    listed_names = " ".join(re.findall(r"<!-- api: (.*?) -->", text)).split()
    run = "".join(re.findall(r"```python\n(.*?)```", text, re.S))
    names = {name for name in public_names() if not name.startswith("figures.")}
    assert names <= set(listed_names)
    assert {name for name in names if not re.search(rf"\blb\.{re.escape(name)}\b", run)} == set()
    assert len(set(listed_names)) == len(listed_names)


@pytest.mark.parametrize("name", sorted(public_names()))
def test_arguments_and_fields_are_documented(name: str) -> None:
    """Each by its name in the docstring, by ``#:`` beside it, or for all functions at once; numbers
    of arrays have shapes."""
    documented = resolve_name(f"ldbb_bayes.{name}")
    text = inspect.getdoc(documented) or ""
    if dataclasses.is_dataclass(documented):
        sources = [
            inspect.getsource(kind)
            for kind in documented.__mro__
            if kind.__module__.startswith("ldbb_bayes")
        ]
        text += " " + " ".join(
            "".join(names_with_comment)
            for names_with_comment in re.findall(
                r"^    (\w+): .*#: |#: .*\n    (\w+): ", "\n".join(sources), re.M
            )
        )
        missing = {
            field.name
            for field in dataclasses.fields(documented)
            if not re.search(rf"\b{field.name}\b", text)
        }
    elif inspect.isfunction(documented):
        missing = {
            p for p in inspect.signature(documented).parameters if not re.search(rf"\b{p}\b", text)
        } - COMMON
        if inspect.signature(documented).return_annotation in ("Array", "pd.DataFrame"):
            assert re.search(r"shape|[Rr]ow|column", text)
    else:
        return
    assert missing == set()


@pytest.mark.slow
def test_json_has_the_keys_of_the_reference(root: Path, recovered: lb.Campaign) -> None:
    fit = (
        (root / "docs/reference/json.md")
        .read_text(encoding="utf-8")
        .split("```text")[1]
        .split("```")[0]
    )
    posterior = lb.sample(lb.HybridModel.default(degree=0), recovered, sampler="independent")
    written = json.dumps(full_result(posterior, 0.95))
    assert {key for key in re.findall(r'"(\w+)"', fit) if f'"{key}"' not in written} == set()
    identified = lb.identify(lb.HybridModel.default(degree=0), recovered)
    schema = TypeAdapter(lb.analysis.Identifiability).json_schema(mode="serialization")
    assert set(schema["properties"]) == set(identified.as_dict())
    one = set(schema["$defs"]["ParameterIdentifiability"]["properties"])
    assert all(one == set(entry) for entry in identified.as_dict()["parameters"].values())


@pytest.fixture
def site(root: Path, tmp_path: Path) -> Path:
    """The documentation: what `make docs` has just built, where LDBB_TEST_DOCS names its folder;
    else built here, in the same way."""
    built = os.environ.get("LDBB_TEST_DOCS")
    if built is not None:
        return Path(built)
    if importlib.util.find_spec("myst_parser") is None:
        pytest.skip("The extra docs is not installed")
    build = [sys.executable, "-m", "sphinx", "-W", "-n", "-q", str(root / "docs"), str(tmp_path)]
    sphinx = subprocess.run(build, capture_output=True, text=True, check=False, timeout=180)
    assert (sphinx.returncode, sphinx.stderr) == (0, "")
    return tmp_path


@pytest.mark.slow
def test_the_documentation_loads_nothing_from_elsewhere(site: Path) -> None:
    """It builds without a warning, without a network, in under three minutes; a page without its
    place in the order is a warning."""
    paths = list(site.rglob("*.html"))
    assert len(paths) > 10
    for path in paths:
        page = path.read_text(encoding="utf-8")
        loaded = re.findall(r"<(?:script|link|img)[^>]+(?:src|href)=\"([^\"]+)\"", page)
        assert [address for address in loaded if "://" in address] == [], path.name
