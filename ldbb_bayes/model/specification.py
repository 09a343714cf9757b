"""The model as TOML, both ways, and its digest; truths to simulate from, read from TOML."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import tomli_w
from pydantic import BaseModel, ConfigDict, Field

from ldbb_bayes.campaign.campaign import Campaign, CircularTest, MountCompensation
from ldbb_bayes.campaign.field_types import Date
from ldbb_bayes.campaign.folder import LARGEST_PLAN
from ldbb_bayes.errors import InputError, check_known, placed, require
from ldbb_bayes.files import parse_toml, read_toml, validated
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.prior import Prior
from ldbb_bayes.model.terms import Term
from ldbb_bayes.units import setting_to_inside

__all__ = [
    "Truths",
    "is_truths",
    "model_from_toml",
    "model_sha256",
    "model_to_toml",
    "read_model",
    "read_truths",
]

SCHEMA = 1
# Tables of [prior], written only where they hold something: the digest of a model does not change
# when a table is added here.
_TABLES = ("overrides", "means")


class _SpecFile(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
    schema_: Literal[1] = Field(alias="schema")
    preset: Literal["default", "first", "paper"] = "default"
    degree: Literal[0, 1, 2] | None = None
    reference_force_N: float | None = None
    fixed: list[str] = Field(default_factory=list)
    prior: dict[str, float | bool | str | dict[str, float | str]] = Field(default_factory=dict)
    terms: dict[str, dict[str, float | str]] | None = None


def model_to_toml(model: HybridModel) -> str:
    """The whole model, every prior spelled out."""
    prior: dict[str, Any] = {
        field.name: getattr(model.prior, field.name)
        for field in fields(Prior)
        if field.name not in _TABLES
    }
    prior |= {
        name: dict(getattr(model.prior, name)) for name in _TABLES if getattr(model.prior, name)
    }
    content: dict[str, Any] = {"schema": SCHEMA, "preset": model.preset, "degree": model.degree}
    if model.reference_force_N is not None:
        content["reference_force_N"] = model.reference_force_N
    if model.fixed:
        content["fixed"] = list(model.fixed)
    content["prior"] = prior
    content["terms"] = {type(term).__name__: asdict(cast("Any", term)) for term in model.nuisances}
    return tomli_w.dumps(content)


def model_from_toml(text: str) -> HybridModel:
    """A model from TOML. What the text leaves out is the preset's; ``[terms]``, where given, lists
    the nuisances that are on."""
    return _model_of(parse_toml(text, "model"), "model", None)


def read_model(path: str | os.PathLike[str], *, degree: int | None = None) -> HybridModel:
    """A model from a TOML file, see `model_from_toml`; of this ``degree`` where the file names
    none."""
    return _model_of(read_toml(Path(path)), str(path), degree)


def model_sha256(model: HybridModel) -> str:
    """SHA-256 of the model's TOML."""
    return hashlib.sha256(model_to_toml(model).encode()).hexdigest()


def _model_of(content: dict[str, Any], place: str, degree: int | None) -> HybridModel:
    spec = validated(_SpecFile, content, place)
    with placed(place):
        chosen = next(
            k for k in (spec.degree, degree, 0 if spec.preset == "paper" else 1) if k is not None
        )
        model = replace(
            HybridModel.from_preset(spec.preset, chosen),
            reference_force_N=spec.reference_force_N,
            fixed=tuple(spec.fixed),
        )
        kinds = {
            field.name: dict if field.name in _TABLES else type(field.default)
            for field in fields(Prior)
        }
        prior = replace(model.prior, **_checked("prior", kinds, spec.prior))
        if spec.terms is None:
            return replace(model, prior=prior)
        own = (
            " A term of your own: commands do not have it; define or import its class in Python,"
            " and read the file there."
        )
        check_known("term", spec.terms, Term.kinds, own)
        terms = []
        usual = {type(term): term for term in model.nuisances}
        for name, kind in Term.kinds.items():
            if name in spec.terms:
                kinds = {
                    field.name: str if isinstance(field.default, str) else float
                    for field in fields(cast("Any", kind))
                }
                term: Any = usual.get(kind) or kind()
                terms.append(replace(term, **_checked(name, kinds, spec.terms[name])))
        return replace(model, prior=prior, nuisances=tuple(terms))


def _checked(what: str, kinds: Mapping[str, type], given: dict[str, Any]) -> dict[str, Any]:
    check_known(f"{what} key", given, kinds)
    given = {
        key: setting_to_inside(key, own, f"{what} {key}") if kinds[key] is float else own
        for key, own in given.items()
    }
    for key, value in given.items():
        kind = kinds[key]
        require(
            isinstance(value, kind),
            f"{what} {key} must be a {kind.__name__}, got {value!r}. Correct it.",
        )
    return given


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
    date: Date | None = None
    parameters: dict[str, float] | None = None
    hyper_um: dict[str, float] = Field(default_factory=dict)


@dataclass(frozen=True)
class Truths:
    """What to simulate: a plan, None when the file names no forces (it must then come from
    elsewhere); true parameters in inside units, None to draw them from the prior; true
    hyper-parameters [µm], the rest drawn; geometry exactly or linear."""

    plan: Campaign | None
    parameters: dict[str, float] | None
    hyper_um: dict[str, float]
    exact: bool


def is_truths(path: Path) -> bool:
    """Whether a TOML file holds truths rather than a campaign."""
    if path.suffix.lower() != ".toml" or not path.is_file():
        return False
    with suppress(InputError):
        return "test" not in read_toml(path)
    return False


def read_truths(path: Path) -> Truths:
    """Read a TOML of truths; what is wrong is refused by the file's name and the place."""
    file = validated(_TruthsFile, read_toml(path), str(path))
    with placed(path):
        return Truths(
            None if file.forces_N is None else _plan(file, path.stem),
            file.parameters,
            file.hyper_um,
            file.exact,
        )


def _plan(file: _TruthsFile, name: str) -> Campaign:
    total = file.readings * len(file.forces_N or ())
    require(
        total <= LARGEST_PLAN,
        f"plan must have at most {LARGEST_PLAN} readings, got {total}. Take fewer forces or"
        " readings.",
    )
    angle = 360.0 * np.arange(file.readings) / file.readings
    return Campaign(
        tuple(CircularTest(force, angle) for force in file.forces_N or ()),
        mount=MountCompensation(compensated=file.compensated),
        name=name,
        **{
            key: getattr(file, key)
            for key in ("topology", "plane", "radius_mm", "resolution_um", "machine_id", "date")
        },
    )
