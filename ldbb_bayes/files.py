"""Files read and written: whole or not at all, whatever happens meanwhile; TOML, XML, and what does
not fit refused by name."""

from __future__ import annotations

import errno
import os
import re
import secrets
import shutil
import tempfile
import tomllib
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar, get_args
from xml.etree import ElementTree
from xml.parsers import expat

from pydantic import TypeAdapter, ValidationError

from ldbb_bayes.errors import InputError, nearest, require

__all__ = [
    "LARGEST_TABLE_BYTES",
    "LARGEST_TOML_BYTES",
    "bytes_of",
    "check_target",
    "parse_toml",
    "read_toml",
    "refusing",
    "staged_folder",
    "validated",
    "write_whole",
    "xml_of",
]

LARGEST_TABLE_BYTES = 64 * 2**20
LARGEST_TOML_BYTES = 512 * 2**10
LONGEST_LINE = 20_000
_DEEPEST = 100
_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
_SHOULD = "Input should be "
T = TypeVar("T")


def bytes_of(path: Path, largest: int, *, what: str) -> bytes:
    """Return the content of a file of sensible size; `InputError` for a device, pipe or folder, and
    what cannot be read."""
    try:
        got = "a folder" if path.is_dir() else "no ordinary file" if path.exists() else "nothing"
        cure = f"Name the files in it: {path}/*" if path.is_dir() else "Check the path"
        require(path.is_file(), f"{path} must be {what}, got {got}. {cure}.")
        with path.open("rb") as file:
            raw = file.read(largest + 1)
    except OSError as error:
        raise InputError(
            f"{path} must be a readable file, got: {error.strerror}. Check the name and the"
            " permissions."
        ) from None
    cure = "got more. Remove what does not belong there, or split it"
    require(len(raw) <= largest, f"{path} must be at most {largest / 2**20:g} MB, {cure}.")
    return raw


@contextmanager
def _writing(target: Path) -> Iterator[None]:
    """What the system refuses, in one message."""
    try:
        yield
    except OSError as error:
        cure = (
            "Free some space or choose"
            if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
            else "Choose"
        )
        raise InputError(
            f"{target} must be writable, got: {error.strerror or error}. {cure} another place."
        ) from None


def write_whole(target: Path, content: bytes) -> None:
    """Write a file in one step, or leave what was there; of two that write the same one the later
    wins whole."""
    staging = target.with_name(f".{target.name}-{secrets.token_hex(4)}.part")
    with _writing(target):
        try:
            staging.write_bytes(content)
            os.replace(staging, target)
        finally:
            staging.unlink(missing_ok=True)


def check_target(target: Path, *, force: bool, ours: Collection[str] = ()) -> None:
    """Refuse a target that must not be replaced or cannot be written, before any work is done. An
    existing folder may be replaced with ``force``, where it holds only names that are ``ours``."""
    try:
        with suppress(FileNotFoundError, NotADirectoryError, PermissionError):
            target.stat()
        standing = target.resolve() in (Path.cwd(), *Path.cwd().parents)
    except (OSError, RuntimeError, ValueError):
        raise InputError(
            f"{target} must be a name of a folder, got one that leads nowhere. Check the link."
        ) from None
    require(
        not standing,
        f"{target} must not be the folder you stand in, or one above it. Choose another name.",
    )
    with _writing(target):
        is_file = False
        names = None
        try:
            names = os.listdir(target)  # one look: another run may be replacing the folder
        except FileNotFoundError:
            pass
        except NotADirectoryError:
            is_file = target.exists()
        free = names is None and not is_file
        require(
            free or force,
            f"{target} must not exist, got an existing one. Choose another name or pass --force.",
        )
        require(not is_file, f"{target} must be a folder, got a file. Choose another name.")
        for foreign in sorted(set(names or ()) - set(ours)):
            got = f"{target} must hold nothing but earlier results to be replaced, got {foreign!r}"
            raise InputError(f"{got}. Move it away or choose another name.")
        target.parent.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryDirectory(prefix=f".{target.name}-", dir=target.parent).cleanup()


@contextmanager
def staged_folder(target: Path, *, force: bool, ours: Collection[str] = ()) -> Iterator[Path]:
    """A scratch folder beside ``target`` that takes its place when the block ends well. The old
    folder is there until the new one is whole; then the old one is renamed, and the new one. Of two
    runs into one folder the later wins whole. A link stays; what it points to is replaced. Where
    writing fails the old target stands untouched."""
    check_target(target, force=force, ours=ours)
    target = target.resolve() if target.is_symlink() else target
    with _writing(target):
        staging = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    try:
        with _writing(target):
            yield staging
            staging.chmod(0o755)
            _take_place(staging, target, force=force)
    except InputError as error:
        raise InputError(str(error).replace(str(staging), str(target))) from None
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _take_place(staging: Path, target: Path, *, force: bool) -> None:
    """Make ``staging`` the target, also where another run does the same at the same time."""
    retired = staging.with_name(f"{staging.name}-old")
    while True:
        try:
            os.rename(staging, target)
            break
        except OSError as error:
            occupied = error.errno in (errno.ENOTEMPTY, errno.EEXIST) and not target.is_file()
            if not (occupied or (error.errno == errno.EACCES and target.is_dir())):
                if retired.is_dir() and not target.exists():
                    os.rename(retired, target)
                raise
        got = "one that another run wrote meanwhile"
        require(force, f"{target} must not exist, got {got}. Choose another name or pass --force.")
        shutil.rmtree(retired, ignore_errors=True)
        with suppress(FileNotFoundError):
            os.rename(target, retired)
    shutil.rmtree(retired, ignore_errors=True)


# Keys of more parts cost time that grows with the square of their number; none of our files has
# more than three.
_DEEP = re.compile(
    r"(?:(?:[\w-]{1,200}|\"[^\"\n]{0,200}\"|'[^'\n]{0,200}')[ \t]{0,9}\.[ \t]{0,9}){8}"
)


def read_toml(path: Path) -> dict[str, Any]:
    """Return the content of a file; an `InputError` names it and the place in it."""
    raw = bytes_of(path, LARGEST_TOML_BYTES, what="a readable TOML file")
    try:
        return parse_toml(raw.decode("utf-8-sig"), str(path))
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"{path}, line {line}: TOML must be UTF-8, got other bytes. Save it as UTF-8."
        ) from None


def parse_toml(text: str, place: str) -> dict[str, Any]:
    """Return the content of a text; ``place`` is what an `InputError` calls it."""
    kilobytes = LARGEST_TOML_BYTES // 2**10
    require(
        len(text) <= LARGEST_TOML_BYTES,
        f"{place} must hold at most {kilobytes} kB, got more. Split it.",
    )
    for number, line in enumerate(text.split("\n"), start=1):
        if len(line) > LONGEST_LINE or _DEEP.search(line):
            got = f"lines must be short and keys plain, got {line[:40]!r}…"
            raise InputError(f"{place}, line {number}: {got}. Correct that line.")
    try:
        return tomllib.loads(text)
    except (RecursionError, ValueError, OverflowError) as error:
        raise InputError(f"{place} must be valid TOML, got: {error}. Correct that place.") from None


def validated(model: type[T], content: dict[str, Any], place: str) -> T:
    """Return the content of a file as a pydantic model or dataclass. An `InputError` names the
    place and the first thing wrong, a misspelt key, with the nearest known, before the gap it
    leaves."""
    try:
        return TypeAdapter(model).validate_python(content)
    except ValidationError as error:
        errors = error.errors()
    first = next((entry for entry in errors if entry["type"] in _UNKNOWN), errors[0])
    keys: list[str] = []
    value: Any = content
    owner: Any = model
    for part in first["loc"]:
        if not isinstance(value, dict | list):
            break  # what follows names a kind, not a key
        keys.append(str(part + 1) if isinstance(part, int) else part)
        value = dict(enumerate(value) if isinstance(value, list) else value).get(part)
        hints = [
            field.annotation
            for name, field in owner.__pydantic_fields__.items()
            if part in (name, field.alias)
        ]
        kinds = [kind for hint in hints for kind in (hint, *get_args(hint))]
        owner = next((kind for kind in kinds if hasattr(kind, "__pydantic_fields__")), owner)
    where = f" in [{' '.join(keys[:-1])}]" if len(keys) > 1 else ""
    if isinstance(own := first.get("ctx", {}).get("error"), InputError):
        raise InputError(f"{place}, [{' '.join(keys)}]: {own}")
    if first["type"] in _UNKNOWN:
        known = [field.alias or name for name, field in owner.__pydantic_fields__.items()]
        raise InputError(
            f"{place}: keys{where} must be among {', '.join(known)}, got {keys[-1]!r}. Did you mean"
            f" {nearest(keys[-1], known)!r}?"
        )
    require(
        first["type"] != "missing",
        f"{place}: {keys[-1]!r}{where} must be given, got nothing. Add it.",
    )
    raise InputError(f"{place}: {_invalid(f'{keys[-1]!r}{where}', first)}")


def _invalid(what: str, first: Any) -> str:
    why = re.sub(
        r"dictionary or an instance of _\w+",
        "table",
        first["msg"].removeprefix("Value error, "),
    )
    got = first["input"]
    if why.startswith(_SHOULD):
        return f"{what} must be {why.removeprefix(_SHOULD)}, got {got!r}. Correct it."
    return f"{what} must be valid, got {got!r}: {why[0].lower()}{why[1:]}. Correct it."


def refusing(what: str) -> Callable[[type[T]], type[T]]:
    """Return a decorator of pydantic dataclasses: arguments that do not fit are an `InputError`
    that names the field."""

    def decorated(cls: type[T]) -> type[T]:
        init = cls.__init__

        @wraps(init)
        def checked(self: T, *args: Any, **fields: Any) -> None:
            try:
                init(self, *args, **fields)
            except ValidationError as error:
                first = error.errors()[0]
                own = first.get("ctx", {}).get("error")
                if isinstance(own, InputError):
                    raise own from None
                place = f"{what} {name!r}" if (name := fields.get("name")) else what
                key = first["loc"][0]
                known = [
                    name
                    for name, field in vars(cls)["__dataclass_fields__"].items()
                    if field.init and not field.kw_only
                ]
                raise InputError(
                    f"{place}: {_invalid(known[key] if isinstance(key, int) else key, first)}"
                ) from None

        cls.__init__ = checked  # type: ignore[method-assign, assignment]
        return cls

    return decorated


def xml_of(raw: bytes, wanted: str) -> ElementTree.Element:
    """Return the root element; document types, and so entities, and great depth are refused.
    ``wanted``: what to give instead."""
    depth = 0

    def refuse(*_: object) -> None:
        raise InputError(
            "the file must have no document type (DTD), got one. Remove <!DOCTYPE …> and its"
            " entities."
        )

    def move(step: int) -> None:
        nonlocal depth
        depth += step
        require(
            depth <= _DEEPEST,
            f"its elements must be nested at most {_DEEPEST} deep, got more. Ask for another file.",
        )

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = lambda *_: move(1)
    parser.EndElementHandler = lambda *_: move(-1)
    try:
        parser.Parse(raw, True)
        return ElementTree.fromstring(raw)
    except InputError:
        raise
    except (expat.ExpatError, ElementTree.ParseError, LookupError, ValueError) as error:
        raise InputError(f"the file must be XML, got: {error}. Give {wanted}.") from None
