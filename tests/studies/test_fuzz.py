"""Mutated files through every reader: read, or refused in one line; no traceback, no long wait, no mountain of memory."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.errors import LONGEST_MESSAGE

STUDY = Path(__file__).parents[2] / "studies" / "10_files"
sys.path.insert(0, str(STUDY))
import fuzz  # noqa: E402

NEED_NOTHING = ("import, text", "import, workbook", "layout", "tidy table", "model", "truths")


def without_memory(found: fuzz.Findings) -> list[str]:
    """What was wrong; the process holds the other tests' memory too."""
    return [line for line in found.wrong if not line.endswith(" MB")]


@pytest.mark.parametrize("name", NEED_NOTHING)
def test_a_few_hundred(name: str) -> None:
    found = fuzz.fuzz(name, 300, 11, {})
    assert without_memory(found) == []
    assert found.read + found.refused == 300


@pytest.mark.slow
def test_a_hundred_thousand() -> None:
    """No traceback, no input above 2 s, no reader above 500 MB, in other inputs than those of the study."""
    every = list(fuzz.fuzz_all(100_000, 2, list(fuzz.readers({}))))
    assert sum(found.inputs for found in every) >= 100_000
    for found in every:
        assert found.wrong == (), found.reader
        assert found.refused > 0
        assert found.slowest_s < 2.0
        assert found.largest_mb < 500.0


def test_a_reader_that_fails_would_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """A traceback, a long message and a long wait are found."""

    def fails(path: Path) -> None:
        if path.stat().st_size % 2:
            raise KeyError("angle")
        raise lb.InputError("x" * 5 * LONGEST_MESSAGE)

    reader = fuzz.Reader("x.csv", [b"12345678" * 4], lambda path: None, 1.0)
    monkeypatch.setattr(fuzz, "readers", lambda own: {"own": reader})
    assert without_memory(fuzz.fuzz("own", 5, 1, {})) == []
    calls = iter([lambda path: None, *[fails] * 40])
    monkeypatch.setattr(
        fuzz, "readers", lambda own: {"own": fuzz.Reader("x.csv", reader.seeds, lambda path: next(calls)(path), 1.0)}
    )
    monkeypatch.setattr(fuzz, "keep", lambda *_: None)
    found = fuzz.fuzz("own", 40, 1, {})
    assert 0 < len(without_memory(found)) < 40
    assert all("KeyError" in line for line in without_memory(found))


def test_mutations_are_of_every_kind(rng: np.random.Generator) -> None:
    """Longer, shorter, changed; of the same seed the same."""
    raw = b"angle_deg,reading_um\n" + b"5,1.25\n" * 72
    sizes = {len(fuzz.mutated(raw, rng)) - len(raw) for _ in range(200)}
    assert min(sizes) < 0 < max(sizes)
    assert fuzz.mutated(raw, np.random.default_rng(3)) == fuzz.mutated(raw, np.random.default_rng(3))
