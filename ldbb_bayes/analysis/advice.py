"""A design in words: which tests, how good, how narrow the intervals, whether it will settle constant against linear."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ldbb_bayes.analysis.places import ALWAYS, place_words
from ldbb_bayes.model.wording import joined
from ldbb_bayes.units import display_name, display_unit

if TYPE_CHECKING:
    from ldbb_bayes.analysis.designed import Design, Judged

__all__ = ["recommendation"]

_MANY = 12
_FAR = 0.5


def recommendation(design: Design) -> tuple[str, ...]:
    """The sentences."""
    parts = (_tests, _quality, _widths, _decision, _robustness)
    return (*(sentence for part in parts for sentence in part(design)), *design.notes)


def _tests(design: Design) -> Iterator[str]:
    table = design.table()
    clocked = bool((table[list(ALWAYS[:2])] != 0.0).any(axis=None))
    told = [name for name in design.columns if (clocked if name in ALWAYS[:2] else table[name].nunique() > 1)]
    words = []
    for row in table.to_dict(orient="records"):
        place = f" ({place_words({name: row[name] for name in told})})" if told else ""
        words.append(f"{row['count']} × {row['force_N']:.4g} N{place}")
    more = " more" if design.augment else ""
    listed = joined(words) if len(words) <= _MANY else "see the table"
    yield f"Run {len(design.tests)}{more} circles: {listed}."


def _quality(design: Design) -> Iterator[str]:
    best = "1: the best shares; whole tests reach it at most" if design.certificate.is_global else "1: the best found nearby"
    others = joined([_compared(judged) for judged in (design.baseline, *design.others)])
    yield f"Efficiency {design.efficiency:.3f} by criterion {design.criterion} ({best}). For comparison: {others}."
    if design.efficiency < _FAR:
        yield "So few circles come nowhere near the best shares: see what more would bring, or choose among less."
    if not design.certificate.holds:
        excess = design.certificate.max_sensitivity / design.certificate.bound - 1.0
        yield f"The certificate does NOT hold: a sensitivity exceeds its bound by {excess:.1e}. Better shares may exist."


def _compared(judged: Judged) -> str:
    outside = ", more than 1: it uses tests that were not to be chosen from" if judged.efficiency > 1.0 + 1e-6 else ""
    return f"{judged.name} {judged.efficiency:.3f} ({len(judged.tests)} circles{outside})"


def _widths(design: Design) -> Iterator[str]:
    expected, baseline = design.forecast.expected, design.baseline.forecast.expected
    ratio = {name: expected[name].sd / baseline[name].sd for name in design.parameters}
    first, last = min(ratio, key=lambda name: ratio[name]), max(ratio, key=lambda name: ratio[name])
    factor, unit = display_unit(expected[first].unit)
    narrow = f"{ratio[first]:.2f} times as wide for {display_name(first)} (u = {expected[first].sd * factor:.2g} {unit})"
    wide = f" to {ratio[last]:.2f} times for {display_name(last)}" if len(ratio) > 1 else ""
    yield f"Expected intervals against {design.baseline.name}: {narrow}{wide}."


def _decision(design: Design) -> Iterator[str]:
    found = design.forecast.discrimination
    if found is None or not set(found.power) & set(design.parameters):
        return
    drawn = {1.0: "their prior sd"}.get(found.size, f"{found.size:g} prior sd")
    there = "slopes as the tests already run leave them" if found.augmented else f"slopes drawn at {drawn}"
    yield (
        f"With slopes or without (constant): with {there} |ln B| > {found.threshold:g} for them is expected with probability "
        f"{found.decisive_with:.2f}, for constant if there are none with {found.decisive_without:.2f}; misleading evidence as "
        f"strong with {found.misleading_with:.2g} and {found.misleading_without:.2g}."
    )
    alone = joined([f"{display_name(name)} {power:.2f}" for name, power in found.power.items()])
    yield f"A single slope of ± {drawn} would be found, all of them in the model, with probability: {alone}."


def _robustness(design: Design) -> Iterator[str]:
    table = design.robustness
    if table.empty:
        return
    worst = {str(name): float(value) for name, value in table["worst"].items()}
    over, steps = worst.pop("good over all"), worst.pop("equal steps")
    yield (
        f"Good over {len(worst)} assumptions: its efficiency is nowhere below {over:.2f}; that of designs made for one of them "
        f"falls to {min(worst.values()):.2f} under another, that of equal steps to {steps:.2f}."
    )
