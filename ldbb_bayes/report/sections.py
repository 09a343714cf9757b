"""The sections of a report, from findings: paragraphs, lists, tables and figures."""

from __future__ import annotations

import html
import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, TypeAlias

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from ldbb_bayes.analysis.budget import Budget, Contribution
from ldbb_bayes.analysis.circularity import BIDIRECTIONAL, COMPLIANCE, GEOMETRY, QUANTITIES, TOGETHER, squareness_name
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.analysis.describe import describe
from ldbb_bayes.analysis.design.design import Design
from ldbb_bayes.inference.posterior import bound_of, campaign_of, fit_of, record_of
from ldbb_bayes.report import figures, wording
from ldbb_bayes.report.findings import Findings, further_remarks
from ldbb_bayes.report.text import (
    clear_of_zero,
    left_out_table,
    models_table,
    nuisance_table,
    preview_table,
    results_table,
    slopes_table,
)
from ldbb_bayes.report.wording import joined, nuisance_words, unit_words
from ldbb_bayes.table import Table
from ldbb_bayes.units import display_name, display_unit, ranked, round_like, round_uncertainty, state

__all__ = ["Beside", "Details", "Document", "Picture", "Section", "compose"]

_REFERENCE = re.compile(r'(\bid="|xlink:href="#|url\(#)')
_PROLOGUE = re.compile(r"^.*?(?=<svg)|<metadata>.*?</metadata>\s*", re.DOTALL)
_GEOMETRY = re.compile(r' (?:d|x|y|points)="[^"]*"')
_DIGITS = re.compile(r"(\.\d\d)\d+")


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure.

    Attributes
    ----------
    key : str
        Of its file.
    name : str
        What it is, for those who cannot see it.
    caption : str
    figure : Figure
    """

    key: str
    name: str
    caption: str
    figure: Figure

    @cached_property
    def svg(self) -> str:
        """The figure as SVG to stand in a page: responsive, with an accessible name, its ids kept apart from other figures'."""
        drawn = io.StringIO()
        with mpl.rc_context({"svg.hashsalt": "ldbb", "svg.fonttype": "none"}):
            self.figure.savefig(drawn, format="svg", metadata={"Date": None}, transparent=True)
        text = _REFERENCE.sub(rf"\g<1>{self.key}-", _PROLOGUE.sub("", drawn.getvalue()))
        # A hundredth of a point is finer than any screen or printer.
        text = _GEOMETRY.sub(lambda match: _DIGITS.sub(r"\1", match[0]), text)
        title = f'<title id="title-{self.key}">{html.escape(self.name)}</title>'
        start, _, rest = text.partition(">")
        return f'<svg role="img" aria-labelledby="title-{self.key}"{start.removeprefix("<svg")}>{title}{rest}'


@dataclass(frozen=True)
class Details:
    """Parts that open on demand on a screen, and are printed."""

    summary: str
    parts: tuple[str | tuple[str, ...] | Table, ...]


Part: TypeAlias = str | tuple[str, ...] | Table | Picture | Details
"""A paragraph (code where it has several lines), a list, or what its name says."""


@dataclass(frozen=True)
class Section:
    """A heading and what stands under it."""

    key: str
    title: str
    parts: tuple[Part, ...]


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


def summary(found: Findings) -> Section:
    """Compliance, geometry, constant or linear, what to do next."""
    result = found.result
    sentences = (
        *wording.compliance_summary(result, found.verdicts, found.budgets),
        *wording.geometry_summary(result, found.verdicts, found.flat),
        *wording.comparison_summary(result, found.comparison),
        *wording.next_summary(found.budgets, found.flat, found.design, found.design_given),
    )
    return Section("summary", "Summary", (wording.summary_lead(result), sentences))


def campaign(found: Findings) -> Section:
    """Tests, assumptions and remarks."""
    seen = found.seen
    readings = sum(test.readings for test in seen.tests)
    remarks = wording.look_sentences(seen) + [wording.remark_words(remark) for remark in seen.remarks]
    assumed = tuple(map(wording.remark_words, seen.assumptions))
    caption = (
        "Tests. Noise: scatter beyond Fourier order 12; balls: clocking of workpiece and tool ball; directions in brackets are "
        "not stated"
    )
    picture = Picture(
        "traces",
        f"Polar traces of {len(seen.tests)} circular tests with the prediction of the fit",
        "Readings, prediction (machine and shared nuisances), and the 95 % band for a new circle.",
        figures.traces(found.posterior),
    )
    intro = f"{len(seen.tests)} circular tests, {readings} readings. SHA-256 of the readings: {seen.sha256}."
    remarked = ("Seen in the readings:", tuple(remarks)) if remarks else ()
    return Section(
        "campaign", "The campaign", (intro, replace(preview_table(seen), caption=caption), assumed, *remarked, picture)
    )


_SCALES = {
    "sigma": "σ, white noise of a reading",
    "delta": "δ, shift of zero and centre between circles",
    "delta_0": "δ of the zero",
    "delta_1": "δ of the centre",
    "kappa": "κ, discrepancy of a circle at order n is κ/n",
    "tau": "τ, form of the balls at order n is τ/n",
}


def results(found: Findings) -> Section:
    """Parameters, hyper-parameters and shared nuisances."""
    percent = wording.percent_of(found.result)
    scales = []
    for name, entry in found.result["hyper"].items():
        spread, decimals = round_uncertainty(entry["sd"])
        low, high = (round_like(bound, decimals) for bound in entry[found.interval_key])
        short = name.removesuffix("_um")
        scales.append((_SCALES.get(short, short), round_like(entry["mean"], decimals), spread, f"[{low}, {high}]"))
    forest = Picture(
        "forest",
        "Intervals of every parameter beside its prior",
        "Every parameter in units of its prior standard deviation.",
        figures.forest(found.posterior),
    )
    against = Picture(
        "compliance_against_force",
        "Compliance against force with credible bands",
        "Compliance over the tested forces, 50 % and 95 % bands.",
        figures.compliance_against_force(found.posterior),
    )
    heads = ("scale", "value", "u", f"{percent} interval")
    return Section(
        "results",
        "Results",
        (
            wording.results_introduction(found.result),
            results_table(found.result, found.verdicts),
            forest,
            against,
            Table.of("Scales learnt from the readings (µm)", heads, scales),
            *_nuisances(found),
            _meanings(found),
        ),
    )


def _nuisances(found: Findings) -> list[Details]:
    """Bar, mount and force, and of the other coefficients those that differ from zero."""
    entries = found.result["nuisances"]
    clear = clear_of_zero(entries)
    shown = {n: own for n, own in entries.items() if n in clear or own["term"] in ("BarLength", "Mount", "ForceError")}
    if not shown:
        return []
    hidden = len(entries) - len(shown)
    more = f"; {hidden} others do not differ from zero (k = 2)" if hidden else ""
    caption = f"Bar, mount and force, form and hysteresis different from zero{more}. Mount: deviation from the nominal deflection"
    heads = ("nuisance", "value", "u", "u before", "unit")
    return [Details("What the fit says of the instrument", (nuisance_table(caption, shown, heads),))]


def _meanings(found: Findings) -> Details:
    """What every parameter is, and the set it stands for."""
    tests = campaign_of(found.posterior)
    machine = describe(tests.machine(), [test.circle for test in tests.tests])
    seen = {entry.name: entry for entry in (*machine.compliances, *machine.geometric_errors)}
    rows = []
    for name in found.result["parameters"]:
        slope = name[-2:] in ("_1", "_2") and name.startswith("C_")
        entry = seen.get(name[:-2] if slope else name) or seen.get(name.rsplit("_", 1)[0])
        if entry is not None:
            power = {"_1": "slope in force of: ", "_2": "curvature in force of: "}[name[-2:]] if slope else ""
            rows.append((display_name(name), f"{power}{entry.meaning}", "" if slope else wording.sum_in_words(entry)))
    heads = ("parameter", "what it is", "stands for")
    return Details("What the parameters are", (Table.of("Parameters", heads, rows, text=heads),))


def limits(found: Findings) -> Section:
    """Degeneracies with their cures, and how much the readings added to the priors."""
    own = found.identifiability
    lists: list[Part] = [
        entries for entries in (wording.degeneracy_items(own), tuple(map(wording.standing_words, own.standing))) if entries
    ]
    effective = () if found.flat else (wording.effective_sentence(own),)
    parts = (*wording.limits_sentences(own, found.flat), *lists, *effective)
    return Section("limits", "What the data cannot separate", parts)


def degree(found: Findings) -> Section:
    """Evidence, what it hangs on, and where they were asked for slopes one by one and tests left out."""
    compared, title = found.comparison, "Constant or linear"
    if not isinstance(compared, Comparison):
        return Section("degree", title, (f"The models were not compared: {compared}",))
    models = replace(models_table(compared), caption="Models at equal prior odds. RMSE: machine and shared nuisances")
    parts: list[Part] = [wording.comparison_sentences(compared), models]
    if compared.slopes:
        parts.append(replace(slopes_table(compared), caption="Probability that a compliance varies with force"))
    if compared.tests:
        parts.append(replace(left_out_table(compared), caption="Every test as the others expect it"))
    caption = (
        f"Evidence of the models, and ln B({compared.sensitivity_of}) against the scale of slopes and under other assumptions."
    )
    parts.append(Picture("evidence", "Log Bayes factor under every assumption tried", caption, figures.evidence(compared)))
    if not compared.local_fits.empty:
        parts.append(
            Picture(
                "compliance_with_local_fits",
                "Compliance against force by every model, and local fits",
                "Compliance by every model and by local fits of neighbouring forces.",
                figures.compliance_with_local_fits(compared),
            )
        )
    if not compared.slopes and not compared.tests:
        parts.append(
            "Slopes one by one, leave-one-force-out, local fits and tests that do not belong: ldbb-bayes compare CAMPAIGN --out "
            "DIR, then report with --comparison DIR."
        )
    return Section("degree", title, tuple(parts))


_SMALL, _RUNNERS = 0.005, 0.05


def uncertainty(found: Findings) -> Section:
    """What each uncertainty is made of, and what would improve it most."""
    rows = []
    for name, budget in found.budgets.items():
        factor, unit = display_unit(budget.unit)
        shares = {line.term: budget.share(line.term) for line in budget.contributions}
        heavy = ranked([term for term in shares if shares[term] >= _RUNNERS], lambda term, own=shares: own[term])[:3]  # type: ignore[misc]
        largest = ", ".join(f"{wording.source_words(term)} {100 * shares[term]:.0f} %" for term in heavy)
        left = "–" if budget.u_if_known is None else round_uncertainty(budget.u_if_known * factor)[0]
        rows.append(
            (display_name(name), round_uncertainty(budget.u * factor)[0], unit, largest, wording.remedy_words(budget), left)
        )
    heads = ("parameter", "u", "unit", "largest sources", "what would improve it most", "u then")
    picture = Picture(
        "budget",
        "Share of every source of uncertainty in the variance of every parameter",
        "Uncertainty budgets.",
        figures.budget_bars(found.budgets),
    )
    details = (Details(wording.budget_line(budget), (_budget(budget),)) for budget in found.budgets.values())
    table = Table.of("What limits every parameter", heads, rows, text=heads[2:5])
    return Section("uncertainty", "Uncertainty budget", (wording.budget_introduction(), table, picture, *details))


def _budget(budget: Budget) -> Table:
    factor, unit = display_unit(budget.unit)
    rows: list[tuple[str, ...]] = []
    small = sum(line.share for line in budget.contributions if line.share < _SMALL)
    for line in (line for line in budget.contributions if line.share >= _SMALL):
        one, one_unit = _one(line)
        rows.append(
            (
                _source(line),
                line.kind,
                "" if line.u is None else _two(line.u * one),
                one_unit if line.u is not None else "",
                "" if line.sensitivity is None else _two(line.sensitivity * factor / one),
                _two(line.contribution * factor),
                f"{100 * line.share:.1f} %",
            )
        )
    if abs(small) >= 5e-4:
        contribution = _two(max(small, 0.0) ** 0.5 * budget.u * factor)
        rows.append(("all smaller ones", "", "", "", "", contribution, f"{100 * small:.1f} %"))
    rows.append(("together", "", "", "", "", _two(budget.u * factor), "100.0 %"))
    heads = ("source", "type", "its u", "its unit", f"sensitivity ({unit} per its unit)", f"contribution ({unit})", "share")
    return Table.of(f"Budget of {display_name(budget.parameter)}", heads, rows, text=("type", "its unit"))


def _source(line: Contribution) -> str:
    if line.source.startswith("other "):
        return f"other {wording.source_words(line.term)}"
    return wording.source_words(line.term) if line.source == line.term else nuisance_words(line.source)


def _one(line: Contribution) -> tuple[float, str]:
    """Factor and label that the source's own uncertainty is read in."""
    if line.source == line.term:
        return (1.0, "N") if line.unit == "N" else (1e3, "µm")
    one, label = unit_words(line.source)
    return 1.0 / one, label


def _two(value: float) -> str:
    """Two significant digits without an exponent."""
    return f"{'−' if value < 0 else ''}{round_uncertainty(abs(value))[0]}"


_FEW = 12
_WORDS = {
    "G_minimum_zone": "G, minimum zone",
    "scale_mismatch": "scale mismatch",
    "G_b": "G(b)",
    "G_b_minimum_zone": "G(b), minimum zone",
}
_HEADS = {
    name: f"{_WORDS.get(name, name.replace('scale_', 'scale '))} ({unit})" for name, unit in (QUANTITIES | BIDIRECTIONAL).items()
}


def path(found: Findings) -> Section:
    """Per force and as a function of force."""
    planes = list(dict.fromkeys(found.path["plane"]))
    measured, pairs = found.measured
    bound = bound_of(found.posterior)
    squares = [squareness_name(bound, plane) for plane in planes]
    parts: list[Part] = [wording.path_introduction(squares, wording.percent_of(found.result))]
    for plane in planes:
        own = found.path[found.path["plane"] == plane]
        where = f", plane {plane}" if len(planes) > 1 else ""
        parts.append(_quantities(own, list(QUANTITIES), f"The machine's path{where} (R = {own['radius_mm'].iloc[0]:g} mm)"))
        if own["quantity"].isin(list(BIDIRECTIONAL)).any():
            caption = f"Both directions{where}: bidirectional deviation G(b), mean radial deviation D, hysteresis included"
            parts.append(_quantities(own, list(BIDIRECTIONAL), caption))
    parts.append(_measured(measured))
    if len(pairs):
        rows = [
            (str(name), f"{row['force_N']:.4g}", *(f"{row[quantity]:.2f}" for quantity in BIDIRECTIONAL))
            for name, row in pairs.iterrows()
        ]
        parts.append(Table.of("Pairs of readings", ("tests", "force (N)", *(_HEADS[q] for q in BIDIRECTIONAL)), rows))
    drawn = (
        (
            figures.circularity,
            "Circular deviation, radial deviation, squareness and scale mismatch against force",
            "Circular-test quantities as functions of force.",
        ),
        (
            figures.contributions,
            "Contribution of compliance and geometry to the reading at every force",
            "What compliance and geometry contribute (Fig. 8 of the paper), tool offsets left out.",
        ),
        (
            figures.parameter_contributions,
            "Contribution of every parameter to the reading at the highest force",
            "What every parameter contributes (Figs. 9 and 10 of the paper).",
        ),
    )
    first, *others = (Picture(draw.__name__, name, caption, draw(found.posterior)) for draw, name, caption in drawn)
    return Section(
        "path", "Circular-test quantities", (*parts, first, *(_contributions(found, plane) for plane in planes), *others)
    )


def _quantities(table: pd.DataFrame, quantities: list[str], caption: str) -> Table:
    forces = list(dict.fromkeys(table["force_N"]))
    shown = forces if len(forces) <= _FEW else [*forces[:: len(forces) // (_FEW - 2)], forces[-1]]
    by_force = {(row["force_N"], row["quantity"]): row for _, row in table.iterrows()}

    def cell(force: float, quantity: str) -> str:
        row = by_force[force, quantity]
        _, decimals = round_uncertainty(row["sd"])
        middle, low, high = (round_like(row[key], decimals) for key in ("median", "ci_low", "ci_high"))
        return f"{middle} [{low}, {high}]"

    rows = [(f"{force:.4g} N", *(cell(force, quantity) for quantity in quantities)) for force in dict.fromkeys(shown)]
    return Table.of(caption, ("force", *(_HEADS[quantity] for quantity in quantities)), rows)


def _measured(table: pd.DataFrame) -> Table:
    places = {field: head for field, head in (("plane", "plane"), ("radius_mm", "R (mm)")) if table[field].nunique() > 1}
    rows = [
        (
            str(name),
            *(f"{row[field]}".removesuffix(".0") for field in places),
            f"{row['force_N']:.4g}",
            row["direction"] or "–",
            *("–" if row[quantity] != row[quantity] else f"{row[quantity]:.2f}" for quantity in QUANTITIES),
        )
        for name, row in table.iterrows()
    ]
    heads = ("test", *places.values(), "force (N)", "travel", *(_HEADS[quantity] for quantity in QUANTITIES))
    return Table.of("The readings themselves, balls, bar and mount included; no uncertainty", heads, rows, text=("travel",))


def _contributions(found: Findings, plane: str) -> Table:
    table = found.contributions
    own = table[table["plane"] == plane]
    rows = []
    for _, row in own.iterrows():
        _, decimals = round_uncertainty(row["sd"])
        keys = ("maximum", "minimum", "median", "ci_low", "ci_high")
        most, least, size, low, high = (round_like(row[key], max(decimals, 1)) for key in keys)
        source = row["source"] if row["source"] in (TOGETHER, COMPLIANCE, GEOMETRY) else display_name(row["source"])
        rows.append((source, most, least, size, f"[{low}, {high}]"))
    where = f", plane {plane}" if table["plane"].nunique() > 1 else ""
    caption = (
        f"Contributions to the reading at {own['force_N'].iloc[0]:.4g} N{where}, a compliance with its slope. Largest and "
        "smallest: of the mean path; peak to peak: median over what is likely, which does not shrink where little is known"
    )
    percent = wording.percent_of(found.result)
    heads = ("source", "largest (µm)", "smallest (µm)", "peak to peak (µm)", f"{percent} interval of it (µm)")
    return Table.of(caption, heads, rows)


def plan(found: Findings) -> Section:
    """Which circles to run instead of these, and what they would tell."""
    title, chosen = "Recommended next tests", found.design
    if isinstance(chosen, str):
        return Section("plan", title, (f"No tests are recommended: {chosen}",))
    sentences = wording.design_sentences(chosen, aliases=False)
    parts: list[Part] = [wording.design_introduction(found.design_given), sentences, _expected(chosen, found)]
    if not chosen.sensitivity.empty:
        parts.append(
            Picture(
                "information",
                "How much a circle tells at every force, and the circles recommended",
                "Where a circle tells most, and the circles recommended.",
                figures.information(chosen),
            )
        )
    return Section("plan", title, tuple(parts))


def _expected(design: Design, found: Findings) -> Table:
    now = {name: entry["sd"] for name, entry in found.result["parameters"].items()}
    rows = []
    for name, entry in design.expected.items():
        factor, unit = display_unit(entry.unit)
        values = (now.get(name, np.nan), entry.sd, design.baseline[name].sd, entry.floor_sd, entry.prior_sd)
        cells = [round_uncertainty(value * factor)[0] if np.isfinite(value) else "–" for value in values]
        rows.append((display_name(name), *cells, unit))
    heads = ("parameter", "u now", "expected u", design.compared[0].name, "no less than", "prior", "unit")
    degree, where = ("constant", "linear", "quadratic")[design.degree], "added to it" if design.augment else "in its place"
    caption = (
        f"Standard uncertainties, {degree} compliance: of this campaign, and expected of the circles recommended {where} "
        "(averaged over readings not yet taken); no less than: what a million circles would leave"
    )
    return Table.of(caption, heads, rows, text=("unit",))


def fit(found: Findings) -> Section:
    """RMSE, fitness and posterior predictive checks."""
    quality = found.result["fit"]
    concerns = wording.concern_sentences(fit_of(found.posterior).concerns, found.result["sampler"])
    notes = (*concerns, *further_remarks(found.seen))
    rows = []
    for test in found.seen.tests:
        checks = quality["predictive_checks"][test.name]
        order, least = ranked(checks["orders_p"].items(), lambda pair: -pair[1])[0]
        others = [
            None if checks[key] is None else f"{checks[key]:.2g}" for key in ("noise_p", "autocorrelation", "autocorrelation_p")
        ]
        fitness = f"{quality['fitness_percent'][test.name]:.1f}"
        rows.append((test.name, f"{test.force_N:.4g}", fitness, f"{least:.2g} (order {order})", *others))
    heads = (
        "test",
        "force (N)",
        "fitness (%)",
        "smallest p by order",
        "p, white noise",
        "autocorrelation (1)",
        "p, autocorrelation",
    )
    caption = "Fitness (Eq. 35) and posterior predictive checks: small p where the model does not expect the reading"
    residuals = Picture(
        "residuals",
        "Residuals of every test against angle, and their amplitude by Fourier order",
        "Reading minus prediction; each circle's own shift and discrepancy left in.",
        figures.residuals(found.posterior),
    )
    predictive = Picture(
        "predictive",
        "Prior and posterior predictive bands of the circle at the highest force",
        "What prior and posterior expect of a circle at the highest force.",
        figures.predictive(found.posterior),
    )
    parts: list[Part] = [wording.fit_introduction(quality), Table.of(caption, heads, rows), *([notes] if notes else [])]
    return Section("fit", "How well the model fits", (*parts, residuals, predictive))


def assumptions(found: Findings) -> Section:
    """Every prior with its unit, and the terms."""
    bound = bound_of(found.posterior)
    rows = []
    for own in bound.parameters:
        factor, unit = display_unit(own.unit)
        sd, decimals = round_uncertainty(own.prior_sd * factor) if np.isfinite(own.prior_sd) else ("flat", 0)
        rows.append((display_name(own.name), round_like(own.prior_mean * factor, decimals), sd, unit))
    for name, scale in zip(bound.hyper_prior.names, bound.hyper_prior.scale_mm, strict=True):
        rows.append((str(name), "", round_uncertainty(float(scale) * 1e3)[0], "µm (scale)"))
    means = any(entry.get("prior_mean") for entry in found.result["parameters"].values())
    heads: tuple[str, ...] = ("parameter", "prior mean", "prior sd", "unit")
    shown = rows if means else [(name, sd, unit) for name, _, sd, unit in rows]
    caption = f"Prior {'means and ' if means else ''}standard deviations, without truncation"
    table = Table.of(caption, heads if means else (heads[0], *heads[2:]), shown, text=("unit",))
    toml: str = record_of(found.posterior)["model"]["toml"]
    details = Details("The whole model as TOML (edit and fit again with --model)", (toml,))
    terms = wording.prior_sentences(found.result, found.flat)
    return Section("assumptions", "Priors and assumptions", (terms, table, details))


def diagnostics(found: Findings) -> Section:
    """Effective sample sizes and R-hat."""
    sampler, sensitivity = found.result["sampler"], record_of(found.posterior)["fit"]["sensitivity"]
    rows = [
        (
            display_name(str(name)),
            f"{row['ess_bulk']:.0f}",
            f"{row['ess_tail']:.0f}",
            f"{row['rhat']:.4f}",
            f"{sensitivity[name]['prior']:.3f}" if name in sensitivity else "",
        )
        for name, row in found.summary.iterrows()
    ]
    heads = ("parameter", "ESS bulk", "ESS tail", "R-hat", "sensitivity to the prior (1)")
    caption = "By parameter; above 0.05 a number moves when its prior's scale does (power scaling)"
    parts: list[Part] = [wording.sampler_sentences(sampler), Table.of(caption, heads, rows)]
    if sampler["kind"] != "independent":
        words = "Traces and ranks of the slowest parameters"
        parts.append(Picture("chains", words, f"{words}: level where ensembles agree.", figures.chains(found.posterior)))
    return Section("diagnostics", "Diagnostics", tuple(parts))


def method(found: Findings) -> Section:
    """In short, with digests, versions and seed."""
    provenance, tests, model = (found.result[key] for key in ("provenance", "campaign", "model"))
    rows = (
        ("campaign", tests["name"]),
        ("readings, SHA-256", tests["sha256"]),
        ("model, SHA-256", model["sha256"]),
        ("sampler and seed", f"{found.result['sampler']['kind']}, {provenance['seed']}"),
        ("fitted", f"{provenance['started']}, {provenance['platform']}"),
        ("versions", ", ".join(f"{name} {value}" for name, value in provenance["versions"].items())),
    )
    table = Table.of("Provenance", ("what", "value"), rows, text=("value",))
    parts: tuple[Part, ...] = (wording.method_sentences(found.result), wording.method_notes(), table)
    return Section("method", "Method, limitations, provenance", parts)


_BLANKS = (
    "machine, maker and serial number", "date and place of the tests", "bar and balls, certificates", "force device, certificate",
    "temperature, warm-up", "positions of axes not moved", "operator", "checked and signed by, date",
)  # fmt: skip


def sign_off(_: Findings) -> Section:
    """What readings do not hold and a signature needs, to be filled in."""
    table = Table.of("To be filled in", ("what", "entry"), [(blank, "") for blank in _BLANKS], text=("entry",))
    return Section("sign-off", "Sign-off", (table,))


@dataclass(frozen=True, eq=False)
class Beside:
    """Another campaign beside the first.

    Attributes
    ----------
    name : str
    result : dict
        The JSON of its fit.
    differences : DataFrame
        Of its parameters to those of the first, from `differences`.
    """

    name: str
    result: Mapping[str, Any]
    differences: pd.DataFrame


def beside(first: Mapping[str, Any], others: Sequence[Beside], *, same_instrument: bool, ci_prob: float) -> Section:
    """Differences of every parameter with intervals and probabilities.

    Parameters
    ----------
    first : dict
        The JSON of the fit that the others are compared with.
    """
    name = str(first["campaign"]["name"])
    rows = []
    for whose, own in ((name, first), *((other.name, other.result) for other in others)):
        tests, forces = own["campaign"], own["campaign"]["forces_N"]
        compliance = ("constant", "linear", "quadratic")[own["model"]["degree"]]
        converged = "yes" if own["sampler"]["converged"] else "NO"
        fitted = own["provenance"]["started"][:10]
        span = f"{min(forces):g} to {max(forces):g}"
        rows.append((whose, str(tests["tests"]), span, compliance, fitted, converged, tests["sha256"]))
    heads = ("campaign", "tests", "forces (N)", "compliance", "fitted", "converged", "readings, SHA-256")
    picture = Picture(
        "differences",
        "Difference of every parameter to the first campaign",
        "Differences in units of their standard uncertainty.",
        figures.difference_forest({other.name: other.differences for other in others}, ci_prob=ci_prob),
    )
    return Section(
        "beside",
        "Campaigns side by side",
        (
            wording.beside_introduction(first, [other.result for other in others], same_instrument),
            tuple(wording.change_sentence(name, other.name, other.differences, ci_prob) for other in others),
            Table.of("Campaigns", heads, rows, text=heads[2:]),
            *(_differences(name, other, f"{100 * ci_prob:g} %") for other in others),
            picture,
        ),
    )


def _differences(first: str, other: Beside, percent: str) -> Table:
    rows = []
    for parameter, row in other.differences.iterrows():
        own = state(row["difference"], row["sd"], (row["ci_low"], row["ci_high"]), row["unit"])
        factor, _ = display_unit(row["unit"])
        _, decimals = round_uncertainty(row["sd"] * factor)
        values = [round_like(row[key] * factor, decimals) for key in ("first", "second")]
        p = row["probability_of_increase"]
        probability = "> 0.999" if p > 0.999 else "< 0.001" if p < 0.001 else f"{p:.3f}"
        rows.append((display_name(str(parameter)), *values, own.value, own.u, own.interval, own.unit, probability))
    heads = ("parameter", "first", "second", "difference", "u", f"{percent} interval", "unit", "P(second > first)")
    return Table.of(f"Second: {other.name}; first: {first}", heads, rows, text=("unit",))


_SECTIONS = (summary, campaign, results, limits, degree, uncertainty, path, plan, fit, assumptions, diagnostics, method, sign_off)


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
    report(0, len(_SECTIONS))
    made = {}
    # The comparison may still be at work elsewhere: what shows it comes last, and figures are drawn as they come.
    for k, section in enumerate(sorted(_SECTIONS, key=lambda section: section in (summary, degree))):
        made[section] = section(found)
        for part in made[section].parts:
            if isinstance(part, Picture):
                _ = part.svg
        report(k + 1, len(_SECTIONS))
    sections = [made[section] for section in _SECTIONS]
    result, seen = found.result, found.seen
    name = title = str(result["campaign"]["name"])
    if others:
        sections.insert(1, beside(result, others, same_instrument=same_instrument, ci_prob=found.ci_prob))
        title = f"{name}, beside {joined([other.name for other in others])}"
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
