"""The page of ``ldbb-bayes app``: a server for this machine alone, a session for every tab, and the
processes that work for them.

Only loopback is listened on; every address begins with a token; Host and Origin must be this
server's. A session is a folder and what its page was told. It ends with its tab, and its files and
its processes with it.
"""

from __future__ import annotations

import asyncio
import io
import json
import os
import re
import secrets
import shutil
import signal
import socket
import sys
import tempfile
import time
import tomllib
import webbrowser
import zipfile
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from contextlib import ExitStack, asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache, partial
from importlib.resources import files
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import jinja2
import uvicorn
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.routing import Mount, Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

import ldbb_bayes as lb
from ldbb_bayes.app import worker
from ldbb_bayes.errors import InputError
from ldbb_bayes.files import LARGEST_TABLE_BYTES
from ldbb_bayes.parallel import ONE_THREAD, WorkerDiedError, process_executor

__all__ = ["Pages", "application", "serve", "words_of_page"]

LOOPBACK = "127.0.0.1"
MOST_SESSIONS = 32
MOST_WAITING = 100
MOST_FILES = 400
LARGEST_FILE = LARGEST_TABLE_BYTES
LARGEST_SESSION = 4 * 2**26
LARGEST_WORDS = 2**17
# Seconds until a session ends: closed (a reload is back at once), never opened, silent (tabs in the
# background sleep).
CLOSED_S = 8.0
UNOPENED_S = 60.0
SILENT_S = 3600.0
ANSWER_S = 120.0
LOOK_S = 1.0
# Until the fit of a page that asks for nothing any more gives way to one that waits.
ABANDONED_S = 150.0
_PAGES = files("ldbb_bayes.app") / "pages"
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src"
    " 'self'; frame-src 'self'"
)
_OF_PAGE = f"{_POLICY}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
# The report brings its own style and no script.
_OF_REPORT = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action"
    " 'none'"
)
_OF_REPORT += "; frame-ancestors 'self'"
_ALWAYS = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "same-origin",
    "cache-control": "no-store",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}
_BACKLOG = 512
_PREFIX = "ldbb-bayes-"
_FIT = "from ldbb_bayes.app.worker import main; main()"
_SHOWN = {"report.html": "text/html", "report.pdf": "application/pdf"}
_LOADED = {
    "report.json": "",
    "dcc.xml": "",
    "posterior.nc": "",
    "parameters.csv": "tables/averaged.csv",
}
_UNAVERAGED = (  # where nothing could be averaged over, the sheets state the fit itself
    "tables/results.csv"
)
_FOLDERS = {"tables.zip": "tables", "campaign.zip": "campaign", "report.zip": ""}


# ---- words and pages


@cache
def words_of_page(language: str) -> Mapping[str, Any]:
    """Return the words of a language, en or de."""
    return tomllib.loads((_PAGES / f"words_{language}.toml").read_text(encoding="utf-8"))


LANGUAGES = ("en", "de")


class Pages:
    """What is shown: templates, filled in the language of a session; all text is escaped."""

    def __init__(self) -> None:
        loader = jinja2.PackageLoader("ldbb_bayes.app", "pages")
        self._templates = jinja2.Environment(
            loader=loader, autoescape=True, undefined=jinja2.StrictUndefined
        )
        self._templates.filters |= {"number": self._number, "phrase": self._phrase}

    @staticmethod
    @jinja2.pass_context
    def _number(context: jinja2.runtime.Context, value: object) -> str:
        """With the decimal sign of the language."""
        return re.sub(r"(?<=\d)\.(?=\d)", str(context["w"]["decimal"]), str(value))

    @staticmethod
    @jinja2.pass_context
    def _phrase(context: jinja2.runtime.Context, text: str) -> str:
        """What an import says, in the language as far as it is known there."""
        for pattern, other in context["w"]["phrases"].items():
            text = re.sub(pattern, other, text)
        return text

    def show(self, template: str, language: str, **values: Any) -> str:
        """Return a page, or a part of one."""
        limits = {"files": MOST_FILES, "bytes": LARGEST_FILE}
        filled = {
            "w": words_of_page(language),
            "language": language,
            "fields": worker.FIELDS,
            "most": limits,
            **values,
        }
        return self._templates.get_template(template).render(filled)


# ---- sessions


@dataclass(eq=False)
class Session:
    """One tab: its folder, what its page was told, and its fit."""

    key: str
    folder: Path
    language: str
    choices: dict[str, str] = field(default_factory=dict)
    wrong: list[str] = field(default_factory=list)  #: those of them that were refused
    edition: int = 0  #: of files and choices
    fitted: int = -1  #: the edition that the report is of
    asked: dict[str, Any] = field(default_factory=dict)  #: of the plan
    outcome: dict[str, Any] = field(default_factory=dict)  #: of the last fit
    task: asyncio.Task[None] | None = None
    process: asyncio.subprocess.Process | None = None
    seen: float = field(default_factory=time.monotonic)
    tabs: set[str] | None = None  #: that show it; none has asked yet
    closed: set[str] = field(default_factory=set)  #: tabs, whose last questions may come late
    #: by which files were sent, by those by which they are kept
    names: dict[str, str] = field(default_factory=dict)
    #: files come one after another, so that they fit together
    adding: asyncio.Lock = field(default_factory=asyncio.Lock)

    @property
    def is_over(self) -> bool:
        """Whether its tabs were closed, are silent for too long, or never came."""
        silent = time.monotonic() - self.seen
        return silent > (UNOPENED_S if self.tabs is None else SILENT_S if self.tabs else CLOSED_S)

    @property
    def held(self) -> dict[str, int]:
        """Sizes of its files [bytes], in the order in which an import takes them: by suffix, 2 N
        before 10 N."""
        return {
            own.name: own.stat().st_size
            for own in sorted((self.folder / worker.FILES).iterdir(), key=_in_order)
        }

    def drop(self, name: str = "*") -> None:
        """Delete a file, or all."""
        for own in self.held:
            if name in (own, "*"):
                (self.folder / worker.FILES / own).unlink(missing_ok=True)
        self.changed()

    def changed(self) -> None:
        """Forget what no longer applies to the files: what a campaign says itself, and certificates
        that are gone."""
        held = self.held
        fields = worker.FIELDS
        gone = {
            name
            for name, own in self.choices.items()
            if fields[name].kind == "file" and own not in held
        }
        if worker.TOML in held:
            gone |= {
                name for name in self.choices if fields[name].group in ("name", "table", "layout")
            }
        self.choices = {name: own for name, own in self.choices.items() if name not in gone}
        self.edition += 1

    @property
    def certificates(self) -> list[str]:
        """Files that may be certificates."""
        return [name for name in self.held if name.lower().endswith(".xml")]

    @property
    def running(self) -> bool:
        """Whether a fit is under way, or waits for its turn."""
        return self.task is not None and not self.task.done()

    def state(self) -> dict[str, Any]:
        """Return what the page asks for again and again."""
        progress: dict[str, Any] = {
            "share": 0.0,
            "step": "start" if self.process else "waiting",
            "of": 0,
        }
        if self.running and self.process is not None:
            with suppress(OSError, ValueError):
                progress = json.loads(
                    (self.folder / "job" / "progress.json").read_text(encoding="utf-8")
                )
        return {
            "files": len(self.held),
            "edition": self.edition,
            "fitted": self.fitted,
            "running": self.running,
            "progress": progress,
            "outcome": self.outcome,
        }

    def word(self, key: str, **values: object) -> str:
        """Return what a refusal says."""
        return str(words_of_page(self.language)["errors"][key]).format(**values)

    def said(self) -> dict[str, str]:
        """Return what was said on the page, with the language of the sheets."""
        return {**self.choices, "language": self.language}

    def stop(self) -> None:
        """End its processes now."""
        if self.task is not None:
            self.task.cancel()
        _kill(self.process)


def _in_order(path: Path) -> tuple[bool, str, list[Any]]:
    parts = re.split(r"([0-9]+)", path.name.casefold())
    return not path.suffix, path.suffix, [int(part) if part.isdigit() else part for part in parts]


def _kill(process: asyncio.subprocess.Process | None) -> None:
    """A process and those that it has started."""
    if process is not None and process.returncode is None:
        with suppress(ProcessLookupError, PermissionError):
            if hasattr(os, "killpg"):
                os.killpg(process.pid, signal.SIGKILL)
            else:
                process.kill()


class Desk:
    """One process that answers all pages' short questions in turn; where it dies or hangs another
    begins."""

    def __init__(self) -> None:
        self._waiting = 0
        self._turn = asyncio.Semaphore(1)
        self._begin()

    def _begin(self) -> None:
        self._stack = ExitStack()
        self._pool = self._stack.enter_context(process_executor(1))
        self._ready = self._pool.submit(worker.warm)

    async def ask(
        self, work: Callable[..., dict[str, Any]], session: Session, *more: Any
    ) -> dict[str, Any]:
        """Return the answer of a function of the worker, or why there is none. The process has one
        question at a time: its time counts from where it begins."""
        if self._waiting >= MOST_WAITING:
            return {"refused": session.word("busy")}
        self._waiting += 1
        try:
            async with self._turn:
                return await self._answer(
                    partial(worker.answer, work, str(session.folder), *more), session
                )
        except Exception as error:  # whatever it is, the page says so and goes on
            return {
                "refused": session.word(
                    "unexpected", error=f"{type(error).__name__}: {error}"[:300]
                )
            }
        finally:
            self._waiting -= 1

    async def _answer(self, call: Callable[[], dict[str, Any]], session: Session) -> dict[str, Any]:
        for _ in range(2 if session.folder.exists() else 0):
            with suppress(WorkerDiedError):
                await asyncio.wait([asyncio.wrap_future(self._ready)])
                try:
                    return await asyncio.wait_for(
                        asyncio.wrap_future(self._pool.submit(call)), ANSWER_S
                    )
                except TimeoutError:
                    await asyncio.to_thread(self.stop)
                    self._begin()
                    break
        return {"refused": session.word("died")}

    def stop(self) -> None:
        """End the process, whatever it is at."""
        ended = KeyboardInterrupt()
        self._stack.__exit__(type(ended), ended, None)


@dataclass(eq=False)
class House:
    """All sessions, the desk, and the folder that holds both's files."""

    folder: Path
    desk: Desk
    pages: Pages = field(default_factory=Pages)
    sessions: dict[str, Session] = field(default_factory=dict)
    #: one fit at a time has all cores
    turn: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(1))

    def begin(self, language: str) -> Session | None:
        """Return a new session; None where there are too many."""
        if len(self.sessions) >= MOST_SESSIONS:
            return None
        key = secrets.token_urlsafe(12)
        session = Session(key, self.folder / key, language)
        (session.folder / worker.FILES).mkdir(parents=True)
        self.sessions[key] = session
        return session

    def end(self, session: Session) -> None:
        """Stop its work and delete its files."""
        self.sessions.pop(session.key, None)
        session.stop()
        shutil.rmtree(session.folder, ignore_errors=True)

    async def look_after(self) -> None:
        """End what is over."""
        while True:
            await asyncio.sleep(LOOK_S)
            for session in [own for own in self.sessions.values() if own.is_over]:
                self.end(session)
            waiting = any(own.running and own.process is None for own in self.sessions.values())
            for session in self.sessions.values():
                if (
                    waiting
                    and session.process is not None
                    and time.monotonic() - session.seen > ABANDONED_S
                ):
                    session.stop()
                    session.outcome = {"refused": session.word("gave_way")}
            for left in (
                self.folder.iterdir()
            ):  # what work that was under way has written after the end of its session
                if left.name not in self.sessions:
                    shutil.rmtree(left, ignore_errors=True)

    async def fit(self, session: Session) -> None:
        """Run the report in a process of its own, on a copy of what is there when it begins."""
        job = session.folder / "job"
        nowhere = asyncio.subprocess.DEVNULL
        try:
            async with self.turn:
                edition = session.edition
                shutil.rmtree(job, ignore_errors=True)
                await asyncio.to_thread(
                    shutil.copytree, session.folder / worker.FILES, job / worker.FILES
                )
                (job / "said.json").write_text(json.dumps(session.said()), encoding="utf-8")
                session.process = await asyncio.create_subprocess_exec(
                    sys.executable,
                    "-P",
                    "-c",
                    _FIT,
                    str(job),
                    str(os.getpid()),
                    stdin=nowhere,
                    stdout=nowhere,
                    stderr=nowhere,
                    env={**os.environ, **ONE_THREAD},
                    start_new_session=True,
                )
                await session.process.wait()
            session.outcome = {"refused": session.word("fit_died")}
            with suppress(OSError, ValueError):
                session.outcome = json.loads((job / "outcome.json").read_text(encoding="utf-8"))
            if (
                "refused" not in session.outcome
            ):  # only a whole report takes the place of the one before
                shutil.rmtree(session.folder / worker.RESULT, ignore_errors=True)
                (job / worker.RESULT).rename(session.folder / worker.RESULT)
                session.fitted = edition
                session.asked = {}
        except OSError as error:
            session.outcome = {
                "refused": session.word(
                    "unexpected", error=error.strerror or "a file could not be copied"
                )
            }
        finally:
            _kill(session.process)
            session.process = None


# ---- what is asked


Answer = Callable[[House, Session, Request], Awaitable[Response]]


def _refused(message: str, status: int) -> Response:
    return JSONResponse({"refused": message}, status)


async def _page(house: House, session: Session, request: Request) -> Response:
    return HTMLResponse(
        house.pages.show("page.html.j2", session.language, session=session, languages=LANGUAGES)
    )


async def _part(house: House, session: Session, request: Request) -> Response:
    """One step of the page, as it stands."""
    name = request.path_params["name"]
    values = dict[str, Any]()
    if name == "understood":
        values = {"found": await house.desk.ask(worker.understand, session, session.said())}
        session.wrong = values["found"].get("wrong", [])
    elif name == "worth":
        values = {"found": await house.desk.ask(worker.worth, session, session.said())}
    elif name == "plan":
        values = {"found": await house.desk.ask(worker.forecast, session, session.asked)}
    elif name not in ("files", "fit", "sheets"):
        return _refused(session.word("nothing"), 404)
    return HTMLResponse(
        house.pages.show(f"{name}.html.j2", session.language, session=session, **values)
    )


async def _body(request: Request, most: int) -> bytes | None:
    """What was sent; None where it is too much."""
    found = bytearray()
    async for chunk in request.stream():
        found += chunk
        if len(found) > most:
            return None
    return bytes(found)


async def _json(request: Request) -> dict[str, Any] | None:
    """An object; None where what was sent is none."""
    body = await _body(request, LARGEST_WORDS)
    with suppress(ValueError, RecursionError):
        found = json.loads(body or b"{}") if body is not None else None
        return found if isinstance(found, dict) else None
    return None


def file_name(sent: str) -> str:
    """Return the name by which a file is kept: the last part of a path, of plain signs."""
    last = PureWindowsPath(PurePosixPath(sent).name).name
    plain = (
        re.sub(r"[^\w+\-.,()\[\] ]", "_", last)
        .strip(" .")
        .encode()[-120:]
        .decode(errors="ignore")
        .lstrip(" .")
    )
    return re.sub(
        r"(?i)^(?=(con|prn|aux|nul|com\d|lpt\d)(\.|$))", "_", plain
    )  # names of devices on Windows


async def _add(house: House, session: Session, request: Request) -> Response:
    """Keep a file: whole, or not at all."""
    name = file_name(request.path_params["name"])
    sent = request.path_params["name"]
    if not name or not session.folder.exists():
        return _refused(session.word("name"), 422)
    async with session.adding:
        held = session.held
        if name in held and session.names.get(name, sent) != sent:
            return _refused(session.word("same_name", name=sent, other=session.names[name]), 409)
        room = min(
            LARGEST_FILE, LARGEST_SESSION - sum(size for own, size in held.items() if own != name)
        )
        too_large = _refused(session.word("too_large", name=name, most=max(room, 0) // 2**20), 413)
        if name not in held and len(held) >= MOST_FILES:
            return _refused(session.word("too_many", most=MOST_FILES), 413)
        if int(request.headers.get("content-length", 0)) > room:
            return too_large
        part = session.folder / f"{secrets.token_hex(8)}.part"
        size = 0
        try:
            with part.open("wb") as file:
                async for chunk in request.stream():
                    size += len(chunk)
                    if size > room:
                        return too_large
                    file.write(chunk)
            part.replace(session.folder / worker.FILES / name)
            session.names[name] = sent
            session.changed()
        except (ClientDisconnect, OSError):  # or its session has ended
            return _refused(session.word("broken_off", name=name), 400)
        finally:
            part.unlink(missing_ok=True)
    return JSONResponse({"name": name})


async def _remove(house: House, session: Session, request: Request) -> Response:
    """Drop one file, or all (*)."""
    session.drop(request.path_params["name"])
    return JSONResponse({})


async def _example(house: House, session: Session, request: Request) -> Response:
    """The published experiment in place of what is there."""
    session.drop()
    for path in Path(lb.embedded_campaign()).iterdir():
        if path.suffix in (".csv", ".toml"):
            shutil.copyfile(path, session.folder / worker.FILES / path.name)
    session.choices.clear()
    session.changed()
    return JSONResponse({})


async def _say(house: House, session: Session, request: Request) -> Response:
    """Take what the form says; or the language."""
    sent = await _json(request)
    if sent is None or not all(isinstance(own, str) and len(own) < 20_000 for own in sent.values()):
        return _refused(session.word("form"), 422)
    if "language" in sent:
        if sent["language"] in LANGUAGES and sent["language"] != session.language:
            session.language = sent["language"]
            session.edition += 1  # the sheets are of the other
        return JSONResponse({})
    choices = {
        name: own.strip() for name, own in sent.items() if name in worker.FIELDS and own.strip()
    }
    session.edition += choices != session.choices
    session.choices = choices
    return JSONResponse({})


async def _fit(house: House, session: Session, request: Request) -> Response:
    if not session.running:
        session.outcome = {}
        session.task = asyncio.create_task(house.fit(session))
    return JSONResponse(session.state())


async def _cancel(house: House, session: Session, request: Request) -> Response:
    if session.running and session.task is not None:
        session.stop()
        await asyncio.wait([session.task])
        session.outcome = {"cancelled": True}
    return JSONResponse(session.state())


async def _state(house: House, session: Session, request: Request) -> Response:
    session.tabs = {*(session.tabs or ()), request.query_params.get("tab", "")} - session.closed
    return JSONResponse(session.state())


async def _leave(house: House, session: Session, request: Request) -> Response:
    """A tab was closed, or is loaded anew: then it asks again before long."""
    session.closed.add(request.query_params.get("tab", ""))
    session.tabs = (session.tabs or set()) - session.closed
    return Response(status_code=204)


async def _plan(house: House, session: Session, request: Request) -> Response:
    sent = await _json(request)
    if sent is None:
        return _refused(session.word("form"), 422)
    found = await house.desk.ask(worker.forecast, session, sent)
    if "refused" not in found:
        session.asked = sent
    return HTMLResponse(house.pages.show("forecast.html.j2", session.language, found=found))


async def _result(house: House, session: Session, request: Request) -> Response:
    """One of the files that a fit, or a plan, has left."""
    name = request.path_params["name"]
    folder = session.folder / worker.RESULT
    if name in ("plan.html", "plan.zip"):
        found = await house.desk.ask(worker.plan, session, session.asked)
        if "refused" in found:
            return _refused(found["refused"], 422)
        if name == "plan.html":
            return HTMLResponse(house.pages.show("operator.html.j2", session.language, found=found))
        return await _zipped(session.folder / "plan", name)
    if name in _FOLDERS and folder.is_dir():
        return await _zipped(folder / _FOLDERS[name], name)
    path = folder / (_LOADED.get(name) or name)
    path = folder / _UNAVERAGED if name == "parameters.csv" and not path.is_file() else path
    if name not in (*_SHOWN, *_LOADED) or not path.is_file():
        return _refused(session.word("nothing"), 404)
    policy = {"content-security-policy": _OF_REPORT} if name == "report.html" else {}
    how = "inline" if name in _SHOWN else "attachment"
    return FileResponse(
        path,
        filename=name,
        headers=policy,
        media_type=_SHOWN.get(name),
        content_disposition_type=how,
    )


async def _zipped(folder: Path, name: str) -> Response:
    def packed() -> bytes:
        drawn = io.BytesIO()
        with zipfile.ZipFile(drawn, "w", zipfile.ZIP_DEFLATED) as archive:
            for path in sorted(own for own in folder.rglob("*") if own.is_file()):
                archive.write(path, str(path.relative_to(folder)))
        return drawn.getvalue()

    headers = {"content-disposition": f'attachment; filename="{name}"'}
    return Response(await asyncio.to_thread(packed), media_type="application/zip", headers=headers)


_ROUTES: tuple[tuple[str, str, Answer], ...] = (
    ("GET", "/", _page),
    ("GET", "/part/{name}", _part),
    ("GET", "/state", _state),
    ("PUT", "/files/{name:path}", _add),
    ("DELETE", "/files/{name}", _remove),
    ("POST", "/example", _example),
    ("POST", "/say", _say),
    ("POST", "/fit", _fit),
    ("POST", "/cancel", _cancel),
    ("POST", "/leave", _leave),
    ("POST", "/plan", _plan),
    ("GET", "/result/{name}", _result),
)


# ---- who may ask


class _Guard:
    """Lets in what was sent to this server's own address, by its own page or by the one who opens
    it, with the token."""

    def __init__(self, app: ASGIApp, token: str, port: int) -> None:
        self._app = app
        self._token = token
        self._hosts = {f"{name}:{port}" for name in (LOOPBACK, "localhost")}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            return await self._app(scope, receive, send)
        if scope["type"] != "http":
            return None
        request = Request(scope)
        own = {name.encode(): value.encode() for name, value in _ALWAYS.items()}
        own[b"content-security-policy"] = _OF_PAGE.encode()

        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                there = {name.lower() for name, _ in message["headers"]}
                message["headers"] = [
                    *message["headers"],
                    *((name, value) for name, value in own.items() if name not in there),
                ]
            await send(message)

        why = self._wrong(request)
        answer = (
            self._app if why is None else Response(f"{why[1]}\n", why[0], media_type="text/plain")
        )
        await answer(scope, receive, sent)
        return None

    def _wrong(self, request: Request) -> tuple[int, str] | None:
        """Status and reason of a refusal."""
        host = request.headers.get("host", "")
        origin = request.headers.get("origin")
        if host not in self._hosts:
            return (
                421,
                (
                    "This page answers at its own address alone. Open the one that ldbb-bayes app"
                    " printed."
                ),
            )
        foreign = origin is not None and origin.partition("://")[2] not in self._hosts
        unsafe = request.method not in ("GET", "HEAD")
        if (
            foreign
            or (unsafe and origin is None)
            or request.headers.get("sec-fetch-site") in ("cross-site", "same-site")
        ):
            return 403, "Only the page itself may ask for this."
        token = str(request.scope["path"]).lstrip("/").partition("/")[0]
        if not secrets.compare_digest(token.encode(), self._token.encode()):
            return (
                403,
                "The address must hold its token. Open the one that ldbb-bayes app printed, whole.",
            )
        if (
            int(length if (length := request.headers.get("content-length", "0")).isdecimal() else 0)
            > LARGEST_FILE
        ):
            return 413, f"A file must have at most {LARGEST_FILE // 2**20} MB."
        return None


def _clear_up() -> None:
    """Delete what servers have left that were ended by force."""
    for left in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*-*"):
        owner = left.name.removeprefix(_PREFIX).partition("-")[0]
        if owner.isdecimal() and not _is_running(int(owner)):
            shutil.rmtree(left, ignore_errors=True)


def _is_running(process: int) -> bool:
    if os.name != "posix":
        return True  # asking would end it
    try:
        os.kill(process, 0)
    except OSError as error:
        return isinstance(error, PermissionError)
    return True


def application(token: str, port: int) -> ASGIApp:
    """Return the server of a token and a port of loopback: what is asked for without either is
    refused."""

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        _clear_up()
        folder = Path(tempfile.mkdtemp(prefix=f"{_PREFIX}{os.getpid()}-"))
        desk = Desk()
        app.state.house = house = House(folder, desk)
        watch = asyncio.create_task(house.look_after())
        try:
            yield
        finally:
            watch.cancel()
            for session in [*house.sessions.values()]:
                house.end(session)
            desk.stop()
            shutil.rmtree(folder, ignore_errors=True)

    async def begin(request: Request) -> Response:
        if request.method == "HEAD":  # as of a browser that looks ahead
            return Response()
        wanted = request.headers.get("accept-language", "").strip().lower()
        language = next((own for own in LANGUAGES if wanted.startswith(own)), LANGUAGES[0])
        session = request.app.state.house.begin(language)
        if session is None:
            return Response(
                f"{words_of_page(language)['errors']['full']}\n",
                503,
                media_type="text/plain; charset=utf-8",
            )
        return RedirectResponse(f"/{token}/s/{session.key}/", 303)

    def answering(answer: Answer) -> Callable[[Request], Awaitable[Response]]:
        async def inner(request: Request) -> Response:
            house: House = request.app.state.house
            session = house.sessions.get(request.path_params["key"])
            if session is None:
                page = house.pages.show("ended.html.j2", LANGUAGES[0], start=f"/{token}/")
                return HTMLResponse(page, 410)
            session.seen = time.monotonic()
            return await answer(house, session, request)

        return inner

    async def static(request: Request) -> Response:
        name = request.path_params["name"]
        kinds = {"app.js": "text/javascript", "app.css": "text/css"}
        if name not in kinds:
            return Response("There is nothing here.\n", 404, media_type="text/plain")
        return Response((_PAGES / name).read_bytes(), media_type=kinds[name])

    async def unexpected(request: Request, error: Exception) -> Response:
        return _refused(
            str(words_of_page(LANGUAGES[0])["errors"]["unexpected"]).format(
                error=type(error).__name__
            ),
            500,
        )

    inside = [Route(path, answering(answer), methods=[method]) for method, path, answer in _ROUTES]
    routes = [Route("/", begin), Route("/static/{name}", static), Mount("/s/{key}", routes=inside)]
    inner = Starlette(
        routes=[Mount(f"/{token}", routes=routes)],
        lifespan=lifespan,
        exception_handlers={Exception: unexpected},
    )
    return _Guard(inner, token, port)


@contextmanager
def _listening(port: int) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as listener:
        if os.name == "posix":
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((LOOPBACK, port))
            listener.listen(_BACKLOG)
        except OSError as error:
            got = f"got {port} ({error.strerror})"
            raise InputError(
                f"--port must be one that is free, {got}. Choose another, or leave it out."
            ) from None
        yield listener


def serve(port: int, *, show: bool, say: Callable[[str], object] = print) -> None:
    """Serve the page until interrupted; its address is said first, and opened in a browser where
    ``show`` is true."""
    with _listening(port) as listener:
        token = secrets.token_urlsafe(18)
        port = listener.getsockname()[1]
        address = f"http://{LOOPBACK}:{port}/{token}/"
        settings = uvicorn.Config(
            application(token, port),
            http="h11",
            ws="none",
            log_level="critical",
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=2,
            backlog=_BACKLOG,
        )
        server = uvicorn.Server(settings)
        if hasattr(signal, "SIGHUP"):  # the terminal was closed
            signal.signal(signal.SIGHUP, lambda *_: setattr(server, "should_exit", True))
        say(address)
        if show:
            settings.load()
            startup = server.startup

            async def started(sockets: list[socket.socket] | None = None) -> None:
                await startup(sockets)
                asyncio.get_running_loop().run_in_executor(None, partial(webbrowser.open, address))

            server.startup = started  # type: ignore[method-assign]
        with suppress(KeyboardInterrupt):
            server.run(sockets=[listener])
