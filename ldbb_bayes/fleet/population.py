"""Population of machines of one kind, described by a hierarchical model.

c_m ~ N(μ, diag(s²)), b ~ N(0, I), μ_j ~ N(0, 1), s_j ~ HalfNormal(spread_scale)

All values are in units of the parameters' prior sds. c_m are the parameters of machine m, which are
the same in all campaigns of this machine. μ is the mean of the population. s are the spreads, that
is, the standard deviations of the machines about μ; j is the index of a parameter. b are the errors
of the instrument, which is the same in all campaigns.

The estimate for each machine also depends on the readings of the other machines. The smaller the
spread is, the stronger is this dependence (partial pooling). The likelihoods of the campaigns are
Gaussian functions of c_m and b (`FleetStatistics`). All unknowns except s are therefore integrated
out exactly (`spread_density`). Each machine is compared with the prediction from the other machines
(`outlying_machines`).
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, NamedTuple

import numpy as np
import pandas as pd
from pydantic import Field
from scipy.special import ndtri

from ldbb_bayes.deprecation import renamed_keyword
from ldbb_bayes.errors import InputError, check_probability
from ldbb_bayes.fleet.campaign_statistics import mixture_covariance
from ldbb_bayes.fleet.compliance_meaning import Meaning
from ldbb_bayes.fleet.deviations import estimate_separately
from ldbb_bayes.fleet.fleet_statistics import FleetStatistics, fleet_statistics
from ldbb_bayes.fleet.interval_summary import Summary, name_intervals
from ldbb_bayes.fleet.outlying_machines import JudgedMachines, judge_machines
from ldbb_bayes.fleet.population_prior import digest_of
from ldbb_bayes.fleet.selection import Caveat, CaveatKind, choose, labels
from ldbb_bayes.fleet.spread_density import (
    SpreadDensity,
    Spreads,
    draw_spreads,
    machine_estimates,
    machine_likelihoods,
    shared_quantities,
)
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.mixtures import mixture_moments, mixture_quantiles, weighted_quantiles
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.report.text import parts_of
from ldbb_bayes.report.wording import (
    PAGE,
    caveat_words,
    nuisance_words,
    population_doubts,
    population_sentences,
    with_words,
)
from ldbb_bayes.results import Array, Result, Table, json_text, readable
from ldbb_bayes.units import (
    display_name,
    display_unit,
    plus_minus,
    ranked,
    round_uncertainty,
    state,
)

__all__ = ["PooledMachine", "PooledParameter", "Population", "fit_population", "pool"]

# The machines of a population are compared with one another if there are at least this many.
_FEWEST_MACHINES = 6
# A machine is flagged if its p-value is below this value. The p-value is that of the hypothesis
# that the machine belongs to the population. If all machines belong to the population, the
# probability that any machine is flagged is at most this value.
_FALSE_ALARMS = 0.05
# Pattern of the names of compliances at the reference force, such as C_XXX. It does not match the
# names of slopes, which describe how a compliance changes with force.
_CONSTANT_COMPLIANCE = re.compile(r"C_...")
# Text of empty cells in the printed table of a population's parameters.
_NOTHING = "–"


class _DrawLimits(NamedTuple):
    """Limits of the number of random draws of a population's spreads.

    A spread is the standard deviation of a parameter from machine to machine.
    """

    #: upper limit of a product: the number of machines, multiplied by the number of random draws of
    #: the spreads. At least ``lowest`` draws are made, even if the product then exceeds the limit.
    pairs: int
    #: smallest number of random draws of the spreads, however many machines there are
    lowest: int
    #: largest number of random draws of the spreads (standard deviations from machine to machine),
    #: however few machines there are
    highest: int

    def size(self, machines: int) -> int:
        """Return the number of random draws of the spreads for a given number of machines.

        A spread is the standard deviation of a parameter from machine to machine. The number of
        draws is a power of two between ``lowest`` and ``highest``. Within these limits, it is the
        largest one whose product with the number of machines is at most ``pairs``.
        """
        count = min(max(self.pairs / machines, self.lowest), self.highest)
        return int(2 ** int(np.log2(count)))


# Limits of the number of random draws that are made to estimate the spreads of a population
# (standard deviations from machine to machine).
_SPREAD_DRAWS = _DrawLimits(pairs=4_000_000, lowest=2048, highest=8192)
# Limits of the number of random draws of the spreads (standard deviations from machine to machine)
# that are used to estimate the parameters of each machine.
_MACHINE_DRAWS = _DrawLimits(pairs=1_000_000, lowest=256, highest=2048)


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
            if _CONSTANT_COMPLIANCE.fullmatch(name):
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


@with_words.register
def _population_record(result: Population) -> dict[str, Any]:
    """Return the content of the file population.json.

    The file holds the results, sentences on their limitations, and the SHA-256 digest of both.
    """
    record = result.as_dict() | {"doubts": list(population_doubts(result))}
    return {**record, "sha256": digest_of(json.loads(json_text(record)))}


@parts_of.register
def _population_parts(result: Population) -> tuple[Table | str, ...]:
    """Return what ``print`` shows of a population: a table of its parameters, then sentences.

    The table has one row for each parameter. The sentences state the findings and the limitations.
    """
    heads = (
        "parameter",
        "unit",
        "mean",
        "U of the bar",
        "spread",
        f"spread, {100 * result.prob:g} %",
        "next machine",
    )
    rows = [_table_row(name, parameter) for name, parameter in result.parameters.items()]
    table = Table.of("Population", heads, rows, text=("unit",))
    passages: list[Table | str] = [table, PAGE["population"], ""]
    passages += population_sentences(result)
    passages += population_doubts(result)
    return tuple(passages)


def _table_row(name: str, parameter: PooledParameter) -> list[str]:
    """Return the cells of one parameter's row in the printed table of a population.

    The cells are

    - the name and the unit of the parameter;
    - the mean of the population ± U, and the part of U that is due to the instrument;
    - the spread (standard deviation from machine to machine) and its credible interval;
    - the prediction for a further machine ± U.

    U is the expanded uncertainty (k = 2). For a skewed quantity, an interval is stated instead of
    the mean ± U.
    """
    factor, unit = display_unit(parameter.unit)
    common = _NOTHING
    if parameter.instrument_sd > 0.0:
        common = round_uncertainty(2.0 * parameter.instrument_sd * factor)[0]
    spread = parameter.spread
    stated_spread = state(spread.mean, spread.sd, spread.interval, parameter.unit)
    return [
        display_name(name),
        unit,
        _without_unit(parameter.mean, parameter.unit),
        common,
        stated_spread.value,
        stated_spread.interval,
        _without_unit(parameter.next, parameter.unit),
    ]


def _without_unit(summary: Summary, unit: str) -> str:
    """Return the mean and uncertainty of a distribution as text, without the name of the unit.

    ``unit`` is the internal unit of the distribution, such as mm/N. The numbers are converted to
    the unit that tables show, such as nm/N.
    """
    _, shown_unit = display_unit(unit)
    stated = plus_minus(summary.mean, summary.sd, summary.interval, unit)
    return stated.removesuffix(f" {shown_unit}")


@renamed_keyword("ci_prob", "prob")
def fit_population(
    rows: pd.DataFrame,
    *,
    parameters: Sequence[str] | None = None,
    exclude: Sequence[str] = (),
    since: str | None = None,
    include_misfits: bool = False,
    reference_force_N: float | None = None,
    spread_scale: float = 0.3,
    one_instrument: bool = True,
    prob: float = 0.95,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Population:
    """Estimate the mean and the spread of each parameter over the machines of a batch.

    The result also predicts the parameters of a further machine, and states which machines do not
    belong to the population.

    Parameters
    ----------
    rows : DataFrame
        Table of a batch that `read_batch` returns, one row per campaign. Every campaign without
        machine_id is treated as the only campaign of a separate machine.
    parameters : sequence of str, optional
        Names of the parameters to analyse. Default: all compliances at the reference force.
    exclude : sequence of str
        Campaigns and machines to leave out. A campaign is identified by its path as in the table,
        by the last part of this path or by its name; a machine is identified by its machine_id.
    since : str, optional
        Date (ISO 8601); campaigns that are earlier or have no date are left out.
    include_misfits : bool
        Whether to keep campaigns whose readings do not fit the model.
    reference_force_N : float, optional
        Force for which the compliances are given [N]. Default: the median of the campaigns'
        reference forces.
    spread_scale : float
        Scale of the prior of each parameter's spread (standard deviation from machine to machine).
        The prior is HalfNormal(spread_scale · sd), where sd is the reference standard deviation of
        the parameter. This reference is the larger of two values: the standard deviation of the
        parameter's default prior, and the median of its prior standard deviations in the fits of
        the campaigns.
    one_instrument : bool
        Whether all campaigns used the same bar. If so, the errors of the mount's deflection and of
        the force are the same in all campaigns and do not average out.
    prob : float
        Probability of the credible intervals.
    seed : int
        Seed of the random draws.
    progress : callable, optional
        Function ``progress(done, total)`` that is called while machines are compared with one
        another. ``total`` is the number of machines whose comparison with the others needs new
        random draws, and ``done`` is the number of these comparisons that are finished.

    Returns
    -------
    Population
        Mean and spread of every parameter, the prediction for a further machine, and the estimates
        for each machine.

    Raises
    ------
    InputError
        If the rows are not those of a batch, no campaign is left, there are fewer than two
        machines, the machines differ in their joints, or an option is out of range.

    Examples
    --------
    >>> population = lb.fleet.fit_population(rows)
    >>> list(population.parameters)
    ['C_XXX', 'C_XYX', 'C_YYY', 'C_CXY', 'C_CYY', 'C_CCY']
    >>> len(population.machine)
    2
    """
    check_probability(prob)
    if not 0.0 < spread_scale < np.inf:
        raise InputError(
            f"spread_scale must be a finite number above zero, got {spread_scale}. The default is"
            " 0.3."
        )
    used_rows, caveats = choose(rows, exclude, since, include_misfits)
    statistics = fleet_statistics(
        used_rows,
        parameters=parameters,
        reference_force_N=reference_force_N,
        one_instrument=one_instrument,
    )
    if len(set(statistics.machines)) < 2:
        advice = " ".join(("Add campaigns of others.", *map(caveat_words, caveats)))
        raise InputError(
            "a population must have at least two machines, got only"
            f" {statistics.machines[0]}. {advice}"
        )
    pooled = pool(statistics, spread_scale=spread_scale, prob=prob, seed=seed, progress=progress)
    lacks_id = [not isinstance(machine_id, str) for machine_id in used_rows["machine_id"]]
    if any(lacks_id):
        caveats.append(Caveat(CaveatKind.MACHINES_OF_THEIR_OWN, tuple(labels(used_rows[lacks_id]))))
    readings = tuple(digest for digest in used_rows["sha256"] if isinstance(digest, str))
    return replace(pooled, caveats=(*caveats, *pooled.caveats), readings=readings)


@one_blas_thread
def pool(
    statistics: FleetStatistics,
    *,
    spread_scale: float = 0.3,
    prob: float = 0.95,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Population:
    """Estimate the mean of each parameter over machines, and its standard deviation (spread).

    If there are at least six machines, each machine is also compared with the others. Unlike
    `fit_population`, this function does not check its arguments: the estimate is also made for a
    single machine, without an error. The result lacks what `fit_population` adds to it: the caveats
    on the choice of the campaigns, and the digests of the readings.

    Parameters
    ----------
    statistics : likelihoods of the campaigns, which should come from at least two machines.
    spread_scale, prob, seed, progress
        The same arguments as those of `fit_population`.
    """
    machines, likelihood = machine_likelihoods(statistics)
    density = SpreadDensity(likelihood, spread_scale)
    tails = (0.5 - 0.5 * prob, 0.5 + 0.5 * prob)
    spreads = draw_spreads(
        density,
        len(statistics.parameters),
        seed=seed,
        size=_SPREAD_DRAWS.size(len(machines)),
    )
    first_spreads = spreads.first(_MACHINE_DRAWS.size(len(machines)))
    shared = shared_quantities(likelihood, first_spreads.spread)
    parameters = _pool_parameters(statistics, spreads, first_spreads, shared, tails)
    judged = None
    if len(machines) >= _FEWEST_MACHINES:
        judged = judge_machines(density, first_spreads, shared, seed=seed, progress=progress)
    pooled_machines = _pool_machines(
        statistics, machines, likelihood, first_spreads, shared, judged, tails
    )
    return Population(
        parameters=parameters,
        machine=pooled_machines,
        campaigns=len(statistics),
        reference_force_N=statistics.reference_force_N,
        forces_N=statistics.forces_N,
        topology=statistics.topology,
        compliances=statistics.compliances,
        instrument=statistics.instrument,
        spread_scale=spread_scale,
        seed=seed,
        pareto_k=spreads.pareto_k,
        trusted=spreads.trusted,
        caveats=tuple(_population_caveats(statistics, parameters, spreads, judged, machines)),
        prob=prob,
        judged=judged is not None and not judged.doubtful.any(),
    )


class _Moments(NamedTuple):
    """Means, sds and credible intervals of c parameters, in units of their prior sds.

    For n machines with c parameters each, the arrays have a row for every machine.
    """

    #: mean of each of c parameters, in units of its prior sd; shape (c,) for a population, (n, c)
    #: for n machines
    mean: Array
    #: standard deviation of each of c parameters, in units of its prior sd; shape (c,) for a
    #: population, (n, c) for n machines
    sd: Array
    #: lower and upper ends of the credible intervals of c parameters, in units of their prior sds;
    #: shape (2, c) for a population, (2, n, c) for n machines
    interval: Array


def _average_over_draws(
    weight: Array, mean: Array, sd: Array, tails: tuple[float, float]
) -> _Moments:
    """Return mean, sd and credible interval of c parameters, averaged over draws of the spreads.

    Spreads are the standard deviations from machine to machine. ``weight``, shape (k,), holds the
    weights of k random draws of the spreads. For each draw, every parameter has a Gaussian
    distribution with the mean ``mean`` and the standard deviation ``sd``, shape (k, c), or (k, n,
    c) for n machines. ``tails`` are the cumulative probabilities of the two ends of the credible
    intervals.
    """
    mixture_mean, mixture_sd = mixture_moments(weight, mean, sd)
    return _Moments(mixture_mean, mixture_sd, mixture_quantiles(weight, mean, sd, tails))


def _summarize(scale: Array, moments: _Moments) -> list[Summary]:
    """Return mean, sd and interval of each of c parameters, in internal units (mm, N, rad).

    ``scale``, shape (c,), holds the prior sds of the parameters in internal units. ``moments``
    holds the means, sds and credible intervals in units of these prior sds.
    """
    mean = (scale * moments.mean).tolist()
    sd = (scale * moments.sd).tolist()
    low = (scale * moments.interval[0]).tolist()
    high = (scale * moments.interval[1]).tolist()
    return [Summary(mean[j], sd[j], (low[j], high[j])) for j in range(len(scale))]


def _pool_parameters(
    statistics: FleetStatistics,
    spreads: Spreads,
    first_spreads: Spreads,
    shared: Gaussian,
    tails: tuple[float, float],
) -> dict[str, PooledParameter]:
    """Return the mean, spread and prediction of every parameter of the population.

    The result is a dict; its keys are the names of the parameters. The mean is taken over the
    machines, the spread is the standard deviation of the machines about the mean, and the
    prediction is for a further machine.

    Parameters
    ----------
    statistics
        Likelihoods of the campaigns.
    spreads
        Random draws of the spreads (standard deviations of the machines about their mean).
    first_spreads
        The first of these draws. The mean and the prediction are computed from the first draws
        only.
    shared
        Gaussian distribution of the population's mean and the instrument's errors, for each draw in
        ``first_spreads``.
    tails
        Cumulative probabilities of the two ends of the credible intervals.
    """
    c = len(statistics.parameters)
    scale = statistics.prior_sd[:c]
    weight = first_spreads.weight
    mean = shared.mean[:, :c]
    sd = shared.sd[:, :c]
    population_mean = _average_over_draws(weight, mean, sd, tails)
    next_machine = _average_over_draws(weight, mean, np.hypot(sd, first_spreads.spread), tails)
    spread_mean, spread_sd = mixture_moments(
        spreads.weight, spreads.spread, np.zeros_like(spreads.spread)
    )
    spread_interval = weighted_quantiles(spreads.weight, spreads.spread, tails)
    mean_summaries = _summarize(scale, population_mean)
    spread_summaries = _summarize(scale, _Moments(spread_mean, spread_sd, spread_interval))
    next_summaries = _summarize(scale, next_machine)
    instrument_sd = scale * _instrument_sd(statistics, weight, shared, sd)
    pooled = {}
    for j, name in enumerate(statistics.parameters):
        pooled[name] = PooledParameter(
            unit=statistics.units[j],
            prior_sd=float(scale[j]),
            mean=mean_summaries[j],
            spread=spread_summaries[j],
            next=next_summaries[j],
            instrument_sd=float(instrument_sd[j]),
        )
    return pooled


def _instrument_sd(
    statistics: FleetStatistics, weight: Array, shared: Gaussian, sd: Array
) -> Array:
    """Return the uncertainty of the population's mean that is due to the instrument's errors.

    The result has one element for each of c parameters, shape (c,), in units of the parameter's
    prior sd.

    Parameters
    ----------
    statistics
        Likelihoods of the campaigns.
    weight
        Weights of k random draws of the machines' spreads (standard deviations about their mean),
        shape (k,).
    shared
        Gaussian distribution of the population's mean and the instrument's errors, for each draw.
    sd
        Standard deviations of the population's mean for each draw, shape (k, c).
    """
    c = len(statistics.parameters)
    if not statistics.instrument:
        return np.zeros(c)
    # Covariance that the population's mean would have if the instrument's errors were known.
    covariance_if_known = np.linalg.inv(shared.precision[:, :c, :c])
    variance_if_known = np.diagonal(covariance_if_known, axis1=1, axis2=2)
    variance_of_errors = (sd**2 - variance_if_known).clip(min=0.0)
    return np.asarray(np.sqrt(weight @ variance_of_errors))


def _pool_machines(
    statistics: FleetStatistics,
    machines: Sequence[str],
    likelihood: Gaussian,
    spreads: Spreads,
    shared: Gaussian,
    judged: JudgedMachines | None,
    tails: tuple[float, float],
) -> dict[str, PooledMachine]:
    """Return the estimates for every machine, and its comparison with the other machines.

    The result is a dict; its keys are the names of the machines. A machine has two sets of
    estimates: the attribute ``estimate`` uses the population, and the attribute ``alone`` uses only
    the campaigns of the machine itself.

    Parameters
    ----------
    statistics
        Likelihoods of the campaigns.
    machines
        Name of each machine, see `PooledMachine`.
    likelihood
        Likelihoods of the machines.
    spreads
        Random draws of the spreads (standard deviations of the machines about their mean).
    shared
        Gaussian distribution of the population's mean and the instrument's errors, for each draw.
    judged
        Comparison of each machine with the other machines; None if there are too few machines.
    tails
        Cumulative probabilities of the two ends of the credible intervals.
    """
    names = statistics.parameters
    scale = statistics.prior_sd[: len(names)]
    estimates = machine_estimates(likelihood, spreads.spread, shared)
    pooled = _average_over_draws(spreads.weight, estimates.mean, estimates.sd, tails)
    separate = _estimate_machines_separately(likelihood, len(names), spreads.weight, shared, tails)
    campaigns = Counter(statistics.machines)
    by_name = {}
    for m, machine in enumerate(machines):
        by_name[machine] = PooledMachine(
            name=machine,
            campaigns=campaigns[machine],
            estimate=dict(
                zip(names, _summarize(scale, _moments_of_machine(pooled, m)), strict=True)
            ),
            alone=dict(
                zip(names, _summarize(scale, _moments_of_machine(separate, m)), strict=True)
            ),
        )
        if judged is not None:
            p_value = float(judged.p_value[m])
            by_name[machine] = replace(
                by_name[machine],
                p_value=p_value,
                flag=p_value < _FALSE_ALARMS,
                z=dict(zip(names, judged.z[m].tolist(), strict=True)),
            )
    return by_name


def _moments_of_machine(moments: _Moments, m: int) -> _Moments:
    """Return mean, sd and credible interval of each parameter of the machine with index ``m``."""
    return _Moments(moments.mean[m], moments.sd[m], moments.interval[:, m])


def _estimate_machines_separately(
    likelihood: Gaussian,
    parameters: int,
    weight: Array,
    shared: Gaussian,
    tails: tuple[float, float],
) -> _Moments:
    """Return the posterior means and sds of the c parameters of n machines, shape (n, c) each.

    Each machine is estimated from its own campaigns only. The errors of the instrument, however,
    are estimated from the campaigns of all machines. The result also holds credible intervals. All
    values are in units of the prior sds.

    Parameters
    ----------
    likelihood
        Likelihoods of the machines.
    parameters
        Number c of parameters.
    weight
        Weights of k random draws of the machines' spreads (standard deviations about their mean),
        shape (k,).
    shared
        Gaussian distribution of the population's mean and the instrument's errors, for each draw.
    tails
        Cumulative probabilities of the two ends of the credible intervals.
    """
    c = parameters
    b_mean, b_covariance = mixture_covariance(
        weight, shared.mean[:, c:], shared.covariance[:, c:, c:]
    )
    separate = estimate_separately(likelihood, c)
    response = separate.response[..., c:]
    mean = separate.value - response @ b_mean
    covariance = separate.covariance + response @ b_covariance @ np.swapaxes(response, 1, 2)
    sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return _Moments(mean, sd, mean + ndtri(tails)[:, None, None] * sd)


def _population_caveats(
    statistics: FleetStatistics,
    parameters: Mapping[str, PooledParameter],
    spreads: Spreads,
    judged: JudgedMachines | None,
    machines: Sequence[str],
) -> list[Caveat]:
    """Return the limitations of a population that its user must know.

    ``statistics`` holds the likelihoods of the campaigns, and ``spreads`` the random draws of the
    machines' spreads (standard deviations about their mean). ``parameters`` are the distributions
    of the parameters over the machines. ``judged`` is the comparison of each machine with the other
    machines, or None if there are too few machines. ``machines`` are the names of all machines.
    """
    caveats = list(statistics.caveats)
    if not spreads.trusted:
        values = (spreads.pareto_k, spreads.good_k)
        caveats.append(Caveat(CaveatKind.SPREADS_NOT_TRUSTED, values=values))
    if statistics.instrument:
        caveats.append(_instrument_caveat(statistics, parameters))
    if judged is None:
        values = (len(machines), _FEWEST_MACHINES)
        caveats.append(Caveat(CaveatKind.FEW_MACHINES, values=values))
    elif judged.doubtful.any():
        names = tuple(machines[m] for m in np.flatnonzero(judged.doubtful).tolist())
        caveats.append(Caveat(CaveatKind.UNCERTAIN_P_VALUES, names))
    return caveats


def _instrument_caveat(
    statistics: FleetStatistics, parameters: Mapping[str, PooledParameter]
) -> Caveat:
    """Return the caveat (limitation) that all campaigns used the same instrument.

    The caveat names the parameter whose population mean is most affected by the instrument's
    errors. It also states the percentage of the variance of this mean that is due to these errors.
    ``parameters`` are the distributions of the parameters over the machines, and ``statistics``
    names the errors.
    """
    shares = {}
    for name, parameter in parameters.items():
        shares[name] = 100.0 * (parameter.instrument_sd / parameter.mean.sd) ** 2
    largest = ranked(shares, lambda name: shares[name])[0]
    errors = ", ".join(nuisance_words(name) for name in statistics.instrument)
    return Caveat(CaveatKind.ONE_INSTRUMENT, (largest,), (min(100.0, shares[largest]),), errors)
