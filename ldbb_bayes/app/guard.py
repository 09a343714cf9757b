"""Access control: the server answers only requests from its own page, with the secret token."""

from __future__ import annotations

import secrets
from typing import NamedTuple

from starlette.requests import Request
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ldbb_bayes.app.templates import LARGEST_FILE

__all__ = ["LOOPBACK", "Guard"]

LOOPBACK = "127.0.0.1"
_PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src"
    " 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
# Largest number of digits of the HTTP header Content-Length, which states a length in bytes.
_MOST_DIGITS = 20
_HEADERS = {
    b"x-content-type-options": b"nosniff",
    b"referrer-policy": b"same-origin",
    b"cache-control": b"no-store",
    b"cross-origin-opener-policy": b"same-origin",
    b"cross-origin-resource-policy": b"same-origin",
    b"content-security-policy": _PAGE_POLICY.encode(),
}


class _Refusal(NamedTuple):
    """HTTP status code and text of the response to a request that is refused."""

    status: int
    reason: str


class Guard:
    """ASGI application that refuses requests that the server's own page did not send.

    ASGI is Python's interface between web servers and applications. A request must be sent to the
    server's own address, and its URL must contain the token.

    Parameters
    ----------
    app
        ASGI application that answers the accepted requests.
    token
        Secret first element of every URL path.
    port
        Port of the server.
    """

    def __init__(self, app: ASGIApp, token: str, port: int) -> None:
        """Guard the application ``app`` of the server on the given port of this computer.

        A request is answered only if its URL path begins with the secret ``token``.
        """
        self._app = app
        self._token = token
        self._hosts = {f"{name}:{port}" for name in (LOOPBACK, "localhost")}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer an HTTP request, or refuse a request that did not come from the server's page.

        The arguments, as defined by ASGI, are the description of the request, a function that
        receives its body and a function that sends the response.
        """
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            return

        async def send_with_headers(message: Message) -> None:
            """Send a part of the response; missing security headers are added first."""
            if message["type"] == "http.response.start":
                names = {name.lower() for name, _ in message["headers"]}
                for name, value in _HEADERS.items():
                    if name not in names:
                        message["headers"] = [*message["headers"], (name, value)]
            await send(message)

        refusal = self._refusal(Request(scope))
        if refusal is None:
            await self._app(scope, receive, send_with_headers)
            return
        response = Response(f"{refusal.reason}\n", refusal.status, media_type="text/plain")
        await response(scope, receive, send_with_headers)

    def _refusal(self, request: Request) -> _Refusal | None:
        """Return the reason why an HTTP request is refused; None if the request is accepted."""
        if request.headers.get("host", "") not in self._hosts:
            return _Refusal(
                421,
                "This page answers at its own address alone. Open the one that ldbb-bayes app"
                " printed.",
            )
        if not self._is_from_page(request):
            return _Refusal(403, "Only the page itself may ask for this.")
        token = str(request.scope["path"]).lstrip("/").partition("/")[0]
        if not secrets.compare_digest(token.encode(), self._token.encode()):
            return _Refusal(
                403,
                "The address must hold its token. Open the one that ldbb-bayes app printed, whole.",
            )
        length = request.headers.get("content-length", "0")
        if not length.isdecimal() or len(length) > _MOST_DIGITS:
            return _Refusal(400, "The length of what is sent must be a number.")
        if int(length) > LARGEST_FILE:
            return _Refusal(413, f"A file must have at most {LARGEST_FILE // 2**20} MB.")
        return None

    def _is_from_page(self, request: Request) -> bool:
        """Return whether a request may come from the server's own page.

        A request without the HTTP header Origin is accepted only if its method changes nothing (GET
        or HEAD).
        """
        if request.headers.get("sec-fetch-site") in ("cross-site", "same-site"):
            return False
        origin = request.headers.get("origin")
        if origin is None:
            return request.method in ("GET", "HEAD")
        return origin.partition("://")[2] in self._hosts
