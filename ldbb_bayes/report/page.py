"""The report as one page: sections composed, written as HTML, its numbers beside it as JSON and CSV."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import pandas as pd
import xarray as xr
from markupsafe import Markup
from matplotlib.figure import Figure

from ldbb_bayes.analysis.circularity import BIDIRECTIONAL, QUANTITIES
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.analysis.design.design import Design
from ldbb_bayes.analysis.differences import differences
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.posterior import bound_of, draws_of, fit_of, record_of, result_json
from ldbb_bayes.report import figures, wording
from ldbb_bayes.report.findings import Compared, Findings, Recommended, find, sizes_of
from ldbb_bayes.report.sections import SECTIONS, Beside, Picture, Section, beside
from ldbb_bayes.result import json_text
from ldbb_bayes.units import display_unit, typeset, units_for

__all__ = ["REPORT_FILES", "Document", "compose", "html_page", "tables", "write_report"]


@dataclass(frozen=True)
class Document:
    """A whole report.

    Attributes
    ----------
    title : str
    lines : tuple of str
        What it is of, under the title.
    alerts : tuple of str
        What a reader must know before any number.
    sections : tuple of Section
    further : mapping of name to callable
        Draws a figure that is not on the page.
    """

    title: str
    lines: tuple[str, ...]
    alerts: tuple[str, ...]
    sections: tuple[Section, ...]
    further: Mapping[str, Callable[[], Figure]] = field(default_factory=dict)

    @property
    def pictures(self) -> Iterator[Picture]:
        """All figures in order."""
        return (part for section in self.sections for part in section.parts if isinstance(part, Picture))


def compose(
    found: Findings,
    others: Sequence[Beside] = (),
    *,
    same_instrument: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Document:
    """Return all sections in order.

    Parameters
    ----------
    others : sequence of Beside
        Campaigns to set beside this one.
    progress : callable, optional
        Called with the sections done and their number.
    """
    report = progress or (lambda done, total: None)
    report(0, len(SECTIONS))
    made = {}
    # The comparison may still be at work elsewhere: what shows it comes last, and figures are drawn as they come.
    for k, key in enumerate(sorted(SECTIONS, key=lambda key: key in ("summary", "degree"))):
        title, write = SECTIONS[key]
        made[key] = Section(key, title, tuple(write(found)))
        for part in made[key].parts:
            if isinstance(part, Picture):
                _ = part.svg
        report(k + 1, len(SECTIONS))
    sections = [made[key] for key in SECTIONS]
    result, seen = found.result, found.seen
    name = title = str(result["campaign"]["name"])
    if others:
        parts = tuple(beside(result, others, same_instrument=same_instrument, ci_prob=found.ci_prob))
        sections.insert(1, Section("beside", "Campaigns side by side", parts))
        title = f"{name}, beside {wording.joined([other.name for other in others])}"
    forces = [test.force_N for test in seen.tests]
    started, version = result["provenance"]["started"][:10], result["provenance"]["versions"]["ldbb-bayes"]
    lines = (
        f"Machine {seen.topology}, plane {seen.plane}. {len(seen.tests)} circular tests at {min(forces):g} to {max(forces):g} N.",
        f"Fitted {started} with ldbb_bayes {version}.",
    )
    alerts = list(wording.alert_sentences(fit_of(found.posterior), result))
    for other in others:
        converged, conflict = other.result["sampler"]["converged"], other.differences.attrs.get("conflict")
        alerts += wording.difference_doubts(name, other.name, converged, conflict)
    return Document(f"Loaded double ball bar: {title}", lines, tuple(alerts), tuple(sections), _further(found))


def _further(found: Findings) -> dict[str, Callable[[], Figure]]:
    """The analyses' other figures."""
    own, compared, chosen = found.identifiability, found.comparison, found.design
    drawn: dict[str, Callable[[], Figure]] = {
        "corner": partial(figures.corner, found.posterior),
        "prior_and_posterior": partial(figures.prior_and_posterior, own),
        "nuisance_costs": partial(figures.nuisance_costs, own),
        "alias": partial(figures.alias_map, own),
        "correlation": partial(figures.correlation_map, own),
    }
    if isinstance(compared, Comparison) and compared.tests:
        drawn["predictive_p_values"] = partial(figures.predictive_p_values, compared)
    if isinstance(compared, Comparison) and not compared.local_fits.empty:
        drawn["geometry_with_local_fits"] = partial(figures.geometry_with_local_fits, compared)
    if isinstance(chosen, Design) and not chosen.sensitivity.empty:
        drawn["expected_widths"] = partial(figures.expected_widths, chosen)
        drawn["efficiency"] = partial(figures.efficiency, chosen)
    return drawn


def html_page(document: Document) -> str:
    """Return the page: no script, no request, figures as inline SVG, all text escaped, a policy against loading anything."""
    loader = jinja2.PackageLoader("ldbb_bayes.report")
    environment = jinja2.Environment(loader=loader, autoescape=True, undefined=jinja2.StrictUndefined)
    environment.filters |= {"typeset": typeset, "kind": lambda part: type(part).__name__}
    style = Markup(loader.get_source(environment, "report.css")[0])
    return environment.get_template("report.html.j2").render(document=document, style=style)


# ---- its numbers


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
        side_by_side = pd.concat({other.name: other.differences for other in others}, names=["campaign", "parameter"])
        every["differences"] = side_by_side.reset_index().set_index("campaign")
    return every


def _results(found: Findings) -> pd.DataFrame:
    """One row per parameter, with its verdict."""
    table = found.summary.copy()
    table["U_k2"] = 2.0 * table["sd"]
    verdicts = found.verdicts
    table["verdict"] = [wording.verdict_words(verdicts[name]) if name in verdicts else "" for name in table.index]
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
    with units_for(sizes_of(posterior)), _place(Path(folder)) as place:
        apart = tuple(
            Beside(
                name,
                result_json(other, ci_prob=ci_prob),
                differences(posterior, other, same_instrument=same_instrument, ci_prob=ci_prob),
            )
            for name, other in (beside_it or {}).items()
        )
        if progress is not None:
            progress(0, len(SECTIONS))
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
    return {
        "schema": 1,
        "campaign": found.result["campaign"],
        "model": found.result["model"],
        "alerts": list(document.alerts),
        "provenance": record_of(found.posterior)["provenance"],
        "tables": {name: frame.reset_index().to_dict(orient="records") for name, frame in frames.items()},
        "comparison": _in_words(found.comparison),
        "design": _in_words(found.design),
    }


def _in_words(result: Comparison | Design | str) -> dict[str, Any]:
    return {"missing": result} if isinstance(result, str) else wording.with_words(result)
