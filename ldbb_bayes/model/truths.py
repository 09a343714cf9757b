"""Truths to simulate from, as TOML: the circles, the parameters and the noise."""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.campaign.folder import LARGEST_PLAN, iso
from ldbb_bayes.campaign.loading import MountCompensation
from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.toml import read_toml

__all__ = ["Truths", "is_truths", "read_truths"]


class _TruthsFile(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
    schema_: Literal[1] = Field(alias="schema")
    forces_N: list[float] | None = Field(default=None, max_length=1000)
    readings: int = Field(default=720, ge=9, le=1_000_000)
    topology: str = "wCAFYXZSt"
    plane: Literal["XY", "YZ", "ZX"] = "XY"
    radius_mm: float = 150.0
    resolution_um: float = 0.24
    compensated: bool = True
    exact: bool = False
    machine_id: str | None = None
    date: dt.datetime | dt.date | str | None = None
    parameters: dict[str, float] | None = None
    hyper_um: dict[str, float] = Field(default_factory=dict)


@dataclass(frozen=True)
class Truths:
    """What to simulate.

    Attributes
    ----------
    plan : Campaign or None
        None when the file names no forces; then a plan must come from elsewhere.
    parameters : dict or None
        True values in inside units; None draws them from the prior.
    hyper_um : dict
        True σ, δ, κ, τ [µm]; the rest is drawn from its prior.
    exact : bool
        Geometry through the exact forward model.
    """

    plan: Campaign | None
    parameters: dict[str, float] | None
    hyper_um: dict[str, float]
    exact: bool


def is_truths(path: Path) -> bool:
    """Whether a TOML file holds truths rather than a campaign."""
    if path.suffix.lower() != ".toml" or not path.is_file():
        return False
    try:
        content = read_toml(path)
    except InputError:
        return False
    return "test" not in content


def read_truths(path: Path) -> Truths:
    """Read a TOML of truths.

    Raises
    ------
    InputError
        Naming the file and the place.
    """
    content = read_toml(path)
    try:
        known = [field.alias or name for name, field in _TruthsFile.model_fields.items()]
        check_known("key", content, known)
        file = _TruthsFile.model_validate(content)
        plan = None if file.forces_N is None else _plan(file, path.stem)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise InputError(f"{path}: {place!r} must be valid, got {first['input']!r}: {first['msg']}. Correct it.") from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return Truths(plan, file.parameters, file.hyper_um, file.exact)


def _plan(file: _TruthsFile, name: str) -> Campaign:
    total = file.readings * len(file.forces_N or ())
    if total > LARGEST_PLAN:
        raise InputError(f"a plan must have at most {LARGEST_PLAN} readings, got {total}. Take fewer forces or readings.")
    angle = 360.0 * np.arange(file.readings) / file.readings
    return Campaign(
        tuple(CircularTest(force, angle) for force in file.forces_N or ()),
        topology=file.topology,
        plane=file.plane,
        radius_mm=file.radius_mm,
        resolution_um=file.resolution_um,
        mount=MountCompensation(compensated=file.compensated),
        name=name,
        machine_id=file.machine_id,
        date=iso(file.date),
    )
