"""Split from its neighbours; see there."""

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
from ldbb_bayes.errors import require
from ldbb_bayes.fleet.compliance_meaning import Meaning, same_meaning, stands_for
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.report.wording import (
    PAGE,
)
from ldbb_bayes.results import Shown, read_result

__all__ = ["PopulationPrior", "digest_of", "prior_from"]


_SAME_FORCE = 1e-9


@dataclass(frozen=True)
class PopulationPrior(Shown):
    """What a population of machines says of the next one: C ~ N(mean, sd²) at the population's
    reference force.

    Compliances alone, in inside units (mm, N, rad): their slopes and the geometric errors keep the
    model's own priors.
    """

    reference_force_N: float  #: F0, at which the compliances are meant
    machines: int  #: their number
    campaigns: int  #: their number
    means: Mapping[str, float]  #: by compliance
    sds: Mapping[str, float]  #: by compliance
    sha256: str  #: of the population
    topology: str  #: of the machines
    #: one that is missing is the campaign's
    compliances: Mapping[str, Meaning] = field(default_factory=dict)
    machine_ids: frozenset[str] = frozenset()  #: of the machines
    readings: frozenset[str] = frozenset()  #: SHA-256 of the campaigns
    own_doubts: tuple[str, ...] = ()  #: what the population says is to be minded

    def model(self, model: HybridModel) -> HybridModel:
        """The same model with these priors of the compliances, at the population's reference force;
        slopes keep their sd."""
        prior = model.prior
        cure = "got flat ones. Use the default preset."
        require(not prior.flat, f"the model must have proper priors to take a population's, {cure}")
        for name in self.means:
            free = name not in model.fixed
            require(
                free,
                f"{name} must be free to have the population's prior, got one fixed at zero."
                " Free it.",
            )
            two = name in prior.overrides or name in prior.means
            require(
                not two,
                f"{name} must have one prior, got the population's and the model's own. Remove one"
                " of them.",
            )
        own = self.reference_force_N if model.reference_force_N is None else model.reference_force_N
        got = f"got {own:g} N. Leave reference_force_N out of the model."
        said = (
            f"reference_force_N must be the population's {self.reference_force_N:g} N, at which its"
            f" compliances are meant, {got}"
        )
        require(np.isclose(own, self.reference_force_N, rtol=_SAME_FORCE), said)
        prior = replace(
            prior, overrides={**prior.overrides, **self.sds}, means={**prior.means, **self.means}
        )
        return replace(model, reference_force_N=self.reference_force_N, prior=prior)

    def doubts(self, campaign: Campaign) -> tuple[str, ...]:
        """What speaks against using it for a campaign (or plan), in sentences; a machine that it
        does not speak of is refused."""
        check_campaign(campaign)
        self._check_machine(campaign)
        doubts = []
        if campaign.machine_id in self.machine_ids:
            doubts.append(PAGE["own_machine"].format(machine=campaign.machine_id))
        low = float(campaign.forces_N.min())
        high = float(campaign.forces_N.max())
        if not low <= self.reference_force_N <= high:
            doubts.append(
                PAGE["other_forces"].format(force=self.reference_force_N, low=low, high=high)
            )
        return (*doubts, *(f"The population says: {doubt}" for doubt in self.own_doubts))

    def _check_machine(self, campaign: Campaign) -> None:
        got = f"got {campaign.topology!r}. Use a population of such machines, or no --prior-from."
        same = campaign.topology == self.topology
        require(
            same, f"topology must be the population's {self.topology!r} to use its prior, {got}"
        )
        sums = stands_for(campaign)
        missing = [name for name in self.means if name not in sums]
        got = (
            f"got {', '.join(sums)} without {', '.join(missing)}. Use a population whose circles"
            " lie in the same planes."
        )
        require(not missing, f"the campaign must have the population's compliances, {got}")
        for name in self.means:
            got = (
                "got circles or joints' frames that stand elsewhere, so that it is the sum of other"
                " compliances"
            )
            same = name not in self.compliances or same_meaning(
                name, self.compliances[name], sums[name]
            )
            cure = "Use a population measured in the same place."
            require(
                same, f"the campaign must mean by {name} what the population does, {got}. {cure}"
            )
        got = "got readings that it was made from: they would count twice"
        cure = "Make the population without it (--exclude), or fit without --prior-from."
        apart = campaign.sha256 not in self.readings
        require(
            apart, f"the campaign must not be in the population that gives its prior, {got}. {cure}"
        )


def prior_from(path: str | os.PathLike[str]) -> PopulationPrior:
    """The prior for one more machine in a population's result, unchanged: its folder, or the
    ``population.json`` in it."""
    return read_result(Path(path), "population", "population", _prior_of)


def _prior_of(record: Mapping[str, Any]) -> PopulationPrior:
    if (record["kind"], record["schema"], record["sha256"]) != ("population", 1, digest_of(record)):
        raise ValueError(
            "its sha256 is not that of its contents: it was edited, or is of another edition"
        )
    return PopulationPrior(
        **{
            name: record[name]
            for name in (
                "reference_force_N",
                "machines",
                "campaigns",
                "topology",
                "sha256",
                "compliances",
            )
        },
        means={name: entry["mean"] for name, entry in record["next"].items()},
        sds={name: entry["sd"] for name, entry in record["next"].items()},
        machine_ids=frozenset(record["machine"]),
        readings=frozenset(record["readings_sha256"]),
        own_doubts=tuple(record["doubts"]),
    )


def digest_of(record: Mapping[str, Any]) -> str:
    """SHA-256 of a population.json, as read, but for its ``sha256``: of its JSON with sorted
    keys."""
    plain = {name: value for name, value in record.items() if name != "sha256"}
    return hashlib.sha256(
        json.dumps(plain, sort_keys=True, separators=(",", ":")).encode()
    ).hexdigest()
