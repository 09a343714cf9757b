"""What the answers to all requests of a browser page have in common.

A session is one browser tab with its files, its typed entries and its computations.
"""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable
from typing import Any, TypeAlias

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from ldbb_bayes.app.session import Session
from ldbb_bayes.app.session_registry import SessionRegistry

__all__ = ["Answer", "read_json", "refused"]

LARGEST_FORM = 2**17  # largest total size of the entries of a form on the browser page [bytes]
# Function that answers a request from a session.
Answer: TypeAlias = Callable[[SessionRegistry, Session, Request], Awaitable[Response]]


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


async def read_json(request: Request) -> dict[str, Any] | None:
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
