"""The prior of one more machine from a population of machines: C ~ N(mean, sd²) at the population's reference force.

Compliances alone: their slopes and the geometric errors keep the model's own priors. A compliance of one campaign is that of
another only where both stand for the same joints' compliances.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from ldbb_bayes.campaign.campaign import Campaign, check_campaign
from ldbb_bayes.errors import InputError
from ldbb_bayes.files import bytes_of
from ldbb_bayes.machine.chain import ComplianceName
from ldbb_bayes.machine.identifiable import kept_compliances
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.prior import Prior, compliance_unit

__all__ = ["FILE", "Meaning", "PopulationPrior", "digest_of", "prior_from", "same_meaning", "stands_for"]

FILE = "population.json"
Meaning = Mapping[str, float]
_LARGEST_BYTES = 128 * 2**20
_FEW = 6
_COMPLIANCE = re.compile(r"C_([XYZABC])([XYZABC])([A-Z])")
_SAME_FORCE = 1e-9
_NAMED = 5
_DIGITS = 7
# Of the default prior's sd: a quarter of the changes that are looked for.
_NEGLIGIBLE = 0.05


def stands_for(campaign: Campaign) -> dict[str, dict[str, float]]:
    """Of every kept compliance of a campaign (or plan) the joints' compliances it is the sum of, with their weights."""
    kept = kept_compliances(campaign.machine(), *dict.fromkeys(test.circle for test in campaign.scope))
    sums = {}
    for name, members, weights, absorbed in zip(kept.names, kept.sets, kept.weights, kept.absorbed, strict=True):
        parts = dict(zip(members, weights, strict=True)) | {other.label: weight for other, weight in absorbed.items()}
        sums[name.label] = {other: float(f"{weight:.{_DIGITS}g}") for other, weight in parts.items()}
    return sums


def same_meaning(name: str, one: Meaning, other: Meaning) -> bool:
    """Whether two sums of compliances differ by less than 5 % of the default prior sd of the kept compliance ``name``, the
    joints' being as large as their priors: a work ball that stands a millimetre higher makes no other machine."""
    labels = sorted(set(one) | set(other))
    size, *sizes = Prior.default().compliance_sd([ComplianceName(*label[2:]) for label in (name, *labels)], 0, 1.0)
    apart = [one.get(label, 0.0) - other.get(label, 0.0) for label in labels]
    return bool(np.linalg.norm(np.array(apart) * sizes) <= _NEGLIGIBLE * size)


@dataclass(frozen=True)
class PopulationPrior:
    """What a population of machines says of the next one.

    Attributes
    ----------
    reference_force_N : float
        F0, at which the compliances are meant.
    machines, campaigns : int
        How many it rests on.
    means, sds : mapping of compliance to prior mean and sd
        In inside units (mm, N, rad).
    forces_N : tuple of float
        Least and greatest force of the population's tests.
    compliances : mapping of compliance to mapping
        What they stand for in the population, see `stands_for`; one that is missing is taken to be the campaign's.
    trusted : bool
        Whether the population's spreads could be computed as well as it asks for.
    not_belonging, machine_ids, readings
        Machines in it that stand out from the others, all machines, and SHA-256 of the campaigns.
    own_doubts : tuple of str
        What the population says is to be minded.
    """

    reference_force_N: float
    machines: int
    campaigns: int
    means: Mapping[str, float]
    sds: Mapping[str, float]
    sha256: str
    topology: str
    forces_N: tuple[float, ...]
    compliances: Mapping[str, Meaning] = field(default_factory=dict)
    trusted: bool = True
    not_belonging: tuple[str, ...] = ()
    machine_ids: frozenset[str] = frozenset()
    readings: frozenset[str] = frozenset()
    own_doubts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("means", "sds", "compliances"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __reduce__(self) -> tuple[Any, ...]:
        """To other processes; a read-only mapping does not pickle."""
        return type(self), tuple(dict(own) if isinstance(own, Mapping) else own for own in vars(self).values())

    def model(self, model: HybridModel) -> HybridModel:
        """The same model with these priors of the compliances, at the population's reference force; slopes keep their sd.

        Raises
        ------
        InputError
            For flat priors, compliances that the model fixes or has other priors of, or another reference force.
        """
        prior = model.prior
        if prior.flat:
            raise InputError("the model must have proper priors to take a population's, got flat ones. Use the default preset.")
        for name in self.means:
            if name in model.fixed:
                raise InputError(f"{name} must be free to have the population's prior, got one fixed at zero. Free it.")
            if name in prior.overrides or name in prior.means:
                raise InputError(f"{name} must have one prior, got the population's and the model's own. Remove one of them.")
        own = model.reference_force_N
        if own is not None and not np.isclose(own, self.reference_force_N, rtol=_SAME_FORCE):
            raise InputError(
                f"reference_force_N must be the population's {self.reference_force_N:g} N, at which its compliances are meant, "
                f"got {own:g} N. Leave reference_force_N out of the model."
            )
        prior = replace(prior, overrides={**prior.overrides, **self.sds}, means={**prior.means, **self.means})
        return replace(model, reference_force_N=self.reference_force_N, prior=prior)

    def doubts(self, campaign: Campaign) -> tuple[str, ...]:
        """What speaks against using it for a campaign (or plan), in sentences.

        Raises
        ------
        InputError
            For a machine that the population does not speak of, or a campaign that is in it.
        """
        check_campaign(campaign)
        self._check_machine(campaign)
        doubts = []
        if campaign.machine_id in self.machine_ids:
            doubts.append(
                f"The population has campaigns of this machine ({campaign.machine_id}): its prior is that of a machine not seen "
                "before, and wider than what is known of this one."
            )
        low, high = float(campaign.forces_N.min()), float(campaign.forces_N.max())
        if not low <= self.reference_force_N <= high:
            doubts.append(
                f"The population's compliances are meant at {self.reference_force_N:g} N, outside this campaign's forces "
                f"({low:g} to {high:g} N): only the model's slopes carry them there."
            )
        if self.machines < _FEW:
            doubts.append(
                f"The population has {self.machines} machine{'s' * (self.machines > 1)}, fewer than {_FEW}: how much machines "
                "differ is hardly known from them, and this prior rests on what was assumed of it."
            )
        doubts += [f"The population says: {doubt}" for doubt in self.own_doubts]
        if not self.trusted:
            doubts.append("The population says that its spreads cannot be trusted: this prior may be too narrow, or too wide.")
        if self.not_belonging:
            n = len(self.not_belonging)
            some = ", ".join(self.not_belonging[:_NAMED]) + (f" and {n - _NAMED} more" if n > _NAMED else "")
            doubts.append(
                f"The population includes {n} machine{'s' * (n > 1)} that do{'es' * (n == 1)} not belong with the others "
                f"({some}): this prior is wider for it. Pool the others alone."
            )
        return tuple(doubts)

    def _check_machine(self, campaign: Campaign) -> None:
        if campaign.topology != self.topology:
            raise InputError(
                f"topology must be the population's {self.topology!r} to use its prior, got {campaign.topology!r}. "
                "Use a population of such machines, or no --prior-from."
            )
        sums = stands_for(campaign)
        missing = [name for name in self.means if name not in sums]
        if missing:
            raise InputError(
                f"the campaign must have the population's compliances, got {', '.join(sums)} without {', '.join(missing)}. "
                "Use a population whose circles lie in the same planes."
            )
        for name in self.means:
            if name in self.compliances and not same_meaning(name, self.compliances[name], sums[name]):
                raise InputError(
                    f"the campaign must mean by {name} what the population does, got circles or joints' frames that stand "
                    "elsewhere, so that it is the sum of other compliances. Use a population measured in the same place."
                )
        if campaign.sha256 in self.readings:
            raise InputError(
                "the campaign must not be in the population that gives its prior, got readings that it was made from: they would "
                "count twice. Make the population without it (--exclude), or fit without --prior-from."
            )


_Name = Annotated[str, Field(pattern=f"^{_COMPLIANCE.pattern}$")]


class _Entry(BaseModel):
    model_config = ConfigDict(strict=True)
    unit: str
    mean: FiniteFloat
    sd: Annotated[FiniteFloat, Field(gt=0.0)]


class _File(BaseModel):
    model_config = ConfigDict(strict=True)
    schema_: Literal[1] = Field(alias="schema")
    kind: Literal["population"]
    reference_force_N: FiniteFloat
    machines: Annotated[int, Field(ge=1)]
    campaigns: Annotated[int, Field(ge=1)]
    forces_N: Annotated[list[FiniteFloat], Field(min_length=1)]
    topology: str
    compliances: dict[str, dict[_Name, FiniteFloat]] = Field(default_factory=dict)
    trusted: bool = True
    not_belonging: list[str] = Field(default_factory=list)
    machine: dict[str, Any] = Field(default_factory=dict)
    readings_sha256: list[str] = Field(default_factory=list)
    doubts: list[str] = Field(default_factory=list)
    next_: Annotated[dict[str, _Entry], Field(alias="next", min_length=1)]
    sha256: Annotated[str, Field(min_length=1, max_length=128)]


def prior_from(path: str | os.PathLike[str]) -> PopulationPrior:
    """The prior that a population's result holds for one more machine.

    Parameters
    ----------
    path : path
        The result's folder, or the ``population.json`` in it.

    Raises
    ------
    InputError
        For anything else, naming the file.
    """
    file = Path(path) / FILE if Path(path).is_dir() else Path(path)
    raw = bytes_of(file, _LARGEST_BYTES, what="a population's result")
    try:
        read = _read(raw)
    except ValueError as error:
        raise InputError(
            f"{file} must be a population's result, got {_got(error)}. Give the folder that held the result, or its {FILE}, "
            "unchanged."
        ) from None
    plain = read.model_dump(include={"reference_force_N", "machines", "campaigns", "topology", "compliances", "trusted"})
    return PopulationPrior(
        means={name: entry.mean for name, entry in read.next_.items()},
        sds={name: entry.sd for name, entry in read.next_.items()},
        sha256=read.sha256,
        forces_N=tuple(read.forces_N),
        not_belonging=tuple(read.not_belonging),
        machine_ids=frozenset(read.machine),
        readings=frozenset(read.readings_sha256),
        own_doubts=tuple(read.doubts),
        **plain,
    )


def digest_of(record: Mapping[str, Any]) -> str:
    """SHA-256 of a population.json, as read, but for its ``sha256``: of its JSON with sorted keys."""
    plain = {name: value for name, value in record.items() if name != "sha256"}
    return hashlib.sha256(json.dumps(plain, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _read(raw: bytes) -> _File:
    try:
        record = json.loads(raw)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"what is no JSON ({type(error).__name__})") from None
    file = _File.model_validate(record)
    if file.sha256 != digest_of(record):
        raise ValueError("contents that its sha256 is not of: it was edited")
    for name, entry in file.next_.items():
        match = _COMPLIANCE.fullmatch(name)
        if match is None:
            raise ValueError(f"{name!r} among the compliances")
        unit = compliance_unit(ComplianceName(*match.groups()))
        if entry.unit != unit:
            raise ValueError(f"{name} in {entry.unit!r} instead of {unit!r}")
    return file


def _got(error: ValueError) -> str:
    if not isinstance(error, ValidationError):
        return str(error)
    first = error.errors()[0]
    place = ".".join(str(part) for part in first["loc"])
    got = "nothing" if first["type"] == "missing" else repr(first["input"])[:80]
    return f"{place or 'the whole'} = {got} ({first['msg']})"
