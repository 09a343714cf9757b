"""ln p(y_i | c_i, b) = −½ (c_i, b)ᵀ Λ_i (c_i, b) + η_iᵀ (c_i, b) + const: what many campaigns say, a small matrix each.

c_i are chosen parameters of the machine in campaign i, compliances at one force for all; b are errors of the instrument (mount,
force gain) that all campaigns share. Everything else (slopes, geometric errors not chosen, form, bar length, hyper-parameters) is
integrated out, anew in each campaign. Of one machine or one bar that is conservative for changes and differences, not for levels
or the population's mean: ball form and bar length that are the same in all campaigns do not average out.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.fleet.scales import reference_sd
from ldbb_bayes.inference.sufficient import INSTRUMENT
from ldbb_bayes.model.meaning import Meaning, same_meaning

__all__ = ["FLEET_COLUMNS", "FleetStatistics", "fleet_statistics", "moment_of"]

Array = NDArray[Any]
# What is asked of the rows of a batch here, and where their campaigns are doubted.
FLEET_COLUMNS = (
    *("campaign", "name", "sha256", "machine_id", "date", "status", "topology", "compliances"),
    *("force_min_N", "force_max_N", "reference_force_N", "model_sha256", "converged", "misfits"),
    "log_prob_truncation",
    *("gaussian_names", "gaussian_units", "gaussian_mean", "gaussian_covariance", "gaussian_prior_mean", "gaussian_prior_sd"),
)
_SLOPE = re.compile(r"(C_.+)_([12])")


@dataclass(frozen=True, eq=False)
class FleetStatistics:
    """Likelihoods of n campaigns, with the priors they were computed with divided out.

    Attributes
    ----------
    campaigns, machines : tuple of str, length n
    dates : tuple of datetime or None, length n
    parameters, units : tuple of str, length c
    instrument : tuple of str, length s
        Errors shared by all campaigns that any of them was fitted with; none where every campaign has an instrument of its
        own. A campaign fitted without one took it as zero: it says nothing of it, and its Λ and η have zeros there.
    prior_mean, prior_sd : ndarray, shape (c,)
        What is assumed of one machine before any campaign: zero and `reference_sd`, not what the fits assumed.
    instrument_sd : ndarray, shape (s,)
    information : ndarray, shape (n, c + s, c + s)
        Λ: parameters first.
    weighted : ndarray, shape (n, c + s)
        η = Λ times the maximum of the likelihood.
    reference_force_N : float
        Force at which compliances are meant.
    forces_N : tuple of float
        Lowest and highest force that was tested in all campaigns.
    topology : str
    compliances : mapping of compliance to mapping
        What the chosen ones stand for, see `stands_for`; empty where rows do not say it.
    """

    campaigns: tuple[str, ...]
    machines: tuple[str, ...]
    dates: tuple[datetime | None, ...]
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    instrument: tuple[str, ...]
    prior_mean: Array
    prior_sd: Array
    instrument_sd: Array
    information: Array
    weighted: Array
    reference_force_N: float
    forces_N: tuple[float, float]
    topology: str
    compliances: Mapping[str, Meaning] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.campaigns)


def fleet_statistics(
    rows: pd.DataFrame,
    *,
    parameters: Sequence[str] | None = None,
    reference_force_N: float | None = None,
    one_instrument: bool = True,
) -> FleetStatistics:
    """The statistics of a batch's rows.

    Parameters
    ----------
    rows : DataFrame
        Of `read_batch`, chosen by `Wanted`; failed campaigns are left out.
    parameters : sequence of str, optional
        Compliances or geometric errors; default: all constant compliances.
    reference_force_N : float, optional
        Default: the median of the campaigns' own.
    one_instrument : bool
        Whether mount and force gain are those of one bar, so that their errors do not average out; else each
        campaign has its own.

    Raises
    ------
    InputError
        For no usable campaign, campaigns of machines with other joints, circles or frames elsewhere such that a compliance is
        another, unknown or repeated parameters.
    """
    usable = rows[rows["status"] == "done"]
    if usable.empty:
        raise InputError(f"a batch must have at least one campaign that was fitted, got none of {len(rows)}. See its reasons.")
    without = int(usable["gaussian_names"].isna().sum())
    if without:
        raise InputError(
            f"campaigns must have sufficient statistics, got none of {without} (flat priors, or a breakdown: see warnings). "
            "Leave them out, or run the batch with proper priors."
        )
    topologies = sorted(set(usable["topology"]))
    if len(topologies) > 1:
        raise InputError(
            f"campaigns must be of machines with the same joints, got {topologies[0]} and {topologies[1]}. Take one kind."
        )
    names = [tuple(own) for own in usable["gaussian_names"]]
    known = [name for name in names[0] if all(name in own for own in names)]
    free = [name for name in known if name not in INSTRUMENT and not _SLOPE.fullmatch(name)]
    parameters = (parameters,) if isinstance(parameters, str) else parameters
    chosen = tuple(parameters) if parameters is not None else tuple(name for name in free if name.startswith("C_"))
    check_known("parameter", chosen, free)
    if len(set(chosen)) < len(chosen) or not chosen:
        raise InputError(
            f"parameters must be given once each, got {', '.join(chosen) or 'none'}. Name some of {', '.join(free)}."
        )
    shared = tuple(name for name in INSTRUMENT if one_instrument and any(name in own for own in names))
    force = float(np.median(usable["reference_force_N"])) if reference_force_N is None else float(reference_force_N)
    information, weighted, priors, instrument_sd = [], [], [], np.zeros(len(shared))
    for row in usable.to_dict("records"):
        own = _Moments(row)
        here = np.array([True] * len(chosen) + [name in own.names for name in shared])
        present = [name for name in shared if name in own.names]
        precision, weight = np.zeros((len(here), len(here))), np.zeros(len(here))
        take = own.rows(chosen, present, force - float(row["reference_force_N"]))
        precision[np.ix_(here, here)], weight[here] = own.likelihood(take)
        information.append(precision)
        weighted.append(weight)
        priors.append(own.prior(chosen))
        instrument_sd[here[len(chosen) :]] = np.maximum(instrument_sd[here[len(chosen) :]], own.prior(present)[1])
    units = dict(zip(names[0], usable.iloc[0]["gaussian_units"], strict=True))
    means, sds = (np.array([own[k] for own in priors]) for k in (0, 1))
    return FleetStatistics(
        campaigns=tuple(map(str, usable["campaign"])),
        machines=tuple(
            str(own if isinstance(own, str) else name) for own, name in zip(usable["machine_id"], usable["campaign"], strict=True)
        ),
        dates=tuple(moment_of(own) if isinstance(own, str) else None for own in usable["date"]),
        parameters=chosen,
        units=tuple(units[name] for name in chosen),
        instrument=shared,
        prior_mean=np.zeros(len(chosen)),
        prior_sd=reference_sd(chosen, [units[name] for name in chosen], means, sds),
        instrument_sd=instrument_sd,
        information=np.array(information),
        weighted=np.array(weighted),
        reference_force_N=force,
        forces_N=(float(usable["force_min_N"].max()), float(usable["force_max_N"].min())),
        topology=topologies[0],
        compliances=_meanings(usable, chosen),
    )


def _meanings(rows: pd.DataFrame, chosen: Sequence[str]) -> dict[str, Meaning]:
    """What every chosen compliance stands for; rows that do not say it are taken to mean what the others do."""
    found: dict[str, Meaning] = {}
    first: dict[str, str] = {}
    texts = {text: str(own) for own, text in zip(rows["campaign"], rows.get("compliances", ()), strict=False)}
    for text, campaign in texts.items():
        own = json.loads(text) if isinstance(text, str) else {}
        for name in chosen:
            if name not in own:
                continue
            if not same_meaning(name, found.setdefault(name, own[name]), own[name]):
                raise InputError(
                    f"campaigns must mean the same by {name}, got {first[name]} and {campaign}: circles or joints' frames stand "
                    "elsewhere, so that it is the sum of other compliances. Take those of one place."
                )
            first.setdefault(name, campaign)
    return found


class _Moments:
    """Moments of one row as arrays."""

    def __init__(self, row: dict[Any, Any]) -> None:
        self.names = list(row["gaussian_names"])
        q = len(self.names)
        self.mean, self.prior_mean, self.prior_sd = (
            np.array(row[f"gaussian_{name}"], dtype=float) for name in ("mean", "prior_mean", "prior_sd")
        )
        self.covariance = np.zeros((q, q))
        self.covariance[np.tril_indices(q)] = row["gaussian_covariance"]
        self.covariance += np.tril(self.covariance, -1).T

    def rows(self, chosen: Sequence[str], shared: Sequence[str], shift_N: float) -> Array:
        """A with (c, b) = A · moments; compliances are carried along their slopes to the common force."""
        found = np.zeros((len(chosen) + len(shared), len(self.names)))
        for i, name in enumerate((*chosen, *shared)):
            found[i, self.names.index(name)] = 1.0
            for k in (1, 2):
                if f"{name}_{k}" in self.names:
                    found[i, self.names.index(f"{name}_{k}")] = shift_N**k
        return found

    def prior(self, names: Sequence[str]) -> tuple[Array, Array]:
        """Means and sds that the fit assumed."""
        places = [self.names.index(name) for name in names]
        return self.prior_mean[places], self.prior_sd[places]

    def likelihood(self, take: Array) -> tuple[Array, Array]:
        """Λ and η with the prior divided out; what the readings cannot add counts as nothing."""
        prior_mean, prior = take @ self.prior_mean, (take * self.prior_sd**2) @ take.T
        scale = np.sqrt(np.diag(prior))
        inside = scale[:, None] * scale
        after, before = (np.linalg.inv(part / inside) for part in (take @ self.covariance @ take.T, prior))
        values, vectors = np.linalg.eigh(0.5 * (after + after.T) - before)
        weight = after @ ((take @ self.mean) / scale) - before @ (prior_mean / scale)
        kept = vectors * (values > 0.0)
        information = (kept * values) @ kept.T
        return information / inside, kept @ (kept.T @ weight) / scale


def moment_of(date: str) -> datetime:
    """A date or time in ISO 8601 as one in UTC, without a time zone taken as such.

    Raises
    ------
    ValueError
    """
    found = datetime.fromisoformat(date)
    return found.replace(tzinfo=UTC) if found.tzinfo is None else found.astimezone(UTC)
