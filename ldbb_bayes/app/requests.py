"""Answers to the HTTP requests of a browser page that has a session.

A session is one browser tab with its files, its typed entries and its computations.
"""

from __future__ import annotations

import asyncio
import io
import json
import re
import secrets
import shutil
import zipfile
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response

import ldbb_bayes as lb
from ldbb_bayes.app.cheapest import CHEAPEST, passages_shown, wrong_entry
from ldbb_bayes.app.computation import Computation
from ldbb_bayes.app.fields import FIELDS, FILES, RESULT
from ldbb_bayes.app.goal_fields import goal_texts
from ldbb_bayes.app.page_words import LANGUAGES
from ldbb_bayes.app.planning import PLAN, forecast, plan
from ldbb_bayes.app.session import Session
from ldbb_bayes.app.session_registry import SessionRegistry
from ldbb_bayes.app.templates import LARGEST_FILE, MOST_FILES
from ldbb_bayes.app.understanding import understand
from ldbb_bayes.app.worth import effects_of_certificates
from ldbb_bayes.report.message_translation import in_language
from ldbb_bayes.report.passage_translation import passages_in_language

__all__ = ["ROUTES", "Answer", "file_name", "refused"]

LARGEST_SESSION = 4 * 2**26  # largest total size of the files of one browser tab [bytes]
LARGEST_FORM = 2**17  # largest total size of the entries of a form on the browser page [bytes]
# largest length of one entry that a user types on the browser page [characters]
_LONGEST_ENTRY = 20_000
_LONGEST_NAME = 120  # largest length of the name of a stored file [bytes]
# Content security policy (an HTTP header) for the page of a report. With this policy, the browser
# applies the style that the page contains, but runs no script.
_REPORT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action"
    " 'none'; frame-ancestors 'self'"
)
_SHOWN_FILES = {"report.html": "text/html", "report.pdf": "application/pdf"}
# Files that the user can download. The keys are the names of the downloaded files; the values are
# the paths of the files, relative to the report folder.
_SAVED_FILES = {
    "report.json": "report.json",
    "dcc.xml": "dcc.xml",
    "posterior.nc": "posterior.nc",
    "parameters.csv": "tables/averaged.csv",
}
# Table that is downloaded as parameters.csv if the results for constant and linear compliance could
# not be averaged. The table has the results of the fit with linear compliance alone. In this case,
# the report also shows these results.
_FIT_TABLE = "tables/results.csv"
_ZIPPED_FOLDERS = {"tables.zip": "tables", "campaign.zip": "campaign", "report.zip": ""}

Answer = Callable[[SessionRegistry, Session, Request], Awaitable[Response]]


def refused(message: str, status: int) -> Response:
    """Return an HTTP response for a request that is refused. The browser page shows the reason.

    Parameters
    ----------
    message
        Reason why the request is refused.
    status
        HTTP status code, such as 404.

    Returns
    -------
    Response
        Response with the JSON object ``{"refused": message}``.
    """
    return JSONResponse({"refused": message}, status)


# ---- the page and its sections


async def _show_page(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Return the whole HTML page of a session (one browser tab)."""
    page = registry.templates.show(
        "page.html.j2", session.language, session=session, languages=LANGUAGES
    )
    return HTMLResponse(page)


async def _show_section(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Return the HTML of one section of the page, such as the list of files or the plan."""
    name = request.path_params["name"]
    values: dict[str, Any] = {}
    if name == "understood":
        understood = await registry.answering_process.ask(
            understand, session, session.typed_texts()
        )
        session.wrong_entries = understood.get("wrong", [])
        values["found"] = understood
    elif name == "worth":
        values["found"] = await registry.answering_process.ask(
            effects_of_certificates, session, session.typed_texts()
        )
    elif name == "plan":
        values["found"] = await registry.answering_process.ask(
            forecast, session, session.plan_entries
        )
        values["passages"] = passages_shown(session.search.outcome, session.language)
    elif name == "cheapest":
        values["passages"] = passages_shown(session.search.outcome, session.language)
    elif name not in ("files", "fit", "sheets"):
        return refused(session.word("nothing"), 404)
    section = registry.templates.show(
        f"{name}.html.j2", session.language, session=session, **values
    )
    return HTMLResponse(section)


async def _state(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Return the state of a session as JSON, and record that its browser tab is open."""
    tabs = session.tabs or set()
    session.tabs = (tabs | {request.query_params.get("tab", "")}) - session.closed
    return JSONResponse(session.state())


async def _leave(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Record that the user has closed a browser tab of the session.

    A reload of the page also counts as closing the tab. The reloaded page counts as a new tab with
    a new identifier.
    """
    session.closed.add(request.query_params.get("tab", ""))
    session.tabs = (session.tabs or set()) - session.closed
    return Response(status_code=204)


# ---- files that the user adds


async def _read_json(request: Request) -> dict[str, Any] | None:
    """Return the JSON object that a request contains; an empty dict for an empty request.

    Return None if the content of the request is no JSON object, or is too large.
    """
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > LARGEST_FORM:
            return None
    try:
        sent = json.loads(bytes(body) or b"{}")
    except (ValueError, RecursionError):
        return None
    return sent if isinstance(sent, dict) else None


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


async def _add_file(registry: SessionRegistry, session: Session, request: Request) -> Response:
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


async def _remove_file(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Delete one file of the session (one browser tab), or all files if the name is ``*``."""
    session.delete_files(request.path_params["name"])
    return JSONResponse({})


async def _take_example(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Replace the files of the session (browser tab) by the example files of the package.

    The example is the published experiment whose readings are part of the package.
    """
    session.delete_files()
    for path in Path(lb.embedded_campaign()).iterdir():
        if path.suffix in (".csv", ".toml"):
            shutil.copyfile(path, session.folder / FILES / path.name)
    session.choices.clear()
    session.update_after_file_change()
    return JSONResponse({})


# ---- the user's entries, and the fit


async def _take_choices(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Store the texts that the user typed on the page, or the language that the user chose.

    The request contains the texts as a JSON object, whose keys are the names of the entry fields.
    """
    sent = await _read_json(request)
    if sent is None or not all(_is_entry(text) for text in sent.values()):
        return refused(session.word("form"), 422)
    if "language" in sent:
        if sent["language"] in LANGUAGES and sent["language"] != session.language:
            session.language = sent["language"]
            # The user has changed the language. The new value of ``edition``, the number of the
            # user's changes, tells the browser page that the report must be written again.
            session.edition += 1
        return JSONResponse({})
    choices = {}
    for name, text in sent.items():
        if name in FIELDS and text.strip():
            choices[name] = text.strip()
    if choices != session.choices:
        session.edition += 1
    session.choices = choices
    return JSONResponse({})


def _is_entry(text: object) -> bool:
    """Return whether a value is a text short enough for an entry field of the browser page."""
    return isinstance(text, str) and len(text) < _LONGEST_ENTRY


async def _fit(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Start the fit of a session's files, if no fit is running, and return the session's state."""
    if not session.fit.running:
        session.fit.outcome = {}
        session.fit.task = asyncio.create_task(registry.fit(session))
    return JSONResponse(session.state())


async def _cancel_fit(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Stop the fit of a session (browser tab), and return the session's state."""
    return await _cancel(session, session.fit)


async def _cancel(session: Session, computation: Computation) -> Response:
    """Stop a computation of a session if it is running, and return the session's state."""
    if computation.running and computation.task is not None:
        computation.stop()
        await asyncio.wait([computation.task])
        computation.outcome = {"cancelled": True}
    return JSONResponse(session.state())


async def _show_forecast(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Return a section of the page with the results that are expected from the next tests.

    The request contains the values of the page's sliders, which describe these tests.
    """
    sent = await _read_json(request)
    if sent is None:
        return refused(session.word("form"), 422)
    expected = await registry.answering_process.ask(forecast, session, sent)
    if "refused" not in expected:
        session.plan_entries = sent
    section = registry.templates.show("forecast.html.j2", session.language, found=expected)
    return HTMLResponse(section)


# ---- the search for the cheapest campaign


async def _search(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Start a search for the cheapest campaign that reaches the uncertainty goals of the user.

    The request contains the texts of the entry fields for goals and costs. If a text cannot be
    used, the response states the reason and the name of the entry field.
    """
    sent = await _read_json(request)
    if sent is None:
        return refused(session.word("form"), 422)
    if session.search.running:
        return refused(session.word("searching"), 409)
    if session.fit.running:
        return refused(session.word("fitting"), 409)
    refusal = session.refusal("no_goal")
    if goal_texts(sent):
        # The function ``wrong_entry`` runs in the process that answers the requests of the pages.
        # It returns a dictionary that states why a goal or cost that the user typed cannot be used.
        # The dictionary is empty if all goals and costs can be used.
        refusal = await registry.answering_process.ask(wrong_entry, session, sent)
    # While this request waited for the check of the typed goals and costs, another request may have
    # started a search for the cheapest campaign.
    if session.search.running:
        return refused(session.word("searching"), 409)
    session.search_entries = sent
    session.search.outcome = refusal
    if "refused" in refusal:
        return JSONResponse({"refused": refusal["refused"], "wrong": refusal.get("wrong", "")})
    session.search.task = asyncio.create_task(registry.search(session))
    return JSONResponse(session.state())


async def _stop_search(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Stop a session's search for the cheapest campaign, and return the session's state."""
    return await _cancel(session, session.search)


async def _send_cheapest(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Return the operator's sheet of a campaign that was found, or a ZIP archive of its files.

    The URL path states the number of the campaign, where 1 is the cheapest. It also states ``html``
    for the sheet or ``zip`` for the archive.
    """
    number = request.path_params["number"]
    kind = request.path_params["kind"]
    outcome = session.search.outcome
    campaigns = outcome.get("campaigns", ())
    if not 1 <= number <= len(campaigns) or kind not in ("html", "zip"):
        return refused(session.word("nothing"), 404)
    if kind == "html":
        planned = {**campaigns[number - 1], "pilot": outcome["pilot"]}
        return HTMLResponse(_operator_sheet(registry, session, planned))
    folder = session.search.folder / CHEAPEST / str(number)
    return await _send_zipped(folder, f"cheapest-{number}.zip")


def _operator_sheet(registry: SessionRegistry, session: Session, planned: Mapping[str, Any]) -> str:
    """Return the operator's sheet of planned circles as HTML, in the language of a session.

    ``planned`` holds what `circle_rows` returns of the circles, their time, and the texts of the
    campaign on which they are based.
    """
    return registry.templates.show(
        "operator.html.j2",
        session.language,
        found=planned,
        mountings=passages_in_language(planned["mountings"], session.language),
        handling=passages_in_language(planned["handling"], session.language),
    )


# ---- results of a fit


async def _send_result(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Return a response with a file of a session's report or plan, or with a ZIP archive.

    A session is one browser tab. The last part of the URL path is the name of the file.
    """
    name = request.path_params["name"]
    folder = session.folder / RESULT
    if name in ("plan.html", "plan.zip"):
        return await _send_plan(registry, session, name)
    if name in _ZIPPED_FOLDERS and folder.is_dir():
        return await _send_zipped(folder / _ZIPPED_FOLDERS[name], name)
    path = folder / _SAVED_FILES.get(name, name)
    if name == "parameters.csv" and not path.is_file():
        path = folder / _FIT_TABLE
    if name not in (*_SHOWN_FILES, *_SAVED_FILES) or not path.is_file():
        return refused(session.word("nothing"), 404)
    headers = {}
    if name == "report.html":
        headers["content-security-policy"] = _REPORT_POLICY
    return FileResponse(
        path,
        filename=name,
        headers=headers,
        media_type=_SHOWN_FILES.get(name),
        content_disposition_type="inline" if name in _SHOWN_FILES else "attachment",
    )


async def _send_plan(registry: SessionRegistry, session: Session, name: str) -> Response:
    """Return the operator's sheet of the planned tests, or a ZIP archive of the plan's files.

    ``name`` is the name of the file: plan.html for the sheet, plan.zip for the archive.
    """
    planned = await registry.answering_process.ask(plan, session, session.plan_entries)
    if "refused" in planned:
        message = str(planned["refused"])
        return refused(in_language(message, session.language) or message, 422)
    if name == "plan.html":
        return HTMLResponse(_operator_sheet(registry, session, planned))
    return await _send_zipped(session.folder / PLAN, name)


async def _send_zipped(folder: Path, name: str) -> Response:
    """Return a response with a ZIP archive of all files in a folder.

    ``name`` is the name under which the browser saves the archive.
    """
    archive = await asyncio.to_thread(_zip_folder, folder)
    headers = {"content-disposition": f'attachment; filename="{name}"'}
    return Response(archive, media_type="application/zip", headers=headers)


def _zip_folder(folder: Path) -> bytes:
    """Return the bytes of a ZIP archive of all files in a folder and its subfolders."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                archive.write(path, str(path.relative_to(folder)))
    return buffer.getvalue()


#: HTTP method and URL path of every request from a session (one browser tab), and the function that
#: answers the request.
ROUTES: tuple[tuple[str, str, Answer], ...] = (
    ("GET", "/", _show_page),
    ("GET", "/part/{name}", _show_section),
    ("GET", "/state", _state),
    ("PUT", "/files/{name:path}", _add_file),
    ("DELETE", "/files/{name}", _remove_file),
    ("POST", "/example", _take_example),
    ("POST", "/say", _take_choices),
    ("POST", "/fit", _fit),
    ("POST", "/cancel", _cancel_fit),
    ("POST", "/leave", _leave),
    ("POST", "/plan", _show_forecast),
    ("POST", "/search", _search),
    ("POST", "/stop", _stop_search),
    ("GET", "/result/cheapest-{number:int}.{kind}", _send_cheapest),
    ("GET", "/result/{name}", _send_result),
)
