"""The report as one page: sections composed, written as HTML, its numbers beside it as JSON and
CSV."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import pandas as pd
import xarray as xr
from markupsafe import Markup

import ldbb_bayes as lb
from ldbb_bayes.analysis.circularity import contributions, measured_circularity
from ldbb_bayes.analysis.conformity import check_force
from ldbb_bayes.analysis.differences import differences
from ldbb_bayes.files import check_target, staged_folder, write_whole
from ldbb_bayes.inference.posterior import bound_of, campaign_of, draws_of, fit_of, record_of
from ldbb_bayes.inference.summary import result_json
from ldbb_bayes.report import wording
from ldbb_bayes.report.sections import (
    SECTIONS,
    Beside,
    Compared,
    Findings,
    Picture,
    Recommended,
    Section,
    beside,
    find,
)
from ldbb_bayes.report.sheets import Banner, Pair, ReportSheet, pdf_of, sheets, words_of
from ldbb_bayes.report.text import fit_in_words
from ldbb_bayes.results import Array, Shown, json_text
from ldbb_bayes.units import display_name, display_unit, is_skewed, typeset

__all__ = [
    "REPORT_FILES",
    "Document",
    "check_folder",
    "compose",
    "dsi_unit",
    "html_page",
    "tables",
    "write_dcc",
    "write_report",
]


@dataclass(frozen=True)
class Document(Shown):
    """A whole report; its lines say under the title what it is of, its alerts what a reader must
    know before any number."""

    title: str
    lines: tuple[str, ...]
    alerts: tuple[str, ...]
    sections: tuple[Section, ...]
    sheets: tuple[ReportSheet, ...] = ()
    annex: bool = False  # whether the sections are printed too
    language: str = "en"  # of the sheets
    shown = ("title", "lines", "alerts")

    @property
    def state(self) -> str:
        """Whether the numbers can be used, in one sentence."""
        return next(
            block.sentence
            for sheet in self.sheets
            for block in sheet.blocks
            if isinstance(block, Banner)
        )

    @property
    def pictures(self) -> Iterator[Picture]:
        """All figures in order."""
        for block in (block for sheet in self.sheets for block in sheet.blocks):
            if isinstance(block, Pair | Picture):
                yield block.picture if isinstance(block, Pair) else block
        yield from (
            part for section in self.sections for part in section.parts if isinstance(part, Picture)
        )


def compose(
    found: Findings,
    others: Sequence[Beside] = (),
    *,
    same_instrument: bool = False,
    language: str = "en",
    annex: bool = False,
    force_N: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Document:
    """Return sheets and sections in order, with campaigns to set beside this one; as
    `write_report`."""
    report = progress or (lambda done, total: None)
    report(0, len(SECTIONS) + 1)
    made = sheets(found, language=language, force_N=force_N)
    sections = []
    for k, (key, (title, write)) in enumerate(SECTIONS.items()):
        report(k + 1, len(SECTIONS) + 1)
        sections.append(Section(key, title, tuple(write(found))))
    report(len(SECTIONS) + 1, len(SECTIONS) + 1)
    result = found.result
    seen = found.seen
    name = title = str(result["campaign"]["name"])
    if others:
        parts = tuple(
            beside(result, others, same_instrument=same_instrument, ci_prob=found.ci_prob)
        )
        sections.insert(0, Section("beside", "Campaigns side by side", parts))
        title = f"{name}, beside {wording.joined([other.name for other in others])}"
    forces = [test.force_N for test in seen.tests]
    started = result["provenance"]["started"][:10]
    version = result["provenance"]["versions"]["ldbb-bayes"]
    lines = (
        (
            f"Machine {seen.topology}, plane {seen.plane}. {len(seen.tests)} circular tests at"
            f" {min(forces):g} to {max(forces):g} N."
        ),
        f"Fitted {started} with ldbb_bayes {version}.",
        wording.annex_words(result["model"]["degree"], bool(found.probabilities)),
    )
    alerts = list(wording.alert_sentences(fit_of(found.posterior), result))
    for other in others:
        converged = other.result["sampler"]["converged"]
        conflict = other.differences.attrs.get("conflict")
        alerts += wording.difference_doubts(name, other.name, converged, conflict)
    return Document(
        f"Loaded double ball bar: {title}",
        lines,
        tuple(alerts),
        tuple(sections),
        made,
        annex,
        language,
    )


def _template(name: str) -> jinja2.Template:
    """All text in it escaped, no name undefined."""
    loader = jinja2.PackageLoader("ldbb_bayes.report")
    environment = jinja2.Environment(
        loader=loader, autoescape=True, undefined=jinja2.StrictUndefined
    )
    filters = {
        "typeset": typeset,
        "kind": lambda part: type(part).__name__,
        "number": lambda value: repr(float(value)),
    }
    environment.filters |= filters
    return environment.get_template(name)


def html_page(document: Document) -> str:
    """Return the page: no script, no request, figures as inline SVG, all text escaped, a policy
    against loading anything."""
    style = Markup(_template("report.css").render())
    return _template("report.html.j2").render(document=document, style=style)


# ---- its numbers


def tables(found: Findings, others: Sequence[Beside] = ()) -> dict[str, pd.DataFrame]:
    """Return everything in numbers for files: inside units (mm, N, rad), µm and µm/m for
    circular-test quantities."""
    bound, (measured, pairs), summary = (
        bound_of(found.posterior),
        measured_circularity(found.posterior),
        found.summary,
    )
    verdicts = [
        wording.verdict_words(found.verdicts[name]) if name in found.verdicts else ""
        for name in summary.index
    ]
    heads = {"kind": "type", "unit": "u_unit"}
    lines = [
        {
            "parameter": name,
            "unit": budget.unit,
            **{heads.get(key, key): value for key, value in asdict(line).items()},
        }
        for name, budget in found.budgets.items()
        for line in budget.contributions
    ]
    beta, phi = draws_of(found.posterior, bound)
    names = [*bound.names, *map(str, bound.hyper_prior.names)]
    draws = np.concatenate([beta, phi], axis=1)
    every = {
        "results": _stated(summary.assign(U_k2=2.0 * summary["sd"], verdict=verdicts)),
        "covariance": pd.DataFrame(np.cov(draws.T), names, names).rename_axis("parameter"),
        "correlation": pd.DataFrame(np.corrcoef(draws.T), names, names).rename_axis("parameter"),
        "budget": pd.DataFrame(lines).set_index("parameter"),
        "circularity": found.path.set_index("plane"),
        "measured_circularity": _with_units(measured).rename_axis("test"),
        "contributions": (
            _with_units(contributions(found.posterior, ci_prob=found.ci_prob)).set_index("plane")
        ),
    }
    if found.averaged is not None:
        mean = lb.summarize(found.averaged, ci_prob=found.ci_prob).drop(
            columns=["ess_bulk", "ess_tail", "rhat"]
        )
        # Slopes are exactly zero in some of the models: no mean and U describe them.
        mean = mean.loc[
            [own.name for own in bound_of(found.averaged).parameters if own.degree == 0]
        ]
        skewed = [
            is_skewed(row["mean"], (row["ci_low"], row["ci_high"])) for _, row in mean.iterrows()
        ]
        every["averaged"] = _stated(mean.assign(U_k2=2.0 * mean["sd"], skewed=skewed))
    if len(pairs):
        every["measured_pairs"] = _with_units(pairs).rename_axis("tests")
    if others:
        side_by_side = pd.concat(
            {other.name: other.differences for other in others}, names=["campaign", "parameter"]
        )
        every["differences"] = side_by_side.reset_index().set_index("campaign")
    return every


def _stated(summary: pd.DataFrame) -> pd.DataFrame:
    """With the unit for reading of every row, and the factor to it."""
    factors, labels = zip(*map(display_unit, summary["unit"]), strict=True)
    return summary.assign(reading_unit=labels, reading_factor=factors).rename_axis("parameter")


def _with_units(frame: pd.DataFrame) -> pd.DataFrame:
    """Columns that stand for a quantity carry its unit in their names."""
    ends = {"µm": "_um", "µm/m": "_um_per_m"}
    return frame.rename(
        columns={name: f"{name}{ends[unit]}" for name, unit in frame.attrs["units"].items()}
    )


_NAMES = (
    "results averaged covariance correlation budget circularity measured_circularity contributions"
    " measured_pairs differences conformity"
)
_TABLES = tuple(f"{name}.csv" for name in _NAMES.split())
REPORT_FILES = ("report.html", "report.pdf", "report.json", "dcc.xml", "tables")


def check_folder(folder: Path) -> None:
    """Refuse a folder that a report cannot be written to, before any work is done."""
    check_target(folder / "tables" if folder.is_dir() else folder, force=True, ours=_TABLES)


def write_report(
    posterior: xr.DataTree,
    folder: str | os.PathLike[str],
    *,
    beside_it: Mapping[str, xr.DataTree] | None = None,
    same_instrument: bool = False,
    ci_prob: float = 0.95,
    tests: int | None = None,
    comparison: Compared | None = None,
    recommended: Recommended | Callable[[], Recommended] | None = None,
    averaged: xr.DataTree | None = None,
    tolerances: Mapping[str, Any] | None = None,
    language: str = "en",
    annex: bool = False,
    force_N: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Document:
    """Write report.html, report.pdf (its two sheets), dcc.xml (their numbers), report.json and
    tables (CSV) into a folder.

    InputError for a comparison of other readings, results of other machines, or a folder that
    cannot be written.

    Parameters
    ----------
    posterior : from `sample` or `load`.
    folder : made where it is missing; other files in it stay.
    beside_it : mapping of name to DataTree, optional
        Other campaigns to set beside this one.
    same_instrument : whether these were run with the same bar, balls, mount and force device.
    ci_prob : probability of the credible intervals.
    tests : circles to recommend; default: as many as the campaign has.
    comparison : from `compare` on the same readings; default: the evidence of constant and linear
        compliance is worked out.
    recommended : from `design` or `read_design` after the same readings; default: as many circles
        as ``tests``, of the forces tested. Or what gives it when the page comes to it.
    averaged : from `average`: what the sheets state; default: the posterior itself, and the sheets
        say so.
    tolerances : mapping of quantity to Tolerance, optional
        That the sheets are to state conformity with.
    language : of the sheets: en or de.
    annex : whether all that follows the sheets is printed too.
    force_N : at which the sheets state stiffness and circular deviation; default: the reference
        force.
    progress : called with the sections done and their number.

    Returns
    -------
    Document
        What was written; its pictures hold the figures.
    """
    folder = Path(folder)
    check_folder(folder)
    check_force(campaign_of(posterior), force_N)
    apart = tuple(
        Beside(
            name,
            result_json(other, ci_prob=ci_prob),
            differences(posterior, other, same_instrument=same_instrument, ci_prob=ci_prob),
        )
        for name, other in (beside_it or {}).items()
    )
    words_of(language)
    found = find(
        posterior,
        ci_prob=ci_prob,
        tests=tests,
        comparison=comparison,
        recommended=recommended,
        averaged=averaged,
        tolerances=tolerances,
    )
    asked: dict[str, Any] = {"language": language, "annex": annex, "force_N": force_N}
    document = compose(found, apart, same_instrument=same_instrument, **asked, progress=progress)
    frames = tables(found, apart)
    conform = {name: own.as_dict() for name, own in found.conformity(force_N).items()}
    if conform:
        frames["conformity"] = pd.DataFrame.from_dict(conform, orient="index").rename_axis(
            "quantity"
        )
    record = json_text(
        _record(found, document, frames) | {"state": document.state, "conformity": conform}
    )
    page = html_page(document)
    paper = pdf_of(
        document.sheets,
        document.title,
        language,
        datetime.fromisoformat(found.result["provenance"]["started"]),
    )
    with staged_folder(folder / "tables", force=True, ours=_TABLES) as staging:
        for name, frame in frames.items():
            frame.to_csv(staging / f"{name}.csv")
    write_whole(folder / "report.json", record.encode())
    write_whole(folder / "report.html", page.encode())
    write_whole(folder / "report.pdf", paper)
    write_dcc(found.numbers, folder / "dcc.xml", ci_prob=ci_prob)
    return document


def _record(
    found: Findings, document: Document, frames: Mapping[str, pd.DataFrame]
) -> dict[str, Any]:
    """One JSON of all tables, with what they are of."""
    beside = {"comparison": found.comparison, "design": found.design}
    return {
        "schema": 1,
        "campaign": found.result["campaign"],
        "model": found.result["model"],
        "alerts": list(document.alerts),
        "provenance": record_of(found.posterior)["provenance"],
        "tables": {
            name: frame.reset_index().to_dict(orient="records") for name, frame in frames.items()
        },
        **{
            key: {"missing": own} if isinstance(own, str) else wording.with_words(own)
            for key, own in beside.items()
        },
    }


# ---- for programs that read calibration certificates: D-SI numbers in the format of a DCC (schema
# 3.3.0, D-SI 2.2.1)

_DSI = {"mm": r"\milli\metre", "um": r"\micro\metre", "N": r"\newton", "rad": r"\radian"}


def dsi_unit(*units: str) -> str:
    r"""Return a product of inside units in D-SI notation: mm/N →
    \\milli\\metre\\newton\\tothe{-1}."""
    powers: Counter[str] = Counter()
    for unit in units:
        for k, part in enumerate(unit.split("/")):
            for name, power in re.findall(r"([a-zA-Z]+)(?:\^(\d))?", part):
                powers[name] += int(power or 1) * (-1 if k else 1)
    shown = (
        _DSI[name] + ("" if power == 1 else f"\\tothe{{{power}}}")
        for name, power in powers.items()
        if power
    )
    return "".join(shown) or r"\one"


def write_dcc(
    posterior: xr.DataTree, path: str | os.PathLike[str], *, ci_prob: float = 0.95
) -> Path:
    """Write what a fit says of a machine as XML in the format of a digital calibration certificate,
    and return the path.

    Every compliance and geometric error in inside units (mm, N, rad), the numbers of ``fit
    --json``: mean, U (k = 2), interval of probability ``ci_prob``, covariance. The file says that
    it is unsigned and no calibration certificate.
    """
    result = result_json(posterior, ci_prob=ci_prob)
    campaign = campaign_of(posterior)
    draws = np.stack(
        [np.ravel(posterior["posterior"].dataset[name]) for name in result["parameters"]]
    )
    units = [entry["unit"] for entry in result["parameters"].values()]
    covariance = np.atleast_2d(np.cov(draws))
    columns = [
        [(covariance[i, j], dsi_unit(units[i], units[j])) for i in range(len(units))]
        for j in range(len(units))
    ]
    text = _template("dcc.xml.j2").render(
        campaign=campaign,
        model=result["model"],
        plane=campaign.machine().plane,
        version=result["provenance"]["versions"]["ldbb-bayes"],
        fitted=result["provenance"]["started"][:10],
        identifier=f"ldbb_bayes-{hashlib.sha256(json.dumps(result['parameters']).encode()).hexdigest()[:32]}",
        verdict=fit_in_words(posterior)["verdict"],
        parameters=[*_parameters(posterior, result["parameters"], draws, f"ci{100 * ci_prob:g}")],
        covariance=columns,
        factor=_coverage_factor(draws, covariance, ci_prob),
        models=len(result.get("averaged", {}).get("models", ())),
        ci_prob=ci_prob,
    )
    write_whole(Path(path), text.encode())
    return Path(path)


def _coverage_factor(draws: Array, covariance: Array, probability: float) -> float:
    """Of the ellipsoid that holds this share of the draws; a parameter that is the same in all of
    them has no part in it."""
    sd = np.sqrt(np.diag(covariance))
    scaled = draws - draws.mean(axis=1, keepdims=True)
    scale = np.where(sd > 0.0, sd, 1.0)
    inverse = np.linalg.pinv(covariance / np.outer(scale, scale), hermitian=True)
    scaled /= scale[:, None]
    return float(np.sqrt(np.quantile(np.sum(scaled * (inverse @ scaled), axis=0), probability)))


def _parameters(
    posterior: xr.DataTree, entries: Mapping[str, Mapping[str, Any]], draws: Array, interval: str
) -> Iterator[dict[str, Any]]:
    """What the file says of every parameter; ``within``: the share of the draws in mean ± U."""
    verdicts = lb.verdicts(posterior)
    for (name, entry), own in zip(entries.items(), draws, strict=True):
        kind = (
            "slope"
            if re.fullmatch(r"C_.*_\d", name)
            else "compliance"
            if name[0] == "C"
            else "geometric"
        )
        low, high = entry[interval]
        yield {key: entry[key] for key in ("mean", "sd")} | {
            "name": name,
            "shown": display_name(name),
            "kind": kind,
            "low": low,
            "high": high,
            "unit": dsi_unit(entry["unit"]),
            "within": float(np.mean(np.abs(own - entry["mean"]) <= 2.0 * entry["sd"])),
            "verdict": wording.verdict_words(verdicts[name]) if name in verdicts else "",
        }
