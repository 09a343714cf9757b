"""Requests of a browser page that has a session, and the answers that show the page.

A session is one browser tab with its files, its typed entries and its computations.
"""

from __future__ import annotations

from typing import Any

from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response

from ldbb_bayes.app.answers import Answer, read_json, refused
from ldbb_bayes.app.cheapest import passages_shown
from ldbb_bayes.app.computation_requests import cancel_fit, start_fit, start_search, stop_search
from ldbb_bayes.app.fields import FIELDS
from ldbb_bayes.app.file_requests import add_file, remove_file, take_example
from ldbb_bayes.app.page_words import LANGUAGES
from ldbb_bayes.app.planning import forecast
from ldbb_bayes.app.result_requests import send_cheapest, send_result
from ldbb_bayes.app.session import Session
from ldbb_bayes.app.session_registry import SessionRegistry
from ldbb_bayes.app.understanding import understand
from ldbb_bayes.app.worth import effects_of_certificates

__all__ = ["ROUTES"]

# largest length of one entry that a user types on the browser page [characters]
_LONGEST_ENTRY = 20_000


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
        values["understood"] = understood
        values["names"] = understood.get("names", ())
    elif name == "worth":
        values["worth"] = await registry.answering_process.ask(
            effects_of_certificates, session, session.typed_texts()
        )
    elif name == "plan":
        values["forecast"] = await registry.answering_process.ask(
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


async def _show_forecast(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Return a section of the page with the results that are expected from the next tests.

    The request contains the values of the page's sliders, which describe these tests.
    """
    sent = await read_json(request)
    if sent is None:
        return refused(session.word("form"), 422)
    expected = await registry.answering_process.ask(forecast, session, sent)
    if "refused" not in expected:
        session.plan_entries = sent
    section = registry.templates.show("forecast.html.j2", session.language, forecast=expected)
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


async def _take_entries(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Store the texts that the user typed on the page, or the language that the user chose.

    The request contains the texts as a JSON object, whose keys are the names of the entry fields.
    """
    sent = await read_json(request)
    if sent is None or not all(_is_entry(text) for text in sent.values()):
        return refused(session.word("form"), 422)
    if "language" in sent:
        if sent["language"] in LANGUAGES and sent["language"] != session.language:
            session.language = sent["language"]
            # The user has changed the language. The new value of ``edition``, the number of the
            # user's changes, tells the browser page that the report must be written again.
            session.edition += 1
        return JSONResponse({})
    entries = {}
    for name, text in sent.items():
        if name in FIELDS and text.strip():
            entries[name] = text.strip()
    if entries != session.entries:
        session.edition += 1
    session.entries = entries
    return JSONResponse({})


def _is_entry(text: object) -> bool:
    """Return whether a value is a text short enough for an entry field of the browser page."""
    return isinstance(text, str) and len(text) < _LONGEST_ENTRY


#: HTTP method and URL path of every request from a session (one browser tab), and the function that
#: answers the request.
ROUTES: tuple[tuple[str, str, Answer], ...] = (
    ("GET", "/", _show_page),
    ("GET", "/section/{name}", _show_section),
    ("GET", "/state", _state),
    ("PUT", "/files/{name:path}", add_file),
    ("DELETE", "/files/{name}", remove_file),
    ("POST", "/example", take_example),
    ("POST", "/entries", _take_entries),
    ("POST", "/fit", start_fit),
    ("POST", "/cancel", cancel_fit),
    ("POST", "/leave", _leave),
    ("POST", "/plan", _show_forecast),
    ("POST", "/search", start_search),
    ("POST", "/stop", stop_search),
    ("GET", "/result/cheapest-{number:int}.{kind}", send_cheapest),
    ("GET", "/result/{name}", send_result),
)
