"""The sentences that matter, and what must be known before any number is read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ldbb_bayes.analysis.compared import ComparedModel, Comparison
from ldbb_bayes.analysis.designed import Design
from ldbb_bayes.analysis.recorded import recorded
from ldbb_bayes.model.wording import joined, term_words
from ldbb_bayes.report.document import Bullets, Paragraph, Section
from ldbb_bayes.report.figures.budget import source_words
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.report.rounding import plus_minus, stiffness
from ldbb_bayes.units import display_name, is_direct

__all__ = ["alerts", "summary"]

_GRAVE = ("Not converged", "The readings contradict", "The readings speak against", "Misfit")
_DEGREES = ("constant", "linear", "quadratic")
_WORTH = 0.95


def alerts(found: Findings) -> tuple[str, ...]:
    """What forbids or limits the use of the numbers."""
    fit, model = found.result["fit"], found.result["model"]
    said = [warning for warning in fit["warnings"] if warning.startswith(_GRAVE)]
    if found.result["sampler"]["converged"] and "does not expect" in fit["verdict"]:
        clause = next(part for part in fit["verdict"].split("; ") if "does not expect" in part)
        said.append(f"Misfit: {clause}. Intervals assume that the model holds.")
    if model["preset"] == "paper":
        said.append(
            "Least squares (preset paper): the intervals cover white noise alone. Ball form, bar length, mount, force errors and "
            "what differs between circles are not in them; real uncertainties are many times larger."
        )
    return tuple(said)


def summary(found: Findings) -> Section:
    """Compliance, geometry, constant or linear, what to do next."""
    usable = found.result["sampler"]["converged"]
    lead = found.result["fit"]["verdict"] if usable else "The sampler has not converged: nothing below may be used."
    sentences = (*_compliance(found), *_geometry(found), *_comparison(found), *_next(found))
    return Section("summary", "Summary", (Paragraph(lead), Bullets(tuple(sentences))))


def _told(found: Findings, name: str) -> str:
    entry = found.result["parameters"][name]
    return f"{display_name(name)} = {plus_minus(entry['mean'], entry['sd'], tuple(entry[found.interval_key]), entry['unit'])}"


def _compliance(found: Findings) -> Iterator[str]:
    names = [name for name in found.result["parameters"] if is_direct(name)]
    if not names:
        return
    known = []
    for name in names:
        entry = found.result["parameters"][name]
        stiff = stiffness(entry["median"], tuple(entry[found.interval_key]))
        word = found.verdicts[name].verdict.word
        doubt = f", {word}" if word != "identified" else ""
        known.append(f"{_told(found, name)} ({f'stiffness {stiff} N/µm' if stiff else 'negative: no stiffness'}{doubt})")
    degree = found.result["model"]["degree"]
    at = f" at {found.result['model']['reference_force_N']:g} N" if degree else ""
    yield (
        f"Compliance{at}, {_DEGREES[degree]} in force, ± expanded uncertainty U (k = 2), brackets {100 * found.ci_prob:g} % "
        f"intervals: {joined(known)}. Most of the uncertainty is {_heaviest(found, names)}."
    )


def _heaviest(found: Findings, names: Sequence[str]) -> str:
    """The largest sources of the variance of some parameters together."""
    terms = {line.term for name in names for line in found.budgets[name].contributions}
    share = {term: sum(found.budgets[name].share(term) for name in names) / len(names) for term in terms}
    first, *others = sorted(share, key=lambda term: -share[term])
    second = f", then {source_words(others[0])} ({100 * share[others[0]]:.0f} %)" if others and share[others[0]] > 0.1 else ""
    return f"{source_words(first)} ({100 * share[first]:.0f} % of the variance){second}"


def _geometry(found: Findings) -> Iterator[str]:
    names = [name for name in found.result["parameters"] if name.startswith("E_") and name[3] != "t"]
    if not names:
        return
    entries = found.result["parameters"]
    told = [name for name in names if abs(entries[name]["mean"]) > 2.0 * entries[name]["sd"]]
    aliased = [name for name in names if found.verdicts[name].verdict.word == "aliased"]
    partners = joined(list(dict.fromkeys(term_words(p) for name in aliased for p in found.verdicts[name].verdict.partners)))
    if not aliased:
        shown = (
            f"told from zero (k = 2): {joined([_told(found, name) for name in told])}"
            if told
            else "none is told from zero (k = 2)"
        )
        yield f"Geometric errors ({len(names)}, tool offsets aside): {shown}."
        return
    if found.flat:
        yield (
            f"Geometric errors: {joined([display_name(name) for name in aliased])} look exactly like {partners}, which these "
            "intervals leave out: they are not known as well as is printed."
        )
        return
    clear = [name for name in told if name not in aliased]
    rest = [name for name in told if name in aliased]
    shown = f" Told from zero (k = 2): {joined([_told(found, name) for name in clear])}." if clear else ""
    if rest:
        shown += f" Beyond what was assumed of these: {joined([_told(found, name) for name in rest])}."
    if not told:
        shown = " None is told from zero (k = 2)."
    yield (
        f"Geometric errors: the readings cannot tell {joined([display_name(name) for name in aliased])} from {partners}; their "
        f"intervals rest on what was assumed of these, and more readings of the same kind do not narrow them.{shown}"
    )


def _comparison(found: Findings) -> Iterator[str]:
    compared = found.comparison
    if not isinstance(compared, Comparison):
        yield f"Constant or linear compliance could not be compared: {compared}"
        return
    robust = next((sentence for sentence in compared.verdict if sentence.startswith("The sign")), "")
    yield f"Constant or linear compliance: {compared.verdict[0]} {robust}".strip()
    other = _preferred(found)
    if other is not None:
        own = _DEGREES[found.result["model"]["degree"]]
        values = [
            f"{name} = {plus_minus(mean, sd, (mean - 2.0 * sd, mean + 2.0 * sd), unit)}"
            for name, (unit, mean, sd) in other.parameters.items()
            if is_direct(name)
        ]
        yield (
            f"The numbers of this page are of {own} compliance. With {other.name} compliance, which the readings prefer "
            f"(probability {other.probability:.3g}): {joined(values)}; to sign these, fit with --degree {other.degree}."
        )


def _preferred(found: Findings) -> ComparedModel | None:
    """The likeliest model, where that is another degree than was fitted."""
    if not isinstance(found.comparison, Comparison):
        return None
    best = max(found.comparison.models.values(), key=lambda model: model.probability)
    return best if best.degree != found.result["model"]["degree"] and best.probability > 0.5 else None


def _next(found: Findings) -> Iterator[str]:
    remedies: dict[str, list[str]] = {}
    for name, budget in found.budgets.items():
        if is_direct(name) or (name.startswith("E_") and name[3] != "t"):
            remedies.setdefault(budget.improve, []).append(display_name(name))
    if found.flat:
        yield "What would help most: fit with the default preset. Least squares sees nothing but white noise."
        return
    ordered = sorted(remedies.items(), key=lambda pair: -len(pair[1]))[:2]
    yield "What would help most: " + " ".join(f"{joined(names)}: {remedy[0].lower()}{remedy[1:]}" for remedy, names in ordered)
    if isinstance(found.design, str):
        return
    told = recorded(found.design) if isinstance(found.design, Design) else found.design
    ratio = {name: told.expected[name].sd / told.baseline[name].sd for name in told.parameters}
    best = min(ratio, key=lambda name: ratio[name])
    run = told.sentences[0].rstrip(".")
    against = f"against {told.baseline_name} the interval of {display_name(best)} is then {ratio[best]:.2f} times as wide"
    if found.design_given:
        yield f"Recommended next: {run[0].lower()}{run[1:]}; {against}."
    elif ratio[best] > _WORTH:
        yield (
            f"Other forces alone would not help: of as many circles the best ({run[4:]}) narrow no interval by more than "
            f"{100 * (1.0 - _WORTH):.0f} % against {told.baseline_name}."
        )
    else:
        yield f"If the campaign is run anew: {run[0].lower()}{run[1:]}; {against}."
