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

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.special import ndtri

from ldbb_bayes.deprecation import renamed_keyword
from ldbb_bayes.errors import InputError, check_probability
from ldbb_bayes.fleet.campaign_statistics import mixture_covariance
from ldbb_bayes.fleet.dataset import READINGS_DIGESTS
from ldbb_bayes.fleet.deviations import estimate_separately
from ldbb_bayes.fleet.fleet_statistics import FleetStatistics, fleet_statistics
from ldbb_bayes.fleet.interval_summary import Summary
from ldbb_bayes.fleet.outlying_machines import JudgedMachines, judge_machines
from ldbb_bayes.fleet.population import PooledMachine, PooledParameter, Population
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
from ldbb_bayes.report.wording import caveat_words, nuisance_words
from ldbb_bayes.results import Array
from ldbb_bayes.units import ranked

__all__ = ["fit_population", "pool"]

# The machines of a population are compared with one another if there are at least this many.
_FEWEST_MACHINES = 6
# A machine is flagged if its p-value is below this value. The p-value is that of the hypothesis
# that the machine belongs to the population. If all machines belong to the population, the
# probability that any machine is flagged is at most this value.
_FALSE_ALARMS = 0.05


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
    with_conditions, without_conditions = READINGS_DIGESTS
    return replace(
        pooled,
        caveats=(*caveats, *pooled.caveats),
        readings=_texts_in(used_rows, with_conditions),
        circles=_texts_in(used_rows, without_conditions),
    )


def _texts_in(rows: pd.DataFrame, column: str) -> tuple[str, ...]:
    """Return the texts in a column of a table, without empty cells; none without the column."""
    if column not in rows:
        return ()
    return tuple(cell for cell in rows[column] if isinstance(cell, str))


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
        density, len(statistics.parameters), seed=seed, size=_SPREAD_DRAWS.size(len(machines))
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
            estimate=_summaries_of_machine(names, scale, pooled, m),
            alone=_summaries_of_machine(names, scale, separate, m),
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


def _summaries_of_machine(
    names: Sequence[str], scale: Array, moments: _Moments, m: int
) -> dict[str, Summary]:
    """Return mean, sd and interval of each parameter of the machine with index ``m``, by name.

    ``names`` are the names of the parameters, and ``scale`` their prior sds in internal units.
    ``moments`` holds the moments of all machines in units of these prior sds.
    """
    of_machine = _Moments(moments.mean[m], moments.sd[m], moments.interval[:, m])
    return dict(zip(names, _summarize(scale, of_machine), strict=True))


def _estimate_machines_separately(
    likelihood: Gaussian,
    parameters: int,
    weight: Array,
    shared: Gaussian,
    tails: tuple[float, float],
) -> _Moments:
    """Return mean, sd and credible interval of the c parameters of n machines, each by itself.

    Each machine is estimated from its own campaigns only. The errors of the instrument, however,
    are estimated from the campaigns of all machines. All values are in units of the prior sds.

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
