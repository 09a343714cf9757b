"""c_m ~ N(μ, diag(s²)), b ~ N(0, diag(instrument_sd²)), μ_j ~ N(prior), s_j ~ HalfNormal(spread_scale · prior_sd_j).

c_m are the parameters of machine m, the same in all its campaigns; b the errors of the one instrument. What the campaigns say of
both is Gaussian (`FleetStatistics`), so that everything but s is integrated out exactly.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtri

from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.membership import Belonging, belonging_of, contradicting
from ldbb_bayes.fleet.pooling import (
    Common,
    Pooling,
    SpreadDensity,
    Spreads,
    draw_spreads,
    pooling,
)
from ldbb_bayes.fleet.population_prior import Meaning, digest_of
from ldbb_bayes.fleet.statistics import Caveat, CaveatKind, FleetStatistics, choose, fleet_statistics, labels, narrow_forces
from ldbb_bayes.jobs import one_blas_thread
from ldbb_bayes.model.gaussian import mixture_moments, mixture_quantiles, weighted_quantiles
from ldbb_bayes.report.text import parts_of
from ldbb_bayes.report.wording import caveat_words, population_doubts, population_sentences, with_words
from ldbb_bayes.result import Result
from ldbb_bayes.table import Table, json_text
from ldbb_bayes.units import display_name, display_unit, plus_minus, ranked, round_uncertainty, state, units_for

__all__ = ["FEWEST", "PooledMachine", "PooledParameter", "Population", "Summary", "pool", "population"]

Array = NDArray[Any]
FEWEST = 6
_CONSTANT = re.compile(r"C_...")


@dataclass(frozen=True)
class Summary(Result):
    """Mean, sd and equal-tailed credible interval, inside units."""

    mean: float
    sd: float
    interval: tuple[float, float]

    def keyed(self, key: str) -> dict[str, Any]:
        """For JSON; the interval under ``key``."""
        return {"mean": self.mean, "sd": self.sd, key: list(self.interval)}


@dataclass(frozen=True)
class PooledParameter(Result):
    """One parameter over the machines.

    Attributes
    ----------
    name, unit : str
    prior_mean, prior_sd : float
        What was believed of the mean of the population.
    mean : Summary
        Of the population.
    spread : Summary
        Standard deviation of the machines about it.
    next : Summary
        A machine of the population that was not measured.
    percent : Summary or None
        Spread in per cent of the mean, the uncertainty of the spread alone; none where the mean is not known to a fifth.
    instrument_sd, instrument_share : float
        Part of the sd of the mean that comes with the one instrument, and its share of the variance: more machines do
        not make it less.
    """

    name: str
    unit: str
    prior_mean: float
    prior_sd: float
    mean: Summary
    spread: Summary
    next: Summary
    percent: Summary | None
    instrument_sd: float
    instrument_share: float


@dataclass(frozen=True)
class PooledMachine(Result):
    """One machine.

    Attributes
    ----------
    name : str
    campaigns : int
    estimate : dict of parameter to Summary
        With what the population tells of it.
    alone : dict of parameter to Summary
        From its own campaigns and the prior of a fit, the instrument's errors as all campaigns know them.
    shrinkage : dict of parameter to float
        Var(c_m | y, μ, b, s) / s²: 0 where the machine's own readings decide, 1 where the population does.
    p_value, family_wise_p_value : float or None
        At most, that a parameter of a machine of the population the others make up stands out so much, allowing for the number
        of parameters, in the second of machines too (Holm); none with too few machines.
    z, parameter_p_value : dict of parameter to float
        Each parameter by itself, two-sided.
    flag : bool
        The family-wise p-value is below 5 %.
    """

    name: str
    campaigns: int
    estimate: dict[str, Summary]
    alone: dict[str, Summary]
    shrinkage: dict[str, float]
    p_value: float | None
    family_wise_p_value: float | None
    z: dict[str, float]
    parameter_p_value: dict[str, float]
    flag: bool

    def keyed(self, key: str) -> dict[str, Any]:
        """For JSON; intervals under ``key``."""
        against = {name: {"z": z, "p_value": self.parameter_p_value[name]} for name, z in self.z.items()}
        return {
            "campaigns": self.campaigns,
            "estimate": {name: own.keyed(key) for name, own in self.estimate.items()},
            "alone": {name: own.keyed(key) for name, own in self.alone.items()},
            "shrinkage": self.shrinkage,
            "p_value": self.p_value,
            "family_wise_p_value": self.family_wise_p_value,
            "flag": self.flag,
            "parameters": against,
        }


@dataclass(frozen=True, eq=False)
class Population(Result):
    """Machines of one kind, partially pooled.

    Attributes
    ----------
    parameters : dict of name to PooledParameter
    machine : dict of name to PooledMachine
    campaigns : int
    reference_force_N : float
        Force at which compliances are meant.
    forces_N : tuple of float
        Lowest and highest force tested in all campaigns.
    topology : str
    instrument : tuple of str
        Errors taken as common to all campaigns.
    spread_scale : float
        Prior of a spread: HalfNormal(spread_scale · prior_sd).
    ci_prob : float
    seed : int
    pareto_k : float
        Of the weights of the spreads; the lower the better.
    trusted : bool
        Whether that is low enough.
    caveats : tuple of Caveat
        What to mind.
    compliances : mapping of compliance to mapping
        What they stand for, where the batch says it.
    readings : tuple of str
        Digests of the campaigns' readings, so that none of them takes its prior from what it said itself.
    judged : bool
        Whether of every machine readings tell something and its p-value can be trusted: only then none standing out means that.
    """

    parameters: dict[str, PooledParameter]
    machine: dict[str, PooledMachine]
    campaigns: int
    reference_force_N: float
    forces_N: tuple[float, float]
    topology: str
    instrument: tuple[str, ...]
    spread_scale: float
    ci_prob: float
    seed: int
    pareto_k: float
    trusted: bool
    caveats: tuple[Caveat, ...]
    compliances: Mapping[str, Meaning] = field(default_factory=dict)
    judged: bool = True
    readings: tuple[str, ...] = ()

    @property
    def not_belonging(self) -> tuple[str, ...]:
        """Machines that stand out from the others, the worst first."""
        flagged = sorted(own.name for own in self.machine.values() if own.flag)
        return tuple(ranked(flagged, lambda name: -float(np.log(self.machine[name].p_value or 1.0))))

    @property
    def ci_key(self) -> str:
        """Key of intervals in JSON: ci95."""
        return f"ci{100 * self.ci_prob:g}"

    def as_dict(self) -> dict[str, Any]:
        """For JSON: population.json."""
        key = self.ci_key
        return {
            "schema": 1,
            "kind": "population",
            "reference_force_N": self.reference_force_N,
            "machines": len(self.machine),
            "campaigns": self.campaigns,
            "forces_N": list(self.forces_N),
            "topology": self.topology,
            "compliances": self.compliances,
            "instrument": list(self.instrument),
            "spread_scale": self.spread_scale,
            "seed": self.seed,
            "pareto_k": self.pareto_k,
            "trusted": self.trusted,
            "parameters": {name: _of_parameter(own, key) for name, own in self.parameters.items()},
            "next": {
                name: {"unit": own.unit, "mean": own.next.mean, "sd": own.next.sd}
                for name, own in self.parameters.items()
                if _CONSTANT.fullmatch(name)
            },
            "machine": {name: own.keyed(key) for name, own in self.machine.items()},
            "not_belonging": list(self.not_belonging),
            "readings_sha256": list(self.readings),
            "caveats": [caveat.as_dict() for caveat in self.caveats],
        }

    def sizes(self) -> dict[str, list[float]]:
        """Sizes of means and machines by inside unit, for `units_for`."""
        found: dict[str, list[float]] = {}
        for own in self.parameters.values():
            found.setdefault(own.unit, []).extend((own.mean.mean, own.next.mean))
        return found

    def machines_table(self) -> pd.DataFrame:
        """One row per machine, inside units."""
        rows = {}
        for name, own in self.machine.items():
            row: dict[str, Any] = {
                "campaigns": own.campaigns,
                "p_value": own.p_value,
                "family_wise_p_value": own.family_wise_p_value,
                "flag": own.flag,
            }
            for parameter, found in own.estimate.items():
                alone = own.alone[parameter]
                row |= {
                    f"{parameter}.mean": found.mean,
                    f"{parameter}.sd": found.sd,
                    f"{parameter}.ci_low": found.interval[0],
                    f"{parameter}.ci_high": found.interval[1],
                    f"{parameter}.alone_mean": alone.mean,
                    f"{parameter}.alone_sd": alone.sd,
                    f"{parameter}.shrinkage": own.shrinkage[parameter],
                    f"{parameter}.z": own.z.get(parameter),
                }
            rows[name] = row
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("machine")


@with_words.register
def _in_words(found: Population) -> dict[str, Any]:
    record = found.as_dict() | {"doubts": list(population_doubts(found))}
    return {**record, "sha256": digest_of(json.loads(json_text(record)))}


@parts_of.register
def _parts(found: Population) -> tuple[Table | str, ...]:
    """A row per parameter with its unit, then what to mind."""
    rows = []
    with units_for(found.sizes()):
        for own in found.parameters.values():
            factor, unit = display_unit(own.unit)
            whole = (plus_minus(one.mean, one.sd, one.interval, own.unit) for one in (own.mean, own.next))
            mean, following = (text.removesuffix(f" {unit}") for text in whole)
            common = round_uncertainty(own.instrument_sd * factor)[0] if own.instrument_sd > 0.0 else "–"
            spread = state(own.spread.mean, own.spread.sd, own.spread.interval, own.unit)
            share = "–" if own.percent is None else f"{own.percent.mean:.{1 if own.percent.mean < 10.0 else 0}f} %"
            rows.append((display_name(own.name), unit, mean, common, spread.value, spread.interval, share, following))
    percent = f"{100 * found.ci_prob:g} %"
    heads = ("parameter", "unit", "mean", "u of the bar", "spread", f"spread, {percent}", "of mean", "next machine")
    meant = (
        "± U = 2u, or the interval where it is asymmetric. u of the bar: what more machines do not make less. Next machine: one "
        "not yet measured."
    )
    table = Table.of("Population", heads, rows, text=("unit",))
    return (table, meant, "", *population_sentences(found), *population_doubts(found))


def _of_parameter(own: PooledParameter, key: str) -> dict[str, Any]:
    return {
        "unit": own.unit,
        "prior_mean": own.prior_mean,
        "prior_sd": own.prior_sd,
        "mean": own.mean.keyed(key),
        "spread": own.spread.keyed(key),
        "spread_percent": None if own.percent is None else own.percent.keyed(key),
        "next": own.next.keyed(key),
        "instrument_sd": own.instrument_sd,
        "instrument_share": own.instrument_share,
    }


# Standard uncertainties that a mean must be away from zero before a spread is told in per cent of it.
_KNOWN = 5.0


def _pooled_parameters(
    statistics: FleetStatistics,
    spreads: Spreads,
    few: Spreads,
    common: Common,
    tails: tuple[float, float],
) -> dict[str, PooledParameter]:
    """μ and the next machine from conditional Gaussians, s from its draws.

    Parameters
    ----------
    few : Spreads
        The first draws of ``spreads``; ``common`` is theirs.
    tails : tuple of float
        Levels of the ends of intervals.
    """
    units = _Units(statistics)
    c = len(units.names)
    mean, variance = common.mean[:, :c], (common.root[:, :c] ** 2).sum(axis=-1)
    mu = units.summaries(*_mixture(few.weight, mean, np.sqrt(variance), tails))
    following = units.summaries(*_mixture(few.weight, mean, np.sqrt(variance + few.spread**2), tails))
    middle = spreads.weight @ spreads.spread
    sd = np.sqrt(spreads.weight @ (spreads.spread - middle) ** 2)
    spread = units.summaries(middle, sd, *weighted_quantiles(spreads.weight, spreads.spread, tails), spread=True)
    known = np.linalg.inv(common.precision[:, :c, :c])
    shared = few.weight @ (variance - np.diagonal(known, axis1=1, axis2=2)).clip(min=0.0) * bool(statistics.instrument)
    total = _mixture(few.weight, mean, np.sqrt(variance), tails)[1] ** 2
    return {
        name: PooledParameter(
            name=name,
            unit=statistics.units[j],
            prior_mean=float(statistics.prior_mean[j]),
            prior_sd=float(statistics.prior_sd[j]),
            mean=mu[j],
            spread=spread[j],
            next=following[j],
            percent=_percent(spread[j], mu[j]),
            instrument_sd=float(units.scale[j] * np.sqrt(shared[j])),
            instrument_share=float(min(1.0, shared[j] / total[j])),
        )
        for j, name in enumerate(units.names)
    }


def _pooled_machines(
    pooled: Pooling,
    statistics: FleetStatistics,
    few: Spreads,
    common: Common,
    belonging: Belonging | None,
    tails: tuple[float, float],
) -> dict[str, PooledMachine]:
    """Every machine with the population, alone, and against the others; arguments as for `_pooled_parameters`."""
    c, n, units = pooled.parameters, len(pooled), _Units(statistics)
    mean, sd = np.empty((2, len(few.weight), c, n))
    shrinkage = np.zeros((c, n))
    for part in pooled.each(few.spread):
        own = Common(*(value[part.rows] for value in vars(common).values()))
        middle, width, share = pooled.estimates(part, own, few.spread)
        mean[part.rows], sd[part.rows] = middle.swapaxes(0, 1), width.swapaxes(0, 1)
        shrinkage += np.einsum("k,jkm->jm", few.weight[part.rows], share)
    estimate = np.stack(_mixture(few.weight, mean, sd, tails))
    alone = _alone(pooled, few, common, tails)
    return {
        name: PooledMachine(
            name=name,
            campaigns=int(pooled.campaigns[m]),
            estimate=dict(zip(units.names, units.summaries(*estimate[..., m]), strict=True)),
            alone=dict(zip(units.names, units.summaries(*alone[..., m]), strict=True)),
            shrinkage=dict(zip(units.names, shrinkage[:, m].tolist(), strict=True)),
            **_judged(units.names, belonging, m),
        )
        for m, name in enumerate(pooled.machines)
    }


def _judged(names: tuple[str, ...], belonging: Belonging | None, m: int) -> dict[str, Any]:
    if belonging is None:
        return {"p_value": None, "family_wise_p_value": None, "z": {}, "parameter_p_value": {}, "flag": False}
    return {
        "p_value": float(belonging.p_value[m]),
        "family_wise_p_value": float(belonging.family_wise[m]),
        "z": dict(zip(names, belonging.z[:, m].tolist(), strict=True)),
        "parameter_p_value": dict(zip(names, belonging.parameter_p_value[:, m].tolist(), strict=True)),
        "flag": bool(belonging.flagged[m]),
    }


def _instrument_moments(pooled: Pooling, few: Spreads, common: Common) -> tuple[Array, Array]:
    """Mean and covariance of b, in units of its prior sd, as all campaigns know it."""
    b, roots = common.mean[:, pooled.parameters :], common.root[:, pooled.parameters :]
    mean = few.weight @ b
    apart = b - mean
    covariance = np.einsum("k,kir,kjr->ij", few.weight, roots, roots) + np.einsum("k,ki,kj->ij", few.weight, apart, apart)
    return mean, covariance


def _alone(pooled: Pooling, few: Spreads, common: Common, tails: tuple[float, float]) -> Array:
    """(A + I)⁻¹ (a − B b) with b as all campaigns know it: mean, sd and interval, shape (4, c, n)."""
    c = pooled.parameters
    mean, covariance = _instrument_moments(pooled, few, common)
    rows = np.moveaxis(pooled.information[:c], -1, 0)
    inverse = np.linalg.inv(rows[..., :c] + np.eye(c))
    gain = inverse @ rows[..., c:]
    middle = np.einsum("mij,jm->im", inverse, pooled.weighted[:c]) - (gain @ mean).T
    sd = np.sqrt(np.diagonal(inverse + gain @ covariance @ np.swapaxes(gain, 1, 2), axis1=1, axis2=2)).T
    return np.stack([middle, sd, *(middle + ndtri(tail) * sd for tail in tails)])


def _mixture(weight: Array, mean: Array, sd: Array, tails: tuple[float, float]) -> tuple[Array, Array, Array, Array]:
    low, high = mixture_quantiles(weight, mean, sd, tails)
    return (*mixture_moments(weight, mean, sd), low, high)


class _Units:
    """From units of the prior sd about the prior mean back to inside units."""

    def __init__(self, statistics: FleetStatistics) -> None:
        self.names = statistics.parameters
        self.centre, self.scale = statistics.prior_mean, statistics.prior_sd

    def summaries(self, mean: Array, sd: Array, low: Array, high: Array, *, spread: bool = False) -> list[Summary]:
        """Of every parameter, arrays of shape (c,); a spread has no centre."""
        centre = 0.0 * self.centre if spread else self.centre
        parts = (centre + self.scale * mean, self.scale * sd, centre + self.scale * low, centre + self.scale * high)
        return [Summary(m, u, (a, b)) for m, u, a, b in zip(*(part.tolist() for part in parts), strict=True)]


def _percent(spread: Summary, mean: Summary) -> Summary | None:
    if abs(mean.mean) <= _KNOWN * mean.sd:
        return None
    factor = 100.0 / abs(mean.mean)
    return Summary(spread.mean * factor, spread.sd * factor, (spread.interval[0] * factor, spread.interval[1] * factor))


# sd / scale of a half-normal, and how much of it counts as nothing learnt.
_HALF_NORMAL, _HARDLY = float(np.sqrt(1.0 - 2.0 / np.pi)), 0.8


def _caveats(
    statistics: FleetStatistics,
    parameters: Mapping[str, PooledParameter],
    spreads: Spreads,
    belonging: Belonging | None,
    machines: Sequence[str],
    changed: Sequence[str],
    spread_scale: float,
) -> Iterator[Caveat]:
    low, high = statistics.forces_N
    force = statistics.reference_force_N
    if low > high:
        yield Caveat(CaveatKind.NO_COMMON_FORCE)
    elif not low <= force <= high:
        yield Caveat(CaveatKind.EXTRAPOLATED, values=(force, low, high))
    if not spreads.trusted:
        yield Caveat(CaveatKind.SPREADS_NOT_TRUSTED, values=(spreads.pareto_k, spreads.good_k))
    scales = {name: spread_scale * own.prior_sd for name, own in parameters.items()}
    prior = [
        name
        for name, own in parameters.items()
        if own.spread.sd > _HARDLY * _HALF_NORMAL * scales[name] and own.spread.mean < 2.0 * scales[name]
    ]
    if prior:
        yield Caveat(CaveatKind.PRIOR_SPREADS, tuple(prior), (spread_scale,))
    if statistics.instrument and parameters:
        most = ranked(parameters.values(), lambda own: own.instrument_share)[0]
        errors = ", ".join(_ERRORS[name] for name in statistics.instrument)
        yield Caveat(CaveatKind.ONE_INSTRUMENT, (most.name,), (100 * most.instrument_share,), errors)
    if changed:
        yield Caveat(CaveatKind.CHANGED_MACHINES, tuple(changed))
    if belonging is None:
        yield Caveat(CaveatKind.FEW_MACHINES, values=(len(machines), FEWEST))
        return
    for kind, which in (
        (CaveatKind.SILENT_MACHINES, ~belonging.seen),
        (CaveatKind.UNCERTAIN_P_VALUES, belonging.doubtful),
    ):
        if which.any():
            yield Caveat(kind, tuple(name for name, own in zip(machines, which, strict=True) if own))
    if belonging.flagged.any():
        yield Caveat(CaveatKind.OUTLIERS_INCLUDED)


_ERRORS = {"mount": "mount", "force_gain": "gain of the force"}


_NEEDED = ("campaign", "status", "machine_id", "date", "topology", "reference_force_N", "gaussian_names", "gaussian_mean")
# Draws of s, as many as so many pairs of draw and machine allow: for the spreads themselves, and for every machine.
_SPREADS, _MACHINES = (4_000_000, 2048, 8192), (1_000_000, 256, 2048)


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
    """The population that the machines of a batch come from, the next machine, and which machines do not belong.

    Parameters
    ----------
    rows : DataFrame
        Of `read_batch`: one row per campaign; campaigns without machine_id count as machines of their own.
    parameters : sequence of str, optional
        Compliances or geometric errors; default: all constant compliances.
    exclude : sequence of str
        Campaigns (path as given, last part of it, or name) and machines to leave out.
    since : str, optional
        ISO 8601 date; campaigns before it are left out.
    include_misfits : bool
        Keep campaigns whose readings the model does not expect, see `choose`.
    reference_force_N : float, optional
        Force at which compliances are meant. Default: the median of the campaigns' own.
    spread_scale : float
        Prior of each spread: HalfNormal(spread_scale · default prior sd of the parameter), see `reference_sd`.
    one_instrument : bool
        Whether mount and force gain are those of one bar; else each campaign has its own.
    ci_prob : float
    seed : int
    progress : callable, optional
        Told of machines that are left out by drawing anew: done and total.

    Returns
    -------
    Population

    Raises
    ------
    InputError
        For rows that are no batch's, fewer than two machines, machines with other joints, or options out of range.
    """
    if not isinstance(rows, pd.DataFrame):
        raise InputError(f"rows must be the table of a batch, got {type(rows).__name__}. Give what read_batch returns.")
    missing = [name for name in _NEEDED if name not in rows]
    if missing:
        raise InputError(f"rows must be the table of a batch, got one without {missing[0]}. Give what read_batch returns.")
    _check_options(spread_scale, ci_prob, reference_force_N)
    relied, caveats = choose(rows, exclude, since, include_misfits)
    statistics = fleet_statistics(
        relied,
        parameters=parameters,
        reference_force_N=reference_force_N,
        one_instrument=one_instrument,
    )
    machines = set(statistics.machines)
    if len(machines) < 2:
        why = " ".join(("Add campaigns of others.", *map(caveat_words, caveats)))
        raise InputError(f"a population must have at least two machines, got only {machines.pop()}. {why}")
    found = pool(statistics, spread_scale=spread_scale, ci_prob=ci_prob, seed=seed, progress=progress)
    nameless = ~relied["machine_id"].map(lambda own: isinstance(own, str)).astype(bool)
    if nameless.any():
        caveats.append(Caveat(CaveatKind.MACHINES_OF_THEIR_OWN, tuple(labels(relied[nameless]))))
    if one_instrument:
        caveats += narrow_forces(relied, statistics.parameters)
    readings = tuple(str(own) for own in relied.get("sha256", ()) if isinstance(own, str))
    return replace(found, caveats=(*caveats, *found.caveats), readings=readings)


def _check_options(spread_scale: float, ci_prob: float, reference_force_N: float | None) -> None:
    if not 0.0 < ci_prob < 1.0:
        raise InputError(f"ci_prob must lie between 0 and 1, got {ci_prob}. For 95 % give 0.95.")
    if not (np.isfinite(spread_scale) and spread_scale > 0.0):
        raise InputError(f"spread_scale must be a finite number above zero, got {spread_scale}. The default is 0.3.")
    if reference_force_N is not None and not np.isfinite(reference_force_N):
        raise InputError(f"reference_force_N must be a finite number, got {reference_force_N}. Give a force in N.")


@one_blas_thread
def pool(
    statistics: FleetStatistics,
    *,
    spread_scale: float = 0.3,
    ci_prob: float = 0.95,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Population:
    """The same from statistics at hand; options as for `population`."""
    pooled = pooling(statistics)
    if len(pooled) < 2:
        raise InputError(f"a population must have at least two machines, got only {pooled.machines[0]}. Add campaigns of others.")
    density = SpreadDensity(pooled, spread_scale)
    spreads = draw_spreads(density, seed=seed, size=_draws(len(pooled), *_SPREADS))
    few = spreads.first(_draws(len(pooled), *_MACHINES))
    common = pooled.common(few.spread)
    tails = 0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob
    parameters = _pooled_parameters(statistics, spreads, few, common, tails)
    belonging = belonging_of(density, few, seed=seed, progress=progress) if len(pooled) >= FEWEST else None
    changed = contradicting(statistics, *_instrument_moments(pooled, few, common))
    machines = _pooled_machines(pooled, statistics, few, common, belonging, tails)
    return Population(
        parameters=parameters,
        machine=machines,
        campaigns=len(statistics),
        reference_force_N=statistics.reference_force_N,
        forces_N=statistics.forces_N,
        topology=statistics.topology,
        instrument=statistics.instrument,
        spread_scale=spread_scale,
        ci_prob=ci_prob,
        seed=seed,
        pareto_k=spreads.pareto_k,
        trusted=spreads.trusted,
        caveats=tuple(_caveats(statistics, parameters, spreads, belonging, pooled.machines, changed, spread_scale)),
        compliances=statistics.compliances,
        judged=belonging is not None and bool(belonging.seen.all() and not belonging.doubtful.any()),
    )


def _draws(machines: int, pairs: int, fewest: int, most: int) -> int:
    """A power of two."""
    return 2 ** int(np.log2(np.clip(pairs / machines, fewest, most)))
