"""Small batches for tests: campaigns that take a second, and rows that take none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.fleet.campaign_row import Job, Settings

CONSTANT = lb.HybridModel.first(0).without("hysteresis", "discrepancy", "setup-shift")
LINEAR = CONSTANT.with_degree(1)
FORCES_N = (36.0, 400.0, 742.0)


def write_campaigns(folder: Path, number: int) -> list[str]:
    """That many campaigns of three circles, 60 readings each."""
    found = []
    for k in range(number):
        campaign = simulated(plan((60,) * 3, forces_N=FORCES_N), seed=k + 1)
        found.append(str(lb.write_campaign(campaign, folder / f"c{k}")))
    return found


def made_row(settings: Settings, job: Job, *, parameters: int = 3) -> dict[str, Any]:
    """A row as `fit_row` makes them, of nothing; every fifth failed."""
    rng = np.random.default_rng(job.number)
    row: dict[str, Any] = {
        "campaign": job.path,
        "degree": 0,
        "sampler": settings.sampler,
        "seed": settings.seed,
    }
    if job.number % 5 == 4:
        return row | {"status": "failed", "reason": "campaign must be good, got none. Mend it."}
    names = [f"C_{k}" for k in range(parameters + job.number % 2)]
    numbers = {
        name: dict(
            zip(
                ("mean", "sd", "median", "ci_low", "ci_high"),
                rng.standard_normal(5).tolist(),
                strict=True,
            )
        )
        for name in names
    }
    return row | {
        "status": "done",
        "converged": True,
        "state": "doubtful" if job.number % 7 == 0 else "usable",
        "verdict": "fine",
        "misfits": ["form"] if job.number % 7 == 0 else [],
        "warnings": [],
        "terms": ["Compliance"],
        "log_prob_truncation": float("nan") if job.number % 3 == 0 else -0.5,
        "parameters": {name: {"unit": "mm/N", **own} for name, own in numbers.items()},
        "gaussian_names": names,
        "gaussian_mean": rng.standard_normal(len(names)).tolist(),
    }


def dataset_bytes(out: Path) -> bytes:
    return (out / "campaigns.parquet").read_bytes()
