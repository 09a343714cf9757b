"""The posterior as an xarray DataTree in ArviZ's layout: build, assess, save, load. The only importer of ArviZ."""

from __future__ import annotations

import gc
import hashlib
import os
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import arviz_base
import arviz_stats
import arviz_stats.base
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.files import write_whole
from ldbb_bayes.inference.stopping import Assessment

__all__ = ["assess", "build_tree", "diagnose", "load", "pareto_smooth", "power_sensitivity", "psis_loo", "save", "saved_bytes"]

Array = NDArray[Any]
_TAILS = (0.05, 0.95)
_POWERS = (0.99, 1.01)
_COUNT = 10.0
_MOST_PER_BYTE, _REASON = 20, 120
_GROUPS = ("posterior", "sample_stats", "observed_data", "constant_data", "provenance")


def diagnose(chain: Array) -> tuple[float, float, float]:
    """Bulk ESS, tail ESS and rank-normalised split R-hat of one quantity, chain (chains, draws)."""
    stats = arviz_stats.base.array_stats
    ordered = np.ascontiguousarray(chain)
    bulk = stats.ess(ordered, chain_axis=0, draw_axis=1, method="bulk")
    tail = stats.ess(ordered, chain_axis=0, draw_axis=1, method="tail", prob=_TAILS)
    return float(bulk), float(tail), float(stats.rhat(ordered, chain_axis=0, draw_axis=1))


def assess(chain: Array) -> Assessment:
    """The worst diagnostics over the last axis, chain (chains, draws, d)."""
    every = np.array([diagnose(chain[..., i]) for i in range(chain.shape[-1])])
    worst = int(np.argmin(every[:, :2].min(axis=1)))
    return Assessment(float(every[:, 0].min()), float(every[:, 1].min()), float(every[:, 2].max()), worst)


def power_sensitivity(draws: Mapping[str, Array], scaled: Mapping[str, Array]) -> dict[str, dict[str, float]]:
    """How much each parameter's posterior changes when a part of the joint density is raised to a power near one.

    Parameters
    ----------
    draws : mapping of parameter to ndarray, shape (chains, draws)
    scaled : mapping of part to its log density, shape (chains, draws)

    Returns
    -------
    dict of parameter to dict of part to float
        Above 0.05 counts as sensitive; 0 where the part is constant.
    """
    stats = arviz_stats.base.array_stats
    found: dict[str, dict[str, float]] = {name: {} for name in draws}
    for part, log_density in scaled.items():
        if np.ptp(log_density) == 0.0:
            for parts in found.values():
                parts[part] = 0.0
            continue
        lower, upper = (_power_weights(log_density, alpha) for alpha in _POWERS)
        for name, values in draws.items():
            sense = stats.power_scale_sense(values, lower, upper, *_POWERS, chain_axis=0, draw_axis=1)
            found[name][part] = float(sense)
    return found


def _power_weights(log_density: Array, alpha: float) -> Array:
    """Pareto-smoothed weights, summing to one, of draws whose density is raised to a power, shape (chains, draws)."""
    log_weights = arviz_stats.base.array_stats.power_scale_lw(log_density, alpha=alpha, axis=(0, 1))
    weights = np.exp(log_weights)
    return weights / weights.sum()


def psis_loo(log_likelihood: Array) -> tuple[Array, Array, float]:
    """Leave-one-out log densities by Pareto-smoothed importance sampling (Vehtari, Gelman and Gabry 2017).

    Parameters
    ----------
    log_likelihood : ndarray, shape (chains, draws, n)
        ln p(y_r | the others, draw) of independent draws.

    Returns
    -------
    log_density : ndarray, shape (n,)
    pareto_k : ndarray, shape (n,)
    good_k : float
        Above this the estimate cannot be trusted.
    """
    tree = arviz_base.from_dict({"posterior": {"draw_": log_likelihood[..., 0]}, "log_likelihood": {"per_test": log_likelihood}})
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Estimated shape parameter of Pareto", UserWarning)
        found = arviz_stats.loo(tree, var_name="per_test", pointwise=True, reff=1.0)
    return found.elpd_i.to_numpy(), found.pareto_k.to_numpy(), float(found.good_k)


def pareto_smooth(log_ratio: Array) -> tuple[Array, float, float]:
    """Weights of importance sampling, their largest smoothed by a Pareto tail (Vehtari et al. 2024).

    Parameters
    ----------
    log_ratio : ndarray, shape (n,)
        ln of target over proposal at independent draws, up to a constant.

    Returns
    -------
    weight : ndarray, shape (n,)
        They sum to one.
    pareto_k : float
        Infinite when hardly a draw counts or the tail cannot be judged; −inf for equal weights.
    good_k : float
        Above this the weights cannot be trusted.
    """
    good_k = min(0.7, 1.0 - 1.0 / float(np.log10(len(log_ratio))))
    if np.ptp(log_ratio) < np.sqrt(np.finfo(float).eps):
        return np.full(len(log_ratio), 1.0 / len(log_ratio)), -np.inf, good_k
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):
            log_weight, k = arviz_stats.base.array_stats.psislw(-log_ratio)
    except ValueError:
        log_weight, k = log_ratio, np.inf
    if np.isnan(log_weight).any():
        log_weight, k = log_ratio, np.inf
    weight = np.exp(log_weight - np.max(log_weight))
    weight /= weight.sum()
    counted = 1.0 / np.sum(weight**2) > _COUNT
    return weight, float(k) if counted and np.isfinite(k) else np.inf, good_k


def build_tree(
    groups: Mapping[str, Mapping[str, Array]],
    *,
    dims: Mapping[str, list[str]],
    coords: Mapping[str, Any],
    units: Mapping[str, str],
    provenance: str,
) -> xr.DataTree:
    """A DataTree of the given groups; every variable with a known unit carries it as attribute ``unit``.

    Parameters
    ----------
    groups : mapping of group to mapping of variable to array
        Sampled groups have axes (chain, draw, …).
    provenance : str
        JSON, kept as the attribute ``json`` of the group ``provenance``.
    """
    tree = arviz_base.from_dict({name: dict(group) for name, group in groups.items()}, dims=dict(dims), coords=dict(coords))
    for node in tree.children.values():
        for name, variable in node.data_vars.items():
            if str(name) in units:
                variable.attrs["unit"] = units[str(name)]
    tree["provenance"] = xr.DataTree(xr.Dataset(attrs={"json": provenance}))
    return tree


def save(tree: xr.DataTree, path: str | os.PathLike[str]) -> Path:
    """Write the tree to one netCDF file (h5netcdf), whole or not at all."""
    target = Path(path)
    write_whole(target, saved_bytes(tree))
    return target


def saved_bytes(tree: xr.DataTree) -> bytes:
    """What `save` writes; made in memory, for HDF5 does not survive a disk that is full."""
    tree = tree.copy()
    tree["provenance"].attrs["sha256"] = _digest(tree)
    with _without_cluster():
        return bytes(tree.to_netcdf(engine="h5netcdf"))


@contextmanager
def _without_cluster() -> Iterator[None]:
    """Within a job of Dask xarray would ask the cluster for a lock on what is in this process's memory."""
    dask = sys.modules.get("dask")
    if dask is None:
        yield
    else:
        with dask.config.set(scheduler="synchronous"):
            yield


def load(path: str | os.PathLike[str]) -> xr.DataTree:
    """Read a posterior written by `save`; a folder means its posterior.nc.

    Raises
    ------
    InputError
        When the file is missing, damaged (its digest tells), or not one of ours.
    """
    source = Path(path)
    source = source / "posterior.nc" if source.is_dir() else source
    if not source.is_file():
        raise InputError(f"result must be a folder with posterior.nc or such a file, got {path}. Give the --out folder of a fit.")
    tree, said = _opened(source)
    if tree is None:
        raise InputError(f"{source} must be a posterior written by ldbb-bayes, got a damaged file ({said}). Fit again.")
    missing = [group for group in _GROUPS if group not in tree.children]
    if missing or "json" not in tree["provenance"].attrs:
        raise InputError(
            f"{source} must be a posterior written by ldbb-bayes, got a file without {missing or 'provenance'}. Fit again."
        )
    if tree["provenance"].attrs.pop("sha256", "") != _digest(tree):
        raise InputError(f"{source} must be as ldbb-bayes wrote it, got numbers that are not those of its digest. Fit again.")
    return tree


def _opened(source: Path) -> tuple[xr.DataTree | None, str]:
    """The tree in a file; or None and why not, whatever a damaged file makes of the libraries."""
    loud, said = sys.unraisablehook, ""
    sys.unraisablehook = lambda _: None  # a file half opened complains once more when it is dropped
    try:
        with warnings.catch_warnings(action="ignore"), xr.open_datatree(source, engine="h5netcdf") as opened:
            size, promised = source.stat().st_size, sum(node.nbytes for node in opened.subtree)
            if promised > _MOST_PER_BYTE * size + 2**20:
                return None, f"it promises {promised / 2**20:.0f} MB in {size / 2**20:.2f} MB"
            return opened.load(), ""
    except Exception as error:  # noqa: BLE001
        said = " ".join(str(error).split())[:_REASON]
    finally:
        gc.collect()
        sys.unraisablehook = loud
    return None, said


def _digest(tree: xr.DataTree) -> str:
    """SHA-256 of every number, name, unit and record in a tree."""
    found = hashlib.sha256(str(tree["provenance"].attrs["json"]).encode())
    for node in sorted(tree.subtree, key=lambda own: own.path):
        for name in sorted(map(str, node.variables)):
            values = np.asarray(node[name].to_numpy())
            found.update(f"{node.path}/{name} {values.shape} {node[name].attrs.get('unit', '')}".encode())
            found.update(np.ascontiguousarray(values).tobytes() if values.dtype.kind in "fiub" else str(values.tolist()).encode())
    return found.hexdigest()
