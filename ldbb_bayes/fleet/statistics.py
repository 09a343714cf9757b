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
from collections.abc import Mapping, Sequence
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
from ldbb_bayes.model.gaussian import Gaussian, solve_lower
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.prior import Prior, geometric_unit
from ldbb_bayes.model.terms import Columns, Term
from ldbb_bayes.result import Result

__all__ = [
    "FLEET_COLUMNS",
    "Caveat",
    "CaveatKind",
    "FleetStatistics",
    "SufficientStatistics",
    "Summary",
    "alone",
    "choose",
    "deviating",
    "fleet_statistics",
    "force_caveats",
    "keyed",
    "labels",
    "mixture_covariance",
    "narrow_forces",
    "reference_sd",
    "sufficient_statistics",
    "whitened",
]

Array = NDArray[Any]
_CHUNK = 256
_SPARE = 1e-4


@dataclass(frozen=True, eq=False)
class SufficientStatistics:
    """Moments of a campaign's parameters and of the errors of its instrument.

    ``names`` are the p parameters of interest, then the coefficients of terms that are ``common`` to campaigns; q in all. Means
    and ``prior_sd`` have shape (q,), ``covariance`` (q, q).
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    mean: Array
    covariance: Array
    prior_mean: Array
    prior_sd: Array

    def columns(self) -> dict[str, list[Any]]:
        """As a batch keeps them: lists, of the covariance the lower triangle row by row."""
        plain = {f"gaussian_{name}": np.asarray(value).tolist() for name, value in vars(self).items()}
        return plain | {"gaussian_covariance": self.covariance[np.tril_indices(len(self.names))].tolist()}


@one_blas_thread
def sufficient_statistics(posterior: HyperPosterior) -> SufficientStatistics:
    """Return the posterior moments of a density that is not truncated, its prior not flat."""
    bound = posterior.bound
    pick, names, units, prior_mean, prior_sd = _columns(bound)
    free, weight = posterior.coarse.heaviest(_SPARE)
    means, covariances = [], []
    for start in range(0, len(weight), _CHUNK):
        phi = bound.hyper_prior.phi(free[start : start + _CHUNK])
        _, shared = bound.collapsed.conditional(phi, np.zeros(len(bound.names)))
        spread = shared.spread()[:, pick]
        means.append(shared.mean[:, pick])
        covariances.append(spread @ np.swapaxes(spread, 1, 2))
    mean, covariance = mixture_covariance(weight, np.concatenate(means), np.concatenate(covariances))
    mean[: len(bound.names)] += bound.centre
    return SufficientStatistics(names, units, mean, covariance, prior_mean, prior_sd)


def _columns(bound: BoundModel) -> tuple[list[int], tuple[str, ...], tuple[str, ...], Array, Array]:
    """Places among the shared coefficients, names, units and priors of parameters and instrument errors."""
    terms = [term for term in bound.nuisance_columns if isinstance(term, Columns) and not term.private]
    nuisances = [(name, float(sd)) for term in terms for name, sd in zip(term.names, term.sd, strict=True)]
    own = [(place, name, sd) for place, (name, sd) in enumerate(nuisances) if Term.owner(name).common]
    pick = [*range(len(nuisances), len(nuisances) + len(bound.names)), *(place for place, _, _ in own)]
    names = (*bound.names, *(name for _, name, _ in own))
    units = (*(parameter.unit for parameter in bound.parameters), *(Term.owner(name).unit_of(name).inside for _, name, _ in own))
    prior_sd = np.concatenate([bound.prior_sd, [sd for _, _, sd in own]])
    return pick, names, units, np.concatenate([bound.prior_mean, np.zeros(len(own))]), prior_sd


def mixture_covariance(weight: Array, mean: Array, covariance: Array | float = 0.0) -> tuple[Array, Array]:
    """Mean (q,) and covariance (q, q) of a mixture: weights (k,), means (k, q), covariances (k, q, q) or none."""
    middle = weight @ mean
    apart = mean - middle
    inside = np.tensordot(weight, covariance, 1) if isinstance(covariance, np.ndarray) else covariance
    return middle, inside + (apart.T * weight) @ apart


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
        own, usual = prior_sd[prior_mean[:, j] == 0.0, j], _default_sd(name, unit)
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
    prior_sd : ndarray, shape (c + s,)
        What is assumed of one machine before any campaign, about zero: `reference_sd`, not what the fits assumed; then of the
        instrument's errors.
    likelihood : Gaussian, shape (n, c + s)
        Λ and η of (c, b), in units of ``prior_sd``.
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
    prior_sd: Array
    likelihood: Gaussian
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
    """Return the statistics of a batch's rows.

    Parameters
    ----------
    rows : DataFrame
        Of `read_batch`, those to rely on: see `choose`.
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
        For campaigns of machines with other joints, circles or frames elsewhere such that a compliance is another, unknown or
        repeated parameters.
    """
    topologies = sorted(set(rows["topology"]))
    if len(topologies) > 1:
        raise InputError(
            f"campaigns must be of machines with the same joints, got {topologies[0]} and {topologies[1]}. Take one kind."
        )
    names = [list(own) for own in rows["gaussian_names"]]
    free = [name for name in names[0] if Term.owner(name) is Term and not _SLOPE.fullmatch(name)]
    free = [name for name in free if all(name in own for own in names)]
    parameters = (parameters,) if isinstance(parameters, str) else parameters
    chosen = tuple(name for name in free if name.startswith("C_")) if parameters is None else tuple(parameters)
    check_known("parameter", chosen, free)
    if len(set(chosen)) < len(chosen) or not chosen:
        raise InputError(
            f"parameters must be given once each, got {', '.join(chosen) or 'none'}. Name some of {', '.join(free)}."
        )
    errors = {name for own in names for name in own if Term.owner(name) is not Term and one_instrument}
    shared = tuple(sorted(errors, key=lambda name: list(Term.kinds.values()).index(Term.owner(name))))
    force = float(np.median(rows["reference_force_N"])) if reference_force_N is None else float(reference_force_N)
    parts = [_likelihood(row, (*chosen, *shared), force) for row in rows.to_dict("records")]
    information, weighted, prior_mean, prior_sd = (np.array(part) for part in zip(*parts, strict=True))
    units, c = dict(zip(names[0], rows.iloc[0]["gaussian_units"], strict=True)), len(chosen)
    own_units = tuple(units[name] for name in chosen)
    scale = np.concatenate([reference_sd(chosen, own_units, prior_mean[:, :c], prior_sd[:, :c]), prior_sd[:, c:].max(axis=0)])
    ids = zip(rows["machine_id"], rows["campaign"], strict=True)
    return FleetStatistics(
        campaigns=tuple(map(str, rows["campaign"])),
        machines=tuple(str(own if isinstance(own, str) else name) for own, name in ids),
        dates=tuple(_moment(own) if isinstance(own, str) else None for own in rows["date"]),
        parameters=chosen,
        units=own_units,
        instrument=shared,
        prior_sd=scale,
        likelihood=Gaussian(information * (scale[:, None] * scale), weighted * scale),
        reference_force_N=force,
        forces_N=(float(rows["force_min_N"].max()), float(rows["force_max_N"].min())),
        topology=topologies[0],
        compliances=_meanings(rows, chosen),
    )


def _likelihood(row: Mapping[Any, Any], wanted: Sequence[str], force_N: float) -> tuple[Array, Array, Array, Array]:
    """Λ and η of what is wanted, the prior divided out, and the prior: of what the row does not have zeros.

    Compliances are carried along their slopes to the common force; what the readings cannot add counts as nothing.
    """
    names, q = list(row["gaussian_names"]), len(row["gaussian_names"])
    mean, prior_mean, prior_sd = (np.array(row[f"gaussian_{what}"], dtype=float) for what in ("mean", "prior_mean", "prior_sd"))
    covariance = np.zeros((q, q))
    covariance[np.tril_indices(q)] = row["gaussian_covariance"]
    covariance += np.tril(covariance, -1).T
    moved = force_N - float(row["reference_force_N"])
    take = np.zeros((len(wanted), q))
    for i, name in enumerate(wanted):
        for power, own in enumerate((name, f"{name}_1", f"{name}_2")):
            if own in names:
                take[i, names.index(own)] = moved**power
    here = np.flatnonzero(take.any(axis=1))
    places = [names.index(wanted[int(i)]) for i in here]
    take = take[here]
    prior = (take * prior_sd**2) @ take.T
    scale = np.sqrt(np.diag(prior))
    inside = scale[:, None] * scale
    after, before = (np.linalg.inv(part / inside) for part in (take @ covariance @ take.T, prior))
    values, vectors = np.linalg.eigh(0.5 * (after + after.T) - before)
    pull = after @ ((take @ mean) / scale) - before @ ((take @ prior_mean) / scale)
    kept = vectors * (values > 0.0)
    information, weighted, means, sds = (np.zeros((len(wanted),) * axes) for axes in (2, 1, 1, 1))
    information[np.ix_(here, here)] = (kept * values) @ kept.T / inside
    weighted[here], means[here], sds[here] = kept @ (kept.T @ pull) / scale, prior_mean[places], prior_sd[places]
    return information, weighted, means, sds


def _meanings(rows: pd.DataFrame, chosen: Sequence[str]) -> dict[str, Meaning]:
    """What every chosen compliance stands for; rows that do not say it are taken to mean what the others do."""
    found: dict[str, tuple[Meaning, str]] = {}
    texts = {text: str(own) for own, text in zip(rows["campaign"], rows.get("compliances", ()), strict=False)}
    for text, campaign in texts.items():
        said = json.loads(text) if isinstance(text, str) else {}
        for name in (name for name in chosen if name in said):
            meaning, first = found.setdefault(name, (said[name], campaign))
            if not same_meaning(name, meaning, said[name]):
                raise InputError(
                    f"campaigns must mean the same by {name}, got {first} and {campaign}: circles or joints' frames stand "
                    "elsewhere, so that it is the sum of other compliances. Take those of one place."
                )
    return {name: meaning for name, (meaning, _) in found.items()}


def _moment(date: str) -> datetime:
    """A date or time in ISO 8601 as one in UTC, without a time zone taken as such; else a ValueError."""
    found = datetime.fromisoformat(date)
    return found.replace(tzinfo=UTC) if found.tzinfo is None else found.astimezone(UTC)


# ---- algebra that machines and their campaigns share, in units of the prior sd


def whitened(likelihood: Gaussian, spread: Array) -> tuple[Array, Array]:
    """L Lᵀ = K = I + s Λ_cc s and L⁻¹ s (Λ_c, η_c), shapes (k, n, c, c) and (k, n, c, q + 1), for k values of s (k, c).

    K is the precision of z = w / s, w ~ N(0, diag s²) being what one campaign or machine differs by: g(c + w, b). Λ may be
    singular.
    """
    c = spread.shape[1]
    s = spread[:, None, :, None]
    rows = np.concatenate([likelihood.precision[:, :c], likelihood.shift[:, :c, None]], axis=-1)
    lower = np.linalg.cholesky(np.eye(c) + s * rows[..., :c] * np.swapaxes(s, -1, -2))
    return lower, solve_lower(lower, s * rows)


def deviating(likelihood: Gaussian, spread: Array) -> Gaussian:
    """∫ g(c + w, b) N(w; 0, diag s²) dw, shape (k, n, q); arguments as for `whitened`."""
    lower, solved = whitened(likelihood, spread)
    square, q = np.swapaxes(solved, -1, -2) @ solved, likelihood.shift.shape[-1]
    constant = 0.5 * square[..., q, q] - np.log(np.diagonal(lower, axis1=-2, axis2=-1)).sum(axis=-1)
    return Gaussian(likelihood.precision - square[..., :q, :q], likelihood.shift - square[..., :q, q], constant)


def alone(likelihood: Gaussian, parameters: int) -> tuple[Array, Array, Array]:
    """S = (I + Λ_cc)⁻¹, H = S Λ_c and t = S η_c, shapes (n, c, c), (n, c, q) and (n, c), of campaigns each by itself.

    Its estimate is t − H_b b; t ~ N(H (c, b), S Λ_cc S).
    """
    c = parameters
    own = np.linalg.inv(np.eye(c) + likelihood.precision[:, :c, :c])
    return own, own @ likelihood.precision[:, :c], (own @ likelihood.shift[:, :c, None])[..., 0]


# ---- which campaigns count


@dataclass(frozen=True)
class Summary(Result):
    """Mean, sd and equal-tailed credible interval, inside units."""

    mean: float
    sd: float
    interval: tuple[float, float]


def keyed(record: Any, ci_prob: float) -> Any:
    """The same with intervals under their probability: interval → ci95."""
    if isinstance(record, dict):
        key = f"ci{100 * ci_prob:g}"
        return {name.replace("interval", key): keyed(value, ci_prob) for name, value in record.items()}
    return [keyed(value, ci_prob) for value in record] if isinstance(record, list) else record


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
    nothing = pd.Series(False, index=rows.index)

    def leave(which: pd.Series[bool], kind: CaveatKind, refusal: str, text: str = "") -> None:
        nonlocal rows
        which = which.loc[rows.index]
        if which.any():
            caveats.append(Caveat(kind, tuple(labels(rows[which])), text=text))
        if which.all():
            raise InputError(refusal.format(given if kind in (CaveatKind.EXCLUDED, CaveatKind.BEFORE) else len(rows)))
        rows = rows[~which]

    kinds = rows.get("kinds", pd.Series(None, index=rows.index, dtype=object))
    found = kinds.map(lambda own: set(own) if isinstance(own, list | tuple | np.ndarray) else set())
    unexpected = found.map(lambda own: not own.isdisjoint((CheckKind.ORDER, ConcernKind.TRUNCATION))).astype(bool)
    not_white = found.map(lambda own: not own.isdisjoint((CheckKind.NOISE, CheckKind.AUTOCORRELATION))).astype(bool)

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
    misfits = (
        "campaigns must have readings that the model expects, got none of {}. See their verdicts and mend them, or keep them "
        "all the same: --include-misfits (include_misfits=True)."
    )
    leave(nothing if include_misfits else unexpected, CaveatKind.UNEXPECTED, misfits)
    converged = rows.get("converged", ~nothing)
    minded = {
        CaveatKind.UNEXPECTED_KEPT: unexpected,
        CaveatKind.NOT_CONVERGED: converged.map(lambda own: not pd.isna(own) and not own).astype(bool),
        CaveatKind.NOT_WHITE: not_white & ~unexpected,
    }
    for kind, which in minded.items():
        if (here := which.loc[rows.index]).any():
            caveats.append(Caveat(kind, tuple(labels(rows[here]))))
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


# Greatest force over least.
_SPAN = 3.0


def narrow_forces(rows: pd.DataFrame, parameters: Sequence[str]) -> list[Caveat]:
    """Return campaigns of one bar whose forces span so little that what its length and balls add looks like a compliance."""
    narrow = rows["force_max_N"] < _SPAN * rows["force_min_N"]
    if not narrow.any() or not any(name.startswith("C_") for name in parameters):
        return []
    return [Caveat(CaveatKind.NARROW_FORCES, tuple(labels(rows[narrow])), (_SPAN,))]


def force_caveats(statistics: FleetStatistics) -> list[Caveat]:
    """Return whether compliances are meant at a force that was not tested in every campaign."""
    low, high = statistics.forces_N
    if low > high:
        return [Caveat(CaveatKind.NO_COMMON_FORCE)]
    force = statistics.reference_force_N
    return [] if low <= force <= high else [Caveat(CaveatKind.EXTRAPOLATED, values=(force, low, high))]


def _named(rows: pd.DataFrame, exclude: Sequence[str], among: pd.DataFrame) -> pd.Series[bool]:
    """Whether campaigns, or their machines, are among the names."""
    names, known = (
        pd.DataFrame({"path": paths, "last": paths.map(lambda own: os.path.basename(own.rstrip("/")))}).join(
            own[[column for column in ("name", "machine_id") if column in own]]
        )
        for own in (rows, among)
        for paths in [own["campaign"].astype(str)]
    )
    wanted = [exclude] if isinstance(exclude, str) else list(exclude)
    for name in wanted:
        if not known.isin([name]).any(axis=None):
            every = sorted({own for own in known.drop(columns="path").to_numpy().ravel() if isinstance(own, str)})
            raise InputError(
                f"what is left out must be a campaign or machine of the batch, got {name!r}. Did you mean "
                f"{nearest(str(name), every)!r}?"
            )
    return names.isin(wanted).any(axis=1)


def _before(rows: pd.DataFrame, since: str) -> pd.Series[bool]:
    try:
        least = _moment(since)
    except ValueError:
        raise InputError(f"since must be a date or time in ISO 8601, got {since!r}. For example 2026-03-01.") from None

    def earlier(date: Any) -> bool:
        try:
            return not isinstance(date, str) or _moment(date) < least
        except ValueError:  # of campaigns that failed
            return True

    return rows["date"].map(earlier).astype(bool)
