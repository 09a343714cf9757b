"""Every sentence about findings: small functions that choose among templates (sentences.toml,
sentences.j2) and fill them.

Nothing decides by reading a sentence: what is decided stands in the findings. Kinds of findings are
looked up by their values.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, singledispatch
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2

from ldbb_bayes.analysis.aliases import Degeneracy, Standing
from ldbb_bayes.analysis.budgets import Budget
from ldbb_bayes.analysis.calibration import Validation
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.analysis.cures import Cure
from ldbb_bayes.analysis.design import Design
from ldbb_bayes.analysis.machine_description import VisibleParameter
from ldbb_bayes.analysis.verdicts import Identifiability, ParameterIdentifiability
from ldbb_bayes.campaign.preview import CampaignPreview, Remark
from ldbb_bayes.inference.checks import Check
from ldbb_bayes.inference.fit import Concern, Fit
from ldbb_bayes.model.terms import OWN, Term, Uncertainty
from ldbb_bayes.units import (
    display_name,
    display_unit,
    plus_minus,
    ranked,
    round_uncertainty,
    typeset,
)

if TYPE_CHECKING:
    import pandas as pd

_SENTENCES: Mapping[str, Any] = tomllib.loads(
    (Path(__file__).parent / "templates" / "sentences.toml").read_text("utf-8")
)
PAGE: Mapping[str, Any] = _SENTENCES["page"]
DEGREES = ("constant", "linear", "quadratic")
IN_FORCE = ("constant", "linear in force", "quadratic in force")
# Ratios of expected sds that differ by less count as equal.
_ALIKE = 2e-3


@cache
def _environment() -> jinja2.Environment:
    """What templates of sentences call: filters and names."""
    loader = jinja2.PackageLoader("ldbb_bayes.report")
    environment = jinja2.Environment(loader=loader, undefined=jinja2.StrictUndefined)
    filters = (
        joined,
        display_name,
        typeset,
        term_words,
        nuisance_words,
        check_words,
        remark_words,
        caveat_words,
        repr,
    )
    environment.filters |= {
        own.__name__: own for own in (*filters, look_sentences, probability_words, strength_words)
    }
    environment.filters |= {
        "as_": format,
        "lines": _lines,
        "point": lambda at: f"({', '.join(f'{x:g}' for x in at)})",
    }
    names: dict[str, Any] = {
        "IN_FORCE": IN_FORCE,
        "DEGREES": DEGREES,
        "FEW": _FEW,
        "BARE": _STRENGTHS[0][0],
        "SIGNS": _SENTENCES["signs"],
    }
    names |= {
        "PAGE": PAGE,
        "SURE": _SURE,
        "JOINED": _JOINED,
        "CONFLICT": _CONFLICT,
        "plus_minus": plus_minus,
    }
    environment.globals |= names
    return environment


def _lines(text: str) -> list[str]:
    return [line.strip() for line in text.split("\n") if line.strip()]


def _sentences(macro: str, *found: Any) -> tuple[str, ...]:
    """Every line that a macro of sentences.j2 makes of findings."""
    return tuple(_lines(getattr(_environment().get_template("sentences.j2").module, macro)(*found)))


def _sentence(macro: str, *found: Any) -> str:
    """The one line that a macro makes."""
    return " ".join(_sentences(macro, *found))


def _every(macro: str) -> Callable[..., tuple[str, ...]]:
    return lambda *found: _sentences(macro, *found)


def _words(macro: str) -> Callable[..., str]:
    return lambda *found: _sentence(macro, *found)


# Of a fit whether its numbers can be used, whether the model expects readings like these, and a
# note on what it does not expect though it hardly moves an interval; of parts of its JSON what was
# fitted, how well, and whether the sampler reached its target; of a validation whether its ranks
# are as they should be.
fit_verdict = _words("fit_verdict")
expectation = _words("expectation")
check_notes = _every("check_notes")
model_words = _words("model_words")
quality_words = _words("quality_words")
sampler_words = _words("sampler_words")
validation_verdict = _words("validation_verdict")
# What a campaign is, and remarks on its tests (what a fit will assume is apart); of a machine
# joints, rank, and what does not show; of a comparison the evidence, whether its sign is robust,
# and what else speaks; what is to be minded of a population, and what it does not model; what
# forbids the use of a difference of campaigns (first, other, converged, conflict).
preview_sentences = _every("preview_sentences")
machine_sentences = _every("machine_sentences")
comparison_sentences = _every("comparison_sentences")
population_doubts = _every("population_doubts")
# Which model the numbers after the sheets are of (degree, averaged); what differences between
# campaigns rest on (force, same).
annex_words = _words("annex_words")
instrument_words = _words("instrument_words")
difference_doubts = _every("difference_doubts")


@singledispatch
def with_words(result: Any) -> dict[str, Any]:
    """Return a result's JSON, its sentences added."""
    record: dict[str, Any] = result.as_dict()
    return record


def joined(parts: Sequence[str], word: str = "and") -> str:
    """a, b and c."""
    return (
        f" {word} ".join(parts) if len(parts) < 3 else f"{', '.join(parts[:-1])} {word} {parts[-1]}"
    )


def _few(names: Sequence[str]) -> str:
    """The first names, and how many there are beyond."""
    more = len(names) - _LISTED
    return ", ".join(names[:_LISTED]) + (f" and {more} more" if more > 0 else "")


def _shown(names: Sequence[str]) -> str:
    """Parameters as the paper prints them."""
    return joined([display_name(name) for name in names])


# ---- terms and aliases


def unit_words(name: str) -> tuple[float, str]:
    """Inside value of one unit that a nuisance coefficient is read in, and its label."""
    inside, one, label = Term.owner(name).unit_of(name)
    return (
        (1.0 / display_unit(inside)[0], display_unit(inside)[1])
        if inside.endswith("/N")
        else (one, label)
    )


def nuisance_words(name: str) -> str:
    """form_cos2 → 2-lobe form (cos 2θ)."""
    return Term.owner(name).describe(name)


def term_words(term: str) -> str:
    """BallForm → ball form, SetupShift → set-up shift; a parameter's name stays."""
    spaced = re.sub(r"(?<!^)(?=[A-Z])", " ", term).lower()
    return (
        Term.kinds[term].words
        if term in Term.kinds
        else display_name(term)
        if "_" in term
        else spaced
    )


def source_words(term: str) -> str:
    """Return what a term of a budget is called."""
    return "prior of the parameters" if term == OWN else term_words(term)


def _amount(value: float, factor: float, label: str, name: str, plus: str = "+") -> str:
    """+6.67 µm/m of E_XX1."""
    size = abs(value) * factor
    if size < 0.01 and label.startswith("µ"):
        size = size * 1e3
        label = "n" + label[1:]
    return (
        f"{plus if value > 0 else '−'}{round_uncertainty(size, 3)[0]}{'' if label == '°' else ' '}{label}"
        f" of {name}"
    )


def statement(found: Degeneracy) -> str:
    """Return a degeneracy with its exchange rate: what looks like what, and how much of it."""
    sign = -1.0 if found.term else 1.0
    changes = [
        _amount(
            sign * found.combination[name], *display_unit(found.units[name]), display_name(name)
        )
        for name in found.parameters
    ]
    left_out = (
        "" if found.modelled else "; the model leaves it out, and the intervals do not cover it"
    )
    nuisances = [(name, *unit_words(name)) for name in found.nuisances]
    parts = [
        _amount(found.combination[name], 1.0 / one, unit, nuisance_words(name), "")
        for name, one, unit in nuisances
    ]
    subject = " with ".join([*parts[:1], *([joined(parts[1:])] if parts[1:] else [])])
    if len(parts) > 4:
        subject = f"{parts[0]} together with {len(parts) - 1} other effects"
    if not found.term:
        company = [f"{len(parts)} other effects"] if parts else []
        return f"{joined([*changes, *company])} together change no reading{left_out}."
    return f"{subject} looks exactly like {joined(changes)}{left_out}."


def cure_words(found: Degeneracy, cures: Sequence[Cure]) -> str:
    """Return what would end a degeneracy."""
    calibration = (
        Term.kinds[found.term].calibration if found.term in Term.kinds else "a calibration of it"
    )
    text = (
        joined([_SENTENCES["cures"].get(cure, calibration) for cure in cures], "or")
        or "a narrower prior on one of them"
    )
    return text[0].upper() + text[1:] + "."


def degeneracy_items(
    found: Sequence[Degeneracy], cures: Sequence[Sequence[Cure]]
) -> tuple[str, ...]:
    """Return every degeneracy with what would separate it."""
    pairs = zip(found, cures, strict=True)
    return tuple(f"{statement(own)} Cure: {cure_words(own, cure)}" for own, cure in pairs)


def alias_sentences(found: Sequence[Degeneracy]) -> Iterator[str]:
    """Return what the terms of the model are confounded with, the terms that it leaves out, and
    parameters that are alike.
    """
    alike: dict[bool, dict[str, dict[str, None]]] = {False: {}, True: {}}
    for own in found:
        if own.term:
            alike[own.modelled].setdefault(own.term, {}).update(dict.fromkeys(own.parameters))
        else:
            yield f"These readings cannot separate {_shown(own.parameters)}."
    covers = (
        "The model leaves these out: no interval covers them",
        "The intervals rest on what was assumed of these",
    )
    for modelled, terms in alike.items():
        if terms:
            pairs = "; ".join(
                f"{term_words(term)} with {_shown([*names])}" for term, names in terms.items()
            )
            yield f"Confounded: {pairs}. {covers[modelled]} (more: ldbb-bayes identify)."


def standing_words(found: Standing) -> str:
    """Return what holds whatever is measured."""
    return _SENTENCES["standing"][found.kind].format(names=_shown(found.parameters))


# ---- fit

_FEW = 3
_CONTRADICTED = -13.815510557964274  # ln 1e-6


def check_words(check: Check) -> str:
    """Return what a check looks at: order 4 of f520."""
    kinds = {"noise": "white noise", "autocorrelation": "autocorrelation"}
    return f"{kinds.get(check.kind, f'order {check.order}')} of {check.test}"


def concern_sentences(concerns: tuple[Concern, ...], sampler: Mapping[str, Any]) -> Iterator[str]:
    """Return a sentence or two on every concern; ``sampler`` is that part of the record."""
    cures = {"independent": "ask for more independent draws (a larger --ess)"}
    for own in concerns:
        template = _SENTENCES["concerns"][
            "one-force" if own.kind == "forces" and own.value == 1 else own.kind
        ]
        said = template.format(
            value=own.value,
            limit=own.limit,
            um=own.value * 1e3,
            limit_um=own.limit * 1e3,
            degree=own.limit - 2,
            verb="contradict" if own.value < _CONTRADICTED else "speak against",
            rhat=sampler.get("target_rhat", 0.0),
            cure=cures.get(sampler.get("kind", ""), "allow more steps (--max-steps)"),
            name=display_name(own.name),
        )
        yield typeset(said)


# ---- campaign


def assumption_words(assumed: Any) -> str:
    """Return what an import assumed, why, and the option that says otherwise."""
    where = f"; {assumed.place}" if assumed.place else ""
    return f"{assumed.what}: {assumed.value} ({assumed.because}{where}): {assumed.option}"


def remark_words(remark: Remark) -> str:
    """Return a remark of a preview in words."""
    if (words := _SENTENCES["remarks"].get(remark.kind)) is not None:
        return str(words.format(**remark.values))
    return _environment().from_string(_SENTENCES["choices"][remark.kind]).render(remark.values)


def look_sentences(seen: CampaignPreview) -> list[str]:
    """Return a sentence on everything that looks odd, with the tests it is of."""
    odd: dict[str, list[str]] = {}
    for test in seen.tests:
        for remark in test.remarks:
            odd.setdefault(remark_words(remark), []).append(test.name)
    return [f"Look at {_few(names)}: {words}." for words, names in odd.items()]


@with_words.register
def _(result: CampaignPreview) -> dict[str, Any]:
    record = {"schema": 1, **result.as_dict()}
    pairs: list[tuple[dict[str, Any], Any]] = [
        (record, result),
        *zip(record["tests"], result.tests, strict=True),
    ]
    for own, found in pairs:
        own["kinds"] = [str(remark.kind) for remark in found.remarks]
        own["remarks"] = [remark_words(remark) for remark in found.remarks]
    record["assumptions"] = [remark_words(remark) for remark in result.assumptions]
    return record


def assumed_words(own: Uncertainty) -> tuple[str, str]:
    """Return what is assumed of the instrument, and where a certificate says it."""
    (table, _, key), kind = own.certificate.partition("_"), Term.owner(own.name)
    where = (
        f"[{table}] {key}"
        if key
        else f"[balls.{table}]"
        if table
        else f"none: [terms.{kind.__name__}] of a model"
    )
    return nuisance_words(own.name.replace("form_", "form_cos")).partition(" (")[0], where


def sum_in_words(seen: VisibleParameter) -> str:
    """C_XXX + C_XXY; weights where they are not one, in mm and mm²."""
    text = ""
    for name, weight in seen.members.items():
        size = "" if abs(weight) == 1.0 else f"{abs(weight):g} "
        sign = ("−" if weight < 0 else "") if not text else (" − " if weight < 0 else " + ")
        text += f"{sign}{size}{display_name(name)}"
    return text


# ---- identifiability

ALIKE = "The readings of this campaign cannot separate:"
NONE_ALIKE = "The readings determine every combination."


def joined_sizes(hyper_um: Mapping[str, float], equals: str) -> str:
    """Return hyper-parameters with their values, the circles' scales left out."""
    sizes = {
        name: f"{value:.2g}{'' if name == 'decay' else ' µm'}" for name, value in hyper_um.items()
    }
    return ", ".join(
        f"{name}{equals}{size}" for name, size in sizes.items() if not name.startswith("lambda_")
    )


def verdict_words(entry: ParameterIdentifiability, *, shares: bool = True) -> str:
    """Return the verdict, with the share of the variance that every partner holds or with the
    partners' names alone.
    """
    known = entry.partner_shares
    if not shares and entry.verdict == "confounded":
        return (
            "confounded with"
            f" {joined([term_words(p) + ('' if p in known else ' (left out)') for p in entry.partners])}"
        )
    if not shares:
        return str(entry.verdict)
    parts = {
        term_words(p): f"{100.0 * known[p]:.0f} %" if p in known else "left out"
        for p in entry.partners
    }
    if entry.verdict == "confounded":
        return "confounded with " + " and ".join(
            f"{partner} ({share})" for partner, share in parts.items()
        )
    plain = ", ".join(f"{partner} {share}" for partner, share in parts.items())
    return f"{entry.verdict} ({plain})" if plain else str(entry.verdict)


@with_words.register
def _(result: Identifiability) -> dict[str, Any]:
    record = result.as_dict()
    record.pop("cures")
    for own, found, cure in zip(
        record["degeneracies"], result.degeneracies, result.cures, strict=True
    ):
        own |= {"statement": statement(found), "cure": cure_words(found, cure)}
    return record | {"notes": [standing_words(own) for own in result.standing]}


def identifiability_sentences(result: Identifiability) -> tuple[str, ...]:
    """Return what the numbers rest on, and how much the readings narrow; what certificates would be
    worth: how much narrower the parameters that they narrow by a tenth.
    """
    certificates = dict(result.certificates)
    worth = {}
    without = certificates.pop("none of these", {})
    for name, left in certificates.items():
        share = {own: sd / without[own] for own, sd in left.items()}
        narrowed = [own for own in ranked(share, share.__getitem__) if share[own] < 0.9]
        worth[name] = [
            f"u of {display_name(own)} to {100.0 * share[own]:.0f} %" for own in narrowed
        ]
    return _sentences(
        "identifiability_sentences", result, joined_sizes(result.hyper_um, " = "), worth
    )


# ---- calibration


@with_words.register
def _(result: Validation) -> dict[str, Any]:
    return {**result.as_dict(), "verdict": validation_verdict(result)}


# ---- comparison

_STRENGTHS = (
    (1.0, "not worth more than a bare mention"),
    (3.0, "positive evidence"),
    (5.0, "strong evidence"),
)
_SURE = 0.95


def strength_words(log_bayes_factor: float) -> str:
    """Words for a log Bayes factor of either sign (Kass and Raftery, J. Am. Stat. Assoc. 90,
    773-795, 1995).
    """
    return next(
        (words for limit, words in _STRENGTHS if abs(log_bayes_factor) < limit),
        "very strong evidence",
    )


@with_words.register
def _(result: Comparison) -> dict[str, Any]:
    sentences = comparison_sentences(result)
    found = {name: value for name, value in result.as_dict().items() if value is not None}
    return {**found, "verdict": " ".join(sentences), "sentences": list(sentences)}


# ---- design


def design_sentences(design: Design) -> tuple[str, ...]:
    """Return the recommendation in words, its notes last."""
    ratio = {
        name: design.expected[name].sd / design.baseline[name].sd for name in design.parameters
    }
    first, last = (
        ranked(ratio, key, tolerance=_ALIKE)[0]
        for key in (lambda name: -ratio[name], ratio.__getitem__)
    )
    return _sentences(
        "design_sentences", design, _tests_to_run(design), ratio, first, last, design_notes(design)
    )


def design_notes(design: Design) -> tuple[str, ...]:
    """Return what the tests do not show, what would, and what the numbers rest on."""
    error = max(own.sd_error / own.sd for own in design.expected.values())
    alike = degeneracy_items(design.limits.degeneracies, design.limits.cures)
    return _sentences("design_notes", design, joined_sizes(design.hyper_um, " "), error, alike)


@with_words.register
def _(result: Design) -> dict[str, Any]:
    return {
        **result.as_dict(),
        "notes": list(design_notes(result)),
        "sentences": list(design_sentences(result)),
    }


def _tests_to_run(design: Design) -> str:
    """6 circles: 2 × 36 N and 4 × 742 N."""
    table = design.table
    columns = list(design.columns)
    clocked = bool((table[columns[:2]] != 0.0).any(axis=None))
    named = [
        name for name in columns if (clocked if name in columns[:2] else table[name].nunique() > 1)
    ]
    words = []
    for row in table.to_dict(orient="records"):
        places = [
            form.format(row[name])
            for name, form in _SENTENCES["places"].items()
            if name in named and row[name] != ""
        ]
        words.append(
            f"{row['count']} × {row['force_N']:.4g} N"
            + (f" ({', '.join(places)})" if named else "")
        )
    listed = joined(words) if len(words) <= 12 else "see the table"
    return f"{table['count'].sum()}{' more' if design.augment else ''} circles: {listed}"


# ---- budget


def remedy_words(budget: Budget) -> str:
    """Return what would improve a parameter most."""
    return _SENTENCES["remedies"].get(budget.heaviest, Term.kinds.get(budget.heaviest, Term).remedy)


@with_words.register
def _(result: Budget) -> dict[str, Any]:
    return {**result.as_dict(), "improve": remedy_words(result)}


# ---- population and trend

_LISTED = 5
_JOINED = 3
# Three decimals show no less, and never quite 0 or 1.
_UNLIKELY = 5e-4


def caveat_words(caveat: Any) -> str:
    """Return a sentence or two on what is to be minded of a trend or a population."""
    parameters = ", ".join(map(display_name, caveat.names))
    return _SENTENCES["caveats"][caveat.kind].format(
        *caveat.values, names=_few(caveat.names), parameters=parameters, text=caveat.text
    )


def probability_words(probability: float) -> str:
    """Return a probability with three decimals."""
    if probability < _UNLIKELY:
        return "< 0.001"
    return "> 0.999" if probability > 1.0 - _UNLIKELY else f"{probability:.3f}"


def limit_words(lower: float | None, upper: float | None, factor: float = 1.0) -> str:
    """Return limits as they are written: ≤ 60, ≥ 18, ± 20, −20 to 40."""
    low, high = (
        "" if own is None else f"{own * factor:.4g}".replace("-", "−") for own in (lower, upper)
    )
    if low == f"−{high}":
        return f"± {high}"
    return f"{low} to {high}" if low and high else f"≥ {low}" if low else f"≤ {high}"


def trend_sentences(trend: Any) -> tuple[str, ...]:
    """Return what a trend says, the most important first; its caveats are apart."""
    own = trend.parameters[trend.most_probable]
    rows = trend.estimates
    when = (
        rows.loc[rows["parameter"] == trend.most_probable, "change_here"].iloc[own.place]
        if trend.changed
        else 0.0
    )
    by_campaign = rows[rows["outside"]].groupby("campaign", sort=False)["parameter"]
    outside = [f"{name} ({', '.join(map(display_name, names))})" for name, names in by_campaign]
    return _sentences("trend_sentences", trend, when, outside)


def population_sentences(found: Any) -> tuple[str, ...]:
    """Return what was pooled, which machines do not belong; its caveats are apart."""
    machines = {name: found.machine[name] for name in found.not_belonging}
    worst = {
        name: ranked(own.z, {key: abs(z) for key, z in own.z.items()}.__getitem__)[0]
        for name, own in machines.items()
    }
    return _sentences("population_sentences", found, worst)


# ---- page

_CONFLICT = 0.01


def interval_of(entry: Mapping[str, Any]) -> tuple[float, float]:
    """Return the credible interval in the JSON of a parameter."""
    low, high = next(value for key, value in entry.items() if key.startswith("ci"))
    return low, high


def percent_of(result: Mapping[str, Any]) -> str:
    """Return the probability of the intervals in the JSON of a fit: 95 %."""
    entry = next(iter(result["parameters"].values()))
    return f"{next(key for key in entry if key.startswith('ci'))[2:]} %"


def alert_sentences(fit: Fit, result: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what forbids or limits the use of the numbers."""
    grave = tuple(concern for concern in fit.concerns if concern.kind not in ("forces", "centre"))
    lines = list(concern_sentences(grave, result["sampler"]))
    if fit.misfits and not {"not-converged", "truncation"} & set(fit.kinds):
        lines.append(f"Misfit: {expectation(fit)}. Intervals assume that the model holds.")
    if result["model"]["preset"] == "paper":
        lines.append(PAGE["paper"])
    return tuple(lines)


def change_sentence(first: str, other: str, table: pd.DataFrame, ci_prob: float) -> str:
    """Return which parameters of a campaign differ from those of the first."""
    tail = 0.5 - 0.5 * ci_prob
    clear = table[
        (table["probability_of_increase"] > 1.0 - tail) | (table["probability_of_increase"] < tail)
    ]
    sizes = [
        f"{display_name(str(name))}"
        f" {plus_minus(row['difference'], row['sd'], (row['ci_low'], row['ci_high']), row['unit'])}"
        for name, row in clear.iterrows()
    ]
    return _sentence("change_sentence", first, other, sizes, f"{100 * ci_prob:g}")


__all__ = [
    "ALIKE",
    "DEGREES",
    "IN_FORCE",
    "NONE_ALIKE",
    "PAGE",
    "with_words",
    *sorted(
        name
        for name, own in globals().items()
        if getattr(own, "__module__", "") == __name__ and name[0] != "_"
    ),
]
