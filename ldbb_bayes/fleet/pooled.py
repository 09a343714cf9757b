"""What `population` found: the population, the next machine, every machine, and how they are shown."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import pandas as pd

from ldbb_bayes.fleet.pooled_words import sentences_of
from ldbb_bayes.model.meaning import Meaning
from ldbb_bayes.model.population_prior import digest_of
from ldbb_bayes.notebook import table_html
from ldbb_bayes.report.plain import json_text
from ldbb_bayes.units import display_name, display_unit, units_for

__all__ = ["PooledMachine", "PooledParameter", "Population", "Summary"]

_CONSTANT = re.compile(r"C_...")


@dataclass(frozen=True)
class Summary:
    """Mean, sd and equal-tailed credible interval, inside units."""

    mean: float
    sd: float
    interval: tuple[float, float]

    def as_dict(self, key: str) -> dict[str, Any]:
        """For JSON; the interval under ``key``."""
        return {"mean": self.mean, "sd": self.sd, key: list(self.interval)}


@dataclass(frozen=True)
class PooledParameter:
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
class PooledMachine:
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

    def as_dict(self, key: str) -> dict[str, Any]:
        """For JSON; intervals under ``key``."""
        against = {name: {"z": z, "p_value": self.parameter_p_value[name]} for name, z in self.z.items()}
        return {
            "campaigns": self.campaigns,
            "estimate": {name: own.as_dict(key) for name, own in self.estimate.items()},
            "alone": {name: own.as_dict(key) for name, own in self.alone.items()},
            "shrinkage": self.shrinkage,
            "p_value": self.p_value,
            "family_wise_p_value": self.family_wise_p_value,
            "flag": self.flag,
            "parameters": against,
        }


@dataclass(frozen=True, eq=False)
class Population:
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
    doubts : tuple of str
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
    doubts: tuple[str, ...]
    compliances: Mapping[str, Meaning] = field(default_factory=dict)
    judged: bool = True
    readings: tuple[str, ...] = ()

    @property
    def not_belonging(self) -> tuple[str, ...]:
        """Machines that stand out from the others, the worst first."""
        flagged = [own for own in self.machine.values() if own.flag]
        return tuple(own.name for own in sorted(flagged, key=lambda own: (own.p_value or 0.0, own.name)))

    @property
    def ci_key(self) -> str:
        """Key of intervals in JSON: ci95."""
        return f"ci{100 * self.ci_prob:g}"

    def as_dict(self) -> dict[str, Any]:
        """For JSON: population.json."""
        key = self.ci_key
        record = {
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
            "machine": {name: own.as_dict(key) for name, own in self.machine.items()},
            "not_belonging": list(self.not_belonging),
            "readings_sha256": list(self.readings),
            "doubts": list(self.doubts),
        }
        return {**record, "sha256": digest_of(json.loads(json_text(record)))}

    def sizes(self) -> dict[str, list[float]]:
        """Sizes of means and machines by inside unit, for `units_for`."""
        found: dict[str, list[float]] = {}
        for own in self.parameters.values():
            found.setdefault(own.unit, []).extend((own.mean.mean, own.next.mean))
        return found

    def table(self) -> pd.DataFrame:
        """One row per parameter, in units for reading."""
        rows = {}
        with units_for(self.sizes()):
            for name, own in self.parameters.items():
                factor, unit = display_unit(own.unit)
                rows[display_name(name)] = {
                    "unit": unit,
                    "mean": own.mean.mean * factor,
                    "u of the mean": own.mean.sd * factor,
                    "from the instrument": own.instrument_sd * factor,
                    "spread": own.spread.mean * factor,
                    "spread, low": own.spread.interval[0] * factor,
                    "spread, high": own.spread.interval[1] * factor,
                    "spread (%)": None if own.percent is None else own.percent.mean,
                    "next machine": own.next.mean * factor,
                    "u of the next": own.next.sd * factor,
                }
        return pd.DataFrame.from_dict(rows, orient="index")

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

    def sentences(self) -> tuple[str, ...]:
        """What was pooled, which machines do not belong, and every doubt."""
        return sentences_of(self)

    def __str__(self) -> str:
        with pd.option_context("display.width", 200, "display.max_columns", 20):
            table = self.table().to_string(float_format=lambda value: f"{value:.3g}", na_rep="–")
        return "\n".join([table, "", *self.sentences()])

    def _repr_html_(self) -> str:
        rows = [
            {"parameter": name, **{str(k): None if v != v else v for k, v in row.items()}}
            for name, row in self.table().T.to_dict().items()
        ]
        said = [{"to mind": sentence} for sentence in self.sentences()[1:]]
        return table_html(f"Population. {self.sentences()[0]}", rows) + (table_html("Findings", said) if said else "")


def _of_parameter(own: PooledParameter, key: str) -> dict[str, Any]:
    return {
        "unit": own.unit,
        "prior_mean": own.prior_mean,
        "prior_sd": own.prior_sd,
        "mean": own.mean.as_dict(key),
        "spread": own.spread.as_dict(key),
        "spread_percent": None if own.percent is None else own.percent.as_dict(key),
        "next": own.next.as_dict(key),
        "instrument_sd": own.instrument_sd,
        "instrument_share": own.instrument_share,
    }
