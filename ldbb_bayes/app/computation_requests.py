"""Answers to the requests that start and stop the computations of a session (one browser tab).

The computations are a fit, and a search for the cheapest campaign.
"""

from __future__ import annotations

import asyncio

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from ldbb_bayes.app.answers import read_json, refused
from ldbb_bayes.app.cheapest import wrong_entry
from ldbb_bayes.app.computation import Computation
from ldbb_bayes.app.goal_fields import goal_texts
from ldbb_bayes.app.session import Session
from ldbb_bayes.app.session_registry import SessionRegistry

__all__ = ["cancel_fit", "start_fit", "start_search", "stop_search"]


async def start_fit(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Start the fit of a session's files, if no fit is running, and return the session's state."""
    if not session.fit.running:
        session.fit.outcome = {}
        session.fit.task = asyncio.create_task(registry.fit(session))
    return JSONResponse(session.state())


async def cancel_fit(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Stop the fit of a session (browser tab), and return the session's state."""
    return await _cancel(session, session.fit)


async def start_search(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Start a search for the cheapest campaign that reaches the uncertainty goals of the user.

    The request contains the texts of the entry fields for goals and costs. If a text cannot be
    used, the response states the reason and the name of the entry field.
    """
    sent = await read_json(request)
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


async def stop_search(registry: SessionRegistry, session: Session, request: Request) -> Response:
    """Stop a session's search for the cheapest campaign, and return the session's state."""
    return await _cancel(session, session.search)


async def _cancel(session: Session, computation: Computation) -> Response:
    """Stop a computation of a session if it is running, and return the session's state."""
    if computation.running and computation.task is not None:
        computation.stop()
        await asyncio.wait([computation.task])
        computation.outcome = {"cancelled": True}
    return JSONResponse(session.state())
