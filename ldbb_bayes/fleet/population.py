"""c_m ~ N(μ, diag(s²)), b ~ N(0, I), μ_j ~ N(0, 1), s_j ~ HalfNormal(spread_scale), all in units of
the parameters' prior sd.

c_m are the parameters of machine m, the same in all its campaigns; b the errors of the one
instrument. What the campaigns say of both is Gaussian (`FleetStatistics`), so that everything but s
is integrated out exactly: every machine's deviation from μ for many s at once, then x = (μ, b); ln
s is drawn about its mode and weighted. A machine is compared with what the others predict of it,
everything but their spread integrated out.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field
from scipy.special import ndtri

from ldbb_bayes.errors import require
from ldbb_bayes.fleet.campaign_statistics import mixture_covariance
from ldbb_bayes.fleet.compliance_meaning import Meaning
from ldbb_bayes.fleet.deviations import estimate_separately
from ldbb_bayes.fleet.fleet_statistics import FleetStatistics, fleet_statistics
from ldbb_bayes.fleet.interval_summary import Summary, keyed
from ldbb_bayes.fleet.outlying_machines import Belonging, belonging_of
from ldbb_bayes.fleet.population_prior import digest_of
from ldbb_bayes.fleet.selection import Caveat, CaveatKind, choose, labels
from ldbb_bayes.fleet.spread_density import (
    SpreadDensity,
    Spreads,
    common_of,
    draw_spreads,
    estimates_of,
    machines_of,
)
from ldbb_bayes.inference.summary import check_probability
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

__all__ = ["PooledMachine", "PooledParameter", "Population", "pool", "population"]

FEWEST = 6
FALSE_ALARMS = 0.05

# ---- machines of a population, everything but their spreads integrated out


# ---- which machines do not belong


# ---- what is found


@dataclass(frozen=True)
class PooledParameter(Result):
    """One parameter over the machines."""

    unit: str
    prior_sd: float  #: of what was believed of the mean of the population, about zero
    mean: Summary  #: of the population
    spread: Summary  #: standard deviation of the machines about it
    next: Summary  #: a machine of the population that was not measured
    #: part of the sd of the mean that comes with the one instrument: more machines do not make it
    #: less
    instrument_sd: float


@dataclass(frozen=True)
class PooledMachine(Result):
    """One machine. ``p_value`` is, at most, that of so many machines of one population a parameter
    of one stands out so much from the others (Bonferroni over parameters, Holm over machines); none
    with too few machines."""

    name: Annotated[str, Field(exclude=True)]
    campaigns: int
    estimate: dict[str, Summary]  #: with what the population tells of it
    #: from its campaigns and the prior of a fit, the instrument's errors as all campaigns know
    #: them
    alone: dict[str, Summary]
    p_value: float | None = None
    flag: bool = False  #: the p-value is below 5 %
    #: of each parameter, against what the other machines predict
    z: dict[str, float] = field(default_factory=dict)


_CONSTANT = re.compile(r"C_...")


@dataclass(frozen=True, eq=False)
class Population(Result):
    """Machines of one kind, partially pooled; only where all could be ``judged`` none standing out
    means that."""

    parameters: dict[str, PooledParameter]  #: mean, spread and next machine, by name
    machine: dict[str, PooledMachine]  #: by machine_id
    campaigns: int  #: their number
    reference_force_N: float  #: at which compliances are meant
    forces_N: tuple[float, float]  #: lowest and highest tested in all campaigns
    topology: str  #: of the machines
    compliances: Mapping[str, Meaning]  #: what they stand for, where the batch says it
    instrument: tuple[str, ...]  #: errors taken as common to all campaigns
    spread_scale: float  #: prior of a spread: HalfNormal(spread_scale · prior_sd)
    seed: int  #: of the draws
    pareto_k: float  #: of the weights of the spreads, the lower the better
    trusted: bool  #: whether that is low enough
    caveats: tuple[Caveat, ...]  #: what to mind
    ci_prob: Annotated[float, Field(exclude=True)]  #: of the intervals
    judged: Annotated[bool, Field(exclude=True)]
    #: so that no campaign takes its prior from itself
    readings: Annotated[tuple[str, ...], Field(alias="readings_sha256")] = ()

    @property
    def not_belonging(self) -> tuple[str, ...]:
        """Machines that stand out from the others, the worst first."""
        flagged = sorted(own.name for own in self.machine.values() if own.flag)
        return tuple(ranked(flagged, lambda name: max(map(abs, self.machine[name].z.values()))))

    def as_dict(self) -> dict[str, Any]:
        """For JSON: population.json; ``next`` is what `prior_from` reads."""
        following = {
            name: {"unit": own.unit, "mean": own.next.mean, "sd": own.next.sd}
            for name, own in self.parameters.items()
            if _CONSTANT.fullmatch(name)
        }
        found = {
            "schema": 1,
            "kind": "population",
            "machines": len(self.machine),
            **keyed(super().as_dict(), self.ci_prob),
        }
        return found | {"next": following, "not_belonging": list(self.not_belonging)}

    def machines_table(self) -> pd.DataFrame:
        """One row per machine, inside units."""
        rows: dict[str, dict[str, Any]] = {}
        for name, own in self.machine.items():
            rows[name] = {what: getattr(own, what) for what in ("campaigns", "p_value", "flag")}
            for parameter, one in own.estimate.items():
                by_itself = own.alone[parameter]
                numbers = (
                    one.mean,
                    one.sd,
                    *one.interval,
                    by_itself.mean,
                    by_itself.sd,
                    own.z.get(parameter),
                )
                heads = ("mean", "sd", "ci_low", "ci_high", "alone_mean", "alone_sd", "z")
                rows[name] |= {
                    f"{parameter}.{head}": value for head, value in zip(heads, numbers, strict=True)
                }
        return readable(pd.DataFrame.from_dict(rows, orient="index").rename_axis("machine"))


@with_words.register
def _in_words(found: Population) -> dict[str, Any]:
    record = found.as_dict() | {"doubts": list(population_doubts(found))}
    return {**record, "sha256": digest_of(json.loads(json_text(record)))}


@parts_of.register
def _parts(found: Population) -> tuple[Table | str, ...]:
    """A row per parameter with its unit, then what to mind."""
    rows = []
    for name, own in found.parameters.items():
        factor, unit = display_unit(own.unit)
        whole = (
            plus_minus(one.mean, one.sd, one.interval, own.unit) for one in (own.mean, own.next)
        )
        mean, following = (text.removesuffix(f" {unit}") for text in whole)
        common = (
            round_uncertainty(2.0 * own.instrument_sd * factor)[0]
            if own.instrument_sd > 0.0
            else "–"
        )
        spread = state(own.spread.mean, own.spread.sd, own.spread.interval, own.unit)
        rows.append(
            (display_name(name), unit, mean, common, spread.value, spread.interval, following)
        )
    heads = (
        "parameter",
        "unit",
        "mean",
        "U of the bar",
        "spread",
        f"spread, {100 * found.ci_prob:g} %",
        "next machine",
    )
    table = Table.of("Population", heads, rows, text=("unit",))
    return (table, PAGE["population"], "", *population_sentences(found), *population_doubts(found))


def _summaries(scale: Array, mean: Array, sd: Array, ends: Array) -> list[Summary]:
    """Of every parameter, arrays of shape (c,), ends (2, c), in inside units."""
    parts = ((scale * part).tolist() for part in (mean, sd, *ends))
    return [Summary(m, u, (a, b)) for m, u, a, b in zip(*parts, strict=True)]


def _mixture(
    weight: Array, mean: Array, sd: Array, tails: tuple[float, float]
) -> tuple[Array, Array, Array]:
    return (*mixture_moments(weight, mean, sd), mixture_quantiles(weight, mean, sd, tails))


def _pooled_parameters(
    statistics: FleetStatistics,
    spreads: Spreads,
    few: Spreads,
    common: Gaussian,
    tails: tuple[float, float],
) -> dict[str, PooledParameter]:
    """μ and the next machine from conditional Gaussians, s from its draws; ``few`` are the first,
    ``common`` is theirs."""
    c = len(statistics.parameters)
    weight = few.weight
    scale = statistics.prior_sd[:c]
    mean = common.mean[:, :c]
    sd = common.sd[:, :c]
    mu, following = (_mixture(weight, mean, own, tails) for own in (sd, np.hypot(sd, few.spread)))
    moments = mixture_moments(spreads.weight, spreads.spread, np.zeros_like(spreads.spread))
    known = np.diagonal(np.linalg.inv(common.precision[:, :c, :c]), axis1=1, axis2=2)
    shared = np.sqrt(weight @ (sd**2 - known).clip(min=0.0)) * bool(statistics.instrument)
    parts = [
        _summaries(scale, *own)
        for own in (
            mu,
            (*moments, weighted_quantiles(spreads.weight, spreads.spread, tails)),
            following,
        )
    ]
    rows = zip(
        statistics.parameters,
        statistics.units,
        scale.tolist(),
        *parts,
        (scale * shared).tolist(),
        strict=True,
    )
    return {name: PooledParameter(*own) for name, *own in rows}


def _pooled_machines(
    statistics: FleetStatistics,
    machines: Sequence[str],
    likelihood: Gaussian,
    spreads: Spreads,
    common: Gaussian,
    belonging: Belonging | None,
    tails: tuple[float, float],
) -> dict[str, PooledMachine]:
    """Every machine with the population, alone, and against the others."""
    names = statistics.parameters
    c = len(statistics.parameters)
    weight = spreads.weight
    mean, sd, _, _ = estimates_of(likelihood, spreads.spread, common)
    b, covariance = mixture_covariance(weight, common.mean[:, c:], common.covariance[:, c:, c:])
    inverse, seen, estimate = estimate_separately(likelihood, c)
    gain = seen[..., c:]
    middle = estimate - gain @ b
    width = np.sqrt(
        np.diagonal(inverse + gain @ covariance @ np.swapaxes(gain, 1, 2), axis1=1, axis2=2)
    )
    pooled = _mixture(weight, mean, sd, tails)
    by_itself = (middle, width, middle + ndtri(tails)[:, None, None] * width)
    campaigns = Counter(statistics.machines)
    found = {}
    for m, name in enumerate(machines):
        together, apart = (
            dict(
                zip(
                    names,
                    _summaries(statistics.prior_sd[:c], own[0][m], own[1][m], own[2][:, m]),
                    strict=True,
                )
            )
            for own in (pooled, by_itself)
        )
        judged: dict[str, Any] = {}
        if belonging is not None:
            value = float(belonging.p_value[m])
            z = dict(zip(names, belonging.z[m].tolist(), strict=True))
            judged = {"p_value": value, "flag": value < FALSE_ALARMS, "z": z}
        found[name] = PooledMachine(name, campaigns[name], together, apart, **judged)
    return found


def _caveats(
    statistics: FleetStatistics,
    parameters: Mapping[str, PooledParameter],
    spreads: Spreads,
    belonging: Belonging | None,
    machines: Sequence[str],
) -> Iterator[Caveat]:
    yield from statistics.caveats
    if not spreads.trusted:
        yield Caveat(CaveatKind.SPREADS_NOT_TRUSTED, values=(spreads.pareto_k, spreads.good_k))
    if statistics.instrument:
        shares = {
            name: 100.0 * (own.instrument_sd / own.mean.sd) ** 2 for name, own in parameters.items()
        }
        most = ranked(shares, lambda name: shares[name])[0]
        errors = ", ".join(map(nuisance_words, statistics.instrument))
        yield Caveat(CaveatKind.ONE_INSTRUMENT, (most,), (min(100.0, shares[most]),), errors)
    if belonging is None:
        yield Caveat(CaveatKind.FEW_MACHINES, values=(len(machines), FEWEST))
        return
    if belonging.doubtful.any():
        names = tuple(name for name, own in zip(machines, belonging.doubtful, strict=True) if own)
        yield Caveat(CaveatKind.UNCERTAIN_P_VALUES, names)


def population(
    rows: pd.DataFrame,
    *,
    parameters: Sequence[str] | None = None,
    exclude: Sequence[str] = (),
    since: str | None = None,
    include_misfits: bool = False,
    reference_force_N: float | None = None,
    spread_scale: float = 0.3,
    one_instrument: bool = True,
    ci_prob: float = 0.95,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Population:
    """The population that the machines of a batch come from, the next machine, and which machines
    do not belong.

    InputError for rows that are no batch's, fewer than two machines, machines with other joints, or
    options out of range.

    Parameters
    ----------
    rows : of `read_batch`: one row per campaign; campaigns without machine_id count as machines of
        their own. Which of them count, and ``exclude``, ``since`` and ``include_misfits``: see
        `choose`.
    parameters, reference_force_N, one_instrument
        See `fleet_statistics`; default: all constant compliances at the median of the campaigns'
        forces, one bar.
    spread_scale : prior of each spread: HalfNormal(spread_scale · default prior sd of the
        parameter), see `reference_sd`.
    ci_prob : float
    seed : int
    progress : told of machines that are left out by drawing anew: done and total.
    """
    check_probability(ci_prob)
    said = (
        f"spread_scale must be a finite number above zero, got {spread_scale}. The default is 0.3."
    )
    require(0.0 < spread_scale < np.inf, said)
    relied, caveats = choose(rows, exclude, since, include_misfits)
    statistics = fleet_statistics(
        relied,
        parameters=parameters,
        reference_force_N=reference_force_N,
        one_instrument=one_instrument,
    )
    why = " ".join(("Add campaigns of others.", *map(caveat_words, caveats)))
    several = len(set(statistics.machines)) > 1
    require(
        several,
        f"a population must have at least two machines, got only {statistics.machines[0]}. {why}",
    )
    found = pool(
        statistics, spread_scale=spread_scale, ci_prob=ci_prob, seed=seed, progress=progress
    )
    nameless = ~relied["machine_id"].map(lambda own: isinstance(own, str)).astype(bool)
    if nameless.any():
        caveats.append(Caveat(CaveatKind.MACHINES_OF_THEIR_OWN, tuple(labels(relied[nameless]))))
    readings = tuple(str(own) for own in relied["sha256"] if isinstance(own, str))
    return replace(found, caveats=(*caveats, *found.caveats), readings=readings)


# Draws of s, a power of two, as many as so many pairs of draw and machine allow: of the spreads
# themselves, of every machine.
_SPREADS = (4_000_000, 2048, 8192)
_MACHINES = (1_000_000, 256, 2048)


@one_blas_thread
def pool(
    statistics: FleetStatistics,
    *,
    spread_scale: float = 0.3,
    ci_prob: float = 0.95,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Population:
    """The same from statistics of at least two machines; options as for `population`."""
    machines, likelihood = machines_of(statistics)
    sizes = [
        2 ** int(np.log2(min(max(pairs / len(machines), fewest), most)))
        for pairs, fewest, most in (_SPREADS, _MACHINES)
    ]
    density = SpreadDensity(likelihood, spread_scale)
    tails = (0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob)
    spreads = draw_spreads(density, len(statistics.parameters), seed=seed, size=sizes[0])
    few = spreads.first(sizes[1])
    common = common_of(likelihood, few.spread)
    parameters = _pooled_parameters(statistics, spreads, few, common, tails)
    belonging = (
        belonging_of(density, few, common, seed=seed, progress=progress)
        if len(machines) >= FEWEST
        else None
    )
    return Population(
        parameters=parameters,
        machine=_pooled_machines(statistics, machines, likelihood, few, common, belonging, tails),
        campaigns=len(statistics),
        **{
            key: getattr(statistics, key)
            for key in ("reference_force_N", "forces_N", "topology", "compliances", "instrument")
        },
        spread_scale=spread_scale,
        seed=seed,
        pareto_k=spreads.pareto_k,
        trusted=spreads.trusted,
        caveats=tuple(_caveats(statistics, parameters, spreads, belonging, machines)),
        ci_prob=ci_prob,
        judged=belonging is not None and not belonging.doubtful.any(),
    )


# ---- the prior of one more machine
