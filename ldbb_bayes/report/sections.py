"""All that a report shows of one fit, and its sections, made of that: paragraphs, lists, tables and
figures."""

from __future__ import annotations

import html
import io
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from importlib.resources import files
from typing import TYPE_CHECKING, Any, TypeAlias

import matplotlib as mpl
import pandas as pd
import xarray as xr
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

import ldbb_bayes as lb
from ldbb_bayes.analysis.aliases import degeneracies, standing_degeneracies
from ldbb_bayes.analysis.circularity import BIDIRECTIONAL, QUANTITIES, squareness_name
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.analysis.cures import cures
from ldbb_bayes.analysis.design import Design
from ldbb_bayes.analysis.machine_description import describe
from ldbb_bayes.campaign.preview import preview
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.posterior import bound_of, campaign_of, fit_of, model_of, record_of
from ldbb_bayes.report import figures, text, wording
from ldbb_bayes.report.text import Passage, parts_of, two_digits
from ldbb_bayes.report.wording import DEGREES
from ldbb_bayes.results import Table
from ldbb_bayes.units import (
    display_name,
    display_unit,
    ranked,
    round_like,
    round_uncertainty,
    state,
)

if TYPE_CHECKING:
    from ldbb_bayes.analysis.conformity import Conformity

__all__ = [
    "PICTURES",
    "SECTIONS",
    "Beside",
    "Compared",
    "Details",
    "Findings",
    "Part",
    "Picture",
    "Recommended",
    "Section",
    "beside",
    "find",
    "picture",
]

_REFERENCE = re.compile(r'(\bid="|xlink:href="#|url\(#)')
_PROLOGUE = re.compile(r"^.*?(?=<svg)|<metadata>.*?</metadata>\s*", re.DOTALL)
_COORDINATES = re.compile(r' (?:d|x|y|points)="[^"]*"')
_DIGITS = re.compile(r"(\.\d\d)\d+")


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure with the name of its file, and its caption: what it is for those who cannot see
    it."""

    key: str
    caption: str
    figure: Figure

    @cached_property
    def svg(self) -> str:
        """The figure as SVG to stand in a page: responsive, with an accessible name, its ids kept
        apart from other figures'."""
        drawn = io.StringIO()
        every: list[Any] = [self.figure, *self.figure.axes]
        grounds = [own.patch for own in every if own.patch.get_visible()]
        with mpl.rc_context({"svg.hashsalt": "ldbb", "svg.fonttype": "none"}):
            for ground in grounds:
                ground.set_visible(False)
            canvas: Any = FigureCanvasSVG(self.figure)
            canvas.print_svg(drawn, metadata={"Date": None})  # savefig draws a figure twice
        for ground in grounds:
            ground.set_visible(True)
        text = _REFERENCE.sub(rf"\g<1>{self.key}-", _PROLOGUE.sub("", drawn.getvalue()))
        # A hundredth of a point is finer than any screen or printer.
        text = _COORDINATES.sub(lambda match: _DIGITS.sub(r"\1", match[0]), text)
        title = f'<title id="title-{self.key}">{html.escape(self.caption)}</title>'
        start, _, rest = text.partition(">")
        return (
            '<svg role="img"'
            f' aria-labelledby="title-{self.key}"{start.removeprefix("<svg")}>{title}{rest}'
        )


@dataclass(frozen=True)
class Details:
    """Parts that open on demand on a screen, and are printed."""

    summary: str
    parts: tuple[Passage, ...]


Part: TypeAlias = Passage | Picture | Details
"""A paragraph (code where it has several lines), a list, a table, or what its name says."""


@dataclass(frozen=True)
class Section:
    """A heading and what stands under it."""

    key: str
    title: str
    parts: tuple[Part, ...]


# ---- what they are of

Compared: TypeAlias = "Comparison | str"
Recommended: TypeAlias = "Design | str"


@dataclass(frozen=True, eq=False)
class Findings:
    """All that a report shows of one posterior; what the fit did not keep is worked out when it is
    first asked for. Where a comparison or design is missing stands why."""

    posterior: xr.DataTree
    ci_prob: float
    comparison: Compared
    recommended: Callable[[], Recommended]
    averaged: xr.DataTree | None = None
    tolerances: Mapping[str, Any] | None = None

    @property
    def numbers(self) -> xr.DataTree:
        """What the sheets state: averaged over the models where that was worked out."""
        return self.posterior if self.averaged is None else self.averaged

    @cached_property
    def probabilities(self) -> Mapping[str, float]:
        """Of the models that were averaged over, and of the rivals of slopes; none where nothing
        was."""
        found: dict[str, float] = record_of(self.numbers).get("averaged", {}).get("probability", {})
        return found

    @property
    def varying(self) -> float:
        """Probability that compliance changes with force; one where that is what was fitted."""
        return 1.0 - self.probabilities.get(DEGREES[0], 0.0)

    # The tests to run next; the JSON of the fit; of the draws; the campaign without a model; what
    # the readings tell of every parameter, and the budget of each; circular-test quantities of the
    # machine.
    design = cached_property(lambda self: self.recommended())
    result = cached_property(lambda self: text.full_result(self.posterior, self.ci_prob))
    summary = cached_property(lambda self: lb.summarize(self.posterior, ci_prob=self.ci_prob))
    seen = cached_property(lambda self: preview(campaign_of(self.posterior)))
    verdicts = cached_property(lambda self: lb.verdicts(self.posterior))
    budgets = cached_property(lambda self: lb.budgets(self.posterior))
    path = cached_property(lambda self: lb.circularity(self.posterior, ci_prob=self.ci_prob))

    def conformity(self, force_N: float | None = None) -> Mapping[str, Conformity]:
        """With the tolerances given or else those of the campaign."""
        return lb.conformity(self.numbers, self.tolerances or None, force_N=force_N)

    @property
    def flat(self) -> bool:
        """Whether the parameters have flat priors."""
        return all(entry["prior_sd"] is None for entry in self.result["parameters"].values())


def find(
    posterior: xr.DataTree,
    *,
    ci_prob: float = 0.95,
    tests: int | None = None,
    comparison: Compared | None = None,
    recommended: Recommended | Callable[[], Recommended] | None = None,
    averaged: xr.DataTree | None = None,
    tolerances: Mapping[str, Any] | None = None,
) -> Findings:
    """Return what a report shows of a fit, after a look whether what is brought is of the same
    readings; as `write_report`."""
    digest = campaign_of(posterior).sha256
    for what, own in (
        ("comparison", getattr(comparison, "campaign", None)),
        ("design", getattr(recommended, "pilot", None)),
    ):
        if own is not None and own.sha256 != digest:
            got = f"got one of {own.name!r} (SHA-256 {own.sha256[:12]}… instead of {digest[:12]}…)"
            raise InputError(
                f"{what} must be of the readings of the fit, {got}. Make the {what} again."
            )
    planned = partial(_next_tests, posterior, tests) if recommended is None else recommended
    return Findings(
        posterior,
        ci_prob,
        _compared(posterior) if comparison is None else comparison,
        planned if callable(planned) else lambda: planned,
        averaged,
        tolerances,
    )


def _next_tests(posterior: xr.DataTree, tests: int | None) -> Recommended:
    model = model_of(posterior)
    try:
        return lb.design(
            model.with_degree(max(model.degree, 1)), pilot=campaign_of(posterior), tests=tests
        )
    except InputError as error:
        if tests is not None:
            raise
        return str(error)


def _compared(posterior: xr.DataTree) -> Compared:
    """Constant against linear compliance (and quadratic where that was fitted) by evidence alone,
    or why not."""
    model = model_of(posterior)
    largest = model.with_degree(max(model.degree, 1))
    models = {DEGREES[k]: largest.with_degree(k) for k in range(largest.degree + 1)}
    try:
        return lb.compare(models, campaign_of(posterior), evidence_only=True)
    except InputError as error:
        return str(error)


# ---- sections, in the order of the page


@dataclass(frozen=True, eq=False)
class Beside:
    """Another campaign beside the first: its name, the JSON of its fit, and its `differences` to
    the first."""

    name: str
    result: Mapping[str, Any]
    differences: pd.DataFrame


# Of every figure of the page what draws it, and its caption.
PICTURES: Mapping[str, tuple[Callable[..., Figure], str]] = {
    key: (getattr(figures, {"budget": "budget_bars"}.get(key, key)), words)
    for key, words in wording.PAGE["pictures"].items()
}


def picture(key: str, subject: Any, caption: str = "", **options: Any) -> Picture:
    """Return a figure of the page, drawn."""
    draw, words = PICTURES[key]
    return Picture(key, caption or words, draw(subject, **options))


def campaign(found: Findings) -> Iterator[Part]:
    """Tests, assumptions and remarks."""
    yield from parts_of(found.seen)


def results(found: Findings) -> Iterator[Part]:
    """Parameters, and what the fit says of other effects."""
    yield wording.model_words(found.result["model"])
    yield wording.PAGE["results"].format(percent=wording.percent_of(found.result))
    yield text.results_table(found.result, found.verdicts, shares=False)
    yield picture("forest", found.posterior)
    yield Details(
        "What the fit says of other effects", (text.nuisance_table(found.result["nuisances"]),)
    )
    tests = campaign_of(found.posterior)
    described = parts_of(describe(tests.machine(), [test.circle for test in tests.tests]))
    yield Details("What the parameters are", described)


def limits(found: Findings) -> Iterator[Part]:
    """Degeneracies with their cures; verdicts stand with the results."""
    bound = bound_of(found.posterior)
    alike = degeneracies(bound)
    items = wording.degeneracy_items(alike, cures(bound, alike))
    yield wording.ALIKE if items else wording.NONE_ALIKE
    yield (*items, *map(wording.standing_words, standing_degeneracies(bound, alike)))


def degree(found: Findings) -> Iterator[Part]:
    """Evidence, what it hangs on, and where they were asked for slopes one by one and tests left
    out."""
    compared = found.comparison
    if not isinstance(compared, Comparison):
        yield f"The models were not compared: {compared}"
        return
    yield from text.comparison_parts(
        compared, rmse=False
    )  # that of the fit, of other draws, stands with the fit
    yield picture("evidence", compared)
    if not compared.local_fits.empty:
        yield picture("compliance_with_local_fits", compared)


def uncertainty(found: Findings) -> Iterator[Part]:
    """What each uncertainty is made of, and what would improve it most."""
    yield wording.PAGE["budget"]
    yield from parts_of(found.budgets)
    yield picture("budget", found.budgets)
    for name, budget in found.budgets.items():
        factor, unit = display_unit(budget.unit)
        yield Details(
            f"{display_name(name)}: u = {two_digits(budget.u, factor)} {unit}", parts_of(budget)
        )


_MOST_FORCES = 12
_WORDS = {"scale_mismatch": "scale mismatch", "G_b": "G(b)"}


def path(found: Findings) -> Iterator[Part]:
    """Circular-test quantities, per force and as functions of force."""
    planes = list(dict.fromkeys(found.path["plane"]))
    squares = wording.joined(
        [display_name(squareness_name(bound_of(found.posterior), plane)) for plane in planes]
    )
    yield wording.PAGE["path"].format(squareness=squares, percent=wording.percent_of(found.result))
    for plane in planes:
        own = found.path[found.path["plane"] == plane]
        where = f", plane {plane}" if len(planes) > 1 else ""
        yield _quantities(
            own, QUANTITIES, f"The machine's path{where} (R = {own['radius_mm'].iloc[0]:g} mm)"
        )
        if own["quantity"].isin(list(BIDIRECTIONAL)).any():
            caption = (
                f"Both directions{where}: bidirectional deviation G(b), mean radial deviation D,"
                " hysteresis included"
            )
            yield _quantities(own, BIDIRECTIONAL, caption)
    for key in ("circularity", "contributions", "parameter_contributions"):
        yield picture(key, found.posterior)


def _quantities(table: pd.DataFrame, quantities: Mapping[str, str], caption: str) -> Table:
    forces = list(dict.fromkeys(table["force_N"]))
    shown = (
        forces
        if len(forces) <= _MOST_FORCES
        else [*forces[:: len(forces) // (_MOST_FORCES - 2)], forces[-1]]
    )
    by_force = {(row["force_N"], row["quantity"]): row for _, row in table.iterrows()}

    def cell(force: float, quantity: str) -> str:
        row = by_force[force, quantity]
        _, decimals = round_uncertainty(row["sd"])
        middle, low, high = (
            round_like(row[key], decimals) for key in ("median", "ci_low", "ci_high")
        )
        return f"{middle} [{low}, {high}]"

    rows = [
        (f"{force:.4g} N", *(cell(force, quantity) for quantity in quantities))
        for force in dict.fromkeys(shown)
    ]
    return Table.of(
        caption,
        ("force", *(f"{_WORDS.get(name, name)} ({unit})" for name, unit in quantities.items())),
        rows,
    )


def plan(found: Findings) -> Iterator[Part]:
    """Which circles to run instead of these, and what they would tell."""
    chosen = found.design
    if not isinstance(chosen, Design):
        yield f"No tests are recommended: {chosen}"
        return
    yield from parts_of(chosen)
    today = {name: entry["sd"] for name, entry in found.result["parameters"].items()}
    yield picture("expected_widths", chosen, today=today)


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
        rows.append(
            (test.name, f"{test.force_N:.4g}", fitness, f"{least:.2g} (order {order})", *cells)
        )
    checked = ("smallest p by order", "p, white noise", "autocorrelation (1)", "p, autocorrelation")
    caption = (
        "Fitness (Eq. 35) and posterior predictive checks: small p where the model does not expect"
        " the reading"
    )
    yield wording.quality_words(quality)
    yield Table.of(caption, ("test", "force (N)", "fitness (%)", *checked), rows)
    concerns = wording.concern_sentences(fit_of(found.posterior).concerns, found.result["sampler"])
    if notes := (*concerns, *text.further_remarks(found.seen)):
        yield notes
    yield picture("residuals", found.posterior)


def assumptions(found: Findings) -> Iterator[Part]:
    """Every prior with its unit beside the posterior, scales included, and the model as a file."""
    yield text.parameter_table(found.result)
    yield Details(
        "The whole model as TOML (edit and fit again with --model)",
        (record_of(found.posterior)["model"]["toml"],),
    )


def diagnostics(found: Findings) -> Iterator[Part]:
    """Effective sample sizes and R-hat."""
    sampler = found.result["sampler"]
    sensitivity = record_of(found.posterior)["fit"]["sensitivity"]
    yield wording.sampler_words(sampler)
    rows = []
    for name, row in found.summary.iterrows():
        moved = f"{sensitivity[name]['prior']:.3f}" if name in sensitivity else ""
        sizes = (f"{row['ess_bulk']:.0f}", f"{row['ess_tail']:.0f}", f"{row['rhat']:.4f}")
        rows.append((display_name(str(name)), *sizes, moved))
    heads = ("parameter", "ESS bulk", "ESS tail", "R-hat", "sensitivity to the prior (1)")
    yield Table.of(
        "By parameter; above 0.05 a number moves when its prior's scale does (power scaling)",
        heads,
        rows,
    )


def method(found: Findings) -> Iterator[Part]:
    """In short, with digests, versions and seed."""
    provenance, tests, model = (found.result[key] for key in ("provenance", "campaign", "model"))
    yield tuple(wording.PAGE["notes"])
    rows = (
        ("campaign", tests["name"]),
        ("readings, SHA-256", tests["sha256"]),
        ("model, SHA-256", model["sha256"]),
        ("sampler and seed", f"{found.result['sampler']['kind']}, {provenance['seed']}"),
        ("fitted", f"{provenance['started']}, {provenance['platform']}"),
        (
            "versions",
            ", ".join(f"{name} {value}" for name, value in provenance["versions"].items()),
        ),
    )
    yield Table.of("Provenance", ("what", "value"), rows, text=("value",))


def glossary(_: Findings) -> Iterator[Part]:
    """Every term of art in a line."""
    lines = tomllib.loads(
        (files("ldbb_bayes.report") / "templates" / "glossary.toml").read_text(encoding="utf-8")
    )
    yield Table.of("Terms", ("term", "meaning"), list(lines.items()), text=("meaning",))


def beside(
    first: Mapping[str, Any], others: Sequence[Beside], *, same_instrument: bool, ci_prob: float
) -> Iterator[Part]:
    """Differences of every parameter with intervals and probabilities; ``first`` is the JSON of the
    fit they are to."""
    name = str(first["campaign"]["name"])
    yield wording.instrument_words(first["model"]["reference_force_N"], same_instrument)
    yield tuple(
        wording.change_sentence(name, other.name, other.differences, ci_prob) for other in others
    )
    yield from (_differences(name, other, f"{100 * ci_prob:g} %") for other in others)


def _differences(first: str, other: Beside, percent: str) -> Table:
    rows = []
    for parameter, row in other.differences.iterrows():
        own = state(row["difference"], row["sd"], (row["ci_low"], row["ci_high"]), row["unit"])
        factor, _ = display_unit(row["unit"])
        _, decimals = round_uncertainty(row["sd"] * factor)
        values = [round_like(row[key] * factor, decimals) for key in ("first", "second")]
        probability = wording.probability_words(row["probability_of_increase"])
        rows.append(
            (
                display_name(str(parameter)),
                *values,
                own.value,
                own.u,
                own.interval,
                own.unit,
                probability,
            )
        )
    heads = (
        "parameter",
        "first",
        "second",
        "difference",
        "u",
        f"{percent} interval",
        "unit",
        "P(second > first)",
    )
    tests = other.result["campaign"]
    caption = f"Second: {other.name} (readings, SHA-256 {tests['sha256']}); first: {first}"
    return Table.of(caption, heads, rows, text=("unit",))


_WRITTEN = (
    campaign,
    results,
    limits,
    degree,
    uncertainty,
    path,
    plan,
    fit,
    assumptions,
    diagnostics,
    method,
    glossary,
)
SECTIONS: Mapping[str, tuple[str, Callable[[Findings], Iterator[Part]]]] = {
    write.__name__: (wording.PAGE["sections"][write.__name__], write) for write in _WRITTEN
}
