"""The model as TOML, both ways, and its digest."""

from __future__ import annotations

import hashlib
import os
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, Literal

import tomli_w
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.files import bytes_of
from ldbb_bayes.model.hybrid import NUISANCES, HybridModel
from ldbb_bayes.model.prior import Prior
from ldbb_bayes.toml import LARGEST_TOML_BYTES, parse_toml

__all__ = ["model_from_toml", "model_sha256", "model_to_toml", "read_model"]

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
    content["terms"] = {type(term).__name__: asdict(term) for term in model.nuisances}  # type: ignore[call-overload]
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
    known = {term.__name__: term for term in NUISANCES.values()}
    check_known("term", spec.terms, known)
    terms = []
    for name, term in known.items():
        if name in spec.terms:
            check_known(f"{name} key", spec.terms[name], [field.name for field in fields(term)])  # type: ignore[arg-type]
            terms.append(term(**_checked_term(name, spec.terms[name])))
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


def _checked_term(name: str, given: dict[str, Any]) -> dict[str, Any]:
    for key, value in given.items():
        wanted = str if (name, key) in (("SetupShift", "moves"), ("Drift", "over")) else float
        if not isinstance(value, wanted):
            raise InputError(f"{name} {key} must be a {wanted.__name__}, got {value!r}. Correct it.")
    return given


def _checked_prior(given: dict[str, Any]) -> dict[str, Any]:
    for name, value in given.items():
        wanted = {"truncated": bool, "flat": bool, **dict.fromkeys(_TABLES, dict)}.get(name, float)
        if not isinstance(value, wanted):
            raise InputError(f"prior {name} must be a {wanted.__name__}, got {value!r}. Correct it.")
    return given
