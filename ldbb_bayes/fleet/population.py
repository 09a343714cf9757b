"""Population of machines of one kind: what is known of it, of its machines and of the next one.

`pooling` makes the population from the campaigns of its machines.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

import pandas as pd
from pydantic import Field

from ldbb_bayes.analysis.compliance_meaning import Meaning
from ldbb_bayes.fleet.interval_summary import Summary, name_intervals
from ldbb_bayes.fleet.selection import Caveat
from ldbb_bayes.results import Result, readable
from ldbb_bayes.units import ranked

__all__ = ["CONSTANT_COMPLIANCE", "PooledMachine", "PooledParameter", "Population"]

# Pattern of the names of compliances at the reference force, such as C_XXX. It does not match the
# names of slopes, which describe how a compliance changes with force.
CONSTANT_COMPLIANCE = re.compile(r"C_...")


@dataclass(frozen=True)
class PooledParameter(Result):
    """Mean and spread of a parameter over a population, and prediction for a further machine.

    Attributes of type ``Summary`` hold a mean, a standard deviation and a credible interval, in
    internal units (mm, N, rad).
    """

    unit: str  #: unit of one parameter of the machines, made of mm, N and rad, such as mm/N
    #: prior standard deviation of the parameter's mean over the population, in ``unit``; the prior
    #: mean is zero
    prior_sd: float
    mean: Summary  #: mean of one parameter over the machines of the population
    #: spread of one parameter: the standard deviation of the machines about their mean
    spread: Summary
    #: prediction of one parameter for a further, unmeasured machine of the population
    next: Summary
    #: part of the posterior sd of the parameter's mean, in ``unit``, that is due to the errors of
    #: the one instrument that all campaigns used; measurements of more machines do not reduce this
    #: part
    instrument_sd: float


@dataclass(frozen=True)
class PooledMachine(Result):
    """Estimates for one machine of a population, and its comparison with the other machines.

    Attributes of type ``Summary`` are in internal units (mm, N, rad).
    """

    #: machine_id of the machine, or the file path of its campaign if the campaign states no
    #: machine_id
    name: Annotated[str, Field(exclude=True)]
    campaigns: int  #: number of campaigns of one machine
    #: estimates of the machine's parameters from its own campaigns and from the population; the
    #: keys are the names of the parameters
    estimate: dict[str, Summary]
    #: estimates of the machine's parameters from its own campaigns, with the prior N(0, prior_sd²)
    #: instead of the distribution of the population; the keys are the names of the parameters. The
    #: errors of the instrument, however, are estimated from the campaigns of all machines.
    alone: dict[str, Summary]
    #: p-value of the hypothesis that the machine belongs to the population of the other machines.
    #: It is corrected for the number of parameters (Bonferroni) and of machines (Holm). If all
    #: machines belong to one population, the probability that any machine has a p-value below 5 %
    #: is at most 5 %. None if there are fewer than six machines.
    p_value: float | None = None
    #: whether the machine stands out from the other machines: its corrected p-value is below 5 %
    flag: bool = False
    #: deviation of each parameter of the machine from the value predicted from the other machines,
    #: positive if the parameter is larger. The deviation is stated as a quantile of the standard
    #: normal distribution: 2, for example, means a two-sided p-value of 4.6 %. The keys are the
    #: names of the parameters. Empty if there are fewer than six machines.
    z: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Population(Result):
    """Population of machines of one kind, and the estimates for each machine.

    ``judged`` states whether every machine could be compared reliably with the other machines. If
    it is false, the list ``not_belonging`` may be incomplete.

    Examples
    --------
    >>> population = lb.fleet.fit_population(rows)
    >>> population.parameters["C_XXX"].unit, population.campaigns
    ('mm/N', 2)
    >>> population.not_belonging, population.judged  # 6 machines are needed to judge one
    ((), False)
    """

    #: distribution of each parameter over the machines (mean, standard deviation from machine to
    #: machine, prediction for a further machine); the keys are the names of the parameters
    parameters: dict[str, PooledParameter]
    #: estimates for each machine; the keys are the machine_ids or, for a machine without
    #: machine_id, the file path of its campaign
    machine: dict[str, PooledMachine]
    campaigns: int  #: number of campaigns of all machines in the population
    reference_force_N: float  #: force for which the compliances are given [N]
    #: lowest and highest force of the range that all campaigns have in common [N]. If there is no
    #: common range, the lowest force is above the highest force.
    forces_N: tuple[float, float]
    topology: str  #: topology of the machines: the chain of joints from workpiece to tool
    #: meaning of each fitted compliance: a weighted sum of joint compliances. The keys are the
    #: names of the fitted compliances. The mapping is empty if the batch does not state the sums.
    compliances: Mapping[str, Meaning]
    #: names of the instrument errors that are the same in all campaigns, such as "mount" for the
    #: error of the mount's deflection; empty if the campaigns used different instruments
    instrument: tuple[str, ...]
    #: scale of the prior of each parameter's spread, the standard deviation from machine to
    #: machine. The prior is HalfNormal(spread_scale · prior_sd).
    spread_scale: float
    #: seed of the random draws of the spreads (standard deviations from machine to machine)
    seed: int
    #: Pareto shape k̂ of the weights of the random draws of the spreads (standard deviations from
    #: machine to machine); the larger k̂ is, the less reliable are the draws
    pareto_k: float
    #: whether ``pareto_k`` is low enough to trust the random draws of the spreads (standard
    #: deviations from machine to machine)
    trusted: bool
    caveats: tuple[Caveat, ...]  #: limitations of the results for the population
    #: probability of the credible intervals in the results for a population
    prob: Annotated[float, Field(exclude=True)]
    #: whether every machine could be compared reliably with the other machines, to find out whether
    #: it belongs to the population
    judged: Annotated[bool, Field(exclude=True)]
    #: one SHA-256 digest for each campaign, computed from the campaign's readings and the
    #: conditions under which they were taken. The digests show which campaigns are part of the
    #: population. These campaigns must not be fitted with a prior from the population, because
    #: their readings would count twice.
    readings: Annotated[tuple[str, ...], Field(alias="readings_sha256")] = ()
    #: one SHA-256 digest for each campaign, computed from the campaign's readings alone. These
    #: digests recognise the campaigns also if something else is stated of the same readings, such
    #: as another order of the tests or another mount.
    circles: Annotated[tuple[str, ...], Field(alias="circles_sha256")] = ()

    @property
    def not_belonging(self) -> tuple[str, ...]:
        """Names of the machines that stand out from the other machines.

        A machine stands out if its corrected p-value is below 5 %. The machines are in descending
        order of their largest deviation ``z`` from the values predicted from the other machines.
        """
        flagged = sorted(machine.name for machine in self.machine.values() if machine.flag)
        return tuple(ranked(flagged, self._largest_z))

    def _largest_z(self, name: str) -> float:
        """Return the largest absolute value of the deviations ``z`` of a machine's parameters.

        ``z`` is explained in `PooledMachine`. ``name`` is the name of the machine.
        """
        return max(abs(z) for z in self.machine[name].z.values())

    def as_dict(self) -> dict[str, Any]:
        """Return the content of the file population.json, without its sentences and SHA-256 digest.

        The entry ``next`` is the prediction for a further machine. `read_population_prior` makes a
        prior from this entry.
        """
        next_machine = {}
        for name, parameter in self.parameters.items():
            if CONSTANT_COMPLIANCE.fullmatch(name):
                next_machine[name] = {
                    "unit": parameter.unit,
                    "mean": parameter.next.mean,
                    "sd": parameter.next.sd,
                }
        return {
            "schema": 1,
            "kind": "population",
            "machines": len(self.machine),
            **name_intervals(super().as_dict(), self.prob),
            "next": next_machine,
            "not_belonging": list(self.not_belonging),
        }

    def machines_table(self) -> pd.DataFrame:
        """Return a table with one row per machine, in internal units (mm, N, rad).

        The first columns are ``campaigns`` (the number of campaigns), ``p_value`` and ``flag``.
        Each parameter has further columns. For the parameter C_XXX, for example, they are

        - ``C_XXX.mean``, ``C_XXX.sd``, ``C_XXX.ci_low`` and ``C_XXX.ci_high``: the estimate from
          the campaigns of all machines;
        - ``C_XXX.alone_mean`` and ``C_XXX.alone_sd``: the estimate from the campaigns of this
          machine only;
        - ``C_XXX.z``: how far this machine's estimate lies from the value that the other machines
          predict, as a quantile of the standard normal distribution.
        """
        rows: dict[str, dict[str, Any]] = {}
        for name, machine in self.machine.items():
            rows[name] = {
                "campaigns": machine.campaigns,
                "p_value": machine.p_value,
                "flag": machine.flag,
            }
            for parameter, estimate in machine.estimate.items():
                low, high = estimate.interval
                separate = machine.alone[parameter]
                rows[name] |= {
                    f"{parameter}.mean": estimate.mean,
                    f"{parameter}.sd": estimate.sd,
                    f"{parameter}.ci_low": low,
                    f"{parameter}.ci_high": high,
                    f"{parameter}.alone_mean": separate.mean,
                    f"{parameter}.alone_sd": separate.sd,
                    f"{parameter}.z": machine.z.get(parameter),
                }
        return readable(pd.DataFrame.from_dict(rows, orient="index").rename_axis("machine"))
