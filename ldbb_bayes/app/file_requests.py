"""Answers to the requests that add files to a session (one browser tab) and remove them."""

from __future__ import annotations

import re
import secrets
import shutil
from pathlib import Path, PurePosixPath, PureWindowsPath

from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response

import ldbb_bayes as lb
from ldbb_bayes.app.answers import refused
from ldbb_bayes.app.fields import FILES
from ldbb_bayes.app.session import Session
from ldbb_bayes.app.session_registry import SessionRegistry
from ldbb_bayes.app.templates import LARGEST_FILE, MOST_FILES

__all__ = ["add_file", "file_name", "remove_file", "take_example"]

LARGEST_SESSION = 4 * 2**26  # largest total size of the files of one browser tab [bytes]
_LONGEST_NAME = 120  # largest length of the name of a stored file [bytes]


def file_name(sent: str) -> str:
    """Return the name under which a file from the browser is stored.

    Parameters
    ----------
    sent
        File name or file path, as the browser sends it.

    Returns
    -------
    str
        Last element of the file path, in which special characters are replaced by underscores; an
        empty string if the path has no such element.
    """
    name = PureWindowsPath(PurePosixPath(sent).name).name
    name = re.sub(r"[^\w+\-.,()\[\] ]", "_", name).strip(" .")
    name = name.encode()[-_LONGEST_NAME:].decode(errors="ignore").lstrip(" .")
    # On Windows, file names such as ``con`` stand for devices: put an underscore before the name.
    return re.sub(r"(?i)^(?=(con|prn|aux|nul|com\d|lpt\d)(\.|$))", "_", name)


async def add_file(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Store a file that the browser sends for a session (one browser tab).

    The file is stored completely or not at all.
    """
    sent_name = request.path_params["name"]
    name = file_name(sent_name)
    if not name or not session.folder.exists():
        return refused(session.word("name"), 422)
    async with session.adding:
        sizes = session.file_sizes
        if name in sizes and session.names.get(name, sent_name) != sent_name:
            message = session.word("same_name", name=sent_name, other=session.names[name])
            return refused(message, 409)
        if name not in sizes and len(sizes) >= MOST_FILES:
            return refused(session.word("too_many", most=MOST_FILES), 413)
        other_sizes = sum(size for other, size in sizes.items() if other != name)
        most_bytes = min(LARGEST_FILE, LARGEST_SESSION - other_sizes)
        too_large = session.word("too_large", name=name, most=max(most_bytes, 0) // 2**20)
        if int(request.headers.get("content-length", 0)) > most_bytes:
            return refused(too_large, 413)
        path = session.folder / f"{secrets.token_hex(8)}.part"
        try:
            if not await _receive(request, path, most_bytes):
                return refused(too_large, 413)
            path.replace(session.folder / FILES / name)
            session.names[name] = sent_name
            session.update_after_file_change()
        # An OSError means that the session (browser tab) has ended and its folder was deleted.
        except (ClientDisconnect, OSError):
            return refused(session.word("broken_off", name=name), 400)
        finally:
            path.unlink(missing_ok=True)
    return JSONResponse({"name": name})


async def _receive(request: Request, path: Path, most_bytes: int) -> bool:
    """Write the body of a request into the file ``path``, and return whether it is small enough.

    A body of more than ``most_bytes`` bytes is too large, and is not read to its end.
    """
    size = 0
    with path.open("wb") as file:
        async for chunk in request.stream():
            size += len(chunk)
            if size > most_bytes:
                return False
            file.write(chunk)
    return True


async def remove_file(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Delete one file of the session (one browser tab), or all files if the name is ``*``."""
    session.delete_files(request.path_params["name"])
    return JSONResponse({})


async def take_example(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Replace the files of the session (browser tab) by the example files of the package.

    The example is the published experiment whose readings are part of the package.
    """
    session.delete_files()
    for path in Path(lb.embedded_campaign()).iterdir():
        if path.suffix in (".csv", ".toml"):
            shutil.copyfile(path, session.folder / FILES / path.name)
    session.entries.clear()
    session.update_after_file_change()
    return JSONResponse({})
