"""Answers to the requests for results: reports, plans, cheapest campaigns and their files.

A session is one browser tab.
"""

from __future__ import annotations

import asyncio
import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, Response

from ldbb_bayes.app.answers import refused
from ldbb_bayes.app.cheapest import CHEAPEST
from ldbb_bayes.app.fields import RESULT
from ldbb_bayes.app.planning import PLAN, plan
from ldbb_bayes.app.session import Session
from ldbb_bayes.app.session_registry import SessionRegistry
from ldbb_bayes.report.message_translation import in_language
from ldbb_bayes.report.passage_translation import passages_in_language

__all__ = ["operator_sheet", "send_cheapest", "send_result"]

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


async def send_result(registry: SessionRegistry, session: Session, request: Request) -> Response:
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
        return HTMLResponse(operator_sheet(registry, session, planned))
    return await _send_zipped(session.folder / PLAN, name)


async def send_cheapest(registry: SessionRegistry, session: Session, request: Request) -> Response:
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
        return HTMLResponse(operator_sheet(registry, session, planned))
    folder = session.search.folder / CHEAPEST / str(number)
    return await _send_zipped(folder, f"cheapest-{number}.zip")


def operator_sheet(registry: SessionRegistry, session: Session, planned: Mapping[str, Any]) -> str:
    """Return the operator's sheet of planned circles as HTML, in the language of a session.

    ``planned`` holds what `circle_rows` returns of the circles, their time, and the texts of the
    campaign on which they are based.
    """
    return registry.templates.show(
        "operator.html.j2",
        session.language,
        planned=planned,
        mountings=passages_in_language(planned["mountings"], session.language),
        handling=passages_in_language(planned["handling"], session.language),
    )


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
