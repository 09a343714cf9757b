"""The posterior as an xarray DataTree in ArviZ's layout: build, assess, save, load, predict. The
only importer of ArviZ."""

from __future__ import annotations

import gc
import hashlib
import json
import os
import sys
import warnings
from collections.abc import Mapping
from contextlib import nullcontext, suppress
from dataclasses import asdict, dataclass, fields
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from pydantic import ValidationError

from ldbb_bayes.campaign.campaign import Campaign, CircularTest, check_campaign
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.files import write_whole
from ldbb_bayes.inference import predictive
from ldbb_bayes.inference.integrals import in_chunks
from ldbb_bayes.inference.mcmc import diagnose
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.specification import model_from_toml
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, Finite, Result, readable
from ldbb_bayes.units import display_unit, ranked

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "Concern",
    "ConcernKind",
    "Fit",
    "State",
    "bound_of",
    "build_tree",
    "campaign_of",
    "campaign_record",
    "check_probability",
    "curves_of",
    "draws_of",
    "fit_of",
    "load",
    "model_of",
    "nuisances",
    "numbers_of",
    "pareto_smooth",
    "parts_of",
    "power_sensitivity",
    "priors_of",
    "record_of",
    "result_json",
    "save",
    "summarize",
    "to_units",
]

_POWERS = (0.99, 1.01)
_SENSITIVE = 0.05
_COUNT = 10.0
_MOVED = 0.5
_WIDER = 0.1
_MOST_PER_BYTE = 20
_REASON = 120
_GROUPS = ("posterior", "sample_stats", "observed_data", "constant_data", "provenance")
_OF_TESTS = ("force_N", "pressure_bar", "work_ball_deg", "tool_ball_deg", "radius_mm")
_OF_READINGS = ("angle_rad", "angle_as_read_deg", "reading_as_read_um", "test_index", "reading_mm")
_DIMS = (
    {name: ["test"] for name in _OF_TESTS}
    | {name: ["reading"] for name in _OF_READINGS}
    | {"reference_force_N": []}
)
_UNITS = {
    "force_N": "N",
    "pressure_bar": "bar",
    "reading_mm": "mm",
    "angle_rad": "rad",
    "radius_mm": "mm",
}
_ARRAYS = ("angle_deg", "reading_um", "angle_rad", "reading_mm")
_ANY_CIRCLE_DEG = np.arange(0.0, 360.0, 10.0)
# What the record keeps so that the campaign and the model can be made again.
_REBUILDS = ("fields", "test_fields", "foreseen", "toml", "prior_sd", "prior_mean", "groups")
_DRAWS = 1000
_PREDICTED = 4000
# ln λ of a circle, to sum over: its density and the likelihood are wide beside the steps.
_LOG_LAMBDA = np.arange(-1.5, 3.01, 0.25)
_TOLERANCE = 1e-2
_LARGE_K = 0.4
_TAMED_K = 0.2
_MOST_K = 2.0


class State(StrEnum):
    """Whether the numbers of a fit can be used: not at all where the sampler missed its target."""

    USABLE = "usable"
    DOUBTFUL = "doubtful"
    UNUSABLE = "unusable"


class ConcernKind(StrEnum):
    """What a fit has to say besides its numbers."""

    NOT_CONVERGED = "not-converged"
    TRUNCATION = "truncation"
    FORCES = "forces"
    HYPER = "hyper"
    CENTRE = "centre"
    PRIOR = "prior"


@dataclass(frozen=True)
class Concern(Result):
    """One thing to mind, with ``value`` and ``limit``.

    NOT_CONVERGED: steps, and the ESS they were to reach. TRUNCATION: ln P(T | y), and the least
    expected. FORCES: force levels, and how many the degree needs. HYPER: median [mm] of the
    hyper-parameter ``name``, and its prior's quantile at 99.9 %. CENTRE: the p-value of no shift of
    the circle's centre along the axis ``name`` in proportion to force. PRIOR: distance of the mean
    of the parameter ``name`` from its stated prior mean, and the largest expected, in sd of what
    the prior lets one expect.
    """

    kind: ConcernKind
    value: float
    limit: float
    name: str = ""


@dataclass(frozen=True)
class Fit(Result):
    """How well a model fits, and what to mind."""

    rmse_um: float  #: Eq. 34 over all readings
    #: Eq. 35, by test; not a number where its readings are all the same
    fitness_percent: dict[str, float]
    log_prob_truncation: float  #: ln P(T | y) of the untruncated posterior
    log_prob_truncation_error: Finite  #: [nat]
    log_prob_truncation_prior: float  #: ln P(T) of the prior
    linearisation_error_um: float  #: largest difference of the linear model from the exact geometry
    concerns: tuple[Concern, ...]
    predictive_checks: dict[str, predictive.TestChecks]
    #: by power-scaling of prior, hyper_prior and likelihood, of each parameter
    sensitivity: dict[str, dict[str, float]]
    #: Of tests with an order of the circle that is not expected: the largest change of a parameter in its u when the test is left
    #: out; not of flat priors.
    shift: dict[str, float]
    #: By which share an interval grows at most with noise as strong as what tests do not share at the orders 13 to 16, where the
    #: checks of noise and of its autocorrelation fail.
    widening: float

    @property
    def checks(self) -> list[predictive.Check]:
        """Posterior predictive checks, the smallest p first."""
        return predictive.every_check(self.predictive_checks)

    @property
    def unexpected(self) -> tuple[predictive.Check, ...]:
        """Checks that fail at 1 % after allowing for their number (Bonferroni), worst first."""
        return predictive.failing(self.checks)

    @property
    def misfits(self) -> tuple[predictive.Check, ...]:
        """Those for which intervals would move: by half a u without the test, or by a tenth of
        their width."""

        def moves(own: predictive.Check) -> bool:
            return (
                self.shift.get(own.test, np.inf) > _MOVED
                if own.kind == predictive.CheckKind.ORDER
                else self.widening > _WIDER
            )

        return tuple(filter(moves, self.unexpected))

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of concerns and of checks that fail, each once."""
        return tuple(
            dict.fromkeys(
                [str(found.kind) for found in self.concerns]
                + [str(check.kind) for check in self.misfits]
            )
        )

    @property
    def state(self) -> State:
        """Unusable: not converged. Doubtful: readings that the model does not expect, or against
        non-negative compliance."""
        kinds = {concern.kind for concern in self.concerns}
        if ConcernKind.NOT_CONVERGED in kinds:
            return State.UNUSABLE
        return State.DOUBTFUL if self.misfits or ConcernKind.TRUNCATION in kinds else State.USABLE

    @property
    def sensitive(self) -> tuple[str, ...]:
        """Parameters whose posterior moves with the prior (power-scaling sensitivity above 0.05),
        most first."""
        found = [name for name in self.parameters if self.sensitivity[name]["prior"] > _SENSITIVE]
        return tuple(ranked(found, lambda name: self.sensitivity[name]["prior"]))

    @property
    def parameters(self) -> tuple[str, ...]:
        """Those of ``sensitivity`` but for the hyper-parameters."""
        return tuple(name for name in self.sensitivity if name.startswith(("C_", "E_")))


def power_sensitivity(
    draws: Mapping[str, Array], scaled: Mapping[str, Array]
) -> dict[str, dict[str, float]]:
    """How much each parameter's posterior changes when a part of the joint density is raised to a
    power near one.

    Of draws and of the log densities of parts, each (chains, draws). Above 0.05 counts as
    sensitive; 0 where a part is constant. The cumulative Jensen-Shannon distance by which a power
    of two would move it (Kallioinen et al. 2023), the larger of those of x and −x; weights are too
    even to need smoothing.
    """
    every = np.stack([values.ravel() for values in draws.values()])
    order = np.argsort(every, axis=1)
    widths = np.diff(np.take_along_axis(every, order, axis=1), axis=1)
    plain = np.linspace(1.0 / every.shape[1], 1.0 - 1.0 / every.shape[1], every.shape[1] - 1)
    changes = {part: np.zeros(len(every)) for part in scaled}
    for part, log_density in scaled.items():
        for power in _POWERS if np.ptp(log_density) > 0.0 else ():
            weight = np.exp((power - 1.0) * (log_density - log_density.mean())).ravel()
            moved = np.cumsum(weight[order], axis=1)[:, :-1] / weight.sum()
            apart = np.maximum(
                _apart(plain, moved, widths), _apart(1.0 - plain, 1.0 - moved, widths)
            )
            changes[part] += apart / abs(np.log2(power)) / len(_POWERS)
    return {
        name: {part: float(values[k]) for part, values in changes.items()}
        for k, name in enumerate(draws)
    }


def _apart(one: Array, other: Array, widths: Array) -> Array:
    """Cumulative Jensen-Shannon distance of distribution functions (d, n) on steps of these
    widths."""
    middle = 0.5 * (one + other)
    shift = 0.5 / np.log(2.0) * (widths * (other - one)).sum(axis=1)
    divergence = [(widths * own * np.log2(own / middle)).sum(axis=1) for own in (one, other)]
    total = np.maximum(divergence[0] + shift, 0.0) + np.maximum(divergence[1] - shift, 0.0)
    return np.asarray(np.sqrt(total / (2.0 * (widths * middle).sum(axis=1))))


def pareto_smooth(log_ratio: Array) -> tuple[Array, float, float]:
    """Weights of importance sampling (n,), their largest smoothed by a Pareto tail (Vehtari et al.
    2024), from ln of target over proposal at independent draws, up to a constant; Pareto's k̂,
    infinite when hardly a draw counts or the tail cannot be judged, −inf for equal weights; and the
    k̂ above which weights cannot be trusted."""
    good_k = min(0.7, 1.0 - 1.0 / float(np.log10(len(log_ratio))))
    if np.ptp(log_ratio) < np.sqrt(np.finfo(float).eps):
        return np.full(len(log_ratio), 1.0 / len(log_ratio)), -np.inf, good_k
    log_weight = log_ratio
    k = np.inf
    with suppress(ValueError), np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):
        from arviz_stats.base import array_stats

        smoothed, shape = array_stats.psislw(-log_ratio)
        if not np.isnan(smoothed).any():
            log_weight = smoothed
            k = float(shape)
    weight = np.exp(log_weight - np.max(log_weight))
    weight /= weight.sum()
    counted = 1.0 / np.sum(weight**2) > _COUNT
    return weight, k if counted and np.isfinite(k) else np.inf, good_k


def build_tree(
    groups: Mapping[str, Mapping[str, Array]], bound: BoundModel, record: Mapping[str, Any]
) -> xr.DataTree:
    """A DataTree of groups of arrays, those sampled (chain, draw, …), and ``record`` as JSON in the
    group ``provenance``."""
    import xarray as xr
    from xarray.indexes import PandasIndex

    units = _UNITS | {p.name: p.unit for p in bound.parameters}
    units |= dict(zip(bound.hyper_prior.names, bound.hyper_prior.units, strict=True))
    sets = {}
    for group, arrays in groups.items():
        sampled = () if group.endswith("_data") else ("chain", "draw")
        # Made so, and read by .values, arrays do not have xarray import Dask to see whether they
        # are its own.
        variables = {
            name: xr.Variable(
                (*sampled, *_DIMS.get(name, ())),
                values,
                {"unit": units[name]} if name in units else {},
                fastpath=True,
            )
            for name, values in arrays.items()
        }
        sizes = {
            dim: size for variable in variables.values() for dim, size in variable.sizes.items()
        }
        values = {
            dim: np.array(bound.test_names) if dim == "test" else np.arange(size)
            for dim, size in sizes.items()
        }
        indexes = {
            dim: PandasIndex(pd.Index(own), dim, coord_dtype=own.dtype)
            for dim, own in values.items()
        }
        coords = {
            name: own
            for index in indexes.values()
            for name, own in index.create_variables().items()
        }
        sets[group] = xr.Dataset(variables, xr.Coordinates(coords, indexes))
    sets["provenance"] = xr.Dataset(attrs={"json": json.dumps(record, ensure_ascii=False)})
    return xr.DataTree.from_dict(sets)


def save(tree: xr.DataTree, path: str | os.PathLike[str]) -> Path:
    """Write the tree to one netCDF file (h5netcdf), whole or not at all; made in memory: HDF5 does
    not survive a full disk."""
    target = Path(path)
    tree = tree.copy()
    tree["provenance"].attrs["sha256"] = _digest(tree)
    dask = sys.modules.get("dask")
    # Within a job of Dask xarray would ask the cluster for a lock on what is in this process's
    # memory.
    with nullcontext() if dask is None else dask.config.set(scheduler="synchronous"):
        write_whole(target, bytes(tree.to_netcdf(engine="h5netcdf")))
    return target


def load(path: str | os.PathLike[str]) -> xr.DataTree:
    """Read a posterior written by `save`; a folder means its posterior.nc. What is missing, damaged
    (its digest tells), not one of ours, or of an earlier edition is refused."""
    source = Path(path)
    source = source / "posterior.nc" if source.is_dir() else source
    if not source.is_file():
        raise InputError(
            f"result must be a folder with posterior.nc or such a file, got {path}. Give the --out"
            " folder of a fit."
        )
    opened = _opened(source)
    missing = [group for group in _GROUPS if group not in opened.children]
    if missing or "json" not in opened["provenance"].attrs:
        raise InputError(
            f"{source} must be a posterior written by ldbb-bayes, got a file without"
            f" {missing or 'provenance'}. Fit again."
        )
    if opened["provenance"].attrs.pop("sha256", "") != _digest(opened):
        raise InputError(
            f"{source} must be as ldbb-bayes wrote it, got numbers that are not those of its"
            " digest. Fit again."
        )
    fit_of(opened)
    return opened


def _opened(source: Path) -> xr.DataTree:
    """The tree in a file; an `InputError` whatever a damaged file makes of the libraries."""
    import xarray as xr

    loud = sys.unraisablehook
    sys.unraisablehook = lambda _: None  # a file half opened complains once more when it is dropped
    try:
        with (
            warnings.catch_warnings(action="ignore"),
            xr.open_datatree(source, engine="h5netcdf") as opened,
        ):
            size = source.stat().st_size
            promised = sum(node.nbytes for node in opened.subtree)
            if promised > _MOST_PER_BYTE * size + 2**20:
                raise ValueError(f"it promises {promised / 2**20:.0f} MB in {size / 2**20:.2f} MB")
            return opened.load()
    except Exception as error:  # whatever a damaged file makes of the libraries
        gc.collect()
        why = " ".join(str(error).split())[:_REASON]
        raise InputError(
            f"{source} must be a posterior written by ldbb-bayes, got a damaged file ({why}). Fit"
            " again."
        ) from None
    finally:
        sys.unraisablehook = loud


def _digest(tree: xr.DataTree) -> str:
    """SHA-256 of every number, name, unit and record in a tree."""
    digest = hashlib.sha256(str(tree["provenance"].attrs["json"]).encode())
    for node in sorted(tree.subtree, key=lambda own: own.path):
        for name in sorted(map(str, node.variables)):
            values = np.asarray(node[name].values)
            digest.update(
                f"{node.path}/{name} {values.shape} {node[name].attrs.get('unit', '')}".encode()
            )
            digest.update(
                np.ascontiguousarray(values).tobytes()
                if values.dtype.kind in "fiub"
                else str(values.tolist()).encode()
            )
    return digest.hexdigest()


def campaign_record(campaign: Campaign) -> dict[str, Any]:
    """What the record keeps of a campaign; readings and angles stand in the group constant_data, as
    read."""
    nested = {
        name: asdict(getattr(campaign, name)) for name in ("mount", "force_law", "instrument")
    }
    return {
        "name": campaign.name,
        "sha256": campaign.sha256,
        "tests": len(campaign.tests),
        "readings": campaign.readings,
        "forces_N": campaign.forces_N.tolist(),
        "fields": _fields(campaign, "name", "tests", "foreseen") | nested,
        "test_fields": [_fields(test, *_ARRAYS) for test in campaign.tests],
        "foreseen": [_fields(test, *_ARRAYS) for test in campaign.foreseen],
    }


def _fields(thing: Campaign | CircularTest, *without: str) -> dict[str, Any]:
    return {own.name: getattr(thing, own.name) for own in fields(thing) if own.name not in without}


def record_of(posterior: xr.DataTree) -> dict[str, Any]:
    """What was fitted, how, and how well: the JSON kept in the group ``provenance``."""
    if "provenance" not in posterior.children:
        raise InputError(
            "the posterior must be one of sample or load, got one in units for reading (to_units)."
            " Pass the first."
        )
    record: dict[str, Any] = json.loads(posterior["provenance"].attrs["json"])
    return record


def fit_of(posterior: xr.DataTree) -> Fit:
    """How well the model fits, and what to mind; a posterior of an earlier edition is refused."""
    try:
        return Fit.from_dict(record_of(posterior)["fit"])
    except ValidationError as error:
        what = ".".join(map(str, error.errors()[0]["loc"]))
        raise InputError(
            "the posterior must be of this edition of ldbb-bayes, got a fit of another (its"
            f" {what}). Fit again."
        ) from None


def campaign_of(posterior: xr.DataTree) -> Campaign:
    """The campaign, readings included."""
    record = record_of(posterior)["campaign"]
    kept = posterior["constant_data"].dataset
    owner, angle, reading = (
        kept[name].values for name in ("test_index", "angle_as_read_deg", "reading_as_read_um")
    )
    tests = tuple(
        CircularTest(angle_deg=angle[owner == i], reading_um=reading[owner == i], **own)
        for i, own in enumerate(record["test_fields"])
    )
    foreseen = tuple(CircularTest(angle_deg=_ANY_CIRCLE_DEG, **own) for own in record["foreseen"])
    return Campaign(tests, name=record["name"], foreseen=foreseen, **record["fields"])


def model_of(posterior: xr.DataTree) -> HybridModel:
    """The model."""
    return model_from_toml(record_of(posterior)["model"]["toml"])


def bound_of(posterior: xr.DataTree) -> BoundModel:
    """The model bound to the campaign, as it was sampled."""
    return model_of(posterior).bind(campaign_of(posterior))


def draws_of(
    posterior: xr.DataTree, bound: BoundModel, size: int | None = None
) -> tuple[Array, Array]:
    """Posterior draws of β (size, p) and φ (size, h) [mm], evenly picked; default: all."""
    group = posterior["posterior"].dataset
    beta, phi = (
        np.stack([group[str(name)].values.ravel() for name in names], axis=1)
        for names in (bound.names, bound.hyper_prior.names)
    )
    _, phi, beta = predictive.Part(bound, phi, beta).few(size or len(beta))
    return beta, phi


def parts_of(posterior: xr.DataTree, size: int | None = None) -> list[predictive.Part]:
    """Posterior draws as `draws_of`, those of an average apart by the rivals of slopes in their
    model: what these add to the readings follows from β and φ of that model alone. Every part has
    all parameters, zero where a model has none."""
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, size)
    averaged = record_of(posterior).get("averaged")
    if averaged is None:
        return [predictive.Part(bound, phi, beta)]
    model = np.asarray(posterior["sample_stats"]["model"]).ravel()
    model = model[np.linspace(0, len(model) - 1, len(beta)).astype(int)]
    rivals = [tuple(own["rivals"]) for own in averaged["models"]]
    parts = []
    for names in dict.fromkeys(rivals[k] for k in model):
        there = np.array([rivals[k] == names for k in model])
        parts.append(
            predictive.Part(
                bound.model.with_rivals(*names).bind(bound.campaign), phi[there], beta[there]
            )
        )
    return parts


def curves_of(
    posterior: xr.DataTree, force_N: Array, size: int | None = None, *, seed: int = 0
) -> Array:
    """C(F) of every kept compliance at forces (n,), see `compliance_curves`, shape (draws, n,
    compliances); the draws of an average in the order of `parts_of`."""
    rng = np.random.default_rng(seed)
    return np.concatenate(
        [predictive.compliance_curves(*part, force_N, rng) for part in parts_of(posterior, size)]
    )


def to_units(posterior: xr.DataTree) -> xr.DataTree:
    """The draws in units for reading, nm/N, nrad/N, µrad, µm/m, µm …, each with its attribute
    ``units``.

    For plots and summaries of other libraries; analyses take the posterior itself. Readings, forces
    and angles stay as they are.
    """
    made = posterior.filter(lambda node: node.name != "provenance").map_over_datasets(
        lambda own: own.copy()
    )
    for node in made.subtree:
        for key, variable in node.data_vars.items():
            if (unit := variable.attrs.get("unit")) is not None:
                factor, label = (
                    display_unit(unit) if node.name in ("posterior", "prior") else (1.0, unit)
                )
                node[str(key)] = variable.copy(data=variable.values * factor)
                node[str(key)].attrs = {"units": label}
    return made


def summarize(posterior: xr.DataTree, *, ci_prob: float = 0.95) -> pd.DataFrame:
    """One row per parameter and hyper-parameter, in inside units (mm, N, rad).

    Parameters
    ----------
    posterior : from `sample` or `load`.
    ci_prob : probability of the equal-tailed credible interval.

    Returns
    -------
    Columns unit, mean, sd, median, ci_low, ci_high, prior_mean and prior_sd (of proper priors; of
    parameters before truncation), ess_bulk, ess_tail, rhat; ``attrs["fit"]`` is the `Fit`: whether
    the numbers can be used (``state``), and what to mind.
    """
    check_probability(ci_prob)
    prior_sd, prior_mean = priors_of(posterior)
    variables = posterior["posterior"].data_vars
    draws = [variable.transpose("chain", "draw").values for variable in variables.values()]
    rows = {}
    for (key, variable), own, quality in zip(
        variables.items(), draws, diagnose(np.stack(draws, axis=2)).T, strict=True
    ):
        prior = {"prior_mean": prior_mean.get(str(key), np.nan), "prior_sd": prior_sd[str(key)]}
        diagnostics = dict(zip(("ess_bulk", "ess_tail", "rhat"), quality, strict=True))
        rows[str(key)] = (
            {"unit": variable.attrs.get("unit", "")}
            | numbers_of(own, ci_prob)
            | prior
            | diagnostics
        )
    table = pd.DataFrame.from_dict(rows, orient="index")
    table.attrs["fit"] = fit_of(posterior)
    return readable(table, f"Posterior, {100 * ci_prob:g} % intervals")


def result_json(posterior: xr.DataTree, *, ci_prob: float = 0.95) -> dict[str, Any]:
    """The result of a fit as documented for ``fit --json``; the key of the interval is named after
    its probability."""
    check_probability(ci_prob)
    record = record_of(posterior)
    prior_sd, prior_mean = priors_of(posterior)
    shown: dict[str, Any] = {"schema": record["schema"]}
    for part in ("campaign", "model"):
        shown[part] = {key: value for key, value in record[part].items() if key not in _REBUILDS}
    shown |= {"parameters": {}, "hyper": {}}
    for key, variable in posterior["posterior"].data_vars.items():
        name = name_shown = str(key)
        unit = variable.attrs.get("unit", "")
        factor = 1.0
        is_hyper = name not in record["model"]["groups"]
        if is_hyper and unit == "mm":
            name_shown = f"{name}_um"
            unit = "um"
            factor = 1e3
        numbers = numbers_of(variable.values * factor, ci_prob)
        interval = [numbers.pop("ci_low"), numbers.pop("ci_high")]
        sd = prior_sd[name]
        entry = {
            "unit": unit,
            **numbers,
            f"ci{100 * ci_prob:g}": interval,
            "prior_sd": None if sd is None else sd * factor,
        }
        if is_hyper:
            shown["hyper"][name_shown] = entry
        else:
            shown["parameters"][name] = entry | {"prior_mean": prior_mean.get(name)}
    return shown | {
        part: record[part]
        for part in ("averaged", "sampler", "fit", "provenance")
        if part in record
    }


def priors_of(posterior: xr.DataTree) -> tuple[dict[str, float | None], dict[str, float]]:
    """Prior sd, None where flat, and prior mean of the parameters that have a prior."""
    model = record_of(posterior)["model"]
    return model["prior_sd"], model["prior_mean"]


def numbers_of(draws: Array, ci_prob: float) -> dict[str, float]:
    """Mean, sd, median, and ci_low and ci_high of the equal-tailed interval, of draws."""
    tail = 50.0 * (1.0 - ci_prob)
    low, median, high = map(float, np.percentile(draws, [tail, 50.0, 100.0 - tail]))
    return {
        "mean": float(draws.mean()),
        "sd": float(draws.std(ddof=1)),
        "median": median,
        "ci_low": low,
        "ci_high": high,
    }


def check_probability(ci_prob: float) -> None:
    """Refuse a probability that is not between 0 and 1."""
    require(
        0.0 < ci_prob < 1.0, f"ci_prob must lie between 0 and 1, got {ci_prob}. For 95 % give 0.95."
    )


@one_blas_thread
def nuisances(posterior: xr.DataTree) -> pd.DataFrame:
    """Posterior of the shared nuisance coefficients.

    Returns
    -------
    One row per coefficient: term, unit (mm; per bar, N, h or K), mean, sd, prior_sd (at the
    posterior mean of φ). The mount's is its deviation from the nominal deflection.
    """
    bound = bound_of(posterior)
    parts = parts_of(posterior, _DRAWS)
    value = dict(
        zip(
            bound.hyper_prior.names,
            np.concatenate([part.phi for part in parts]).mean(axis=0),
            strict=True,
        )
    )
    rows = {
        name: {"term": kind.__name__, "unit": kind.unit_of(name).inside, "prior_sd": sd}
        for kind, columns in bound.columns_of.items()
        for part in predictive.shared_terms(columns)
        for name, sd in zip(part.names, part.sd_at(value), strict=True)
    }
    table = pd.DataFrame.from_dict(rows, orient="index", columns=["term", "unit", "prior_sd"])
    means, variances = (
        np.zeros((sum(len(part.phi) for part in parts), len(table))) for _ in range(2)
    )
    end = 0
    for own, phi, beta in parts:
        given = own.given_interest.conditional(phi, beta - own.centre)[1]
        names = [
            name for part in predictive.shared_terms(own.nuisance_columns) for name in part.names
        ]
        at = np.ix_(
            np.arange(end, end := end + len(phi)),
            np.array(list(map(list(table.index).index, names)), dtype=int),
        )
        means[at], variances[at] = given.mean, given.sd**2
    table.insert(2, "mean", means.mean(axis=0))
    table.insert(3, "sd", np.sqrt(variances.mean(axis=0) + means.var(axis=0)))
    return readable(table, "Other effects of the instrument and the set-up")


@one_blas_thread
def predict(
    posterior: xr.DataTree, plan: Campaign, *, ci_prob: float = 0.95, seed: int = 1
) -> pd.DataFrame:
    """Predict the readings of new circles on the machine of a posterior, with its bar, balls, mount
    and force device.

    Machine and what circles share come from the posterior; set-up shift, discrepancy, scatter,
    random force error and white noise are drawn anew. What the campaign says nothing of, such as
    the bar's length at another radius, has its prior. Nuisances are integrated out: draws of them,
    given each draw of the posterior, are not kept; `nuisances` gives their mean and sd.

    InputError for another machine, or circles that show parameters which the fit does not have.

    Parameters
    ----------
    posterior : from `sample`, `load` or `average`.
    plan : the circles; any readings are ignored.
    ci_prob : probability of the equal-tailed interval of a reading.

    Returns
    -------
    One row per test and angle: test, force_N, angle_deg, mean_um, median_um, ci_low_um, ci_high_um.

    Examples
    --------
    >>> table = lb.predict(posterior, lb.Plan((lb.CircularTest(300.0, np.arange(0.0, 360.0, 5.0)),)))
    """
    check_probability(ci_prob)
    check_campaign(plan)
    rng = np.random.default_rng(seed)
    levels = [0.5, 0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob]
    parts = [predictive.new_circles(part, plan, rng) for part in parts_of(posterior, _PREDICTED)]
    tables = []
    for test, *drawn in zip(plan.tests, *parts, strict=True):
        readings = np.concatenate(drawn) * 1e3
        columns = np.vstack([readings.mean(axis=0), np.quantile(readings, levels, axis=0)])
        numbers = dict(
            zip(("mean_um", "median_um", "ci_low_um", "ci_high_um"), columns, strict=True)
        )
        tables.append(
            pd.DataFrame(
                {"test": test.name, "force_N": test.force_N, "angle_deg": test.angle_deg, **numbers}
            )
        )
    return pd.concat(tables, ignore_index=True)


@one_blas_thread
def with_predictive(posterior: xr.DataTree, *, draws: int = 1000, seed: int = 1) -> xr.DataTree:
    """Return the posterior with the groups by which ArviZ checks and compares models.

    ``posterior_predictive.reading_mm`` (chain, draw, reading), beside ``observed_data.reading_mm``:
    a new circle in the place of every test, with the scatter of the circle that was there.

    ``log_likelihood.per_test`` (chain, draw, test): ln p(y_r | y_−r, φ), the readings of one circle
    given those of all others, which are not independent of it, and the hyper-parameters; all that
    is linear and the circle's own λ_r are integrated out, inside the truncation. The harmonic mean
    of p is the density of a circle left out (Bürkner, Gabry and Vehtari 2021): ``arviz.loo``
    estimates what `compare` computes. Only the hyper-parameters that circles share must bear a
    circle's absence, which keeps Pareto's k low; where it is above 0.4 all the same, p is raised to
    a power below one and scaled so that its harmonic mean is the exact density. The sum over
    circles is not ln p of all of them: for the sensitivity to that see ``Fit.sensitivity``.
    InputError for an average over models, flat priors, a single test, or too few draws.

    Parameters
    ----------
    posterior : from `sample` or `load`.
    draws : at most so many, evenly picked; the groups posterior, sample_stats and log_prior keep
        the same ones.
    """
    import xarray as xr

    require(
        "averaged" not in record_of(posterior),
        "the posterior must be of one model, got an average. Fit each model.",
    )
    chains, most = (int(posterior["posterior"].sizes[dim]) for dim in ("chain", "draw"))
    require(
        draws >= chains,
        f"draws must be at least {chains}, one of each chain, got {draws}. The default is 1000.",
    )
    pick = np.linspace(0, most - 1, min(most, draws // chains)).astype(int)
    made = posterior.copy()
    for group in ("posterior", "sample_stats", "log_prior"):
        made[group] = xr.DataTree(
            posterior[group].to_dataset().isel(draw=pick).assign_coords(draw=np.arange(len(pick)))
        )
    (bound, *_), *_ = parts_of(posterior, 1)
    require(
        not bound.model.prior.flat,
        "the prior must be proper, got a flat one. Fit with the default preset.",
    )
    require(
        len(bound.test_names) > 1,
        "a campaign must have at least two tests to leave one out, got one. Add tests.",
    )
    beta, phi = draws_of(made, bound)
    rng = np.random.default_rng(seed)
    shape = (chains, len(pick), -1)
    circles = np.moveaxis(predictive.new_circle_coefficients(bound, phi, beta, rng), 1, 0)
    sigma = phi[:, bound.hyper_prior.names.index("sigma")]
    pairs = zip(circles, bound.campaign.tests, strict=True)
    drawn = [predictive.readings_drawn(own, sigma, test.angles_rad(), rng) for own, test in pairs]
    arrays = {
        "posterior_predictive": ("reading_mm", "reading", np.concatenate(drawn, axis=1)),
        "log_likelihood": (
            "per_test",
            "test",
            _steadied(bound, log_likelihood_of_tests(bound, phi)),
        ),
    }
    for group, (name, dim, values) in arrays.items():
        at = (
            made["observed_data"]["reading"].values
            if dim == "reading"
            else np.array(bound.test_names)
        )
        coords = {"chain": np.arange(chains), "draw": np.arange(len(pick)), dim: at}
        attrs = {"unit": "mm"} if dim == "reading" else {}
        made[group] = xr.DataTree(
            xr.Dataset({name: (("chain", "draw", dim), values.reshape(shape), attrs)}, coords)
        )
    return made


def log_likelihood_of_tests(bound: BoundModel, phi: Array) -> Array:
    """ln p(y_r | y_−r, φ), without the λ_r in φ (w, h), shape (w, tests); see `with_predictive`."""
    together = in_chunks(partial(_log_evidence, bound), phi)
    found = np.empty((len(phi), len(bound.test_names)))
    for r, name in enumerate(bound.test_names):
        rest = bound.keeping([other for other in bound.test_names if other != name])
        circle = str(bound.setting.circle[r])
        top = together
        if circle:
            each = np.tile(phi[:, None], (1, len(_LOG_LAMBDA), 1))
            each[:, :, bound.hyper_prior.names.index(circle)] = np.exp(_LOG_LAMBDA)
            prior = bound.hyper_prior.log_density(each) + _LOG_LAMBDA
            values = in_chunks(
                partial(_log_evidence, bound), each.reshape(-1, phi.shape[1])
            ).reshape(prior.shape)
            top = np.logaddexp.reduce(prior + values, axis=1) - np.logaddexp.reduce(prior, axis=1)
        found[:, r] = top - in_chunks(partial(_log_evidence, rest), phi)
    return found


def _steadied(bound: BoundModel, log_density: Array) -> Array:
    """ln p(y_r | y_−r, φ) (w, tests) of draws; where Pareto's k is large, such that w / Σ 1/p is
    the exact density."""
    for r, name in enumerate(bound.test_names):
        k = pareto_smooth(-log_density[:, r])[1]
        if k > _LARGE_K:
            rest = bound.keeping([other for other in bound.test_names if other != name])
            tempered = log_density[:, r] * _TAMED_K / min(k, _MOST_K)
            posteriors = [
                HyperPosterior(own, truncated=own.truncation.active) for own in (bound, rest)
            ]
            whole, left = (own.nodes(_TOLERANCE).evidence.log_value for own in posteriors)
            log_density[:, r] = (
                tempered + whole - left + np.logaddexp.reduce(-tempered) - np.log(len(tempered))
            )
    return log_density


def _log_evidence(bound: BoundModel, phi: Array) -> Array:
    """ln p(y | φ) inside the truncation, but for P(T) of the prior, shape (w,)."""
    if not bound.truncation.active:
        return bound.log_evidence(phi)
    log_evidence, given = bound.given(phi)
    return log_evidence + given.orthant.log_probability(_TOLERANCE)[0]
