"""ln p(y_i | c_i, b) = −½ (c_i, b)ᵀ Λ_i (c_i, b) + η_iᵀ (c_i, b) + const: what many campaigns say, a small matrix each.

c_i are chosen parameters of the machine in campaign i, compliances at one force for all; b are errors of the instrument (mount,
force gain) that all campaigns share. Everything else (slopes, geometric errors not chosen, form, bar length, hyper-parameters) is
integrated out, anew in each campaign. Of one machine or one bar that is conservative for changes and differences, not for levels
or the population's mean: ball form and bar length that are the same in all campaigns do not average out.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any, get_args

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError, check_known, nearest
from ldbb_bayes.fleet.population_prior import Meaning, same_meaning
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.posterior import ConcernKind
from ldbb_bayes.inference.predictive import CheckKind
from ldbb_bayes.jobs import one_blas_thread
from ldbb_bayes.machine.chain import ComplianceName, GeometricKind, GeometricName
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.prior import Prior, geometric_unit
from ldbb_bayes.model.terms import Columns
from ldbb_bayes.result import Result

__all__ = [
    "FLEET_COLUMNS",
    "INSTRUMENT",
    "Caveat",
    "CaveatKind",
    "FleetStatistics",
    "SufficientStatistics",
    "choose",
    "fleet_statistics",
    "labels",
    "narrow_forces",
    "reference_sd",
    "sufficient_statistics",
]

Array = NDArray[Any]
INSTRUMENT = {"mount": "mm/bar", "force_gain": "1"}
_CHUNK = 256
_SPARE = 1e-4


@dataclass(frozen=True, eq=False)
class SufficientStatistics:
    """Moments of a campaign's parameters and instrument errors.

    Attributes
    ----------
    names : tuple of str
        The p parameters of interest, then those of ``mount`` and ``force_gain`` that the model has; q in all.
    units : tuple of str
    mean : ndarray, shape (q,)
    covariance : ndarray, shape (q, q)
    prior_mean, prior_sd : ndarray, shape (q,)
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    mean: Array
    covariance: Array
    prior_mean: Array
    prior_sd: Array

    def columns(self) -> dict[str, list[Any]]:
        """As a batch keeps them: lists, of the covariance the lower triangle row by row."""
        return {
            "gaussian_names": list(self.names),
            "gaussian_units": list(self.units),
            "gaussian_mean": self.mean.tolist(),
            "gaussian_covariance": self.covariance[np.tril_indices(len(self.names))].tolist(),
            "gaussian_prior_mean": self.prior_mean.tolist(),
            "gaussian_prior_sd": self.prior_sd.tolist(),
        }


@one_blas_thread
def sufficient_statistics(posterior: HyperPosterior) -> SufficientStatistics:
    """Posterior moments with the truncation left aside.

    Parameters
    ----------
    posterior : HyperPosterior
        Not truncated.

    Raises
    ------
    InputError
        For a truncated density, or a flat prior.
    """
    bound = posterior.bound
    if posterior.truncated or bound.model.prior.flat:
        kind = "a truncated density" if posterior.truncated else "a flat prior"
        raise InputError(f"sufficient statistics must be those of a Gaussian with a proper prior, got {kind}. Use another.")
    pick, names, units, prior_mean, prior_sd = _columns(bound)
    free, weight = posterior.coarse.heaviest(_SPARE)
    means, spreads = [], []
    for start in range(0, len(weight), _CHUNK):
        phi = bound.hyper_prior.phi(free[start : start + _CHUNK])
        _, shared = bound.collapsed.conditional(phi, np.zeros(len(bound.names)))
        inverse = np.linalg.inv(shared.root)
        spread = (np.swapaxes(inverse, 1, 2) * shared.scale[:, :, None])[:, pick]
        means.append(shared.mean[:, pick])
        spreads.append(spread @ np.swapaxes(spread, 1, 2))
    every = np.concatenate(means)
    mean = weight @ every
    apart = every - mean
    covariance = np.einsum("w,wij->ij", weight, np.concatenate(spreads)) + np.einsum("w,wi,wj->ij", weight, apart, apart)
    mean[: len(bound.names)] += bound.centre
    return SufficientStatistics(names, units, mean, covariance, prior_mean, prior_sd)


def _columns(bound: BoundModel) -> tuple[list[int], tuple[str, ...], tuple[str, ...], Array, Array]:
    """Places among the shared coefficients, names, units and priors of parameters and instrument errors."""
    terms = [term for term in bound.nuisance_columns if isinstance(term, Columns) and not term.private]
    nuisances = [(name, float(sd)) for term in terms for name, sd in zip(term.names, term.sd, strict=True)]
    own = [(place, name, sd) for place, (name, sd) in enumerate(nuisances) if name in INSTRUMENT]
    pick = [*range(len(nuisances), len(nuisances) + len(bound.names)), *(place for place, _, _ in own)]
    names = (*bound.names, *(name for _, name, _ in own))
    units = (*(parameter.unit for parameter in bound.parameters), *(INSTRUMENT[name] for _, name, _ in own))
    prior_sd = np.concatenate([bound.prior_sd, [sd for _, _, sd in own]])
    return pick, names, units, np.concatenate([bound.prior_mean, np.zeros(len(own))]), prior_sd


_COMPLIANCE = re.compile(r"C_([XYZABC])([XYZABC])([XYZ])")


def reference_sd(names: Sequence[str], units: Sequence[str], prior_mean: Array, prior_sd: Array) -> Array:
    """Reference sd of every parameter, shape (c,), in inside units.

    The default prior's; where fits had a wider one about zero, its median over them: a compliance that stands for those of
    several joints is larger, and a user may know of machines that are. A prior about another mean says how well a parameter
    is known, not how large it is, and does not count.

    Parameters
    ----------
    prior_mean, prior_sd : ndarray, shape (n, c)
        Of the fits, each at its own reference force.
    """
    found = np.empty(len(names))
    for j, (name, unit) in enumerate(zip(names, units, strict=True)):
        own = prior_sd[prior_mean[:, j] == 0.0, j]
        usual = _default_sd(name, unit)
        wide = float(np.median(own if own.size else prior_sd[:, j])) if own.size or usual is None else 0.0
        found[j] = max(usual or 0.0, wide)
    return found


def _default_sd(name: str, unit: str) -> float | None:
    """Of a compliance by its name, of a geometric error by its unit; none of what is neither."""
    prior = Prior.default()
    match = _COMPLIANCE.fullmatch(name)
    if match is not None:
        return float(prior.compliance_sd([ComplianceName(*match.groups())], 0, 1.0)[0])
    kinds = {geometric_unit(kind): kind for kind in get_args(GeometricKind)}
    return float(prior.geometric_sd([GeometricName("X", "X", kinds[unit])])[0]) if unit in kinds else None


# What is asked of the rows of a batch here, and where their campaigns are doubted.
FLEET_COLUMNS = (
    *("campaign", "name", "sha256", "machine_id", "date", "status", "topology", "compliances"),
    *("force_min_N", "force_max_N", "reference_force_N", "model_sha256", "converged", "kinds"),
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
        Of `read_batch`, see `choose`; failed campaigns are left out.
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


class CaveatKind(StrEnum):
    """What is to be minded of the campaigns that a result rests on, and of the result."""

    EXCLUDED = "excluded"
    BEFORE = "before"
    FAILED = "failed"
    NO_STATISTICS = "no-statistics"
    GIVEN_AGAIN = "given-again"
    UNEXPECTED = "unexpected"
    UNEXPECTED_KEPT = "unexpected-kept"
    NOT_CONVERGED = "not-converged"
    NOT_WHITE = "not-white"
    MODELS_DIFFER = "models-differ"
    NO_MACHINES = "no-machines"
    FAILED_WITHOUT_MACHINE = "failed-without-machine"
    WITHOUT_MACHINE = "without-machine"
    MACHINES_OF_THEIR_OWN = "machines-of-their-own"
    EXTRAPOLATED = "extrapolated"
    NO_COMMON_FORCE = "no-common-force"
    NARROW_FORCES = "narrow-forces"
    NO_DATES = "no-dates"
    SAME_DATES = "same-dates"
    TWO_CAMPAIGNS = "two-campaigns"
    SPREADS_NOT_TRUSTED = "spreads-not-trusted"
    PRIOR_SPREADS = "prior-spreads"
    ONE_INSTRUMENT = "one-instrument"
    CHANGED_MACHINES = "changed-machines"
    FEW_MACHINES = "few-machines"
    SILENT_MACHINES = "silent-machines"
    UNCERTAIN_P_VALUES = "uncertain-p-values"
    OUTLIERS_INCLUDED = "outliers-included"


@dataclass(frozen=True)
class Caveat(Result):
    """One thing to mind: of which campaigns, machines or parameters, and numbers that go with it."""

    kind: CaveatKind
    names: tuple[str, ...] = ()
    values: tuple[float, ...] = ()
    text: str = ""


_UNEXPECTED = (CheckKind.ORDER, ConcernKind.TRUNCATION)
_NOT_WHITE = (CheckKind.NOISE, CheckKind.AUTOCORRELATION)


def choose(
    rows: pd.DataFrame,
    exclude: Sequence[str] = (),
    since: str | None = None,
    include_misfits: bool = False,
    *,
    among: pd.DataFrame | None = None,
) -> tuple[pd.DataFrame, list[Caveat]]:
    """Return the rows of a batch to rely on, what was left out and why, and what is to be minded of the others.

    Readings a thousand times too large would move the mean of a population, widen its spread, and hide a change of their machine.

    Parameters
    ----------
    rows : DataFrame
        Of `read_batch`; of columns that it lacks nothing is said.
    exclude : sequence of str
        Campaigns (path as given, last part of it, or name) and machines (machine_id) to leave out.
    since : str, optional
        ISO 8601 date or time; campaigns before it, and those without a date, are left out.
    include_misfits : bool
        Keep campaigns whose readings the model does not expect: orders of a circle that fail their check, or readings against
        non-negative compliance.
    among : DataFrame, optional
        The whole batch, what ``exclude`` may name; default: the rows.

    Raises
    ------
    InputError
        For unknown names, a date that is none, or nothing left.
    """
    given, caveats = len(rows), []

    def leave(which: Any, kind: CaveatKind, empty: str, text: str = "") -> None:
        nonlocal rows
        which = np.asarray(which, dtype=bool)
        if which.any():
            caveats.append(Caveat(kind, tuple(labels(rows[which])), text=text))
        if which.all():
            raise InputError(empty.format(given if kind in (CaveatKind.EXCLUDED, CaveatKind.BEFORE) else len(rows)))
        rows = rows[~which]

    none_left = "campaigns must be left to rely on, got all {} of them left out. Exclude fewer."
    leave(_named(rows, exclude, rows if among is None else among), CaveatKind.EXCLUDED, none_left)
    if since is not None:
        leave(_before(rows, since), CaveatKind.BEFORE, none_left, since)
    fitted = "a batch must have at least one campaign that was fitted, got none of {}. See its reasons."
    leave(rows["status"] != "done", CaveatKind.FAILED, fitted)
    statistics = (
        "campaigns must have sufficient statistics, got none of {} (flat priors, or a breakdown: see warnings). Run the batch "
        "with proper priors."
    )
    leave(rows["gaussian_names"].isna(), CaveatKind.NO_STATISTICS, statistics)
    if "sha256" in rows:
        leave(rows["sha256"].notna() & rows["sha256"].duplicated(), CaveatKind.GIVEN_AGAIN, "")
    unexpected = _of_kinds(rows, _UNEXPECTED)
    if not include_misfits:
        misfits = (
            "campaigns must have readings that the model expects, got none of {}. See their verdicts and mend them, or keep them "
            "all the same: --include-misfits (include_misfits=True)."
        )
        leave(unexpected, CaveatKind.UNEXPECTED, misfits)
        unexpected = unexpected[~unexpected]
    minded = {CaveatKind.UNEXPECTED_KEPT: unexpected}
    if "converged" in rows:
        minded[CaveatKind.NOT_CONVERGED] = rows["converged"].map(lambda own: not pd.isna(own) and not own).astype(bool)
    minded[CaveatKind.NOT_WHITE] = _of_kinds(rows, _NOT_WHITE) & ~unexpected
    caveats += [Caveat(kind, tuple(labels(rows[which]))) for kind, which in minded.items() if which.any()]
    if "model_sha256" in rows and rows["model_sha256"].nunique(dropna=True) > 1:
        caveats.append(Caveat(CaveatKind.MODELS_DIFFER))
    return rows, caveats


def labels(rows: pd.DataFrame) -> list[str]:
    """Return what campaigns are called: by name, those whose name others have too by path."""
    paths = rows["campaign"].astype(str)
    if "name" not in rows:
        return list(paths)
    names = rows["name"].where(rows["name"].map(lambda own: isinstance(own, str)), paths)
    return [str(path if same else name) for name, path, same in zip(names, paths, names.duplicated(keep=False), strict=True)]


def narrow_forces(rows: pd.DataFrame, parameters: Sequence[str]) -> list[Caveat]:
    """Return campaigns of one bar whose forces span so little that what its length and balls add looks like a compliance."""
    narrow = rows["force_max_N"] < _SPAN * rows["force_min_N"]
    if not narrow.any() or not any(name.startswith("C_") for name in parameters):
        return []
    return [Caveat(CaveatKind.NARROW_FORCES, tuple(labels(rows[narrow])), (_SPAN,))]


# Greatest force over least.
_SPAN = 3.0


def _named(rows: pd.DataFrame, exclude: Sequence[str], among: pd.DataFrame) -> Any:
    """Campaigns that are, or whose machine is, among the names."""
    found = np.zeros(len(rows), dtype=bool)
    for wanted in [exclude] if isinstance(exclude, str) else exclude:
        if not _called(among, wanted).any():
            every = {str(own) for column in _callings(among)[1:] for own in column if isinstance(own, str)}
            raise InputError(
                f"what is left out must be a campaign or machine of the batch, got {wanted!r}. Did you mean "
                f"{nearest(str(wanted), sorted(every))!r}?"
            )
        found |= _called(rows, wanted)
    return found


def _called(rows: pd.DataFrame, name: str) -> Any:
    return np.logical_or.reduce([(own == name).to_numpy(dtype=bool, na_value=False) for own in _callings(rows)])


def _callings(rows: pd.DataFrame) -> list[pd.Series[Any]]:
    """What a campaign goes by."""
    paths = rows["campaign"].astype(str)
    short = paths.map(lambda own: os.path.basename(own.rstrip("/")))
    return [paths, short, *(rows[column] for column in ("name", "machine_id") if column in rows)]


def _before(rows: pd.DataFrame, since: str) -> pd.Series[bool]:
    try:
        least = moment_of(since)
    except ValueError:
        raise InputError(f"since must be a date or time in ISO 8601, got {since!r}. For example 2026-03-01.") from None

    def earlier(date: Any) -> bool:
        try:
            return not isinstance(date, str) or moment_of(date) < least
        except ValueError:  # of campaigns that failed
            return True

    return rows["date"].map(earlier).astype(bool)


def _of_kinds(rows: pd.DataFrame, kinds: Collection[str]) -> pd.Series[bool]:
    if "kinds" not in rows:
        return pd.Series(False, index=rows.index)
    every = rows["kinds"].map(lambda own: set(own) if isinstance(own, list | tuple | np.ndarray) else set())
    return every.map(lambda own: bool(own & set(kinds))).astype(bool)
