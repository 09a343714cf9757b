"""The posterior as an xarray DataTree in ArviZ's layout: build, save, load and read back."""

from __future__ import annotations

import gc
import hashlib
import json
import os
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from arviz_base import from_dict
from pydantic import ValidationError

from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.errors import InputError
from ldbb_bayes.files import write_whole
from ldbb_bayes.inference.coefficients import ModelDraws, compliance_curves, evenly_spaced
from ldbb_bayes.inference.fit import Fit
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.specification import model_from_toml
from ldbb_bayes.results import Array
from ldbb_bayes.units import display_unit

__all__ = [
    "bound_of",
    "build_tree",
    "campaign_of",
    "campaign_record",
    "curves_of",
    "draws_of",
    "fit_of",
    "load",
    "model_draws_of",
    "model_of",
    "record_of",
    "save",
    "to_units",
]

# Groups without which a file is no posterior.
_GROUPS = ("posterior", "sample_stats", "observed_data", "constant_data", "provenance")
# Dimensions of variables that are not draws of numbers.
_DIMENSIONS = {
    "force_N": ["test"],
    "pressure_bar": ["test"],
    "work_ball_deg": ["test"],
    "tool_ball_deg": ["test"],
    "radius_mm": ["test"],
    "angle_rad": ["reading"],
    "angle_as_read_deg": ["reading"],
    "reading_as_read_um": ["reading"],
    "test_index": ["reading"],
    "reading_mm": ["reading"],
    "reference_force_N": [],
}
_UNITS = {
    "force_N": "N",
    "pressure_bar": "bar",
    "reading_mm": "mm",
    "angle_rad": "rad",
    "radius_mm": "mm",
}
# Fields of a test that are arrays, kept in the group constant_data.
_ARRAY_FIELDS = ("angle_deg", "reading_um", "angle_rad", "reading_mm")
# A foreseen circle has no angles of its own; these stand for them.
_ANY_CIRCLE_DEG = np.arange(0.0, 360.0, 10.0)
# A sound file holds at most so many numbers' bytes for each of its own ...
_LARGEST_EXPANSION = 20
# ... and so many bytes beyond.
_SMALL_FILE_BYTES = 2**20
# Characters quoted of a library's error.
_LONGEST_REASON = 120


def build_tree(
    groups: Mapping[str, Mapping[str, Array]], bound: BoundModel, record: Mapping[str, Any]
) -> xr.DataTree:
    """Return a DataTree of groups of arrays, the sampled ones (chain, draw, …).

    ``record`` is kept as JSON in the group ``provenance``.
    """
    coordinates: dict[str, Array] = {"test": np.array(bound.test_names)}
    if "observed_data" in groups:
        coordinates["reading"] = np.arange(len(groups["observed_data"]["reading_mm"]))
    tree = from_dict(groups, dims=_DIMENSIONS, coords=coordinates)
    units = dict(_UNITS)
    units.update({parameter.name: parameter.unit for parameter in bound.parameters})
    units.update(zip(bound.hyper_prior.names, bound.hyper_prior.units, strict=True))
    for node in tree.children.values():
        for name, variable in node.data_vars.items():
            if name in units:
                variable.attrs["unit"] = units[str(name)]
    text = json.dumps(record, ensure_ascii=False)
    tree["provenance"] = xr.DataTree(xr.Dataset(attrs={"json": text}))
    return tree


def save(tree: xr.DataTree, path: str | os.PathLike[str]) -> Path:
    """Write the tree to one netCDF file (h5netcdf), whole or not at all.

    Parameters
    ----------
    tree : DataTree
        From `sample` or `load`.
    path : path
        Of the file.

    Returns
    -------
    Path
        Of the file.
    """
    target = Path(path)
    tree = tree.copy()
    tree["provenance"].attrs["sha256"] = _digest(tree)
    with _no_lock_of_dask():
        # In memory first: HDF5 does not survive a full disk.
        content = bytes(tree.to_netcdf(engine="h5netcdf"))
    write_whole(target, content)
    return target


def _no_lock_of_dask() -> AbstractContextManager[Any]:
    """Keep xarray from asking a cluster of Dask for a lock on what is in this process's memory."""
    try:
        import dask.config  # an optional dependency
    except ImportError:
        return nullcontext()
    return dask.config.set(scheduler="synchronous")


def load(path: str | os.PathLike[str]) -> xr.DataTree:
    """Read a posterior that `save` wrote.

    Parameters
    ----------
    path : path
        Of the file, or of a folder with a posterior.nc.

    Returns
    -------
    DataTree

    Raises
    ------
    InputError
        For a file that is missing, damaged (its digest tells), not one of ours, or of an earlier
        edition.
    """
    source = Path(path)
    if source.is_dir():
        source = source / "posterior.nc"
    if not source.is_file():
        raise InputError(
            f"result must be a folder with posterior.nc or such a file, got {path}. Give the --out"
            " folder of a fit."
        )
    tree = _read_tree(source)
    missing = [group for group in _GROUPS if group not in tree.children]
    if missing or "json" not in tree["provenance"].attrs:
        raise InputError(
            f"{source} must be a posterior written by ldbb-bayes, got a file without"
            f" {missing or 'provenance'}. Fit again."
        )
    if tree["provenance"].attrs.pop("sha256", "") != _digest(tree):
        raise InputError(
            f"{source} must be as ldbb-bayes wrote it, got numbers that are not those of its"
            " digest. Fit again."
        )
    fit_of(tree)
    return tree


def _read_tree(source: Path) -> xr.DataTree:
    """Read the tree in a file; raise an `InputError` for whatever a damaged file makes happen."""
    with _silent_finalizers(), warnings.catch_warnings(action="ignore"):
        try:
            with xr.open_datatree(source, engine="h5netcdf") as tree:
                size = source.stat().st_size
                promised = sum(node.nbytes for node in tree.subtree)
                if promised > _LARGEST_EXPANSION * size + _SMALL_FILE_BYTES:
                    raise ValueError(
                        f"it promises {promised / 2**20:.0f} MB in {size / 2**20:.2f} MB"
                    )
                return tree.load()
        except Exception as error:  # noqa: BLE001 - libraries raise anything on a damaged file
            reason = " ".join(str(error).split())[:_LONGEST_REASON]
    raise InputError(
        f"{source} must be a posterior written by ldbb-bayes, got a damaged file ({reason}). Fit"
        " again."
    )


@contextmanager
def _silent_finalizers() -> Iterator[None]:
    """Silence a file opened in vain, which complains once more when it is dropped."""
    hook = sys.unraisablehook
    sys.unraisablehook = _ignore_unraisable
    try:
        yield
    finally:
        gc.collect()
        sys.unraisablehook = hook


def _ignore_unraisable(_: sys.UnraisableHookArgs) -> None:
    pass


def _digest(tree: xr.DataTree) -> str:
    """Return the SHA-256 of every number, name, unit and record in a tree."""
    digest = hashlib.sha256(str(tree["provenance"].attrs["json"]).encode())
    for node in sorted(tree.subtree, key=_path_of):
        for name in sorted(map(str, node.variables)):
            variable = node[name]
            values = np.asarray(variable.values)
            head = f"{node.path}/{name} {values.shape} {variable.attrs.get('unit', '')}"
            digest.update(head.encode())
            if values.dtype.kind in "fiub":
                digest.update(np.ascontiguousarray(values).tobytes())
            else:
                digest.update(str(values.tolist()).encode())
    return digest.hexdigest()


def _path_of(node: xr.DataTree) -> str:
    return node.path


def campaign_record(campaign: Campaign) -> dict[str, Any]:
    """Return what the record keeps of a campaign; readings and angles are in constant_data."""
    campaign_fields = _fields(campaign, "name", "tests", "foreseen")
    for name in ("mount", "force_law", "instrument"):
        campaign_fields[name] = asdict(getattr(campaign, name))
    return {
        "name": campaign.name,
        "sha256": campaign.sha256,
        "tests": len(campaign.tests),
        "readings": campaign.readings,
        "forces_N": campaign.forces_N.tolist(),
        "fields": campaign_fields,
        "test_fields": [_fields(test, *_ARRAY_FIELDS) for test in campaign.tests],
        "foreseen": [_fields(test, *_ARRAY_FIELDS) for test in campaign.foreseen],
    }


def _fields(source: Campaign | CircularTest, *excluded: str) -> dict[str, Any]:
    names = [field.name for field in fields(source) if field.name not in excluded]
    return {name: getattr(source, name) for name in names}


def record_of(posterior: xr.DataTree) -> dict[str, Any]:
    """Return the JSON in the group ``provenance``: what was fitted, how, and how well."""
    if "provenance" not in posterior.children:
        raise InputError(
            "the posterior must be one of sample or load, got one in units for reading (to_units)."
            " Pass the first."
        )
    record: dict[str, Any] = json.loads(posterior["provenance"].attrs["json"])
    return record


def fit_of(posterior: xr.DataTree) -> Fit:
    """Return how well the model fits, and what to mind; refuse one of an earlier edition."""
    try:
        return Fit.from_dict(record_of(posterior)["fit"])
    except ValidationError as error:
        field = ".".join(map(str, error.errors()[0]["loc"]))
        raise InputError(
            "the posterior must be of this edition of ldbb-bayes, got a fit of another (its"
            f" {field}). Fit again."
        ) from None


def campaign_of(posterior: xr.DataTree) -> Campaign:
    """Return the campaign, readings included."""
    record = record_of(posterior)["campaign"]
    constants = posterior["constant_data"].dataset
    test_index = constants["test_index"].values
    angle_deg = constants["angle_as_read_deg"].values
    reading_um = constants["reading_as_read_um"].values
    tests = []
    for index, test_fields in enumerate(record["test_fields"]):
        of_test = test_index == index
        tests.append(
            CircularTest(
                angle_deg=angle_deg[of_test], reading_um=reading_um[of_test], **test_fields
            )
        )
    foreseen = [
        CircularTest(angle_deg=_ANY_CIRCLE_DEG, **test_fields) for test_fields in record["foreseen"]
    ]
    return Campaign(tuple(tests), name=record["name"], foreseen=tuple(foreseen), **record["fields"])


def model_of(posterior: xr.DataTree) -> HybridModel:
    """Return the model."""
    return model_from_toml(record_of(posterior)["model"]["toml"])


def bound_of(posterior: xr.DataTree) -> BoundModel:
    """Return the model bound to the campaign, as it was sampled."""
    return model_of(posterior).bind(campaign_of(posterior))


def draws_of(
    posterior: xr.DataTree, bound: BoundModel, size: int | None = None
) -> tuple[Array, Array]:
    """Return posterior draws of β (size, p) and φ (size, h) [mm], evenly picked; default: all."""
    group = posterior["posterior"].dataset
    beta = _stack_draws(group, bound.names)
    phi = _stack_draws(group, bound.hyper_prior.names)
    draws = ModelDraws(bound, phi, beta)
    if size is not None:
        draws = draws.thinned(size)
    return draws.beta, draws.phi


def _stack_draws(group: Any, names: tuple[str, ...]) -> Array:
    """Return draws of variables side by side, shape (chains × draws, variables)."""
    return np.stack([group[str(name)].values.ravel() for name in names], axis=1)


def model_draws_of(posterior: xr.DataTree, size: int | None = None) -> list[ModelDraws]:
    """Return posterior draws as `draws_of`, those of an average by model.

    Models of an average differ in the rivals of slopes that they have, and what these add to the
    readings follows from β and φ of that model alone. Every item has all parameters, zero where
    its model has none.
    """
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, size)
    averaged = record_of(posterior).get("averaged")
    if averaged is None:
        return [ModelDraws(bound, phi, beta)]
    model_index = np.asarray(posterior["sample_stats"]["model"]).ravel()
    model_index = model_index[evenly_spaced(len(model_index), len(beta))]
    rivals_of_model = [tuple(model["rivals"]) for model in averaged["models"]]
    rivals_of_draw = [rivals_of_model[index] for index in model_index]
    by_model = []
    for rivals in dict.fromkeys(rivals_of_draw):
        has_rivals = np.array([other == rivals for other in rivals_of_draw])
        model = bound.model.with_rivals(*rivals).bind(bound.campaign)
        by_model.append(ModelDraws(model, phi[has_rivals], beta[has_rivals]))
    return by_model


def curves_of(
    posterior: xr.DataTree, force_N: Array, size: int | None = None, *, seed: int = 0
) -> Array:
    """Return C(F) of every kept compliance at forces (n,), shape (draws, n, compliances).

    See `compliance_curves`; the draws of an average are in the order of `model_draws_of`.
    """
    rng = np.random.default_rng(seed)
    curves = [
        compliance_curves(draws.bound, draws.phi, draws.beta, force_N, rng)
        for draws in model_draws_of(posterior, size)
    ]
    return np.concatenate(curves)


def to_units(posterior: xr.DataTree) -> xr.DataTree:
    """Return the draws in units for reading: nm/N, nrad/N, µrad, µm/m, µm and so on.

    For plots and summaries of other libraries; analyses take the posterior itself. Each variable
    has its attribute ``units``. Readings, forces and angles stay as they are.

    Parameters
    ----------
    posterior : DataTree
        From `sample`, `load` or `average`.

    Returns
    -------
    DataTree
        Without the group ``provenance``.
    """
    converted = {}
    for path, node in posterior.children.items():
        if path == "provenance":
            continue
        dataset = node.to_dataset().copy()
        for name, variable in dataset.data_vars.items():
            unit = variable.attrs.get("unit")
            if unit is None:
                continue
            factor = 1.0
            label = unit
            if path in ("posterior", "prior"):
                factor, label = display_unit(unit)
            dataset[name] = variable.copy(data=variable.values * factor)
            dataset[name].attrs = {"units": label}
        converted[path] = dataset
    return xr.DataTree.from_dict(converted)
