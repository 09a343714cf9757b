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
PARAMETER_NUMBERS = ("mean", "sd", "median", "ci_low", "ci_high")


def write_campaigns(folder: Path, number: int) -> list[str]:
    """Write so many campaigns of three circles, 60 readings each."""
    paths = []
    for k in range(number):
        campaign = simulated(plan((60,) * 3, forces_N=FORCES_N), seed=k + 1)
        paths.append(str(lb.write_campaign(campaign, folder / f"c{k}")))
    return paths


def made_row(settings: Settings, job: Job, *, parameters: int = 3) -> dict[str, Any]:
    """Return a row like those of `fit_row`, with random numbers; every fifth failed."""
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
    numbers = {}
    for name in names:
        values = rng.standard_normal(5).tolist()
        numbers[name] = {"unit": "mm/N", **dict(zip(PARAMETER_NUMBERS, values, strict=True))}
    state = "usable"
    misfits = []
    if job.number % 7 == 0:
        state = "doubtful"
        misfits = ["form"]
    log_prob_truncation = -0.5
    if job.number % 3 == 0:
        log_prob_truncation = float("nan")
    return row | {
        "status": "done",
        "converged": True,
        "state": state,
        "verdict": "fine",
        "misfits": misfits,
        "warnings": [],
        "terms": ["Compliance"],
        "log_prob_truncation": log_prob_truncation,
        "parameters": numbers,
        "gaussian_names": names,
        "gaussian_mean": rng.standard_normal(len(names)).tolist(),
    }


def dataset_bytes(out: Path) -> bytes:
    return (out / "campaigns.parquet").read_bytes()
