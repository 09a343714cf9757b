"""The server of ``ldbb-bayes app``: a page for this computer only, with a session for each tab.

The server listens on the loopback address only. Every URL path begins with a secret token, and the
headers Host and Origin must name this server. A session consists of a folder of files and the
entries on its page. When the browser tab is closed, the session ends: the files are deleted and the
processes of the session are stopped.
"""

from __future__ import annotations

import asyncio
import os
import secrets
import shutil
import signal
import socket
import tempfile
import time
import webbrowser
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path
from types import FrameType

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import Mount, Route
from starlette.types import ASGIApp

from ldbb_bayes.app.answering_process import AnsweringProcess
from ldbb_bayes.app.answers import Answer, refused
from ldbb_bayes.app.guard import LOOPBACK, Guard
from ldbb_bayes.app.page_words import LANGUAGES, PAGES, words_of_page
from ldbb_bayes.app.requests import ROUTES
from ldbb_bayes.app.session_registry import SessionRegistry
from ldbb_bayes.errors import InputError

__all__ = ["application", "listening", "serve"]

_BACKLOG = 512  # largest number of connections that wait for the server
_GRACE_S = 2  # time in which the server may finish its answers before it ends [s]
_FOLDER_PREFIX = "ldbb-bayes-"
_STATIC_FILES = {"app.js": "text/javascript", "app.css": "text/css"}


# ---- answers to requests outside a session


async def _begin_session(request: Request) -> Response:
    """Begin a session for a new browser tab, and redirect the browser to the session's page.

    If there are already too many sessions, the response states this.
    """
    # A browser sends a HEAD request only to ask whether the page exists: begin no session.
    if request.method == "HEAD":
        return Response()
    language = _language_of(request)
    session = request.app.state.registry.begin(language)
    if session is None:
        message = words_of_page(language)["errors"]["full"]
        return Response(f"{message}\n", 503, media_type="text/plain; charset=utf-8")
    return RedirectResponse(f"{request.url.path}s/{session.key}/", 303)


def _language_of(request: Request) -> str:
    """Return the language that the browser prefers, or English if the page has no texts for it."""
    preferred = request.headers.get("accept-language", "").strip().lower()
    for language in LANGUAGES:
        if preferred.startswith(language):
            return language
    return LANGUAGES[0]


async def _send_static(request: Request) -> Response:
    """Return the JavaScript or the style sheet of the browser page."""
    name = request.path_params["name"]
    if name not in _STATIC_FILES:
        return Response("There is nothing here.\n", 404, media_type="text/plain")
    return Response((PAGES / name).read_bytes(), media_type=_STATIC_FILES[name])


async def _say_unexpected(request: Request, error: Exception) -> Response:
    """Return the response to a request that caused an unexpected error, with HTTP status 500.

    The response contains a message in English, whatever the language of the page. The message
    states only the class of the error, such as KeyError.
    """
    message = str(words_of_page(LANGUAGES[0])["errors"]["unexpected"])
    return refused(message.format(error=type(error).__name__), 500)


# ---- the ASGI application


def application(token: str, port: int) -> ASGIApp:
    """Return the application that answers all requests to the server of the browser page.

    Parameters
    ----------
    token
        Secret first element of every URL path; requests without it are refused.
    port
        Port of the server on the loopback address.

    Returns
    -------
    ASGI application
        Application for a server that uses ASGI, Python's interface for web applications.
    """

    def endpoint(answer: Answer) -> Callable[[Request], Awaitable[Response]]:
        """Return a function that answers a request from a session (one browser tab).

        The function finds the session that the request's URL names, and passes the session and the
        request to ``answer``, which computes the answer.
        """

        async def answer_in_session(request: Request) -> Response:
            """Return the answer to a request, or a page which says that the session has ended."""
            registry: SessionRegistry = request.app.state.registry
            session = registry.sessions.get(request.path_params["key"])
            if session is None:
                page = registry.templates.show("ended.html.j2", LANGUAGES[0], start=f"/{token}/")
                return HTMLResponse(page, 410)
            session.last_request_s = time.monotonic()
            return await answer(registry, session, request)

        return answer_in_session

    session_routes = []
    for method, path, answer in ROUTES:
        session_routes.append(Route(path, endpoint(answer), methods=[method]))
    routes = [
        Route("/", _begin_session),
        Route("/static/{name}", _send_static),
        Mount("/s/{key}", routes=session_routes),
    ]
    starlette = Starlette(
        routes=[Mount(f"/{token}", routes=routes)],
        lifespan=_lifespan,
        exception_handlers={Exception: _say_unexpected},
    )
    return Guard(starlette, token, port)


@asynccontextmanager
async def _lifespan(app: Starlette) -> AsyncIterator[None]:
    """Create the registry of all sessions (browser tabs), and keep it while the server runs.

    When the server ends, the processes of the sessions are stopped, and the sessions' files are
    deleted.
    """
    _delete_folders_of_dead_servers()
    folder = Path(tempfile.mkdtemp(prefix=f"{_FOLDER_PREFIX}{os.getpid()}-"))
    registry = SessionRegistry(folder, AnsweringProcess())
    app.state.registry = registry
    watch = asyncio.create_task(registry.look_after())
    try:
        yield
    finally:
        watch.cancel()
        for session in list(registry.sessions.values()):
            registry.end(session)
        registry.answering_process.stop()
        shutil.rmtree(folder, ignore_errors=True)


def _delete_folders_of_dead_servers() -> None:
    """Delete the temporary folders of servers whose processes ended without deleting them.

    On Windows, nothing is deleted, because `_is_running` takes every process to be running.
    """
    for folder in Path(tempfile.gettempdir()).glob(f"{_FOLDER_PREFIX}*-*"):
        process = folder.name.removeprefix(_FOLDER_PREFIX).partition("-")[0]
        if process.isdecimal() and not _is_running(int(process)):
            shutil.rmtree(folder, ignore_errors=True)


def _is_running(process: int) -> bool:
    """Return whether a process is running; on Windows, the result is always true.

    ``process`` is the id of the process. On Windows, the function has no safe way to find out
    whether the process runs.
    """
    if os.name != "posix":
        # On Windows, ``os.kill(process, 0)`` would end the process instead of asking whether it
        # runs. The process is therefore assumed to be running.
        return True
    try:
        os.kill(process, 0)
    except OSError as error:
        return isinstance(error, PermissionError)
    return True


# ---- listening and serving


@contextmanager
def listening(port: int) -> Iterator[socket.socket]:
    """Listen on a port of the loopback address, which only this computer can reach.

    Parameters
    ----------
    port
        Port number; 0 for any free port.

    Yields
    ------
    socket
        Socket on which a server can accept connections; it is closed after the ``with`` block.

    Raises
    ------
    InputError
        If the port is in use or not permitted.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as listener:
        if os.name == "posix":
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((LOOPBACK, port))
            listener.listen(_BACKLOG)
        except OSError as error:
            raise InputError(
                f"--port must be one that is free, got {port} ({error.strerror}). Choose another,"
                " or leave it out."
            ) from None
        yield listener


def serve(port: int, *, show: bool, say: Callable[[str], object] = print) -> None:
    """Serve the browser page until the user ends the program with Ctrl-C.

    Parameters
    ----------
    port
        Port number; 0 for any free port.
    show
        Whether to open the page in a browser.
    say
        Function that is called with the address of the page.

    Raises
    ------
    InputError
        If the port is in use or not permitted.
    """
    with listening(port) as listener:
        token = secrets.token_urlsafe(18)
        port = listener.getsockname()[1]
        address = f"http://{LOOPBACK}:{port}/{token}/"
        server = uvicorn.Server(
            uvicorn.Config(
                application(token, port),
                http="h11",
                ws="none",
                log_level="critical",
                access_log=False,
                server_header=False,
                timeout_graceful_shutdown=_GRACE_S,
                backlog=_BACKLOG,
            )
        )

        def end(signal_number: int, frame: FrameType | None) -> None:
            """End the server because its process has received a signal.

            Python calls a signal handler with the number of the signal and the interrupted frame.
            """
            server.should_exit = True

        if hasattr(signal, "SIGHUP"):  # the signal SIGHUP means that the terminal was closed
            signal.signal(signal.SIGHUP, end)
        say(address)
        with suppress(KeyboardInterrupt):
            asyncio.run(_serve_and_show(server, listener, address if show else None))


async def _serve_and_show(
    server: uvicorn.Server, listener: socket.socket, address: str | None
) -> None:
    """Run the server, and open the page in a browser once the server answers.

    ``listener`` is the socket on which the server listens. ``address`` is the URL of the page; if
    it is None, no browser is opened.
    """
    serving = asyncio.create_task(server.serve(sockets=[listener]))
    if address is not None:
        while not (server.started or serving.done()):
            await asyncio.sleep(0.05)
        if server.started:
            asyncio.get_running_loop().run_in_executor(None, webbrowser.open, address)
    await serving
