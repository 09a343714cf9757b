"""A session of the browser page: one tab with its files, its typed entries and its computations."""

from __future__ import annotations

import asyncio
import re
import shutil
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from ldbb_bayes.app.computation import Computation
from ldbb_bayes.app.fields import FIELDS, FILES
from ldbb_bayes.app.page_words import words_of_page
from ldbb_bayes.campaign.folder import TOML_NAME

__all__ = ["Session"]

_JOB = "job"  # subfolder of a session (one browser tab) in which its report is made
_SEARCH = "search"  # subfolder of a session (browser tab) for the search for the cheapest campaign
# Times without a request after which a session ends [s]. ``CLOSED_S`` applies after the session's
# browser tabs were closed, and is long enough to reload the page. ``UNOPENED_S`` applies if no tab
# was ever opened. ``SILENT_S`` applies while a tab is open, and is long because tabs in the
# background may send no requests.
CLOSED_S = 8.0
UNOPENED_S = 60.0
SILENT_S = 3600.0


@dataclass(eq=False)
class Session:
    """One session: a browser tab with its files, its typed entries and its computations."""

    key: str  #: Random text that identifies the session (browser tab) in URL paths.
    folder: Path  #: Folder of the files of the session (browser tab).
    language: str  #: Language of the browser page, en or de.
    #: Texts that the user typed on the page; the keys are the names of the entry fields.
    entries: dict[str, str] = field(default_factory=dict)
    #: Names of the entry fields whose texts could not be used when the files were last read.
    wrong_entries: list[str] = field(default_factory=list)
    #: Number of changes that the user has made so far to files, entries and language.
    edition: int = 0
    #: Value that ``edition`` had when the computation of the report was started; -1 if there is no
    #: report. The page knows it as ``fitted``.
    edition_of_report: int = -1
    #: Values of the sliders and fields of the page that describe the plan of the next tests.
    plan_entries: dict[str, Any] = field(default_factory=dict)
    #: Texts that the user typed before the last search for the cheapest campaign: goals for
    #: uncertainties, and costs. The keys are the names of the entry fields.
    search_entries: dict[str, Any] = field(default_factory=dict)
    #: Time of the last request from the session (browser tab), on the monotonic clock [s].
    last_request_s: float = field(default_factory=time.monotonic)
    #: Identifiers of the browser tabs that show the session; None before the first request.
    tabs: set[str] | None = None
    #: Identifiers of the browser tabs that were closed. A late request from such a tab does not
    #: open the tab again.
    closed: set[str] = field(default_factory=set)
    #: Original names of the added files; the keys are the names under which the files are stored.
    names: dict[str, str] = field(default_factory=dict)
    #: Lock that lets only one file be added at a time, so that the limit on the total size holds.
    adding: asyncio.Lock = field(default_factory=asyncio.Lock)
    #: Computation of the fit. Its outcome holds the warnings of the report and the sentence on
    #: whether the results can be used. If the fit is refused, the outcome states the reason.
    fit: Computation = field(init=False)
    #: Search for the cheapest campaign. Its outcome holds the tables and sentences that the browser
    #: page shows. If the search is refused, the outcome states the reason.
    search: Computation = field(init=False)

    def __post_init__(self) -> None:
        """Create the computations of the browser tab: a fit, and a search for a campaign."""
        self.fit = Computation("fit", self.folder / _JOB)
        self.search = Computation("search", self.folder / _SEARCH)

    @property
    def computations(self) -> dict[str, Computation]:
        """Computations of the session (browser tab); the keys are their kinds: fit and search."""
        return {self.fit.kind: self.fit, self.search.kind: self.search}

    @property
    def is_over(self) -> bool:
        """Whether the session has ended.

        A session ends after a time without a request. This time is eight seconds if all its browser
        tabs have been closed, an hour if a tab is open, and a minute if no tab was ever opened.
        """
        limit_s = CLOSED_S
        if self.tabs is None:
            limit_s = UNOPENED_S
        elif self.tabs:
            limit_s = SILENT_S
        return time.monotonic() - self.last_request_s > limit_s

    @property
    def file_sizes(self) -> dict[str, int]:
        """Sizes of the added files [bytes] in the order of import; the keys are the file names."""
        paths = sorted((self.folder / FILES).iterdir(), key=_import_order)
        return {path.name: path.stat().st_size for path in paths}

    @property
    def certificates(self) -> list[str]:
        """Names of the added files with the ending .xml, which may be calibration certificates."""
        return [name for name in self.file_sizes if name.lower().endswith(".xml")]

    def delete_files(self, name: str = "*") -> None:
        """Delete one file that the user added, or all added files if the name is ``*``."""
        for stored_name in self.file_sizes:
            if name in (stored_name, "*"):
                (self.folder / FILES / stored_name).unlink(missing_ok=True)
        self.update_after_file_change()

    def update_after_file_change(self) -> None:
        """Remove typed entries that no longer apply, and count one more change of the files.

        The names of deleted certificates no longer apply. If the files include a ``campaign.toml``,
        this file describes the campaign and its tables; typed entries on the campaign and the
        tables then no longer apply.
        """
        file_sizes = self.file_sizes
        has_campaign_file = TOML_NAME in file_sizes
        entries = {}
        for name, text in self.entries.items():
            entry = FIELDS[name]
            is_deleted_file = entry.kind == "file" and text not in file_sizes
            is_in_campaign_file = has_campaign_file and entry.group in ("name", "table", "layout")
            if not (is_deleted_file or is_in_campaign_file):
                entries[name] = text
        self.entries = entries
        self.edition += 1

    def state(self) -> dict[str, Any]:
        """Return a dictionary that describes the session (browser tab).

        The page requests the dictionary repeatedly. The dictionary states the number of files,
        whether a fit is running, and the progress and the outcome of the fit. ``searching`` states
        whether a search for the cheapest campaign is running, and ``search_progress`` how far it
        is. ``edition`` is the number of changes that the user has made so far, and ``fitted`` the
        number of changes when the report was made.
        """
        return {
            "files": len(self.file_sizes),
            "edition": self.edition,
            "fitted": self.edition_of_report,
            "running": self.fit.running,
            "progress": self.fit.progress,
            "outcome": self.fit.outcome,
            "searching": self.search.running,
            "search_progress": self.search.progress,
        }

    def word(self, key: str, **values: object) -> str:
        """Return the text of an error message in the language of the browser page.

        ``key`` is the name under which the text is stored. ``values`` are inserted into the text.
        """
        return str(words_of_page(self.language)["errors"][key]).format(**values)

    def refusal(self, key: str, **values: object) -> dict[str, Any]:
        """Return a dictionary with an error message in the language of the browser page.

        ``key`` is the name under which the text of the message is stored. ``values`` are inserted
        into the text. The second entry of the dictionary tells the page that the text needs no
        translation.
        """
        return {"refused": self.word(key, **values), "is_in_words_of_page": True}

    def typed_texts(self) -> dict[str, str]:
        """Return the texts that the user typed, and the language of the report.

        The keys of the result are the names of the entry fields.
        """
        return {**self.entries, "language": self.language}

    def stop(self) -> None:
        """Stop the computations of the session (browser tab), and end all their processes."""
        for computation in self.computations.values():
            computation.stop()

    def forget_search(self) -> None:
        """Stop the search for the cheapest campaign, and delete what an earlier search found."""
        self.search.stop()
        self.search.outcome = {}
        shutil.rmtree(self.search.folder, ignore_errors=True)


class _ImportOrder(NamedTuple):
    """Sort key for files: they are sorted first by suffix, then by name.

    Numbers in names are sorted by their values, so that "2 N" comes before "10 N". Files without a
    suffix come last.
    """

    has_no_suffix: bool
    suffix: str
    #: Name of the file in lower case, split into its whole numbers and the pieces of text between
    #: them.
    pieces: list[Any]


def _import_order(path: Path) -> _ImportOrder:
    """Return the key by which a file is sorted into the order of import."""
    pieces: list[Any] = re.split(r"([0-9]+)", path.name.casefold())
    for k, piece in enumerate(pieces):
        if piece.isdigit():
            pieces[k] = int(piece)
    return _ImportOrder(not path.suffix, path.suffix, pieces)
