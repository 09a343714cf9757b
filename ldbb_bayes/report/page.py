"""A report's numbers as tables for files."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import pandas as pd
import xarray as xr
from markupsafe import Markup

from ldbb_bayes.analysis.circularity import BIDIRECTIONAL, QUANTITIES
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.analysis.differences import differences
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.posterior import bound_of, draws_of, record_of, result_json
from ldbb_bayes.report.findings import Compared, Findings, Recommended, find, sizes_of
from ldbb_bayes.report.sections import Beside, Document, compose
from ldbb_bayes.report.wording import verdict_words, with_words
from ldbb_bayes.table import json_text
from ldbb_bayes.units import display_unit, typeset, units_for

__all__ = ["REPORT_FILES", "html_page", "tables", "write_report"]


def tables(found: Findings, others: Sequence[Beside] = ()) -> dict[str, pd.DataFrame]:
    """Return everything in numbers for files: inside units (mm, N, rad), µm and µm/m for circular-test quantities."""
    bound = bound_of(found.posterior)
    beta, phi = draws_of(found.posterior, bound)
    names = [*bound.names, *map(str, bound.hyper_prior.names)]
    draws = np.concatenate([beta, phi], axis=1)
    measured, pairs = found.measured
    every = {
        "results": _results(found).rename_axis("parameter"),
        "covariance": pd.DataFrame(np.cov(draws.T), names, names).rename_axis("parameter"),
        "correlation": pd.DataFrame(np.corrcoef(draws.T), names, names).rename_axis("parameter"),
        "budget": _budget_lines(found).set_index("parameter"),
        "circularity": found.path.set_index("plane"),
        "measured_circularity": _with_units(measured).rename_axis("test"),
        "contributions": _with_units(found.contributions).set_index("plane"),
    }
    if len(pairs):
        every["measured_pairs"] = _with_units(pairs).rename_axis("tests")
    if others:
        joined = pd.concat({other.name: other.differences for other in others}, names=["campaign", "parameter"])
        every["differences"] = joined.reset_index().set_index("campaign")
    return every


def _results(found: Findings) -> pd.DataFrame:
    """One row per parameter, with its verdict."""
    table = found.summary.copy()
    table["U_k2"] = 2.0 * table["sd"]
    table["verdict"] = [verdict_words(found.verdicts[name]) if name in found.verdicts else "" for name in table.index]
    factors, labels = zip(*map(display_unit, table["unit"]), strict=True)
    return table.assign(reading_unit=labels, reading_factor=factors)


def _budget_lines(found: Findings) -> pd.DataFrame:
    """Every line of every budget."""
    names = {"kind": "type", "unit": "u_unit"}
    rows = [
        {"parameter": name, "unit": budget.unit, **{names.get(key, key): value for key, value in asdict(line).items()}}
        for name, budget in found.budgets.items()
        for line in budget.contributions
    ]
    return pd.DataFrame(rows)


def _with_units(frame: pd.DataFrame) -> pd.DataFrame:
    """Columns that stand for a quantity carry its unit in their names."""
    units = {"µm": "_um", "µm/m": "_um_per_m"}
    named = {name: f"{name}{units[unit]}" for name, unit in (QUANTITIES | BIDIRECTIONAL).items()}
    sizes = ("maximum", "minimum", "peak_to_peak", "median", "sd", "ci_low", "ci_high")
    return frame.rename(columns=named | {name: f"{name}_um" for name in sizes})


def html_page(document: Document) -> str:
    """Return the page: no script, no request, figures as inline SVG, all text escaped, a policy against loading anything."""
    loader = jinja2.PackageLoader("ldbb_bayes.report")
    environment = jinja2.Environment(loader=loader, autoescape=True, undefined=jinja2.StrictUndefined)
    environment.filters |= {"typeset": typeset, "kind": lambda part: type(part).__name__}
    style = Markup(loader.get_source(environment, "report.css")[0])
    return environment.get_template("report.html.j2").render(document=document, style=style)


_ONLY_SOMETIMES = {"tables/differences.csv", "tables/measured_pairs.csv"}
REPORT_FILES = ("report.html", "report.json", "tables")


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
    """Write report.html, report.json and tables (CSV) into a folder.

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
    recommended : Design, optional
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
        place["report.json"] = json_text(_record(found, document, frames))
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


def _record(found: Findings, document: Document, frames: Mapping[str, pd.DataFrame]) -> dict[str, Any]:
    """One JSON of all tables, with what they are of."""
    compared = found.comparison
    return {
        "schema": 1,
        "campaign": found.result["campaign"],
        "model": found.result["model"],
        "alerts": list(document.alerts),
        "provenance": record_of(found.posterior)["provenance"],
        "tables": {name: frame.reset_index().to_dict(orient="records") for name, frame in frames.items()},
        "comparison": with_words(compared) if isinstance(compared, Comparison) else {"missing": compared},
        "design": _design(found.design),
    }


def _design(chosen: Recommended) -> dict[str, Any]:
    return {"missing": chosen} if isinstance(chosen, str) else with_words(chosen)
