"""Every sentence about findings: templates, and small functions that choose among them and fill them with numbers.

Nothing decides by reading a sentence: what is decided stands in the findings. Where a list is named, `joined` joins it. The
paragraphs that introduce the page's tables are `prose`, from ``templates/prose.j2``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, singledispatch
from typing import Any

import numpy as np
import pandas as pd

from ldbb_bayes.analysis.aliases import Cure, Degeneracy, Standing, StandingKind
from ldbb_bayes.analysis.budget import Budget
from ldbb_bayes.analysis.calibration import Validation
from ldbb_bayes.analysis.comparison import Comparison, Sign
from ldbb_bayes.analysis.design.design import Design, Outcome, RemedyKind
from ldbb_bayes.analysis.identifiability import DescribedMachine, Identifiability, ParameterIdentifiability, Seen, Verdict
from ldbb_bayes.analysis.sensitivity import WHITE_NOISE, SlopeSubset
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
    stiffness,
    units_for,
    value_and_uncertainty,
)

DEGREES = ("constant", "linear", "quadratic")
IN_FORCE = ("constant", "linear in force", "quadratic in force")
# Ratios of expected sds that differ by less count as equal.
_ALIKE = 2e-3


@singledispatch
def with_words(result: Any) -> dict[str, Any]:
    """Return a result's JSON, its sentences added."""
    record: dict[str, Any] = result.as_dict()
    return record


def joined(parts: Sequence[str], word: str = "and") -> str:
    """a, b and c."""
    return f" {word} ".join(parts) if len(parts) < 3 else f"{', '.join(parts[:-1])} {word} {parts[-1]}"


def _shown(names: Sequence[str]) -> str:
    """Parameters as the paper prints them."""
    return joined([display_name(name) for name in names])


def _lowered(text: str) -> str:
    return text[:1].lower() + text[1:]


# ---- terms and aliases

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
_STANDING = {
    StandingKind.FRICTION: "Friction in the bar or lost motion in proportion to force looks exactly like {names} in these "
    "directions. Run both directions at the same forces.",
    StandingKind.CURVATURE: "A curvature in force common to all angles (force law, mount) looks exactly like equal slopes of "
    "{names}.",
    StandingKind.LOBES: "{names} and the 4-lobe form of the balls are told apart by force alone.",
    StandingKind.DRIFT: "The tests record {over}, the model has no drift over it: what changes steadily counts as set-up shift, "
    "and as compliance where the forces were run in order. Ask for it (--drift {over}).",
}


def unit_words(name: str) -> tuple[float, str]:
    """Inside value of one unit that a nuisance coefficient is read in, and its label."""
    return Term.owner(name).unit_of(name)[1:]


def nuisance_words(name: str) -> str:
    """form_cos2 → 2-lobe form (cos 2θ)."""
    return Term.owner(name).describe(name)


def term_words(term: str) -> str:
    """BallForm → ball form, SetupShift → set-up shift; a parameter's name stays."""
    spaced = re.sub(r"(?<!^)(?=[A-Z])", " ", term).lower()
    return Term.kinds[term].words if term in Term.kinds else display_name(term) if "_" in term else spaced


def source_words(term: str) -> str:
    """Return what a term of a budget is called."""
    return "prior of the parameters" if term == OWN else term_words(term)


def _three(value: float) -> str:
    """Three significant digits without an exponent."""
    if value == 0.0 or not np.isfinite(value):
        return f"{value:g}"
    decimals = max(2 - int(np.floor(np.log10(abs(float(f"{value:.2e}"))))), 0)
    return f"{value:.{decimals}f}" if decimals <= 6 else f"{value:.2e}"


def _change(name: str, change: float, unit: str) -> str:
    """+6.67 µm/m of E_XX1."""
    factor, label = display_unit(unit)
    value = abs(change) * factor
    if value < 0.01 and label.startswith("µ"):
        value, label = value * 1e3, "n" + label[1:]
    return f"{'+' if change > 0 else '−'}{_three(value)} {label} of {display_name(name)}"


def _company(lead: str, amount: float, name: str, change: float) -> str:
    """0.5 times as much mount deflection; of another unit, how much."""
    (_, unit), (own, other) = unit_words(lead), unit_words(name)
    ratio = change / own if unit != other else change / amount
    digits = f"{ratio:.2g}".replace("-", "−")
    if unit != other:
        return f"{digits} {other} of {nuisance_words(name)}"
    much = {1.0: "as much", -1.0: "minus as much"}.get(round(ratio, 6), f"{digits} times as much")
    return f"{much} {nuisance_words(name)}"


def statement(found: Degeneracy) -> str:
    """Return a degeneracy with its exchange rate: what looks like what, and how much of it."""
    left_out = "" if found.modelled else "; the model leaves it out, and the intervals do not cover it"
    combined, units = found.combination, found.units
    if not found.term:
        subject = joined([_change(name, combined[name], units[name]) for name in found.parameters])
        company = f" in company with {len(found.nuisances)} nuisances" if found.nuisances else ""
        return f"{subject}{company} together change no reading{left_out}."
    lead, *others = found.nuisances
    amount, (one, unit) = combined[lead], unit_words(lead)
    subject = f"{f'{amount / one:g}' if unit == '%' else _three(amount / one)} {unit} of {nuisance_words(lead)}"
    if len(others) > 3:
        subject += f" in company with {len(others)} other nuisances"
    elif others:
        subject += f" with {joined([_company(lead, amount, name, combined[name]) for name in others])}"
    looks = joined([_change(name, -combined[name], units[name]) for name in found.parameters])
    if len(found.parameters) == 2:
        (first, second), (a, b) = found.parameters, (-combined[name] for name in found.parameters)
        # Two that go opposite ways by as much: their difference.
        if units[first] == units[second] and abs(a + b) < 1e-6 * abs(a):
            factor, label = display_unit(units[first])
            looks += f" ({_three(abs(a - b) * factor)} {label} of {display_name(first)} − {display_name(second)})"
    return f"{subject} looks exactly like {looks}{left_out}."


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
    sentences = []
    for term, members in by_term.items():
        if not term:
            sentences += [f"{_shown(member.parameters)} cannot be told apart by these readings." for member in members]
            continue
        alike: dict[tuple[str, ...], list[str]] = {}
        for member in members:
            name = member.nuisances[0]
            alike.setdefault(member.parameters, []).append(Term.owner(name).pattern(name).strip())
        looks = "; ".join(f"like {_shown(names)} {', '.join(patterns)}".strip() for names, patterns in alike.items())
        left_out = "" if members[0].modelled else " The model leaves it out: the intervals do not cover it."
        remedy = Term.kinds.get(term, Term).remedy
        words = term_words(term).capitalize()
        sentences.append(f"{words} looks exactly {looks}: these readings cannot tell them apart.{left_out} {remedy}")
    return tuple(sentences)


def standing_words(found: Standing) -> str:
    """Return what holds whatever is measured."""
    return _STANDING[found.kind].format(names=_shown(found.parameters), over=found.over)


# ---- fit

_FEW = 3
_CONTRADICTED = -13.815510557964274  # ln 1e-6
_CONCERNS = {
    "not-converged": "Not converged: ESS ≥ {limit:g} and R-hat ≤ {rhat:g} was not reached in {value:.0f} steps. Do not use the "
    "numbers; {cure}.",
    "truncation": "The readings {verb} non-negative compliance: ln P(T | y) = {value:.1f} (expected above {limit:.1f}). A "
    "nuisance may be missing, or a sign, a force or the mount compensation be wrong.",
    "one-force": "One force level: constant compliance and geometry are told apart by their priors alone.",
    "forces": "Only {value:.0f} force levels: at degree {degree:.0f} compliance and geometry need {limit:.0f} to be told apart "
    "by the readings; here their priors do it.",
    "hyper": "Misfit: {name} = {um:.3g} µm lies far above what its prior expects ({limit_um:.3g} µm at 99.9 %). The model misses "
    "something in these readings.",
}


def check_words(check: Check) -> str:
    """Return what a check looks at: order 4 of f520."""
    kinds = {CheckKind.NOISE: "white noise", CheckKind.AUTOCORRELATION: "autocorrelation"}
    return f"{kinds.get(check.kind, f'order {check.order}')} of {check.test}"


def fit_verdict(fit: Fit) -> str:
    """Return in one line whether the numbers can be used, and what to look at."""
    kinds = {concern.kind for concern in fit.concerns}
    if ConcernKind.NOT_CONVERGED in kinds:
        return "NOT CONVERGED: do not use the numbers."
    moved = f"{len(fit.sensitive)} of {len(fit.sensitivity)} numbers are sensitive to their prior"
    which = ", ".join(fit.sensitive[:_FEW]) + (", …" if len(fit.sensitive) > _FEW else "")
    doubt = "the readings speak against non-negative compliance" if ConcernKind.TRUNCATION in kinds else expectation(fit)
    return f"Converged; {doubt}; {moved}{f' ({which})' if which else ''}."


def expectation(fit: Fit) -> str:
    """Return whether the model expects readings like these."""
    misfits = [check_words(check) for check in fit.misfits]
    if misfits:
        more = f" and {len(misfits) - _FEW} more" if len(misfits) > _FEW else ""
        return f"the model does not expect readings like these ({', '.join(misfits[:_FEW])}{more})"
    worst, count = fit.checks[0], len(fit.checks)
    return f"the model expects readings like these ({count} checks, smallest p = {worst.p:.2g}, {check_words(worst)})"


def concern_sentences(concerns: tuple[Concern, ...], sampler: Mapping[str, Any]) -> Iterator[str]:
    """Return a sentence or two on every concern; ``sampler`` is that part of the record."""
    for own in concerns:
        more: dict[str, Any] = {"um": own.value * 1e3, "limit_um": own.limit * 1e3, "degree": own.limit - 2}
        if own.kind == ConcernKind.NOT_CONVERGED:
            independent = sampler["kind"] == "independent"
            more["rhat"] = sampler["target_rhat"]
            more["cure"] = "ask for more independent draws (a larger --ess)" if independent else "allow more steps (--max-steps)"
        more["verb"] = "contradict" if own.value < _CONTRADICTED else "speak against"
        template = _CONCERNS["one-force" if own.kind == ConcernKind.FORCES and own.value == 1 else own.kind]
        yield template.format(value=own.value, limit=own.limit, name=own.name, **more)


def fit_sentences(result: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what was fitted, how well it went, and every warning."""
    model, sampler = result["model"], result["sampler"]
    text = (
        "Verdict: {fit[verdict]}\n"
        "{campaign[name]}: {campaign[tests]} tests, {campaign[readings]} readings.\n"
        "Compliance {degree}, preset {model[preset]}{changes}, reference force {model[reference_force_N]:g} N.\n"
        "RMSE {fit[rmse_um]:.2f} µm (machine and shared nuisances); linear for exact geometry costs at most "
        "{fit[linearisation_error_um]:.4f} µm. ln P(T | y) = {fit[log_prob_truncation]:.2f}.\n"
        "Sampler {sampler[kind]}: {state}ESS bulk {sampler[ess_bulk_min]:.0f}, tail {sampler[ess_tail_min]:.0f}, R-hat "
        "{sampler[rhat_max]:.4f}, {sampler[seconds]:.1f} s."
    )
    state = "" if sampler["converged"] else "NOT CONVERGED, "
    lines = text.format(**result, degree=IN_FORCE[model["degree"]], changes=_changes(model), state=state).split("\n")
    return (*lines, *(f"Note: {warning}" for warning in result["fit"]["warnings"]))


def _changes(model: Mapping[str, Any]) -> str:
    """How the model differs from its preset."""
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
    values = []
    for name in filter(is_direct, constant["parameters"]):
        entry = constant["parameters"][name]
        values.append(f"{name} = {' ± '.join(value_and_uncertainty(entry['mean'] * 1e3, 2e3 * entry['sd']))} µm/N")
    slopes = {name: entry["ci95"] for name, entry in linear["parameters"].items() if name.endswith("_1")}
    away = ", ".join(name for name, (low, high) in slopes.items() if low > 0 or high < 0)
    says = f"the 95 % interval of {away} excludes zero" if away else "the 95 % interval of every force slope contains zero"
    gain = 100.0 * (1.0 - linear["fit"]["rmse_um"] / constant["fit"]["rmse_um"])
    errors = {name: entry for name, entry in constant["parameters"].items() if name.startswith("E_")}
    rough = [display_name(name) for name, entry in errors.items() if abs(entry["mean"]) < 2.0 * entry["sd"]]
    return (
        f"With constant compliance {', '.join(values)}: these intervals include what the mount, the force and the balls may "
        "hide.",
        f"Linear compliance lowers the RMSE by {gain:.0f} %, but {says}: a lower RMSE alone does not show a slope.",
        f"Geometric errors not told from zero (k = 2): {', '.join(rough) or 'none'}; most of their uncertainty is the form of "
        "the balls and the length of the bar, which more readings do not reduce.",
    )


# ---- campaign


def _machine(topology: str, plane: str, radii_mm: Sequence[float]) -> str:
    several = ", each with a length of its own." if len(radii_mm) > 1 else "."
    return f"Machine {topology}, plane {plane}, R = {', '.join(f'{r:g}' for r in radii_mm)} mm{several}"


def _frames(frames_mm: Mapping[str, Sequence[float]]) -> str:
    frames = "; ".join(f"{axis} ({', '.join(f'{x:g}' for x in at)})" for axis, at in frames_mm.items())
    return f"Joint frames stand at {frames} mm."


_REMARKS: Mapping[RemarkKind, str | Callable[..., str]] = {
    RemarkKind.TRAVEL: "stated {stated}, but the angles run {travel}",
    RemarkKind.ARC: "arc of {arc_deg:.0f}° only: harmonics mix",
    RemarkKind.GAP: "gap of {gap_deg:.1f}°",
    RemarkKind.OPEN: "start and end differ by {start_end_um:+.1f} µm more than the path does there: drift, or a trace that does "
    "not close",
    RemarkKind.EQUAL: "all readings equal",
    RemarkKind.SMALL: "readings hardly exceed the resolution: check their unit",
    RemarkKind.LARGE: "readings span more than 1 mm: check their unit",
    RemarkKind.FORCE_LAW: "force {force_N:g} N, but the force law gives {law_N:.0f} N at {pressure_bar:g} bar",
    RemarkKind.SPIKES: lambda reading, angle_deg, off_um, count: (
        f"reading {reading} at {angle_deg:g}° stands {off_um:+.1f} µm off its neighbours"
        f"{'' if count == 1 else f'; {count} readings do so'}"
    ),
    RemarkKind.STEP: "readings go in steps of {step_um:.3g} µm, the campaign states a resolution of {stated_um:g} µm, below "
    "whose √12th part no noise is looked for: state the step (--resolution-um, or resolution_um in campaign.toml)",
    RemarkKind.ONE_LEVEL: "One force level: constant compliance and geometry are told apart by their priors alone; degree 0 "
    "only. Test a second force.",
    RemarkKind.TWO_LEVELS: "Two force levels: constant compliance only is checked by the readings; a slope needs a third.",
    RemarkKind.SMALL_FORCE: "The largest force is {force_N:g} N: check the unit of force_N.",
    RemarkKind.RADIUS: "A radius is {radius_mm:g} mm: check the unit of radius_mm.",
    RemarkKind.COPY: "Tests {first} and {second} hold the same readings: a file read twice?",
    RemarkKind.ONE_WAY: lambda compliance, plane: (
        f"One direction of travel (or none stated){f' in plane {plane}' if plane else ''}: friction in the bar cannot be told "
        f"from {compliance}."
    ),
    RemarkKind.SORTED: "Angles rise in all tests, those stated CW among them: taken as sorted, and the directions as stated.",
    RemarkKind.NO_DIRECTION: "Test {test} states no direction while others run both ways: a fit will refuse it. State it.",
    RemarkKind.CENTRES: "Several centres in set-up {setup}: the tool ball's offsets are shared, as if the work ball had been "
    "moved by exactly what the axes say. If it was mounted anew, number the set-ups.",
    RemarkKind.PLANES: "Several planes in one set-up: the tool ball's offsets are shared. If the bar was mounted anew, number "
    "the set-ups.",
    RemarkKind.MACHINE: _machine,
    RemarkKind.FRAMES: _frames,
    RemarkKind.SETUPS: lambda setups: f"Set-ups {', '.join(map(str, setups))}: tool offsets of each; everything else is shared.",
    RemarkKind.BOTH_WAYS: lambda planes: f"Both directions of travel in {', '.join(planes)}: hysteresis is a term of the model.",
    RemarkKind.COVARIATE: "Tests record {over}s; a drift over them is modelled only when asked for (--drift {over}).",
    RemarkKind.READINGS: "Readings are actual ball distance − R; readout resolution {resolution_um:g} µm.",
    RemarkKind.MOUNT: lambda deflection_um_per_bar, compensated: (
        f"Mount (Eq. 32) {deflection_um_per_bar:g} µm/bar, "
        f"{'already compensated' if compensated else 'not compensated: the nominal deflection will be subtracted'}."
    ),
    RemarkKind.FORCES: "Force law F = {slope_N_per_bar:g} N/bar · P {offset_N:+g} N, where a test gives only one of the two.",
    RemarkKind.REFERENCE: "Reference force F0 = {force_N:g} N, the middle of the tested range.",
    RemarkKind.BALLS: lambda clocked: (
        "Balls clocked between tests: two forms."
        if clocked
        else "No ball clocked between tests: one form, the sum of both balls."
    ),
}


def remark_words(remark: Remark) -> str:
    """Return a remark of a preview in words."""
    words = _REMARKS[remark.kind]
    return words.format(**remark.values) if isinstance(words, str) else words(**remark.values)


def look_sentences(seen: CampaignPreview) -> list[str]:
    """Return a sentence on everything that looks odd in a test."""
    return [f"Look at {test.name}: {remark_words(remark)}." for test in seen.tests for remark in test.remarks]


def preview_sentences(seen: CampaignPreview) -> tuple[str, ...]:
    """Return remarks on the tests, and what a fit will assume."""
    unstated = any(test.direction is None and test.travel is not None for test in seen.tests)
    return (
        "",
        f"{'Plan' if seen.is_plan else 'Campaign'} {seen.name}, SHA-256 {seen.sha256[:16]}…",
        *(["Directions in brackets are not stated: the angles run so."] if unstated else []),
        *look_sentences(seen),
        *(f"Note: {remark_words(remark)}" for remark in seen.remarks),
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
    centres = []
    if any(any(centre) for centre in found.centres_mm):
        listed = "; ".join(f"({', '.join(f'{x:g}' for x in centre)})" for centre in found.centres_mm)
        several = " Patterns are those at the first; what can be told apart is of all together."
        centres = [f"Circles centred at {listed} mm.{several if len(found.centres_mm) > 1 else ''}"]
    bounded = [display_name(entry.name) for entry in found.compliances if entry.not_negative]
    dependent = (
        f"Combinations of several of those above, left out: {', '.join(found.dependent)}. What they are goes into the others."
    )
    return (
        f"{found.topology}, plane{'s' if len(found.planes) > 1 else ''} {', '.join(found.planes)}. {'; '.join(found.joints)}.",
        "Patterns: change of the reading per unit, of a compliance per unit and N; c = cos θ, s = sin θ, lengths in mm.",
        "Rotary joints, and slides that no plane here drives, count as rigid.",
        *centres,
        f"{found.rank} compliances can be told apart; condition number of their columns {found.condition_number:.6g} (mm, N, R = "
        "150 mm).",
        *([f"Never seen: {', '.join(found.null)}."] if found.null else []),
        f"Cannot be negative: {', '.join(bounded) or 'none'}.",
        *([dependent] if found.dependent else []),
    )


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
    known = entry.partner_shares
    shares = {p: f"{100.0 * known[p]:.0f} %" if p in known else "left out" for p in entry.partners}
    if entry.verdict is Verdict.CONFOUNDED:
        return "confounded with " + " and ".join(f"{term_words(partner)} ({share})" for partner, share in shares.items())
    plain = ", ".join(f"{term_words(partner)} {share}" for partner, share in shares.items())
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
    return (_evidence(comparison), *notes)


@with_words.register
def _(result: Comparison) -> dict[str, Any]:
    sentences = comparison_sentences(result)
    return {**result.as_dict(), "verdict": " ".join(sentences), "sentences": list(sentences)}


def _evidence(comparison: Comparison) -> str:
    """What the evidence says, in whose favour."""
    first, second = comparison.pair
    ratio = comparison.sensitivity_of
    value, error = comparison.log_bayes_factor[ratio], comparison.log_bayes_factor_error[ratio]
    favour = " either way" if abs(value) < _STRENGTHS[0][0] else f", in favour of {second if value > 0 else first}"
    shares = joined([f"{name} {_share(model.posterior_probability)}" for name, model in comparison.models.items()])
    says = f"{strength_words(value)}{favour}"
    return f"ln B({ratio}) = {value:+.2f} ± {_error(error)}: {says}. Probabilities at equal prior odds: {shares}."


def _share(probability: float) -> str:
    return f"{probability:.3f}" if 0.001 <= probability <= 0.999 else f"{probability:.2g}" if probability < 0.5 else "> 0.999"


def _error(error: float) -> str:
    return f"{max(error, 1e-3):.1g}"


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
    yield _SIGNS[comparison.sign]
    if scales := comparison.prior_sensitivity:
        values = [scaled.log_bayes_factor for scaled in scales]
        zeros = joined([f"{crossing:.2g}" for crossing in comparison.prior_sensitivity_crossings])
        yield (
            f"With slopes expected at {scales[0].slope_scale:g} to {scales[-1].slope_scale:g} times sd(C)/(F_max − F_min) it "
            f"lies between {min(values):+.1f} and {max(values):+.1f}, {f'changing sign at {zeros}' if zeros else 'of one sign'}."
        )
    if (better := comparison.preferred_assumption()) is not None:
        yield (
            f"The readings prefer '{better.assumption}' by {comparison.gain(better):.1f} nats to what the models assume: under "
            f"it ln B is {better.log_bayes_factor:+.1f}. Consider making it the model."
        )
    turning = comparison.turning()
    for assumed in filter(comparison.allowed, turning):
        yield (
            f"With '{assumed.assumption}' it is {assumed.log_bayes_factor:+.1f}, and the readings do not rule that assumption "
            f"out (its evidence is {comparison.gain(assumed):+.1f} nats against the models' own)."
        )
    if rejected := [assumed for assumed in turning if not comparison.allowed(assumed)]:
        listed = joined([f"'{a.assumption}' ({a.log_bayes_factor:+.0f})" for a in rejected])
        also, least = "also " if comparison.sign is Sign.OPEN else "", -comparison.gain(rejected[0])
        yield f"It {also}turns with {listed}, assumptions the readings reject by {least:.0f} nats and more."
    if (naive := comparison.assumptions.get(WHITE_NOISE)) is not None:
        away = abs(comparison.white_noise_overstates_by_nats)
        yield (
            f"White noise alone, without nuisances and truncation, would say {naive.log_bayes_factor:+.0f}: {away:.0f} nats "
            "away, because it counts every reading as an independent fact."
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
    if smoothed := [name for name, test in tests.items() if not all(own.trustworthy for own in test.psis_loo.values())]:
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
    if (comparison.slope_subsets_possible or 0) > len(subsets):
        yield (
            f"Of {comparison.slope_subsets_possible} sets of slopes the {len(subsets)} found from the best to its neighbours are "
            "weighed: probabilities are among these."
        )
    quadratic = any(slope.quadratic_probability is not None for slope in comparison.slopes.values())
    prior = "none, linear or quadratic with probability ⅓ each" if quadratic else "there or not with probability ½"
    share = {name: slope.inclusion_probability for name, slope in comparison.slopes.items()}
    listed = ", ".join(f"{name} {share[name]:.2f}" for name in ranked(share, lambda name: share[name]))
    sure = joined([name for name, p in share.items() if p >= _SURE]) or "none"
    none = next(subset.probability for subset in subsets if not subset.varying)
    yield (
        f"Slopes one by one (each {prior} beforehand): {listed}; beyond {_SURE:g}: {sure}. No slope at all has probability "
        f"{none:.2g}, the likeliest set ({joined(subset_words(subsets[0]))}) {subsets[0].probability:.2g}. "
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


# ---- design

_HELPING = {
    RemedyKind.LEVELS: "force levels in between",
    RemedyKind.WORK_BALL: "the work ball clocked at 0, 45 and 90°",
    RemedyKind.TOOL_BALL: "the tool ball clocked at 0, 45 and 90°",
    RemedyKind.BOTH_BALLS: "both balls clocked at 0, 45 and 90°",
}


def place_words(row: Mapping[str, Any]) -> str:
    """Return where a test is run, from one row of a design's table or a part of it."""
    centre = ", ".join(f"{axis} = {row[f'centre_{axis}_mm']:g} mm" for axis in "xyz" if f"centre_{axis}_mm" in row)
    parts = (
        f"plane {row['plane']}" if row.get("plane") else "",
        str(row.get("direction") or ""),
        f"set-up {row['setup']}" if row.get("setup") else "",
        f"centre {centre}" if centre else "",
        f"work ball {row['work_ball_deg']:g}°, tool ball {row['tool_ball_deg']:g}°" if "work_ball_deg" in row else "",
        f"R {row['radius_mm']:g} mm" if "radius_mm" in row else "",
    )
    return ", ".join(filter(None, parts))


def design_sentences(design: Design, *, aliases: bool = True) -> tuple[str, ...]:
    """Return the recommendation in words, its notes last; without ``aliases`` those of nuisances are left out."""
    parts = (_quality, _decision, _over_assumptions)
    run = f"Run {_tests_to_run(design)}."
    return (run, *(sentence for part in parts for sentence in part(design)), *design_notes(design, aliases=aliases))


def design_notes(design: Design, *, aliases: bool = True) -> tuple[str, ...]:
    """Return whether the goal is reached, what the tests do not show and what would, and what the numbers rest on."""
    values = ", ".join(f"{name} {value:.2g}" for name, value in design.hyper_um.items())
    source = f"what {design.pilot.name!r} leaves likely" if design.measured else "their prior"
    basis = (
        f"Parameters are at F0 = {design.reference_force_N:g} N. Averaged over the hyper-parameters, {source} (root mean square "
        f"{values} µm); model.toml beside a written plan keeps F0 and the slopes' prior for its analysis."
    )
    limits = design.limits
    pairs = zip(limits.degeneracies, limits.cures, strict=True)
    cures = dict.fromkeys(f"{statement(own)} Cure: {cure_words(own, cure)}" for own, cure in pairs if aliases or not own.term)
    return (*_goal(design), *_limits(design), *cures, basis)


@with_words.register
def _(result: Design) -> dict[str, Any]:
    return {**result.as_dict(), "notes": list(design_notes(result)), "sentences": list(design_sentences(result))}


def _tests_to_run(design: Design) -> str:
    """6 circles: 2 × 36 N and 4 × 742 N."""
    table, columns = design.table, list(design.columns)
    clocked = bool((table[columns[:2]] != 0.0).any(axis=None))
    named = [name for name in columns if (clocked if name in columns[:2] else table[name].nunique() > 1)]
    words = []
    for row in table.to_dict(orient="records"):
        place = f" ({place_words({name: row[name] for name in named})})" if named else ""
        words.append(f"{row['count']} × {row['force_N']:.4g} N{place}")
    listed = joined(words) if len(words) <= 12 else "see the table"
    return f"{table['count'].sum()}{' more' if design.augment else ''} circles: {listed}"


def _ratios(design: Design) -> dict[str, float]:
    """Expected sd of every parameter of interest over that of the baseline."""
    return {name: design.expected[name].sd / design.baseline[name].sd for name in design.parameters}


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
    ratio = _ratios(design)
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


def _goal(design: Design) -> Iterator[str]:
    goal = design.goal
    if goal is None:
        return
    aim = f"a probability of {goal.power or 0.0:g} of decisive evidence (|ln B| > {goal.threshold:g})"
    if goal.power is None:
        units = {name: display_unit(design.expected[name].unit) for name in goal.targets}
        sizes = {name: f"{sd * units[name][0]:.3g} {units[name][1]}" for name, sd in goal.targets.items()}
        aim = joined([f"u({display_name(name)}) ≤ {size}" for name, size in sizes.items()])
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


def _limits(design: Design) -> Iterator[str]:
    limits = design.limits
    if limits.clockings_of_budget:
        yield "Efficiency and certificate are among the clockings chosen; more of them would not pay for their set-ups."
    if limits.levels is not None:
        yield (
            f"With {limits.levels} different force{'s' if limits.levels > 1 else ''} the readings cannot show that compliance is "
            f"not {DEGREES[design.degree]} in force: the design trusts the model. Another level would tell."
        )
    for plane, way in limits.one_way.items():
        yield (
            f"Its circles of plane {plane} all run {way}: they cannot show the hysteresis that is counted here, and their "
            "analysis would not have it. Take more circles, or both directions of each."
        )
    if limits.drift:
        yield (
            "Drift is taken to have nothing to do with what differs between the new circles: run them in the order given, which "
            "is at random, and record time and temperature."
        )
    if limits.shared:
        yield (
            f"More circles of this kind, at whatever forces, would narrow {_shown(limits.shared)} by less than a fifth: what is "
            "left is shared by all circles."
        )


# ---- budget

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
        sentences = [*_change_in_time(trend), *_outside(trend), *_prediction(trend)]
    again = " To watch for the next one, take the campaigns since as a series of their own." if trend.changed else ""
    sentences.append(f"One lasting step of one parameter is looked for, not several and not a slow drift.{again}")
    if trend.assumptions["one_instrument"]:
        sentences.append(
            "Not modelled: that one bar has the same length and ball form in all campaigns. That is conservative for changes, "
            "not for levels."
        )
    return tuple(sentences)


def _change_in_time(trend: Any) -> Iterator[str]:
    whose = f" of {trend.machine}" if trend.machine else ""
    prior, threshold = trend.assumptions["probability"], trend.assumptions["threshold"]
    yield (
        f"Over {len(trend.campaigns)} campaigns{whose} {'a' if trend.changed else 'no'} change is found: its probability is "
        f"{probability_words(trend.probability)} (before the readings {prior:g}; found means above {threshold:g})."
    )
    if differing := {name: other for name, other in trend.sensitivity.items() if (other > threshold) != trend.changed}:
        yield f"That hangs on assumptions: {joined([f'{probability_words(p)} with {name}' for name, p in differing.items()])}."
    if not trend.changed:
        return
    own = trend.most_probable
    whole = trend.parameters[own.parameter]
    size, percent = plus_minus(own.change.mean, own.change.sd, own.change.interval, own.unit), ""
    if own.percent is not None and own.percent_interval is not None:
        low, high = own.percent_interval
        percent = f", {own.percent:+.0f} % [{low:.0f}, {high:.0f}] of the level before".replace("-", "−")
    visits = trend.campaigns[own.place - 1 : own.place + 1]
    before, after = (one.campaign if one.date is None else f"{one.date.date().isoformat()} ({one.campaign})" for one in visits)
    yield (
        f"It is most probably one of {display_name(own.parameter)} ({probability_words(whole.probability)}), then "
        f"between {before} and {after} (both: {probability_words(own.probability)}): {size}{percent}."
    )


def _outside(trend: Any) -> Iterator[str]:
    by_campaign = trend.estimates[trend.estimates["outside"]].groupby("campaign", sort=False)["parameter"]
    words = [f"{name} ({', '.join(map(display_name, own))})" for name, own in by_campaign]
    if words:
        more = [f"{len(words) - _JOINED} more"] if len(words) > _JOINED else []
        yield f"Outside the limits drawn from the campaigns before: {joined([*words[:_JOINED], *more])}."


def _prediction(trend: Any) -> Iterator[str]:
    alarm, asked = trend.false_alarm, trend.assumptions["detect"]
    slow, horizon = [], len(alarm.within)
    for name, own in trend.parameters.items():
        soon = own.detection
        if np.isnan(soon.found_within[0]):
            continue
        needed = soon.campaigns_for_90_percent
        at = (needed or horizon) - 1
        share = _counted_share(soon.found_within[at], soon.error[at])
        step = f"{display_name(name)} {100 * asked:+.0f} %".replace("-", "−")
        if needed is None:
            slow.append(f"{step} ({share})")
            continue
        what = f"A loosened joint ({step})" if asked > 0.0 and is_direct(name) else f"A change of {step}"
        yield f"{what} would be found within {needed} campaign{'s' * (needed > 1)} with probability {share}."
    if slow:
        yield f"Hardly found within {horizon} campaigns, in brackets with what probability: {joined(slow)}."
    after = "campaign" if alarm.campaigns_before == 1 else f"{alarm.campaigns_before} campaigns"
    since, share = "since the change" if trend.changed else "so far", _counted_share(alarm.within[-1], alarm.error[-1])
    yield f"That counts the {after} {since}; a false alarm within the next {horizon} has probability {share}."


def _counted_share(share: float, error: float) -> str:
    digits = 3 if error < 0.0095 else 2
    return f"below {share + 2.0 * error:.{digits}f}" if share < error else f"{share:.{digits}f} ± {error:.{digits}f}"


def population_sentences(found: Any) -> tuple[str, ...]:
    """Return what was pooled, which machines do not belong or which is the farthest out; its caveats are apart."""
    low, high = found.forces_N
    tested = f", tested from {low:g} to {high:g} N" if low <= high else ""
    sentences = [
        f"{len(found.machine)} machines, {found.campaigns} campaigns; compliances at {found.reference_force_N:g} N{tested}.",
        *(f"{name} does not belong with the others: {_how_far(found.machine[name])}." for name in found.not_belonging),
    ]
    if found.judged and not found.not_belonging:
        sentences.append("No machine stands out from the others (Holm, 5 %).")
        farthest = ranked(found.machine.values(), lambda own: -float(np.log(own.p_value)))[0]
        if farthest.family_wise_p_value is not None and farthest.family_wise_p_value <= _NAMED_BELOW:
            sentences.append(f"The farthest out: {farthest.name}, {_how_far(farthest)}.")
    return tuple(sentences)


def population_doubts(found: Any) -> tuple[str, ...]:
    """Return what is to be minded of a population, and what it does not model."""
    one_bar = (
        "Nor that one bar has the same length and ball form in all campaigns. That is conservative for differences between "
        "machines, not for the population's mean."
    )
    return (
        *map(caveat_words, found.caveats),
        "Not modelled: that compliances cannot be negative, changes of a machine from campaign to campaign, and correlations of "
        "parameters from machine to machine.",
        *([one_bar] if found.instrument else []),
    )


def _how_far(own: Any) -> str:
    """How far out a machine is, and in what."""
    worst = ranked(own.parameters, lambda name: abs(own.parameters[name].z))[0]
    p = own.family_wise_p_value
    value = "–" if p is None else "< 0.0001" if p < 1e-4 else f"= {p:.2g}"
    return f"p {value} over all machines, most in {display_name(worst)} (z = {own.parameters[worst].z:+.1f})"


# ---- page

_CONFLICT, _WORTH = 0.01, 0.95


@cache
def _paragraphs() -> Any:
    import jinja2

    environment = jinja2.Environment(loader=jinja2.PackageLoader("ldbb_bayes.report"), undefined=jinja2.StrictUndefined)
    environment.filters |= {"joined": joined, "names": _shown, "term": term_words}
    return environment.get_template("prose.j2").module


def prose(paragraph: str, **values: Any) -> str:
    """Return a paragraph of the page from ``templates/prose.j2``, filled with its values."""
    return " ".join(str(getattr(_paragraphs(), paragraph)(**values)).split())


def method_notes() -> tuple[str, ...]:
    """Return what a reader of the page should know of words and limits."""
    return tuple(" ".join(note.split()) for note in str(_paragraphs().notes()).split("¶"))


def interval_of(entry: Mapping[str, Any]) -> tuple[float, float]:
    """Return the credible interval in the JSON of a parameter."""
    low, high = next(value for key, value in entry.items() if key.startswith("ci"))
    return low, high


def percent_of(result: Mapping[str, Any]) -> str:
    """Return the probability of the intervals in the JSON of a fit: 95 %."""
    entry = next(iter(result["parameters"].values()))
    return f"{next(key for key in entry if key.startswith('ci'))[2:]} %"


def _value(result: Mapping[str, Any], name: str) -> str:
    entry = result["parameters"][name]
    return f"{display_name(name)} = {plus_minus(entry['mean'], entry['sd'], interval_of(entry), entry['unit'])}"


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
        stiff = stiffness(entry["median"], interval_of(entry))
        doubt = f", {word}" if word is not Verdict.IDENTIFIED else ""
        values.append(f"{_value(result, name)} ({f'stiffness {stiff} N/µm' if stiff else 'negative: no stiffness'}{doubt})")
    terms = dict.fromkeys(line.term for name in names for line in budgets[name].contributions)
    share = {term: 100.0 * sum(budgets[name].share(term) for name in names) / len(names) for term in terms}
    first, *others = ranked(share, lambda term: share[term])
    second = f", then {source_words(others[0])} ({share[others[0]]:.0f} %)" if others and share[others[0]] > 10.0 else ""
    model = result["model"]
    at = f" at {model['reference_force_N']:g} N" if model["degree"] else ""
    yield (
        f"Compliance{at}, {DEGREES[model['degree']]} in force, ± expanded uncertainty U (k = 2), brackets {percent_of(result)} "
        f"intervals: {joined(values)}. Most of the uncertainty is {source_words(first)} ({share[first]:.0f} % of the "
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
    free, rest = (joined([_value(result, n) for n in clear if (n in confounded) is which]) for which in (False, True))
    if not confounded:
        shown = f"different from zero (k = 2): {free}" if clear else "none differs from zero (k = 2)"
        yield f"Geometric errors ({len(entries)}, without tool offsets): {shown}."
    elif flat:
        yield (
            f"Geometric errors: {_shown(confounded)} look exactly like {partners}, which these intervals leave out: they are not "
            "known as well as is printed."
        )
    else:
        shown = f" Different from zero (k = 2): {free}." if free else ""
        shown += f" Beyond what was assumed of these: {rest}." if rest else ""
        yield (
            f"Geometric errors: {_shown(confounded)} are confounded with {partners}; their intervals rest on what was assumed of "
            "these, and more readings of the same kind do not narrow them."
            f"{shown or ' None differs from zero (k = 2).'}"
        )


def comparison_summary(result: Mapping[str, Any], compared: Comparison | str) -> Iterator[str]:
    """Return whether compliance is constant or linear, and the compliances of a model that the readings prefer."""
    if not isinstance(compared, Comparison):
        yield f"Constant or linear compliance could not be compared: {compared}"
        return
    yield f"Constant or linear compliance: {_evidence(compared)} {_SIGNS[compared.sign]}"
    best = ranked(compared.models, lambda name: compared.models[name].posterior_probability)[0]
    model, degree = compared.models[best], result["model"]["degree"]
    if model.degree != degree and model.posterior_probability > 0.5:
        values = [
            f"{name} = {plus_minus(own.mean, own.sd, (own.mean - 2.0 * own.sd, own.mean + 2.0 * own.sd), own.unit)}"
            for name, own in model.parameters.items()
            if is_direct(name)
        ]
        yield (
            f"The numbers of this page are of {DEGREES[degree]} compliance. With {best} compliance, which the readings prefer "
            f"(probability {model.posterior_probability:.3g}): {joined(values)}; to sign these, fit with --degree {model.degree}."
        )


def next_summary(budgets: Mapping[str, Budget], flat: bool, design: Design | str, given: bool) -> Iterator[str]:
    """Return what would help most, and which circles to run next."""
    if flat:
        yield "What would help most: fit with the default preset. Least squares sees nothing but white noise."
        return
    remedies: dict[str, list[str]] = {}
    for name, budget in budgets.items():
        if is_direct(name) or (name.startswith("E_") and name[3] != "t"):
            remedies.setdefault(remedy_words(budget), []).append(name)
    most = ranked(remedies.items(), lambda pair: len(pair[1]))[:2]
    yield "What would help most: " + " ".join(f"{_shown(names)}: {_lowered(remedy)}" for remedy, names in most)
    if isinstance(design, str):
        return
    ratio = _ratios(design)
    best = ranked(ratio, lambda name: -ratio[name], tolerance=_ALIKE)[0]
    run, steps = _tests_to_run(design), design.compared[0].name
    if ratio[best] > _WORTH and not given:
        yield (
            f"Other forces alone would not help: of as many circles the best ({run}) narrow no interval by more than "
            f"{100 * (1.0 - _WORTH):.0f} % against {steps}."
        )
    else:
        when = "Recommended next" if given else "If the campaign is run anew"
        yield f"{when}: run {run}; against {steps} the interval of {display_name(best)} is then {ratio[best]:.2f} times as wide."


def degeneracy_items(found: Identifiability) -> tuple[str, ...]:
    """Return every degeneracy with what would separate it."""
    pairs = zip(found.degeneracies, found.cures, strict=True)
    return tuple(f"{statement(own)} What would: {_lowered(cure_words(own, cures))}" for own, cures in pairs)


def change_sentence(first: str, other: str, table: pd.DataFrame, ci_prob: float) -> str:
    """Return which parameters of a campaign differ from those of the first."""
    tail = 0.5 - 0.5 * ci_prob
    clear = table[(table["probability_of_increase"] > 1.0 - tail) | (table["probability_of_increase"] < tail)]
    sizes = [
        f"{display_name(str(name))} {plus_minus(row['difference'], row['sd'], (row['ci_low'], row['ci_high']), row['unit'])}"
        for name, row in clear.iterrows()
    ]
    differs = (
        f"differs from {first} (± U, k = 2): {'; '.join(sizes)}" if sizes else f"does not differ from {first} in any parameter"
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


__all__ = sorted(name for name, own in globals().items() if getattr(own, "__module__", "") == __name__ and name[0] != "_")
