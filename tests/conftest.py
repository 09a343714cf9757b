"""Shared fixtures. One seed for all tests, with an override: LDBB_TEST_SEED=7 make test."""

from __future__ import annotations

import fcntl
import json
import os
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from ldbb_bayes.analysis.comparison import Comparison, compare
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.folder import read_campaign
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.table import json_text

ROOT = Path(__file__).resolve().parents[1]

settings.register_profile("house", deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("house")


@pytest.fixture(scope="session")
def root() -> Path:
    return ROOT


@pytest.fixture(scope="session")
def recovered() -> Campaign:
    return read_campaign(ROOT / "data" / "recovered_experiment")


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(int(os.environ.get("LDBB_TEST_SEED", "1")))


@pytest.fixture(scope="session")
def compared(recovered: Campaign, tmp_path_factory: pytest.TempPathFactory) -> Comparison:
    """Constant and linear compliance on the recovered experiment, once for all workers of a run."""
    base = tmp_path_factory.getbasetemp()
    kept = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "comparison.json"
    with (kept.with_suffix(".lock")).open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not kept.exists():
            linear = HybridModel.default(1)
            found = compare({"constant": linear.with_degree(0), "linear": linear}, recovered)
            kept.write_text(json_text(found.as_dict()), encoding="utf-8")
    return Comparison.from_dict(json.loads(kept.read_text(encoding="utf-8")))
