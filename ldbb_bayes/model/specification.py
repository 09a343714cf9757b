"""TOML files of models, and TOML files of true values ("truths") for simulations.

A model (`HybridModel`) is written to and read from TOML text. The SHA-256 digest of this text
identifies the model. The nuisance terms of a model are effects that are modelled but not of
interest.
"""

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

from ldbb_bayes.campaign.campaign import Campaign, CircularTest, MountCompensation, Order
from ldbb_bayes.campaign.circular_test import FEWEST_READINGS
from ldbb_bayes.campaign.field_types import Date
from ldbb_bayes.campaign.folder import LARGEST_PLAN
from ldbb_bayes.errors import InputError, check_known, placed, require
from ldbb_bayes.files import parse_toml, read_toml, validated
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.prior import Prior
from ldbb_bayes.model.terms import Term
from ldbb_bayes.results import read_result
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

# Version of the format of model files; every file gives it under the key ``schema``.
SCHEMA = 1
# Names of the sub-tables of the table [prior] in a model file. Empty sub-tables are not written.
# The SHA-256 digests of existing models therefore do not change when a name is added here.
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
    """Return a model as TOML text, with its terms, priors and all other settings.

    Terms are nuisance terms: effects that are modelled but not of interest. A reference force that
    is None, an empty list of fixed parameters and empty tables of the prior are left out.
    """
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
    """Return the model that the TOML text of a model file describes.

    Settings that the text omits have the values of the preset that the text names: ``default``,
    ``first`` or ``paper``. If the text names no preset, the preset is ``default``. If the text
    omits the degree of the compliance as a polynomial in force, the degree is 0 for the preset
    ``paper`` and 1 for the other presets. If the text has a table ``[terms]``, the model has
    exactly the nuisance terms that this table lists. Raise an `InputError` if the text contains a
    mistake.
    """
    return _model_of(parse_toml(text, "model"), "model", None)


def read_model(path: str | os.PathLike[str], *, degree: int | None = None) -> HybridModel:
    r"""Return the model that a TOML file describes.

    Settings that the file omits have the values of the preset that the file names: ``default``,
    ``first`` or ``paper``. If the file names no preset, the preset is ``default``. If the file has
    a table ``[terms]``, the model has exactly the nuisance terms (effects modelled but not of
    interest) that this table lists.

    Parameters
    ----------
    path : str or os.PathLike
        Path of the file.
    degree : int, optional
        Degree of the compliance as a polynomial in force, 0, 1 or 2, for a file that gives no
        degree. By default, the degree of such a file is 0 for the preset ``paper`` and 1 for the
        other presets.

    Returns
    -------
    HybridModel
        The model.

    Raises
    ------
    InputError
        If the file is not TOML, has unknown keys, or has values that are out of range or in a wrong
        unit. The message names the file and the place of the mistake.

    Examples
    --------
    >>> from pathlib import Path
    >>> size = Path("model.toml").write_text("schema = 1\n[terms.BarLength]\nsd_um = 1.0\n")
    >>> lb.read_model("model.toml", degree=0).nuisances
    (BarLength(sd_um=1),)
    """
    return _model_of(read_toml(Path(path)), str(path), degree)


def model_sha256(model: HybridModel) -> str:
    """Return the SHA-256 digest of a model's TOML text; the digest identifies the model.

    The function `model_to_toml` returns this text.
    """
    return hashlib.sha256(model_to_toml(model).encode()).hexdigest()


def _model_of(content: dict[str, Any], place: str, usual_degree: int | None) -> HybridModel:
    """Return the model that the content of a model file describes.

    The compliance is a polynomial in force. ``usual_degree`` is its degree if the file gives none.
    If it is None too, the degree is 0 for the preset ``paper`` and 1 for the other presets.
    ``place`` names the file in error messages. Raise an `InputError` for unknown keys, or for
    values that have a wrong type or are not permitted.
    """
    spec = validated(_SpecFile, content, place)
    with placed(place):
        model = replace(
            HybridModel.from_preset(spec.preset, _degree_of(spec, usual_degree)),
            reference_force_N=spec.reference_force_N,
            fixed=tuple(spec.fixed),
        )
        prior_types: dict[str, type] = {}
        for setting in fields(Prior):
            is_table = setting.name in _TABLES
            prior_types[setting.name] = dict if is_table else type(setting.default)
        prior = replace(model.prior, **_checked_settings("prior", prior_types, spec.prior))
        if spec.terms is None:
            return replace(model, prior=prior)
        return replace(model, prior=prior, nuisances=_terms_of(spec.terms, model))


def _degree_of(spec: _SpecFile, usual_degree: int | None) -> int:
    """Return the degree that a model file states for the compliance as a polynomial in force.

    ``spec`` is the content of the file. If the file gives no degree, return ``usual_degree``. If
    ``usual_degree`` is None too, return 0 for the preset ``paper`` and 1 for the other presets.
    """
    if spec.degree is not None:
        return spec.degree
    if usual_degree is not None:
        return usual_degree
    return 0 if spec.preset == "paper" else 1


def _terms_of(tables: Mapping[str, dict[str, float | str]], model: HybridModel) -> tuple[Term, ...]:
    """Return the nuisance terms that are listed in a model file, in the tables under [terms].

    ``tables`` holds the settings of every term; the keys are class names. Settings that a table
    omits have the values that the term has in ``model``. If ``model`` lacks the term, the omitted
    settings are the defaults of the class. The terms are in the order of ``Term.kinds``. Raise an
    `InputError` for an unknown term or setting, or a value of the wrong type.
    """
    check_known(
        "term",
        tables,
        Term.kinds,
        " A term of your own: commands do not have it; define or import its class in Python,"
        " and read the file there.",
    )
    usual = {type(term): term for term in model.nuisances}
    terms = []
    for name, kind in Term.kinds.items():
        if name in tables:
            types: dict[str, type] = {}
            for setting in fields(cast("Any", kind)):
                types[setting.name] = str if isinstance(setting.default, str) else float
            term: Any = usual.get(kind) or kind()
            terms.append(replace(term, **_checked_settings(name, types, tables[name])))
    return tuple(terms)


def _checked_settings(
    table: str, types: Mapping[str, type], values: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the settings of one table of a model file, in the units given in their names.

    A number may be written as a string with a unit. It is then converted to the unit at the end of
    the setting's name: "3000 nm" for ``sd_um`` becomes 3. All other values are only checked; no
    value is converted to another type. ``table`` is the name of the table for error messages.
    ``types`` holds the types of all settings that the table may have, by name; ``values`` holds the
    settings as written in the file. Raise an `InputError` for an unknown name or a value of the
    wrong type.
    """
    check_known(f"{table} key", values, types)
    settings = {}
    for key, value in values.items():
        settings[key] = value
        if types[key] is float:
            settings[key] = setting_to_inside(key, value, f"{table} {key}")
    for key, value in settings.items():
        require(
            isinstance(value, types[key]),
            f"{table} {key} must be a {types[key].__name__}, got {value!r}. Correct it.",
        )
    return settings


class _TruthsFile(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
    schema_: Literal[1] = Field(alias="schema")
    forces_N: list[float] | None = Field(default=None, max_length=1000)
    readings: int = Field(default=720, ge=FEWEST_READINGS, le=1_000_000)
    topology: str = "wCAFYXZSt"
    plane: Literal["XY", "YZ", "ZX"] = "XY"
    radius_mm: float = 150.0
    resolution_um: float = 0.24
    order: Order | None = None
    drift: bool = True
    compensated: bool = True
    exact: bool = False
    machine_id: str | None = None
    date: Date | None = None
    parameters: dict[str, float] | None = None
    hyper_um: dict[str, float] = Field(default_factory=dict)


class _TruthRecord(BaseModel):
    """Part of the file truth.json of a simulation that a further simulation can use."""

    model_config = ConfigDict(extra="ignore", strict=True)
    schema_: Literal[1] = Field(alias="schema")
    parameters: dict[str, float]
    hyper_um: dict[str, float]


@dataclass(frozen=True)
class Truths:
    """Plan and true values for a simulation, as read from a file."""

    #: plan (campaign without readings) that is to be simulated; None if the file of true values
    #: contains no forces, so that the plan must come from another file
    plan: Campaign | None
    #: true compliances, their changes with force, and geometric errors for a simulation, by name,
    #: in internal units (mm, N, rad); None if they are drawn at random from the prior
    parameters: dict[str, float] | None
    #: true hyper-parameters (such as the standard deviation of the noise) by name, with lengths in
    #: µm; hyper-parameters that are not named are drawn at random from their priors
    hyper_um: dict[str, float]
    #: whether the effect of geometric errors on the simulated readings is computed with the exact
    #: kinematic equations instead of linearised equations
    exact: bool


def is_truths(path: Path) -> bool:
    """Return whether a file is a TOML file of true values for a simulation.

    ``path`` is the path of the file. A valid TOML file (suffix ``.toml``) counts as a file of true
    values if it lists no tests, unlike the file of a campaign.
    """
    if path.suffix.lower() != ".toml" or not path.is_file():
        return False
    with suppress(InputError):
        return "test" not in read_toml(path)
    return False


def read_truths(path: Path) -> Truths:
    """Read a file with the plan of a simulation and the true values of the machine.

    ``path`` is the path of a TOML file, or of the file truth.json that an earlier simulation wrote.
    Of truth.json, parameters and hyper-parameters are used. Noise factors of its circles, and the
    effects and changes with force that it states, are not used. For a mistake in the file, raise an
    `InputError` that names the file and the place of the mistake.
    """
    if path.suffix.lower() == ".json":
        return read_result(path, "truth", "simulate", _truths_of_record)
    file = validated(_TruthsFile, read_toml(path), str(path))
    with placed(path):
        plan = None if file.forces_N is None else _plan_of_truths(file, path.stem)
        return Truths(
            plan,
            file.parameters,
            file.hyper_um,
            file.exact,
        )


def _truths_of_record(record: Mapping[str, Any]) -> Truths:
    """Return the true values in the content of a file truth.json, without its plan.

    Noise factors of circles are left out, because they belong to the circles of the simulation that
    wrote the file. Raise a ValueError if the content is not that of such a file.
    """
    content = _TruthRecord.model_validate(record)
    hyper_um = {
        name: value for name, value in content.hyper_um.items() if not name.startswith("lambda_")
    }
    return Truths(None, content.parameters, hyper_um, False)


def _plan_of_truths(file: _TruthsFile, name: str) -> Campaign:
    """Return the plan to simulate, with one full circle at each force that a file lists.

    ``file`` is the content of the file, which also holds the true values for the simulation.
    ``name`` is the name of the plan. Each circle has ``file.readings`` readings at equally spaced
    angles. Raise an `InputError` if the plan would have too many readings.
    """
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
        topology=file.topology,
        plane=file.plane,
        radius_mm=file.radius_mm,
        resolution_um=file.resolution_um,
        order=file.order,
        drift=file.drift,
        machine_id=file.machine_id,
        date=file.date,
    )
