"""Blocks of a run on disk: one file each, whole or not at all, refused when damaged or of another run."""

from __future__ import annotations

import hashlib
import json
import os
import weakref
import zipfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import fields
from pathlib import Path

import numpy as np

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.ensemble import Block

__all__ = ["Checkpoint", "remove_checkpoint"]

_PATTERN = "block-*.npz"
_REASON = 80
_FIELDS = tuple(field.name for field in fields(Block))
# What a block ends in, and the next begins with.
_STATE = ("coords", "log_density", "random", "position", "gauss")


class Checkpoint:
    """A folder of blocks.

    Parameters
    ----------
    folder : path
        Made when the first block is saved.
    key : mapping of str to str
        What makes the run what it is: digests of campaign and model, sampler, seed, versions. Blocks of another key are refused.
    resume : bool
        Whether blocks that are there may be used.

    Raises
    ------
    InputError
        When blocks are there and may not be used, or are of another run, or another run is at work there.
    """

    def __init__(self, folder: str | os.PathLike[str], key: Mapping[str, str], *, resume: bool) -> None:
        self.folder, self._key = Path(folder), dict(key)
        self._last = ""
        self._locked = False
        if self.folder.is_dir():
            self._hold()
        found = sorted(self.folder.glob(_PATTERN)) if self.folder.is_dir() else []
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError(f"{self.folder} must be a folder, got a file. Choose another name.")
        if found and not resume:
            raise InputError(
                f"{self.folder} must not hold an unfinished run, got {len(found)} of its blocks. "
                "Go on with it (--resume), or begin anew (--force, or remove the folder)."
            )

    def load(self, number: int) -> Block | None:
        """The block of that number, or None.

        Raises
        ------
        InputError
            Naming the file, when it is damaged, of another run, or does not follow the block before.
        """
        path = self._path(number)
        if not path.exists():
            return None
        try:
            if not path.is_file():
                raise ValueError("no ordinary file")
            _check_size(path)
            with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
                header = json.loads(str(file["header"]))
                block = Block(**{name: file[name] for name in _FIELDS})
                found, before = dict(header["key"]), str(header["before"])
            if header["sha256"] != _digest(block, _FIELDS):
                raise ValueError("numbers that are not those of its digest")
        except Exception as error:  # noqa: BLE001  # whatever a damaged file makes of the libraries
            reason = str(error).split(". ")[0].split("\n")[0][:_REASON]
            cure = "Remove it to go on from the block before" if number else "Remove it to begin anew"
            raise InputError(f"{path} must be a block of a run, got a damaged file ({reason}). {cure}.") from None
        self._check_key(path, found)
        if before != self._last:
            raise InputError(f"{path} must follow the block before it, got one of another run. Remove it and all later ones.")
        self._last = _digest(block, _STATE)
        return block

    def save(self, number: int, block: Block) -> None:
        """Keep a block for good.

        Raises
        ------
        InputError
            When the folder cannot be written.
        """
        path = self._path(number)
        staging = path.with_name(f".{path.name}.{os.getpid()}.part")
        header = json.dumps({"key": self._key, "before": self._last, "sha256": _digest(block, _FIELDS)})
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._hold()
            with staging.open("wb") as file:
                np.savez(file, header=np.array(header), **{name: getattr(block, name) for name in _FIELDS})
                file.flush()
                os.fsync(file.fileno())
            os.replace(staging, path)
        except OSError as error:
            staging.unlink(missing_ok=True)
            with suppress(OSError):
                self.folder.rmdir()
            raise InputError(
                f"{path} must be writable, got: {error.strerror or error}. Free some space or choose another place."
            ) from None
        finally:
            staging.unlink(missing_ok=True)
        self._last = _digest(block, _STATE)

    def _hold(self) -> None:
        """Keep other runs from the folder for as long as this object is."""
        if not self._locked:
            handle = _lock(self.folder)
            if handle is not None:
                weakref.finalize(self, os.close, handle)
        self._locked = True

    def _path(self, number: int) -> Path:
        return self.folder / f"block-{number:05d}.npz"

    def _check_key(self, path: Path, found: Mapping[str, str]) -> None:
        for name, value in self._key.items():
            if found.get(name) != value:
                raise InputError(
                    f"{path} must be of this run, got {name} {found.get(name, 'missing')} where this run has {value}. "
                    "Resume with what the run was started with, or remove the folder to begin anew."
                )


def remove_checkpoint(folder: str | os.PathLike[str]) -> None:
    """Drop the blocks in a folder, and the folder when nothing else is in it.

    Raises
    ------
    InputError
        When a run is at work there.
    """
    path = Path(folder)
    if not path.is_dir():
        return
    lock = _lock(path)
    try:
        for file in (*path.glob(_PATTERN), *path.glob(f".{_PATTERN}.*.part")):
            file.unlink(missing_ok=True)
        if not any(path.iterdir()):
            path.rmdir()
    finally:
        if lock is not None:
            os.close(lock)


def _lock(folder: Path) -> int | None:
    """A descriptor that keeps others from a folder until it is closed or its process ends; None where there are no locks."""
    if fcntl is None:
        return None
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise InputError(
            f"{folder} must not be in use, got another run at work there. Wait for it, or choose another --out."
        ) from None
    except OSError:
        os.close(handle)
        return None
    return handle


def _check_size(path: Path) -> None:
    """Blocks are not compressed: what unpacks to more than the file was not written here."""
    with zipfile.ZipFile(path) as archive:
        if sum(part.file_size for part in archive.infolist()) > path.stat().st_size:
            raise ValueError("it promises more than it holds")


def _digest(block: Block, names: Sequence[str]) -> str:
    """Of the arrays of these names, their shapes and kinds."""
    found = hashlib.sha256()
    for name in names:
        values = np.ascontiguousarray(getattr(block, name))
        found.update(f"{name} {values.dtype.str} {values.shape}".encode())
        found.update(values.tobytes())
    return found.hexdigest()
