"""The package answers what it answered when the goldens were written (tests/goldens/make.py writes
them, and says how to)."""

from __future__ import annotations

from pathlib import Path

import make
import pytest

pytest.importorskip("pyarrow")
pytest.importorskip("openpyxl")
NAMES = [
    pytest.param(name, marks=pytest.mark.slow if golden.slow else ())
    for name, golden in make.GOLDENS.items()
]


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> make.Work:
    return make.Work(tmp_path_factory.mktemp("goldens").resolve())


@pytest.mark.golden
@pytest.mark.parametrize("name", NAMES)
def test_golden(name: str, work: make.Work) -> None:
    changes = make.check(name, make.make(name, work))
    listing = [f"{change.path}: {change.old!r} -> {change.new!r}" for change in changes[:20]]
    assert not changes, "\n".join(listing)


def test_goldens_are_in_this_file_alone() -> None:
    """`make test-golden` and `make test-slow` look for them here."""
    mark = "pytest.mark." + "golden"
    tests = Path(__file__).parent
    files = [path.name for path in tests.rglob("*.py") if mark in path.read_text(encoding="utf-8")]
    assert files == ["test_goldens.py"]


def test_every_file_has_a_golden() -> None:
    assert {path.stem for path in make.HERE.glob("*.json")} == set(make.GOLDENS)


@pytest.mark.parametrize(
    ("old", "new", "differ"),
    [
        ({"mean": 1.0}, {"mean": 1.0 + 1e-12}, False),
        ({"mean": 1.0}, {"mean": 1.0 + 1e-8}, True),
        ({"mean": 0.0, "sd": 1.0}, {"mean": 1e-12, "sd": 1.0}, False),
        ({"mean": 0.0, "other": 1.0}, {"mean": 1e-12, "other": 1.0}, True),
        ([0.0, 1.0], [1e-12, 1.0], False),
        ("C is 1.20 ± 0.01", "C is 1.21 ± 0.01", False),
        ("C is 1.20 ± 0.01", "C is 1.23 ± 0.01", True),
        ("C is large", "C is small", True),
        ([1, 2], [1, 2, 3], True),
        ({"a": None}, {"b": None}, True),
        (float("nan"), float("nan"), False),
    ],
)
def test_what_counts_as_a_difference(old: object, new: object, differ: bool) -> None:
    assert bool(make.differences(old, new)) == differ
    assert not make.differences(old, old)


@pytest.mark.parametrize(
    ("new", "differ"), [(0.0, False), (9e-10, False), (1.1e-9, True), (-0.1, True)]
)
def test_less_than_a_billionth_of_a_micrometre_is_rounding(new: float, differ: bool) -> None:
    for old in ({"change_um": 1e-14}, {"sigma_um": [1e-14, 0.0]}):
        answer = {"change_um": new} if "change_um" in old else {"sigma_um": [new, 0.0]}
        assert bool(make.differences(old, answer, rules=make.RULES)) == differ
    assert make.differences({"change_mm": 1e-14}, {"change_mm": 9e-10}, rules=make.RULES)
