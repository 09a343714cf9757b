"""The sentences that matter, and what must be known before any number is read."""

from __future__ import annotations

from collections.abc import Iterator

from ldbb_bayes.analysis.compared import Comparison
from ldbb_bayes.analysis.designed import Design
from ldbb_bayes.model.wording import joined, term_words
from ldbb_bayes.report.document import Bullets, Paragraph, Section
from ldbb_bayes.report.figures.budget import source_words
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.report.rounding import state, stiffness
from ldbb_bayes.units import display_name, is_direct

__all__ = ["alerts", "summary"]

_GRAVE = ("Not converged", "The readings contradict", "The readings speak against", "Misfit")


def alerts(found: Findings) -> tuple[str, ...]:
    """What forbids or limits the use of the numbers."""
    fit, model = found.result["fit"], found.result["model"]
    said = [warning for warning in fit["warnings"] if warning.startswith(_GRAVE)]
    if found.result["sampler"]["converged"] and "does not expect" in fit["verdict"]:
        clause = next(part for part in fit["verdict"].split("; ") if "does not expect" in part)
        said.append(f"Misfit: {clause}. Intervals assume that the model holds.")
    if model["preset"] == "paper":
        said.append(
            "Least squares (preset paper): the intervals cover white noise alone. Ball form, bar length, mount, force errors "
            "and what differs between circles are not in them; real uncertainties are many times larger."
        )
    return tuple(said)


def summary(found: Findings) -> Section:
    """Compliance, geometry, constant or linear, what to do next."""
    usable = found.result["sampler"]["converged"]
    lead = found.result["fit"]["verdict"] if usable else "The sampler has not converged: nothing below may be used."
    sentences = (*_compliance(found), *_geometry(found), *_comparison(found), *_next(found))
    return Section("summary", "Summary", (Paragraph(lead), Bullets(tuple(sentences))))


def _compliance(found: Findings) -> Iterator[str]:
    known = []
    for name, entry in found.result["parameters"].items():
        if not is_direct(name):
            continue
        own = state(entry["mean"], entry["sd"], tuple(entry[found.interval_key]), entry["unit"])
        stiff = stiffness(entry["median"], tuple(entry[found.interval_key]))
        told = f" (stiffness {stiff} N/µm)" if stiff else " (no lower limit of the stiffness can be given)"
        sign = "" if own.expanded.startswith("+") else "± "
        known.append(f"{name} = {own.value} {sign}{own.expanded} {own.unit}{told}")
    if not known:
        return
    heaviest = _heaviest(found, [name for name in found.result["parameters"] if is_direct(name)])
    at = f" at {found.result['model']['reference_force_N']:g} N" if found.result["model"]["degree"] else ""
    yield (
        f"Compliance{at}, with expanded uncertainty (k = 2, or the interval where it is lopsided): {joined(known)}. "
        f"Most of this uncertainty is {heaviest}."
    )


def _heaviest(found: Findings, names: list[str]) -> str:
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
    told = [
        name for name in names if abs(found.result["parameters"][name]["mean"]) > 2.0 * found.result["parameters"][name]["sd"]
    ]
    aliased = [name for name in names if found.verdicts[name].verdict.word == "aliased"]
    shown = []
    for name in told:
        entry = found.result["parameters"][name]
        own = state(entry["mean"], entry["sd"], tuple(entry[found.interval_key]), entry["unit"])
        shown.append(f"{display_name(name)} = {own.value} ± {own.expanded} {own.unit}")
    says = f"told from zero (k = 2): {joined(shown)}" if shown else "none is told from zero (k = 2)"
    yield f"Geometric errors ({len(names)}, tool offsets aside): {says}."
    if aliased:
        partners = joined(list(dict.fromkeys(term_words(p) for name in aliased for p in found.verdicts[name].verdict.partners)))
        yield (
            f"{joined([display_name(name) for name in aliased])} cannot be told from {partners}: their intervals rest on what "
            "was assumed of these, and more readings of the same kind do not narrow them."
        )


def _comparison(found: Findings) -> Iterator[str]:
    if isinstance(found.comparison, Comparison):
        yield f"Constant or linear compliance: {found.comparison.verdict[0]} {_robust(found.comparison)}".strip()
    else:
        yield f"Constant or linear compliance could not be compared: {found.comparison}"


def _robust(comparison: Comparison) -> str:
    return next((sentence for sentence in comparison.verdict if sentence.startswith("The sign")), "")


def _next(found: Findings) -> Iterator[str]:
    if isinstance(found.design, Design):
        yield f"Next: {found.design.sentences()[0][0].lower()}{found.design.sentences()[0][1:]}"
