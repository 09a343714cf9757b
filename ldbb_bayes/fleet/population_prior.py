"""The prior of one more machine from a population of machines: C ~ N(mean, sd²) at the population's reference force."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign, check_campaign
from ldbb_bayes.errors import InputError
from ldbb_bayes.files import bytes_of
from ldbb_bayes.fleet.statistics import Meaning, same_meaning, stands_for
from ldbb_bayes.model.hybrid import HybridModel

__all__ = ["PopulationPrior", "digest_of", "prior_from"]

FILE = "population.json"
_LARGEST_BYTES = 128 * 2**20
_SAME_FORCE = 1e-9


@dataclass(frozen=True)
class PopulationPrior:
    """What a population of machines says of the next one: C ~ N(mean, sd²) at the population's reference force.

    Compliances alone, in inside units (mm, N, rad): their slopes and the geometric errors keep the model's own priors.
    """

    reference_force_N: float  # F0, at which the compliances are meant
    machines: int
    campaigns: int
    means: Mapping[str, float]
    sds: Mapping[str, float]
    sha256: str
    topology: str
    compliances: Mapping[str, Meaning] = field(default_factory=dict)  # see `stands_for`; one that is missing is the campaign's
    machine_ids: frozenset[str] = frozenset()
    readings: frozenset[str] = frozenset()  # SHA-256 of the campaigns
    own_doubts: tuple[str, ...] = ()  # what the population says is to be minded

    def model(self, model: HybridModel) -> HybridModel:
        """The same model with these priors of the compliances, at the population's reference force; slopes keep their sd."""
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
        """What speaks against using it for a campaign (or plan), in sentences; a machine that it does not speak of is refused."""
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
        return (*doubts, *(f"The population says: {doubt}" for doubt in self.own_doubts))

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


def prior_from(path: str | os.PathLike[str]) -> PopulationPrior:
    """The prior for one more machine in a population's result: its folder, or the ``population.json`` in it."""
    file = Path(path) / FILE if Path(path).is_dir() else Path(path)
    raw, got, record = bytes_of(file, _LARGEST_BYTES, what="a population's result"), "", None
    try:
        record = json.loads(raw)
    except (ValueError, RecursionError) as error:
        got = f"what is no JSON ({type(error).__name__})"
    if not got and not (isinstance(record, dict) and record.get("kind") == "population" and record.get("schema") == 1):
        got = "something else, or another edition"
    elif record is not None and record.get("sha256") != digest_of(record):
        got = "contents that its sha256 is not of: it was edited"
    if record is None or got:
        raise InputError(
            f"{file} must be a population's result, got {got}. Give the folder that held the result, or its {FILE}, unchanged."
        )
    return PopulationPrior(
        **{name: record[name] for name in ("reference_force_N", "machines", "campaigns", "topology", "sha256", "compliances")},
        means={name: entry["mean"] for name, entry in record["next"].items()},
        sds={name: entry["sd"] for name, entry in record["next"].items()},
        machine_ids=frozenset(record["machine"]),
        readings=frozenset(record["readings_sha256"]),
        own_doubts=tuple(record["doubts"]),
    )


def digest_of(record: Mapping[str, Any]) -> str:
    """SHA-256 of a population.json, as read, but for its ``sha256``: of its JSON with sorted keys."""
    plain = {name: value for name, value in record.items() if name != "sha256"}
    return hashlib.sha256(json.dumps(plain, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
