"""Prior for a further machine, taken from the result of a population of machines."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ldbb_bayes.analysis.compliance_meaning import Meaning, same_meaning, stands_for
from ldbb_bayes.campaign.campaign import Campaign, require_campaign
from ldbb_bayes.errors import InputError
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.report.wording import PAGE
from ldbb_bayes.results import Shown, read_result

__all__ = ["PopulationPrior", "digest_of", "read_population_prior"]

# Two reference forces are treated as equal if their relative difference is at most this number.
# Such a small difference may be a rounding error.
_SAME_FORCE = 1e-9
# Advice that is printed if a file is not the result of a population. A user may have given a fit.
_ADVICE = (
    "A population needs two machines or more. What a fit says of one machine goes by hand into"
    " [prior.means] and [prior.overrides] of a model.toml (--model); see"
    " docs/how-to/change_a_prior.md."
)


@dataclass(frozen=True)
class PopulationPrior(Shown):
    """Prior for a further machine of a population; its compliances C follow N(mean, sd²).

    The prior is for compliances at the population's reference force, in internal units (mm, N,
    rad). Changes of compliances with force (slopes) and geometric errors keep the priors of the
    model.

    Examples
    --------
    >>> prior = lb.fleet.PopulationPrior(
    ...     reference_force_N=389.0, machines=12, campaigns=12, means={"C_XXX": 50e-6},
    ...     sds={"C_XXX": 5e-6}, sha256="", topology="wCAFYXZSt")
    >>> informed = prior.model(lb.HybridModel.default())
    >>> informed.prior.means["C_XXX"], informed.reference_force_N
    (5e-05, 389.0)
    >>> prior.doubts(campaign)
    ()
    """

    reference_force_N: float  #: force for which the compliances of the prior are given [N]
    machines: int  #: number of machines in the population from which the prior was made
    campaigns: int  #: number of campaigns in the population from which the prior was made
    #: prior mean of each compliance in internal units (mm, N, rad); the keys are the names of the
    #: compliances
    means: Mapping[str, float]
    #: prior standard deviation of each compliance in internal units (mm, N, rad); the keys are the
    #: names of the compliances
    sds: Mapping[str, float]
    #: SHA-256 of the content of population.json, the result from which the prior was made
    sha256: str
    topology: str  #: topology of the machines: the chain of joints from workpiece to tool
    #: meaning of each compliance of the population: a weighted sum of the compliances of single
    #: joints. The keys are the names of the compliances. A compliance without an entry is assumed
    #: to have the same meaning as in the campaign to be fitted.
    compliances: Mapping[str, Meaning] = field(default_factory=dict)
    #: names of the machines in the population from which the prior was made: the machine_id or, for
    #: a machine without machine_id, the file path of its campaign
    machine_ids: frozenset[str] = frozenset()
    #: SHA-256 digests of the campaigns in the population from which the prior was made. A campaign
    #: has two: one is computed from its readings and the conditions under which they were taken,
    #: the other from its readings alone. Populations of earlier versions lack the second.
    readings: frozenset[str] = frozenset()
    #: sentences on the limitations of the population from which the prior was made
    population_doubts: tuple[str, ...] = ()

    def model(self, model: HybridModel) -> HybridModel:
        """Return a copy of a model in which the compliances have this prior from a population.

        Changes of compliances with force (slopes) keep the prior standard deviations of the given
        model. The reference force of the returned model is that of the population.

        Parameters
        ----------
        model : HybridModel
            Model with proper (not flat) priors, in which no compliance of the population is fixed.

        Returns
        -------
        HybridModel
            The same model with the population's means and standard deviations.

        Raises
        ------
        InputError
            If the priors of the model are flat, the model fixes a compliance or states another
            prior for a compliance, or the model states another reference force.
        """
        prior = model.prior
        if prior.flat:
            raise InputError(
                "the model must have proper priors to take a population's, got flat ones. Use the"
                " default preset."
            )
        for name in self.means:
            _check_takes_prior(model, name)
        force = model.reference_force_N
        if force is not None and not np.isclose(force, self.reference_force_N, rtol=_SAME_FORCE):
            raise InputError(
                f"reference_force_N must be the population's {self.reference_force_N:g} N, at which"
                f" its compliances are meant, got {force:g} N. Leave reference_force_N out of the"
                " model (model.toml); --preset default has none."
            )
        prior = replace(
            prior, overrides={**prior.overrides, **self.sds}, means={**prior.means, **self.means}
        )
        return replace(model, reference_force_N=self.reference_force_N, prior=prior)

    def doubts(self, campaign: Campaign) -> tuple[str, ...]:
        """Return sentences that state why the population's prior may not suit a campaign.

        The prior may not suit the campaign in the following cases:

        - the population has other campaigns of the same machine;
        - the population's reference force is outside the campaign's range of forces;
        - there are doubts about the population itself.

        Parameters
        ----------
        campaign : Campaign
            Campaign or plan to be fitted with the prior.

        Returns
        -------
        tuple of str
            The sentences; empty if there is no doubt.

        Raises
        ------
        InputError
            If the topology (chain of joints) of the campaign's machine differs from that of the
            population; if a compliance of the population is missing in the campaign, or is a
            different sum of joint compliances there; or if the readings of the campaign belong to
            the population, so that they would be used twice, whatever else is stated of them.
        """
        require_campaign(campaign)
        self._check_applies_to(campaign)
        doubts = []
        if campaign.machine_id in self.machine_ids:
            doubts.append(PAGE["own_machine"].format(machine=campaign.machine_id))
        low = float(campaign.forces_N.min())
        high = float(campaign.forces_N.max())
        if not low <= self.reference_force_N <= high:
            doubts.append(
                PAGE["other_forces"].format(force=self.reference_force_N, low=low, high=high)
            )
        doubts += [f"The population says: {doubt}" for doubt in self.population_doubts]
        return tuple(doubts)

    def _check_applies_to(self, campaign: Campaign) -> None:
        """Raise an `InputError` if the population's prior does not apply to a campaign.

        The campaign's machine must have the topology (chain of joints) of the population's
        machines. Each compliance must stand for the same sum of joint compliances in the campaign
        as in the population. The campaign must not be part of the population.
        """
        if campaign.topology != self.topology:
            raise InputError(
                f"topology must be the population's {self.topology!r} to use its prior, got"
                f" {campaign.topology!r}. Use a population of such machines, or no --prior-from."
            )
        meanings = stands_for(campaign)
        missing = [name for name in self.means if name not in meanings]
        if missing:
            raise InputError(
                "the campaign must have the population's compliances, got"
                f" {', '.join(meanings)} without {', '.join(missing)}. Use a population whose"
                " circles lie in the same planes."
            )
        for name in self.means:
            stated = self.compliances.get(name)
            if stated is not None and not same_meaning(name, stated, meanings[name]):
                raise InputError(
                    f"the campaign must mean by {name} what the population does, got circles or"
                    " joints' frames that stand elsewhere, so that it is the sum of other"
                    " compliances. Use a population measured in the same place."
                )
        if not self.readings.isdisjoint((campaign.sha256, campaign.circles_sha256)):
            raise InputError(
                "the campaign must not be in the population that gives its prior, got readings that"
                " it was made from: they would count twice. Make the population without it"
                " (--exclude), or fit without --prior-from."
            )


def _check_takes_prior(model: HybridModel, name: str) -> None:
    """Raise an `InputError` if a compliance of a model must not take its prior from a population.

    This is the case if the model fixes the compliance at zero, or if the user has set a prior for
    it in the model. ``name`` is the name of the compliance.
    """
    if name in model.fixed:
        raise InputError(
            f"{name} must be free to have the population's prior, got one fixed at zero. Free it."
        )
    if name in model.prior.overrides or name in model.prior.means:
        raise InputError(
            f"{name} must have one prior, got the population's and the model's own. Remove it from"
            " the model (model.toml), or leave --prior-from out."
        )


def read_population_prior(path: str | os.PathLike[str]) -> PopulationPrior:
    """Return the prior that a population gives for a further machine.

    Parameters
    ----------
    path : path
        Folder of a population's result, or the unchanged file ``population.json`` in it.

    Returns
    -------
    PopulationPrior
        Prior means and standard deviations of the compliances of the further machine.

    Raises
    ------
    InputError
        If there is no file population.json, or if the file has been edited.

    Examples
    --------
    >>> population = lb.fleet.fit_population(rows)
    >>> import json, pathlib
    >>> text = json.dumps(lb.report.with_words(population))
    >>> size = pathlib.Path("population.json").write_text(text)
    >>> prior = lb.fleet.read_population_prior("population.json")
    >>> prior.machines, prior.reference_force_N
    (2, 389.0)
    """
    return read_result(Path(path), "population", "population", _prior_of, _ADVICE)


def _prior_of(record: Mapping[str, Any]) -> PopulationPrior:
    """Return the prior for a further machine, from the content of the file population.json.

    Raise a ValueError if the file does not hold a population, or has been edited.
    """
    is_population = record["kind"] == "population" and record["schema"] == 1
    if not is_population or record["sha256"] != digest_of(record):
        raise ValueError(
            "its sha256 is not that of its contents: it was edited, or is of another edition"
        )
    next_machine = record["next"]
    return PopulationPrior(
        reference_force_N=record["reference_force_N"],
        machines=record["machines"],
        campaigns=record["campaigns"],
        means={name: entry["mean"] for name, entry in next_machine.items()},
        sds={name: entry["sd"] for name, entry in next_machine.items()},
        sha256=record["sha256"],
        topology=record["topology"],
        compliances=record["compliances"],
        machine_ids=frozenset(record["machine"]),
        readings=frozenset((*record["readings_sha256"], *record.get("circles_sha256", ()))),
        population_doubts=tuple(record["doubts"]),
    )


def digest_of(record: Mapping[str, Any]) -> str:
    """Return the SHA-256 digest of the content of population.json without its entry ``sha256``.

    Parameters
    ----------
    record : content of the file as a dictionary. The digest is computed from this content, written
        as compact JSON with sorted keys.
    """
    content = {name: value for name, value in record.items() if name != "sha256"}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
