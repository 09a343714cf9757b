"""Campaigns, plans and files that commands are run on."""

from __future__ import annotations

from pathlib import Path

import awkward
import pytest
from campaigns import plan, simulated, written

import ldbb_bayes as lb


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of four circles."""
    return lb.write_campaign(simulated(plan()), tmp_path_factory.mktemp("campaign") / "c")


@pytest.fixture(scope="session")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan of three circles."""
    return lb.write_campaign(
        plan((40,) * 3, forces_N=(36.0, 400.0, 742.0)), tmp_path_factory.mktemp("plan") / "p"
    )


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    """Tables with semicolons and decimal commas, one a test."""
    return written(tmp_path, awkward.CASES["02_semicolon"].files)
