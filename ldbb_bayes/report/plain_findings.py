"""First sentences on sheet 1 of the test certificate. They state the results of a fit plainly.

The sentences describe the machine under load, state at most three findings, name circles that
scatter far more than others, and name the step that would reduce the uncertainty of undetermined
parameters most. A finding is something on the machine
to inspect or to repair, and is stated with its probability. There are four kinds of findings: a
softer axis in a plane, a compliance that changes with force, a difference between the two
directions of travel (backlash or servo mismatch), and a squareness error.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from ldbb_bayes.inference.odd_circles import odd_circles
from ldbb_bayes.inference.posterior import bound_of
from ldbb_bayes.model.terms import BallForm
from ldbb_bayes.model.terms.columns import PARAMETERS
from ldbb_bayes.report.blocks import Items
from ldbb_bayes.report.sheet_numbers import SheetNumbers
from ldbb_bayes.report.stated_quantity import StatedQuantity
from ldbb_bayes.units import (
    display_unit,
    needs_interval,
    ranked,
    round_like,
    value_and_uncertainty,
)

if TYPE_CHECKING:
    from ldbb_bayes.report.translation import Words

__all__ = ["Finding", "FindingKind", "best_step", "findings_of", "plain_words"]

# largest number of findings (things to inspect or to repair) that the test certificate names
_MOST_FINDINGS = 3
# Sheet 1 of the test certificate names a finding (something to inspect or to repair) if the
# probability of the finding is at least this value. A change of a compliance with force counts as
# shown from the same probability on.
_LIKELY = 0.95
_N_PER_UM_OF_N_PER_MM = 1e-3  # factor from N/mm to N/µm
# force for which the test certificate's sentences state the deflection of an axis [N]
_LOAD_N = 100.0
_UM_PER_MM = 1e3


class FindingKind(StrEnum):
    """Kind of a finding. A finding is something on the machine to inspect or to repair."""

    SOFT_AXIS = "soft-axis"
    CHANGE = "change"
    REVERSAL = "reversal"
    SQUARENESS = "squareness"


@dataclass(frozen=True)
class Finding:
    """A finding: something on the machine to inspect or to repair, with its probability.

    The sentence on the finding has placeholders. ``values`` is a mapping from the names of the
    placeholders to the texts that are inserted for them.
    """

    kind: FindingKind
    probability: float
    values: Mapping[str, str]


def plain_words(numbers: SheetNumbers) -> Items:
    """Return the first sentences on sheet 1 of the test certificate, in plain words.

    Parameters
    ----------
    numbers
        Quantities that the test certificate states.

    Returns
    -------
    Items
        Heading and sentences. If the results cannot be used, as the banner of the sheet says, a
        single sentence says that they do not describe the machine.
    """
    words = numbers.words
    if numbers.are_unusable:
        return Items(words("sheet.plain"), (words("sheet.plain_unusable"),))
    items = [
        *_sentences_under_load(numbers),
        *_findings_in_words(numbers),
        *_odd_circles_in_words(numbers),
    ]
    if numbers.findings.has_flat_priors:
        items.append(words("sheet.not_examined"))
    else:
        items.append(_undetermined_sentence(numbers))
    return Items(words("sheet.plain"), tuple(items))


# ---- the machine under load


def _sentences_under_load(numbers: SheetNumbers) -> Iterator[str]:
    """Yield two sentences for each plane: one on the stiffness, one on the circular deviation."""
    words = numbers.words
    force = words.number(f"{numbers.force_N:.4g}")
    has_several_planes = len(numbers.planes) > 1
    sentence_on_path = "plain.path"
    if BallForm.__name__ not in bound_of(numbers.findings.posterior_of_certificate).terms:
        sentence_on_path = "plain.path_with_balls"
    for plane in numbers.planes:
        suffix = f"_{plane}" if has_several_planes else ""
        plane_and_circle = plane + numbers.circle_in_words(plane)
        least = numbers.directions[f"k_min{suffix}"]
        greatest = numbers.directions[f"k_max{suffix}"]
        yield words(
            "plain.stiffness",
            plane=plane_and_circle,
            force=force,
            least=_with_U(least, words),
            where=least.where,
            greatest=_with_U(greatest, words),
            there=greatest.where,
            load=words.number(f"{_LOAD_N:g}"),
            deflection=_deflection_with_U(least, words),
        )
        circle = numbers.path[f"G{suffix}"]
        unloaded = numbers.unloaded_path[f"G_no_load{suffix}"]
        yield words(
            sentence_on_path,
            plane=plane_and_circle,
            force=force,
            loaded=_with_U(circle, words),
            unloaded=_with_U(unloaded, words),
            apart=_inseparable(circle, words),
        )


def _deflection_with_U(stiffness: StatedQuantity, words: Words) -> str:
    """Return a string with the deflection under 100 N [µm] and its expanded uncertainty (k = 2).

    ``stiffness`` is in N/mm. If only a lower limit of the stiffness is known, the string states the
    upper limit of the deflection. If value ± U would not describe the deflection, the distances to
    the ends of its credible interval are stated instead of U.
    """
    if stiffness.limit:
        largest_um = _LOAD_N / (stiffness.interval[0] * _N_PER_UM_OF_N_PER_MM)
        return words("plain.at_most", value=words.number(f"{largest_um:.2g}"))
    deflection_um = _LOAD_N / (stiffness.estimate * _N_PER_UM_OF_N_PER_MM)
    sd_um = stiffness.sd / stiffness.estimate * deflection_um
    low, high = stiffness.interval
    interval_um = (
        _LOAD_N / (high * _N_PER_UM_OF_N_PER_MM),
        _LOAD_N / (low * _N_PER_UM_OF_N_PER_MM),
    )
    if needs_interval(deflection_um, sd_um, interval_um):
        below = round_like(deflection_um - interval_um[0], 2)
        above = round_like(interval_um[1] - deflection_um, 2)
        return words.number(f"{round_like(deflection_um, 2)} (+{above} / −{below})")
    value, expanded = value_and_uncertainty(deflection_um, 2.0 * sd_um)
    return words.number(f"{value} ± {expanded}")


def _inseparable(circle: StatedQuantity, words: Words) -> str:
    """Return a sentence on the effects that readings cannot separate from a circular deviation.

    ``circle`` is the circular deviation. The sentence is empty if there are no such effects.
    """
    if not circle.confounding_effects:
        return ""
    partners = words.joined([words.term(name) for name in circle.confounding_effects])
    return words("plain.apart", partners=partners)


def _with_U(quantity: StatedQuantity, words: Words) -> str:
    """Return a string with a value and its expanded uncertainty, such as "17.5 ± 2.0".

    If only a limit of the quantity is known, the string states the limit.
    """
    statement = quantity.value_and_U()
    if quantity.limit:
        return words.number(statement.value)
    if "/" in statement.expanded:
        return words.number(f"{statement.value} ({statement.expanded})")
    return words.number(f"{statement.value} ± {statement.expanded}")


# ---- findings: what to look at or to repair


def findings_of(numbers: SheetNumbers) -> tuple[Finding, ...]:
    """Return at most three findings: things to inspect or to repair, the most probable first.

    Parameters
    ----------
    numbers
        Quantities that the test certificate states.

    Returns
    -------
    tuple of Finding
        Findings with a probability of at least 95 %.
    """
    candidates = [
        *_soft_axis_findings(numbers),
        *_change_findings(numbers),
        *_reversal_findings(numbers),
        *_squareness_findings(numbers),
    ]
    likely = [finding for finding in candidates if finding.probability >= _LIKELY]
    likely = _without_stiffer_axes(likely)
    return tuple(ranked(likely, lambda finding: finding.probability)[:_MOST_FINDINGS])


def _without_stiffer_axes(likely: Sequence[Finding]) -> list[Finding]:
    """Return findings without those on a soft axis that another finding calls the stiffer one.

    If X yields more than Y, and Y more than Z, only the finding on X is left: there the user is to
    begin.
    """
    stiffer = set()
    for finding in likely:
        if finding.kind == FindingKind.SOFT_AXIS:
            stiffer.add(finding.values["stiffer"])
    left = []
    for finding in likely:
        if finding.kind != FindingKind.SOFT_AXIS or finding.values["softer"] not in stiffer:
            left.append(finding)
    return left


def _probability_of_sign(mean: float, sd: float) -> float:
    """Return the probability that a normally distributed quantity has the same sign as its mean."""
    if not sd > 0.0:
        return 1.0
    return 0.5 * (1.0 + math.erf(abs(mean) / sd / math.sqrt(2.0)))


def _soft_axis_findings(numbers: SheetNumbers) -> Iterator[Finding]:
    """Yield one finding for each plane, which names the softer of the plane's two axes.

    A plane is left out if the model has no direct compliance of one of the two axes.
    """
    words = numbers.words
    for plane in numbers.stiffness_by_plane:
        difference = plane.difference
        softer = plane.plane[0]
        stiffer = plane.plane[1]
        if difference.mean < 0.0:
            softer = plane.plane[1]
            stiffer = plane.plane[0]
        smaller_stiffness = numbers.stiffness_of_axis(softer)
        larger_stiffness = numbers.stiffness_of_axis(stiffer)
        if smaller_stiffness is None or larger_stiffness is None:
            continue
        values = {
            "softer": softer,
            "stiffer": stiffer,
            "soft": _with_U(smaller_stiffness, words),
            "stiff": _with_U(larger_stiffness, words),
        }
        probability = _probability_of_sign(difference.mean, difference.sd)
        yield Finding(FindingKind.SOFT_AXIS, probability, values)


def _change_findings(numbers: SheetNumbers) -> Iterator[Finding]:
    """Yield a finding on the compliance whose change with force has the most certain sign.

    Nothing is yielded if no compliance changes with force in the model.
    """
    words = numbers.words
    probabilities = {
        name: max(change.probability_of_increase, change.probability_of_decrease)
        for name, change in numbers.changes_with_force.items()
    }
    if not probabilities:
        return
    name = ranked(probabilities, probabilities.__getitem__)[0]
    quantity = numbers.changes[name]
    values = {
        "symbol": quantity.symbol.removeprefix("Δ"),
        "direction": words("remarks.increases"),
        "change": _with_U(quantity, words),
        "unit": words.unit(display_unit(quantity.unit)[1]),
    }
    if quantity.estimate < 0.0:
        values["direction"] = words("remarks.decreases")
    yield Finding(FindingKind.CHANGE, probabilities[name], values)


def _reversal_findings(numbers: SheetNumbers) -> Iterator[Finding]:
    """Yield one finding for each plane in which circles were run in both directions.

    The readings of the two directions differ. The finding states the amplitude of sin 2θ in that
    part of this difference which does not grow with force [µm], where θ is the angle of the bar.
    Servo mismatch, or unequal backlash of the two axes, causes it. The whole difference at 45° is
    another number: it also has other waves, a constant, and a part that grows with force.
    """
    words = numbers.words
    for plane, coefficient in numbers.reversal_coefficients.items():
        mean_um = 2.0 * coefficient["mean"] * _UM_PER_MM
        sd_um = 2.0 * coefficient["sd"] * _UM_PER_MM
        value, expanded = value_and_uncertainty(abs(mean_um), 2.0 * sd_um)
        values = {"plane": plane, "difference": words.number(f"{value} ± {expanded}")}
        yield Finding(FindingKind.REVERSAL, _probability_of_sign(mean_um, sd_um), values)


def _squareness_findings(numbers: SheetNumbers) -> Iterator[Finding]:
    """Yield one finding for each squareness error, with the probability of the error's sign.

    Errors that the readings do not determine are left out: the machine must not be corrected by
    them. Of a confounded error, the sentence asks for a confirmation before it is corrected.
    """
    words = numbers.words
    for label, quantity in numbers.squareness_errors.items():
        if quantity.is_undetermined:
            continue
        advice = words("plain.align")
        if quantity.entry is not None and quantity.entry.partners:
            partners = words.joined([words.term(name) for name in quantity.entry.partners])
            advice = words("plain.confirm", partners=partners)
        values = {
            "name": quantity.words,
            "value": _with_U(quantity, words),
            "angle": numbers.angle_of_squareness(label),
            "advice": advice,
        }
        probability = _probability_of_sign(quantity.estimate, quantity.sd)
        yield Finding(FindingKind.SQUARENESS, probability, values)


def _findings_in_words(numbers: SheetNumbers) -> Iterator[str]:
    """Yield one sentence for each thing on the machine that should be inspected or repaired.

    If there is nothing to inspect, a sentence says so. Another sentence follows if the readings do
    not show that the stiffness changes with force. If no plane has circles in both directions, or
    no circle states its direction, or the model has no hysteresis, the last sentence says that
    backlash and servo mismatch were not tested.
    """
    words = numbers.words
    findings = findings_of(numbers)
    for finding in findings:
        probability = words.percent(finding.probability)
        key = str(finding.kind).replace("-", "_")
        yield words(f"plain.{key}", probability=probability, **finding.values)
    if not findings:
        yield words("plain.nothing", limit=words.percent(_LIKELY))
    change = next(_change_findings(numbers), None)
    if change is not None and change.probability < _LIKELY:
        probability = words.percent(change.probability, below=_LIKELY)
        yield words(
            "plain.no_change",
            symbol=change.values["symbol"],
            direction=change.values["direction"],
            probability=probability,
        )
    if not numbers.reversal_coefficients:
        yield words(f"plain.{_why_not_reversed(numbers)}")


def _why_not_reversed(numbers: SheetNumbers) -> str:
    """Return the name of the sentence on why the readings cannot show backlash or servo mismatch.

    ``numbers`` has no plane whose circles in both directions are compared.
    """
    tests = bound_of(numbers.findings.posterior).campaign.tests
    directions = {test.direction for test in tests}
    if directions == {None}:
        return "directions_not_stated"
    if len(directions) == 1:
        return "one_way"
    for plane in numbers.planes:
        if {"CW", "CCW"} <= {test.direction for test in tests if test.plane == plane}:
            return "no_hysteresis"
    return "no_plane_both_ways"


def _odd_circles_in_words(numbers: SheetNumbers) -> Iterator[str]:
    """Yield a sentence for each circle that scatters far more than circles usually do.

    If there are many such circles, the oddest are named.
    """
    words = numbers.words
    for circle in odd_circles(numbers.findings.posterior_of_certificate)[:_MOST_FINDINGS]:
        low, high = circle.interval
        yield words(
            "plain.odd_circle",
            test=circle.test,
            factor=words.number(f"{circle.factor:.2g}"),
            low=words.number(f"{low:.2g}"),
            high=words.number(f"{high:.2g}"),
        )


# ---- parameters that the readings do not determine, and the step that would help most


def best_step(numbers: SheetNumbers) -> str:
    """Return the name of the effect that makes the undetermined parameters most uncertain.

    A parameter is undetermined if the readings hardly determine it. Each effect causes a share of
    the variance of every undetermined parameter. The shares due to the same effect are added up,
    and the effect with the largest sum is chosen. The undetermined parameters therefore become most
    certain if the uncertainty due to this effect is reduced.

    Parameters
    ----------
    numbers
        Quantities that the test certificate states.

    Returns
    -------
    str
        Class name of a model term, or the name that stands for the parameters' own priors. The
        string is empty if the readings determine all parameters.
    """
    shares: dict[str, float] = {}
    for quantity in numbers.parameters.values():
        entry = quantity.entry
        if entry is None or not quantity.is_undetermined:
            continue
        partners = entry.partner_shares or {entry.held_by.name: entry.held_by.share}
        for name, share in partners.items():
            shares[name] = shares.get(name, 0.0) + share
    if not shares:
        return ""
    return ranked(shares, shares.__getitem__)[0]


def _undetermined_sentence(numbers: SheetNumbers) -> str:
    """Return a string that names the undetermined parameters and the step that would help most.

    A step, such as a calibration, reduces the uncertainty that is due to one effect. If the
    readings determine all parameters, the string says so. If the uncertainty of some parameters is
    mostly that of effects which nobody measured, the string does not say that these parameters are
    determined: it says how much the readings narrow all parameters, and names these parameters.
    """
    words = numbers.words
    step = best_step(numbers)
    if not step:
        assumed = [
            quantity.symbol
            for quantity in numbers.parameters.values()
            if quantity.entry is not None and quantity.entry.partners
        ]
        if assumed:
            by_assumption = words("plain.by_assumption", names=words.joined(assumed))
            return words("plain.narrowed") + by_assumption
        return words("plain.all_determined")
    undetermined = []
    helped_by_step: dict[str, list[str]] = {step: []}
    for quantity in numbers.parameters.values():
        if quantity.entry is None or not quantity.is_undetermined:
            continue
        undetermined.append(quantity.symbol)
        name = quantity.entry.held_by.name
        if step in quantity.entry.partners:
            name = step
        helped_by_step.setdefault(name, []).append(quantity.symbol)
    best_helped = helped_by_step.pop(step)
    return words(
        "plain.not_determined",
        count=str(len(undetermined)),
        all=str(len(numbers.parameters)),
        names=words.joined(undetermined),
        step=_step_in_words(step, words),
        helped=words.joined(best_helped),
        others="".join(_other_steps(helped_by_step, words)),
    )


def _other_steps(helped_by_step: Mapping[str, Sequence[str]], words: Words) -> Iterator[str]:
    """Yield one sentence on each step, other than the best step, that would help.

    A step, such as a calibration, reduces the uncertainty that is due to one effect. The sentence
    names the parameters that become more certain with this step, but not with the best step. The
    keys of ``helped_by_step`` are the effects, given as class names of model terms. Each value
    holds the symbols of these parameters.
    """
    for name, symbols in helped_by_step.items():
        yield words(
            "plain.other_step", helped=words.joined(symbols), step=_step_in_words(name, words)
        )


def _step_in_words(name: str, words: Words) -> str:
    """Return a text that states how to reduce the uncertainty due to one effect.

    ``name`` is the class name of the model term that describes the effect.
    """
    steps = words.table["steps"]
    return str(steps.get(name, steps[PARAMETERS]))
