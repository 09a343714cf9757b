"""A release is one command and one version everywhere; earlier names are answered for a while."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

import ldbb_bayes as lb
from ldbb_bayes.deprecation import NEW_NAMES

STATED = ("ldbb_bayes/__init__.py", "CITATION.cff", "CHANGELOG.md")


def stated(tree: Path) -> str:
    return "\n".join((tree / name).read_text(encoding="utf-8") for name in STATED)


def test_package_citation_and_changelog_have_one_version(root: Path) -> None:
    """Before its release a version is a development version, so that no sheet states the last one;
    what one cites is the last release."""
    versions = re.findall(r"^## (\S+) \((.*?)\)$", stated(root), re.M)
    newest, day = versions[0]
    released = [version for version, when in versions if when != "unreleased"]
    expected = f"{newest}.dev0" if day == "unreleased" else newest
    assert lb.__version__ == expected
    assert re.findall(r"^version: (.*)$", stated(root), re.M) == released[:1]


def newest_section(root: Path) -> str:
    """What CHANGELOG.md says of the newest version."""
    return (root / "CHANGELOG.md").read_text(encoding="utf-8").split("\n## ")[1]


def test_the_newest_version_can_be_read_in_ten_minutes(root: Path) -> None:
    lines = newest_section(root).splitlines()
    assert len(lines) <= 250
    assert [line for line in lines if len(line) > 300] == []


def test_links_of_the_newest_version_lead_to_files_and_headings(root: Path) -> None:
    section = newest_section(root)
    links = re.findall(r"\]\(([^)#]*)(?:#([^)]*))?\)", section)
    assert len(links) > 5
    for place, heading in links:
        target = root / place if place else root / "CHANGELOG.md"
        assert target.exists(), place
        if heading:
            titles = re.findall(r"^#+ (.*)$", target.read_text(encoding="utf-8"), re.M)
            anchors = [re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles]
            assert heading in anchors, heading


def test_the_changelog_says_where_every_name_of_0_2_has_gone(root: Path) -> None:
    changelog = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    section = changelog.split("\n## 0.3.0")[1].split("\n## ")[0]
    stated: dict[str, str] = {}
    for old, new in re.findall(r"^\| (`lb\..*?) \| (`lb\..*?) \|$", section, re.M):
        olds, news = (re.findall(r"`(?:lb\.)?([\w.]+)`", side) for side in (old, new))
        if old.startswith("`lb.` with"):
            olds = olds[1:]
            news = [news[0] + name for name in olds]
        stated |= dict(zip(olds, news, strict=True))
    assert stated == NEW_NAMES


def run(tree: Path, *command: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*map(str, command)], cwd=tree, capture_output=True, text=True, check=False
    )


@pytest.fixture
def tree(root: Path, tmp_path: Path) -> Path:
    """What a release changes, in a repository of its own, where building does nothing, or fails."""
    for name in (".ci/release", *STATED):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(root / name, tmp_path / name)
    (tmp_path / "CHANGELOG.md").write_text(
        "# Changelog\n\n## 7.8.9 (unreleased)\n\n- New.\n", encoding="utf-8"
    )
    (tmp_path / ".ci" / "package").write_text("#!/bin/sh\ntest ! -e .git/broken\n")
    (tmp_path / ".ci" / "package").chmod(0o755)
    for words in ("init", "config user.name A", "config user.email a@b.c", "add .", "commit -mAll"):
        assert run(tmp_path, "git", *words.split()).returncode == 0
    return tmp_path


def test_a_release_is_one_command(tree: Path) -> None:
    assert run(tree, ".ci/release", "7.8.9").returncode == 0
    assert run(tree, "git", "tag").stdout == "v7.8.9\n"
    assert run(tree, "git", "status", "--porcelain").stdout == ""
    dated = (r"version: 7.8.9\ndate-released: \d{4}-\d\d-\d\d", r"## 7.8.9 \(\d{4}-\d\d-\d\d\)")
    for line in ('__version__ = "7.8.9"', *dated):
        assert re.search(f"^{line}$", stated(tree), re.M)
    assert "VERSION must be new, got v7.8.9" in run(tree, ".ci/release", "7.8.9").stderr


@pytest.mark.parametrize(
    ("version", "code", "words"),
    [("7.8", 2, "must be X.Y.Z, got '7.8'"), ("7.9.0", 2, "got no such line"), ("7.8.9", 1, "")],
)
def test_a_release_that_fails_changes_nothing(
    tree: Path, version: str, code: int, words: str
) -> None:
    (tree / ".git" / "broken").touch()
    ended = run(tree, ".ci/release", version)
    assert ended.returncode == code
    assert words in ended.stderr
    assert run(tree, "git", "tag").stdout == ""
    assert run(tree, "git", "status", "--porcelain").stdout == ""


@pytest.mark.parametrize(
    "call",
    [
        lambda: lb.sample(None, None, sampler="quadrature"),  # type: ignore[arg-type]
        lambda: lb.calibrate(None, None, sampler="quadrature"),  # type: ignore[arg-type]
        lambda: lb.fleet.run_batch([], "fitted", sampler="quadrature", ess=-1.0),
    ],
    ids=["sample", "calibrate", "run_batch"],
)
def test_names_that_were_to_go_with_this_version_are_gone(call: Any) -> None:
    with pytest.raises(lb.InputError, match=r"sampler must be .*got 'quadrature'"):
        call()
    assert not hasattr(lb.HybridModel, "including")
