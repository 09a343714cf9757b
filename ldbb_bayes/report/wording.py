"""Every sentence about findings: small functions that take findings and return what is read of them.

Nothing decides by reading a sentence: what is decided stands in the findings. Where a list is named, `joined` joins it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import singledispatch
from typing import Any

import numpy as np
import pandas as pd

from ldbb_bayes.analysis.aliases import Cure, Degeneracy, Standing, StandingKind
from ldbb_bayes.analysis.budget import Budget
from ldbb_bayes.analysis.calibration import Validation
from ldbb_bayes.analysis.comparison import WHITE_NOISE, Comparison, Sign
from ldbb_bayes.analysis.describe import DescribedMachine, Seen
from ldbb_bayes.analysis.design.design import Design, Outcome, RemedyKind
from ldbb_bayes.analysis.identifiability import Identifiability, ParameterIdentifiability, Verdict
from ldbb_bayes.analysis.slopes import SlopeSubset
from ldbb_bayes.campaign.preview import CampaignPreview, Remark, RemarkKind
from ldbb_bayes.inference.posterior import Concern, ConcernKind, Fit
from ldbb_bayes.inference.predictive import Check, CheckKind
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.likelihood import NOISE, OWN
from ldbb_bayes.model.terms import Term
from ldbb_bayes.units import (
    display_name,
    display_unit,
    is_direct,
    plus_minus,
    ranked,
    round_uncertainty,
    stiffness,
    units_for,
    value_and_uncertainty,
)

_IN_FORCE = ("constant", "linear in force", "quadratic in force")
_DEGREES = ("constant", "linear", "quadratic")
_FEW = 3
# Ratios of expected sds that differ by less are drawn alike.
_ALIKE = 2e-3
_CONTRADICTED = -13.815510557964274  # ln 1e-6


@singledispatch
def with_words(result: Any) -> dict[str, Any]:
    """Return a result's JSON, its sentences added."""
    found: dict[str, Any] = result.as_dict()
    return found


# ---- terms and aliases

_COMPANY = 3
_SMALL = 0.01


def unit_words(name: str) -> tuple[float, str]:
    """Inside value of one unit that a nuisance coefficient is read in, and its label."""
    return Term.owner(name).unit_of(name)[1:]


def company_words(lead: str, amount: float, name: str, change: float) -> str:
    """0.5 times as much mount deflection; of another unit, how much."""
    (_, unit), (own, other) = unit_words(lead), unit_words(name)
    if unit != other:
        return f"{signed(change / own)} {other} of {nuisance_words(name)}"
    ratio = change / amount
    much = {1.0: "as much", -1.0: "minus as much"}.get(round(ratio, 6), f"{signed(ratio)} times as much")
    return f"{much} {nuisance_words(name)}"


def term_words(term: str) -> str:
    """BallForm → ball form, SetupShift → set-up shift; a parameter's name stays."""
    spaced = re.sub(r"(?<!^)(?=[A-Z])", " ", term).lower()
    return Term.kinds[term].words if term in Term.kinds else display_name(term) if "_" in term else spaced


def pattern(name: str) -> str:
    """form_cos2 →  in cos 2θ; empty where the term has a single column."""
    return Term.owner(name).pattern(name)


def nuisance_words(name: str) -> str:
    """form_cos2 → 2-lobe form (cos 2θ)."""
    return Term.owner(name).describe(name)


def amount_words(name: str, amount: float) -> str:
    """1.00 µm of bar length; 1 % of force gain."""
    one, unit = unit_words(name)
    return f"{f'{amount / one:g}' if unit == '%' else three(amount / one)} {unit} of {nuisance_words(name)}"


def change_words(name: str, change: float, unit: str) -> str:
    """+6.67 µm/m of E_XX1."""
    factor, label = display_unit(unit)
    value = abs(change) * factor
    if value < _SMALL and label.startswith("µ"):
        value, label = value * 1e3, "n" + label[1:]
    return f"{'+' if change > 0 else '−'}{three(value)} {label} of {display_name(name)}"


def signed(ratio: float) -> str:
    """Two significant digits."""
    return f"{ratio:.2g}".replace("-", "−")


def three(value: float) -> str:
    """Three significant digits without an exponent."""
    if value == 0.0 or not np.isfinite(value):
        return f"{value:g}"
    decimals = max(2 - int(np.floor(np.log10(abs(float(f"{value:.2e}"))))), 0)
    return f"{value:.{decimals}f}" if decimals <= 6 else f"{value:.2e}"


def joined(parts: Sequence[str], word: str = "and") -> str:
    """a, b and c."""
    return f" {word} ".join(parts) if len(parts) < 3 else f"{', '.join(parts[:-1])} {word} {parts[-1]}"


_CURES = {
    Cure.FORCES: "other force levels",
    Cure.WORK_BALL: "clocking the work ball (0/45/90°)",
    Cure.TOOL_BALL: "clocking the tool ball (0/45/90°)",
    Cure.BOTH_BALLS: "clocking both balls (0/45/90°)",
    Cure.RADIUS: "a second radius",
    Cure.DIRECTIONS: "both directions of travel at the same forces",
    Cure.REVERSE_ORDER: "the same tests once more in reverse order",
    Cure.FULL_CIRCLES: "full circles of more readings",
}


def statement(found: Degeneracy) -> str:
    """Return a degeneracy with its exchange rate: what looks like what, and how much of it."""
    changes = {name: found.combination[name] for name in found.parameters}
    if found.term:
        subject = amount_words(found.nuisances[0], found.combination[found.nuisances[0]]) + _company(found)
        looks = joined([change_words(name, -change, found.units[name]) for name, change in changes.items()])
        verb, said = "looks exactly like", looks + _difference(found, {name: -change for name, change in changes.items()})
    else:
        subject = joined([change_words(name, change, found.units[name]) for name, change in changes.items()])
        subject += f" in company with {len(found.nuisances)} nuisances" if found.nuisances else ""
        verb, said = "together change", "no reading"
    left_out = "" if found.modelled else "; the model leaves it out, and the intervals do not cover it"
    return f"{subject} {verb} {said}{left_out}."


def _company(found: Degeneracy) -> str:
    """The other nuisances in it."""
    lead, *others = found.nuisances
    if len(others) > _COMPANY:
        return f" in company with {len(others)} other nuisances"
    amounts = [company_words(lead, found.combination[lead], name, found.combination[name]) for name in others]
    return f" with {joined(amounts)}" if amounts else ""


def _difference(found: Degeneracy, changes: Mapping[str, float]) -> str:
    """Of two that go opposite ways by as much: their difference."""
    if len(changes) != 2:
        return ""
    (first, a), (second, b) = changes.items()
    if found.units[first] != found.units[second] or not abs(a + b) < 1e-6 * abs(a):
        return ""
    factor, unit = display_unit(found.units[first])
    return f" ({three(abs(a - b) * factor)} {unit} of {display_name(first)} − {display_name(second)})"


def cure_words(found: Degeneracy, cures: Sequence[Cure]) -> str:
    """Return what would end a degeneracy."""
    calibration = Term.kinds[found.term].calibration if found.term in Term.kinds else "a calibration of it"
    text = joined([_CURES.get(cure, calibration) for cure in cures], "or") or "a narrower prior on one of them"
    return text[0].upper() + text[1:] + "."


def alias_sentences(found: Sequence[Degeneracy]) -> tuple[str, ...]:
    """Return one sentence per term: what it looks like, and what supplies it."""
    by_term: dict[str, list[Degeneracy]] = {}
    for degeneracy in found:
        by_term.setdefault(degeneracy.term, []).append(degeneracy)
    said = []
    for term, members in by_term.items():
        if not term:
            alone = (joined([display_name(name) for name in member.parameters]) for member in members)
            said += [f"{together} cannot be told apart by these readings." for together in alone]
            continue
        alike: dict[tuple[str, ...], list[str]] = {}
        for member in members:
            alike.setdefault(member.parameters, []).append(pattern(member.nuisances[0]))
        parts = [f"like {joined([display_name(n) for n in names])}{', '.join(p)}" for names, p in alike.items()]
        left_out = "" if members[0].modelled else " The model leaves it out: the intervals do not cover it."
        remedy = Term.kinds.get(term, Term).remedy
        said.append(
            f"{term_words(term).capitalize()} looks exactly {'; '.join(parts)}: these readings cannot tell them apart."
            f"{left_out} {remedy}"
        )
    return tuple(said)


def standing_words(found: Standing) -> str:
    """Return what holds whatever is measured."""
    names = joined([display_name(name) for name in found.parameters])
    return {
        StandingKind.FRICTION: f"Friction in the bar or lost motion in proportion to force looks exactly like {names} "
        "in these directions. Run both directions at the same forces.",
        StandingKind.CURVATURE: "A curvature in force common to all angles (force law, mount) looks exactly like equal slopes of "
        f"{names}.",
        StandingKind.LOBES: f"{names} and the 4-lobe form of the balls are told apart by force alone.",
        StandingKind.DRIFT: f"The tests record {found.over}, the model has no drift over it: what changes steadily counts as "
        f"set-up shift, and as compliance where the forces were run in order. Ask for it (--drift {found.over}).",
    }[found.kind]


# ---- fit


def check_words(check: Check) -> str:
    """Return what a check looks at: order 4 of f520."""
    kinds = {
        CheckKind.ORDER: f"order {check.order}",
        CheckKind.NOISE: "white noise",
        CheckKind.AUTOCORRELATION: "autocorrelation",
    }
    return f"{kinds[check.kind]} of {check.test}"


def fit_verdict(fit: Fit) -> str:
    """Return in one line whether the numbers can be used, and what to look at."""
    kinds = {concern.kind for concern in fit.concerns}
    if ConcernKind.NOT_CONVERGED in kinds:
        return "NOT CONVERGED: do not use the numbers."
    moved = f"{len(fit.sensitive)} of {len(fit.sensitivity)} numbers are sensitive to their prior"
    shown = ", ".join(fit.sensitive[:_FEW]) + (", …" if len(fit.sensitive) > _FEW else "")
    doubt = "the readings speak against non-negative compliance" if ConcernKind.TRUNCATION in kinds else expectation(fit)
    return f"Converged; {doubt}; {moved}{f' ({shown})' if fit.sensitive else ''}."


def expectation(fit: Fit) -> str:
    """Return whether the model expects readings like these."""
    misfits = [check_words(check) for check in fit.misfits]
    if misfits:
        shown = ", ".join(misfits[:_FEW]) + (f" and {len(misfits) - _FEW} more" if len(misfits) > _FEW else "")
        return f"the model does not expect readings like these ({shown})"
    worst, *others = fit.checks
    return f"the model expects readings like these ({1 + len(others)} checks, smallest p = {worst.p:.2g}, {check_words(worst)})"


def concern_sentences(concerns: tuple[Concern, ...], sampler: Mapping[str, Any]) -> Iterator[str]:
    """Return a sentence or two on every concern; ``sampler`` is that part of the record."""
    for concern in concerns:
        value, limit = concern.value, concern.limit
        if concern.kind == ConcernKind.NOT_CONVERGED:
            independent = "ask for more independent draws (a larger --ess)"
            cure = independent if sampler["kind"] == "independent" else "allow more steps (--max-steps)"
            target = f"ESS ≥ {limit:g} and R-hat ≤ {sampler['target_rhat']:g}"
            yield f"Not converged: {target} was not reached in {value:.0f} steps. Do not use the numbers; {cure}."
        elif concern.kind == ConcernKind.TRUNCATION:
            verb = "contradict" if value < _CONTRADICTED else "speak against"
            yield (
                f"The readings {verb} non-negative compliance: ln P(T | y) = {value:.1f} (expected above {limit:.1f}). "
                "A nuisance may be missing, or a sign, a force or the mount compensation be wrong."
            )
        elif concern.kind == ConcernKind.FORCES and value == 1:
            yield "One force level: constant compliance and geometry are told apart by their priors alone."
        elif concern.kind == ConcernKind.FORCES:
            yield (
                f"Only {value:.0f} force levels: at degree {limit - 2:.0f} compliance and geometry need {limit:.0f} to be told "
                "apart by the readings; here their priors do it."
            )
        else:
            yield (
                f"Misfit: {concern.name} = {value * 1e3:.3g} µm lies far above what its prior expects ({limit * 1e3:.3g} µm at "
                "99.9 %). The model misses something in these readings."
            )


def fit_sentences(result: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what was fitted, how well it went, and every warning."""
    campaign, model, sampler, fit = result["campaign"], result["model"], result["sampler"], result["fit"]
    degree = _IN_FORCE[model["degree"]]
    return (
        f"Verdict: {fit['verdict']}",
        f"{campaign['name']}: {campaign['tests']} tests, {campaign['readings']} readings.",
        f"Compliance {degree}, preset {model['preset']}{model_changes(model)}, reference force {model['reference_force_N']:g} N.",
        f"RMSE {fit['rmse_um']:.2f} µm (machine and shared nuisances); linear for exact geometry costs at most "
        f"{fit['linearisation_error_um']:.4f} µm. ln P(T | y) = {fit['log_prob_truncation']:.2f}.",
        f"Sampler {sampler['kind']}: {'' if sampler['converged'] else 'NOT CONVERGED, '}ESS bulk {sampler['ess_bulk_min']:.0f}, "
        f"tail {sampler['ess_tail_min']:.0f}, R-hat {sampler['rhat_max']:.4f}, {sampler['seconds']:.1f} s.",
        *(f"Note: {warning}" for warning in fit["warnings"]),
    )


def model_changes(model: Mapping[str, Any]) -> str:
    """Return how the model differs from its preset."""
    if model["preset"] == "paper":
        return " (least squares: the intervals cover white noise alone)"
    default = HybridModel.default().terms
    there = (*model["terms"], *model.get("idle_terms", ("Hysteresis",)))
    missing = [name for name in default if name not in there] + ([] if model["truncated"] else ["truncation"])
    words = [f"without {', '.join(missing)}"] if missing else []
    words += [f"with {', '.join(more)}"] if (more := [name for name in model["terms"] if name not in default]) else []
    words += ["with edited priors"] if model["priors"] == "edited" else []
    return f" {' and '.join(words)}" if words else ""


def two_fits_sentences(constant: Mapping[str, Any], linear: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what the two fits say, in three sentences."""
    direct = [name for name in constant["parameters"] if is_direct(name)]
    known = []
    for name in direct:
        entry = constant["parameters"][name]
        value, expanded = value_and_uncertainty(entry["mean"] * 1e3, 2e3 * entry["sd"])
        known.append(f"{name} = {value} ± {expanded} µm/N")
    slopes = [name for name in linear["parameters"] if name.endswith("_1")]
    away = [name for name in slopes if linear["parameters"][name]["ci95"][0] > 0 or linear["parameters"][name]["ci95"][1] < 0]
    says = (
        f"the 95 % interval of {', '.join(away)} excludes zero"
        if away
        else "the 95 % interval of every force slope contains zero"
    )
    gain = 100.0 * (1.0 - linear["fit"]["rmse_um"] / constant["fit"]["rmse_um"])
    rough = [
        display_name(name)
        for name, entry in constant["parameters"].items()
        if name.startswith("E_") and abs(entry["mean"]) < 2.0 * entry["sd"]
    ]
    return (
        f"With constant compliance {', '.join(known)}: these intervals include what the mount, the force and the balls may hide.",
        f"Linear compliance lowers the RMSE by {gain:.0f} %, but {says}: a lower RMSE alone does not show a slope.",
        f"Geometric errors not told from zero (k = 2): {', '.join(rough) or 'none'}; most of their uncertainty is "
        "the form of the balls and the length of the bar, which more readings do not reduce.",
    )


# ---- campaign


def _machine(topology: str, plane: str, radii_mm: Sequence[float]) -> str:
    several = ", each with a length of its own." if len(radii_mm) > 1 else "."
    return f"Machine {topology}, plane {plane}, R = {', '.join(f'{r:g}' for r in radii_mm)} mm{several}"


def _frames(frames_mm: Mapping[str, Sequence[float]]) -> str:
    frames = "; ".join(f"{axis} ({', '.join(f'{x:g}' for x in at)})" for axis, at in frames_mm.items())
    return f"Joint frames stand at {frames} mm."


def _spikes(reading: int, angle_deg: float, off_um: float, count: int) -> str:
    many = "" if count == 1 else f"; {count} readings do so"
    return f"reading {reading} at {angle_deg:g}° stands {off_um:+.1f} µm off its neighbours{many}"


def _mount(deflection_um_per_bar: float, compensated: bool) -> str:
    state = "already compensated" if compensated else "not compensated: the nominal deflection will be subtracted"
    return f"Mount (Eq. 32) {deflection_um_per_bar:g} µm/bar, {state}."


_SHARED = "the tool ball's offsets are shared"
_REMARKS: Mapping[RemarkKind, Callable[..., str]] = {
    RemarkKind.TRAVEL: lambda stated, travel: f"stated {stated}, but the angles run {travel}",
    RemarkKind.ARC: lambda arc_deg: f"arc of {arc_deg:.0f}° only: harmonics mix",
    RemarkKind.GAP: lambda gap_deg: f"gap of {gap_deg:.1f}°",
    RemarkKind.OPEN: lambda start_end_um: (
        f"start and end differ by {start_end_um:+.1f} µm more than the path does there: drift, or a trace that does not close"
    ),
    RemarkKind.EQUAL: lambda: "all readings equal",
    RemarkKind.SMALL: lambda: "readings hardly exceed the resolution: check their unit",
    RemarkKind.LARGE: lambda: "readings span more than 1 mm: check their unit",
    RemarkKind.FORCE_LAW: lambda force_N, law_N, pressure_bar: (
        f"force {force_N:g} N, but the force law gives {law_N:.0f} N at {pressure_bar:g} bar"
    ),
    RemarkKind.SPIKES: _spikes,
    RemarkKind.STEP: lambda step_um, stated_um: (
        f"readings go in steps of {step_um:.3g} µm, the campaign states a resolution of {stated_um:g} µm, below whose √12th part "
        "no noise is looked for: state the step (--resolution-um, or resolution_um in campaign.toml)"
    ),
    RemarkKind.ONE_LEVEL: lambda: (
        "One force level: constant compliance and geometry are told apart by their priors alone; degree 0 only. "
        "Test a second force."
    ),
    RemarkKind.TWO_LEVELS: lambda: (
        "Two force levels: constant compliance only is checked by the readings; a slope needs a third."
    ),
    RemarkKind.SMALL_FORCE: lambda force_N: f"The largest force is {force_N:g} N: check the unit of force_N.",
    RemarkKind.RADIUS: lambda radius_mm: f"A radius is {radius_mm:g} mm: check the unit of radius_mm.",
    RemarkKind.COPY: lambda first, second: f"Tests {first} and {second} hold the same readings: a file read twice?",
    RemarkKind.ONE_WAY: lambda compliance, plane: (
        f"One direction of travel (or none stated){f' in plane {plane}' if plane else ''}: friction in the bar cannot be told "
        f"from {compliance}."
    ),
    RemarkKind.SORTED: lambda: (
        "Angles rise in all tests, those stated CW among them: taken as sorted, and the directions as stated."
    ),
    RemarkKind.NO_DIRECTION: lambda test: (
        f"Test {test} states no direction while others run both ways: a fit will refuse it. State it."
    ),
    RemarkKind.CENTRES: lambda setup: (
        f"Several centres in set-up {setup}: {_SHARED}, as if the work ball had been moved by exactly what the axes say. If it "
        "was mounted anew, number the set-ups."
    ),
    RemarkKind.PLANES: lambda: f"Several planes in one set-up: {_SHARED}. If the bar was mounted anew, number the set-ups.",
    RemarkKind.MACHINE: _machine,
    RemarkKind.FRAMES: _frames,
    RemarkKind.SETUPS: lambda setups: f"Set-ups {', '.join(map(str, setups))}: tool offsets of each; everything else is shared.",
    RemarkKind.BOTH_WAYS: lambda planes: f"Both directions of travel in {', '.join(planes)}: hysteresis is a term of the model.",
    RemarkKind.COVARIATE: lambda over: (
        f"Tests record {over}s; a drift over them is modelled only when asked for (--drift {over})."
    ),
    RemarkKind.READINGS: lambda resolution_um: f"Readings are actual ball distance − R; readout resolution {resolution_um:g} µm.",
    RemarkKind.MOUNT: _mount,
    RemarkKind.FORCES: lambda slope_N_per_bar, offset_N: (
        f"Force law F = {slope_N_per_bar:g} N/bar · P {offset_N:+g} N, where a test gives only one of the two."
    ),
    RemarkKind.REFERENCE: lambda force_N: f"Reference force F0 = {force_N:g} N, the middle of the tested range.",
    RemarkKind.BALLS: lambda clocked: (
        "Balls clocked between tests: two forms."
        if clocked
        else "No ball clocked between tests: one form, the sum of both balls."
    ),
}


def remark_words(remark: Remark) -> str:
    """Return a remark of a preview in words."""
    return _REMARKS[remark.kind](**remark.values)


def look_sentences(seen: CampaignPreview) -> list[str]:
    """Return a sentence on everything that looks odd in a test."""
    return [f"Look at {test.name}: {remark_words(remark)}." for test in seen.tests for remark in test.remarks]


def preview_sentences(seen: CampaignPreview) -> tuple[str, ...]:
    """Return remarks on the tests, and what a fit will assume."""
    unstated = ["Directions in brackets are not stated: the angles run so."] * any(
        test.direction is None and test.travel is not None for test in seen.tests
    )
    lines = look_sentences(seen) + [f"Note: {remark_words(remark)}" for remark in seen.remarks]
    kind = "Plan" if seen.is_plan else "Campaign"
    return (
        "",
        f"{kind} {seen.name}, SHA-256 {seen.sha256[:16]}…",
        *unstated,
        *lines,
        "",
        "A fit will assume:",
        *(f"- {remark_words(assumed)}" for assumed in seen.assumptions),
    )


@with_words.register
def _(result: CampaignPreview) -> dict[str, Any]:
    record = {"schema": 1, **result.as_dict()}
    pairs: list[tuple[dict[str, Any], Any]] = [(record, result), *zip(record["tests"], result.tests, strict=True)]
    for own, found in pairs:
        own["kinds"] = [str(remark.kind) for remark in found.remarks]
        own["remarks"] = [remark_words(remark) for remark in found.remarks]
    record["assumptions"] = [remark_words(remark) for remark in result.assumptions]
    return record


# ---- machine


def machine_sentences(found: DescribedMachine) -> tuple[str, ...]:
    """Return joints, rank, and what does not show."""
    lines = [
        f"{found.topology}, plane{'s' if len(found.planes) > 1 else ''} {', '.join(found.planes)}. {'; '.join(found.joints)}.",
        "Patterns: change of the reading per unit, of a compliance per unit and N; c = cos θ, s = sin θ, lengths in mm.",
        "Rotary joints, and slides that no plane here drives, count as rigid.",
        *_centres(found),
        f"{found.rank} compliances can be told apart; condition number of their columns {found.condition_number:.6g} "
        "(mm, N, R = 150 mm).",
    ]
    if found.null:
        lines.append(f"Never seen: {', '.join(found.null)}.")
    bounded = [display_name(entry.name) for entry in found.compliances if entry.not_negative]
    lines.append(f"Cannot be negative: {', '.join(bounded) or 'none'}.")
    if found.dependent:
        lines.append(
            f"Combinations of several of those above, left out: {', '.join(found.dependent)}. What they are goes into the others."
        )
    return tuple(lines)


def _centres(found: DescribedMachine) -> list[str]:
    if not any(any(centre) for centre in found.centres_mm):
        return []
    listed = "; ".join(f"({', '.join(f'{x:g}' for x in centre)})" for centre in found.centres_mm)
    first = " Patterns are those at the first; what can be told apart is of all together." if len(found.centres_mm) > 1 else ""
    return [f"Circles centred at {listed} mm.{first}"]


def sum_in_words(seen: Seen) -> str:
    """C_XXX + C_XXY; weights where they are not one, in mm and mm²."""
    text = ""
    for name, weight in seen.members.items():
        size = "" if abs(weight) == 1.0 else f"{abs(weight):g} "
        sign = ("−" if weight < 0 else "") if not text else (" − " if weight < 0 else " + ")
        text += f"{sign}{size}{display_name(name)}"
    return text


# ---- identifiability


def verdict_words(entry: ParameterIdentifiability) -> str:
    """Return the verdict with the share of the variance that every partner holds."""

    def share(partner: str) -> str:
        return f"{100.0 * entry.partner_shares[partner]:.0f} %" if partner in entry.partner_shares else "left out"

    if entry.verdict is Verdict.CONFOUNDED:
        return "confounded with " + " and ".join(f"{term_words(partner)} ({share(partner)})" for partner in entry.partners)
    plain = ", ".join(f"{term_words(partner)} {share(partner)}" for partner in entry.partners)
    return f"{entry.verdict} ({plain})" if plain else str(entry.verdict)


def basis_words(found: Identifiability) -> str:
    """Return what the numbers rest on."""
    values = ", ".join(f"{name} = {value:.2g} µm" for name, value in found.hyper_um.items())
    return f"At {values} ({'posterior mean' if found.measured else 'prior median; no readings'}), without truncation."


@with_words.register
def _(result: Identifiability) -> dict[str, Any]:
    record = result.as_dict()
    record.pop("cures")
    for own, found, cure in zip(record["degeneracies"], result.degeneracies, result.cures, strict=True):
        own |= {"statement": statement(found), "cure": cure_words(found, cure)}
    return record | {"notes": [standing_words(own) for own in result.standing]}


def identifiability_sentences(result: Identifiability) -> tuple[str, ...]:
    """Return what the table rests on, the degeneracies with their cures, and the standing ones."""
    lines = [
        basis_words(result),
        f"Effective number of parameters {result.effective_parameters:.1f} of {len(result.parameters)} (what the readings narrow "
        "against the priors; a confounded parameter may be narrowed and still not known); condition number of their design "
        f"{result.condition_number:.2g} as it stands, {result.scaled_condition_number:.2g} in units of the prior sd.",
        "Contraction 1 − (sd / prior sd)²; a term's share is what knowing it would take from the variance.",
    ]
    if result.degeneracies:
        lines += ["", "No reading of this campaign can tell apart:"]
        for degeneracy, cure in zip(result.degeneracies, result.cures, strict=True):
            lines += [f"- {statement(degeneracy)}", f"  What would: {cure_words(degeneracy, cure)}"]
    return (*lines, *(f"- {standing_words(own)}" for own in result.standing))


# ---- calibration


def validation_verdict(validation: Validation) -> str:
    """Return in one line whether ranks are as those of a calibrated computation."""
    tested = f"{validation.replicates} replicates, {len(validation.names)} quantities, {100 * validation.prob:g} % band"
    if validation.failures:
        count, first = len(validation.failures), validation.failures[0]
        return f"NOT CALIBRATED: {count} replicates failed, first: {first} ({tested})."
    if validation.outside:
        return f"NOT CALIBRATED: the ranks of {', '.join(validation.outside)} leave the band ({tested})."
    return f"Calibrated as far as {tested} can tell."


@with_words.register
def _(result: Validation) -> dict[str, Any]:
    return {**result.as_dict(), "verdict": validation_verdict(result)}


# ---- comparison

_STRENGTHS = ((1.0, "not worth more than a bare mention"), (3.0, "positive evidence"), (5.0, "strong evidence"))
_SURE = 0.95
_DISAGREE = 0.05
_SIGNS = {
    Sign.OPEN: "The sign is NOT robust: it depends on what is assumed.",
    Sign.HELD: "The sign holds under every assumption that the readings do not reject.",
    Sign.FIRM: "The sign holds under every assumption tried.",
}


def strength_words(log_bayes_factor: float) -> str:
    """Words for a log Bayes factor of either sign (Kass and Raftery, J. Am. Stat. Assoc. 90, 773-795, 1995)."""
    return next((words for limit, words in _STRENGTHS if abs(log_bayes_factor) < limit), "very strong evidence")


def subset_words(subset: SlopeSubset) -> list[str]:
    """C_XYX, C_YYY²: the compliances that vary with force, ² where quadratically."""
    return [f"{name}{'²' if subset.powers[name] > 1 else ''}" for name in subset.varying] or ["none"]


def comparison_sentences(comparison: Comparison) -> tuple[str, ...]:
    """The verdict: the evidence, whether its sign is robust, and what else speaks."""
    parts = (_second_route, _robustness, _left_out, _slopes, _fit)
    notes = [sentence for part in parts for sentence in part(comparison)]
    if comparison.differing_priors:
        listed = joined(comparison.differing_priors)
        notes.append(f"The models give {listed} different priors: the Bayes factor compares these too.")
    return (evidence_sentence(comparison), *notes)


@with_words.register
def _(result: Comparison) -> dict[str, Any]:
    sentences = comparison_sentences(result)
    return {**result.as_dict(), "verdict": " ".join(sentences), "sentences": list(sentences)}


def evidence_sentence(comparison: Comparison) -> str:
    """What the evidence says, in whose favour."""
    first, second = comparison.pair
    ratio = comparison.sensitivity_of
    value, error = comparison.log_bayes_factor[ratio], comparison.log_bayes_factor_error[ratio]
    either = abs(value) < _STRENGTHS[0][0]
    says = (
        f"{strength_words(value)} either way"
        if either
        else f"{strength_words(value)}, in favour of {second if value > 0 else first}"
    )
    shares = joined([f"{name} {_share(model.posterior_probability)}" for name, model in comparison.models.items()])
    return f"ln B({ratio}) = {value:+.2f} ± {_error(error)}: {says}. Probabilities at equal prior odds: {shares}."


def sign_sentence(comparison: Comparison) -> str:
    """How robust the sign of the log Bayes factor is."""
    return _SIGNS[comparison.sign]


def _second_route(comparison: Comparison) -> Iterator[str]:
    for ratio, other in comparison.savage_dickey.items():
        direct, error = comparison.log_bayes_factor[ratio], comparison.log_bayes_factor_error[ratio]
        gives = f"gives ln B({ratio}) = {other.log_bayes_factor:+.2f} ± {_error(other.error)}"
        if abs(other.log_bayes_factor - direct) <= _DISAGREE and other.error <= _DISAGREE:
            yield f"A second route (Savage-Dickey) {gives}."
        else:
            both = f"{gives}, the first {direct:+.2f} ± {_error(error)}"
            yield f"The second route (Savage-Dickey) {both}: trust no more than they share."


def _robustness(comparison: Comparison) -> Iterator[str]:
    turning = comparison.turning()
    yield sign_sentence(comparison)
    if comparison.prior_sensitivity:
        scales = comparison.prior_sensitivity
        values = [scaled.log_bayes_factor for scaled in scales]
        zeros = joined([f"{crossing:.2g}" for crossing in comparison.prior_sensitivity_crossings])
        sign = f"changing sign at {zeros}" if zeros else "of one sign"
        yield (
            f"With slopes expected at {scales[0].slope_scale:g} to {scales[-1].slope_scale:g} times sd(C)/(F_max − F_min) "
            f"it lies between {min(values):+.1f} and {max(values):+.1f}, {sign}."
        )
    better = comparison.preferred_assumption()
    if better is not None:
        yield (
            f"The readings prefer '{better.assumption}' by {comparison.gain(better):.1f} nats to what the models assume: under "
            f"it ln B is {better.log_bayes_factor:+.1f}. Consider making it the model."
        )
    for assumed in filter(comparison.allowed, turning):
        yield (
            f"With '{assumed.assumption}' it is {assumed.log_bayes_factor:+.1f}, and the readings do not rule that assumption "
            f"out (its evidence is {comparison.gain(assumed):+.1f} nats against the models' own)."
        )
    rejected = [assumed for assumed in turning if not comparison.allowed(assumed)]
    if rejected:
        listed = joined([f"'{a.assumption}' ({a.log_bayes_factor:+.0f})" for a in rejected])
        also = "also " if comparison.sign is Sign.OPEN else ""
        least = -comparison.gain(rejected[0])
        yield f"It {also}turns with {listed}, assumptions the readings reject by {least:.0f} nats and more."
    naive = comparison.assumptions.get(WHITE_NOISE)
    if naive is not None:
        yield (
            f"White noise alone, without nuisances and truncation, would say {naive.log_bayes_factor:+.0f}: "
            f"{abs(comparison.white_noise_overstates_by_nats):.0f} nats away, because it counts every reading as an independent "
            "fact."
        )


def _left_out(comparison: Comparison) -> Iterator[str]:
    tests = comparison.tests
    if comparison.elpd_difference:
        found = comparison.elpd_difference[comparison.sensitivity_of]
        better = comparison.pair[int(found.value > 0)]
        says = "no difference to speak of" if abs(found.value) < 2.0 * found.se else f"in favour of {better}"
        yield (
            f"With one force left out at a time, {better} predicts it better by {abs(found.value):.1f} ± {found.se:.1f} nats: "
            f"{says} ({len(tests)} tests, so the ± is rough itself)."
        )
    smoothed = [name for name, test in tests.items() if not all(own.trustworthy for own in test.psis_loo.values())]
    if smoothed:
        yield (
            f"Importance sampling (PSIS-LOO) cannot be trusted for {joined(smoothed)} (Pareto k above "
            f"{tests[smoothed[0]].psis_loo_good_k:.2g}); all numbers here are the exact ones."
        )
    flagged = {name: test for name, test in tests.items() if test.flag}
    for name, test in flagged.items():
        yield (
            f"{name} does not belong with the others (family-wise p = {test.lofo_family_wise_p_value:.2g}, most in order "
            f"{test.lofo_worst_order}): look at it, and compare again without it, for it weighs on all of the above."
        )
    at_odds = [name for name, test in tests.items() if test.stands_out and not test.flag]
    if at_odds:
        yield f"{joined(at_odds)} disagree with one another, and nothing says which is wrong: add tests."
    if tests and not flagged and not at_odds:
        smallest = min(test.lofo_family_wise_p_value for test in tests.values())
        yield f"Every test belongs with the others (smallest family-wise p = {smallest:.2g})."


def _slopes(comparison: Comparison) -> Iterator[str]:
    subsets = comparison.slope_subsets
    if not subsets:
        return
    quadratic = any(slope.quadratic_probability is not None for slope in comparison.slopes.values())
    prior = "none, linear or quadratic with probability ⅓ each" if quadratic else "there or not with probability ½"
    share = {name: slope.inclusion_probability for name, slope in comparison.slopes.items()}
    listed = ", ".join(f"{name} {share[name]:.2f}" for name in ranked(share, lambda name: share[name]))
    sure = joined([name for name, p in share.items() if p >= _SURE])
    best = subsets[0]
    none = next(subset.probability for subset in subsets if not subset.varying)
    if (comparison.slope_subsets_possible or 0) > len(subsets):
        yield (
            f"Of {comparison.slope_subsets_possible} sets of slopes the {len(subsets)} found from the best to its neighbours are "
            "weighed: probabilities are among these."
        )
    yield (
        f"Slopes one by one (each {prior} beforehand): {listed}; beyond {_SURE:g}: {sure or 'none'}. No slope at all has "
        f"probability {none:.2g}, the likeliest set ({joined(subset_words(best))}) {best.probability:.2g}. "
        "A single slope asks for less evidence than all of them at once, which is what the models compared above differ by."
    )


def _fit(comparison: Comparison) -> Iterator[str]:
    smaller, larger = sorted(comparison.pair, key=lambda name: comparison.models[name].degree)
    low, high = comparison.models[smaller], comparison.models[larger]
    before, after = low.least_squares.rmse_um, high.least_squares.rmse_um
    if np.isfinite(before) and np.isfinite(after) and low.degree != high.degree:
        yield (
            f"By least squares the RMSE (Eq. 34) goes from {before:.2f} ({smaller}) to {after:.2f} µm ({larger}), "
            f"{100 * (after / before - 1):+.0f} %: more parameters always lower it, so it is no evidence by itself."
        )
    if not comparison.within_tolerance:
        error, asked = comparison.largest_error, comparison.tolerance
        yield (
            f"A log evidence has an error of {error:.2g} nats, more than the {asked:g} asked for: read ln B with that error, or "
            f"ask for a tolerance of {error:.1g} (--tolerance)."
        )


def _share(probability: float) -> str:
    return f"{probability:.3f}" if 0.001 <= probability <= 0.999 else f"{probability:.2g}" if probability < 0.5 else "> 0.999"


def _error(error: float) -> str:
    return f"{max(error, 1e-3):.1g}"


# ---- design


def place_words(row: Mapping[str, Any]) -> str:
    """Return where a test is run, from one row of a design's table or a part of it."""
    parts = []
    if row.get("plane"):
        parts.append(f"plane {row['plane']}")
    if row.get("direction"):
        parts.append(str(row["direction"]))
    if row.get("setup"):
        parts.append(f"set-up {row['setup']}")
    centre = [f"{axis} = {row[f'centre_{axis}_mm']:g} mm" for axis in "xyz" if f"centre_{axis}_mm" in row]
    if centre:
        parts.append(f"centre {', '.join(centre)}")
    if "work_ball_deg" in row:
        parts.append(f"work ball {row['work_ball_deg']:g}°, tool ball {row['tool_ball_deg']:g}°")
    if "radius_mm" in row:
        parts.append(f"R {row['radius_mm']:g} mm")
    return ", ".join(parts)


def design_sentences(design: Design, *, aliases: bool = True) -> tuple[str, ...]:
    """Return the recommendation in words, its notes last; without ``aliases`` those of nuisances are left out."""
    parts = (_tests_to_run, _quality, _widths, _decision, _over_assumptions)
    return (*(sentence for part in parts for sentence in part(design)), *design_notes(design, aliases=aliases))


def design_notes(design: Design, *, aliases: bool = True) -> tuple[str, ...]:
    """Return whether the goal is reached, what the tests do not show and what would, and what the numbers rest on."""
    return (*_goal(design), *_limits(design, aliases=aliases), _basis(design))


def tests_to_run(design: Design) -> str:
    """Return the circles of a design in one line: 6 circles: 2 × 36 N and 4 × 742 N."""
    table, columns = design.table, list(design.columns)
    clocked = bool((table[columns[:2]] != 0.0).any(axis=None))
    named = [name for name in columns if (clocked if name in columns[:2] else table[name].nunique() > 1)]
    words = []
    for row in table.to_dict(orient="records"):
        place = f" ({place_words({name: row[name] for name in named})})" if named else ""
        words.append(f"{row['count']} × {row['force_N']:.4g} N{place}")
    listed = joined(words) if len(words) <= 12 else "see the table"
    return f"{table['count'].sum()}{' more' if design.augment else ''} circles: {listed}"


def _tests_to_run(design: Design) -> Iterator[str]:
    yield f"Run {tests_to_run(design)}."


def _quality(design: Design) -> Iterator[str]:
    best = "1: the best shares; whole tests reach it at most" if design.certificate.is_global else "1: the best found nearby"
    others = []
    for own in design.compared:
        outside = ", more than 1: it uses tests that were not to be chosen from" if own.efficiency > 1.0 + 1e-6 else ""
        others.append(f"{own.name} {own.efficiency:.3f} ({len(own.tests)} circles{outside})")
    yield f"Efficiency {design.efficiency:.3f} by criterion {design.criterion} ({best}). For comparison: {joined(others)}."
    if design.efficiency < 0.5:
        yield "So few circles come nowhere near the best shares: see what more would bring, or choose among less."
    if not design.certificate.holds:
        excess = design.certificate.max_sensitivity / design.certificate.bound - 1.0
        yield f"The certificate does NOT hold: a sensitivity exceeds its bound by {excess:.1e}. Better shares may exist."


def _widths(design: Design) -> Iterator[str]:
    ratio = {name: design.expected[name].sd / design.baseline[name].sd for name in design.parameters}
    first, last = (ranked(ratio, key, tolerance=_ALIKE)[0] for key in (lambda name: -ratio[name], ratio.__getitem__))
    factor, unit = display_unit(design.expected[first].unit)
    narrow = f"{ratio[first]:.2f} times as wide for {display_name(first)} (u = {design.expected[first].sd * factor:.2g} {unit})"
    wide = f" to {ratio[last]:.2f} times for {display_name(last)}" if len(ratio) > 1 else ""
    yield f"Expected intervals against {design.compared[0].name}: {narrow}{wide}."


def _decision(design: Design) -> Iterator[str]:
    found = design.discrimination
    if found is None or not set(found.power) & set(design.parameters):
        return
    drawn = "their prior sd" if found.size == 1.0 else f"{found.size:g} prior sd"
    there = "slopes as the tests already run leave them" if found.augmented else f"slopes drawn at {drawn}"
    yield (
        f"With slopes or without (constant): with {there} |ln B| > {found.threshold:g} for them is expected with probability "
        f"{found.decisive_with:.2f}, for constant if there are none with {found.decisive_without:.2f}; misleading evidence as "
        f"strong with {found.misleading_with:.2g} and {found.misleading_without:.2g}."
    )
    alone = joined([f"{display_name(name)} {power:.2f}" for name, power in found.power.items()])
    yield f"A single slope of ± {drawn} would be found, all of them in the model, with probability: {alone}."


def _over_assumptions(design: Design) -> Iterator[str]:
    if design.robustness.empty:
        return
    over, *single, steps = design.robustness["worst"].tolist()
    yield (
        f"Good over {len(single)} assumptions: its efficiency is nowhere below {over:.2f}; that of designs made for one of them "
        f"falls to {min(single):.2f} under another, that of equal steps to {steps:.2f}."
    )


_HELPING = {
    RemedyKind.LEVELS: "force levels in between",
    RemedyKind.WORK_BALL: "the work ball clocked at 0, 45 and 90°",
    RemedyKind.TOOL_BALL: "the tool ball clocked at 0, 45 and 90°",
    RemedyKind.BOTH_BALLS: "both balls clocked at 0, 45 and 90°",
}


def _goal(design: Design) -> Iterator[str]:
    goal = design.goal
    if goal is None:
        return
    if goal.power is None:
        units = {name: display_unit(design.expected[name].unit) for name in goal.targets}
        aim = joined(
            [f"u({display_name(name)}) ≤ {sd * units[name][0]:.3g} {units[name][1]}" for name, sd in goal.targets.items()]
        )
    else:
        aim = f"a probability of {goal.power:g} of decisive evidence (|ln B| > {goal.threshold:g})"
    if goal.outcome is Outcome.ALREADY:
        yield f"The tests already run reach {aim}: no more are needed."
    elif goal.outcome is Outcome.REACHED:
        yield f"{'1 circle is' if goal.tests == 1 else f'{goal.tests} circles are'} the fewest found that reach {aim}."
    else:
        yield f"No number of these circles up to {goal.most} reaches {aim}."
        helping = [
            f"{_HELPING.get(own.kind, f'a second radius of {own.radius_mm or 0.0:g} mm')} ({own.tests} circles)"
            for own in goal.remedies
        ]
        if helping:
            yield f"What would reach it: {joined(helping, 'or')}. The design shown is the best without."
        else:
            yield "Neither clocking the balls, nor a second radius, nor other levels in this range would."


def _limits(design: Design, *, aliases: bool) -> Iterator[str]:
    limits = design.limits
    if limits.clockings_of_budget:
        yield "Efficiency and certificate are among the clockings chosen; more of them would not pay for their set-ups."
    if limits.levels is not None:
        yield (
            f"With {limits.levels} different force{'s' if limits.levels > 1 else ''} the readings cannot show that compliance is "
            f"not {('constant', 'linear', 'quadratic')[design.degree]} in force: the design trusts the model. Another level "
            "would tell."
        )
    for plane, way in limits.one_way.items():
        yield (
            f"Its circles of plane {plane} all run {way}: they cannot show the hysteresis that is counted here, and "
            "their analysis would not have it. Take more circles, or both directions of each."
        )
    if limits.drift:
        yield (
            "Drift is taken to have nothing to do with what differs between the new circles: run them in the order given, "
            "which is at random, and record time and temperature."
        )
    if limits.shared:
        names = joined([display_name(name) for name in limits.shared])
        yield (
            f"More circles of this kind, at whatever forces, would narrow {names} by less than a fifth: what is left is shared "
            "by all circles."
        )
    pairs = zip(limits.degeneracies, limits.cures, strict=True)
    shown = [(found, cure) for found, cure in pairs if aliases or not found.term]
    yield from dict.fromkeys(f"{statement(found)} Cure: {cure_words(found, cure)}" for found, cure in shown)


def _basis(design: Design) -> str:
    values = ", ".join(f"{name} {value:.2g}" for name, value in design.hyper_um.items())
    source = f"what {design.pilot.name!r} leaves likely" if design.measured else "their prior"
    return (
        f"Parameters are at F0 = {design.reference_force_N:g} N. Averaged over the hyper-parameters, {source} "
        f"(root mean square {values} µm); model.toml beside a written plan keeps F0 and the slopes' prior for its analysis."
    )


@with_words.register
def _(result: Design) -> dict[str, Any]:
    return {**result.as_dict(), "notes": list(design_notes(result)), "sentences": list(design_sentences(result))}


# ---- budget and circularity


def source_words(term: str) -> str:
    """Return what a term of a budget is called."""
    return "prior of the parameters" if term == OWN else term_words(term)


_REMEDIES: Mapping[str, str] = {
    NOISE: "Take more readings per circle, or more circles.",
    OWN: "The readings hardly tell it: run tests that do (design).",
}


def remedy_words(budget: Budget) -> str:
    """Return what would improve a parameter most."""
    return _REMEDIES.get(budget.heaviest, Term.kinds.get(budget.heaviest, Term).remedy)


@with_words.register
def _(result: Budget) -> dict[str, Any]:
    return {**result.as_dict(), "improve": remedy_words(result)}


def budget_introduction() -> str:
    """Return how budgets are read."""
    return (
        "Contributions are independent and come from the model in one go; shares are of the posterior variance and sum to one. "
        "Type A: evaluated from the scatter of the readings; type B: from what else is known. Sensitivity: change of the "
        "estimate per unit of the source, with all other sources at work. The last column of the first table is the standard "
        "uncertainty that would be left if the largest term were known exactly: less than its share alone leaves, where knowing "
        "it lets the readings say more of the others; – where the largest is noise or a prior, which nothing makes known."
    )


def budget_line(budget: Budget) -> str:
    """Return a parameter's standard uncertainty."""
    factor, unit = display_unit(budget.unit)
    return f"{display_name(budget.parameter)}: u = {round_uncertainty(budget.u * factor)[0]} {unit}"


def path_introduction(squareness: Sequence[str], percent: str) -> str:
    """Return what the circular-test quantities are."""
    return (
        "Circular deviation G, radial deviations F_max and F_min about the least-squares circle (ISO 230-4), and from the second "
        f"harmonic squareness (in the sense and sign of {joined([display_name(name) for name in squareness])}) and scale "
        "mismatch (gain of the first axis less that of the second), as a circle shows them: under load compliance is in them. Of "
        f"the machine's own path, without balls, bar, mount and tool offsets: median and {percent} interval; 0 N is geometry "
        "alone. G is a largest difference: where the path is hardly known it is more often too large than too small."
    )


# ---- population and trend

_CAVEATS = {
    "excluded": "Left out, as was asked for: {names}.",
    "before": "Left out, for no date, or one before {text}: {names}.",
    "failed": "Left out, for they could not be fitted: {names}.",
    "no-statistics": "Left out, for they have no sufficient statistics (flat priors, or a breakdown: see warnings): {names}.",
    "given-again": "Left out, for their readings are those of campaigns before them: {names}.",
    "unexpected": "Left out, for the model does not expect their readings (see their verdicts; --include-misfits keeps them): "
    "{names}.",
    "unexpected-kept": "The model does not expect the readings of {names}: kept, as was asked for.",
    "not-converged": "Not converged, refit with more draws: {names}.",
    "not-white": "Noise that is not white, so that uncertainties may be too small: {names}.",
    "models-differ": "The campaigns were fitted with different models or priors; each one's priors are divided out.",
    "no-machines": "No campaign names its machine: all are taken as campaigns of one (machine_id in campaign.toml).",
    "failed-without-machine": "Left out, for they could not be fitted, and their machine is not named: {names}.",
    "without-machine": "Left out for naming no machine: {names}.",
    "machines-of-their-own": "Naming no machine, each counted as one of its own: {names}. Write machine_id into campaign.toml.",
    "extrapolated": "The reference force, {0:g} N, was not within the tested forces of every campaign (common to all: {1:g} to "
    "{2:g} N): compliances are extrapolated.",
    "no-common-force": "No force was tested in all campaigns: compliances are carried to one force along the slopes that were "
    "fitted.",
    "narrow-forces": "Forces that span little (the greatest below {0:g} times the least), so that length and ball form of the "
    "one bar look like compliances and do not average out: {names}.",
    "no-dates": "No campaign has a date: the order given is taken as that of time.",
    "same-dates": "Some campaigns have the same date: of those the order given is taken as that of time. A time of day tells.",
    "two-campaigns": "With two campaigns only the assumptions tell a change from what the machine changes every time.",
    "spreads-not-trusted": "The spreads cannot be trusted: Pareto's k = {0:.2f} of their weights is above {1:.2f}. Use fewer "
    "parameters or more machines.",
    "prior-spreads": "The spread of {parameters} is little more than its prior, HalfNormal({0:g} prior sd).",
    "one-instrument": "Errors of one bar, the same in all campaigns ({text}), are up to {0:.0f} % of the variance of the "
    "population's mean ({parameters}), however many machines. Where the population gives the prior of a campaign with the same "
    "bar they are counted again.",
    "changed-machines": "Campaigns of one machine contradict one another: {names}. Either it changed, or they are of two "
    "machines: its estimate is sure of what neither says, and where one bar is shared the others' move with it. Look at it over "
    "time (trend), then leave it out (--exclude) or what came before the change (--since).",
    "few-machines": "Whether a machine belongs is not judged with {0:g} machines: at least {1:g} are needed.",
    "silent-machines": "The readings tell nothing of {names}: whether they belong is not known.",
    "uncertain-p-values": "p-values that cannot be trusted, their weights being too uneven: {names}.",
    "outliers-included": "The population includes the machines that do not belong. Look at what it is without them.",
}
_LISTED, _JOINED = 5, 3
# Three decimals show no less, and never quite 0 or 1.
_UNLIKELY = 5e-4
# Family-wise p-value below which the machine farthest out is named though it may belong.
_NAMED_BELOW = 0.5


def caveat_words(caveat: Any) -> str:
    """Return a sentence or two on what is to be minded of a trend or a population."""
    more = len(caveat.names) - _LISTED
    names = ", ".join(caveat.names[:_LISTED]) + (f" and {more} more" if more > 0 else "")
    parameters = ", ".join(map(display_name, caveat.names))
    return _CAVEATS[str(caveat.kind)].format(*caveat.values, names=names, parameters=parameters, text=caveat.text)


def probability_words(probability: float) -> str:
    """Return a probability with three decimals."""
    if probability < _UNLIKELY:
        return "< 0.001"
    return "> 0.999" if probability > 1.0 - _UNLIKELY else f"{probability:.3f}"


def trend_sentences(trend: Any) -> tuple[str, ...]:
    """Return what a trend says, the most important first; its caveats are apart."""
    with units_for(trend.sizes()):
        said = [*_change(trend), *_outside(trend), *_prediction(trend)]
    again = " To watch for the next one, take the campaigns since as a series of their own." if trend.changed else ""
    said.append(f"One lasting step of one parameter is looked for, not several and not a slow drift.{again}")
    if trend.assumptions["one_instrument"]:
        said.append(
            "Not modelled: that one bar has the same length and ball form in all campaigns. That is conservative for changes, "
            "not for levels."
        )
    return tuple(said)


def _change(trend: Any) -> Iterator[str]:
    whose = f" of {trend.machine}" if trend.machine else ""
    prior, threshold = trend.assumptions["probability"], trend.assumptions["threshold"]
    yield (
        f"Over {len(trend.campaigns)} campaigns{whose} {'a' if trend.changed else 'no'} change is found: its probability is "
        f"{probability_words(trend.probability)} (before the readings {prior:g}; found means above {threshold:g})."
    )
    differing = [name for name, other in trend.sensitivity.items() if (other > threshold) != trend.changed]
    if differing:
        words = [f"{probability_words(trend.sensitivity[name])} with {name}" for name in differing]
        yield f"That hangs on assumptions: {joined(words)}."
    if not trend.changed:
        return
    name, k, own = trend.most_probable.parameter, trend.most_probable.place, trend.most_probable.change
    size, percent = plus_minus(own.size, own.sd, own.interval, own.unit), ""
    if own.percent is not None and own.percent_interval is not None:
        low, high = own.percent_interval
        percent = f", {own.percent:+.0f} % [{low:.0f}, {high:.0f}] of the level before".replace("-", "−")
    before, after = (
        trend.campaigns[t] if trend.dates[t] is None else f"{trend.dates[t].date().isoformat()} ({trend.campaigns[t]})"
        for t in (k - 1, k)
    )
    yield (
        f"It is most probably one of {display_name(name)} ({probability_words(trend.parameters[name].probability)}), then "
        f"between {before} and {after} (both: {probability_words(own.probability)}): {size}{percent}."
    )


def _outside(trend: Any) -> Iterator[str]:
    out = trend.estimates[trend.estimates["outside"]]
    if not out.empty:
        words = [
            f"{name} ({', '.join(map(display_name, own['parameter']))})" for name, own in out.groupby("campaign", sort=False)
        ]
        more = [f"{len(words) - _JOINED} more"] if len(words) > _JOINED else []
        yield f"Outside the limits drawn from the campaigns before: {joined([*words[:_JOINED], *more])}."


def _prediction(trend: Any) -> Iterator[str]:
    soon, asked = trend.detection, trend.assumptions["detect"]
    slow, horizon = [], len(soon.false_alarm)
    for k, name in enumerate(trend.parameters):
        if not np.isfinite(soon.changes[k]):
            continue
        needed = soon.campaigns(k)
        at = (needed or horizon) - 1
        share = _counted_share(float(soon.found[k, at]), float(soon.error(soon.found[k])[at]))
        step = f"{display_name(name)} {100 * asked:+.0f} %".replace("-", "−")
        if needed is None:
            slow.append(f"{step} ({share})")
            continue
        what = f"A loosened joint ({step})" if asked > 0.0 and is_direct(name) else f"A change of {step}"
        yield f"{what} would be found within {needed} campaign{'s' * (needed > 1)} with probability {share}."
    if slow:
        yield f"Hardly found within {horizon} campaigns, in brackets with what probability: {joined(slow)}."
    alarm = _counted_share(float(soon.false_alarm[-1]), float(soon.error(soon.false_alarm)[-1]))
    after = "campaign" if soon.before == 1 else f"{soon.before} campaigns"
    since = "since the change" if trend.changed else "so far"
    yield f"That counts the {after} {since}; a false alarm within the next {horizon} has probability {alarm}."


def _counted_share(share: float, error: float) -> str:
    digits = 3 if error < 0.0095 else 2
    return f"below {share + 2.0 * error:.{digits}f}" if share < error else f"{share:.{digits}f} ± {error:.{digits}f}"


def population_sentences(found: Any) -> tuple[str, ...]:
    """Return what was pooled, which machines do not belong or which is the farthest out; its caveats are apart."""
    low, high = found.forces_N
    tested = f", tested from {low:g} to {high:g} N" if low <= high else ""
    said = [f"{len(found.machine)} machines, {found.campaigns} campaigns; compliances at {found.reference_force_N:g} N{tested}."]
    said += [f"{name} does not belong with the others: {_where(found.machine[name])}." for name in found.not_belonging]
    if found.judged and not found.not_belonging:
        said.append("No machine stands out from the others (Holm, 5 %).")
        farthest = ranked(found.machine.values(), lambda own: -float(np.log(own.p_value)))[0]
        if farthest.family_wise_p_value is not None and farthest.family_wise_p_value <= _NAMED_BELOW:
            said.append(f"The farthest out: {farthest.name}, {_where(farthest)}.")
    return tuple(said)


def population_doubts(found: Any) -> tuple[str, ...]:
    """Return what is to be minded of a population, and what it does not model."""
    said = [caveat_words(caveat) for caveat in found.caveats]
    said.append(
        "Not modelled: that compliances cannot be negative, changes of a machine from campaign to campaign, and correlations of "
        "parameters from machine to machine."
    )
    if found.instrument:
        said.append(
            "Nor that one bar has the same length and ball form in all campaigns. That is conservative for differences between "
            "machines, not for the population's mean."
        )
    return tuple(said)


def _where(own: Any) -> str:
    """How far out a machine is, and in what."""
    worst = ranked(own.z, lambda name: abs(own.z[name]))[0]
    p = own.family_wise_p_value
    value = "–" if p is None else "< 0.0001" if p < 1e-4 else f"= {p:.2g}"
    return f"p {value} over all machines, most in {display_name(worst)} (z = {own.z[worst]:+.1f})"


# ---- page


def _interval(entry: Mapping[str, Any]) -> tuple[float, float]:
    low, high = next(value for key, value in entry.items() if key.startswith("ci"))
    return low, high


def percent_of(result: Mapping[str, Any]) -> str:
    """Return the probability of the intervals in the JSON of a fit: 95 %."""
    entry = next(iter(result["parameters"].values()))
    return f"{next(key for key in entry if key.startswith('ci'))[2:]} %"


def _value(result: Mapping[str, Any], name: str) -> str:
    entry = result["parameters"][name]
    return f"{display_name(name)} = {plus_minus(entry['mean'], entry['sd'], _interval(entry), entry['unit'])}"


def alert_sentences(fit: Fit, result: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what forbids or limits the use of the numbers."""
    grave = tuple(concern for concern in fit.concerns if concern.kind != ConcernKind.FORCES)
    lines = list(concern_sentences(grave, result["sampler"]))
    if fit.misfits and not {ConcernKind.NOT_CONVERGED, ConcernKind.TRUNCATION} & {concern.kind for concern in grave}:
        lines.append(f"Misfit: {expectation(fit)}. Intervals assume that the model holds.")
    if result["model"]["preset"] == "paper":
        lines.append(
            "Least squares (preset paper): the intervals cover white noise alone. Ball form, bar length, mount, force errors and "
            "what differs between circles are not in them; real uncertainties are many times larger."
        )
    return tuple(lines)


def summary_lead(result: Mapping[str, Any]) -> str:
    """Return whether the page may be used."""
    if not result["sampler"]["converged"]:
        return "The sampler has not converged: nothing below may be used."
    return str(result["fit"]["verdict"])


def compliance_summary(
    result: Mapping[str, Any], verdicts: Mapping[str, ParameterIdentifiability], budgets: Mapping[str, Budget]
) -> Iterator[str]:
    """Return the direct compliances with their stiffness, and what their uncertainty is made of."""
    names = [name for name in result["parameters"] if is_direct(name)]
    if not names:
        return
    values = []
    for name in names:
        entry, word = result["parameters"][name], verdicts[name].verdict
        stiff = stiffness(entry["median"], _interval(entry))
        doubt = f", {word}" if word is not Verdict.IDENTIFIED else ""
        values.append(f"{_value(result, name)} ({f'stiffness {stiff} N/µm' if stiff else 'negative: no stiffness'}{doubt})")
    terms = dict.fromkeys(line.term for name in names for line in budgets[name].contributions)
    share = {term: sum(budgets[name].share(term) for name in names) / len(names) for term in terms}
    first, *others = ranked(share, lambda term: share[term])
    second = f", then {source_words(others[0])} ({100 * share[others[0]]:.0f} %)" if others and share[others[0]] > 0.1 else ""
    model = result["model"]
    at = f" at {model['reference_force_N']:g} N" if model["degree"] else ""
    yield (
        f"Compliance{at}, {_DEGREES[model['degree']]} in force, ± expanded uncertainty U (k = 2), brackets {percent_of(result)} "
        f"intervals: {joined(values)}. Most of the uncertainty is {source_words(first)} ({100 * share[first]:.0f} % of the "
        f"variance){second}."
    )


def geometry_summary(result: Mapping[str, Any], verdicts: Mapping[str, ParameterIdentifiability], flat: bool) -> Iterator[str]:
    """Return which geometric errors differ from zero, and which are confounded with what."""
    entries = {name: own for name, own in result["parameters"].items() if name.startswith("E_") and name[3] != "t"}
    if not entries:
        return
    clear = [name for name, own in entries.items() if abs(own["mean"]) > 2.0 * own["sd"]]
    confounded = [name for name in entries if verdicts[name].verdict is Verdict.CONFOUNDED]
    partners = joined(list(dict.fromkeys(term_words(p) for name in confounded for p in verdicts[name].partners)))

    def listed(names: Sequence[str]) -> str:
        return joined([_value(result, name) for name in names])

    if not confounded:
        shown = f"different from zero (k = 2): {listed(clear)}" if clear else "none differs from zero (k = 2)"
        yield f"Geometric errors ({len(entries)}, without tool offsets): {shown}."
        return
    names = joined([display_name(name) for name in confounded])
    if flat:
        yield (
            f"Geometric errors: {names} look exactly like {partners}, which these intervals leave out: they are not known as "
            "well as is printed."
        )
        return
    free, rest = [name for name in clear if name not in confounded], [name for name in clear if name in confounded]
    shown = f" Different from zero (k = 2): {listed(free)}." if free else ""
    shown += f" Beyond what was assumed of these: {listed(rest)}." if rest else ""
    yield (
        f"Geometric errors: {names} are confounded with {partners}; their intervals rest on what was assumed of these, and more "
        f"readings of the same kind do not narrow them.{shown or ' None differs from zero (k = 2).'}"
    )


def comparison_summary(result: Mapping[str, Any], compared: Comparison | str) -> Iterator[str]:
    """Return whether compliance is constant or linear, and the compliances of a model that the readings prefer."""
    if not isinstance(compared, Comparison):
        yield f"Constant or linear compliance could not be compared: {compared}"
        return
    yield f"Constant or linear compliance: {evidence_sentence(compared)} {sign_sentence(compared)}"
    best = ranked(compared.models, lambda name: compared.models[name].posterior_probability)[0]
    model, degree = compared.models[best], result["model"]["degree"]
    if model.degree != degree and model.posterior_probability > 0.5:
        values = [
            f"{name} = {plus_minus(own.mean, own.sd, (own.mean - 2.0 * own.sd, own.mean + 2.0 * own.sd), own.unit)}"
            for name, own in model.parameters.items()
            if is_direct(name)
        ]
        yield (
            f"The numbers of this page are of {_DEGREES[degree]} compliance. With {best} compliance, which the readings prefer "
            f"(probability {model.posterior_probability:.3g}): {joined(values)}; to sign these, fit with --degree {model.degree}."
        )


def results_introduction(result: Mapping[str, Any]) -> str:
    """Return how the table of results is read."""
    model, percent = result["model"], percent_of(result)
    negative = " Compliances that cannot be negative are held so: read a low one as an upper limit." if model["truncated"] else ""
    at = f" C_… are values at F0 = {model['reference_force_N']:g} N, C_…_1 slopes there." if model["degree"] else ""
    return (
        f"Compliance {_IN_FORCE[model['degree']]}, as it was fitted (whether the readings prefer it: Constant or linear).{at} u "
        "is the standard uncertainty (posterior standard deviation), U = 2u the expanded one (k = 2, about 95 %); where the "
        f"distribution is skewed, the distances to the ends of the {percent} credible interval stand in its place. Brackets, of "
        f"the stiffness too, are {percent} intervals. A compliance stands for the sum of its set.{negative} The last column is "
        "what the readings tell of the parameter: identified, prior-limited (mostly what was assumed), or confounded with what "
        "they cannot separate from it; in brackets what knowing a term would take from its variance. Such shares overlap; those "
        "of the budgets below sum to one."
    )


def limits_sentences(found: Identifiability, flat: bool) -> Iterator[str]:
    """Return what is read before the degeneracies."""
    if not found.degeneracies:
        yield "No combination of parameters and nuisances is unseen."
        return
    assumed = "The model leaves it out (least squares)." if flat else "Only what was assumed separates it."
    yield f"However many readings of this kind are taken, what follows looks the same to them. {assumed}"


def degeneracy_items(found: Identifiability) -> tuple[str, ...]:
    """Return every degeneracy with what would separate it."""
    pairs = [(own, cure_words(own, cures)) for own, cures in zip(found.degeneracies, found.cures, strict=True)]
    return tuple(f"{statement(own)} What would: {cure[0].lower()}{cure[1:]}" for own, cure in pairs)


def effective_sentence(found: Identifiability) -> str:
    """Return how many parameters the readings determine."""
    return (
        f"Effective number of parameters {found.effective_parameters:.1f} of {len(found.parameters)}: how much the readings "
        "narrow against the priors, in parameters. A confounded one may be narrowed and still not known. "
        f"{basis_words(found)}"
    )


def fit_introduction(quality: Mapping[str, Any]) -> str:
    """Return how well the model fits."""
    return (
        f"RMSE {quality['rmse_um']:.2f} µm over all readings (Eq. 34; machine and shared nuisances). The linear model differs "
        f"from the exact geometry by at most {quality['linearisation_error_um']:.4f} µm. ln P(T | y) = "
        f"{quality['log_prob_truncation']:.2f} (before: {quality['log_prob_truncation_prior']:.2f}), the log probability that "
        "the compliances restricted to non-negative values would be so without the restriction: far below −4 the readings "
        "contradict it."
    )


def sampler_sentences(sampler: Mapping[str, Any]) -> str:
    """Return whether the sampler reached its target, and what its figures mean."""
    state = "reached its target" if sampler["converged"] else "did NOT reach its target"
    return (
        f"Sampler {sampler['kind']} {state} (ESS ≥ {sampler['target_ess']:g}, R-hat ≤ {sampler['target_rhat']:g}): "
        f"{sampler['draws']} draws, {sampler['steps']} steps, smallest bulk ESS {sampler['ess_bulk_min']:.0f}, smallest tail ESS "
        f"{sampler['ess_tail_min']:.0f}, largest R-hat {sampler['rhat_max']:.4f}. ESS: independent draws the result is worth. "
        "R-hat: independent runs compared, 1 when they agree."
    )


def prior_sentences(result: Mapping[str, Any], flat: bool) -> str:
    """Return terms and priors of a model."""
    model = result["model"]
    idle = f" Idle here: {', '.join(map(term_words, model['idle_terms']))}." if model.get("idle_terms") else ""
    fixed = f" Fixed at zero: {', '.join(model['fixed'])}." if model.get("fixed") else ""
    terms = (
        f"Preset {model['preset']}, priors {model['priors']}; terms: {', '.join(map(term_words, model['terms']))}.{idle}{fixed}"
    )
    if flat:
        return f"{terms} Priors are flat (least squares), that of σ half-normal."
    greek = {"sigma": "σ", "delta": "δ", "kappa": "κ", "tau": "τ"}
    hypers = joined(list(dict.fromkeys(greek.get(name.split("_")[0], name) for name in result["hyper"])))
    limited = ", restricted to compliances that are not negative at any tested force" if model["truncated"] else ""
    about = "the means below" if any(own.get("prior_mean") for own in result["parameters"].values()) else "zero"
    return f"{terms} Parameters have normal priors about {about}{limited}; {hypers} half-normal ones."


def method_sentences(result: Mapping[str, Any]) -> str:
    """Return the method in short."""
    nuisances = [term_words(name) for name in result["model"]["terms"] if name not in ("Compliance", "GeometricErrors")]
    integrated = (
        f"Nuisances ({joined(nuisances)}) are Gaussian and integrated out; parameters, σ and the scales are sampled."
        if nuisances
        else "No nuisance is in the model; parameters and σ are sampled."
    )
    return (
        "Readings are a linear function of joint compliances times force, geometric errors and nuisances (hybrid Jacobian), with "
        f"white noise. {integrated} Intervals are equal-tailed credible intervals: given model and readings, the parameter lies "
        "inside with the stated probability. The model is that of 'A Novel Elasto-Geometric Model Exploiting Loaded Circular "
        "Test on a Machine Tool' (the paper; Eq. and Table are its), with nuisances."
    )


def method_notes() -> tuple[str, ...]:
    """Return what a reader of the page should know of words and limits."""
    return (
        "ln B: logarithm of the Bayes factor, how much more probable one model makes the readings than the other; in nats "
        "(natural logarithms), 1 to 3 positive, 3 to 5 strong, more very strong evidence.",
        "Truncation: the condition that compliances are not negative. Discrepancy: what else differs from circle to circle.",
        "Form of the balls at orders 2 and 3 looks exactly like geometric errors; its size is learnt from the orders the machine "
        "cannot make. A ball with one strong lobe at order 2 or 3 breaks this.",
        "Compliance is quasi-static and a polynomial of force; thermal drift counts only where it was asked for.",
        "Joints that no circle of the campaign moves are taken as rigid.",
        "Type A and B follow the GUM; budgets hold at the mean hyper-parameters and are scaled to the posterior variance.",
    )


def beside_introduction(first: Mapping[str, Any], others: Sequence[Mapping[str, Any]], same_instrument: bool) -> str:
    """Return what differences between campaigns rest on; of the JSON of their fits."""
    shared = (
        "The instrument was the same (bar, balls, mount, force device): its errors cancel in the differences, as far as both "
        "campaigns see them alike. Differences are without truncation, so an interval that it had narrowed may be wider here."
        if same_instrument
        else "Instruments are taken as independent. If bar, balls, mount and force device were the same, their errors cancel and "
        "most differences are known better than stated here (--same-instrument)."
    )
    degrees = {own["model"]["degree"] for own in (first, *others)}
    unlike = " The campaigns were fitted with different degrees: only what all have is compared." if len(degrees) > 1 else ""
    return (
        f"The first campaign is {first['campaign']['name']}; the rest of the page is about it. Differences are at its reference "
        f"force {first['model']['reference_force_N']:g} N; offsets of the tool ball, which are the set-up's, are left out. "
        f"{shared}{unlike}"
    )


def change_sentence(first: str, other: str, table: pd.DataFrame, ci_prob: float) -> str:
    """Return which parameters of a campaign differ from those of the first."""
    tail = 0.5 - 0.5 * ci_prob
    clear = table[(table["probability_of_increase"] > 1.0 - tail) | (table["probability_of_increase"] < tail)]
    shown = [
        f"{display_name(str(name))} {plus_minus(row['difference'], row['sd'], (row['ci_low'], row['ci_high']), row['unit'])}"
        for name, row in clear.iterrows()
    ]
    differs = (
        f"differs from {first} (± U, k = 2): {'; '.join(shown)}" if shown else f"does not differ from {first} in any parameter"
    )
    return f"{other} {differs}. {100 * ci_prob:g} % intervals, each parameter by itself."


def difference_doubts(first: str, other: str, converged: bool, conflict: tuple[str, float] | None) -> Iterator[str]:
    """Return what forbids the use of a difference."""
    if not converged:
        yield f"Not converged: {other}. Do not use its numbers."
    if conflict is not None and conflict[1] < _CONFLICT:
        yield (
            f"Not one instrument: {first} and {other} disagree about the {nuisance_words(conflict[0])} (p = {conflict[1]:.1g}). "
            "Balls turned or changed? Do not use the differences; make the page without --same-instrument."
        )


_CONFLICT = 0.01

_AS_WORKED_OUT = (
    "As many circles in place of this campaign, of the forces between its lowest and highest, that tell most about all "
    "compliances and geometric errors together (criterion eig, expected information gain: a single interval may be wider). "
    "ldbb-bayes design has other goals: clockings, radii, directions, costs, adding to the tests already run; its result comes "
    "here with --design DIR."
)
_WORTH = 0.95


def design_introduction(given: bool) -> str:
    """Return where the recommended circles come from."""
    return "As ldbb-bayes design found it." if given else _AS_WORKED_OUT


def next_summary(budgets: Mapping[str, Budget], flat: bool, design: Design | str, given: bool) -> Iterator[str]:
    """Return what would help most, and which circles to run next."""
    if flat:
        yield "What would help most: fit with the default preset. Least squares sees nothing but white noise."
        return
    remedies: dict[str, list[str]] = {}
    for name, budget in budgets.items():
        if is_direct(name) or (name.startswith("E_") and name[3] != "t"):
            remedies.setdefault(remedy_words(budget), []).append(display_name(name))
    most = ranked(remedies.items(), lambda pair: len(pair[1]))[:2]
    yield "What would help most: " + " ".join(f"{joined(names)}: {remedy[0].lower()}{remedy[1:]}" for remedy, names in most)
    if isinstance(design, str):
        return
    ratio = {name: design.expected[name].sd / design.baseline[name].sd for name in design.parameters}
    best = ranked(ratio, lambda name: -ratio[name], tolerance=_ALIKE)[0]
    run, steps = tests_to_run(design), design.compared[0].name
    against = f"against {steps} the interval of {display_name(best)} is then {ratio[best]:.2f} times as wide"
    if given:
        yield f"Recommended next: run {run}; {against}."
    elif ratio[best] > _WORTH:
        yield (
            f"Other forces alone would not help: of as many circles the best ({run}) narrow no interval by more than "
            f"{100 * (1.0 - _WORTH):.0f} % against {steps}."
        )
    else:
        yield f"If the campaign is run anew: run {run}; {against}."


__all__ = sorted(name for name, own in globals().items() if getattr(own, "__module__", "") == __name__ and name[0] != "_")
