"""Small campaigns for tests, and the same campaigns for the oracle."""

from __future__ import annotations

import resource
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from oracle import Oracle, OracleTest

from ldbb_bayes.campaign.campaign import Campaign, CircularTest, MountCompensation
from ldbb_bayes.errors import InputError
from ldbb_bayes.model.hybrid import HybridModel

# A command in this process: exit code, stdout, stderr.
Invoke = Callable[..., tuple[int, str, str]]
TRUTH = {
    "C_XXX": 5.5e-5,
    "C_XYX": 5e-7,
    "C_YYY": 4.2e-5,
    "C_CXY": 1e-8,
    "C_CYY": -1e-8,
    "C_CCY": 4e-10,
    "E_XX1": -1e-4,
    "E_YX2": 4e-7,
    "E_XY2": -6e-7,
    "E_YY1": -8e-5,
    "E_C0YX": 5e-6,
    "E_Xt0": 4e-3,
    "E_Yt0": -1e-3,
}
HYPER_UM = {"sigma": 0.3, "delta": 0.5, "kappa": 0.3, "tau": 2.0}
FORCES_N = (36.0, 300.0, 520.0, 742.0)


def plan(
    readings: Sequence[int] = (40, 40, 40, 40),
    *,
    arc_deg: float = 360.0,
    work_deg: float = 0.0,
    tool_deg: float = 0.0,
    compensated: bool = True,
    forces_N: Sequence[float] = FORCES_N,
) -> Campaign:
    """A plan; clockings grow by ``work_deg`` and ``tool_deg`` from test to test."""
    tests = []
    for i, (force, n) in enumerate(zip(forces_N, readings, strict=True)):
        angle = np.linspace(-10.0, arc_deg - 10.0, n)
        if arc_deg == 360.0:
            angle = np.arange(n) * 360.0 / n
        tests.append(
            CircularTest(force, angle, work_ball_deg=work_deg * i, tool_ball_deg=tool_deg * i)
        )
    return Campaign(tuple(tests), mount=MountCompensation(compensated=compensated))


def in_setups(circles: Campaign, *setups: int | None) -> Campaign:
    """The circles in these set-ups; those of set-up 2 are in another plane."""
    tests = []
    for test, setup in zip(circles.tests, setups, strict=True):
        tests.append(replace(test, setup=setup, plane="YZ" if setup == 2 else "XY"))
    return replace(circles, topology="wXFYZSt", tests=tuple(tests))


def clocked(turns: tuple[tuple[float, float], ...]) -> Campaign:
    """Every force at every (work, tool) clocking, 40 angles each."""
    angle = np.arange(40) * 9.0
    tests = []
    for work_deg, tool_deg in turns:
        for force in (100.0, 300.0, 500.0):
            test = CircularTest(force, angle, work_ball_deg=work_deg, tool_ball_deg=tool_deg)
            tests.append(test)
    return Campaign(tuple(tests))


def simulated(planned: Campaign, *, seed: int = 1) -> Campaign:
    """Readings of a plan under plain truths."""
    model = HybridModel.first(0)
    return model.simulate(planned, seed=seed, parameters=TRUTH, hyper_um=HYPER_UM).campaign


def refuses(
    message: str, call: Callable[..., object], /, *arguments: object, **options: object
) -> None:
    """A call does not take what it is given, and says so in words that match."""
    with pytest.raises(InputError, match=message):
        call(*arguments, **options)


def cases(test: str, name: str) -> dict[str, Any]:
    """The tables of a TOML file beside a test."""
    return tomllib.loads(Path(test).with_name(name).read_text(encoding="utf-8"))


def written(folder: Path, files: Mapping[str, bytes]) -> list[Path]:
    """Files of these names and contents in a folder."""
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return [folder / name for name in files]


@contextmanager
def full_disk(largest_bytes: int) -> Iterator[None]:
    """Files may not grow beyond so much: as on a full disk, writing fails in the middle (Python
    ignores SIGXFSZ)."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def printed(name: str) -> pd.DataFrame:
    """A published table as it is printed."""
    tables = Path(__file__).parents[1] / "data" / "published_tables"
    return pd.read_csv(tables / f"{name}.csv", dtype=str)


def misses(row: pd.Series, estimate: Mapping[str, float]) -> list[float]:
    """Distance from every printed number in half-units of its last digit."""
    distances = []
    for name in row.index:
        if name.startswith("force_"):
            continue
        mantissa, _, exponent = row[name].upper().partition("E")
        half_unit = 0.5 * 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
        estimated = estimate[name.replace("(", "").replace(")", "")]
        distances.append(abs(estimated - float(row[name])) / half_unit)
    return distances


def tidy(campaign: Campaign, path: Path) -> Path:
    """Written as one table of all tests."""
    columns = [
        pd.DataFrame(
            {
                "test": t.name,
                "force_N": t.force_N,
                "angle_deg": t.angle_deg,
                "reading_um": t.reading_um,
            }
        )
        for t in campaign.tests
    ]
    pd.concat(columns).to_csv(path, index=False)
    return path


def oracle_of(campaign: Campaign, degree: int, **options: object) -> Oracle:
    """The dense oracle of the same campaign."""
    tests = oracle_tests(campaign)
    compensated = campaign.mount.compensated
    stated = {"compensated": compensated, "order": campaign.order, "drift": campaign.drift}
    return Oracle(tests, degree, **(stated | options))  # type: ignore[arg-type]


def oracle_tests(campaign: Campaign) -> list[OracleTest]:
    """The tests as the oracle has them."""
    return [
        OracleTest(
            float(test.force_N or 0.0),
            float(test.pressure_bar or 0.0),
            np.deg2rad(test.angle_deg),
            np.asarray(test.reading_um) * 1e-3,
            np.deg2rad(test.work_ball_deg),
            np.deg2rad(test.tool_ball_deg),
            float(test.radius_mm or 0.0),
            -1.0 if test.direction == "CCW" else 1.0,
            str(test.plane),
            test.time_s,
        )
        for test in campaign.tests
    ]
