"""The sections of the report, from findings: paragraphs, lists, tables and figures."""

from __future__ import annotations

import html
import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from ldbb_bayes.analysis.budget import Budget, Contribution
from ldbb_bayes.analysis.circularity import BIDIRECTIONAL, COMPLIANCE, GEOMETRY, QUANTITIES, TOGETHER, squareness_name
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.analysis.design.design import Design
from ldbb_bayes.analysis.identifiability import describe
from ldbb_bayes.inference.posterior import bound_of, campaign_of, fit_of, record_of
from ldbb_bayes.model.terms import Term
from ldbb_bayes.report import figures, wording
from ldbb_bayes.report.findings import Findings, further_remarks
from ldbb_bayes.report.text import (
    clear_of_zero,
    expected_table,
    left_out_table,
    models_table,
    nuisance_table,
    preview_table,
    results_table,
    slopes_table,
    two_digits,
)
from ldbb_bayes.report.wording import DEGREES, IN_FORCE, nuisance_words, prose, source_words, unit_words
from ldbb_bayes.result import Table
from ldbb_bayes.units import display_name, display_unit, ranked, round_like, round_uncertainty, state

__all__ = ["SECTIONS", "Beside", "Details", "Part", "Picture", "Section", "beside"]

_REFERENCE = re.compile(r'(\bid="|xlink:href="#|url\(#)')
_PROLOGUE = re.compile(r"^.*?(?=<svg)|<metadata>.*?</metadata>\s*", re.DOTALL)
_COORDINATES = re.compile(r' (?:d|x|y|points)="[^"]*"')
_DIGITS = re.compile(r"(\.\d\d)\d+")


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure.

    Attributes
    ----------
    key : str
        Of its file.
    caption : str
        Of the page, and what the figure is for those who cannot see it.
    figure : Figure
    """

    key: str
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
        text = _COORDINATES.sub(lambda match: _DIGITS.sub(r"\1", match[0]), text)
        title = f'<title id="title-{self.key}">{html.escape(self.caption)}</title>'
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


@dataclass(frozen=True, eq=False)
class Beside:
    """Another campaign beside the first: its name, the JSON of its fit, and its `differences` to the first."""

    name: str
    result: Mapping[str, Any]
    differences: pd.DataFrame


_PICTURES: Mapping[str, tuple[Callable[..., Figure], str]] = {
    "traces": (
        figures.traces,
        "Polar traces: readings, prediction (machine and shared nuisances), and the 95 % band for a new circle.",
    ),
    "forest": (figures.forest, "Every parameter in units of its prior standard deviation, beside its prior."),
    "compliance_against_force": (
        figures.compliance_against_force,
        "Compliance over the tested forces, 50 % and 95 % bands.",
    ),
    "evidence": (
        figures.evidence,
        "Evidence of the models, and their ln B against the scale of slopes and under other assumptions.",
    ),
    "compliance_with_local_fits": (
        figures.compliance_with_local_fits,
        "Compliance by every model and by local fits of neighbouring forces.",
    ),
    "budget": (figures.budget_bars, "Uncertainty budgets: share of every source in the variance of every parameter."),
    "circularity": (figures.circularity, "Circular-test quantities as functions of force."),
    "contributions": (
        figures.contributions,
        "What compliance and geometry contribute (Fig. 8 of the paper), tool offsets left out.",
    ),
    "parameter_contributions": (
        figures.parameter_contributions,
        "What every parameter contributes (Figs. 9 and 10 of the paper).",
    ),
    "information": (figures.information, "Where a circle tells most, and the circles recommended."),
    "residuals": (figures.residuals, "Reading minus prediction; each circle's own shift and discrepancy left in."),
    "predictive": (figures.predictive, "What prior and posterior expect of a circle at the highest force."),
    "chains": (figures.chains, "Traces and ranks of the slowest parameters: level where ensembles agree."),
    "differences": (figures.difference_forest, "Differences in units of their standard uncertainty."),
}


def _picture(key: str, subject: Any, **options: Any) -> Picture:
    draw, caption = _PICTURES[key]
    return Picture(key, caption, draw(subject, **options))


# ---- sections, in the order of the page


def summary(found: Findings) -> Iterator[Part]:
    """Compliance, geometry, constant or linear, what to do next."""
    result = found.result
    unusable = "The sampler has not converged: nothing below may be used."
    yield str(result["fit"]["verdict"]) if result["sampler"]["converged"] else unusable
    yield (
        *wording.compliance_summary(result, found.verdicts, found.budgets),
        *wording.geometry_summary(result, found.verdicts, found.flat),
        *wording.comparison_summary(result, found.comparison),
        *wording.next_summary(found.budgets, found.flat, found.design, found.design_given),
    )


def campaign(found: Findings) -> Iterator[Part]:
    """Tests, assumptions and remarks."""
    seen = found.seen
    readings = sum(test.readings for test in seen.tests)
    yield f"{len(seen.tests)} circular tests, {readings} readings. SHA-256 of the readings: {seen.sha256}."
    noise = (
        "Tests. Noise: scatter beyond Fourier order 12; balls: clocking of workpiece and tool ball; directions in brackets are"
    )
    yield replace(preview_table(seen), caption=f"{noise} not stated")
    yield tuple(map(wording.remark_words, seen.assumptions))
    if remarks := (*wording.look_sentences(seen), *map(wording.remark_words, seen.remarks)):
        yield "Seen in the readings:"
        yield remarks
    yield _picture("traces", found.posterior)


def results(found: Findings) -> Iterator[Part]:
    """Parameters, hyper-parameters and shared nuisances."""
    result, model = found.result, bound_of(found.posterior).model
    percent = wording.percent_of(result)
    yield prose("results", model=result["model"], in_force=IN_FORCE[result["model"]["degree"]], percent=percent)
    yield results_table(result, found.verdicts)
    yield _picture("forest", found.posterior)
    yield _picture("compliance_against_force", found.posterior)
    rows = []
    for scale in model.scales:
        entry = result["hyper"][f"{scale.name}_um"]
        spread, decimals = round_uncertainty(entry["sd"])
        value, low, high = (round_like(own, decimals) for own in (entry["mean"], *wording.interval_of(entry)))
        rows.append((f"{scale.symbol or scale.name}, {scale.words}", value, spread, f"[{low}, {high}]"))
    yield Table.of("Scales learnt from the readings (µm)", ("scale", "value", "u", f"{percent} interval"), rows)
    yield from _nuisances(result["nuisances"])
    yield _meanings(found)


def _nuisances(entries: Mapping[str, Mapping[str, Any]]) -> Iterator[Details]:
    """Constants of the instrument, and of the other coefficients those that differ from zero."""
    clear = clear_of_zero(entries)
    constants = {name for name in entries if Term.owner(name).instrument and not Term.owner(name).pattern(name)}
    shown = {name: own for name, own in entries.items() if name in clear or name in constants}
    if shown:
        hidden = len(entries) - len(shown)
        more = f"; {hidden} others do not differ from zero (k = 2)" if hidden else ""
        caption = (
            f"Bar, mount and force, form and hysteresis different from zero{more}. Mount: deviation from the nominal deflection"
        )
        table = nuisance_table(caption, shown, ("nuisance", "value", "u", "u before", "unit"))
        yield Details("What the fit says of the instrument", (table,))


def _meanings(found: Findings) -> Details:
    """What every parameter is, and the set it stands for."""
    tests = campaign_of(found.posterior)
    machine = describe(tests.machine(), [test.circle for test in tests.tests])
    seen = {entry.name: entry for entry in (*machine.compliances, *machine.geometric_errors)}
    powers = {"_1": "slope in force of: ", "_2": "curvature in force of: "}
    rows = []
    for name in found.result["parameters"]:
        power = powers.get(name[-2:], "") if name.startswith("C_") else ""
        entry = seen.get(name[:-2] if power else name) or seen.get(name.rsplit("_", 1)[0])
        if entry is not None:
            rows.append((display_name(name), f"{power}{entry.meaning}", "" if power else wording.sum_in_words(entry)))
    heads = ("parameter", "what it is", "stands for")
    return Details("What the parameters are", (Table.of("Parameters", heads, rows, text=heads),))


def limits(found: Findings) -> Iterator[Part]:
    """Degeneracies with their cures, and how much the readings added to the priors."""
    own = found.identifiability
    yield prose("limits", found=own, flat=found.flat)
    yield from filter(None, (wording.degeneracy_items(own), tuple(map(wording.standing_words, own.standing))))
    if not found.flat:
        yield prose("effective", found=own, basis=wording.basis_words(own))


def degree(found: Findings) -> Iterator[Part]:
    """Evidence, what it hangs on, and where they were asked for slopes one by one and tests left out."""
    compared = found.comparison
    if not isinstance(compared, Comparison):
        yield f"The models were not compared: {compared}"
        return
    yield wording.comparison_sentences(compared)
    yield replace(models_table(compared), caption="Models at equal prior odds. RMSE: machine and shared nuisances")
    if compared.slopes:
        yield replace(slopes_table(compared), caption="Probability that a compliance varies with force")
    if compared.tests:
        yield replace(left_out_table(compared), caption="Every test as the others expect it")
    yield _picture("evidence", compared)
    if not compared.local_fits.empty:
        yield _picture("compliance_with_local_fits", compared)
    if not compared.slopes and not compared.tests:
        yield (
            "Slopes one by one, leave-one-force-out, local fits and tests that do not belong: ldbb-bayes compare CAMPAIGN --out "
            "DIR, then report with --comparison DIR."
        )


_SMALL, _RUNNERS = 0.005, 0.05


def uncertainty(found: Findings) -> Iterator[Part]:
    """What each uncertainty is made of, and what would improve it most."""
    rows, details = [], []
    for name, budget in found.budgets.items():
        factor, unit = display_unit(budget.unit)
        shares = {line.term: budget.share(line.term) for line in budget.contributions}
        heavy = ranked([item for item in shares.items() if item[1] >= _RUNNERS], lambda item: item[1])[:3]
        largest = ", ".join(f"{source_words(term)} {100 * share:.0f} %" for term, share in heavy)
        u, remedy = two_digits(budget.u, factor), wording.remedy_words(budget)
        rows.append((display_name(name), u, unit, largest, remedy, two_digits(budget.u_if_known, factor)))
        details.append(Details(f"{display_name(name)}: u = {u} {unit}", (_budget(budget, factor, unit),)))
    heads = ("parameter", "u", "unit", "largest sources", "what would improve it most", "u then")
    yield prose("budget")
    yield Table.of("What limits every parameter", heads, rows, text=heads[2:5])
    yield _picture("budget", found.budgets)
    yield from details


def _budget(budget: Budget, factor: float, unit: str) -> Table:
    large = [line for line in budget.contributions if line.share >= _SMALL]
    small = sum(line.share for line in budget.contributions if line.share < _SMALL)
    rows: list[tuple[str, ...]] = []
    for line in large:
        one, one_unit = _size_of_one(line)
        own = ("", "") if line.u is None else (two_digits(line.u * one), one_unit)
        sensitivity = "" if line.sensitivity is None else two_digits(line.sensitivity * factor / one)
        share = f"{100 * line.share:.1f} %"
        rows.append((_source(line), line.kind, *own, sensitivity, two_digits(line.contribution * factor), share))
    if abs(small) >= 5e-4:
        contribution = two_digits(max(small, 0.0) ** 0.5 * budget.u * factor)
        rows.append(("all smaller ones", "", "", "", "", contribution, f"{100 * small:.1f} %"))
    rows.append(("together", "", "", "", "", two_digits(budget.u * factor), "100.0 %"))
    heads = ("source", "type", "its u", "its unit", f"sensitivity ({unit} per its unit)", f"contribution ({unit})", "share")
    return Table.of(f"Budget of {display_name(budget.parameter)}", heads, rows, text=("type", "its unit"))


def _source(line: Contribution) -> str:
    if line.source.startswith("other "):
        return f"other {source_words(line.term)}"
    return source_words(line.term) if line.source == line.term else nuisance_words(line.source)


def _size_of_one(line: Contribution) -> tuple[float, str]:
    """Factor and label that the source's own uncertainty is read in."""
    if line.source == line.term:
        return (1.0, "N") if line.unit == "N" else (1e3, "µm")
    one, label = unit_words(line.source)
    return 1.0 / one, label


_MOST_FORCES = 12
_WORDS = {
    "G_minimum_zone": "G, minimum zone",
    "scale_mismatch": "scale mismatch",
    "G_b": "G(b)",
    "G_b_minimum_zone": "G(b), minimum zone",
}
_HEADS = {
    name: f"{_WORDS.get(name, name.replace('scale_', 'scale '))} ({unit})" for name, unit in (QUANTITIES | BIDIRECTIONAL).items()
}


def path(found: Findings) -> Iterator[Part]:
    """Circular-test quantities, per force and as functions of force."""
    planes = list(dict.fromkeys(found.path["plane"]))
    measured, pairs = found.measured
    squares = [squareness_name(bound_of(found.posterior), plane) for plane in planes]
    yield prose("path", squareness=squares, percent=wording.percent_of(found.result))
    for plane in planes:
        own = found.path[found.path["plane"] == plane]
        where = f", plane {plane}" if len(planes) > 1 else ""
        yield _quantities(own, list(QUANTITIES), f"The machine's path{where} (R = {own['radius_mm'].iloc[0]:g} mm)")
        if own["quantity"].isin(list(BIDIRECTIONAL)).any():
            caption = f"Both directions{where}: bidirectional deviation G(b), mean radial deviation D, hysteresis included"
            yield _quantities(own, list(BIDIRECTIONAL), caption)
    yield _measured(measured)
    if len(pairs):
        forces, sizes = pairs["force_N"].map("{:.4g}".format), pairs[list(BIDIRECTIONAL)].map("{:.2f}".format)
        rows = pd.concat([forces, sizes], axis=1).astype(object).itertuples(name=None)
        yield Table.of("Pairs of readings", ("tests", "force (N)", *(_HEADS[q] for q in BIDIRECTIONAL)), [*rows])
    yield _picture("circularity", found.posterior)
    yield from (_contributions(found, plane) for plane in planes)
    yield _picture("contributions", found.posterior)
    yield _picture("parameter_contributions", found.posterior)


def _quantities(table: pd.DataFrame, quantities: list[str], caption: str) -> Table:
    forces = list(dict.fromkeys(table["force_N"]))
    shown = forces if len(forces) <= _MOST_FORCES else [*forces[:: len(forces) // (_MOST_FORCES - 2)], forces[-1]]
    by_force = {(row["force_N"], row["quantity"]): row for _, row in table.iterrows()}

    def cell(force: float, quantity: str) -> str:
        row = by_force[force, quantity]
        _, decimals = round_uncertainty(row["sd"])
        middle, low, high = (round_like(row[key], decimals) for key in ("median", "ci_low", "ci_high"))
        return f"{middle} [{low}, {high}]"

    rows = [(f"{force:.4g} N", *(cell(force, quantity) for quantity in quantities)) for force in dict.fromkeys(shown)]
    return Table.of(caption, ("force", *(_HEADS[quantity] for quantity in quantities)), rows)


def _measured(table: pd.DataFrame) -> Table:
    places = {column: head for column, head in (("plane", "plane"), ("radius_mm", "R (mm)")) if table[column].nunique() > 1}
    rows = []
    for name, row in table.iterrows():
        where = (f"{row[column]}".removesuffix(".0") for column in places)
        sizes = ("–" if row[quantity] != row[quantity] else f"{row[quantity]:.2f}" for quantity in QUANTITIES)
        rows.append((str(name), *where, f"{row['force_N']:.4g}", row["direction"] or "–", *sizes))
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


def plan(found: Findings) -> Iterator[Part]:
    """Which circles to run instead of these, and what they would tell."""
    chosen = found.design
    if not isinstance(chosen, Design):
        yield f"No tests are recommended: {chosen}"
        return
    yield prose("design", given=found.design_given)
    yield wording.design_sentences(chosen, aliases=False)
    where = "added to it" if chosen.augment else "in its place"
    caption = (
        f"Standard uncertainties, {DEGREES[chosen.degree]} compliance: of this campaign, and expected of the circles recommended "
        f"{where} (averaged over readings not yet taken); no less than: what a million circles would leave"
    )
    yield expected_table(chosen, {name: entry["sd"] for name, entry in found.result["parameters"].items()}, caption)
    if not chosen.sensitivity.empty:
        yield _picture("information", chosen)


def fit(found: Findings) -> Iterator[Part]:
    """RMSE, fitness and posterior predictive checks."""
    quality = found.result["fit"]
    rows = []
    for test in found.seen.tests:
        checks = quality["predictive_checks"][test.name]
        order, least = ranked(checks["orders_p"].items(), lambda pair: -pair[1])[0]
        others = (checks[key] for key in ("noise_p", "autocorrelation", "autocorrelation_p"))
        cells = (None if value is None else f"{value:.2g}" for value in others)
        fitness = f"{quality['fitness_percent'][test.name]:.1f}"
        rows.append((test.name, f"{test.force_N:.4g}", fitness, f"{least:.2g} (order {order})", *cells))
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
    yield prose("fit", quality=quality)
    yield Table.of(caption, heads, rows)
    concerns = wording.concern_sentences(fit_of(found.posterior).concerns, found.result["sampler"])
    if notes := (*concerns, *further_remarks(found.seen)):
        yield notes
    yield _picture("residuals", found.posterior)
    yield _picture("predictive", found.posterior)


def assumptions(found: Findings) -> Iterator[Part]:
    """Every prior with its unit, and the terms."""
    bound, model = bound_of(found.posterior), found.result["model"]
    symbols = list(dict.fromkeys(scale.symbol or scale.name for scale in bound.model.scales))
    yield prose("priors", model=model, parameters=found.result["parameters"], symbols=symbols, flat=found.flat)
    means = any(entry.get("prior_mean") for entry in found.result["parameters"].values())
    rows = []
    for own in bound.parameters:
        factor, unit = display_unit(own.unit)
        sd, decimals = round_uncertainty(own.prior_sd * factor) if np.isfinite(own.prior_sd) else ("flat", 0)
        rows.append((display_name(own.name), *([round_like(own.prior_mean * factor, decimals)] if means else []), sd, unit))
    for name, scale in zip(bound.hyper_prior.names, bound.hyper_prior.scale_mm, strict=True):
        rows.append((str(name), *([""] if means else []), two_digits(float(scale), 1e3), "µm (scale)"))
    heads = ("parameter", *(["prior mean"] if means else []), "prior sd", "unit")
    yield Table.of(f"Prior {'means and ' if means else ''}standard deviations, without truncation", heads, rows, text=("unit",))
    toml: str = record_of(found.posterior)["model"]["toml"]
    yield Details("The whole model as TOML (edit and fit again with --model)", (toml,))


def diagnostics(found: Findings) -> Iterator[Part]:
    """Effective sample sizes and R-hat."""
    sampler, sensitivity = found.result["sampler"], record_of(found.posterior)["fit"]["sensitivity"]
    yield prose("diagnostics", sampler=sampler)
    rows = []
    for name, row in found.summary.iterrows():
        moved = f"{sensitivity[name]['prior']:.3f}" if name in sensitivity else ""
        sizes = (f"{row['ess_bulk']:.0f}", f"{row['ess_tail']:.0f}", f"{row['rhat']:.4f}")
        rows.append((display_name(str(name)), *sizes, moved))
    heads = ("parameter", "ESS bulk", "ESS tail", "R-hat", "sensitivity to the prior (1)")
    yield Table.of("By parameter; above 0.05 a number moves when its prior's scale does (power scaling)", heads, rows)
    if sampler["kind"] != "independent":
        yield _picture("chains", found.posterior)


def method(found: Findings) -> Iterator[Part]:
    """In short, with digests, versions and seed."""
    provenance, tests, model = (found.result[key] for key in ("provenance", "campaign", "model"))
    yield prose("method", nuisances=[name for name in model["terms"] if name not in ("Compliance", "GeometricErrors")])
    yield wording.method_notes()
    rows = (
        ("campaign", tests["name"]),
        ("readings, SHA-256", tests["sha256"]),
        ("model, SHA-256", model["sha256"]),
        ("sampler and seed", f"{found.result['sampler']['kind']}, {provenance['seed']}"),
        ("fitted", f"{provenance['started']}, {provenance['platform']}"),
        ("versions", ", ".join(f"{name} {value}" for name, value in provenance["versions"].items())),
    )
    yield Table.of("Provenance", ("what", "value"), rows, text=("value",))


_BLANKS = (
    "machine, maker and serial number", "date and place of the tests", "bar and balls, certificates", "force device, certificate",
    "temperature, warm-up", "positions of axes not moved", "operator", "checked and signed by, date",
)  # fmt: skip


def sign_off(_: Findings) -> Iterator[Part]:
    """What readings do not hold and a signature needs, to be filled in."""
    yield Table.of("To be filled in", ("what", "entry"), [(blank, "") for blank in _BLANKS], text=("entry",))


def beside(first: Mapping[str, Any], others: Sequence[Beside], *, same_instrument: bool, ci_prob: float) -> Iterator[Part]:
    """Differences of every parameter with intervals and probabilities; ``first`` is the JSON of the fit they are to."""
    name = str(first["campaign"]["name"])
    campaigns = {name: first, **{other.name: other.result for other in others}}
    degrees = {own["model"]["degree"] for own in campaigns.values()}
    yield prose("beside", first=first, degrees=len(degrees), same_instrument=same_instrument)
    yield tuple(wording.change_sentence(name, other.name, other.differences, ci_prob) for other in others)
    rows = []
    for whose, own in campaigns.items():
        tests, compliance = own["campaign"], DEGREES[own["model"]["degree"]]
        span, fitted = f"{min(tests['forces_N']):g} to {max(tests['forces_N']):g}", own["provenance"]["started"][:10]
        converged = "yes" if own["sampler"]["converged"] else "NO"
        rows.append((whose, str(tests["tests"]), span, compliance, fitted, converged, tests["sha256"]))
    heads = ("campaign", "tests", "forces (N)", "compliance", "fitted", "converged", "readings, SHA-256")
    yield Table.of("Campaigns", heads, rows, text=heads[2:])
    yield from (_differences(name, other, f"{100 * ci_prob:g} %") for other in others)
    yield _picture("differences", {other.name: other.differences for other in others}, ci_prob=ci_prob)


def _differences(first: str, other: Beside, percent: str) -> Table:
    rows = []
    for parameter, row in other.differences.iterrows():
        own = state(row["difference"], row["sd"], (row["ci_low"], row["ci_high"]), row["unit"])
        factor, _ = display_unit(row["unit"])
        _, decimals = round_uncertainty(row["sd"] * factor)
        values = [round_like(row[key] * factor, decimals) for key in ("first", "second")]
        probability = wording.probability_words(row["probability_of_increase"])
        rows.append((display_name(str(parameter)), *values, own.value, own.u, own.interval, own.unit, probability))
    heads = ("parameter", "first", "second", "difference", "u", f"{percent} interval", "unit", "P(second > first)")
    return Table.of(f"Second: {other.name}; first: {first}", heads, rows, text=("unit",))


SECTIONS: Mapping[str, tuple[str, Callable[[Findings], Iterator[Part]]]] = {
    "summary": ("Summary", summary),
    "campaign": ("The campaign", campaign),
    "results": ("Results", results),
    "limits": ("What the data cannot separate", limits),
    "degree": ("Constant or linear", degree),
    "uncertainty": ("Uncertainty budget", uncertainty),
    "path": ("Circular-test quantities", path),
    "plan": ("Recommended next tests", plan),
    "fit": ("How well the model fits", fit),
    "assumptions": ("Priors and assumptions", assumptions),
    "diagnostics": ("Diagnostics", diagnostics),
    "method": ("Method, limitations, provenance", method),
    "sign-off": ("Sign-off", sign_off),
}
