"""Files of posteriors: a posterior is written to one netCDF file, and read from it."""

from __future__ import annotations

import gc
import hashlib
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ldbb_bayes.errors import InputError, quoted_reason, require
from ldbb_bayes.files import write_whole
from ldbb_bayes.inference.posterior import MODEL_EDITION, fit_of, record_of

__all__ = ["load", "save"]

# First bytes of a netCDF file of version 4, which is an HDF5 file.
_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
# Names of the groups of arrays that a netCDF file must contain to be read as a posterior.
_GROUPS = ("posterior", "sample_stats", "observed_data", "constant_data", "provenance")
# Largest size of a posterior's arrays after decompression: ``_LARGEST_EXPANSION`` times the size of
# the file plus ``_SMALL_FILE_BYTES``. A file with larger arrays counts as damaged.
_LARGEST_EXPANSION = 20
_SMALL_FILE_BYTES = 2**20


def save(posterior: xr.DataTree, path: str | os.PathLike[str], *, force: bool = False) -> Path:
    """Write a posterior to one netCDF file (h5netcdf).

    If an error occurs, no file is written, and an existing file of this name is not changed.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.
    path : str or os.PathLike
        Name of the file to write.
    force : bool, default False
        Whether an existing file of this name may be replaced.

    Returns
    -------
    Path
        Name of the file.

    Raises
    ------
    InputError
        If the file exists and ``force`` is false; for a file that cannot be written, or a posterior
        from `to_units`.

    Examples
    --------
    >>> path = lb.save(posterior, "posterior.nc")
    >>> path.name
    'posterior.nc'
    >>> path.stat().st_size > 100_000  # bytes
    True
    """
    target = Path(path)
    require(
        force or not target.exists(),
        f"{target} must not exist, got an existing one. Choose another name, or replace it:"
        " force=True.",
    )
    # Raise an error if the posterior has no record (the JSON text that states how the posterior was
    # made).
    record_of(posterior)
    tree = posterior.copy()
    tree["provenance"].attrs["sha256"] = _digest(tree)
    with _no_lock_of_dask():
        # Make the file in memory first, because the HDF5 library can crash on a full disk.
        content = bytes(tree.to_netcdf(engine="h5netcdf"))
    write_whole(target, content)
    return target


def _no_lock_of_dask() -> AbstractContextManager[Any]:
    """Return a context in which xarray does not ask a cluster of Dask workers for a file lock.

    No lock is needed, because the file is first written to the memory of this process.
    """
    try:
        import dask.config  # The library Dask need not be installed.
    except ImportError:
        return nullcontext()
    return dask.config.set(scheduler="synchronous")


def load(path: str | os.PathLike[str]) -> xr.DataTree:
    """Read a posterior that `save` wrote.

    Parameters
    ----------
    path : str or os.PathLike
        Name of the file, or of a folder that contains ``posterior.nc``.

    Returns
    -------
    DataTree
        Posterior as `sample` returned it, in mm, N and rad.

    Raises
    ------
    InputError
        If the file is missing, damaged, or not written by this version of the package, or if it
        holds a fit of another edition of the default model. The digest shows whether a file is
        damaged.

    Examples
    --------
    >>> path = lb.save(posterior, "posterior.nc")
    >>> loaded = lb.load(path)
    >>> loaded["posterior"].equals(posterior["posterior"])
    True
    """
    require(
        isinstance(path, str | os.PathLike),
        f"path must be the name of a file, got {path!r}. Give for example 'posterior.nc'.",
    )
    source = Path(path)
    if source.is_dir():
        source = source / "posterior.nc"
    if not source.is_file():
        raise InputError(
            f"result must be a folder with posterior.nc or such a file, got {path}. Give the --out"
            " folder of a fit."
        )
    with source.open("rb") as file:
        is_netcdf = file.read(len(_HDF5_SIGNATURE)) == _HDF5_SIGNATURE
    if not is_netcdf and source.name != "posterior.nc":
        raise InputError(
            f"result must be a folder with posterior.nc or such a file, got {source}, which is of"
            " another kind. Give the --out folder of a fit."
        )
    tree = _read_tree(source)
    missing = [group for group in _GROUPS if group not in tree.children]
    if missing or "json" not in tree["provenance"].attrs:
        lacking = ", ".join(missing) or "provenance"
        raise InputError(
            f"{source} must be a posterior written by ldbb-bayes, got a file without {lacking}. Fit"
            " again."
        )
    if tree["provenance"].attrs.pop("sha256", "") != _digest(tree):
        raise InputError(
            f"{source} must be as ldbb-bayes wrote it, got numbers that are not those of its"
            " digest. Fit again."
        )
    _require_edition(tree, source)
    fit_of(tree)
    return tree


def _require_edition(tree: xr.DataTree, source: Path) -> None:
    """Raise an `InputError` if a fit was made with another edition of the default model.

    The number of the edition is increased whenever the default model changes. All results of a
    posterior are computed with the present edition, and would be wrong if the draws came from
    another edition. ``tree`` is the posterior of the fit, and ``source`` the name of its file for
    the message.
    """
    record = record_of(tree)
    edition = record.get("model_edition", "an earlier one")
    require(
        record["model"]["preset"] != "default" or edition == MODEL_EDITION,
        f"{source} must be a fit of edition {MODEL_EDITION} of the default model, got {edition}."
        " Fit again.",
    )


def _read_tree(source: Path) -> xr.DataTree:
    """Return the tree of arrays in the netCDF file ``source``.

    Raise an `InputError` if the file cannot be read.
    """
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
        # Libraries may raise exceptions of any class if they read a damaged file.
        except Exception as error:  # noqa: BLE001
            reason = quoted_reason(error)
        # Deleting the library's object for a damaged file causes error messages. Delete it now,
        # while such messages are suppressed.
        gc.collect()
    raise InputError(
        f"{source} must be a posterior written by ldbb-bayes, got a damaged file ({reason}). Fit"
        " again."
    )


@contextmanager
def _silent_finalizers() -> Iterator[None]:
    """Suppress messages about errors that arise while Python deletes objects.

    If a damaged file cannot be opened, the library's object for the file is only partly
    initialised. An error arises when Python deletes this object; Python cannot raise it and only
    prints a message. Such messages are suppressed while the ``with`` block of this context manager
    runs.
    """
    hook = sys.unraisablehook
    sys.unraisablehook = _ignore_unraisable
    try:
        yield
    finally:
        sys.unraisablehook = hook


def _ignore_unraisable(_: sys.UnraisableHookArgs) -> None:
    """Do nothing when an exception arises that Python cannot raise and would only print.

    Such exceptions arise, for example, while Python deletes an object.
    """


def _digest(tree: xr.DataTree) -> str:
    """Return the SHA-256 checksum that shows whether the file of a posterior was changed.

    The checksum is computed from all numbers, names and units in the posterior, and from its JSON
    record of how the posterior was made.
    """
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
    """Return the path of a group of arrays within its DataTree. It is used to sort groups."""
    return node.path
