"""The model as TOML, both ways, and its digest; truths to simulate from, read from TOML."""

from __future__ import annotations

import datetime as dt
import hashlib
import os
from dataclasses import Field as DataField
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import tomli_w
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ldbb_bayes.campaign.campaign import Campaign, CircularTest, MountCompensation
from ldbb_bayes.campaign.folder import LARGEST_PLAN, iso
from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.files import LARGEST_TOML_BYTES, bytes_of, parse_toml, read_toml
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.prior import Prior
from ldbb_bayes.model.terms import Term

__all__ = ["Truths", "is_truths", "model_from_toml", "model_sha256", "model_to_toml", "read_model", "read_truths"]

SCHEMA = 1
# Tables of [prior], written only where they hold something: the digest of a model does not change when a table is added here.
_TABLES = ("overrides", "means")


class _SpecFile(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
    schema_: Literal[1] = Field(alias="schema")
    preset: Literal["default", "paper"] = "default"
    degree: Literal[0, 1, 2] | None = None
    reference_force_N: float | None = None
    fixed: list[str] = Field(default_factory=list)
    prior: dict[str, float | bool | dict[str, float]] = Field(default_factory=dict)
    terms: dict[str, dict[str, float | str]] | None = None


def model_to_toml(model: HybridModel) -> str:
    """The whole model, every prior spelled out."""
    prior: dict[str, Any] = {field.name: getattr(model.prior, field.name) for field in fields(Prior) if field.name not in _TABLES}
    prior |= {name: dict(getattr(model.prior, name)) for name in _TABLES if getattr(model.prior, name)}
    content: dict[str, Any] = {"schema": SCHEMA, "preset": model.preset, "degree": model.degree}
    if model.reference_force_N is not None:
        content["reference_force_N"] = model.reference_force_N
    if model.fixed:
        content["fixed"] = list(model.fixed)
    content["prior"] = prior
    content["terms"] = {type(term).__name__: asdict(cast("Any", term)) for term in model.nuisances}
    return tomli_w.dumps(content)


def model_from_toml(text: str, *, degree: int | None = None) -> HybridModel:
    """A model from TOML. What the text leaves out is the preset's; ``[terms]``, where given, lists the nuisances that are on.

    Parameters
    ----------
    degree : int, optional
        Used when the text names none (default then: the preset's).

    Raises
    ------
    InputError
        For invalid TOML, unknown keys, or values that cannot be.
    """
    content = parse_toml(text, "model")
    check_known("model key", content, ("schema", "preset", "degree", "reference_force_N", "fixed", "prior", "terms"))
    try:
        spec = _SpecFile.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise InputError(f"model {place!r} must be valid, got {first['input']!r}: {first['msg']}. Correct it.") from None
    model = HybridModel.paper() if spec.preset == "paper" else HybridModel.default()
    chosen = spec.degree if spec.degree is not None else degree
    degree = model.degree if chosen is None else chosen
    model = replace(model, degree=degree, reference_force_N=spec.reference_force_N, fixed=tuple(spec.fixed))
    check_known("prior key", spec.prior, [field.name for field in fields(Prior)])
    prior = replace(model.prior, **_checked_prior(spec.prior))
    if spec.terms is None:
        return replace(model, prior=prior)
    check_known("term", spec.terms, Term.kinds)
    terms = [kind(**_checked_term(kind, spec.terms[name])) for name, kind in Term.kinds.items() if name in spec.terms]
    return replace(model, prior=prior, nuisances=tuple(terms))


def read_model(path: str | os.PathLike[str], *, degree: int | None = None) -> HybridModel:
    """A model from a TOML file; see `model_from_toml`."""
    raw = bytes_of(Path(path), LARGEST_TOML_BYTES, what="a readable TOML file")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} must be UTF-8, got: {error}. Save it as UTF-8.") from None
    try:
        return model_from_toml(text, degree=degree)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def model_sha256(model: HybridModel) -> str:
    """SHA-256 of the model's TOML."""
    return hashlib.sha256(model_to_toml(model).encode()).hexdigest()


def _checked_term(kind: type[Term], given: dict[str, Any]) -> dict[str, Any]:
    known: dict[str, DataField[Any]] = {field.name: field for field in fields(cast("Any", kind))}
    check_known(f"{kind.__name__} key", given, known)
    for key, value in given.items():
        wanted = str if isinstance(known[key].default, str) else float
        if not isinstance(value, wanted):
            raise InputError(f"{kind.__name__} {key} must be a {wanted.__name__}, got {value!r}. Correct it.")
    return given


def _checked_prior(given: dict[str, Any]) -> dict[str, Any]:
    for name, value in given.items():
        wanted = {"truncated": bool, "flat": bool, **dict.fromkeys(_TABLES, dict)}.get(name, float)
        if not isinstance(value, wanted):
            raise InputError(f"prior {name} must be a {wanted.__name__}, got {value!r}. Correct it.")
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
