"""Writing a file or a folder whole or not at all, whatever happens meanwhile."""

from __future__ import annotations

import errno
import os
import re
import secrets
import shutil
import stat
import tempfile
import tomllib
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from ldbb_bayes.errors import InputError, nearest, require

__all__ = [
    "LARGEST_TABLE_BYTES",
    "LARGEST_TOML_BYTES",
    "bytes_of",
    "check_target",
    "parse_toml",
    "read_toml",
    "staged_folder",
    "validated",
    "write_whole",
]

LARGEST_TABLE_BYTES, LARGEST_TOML_BYTES, LONGEST_LINE = 64 * 2**20, 512 * 2**10, 20_000
_RETIRED = "-old"
M = TypeVar("M", bound=BaseModel)


def bytes_of(path: Path, largest: int, *, what: str) -> bytes:
    """The content of a file of sensible size; no device, pipe or folder.

    Raises
    ------
    InputError
        Naming the file and the cure.
    """
    try:
        got = "a folder" if path.is_dir() else "no ordinary file" if path.exists() else "nothing"
        cure = f"Name the files in it: {path}/*" if path.is_dir() else "Check the path"
        require(path.is_file(), f"{path} must be {what}, got {got}. {cure}.")
        with path.open("rb") as file:
            raw = file.read(largest + 1)
    except OSError as error:
        raise InputError(f"{path} must be a readable file, got: {error.strerror}. Check the name and the permissions.") from None
    size = f"{largest / 2**20:.0f} MB" if largest >= 2**20 else f"{largest / 2**10:.0f} kB"
    require(len(raw) <= largest, f"{path} must be at most {size}, got more. Remove what does not belong there, or split it.")
    return raw


@contextmanager
def _writing(target: Path) -> Iterator[None]:
    """What the system refuses, in one message."""
    try:
        yield
    except OSError as error:
        got = error.strerror or error
        raise InputError(f"{target} must be writable, got: {got}. Free some space or choose another place.") from None


def write_whole(target: Path, content: bytes) -> None:
    """Write a file in one step; of two that write the same one the later wins whole.

    Raises
    ------
    InputError
        When it cannot be written; what was there before then stands.
    """
    staging = target.with_name(f".{target.name}-{secrets.token_hex(4)}.part")
    with _writing(target):
        try:
            with staging.open("xb") as file:
                file.write(content)
                file.flush()
                _to_disk(file.fileno())
            os.replace(staging, target)
        finally:
            staging.unlink(missing_ok=True)


def check_target(target: Path, *, force: bool, ours: Collection[str] = ()) -> None:
    """Refuse a target that must not be replaced or cannot be written, before any work is done.

    What a run that was killed between two renames left behind is put back first.

    Parameters
    ----------
    force : bool
        Whether an existing folder may be replaced.
    ours : collection of str
        Names that may be lost with the old folder; anything else in it is somebody's and is kept.

    Raises
    ------
    InputError
    """
    _put_back(target)
    kind = None
    with suppress(OSError):
        kind = target.stat().st_mode
    require(kind is None or force, f"{target} must not exist, got an existing one. Choose another name or pass --force.")
    require(kind is None or stat.S_ISDIR(kind), f"{target} must be a folder, got a file. Choose another name.")
    standing = _resolved(target) in (Path.cwd(), *Path.cwd().parents)
    require(not standing, f"{target} must not be the folder you stand in, or one above it. Choose another name.")
    foreign: list[str] = []
    with suppress(FileNotFoundError, NotADirectoryError):  # another run may be replacing it
        foreign = sorted(set(os.listdir(target)) - set(ours))
    got = f"{target} must hold nothing but earlier results to be replaced, got {(foreign or [''])[0]!r}"
    require(not foreign, f"{got}. Move it away or choose another name.")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{target.name}-", dir=target.parent):
            pass
    except OSError as error:
        raise InputError(f"{target} must be writable, got: {error.strerror}. Choose another place.") from None


@contextmanager
def staged_folder(target: Path, *, force: bool, ours: Collection[str] = ()) -> Iterator[Path]:
    """A scratch folder beside ``target`` that takes its place when the block ends well.

    The old folder is there until the new one is whole; then the old one is renamed, and the new one. `check_target` gives the old
    one its name back where a run was killed between the two. Of two runs into one folder the later wins whole. A link stays; what
    it points to is replaced.

    Raises
    ------
    InputError
        As `check_target`, or when writing fails; the old target then stands untouched.
    """
    target = _resolved(target) if target.is_symlink() else target
    check_target(target, force=force, ours=ours)
    staging = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    try:
        with _writing(target):
            yield staging
            staging.chmod(0o755)
            _sync(staging)
            _take_place(staging, target, force=force)
    except InputError as error:
        raise InputError(str(error).replace(str(staging), str(target))) from None
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _take_place(staging: Path, target: Path, *, force: bool) -> None:
    """Make ``staging`` the target, also where another run does the same at the same time."""
    retired = staging.with_name(staging.name + _RETIRED)
    while True:
        try:
            os.rename(staging, target)
            break
        except OSError as error:
            occupied = error.errno in (errno.ENOTEMPTY, errno.EEXIST) and not target.is_file()
            if not (occupied or (error.errno == errno.EACCES and target.is_dir())):
                _put_back(target)
                raise
        got = "one that another run wrote meanwhile"
        require(force, f"{target} must not exist, got {got}. Choose another name or pass --force.")
        _discard(retired)
        with suppress(FileNotFoundError):
            os.rename(target, retired)
    _discard(retired)


def _discard(retired: Path) -> None:
    """Remove an old folder, under a name by which no other run puts it back half removed."""
    with suppress(FileNotFoundError):
        gone = Path(f"{retired}er")
        os.rename(retired, gone)
        shutil.rmtree(gone, ignore_errors=True)


def _put_back(target: Path) -> None:
    """Give the target its name again if a run ended between taking it from the old folder and giving it to the new one."""
    if target.exists() or not target.parent.is_dir():
        return
    scratch = re.compile(rf"\.{re.escape(target.name)}-[a-z0-9_]{{8}}{_RETIRED}")
    left = [path for path in target.parent.iterdir() if scratch.fullmatch(path.name) and path.is_dir() and not path.is_symlink()]
    with suppress(OSError):  # another run may do the same
        if left:
            max(left, key=lambda path: path.stat().st_mtime).rename(target)


def _resolved(path: Path) -> Path:
    """Links followed; those that lead to themselves are refused."""
    try:
        with suppress(FileNotFoundError, NotADirectoryError, PermissionError):
            path.stat()
        return path.resolve()
    except (OSError, RuntimeError, ValueError):
        raise InputError(f"{path} must be a name of a file or folder, got one that leads nowhere. Check the link.") from None


def _sync(folder: Path) -> None:
    """Have everything on the disk before the name changes."""
    for path in [*folder.rglob("*"), folder]:
        if path.is_symlink() or not (path.is_file() or path.is_dir()):
            continue
        try:
            handle = os.open(path, os.O_RDONLY)
        except OSError:
            continue
        try:
            _to_disk(handle)
        finally:
            os.close(handle)


def _to_disk(handle: int) -> None:
    """Where the system can; some mounts cannot, and say so by EINVAL and the like."""
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EIO):
            raise


# Keys of more parts cost time that grows with the square of their number; none of our files has more than three.
_DEEP = re.compile(r"(?:(?:[\w-]{1,200}|\"[^\"\n]{0,200}\"|'[^'\n]{0,200}')[ \t]{0,9}\.[ \t]{0,9}){8}")


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a file.

    Raises
    ------
    InputError
        Naming the file, and the place in it.
    """
    raw = bytes_of(path, LARGEST_TOML_BYTES, what="a readable TOML file")
    try:
        return parse_toml(raw.decode("utf-8-sig"), str(path))
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(f"{path}, line {line}: TOML must be UTF-8, got other bytes. Save it as UTF-8.") from None


def parse_toml(text: str, place: str) -> dict[str, Any]:
    """The content of a text; ``place`` is what a message calls it.

    Raises
    ------
    InputError
    """
    kilobytes = LARGEST_TOML_BYTES // 2**10
    require(
        len(text) <= LARGEST_TOML_BYTES, f"{place} must hold at most {kilobytes} kB, got more. Remove what does not belong there."
    )
    for number, line in enumerate(text.split("\n"), start=1):
        if len(line) > LONGEST_LINE or _DEEP.search(line):
            got = f"lines must be short and keys plain, got {line[:40]!r}…"
            raise InputError(f"{place}, line {number}: {got}. Correct that line.")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{place} must be valid TOML, got: {error}. Correct that place.") from None
    except (RecursionError, ValueError, OverflowError) as error:
        raise InputError(f"{place} must be valid TOML, got what cannot be read ({type(error).__name__}). Correct it.") from None


def validated(model: type[M], content: dict[str, Any], place: str) -> M:
    """Return the content of a file as a pydantic model.

    Raises
    ------
    InputError
        Naming the place and the first thing wrong, a misspelt key, with the nearest known, before the gap it leaves.
    """
    try:
        return model.model_validate(content)
    except ValidationError as error:
        errors = error.errors()
    first = next((entry for entry in errors if entry["type"] == "extra_forbidden"), errors[0])
    keys: list[str] = []
    value: Any = content
    owner: Any = model
    for part in first["loc"]:
        if not isinstance(value, dict | list):
            break  # what follows names a kind, not a key
        keys.append(str(part + 1) if isinstance(part, int) else part)
        value = dict(enumerate(value) if isinstance(value, list) else value).get(part)
        hints = [field.annotation for name, field in owner.model_fields.items() if part in (name, field.alias)]
        kinds = [kind for hint in hints for kind in (hint, *get_args(hint))]
        owner = next((kind for kind in kinds if hasattr(kind, "model_fields")), owner)
    where = f" in [{' '.join(keys[:-1])}]" if len(keys) > 1 else ""
    if first["type"] == "extra_forbidden":
        known = [field.alias or name for name, field in owner.model_fields.items()]
        raise InputError(
            f"{place}: keys{where} must be among {', '.join(known)}, got {keys[-1]!r}. Did you mean {nearest(keys[-1], known)!r}?"
        )
    require(first["type"] != "missing", f"{place}: {keys[-1]!r}{where} must be given, got nothing. Add it.")
    why = first["msg"].removeprefix("Value error, ")
    got = f"{keys[-1]!r}{where} must be valid, got {first['input']!r}"
    raise InputError(f"{place}: {got}: {why[0].lower()}{why[1:]}. Correct it.")
