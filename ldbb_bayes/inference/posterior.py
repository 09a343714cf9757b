"""The posterior as an xarray DataTree in ArviZ's layout: build, save, load and read back."""

from __future__ import annotations

import gc
import hashlib
import json
import os
import sys
import warnings
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from pydantic import ValidationError

from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.errors import InputError
from ldbb_bayes.files import write_whole
from ldbb_bayes.inference.coefficients import (
    ModelDraws,
    compliance_curves,
)
from ldbb_bayes.inference.fit import Fit
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.specification import model_from_toml
from ldbb_bayes.results import Array
from ldbb_bayes.units import display_unit

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "bound_of",
    "build_tree",
    "campaign_of",
    "campaign_record",
    "curves_of",
    "draws_of",
    "fit_of",
    "load",
    "model_of",
    "model_draws_of",
    "record_of",
    "save",
    "to_units",
]

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
    _, phi, beta = ModelDraws(bound, phi, beta).thinned(size or len(beta))
    return beta, phi


def model_draws_of(posterior: xr.DataTree, size: int | None = None) -> list[ModelDraws]:
    """Posterior draws as `draws_of`, those of an average apart by the rivals of slopes in their
    model: what these add to the readings follows from β and φ of that model alone. Every part has
    all parameters, zero where a model has none."""
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, size)
    averaged = record_of(posterior).get("averaged")
    if averaged is None:
        return [ModelDraws(bound, phi, beta)]
    model = np.asarray(posterior["sample_stats"]["model"]).ravel()
    model = model[np.linspace(0, len(model) - 1, len(beta)).astype(int)]
    rivals = [tuple(own["rivals"]) for own in averaged["models"]]
    parts = []
    for names in dict.fromkeys(rivals[k] for k in model):
        there = np.array([rivals[k] == names for k in model])
        parts.append(
            ModelDraws(
                bound.model.with_rivals(*names).bind(bound.campaign), phi[there], beta[there]
            )
        )
    return parts


def curves_of(
    posterior: xr.DataTree, force_N: Array, size: int | None = None, *, seed: int = 0
) -> Array:
    """C(F) of every kept compliance at forces (n,), see `compliance_curves`, shape (draws, n,
    compliances); the draws of an average in the order of `model_draws_of`."""
    rng = np.random.default_rng(seed)
    return np.concatenate(
        [compliance_curves(*part, force_N, rng) for part in model_draws_of(posterior, size)]
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
