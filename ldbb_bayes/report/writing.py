"""write_report(): find, compose, write."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from ldbb_bayes.analysis.compared import Comparison
from ldbb_bayes.analysis.designed import Design
from ldbb_bayes.analysis.differences import differences
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.origin import record_of
from ldbb_bayes.inference.summary import result_json
from ldbb_bayes.report.compose import compose
from ldbb_bayes.report.document import Document
from ldbb_bayes.report.findings import Compared, Findings, Recommended, find
from ldbb_bayes.report.page import html_page, markdown_page
from ldbb_bayes.report.plain import json_text
from ldbb_bayes.report.result import sizes_of
from ldbb_bayes.report.sections.beside import Beside
from ldbb_bayes.report.sections.summary import alerts
from ldbb_bayes.report.tables import tables
from ldbb_bayes.units import units_for

__all__ = ["REPORT_FILES", "write_report"]

_ONLY_SOMETIMES = {"tables/differences.csv", "tables/measured_pairs.csv"}
REPORT_FILES = ("report.html", "report.md", "report.json", "tables")


def write_report(
    posterior: xr.DataTree,
    folder: str | os.PathLike[str],
    *,
    beside_it: Mapping[str, xr.DataTree] | None = None,
    same_instrument: bool = False,
    ci_prob: float = 0.95,
    tests: int | None = None,
    comparison: Compared | Future[Compared] | None = None,
    recommended: Recommended | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Document:
    """Write report.html, report.md, report.json and tables (CSV) into a folder.

    Parameters
    ----------
    posterior : DataTree
        From `sample` or `load`.
    folder : path
        Made where it is missing; other files in it stay.
    beside_it : mapping of name to DataTree, optional
        Other campaigns to set beside this one.
    same_instrument : bool
        Whether these were run with the same bar, balls, mount and force device.
    ci_prob : float
        Probability of the credible intervals.
    tests : int, optional
        Circles to recommend; default: as many as the campaign has.
    comparison : Comparison, or a future of one, optional
        From `compare` on the same readings; default: the evidence of constant and linear compliance is worked out.
    recommended : Design, or RecordedDesign, optional
        From `design` or `read_design` after the same readings; default: as many circles as ``tests``, of the forces tested.
    progress : callable, optional
        Called with the sections done and their number.

    Returns
    -------
    Document
        What was written; its pictures hold the figures.

    Raises
    ------
    InputError
        For a comparison of other readings, results of other machines, or a folder that cannot be written.
    """
    others = beside_it or {}
    with units_for(sizes_of(posterior)), _place(Path(folder)) as place:
        apart = tuple(
            Beside(
                name,
                result_json(other, ci_prob=ci_prob),
                differences(posterior, other, same_instrument=same_instrument, ci_prob=ci_prob),
            )
            for name, other in others.items()
        )
        found = find(posterior, ci_prob=ci_prob, tests=tests, comparison=comparison, recommended=recommended)
        document = compose(found, apart, same_instrument=same_instrument, progress=progress)
        frames = tables(found, apart)
        place |= {f"tables/{name}.csv": frame.to_csv() for name, frame in frames.items()}
        place["report.json"] = json_text(_record(found, frames))
        place["report.md"] = markdown_page(document)
        place["report.html"] = html_page(document)
    return document


@contextmanager
def _place(folder: Path) -> Iterator[dict[str, str]]:
    """Texts by path, to be filled in. Every file is written whole beside its place and then moved there, the page last."""
    made = not folder.exists()
    try:
        (folder / "tables").mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".report-", dir=folder) as name:
            texts: dict[str, str] = {}
            yield texts
            staging = Path(name)
            (staging / "tables").mkdir()
            for path, text in texts.items():
                (staging / path).write_text(text, encoding="utf-8")
            for path in texts:
                os.replace(staging / path, folder / path)
            for stale in _ONLY_SOMETIMES - set(texts):
                (folder / stale).unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{folder} must be writable, got: {error.strerror or error}. Choose another place (--out).") from None
    finally:
        for empty in (folder / "tables", *([folder] if made else [])):
            if empty.is_dir() and not any(empty.iterdir()):
                empty.rmdir()


def _record(found: Findings, frames: Mapping[str, pd.DataFrame]) -> dict[str, Any]:
    """One JSON of all tables, with what they are of."""
    compared = found.comparison
    return {
        "schema": 1,
        "campaign": found.result["campaign"],
        "model": found.result["model"],
        "alerts": list(alerts(found)),
        "provenance": record_of(found.posterior)["provenance"],
        "tables": {name: frame.reset_index().to_dict(orient="records") for name, frame in frames.items()},
        "comparison": compared.as_dict() if isinstance(compared, Comparison) else {"missing": compared},
        "design": _design(found.design),
    }


def _design(chosen: Recommended) -> dict[str, Any]:
    if isinstance(chosen, Design):
        return chosen.as_dict()
    return {"missing": chosen} if isinstance(chosen, str) else asdict(chosen)
